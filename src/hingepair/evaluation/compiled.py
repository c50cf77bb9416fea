"""The compiled backend: inputs and outputs as tables of addresses, handed to the kernels in chunks."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.evaluation.kernel_cache import kernels
from hingepair.evaluation.kernel_rows import (
    LANES,
    PAST_CACHES,
    ROWS,
    input_rows,
    input_sign,
    operations,
    output_rows,
    place,
)
from hingepair.evaluation.plan import Plan
from hingepair.numeric.arrays import Box, boxes
from hingepair.numeric.blocks import Values

Integers: TypeAlias = NDArray[np.int64]

FEWEST_A_WORKER = 8192
"""Samples that are worth a thread: a third of a millisecond of work, which is what starting threads takes."""

_SLAB = 6_000_000  # bytes converted at a time, where inputs are of another dtype than the one computed in
_TOO_MUCH_FOR_CACHES = 2**25  # bytes of output; of fewer, something is still there when the caller looks at them
_rows_of = functools.lru_cache(maxsize=4096)(input_rows)
_sign = functools.lru_cache(maxsize=4096)(input_sign)
_ANGLES = {ROWS["phi"] + i * LANES: f"phi_{axis}" for i, axis in enumerate("xyz")}


def compute(
    plan: Plan,
    inputs: Values,
    out: Mapping[str, NDArray[Any]],
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    workers: int,
) -> None:
    """Write the plan's outputs into the arrays of `out`, as `blocks.compute` does, by the compiled kernels.

    `inputs` are by name an array with the components last, a component, or a tuple of components, each an array that
    broadcasts to the samples or a number.
    """
    if 0 in shape:
        return
    groups = [_constant_as(dtype, group) for group in _input_groups(plan, inputs, dtype)]
    first = {name: output_rows(plan, name)[0] for name in out}
    how = PAST_CACHES if sum(array.nbytes for array in out.values()) >= _TOO_MUCH_FOR_CACHES else 1
    targets = [group for name, array in out.items() for group in _groups_of(first[name], array, len(shape), how)]
    if all(group.array.dtype == dtype for group in groups):
        _compute(plan, groups, targets, shape, dtype, workers)
        return
    size = dtype.itemsize * sum(group.array.shape[-1] for group in groups)
    for box in boxes(shape, _SLAB // size):
        _compute(
            plan,
            [group._replace(array=_converted(group.array, box, dtype)) for group in groups],
            [group._replace(array=group.array[box]) for group in targets],
            tuple(piece.stop - piece.start for piece in box),
            dtype,
            workers,
        )


def one_state(plan: Plan, values: Values) -> NDArray[np.float64]:
    """The outputs of one state whose values are Python floats: one after the other, in one array."""
    recipe = _recipe(plan)
    given: list[float] = []
    for name in recipe.names:
        value = values[name]
        if isinstance(value, tuple):
            given.extend(value)
        else:
            given.append(value)
    out = np.empty(recipe.outputs.size)
    scratch = np.empty(ROWS["end"])
    kernels().one_state(
        scratch, np.array(given) * recipe.signs, recipe.rows, recipe.outputs, recipe.steps, recipe.place, out
    )
    return out


class _Recipe(NamedTuple):
    """How one state goes through the kernel: names of its values, the rows they go to and come from."""

    names: tuple[str, ...]
    rows: Integers
    signs: NDArray[np.float64]
    outputs: Integers
    steps: Integers
    place: Integers


@functools.lru_cache(maxsize=256)
def _recipe(plan: Plan) -> _Recipe:
    names = tuple(sorted(plan.inputs))
    rows = [row for name in names for row in _rows_of(plan, name)]
    signs = [_sign(plan, name) for name in names for _ in _rows_of(plan, name)]
    outputs = [row for name in plan.outputs for row in output_rows(plan, name)]
    once, each = operations(plan, frozenset())
    return _Recipe(
        names, np.array(rows), np.array(signs, float), np.array(outputs), np.array([*once, *each]), place(plan)
    )


class _Group(NamedTuple):
    """Components that go to rows one after the other: along the last axis of the array."""

    row: int
    array: NDArray[Any]
    sign: int


def _input_groups(plan: Plan, inputs: Values, dtype: np.dtype[Any]) -> Iterator[_Group]:
    for name in sorted(plan.inputs):
        value, rows, sign = inputs[name], _rows_of(plan, name), _sign(plan, name)
        if isinstance(value, np.ndarray):
            array = value if len(rows) > 1 else value[..., None]
            array = array if rows[0] <= rows[-1] else array[..., ::-1]
            matrices = len(rows) == 9 and array.shape[-2:] == (3, 3)
            yield from _groups_of(min(rows), array, array.ndim - (2 if matrices else 1), sign)
            continue
        components = value if isinstance(value, tuple) else (value,)
        if not any(isinstance(c, np.ndarray) and c.size > 1 for c in components):
            numbers = np.array([c.item() if isinstance(c, np.ndarray) else c for c in components], dtype)
            yield from _groups_of(min(rows), numbers if rows[0] <= rows[-1] else numbers[::-1], 0, sign)
            continue
        for row, c in zip(rows, components, strict=True):
            yield _Group(row, c[..., None] if isinstance(c, np.ndarray) else np.array([c], dtype), sign)


def _groups_of(row: int, array: NDArray[Any], axes: int, sign: int = 1) -> Iterator[_Group]:
    """The group of an array whose first axes are those of the samples; three groups where rows are not joined."""
    if array.ndim - axes == 2 and array.strides[-2] == 3 * array.strides[-1]:
        yield _Group(row, array.reshape(*array.shape[:-2], 9), sign)
    elif array.ndim - axes == 2:
        for i in range(3):
            yield _Group(row + 3 * i * LANES, array[..., i, :], sign)
    elif array.ndim == axes:
        yield _Group(row, array[..., None], sign)
    else:
        yield _Group(row, array, sign)


def _constant_as(dtype: np.dtype[Any], group: _Group) -> _Group:
    """The group; one that is a single number, vector or matrix in the dtype computed in."""
    varies = math.prod(group.array.shape[:-1]) != 1
    return group if varies or group.array.dtype == dtype else group._replace(array=group.array.astype(dtype))


def _converted(array: NDArray[Any], box: Box, dtype: np.dtype[Any]) -> NDArray[Any]:
    """The part of a group that belongs to a box, in the dtype computed in."""
    if array.dtype == dtype and array.ndim == 1:
        return array
    own = zip(box[len(box) - array.ndim + 1 :], array.shape[:-1], strict=True)
    return array[tuple(piece if n != 1 else slice(None) for piece, n in own)].astype(dtype, copy=False)


def _compute(
    plan: Plan,
    groups: list[_Group],
    targets: list[_Group],
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    workers: int,
) -> None:
    """Fill the targets from groups of the dtype computed in, which broadcast to the shape."""
    both = (*groups, *targets)
    forms = tuple((row, sign, array.shape, array.strides) for row, array, sign in both)
    layout = _layout(plan, forms, len(groups), shape)
    start = np.array([array.__array_interface__["data"][0] for _, array, _ in both])
    for offset in layout.offsets:
        table = layout.table.copy()
        table[:, 4] = start + offset
        _run(table, len(groups), layout.shape, layout.steps, dtype, workers)


class _Layout(NamedTuple):
    """How the kernel walks through groups: all of its table but the addresses, and where each of its calls starts."""

    table: Integers
    shape: tuple[int, int]
    steps: tuple[Integers, Integers, Integers]
    offsets: Integers


_Form: TypeAlias = tuple[int, int, tuple[int, ...], tuple[int, ...]]  # row, sign, shape, strides


@functools.lru_cache(maxsize=256)
def _layout(plan: Plan, forms: tuple[_Form, ...], inputs: int, shape: tuple[int, ...]) -> _Layout:
    """The layout of groups by their forms, of which the first are inputs; the longest axis is walked innermost."""
    lengths, strides = _merged(shape, np.array([_strides(form, shape) for form in forms]))
    inner, outer, *others = sorted(range(len(lengths)), key=lambda axis: -lengths[axis])
    table = np.array([(row, own[-1], steps[-1], sign, 0, 0, 0) for row, sign, own, steps in forms])
    table[:, 5], table[:, 6] = strides[:, outer], strides[:, inner]
    quiet = [form for form, stride in zip(forms[:inputs], table[:inputs, 6], strict=True) if stride == 0]
    still = frozenset(row + i * LANES for row, _, own, _ in quiet for i in range(own[-1]))
    walks = np.array([*itertools.product(*(range(lengths[axis]) for axis in others))], np.int64)
    offsets = walks.reshape(len(walks), len(others)) @ strides[:, others].T
    return _Layout(table, (lengths[outer], lengths[inner]), _steps(plan, still), offsets)


def _strides(form: _Form, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Strides in bytes along the axes of the samples; 0 where the group does not vary."""
    _, _, own, strides = form
    moving = tuple(stride if n != 1 else 0 for stride, n in zip(strides[:-1], own[:-1], strict=True))
    return (0,) * (len(shape) - len(moving)) + moving


