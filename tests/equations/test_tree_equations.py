"""The equations of trees against clouds of points that hinges and sliders carry, in sixty digits."""

from __future__ import annotations

import mpmath
import pytest
from mpmath import mpf

from hingepair.equations import trees
from hingepair.equations.joints import HINGE, SLIDER, Axis
from support.differences import Body, Cloud, at, column, rate, same, tuple_of, turn, unit, vector, vee

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


def test_paths_lead_to_the_base(tree):
    assert [trees.joints_to_base(tree.links, k) for k in range(6)] == [
        set(),
        {1},
        {1, 2},
        {1, 2, 3},
        {1, 4},
        {1, 4, 5},
    ]


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
