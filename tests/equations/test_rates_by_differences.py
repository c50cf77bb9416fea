"""The equations against motions in sixty digits, whose rates are differences and whose bodies are clouds of points.

Rotations are products of turns about one axis, which are exponentials; nothing here uses the equations' own formulas.
"""

from __future__ import annotations

import mpmath
import pytest
from mpmath import mpf

from hingepair.equations import constraints as con
from hingepair.equations import derivatives as der
from hingepair.equations import dynamics as dyn
from hingepair.equations import spatial as eq
from support.differences import (
    SEQUENCE_NAMES,
    Body,
    at,
    column,
    hat,
    matrix,
    rate,
    same,
    tuple_of,
    turn,
    unit,
    vector,
    vee,
)


@pytest.fixture(autouse=True)
def _sixty_digits():
    with mpmath.workdps(60):
        yield


class Pair(Body):
    """And a hinge with a second body."""

    def __init__(self, kind="tait_bryan"):
        super().__init__(11, kind)
        self.u1, self.u2, self.n = vector(21), vector(22), unit(vector(23))
        self.psi = [(mpf("0.7"),), (mpf("-1.3"),), (mpf("0.4"),)]
        self.home = turn(unit(vector(24)), mpf(1))

    def Sh(self, s=0, n=None):
        return turn(self.n if n is None else unit(n), at(self.psi, s)[0])

    def S2(self, s=0, n=None):
        return self.S(s) * self.Sh(s, n) * self.home

    def R2(self, s=0, n=None):
        return self.R(s) + self.S(s) * column(self.u1) - self.S2(s, n) * column(self.u2)

    def omega2(self, s=0, n=None):
        return column(vee(rate(lambda h: self.S2(s + h, n)) * self.S2(s, n).T))


@pytest.fixture(params=SEQUENCE_NAMES)
def pair(request):
    return Pair(request.param)


def trig(angles):
    return tuple(f(angle) for angle in angles for f in (mpmath.sin, mpmath.cos))


def hinge(pair):
    (psi,) = pair.psi[0]
    return mpmath.sin(psi), 1 - mpmath.cos(psi)


def axes_of(pair):
    return getattr(eq, f"{pair.kind}_axes")(trig(pair.angles[0]))


def test_a_turn_is_an_exponential():
    n = unit(vector(1))
    same(tuple_of(turn(n, mpf(2))), tuple_of(mpmath.expm(2 * hat(n))))


def test_attitudes(pair):
    same(getattr(eq, f"{pair.kind}_attitude")(trig(pair.angles[0])), tuple_of(pair.S()))
    same(eq.hinge_rotation(pair.n, hinge(pair)), tuple_of(pair.Sh()))
    same(eq.attitude2(*(tuple_of(S) for S in (pair.S(), pair.Sh(), pair.home))), tuple_of(pair.S2()))
    half = mpf("0.9")
    quat = (mpmath.cos(half), *(part * mpmath.sin(half) for part in pair.n))
    same(eq.quaternion_attitude(quat), tuple_of(turn(pair.n, 2 * half)))


def test_rates_of_euler_angles(pair):
    axes, (_, phid, phidd) = axes_of(pair), pair.angles
    omega = tuple(pair.omega())
    same(eq.angular_velocity1(axes, phid), omega)
    same(eq.angular_acceleration1(axes, phid, phidd), pair.alpha)
    columns = eq.euler_axes(axes)
    same(eq.rotate(tuple_of(matrix(sum(columns, ())).T), phid), omega)

    def axis(i):
        """What a rate of one angle alone makes omega."""

        def of(s):
            one = Body(0, pair.kind)
            one.angles = [at(pair.angles, s), [int(i == k) for k in range(3)], (0, 0, 0)]
            return one.omega()

        return of

    for i, turns in enumerate(columns):
        same(turns, axis(i)(mpf(0)))
    pivot = mpmath.cos(pair.angles[0][1]) if pair.kind == "tait_bryan" else -mpmath.sin(pair.angles[0][1])
    same([eq.scaled_third_rate(axes, omega)], [phid[2] * pivot])
    same(eq.euler_rates1(axes, omega, phid[2]), phid)


