"""Newton and Euler for both bodies, the hinge's wrench eliminated: D1-D8, as plain arithmetic on tuples of scalars.

A body brings its mass m, its centre of mass c from its reference point and its inertia I about c, both in its own
axes; what turns with a body is taken to world axes here: r_i = S_i c_i. e = d + r2 leads from R1 to the centre of
mass of body 2, h = S2 (c2 - u2) there from the hinge point, k = S1 n is the hinge axis, g gravity.

D1  f_i = m_i (a_i + alpha_i x r_i + omega_i x (omega_i x r_i) - g)       what moves the centre of mass
D2  t_i = S_i (I_i S_i^T alpha_i + S_i^T omega_i x I_i S_i^T omega_i)     what turns body i about it
D3  force = f_2, torque = t_2 + h x f_2                                   the hinge on body 2, about the hinge point
D4  hinge_torque = k . torque                                             what a motor gives; the rest constrains
D5  force1 = f_1 + f_2, torque1 = t_1 + r1 x f_1 + t_2 + e x f_2          what must act on body 1, about R1
D6  M (a1, alpha1, psi'') + bias = (force1, torque1, hinge_torque)        D1-D5, sorted by accelerations
D7  T = sum m_i v_ci^2 / 2 + omega_i . I_i omega_i / 2, U = -sum m_i g . R_ci       energies
D8  P = sum m_i v_ci, L = sum R_ci x m_i v_ci + I_i omega_i                         momenta, about the origin
"""

from __future__ import annotations

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
    """The force that moves a body's centre of mass as it moves, against gravity g (D1)."""
    return scale(subtract(add(a, point_acceleration(omega, alpha, r)), g), mass)


def inertial_torque(S: Matrix, inertia: Matrix, omega: Vector, alpha: Vector) -> Vector:
    """The torque that turns a body about its centre of mass as it turns (D2)."""
    back = transpose(S)
    spin = rotate(back, omega)
    momentum = rotate(inertia, spin)
    return rotate(S, add(rotate(inertia, rotate(back, alpha)), cross(spin, momentum)))


def torque_about(torque: Vector, lever: Vector, force: Vector) -> Vector:
    """A torque about one point, from that about another, to which the lever leads, and the force there (D3, D5)."""
    return add(torque, cross(lever, force))


def torque_from(torque: Vector, lever: Vector, force: Vector) -> Vector:
    """A torque about the point to which the lever leads, from that about its start, where the force acts."""
    return subtract(torque, cross(lever, force))


def world_inertia(S: Matrix, inertia: Matrix) -> Matrix:
    """S I S^T: a body's inertia in world axes."""
    return compose(compose(S, inertia), transpose(S))


def spread(mass: Scalar, r: Vector) -> Matrix:
    """-m [r]x [r]x: the inertia of a mass at r."""
    x, y, z = r
    xx, yy, zz = mass * (x * x), mass * (y * y), mass * (z * z)
    xy, yz, zx = -(mass * (x * y)), -(mass * (y * z)), -(mass * (z * x))
    return yy + zz, xy, zx, xy, zz + xx, yz, zx, yz, xx + yy


def matrix_sum(A: Matrix, B: Matrix) -> Matrix:
    """The sum A + B."""
    a, b, c, d, e, f, g, h, i = (x + y for x, y in zip(A, B, strict=True))
    return a, b, c, d, e, f, g, h, i


def mass_matrix(
    masses: tuple[Scalar, Scalar], r1: Vector, e: Vector, inertias: tuple[Matrix, Matrix], axis: Vector, push: Vector
) -> Entries:
    """M of D6, 7 x 7, row by row; push = k x h, the velocity of body 2's centre of mass by psi'."""
    m1, m2 = masses
    zero = 0 * m1
    total = m1 + m2
    x, y, z = add(scale(r1, m1), scale(e, m2))
    J = matrix_sum(matrix_sum(inertias[0], inertias[1]), matrix_sum(spread(m1, r1), spread(m2, e)))
    px, py, pz = scale(push, m2)
    turn = add(rotate(inertias[1], axis), cross(e, (px, py, pz)))
    last = dot(axis, rotate(inertias[1], axis)) + m2 * dot(push, push)
    return (
        total, zero, zero, zero, z, -y, px,
        zero, total, zero, -z, zero, x, py,
        zero, zero, total, y, -x, zero, pz,
        zero, -z, y, J[0], J[3], J[6], turn[0],
        z, zero, -x, J[3], J[4], J[7], turn[1],
        -y, x, zero, J[6], J[7], J[8], turn[2],
        px, py, pz, *turn, last,
    )  # fmt: skip


def accelerations(
    masses: tuple[Scalar, Scalar],
    r1: Vector,
    e: Vector,
    inertias: tuple[Matrix, Matrix],
    axis: Vector,
    push: Vector,
    force: Vector,
    torque: Vector,
    hinge_torque: Scalar,
) -> tuple[Vector, Vector, Scalar, Entries]:
    """D6 solved for a1, alpha1, psi'': what acts, less the bias, in; and how much of the inertias is left as pivots.

    a1 is eliminated by the common centre of mass c, about which no term cancels: with s = e - r1 and the reduced mass
    m1 m2 / (m1 + m2), the matrix of alpha1 and psi'' is that of a mass at s. It is 4 x 4, symmetric and positive
    definite, and factored as L D L^T.
    """
    m1, m2 = masses
    J1, J2 = inertias
    total = m1 + m2
    share = m2 / total
    apart = subtract(e, r1)
    reduced = m1 * share
    centre = add(r1, scale(apart, share))
    J = matrix_sum(matrix_sum(J1, J2), spread(reduced, apart))
    turn = add(rotate(J2, axis), scale(cross(apart, push), reduced))
    last = dot(axis, rotate(J2, axis)) + reduced * dot(push, push)
    right = (*subtract(torque, cross(centre, force)), hinge_torque - share * dot(push, force))
    (ax, ay, az, psidd), (px, py, pz, last_pivot) = solve_symmetric((J[0], J[3], J[4], *J[6:9], *turn, last), right)
    alpha1 = (ax, ay, az)
    moved = add(cross(alpha1, centre), scale(push, share * psidd))
    of = last + (J2[0] + J2[4] + J2[8])
    kept = (px / J[0], py / J[4], pz / J[8], last_pivot / of)
    return subtract(scale(force, 1 / total), moved), alpha1, psidd, kept


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
    """T of one body (D7): of its centre's velocity, and of its spin and inertia in the same axes."""
    return (mass * dot(velocity, velocity) + dot(spin, rotate(inertia, spin))) * 0.5


