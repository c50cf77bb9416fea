"""The binding of a loop's inputs: which components are known numbers, constants or arrays, and their strides.

A component that is the number 0, 1 or -1 becomes part of the program, which folds it away. Other constants are
run-time parameters, so that one program serves all pairs with the same pattern. Arrays are read in place.
"""

from __future__ import annotations

import ctypes
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.array_reader import data_address
from hingepair.engine.llvm_builder import LANES
from hingepair.engine.llvm_ir import TABLE_FIELDS

ArrayShape: TypeAlias = tuple[int, ...]
NamedShapes: TypeAlias = tuple[tuple[str, ArrayShape], ...]
ComponentSource: TypeAlias = float | tuple[int, int] | None
"""Source of a component: a known number; (index of an array, component of it); or None, the next constant."""
InputPattern: TypeAlias = tuple[ComponentSource, ...]

MIN_SAMPLES_PER_WORKER: Final = 8192
"""Number of samples that are worth a thread: about 0.1 ms of work, as long as starting the thread takes."""

_FOLDED_NUMBERS: Final = {0.0: 0.0, 1.0: 1.0, -1.0: -1.0}
"""Numbers that become part of the program, which folds them away."""


class BoundInputs(NamedTuple):
    """The inputs of a loop, sorted into known numbers, constants and arrays.

    Attributes:
        pattern: the source of each component of each input.
        constants: numbers that are the same at all samples.
        arrays: arrays of the components that vary from sample to sample; the last axis holds the components.
    """

    pattern: InputPattern
    constants: list[float]
    arrays: list[NDArray[Any]]


class BoundConstant(NamedTuple):
    """An input that is the same at all samples, bound once for many calls.

    Attributes:
        value: the input itself: a number, a tuple of numbers, or an array.
        pattern: the source of each component.
        constants: the components that are not among the folded numbers.
    """

    value: Any
    pattern: InputPattern
    constants: tuple[float, ...]


def bind_constant(name: str, tail: ArrayShape, value: Any) -> Any:
    """Return an input of one sample as a `BoundConstant`; return an input of more samples unchanged."""
    bound = bind(((name, tail),), {name: value})
    return value if bound.arrays else BoundConstant(value, bound.pattern, tuple(bound.constants))


def bind(
    spec: NamedShapes, values: Mapping[str, Any], carried: frozenset[str] = frozenset(), varying: bool = False
) -> BoundInputs:
    """Sort the inputs of a loop into known numbers, constants and arrays that vary from sample to sample.

    Args:
        spec: names of the inputs, and the shape of one sample of each.
        values: inputs by name: numbers, arrays, or tuples of numbers and arrays.
        carried: names of the inputs that a scan carries. They are always arrays, of shape (*chains, *one sample).
        varying: whether an array counts as varying though it holds one sample only.
    """
    pattern: list[ComponentSource] = []
    constants: list[float] = []
    arrays: list[NDArray[Any]] = []
    seen: dict[int, int] = {}

    def bind_number(x: float) -> None:
        """Add a number to the pattern if it folds, else to the constants."""
        known = _FOLDED_NUMBERS.get(x)
        pattern.append(known)
        if known is None:
            constants.append(x)

    for name, tail in spec:
        value, count = values[name], math.prod(tail)
        if isinstance(value, BoundConstant):
            if not varying:
                pattern += value.pattern
                constants += value.constants
                continue
            value = value.value
        if name in carried:
            pattern.extend((len(arrays), c) for c in range(count))
            arrays.append(value.reshape(*value.shape[: value.ndim - len(tail)], 1, count))
            continue
        if isinstance(value, np.ndarray):
            if value.size == count and not varying:
                pattern.extend((None,) * count)
                constants.extend(map(float, value.ravel().tolist()))
                continue
            for part in component_views(value, tail):
                pattern.extend((len(arrays), c) for c in range(part.shape[-1]))
                arrays.append(part)
            continue
        for component in value if isinstance(value, tuple) else (value,):
            if not isinstance(component, np.ndarray):
                bind_number(float(component))
            elif component.size == 1 and not varying:
                pattern.append(None)
                constants.append(float(component.item()))
            else:
                if id(component) not in seen:
                    seen[id(component)] = len(arrays)
                    arrays.append(component[..., None])
                pattern.append((seen[id(component)], 0))
    return BoundInputs(tuple(pattern), constants, arrays)


