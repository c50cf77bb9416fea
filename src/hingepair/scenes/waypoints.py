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
"""Names of the curves from one waypoint to the next."""
MAX_POINTS: Final = 200
"""Largest number of waypoints of one coordinate."""
_PROFILE_POLYNOMIALS: Final = {"linear": (0, 1), "cubic": (0, 0, 3, -2), "quintic": (0, 0, 0, 10, -15, 6)}
"""Coefficients of the way from 0 to 1 in the time from 0 to 1."""
_WAY_POINT_TOLERANCE: Final = 1e-9  # relative: smaller jumps and excesses are rounding


@dataclass(frozen=True, slots=True, eq=False)
class WayPoints:
    """A function of time made of polynomials, constant before the first and after the last.

    Attributes:
        breaks: where one polynomial ends and the next begins; shape (m,) s.
        coefficients: of the polynomials, in the time since a polynomial's beginning, lowest power first; shape
            (m, degree + 1), the last one constant.
    """

    breaks: Float64Array
    coefficients: Float64Array

    def derivatives(self, t: ArrayLike, order: int) -> tuple[Float64Array, ...]:
        """Return the value and its derivatives up to an order, those at breaks from the right; t's shape each."""
        times = np.asarray(t, dtype=np.float64)
        piece = np.searchsorted(self.breaks, times, side="right") - 1
        own = np.maximum(piece, 0)
        since = np.maximum(times, self.breaks[0]) - self.breaks[own]
        found = [_polynomials(_derived(self.coefficients, k)[own], since) for k in range(order + 1)]
        return found[0], *(np.where(piece >= 0, derivative, 0.0) for derivative in found[1:])

    def switches(self, t: Float64Array) -> NDArray[np.bool_]:
        """Return whether a kink or a jump lies between neighbouring instants; shape (N - 1,)."""
        switched = np.zeros(max(0, t.size - 1), dtype=bool)
        places = np.searchsorted(t, self.breaks, side="left") - 1
        switched[places[(places >= 0) & (places < switched.size) & self._kinked()]] = True
        return switched

    def largest(self, k: int) -> float:
        """Return the largest absolute value of the k-th derivative."""
        derived, largest = _derived(self.coefficients, k), 0.0
        for own, length in zip(derived, np.diff(self.breaks), strict=False):
            slope = np.polynomial.Polynomial(own).deriv()
            roots = slope.roots() if np.any(slope.coef) else np.empty(0)
            inner = roots.real[
                (np.abs(roots.imag) < _WAY_POINT_TOLERANCE * length) & (roots.real > 0) & (roots.real < length)
            ]
            at = np.concatenate(([0.0, length], inner))
            largest = max(largest, float(np.abs(_polynomials(np.broadcast_to(own, (at.size, own.size)), at)).max()))
        return largest

    def _kinked(self) -> NDArray[np.bool_]:
        """Return which breaks are kinks or jumps of the value or of its first two derivatives; shape (m,)."""
        kinked = np.zeros(self.breaks.size, dtype=bool)
        lengths = np.diff(self.breaks)
        for k in (1, 2):
            derived = _derived(self.coefficients, k)
            after, before = derived[:, 0], np.concatenate(([0.0], _polynomials(derived[:-1], lengths)))
            most = (np.abs(derived[:-1]) * lengths[:, None] ** np.arange(derived.shape[1])).sum(axis=1).max()
            kinked |= np.abs(after - before) > _WAY_POINT_TOLERANCE * most
        return kinked


def through(
    t: Float64Array, values: Float64Array, profile: str, speed: float = math.inf, acceleration: float = math.inf
) -> WayPoints:
    """Return the function through values at increasing instants, two at least; refuse limits that it cannot keep.

    >>> position, speed = through(np.array([0.0, 2.0]), np.array([0.0, 4.0]), "quintic").derivatives(1.0, 1)
    >>> round(float(position), 9), round(float(speed), 9)
    (2.0, 3.75)
    """
    if profile == "trapezoid":
        return _trapezoids(t, values, speed, acceleration)
    pieces = (
        _spline(t, values) if profile == "spline" else _profile_coefficients(t, values, _PROFILE_POLYNOMIALS[profile])
    )
    found = _made(t, pieces, values[-1])
    for k, name, limit in ((1, "speed", speed), (2, "acceleration", acceleration)):
        if profile == "linear" and k == 2 and limit < math.inf:
            raise ArgumentError(name, "no such limit of a linear profile, whose speed jumps", limit)
        largest = found.largest(k)
        if largest > limit * (1 + _WAY_POINT_TOLERANCE):
            expected = f"at least {largest:.6g}, which this profile needs between these points"
            raise ArgumentError(name, expected, limit)
    return found


