"""The ways that `bench direct` compares."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from hingepair.bench.arrays import jax_compiled, numpy_stacks, scipy_rotation, sympy_lambdify
from hingepair.bench.cpp import compiled_loop, pinocchio_cpp
from hingepair.bench.engines import mujoco_loop, pinocchio_loop
from hingepair.bench.methods import Method, ours
from hingepair.errors import MissingDependencyError

METHODS = (
    Method("hingepair numba, out=, 1 worker", ours("numba"), 10**7, np.float64),
    Method("hingepair numba, out=, 2 workers", ours("numba", workers=2), 10**7, np.float64),
    Method("hingepair numba, fresh, 1 worker", ours("numba", fresh=True), 10**7, np.float64),
    Method("hingepair numba, fresh, 2 workers", ours("numba", workers=2, fresh=True), 10**7, np.float64),
    Method("hingepair numba float32, out=", ours("numba"), 10**7, np.float32),
    Method("hingepair numpy, out=", ours("numpy"), 10**7, np.float64),
    Method("hingepair numpy, out=, 2 workers", ours("numpy", workers=2), 10**7, np.float64),
    Method("hingepair numpy, fresh", ours("numpy", fresh=True), 10**7, np.float64),
    Method("Pinocchio, Python loop", pinocchio_loop, 10**4, np.float64, "pinocchio"),
    Method("MuJoCo, Python loop", mujoco_loop, 10**4, np.float64, "mujoco"),
    Method("JAX, compiled, 1 core", jax_compiled, 10**7, np.float64, "jax"),
    Method("SciPy Rotation + NumPy", scipy_rotation, 10**6, np.float64, "scipy"),
    Method("NumPy, 3x3 stacks", numpy_stacks, 10**6, np.float64),
    Method("SymPy lambdify + cse", sympy_lambdify, 10**6, np.float64, "sympy"),
)


CPP = Method("Pinocchio, C++ loop", pinocchio_cpp, 10**6, np.float64, "pinocchio")


def contenders(cpp: bool) -> tuple[list[Method], list[str]]:
    """The ways that can be had, and a line for each that cannot.

    Args:
        cpp: compile Pinocchio's C++ loop.
    """
    found = [method for method in METHODS if installed(method)]
    missing = [f"{m.name} ({m.needs} is not installed)" for m in METHODS if not installed(m)]
    if not cpp:
        return found, [*missing, f"{CPP.name} (compiled where --cpp asks for it)"]
    try:
        compiled_loop()
    except MissingDependencyError as error:
        return found, [*missing, f"{CPP.name} ({error})"]
    return [*found, CPP], missing


def installed(method: Method) -> bool:
    """Whether the package that a method needs is there."""
    return not method.needs or find_spec(method.needs) is not None
