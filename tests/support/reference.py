"""The oracle: the hinge pair in 60-digit arithmetic, from its definitions alone.

Every coordinate is a Taylor polynomial in t, cut after t^2. S1(t) is the product of elementary rotations of such
angles, Sh(t) the rotation about n by such an angle, R2(t) = R1 + S1 u1 - S2 u2. Velocities and accelerations are
read off the coefficients: v2 is one of them, and omega is vee(S' S^T) of the series of S. No formula for omega,
alpha, v2 or a2 appears here, and nothing is imported from hingepair.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import mpmath
import numpy as np

DIGITS = 60
OUTPUTS = ("R2", "S2", "d", "v2", "omega2", "a2", "alpha2", "S1", "omega1", "alpha1")
BOUNDS = {
    "S1": 6, "S2": 13, "d": 10, "R2": 10, "omega1": 4, "omega2": 6, "v2": 10, "alpha1": 4, "alpha2": 8, "a2": 12,
}  # fmt: skip
"""What all keep to that are not searched for; what is proved is more (`pair.accuracy`)."""
ORDINARY = BOUNDS | {"S2": 12, "d": 8, "R2": 8, "omega1": 3, "omega2": 3, "v2": 6, "alpha2": 4, "a2": 6}
"""What random states keep to, thousands of them, and hard ones."""
UNIT = {np.dtype(np.float64): 2.0**-53, np.dtype(np.float32): 2.0**-24}

_AXES = {"X": (1, 0, 0), "Y": (0, 1, 0), "Z": (0, 0, 1)}
_exact = np.frompyfunc(mpmath.mpf, 1, 1)
_sin = np.frompyfunc(mpmath.sin, 1, 1)
_cos = np.frompyfunc(mpmath.cos, 1, 1)
_sqrt = np.frompyfunc(mpmath.sqrt, 1, 1)


class Series:
    """A matrix that depends on time: c0 + c1 t + c2 t^2, the coefficients stacks (N, rows, columns) of mpf."""

    def __init__(self, c0, c1, c2):
        self.c0, self.c1, self.c2 = c0, c1, c2

    def __add__(self, other):
        return Series(self.c0 + other.c0, self.c1 + other.c1, self.c2 + other.c2)

    def __sub__(self, other):
        return Series(self.c0 - other.c0, self.c1 - other.c1, self.c2 - other.c2)

    def __matmul__(self, other):
        if not isinstance(other, Series):
            return Series(self.c0 @ other, self.c1 @ other, self.c2 @ other)
        return Series(
            self.c0 @ other.c0,
            self.c0 @ other.c1 + self.c1 @ other.c0,
            self.c0 @ other.c2 + self.c1 @ other.c1 + self.c2 @ other.c0,
        )


@dataclass(frozen=True, eq=False)
class Truth:
    """The exact outputs by name, (N, ...) arrays of mpf, and the scale of each output per sample, (N,) floats."""

    values: dict
    scales: dict

    def errors(self, name, got):
        """The largest component's error of each sample in units of u * scale; inf where got is not finite."""
        got = np.asarray(got)
        unit = UNIT[got.dtype]
        truth = self.values[name]
        rows = got.astype(float).reshape(len(truth), -1)
        finite = np.isfinite(rows).all(axis=-1)
        with mpmath.workdps(DIGITS):
            safe = np.where(finite[:, None], rows, 0.0).astype(object)
            gap = abs(safe - truth.reshape(safe.shape)).max(axis=-1)
            # Below the smallest normal number no relative precision is left, whatever the scale.
            smallest = mpmath.mpf(float(np.finfo(got.dtype).tiny))
            scales = [max(mpmath.mpf(unit) * s, smallest) for s in self.scales[name]]
            ratio = [float(g / s) for g, s in zip(gap, scales, strict=True)]
        return np.where(finite, ratio, np.inf)


def remembered(function):
    """The same for the same numbers: each backend is held against one truth."""
    known = {}

    def key_of(value):
        if isinstance(value, tuple | list):
            return tuple(map(key_of, value))
        if isinstance(value, np.ndarray):
            numbers = tuple(x._mpf_ for x in value.flat) if value.dtype == object else value.tobytes()
            return value.shape, value.dtype.str, numbers
        return value

    @functools.wraps(function)
    def remembering(*arguments, **options):
        key = key_of((arguments, tuple(options.items())))
        if key not in known:
            known[key] = function(*arguments, **options)
        return known[key]

    return remembering


