"""How far the steps are from the truth (E12): by steps of half the length, or shorter ones, on probes.

The errors of the intervals, turned back to the first instant, add up to the error at any later one. They are measured
on all intervals, or on PROBES of them, spread evenly and shifted each within its part, which stand for the others.
Of samples it is the interpolant that is integrated so; what this misses is added (`interpolation_error`).
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.integration import increments as inc
from hingepair.integration.attitude_steps import RULES, Rule, Steps, divided, increment_quaternions
from hingepair.integration.interpolation_error import largest_error
from hingepair.integration.interval_rounding import interval_rounding
from hingepair.integration.signals import Constant, Samples, Signal, Values

PROBES: Final = 2048

LOOKS: Final = 509
"""Steps over the whole time that a callable is looked at in, at least, to see what longer ones miss.

What is narrower than one of these, and than half a step, may lie between their nodes and be missed.
"""

_U = 2.0**-53
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
    if len(steps.t) < 2 or exact(omega, rule):
        return 0.0
    chosen, weights = probes(steps.t)
    errors, rounding = turn_errors(omega, steps.t, chosen, steps.counts[chosen], rule, body=body)
    q = quats if body else quats * np.array([1, -1, -1, -1])
    if isinstance(omega, Samples):
        seen = above(np.sqrt((errors**2).sum(axis=1)), rounding) > 0
        errors = np.where(seen[:, None], errors, 0.0) * weights[:, None]
        # In body axes it is S^T that is turned, the other way
        return largest_error(
            omega,
            (chosen, -errors if body else errors),
            lambda first, last, vectors: _rotate(q[first + 1 : last + 1], vectors),
        )
    total = np.cumsum(_rotate(q[chosen + 1], errors * weights[:, None]), axis=0)
    return _unless(float(np.sqrt((total**2).sum(axis=1)).max()), _enlarged(rounding, weights))


@np.errstate(all="ignore")
def angle_error(psid: Signal, steps: Steps, rule: Rule) -> float:
    """How far psi is off at the worst instant, by truncation [rad]; NaN where it cannot be told."""
    if len(steps.t) < 2 or isinstance(psid, Constant):
        return 0.0
    chosen, weights = probes(steps.t)
    errors, rounding = sum_errors(psid, steps.t, chosen, steps.counts[chosen], rule)
    if isinstance(psid, Samples):
        return largest_error(psid, (chosen, np.where(above(errors, rounding) > 0, errors, 0.0) * weights))
    return _unless(float(np.abs(np.cumsum(errors * weights)).max()), _enlarged(rounding, weights))


def turn_errors(
    omega: Signal, t: Values, chosen: NDArray[np.intp], counts: NDArray[np.int64], rule: Rule, *, body: bool
) -> tuple[Values, Values]:
    """Errors of some intervals in so many steps, as rotation vectors (P, 3), and what rounding explains of them."""
    ends, finer = (t[chosen], t[chosen + 1]), _finer(t, chosen, counts)
    coarse = _turns(omega, *ends, counts, rule, body=body)
    fine = _turns(omega, *ends, finer * counts, rule, body=body)
    rounding = interval_rounding(omega, *ends, counts)
    products = np.minimum(rounding.size, 4 * np.sqrt(np.minimum(rounding.size, finer * counts)))
    return _apart(coarse, fine) * _whole(finer, rule)[:, None], rounding.noise + _U * products


def sum_errors(
    psid: Signal, t: Values, chosen: NDArray[np.intp], counts: NDArray[np.int64], rule: Rule
) -> tuple[Values, Values]:
    """Errors of the integrals over some intervals in so many steps, shape (P,), and what rounding explains."""
    ends, finer = (t[chosen], t[chosen + 1]), _finer(t, chosen, counts)
    coarse, fine = _sums(psid, *ends, counts, rule), _sums(psid, *ends, finer * counts, rule)
    rounding = interval_rounding(psid, *ends, counts)
    return (coarse - fine) * _whole(finer, rule), rounding.noise + _U * np.abs(fine)


def spread(t: Values, chosen: NDArray[np.intp], steps: int) -> NDArray[np.int64]:
    """Of so many steps over the whole time, spread evenly, those within some intervals; one at least."""
    parts = np.ceil((t[chosen + 1] - t[chosen]) * (steps / (t[-1] - t[0])))
    found: NDArray[np.int64] = np.clip(np.nan_to_num(parts, nan=1.0), 1, steps).astype(np.int64)
    return found


def _finer(t: Values, chosen: NDArray[np.intp], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """By how much the steps are made shorter to see what they miss: twice, or as `LOOKS` asks for."""
    times: NDArray[np.int64] = -(-spread(t, chosen, LOOKS) // counts)
    return np.maximum(times, 2)


def _whole(finer: NDArray[np.int64], rule: Rule) -> Values:
    """The error as a multiple of the difference from what finer steps find."""
    gain: Values = finer.astype(float) ** rule.order
    return gain / (gain - 1)


def exact(omega: Signal, rule: Rule) -> bool:
    """Whether steps have no truncation: rotations about one axis, but for Runge and Kutta's."""
    return isinstance(omega, Constant) and rule is not RULES["rk4_quaternion"]


def _unless(error: float, noise: float) -> float:
    return 0.0 if error <= noise else error


def above(errors: Values, noise: Values) -> Values:
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
