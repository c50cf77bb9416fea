"""Functions of scalars that run over samples: traced once for each pattern of inputs, run as NumPy or LLVM.

    loop = Loop("turn", function, inputs={"omega": (3,), "h": ()}, outputs={"q": (4,)})
    loop.run({"omega": omega, "h": h}, {"q": q}, shape, dtype, execution)

`function` takes and returns values by name, a vector as the tuple of its components. It uses arithmetic and the
functions of `trace`.
"""

from __future__ import annotations

import functools
import itertools
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution, compiler_lock
from hingepair.engine.binding import ArrayShape, Bound, InputPattern, NamedShapes, bind
from hingepair.engine.llvm import object_cache
from hingepair.engine.llvm.direct import direct_ir
from hingepair.engine.llvm.ir import kernel_ir
from hingepair.engine.llvm.kernels import FLOAT_TYPES, Code, Layout, Operand, run_slices
from hingepair.engine.llvm.native import Kernel, can_fuse
from hingepair.engine.llvm.scan import scan_ir
from hingepair.engine.llvm.schedule import ComponentGroup, Schedule
from hingepair.engine.threads import run_in_threads
from hingepair.engine.trace import Operand as TracedOperand
from hingepair.engine.trace import Trace, TracedValue, check_size, needed_values
from hingepair.errors import ShapeError
from hingepair.numeric.arrays import Block, split_into_blocks
from hingepair.numeric.blocks import components, fill_blocks, versines
from hingepair.numeric.caching import lock_free_cached_property

Buffers: TypeAlias = Mapping[str, NDArray[Any]]

FUNCTIONS: Final[Mapping[str, Callable[..., Any]]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "negative": operator.neg,
    "<": operator.lt,
    "sin": np.sin,
    "cos": np.cos,
    "versine": versines,
    "sqrt": np.sqrt,
    "arctan2": np.arctan2,
    "hypot": np.hypot,
    "where": np.where,
}

_BLOCK: Final = 2048  # samples that NumPy computes at a time: 16 kB for each component
_HELD_NUMBERS: Final = 30_000_000  # of values that NumPy holds at a time, 240 MB


class Loop:
    """A function of scalars with the shapes of its inputs and outputs, traced once for each pattern of inputs.

    Args:
        name: name of the generated code.
        function: takes values by name, traced or not, and returns results by name.
        inputs: shape of one sample of each input.
        outputs: shape of one sample of each output.
        form: what the function is made of, if that and the sources of `object_cache.TRACED_PACKAGES` decide what it
            computes: numbers, texts and tuples, whose `repr` says all. Then a process that finds the kernel on disk
            need not trace the function.
    """

    def __init__(
        self,
        name: str,
        function: Callable[[dict[str, Any]], Mapping[str, Any]],
        inputs: Mapping[str, ArrayShape],
        outputs: Mapping[str, ArrayShape],
        *,
        form: object = None,
    ) -> None:
        self.name = name
        self.function = function
        self.inputs: NamedShapes = tuple(inputs.items())
        self.outputs: NamedShapes = tuple(outputs.items())
        self.form = form
        self.program = functools.lru_cache(maxsize=256)(functools.partial(Program, self))

    def run(
        self, values: Mapping[str, Any], out: Buffers, shape: ArrayShape, dtype: np.dtype[Any], execution: Execution
    ) -> None:
        """Compute the outputs of all samples.

        Args:
            values: inputs by name: arrays with the components last, or tuples of components; a component is a number
                or an array. All broadcast to the samples.
            out: arrays (*shape, *shape of one sample) of the dtype by output; they may overlap inputs only sample on
                sample.
            shape: shape of the samples.
            dtype: dtype to compute in, float64 or float32.
            execution: backend and number of threads.
        """
        if 0 in shape:
            return
        bound = bind(self.inputs, values)
        program, targets = self.program(bound.pattern), [out[name] for name, _ in self.outputs]
        tails = [*bound.tails, *(tail for _, tail in self.outputs)]
        if execution.backend != "numpy" and bound.arrays and not any(0 in tail for tail in tails):
            inputs = [Operand(tail) for tail in bound.tails]
            code = program.code(inputs, bound.numbers, dtype.char)
            run_slices(code, bound.arrays, targets, shape, execution.workers)
        else:
            program.run_numpy(bound, targets, shape, dtype, execution.workers)

    def count_operations(self, values: Mapping[str, Any]) -> int:
        """Count the operations of each sample for these inputs, of which numbers are known."""
        results = self.program(bind(self.inputs, values).pattern).traced.results
        return sum(value.operation != "input" for value in needed_values(results))


