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
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.integration.error_estimate import (
    StepErrors,
    concatenate_errors,
    equal_step_counts,
    largest_sum,
    measure_errors,
    rounding_error,
)
from hingepair.integration.integrals import Integral
from hingepair.integration.stepping import Steps, subdivide
from hingepair.numeric.arrays import Float64Array as Array

MAX_STEPS: Final = 2_000_000  # up to which steps are divided; more errors remain in the error estimate
_IRREGULAR_PARTS = 4  # of a piece whose error did not fall by the rule's order


class SelectedSteps(NamedTuple):
    """Selected integration steps, and the errors of each integral over them, as far as they were measured."""

    steps: Steps
    errors: Mapping[Integral, StepErrors] = MappingProxyType({})


class _Pieces(NamedTuple):
    """Pieces of time into which the intervals are divided so far."""

    start: Array  # [s]
    stop: Array  # [s]
    sizes: Array  # of the errors of the integral where they are largest [rad]
    is_refined: NDArray[np.bool_]  # whether the piece is part of a longer one whose error was measured before
    is_regular: NDArray[np.bool_]  # whether its error fell by the rule's order when it was divided
    errors: tuple[StepErrors, ...]  # by integral

    @property
    def cautious_sizes(self) -> Array:
        """Sizes of the errors [rad], tenfold where they may be small by chance, since they are not regular."""
        return np.where(self.is_regular, self.sizes, 10.0 * self.sizes)

    @property
    def divisible_sizes(self) -> Array:
        """Cautious sizes [rad], 0 of pieces too short to divide."""
        shortest = 16 * np.spacing(np.maximum(np.abs(self.start), np.abs(self.stop)))
        return np.where(self.stop - self.start > shortest, self.cautious_sizes, 0.0)

    def select(self, which: NDArray[Any]) -> _Pieces:
        """Return some of the pieces."""
        start, stop, sizes, is_refined, is_regular = (column[which] for column in self[:-1])
        errors = tuple(one.select(which) for one in self.errors)
        return _Pieces(start, stop, sizes, is_refined, is_regular, errors)

    def merged(self, other: _Pieces) -> _Pieces:
        """Return the pieces of both in the order of time."""
        columns = (np.concatenate(pair) for pair in zip(self[:-1], other[:-1], strict=True))
        start, stop, sizes, is_refined, is_regular = columns
        errors = tuple(concatenate_errors(pair) for pair in zip(self.errors, other.errors, strict=True))
        return _Pieces(start, stop, sizes, is_refined, is_regular, errors).select(np.argsort(start))


@np.errstate(all="ignore")
def select_steps(integrals: Sequence[Integral], t: Array, tol: float | None) -> SelectedSteps:
    """Select integration steps between the instants t that keep the error of each integral below `tol` [rad], as far
    as MAX_STEPS can. Errors of interpolation between samples do not count. Without a tolerance each interval is one
    step. All integrals have the same rule.
    """
    inexact = [integral for integral in integrals if not integral.is_exact]
    if tol is None or len(t) < 2 or not inexact:
        return SelectedSteps(Steps(t))
    duration, tol = t[-1] - t[0], max(tol, 1e-15)  # rad; below this tolerance only rounding errors are left
    # The first steps are at most 1/16 of the whole time.
    counts = equal_step_counts(np.diff(t), duration, 16)
    pieces = _divided(inexact, t[:-1], t[1:], np.full(len(t) - 1, np.nan), counts, duration)
    totals, piece_counts = list[float](), list[int]()
    for _ in range(64):
        # A sum of errors below 1e-3 rad that stagnates for five rounds is noise of the rate, not truncation.
        totals = [*totals, float(pieces.divisible_sizes.sum())][-5:]
        piece_counts = [*piece_counts, len(pieces.start)][-5:]
        stagnates = len(totals) == 5 and max(totals) < min(2 * min(totals), 1e-3)
        if stagnates and piece_counts[-1] > 2 * piece_counts[0]:
            break
        counts = _part_counts(inexact, t, pieces, tol)
        divide = counts > 1
        if not divide.any():
            break
        old = pieces.select(divide)
        parts = _divided(inexact, old.start, old.stop, old.sizes, counts[divide], duration)
        pieces = pieces.select(~divide).merged(parts)
    return SelectedSteps(_steps_of(t, pieces), dict(zip(inexact, pieces.errors, strict=True)))


def _steps_of(t: Array, pieces: _Pieces) -> Steps:
    return Steps(t) if len(pieces.start) == len(t) - 1 else Steps(t).refine(pieces.start)


