"""Trees of joints, T1-T14, as plain arithmetic on tuples of scalars: each body in its own axes.

Body 0 is the base, body k >= 1 is what joint k moves, p is its parent. The z axis of body k is the axis of joint k,
and its reference point lies on it. A joint turns its body about the axis by c q and shifts it along the axis by e q:
c, e = 1, 0 of a hinge, 0, 1 of a slider, 1, h of a screw with the pitch h (`equations.joints`). Q = S Sz(c q) turns
the axes of body k into those of its parent, and r = u + S e_z e q leads from the parent's reference point to its own,
in the parent's axes.
Of the matter of a body count its mass m, its first moment h = m c and its second moment N = sum of m_i r_i r_i^T,
about the reference point, so that its inertia is J = tr(N) - N. g is gravity. A symmetric matrix is the tuple of its
entries (xx, xy, xz, yy, yz, zz).

T1  omega_k = Q^T omega_p + e_z c q', alpha_k = Q^T alpha_p + omega_k x e_z c q' + e_z c q''        (E2, E9)
    a_k = Q^T (a_p + B_p r) + 2 omega_k x e_z e q' + e_z e q'', B = [alpha]x + [omega]x^2
    from the base: omega_0 = S1^T omega1, alpha_0 = S1^T alpha1, a_0 = S1^T (a1 - g)
T2  f_k = m a_k + B h, t_k = h x a_k + sum of r_i x B r_i m_i, about the reference point     (D1, D2)
T3  f_p += Q f_k, t_p += Q t_k + r x Q f_k;  tau_k = e_z . (c t_k + e f_k)                         (D3, D4)
T4  M_ki = tau_i of the matter beyond joint k, moved by q_k'' = 1 alone: m, h, N summed inward as m_p += m_k,
    h_p += Q h_k + m_k r, N_p += Q N_k Q^T + r (Q h_k)^T + (Q h_k) r^T + m_k r r^T          (D6; composite bodies)
T5  [t f] = [J H; H^T M] [alpha a]: what resists where the joints beyond give way; of one body H = [h]x, M = m.
    Joint k takes the column U of its axis and D = e_z . U: inward goes I - U U^T / D       (articulated bodies)
T6  q_k'' = (tau_k - tau_k(q'' = 0) - what comes from beyond - U . (alpha, a) from the parent) / D
T7  kinetic energy m v^2 / 2 + v . (omega x h) + omega . J omega / 2, potential energy -g . (m R + S h)        (D7)
T8  P = m v + omega x h, L = h x v + J omega, about the reference point; inward as in T3     (D8)
T9  matter on a hinge's axis moves with both bodies: it is counted with the parent, so that m = 0, h . e_z = 0 and
    N_zz = 0 beyond a hinge; of a slider N is the parent's, of a screw nothing. Nothing above changes by it.
T10 a geared rotor turns with its joint only, with the inertia I (armature) referred to the joint: it adds I q_k'' to
    tau_k, I to M_kk and to D, I q_k'^2 / 2 to the kinetic energy. The body's own motion is not felt by it.
T11 dq'' = M^-1 (dtau - dtau(q, q', q'')), where the last change is that of inverse dynamics at constant q''
T12 A_k = (P, L about the centre of mass c) of the matter beyond joint k, moved by q_k' = 1 alone; in world axes
T13 tau = Y p with m, h and J of all bodies as p: Y is the derivative
T14 tau + l = M q'' + bias, with the load l = -k (q - rest) - d q' - f sign(q') of a joint's spring, damper, friction

T1-T3: Luh, Walker, Paul, On-line computational scheme for mechanical manipulators, 1980; T4-T6: Featherstone, Rigid
Body Dynamics Algorithms, 2008; T9: Gautier, Khalil, Direct calculation of minimum set of inertial parameters, 1990.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple, TypeAlias

from hingepair.equations.joints import HINGE, SLIDER, Axis
from hingepair.equations.spatial import (
    WORLD_UNIT_VECTORS,
    ZERO_VECTOR,
    Matrix,
    Scalar,
    Vector,
    add,
    angular_acceleration2,
    compose,
    cross,
    dot,
    point_acceleration,
    rotate,
    scale,
    subtract,
    transpose,
)

Symmetric: TypeAlias = tuple[Scalar, Scalar, Scalar, Scalar, Scalar, Scalar]
Turn: TypeAlias = tuple[Scalar, Scalar]  # (sin q, cos q)


class Link(NamedTuple):
    """A joint and the body that it moves; joint k and its body have the number k, from 1 on."""

    parent: int  # number of the body that carries it
    axis: Axis
    S: Matrix  # attitude of its body at q = 0, in the parent's axes
    u: Vector  # its point in the parent's axes
    mass: Scalar
    first: Vector  # h of its body
    second: Symmetric  # N of its body
    armature: Scalar  # I of its motor's rotor (T10)


class JointLoad(NamedTuple):
    """Spring, damper and dry friction of a joint (T14)."""

    stiffness: Scalar  # k
    rest: Scalar  # q at which the spring exerts nothing
    damping: Scalar  # d
    friction: Scalar  # f


class Base(NamedTuple):
    """The base of a tree (body 0), in its own axes and about its reference point."""

    mass: Scalar
    first: Vector  # h
    second: Symmetric  # N


class Placement(NamedTuple):
    """Pose of a joint's body in its parent: the rotation is S Sz(c q), and r the position of the reference point."""

    S: Matrix
    turn: Turn | None  # (sin c q, cos c q); None of a joint that does not turn
    r: Vector


