"""Functions of scalars that run over samples: traced once for each pattern of inputs, run as NumPy, Python or LLVM.

    loop = Loop("turn", function, inputs={"omega": (3,), "h": ()}, outputs={"q": (4,)})
    loop.run({"omega": omega, "h": h}, {"q": q}, shape, dtype, execution)

`function` takes and returns values by name, a vector as the tuple of its components. It uses arithmetic and the
functions of `trace`. A loop with a carry is a scan: the samples along the last axis form a chain, in which each
sample takes results of the sample before it.
"""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from hingepair.engine import python_source
from hingepair.engine.backend import BreakEvenCounter, Execution, disable_kernels
from hingepair.engine.binding import (
    ArrayShape,
    BoundInputs,
    InputPattern,
    NamedShapes,
    bind,
    bind_foreign,
    component_views,
    layout_of,
    run_in_threads,
    run_kernel,
    shapes_and_strides,
)
from hingepair.engine.llvm_arithmetic import Carry, ComponentGroup
from hingepair.engine.llvm_builder import float_type_name
from hingepair.engine.llvm_ir import kernel_ir
from hingepair.engine.trace import (
    NON_ARITHMETIC_OPERATION_NAMES,
    Operand,
    Trace,
    TracedValue,
    component_name,
    name_components,
    needed_values,
    operation_count,
)
from hingepair.errors import CompilationError, MissingDependencyError
from hingepair.numeric.array_libraries import Library
from hingepair.numeric.arrays import Block, load, split_into_blocks

if TYPE_CHECKING:
    from hingepair.engine.native import Kernel

Buffers: TypeAlias = Mapping[str, NDArray[Any]]

_NUMPY_SAMPLES_PER_BLOCK: Final = 2048
"""Number of samples that NumPy computes at a time: 16 kB for each component."""

_MAX_BYTES_PER_BLOCK_OF_CONVERTED_INPUTS: Final = 4_000_000
"""Number of bytes that are converted to another dtype at a time (one block is still held while the next is made)."""

_WEIGHT_OF_NON_ARITHMETIC_OPERATION: Final = 10
"""Number of operations that a sine, a square root and the like count as."""


class KernelKey(NamedTuple):
    """Key by which a program finds a kernel. `uniform` says for each input array whether it is equal for all inner
    samples, `widths` holds the numbers of components of the output arrays, and dtype_char is "d" (float64) or "f"
    (float32).

    Attributes:
        uniform: for each input array, whether it stays the same along the inner axis.
        widths: numbers of components of the output arrays.
        dtype_char: character of the dtype, "d" or "f".
    """

    uniform: tuple[bool, ...]
    widths: tuple[int, ...]
    dtype_char: str


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
    ) -> None:
        self.name = name
        self.function = function
        self.inputs: NamedShapes = tuple(inputs.items())
        self.outputs: NamedShapes = tuple(outputs.items())
        self.exact = exact
        self.carry = dict(carry or {})
        self.labels = dict(labels or {})
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
        if not bound.arrays and execution.backend == "compiled":  # one sample is rounded as many samples are
            bound = bind(self.inputs, values, keep_single_samples=True)
        self.program(bound.pattern).run(bound, out, shape, dtype, execution)

    def foreign_outputs(self, values: Mapping[str, Any], library: Library) -> dict[str, tuple[Any, ...]]:
        """Return a dictionary of outputs computed by another array library from `values`, a dictionary of numbers,
        arrays of the library and tuples of them by input name. Each output is a tuple of its components, even if the
        output is a scalar.

        Args:
            values: inputs by name: numbers and arrays of the library, vectors as tuples of numbers and arrays.
            library: the array library.
        """
        pattern, constants, arrays = bind_foreign(self.inputs, values)
        flat = iter(self.program(pattern).function_for_library(library)(*constants, *arrays))
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

    def output_components(self, outputs: NamedShapes) -> list[Operand]:
        """Return the components of the named outputs in one flat list. `outputs` holds pairs (name, shape of one
        sample).
        """
        return [component for name, _ in outputs for component in components(self.results[name])]