def bind_foreign(spec: NamedShapes, values: Mapping[str, Any]) -> tuple[InputPattern, list[float], list[Any]]:
    """Sort the inputs of a loop as `bind` does, for numbers and arrays of another library.

    Returns:
        The pattern, the constants, and the arrays, each of one component.
    """
    pattern: list[ComponentSource] = []
    constants: list[float] = []
    arrays: list[Any] = []
    seen: dict[int, int] = {}
    for name, tail in spec:
        for component in values[name] if tail else (values[name],):
            if not isinstance(component, float | int):
                if id(component) not in seen:
                    seen[id(component)] = len(arrays)
                    arrays.append(component)
                pattern.append((seen[id(component)], 0))
                continue
            known = _FOLDED_NUMBERS.get(component)
            pattern.append(known)
            if known is None:
                constants.append(float(component))
    return tuple(pattern), constants, arrays


def component_views(array: NDArray[Any], tail: ArrayShape) -> Iterator[NDArray[Any]]:
    """Yield views of an array with one axis of components: a single view where possible, else one for each row."""
    if not tail:
        yield array[..., None]
    elif len(tail) == 1:
        yield array
    else:
        axis = array.ndim - len(tail)
        try:
            yield np.reshape(array, (*array.shape[:axis], math.prod(tail)), copy=False)
        except ValueError:
            for i in range(tail[0]):
                yield from component_views(array[(slice(None),) * axis + (i,)], tail[1:])


class ArrayLayout(NamedTuple):
    """The strides by which a kernel reads and writes arrays along two axes of samples; further axes take more calls.

    Attributes:
        outer_length: number of samples along the outer axis.
        inner_length: number of samples along the inner axis.
        strides: for each array, bytes between outer samples, between inner samples, and between components.
        offsets: for each call of the kernel, the offset of its first sample in each array, in bytes.
    """

    outer_length: int
    inner_length: int
    strides: tuple[tuple[int, int, int], ...]
    offsets: tuple[tuple[int, ...], ...]


ShapeAndStrides: TypeAlias = tuple[tuple[int, ...], tuple[int, ...]]  # shape and strides


def shapes_and_strides(arrays: Sequence[NDArray[Any]]) -> tuple[ShapeAndStrides, ...]:
    """Return the shapes and strides of arrays, from which their layout follows."""
    return tuple((array.shape, array.strides) for array in arrays)


@functools.lru_cache(maxsize=512)
def layout_of(forms: tuple[ShapeAndStrides, ...], shape: tuple[int, ...], chained: bool) -> ArrayLayout:
    """Return the layout of arrays that broadcast to the samples.

    The inner axis is the longest axis, or the last axis of chains; the outer axis is the longest of the others.

    Args:
        forms: shapes and strides [bytes] of the arrays.
        shape: shape of the samples.
        chained: whether the last axis is the chain of a scan.
    """
    strides = np.array([_sample_strides(form, shape) for form in forms]).reshape(len(forms), len(shape))
    if chained:
        lengths, columns = _merge_axes(shape[:-1], strides[:, :-1])
        order = sorted(range(len(lengths)), key=lambda axis: -lengths[axis])
        outer, others = order[0], order[1:]
        outers, inners, sizes = columns[:, outer], strides[:, -1], (lengths[outer], shape[-1])
    else:
        lengths, columns = _merge_axes(shape, strides)
        inner, outer, *others = sorted(range(len(lengths)), key=lambda axis: -lengths[axis])
        outers, inners, sizes = columns[:, outer], columns[:, inner], (lengths[outer], lengths[inner])
    array_strides = tuple((int(a), int(b), form[1][-1]) for a, b, form in zip(outers, inners, forms, strict=True))
    starts = np.array([*itertools.product(*(range(lengths[axis]) for axis in others))], np.int64)
    offsets = starts.reshape(len(starts), len(others)) @ columns[:, others].T
    return ArrayLayout(*sizes, array_strides, tuple(tuple(map(int, row)) for row in offsets))


