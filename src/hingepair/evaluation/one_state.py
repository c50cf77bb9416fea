"""One state at a time: generated Python, or the kernel of batches with all of its lanes on the one sample."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError
from hingepair.evaluation.backend import Account
from hingepair.evaluation.binding import bind
from hingepair.evaluation.loops import Loop


class OneState:
    """A loop of one state, of float64: some inputs are constants, the others come with each call.

    Args:
        loop: what to compute.
        constants: inputs that stay, as tuples of floats.
        backend: "compiled" from the first call on, "numpy" for generated Python, "auto" for what pays.
    """

    def __init__(self, loop: Loop, constants: dict[str, Any], backend: str) -> None:
        self._moving = {name: tail for name, tail in loop.inputs if name not in constants}
        some = {name: np.empty((2, *tail)) for name, tail in self._moving.items()}
        bound = bind(loop.inputs, {**constants, **some})
        self._numbers, self._constants = bound.constants, np.array(bound.constants)
        self._program = loop.program(bound.pattern)
        counts = tuple(math.prod(tail) for _, tail in loop.outputs)
        self._size, self._key = sum(counts), ((False,) * len(some), counts, "d")
        self._account, self._may_compile = Account(self._program.operations), backend == "auto"
        self._run: Callable[..., bool] | None = None
        if backend == "compiled":
            self._run = self._program.kernel(*self._key).run_objects

    def __call__(self, values: Mapping[str, Any]) -> NDArray[np.float64]:
        """The outputs, one after the other, in a new array; of floats, arrays of float64, and tuples of floats."""
        if self._may_compile and self._account.pays_one():
            self._may_compile = False
            if self._program.can_have(self._key):
                self._run = self._program.kernel(*self._key).run_objects
        if self._run is None:
            return np.array(self._program.floats_function(*self._numbers, *self._flat(values)))
        buffer = np.empty(self._size)
        given = [values[name] for name in self._moving]
        if self._run(*given, self._constants, buffer):  # it takes arrays of float64 side by side
            return buffer
        if self._run(*(np.array(value, np.float64, order="C") for value in given), self._constants, buffer):
            return buffer
        raise ArgumentError("values", f"arrays of shapes {self._moving}", [np.shape(value) for value in given])

    def _flat(self, values: Mapping[str, Any]) -> list[float]:
        found: list[float] = []
        for name in self._moving:
            value = values[name]
            found += (
                value.ravel().tolist()
                if isinstance(value, np.ndarray)
                else value
                if type(value) is tuple
                else [value]
            )
        return found
