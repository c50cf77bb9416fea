"""Calls: a loop with its constants, called with arrays of one state or of many.

call = Call(loop, {"psi": ()}, {"n": (0.0, 0.0, 1.0)}, Results)
call.rows(np.zeros(5))                         # arguments that are one array each: a ufunc of NumPy
call.run({"psi": np.zeros(5)}, {"psi": (5,)})  # arguments by components too, and the backend "numpy"
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.binding import ArrayShape, BoundConstant, ComponentSource, bind_constant
from hingepair.engine.loops import Loop, Program
from hingepair.engine.outputs import MIN_REUSED_BYTES, Out, output_arrays
from hingepair.engine.results import Results
from hingepair.engine.rows import Output, Rows, rows_function
from hingepair.engine.slices import run_slices
from hingepair.engine.ufunc import MAX_OPERANDS, Layout, Operand, Ufunc
from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.numeric.arrays import MAX_AXES, broadcast_shape, result_dtype
from hingepair.numeric.caching import lock_free_cached_property

if TYPE_CHECKING:
    from hingepair.engine.llvm.native import Kernel

_FLOAT64, _FLOAT32 = np.dtype(np.float64), np.dtype(np.float32)
_READ_CHARACTERS = frozenset("dfbhilqBHILQ")  # characters of the dtypes that are computed in float64 or float32
# Types of arguments that become an array of one state.
_SEQUENCES, _NUMBERS = {list, tuple}, {float, int, np.float64}
_WEAK = {float, int}  # numbers that take the dtype of the arrays beside them
# Samples below which calls share one kernel, in which no constant is folded, and components are joined for it.
_FEW_SAMPLES: Final = 20_000


class _Compiled(NamedTuple):
    """A kernel of a call, for one dtype."""

    ufunc: Ufunc
    rows: Rows
    most: int  # samples that `rows` computes, at most


class _Read(NamedTuple):
    """Arguments that are one array each, and what a call by a kernel needs to know of them."""

    arrays: list[NDArray[Any]]
    shape: ArrayShape  # of the samples
    dtype: np.dtype[Any]  # to compute in
    alike: bool  # whether no array is broadcast


class Call:
    """A loop with fixed constants, for arguments of given names.

    Args:
        loop: the loop to run.
        argument_shapes: shape of one sample of each argument, by name and in order. Arguments that the loop does not
            need are checked and broadcast too.
        constants: the loop's other inputs by name: numbers, or tuples of numbers; arrays where they have samples.
        result: class of the result; None to return the only output itself, as a writable array.
        shape: leading shape of the constants; () where they are the same at all samples.
        backend: one of `backend.BACKEND_NAMES`.
        limits: limits of outputs that are checked instead of returned, by the size of a number in bytes (8 for
            float64, 4 for float32). The call is refused if such an output exceeds its limit at any sample; NaN does
            not exceed it.
        on_limit: called with the arguments by name where a limit is exceeded; raises the error.
        constants_name: name of the constants in messages.
        samples_name: name in messages of the constants that have samples; by default `constants_name`.
        shared: whether few samples are computed by a kernel for any constants, which many calls share.

    Attributes:
        outputs: names of the returned outputs.
        has_kernels: whether kernels compute calls whose arguments are one array each.
        rows: function of the arguments in order, `out` and `workers`; returns the results, or None where `run` has to
            compute them or to say what cannot be used.
    """

    def __init__(
        self,
        loop: Loop,
        argument_shapes: Mapping[str, ArrayShape],
        constants: Mapping[str, Any],
        result: type[Results] | None,
        *,
        shape: ArrayShape = (),
        backend: str = "auto",
        limits: Mapping[str, Mapping[int, float]] | None = None,
        on_limit: Callable[[Mapping[str, Any]], None] | None = None,
        constants_name: str = "pair",
        samples_name: str | None = None,
        shared: bool = False,
    ) -> None:
        self.loop = loop
        self.argument_shapes = dict(argument_shapes)
        self.result = result
        self._constants = {name: value for name, value in constants.items() if name not in argument_shapes}
        self._shape, self._backend, self._constants_name = shape, backend, constants_name
        self._samples_name = samples_name or constants_name
        self._limits, self._on_limit = dict(limits or {}), on_limit
        self.outputs = tuple(name for name, _ in loop.outputs if name not in self._limits)
        self._bound_constants = {
            name: bind_constant(name, tail, self._constants[name])
            for name, tail in loop.inputs
            if name in self._constants
        }
        self._tails = tuple(self.argument_shapes.values())
        tails = [*self._tails, *(tail for _, tail in loop.outputs)]
        self.has_kernels = (
            backend != "numpy"
            and loop.traced
            and shape == ()
            and len(tails) <= MAX_OPERANDS
            and not any(0 in tail for tail in tails)
            and all(isinstance(one, BoundConstant) for one in self._bound_constants.values())
        )
        self._shared = shared and backend == "auto"
        self._compiled: dict[tuple[str, bool], _Compiled] = {}  # by dtype, and whether other calls share the kernel
        self.rows: Rows = self._any_rows
        if backend == "compiled":
            self.compile()

    # ---- kernels

    @lock_free_cached_property
    def program(self) -> Program:
        """The program for arguments that all vary from sample to sample, in which constants are folded."""
        return self._program(False)[0]

    def _program(self, shared: bool) -> tuple[Program, list[float]]:
        """Return the program for arguments that all vary, and its constant numbers, of which `shared` folds none."""
        places = {name: k for k, name in enumerate(self._used)}
        pattern: list[ComponentSource] = []
        constants: list[float] = []
        for name, tail in self.loop.inputs:
            count = math.prod(tail)
            bound = self._bound_constants.get(name)
            if name in places:
                pattern += [(places[name], k) for k in range(count)]
            elif not isinstance(bound, BoundConstant):  # constants that vary by sample: only for what is said of it
                pattern += [(len(places), k) for k in range(count)]
                places[name] = len(places)
            elif shared:
                pattern += [None] * count
                constants += np.array(bound.value, np.float64).ravel().tolist()
            else:
                pattern += bound.pattern
                constants += bound.constants
        return self.loop.program(tuple(pattern)), constants

    @lock_free_cached_property
    def _used(self) -> list[str]:
        """Arguments that the loop needs, in the order of the arguments."""
        needed = {name for name, _ in self.loop.inputs}
        return [name for name in self.argument_shapes if name in needed]

    def _layout(self, has_constants: bool) -> Layout:
        inputs = tuple(Operand(tail, name in self._used) for name, tail in self.argument_shapes.items())
        return Layout(inputs, tuple(Operand(tail) for _, tail in self.loop.outputs), has_constants)

    def compile(self) -> None:
        """Compile the kernel now; for the backend "auto" that is the one of calls of any number of samples.

        Raises:
            CompilationError: LLVM fails, and the backend is "compiled".
        """
        self._shared = False
        if self.has_kernels:
            self._kernel("d", False)

    def _check_constants(self, char: str) -> None:
        """Refuse constants that are infinite in float32 if that is the dtype to compute in."""
        if char != "f":
            return
        most = float(np.finfo(np.float32).max)
        for bound in self._bound_constants.values():
            value = bound.value if isinstance(bound, BoundConstant) else bound
            parts = value if isinstance(value, tuple) else (value,)
            largest = max((float(np.abs(part).max(initial=0.0)) for part in map(np.asarray, parts)), default=0.0)
            if most < largest < math.inf:
                expected = "numbers below 3.4e38, since the arguments are float32"
                raise ArgumentError(self._constants_name, expected, largest)

    def machine_code(self, char: str, shared: bool = False) -> tuple[Kernel, Layout, NDArray[Any] | None] | None:
        """Return the kernel for a dtype, its arrays, and its constants, if it has any; None if LLVM cannot compile it
        and the backend is "auto".
        """
        self._check_constants(char)
        program, numbers = self._program(shared)
        layout = self._layout(bool(numbers))
        kernel = (program.kernel if self._backend == "compiled" else program.kernel_or_none)(layout, char)
        return None if kernel is None else (kernel, layout, np.array(numbers, char) if numbers else None)

    def _kernel(self, char: str, shared: bool) -> _Compiled | None:
        """Return the kernel for a dtype; None if LLVM cannot compile it and the backend is "auto"."""
        compiled = self._compiled.get((char, shared))
        if compiled is not None:
            return compiled
        code = self.machine_code(char, shared)
        if code is None:
            return None
        kernel, layout, constants = code
        ufunc, packed = (
            Ufunc(self.loop.name, one, [(char, kernel.address(symbol), constants)], kernel)
            for one, symbol in ((layout, "loop"), (layout.packed, "packed"))
        )
        dtype = np.dtype(char)
        outputs = [
            Output(name, tail, self._limits[name][dtype.itemsize] if name in self._limits else None)
            for name, tail in self.loop.outputs
        ]
        width = max(math.prod(tail) for _, tail in self.loop.outputs) * dtype.itemsize
        most = min(_FEW_SAMPLES, MIN_REUSED_BYTES // max(1, width))  # of larger results the memory is used again
        rows = rows_function(
            layout, outputs, dtype, self.result, kernel=ufunc, packed=packed, most=most,
            general=self._any_rows, refuse=self._refuse,
        )  # fmt: skip
        if char == "d" and shared == self._shared:
            self.rows = rows
        compiled = self._compiled[char, shared] = _Compiled(ufunc, rows, most)
        return compiled

    @lock_free_cached_property
    def ufunc(self) -> np.ufunc:
        """The kernel as a ufunc of NumPy, of float64 and float32, without the outputs that are only checked.

        Raises:
            ArgumentError: an argument or output has no components, or they are too many for a ufunc.
            CompilationError: LLVM fails.
        """
        loop = self.loop
        if self._limits:
            outputs = {name: tail for name, tail in loop.outputs if name in self.outputs}
            loop = Loop(loop.name, loop.function, dict(loop.inputs), outputs, form=loop.form)
        call = Call(loop, self.argument_shapes, self._constants, None, shape=self._shape)
        if not call.has_kernels:
            raise ArgumentError("ufunc", "a call of single arrays of at least one number each", quoted(self.outputs))
        program, constants = call._program(False)
        layout, loops, kernels = call._layout(bool(constants)), [], []
        for char in "df":
            kernels.append(program.kernel(layout, char))
            with np.errstate(over="ignore"):
                numbers = np.array(constants, char)
            loops.append((char, kernels[-1].address("loop"), numbers if constants else None))
        doc = f"{', '.join(self.argument_shapes)} -> {', '.join(self.outputs)}"
        return Ufunc(self.loop.name, layout, loops, kernels, doc).publish()

    # ---- arguments that are one array each

    def _any_rows(self, *arguments: Any, out: Out = None, workers: int = 1) -> Any:
        """Return the results for single arrays, lists or numbers; None if `run` has to look at the arguments."""
        read = self._read(arguments) if self.has_kernels else None
        if read is None or (out is not None and not (type(out) is dict and out.keys() <= {*self.outputs})):
            return None
        arrays, shape, dtype, alike = read
        shared = self._shared and math.prod(shape) < _FEW_SAMPLES
        kernel = self._kernel(dtype.char, shared)
        if kernel is None:
            return None
        if out is None and alike and workers == 1 and math.prod(shape) < kernel.most:
            return kernel.rows(*[
                one if one.dtype is dtype and one.flags.c_contiguous else _copied(one, dtype) for one in arrays
            ])  # fmt: skip
        outputs = self._output_arrays(shape, dtype, out, dict(zip(self.argument_shapes, arrays, strict=True)))
        self._run_kernel(kernel.ufunc, arrays, outputs, shape, workers)
        self._check_limits(outputs, arguments, out)
        return self._make_result(outputs, shape)

    def _read(self, arguments: Sequence[Any]) -> _Read | None:
        """Return arguments as arrays; None where one is something else, or has another shape or dtype."""
        if len(arguments) != len(self._tails):
            return None
        arrays, leads, chars = [], [], set()
        for value, tail in zip(arguments, self._tails, strict=True):
            array = value if type(value) is np.ndarray else _state_array(value, tail)
            if array is None:
                return None
            axes = array.ndim - len(tail)
            if axes < 0 or array.shape[axes:] != tail or array.ndim > MAX_AXES:
                return None
            leads.append(array.shape[:axes])
            if array.dtype.char not in _READ_CHARACTERS:
                return None
            arrays.append(array)
            if type(value) not in _WEAK:
                chars.add(array.dtype.char)
        alike = len(set(leads)) == 1
        try:
            shape = leads[0] if alike else np.broadcast_shapes(*leads)
        except ValueError:
            return None
        return None if 0 in shape else _Read(arrays, shape, _FLOAT32 if chars == {"f"} else _FLOAT64, alike)

    def _run_kernel(
        self,
        ufunc: Ufunc,
        arrays: Sequence[NDArray[Any]],
        outputs: Mapping[str, NDArray[Any]],
        shape: ArrayShape,
        workers: int,
    ) -> None:
        """Compute the outputs of all samples into their arrays."""
        ranks = [*map(len, self._tails), *(len(tail) for _, tail in self.loop.outputs)]
        targets = [outputs[name] for name, _ in self.loop.outputs]
        operations = self.program.weighted_operations if workers > 1 else 1
        run_slices(ufunc, arrays, targets, ranks, shape, operations=operations, workers=workers)

    # ---- any arguments

    def run(
        self,
        values: Mapping[str, Any],
        shapes: Mapping[str, ArrayShape],
        out: Out = None,
        workers: int = 1,
        dtype: np.dtype[Any] | None = None,
        labels: Mapping[str, str] | None = None,
    ) -> Any:
        """Return the results for checked arguments of one state or of many. An array of `out` whose call is refused
        for the values of an argument may have been written.

        Args:
            values: the arguments by name: numbers, arrays, or tuples of components, each a number or an array.
            shapes: leading shape of the samples of each argument, by the name that messages use.
            out: arrays to write outputs into, by output name.
            workers: number of threads.
            dtype: dtype to compute in; by default float32 if all arrays are float32, else float64.
            labels: names of arguments in messages, where they are not those of the inputs.
        """
        shape = self._sample_shape(shapes)
        dtype = dtype or result_dtype(
            part for value in values.values() for part in (value if isinstance(value, tuple) else (value,))
        )
        self._check_constants(dtype.char)
        named = {labels.get(name, name): value for name, value in values.items()} if out and labels else values
        outputs = self._output_arrays(shape, dtype, out, named)
        kernel, few = None, math.prod(shape) < _FEW_SAMPLES
        if self.has_kernels and 0 not in shape and (few or not any(type(one) is tuple for one in values.values())):
            kernel = self._kernel(dtype.char, self._shared and few)
        if kernel is not None:
            arrays = [_joined(values[name], tail, dtype) for name, tail in self.argument_shapes.items()]
            self._run_kernel(kernel.ufunc, arrays, outputs, shape, workers)
        else:
            inputs = {**self._bound_constants, **values}
            self.loop.run(inputs, outputs, shape, dtype, Execution(self._backend, workers))
        self._check_limits(outputs, [values[name] for name in self.argument_shapes], out)
        return self._make_result(outputs, shape)

    def _sample_shape(self, shapes: Mapping[str, ArrayShape]) -> ArrayShape:
        """Return the leading shape of the results, to which those of the arguments and of the constants broadcast."""
        try:
            return broadcast_shape({**shapes, self._samples_name: self._shape})
        except ShapeError as error:
            if error.name != self._samples_name:
                raise
            combined = (*self._shape, *[1] * len(broadcast_shape(shapes)))
            got = f"{error.got}; shape {combined} combines each with every sample of the arguments"
            raise ShapeError(error.name, error.expected, got) from None

    def _output_arrays(
        self, shape: ArrayShape, dtype: np.dtype[Any], out: Out, inputs: Mapping[str, Any]
    ) -> dict[str, NDArray[Any]]:
        """Return the arrays to write the outputs into. Where there is one output, messages call it `out`."""
        try:
            return output_arrays(self.loop.outputs, shape, dtype, out, inputs)
        except ArgumentError as error:
            if self.result is not None or error.name != f"out[{self.outputs[0]!r}]":
                raise
            raise type(error)("out", error.expected, error.got) from None

    def _make_result(self, outputs: Mapping[str, Any], shape: ArrayShape) -> Any:
        """Return the result that holds these outputs, or the only output."""
        if self.result is None:
            return outputs[self.outputs[0]]
        return self.result({name: outputs[name] for name in self.outputs}, shape)

    # ---- limits

    def _check_limits(self, outputs: Mapping[str, Any], arguments: Sequence[Any], out: Out) -> None:
        """Refuse the arguments if an output exceeds its limit at any sample."""
        for name, limits in self._limits.items():
            array = outputs[name]
            if (array > limits[array.dtype.itemsize]).any():
                self._refuse(arguments, out is not None)

    def _refuse(self, arguments: Sequence[Any], written: bool) -> None:
        """Call `on_limit`, which raises an error, with the arguments by name; say whether `out` has been written."""
        if self._on_limit is None:
            return
        try:
            self._on_limit(dict(zip(self.argument_shapes, arguments, strict=True)))
        except ArgumentError as error:
            if written:
                error.add_note("The arrays of `out` have been written.")
            raise


def _copied(array: NDArray[Any], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return a contiguous copy of this very dtype; np.array keeps one that is equal, as arrays from pickles have."""
    copied = np.empty(array.shape, dtype)
    copied[...] = array
    return copied


def _state_array(value: Any, tail: ArrayShape) -> NDArray[Any] | None:
    """Return a list, a tuple or a number of one state as an array of the shape `tail`; None for all else."""
    if type(value) not in _NUMBERS and not (type(value) in _SEQUENCES and _is_plain(value)):
        return None
    try:
        array = np.asarray(value)
    except (ValueError, TypeError, OverflowError):
        return None
    return array if array.shape == tail else None


def _joined(value: Any, tail: ArrayShape, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return an argument as one array, a tuple of components too."""
    if type(value) is not tuple:
        return np.asarray(value)
    array = np.empty((*np.broadcast_shapes(*map(np.shape, value)), len(value)), dtype)
    for k, component in enumerate(value):
        array[..., k] = component
    return array.reshape(*array.shape[:-1], *tail)


def _is_plain(values: Any) -> bool:
    """Return whether a list or tuple holds numbers and lists of numbers alone: NumPy would compute a lazy array."""
    return _NUMBERS.issuperset(map(type, values)) or all(
        type(x) in _NUMBERS or (type(x) in _SEQUENCES and _is_plain(x)) for x in values
    )
