"""Pinocchio's C++ loop for `bench direct --cpp`, compiled against the headers that come with Pinocchio."""

from __future__ import annotations

import ctypes
import functools
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from hingepair.bench_engines import pinocchio_inputs
from hingepair.bench_methods import Array, Found, Job, Motion, room_at
from hingepair.errors import MissingDependencyError
from hingepair.pair import HingePair

SOURCE = Path(__file__).with_name("pinocchio_loop.cpp")
FLAGS = ("-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-shared", "-fPIC", "-w")

_COMPILERS = ("c++", "g++", "clang++")
_HOW = "a C++ compiler and the headers of Pinocchio, Boost and Eigen (pip install 'hingepair[bench]')"
_OUTPUTS = ("R2", "S2", "v2", "omega2", "a2", "alpha2")


def pinocchio_cpp(pair: HingePair, motion: Motion) -> Job:
    """Pinocchio from C++: the same inputs and outputs as from Python, the loop compiled."""
    made = pinocchio_inputs(pair, motion)
    out = room_at(len(motion), len(motion[0]))
    constants = [pair.u1, pair.u2, pair.n, pair.home]
    samples = len(motion[0])
    inputs = [*made, None, None][:3]
    function = compiled_loop()

    def run() -> Found:
        function(
            *map(_address, constants), samples, *map(_address, inputs), *(_address(out.get(n)) for n in _OUTPUTS)
        )
        return out

    return run


@functools.cache
def compiled_loop() -> Any:
    """The compiled loop; a process compiles it once, which takes up to a minute.

    Raises:
        MissingDependencyError: there is no compiler, or a header is missing.
    """
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        raise MissingDependencyError("--cpp", _HOW, f"none of {', '.join(_COMPILERS)} is on the path")
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "pinocchio_loop.so"
        headers = [part for path in _headers() for part in ("-isystem", str(path))]
        command = [compiler, *FLAGS, *headers, str(SOURCE), "-o", str(library)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"LC_ALL": "C"})
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error" in line]
            raise MissingDependencyError("--cpp", _HOW, (lines or ["the compiler failed"])[0])
        function = ctypes.CDLL(str(library)).pinocchio_loop
    function.argtypes = [ctypes.c_void_p] * 4 + [ctypes.c_long] + [ctypes.c_void_p] * 9
    function.restype = None
    return function


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
