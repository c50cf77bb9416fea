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
    name, times = "R1", t
    if callable(R1):
        times = np.append(t, [t[-1]] * (len(_NAMES) + 1 - len(t)))  # more than a tuple has parts, or a point
        name, R1 = "R1(t)", called("R1", R1, times)
    if isinstance(R1, tuple) and len(R1) <= len(_NAMES) and len(R1) and np.ndim(R1[0]) > 0:
        if len(R1) == len(times) > 1 and all(np.ndim(part) == 1 for part in R1):
            either = f"an array of shape {(len(t), size)}, or (R1, v1) with R1 of that shape"
            raise ArgumentError(name, either, f"a tuple of {len(t)} points, which could be either")
        return {own: _points(f"{name}[{i}]", R1[i], t, times, size) for i, own in enumerate(_NAMES[: len(R1)])}
    if R1 is None:
        raise ArgumentError(name, "a point, points, or (R1, v1, a1)", None)
    point = _points(name, R1, t, times, size)
    if point.ndim == 1:
        return {"R1": point, "v1": np.zeros(size), "a1": np.zeros(size)}
    return {"R1": point}


def _points(name: str, value: Any, t: NDArray[Any], times: NDArray[Any], size: int) -> NDArray[Any]:
    points = real_array(name, value)
    if points.shape not in {(size,), (len(times), size)}:
        raise ShapeError(name, f"shape ({size},) or {(len(times), size)}", f"shape {points.shape}")
    return points if points.ndim == 1 else points[: len(t)]
