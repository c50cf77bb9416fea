"""Which equation gives which quantity of a pair in closed forms (E1-E11), from the coordinates to the outputs.

Programs compute body 2 by a tree whose z axis is the hinge axis (`plans.pairs`). Closed forms stay shorter in the
axes of body 1, with Rodrigues' rotation about n (E6).
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, TypeAlias

from hingepair.equations import spatial as eq
from hingepair.equations.spatial import Scalar, Vector
from hingepair.plans.fronts import FourCoordinates, Front, SevenCoordinates
from hingepair.plans.pairs import POINT_ENDINGS, Point
from hingepair.rotations.sequences import find_sequence
from hingepair.symbolic.trig_sums import cosine_expression, sine_expression

Equation: TypeAlias = tuple[Callable[..., Any], tuple[str, ...]]
"""A function, and the names of its arguments."""


def equations_of(sequence: str | None, has_home: bool, points: Iterable[Point]) -> dict[str, Equation]:
    """Return the equations of a pair by the name of what they give.

    Args:
        sequence: Euler sequence of body 1; None in the plane.
        has_home: whether C differs from the identity.
        points: points of the pair.
    """
    if sequence is None:
        found = _parts(FourCoordinates) | _PLANAR
    else:
        order = find_sequence(sequence)
        found = _parts(SevenCoordinates) | {
            "angles": (order.angles, ("phi",)),
            "trig": (_angle_trig, ("angles" if sequence != "XYZ" else "phi",)),
            "S1": (order.attitude, ("trig",)),
            "axes": (order.axes, ("trig",)),
            "omega1": (order.angular_velocity, ("axes", "phid")),
            "alpha1": (order.angular_acceleration, ("axes", "phid", "phidd")),
            **_SPATIAL,
        }
        if not has_home:
            found |= {"S2": (eq.compose, ("S1", "Sh")), "arm": (_same, ("u2",))}
    for point in points:
        found |= _of_point(point, planar=sequence is None)
    return found


def point_vector(name: str) -> str:
    """Return the name of the vector to a point, which its output has to be told from."""
    return f"vector to {name}"


def result_of(output: str) -> str:
    """Return the name of the equation of an output of a point."""
    return f"result of {output}"


def _parts(front: type[Front]) -> dict[str, Equation]:
    return {part: (operator.itemgetter(place), (array,)) for part, (array, place) in front.parts.items()}  # type: ignore[attr-defined]


def _same(value: Any) -> Any:
    return value


def _both(*parts: Any) -> tuple[Any, ...]:
    return parts


def _angle_trig(phi: tuple[Any, ...]) -> tuple[Any, ...]:
    return tuple(function(angle) for angle in phi for function in (sine_expression, cosine_expression))


def _hinge_trig(psi: Any) -> tuple[Any, Any]:
    return sine_expression(psi), 1 - cosine_expression(psi)


_HINGE: Final[dict[str, Equation]] = {
    "hinge": (_hinge_trig, ("psi",)),
    "cosine": (eq.cosine_of_psi, ("hinge",)),
    "lever_moving": (eq.lever_moving, ("lever_cos", "lever_sin", "hinge", "cosine")),
}
_SPATIAL: Final[dict[str, Equation]] = {
    **_HINGE,
    "arm": (eq.rotate, ("home", "u2")),
    "lever_sin": (eq.cross, ("n", "arm")),
    "lever_cos": (eq.cross, ("lever_sin", "n")),
    "lever_fixed": (eq.lever_fixed, ("u1", "arm", "lever_cos")),
    "Sh": (eq.hinge_rotation, ("n", "hinge")),
    "S2": (eq.attitude2, ("S1", "Sh", "home")),
    "d": (eq.offset, ("S1", "lever_fixed", "lever_moving")),
    "R2": (eq.position2, ("R1", "d")),
    "axis": (eq.rotate, ("S1", "n")),
    "omega2": (eq.angular_velocity2, ("omega1", "axis", "psid")),
    "lever_by_psi": (eq.lever_by_psi, ("S1", "lever_cos", "lever_sin", "hinge", "cosine")),
    "v2": (eq.velocity2, ("v1", "omega1", "d", "lever_by_psi", "psid")),
    "alpha2": (eq.angular_acceleration2, ("alpha1", "omega1", "axis", "psid", "psidd")),
    "centripetal": (eq.rotate, ("S1", "lever_moving")),
    "relative": (eq.relative_acceleration, ("lever_by_psi", "centripetal", "psid", "psidd")),
    "a2": (eq.acceleration2, ("a1", "omega1", "alpha1", "d", "lever_by_psi", "psid", "relative")),
}


def _upright(phi1: Any) -> eq.Matrix:
    s, c = sine_expression(phi1), cosine_expression(phi1)
    return c, -s, 0, s, c, 0, 0, 0, 1


def _in_space(u: tuple[Scalar, Scalar]) -> Vector:
    return u[0], u[1], 0


def _across(u: tuple[Scalar, Scalar]) -> Vector:
    return -u[1], u[0], 0


def _along_z(rate: Scalar) -> Vector:
    return 0, 0, rate


def _in_plane(v: Vector) -> tuple[Scalar, Scalar]:
    return v[0], v[1]


def _z(v: Vector) -> Scalar:
    return v[2]


def _velocity2(v1: Vector, omega1: Vector, r1: Vector, omega2: Vector, r2: Vector) -> Vector:
    """Return v2 = v1 + omega1 x r1 - omega2 x r2 (E8), the time derivative of E11."""
    return eq.add(v1, eq.subtract(eq.cross(omega1, r1), eq.cross(omega2, r2)))


def _acceleration2(
    a1: Vector, rates1: tuple[Vector, Vector], r1: Vector, rates2: tuple[Vector, Vector], r2: Vector
) -> Vector:
    """Return a2 = a1 + r1'' - r2'' (E9), where rates1 = (omega1, alpha1) and rates2 = (omega2, alpha2)."""
    return eq.add(a1, eq.subtract(eq.point_acceleration(*rates1, r1), eq.point_acceleration(*rates2, r2)))


_PLANAR: Final[dict[str, Equation]] = {
    **_HINGE,
    "S1": (_upright, ("phi1",)),
    "lever_fixed": (_in_space, ("u1",)),
    "lever_cos": (_in_space, ("u2",)),
    "lever_sin": (_across, ("u2",)),
    "r1": (eq.rotate, ("S1", "lever_fixed")),
    "r2": (eq.rotate, ("S1", "lever_moving")),
    "d in space": (eq.subtract, ("r1", "r2")),
    "R1 in space": (_in_space, ("R1",)),
    "R2 in space": (eq.position2, ("R1 in space", "d in space")),
    "phi2": (operator.add, ("phi1", "psi")),
    "omega1": (_along_z, ("phi1d",)),
    "axis": (functools.partial(_along_z, 1), ()),
    "omega2 in space": (eq.angular_velocity2, ("omega1", "axis", "psid")),
    "v1 in space": (_in_space, ("v1",)),
    "v2 in space": (_velocity2, ("v1 in space", "omega1", "r1", "omega2 in space", "r2")),
    "alpha1": (_along_z, ("phi1dd",)),
    "alpha2 in space": (eq.angular_acceleration2, ("alpha1", "omega1", "axis", "psid", "psidd")),
    "rates1": (_both, ("omega1", "alpha1")),
    "rates2": (_both, ("omega2 in space", "alpha2 in space")),
    "a1 in space": (_in_space, ("a1",)),
    "a2 in space": (_acceleration2, ("a1 in space", "rates1", "r1", "rates2", "r2")),
    **{name: (_in_plane, (f"{name} in space",)) for name in ("d", "R2", "v2", "a2")},
    **{name: (_z, (f"{name} in space",)) for name in ("omega2", "alpha2")},
}


def _point_velocity(v: Vector, omega: Vector, arm: Vector) -> Vector:
    return eq.add(v, eq.cross(omega, arm))


def _point_acceleration(a: Vector, omega: Vector, alpha: Vector, arm: Vector) -> Vector:
    return eq.add(a, eq.point_acceleration(omega, alpha, arm))


def _of_point(point: Point, planar: bool) -> Mapping[str, Equation]:
    """Return the equations of a point: R = R_i + S_i p, v = v_i + omega_i x S_i p, and a likewise (E1, E8, E9)."""
    name, k = point
    p, arm = point_vector(name), f"arm of {name}"
    R, v, a = (result_of(name + ending) for ending in POINT_ENDINGS.values())
    if not planar:
        return {
            arm: (eq.rotate, (f"S{k}", p)),
            R: (eq.add, (f"R{k}", arm)),
            v: (_point_velocity, (f"v{k}", f"omega{k}", arm)),
            a: (_point_acceleration, (f"a{k}", f"omega{k}", f"alpha{k}", arm)),
        }
    lifted, across, turned = (f"{word} {name}" for word in ("lifted", "across", "turned"))
    omega, alpha = ("omega1", "alpha1") if k == 1 else ("omega2 in space", "alpha2 in space")
    in_space: dict[str, Equation] = {
        "R": (eq.add, (f"R{k} in space", arm)),
        "v": (_point_velocity, (f"v{k} in space", omega, arm)),
        "a": (_point_acceleration, (f"a{k} in space", omega, alpha, arm)),
    }
    return {
        lifted: (_in_space, (p,)),
        across: (_across, (p,)),
        turned: (eq.lever_moving, (lifted, across, "hinge", "cosine")),
        arm: (eq.rotate, ("S1", lifted if k == 1 else turned)),
        **{f"{letter} of {name} in space": equation for letter, equation in in_space.items()},
        **{one: (_in_plane, (f"{letter} of {name} in space",)) for letter, one in zip("Rva", (R, v, a), strict=True)},
    }
