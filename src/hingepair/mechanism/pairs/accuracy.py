"""Promised accuracy: the largest differences between results and exact values, in units of unit roundoff times scale.

The scale of an output is the size of the terms whose sum it is, before they cancel; it is computed for each sample.
`abs(u)` is the Euclidean norm of a vector, and `max abs(R1)` is the largest absolute component of R1.

W1 and A1 are the sizes of body 1's angular velocity and acceleration. If the motion is given by Euler angles, they
are `W1 = sum abs(phi_i')` and `A1 = sum abs(phi_i'') + W1^2`; if the attitude is given, they are `abs(omega1)` and
`abs(alpha1)`.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike

from hingepair.numeric.arrays import Float64Array


class PromisedBound(NamedTuple):
    """Promised bound on the rounding error of one output, in units of u * scale, with the unit roundoff u."""

    proved: int  # no error is larger: the largest bound of `error_bounds` over all states, rounded up
    seen: float  # the largest error that any search has met
    scale: str  # its formula


PROMISED_BOUND_BY_OUTPUT: Mapping[str, PromisedBound] = MappingProxyType(
    {
        "S1": PromisedBound(8, 5.1, "1"),
        "S2": PromisedBound(36, 11.6, "1"),
        "d": PromisedBound(36, 8.8, "abs(u1) + abs(u2)"),
        "R2": PromisedBound(36, 10.6, "max abs(R1) + abs(u1) + abs(u2)"),
        "omega1": PromisedBound(7, 3.4, "W1"),
        "omega2": PromisedBound(14, 6.1, "W2 = W1 + abs(psi')"),
        "v2": PromisedBound(64, 10.6, "max abs(v1) + W1 abs(u1) + W2 abs(u2)"),
        "alpha1": PromisedBound(7, 4.5, "A1"),
        "alpha2": PromisedBound(25, 9.3, "A2 = A1 + abs(psi'') + W1 abs(psi')"),
        "a2": PromisedBound(80, 13.7, "max abs(a1) + (A1 + W1^2) abs(u1) + (A2 + W2^2) abs(u2)"),
    }
)
"""The bounds hold if all inputs, results and scales are 0 or in the normal range of floating-point numbers. If
u * scale is below the smallest normal number, this number takes its place."""

PINOCCHIO_ROUNDOFFS = 16
"""Largest difference from Pinocchio that passes, in units of u * scale. The results of both sides contain rounding
errors."""


def unit_roundoff(dtype: DTypeLike) -> float:
    """Return the unit roundoff u of a floating-point dtype, half the distance from 1 to the next number: 2^-53 for
    float64, 2^-24 for float32.

    >>> unit_roundoff(np.float32) == 2.0**-24
    True
    """
    return float(np.finfo(np.dtype(dtype)).eps) / 2


def euler_rate_sizes(phid: ArrayLike, phidd: ArrayLike | None = None) -> tuple[Float64Array, Float64Array | None]:
    """Return (W1, A1), the sizes of body 1's angular velocity and acceleration, of Euler rates (..., 3).

    >>> W1, A1 = euler_rate_sizes((1, -2, 0), (0, 0, 3))
    >>> float(W1), float(A1)
    (3.0, 12.0)
    """
    W1 = np.abs(np.asarray(phid, dtype=np.float64)).sum(axis=-1)
    with np.errstate(all="ignore"):
        return W1, None if phidd is None else np.abs(np.asarray(phidd, dtype=np.float64)).sum(axis=-1) + W1 * W1


def output_scales(
    *,
    u1: ArrayLike,
    u2: ArrayLike,
    R1: ArrayLike,
    v1: ArrayLike | None = None,
    a1: ArrayLike | None = None,
    W1: Any = None,
    A1: Any = None,
    psid: ArrayLike | None = None,
    psidd: ArrayLike | None = None,
    pinocchio: bool = False,
) -> dict[str, Any]:
    """Return the scales that the rounding errors of outputs are relative to, the formulas of
    `PROMISED_BOUND_BY_OUTPUT`, by output name; without those of velocities or accelerations that are not given. The
    vectors have the shape (..., 3), the sizes W1 and A1 and the rates (...,).

    Pinocchio's terms are larger before they cancel. It computes omega2 x n psi', and the part psi'^2 n x n of it is
    rounded before it vanishes; and it adds spatial accelerations, which differ from classical ones by omega2 x v2.
    `pinocchio` adds these to the scales of alpha2 and a2.

    >>> found = output_scales(u1=(3, 4, 0), u2=(0, 0, 1), R1=(-10, 1, 2))
    >>> {name: float(value) for name, value in found.items()}
    {'S1': 1.0, 'S2': 1.0, 'd': 6.0, 'R2': 16.0}
    """
    U1, U2 = norm(u1), norm(u2)
    found = {"S1": 1.0, "S2": 1.0, "d": U1 + U2, "R2": largest(R1) + (U1 + U2)}
    if v1 is None or psid is None:
        return found
    V1, W = largest(v1), np.abs(psid)
    W2 = W1 + W
    with np.errstate(all="ignore"):
        found |= {"omega1": W1, "omega2": W2, "v2": V1 + W1 * U1 + W2 * U2}
        if a1 is None or psidd is None:
            return found
        A2 = A1 + np.abs(psidd) + W1 * W
        # Squares alone could overflow.
        a2 = largest(a1) + (A1 * U1 + W1 * (W1 * U1)) + (A2 * U2 + W2 * (W2 * U2))
        found |= {"alpha1": A1, "alpha2": A2, "a2": a2}
        if pinocchio:
            found |= {"alpha2": A2 + W * W, "a2": a2 + (W1 + W2) * V1 + W1 * (W2 * U1)}
    return found


def norm(vector: ArrayLike) -> Float64Array:
    """Return the Euclidean norms of vectors on the last axis of an array, shape (...,). Intermediate results do not
    overflow or underflow.

    >>> f"{norm((3e200, 4e200, 0.0)):.6g}"
    '5e+200'
    """
    vector = np.asarray(vector, dtype=np.float64)
    return np.asarray(np.hypot.reduce(vector, axis=-1))


def largest(vector: ArrayLike) -> Float64Array:
    """Return the largest absolute component of each vector on the last axis of an array; shape (...,)."""
    return np.asarray(np.abs(np.asarray(vector, dtype=np.float64)).max(axis=-1))
