"""The steps of a plan: which equation computes which quantity, for each kind of motion."""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable
from typing import Any, NamedTuple

from hingepair.engine.trace import arc_tangent, hypotenuse, square_root, where_less
from hingepair.equations import constraints as ce
from hingepair.equations import derivatives as by
from hingepair.equations import spatial as eq
from hingepair.equations.spatial import Scalar, Vector
from hingepair.numeric.blocks import Components, hinge_cosine, hinge_terms, turn_terms


class Step(NamedTuple):
    """One equation of a plan: result = function(*arguments), where result and arguments are names of values."""

    result: str
    function: Callable[..., Any]
    arguments: tuple[str, ...]


# Names of the components of q in space.
SPATIAL_COORDINATE_NAMES = ("x", "y", "z", "phi_x", "phi_y", "phi_z", "psi")
# Names of the parts of the coordinates and their derivatives in space.
SPATIAL_PARTS = {
    "q": ("R1", "phi", "psi"),
    "qd": ("v1", "phid", "psid"),
    "qdd": ("a1", "phidd", "psidd"),
}
PLANAR_COORDINATE_NAMES = ("x", "y", "phi", "psi")  # names of the components of q in the plane
PLANAR_PARTS = {
    "q": ("R1", "phi1", "psi"),
    "qd": ("v1", "phi1d", "psid"),
    "qdd": ("a1", "phi1dd", "psidd"),
}
"""Names of the parts of the coordinates and their derivatives in the plane."""
LOG_COLUMNS_OF: dict[tuple[str, ...], dict[str, tuple[str, ...]]] = {
    SPATIAL_COORDINATE_NAMES: {
        "q": SPATIAL_COORDINATE_NAMES,
        "qd": ("v1_x", "v1_y", "v1_z", "phid_x", "phid_y", "phid_z", "psid"),
        "qdd": ("a1_x", "a1_y", "a1_z", "phidd_x", "phidd_y", "phidd_z", "psidd"),
    },
    PLANAR_COORDINATE_NAMES: {
        "q": PLANAR_COORDINATE_NAMES,
        "qd": ("v1_x", "v1_y", "phid", "psid"),
        "qdd": ("a1_x", "a1_y", "phidd", "psidd"),
    },
}
"""Names of the columns, in files and data frames, that hold q, qd and qdd, by the names of the coordinates."""

# Steps to the parts of q, qd, qdd in space.
SPATIAL_SPLIT_STEPS = tuple(
    Step(part, operator.itemgetter(place), (name,))
    for name, parts in SPATIAL_PARTS.items()
    for part, place in zip(parts, (slice(0, 3), slice(3, 6), 6), strict=True)
)
PLANAR_SPLIT_STEPS = tuple(
    Step(part, operator.itemgetter(place), (name,))
    for name, parts in PLANAR_PARTS.items()
    for part, place in zip(parts, (slice(0, 2), 2, 3), strict=True)
)
"""Steps to the parts of q, qd, qdd in the plane."""


def _quaternion_rotation(quat: tuple[Any, ...]) -> eq.Matrix:
    """Return the rotation matrix of a quaternion (w, x, y, z) of any length but zero."""
    scale = _largest_component(quat)
    w, x, y, z = (c / scale for c in quat)
    length = square_root(w * w + x * x + y * y + z * z)
    return eq.quaternion_attitude((w / length, x / length, y / length, z / length))


def _largest_component(parts: tuple[Any, ...]) -> Any:
    """Return the largest absolute value among the components."""
    return functools.reduce(lambda a, b: where_less(a, b, b, a), (where_less(c, 0.0, -c, c) for c in parts))


def _rotation_defect(S: eq.Matrix) -> Any:
    """Return the largest entry of S S^T - I; 2 for a reflection."""
    *errors, volume = eq.orthonormality_terms(S)
    return where_less(volume, 0.0, 2.0, _largest_component(tuple(errors)))


def _zero_quaternion_check(quat: tuple[Any, ...]) -> Any:
    """Return 2 for a quaternion of zeros, else 0."""
    size = sum(where_less(c, 0.0, -c, c) for c in quat)
    return where_less(0.0, size, 0.0, where_less(size, 1.0, 2.0, 0.0))


