"""Exact results: pairs and robots in sixty-digit arithmetic, from their definitions alone.

Every coordinate is a Taylor polynomial in t, cut after t^2, and every pose a product of such poses. Velocities and
accelerations are read off the coefficients, and omega is vee(S' S^T) of the series of S. Forces are sums over bodies
of the rates of their momenta. No formula for omega, an acceleration or a force appears here, and no code is shared
with the rest of hingepair, so that benchmarks and tests may judge it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import mpmath
import numpy as np
from numpy.typing import ArrayLike, NDArray

Array: TypeAlias = NDArray[Any]
Pair: TypeAlias = tuple[Any, Any, Any, Any]
"""u1, u2, n of any length, and home, which is taken as it stands (None: identity)."""

DIGITS = 60  # decimal
OUTPUTS = ("R2", "S2", "d", "v2", "omega2", "a2", "alpha2", "S1", "omega1", "alpha1")  # of a pair
UNIT = {np.dtype(np.float64): 2.0**-53, np.dtype(np.float32): 2.0**-24}  # unit roundoff
LETTERS = ("R", "S", "v", "omega", "a", "alpha")  # of a frame's motion

_AXES = {"X": (1, 0, 0), "Y": (0, 1, 0), "Z": (0, 0, 1)}
_exact: Any = np.frompyfunc(mpmath.mpf, 1, 1)
_sin: Any = np.frompyfunc(mpmath.sin, 1, 1)
_cos: Any = np.frompyfunc(mpmath.cos, 1, 1)
_sqrt: Any = np.frompyfunc(mpmath.sqrt, 1, 1)


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """A matrix that depends on time, c0 + c1 t + c2 t^2; stacks (N, rows, columns) of mpf."""

    c0: Array
    c1: Array
    c2: Array

    def __add__(self, other: Series) -> Series:
        return Series(self.c0 + other.c0, self.c1 + other.c1, self.c2 + other.c2)

    def __sub__(self, other: Series) -> Series:
        return Series(self.c0 - other.c0, self.c1 - other.c1, self.c2 - other.c2)

    def __matmul__(self, other: Series | Array) -> Series:
        if not isinstance(other, Series):
            return Series(self.c0 @ other, self.c1 @ other, self.c2 @ other)
        return Series(
            self.c0 @ other.c0,
            self.c0 @ other.c1 + self.c1 @ other.c0,
            self.c0 @ other.c2 + self.c1 @ other.c1 + self.c2 @ other.c0,
        )


class Truth(NamedTuple):
    """The exact outputs of a pair by name."""

    values: dict[str, Array]  # (N, ...), of mpf
    scales: dict[str, Array]  # (N,), of floats: what errors are divided by

    def errors(self, name: str, got: ArrayLike) -> Array:
        """Return the largest error of a component of each sample [u * scale]; inf where `got` is not finite."""
        found = np.asarray(got)
        truth = self.values[name]
        rows = found.astype(float).reshape(len(truth), -1)
        finite = np.isfinite(rows).all(axis=-1)
        with mpmath.workdps(DIGITS):
            safe = np.where(finite[:, None], rows, 0.0).astype(object)
            gap = abs(safe - truth.reshape(safe.shape)).max(axis=-1)
            # Below the smallest normal number no relative precision is left, whatever the scale.
            smallest = mpmath.mpf(float(np.finfo(found.dtype).tiny))
            scales = [max(mpmath.mpf(UNIT[found.dtype]) * s, smallest) for s in self.scales[name]]
            ratio = [float(g / s) for g, s in zip(gap, scales, strict=True)]
        return np.where(finite, ratio, np.inf)


def from_euler(pair: Pair, q: Any, qd: Any = None, qdd: Any = None, sequence: str = "XYZ") -> Truth:
    """Return the truth for coordinates (x, y, z, phi_1, phi_2, phi_3, psi), shape (N, 7); absent rates are zero."""
    with mpmath.workdps(DIGITS + _cancelled(qd)):
        q, qd, qdd = (_coordinates(c, np.shape(q)) for c in (q, qd, qdd))
        series = [(q[:, i], qd[:, i], qdd[:, i] / 2) for i in range(7)]
        turns = [rotation(exactly(_AXES[k.upper()]), series[3 + i]) for i, k in enumerate(sequence)]
        first, second, third = turns if sequence.isupper() else reversed(turns)
        S1 = first @ second @ third
        R1 = Series(*(c[..., None] for c in (q[:, :3], qd[:, :3], qdd[:, :3] / 2)))
        values = _body2(pair, R1, S1, series[6])
    return Truth(values, euler_scales(pair, *(c.astype(float) for c in (q, qd, qdd))))


def from_attitude(
    pair: Pair, body1: Sequence[Any], psi: Array, psid: Array | None = None, psidd: Array | None = None
) -> Truth:
    """Return the truth for a given attitude.

    Args:
        pair: the pair.
        body1: R1, S1, v1, omega1, a1, alpha1; S1 (N, 3, 3) stands for the rotation next to it, others are (N, 3).
        psi: hinge angle, (N,); its rates likewise.
        psid: zero if None.
        psidd: zero if None.
    """
    shape = np.shape(psi)
    with mpmath.workdps(DIGITS + _cancelled(psid)):
        psi, psid, psidd = (_coordinates(c, shape) for c in (psi, psid, psidd))
        values = _body2(pair, *given_motion(body1), (psi, psid, psidd / 2))
    R, _, v, omega, a, alpha = (np.asarray(x, float) for x in body1)
    rates = [np.column_stack([x, c.astype(float)]) for x, c in ((R, psi), (v, psid), (a, psidd))]
    return Truth(values, _scales(pair, rates, _length(omega), _length(alpha)))


def given_motion(body: Sequence[Any]) -> tuple[Series, Series]:
    """Return position and attitude of R, S, v, omega, a, alpha as series, from S' = [omega]x S (E3)."""
    R, S, v, omega, a, alpha = (exactly(x) for x in body)
    S, W = nearest_rotation(S), skew(omega)
    return (
        Series(R[..., None], v[..., None], a[..., None] / 2),
        Series(S, W @ S, (skew(alpha) + W @ W) @ S / 2),
    )


