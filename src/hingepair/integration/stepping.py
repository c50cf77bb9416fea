"""From rates to angles at the instants (E12): steps, slab by slab, and all products of the first k of them.

omega does not depend on the attitude, so all rotations of steps are had at once; the attitudes are their products.
These are made by a tree: groups of RADIX neighbours one after the other, then the groups' products in the same way,
which are handed down to the groups' members. A small rotation is rounded in proportion to its angle, and the tree
multiplies small ones by small ones: only the last few levels round at the size of 1, as often as the whole motion
has radians, where a running product would have done so at each of k steps. psi goes along as sums of two doubles.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError
from hingepair.evaluation.backend import How
from hingepair.evaluation.loops import Loop
from hingepair.integration.methods import Rule, integrals, quaternion_product, quaternion_unit, turns
from hingepair.integration.signals import Constant, Signal, Values
from hingepair.numeric.twofold import HighLow, exact_sum, pair_product, pair_sum

SLAB: Final = 16384
"""Steps a slab: 1.2 MB of omega at three nodes."""

RADIX: Final = 16
FEW: Final = 64
"""Elements that are combined one after the other, as plain numbers."""

_INVERSE = np.array([1.0, -1.0, -1.0, -1.0])
_F8 = np.dtype(np.float64)


class Steps(NamedTuple):
    """Steps between the instants, as many to each interval as its error asks for.

    Attributes:
        t: the instants, shape (N,).
        counts: steps of each interval, shape (N - 1,).
        asked: which of the instants were asked for; None for all.
    """

    t: Values
    counts: NDArray[np.int64]
    asked: NDArray[np.intp] | None = None

    def slabs(self) -> list[tuple[int, int]]:
        """Ranges of intervals that hold about SLAB steps each."""
        if not len(self.counts):
            return []
        ends = np.cumsum(self.counts)
        cuts = np.searchsorted(ends, np.arange(SLAB, ends[-1] + SLAB, SLAB)) + 1
        edges = np.unique([0, *np.minimum(cuts, len(ends))]).tolist()
        return list(itertools.pairwise(edges))

    def within(self, first: int, last: int) -> tuple[Values, HighLow, NDArray[np.intp] | None]:
        """Starts and lengths (as two doubles) of the steps of some intervals, and the last step of each interval.

        The latter is None where each interval is one step.
        """
        counts = self.counts[first:last]
        start, stop = self.t[first:last], self.t[first + 1 : last + 1]
        if counts.max() == 1:
            return start, exact_sum(stop, -start), None
        begin, h, _ = divided(start, stop, counts)
        return begin, h, np.cumsum(counts) - 1


def divided(start: Values, stop: Values, counts: NDArray[np.int64]) -> tuple[Values, HighLow, NDArray[np.intp]]:
    """Starts and lengths (as two doubles) of the steps of intervals, and their numbers within their interval.

    A length is the difference between rounded starts, so that the lengths add up to the interval: a rounded length
    would be off by as much in all of its steps.
    """
    ends = np.cumsum(counts)
    part = np.arange(ends[-1]) - np.repeat(ends - counts, counts)
    begin = np.repeat(start, counts) + part * np.repeat((stop - start) / counts, counts)
    after = np.append(begin[1:], stop[-1])
    after[ends - 1] = stop
    return begin, exact_sum(after, -begin), part


class Prefixes:
    """All products of the first k factors of a row, in place; or sums, or whatever else is associative.

    Args:
        name: of what is combined.
        combine: of a later and an earlier element.
        neutral: what changes nothing.
        finish: of a result that is final.
        exact: whether its code may not be fused.
    """

    def __init__(
        self,
        name: str,
        combine: Callable[[Any, Any], Any],
        neutral: tuple[float, ...],
        finish: Callable[[Any], Any] = lambda result: result,
        *,
        exact: bool = False,
    ) -> None:
        self.combine = combine
        self.neutral = neutral
        self.finish = finish
        shape = (len(neutral),)
        given, out = {"own": shape, "before": shape}, {"own": shape}
        self._chain = Loop(f"{name}_in_a_row", lambda v: {"own": combine(v["own"], v["before"])}, given, out,
                           exact=exact, carry={"before": "own"})  # fmt: skip
        self._join = Loop(f"{name}_joined", lambda v: {"own": finish(combine(v["own"], v["before"]))}, given, out,
                          exact=exact)  # fmt: skip

    def room(self, count: int) -> Values:
        """Rows for so many elements and, where there are many, neutral ones to fill the last group."""
        rows = np.empty((count if count <= FEW else -(-count // RADIX) * RADIX, len(self.neutral)))
        rows[count:] = self.neutral
        return rows

    def run(self, rows: Values, start: tuple[float, ...], how: How) -> Any:
        """Combine rows, as many as `room` has, after a start; returns what they come to without it."""
        if len(rows) <= FEW:
            own = list(itertools.accumulate(map(tuple, rows.tolist()), lambda a, b: self.combine(b, a)))
            rows[:] = [self.finish(self.combine(one, start)) for one in own]
            return own[-1]
        groups = rows.reshape(-1, RADIX, rows.shape[1])
        self._run(self._chain, groups, np.broadcast_to(self.neutral, groups[:, 0].shape), how)
        ends = self.room(len(groups))
        ends[: len(groups)] = groups[:, -1]
        whole = self.run(ends, start, how)
        before = np.concatenate([[start], ends[: len(groups) - 1]])
        self._run(self._join, groups, before[:, None], how)
        return whole

    def _run(self, loop: Loop, own: Values, before: Values, how: How) -> None:
        loop.run({"own": own, "before": before}, {"own": own}, own.shape[:-1], _F8, how)


ROTATIONS: Final = Prefixes("rotations", quaternion_product, (1.0, 0.0, 0.0, 0.0), quaternion_unit)
SUMS: Final = Prefixes("sums", pair_sum, (0.0, 0.0), exact=True)


class _Carry:
    """What the slabs so far come to, kept for powers of two of them: none is combined with one much shorter."""

    def __init__(self, prefixes: Prefixes, start: Values) -> None:
        self.combine = prefixes.combine
        self.start = tuple(start.tolist())
        self.parts: list[tuple[int, tuple[float, ...]]] = []

    def add(self, slab: tuple[float, ...]) -> None:
        count = 1
        while self.parts and self.parts[-1][0] == count:
            slab, count = self.combine(slab, self.parts.pop()[1]), 2 * count
        self.parts.append((count, slab))

    @property
    def now(self) -> tuple[float, ...]:
        return functools.reduce(lambda whole, part: self.combine(part[1], whole), self.parts, self.start)


def _accumulate(steps: Steps, prefixes: Prefixes, start: Values, fill: Callable[..., None], how: How) -> Values:
    """What the steps come to at the instants, from a start.

    Args:
        steps: between the instants.
        prefixes: how they are combined.
        start: at the first instant.
        fill: writes the steps of a slab, from starts and lengths (as two doubles), into rows.
        how: backend.
    """
    found = np.empty((len(steps.t), len(start)))
    found[0] = start
    carry = _Carry(prefixes, start)
    for first, last in steps.slabs():
        begin, h, ends = steps.within(first, last)
        target = found[first + 1 : last + 1]
        direct = ends is None and (len(target) <= FEW or len(target) % RADIX == 0)
        rows = target if direct else prefixes.room(len(begin))
        fill(begin, h, rows[: len(begin)])
        carry.add(prefixes.run(rows, carry.now, how))
        if not direct:
            target[:] = rows[: len(begin)] if ends is None else rows[ends]
    return found


@np.errstate(all="ignore")
def attitudes(omega: Signal, steps: Steps, rule: Rule, how: How, start: Values, *, body: bool = False) -> Values:
    """The attitudes at the instants.

    Args:
        omega: in world axes, S' = [omega]x S, or in body axes, S' = S [omega]x. The latter is the former for S^T
            and -omega; what a step makes of omega depends on h omega only, so that -h serves.
        steps: between the instants.
        rule: that makes a rotation of each step.
        how: backend.
        start: the attitude at the first instant, a unit quaternion (w, x, y, z).
        body: whether omega is in body axes.

    Returns:
        Unit quaternions, shape (N, 4), without a jump of their sign.
    """

    def fill(begin: Values, h: HighLow, rows: Values) -> None:
        given = {"omega": omega.nodes(begin, h[0], rule.nodes), "h": -h[0] if body else h[0]}
        turns(rule).run(given, {"q": rows}, h[0].shape, _F8, how)

    found = _accumulate(steps, ROTATIONS, start * _INVERSE if body else start, fill, how)
    _check_finite("omega1", "angles of each step that have a sine", found, steps)
    return found * _INVERSE if body else found


@np.errstate(all="ignore")
def angles(name: str, rate: Signal, start: float, steps: Steps, rule: Rule, how: How) -> Values:
    """Angles at the instants from their rate, which has a name, to the last bit or so of the sum; shape (N,)."""
    if isinstance(rate, Constant):
        apart = exact_sum(steps.t, -steps.t[0])
        turned = pair_product((rate.value, 0.0), apart)
        found = np.stack(pair_sum(turned, (start, 0.0)), axis=-1)
    else:

        def fill(begin: Values, h: HighLow, rows: Values) -> None:
            given = {"rate": rate.nodes(begin, h[0], rule.nodes), "h": h}
            integrals(rule).run(given, {"sum": rows}, h[0].shape, _F8, how)

        found = _accumulate(steps, SUMS, np.array([start, 0.0]), fill, how)
    _check_finite(name, "a rate whose integral is finite", found, steps)
    return found[:, 0].copy()


def _check_finite(name: str, expected: str, rows: Values, steps: Steps) -> None:
    """Refuse what has overflowed on the way, which the last row shows; names the first interval that did."""
    if not np.isfinite(rows[-1]).all():
        first = int(np.argmin(np.isfinite(rows).all(axis=1)))
        if steps.asked is not None:
            first = int(np.searchsorted(steps.asked, first))
        raise ArgumentError(name, expected, f"overflow between the instants {first - 1} and {first}")
