"""How far the steps are from the truth, and how many there must be (E12): by steps of half the length, on probes.

The errors of the intervals, turned back to the first instant, add up to the error at any later one. They are measured
on all intervals, or on PROBES of them, spread evenly and shifted each within its part, which stand for the others.
Samples cannot be had at half the step; there every second one is left out, which makes an error 2^order as large.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair import increments as inc
from hingepair.attitude_steps import RULES, Rule, Steps, divided, increment_quaternions
from hingepair.interval_rounding import interval_rounding
from hingepair.signals import POINTS, Constant, Function, Samples, Signal, Values

PROBES: Final = 2048
MOST_STEPS: Final = 2_000_000
"""That a tolerance may ask for; where they are not enough, `integrate` says how far they got."""

FEWEST: Final = 16
"""Steps over the whole time that a tolerance begins with."""

LOOKS: Final = 509
"""Steps over the whole time that a callable is looked at in, at least, to see what longer ones miss."""

_U = 2.0**-53
_FINEST = 1e-15  # rad: below, rounding is all that is left
_ROUNDS = 16
_COARSE = 1e-3  # rad: errors of intervals from here on do not follow the order of the rule
_GROWTH = 4.0
_HUGE = 1e30  # rad, or steps; anything larger is as bad
_SUM_SURE = 4.0
_SURE = 2.0  # times the noise of rounding: what is larger has another cause
_GOLDEN = 0.6180339887498949


class Probes(NamedTuple):
    """Intervals that are looked at, and how many intervals each stands for."""

    intervals: NDArray[np.intp]
    weights: Values


def probes(t: Values) -> Probes:
    """All intervals if they are few; else one of each part, and where lengths differ the longest, for themselves."""
    count = len(t) - 1
    if count <= PROBES:
        return Probes(np.arange(count), np.ones(count))
    edges = np.linspace(0, count, PROBES + 1)
    shift = (np.arange(PROBES) * _GOLDEN) % 1.0
    chosen = np.minimum((edges[:-1] + shift * np.diff(edges)).astype(np.intp), count - 1)
    weights = np.full(PROBES, count / PROBES)
    lengths = np.abs(np.diff(t))
    if lengths.max() > 1.5 * lengths.mean():
        longest = np.argpartition(lengths, -PROBES // 8)[-PROBES // 8 :]
        chosen, weights = (
            np.concatenate([longest, chosen]),
            np.concatenate([np.ones(len(longest)), weights]),
        )
        chosen, first = np.unique(chosen, return_index=True)
        weights = weights[first]
    return Probes(chosen, weights)


@np.errstate(all="ignore")
def attitude_rounding(omega: Signal, steps: Steps) -> float:
    """What rounding adds to the attitude [rad]: that of the steps, and of products of rotations by a radian or so.

    Both are random walks, but for an omega that never changes: then each step rounds alike.
    """
    if len(steps.t) < 2:
        return 4 * _U
    chosen, weights = probes(steps.t)
    found = interval_rounding(omega, steps.t[chosen], steps.t[chosen + 1], steps.counts[chosen])
    products = min(float((found.size * weights).sum()), float(steps.counts.sum()))
    return _U * 8 + found.added(weights) + (0.0 if found.alike else _U * 4 * math.sqrt(products))


@np.errstate(all="ignore")
def angle_rounding(rate: Signal, steps: Steps) -> float:
    """What rounding adds to an angle [rad], beside its own last bit; a constant rate is integrated exactly."""
    if len(steps.t) < 2 or isinstance(rate, Constant):
        return 0.0
    chosen, weights = probes(steps.t)
    return interval_rounding(rate, steps.t[chosen], steps.t[chosen + 1], steps.counts[chosen]).added(weights)


@np.errstate(all="ignore")
def attitude_error(omega: Signal, steps: Steps, rule: Rule, quats: Values, *, body: bool) -> float:
    """How far the attitudes are off at the worst instant, by truncation [rad]; NaN where it cannot be told."""
    if len(steps.t) < 2 or _exact(omega, rule):
        return 0.0
    noise = 0.0
    if isinstance(omega, Samples):
        errors, ends, weights = _thinned_turns(omega, rule, body=body)
    else:
        chosen, weights = probes(steps.t)
        errors, rounding = turn_errors(omega, steps.t, chosen, steps.counts[chosen], rule, body=body)
        noise, ends = _enlarged(rounding, weights), chosen + 1
    if not len(ends):
        return math.nan
    q = quats[ends] * np.array([1, -1, -1, -1]) if not body else quats[ends]
    total = np.cumsum(_rotate(q, errors) * weights[:, None], axis=0)
    return min(_unless(float(np.sqrt((total**2).sum(axis=1)).max()), noise), math.pi)


@np.errstate(all="ignore")
def angle_error(psid: Signal, steps: Steps, rule: Rule) -> float:
    """How far psi is off at the worst instant, by truncation [rad]; NaN where it cannot be told."""
    if len(steps.t) < 2 or isinstance(psid, Constant):
        return 0.0
    noise = 0.0
    if isinstance(psid, Samples):
        errors, weights = _thinned_sums(psid, rule)
    else:
        chosen, weights = probes(steps.t)
        errors, rounding = sum_errors(psid, steps.t, chosen, steps.counts[chosen], rule)
        noise = _enlarged(rounding, weights)
    return _unless(float(np.abs(np.cumsum(errors * weights)).max()), noise) if len(errors) else math.nan


@np.errstate(all="ignore")
def substeps(
    omega: Signal | None, rates: Sequence[Signal], t: Values, rule: Rule, tol: float | None, *, body: bool = False
) -> NDArray[np.int64]:
    """Steps for each interval that keep the error of attitude and angles below tol, where signals are not samples.

    With an error e of an interval in one step, m steps make it e / m^order; the least number of steps in all for a
    sum of errors has m in proportion to e^(1/(order + 1)).
    """
    ones = np.ones(max(0, len(t) - 1), np.int64)
    turning = omega is not None and not isinstance(omega, Samples) and not _exact(omega, rule)
    rates = [rate for rate in rates if isinstance(rate, Function)]
    if tol is None or len(t) < 2 or not (turning or rates):
        return ones
    goal = 0.4 * max(tol, _FINEST)
    chosen, weights = probes(t)
    counts = _spread(t, chosen, FEWEST)
    for _ in range(_ROUNDS):
        errors = np.zeros(len(chosen))
        if omega is not None and turning:
            found, noise = turn_errors(omega, t, chosen, counts, rule, body=body)
            errors = _above(np.sqrt((found**2).sum(axis=1)), noise)
        for rate in rates:
            errors = np.maximum(errors, _above(*sum_errors(rate, t, chosen, counts, rule)))
        total = (errors * weights).sum()
        if total <= 1.2 * goal or np.isnan(total):
            break
        asked = np.maximum(counts, _asked(np.minimum(errors, _HUGE), weights, counts, goal, rule.order))
        room = MOST_STEPS / (asked * weights).sum()
        counts = np.maximum(counts, np.ceil(asked * min(room, 1.0)).astype(np.int64))
        if room < 1:
            break
    if len(chosen) == len(ones):
        return counts
    after = np.searchsorted(chosen, np.arange(len(ones)))
    return np.maximum(counts[np.minimum(after, len(chosen) - 1)], counts[np.maximum(after - 1, 0)])


def _asked(errors: Values, weights: Values, counts: NDArray[np.int64], goal: float, order: int) -> Values:
    """The steps of intervals that make their errors as large as the goal, in all.

    Errors that large steps make are of no order yet; then more than a few times as many are not asked for at once.
    """
    shares: Values = (errors * counts.astype(float) ** order) ** (1 / (order + 1))
    asked: Values = ((shares * weights).sum() / goal) ** (1 / order) * shares
    return np.minimum(asked, np.where(errors > _COARSE, _GROWTH * counts, _HUGE))


def turn_errors(
    omega: Signal, t: Values, chosen: NDArray[np.intp], counts: NDArray[np.int64], rule: Rule, *, body: bool
) -> tuple[Values, Values]:
    """Errors of some intervals in so many steps, as rotation vectors (P, 3), and how far rounding explains them."""
    ends, finer = (t[chosen], t[chosen + 1]), _finer(t, chosen, counts)
    coarse = _turns(omega, *ends, counts, rule, body=body)
    fine = _turns(omega, *ends, finer * counts, rule, body=body)
    rounding = interval_rounding(omega, *ends, counts)
    products = np.minimum(rounding.size, 4 * np.sqrt(np.minimum(rounding.size, finer * counts)))
    return _apart(coarse, fine) * _whole(finer, rule)[:, None], rounding.noise + _U * products


def sum_errors(
    psid: Signal, t: Values, chosen: NDArray[np.intp], counts: NDArray[np.int64], rule: Rule
) -> tuple[Values, Values]:
    """Errors of the integrals over some intervals in so many steps, shape (P,), and how far rounding explains them."""
    ends, finer = (t[chosen], t[chosen + 1]), _finer(t, chosen, counts)
    coarse, fine = _sums(psid, *ends, counts, rule), _sums(psid, *ends, finer * counts, rule)
    rounding = interval_rounding(psid, *ends, counts)
    return (coarse - fine) * _whole(finer, rule), rounding.noise + _U * np.abs(fine)


def _spread(t: Values, chosen: NDArray[np.intp], steps: int) -> NDArray[np.int64]:
    """Of so many steps over the whole time, spread evenly, those within some intervals; one at least."""
    parts: NDArray[np.int64] = np.ceil((t[chosen + 1] - t[chosen]) * (steps / (t[-1] - t[0]))).astype(np.int64)
    return np.maximum(parts, 1)


def _finer(t: Values, chosen: NDArray[np.intp], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """By how much the steps are made shorter to see what they miss: twice, or as `LOOKS` asks for."""
    return np.maximum(2, -(-_spread(t, chosen, LOOKS) // counts))


def _whole(finer: NDArray[np.int64], rule: Rule) -> Values:
    """The error as a multiple of the difference from what finer steps find."""
    gain = finer.astype(float) ** rule.order
    return gain / (gain - 1)


def _exact(omega: Signal, rule: Rule) -> bool:
    """Whether steps have no truncation: rotations about one axis, but for Runge and Kutta's."""
    return isinstance(omega, Constant) and rule is not RULES["rk4_quaternion"]