def _merged(shape: tuple[int, ...], strides: Integers) -> tuple[list[int], Integers]:
    """Axes that all components walk through as one, joined to one; at least two, of length 1 if need be."""
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


@functools.lru_cache(maxsize=1024)
def _steps(plan: Plan, still: frozenset[int]) -> tuple[Integers, Integers, Integers]:
    """The operations, where the rows in `still` are the same for every sample of the inner axis."""
    fixed = {name for name in plan.inputs if still.issuperset(_rows_of(plan, name))}
    fixed |= {name for row, name in _ANGLES.items() if row in still}
    once, each = operations(plan, frozenset(fixed))
    return np.array(once, np.int64), np.array(each, np.int64), place(plan)


def _run(
    table: Integers,
    inputs: int,
    shape: tuple[int, int],
    steps: tuple[Integers, Integers, Integers],
    dtype: np.dtype[Any],
    workers: int,
) -> None:
    """Run the kernel over two axes of samples, the inner one cut into a chunk for each worker."""
    kernel = kernels().kernel
    outer, inner = shape
    workers = max(1, min(workers, outer * inner // FEWEST_A_WORKER, inner // LANES))
    chunk = -(-inner // (workers * LANES)) * LANES

    if workers == 1:
        kernel(_scratch(dtype), shape, table[:inputs], table[inputs:], *steps)
        return

    def part(start: int) -> None:
        own = table.copy()
        own[:, 4] += start * own[:, 6]
        size = outer, min(chunk, inner - start)
        kernel(_scratch(dtype), size, own[:inputs], own[inputs:], *steps)

    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(part, range(0, inner, chunk)))


def _scratch(dtype: np.dtype[Any]) -> NDArray[Any]:
    """The kernel's scratch array. Its rows start at a cache line: else every other load spans two."""
    room = np.empty(ROWS["end"] * dtype.itemsize + 64, np.uint8)
    start = -room.__array_interface__["data"][0] % 64
    scratch: NDArray[Any] = room[start : start + ROWS["end"] * dtype.itemsize].view(dtype)
    return scratch
