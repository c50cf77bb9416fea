"""Calls: a loop with its constants, called with arrays of one state or of many.

    call = Call(loop, {"psi": ()}, {"n": (0.0, 0.0, 1.0)}, Results)
    call.run({"psi": np.zeros(5)}, {"psi": (5,)})

A call has a fast path and a general path. The fast path is machine code that reads the arrays of the arguments in
place (`array_reader`); it serves one state, and batches along one axis. Until compiling a kernel pays, a generated
Python function serves one state instead. Everything else - other dtypes, several axes of samples, threads, components
given one by one - takes the general path, `Loop.run`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import CodeType
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.array_reader import MAX_SAMPLE_RANK_READ_BY_MACHINE_CODE, call_descriptor, knows_array_layout
from hingepair.engine.backend import Execution
from hingepair.engine.binding import ArrayShape, bind, bind_constant
from hingepair.engine.loops import Loop, Program
from hingepair.engine.results import Results
from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted
from hingepair.numeric.array_libraries import Library, foreign_components, is_foreign
from hingepair.numeric.arrays import broadcast_shape, result_dtype

if TYPE_CHECKING:
    from hingepair.engine.native import Kernel

Out: TypeAlias = Mapping[str, NDArray[Any]] | None
"""Arrays to write outputs into, by output name."""

_FLOAT64_DTYPE: Final = np.dtype(np.float64)  # the dtype that the fast path reads and writes

_MIN_OPERATIONS_PER_CALL_TO_RELEASE_GIL: Final = 100_000
"""Number of operations, about 20 us of work, from which a call releases the interpreter's lock."""


