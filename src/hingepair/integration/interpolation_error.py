"""Errors of integrals over interpolated samples (E12), interval by interval, from divided differences.

The error of an interpolant of degree 5 is the sixth divided difference times the product of the distances from the
six samples, whose integral over an interval is known for even and uneven samples. That is the whole error where the
motion is smooth: the differences fall from order to order.

A jump, a kink or a bend makes one difference stand out from its neighbours, and those of higher order grow from there
on. Samples do not show where between two of them it lies; its error is at most the largest value of Bernoulli's
polynomial of its order over the factorial, times the difference. Many such errors may add up, as where all jumps are
at samples, or cancel at random: the estimate of their total is the geometric mean of both.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from hingepair.integration.signals import POINTS, SampledSignal
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import row_norms

ErrorRotation: TypeAlias = Callable[[int, int, Array], Array]
"""Rotates errors (..., n, k) of the intervals from the first to the second index to axes in which they add up."""

_BLOCK = 65536  # intervals whose errors are computed at a time
_MARGIN = 12  # samples on either side of a block that its divided differences use
# Order of the difference that stands out (jump, kink, bend), and the largest |B_k| / k! on [0, 1].
_KINKS: Final = ((1, 1 / 2), (2, 1 / 12), (3, 1 / 125))
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
    group = 8  # intervals whose errors may belong to one kink and are summed before sizes are taken
    sizes, squares = np.zeros(len(_KINKS)), np.zeros(len(_KINKS))
    for first in range(0, count - 1, _BLOCK):
        last = min(first + _BLOCK, count - 1)
        low, high = max(0, first - _MARGIN), min(count, last + 1 + _MARGIN)
        missed = _interval_errors(samples.t[low:high], values[low:high])[:, first - low : last - low]
        missed[0] -= step_errors[first:last]
        errors = rotate_to_start(first, last, missed)
        # Smooth motion: the errors add up with their signs.
        sums = sum_before + np.cumsum(errors[0], axis=0)
        worst = float(np.maximum(worst, np.maximum(row_norms(sums).max(), row_norms(errors[1]).max())))
        sum_before = sums[-1]
        # Jumps, kinks and bends: sums of sizes and of squares.
        grouped = row_norms(np.add.reduceat(errors[2:], np.arange(0, last - first, group), axis=1))
        sizes, squares = sizes + grouped.sum(axis=1), squares + (grouped**2).sum(axis=1)
    return float(np.maximum(worst, np.sqrt(sizes * np.sqrt(squares)).max()))


def _interval_errors(t: Array, columns: Array) -> Array:
    """Return estimates of the interpolation error of the integral over each interval; (5, intervals, columns). The
    first two rows come from the mean and from the larger of two sixth divided differences; the other three are the
    errors of jumps, kinks and bends.
    """
    points = min(POINTS, len(t))
    differences = [columns]
    for k in range(1, min(POINTS + 1, len(t))):
        differences.append(np.diff(differences[-1], axis=0) / (t[k:] - t[:-k])[:, None])
    intervals = np.arange(len(t) - 1)
    start = np.clip(intervals - (points // 2 - 1), 0, len(t) - points)
    product = _stencil_products(t, start, points)
    errors = np.zeros((2 + len(_KINKS), len(intervals), columns.shape[1]))
    for row, difference in enumerate(_highest_differences(differences, start, points)):
        errors[row] = difference * product[:, None]
    if len(t) > POINTS:
        h = np.diff(t)
        even_product = 191 / 84  # the product for six samples at distances of 1, in the middle interval
        stencil_length = (np.abs(product) / (even_product * h)) ** (1 / POINTS)
        for level, (order, bound) in enumerate(_KINKS, start=2):
            errors[level] = bound * _kink_sizes(differences, order, h, stencil_length)
    return errors


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


def _highest_differences(
    differences: list[Array], stencil_starts: NDArray[np.intp], stencil_size: int
) -> tuple[Array, Array]:
    """Return for each stencil the mean and the larger of two divided differences: over the stencil and the next
    sample on its left, and on its right; (stencils, columns). `differences` are those of each order. Where there are
    no more samples, the differences of lower order are extrapolated.
    """
    if len(differences) > stencil_size:
        rows = differences[stencil_size]
        left, right = rows[np.maximum(stencil_starts - 1, 0)], rows[np.minimum(stencil_starts, len(rows) - 1)]
        return 0.5 * (left + right), np.where((row_norms(left) > row_norms(right))[:, None], left, right)
    sizes = [math.factorial(k) * float(row_norms(rows).max()) for k, rows in enumerate(differences)]
    if sizes[-1] == 0:
        zero = np.zeros((len(stencil_starts), differences[0].shape[1]))
        return zero, zero
    # A motion and its second derivative are large at the same time; four samples have only one such pair of orders.
    steps = (2, 4) if stencil_size > 4 else (1, 2)
    pairs = [(j, j + up) for up in steps for j in range(1, stencil_size - up) if sizes[j] != 0]
    growth = max((sizes[k] / sizes[j]) ** (1 / (k - j)) for j, k in pairs)
    factor = growth * max(1.0, growth * sizes[-2] / sizes[-1]) / stencil_size
    extrapolated = np.broadcast_to(factor * differences[-1], (len(stencil_starts), differences[0].shape[1]))
    return extrapolated, extrapolated


def _kink_sizes(differences: list[Array], order: int, h: Array, stencil_length: Array) -> Array:
    """Return the sizes of kinks in intervals of lengths h, times h and the `order`-th power of `stencil_length` [s];
    (intervals, columns). A kink shows as an outlier of the divided differences of `order`; a jump is a kink of order
    1. The size is reduced where the differences grow too little from order to order.
    """
    outliers = math.factorial(order) * _subtract_local_median(differences[order])[_centred_indices(order, h)]
    low = _neighbourhood_max(row_norms(outliers), 2) * stencil_length**order
    middle, high = (
        math.factorial(k)
        * _neighbourhood_max(row_norms(differences[k])[_centred_indices(k, h)], radius)
        * stencil_length**k
        for k, radius in ((POINTS - 2, 2), (POINTS, 1))
    )
    # Differences at a kink grow by these factors from order to order: from the one that stands out to the sixth, and
    # from the fourth to the sixth; within two intervals of an end by 1.3, since fewer of them reach across. Less
    # growth reduces the weight by a high power; a vibration of six samples a period has growth 1.
    weight = np.ones(len(h))
    for lower, rise, growth in ((low, POINTS - order, 1.4), (middle, 2, 1.65)):
        observed = (high / np.where(lower > 0, lower, np.inf)) ** (1 / rise)
        required = np.full(len(h), growth)
        required[:2] = required[-2:] = 1.3
        weight = np.minimum(weight, (observed / required) ** 15)
    return outliers * (weight * h * stencil_length**order)[:, None]


def _centred_indices(order: int, h: Array) -> NDArray[np.intp]:
    """Return for each interval the index of the divided difference nearest to it."""
    return np.clip(np.arange(len(h)) - order // 2, 0, len(h) - order)


def _subtract_local_median(rows: Array) -> Array:
    """Return rows less the median of the five nearest, unless these five are spread widely."""
    neighbours = list(
        np.moveaxis(sliding_window_view(np.pad(rows, ((2, 2), (0, 0)), mode="reflect"), 5, axis=0), -1, 0)
    )
    middle = _median_of_five(neighbours)
    spread = _median_of_five([np.abs(row - middle) for row in neighbours])
    return rows - np.where(spread > 0.5 * np.abs(middle), 0.0, middle)


def _median_of_five(arrays: list[Array]) -> Array:
    a, b, c, d, e = arrays
    low = np.maximum(np.minimum(a, b), np.minimum(d, e))
    high = np.minimum(np.maximum(a, b), np.maximum(d, e))
    return np.asarray(np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), c)))


def _neighbourhood_max(sizes: Array, radius: int) -> Array:
    """Return for each element the largest of the elements at most `radius` places away."""
    return np.asarray(sliding_window_view(np.pad(sizes, radius, mode="edge"), 2 * radius + 1).max(axis=-1))
