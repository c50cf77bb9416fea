"""From the arrays that a caller gives to what a loop walks through: addresses, strides, and what is known beforehand.

What is the number 0, 1 or -1 becomes part of the program, which folds it away. Other constants are run-time
parameters, so that one program serves all pairs of the same build. Arrays are walked through where they lie.
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

from hingepair.engine.array_heads import address
from hingepair.engine.llvm_ir import FIELDS
from hingepair.engine.llvm_writer import LANES

Tail: TypeAlias = tuple[int, ...]
Spec: TypeAlias = tuple[tuple[str, Tail], ...]
Origin: TypeAlias = float | tuple[int, int] | None
"""Where a component comes from: a known number; (piece, component of it); or None, the next of the constants."""
Pattern: TypeAlias = tuple[Origin, ...]

FEWEST_A_WORKER: Final = 8192
"""Samples that are worth a thread: a tenth of a millisecond of work, which is what starting one takes."""

_KNOWN: Final = {0.0: 0.0, 1.0: 1.0, -1.0: -1.0}


class Bound(NamedTuple):
    """The inputs of a loop, sorted into known numbers, constants and arrays.

    Attributes:
        pattern: where each component of each input comes from.
        constants: numbers that all samples share.
        pieces: arrays of components that move, the components last.
    """

    pattern: Pattern
    constants: list[float]
    pieces: list[NDArray[Any]]


class Numbers(NamedTuple):
    """An input that all samples share, sorted once for many calls.

    Attributes:
        value: the number, tuple of numbers or array that it is.
        pattern: where each of its components comes from.
        constants: those of them that are not known beforehand.
    """

    value: Any
    pattern: Pattern
    constants: tuple[float, ...]


def sorted_once(name: str, tail: Tail, value: Any) -> Any:
    """Return an input as `Numbers`, where it holds one sample; as it is where it holds more."""
    bound = bind(((name, tail),), {name: value})
    return value if bound.pieces else Numbers(value, bound.pattern, tuple(bound.constants))


def bind(spec: Spec, values: Mapping[str, Any], carried: frozenset[str] = frozenset(), moving: bool = False) -> Bound:
    """Sort the inputs of a loop into known numbers, constants and arrays that change from sample to sample.

    Those that are carried are never known beforehand: they are arrays, of the chains' shape and their own. Where
    `moving`, arrays are pieces though they hold one sample.
    """
    pattern: list[Origin] = []
    constants: list[float] = []
    pieces: list[NDArray[Any]] = []
    seen: dict[int, int] = {}

    def number(x: float) -> None:
        known = _KNOWN.get(x)
        pattern.append(known)
        if known is None:
            constants.append(x)

    for name, tail in spec:
        value, count = values[name], math.prod(tail)
        if isinstance(value, Numbers):
            if not moving:
                pattern += value.pattern
                constants += value.constants
                continue
            value = value.value
        if name in carried:
            pattern.extend((len(pieces), c) for c in range(count))
            pieces.append(value.reshape(*value.shape[: value.ndim - len(tail)], 1, count))
            continue
        if isinstance(value, np.ndarray):
            if value.size == count and not moving:
                pattern.extend((None,) * count)
                constants.extend(map(float, value.ravel().tolist()))
                continue
            for part in rows_of(value, tail):
                pattern.extend((len(pieces), c) for c in range(part.shape[-1]))
                pieces.append(part)
            continue
        for component in value if isinstance(value, tuple) else (value,):
            if not isinstance(component, np.ndarray):
                number(float(component))
            elif component.size == 1 and not moving:
                pattern.append(None)
                constants.append(float(component.item()))
            else:
                if id(component) not in seen:
                    seen[id(component)] = len(pieces)
                    pieces.append(component[..., None])
                pattern.append((seen[id(component)], 0))
    return Bound(tuple(pattern), constants, pieces)


def bind_foreign(spec: Spec, values: Mapping[str, Any]) -> tuple[Pattern, list[float], list[Any]]:
    """Sort the inputs of a loop, given as numbers and arrays of another library, as `bind` does.

    Returns:
        The pattern, the constants, and the arrays, each of one component.
    """
    pattern: list[Origin] = []
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
            known = _KNOWN.get(component)
            pattern.append(known)
            if known is None:
                constants.append(float(component))
    return tuple(pattern), constants, arrays


def rows_of(array: NDArray[Any], tail: Tail) -> Iterator[NDArray[Any]]:
    """Yield views of an array with one axis of components; one view a row where a single view is not possible."""
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
                yield from rows_of(array[(slice(None),) * axis + (i,)], tail[1:])


class Layout(NamedTuple):
    """The strides by which a kernel walks through arrays: two axes of samples; further axes take one call a sample.

    Attributes:
        outer: samples along the outer axis.
        inner: samples along the inner one.
        lines: of each array (bytes between outer samples, between inner ones, between components).
        offsets: where each call starts, in bytes, by array.
    """

    outer: int
    inner: int
    lines: tuple[tuple[int, int, int], ...]
    offsets: tuple[tuple[int, ...], ...]


Form: TypeAlias = tuple[tuple[int, ...], tuple[int, ...]]  # shape and strides


def forms_of(arrays: Sequence[NDArray[Any]]) -> tuple[Form, ...]:
    """Return shapes and strides of arrays, from which their layout follows."""
    return tuple((array.shape, array.strides) for array in arrays)


@functools.lru_cache(maxsize=512)
def layout_of(forms: tuple[Form, ...], shape: tuple[int, ...], chained: bool) -> Layout:
    """Return the layout of arrays that broadcast to the samples.

    The longest axis is walked innermost; of chains, the last one, and the longest of the others outside of it.
    """
    strides = np.array([_strides(form, shape) for form in forms]).reshape(len(forms), len(shape))
    if chained:
        lengths, columns = _merged(shape[:-1], strides[:, :-1])
        order = sorted(range(len(lengths)), key=lambda axis: -lengths[axis])
        outer, others = order[0], order[1:]
        outers, inners, sizes = columns[:, outer], strides[:, -1], (lengths[outer], shape[-1])
    else:
        lengths, columns = _merged(shape, strides)
        inner, outer, *others = sorted(range(len(lengths)), key=lambda axis: -lengths[axis])
        outers, inners, sizes = columns[:, outer], columns[:, inner], (lengths[outer], lengths[inner])
    lines = tuple((int(a), int(b), own[-1]) for a, b, (_, own) in zip(outers, inners, forms, strict=True))
    walks = np.array([*itertools.product(*(range(lengths[axis]) for axis in others))], np.int64)
    offsets = walks.reshape(len(walks), len(others)) @ columns[:, others].T
    return Layout(*sizes, lines, tuple(tuple(map(int, row)) for row in offsets))


def _strides(form: Form, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Return the strides in bytes along the axes of the samples; 0 where the array does not vary."""
    own, strides = form
    moving = tuple(stride if n != 1 else 0 for stride, n in zip(strides[:-1], own[:-1], strict=True))
    return (0,) * (len(shape) - len(moving)) + moving