class Required(NamedTuple):
    """Force and torque that the motion of a body requires."""

    force: Array  # (N, 3)
    torque: Array  # about the centre of mass
    centre: Array  # where that is


def required(origin: Series, turn: Series, body: Sequence[Any], gravity: Array) -> Required:
    """Return what the motion of a body requires beside gravity: the rates of the momenta of its mass.

    Args:
        origin: the reference point.
        turn: rotation from body axes.
        body: mass, centre of mass and inertia about it, body axes.
        gravity: (3,), which adds no force of its own.
    """
    mass, centre, J = (exactly(part) for part in body)
    place = origin + turn @ centre[:, None]
    spread = exactly(np.eye(3)) * (J[0, 0] + J[1, 1] + J[2, 2]) / 2 - J  # second moments of the mass
    rate = turn.c0 @ spread @ np.swapaxes(2 * turn.c2, -1, -2)
    torque = np.stack([rate[:, i, j] - rate[:, j, i] for i, j in ((1, 2), (2, 0), (0, 1))], axis=-1)
    return Required(mass * (2 * place.c2[..., 0] - gravity), torque, place.c0[..., 0])


class ExactRobot:
    """A robot at N states.

    Args:
        tree: the record of the robot; its matrices stand for the rotations next to them.
        q: positions, (N, dof); qd and qdd likewise.
        qd: zero if None.
        qdd: zero if None.
        base: R, S, v, omega, a, alpha of the base, (N, 3) and (N, 3, 3); None for a base at rest at the origin.
        gravity: (3,).
    """

    def __init__(
        self,
        tree: Any,
        q: Any,
        qd: Any = None,
        qdd: Any = None,
        base: Sequence[Any] | None = None,
        gravity: Sequence[Any] | Array = (0, 0, -9.81),
    ) -> None:
        self._tree, self._gravity = tree, exactly(gravity)
        shape = np.shape(q)
        self._columns, self._ratios, offsets = _followers(tree)
        self._dof = shape[1]
        if base is None:
            zero = np.zeros((shape[0], 3))
            base = (zero, np.broadcast_to(np.eye(3), (shape[0], 3, 3)), zero, zero, zero, zero)
        with mpmath.workdps(DIGITS):
            q, qd, qdd = (_coordinates(c, shape)[:, self._columns] * self._ratios for c in (q, qd, qdd))
            self._state = q, qd, qdd
            q = q + offsets
            self.poses = [given_motion(base)]
            self._axes = [exactly(np.zeros(3))]
            self._points = [self.poses[0][0].c0[..., 0]]
            for k, joint in enumerate(tree.joints):
                origin, turn = self.poses[joint.parent]
                motion = q[:, k], qd[:, k], qdd[:, k] / 2
                point, turn = origin + turn @ exactly(joint.u)[:, None], turn @ nearest_rotation(exactly(joint.S))
                axis = unit(joint.n)
                turns, shifts = map(mpmath.mpf, joint.axis)
                point = point + turn @ Series(*(shifts * part[:, None, None] * axis[:, None] for part in motion))
                turn = turn @ rotation(axis, tuple(turns * part for part in motion))
                self._axes.append((turn @ axis[:, None]).c0[..., 0])
                self._points.append(point.c0[..., 0])
                self.poses.append((point, turn))

    def motion(self, frame: Any) -> dict[str, Array]:
        """Return R, S, v, omega, a, alpha and d of a frame of the tree; (N, 3) and (N, 3, 3)."""
        with mpmath.workdps(DIGITS):
            origin, turn = self.poses[frame.body]
            d = turn @ exactly(frame.R)[:, None] + (origin - self.poses[0][0])
            place = d + self.poses[0][0]
            omega, alpha = angular_motion(turn)
            R, v, a = place.c0[..., 0], place.c1[..., 0], 2 * place.c2[..., 0]
            values = (R, turn.c0 @ nearest_rotation(exactly(frame.S)), v, omega, a, alpha)
            return dict(zip(LETTERS, values, strict=True)) | {"d": d.c0[..., 0]}

    def forces(self, *, base_counts: bool = True) -> tuple[Array, Array, Array]:
        """Return force1, torque1 about R1, (N, 3), and tau, (N, dof).

        Args:
            base_counts: whether the base's own mass counts in force1 and torque1.
        """
        with mpmath.workdps(DIGITS):
            own = [self._required(k) for k in range(len(self.poses))]
            reference = self._points[0]
            counted = own if base_counts else own[1:]
            force1 = sum((force for force, *_ in counted), start=0 * reference)
            torque1 = sum((t + np.cross(x - reference, f) for f, t, x in counted), start=0 * reference)
            tau = exactly(np.zeros((len(reference), self._dof)))
            for k, joint in enumerate(self._tree.joints, 1):
                carried = [own[i] for i in range(1, len(own)) if k in self._path(i)]
                force = sum(f for f, *_ in carried)
                torque = sum(t + np.cross(x - self._points[k], f) for f, t, x in carried)
                effort = (self._axes[k] * (joint.axis.turns * torque + joint.axis.shifts * force)).sum(axis=-1)
                tau[:, self._columns[k - 1]] += self._ratios[k - 1] * effort
            return force1, torque1, tau

    def jacobian(self, body: int, point: Array) -> Array:
        """Return the velocity of a point (N, 3) of a body and the body's omega for unit rates; (N, 6, dof)."""
        with mpmath.workdps(DIGITS):
            J = exactly(np.zeros((len(point), 6, self._dof)))
            for k in self._path(body):
                axis = self._axes[k]
                turns, shifts = map(mpmath.mpf, self._tree.joints[k - 1].axis)
                parts = (turns * np.cross(axis, point - self._points[k]) + shifts * axis, turns * axis)
                J[:, :, self._columns[k - 1]] += self._ratios[k - 1] * np.concatenate(parts, axis=-1)
            return J

    def mass_matrix(self) -> Array:
        """Return the matrix of the kinetic energy in the rates, with the base at rest; (N, dof, dof)."""
        with mpmath.workdps(DIGITS):
            M = exactly(np.zeros((len(self._points[0]), self._dof, self._dof)))
            for k, joint in enumerate(self._tree.joints, 1):
                turn = self.poses[k][1].c0
                J = self.jacobian(k, self._required(k).centre)
                v, omega = J[:, :3], np.swapaxes(turn, -1, -2) @ J[:, 3:]
                M += exactly(joint.body.mass) * np.swapaxes(v, -1, -2) @ v
                M += np.swapaxes(omega, -1, -2) @ exactly(joint.body.inertia) @ omega
            return M

    def accelerations(self, tau: Any) -> Array:
        """Return the qdd, (N, dof), that efforts tau cause; the robot is at rest on its base and its own qdd zero."""
        with mpmath.workdps(DIGITS):
            remaining, M = exactly(tau) - self.forces()[2], self.mass_matrix()
            systems = zip(M.tolist(), remaining.tolist(), strict=True)
            return np.array([list(mpmath.lu_solve(mpmath.matrix(A), b)) for A, b in systems], dtype=object)

    def torque_slopes(self, qdd: Any = None) -> tuple[Array, Array]:
        """Return the derivatives of tau by q and by qd, (N, dof, dof), of a robot without mimic joints at rest on its
        base; qdd takes the place of the robot's own.
        """

        def tau(q: Any, qd: Any, qdd: Any) -> Array:
            return ExactRobot(self._tree, q, qd, qdd, gravity=self._gravity).forces()[2]

        state = (*self._state[:2], self._state[2] if qdd is None else qdd)
        return exact_slopes(tau, state, 0), exact_slopes(tau, state, 1)

    def acceleration_slopes(self, tau: Any) -> tuple[Array, Array]:
        """Return the derivatives of the qdd that efforts tau cause, by q and by qd, (N, dof, dof)."""
        with mpmath.workdps(DIGITS):
            q, qd, _ = self._state
            slopes = self.torque_slopes(ExactRobot(self._tree, q, qd, gravity=self._gravity).accelerations(tau))
            inverse = np.array([mpmath.inverse(mpmath.matrix(M)).tolist() for M in self.mass_matrix().tolist()])
            by_q, by_qd = (-np.stack([A @ B for A, B in zip(inverse, one, strict=True)]) for one in slopes)
            return by_q, by_qd

    def _path(self, body: int) -> list[int]:
        """Return the numbers, from 1, of the joints from a body to the base."""
        found = []
        while body:
            found.append(body)
            body = self._tree.joints[body - 1].parent
        return found

    def _required(self, body: int) -> Required:
        masses = self._tree.joints[body - 1].body if body else self._tree.base
        parts = masses.mass, masses.centre_of_mass, masses.inertia
        return required(*self.poses[body], parts, self._gravity)