def _profile_coefficients(t: Float64Array, values: Float64Array, shape: tuple[float, ...]) -> Float64Array:
    """Return coefficients of polynomials that go from point to point, each in one shape of the way from 0 to 1."""
    powers = np.diff(t)[:, None] ** np.arange(len(shape))
    found: Float64Array = np.diff(values)[:, None] * np.array(shape) / powers
    found[:, 0] = values[:-1]
    return found


def _spline(t: Float64Array, values: Float64Array) -> Float64Array:
    """Return coefficients of the spline of degree 5 through points, without rate or acceleration at both ends."""
    h, m, size = np.diff(t), len(t) - 1, 6
    ends = [_polynomials(_derived(np.eye(size), k), np.array([[0.0], [1.0]])) for k in range(size - 1)]

    def row(i: int, k: int, end: int) -> Float64Array:
        """Return the row of the k-th derivative at one end of a piece, in x = (time since t[i]) / h[i]."""
        found = np.zeros((m, size))
        found[i] = ends[k][end]
        return found.ravel()

    rows = [row(i, 0, end) for i in range(m) for end in (0, 1)]
    rows += [row(i, k, 1) - (h[i] / h[i + 1]) ** k * row(i + 1, k, 0) for i in range(m - 1) for k in (1, 2, 3, 4)]
    rows += [row(i, k, end) for i, end in ((0, 0), (m - 1, 1)) for k in (1, 2)]
    right = np.zeros(m * size)
    right[: 2 * m] = np.repeat(values, 2)[1:-1]
    solved = np.linalg.solve(np.array(rows), right).reshape(m, size)
    solved[:, 0], solved[0, 1:3] = values[:-1], 0.0
    return solved / h[:, None] ** np.arange(size)


def _trapezoids(t: Float64Array, values: Float64Array, speed: float, acceleration: float) -> WayPoints:
    """Return the function that goes from rest to rest between neighbours: it accelerates, cruises and brakes."""
    breaks, coefficients = [t[0]], []
    for i, (start, stop) in enumerate(itertools.pairwise(t)):
        time, way = stop - start, values[i + 1] - values[i]
        ramp = _ramp(f"from {start:g} to {stop:g} s", time, abs(way), speed, acceleration)
        rate = way / (time - ramp)
        bend = rate / ramp / 2
        coefficients += [
            [values[i], 0.0, bend],
            [values[i] + rate * ramp / 2, rate, 0.0],
            [values[i + 1] - rate * ramp / 2, rate, -bend],
        ]
        breaks += [start + ramp, stop - ramp, stop]
    return _made(np.array(breaks), np.array(coefficients), values[-1])


def _made(breaks: Float64Array, coefficients: Float64Array, last: float) -> WayPoints:
    """Return the function of these polynomials that stays at its last value."""
    still = np.zeros((1, coefficients.shape[1]))
    still[0, 0] = last
    return WayPoints(breaks, np.concatenate((coefficients, still)))


def _ramp(where: str, time: float, way: float, speed: float, acceleration: float) -> float:
    """Return the time to accelerate, and to brake [s]: a third of the time where the limits allow it."""
    if way == 0:
        return time / 3
    longest = min(time / 2, time - way / speed)  # the cruising speed is way / (time - ramp)
    below = time * time - 4 * way / acceleration
    shortest = (time - math.sqrt(below)) / 2 if below >= 0 else math.inf
    if longest <= 0:
        raise ArgumentError("speed", f"more than {way / time:.6g}, which the way {where} needs", speed)
    if shortest > longest:
        needed = way / (longest * (time - longest))
        expected = f"at least {needed:.6g}, which the way {where} needs"
        raise ArgumentError("acceleration", expected, acceleration)
    return min(max(time / 3, shortest), longest)


def _derived(coefficients: Float64Array, k: int) -> Float64Array:
    """Return coefficients of the k-th derivative of polynomials."""
    return np.asarray(polynomial.polyder(coefficients, k, axis=-1))


def _polynomials(coefficients: Float64Array, x: Float64Array) -> Float64Array:
    """Return the value of each polynomial at its own x; shapes (..., degree + 1) and (...)."""
    return np.asarray(polynomial.polyval(x, np.moveaxis(coefficients, -1, 0), tensor=False))
