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
from hingepair.engine.llvm_builder import LANE_COUNT
from hingepair.engine.llvm_ir import INTEGERS_PER_KERNEL_TABLE_ROW

ArrayShape: TypeAlias = tuple[int, ...]
NamedShapes: TypeAlias = tuple[tuple[str, ArrayShape], ...]
ComponentSource: TypeAlias = float | tuple[int, int] | None
"""Source of a component: a known number; (index of an array, component of it); or None, the next constant."""
InputPattern: TypeAlias = tuple[ComponentSource, ...]

MIN_SAMPLES_PER_WORKER: Final = 8192
"""Number of samples that are worth a thread: about 0.1 ms of work, as long as starting the thread takes."""

_NUMBER_FOLDED_INTO_PROGRAM_BY_INPUT_VALUE: Final = {0.0: 0.0, 1.0: 1.0, -1.0: -1.0}
"""Numbers that become part of the program, which folds them away, by the value that is looked up."""


class BoundInputs(NamedTuple):
    """The inputs of a loop, divided into known numbers, constants and arrays. `pattern` holds the source of each
    component: a known number, a pair (index of an array, index of the component in the array), or None for the next
    constant. `constants` holds the other numbers that are equal at all samples, and `arrays` the arrays that vary by
    sample.

    Attributes:
        pattern: the source of each component of each input.
        constants: numbers that are the same at all samples.
        arrays: arrays of the components that vary from sample to sample; the last axis holds the components.
    """

    pattern: InputPattern
    constants: list[float]
    arrays: list[NDArray[Any]]


class BoundConstant(NamedTuple):
    """An input that is equal at all samples: its value, its pattern (the source of each component) and its constants
    (all components except the numbers 0, 1 and -1, which fold). The input is bound once and serves many calls.

    Attributes:
        value: the input itself: a number, a tuple of numbers, or an array.
        pattern: the source of each component.
        constants: the components that are not among the folded numbers.
    """

    value: Any
    pattern: InputPattern
    constants: tuple[float, ...]


def bind_constant(name: str, sample_shape: ArrayShape, value: Any) -> Any:
    """Return an input of one sample as a `BoundConstant`; return an input of more than one sample unchanged. `value`
    is a number, an array or a tuple of them, and `sample_shape` is the shape of one sample.
    """
    bound = bind(((name, sample_shape),), {name: value})
    return value if bound.arrays else BoundConstant(value, bound.pattern, tuple(bound.constants))


def bind(
    input_shapes: NamedShapes,
    values: Mapping[str, Any],
    carried_names: frozenset[str] = frozenset(),
    keep_single_samples: bool = False,
) -> BoundInputs:
    """Divide the inputs of a loop into known numbers, constants and arrays that vary by sample, and return them as
    `BoundInputs`. input_shapes holds pairs (name, shape of one sample), and `values` is a dictionary of numbers,
    arrays or tuples of them by name. carried_names are the names of the inputs that a scan carries from sample to
    sample; these inputs must be arrays. Arrays of one sample become constants unless keep_single_samples is true.

    Args:
        input_shapes: names of the inputs, and the shape of one sample of each.
        values: inputs by name: numbers, arrays, or tuples of numbers and arrays.
        carried_names: names of the inputs that a scan carries, which are arrays of shape (*chains, *one sample).
        keep_single_samples: whether arrays of one sample count as varying, too; else they are constants.
    """
    pattern: list[ComponentSource] = []
    constants: list[float] = []
    arrays: list[NDArray[Any]] = []
    array_index_by_id: dict[int, int] = {}

    def bind_number(x: float) -> None:
        """Append a component that is the number x to the lists of `bind`. The pattern gets the numbers 0, 1 and -1;
        for any other number, the pattern gets None and the constants get the number.
        """
        known = _NUMBER_FOLDED_INTO_PROGRAM_BY_INPUT_VALUE.get(x)
        pattern.append(known)
        if known is None:
            constants.append(x)

    for name, sample_shape in input_shapes:
        value, count = values[name], math.prod(sample_shape)
        if isinstance(value, BoundConstant):
            if not keep_single_samples:
                pattern += value.pattern
                constants += value.constants
                continue
            value = value.value
        if name in carried_names:
            pattern.extend((len(arrays), c) for c in range(count))
            arrays.append(value.reshape(*value.shape[: value.ndim - len(sample_shape)], 1, count))
            continue
        if isinstance(value, np.ndarray):
            if value.size == count and not keep_single_samples:
                pattern.extend((None,) * count)
                constants.extend(map(float, value.ravel().tolist()))
                continue
            for part in component_views(value, sample_shape):
                pattern.extend((len(arrays), c) for c in range(part.shape[-1]))
                arrays.append(part)
            continue
        for component in value if isinstance(value, tuple) else (value,):
            if not isinstance(component, np.ndarray):
                bind_number(float(component))
            elif component.size == 1 and not keep_single_samples:
                pattern.append(None)
                constants.append(float(component.item()))
            else:
                if id(component) not in array_index_by_id:
                    array_index_by_id[id(component)] = len(arrays)
                    arrays.append(component[..., None])
                pattern.append((array_index_by_id[id(component)], 0))
    return BoundInputs(tuple(pattern), constants, arrays)


