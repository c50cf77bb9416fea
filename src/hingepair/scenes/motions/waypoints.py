"""Way points: a coordinate that is at given values at given instants, and how it goes from one to the next.

psi = { t = [0, 2, 5], value = [0, "pi/2", 0.3], profile = "quintic", speed = 2, acceleration = 4 }

A trapezoid, a cubic and a quintic stop at each point and never leave the range between two neighbours: a cubic with
the least mean square acceleration, a quintic with the least mean square jerk and no acceleration at the points. A
spline goes through the inner points without stopping: of all such motions the one with the least mean square jerk,
which may swing past the points. Before the first point and after the last the coordinate stays where it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import Float64Array

PROFILES: Final = ("linear", "trapezoid", "cubic", "quintic", "spline")
"""Names of the curves from one way point to the next."""
MAX_WAY_POINTS: Final = 200
"""Largest number of way points of one coordinate."""
_CONTINUOUS: Final = {"linear": 1, "trapezoid": 2, "cubic": 2, "quintic": 3, "spline": 3}
"""How many of coordinate, rate and acceleration are continuous, which at the breaks determine the curve."""


@dataclass(frozen=True, slots=True, eq=False)
class WayPoints:
    """Piecewise polynomial of time through way points; constant before the first and after the last break."""

    #: a `scipy.interpolate.PPoly`, whose last piece is constant and begins at the last way point
    path: Any
    #: whether the second derivative is continuous
    smooth: bool

    def derivatives(self, t: ArrayLike, order: int) -> tuple[Float64Array, ...]:
        """Return (value, first derivative, ...) up to `order` at t, a tuple of arrays of t's shape. At a break,
        return the derivatives from the right.
        """
        times, start = np.asarray(t, dtype=np.float64), self.path.x[0]
        value, *rates = (self.path(np.maximum(times, start), k) for k in range(order + 1))
        return value, *(np.where(times < start, 0.0, rate) for rate in rates)

    def switches(self, t: Float64Array) -> NDArray[np.bool_]:
        """Return, for each interval between instants t, whether it has a break at which a derivative jumps."""
        switched = np.zeros(max(0, t.size - 1), dtype=bool)
        places = np.searchsorted(t, () if self.smooth else self.path.x[:-1], side="left") - 1
        switched[places[(places >= 0) & (places < switched.size)]] = True
        return switched


def interpolate_way_points(
    t: Float64Array, values: Float64Array, profile: str, speed: float = math.inf, acceleration: float = math.inf
) -> WayPoints:
    """Return WayPoints through values at increasing instants t; `profile`, one of the PROFILES, selects the
    polynomials between them. `speed` and `acceleration` are limits: ramps of a trapezoid keep them, and other
    profiles are refused where they exceed them.

    >>> path = interpolate_way_points(np.array([0.0, 2.0]), np.array([0.0, 4.0]), "quintic")
    >>> position, speed = path.derivatives(1.0, 1)
    >>> round(float(position), 9), round(float(speed), 9)
    (2.0, 3.75)
    """
    from scipy.interpolate import BPoly, PPoly

    rows, count = np.stack((values, 0 * values, 0 * values), axis=1), _CONTINUOUS[profile]
    if profile == "trapezoid":
        t, rows = _with_ramps(t, values, speed, acceleration)
    elif profile == "spline":
        rows = _spline_rows(t, values)
    still = np.array([values[-1], 0.0, 0.0])
    curve = BPoly.from_derivatives([*t, t[-1] + 1.0], [row[:count] for row in (*rows, still)])
    path = PPoly.from_bernstein_basis(curve)
    for k, name, limit in ((1, "speed", speed), (2, "acceleration", acceleration)):
        if profile == "linear" and k == 2 and limit < math.inf:
            raise ArgumentError(name, "no such limit of a linear profile, whose speed jumps", limit)
        derived = path.derivative(k)
        at = np.concatenate((t, derived.derivative().roots(extrapolate=False)))
        largest = float(np.nanmax(np.abs(derived(at)))) if limit < math.inf else 0.0
        if largest > limit * (1 + 1e-9):  # a smaller excess is rounding
            raise ArgumentError(name, f"at least {largest:.6g}, which this profile needs between these points", limit)
    return WayPoints(path, count == 3)


def _spline_rows(t: Float64Array, values: Float64Array) -> Float64Array:
    """Return value, rate and acceleration at points of the spline of degree 5, whose ends rest; shape (m, 3)."""
    from scipy.interpolate import make_interp_spline

    rest = [(1, 0.0), (2, 0.0)]
    try:
        spline = make_interp_spline(t, values, k=5, bc_type=(rest, rest))
    except ValueError:  # LinAlgError is one
        step = f"a shortest step of {np.diff(t).min():g} s"
        raise ArgumentError("t", "steps of like size, long enough for a spline profile", step) from None
    rows = np.stack((values, spline(t, 1), spline(t, 2)), axis=1)
    rows[[0, -1], 1:] = 0.0
    return rows


def _with_ramps(
    t: Float64Array, values: Float64Array, speed: float, acceleration: float
) -> tuple[Float64Array, Float64Array]:
    """Return instants at which a trapezoidal rate begins and ends to change, and value and rate there. A ramp takes a
    third of the time, or what is nearest to it among times that the limits allow.
    """
    time, way = np.diff(t), np.diff(values)
    longest = np.minimum(0.499 * time, time - np.abs(way) / speed)
    shortest = (time - np.sqrt(np.maximum(time**2 - 4 * np.abs(way) / acceleration, 0.0))) / 2
    ramp = np.where(longest > 0, np.clip(time / 3, shortest, longest), time / 3)
    rate = way / (time - ramp)
    rising, falling = values[:-1] + rate * ramp / 2, values[1:] - rate * ramp / 2
    times = np.stack((t[:-1], t[:-1] + ramp, t[1:] - ramp), axis=1).ravel()
    rows = np.stack((np.stack((values[:-1], rising, falling), 1), np.stack((0 * rate, rate, rate), 1)), axis=-1)
    return np.append(times, t[-1]), np.concatenate((rows.reshape(-1, 2), [[values[-1], 0.0]]))