def _unless(error: float, noise: float) -> float:
    return 0.0 if error <= noise else error


def _above(errors: Values, noise: Values) -> Values:
    """The sizes of errors that rounding does not explain, else zero."""
    size = np.abs(errors)
    return np.where(size <= _SURE * noise, 0.0, size)


def _enlarged(noise: Values, weights: Values) -> float:
    """What rounding makes of a sum over probes, for want of the other intervals, where it would average out."""
    return 2 * _SURE * float(np.sqrt((noise**2 * (weights**2 - weights)).sum()))


def _turns(omega: Signal, start: Values, stop: Values, counts: NDArray[np.int64], rule: Rule, *, body: bool) -> Any:
    """The rotations over intervals, each in its number of steps: neighbours are multiplied until one is left."""
    begin, (h, _), part = divided(start, stop, counts)
    q = np.stack(increment_quaternions(omega.nodes(begin, h, rule.nodes), -h if body else h, rule.number))
    while len(part) > len(counts):
        even = np.flatnonzero(part % 2 == 0)
        later = np.minimum(even + 1, len(part) - 1)
        paired = part[later] == part[even] + 1
        rest, last = even[paired], later[paired]
        q[:, rest] = inc.quaternion_product(_four(q[:, last]), _four(q[:, rest]))
        q, part = q[:, even], part[even] // 2
    return _four(q)