def _followers(tree: Any) -> tuple[list[int], Array, Array]:
    """Return, of each joint, the column of its coordinate, and its ratio and offset to that."""
    columns = {joint.name: i for i, joint in enumerate(tree.coordinates)}
    own = [(joint, joint.mimic) for joint in tree.joints]
    leaders = [joint if mimic is None else tree.joints[mimic.leader - 1] for joint, mimic in own]
    ratios = [1.0 if mimic is None else mimic.multiplier for _, mimic in own]
    offsets = [0.0 if mimic is None else mimic.offset for _, mimic in own]
    return [columns[joint.name] for joint in leaders], exactly(ratios), exactly(offsets)


def rotation(axis: Array, angle: Sequence[Array]) -> Series:
    """Return the turn about a unit axis, (3,) or (N, 3), by an angle that is a series: I + sin K + (1 - cos) K^2."""
    f0, f1, f2 = angle
    s, c, half = _sin(f0), _cos(f0), _sin(f0 / 2)
    sine = (s, c * f1, c * f2 - s * f1 * f1 / 2)
    versine = (2 * half * half, s * f1, s * f2 + c * f1 * f1 / 2)
    K = skew(axis)
    terms = [x[:, None, None] * K + y[:, None, None] * (K @ K) for x, y in zip(sine, versine, strict=True)]
    return Series(terms[0] + exactly(np.eye(3)), terms[1], terms[2])


