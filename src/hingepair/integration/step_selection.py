"""The steps that a tolerance asks for (E12): ever shorter ones where errors are large.

With an error e of an interval in one step, m steps make it e / m^order; the least number of steps in all for a sum of
errors has m in proportion to e^(1/(order + 1)). Intervals are divided so, a few times at a time, until the sum is
small enough: beside a jump or a root again and again, which costs some sixty steps and not a million.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.integration.error_estimate import probes, spread, step_errors
from hingepair.integration.integrals import Integral
from hingepair.integration.stepping import Steps, divided
from hingepair.numeric.arrays import Float64Array as Array

MOST_STEPS: Final = 2_000_000
"""That a tolerance may ask for; where they are not enough, the estimate says how far they got."""

FEWEST: Final = 16
"""Steps over the whole time that a tolerance begins with."""

_FINEST = 1e-15  # rad: below, rounding is all that is left
_SHARE = 0.4  # of the tolerance that the sum of errors is aimed at: there is rounding, and what probes do not show
_ROUNDS = 64
_PARTS, _FEW_PARTS = 16, 4  # of an interval at a time; few where errors do not go by the rule's order
_COARSE, _PATIENCE = 1e-3, 5  # rad, rounds: a smaller sum that stays the same for so many is noise, not truncation
_BY_CHANCE = 10.0  # errors that do not go by the order may be so many times too small: two rules agree by chance
_HUGE = 1e30  # rad; anything larger is as bad


@np.errstate(all="ignore")
def selected_steps(integrals: Sequence[Integral], t: Array, tol: float | None) -> Steps:
    """Steps between instants that keep the errors of integrals below tol, but for that of interpolation.

    Without a tolerance there is one for each interval. The integrals are of one rule.
    """
    moving = [integral for integral in integrals if not integral.exact]
    if tol is None or len(t) < 2 or not moving:
        return Steps(t)
    whole, order, goal = t[-1] - t[0], moving[0].rule.order, _SHARE * max(tol, _FINEST)
    looked = probes(t, [integral.rate for integral in moving])
    weights = looked.stand_for(0)  # of as many times as much time
    start, stop = looked.ends
    pieces: tuple[NDArray[Any], ...] = (
        np.arange(len(start)),
        start,
        stop,
        np.full(len(start), np.nan),
        np.full(len(start), _FEW_PARTS),
    )
    counts = spread(stop - start, whole, FEWEST)
    again, totals = np.ones(len(start), np.bool_), list[float]()
    while again.any() and len(totals) < _ROUNDS:
        owner, start, stop, errors, _ = (each[again] for each in pieces)
        parts = divided(start, stop, counts[again])
        found = [step_errors(integral, parts.start, parts.stop, whole).sizes for integral in moving]
        now = np.minimum(np.max(found, axis=0), _HUGE)
        falls = now <= np.repeat(errors / parts.counts.astype(float) ** order, parts.counts)
        fresh = np.repeat(owner, parts.counts), parts.start, parts.stop, now, np.where(falls, _PARTS, _FEW_PARTS)
        pieces = tuple(np.concatenate([old[~again], new]) for old, new in zip(pieces, fresh, strict=True))
        owner, start, stop, errors, most = pieces
        wide = stop - start > 16 * np.spacing(np.maximum(np.abs(start), np.abs(stop)))
        errors = np.where(wide, np.where(most == _PARTS, errors, _BY_CHANCE * errors), 0.0)
        totals.append(float((errors * weights[owner]).sum()))
        last = totals[-_PATIENCE:]
        if not totals[-1] > goal or (len(last) == _PATIENCE and max(last) < min(2 * min(last), _COARSE)):
            break
        counts = _asked(errors, weights[owner], most, goal, order)
        again = counts > 1
    if len(start) == len(t) - 1:
        return Steps(t)
    longest = np.zeros(len(weights))
    np.maximum.at(longest, owner, stop - start)
    like = np.maximum(np.ceil(np.diff(t) * (1 - 2.0**-50) / looked.each(longest)), 1).astype(np.int64)
    like[looked.intervals] = 1
    return Steps(t).refined(np.append(start, divided(t[:-1], t[1:], like).start))


def _asked(errors: Array, weights: Array, most: NDArray[np.int64], goal: float, order: int) -> NDArray[np.int64]:
    """The parts of intervals that make their errors as large as the goal in all, or as many as there may be steps."""
    shares = errors ** (1 / (order + 1))
    more = np.clip(((shares * weights).sum() / goal) ** (1 / order) * shares, 1, most)
    more = np.maximum(more * min(1.0, MOST_STEPS / (more * weights).sum()), 1)
    whole = np.floor(more)
    gain = errors * (whole**-order - (whole + 1) ** -order)
    best = np.argsort(-gain)
    enough = np.cumsum((gain * weights)[best]) > (errors * whole**-order * weights).sum() - goal
    room = np.cumsum(weights[best]) <= MOST_STEPS - (whole * weights).sum()
    one_more = np.append(True, ~enough[:-1]) & room & (more > whole)[best]
    whole[best[one_more]] += 1
    return np.asarray(whole.astype(np.int64))
