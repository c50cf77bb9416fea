"""One state at a time: generated Python, or the kernel of batches with all of its lanes on the one sample."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import MissingDependencyError
from hingepair.evaluation.backend import Account, give_up
from hingepair.evaluation.binding import address, bind
from hingepair.evaluation.llvm_ir import SCATTERED
from hingepair.evaluation.loops import Loop

Values = dict[str, Any]


class _Slot:
    """Memory that a kernel reads and writes, at addresses that need not be asked for again."""

    def __init__(self, constants: Sequence[float], inputs: Sequence[int], outputs: Sequence[int]) -> None:
        self.constants = np.array(constants, np.float64)
        self.inputs = np.zeros(sum(inputs))
        self.outputs = np.zeros(sum(outputs))
        self.views = np.split(self.inputs, np.cumsum(inputs)[:-1])
        lines = [(address(self.constants), 0, 0, 8, 0)] if len(constants) else []
        for array, counts in ((self.inputs, inputs), (self.outputs, outputs)):
            at = address(array)
            for count in counts:
                lines.append((at, 0, 0, 8, SCATTERED))
                at += 8 * count
        self.table = (ctypes.c_int64 * (5 * len(lines)))(*(field for line in lines for field in line))


class OneState:
    """A loop of one state, of float64: some inputs are constants, the others come with each call.

    Args:
        loop: what to compute.
        constants: inputs that stay, as tuples of floats.
        backend: "compiled" from the first call on, "numpy" for generated Python, "auto" for what pays.
    """

    def __init__(self, loop: Loop, constants: Values, backend: str) -> None:
        moving = {name: tail for name, tail in loop.inputs if name not in constants}
        bound = bind(loop.inputs, {**constants, **{name: np.empty((2, *tail)) for name, tail in moving.items()}})
        self.program = loop.program(bound.pattern)
        self.constants = bound.constants
        self.names = tuple(moving)
        self.inputs = [math.prod(tail) for tail in moving.values()]
        self.outputs = tuple(math.prod(tail) for _, tail in loop.outputs)
        self.key = (False,) * len(self.inputs), self.outputs, "d"
        self.slots: list[_Slot] = []
        self.account = Account(self.program.operations)
        self.backend = backend
        self.kernel: Any = None
        if backend == "compiled":
            self.kernel = self.program.kernel(*self.key).run_one
        else:
            self.function = self.program.floats_function

    def __call__(self, parts: Sequence[Any]) -> NDArray[np.float64]:
        """The outputs, one after the other, in a new array.

        Args:
            parts: of each input that comes with the call, a flat array or list of floats.
        """
        if self.kernel is None:
            if self.backend == "auto" and self.account.pays_one():
                self._compile()
            return np.array(self.function(*self.constants, *(x for part in parts for x in part)))
        try:
            slot = self.slots.pop()
        except IndexError:
            slot = _Slot(self.constants, self.inputs, self.outputs)
        for view, part in zip(slot.views, parts, strict=True):
            view[:] = part
        self.kernel(slot.table, 1, 1)
        found = slot.outputs.copy()
        self.slots.append(slot)
        return found

    def _compile(self) -> None:
        try:
            self.kernel = self.program.kernel(*self.key).run_one
        except MissingDependencyError as error:
            give_up(error)
