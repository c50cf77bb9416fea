"""E11: the constraint equations where all turns are about z, written once, as `equations` writes those of space.

phi_2 = phi_1 + psi, omega_2 = phi_1' + psi', R2 = R1 + S(phi_1) u1 - S(phi_2) u2; v2 and a2 are its derivatives.

A vector in the plane is a tuple of two scalars, and so is a turn: its (sin, cos). What is called flat is motion in
space whose turns are all about z: the same equations, with a third component that follows along.
"""

from __future__ import annotations

from typing import TypeAlias

from hingepair.equations.spatial import Hinge, Matrix, Scalar, Vector

Plane: TypeAlias = tuple[Scalar, Scalar]


def planar_sum(a: Plane, b: Plane) -> Plane:
    """The sum a + b."""
    return a[0] + b[0], a[1] + b[1]


def planar_difference(a: Plane, b: Plane) -> Plane:
    """The difference a - b."""
    return a[0] - b[0], a[1] - b[1]


def planar_rate(rate1: Scalar, rate: Scalar) -> Scalar:
    """phi_2 = phi_1 + psi, and so their derivatives (E11)."""
    return rate1 + rate


def planar_turn(turn1: Plane, hinge: Hinge) -> Plane:
    """(sin, cos) of phi_1 + psi (E11); hinge = (sin psi, 1 - cos psi)."""
    s, c = turn1
    sine, versine = hinge[0], hinge[1]
    return s + (c * sine - s * versine), c - (c * versine + s * sine)


def planar_rotate(turn: Plane, u: Plane) -> Plane:
    """A body vector in world axes; turn = (sin, cos)."""
    s, c = turn
    return c * u[0] - s * u[1], s * u[0] + c * u[1]


def planar_velocity2(v1: Plane, omega1: Scalar, r1: Plane, omega2: Scalar, r2: Plane) -> Plane:
    """v2 = v1 + (S1 u1)' - (S2 u2)' (E11 differentiated)."""
    return v1[0] - (omega1 * r1[1] - omega2 * r2[1]), v1[1] + (omega1 * r1[0] - omega2 * r2[0])


def planar_point_acceleration(omega: Scalar, alpha: Scalar, r: Plane) -> Plane:
    """Acceleration of a body's point against its reference point."""
    w = omega * omega
    return -(alpha * r[1]) - w * r[0], alpha * r[0] - w * r[1]


def planar_acceleration2(
    a1: Plane, omega1: Scalar, alpha1: Scalar, r1: Plane, omega2: Scalar, alpha2: Scalar, r2: Plane
) -> Plane:
    """a2 = a1 + (S1 u1)'' - (S2 u2)'' (E11 differentiated twice)."""
    p1, p2 = planar_point_acceleration(omega1, alpha1, r1), planar_point_acceleration(omega2, alpha2, r2)
    return planar_sum(a1, planar_difference(p1, p2))


def flat_turn(turn1: Plane, hinge: Hinge, n: Vector) -> Plane:
    """(sin, cos) of body 2's turn about z where n is e_z or -e_z (E11)."""
    return planar_turn(turn1, (n[2] * hinge[0], hinge[1]))


def flat_turn_home(turn1: Plane, hinge: Hinge, n: Vector, home: Matrix) -> Plane:
    """The same with a home that turns about z."""
    s, c = flat_turn(turn1, hinge, n)
    return s * home[0] + c * home[3], c * home[0] - s * home[3]


def flat_attitude(turn: Plane) -> Matrix:
    """The rotation about z; turn = (sin, cos)."""
    s, c = turn
    return c, -s, 0, s, c, 0, 0, 0, 1


def flat_rotate(turn: Plane, u: Vector) -> Vector:
    """A body vector in world axes, turned about z."""
    x, y = planar_rotate(turn, u[0:2])
    return x, y, u[2]


def flat_spin1(rate1: Scalar) -> Vector:
    """omega1 of a turn about z, and alpha1."""
    return 0, 0, rate1


def flat_spin2(rate1: Scalar, n: Vector, rate: Scalar) -> Vector:
    """omega2 = (phi_1' + n psi') e_z with n = 1 or -1, and alpha2 (E11)."""
    return 0, 0, planar_rate(rate1, n[2] * rate)


def flat_velocity2(v1: Vector, rate1: Scalar, r1: Vector, omega2: Vector, r2: Vector) -> Vector:
    """v2 where all turns are about z (E8, E11)."""
    x, y = planar_velocity2(v1[0:2], rate1, r1[0:2], omega2[2], r2[0:2])
    return x, y, v1[2]


def flat_acceleration2(
    a1: Vector, rate1: Scalar, rate1d: Scalar, r1: Vector, omega2: Vector, alpha2: Vector, r2: Vector
) -> Vector:
    """a2 where all turns are about z (E9, E11)."""
    x, y = planar_acceleration2(a1[0:2], rate1, rate1d, r1[0:2], omega2[2], alpha2[2], r2[0:2])
    return x, y, a1[2]
