"""LLVM code that takes Python's arrays as they are: it reads where they lie from their heads, and runs a kernel.

To ask an array for its shape, strides, dtype and address takes Python longer than a kernel takes for one state, and
so does a call by ctypes; a built-in function of Python made of compiled code takes a twentieth of either. The head of
an array is part of NumPy's binary interface: data, number of axes, shape, strides, base, dtype, flags. Anything but
float64 side by side is answered with False, and left to Python.
"""

from __future__ import annotations

import ctypes
import functools
import sys
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.llvm_ir import FIELDS, SIDE_BY_SIDE

_TYPE: Final = object.__basicsize__ - 8  # where an object says its type
_HEAD: Final = object.__basicsize__  # where an array's own part begins, and a float's number is
_AXES, _SHAPE, _STRIDES, _DTYPE, _FLAGS = _HEAD + 8, _HEAD + 16, _HEAD + 24, _HEAD + 40, _HEAD + 48
_WRITEABLE: Final = 0x0400
_POINTER: Final = ctypes.c_void_p.from_address


@functools.cache
def known_heads() -> bool:
    """Whether arrays lie in memory as is expected here."""
    if sys.implementation.name != "cpython" or sys.byteorder != "little" or object.__basicsize__ != 16:
        return False
    probe = np.empty((2, 3))
    pointer, number = _POINTER, ctypes.c_int64.from_address
    own = id(probe)
    return (
        pointer(own + _TYPE).value == id(np.ndarray)
        and pointer(own + _HEAD).value == probe.ctypes.data
        and ctypes.c_int32.from_address(own + _AXES).value == 2
        and [number((pointer(own + _SHAPE).value or 0) + 8 * k).value for k in range(2)] == [2, 3]
        and [number((pointer(own + _STRIDES).value or 0) + 8 * k).value for k in range(2)] == [24, 8]
        and pointer(own + _DTYPE).value == id(probe.dtype)
        and ctypes.c_int32.from_address(own + _FLAGS).value == probe.flags.num
        and ctypes.c_double.from_address(id(0.5) + _HEAD).value == 0.5
        and ctypes.c_double.from_address(id(x := np.float64(0.5)) + _HEAD).value == x
    )


_KNOWN: Final = known_heads()


def address(array: NDArray[Any]) -> int:
    """Where an array starts in memory; read from its head, since `array.ctypes` takes as long as 100 samples."""
    return (_POINTER(id(array) + _HEAD).value or 0) if _KNOWN else int(array.ctypes.data)


def objects_ir(inputs: Sequence[tuple[int, ...]], outputs: Sequence[int], constants: bool) -> str:
    """The code of a built-in function of (input, ..., constants, buffer): True where it ran the kernel, else False.

    The buffer, into which the outputs go, becomes read-only.

    Args:
        inputs: shapes of the arrays; () for a number.
        outputs: components of each output; they are stored one after the other.
        constants: whether the kernel takes constants.
    """
    names = [f"%in{k}" for k in range(len(inputs))]
    lines = ["entry:"]
    groups = int(constants) + len(inputs) + len(outputs)
    lines.append(f"  %table = alloca [{groups * FIELDS} x i64], align 64")
    lines.append(f"  %complete = icmp eq i64 %count, {len(names) + 2}")
    lines.append("  br i1 %complete, label %arguments.of, label %no")
    lines.append("arguments.of:")
    for k, name in enumerate((*names, "%constants", "%buffer")):
        lines.append(f"  {name}.field = getelementptr ptr, ptr %arguments, i64 {k}")
        lines.append(f"  {name} = load ptr, ptr {name}.field")
    lines.append("  br label %check0")
    for k, shape in enumerate(inputs):
        lines += _check(names[k], k, shape)
    lines.append(f"check{len(inputs)}:")
    rows: list[tuple[str, int, int]] = []
    if constants:
        rows.append((_pointer(lines, "%constants", "constants.at"), 0, 0))
    for k, shape in enumerate(inputs):
        count = int(np.prod(shape, dtype=int))
        rows.append((f"%at{k}", 8 * count, 0))
    start = _pointer(lines, "%buffer", "buffer.at")
    begin = 0
    for k, count in enumerate(outputs):
        lines.append(f"  %out{k} = add i64 {start}, {8 * begin}")
        rows.append((f"%out{k}", 8 * count, SIDE_BY_SIDE))
        begin += count
    for g, (at, stride, mode) in enumerate(rows):
        for field, value in enumerate((at, "0", str(stride), "8", str(mode))):
            place = f"%place{g}.{field}"
            lines.append(f"  {place} = getelementptr i64, ptr %table, i64 {g * FIELDS + field}")
            lines.append(f"  store i64 {value}, ptr {place}")
    lines += [
        "  call void @kernel(ptr %table, i64 1, i64 1)",
        f"  %flags.field = getelementptr i8, ptr %buffer, i64 {_FLAGS}",
        "  %flags = load i32, ptr %flags.field",
        f"  %flags.after = and i32 %flags, {~_WRITEABLE}",
        "  store i32 %flags.after, ptr %flags.field",
        "  %true = call ptr @PyBool_FromLong(i64 1)",
        "  ret ptr %true",
        "no:",
        "  %false = call ptr @PyBool_FromLong(i64 0)",
        "  ret ptr %false",
    ]
    head = "declare ptr @PyBool_FromLong(i64)\n\ndefine ptr @objects(ptr %self, ptr %arguments, i64 %count) {"
    return "\n".join([head, *lines, "}\n"])


