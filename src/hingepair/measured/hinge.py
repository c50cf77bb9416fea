"""A hinge without its psi = 0, and the rules that fix what a motion cannot show.

These are the point of the axis, the sign of (n, psi), and psi = 0.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import skew

GAUGES: Final = ("closest_to_R1", "closest_to_R2")


class Hinge(NamedTuple):
    """Two lines, one in either body, and where they meet."""

    n: Float64Array  # axis in body 1's axes, unit
    m: Float64Array  # axis in body 2's axes, unit: C^T n
    u1: Float64Array  # hinge point, body 1's axes [m]
    u2: Float64Array  # hinge point, body 2's axes [m]

    def signed(self) -> Hinge:
        """The hinge with the sign of its axis by the rule."""
        sign = sign_of(self.n)
        return self._replace(n=sign * self.n, m=sign * self.m)

    def balanced(self) -> Hinge:
        """The hinge by that point of its axis which is as near to one body as to the other."""
        return self._slid(-float(self.u1 @ self.n + self.u2 @ self.m) / 2)

    def in_gauge(self, gauge: str) -> Hinge:
        """The hinge by that point of its axis which the gauge names."""
        return self._slid(-float(self.u1 @ self.n if gauge == "closest_to_R1" else self.u2 @ self.m))

    def _slid(self, slide: float) -> Hinge:
        return self._replace(u1=self.u1 + slide * self.n, u2=self.u2 + slide * self.m)

    def moved(self, step: Float64Array) -> Hinge:
        """The hinge after a step of the nine parameters of the fit, in the axes of `frame`.

        Turns of n (2) and m (2), across; u1 (3); u2 across m (2): along the axis only u1 - u2 is seen.
        """
        u1, u2 = self.u1 + frame(self.n) @ step[4:7], self.u2 + frame(self.m) @ (step[7], step[8], 0.0)
        return Hinge(turned(self.n, step[:2]), turned(self.m, step[2:4]), u1, u2)


def sign_of(n: Float64Array) -> float:
    """Of the components that are at least half as large as the largest, the sign of the first."""
    return 1.0 if n[np.argmax(np.abs(n) >= 0.5 * np.abs(n).max())] > 0 else -1.0


def frame(axis: Float64Array) -> Float64Array:
    """Axes of which the third is along a unit vector, as columns."""
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


def turned(axis: Float64Array, step: ArrayLike) -> Float64Array:
    """A unit vector after a step across it, in the axes of `frame`."""
    there = frame(axis) @ np.append(step, 1.0)
    return np.asarray(there / np.linalg.norm(there))


def shortest_turn(m: Float64Array, n: Float64Array) -> Float64Array:
    """The rotation by the least angle that takes one unit vector to another: twice a reflection."""
    half = m + n
    if half @ half < 1e-20:
        half = frame(n)[:, 0]
        return 2 * np.outer(half, half) - np.eye(3)
    once = 2 * np.outer(half, half) / (half @ half) - np.eye(3)  # half a turn about the middle
    return np.asarray(once @ (2 * np.outer(m, m) - np.eye(3)))  # after half a turn about m


def derivatives(hinge: Hinge, home: Float64Array, gauge: str) -> Float64Array:
    """Of u1, u2, n and home's rotation vector by the parameters of the fit; (12, 9).

    The rotation d of home by the short way from m to n has `d x n` as its change asks for; about n it turns so that
    home's axis stays across m + n.
    """
    n, m, u1, u2 = hinge
    first, second = frame(n), frame(m)
    dn, dm, du1, du2 = np.zeros((4, 3, 9))
    dn[:, :2], dm[:, 2:4], du1[:, 4:7], du2[:, 7:] = first[:, :2], second[:, :2], first, second[:, :2]
    slide = -(n @ du1 + u1 @ dn) if gauge == "closest_to_R1" else -(m @ du2 + u2 @ dm)
    to_n, from_m = skew(n) @ dn, -skew(n) @ home @ dm
    about = m @ (from_m - to_n) / max(float(1 + m @ n), 1e-12)
    rows = (du1 + np.outer(n, slide), du2 + np.outer(m, slide), dn, to_n + from_m + np.outer(n, about))
    return np.concatenate(rows)


def offset(hinge: Hinge, home: Float64Array) -> float:
    """The angle about the axis from body 1's frame to that of body 2, at psi = 0."""
    first, second = frame(hinge.n), home @ frame(hinge.m)
    return float(np.arctan2(first[:, 1] @ second[:, 0], first[:, 0] @ second[:, 0]))
