"""E12 for the Euler angles of body 1: phi' = J(phi)^-1 omega by Runge-Kutta steps.

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
from hingepair.engine.trace import where_less
from hingepair.equations import spatial as eq
from hingepair.errors import GimbalLockError
from hingepair.integration.methods import STEP_RULE_BY_NAME, quaternion_product
from hingepair.integration.signals import Signal
from hingepair.integration.stepping import Steps
from hingepair.numeric.arrays import FLOAT64_DTYPE
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.blocks import cosine, sine

RELATIVE_RK4_NODE_TIMES: Final = STEP_RULE_BY_NAME["rk4_quaternion"].nodes
"""Nodes of a classical Runge-Kutta step, as fractions of the step."""

# abs(cos phi_y): below this value a large change of an angle in a step means that gimbal lock is near.
_MAX_ABS_COS_PHI_Y_NEAR_GIMBAL_LOCK = 0.5
_MAX_ANGLE_CHANGE_PER_STEP_NEAR_GIMBAL_LOCK_RAD = 1.0  # rad: largest change of an angle in a step
_MIN_STEP_COUNT_FOR_COMPILED_LOOP = 5_000  # steps from which on compiling pays


def integrate_euler_angles(
    omega: Signal, steps: Steps, execution: Execution, start: NDArray[Any], *, omega_in_body_axes: bool
) -> Array:
    """Integrate the Euler angles XYZ of body 1 from the Signal `omega` over `steps`, a Steps object; return the
    continuous angles at the ends of the steps, shape (steps + 1, 3). `start` are the angles at the first time. omega
    is in axes of body 1 if `omega_in_body_axes`, otherwise in axes of the world. The Execution `execution` chooses
    the backend. Raise a GimbalLockError if an angle would change by more than 1 rad in a step near gimbal lock.

    Raises:
        GimbalLockError: an angle would turn by more than 1 rad in a step, near gimbal lock or because steps are too
            long; names the time.
    """
    angles = np.empty((len(steps.t), 3))
    angles[0] = start
    compile_auto = execution.backend == "auto" and steps.step_count >= _MIN_STEP_COUNT_FOR_COMPILED_LOOP
    run = _integrate_compiled if compile_auto or execution.backend == "compiled" else _integrate_on_floats
    for first, last in steps.chunks():
        begin, (h, _) = steps.starts_and_lengths(first, last)
        rows = angles[first + 1 : last + 1]
        rows[:] = math.nan
        run(omega.values_at_nodes(begin, h, RELATIVE_RK4_NODE_TIMES), h, angles[first], omega_in_body_axes, rows)
        if not np.isfinite(rows[-1]).all():
            failed = int(np.argmin(np.isfinite(rows).all(axis=1)))
            phi_y = rows[failed - 1, 1] if failed else angles[first, 1]
            raise GimbalLockError(
                "method",
                "'magnus6' (or another method without gimbal lock) for a motion near phi_y = +-1.5708; or "
                "shorter steps",
                f"'euler_angles' with phi_y = {phi_y:.6g} at t = {begin[failed]:.6g} and more than 1 rad in "
                f"{h[failed]:.3g} s",
            )
    return angles


def euler_to_quaternions(phi: Array) -> Array:
    """Return the unit quaternions (w, x, y, z), shape (N, 4), of the Euler angles XYZ `phi` (N, 3) (E10). The
    quaternions are continuous where the angles are.
    """
    (sx, sy, sz), (cx, cy, cz) = np.sin(0.5 * phi).T, np.cos(0.5 * phi).T
    about_x_y = quaternion_product((cx, sx, 0.0, 0.0), (cy, 0.0, sy, 0.0))
    return np.stack(quaternion_product(about_x_y, (cz, 0.0, 0.0, sz)), axis=-1)


def _integrate_on_floats(node_omega: Array, h: Array, start: Array, omega_in_body_axes: bool, angles: Array) -> None:
    """Integrate Euler angles from `start` over steps of lengths h, one after the other on Python floats, and write
    the angles after each step into `angles`; return None. `node_omega` is omega at the nodes of the steps, in axes of
    body 1 if `omega_in_body_axes`, otherwise of the world. Stop after the first step that gives NaN, which means
    gimbal lock.
    """
    phi, step = tuple(start.tolist()), _float_step_function(omega_in_body_axes)
    for k, (w, length) in enumerate(zip(node_omega.reshape(-1, 9).tolist(), h.tolist(), strict=True)):
        angles[k] = phi = step(*phi, *w, length)[:3]
        if not math.isfinite(phi[0] + phi[2]):
            return


@functools.cache
def _float_step_function(omega_in_body_axes: bool) -> Any:
    """Return the cached function of one Runge-Kutta step on 13 floats (phi, omega at three nodes, and the step
    length). The function returns a sequence that begins with the three new angles. It takes omega in axes of body 1
    if `omega_in_body_axes`, otherwise in axes of the world.
    """
    loop = _runge_kutta_loop(omega_in_body_axes)
    examples = {name: np.full((2, *shape), 0.5) for name, shape in loop.inputs}
    return loop.program(bind(loop.inputs, examples, frozenset(loop.carry)).pattern).floats_function


def _integrate_compiled(node_omega: Array, h: Array, start: Array, omega_in_body_axes: bool, angles: Array) -> None:
    """Integrate Euler angles from `start` over steps of lengths h by the compiled loop, and write the angles after
    each step into `angles`, NaN after gimbal lock; return None. `node_omega` is omega at the nodes of the steps, in
    axes of body 1 if `omega_in_body_axes`, otherwise of the world.
    """
    arguments = {"phi": start[None], "omega": node_omega[None], "h": h[None]}
    _runge_kutta_loop(omega_in_body_axes).run(
        arguments, {"phi": angles[None]}, (1, len(h)), FLOAT64_DTYPE, Execution("compiled", 1)
    )


@functools.cache
def _runge_kutta_loop(omega_in_body_axes: bool) -> Loop:
    """Return the cached `Loop` of Runge-Kutta steps that integrate Euler angles from omega; the angles are NaN after
    a step that is too long near gimbal lock. Its inputs are phi, omega at start, middle and end of each step, and the
    length h of each step. omega is in axes of body 1 if `omega_in_body_axes`, otherwise in axes of the world.
    """

    def step(values: dict[str, Any]) -> dict[str, Any]:
        """Return the angles after one Runge-Kutta step as {"phi": ...}, NaN if the step is too long near gimbal lock.
        `values` is a dict of phi before the step, omega at the three nodes, and the step length h.
        """
        phi, w, h = values["phi"], values["omega"], values["h"]
        a = _euler_rates(phi, w[:3], h, omega_in_body_axes)
        b = _euler_rates(eq.add(phi, eq.scale(a, 0.5 * h)), w[3:6], h, omega_in_body_axes)
        c = _euler_rates(eq.add(phi, eq.scale(b, 0.5 * h)), w[3:6], h, omega_in_body_axes)
        d = _euler_rates(eq.add(phi, eq.scale(c, h)), w[6:], h, omega_in_body_axes)
        rise = eq.add(eq.add(a, eq.scale(eq.add(b, c), 2)), d)
        return {"phi": eq.add(phi, eq.scale(rise, h / 6))}

    shapes = {"phi": (3,), "omega": (3, 3), "h": ()}
    return Loop("euler_angles", step, shapes, {"phi": (3,)}, carry={"phi": "phi"})


def _euler_rates(phi: eq.Vector, omega: eq.Vector, h: eq.Scalar, omega_in_body_axes: bool) -> Any:
    """Return the Euler-angle rates J^-1 omega (E4) at the angles phi as a tuple. They are NaN if an angle would
    change by more than 1 rad in a step of length h near gimbal lock. omega is in axes of body 1 if
    `omega_in_body_axes`, otherwise in axes of the world.
    """
    x, y, z = phi
    trig = (sine(x), cosine(x), sine(y), cosine(y), sine(z), cosine(z))
    w = eq.rotate(eq.tait_bryan_attitude(trig), omega) if omega_in_body_axes else omega
    axes = eq.tait_bryan_axes(trig)
    rate_along_x, cos_y = eq.scaled_third_rate(axes, w), trig[3]
    rates, nan_rates = eq.euler_rates1(axes, w, rate_along_x / cos_y), (math.nan,) * 3
    squared_change, squared_cos = (rate_along_x * h) * (rate_along_x * h), cos_y * cos_y
    return where_less(
        squared_cos,
        _MAX_ABS_COS_PHI_Y_NEAR_GIMBAL_LOCK**2,
        where_less(
            _MAX_ANGLE_CHANGE_PER_STEP_NEAR_GIMBAL_LOCK_RAD**2 * squared_cos, squared_change, nan_rates, rates
        ),
        rates,
    )
