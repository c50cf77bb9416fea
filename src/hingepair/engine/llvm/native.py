"""The compilation of LLVM IR into this process by llvmlite, which is imported for the first kernel."""

from __future__ import annotations

import ctypes
import functools
import gc
import importlib.util
import itertools
import os
import platform
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from hingepair.engine.backend import compiler_lock
from hingepair.engine.llvm import images, object_cache
from hingepair.engine.llvm.ir import shared_ir, shared_symbols
from hingepair.engine.threads import call_apart
from hingepair.errors import CompilationError, MissingDependencyError


class Kernel:
    """A compiled kernel, which owns its machine code: who uses an address must keep a reference to it.

    Args:
        name: name of the kernel in messages.
        ir: function that returns the kernel's LLVM module as text; it is called where the disk has no code.
        float_type: type of the numbers it computes with, "double" or "float".
        form: text that decides, with the sources of this package, what `ir` returns, so that it need not be called
            to look on the disk; empty where only the module itself says what it is.
        imports: addresses of further functions that the module calls, by symbol.

    Attributes:
        key: text that tells this code from all other.

    Raises:
        MissingDependencyError: llvmlite is not installed.
        CompilationError: LLVM does not compile the code, or it cannot be loaded.
    """

    def __init__(
        self,
        name: str,
        ir: Callable[[], str],
        float_type: str = "double",
        form: str = "",
        imports: Mapping[str, int] | None = None,
    ) -> None:
        with compiler_lock:
            # A kernel holds the functions that it calls: a thread may still run it when all else is gone.
            self._shared, functions = _shared_functions(float_type, host_processor())
            self.key, self._code = _compile_module(name, ir, form, {**functions, **(imports or {})})

    def address(self, symbol: str) -> int:
        """Return the address of a function that the module defines."""
        return self._code.address(symbol)


_OBJECT_KIND = "image 2" if images.CAN_LINK else "object 1"  # in keys of the cache: format and version
_FAILURES = (RuntimeError, OSError, ValueError)  # of LLVM, of the system and of the linker
_C_FUNCTIONS = ("sin", "cos", "atan2", "hypot", "fma", "fmaf", "malloc", "free")  # that compiled code calls


class _JitCode:
    """Machine code that llvmlite has loaded, for systems whose objects `images` does not link."""

    def __init__(self, compiled: bytes, shared: Mapping[str, int]) -> None:
        llvm = load_llvmlite()
        for symbol, address in shared.items():
            llvm.add_symbol(symbol, address)
        while _unused_engines:
            _unused_engines.pop().close()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target_machine(llvm))
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(compiled))
        self._engine.finalize_object()

    def address(self, symbol: str) -> int:
        """Return the address of a function."""
        with compiler_lock:
            address: int = self._engine.get_function_address(symbol)
        return address

    def __del__(self) -> None:  # closed later, under the lock: a fork beside it would leave llvmlite's own lock held
        _unused_engines.append(self._engine)


_unused_engines: list[Any] = []


def _compile_module(
    name: str, ir: Callable[[], str], form: str = "", shared: Mapping[str, int] | None = None
) -> tuple[str, images.Image | _JitCode]:
    """Return the key of an LLVM module, and its loaded machine code, compiled or from the disk; see `Kernel`.
    `shared` are the addresses of functions that it calls, beside those of the C library.
    """
    with compiler_lock:  # LLVM's optimiser is not run: the trace has been folded already
        processor = host_processor()
        text = "" if form else _written(ir)
        key = object_cache.cache_key(_OBJECT_KIND, _llvmlite_build(), *processor, form, text)
        code = object_cache.read_object(key)
        if code is None and form:
            text = _written(ir)
        try:
            if code is None:
                code = call_apart(functools.partial(_compile, text))
                object_cache.write_object(key, code)
            if images.CAN_LINK:
                return key, images.Image(code, functools.partial(_import_address, shared or {}))
            return key, call_apart(functools.partial(_JitCode, code, shared or {}))
        except _FAILURES as error:
            raise CompilationError(name, f"{type(error).__name__}: {error}") from error


def _written(ir: Callable[[], str]) -> str:
    """Return an LLVM module as text. Python does not look for unreachable objects meanwhile: a trace has hundreds of
    thousands of objects, none of them unreachable, and a process may have millions.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        return ir()
    finally:
        if collects:
            gc.enable()


def _compile(ir: str) -> bytes:
    """Return the machine code of an LLVM module: an image where they run, else an object file."""
    llvm = load_llvmlite()
    module = llvm.parse_assembly(ir)
    module.verify()
    compiled: bytes = _target_machine(llvm).emit_object(module)
    return images.link(compiled) if images.CAN_LINK else compiled


def _target_machine(llvm: Any) -> Any:
    """Return LLVM's description of what it compiles for."""
    processor, features = host_processor()
    options = {"reloc": "pic", "codemodel": "small"} if images.CAN_LINK else {"jit": True}
    return llvm.Target.from_default_triple().create_target_machine(cpu=processor, features=features, opt=1, **options)


