"""The equations of trees against clouds of points that hinges and sliders carry, in sixty digits."""

from __future__ import annotations

import mpmath
import pytest
from mpmath import mpf

from hingepair.equations import trees
from hingepair.equations.joints import HINGE, SLIDER, Axis
from support.differences import Body, Cloud, at, column, hat, rate, same, tuple_of, turn, unit, vector, vee

G = (mpf("0.3"), mpf("-0.2"), mpf("-9.81"))
JOINTS = ((0, HINGE), (1, SLIDER), (2, HINGE), (1, Axis(1.0, 0.25)), (4, SLIDER))
"""The parent of each, and its axis: a hinge carries a slider with a hinge, and a screw with a slider."""


@pytest.fixture(autouse=True)
def _sixty_digits():
    with mpmath.workdps(60):
        yield


class Tree:
    """A free base and joints, all in motion."""

    def __init__(self):
        self.base = Body(201)
        self.clouds = [Cloud(211 + 10 * k) for k in range(len(JOINTS) + 1)]
        self.S = [turn(unit(vector(301 + k)), mpf(k + 1)) for k in range(len(JOINTS))]
        self.u = [vector(311 + k) for k in range(len(JOINTS))]
        count = len(JOINTS)
        self.rotors = [mpf(k) / 3 for k in range(1, count + 1)]  # the inertias of geared rotors (T10)
        self.q = [vector(321, count), vector(322, count), vector(323, count)]
        self.links = [
            trees.Link(parent, axis, tuple_of(S), u, *moments(cloud), rotor)
            for (parent, axis), S, u, cloud, rotor in zip(
                JOINTS, self.S, self.u, self.clouds[1:], self.rotors, strict=True
            )
        ]
        self.root = trees.Base(*moments(self.clouds[0]))
        turns = [
            (mpmath.sin(q), mpmath.cos(q)) if axis.turns else None
            for (_, axis), q in zip(JOINTS, self.q[0], strict=True)
        ]
        self.places = trees.joint_placements(self.links, turns, self.q[0])

    def poses(self, s=0, q=None):
        """(R, S) of every body."""
        found = [(self.base.R(s), self.base.S(s))]
        for (parent, (turns, shifts)), S, u, now in zip(
            JOINTS, self.S, self.u, at(self.q, s) if q is None else q, strict=True
        ):
            (R, own) = found[parent]
            placed = R + own * (column(u) + S * column([0, 0, shifts * now]))
            found.append((placed, own * S * turn([0, 0, 1], turns * now)))
        return found

    def point(self, body, p):
        """Where a point of a body is."""

        def place(s):
            R, S = self.poses(s)[body]
            return R + S * p

        return place

    def omega(self, body):
        return column(vee(rate(lambda s: self.poses(s)[body][1]) * self.poses()[body][1].T))

    def alpha(self, body):
        return column(vee(rate(lambda s: self.poses(s)[body][1], 2) * self.poses()[body][1].T))

    def beyond(self, joint):
        """The bodies that a joint carries."""
        return [k for k in range(len(JOINTS) + 1) if joint in trees.joints_to_base(self.links, k)]


def moments(cloud):
    """m, h and N of a cloud."""
    second = cloud.total(lambda m, p: m * p * p.T)
    picked = [second[i, j] for i in range(3) for j in range(i, 3)]
    return cloud.mass, tuple(cloud.mass * cloud.centre), tuple(picked)


@pytest.fixture(scope="module")
def tree():
    with mpmath.workdps(60):
        return Tree()


@pytest.fixture(scope="module")
def truth(tree):
    """Of every body (v, omega) and (a, alpha) of its reference point; of every point its acceleration."""
    with mpmath.workdps(60):
        bodies = range(len(JOINTS) + 1)
        zero = column([0, 0, 0])
        velocities = [(rate(tree.point(k, zero)), tree.omega(k)) for k in bodies]
        changes = [(rate(tree.point(k, zero), 2), tree.alpha(k)) for k in bodies]
        points = [
            [
                (m, tree.point(k, p)(mpf(0)), rate(tree.point(k, p)), rate(tree.point(k, p), 2))
                for m, p in tree.clouds[k]
            ]
            for k in bodies
        ]
        return velocities, changes, points


def own_axes(tree, body, v):
    return tuple(tree.poses()[body][1].T * column(v))


def test_paths_lead_to_the_base(tree):
    assert [trees.joints_to_base(tree.links, k) for k in range(6)] == [
        set(),
        {1},
        {1, 2},
        {1, 2, 3},
        {1, 4},
        {1, 4, 5},
    ]


