"""How far the steps are from the truth (E12): by steps of half the length, or shorter ones, on probes.

The errors of the intervals, turned back to the first instant, add up to the error at any later one. They are measured
on all intervals, or on PROBES of them: the longest of each part of the time, which stands for the part, and those
over which a callable changes most abruptly, since it may jump there. Two quadratures may agree by chance on a jump
near the end of a step; divided differences of all nodes and of two looks beside the ends do not. Of samples it is the
interpolant that is integrated so; what this misses is added (`interpolation_error`).

Rounding: a step that turns by an angle a is rounded by about u a. Its nodes are rounded by about u t where a callable
is given, which adds u t times the change of the rate over the step. Each step is rounded in its own way, so that the
squares add up: over many steps this is far less than u times all that is turned, over few fast ones about that. The
stamps of samples may be rounded too: u times 1.7e9 s is 1e-7 s. Values that belong to the stamps as they are lie on a
smooth curve over them; over rounded stamps they are as rough as their slope times that.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.integration.integrals import Angle, Integral
from hingepair.integration.interpolation_error import largest_error
from hingepair.integration.methods import RULES, Rule
from hingepair.integration.signals import Constant, Function, Samples, Signal
from hingepair.integration.stepping import Division, Steps, divided
from hingepair.numeric.arrays import Float64Array as Array

PROBES: Final = 2048

LOOKS: Final = 509
"""Steps over the whole time that a callable is looked at in, at least, to see what longer ones miss.

What is narrower than one of these, and than half a step, may lie between their nodes and be missed.
"""

_U = 2.0**-53
_NODES = 0.4  # measured; a step's outer nodes are rounded in opposite senses, the middle one counts 4/9
_WINDOW = 11  # samples whose highest divided difference tells roughness; of a smooth motion it is as good as none
_WINDOWS = 2048
_ROUGH = 0.02  # of the roughness that rounded stamps make, in the mean of squares: they go like a saw, of few teeth
_OUTER = RULES["magnus6"].nodes[0], RULES["magnus6"].nodes[-1]
_SURE = 2.0  # times the noise of rounding: what is larger has another cause
_EDGE = 1e-4  # of a step: how near to its ends a callable is looked at, since it may jump at the instants themselves
_GROUP = 1 << 12  # intervals that are looked at in one go: arrays of a megabyte or two


class Probes(NamedTuple):
    """Intervals that are looked at, one of each part of the time."""

    t: Array  # the instants
    intervals: NDArray[np.intp]  # those looked at, increasing
    parts: NDArray[np.intp]  # the first interval of each part

    @property
    def ends(self) -> tuple[Array, Array]:
        """When those looked at begin and end."""
        return self.t[self.intervals], self.t[self.intervals + 1]

    def each(self, values: Array) -> Array:
        """Values of probes as those of all intervals."""
        return np.repeat(values, np.diff(self.parts, append=len(self.t) - 1))

    def stand_for(self, order: int) -> Array:
        """How many times a probe's error its part's is, where steps' errors go as length^(order + 1)."""
        if len(self.intervals) == len(self.t) - 1:
            return np.ones(len(self.intervals))
        errors = np.diff(self.t) ** (order + 1)
        largest = errors[self.intervals]
        found: Array = np.add.reduceat(errors, self.parts) / np.where(largest > 0, largest, 1.0)
        return found


def probes(t: Array, signals: Sequence[Signal] = ()) -> Probes:
    """All intervals if they are few; else the longest of each part.

    Parts are alike in time and number of intervals; those over which a callable changes most abruptly, so that it
    may jump there, are parts of their own.
    """
    count = len(t) - 1
    every = np.arange(count)
    if count <= PROBES:
        return Probes(t, every, every)
    lengths = np.diff(t)
    place = np.floor(0.5 * PROBES * (every / count + (t[:-1] - t[0]) / (t[-1] - t[0])))
    first = np.diff(place, prepend=-1) > 0
    for signal in signals:
        if isinstance(signal, Function):
            abrupt = _most_abrupt(signal.instants(t).reshape(len(t), -1), lengths)
            first[abrupt] = True
            first[abrupt[abrupt < count - 1] + 1] = True
    part = np.cumsum(first)
    last = np.flatnonzero(np.diff(part, append=part[-1] + 1))
    return Probes(t, np.lexsort((lengths, part))[last], np.flatnonzero(first))


