"""Attitudes in the processor's floats of 64 digits of 2, eleven more than a double has, for many states at once."""

from __future__ import annotations

import numpy as np

from hingepair.bench.truth import skew

LONG = np.longdouble


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