def bind_foreign(input_shapes: NamedShapes, values: Mapping[str, Any]) -> tuple[InputPattern, list[float], list[Any]]:
    """Divide inputs by the rules of `bind`, and return the tuple (pattern, constants, arrays), in which each array is
    one component. `values` is a dictionary of the inputs by name: numbers and arrays of another library, or tuples of
    them for vectors. input_shapes holds pairs (name, shape of one sample).

    Returns:
        The pattern, the constants, and the arrays, each of which is one component.
    """
    pattern: list[ComponentSource] = []
    constants: list[float] = []
    arrays: list[Any] = []
    array_index_by_id: dict[int, int] = {}
    for name, sample_shape in input_shapes:
        for component in values[name] if sample_shape else (values[name],):
            if not isinstance(component, float | int):
                if id(component) not in array_index_by_id:
                    array_index_by_id[id(component)] = len(arrays)
                    arrays.append(component)
                pattern.append((array_index_by_id[id(component)], 0))
                continue
            known = _NUMBER_FOLDED_INTO_PROGRAM_BY_INPUT_VALUE.get(component)
            pattern.append(known)
            if known is None:
                constants.append(float(component))
    return tuple(pattern), constants, arrays


def component_views(array: NDArray[Any], sample_shape: ArrayShape) -> Iterator[NDArray[Any]]:
    """Yield views of an array in which the last axis holds the components of one sample. One view holds all
    components if the strides allow that; otherwise several views follow each other. If `sample_shape` is (), the view
    has an additional last axis of length 1.
    """
    if not sample_shape:
        yield array[..., None]
    elif len(sample_shape) == 1:
        yield array
    else:
        axis = array.ndim - len(sample_shape)
        try:
            yield np.reshape(array, (*array.shape[:axis], math.prod(sample_shape)), copy=False)
        except ValueError:
            for i in range(sample_shape[0]):
                yield from component_views(array[(slice(None),) * axis + (i,)], sample_shape[1:])


class ArrayLayout(NamedTuple):
    """The lengths, strides [bytes] and offsets [bytes] by which a kernel steps through its arrays along two axes of
    samples, an outer and an inner one. Each combination of indices along further axes is one more call of the kernel,
    with its own tuple of `offsets`, one for each array.

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
    """Return a tuple with the pair (shape, strides [bytes]) of each array. `layout_of` takes this tuple."""
    return tuple((array.shape, array.strides) for array in arrays)


@functools.lru_cache(maxsize=512)
def layout_of(array_forms: tuple[ShapeAndStrides, ...], shape: tuple[int, ...], is_scan: bool) -> ArrayLayout:
    """Return the cached `ArrayLayout` of arrays that broadcast to the shape of the samples. Each of `array_forms` is
    the pair (shape, strides [bytes]) of an array whose last axis holds components. The inner axis is the longest one.
    If `is_scan` is true, each sample takes results of the sample before it on the last axis, and this axis is the
    inner one.

    The outer axis is the longest of the others.

    Args:
        array_forms: shapes and strides [bytes] of the arrays.
        shape: shape of the samples.
        is_scan: whether the program is a scan, whose last axis is the chain.
    """
    strides = np.array([_sample_strides(array_form, shape) for array_form in array_forms]).reshape(
        len(array_forms), len(shape)
    )
    if is_scan:
        lengths, columns = _merge_axes(shape[:-1], strides[:, :-1])
        order = sorted(range(len(lengths)), key=lambda axis: -lengths[axis])
        outer, others = order[0], order[1:]
        outers, inners, sizes = columns[:, outer], strides[:, -1], (lengths[outer], shape[-1])
    else:
        lengths, columns = _merge_axes(shape, strides)
        inner, outer, *others = sorted(range(len(lengths)), key=lambda axis: -lengths[axis])
        outers, inners, sizes = columns[:, outer], columns[:, inner], (lengths[outer], lengths[inner])
    array_strides = tuple(
        (int(a), int(b), array_form[1][-1]) for a, b, array_form in zip(outers, inners, array_forms, strict=True)
    )
    starts = np.array([*itertools.product(*(range(lengths[axis]) for axis in others))], np.int64)
    offsets = starts.reshape(len(starts), len(others)) @ columns[:, others].T
    return ArrayLayout(*sizes, array_strides, tuple(tuple(map(int, row)) for row in offsets))


def _sample_strides(array_form: ShapeAndStrides, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return a tuple with an array's stride [bytes] along each axis of the samples. The stride is 0 along an axis
    along which the array is broadcast. `array_form` is the pair (shape, strides) of the array; its last axis holds
    the components and is left out.
    """
    lengths, strides = array_form
    own_axes = tuple(stride if n != 1 else 0 for stride, n in zip(strides[:-1], lengths[:-1], strict=True))
    return (0,) * (len(shape) - len(own_axes)) + own_axes


