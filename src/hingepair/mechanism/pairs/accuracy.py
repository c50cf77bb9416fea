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

from hingepair.mechanism.pairs.geometry import Constants, axis_errors, tree_errors, tree_numbers
from hingepair.mechanism.pairs.requests import COORDINATES, INPUT_LABELS, computation_of
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.blocks import numbers
from hingepair.plans.arguments import Outputs, read_arguments, requested_outputs
from hingepair.plans.bounds import Known, output_bounds
from hingepair.plans.pairs import PairRequest, tree_parameters


class PromisedBound(NamedTuple):
    """Promised bound on the rounding error of one output, in units of u * scale, with the unit roundoff u."""

    proved: int  # no error is larger: the largest bound of `error_bounds` over all states, rounded up
    seen: float  # the largest error that any search has met
    scale: str  # its formula


PROMISED_BOUND_BY_OUTPUT: Mapping[str, PromisedBound] = MappingProxyType(
    {
        "S1": PromisedBound(8, 5.1, "1"),
        "S2": PromisedBound(36, 11.6, "1"),
        "d": PromisedBound(19, 8.4, "abs(u1) + abs(u2)"),
        "R2": PromisedBound(20, 8.8, "max abs(R1) + abs(u1) + abs(u2)"),
        "omega1": PromisedBound(7, 3.4, "W1"),
        "omega2": PromisedBound(14, 6.1, "W2 = W1 + abs(psi')"),
        "v2": PromisedBound(32, 10.6, "max abs(v1) + W1 abs(u1) + W2 abs(u2)"),
        "alpha1": PromisedBound(7, 4.5, "A1"),
        "alpha2": PromisedBound(25, 9.3, "A2 = A1 + abs(psi'') + W1 abs(psi')"),
        "a2": PromisedBound(33, 12.8, "max abs(a1) + (A1 + W1^2) abs(u1) + (A2 + W2^2) abs(u2)"),
    }
)
"""The bounds hold if all inputs, results and scales are 0 or in the normal range of floating-point numbers. If
u * scale is below the smallest normal number, this number takes its place."""

PINOCCHIO_ROUNDOFFS = 16
"""Largest difference from Pinocchio that passes, in units of u * scale. The results of both sides contain rounding
errors."""

PLANAR_SCALES: Mapping[str, str] = MappingProxyType({"phi2": "1 + abs(phi2) + abs(psi)"})
"""The scales of the outputs that only planar pairs have: the rounding error of an angle grows with the angle."""

PINOCCHIO_EXTRA_SCALES: Mapping[str, str] = MappingProxyType(
    {"alpha2": "psi'^2", "a2": "(W1 + W2) max abs(v1) + W1 W2 abs(u1)"}
)
"""Terms that are added to the scale of an output for a comparison with Pinocchio, whose terms are larger before they
cancel. Pinocchio computes omega2 x n psi', and the part psi'^2 n x n of it is rounded before it vanishes. It also
adds spatial accelerations, which differ from classical accelerations by omega2 x v2."""


def unit_roundoff(dtype: DTypeLike) -> float:
    """Return the unit roundoff u of a floating-point dtype, half the distance from 1 to the next number: 2^-53 for
    float64, 2^-24 for float32.

    >>> unit_roundoff(np.float32) == 2.0**-24
    True
    """
    return float(np.finfo(np.dtype(dtype)).eps) / 2


def euler_rate_sizes(
    phid: ArrayLike | None, phidd: ArrayLike | None = None
) -> tuple[Float64Array | None, Float64Array | None]:
    """Return (W1, A1), the sizes of body 1's angular velocity and acceleration, of Euler rates (..., 3): W1 = sum
    abs(phi_i'), A1 = sum abs(phi_i'') + W1^2; None where a derivative is missing.

    >>> W1, A1 = euler_rate_sizes((1, -2, 0), (0, 0, 3))
    >>> float(W1), float(A1)
    (3.0, 12.0)
    """
    if phid is None:
        return None, None
    W1 = np.abs(np.asarray(phid, dtype=np.float64)).sum(axis=-1)
    if phidd is None:
        return W1, None
    with np.errstate(all="ignore"):
        return W1, np.abs(np.asarray(phidd, dtype=np.float64)).sum(axis=-1) + W1 * W1


def angular_rate_sizes(
    omega1: ArrayLike | None, alpha1: ArrayLike | None = None
) -> tuple[Float64Array | None, Float64Array | None]:
    """Return (W1, A1), the norms of omega1 and alpha1; None of None."""
    return (None if omega1 is None else norm(omega1)), (None if alpha1 is None else norm(alpha1))


