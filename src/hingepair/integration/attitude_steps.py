"""Attitude and hinge angle at the instants from what their rates are in between (E12): steps, slab by slab.

omega does not depend on the attitude, so all increments are had at once; the attitudes are their products, made by a
tree (`prefix_product`): within slabs of steps that fit the cache, then over the slabs. psi goes along as sums of two
doubles.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError
from hingepair.evaluation import kernel_cache
from hingepair.evaluation.backend import How
from hingepair.integration import increments as inc
from hingepair.integration.prefix_product import scan
from hingepair.integration.signals import Constant, Signal, Values
from hingepair.numeric import compensated
from hingepair.numeric.blocks import components_of

SLAB: Final = 16384
"""Steps a slab: 400 kB of omega at three nodes."""

_INVERSE = np.array([1.0, -1.0, -1.0, -1.0])
_A, _B = 0.5 - 3**0.5 / 6, 0.5 - 15**0.5 / 10


class Rule(NamedTuple):
    """A method that makes each step from omega alone.

    Attributes:
        number: by which the compiled kernels know it.
        order: of the error against h.
        nodes: where a step looks at omega and psi', as parts of the step.
    """

    number: int
    order: int
    nodes: tuple[float, ...]


RULES: Final = {
    "magnus6": Rule(2, 6, (_B, 0.5, 1 - _B)),
    "magnus4": Rule(1, 4, (_A, 1 - _A)),
    "cf4": Rule(3, 4, (_A, 1 - _A)),
    "midpoint": Rule(0, 2, (0.5,)),
    "rk4_quaternion": Rule(4, 4, (0.0, 0.5, 1.0)),
}


class Steps(NamedTuple):
    """Steps between the instants, as many to each interval as its error asks for.

    Attributes:
        t: the instants, shape (N,).
        counts: steps of each interval, shape (N - 1,).
    """

    t: Values
    counts: NDArray[np.int64]

    def slabs(self) -> list[tuple[int, int]]:
        """Ranges of intervals that hold about SLAB steps each."""
        if not len(self.counts):
            return []
        ends = np.cumsum(self.counts)
        cuts = np.searchsorted(ends, np.arange(SLAB, ends[-1] + SLAB, SLAB)) + 1
        edges = np.unique([0, *np.minimum(cuts, len(ends))]).tolist()
        return list(itertools.pairwise(edges))

    def within(self, first: int, last: int) -> tuple[Values, compensated.Pair, NDArray[np.intp] | None]:
        """Starts and lengths (as two doubles) of the steps of some intervals, and the last step of each interval.

        The latter is None where each interval is one step.
        """
        counts = self.counts[first:last]
        start, stop = self.t[first:last], self.t[first + 1 : last + 1]
        if counts.max() == 1:
            return start, compensated.exact_sum(stop, -start), None
        begin, h, _ = divided(start, stop, counts)
        return begin, h, np.cumsum(counts) - 1


def divided(
    start: Values, stop: Values, counts: NDArray[np.int64]
) -> tuple[Values, compensated.Pair, NDArray[np.intp]]:
    """Starts and lengths (as two doubles) of the steps of intervals, and their numbers within their interval.

    A length is the difference between rounded starts, so that the lengths add up to the interval: a rounded length
    would be off by as much in all of its steps.
    """
    ends = np.cumsum(counts)
    part = np.arange(ends[-1]) - np.repeat(ends - counts, counts)
    begin = np.repeat(start, counts) + part * np.repeat((stop - start) / counts, counts)
    after = np.append(begin[1:], stop[-1])
    after[ends - 1] = stop
    return begin, compensated.exact_sum(after, -begin), part


class Loops(NamedTuple):
    """What runs over the steps of a slab, by NumPy or compiled (see `kernel_turns`)."""

    turns: Callable[[Values, Values, int, Values], None]
    place: Callable[[Values, Values], None]
    sums: Callable[[Values, Values, Values, int, Values], None]


def loops(how: How, steps: Steps) -> Loops:
    """The loops for so many steps."""
    if not how.compiles(int(steps.counts.sum()), kernel_cache.turns_loaded):
        return Loops(_turns, _place, _sums)

    kernels = kernel_cache.turn_kernels()
    return Loops(kernels.turns, kernels.place, kernels.sums)


@np.errstate(all="ignore")
def attitudes(omega: Signal, steps: Steps, rule: Rule, run: Loops, start: Values, *, body: bool = False) -> Values:
    """The attitudes at the instants.

    Args:
        omega: in world axes, S' = [omega]x S, or in body axes, S' = S [omega]x. The latter is the former for S^T
            and -omega; what a step makes of omega depends on h omega only, so that -h serves.
        steps: between the instants.
        rule: that makes a rotation of each step.
        run: the loops.
        start: the attitude at the first instant, a unit quaternion (w, x, y, z).
        body: whether omega is in body axes.

    Returns:
        Unit quaternions, shape (N, 4), without a jump of their sign.
    """
    found = np.empty((len(steps.t), 4))
    found[0] = start * _INVERSE if body else start
    slabs = steps.slabs()
    for first, last in slabs:
        begin, (h, _), ends = steps.within(first, last)
        target = found[first + 1 : last + 1]
        rows = target if ends is None else np.empty((len(h), 4))
        given = np.ascontiguousarray(omega.nodes(begin, h, rule.nodes))
        run.turns(given, -h if body else h, rule.number, rows)
        if ends is not None:
            target[:] = rows[ends]
    carries = found[[first for first, _ in slabs]].T.copy()
    _scan_quaternions(carries)
    for (first, last), carry in zip(slabs, carries.T, strict=True):
        run.place(found[first + 1 : last + 1], carry / np.sqrt(carry @ carry))
    _check_finite("omega1", "angles of each step that have a sine", found)
    if body:
        found *= _INVERSE
    return found


@np.errstate(all="ignore")
def angles(name: str, psid: Signal, psi_0: float, steps: Steps, rule: Rule, run: Loops) -> Values:
    """Angles at the instants from their rate, which has a name, to the last bit or so of the sum; shape (N,)."""
    if isinstance(psid, Constant):
        apart = compensated.exact_sum(steps.t, -steps.t[0])
        found = np.stack(
            compensated.pair_sum(compensated.pair_product((psid.value, 0.0), apart), (psi_0, 0.0)), axis=-1
        )
        _check_finite(name, "a rate whose integral is finite", found)
        return found[:, 0].copy()
    found = np.zeros((len(steps.t), 2))
    slabs = steps.slabs()
    for first, last in slabs:
        begin, h, ends = steps.within(first, last)
        target = found[first + 1 : last + 1]
        rows = target if ends is None else np.empty((len(h[0]), 2))
        run.sums(np.ascontiguousarray(psid.nodes(begin, h[0], rule.nodes)), *h, rule.number, rows)
        if ends is not None:
            target[:] = rows[ends]
    carries = found[[first for first, _ in slabs]].T.copy()
    carries[0, :1] = psi_0
    scan((carries[0], carries[1]), compensated.pair_sum)
    for (first, last), carry in zip(slabs, carries.T, strict=True):
        rows = found[first + 1 : last + 1]
        rows[:, 0], rows[:, 1] = compensated.pair_sum((rows[:, 0], rows[:, 1]), (carry[0], carry[1]))
    found[0, 0] = psi_0
    _check_finite(name, "a rate whose integral is finite", found)
    return found[:, 0].copy()


def _check_finite(name: str, expected: str, rows: Values) -> None:
    """Refuse what has overflowed on the way, which the last row shows; names the first interval that did."""
    if not np.isfinite(rows[-1]).all():
        first = int(np.argmin(np.isfinite(rows).all(axis=1)))
        raise ArgumentError(name, expected, f"overflow between the instants {first - 1} and {first}")


@np.errstate(all="ignore")
def increment_quaternions(omega: Values, h: Values, number: int) -> Any:
    """The rotation of each step by a rule's number; omega at the nodes, shape (steps, nodes, 3)."""
    w: Any = [components_of(omega[:, i]) for i in range(omega.shape[1])]
    if number == 4:
        x = inc.runge_kutta4(w[0], w[1], w[2], h)
        length = np.sqrt(sum(c * c for c in x))
        return tuple(c / length for c in x)
    if number == 3:
        first, second = inc.two_exponentials(w[0], w[1], h)
        return inc.quaternion_product(_exp(second), _exp(first))
    rules: dict[int, Callable[..., Any]] = {0: inc.midpoint, 1: inc.magnus4, 2: inc.magnus6}
    return _exp(rules[number](*w, h))


