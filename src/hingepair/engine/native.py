"""LLVM code compiled into this process by llvmlite, which is imported when the first kernel is asked for."""

from __future__ import annotations

import ctypes
import functools
import os
import platform
import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hingepair.engine.array_heads import call_ir
from hingepair.engine.backend import disable_kernels, mark_shared_code_compiled
from hingepair.engine.llvm_shared import shared_ir, shared_symbols
from hingepair.errors import CompilationError, MissingDependencyError

compiler_lock = threading.RLock()
"""Held while llvmlite is imported and while code is compiled."""
if hasattr(os, "register_at_fork"):  # a fork waits until nothing is being compiled: the child starts whole
    os.register_at_fork(
        before=compiler_lock.acquire, after_in_parent=compiler_lock.release, after_in_child=compiler_lock.release
    )


class Kernel:
    """A compiled kernel; it owns the machine code, so whoever calls the code must hold the kernel.

    Args:
        name: what messages call it.
        ir: its LLVM code.
        number: the type of the numbers it computes with, "double" or "float".

    Attributes:
        ir: its LLVM code as it was written.
        address: where its machine code is.
        run: the function of (table, outer, inner); the interpreter's lock is released while it runs.

    Raises:
        MissingDependencyError: llvmlite is not installed.
        CompilationError: LLVM does not compile the code; says why.
    """

    def __init__(self, name: str, ir: str, number: str = "double") -> None:
        self.ir = ir
        with compiler_lock:
            _link_shared_functions(number)
            self._engine = _compile(name, ir)
        self.address: int = self._engine.get_function_address("kernel")
        self.run: Callable[[Any, int, int], None] = _RUN(self.address)


def array_call(kernel: Kernel, layout: Sequence[int]) -> Callable[..., bool | int]:
    """Return the built-in function of `array_heads.call_ir` for a kernel, which it holds.

    Args:
        kernel: the kernel to call.
        layout: the numbers of `array_heads.call_layout`.
    """
    numbers = np.array(layout, np.int64).view(_Layout)
    numbers.kernel = kernel
    with compiler_lock:  # made by two threads at once, the one that is not kept would be freed while it is called
        method = _call_method()
    function: Callable[..., bool | int] = _make_built_in(ctypes.byref(method), numbers, None)
    return function


class _Layout(np.ndarray):
    """The numbers of a call's layout, and the kernel whose machine code they point to."""

    kernel: Kernel


class _Method(ctypes.Structure):
    """Description of a built-in function: PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


_FASTCALL = 0x0080  # METH_FASTCALL: the arguments come as a C array
_RUN = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)
_make_built_in: Any = ctypes.pythonapi.PyCFunction_NewEx
_make_built_in.restype = ctypes.py_object
_make_built_in.argtypes = (ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)

_PYTHON_FUNCTIONS = ("PyBool_FromLong", "PyLong_FromLongLong", "PyEval_SaveThread", "PyEval_RestoreThread")
_C_FUNCTIONS = ("sin", "cos", "atan2", "hypot", "fma", "fmaf")


def _compile(name: str, ir: str) -> Any:
    """Return the engine that holds the machine code of a module.

    LLVM's optimiser is left out: what it would find was folded away while tracing.
    """
    with compiler_lock:
        llvm = llvmlite()
        try:
            processor, features = cpu(llvm)
            target = llvm.Target.from_default_triple()
            machine = target.create_target_machine(
                cpu=processor, features=features, opt=1
            )  # the engine takes it over
            engine = llvm.create_mcjit_compiler(llvm.parse_assembly(ir), machine)
            engine.finalize_object()
        except Exception as error:
            raise CompilationError(name, f"{type(error).__name__}: {error}") from error
        return engine


def _link_shared_functions(number: str) -> None:
    """Let the functions that all kernels share be found under their names by what is compiled next."""
    llvm = llvmlite()
    for symbol, address in _shared_functions(number, cpu(llvm))[1].items():
        llvm.add_symbol(symbol, address)


@functools.cache
def _shared_functions(number: str, processor: tuple[str, str]) -> tuple[Any, dict[str, int]]:  # noqa: ARG001
    """Compile the functions that all kernels share for a processor; return their engine, and addresses by name."""
    engine = _compile("shared functions", shared_ir(number))
    mark_shared_code_compiled()
    return engine, {symbol: engine.get_function_address(symbol) for symbol in shared_symbols(number)}


@functools.cache
def _call_method() -> _Method:
    """Compile the function that calls kernels with arrays, once for all kernels; return its description."""
    engine = _compile("array_call", call_ir())
    method = _Method(b"kernel", engine.get_function_address("call"), _FASTCALL)
    method.engine = engine  # kept as long as the description
    return method


@functools.cache
def llvmlite() -> Any:
    """Return `llvmlite.binding`, ready to compile for this machine.

    Raises:
        MissingDependencyError: llvmlite is not installed, or does not start.
    """
    with compiler_lock:
        try:
            from llvmlite import binding as llvm

            llvm.initialize_native_target()
            llvm.initialize_native_asmprinter()
            cpu(llvm)
        except ModuleNotFoundError as error:
            raise MissingDependencyError("backend", "llvmlite (pip install llvmlite)", str(error)) from None
        except Exception as error:
            raise MissingDependencyError(
                "backend", "an llvmlite that starts", f"{type(error).__name__}: {error}"
            ) from error
        library = ctypes.CDLL(None) if os.name == "posix" else ctypes.CDLL("ucrtbase")
        for owner, names in ((ctypes.pythonapi, _PYTHON_FUNCTIONS), (library, _C_FUNCTIONS)):
            for name in names:
                llvm.add_symbol(name, ctypes.cast(getattr(owner, name), ctypes.c_void_p).value)
        return llvm


@functools.cache
def can_compile() -> bool:
    """Return whether code can be compiled here; where it cannot, warn once."""
    try:
        Kernel("probe", "define void @kernel() { ret void }")
    except (MissingDependencyError, CompilationError) as error:
        disable_kernels(error)
        return False
    return True


@functools.cache
def can_fuse() -> bool:
    """Return whether this machine multiplies and adds in one instruction.

    Raises:
        MissingDependencyError: llvmlite is not installed.
    """
    with compiler_lock:
        return "+fma" in cpu(llvmlite())[1].split(",") or platform.machine().lower() in {"arm64", "aarch64"}


def cpu(llvm: Any) -> tuple[str, str]:
    """Return name and features of the processor to compile for."""
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