def _pointer(lines: list[str], owner: str, name: str) -> str:
    """The address of an array's data."""
    lines.append(f"  %{name}.field = getelementptr i8, ptr {owner}, i64 {_HEAD}")
    lines.append(f"  %{name} = load i64, ptr %{name}.field")
    return f"%{name}"


def _check(own: str, k: int, shape: tuple[int, ...]) -> list[str]:
    """Go on where an object is an array of float64 of this shape, side by side; its data is at `%at{k}`."""
    lines = [
        f"check{k}:",
        f"  %type{k}.field = getelementptr i8, ptr {own}, i64 {_TYPE}",
        f"  %type{k} = load i64, ptr %type{k}.field",
        f"  %array{k} = icmp eq i64 %type{k}, {id(np.ndarray)}",
    ]
    if shape == ():
        lines += [
            f"  br i1 %array{k}, label %head{k}, label %number{k}",
            f"number{k}:",
            f"  %float{k} = icmp eq i64 %type{k}, {id(float)}",
            f"  %double{k} = icmp eq i64 %type{k}, {id(np.float64)}",
            f"  %either{k} = or i1 %float{k}, %double{k}",
            f"  %value{k}.field = getelementptr i8, ptr {own}, i64 {_HEAD}",
            f"  %value{k} = ptrtoint ptr %value{k}.field to i64",
            f"  br i1 %either{k}, label %found{k}, label %no",
        ]
    else:
        lines.append(f"  br i1 %array{k}, label %head{k}, label %no")
    lines += [
        f"head{k}:",
        f"  %axes{k}.field = getelementptr i8, ptr {own}, i64 {_AXES}",
        f"  %axes{k} = load i32, ptr %axes{k}.field",
        f"  %dtype{k}.field = getelementptr i8, ptr {own}, i64 {_DTYPE}",
        f"  %dtype{k} = load i64, ptr %dtype{k}.field",
        f"  %ok{k}.axes = icmp eq i32 %axes{k}, {len(shape)}",
        f"  %ok{k}.dtype = icmp eq i64 %dtype{k}, {id(np.dtype(np.float64))}",
        f"  %ok{k} = and i1 %ok{k}.axes, %ok{k}.dtype",
        f"  br i1 %ok{k}, label %lengths{k}, label %no",
        f"lengths{k}:",
    ]
    stride, wanted = 8, []
    for axis in range(len(shape) - 1, -1, -1):
        wanted += [(_SHAPE, axis, shape[axis]), (_STRIDES, axis, stride)]
        stride *= shape[axis]
    previous = "true"
    for i, (field, axis, value) in enumerate(wanted):
        one = f"{k}.{i}"
        lines += [
            f"  %list{one}.field = getelementptr i8, ptr {own}, i64 {field}",
            f"  %list{one} = load ptr, ptr %list{one}.field",
            f"  %length{one}.field = getelementptr i64, ptr %list{one}, i64 {axis}",
            f"  %length{one} = load i64, ptr %length{one}.field",
            f"  %same{one} = icmp eq i64 %length{one}, {value}",
            f"  %so{one} = and i1 {previous}, %same{one}",
        ]
        previous = f"%so{one}"
    lines.append(f"  %data{k}.field = getelementptr i8, ptr {own}, i64 {_HEAD}")
    lines.append(f"  %data{k} = load i64, ptr %data{k}.field")
    if shape == ():
        lines += [f"  br label %found{k}", f"found{k}:"]
        lines.append(f"  %at{k} = phi i64 [%value{k}, %number{k}], [%data{k}, %lengths{k}]")
        lines.append(f"  br label %check{k + 1}")
    else:
        lines.append(f"  %at{k} = add i64 %data{k}, 0")
        lines.append(f"  br i1 {previous}, label %check{k + 1}, label %no")
    return lines
