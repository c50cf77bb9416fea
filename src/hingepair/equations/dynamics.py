"""Newton and Euler for both bodies, the hinge's wrench eliminated: D1-D8, as plain arithmetic on tuples of scalars.

A body brings its mass m, its centre of mass c from its reference point and its inertia I about c, both in its own
axes; what turns with a body is taken to world axes here: r_i = S_i c_i. e = d + r2 leads from R1 to the centre of
mass of body 2, h = S2 (c2 - u2) there from the hinge point, k = S1 n is the hinge axis, g gravity.

D1  f_i = m_i (a_i + alpha_i x r_i + omega_i x (omega_i x r_i) - g)       what moves the centre of mass
D2  t_i = S_i (I_i S_i^T alpha_i + S_i^T omega_i x I_i S_i^T omega_i)     what turns body i about it
D3  force = f_2, torque = t_2 + h x f_2                                   the hinge on body 2, about the hinge point
D4  hinge_torque = k . torque                                             motor, spring, stops...; the rest constrains
D5  force1 = f_1 + f_2, torque1 = t_1 + r1 x f_1 + t_2 + e x f_2          what must act on body 1, about R1
D6  M (a1, alpha1, psi'') + bias = (force1, torque1, hinge_torque)        D1-D5, sorted by accelerations
D7  T = sum m_i v_ci^2 / 2 + omega_i . I_i omega_i / 2, U = -sum m_i g . R_ci       energies
D8  P = sum m_i v_ci, L = sum R_ci x m_i v_ci + I_i omega_i                         momenta, about the origin
"""

from __future__ import annotations

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
    """Return the force m (a_c - g) that the acceleration of a body's centre of mass requires (D1)."""
    return scale(subtract(add(a, point_acceleration(omega, alpha, r)), g), mass)


def inertial_torque(S: Matrix, inertia: Matrix, omega: Vector, alpha: Vector) -> Vector:
    """Return the torque about its centre of mass that the rotation of a body requires (D2, Euler's equation)."""
    back = transpose(S)
    spin = rotate(back, omega)
    momentum = rotate(inertia, spin)
    return rotate(S, add(rotate(inertia, rotate(back, alpha)), cross(spin, momentum)))


def torque_about(torque: Vector, lever: Vector, force: Vector) -> Vector:
    """Return a torque about a point from that about another, where the force acts, at the lever (D3, D5)."""
    return add(torque, cross(lever, force))


def torque_from(torque: Vector, lever: Vector, force: Vector) -> Vector:
    """Return a torque about the point to which the lever leads, from that about its start, where the force acts."""
    return subtract(torque, cross(lever, force))


def world_inertia(S: Matrix, inertia: Matrix) -> Matrix:
    """Return S I S^T, a body's inertia in world axes."""
    return compose(compose(S, inertia), transpose(S))


def spread(mass: Scalar, r: Vector) -> Matrix:
    """Return -m [r]x [r]x, the inertia of a mass at r."""
    x, y, z = r
    xx, yy, zz = mass * (x * x), mass * (y * y), mass * (z * z)
    xy, yz, zx = -(mass * (x * y)), -(mass * (y * z)), -(mass * (z * x))
    return yy + zz, xy, zx, xy, zz + xx, yz, zx, yz, xx + yy


def matrix_sum(A: Matrix, B: Matrix) -> Matrix:
    """Return the sum A + B."""
    a, b, c, d, e, f, g, h, i = (x + y for x, y in zip(A, B, strict=True))
    return a, b, c, d, e, f, g, h, i


Resistance: TypeAlias = tuple[Matrix, Vector, Scalar]
"""What resists alpha1 and psi'' about a point: by alpha1, by both, by psi'' (the lower right of M, if that is R1)."""


def resistance(J: Matrix, J2: Matrix, axis: Vector, push: Vector, mass: Scalar, lever: Vector) -> Resistance:
    """Return the resistance of a body about a point: its inertia J, and a mass at a lever that psi' moves by push.

    About R1, that is body 2's mass at e, J with body 1's at r1; about the common centre, where no term cancels, the
    reduced mass m1 m2 / (m1 + m2) at e - r1.
    """
    pushed, own = scale(push, mass), rotate(J2, axis)
    return matrix_sum(J, spread(mass, lever)), add(own, cross(lever, pushed)), dot(axis, own) + dot(push, pushed)


def mass_matrix(m1: Scalar, m2: Scalar, r1: Vector, e: Vector, push: Vector, about: Resistance) -> Entries:
    """Return M of D6 about R1, 7 x 7, row by row; push = k x h is the velocity of body 2's centre for psi' = 1."""
    zero = 0 * m1
    total = m1 + m2
    x, y, z = add(scale(r1, m1), scale(e, m2))
    px, py, pz = scale(push, m2)
    J, turn, last = about
    return (
        total, zero, zero, zero, z, -y, px,
        zero, total, zero, -z, zero, x, py,
        zero, zero, total, y, -x, zero, pz,
        zero, -z, y, J[0], J[3], J[6], turn[0],
        z, zero, -x, J[3], J[4], J[7], turn[1],
        -y, x, zero, J[6], J[7], J[8], turn[2],
        px, py, pz, *turn, last,
    )  # fmt: skip


