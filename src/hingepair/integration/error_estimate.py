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
from collections.abc import Callable, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.evaluation.backend import How
from hingepair.integration.interpolation_error import largest_error
from hingepair.integration.methods import RULES, Quaternion, Rule, quaternion_product, turns
from hingepair.integration.signals import Constant, Function, Samples, Signal, Values
from hingepair.integration.stepping import Steps, divided

_Errors: TypeAlias = tuple[Values, Values, Values]

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
_GROUP = 1 << 14  # steps that are looked at in one go, but for those of one interval: arrays of a megabyte or two


class Probes(NamedTuple):
    """Intervals that are looked at, one of each part of the time.

    Attributes:
        t: the instants.
        intervals: those looked at, increasing.
        parts: the first interval of each part.
    """

    t: Values
    intervals: NDArray[np.intp]
    parts: NDArray[np.intp]

    def each(self, values: Values) -> Values:
        """Values of probes as those of all intervals."""
        sizes = np.diff(self.parts, append=len(self.t) - 1)
        return np.repeat(values, sizes)

    def stand_for(self, counts: NDArray[np.int64], order: int) -> Values:
        """How many times a probe's error its part's is, where errors go as length times steps' length^order."""
        if len(self.intervals) == len(self.t) - 1:
            return np.ones(len(self.intervals))
        lengths = np.diff(self.t)
        errors = lengths * (lengths / counts) ** order
        largest = errors[self.intervals]
        found: Values = np.add.reduceat(errors, self.parts) / np.where(largest > 0, largest, 1.0)
        return found

    def counts(self, own: NDArray[np.int64]) -> NDArray[np.int64]:
        """Steps of all intervals, none longer than those of the probe of its part."""
        if len(self.intervals) == len(self.t) - 1:
            return own
        lengths = np.diff(self.t)
        found = np.ceil(lengths * (1 - 8 * _U) / self.each(lengths[self.intervals] / own))
        return np.maximum(found, 1).astype(np.int64)


def probes(t: Values, signals: Sequence[Signal] = ()) -> Probes:
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
            abrupt = _most_abrupt(signal.at(t).reshape(len(t), -1), lengths)
            first[abrupt] = True
            first[abrupt[abrupt < count - 1] + 1] = True
    part = np.cumsum(first)
    last = np.flatnonzero(np.diff(part, append=part[-1] + 1))
    return Probes(t, np.lexsort((lengths, part))[last], np.flatnonzero(first))