@pytest.mark.slow
def test_motion_of_bodies_and_frames(tree, truth):
    S1 = tuple_of(tree.base.S())
    bodies = trees.poses(tree.links, tree.places, S1)
    velocities, changes, _ = truth
    rates = trees.body_velocities(tree.links, bodies, tree.q[1], tuple(map(tuple, velocities[0])))
    found = trees.body_accelerations(tree.links, bodies, tree.q[1], tree.q[2], rates, tuple(map(tuple, changes[0])))
    for k, (R, S) in enumerate(tree.poses()):
        same(bodies[k].S, tuple_of(S))
        same(bodies[k].d, R - tree.base.R())
        for got, expected in zip((*rates[k], *found[k]), (*velocities[k], *changes[k]), strict=True):
            same(got, expected)
    p, T = column(vector(331)), turn(unit(vector(332)), mpf(2))
    frame = trees.frame_pose(bodies[3], tuple(p), tuple_of(T))
    place = tree.point(3, p)
    same(frame.S, tuple_of(tree.poses()[3][1] * T))
    same(frame.d, place(mpf(0)) - tree.base.R())
    same(trees.frame_velocity(frame, rates[3])[0], rate(place))
    same(trees.frame_acceleration(frame, rates[3][1], found[3])[0], rate(place, 2))
    columns = trees.base_jacobian_columns(frame.d) + trees.point_jacobian_columns(tree.links, bodies, 3, frame.d)
    speeds = [*velocities[0][0], *velocities[0][1], *tree.q[1]]
    for part, expected in ((0, rate(place)), (1, tree.omega(3))):
        same(
            sum((mpf(x) * column(c[part]) for x, c in zip(speeds, columns, strict=True)), column([0, 0, 0])), expected
        )


@pytest.mark.slow
def test_forces_are_those_of_the_points_beyond_each_joint(tree, truth):
    _, changes, points = truth
    feels = trees.accelerations_in_own_axes(
        tree.links, tree.places, tree.q[1], tree.q[2],
        own_axes(tree, 0, tree.omega(0)), own_axes(tree, 0, changes[0][1]),
        own_axes(tree, 0, changes[0][0] - column(G)),
    )  # fmt: skip
    wrenches = trees.sum_inward(tree.links, tree.places, trees.inertial_wrenches(tree.root, tree.links, feels))
    along = trees.along_axes(tree.links, wrenches)
    efforts = trees.driving_efforts(tree.links, wrenches, tree.q[2])
    rotors = [rotor * change for rotor, change in zip(tree.rotors, tree.q[2], strict=True)]
    same([effort - load for effort, load in zip(efforts, along, strict=True)], rotors)
    for joint in range(len(JOINTS) + 1):
        R, S = tree.poses()[joint]
        moved = [one for body in (tree.beyond(joint) if joint else range(len(points))) for one in points[body]]
        force = sum((m * (a - column(G)) for m, _, _, a in moved), column([0, 0, 0]))
        torque = sum((hat(x - R) * (m * (a - column(G))) for m, x, _, a in moved), column([0, 0, 0]))
        same(wrenches[joint][0], S.T * force)
        same(wrenches[joint][1], S.T * torque)
        if joint:
            turns, shifts = JOINTS[joint - 1][1]
            same([along[joint - 1]], [(S.T * (turns * torque + shifts * force))[2]])


def whole_mass_matrix(tree):
    """M of the base and all joints, 11 x 11, in (v1, omega1, q')."""
    matter = trees.composites(tree.root, tree.links, tree.places)
    S = tuple_of(tree.base.S())
    rows, on_base = trees.mass_matrix(tree.links, tree.places, matter)
    M = mpmath.zeros(11)
    for i, row in enumerate(trees.base_mass_rows(S, matter[0])):
        for j, entry in enumerate(row):
            M[i, j] = M[j, i] = entry
    for i, (row, wrench) in enumerate(zip(rows, on_base, strict=True), 6):
        base = [*(tree.base.S() * column(wrench[0])), *(tree.base.S() * column(wrench[1]))]
        for j, entry in enumerate([*base, *row]):
            M[i, j] = M[j, i] = entry
    return M