def levers(pair):
    arm = tuple(pair.home * column(pair.u2))
    lever_sin = eq.cross(pair.n, arm)
    return arm, eq.cross(lever_sin, pair.n), lever_sin


def test_body2(pair):
    S1, (_, (psid,), (psidd,)) = tuple_of(pair.S()), pair.psi
    arm, lever_cos, lever_sin = levers(pair)
    lever_moving = eq.lever_moving(lever_cos, lever_sin, hinge(pair), eq.cosine_of_psi(hinge(pair)))
    d = eq.offset(S1, eq.lever_fixed(pair.u1, arm, lever_cos), lever_moving)
    lever_by_psi = eq.lever_by_psi(S1, lever_cos, lever_sin, hinge(pair), eq.cosine_of_psi(hinge(pair)))
    omega1, alpha1, axis = tuple(pair.omega()), tuple(pair.alpha), eq.rotate(S1, pair.n)
    same(eq.position2(tuple(pair.R()), d), pair.R2())
    same(eq.velocity2(pair.points[1], omega1, d, lever_by_psi, psid), rate(pair.R2))
    same(eq.angular_velocity2(omega1, axis, psid), pair.omega2())
    alpha2 = column(vee(rate(pair.S2, 2) * pair.S2().T))
    same(eq.angular_acceleration2(alpha1, omega1, axis, psid, psidd), alpha2)
    relative = eq.relative_acceleration(lever_by_psi, eq.rotate(S1, lever_moving), psid, psidd)
    same(eq.acceleration2(pair.points[2], omega1, alpha1, d, lever_by_psi, psid, relative), rate(pair.R2, 2))
    r1, r2 = pair.S() * column(pair.u1), pair.S2() * column(pair.u2)
    same(eq.point_acceleration(omega1, alpha1, tuple(r1)), rate(lambda s: pair.S(s) * column(pair.u1), 2))
    same(eq.hinge_gap(pair.points[0], tuple(r1), vector(30), tuple(r2)), pair.R() + r1 - column(vector(30)) - r2)


def test_matrices():
    S, w = matrix(vector(41, 9)), vector(42)
    same(eq.skew(w), tuple_of(hat(w)))
    same(eq.unskew(tuple_of(S)), vee(S))
    same(eq.rotate(tuple_of(S), w), S * column(w))
    same(eq.transpose(tuple_of(S)), tuple_of(S.T))
    same(eq.angular_velocity_matrix(tuple_of(S), vector(43, 9)), tuple_of(matrix(vector(43, 9)) * S.T))
    product = S * S.T - mpmath.eye(3)
    six = [product[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))]
    same(eq.orthonormality_terms(tuple_of(S)), [*six, mpmath.det(S)])


def test_jacobian(pair):
    def jacobian(s):
        moved = Pair(pair.kind)
        moved.angles = [at(pair.angles, s), vector(51), vector(52)]
        moved.psi = [at(pair.psi, s), (0,), (0,)]
        S, d = moved.S(), moved.R2() - moved.R()
        turns = eq.euler_axes(axes_of(moved))
        return matrix(
            der.jacobian(turns, tuple(d), tuple(moved.S2() * column(pair.u2)), tuple(S * column(pair.n))), 7
        )

    velocities = column([*pair.points[1], *pair.angles[1], *pair.psi[1]])
    same(jacobian(mpf(0)) * velocities, [*rate(pair.R2), *pair.omega2()])


class Free:
    """Two bodies that move as they like, and the hinge's frame in both."""

    def __init__(self):
        self.one, self.two = Body(61), Body(71)
        n = unit(vector(81))
        e1 = unit(eq.cross(n, vector(82)))
        self.frame = [column(e1), column(eq.cross(n, e1)), column(n)]
        self.home = turn(unit(vector(83)), mpf(1))
        self.u1, self.u2 = column(vector(84)), column(vector(85))

    def frames(self, s=0):
        ones = [tuple(self.one.S(s) * e) for e in self.frame]
        return ones, [tuple(self.two.S(s) * self.home.T * e) for e in self.frame]

    def gap(self, s=0):
        return self.one.R(s) + self.one.S(s) * self.u1 - self.two.R(s) - self.two.S(s) * self.u2

    def tilt(self, s=0):
        (f1, f2, h1), (_, _, h2) = self.frames(s)
        projection_across = eq.cross(h1, h2)
        return column([eq.dot(projection_across, f1), eq.dot(projection_across, f2)])

    def psi(self, s=0):
        """The twist of body 2 about the axis."""
        (f1, f2, _), (g1, g2, _) = self.frames(s)
        return mpmath.atan2(*con.hinge_angle_terms((f1, f2), g1, g2))


