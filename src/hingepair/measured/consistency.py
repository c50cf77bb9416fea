"""Inertial parameters that rigid bodies can have, nearest to given combinations of them (a semidefinite program).

A body has the mass m, the first moment h and the second moment N = tr(J) / 2 - J of some distribution of mass where
its pseudo-inertia [N h; h^T m] is positive semidefinite (Wensing, Kim, Slotine, Linear matrix inequalities for
physically consistent inertial parameter identification, 2018).
"""

from __future__ import annotations

from typing import Final

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
_ON_DIAGONAL: Final = np.array([k in (0, 2, 5, 9) for k in range(10)])
_ENTRY_SCALE: Final = np.where(_ON_DIAGONAL, 1.0, np.sqrt(2.0))[:, None]  # with which Clarabel takes the entries
_CONE: Final = _ENTRY_SCALE * np.array([[entries.get(k, 0.0) for k in range(10)] for entries in _TRIANGLE])
_LEAST = 1e-6  # lowest eigenvalue of the pseudo-inertia of a body of size one: its mass is not all in a plane
# Standard deviations per unit that the solver resolves; where it fails, the next.
_PRECISIONS: Final = (1e7, 1e5, 1e3, 1.0)
_KNOWN = 1e6  # standard deviations per unit of what is known best, in the squares that are judged
_PULLS: Final = (1.0, 0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3, 1e-4)  # to the described parameters, beside one deviation
_AS_WELL = 4.0  # variances of the noise that the pull may add to the squares: two standard deviations
_WORSE = 0.01  # part that it may add to squares that are large since no masses of rigid bodies explain the torques


def consistent_parameters(
    factor: Float64Array,
    combinations: Float64Array,
    target: Float64Array,
    described: Float64Array,
    sizes: Float64Array,
    signed: NDArray[np.bool_],
) -> tuple[Float64Array, Float64Array, float]:
    """Return the inertial parameters p of rigid bodies, and the further parameters f, not below 0 unless signed, for
    which the sum of squares of factor @ ((combinations @ p, f) - target) is least but for noise, near to those
    described; and this sum.

    Where masses of rigid bodies have the combinations of the target by the least change from those described, these
    are returned.

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
    from scipy import sparse

    clarabel = require("clarabel", "physical")
    count, further = combinations.shape[1], target[len(combinations) :]
    unit = np.concatenate([body_units(*size) for size in sizes])
    lengths = np.linalg.norm(factor[:, len(combinations) :], axis=0)
    further_unit = np.maximum(np.abs(further), 1 / np.where(lengths > 0, lengths, 1.0))
    least_change = nearest_parameters(combinations, target[: len(combinations)], described, unit)
    if (further[~signed] >= 0).all() and _are_rigid(least_change / unit):
        return least_change, further, 0.0
    # A change x from the target and the least change, in these units, makes the squares grow by |A @ x|^2. Along the
    # singular vectors of A, no digits are lost to those of other sizes.
    A = np.hstack(
        (factor[:, : len(combinations)] @ (combinations * unit), factor[:, len(combinations) :] * further_unit)
    )
    _, sizes_of_A, axes = np.linalg.svd(A)
    weights = np.zeros(count + further.size)  # standard deviations per unit of each axis
    weights[: sizes_of_A.size] = sizes_of_A
    away = axes[:, :count] @ ((least_change - described) / unit)
    cone = np.kron(np.eye(len(sizes)), _CONE)
    limits = cone @ (least_change / unit) - _LEAST * np.tile(_ON_DIAGONAL, len(sizes))
    rows = np.vstack((cone @ axes[:, :count].T, axes[:, count:].T[~signed]))
    limits = np.concatenate((limits, (further / further_unit)[~signed]))
    cones = [clarabel.PSDTriangleConeT(4)] * len(sizes)
    cones += [clarabel.NonnegativeConeT(int((~signed).sum()))] if not signed.all() else []
    settings = clarabel.DefaultSettings()
    settings.verbose = False

    def nearest(pull: float) -> tuple[Float64Array, float]:
        """Return the change x with the least sum of squares and pull, and what the squares grow by."""
        for most in _PRECISIONS:
            scale = 1 / np.sqrt(np.minimum(weights, most) ** 2 + pull)  # the shortest vector is to be found
            found = clarabel.DefaultSolver(
                sparse.eye(scale.size, format="csc"), pull * scale * away, sparse.csc_matrix(-rows * scale),
                limits, cones, settings,
            ).solve()  # fmt: skip
            if "Solved" in str(found.status):
                along = scale * np.asarray(found.x)
                return axes.T @ along, float(((np.minimum(weights, _KNOWN) * along) ** 2).sum())
        raise FitError("physical", "torques that rigid bodies can take", f"a solver that stopped: {found.status}")

    # The strongest pull to which the torques do not object.
    change, growth = nearest(_PULLS[0])
    if growth > _AS_WELL:
        limit = (1 + _WORSE) * nearest(_PULLS[-1])[1] + _AS_WELL
        weaker = iter(_PULLS[1:])
        while growth > limit:
            change, growth = nearest(next(weaker))
    f = further + change[count:] * further_unit
    parameters = unit * _made_rigid(
        (least_change / unit) + change[:count]
    )  # but for the solver's tolerance, they are
    return parameters, np.where(signed, f, np.maximum(f, 0.0)), growth


def nearest_parameters(
    combinations: Float64Array, target: Float64Array, described: Float64Array, unit: Float64Array
) -> Float64Array:
    """Return the inertial parameters whose combinations are the target, by the least change, in parts of the units,
    from those described; (10 * bodies,).
    """
    weighted = combinations * unit**2
    change: Float64Array = weighted.T @ np.linalg.solve(weighted @ combinations.T, target - combinations @ described)
    return described + change


def body_units(mass: float, radius: float) -> NDArray[np.float64]:
    """Return the units of the ten parameters of a body of this mass and radius of gyration."""
    return np.array([mass, *[mass * radius] * 3, *[mass * radius**2] * 6])


def _pseudo_inertias(parameters: Float64Array) -> Float64Array:
    """Return the lower triangles of the pseudo-inertias of all bodies; (bodies, 4, 4)."""
    matrices = np.zeros((len(parameters) // 10, 4, 4))
    matrices[:, *np.tril_indices(4)] = parameters.reshape(-1, 10) @ (_CONE / _ENTRY_SCALE).T
    return matrices


def _are_rigid(parameters: Float64Array) -> bool:
    """Return whether all bodies of size one with these parameters are rigid bodies, by a margin."""
    return bool((np.linalg.eigvalsh(_pseudo_inertias(parameters)) >= _LEAST).all())


def _made_rigid(parameters: Float64Array) -> Float64Array:
    """Return parameters of bodies of size one with the eigenvalues of their pseudo-inertias above 0 by a margin."""
    sizes, vectors = np.linalg.eigh(_pseudo_inertias(parameters))
    rigid = (vectors * np.maximum(sizes, _LEAST / 2)[:, None]) @ np.swapaxes(vectors, 1, 2)
    second = rigid[:, :3, :3]
    inertia = np.trace(second, axis1=1, axis2=2)[:, None, None] * np.eye(3) - second
    upper = inertia[:, (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)]
    return np.concatenate((rigid[:, 3:, 3], rigid[:, 3, :3], upper), axis=1).ravel()