@remembered
def from_euler(pair, q, qd=None, qdd=None, sequence="XYZ"):
    """The truth for coordinates q = (x, y, z, phi_1, phi_2, phi_3, psi), shape (N, 7); rates not given are zero.

    pair: (u1, u2, n, home), plain arrays; n of any length; home None or a rotation, which is taken as it stands.
    """
    with mpmath.workdps(DIGITS + _squares(qd)):
        q, qd, qdd = (_coordinates(c, np.shape(q)) for c in (q, qd, qdd))
        series = [(q[:, i], qd[:, i], qdd[:, i] / 2) for i in range(7)]
        turns = [rotation(exactly(_AXES[k.upper()]), series[3 + i]) for i, k in enumerate(sequence)]
        first, second, third = turns if sequence.isupper() else reversed(turns)
        S1 = first @ second @ third
        R1 = Series(*(_column(c) for c in (q[:, :3], qd[:, :3], qdd[:, :3] / 2)))
        values = _follow(pair, R1, S1, series[6])
    return Truth(values, euler_scales(pair, *(c.astype(float) for c in (q, qd, qdd))))


def from_attitude(pair, body1, psi, psid=None, psidd=None):
    """The truth for a given attitude: body1 = (R1, S1, v1, omega1, a1, alpha1), shapes (N, 3) and S1 (N, 3, 3).

    S1 stands for the rotation next to it; S1(t) is its series S1 + S1' t + S1'' t^2/2 from S1' = [omega1]x S1 (E3).
    """
    shape = np.shape(psi)
    with mpmath.workdps(DIGITS + _squares(psid)):
        psi, psid, psidd = (_coordinates(c, shape) for c in (psi, psid, psidd))
        R, S, v, omega, a, alpha = (exactly(x) for x in body1)
        S, W = nearest_rotation(S), skew(omega)
        S1 = Series(S, W @ S, (skew(alpha) + W @ W) @ S / 2)
        R1 = Series(*(_column(c) for c in (R, v, a / 2)))
        values = _follow(pair, R1, S1, (psi, psid, psidd / 2))
    R, _, v, omega, a, alpha = (np.asarray(x, float) for x in body1)
    rates = (np.column_stack([x, c.astype(float)]) for x, c in ((R, psi), (v, psid), (a, psidd)))
    return Truth(values, _scales(pair, tuple(rates), _length(omega), _length(alpha)))


@remembered
def forces_from_attitude(pair, bodies, body1, psi, psid, psidd, gravity):
    """What must act: force1, torque1 about R1 and hinge_torque, (N, ...) arrays of mpf; as `from_attitude`.

    bodies: (mass, centre of mass, inertia about it) of both, body axes. The momenta are differentiated: of the centre
    of mass, and of x x x' over the body, which takes its second moments and the series of S.
    """
    with mpmath.workdps(DIGITS):
        R, S, v, omega, a, alpha = (exactly(x) for x in body1)
        S, W = nearest_rotation(S), skew(omega)
        S1 = Series(S, W @ S, (skew(alpha) + W @ W) @ S / 2)
        u1, u2 = (exactly(u)[..., None] for u in pair[:2])
        turned = S1 @ rotation(
            unit(pair[2]), tuple(exactly(c) / (1, 1, 2)[i] for i, c in enumerate((psi, psid, psidd)))
        )
        S2 = turned if pair[3] is None else turned @ exactly(pair[3])
        R1 = Series(*(_column(c) for c in (R, v, a / 2)))
        R2 = R1 + S1 @ u1 - S2 @ u2
        hinge = (R1 + S1 @ u1).c0[..., 0]
        force, torque, levers = [], [], []
        for (mass, centre, inertia), Ri, Si in zip(bodies, (R1, R2), (S1, S2), strict=True):
            at, J = Ri + Si @ exactly(centre)[..., None], exactly(inertia)
            spread = exactly(np.eye(3)) * (J[0, 0] + J[1, 1] + J[2, 2]) / 2 - J
            rate = Si.c0 @ spread @ np.swapaxes(2 * Si.c2, -1, -2)
            force.append(exactly(mass) * (2 * at.c2[..., 0] - exactly(gravity)))
            torque.append(np.stack([rate[:, i, j] - rate[:, j, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=-1))
            levers.append(at.c0[..., 0])
        about = sum(t + np.cross(x - R, f) for t, x, f in zip(torque, levers, force, strict=True))
        moment = torque[1] + np.cross(levers[1] - hinge, force[1])
        axis = (S1 @ unit(pair[2])[..., None]).c0[..., 0]
        return force[0] + force[1], about, (axis * moment).sum(axis=-1)


def euler_scales(pair, q, qd, qdd):
    """The scale of every output, (N,) each, for coordinates of shape (N, 7)."""
    W1 = abs(qd[:, 3:6]).sum(axis=-1)
    A1 = abs(qdd[:, 3:6]).sum(axis=-1) + W1**2
    return _scales(pair, (q, qd, qdd), W1, A1)


def rotation(axis, angle):
    """I + sin K + (1 - cos) K^2: the turn about a unit axis, (3,) or (N, 3), by an angle that is a series (N,)."""
    f0, f1, f2 = angle
    s, c, half = _sin(f0), _cos(f0), _sin(f0 / 2)
    sine = (s, c * f1, c * f2 - s * f1 * f1 / 2)
    versine = (2 * half * half, s * f1, s * f2 + c * f1 * f1 / 2)
    K = skew(axis)
    terms = [_stack(x) * K + _stack(y) * (K @ K) for x, y in zip(sine, versine, strict=True)]
    return Series(terms[0] + exactly(np.eye(3)), terms[1], terms[2])


def angular_motion(S):
    """The angular velocity vee(S' S^T) and its derivative, from the series of S."""
    transposed = np.swapaxes(S.c0, -1, -2)
    rate = S.c1 @ transposed
    change = 2 * S.c2 @ transposed + S.c1 @ np.swapaxes(S.c1, -1, -2)
    return tuple(np.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]], axis=-1) for W in (rate, change))