# ---- turns about the joint's own axis, the z axis


def turned(turn: Turn, v: Vector) -> Vector:
    """Return Sz(q) v, the vector v rotated about z by q, where turn = (sin q, cos q)."""
    s, c = turn
    return c * v[0] - s * v[1], s * v[0] + c * v[1], v[2]


def turned_back(turn: Turn, v: Vector) -> Vector:
    """Return Sz(q)^T v, the vector v rotated about z by -q, where turn = (sin q, cos q)."""
    s, c = turn
    return c * v[0] + s * v[1], c * v[1] - s * v[0], v[2]


def turned_columns(A: Matrix, turn: Turn) -> Matrix:
    """Return A Sz(q), the product of a matrix A and the rotation by q about z, as nine entries by rows; `turn` is
    (sin q, cos q).
    """
    s, c = turn
    return (
        c * A[0] + s * A[1], c * A[1] - s * A[0], A[2],
        c * A[3] + s * A[4], c * A[4] - s * A[3], A[5],
        c * A[6] + s * A[7], c * A[7] - s * A[6], A[8],
    )  # fmt: skip


def to_parent(placement: Placement, v: Vector) -> Vector:
    """Return Q v, with the rotation Q of the placement: v in the body's axes, converted to the parent's."""
    return rotate(placement.S, v if placement.turn is None else turned(placement.turn, v))


def to_child(placement: Placement, v: Vector) -> Vector:
    """Return Q^T v, with the rotation Q of the placement: v in the parent's axes, converted to the body's."""
    back = rotate(transpose(placement.S), v)
    return back if placement.turn is None else turned_back(placement.turn, back)


def joint_placements(links: Sequence[Link], turns: Sequence[Turn | None], q: Sequence[Scalar]) -> list[Placement]:
    """Return the `Placement` of each joint from its q and (sin c q, cos c q), or None if it does not turn."""
    placements = []
    for link, turn, value in zip(links, turns, q, strict=True):
        r = add(link.u, scale(link.S[2::3], link.axis.shift(value))) if link.axis.shifts else link.u
        placements.append(Placement(link.S, turn, r))
    return placements


# ---- kinematics, world axes


class Pose(NamedTuple):
    """Pose of a body or a frame in world axes: its attitude S, the vector d from the base's reference point to its
    own, and the vector `arm` from the reference point of the parent body to its own.
    """

    S: Matrix
    d: Vector
    arm: Vector


def axis_of(pose: Pose) -> Vector:
    """Return the axis of the joint that moves a body, which is the z axis of the body, in world axes."""
    return pose.S[2], pose.S[5], pose.S[8]


def poses(links: Sequence[Link], placements: Sequence[Placement], S1: Matrix) -> list[Pose]:
    """Return a list of the poses of all bodies, the base first, from the placements of the joints and the attitude S1
    of the base (E5, E7 with u2 = 0).
    """
    bodies = [Pose(S1, ZERO_VECTOR, ZERO_VECTOR)]
    for link, joint in zip(links, placements, strict=True):
        p = bodies[link.parent]
        arm = rotate(p.S, joint.r)
        S = compose(p.S, joint.S)
        bodies.append(Pose(S if joint.turn is None else turned_columns(S, joint.turn), add(p.d, arm), arm))
    return bodies


Rates: TypeAlias = tuple[Vector, Vector]
"""Velocity, or acceleration, of the reference point, and the angular one."""


def body_velocities(
    links: Sequence[Link], body_poses: Sequence[Pose], qd: Sequence[Scalar], base_velocity: Rates
) -> list[Rates]:
    """Return a list of (v, omega) of all bodies, world axes, the base first (E2, E8). body_poses begins with the
    base, qd holds the rates of the joints, and base_velocity is (v, omega) of the base.
    """
    velocities = [base_velocity]
    for link, body, rate in zip(links, body_poses[1:], qd, strict=True):
        v, omega = velocities[link.parent]
        v = add(v, cross(omega, body.arm))
        if link.axis.shifts:
            v = add(v, scale(axis_of(body), link.axis.shift(rate)))
        if link.axis.turns:
            omega = add(omega, scale(axis_of(body), link.axis.turn(rate)))
        velocities.append((v, omega))
    return velocities


