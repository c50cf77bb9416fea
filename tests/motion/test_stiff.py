"""Loads that answer to psi and psi' far quicker than the motion goes on, in closed form and beside SciPy's Radau."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import hingepair as hp
from support.near import TOL
from support.sparse import sparse
from support.states import generator, rotations

STILL = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))


def wheel(inertia):
    return hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=hp.Body(1.0, inertia=inertia * np.eye(3)))


@pytest.mark.slow
@pytest.mark.parametrize("inertia", sparse([3e-5, 1.0, 1e-9], 2))
def test_a_strong_damper_takes_no_short_steps(inertia):
    """J psi'' = A sin(w t) - d psi'; d / J is up to 1e13 1/s."""
    d, A, w, start, t = 1e4, 1e3, 50.0, 1.0, np.linspace(0, 0.2, 21)
    load = hp.HingeLoad(damping=d, motor=lambda t, *_: A * np.sin(w * t))
    found = hp.simulate(wheel(inertia), t, STILL, 0.0, start, base="fixed", hinge_torque=load)
    decay, size = d / inertia, A / inertia / ((d / inertia) ** 2 + w**2)
    left = start + size * w
    rate = left * np.exp(-decay * t) + size * (decay * np.sin(w * t) - w * np.cos(w * t))
    psi = left * -np.expm1(-decay * t) / decay + size * (decay * (1 - np.cos(w * t)) / w - np.sin(w * t))
    np.testing.assert_allclose(found.psi, psi, rtol=0, atol=TOL)
    np.testing.assert_allclose(found.psid, rate, rtol=0, atol=1000 * TOL)
    assert found.steps < 100
    assert found.psi_error_estimate < TOL


STIFF = {
    "overdamped spring": (
        1e-2, 0.1, 0.0, lambda q, v: -1e6 * q - 1e4 * v, {"stiffness": 1e6, "damping": 1e4}, 1e3, 5
    ),
    "smooth friction": (
        3e-5, 0.0, 1.0, lambda _, v: -0.05 * np.tanh(v / 1e-2), {"friction": 0.05, "friction_rate": 1e-2}, 0.1, 50
    ),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize(("J", "psi", "psid", "law", "load", "A", "w"), STIFF.values(), ids=STIFF)
def test_stiff_loads_take_no_short_steps(J, psi, psid, law, load, A, w):
    t = np.linspace(0, 0.2, 21)
    load = hp.HingeLoad(**load, motor=lambda t, *_: A * np.sin(w * t))
    found = hp.simulate(wheel(J), t, STILL, psi, psid, base="fixed", hinge_torque=load)

    def rates(t, y):
        return [y[1], (A * np.sin(w * t) + law(*y)) / J]

    expected = solve_ivp(rates, (0, 0.2), [psi, psid], "Radau", t, rtol=TOL / 10, atol=TOL / 1e4).y
    np.testing.assert_allclose(found.psi, expected[0], rtol=0, atol=100 * TOL)
    assert found.steps < 200


@pytest.mark.slow
def test_a_strong_damper_at_a_free_pair_leaves_one_rigid_body():
    rng = generator(61)
    bodies = [hp.Body(rng.uniform(1, 2), rng.normal(size=3), np.diag(rng.uniform(0.6, 1, 3))) for _ in range(2)]
    pair = hp.HingePair(*rng.normal(size=(3, 3)), home=rotations(rng, 1)[0], body1=bodies[0], body2=bodies[1])
    start = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), v=(1, 2, 3), omega=(1, -2, 0.5))
    load, t = hp.HingeLoad(damping=1e8), np.linspace(0, 3, 31)
    found = hp.simulate(pair, t, start, 0.3, 0.0, hinge_torque=load, gravity=(0, 0, 0))
    np.testing.assert_allclose(found.psi, 0.3, rtol=0, atol=1e4 * TOL)
    energy, momentum = found.energy().kinetic, found.momentum()
    np.testing.assert_allclose(energy, energy[0], rtol=1e4 * TOL)
    size = np.abs(found.body1.R).max() * np.abs(momentum.linear).max() + np.abs(momentum.angular).max()
    assert np.ptp(momentum.angular, axis=0).max() <= size * 2.0**-49
    assert found.steps < 200
