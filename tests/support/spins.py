"""Spins with a closed form: the reference example phi = (3t, t, 5t), and the same turned; nothing of hingepair.

The reference alone flatters whoever integrates Euler angles: they are linear in t there.
"""

from __future__ import annotations

import functools

import mpmath
import numpy as np

from hingepair.bench.truth import DIGITS, exactly, rotation
from support.exact import attitude_of_quaternion, twice_the_odd_part

U = 2.0**-53
RATES = (3, 1, 5)  # of phi


class Spin:
    """A motion S(t) = Q S_ref(t), omega(t) = Q omega_ref(t), alpha its derivative."""

    def __init__(self, quat_xyzw=(0, 0, 0, 1)):
        self.Q = attitude_of_quaternion(np.array([quat_xyzw], dtype=float)).reshape(3, 3)
        self.turn = self.Q.astype(float)

    @property
    def S1_0(self):
        return self.turn

    def omega(self, t):
        x, y, z = (
            3 + 5 * np.sin(t),
            np.cos(3 * t) - 2.5 * np.sin(2 * t) - 2.5 * np.sin(4 * t),
            np.sin(3 * t) + 2.5 * np.cos(4 * t) + 2.5 * np.cos(2 * t),
        )
        return np.stack([x, y, z], axis=-1) @ self.turn.T

    def body_omega(self, t):
        """Omega in the body's own axes: the rates 3, 1, 5 about e_x, e_y, e_z, turned back one by one."""
        x = 3 * np.cos(t) * np.cos(5 * t) + np.sin(5 * t)
        y = np.cos(5 * t) - 3 * np.cos(t) * np.sin(5 * t)
        return np.stack([x, y, 3 * np.sin(t) + 5], axis=-1)

    def alpha(self, t):
        x, y, z = (
            5 * np.cos(t),
            -3 * np.sin(3 * t) - 5 * np.cos(2 * t) - 10 * np.cos(4 * t),
            3 * np.cos(3 * t) - 10 * np.sin(4 * t) - 5 * np.sin(2 * t),
        )
        return np.stack([x, y, z], axis=-1) @ self.turn.T

    def exact(self, t):
        """S at one instant, of DIGITS digits."""
        with mpmath.workdps(DIGITS):
            t = exactly([float(t)])
            turns = (rotation(exactly(e), (k * t, 0 * t, 0 * t)).c0[0] for e, k in zip(np.eye(3), RATES, strict=True))
            return functools.reduce(np.matmul, turns, self.Q)

    def attitudes(self, t):
        """S at some instants as doubles."""
        return np.array([self.exact(one).astype(float) for one in t])

    def error(self, t, S, instants=12):
        """The largest angle [rad] between S and the truth, at a few instants and the last."""
        return max(angle(S[i], self.exact(t[i])) for i in np.linspace(1, len(t) - 1, instants).astype(int))


def angle(S, exact):
    """The angle between two attitudes that are near, to all digits: the antisymmetric part of S^T exact."""
    with mpmath.workdps(DIGITS):
        sine = twice_the_odd_part((exactly(S).T @ exact)[None])[0] / 2
        return float(mpmath.sqrt((sine * sine).sum()))


REFERENCE = Spin()
TURNED = Spin((0.3, -0.2, 0.25, 0.9))
SPINS = {"reference": REFERENCE, "turned": TURNED}