@pytest.mark.slow
def test_residuals_of_two_motions_and_their_rates():
    free = Free()
    (f1, f2, h1), (_, _, h2) = free.frames()
    omega = tuple(free.one.omega()), tuple(free.two.omega())
    alpha = tuple(free.one.alpha), tuple(free.two.alpha)
    spin, twist = con.relative_rate(*omega), con.relative_rate(*alpha)
    same(spin, free.two.omega() - free.one.omega())
    same(con.tilt(f1, f2, h2), free.tilt())
    axes = con.tilt_axes(f1, f2, h2)
    same(con.tilt_rate(axes, spin), rate(free.tilt))
    bias = con.tilt_bias((f1, f2), h2, *omega, spin)
    same(con.tilt_acceleration(axes, twist, bias), rate(free.tilt, 2))
    r1, r2 = tuple(free.one.S() * free.u1), tuple(free.two.S() * free.u2)
    v1, v2 = free.one.points[1], free.two.points[1]
    same(con.gap_rate(v1, omega[0], r1, v2, omega[1], r2), rate(free.gap))
    turned = [eq.point_acceleration(w, a, r) for w, a, r in zip(omega, alpha, (r1, r2), strict=True)]
    a1, a2 = free.one.points[2], free.two.points[2]
    same(con.gap_acceleration(a1, turned[0], a2, turned[1]), rate(free.gap, 2))
    J = matrix(con.constraint_jacobian(r1, r2, axes), 12)
    same(J * column([*v1, *omega[0], *v2, *omega[1]]), [*rate(free.gap), *rate(free.tilt)])
    known = [*con.gap_bias(omega[0], r1, omega[1], r2), *bias]
    same(J * column([*a1, *alpha[0], *a2, *alpha[1]]) + column(known), [*rate(free.gap, 2), *rate(free.tilt, 2)])
    same(con.slip(*omega, h2, mpf(3)), free.two.omega() - free.one.omega() - 3 * column(h2))
    top, bottom = con.hinge_rate(h1, h2, spin)
    same([top / bottom], [rate(free.psi)])
    top, bottom = con.hinge_acceleration((h1, h2), omega, spin, twist, rate(free.psi))
    same([top / bottom], [rate(free.psi, 2)])


def test_the_hinge_angle_of_two_attitudes():
    pair, free = Pair(), Free()
    n = tuple(free.frame[2])
    (psi,) = pair.psi[0]
    f1, f2, _ = (tuple(pair.S() * e) for e in free.frame)
    g1, g2, _ = (tuple(pair.S() * turn(n, psi) * e) for e in free.frame)
    same(con.hinge_angle_terms((f1, f2), g1, g2), [2 * mpmath.sin(psi), 2 * mpmath.cos(psi)])


def test_symmetric_systems_are_solved():
    A = matrix(vector(141, 49), 7)
    A = A * A.T + mpmath.eye(7)
    lower = tuple(A[i, j] for i in range(7) for j in range(i + 1))
    same(dyn.solve_symmetric(lower, vector(142, 7))[0], mpmath.lu_solve(A, column(vector(142, 7))))


def test_cayley_s_map_and_its_rate():
    g, S = [vector(161), vector(162), vector(163)], Body(171).S()

    def attitude(s):
        now = at(g, s)
        size = mpmath.norm(now)
        return turn([part / size for part in now], 2 * mpmath.atan(size / 2)) * S

    same(dyn.cayley_attitude(g[0], tuple_of(S)), tuple_of(attitude(mpf(0))))
    omega = vee(rate(attitude) * attitude(mpf(0)).T)
    same(dyn.cayley_rate(g[0], omega), g[1])
