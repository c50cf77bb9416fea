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
MAX_SAMPLES_IN_PYTHON_LOOP = 10**4
"""Samples that a Python loop over an engine computes at most, since it takes microseconds for each."""

# The C++ file with the loops over a pair, and the compiler flag that adds those of dynamics.
PAIR_LOOP_SOURCE, DYNAMICS_FLAG = "pinocchio_loop.cpp", "-DDYNAMICS"
# Flags of the C++ compiler.
_CPP_COMPILER_FLAGS = ("-std=c++17", "-O3", "-march=native", "-DNDEBUG", "-shared", "-fPIC", "-w")
_CPP_COMPILER_NAMES = ("c++", "g++", "clang++")  # the first one on the path is taken
# What a message says is needed for the C++ loops.
_CPP_REQUIREMENTS_TEXT = (
    "a C++ compiler and the headers of Pinocchio, Boost and Eigen (pip install '.[bench]' in the project's folder)"
)


def pinocchio_coordinates(pair: HingePair, body1: BodyMotion, hinge_motion: Any) -> list[Array]:
    """Convert a pair's motion to Pinocchio's coordinates; return a list of the first one, two or three of the arrays
    q, v, a. `hinge_motion` is a sequence of psi, psi' and psi'', or of the first one or two of these, and the list
    has as many arrays. `body1` is the BodyMotion of body 1.

    Args:
        pair: the pair.
        body1: motion of body 1.
        hinge_motion: psi; psi and psi'; or psi, psi' and psi''. As many arrays are returned.
    """
    twin = to_pinocchio(pair)
    makers: tuple[Any, ...] = (twin.configuration, twin.velocity, twin.acceleration)
    return [make(body1, *hinge_motion[: i + 1]) for i, make in enumerate(makers[: len(hinge_motion)])]


def mujoco_coordinates(pinocchio_rows: Sequence[Array], *linear: Any) -> list[Array]:
    """Convert q, v, a, or the first one or two of these, from Pinocchio's conventions to MuJoCo's; return a list of
    as many arrays. For each of v and a, a further positional argument holds the linear rates in world axes, shape (N,
    3), which replace the first three columns.

    MuJoCo's quaternions are wxyz, its linear rates are in world axes, its accelerations are classical.

    Args:
        pinocchio_rows: Pinocchio's q, v, a, as many as there are.
        linear: the linear rates in world axes that replace the first three columns of v and a.
    """
    q, *others = pinocchio_rows
    moved = [np.hstack([first, row[:, 3:]]) for first, row in zip(linear, others, strict=True)]
    return [np.ascontiguousarray(q[:, [0, 1, 2, 6, 3, 4, 5, 7]]), *moved]


def make_cpp_job(pair: HingePair, arguments: Sequence[Any], results: Any, *, with_dynamics: bool = False) -> Job:
    """Compile Pinocchio's C++ loop over a pair, for dynamics if `with_dynamics`, otherwise for kinematics. Return a
    job that calls the loop with the pair and with `arguments`, of which arrays are passed by address, and that
    returns `results`: the array or dict of arrays among the arguments that the loop fills. Raise a
    MissingDependencyError if the loop cannot be compiled.

    Args:
        pair: the pair.
        arguments: arguments of the C++ function after the pair; arrays are passed by address.
        results: what the job returns, the arrays that the C++ function fills.
        with_dynamics: whether the loop is `pair_dynamics`, of a pair with masses; otherwise it is `pair_loop`.
    """
    library = compile_pair_loop(with_dynamics=with_dynamics)
    bodies: list[Any] = [pair.body1, pair.body2] if with_dynamics else []
    masses = [np.array([getattr(one, name) for one in bodies]) for name in ("mass", "center_of_mass", "inertia")]
    constants = [*map(np.ascontiguousarray, (pair.u1, pair.u2, pair.n, pair.home)), *masses]
    handle = library.pair_new(len(bodies), *map(_address, constants))
    loop = library.pair_dynamics if with_dynamics else library.pair_loop
    call = functools.partial(loop, handle, *map(_address, arguments))

    def run() -> Any:
        call()
        return results

    weakref.finalize(
        run, lambda *_: library.pair_delete(handle), *arguments
    )  # keeps the arrays alive as long as the job
    return run


