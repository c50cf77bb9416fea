"""Other engines: the pair and its motion as Pinocchio and MuJoCo take them, and Pinocchio's loops in C++."""

from __future__ import annotations

import ctypes
import functools
import os
import shutil
import subprocess
import tempfile
import weakref
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.measure import Job
from hingepair.errors import MissingDependencyError
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_pair import HingePair
from hingepair.validation.pinocchio_twin import to_pinocchio

Array: TypeAlias = NDArray[Any]

PYTHON_LOOP, CPP, MUJOCO = "Pinocchio, Python loop", "Pinocchio, C++ loop", "MuJoCo, Python loop"
FEW = 10**4
"""Samples that a Python loop over an engine is given."""

PAIR_LOOP, DYNAMICS_FLAG = "pinocchio_loop.cpp", "-DDYNAMICS"
_FLAGS = ("-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-shared", "-fPIC", "-w")
_COMPILERS = ("c++", "g++", "clang++")
_HOW = "a C++ compiler and the headers of Pinocchio, Boost and Eigen (pip install '.[bench]' in the project's folder)"


def pinocchio_rows(pair: HingePair, body1: BodyMotion, hinge: Any) -> list[Array]:
    """Pinocchio's q, v, a of psi, psi', psi'', as far as they go."""
    twin = to_pinocchio(pair)
    makers: tuple[Any, ...] = (twin.configuration, twin.velocity, twin.acceleration)
    return [make(body1, *hinge[: i + 1]) for i, make in enumerate(makers[: len(hinge)])]


def mujoco_rows(rows: Sequence[Array], *linear: Any) -> list[Array]:
    """MuJoCo's of Pinocchio's rows: quaternions wxyz; what is linear in world axes, and an acceleration classical."""
    q, *others = rows
    moved = [np.hstack([first, row[:, 3:]]) for first, row in zip(linear, others, strict=True)]
    return [np.ascontiguousarray(q[:, [0, 1, 2, 6, 3, 4, 5, 7]]), *moved]


def cpp_job(pair: HingePair, arguments: Sequence[Any], results: Any, *, dynamics: bool = False) -> Job:
    """Pinocchio's `pair_loop` in C++, or `pair_dynamics` of a pair with masses, which returns the results."""
    library = compiled_loop(dynamics=dynamics)
    bodies: list[Any] = [pair.body1, pair.body2] if dynamics else []
    masses = [np.array([getattr(one, name) for one in bodies]) for name in ("mass", "center_of_mass", "inertia")]
    constants = [*map(np.ascontiguousarray, (pair.u1, pair.u2, pair.n, pair.home)), *masses]
    handle = library.pair_new(len(bodies), *map(_address, constants))
    loop = library.pair_dynamics if dynamics else library.pair_loop
    call = functools.partial(loop, handle, *map(_address, arguments))

    def run() -> Any:
        call()
        return results

    weakref.finalize(run, lambda *_: library.pair_delete(handle), *arguments)  # which live as long
    return run


def _address(value: Any) -> Any:
    """Where an array lies; all else as it is."""
    return value.ctypes.data if isinstance(value, np.ndarray) else value


@functools.cache
def compiled_library(source: str, *flags: str) -> Any:
    """Return the library compiled from a file beside this one, which takes a process half a minute to two minutes.

    Args:
        source: name of the file.
        flags: further flags of the compiler.

    Raises:
        MissingDependencyError: there is no compiler, or a header is missing.
    """
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        raise MissingDependencyError("--cpp", _HOW, f"none of {', '.join(_COMPILERS)} is on the path")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "loop.so"
        headers = [part for path in _headers() for part in ("-isystem", str(path))]
        command = [compiler, *_FLAGS, *flags, *headers, str(Path(__file__).with_name(source)), "-o", str(target)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"LC_ALL": "C"})
        if done.returncode:
            lines = [line for line in done.stderr.splitlines() if "error" in line]
            raise MissingDependencyError("--cpp", _HOW, (lines or ["the compiler failed"])[0])
        return ctypes.CDLL(str(target))


def compiled_loop(*, dynamics: bool = False) -> Any:
    """Return the library with the loops of a pair, with dynamics or without.

    Raises:
        MissingDependencyError: there is no compiler, or a header is missing.
    """
    loaded = compiled_library(PAIR_LOOP, *[DYNAMICS_FLAG] * dynamics)
    pointer: Any = ctypes.c_void_p
    number: Any = ctypes.c_long
    loaded.pair_new.argtypes, loaded.pair_new.restype = [number] + [pointer] * 7, pointer
    loaded.pair_delete.argtypes, loaded.pair_delete.restype = [pointer], None
    loaded.pair_loop.argtypes, loaded.pair_loop.restype = [pointer, number] + [pointer] * 9, None
    if dynamics:
        loaded.pair_dynamics.argtypes = [pointer, number, number] + [pointer] * 4
        loaded.pair_dynamics.restype = None
    return loaded


def cpp_missing(wanted: bool, source: str = PAIR_LOOP, *flags: str) -> str | None:
    """Return why a library of `compiled_library` cannot be had; None where it can."""
    if not wanted:
        return "compiled where --cpp asks for it"
    try:
        compiled_library(source, *flags)
    except MissingDependencyError as error:
        return str(error)
    return None


def _headers() -> Iterator[Path]:
    """Folders of headers beside the Pinocchio that Python imports, and Eigen's where systems have it."""
    import pinocchio

    for parent in Path(pinocchio.__file__).resolve().parents:
        if (parent / "include" / "pinocchio").is_dir():
            yield from (parent / "include", parent / "include" / "eigen3")
            break
    yield from (Path("/usr/include/eigen3"), Path("/usr/local/include/eigen3"))