def body_accelerations(
    links: Sequence[Link],
    body_poses: Sequence[Pose],
    qd: Sequence[Scalar],
    qdd: Sequence[Scalar],
    velocities: Sequence[Rates],
    base_acceleration: Rates,
) -> list[Rates]:
    """Return a list of (a, alpha) of all bodies, world axes, the base first (E9); a is the classical acceleration.
    `velocities` is the list of (v, omega) of all bodies, and base_acceleration is (a, alpha) of the base.
    """
    changes = [base_acceleration]
    for link, body, rate, rate_change in zip(links, body_poses[1:], qd, qdd, strict=True):
        (a, alpha), omega = changes[link.parent], velocities[link.parent][1]
        a = add(a, point_acceleration(omega, alpha, body.arm))
        axis = axis_of(body)
        if link.axis.shifts:
            half = scale(cross(omega, axis), link.axis.shift(rate))
            a = add(a, add(scale(axis, link.axis.shift(rate_change)), add(half, half)))
        if link.axis.turns:
            alpha = angular_acceleration2(alpha, omega, axis, link.axis.turn(rate), link.axis.turn(rate_change))
        changes.append((a, alpha))
    return changes


def frame_pose(body: Pose, R: Vector, S: Matrix) -> Pose:
    """Return the `Pose`, in world axes, of a frame that is fixed in a body, at the position R and with the axes S,
    both in body axes (E7). `body` is the `Pose` of the body.
    """
    arm = rotate(body.S, R)
    return Pose(compose(body.S, S), add(body.d, arm), arm)


def frame_velocity(frame: Pose, body: Rates) -> Rates:
    """Return (v, omega) of a frame from its pose and (v, omega) of its body, world axes (E8)."""
    v, omega = body
    return add(v, cross(omega, frame.arm)), omega


def frame_acceleration(frame: Pose, omega: Vector, body: Rates) -> Rates:
    """Return (a, alpha) of a frame from its pose, and from omega and (a, alpha) of its body, world axes (E9)."""
    a, alpha = body
    return add(a, point_acceleration(omega, alpha, frame.arm)), alpha


def joints_to_base(links: Sequence[Link], body: int) -> set[int]:
    """Return the set of the numbers of the joints on the path from the body with this number to the base."""
    numbers = set()
    while body:
        numbers.add(body)
        body = links[body - 1].parent
    return numbers


def point_jacobian_columns(
    links: Sequence[Link], body_poses: Sequence[Pose], body: int, d: Vector
) -> list[tuple[Vector, Vector]]:
    """Return a list with one pair (v, omega) for each joint, world axes: the velocity of a point of a body for q' = 1
    of this joint alone, zero for joints that do not move the body (E2, E8). `body` is the number of the body, and d
    leads from R1 of the base to the point.
    """
    on_path = joints_to_base(links, body)
    columns = []
    for number, link in enumerate(links, 1):
        v = omega = ZERO_VECTOR
        axis = axis_of(body_poses[number])
        if number in on_path and link.axis.turns:
            omega = scale(axis, link.axis.turn(1.0))
            v = cross(omega, subtract(d, body_poses[number].d))
        if number in on_path and link.axis.shifts:
            along = scale(axis, link.axis.shift(1.0))
            v = add(v, along) if link.axis.turns else along
        columns.append((v, omega))
    return columns


def base_jacobian_columns(d: Vector) -> list[tuple[Vector, Vector]]:
    """Return a list of six pairs (v, omega), the velocities of a point for unit v1 along each world axis, then for
    unit omega1 about each world axis, of the base (E8). The vector d leads from R1 of the base to the point.
    """
    x, y, z = d
    units = WORLD_UNIT_VECTORS
    turning = ((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0))
    return [*((unit, ZERO_VECTOR) for unit in units), *zip(turning, units, strict=True)]


# ---- symmetric matrices


def symmetric_sum(A: Symmetric, B: Symmetric) -> Symmetric:
    """Return the sum A + B of two symmetric matrices of six entries."""
    return A[0] + B[0], A[1] + B[1], A[2] + B[2], A[3] + B[3], A[4] + B[4], A[5] + B[5]


def full_matrix(A: Symmetric) -> Matrix:
    """Return all nine entries of a symmetric matrix given by six entries."""
    xx, xy, xz, yy, yz, zz = A
    return xx, xy, xz, xy, yy, yz, xz, yz, zz


def inertia_from_moment(second: Symmetric) -> Symmetric:
    """Return the inertia matrix J = tr(N) - N from the second moment N; both have six entries."""
    xx, xy, xz, yy, yz, zz = second
    return yy + zz, -xy, -xz, xx + zz, -yz, xx + yy


def conjugate(S: Matrix, A: Symmetric) -> Symmetric:
    """Return S A S^T, the symmetric matrix A converted to other axes, as six entries."""
    T = compose(S, full_matrix(A))
    rows, S_rows = (T[0:3], T[3:6], T[6:9]), (S[0:3], S[3:6], S[6:9])
    xx, xy, xz, yy, yz, zz = (dot(rows[i], S_rows[j]) for i, j in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)))
    return xx, xy, xz, yy, yz, zz


