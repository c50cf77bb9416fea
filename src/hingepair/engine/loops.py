"""Functions of scalars that run over samples: traced once for each pattern of inputs, run as NumPy, Python or LLVM.

    loop = Loop("turn", function, inputs={"omega": (3,), "h": ()}, outputs={"q": (4,)})
    loop.run({"omega": omega, "h": h}, {"q": q}, shape, dtype, execution)

`function` takes and returns values by name, a vector as the tuple of its components. It uses arithmetic and the
functions of `trace`. A loop with a carry is a scan: the samples along the last axis form a chain, in which each
sample takes results of the sample before it.
"""

from __future__ import annotations

import functools
import itertools
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.engine import object_cache, python_source
from hingepair.engine.backend import Execution, compiler_lock, kernel_pays
from hingepair.engine.binding import (
    ArrayShape,
    BoundInputs,
    InputPattern,
    NamedShapes,
    bind,
    bind_foreign,
    component_views,
)
from hingepair.engine.llvm_arithmetic import Carry, ComponentGroup
from hingepair.engine.llvm_builder import float_type_name
from hingepair.engine.llvm_ir import kernel_ir
from hingepair.engine.slices import run_in_threads, run_slices
from hingepair.engine.trace import (
    NON_ARITHMETIC_OPERATION_NAMES,
    Trace,
    TracedValue,
    component_name,
    name_components,
    needed_values,
    operation_count,
)
from hingepair.engine.trace import Operand as TracedOperand
from hingepair.engine.ufunc import MAX_OPERANDS, Layout, Operand, Ufunc, loop_ir
from hingepair.errors import CompilationError
from hingepair.numeric.array_libraries import Library
from hingepair.numeric.arrays import Block, load, split_into_blocks
from hingepair.numeric.blocks import components, fill_blocks
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.numeric.sampled import Sampled, sampled_value

if TYPE_CHECKING:
    from hingepair.engine.native import Kernel

Buffers: TypeAlias = Mapping[str, NDArray[Any]]

_NUMPY_SAMPLES_PER_BLOCK: Final = 2048
"""Number of samples that NumPy computes at a time: 16 kB for each component."""

_MAX_STACKED_BYTES: Final = 4_000_000
"""Number of bytes of components that are stacked at a time where they are too many for a ufunc."""

_MAX_UNTRACED_NUMBERS: Final = 30_000_000
"""Numbers that a function without a trace may hold at a time (240 MB): the outputs, and some four for each input."""

_WEIGHT_OF_NON_ARITHMETIC_OPERATION: Final = 10
"""Number of operations that a sine, a square root and the like count as."""


