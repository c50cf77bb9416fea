"""Calls: a loop with its constants, called with arrays of one state or of many.

    call = Call(loop, {"psi": ()}, {"n": (0.0, 0.0, 1.0)}, Results)
    call.run({"psi": np.zeros(5)}, {"psi": (5,)})

Where every argument is one array, a kernel computes the call, as a ufunc of NumPy (`rows`). Arguments that are given
by components, other libraries' arrays and the backend "numpy" take the general way, `run`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import CodeType
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.binding import ArrayShape, BoundConstant, ComponentSource, bind_constant
from hingepair.engine.loops import Loop, Program
from hingepair.engine.memory import empty
from hingepair.engine.results import Results
from hingepair.engine.slices import run_slices
from hingepair.engine.ufunc import MAX_OPERANDS, Layout, Operand, Ufunc
from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted
from hingepair.numeric.array_libraries import Library, foreign_components, is_foreign
from hingepair.numeric.arrays import MAX_AXES, broadcast_shape, result_dtype
from hingepair.numeric.caching import lock_free_cached_property

Out: TypeAlias = Mapping[str, NDArray[Any]] | None
"""Arrays to write outputs into, by output name."""

_FLOAT64 = np.dtype(np.float64)
_FLOAT32 = np.dtype(np.float32)
_READ_CHARACTERS = frozenset("dfbhilqBHILQ")  # characters of the dtypes that are computed in float64 or float32
_PLAIN_TYPES = {list, tuple, float, int, np.float64}  # of arguments that become an array of one state
_FEW_SAMPLES: Final = 20_000  # up to which all pairs share one kernel, in which no constant is folded
_SLAB_BYTES: Final = 1_000_000  # from which new outputs lie in one piece of memory


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
        shared: whether few samples are computed by a kernel for any constants, which many calls share.

    Attributes:
        outputs: names of the returned outputs.
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
        shared: bool = False,
    ) -> None:
        self.loop = loop
        self.argument_shapes = dict(argument_shapes)
        self.result = result
        self._constant_inputs = {name: value for name, value in constants.items() if name not in argument_shapes}
        self._shape, self._backend, self._constants_name = shape, backend, constants_name
        self._limits, self._on_limit = dict(limits or {}), on_limit
        self.outputs = tuple(name for name, _ in loop.outputs if name not in self._limits)
        self._bound_constants = {
            name: bind_constant(name, sample_shape, self._constant_inputs[name])
            for name, sample_shape in loop.inputs
            if name in self._constant_inputs
        }
        self._sample_shapes = tuple(self.argument_shapes.values())
        tails = [*self._sample_shapes, *(tail for _, tail in loop.outputs)]
        self._has_rows = (
            backend != "numpy"
            and loop.traced
            and shape == ()
            and len(tails) <= MAX_OPERANDS
            and not any(0 in tail for tail in tails)
            and all(isinstance(one, BoundConstant) for one in self._bound_constants.values())
        )
        self._shared = shared and backend == "auto"
        self._ufuncs: dict[tuple[str, bool], Ufunc] = {}
        self._ones: dict[tuple[str, bool], Callable[..., Any]] = {}
        self._names = [name for name, _ in loop.outputs]
        self.rows: Callable[..., Any] = self._any_rows if self._has_rows else _no_rows
        if backend == "compiled":
            self.compile()

    # ---- kernels

    @lock_free_cached_property
    def program(self) -> Program:
        """The program for arguments that all vary from sample to sample, in which constants are folded."""
        return self._program(False)[0]

    def _program(self, shared: bool) -> tuple[Program, list[float]]:
        """Return the program for arguments that all vary, and its constants, of which a shared one folds none."""
        places = {name: k for k, name in enumerate(self._used)}
        pattern: list[ComponentSource] = []
        constants: list[float] = []
        for name, sample_shape in self.loop.inputs:
            count = math.prod(sample_shape)
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
        """Return the layout of the call's ufuncs."""
        inputs = tuple(Operand(tail, name in self._used) for name, tail in self.argument_shapes.items())
        return Layout(inputs, tuple(Operand(tail) for _, tail in self.loop.outputs), has_constants)

    def compile(self) -> None:
        """Compile the kernel now; for the backend "auto" that is the one of calls of any number of samples.

        Raises:
            CompilationError: LLVM fails, and the backend is "compiled".
        """
        self._shared = False
        if self._has_rows:
            self._ufunc("d", False)

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

    @property
    def llvm(self) -> str:
        """The LLVM module of the kernel of float64."""
        program, constants = self._program(False)
        return program.llvm_ir(self._layout(bool(constants)), "d")

    def _ufunc(self, char: str, shared: bool) -> Ufunc | None:
        """Return the ufunc for a dtype; None if LLVM cannot compile it and the backend is "auto"."""
        ufunc = self._ufuncs.get((char, shared))
        if ufunc is None:
            self._check_constants(char)
            program, constants = self._program(shared)
            layout = self._layout(bool(constants))
            if self._backend == "compiled":
                kernel = program.kernel(layout, char)
            elif (found := program.kernel_or_none(layout, char)) is not None:
                kernel = found
            else:
                return None
            loops = [(char, kernel.address("loop"), np.array(constants, char) if constants else None)]
            ufunc = self._ufuncs[char, shared] = Ufunc(self.loop.name, layout, loops, kernel)
            self._ones[char, shared] = one = self._make_one(ufunc, np.dtype(char))
            if char == "d" and shared == self._shared:
                self.rows = one
        return ufunc

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
            loop = Loop(loop.name, loop.function, dict(loop.inputs), outputs, labels=loop.labels, form=loop.form)
        call = Call(loop, self.argument_shapes, self._constant_inputs, None, shape=self._shape)
        if not call._has_rows:
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
        """Return the results for arguments that are single arrays, lists or numbers; None if `run` has to look at
        them.
        """
        read = self._read(arguments)
        if read is None or (out is not None and not (type(out) is dict and out.keys() <= {*self.outputs})):
            return None
        arrays, lead, dtype, alike = read
        size = math.prod(lead)
        ufunc = self._ufunc(dtype.char, self._shared and size < _FEW_SAMPLES)
        if ufunc is None:
            return None
        if out is None and not lead:
            arrays = [one if one.dtype is dtype else one.astype(dtype) for one in arrays]
            return self._ones[dtype.char, self._shared](*arrays)
        if out is None and alike and size < _FEW_SAMPLES and workers == 1:
            found = ufunc.call(*arrays, dtype=dtype)
            outputs = dict(zip(self._names, found if type(found) is tuple else (found,), strict=True))
        else:
            outputs = self._buffers(lead, dtype, out, dict(zip(self.argument_shapes, arrays, strict=True)))
            self._run_ufunc(ufunc, arrays, outputs, lead, workers)
        if self._limits:
            self._check_limits(outputs, dict(zip(self.argument_shapes, arguments, strict=True)), out)
        return self._make_result(outputs, lead)

    def _read(self, arguments: Sequence[Any]) -> tuple[list[NDArray[Any]], ArrayShape, np.dtype[Any], bool] | None:
        """Return the arguments as arrays, the shape of the samples, the dtype to compute in, and whether one stride
        leads through the samples of each array; None where an argument is something else, or has another shape or
        dtype.
        """
        if len(arguments) != len(self._sample_shapes):
            return None
        arrays, leads, chars, alike = [], [], set(), True
        for value, sample_shape in zip(arguments, self._sample_shapes, strict=True):
            array = value if type(value) is np.ndarray else _state_array(value, sample_shape)
            if array is None:
                return None
            shape, char = array.shape, array.dtype.char
            axes = len(shape) - len(sample_shape)
            if shape != sample_shape:
                if axes < 0 or shape[axes:] != sample_shape or len(shape) > MAX_AXES:
                    return None
                leads.append(shape[:axes])
                alike = alike and (axes == 1 or array.flags.c_contiguous)
            if char not in _READ_CHARACTERS:
                return None
            arrays.append(array)
            if type(value) is not float:
                chars.add(char)
        lead = leads[0] if leads else ()
        if any(one != lead for one in leads):
            alike = False
            try:
                lead = np.broadcast_shapes(*leads)
            except ValueError:
                return None
        return None if 0 in lead else (arrays, lead, _FLOAT32 if chars == {"f"} else _FLOAT64, alike)

    def _run_ufunc(
        self,
        ufunc: Ufunc,
        arrays: Sequence[NDArray[Any]],
        outputs: Mapping[str, NDArray[Any]],
        lead: ArrayShape,
        workers: int,
    ) -> None:
        """Compute the outputs of all samples into their arrays."""
        ranks = [*map(len, self._sample_shapes), *(len(tail) for _, tail in self.loop.outputs)]
        targets = [outputs[name] for name, _ in self.loop.outputs]
        operations = self.program.weighted_operations if workers > 1 else 1
        run_slices(ufunc.call, arrays, targets, ranks, lead, operations=operations, workers=workers)

    def _make_one(self, ufunc: Ufunc, dtype: np.dtype[Any]) -> Callable[..., Any]:
        """Return a generated function that is `rows` without detours for one state of this dtype."""
        vectors = [k for k, tail in enumerate(self._sample_shapes) if tail]
        arguments = ", ".join(f"in{k}" for k in range(len(self.argument_shapes)))
        number = " or type(in{0}) is float" if dtype == _FLOAT64 else ""
        fits = [
            f"(type(in{k}) is ndarray and in{k}.dtype is dtype and in{k}.shape == {tail}"
            f"{'' if tail else number.format(k)})"
            for k, tail in enumerate(self._sample_shapes)
        ]
        outs = "".join(f"out{k}, " for k in range(len(self._names)))
        target = outs if len(self._names) > 1 else "out0"
        other = f"return any_rows({arguments}, out=out, workers=workers)"
        source = [
            f"def one({arguments}, out=None, workers=1):",
            f"    if not ({' and '.join(fits)}):",
            f"        {other}",
            "    if out is None:",
            f"        {target} = ufunc({arguments})",
            *self._result_lines(arguments, dtype),
            "    if type(out) is not dict or workers != 1:",
            f"        {other}",
            *(f"    owner{k} = in{k}.base" for k in vectors),
            f"    seen = {{{', '.join(f'id(in{k} if owner{k} is None else owner{k})' for k in vectors)}}}"
            if vectors
            else "    seen = set()",
            "    found = len(seen)",
            *(
                f"    if owner{k} is not None and (type(owner{k}) is not ndarray or owner{k}.base is not None):"
                f"\n        {other}"
                for k in vectors
            ),
        ]
        for k, (name, tail) in enumerate(self.loop.outputs):
            source += [f"    out{k} = {f'out.get({name!r})' if name in self.outputs else None}"]
            if name in self.outputs:
                source += [
                    f"    if out{k} is not None:",
                    f"        if type(out{k}) is not ndarray or out{k}.dtype is not dtype or out{k}.shape != {tail}:",
                    f"            {other}",
                    f"        owner = out{k}.base",
                    "        if owner is None:",
                    f"            seen.add(id(out{k}))",
                    f"        elif type(owner) is ndarray and owner.base is None and out{k}.flags.c_contiguous:",
                    "            seen.add(id(owner))",
                ]
        source += [
            "    if not out or len(seen) != found + len(out):  # all memory is of its own",
            f"        {other}",
            "    try:",
            f"        {target} = ufunc({arguments}, out=({outs}))",
            "    except ValueError:",
            f"        {other}",
            *(line.removeprefix("    ") for line in self._result_lines(arguments, dtype, writes=True)),
        ]
        result = self.result or Results
        slots = {f"set_{n}": result.__dict__[n].__set__ for n in self.outputs if n in result.__slots__}
        scope: dict[str, Any] = {
            "ndarray": np.ndarray, "dtype": dtype, "array": np.array, "ufunc": ufunc.call, "owner": ufunc,
            "any_rows": self._any_rows, "freeze": np.ndarray.setflags,
            "new": result.__new__, "Result": result, "set_content": Results.__dict__["_content"].__set__,
            "names": self.outputs, "refuse": self._refuse, **slots,
        }  # fmt: skip
        exec(_compile_source("\n".join(source)), scope)
        function: Callable[..., Any] = scope["one"]
        return function

    def _result_lines(self, arguments: str, dtype: np.dtype[Any], writes: bool = False) -> list[str]:
        """Return the lines of generated source that check the limits, and return the result of one state. Arrays of
        the user (`writes`) stay writable: results show read-only views of them.
        """
        lines, visible = [], []
        for k, (name, sample_shape) in enumerate(self.loop.outputs):
            if name in self._limits:
                excess = f"(out{k} > {self._limits[name][dtype.itemsize]!r}).any()"
                lines += [f"        if {excess}:", f"            refuse(({arguments},), {writes})"]
            else:
                visible.append((k, name, sample_shape))
        if self.result is None:
            k, _, sample_shape = visible[0]
            return [*lines, f"        return out{k}" if sample_shape or writes else f"        return array(out{k})"]
        values = "".join(f"out{k}, " for k, _, _ in visible)
        content = ["        result = new(Result)", f"        set_content(result, (names, ({values}), ()))"]
        if not writes:
            lines += [f"        freeze(out{k}, False)" for k, _, sample_shape in visible if sample_shape]
            slots = self.result.__slots__
            content += [f"        set_{name}(result, out{k})" for k, name, _ in visible if name in slots]
        return [*lines, *content, "        return result"]

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
            dtype: dtype to compute in; by default that of the values.
            labels: names of arguments in messages, where they are not those of the inputs.

        Raises:
            ArgumentError: the arguments do not broadcast, or `out` cannot be used.
        """
        shape = broadcast_shape({**shapes, self._constants_name: self._shape})
        dtype = dtype or common_dtype(values)
        self._check_constants(dtype.char)
        named = {labels.get(name, name): value for name, value in values.items()} if out and labels else values
        arrays = self._buffers(shape, dtype, out, named)
        ufunc = None
        if self._has_rows and 0 not in shape and not any(type(value) is tuple for value in values.values()):
            ufunc = self._ufunc(dtype.char, self._shared and math.prod(shape) < _FEW_SAMPLES)
        if ufunc is not None:
            given = [np.asarray(values[name]) for name in self.argument_shapes]
            self._run_ufunc(ufunc, given, arrays, shape, workers)
        else:
            inputs = {**self._bound_constants, **values}
            self.loop.run(inputs, arrays, shape, dtype, Execution(self._backend, workers))
        self._check_limits(arrays, values, out)
        return self._make_result(arrays, shape)

    def _buffers(
        self, shape: ArrayShape, dtype: np.dtype[Any], out: Out, inputs: Mapping[str, Any]
    ) -> dict[str, NDArray[Any]]:
        """Return the arrays to write the outputs into, as `output_buffers` does. The only output is called `out`."""
        try:
            return output_buffers(self.loop.outputs, shape, dtype, out, inputs)
        except ArgumentError as error:
            if self.result is not None or error.name != f"out[{self.outputs[0]!r}]":
                raise
            raise type(error)("out", error.expected, error.got) from None

    def _make_result(self, arrays: Mapping[str, Any], shape: ArrayShape) -> Any:
        """Return an object of the call's result class that holds arrays by output name, with this leading shape. If
        the call has no result class, return the array of its only output instead.
        """
        if self.result is None:
            return arrays[self.outputs[0]]
        return self.result({name: arrays[name] for name in self.outputs}, shape)

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

    def _check_limits(self, arrays: Mapping[str, Any], arguments: Mapping[str, Any], out: Out) -> None:
        """Refuse the arguments if an output exceeds its limit at any sample."""
        for name, limits in self._limits.items():
            array = arrays[name]
            if (array > limits[array.dtype.itemsize]).any():
                self._refuse(tuple(arguments.values()), out is not None)

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


def _state_array(value: Any, sample_shape: ArrayShape) -> NDArray[Any] | None:
    """Return a list, a tuple or a number of one state as an array; None for all else."""
    if type(value) not in _PLAIN_TYPES:
        return None
    try:
        array = np.asarray(value)
    except (ValueError, TypeError, OverflowError):
        return None
    return array if array.shape == sample_shape else None


def _no_rows(*_: Any, **__: Any) -> None:
    """Return None: `run` has to compute the call."""


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
    inputs: Mapping[str, Any],
) -> dict[str, NDArray[Any]]:
    """Return a dictionary with the array to write each output into: the array of `out` after checks, or else a new,
    uninitialised one.

    Args:
        sample_shapes: shape of one sample of each output, by name.
        shape: leading shape of the samples.
        dtype: dtype of the outputs.
        out: the user's arrays by output name.
        inputs: the arguments by name; no array of `out` may overlap them.

    Raises:
        ArgumentError: an array of `out` cannot be used; the error names it.
    """
    sizes = {name: (*shape, *sample_shape) for name, sample_shape in sample_shapes}
    for name, array in (out or {}).items():
        _check_buffer(name, array, sizes[name], dtype)
    if out:
        arrays = [
            (name, part)
            for name, value in inputs.items()
            for part in (value if isinstance(value, tuple) else (value,))
            if isinstance(part, np.ndarray)
        ]
        if not _separate([*out.values()], [array for _, array in arrays]):
            _refuse_overlap(out, arrays)
    new = {name: dtype.itemsize * math.prod(size) for name, size in sizes.items() if not out or name not in out}
    if sum(new.values()) < _SLAB_BYTES:
        return {name: np.empty(size, dtype) if name in new else out[name] for name, size in sizes.items()}  # type: ignore[index]
    slab = empty(sum(new.values()) // dtype.itemsize, dtype)
    parts = np.split(slab, np.cumsum([*new.values()])[:-1] // dtype.itemsize)
    made = {name: part.reshape(sizes[name]) for name, part in zip(new, parts, strict=True)}
    return {name: made[name] if name in made else out[name] for name in sizes}  # type: ignore[index]


def _check_buffer(output_name: str, array: Any, shape: ArrayShape, dtype: np.dtype[Any]) -> None:
    """Raise an error unless the array that `out` holds for this output is a writable NumPy array of this shape and
    dtype.
    """
    name = f"out[{output_name!r}]"
    if not isinstance(array, np.ndarray) or isinstance(array, np.matrix):
        raise ArgumentError(name, "a NumPy array to write into (no matrix)", quoted(array))
    if isinstance(array, np.ma.MaskedArray):
        raise ArgumentError(name, "an array without a mask", "a masked array")
    if array.shape != shape:
        raise ShapeError(name, f"shape {shape}", f"shape {array.shape}")
    if array.dtype != dtype:
        raise DtypeError(name, f"dtype {dtype.name}", f"dtype {array.dtype}")
    if not array.flags.writeable:
        raise ArgumentError(name, "a writable array", "a read-only array")


def _separate(outputs: Sequence[NDArray[Any]], inputs: Sequence[NDArray[Any]]) -> bool:
    """Return whether arrays to write into overlap neither each other, nor themselves, nor an input, as far as that is
    seen by the arrays that own their memory.
    """
    owners = {id(one) if one.base is None else id(one.base) for one in outputs}
    if len(owners) < len(outputs):
        return False
    for one in (*outputs, *inputs):
        if one.base is not None and (type(one.base) is not np.ndarray or one.base.base is not None):
            return False
    if not owners.isdisjoint(id(one) if one.base is None else id(one.base) for one in inputs):
        return False
    return all(one.base is None or one.flags.forc or _steps_apart(one) for one in outputs)


def _steps_apart(array: NDArray[Any]) -> bool:
    """Return whether each stride of an array leads beyond what the smaller ones reach."""
    reach = array.itemsize
    for step, n in sorted((abs(step), n) for step, n in zip(array.strides, array.shape, strict=True) if n > 1):
        if step < reach:
            return False
        reach = step * (n - 1) + reach
    return True


def _refuse_overlap(out: Mapping[str, NDArray[Any]], inputs: Iterable[tuple[str, NDArray[Any]]]) -> None:
    """Raise an error if an array of `out` shares memory with another one, with itself or with an input."""
    others = [*inputs]
    for name, array in out.items():
        if not _steps_apart(array):
            raise ArgumentError(f"out[{name!r}]", "memory of its own", "an array that overlaps itself")
        for other_name, other in others:
            if np.may_share_memory(array, other) and np.shares_memory(array, other):
                raise ArgumentError(f"out[{name!r}]", "memory of its own", f"an array that overlaps {other_name}")
        others.append((f"out[{name!r}]", array))
