"""Estimates of the error of integrals (E12), from the errors of their steps.

The error of a step is measured by steps of half its length or less. Errors of steps, turned back to the first
instant, add up to the error at any later one; where a tolerance selected the steps, it measured their errors. Of more
steps than MAX_MEASURED one of each part of the time is measured and stands for the part, beside those over which a
callable changes most abruptly, since it may jump there. Two quadratures may agree by chance on a jump near the end of
a step; divided differences of the values at all nodes and at two more times beside the ends do not. Of samples it is
the interpolant that is integrated so; what this misses is added (`interpolation_error`).

Rounding: a step that turns by an angle a is rounded by about u a. Its nodes are rounded by about u t where a callable
is given, which adds u t times the change of the rate over the step. Each step is rounded in its own way, so that the
squares add up: over many steps this is far less than u times all that is turned, over few fast ones about that. The
stamps of samples may be rounded too (`stamp_rounding`).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.integration.integrals import Angle, Integral
from hingepair.integration.interpolation_error import largest_error
from hingepair.integration.methods import RULES, Rule
from hingepair.integration.signals import Constant, Function, Samples, Signal
from hingepair.integration.stepping import Division, Steps, divided
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import row_norms

MAX_MEASURED: Final = 1 << 16
"""Steps whose errors are measured; of more, one of each part of the time."""

LOOKS: Final = 509
"""Steps over the whole time that a callable is looked at in, at least, to see what longer ones miss.

