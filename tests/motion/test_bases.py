"""A base that is pinned, the double pendulum, and laws of what a pin holds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hingepair as hp
from support.near import TIGHT, TOL
from support.states import generator, rotations

ROD1 = hp.Body(mass=1.3, centre_of_mass=(0.5, 0, 0), inertia=(0.1, 0.1, 0.12))
ROD2 = hp.Body(mass=0.7, centre_of_mass=(0.4, 0, 0), inertia=(0.05, 0.08, 0.09))
DOUBLE = hp.HingePair((1, 0, 0), (0, 0, 0), (0, 0, 1), body1=ROD1, body2=ROD2)
HELD = hp.BodyMotion(R=(0, 0, 0), S=hp.rotation_exp((0, 0, 0.3)), omega=(0, 0, 0.2))


def textbook(t, angles):
    """Both angles from the x axis, by Lagrange: m2 l1 c2 couples them; l1 = 1, c1 = 0.5, c2 = 0.4."""
    m1, m2, c1, c2, g = 1.3, 0.7, 0.5, 0.4, 9.81

    def rates(_, y):
        a, b, da, db = y
        off = m2 * c2 * np.cos(a - b)
        M = [[0.12 + m1 * c1**2 + m2, off], [off, 0.09 + m2 * c2**2]]
        turn = m2 * c2 * np.sin(a - b)
        right = [
            -turn * db**2 - (m1 * c1 + m2) * g * np.cos(a),
            turn * da**2 - m2 * c2 * g * np.cos(b),
        ]
        return [da, db, *np.linalg.solve(M, right)]

    return solve_ivp(rates, (t[0], t[-1]), angles, method="DOP853", rtol=TIGHT, atol=TIGHT, t_eval=t).y


@pytest.mark.slow
def test_a_double_pendulum_swings_as_the_textbook_says():
    t = np.linspace(0, 2, 21)
    found = hp.simulate(DOUBLE, t, HELD, 0.4, -0.1, base="pinned", gravity=(0, -9.81, 0), tol=TIGHT)
    first, second, *_ = textbook(t, [0.3, 0.7, 0.2, 0.1])
    for S, angle in ((found.S1, first), (found.S2, second)):
        np.testing.assert_allclose(np.unwrap(np.arctan2(S[:, 1, 0], S[:, 0, 0])), angle, rtol=0, atol=10 * TOL)
    np.testing.assert_array_equal(found.body1.R, np.zeros((21, 3)))
    total = sum(found.energy())
    assert np.ptp(total) <= TIGHT * np.abs(total).max()
    assert found.recorded()["hinge_torque"].shape == (21,)


@pytest.mark.slow
def test_a_pin_holds_its_point_and_gives_no_torque():
    rng = generator(42)
    bodies = [hp.Body(rng.uniform(1, 2), rng.normal(size=3), rng.uniform(0.6, 1, 3)) for _ in range(2)]
    pair = hp.HingePair(*rng.normal(size=(3, 3)), home=rotations(rng, 1)[0], body1=bodies[0], body2=bodies[1])
    start = hp.BodyMotion(R=(1, 2, 3), S=rotations(rng, 1)[0], omega=rng.normal(size=3))
    given = {"base": "pinned", "torque1": (0.1, 0, 0.2), "tol": TIGHT}
    found = hp.simulate(pair, np.linspace(0, 1, 11), start, 0.4, 1.0, **given)
    forces = pair.inverse_dynamics(found.body1, found.psi, found.psid, found.psidd)
    np.testing.assert_array_equal(found.R1, np.broadcast_to((1.0, 2.0, 3.0), (11, 3)))
    np.testing.assert_allclose(found.body1.a, 0, rtol=0, atol=TIGHT)
    np.testing.assert_allclose(forces.torque1, np.broadcast_to((0.1, 0, 0.2), (11, 3)), rtol=0, atol=TIGHT)
    np.testing.assert_allclose(forces.hinge_torque, 0, rtol=0, atol=TIGHT)


def accelerations_of_rods(y, torque=0.0):
    """Accelerations of both rods' angles from the x axis, and the mass matrix and right side of what gives them."""
    a, b, da, db = y
    off, turn = 0.28 * np.cos(a - b), 0.28 * np.sin(a - b)
    M = np.array([[0.12 + 1.3 * 0.25 + 0.7, off], [off, 0.09 + 0.7 * 0.16]])
    right = np.array([-turn * db**2 - 1.35 * 9.81 * np.cos(a), turn * da**2 - 0.28 * 9.81 * np.cos(b)])
    return np.linalg.solve(M, right + np.array([torque, -torque])), M, right


@pytest.mark.slow
def test_a_hinge_sticks_and_slips_as_scipy_with_events_says():
    """The sense of the rate at the hinge, 0 where it sticks, changes where the rate or what friction bears does."""
    friction, y, now, end, sense, t = 1.2, np.array([0.3, 0.7, 0.2, 0.1]), 0.0, 4.0, -1.0, np.linspace(0, 4, 81)
    start = hp.BodyMotion(R=(0, 0, 0), S=hp.rotation_exp((0, 0, 0.3)), omega=(0, 0, 0.2))
    load, gravity = hp.HingeLoad(friction=friction), (0, -9.81, 0)
    found = hp.simulate(DOUBLE, t, start, 0.4, -0.1, base="pinned", hinge_torque=load, gravity=gravity, tol=TIGHT)

    def together(y):
        """The acceleration of rods that turn as one, and the torque that the hinge must give."""
        _, M, right = accelerations_of_rods(y)
        turning = right.sum() / M.sum()
        return turning, M[1].sum() * turning - right[1]

    def rates(_, y):
        return [y[2], y[3], *(accelerations_of_rods(y, sense * friction)[0] if sense else [together(y)[0]] * 2)]

    def margin(_, y):
        return sense * (y[3] - y[2]) if sense else friction - abs(together(y)[1])

    margin.terminal, margin.direction = True, -1
    expected, phases = np.empty((4, 81)), []
    while now < end:
        phases.append(sense)
        part = solve_ivp(
            rates, (now, end), y, "DOP853", rtol=TIGHT, atol=TIGHT / 10, events=margin, dense_output=True
        )
        inside = (t >= now) & (t <= part.t[-1])
        expected[:, inside] = part.sol(t[inside])
        now, y = part.t[-1], part.y[:, -1].copy()
        y[3] = y[2]
        torque = together(y)[1]
        sense = -np.sign(torque) if not sense else 0.0 if abs(torque) <= friction else -sense
    assert {*phases} == {0.0, 1.0, -1.0}
    for S, angle in ((found.S1, expected[0]), (found.S2, expected[1])):
        np.testing.assert_allclose(np.unwrap(np.arctan2(S[:, 1, 0], S[:, 0, 0])), angle, rtol=0, atol=10 * TOL)
