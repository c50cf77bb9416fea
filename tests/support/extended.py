"""Attitudes in the processor's floats of 64 digits of 2, eleven more than a double has, for many states at once."""

from __future__ import annotations

import numpy as np

from hingepair.bench.truth import skew
from support.exact import matrices_of_quaternions

LONG = np.longdouble


def _turn(axis, angle):
    """The turns (N, 3, 3) about unit axes, (3,) or (N, 3), by angles (N,): I + sin K + 2 sin^2(angle/2) K^2."""
    K, half = skew(np.asarray(axis, LONG)), np.sin(angle / 2)
    return np.eye(3, dtype=LONG) + np.sin(angle)[:, None, None] * K + (2 * half * half)[:, None, None] * (K @ K)


def attitude_of_angles(phi, sequence):
    """The rotations of Euler angles, (N, 3) -> (N, 3, 3)."""
    phi = np.asarray(phi, LONG)
    turns = [_turn(np.eye(3)["XYZ".index(letter.upper())], phi[:, i]) for i, letter in enumerate(sequence)]
    first, second, third = turns if sequence.isupper() else reversed(turns)
    return first @ second @ third


def attitude_of_rotvec(rotvec):
    """The rotations of rotation vectors, (N, 3) -> (N, 3, 3)."""
    vector = np.asarray(rotvec, LONG)
    angle = np.sqrt((vector * vector).sum(axis=-1))
    return _turn(vector / np.where(angle > 0, angle, 1)[:, None], angle)


def attitude_of_quaternion(quat_xyzw):
    """The rotations of quaternions."""
    return matrices_of_quaternions(np.asarray(quat_xyzw, LONG))


def nearest_rotation(matrix):
    """The orthogonal polar factor: Newton's steps X -> (X + X^-T) / 2, X^-T by cofactors."""
    X = np.asarray(matrix, LONG)
    for _ in range(30):
        a, b, c = X[:, 0], X[:, 1], X[:, 2]
        cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
        X = (X + cofactors / (a * cofactors[:, 0]).sum(axis=-1)[:, None, None]) / 2
    return X
