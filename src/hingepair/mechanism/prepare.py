"""What a robot's call can be prepared for: the names that it will bring, and what is computed of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

import numpy as np

from hingepair.engine.backend import Execution
from hingepair.engine.calls import Call, Out
from hingepair.engine.loops import OperationCounts
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.mechanism.arguments import (
    LETTERS,
    NO_LOADS,
    Values,
    library_among,
    read_coordinates,
    read_out,
)
from hingepair.mechanism.evaluate import Problem
from hingepair.numeric.array_libraries import check_tail
from hingepair.numeric.arrays import vectors

KINDS: Final = {
    "pose": ("q",),
    "velocity": ("q", "qd"),
    "acceleration": ("q", "qd", "qdd"),
    "jacobian": ("q",),
    "acceleration_bias": ("q", "qd"),
    "inverse_dynamics": ("q", "qd", "qdd"),
    "forward_dynamics": ("q", "qd", "tau"),
    "mass_matrix": ("q",),
    "bias_forces": ("q", "qd"),
    "gravity_forces": ("q",),
}
"""The arguments of a prepared call, by what it is prepared for."""

ARRAYS: Final = ("jacobian", "acceleration_bias", "mass_matrix", "bias_forces", "gravity_forces")
"""What is one array, as the method of that name returns it."""

_COORDINATES: Final = ("q", "qd", "qdd", "tau")
_NAMES: Final = (*_COORDINATES, *LETTERS, *NO_LOADS)


class PreparedMechanism:
    """What `Mechanism.prepare` gives: call it with arrays in the order of `given`, and `out=`.

    Attributes:
        given: names of what it takes, in order.
        outputs: names of what it computes.
    """

    def __init__(
        self,
        problem: Problem,
        joints: tuple[str, ...],
        given: tuple[str, ...],
        gravity: tuple[float, ...],
        execution: Execution,
        remade: Callable[[], Any],
    ) -> None:
        self.given, self.outputs = given, problem.request.outputs
        self._joints = joints
        self._problem, self._gravity, self._execution, self._remade = problem, gravity, execution, remade
        self._call: Call = problem.call(given, gravity, execution.backend, checked=True)
        if execution.backend == "auto":
            self._call.compile()

    def __repr__(self) -> str:
        return f"PreparedMechanism(given={self.given}, outputs={self.outputs})"

    def __str__(self) -> str:
        count = self.operations
        once = f", {count.shared} once for all samples" if count.shared else ""
        left = f"{count.per_sample} operations for each sample{once}, of {count.unfolded} where nothing is known"
        return f"{', '.join(self.outputs)} from {', '.join(self.given)}: {left}"

    def __reduce__(self) -> tuple[Any, ...]:
        return _called, (self._remade,)

    @property
    def source(self) -> str:
        """The Python code that runs where nothing is compiled."""
        return self._call.program.source

    @property
    def llvm(self) -> str:
        """The LLVM code that runs for one state and for rows of states."""
        return self._call.kernel.ir

    @property
    def operations(self) -> OperationCounts:
        """How many operations are left for each sample, once for all, and where nothing is known beforehand."""
        return self._problem.count_operations()

    def __call__(self, *given: Any, out: Any = None) -> Any:
        """Return the results: of one state or many.

        Args:
            *given: what it was prepared for, in that order; shape (..., dof), of the base (..., 3) or (..., 3, 3).
                Coordinates may be tables or values by joint too, as in the methods, which takes longer.
            out: arrays by output name, written in place; of a call that returns one array, that array.

        Raises:
            ArgumentError: an argument cannot be used; names it.
        """
        if out is None:
            try:
                result = self._call.fast_path(*given)
            except TypeError:
                result = None  # perhaps another number of arguments
            return self._general(given, None) if result is None else result
        arrays = {self.outputs[0]: out} if self._problem.result is None else out
        if type(arrays) is dict and arrays.keys() <= {*self.outputs} and len(given) == len(self.given):
            result = self._call.run_into(given, arrays)
            if result is not None:
                return result
        return self._general(given, arrays)

    def _general(self, given: Sequence[Any], out: Out) -> Any:
        """Return the results for anything that can be used; refuse the rest."""
        if len(given) != len(self.given):
            raise ArgumentError("*given", f"{len(self.given)} arguments: {', '.join(self.given)}", f"{len(given)}")
        read_out(out, self.outputs)
        named = dict(zip(self.given, given, strict=True))
        library = library_among(named)
        parts, shapes, tails = {}, {}, self._call.argument_shapes
        for name, value in named.items():
            if value is None:
                raise ArgumentError(name, "a value, since this was prepared for it", None)
            if name in _COORDINATES:
                parts[name], shapes[name] = read_coordinates(name, value, self._joints, library)
                continue
            if library is not None:
                check_tail(name, value, *tails[name])
            parts[name] = value if library is not None else vectors(name, value, *tails[name])
            shapes[name] = tuple(np.shape(value)[: np.ndim(value) - len(tails[name])])
        return self._problem.run(Values(parts, shapes, library), self._gravity, out, self._execution, checked=True)


def _called(function: Callable[[], Any]) -> Any:
    return function()


def checked_given(given: str | Iterable[str], problem_inputs: Iterable[str] = ()) -> tuple[str, ...]:
    """Return the names of the arguments of a prepared call.

    Raises:
        ArgumentError: an unknown name, or one twice.
    """
    try:
        names = KINDS[given] if isinstance(given, str) else tuple(given)
    except (KeyError, TypeError):
        raise ArgumentError("given", f"{choices(tuple(KINDS))}, or a tuple of names", quoted(given)) from None
    for name in names:
        if name not in _NAMES:
            raise ArgumentError("given", choices(_NAMES), quoted(name))
    if len({*names}) < len(names):
        raise ArgumentError("given", "each name once", quoted(names))
    for name in problem_inputs:
        if name in _COORDINATES and name not in names:
            raise ArgumentError("given", f"{name} too, since the outputs need it", ", ".join(names))
    return names
