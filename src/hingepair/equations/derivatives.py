"""The equations differentiated by what they depend on: by velocities (E2, E8), by coordinates, by u1, u2, n and psi.

Plain arithmetic on tuples, as in `equations`. A matrix is a tuple of its entries, row by row; `turn_axes` are the
three axes that body 1 turns about: the columns of J (E4), or the world's axes where its velocity is omega1 itself.
"""

from __future__ import annotations

from typing import TypeAlias

from hingepair.equations import spatial as eq
from hingepair.equations.spatial import ZERO_VECTOR, Scalar, Vector

Entries: TypeAlias = tuple[Scalar, ...]
Axes: TypeAlias = tuple[Vector, Vector, Vector]

WORLD_UNIT_VECTORS: Axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Unit vectors along the world's axes."""


def matrix_from_columns(*columns: Entries) -> Entries:
    """Return the matrix with these columns, each a tuple of numbers, as a flat tuple row by row."""
    return tuple(entry for row in zip(*columns, strict=True) for entry in row)


def jacobian(turn_axes: Axes, d: Vector, r2: Vector, axis: Vector) -> Entries:
    """Return the Jacobian of (v2, omega2) with respect to v1, the rates of body 1's rotations about three axes
    (turn_axes), and psi': a 6 x 7 matrix as a flat tuple row by row. d = R2 - R1, r2 = S2 u2, and axis = S1 n; all
    are in world axes.

    Where turn_axes are the world's axes, the three rates are omega1 (E8, E2): v2 = v1 + omega1 x d + (r2 x S1 n) psi'
    and omega2 = omega1 + S1 n psi', with d = r1 - r2.
    """
    moved = [(*unit, *ZERO_VECTOR) for unit in WORLD_UNIT_VECTORS]
    turned = [(*eq.cross(turn, d), *turn) for turn in turn_axes]
    return matrix_from_columns(*moved, *turned, (*eq.cross(r2, axis), *axis))
