"""Prepared calls of a robot: planned, checked and compiled once for arguments of given names."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np

from hingepair.engine.backend import Execution
from hingepair.engine.calls import Call, Out
from hingepair.engine.loops import OperationCounts
from hingepair.engine.results import Results, writable_arrays
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
from hingepair.numeric.arrays import FloatArray, vectors
from hingepair.plans.derivatives import Derivative

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
        values = self._checked_values(self._call, dict(zip(self.given, arguments, strict=True)), {})
        return self._computation.run(values, self._gravity, out, self._execution, check_attitude=True)

    def _checked_values(self, call: Call, arguments: Mapping[str, Any], labels: Mapping[str, str]) -> InputValues:
        """Check arguments of a call by name, and return them in the form that programs take."""
        library = common_library({labels.get(name, name): value for name, value in arguments.items()})
        parts, shapes = {}, {}
        for name, value in arguments.items():
            label, tail = labels.get(name, name), call.argument_shapes[name]
            if value is None:
                raise ArgumentError(label, "a value, since the call was prepared for it", None)
            if name.removeprefix("change_") in _JOINT_ARGUMENT_NAMES:
                parts[name], shapes[label] = read_coordinates(label, value, self._joints, library)
                continue
            if library is not None:
                check_sample_shape(label, value, *tail)
            parts[name] = value if library is not None else vectors(label, value, *tail)
            shapes[label] = tuple(np.shape(value)[: np.ndim(value) - len(tail)])
        return InputValues(parts, shapes, library, labels)

    # ---- derivatives

    def jacobian(
        self, given: Sequence[Any], wrt: str | Iterable[str] | None = None, *, out: Any = None
    ) -> dict[str, dict[str, FloatArray]]:
        """Compute the derivatives of all outputs by arguments, exactly up to rounding.

        Args:
            given: the arguments, as a tuple in the order of the call.
            wrt: names of arguments out of `given`; by default all.
            out: arrays to write into, in the form of the result.

        Returns:
            {output: {argument: array}}. The shape of an array is (..., shape of the output, shape of the argument),
            such as (..., dof, dof) of tau by q. A rotation matrix (S of frames, S1) counts as three numbers: it
            changes along rotations about the axes of the world [rad]. The first call for a choice of arguments
            compiles.

        Raises:
            ArgumentError: an argument cannot be used, or the robot has too many joints.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> f = hp.load_robot("ur5_robot").prepare("inverse_dynamics", outputs=("tau",))
        >>> q, qd, qdd = np.zeros((3, 6))
        >>> f.jacobian((q, qd, qdd), wrt=("q", "qd"))["tau"]["q"].shape
        (6, 6)
        """
        names = self._names("wrt", self.given if wrt is None else (wrt,) if isinstance(wrt, str) else wrt, self.given)
        places = {f"{one}_{name}": (one, name) for one in self.outputs for name in names}
        flat = None
        if out is not None:
            form = {one: [*names] for one in self.outputs}
            if not isinstance(out, dict) or {one: [*part] for one, part in out.items()} != form:
                raise ArgumentError("out", f"a dict of dicts of arrays, with the names {form}", quoted(out))
            flat = {key: out[one][name] for key, (one, name) in places.items()}
        try:
            arrays = writable_arrays(self._derive("jacobian", self.outputs, names, given, {}, {}, flat))
        except ArgumentError as error:
            labels = {f"out[{key!r}]": f"out[{one!r}][{name!r}]" for key, (one, name) in places.items()}
            if error.name in labels:
                raise error.renamed(labels[error.name]) from None
            raise
        return {one: {name: arrays[f"{one}_{name}"] for name in names} for one in self.outputs}

    def vjp(self, given: Sequence[Any], cotangents: Mapping[str, Any]) -> tuple[Any, dict[str, FloatArray]]:
        """Compute the results of the call, and the gradient of a weighted sum of outputs by every argument.

        Args:
            given: the arguments, as a tuple in the order of the call.
            cotangents: weights by output, each of the shape of the output; for a rotation matrix three, those of
                rotations about the axes of the world. Outputs without weights do not count.

        Returns:
            (value, gradient): what the call returns, and a dict of arrays by argument. The gradient of each sample is
            its own: it is not summed over samples that share an argument.

        Raises:
            ArgumentError: an argument cannot be used, or the robot has too many joints.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> f = hp.load_robot("ur5_robot").prepare("inverse_dynamics", outputs=("tau",))
        >>> value, gradient = f.vjp(tuple(np.zeros((3, 6))), {"tau": np.ones(6)})
        >>> value.tau.shape, gradient["q"].shape
        ((6,), (6,))
        """
        outputs = self._names("cotangents", cotangents, self.outputs)
        weights = {f"weight_{name}": cotangents[name] for name in outputs}
        labels = {f"weight_{name}": f"cotangents[{name!r}]" for name in outputs}
        found = self._derive("vjp", outputs, self.given, given, weights, labels)
        return self._value(found), {name: writable_arrays(found)[f"gradient_{name}"] for name in self.given}

    def jvp(self, given: Sequence[Any], tangents: Mapping[str, Any]) -> tuple[Any, dict[str, FloatArray]]:
        """Compute the results of the call, and their rates of change for given rates of change of arguments.

        Args:
            given: the arguments, as a tuple in the order of the call.
            tangents: rates of change by argument, each of the shape of the argument; for S1 an angular velocity, axes
                of the world. All other arguments do not change.

        Returns:
            (value, tangent): what the call returns, and a dict of the rates of change by output; that of a rotation
            matrix is an angular velocity, axes of the world.

        Raises:
            ArgumentError: an argument cannot be used, or the robot has too many joints.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> f = hp.load_robot("ur5_robot").prepare("pose", frames="tool0")
        >>> value, tangent = f.jvp((np.zeros(6),), {"q": np.ones(6)})
        >>> value.S.shape, tangent["S"].shape
        ((1, 3, 3), (1, 3))
        """
        names = self._names("tangents", tangents, self.given)
        changes = {f"change_{name}": tangents[name] for name in names}
        labels = {f"change_{name}": f"tangents[{name!r}]" for name in names}
        found = self._derive("jvp", self.outputs, names, given, changes, labels)
        return self._value(found), {name: writable_arrays(found)[f"rate_{name}"] for name in self.outputs}

    def _derive(
        self,
        kind: str,
        outputs: tuple[str, ...],
        names: tuple[str, ...],
        given: Sequence[Any],
        further: Mapping[str, Any],
        labels: Mapping[str, str],
        out: Out = None,
    ) -> Results:
        """Compute a derivative of these outputs by the arguments with these names; `further` are its weights or
        changes.
        """
        if not isinstance(given, tuple | list) or len(given) != len(self.given):
            raise ArgumentError("given", f"a tuple of {', '.join(self.given)}", quoted(given))
        shapes = self._call.argument_shapes
        derivative = Derivative(kind, outputs, tuple((name, shapes[name]) for name in names))
        self._computation.check_differentiable(derivative)
        arguments = {**dict(zip(self.given, given, strict=True)), **further}
        call = self._computation.call(
            tuple(arguments), self._gravity, self._execution.backend, check_attitude=True, derivative=derivative
        )
        result: Results | None = call.rows(*arguments.values(), out=out, workers=self._execution.workers)
        if result is None:
            values = self._checked_values(call, arguments, labels)
            result = self._computation.run(
                values, self._gravity, out, self._execution, check_attitude=True, derivative=derivative
            )
        return result

    def _names(self, argument: str, names: Iterable[Any], accepted: tuple[str, ...]) -> tuple[str, ...]:
        """Check names of arguments or outputs, and return them in the order of the call."""
        if argument != "wrt" and not isinstance(names, Mapping):
            raise ArgumentError(argument, f"a dict of arrays, with names out of {', '.join(accepted)}", quoted(names))
        chosen = [*names] if isinstance(names, Iterable) else []
        for name in chosen:
            if name not in accepted:
                raise ArgumentError(argument, f"names out of {', '.join(accepted)}", quoted(name))
        if not chosen:
            raise ArgumentError(argument, f"at least one of {', '.join(accepted)}", quoted(names))
        return tuple(name for name in accepted if name in chosen)

    def _value(self, found: Results) -> Any:
        """Return the results of the call itself out of those of a derivative."""
        arrays = {name: one for name, one in writable_arrays(found).items() if name in self.outputs}
        kind = self._computation.result
        return arrays[self.outputs[0]] if kind is None else kind(arrays, found.shape)


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