def angular_motion(S: Series) -> tuple[Array, Array]:
    """Return the angular velocity vee(S' S^T) and its derivative."""
    transposed = np.swapaxes(S.c0, -1, -2)
    rate = S.c1 @ transposed
    change = 2 * S.c2 @ transposed + S.c1 @ np.swapaxes(S.c1, -1, -2)
    omega, alpha = (np.stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]], axis=-1) for W in (rate, change))
    return omega, alpha


def unit(n: ArrayLike) -> Array:
    """Return an axis of any size scaled to length one."""
    n = exactly(n)
    return np.asarray(n / _sqrt((n * n).sum(axis=-1, keepdims=True)))


def exact_slopes(function: Any, arguments: Sequence[Any], by: int) -> Array:
    """Return the derivatives (N, m, n) of a function's results (N, m) by one of its arguments, (N, n).

    Central differences of steps of 10^-20 are right to some 35 digits.
    """
    with mpmath.workdps(DIGITS):
        given = [exactly(one) for one in arguments]
        n, step = given[by].shape[1], mpmath.mpf(10) ** -20
        columns = []
        for k in range(n):
            near = []
            for sign in (1, -1):
                moved = given[by].copy()
                moved[:, k] += sign * step
                near.append(function(*given[:by], moved, *given[by + 1 :]))
            columns.append((near[0] - near[1]) / (2 * step))
        return np.stack(columns, axis=-1)