def _most_abrupt(columns: Values, lengths: Values) -> NDArray[np.intp]:
    """The intervals over which values change least like over their neighbours, by what the integral may be off."""
    slopes = np.diff(columns, axis=0) / lengths[:, None]
    near = np.pad(slopes, ((1, 1), (0, 0)), mode="edge")
    off = _size(slopes - 0.5 * (near[:-2] + near[2:])) * lengths**2
    return np.argpartition(off, -PROBES // 8)[-PROBES // 8 :]


@np.errstate(all="ignore")
def attitude_error(omega: Signal, steps: Steps, rule: Rule, quats: Values, how: How, *, body: bool) -> float:
    """How far the attitudes are off at the worst instant [rad]; NaN where it cannot be told.

    Rounding comes to that of the steps, and of products of rotations by a radian or so. Both are random walks, but
    for an omega that never changes: then each step rounds alike.
    """
    if len(steps.t) < 2:
        return 4 * _U
    looked = probes(steps.t, (omega,))
    found, size, noise = _rounding(omega, steps, looked)
    products = 0.0 if found.alike else 4 * math.sqrt(min(size, float(steps.counts.sum())))
    rounded = _U * (8 + products) + noise
    if exact(omega, rule):
        return rounded
    chosen, weights = looked.intervals, looked.stand_for(steps.counts, rule.order)
    errors, hidden, rounding = turn_errors(omega, steps.t, chosen, steps.counts[chosen], rule, how, body=body)
    q = quats if body else quats * np.array([1, -1, -1, -1])
    if isinstance(omega, Samples):
        seen = above(_size(errors), rounding) > 0
        errors = np.where(seen[:, None], errors, 0.0) * weights[:, None]
        at_samples = q if steps.asked is None else q[steps.asked]
        # In body axes it is S^T that is turned, the other way
        return rounded + largest_error(
            omega,
            _between_samples(steps, chosen, -errors if body else errors),
            lambda first, last, vectors: _rotate(at_samples[first + 1 : last + 1], vectors),
        )
    total = np.cumsum(_rotate(q[chosen + 1], errors * weights[:, None]), axis=0)
    return rounded + _largest(_size(total), hidden, rounding, weights, looked.stand_for(steps.counts, 1))


@np.errstate(all="ignore")
def angle_error(rate: Signal, steps: Steps, rule: Rule) -> float:
    """How far an angle is off at the worst instant [rad], but for its own last bit; NaN where it cannot be told.

    A constant rate is integrated exactly.
    """
    if len(steps.t) < 2 or isinstance(rate, Constant):
        return 0.0
    looked = probes(steps.t, (rate,))
    rounded = _rounding(rate, steps, looked)[2]
    chosen, weights = looked.intervals, looked.stand_for(steps.counts, rule.order)
    errors, hidden, rounding = sum_errors(rate, steps.t, chosen, steps.counts[chosen], rule)
    if isinstance(rate, Samples):
        seen = np.where(above(errors, rounding) > 0, errors, 0.0) * weights
        return rounded + largest_error(rate, _between_samples(steps, chosen, seen))
    total = np.abs(np.cumsum(errors * weights))
    return rounded + _largest(total, hidden, rounding, weights, looked.stand_for(steps.counts, 1))


def _between_samples(steps: Steps, chosen: NDArray[np.intp], errors: Values) -> tuple[NDArray[np.intp], Values]:
    """Errors of intervals as those of the intervals between samples, of which they may be parts."""
    if steps.asked is None:
        return chosen, errors
    whole, first = np.unique(np.searchsorted(steps.asked, chosen, side="right") - 1, return_index=True)
    return whole, np.add.reduceat(errors, first, axis=0)


def _rounding(signal: Signal, steps: Steps, looked: Probes) -> tuple[Rounding, float, float]:
    """The rounding of probes; of all intervals, the integral of the size, and what rounding adds to the integral."""
    chosen = looked.intervals
    found = interval_rounding(signal, steps.t[chosen], steps.t[chosen + 1], steps.counts[chosen])
    size = float((found.size * looked.stand_for(steps.counts, 0)).sum())
    if found.alike:
        noise = _U * size
    else:
        noise = math.sqrt(float((found.noise**2 * looked.stand_for(steps.counts, 1)).sum()))
    return found, size, noise + (stamp_rounding(signal) if isinstance(signal, Samples) else 0.0)


def _largest(total: Values, hidden: Values, noise: Values, weights: Values, squares: Values) -> float:
    """The largest sum of errors over the probes, less what rounding makes of it, or what may be hidden in all.

    Of the rounding, for want of the other intervals where it would average out; of what is hidden, as chance has it.
    """
    enlarged = 2 * _SURE * float(np.sqrt((noise**2 * (weights**2 - weights)).sum()))
    apart = float(total.max())
    return float(np.maximum(0.0 if apart <= enlarged else apart, np.sqrt((hidden**2 * squares).sum())))


def _few_at_a_time(errors: Callable[..., _Errors]) -> Callable[..., _Errors]:
    """The same errors, of so many intervals at a time that the values at their nodes stay in the caches."""

    @functools.wraps(errors)
    def each(
        signal: Signal, t: Values, chosen: NDArray[np.intp], counts: NDArray[np.int64], *rest: Any, **how: Any
    ) -> _Errors:
        cuts = np.flatnonzero(np.diff(np.cumsum(counts) // _GROUP)) + 1
        groups = zip(np.split(chosen, cuts), np.split(counts, cuts), strict=True)
        apart, hidden, noise = zip(*(errors(signal, t, *group, *rest, **how) for group in groups), strict=True)
        return np.concatenate(apart), np.concatenate(hidden), np.concatenate(noise)

    return each


@_few_at_a_time
def turn_errors(
    omega: Signal,
    t: Values,
    chosen: NDArray[np.intp],
    counts: NDArray[np.int64],
    rule: Rule,
    how: How,
    *,
    body: bool,
) -> _Errors:
    """Errors of some intervals in so many steps.

    Returns:
        As rotation vectors (P, 3), the size of what these may not show (P,), and what rounding explains (P,).
    """
    ends, finer = (t[chosen], t[chosen + 1]), _finer(t, chosen, counts)
    coarse, fine = _looks(omega, *ends, counts, rule), _looks(omega, *ends, finer * counts, rule)
    apart = _apart(*(_turns(looks, rule, how, body=body) for looks in (coarse, fine))) * _whole(finer, rule)[:, None]
    rounding = interval_rounding(omega, *ends, counts)
    products = np.minimum(rounding.size, 4 * np.sqrt(np.minimum(rounding.size, finer * counts)))
    noise = rounding.noise + _U * products
    return apart, above(_hidden(omega, *ends, coarse, fine, rule), 4 * noise), noise


@_few_at_a_time
def sum_errors(psid: Signal, t: Values, chosen: NDArray[np.intp], counts: NDArray[np.int64], rule: Rule) -> _Errors:
    """The same of the integrals over some intervals; each of shape (P,)."""
    ends, finer = (t[chosen], t[chosen + 1]), _finer(t, chosen, counts)
    coarse, fine = _looks(psid, *ends, counts, rule), _looks(psid, *ends, finer * counts, rule)
    whole = _sums(fine, rule)
    noise = interval_rounding(psid, *ends, counts).noise + _U * np.abs(whole)
    return (
        (_sums(coarse, rule) - whole) * _whole(finer, rule),
        above(_hidden(psid, *ends, coarse, fine, rule), 4 * noise),
        noise,
    )


def sizes(found: _Errors) -> Values:
    """How large the errors of intervals are, of those functions, where rounding does not explain them."""
    errors, hidden, noise = found
    return np.maximum(above(_size(errors.reshape(len(errors), -1)), noise), hidden)


def spread(t: Values, chosen: NDArray[np.intp], steps: int) -> NDArray[np.int64]:
    """Of so many steps over the whole time, spread evenly, those within some intervals; one at least."""
    parts = np.ceil((t[chosen + 1] - t[chosen]) * (steps / (t[-1] - t[0])))
    found: NDArray[np.int64] = np.clip(np.nan_to_num(parts, nan=1.0), 1, steps).astype(np.int64)
    return found


def _finer(t: Values, chosen: NDArray[np.intp], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """By how much the steps are made shorter to see what they miss: twice, or a multiple as `LOOKS` asks for."""
    pairs: NDArray[np.int64] = -(-spread(t, chosen, LOOKS) // (2 * counts))
    return 2 * np.maximum(pairs, 1)


def _whole(finer: NDArray[np.int64], rule: Rule) -> Values:
    """The error as a multiple of the difference from what finer steps find."""
    gain: Values = finer.astype(float) ** rule.order
    return gain / (gain - 1)


def exact(omega: Signal, rule: Rule) -> bool:
    """Whether steps have no truncation: rotations about one axis, but for Runge and Kutta's."""
    return isinstance(omega, Constant) and rule is not RULES["rk4_quaternion"]


def above(errors: Values, noise: Values) -> Values:
    """The sizes of errors that rounding does not explain, else zero."""
    size = np.abs(errors)
    return np.where(size <= _SURE * noise, 0.0, size)


class _Looks(NamedTuple):
    """A signal at the nodes of the steps of some intervals, each in its number of steps."""

    counts: NDArray[np.int64]
    h: Values
    part: NDArray[np.intp]
    values: Values


def _looks(signal: Signal, start: Values, stop: Values, counts: NDArray[np.int64], rule: Rule) -> _Looks:
    begin, (h, _), part = divided(start, stop, counts)
    return _Looks(counts, h, part, signal.nodes(begin, h, rule.nodes))


def _turns(looks: _Looks, rule: Rule, how: How, *, body: bool) -> Any:
    """The rotations over intervals: neighbours are multiplied until one is left."""
    part = looks.part
    rows = np.empty((len(looks.h), 4))
    given = {"omega": looks.values, "h": -looks.h if body else looks.h}
    turns(rule).run(given, {"q": rows}, looks.h.shape, rows.dtype, how)
    q = rows.T.copy()
    while len(part) > len(looks.counts):
        even = np.flatnonzero(part % 2 == 0)
        later = np.minimum(even + 1, len(part) - 1)
        paired = part[later] == part[even] + 1
        rest, last = even[paired], later[paired]
        q[:, rest] = quaternion_product(_four(q[:, last]), _four(q[:, rest]))
        q, part = q[:, even], part[even] // 2
    return _four(q)


def _sums(looks: _Looks, rule: Rule) -> Values:
    """The integrals over intervals."""
    return np.add.reduceat(_each(looks, rule)[:, 0], np.cumsum(looks.counts) - looks.counts)


def _each(looks: _Looks, rule: Rule) -> Values:
    """The integrals over steps, by columns."""
    values = looks.values.reshape(len(looks.h), len(rule.nodes), -1)
    found: Values = looks.h[:, None] * np.einsum("n,snk->sk", np.array(rule.weights) / sum(rule.weights), values)
    return found


def _hidden(signal: Signal, start: Values, stop: Values, coarse: _Looks, fine: _Looks, rule: Rule) -> Values:
    """What a jump or a kink may come to that two quadratures do not show, since they agree by chance.

    Where a callable jumps between two nodes of a pair of steps, the integral may be off by as much as it jumps times
    the distance of the nodes; of what is smooth, divided differences over so many nodes leave less than the rule.
    """
    if not isinstance(signal, Function) or rule.nodes[0] == 0:
        return np.zeros(len(start))
    begin, (h, _), _ = divided(start, stop, fine.counts // 2)
    inside = fine.values.reshape(len(h), 2 * len(rule.nodes), -1)
    ends = signal.nodes(begin, h, (_EDGE, 1 - _EDGE)).reshape(len(h), 2, -1)
    values = np.concatenate([ends[:, :1], inside, ends[:, 1:]], axis=1).transpose(1, 0, 2)
    columns = values.reshape(len(values), -1)
    seen = [_size((rows @ columns).reshape(-1, *values.shape[1:])).max(axis=0) for rows in _jump_weights(rule)]
    largest: Values = h * np.minimum(*seen)
    finer = np.repeat(fine.counts // coarse.counts, coarse.counts)
    of_steps, of_pairs = np.cumsum(finer) - finer, np.cumsum(finer // 2) - finer // 2
    squares = np.add.reduceat(largest**2, of_pairs)
    shown = _size(_each(coarse, rule) - np.add.reduceat(_each(fine, rule), of_steps))
    squares = np.where(squares > (_SURE * shown) ** 2, squares, 0.0)
    return np.sqrt(np.add.reduceat(squares, np.cumsum(coarse.counts) - coarse.counts))


@functools.cache
def _jump_weights(rule: Rule) -> tuple[Values, Values]:
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
    """Of each interval.

    Attributes:
        size: the integral of the rate's size, shape (P,).
        noise: standard deviation of what rounding adds to the integral, shape (P,).
        alike: whether all steps of all intervals have the same rate, and so are rounded alike.
    """

    size: Values
    noise: Values
    alike: bool


def interval_rounding(signal: Signal, start: Values, stop: Values, counts: NDArray[np.int64]) -> Rounding:
    """The rounding of intervals, each in its number of steps."""
    if isinstance(signal, Constant):
        size = (stop - start) * float(_size(signal.value.reshape(-1)))
        return Rounding(size, _U * size, alike=True)
    begin, (h, _), _ = divided(start, stop, counts)
    rates = signal.nodes(begin, h, _OUTER).reshape(len(h), 2, -1)
    turned = 0.5 * h * (_size(rates[:, 0]) + _size(rates[:, 1]))
    moved = 0.0 if isinstance(signal, Samples) else _NODES * np.abs(begin + h) * _size(rates[:, 1] - rates[:, 0])
    first = np.cumsum(counts) - counts
    size = np.add.reduceat(turned, first)
    if (rates == rates[0, 0]).all():
        return Rounding(size, _U * size, alike=True)
    return Rounding(size, _U * np.sqrt(np.add.reduceat(turned**2 + moved**2, first)), alike=False)


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


def _stamps_are_rounded(t: Values, columns: Values, sigma: Values) -> bool:
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


def _size(rows: Values) -> Values:
    size: Values = np.sqrt((rows**2).sum(axis=-1))
    return size


def _four(rows: Values) -> Quaternion:
    return rows[0], rows[1], rows[2], rows[3]


def _apart(coarse: Any, fine: Any) -> Values:
    """The rotation from the finer to the coarser result, as vectors (P, 3)."""
    w, x, y, z = quaternion_product(coarse, (fine[0], -fine[1], -fine[2], -fine[3]))
    length = np.sqrt(x * x + y * y + z * z)
    factor = np.where(length > 0, 2 * np.arctan2(length, np.abs(w)) / np.where(length > 0, length, 1.0), 2.0)
    found: Values = np.stack([x, y, z], axis=-1) * (factor * np.copysign(1.0, w))[:, None]
    return found


def _rotate(quats: Values, vectors: Values) -> Values:
    """Vectors turned by quaternions."""
    w, axis = quats[:, :1], quats[:, 1:]
    twice = 2 * np.cross(axis, vectors)
    return vectors + w * twice + np.cross(axis, twice)