def _merged(shape: tuple[int, ...], strides: NDArray[np.int64]) -> tuple[list[int], NDArray[np.int64]]:
    """Join neighbouring axes that all arrays walk through as one; return lengths and strides of at least two axes."""
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


def walk(
    run: Any,
    layout: Layout,
    inputs: Sequence[NDArray[Any]],
    outputs: Sequence[NDArray[Any]],
    constants: NDArray[Any] | None,
    workers: int,
    chained: bool = False,
) -> None:
    """Call a kernel for all samples, in threads along the inner axis of a map or the outer axis of chains."""
    itemsize = outputs[0].itemsize
    table: list[int] = []
    if constants is not None:
        table += (address(constants), 0, 0, itemsize)
    first = len(table) // FIELDS
    for array, (outer, inner, step) in zip((*inputs, *outputs), layout.lines, strict=True):
        table += (address(array), outer, inner, step)
    kind = ctypes.c_int64 * len(table)
    shared, column = (layout.outer, 1) if chained else (layout.inner, 2)
    workers = max(1, min(workers, layout.outer * layout.inner // FEWEST_A_WORKER, shared // LANES))
    chunk = -(-shared // (workers * LANES)) * LANES

    def part(start: int) -> None:
        own, count = list(table), min(chunk, shared - start)
        for k in range(first, len(table) // FIELDS):
            own[k * FIELDS] += start * own[k * FIELDS + column]
        for offsets in layout.offsets:
            moved = list(own)
            for k, offset in enumerate(offsets, first):
                moved[k * FIELDS] += offset
            run(kind(*moved), *((count, layout.inner) if chained else (layout.outer, count)))

    in_threads(part, range(0, shared, chunk))


def in_threads(work: Callable[[Any], None], parts: Sequence[Any]) -> None:
    """Do the parts of some work, each in a thread of its own; a single part is done in the calling thread."""
    if len(parts) == 1:
        work(parts[0])
        return
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(len(parts)) as pool:
        list(pool.map(work, parts))