def exactly(numbers: ArrayLike) -> Array:
    """Return the numbers as an array of mpf, none rounded."""
    numbers = np.asarray(numbers)
    return np.asarray(_exact(numbers if numbers.dtype == object else numbers.astype(float)), dtype=object)


def skew(w: Array) -> Array:
    """Return [w]x for w of shape (..., 3)."""
    x, y, z = w[..., 0], w[..., 1], w[..., 2]
    zero = 0 * x
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*np.shape(x), 3, 3)


def nearest_rotation(S: Array) -> Array:
    """Return the rotation next to a matrix that is one up to rounding."""
    for _ in range(4):  # Newton-Schulz: each step squares the distance from orthogonality
        S = S @ (3 * exactly(np.eye(3)) - np.swapaxes(S, -1, -2) @ S) / 2
    return S


def attitude_of_rotvec(rotvec: ArrayLike) -> Array:
    """Return the rotations (N, 3, 3) of rotation vectors (N, 3)."""
    with mpmath.workdps(DIGITS + 320):
        vector = exactly(rotvec)
        angle = _sqrt((vector * vector).sum(axis=-1))
        axis = vector / np.where(angle == 0, mpmath.mpf(1), angle)[..., None]
        zero = 0 * angle
        return rotation(axis, (angle, zero, zero)).c0


def attitude_of_quaternion(quat_xyzw: ArrayLike) -> Array:
    """Return the rotations (N, 3, 3) of quaternions (N, 4) of any length: q e q* for each e of Hamilton's i, j, k."""
    with mpmath.workdps(DIGITS):
        x, y, z, w = np.moveaxis(unit(quat_xyzw), -1, 0)
        columns = []
        for e in np.eye(3, dtype=int):
            left = _hamilton((w, x, y, z), (0, *e.tolist()))
            columns.append(np.stack(_hamilton(left, (w, -x, -y, -z))[1:], axis=-1))
        return np.stack(columns, axis=-1)


def _hamilton(p: Sequence[Any], q: Sequence[Any]) -> tuple[Any, ...]:
    """Return the product p q of quaternions (w, x, y, z)."""
    a, b, c, d = p
    e, f, g, h = q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def _body2(pair: Pair, R1: Series, S1: Series, psi: Sequence[Array]) -> dict[str, Array]:
    """Return all OUTPUTS by name, from the series of body 1 and of the hinge angle."""
    u1, u2, n, home = pair
    u1, u2 = (exactly(u)[..., None] for u in (u1, u2))
    S2 = S1 @ rotation(unit(n), psi)
    omega2, alpha2 = angular_motion(S2)
    if home is not None:
        S2 = S2 @ exactly(home)
    d = S1 @ u1 - S2 @ u2
    R2 = R1 + d
    omega1, alpha1 = angular_motion(S1)
    points = {"R2": R2.c0, "d": d.c0, "v2": R2.c1, "a2": 2 * R2.c2}
    found = {name: value[..., 0] for name, value in points.items()}
    rates = {"omega1": omega1, "omega2": omega2, "alpha1": alpha1, "alpha2": alpha2}
    return found | {"S1": S1.c0, "S2": S2.c0} | rates


def euler_scales(pair: Pair, q: Array, qd: Array, qdd: Array) -> dict[str, Array]:
    """Return the scale of every output, (N,) each, for coordinates of shape (N, 7)."""
    W1 = abs(qd[:, 3:6]).sum(axis=-1)
    A1 = abs(qdd[:, 3:6]).sum(axis=-1) + W1**2
    return _scales(pair, (q, qd, qdd), W1, A1)


def _scales(pair: Pair, coordinates: Sequence[Array], W1: Array, A1: Array) -> dict[str, Array]:
    """Return the size of the terms before they cancel, per sample (docs/concepts/accuracy.md)."""
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


def _coordinates(values: Any, shape: tuple[int, ...]) -> Array:
    return exactly(np.zeros(shape) if values is None else values)


def _cancelled(rates: Any) -> int:
    """Return the digits that cancel where omega' is taken from S'' and S': those of the squares of the rates."""
    largest = 0.0 if rates is None else float(np.max(np.abs(np.asarray(rates, float)), initial=0.0))
    return max(0, 2 * int(np.log10(largest))) if largest > 1 and np.isfinite(largest) else 0


def _length(v: Array) -> Array:
    return np.asarray(np.hypot(np.hypot(v[..., 0], v[..., 1]), v[..., 2]))
