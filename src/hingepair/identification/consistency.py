"""Inertial parameters that rigid bodies can have, nearest to given combinations of them (a semidefinite program).

A body has the mass m, the first moment h and the second moment N = tr(J) / 2 - J of some distribution of mass where
its pseudo-inertia [N h; h^T m] is positive semidefinite (Wensing, Kim, Slotine, Linear matrix inequalities for
physically consistent inertial parameter identification, 2018).
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import FitError
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.optional import require

# Upper triangle of the pseudo-inertia, column by column, each entry a sum over m, h and J in the regressor's order.
_TRIANGLE: Final = (
    {4: -0.5, 6: 0.5, 9: 0.5},
    {5: -1.0}, {4: 0.5, 6: -0.5, 9: 0.5},
    {7: -1.0}, {8: -1.0}, {4: 0.5, 6: 0.5, 9: -0.5},
    {1: 1.0}, {2: 1.0}, {3: 1.0}, {0: 1.0},
)  # fmt: skip
_DIAGONAL: Final = (0, 2, 5, 9)  # entries of _TRIANGLE on the diagonal
_LEAST = 1e-6  # lowest eigenvalue of the pseudo-inertia of a body of size one: its mass is not all in a plane
_PULL = 1e-2  # towards the described parameters, beside one standard deviation; decides what is not determined


def consistent_parameters(
    factor: Float64Array,
    combinations: Float64Array,
    target: Float64Array,
    described: Float64Array,
    sizes: Float64Array,
    signed: NDArray[np.bool_],
) -> tuple[Float64Array, Float64Array]:
    """Return the inertial parameters p of rigid bodies, and the further parameters f, not below 0 unless signed, for
    which the sum of squares of factor @ ((combinations @ p, f) - target) is least.

    Args:
        factor: weights of the parameters; (B + F, B + F).
        combinations: rows of base parameters; (B, 10 * bodies).
        target: what least squares found; (B + F,).
        described: inertial parameters of the robot as described; (10 * bodies,).
        sizes: mass and radius of gyration of each body, which scale the program; (bodies, 2).
        signed: which of f may be below 0; (F,).

    Raises:
        MissingDependencyError: Clarabel is not installed.
        FitError: the solver found no such parameters.
    """
    clarabel, sparse = require("clarabel", "physical"), require("scipy.sparse", "physical")
    bodies, count = len(sizes), combinations.shape[1]
    further = len(target) - len(combinations)
    unit = np.concatenate([body_units(*size) for size in sizes])
    lengths = np.linalg.norm(factor[:, len(combinations) :], axis=0)
    further_unit = np.maximum(np.abs(target[len(combinations) :]), 1 / np.where(lengths > 0, lengths, 1.0))
    # Least r.r and pull in these units, with r = A x - b as unknowns, since A.T A would lose half of the digits.
    A = factor @ np.hstack(
        (
            np.vstack((combinations * unit, np.zeros((further, count)))),
            np.vstack((np.zeros((len(combinations), further)), np.diag(further_unit))),
        )
    )
    equations = len(A)
    diagonal = np.concatenate((np.full(count + further, _PULL), np.ones(equations)))
    start = np.concatenate((described / unit, target[len(combinations) :] / further_unit))
    gradient = np.concatenate((-_PULL * start, np.zeros(equations)))
    rows, offsets = zip(*(_cone(k, diagonal.size) for k in range(bodies)), strict=True)
    constraints = np.vstack(
        (np.hstack((A, -np.eye(equations))), *rows, -np.eye(further, diagonal.size, count)[~signed])
    )
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.ZeroConeT(equations), *[clarabel.PSDTriangleConeT(4)] * bodies]
    positive = int((~signed).sum())
    cones += [clarabel.NonnegativeConeT(positive)] if positive else []
    found = clarabel.DefaultSolver(
        sparse.diags(diagonal, format="csc"), gradient, sparse.csc_matrix(constraints),
        np.concatenate((factor @ target, *offsets, np.zeros(positive))), cones, settings,
    ).solve()  # fmt: skip
    if "Solved" not in str(found.status):
        raise FitError("physical", "torques that rigid bodies can take", f"a solver that stopped: {found.status}")
    x = np.asarray(found.x)[: count + further]
    return x[:count] * unit, np.where(signed, x[count:], np.maximum(x[count:], 0.0)) * further_unit


def body_units(mass: float, radius: float) -> NDArray[np.float64]:
    """Return the units of the ten parameters of a body of this mass and radius of gyration."""
    return np.array([mass, *[mass * radius] * 3, *[mass * radius**2] * 6])


def _cone(body: int, size: int) -> tuple[Any, Any]:
    """Return rows and right-hand side of s = pseudo-inertia - _LEAST, as Clarabel takes triangles."""
    rows, offset = np.zeros((10, size)), np.zeros(10)
    for k, entries in enumerate(_TRIANGLE):
        for parameter, share in entries.items():
            rows[k, 10 * body + parameter] = -share * (1.0 if k in _DIAGONAL else np.sqrt(2.0))
        offset[k] = -_LEAST * (k in _DIAGONAL)
    return rows, offset
