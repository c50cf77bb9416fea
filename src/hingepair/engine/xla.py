"""Kernels that XLA, the compiler of JAX, calls itself.

XLA calls a handler with a call frame (`xla/ffi/api/c_api.h` of `jax.ffi.include_dir()`), which holds addresses and
shapes of arrays. The handler, a function of machine code, calls the kernel with them.
"""

from __future__ import annotations

import ctypes
import functools
import math
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hingepair.engine.backend import compiler_lock
from hingepair.engine.calls import Call
from hingepair.engine.layout import Layout, begin_table, store_row
from hingepair.engine.llvm.builder import FunctionBuilder
from hingepair.engine.llvm.native import Kernel

# Offsets [bytes] in XLA's structures, which only grow at their ends while the major version of the interface is 0.
_EXTENSION, _KIND = 8, 8  # in a call frame; in an extension
_ARGUMENTS, _RESULTS, _ATTRIBUTES = 72, 112, 160  # in a call frame: tables of addresses
_DATA, _RANK, _DIMENSIONS = 24, 32, 40  # in a buffer
_NUMBERS = 16  # in an array among the attributes
_METADATA = 24  # in an extension of the kind that asks for nothing but metadata
_ASKS_FOR_METADATA = 1  # kind of such an extension
_MAJOR, _MINOR, _TRAITS = 24, 28, 32  # in metadata

_targets: dict[str, tuple[Kernel, Kernel]] = {}  # kernels and their handlers by name, for the life of the process


def call_by_xla(call: Call, arrays: Sequence[Any], results: Sequence[Any]) -> list[Any]:
    """Return the outputs of a call of JAX arrays with equal leading axes.

    Raises:
        CompilationError: LLVM fails.
    """
    import jax

    dtype = np.dtype(arrays[0].dtype)
    kernel, layout, constants = call.machine_code(dtype.char)
    attributes = {"constants": constants} if constants.size else {}
    return [*jax.ffi.ffi_call(_target(kernel, layout, dtype.char), results)(*arrays, **attributes)]


def _target(kernel: Kernel, layout: Layout, char: str) -> str:
    """Return the name by which XLA knows a kernel. It says what the kernel computes, since JAX can keep compiled
    programs on disk.
    """
    import jax

    name = f"hingepair.{kernel.key}"
    with compiler_lock:
        if name not in _targets:
            header = (Path(jax.ffi.include_dir()) / "xla/ffi/api/c_api.h").read_text(encoding="utf-8")
            minor = int(re.findall(r"^#define XLA_FFI_API_MINOR (\d+)", header, re.MULTILINE)[0])
            ir = functools.partial(_handler_ir, name, layout, np.dtype(char).itemsize, minor)
            handler = Kernel("handler", ir, imports={name: kernel.address("kernel")})
            capsule = ctypes.pythonapi.PyCapsule_New
            capsule.restype, capsule.argtypes = ctypes.py_object, (ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p)
            jax.ffi.register_ffi_target(name, capsule(handler.address("handler"), None, None), platform="cpu")
            _targets[name] = kernel, handler
    return name


def _handler_ir(name: str, layout: Layout, number_bytes: int, minor: int) -> str:
    """Return the LLVM module of the handler of a kernel of this name."""
    f = FunctionBuilder("ptr @handler(ptr %frame)")
    extension = f.load_word("%frame", _EXTENSION, "ptr")
    none = f.put(f"icmp eq ptr {extension}, null")
    holder = f.put(f"select i1 {none}, ptr %frame, ptr {extension}")  # the frame itself has the null there
    with f.when_else(f.put(f"icmp ne i32 {f.load_half(holder, _KIND)}, {_ASKS_FOR_METADATA}")) as otherwise:
        _call_kernel(f, name, layout, number_bytes)
        otherwise()
        metadata = f.load_word(extension, _METADATA, "ptr")
        for offset, value in ((_MAJOR, 0), (_MINOR, minor), (_TRAITS, 0)):
            f.do(f"store i32 {value}, ptr {f.pointer_at(metadata, offset)}, align 4")
    f.do("ret ptr null")
    return "\n\n".join([f'declare void @"{name}"(ptr, i64)', f.text()]) + "\n"


def _call_kernel(f: FunctionBuilder, name: str, layout: Layout, number_bytes: int) -> None:
    """Append the call of the kernel with the arrays of the call frame, which are contiguous."""
    tables = {True: f.load_word("%frame", _ARGUMENTS, "ptr"), False: f.load_word("%frame", _RESULTS, "ptr")}
    places = [(True, k) for k in range(len(layout.inputs))] + [(False, k) for k in range(len(layout.outputs))]
    buffers = [f.load_word(tables[is_input], 8 * k, "ptr") for is_input, k in places]
    constants = "null"
    if layout.constants:
        attribute = f.load_word(f.load_word("%frame", _ATTRIBUTES, "ptr"), 0, "ptr")
        constants = f.load_word(attribute, _NUMBERS, "ptr")
    table = begin_table(f, layout, constants, number_bytes)
    for k, row in layout.rows.items():
        size = number_bytes * math.prod(layout.operands[k].sample_shape)
        store_row(f, table, row, f.load_word(buffers[k], _DATA), str(size), str(number_bytes))
    count = f.buffer(8)
    f.store_word(1, count)
    dimensions = f.load_word(buffers[-1], _DIMENSIONS, "ptr")
    axes = f.put(f"sub i64 {f.load_word(buffers[-1], _RANK)}, {len(layout.operands[-1].sample_shape)}")
    with f.loop(axes) as axis:
        length = f.load_word(f.pointer_at(dimensions, f.multiply(axis, 8)), 0)
        f.store_word(f.multiply(length, f.load_word(count, 0)), count)
    f.do(f'call void @"{name}"(ptr {table}, i64 {f.load_word(count, 0)})')
