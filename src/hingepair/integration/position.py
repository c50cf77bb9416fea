"""The reference point of body 1 as it is given to `integrate`: constant, moving, or with its derivatives."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, ShapeError
from hingepair.integration.signals import called
from hingepair.numeric.arrays import real_array

_NAMES = ("R1", "v1", "a1")


def read_position(R1: Any, t: NDArray[np.float64], size: int) -> dict[str, NDArray[Any]]:
    """R1 and, as far as they are known, v1 and a1; each of shape (size,) or (N, size).

    Args:
        R1: one point, which stays where it is; a point for each instant; a tuple (R1, v1) or (R1, v1, a1); a callable
            of t that returns one of these.
        t: the instants, shape (N,).
        size: 3 in space, 2 in the plane.

    Raises:
        ShapeError, DtypeError, ArgumentError: it is none of these.
    """
    name = "R1"
    if callable(R1):
        name, R1 = "R1(t)", called("R1", R1, t)
    if isinstance(R1, tuple) and len(R1) <= len(_NAMES) and len(R1) and np.ndim(R1[0]) > 0:
        return {own: _points(f"{name}[{i}]", R1[i], t, size) for i, own in enumerate(_NAMES[: len(R1)])}
    if R1 is None:
        raise ArgumentError(name, "a point, points, or (R1, v1, a1)", None)
    point = _points(name, R1, t, size)
    if point.ndim == 1:
        return {"R1": point, "v1": np.zeros(size), "a1": np.zeros(size)}
    return {"R1": point}


def _points(name: str, value: Any, t: NDArray[np.float64], size: int) -> NDArray[Any]:
    points = real_array(name, value)
    if points.shape not in {(size,), (len(t), size)}:
        raise ShapeError(name, f"shape ({size},) or {(len(t), size)}", f"shape {points.shape}")
    return points
