"""Numbers compared in units of rounding."""

from __future__ import annotations

import numpy as np

U = 2.0**-53


def assert_near(found, expected, units, scale=None):
    """Assert that no number is off by more than so many units of rounding of a scale: the largest expected."""
    size = np.nanmax(np.abs(expected)) if scale is None else scale
    np.testing.assert_allclose(found, expected, rtol=0, atol=units * U * size)
