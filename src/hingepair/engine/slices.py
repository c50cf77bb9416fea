"""The call of a kernel for all samples of arrays: in blocks, by threads."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.threads import run_in_threads
from hingepair.engine.ufunc import Code
from hingepair.numeric.arrays import Block, split_into_blocks

_MIN_WORK: Final = 400_000  # least bytes of a thread: they take about the 0.1 ms that handing it work takes
_COPIED_SAMPLES: Final = 2_000  # of a block that is copied, in which samples follow each other in the dtype
_PROTOTYPE: Final = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64)  # of a kernel


def run_slices(
    code: Code,
    inputs: Sequence[NDArray[Any]],
    outputs: Sequence[NDArray[Any]],
    shape: tuple[int, ...],
    workers: int,
) -> None:
    """Call a kernel for all samples; it writes its results into `outputs`.

    Args:
        code: the kernel.
        inputs: arrays whose leading axes broadcast to the samples.
        outputs: arrays of the dtype in which the kernel computes.
        shape: shape of the samples.
        workers: threads at most.
    """
    size, dtype, layout = math.prod(shape), outputs[0].dtype, code.layout
    tails = [one.sample_shape for one in layout.operands]
    workers = max(1, min(workers, size * dtype.itemsize * sum(map(math.prod, tails)) // _MIN_WORK))
    wide = [
        one if one.shape == shape + tail else np.broadcast_to(one, shape + tail)
        for one, tail in zip(inputs, tails, strict=False)
    ]
    arrays = [((*wide, *outputs)[k], tails[k]) for k in layout.rows]
    function, first = _PROTOTYPE(code.kernel.address("kernel")), len(arrays) - len(outputs)
    constants = [[code.constants.ctypes.data, 0, 0]] if layout.constants else []

    def compute(block: Block, _kept: object = code) -> None:
        """Compute a block, with copies of what does not lie as the kernel reads and writes it; keeps the code."""
        index: tuple[Any, ...] = block
        rows, copied = [], []
        for k, (whole, tail) in enumerate(arrays):
            part = whole[(*index, Ellipsis)]  # without axes too, an array and no copy
            row = _rows(part, tail, dtype)
            if row is None:
                row = np.empty((part.size // math.prod(tail), math.prod(tail)), dtype)
                if k < first:
                    row.reshape(part.shape)[...] = part
                else:
                    copied.append((part, row))
            rows.append(row)
        table = np.array(constants + [_table_row(one) for one in rows], np.int64)
        function(table.ctypes.data, len(rows[-1]))
        for part, row in copied:
            part[...] = row.reshape(part.shape)

    most = -(-size // workers)
    if any(_rows(one, tail, dtype) is None for one, tail in arrays):
        along = all(_rows(one[(0,) * (len(shape) - 1)], tail, dtype) is not None for one, tail in arrays)
        most = min(most, max(_COPIED_SAMPLES, shape[-1] if along else 0))  # without copies, the whole last axis
    run_in_threads(compute, [*split_into_blocks(shape, most)], workers)


def _rows(array: NDArray[Any], tail: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any] | None:
    """Return an array as a row of components for each sample; None if that would be a copy."""
    try:
        return np.reshape(array, (-1, math.prod(tail)), copy=False) if array.dtype == dtype else None
    except ValueError:
        return None


def _table_row(array: NDArray[Any]) -> list[int]:
    """Return address and strides of rows of components."""
    sample, component = array.strides
    return [array.__array_interface__["data"][0], sample, component if array.shape[1] > 1 else array.itemsize]