def output_scales(
    *,
    u1: ArrayLike,
    u2: ArrayLike,
    R1: ArrayLike | None = None,
    v1: ArrayLike | None = None,
    a1: ArrayLike | None = None,
    W1: ArrayLike | None = None,
    A1: ArrayLike | None = None,
    psid: ArrayLike | None = None,
    psidd: ArrayLike | None = None,
    pinocchio: bool = False,
) -> dict[str, Float64Array]:
    """Return the scales that the rounding errors of outputs are relative to, the formulas of
    `PROMISED_BOUND_BY_OUTPUT`, by output name; without those that need what is not given. The vectors have the shape
    (..., 3), the sizes W1 and A1 and the rates (...,). `pinocchio` adds `PINOCCHIO_EXTRA_SCALES` (a2 then needs v1).

    >>> found = output_scales(u1=(3, 4, 0), u2=(0, 0, 1), R1=(-10, 1, 2))
    >>> {name: float(value) for name, value in found.items()}
    {'S1': 1.0, 'S2': 1.0, 'd': 6.0, 'R2': 16.0}
    """
    linear: dict[str, Any] = {"U1": norm(u1), "U2": norm(u2), "R1": R1, "V1": v1, "a1": a1}
    for name in ("R1", "V1", "a1"):
        linear[name] = None if linear[name] is None else largest(linear[name])
    angular = {"W1": W1, "A1": A1, "W": psid, "A": psidd}
    sizes = linear | {
        name: None if value is None else np.abs(np.asarray(value, dtype=np.float64))
        for name, value in angular.items()
    }
    with np.errstate(all="ignore"):
        scale_by_output = _scale_formulas(**sizes, pinocchio=pinocchio)
    return {
        name: np.asarray(scale_by_output[name])
        for name in PROMISED_BOUND_BY_OUTPUT
        if scale_by_output[name] is not None
    }


def _scale_formulas(
    U1: Any, U2: Any, R1: Any, V1: Any, a1: Any, W1: Any, A1: Any, W: Any, A: Any, pinocchio: bool
) -> Any:
    """Return the scales by output from sizes, such as U1 of u1, W of psi', A of psi''; None where one is missing."""
    W2 = None if W1 is None or W is None else W1 + W
    A2 = None if A1 is None or A is None or W1 is None or W is None else A1 + A + W1 * W
    alpha2, a2 = A2, None
    if a1 is not None and A2 is not None and W2 is not None:
        a2 = a1 + (A1 * U1 + W1 * (W1 * U1)) + (A2 * U2 + W2 * (W2 * U2))  # squares alone could overflow
    if pinocchio and A2 is not None and W2 is not None:
        alpha2 = A2 + W * W
        a2 = None if a2 is None or V1 is None else a2 + (W1 + W2) * V1 + W1 * (W2 * U1)
    return {
        "S1": 1.0,
        "S2": 1.0,
        "d": U1 + U2,
        "R2": None if R1 is None else R1 + (U1 + U2),
        "omega1": W1,
        "omega2": W2,
        "v2": None if V1 is None or W2 is None else V1 + W1 * U1 + W2 * U2,
        "alpha1": A1,
        "alpha2": alpha2,
        "a2": a2,
    }


def error_ratios(
    output: str, computed: ArrayLike, expected: ArrayLike, scale: ArrayLike, dtype: DTypeLike = np.float64
) -> tuple[Float64Array, Float64Array]:
    """Return (error, ratio) of an output at each sample, shape (...,): the largest difference of a component, and
    that in units of u * scale, or of the smallest normal number if this is larger.

    Args:
        output: name of the output, which says how many axes one sample has.
        computed: computed values; shape (..., 3) or (..., 3, 3). Where one is not finite, the error is inf.
        expected: expected values, of the same shape. Where one, or the scale, is not finite, both results are NaN.
        scale: scale of the output, as `output_scales` returns it; shape (...,).
        dtype: dtype of the computation, which determines u.

    >>> error, ratio = error_ratios("d", (1.0 + 2.0**-52, 0.0, 0.0), (1.0, 0.0, 0.0), 1.0)
    >>> float(ratio)
    2.0
    """
    axes = (-2, -1) if output in {"S1", "S2"} else (-1,)
    expected = np.asarray(expected, dtype=np.float64)
    comparable = np.isfinite(expected).all(axis=axes) & np.isfinite(scale)
    with np.errstate(all="ignore"):
        error = np.abs(np.asarray(computed, dtype=np.float64) - expected).max(axis=axes)
        error = np.where(comparable, np.where(np.isfinite(error), error, np.inf), np.nan)
        smallest = float(np.finfo(np.dtype(dtype)).tiny)
        ratio = error / np.maximum(np.asarray(scale, dtype=np.float64) * unit_roundoff(dtype), smallest)
    return error, ratio


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


def error_bounds(
    pair: Constants, given: Mapping[str, Any], level: int, outputs: Outputs, sequence: str | None = None
) -> dict[str, Float64Array]:
    """Compute bounds on the rounding errors of outputs of forward kinematics; return arrays (...,) by output name.
    `given` are the inputs by name, as users give them, `level` (0 to 2) is that of the default outputs.

    Raises:
        ArgumentError: an output needs an input that is not given.
    """
    names = requested_outputs(outputs, None, pair.levels, pair.kind.default_outputs(level))
    computation_of(pair, names, sequence).check_given(given, INPUT_LABELS)
    arguments = read_arguments(given, pair.shapes, COORDINATES[pair.kind], INPUT_LABELS)
    read = tuple(arguments.values)
    request = PairRequest(names, read, pair.kind.planar, sequence, pair.points, has_home=pair.has_home)
    constants = tree_numbers(pair).components, tree_errors(pair)
    known: dict[str, Any] = {"constants": Known(*map(tree_parameters, constants))}
    if not pair.kind.planar:
        known |= {"n": Known(numbers(pair.arrays["n"]), axis_errors(pair)), "home": numbers(pair.arrays["home"], 2)}
    return output_bounds(
        request.compute, arguments, request.inputs(), known, dict.fromkeys(names, 0), shape=pair.shape
    )