class TracedFunction(NamedTuple):
    """A function traced for one pattern of inputs."""

    constants: tuple[TracedValue, ...]
    arrays: tuple[tuple[TracedValue, ...], ...]  # the components of each input array
    outputs: Mapping[str, tuple[TracedOperand, ...]]  # components by name, in the order of the loop

    @property
    def inputs(self) -> list[TracedValue]:
        """The constants, then the components of all input arrays."""
        return [*self.constants, *itertools.chain(*self.arrays)]

    @property
    def results(self) -> list[TracedOperand]:
        """The components of all outputs."""
        return [*itertools.chain(*self.outputs.values())]


class Program:
    """A loop's function, traced and folded for one pattern of inputs, with its kernels."""

    def __init__(self, loop: Loop, pattern: InputPattern) -> None:
        self.loop = loop
        self.pattern = pattern
        self._kernels: dict[tuple[Layout, str], Kernel] = {}

    def run_numpy(
        self, bound: Bound, out: Sequence[NDArray[Any]], shape: ArrayShape, dtype: np.dtype[Any], workers: int
    ) -> None:
        """Compute the outputs by NumPy, over blocks of samples."""
        inputs = [one for array, tail in zip(bound.arrays, bound.tails, strict=True) for one in _views(array, tail)]
        targets = [
            one for array, (_, tail) in zip(out, self.loop.outputs, strict=True) for one in _views(array, tail)
        ]
        with np.errstate(all="ignore"):
            on_samples = functools.partial(self.interpreter.run, *np.array(bound.numbers, dtype))
        size = min(_BLOCK, max(1, _HELD_NUMBERS // (self.interpreter.width + 1)))
        blocks: list[Block] = [*split_into_blocks(shape, size)] if inputs else [()]
        run_in_threads(lambda block: fill_blocks(on_samples, inputs, targets, dtype, [block]), blocks, workers)

    # ---- kernels

    def code(self, inputs: Sequence[Operand], numbers: Sequence[float], char: str) -> Code:
        """Return the kernel that reads these arrays, for a dtype, with its constants.

        Raises:
            CompilationError: LLVM fails.
        """
        layout = Layout(tuple(inputs), tuple(Operand(tail) for _, tail in self.loop.outputs), bool(numbers))
        with np.errstate(over="ignore"):
            return Code(self.kernel(layout, char), layout, np.array(numbers, char))

    def kernel(self, layout: Layout, char: str) -> Kernel:
        """Return the kernel for a layout and a dtype, "d" (float64) or "f" (float32); compile it at the first call.

        Raises:
            CompilationError: LLVM fails.
        """
        kernel = self._kernels.get((layout, char))
        if kernel is None:
            with compiler_lock:  # a second thread waits, and takes the kernel of the first
                kernel = self._kernels.get((layout, char))
                if kernel is None:
                    ir = functools.partial(self.llvm_ir, layout, char)
                    form = self._form("kernel", layout, char)
                    kernel = self._kernels[layout, char] = Kernel(self.loop.name, ir, FLOAT_TYPES[char], form)
        return kernel

    def scan_kernel(self, arrays: Sequence[str]) -> Kernel:
        """Compile the kernel that repeats this program in steps (`llvm.scan`); `arrays` names the input arrays.

        Raises:
            CompilationError: LLVM fails.
        """

        def ir() -> str:
            traced = self.traced
            outputs = {name: traced.outputs[name] for name, tail in self.loop.outputs if 0 not in tail}
            return scan_ir(traced.constants, dict(zip(arrays, traced.arrays, strict=True)), outputs, fuse=can_fuse())

        return Kernel(self.loop.name, ir, form=self._form("scan"))

    def _form(self, *parts: object) -> str:
        """Return a text that determines, without a trace, what these parts of the program are; "" without a form."""
        loop = self.loop
        sources = object_cache.SOURCE_DIGEST if loop.form is not None else None
        return "" if sources is None else repr((sources, loop.form, loop.inputs, loop.outputs, self.pattern, *parts))

    def llvm_ir(self, layout: Layout, char: str) -> str:
        """Return the LLVM module, as text, of a kernel and of the functions by which Python calls it."""
        traced = self.traced
        outputs = [*map(ComponentGroup, traced.outputs.values())]
        schedule = Schedule(traced.constants, [*map(ComponentGroup, traced.arrays)], outputs, can_fuse())
        kernel = kernel_ir(schedule, FLOAT_TYPES[char])
        return f"{kernel}\n{direct_ir(layout, FLOAT_TYPES[char])}"

    # ---- operations

    def evaluated(
        self, numbers: Sequence[Any], arrays: Iterable[Any], functions: Mapping[str, Callable[..., Any]]
    ) -> dict[str, list[Any]]:
        """Return the components of each output, by name, where `functions` compute the operations.

        Args:
            numbers: values of the constants.
            arrays: values of the components of all input arrays, one after the other.
            functions: of the values, by the names of FUNCTIONS.
        """
        traced = self.traced
        found = iter(interpreter(traced.inputs, traced.results, functions).run(*numbers, *arrays))
        return {name: [*itertools.islice(found, len(group))] for name, group in traced.outputs.items()}

    @lock_free_cached_property
    def interpreter(self) -> Interpreter:
        """The trace as a function of the constants and then the inputs, numbers or arrays of NumPy."""
        return interpreter(self.traced.inputs, self.traced.results)

    @lock_free_cached_property
    def traced(self) -> TracedFunction:
        """The loop's function traced for this pattern of inputs."""
        check_size(sum(math.prod(tail) for _, tail in self.loop.outputs))
        trace, sources = Trace(), iter(self.pattern)
        constants: list[TracedValue] = []
        arrays: dict[int, dict[int, TracedValue]] = {}
        values: dict[str, Any] = {}
        for name, tail in self.loop.inputs:
            operands: list[TracedOperand] = []
            for source in itertools.islice(sources, math.prod(tail)):
                if source is None:
                    constants.append(trace.input())
                    operands.append(constants[-1])
                elif isinstance(source, tuple):
                    columns = arrays.setdefault(source[0], {})
                    if source[1] not in columns:
                        columns[source[1]] = trace.input()
                    operands.append(columns[source[1]])
                else:
                    operands.append(source)
            values[name] = tuple(operands) if tail else operands[0]
        results = self.loop.function(values)
        outputs = {name: components(results[name]) for name, _ in self.loop.outputs}
        for name, tail in self.loop.outputs:
            if len(outputs[name]) != math.prod(tail):  # kernels would write beyond their arrays
                raise ShapeError(
                    name, f"{math.prod(tail)} components of shape {tail}", f"{len(outputs[name])} results"
                )
        ordered = tuple(tuple(columns[k] for k in sorted(columns)) for _, columns in sorted(arrays.items()))
        return TracedFunction(tuple(constants), ordered, outputs)


class Interpreter(NamedTuple):
    """A program as a function of its inputs, numbers or arrays of NumPy, that returns the results."""

    run: Callable[..., list[Any]]
    width: int  # how many values it holds at a time, about


def interpreter(
    inputs: Sequence[TracedValue],
    results: Sequence[TracedOperand],
    functions: Mapping[str, Callable[..., Any]] = FUNCTIONS,
) -> Interpreter:
    """Return the function of a trace; `functions` compute its operations.

    A register holds each value until its last use, and then another one: a block's arrays stay in the cache.
    """
    lines = [value for value in needed_values(results) if value.operation != "input"]
    # The versine is computed from the sine and the cosine, which are recorded before it.
    operands = {id(v): v.operands[v.operation == "versine" :] for v in lines}
    last = {id(one): k for k, value in enumerate(lines) for one in operands[id(value)]}
    last |= {id(one): len(lines) for one in results}
    registers: list[Any] = [None] * len(inputs)
    places = {id(value): k for k, value in enumerate(inputs)}
    free: list[int] = []
    program: list[tuple[Callable[..., Any], int, Callable[[Any], Any], bool]] = []

    def place_of(one: TracedOperand) -> int:
        """Return the register of a value, or of a number, which has one of its own."""
        if isinstance(one, TracedValue):
            return places[id(one)]
        registers.append(float(one))
        return len(registers) - 1

    for k, value in enumerate(lines):
        own = operands[id(value)]
        read = tuple(map(place_of, own))
        free += {places[id(one)] for one in own if isinstance(one, TracedValue) and last[id(one)] == k}
        if not free:
            registers.append(None)
            free.append(len(registers) - 1)
        places[id(value)] = free.pop()
        program.append((functions[value.operation], places[id(value)], operator.itemgetter(*read), len(read) == 1))
    ends, rest = [*map(place_of, results)], registers[len(inputs) :]

    def run(*given: Any) -> list[Any]:
        values = [*given, *rest]
        for function, target, operands_of, is_single in program:
            values[target] = function(operands_of(values)) if is_single else function(*operands_of(values))
        return [values[k] for k in ends]

    return Interpreter(run, len(registers))


def _views(array: NDArray[Any], tail: ArrayShape) -> list[NDArray[Any]]:
    """Return views of the components of one sample, in order."""
    return [array[(..., *index)] for index in np.ndindex(*tail)]