class Loop:
    """A function of scalars with the shapes of its inputs and outputs. The method `run` computes the function at many
    samples by NumPy, Python or machine code. The function is traced once for each pattern of inputs, which says which
    components are known numbers, constants or arrays.

    Args:
        name: name of the generated code.
        function: takes values by name, traced or not, and returns results by name.
        inputs: shape of one sample of each input.
        outputs: shape of one sample of each output.
        exact: whether the compiled code may not fuse products with sums (FMA), which breaks compensated arithmetic.
        carry: makes the loop a scan: for each carried input, the result that becomes its value at the next sample.
            The value given for a carried input is the start of each chain.
        labels: names of the components of inputs in generated code; by default the input's name and a number.
        form: what the function is made of, if that and the sources of `object_cache.TRACED_PACKAGES` decide what it
            computes: numbers, texts and tuples, whose `repr` says all. Then a process that finds the kernel on disk
            need not trace the function.
        traced: whether `run` traces the function. If not, the function computes with arrays of samples itself, one
            operation after the other: for functions of so many operations that straight-line code takes long to make.
    """

    def __init__(
        self,
        name: str,
        function: Callable[[dict[str, Any]], Mapping[str, Any]],
        inputs: Mapping[str, ArrayShape],
        outputs: Mapping[str, ArrayShape],
        *,
        exact: bool = False,
        carry: Mapping[str, str] | None = None,
        labels: Mapping[str, Sequence[str]] | None = None,
        form: object = None,
        traced: bool = True,
    ) -> None:
        self.name = name
        self.function = function
        self.inputs: NamedShapes = tuple(inputs.items())
        self.outputs: NamedShapes = tuple(outputs.items())
        self.exact = exact
        self.carry = dict(carry or {})
        self.labels = dict(labels or {})
        self.form = form
        self.traced = traced
        self.program = functools.lru_cache(maxsize=256)(functools.partial(Program, self))

    def run(
        self, values: Mapping[str, Any], out: Buffers, shape: ArrayShape, dtype: np.dtype[Any], execution: Execution
    ) -> None:
        """Compute the outputs of all samples from `values`, a dictionary of numbers, arrays and tuples of them by
        input name, and write them into the arrays of `out`, a dictionary by output name. Each of these arrays has the
        shape (*shape, *shape of one sample). `execution` holds the backend and the number of threads. May compile a
        kernel; the backend "compiled" raises an error if that fails.

        Args:
            values: inputs by name: arrays with the components last, or tuples of components; a component is a number
                or an array. All broadcast to the samples.
            out: arrays of the dtype by output; they may overlap inputs only sample on sample.
            shape: shape of the samples; the last axis of a scan is the chain.
            dtype: dtype to compute in, float64 or float32.
            execution: backend and number of threads.
        """
        if 0 in shape:
            return
        bound = bind(self.inputs, values, frozenset(self.carry))
        if not self.traced:
            self._run_untraced(bound, out, shape, dtype, execution.workers)
            return
        if not bound.arrays and execution.backend == "compiled":  # one sample is rounded as many samples are
            bound = bind(self.inputs, values, keep_single_samples=True)
        self.program(bound.pattern).run(bound, out, shape, dtype, execution)

    def _run_untraced(
        self, bound: BoundInputs, out: Buffers, shape: ArrayShape, dtype: np.dtype[Any], workers: int
    ) -> None:
        """Compute the outputs by the function itself, over blocks of samples that are shared by the threads."""
        views = [view for name, tail in self.outputs for view in component_views(out[name], tail)]
        targets = [view[..., k] for view in views for k in range(view.shape[-1])]
        constants = [dtype.type(x) for x in bound.constants]

        def run_blocks(blocks: Sequence[Block]) -> None:
            """Compute blocks of samples, one after the other."""
            with np.errstate(all="ignore"):
                for block in blocks:
                    arrays = [load(one, (*block, slice(one.shape[-1])), dtype) for one in bound.arrays]
                    results = self._untraced_results(bound.pattern, constants, arrays)
                    for target, result in zip(targets, results, strict=True):
                        target[block] = result

        size = _MAX_UNTRACED_NUMBERS // (len(targets) + 4 * len(bound.pattern) + 1)
        size = max(1, min(_NUMPY_SAMPLES_PER_BLOCK, size))
        blocks: list[Block] = [*split_into_blocks(shape, size)] if bound.arrays else [()]
        workers = min(workers, len(blocks))
        run_in_threads(run_blocks, [blocks[i::workers] for i in range(workers)])

    def _untraced_results(self, pattern: InputPattern, constants: Sequence[Any], arrays: Sequence[Any]) -> list[Any]:
        """Return the components of all outputs, which the function computes for inputs bound by a pattern."""
        rest, parts = iter(constants), iter(pattern)
        values: dict[str, Any] = {}
        for name, tail in self.inputs:
            group = tuple(
                Sampled(arrays[one[0]][..., one[1]])
                if isinstance(one, tuple)
                else Sampled(next(rest))
                if one is None
                else one
                for one in itertools.islice(parts, math.prod(tail))
            )
            values[name] = group if tail else group[0]
        results = self.function(values)
        return [sampled_value(one) for name, _ in self.outputs for one in components(results[name])]

    def foreign_outputs(self, values: Mapping[str, Any], library: Library) -> dict[str, tuple[Any, ...]]:
        """Return a dictionary of outputs computed by another array library from `values`, a dictionary of numbers,
        arrays of the library and tuples of them by input name. Each output is a tuple of its components, even if the
        output is a scalar.

        Args:
            values: inputs by name: numbers and arrays of the library, vectors as tuples of numbers and arrays.
            library: the array library.
        """
        pattern, constants, arrays = bind_foreign(self.inputs, values)
        if self.traced:
            flat = iter(self.program(pattern).function_for_library(library)(*constants, *arrays))
        else:
            flat = iter(self._untraced_results(pattern, constants, [one[..., None] for one in arrays]))
        return {
            name: tuple(next(flat) for _ in range(math.prod(sample_shape))) for name, sample_shape in self.outputs
        }


