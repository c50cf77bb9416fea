"""A hinge without its psi = 0, and the rules that fix what a motion cannot show.

These are the point on the axis, the sign of (n, psi), and psi = 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple, TypeAlias

import numpy as np

from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import rotation_vector

_STEP = 1e-5  # rad, m: of derivatives
Results: TypeAlias = tuple[Float64Array, Float64Array, Float64Array, Float64Array]
"""u1, u2, n and home."""
GAUGES: Final = ("closest_to_R1", "closest_to_R2")  # rules that place the hinge point along the axis
RULE_OF_SIGN: Final = "The first component of n that is at least 0.45 times as large as the largest one is positive."
RULE_OF_HOME: Final = (
    "home, the rotation of body 2 relative to body 1 at psi = 0, is the rotation by the smallest angle that aligns "
    "the hinge axis in body 2 with the hinge axis in body 1, unless both axes are nearly opposite."
)


class Hinge(NamedTuple):
    """The axis of a hinge and a point on it, in the axes of both bodies, without the direction of psi = 0."""

    first: Float64Array  # frame along the hinge, in body 1's axes: orthonormal columns, the last is n
    second: Float64Array  # likewise in body 2's axes; the last column is m = C^T n
    u1: Float64Array  # hinge point, body 1's axes [m]
    u2: Float64Array  # hinge point, body 2's axes [m]

    @classmethod
    def along(cls, n: Float64Array, m: Float64Array, u1: Float64Array, u2: Float64Array) -> Hinge:
        """Return the hinge of its unit axes n, in body 1's axes, and m, in body 2's axes."""
        return cls(frame(n), frame(m), u1, u2)

    @classmethod
    def around(cls, n: Float64Array, centre: Float64Array, radius: float) -> Hinge:
        """Return the hinge about whose unit axis n a point of body 2, its reference point, moves on a circle.

        Both frames are one, since home is the identity; its first column points from `centre` (body 1's axes) to the
        point at psi = 0, as a coordinate axis does.
        """
        across = np.eye(3)[first_axis_across(n)]
        start = across - (across @ n) * n
        start = start / np.linalg.norm(start)
        axes = np.stack((start, np.cross(n, start), n), axis=1)
        return cls(axes, axes, centre, -radius * start)

    @property
    def n(self) -> Float64Array:
        """Axis in body 1's axes, a unit vector (3,)."""
        return self.first[:, 2]

    @property
    def m(self) -> Float64Array:
        """Axis in body 2's axes, a unit vector (3,)."""
        return self.second[:, 2]

    def signed(self) -> Hinge:
        """Return the hinge with the sign of its axis that `sign_of` chooses."""
        sign = sign_of(self.n)
        return self.along(sign * self.n, sign * self.m, self.u1, self.u2)

    def balanced(self) -> Hinge:
        """Return the hinge whose point is equally far along the axis from the reference points of both bodies."""
        return self._with_shifted_point(-float(self.u1 @ self.n + self.u2 @ self.m) / 2)

    def in_gauge(self, gauge: str) -> Hinge:
        """Return the hinge with the point of its axis that the gauge names, "closest_to_R1" or "closest_to_R2"."""
        return self._with_shifted_point(-float(self.u1 @ self.n if gauge == "closest_to_R1" else self.u2 @ self.m))

    def results(self, gauge: str) -> Results:
        """Return u1, u2, n and home."""
        there = self.in_gauge(gauge)
        return there.u1, there.u2, there.n, home_of(there)

    def _with_shifted_point(self, slide: float) -> Hinge:
        return self._replace(u1=self.u1 + slide * self.n, u2=self.u2 + slide * self.m)

    def moved(self, step: Float64Array) -> Hinge:
        """Return the hinge after a step of nine parameters: tilts of n (2) and of m (2) [rad] towards the first two
        columns of `first` and `second`, shifts of u1 (3) and of u2 (2) along these columns [m]. Shifts along the axis
        count once, since only u1 - u2 is seen along it.
        """
        u1, u2 = self.u1 + self.first @ step[4:7], self.u2 + self.second @ (step[7], step[8], 0.0)
        return Hinge(tilted(self.first, step[:2]), tilted(self.second, step[2:4]), u1, u2)


def sign_of(n: Float64Array) -> float:
    """Return the sign of the first component of n of at least 0.45 times the largest size."""
    # No ratio of two small numbers, so that noise does not decide for an axis such as (-1, 2, 0).
    return 1.0 if n[np.argmax(np.abs(n) >= 0.45 * np.abs(n).max())] > 0 else -1.0


def frame(axis: Float64Array) -> Float64Array:
    """Return three orthonormal columns, right-handed, the last of which is the unit vector `axis`."""
    x, y, z = axis.tolist()
    if abs(x) <= min(abs(y), abs(z)):
        first = (0.0, z, -y)
    elif abs(y) <= abs(z):
        first = (-z, 0.0, x)
    else:
        first = (y, -x, 0.0)
    size = math.hypot(*first)
    a, b, c = (component / size for component in first)
    return np.array(((a, y * c - z * b, x), (b, z * a - x * c, y), (c, x * b - y * a, z)))


def tilted(axes: Float64Array, step: Float64Array) -> Float64Array:
    """Return a frame (3, 3) turned by the least angle so that its last column tilts towards the first and the second
    by `step` [rad].
    """
    a, b = step.tolist()  # Rodrigues' formula of the rotation vector (-b, a, 0)
    angle = math.hypot(a, b)
    s = math.sin(angle) / angle if angle else 1.0
    k = 0.5 * (math.sin(angle / 2) / (angle / 2)) ** 2 if angle else 0.5
    turn = ((1 - k * a * a, -k * a * b, s * a), (-k * a * b, 1 - k * b * b, s * b), (-s * a, -s * b, math.cos(angle)))
    return np.asarray(axes @ np.array(turn))


def first_axis_across(n: Float64Array) -> int:
    """Return the index of the first component of the unit vector n whose size is below 0.65; there always is one.

    It fixes the direction of psi = 0 for a point, and the axis of the half turn that home begins with; after that
    half turn, axes that were opposite are less than a right angle apart.
    """
    return int(np.argmax(np.abs(n) < 0.65))


def home_of(hinge: Hinge) -> Float64Array:
    """Return `home` (3, 3), the rotation of body 2 relative to body 1 at psi = 0, by the smallest angle that turns m
    into n. Where these are nearly opposite, noise would choose among such rotations; a half turn about a coordinate
    axis of body 2 comes first.
    """
    before = _half_turn_before(hinge)
    return _shortest_turn(before @ hinge.m, hinge.n) @ before


def _half_turn_before(hinge: Hinge) -> Float64Array:
    """Return the half turn (3, 3) that home begins with, the identity unless the axes are nearly opposite."""
    if hinge.n @ hinge.m > -0.9:
        return np.eye(3)
    turn = -np.eye(3)
    across = first_axis_across(hinge.n)
    turn[across, across] = 1.0
    return turn


def _shortest_turn(m: Float64Array, n: Float64Array) -> Float64Array:
    """Return the rotation (3, 3) by the smallest angle that turns the unit vector m into n, unless opposite."""
    half = m + n
    once = 2 * np.outer(half, half) / (half @ half) - np.eye(3)  # half a turn about the middle
    return np.asarray(once @ (2 * np.outer(m, m) - np.eye(3)))  # after half a turn about m


def slopes(of: Callable[[Float64Array], Float64Array], count: int) -> Float64Array:
    """Return the derivatives of `of` by `count` numbers at 0, by central differences; the last axis is theirs."""
    ends = [(of(step), of(-step)) for step in _STEP * np.eye(count)]
    return np.stack([high - low for high, low in ends], axis=-1) / (2 * _STEP)


def result_derivatives(results: Callable[[Float64Array], Results], count: int) -> Float64Array:
    """Return the derivatives of u1, u2, n and the rotation vector of home by a step of `count` parameters, of a
    function of the step that returns u1, u2, n and home; (12, count).
    """
    back = results(np.zeros(count))[3].T

    def row(step: Float64Array) -> Float64Array:
        *vectors, home = results(step)
        return np.concatenate((*vectors, rotation_vector(home @ back)))

    return slopes(row, count)


def home_angle(hinge: Hinge, home: Float64Array) -> float:
    """Return the angle [rad] about n at psi = 0 from the first column of `first`, in body 1, to that of `second`, in
    body 2.
    """
    first, second = hinge.first, home @ hinge.second
    return float(np.arctan2(first[:, 1] @ second[:, 0], first[:, 0] @ second[:, 0]))
