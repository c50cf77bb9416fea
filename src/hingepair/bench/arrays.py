"""Ways of `bench direct` that work on arrays: SciPy, NumPy, SymPy, JAX."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from hingepair.bench.methods import PARTS, Array, Found, Job, Motion, outputs_at
from hingepair.evaluation.plan import Plan, make_plan
from hingepair.pair.hinge_pair import HingePair


def scipy_rotation(pair: HingePair, motion: Motion) -> Job:
    """SciPy's Rotation for the attitudes, NumPy for the rest."""
    from scipy.spatial.transform import Rotation

    home = Rotation.from_matrix(pair.home)

    def attitudes(q: Array) -> tuple[Array, Array]:
        first = Rotation.from_euler("XYZ", q[:, 3:6])
        return first.as_matrix(), (first * Rotation.from_rotvec(q[:, 6:] * pair.n) * home).as_matrix()

    return lambda: _by_stacks(np, pair, motion, *attitudes(motion[0]))


def numpy_stacks(pair: HingePair, motion: Motion) -> Job:
    """NumPy on stacks of 3 x 3 matrices: products with @, vector products with numpy.cross."""

    def about(axis: int, angle: Array) -> Array:
        S = np.zeros((len(angle), 3, 3))
        i, j = (axis + 1) % 3, (axis + 2) % 3
        S[:, axis, axis] = 1
        S[:, i, i] = S[:, j, j] = np.cos(angle)
        S[:, j, i] = np.sin(angle)
        S[:, i, j] = -S[:, j, i]
        return S

    def run() -> Found:
        return _by_stacks(np, pair, motion, *_attitudes(np, pair, motion[0], about))

    return run


def _attitudes(xp: Any, pair: HingePair, q: Any, about: Callable[[int, Any], Any]) -> tuple[Any, Any]:
    """S1 and S2 as stacks, by NumPy or what is written like it."""
    x, y, z = pair.n
    K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    S1 = about(0, q[:, 3]) @ about(1, q[:, 4]) @ about(2, q[:, 5])
    s, c = xp.sin(q[:, 6])[:, None, None], xp.cos(q[:, 6])[:, None, None]
    return S1, S1 @ (np.eye(3) + s * K + (1 - c) * (K @ K)) @ pair.home


def _by_stacks(xp: Any, pair: HingePair, motion: tuple[Any, ...], S1: Any, S2: Any) -> dict[str, Any]:
    """Body 2 from stacks of attitudes, written as a NumPy user would, by NumPy or what is written like it."""
    q = motion[0]
    r1, r2 = S1 @ pair.u1, S2 @ pair.u2
    found = {"R2": q[:, :3] + r1 - r2, "S2": S2}
    if len(motion) > 1:
        qd = motion[1]
        c, s = xp.cos(q[:, 3]), xp.sin(q[:, 3])
        zero = xp.zeros_like(c)
        b = xp.stack([zero, c, s], axis=-1)
        turn_x, turn_y = xp.stack([qd[:, 3], zero, zero], axis=-1), b * qd[:, 4:5]
        omega1 = turn_x + turn_y + S1[:, :, 2] * qd[:, 5:6]
        axis = S1 @ pair.n
        omega2 = omega1 + axis * qd[:, 6:]
        found |= {"v2": qd[:, :3] + xp.cross(omega1, r1) - xp.cross(omega2, r2), "omega2": omega2}
    if len(motion) > 2:
        qdd = motion[2]
        alpha1 = xp.stack([qdd[:, 3], zero, zero], axis=-1) + b * qdd[:, 4:5] + S1[:, :, 2] * qdd[:, 5:6]
        alpha1 += xp.cross(turn_x, turn_y) + xp.cross(turn_x + turn_y, S1[:, :, 2] * qd[:, 5:6])
        alpha2 = alpha1 + axis * qdd[:, 6:] + xp.cross(omega1, axis) * qd[:, 6:]
        a1 = qdd[:, :3] + xp.cross(alpha1, r1) + xp.cross(omega1, xp.cross(omega1, r1))
        found |= {"a2": a1 - xp.cross(alpha2, r2) - xp.cross(omega2, xp.cross(omega2, r2)), "alpha2": alpha2}
    return found


def sympy_lambdify(pair: HingePair, motion: Motion) -> Job:
    """The equations as SymPy expressions in the coordinates, compiled by lambdify with common subexpressions."""
    import sympy

    names = outputs_at(len(motion))
    symbols = [sympy.symbols(f"{letter}0:7") for letter in ("q", "v", "a")[: len(motion)]]
    plan = _plan(names, sympy.sin, sympy.cos)
    values = _values(pair, symbols)
    plan.run(values)
    flat = [component for name in names for component in values[name]]
    function = sympy.lambdify(list(sum(symbols, ())), flat, "numpy", cse=True)

    def run() -> Found:
        columns = iter(function(*(c[:, i] for c in motion for i in range(7))))
        count = len(motion[0])
        found = {}
        for name in names:
            shape = (3, 3) if name == "S2" else (3,)
            parts = [next(columns) for _ in range(int(np.prod(shape)))]
            found[name] = np.stack(np.broadcast_arrays(*parts), axis=-1).reshape(count, *shape)
        return found

    return run


def jax_compiled(pair: HingePair, motion: Motion) -> Job:
    """Stacks of 3 x 3 matrices, compiled by jax.jit, on one core; its inputs are JAX arrays beforehand."""
    with _one_core():
        import jax
        import jax.numpy as jnp

        device = jax.devices("cpu")[0]

    def about(axis: int, angle: Any) -> Any:
        i, j = (axis + 1) % 3, (axis + 2) % 3
        rows = [[jnp.zeros_like(angle)] * 3 for _ in range(3)]
        rows[axis][axis] = jnp.ones_like(angle)
        rows[i][i] = rows[j][j] = jnp.cos(angle)
        rows[j][i] = jnp.sin(angle)
        rows[i][j] = -rows[j][i]
        return jnp.stack([jnp.stack(row, -1) for row in rows], -2)

    function = jax.jit(lambda *given: _by_stacks(jnp, pair, given, *_attitudes(jnp, pair, given[0], about)))
    with jax.enable_x64(True):
        made = [jax.device_put(c, device) for c in motion]

    def run() -> Found:
        with jax.enable_x64(True):
            return {name: np.asarray(array) for name, array in function(*made).items()}

    return run


def _plan(names: tuple[str, ...], sin: Any, cos: Any) -> Plan:
    """The steps to some outputs, with the sine and cosine of another package."""
    return make_plan(
        names,
        "XYZ",
        True,
        (
            lambda phi: tuple(f(angle) for angle in phi for f in (sin, cos)),
            lambda psi: (sin(psi), 2 * sin(psi / 2) ** 2),
        ),
    )


def _values(pair: HingePair, sevens: list[tuple[Any, ...]]) -> dict[str, Any]:
    """What a plan takes: the pair's constants, and q, qd, qdd by their parts."""
    values: dict[str, Any] = {key: tuple(getattr(pair, key).ravel().tolist()) for key in ("u1", "u2", "n", "home")}
    for names, seven in zip(PARTS, sevens, strict=False):
        values |= dict(zip(names, (seven[:3], seven[3:6], seven[6]), strict=True))
    return values


@contextmanager
def _one_core() -> Iterator[None]:
    """JAX makes as many threads as the process may use cores when it first names its devices (Linux only)."""
    if not hasattr(os, "sched_setaffinity"):
        yield
        return
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)
