"""Forces within limits that keep joints at rest, as far as they suffice: a small complementarity problem."""

from __future__ import annotations

import numpy as np

from hingepair.numeric.arrays import Float64Array as Array


def forces_within_limits(mobility: Array, free: Array, lowest: Array, highest: Array) -> Array:
    """Return the forces f between their limits with which each element of a = free + mobility f is 0, or is at
    least 0 where f is at its lowest, or at most 0 where f is at its highest.

    The mobility is symmetric and positive definite, so that there is one solution. It is found by principal
    pivoting with the least index (Judice, Pires, *A block principal pivoting algorithm for large-scale strictly
    monotone linear complementarity problems*, 1994), which ends.

    Args:
        mobility: accelerations by unit forces; shape (n, n).
        free: accelerations without these forces; shape (n,).
        lowest: lower limits of the forces, -inf where there is none; shape (n,).
        highest: upper limits, at least the lower ones; shape (n,).

    >>> forces_within_limits(np.eye(2), np.array([-3.0, 1.0]), np.zeros(2), np.full(2, 2.0))
    array([2., 0.])
    """
    n = len(free)
    side = np.zeros(n, int)  # of each force: at its lowest (-1), within its limits (0), at its highest (1)
    forces = np.zeros(n)
    for _ in range(64 * 2 ** min(n, 12)):
        within = side == 0
        forces = np.where(side < 0, lowest, np.where(side > 0, highest, 0.0))
        if within.any():
            rest = free[within] + mobility[np.ix_(within, ~within)] @ forces[~within]
            forces[within] = -np.linalg.solve(mobility[np.ix_(within, within)], rest)
        accelerations = free + mobility @ forces
        too_low, too_high = within & ~(forces >= lowest), within & ~(forces <= highest)
        # Forces at their limits that push the joint instead of holding it back.
        loose = ((side < 0) & (accelerations < 0)) | ((side > 0) & (accelerations > 0))
        wrong = np.flatnonzero(too_low | too_high | loose)
        if not wrong.size:
            break
        k = int(wrong[0])
        side[k] = 0 if loose[k] else (-1 if too_low[k] else 1)
    return forces
