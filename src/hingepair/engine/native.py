"""The compilation of LLVM IR into this process by llvmlite, which is imported for the first kernel."""

from __future__ import annotations

import ctypes
import functools
import os
import platform
import threading
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from hingepair.engine.array_reader import call_ir
from hingepair.engine.backend import disable_kernels, mark_shared_code_compiled
from hingepair.engine.llvm_shared import shared_ir, shared_symbols
from hingepair.errors import CompilationError, MissingDependencyError

compiler_lock = threading.RLock()
"""Lock that is held while llvmlite is imported and while code is compiled."""
if hasattr(os, "register_at_fork"):  # a fork waits for the lock: the child must not inherit it locked
    os.register_at_fork(
        before=compiler_lock.acquire, after_in_parent=compiler_lock.release, after_in_child=compiler_lock.release
    )


class Kernel:
    """A compiled kernel, which owns its machine code: who uses an address or `run` must keep a reference to it. The
    constructor compiles the kernel, and raises an error if that fails.

    Args:
        name: name of the kernel in messages.
        ir: the kernel's LLVM module.
        float_type: type of the numbers it computes with, "double" or "float".

    Attributes:
        ir: the kernel's LLVM module.
        run: function of (table, outer length, inner length); it releases the interpreter's lock.

    Raises:
        MissingDependencyError: llvmlite is not installed.
        CompilationError: LLVM does not compile the code; the error says why.
    """

    def __init__(self, name: str, ir: str, float_type: str = "double") -> None:
        self.ir = ir
        with compiler_lock:
            _link_shared_functions(float_type)
            self._engine = _compile_module(name, ir)
        self.run: Callable[[Any, int, int], None] = _KERNEL_CTYPES_FUNCTION_TYPE(self.address("kernel"))

    def address(self, symbol: str) -> int:
        """Return the address of a function that the module defines."""
        with compiler_lock:  # llvmlite's own lock is not released in a forked child
            address: int = self._engine.get_function_address(symbol)
        return address


def array_call(kernel: Kernel, descriptor: Sequence[int]) -> Callable[..., bool | int]:
    """Return a built-in function that runs a kernel on arrays, and keeps the kernel alive. Its positional arguments
    are the inputs, the outputs, the constants, and whether the outputs are new arrays; it returns True if it has run
    the kernel, else False or the number of samples that the outputs need. `descriptor` is the list of integers that
    `call_descriptor` returns. The first call compiles the code that reads arrays; raises an error if that fails.

    Args:
        kernel: the kernel to call.
        descriptor: the integers of `array_reader.call_descriptor`.
    """
    numbers = np.array(descriptor, np.int64).view(_CallDescriptor)
    numbers.kernel = kernel
    with compiler_lock:  # two threads must not make two definitions: the one not cached would be freed
        method = _call_method_definition()
    function: Callable[..., bool | int] = _new_built_in_function(ctypes.byref(method), numbers, None)
    return function


class _CallDescriptor(np.ndarray):
    """An array of the integers that describe a call. It also keeps the kernel to which they point alive."""

    kernel: Kernel


