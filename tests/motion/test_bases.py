"""A base that is pinned, the double pendulum, and laws of what a pin holds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hingepair as hp
from support.near import TIGHT, TOL

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

    return solve_ivp(rates, (t[0], t[-1]), angles, method="DOP853", rtol=1e-12, atol=1e-12, t_eval=t).y


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