class Call:
    """A loop with fixed constants; the method `run` takes arrays of one state or of many. A call is computed by the
    function `fast_path` (generated Python for one state, or machine code) if that supports the arguments, else by
    `Loop.run`.

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

    Attributes:
        outputs: names of the returned outputs.
        fast_path: function that takes the arguments in order, and returns the results; it returns None where the
            arguments are not arrays that it supports.
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
    ) -> None:
        self.loop = loop
        self.argument_shapes = dict(argument_shapes)
        self.result = result
        self._constant_inputs = {name: value for name, value in constants.items() if name not in argument_shapes}
        self._shape, self._backend, self._constants_name = shape, backend, constants_name
        self._limits, self._on_limit = dict(limits or {}), on_limit
        self.outputs = tuple(name for name, _ in loop.outputs if name not in self._limits)
        samples = {
            name: np.empty((2, *sample_shape)) for name, sample_shape in loop.inputs if name in argument_shapes
        }
        fixed = [(name, sample_shape) for name, sample_shape in loop.inputs if name in self._constant_inputs]
        self._bound_constants = {
            name: bind_constant(name, sample_shape, self._constant_inputs[name]) for name, sample_shape in fixed
        }
        bound = bind(loop.inputs, {**self._bound_constants, **samples})
        self._constant_numbers = bound.constants
        self._constant_array = np.array(bound.constants, np.float64)
        self.program: Program = loop.program(bound.pattern)
        self._kernel_key = self.program.default_kernel_key()
        names = tuple(argument_shapes)
        self._argument_positions = tuple(names.index(name) for name, _ in loop.inputs if name in argument_shapes)
        self._kernel_function: Callable[..., bool | int] | None = None
        self._cached_limits_call: Call | None = None
        sample_shapes = [*self.argument_shapes.values(), *(sample_shape for _, sample_shape in loop.outputs)]
        self._fast_path_supported = (
            shape == ()
            and knows_array_layout()
            and all(len(sample_shape) <= MAX_SAMPLE_RANK_READ_BY_MACHINE_CODE for sample_shape in sample_shapes)
        )
        self.fast_path: Callable[..., Any] = _no_fast_path
        if backend == "compiled":
            self._use_kernel(self.program.kernel(self._kernel_key))
        elif shape == ():
            self.fast_path = self._make_python_path()

    # ---- the fast path

    def compile(self) -> None:
        """Compile the kernel now and use its machine code in later calls. If that is not possible, issue a warning
        once and go on without the kernel.
        """
        kernel = self.program.kernel_or_none(self._kernel_key)
        if kernel is not None:
            self._use_kernel(kernel)

    @property
    def kernel(self) -> Kernel:
        """Compiled kernel for float64 inputs that all vary from sample to sample. Its first use compiles it; raises
        an error if that fails.

        Raises:
            MissingDependencyError: llvmlite is not installed.
            CompilationError: LLVM fails.
        """
        return self.program.kernel(self._kernel_key)

    def _use_kernel(self, kernel: Kernel) -> None:
        """Set the attribute `fast_path` to a function that runs the machine code of this compiled kernel. Do nothing
        if the memory layout of arrays is unknown or the shape of an argument or output is not supported.
        """
        if not self._fast_path_supported:
            return
        from hingepair.engine.native import array_call

        names = [name for name, _ in self.loop.inputs if name in self.argument_shapes]
        positions = {name: position for position, name in enumerate(names)}
        layout = call_descriptor(
            [(sample_shape, positions.get(name, -1)) for name, sample_shape in self.argument_shapes.items()],
            [sample_shape for _, sample_shape in self.loop.outputs],
            has_constants=bool(self._constant_numbers),
            kernel_address=kernel.address("kernel"),
            min_unlocked_samples=-(
                -_MIN_OPERATIONS_PER_CALL_TO_RELEASE_GIL // max(self.program.weighted_operations, 1)
            ),
        )
        self._kernel_function = array_call(kernel, layout)
        self.fast_path = self._make_kernel_path(self._kernel_function)

    def _make_kernel_path(self, kernel_function: Callable[..., bool | int]) -> Callable[..., Any]:
        """Return a generated Python function that takes the arguments of a call in order and returns its results, or
        None if the arguments are not supported. The function allocates the outputs, runs kernel_function, the machine
        code, for one state or a batch along one axis, and checks the limits.
        """
        outs = [f"out{k}" for k in range(len(self.loop.outputs))]
        arguments = ", ".join(f"in{k}" for k in range(len(self.argument_shapes)))
        source = []
        for length in ("samples, ", ""):
            source += [f"def {'many' if length else 'one'}({length}{arguments}):"]
            for out, (_, sample_shape) in zip(outs, self.loop.outputs, strict=True):
                source += [f"    {out} = empty(({length}{''.join(f'{n}, ' for n in sample_shape)}))"]
            read_only = self.result is not None
            call = f"kernel_function({arguments}, {', '.join(outs)}, constants, {read_only})"
            source += [f"    ran = {call}", "    if ran is not True:"]
            if length:
                source += ["        return None"]
            else:
                source += [f"        return many(ran, {arguments}) if ran > 0 else None"]
                scalars = (
                    out for out, (_, sample_shape) in zip(outs, self.loop.outputs, strict=True) if sample_shape == ()
                )
                source += [f"    {out} = {out}[()]" for out in scalars]
            source += self._result_lines(arguments, length)
        return self._execute_source(source, "one", kernel_function=kernel_function)

    def _make_python_path(self) -> Callable[..., Any]:
        """Return a generated Python function that takes the arguments of one state in order and returns its results
        without machine code. The function returns None unless the arguments are float64 arrays or floats of one
        state. When it pays, the function compiles the kernel and switches to it.
        """
        arguments = ", ".join(f"in{k}" for k in range(len(self.argument_shapes)))
        source = [f"def one({arguments}):"]
        numbers: dict[int, str] = {}
        for k, sample_shape in enumerate(self.argument_shapes.values()):
            unfit = f"type(in{k}) is not ndarray or in{k}.dtype is not float64 or in{k}.shape != {sample_shape}"
            source += [f"    if {unfit}:"]
            source += (
                [f"        if type(in{k}) is not float:", "            return None"] if sample_shape == () else []
            )
            source += [f"        in{k} = array(in{k})" if sample_shape == () else "        return None"]
            numbers[k] = (
                f"in{k}.item()"
                if sample_shape == ()
                else f"*in{k}{'.ravel()' if len(sample_shape) > 1 else ''}.tolist()"
            )
        if self._backend == "auto" and self._fast_path_supported:
            source += ["    if kernel_at_break_even(key, 0) is not None:", f"        return switch({arguments})"]
        components = ", ".join(numbers[place] for place in self._argument_positions)
        source += [f"    components = array(program.floats_function(*numbers, {components}))"]
        source += ["    components.setflags(write=False)"] if self.result is not None else []
        begin = 0
        for k, (_, sample_shape) in enumerate(self.loop.outputs):
            end = begin + math.prod(sample_shape)
            part = f"[{begin}:{end}]" + (f".reshape({sample_shape})" if len(sample_shape) > 1 else "")
            source += [f"    out{k} = components{part if sample_shape else f'[{begin}]'}"]
            begin = end
        source += self._result_lines(arguments, "")
        return self._execute_source(source, "one", program=self.program, numbers=self._constant_numbers)

    def _result_lines(self, arguments: str, leading_shape: str) -> list[str]:
        """Return the list of the lines of generated source that check the limits and return the result. `arguments`
        and `leading_shape` are source text: the names of the arguments, and "samples, " for a batch or "" for one
        state.

        Args:
            arguments: the names of the arguments in the source.
            leading_shape: the leading shape in the source, such as "samples, "; "" for one state.
        """
        named = [(f"out{k}", name) for k, (name, _) in enumerate(self.loop.outputs)]
        source = []
        for out, name in named:
            if name in self._limits:
                passed = f"{out} > {self._limits[name][8]!r}"
                source += [f"    if ({passed}).any():", f"        refuse({arguments})"]
        visible = [(out, name) for out, name in named if name in self.outputs]
        if self.result is None:
            return [*source, f"    return {visible[0][0]}"]
        values = "".join(f"{out}, " for out, _ in visible)
        source += ["    result = new(Result)", f"    set_content(result, (names, ({values}), ({leading_shape})))"]
        slots = self.result.__slots__
        source += [f"    set_{name}(result, {out})" for out, name in visible if name in slots]
        return [*source, "    return result"]

    def _execute_source(self, source_lines: list[str], function_name: str, **values: Any) -> Callable[..., Any]:
        """Execute lines of generated source, and return the function called function_name that they define. Keyword
        arguments become global variables of the source, in addition to those that all sources use.

        Args:
            source_lines: the lines of the source.
            function_name: the name of the function.
            values: further values that the source uses, by name.
        """
        result = self.result or Results
        slots = {f"set_{n}": result.__dict__[n].__set__ for n in self.outputs if n in result.__slots__}
        scope: dict[str, Any] = {
            "empty": np.empty, "array": np.array, "ndarray": np.ndarray, "float64": _FLOAT64_DTYPE,
            "constants": self._constant_array, "new": result.__new__, "Result": result,
            "set_content": Results.__dict__["_content"].__set__, "names": self.outputs,
            "refuse": self._refuse_arguments,
            "kernel_at_break_even": self.program.kernel_at_break_even, "key": self._kernel_key,
            "switch": self._switch_to_kernel, **slots, **values,
        }  # fmt: skip
        exec(_compile_source("\n".join(source_lines)), scope)
        function: Callable[..., Any] = scope[function_name]
        return function

    def _switch_to_kernel(self, *arguments: Any) -> Any:
        """Compile the kernel, make its machine code the fast path, and return the results for the positional
        arguments. Raises an error if compiling fails.
        """
        self._use_kernel(self.program.kernel(self._kernel_key))
        return self.fast_path(*arguments)

    # ---- the general path

    def run(
        self,
        values: Mapping[str, Any],
        shapes: Mapping[str, ArrayShape],
        out: Out = None,
        workers: int = 1,
        dtype: np.dtype[Any] | None = None,
    ) -> Any:
        """Return the results for checked arguments of one state or of many. `values` are the arguments (numbers,
        arrays, or tuples of components) and `shapes` their leading shapes, both by name. Outputs named in `out` are
        written into its arrays. If `dtype` is None, the results have the dtype of the values; a kernel is compiled
        when that pays. Raises an error if shapes do not broadcast, an array of `out` does not fit, or a limit is
        exceeded.

        Args:
            values: the arguments by name: numbers, arrays, or tuples of components, each a number or an array.
            shapes: leading shape of the samples of each argument, by the name that messages use.
            out: arrays to write outputs into, by output name.
            workers: number of threads.
            dtype: dtype to compute in; by default that of the values.

        Raises:
            ArgumentError: the arguments do not broadcast, or `out` cannot be used.
        """
        if self._shape == () and workers == 1:
            result = self._run_fast_path(values, shapes, out, dtype)
            if result is not None:
                return result
        shape = broadcast_shape({**shapes, self._constants_name: self._shape})
        dtype = dtype or common_dtype(values)
        arrays = output_buffers(self.loop.outputs, shape, dtype, out, values)
        if out and self._limits:
            self._limits_call().run(values, shapes)
        inputs = {**self._bound_constants, **values}
        self.loop.run(inputs, arrays, shape, dtype, Execution(self._backend, workers))
        self._check_limits(arrays, values)
        return self._make_result(arrays, shape)

    def _make_result(self, arrays: Mapping[str, Any], shape: ArrayShape) -> Any:
        """Return an object of the call's result class that holds arrays by output name, with this leading shape. If
        the call has no result class, return the array of its only output instead.
        """
        if self.result is None:
            return arrays[self.outputs[0]]
        return self.result({name: arrays[name] for name in self.outputs}, shape)

    def _run_fast_path(
        self, values: Mapping[str, Any], shapes: Mapping[str, ArrayShape], out: Out, dtype: np.dtype[Any] | None
    ) -> Any:
        """Return the results as the function `fast_path` (generated Python or machine code) computes them, written
        into `out` if that is given; return None if the function does not support the arguments. `values` are the
        arguments and `shapes` their leading shapes, both by name. If `dtype` is None, the results have the dtype of
        the values. Compiles the kernel when that pays.
        """
        single = not any(shapes.values())
        if single and (dtype or common_dtype(values)) == _FLOAT64_DTYPE:
            result = self.fast_path(*(np.array(value, _FLOAT64_DTYPE, order="C") for value in values.values()))
            return result if result is None or out is None else self._copy_into(result, out)
        arguments = tuple(np.array(value) if _is_float_tuple(value) else value for value in values.values())
        if not all(
            type(value) is float or (type(value) is np.ndarray and value.dtype is _FLOAT64_DTYPE)
            for value in arguments
        ):
            return None
        result = self.fast_path(*arguments) if out is None else self.run_into(arguments, out)
        if result is None and self._kernel_function is None and self._fast_path_supported and self._backend == "auto":
            samples = math.prod(broadcast_shape(shapes))
            sample_shapes = [*self.argument_shapes.values()]
            if all(np.size(arguments[k]) > math.prod(sample_shapes[k]) for k in self._argument_positions):
                kernel = self.program.existing_kernel(self._kernel_key)  # the general path counts this call
            else:
                kernel = self.program.kernel_at_break_even(self._kernel_key, samples) if samples else None
            if kernel is not None:
                self._use_kernel(kernel)
                result = self.fast_path(*arguments) if out is None else self.run_into(arguments, out)
        return result

    def run_into(self, arguments: Sequence[Any], out: Mapping[str, NDArray[Any]]) -> Any:
        """Run the machine code on the arguments, in order, with the arrays of `out` as outputs and new arrays for all
        other outputs, and return the result. Return None, with nothing written, if the arguments or arrays are not
        supported or no kernel is in use. Raises an error if a limit is exceeded.

        Args:
            arguments: the arguments in order.
            out: arrays to write into, by names of outputs.
        """
        if self._kernel_function is None or not out:
            return None
        name, array = next(iter(out.items()))
        lead = array.shape[: array.ndim - len(dict(self.loop.outputs)[name])] if type(array) is np.ndarray else (0, 0)
        if len(lead) > 1:
            return None
        if self._limits and self._limits_call().fast_path(*arguments) is None:
            return None
        arrays = [
            out[name] if name in out else np.empty((*lead, *sample_shape)) for name, sample_shape in self.loop.outputs
        ]
        if self._kernel_function(*arguments, *arrays, self._constant_array, False) is not True:
            return None
        return self._make_result(dict(zip((name for name, _ in self.loop.outputs), arrays, strict=True)), lead)

    def _copy_into(self, result: Any, out: Mapping[str, NDArray[Any]]) -> Any:
        """Copy `result`, the results of one state, into the arrays of `out`, a dictionary by output name, and return
        a result that holds these arrays. Raises an error if an array of `out` does not fit or overlaps another array
        of `out`.
        """
        arrays = {self.outputs[0]: result} if self.result is None else result.arrays()
        for name, array in out.items():
            _check_buffer(name, array, np.shape(arrays[name]), _FLOAT64_DTYPE)
        _check_no_overlap(out, {})
        for name, array in out.items():
            array[...] = arrays[name]
        return self._make_result({**arrays, **out}, ())

    def run_foreign(
        self, values: Mapping[str, Any], shapes: Mapping[str, ArrayShape], library: Library, out: Out, workers: int
    ) -> Any:
        """Return the results as arrays of another array library, which computes them. `values` are the arguments and
        `shapes` their leading shapes, both by name. Limits are not checked; the result class is registered with JAX
        if JAX is the library. Raises an error if `out` is not None, `workers` is not 1, or the call has a backend
        other than "auto".

        Args:
            values: the arguments by name: numbers, arrays of NumPy or of the library, or tuples of components.
            shapes: leading shape of the samples of each argument.
            library: the array library.
            out: None; anything else is refused.
            workers: 1; any other number is refused.

        Raises:
            ArgumentError: an option was given that holds for NumPy arrays only; the error names it.
        """
        if out is not None:
            raise ArgumentError("out", f"None, since {library.name} makes its own arrays", quoted(out))
        if self._backend != "auto":
            raise ArgumentError("backend", f"'auto', since {library.name} runs the equations", self._backend)
        if workers != 1:
            raise ArgumentError("workers", f"1, since {library.name} has threads of its own", workers)
        shape = broadcast_shape({**shapes, self._constants_name: self._shape})
        inputs = {**self._constant_inputs, **values}
        parts = {
            name: _foreign_components(name, inputs[name], sample_shape, library)
            for name, sample_shape in self.loop.inputs
        }
        components = self.loop.foreign_outputs(parts, library)
        if library.name == "jax" and self.result is not None:
            result: Any = self.result
            _register_for_jax(result)
        arrays = {}
        for name, sample_shape in self.loop.outputs:
            if name in self.outputs:
                arrays[name] = library.join_components(components[name], shape, sample_shape)
        return self._make_result(arrays, shape)

    # ---- limits

    def _limits_call(self) -> Call:
        """Return the cached `Call` that computes only the outputs with limits. Running it checks the limits before
        anything is written into `out`.
        """
        if self._cached_limits_call is None:
            limited = {name: sample_shape for name, sample_shape in self.loop.outputs if name in self._limits}
            loop = Loop(self.loop.name, self.loop.function, dict(self.loop.inputs), limited, labels=self.loop.labels)
            self._cached_limits_call = Call(
                loop, self.argument_shapes, self._constant_inputs, Results, shape=self._shape, backend=self._backend,
                limits=self._limits, on_limit=self._on_limit, constants_name=self._constants_name,
            )  # fmt: skip
        return self._cached_limits_call

    def _check_limits(self, arrays: Mapping[str, Any], arguments: Mapping[str, Any]) -> None:
        """Call `on_limit`, which raises an error, with the arguments if an output exceeds its limit at any sample.
        `arrays` holds the outputs and `arguments` the arguments by name.
        """
        for name, limits in self._limits.items():
            array = arrays[name]
            if (array > limits[array.dtype.itemsize]).any() and self._on_limit is not None:
                self._on_limit(arguments)

    def _refuse_arguments(self, *arguments: Any) -> None:
        """Call `on_limit`, which raises an error, with a dictionary of the positional arguments by name. Do nothing
        if there is no `on_limit`.
        """
        if self._on_limit is not None:
            self._on_limit(dict(zip(self.argument_shapes, arguments, strict=True)))


def _foreign_components(name: str, value: Any, sample_shape: ArrayShape, library: Library) -> Any:
    """Return the components of an input as numbers and arrays of a library: a tuple, or the only component if
    sample_shape is (). `value` is a number, a tuple of components, an array of the library, or an array of NumPy,
    which is converted; `name` is the input's name in messages.
    """
    if isinstance(value, tuple):
        return tuple(library.array(c) if isinstance(c, np.ndarray) else c for c in value)
    if is_foreign(value):
        return foreign_components(name, value, *sample_shape) if sample_shape else value
    if not isinstance(value, np.ndarray):
        return float(value)
    flat = value.reshape(*value.shape[: value.ndim - len(sample_shape)], -1)
    parts = flat.tolist() if flat.ndim == 1 else [library.array(flat[..., k]) for k in range(flat.shape[-1])]
    return tuple(parts) if sample_shape else parts[0]


@functools.cache
def _register_for_jax(result_class: Any) -> None:
    """Register a class of results as a JAX pytree, so that functions of JAX take and return such results. Further
    calls for the class do nothing.
    """
    from jax.tree_util import register_pytree_node

    def flatten(results: Any) -> tuple[tuple[Any, ...], tuple[tuple[str, ...], int]]:
        arrays = tuple(results.arrays().values())
        return arrays, (results.outputs, arrays[0].ndim - len(results.shape))

    def unflatten(structure: tuple[tuple[str, ...], int], arrays: Any) -> Any:
        """Return a result object rebuilt from its arrays after a transformation by JAX. `structure` holds the names
        of the outputs and the number of axes of one sample of the first output.
        """
        names, axes = structure  # names of the outputs, and the number of axes of one sample of the first output
        by_name = dict(zip(names, arrays, strict=True))
        shape = getattr(by_name[names[0]], "shape", ())  # JAX also passes placeholders that are not arrays
        return result_class(by_name, tuple(shape[: len(shape) - axes]))

    register_pytree_node(result_class, flatten, unflatten)


@functools.lru_cache(maxsize=512)
def _compile_source(source: str) -> CodeType:
    """Return the cached code object of a Python source, so that calls with the same source share the object."""
    return compile(source, "<hingepair: call>", "exec")


def _is_float_tuple(value: Any) -> bool:
    """Return whether a value is a tuple of Python floats."""
    return type(value) is tuple and all(type(component) is float for component in value)


def _no_fast_path(*_: Any) -> None:
    """Return None for any arguments. This function is the fast path of a call that has no other."""


def common_dtype(values: Mapping[str, Any]) -> np.dtype[Any]:
    """Return the dtype to compute in for inputs by name, which are arrays, numbers, or tuples of them: float32 if all
    arrays are float32, else float64.
    """
    return result_dtype(c for group in values.values() for c in (group if isinstance(group, tuple) else (group,)))


def output_buffers(
    sample_shapes: Iterable[tuple[str, ArrayShape]],
    shape: ArrayShape,
    dtype: np.dtype[Any],
    out: Out,
    values: Mapping[str, Any],
) -> dict[str, NDArray[Any]]:
    """Return a dictionary with the array to write each output into: the array of `out` after checks, or else a new,
    uninitialised one. sample_shapes holds pairs (name, shape of one sample), and `shape` is the leading shape. Raises
    an error if an array of `out` does not fit, or overlaps another array of `out` or one of the inputs in `values`.

    Args:
        sample_shapes: shape of one sample of each output, by name.
        shape: leading shape of the samples.
        dtype: dtype of the outputs.
        out: the user's arrays by output name.
        values: the inputs by name; no array of `out` may overlap them.

    Raises:
        ArgumentError: an array of `out` cannot be used; the error names it.
    """
    sizes = {name: (*shape, *sample_shape) for name, sample_shape in sample_shapes}
    for name, array in (out or {}).items():
        _check_buffer(name, array, sizes[name], dtype)
    if out:
        _check_no_overlap(out, values)
    return {name: out[name] if out and name in out else np.empty(size, dtype) for name, size in sizes.items()}


def _check_buffer(output_name: str, array: Any, shape: ArrayShape, dtype: np.dtype[Any]) -> None:
    """Raise an error unless the array that `out` holds for this output is a writable NumPy array of this shape and
    dtype.
    """
    name = f"out[{output_name!r}]"
    if not isinstance(array, np.ndarray) or isinstance(array, np.matrix):
        raise ArgumentError(name, "a NumPy array to write into (no matrix)", quoted(array))
    if array.shape != shape:
        raise ShapeError(name, f"shape {shape}", f"shape {array.shape}")
    if array.dtype != dtype:
        raise DtypeError(name, f"dtype {dtype.name}", f"dtype {array.dtype}")
    if not array.flags.writeable:
        raise ArgumentError(name, "a writable array", "a read-only array")


def _check_no_overlap(out: Mapping[str, NDArray[Any]], inputs: Mapping[str, Any]) -> None:
    """Raise an error if an array of `out` shares memory with another array of `out` or with one of the `inputs`, a
    dictionary by name. With shared memory, the computation would read values that it has already overwritten.
    """
    others = [
        (name, c, c.flags.owndata)
        for name, value in inputs.items()
        for c in (value if isinstance(value, tuple) else (value,))
        if isinstance(c, np.ndarray)
    ]
    for name, array in out.items():
        owns = array.flags.owndata
        for other_name, other, other_owns in others:
            separate = owns and other_owns and array is not other  # two arrays with memory of their own
            if not separate and np.may_share_memory(array, other) and np.shares_memory(array, other):
                raise ArgumentError(f"out[{name!r}]", "memory of its own", f"an array that overlaps {other_name}")
        others.append((f"out[{name!r}]", array, owns))
