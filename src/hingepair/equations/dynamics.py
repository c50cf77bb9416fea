"""Newton and Euler for both bodies, the hinge's wrench eliminated: D1-D6 and D8, for simulation.

A body brings its mass m, its centre of mass c from its reference point and its inertia I about c, both in its own
axes; what turns with a body is taken to world axes here: r_i = S_i c_i. e = d + r2 leads from R1 to the centre of
mass of body 2, h = S2 (c2 - u2) there from the hinge point, k = S1 n is the hinge axis, g gravity.

D1  f_i = m_i (a_i + alpha_i x r_i + omega_i x (omega_i x r_i) - g)       what moves the centre of mass
D2  t_i = S_i (I_i S_i^T alpha_i + S_i^T omega_i x I_i S_i^T omega_i)     what turns body i about it
D3  force = f_2, torque = t_2 + h x f_2                                   the hinge on body 2, about the hinge point
D4  hinge_torque = k . torque                                             motor, spring, stops...; the rest constrains
D5  force1 = f_1 + f_2, torque1 = t_1 + r1 x f_1 + t_2 + e x f_2          what must act on body 1, about R1
D6  M (a1, alpha1, psi'') + bias = (force1, torque1, hinge_torque)        D1-D5, sorted by accelerations
D8  P = sum m_i v_ci, L = sum R_ci x m_i v_ci + I_i omega_i               momenta
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

from hingepair.equations.derivatives import Entries
from hingepair.equations.spatial import (
    Matrix,
    Scalar,
    Vector,
    add,
    compose,
    cross,
    dot,
    point_acceleration,
    rotate,
    scale,
    subtract,
    transpose,
)


def inertial_force(mass: Scalar, a: Vector, omega: Vector, alpha: Vector, r: Vector, g: Vector) -> Vector:
    """Return m (a_c - g), the sum of all forces on a body except gravity, where a_c is the acceleration of the centre
    of mass (D1). A point of the body has the acceleration a, and r leads from the point to the centre of mass. omega
    and alpha are the angular velocity and acceleration of the body, and `g` is the acceleration of gravity.
    """
    return scale(subtract(add(a, point_acceleration(omega, alpha, r)), g), mass)


def inertial_torque(S: Matrix, inertia: Matrix, omega: Vector, alpha: Vector) -> Vector:
    """Return the torque about the centre of mass, world axes, that gives a body its omega and alpha (D2). `inertia`
    is about the centre of mass and in body axes, S is the attitude of the body, and omega and alpha are in world
    axes.
    """
    to_body = transpose(S)
    body_omega = rotate(to_body, omega)
    body_momentum = rotate(inertia, body_omega)
    return rotate(S, add(rotate(inertia, rotate(to_body, alpha)), cross(body_omega, body_momentum)))


def torque_about(torque: Vector, lever: Vector, force: Vector) -> Vector:
    """Return torque + lever x force, the torque about a point P. `lever` leads from P to the point where the force
    acts, about which `torque` is given (D3, D5).
    """
    return add(torque, cross(lever, force))


def torque_from(torque: Vector, lever: Vector, force: Vector) -> Vector:
    """Return torque - lever x force, the torque about a point P. `lever` leads to P from the point where the force
    acts, about which `torque` is given.
    """
    return subtract(torque, cross(lever, force))


def world_inertia(S: Matrix, inertia: Matrix) -> Matrix:
    """Return S I S^T: a body's inertia matrix, given in body axes, in world axes."""
    return compose(compose(S, inertia), transpose(S))


def point_mass_inertia(mass: Scalar, r: Vector) -> Matrix:
    """Return the inertia matrix -m [r]x [r]x of a point mass at r, about the origin of r, as nine entries."""
    x, y, z = r
    xx, yy, zz = mass * (x * x), mass * (y * y), mass * (z * z)
    xy, yz, zx = -(mass * (x * y)), -(mass * (y * z)), -(mass * (z * x))
    return yy + zz, xy, zx, xy, zz + xx, yz, zx, yz, xx + yy


def matrix_sum(A: Matrix, B: Matrix) -> Matrix:
    """Return the sum A + B of two 3 x 3 matrices."""
    a, b, c, d, e, f, g, h, i = (x + y for x, y in zip(A, B, strict=True))
    return a, b, c, d, e, f, g, h, i


PairInertia: TypeAlias = tuple[Matrix, Vector, Scalar]
"""Inertia of a pair about a point: of alpha1 (3 x 3), its coupling with psi'', of psi''; about R1, entries of M."""


def pair_inertia(
    J: Matrix, J2: Matrix, axis: Vector, partial_velocity: Vector, mass: Scalar, lever: Vector
) -> PairInertia:
    """Return the inertia of a pair about a point as a tuple: the 3 x 3 matrix for alpha1, the vector that couples
    alpha1 and psi'', and the number for psi''. A point of mass `mass` at `lever`, whose velocity for psi' = 1 is
    partial_velocity, is added to the inertias J (both bodies) and J2 (body 2). `axis` is the hinge axis.

    About R1, the mass is body 2's mass at e, and J includes body 1's mass at r1. About the common centre, where no
    term cancels, the mass is the reduced mass m1 m2 / (m1 + m2) at e - r1.
    """
    momentum, axis_inertia = scale(partial_velocity, mass), rotate(J2, axis)
    return (
        matrix_sum(J, point_mass_inertia(mass, lever)),
        add(axis_inertia, cross(lever, momentum)),
        dot(axis, axis_inertia) + dot(partial_velocity, momentum),
    )