def point_velocity(v: Vector, omega: Vector, r: Vector) -> Vector:
    """Velocity of a body's point: v + omega x r."""
    return add(v, cross(omega, r))


def angular_momentum(mass: Scalar, R: Vector, velocity: Vector, inertia: Matrix, omega: Vector) -> Vector:
    """L of one body about the origin (D8): R leads to its centre of mass, whose velocity it is."""
    return add(cross(R, scale(velocity, mass)), rotate(inertia, omega))


def hinge_torque_of(axis: Vector, torque2: Vector, r2: Vector, force2: Vector) -> Scalar:
    """What a force and a torque on body 2, about its reference point, turn about the hinge; r2 = S2 u2 (D4)."""
    return dot(axis, subtract(torque2, cross(r2, force2)))


def kinetic_of_both(
    masses: tuple[Scalar, Scalar],
    velocities: tuple[Vector, Vector],
    spins: tuple[Vector, Vector],
    inertias: tuple[Matrix, Matrix],
) -> Scalar:
    """T (D7), of the centres' velocities and of what the bodies turn."""
    one, two = map(kinetic_energy, masses, velocities, spins, inertias)
    return one + two


def potential_energy(masses: tuple[Scalar, Scalar], gravity: Vector, at1: Vector, at2: Vector) -> Scalar:
    """U (D7); at1, at2 lead from the origin to the centres of mass."""
    return -(masses[0] * dot(gravity, at1) + masses[1] * dot(gravity, at2))


def linear_momentum(masses: tuple[Scalar, Scalar], velocities: tuple[Vector, Vector]) -> Vector:
    """P (D8), of the centres' velocities."""
    return add(scale(velocities[0], masses[0]), scale(velocities[1], masses[1]))


def cayley_attitude(g: Vector, S: Matrix) -> Matrix:
    """S turned by 2 atan(|g| / 2) about g, world axes (Cayley's map): near 0, g is the rotation vector."""
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
    """The rate of g where `cayley_attitude` turns with omega, world axes."""
    return add(subtract(omega, scale(cross(g, omega), 0.5)), scale(g, dot(g, omega) * 0.25))


def common_centre(masses: tuple[Scalar, Scalar], r1: Vector, e: Vector) -> Vector:
    """From R1 to the centre of mass of both bodies."""
    return add(r1, scale(subtract(e, r1), masses[1] / (masses[0] + masses[1])))


def spin_of_momentum(
    masses: tuple[Scalar, Scalar],
    r1: Vector,
    e: Vector,
    inertias: tuple[Matrix, Matrix],
    axis: Vector,
    push: Vector,
    momentum: Vector,
    psid: Scalar,
) -> Vector:
    """omega1 from the angular momentum about the common centre of mass (D8 solved)."""
    m1, m2 = masses
    reduced = m1 * m2 / (m1 + m2)
    apart = subtract(e, r1)
    J = matrix_sum(matrix_sum(inertias[0], inertias[1]), spread(reduced, apart))
    turn = add(rotate(inertias[1], axis), scale(cross(apart, push), reduced))
    (x, y, z), _ = solve_symmetric((J[0], J[3], J[4], *J[6:9]), subtract(momentum, scale(turn, psid)))
    return x, y, z


def momentum_about(
    masses: tuple[Scalar, Scalar],
    r1: Vector,
    e: Vector,
    inertias: tuple[Matrix, Matrix],
    omega: tuple[Vector, Vector],
    push: Vector,
    psid: Scalar,
) -> Vector:
    """The angular momentum about the common centre of mass; omega of both bodies (D8)."""
    m1, m2 = masses
    apart = subtract(e, r1)
    speed = add(cross(omega[0], apart), scale(push, psid))
    spins = add(rotate(inertias[0], omega[0]), rotate(inertias[1], omega[1]))
    return add(spins, scale(cross(apart, speed), m1 * m2 / (m1 + m2)))


def velocity_from_centre(
    masses: tuple[Scalar, Scalar], centre: Vector, omega1: Vector, push: Vector, psid: Scalar
) -> Vector:
    """From the velocity of R1 to that of the common centre of mass; centre leads there."""
    return add(cross(omega1, centre), scale(push, masses[1] / (masses[0] + masses[1]) * psid))


def driven_acceleration(
    m2: Scalar, J2: Matrix, axis: Vector, push: Vector, hinge_torque: Scalar, bias: Scalar
) -> Scalar:
    """Psi'' where body 1 moves as given: D4 solved; bias is the hinge torque of psi'' = 0."""
    return (hinge_torque - bias) / (dot(axis, rotate(J2, axis)) + m2 * dot(push, push))
