"""The steps of a plan: which equation makes what of what, for each kind of motion."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, NamedTuple

from hingepair.equations import spatial as eq
from hingepair.equations.spatial import Scalar, Vector
from hingepair.numeric.blocks import hinge_cosine, hinge_terms, turn_terms


class Step(NamedTuple):
    """One equation: result = function(*arguments), all by name."""

    result: str
    function: Callable[..., Any]
    arguments: tuple[str, ...]


COORDINATES = ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi")
PARTS = {"q": ("R1", "phi", "psi"), "qd": ("v1", "phid", "psid"), "qdd": ("a1", "phidd", "psidd")}
PLANAR_COORDINATES = ("x", "y", "phi", "psi")
PLANAR_PARTS = {"q": ("R1", "phi1", "psi"), "qd": ("v1", "phi1d", "psid"), "qdd": ("a1", "phi1dd", "psidd")}
"""The coordinates and their derivatives, and what a plan calls their parts: position, angles, hinge angle."""

ROW_STEPS = tuple(
    Step(part, operator.itemgetter(place), (name,))
    for name, parts in PARTS.items()
    for part, place in zip(parts, (slice(0, 3), slice(3, 6), 6), strict=True)
)
PLANAR_ROW_STEPS = tuple(
    Step(part, operator.itemgetter(place), (name,))
    for name, parts in PLANAR_PARTS.items()
    for part, place in zip(parts, (slice(0, 2), 2, 3), strict=True)
)
"""The parts out of q, qd, qdd."""

HINGE_STEPS = (
    Step("Sh", eq.hinge_rotation, ("n", "hinge")),
    Step("S2", eq.attitude2, ("S1", "Sh", "home")),
    Step("swing", eq.swing, ("across", "around", "hinge", "cosine")),
    Step("d", eq.offset, ("S1", "along", "swing")),
    Step("R2", eq.position2, ("R1", "d")),
    Step("axis", eq.rotate, ("S1", "n")),
    Step("omega2", eq.angular_velocity2, ("omega1", "axis", "psid")),
    Step("slide", eq.slide, ("S1", "across", "around", "hinge", "cosine")),
    Step("v2", eq.velocity2, ("v1", "omega1", "d", "slide", "psid")),
    Step("alpha2", eq.angular_acceleration2, ("alpha1", "omega1", "axis", "psid", "psidd")),
    Step("pull", eq.rotate, ("S1", "swing")),
    Step("relative", eq.relative_acceleration, ("slide", "pull", "psid", "psidd")),
    Step("a2", eq.acceleration2, ("a1", "omega1", "alpha1", "d", "slide", "psid", "relative")),
)
"""Body 2 from body 1 and the hinge (E1, E2, E5-E9)."""

ARM_STEPS = (Step("r1", eq.rotate, ("S1", "u1")), Step("r2", eq.rotate, ("S2", "u2")))
"""The hinge point from either reference point, in world axes: no output needs it, Jacobians do."""

LEVER_STEPS = (
    Step("arm", eq.rotate, ("home", "u2")),
    Step("around", eq.cross, ("n", "arm")),
    Step("across", eq.cross, ("around", "n")),
    Step("along", eq.along, ("u1", "arm", "across")),
)
"""What the hinge turns of the levers u1 and u2, and what it leaves; a pair takes these steps once, in twice the
precision, so that a plan in doubles starts from constants that are right to the last bit."""

WITHOUT_HOME = Step("S2", eq.compose, ("S1", "Sh"))

GIVEN_S1 = {
    "slide": (Step("reach", eq.rotate, ("S1", "swing")), Step("slide", eq.cross, ("axis", "reach"))),
    "pull": (Step("pull", eq.cross, ("slide", "axis")),),
}
"""A matrix from outside may be a rotation to nine digits only: there the cross products of E2 and E8, as they stand,
keep the hinge point of both bodies together to the last digit."""


def upright(turn: tuple[Scalar, Scalar]) -> eq.Matrix:
    """The rotation about z (E11); turn = (sin, cos)."""
    s, c = turn
    return c, -s, 0, s, c, 0, 0, 0, 1


def upward(rate: Scalar) -> Vector:
    """A turn about z, as a vector."""
    return 0, 0, rate


def in_space(u: tuple[Scalar, Scalar]) -> Vector:
    """A vector of the plane z = 0."""
    return u[0], u[1], 0


def quarter(u: tuple[Scalar, Scalar]) -> Vector:
    """e_z x u."""
    return -u[1], u[0], 0


def in_plane(v: Vector) -> tuple[Scalar, Scalar]:
    """What a vector has in the plane."""
    return v[0], v[1]


def height(v: Vector) -> Scalar:
    """What a vector has along z."""
    return v[2]


def planar_velocity2(v1: Vector, omega1: Vector, r1: Vector, omega2: Vector, r2: Vector) -> Vector:
    """v2 = v1 + omega1 x r1 - omega2 x r2 (E8), as E11 is differentiated."""
    return eq.add(v1, eq.subtract(eq.cross(omega1, r1), eq.cross(omega2, r2)))


def planar_acceleration2(
    a1: Vector, turn1: tuple[Vector, Vector], r1: Vector, turn2: tuple[Vector, Vector], r2: Vector
) -> Vector:
    """a2 = a1 + r1'' - r2'' (E9), as E11 is differentiated twice; turn_i = (omega_i, alpha_i)."""
    return eq.add(a1, eq.subtract(eq.point_acceleration(*turn1, r1), eq.point_acceleration(*turn2, r2)))


def together(*parts: Any) -> tuple[Any, ...]:
    """Several values as one."""
    return parts


def joined(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[Any, ...]:
    """The components of two vectors as those of one."""
    return (*a, *b)


def same(value: Any) -> Any:
    """The value itself, by another name."""
    return value


PLANAR_STEPS = (
    Step("hinge", hinge_terms, ("psi",)),
    Step("cosine", hinge_cosine, ("hinge",)),
    Step("turn1", turn_terms, ("phi1",)),
    Step("S1", upright, ("turn1",)),
    Step("along", in_space, ("u1",)),
    Step("across", in_space, ("u2",)),
    Step("around", quarter, ("u2",)),
    Step("swing", eq.swing, ("across", "around", "hinge", "cosine")),
    Step("r1", eq.rotate, ("S1", "along")),
    Step("r2", eq.rotate, ("S1", "swing")),
    Step("d_in_space", eq.subtract, ("r1", "r2")),
    Step("d", in_plane, ("d_in_space",)),
    Step("R1_in_space", in_space, ("R1",)),
    Step("R2_in_space", eq.position2, ("R1_in_space", "d_in_space")),
    Step("R2", in_plane, ("R2_in_space",)),
    Step("phi2", operator.add, ("phi1", "psi")),
    Step("omega1", upward, ("phi1d",)),
    Step("axis", lambda: (0, 0, 1), ()),
    Step("omega2_in_space", eq.angular_velocity2, ("omega1", "axis", "psid")),
    Step("omega2", height, ("omega2_in_space",)),
    Step("v1_in_space", in_space, ("v1",)),
    Step("v2_in_space", planar_velocity2, ("v1_in_space", "omega1", "r1", "omega2_in_space", "r2")),
    Step("v2", in_plane, ("v2_in_space",)),
    Step("alpha1", upward, ("phi1dd",)),
    Step("alpha2_in_space", eq.angular_acceleration2, ("alpha1", "omega1", "axis", "psid", "psidd")),
    Step("alpha2", height, ("alpha2_in_space",)),
    Step("spin1", together, ("omega1", "alpha1")),
    Step("spin2", together, ("omega2_in_space", "alpha2_in_space")),
    Step("a1_in_space", in_space, ("a1",)),
    Step("a2_in_space", planar_acceleration2, ("a1_in_space", "spin1", "r1", "spin2", "r2")),
    Step("a2", in_plane, ("a2_in_space",)),
)
"""A planar pair: the equations of space with n = e_z, of which folding leaves what the plane needs (E11)."""
