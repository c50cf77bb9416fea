"""Matrices as flat tuples of their entries, row by row, for the derivatives of the equations."""

from __future__ import annotations

from typing import TypeAlias

from hingepair.equations.spatial import Scalar, Vector

Entries: TypeAlias = tuple[Scalar, ...]
Axes: TypeAlias = tuple[Vector, Vector, Vector]

WORLD_UNIT_VECTORS: Axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Unit vectors along the world's axes."""


def matrix_from_columns(*columns: Entries) -> Entries:
    """Return the matrix with these columns, each a tuple of numbers, as a flat tuple row by row."""
    return tuple(entry for row in zip(*columns, strict=True) for entry in row)
