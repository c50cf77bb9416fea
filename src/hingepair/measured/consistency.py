"""Inertial parameters that rigid bodies can have, near given combinations of them.

A body has the mass m, the first moment h and the second moment N = tr(J) / 2 - J of some distribution of mass where
its pseudo-inertia [N h; h^T m] is positive definite (Wensing, Kim, Slotine, Linear matrix inequalities for physically
consistent inertial parameter identification, 2018). So its Cholesky factor is sought.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.arrays import Float64Array

_ROWS, _COLUMNS = np.tril_indices(4)  # of the entries of L
_LEAST = 1e-6  # lowest eigenvalue of the pseudo-inertia of a body of size one: its mass is not all in a plane
_KNOWN = 1e3  # standard deviations that a unit of a parameter counts at most
_PULL = 0.03  # standard deviations of the combinations that a change of all parameters by their units is worth


def _parameters_of_moments() -> NDArray[np.float64]:
    """Return M (10, 4, 4): parameter k of a body is the sum of M[k] times its pseudo-inertia, entry by entry."""
    M = np.zeros((10, 4, 4))
    M[0, 3, 3] = 1.0
    M[(1, 2, 3), (0, 1, 2), 3] = M[(1, 2, 3), 3, (0, 1, 2)] = 0.5
    for k, (i, j) in enumerate(((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)), 4):
        M[k, i, j] -= 0.5
        M[k, j, i] -= 0.5
        if i == j:
            M[k, range(3), range(3)] += 1.0
    return M


_OF_MOMENTS: Final = _parameters_of_moments()


def rigid_parameters(
    weights: Float64Array,
    combinations: Float64Array,
    nearest: Float64Array,
    described: Float64Array,
    unit: Float64Array,
) -> Float64Array:
    """Return the inertial parameters (10 * bodies,) of rigid bodies whose combinations differ least from those of
    `nearest`, and which are near to the described ones beside that: `nearest` itself where rigid bodies have it.

    Args:
        weights: factor (k, B) of the squares of differences of the combinations, in standard deviations.
        combinations: rows of base parameters; (B, 10 * bodies).
        nearest: parameters that have the combinations sought; (10 * bodies,).
        described: likewise as described.
        unit: what each parameter may amount to.
    """
    from scipy.linalg import block_diag
    from scipy.optimize import least_squares

    moments = np.linalg.pinv(_OF_MOMENTS.reshape(10, 16))
    sizes, vectors = np.linalg.eigh(((nearest / unit).reshape(-1, 10) @ moments.T).reshape(-1, 4, 4))
    if (sizes >= _LEAST).all():
        return nearest
    _, known, axes = np.linalg.svd(weights @ (combinations * unit), full_matrices=False)
    A = np.vstack((np.minimum(known, _KNOWN)[:, None] * axes, _PULL * np.eye(unit.size)))
    wanted = A @ (nearest / unit)
    wanted[known.size :] = _PULL * described / unit

    def factors(x: Float64Array) -> Float64Array:
        L = np.zeros((unit.size // 10, 4, 4))
        L[:, _ROWS, _COLUMNS] = x.reshape(-1, 10)
        return L

    def parameters(x: Float64Array) -> Float64Array:
        L = factors(x)
        P = L @ np.swapaxes(L, 1, 2) + _LEAST * np.eye(4)
        return np.asarray(np.einsum("kab,nab->nk", _OF_MOMENTS, P).ravel())

    def slopes(x: Float64Array) -> Float64Array:
        by_entry = 2 * np.einsum("kib,nbi->nki", _OF_MOMENTS[:, _ROWS], factors(x)[:, :, _COLUMNS])
        return np.asarray(A @ block_diag(*by_entry))

    start = np.linalg.cholesky((vectors * np.maximum(sizes, 0.01)[:, None]) @ np.swapaxes(vectors, 1, 2))
    x = start[:, _ROWS, _COLUMNS].ravel()
    found = least_squares(lambda x: A @ parameters(x) - wanted, x, slopes, method="lm", ftol=1e-6, max_nfev=100)
    return np.asarray(unit * parameters(found.x))