@pytest.mark.slow
def test_the_mass_matrix_is_that_of_the_kinetic_energy(tree, truth):
    """For all motions: of the tree as it moves, and of each rate alone with each other."""
    velocities, _, points = truth
    M = whole_mass_matrix(tree)
    speeds = column([*velocities[0][0], *velocities[0][1], *tree.q[1]])
    energy = sum(m * mpmath.norm(v) ** 2 / 2 for own in points for m, _, v, _ in own)
    energy += sum(rotor * rate**2 / 2 for rotor, rate in zip(tree.rotors, tree.q[1], strict=True))
    same([(speeds.T * M * speeds)[0] / 2], [energy])
    bodies = trees.velocities_in_own_axes(
        tree.links, tree.places, tree.q[1], own_axes(tree, 0, velocities[0][0]), own_axes(tree, 0, velocities[0][1])
    )
    momenta = trees.body_momenta(tree.root, tree.links, bodies)
    same([trees.kinetic_energy(tree.links, bodies, momenta, tree.q[1])], [energy])
    for k, (R, S) in enumerate(tree.poses()):
        same(bodies[k][0], S.T * velocities[k][0])
        same(bodies[k][1], S.T * velocities[k][1])
        same(momenta[k][0], S.T * sum((m * v for m, _, v, _ in points[k]), column([0, 0, 0])))
        same(momenta[k][1], S.T * sum((hat(x - R) * (m * v) for m, x, v, _ in points[k]), column([0, 0, 0])))
    # each column is the momentum of the points that a rate of its own makes
    step = mpf(10) ** -15
    for j in range(len(JOINTS)):
        shifted = [[q + sign * step * (i == j) for i, q in enumerate(tree.q[0])] for sign in (1, -1)]
        (ahead, behind) = (tree.poses(q=q) for q in shifted)
        moving = [
            (m, x, (Ra + Sa * p - Rb - Sb * p) / (2 * step))
            for k, ((Ra, Sa), (Rb, Sb)) in enumerate(zip(ahead, behind, strict=True))
            for (m, p), (_, x, _, _) in zip(tree.clouds[k], points[k], strict=True)
        ]
        linear = sum((m * v for m, _, v in moving), column([0, 0, 0]))
        angular = sum((hat(x - tree.base.R()) * (m * v) for m, x, v in moving), column([0, 0, 0]))
        same(M[0:3, 6 + j], linear)
        same(M[3:6, 6 + j], angular)


def test_forward_dynamics_solve_the_mass_matrix(tree):
    """From rest, without gravity: the joints of a base that is moved, and what they leave of its resistance."""
    M, loads = whole_mass_matrix(tree), vector(341, len(JOINTS))
    alpha, a = vector(342), vector(343)
    steps, resistance = trees.eliminate_joints(tree.root, tree.links, tree.places, lambda pivot: 1 / pivot)
    left, at_base = trees.accelerations_by_loads(tree.links, tree.places, steps, loads)
    S = tree.base.S()
    qdd = trees.joint_accelerations(
        tree.links, tree.places, steps, left, tuple(S.T * column(alpha)), tuple(S.T * column(a))
    )
    expected = mpmath.lu_solve(M[6:11, 6:11], column(loads) - M[6:11, 0:6] * column([*a, *alpha]))
    same(qdd, expected)
    whole = M * column([*a, *alpha, *expected])
    J, H, M0 = (
        matrix3(tree, part)
        for part in (trees.full_matrix(resistance.J), resistance.H, trees.full_matrix(resistance.M))
    )
    force = M0 * column(a) + H.T * column(alpha) + S * column(at_base[0])
    torque = J * column(alpha) + H * column(a) + S * column(at_base[1])
    same([*force, *torque], whole[0:6])
    for step, link in zip(steps, tree.links, strict=True):
        along = link.axis.turns * step.torque[2] + link.axis.shifts * step.force[2] + link.armature
        same([step.share * step.pivot, along], [1, step.pivot])


def matrix3(tree, entries):
    """A matrix of the base's own axes in the world's."""
    S = tree.base.S()
    return S * mpmath.matrix([list(entries[i : i + 3]) for i in (0, 3, 6)]) * S.T


def test_symmetric_matrices():
    A, B = vector(351, 6), vector(352, 6)
    S, pair = turn(unit(vector(353)), mpf(1)), (mpmath.sin(mpf(2)), mpmath.cos(mpf(2)))
    full_A, about_z = (
        mpmath.matrix([list(trees.full_matrix(A)[i : i + 3]) for i in (0, 3, 6)]),
        turn([0, 0, 1], mpf(2)),
    )

    def upper(m):
        return [m[i, j] for i in range(3) for j in range(i, 3)]

    assert full_A == full_A.T
    same(trees.symmetric_sum(A, B), [a + b for a, b in zip(A, B, strict=True)])
    same(trees.conjugate(tuple_of(S), A), upper(S * full_A * S.T))
    same(trees.turned_symmetric(pair, A), upper(about_z * full_A * about_z.T))
    same(trees.inertia_from_moment(A), upper((A[0] + A[3] + A[5]) * mpmath.eye(3) - full_A))
    x, y = column(vector(354)), column(vector(355))
    same(trees.outer_sum(tuple(x), tuple(y)), upper(x * y.T + y * x.T))
    C = mpmath.matrix([list(vector(356)), list(vector(357)), list(vector(358))])
    same(trees.turned_matrix(pair, tuple_of(C)), tuple_of(about_z * C * about_z.T))
    same(trees.turned_columns(tuple_of(C), pair), tuple_of(C * about_z))
    same(trees.turned(pair, tuple(x)), about_z * x)
    same(trees.turned_back(pair, tuple(x)), about_z.T * x)
