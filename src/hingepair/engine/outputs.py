"""Arrays that a call writes into: the user's, once they have been checked, or new ones.

New memory costs as much as the computation: the operating system clears each page at its first use, and the C library
gives large blocks back at once. So the memory of the last few results is kept, at most 160 MB, and used again once
nobody holds them.
"""

from __future__ import annotations

import collections
import contextlib
import math
from collections.abc import Iterable, Mapping
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, DtypeError, ShapeError, quoted

Out: TypeAlias = Mapping[str, NDArray[Any]] | None
"""Arrays to write outputs into, by output name."""


def output_arrays(
    sample_shapes: Iterable[tuple[str, tuple[int, ...]]],
    shape: tuple[int, ...],
    dtype: np.dtype[Any],
    out: Out,
    inputs: Mapping[str, Any],
    bare: bool = False,
) -> dict[str, NDArray[Any]]:
    """Return an array for each output: that of `out`, or a new one that holds nothing yet.

    Args:
        sample_shapes: shape of one sample of each output, by name.
        shape: leading shape of the samples.
        dtype: dtype of the outputs.
        out: the user's arrays by output name.
        inputs: the arguments by name, arrays or tuples of them; no array of `out` may overlap them.
        bare: whether there is one output, whose array messages call `out`.
    """
    shapes = {name: (*shape, *tail) for name, tail in sample_shapes}
    out = out or {}
    labels = {"out" if bare else f"out[{name!r}]": name for name in out}
    for label, name in labels.items():
        _check_array(label, out[name], shapes[name], dtype)
    if out:
        _check_memory({label: out[name] for label, name in labels.items()}, inputs)
    return {name: out[name] if name in out else empty(size, dtype) for name, size in shapes.items()}


def _check_array(name: str, array: Any, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
    """Refuse what is no writable array of this shape and dtype."""
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


def _check_memory(out: Mapping[str, NDArray[Any]], inputs: Mapping[str, Any]) -> None:
    """Refuse an array of `out` that shares memory with another one or with an input."""
    others = [
        (name, part)
        for name, value in inputs.items()
        for part in (value if isinstance(value, tuple) else (value,))
        if isinstance(part, np.ndarray)
    ]
    for name, array in out.items():
        for other_name, other in others:
            if np.may_share_memory(array, other) and np.shares_memory(array, other):
                raise ArgumentError(name, "memory of its own", f"an array that overlaps {other_name}")
        others.append((name, array))


MIN_REUSED_BYTES: Final = 100_000
"""Size of results from which on their memory is used again; the C library keeps less itself."""

_KEPT: Final = 160_000_000  # bytes of blocks that nobody uses, at most


class _Block(np.ndarray[Any, Any]):
    """Bytes that are used again. NumPy would take a plain array in place of its `_Lease` as the base of a result."""


class _Lease(np.ndarray[Any, Any]):
    """A view of a block, the base of a result and of its views; returns the block when the last of them is gone."""

    def __del__(self) -> None:
        if type(self.base) is _Block:
            _free.append(self.base)
            while sum([block.nbytes for block in [*_free]]) > _KEPT:
                with contextlib.suppress(IndexError):  # another thread was quicker
                    _free.popleft()


_free: Final[collections.deque[_Block]] = collections.deque(maxlen=32)  # the oldest falls out


def empty(shape: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return an uninitialised array, whose memory may be that of a former result."""
    size = math.prod(shape) * dtype.itemsize
    if not MIN_REUSED_BYTES <= size <= _KEPT:
        return np.empty(shape, dtype)
    for _ in range(len(_free)):
        try:
            block = _free.popleft()
        except IndexError:  # another thread was quicker
            break
        if block.nbytes == size:
            break
        _free.append(block)
    else:
        block = _Block(size, np.uint8)
    return np.ndarray(shape, dtype, _Lease(size, np.uint8, block))
