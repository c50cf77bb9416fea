"""What an interpolant of samples misses of the integral (E12), interval by interval: from divided differences.

Degree 5 is off by the sixth divided difference times the product of the distances from the six samples, whose
integral over an interval is known, be the samples even or not. That is all of it where the motion is smooth: from
order to order the differences fall.

A jump, a kink or a bend makes one difference stand out from its neighbours, and those of higher order grow from there
on. Where between two samples it is cannot be seen; what it may come to is the largest value of Bernoulli's polynomial
of its order over the factorial, times the difference. Of many such errors nobody knows whether they add up, as where
all jumps are at samples, or go as chance has it: their total is taken halfway (the geometric mean).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from hingepair.integration.signals import POINTS, Samples
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import row_norms

Turn: TypeAlias = Callable[[int, int, Array], Array]

_BLOCK = 65536
_MARGIN = 12  # samples beside a block that its differences look at
_NEAR = 8  # intervals in which errors may belong to one kink and cancel
_KINKS: Final = ((1, 1 / 2), (2, 1 / 12), (3, 1 / 125))
"""Order of the difference that stands out (jump, kink, bend), and the largest |B_k| / k! on [0, 1]."""

_MIDDLE = 191 / 84  # of six even samples a step apart: integral of the product over the interval in the middle
# Differences of a jump, a kink or a bend grow by so much from order to order: from the one that stands out to the
# sixth, from the fourth to the sixth, and within two intervals of an end, where fewer of them reach across.
_GROWTH, _LAST_GROWTH, _GROWTH_AT_ENDS = 1.4, 1.65, 1.3
_STEEP = 15  # power by which less growth counts less; a vibration with six samples a period has 1
_GAUSS = np.polynomial.legendre.leggauss(POINTS // 2 + 1)


def largest_error(samples: Samples, of_steps: tuple[NDArray[np.intp], Array], turn: Turn) -> float:
    """Return the largest sum of the errors of integrals over the intervals, up to any instant.

    Args:
        samples: what is integrated.
        of_steps: numbers of intervals, and the errors of the steps in them, which are added.
        turn: takes errors (..., n, 3) of the intervals from one to another into axes in which they add up.

    Returns:
        The error [rad]; NaN of fewer than 4 samples.
    """
    chosen, extra = of_steps
    if len(samples.t) < 4:
        return math.nan
    count, width = len(samples.t), extra.shape[1]
    values = samples.values.reshape(count, -1)
    carry, worst = np.zeros(width), 0.0
    sizes, squares = np.zeros(len(_KINKS)), np.zeros(len(_KINKS))
    for first in range(0, count - 1, _BLOCK):
        last = min(first + _BLOCK, count - 1)
        low, high = max(0, first - _MARGIN), min(count, last + 1 + _MARGIN)
        missed = _missed(samples.t[low:high], values[low:high])[:, first - low : last - low]
        own = slice(*np.searchsorted(chosen, (first, last)))
        missed[0, chosen[own] - first] -= extra[own]
        errors = turn(first, last, missed)
        sums = carry + np.cumsum(errors[0], axis=0)
        worst = float(np.maximum(worst, np.maximum(row_norms(sums).max(), row_norms(errors[1]).max())))
        carry = sums[-1]
        near = row_norms(np.add.reduceat(errors[2:], np.arange(0, last - first, _NEAR), axis=1))
        sizes, squares = sizes + near.sum(axis=1), squares + (near**2).sum(axis=1)
    return float(np.maximum(worst, np.sqrt(sizes * np.sqrt(squares)).max()))


def _missed(t: Array, columns: Array) -> Array:
    """What is missed in the intervals; shape (2 + kinks, intervals, columns).

    First by the mean of two sixth differences; then by the larger of them, since beside a gap they may cancel.
    """
    points = min(POINTS, len(t))
    differences = [columns]
    for k in range(1, min(POINTS + 1, len(t))):
        differences.append(np.diff(differences[-1], axis=0) / (t[k:] - t[:-k])[:, None])
    intervals = np.arange(len(t) - 1)
    start = np.clip(intervals - (points // 2 - 1), 0, len(t) - points)
    product = _product(t, start, points)
    found = np.zeros((2 + len(_KINKS), len(intervals), columns.shape[1]))
    for row, rest in enumerate(_next(differences, start, points)):
        found[row] = rest * product[:, None]
    if len(t) > POINTS:
        reach = (np.abs(product) / (_MIDDLE * np.diff(t))) ** (1 / POINTS)
        for level, (order, most) in enumerate(_KINKS, start=2):
            found[level] = most * _kinks(differences, order, np.diff(t), reach)
    return found


def _product(t: Array, start: NDArray[np.intp], points: int) -> Array:
    """The integrals over the intervals of the product of the distances from the samples of the stencil."""
    h = np.diff(t)
    times = t[:-1, None] + h[:, None] * (0.5 + 0.5 * _GAUSS[0])
    product = np.ones_like(times)
    for j in range(points):
        product *= times - t[start + j][:, None]
    return np.asarray(0.5 * h * (product @ _GAUSS[1]))


def _next(differences: list[Array], start: NDArray[np.intp], points: int) -> tuple[Array, Array]:
    """The divided difference of the stencil and one sample more, on either side: their mean, and the larger.

    Where there are no more samples, it is as the differences there are go on.
    """
    if len(differences) > points:
        rows = differences[points]
        left, right = rows[np.maximum(start - 1, 0)], rows[np.minimum(start, len(rows) - 1)]
        return 0.5 * (left + right), np.where((row_norms(left) > row_norms(right))[:, None], left, right)
    sizes = [math.factorial(k) * float(row_norms(rows).max()) for k, rows in enumerate(differences)]
    if sizes[-1] == 0:
        none = np.zeros((len(start), differences[0].shape[1]))
        return none, none
    # A motion and its second derivative are large at the same time; four samples have one such pair only.
    steps = (2, 4) if points > 4 else (1, 2)
    pairs = [(j, j + up) for up in steps for j in range(1, points - up) if sizes[j] != 0]
    growth = max((sizes[k] / sizes[j]) ** (1 / (k - j)) for j, k in pairs)
    factor = growth * max(1.0, growth * sizes[-2] / sizes[-1]) / points
    found = np.broadcast_to(factor * differences[-1], (len(start), differences[0].shape[1]))
    return found, found


def _kinks(differences: list[Array], order: int, h: Array, reach: Array) -> Array:
    """How far each difference of an order stands out, times h^(order + 1), as far as higher ones grow upon it."""
    spikes = math.factorial(order) * _standing_out(differences[order])[_at(order, h)]
    low = _widest(row_norms(spikes), 2) * reach**order
    middle, high = (
        math.factorial(k) * _widest(row_norms(differences[k])[_at(k, h)], far) * reach**k
        for k, far in ((POINTS - 2, 2), (POINTS, 1))
    )
    weight = np.ones(len(h))
    for below, rise, growth in ((low, POINTS - order, _GROWTH), (middle, 2, _LAST_GROWTH)):
        found = (high / np.where(below > 0, below, np.inf)) ** (1 / rise)
        asked = np.full(len(h), growth)
        asked[:2] = asked[-2:] = _GROWTH_AT_ENDS
        weight = np.minimum(weight, (found / asked) ** _STEEP)
    return spikes * (weight * h * reach**order)[:, None]


def _at(order: int, h: Array) -> NDArray[np.intp]:
    """The difference of an order in whose middle each interval is, or the nearest."""
    return np.clip(np.arange(len(h)) - order // 2, 0, len(h) - order)


def _standing_out(rows: Array) -> Array:
    """Rows less the median of the five nearest, unless these are spread so much that it means nothing."""
    near = list(np.moveaxis(sliding_window_view(np.pad(rows, ((2, 2), (0, 0)), mode="reflect"), 5, axis=0), -1, 0))
    middle = _median(near)
    spread = _median([np.abs(row - middle) for row in near])
    return rows - np.where(spread > 0.5 * np.abs(middle), 0.0, middle)


def _median(five: list[Array]) -> Array:
    a, b, c, d, e = five
    low = np.maximum(np.minimum(a, b), np.minimum(d, e))
    high = np.minimum(np.maximum(a, b), np.maximum(d, e))
    return np.asarray(np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), c)))


def _widest(sizes: Array, far: int) -> Array:
    """The largest of the neighbours up to so far."""
    return np.asarray(sliding_window_view(np.pad(sizes, far, mode="edge"), 2 * far + 1).max(axis=-1))
