"""The constants of a pair's tree without masses, made in its program of the geometry, for derivatives by it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Final

from hingepair.engine.binding import ArrayShape
from hingepair.engine.trace import square_root
from hingepair.equations.spatial import (
    IDENTITY_MATRIX,
    Vector,
    add,
    compose,
    cross,
    dot,
    matrix_from_columns,
    rotate,
    scale,
    subtract,
    transpose,
)
from hingepair.numeric.caching import lock_free_cached_property
from hingepair.plans.fronts import Front

GEOMETRY_SHAPES: Final[Mapping[str, ArrayShape]] = {"u1": (3,), "u2": (3,), "n": (3,), "home": (3, 3)}
"""Shapes of the constants by which kinematics of a pair in space can be differentiated. The axis x, y or z of body 1
that is farthest from n, least_axis, comes with them."""


class Geometry(Front):
    """The constants of the tree, given as geometry.

    Args:
        given: values by name.
        bodies: for each point of the pair, its body, 1 or 2.
    """

    needs: ClassVar = {
        "numbers": (*GEOMETRY_SHAPES, "least_axis", "points"),
        **dict.fromkeys(("e1", "e2"), ("n", "least_axis")),
        **dict.fromkeys(("e1_in_2", "e2_in_2", "n_in_2"), ("n", "least_axis", "home")),
    }

    def __init__(self, given: Mapping[str, Any], bodies: Sequence[int]) -> None:
        super().__init__(given)
        self._bodies = bodies

    @lock_free_cached_property
    def numbers(self) -> tuple[Any, ...]:
        """All constants in the order of `plans.trees`. Body 2 has the axes e1, e2 and n of body 1 at psi = 0."""
        n, home, u1, u2 = (self.given[name] for name in ("n", "home", "u1", "u2"))
        axes = matrix_from_columns(self.e1, self.e2, n)
        turn = compose(transpose(axes), home)
        arm = scale(rotate(turn, u2), -1.0)  # from the hinge point to R2
        frames = [*arm, *turn]
        positions = iter(self.given["points"]) if self._bodies else iter(())
        for body, p in zip(self._bodies, zip(positions, positions, positions, strict=True), strict=True):
            if body == 1:
                frames += [*p, *IDENTITY_MATRIX]
            else:
                frames += [*add(arm, rotate(turn, p)), *turn]
        nothing, rotor = (0.0,) * 10, (0.0, 1.0, 0.0)  # masses; no motor, and it follows none
        min_pivots = (0.0,) * 3  # of the hinge, and of force and torque on a free base
        return (*nothing, *axes, *u1, *nothing, *rotor, *min_pivots, *frames)

    @lock_free_cached_property
    def e1(self) -> Vector:
        """Unit vector across n."""
        n, across = self.given["n"], self.given["least_axis"]
        e1 = subtract(across, scale(n, dot(n, across)))
        return scale(e1, 1.0 / square_root(dot(e1, e1)))

    @property
    def e2(self) -> Vector:
        """Unit vector across n and e1."""
        return cross(self.given["n"], self.e1)

    @property
    def e1_in_2(self) -> Vector:
        """C^-1 e1."""
        return self._in_body2(self.e1)

    @property
    def e2_in_2(self) -> Vector:
        """C^-1 e2."""
        return self._in_body2(self.e2)

    @property
    def n_in_2(self) -> Vector:
        """C^-1 n."""
        return self._in_body2(self.given["n"])

    def _in_body2(self, v: Vector) -> Vector:
        """Return C^-1 v: a vector of body-1 axes at psi = 0 in the axes of body 2."""
        a, b, c = (self.given["home"][k::3] for k in range(3))
        sides = cross(b, c), cross(c, a), cross(a, b)
        volume = dot(a, sides[0])
        x, y, z = (dot(side, v) / volume for side in sides)
        return x, y, z