def unit(n):
    """The axis scaled to length one, in the working precision; float components of any size."""
    n = exactly(n)
    return n / _sqrt((n * n).sum(axis=-1, keepdims=True))


def exactly(numbers):
    """The numbers as an array of mpf, none rounded."""
    numbers = np.asarray(numbers)
    return _exact(numbers if numbers.dtype == object else numbers.astype(float))


def skew(w):
    """[w]x for w of shape (..., 3)."""
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    zero = 0 * x
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*np.shape(x), 3, 3)


def nearest_rotation(S):
    """The rotation that a matrix rounds: Newton-Schulz steps, each squares the distance from orthogonality."""
    for _ in range(4):
        S = S @ (3 * exactly(np.eye(3)) - np.swapaxes(S, -1, -2) @ S) / 2
    return S


def attitude_of_rotvec(rotvec):
    """The rotation of rotation vectors, (N, 3) -> (N, 3, 3)."""
    with mpmath.workdps(DIGITS + 320):
        vector = exactly(rotvec)
        angle = _sqrt((vector * vector).sum(axis=-1))
        axis = vector / np.where(angle == 0, mpmath.mpf(1), angle)[..., None]
        zero = 0 * angle
        return rotation(axis, (angle, zero, zero)).c0


def attitude_of_quaternion(quat_xyzw):
    """The rotation of a quaternion of any length, (N, 4) -> (N, 3, 3): q e q* for each e of Hamilton's i, j, k."""
    with mpmath.workdps(DIGITS):
        x, y, z, w = np.moveaxis(unit(quat_xyzw), -1, 0)
        columns = []
        for e in np.eye(3, dtype=int):
            left = _hamilton((w, x, y, z), (0, *e.tolist()))
            columns.append(np.stack(_hamilton(left, (w, -x, -y, -z))[1:], axis=-1))
        return np.stack(columns, axis=-1)


def _hamilton(p, q):
    a, b, c, d = p
    e, f, g, h = q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def _follow(pair, R1, S1, psi):
    u1, u2, n, home = pair
    u1, u2 = (exactly(u)[..., None] for u in (u1, u2))
    S2 = S1 @ rotation(unit(n), psi)
    omega2, alpha2 = angular_motion(S2)
    if home is not None:
        S2 = S2 @ exactly(home)
    d = S1 @ u1 - S2 @ u2
    R2 = R1 + d
    omega1, alpha1 = angular_motion(S1)
    flat = {"R2": R2.c0, "d": d.c0, "v2": R2.c1, "a2": 2 * R2.c2}
    found = {name: value[..., 0] for name, value in flat.items()}
    found |= {"S1": S1.c0, "S2": S2.c0}
    return found | {"omega1": omega1, "omega2": omega2, "alpha1": alpha1, "alpha2": alpha2}


def _scales(pair, coordinates, W1, A1):
    """docs/concepts/accuracy.md: the size of the terms before they cancel, per sample."""
    lever1, lever2 = (_length(np.asarray(u, float)) for u in pair[:2])
    R1, v1, a1 = (abs(c[:, :3]).max(axis=-1) for c in coordinates)
    psid, psidd = (abs(c[:, -1]) for c in coordinates[1:])
    one = np.ones(len(R1))
    W2 = W1 + psid
    A2 = A1 + psidd + W1 * psid
    return {
        "S1": one,
        "S2": one,
        "d": one * (lever1 + lever2),
        "R2": R1 + lever1 + lever2,
        "omega1": W1,
        "omega2": W2,
        "v2": v1 + W1 * lever1 + W2 * lever2,
        "alpha1": A1,
        "alpha2": A2,
        "a2": a1 + A1 * lever1 + W1 * (W1 * lever1) + A2 * lever2 + W2 * (W2 * lever2),
    }


def _coordinates(values, shape):
    return exactly(np.zeros(shape) if values is None else values)


def _squares(rates):
    """Digits that cancel where omega' is taken from S'' and S': those of the squares of the rates."""
    largest = 0.0 if rates is None else float(np.max(np.abs(np.asarray(rates, float)), initial=0.0))
    return max(0, 2 * int(np.log10(largest))) if largest > 1 and np.isfinite(largest) else 0


def _column(vectors):
    return vectors[..., None]


def _stack(numbers):
    return numbers[:, None, None]


def _length(v):
    return np.hypot(np.hypot(v[..., 0], v[..., 1]), v[..., 2])