class OperationCounts(NamedTuple):
    """Numbers of operations of a program: `per_sample` counts the operations done for each sample, `shared` the
    operations done once for all samples, and `unfolded` the operations of the program for which no input is known.

    Attributes:
        per_sample: operations for each sample.
        shared: operations that are done once for all samples.
        unfolded: operations of the program for which no input is known beforehand.
    """

    per_sample: int
    shared: int
    unfolded: int

    @property
    def folded(self) -> int:
        """Number of operations that known inputs make unnecessary."""
        return self.unfolded - self.per_sample - self.shared


class TracedFunction(NamedTuple):
    """A traced function: `constants` are the traced values of its constants, `arrays` holds for each input array the
    traced values of its components, and `results` are its results by name.

    Attributes:
        constants: traced values of the constants.
        arrays: traced values of the components of each input array.
        results: results by name.
    """

    constants: tuple[TracedValue, ...]
    arrays: tuple[tuple[TracedValue, ...], ...]
    results: dict[str, Any]

    def output_components(self, outputs: NamedShapes) -> list[TracedOperand]:
        """Return the components of the named outputs in one flat list. `outputs` holds pairs (name, shape of one
        sample).
        """
        return [component for name, _ in outputs for component in components(self.results[name])]


class Program:
    """A loop's function, traced and folded for one pattern of inputs, which says which components are known numbers,
    constants or arrays. The method `run` computes the outputs by NumPy, Python or a kernel; the generated Python
    functions and the compiled kernels are cached.

    Args:
        loop: the loop.
        pattern: the source of each component of each input.
    """

    def __init__(self, loop: Loop, pattern: InputPattern) -> None:
        self.loop = loop
        self.pattern = pattern
        self._kernels: dict[tuple[Layout, str], Kernel] = {}
        self._ufuncs: dict[tuple[Layout, str], Ufunc] = {}
        self._compiles = True  # until LLVM fails

    # ---- running

    def run(
        self, bound: BoundInputs, out: Buffers, shape: ArrayShape, dtype: np.dtype[Any], execution: Execution
    ) -> None:
        """Compute the outputs from the inputs `bound` by NumPy, Python or a kernel, as `execution` says, and write
        them into the arrays of `out`, a dictionary by output name. `shape` is the shape of the samples. May compile a
        kernel; the backend "compiled" raises an error if that fails.
        """
        if (
            bound.arrays
            and self._takes_kernel(shape, execution.backend)
            and self._run_kernel(bound, out, shape, dtype, execution)
        ):
            return
        targets = [
            view for name, sample_shape in self.loop.outputs for view in component_views(out[name], sample_shape)
        ]
        self._run_numpy(bound, targets, shape, dtype, execution.workers)

    def _takes_kernel(self, shape: ArrayShape, backend: str) -> bool:
        """Return whether a kernel computes samples of this shape. There is none of an output without components, as
        of a robot without joints.
        """
        if backend == "numpy" or any(0 in sample_shape for _, sample_shape in self.loop.outputs):
            return False
        chain_length = shape[-1] if self.loop.carry else 1
        return backend == "compiled" or kernel_pays(self.weighted_operations, math.prod(shape), chain_length)

    def _run_kernel(
        self, bound: BoundInputs, out: Buffers, shape: ArrayShape, dtype: np.dtype[Any], execution: Execution
    ) -> bool:
        """Compute the outputs by a kernel, and return True; return False if there is none."""
        chained = bool(self.loop.carry)
        outputs = [out[name] for name, _ in self.loop.outputs]
        if len(bound.arrays) + len(outputs) >= MAX_OPERANDS:
            self._run_stacked(bound, out, shape, dtype, execution)
            return True
        inputs = [*bound.arrays]
        if chained:  # each has the axis of the chain
            axes = [max(0, 2 - one.ndim) for one in inputs]
            inputs = [one[(None,) * n] for one, n in zip(inputs, axes, strict=True)]
            inputs = [np.broadcast_to(one, (*one.shape[:-2], shape[-1], one.shape[-1])) for one in inputs]
        operands = [Operand((one.shape[-1],), chained=chained) for one in inputs]
        if bound.constants:
            inputs = [np.array(bound.constants, dtype), *inputs]
            operands = [Operand((len(bound.constants),)), *operands]
        layout = Layout(
            tuple(operands), tuple(Operand(tail, chained=chained) for _, tail in self.loop.outputs), False
        )
        ufunc = self._ufuncs.get((layout, dtype.char))
        if ufunc is None:
            compiled = self.kernel if execution.backend == "compiled" else self.kernel_or_none
            kernel = compiled(layout, dtype.char)
            if kernel is None:
                return False
            loops = [(dtype.char, kernel.address("loop"), None)]
            ufunc = self._ufuncs[layout, dtype.char] = Ufunc(self.loop.name, layout, loops, kernel)
        tails = [sample_shape for _, sample_shape in self.loop.outputs]
        run_slices(
            ufunc.call,
            inputs,
            outputs,
            [*(1 + one.chained for one in operands), *(chained + len(tail) for tail in tails)],
            shape[:-1] if chained else shape,
            operations=self.weighted_operations * (shape[-1] if chained else 1),
            workers=execution.workers,
        )
        return True

    def _run_stacked(
        self, bound: BoundInputs, out: Buffers, shape: ArrayShape, dtype: np.dtype[Any], execution: Execution
    ) -> None:
        """Compute the outputs from more arrays than a ufunc takes: in one array of all components, block by block."""
        starts = [0, *itertools.accumulate(one.shape[-1] for one in bound.arrays)]
        pattern = tuple((0, starts[one[0]] + one[1]) if isinstance(one, tuple) else one for one in self.pattern)
        program = self.loop.program(pattern)
        for block in split_into_blocks(shape, max(1, _MAX_STACKED_BYTES // (dtype.itemsize * starts[-1]))):
            block_shape = tuple(axis.stop - axis.start for axis in block)
            parts = [load(one, (*block, slice(one.shape[-1])), dtype) for one in bound.arrays]
            stacked = np.concatenate([np.broadcast_to(one, (*block_shape, one.shape[-1])) for one in parts], axis=-1)
            buffers = {name: array[block] for name, array in out.items()}
            program.run(BoundInputs(pattern, bound.constants, [stacked]), buffers, block_shape, dtype, execution)

    def kernel_or_none(self, layout: Layout, char: str) -> Kernel | None:
        """Return the kernel for a layout and a dtype. If it cannot be compiled, warn once and return None; the
        backend "auto" does not try again.
        """
        try:
            return self.kernel(layout, char) if self._compiles else None
        except CompilationError as error:
            warnings.warn(f"{error}; computing with NumPy", RuntimeWarning, stacklevel=2)
            self._compiles = False
        return None

    def kernel(self, layout: Layout, char: str) -> Kernel:
        """Return the kernel for a layout and a dtype, "d" (float64) or "f" (float32); compile it at the first call.

        Raises:
            CompilationError: LLVM fails.
        """
        kernel = self._kernels.get((layout, char))
        if kernel is None:
            with compiler_lock:  # a second thread waits, and takes the kernel of the first
                from hingepair.engine.native import Kernel

                kernel = self._kernels.get((layout, char))
                if kernel is None:
                    ir = functools.partial(self.llvm_ir, layout, char)
                    form = self._form("kernel", layout, char, self.fuses)
                    kernel = Kernel(self.loop.name, ir, float_type_name(char == "f"), form)
                    self._kernels[layout, char] = kernel
        return kernel

    def _form(self, *parts: object) -> str:
        """Return a text that decides, without a trace, what these parts of the program are, or an empty text."""
        loop = self.loop
        sources = object_cache.source_digest() if loop.form is not None else None
        if sources is None:
            return ""
        return repr((sources, loop.form, loop.inputs, loop.outputs, loop.carry, self.pattern, *parts))

    @property
    def fuses(self) -> bool:
        """Whether a product and a sum become one instruction of kernels (FMA)."""
        from hingepair.engine.native import can_fuse

        return can_fuse() and not self.loop.exact

    def llvm_ir(self, layout: Layout, char: str) -> str:
        """Return the LLVM module, as text, of a kernel and of the loop by which a ufunc calls it.

        Args:
            layout: arrays of the ufunc.
            char: character of the dtype, "d" or "f".
        """
        traced = self._traced
        inputs = [ComponentGroup(traced.constants, False)] if traced.constants else []
        start = [value for name in self.loop.carry for value in components(traced.results["before"][name])]
        carried = {id(value) for value in start}
        inputs += [ComponentGroup(array, carried.isdisjoint(map(id, array))) for array in traced.arrays]
        outputs = [ComponentGroup(components(traced.results[name])) for name, _ in self.loop.outputs]
        carry = None
        if self.loop.carry:
            after = [value for name in self.loop.carry.values() for value in components(traced.results[name])]
            carry = Carry(tuple(start), tuple(after))
        kernel = kernel_ir(inputs, outputs, single=char == "f", fuse=self.fuses, carry=carry)
        return f"{kernel}\n{loop_ir(layout, float_type_name(char == 'f'))}"

    def _run_numpy(
        self,
        bound: BoundInputs,
        targets: Sequence[NDArray[Any]],
        shape: ArrayShape,
        dtype: np.dtype[Any],
        workers: int,
    ) -> None:
        """Compute the outputs from the bound inputs by NumPy, in blocks of samples shared by at most `workers`
        threads, and write them into `targets`, views of the outputs with the components last. Without input arrays,
        float64 outputs are computed once in Python floats.
        """
        if not bound.arrays and dtype == np.float64:
            results = self.floats_function(*bound.constants)
            for target in targets:
                width = target.shape[-1]
                target[...], results = results[:width], results[width:]
            return
        constants = bound.constants if dtype == np.float64 else [dtype.type(x) for x in bound.constants]
        inputs = [array[..., k] for array in bound.arrays for k in range(array.shape[-1])]
        outputs = [target[..., k] for target in targets for k in range(target.shape[-1])]
        if self.loop.carry:
            self._run_numpy_scan(constants, inputs, outputs, shape, dtype)
            return
        function = functools.partial(self.arrays_function, *constants)
        run_blocks = functools.partial(fill_blocks, function, inputs, outputs, dtype)
        blocks: list[Block] = [*split_into_blocks(shape, _NUMPY_SAMPLES_PER_BLOCK)] if inputs else [()]
        workers = min(workers, len(blocks))
        run_in_threads(run_blocks, [blocks[i::workers] for i in range(workers)])

    # ---- generated code

    @lock_free_cached_property
    def source(self) -> str:
        """Source of the generated Python function, cached."""
        traced = self._traced
        inputs = [*traced.constants, *(value for array in traced.arrays for value in array)]
        after = [value for name in self.loop.carry.values() for value in components(traced.results[name])]
        outputs = traced.output_components(self.loop.outputs)
        return python_source.function_source(self.loop.name, inputs, [*outputs, *after])

    @lock_free_cached_property
    def floats_function(self) -> Callable[..., tuple[Any, ...]]:
        """Generated function of Python floats for one state, cached. It takes the constants, then the inputs, and
        returns a flat tuple of components.
        """
        return python_source.compile_for_floats(self.loop.name, self.source)

    @lock_free_cached_property
    def arrays_function(self) -> Callable[..., tuple[Any, ...]]:
        """Generated function of NumPy arrays, cached. It takes the constants, then the inputs, and returns a flat
        tuple of components.
        """
        return python_source.compile_for_arrays(self.loop.name, self.source)

    @lock_free_cached_property
    def function_for_library(self) -> Callable[[Library], Callable[..., tuple[Any, ...]]]:
        """Cached function that takes an array library and returns the generated function for arrays of that
        library.
        """
        return functools.lru_cache(maxsize=8)(
            functools.partial(python_source.compile_for_library, self.loop.name, self.source)
        )

    @lock_free_cached_property
    def weighted_operations(self) -> int:
        """Number of operations of the program, in which a sine or square root counts as several operations;
        cached, on disk too.
        """
        form = self._form("operations")
        key = object_cache.cache_key(form)
        kept = object_cache.read_object(key) if form else None
        if kept is not None:
            return int(kept)
        count = sum(
            (_WEIGHT_OF_NON_ARITHMETIC_OPERATION if value.operation in NON_ARITHMETIC_OPERATION_NAMES else 1)
            for value in self._needed_values
            if value.operation != "input"
        )
        if form:
            object_cache.write_object(key, b"%d" % count)
        return count

    def count_operations(self, unfolded: Program) -> OperationCounts:
        """Return the `OperationCounts` of this program. `unfolded` is the program of the same loop for which no input
        is known.
        """
        per_sample, shared = (operation_count(self._needed_values, varies) for varies in (True, False))
        return OperationCounts(per_sample, shared, operation_count(unfolded._needed_values))

    @lock_free_cached_property
    def _needed_values(self) -> list[TracedValue]:
        """List of the traced values that the outputs need, each after its operands; cached."""
        return needed_values(self._traced.output_components(self.loop.outputs))

    @lock_free_cached_property
    def _traced(self) -> TracedFunction:
        """The loop's function traced for this pattern of inputs."""
        trace, sources = Trace(), iter(self.pattern)
        constants: list[TracedValue] = []
        arrays: dict[int, dict[int, TracedValue]] = {}
        values: dict[str, Any] = {}
        for name, sample_shape in self.loop.inputs:
            operands: list[TracedOperand] = []
            count = math.prod(sample_shape)
            for k in range(count):
                source, labels = next(sources), self.loop.labels.get(name)
                label = labels[k] if labels else component_name(name, k, count)
                if source is None:
                    constants.append(trace.input(label, False))
                    operands.append(constants[-1])
                elif isinstance(source, tuple):
                    array, component = source
                    columns = arrays.setdefault(array, {})
                    if component not in columns:
                        columns[component] = trace.input(label, True)
                    operands.append(columns[component])
                else:
                    operands.append(source)
            values[name] = tuple(operands) if sample_shape else operands[0]
        before = {name: values[name] for name in self.loop.carry}
        results = {**self.loop.function(values), "before": before}
        for name, _ in self.loop.outputs:
            name_components(name, results[name])
        ordered = tuple(tuple(columns[k] for k in sorted(columns)) for _, columns in sorted(arrays.items()))
        return TracedFunction(tuple(constants), ordered, results)

    def _run_numpy_scan(
        self,
        constants: Sequence[Any],
        inputs: Sequence[Any],
        outputs: Sequence[Any],
        shape: ArrayShape,
        dtype: np.dtype[Any],
    ) -> None:
        """Run a scan, in which each sample takes results of the sample before it on the last axis of `shape`, by
        NumPy for all other axes at once, and write the results into `outputs`. `inputs` and `outputs` hold one array
        for each component.
        """
        names = [name for name, sample_shape in self.loop.inputs for _ in range(math.prod(sample_shape))]
        sources = [*zip(names, self.pattern, strict=True)]
        columns = {source: k for k, source in enumerate(sorted({s for _, s in sources if isinstance(s, tuple)}))}
        carried = [columns[s] for name, s in sources if name in self.loop.carry and isinstance(s, tuple)]
        chains = shape[:-1]
        arrays = [np.broadcast_to(array, shape) for array in inputs]
        state = {k: arrays[k][..., 0].astype(dtype) for k in carried}
        with np.errstate(all="ignore"):
            for j in range(shape[-1]):
                sample = [state[k] if k in state else array[..., j].astype(dtype) for k, array in enumerate(arrays)]
                results = self.arrays_function(*constants, *sample)
                for k, after in zip(carried, results[len(outputs) :], strict=True):
                    has_all_chains = np.shape(after) == chains
                    state[k] = after if has_all_chains else np.broadcast_to(np.asarray(after, dtype), chains)
                for output, result in zip(outputs, results, strict=False):
                    output[..., j] = result