def _exp(Omega: Any) -> Any:
    x = np.sqrt(inc.half_turn(Omega))
    safe = np.where(x > 0, x, 1.0)
    return inc.quaternion_exp(Omega, (np.where(x > 0, np.sin(x) / safe, 1.0), np.cos(x)))


def _scan_quaternions(parts: Values) -> None:
    scan((parts[0], parts[1], parts[2], parts[3]), inc.quaternion_product)


def _turns(omega: Values, h: Values, number: int, rows: Values) -> None:
    parts = np.stack(increment_quaternions(omega, h, number))
    _scan_quaternions(parts)
    rows[:] = parts.T


def _place(rows: Values, carry: Values) -> None:
    product = inc.quaternion_product(components_of(rows), tuple(carry))
    for i, part in enumerate(inc.quaternion_unit(product)):
        rows[:, i] = part


def _sums(psid: Values, high: Values, low: Values, number: int, rows: Values) -> None:
    p, h = components_of(psid), (high, low)
    if number == 0:
        parts = compensated.one_node(p[0], h)
    elif number in {1, 3}:
        parts = compensated.two_nodes(p[0], p[1], h)
    else:
        parts = compensated.three_nodes(p[0], p[1], p[2], *((5.0, 8.0) if number == 2 else (1.0, 4.0)), h)
    scan(parts, compensated.pair_sum)
    rows[:, 0], rows[:, 1] = parts
