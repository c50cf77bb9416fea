"""The truth of a pair, computed once for all backends that are held against it, and the limits of errors."""

from __future__ import annotations

import functools

import mpmath
import numpy as np

from hingepair.bench import truth
from hingepair.bench.truth import DIGITS

BOUNDS = {
    "S1": 6, "S2": 13, "d": 10, "R2": 10, "omega1": 4, "omega2": 6, "v2": 10, "alpha1": 4, "alpha2": 8, "a2": 12,
}  # fmt: skip
"""What all keep to that are not searched for; what is proved is more (`pair.accuracy`)."""
ORDINARY = BOUNDS | {"S2": 12, "d": 8, "R2": 8, "omega1": 3, "omega2": 3, "v2": 6, "alpha2": 4, "a2": 6}
"""What random states keep to, thousands of them, and hard ones."""


def remembered(function):
    """The same for the same numbers."""
    known = {}

    def key_of(value):
        if isinstance(value, tuple | list):
            return tuple(map(key_of, value))
        if isinstance(value, np.ndarray):
            numbers = tuple(x._mpf_ for x in value.flat) if value.dtype == object else value.tobytes()
            return value.shape, value.dtype.str, numbers
        return value

    @functools.wraps(function)
    def remembering(*arguments, **options):
        key = key_of((arguments, tuple(options.items())))
        if key not in known:
            known[key] = function(*arguments, **options)
        return known[key]

    return remembering


from_euler = remembered(truth.from_euler)


def require(truth, found):
    """Hold every output to its bound, for every sample."""
    worst = {name: float(truth.errors(name, np.asarray(got)).max(initial=0.0)) for name, got in found.items()}
    late = {name: value for name, value in worst.items() if not value <= ORDINARY[name]}
    assert not late, f"beyond the promise, in units of u * scale: {late}"


def largest_errors(got, exact, axes):
    """Return the largest error of a component of each sample, as floats; a sample has `axes` axes."""
    with mpmath.workdps(DIGITS):
        gap = np.abs(np.asarray(got).astype(object) - exact).reshape(*np.shape(exact)[: np.ndim(exact) - axes], -1)
        return np.asarray(gap.max(axis=-1).astype(float))


def ratios(got, expected, scale):
    """Return the largest difference of a component of each sample of vectors or matrices [u * scale]."""
    gap = np.abs(np.asarray(got, float) - np.asarray(expected, float))
    return gap.reshape(*np.shape(scale), -1).max(axis=-1) / (2.0**-53 * scale)
