"""Attitudes that are given: quaternions as rotation matrices, and what is wrong with an attitude."""

from __future__ import annotations

import functools
from typing import Any

from hingepair.engine.trace import square_root, where_less
from hingepair.equations import spatial as eq
from hingepair.equations.spatial import Matrix, Scalar


def quaternion_rotation(quat: tuple[Any, ...]) -> Matrix:
    """Return the rotation matrix of a quaternion (w, x, y, z) of any length but zero."""
    scale = _largest_component(quat)
    w, x, y, z = (c / scale for c in quat)
    length = square_root(w * w + x * x + y * y + z * z)
    return eq.quaternion_attitude((w / length, x / length, y / length, z / length))


def rotation_defect(S: Matrix) -> Scalar:
    """Return the largest entry of S S^T - I; 2 for a reflection."""
    *errors, volume = eq.orthonormality_terms(S)
    return where_less(volume, 0.0, 2.0, _largest_component(tuple(errors)))


def zero_quaternion_check(quat: tuple[Any, ...]) -> Scalar:
    """Return 2 for a quaternion of zeros, else 0."""
    size = sum(where_less(c, 0.0, -c, c) for c in quat)
    return where_less(0.0, size, 0.0, where_less(size, 1.0, 2.0, 0.0))


def _largest_component(parts: tuple[Any, ...]) -> Scalar:
    """Return the largest absolute value among the components."""
    return functools.reduce(lambda a, b: where_less(a, b, b, a), (where_less(c, 0.0, -c, c) for c in parts))