def _most_abrupt(columns: Array, lengths: Array) -> NDArray[np.intp]:
    """The intervals over which values change least like over their neighbours, by what the integral may be off."""
    slopes = np.diff(columns, axis=0) / lengths[:, None]
    near = np.pad(slopes, ((1, 1), (0, 0)), mode="edge")
    off = _size(slopes - 0.5 * (near[:-2] + near[2:])) * lengths**2
    return np.argpartition(off, -PROBES // 8)[-PROBES // 8 :]


@np.errstate(all="ignore")
def estimated_error(integral: Integral, steps: Steps, values: Array) -> float:
    """How far what steps came to is off at the worst instant [rad]; NaN where it cannot be told."""
    rate, rule = integral.rate, integral.rule
    if not steps.made or (isinstance(integral, Angle) and integral.exact):
        return integral.rounded_on_the_way(values, 0.0)
    looked = probes(steps.t, (rate,))
    rounding = interval_rounding(rate, *looked.ends)
    size = float((rounding.size * looked.stand_for(0)).sum())
    noise = _U * size if rounding.alike else math.sqrt(float((rounding.noise**2 * looked.stand_for(1)).sum()))
    noise += stamp_rounding(rate) if isinstance(rate, Samples) else 0.0
    rounded = noise + integral.rounded_on_the_way(values, 0.0 if rounding.alike else size)
    if integral.exact:
        return rounded
    found = step_errors(integral, *looked.ends, steps.t[-1] - steps.t[0])
    weights = looked.stand_for(rule.order)
    if isinstance(rate, Samples):
        seen = np.where(above(_size(found.errors), found.noise) > 0, weights, 0.0)[:, None] * found.errors
        at_samples = steps.asked(values)
        between = _between_samples(steps, looked.intervals, seen)
        missed = largest_error(rate, between, lambda a, b, e: integral.added_up(at_samples[a + 1 : b + 1], e))
        return rounded + missed
    # Less what rounding makes of probes, for want of the other intervals where it would average out; or what may be
    # hidden in all, as chance has it.
    total = np.cumsum(integral.added_up(values[looked.intervals + 1], found.errors * weights[:, None]), axis=0)
    enlarged = 2 * _SURE * float(np.sqrt((found.noise**2 * (weights**2 - weights)).sum()))
    apart = float(_size(total).max())
    hidden = np.sqrt((found.hidden**2 * looked.stand_for(1)).sum())
    return rounded + float(np.maximum(0.0 if apart <= enlarged else apart, hidden))


def _between_samples(steps: Steps, chosen: NDArray[np.intp], errors: Array) -> tuple[NDArray[np.intp], Array]:
    """Errors of steps as those of the intervals between samples, of which they may be parts."""
    if steps.own is None:
        return chosen, errors
    whole, first = np.unique(np.searchsorted(steps.own, chosen, side="right") - 1, return_index=True)
    return whole, np.add.reduceat(errors, first, axis=0)


class StepErrors(NamedTuple):
    """Of steps over intervals."""

    errors: Array  # vectors, shape (P, 3) or (P, 1)
    hidden: Array  # the size of what these may not show, shape (P,)
    noise: Array  # what rounding explains, shape (P,)

    @property
    def sizes(self) -> Array:
        """How large they are where rounding does not explain them."""
        return np.maximum(above(_size(self.errors), self.noise), self.hidden)


def step_errors(integral: Integral, start: Array, stop: Array, whole: float) -> StepErrors:
    """Errors of steps over intervals, by steps of half the length, or as short as `LOOKS` over the whole time are."""
    few = (slice(first, first + _GROUP) for first in range(0, len(start), _GROUP))
    found = zip(*(_few_errors(integral, start[own], stop[own], whole) for own in few), strict=True)
    return StepErrors(*map(np.concatenate, found))


def _few_errors(integral: Integral, start: Array, stop: Array, whole: float) -> StepErrors:
    rate, rule = integral.rate, integral.rule
    one = divided(start, stop, np.ones(len(start), np.int64))
    many = divided(start, stop, 2 * np.maximum(-(-spread(stop - start, whole, LOOKS) // 2), 1))
    nodes = rate.nodes(one.start, one.h, rule.nodes), rate.nodes(many.start, many.h, rule.nodes)
    gain = many.counts.astype(float) ** rule.order  # of the error: what finer steps find is not all of it
    errors = integral.apart(one, many, nodes) * (gain / (gain - 1))[:, None]
    rounding = interval_rounding(rate, start, stop)
    noise = rounding.noise + integral.rounded(rounding.size, many.counts.astype(float))
    return StepErrors(errors, above(_hidden(rate, one, many, nodes, rule), 4 * noise), noise)


def spread(lengths: Array, whole: float, steps: int) -> NDArray[np.int64]:
    """Of so many steps over the whole time, spread evenly, those within intervals; one at least."""
    found: NDArray[np.int64] = np.clip(np.nan_to_num(np.ceil(lengths * (steps / whole)), nan=1.0), 1, steps)
    return found.astype(np.int64)


def above(errors: Array, noise: Array) -> Array:
    """The sizes of errors that rounding does not explain, else zero."""
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
    seen = [_size((rows @ columns).reshape(-1, *values.shape[1:])).max(axis=0) for rows in _jump_weights(rule)]
    squares = pairs.added((pairs.h * np.minimum(*seen)) ** 2)
    shown = _size(rule.integral(nodes[0], one.h) - many.added(rule.integral(nodes[1], many.h)))
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
    """Of steps over intervals."""

    size: Array  # the integral of the rate's size, shape (P,)
    noise: Array  # standard deviation of what rounding adds to the integral, shape (P,)
    alike: bool  # whether all have the same rate, and so are rounded alike


def interval_rounding(signal: Signal, start: Array, stop: Array) -> Rounding:
    """The rounding of steps over intervals."""
    h = stop - start
    if isinstance(signal, Constant):
        size = h * float(_size(signal.value.reshape(-1)))
        return Rounding(size, _U * size, alike=True)
    rates = signal.nodes(start, h, _OUTER).reshape(len(h), 2, -1)
    size = 0.5 * h * (_size(rates[:, 0]) + _size(rates[:, 1]))
    moved = 0.0 if isinstance(signal, Samples) else _NODES * np.abs(stop) * _size(rates[:, 1] - rates[:, 0])
    return Rounding(size, _U * np.sqrt(size**2 + moved**2), alike=bool((rates == rates[0, 0]).all()))


def stamp_rounding(samples: Samples) -> float:
    """What the rounding of the stamps adds to an integral over samples; 0 where values show that none took place.

    At an instant that is off by some time the integral is off by the rate times that, and a random walk of the
    changes of the rate times that comes to it on the way there.
    """
    t, columns = samples.t, samples.values.reshape(len(samples.t), -1)
    sigma = np.spacing(np.abs(t)) / math.sqrt(12)
    h, slopes = np.diff(t), _size(np.diff(columns, axis=0)) / np.diff(t)
    if not _stamps_are_rounded(t, columns, sigma):
        return 0.0
    walk = math.sqrt(float(((slopes * h * sigma[1:]) ** 2).sum()))
    return 2 * float((_size(columns) * sigma).max()) + walk


def _stamps_are_rounded(t: Array, columns: Array, sigma: Array) -> bool:
    if len(t) < _WINDOW + 1:
        return True
    first = np.unique(np.linspace(0, len(t) - _WINDOW, _WINDOWS).astype(np.intp))
    near = first[:, None] + np.arange(_WINDOW)
    x = (t[near] - t[first, None]) / (t[first + _WINDOW - 1] - t[first])[:, None]
    apart = x[:, :, None] - x[:, None, :] + np.eye(_WINDOW)
    weights = 1 / apart.prod(axis=2)
    rough = _size(np.einsum("wi,wik->wk", weights, columns[near]))
    slopes = _size(np.gradient(columns, t, axis=0))[near]
    expected = ((weights * slopes * sigma[near]) ** 2).sum(axis=1)
    return bool((rough**2).sum() > _ROUGH**2 * expected.sum())


def _size(rows: Array) -> Array:
    return np.asarray(np.sqrt((rows**2).sum(axis=-1)))