def turned_symmetric(turn: Turn, A: Symmetric) -> Symmetric:
    """Return Sz(q) A Sz(q)^T for a symmetric matrix A, as six entries, where turn = (sin q, cos q)."""
    s, c = turn
    xx, xy, xz, yy, yz, zz = A
    cc, cs, ss = c * c, c * s, s * s
    twice = cs + cs
    return (
        cc * xx - twice * xy + ss * yy, cs * (xx - yy) + (cc - ss) * xy, c * xz - s * yz,
        ss * xx + twice * xy + cc * yy, s * xz + c * yz, zz,
    )  # fmt: skip


def symmetric_to_parent(placement: Placement, A: Symmetric) -> Symmetric:
    """Return Q A Q^T, with the rotation Q of the placement: A in the body's axes, converted to the parent's."""
    return conjugate(placement.S, A if placement.turn is None else turned_symmetric(placement.turn, A))


def outer_sum(a: Vector, b: Vector) -> Symmetric:
    """Return the symmetric matrix a b^T + b a^T, as six entries."""
    xx, yy, zz = a[0] * b[0], a[1] * b[1], a[2] * b[2]
    return (
        xx + xx, a[0] * b[1] + a[1] * b[0], a[0] * b[2] + a[2] * b[0],
        yy + yy, a[1] * b[2] + a[2] * b[1], zz + zz,
    )  # fmt: skip


# ---- inverse dynamics


class Acceleration(NamedTuple):
    """The motion of a body from which its inertial wrench follows, in body axes: the angular velocity omega, the
    acceleration `a` of its reference point less gravity, the matrix B = [alpha]x + [omega]x^2 (T1), and the angular
    acceleration alpha.
    """

    omega: Vector
    a: Vector
    B: Matrix
    alpha: Vector


def acceleration_gradient(omega: Vector, alpha: Vector) -> Matrix:
    """Return the matrix B = [alpha]x + [omega]x^2. A point of the body at r from the reference point has the
    acceleration B r relative to it (T1).
    """
    x, y, z = omega
    u, v, w = alpha
    xx, yy, zz = x * x, y * y, z * z
    return (
        -(yy + zz), x * y - w, x * z + v,
        x * y + w, -(zz + xx), y * z - u,
        x * z - v, y * z + u, -(xx + yy),
    )  # fmt: skip


def accelerations_in_own_axes(
    links: Sequence[Link],
    placements: Sequence[Placement],
    qd: Sequence[Scalar],
    qdd: Sequence[Scalar],
    omega: Vector,
    alpha: Vector,
    a: Vector,
) -> list[Acceleration]:
    """Return a list of the `Acceleration` of all bodies, each in the axes of its body, the base first (T1). omega,
    alpha and a describe the motion of the base, in base axes; a is its acceleration less gravity.
    """
    motions = [Acceleration(omega, a, acceleration_gradient(omega, alpha), alpha)]
    for link, joint, rate, rate_change in zip(links, placements, qd, qdd, strict=True):
        p = motions[link.parent]
        a_body = to_child(joint, add(p.a, rotate(p.B, joint.r)))
        x, y, z = to_child(joint, p.omega)
        u, v, w = to_child(joint, p.alpha)
        if link.axis.shifts:
            shift = link.axis.shift(rate)
            half = (y * shift, -(x * shift))
            a_body = add(a_body, (half[0] + half[0], half[1] + half[1], link.axis.shift(rate_change)))
        if link.axis.turns:
            turn = link.axis.turn(rate)
            z = z + turn
            u, v, w = u + y * turn, v - x * turn, w + link.axis.turn(rate_change)
        motions.append(Acceleration((x, y, z), a_body, acceleration_gradient((x, y, z), (u, v, w)), (u, v, w)))
    return motions


Wrench: TypeAlias = tuple[Vector, Vector]
"""Force, and torque about the reference point, in a body's own axes."""


def inertial_wrench(mass: Scalar, first_moment: Vector, second_moment: Symmetric, motion: Acceleration) -> Wrench:
    """Return the pair (force, torque) that gives a body its motion, an `Acceleration`, in body axes (T2). The torque
    is about the body's reference point.
    """
    B, a = motion.B, motion.a
    xx, xy, xz, yy, yz, zz = second_moment
    force = add(scale(a, mass), rotate(B, first_moment))
    torque = (
        (B[8] - B[4]) * yz + B[7] * yy - B[5] * zz + B[6] * xy - B[3] * xz,
        (B[0] - B[8]) * xz + B[2] * zz - B[6] * xx + B[1] * yz - B[7] * xy,
        (B[4] - B[0]) * xy + B[3] * xx - B[1] * yy + B[5] * xz - B[2] * yz,
    )
    return force, add(torque, cross(first_moment, a))


