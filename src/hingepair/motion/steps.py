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
from collections.abc import Iterable, Mapping, Sequence
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
from hingepair.motion.signals import CallableSignal, ConstantSignal, SampledSignal
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import row_norms
from hingepair.numeric.bounded import UNIT_ROUNDOFF

_CHUNK = 1 << 12  # steps whose errors are measured at a time, in arrays of a megabyte or two
_BESIDE_ENDS = 1e-4, 1 - 1e-4  # fractions of a pair of steps; not 0 and 1, since a callable may jump at instants
MAX_STEPS: Final = 2_000_000  # up to which steps are divided; more errors remain in the error estimate
_NOISE = 2.5  # standard deviations of rounding that a measured error without truncation may have


class StepErrors(NamedTuple):
    """Measured errors of integration steps, a row for each step."""

    errors: Array  # rotation vectors (P, 3) or angles (P, 1) [rad]
    undetected: Array  # sizes of errors of jumps that the measurement may miss [rad]; shape (P,)
    rounding: Array  # standard deviations of the rounding of the steps [rad]; shape (P,)

    @property
    def sizes(self) -> Array:
        """Sizes of the errors [rad], 0 where rounding explains them, but not below `undetected`."""
        sizes = row_norms(self.errors)
        return np.maximum(np.where(sizes <= _NOISE * self.rounding, 0.0, sizes), self.undetected)

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
    estimate = rounding_error(integral, values, errors) + largest_sum(integral, steps, values, errors)
    return estimate + (
        _interpolation_error(integral, rate, steps, values) if isinstance(rate, SampledSignal) else 0.0
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


def rounding_error(integral: Integral, values: Array, errors: StepErrors) -> float:
    """Return the largest rounding error of an integral at any instant [rad]."""
    turned = float(errors.rounding.sum()) / UNIT_ROUNDOFF
    return math.sqrt(float((errors.rounding**2).sum())) + integral.rounding_at_instants(values, turned)


def largest_sum(
    integral: Integral, steps: Steps, values: Array, errors: StepErrors, factors: Array | float = 1.0
) -> float:
    """Return the size of the largest sum of errors up to any instant [rad], each times its factor; not below the root
    of the sum of squares of errors that the measurement may miss.
    """
    at_start = (integral.errors_at_start(values[1:], errors.errors).T * factors).T
    sums = np.cumsum(np.append(np.zeros((1, at_start.shape[1])), at_start, axis=0), axis=0)
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
    node_values = tuple(rate.values_at_nodes(steps.start, steps.h, NODES) for steps in (coarse, fine))
    # Richardson extrapolation: the error of fine steps is smaller by this factor.
    gain = fine.counts.astype(float) ** ORDER
    errors = integral.difference(coarse, fine, node_values) * (gain / (gain - 1))[:, None]
    of_nodes = node_values[0].reshape(len(start), len(NODES), -1)
    turned = coarse.h * row_norms(of_nodes).mean(axis=1)
    rounding = UNIT_ROUNDOFF * turned
    undetected = np.zeros(len(start))
    if isinstance(rate, CallableSignal):
        # As measured, nodes that are rounded by u t give a step an error of 0.4 u t times the change of the rate.
        rounding = np.hypot(
            rounding, 0.4 * UNIT_ROUNDOFF * np.abs(stop) * row_norms(of_nodes[:, -1] - of_nodes[:, 0])
        )
        found = _undetected_errors(rate, coarse, fine, node_values)
        undetected = np.where(found <= 4 * _NOISE * rounding, 0.0, found)
    return StepErrors(errors, undetected, rounding)


def equal_step_counts(lengths: Array, duration: float, most: int) -> NDArray[np.int64]:
    """Return into how many equal steps of at most `duration` / `most` each interval is divided, 1 to `most`."""
    counts = np.clip(np.nan_to_num(np.ceil(lengths * (most / duration)), nan=1.0), 1, most)
    return np.asarray(counts, np.int64)


def _undetected_errors(
    signal: CallableSignal, coarse: Subdivision, fine: Subdivision, node_values: tuple[Array, ...]
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


class SelectedSteps(NamedTuple):
    """Selected integration steps, and the errors of each integral over them, as far as they were measured."""

    steps: Steps
    errors: Mapping[Integral, StepErrors] = MappingProxyType({})


class _Pieces(NamedTuple):
    """Pieces of time into which the intervals are divided so far."""

    start: Array  # [s]
    stop: Array  # [s]
    expected: Array  # size of the error if it has fallen by the method's order [rad]; NaN before any division
    errors: tuple[StepErrors, ...]  # by integral

    @property
    def sizes(self) -> Array:
        """Sizes of the errors of the pieces [rad], each the largest of all integrals."""
        return np.asarray(
            np.minimum(np.max([one.sizes for one in self.errors], axis=0), 1e30)
        )  # also of infinite ones

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

    def divided(start: Array, stop: Array, sizes: Array, counts: NDArray[np.int64]) -> _Pieces:
        """Divide pieces with errors of `sizes` (NaN: unknown) into `counts` equal parts each, and measure those."""
        parts = subdivide(start, stop, counts)
        errors = tuple(measure_errors(integral, parts.start, parts.stop, duration) for integral in inexact)
        return _Pieces(parts.start, parts.stop, np.repeat(sizes / counts.astype(float) ** ORDER, counts), errors)

    # The first steps are at most 1/16 of the whole time.
    counts = equal_step_counts(np.diff(t), duration, 16)
    pieces = divided(t[:-1], t[1:], np.full(len(t) - 1, np.nan), counts)
    totals, piece_counts = list[float](), list[int]()
    for _ in range(64):
        sizes, regular = pieces.sizes, pieces.sizes <= pieces.expected
        # Sizes that did not fall by the method's order may be small by chance. Some pieces are too short to divide.
        shortest = 16 * np.spacing(np.maximum(np.abs(pieces.start), np.abs(pieces.stop)))
        cautious = np.where(pieces.stop - pieces.start > shortest, np.where(regular, 1.0, 10.0) * sizes, 0.0)
        # A sum of errors below 1e-3 rad that stagnates for five rounds is noise of the rate, not truncation.
        totals, piece_counts = [*totals, float(cautious.sum())][-5:], [*piece_counts, len(sizes)][-5:]
        stagnates = len(totals) == 5 and max(totals) < min(2 * min(totals), 1e-3)
        if stagnates and piece_counts[-1] > 2 * piece_counts[0]:
            break
        counts = _part_counts(inexact, t, pieces, cautious, regular, tol)
        divide = counts > 1
        if not divide.any():
            break
        old = pieces.select(divide)
        pieces = pieces.select(~divide).merged(divided(old.start, old.stop, sizes[divide], counts[divide]))
    return SelectedSteps(_steps_of(t, pieces), dict(zip(inexact, pieces.errors, strict=True)))


def _steps_of(t: Array, pieces: _Pieces) -> Steps:
    return Steps(t) if len(pieces.start) == len(t) - 1 else Steps(t).refine(pieces.start)


def _part_counts(
    integrals: Sequence[Integral], t: Array, pieces: _Pieces, sizes: Array, regular: NDArray[np.bool_], tol: float
) -> NDArray[np.int64]:
    """Return into how many equal parts each piece is divided next; all 1 if the errors are small enough."""
    total, done = float(sizes.sum()), np.ones(len(sizes), np.int64)
    if total == 0:
        return done
    parts: list[tuple[Any, Any, Any, Any]] = []
    goal = min(0.1, total / 20)  # rad, for large errors, which cannot be added up as vectors
    if total < 1.0:
        steps = _steps_of(t, pieces)
        values = [integral.integrate(steps, integral.default_start) for integral in integrals]
        parts = [*zip(integrals, [steps] * len(values), values, pieces.errors, strict=True)]
        rounding = max(rounding_error(*own) for own in zip(integrals, values, pieces.errors, strict=True))
        # A sum of errors is accepted up to 0.85 of what rounding leaves of the tolerance; a division aims at 0.75.
        goal = 0.75 * max(tol - rounding, 0.5 * tol)

    def error_after(counts: Array) -> Any:
        """Return the largest sum of errors at any instant that is to be expected of so many parts [rad]."""
        factors = counts**-ORDER
        by_chance = float(np.linalg.norm(np.where(regular, 0.0, sizes) * factors))
        return max(by_chance, *(largest_sum(*own, factors) for own in parts)) if parts else float(sizes @ factors)

    shares, wanted = sizes ** (1 / (ORDER + 1)), np.ones(len(sizes))
    error = error_after(wanted)
    if parts and error <= 0.85 / 0.75 * goal:
        return done
    scale = (error / total * float(shares.sum()) / goal) ** (1 / ORDER)
    while error_after(wanted) > goal and wanted.max() < 16:  # in a round
        wanted, scale = np.maximum(np.rint(scale * shares), 1.0), 1.02 * scale
    counts = np.asarray(np.minimum(wanted, np.where(regular, 16, 4)), np.int64)
    if sizes[regular].sum() < 0.1 * total:  # jumps first: their remaining error decides on the other pieces
        counts[sizes < 0.01 * sizes.max()] = 1
    # The largest errors first, where there may not be enough steps.
    largest = np.argsort(-sizes)
    counts[largest[np.cumsum(counts[largest] - 1) > MAX_STEPS - len(counts)]] = 1
    return counts
