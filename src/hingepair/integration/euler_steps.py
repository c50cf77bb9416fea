"""Runge-Kutta steps for phi' = J(phi)^-1 omega (E4, E12), as arithmetic that also compiles."""

from __future__ import annotations

import math
from typing import Any

from hingepair.equations import spatial as eq

_LOCK = 0.5  # of abs(cos phi_y): below, an angle that turns far in a step does so because lock is near
_FARTHEST = 1.0  # rad in a step


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