def _merge_axes(shape: tuple[int, ...], strides: NDArray[np.int64]) -> tuple[list[int], NDArray[np.int64]]:
    """Merge neighbouring axes of the samples if every array steps through them with one common stride. Return the
    list of at least two lengths and the array of strides (array, axis). `shape` holds the lengths of the axes and
    `strides` their strides, one row for each array.
    """
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
    kernel_function: Any,
    layout: ArrayLayout,
    inputs: Sequence[NDArray[Any]],
    outputs: Sequence[NDArray[Any]],
    constants: NDArray[Any] | None,
    workers: int,
    is_scan: bool = False,
) -> None:
    """Run a kernel, which writes the outputs of all samples into the arrays `outputs`. kernel_function is the
    compiled function, `layout` the `ArrayLayout` of the inputs followed by the outputs, and `constants` an array or
    None. At most `workers` threads share the samples of the inner axis. If `is_scan` is true, each row along the
    inner axis is one scan, and the threads share the rows.

    Args:
        kernel_function: the kernel's function of (table of addresses and strides, outer length, inner length).
        layout: the layout of the arrays.
        inputs: the input arrays.
        outputs: the output arrays.
        constants: the constants in one array, or None.
        workers: number of threads at most.
        is_scan: whether the program is a scan, whose inner axis is the chain.
    """
    itemsize = outputs[0].itemsize
    table: list[int] = []
    if constants is not None:
        table += (data_address(constants), 0, 0, itemsize)
    first = len(table) // INTEGERS_PER_KERNEL_TABLE_ROW
    for array, strides in zip((*inputs, *outputs), layout.strides, strict=True):
        table += (data_address(array), *strides)
    table_type = ctypes.c_int64 * len(table)
    outer_length, inner_length = layout.outer_length, layout.inner_length
    shared, column = (outer_length, 1) if is_scan else (inner_length, 2)
    workers = max(1, min(workers, outer_length * inner_length // MIN_SAMPLES_PER_WORKER, shared // LANE_COUNT))
    chunk = -(-shared // (workers * LANE_COUNT)) * LANE_COUNT

    def run_chunk(start: int) -> None:
        """Run the kernel for the part of the samples that one thread computes. The part begins at the index `start`
        of the axis that the threads share.
        """
        chunk_table, count = list(table), min(chunk, shared - start)
        for k in range(first, len(table) // INTEGERS_PER_KERNEL_TABLE_ROW):
            chunk_table[k * INTEGERS_PER_KERNEL_TABLE_ROW] += (
                start * chunk_table[k * INTEGERS_PER_KERNEL_TABLE_ROW + column]
            )
        for offsets in layout.offsets:
            call_table = list(chunk_table)
            for k, offset in enumerate(offsets, first):
                call_table[k * INTEGERS_PER_KERNEL_TABLE_ROW] += offset
            kernel_function(table_type(*call_table), *((count, inner_length) if is_scan else (outer_length, count)))

    run_in_threads(run_chunk, range(0, shared, chunk))


def run_in_threads(function: Callable[[Any], None], arguments: Sequence[Any]) -> None:
    """Call `function` with each of the arguments, each in a thread of its own, and wait until all calls have ended. A
    single argument is handled in the calling thread. An error in a thread is raised here.
    """
    if len(arguments) == 1:
        function(arguments[0])
        return
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(len(arguments)) as pool:
        list(pool.map(function, arguments))
