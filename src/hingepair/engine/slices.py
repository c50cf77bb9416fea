"""The call of a ufunc in slices of the samples: for threads, short axes and casts."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
_COPIED_SAMPLES: Final = 2_000  # copied at a time, so that samples along short axes follow each other


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
    # Samples of a slice: as many as there are threads for, and as a cast may hold.
    most, workers = size, max(1, min(workers, size * operations // _MIN_WORK))
    if workers > 1:
        most = -(-size // workers)
    cast = sum(dtype.itemsize * one.size for one in inputs if one.dtype != dtype)
    if cast > _MAX_CAST_BYTES:
        most = min(most, max(1, size * _MAX_CAST_BYTES // cast))
    # NumPy takes the samples along one axis at a time, unless one stride leads through several axes of all arrays.
    short = len(shape) > 1 and shape[-1] < min(_SHORT_AXIS, size) and not _merges((*inputs, *outputs), ranks, shape)
    short = short and all(one.flags.c_contiguous for one in outputs)
    if short:
        most = min(most, _COPIED_SAMPLES)

    def run(block: Block) -> None:
        """Call the ufunc for a block."""
        parts = [_part(one, rank, block) for one, rank in zip((*inputs, *outputs), ranks, strict=True)]
        if short:
            lead = tuple(axis.stop - axis.start for axis in block)
            for k, one in enumerate(ufunc.layout.operands):
                whole = np.broadcast_to(parts[k], lead + one.sample_shape) if k < len(inputs) else parts[k]
                parts[k] = whole.reshape(-1, *one.sample_shape)
        ufunc.call(*parts[: len(inputs)], out=tuple(parts[len(inputs) :]), dtype=dtype)

    run_in_threads(run, [*split_into_blocks(shape, most)], workers)


def _part(array: NDArray[Any], rank: int, block: Block) -> NDArray[Any]:
    """Return the samples of an array that a block selects; axes of length 1 and missing ones broadcast."""
    axes = array.ndim - rank
    own = zip(block[len(block) - axes :], array.shape[:axes], strict=True)
    index: tuple[Any, ...] = tuple(piece if n != 1 else slice(None) for piece, n in own)
    return array[(*index, Ellipsis)]  # without axes too, an array and no copy


def _merges(arrays: Arrays, ranks: Sequence[int], shape: tuple[int, ...]) -> bool:
    """Return whether one stride leads through the last axis of the samples and the one before it, of each array."""
    for array, rank in zip(arrays, ranks, strict=True):
        axes = array.ndim - rank
        steps = [0 if n == 1 else step for n, step in zip(array.shape[:axes], array.strides[:axes], strict=True)]
        *_, outer, inner = 0, 0, *steps
        if outer != inner * shape[-1]:
            return False
    return True
