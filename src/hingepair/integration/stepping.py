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
from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.loops import Loop
from hingepair.integration.methods import quaternion_product, quaternion_unit
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.twofold import HighLow, exact_sum, pair_sum

SLAB: Final = 16384
"""Steps a slab: 1.2 MB of omega at three nodes."""

RADIX: Final = 16
FEW: Final = 64
"""Elements that are combined one after the other, as plain numbers."""

_F8 = np.dtype(np.float64)


class Steps(NamedTuple):
    """Steps, one from each of these times to the next."""

    t: Array  # shape (steps + 1,)
    own: NDArray[np.intp] | None = None  # which of the times are the instants that were asked for; None for all

    @property
    def made(self) -> int:
        """How many steps."""
        return len(self.t) - 1

    def asked(self, rows: Array) -> Array:
        """Of what was found between all steps, that at the instants."""
        return rows if self.own is None else rows[self.own]

    def refined(self, times: Array) -> Steps:
        """Steps that end at these times as well."""
        t = np.union1d(self.t, times)
        return Steps(t, np.searchsorted(t, self.asked(self.t)))

    def slabs(self) -> Iterator[tuple[int, int]]:
        """Ranges of SLAB steps."""
        return ((first, min(first + SLAB, self.made)) for first in range(0, self.made, SLAB))

    def within(self, first: int, last: int) -> tuple[Array, HighLow]:
        """Starts and lengths (as two doubles) of steps."""
        return self.t[first:last], exact_sum(self.t[first + 1 : last + 1], -self.t[first:last])


class Division(NamedTuple):
    """Intervals in equal steps."""

    counts: NDArray[np.int64]  # steps of each interval
    start: Array  # of each step
    stop: Array
    part: NDArray[np.int64]  # number of each step in its interval

    @property
    def h(self) -> Array:
        """Lengths of the steps."""
        return self.stop - self.start

    def added(self, rows: Array) -> Array:
        """Sums over the intervals of what the steps have."""
        return np.asarray(np.add.reduceat(rows, np.cumsum(self.counts) - self.counts))


def divided(start: Array, stop: Array, counts: NDArray[np.int64]) -> Division:
    """Intervals in so many steps each; the end of a step is the start of the next."""
    ends = np.cumsum(counts)
    part = np.arange(ends[-1]) - np.repeat(ends - counts, counts)
    begin = np.repeat(start, counts) + part * np.repeat((stop - start) / counts, counts)
    after = np.append(begin[1:], stop[-1])
    after[ends - 1] = stop
    return Division(counts, begin, after, part)


class Prefixes:
    """All products of the first k factors of a row, in place; or sums, or whatever else is associative.

    `combine` takes a later and an earlier element, `neutral` changes nothing, `finish` is for final results; `exact`
    is what may not be fused.
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

    def over(
        self, steps: Steps, start: tuple[float, ...], fill: Callable[[Array, HighLow, Array], None], how: Execution
    ) -> Array:
        """What the steps come to, from a start; one row more than there are steps.

        `fill` writes steps into rows, from their starts and lengths (as two doubles). Of the slabs so far no long
        part is combined with a much shorter one.
        """
        found = np.empty((1 + _filled_up(steps.made), len(start)))
        found[0], found[1 + steps.made :] = start, self.neutral
        parts: list[tuple[int, tuple[float, ...]]] = []  # how many slabs, a power of two, and what they come to
        for first, last in steps.slabs():
            count, rows = 1, found[first + 1 : len(found) if last == steps.made else last + 1]
            fill(*steps.within(first, last), rows[: last - first])
            before = functools.reduce(lambda whole, part: self.combine(part[1], whole), parts, start)
            slab = self.run(rows, before, how)
            while parts and parts[-1][0] == count:
                slab, count = self.combine(slab, parts.pop()[1]), 2 * count
            parts.append((count, slab))
        return found[: steps.made + 1]

    def room(self, count: int) -> Array:
        """Rows for so many elements and, where there are many, neutral ones to fill the last group."""
        rows = np.empty((_filled_up(count), len(self.neutral)))
        rows[count:] = self.neutral
        return rows

    def run(self, rows: Array, start: tuple[float, ...], how: Execution) -> Any:
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

    def _run(self, loop: Loop, own: Array, before: Array, how: Execution) -> None:
        loop.run({"own": own, "before": before}, {"own": own}, own.shape[:-1], _F8, how)


def _filled_up(count: int) -> int:
    return count if count <= FEW else -(-count // RADIX) * RADIX


ROTATIONS: Final = Prefixes("rotations", quaternion_product, (1.0, 0.0, 0.0, 0.0), quaternion_unit)
SUMS: Final = Prefixes("sums", pair_sum, (0.0, 0.0), exact=True)
