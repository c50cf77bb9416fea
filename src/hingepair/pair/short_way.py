"""The short way from rows of coordinates to a state: one call of machine code, a microsecond beside the kernel's own.

It is taken where a compiled kernel is there and was asked for a few times in the same words, by contiguous arrays of
float64; for all else it says None, and the long way computes, or says what is wrong. The bits are those of the long
way, which calls the same kernel.
"""

from __future__ import annotations

import ctypes
from typing import Any, Final

import numpy as np

from hingepair.evaluation.binding import bind
from hingepair.evaluation.plan import Plan, outputs_of
from hingepair.pair.constants import Constants
from hingepair.pair.evaluate import Out, loop_of
from hingepair.pair.states import PairState, record_of

WORTH: Final = 50
"""Calls by the long way after which the short one, whose making takes 20 milliseconds, is looked for."""

_empty = np.empty


class ShortWay:
    """What one pair is asked for in the same words again and again.

    Args:
        plan: what is computed.
        pair: the constants of one pair.
        given: how many of q, qd, qdd there are.
    """

    def __init__(self, plan: Plan, pair: Constants, given: int) -> None:
        self.plan = plan
        self.pair = pair
        self.given = given
        self.calls = 0
        self.one: Any = None
        self.record = record_of(plan.outputs, plan.kind)
        self.tails = [(name, outputs_of(plan.kind)[name].tail) for name in plan.outputs]

    def __call__(self, rows: tuple[Any, ...], out: Out) -> PairState | None:
        """The state; None where the long way must be taken."""
        if self.one is None and not self._open():
            return None
        if out is not None:
            if len(out) != len(self.tails):
                return None
            arrays: dict[str, Any] = {name: out.get(name) for name, _ in self.tails}
            done = self.many(self.table, *rows, *arrays.values())
            return PairState(arrays, rows[0].shape[:-1]) if done else None
        shape = getattr(rows[0], "shape", ())
        if len(shape) == 1:
            record = _empty((), self.record)
            return PairState.of_one(record) if self.one(self.table, *rows, record) else None
        if len(shape) != 2:
            return None
        samples = shape[:1]
        fresh = {name: _empty(samples + tail) for name, tail in self.tails}
        return PairState(fresh, samples) if self.many(self.table, *rows, *fresh.values()) else None

    def _open(self) -> bool:
        """Find the kernel, after some calls, and bind this pair's constants to it."""
        self.calls += 1
        if self.calls % WORTH:
            return False
        loop = loop_of(self.plan, True)
        own = {name: value for name, value in self.pair.values.items() if name in self.plan.inputs}
        rows: dict[str, tuple[int, ...]] = {name: tail for name, tail in loop.inputs if name not in own}
        if len(rows) != self.given:  # what no output needs would not be looked at
            return False
        bound = bind(loop.inputs, {**own, **{name: _empty((2, *tail)) for name, tail in rows.items()}})
        program = loop.program(bound.pattern)
        parts = tuple(int(np.prod(tail)) for _, tail in self.tails)
        front = program.front(((False,) * len(rows), parts, "d"))
        if front is None:
            return False
        from hingepair.evaluation.front import table_of

        self.constants = np.array(bound.constants, np.float64)
        self.lines = table_of(self.constants, [tail[0] for tail in rows.values()], [tail for _, tail in self.tails])
        self.table = ctypes.c_void_p(ctypes.addressof(self.lines))
        self.many, self.one = front.many, front.one
        return True
