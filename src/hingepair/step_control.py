"""How far the steps are from the truth, and how many there must be (E12): by steps of half the length, on probes.

The errors of the intervals, turned back to the first instant, add up to the error at any later one. They are measured
on all intervals, or on PROBES of them, spread evenly and shifted each within its part, which stand for the others.
Of samples it is the interpolant that is integrated so; what this misses is added (`interpolation_error`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair import increments as inc
from hingepair.attitude_steps import Rule, Steps, increment_quaternions
from hingepair.interpolation_error import largest_error
from hingepair.signals import Samples, Signal, Values

PROBES: Final = 2048
MOST_STEPS: Final = 2_000_000
"""That a tolerance may ask for; where they are not enough, `integrate` says how far they got."""

_U = 2.0**-53
_FINEST = 1e-15  # rad: below, rounding is all that is left
_ROUNDS = 8
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
def attitude_rounding(omega: Signal, t: Values) -> float:
    """What rounding adds to the attitude [rad]: products of rotations by a radian or so, a random walk of them.

    Where omega never changes, each step rounds alike, and there is nothing random about it.
    """
    if len(t) < 2:
        return 4 * _U
    chosen, weights = probes(t)
    values = omega.at(t[chosen])
    size = np.sqrt((values**2).sum(axis=1))
    radians = float((size * (t[chosen + 1] - t[chosen]) * weights).sum())
    return _U * (8 + (radians if (values == values[0]).all() else 4 * math.sqrt(radians)))


@np.errstate(all="ignore")
def attitude_error(omega: Signal, steps: Steps, rule: Rule, quats: Values, *, body: bool) -> float:
    """How far the attitudes are off at the worst instant, by truncation [rad]; NaN where it cannot be told."""
    if len(steps.t) < 2:
        return 0.0
    chosen, weights = probes(steps.t)
    errors = turn_errors(omega, steps.t, chosen, steps.counts[chosen], rule, body=body) * weights[:, None]
    q = quats if body else quats * np.array([1, -1, -1, -1])
    if isinstance(omega, Samples):
        # In body axes it is S^T that is turned, the other way
        return largest_error(
            omega,
            (chosen, -errors if body else errors),
            lambda first, last, vectors: _rotate(q[first + 1 : last + 1], vectors),
        )
    total = np.cumsum(_rotate(q[chosen + 1], errors), axis=0)
    return float(np.sqrt((total**2).sum(axis=1)).max())


@np.errstate(all="ignore")
def angle_error(psid: Signal, steps: Steps, rule: Rule) -> float:
    """How far psi is off at the worst instant, by truncation [rad]; NaN where it cannot be told."""
    if len(steps.t) < 2:
        return 0.0
    chosen, weights = probes(steps.t)
    errors = sum_errors(psid, steps.t, chosen, steps.counts[chosen], rule) * weights
    if isinstance(psid, Samples):
        return largest_error(psid, (chosen, errors))
    return float(np.abs(np.cumsum(errors)).max())


@np.errstate(all="ignore")
def substeps(
    omega: Signal | None, rates: Sequence[Signal], t: Values, rule: Rule, tol: float | None, *, body: bool = False
) -> NDArray[np.int64]:
    """Steps for each interval that keep the error of attitude and angles below tol, but for that of interpolation.

    With an error e of an interval in one step, m steps make it e / m^order; the least number of steps in all for a
    sum of errors has m in proportion to e^(1/(order + 1)).
    """
    ones = np.ones(max(0, len(t) - 1), np.int64)
    if tol is None or len(t) < 2:
        return ones
    goal = 0.4 * max(tol, _FINEST)
    chosen, weights = probes(t)
    counts = ones[chosen]
    for _ in range(_ROUNDS):
        errors = np.zeros(len(chosen))
        if omega is not None:
            errors = np.sqrt((turn_errors(omega, t, chosen, counts, rule, body=body) ** 2).sum(axis=1))
        for rate in rates:
            errors = np.maximum(errors, np.abs(sum_errors(rate, t, chosen, counts, rule)))
        total = (errors * weights).sum()
        if total <= 1.2 * goal or not np.isfinite(total):
            break
        shares = (errors * counts**rule.order) ** (1 / (rule.order + 1))
        factor = ((shares * weights).sum() / goal) ** (1 / rule.order)
        asked = np.maximum(counts, factor * shares)
        room = MOST_STEPS / (asked * weights).sum()
        counts = np.maximum(counts, np.ceil(asked * min(room, 1.0)).astype(np.int64))
        if room < 1:
            break
    if len(chosen) == len(ones):
        return counts
    after = np.searchsorted(chosen, np.arange(len(ones)))
    return np.maximum(counts[np.minimum(after, len(chosen) - 1)], counts[np.maximum(after - 1, 0)])


def turn_errors(
    omega: Signal, t: Values, chosen: NDArray[np.intp], counts: NDArray[np.int64], rule: Rule, *, body: bool
) -> Values:
    """Errors of some intervals in so many steps, as rotation vectors (P, 3); zero below what rounding explains.

    Rounding is that of the interval's angle, and that of t, which moves the nodes.
    """
    ends = t[chosen], t[chosen + 1]
    coarse = _turns(omega, *ends, counts, rule, body=body)
    fine = _turns(omega, *ends, 2 * counts, rule, body=body)
    size = 2 * np.arctan2(np.sqrt(fine[1] ** 2 + fine[2] ** 2 + fine[3] ** 2), np.abs(fine[0]))
    change = np.abs(omega.at(ends[1]) - omega.at(ends[0])).sum(axis=1)
    found = _apart(coarse, fine) * (2**rule.order / (2**rule.order - 1))
    noise = _U * (size + np.abs(ends[1]) * change)
    return np.where((np.abs(found).max(axis=1) > noise)[:, None], found, 0.0)


def sum_errors(psid: Signal, t: Values, chosen: NDArray[np.intp], counts: NDArray[np.int64], rule: Rule) -> Values:
    """Errors of the integrals over some intervals in so many steps, shape (P,); zero likewise."""
    ends = t[chosen], t[chosen + 1]
    coarse, fine = _sums(psid, *ends, counts, rule), _sums(psid, *ends, 2 * counts, rule)
    found: Values = (coarse - fine) * (2**rule.order / (2**rule.order - 1))
    change = np.abs(psid.at(ends[1]) - psid.at(ends[0]))
    return np.where(np.abs(found) > _U * (np.abs(fine) + np.abs(ends[1]) * change), found, 0.0)


def _turns(omega: Signal, start: Values, stop: Values, counts: NDArray[np.int64], rule: Rule, *, body: bool) -> Any:
    """The rotations over intervals, each in its number of steps: neighbours are multiplied until one is left."""
    begin, h, part = _split(start, stop, counts)
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
    begin, h, _ = _split(start, stop, counts)
    each: Values = h * (psid.nodes(begin, h, rule.nodes) @ _quadrature(rule))
    return np.add.reduceat(each, np.cumsum(counts) - counts)


def _split(start: Values, stop: Values, counts: NDArray[np.int64]) -> tuple[Values, Values, NDArray[np.int64]]:
    """Starts and lengths of the steps of intervals, and their numbers within their interval."""
    part = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    h = np.repeat((stop - start) / counts, counts)
    return np.repeat(start, counts) + part * h, h, part


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
