"""Exact results to hundreds of digits, computed from the definitions and independently of the library.

S1(t) is the product of three turns about fixed axes by phi + phi' t + phi'' t^2/2 (E10), S2(t) and R2(t) follow (E5,
E6, E7). Velocities and accelerations are finite differences of S2(t) and R2(t) over a time step so short that their
error is far below the rounding of a double. omega is the skew part of S' S^T with S = S1 Sh (E3).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, TypeAlias

import mpmath
import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.bounded import FLOAT64_UNIT_ROUNDOFF
from hingepair.pair.accuracy import euler_rate_sizes, output_scales

Array: TypeAlias = NDArray[Any]
MotionArrays: TypeAlias = tuple[Array, ...]
PairNumbers: TypeAlias = Mapping[str, Any]

TRUTH_DECIMAL_DIGITS = 700
"""Decimal digits; an angle of 1e300 keeps 400 of them, and second differences over 1e-100 s take another 200."""

# Places of phi_y, of psi and of all angles among the seven coordinates.
_PHI_Y_COORDINATE_INDEX, _PSI_COORDINATE_INDEX = 4, 6
_COORDINATE_SLICE_OF_EULER_ANGLES_AND_PSI = slice(3, 7)  # of the three Euler angles and psi among the coordinates


def compute_exact_outputs(pair: PairNumbers, q: Any, qd: Any = None, qdd: Any = None) -> dict[str, Any]:
    """Return a dict of R2, S2, v2, omega2, a2, alpha2 at one state by name, as flat lists of mpmath numbers. `pair`
    is a mapping with u1, u2, n, home; q, qd and qdd have seven components, and qd and qdd are zero unless given.

    Args:
        pair: u1, u2, n, home as numbers.
        q: coordinates; shape (7,).
        qd: their rates; zero unless given.
        qdd: their second derivatives; zero unless given.
    """
    with mpmath.workdps(TRUTH_DECIMAL_DIGITS):
        zero = [0.0] * 7
        motion = [[mpmath.mpf(float(x)) for x in (zero if c is None else c)] for c in (q, qd, qdd)]
        # time step of the finite differences: 1e-100 s divided by the size of the rates
        h = mpmath.mpf(10) ** -100 / (1 + sum(abs(x) for x in motion[1]) + mpmath.sqrt(sum(map(abs, motion[2]))))
        (R0, _, T0), (R, S, T), (R3, _, T3) = (_exact_body2(pair, motion, t) for t in (-h, mpmath.mpf(0), h))
        rate, change = (T3 - T0) / (2 * h), (T3 - 2 * T + T0) / h**2
        outputs = {
            "R2": R,
            "S2": S,
            "v2": (R3 - R0) / (2 * h),
            "omega2": skew_vector(rate * T.T),
            "a2": (R3 - 2 * R + R0) / h**2,
            "alpha2": skew_vector(change * T.T),  # S' S'^T, the other part of the derivative, is symmetric
        }
        return {name: list(value) for name, value in outputs.items()}


def _exact_body2(pair: PairNumbers, motion: Any, t: Any) -> tuple[Any, Any, Any]:
    """Return a tuple of three mpmath matrices at time t [s]: R2, S2, and S1 times the rotation about the hinge axis
    by psi. `motion` is a list of q, qd and qdd at time 0; qdd is constant. `pair` is a mapping with u1, u2, n, home.
    """
    x, y, z, *angles, psi = (a + t * (b + t * c / 2) for a, b, c in zip(*motion, strict=True))
    S1 = mpmath.eye(3)
    for axis, angle in zip(np.eye(3).tolist(), angles, strict=True):
        S1 = S1 * rotation_about_axis(axis, angle)
    S1_Sh = S1 * rotation_about_axis(pair["n"], psi)
    S2 = S1_Sh * mpmath.matrix(pair["home"])
    u1, u2 = mpmath.matrix(pair["u1"]), mpmath.matrix(pair["u2"])
    return mpmath.matrix([x, y, z]) + S1 * u1 - S2 * u2, S2, S1_Sh


def rotation_about_axis(axis: Any, angle: Any) -> Any:
    """Return the rotation matrix about an axis of any length by an angle [rad], as an mpmath matrix."""
    part = mpmath.sin(angle / 2) / mpmath.norm(mpmath.matrix(axis))
    return rotation_of_quaternion((mpmath.cos(angle / 2), *(part * c for c in axis)))


def rotation_of_quaternion(quat: Any) -> Any:
    """Return the rotation matrix of a quaternion (w, x, y, z) of any non-zero length, as an mpmath matrix."""
    w, x, y, z = quat
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    return mpmath.matrix(rows) / (w * w + x * x + y * y + z * z)


def skew_vector(W: Any) -> Any:
    """Return the vector w of the skew part [w]x of a 3 x 3 matrix, as an mpmath matrix (3, 1)."""
    return mpmath.matrix([(W[2, 1] - W[1, 2]) / 2, (W[0, 2] - W[2, 0]) / 2, (W[1, 0] - W[0, 1]) / 2])


class ExactResults:
    """Exact results of a batch of states, computed at construction for the outputs that it names, and the scales of
    their rounding errors. The method `largest_error` compares the results of a computation with them.

    Args:
        pair: u1, u2, n, home: the arguments of the pair.
        motion: q; q and qd; or q, qd and qdd, each of shape (N, 7).
        outputs: names of the outputs that are compared.
    """

    def __init__(self, pair: PairNumbers, motion: MotionArrays, outputs: tuple[str, ...]):
        self.motion = motion
        self.outputs = outputs
        self.scales = _error_scales(pair, self.motion)
        self.exact = [compute_exact_outputs(pair, *state) for state in zip(*self.motion, strict=True)]

    def largest_error(self, results: Mapping[str, Array]) -> float:
        """Return the largest error of the outputs that the constructor names, as a float in units of u * scale, the
        unit roundoff times the scale of the output. `results` is a mapping of arrays by output name, which must hold
        these outputs; others are ignored. The error is inf if a result is not finite.
        """
        worst = 0.0
        for name in self.outputs:
            rows = np.asarray(results[name], dtype=np.float64).reshape(len(self.exact), -1)
            if not np.isfinite(rows).all():
                return math.inf
            scales = np.broadcast_to(self.scales[name], len(rows)).tolist()
            with mpmath.workdps(TRUTH_DECIMAL_DIGITS):
                for row, true, scale in zip(rows.tolist(), self.exact, scales, strict=True):
                    gap = max(abs(x - y) for x, y in zip(row, true[name], strict=True))
                    rounding = max(FLOAT64_UNIT_ROUNDOFF * mpmath.mpf(scale), np.finfo(float).tiny)
                    worst = max(worst, float(gap / rounding))
        return worst


def _error_scales(pair: PairNumbers, motion: MotionArrays) -> dict[str, NDArray[np.float64]]:
    """Return a dict from an output's name to the scale by which its errors are divided: an array (N,) or a number.
    `pair` is a mapping with u1, u2, n, home; `motion` is one of the tuples (q,), (q, qd) and (q, qd, qdd) of arrays
    of shape (N, 7).
    """
    q, qd, qdd = (*motion, None, None)[:3]
    W1, A1 = euler_rate_sizes(None if qd is None else qd[:, 3:6], None if qdd is None else qdd[:, 3:6])
    linear: dict[str, Any] = {name: c[:, :3] for name, c in (("R1", q), ("v1", qd), ("a1", qdd)) if c is not None}
    hinge: dict[str, Any] = {name: c[:, 6] for name, c in (("psid", qd), ("psidd", qdd)) if c is not None}
    return output_scales(u1=pair["u1"], u2=pair["u2"], W1=W1, A1=A1, **linear, **hinge)


def random_states(rng: np.random.Generator, count: int, num_levels: int) -> MotionArrays:
    """Return a tuple of the first `num_levels` (1 to 3) of q, qd and qdd, of normally distributed random numbers from
    `rng`, shape (count, 7) each.

    Args:
        rng: source of the numbers.
        count: number of states.
        num_levels: 1 for q alone, 2 for q and qd, 3 for all.
    """
    return tuple(rng.normal(size=(num_levels, count, 7)))


def hard_states(rng: np.random.Generator, num_levels: int) -> MotionArrays:
    """Return a tuple of the first `num_levels` (1 to 3) of q, qd and qdd of numerically difficult states, shape (N,
    7) each. Each state is random (from `rng`) except for one change, such as a tiny psi.

    Args:
        rng: source of the numbers.
        num_levels: 1 for q alone, 2 for q and qd, 3 for all.
    """
    quarter = math.pi / 2
    changes: list[tuple[Any, Any, float]] = [(_PSI_COORDINATE_INDEX, psi, 1.0) for psi in (1e-160, 1e-9, -1e-5, 0.0)]
    changes += [
        (_PSI_COORDINATE_INDEX, psi, 1.0) for psi in (math.pi, math.pi - 1e-9, math.pi + 1e-9, 1e5, -1e16, 1e300)
    ]
    changes += [
        (_PHI_Y_COORDINATE_INDEX, angle, 1.0) for angle in (quarter, -quarter, quarter - 1e-9, quarter + 1e-9)
    ]
    changes += [(_COORDINATE_SLICE_OF_EULER_ANGLES_AND_PSI, (quarter, 2 * quarter, -quarter, 4 * quarter), 1.0)]
    changes += [(_COORDINATE_SLICE_OF_EULER_ANGLES_AND_PSI, angle, 1.0) for angle in (1e-9, 1e6, 1e16)]
    changes += [(slice(0, 3), (far, -far / 3, far), 1.0) for far in (1e8, 1e15)]
    changes += [(slice(0, 0), (), rate) for rate in (0.0, 1e-60, 1e20, 1e100)]
    motion = rng.normal(size=(3, len(changes), 7))
    for sample, (index, value, rate) in enumerate(changes):
        motion[0, sample, index] = value
        motion[1, sample] *= rate
        motion[2, sample] *= rate * rate
    return tuple(motion[:num_levels])
