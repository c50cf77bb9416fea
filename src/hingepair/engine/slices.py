"""The call of a ufunc in slices of the samples: for threads, short axes and casts."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.threads import run_in_threads
from hingepair.engine.ufunc import Ufunc
from hingepair.numeric.arrays import Block, split_into_blocks

Arrays = Sequence[NDArray[Any]]

_MIN_WORK: Final = 1_000_000  # least operations of a thread: about 0.1 ms, as handing it work takes
_MAX_CAST_BYTES: Final = 4_000_000  # most that are cast to another dtype at a time
_SHORT_AXIS: Final = 16  # samples that are too few for one run of the inner loop, along the innermost axis
_MIN_SAMPLES: Final = 512  # least of one call, so that the call itself takes little of the time
_MAX_COPIED_NUMBERS: Final = 500_000  # of inputs, copied so that samples of short axes follow each other


def run_slices(
    ufunc: Ufunc,
    inputs: Arrays,
    outputs: Arrays,
    shape: tuple[int, ...],
    *,
    operations: int,
    workers: int,
) -> None:
    """Call a ufunc for all samples, and write its results into `outputs`.

    Args:
        ufunc: takes the inputs; threads keep it, since NumPy's ufunc alone does not own its machine code.
        inputs: arrays whose leading axes broadcast to the samples.
        outputs: arrays of the dtype in which the ufunc computes.
        shape: shape of the samples.
        operations: of one sample.
        workers: threads at most.
    """
    size, dtype = math.prod(shape), outputs[0].dtype
    ranks = [len(one.sample_shape) for one in ufunc.layout.operands]
    input_ranks, output_ranks = ranks[: len(inputs)], ranks[len(inputs) :]
    blocks: list[Block] = [tuple(slice(0, n) for n in shape)]
    short = _short_axes((*inputs, *outputs), ranks, shape) if len(shape) > 1 else []
    # A call for each index of the short axes where each has many samples.
    if short and size // math.prod(shape[axis] for axis in short) >= _MIN_SAMPLES:
        pieces = (
            [slice(k, k + 1) for k in range(n)] if axis in short else [slice(0, n)] for axis, n in enumerate(shape)
        )
        blocks = list(itertools.product(*pieces))
    # Else copies, whose samples fill the lanes; so many axes that these are large are left to NumPy.
    elif short:
        samples = [math.prod(one.shape[one.ndim - rank :]) for one, rank in zip(inputs, input_ranks, strict=True)]
        if size * sum(samples) <= _MAX_COPIED_NUMBERS:
            inputs = [
                np.ascontiguousarray(np.broadcast_to(one, (*shape, *one.shape[one.ndim - rank :])))
                for one, rank in zip(inputs, input_ranks, strict=True)
            ]
    # Samples of a slice: as many as there are threads for, and as a cast may hold.
    most = size
    workers = max(1, min(workers, size * operations // _MIN_WORK))
    if workers > 1:
        most = -(-size // workers)
    cast = sum(dtype.itemsize * one.size for one in inputs if one.dtype != dtype)
    if cast > _MAX_CAST_BYTES:
        most = min(most, max(1, size * _MAX_CAST_BYTES // cast))
    if most < size:
        blocks = [part for block in blocks for part in _cut(block, most)]
    if len(blocks) == 1:
        ufunc.call(*inputs, out=tuple(outputs), dtype=dtype)
        return

    def run(block: Block) -> None:
        """Call the ufunc for a block."""
        ufunc.call(
            *(_part(one, rank, block) for one, rank in zip(inputs, input_ranks, strict=True)),
            out=tuple(_part(one, rank, block) for one, rank in zip(outputs, output_ranks, strict=True)),
            dtype=dtype,
        )

    run_in_threads(run, blocks, workers)


def _cut(block: Block, most: int) -> Iterator[Block]:
    """Yield parts of a block, of at most `most` samples each."""
    for part in split_into_blocks(tuple(axis.stop - axis.start for axis in block), most):
        yield tuple(
            slice(axis.start + own.start, axis.start + own.stop) for axis, own in zip(block, part, strict=True)
        )


def _part(array: NDArray[Any], rank: int, block: Block) -> NDArray[Any]:
    """Return the samples of an array that a block selects; axes of length 1 and missing ones broadcast."""
    axes = array.ndim - rank
    own = zip(block[len(block) - axes :], array.shape[:axes], strict=True)
    return array[tuple(piece if n != 1 else slice(None) for piece, n in own)]


def _short_axes(arrays: Arrays, ranks: Sequence[int], shape: tuple[int, ...]) -> list[int]:
    """Return the axes of the samples along which NumPy's inner loop would not fill the lanes of a kernel: short ones
    that do not merge with a neighbour, beside a longer axis.
    """
    steps = []
    for array, rank in zip(arrays, ranks, strict=True):
        axes = array.ndim - rank
        own = (0 if n == 1 else step for n, step in zip(array.shape[:axes], array.strides[:axes], strict=True))
        steps.append([*[0] * (len(shape) - axes), *own])
    # NumPy merges neighbouring axes if one stride leads through both of each array.
    merged: list[list[int]] = []
    for axis, n in enumerate(shape):
        if n == 1:
            continue
        last = merged[-1][-1] if merged else 0
        if merged and all(one[last] == one[axis] * n for one in steps):
            merged[-1].append(axis)
        else:
            merged.append([axis])
    lengths = [math.prod(shape[axis] for axis in axes) for axes in merged]
    if len(merged) < 2:
        return []
    return [
        axis for axes, n in zip(merged, lengths, strict=True) for axis in axes if n < _SHORT_AXIS and n < max(lengths)
    ]
