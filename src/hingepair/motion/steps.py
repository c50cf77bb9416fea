"""Errors of integration steps (E12), and steps selected by them.

The error of a step is measured by steps of half its length or less (step doubling, with Richardson extrapolation).
Errors of steps, rotated to the axes of the first instant, add up to the error at any later one. Both miss a jump
beside an end of a step; there the value is compared with the one that the nodes let expect. For samples the
interpolant is integrated; added is an error of interpolation, from those of every second and fourth sample.

Rounding: a step that turns by an angle a is rounded by about u a. Its nodes are rounded by about u t where the rate
is a callable, which adds u t times the change of the rate over the step. The rounding errors of steps are
independent, so that their squares add up: over many steps the sum is far less than u times the angle turned in all,
over few fast steps about that.

If an interval has an error e in one step, it has e / m^order in m steps; the number of steps in all is least for a
given sum of errors if m is in proportion to e^(1/(order + 1)). Where an error did not fall like this at the last
division, beside a jump or a root, a step is divided into four at most, again and again: into some sixty steps and not
a million.

The sizes of errors add up to more than the errors, which mostly cancel where a motion goes to and fro. So the errors
are added up with their signs over the steps so far, and the target of the sum of sizes is larger by that ratio.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.motion.magnus import (
    NODES,
    ORDER,
    AngleIntegral,
    Integral,
    Steps,
    Subdivision,
    step_integrals,
    subdivide,
)
from hingepair.motion.signals import CallableSignal, ConstantSignal, SampledSignal, Signal
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import row_norms
from hingepair.numeric.bounded import UNIT_ROUNDOFF

_CHUNK = 1 << 12  # steps whose errors are measured at a time, in arrays of a megabyte or two
_BESIDE_ENDS = 1e-4, 1 - 1e-4  # fractions of a pair of steps; not 0 and 1, since a callable may jump at instants
_EARLY_AND_LATE = NODES[::2]  # fractions of a step


class StepErrors(NamedTuple):
    """Measured errors of integration steps, a row for each step."""

    errors: Array  # rotation vectors (P, 3) or angles (P, 1) [rad]
    undetected: Array  # sizes of errors of jumps that the measurement may miss [rad]; shape (P,)
    noise: Array  # standard deviations of the rounding of the measured errors [rad]; shape (P,)
    turned: Array  # integrals of abs(rate) over the steps [rad]; shape (P,)
    rounding: Array  # standard deviations of what rounding adds to these [rad]; shape (P,)

    @property
    def sizes(self) -> Array:
        """Sizes of the errors [rad], 0 where rounding explains them, but not below `undetected`."""
        return np.maximum(_above_noise(row_norms(self.errors), self.noise), self.undetected)

    def select(self, which: NDArray[Any]) -> StepErrors:
        """Return the errors of some of the steps."""
        return StepErrors(*(column[which] for column in self))


def concatenate_errors(groups: Iterable[StepErrors]) -> StepErrors:
    """Return the errors of several groups of steps as one."""
    return StepErrors(*map(np.concatenate, zip(*groups, strict=True)))


@np.errstate(all="ignore")
def estimate_error(integral: Integral, steps: Steps, values: Array, errors: StepErrors | None = None) -> float:
    """Return an estimate of the largest error of an integral at any instant [rad].

    Args:
        integral: the integral of one motion.
        steps: its steps.
        values: attitudes or angles at the ends of the steps.
        errors: of the steps; None: they are measured here.

    Returns:
        The estimate; NaN for samples too few to tell.
    """
    rate = integral.rate
    if not steps.step_count or (isinstance(integral, AngleIntegral) and integral.is_exact):
        return integral.rounding_at_instants(values, 0.0)
    if isinstance(rate, ConstantSignal):
        turned = (steps.t[-1] - steps.t[0]) * float(row_norms(rate.values.reshape(-1)))
        return float(UNIT_ROUNDOFF * turned + integral.rounding_at_instants(values, 0.0))
    if errors is None:
        errors = measure_errors(integral, steps.t[:-1], steps.t[1:], steps.t[-1] - steps.t[0])
    rounding = rounding_error(integral, steps, values, errors)
    by_steps = rounding + largest_sum(integral, steps, values, errors)
    return (
        by_steps + _interpolation_error(integral, rate, steps, values)
        if isinstance(rate, SampledSignal)
        else by_steps
    )


def _interpolation_error(integral: Integral, rate: SampledSignal, steps: Steps, values: Array) -> float:
    """Return the largest error of interpolation at any instant [rad], by the integrals through every second and
    every fourth sample; NaN for fewer than 4 samples.
    """
    if len(rate.t) < 4:
        return math.nan
    t, h = steps.t, np.diff(steps.t)
    signals = [rate]
    while len(signals) < 3 and len(signals[-1].t) >= 4:
        signals.append(signals[-1].thinned())
    nodes = [one.values_at_nodes(t[:-1], h, NODES) for one in signals]
    apart = []
    for fine, coarse in itertools.pairwise(nodes):
        at_start = integral.errors_at_start(values[1:], step_integrals(fine - coarse, h))
        apart.append(float(row_norms(np.cumsum(at_start, axis=0)).max()))
    # Where the motion is smooth, twice the distance makes the error 64 times as large, beside a jump about twice. The
    # root of the ratio leaves room for a jump that the error of a smooth motion hides.
    ratio = apart[1] / apart[0] if len(apart) > 1 and apart[0] else 1.0
    return apart[0] / math.sqrt(min(max(ratio, 1.0), 64.0))


def rounding_error(integral: Integral, steps: Steps, values: Array, errors: StepErrors) -> float:
    """Return the largest rounding error of an integral at any instant [rad]."""
    turned = float(errors.turned.sum())
    if _is_rate_constant(integral.rate, steps.t):
        return UNIT_ROUNDOFF * turned + integral.rounding_at_instants(values, 0.0)
    return math.sqrt(float((errors.rounding**2).sum())) + integral.rounding_at_instants(values, turned)


def _is_rate_constant(rate: Signal, t: Array) -> bool:
    """Return whether the rate is the same in up to 64 steps, so that all are rounded alike."""
    some = np.unique(np.linspace(0, len(t) - 2, 64).astype(np.intp))
    rates = rate.values_at_nodes(t[some], t[some + 1] - t[some], _EARLY_AND_LATE)
    return bool((rates == rates[0, 0]).all())


def largest_sum(
    integral: Integral, steps: Steps, values: Array, errors: StepErrors, factors: Array | float = 1.0
) -> float:
    """Return the size of the largest sum of errors up to any instant [rad], each times its factor; not below the root
    of the sum of squares of errors that the measurement may miss.
    """
    scaled = (integral.errors_at_start(values[1:], errors.errors).T * factors).T
    sums = np.cumsum(np.append(np.zeros((1, scaled.shape[1])), scaled, axis=0), axis=0)
    return float(np.maximum(row_norms(steps.at_instants(sums)).max(), np.linalg.norm(errors.undetected * factors)))


def measure_errors(integral: Integral, start: Array, stop: Array, duration: float) -> StepErrors:
    """Measure the errors of steps from `start` to `stop` [s] by shorter steps in place of each, no longer than 1/509
    of the `duration` of the motion [s].
    """
    groups = (slice(first, first + _CHUNK) for first in range(0, len(start), _CHUNK))
    return concatenate_errors(_measure_chunk(integral, start[group], stop[group], duration) for group in groups)


def _measure_chunk(integral: Integral, start: Array, stop: Array, duration: float) -> StepErrors:
    """Measure the errors of so few steps that all fit into memory."""
    rate = integral.rate
    coarse = subdivide(start, stop, np.ones(len(start), np.int64))
    # A feature of a callable that is narrower than one of these steps, and than half a step, may be missed.
    fine = subdivide(start, stop, 2 * np.maximum(-(-equal_step_counts(stop - start, duration, 509) // 2), 1))
    node_values = (
        rate.values_at_nodes(coarse.start, coarse.h, NODES),
        rate.values_at_nodes(fine.start, fine.h, NODES),
    )
    # Richardson extrapolation: the error of fine steps is smaller by this factor.
    gain = fine.counts.astype(float) ** ORDER
    errors = integral.difference(coarse, fine, node_values) * (gain / (gain - 1))[:, None]
    turned, rounding = _step_rounding(rate, start, stop)
    noise = rounding + integral.rounding_of_sums(turned, fine.counts.astype(float))
    undetected = np.zeros(len(start))
    if isinstance(rate, CallableSignal):
        undetected = _above_noise(_undetected_errors(rate, coarse, fine, node_values), 4 * noise)
    return StepErrors(errors, undetected, noise, turned, rounding)


def equal_step_counts(lengths: Array, duration: float, most: int) -> NDArray[np.int64]:
    """Return into how many equal steps of at most `duration` / `most` each interval is divided, 1 to `most`."""
    counts = np.clip(np.nan_to_num(np.ceil(lengths * (most / duration)), nan=1.0), 1, most)
    return np.asarray(counts, np.int64)


def _above_noise(sizes: Array, noise: Array) -> Array:
    """Return sizes of errors, 0 where rounding explains them: up to two of its standard deviations."""
    return np.where(sizes <= 2.0 * noise, 0.0, sizes)


def _step_rounding(signal: Signal, start: Array, stop: Array) -> tuple[Array, Array]:
    """Return the integrals of abs(rate) over steps [rad], and the standard deviations of their rounding [rad]."""
    h = stop - start
    rates = signal.values_at_nodes(start, h, _EARLY_AND_LATE).reshape(len(h), 2, -1)
    turned = 0.5 * h * (row_norms(rates[:, 0]) + row_norms(rates[:, 1]))
    # As measured, nodes that are rounded by u t give a step an error of 0.4 u t times the change of the rate.
    by_nodes = 0.0 if isinstance(signal, SampledSignal) else 0.4 * np.abs(stop) * row_norms(rates[:, 1] - rates[:, 0])
    return turned, UNIT_ROUNDOFF * np.sqrt(turned**2 + by_nodes**2)


def _undetected_errors(
    signal: CallableSignal, coarse: Subdivision, fine: Subdivision, node_values: tuple[Array, Array]
) -> Array:
    """Return bounds on the errors [rad] of jumps between an end of a pair of fine steps and their nearest node, which
    coarse and fine steps both miss; 0 where a bound does not exceed twice the difference between them.
    """
    pairs = fine._replace(counts=fine.counts // 2, start=fine.start[::2], stop=fine.stop[1::2])
    nodes = np.append(NODES, np.add(NODES, 1)) / 2
    inside = node_values[1].reshape(len(pairs.h), len(nodes), -1)
    ends = signal.values_at_nodes(pairs.start, pairs.h, _BESIDE_ENDS).reshape(len(pairs.h), 2, -1)
    # Where no jump is in between, the polynomial through the values at the nodes goes through those at the ends.
    weights = np.linalg.solve(np.vander(nodes).T, np.vander(_BESIDE_ENDS, len(nodes)).T).T
    jumps = row_norms(ends - weights @ inside).max(axis=1)
    squares = pairs.sum_over_intervals((nodes[0] * pairs.h * jumps) ** 2)
    measured = row_norms(
        step_integrals(node_values[0], coarse.h) - fine.sum_over_intervals(step_integrals(node_values[1], fine.h))
    )
    return np.sqrt(np.where(squares > (2.0 * measured) ** 2, squares, 0.0))


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
