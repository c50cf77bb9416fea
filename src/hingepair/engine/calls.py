"""Calls: a loop with its constants, called with arrays of one state or of many.

    call = Call(loop, {"psi": ()}, {"n": (0.0, 0.0, 1.0)}, Results)
    call.run({"psi": np.zeros(5)}, {"psi": (5,)})

A call has one quick way and one general way. The quick way is machine code that reads the arrays it is given
(`array_heads`); it serves one state, and batches along one axis. Until a kernel pays, a generated Python function
serves one state instead. All else - other dtypes, several axes of samples, threads, components given one by one -
goes the general way, `Loop.run`.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from types import CodeType
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.array_heads import MAX_RANK, call_layout, known_heads
from hingepair.engine.backend import How
from hingepair.engine.binding import bind, sorted_once
from hingepair.engine.loops import Extent, Loop, Program
from hingepair.engine.results import Results
from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted
from hingepair.numeric.array_libraries import Library, foreign_components, is_foreign
from hingepair.numeric.arrays import broadcast_shape, result_dtype

if TYPE_CHECKING:
    from hingepair.engine.native import Kernel

Out: TypeAlias = Mapping[str, NDArray[Any]] | None
"""Arrays to write into, by output name."""

_FLOAT64: Final = np.dtype(np.float64)

_LONG_CALL_OPERATIONS: Final = 100_000
"""Number of operations from which the interpreter's lock is released: some 20 us."""


