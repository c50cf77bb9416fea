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
from typing import Final

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import Float64Array

PROFILES: Final = ("linear", "trapezoid", "cubic", "quintic", "spline")
"""Names of the curves from one way point to the next."""
MAX_WAY_POINTS: Final = 200
"""Largest number of way points of one coordinate."""
_UNIT_POLYNOMIALS: Final = {
    "linear": (0, 1),
    "cubic": (0, 0, 3, -2),
    "quintic": (0, 0, 0, 10, -15, 6),
}
"""Coefficients, lowest power first, of polynomials from 0 to 1 in the time from 0 to 1."""


@dataclass(frozen=True, slots=True, eq=False)
class WayPoints:
    """Piecewise polynomial of time through way points; constant before the first and after the last break."""

    #: where one polynomial ends and the next begins; shape (m,) s
    breaks: Float64Array
    #: of the polynomials, in the time since a polynomial's beginning, lowest power first; shape (m, degree + 1), the
    #: last one constant
    coefficients: Float64Array

    def derivatives(self, t: ArrayLike, order: int) -> tuple[Float64Array, ...]:
        """Return (value, first derivative, ...) up to `order` at t, a tuple of arrays of t's shape. At a break,
        return the derivatives from the right.
        """
        times = np.asarray(t, dtype=np.float64)
        piece = np.searchsorted(self.breaks, times, side="right") - 1
        index = np.maximum(piece, 0)
        since = np.maximum(times, self.breaks[0]) - self.breaks[index]
        derivatives = [_polynomials(_derived(self.coefficients, k)[index], since) for k in range(order + 1)]
        return derivatives[0], *(np.where(piece >= 0, derivative, 0.0) for derivative in derivatives[1:])

    def switches(self, t: Float64Array) -> NDArray[np.bool_]:
        """Return, for each interval between instants t, whether the first or second derivative jumps in it."""
        switched = np.zeros(max(0, t.size - 1), dtype=bool)
        places = np.searchsorted(t, self.breaks, side="left") - 1
        switched[places[(places >= 0) & (places < switched.size) & self._kinked_breaks()]] = True
        return switched

    def max_abs_derivative(self, order: int) -> float:
        """Return the largest absolute value of the derivative of an order (0: the function) at any time."""
        derived, largest = _derived(self.coefficients, order), 0.0
        for polynomial_coefficients, length in zip(derived, np.diff(self.breaks), strict=False):
            slope = np.polynomial.Polynomial(polynomial_coefficients).deriv()
            roots = slope.roots() if np.any(slope.coef) else np.empty(0)
            is_real = np.abs(roots.imag) < 1e-9 * length  # smaller imaginary parts are rounding
            inner = roots.real[is_real & (roots.real > 0) & (roots.real < length)]
            at = np.concatenate(([0.0, length], inner))
            largest = max(
                largest,
                float(
                    np.abs(
                        _polynomials(
                            np.broadcast_to(polynomial_coefficients, (at.size, polynomial_coefficients.size)), at
                        )
                    ).max()
                ),
            )
        return largest

    def _kinked_breaks(self) -> NDArray[np.bool_]:
        """Return whether the first or the second derivative jumps at each break; shape (m,)."""
        kinked = np.zeros(self.breaks.size, dtype=bool)
        lengths = np.diff(self.breaks)
        for k in (1, 2):
            derived = _derived(self.coefficients, k)
            after, before = derived[:, 0], np.concatenate(([0.0], _polynomials(derived[:-1], lengths)))
            most = (np.abs(derived[:-1]) * lengths[:, None] ** np.arange(derived.shape[1])).sum(axis=1).max()
            kinked |= np.abs(after - before) > 1e-9 * most  # smaller jumps are rounding
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
    pieces = (
        _spline_coefficients(t, values)
        if profile == "spline"
        else _profile_coefficients(t, values, _UNIT_POLYNOMIALS[profile])
    )
    way_points = _with_constant_end(t, pieces, values[-1])
    for k, name, limit in ((1, "speed", speed), (2, "acceleration", acceleration)):
        if profile == "linear" and k == 2 and limit < math.inf:
            raise ArgumentError(name, "no such limit of a linear profile, whose speed jumps", limit)
        largest = way_points.max_abs_derivative(k)
        if largest > limit * (1 + 1e-9):  # a smaller excess is rounding
            expected = f"at least {largest:.6g}, which this profile needs between these points"
            raise ArgumentError(name, expected, limit)
    return way_points


