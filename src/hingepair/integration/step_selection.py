"""The steps that a tolerance asks for (E12): so many in each interval, and ever shorter ones beside a corner.

With an error e of an interval in one step, m steps make it e / m^order; the least number of steps in all for a sum of
errors has m in proportion to e^(1/(order + 1)). Where errors fall by less than that, something is not smooth: there
intervals are halved again and again, so that a jump or a root costs some forty steps and not a million.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.evaluation.backend import How
from hingepair.integration.error_estimate import exact, probes, sizes, spread, sum_errors, turn_errors
from hingepair.integration.methods import Rule
from hingepair.integration.signals import Constant, Function, Signal, Values
from hingepair.integration.stepping import Steps

MOST_STEPS: Final = 2_000_000
"""That a tolerance may ask for; where they are not enough, the estimate says how far they got."""

FEWEST: Final = 16
"""Steps over the whole time that a tolerance begins with."""

_FINEST = 1e-15  # rad: below, rounding is all that is left
_ROUNDS = 16
_COARSE = 1e-3  # rad: errors of intervals from here on do not follow the order of the rule
_GROWTH = 4.0
_HUGE = 1e30  # rad, or steps; anything larger is as bad
_PASSES = 4  # of halving what is not smooth, and of counting steps again
_MOST_CORNERS = 4096  # instants that halving may add in a pass
_SMALL = 0.02  # of the tolerance: what an interval beside a corner may leave


class _Rates(NamedTuple):
    """What is integrated, and how.

    Attributes:
        omega: angular velocity, or None where there is no attitude, or none that steps are too long for.
        others: rates of angles that are not constant.
        rule: that makes the steps.
        how: backend.
        body: whether omega is in body axes.
    """

    omega: Signal | None
    others: Sequence[Signal]
    rule: Rule
    how: How
    body: bool

    @property
    def all(self) -> list[Signal]:
        return [*([] if self.omega is None else [self.omega]), *self.others]

    def errors(self, t: Values, chosen: NDArray[np.intp], counts: NDArray[np.int64]) -> Values:
        """The largest error of each chosen interval in so many steps."""
        found = np.zeros(len(chosen))
        if self.omega is not None:
            found = sizes(turn_errors(self.omega, t, chosen, counts, self.rule, self.how, body=self.body))
        for rate in self.others:
            found = np.maximum(found, sizes(sum_errors(rate, t, chosen, counts, self.rule)))
        return found


@np.errstate(all="ignore")
def selected_steps(
    omega: Signal | None,
    rates: Sequence[Signal],
    t: Values,
    rule: Rule,
    tol: float | None,
    how: How,
    *,
    body: bool = False,
) -> Steps:
    """Steps that keep the error of attitude and angles below tol, but for that of interpolation; one each without.

    Args:
        omega: angular velocity, or None where no attitude is integrated.
        rates: of angles.
        t: the instants that are asked for.
        rule: that makes the steps.
        tol: largest error [rad].
        how: backend.
        body: whether omega is in body axes.
    """
    moving = [rate for rate in rates if not isinstance(rate, Constant)]
    turning = None if omega is None or exact(omega, rule) else omega
    given = _Rates(turning, moving, rule, how, body)
    if tol is None or len(t) < 2 or not given.all:
        return Steps(t, np.ones(max(0, len(t) - 1), np.int64))
    goal, refined = 0.4 * max(tol, _FINEST), t
    for _ in range(_PASSES):
        counts, rough = _counted(given, refined, goal)
        if not rough.size:
            break
        refined = np.union1d(refined, _halved(given, refined, rough, _SMALL * goal))
    else:
        counts, _ = _counted(given, refined, goal, stop=False)
    return Steps(refined, counts, None if refined is t else np.searchsorted(refined, t))


class _Round(NamedTuple):
    errors: Values
    counts: NDArray[np.int64]


def _counted(
    given: _Rates, t: Values, goal: float, *, stop: bool = True
) -> tuple[NDArray[np.int64], NDArray[np.intp]]:
    """Steps for each interval; and intervals where errors do not fall with them, at which to stop."""
    rule, looked = given.rule, probes(t, given.all)
    chosen = looked.intervals
    counts = spread(t, chosen, FEWEST)
    before = _Round(np.zeros(len(chosen)), counts)
    stop = stop and any(isinstance(rate, Function) for rate in given.all)
    for _ in range(_ROUNDS):
        errors = given.errors(t, chosen, counts)
        weights = looked.stand_for(looked.counts(counts), rule.order)
        total = (errors * weights).sum()
        if total <= 1.2 * goal or np.isnan(total):
            break
        now = _Round(np.minimum(errors, _HUGE), counts)
        order = _order_seen(before, now, rule)
        rough = (errors < _COARSE) & (errors > _SMALL * goal) & (order < min(2.5, rule.order - 0.5))
        if stop and rough.any():
            return looked.counts(counts), chosen[rough]
        asked = _asked(*now, weights, goal, order, rule)
        before = now
        room = MOST_STEPS / (asked * weights).sum()
        counts = np.maximum(counts, np.ceil(asked * min(room, 1.0)).astype(np.int64))
        if room < 1:
            break
    return looked.counts(counts), np.empty(0, np.intp)


def _halved(given: _Rates, t: Values, rough: NDArray[np.intp], small: float) -> Values:
    """Instants that halve intervals, and what is not smooth of the halves again, until little is left there.

    An error may fall by chance: what is smooth has fallen as the rule's do twice in a row.
    """
    start, stop = t[rough], t[rough + 1]
    before, smooth = given.errors(t, rough, np.ones(len(rough), np.int64)), np.zeros(len(rough), bool)
    falling = 2.0 ** -min(3.5, given.rule.order + 0.5)
    found: list[float] = []
    while 0 < len(start) < _MOST_CORNERS - len(found):
        middle = start + 0.5 * (stop - start)
        found.extend(middle.tolist())
        start, stop = np.stack([start, middle], axis=1).ravel(), np.stack([middle, stop], axis=1).ravel()
        edges = np.union1d(start, stop)
        errors = given.errors(edges, np.searchsorted(edges, start), np.ones(len(start), np.int64))
        wide = stop - start > 16 * np.spacing(np.maximum(np.abs(start), np.abs(stop)))
        fell = errors <= falling * np.repeat(before, 2)
        kept = (errors > small) & ~(fell & np.repeat(smooth, 2)) & wide
        start, stop, before, smooth = start[kept], stop[kept], errors[kept], fell[kept]
    return np.array(found)


def _asked(
    errors: Values, counts: NDArray[np.int64], weights: Values, goal: float, order: Values, rule: Rule
) -> Values:
    """The steps of intervals that make their errors as large as the goal, in all.

    Errors that large steps make are of no order yet; then more than a few times as many are not asked for at once.
    Nor are they where the rate has a corner or a root, and errors fall by a lower order than the rule's.
    """
    shares: Values = (errors * counts.astype(float) ** rule.order) ** (1 / (rule.order + 1))
    more = ((shares * weights).sum() / goal) ** (1 / rule.order) * shares / counts
    slower = np.maximum(more, np.minimum(np.maximum(more, 1.0) ** (rule.order / order), _GROWTH))
    asked: Values = counts * np.where(errors > _COARSE, np.minimum(more, _GROWTH), slower)
    return np.clip(asked, counts, _HUGE)


def _order_seen(before: _Round, now: _Round, rule: Rule) -> Values:
    """The order by which errors fell with the steps, from 1 up to the rule's."""
    seen = np.log(before.errors / now.errors) / np.log(now.counts / before.counts)
    return np.clip(np.where(np.isfinite(seen), seen, rule.order), 1, rule.order)
