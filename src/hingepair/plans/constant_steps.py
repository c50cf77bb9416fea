"""Steps from what users give of a pair, its geometry and its masses, to the constants of its programs.

Pairs take these steps once, in other ways that round less; programs take them where they are differentiated by a
constant.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from hingepair.engine.binding import ArrayShape
from hingepair.engine.trace import square_root
from hingepair.equations.derivatives import matrix_from_columns
from hingepair.equations.spatial import (
    ZERO_VECTOR,
    Matrix,
    Vector,
    compose,
    cross,
    dot,
    rotate,
    scale,
    subtract,
    transpose,
)
from hingepair.equations.trees import Matter, Placement, with_carried
from hingepair.plans.steps import LEVER_CONSTANT_STEPS, Step, in_space

_NOTHING: Final = Matter(0.0, ZERO_VECTOR, (0.0,) * 6)  # a body without mass
_IDENTITY: Final = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

CONSTANT_SHAPES: Final[Mapping[bool, Mapping[str, ArrayShape]]] = {
    False: {
        **{"masses": (2,), "first_moments": (2, 3), "inertias": (2, 6)},
        **{"u1": (3,), "u2": (3,), "n": (3,), "home": (3, 3)},
    },
    True: {"masses": (2,), "first_moments": (2, 2), "inertias": (2,), "u1": (2,), "u2": (2,)},
}
"""Shapes of the constants by which outputs can be differentiated, of a pair in space and, True, in the plane."""


def _across(unit: Vector, n: Vector) -> Vector:
    """Return a unit vector, made perpendicular to n."""
    across = subtract(unit, scale(n, dot(n, unit)))
    return scale(across, 1.0 / square_root(dot(across, across)))


def _in_body2(home: Matrix, v: Vector) -> Vector:
    """Return C^-1 v, where home = C: a vector of body-1 axes at psi = 0 in the axes of body 2."""
    a, b, c = (home[k::3] for k in range(3))
    sides = cross(b, c), cross(c, a), cross(a, b)
    volume = dot(a, sides[0])
    x, y, z = (dot(side, v) / volume for side in sides)
    return x, y, z


def _matter(body: int, masses: Any, first_moments: Any, inertias: Any) -> Matter:
    """Return the matter of body 1 (`body` 0) or 2 (1), about its reference point, in its axes."""
    xx, xy, yy, xz, yz, zz = inertias[6 * body : 6 * body + 6]  # Pinocchio's order
    half = 0.5 * (xx + yy + zz)
    return Matter(
        masses[body], first_moments[3 * body : 3 * body + 3], (half - xx, -xy, -xz, half - yy, -yz, half - zz)
    )


def _matter2(axes: Matrix, home: Matrix, u2: Vector, *both_bodies: Any) -> Matter:
    """Return the matter of body 2 about the hinge point, in the tree's axes."""
    turn = compose(transpose(axes), home)
    return with_carried(_NOTHING, Placement(turn, None, scale(rotate(turn, u2), -1.0)), _matter(1, *both_bodies))


def _tree(axes: Matrix, u1: Vector, matter2: Matter, least_pivots: Vector, *both_bodies: Any) -> tuple[Any, ...]:
    """Return `tree` as `pair.dynamics.tree_numbers` does: matter on the hinge's axis counts with body 1 (T9)."""
    *second, along = matter2.second
    on_axis = Matter(matter2.mass, (0.0, 0.0, matter2.first[2]), (0.0, 0.0, 0.0, 0.0, 0.0, along))
    base = with_carried(_matter(0, *both_bodies), Placement(axes, None, u1), on_axis)
    return (base.mass, *base.first, *base.second, *axes, *u1, *matter2.first[:2], *second, *least_pivots)


_BOTH_BODIES: Final = ("masses", "first_moments", "inertias")
# Steps to the constants of dynamics, in space and in the plane.
_TREE_STEPS: Final = (
    Step("tree_axes", matrix_from_columns, ("e1", "e2", "n")),
    Step("matter2", _matter2, ("tree_axes", "home", "u2", *_BOTH_BODIES)),
    Step("tree", _tree, ("tree_axes", "u1", "matter2", "least_pivots", *_BOTH_BODIES)),
    Step(
        "whole_body2", lambda axes, u1, m: (*axes, *u1, m.mass, *m.first, *m.second), ("tree_axes", "u1", "matter2")
    ),
    Step("arm2", lambda axes, arm: scale(rotate(transpose(axes), arm), -1.0), ("tree_axes", "arm")),
)
SPATIAL_CONSTANT_STEPS: Final = (
    *LEVER_CONSTANT_STEPS,
    Step("e1", _across, ("least_axis", "n")),
    Step("e2", cross, ("n", "e1")),
    *(Step(f"{name}_in_2", _in_body2, ("home", name)) for name in ("e1", "e2", "n")),
    *_TREE_STEPS,
)
"""Steps to the constants of a pair in space. `least_axis` is the axis x, y or z of body 1 that is farthest from n."""


def _moments_in_space(first_moments: Any) -> tuple[Any, ...]:
    return (*in_space(first_moments[:2]), *in_space(first_moments[2:]))


def _inertias_in_space(inertias: Any) -> tuple[Any, ...]:
    """Return inertias in space. Those across the plane do not count; they are large enough for any first moment."""
    return tuple(x for J in inertias for x in (1.5 * J, 0.0, 1.5 * J, 0.0, 0.0, J))


_PLANAR_NAMES: Final = {name: f"{name}_in_space" for name in ("u1", "u2", *_BOTH_BODIES[1:])}  # names in space
PLANAR_CONSTANT_STEPS: Final = (
    *(Step(f"{name}_in_space", in_space, (name,)) for name in ("u1", "u2")),
    Step("first_moments_in_space", _moments_in_space, ("first_moments",)),
    Step("inertias_in_space", _inertias_in_space, ("inertias",)),
    *(Step(f"e{k + 1}", lambda k=k: _IDENTITY[3 * k : 3 * k + 3], ()) for k in range(2)),
    Step("n", lambda: _IDENTITY[6:], ()),
    Step("home", lambda: _IDENTITY, ()),
    *(
        Step(result, function, tuple(_PLANAR_NAMES.get(name, name) for name in arguments))
        for result, function, arguments in (LEVER_CONSTANT_STEPS[0], *_TREE_STEPS)
    ),
)
"""Steps to the constants of a planar pair, whose levers its programs compute."""
