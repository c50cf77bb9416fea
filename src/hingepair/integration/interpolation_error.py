"""Errors of integrals over interpolated samples (E12), interval by interval, from divided differences.

The error of an interpolant of degree 5 is the sixth divided difference times the product of the distances from the
six samples, whose integral over an interval is known for even and uneven samples. Two sixth differences reach one
sample further than the six, to the left and to the right. Where the motion is smooth they nearly agree, and the error
is their mean with its sign. At a jump, a kink or a bend they differ by more than their mean, and their signs
alternate: only sizes count there. Samples do not show where between two of them a jump lies; many such errors may add
up, as where all jumps are at samples, or cancel at random: the estimate of their total is the geometric mean of both.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.integration.signals import POINTS, SampledSignal
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import row_norms

ErrorRotation: TypeAlias = Callable[[int, int, Array], Array]
"""Rotates errors (n, k) of the intervals from the first to the second index to axes in which they add up."""

_BLOCK = 65536  # intervals whose errors are computed at a time
_GROUP = 8  # intervals whose differences one kink may change
# On the errors of groups: the estimate is then 0.8 of the largest error of a jump, 2.5 of a kink's, 13 of a bend's.
_KINK_FACTOR = 3.0
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(POINTS // 2 + 1)  # Gauss-Legendre on [-1, 1]


def largest_interpolation_error(samples: SampledSignal, step_errors: Array, rotate_to_start: ErrorRotation) -> float:
    """Return the largest error up to any instant [rad] of the integral of a rate that is interpolated between
    samples, NaN for fewer than 4 samples. `step_errors` (N - 1, k) are the errors of the integration steps in the
    intervals, which are subtracted.
    """
    count = len(samples.t)
    if count < 4:
        return math.nan
    values = samples.values.reshape(count, -1)
    sum_before, worst = np.zeros(step_errors.shape[1]), 0.0
    size, square = 0.0, 0.0
    for first in range(0, count - 1, _BLOCK):
        last = min(first + _BLOCK, count - 1)
        low, high = max(0, first - POINTS), min(count, last + 1 + POINTS)
        mean, half = _interval_errors(samples.t[low:high], values[low:high])[:, first - low : last - low]
        # Smooth motion: the errors add up with their signs.
        sums = sum_before + np.cumsum(rotate_to_start(first, last, mean - step_errors[first:last]), axis=0)
        alone = np.abs(mean) + 4 * np.abs(half)  # of a single interval, as at a kink beside much shorter intervals
        worst = float(np.maximum(worst, np.maximum(row_norms(sums).max(), row_norms(alone).max())))
        sum_before = sums[-1]
        # Jumps, kinks and bends: sums of sizes and of squares.
        groups = np.arange(0, last - first, _GROUP)
        squares = [np.add.reduceat((errors**2).sum(axis=1), groups) for errors in (mean, half)]
        sizes = np.add.reduceat(row_norms(np.abs(mean) + np.abs(half)), groups)[squares[1] > squares[0]]
        size, square = size + float(sizes.sum()), square + float((sizes**2).sum())
    return float(np.maximum(worst, _KINK_FACTOR * math.sqrt(size * math.sqrt(square))))


def _interval_errors(t: Array, columns: Array) -> Array:
    """Return the mean of two estimates of the interpolation error of the integral over each interval, and half their
    difference; (2, intervals, columns).
    """
    points = min(POINTS, len(t))
    differences = [columns]
    for k in range(1, min(POINTS + 1, len(t))):
        differences.append(np.diff(differences[-1], axis=0) / (t[k:] - t[:-k])[:, None])
    start = np.clip(np.arange(len(t) - 1) - (points // 2 - 1), 0, len(t) - points)
    if len(t) > POINTS:
        # Extrapolated where there is no further sample.
        highest = np.pad(differences[POINTS], ((1, 1), (0, 0)), mode="reflect", reflect_type="odd")
    else:
        highest = np.repeat(_extrapolated_difference(differences), 2, axis=0)
    left, right = highest[start], highest[start + 1]
    return 0.5 * np.stack([left + right, right - left]) * _stencil_products(t, start, points)[:, None]


def _extrapolated_difference(differences: list[Array]) -> Array:
    """Return a divided difference (1, columns) of the next higher order, by how `differences` grow with the order."""
    sizes = [math.factorial(k) * float(row_norms(rows).max()) for k, rows in enumerate(differences)]
    if sizes[-1] == 0:
        return differences[-1]
    # A motion and its second derivative are large at the same time; four samples have only one such pair of orders.
    count = len(differences)
    steps = (2, 4) if count > 4 else (1, 2)
    pairs = [(j, j + up) for up in steps for j in range(1, count - up) if sizes[j] != 0]
    growth = max((sizes[k] / sizes[j]) ** (1 / (k - j)) for j, k in pairs)
    return np.asarray(differences[-1] * (growth * max(1.0, growth * sizes[-2] / sizes[-1]) / count))


def _stencil_products(t: Array, stencil_starts: NDArray[np.intp], stencil_size: int) -> Array:
    """Return for each interval the integral of the product of the signed distances from all samples of its stencil,
    the samples through which its polynomial passes.
    """
    h = np.diff(t)
    times = t[:-1, None] + h[:, None] * (0.5 + 0.5 * _NODES)
    product = np.ones_like(times)
    for j in range(stencil_size):
        product *= times - t[stencil_starts + j][:, None]
    return np.asarray(0.5 * h * (product @ _WEIGHTS))
