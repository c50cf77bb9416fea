"""Pinocchio's C++ loop for `bench direct --cpp`, compiled against the headers that come with Pinocchio."""

from __future__ import annotations

import ctypes
import functools
import os
import shutil
import subprocess
import tempfile
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from hingepair.bench.engines import pinocchio_inputs
from hingepair.bench.methods import Array, Found, Job, Motion, room_at
from hingepair.errors import MissingDependencyError
from hingepair.pair.hinge_pair import HingePair

SOURCE = Path(__file__).with_name("pinocchio_loop.cpp")
FLAGS = ("-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-shared", "-fPIC", "-w")

_COMPILERS = ("c++", "g++", "clang++")
_HOW = "a C++ compiler and the headers of Pinocchio, Boost and Eigen (pip install '.[bench]' in the project's folder)"
_OUTPUTS = ("R2", "S2", "v2", "omega2", "a2", "alpha2")


def pinocchio_cpp(pair: HingePair, motion: Motion) -> Job:
    """Pinocchio from C++: the same inputs and outputs as from Python, the loop compiled."""
    made = pinocchio_inputs(pair, motion)
    samples = len(motion[0])
    out = room_at(len(motion), samples)
    library = compiled_loop()
    constants = [np.ascontiguousarray(c) for c in (pair.u1, pair.u2, pair.n, pair.home)]
    handle = library.pair_new(*map(_address, constants))
    arrays = [*(*made, None, None)[:3], *map(out.get, _OUTPUTS)]
    addresses = [_address(array) for array in arrays]

    def run() -> Found:
        library.pair_loop(handle, samples, *addresses)
        return out

    def release(*kept: Array | None) -> None:  # noqa: ARG001 (arrays that live as long as what runs on their addresses)
        library.pair_delete(handle)

    weakref.finalize(run, release, *arrays)
    return run


@functools.cache
def compiled_loop() -> Any:
    """The library with the compiled loop; a process compiles it once, which takes up to a minute.

    Raises:
        MissingDependencyError: there is no compiler, or a header is missing.
    """
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        raise MissingDependencyError("--cpp", _HOW, f"none of {', '.join(_COMPILERS)} is on the path")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "pinocchio_loop.so"
        headers = [part for path in _headers() for part in ("-isystem", str(path))]
        command = [compiler, *FLAGS, *headers, str(SOURCE), "-o", str(target)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"LC_ALL": "C"})
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error" in line]
            raise MissingDependencyError("--cpp", _HOW, (lines or ["the compiler failed"])[0])
        loaded = ctypes.CDLL(str(target))
    pointer: Any = ctypes.c_void_p
    loaded.pair_new.argtypes, loaded.pair_new.restype = [pointer] * 4, pointer
    loaded.pair_delete.argtypes, loaded.pair_delete.restype = [pointer], None
    loaded.pair_loop.argtypes, loaded.pair_loop.restype = [pointer, ctypes.c_long] + [pointer] * 9, None
    return loaded


def _headers() -> Iterator[Path]:
    """Folders of headers beside the Pinocchio that Python imports, and Eigen's where systems have it."""
    import pinocchio

    for parent in Path(pinocchio.__file__).resolve().parents:
        if (parent / "include" / "pinocchio").is_dir():
            yield from (parent / "include", parent / "include" / "eigen3")
            break
    yield from (Path("/usr/include/eigen3"), Path("/usr/local/include/eigen3"))


def _address(array: Array | None) -> int | None:
    return None if array is None else array.ctypes.data
