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

    def call(rows: Sequence[NDArray[Any]], _kept: object = code) -> None:
        """Compute samples that follow each other; keeps the machine code."""
        table = np.array(constants + [_table_row(one) for one in rows], np.int64)
        function(table.ctypes.data, len(rows[-1]))

    def copy(block: Block) -> None:
        """Compute a block, with copies of what does not lie as the kernel reads and writes it."""
        index: tuple[Any, ...] = block
        parts = [(one[(*index, Ellipsis)], tail) for one, tail in arrays]  # without axes too, an array and no copy
        views = [_rows(one, tail, dtype) for one, tail in parts]
        rows = [
            np.empty((one.size // math.prod(tail), math.prod(tail)), dtype) if view is None else view
            for view, (one, tail) in zip(views, parts, strict=True)
        ]
        for k, (one, _) in enumerate(parts[:first]):
            if views[k] is None:
                rows[k].reshape(one.shape)[...] = one
        call(rows)
        for k, (one, _) in enumerate(parts[first:], first):
            if views[k] is None:
                one[...] = rows[k].reshape(one.shape)

    step = -(-size // workers)
    whole = [view for one, tail in arrays if (view := _rows(one, tail, dtype)) is not None]
    if len(whole) == len(arrays):
        run_in_threads(call, [[one[k : k + step] for one in whole] for k in range(0, size, step)], workers)
        return
    along = all(_rows(one[(0,) * (len(shape) - 1)], tail, dtype) is not None for one, tail in arrays)  # the last axis
    most = min(step, max(_COPIED_SAMPLES, shape[-1] if along else 0))
    run_in_threads(copy, [*split_into_blocks(shape, most)], workers)


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