def _sums(psid: Signal, start: Values, stop: Values, counts: NDArray[np.int64], rule: Rule) -> Values:
    """The integrals over intervals, each in its number of steps."""
    begin, (h, _), _ = divided(start, stop, counts)
    each: Values = h * (psid.nodes(begin, h, rule.nodes) @ _quadrature(rule))
    return np.add.reduceat(each, np.cumsum(counts) - counts)


def _four(rows: Values) -> inc.Quaternion:
    return rows[0], rows[1], rows[2], rows[3]


def _quadrature(rule: Rule) -> Values:
    weights = {1: [1.0], 2: [0.5, 0.5], 3: [5 / 18, 8 / 18, 5 / 18] if rule.order == 6 else [1 / 6, 4 / 6, 1 / 6]}
    return np.array(weights[len(rule.nodes)])


def _thinned_turns(omega: Samples, rule: Rule, *, body: bool) -> tuple[Values, NDArray[np.intp], Values]:
    """Errors of pairs of intervals, the instants they end at, and how many pairs each stands for."""
    half, pairs, weights = _pairs(omega)
    if not len(pairs):
        return np.empty((0, 3)), pairs, weights
    t, one = omega.t, np.ones(len(pairs), np.int64)
    first = _turns(omega, t[pairs], t[pairs + 1], one, rule, body=body)
    second = _turns(omega, t[pairs + 1], t[pairs + 2], one, rule, body=body)
    coarse = _turns(half, t[pairs], t[pairs + 2], one, rule, body=body)
    fine: Any = inc.quaternion_product(second, first)
    return _apart(coarse, fine) / _gain(half, rule), pairs + 2, weights


def _thinned_sums(psid: Samples, rule: Rule) -> tuple[Values, Values]:
    half, pairs, weights = _pairs(psid)
    if not len(pairs):
        return np.empty(0), weights
    t, one = psid.t, np.ones(len(pairs), np.int64)
    fine = _sums(psid, t[pairs], t[pairs + 1], one, rule) + _sums(psid, t[pairs + 1], t[pairs + 2], one, rule)
    return (_sums(half, t[pairs], t[pairs + 2], one, rule) - fine) / _gain(half, rule), weights


def _pairs(signal: Samples) -> tuple[Samples, NDArray[np.intp], Values]:
    """Every second sample, and pairs of intervals that start at one."""
    half = signal.thinned()
    if len(half.t) < 2:
        return half, np.empty(0, np.intp), np.empty(0)
    chosen, weights = probes(half.t)
    return half, 2 * chosen, weights


def _gain(half: Samples, rule: Rule) -> float:
    return float(2 ** min(rule.order, half.count, POINTS) - 1)


def _apart(coarse: Any, fine: Any) -> Values:
    """The rotation from the finer to the coarser result, as vectors (P, 3)."""
    w, x, y, z = inc.quaternion_product(coarse, (fine[0], -fine[1], -fine[2], -fine[3]))
    length = np.sqrt(x * x + y * y + z * z)
    factor = np.where(length > 0, 2 * np.arctan2(length, np.abs(w)) / np.where(length > 0, length, 1.0), 2.0)
    found: Values = np.stack([x, y, z], axis=-1) * (factor * np.copysign(1.0, w))[:, None]
    return found


def _rotate(quats: Values, vectors: Values) -> Values:
    """Vectors turned by quaternions."""
    w, axis = quats[:, :1], quats[:, 1:]
    twice = 2 * np.cross(axis, vectors)
    return vectors + w * twice + np.cross(axis, twice)