_CachedType = TypeVar("_CachedType")


class _LockFreeCachedProperty(functools.cached_property[_CachedType]):
    """A cached property without a lock. In Python 3.11, a fork could leave the lock of `functools.cached_property`
    held for ever in the child process.
    """

    def __get__(self, instance: Any, owner: type[Any] | None = None) -> _CachedType:  # type: ignore[override]
        value = instance.__dict__[self.attrname] = self.func(instance)
        return value


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
        self._kernels: dict[KernelKey, Kernel] = {}
        self._break_even_counters: dict[KernelKey, BreakEvenCounter] = {}
        self._compiles = True  # until LLVM fails

    # ---- running

    def run(
        self, bound: BoundInputs, out: Buffers, shape: ArrayShape, dtype: np.dtype[Any], execution: Execution
    ) -> None:
        """Compute the outputs from the inputs `bound` by NumPy, Python or a kernel, as `execution` says, and write
        them into the arrays of `out`, a dictionary by output name. `shape` is the shape of the samples. May compile a
        kernel; the backend "compiled" raises an error if that fails.
        """
        targets = [
            view for name, sample_shape in self.loop.outputs for view in component_views(out[name], sample_shape)
        ]
        if not bound.arrays or execution.backend == "numpy":
            self._run_numpy(bound, targets, shape, dtype, execution.workers)
            return
        chained = bool(self.loop.carry)
        layout = layout_of(shapes_and_strides((*bound.arrays, *targets)), shape, chained)
        uniform = tuple(inner == 0 for _, inner, _ in layout.strides[: len(bound.arrays)])
        key = KernelKey(uniform, tuple(target.shape[-1] for target in targets), dtype.char)
        if execution.backend == "auto":
            kernel = self.kernel_at_break_even(key, math.prod(shape), shape[-1] if chained else 1)
        else:
            kernel = self.kernel(key)
        if kernel is None:
            self._run_numpy(bound, targets, shape, dtype, execution.workers)
        elif all(array.dtype == dtype for array in bound.arrays):
            constants = np.array(bound.constants, dtype) if bound.constants else None
            run_kernel(kernel.run, layout, bound.arrays, targets, constants, execution.workers, chained)
        else:  # in blocks, so that the converted copies take little memory
            sample_bytes = dtype.itemsize * sum(array.shape[-1] for array in bound.arrays)
            for block in split_into_blocks(shape, max(1, _MAX_BYTES_PER_BLOCK_OF_CONVERTED_INPUTS // sample_bytes)):
                converted = [load(array, (*block, slice(array.shape[-1])), dtype) for array in bound.arrays]
                buffers = {name: array[block] for name, array in out.items()}
                block_shape = tuple(axis.stop - axis.start for axis in block)
                compiled = Execution("compiled", execution.workers)
                self.run(bound._replace(arrays=converted), buffers, block_shape, dtype, compiled)

    def default_kernel_key(self) -> KernelKey:
        """Return the key of the kernel for float64 inputs that all vary from sample to sample and outputs that are
        contiguous within a sample.
        """
        arrays = {source[0] for source in self.pattern if isinstance(source, tuple)}
        return KernelKey(
            (False,) * len(arrays), tuple(math.prod(sample_shape) for _, sample_shape in self.loop.outputs), "d"
        )

    def kernel_at_break_even(self, key: KernelKey, samples: int, chain_length: int = 1) -> Kernel | None:
        """Return the kernel with this key if it exists. Otherwise count a call with `samples` samples; if compiling
        pays now, compile and return the kernel, else return None. `samples` is 0 for one state that Python computes;
        chain_length is the number of samples of each chain of a scan. Warns and returns None if compiling fails.

        `backend.BreakEvenCounter` decides when compiling pays.

        Args:
            key: key of the kernel.
            samples: number of samples of the call; 0 of one state that Python computes.
            chain_length: number of samples of each chain of a scan.
        """
        kernel = self._kernels.get(key)
        if kernel is not None or not self._compiles:
            return kernel
        counter = self._break_even_counters.get(key)
        if counter is None:
            counter = BreakEvenCounter(self.weighted_operations, sum(key.widths))
            counter = self._break_even_counters.setdefault(key, counter)
        pays = counter.count_call(samples, chain_length) if samples else counter.count_state_call()
        return self.kernel_or_none(key) if pays else None

    def existing_kernel(self, key: KernelKey) -> Kernel | None:
        """Return the kernel with this key if it is already compiled, else None."""
        return self._kernels.get(key)

    def kernel_or_none(self, key: KernelKey) -> Kernel | None:
        """Return the kernel with this key, compiled if necessary. If it cannot be compiled, warn once and return
        None; the backend "auto" does not try again.
        """
        try:
            return self.kernel(key)
        except MissingDependencyError as error:
            disable_kernels(error)
        except CompilationError as error:
            if self._compiles:
                warnings.warn(f"{error}; computing with NumPy", RuntimeWarning, stacklevel=2)
            self._compiles = False
        return None

    def kernel(self, key: KernelKey) -> Kernel:
        """Return the kernel with this key; compile and cache it at the first call. Raises an error if llvmlite is
        missing or LLVM fails.

        Raises:
            MissingDependencyError: llvmlite is not installed.
            CompilationError: LLVM fails.
        """
        kernel = self._kernels.get(key)
        if kernel is None:
            from hingepair.engine.native import Kernel, can_fuse, compiler_lock

            with compiler_lock:  # a second thread waits, and takes the kernel of the first
                kernel = self._kernels.get(key)
                if kernel is None:
                    ir = self.llvm_ir(*key, fuse=can_fuse() and not self.loop.exact)
                    kernel = self._kernels[key] = Kernel(self.loop.name, ir, float_type_name(key.dtype_char == "f"))
        return kernel

    def llvm_ir(self, uniform: tuple[bool, ...], widths: tuple[int, ...], dtype_char: str, fuse: bool) -> str:
        """Return the LLVM IR of a kernel, as text. `uniform` says for each input array whether it is equal for all
        inner samples, `widths` are the numbers of components of the output arrays, dtype_char is "d" (float64) or "f"
        (float32), and `fuse` allows fused multiply-adds.

        Args:
            uniform: for each input array, whether it stays the same along the inner axis.
            widths: numbers of components of the output arrays.
            dtype_char: character of the dtype, "d" or "f".
            fuse: whether a product and a sum become one instruction (FMA).
        """
        traced = self.traced(uniform)
        inputs = [ComponentGroup(traced.constants, False)] if traced.constants else []
        inputs += [ComponentGroup(array, not same) for array, same in zip(traced.arrays, uniform, strict=True)]
        flat, outputs = traced.output_components(self.loop.outputs), []
        for width in widths:
            outputs.append(ComponentGroup(tuple(flat[:width])))
            del flat[:width]
        carry = None
        if self.loop.carry:
            before = [value for name in self.loop.carry for value in components(traced.results["before"][name])]
            after = [value for name in self.loop.carry.values() for value in components(traced.results[name])]
            carry = Carry(tuple(before), tuple(after))
        return kernel_ir(inputs, outputs, single=dtype_char == "f", fuse=fuse, carry=carry)

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
        function = self.arrays_function

        def run_blocks(blocks: Sequence[Block]) -> None:
            """Compute blocks of samples, given by their indices, one after the other, and write them into the
            outputs.
            """
            with np.errstate(all="ignore"):
                for block in blocks:
                    results = function(*constants, *(load(array, block, dtype) for array in inputs))
                    for output, result in zip(outputs, results, strict=True):
                        output[block] = result

        blocks: list[Block] = [*split_into_blocks(shape, _NUMPY_SAMPLES_PER_BLOCK)] if inputs else [()]
        workers = min(workers, len(blocks))
        run_in_threads(run_blocks, [blocks[i::workers] for i in range(workers)])

    # ---- generated code

    @_LockFreeCachedProperty
    def source(self) -> str:
        """Source of the generated Python function, cached."""
        traced = self._varying_trace
        inputs = [*traced.constants, *(value for array in traced.arrays for value in array)]
        after = [value for name in self.loop.carry.values() for value in components(traced.results[name])]
        outputs = traced.output_components(self.loop.outputs)
        return python_source.function_source(self.loop.name, inputs, [*outputs, *after])

    @_LockFreeCachedProperty
    def floats_function(self) -> Callable[..., tuple[Any, ...]]:
        """Generated function of Python floats for one state, cached. It takes the constants, then the inputs, and
        returns a flat tuple of components.
        """
        return python_source.compile_for_floats(self.loop.name, self.source)

    @_LockFreeCachedProperty
    def arrays_function(self) -> Callable[..., tuple[Any, ...]]:
        """Generated function of NumPy arrays, cached. It takes the constants, then the inputs, and returns a flat
        tuple of components.
        """
        return python_source.compile_for_arrays(self.loop.name, self.source)

    @_LockFreeCachedProperty
    def function_for_library(self) -> Callable[[Library], Callable[..., tuple[Any, ...]]]:
        """Cached function that takes an array library and returns the generated function for arrays of that
        library.
        """
        return functools.lru_cache(maxsize=8)(
            functools.partial(python_source.compile_for_library, self.loop.name, self.source)
        )

    @_LockFreeCachedProperty
    def weighted_operations(self) -> int:
        """Number of operations of the program, in which a sine or square root counts as several operations;
        cached.
        """
        return sum(
            (_WEIGHT_OF_NON_ARITHMETIC_OPERATION if value.operation in NON_ARITHMETIC_OPERATION_NAMES else 1)
            for value in self._needed_values
            if value.operation != "input"
        )

    def count_operations(self, unfolded: Program) -> OperationCounts:
        """Return the `OperationCounts` of this program. `unfolded` is the program of the same loop for which no input
        is known.
        """
        per_sample, shared = (operation_count(self._needed_values, varies) for varies in (True, False))
        return OperationCounts(per_sample, shared, operation_count(unfolded._needed_values))

    @_LockFreeCachedProperty
    def _needed_values(self) -> list[TracedValue]:
        """List of the traced values that the outputs need, each after its operands; cached."""
        return needed_values(self._varying_trace.output_components(self.loop.outputs))

    @_LockFreeCachedProperty
    def _varying_trace(self) -> TracedFunction:
        """Traced function for input arrays that all vary from sample to sample; cached."""
        return self.traced((False,) * len({source[0] for source in self.pattern if isinstance(source, tuple)}))

    def traced(self, uniform: tuple[bool, ...]) -> TracedFunction:
        """Trace the loop's function for this pattern of inputs, and return the `TracedFunction`. `uniform` says for
        each input array whether it is equal for all inner samples.

        Args:
            uniform: for each input array, whether it stays the same from sample to sample.
        """
        trace, sources = Trace(), iter(self.pattern)
        constants: list[TracedValue] = []
        arrays: dict[int, dict[int, TracedValue]] = {}
        values: dict[str, Any] = {}
        for name, sample_shape in self.loop.inputs:
            operands: list[Operand] = []
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
                        columns[component] = trace.input(label, not uniform[array] or name in self.loop.carry)
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


def components(value: Any) -> tuple[Any, ...]:
    """Return the components of a vector as a tuple; return a scalar as a tuple of one component."""
    return value if isinstance(value, tuple) else (value,)
