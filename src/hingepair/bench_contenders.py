"""The ways that `bench direct` compares."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np

from hingepair.bench_arrays import jax_compiled, numpy_stacks, scipy_rotation, sympy_lambdify
from hingepair.bench_engines import mujoco_loop, pinocchio_loop
from hingepair.bench_methods import Method, ours

METHODS = (
    Method("hingepair numba, out=, 1 worker", ours("numba"), 10**7, np.float64),
    Method("hingepair numba, out=, 2 workers", ours("numba", workers=2), 10**7, np.float64),
    Method("hingepair numba, fresh, 1 worker", ours("numba", fresh=True), 10**7, np.float64),
    Method("hingepair numba float32, out=", ours("numba"), 10**7, np.float32),
    Method("hingepair numpy, out=", ours("numpy"), 10**7, np.float64),
    Method("Pinocchio, Python loop", pinocchio_loop, 10**4, np.float64, "pinocchio"),
    Method("MuJoCo, Python loop", mujoco_loop, 10**4, np.float64, "mujoco"),
    Method("JAX, compiled, 1 core", jax_compiled, 10**7, np.float64, "jax"),
    Method("SciPy Rotation + NumPy", scipy_rotation, 10**6, np.float64, "scipy"),
    Method("NumPy, 3x3 stacks", numpy_stacks, 10**6, np.float64),
    Method("SymPy lambdify + cse", sympy_lambdify, 10**6, np.float64, "sympy"),
)


def installed(method: Method) -> bool:
    """Whether the package that a method needs is there."""
    return not method.needs or find_spec(method.needs) is not None