def angular_accelerations(inertia: PairInertia, torque: Vector, hinge_torque: Scalar) -> tuple[Vector, Scalar]:
    """Return (alpha1, psi'') from the torque about a point and the hinge torque (D6). `inertia` is the result of
    `pair_inertia` about that point.
    """
    J, coupling, hinge_inertia = inertia
    rows = (J[0], J[3], J[4], *J[6:9], *coupling, hinge_inertia)
    (ax, ay, az, psidd), _ = solve_symmetric(rows, (*torque, hinge_torque))
    return (ax, ay, az), psidd


def factor_symmetric(A: Entries) -> tuple[list[list[Scalar]], Entries]:
    """Return the entries of L below its diagonal, row by row, and the tuple of pivots D of A = L D L^T. A is
    symmetric and positive definite, given by the entries on and below its diagonal, row by row. A pivot that is known
    to be 0 is NaN.
    """
    lower: list[list[Scalar]] = []
    pivots: list[Scalar] = []
    while len(row := list(A[len(lower) * (len(lower) + 1) // 2 :][: len(lower) + 1])) > len(lower):
        size = len(lower)
        for j in range(size):
            for k in range(j):
                row[j] = row[j] - row[k] * lower[j][k]
        scaled = [row[j] / pivots[j] for j in range(size)]
        pivot = row[size]
        for j in range(size):
            pivot = pivot - row[j] * scaled[j]
        lower.append(scaled)
        pivots.append(math.nan if type(pivot) is float and pivot == 0 else pivot)
    return lower, tuple(pivots)


def solve_symmetric(A: Entries, b: Entries) -> tuple[Entries, Entries]:
    """Solve A x = b by the factorisation A = L D L^T, and return the tuple x and the tuple of pivots D; A is as for
    `factor_symmetric`.
    """
    lower, pivots = factor_symmetric(A)
    return solve_factored(lower, lambda k, part: part / pivots[k], b), pivots


def solve_factored(
    lower: Sequence[Sequence[Scalar]], divide: Callable[[int, Scalar], Scalar], b: Sequence[Scalar]
) -> Entries:
    """Return x of L D L^T x = b. `lower` are the entries of L, as of `factor_symmetric`; `divide(k, part)` divides by
    the k-th pivot of D.
    """
    size = len(b)
    x = list(b)
    for i in range(size):
        for j in range(i):
            x[i] = x[i] - lower[i][j] * x[j]
    x = [divide(k, part) for k, part in enumerate(x)]
    for i in reversed(range(size)):
        for j in range(i + 1, size):
            x[i] = x[i] - lower[j][i] * x[j]
    return tuple(x)


def hinge_torque_of(axis: Vector, torque2: Vector, r2: Vector, force2: Vector) -> Scalar:
    """Return the contribution of the force force2 at R2 and of the torque torque2 on body 2 to the hinge torque, a
    number: their moment about the hinge axis (D4). The vector r2 = S2 u2 leads from R2 to the hinge point.
    """
    return dot(axis, subtract(torque2, cross(r2, force2)))


def cayley_attitude(g: Vector, S: Matrix) -> Matrix:
    """Return S rotated by the angle 2 atan(|g| / 2) about the world vector g (Cayley's map). For small g, g is the
    rotation vector.
    """
    x, y, z = scale(g, 0.5)
    factor = 2 / (1 + (x * x + y * y + z * z))
    sx, sy, sz = factor * x, factor * y, factor * z
    turn = (
        1 - (sy * y + sz * z), sx * y - sz, sx * z + sy,
        sx * y + sz, 1 - (sx * x + sz * z), sy * z - sx,
        sx * z - sy, sy * z + sx, 1 - (sx * x + sy * y),
    )  # fmt: skip
    return compose(turn, S)


def cayley_rate(g: Vector, omega: Vector) -> Vector:
    """Return the time derivative of g for which `cayley_attitude(g, S)`, with a constant S, rotates with the angular
    velocity omega, world axes.
    """
    return add(subtract(omega, scale(cross(g, omega), 0.5)), scale(g, dot(g, omega) * 0.25))


def omega1_from_momentum(inertia: PairInertia, momentum: Vector, psid: Scalar) -> Vector:
    """Return omega1 from psi' and the angular momentum of a pair about a point (D8 solved for omega1). `inertia` is
    the result of `pair_inertia` about that point.
    """
    J, coupling, _ = inertia
    (x, y, z), _ = solve_symmetric((J[0], J[3], J[4], *J[6:9]), subtract(momentum, scale(coupling, psid)))
    return x, y, z


def pair_angular_momentum(inertia: PairInertia, omega1: Vector, psid: Scalar) -> Vector:
    """Return the angular momentum of a pair about a point that is at rest or moves with the common centre of mass
    (D8). `inertia` is the result of `pair_inertia` about that point.
    """
    J, coupling, _ = inertia
    return add(rotate(J, omega1), scale(coupling, psid))


def reference_point_rate(
    centre_rate: Vector, body1_rate: Vector, centre: Vector, partial_velocity2: Vector, psid_fraction: Scalar
) -> Vector:
    """Return v1 from the velocity of the common centre of mass, or a1 without centripetal terms from its
    acceleration. body1_rate is omega1 or alpha1, `centre` leads from R1 to the common centre of mass,
    partial_velocity2 is the velocity of body 2's centre of mass for psi' = 1, and psid_fraction is psi' or psi''
    times m2 / (m1 + m2).
    """
    return subtract(centre_rate, add(cross(body1_rate, centre), scale(partial_velocity2, psid_fraction)))
