"""Points that are fixed to the bodies of a pair: their names and positions, as users give them."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations.quantities import QUANTITIES
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import constant
from hingepair.plans.points import INPUT, POINT_ENDINGS, Point

Points: TypeAlias = Mapping[str, NDArray[np.float64]]

_RESERVED: Final = {  # names that a point cannot have
    *QUANTITIES,
    *("home", "next_S1"),  # attitudes among the inputs of programs
    *("quat1", "quat2", "qx", "qy", "qz", "qw"),  # in scenes
    *("body1", "body2", "body2_at_hinge", "hinge", "base", "world"),  # in models and pages
}
_COMPONENTS: Final = ("_x", "_y", "_z")  # endings of the columns of a vector


def checked_points(argument: str, points: Mapping[str, ArrayLike] | None, size: int) -> Points:
    """Return the argument points1 or points2 as read-only positions (..., size) by name; refuse names in use."""
    if points is None:
        return MappingProxyType({})
    if not isinstance(points, Mapping):
        raise ArgumentError(argument, "a dict of positions by name", quoted(points))
    for name in points:
        if not isinstance(name, str) or not name.isidentifier():
            expected = "names of letters, digits and _ that begin with a letter"
            raise ArgumentError(argument, expected, quoted(name))
        for ending in (*filter(None, POINT_ENDINGS.values()), *_COMPONENTS):
            if name.endswith(ending):
                expected = f"names that do not end in {ending}, as columns of points do"
                raise ArgumentError(argument, expected, quoted(name))
        if name in _RESERVED:
            raise ArgumentError(argument, "names that no output and no part of a model has", quoted(name))
    return MappingProxyType({name: constant(f"{argument}[{name!r}]", value, size) for name, value in points.items()})


def named_points(points1: Points, points2: Points) -> tuple[tuple[Point, ...], Points]:
    """Return the points of both bodies, and their positions by the names that plans use.

    Raises:
        ArgumentError: a name stands twice.
    """
    for name in points2:
        if name in points1:
            raise ArgumentError("points2", "names that points1 does not have", quoted(name))
    points = (*(Point(name, 1) for name in points1), *(Point(name, 2) for name in points2))
    return points, {INPUT + name: array for name, array in {**points1, **points2}.items()}