def _import_address(shared: Mapping[str, int], name: str) -> int:
    """Return the address of a shared function, or of a function of the C library."""
    if name in shared:
        return shared[name]
    function = getattr(_c_library(), name, None)
    if function is None:
        raise ValueError(f"a call of {name}, which the C library does not have")
    return ctypes.cast(function, ctypes.c_void_p).value or 0


@functools.cache
def _c_library() -> Any:
    return ctypes.CDLL(None) if os.name == "posix" else ctypes.CDLL("ucrtbase")


@functools.cache
def _shared_functions(float_type: str, processor: tuple[str, str]) -> tuple[images.Image | _JitCode, dict[str, int]]:  # noqa: ARG001
    """Return the functions that kernels share, and their addresses by symbol, loaded once for each processor."""
    sources = object_cache.SOURCE_DIGEST
    form = f"shared functions {float_type} {sources}" if sources else ""
    _, code = _compile_module("shared functions", functools.partial(shared_ir, float_type), form)
    return code, {symbol: code.address(symbol) for symbol in shared_symbols(float_type)}


@functools.cache
def load_llvmlite() -> Any:
    """Return the module `llvmlite.binding`, ready to compile; for `call_apart`, under the lock.

    Raises:
        MissingDependencyError: llvmlite is not installed, or its initialisation fails.
    """
    try:
        from llvmlite import binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        _ask_host_processor(llvm)
    except ModuleNotFoundError as error:
        raise _no_llvmlite(error) from None
    except Exception as error:
        raise MissingDependencyError(
            "backend", "an llvmlite that starts", f"{type(error).__name__}: {error}"
        ) from error
    if not images.CAN_LINK:
        for name in _C_FUNCTIONS:
            llvm.add_symbol(name, _import_address({}, name))
    return llvm


def _no_llvmlite(error: object) -> MissingDependencyError:
    return MissingDependencyError("backend", "llvmlite (pip install llvmlite)", str(error))


@functools.cache
def can_fuse() -> bool:
    """Return whether this machine has an instruction for fused multiply-add (FMA)."""
    return "+fma" in host_processor()[1].split(",") or platform.machine().lower() in {"arm64", "aarch64"}


@functools.cache
def host_processor() -> tuple[str, str]:
    """Return the name and the features by which LLVM describes the processor of this machine, from the disk if they
    are kept there: then llvmlite need not be imported.
    """
    with compiler_lock:
        told = _linux_processor() if images.CAN_LINK else None
        if told is None:
            return call_apart(lambda: _ask_host_processor(load_llvmlite()))
        key = object_cache.cache_key("processor", _llvmlite_build(), told)
        kept = object_cache.read_object(key)
        if kept is None:
            kept = "\n".join(call_apart(lambda: _ask_host_processor(load_llvmlite()))).encode()
            object_cache.write_object(key, kept)
        name, features = kept.decode().split("\n")
        return name, features


def _ask_host_processor(llvm: Any) -> tuple[str, str]:
    return llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()


def _linux_processor() -> str | None:
    """Return what identifies the first processor in /proc/cpuinfo; None if that is missing or says too little."""
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:
            lines = dict.fromkeys(itertools.takewhile(str.strip, file))
    except OSError:
        return None
    fields = {name.strip(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
    return "\n".join(fields[name] for name in _CPUINFO) if fields.keys() >= {*_CPUINFO} else None


_CPUINFO = ("vendor_id", "cpu family", "model", "model name", "stepping", "flags")  # that tell processors apart


@functools.cache
def _llvmlite_build() -> str:
    """Return what tells one build of llvmlite from another, without importing it: its version, and the size of the
    library that contains LLVM.
    """
    try:
        found = importlib.util.find_spec("llvmlite")
    except ValueError as error:  # a module without a specification
        raise _no_llvmlite(error) from None
    if found is None or not found.submodule_search_locations:
        raise _no_llvmlite("No module named 'llvmlite'")
    folder = Path(found.submodule_search_locations[0])
    version = (folder / "_version.py").read_text()
    sizes = sorted((path.name, path.stat().st_size) for path in (folder / "binding").glob("*llvmlite*"))
    return f"{version}\n{sizes}"
