"""Way points: a coordinate that is at given values at given instants, and how it goes from one to the next.

psi = { t = [0, 2, 5], value = [0, "pi/2", 0.3], profile = "quintic", speed = 2, acceleration = 4 }

A trapezoid, a cubic and a quintic stop at each point and never leave the range between two neighbours: a cubic with
the least mean square acceleration, a quintic with the least mean square jerk and no acceleration at the points. A
spline goes through the inner points without stopping: of all such motions the one with the least mean square jerk,
which may swing past the points. Before the first point and after the last the coordinate stays where it is.
"""

from __future__ import annotations

import itertools
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
_UNIT_POLYNOMIALS: Final = {
    "linear": (1, 0),
    "cubic": (-2, 3, 0, 0),
    "quintic": (6, -15, 10, 0, 0, 0),
}
"""Coefficients, highest power first, of polynomials from 0 to 1 in the time from 0 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class WayPoints:
    """Piecewise polynomial of time through way points; constant before the first and after the last break."""

    #: a `scipy.interpolate.PPoly`, whose last piece is constant and begins at the last way point
    path: Any

    def derivatives(self, t: ArrayLike, order: int) -> tuple[Float64Array, ...]:
        """Return (value, first derivative, ...) up to `order` at t, a tuple of arrays of t's shape. At a break,
        return the derivatives from the right.
        """
        times, start = np.asarray(t, dtype=np.float64), self.path.x[0]
        value, *rates = (self.path(np.maximum(times, start), k) for k in range(order + 1))
        return value, *(np.where(times < start, 0.0, rate) for rate in rates)

    def switches(self, t: Float64Array) -> NDArray[np.bool_]:
        """Return, for each interval between instants t, whether the first or second derivative jumps in it."""
        switched = np.zeros(max(0, t.size - 1), dtype=bool)
        places = np.searchsorted(t, self.path.x[:-1], side="left") - 1
        switched[places[(places >= 0) & (places < switched.size) & self._kinked_breaks()]] = True
        return switched

    def max_abs_derivative(self, order: int) -> float:
        """Return the largest absolute value of the derivative of an order at any time, from the right at breaks."""
        derived = self.path.derivative(order)
        at = np.concatenate((self.path.x[:-1], derived.derivative().roots(extrapolate=False)))
        return float(np.nanmax(np.abs(derived(at))))

    def _kinked_breaks(self) -> NDArray[np.bool_]:
        """Return whether the first or the second derivative jumps at each break; shape (m,)."""
        lengths = np.diff(self.path.x)[:-1]
        kinked = np.zeros(lengths.size + 1, dtype=bool)
        for k in (1, 2):
            coefficients = self.path.derivative(k).c
            terms = coefficients[:, :-1] * lengths ** np.arange(len(coefficients))[::-1, None]
            jumps = coefficients[-1] - np.concatenate(([0.0], terms.sum(axis=0)))
            kinked |= np.abs(jumps) > 1e-9 * np.abs(terms).sum(axis=0).max()  # smaller jumps are rounding
        return kinked


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
    if profile == "trapezoid":
        return _trapezoid_way_points(t, values, speed, acceleration)
    pieces = _spline_pieces(t, values) if profile == "spline" else _profile_pieces(t, values, profile)
    way_points = _with_constant_end(t, pieces, values[-1])
    for k, name, limit in ((1, "speed", speed), (2, "acceleration", acceleration)):
        if profile == "linear" and k == 2 and limit < math.inf:
            raise ArgumentError(name, "no such limit of a linear profile, whose speed jumps", limit)
        largest = way_points.max_abs_derivative(k)
        if largest > limit * (1 + 1e-9):  # a smaller excess is rounding
            expected = f"at least {largest:.6g}, which this profile needs between these points"
            raise ArgumentError(name, expected, limit)
    return way_points


def _profile_pieces(t: Float64Array, values: Float64Array, profile: str) -> Float64Array:
    """Return the coefficients of the polynomials between neighbouring points (t, values), highest power first; shape
    (degree + 1, m - 1).
    """
    unit = np.array(_UNIT_POLYNOMIALS[profile])
    pieces: Float64Array = np.diff(values) * unit[:, None] / np.diff(t) ** np.arange(len(unit))[::-1, None]
    pieces[-1] = values[:-1]
    return pieces


def _spline_pieces(t: Float64Array, values: Float64Array) -> Float64Array:
    """Return the coefficients (6, m - 1), highest power first, of the spline of degree 5 through points (t, values);
    its first and second derivatives are 0 at both ends.
    """
    from scipy.interpolate import PPoly, make_interp_spline

    rest = [(1, 0.0), (2, 0.0)]
    try:
        pieces = PPoly.from_spline(make_interp_spline(t, values, k=5, bc_type=(rest, rest))).c[:, 5:-5]
    except ValueError:  # LinAlgError is one
        step = f"a shortest step of {np.diff(t).min():g} s"
        raise ArgumentError("t", "steps of like size, long enough for a spline profile", step) from None
    pieces[-1], pieces[-3:-1, 0] = values[:-1], 0.0
    return np.asarray(pieces)


def _trapezoid_way_points(t: Float64Array, values: Float64Array, speed: float, acceleration: float) -> WayPoints:
    """Return the WayPoints that stop at each value and between them accelerate, keep a rate and brake, within limits
    of speed and acceleration.
    """
    breaks, coefficients = [t[0]], []
    for i, (start, stop) in enumerate(itertools.pairwise(t)):
        time, way = stop - start, values[i + 1] - values[i]
        ramp = _ramp_time(f"from {start:g} to {stop:g} s", time, abs(way), speed, acceleration)
        rate = way / (time - ramp)
        bend = rate / ramp / 2
        coefficients += [
            [bend, 0.0, values[i]],
            [0.0, rate, values[i] + rate * ramp / 2],
            [-bend, rate, values[i + 1] - rate * ramp / 2],
        ]
        breaks += [start + ramp, stop - ramp, stop]
    return _with_constant_end(np.array(breaks), np.array(coefficients).T, values[-1])


def _with_constant_end(breaks: Float64Array, pieces: Float64Array, last_value: float) -> WayPoints:
    """Return the WayPoints of breaks and polynomials, constant at `last_value` after the last break."""
    from scipy.interpolate import PPoly

    still = np.zeros((len(pieces), 1))
    still[-1] = last_value
    return WayPoints(PPoly(np.concatenate((pieces, still), axis=1), np.append(breaks, breaks[-1] + 1.0)))


def _ramp_time(interval_text: str, duration: float, distance: float, speed: float, acceleration: float) -> float:
    """Return how long [s] a trapezoidal rate rises, and falls: a third of `duration`, or the nearest that the limits
    allow; raise an ArgumentError if they allow none.
    """
    if distance == 0:
        return duration / 3
    longest = min(duration / 2, duration - distance / speed)  # the cruising speed is way / (time - ramp)
    below = duration * duration - 4 * distance / acceleration
    shortest = (duration - math.sqrt(below)) / 2 if below >= 0 else math.inf
    if longest <= 0:
        raise ArgumentError(
            "speed", f"more than {distance / duration:.6g}, which the way {interval_text} needs", speed
        )
    if shortest > longest:
        needed = distance / (longest * (duration - longest))
        expected = f"at least {needed:.6g}, which the way {interval_text} needs"
        raise ArgumentError("acceleration", expected, acceleration)
    return min(max(duration / 3, shortest), longest)
