"""LLVM code compiled into this process, by llvmlite: imported when the first kernel is asked for."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import os
import platform
import threading
from collections.abc import Callable, Iterator
from typing import Any

from hingepair.engine.backend import give_up
from hingepair.errors import MissingDependencyError

_lock = threading.RLock()
if hasattr(os, "register_at_fork"):  # a fork waits for what is being imported or compiled: the child starts whole
    os.register_at_fork(before=_lock.acquire, after_in_parent=_lock.release, after_in_child=_lock.release)


class Kernel:
    """A compiled kernel.

    Attributes:
        ir: its LLVM code as it was written.
        run: the function of (table, outer, inner); other threads go on while it runs.
        run_one: the same for a microsecond's work, which keeps the interpreter's lock.
        run_objects: the function of `array_heads.objects_ir`, where its code was given.
    """

    def __init__(self, ir: str, objects: str = "") -> None:
        self.ir = ir
        with _trouble(), _lock:
            self._engine, address = _compile(ir + objects)
            self.run_objects: Callable[..., bool] | None = None
            if objects:
                self._method = _Method(b"kernel", self._engine.get_function_address("objects"), _FASTCALL, None)
                self.run_objects = _made_built_in(ctypes.byref(self._method), None, None)
        self.run: Callable[[Any, int, int], None] = _SHARING(address)
        self.run_one: Callable[[Any, int, int], None] = _KEEPING(address)


class _Method(ctypes.Structure):
    """What Python knows of a built-in function: PyMethodDef."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("function", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


_FASTCALL = 0x0080
_made_built_in: Any = ctypes.pythonapi.PyCFunction_NewEx
_made_built_in.restype = ctypes.py_object
_made_built_in.argtypes = (ctypes.c_void_p, ctypes.c_void_p, ctypes.c_void_p)

_ARGUMENTS = (None, ctypes.c_void_p, ctypes.c_int64, ctypes.c_int64)
_SHARING, _KEEPING = ctypes.CFUNCTYPE(*_ARGUMENTS), ctypes.PYFUNCTYPE(*_ARGUMENTS)


def _compile(ir: str) -> tuple[Any, int]:
    """Machine code. LLVM's optimiser is left out: what it would find was folded away while tracing."""
    llvm = llvmlite()
    name, features = cpu(llvm)
    target = llvm.Target.from_default_triple()
    machine = target.create_target_machine(cpu=name, features=features, opt=1)  # the engine takes it over
    module = llvm.parse_assembly(ir)
    engine = llvm.create_mcjit_compiler(module, machine)
    engine.finalize_object()
    return engine, engine.get_function_address("kernel")


@functools.cache
def llvmlite() -> Any:
    """Llvmlite, ready to compile for this machine.

    Raises:
        MissingDependencyError: llvmlite is not installed.
    """
    with _lock:
        try:
            from llvmlite import binding as llvm
        except ModuleNotFoundError as error:
            raise MissingDependencyError("backend", "llvmlite (pip install llvmlite)", str(error)) from None
        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        llvm.add_symbol("PyBool_FromLong", ctypes.cast(ctypes.pythonapi.PyBool_FromLong, ctypes.c_void_p).value)
        library = ctypes.CDLL(None) if os.name == "posix" else ctypes.CDLL("ucrtbase")
        for name in ("sin", "cos", "atan2", "hypot", "fma", "fmaf"):
            llvm.add_symbol(name, ctypes.cast(getattr(library, name), ctypes.c_void_p).value)
        return llvm


@functools.cache
def can_compile() -> bool:
    """Whether code can be compiled here; where it cannot, that is said once."""
    try:
        Kernel("define void @kernel() { ret void }")
    except MissingDependencyError as error:
        give_up(error)
        return False
    return True


@functools.cache
def can_fuse() -> bool:
    """Whether this machine multiplies and adds in one instruction.

    Raises:
        MissingDependencyError: llvmlite is not installed, or does not work.
    """
    with _trouble(), _lock:
        return "+fma" in cpu(llvmlite())[1].split(",") or platform.machine().lower() in {"arm64", "aarch64"}


@contextlib.contextmanager
def _trouble() -> Iterator[None]:
    """Whatever goes wrong with llvmlite is one kind of error."""
    try:
        yield
    except MissingDependencyError:
        raise
    except Exception as error:
        found = f"{type(error).__name__}: {error}"
        raise MissingDependencyError("backend", "an llvmlite that works", found) from error


def cpu(llvm: Any) -> tuple[str, str]:
    """Name and features of the processor to compile for."""
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
