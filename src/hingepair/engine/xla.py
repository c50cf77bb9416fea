"""Kernels that XLA, the compiler of JAX, calls itself: on its own arrays, without Python and without copies.

XLA calls a handler with a call frame (`xla/ffi/api/c_api.h` of `jax.ffi.include_dir()`), which holds addresses and
shapes of arrays. The handler, a function of machine code, hands them to the kernel's inner loop as NumPy does.
"""

from __future__ import annotations

import ctypes
import functools
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from hingepair.engine.backend import compiler_lock
from hingepair.engine.calls import Call
from hingepair.engine.llvm.builder import FunctionBuilder
from hingepair.engine.llvm.native import Kernel
from hingepair.engine.ufunc import Layout

# Offsets [bytes] in XLA's structures, which only grow at their ends while the major version of the interface is 0.
_EXTENSION, _KIND = 8, 8  # in a call frame; in an extension
_ARGUMENTS, _RESULTS, _ATTRIBUTES = 72, 112, 160  # in a call frame: tables of addresses
_DATA, _RANK, _DIMENSIONS = 24, 32, 40  # in a buffer
_NUMBERS = 16  # in an array among the attributes
_METADATA = 24  # in an extension of the kind that asks for nothing but metadata
_ASKS_FOR_METADATA = 1  # kind of such an extension
_MAJOR, _MINOR, _TRAITS = 24, 28, 32  # in metadata

_LARGE_PAGE = 2**21  # bytes
_MADV_HUGEPAGE = 14  # of Linux


def xla_function(call: Call, char: str) -> Callable[..., tuple[Any, ...]] | None:
    """Return the function of arrays of JAX that a call's kernel computes, of dtype "d" or "f" and with equal leading
    axes; None where LLVM fails.
    """
    found = call.machine_code(char)
    if found is None:
        return None
    import jax

    struct: Any = jax.ShapeDtypeStruct
    ffi_call: Any = jax.ffi.ffi_call
    kernel, layout, constants = found
    target = _target(kernel, layout, char)
    tails = [one.sample_shape for one in layout.outputs]

    def function(*arrays: Any) -> tuple[Any, ...]:
        """Let XLA call the handler."""
        lead = arrays[0].shape[: arrays[0].ndim - len(layout.inputs[0].sample_shape)]
        shapes = [struct((*lead, *tail), arrays[0].dtype) for tail in tails]
        attributes = {} if constants is None else {"constants": constants}
        return tuple(ffi_call(target, shapes)(*arrays, **attributes))

    return function


_targets: dict[str, tuple[Kernel, Kernel]] = {}  # kernels and their handlers by name, for the life of the process


def _target(kernel: Kernel, layout: Layout, char: str) -> str:
    """Return the name by which XLA knows a kernel. It says what the kernel computes, since JAX can keep compiled
    programs on disk.
    """
    import jax

    name = f"hingepair.{kernel.key}"
    with compiler_lock:
        if name not in _targets:
            ir = functools.partial(_handler_ir, name, layout, np.dtype(char).itemsize, _minor_version())
            handler = Kernel("handler", ir, imports={name: kernel.address("loop"), **_system_functions()})
            capsule = ctypes.pythonapi.PyCapsule_New
            capsule.restype, capsule.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
            jax.ffi.register_ffi_target(name, capsule(handler.address("handler"), None, None), platform="cpu")
            _targets[name] = kernel, handler
    return name


def _system_functions() -> dict[str, int]:
    """Return the addresses of functions of the system that a handler calls."""
    if sys.platform != "linux":
        return {}
    return {"madvise": ctypes.cast(ctypes.CDLL(None).madvise, ctypes.c_void_p).value or 0}


@functools.cache
def _minor_version() -> int:
    """Return the minor version of the interface, which XLA wants to be told."""
    import jax

    text = (Path(jax.ffi.include_dir()) / "xla/ffi/api/c_api.h").read_text(encoding="utf-8")
    return int(re.findall(r"^#define XLA_FFI_API_MINOR (\d+)", text, re.MULTILINE)[0])


