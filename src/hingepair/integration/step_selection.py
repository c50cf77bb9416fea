"""Selection of steps by a tolerance (E12): steps are divided where their errors are large.

If an interval has an error e in one step, it has e / m^order in m steps; the number of steps in all is least for a
given sum of errors if m is in proportion to e^(1/(order + 1)). Intervals are divided in this way, into a few parts at
a time, until the errors are small enough: beside a jump or a root again and again, which costs some sixty steps and
not a million.

The sizes of errors add up to more than the errors, which mostly cancel where a motion goes to and fro. So the errors
are added up with their signs over the steps so far, and the target of the sum of sizes is larger by that ratio.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.integration.error_estimate import (
    StepErrors,
    StepSample,
    accumulate_errors,
    choose_step_sample,
    concatenate_errors,
    count_equal_steps,
    measure_step_errors,
    rounding_error,
)
from hingepair.integration.integrals import Integral
from hingepair.integration.stepping import Steps, subdivide
from hingepair.numeric.arrays import Float64Array as Array

MAX_SELECTED_STEP_COUNT: Final = 2_000_000
"""Number of steps up to which steps are divided for a tolerance; more errors remain in the error estimate."""

_MAX_DIVISION_ROUNDS = 64  # divisions of all pieces, at most


class SelectedSteps(NamedTuple):
    """Selected integration steps (`steps`), and a mapping from each integral to a pair of a StepSample of the steps
    and the StepErrors measured on it (`measured_errors`). The mapping is empty if no errors were measured, as without
    a tolerance.
    """

    steps: Steps
    # By integral; empty if none were measured.
    measured_errors: Mapping[Integral, tuple[StepSample, StepErrors]] = MappingProxyType({})


class _Pieces(NamedTuple):
    """Pieces of time into which the measured intervals are divided so far. Arrays give for each piece the index of
    its interval, its start and stop [s], the size of its error [rad], whether it is part of a longer measured piece
    (`is_refined`), and whether its error fell by the rule's order (`is_regular`). `errors` holds StepErrors by
    integral.
    """

    interval: NDArray[np.intp]  # index of the measured interval that each is part of
    start: Array  # of each [s]
    stop: Array  # of each [s]
    sizes: Array  # of the errors of the integral where they are largest [rad]
    is_refined: NDArray[np.bool_]  # whether the piece is part of a longer one whose error was measured before
    is_regular: NDArray[np.bool_]  # whether its error fell by the rule's order when it was divided
    errors: tuple[StepErrors, ...]  # by integral

    @property
    def cautious_sizes(self) -> Array:
        """Sizes of the errors [rad] as an array. A size is multiplied by 10 if the error did not fall by the rule's
        order, since it may be small by chance.
        """
        return np.where(self.is_regular, self.sizes, 10.0 * self.sizes)

    def select(self, selection: NDArray[Any]) -> _Pieces:
        """Return some of the pieces as `_Pieces`; `selection` is an array of indices or a mask."""
        interval, start, stop, sizes, refined, regular = (column[selection] for column in self[:-1])
        errors = tuple(errors.select(selection) for errors in self.errors)
        return _Pieces(interval, start, stop, sizes, refined, regular, errors)


def _merge_pieces(first: _Pieces, second: _Pieces) -> _Pieces:
    """Return two groups of pieces, `first` and `second`, as one `_Pieces` in the order of time."""
    columns = zip(first[:-1], second[:-1], strict=True)
    interval, start, stop, sizes, refined, regular = (np.concatenate(pair) for pair in columns)
    errors = tuple(concatenate_errors(pair) for pair in zip(first.errors, second.errors, strict=True))
    return _Pieces(interval, start, stop, sizes, refined, regular, errors).select(np.argsort(start))


@np.errstate(all="ignore")
def select_steps(integrals: Sequence[Integral], t: Array, tol: float | None) -> SelectedSteps:
    """Select integration steps between the instants t that keep the error of each integral below `tol` [rad], as far
    as at most MAX_SELECTED_STEP_COUNT steps can; return `SelectedSteps`. Errors of interpolation between samples do
    not count. If `tol` is None, each interval is one step.

    All integrals must have the same rule.
    """
    inexact = [integral for integral in integrals if not integral.is_exact]
    if tol is None or len(t) < 2 or not inexact:
        return SelectedSteps(Steps(t))
    duration, tol = t[-1] - t[0], max(tol, 1e-15)  # rad; below this tolerance only rounding errors are left
    step_sample = choose_step_sample(t, inexact[0].rule.order, [integral.rate for integral in inexact])
    weights = step_sample.error_weights(0)  # ratios of times: errors of pieces are proportional to time
    start, stop = step_sample.ends
    intervals, unknown = np.arange(len(start)), np.full(len(start), np.nan)
    counts = count_equal_steps(stop - start, duration, 16)  # the first steps are at most 1/16 of the whole time
    pieces = _divide_pieces(inexact, (intervals, start, stop, unknown), counts, duration)
    totals, piece_counts = list[float](), list[int]()
    while len(totals) < _MAX_DIVISION_ROUNDS:
        piece_weights = weights[pieces.interval]
        totals.append(float((_divisible_sizes(pieces) * piece_weights).sum()))
        piece_counts.append(len(pieces.start))
        # A sum of errors below 1e-3 rad that stagnates for five rounds is noise of the rate, not truncation.
        recent_totals = totals[-5:]
        stagnates = len(recent_totals) == 5 and max(recent_totals) < min(2 * min(recent_totals), 1e-3)
        if stagnates and piece_counts[-1] > 2 * piece_counts[-5]:
            break
        counts = _next_part_counts(inexact, step_sample, pieces, piece_weights, tol)
        divide = counts > 1
        if not divide.any():
            break
        parts = _divide_pieces(inexact, pieces.select(divide)[:4], counts[divide], duration)
        pieces = _merge_pieces(pieces.select(~divide), parts)
    return _assemble_steps(inexact, step_sample, pieces)


def _next_part_counts(
    integrals: Sequence[Integral], step_sample: StepSample, pieces: _Pieces, piece_weights: Array, tol: float
) -> NDArray[np.int64]:
    """Return an integer array, the number of equal parts into which each piece of time is divided next; all 1 if the
    errors of the integrals are small enough for `tol`. `piece_weights` are the numbers of pieces for which each piece
    stands.
    """
    order, sizes = integrals[0].rule.order, _divisible_sizes(pieces)
    target = 0.4 * tol  # a sum of the sizes of errors that is accepted without adding up the errors
    regular_sizes = np.where(pieces.is_regular, sizes, 0.0)
    total, regular = (float((part * piece_weights).sum()) for part in (sizes, regular_sizes))
    if not total > target:
        return np.ones(len(sizes), np.int64)
    # Parts of a piece in one round: fewer where the error did not fall by the rule's order.
    max_irregular_count = 4
    max_counts = np.where(pieces.is_regular, 16, max_irregular_count)
    counts, _ = _part_counts(sizes, piece_weights, max_counts, target, order)
    is_irregular = pieces.is_refined & ~pieces.is_regular
    if 0 < regular < 0.1 * total:  # jumps and roots first; their remaining error decides on the others
        counts[pieces.is_regular] = 1
    elif total < 1.0:  # rad; larger errors cannot be added up as vectors
        accumulated = _PieceErrors(integrals, step_sample, pieces)
        # A sum of errors is accepted up to 0.8 of what rounding leaves of the tolerance; a division aims at 0.6.
        allowed = max(tol - accumulated.rounding, 0.5 * tol)
        if accumulated.largest_sum(np.ones(len(sizes))) <= 0.8 * allowed:
            return np.ones(len(sizes), np.int64)
        for _ in range(8):  # geometric bisections between an accepted sum of sizes and one that is too large
            goal = math.sqrt(target * total)
            candidate, unlimited = _part_counts(sizes, piece_weights, max_counts, goal, order)
            if accumulated.largest_sum(np.where(unlimited > max_counts, unlimited, candidate)) <= 0.6 * allowed:
                target, counts = goal, candidate
            else:
                total = goal
    return np.where((counts > 1) & is_irregular, max_irregular_count, counts)


def _divide_pieces(
    integrals: Sequence[Integral],
    piece_columns: tuple[NDArray[np.intp], Array, Array, Array],
    counts: NDArray[np.int64],
    duration: float,
) -> _Pieces:
    """Divide pieces of time into `counts` equal parts each, measure the errors of the parts, and return the parts as
    `_Pieces`. `piece_columns` is a tuple of arrays, interval indices, starts, stops and error sizes of the pieces.
    `duration` is the whole time of the motion [s].
    """
    (interval, start, stop, old_sizes), order = piece_columns, integrals[0].rule.order
    steps = subdivide(start, stop, counts)
    errors = tuple(measure_step_errors(integral, steps.start, steps.stop, duration) for integral in integrals)
    sizes = np.minimum(np.max([one.sizes for one in errors], axis=0), 1e30)  # also of infinite errors
    expected = np.repeat(old_sizes / counts.astype(float) ** order, counts)
    columns = np.repeat(interval, counts), steps.start, steps.stop, sizes
    return _Pieces(*columns, ~np.isnan(expected), sizes <= expected, errors)


def _divisible_sizes(pieces: _Pieces) -> Array:
    """Return the error sizes of pieces of the time span [rad], multiplied by 10 where an error may be small by
    chance. The size is 0 for a piece that is too short to divide.
    """
    divisible = pieces.stop - pieces.start > 16 * np.spacing(np.maximum(np.abs(pieces.start), np.abs(pieces.stop)))
    return np.where(divisible, pieces.cautious_sizes, 0.0)


class _PieceErrors:
    """Errors of pieces of the time span for each integral, rotated to the axes of the first instant, where they add
    up. The method `largest_sum` returns the largest sum to expect after a further division, and the attribute
    `rounding` is the largest rounding error of an integral [rad].
    """

    def __init__(self, integrals: Sequence[Integral], step_sample: StepSample, pieces: _Pieces) -> None:
        self.order = integrals[0].rule.order
        self.uncertain = np.where(pieces.is_regular, 0.0, pieces.cautious_sizes)
        steps, measured_errors = _assemble_steps(integrals, step_sample, pieces)
        values = {integral: integral.integrate(steps, integral.default_start) for integral in integrals}
        self.by_integral = [accumulate_errors(one, steps, values[one], *measured_errors[one]) for one in integrals]
        self.rounding = max(
            rounding_error(one, values[one], measured_errors[one][0], measured_errors[one][1].rounding)
            for one in integrals
        )

    def largest_sum(self, counts: Array) -> float:
        """Return the largest sum of errors up to any instant [rad], a float, to expect if the pieces are divided into
        equal parts. `counts` is an array with the number of parts of each piece.
        """
        factors = counts**-self.order
        chance = math.sqrt(float(((self.uncertain * factors) ** 2).sum()))
        return max(chance, *(errors.largest_sum(factors) for errors in self.by_integral))


def _assemble_steps(integrals: Sequence[Integral], step_sample: StepSample, pieces: _Pieces) -> SelectedSteps:
    """Return the steps of the whole motion as `SelectedSteps`. Each piece is one step. Each interval that was not
    measured is divided into steps no longer than the longest piece of the measured interval that stands for it. The
    errors of the pieces become the measured errors of a sample of the steps.
    """
    t, count = step_sample.t, len(step_sample.t) - 1
    steps = Steps(t)
    if not len(step_sample.steps) == len(pieces.start) == count:
        longest = np.zeros(len(step_sample.steps))
        np.maximum.at(longest, pieces.interval, pieces.stop - pieces.start)
        part_counts = np.maximum(
            np.ceil(np.diff(t) * (1 - 2.0**-50) / step_sample.expand_to_steps(longest)), 1
        ).astype(np.int64)
        part_counts[step_sample.steps] = 1
        steps = steps.refine(np.append(pieces.start, subdivide(t[:-1], t[1:], part_counts).start))
        parts = np.searchsorted(steps.t, t[step_sample.parts])
        step_sample = StepSample(steps.t, np.searchsorted(steps.t, pieces.start), parts)
    by_integral = {integral: (step_sample, errors) for integral, errors in zip(integrals, pieces.errors, strict=True)}
    return SelectedSteps(steps, by_integral)


def _part_counts(
    sizes: Array, weights: Array, max_counts: NDArray[np.int64], target_sum: float, order: int
) -> tuple[NDArray[np.int64], Array]:
    """Return two arrays, the numbers of parts into which pieces must be divided so that the error sizes of all parts
    add up to `target_sum` [rad]. The first array holds integers that are at most `max_counts` each and whose sum,
    weighted with `weights`, is at most MAX_SELECTED_STEP_COUNT. The second array is without limits and not rounded.
    `sizes` are the error sizes of the pieces, `weights` the numbers of pieces that each stands for, and `order` is
    the power of the step length by which errors fall.
    """
    shares = sizes ** (1 / (order + 1))
    unlimited = ((shares * weights).sum() / target_sum) ** (1 / order) * shares
    limited = np.clip(unlimited, 1, max_counts)
    limited = np.maximum(limited * min(1.0, MAX_SELECTED_STEP_COUNT / (limited * weights).sum()), 1)
    counts = np.floor(limited)
    gain = sizes * (counts**-order - (counts + 1) ** -order)
    by_gain = np.argsort(-gain)
    reached = np.cumsum((gain * weights)[by_gain]) > (sizes * counts**-order * weights).sum() - target_sum
    within_limit = np.cumsum(weights[by_gain]) <= MAX_SELECTED_STEP_COUNT - (counts * weights).sum()
    one_more = np.append(True, ~reached[:-1]) & within_limit & (limited > counts)[by_gain]
    counts[by_gain[one_more]] += 1
    return counts.astype(np.int64), unlimited