def turning(about: Resistance, J2: Matrix, torque: Vector, hinge_torque: Scalar) -> tuple[Vector, Scalar, Entries]:
    """Return alpha1 and psi'' from the loads about a point, and the shares of the inertias left as pivots (D6).

    4 x 4, symmetric and positive definite, factored as L D L^T.
    """
    J, turn, last = about
    (ax, ay, az, psidd), (px, py, pz, rest) = solve_symmetric(
        (J[0], J[3], J[4], *J[6:9], *turn, last), (*torque, hinge_torque)
    )
    kept = (px / J[0], py / J[4], pz / J[8], rest / (last + (J2[0] + J2[4] + J2[8])))
    return (ax, ay, az), psidd, kept


def solve_symmetric(A: Entries, b: Entries) -> tuple[Entries, Entries]:
    """Solve A x = b for a symmetric positive definite A, by L D L^T; A is its lower half, row by row; x and D."""
    size = len(b)
    lower: list[list[Scalar]] = []
    pivots: list[Scalar] = []
    for i in range(size):
        row = list(A[i * (i + 1) // 2 : (i + 1) * (i + 2) // 2])
        for j in range(i):
            for k in range(j):
                row[j] = row[j] - row[k] * lower[j][k]
        scaled = [row[j] / pivots[j] for j in range(i)]
        pivot = row[i]
        for j in range(i):
            pivot = pivot - row[j] * scaled[j]
        lower.append(scaled)
        pivots.append(pivot)
    x = list(b)
    for i in range(size):
        for j in range(i):
            x[i] = x[i] - lower[i][j] * x[j]
    x = [part / pivot for part, pivot in zip(x, pivots, strict=True)]
    for i in reversed(range(size)):
        for j in range(i + 1, size):
            x[i] = x[i] - lower[j][i] * x[j]
    return tuple(x), tuple(pivots)


def kinetic_energy(mass: Scalar, velocity: Vector, spin: Vector, inertia: Matrix) -> Scalar:
    """Return T of one body (D7), from its centre's velocity and from its spin and inertia in the same axes."""
    return (mass * dot(velocity, velocity) + dot(spin, rotate(inertia, spin))) * 0.5


def point_velocity(v: Vector, omega: Vector, r: Vector) -> Vector:
    """Return the velocity of a body's point, v + omega x r."""
    return add(v, cross(omega, r))


def angular_momentum(mass: Scalar, R: Vector, velocity: Vector, inertia: Matrix, omega: Vector) -> Vector:
    """Return L of one body about the origin (D8); R leads to its centre of mass, whose velocity is given."""
    return add(cross(R, scale(velocity, mass)), rotate(inertia, omega))


def hinge_torque_of(axis: Vector, torque2: Vector, r2: Vector, force2: Vector) -> Scalar:
    """Return the part of a force and torque on body 2 that turns it about the hinge; r2 = S2 u2 (D4)."""
    return dot(axis, subtract(torque2, cross(r2, force2)))


def potential_energy(m1: Scalar, at1: Vector, m2: Scalar, at2: Vector, gravity: Vector) -> Scalar:
    """Return U (D7); at1, at2 lead from the origin to the centres of mass."""
    return -(m1 * dot(gravity, at1) + m2 * dot(gravity, at2))


def linear_momentum(m1: Scalar, v1: Vector, m2: Scalar, v2: Vector) -> Vector:
    """Return P from the centres' velocities (D8)."""
    return add(scale(v1, m1), scale(v2, m2))


def cayley_attitude(g: Vector, S: Matrix) -> Matrix:
    """Return S turned by 2 atan(|g| / 2) about g, world axes (Cayley's map); near 0, g is the rotation vector."""
    x, y, z = scale(g, 0.5)
    share = 2 / (1 + (x * x + y * y + z * z))
    sx, sy, sz = share * x, share * y, share * z
    turn = (
        1 - (sy * y + sz * z), sx * y - sz, sx * z + sy,
        sx * y + sz, 1 - (sx * x + sz * z), sy * z - sx,
        sx * z - sy, sy * z + sx, 1 - (sx * x + sy * y),
    )  # fmt: skip
    return compose(turn, S)


def cayley_rate(g: Vector, omega: Vector) -> Vector:
    """Return the rate of g where `cayley_attitude` turns with omega, world axes."""
    return add(subtract(omega, scale(cross(g, omega), 0.5)), scale(g, dot(g, omega) * 0.25))


def spin_of_momentum(about: Resistance, momentum: Vector, psid: Scalar) -> Vector:
    """Return omega1 from the angular momentum about a point (D8 solved)."""
    J, turn, _ = about
    (x, y, z), _ = solve_symmetric((J[0], J[3], J[4], *J[6:9]), subtract(momentum, scale(turn, psid)))
    return x, y, z


def momentum_about(about: Resistance, omega1: Vector, psid: Scalar) -> Vector:
    """Return the angular momentum about a point at rest, or moving with the common centre (D8)."""
    J, turn, _ = about
    return add(rotate(J, omega1), scale(turn, psid))


def from_centre(at_centre: Vector, turn: Vector, centre: Vector, push: Vector, drift: Scalar) -> Vector:
    """Return the acceleration of R1 from that of the common centre, while body 1 turns and the hinge moves it."""
    return subtract(at_centre, add(cross(turn, centre), scale(push, drift)))
