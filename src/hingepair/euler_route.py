"""E12 by the equations' own route: phi' = J(phi)^-1 omega for the Euler angles of body 1, by Runge-Kutta steps.

The sequence is E10's, XYZ. The rates grow without bound towards gimbal lock, and no step is short enough there.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from hingepair import equations as eq
from hingepair.attitude_steps import Rule, Steps
from hingepair.backend import How
from hingepair.errors import GimbalLockError
from hingepair.increments import quaternion_product
from hingepair.signals import Signal, Values

RULE: Final = Rule(5, 4, (0.0, 0.5, 1.0))

_LOCK = 0.5
_FARTHEST = 1.0


def euler_angles(omega: Signal, steps: Steps, how: How, start: Values, *, body: bool) -> Values:
    """The Euler angles of body 1 at the instants, continuous in time, shape (N, 3).

    Raises:
        GimbalLockError: near lock an angle would turn by more than 1 rad in a step; names the time.
    """
    found = np.empty((len(steps.t), 3))
    found[0] = start
    run: Any = runge_kutta
    if how.compiles(int(steps.counts.sum())):
        from hingepair.kernel_cache import turn_kernels

        run = turn_kernels().euler
    for first, last in steps.slabs():
        begin, (h, _), ends = steps.within(first, last)
        rows = np.empty((len(h), 3))
        at = run(np.ascontiguousarray(omega.nodes(begin, h, RULE.nodes)), h, found[first], body, rows)
        if at >= 0:
            near = rows[at - 1, 1] if at else found[first, 1]
            raise GimbalLockError(
                "method",
                "'magnus6' (or another that knows no lock) for a motion near gimbal lock",
                f"'euler_angles' with phi_y = {near:.6g} at t = {begin[at]:.6g}",
            )
        found[first + 1 : last + 1] = rows if ends is None else rows[ends]
    return found


def runge_kutta(omega: Any, h: Any, start: Any, body: bool, rows: Any) -> int:
    """Classical Runge-Kutta steps; omega at start, middle and end of each, shape (steps, 3, 3).

    Returns the first step that comes too near to lock, or -1.
    """
    x, y, z = start[0], start[1], start[2]
    for k in range(len(h)):
        s = h[k]
        w1 = (omega[k, 0, 0], omega[k, 0, 1], omega[k, 0, 2])
        w2 = (omega[k, 1, 0], omega[k, 1, 1], omega[k, 1, 2])
        w3 = (omega[k, 2, 0], omega[k, 2, 1], omega[k, 2, 2])
        a = rates((x, y, z), w1, body, s)
        b = rates((x + 0.5 * s * a[0], y + 0.5 * s * a[1], z + 0.5 * s * a[2]), w2, body, s)
        c = rates((x + 0.5 * s * b[0], y + 0.5 * s * b[1], z + 0.5 * s * b[2]), w2, body, s)
        d = rates((x + s * c[0], y + s * c[1], z + s * c[2]), w3, body, s)
        x += s / 6 * (a[0] + 2 * (b[0] + c[0]) + d[0])
        y += s / 6 * (a[1] + 2 * (b[1] + c[1]) + d[1])
        z += s / 6 * (a[2] + 2 * (b[2] + c[2]) + d[2])
        if not (math.isfinite(x) and math.isfinite(z)):
            return k
        rows[k, 0] = x
        rows[k, 1] = y
        rows[k, 2] = z
    return -1


def rates(phi: Any, omega: Any, body: bool, h: float) -> Any:
    """J^-1 omega (E4); NaN where lock is too near for a step of length h."""
    if not math.isfinite(phi[0] + phi[1] + phi[2]):
        return math.nan, math.nan, math.nan
    trig = (
        math.sin(phi[0]), math.cos(phi[0]), math.sin(phi[1]), math.cos(phi[1]), math.sin(phi[2]), math.cos(phi[2]),
    )  # fmt: skip
    w = eq.rotate(eq.tait_bryan_attitude(trig), omega) if body else omega
    axes = eq.tait_bryan_axes(trig)
    along, level = eq.euler_rate_along(axes, w), trig[3]
    if abs(level) < _LOCK and abs(along * h) > _FARTHEST * abs(level):
        return math.nan, math.nan, math.nan
    return eq.euler_rates1(axes, w, along / level)


def quaternions_of_euler(phi: Values) -> Values:
    """The rotations of Euler angles (E10), unit quaternions (w, x, y, z) that are continuous where the angles are."""
    s, c, zero = np.sin(0.5 * phi), np.cos(0.5 * phi), np.zeros(len(phi))
    x, y, z = (
        (c[:, i], *(s[:, i] if i == j else zero for j in range(3))) for i in range(3)
    )
    return np.stack(quaternion_product(quaternion_product(x, y), z), axis=-1)