class _MethodDefinition(ctypes.Structure):
    """The C structure PyMethodDef, which defines a built-in function."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


_METH_FASTCALL_FLAG = 0x0080  # METH_FASTCALL: the arguments come as a C array
_KERNEL_CTYPES_FUNCTION_TYPE = ctypes.CFUNCTYPE(
    None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64
)  # of `Kernel.run`
_new_built_in_function: Any = ctypes.pythonapi.PyCFunction_NewEx
_new_built_in_function.restype = ctypes.py_object
_new_built_in_function.argtypes = (ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)

# Functions of Python's C interface that compiled code calls.
_PYTHON_API_FUNCTION_NAMES = ("PyBool_FromLong", "PyLong_FromLongLong", "PyEval_SaveThread", "PyEval_RestoreThread")
# Functions of the C library that compiled code calls.
_C_LIBRARY_FUNCTION_NAMES = ("sin", "cos", "atan2", "hypot", "fma", "fmaf")


def _compile_module(name: str, ir: str) -> Any:
    """Compile an LLVM module, given as text (`ir`), and return llvmlite's engine that owns its machine code. Raises
    an error, with the given name of the module, if llvmlite is missing or LLVM fails.

    LLVM's optimiser is not run: the trace has been folded already.

    Raises:
        MissingDependencyError: llvmlite is not installed.
        CompilationError: LLVM does not compile the module.
    """
    with compiler_lock:
        llvm = load_llvmlite()
        try:
            processor, features = host_processor(llvm)
            target = llvm.Target.from_default_triple()
            machine = target.create_target_machine(cpu=processor, features=features, opt=1)  # owned by the engine
            engine = llvm.create_mcjit_compiler(llvm.parse_assembly(ir), machine)
            engine.finalize_object()
        except Exception as error:
            raise CompilationError(name, f"{type(error).__name__}: {error}") from error
        return engine


def _link_shared_functions(float_type: str) -> None:
    """Register the shared functions for numbers of type "double" or "float" with LLVM, so that kernels can call them
    by name. The first call compiles them; raises an error if that fails.
    """
    llvm = load_llvmlite()
    for symbol, address in _shared_functions(float_type, host_processor(llvm))[1].items():
        llvm.add_symbol(symbol, address)


@functools.cache
def _shared_functions(float_type: str, processor: tuple[str, str]) -> tuple[Any, dict[str, int]]:  # noqa: ARG001
    """Compile the functions that all kernels share for numbers of type "double" or "float", and record that they are
    compiled for the estimates of compile time. Return the engine that owns their machine code, and a dictionary of
    their addresses by symbol. The result is cached by number type and by `processor`, the pair that `host_processor`
    returns.
    """
    engine = _compile_module("shared functions", shared_ir(float_type))
    mark_shared_code_compiled()
    return engine, {symbol: engine.get_function_address(symbol) for symbol in shared_symbols(float_type)}


@functools.cache
def _call_method_definition() -> _MethodDefinition:
    """Return the cached definition of the built-in function that calls kernels with arrays. The first call compiles
    the function; raises an error if that fails.
    """
    engine = _compile_module("array_call", call_ir())
    method = _MethodDefinition(b"kernel", engine.get_function_address("call"), _METH_FASTCALL_FLAG)
    method.engine = engine  # kept alive as long as the definition
    return method


@functools.cache
def load_llvmlite() -> Any:
    """Return the module `llvmlite.binding`. The first call imports and initialises it, and registers functions of
    Python and of the C library with LLVM. Raises an error if llvmlite is missing or does not start.

    Raises:
        MissingDependencyError: llvmlite is not installed, or its initialisation fails.
    """
    with compiler_lock:
        try:
            from llvmlite import binding as llvm

            llvm.initialize_native_target()
            llvm.initialize_native_asmprinter()
            host_processor(llvm)
        except ModuleNotFoundError as error:
            raise MissingDependencyError("backend", "llvmlite (pip install llvmlite)", str(error)) from None
        except Exception as error:
            raise MissingDependencyError(
                "backend", "an llvmlite that starts", f"{type(error).__name__}: {error}"
            ) from error
        library = ctypes.CDLL(None) if os.name == "posix" else ctypes.CDLL("ucrtbase")
        for owner, names in ((ctypes.pythonapi, _PYTHON_API_FUNCTION_NAMES), (library, _C_LIBRARY_FUNCTION_NAMES)):
            for name in names:
                llvm.add_symbol(name, ctypes.cast(getattr(owner, name), ctypes.c_void_p).value)
        return llvm


@functools.cache
def can_compile() -> bool:
    """Return whether kernels can be compiled in this process, which is found by compiling one; the answer is cached.
    If they cannot, warn once and stop the backend "auto" from compiling.
    """
    try:
        Kernel("probe", "define void @kernel() { ret void }")
    except (MissingDependencyError, CompilationError) as error:
        disable_kernels(error)
        return False
    return True


@functools.cache
def can_fuse() -> bool:
    """Return whether this machine has an instruction for fused multiply-add (FMA); the answer is cached. Raises an
    error if llvmlite is missing.

    Raises:
        MissingDependencyError: llvmlite is not installed.
    """
    with compiler_lock:
        features = host_processor(load_llvmlite())[1].split(",")
        return "+fma" in features or platform.machine().lower() in {"arm64", "aarch64"}


def host_processor(llvm: Any) -> tuple[str, str]:
    """Return the pair (name, features) by which LLVM describes the processor of this machine."""
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