def sum_inward(
    links: Sequence[Link], placements: Sequence[Placement], body_wrenches: Iterable[Wrench]
) -> list[Wrench]:
    """Return a list of the wrenches (force, torque) that the joints transmit, in the axes of their bodies, the total
    wrench on the base first. body_wrenches are the wrenches on the single bodies, the base first (T3).
    """
    sums = list(body_wrenches)
    for number in range(len(links), 0, -1):
        link, joint, (force, torque) = links[number - 1], placements[number - 1], sums[number]
        force_to_parent = to_parent(joint, force)
        f, t = sums[link.parent]
        sums[link.parent] = (
            add(f, force_to_parent),
            add(t, add(to_parent(joint, torque), cross(joint.r, force_to_parent))),
        )
    return sums


def driving_efforts(links: Sequence[Link], wrenches: Sequence[Wrench], qdd: Sequence[Scalar]) -> list[Scalar]:
    """Return a list with the effort of each joint's motor: the sum of the wrench's component along the axis and of
    armature times q'', the inertial effort of the motor's own rotor (T3, T10). `wrenches` begins with the wrench on
    the base.
    """
    joints = zip(links, wrenches[1:], qdd, strict=True)
    return [link.axis.effort(*wrench) + link.armature * change for link, wrench, change in joints]


def spring_and_damper_effort(load: JointLoad, q: Scalar, qd: Scalar) -> Scalar:
    """Return the effort of the spring and the damper of a joint at the coordinate q and the rate q' (T14)."""
    return load.stiffness * (load.rest - q) - load.damping * qd


def inertial_wrenches(base: Base, links: Sequence[Link], motions: Sequence[Acceleration]) -> list[Wrench]:
    """Return a list of the wrenches (force, torque) that give each body alone its motion, in the axes of the body,
    the base first (T2). `motions` is the list of the `Acceleration` of all bodies.
    """
    return [
        inertial_wrench(body.mass, body.first, body.second, motion)
        for body, motion in zip(_bodies(base, links), motions, strict=True)
    ]


def _bodies(base: Base, links: Sequence[Link]) -> list[Any]:
    """Return the base and the links, in the order of the body numbers."""
    return [base, *links]


# ---- composite bodies


class Matter(NamedTuple):
    """Mass, first moment h, second moment N of one or several bodies, about a body's reference point in its axes."""

    mass: Scalar
    first: Vector
    second: Symmetric


def with_carried(parent: Matter, joint: Placement, subtree: Matter) -> Matter:
    """Return the `Matter` of a body together with that which a joint carries (T4)."""
    first = to_parent(joint, subtree.first)
    carried = scale(joint.r, subtree.mass)
    second = symmetric_sum(
        symmetric_to_parent(joint, subtree.second), outer_sum(joint.r, add(first, scale(carried, 0.5)))
    )
    return Matter(
        parent.mass + subtree.mass, add(parent.first, add(first, carried)), symmetric_sum(parent.second, second)
    )


def composites(base: Base, links: Sequence[Link], placements: Sequence[Placement]) -> list[Matter]:
    """Return a list of the `Matter` of composite bodies, the base first: each body together with all bodies that it
    carries, in the axes of that body (T4).
    """
    matter = [Matter(body.mass, body.first, body.second) for body in _bodies(base, links)]
    for number in range(len(links), 0, -1):
        parent = links[number - 1].parent
        matter[parent] = with_carried(matter[parent], placements[number - 1], matter[number])
    return matter


def axis_wrench(axis: Axis, matter: Matter) -> Wrench:
    """Return the (force, torque), in body axes, that gives a body of this `Matter` q'' = 1 of a joint alone (T4)."""
    x, y, _ = matter.first
    xx, _, xz, yy, yz, _ = matter.second
    force, torque = ZERO_VECTOR, ZERO_VECTOR
    if axis.turns:
        c = axis.turns
        force, torque = scale((-y, x, 0.0), c), scale((-xz, -yz, xx + yy), c)
    if axis.shifts:
        e = axis.shifts
        force = add(force, scale((0.0, 0.0, matter.mass), e))
        torque = add(torque, scale((y, -x, 0.0), e))
    return force, torque


def mass_matrix(
    links: Sequence[Link], placements: Sequence[Placement], composite_matter: Sequence[Matter]
) -> tuple[list[list[Scalar]], list[Wrench]]:
    """Return a list of the rows of the mass matrix M up to the diagonal, rotor inertias included, and a list of
    the wrenches on the base, base axes, for q'' = 1 of each joint (T4). composite_matter is the result of
    `composites`.
    """
    rows: list[list[Scalar]] = []
    on_base = []
    for number, link in enumerate(links, 1):
        force, torque = axis_wrench(link.axis, composite_matter[number])
        row: list[Scalar] = [0.0] * number
        at = number
        while at:
            row[at - 1] = links[at - 1].axis.effort(force, torque)
            joint = placements[at - 1]
            force = to_parent(joint, force)
            torque = add(to_parent(joint, torque), cross(joint.r, force))
            at = links[at - 1].parent
        row[-1] = row[-1] + link.armature
        rows.append(row)
        on_base.append((force, torque))
    return rows, on_base


