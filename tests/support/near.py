"""Numbers compared in units of rounding, and tolerances of simulations."""

from __future__ import annotations

import numpy as np

U = 2.0**-53
TOL = 1e-10  # of simulations, relative, unless given
POSE = 1e-9  # of positions [m] and angles [rad] of inverse kinematics, unless given
TIGHT = 1e-12  # of simulations that are held against closed forms


def assert_near(found, expected, units, scale=None):
    """Assert that no number is off by more than so many units of rounding of a scale: the largest expected."""
    size = np.nanmax(np.abs(expected)) if scale is None else scale
    np.testing.assert_allclose(found, expected, rtol=0, atol=units * U * size)
