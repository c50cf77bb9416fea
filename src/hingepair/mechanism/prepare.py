"""Prepared calls of a robot: planned, checked and compiled once for arguments of given names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

import numpy as np

from hingepair.engine.backend import Execution
from hingepair.engine.calls import Call, Out
from hingepair.engine.loops import OperationCounts
from hingepair.errors import ArgumentError, choices, quoted
from hingepair.mechanism.arguments import (
    BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME,
    ZERO_BASE_LOAD_BY_INPUT_NAME,
    InputValues,
    check_out_names,
    common_library,
    read_coordinates,
)
from hingepair.mechanism.evaluate import RobotComputation
from hingepair.numeric.array_libraries import check_sample_shape
from hingepair.numeric.arrays import vectors

ARGUMENT_NAMES_BY_PREPARED_COMPUTATION_NAME: Final = {
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
"""Names of the arguments of a prepared call, by the method or level of motion for which it is prepared."""

_JOINT_ARGUMENT_NAMES: Final = ("q", "qd", "qdd", "tau")  # which have a component for each coordinate
# Names that the argument `given` of `prepare` may hold.
_ARGUMENT_NAMES_OF_PREPARED_CALLS: Final = (
    *_JOINT_ARGUMENT_NAMES,
    *BODY_MOTION_ATTRIBUTE_BY_BASE_INPUT_NAME,
    *ZERO_BASE_LOAD_BY_INPUT_NAME,
)


class PreparedMechanism:
    """Prepared call of a robot. It takes arrays for the arguments named in `given`, in this order, and optionally
    `out`, arrays to write into. It computes and returns the outputs named in `outputs`.

    Attributes:
        given: names of the arguments, in the order in which the callable takes them.
        outputs: names of the computed outputs.
    """

    def __init__(
        self,
        computation: RobotComputation,
        joints: tuple[str, ...],
        given: tuple[str, ...],
        gravity: tuple[float, ...],
        execution: Execution,
        factory: Callable[[], Any],
    ) -> None:
        self.given, self.outputs = given, computation.request.outputs
        self._joints = joints
        self._computation, self._gravity, self._execution, self._factory = computation, gravity, execution, factory
        self._call: Call = computation.call(given, gravity, execution.backend, check_attitude=True)
        if execution.backend == "auto":
            self._call.compile()

    def __repr__(self) -> str:
        return f"PreparedMechanism(given={self.given}, outputs={self.outputs})"

    def __str__(self) -> str:
        if not self._call.loop.traced:
            return f"{', '.join(self.outputs)} from {', '.join(self.given)}: joint by joint, without a program"
        count = self.operations
        once = f", {count.shared} once for all samples" if count.shared else ""
        left = f"{count.per_sample} operations for each sample{once}, of {count.unfolded} where nothing is known"
        return f"{', '.join(self.outputs)} from {', '.join(self.given)}: {left}"

    def __reduce__(self) -> tuple[Any, ...]:
        return _call_factory, (self._factory,)

    @property
    def source(self) -> str:
        """Generated Python code, as text, which is run if the call is not compiled."""
        return self._call.program.source

    @property
    def ufunc(self) -> np.ufunc:
        """The kernel itself, a generalised ufunc of NumPy such as "(7),(7),(7)->(7)". It follows NumPy's rules of
        broadcasting and casting (small integers, bool and float16 become float32), and checks no rotation. It stays
        in memory, cannot be pickled, and returns the outputs in order.
        """
        return self._call.ufunc

    @property
    def llvm(self) -> str:
        """LLVM code, as text, of the compiled function, which is run for one state and for many states."""
        return self._call.llvm

    @property
    def operations(self) -> OperationCounts:
        """Numbers of operations as OperationCounts, with the fields `per_sample` for each sample, `shared` once for
        all samples, and `unfolded` for a program in which no input is known.
        """
        samples = {name: np.empty((2, *self._call.argument_shapes[name])) for name in self.given}
        return self._computation.count_operations(samples, self._gravity)

    def __call__(self, *given: Any, out: Any = None) -> Any:
        """Compute and return the results for one state or many. Arrays in `out` are written in place.

        Args:
            *given: the arguments for which the call was prepared, in order. Coordinates have shape (..., dof),
                vectors of the base (..., 3), its attitude (..., 3, 3). Coordinates may also be tables or dicts by
                joint, as in the methods of the robot; such a call takes longer.
            out: arrays by output name, which are written in place; if the call returns a bare array, one such array.

        Raises:
            ArgumentError: an argument cannot be used; the message names it.
        """
        if len(given) != len(self.given):
            raise ArgumentError("*given", f"{len(self.given)} arguments: {', '.join(self.given)}", f"{len(given)}")
        if out is not None and self._computation.result is None:
            out = {self.outputs[0]: out}
        result = self._call.rows(*given, out=out, workers=self._execution.workers)
        return self._run_any_arguments(given, out) if result is None else result

    def _run_any_arguments(self, arguments: Sequence[Any], out: Out) -> Any:
        """Check arguments that the fast path refuses, such as tables and arrays of other libraries; compute and
        return the results. `arguments` are in the order of `given`. Write into the arrays of `out`, None or a dict by
        output name. Raise an ArgumentError if an argument cannot be used.
        """
        check_out_names(out, self.outputs)
        named = dict(zip(self.given, arguments, strict=True))
        library = common_library(named)
        parts, shapes, tails = {}, {}, self._call.argument_shapes
        for name, value in named.items():
            if value is None:
                raise ArgumentError(name, "a value, since the call was prepared for it", None)
            if name in _JOINT_ARGUMENT_NAMES:
                parts[name], shapes[name] = read_coordinates(name, value, self._joints, library)
                continue
            if library is not None:
                check_sample_shape(name, value, *tails[name])
            parts[name] = value if library is not None else vectors(name, value, *tails[name])
            shapes[name] = tuple(np.shape(value)[: np.ndim(value) - len(tails[name])])
        return self._computation.run(
            InputValues(parts, shapes, library), self._gravity, out, self._execution, check_attitude=True
        )


class WatchedPreparedMechanism(PreparedMechanism):
    """Prepared call whose accelerations may be NaN because the mass matrix is singular, of which `watch` warns."""

    def __init__(self, watch: Callable[[Any, Any], None], *arguments: Any) -> None:
        super().__init__(*arguments)
        self._watch = watch

    def __call__(self, *given: Any, out: Any = None) -> Any:
        """Compute as a PreparedMechanism does, and warn of a singular mass matrix."""
        result = super().__call__(*given, out=out)
        self._watch(result, given[self.given.index("q")])
        return result


def _call_factory(function: Callable[[], Any]) -> Any:
    """Call a function without arguments, and return its result; pickles of prepared calls are rebuilt by it."""
    return function()


def checked_given(given: str | Iterable[str], needed_inputs: Iterable[str] = ()) -> tuple[str, ...]:
    """Check the argument `given` of `prepare`, the name of a computation or an iterable of argument names, and return
    a tuple of the names of the call's arguments. Raise an ArgumentError for an unknown or repeated name, and if q,
    qd, qdd or tau is among `needed_inputs` but not among these names.

    Raises:
        ArgumentError: an unknown name, or one twice.
    """
    try:
        names = ARGUMENT_NAMES_BY_PREPARED_COMPUTATION_NAME[given] if isinstance(given, str) else tuple(given)
    except (KeyError, TypeError):
        raise ArgumentError(
            "given",
            f"{choices(tuple(ARGUMENT_NAMES_BY_PREPARED_COMPUTATION_NAME))}, or a tuple of names",
            quoted(given),
        ) from None
    for name in names:
        if name not in _ARGUMENT_NAMES_OF_PREPARED_CALLS:
            raise ArgumentError("given", choices(_ARGUMENT_NAMES_OF_PREPARED_CALLS), quoted(name))
    if len({*names}) < len(names):
        raise ArgumentError("given", "each name once", quoted(names))
    for name in needed_inputs:
        if name in _JOINT_ARGUMENT_NAMES and name not in names:
            raise ArgumentError("given", f"{name} too, since the outputs need it", ", ".join(names))
    return names
