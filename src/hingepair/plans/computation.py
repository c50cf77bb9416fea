"""Computations: outputs of one pair or robot, and the calls that compute them, by what is given."""

from __future__ import annotations

import functools
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from hingepair.engine.backend import Execution
from hingepair.engine.binding import ArrayShape
from hingepair.engine.calls import Call
from hingepair.engine.loops import Loop
from hingepair.engine.results import Results
from hingepair.errors import ArgumentError, RotationError, ShapeError
from hingepair.plans import dask_chunks
from hingepair.plans.arguments import CoordinateNames, check_out, read_arguments
from hingepair.plans.dask_chunks import is_dask
from hingepair.plans.derivatives import Derivative, derivative_loop
from hingepair.rotations.matrices import MAX_ORTHOGONALITY_ERRORS, check_rotation

QUATERNION_INPUTS: Final = ("quat_xyzw", "quat_wxyz")  # inputs that can replace S1
_ATTITUDES: Final = ("S1", "S2", *QUATERNION_INPUTS)  # inputs that a prepared call checks
_MAX_CALLS: Final = 64  # most that a computation keeps, before it forgets all


@dataclass(slots=True, eq=False)
class Cache:
    """What is made once for a pair or a robot."""

    computations: dict[Any, Any] = field(default_factory=dict)  # by what is asked
    # by what is asked and given: calls that need the arrays alone, and what looks at their results
    calls: dict[Any, tuple[Call, Any]] = field(default_factory=dict)
    others: dict[Any, Any] = field(default_factory=dict)  # extended constants
    # whether the base is among the bodies whose masses were warned of, as assumed or impossible: True, False or both
    warned: set[bool] = field(default_factory=set)
    warned_of_loads: bool = False  # of joints that are left out


