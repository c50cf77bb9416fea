"""Exact results of pairs in sixty-digit arithmetic, from their definition alone.

Every coordinate is a Taylor polynomial in t, cut after t^2, and every pose a product of such poses. Velocities and
accelerations are read off the coefficients, and omega is vee(S' S^T) of the series of S. No formula for omega or an
acceleration appears here, and no code is shared with the rest of hingepair, so that `hingepair bench` and tests may
judge it.
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
    return Truth(values, motion_scales(pair, rates, _length(omega), _length(alpha)))


def given_motion(body: Sequence[Any]) -> tuple[Series, Series]:
    """Return position and attitude of R, S, v, omega, a, alpha as series, from S' = [omega]x S (E3)."""
    R, S, v, omega, a, alpha = (exactly(x) for x in body)
    S, W = nearest_rotation(S), skew(omega)
    return (
        Series(R[..., None], v[..., None], a[..., None] / 2),
        Series(S, W @ S, (skew(alpha) + W @ W) @ S / 2),
    )


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
    return motion_scales(pair, (q, qd, qdd), W1, A1)


def motion_scales(pair: Sequence[Any], coordinates: Sequence[Array], W1: Array, A1: Array) -> dict[str, Array]:
    """Return the size of the terms before they cancel, per sample (docs/concepts/accuracy.md).

    Args:
        pair: u1, u2.
        coordinates: positions and hinge angle, and their rates and accelerations; (N, 4) or (N, 7) each.
        W1: size of the angular velocity of body 1; (N,).
        A1: that of its angular acceleration.
    """
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
