"""Kernels with their arrays, and their call for all samples of these: in blocks, by threads.

A kernel finds its arrays by a table that has a row for the constants, if there are any, and one for each array: its
address, and the bytes between samples and between components.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.llvm.builder import FunctionBuilder
from hingepair.engine.llvm.ir import ROW_WORDS
from hingepair.engine.llvm.native import Kernel
from hingepair.engine.threads import run_in_threads
from hingepair.numeric.arrays import Block, split_into_blocks

FLOAT_TYPES: Final = {"d": "double", "f": "float"}  # LLVM's name of a type, by the character of the dtype
TYPE_NUMBERS: Final = {"f": 11, "d": 12}  # NPY_FLOAT, NPY_DOUBLE

_MIN_WORK: Final = 400_000  # least bytes of a thread: they take about the 0.1 ms that handing it work takes
_COPIED_SAMPLES: Final = 2_000  # of a block that is copied, in which samples follow each other in the dtype
_PROTOTYPE: Final = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64)  # of a kernel


class Operand(NamedTuple):
    """An array that a kernel reads or writes."""

    sample_shape: tuple[int, ...]  # of one sample: the core dimensions
    used: bool = True  # whether the kernel has a row for it; others broadcast, but nothing reads them


class Layout(NamedTuple):
    """The arrays of a kernel, in order."""

    inputs: tuple[Operand, ...]
    outputs: tuple[Operand, ...]
    constants: bool  # whether the kernel takes constants, before all others

    @property
    def operands(self) -> tuple[Operand, ...]:
        """Inputs, then outputs."""
        return (*self.inputs, *self.outputs)

    @property
    def signature(self) -> str:
        """Signature of the ufunc; sizes are fixed, so that NumPy refuses arrays that are shorter.

        >>> Layout((Operand((7,)), Operand(())), (Operand((3, 3)),), False).signature
        '(7),()->(3,3)'
        """
        groups = ([f"({','.join(map(str, one.sample_shape))})" for one in g] for g in (self.inputs, self.outputs))
        return "->".join(map(",".join, groups))

    @property
    def rows(self) -> dict[int, int]:
        """Rows of the kernel's table, by the place of an operand that the kernel reads or writes."""
        used = (k for k, one in enumerate(self.operands) if one.used)
        return {k: row for row, k in enumerate(used, int(self.constants))}


def begin_table(f: FunctionBuilder, layout: Layout, constants: str, number_bytes: int) -> str:
    """Return the address of the kernel's table, in which the row of the constants is filled."""
    table = f.buffer(8 * ROW_WORDS * (len(layout.rows) + layout.constants))
    if layout.constants:
        store_row(f, table, 0, f.put(f"ptrtoint ptr {constants} to i64"), "0", str(number_bytes))
    return table


def store_row(f: FunctionBuilder, table: str, row: int, *values: str) -> None:
    """Store the integers of a row of the kernel's table."""
    for k, value in enumerate(values):
        f.store_word(value, table, 8 * (ROW_WORDS * row + k))


class Code(NamedTuple):
    """A kernel, its arrays and its constants."""

    kernel: Kernel
    layout: Layout
    constants: NDArray[Any]


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


def numpy_function(table: str, entry: int) -> int:
    """Return the address of a function out of one of NumPy's tables, which are private; 0 if it is not there."""
    try:
        import numpy._core._multiarray_umath as umath  # type: ignore[import-not-found,unused-ignore]

        get_pointer = ctypes.pythonapi.PyCapsule_GetPointer
        get_pointer.restype, get_pointer.argtypes = ctypes.c_void_p, (ctypes.py_object, ctypes.c_char_p)
        functions = ctypes.cast(get_pointer(getattr(umath, table), None), ctypes.POINTER(ctypes.c_void_p))
    except (ImportError, AttributeError, ValueError):
        return 0
    return functions[entry] or 0
