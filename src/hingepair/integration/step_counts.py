"""How many steps a tolerance asks for (E12), interval by interval."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.integration.attitude_steps import Rule
from hingepair.integration.signals import Constant, Signal, Values
from hingepair.integration.step_control import exact, probes, sizes, spread, sum_errors, turn_errors

MOST_STEPS: Final = 2_000_000
"""That a tolerance may ask for; where they are not enough, `integrate` says how far they got."""

FEWEST: Final = 16
"""Steps over the whole time that a tolerance begins with."""

_FINEST = 1e-15  # rad: below, rounding is all that is left
_ROUNDS = 16
_COARSE = 1e-3  # rad: errors of intervals from here on do not follow the order of the rule
_GROWTH = 4.0
_HUGE = 1e30  # rad, or steps; anything larger is as bad


class _Round(NamedTuple):
    errors: Values
    counts: NDArray[np.int64]


@np.errstate(all="ignore")
def substeps(
    omega: Signal | None, rates: Sequence[Signal], t: Values, rule: Rule, tol: float | None, *, body: bool = False
) -> NDArray[np.int64]:
    """Steps for each interval that keep the error of attitude and angles below tol, but for that of interpolation.

    With an error e of an interval in one step, m steps make it e / m^order; the least number of steps in all for a
    sum of errors has m in proportion to e^(1/(order + 1)).
    """
    ones = np.ones(max(0, len(t) - 1), np.int64)
    turning = omega is not None and not exact(omega, rule)
    rates = [rate for rate in rates if not isinstance(rate, Constant)]
    if tol is None or len(t) < 2 or not (turning or rates):
        return ones
    goal = 0.4 * max(tol, _FINEST)
    looked = probes(t, [*([omega] if omega is not None and turning else ()), *rates])
    chosen = looked.intervals
    counts = spread(t, chosen, FEWEST)
    before = _Round(np.zeros(len(chosen)), counts)
    for _ in range(_ROUNDS):
        errors = np.zeros(len(chosen))
        if omega is not None and turning:
            errors = sizes(turn_errors(omega, t, chosen, counts, rule, body=body))
        for rate in rates:
            errors = np.maximum(errors, sizes(sum_errors(rate, t, chosen, counts, rule)))
        weights = looked.stand_for(looked.counts(counts), rule.order)
        total = (errors * weights).sum()
        if total <= 1.2 * goal or np.isnan(total):
            break
        now = _Round(np.minimum(errors, _HUGE), counts)
        asked = _asked(*now, weights, goal, _order_seen(before, now, rule), rule)
        before = now
        room = MOST_STEPS / (asked * weights).sum()
        counts = np.maximum(counts, np.ceil(asked * min(room, 1.0)).astype(np.int64))
        if room < 1:
            break
    return looked.counts(counts)


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
