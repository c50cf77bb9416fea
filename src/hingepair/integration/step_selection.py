"""The steps that a tolerance asks for (E12): ever shorter ones where errors are large.

With an error e of an interval in one step, m steps make it e / m^order; the least number of steps in all for a sum of
errors has m in proportion to e^(1/(order + 1)). Intervals are divided so, a few times at a time, until the errors
are small enough: beside a jump or a root again and again, which costs some sixty steps and not a million.

Sizes of errors add up to more than errors do, which mostly cancel where a motion goes to and fro. So the errors are
added up as they are, over the steps found so far, and the sum of sizes that is aimed at is larger by that ratio.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.integration.error_estimate import (
    Measured,
    StepErrors,
    accumulated_errors,
    choose_measured,
    joined,
    rounding_error,
    spread,
    step_errors,
)
from hingepair.integration.integrals import Integral
from hingepair.integration.stepping import Steps, divided
from hingepair.numeric.arrays import Float64Array as Array

MOST_STEPS: Final = 2_000_000
"""That a tolerance may ask for; where they are not enough, the estimate says how far they got."""

FEWEST: Final = 16
"""Steps over the whole time that a tolerance begins with."""

_FINEST = 1e-15  # rad: below, rounding is all that is left
_SHARE = 0.4  # of the tolerance: a sum of sizes of errors that is small enough
_AIM, _ENOUGH = 0.6, 0.8  # of the tolerance: errors as they add up, aimed at and small enough
_HALVINGS = 8  # of the range, in powers, in which the sum of sizes is found that makes such errors
_ADDING = 1.0  # rad: a smaller sum of errors has directions in which they add up
_MOSTLY = 0.1  # of the sum of errors: the others are nearly all of it
_ROUNDS = 64
_PARTS, _FEW_PARTS = 16, 4  # of an interval at a time; few where errors do not go by the rule's order
_COARSE, _PATIENCE = 1e-3, 5  # rad, rounds: a smaller sum that stays the same for so many is noise, not truncation
_BY_CHANCE = 10.0  # errors that do not go by the order may be so many times too small: two rules agree by chance
_HUGE = 1e30  # rad; anything larger is as bad


class SelectedSteps(NamedTuple):
    """Steps, and the errors that were measured when they were selected."""

    steps: Steps
    known: Mapping[Integral, tuple[Measured, StepErrors]] = MappingProxyType({})  # by integral, if measured


class _Pieces(NamedTuple):
    """Parts of the measured intervals: the steps so far."""

    owner: NDArray[np.intp]  # number of the measured interval that each is part of
    start: Array
    stop: Array
    sizes: Array  # of the errors, of the integral where they are largest
    divided: NDArray[np.bool_]  # whether each is a part of a piece whose error was measured before
    falling: NDArray[np.bool_]  # whether errors went by the rule's order when it was made
    errors: tuple[StepErrors, ...]  # of each integral

    def of(self, chosen: NDArray[Any]) -> _Pieces:
        """Return some pieces, by number or by a mask."""
        owner, start, stop, sizes, parted, falling = (column[chosen] for column in self[:-1])
        return _Pieces(owner, start, stop, sizes, parted, falling, tuple(each.of(chosen) for each in self.errors))


def _joined_pieces(some: _Pieces, others: _Pieces) -> _Pieces:
    """Join pieces in the order of time."""
    columns = zip(some[:-1], others[:-1], strict=True)
    owner, start, stop, sizes, parted, falling = (np.concatenate(pair) for pair in columns)
    errors = tuple(joined(pair) for pair in zip(some.errors, others.errors, strict=True))
    return _Pieces(owner, start, stop, sizes, parted, falling, errors).of(np.argsort(start))


@np.errstate(all="ignore")
def selected_steps(integrals: Sequence[Integral], t: Array, tol: float | None) -> SelectedSteps:
    """Select steps between instants that keep the errors of integrals below a tolerance, but for interpolation's.

    Args:
        integrals: what is integrated, all by one rule.
        t: the instants.
        tol: the largest error [rad]; without one there is one step for each interval.
    """
    moving = [integral for integral in integrals if not integral.exact]
    if tol is None or len(t) < 2 or not moving:
        return SelectedSteps(Steps(t))
    whole, tol = t[-1] - t[0], max(tol, _FINEST)
    measured = choose_measured(t, moving[0].rule.order, [integral.rate for integral in moving])
    weights = measured.stand_for(0)  # of as many times as much time
    start, stop = measured.ends
    intervals, unknown = np.arange(len(start)), np.full(len(start), np.nan)
    counts = spread(stop - start, whole, FEWEST)
    pieces = _divided(moving, (intervals, start, stop, unknown), counts, whole)
    totals, made = list[float](), list[int]()
    while len(totals) < _ROUNDS:
        stands_for = weights[pieces.owner]
        totals.append(float((_cautious_sizes(pieces) * stands_for).sum()))
        made.append(len(pieces.start))
        last = totals[-_PATIENCE:]
        stays = len(last) == _PATIENCE and max(last) < min(2 * min(last), _COARSE)
        if stays and made[-1] > 2 * made[-_PATIENCE]:
            break
        counts = _next_counts(moving, measured, pieces, stands_for, tol)
        again = counts > 1
        if not again.any():
            break
        parts = _divided(moving, pieces.of(again)[:4], counts[again], whole)
        pieces = _joined_pieces(pieces.of(~again), parts)
    return _assembled(moving, measured, pieces)


def _next_counts(
    integrals: Sequence[Integral], measured: Measured, pieces: _Pieces, stands_for: Array, tol: float
) -> NDArray[np.int64]:
    """Return how many parts each piece is divided into next; all 1 where errors are small enough."""
    order, sizes, least = integrals[0].rule.order, _cautious_sizes(pieces), _SHARE * tol
    total, certain = (float((part * stands_for).sum()) for part in (sizes, np.where(pieces.falling, sizes, 0.0)))
    if not total > least:
        return np.ones(len(sizes), np.int64)
    most = np.where(pieces.falling, _PARTS, _FEW_PARTS)
    counts, _ = _parts(sizes, stands_for, most, least, order)
    irregular = pieces.divided & ~pieces.falling
    if 0 < certain < _MOSTLY * total:  # jumps and roots first: what they leave tells how to divide the others
        counts[pieces.falling] = 1
    elif total < _ADDING:
        accumulated = _AccumulatedErrors(integrals, measured, pieces)
        allowed = max(tol - accumulated.rounding, 0.5 * tol)
        if accumulated.largest(np.ones(len(sizes))) <= _ENOUGH * allowed:
            return np.ones(len(sizes), np.int64)
        for _ in range(_HALVINGS):
            goal = math.sqrt(least * total)
            fewer, unlimited = _parts(sizes, stands_for, most, goal, order)
            if accumulated.largest(np.where(unlimited > most, unlimited, fewer)) <= _AIM * allowed:
                least, counts = goal, fewer
            else:
                total = goal
    return np.where((counts > 1) & irregular, _FEW_PARTS, counts)


def _divided(
    integrals: Sequence[Integral],
    pieces: tuple[NDArray[np.intp], Array, Array, Array],
    counts: NDArray[np.int64],
    whole: float,
) -> _Pieces:
    """Divide pieces (owner, start, stop, sizes) into so many parts each, and measure the errors of the parts."""
    (owner, start, stop, before), order = pieces, integrals[0].rule.order
    parts = divided(start, stop, counts)
    errors = tuple(step_errors(integral, parts.start, parts.stop, whole) for integral in integrals)
    sizes = np.minimum(np.max([each.sizes for each in errors], axis=0), _HUGE)
    expected = np.repeat(before / counts.astype(float) ** order, counts)
    whole_ones = np.repeat(owner, counts), parts.start, parts.stop, sizes
    return _Pieces(*whole_ones, ~np.isnan(expected), sizes <= expected, errors)


def _cautious_sizes(pieces: _Pieces) -> Array:
    """Return the sizes of errors, larger where they may be small by chance, none where no step can be shorter."""
    wide = pieces.stop - pieces.start > 16 * np.spacing(np.maximum(np.abs(pieces.start), np.abs(pieces.stop)))
    return np.where(wide, np.where(pieces.falling, pieces.sizes, _BY_CHANCE * pieces.sizes), 0.0)


class _AccumulatedErrors:
    """Errors of pieces, ready to be added up."""

    def __init__(self, integrals: Sequence[Integral], measured: Measured, pieces: _Pieces) -> None:
        self.order = integrals[0].rule.order
        self.uncertain = np.where(pieces.falling, 0.0, _BY_CHANCE * pieces.sizes)
        steps, known = _assembled(integrals, measured, pieces)
        values = {integral: integral.over(steps, integral.neutral) for integral in integrals}
        self.each = [accumulated_errors(one, steps, values[one], *known[one]) for one in integrals]
        self.rounding = max(
            rounding_error(one, values[one], known[one][0], known[one][1].rounding) for one in integrals
        )

    def largest(self, counts: Array) -> float:
        """Return the largest sum of errors up to any instant [rad] if each piece is divided into so many parts."""
        factors = counts**-self.order
        by_chance = math.sqrt(float(((self.uncertain * factors) ** 2).sum()))
        return max(by_chance, *(each.largest(factors) for each in self.each))


def _assembled(integrals: Sequence[Integral], measured: Measured, pieces: _Pieces) -> SelectedSteps:
    """Return pieces as steps; intervals that are not measured are divided like their neighbours."""
    t, count = measured.t, len(measured.t) - 1
    steps = Steps(t)
    if not len(measured.steps) == len(pieces.start) == count:
        longest = np.zeros(len(measured.steps))
        np.maximum.at(longest, pieces.owner, pieces.stop - pieces.start)
        like = np.maximum(np.ceil(np.diff(t) * (1 - 2.0**-50) / measured.each(longest)), 1).astype(np.int64)
        like[measured.steps] = 1
        steps = steps.refined(np.append(pieces.start, divided(t[:-1], t[1:], like).start))
        parts = np.searchsorted(steps.t, t[measured.parts])
        measured = Measured(steps.t, np.searchsorted(steps.t, pieces.start), parts)
    return SelectedSteps(
        steps, {own: (measured, errors) for own, errors in zip(integrals, pieces.errors, strict=True)}
    )


def _parts(
    sizes: Array, weights: Array, most: NDArray[np.int64], goal: float, order: int
) -> tuple[NDArray[np.int64], Array]:
    """Return how many parts pieces are divided into for sizes of errors that add up to a goal.

    Args:
        sizes: of the errors.
        weights: how many pieces each stands for.
        most: the largest numbers of parts.
        goal: the sum of the sizes of the parts' errors.
        order: of errors against the length of steps.

    Returns:
        The numbers of parts, within `most` and for MOST_STEPS in all; and what they would be without these limits,
        which is not rounded.
    """
    shares = sizes ** (1 / (order + 1))
    unlimited = ((shares * weights).sum() / goal) ** (1 / order) * shares
    more = np.clip(unlimited, 1, most)
    more = np.maximum(more * min(1.0, MOST_STEPS / (more * weights).sum()), 1)
    counts = np.floor(more)
    gain = sizes * (counts**-order - (counts + 1) ** -order)
    best = np.argsort(-gain)
    enough = np.cumsum((gain * weights)[best]) > (sizes * counts**-order * weights).sum() - goal
    room = np.cumsum(weights[best]) <= MOST_STEPS - (counts * weights).sum()
    one_more = np.append(True, ~enough[:-1]) & room & (more > counts)[best]
    counts[best[one_more]] += 1
    return counts.astype(np.int64), unlimited