def _handler_ir(name: str, layout: Layout, number_bytes: int, minor: int) -> str:
    """Return the LLVM module of the handler of a kernel, whose inner loop has this name."""
    f = FunctionBuilder("ptr @handler(ptr %frame)")
    extension = f.load_word("%frame", _EXTENSION, "ptr")
    none = f.put(f"icmp eq ptr {extension}, null")
    holder = f.put(f"select i1 {none}, ptr %frame, ptr {extension}")  # the frame itself has the null there
    kind = f.put(f"load i32, ptr {f.pointer_at(holder, _KIND)}, align 4")
    with f.when_else(f.put(f"icmp ne i32 {kind}, {_ASKS_FOR_METADATA}")) as otherwise:
        _call_loop(f, name, layout, number_bytes)
        otherwise()
        metadata = f.load_word(extension, _METADATA, "ptr")
        for offset, value in ((_MAJOR, 0), (_MINOR, minor), (_TRAITS, 0)):
            f.do(f"store i32 {value}, ptr {f.pointer_at(metadata, offset)}, align 4")
    f.do("ret ptr null")
    declared = [f'declare void @"{name}"(ptr, ptr, ptr, ptr)', "declare i32 @madvise(i64, i64, i32)"]
    return "\n".join([*declared, "", f.text(), ""])


def _call_loop(f: FunctionBuilder, name: str, layout: Layout, number_bytes: int) -> None:
    """Call the inner loop with the arrays of the call frame, which are contiguous."""
    operands, inputs = layout.operands, len(layout.inputs)
    tables = [f.load_word("%frame", place, "ptr") for place in (_ARGUMENTS, _RESULTS)]
    buffers = [
        f.load_word(tables[k >= inputs], 8 * (k - inputs if k >= inputs else k), "ptr") for k in range(len(operands))
    ]
    # Strides of the samples, then of the axes of one sample of each array.
    sizes = [
        [number_bytes * math.prod(one.sample_shape[k:]) for k in range(len(one.sample_shape) + 1)] for one in operands
    ]
    steps = [one[0] for one in sizes] + [step for one in sizes for step in one[1:]]
    f.do(f"%args = alloca [{len(operands)} x ptr], align 8")
    f.do(f"%steps = alloca [{len(steps)} x i64], align 8")
    f.do("%count = alloca i64, align 8")
    for k, buffer in enumerate(buffers):
        f.do(f"store ptr {f.load_word(buffer, _DATA, 'ptr')}, ptr {f.pointer_at('%args', 8 * k)}, align 8")
    for k, step in enumerate(steps):
        f.do(f"store i64 {step}, ptr {f.pointer_at('%steps', 8 * k)}, align 8")
    f.do("store i64 1, ptr %count, align 8")
    dimensions = f.load_word(buffers[-1], _DIMENSIONS, "ptr")
    axes = f.put(f"sub i64 {f.load_word(buffers[-1], _RANK)}, {len(operands[-1].sample_shape)}")
    with f.loop(axes) as axis:
        length = f.load_word(f.pointer_at(dimensions, f.multiply(axis, 8)), 0)
        f.do(f"store i64 {f.multiply(length, f.load_word('%count', 0))}, ptr %count, align 8")
    if sys.platform == "linux":
        for k in range(inputs, len(operands)):
            _ask_for_large_pages(f, f.load_word("%args", 8 * k), f.multiply(f.load_word("%count", 0), steps[k]))
    constants = "null"
    if layout.constants:
        attribute = f.load_word(f.load_word("%frame", _ATTRIBUTES, "ptr"), 0, "ptr")
        constants = f.load_word(attribute, _NUMBERS, "ptr")
    f.do(f'call void @"{name}"(ptr %args, ptr %count, ptr %steps, ptr {constants})')


def _ask_for_large_pages(f: FunctionBuilder, start: str, size: str) -> None:
    """Ask the system for large pages under new memory, as NumPy does; small ones take longer than most kernels."""
    first = f.put(f"and i64 {f.put(f'add i64 {start}, {_LARGE_PAGE - 1}')}, {-_LARGE_PAGE}")
    inside = f.put(f"sub i64 {f.put(f'add i64 {start}, {size}')}, {first}")
    with f.when(f.put(f"icmp sgt i64 {inside}, {_LARGE_PAGE}")):
        f.put(f"call i32 @madvise(i64 {first}, i64 {inside}, i32 {_MADV_HUGEPAGE})")