ATTITUDE_STEPS = {
    "S1": (Step("S1_check", _rotation_defect, ("S1",)),),
    "quat_xyzw": (
        Step("quat", lambda q: (q[3], *q[:3]), ("quat_xyzw",)),
        Step("S1", _quaternion_rotation, ("quat",)),
        Step("quat_xyzw_check", _zero_quaternion_check, ("quat",)),
    ),
    "quat_wxyz": (
        Step("S1", _quaternion_rotation, ("quat_wxyz",)),
        Step("quat_wxyz_check", _zero_quaternion_check, ("quat_wxyz",)),
    ),
}
"""Steps to S1 from the input that gives the attitude of body 1, and to the number that tells whether this input is an
attitude: the distance of a matrix from a rotation, or whether a quaternion is zero."""

ATTITUDE2_CHECK_STEPS = (Step("S2_check", _rotation_defect, ("S2",)),)
"""Step to the distance of a given S2 from a rotation."""

BODY2_KINEMATICS_STEPS = (
    Step("Sh", eq.hinge_rotation, ("n", "hinge")),
    Step("S2", eq.attitude2, ("S1", "Sh", "home")),
    Step("lever_moving", eq.lever_moving, ("lever_cos", "lever_sin", "hinge", "cosine")),
    Step("d", eq.offset, ("S1", "lever_fixed", "lever_moving")),
    Step("R2", eq.position2, ("R1", "d")),
    Step("axis", eq.rotate, ("S1", "n")),
    Step("omega2", eq.angular_velocity2, ("omega1", "axis", "psid")),
    Step("lever_by_psi", eq.lever_by_psi, ("S1", "lever_cos", "lever_sin", "hinge", "cosine")),
    Step("v2", eq.velocity2, ("v1", "omega1", "d", "lever_by_psi", "psid")),
    Step("alpha2", eq.angular_acceleration2, ("alpha1", "omega1", "axis", "psid", "psidd")),
    Step("centripetal", eq.rotate, ("S1", "lever_moving")),
    Step("relative", eq.relative_acceleration, ("lever_by_psi", "centripetal", "psid", "psidd")),
    Step("a2", eq.acceleration2, ("a1", "omega1", "alpha1", "d", "lever_by_psi", "psid", "relative")),
)
"""Steps to body 2 from body 1 and the hinge (E1, E2, E5-E9)."""

ARM_STEPS = (
    Step("r1", eq.rotate, ("S1", "u1")),
    Step("r2", eq.rotate, ("S2", "u2")),
)
"""Steps to the hinge point from either reference point, world axes; outputs do not need it, Jacobians do."""

LEVER_CONSTANT_STEPS = (
    Step("arm", eq.rotate, ("home", "u2")),
    Step("lever_sin", eq.cross, ("n", "arm")),
    Step("lever_cos", eq.cross, ("lever_sin", "n")),
    Step("lever_fixed", eq.lever_fixed, ("u1", "arm", "lever_cos")),
)
"""Steps to the constants of d: the parts of u1 and u2 that the hinge turns, and the part that it does not turn.
A pair takes these steps once, in twice the precision, so that a plan in doubles starts from constants that are right
to the last bit."""

WITHOUT_HOME = Step("S2", eq.compose, ("S1", "Sh"))  # E5 where C is the identity

GIVEN_ATTITUDE_STEPS = {
    "lever_by_psi": (
        Step("lever_in_world", eq.rotate, ("S1", "lever_moving")),
        Step("lever_by_psi", eq.cross, ("axis", "lever_in_world")),
    ),
    "centripetal": (Step("centripetal", eq.cross, ("lever_by_psi", "axis")),),
}
"""Steps that replace the step to a result if S1 is given. A given matrix may be a rotation to nine digits only; then
the cross products of E2 and E8 keep the hinge point of both bodies together to the last digit."""


def upright(turn: tuple[Scalar, Scalar]) -> eq.Matrix:
    """Return the rotation matrix about z, as nine entries (E11), where turn = (sin, cos) of the angle."""
    s, c = turn
    return c, -s, 0, s, c, 0, 0, 0, 1


def vector_along_z(rate: Scalar) -> Vector:
    """Return the vector (0, 0, rate), such as an angular velocity in the plane."""
    return 0, 0, rate


def in_space(u: tuple[Scalar, Scalar]) -> Vector:
    """Return a planar vector as a vector in space with z = 0."""
    return u[0], u[1], 0


def cross_with_e_z(u: tuple[Scalar, Scalar]) -> Vector:
    """Return e_z x u, as a vector in space, for a planar vector u."""
    return -u[1], u[0], 0


def in_plane(v: Vector) -> tuple[Scalar, Scalar]:
    """Return the x and y components of a vector in space."""
    return v[0], v[1]


def z_component(v: Vector) -> Scalar:
    """Return the z component of a vector."""
    return v[2]