def base_mass_rows(S: Matrix, matter: Matter) -> list[list[Scalar]]:
    """Return a list of the six rows of the mass matrix M of a free base, each up to its diagonal, for (v1, omega1) in
    world axes (T4). `matter` is the `Matter` of the whole tree and S the attitude of the base.
    """
    x, y, z = rotate(S, matter.first)
    J = conjugate(S, inertia_from_moment(matter.second))
    m = matter.mass
    return [
        [m],
        [0.0, m],
        [0.0, 0.0, m],
        [0.0, -z, y, J[0]],
        [z, 0.0, -x, J[1], J[3]],
        [-y, x, 0.0, J[2], J[4], J[5]],
    ]


def momentum_columns(
    links: Sequence[Link], body_poses: Sequence[Pose], composite_matter: Sequence[Matter], centre: Vector
) -> list[Wrench]:
    """Return the linear momentum and the angular momentum about the centre of mass, world axes, for q' = 1 of each
    joint alone (T12). `centre` leads from the base's reference point to the centre of mass.
    """
    columns = []
    for link, pose, matter in zip(links, body_poses[1:], composite_matter[1:], strict=True):
        P, L = (rotate(pose.S, part) for part in axis_wrench(link.axis, matter))
        columns.append((P, add(L, cross(subtract(pose.d, centre), P))))
    return columns


def base_momentum_columns(S1: Matrix, matter: Matter, centre: Vector) -> list[Wrench]:
    """Return what `momentum_columns` does, for v1 along each world axis and omega1 about each. `matter` is that of
    the whole tree, and S1 the attitude of the base.
    """
    m, (x, y, z) = matter.mass, rotate(S1, matter.first)
    J = full_matrix(conjugate(S1, inertia_from_moment(matter.second)))
    moving = [(m, 0.0, 0.0), (0.0, m, 0.0), (0.0, 0.0, m)]
    turning = [(0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)]
    columns: list[Wrench] = [(P, ZERO_VECTOR) for P in moving]
    return columns + [(P, subtract(J[3 * k : 3 * k + 3], cross(centre, P))) for k, P in enumerate(turning)]


# ---- articulated bodies


class SpatialInertia(NamedTuple):
    """Spatial inertia of a body in the articulated-body algorithm (T5): [torque force] = [J H; H^T M] [alpha a]. J
    and M are symmetric matrices of six entries; H has nine entries, row by row.
    """

    J: Symmetric
    H: Matrix
    M: Symmetric


class JointElimination(NamedTuple):
    """The elimination of one joint from an articulated body, a body with all bodies that it carries by movable joints
    (T5). `torque` and `force` are the column U of the articulated body's inertia for the joint axis, `pivot` is D,
    the entry of U along the axis plus the armature, and `share` is 1 / D.
    """

    torque: Vector
    force: Vector
    share: Scalar
    pivot: Scalar


def rigid_body_inertia(mass: Scalar, first_moment: Vector, second_moment: Symmetric) -> SpatialInertia:
    """Return the `SpatialInertia` of a single rigid body about its reference point, in body axes, from which the
    articulated-body algorithm starts (T5).
    """
    x, y, z = first_moment
    return SpatialInertia(
        inertia_from_moment(second_moment), (0.0, -z, y, z, 0.0, -x, -y, x, 0.0), (mass, 0.0, 0.0, mass, 0.0, mass)
    )


def turned_matrix(turn: Turn, A: Matrix) -> Matrix:
    """Return Sz(q) A Sz(q)^T for any 3 x 3 matrix A, as nine entries, where turn = (sin q, cos q)."""
    s, c = turn
    cc, cs, ss = c * c, c * s, s * s
    both, apart = cs * (A[1] + A[3]), cs * (A[0] - A[4])
    return (
        cc * A[0] - both + ss * A[4], apart + cc * A[1] - ss * A[3], c * A[2] - s * A[5],
        apart + cc * A[3] - ss * A[1], ss * A[0] + both + cc * A[4], s * A[2] + c * A[5],
        c * A[6] - s * A[7], s * A[6] + c * A[7], A[8],
    )  # fmt: skip


