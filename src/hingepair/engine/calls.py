"""Calls: a loop with its constants, called with arrays of one state or of many.

call = Call(loop, {"psi": ()}, {"n": (0.0, 0.0, 1.0)}, Results)
call.rows(np.zeros(5))                         # arguments that are one array each
call.run({"psi": np.zeros(5)}, {"psi": (5,)})  # arguments by components too, and the backend "numpy"

Few samples in arrays that need no conversion are computed by `direct`, others by a ufunc, in slices. What has no
kernel for its arguments is left to the loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.binding import ArrayShape, Constant, NamedShapes, bind, bind_constant
from hingepair.engine.llvm.direct import Direct, direct_calls
from hingepair.engine.llvm.kernels import Code, Operand, run_slices
from hingepair.engine.loops import Loop, Program
from hingepair.engine.outputs import MIN_REUSED_BYTES, Out, empty, output_arrays
from hingepair.engine.results import Results
from hingepair.engine.ufunc import MAX_OPERANDS, make_ufunc
from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.numeric.arrays import MAX_AXES, broadcast_shape, result_dtype
from hingepair.numeric.caching import lock_free_cached_property

Rows = Callable[..., Any]

_FLOAT64, _FLOAT32 = np.dtype(np.float64), np.dtype(np.float32)
_READ_CHARACTERS = frozenset("dfbhilqBHILQ")  # characters of the dtypes that are computed in float64 or float32
# Types of arguments that become an array of one state.
_SEQUENCES, _NUMBERS = {list, tuple}, {float, int, np.float64}
_WEAK = {float, int}  # numbers that take the dtype of the arrays beside them
# Samples below which calls share one kernel, in which no constant is folded, and components are joined for it.
_FEW_SAMPLES: Final = 20_000
_DIRECT_SAMPLES: Final = 2_000  # that are copied at most, so that they need no conversion


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
        shared: bool = False,
    ) -> None:
        self.loop = loop
        self.argument_shapes = dict(argument_shapes)
        self.result = result
        self._shape, self._backend, self._constants_name = shape, backend, constants_name
        limits = limits or {}
        self._limits = [(k, limits[name]) for k, (name, _) in enumerate(loop.outputs) if name in limits]
        self._on_limit = on_limit
        shown = [k for k, (name, _) in enumerate(loop.outputs) if name not in limits]
        self.outputs = tuple(loop.outputs[k][0] for k in shown)
        self._result_of = _result_maker(result, loop.outputs, shown)
        self._bound_constants = {  # by whether calls share a kernel, in which nothing folds
            shares: {k: bind_constant(tail, constants[k], not shares) for k, tail in loop.inputs if k in constants}
            for shares in (False, True)
        }
        needed = {name for name, _ in loop.inputs}
        self._used = [name for name in self.argument_shapes if name in needed]
        self._operands = [Operand(tail, name in needed) for name, tail in self.argument_shapes.items()]
        tails = [*self.argument_shapes.values(), *(tail for _, tail in loop.outputs)]
        self.has_kernels = (
            backend != "numpy" and shape == () and not any(0 in tail for tail in tails)
            and all(isinstance(one, Constant) for one in self._bound_constants[False].values())
        )  # fmt: skip
        self._shared = shared and backend == "auto"
        self._kernels: dict[tuple[str, bool], tuple[Code, Direct]] = {}  # by dtype, and whether others share it
        self.rows: Rows = self._any_rows
        if backend == "compiled":
            self.compile()

    # ---- kernels

    def program_with_numbers(self, shared: bool = False) -> tuple[Program, list[float]]:
        """Return the program for arguments that all vary, and its constant numbers, of which `shared` folds none."""
        arguments = {name: np.empty(self.argument_shapes[name]) for name in self._used}
        bound = bind(self.loop.inputs, {**arguments, **self._bound_constants[shared]})
        return self.loop.program(bound.pattern), bound.numbers

    def compile(self) -> None:
        """Compile the kernel now; for the backend "auto" that is the one of calls of any number of samples.

        Raises:
            CompilationError: LLVM fails.
        """
        self._shared = False
        if self.has_kernels:
            self._kernel("d", False)

    def machine_code(self, char: str, shared: bool = False) -> Code:
        """Return the kernel for a dtype, its arrays and its constants.

        Raises:
            CompilationError: LLVM fails.
        """
        program, numbers = self.program_with_numbers(shared)
        return program.code(self._operands, numbers, char)

    def _kernel(self, char: str, shared: bool) -> tuple[Code, Direct]:
        """Return the kernel for a dtype and its direct calls."""
        if (char, shared) not in self._kernels:
            code = self.machine_code(char, shared)
            width = max(math.prod(tail) for _, tail in self.loop.outputs) * code.constants.itemsize
            most = max(1, MIN_REUSED_BYTES // width)  # of larger results the memory is used again
            direct = direct_calls(code, char, most, self.result is not None)
            self._kernels[char, shared] = code, direct
            if char == "d" and shared == self._shared:
                self.rows = self._direct_rows(direct)
        return self._kernels[char, shared]

    @lock_free_cached_property
    def ufunc(self) -> np.ufunc:
        """The kernel as a ufunc of NumPy, of float64 and float32.

        Raises:
            ArgumentError: an argument or output has no components, or they are too many for a ufunc.
            CompilationError: LLVM fails.
        """
        if not self.has_kernels or len(self.argument_shapes) + len(self.loop.outputs) > MAX_OPERANDS:
            raise ArgumentError("ufunc", "a call of single arrays of at least one number each", quoted(self.outputs))
        doc = f"{', '.join(self.argument_shapes)} -> {', '.join(self.outputs)}"
        return make_ufunc(self.loop.name, {char: self.machine_code(char) for char in "df"}, doc)

    # ---- arguments that are one array each

    def _direct_rows(self, direct: Direct) -> Rows:
        """Return a function of the arguments in order, `out` and `workers`, which calls a kernel of float64 directly,
        and leaves to `_any_rows` what that does not take.
        """
        (make, fill), array, ndarray, one_empty = direct, np.array, np.ndarray, np.empty
        tails, outputs = [*self.argument_shapes.values()], self.loop.outputs
        rank, takes_numbers = len(tails[0]) if tails else 0, () in tails
        known, checks, result_of = {*self.outputs}, bool(self._limits), self._result_of

        def rows(*given: Any, out: Any = None, workers: int = 1) -> Any:
            arrays = [array(x) if type(x) is float else x for x in given] if takes_numbers else given
            made = None
            if out is None:
                made = make(*arrays)
                if made is None and not _SEQUENCES.isdisjoint(map(type, given)):
                    arrays = [*map(_row, arrays)]
                    made = make(*arrays)
            first: Any = arrays[0] if arrays else None
            found = made
            if found is None and workers == 1 and type(first) is ndarray and first.dtype is _FLOAT64:
                ready = {} if out is None else out
                # `fill` refuses arrays that are not contiguous: for these, no outputs are made here.
                if type(ready) is dict and known.issuperset(ready) and first.flags.c_contiguous:
                    lead = first.shape[: first.ndim - rank]
                    new = empty if lead else one_empty
                    written = [ready[name] if name in ready else new(lead + tail, _FLOAT64) for name, tail in outputs]
                    found = fill(*arrays, *written)
            if found is None:
                return self._any_rows(*given, out=out, workers=workers)
            if checks:
                self._check_limits(found, given)
            return result_of(found, first.shape[: first.ndim - rank], made is not None)

        return rows

    def _any_rows(self, *arguments: Any, out: Out = None, workers: int = 1) -> Any:
        """Return the results for single arrays, lists or numbers; None if more has to be looked at."""
        if len(arguments) != len(self.argument_shapes):
            return None
        if out is not None and not (type(out) is dict and out.keys() <= {*self.outputs}):
            return None
        values, shapes = {}, {}
        for value, (name, tail) in zip(arguments, self.argument_shapes.items(), strict=True):
            array = np.asarray(value) if type(value) in _NUMBERS else _row(value)
            if type(array) is not np.ndarray or array.ndim > MAX_AXES or array.dtype.char not in _READ_CHARACTERS:
                return None
            axes = array.ndim - len(tail)
            if axes < 0 or array.shape[axes:] != tail:
                return None
            values[name], shapes[name] = value if type(value) in _WEAK else array, array.shape[:axes]
        try:
            return self.run(values, shapes, out, workers)
        except ShapeError:  # whose argument may have another name
            return None

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
        shape = broadcast_shape({**shapes, self._constants_name: self._shape})
        dtype = dtype or result_dtype(
            part for value in values.values() for part in (value if isinstance(value, tuple) else (value,))
        )
        samples = math.prod(shape)
        few, given = samples < _FEW_SAMPLES, [values[name] for name in self.argument_shapes]
        kernel = None
        if few or not any(type(one) is tuple for one in given):
            tails = [*self.argument_shapes.values()]
            given = [_joined(one, tail, dtype) for one, tail in zip(given, tails, strict=True)]
            kernel = self._kernel(dtype.char, self._shared and few) if self.has_kernels and samples else None
            if kernel is not None and out is None and samples < _DIRECT_SAMPLES:
                made = kernel[1].make(*(_plain(x, shape, tail, dtype) for x, tail in zip(given, tails, strict=True)))
                if made is not None:
                    self._check_limits(made, given)
                    return self._result_of(made, shape, True)
        named = {(labels or {}).get(name, name): value for name, value in values.items()}
        outputs = output_arrays(self.loop.outputs, shape, dtype, out, named, self.result is None)
        if kernel is not None:
            run_slices(kernel[0], given, [*outputs.values()], shape, workers)
        else:
            arguments = {name: x for name, x in zip(self.argument_shapes, given, strict=True) if name in self._used}
            inputs = {**arguments, **self._bound_constants[self._shared and few]}
            self.loop.run(inputs, outputs, shape, dtype, Execution(self._backend, workers))
        found = tuple(outputs.values())
        self._check_limits(found, given)
        return self._result_of(found, shape, False)

    # ---- limits

    def _check_limits(self, outputs: Sequence[Any], arguments: Sequence[Any]) -> None:
        """Call `on_limit`, which raises an error, if an output exceeds its limit at any sample."""
        for k, limits in self._limits:
            if self._on_limit is not None and (outputs[k] > limits[outputs[k].dtype.itemsize]).any():
                self._on_limit(dict(zip(self.argument_shapes, arguments, strict=True)))


def _result_maker(
    kind: type[Results] | None, outputs: NamedShapes, shown: Sequence[int]
) -> Callable[[tuple[Any, ...], ArrayShape, bool], Any]:
    """Return a function that makes the result of all outputs, their leading shape, and whether they are read-only."""
    if kind is None:
        return lambda found, *_: found[shown[0]]
    make = kind.maker([outputs[k] for k in shown])
    if len(shown) == len(outputs):
        return make
    return lambda found, *rest: make(tuple([found[k] for k in shown]), *rest)


def _plain(array: NDArray[Any], shape: ArrayShape, tail: ArrayShape, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return an array as contiguous samples of the dtype, all or one of them; np.array would keep a dtype that is
    equal, as arrays from pickles have it.
    """
    if array.dtype is dtype and array.flags.c_contiguous and array.shape in {shape + tail, tail}:
        return array
    copied = np.empty(shape + tail, dtype)
    copied[...] = array
    return copied


def _row(numbers: Any) -> Any:
    """Return a list or tuple of numbers as a row of float64, and all else as it is."""
    try:
        plain = type(numbers) in _SEQUENCES and _NUMBERS.issuperset(map(type, numbers))
        return np.array(numbers, np.float64) if plain else numbers
    except OverflowError:
        return numbers


def _joined(value: Any, tail: ArrayShape, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return an argument as one array, a tuple of components too."""
    if type(value) is not tuple:
        return np.asarray(value)
    array = np.empty((*np.broadcast_shapes(*map(np.shape, value)), len(value)), dtype)
    for k, component in enumerate(value):
        array[..., k] = component
    return array.reshape(*array.shape[:-1], *tail)