def planar_velocity2(v1: Vector, omega1: Vector, r1: Vector, omega2: Vector, r2: Vector) -> Vector:
    """Return v2 = v1 + omega1 x r1 - omega2 x r2 (E8), the time derivative of E11. r1 and r2 lead from the reference
    points of body 1 and body 2 to the hinge point. All arguments and the result are vectors in space.
    """
    return eq.add(v1, eq.subtract(eq.cross(omega1, r1), eq.cross(omega2, r2)))


def planar_acceleration2(
    a1: Vector, rates1: tuple[Vector, Vector], r1: Vector, rates2: tuple[Vector, Vector], r2: Vector
) -> Vector:
    """Return a2 = a1 + r1'' - r2'' of a planar pair as a vector in space (E9, E11), where rates1 = (omega1, alpha1)
    and rates2 = (omega2, alpha2). r1 and r2 lead from the reference points of body 1 and body 2 to the hinge point.
    All vectors are vectors in space.
    """
    return eq.add(a1, eq.subtract(eq.point_acceleration(*rates1, r1), eq.point_acceleration(*rates2, r2)))


def as_tuple(*parts: Any) -> tuple[Any, ...]:
    """Return the positional arguments, any number of them, as one tuple."""
    return parts


def concatenate_vectors(a: tuple[Any, ...], b: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return one tuple with the components of two vectors."""
    return (*a, *b)


def same(value: Any) -> Any:
    """Return the value unchanged: the function of steps that give a value another name."""
    return value


PLANAR_KINEMATICS_STEPS = (
    Step("hinge", hinge_terms, ("psi",)),
    Step("cosine", hinge_cosine, ("hinge",)),
    Step("turn1", turn_terms, ("phi1",)),
    Step("S1", upright, ("turn1",)),
    Step("lever_fixed", in_space, ("u1",)),
    Step("lever_cos", in_space, ("u2",)),
    Step("lever_sin", cross_with_e_z, ("u2",)),
    Step("lever_moving", eq.lever_moving, ("lever_cos", "lever_sin", "hinge", "cosine")),
    Step("r1", eq.rotate, ("S1", "lever_fixed")),
    Step("r2", eq.rotate, ("S1", "lever_moving")),
    Step("d_in_space", eq.subtract, ("r1", "r2")),
    Step("d", in_plane, ("d_in_space",)),
    Step("R1_in_space", in_space, ("R1",)),
    Step("R2_in_space", eq.position2, ("R1_in_space", "d_in_space")),
    Step("R2", in_plane, ("R2_in_space",)),
    Step("phi2", operator.add, ("phi1", "psi")),
    Step("omega1", vector_along_z, ("phi1d",)),
    Step("axis", lambda: (0, 0, 1), ()),
    Step("omega2_in_space", eq.angular_velocity2, ("omega1", "axis", "psid")),
    Step("omega2", z_component, ("omega2_in_space",)),
    Step("v1_in_space", in_space, ("v1",)),
    Step("v2_in_space", planar_velocity2, ("v1_in_space", "omega1", "r1", "omega2_in_space", "r2")),
    Step("v2", in_plane, ("v2_in_space",)),
    Step("alpha1", vector_along_z, ("phi1dd",)),
    Step("alpha2_in_space", eq.angular_acceleration2, ("alpha1", "omega1", "axis", "psid", "psidd")),
    Step("alpha2", z_component, ("alpha2_in_space",)),
    Step("spin1", as_tuple, ("omega1", "alpha1")),
    Step("spin2", as_tuple, ("omega2_in_space", "alpha2_in_space")),
    Step("a1_in_space", in_space, ("a1",)),
    Step("a2_in_space", planar_acceleration2, ("a1_in_space", "spin1", "r1", "spin2", "r2")),
    Step("a2", in_plane, ("a2_in_space",)),
)
"""A planar pair: the equations of space with n = e_z, of which folding leaves what the plane needs (E11)."""


JACOBIAN_STEPS = (
    Step("turns", lambda: by.WORLD_UNIT_VECTORS, ()),
    Step("jacobian", by.jacobian, ("turns", "d", "r2", "axis")),
    Step(
        "relative_bias",
        lambda lever_by_psi, centripetal, psid: eq.relative_acceleration(lever_by_psi, centripetal, psid, 0.0),
        ("lever_by_psi", "centripetal", "psid"),
    ),
    Step(
        "a2_bias",
        lambda omega1, d, lever_by_psi, psid, relative_bias: eq.acceleration2(
            eq.ZERO_VECTOR, omega1, eq.ZERO_VECTOR, d, lever_by_psi, psid, relative_bias
        ),
        ("omega1", "d", "lever_by_psi", "psid", "relative_bias"),
    ),
    Step(
        "alpha2_bias",
        lambda omega1, axis, psid: eq.angular_acceleration2(eq.ZERO_VECTOR, omega1, axis, psid, 0.0),
        ("omega1", "axis", "psid"),
    ),
    Step("acceleration_bias", concatenate_vectors, ("a2_bias", "alpha2_bias")),
)
"""Steps to `jacobian`, by v1, omega1 and psi', and to the bias, (a2, alpha2) where a1, alpha1 and psi'' are 0."""


def _twist(turn: Components) -> Any:
    """Return the angle psi [rad], where turn = (sin psi, cos psi); both may be multiplied by one positive factor."""
    return arc_tangent(turn[0], turn[1])


def _tilt_angle(tilt: Components, h1: eq.Vector, h2: eq.Vector) -> Any:
    """Return the angle [rad] between the hinge axes h1 and h2, of which `tilt` is the cross product."""
    return arc_tangent(hypotenuse(tilt[0], tilt[1]), eq.dot(h1, h2))


def _component_quotient(parts: Components) -> Any:
    """Return the quotient of two components, the first divided by the second."""
    return parts[0] / parts[1]


CONSTRAINT_STEPS = (
    *ARM_STEPS,
    Step("h1", eq.rotate, ("S1", "n")),
    Step("e1_in_world", eq.rotate, ("S1", "e1")),
    Step("e2_in_world", eq.rotate, ("S1", "e2")),
    # Across h1 to the last bit, also where the S1 given is a rotation to nine digits only: no tilt of S1's own.
    Step("f1", eq.cross, ("e2_in_world", "h1")),
    Step("f2", eq.cross, ("h1", "e1_in_world")),
    Step("f", as_tuple, ("f1", "f2")),
    Step("g1", eq.rotate, ("S2", "e1_in_2")),
    Step("g2", eq.rotate, ("S2", "e2_in_2")),
    Step("h2", eq.rotate, ("S2", "n_in_2")),
    Step("h", as_tuple, ("h1", "h2")),
    Step("gap", eq.hinge_gap, ("R1", "r1", "R2", "r2")),
    Step("tilt", ce.tilt, ("f1", "f2", "h2")),
    Step("tilt_angle", _tilt_angle, ("tilt", "h1", "h2")),
    Step("turn", ce.hinge_angle_terms, ("f", "g1", "g2")),
    Step("psi", _twist, ("turn",)),
    Step("tilt_axes", ce.tilt_axes, ("f1", "f2", "h2")),
    Step("constraint_jacobian", ce.constraint_jacobian, ("r1", "r2", "tilt_axes")),
    Step("slip", ce.slip, ("omega1", "omega2", "h2", "psid_given")),
    Step("spin", ce.relative_rate, ("omega1", "omega2")),
    Step("omegas", as_tuple, ("omega1", "omega2")),
    Step("gap_rate", ce.gap_rate, ("v1", "omega1", "r1", "v2", "omega2", "r2")),
    Step("tilt_rate", ce.tilt_rate, ("tilt_axes", "spin")),
    Step("psid_parts", ce.hinge_rate, ("h1", "h2", "spin")),
    Step("psid", _component_quotient, ("psid_parts",)),
    Step("gap_bias", ce.gap_bias, ("omega1", "r1", "omega2", "r2")),
    Step("tilt_bias", ce.tilt_bias, ("f", "h2", "omega1", "omega2", "spin")),
    Step("constraint_bias", concatenate_vectors, ("gap_bias", "tilt_bias")),
    Step("turned1", eq.point_acceleration, ("omega1", "alpha1", "r1")),
    Step("turned2", eq.point_acceleration, ("omega2", "alpha2", "r2")),
    Step("gap_acceleration", ce.gap_acceleration, ("a1", "turned1", "a2", "turned2")),
    Step("relative_alpha", ce.relative_rate, ("alpha1", "alpha2")),
    Step("tilt_acceleration", ce.tilt_acceleration, ("tilt_axes", "relative_alpha", "tilt_bias")),
    Step("psidd_parts", ce.hinge_acceleration, ("h", "omegas", "spin", "relative_alpha", "psid")),
    Step("psidd", _component_quotient, ("psidd_parts",)),
)
"""Steps to the constraints and to all that follows from them."""