def spatial_inertia_to_parent(placement: Placement, inertia: SpatialInertia) -> SpatialInertia:
    """Return the `SpatialInertia` of a body, converted to the parent's reference point and the parent's axes (T5)."""
    J, H, M = inertia
    if placement.turn is not None:
        J, H, M = (
            turned_symmetric(placement.turn, J),
            turned_matrix(placement.turn, H),
            turned_symmetric(placement.turn, M),
        )
    S = placement.S
    J, M = conjugate(S, J), conjugate(S, M)
    H = compose(compose(S, H), transpose(S))
    x, y, z = placement.r
    lever = (0.0, -z, y, z, 0.0, -x, -y, x, 0.0)
    moved = compose(lever, full_matrix(M))
    crossed = compose(lever, transpose(H))
    both = _sum(H, moved)
    # r x H^T + (H + r x M) r^T, of which the entries on and above the diagonal are computed
    rows, levers = (both[0:3], both[3:6], both[6:9]), (lever[0:3], lever[3:6], lever[6:9])
    picked = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    xx, xy, xz, yy, yz, zz = (crossed[3 * i + j] + dot(rows[i], levers[j]) for i, j in picked)
    return SpatialInertia(symmetric_sum(J, (xx, xy, xz, yy, yz, zz)), both, M)


def _sum(A: Matrix, B: Matrix) -> Matrix:
    """Return the sum A + B of two 3 x 3 matrices of nine entries."""
    a, b, c, d, e, f, g, h, i = (x + y for x, y in zip(A, B, strict=True))
    return a, b, c, d, e, f, g, h, i


def eliminate_joint(
    axis: Axis, armature: Scalar, inertia: SpatialInertia, reciprocal: Callable[[Scalar], Scalar]
) -> tuple[JointElimination, SpatialInertia]:
    """Return the `JointElimination` of a joint and the `SpatialInertia` of its articulated body that is left for the
    parent, still in body axes (T5, T10). `reciprocal` computes 1 / D.
    """
    rows = spatial_rows(inertia)
    column = [axis.effort((0.0, 0.0, row[5]), (0.0, 0.0, row[2])) for row in rows]
    pivot = axis.effort((0.0, 0.0, column[5]), (0.0, 0.0, column[2])) + armature
    share = reciprocal(pivot)
    rotor_share = _rotor_share(armature, share)
    # Along the axis of a hinge or a slider nothing but the rotor is left, exactly.
    alone = 2 if axis == HINGE else 5 if axis == SLIDER else None
    shares = [entry * share for entry in column]

    def left(i: int, j: int) -> Scalar:
        if alone in (i, j):
            return column[j if i == alone else i] * rotor_share
        return rows[i][j] - column[i] * shares[j]

    J, M = (
        (left(k, k), left(k, k + 1), left(k, k + 2), left(k + 1, k + 1), left(k + 1, k + 2), left(k + 2, k + 2))
        for k in (0, 3)
    )
    H = tuple(left(i, j) for i in range(3) for j in range(3, 6))
    torque, force = (column[0], column[1], column[2]), (column[3], column[4], column[5])
    return JointElimination(torque, force, share, pivot), SpatialInertia(J, H, M)


def spatial_rows(inertia: SpatialInertia) -> list[tuple[Scalar, ...]]:
    """Return the six rows of a `SpatialInertia`, for (alpha, a), those of the torque first."""
    J, M, H = full_matrix(inertia.J), full_matrix(inertia.M), inertia.H
    upper = [(*J[3 * i : 3 * i + 3], *H[3 * i : 3 * i + 3]) for i in range(3)]
    return upper + [(*H[i::3], *M[3 * i : 3 * i + 3]) for i in range(3)]


def _rotor_share(armature: Scalar, share: Scalar) -> Scalar:
    """Return armature * share, the part of a load that the motor's rotor resists (T10). `share` is the reciprocal of
    the joint's inertia with the armature. The result is exactly 0 if the armature is known to be 0.
    """
    return 0.0 if type(armature) is float and armature == 0 else armature * share


def eliminate_joints(
    base: Base, links: Sequence[Link], placements: Sequence[Placement], reciprocal: Callable[[Scalar], Scalar]
) -> tuple[list[JointElimination], SpatialInertia]:
    """Return the `JointElimination` of all joints, and the articulated `SpatialInertia` of the base in base axes
    (T5). `reciprocal` computes 1 / D of a pivot.
    """
    sums = [rigid_body_inertia(body.mass, body.first, body.second) for body in _bodies(base, links)]
    eliminations: list[JointElimination] = []
    for number in range(len(links), 0, -1):
        link, joint = links[number - 1], placements[number - 1]
        elimination, inertia_left = eliminate_joint(link.axis, link.armature, sums[number], reciprocal)
        eliminations.append(elimination)
        J, H, M = spatial_inertia_to_parent(joint, inertia_left)
        p = sums[link.parent]
        sums[link.parent] = SpatialInertia(symmetric_sum(p.J, J), _sum(p.H, H), symmetric_sum(p.M, M))
    return eliminations[::-1], sums[0]


