"""Inertial parameters that rigid bodies can have, near given combinations of them.

A body has the mass m, the first moment h and the second moment N = tr(J) / 2 - J of some distribution of mass where
its pseudo-inertia [N h; h^T m] is positive definite (Wensing, Kim, Slotine, Linear matrix inequalities for physically
consistent inertial parameter identification, 2018). The sum of squares is least there, by Newton's method with a
logarithmic barrier (Boyd and Vandenberghe, Convex Optimization, 2004, 11.3).
"""

from __future__ import annotations

from typing import Final

import numpy as np

from hingepair.mechanism.bodies.body import INERTIA_ENTRIES
from hingepair.numeric.arrays import Float64Array

# The pseudo-inertia is linear in the parameters m, hx, hy, hz, Jxx, Jxy, Jyy, Jxz, Jyz, Jzz; (10, 4, 4).
_OF_PARAMETERS: Final = np.zeros((10, 4, 4))
_OF_PARAMETERS[0, 3, 3] = 1.0
for _k in range(3):
    _OF_PARAMETERS[1 + _k, _k, 3] = _OF_PARAMETERS[1 + _k, 3, _k] = 1.0
for _k, (_i, _j) in enumerate(INERTIA_ENTRIES, 4):
    _OF_PARAMETERS[_k, _i, _j] = _OF_PARAMETERS[_k, _j, _i] = -1.0
    if _i == _j:
        _OF_PARAMETERS[_k, range(3), range(3)] += 0.5
_LEAST = 1e-6  # lowest eigenvalue of the pseudo-inertia of a body of size one that counts as rigid
_KNOWN = 1e3  # standard deviations that a unit of a parameter counts at most
_PULL = 0.5  # standard deviations of the combinations that a change of all parameters by their units is worth
_BARRIER = 1e-5  # of the squares: what the barrier costs in the end, by body


def rigid_parameters(
    weights: Float64Array,
    combinations: Float64Array,
    nearest: Float64Array,
    described: Float64Array,
    unit: Float64Array,
) -> tuple[Float64Array, float]:
    """Return the inertial parameters (10 * bodies,) of rigid bodies whose combinations differ least from those of
    `nearest`, and which are near to the described ones beside that: `nearest` itself where rigid bodies have it.
    Also return by how much the squares grow, in variances.

    Args:
        weights: factor (k, B) of the squares of differences of the combinations, in standard deviations.
        combinations: rows of base parameters; (B, 10 * bodies).
        nearest: parameters that have the combinations sought; (10 * bodies,).
        described: likewise as described.
        unit: what each parameter may amount to.
    """
    from scipy.linalg import block_diag

    def moments(x: Float64Array) -> Float64Array:
        return np.asarray(np.einsum("nk,kab->nab", x.reshape(-1, 10), _OF_PARAMETERS))

    sizes, vectors = np.linalg.eigh(moments(nearest / unit))
    if (sizes >= _LEAST).all():
        return nearest, 0.0
    _, known, axes = np.linalg.svd(weights @ (combinations * unit), full_matrices=False)
    A = np.vstack((np.minimum(known, _KNOWN)[:, None] * axes, _PULL * np.eye(unit.size)))
    wanted = np.concatenate((A[: known.size] @ (nearest / unit), _PULL * described / unit))
    inside = (vectors * np.maximum(sizes, 0.1)[:, None]) @ np.swapaxes(vectors, 1, 2)
    x = (inside.reshape(-1, 16) @ np.linalg.pinv(_OF_PARAMETERS.reshape(10, 16))).ravel()
    barrier = max(float(((A @ x - wanted) ** 2).sum()), _BARRIER)
    least = max(_BARRIER, 1e-7 * barrier)  # smaller ones are lost in rounding
    while True:
        for _ in range(100):  # damped steps of Newton, which stay inside
            by_parameter = np.linalg.inv(moments(x))[:, None] @ _OF_PARAMETERS
            gradient = A.T @ (A @ x - wanted) - barrier * np.trace(by_parameter, axis1=2, axis2=3).ravel()
            bend = block_diag(*np.einsum("nkab,nlba->nkl", by_parameter, by_parameter))
            step = -np.linalg.solve(A.T @ A + barrier * bend, gradient)
            decrement = float(np.sqrt(max(-gradient @ step / barrier, 0.0)))
            x = x + step / (1 + decrement)
            if decrement < 0.1:
                break
        if barrier <= least:
            return unit * x, float(((A @ x - wanted)[: known.size] ** 2).sum())
        barrier = max(barrier / 10, least)
