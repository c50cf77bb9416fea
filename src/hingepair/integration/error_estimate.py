"""Estimates of the error of integrals (E12), from the errors of their steps.

The error of a step is measured by steps of half its length or less. Errors of steps, rotated to the axes of the first
instant, add up to the error at any later one; where a tolerance selected the steps, their errors were measured then.
Of more than MAX_FULLY_MEASURED_STEP_COUNT steps, one of each part of the time is measured and stands for the part;
the steps over which a callable changes most abruptly are measured too, since it may jump there. Two quadratures may
agree by chance on a jump near the end of a step; divided differences of the values at all nodes and at two more times
beside the ends do not. For samples the interpolant is integrated; the error of the interpolation is added
(`interpolation_error`).

Rounding: a step that turns by an angle a is rounded by about u a. Its nodes are rounded by about u t where the rate
is a callable, which adds u t times the change of the rate over the step. The rounding errors of steps are
independent, so that their squares add up: over many steps the sum is far less than u times the angle turned in all,
over few fast steps about that. The stamps of samples may be rounded too (`stamp_rounding`).
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.integration.integrals import AngleIntegral, Integral
from hingepair.integration.interpolation_error import largest_interpolation_error
from hingepair.integration.methods import STEP_RULE_BY_NAME, StepRule
from hingepair.integration.signals import CallableSignal, ConstantSignal, SampledSignal, Signal
from hingepair.integration.stepping import Steps, Subdivision, subdivide
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import row_norms
from hingepair.numeric.bounded import FLOAT64_UNIT_ROUNDOFF

MAX_FULLY_MEASURED_STEP_COUNT: Final = 1 << 16
"""Steps whose errors are all measured; of more steps one is measured in each of about as many parts of the time."""

# First and last node of a step on [0, 1].
_RELATIVE_FIRST_AND_LAST_NODE_TIME_OF_MAGNUS6 = (
    STEP_RULE_BY_NAME["magnus6"].nodes[0],
    STEP_RULE_BY_NAME["magnus6"].nodes[-1],
)
_MAX_ERROR_EXPLAINED_BY_ROUNDING_IN_STD = 2.0  # standard deviations of rounding: a larger error has another cause
# Fractions of a pair of steps: beside its ends, and not at them, since a callable may jump at instants.
_RELATIVE_JUMP_DETECTION_TIMES_AT_ENDS_OF_STEP_PAIR = (1e-4, 1 - 1e-4)
_MEASURED_STEPS_PER_CHUNK = 1 << 12  # steps whose errors are measured at a time, in arrays of a megabyte or two
# Of the golden ratio; fractions of its multiples are spread evenly over [0, 1].
_GOLDEN_RATIO_FRACTIONAL_PART = 0.6180339887498949


class StepSample(NamedTuple):
    """Sample of integration steps whose errors are measured. `t` holds the ends of all steps, `steps` the indices of
    the measured steps, and `parts` the index of the first step of each part of the time; the measured steps of a part
    stand for the whole part.
    """

    t: Array  # ends of all steps [s]; shape (steps + 1,)
    steps: NDArray[np.intp]  # indices of the measured steps, increasing
    parts: NDArray[np.intp]  # index of the first step of each part

    @property
    def ends(self) -> tuple[Array, Array]:
        """A pair of arrays (P,), the times at which the measured steps begin and end [s]."""
        return self.t[self.steps], self.t[self.steps + 1]

    def expand_to_steps(self, values: Array) -> Array:
        """Return an array with a value for each of all steps from `values`, one for each part of the time."""
        return np.repeat(values, np.diff(self.parts, append=len(self.t) - 1))

    def error_weights(self, order: int) -> Array:
        """Return weights (P,) by which the errors of the measured steps are multiplied to give the errors of the
        parts of the time for which they stand. The error of a step is taken to be proportional to its length to the
        power `order` + 1.
        """
        if len(self.steps) == len(self.t) - 1:
            return np.ones(len(self.steps))
        errors = np.diff(self.t) ** (order + 1)
        part = np.searchsorted(self.parts, self.steps, side="right") - 1
        measured = np.bincount(part, errors[self.steps])
        factors = np.add.reduceat(errors, self.parts) / np.where(measured > 0, measured, 1.0)
        return np.asarray(factors[part])


def choose_step_sample(t: Array, order: int, signals: Sequence[Signal] = ()) -> StepSample:
    """Choose the steps between times t whose errors are measured; return a `StepSample`. These are all steps, if
    there are at most MAX_FULLY_MEASURED_STEP_COUNT. Otherwise they are one step in each part of the time, drawn by a
    fixed sequence with a probability in proportion to the power `order` + 1 of the step's length, and the steps over
    which a Signal of `signals` changes most abruptly.

    Parts are similar in time and number of steps. The measured step of a part is drawn by a fixed quasi-random
    sequence (fractions of multiples of the golden ratio), with a probability in proportion to length^(order + 1), as
    errors go, among steps that are not much shorter than the longest. So the expected sum is right for any lengths,
    and no period of the motion is always met in the same phase. Steps over which signals change most abruptly, where
    they may jump, are parts of their own.
    """
    count = len(t) - 1
    indices = np.arange(count)
    if count <= MAX_FULLY_MEASURED_STEP_COUNT:
        return StepSample(t, indices, indices)
    lengths = np.diff(t)
    place = np.floor(0.5 * MAX_FULLY_MEASURED_STEP_COUNT * (indices / count + (t[:-1] - t[0]) / (t[-1] - t[0])))
    first = np.diff(place, prepend=-1) > 0
    for signal in signals:
        if not isinstance(signal, ConstantSignal):
            abrupt = _most_abrupt_steps(t, signal.values_at(t).reshape(len(t), -1))
            first[abrupt] = True
            first[abrupt[abrupt < count - 1] + 1] = True
    parts = np.flatnonzero(first)
    shares = lengths / np.repeat(np.maximum.reduceat(lengths, parts), np.diff(parts, append=count))
    # Steps below half the length of the longest step of a part are not drawn.
    below = np.append(0.0, np.cumsum(np.where(shares < 0.5, 0.0, shares ** (order + 1))))
    chance = np.arange(1, len(parts) + 1) * _GOLDEN_RATIO_FRACTIONAL_PART % 1.0
    sums = np.diff(below[np.append(parts, count)])
    return StepSample(t, np.searchsorted(below, below[parts] + chance * sums, side="right") - 1, parts)


def _most_abrupt_steps(t: Array, values: Array) -> NDArray[np.intp]:
    """Return the indices of the MAX_FULLY_MEASURED_STEP_COUNT / 8 steps between times t over which `values`, an array
    with a row for each time, change most abruptly.
    """
    count, step_count = len(t) - 1, MAX_FULLY_MEASURED_STEP_COUNT // 8
    differences, order = values, 6  # of the divided differences whose size shows where a callable may jump
    for k in range(1, order + 1):
        differences = np.diff(differences, axis=0) / (t[k:] - t[:-k])[:, None]
    first = np.clip(np.arange(count) - (order - 1) // 2, 0, len(differences) - 1)
    middle, sizes = 0.5 * (t[:-1] + t[1:]), np.diff(t) * row_norms(differences)[first]
    for k in range(order):
        sizes *= np.abs(middle - t[first + k])
    return np.argpartition(sizes, -step_count)[-step_count:]


class StepErrors(NamedTuple):
    """Measured errors of integration steps, arrays with a row for each step. `errors` are the errors [rad], `noise`
    the standard deviations of their rounding, `undetected` the sizes of errors of jumps that the measurement may
    miss, `rate_integral` the integrals of the absolute rate, and `rate_integral_noise` the standard deviations of
    their rounding.
    """

    errors: Array  # rotation vectors (P, 3) or angles (P, 1) [rad]
    undetected: Array  # sizes of errors of jumps that the measurement may miss [rad]; shape (P,)
    noise: Array  # standard deviations of the rounding of the measured errors [rad]; shape (P,)
    rate_integral: Array  # integrals of abs(rate) over the steps [rad]; shape (P,)
    rate_integral_noise: Array  # standard deviations of what rounding adds to these [rad]; shape (P,)

    @property
    def rounding(self) -> StepRounding:
        """The integrals of the absolute rate over the steps and their rounding, as `StepRounding`."""
        return StepRounding(self.rate_integral, self.rate_integral_noise)

    @property
    def sizes(self) -> Array:
        """Sizes of the errors [rad], shape (P,). An error that rounding explains counts as zero, and no size is below
        the size of the undetected error.
        """
        return np.maximum(errors_above_noise(row_norms(self.errors), self.noise), self.undetected)

    def select(self, selection: NDArray[Any]) -> StepErrors:
        """Return the StepErrors of some of the steps; `selection` is an array of indices or a mask."""
        return StepErrors(*(column[selection] for column in self))


def concatenate_errors(groups: Iterable[StepErrors]) -> StepErrors:
    """Return the StepErrors of several groups of steps as one StepErrors, in the order of the groups."""
    return StepErrors(*map(np.concatenate, zip(*groups, strict=True)))


@np.errstate(all="ignore")
def estimate_error(
    integral: Integral, steps: Steps, values: Array, measured_errors: tuple[StepSample, StepErrors] | None = None
) -> float:
    """Return an estimate of the largest error of an integral at any instant [rad], a float; NaN if there is no
    estimate. `values` are the attitudes or angles at the ends of all `steps`, a Steps object. `measured_errors` is a
    pair of a StepSample and its StepErrors; if it is None, errors are measured here. The rounding of time stamps is
    not part of the estimate.
    """
    rate, rule = integral.rate, integral.rule
    if not steps.step_count or (isinstance(integral, AngleIntegral) and integral.is_exact):
        return integral.rounding_at_instants(values, 0.0)
    if integral.is_exact:
        step_sample = choose_step_sample(steps.t, rule.order)
        return rounding_error(integral, values, step_sample, step_rounding(rate, *step_sample.ends))
    if measured_errors is None:
        step_sample = choose_step_sample(steps.t, rule.order, (rate,))
        measured_errors = step_sample, measure_step_errors(integral, *step_sample.ends, steps.t[-1] - steps.t[0])
    step_sample, errors = measured_errors
    rounding = rounding_error(integral, values, step_sample, errors.rounding)
    if not isinstance(rate, SampledSignal):
        return rounding + accumulate_errors(integral, steps, values, step_sample, errors).largest_sum()
    weights = np.where(
        errors_above_noise(row_norms(errors.errors), errors.noise) > 0, step_sample.error_weights(rule.order), 0.0
    )
    at_samples = steps.at_instants(values)
    between = _sum_by_sample_interval(steps, step_sample.steps, weights[:, None] * errors.errors)
    missed = largest_interpolation_error(
        rate, between, lambda a, b, e: integral.errors_at_start(at_samples[a + 1 : b + 1], e)
    )
    return rounding + missed


def rounding_error(integral: Integral, values: Array, step_sample: StepSample, rounding: StepRounding) -> float:
    """Return the largest rounding error of an integral at any instant [rad], a float, without the rounding of time
    stamps. `values` are the attitudes or angles at the ends of all steps. `rounding` is the StepRounding of the steps
    in `step_sample`, which stand for all steps.
    """
    size = float((rounding.rate_integral * step_sample.error_weights(0)).sum())
    if _is_rate_constant(integral.rate, step_sample):
        return FLOAT64_UNIT_ROUNDOFF * size + integral.rounding_at_instants(values, 0.0)
    noise = math.sqrt(float((rounding.noise**2 * step_sample.error_weights(1)).sum()))
    return noise + integral.rounding_at_instants(values, size)


class AccumulatedErrors(NamedTuple):
    """Errors of measured steps, rotated to the axes of the first instant, where they add up to errors of the
    integral. `errors` and `noise` are the errors and the standard deviations of their rounding, `undetected` the
    sizes of errors that may be missed, and `counts_before` the number of errors before each instant (None if all
    steps end at instants).
    """

    errors: Array  # of all steps that each stands for, in the axes of the first instant [rad]; shape (P, k)
    noise: Array  # standard deviations of what rounding adds to these beyond what it adds to all steps [rad]
    undetected: Array  # sizes of errors that the measurement may miss [rad]
    counts_before: NDArray[np.intp] | None  # number of errors before each instant; None: instants end all steps

    def largest_sum(self, factors: Array | float = 1.0) -> float:
        """Return the size of the largest sum of errors up to any instant [rad], a float. Each error is multiplied by
        its element of `factors`, an array or one number. A sum that rounding explains counts as zero. The result is
        not below the size of the undetected errors.
        """
        scaled = self.errors.T * factors
        total = np.cumsum(np.append(np.zeros((len(scaled), 1)), scaled, axis=1), axis=1)
        total = total if self.counts_before is None else total[:, self.counts_before]
        largest = math.sqrt(float((total**2).sum(axis=0).max()))
        noise, undetected = (
            math.sqrt(float(((sizes * factors) ** 2).sum())) for sizes in (self.noise, self.undetected)
        )
        return float(
            np.maximum(0.0 if largest <= 2 * _MAX_ERROR_EXPLAINED_BY_ROUNDING_IN_STD * noise else largest, undetected)
        )


def accumulate_errors(
    integral: Integral, steps: Steps, values: Array, step_sample: StepSample, errors: StepErrors
) -> AccumulatedErrors:
    """Rotate errors of measured steps to the axes of the first instant, where they add up; return
    `AccumulatedErrors`. `errors` are the StepErrors of the steps in `step_sample`. Each error is scaled to the part
    of the time for which its step stands. `values` are the attitudes or angles at the ends of all `steps`, a Steps
    object.
    """
    weights = step_sample.error_weights(integral.rule.order)
    errors_at_start = integral.errors_at_start(values[step_sample.steps + 1], errors.errors * weights[:, None])
    noise, undetected = (
        errors.noise * np.sqrt(weights**2 - weights),
        errors.undetected * np.sqrt(step_sample.error_weights(1)),
    )
    counts_before = (
        None if steps.instant_indices is None else np.searchsorted(step_sample.steps, steps.instant_indices)
    )
    return AccumulatedErrors(errors_at_start, noise, undetected, counts_before)


def _is_rate_constant(rate: Signal, step_sample: StepSample) -> bool:
    """Return True if the Signal `rate` has one and the same value near both ends of all steps of a sample of up to 64
    measured steps. All steps are then rounded alike.
    """
    if isinstance(rate, ConstantSignal):
        return True
    sampled = np.unique(np.linspace(0, len(step_sample.steps) - 1, 64).astype(np.intp))
    start, stop = (times[sampled] for times in step_sample.ends)
    rates = rate.values_at_nodes(start, stop - start, _RELATIVE_FIRST_AND_LAST_NODE_TIME_OF_MAGNUS6)
    return bool((rates == rates[0, 0]).all())


def _sum_by_sample_interval(
    steps: Steps, step_indices: NDArray[np.intp], errors: Array
) -> tuple[NDArray[np.intp], Array]:
    """Sum errors of steps over the intervals between instants. Return a pair of arrays: the indices of the intervals
    that contain one of these steps, and the sums, one row for each of the intervals. `errors` (P, k) are the errors
    of the steps with the indices `step_indices` in `steps`, a Steps object.
    """
    if steps.instant_indices is None:
        return step_indices, errors
    intervals, first = np.unique(
        np.searchsorted(steps.instant_indices, step_indices, side="right") - 1, return_index=True
    )
    return intervals, np.add.reduceat(errors, first, axis=0)


def measure_step_errors(integral: Integral, start: Array, stop: Array, duration: float) -> StepErrors:
    """Measure the errors of the steps of an integral from `start` to `stop` [s] by comparison with two or more
    shorter steps in place of each; return `StepErrors`. The shorter steps are no longer than 1/509 of `duration`, the
    whole time of the motion [s].
    """
    groups = (
        slice(first, first + _MEASURED_STEPS_PER_CHUNK) for first in range(0, len(start), _MEASURED_STEPS_PER_CHUNK)
    )
    return concatenate_errors(
        _measure_chunk_errors(integral, start[group], stop[group], duration) for group in groups
    )


def _measure_chunk_errors(integral: Integral, start: Array, stop: Array, duration: float) -> StepErrors:
    """Measure the errors of steps from `start` to `stop` [s] as `measure_step_errors` does, but all at once, not in
    chunks; return `StepErrors`.
    """
    rate, rule = integral.rate, integral.rule
    coarse = subdivide(start, stop, np.ones(len(start), np.int64))
    # A feature of a callable that is narrower than one of these steps, and than half a step, may be missed.
    min_counts = count_equal_steps(stop - start, duration, 509)
    fine = subdivide(start, stop, 2 * np.maximum(-(-min_counts // 2), 1))
    node_values = (
        rate.values_at_nodes(coarse.start, coarse.h, rule.nodes),
        rate.values_at_nodes(fine.start, fine.h, rule.nodes),
    )
    gain = fine.counts.astype(float) ** rule.order  # the ratio of errors, for Richardson extrapolation
    errors = integral.difference(coarse, fine, node_values) * (gain / (gain - 1))[:, None]
    rounding = step_rounding(rate, start, stop)
    noise = rounding.noise + integral.rounding_of_sums(rounding.rate_integral, fine.counts.astype(float))
    undetected = errors_above_noise(_undetected_errors(rate, coarse, fine, node_values, rule), 4 * noise)
    return StepErrors(errors, undetected, noise, rounding.rate_integral, rounding.noise)


def count_equal_steps(lengths: Array, duration: float, steps_per_duration: int) -> NDArray[np.int64]:
    """Return the number of equal steps of at most `duration` / `steps_per_duration` into which each interval of the
    array `lengths` must be divided, as an array of integers. Each number is from 1 to `steps_per_duration`.
    """
    counts: NDArray[np.int64] = np.clip(
        np.nan_to_num(np.ceil(lengths * (steps_per_duration / duration)), nan=1.0), 1, steps_per_duration
    )
    return counts.astype(np.int64)


def errors_above_noise(error_sizes: Array, noise: Array) -> Array:
    """Return the array `error_sizes` with zero in place of sizes that are at most twice the standard deviation
    `noise`, since rounding explains them.
    """
    return np.where(error_sizes <= _MAX_ERROR_EXPLAINED_BY_ROUNDING_IN_STD * noise, 0.0, error_sizes)


def _undetected_errors(
    signal: Signal, coarse: Subdivision, fine: Subdivision, node_values: tuple[Array, Array], rule: StepRule
) -> Array:
    """Return bounds on the errors [rad] of jumps that coarse and fine steps both miss by chance, shape (intervals,).
    A bound is zero unless the signal is a callable, no node of the rule is at an end of a step, and the bound exceeds
    twice the difference between coarse and fine steps. `coarse` and `fine` are Subdivisions of the same intervals,
    and `node_values` is the pair of arrays of the signal's values at the nodes of their steps.

    Where a callable jumps between two nodes of a pair of steps, the error of the integral may be the jump times the
    distance of the nodes. Divided differences over many nodes estimate this product; they are small where the
    callable is smooth.
    """
    if not isinstance(signal, CallableSignal) or rule.nodes[0] == 0:
        return np.zeros(len(coarse.h))
    pairs = fine._replace(counts=fine.counts // 2, start=fine.start[::2], stop=fine.stop[1::2])
    inside = node_values[1].reshape(len(pairs.h), 2 * len(rule.nodes), -1)
    ends = signal.values_at_nodes(pairs.start, pairs.h, _RELATIVE_JUMP_DETECTION_TIMES_AT_ENDS_OF_STEP_PAIR).reshape(
        len(pairs.h), 2, -1
    )
    values = np.concatenate([ends[:, :1], inside, ends[:, 1:]], axis=1).transpose(1, 0, 2)
    columns = values.reshape(len(values), -1)
    jumps = [row_norms((rows @ columns).reshape(-1, *values.shape[1:])).max(axis=0) for rows in _jump_weights(rule)]
    squares = pairs.sum_over_intervals((pairs.h * np.minimum(*jumps)) ** 2)
    measured = row_norms(
        rule.integral(node_values[0], coarse.h) - fine.sum_over_intervals(rule.integral(node_values[1], fine.h))
    )
    return np.sqrt(np.where(squares > (2.0 * measured) ** 2, squares, 0.0))


@functools.cache
def _jump_weights(rule: StepRule) -> tuple[Array, Array]:
    """Return two cached matrices (gaps, nodes) that detect jumps in the values at the nodes of two neighbouring steps
    of a rule, including two more nodes just inside the ends of the pair. Each row belongs to a gap between
    neighbouring nodes and is a divided difference, scaled so that a unit jump in the gap gives the length of the gap.
    The order of the differences is that of the rule in the first matrix, and one more in the second.
    """
    nodes = np.array(rule.nodes) / 2
    first, last = _RELATIVE_JUMP_DETECTION_TIMES_AT_ENDS_OF_STEP_PAIR
    x = np.concatenate([[first], nodes, 0.5 + nodes, [last]])
    matrices = []
    for order in (rule.order, rule.order + 1):
        rows = np.zeros((len(x) - 1, len(x)))
        for gap, row in enumerate(rows):
            low = min(max(gap - (order - 1) // 2, 0), len(x) - order - 1)
            near = x[low : low + order + 1]
            weights = 1 / (near[:, None] - near + np.eye(order + 1)).prod(axis=1)
            row[low : low + order + 1] = weights * ((x[gap + 1] - x[gap]) / weights[gap - low + 1 :].sum())
        matrices.append(rows)
    return matrices[0], matrices[1]


class StepRounding(NamedTuple):
    """Rounding of integration steps. `rate_integral` are the integrals of the absolute rate over the steps [rad], and
    `noise` the standard deviations of the rounding of the steps [rad].
    """

    rate_integral: Array  # integrals of abs(rate) over the intervals [rad]; shape (P,)
    noise: Array  # standard deviations of what rounding adds to these [rad]; shape (P,)


def step_rounding(signal: Signal, start: Array, stop: Array) -> StepRounding:
    """Return the `StepRounding` of integration steps from `start` to `stop` [s]; `signal` is the Signal of the
    rate.
    """
    h = stop - start
    if isinstance(signal, ConstantSignal):
        size = h * float(row_norms(signal.value.reshape(-1)))
        return StepRounding(size, FLOAT64_UNIT_ROUNDOFF * size)
    rates = signal.values_at_nodes(start, h, _RELATIVE_FIRST_AND_LAST_NODE_TIME_OF_MAGNUS6).reshape(len(h), 2, -1)
    size = 0.5 * h * (row_norms(rates[:, 0]) + row_norms(rates[:, 1]))
    # As measured, nodes that are rounded by u t give a step an error of 0.4 u t times the change of the rate.
    node_noise = (
        0.0 if isinstance(signal, SampledSignal) else 0.4 * np.abs(stop) * row_norms(rates[:, 1] - rates[:, 0])
    )
    return StepRounding(size, FLOAT64_UNIT_ROUNDOFF * np.sqrt(size**2 + node_noise**2))
