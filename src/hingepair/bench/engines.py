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

# Names of the methods, and of the workloads of dynamics.
PINOCCHIO_LOOP_NAME, PINOCCHIO_CPP_NAME, MUJOCO_NAME = (
    "Pinocchio, Python loop",
    "Pinocchio, C++ loop",
    "MuJoCo, Python loop",
)
INVERSE_WORKLOAD, FORWARD_WORKLOAD = "inverse dynamics", "forward dynamics"
MAX_LOOP_SAMPLES = 10**4
"""Samples that a Python loop over an engine computes at most, since it takes microseconds for each."""

# The C++ file with the loops over a pair, and the compiler flag that adds those of dynamics.
PAIR_LOOP_SOURCE, DYNAMICS_FLAG = "pinocchio_loop.cpp", "-DDYNAMICS"
# Flags of the C++ compiler.
_COMPILER_FLAGS = ("-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-shared", "-fPIC", "-w")
_COMPILERS = ("c++", "g++", "clang++")  # the first one on the path is taken
# What a message says is needed for the C++ loops.
_CPP_REQUIREMENTS = (
    "a C++ compiler and the headers of Pinocchio, Boost and Eigen (pip install '.[bench]' in the project's folder)"
)


def pinocchio_coordinates(pair: HingePair, body1: BodyMotion, hinge: Any) -> list[Array]:
    """Return Pinocchio's q, v, a of a motion.

    Args:
        pair: the pair.
        body1: motion of body 1.
        hinge: psi; psi and psi'; or psi, psi' and psi''. As many arrays are returned.
    """
    twin = to_pinocchio(pair)
    makers: tuple[Any, ...] = (twin.configuration, twin.velocity, twin.acceleration)
    return [make(body1, *hinge[: i + 1]) for i, make in enumerate(makers[: len(hinge)])]


def mujoco_coordinates(rows: Sequence[Array], *linear: Any) -> list[Array]:
    """Return MuJoCo's coordinates from those of Pinocchio.

    MuJoCo's quaternions are wxyz, its linear rates are in world axes, its accelerations are classical.

    Args:
        rows: Pinocchio's q, v, a, as many as there are.
        linear: the linear rates in world axes that replace the first three columns of v and a.
    """
    q, *others = rows
    moved = [np.hstack([first, row[:, 3:]]) for first, row in zip(linear, others, strict=True)]
    return [np.ascontiguousarray(q[:, [0, 1, 2, 6, 3, 4, 5, 7]]), *moved]


def make_cpp_job(pair: HingePair, arguments: Sequence[Any], results: Any, *, dynamics: bool = False) -> Job:
    """Return a job that calls Pinocchio in C++: `pair_loop`, or `pair_dynamics` of a pair with masses.

    Args:
        pair: the pair.
        arguments: arguments of the C++ function after the pair; arrays are passed by address.
        results: what the job returns, the arrays that the C++ function fills.
        dynamics: whether dynamics are computed.
    """
    library = compile_pair_loop(dynamics=dynamics)
    bodies: list[Any] = [pair.body1, pair.body2] if dynamics else []
    masses = [np.array([getattr(one, name) for one in bodies]) for name in ("mass", "center_of_mass", "inertia")]
    constants = [*map(np.ascontiguousarray, (pair.u1, pair.u2, pair.n, pair.home)), *masses]
    handle = library.pair_new(len(bodies), *map(_address, constants))
    loop = library.pair_dynamics if dynamics else library.pair_loop
    call = functools.partial(loop, handle, *map(_address, arguments))

    def run() -> Any:
        call()
        return results

    weakref.finalize(
        run, lambda *_: library.pair_delete(handle), *arguments
    )  # keeps the arrays alive as long as the job
    return run


def _address(value: Any) -> Any:
    """Return the address of the data of an array; return other values unchanged."""
    return value.ctypes.data if isinstance(value, np.ndarray) else value


@functools.cache
def compile_library(source: str, *flags: str) -> Any:
    """Compile a C++ file of this folder and load it, which takes half a minute to two minutes.

    Args:
        source: name of the file.
        flags: further flags of the compiler.

    Raises:
        MissingDependencyError: no compiler is on the path, or a header is missing.
    """
    compiler = next(filter(None, map(shutil.which, _COMPILERS)), None)
    if compiler is None:
        raise MissingDependencyError("--cpp", _CPP_REQUIREMENTS, f"none of {', '.join(_COMPILERS)} is on the path")
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "loop.so"
        headers = [part for path in _header_folders() for part in ("-isystem", str(path))]
        command = [
            compiler,
            *_COMPILER_FLAGS,
            *flags,
            *headers,
            str(Path(__file__).with_name(source)),
            "-o",
            str(target),
        ]
        process = subprocess.run(
            command, capture_output=True, text=True, check=False, env=os.environ | {"LC_ALL": "C"}
        )
        if process.returncode:
            lines = [line for line in process.stderr.splitlines() if "error" in line]
            raise MissingDependencyError("--cpp", _CPP_REQUIREMENTS, (lines or ["the compiler failed"])[0])
        return ctypes.CDLL(str(target))


def compile_pair_loop(*, dynamics: bool = False) -> Any:
    """Compile and load the C++ loops over a pair, with dynamics or without.

    Raises:
        MissingDependencyError: no compiler is on the path, or a header is missing.
    """
    library = compile_library(PAIR_LOOP_SOURCE, *[DYNAMICS_FLAG] * dynamics)
    pointer: Any = ctypes.c_void_p
    number: Any = ctypes.c_long
    library.pair_new.argtypes, library.pair_new.restype = [number] + [pointer] * 7, pointer
    library.pair_delete.argtypes, library.pair_delete.restype = [pointer], None
    library.pair_loop.argtypes, library.pair_loop.restype = [pointer, number] + [pointer] * 9, None
    if dynamics:
        library.pair_dynamics.argtypes = [pointer, number, number] + [pointer] * 4
        library.pair_dynamics.restype = None
    return library


def cpp_missing_reason(requested: bool, source: str = PAIR_LOOP_SOURCE, *flags: str) -> str | None:
    """Return why the C++ loops of a file cannot be measured; None if they can.

    Args:
        requested: whether the user asks for them by --cpp.
        source: name of the file, as for `compile_library`.
        flags: further flags of the compiler.
    """
    if not requested:
        return "--cpp compiles and measures it"
    try:
        compile_library(source, *flags)
    except MissingDependencyError as error:
        return str(error)
    return None


def _header_folders() -> Iterator[Path]:
    """Yield the folders that may hold the headers of Pinocchio, of its dependencies and of Eigen."""
    import pinocchio

    for parent in Path(pinocchio.__file__).resolve().parents:
        if (parent / "include" / "pinocchio").is_dir():
            yield from (parent / "include", parent / "include" / "eigen3")
            break
    yield from (Path("/usr/include/eigen3"), Path("/usr/local/include/eigen3"))
