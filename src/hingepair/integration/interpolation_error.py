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

from hingepair.integration.signals import INTERPOLATION_POINTS, SampledSignal
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import row_norms

ErrorRotation: TypeAlias = Callable[[int, int, Array], Array]
"""Takes errors (..., n, k) of the intervals from the first to the second index to axes in which they add up."""

_BLOCK_INTERVALS = 65536  # intervals whose errors are computed at a time
_MARGIN_SAMPLES = 12  # samples on either side of a block that its divided differences use
_KINK_GROUP_SIZE = 8  # intervals whose errors may belong to one kink and are summed before sizes are taken
_KINK_BOUNDS: Final = ((1, 1 / 2), (2, 1 / 12), (3, 1 / 125))
"""Order of the difference that stands out (jump, kink, bend), and the largest |B_k| / k! on [0, 1]."""

_MIDDLE_PRODUCT_INTEGRAL = (
    191 / 84
)  # integral of the product of distances from six even samples a step apart, over the middle interval
# Factors by which differences at a jump, a kink or a bend grow from order to order: from the one that stands out to
# the sixth, from the fourth to the sixth, and within two intervals of an end, where fewer of them reach across.
_KINK_GROWTH, _LAST_KINK_GROWTH, _END_KINK_GROWTH = 1.4, 1.65, 1.3
# Power by which less growth reduces the weight of a kink; a vibration of six samples a period has growth 1.
_GROWTH_POWER = 15
_GAUSS_RULE = np.polynomial.legendre.leggauss(INTERPOLATION_POINTS // 2 + 1)  # nodes and weights on [-1, 1]


def largest_interpolation_error(
    samples: SampledSignal, step_errors: tuple[NDArray[np.intp], Array], rotate: ErrorRotation
) -> float:
    """Return the largest sum of the errors of integrals over the intervals, up to any instant.

    Args:
        samples: the samples of the rate.
        step_errors: indices of intervals, and the errors of the steps in them, which are added.
        rotate: takes errors to axes in which they add up.

    Returns:
        The error [rad]; NaN of fewer than 4 samples.
    """
    intervals, interval_step_errors = step_errors
    if len(samples.t) < 4:
        return math.nan
    count, width = len(samples.t), interval_step_errors.shape[1]
    values = samples.values.reshape(count, -1)
    carried_sum, worst = np.zeros(width), 0.0
    sizes, squares = np.zeros(len(_KINK_BOUNDS)), np.zeros(len(_KINK_BOUNDS))
    for first in range(0, count - 1, _BLOCK_INTERVALS):
        last = min(first + _BLOCK_INTERVALS, count - 1)
        low, high = max(0, first - _MARGIN_SAMPLES), min(count, last + 1 + _MARGIN_SAMPLES)
        missed = _interval_errors(samples.t[low:high], values[low:high])[:, first - low : last - low]
        block = slice(*np.searchsorted(intervals, (first, last)))
        missed[0, intervals[block] - first] -= interval_step_errors[block]
        errors = rotate(first, last, missed)
        sums = carried_sum + np.cumsum(errors[0], axis=0)
        worst = float(np.maximum(worst, np.maximum(row_norms(sums).max(), row_norms(errors[1]).max())))
        carried_sum = sums[-1]
        group_sizes = row_norms(np.add.reduceat(errors[2:], np.arange(0, last - first, _KINK_GROUP_SIZE), axis=1))
        sizes, squares = sizes + group_sizes.sum(axis=1), squares + (group_sizes**2).sum(axis=1)
    return float(np.maximum(worst, np.sqrt(sizes * np.sqrt(squares)).max()))


def _interval_errors(t: Array, columns: Array) -> Array:
    """Return the errors of the integrals over the intervals; shape (2 + kinks, intervals, columns).

    The first row has the mean of two sixth differences, the second the larger of them, since beside a gap they may
    cancel; the others have the errors of jumps, kinks and bends.
    """
    points = min(INTERPOLATION_POINTS, len(t))
    differences = [columns]
    for k in range(1, min(INTERPOLATION_POINTS + 1, len(t))):
        differences.append(np.diff(differences[-1], axis=0) / (t[k:] - t[:-k])[:, None])
    intervals = np.arange(len(t) - 1)
    start = np.clip(intervals - (points // 2 - 1), 0, len(t) - points)
    product = _stencil_products(t, start, points)
    errors = np.zeros((2 + len(_KINK_BOUNDS), len(intervals), columns.shape[1]))
    for row, difference in enumerate(_next_differences(differences, start, points)):
        errors[row] = difference * product[:, None]
    if len(t) > INTERPOLATION_POINTS:
        reach = (np.abs(product) / (_MIDDLE_PRODUCT_INTEGRAL * np.diff(t))) ** (1 / INTERPOLATION_POINTS)
        for level, (order, bound) in enumerate(_KINK_BOUNDS, start=2):
            errors[level] = bound * _kink_sizes(differences, order, np.diff(t), reach)
    return errors


def _stencil_products(t: Array, start: NDArray[np.intp], points: int) -> Array:
    """Integrate the product of the distances from the samples of the stencil over each interval."""
    h = np.diff(t)
    times = t[:-1, None] + h[:, None] * (0.5 + 0.5 * _GAUSS_RULE[0])
    product = np.ones_like(times)
    for j in range(points):
        product *= times - t[start + j][:, None]
    return np.asarray(0.5 * h * (product @ _GAUSS_RULE[1]))


def _next_differences(differences: list[Array], start: NDArray[np.intp], points: int) -> tuple[Array, Array]:
    """Return the mean and the larger of the divided differences of the stencil and one sample on either side.

    Where there are no more samples, the differences of lower order are extrapolated.
    """
    if len(differences) > points:
        rows = differences[points]
        left, right = rows[np.maximum(start - 1, 0)], rows[np.minimum(start, len(rows) - 1)]
        return 0.5 * (left + right), np.where((row_norms(left) > row_norms(right))[:, None], left, right)
    sizes = [math.factorial(k) * float(row_norms(rows).max()) for k, rows in enumerate(differences)]
    if sizes[-1] == 0:
        zero = np.zeros((len(start), differences[0].shape[1]))
        return zero, zero
    # A motion and its second derivative are large at the same time; four samples have only one such pair of orders.
    steps = (2, 4) if points > 4 else (1, 2)
    pairs = [(j, j + up) for up in steps for j in range(1, points - up) if sizes[j] != 0]
    growth = max((sizes[k] / sizes[j]) ** (1 / (k - j)) for j, k in pairs)
    factor = growth * max(1.0, growth * sizes[-2] / sizes[-1]) / points
    extrapolated = np.broadcast_to(factor * differences[-1], (len(start), differences[0].shape[1]))
    return extrapolated, extrapolated


def _kink_sizes(differences: list[Array], order: int, h: Array, reach: Array) -> Array:
    """Return how far differences of an order stand out, times h^(order + 1), weighted by growth of higher ones."""
    outliers = math.factorial(order) * _subtract_local_median(differences[order])[_centred_indices(order, h)]
    low = _neighbourhood_max(row_norms(outliers), 2) * reach**order
    middle, high = (
        math.factorial(k) * _neighbourhood_max(row_norms(differences[k])[_centred_indices(k, h)], radius) * reach**k
        for k, radius in ((INTERPOLATION_POINTS - 2, 2), (INTERPOLATION_POINTS, 1))
    )
    weight = np.ones(len(h))
    for lower, rise, growth in ((low, INTERPOLATION_POINTS - order, _KINK_GROWTH), (middle, 2, _LAST_KINK_GROWTH)):
        observed = (high / np.where(lower > 0, lower, np.inf)) ** (1 / rise)
        required = np.full(len(h), growth)
        required[:2] = required[-2:] = _END_KINK_GROWTH
        weight = np.minimum(weight, (observed / required) ** _GROWTH_POWER)
    return outliers * (weight * h * reach**order)[:, None]


def _centred_indices(order: int, h: Array) -> NDArray[np.intp]:
    """Return the index of the difference of an order that is centred on each interval, or of the nearest."""
    return np.clip(np.arange(len(h)) - order // 2, 0, len(h) - order)


def _subtract_local_median(rows: Array) -> Array:
    """Subtract the median of the five nearest rows, unless these are too spread for it to mean anything."""
    neighbours = list(
        np.moveaxis(sliding_window_view(np.pad(rows, ((2, 2), (0, 0)), mode="reflect"), 5, axis=0), -1, 0)
    )
    middle = _median_of_five(neighbours)
    spread = _median_of_five([np.abs(row - middle) for row in neighbours])
    return rows - np.where(spread > 0.5 * np.abs(middle), 0.0, middle)


def _median_of_five(five: list[Array]) -> Array:
    """Return the median of five arrays, element by element."""
    a, b, c, d, e = five
    low = np.maximum(np.minimum(a, b), np.minimum(d, e))
    high = np.minimum(np.maximum(a, b), np.maximum(d, e))
    return np.asarray(np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), c)))


def _neighbourhood_max(sizes: Array, radius: int) -> Array:
    """Return the largest of the neighbours up to a radius."""
    return np.asarray(sliding_window_view(np.pad(sizes, radius, mode="edge"), 2 * radius + 1).max(axis=-1))
