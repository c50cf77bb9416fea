"""Selection of steps by a tolerance (E12): steps are divided where their errors are large.

If an interval has an error e in one step, it has e / m^order in m steps; the number of steps in all is least for a
given sum of errors if m is in proportion to e^(1/(order + 1)). Where an error did not fall like this at the last
division, beside a jump or a root, a step is divided into four at most, again and again: into some sixty steps and not
a million.

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

from hingepair.motion.error_estimate import (
    StepErrors,
    concatenate_errors,
    equal_step_counts,
    largest_sum,
    measure_errors,
    rounding_error,
)
from hingepair.motion.integrals import Integral
from hingepair.motion.methods import ORDER
from hingepair.motion.stepping import Steps, subdivide
from hingepair.numeric.arrays import Float64Array as Array

MAX_STEPS: Final = 2_000_000  # up to which steps are divided; more errors remain in the error estimate


class SelectedSteps(NamedTuple):
    """Selected integration steps, and the errors of each integral over them, as far as they were measured."""

    steps: Steps
    errors: Mapping[Integral, StepErrors] = MappingProxyType({})


class _Pieces(NamedTuple):
    """Pieces of time into which the intervals are divided so far."""

    start: Array  # [s]
    stop: Array  # [s]
    expected: (
        Array  # size of the error if it has fallen by the method's order at the last division [rad]; NaN: unknown
    )
    errors: tuple[StepErrors, ...]  # by integral

    @property
    def error_sizes(self) -> Array:
        """Sizes of the errors of the pieces [rad], each the largest of all integrals."""
        return np.asarray(
            np.minimum(np.max([one.sizes for one in self.errors], axis=0), 1e30)
        )  # also of infinite ones

    @property
    def is_regular(self) -> NDArray[np.bool_]:
        """Whether the error fell by the method's order at the last division."""
        return self.error_sizes <= self.expected

    @property
    def cautious_sizes(self) -> Array:
        """Sizes of the errors [rad], tenfold where they may be small by chance, since they are not regular; 0 of
        pieces too short to divide.
        """
        shortest = 16 * np.spacing(np.maximum(np.abs(self.start), np.abs(self.stop)))
        factor = np.where(self.is_regular, 1.0, 10.0)
        return np.where(self.stop - self.start > shortest, factor * self.error_sizes, 0.0)

    def select(self, which: NDArray[Any]) -> _Pieces:
        """Return some of the pieces."""
        start, stop, expected = (column[which] for column in self[:-1])
        return _Pieces(start, stop, expected, tuple(one.select(which) for one in self.errors))

    def merged(self, other: _Pieces) -> _Pieces:
        """Return the pieces of both in the order of time."""
        start, stop, expected = (np.concatenate(pair) for pair in zip(self[:-1], other[:-1], strict=True))
        errors = tuple(concatenate_errors(pair) for pair in zip(self.errors, other.errors, strict=True))
        return _Pieces(start, stop, expected, errors).select(np.argsort(start))


@np.errstate(all="ignore")
def select_steps(integrals: Sequence[Integral], t: Array, tol: float | None) -> SelectedSteps:
    """Select integration steps between the instants t that keep the error of each integral below `tol` [rad], as far
    as MAX_STEPS can. Errors of interpolation between samples do not count. Without a tolerance each interval is one
    step.
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
        totals = [*totals, float(pieces.cautious_sizes.sum())][-5:]
        piece_counts = [*piece_counts, len(pieces.start)][-5:]
        stagnates = len(totals) == 5 and max(totals) < min(2 * min(totals), 1e-3)
        if stagnates and piece_counts[-1] > 2 * piece_counts[0]:
            break
        counts = _part_counts(inexact, t, pieces, tol)
        divide = counts > 1
        if not divide.any():
            break
        old = pieces.select(divide)
        parts = _divided(inexact, old.start, old.stop, old.error_sizes, counts[divide], duration)
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
    expected = np.repeat(sizes / counts.astype(float) ** ORDER, counts)
    return _Pieces(parts.start, parts.stop, expected, errors)


def _part_counts(integrals: Sequence[Integral], t: Array, pieces: _Pieces, tol: float) -> NDArray[np.int64]:
    """Return into how many equal parts each piece is divided next; all 1 if the errors are small enough."""
    sizes, is_regular = pieces.cautious_sizes, pieces.is_regular
    total, done = float(sizes.sum()), np.ones(len(sizes), np.int64)
    shares = sizes ** (1 / (ORDER + 1))

    def wanted(goal: float) -> Array:
        """Return the numbers of parts that bring the sum of sizes to about the goal."""
        return np.asarray(np.maximum(np.rint((shares.sum() / goal) ** (1 / ORDER) * shares), 1.0))

    if total == 0:
        return done
    goal = min(0.1, total / 20)  # rad, for large errors, which cannot be added up as vectors
    if total < 1.0:
        error_after, rounding = _expected_errors(integrals, t, pieces)
        # A sum of errors is accepted up to 0.8 of what rounding leaves of the tolerance; a division aims at 0.6.
        allowed = max(tol - rounding, 0.5 * tol)
        if error_after(done) <= 0.8 * allowed:
            return done
        goal, high = 0.4 * allowed / 1.5**ORDER, total  # with this goal, numbers that are rounded down suffice too
        for _ in range(8):  # bisections
            middle = math.sqrt(goal * high)
            goal, high = (middle, high) if error_after(wanted(middle)) <= 0.6 * allowed else (goal, middle)
    counts = np.asarray(np.minimum(wanted(goal), np.where(is_regular, 16, 4)), np.int64)
    if sizes[is_regular].sum() < 0.1 * total:  # jumps first: their remaining error decides on the other pieces
        counts[sizes < 0.01 * sizes.max()] = 1
    # The largest errors first, where there may not be enough steps.
    largest = np.argsort(-sizes)
    counts[largest[np.cumsum(counts[largest] - 1) > MAX_STEPS - len(counts)]] = 1
    return counts


def _expected_errors(
    integrals: Sequence[Integral], t: Array, pieces: _Pieces
) -> tuple[Callable[[NDArray[Any]], float], float]:
    """Return a function of the numbers of parts of the pieces, which tells the largest sum of errors at any instant
    that is to be expected of them [rad], and the largest rounding error [rad].
    """
    steps = _steps_of(t, pieces)
    parts = [
        (one, steps, one.integrate(steps, one.default_start), errors)
        for one, errors in zip(integrals, pieces.errors, strict=True)
    ]
    irregular = np.where(pieces.is_regular, 0.0, pieces.cautious_sizes)

    def error_after(counts: NDArray[Any]) -> float:
        factors = counts ** -float(ORDER)
        by_chance = float(np.linalg.norm(irregular * factors))
        return max(by_chance, *(largest_sum(*part, factors) for part in parts))

    return error_after, max(rounding_error(*part) for part in parts)