class Computation:
    """Outputs of one pair or robot, from arguments of any names.

    Args:
        loop: function of the names of outputs and of arguments; returns the loop that computes them.
        outputs: names of the outputs.
        shapes: shape of one sample of each argument that may be given.
        known: values of the inputs that need not be given.
        result: class of the result; None to return the only output as a bare array.
        coordinates: names of the coordinates.
        owner: name of the constants in messages, such as "pair", or of those of them that have samples.
        shape: leading shape of a pair whose geometry has axes.
        shared: whether few samples of a plain call are computed by a kernel for any constants.
        constant_shapes: shapes of the constants by which outputs can be differentiated.
        by_constants: returns the computation whose derivatives by constants are taken; by default this one.
    """

    def __init__(
        self,
        loop: Callable[[tuple[str, ...], tuple[str, ...]], Loop],
        outputs: tuple[str, ...],
        shapes: Mapping[str, ArrayShape],
        known: Mapping[str, Any],
        result: type[Results] | None,
        coordinates: CoordinateNames,
        *,
        owner: str = "pair",
        shape: ArrayShape = (),
        shared: bool = False,
        constant_shapes: Mapping[str, ArrayShape] | None = None,
        by_constants: Callable[[], Computation] | None = None,
    ) -> None:
        self.outputs, self.shapes, self.known = outputs, shapes, known
        self.result, self.coordinates = result, coordinates
        self._loop, self.owner, self._shape, self._shared = loop, owner, shape, shared
        self.constant_shapes, self._by_constants = constant_shapes or {}, by_constants
        self.asked: tuple[Any, ...] = ()  # by which the method `computation` of a pair or robot makes it anew
        self._calls: dict[Any, Call] = {}
        self._sufficient: set[tuple[str, ...]] = set()  # names of arguments that suffice

    def call(
        self,
        given: tuple[str, ...],
        backend: str,
        gravity: tuple[float, ...] | None = None,
        *,
        prepared: bool = False,
        derivatives: tuple[Derivative, ...] = (),
    ) -> Call:
        """Return the cached call of the outputs, or of their derivatives, for arguments of these names.

        Args:
            given: names of the arguments, in order.
            backend: one of `engine.backend.BACKEND_NAMES`.
            gravity: acceleration of free fall [m/s^2], where outputs depend on it.
            prepared: check attitudes among the arguments, and fold the constants of this pair or robot.
            derivatives: what is computed in place of the outputs, each the derivative of the one before; weights and
                changes are arguments, too.
        """
        key = given, backend, gravity, prepared, derivatives
        call = self._calls.get(key)
        if call is None:
            checks = {f"{name}_check": _limits(name) for name in given if name in _ATTITUDES} if prepared else {}
            loop = self._loop((*self.outputs, *checks), given)
            for one in derivatives:
                loop = derivative_loop(loop, one)
            shapes = {**self.shapes, **dict(loop.inputs)}
            known = self.known if gravity is None else {**self.known, "gravity": gravity}
            call = Call(
                loop, {name: shapes[name] for name in given},
                {name: known[name] for name, _ in loop.inputs if name not in given},
                Results if derivatives else self.result,
                shape=self._shape, backend=backend, constants_name=self.owner,
                shared=self._shared and not prepared, limits=checks, on_limit=_check_attitudes,
            )  # fmt: skip
            if len(self._calls) >= _MAX_CALLS:
                self._calls.clear()
            self._calls[key] = call
        return call

    @property
    def by_constants(self) -> Computation:
        """The computation whose derivatives by constants are taken."""
        return self if self._by_constants is None else self._by_constants()

    def check_given(self, given: Collection[str], labels: Mapping[str, str] | None = None) -> None:
        """Refuse arguments of these names if they do not suffice for the outputs.

        Raises:
            ArgumentError: an output needs an input that is neither given nor known.
        """
        names = tuple(given)
        if names not in self._sufficient:
            for output in self.outputs:
                for name in self.missing_inputs(output, names):
                    label = (labels or {}).get(name, name)
                    raise ArgumentError(label, f"a value, since output {output} needs it", None)
            self._sufficient.add(names)

    def missing_inputs(self, output: str, given: tuple[str, ...]) -> list[str]:
        """Return the names of the inputs, gravity apart, that an output needs beside what is given and known."""
        needed = (name for name, _ in self._loop((output,), given).inputs)
        return [name for name in needed if name not in given and name not in self.known and name != "gravity"]

    def compute(
        self,
        given: Mapping[str, Any],
        execution: Execution,
        gravity: tuple[float, ...] | None = None,
        out: Any = None,
        *,
        labels: Mapping[str, str] | None = None,
        remade: Callable[[], Computation] | None = None,
    ) -> Any:
        """Compute a plain call with arguments of any form, Dask arrays among them.

        Args:
            given: the arguments by input name, as users give them.
            execution: backend and number of threads.
            gravity: acceleration of free fall [m/s^2], where outputs depend on it.
            out: arrays to write into.
            labels: names of inputs in messages, where they differ.
            remade: function that can be pickled and makes this computation anew; without it, Dask arrays are refused.
        """
        self.check_given(given, labels)
        call = self.call(tuple(given), execution.backend, gravity)
        if remade is not None and any(map(is_dask, given.values())):
            function = functools.partial(_compute_chunk, remade, execution, gravity, tuple(given))
            return self.over_chunks(call, function, given, out, labels)
        return self.answer(call, given, out, execution.workers, labels)

    def answer(
        self, call: Call, given: Mapping[str, Any], out: Any, workers: int, labels: Mapping[str, str] | None = None
    ) -> Any:
        """Return the results of a call for arguments of any form; see `compute`."""
        out = check_out(out, call.outputs)
        result = call.rows(*given.values(), out=out, workers=workers)
        if result is None:
            values, shapes, labels = read_arguments(given, call.argument_shapes, self.coordinates, labels)
            result = call.run(values, shapes, out, workers, None, labels)
        return result

    def over_chunks(
        self,
        call: Call,
        function: Callable[..., Any],
        given: Mapping[str, Any],
        out: Any,
        labels: Mapping[str, str] | None = None,
    ) -> Any:
        """Return the results for arguments among which are Dask arrays, as lazy Dask arrays; `function` computes the
        call for the arrays of a chunk, and can be pickled.
        """
        dask_chunks.refuse_out(out)
        if self._shape:
            raise ShapeError(self.owner, "no samples, since the arguments are Dask arrays", f"{self._shape}")
        named = {(labels or {}).get(name, name): value for name, value in given.items()}
        outputs = {name: tail for name, tail in call.loop.outputs if name in self.outputs}
        arrays = dask_chunks.over_chunks(function, named, [*call.argument_shapes.values()], outputs)
        first = next(iter(arrays.values()))
        axes = first.ndim - len(next(iter(outputs.values())))
        return first if self.result is None else self.result(arrays, first.shape[:axes])

    def count_operations(self, values: Mapping[str, Any], gravity: tuple[float, ...] | None = None) -> int:
        """Count the operations for each sample of a call in which numbers among these values are known."""
        loop = self._loop(self.outputs, tuple(values))
        arrays = {name: np.empty((2, *tail)) for name, tail in loop.inputs}
        known = self.known if gravity is None else {**self.known, "gravity": gravity}
        return loop.count_operations({**arrays, **known, **values})


def _compute_chunk(
    remade: Callable[[], Computation],
    execution: Execution,
    gravity: tuple[float, ...] | None,
    names: tuple[str, ...],
    *arrays: Any,
) -> Any:
    """Compute one chunk of Dask arrays."""
    return remade().compute(dict(zip(names, arrays, strict=True)), execution, gravity)


def _limits(name: str) -> Mapping[int, float]:
    """Return the limits of the check of an attitude, by the size of a number in bytes."""
    return {8: 1.0, 4: 1.0} if name in QUATERNION_INPUTS else MAX_ORTHOGONALITY_ERRORS  # of a zero, 2


def _check_attitudes(values: Mapping[str, Any], labels: Mapping[str, str] | None = None) -> None:
    """Raise a RotationError for a matrix that is no rotation, or a quaternion that is zero."""
    for name, value in values.items():
        if name in QUATERNION_INPUTS and (np.asarray(value) == 0).all(axis=-1).any():
            raise RotationError(name, "non-zero quaternions", "a zero quaternion")
        if name in ("S1", "S2"):
            check_rotation((labels or {}).get(name, name), np.asarray(value))
