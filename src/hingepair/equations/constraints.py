"""E1 and E2 as residuals of any two motions, and their exact first and second derivatives in time.

Plain arithmetic on tuples, as in `equations`. The hinge has a frame in each body: (e1, e2, n) fixed in body 1,
which in world axes is (f1, f2, h1), and C^-1 (e1, e2, n) fixed in body 2, in world axes (g1, g2, h2). At psi = 0 both
are one frame; whatever psi is, E2 keeps h1 and h2 one line. r_i = S_i u_i.

E2 says that body 2 turns against body 1 about h1 only. What it forbids is a turn about f1 or f2: the tilt, the
components of h1 x h2 along them.
"""

from __future__ import annotations

from hingepair.equations import spatial as eq
from hingepair.equations.spatial import Scalar, Vector

Two = tuple[Scalar, Scalar]


def tilt(f1: Vector, f2: Vector, h2: Vector) -> Two:
    """Return the tilt of a hinge, two numbers: the components of h1 x h2 along f1 and f2, -f2 . h2 and f1 . h2. The
    unit vectors f1 and f2 are fixed in body 1, h1 = f1 x f2 is the hinge axis in body 1, and h2 that in body 2. The
    norm is the sine of the angle between the axes, which E5 keeps at 0.
    """
    return -eq.dot(f2, h2), eq.dot(f1, h2)


def tilt_axes(f1: Vector, f2: Vector, h2: Vector) -> tuple[Vector, Vector]:
    """Return the pair of vectors (f2 x h2, h2 x f1). Their inner products with omega2 - omega1 are the time
    derivatives of the two components of `tilt`.

    The vectors are f1 and f2 if the hinge is not tilted.
    """
    return eq.cross(f2, h2), eq.cross(h2, f1)


def relative_rate(body1_rate: Vector, body2_rate: Vector) -> Vector:
    """Return body2_rate - body1_rate, for angular velocities (omega2 - omega1) or angular accelerations."""
    return eq.subtract(body2_rate, body1_rate)


def tilt_rate(tilt_axes: tuple[Vector, Vector], relative_omega: Vector) -> Two:
    """Return the time derivative of `tilt`, two numbers (E2), from `tilt_axes` and omega2 - omega1."""
    return eq.dot(tilt_axes[0], relative_omega), eq.dot(tilt_axes[1], relative_omega)


def tilt_bias(
    f_axes: tuple[Vector, Vector], h2: Vector, omega1: Vector, omega2: Vector, relative_omega: Vector
) -> Two:
    """Return the second time derivative of `tilt`, two numbers, for zero angular accelerations of both bodies. f_axes
    = (f1, f2) are unit vectors of body 1 across the hinge axis, h2 is the hinge axis in body 2, and relative_omega =
    omega2 - omega1, all in world axes.

    It is c' . (omega2 - omega1), with the axes c of `tilt_axes`.
    """
    h2_rate = eq.cross(omega2, h2)
    axis1_rate = eq.add(eq.cross(eq.cross(omega1, f_axes[1]), h2), eq.cross(f_axes[1], h2_rate))
    axis2_rate = eq.add(eq.cross(h2_rate, f_axes[0]), eq.cross(h2, eq.cross(omega1, f_axes[0])))
    return eq.dot(axis1_rate, relative_omega), eq.dot(axis2_rate, relative_omega)


def tilt_acceleration(tilt_axes: tuple[Vector, Vector], relative_alpha: Vector, bias: Two) -> Two:
    """Return the second time derivative of `tilt`, two numbers (E2), from the results of the functions `tilt_axes`
    and `tilt_bias`, and relative_alpha = alpha2 - alpha1.
    """
    return eq.dot(tilt_axes[0], relative_alpha) + bias[0], eq.dot(tilt_axes[1], relative_alpha) + bias[1]


def gap_rate(v1: Vector, omega1: Vector, r1: Vector, v2: Vector, omega2: Vector, r2: Vector) -> Vector:
    """Return (R1 + r1)' - (R2 + r2)', the time derivative of `hinge_gap` (E1). r1 and r2 lead from the reference
    point of body 1 and of body 2 to the hinge point of that body, world axes.
    """
    return eq.subtract(eq.add(v1, eq.cross(omega1, r1)), eq.add(v2, eq.cross(omega2, r2)))


def gap_acceleration(a1: Vector, r1_acceleration: Vector, a2: Vector, r2_acceleration: Vector) -> Vector:
    """Return a1 + r1'' - (a2 + r2''), the second time derivative of `hinge_gap` (E1), where r1 and r2 lead from the
    reference point of body 1 and of body 2 to the hinge point of that body, world axes.
    """
    return eq.subtract(eq.add(a1, r1_acceleration), eq.add(a2, r2_acceleration))


def hinge_angle_terms(f_axes: tuple[Vector, Vector], g1: Vector, g2: Vector) -> Two:
    """Return the pair (sin psi, cos psi) times a common positive factor. f_axes = (f1, f2) are unit vectors of body 1
    across the hinge axis, and g1 and g2 those of body 2 that coincide with them at psi = 0, all in world axes.

    From Sh = S1^T S2 C^-1 (E5, E6). The factor is 1 + h1 . h2, which is 2 unless the hinge is tilted.
    Of a tilted hinge, psi is the twist about the axis.
    """
    f1, f2 = f_axes
    return eq.dot(f2, g1) - eq.dot(f1, g2), eq.dot(f1, g1) + eq.dot(f2, g2)


def hinge_rate(h1: Vector, h2: Vector, relative_omega: Vector) -> Two:
    """Return psi' as the pair (numerator, denominator) = ((omega2 - omega1) . (h1 + h2), 1 + h1 . h2), not divided.
    The result holds for tilted hinges too; h1 and h2 are the hinge axis in body 1 and in body 2, and relative_omega =
    omega2 - omega1.
    """
    return eq.dot(relative_omega, eq.add(h1, h2)), 1.0 + eq.dot(h1, h2)


def hinge_acceleration(
    h_axes: tuple[Vector, Vector],
    omegas: tuple[Vector, Vector],
    relative_omega: Vector,
    relative_alpha: Vector,
    psid: Scalar,
) -> Two:
    """Return psi'' as a pair (numerator, denominator), not divided: the time derivative of the quotient of
    `hinge_rate`, which is psid. h_axes = (h1, h2) are the hinge axis in body 1 and in body 2, omegas = (omega1,
    omega2), relative_omega = omega2 - omega1, and relative_alpha = alpha2 - alpha1.
    """
    h1, h2 = h_axes
    middle_rate = eq.add(eq.cross(omegas[0], h1), eq.cross(omegas[1], h2))
    numerator = eq.dot(relative_alpha, eq.add(h1, h2)) + eq.dot(relative_omega, middle_rate)
    return numerator - psid * eq.dot(relative_omega, eq.cross(h2, h1)), 1.0 + eq.dot(h1, h2)
