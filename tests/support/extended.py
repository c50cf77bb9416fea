"""A second oracle, for millions of states: the definitions of `reference` in the processor's 64-bit-mantissa floats.

Eleven bits more than a double: errors in units of 2^-53 come out to about 0.02, thousands of times as fast as with 60
digits. The test of this oracle is the other one.
"""

from __future__ import annotations

from functools import cached_property
from typing import ClassVar

import numpy as np

from hingepair.bench.truth import euler_scales, skew

LONG = np.longdouble
WIDE = np.finfo(LONG).nmant >= 63


class Extended:
    """The outputs for coordinates of shape (N, 7), each found when it is asked for.

    pair = (u1, u2, n, home), each of one pair or of N, home of one. Inside, components come first and samples last.
    What body 2 holds is turned about n, and all that body 1 holds about z, y and x; angular velocities are added up
    on the way.
    """

    def __init__(self, pair, q, qd, qdd):
        self.scales = euler_scales(pair, *(np.asarray(c, float) for c in (q, qd, qdd)))
        self.q, self.qd, self.qdd = (np.array(np.transpose(c), LONG, order="C") for c in (q, qd, qdd))
        self.u1, self.u2, n = (np.array(np.atleast_2d(c).T, LONG, order="C") for c in pair[:3])
        self.home = np.asarray(np.eye(3) if pair[3] is None else pair[3], LONG)[..., None]
        angles = [(self.q[i], self.qd[i], self.qdd[i] / 2) for i in range(3, 7)]
        self.turns = [_turn(axis, *angles[axis]) for axis in (2, 1, 0)]
        self.hinge = _turn(n / np.sqrt((n * n).sum(axis=0)), *angles[3])
        self.values = {}

    @cached_property
    def d(self):
        still = np.zeros((3, 1), LONG)
        arm = _turned([(self.home * self.u2).sum(axis=1), still, still], [self.hinge])
        return _turned([self.u1 - arm[0], -arm[1], -arm[2]], self.turns)

    @cached_property
    def turning1(self):
        return _turning(self.turns)

    @cached_property
    def turning2(self):
        return _turning([self.hinge, *self.turns])

    WAYS: ClassVar = {
        "S1": lambda own: _turned([np.eye(3, dtype=LONG)[..., None]], own.turns)[0],
        "S2": lambda own: _turned([own.home], [own.hinge, *own.turns])[0],
        "d": lambda own: own.d[0],
        "R2": lambda own: own.q[:3] + own.d[0],
        "v2": lambda own: own.qd[:3] + own.d[1],
        "a2": lambda own: own.qdd[:3] + 2 * own.d[2],
        "omega1": lambda own: own.turning1[0],
        "alpha1": lambda own: own.turning1[1],
        "omega2": lambda own: own.turning2[0],
        "alpha2": lambda own: own.turning2[1],
    }

    def value(self, name):
        """An output, longdouble (N, ...); computed once."""
        if name not in self.values:
            self.values[name] = np.moveaxis(self.WAYS[name](self), -1, 0)
        return self.values[name]

    def errors(self, name, got):
        """The largest component's error of each sample in units of u * scale; inf where got is not finite."""
        unit = 2.0**-24 if got.dtype == np.float32 else 2.0**-53
        gap = abs(np.asarray(got, LONG) - self.value(name)).reshape(len(got), -1).max(axis=-1)
        scale = unit * np.asarray(self.scales[name], LONG)
        ratio = np.where(gap == 0, 0, gap / np.where(scale > 0, scale, np.finfo(LONG).tiny))
        return np.where(np.isfinite(ratio), ratio, np.inf).astype(float)


def _turn(axis, f0, f1=0, f2=0):
    """A turn by the angle f0 + f1 t + f2 t^2 about the axis of a number, or along a unit vector (3, N).

    The axis, the series of the angle's sine and of 1 - cosine, and of the angular velocity.
    """
    s, half = np.sin(f0), np.sin(f0 / 2)
    versine = 2 * half * half
    c = 1 - versine
    unit = np.eye(3, dtype=LONG)[:, axis, None] if isinstance(axis, int) else axis
    sine = s, c * f1, c * f2 - s * f1 * f1 / 2
    return axis, sine, (versine, s * f1, s * f2 + c * f1 * f1 / 2), (unit * f1, unit * (2 * f2))


def _turned(vector, turns):
    """The coefficients of a series of vectors, as many as are given, after the turns, one after the other."""
    for axis, sine, versine, _ in turns:
        across = [_cross(axis, v) for v in vector]
        twice = [_cross(axis, v) for v in across]
        parts = vector, _product(sine, across), _product(versine, twice)
        vector = [v + x + y for v, x, y in zip(*parts, strict=True)]
    return vector


def _turning(turns):
    """Angular velocity and acceleration of what is turned so."""
    found = [np.zeros((3, 1), LONG)] * 2
    for turn in turns:
        found = [v + w for v, w in zip(_turned(found, [turn]), turn[-1], strict=True)]
    return found


def _cross(axis, v):
    """Axis x v."""
    if isinstance(axis, int):
        found = np.zeros_like(v)
        found[axis - 2], found[axis - 1] = -v[axis - 1], v[axis - 2]
        return found
    a = axis[:, None] if v.ndim > axis.ndim else axis
    return np.stack(np.broadcast_arrays(*(a[i - 2] * v[i - 1] - a[i - 1] * v[i - 2] for i in range(3))))


def _product(a, b):
    """Of two series, as far as the second goes."""
    return [sum(a[i] * b[k - i] for i in range(k + 1)) for k in range(len(b))]


def attitude_of_angles(phi, sequence):
    """The rotations of Euler angles, (N, 3) -> (N, 3, 3)."""
    turns = [_turn("XYZ".index(letter.upper()), np.asarray(phi[:, i], LONG)) for i, letter in enumerate(sequence)]
    return _attitude(reversed(turns) if sequence.isupper() else turns)


def attitude_of_rotvec(rotvec):
    """The rotations of rotation vectors, (N, 3) -> (N, 3, 3)."""
    vector = np.asarray(rotvec, LONG).T
    angle = np.sqrt((vector * vector).sum(axis=0))
    return _attitude([_turn(vector / np.where(angle > 0, angle, 1), angle)])


def _attitude(turns):
    return np.moveaxis(_turned([np.eye(3, dtype=LONG)[..., None]], turns)[0], -1, 0)


def attitude_of_quaternion(quat_xyzw):
    """The rotations of quaternions: w^2 - v.v + 2 v v^T + 2 w [v]x, of the unit one."""
    quat = np.asarray(quat_xyzw, LONG)
    quat = quat / np.sqrt((quat * quat).sum(axis=-1, keepdims=True))
    v, w = quat[:, :3], quat[:, 3][:, None, None]
    square = (v * v).sum(axis=-1)[:, None, None]
    return (w * w - square) * np.eye(3, dtype=LONG) + 2 * v[:, :, None] * v[:, None, :] + 2 * w * skew(v)


def nearest_rotation(matrix):
    """The orthogonal polar factor: Newton's steps X -> (X + X^-T) / 2, X^-T by cofactors."""
    X = np.asarray(matrix, LONG)
    for _ in range(30):
        a, b, c = X[:, 0], X[:, 1], X[:, 2]
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
        X = (X + cofactors / (a * cofactors[:, 0]).sum(axis=-1)[:, None, None]) / 2
    return X