def _divided(
    integrals: Sequence[Integral], start: Array, stop: Array, sizes: Array, counts: NDArray[np.int64], duration: float
) -> _Pieces:
    """Divide pieces with errors of `sizes` (NaN: unknown) into `counts` equal parts each, and measure those."""
    parts = subdivide(start, stop, counts)
    errors = tuple(measure_errors(integral, parts.start, parts.stop, duration) for integral in integrals)
    found = np.minimum(np.max([one.sizes for one in errors], axis=0), 1e30)  # also of infinite errors
    expected = np.repeat(sizes / counts.astype(float) ** integrals[0].rule.order, counts)
    return _Pieces(parts.start, parts.stop, found, ~np.isnan(expected), found <= expected, errors)


def _part_counts(integrals: Sequence[Integral], t: Array, pieces: _Pieces, tol: float) -> NDArray[np.int64]:
    """Return into how many equal parts each piece is divided next; all 1 if the errors are small enough."""
    sizes = pieces.divisible_sizes
    total, regular = float(sizes.sum()), float(sizes[pieces.is_regular].sum())
    target = 0.4 * tol  # a sum of sizes that is accepted without adding up the errors
    done = np.ones(len(sizes), np.int64)
    if not total > target:
        return done
    order, most = integrals[0].rule.order, np.where(pieces.is_regular, 16, _IRREGULAR_PARTS)
    counts, _ = _counts_for(sizes, most, target, order)
    if 0 < regular < 0.1 * total:  # jumps first: their remaining error decides on the other pieces
        counts[pieces.is_regular] = 1
    elif total < 1.0:  # rad; larger errors cannot be added up as vectors
        largest_sum_of, rounding = _error_sums(integrals, t, pieces)
        # A sum of errors is accepted up to 0.8 of what rounding leaves of the tolerance; a division aims at 0.6.
        allowed = max(tol - rounding, 0.5 * tol)
        if largest_sum_of(done) <= 0.8 * allowed:
            return done
        for _ in range(8):  # geometric bisections between an accepted sum of sizes and one that is too large
            goal = math.sqrt(target * total)
            candidate, unlimited = _counts_for(sizes, most, goal, order)
            if largest_sum_of(np.where(unlimited > most, unlimited, candidate)) <= 0.6 * allowed:
                target, counts = goal, candidate
            else:
                total = goal
    return np.where((counts > 1) & pieces.is_refined & ~pieces.is_regular, _IRREGULAR_PARTS, counts)


def _error_sums(
    integrals: Sequence[Integral], t: Array, pieces: _Pieces
) -> tuple[Callable[[NDArray[Any]], float], float]:
    """Return a function of the numbers of parts of the pieces, which returns the largest sum of errors of an integral
    up to any instant that is to be expected, and the largest rounding error [rad].
    """
    steps, order = _steps_of(t, pieces), integrals[0].rule.order
    parts = [
        (one, steps, one.integrate(steps, one.default_start), errors)
        for one, errors in zip(integrals, pieces.errors, strict=True)
    ]
    irregular = np.where(pieces.is_regular, 0.0, pieces.cautious_sizes)

    def largest(counts: NDArray[Any]) -> float:
        factors = counts.astype(float) ** -order
        by_chance = math.sqrt(float(((irregular * factors) ** 2).sum()))
        return max(by_chance, *(largest_sum(*part, factors) for part in parts))

    return largest, max(rounding_error(*part) for part in parts)


def _counts_for(sizes: Array, most: NDArray[np.int64], target: float, order: int) -> tuple[NDArray[np.int64], Array]:
    """Return into how many parts, at most `most` and MAX_STEPS in all, pieces must be divided so that the sizes of
    the errors of all parts add up to `target` [rad]; and the same without limits, not rounded.
    """
    shares = sizes ** (1 / (order + 1))
    unlimited = (shares.sum() / target) ** (1 / order) * shares
    limited = np.clip(unlimited, 1, most)
    limited = np.maximum(limited * min(1.0, MAX_STEPS / limited.sum()), 1)
    counts = np.floor(limited)
    # One part more where it gains most, until the target is reached.
    gain = sizes * (counts**-order - (counts + 1) ** -order)
    by_gain = np.argsort(-gain)
    reached = np.cumsum(gain[by_gain]) > (sizes * counts**-order).sum() - target
    within_limit = np.arange(1, len(sizes) + 1) <= MAX_STEPS - counts.sum()
    one_more = np.append(True, ~reached[:-1]) & within_limit & (limited > counts)[by_gain]
    counts[by_gain[one_more]] += 1
    return np.asarray(counts, np.int64), unlimited
