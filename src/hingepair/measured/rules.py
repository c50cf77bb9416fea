"""What a motion cannot show, fixed by rules: the point of the axis, the sign of (n, psi), psi = 0."""

from __future__ import annotations

from typing import Final

import numpy as np

from hingepair.measured.likelihood import frame
from hingepair.measured.relative_poses import Hinge
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import skew

GAUGES: Final = ("closest_to_R1", "closest_to_R2")


def signed(hinge: Hinge) -> Hinge:
    """The hinge with the sign of its axis by the rule."""
    large = np.abs(hinge.n) >= 0.5 * np.abs(hinge.n).max()
    sign = 1.0 if hinge.n[np.argmax(large)] > 0 else -1.0
    return hinge._replace(n=sign * hinge.n, m=sign * hinge.m)


def in_gauge(hinge: Hinge, gauge: str) -> Hinge:
    """The hinge by that point of its axis which the gauge names."""
    slide = -(hinge.u1 @ hinge.n) if gauge == "closest_to_R1" else -(hinge.u2 @ hinge.m)
    return hinge._replace(u1=hinge.u1 + slide * hinge.n, u2=hinge.u2 + slide * hinge.m)


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