def accelerations_by_loads(
    links: Sequence[Link],
    placements: Sequence[Placement],
    eliminations: Sequence[JointElimination],
    loads: Sequence[Scalar],
    friction: Callable[[int, Scalar, Scalar], Scalar] | None = None,
) -> tuple[list[Scalar], Wrench]:
    """Return the q'' that the loads, one number for each joint, cause at each joint while its parent is at rest, and
    the wrench (force, torque) that these loads transmit to the base, in base axes (T6). `friction` returns the effort
    of dry friction from the index of a joint (from 0), the effort of all else, and the pivot (T14).
    """
    wrenches: list[Wrench] = [(ZERO_VECTOR, ZERO_VECTOR)] * (len(links) + 1)
    qdd: list[Scalar] = [0.0] * len(links)
    for number in range(len(links), 0, -1):
        link, joint, elimination, (force, torque) = (
            links[number - 1],
            placements[number - 1],
            eliminations[number - 1],
            wrenches[number],
        )
        rest = loads[number - 1] - link.axis.effort(force, torque)
        if friction is not None:
            rest = rest + friction(number - 1, rest, elimination.pivot)
        qdd[number - 1] = rest * elimination.share
        force = add(force, scale(elimination.force, qdd[number - 1]))
        torque = add(torque, scale(elimination.torque, qdd[number - 1]))
        force_to_parent = to_parent(joint, force)
        f, t = wrenches[link.parent]
        wrenches[link.parent] = (
            add(f, force_to_parent),
            add(t, add(to_parent(joint, torque), cross(joint.r, force_to_parent))),
        )
    return qdd, wrenches[0]


def joint_accelerations(
    links: Sequence[Link],
    placements: Sequence[Placement],
    eliminations: Sequence[JointElimination],
    qdd_by_loads: Sequence[Scalar],
    alpha: Vector,
    a: Vector,
) -> list[Scalar]:
    """Return the q'' of all joints (T6) from qdd_by_loads, the first result of `accelerations_by_loads`, and alpha
    and a, the accelerations of a free base in base axes, a less gravity; both are zero for any other base.
    """
    bodies, qdd = [(alpha, a)], []
    for link, joint, elimination, rest in zip(links, placements, eliminations, qdd_by_loads, strict=True):
        alpha_p, a_p = bodies[link.parent]
        turning = to_child(joint, alpha_p)
        moving = to_child(joint, add(a_p, cross(alpha_p, joint.r)))
        change = rest - (dot(elimination.torque, turning) + dot(elimination.force, moving)) * elimination.share
        qdd.append(change)
        if link.axis.shifts:
            moving = (moving[0], moving[1], moving[2] + link.axis.shift(change))
        if link.axis.turns:
            turning = (turning[0], turning[1], turning[2] + link.axis.turn(change))
        bodies.append((turning, moving))
    return qdd


# ---- energy and momentum


def velocities_in_own_axes(
    links: Sequence[Link], placements: Sequence[Placement], qd: Sequence[Scalar], v: Vector, omega: Vector
) -> list[tuple[Vector, Vector]]:
    """Return a list of (v, omega) of all bodies, each in the axes of its body, the base first. v and omega are the
    velocities of the base in base axes.
    """
    bodies = [(v, omega)]
    for link, joint, rate in zip(links, placements, qd, strict=True):
        v_p, omega_p = bodies[link.parent]
        x, y, z = to_child(joint, omega_p)
        a, b, c = to_child(joint, add(v_p, cross(omega_p, joint.r)))
        if link.axis.shifts:
            c = c + link.axis.shift(rate)
        if link.axis.turns:
            z = z + link.axis.turn(rate)
        bodies.append(((a, b, c), (x, y, z)))
    return bodies


def body_momenta(base: Base, links: Sequence[Link], own_velocities: Sequence[tuple[Vector, Vector]]) -> list[Wrench]:
    """Return a list of (P, L), the linear and angular momentum of all bodies about their reference points, the base
    first (T8). own_velocities holds (v, omega); velocities and momenta are in the axes of each body.
    """
    result = []
    for body, (v, omega) in zip(_bodies(base, links), own_velocities, strict=True):
        linear = add(scale(v, body.mass), cross(omega, body.first))
        angular = add(cross(body.first, v), rotate(full_matrix(inertia_from_moment(body.second)), omega))
        result.append((linear, angular))
    return result


def kinetic_energy(
    links: Sequence[Link],
    own_velocities: Sequence[tuple[Vector, Vector]],
    momenta: Sequence[Wrench],
    qd: Sequence[Scalar],
) -> Scalar:
    """Return the kinetic energy of a tree: half the sum of v . P + omega . L of all bodies and of the armature times
    q'^2 of all joints (T7, T10). own_velocities holds (v, omega) and `momenta` holds (P, L), each in the axes of its
    body.
    """
    doubles = [dot(v, P) + dot(omega, L) for (v, omega), (P, L) in zip(own_velocities, momenta, strict=True)]
    doubles += [link.armature * rate * rate for link, rate in zip(links, qd, strict=True)]
    total = doubles[0]
    for double in doubles[1:]:
        total = total + double
    return total * 0.5
