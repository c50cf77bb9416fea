"""E12 by the equations' own route: phi' = J(phi)^-1 omega for the Euler angles of body 1, by Runge-Kutta steps.

The sequence is E10's, XYZ. The rates grow without bound towards gimbal lock, and no step is short enough there.
"""

from __future__ import annotations

import functools
import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import Execution
from hingepair.engine.binding import bind
from hingepair.engine.loops import Loop
from hingepair.engine.native import can_compile
from hingepair.engine.trace import where_less
from hingepair.equations import spatial as eq
from hingepair.errors import GimbalLockError
from hingepair.integration.methods import RULES, quaternion_product
from hingepair.integration.signals import Signal
from hingepair.integration.stepping import Steps
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.blocks import cosine, sine

NODES: Final = RULES["rk4_quaternion"].nodes

_LOCK = 0.5  # of abs(cos phi_y): below, an angle that turns far in a step does so because lock is near
_FARTHEST = 1.0  # rad in a step
_WORTH_COMPILING = 5_000  # steps
_F8 = np.dtype(np.float64)


def euler_angles(omega: Signal, steps: Steps, how: Execution, start: NDArray[Any], *, body: bool) -> Array:
    """The Euler angles of body 1 between steps, continuous in time, shape (steps + 1, 3).

    Raises:
        GimbalLockError: an angle would turn by more than 1 rad in a step, near lock or since steps are too long;
            names the time.
    """
    found = np.empty((len(steps.t), 3))
    found[0] = start
    pays = how.backend == "auto" and steps.made >= _WORTH_COMPILING and can_compile()
    run = _run_compiled if pays or how.backend == "compiled" else _run
    for first, last in steps.slabs():
        begin, (h, _) = steps.within(first, last)
        rows = found[first + 1 : last + 1]
        rows[:] = math.nan
        run(omega.nodes(begin, h, NODES), h, found[first], body, rows)
        if not np.isfinite(rows[-1]).all():
            at = int(np.argmin(np.isfinite(rows).all(axis=1)))
            near = rows[at - 1, 1] if at else found[first, 1]
            raise GimbalLockError(
                "method",
                "'magnus6' (or another that knows no lock) for a motion near gimbal lock, phi_y = +-1.5708; or "
                "shorter steps",
                f"'euler_angles' with phi_y = {near:.6g} at t = {begin[at]:.6g} and more than 1 rad in {h[at]:.3g} s",
            )
    return found


def quaternions_of_euler(phi: Array) -> Array:
    """The rotations of Euler angles (E10), unit quaternions (w, x, y, z) that are continuous where the angles are."""
    (sx, sy, sz), (cx, cy, cz) = np.sin(0.5 * phi).T, np.cos(0.5 * phi).T
    about_x_y = quaternion_product((cx, sx, 0.0, 0.0), (cy, 0.0, sy, 0.0))
    return np.stack(quaternion_product(about_x_y, (cz, 0.0, 0.0, sz)), axis=-1)


def _run(omega: Array, h: Array, start: Array, body: bool, rows: Array) -> None:
    """The steps one after the other, up to the first that comes too near to lock."""
    phi, step = tuple(start.tolist()), _step_of_floats(body)
    for k, (w, length) in enumerate(zip(omega.reshape(-1, 9).tolist(), h.tolist(), strict=True)):
        rows[k] = phi = step(*phi, *w, length)[:3]
        if not math.isfinite(phi[0] + phi[2]):
            return


@functools.cache
def _step_of_floats(body: bool) -> Any:
    loop = _steps(body)
    some = {name: np.full((2, *shape), 0.5) for name, shape in loop.inputs}
    return loop.program(bind(loop.inputs, some, frozenset(loop.carry)).pattern).floats_function


def _run_compiled(omega: Array, h: Array, start: Array, body: bool, rows: Array) -> None:
    given = {"phi": start[None], "omega": omega[None], "h": h[None]}
    _steps(body).run(given, {"phi": rows[None]}, (1, len(h)), _F8, Execution("compiled", 1))


@functools.cache
def _steps(body: bool) -> Loop:
    """Classical Runge-Kutta steps; omega at start, middle and end of each. NaN from where lock is too near."""

    def step(v: dict[str, Any]) -> dict[str, Any]:
        phi, w, h = v["phi"], v["omega"], v["h"]
        a = _rates(phi, w[:3], h, body)
        b = _rates(eq.add(phi, eq.scale(a, 0.5 * h)), w[3:6], h, body)
        c = _rates(eq.add(phi, eq.scale(b, 0.5 * h)), w[3:6], h, body)
        d = _rates(eq.add(phi, eq.scale(c, h)), w[6:], h, body)
        rise = eq.add(eq.add(a, eq.scale(eq.add(b, c), 2)), d)
        return {"phi": eq.add(phi, eq.scale(rise, h / 6))}

    shapes = {"phi": (3,), "omega": (3, 3), "h": ()}
    return Loop("euler_angles", step, shapes, {"phi": (3,)}, carry={"phi": "phi"})


def _rates(phi: eq.Vector, omega: eq.Vector, h: eq.Scalar, body: bool) -> Any:
    """J^-1 omega (E4); NaN where lock is too near for a step of length h."""
    x, y, z = phi
    trig = (sine(x), cosine(x), sine(y), cosine(y), sine(z), cosine(z))
    w = eq.rotate(eq.tait_bryan_attitude(trig), omega) if body else omega
    axes = eq.tait_bryan_axes(trig)
    along, level = eq.euler_rate_along(axes, w), trig[3]
    rates, locked = eq.euler_rates1(axes, w, along / level), (math.nan,) * 3
    far, near = (along * h) * (along * h), level * level
    return where_less(near, _LOCK**2, where_less(_FARTHEST**2 * near, far, locked, rates), rates)