def _address(value: Any) -> Any:
    """Return the memory address of the data of an array; return any other value unchanged."""
    return value.ctypes.data if isinstance(value, np.ndarray) else value


@functools.cache
def compile_library(source_name: str, *flags: str) -> Any:
    """Compile a C++ file of the folder `bench`, named `source_name`, with further compiler flags, which takes up to
    two minutes; return it as a ctypes library. The libraries are cached. Raise a MissingDependencyError if the
    compiler or a header is missing.

    Args:
        source_name: name of the file.
        flags: further flags of the compiler.

    Raises:
        MissingDependencyError: no compiler is on the path, or a header is missing.
    """
    compiler = next(filter(None, map(shutil.which, _CPP_COMPILER_NAMES)), None)
    if compiler is None:
        raise MissingDependencyError(
            "--cpp", _CPP_REQUIREMENTS_TEXT, f"none of {', '.join(_CPP_COMPILER_NAMES)} is on the path"
        )
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "loop.so"
        headers = [part for path in _header_folders() for part in ("-isystem", str(path))]
        command = [
            compiler,
            *_CPP_COMPILER_FLAGS,
            *flags,
            *headers,
            str(Path(__file__).with_name(source_name)),
            "-o",
            str(target),
        ]
        process = subprocess.run(
            command, capture_output=True, text=True, check=False, env=os.environ | {"LC_ALL": "C"}
        )
        if process.returncode:
            lines = [line for line in process.stderr.splitlines() if "error" in line]
            raise MissingDependencyError("--cpp", _CPP_REQUIREMENTS_TEXT, (lines or ["the compiler failed"])[0])
        return ctypes.CDLL(str(target))


def compile_pair_loop(*, with_dynamics: bool = False) -> Any:
    """Compile the C++ loops over a pair, including the loop for dynamics if `with_dynamics`; return the ctypes
    library, whose functions have their argument types set. The library is cached. Raise a MissingDependencyError if
    the compiler or a header is missing.

    Raises:
        MissingDependencyError: no compiler is on the path, or a header is missing.
    """
    library = compile_library(PAIR_LOOP_SOURCE, *[DYNAMICS_FLAG] * with_dynamics)
    pointer: Any = ctypes.c_void_p
    number: Any = ctypes.c_long
    library.pair_new.argtypes, library.pair_new.restype = [number] + [pointer] * 7, pointer
    library.pair_delete.argtypes, library.pair_delete.restype = [pointer], None
    library.pair_loop.argtypes, library.pair_loop.restype = [pointer, number] + [pointer] * 9, None
    if with_dynamics:
        library.pair_dynamics.argtypes = [pointer, number, number] + [pointer] * 4
        library.pair_dynamics.restype = None
    return library


def cpp_missing_reason(is_requested: bool, source_name: str = PAIR_LOOP_SOURCE, *flags: str) -> str | None:
    """Compile a C++ file if `is_requested`. Return None if this succeeds; otherwise return a string that says why the
    loops of the file cannot be measured (not requested, or no compiler or header).

    Args:
        is_requested: whether the user asks for them by --cpp.
        source_name: name of the file, as for `compile_library`.
        flags: further flags of the compiler.
    """
    if not is_requested:
        return "--cpp compiles and measures it"
    try:
        compile_library(source_name, *flags)
    except MissingDependencyError as error:
        return str(error)
    return None


def _header_folders() -> Iterator[Path]:
    """Yield the paths of folders that may hold the headers of Pinocchio, of its dependencies and of Eigen."""
    import pinocchio

    for parent in Path(pinocchio.__file__).resolve().parents:
        if (parent / "include" / "pinocchio").is_dir():
            yield from (parent / "include", parent / "include" / "eigen3")
            break
    yield from (Path("/usr/include/eigen3"), Path("/usr/local/include/eigen3"))