What is narrower than one of these, and than half a step, may lie between their nodes and be missed.
"""

_U = 2.0**-53
_NODES = 0.4  # measured; a step's outer nodes are rounded in opposite senses, the middle one counts 4/9
_OUTER = RULES["magnus6"].nodes[0], RULES["magnus6"].nodes[-1]
_SURE = 2.0  # times the noise of rounding: what is larger has another cause
_EDGE = 1e-4  # of a step: how near to its ends a callable is looked at, since it may jump at the instants themselves
_GROUP = 1 << 12  # intervals that are looked at in one go: arrays of a megabyte or two
_GOLDEN = 0.6180339887498949  # multiples of the golden ratio: their fractions are spread evenly
_ABRUPT = 6  # order of the divided differences that tell where a callable may jump
_LONG = 0.5  # of the longest step of its part: a step that may be measured for all of them
_FEW = 64  # steps that tell whether a rate is the same in all of them


class Measured(NamedTuple):
    """Steps whose errors are measured: all steps, or some of each part of the time, which stand for the part."""

    t: Array  # times between which the steps are, shape (steps + 1,)
    steps: NDArray[np.intp]  # numbers of the measured steps, increasing
    parts: NDArray[np.intp]  # number of the first step of each part

    @property
    def ends(self) -> tuple[Array, Array]:
        """Times at which the measured steps begin and end."""
        return self.t[self.steps], self.t[self.steps + 1]

    def each(self, values: Array) -> Array:
        """Return the values of parts as those of all steps."""
        return np.repeat(values, np.diff(self.parts, append=len(self.t) - 1))

    def stand_for(self, order: int) -> Array:
        """Return how many times a measured step's error its part's is, where errors go as length^(order + 1)."""
        if len(self.steps) == len(self.t) - 1:
            return np.ones(len(self.steps))
        errors = np.diff(self.t) ** (order + 1)
        part = np.searchsorted(self.parts, self.steps, side="right") - 1
        measured = np.bincount(part, errors[self.steps])
        factors = np.add.reduceat(errors, self.parts) / np.where(measured > 0, measured, 1.0)
        return np.asarray(factors[part])


def choose_measured(t: Array, order: int, signals: Sequence[Signal] = ()) -> Measured:
    """Choose the steps whose errors are measured: all, or one of each of some MAX_MEASURED parts.

    Parts are alike in time and number of steps. Which of its steps is measured is left to chance (the fractions of
    multiples of the golden ratio, the same at each call), in proportion to length^(order + 1), as errors go, among
    steps that are not much shorter than the longest: so the expected sum is right, whatever the lengths, and no
    rhythm of the motion is met always in the same phase. Steps over which signals change most abruptly, so that they
    may jump there, are parts of their own.
    """
    count = len(t) - 1
    every = np.arange(count)
    if count <= MAX_MEASURED:
        return Measured(t, every, every)
    lengths = np.diff(t)
    place = np.floor(0.5 * MAX_MEASURED * (every / count + (t[:-1] - t[0]) / (t[-1] - t[0])))
    first = np.diff(place, prepend=-1) > 0
    for signal in signals:
        if not isinstance(signal, Constant):
            abrupt = _most_abrupt(t, signal.instants(t).reshape(len(t), -1))
            first[abrupt] = True
            first[abrupt[abrupt < count - 1] + 1] = True
    parts = np.flatnonzero(first)
    shares = lengths / np.repeat(np.maximum.reduceat(lengths, parts), np.diff(parts, append=count))
    below = np.append(0.0, np.cumsum(np.where(shares < _LONG, 0.0, shares ** (order + 1))))
    chance = np.arange(1, len(parts) + 1) * _GOLDEN % 1.0
    sums = np.diff(below[np.append(parts, count)])
    return Measured(t, np.searchsorted(below, below[parts] + chance * sums, side="right") - 1, parts)


def _most_abrupt(t: Array, columns: Array) -> NDArray[np.intp]:
    """Return the steps over which values change most abruptly: there polynomials through six of them are most off."""
    count, most = len(t) - 1, MAX_MEASURED // 8
    rows = columns
    for k in range(1, _ABRUPT + 1):
        rows = np.diff(rows, axis=0) / (t[k:] - t[:-k])[:, None]
    first = np.clip(np.arange(count) - (_ABRUPT - 1) // 2, 0, len(rows) - 1)
    middle, off = 0.5 * (t[:-1] + t[1:]), np.diff(t) * row_norms(rows)[first]
    for k in range(_ABRUPT):
        off *= np.abs(middle - t[first + k])
    return np.argpartition(off, -most)[-most:]


class StepErrors(NamedTuple):
    """Errors of steps."""

    errors: Array  # vectors, shape (P, 3) or (P, 1)
    hidden: Array  # the size of what these may not show, shape (P,)
    noise: Array  # standard deviation of what rounding does to these, shape (P,)
    size: Array  # the integral of the rate's size, shape (P,)
    rounded: Array  # standard deviation of what rounding adds to that integral, shape (P,)

    @property
    def rounding(self) -> Rounding:
        """How steps are rounded."""
        return Rounding(self.size, self.rounded)

    @property
    def sizes(self) -> Array:
        """The sizes of errors, zero where rounding explains them."""
        return np.maximum(above(row_norms(self.errors), self.noise), self.hidden)

    def of(self, chosen: NDArray[Any]) -> StepErrors:
        """Return the errors of some of the steps, by number or by a mask."""
        return StepErrors(*(column[chosen] for column in self))


def joined(parts: Iterable[StepErrors]) -> StepErrors:
    """Join the errors of several groups of steps."""
    return StepErrors(*map(np.concatenate, zip(*parts, strict=True)))


@np.errstate(all="ignore")
def estimated_error(
    integral: Integral, steps: Steps, values: Array, known: tuple[Measured, StepErrors] | None = None
) -> float:
    """Estimate the error of an integral at the worst instant [rad], but for that of stamps.

    Args:
        integral: what was integrated.
        steps: the steps that were made.
        values: attitudes or angles at the ends of the steps.
        known: errors of the steps, if these were measured already.

    Returns:
        The error; NaN where it cannot be told.
    """
    rate, rule = integral.rate, integral.rule
    if not steps.made or (isinstance(integral, Angle) and integral.exact):
        return integral.rounded_on_the_way(values, 0.0)
    if integral.exact:
        measured = choose_measured(steps.t, rule.order)
        return rounding_error(integral, values, measured, interval_rounding(rate, *measured.ends))
    if known is None:
        measured = choose_measured(steps.t, rule.order, (rate,))
        known = measured, step_errors(integral, *measured.ends, steps.t[-1] - steps.t[0])
    measured, errors = known
    rounded = rounding_error(integral, values, measured, errors.rounding)
    if not isinstance(rate, Samples):
        return rounded + accumulated_errors(integral, steps, values, measured, errors).largest()
    seen = np.where(above(row_norms(errors.errors), errors.noise) > 0, measured.stand_for(rule.order), 0.0)
    at_samples = steps.asked(values)
    between = _between_samples(steps, measured.steps, seen[:, None] * errors.errors)
    missed = largest_error(rate, between, lambda a, b, e: integral.added_up(at_samples[a + 1 : b + 1], e))
    return rounded + missed


def rounding_error(integral: Integral, values: Array, measured: Measured, rounding: Rounding) -> float:
    """Return how far rounding takes an integral [rad], but for that of stamps.

    Args:
        integral: what was integrated.
        values: attitudes or angles at the ends of the steps.
        measured: the steps whose rounding is known.
        rounding: their rounding.
    """
    size = float((rounding.size * measured.stand_for(0)).sum())
    if _is_constant(integral.rate, measured):
        return _U * size + integral.rounded_on_the_way(values, 0.0)
    noise = math.sqrt(float((rounding.noise**2 * measured.stand_for(1)).sum()))
    return noise + integral.rounded_on_the_way(values, size)


class AccumulatedErrors(NamedTuple):
    """Errors of measured steps, ready to be added up."""

    turned: Array  # errors, turned back to the first instant, of all steps that each stands for; shape (P, k)
    noise: Array  # standard deviation of what rounding adds to these beyond what it adds to all steps
    hidden: Array  # the size of what these may not show
    before: NDArray[np.intp] | None  # how many of these are before each instant; None where instants end all steps

    def largest(self, factors: Array | float = 1.0) -> float:
        """Return the largest sum of errors up to any instant [rad], at least what may be hidden, as chance has it.

        Args:
            factors: what the errors are multiplied by; shape (P,).
        """
        scaled = self.turned.T * factors
        total = np.cumsum(np.append(np.zeros((len(scaled), 1)), scaled, axis=1), axis=1)
        total = total if self.before is None else total[:, self.before]
        apart = math.sqrt(float((total**2).sum(axis=0).max()))
        noise, hidden = (math.sqrt(float(((each * factors) ** 2).sum())) for each in (self.noise, self.hidden))
        return float(np.maximum(0.0 if apart <= 2 * _SURE * noise else apart, hidden))


def accumulated_errors(
    integral: Integral, steps: Steps, values: Array, measured: Measured, errors: StepErrors
) -> AccumulatedErrors:
    """Turn measured errors of steps back to the first instant, where they add up.

    Args:
        integral: what was integrated.
        steps: the steps that were made.
        values: attitudes or angles at the ends of the steps.
        measured: the steps whose errors are known.
        errors: their errors.
    """
    weights = measured.stand_for(integral.rule.order)
    turned = integral.added_up(values[measured.steps + 1], errors.errors * weights[:, None])
    noise, hidden = errors.noise * np.sqrt(weights**2 - weights), errors.hidden * np.sqrt(measured.stand_for(1))
    before = None if steps.own is None else np.searchsorted(measured.steps, steps.own)
    return AccumulatedErrors(turned, noise, hidden, before)


def _is_constant(rate: Signal, measured: Measured) -> bool:
    """Return whether a rate is the same in all steps, which are rounded alike then, as seen in a few of them."""
    if isinstance(rate, Constant):
        return True
    some = np.unique(np.linspace(0, len(measured.steps) - 1, _FEW).astype(np.intp))
    start, stop = (times[some] for times in measured.ends)
    rates = rate.nodes(start, stop - start, _OUTER)
    return bool((rates == rates[0, 0]).all())


def _between_samples(steps: Steps, chosen: NDArray[np.intp], errors: Array) -> tuple[NDArray[np.intp], Array]:
    """Add errors of steps up to those of the intervals between samples, of which steps may be parts."""
    if steps.own is None:
        return chosen, errors
    whole, first = np.unique(np.searchsorted(steps.own, chosen, side="right") - 1, return_index=True)
    return whole, np.add.reduceat(errors, first, axis=0)


def step_errors(integral: Integral, start: Array, stop: Array, whole: float) -> StepErrors:
    """Measure the errors of steps by steps of half the length, or as short as `LOOKS` over the whole time are.

    Args:
        integral: what is integrated.
        start: when the steps begin.
        stop: when the steps end.
        whole: the whole time, of which `LOOKS` steps are shortest.
    """
    groups = (slice(first, first + _GROUP) for first in range(0, len(start), _GROUP))
    return joined(_step_errors(integral, start[group], stop[group], whole) for group in groups)


def _step_errors(integral: Integral, start: Array, stop: Array, whole: float) -> StepErrors:
    rate, rule = integral.rate, integral.rule
    one = divided(start, stop, np.ones(len(start), np.int64))
    many = divided(start, stop, 2 * np.maximum(-(-spread(stop - start, whole, LOOKS) // 2), 1))
    nodes = rate.nodes(one.start, one.h, rule.nodes), rate.nodes(many.start, many.h, rule.nodes)
    gain = many.counts.astype(float) ** rule.order  # of the error: what finer steps find is not all of it
    errors = integral.apart(one, many, nodes) * (gain / (gain - 1))[:, None]
    rounding = interval_rounding(rate, start, stop)
    noise = rounding.noise + integral.rounded(rounding.size, many.counts.astype(float))
    hidden = above(_hidden(rate, one, many, nodes, rule), 4 * noise)
    return StepErrors(errors, hidden, noise, rounding.size, rounding.noise)


def spread(lengths: Array, whole: float, steps: int) -> NDArray[np.int64]:
    """Return how many of so many even steps over the whole time are within intervals; one at least."""
    counts: NDArray[np.int64] = np.clip(np.nan_to_num(np.ceil(lengths * (steps / whole)), nan=1.0), 1, steps)
    return counts.astype(np.int64)


def above(errors: Array, noise: Array) -> Array:
    """Return the sizes of errors that rounding does not explain, else zero."""
    return np.where(errors <= _SURE * noise, 0.0, errors)


def _hidden(signal: Signal, one: Division, many: Division, nodes: tuple[Array, Array], rule: Rule) -> Array:
    """What a jump or a kink may come to that two quadratures do not show, since they agree by chance.

    Where a callable jumps between two nodes of a pair of steps, the integral may be off by as much as it jumps times
    the distance of the nodes; of what is smooth, divided differences over so many nodes leave less than the rule.
    """
    if not isinstance(signal, Function) or rule.nodes[0] == 0:
        return np.zeros(len(one.h))
    pairs = many._replace(counts=many.counts // 2, start=many.start[::2], stop=many.stop[1::2])
    inside = nodes[1].reshape(len(pairs.h), 2 * len(rule.nodes), -1)
    ends = signal.nodes(pairs.start, pairs.h, (_EDGE, 1 - _EDGE)).reshape(len(pairs.h), 2, -1)
    values = np.concatenate([ends[:, :1], inside, ends[:, 1:]], axis=1).transpose(1, 0, 2)
    columns = values.reshape(len(values), -1)
    seen = [row_norms((rows @ columns).reshape(-1, *values.shape[1:])).max(axis=0) for rows in _jump_weights(rule)]
    squares = pairs.added((pairs.h * np.minimum(*seen)) ** 2)
    shown = row_norms(rule.integral(nodes[0], one.h) - many.added(rule.integral(nodes[1], many.h)))
    return np.sqrt(np.where(squares > (_SURE * shown) ** 2, squares, 0.0))


@functools.cache
def _jump_weights(rule: Rule) -> tuple[Array, Array]:
    """Divided differences of the rule's order and of one more, about each gap between the nodes of a pair of steps.

    Each makes of a jump by 1 in its gap the length of the gap.
    """
    nodes = np.array(rule.nodes) / 2
    x = np.concatenate([[_EDGE], nodes, 0.5 + nodes, [1 - _EDGE]])
    found = []
    for order in (rule.order, rule.order + 1):
        rows = np.zeros((len(x) - 1, len(x)))
        for gap, row in enumerate(rows):
            low = min(max(gap - (order - 1) // 2, 0), len(x) - order - 1)
            near = x[low : low + order + 1]
            weights = 1 / (near[:, None] - near + np.eye(order + 1)).prod(axis=1)
            row[low : low + order + 1] = weights * ((x[gap + 1] - x[gap]) / weights[gap - low + 1 :].sum())
        found.append(rows)
    return found[0], found[1]


class Rounding(NamedTuple):
    """Rounding of steps over intervals."""

    size: Array  # the integral of the rate's size, shape (P,)
    noise: Array  # standard deviation of what rounding adds to the integral, shape (P,)


def interval_rounding(signal: Signal, start: Array, stop: Array) -> Rounding:
    """The rounding of steps over intervals."""
    h = stop - start
    if isinstance(signal, Constant):
        size = h * float(row_norms(signal.value.reshape(-1)))
        return Rounding(size, _U * size)
    rates = signal.nodes(start, h, _OUTER).reshape(len(h), 2, -1)
    size = 0.5 * h * (row_norms(rates[:, 0]) + row_norms(rates[:, 1]))
    moved = 0.0 if isinstance(signal, Samples) else _NODES * np.abs(stop) * row_norms(rates[:, 1] - rates[:, 0])
    return Rounding(size, _U * np.sqrt(size**2 + moved**2))