def _sample_strides(form: ShapeAndStrides, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the strides in bytes along the axes of the samples; 0 along an axis on which the array is broadcast."""
    lengths, strides = form
    own_axes = tuple(stride if n != 1 else 0 for stride, n in zip(strides[:-1], lengths[:-1], strict=True))
    return (0,) * (len(shape) - len(own_axes)) + own_axes


def _merge_axes(shape: tuple[int, ...], strides: NDArray[np.int64]) -> tuple[list[int], NDArray[np.int64]]:
    """Merge neighbouring axes that all arrays can step through as one; return lengths and strides, of two or more."""
    lengths, columns = [1, 1], [np.zeros(len(strides), np.int64)] * 2
    for length, column in zip(shape, strides.T, strict=True):
        if length == 1:
            continue
        if (columns[-1] == column * length).all():
            lengths[-1], columns[-1] = lengths[-1] * length, column
        else:
            lengths.append(length)
            columns.append(column)
    return lengths, np.stack(columns, axis=1)


def run_kernel(
    run: Any,
    layout: ArrayLayout,
    inputs: Sequence[NDArray[Any]],
    outputs: Sequence[NDArray[Any]],
    constants: NDArray[Any] | None,
    workers: int,
    chained: bool = False,
) -> None:
    """Run a kernel over all samples; threads share the inner axis, or the outer axis of chains.

    Args:
        run: the kernel's function of (table of addresses and strides, outer length, inner length).
        layout: the layout of the arrays.
        inputs: the input arrays.
        outputs: the output arrays.
        constants: the constants in one array, or None.
        workers: number of threads at most.
        chained: whether the inner axis is the chain of a scan.
    """
    itemsize = outputs[0].itemsize
    table: list[int] = []
    if constants is not None:
        table += (data_address(constants), 0, 0, itemsize)
    first = len(table) // TABLE_FIELDS
    for array, strides in zip((*inputs, *outputs), layout.strides, strict=True):
        table += (data_address(array), *strides)
    table_type = ctypes.c_int64 * len(table)
    outer_length, inner_length = layout.outer_length, layout.inner_length
    shared, column = (outer_length, 1) if chained else (inner_length, 2)
    workers = max(1, min(workers, outer_length * inner_length // MIN_SAMPLES_PER_WORKER, shared // LANES))
    chunk = -(-shared // (workers * LANES)) * LANES

    def run_chunk(start: int) -> None:
        """Run the kernel over the chunk of the shared axis that begins at a sample."""
        chunk_table, count = list(table), min(chunk, shared - start)
        for k in range(first, len(table) // TABLE_FIELDS):
            chunk_table[k * TABLE_FIELDS] += start * chunk_table[k * TABLE_FIELDS + column]
        for offsets in layout.offsets:
            call_table = list(chunk_table)
            for k, offset in enumerate(offsets, first):
                call_table[k * TABLE_FIELDS] += offset
            run(table_type(*call_table), *((count, inner_length) if chained else (outer_length, count)))

    run_in_threads(run_chunk, range(0, shared, chunk))


def run_in_threads(work: Callable[[Any], None], parts: Sequence[Any]) -> None:
    """Call a function with each of some arguments, each in a thread of its own; run a single call in this thread."""
    if len(parts) == 1:
        work(parts[0])
        return
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(len(parts)) as pool:
        list(pool.map(work, parts))
