"""Kernels as generalised ufuncs of NumPy, which then reads the arrays: broadcasting, strides, dtypes, `out`.

NumPy's C interface makes a ufunc of the address of an inner loop. The loop, a function of machine code, gets
addresses and strides of arrays, and fills the kernel's table with them.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import itertools
import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from hingepair.engine.llvm.builder import LANES, NUMBER_BYTES, FunctionBuilder
from hingepair.engine.llvm.ir import ROW_WORDS
from hingepair.engine.llvm.kernels import (
    FLOAT_TYPES,
    TYPE_NUMBERS,
    Code,
    Layout,
    begin_table,
    numpy_function,
    store_row,
)
from hingepair.engine.llvm.native import Kernel
from hingepair.errors import CompilationError

MAX_OPERANDS: Final = 64  # that a ufunc takes and returns (NPY_MAXARGS)

_LOOP = "(ptr %args, ptr %dims, ptr %steps, ptr %data)"  # parameters of NumPy's inner loops
_CREATE_UFUNC = 31  # entry of NumPy's table of functions, frozen in its ABI: PyUFunc_FromFuncAndDataAndSignature


def make_ufunc(name: str, codes: Mapping[str, Code], doc: str) -> np.ufunc:
    """Return a ufunc of NumPy; what it borrows is kept for the life of the process.

    Args:
        name: name of the ufunc.
        codes: what computes, by the character of a dtype, "d" first.
        doc: documentation of the ufunc.

    Raises:
        CompilationError: NumPy keeps the table of its functions, which is private, in another place.
    """
    layout, count = codes["d"].layout, len(codes)
    address = numpy_function("_UFUNC_API", _CREATE_UFUNC)
    if not address:
        raise CompilationError(name, f"NumPy {np.__version__} has no table of functions where ufuncs are made")
    loops = [_loop(char, code) for char, code in codes.items()]
    functions = (ctypes.c_void_p * count)(*(one.address("loop") for one in loops))
    data = (ctypes.c_void_p * count)(
        *(one.constants.ctypes.data if one.constants.size else None for one in codes.values())
    )
    numbers = bytes(TYPE_NUMBERS[char] for char in codes for _ in layout.operands)
    types = ctypes.create_string_buffer(numbers, len(numbers))
    texts = [text.encode() for text in (name, doc, layout.signature)]
    _borrowed.append((functions, data, types, texts, codes, loops))
    pointer, integer, text = ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p
    create = ctypes.PYFUNCTYPE(
        ctypes.py_object, pointer, pointer, pointer, integer, integer, integer, integer, text, text, integer, text
    )(address)
    made: np.ufunc = create(
        ctypes.addressof(functions), ctypes.addressof(data), ctypes.addressof(types), count,
        len(layout.inputs), len(layout.outputs), -1, texts[0], texts[1], 0, texts[2],
    )  # fmt: skip
    return made


_borrowed: list[Any] = []  # by ufuncs, which users may hold when all else is gone


def _loop(char: str, code: Code) -> Kernel:
    """Return the machine code of the inner loop of a kernel."""
    name = f"hingepair.{code.kernel.key}"
    ir = functools.partial(_loop_ir, code.layout, FLOAT_TYPES[char], name)
    return Kernel("ufunc", ir, imports={name: code.kernel.address("kernel")})


def _loop_ir(layout: Layout, float_type: str, name: str) -> str:
    """Return the LLVM module of `loop`, the inner loop of a ufunc with this layout, which calls a kernel of this
    name. Where the strides of a matrix are more than a row of the table can say, such as those of a transposed one,
    it copies matrices, eight samples at a time.
    """
    f, number_bytes = FunctionBuilder(f"void @loop{_LOOP}"), NUMBER_BYTES[float_type]
    count, table = f.load_word("%dims", 0), begin_table(f, layout, "%data", number_bytes)
    operands, ranks = layout.operands, [len(one.sample_shape) for one in layout.operands]
    starts = {k: (f.load_word("%args", 8 * k), f.load_word("%steps", 8 * k)) for k in layout.rows}
    cores = {}  # the strides of an operand's core dimensions, which follow those of the loop
    for k in layout.rows:
        at = len(ranks) + sum(ranks[:k])
        cores[k] = [f.load_word("%steps", 8 * place) for place in range(at, at + ranks[k])]
    whole = "true"
    for k, row in layout.rows.items():
        axes = [(n, step) for n, step in zip(operands[k].sample_shape, cores[k], strict=True) if n > 1]
        store_row(f, table, row, *starts[k], axes[-1][1] if axes else str(number_bytes))
        for (_, step), (n, inner) in itertools.pairwise(axes):
            whole = f.put(f"and i1 {whole}, {f.put(f'icmp eq i64 {step}, {f.multiply(inner, n)}')}")
    bytes_of = {k: math.prod(operands[k].sample_shape) * number_bytes for k in layout.rows if ranks[k] > 1}
    buffers = {k: f.buffer(LANES * size) for k, size in bytes_of.items()}

    def copy(k: int, start: str, samples: str) -> None:
        """Copy an input, from a sample on, into its buffer; or the buffer of an output to its samples."""
        place = "0"
        with contextlib.ExitStack() as loops:
            for n, step in zip(
                (samples, *map(str, operands[k].sample_shape)), (starts[k][1], *cores[k]), strict=True
            ):
                i = loops.enter_context(f.loop(n))
                place = f.put(f"add i64 {f.multiply(place, n)}, {i}")
                start = f.put(f"add i64 {start}, {f.multiply(i, step)}")
            ends = f.put(f"inttoptr i64 {start} to ptr"), f.pointer_at(buffers[k], f.multiply(place, number_bytes))
            source, target = ends if k < len(layout.inputs) else reversed(ends)
            number = f.put(f"load {float_type}, ptr {source}, align {number_bytes}")
            f.do(f"store {float_type} {number}, ptr {target}, align {number_bytes}")

    with f.when_else(whole) as otherwise:
        f.do(f'call void @"{name}"(ptr {table}, i64 {count})')
        otherwise()
        for k, size in bytes_of.items():
            buffer = f.put(f"ptrtoint ptr {buffers[k]} to i64")
            store_row(f, table, layout.rows[k], buffer, str(size), str(number_bytes))
        with f.loop(count, step=str(LANES)) as first:
            left = f.put(f"call i64 @llvm.umin.i64(i64 {f.put(f'sub i64 {count}, {first}')}, i64 {LANES})")
            for k, (start, step) in starts.items():
                place = f.put(f"add i64 {start}, {f.multiply(first, step)}")
                if k not in buffers:
                    f.store_word(place, table, 8 * ROW_WORDS * layout.rows[k])
                elif k < len(layout.inputs):
                    copy(k, place, left)
            f.do(f'call void @"{name}"(ptr {table}, i64 {left})')
            for k in buffers:
                if k >= len(layout.inputs):
                    copy(k, f.put(f"add i64 {starts[k][0]}, {f.multiply(first, starts[k][1])}"), left)
    f.do("ret void")
    declared = [f'declare void @"{name}"(ptr, i64)', "declare i64 @llvm.umin.i64(i64, i64)"]
    return "\n\n".join([*declared, f.text()]) + "\n"