class Call:
    """A loop with its constants, for arguments of some names.

    Args:
        loop: what is computed.
        given: shape of one sample of each argument, by name and in order; also of those that the loop does not need,
            which are checked and broadcast all the same.
        constants: the loop's other inputs by name: numbers, or tuples of numbers; arrays where they have samples.
        result: the class of what is returned; None where the one output is returned itself, as an array that can be
            written to.
        shape: leading shape of the constants; () where they are the same at all samples.
        backend: one of `backend.BACKENDS`.
        limits: outputs that are not returned, but compared: where one is larger than its limit at a sample, the call
            is refused. NaN is not larger. Limits by bytes of a number: 8 of float64, 4 of float32.
        refuse: called with the arguments by name where a limit is passed; raises the error that fits.
        owner: what messages call the constants.

    Attributes:
        outputs: names of what is returned.
        quick: the quick way: takes the arguments in order, and returns the results, or None where they are not
            arrays that it supports.
    """

    def __init__(
        self,
        loop: Loop,
        given: Mapping[str, Extent],
        constants: Mapping[str, Any],
        result: type[Results] | None,
        *,
        shape: Extent = (),
        backend: str = "auto",
        limits: Mapping[str, Mapping[int, float]] | None = None,
        refuse: Callable[[Mapping[str, Any]], None] | None = None,
        owner: str = "pair",
    ) -> None:
        self.loop = loop
        self.given = dict(given)
        self.result = result
        self._constants = {name: value for name, value in constants.items() if name not in given}
        self._shape, self._backend, self._owner = shape, backend, owner
        self._limits, self._refuse = dict(limits or {}), refuse
        self.outputs = tuple(name for name, _ in loop.outputs if name not in self._limits)
        samples = {name: np.empty((2, *tail)) for name, tail in loop.inputs if name in given}
        fixed = [(name, tail) for name, tail in loop.inputs if name in self._constants]
        self._sorted = {name: sorted_once(name, tail, self._constants[name]) for name, tail in fixed}
        bound = bind(loop.inputs, {**self._sorted, **samples})
        self._numbers = bound.constants
        self._constant_array = np.array(bound.constants, np.float64)
        self.program: Program = loop.program(bound.pattern)
        self._key = self.program.key_of_samples()
        names = tuple(given)
        self._places = tuple(names.index(name) for name, _ in loop.inputs if name in given)
        self._into: Callable[..., bool | int] | None = None
        self._check: Call | None = None
        tails = [*self.given.values(), *(tail for _, tail in loop.outputs)]
        self._readable = shape == () and known_heads() and all(len(tail) <= MAX_RANK for tail in tails)
        self.quick: Callable[..., Any] = _unsupported
        if backend == "compiled":
            self._use(self.program.kernel(self._key))
        elif shape == ():
            self.quick = self._python_call()

    # ---- the quick way

    def compile(self) -> None:
        """Compile now; where that is not possible, warn once and compute with NumPy."""
        kernel = self.program.kernel_if_compiled(self._key)
        if kernel is not None:
            self._use(kernel)

    @property
    def kernel(self) -> Kernel:
        """The kernel for float64 inputs that all change from sample to sample.

        Raises:
            MissingDependencyError: llvmlite is not installed.
            CompilationError: LLVM fails.
        """
        return self.program.kernel(self._key)

    def _use(self, kernel: Kernel) -> None:
        """Let the quick way be machine code, where the interpreter and the shapes allow it."""
        if not self._readable:
            return
        from hingepair.engine.native import array_call

        places = {name: place for place, name in enumerate(n for n, _ in self.loop.inputs if n in self.given)}
        layout = call_layout(
            [(tail, places.get(name, -1)) for name, tail in self.given.items()],
            [tail for _, tail in self.loop.outputs],
            constants=bool(self._numbers),
            kernel=kernel.address,
            long_call=-(-_LONG_CALL_OPERATIONS // max(self.program.operations, 1)),
        )
        self._into = array_call(kernel, layout)
        self.quick = self._machine_call(self._into)

    def _machine_call(self, run: Callable[..., bool | int]) -> Callable[..., Any]:
        """Return the quick way through machine code: of one state, which hands batches on."""
        outs = [f"out{k}" for k in range(len(self.loop.outputs))]
        arguments = ", ".join(f"in{k}" for k in range(len(self.given)))
        source = []
        for length in ("samples, ", ""):
            source += [f"def {'many' if length else 'one'}({length}{arguments}):"]
            for out, (_, tail) in zip(outs, self.loop.outputs, strict=True):
                source += [f"    {out} = empty(({length}{''.join(f'{n}, ' for n in tail)}))"]
            read_only = self.result is not None
            call = f"run({arguments}, {', '.join(outs)}, constants, {read_only})"
            source += [f"    ran = {call}", "    if ran is not True:"]
            if length:
                source += ["        return None"]
            else:
                source += [f"        return many(ran, {arguments}) if ran > 0 else None"]
                scalars = (out for out, (_, tail) in zip(outs, self.loop.outputs, strict=True) if tail == ())
                source += [f"    {out} = {out}[()]" for out in scalars]
            source += self._result_lines(arguments, length)
        return self._compiled_source(source, "one", run=run)

    def _python_call(self) -> Callable[..., Any]:
        """Return the quick way through the generated Python function, for one state until a kernel pays."""
        arguments = ", ".join(f"in{k}" for k in range(len(self.given)))
        source = [f"def one({arguments}):"]
        numbers: dict[int, str] = {}
        for k, tail in enumerate(self.given.values()):
            unfit = f"type(in{k}) is not ndarray or in{k}.dtype is not float64 or in{k}.shape != {tail}"
            source += [f"    if {unfit}:"]
            source += [f"        if type(in{k}) is not float:", "            return None"] if tail == () else []
            source += [f"        in{k} = array(in{k})" if tail == () else "        return None"]
            numbers[k] = f"in{k}.item()" if tail == () else f"*in{k}{'.ravel()' if len(tail) > 1 else ''}.tolist()"
        if self._backend == "auto" and self._readable:
            source += ["    if pays(key, 0) is not None:", f"        return switch({arguments})"]
        taken = ", ".join(numbers[place] for place in self._places)
        source += [f"    components = array(program.floats_function(*numbers, {taken}))"]
        source += ["    components.setflags(write=False)"] if self.result is not None else []
        begin = 0
        for k, (_, tail) in enumerate(self.loop.outputs):
            end = begin + math.prod(tail)
            part = f"[{begin}:{end}]" + (f".reshape({tail})" if len(tail) > 1 else "")
            source += [f"    out{k} = components{part if tail else f'[{begin}]'}"]
            begin = end
        source += self._result_lines(arguments, "")
        return self._compiled_source(source, "one", program=self.program, numbers=self._numbers)

    def _result_lines(self, arguments: str, length: str) -> list[str]:
        """Return the lines that check the limits and put the outputs into a result: no loop, which costs too much."""
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
        source += ["    result = new(Result)", f"    set_content(result, (names, ({values}), ({length})))"]
        slots = self.result.__slots__
        source += [f"    set_{name}(result, {out})" for out, name in visible if name in slots]
        return [*source, "    return result"]

    def _compiled_source(self, source: list[str], name: str, **more: Any) -> Callable[..., Any]:
        result = self.result or Results
        slots = {f"set_{n}": result.__dict__[n].__set__ for n in self.outputs if n in result.__slots__}
        scope: dict[str, Any] = {
            "empty": np.empty, "array": np.array, "ndarray": np.ndarray, "float64": _FLOAT64,
            "constants": self._constant_array, "new": result.__new__, "Result": result,
            "set_content": Results.__dict__["_content"].__set__, "names": self.outputs, "refuse": self._refused,
            "pays": self.program.kernel_if_paid, "key": self._key,
            "switch": self._switch, **slots, **more,
        }  # fmt: skip
        exec(_code("\n".join(source)), scope)
        made: Callable[..., Any] = scope[name]
        return made

    def _switch(self, *given: Any) -> Any:
        """Go over to the kernel, which pays now, and return its results."""
        self._use(self.program.kernel(self._key))
        return self.quick(*given)

    # ---- any arguments

    def run(
        self,
        values: Mapping[str, Any],
        shapes: Mapping[str, Extent],
        out: Out = None,
        workers: int = 1,
        dtype: np.dtype[Any] | None = None,
    ) -> Any:
        """Return the results for arguments that are checked: one state or many.

        Args:
            values: the arguments by name: numbers, arrays, or tuples of components, each a number or an array.
            shapes: leading shape of the samples of each argument, for messages under the user's names.
            out: arrays to write into by output name.
            workers: number of threads.
            dtype: to compute in; that of the values unless given.

        Raises:
            ArgumentError: the arguments do not broadcast, or `out` cannot be used.
        """
        if self._shape == () and workers == 1:
            result = self._run_quickly(values, shapes, out, dtype)
            if result is not None:
                return result
        shape = broadcast_shape({**shapes, self._owner: self._shape})
        dtype = dtype or dtype_of(values)
        arrays = output_buffers(self.loop.outputs, shape, dtype, out, values)
        if out and self._limits:
            self._checks().run(values, shapes)
        inputs = {**self._sorted, **values}
        self.loop.run(inputs, arrays, shape, dtype, How(self._backend, workers))
        self._check_limits(arrays, lambda: values)
        return self._returned(arrays, shape)

    def _returned(self, arrays: Mapping[str, Any], shape: Extent) -> Any:
        """Return the outputs among these arrays as the result, or the one output itself."""
        if self.result is None:
            return arrays[self.outputs[0]]
        return self.result({name: arrays[name] for name in self.outputs}, shape)

    def _run_quickly(
        self, values: Mapping[str, Any], shapes: Mapping[str, Extent], out: Out, dtype: np.dtype[Any] | None
    ) -> Any:
        """Return the results by the quick way, where it is open to the arguments; else None."""
        single = not any(shapes.values())
        if single and (dtype or dtype_of(values)) == _FLOAT64:
            result = self.quick(*(np.array(value, _FLOAT64, order="C") for value in values.values()))
            return result if result is None or out is None else self._copied(result, out)
        given = tuple(np.array(value) if _is_row(value) else value for value in values.values())
        if not all(
            type(value) is float or (type(value) is np.ndarray and value.dtype is _FLOAT64) for value in given
        ):
            return None
        quick: Callable[[], Any] = lambda: self.quick(*given) if out is None else self.write(given, out)  # noqa: E731
        result = quick()
        if result is None and self._into is None and self._readable and self._backend == "auto":
            samples = math.prod(broadcast_shape(shapes))
            tails = [*self.given.values()]
            if all(np.size(given[place]) > math.prod(tails[place]) for place in self._places):
                kernel = self.program.kernel_if_made(self._key)  # the general way counts the call for this kernel
            else:
                kernel = self.program.kernel_if_paid(self._key, samples) if samples else None
            if kernel is not None:
                self._use(kernel)
                result = quick()
        return result

    def write(self, given: Sequence[Any], out: Mapping[str, NDArray[Any]]) -> Any:
        """Return the results of the quick way, written into arrays; None, and nothing written, where it is not open.

        Args:
            given: the arguments in order.
            out: arrays to write into; their names are known.
        """
        if self._into is None or not out:
            return None
        name, array = next(iter(out.items()))
        lead = array.shape[: array.ndim - len(dict(self.loop.outputs)[name])] if type(array) is np.ndarray else (0, 0)
        if len(lead) > 1:
            return None
        if self._limits and self._checks().quick(*given) is None:
            return None
        arrays = [out[name] if name in out else np.empty((*lead, *tail)) for name, tail in self.loop.outputs]
        if self._into(*given, *arrays, self._constant_array, False) is not True:
            return None
        return self._returned(dict(zip((name for name, _ in self.loop.outputs), arrays, strict=True)), lead)

    def _copied(self, result: Any, out: Mapping[str, NDArray[Any]]) -> Any:
        """Return the results of one state, copied into arrays."""
        arrays = {self.outputs[0]: result} if self.result is None else result.arrays()
        for name, array in out.items():
            _check_buffer(name, array, np.shape(arrays[name]), _FLOAT64)
        _check_apart(out, {})
        for name, array in out.items():
            array[...] = arrays[name]
        return self._returned({**arrays, **out}, ())

    def run_foreign(
        self, values: Mapping[str, Any], shapes: Mapping[str, Extent], library: Library, out: Out, workers: int
    ) -> Any:
        """Return the results as arrays of another library, by its own arithmetic; limits are not looked at.

        Args:
            values: the arguments by name: numbers, arrays of either kind, or tuples of components.
            shapes: leading shape of the samples of each argument.
            library: the other library.
            out: refused unless None.
            workers: refused unless 1.

        Raises:
            ArgumentError: an option that is of NumPy arrays only; names it.
        """
        if out is not None:
            raise ArgumentError("out", f"None, since {library.name} makes its own arrays", quoted(out))
        if self._backend != "auto":
            raise ArgumentError("backend", f"'auto', since {library.name} runs the equations", self._backend)
        if workers != 1:
            raise ArgumentError("workers", f"1, since {library.name} has threads of its own", workers)
        shape = broadcast_shape({**shapes, self._owner: self._shape})
        inputs = {**self._constants, **values}
        parts = {name: _foreign_parts(name, inputs[name], tail, library) for name, tail in self.loop.inputs}
        components = self.loop.of_library(parts, library)
        if library.name == "jax" and self.result is not None:
            result: Any = self.result
            _register_for_jax(result)
        arrays = {}
        for name, tail in self.loop.outputs:
            if name in self.outputs:
                arrays[name] = library.joined(components[name], shape, tail)
        return self._returned(arrays, shape)

    # ---- limits

    def _checks(self) -> Call:
        """Return the call that computes only what has a limit: it comes first where outputs must not be touched."""
        if self._check is None:
            wanted = {name: tail for name, tail in self.loop.outputs if name in self._limits}
            loop = Loop(self.loop.name, self.loop.function, dict(self.loop.inputs), wanted, labels=self.loop.labels)
            self._check = Call(
                loop, self.given, self._constants, Results, shape=self._shape, backend=self._backend,
                limits=self._limits, refuse=self._refuse, owner=self._owner,
            )  # fmt: skip
        return self._check

    def _check_limits(self, arrays: Mapping[str, Any], given: Callable[[], Mapping[str, Any]]) -> None:
        for name, limits in self._limits.items():
            array = arrays[name]
            if (array > limits[array.dtype.itemsize]).any() and self._refuse is not None:
                self._refuse(given())

    def _refused(self, *given: Any) -> None:
        if self._refuse is not None:
            self._refuse(dict(zip(self.given, given, strict=True)))


def _foreign_parts(name: str, value: Any, tail: Extent, library: Library) -> Any:
    """Return the components of an input as numbers and arrays of a library."""
    if isinstance(value, tuple):
        return tuple(library.array(c) if isinstance(c, np.ndarray) else c for c in value)
    if is_foreign(value):
        return foreign_components(name, value, *tail) if tail else value
    if not isinstance(value, np.ndarray):
        return float(value)
    flat = value.reshape(*value.shape[: value.ndim - len(tail)], -1)
    parts = flat.tolist() if flat.ndim == 1 else [library.array(flat[..., k]) for k in range(flat.shape[-1])]
    return tuple(parts) if tail else parts[0]


@functools.cache
def _register_for_jax(kind: Any) -> None:
    """Tell JAX what results are made of, so that its functions take and return them."""
    from jax.tree_util import register_pytree_node

    def parts(results: Any) -> tuple[tuple[Any, ...], tuple[tuple[str, ...], int]]:
        arrays = tuple(results.arrays().values())
        return arrays, (results.outputs, arrays[0].ndim - len(results.shape))

    def joined(form: tuple[tuple[str, ...], int], arrays: Any) -> Any:
        names, axes = form  # of the first output, how many axes one sample has
        by_name = dict(zip(names, arrays, strict=True))
        shape = getattr(by_name[names[0]], "shape", ())  # JAX also asks for results of what is no array
        return kind(by_name, tuple(shape[: len(shape) - axes]))

    register_pytree_node(kind, parts, joined)


@functools.lru_cache(maxsize=512)
def _code(source: str) -> CodeType:
    """Return the code of a source; calls of the same form share it."""
    return compile(source, "<hingepair: call>", "exec")


def _is_row(value: Any) -> bool:
    """Return whether a value is a tuple of numbers."""
    return type(value) is tuple and all(type(component) is float for component in value)


def _unsupported(*_: Any) -> None:
    """Return None: the quick way is not open."""


def dtype_of(values: Mapping[str, Any]) -> np.dtype[Any]:
    """Return the dtype that values are computed in."""
    return result_dtype(c for group in values.values() for c in (group if isinstance(group, tuple) else (group,)))


def output_buffers(
    tails: Iterable[tuple[str, Extent]], shape: Extent, dtype: np.dtype[Any], out: Out, values: Mapping[str, Any]
) -> dict[str, NDArray[Any]]:
    """Return arrays for the outputs: those of `out`, which overlap none of the values, and new ones.

    Args:
        tails: shape of one sample of each output, by name.
        shape: of the samples.
        dtype: of the outputs.
        out: the user's arrays by output name.
        values: the inputs by name.

    Raises:
        ArgumentError: an array of `out` cannot be used; names it.
    """
    sizes = {name: (*shape, *tail) for name, tail in tails}
    for name, array in (out or {}).items():
        _check_buffer(name, array, sizes[name], dtype)
    if out:
        _check_apart(out, values)
    return {name: out[name] if out and name in out else np.empty(size, dtype) for name, size in sizes.items()}


def _check_buffer(output: str, array: Any, shape: Extent, dtype: np.dtype[Any]) -> None:
    """Refuse what is no array of this shape and dtype that can be written to."""
    name = f"out[{output!r}]"
    if not isinstance(array, np.ndarray):
        raise ArgumentError(name, "an array to write into", quoted(array))
    if array.shape != shape:
        raise ShapeError(name, f"shape {shape}", f"shape {array.shape}")
    if array.dtype != dtype:
        raise DtypeError(name, f"dtype {dtype.name}", f"dtype {array.dtype}")
    if not array.flags.writeable:
        raise ArgumentError(name, "a writable array", "a read-only one")


def _check_apart(out: Mapping[str, NDArray[Any]], groups: Mapping[str, Any]) -> None:
    """Refuse an output that lies over an input or over another output: blocks would read what they wrote."""
    taken = [
        (name, c, c.flags.owndata)
        for name, group in groups.items()
        for c in (group if isinstance(group, tuple) else (group,))
        if isinstance(c, np.ndarray)
    ]
    for name, array in out.items():
        owns = array.flags.owndata
        for other, c, owned in taken:
            apart = owns and owned and array is not c  # two arrays with memory of their own
            if not apart and np.may_share_memory(array, c) and np.shares_memory(array, c):
                raise ArgumentError(f"out[{name!r}]", "memory of its own", f"an array that overlaps {other}")
        taken.append((f"out[{name!r}]", array, owns))