def _profile_coefficients(
    t: Float64Array, values: Float64Array, unit_coefficients: tuple[float, ...]
) -> Float64Array:
    """Return the coefficients of the polynomials between neighbouring points (t, values), lowest power first; shape
    (m - 1, degree + 1).
    """
    powers = np.diff(t)[:, None] ** np.arange(len(unit_coefficients))
    coefficients: Float64Array = np.diff(values)[:, None] * np.array(unit_coefficients) / powers
    coefficients[:, 0] = values[:-1]
    return coefficients


def _spline_coefficients(t: Float64Array, values: Float64Array) -> Float64Array:
    """Return the coefficients (m - 1, 6), lowest power first, of the spline of degree 5 through points (t, values);
    its first and second derivatives are 0 at both ends.
    """
    h, m, size = np.diff(t), len(t) - 1, 6
    ends = [_polynomials(_derived(np.eye(size), k), np.array([[0.0], [1.0]])) for k in range(size - 1)]

    def derivative_row(piece: int, order: int, end: int) -> Float64Array:
        """Return the row of the linear system for a derivative (order 0: the value) of a piece at its start (`end` 0)
        or its end (1).
        """
        equation = np.zeros((m, size))
        equation[piece] = ends[order][end]
        return equation.ravel()

    rows = [derivative_row(i, 0, end) for i in range(m) for end in (0, 1)]
    rows += [
        derivative_row(i, k, 1) - (h[i] / h[i + 1]) ** k * derivative_row(i + 1, k, 0)
        for i in range(m - 1)
        for k in (1, 2, 3, 4)
    ]
    rows += [derivative_row(i, k, end) for i, end in ((0, 0), (m - 1, 1)) for k in (1, 2)]
    right = np.zeros(m * size)
    right[: 2 * m] = np.repeat(values, 2)[1:-1]
    solved = np.linalg.solve(np.array(rows), right).reshape(m, size)
    solved[:, 0], solved[0, 1:3] = values[:-1], 0.0
    return solved / h[:, None] ** np.arange(size)


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
            [values[i], 0.0, bend],
            [values[i] + rate * ramp / 2, rate, 0.0],
            [values[i + 1] - rate * ramp / 2, rate, -bend],
        ]
        breaks += [start + ramp, stop - ramp, stop]
    return _with_constant_end(np.array(breaks), np.array(coefficients), values[-1])


def _with_constant_end(breaks: Float64Array, coefficients: Float64Array, last_value: float) -> WayPoints:
    """Return the WayPoints of breaks and coefficients, constant at `last_value` after the last break."""
    still = np.zeros((1, coefficients.shape[1]))
    still[0, 0] = last_value
    return WayPoints(breaks, np.concatenate((coefficients, still)))


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


def _derived(coefficients: Float64Array, k: int) -> Float64Array:
    """Return the coefficients (last axis, lowest power first) of the k-th derivatives of polynomials."""
    return np.asarray(polynomial.polyder(coefficients, k, axis=-1))


def _polynomials(coefficients: Float64Array, x: Float64Array) -> Float64Array:
    """Return the value of each polynomial at the entry of x that belongs to it, an array of x's shape (...)."""
    return np.asarray(polynomial.polyval(x, np.moveaxis(coefficients, -1, 0), tensor=False))
