"""Linearized motions of robots: those of pairs, and those that differences of the motion show."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.near import TIGHT
from support.trees import Robot, base_motion, random_model, record_of

SLOPES = 1e-9  # of loads that are differentiated by steps of 1e-4, with formulas of order 4

ROD = hp.Body(mass=2, inertia=(0.01, 1, 1), centre_of_mass=(1, 0, 0))
PAIR = hp.HingePair(u1=(0, 0, 0), u2=(0, 0, 0), n=(0, 1, 0), body2=ROD)


LOADS = {
    "spring and damper": hp.HingeLoad(stiffness=3.0, rest=0.2, damping=0.4),
    "friction": hp.HingeLoad(friction=0.5, friction_rate=0.3),
    "sliding": hp.HingeLoad(friction=0.5, damping=0.1),
    "stop": hp.HingeLoad(stops=(-1.0, 0.2), stop_stiffness=80.0, stop_damping=0.3),
    "motor": hp.HingeLoad(motor=lambda t, psi, psid: np.cos(t) * np.sin(psi) - 0.2 * psid**2),
    "nested": hp.HingeLoad(stiffness=1.0, motor=hp.HingeLoad(damping=0.7, motor=0.3)),
}


@pytest.mark.parametrize("load", LOADS.values(), ids=LOADS)
def test_loads_of_joints_change_the_rates_as_differences_show(load):
    arm, q, qd, h = hp.Mechanism([PAIR]), 0.3, 0.6, 1e-5

    def acceleration(change, change_of_rate):
        effort = load.smooth((q, qd), 1.2, q + change, qd + change_of_rate)
        return arm.forward_dynamics([q + change], [qd + change_of_rate], [effort]).qdd[0]

    slopes = [(acceleration(*step) - acceleration(*-step)) / (2 * h) for step in h * np.eye(2)]
    found = hp.linearize(arm, [q], [qd], [0.0], loads={arm.names[0]: load}, t=1.2)
    np.testing.assert_allclose(found.A, [[0, 1], slopes], rtol=0, atol=100 * SLOPES)
    np.testing.assert_allclose(found.rates, [qd, acceleration(0, 0)], rtol=TIGHT)
    held = hp.linearize(arm, [[q], [0.5]], [qd], loads={arm.names[0]: load}, t=1.2)
    np.testing.assert_allclose(held.rates[:, 1], 0.0, rtol=0, atol=TIGHT)
    with pytest.raises(hp.ArgumentError, match="poles: expected the linearization about one state"):
        _ = held.poles


@pytest.mark.slow
def test_rates_of_a_free_robot_change_as_the_linearization_says():
    robot = Robot(record_of(random_model(3, 4)), "free")
    rng = np.random.default_rng(1)
    q, qd, tau, n = *rng.uniform(-1, 1, (3, robot.dof)), robot.dof
    base = base_motion(rng)
    found = hp.linearize(robot, q, qd, tau, base_motion=base)
    x = rng.normal(size=2 * (6 + n))

    def rates(size):
        """Rates of the state beside the given one, rotations as seen from there."""
        d = size * x
        v, omega = base.v + d[6 + n : 9 + n], base.omega + d[9 + n : 12 + n]
        S = hp.rotation_exp(d[3:6]) @ base.S
        moved = hp.BodyMotion(R=base.R + d[:3], S=S, v=v, omega=omega)
        near = q + d[6 : 6 + n], qd + d[12 + n :]
        a = robot.forward_dynamics(*near, tau, base_motion=moved)
        turning = omega - base.omega + 0.5 * np.cross(omega + base.omega, d[3:6])  # phi' up to second order
        return np.concatenate((v, turning, near[1], a.a1, a.alpha1, a.qdd))

    h = 1e-6
    expected = (rates(h) - rates(-h)) / (2 * h)
    np.testing.assert_allclose(found.A @ x, expected, rtol=0, atol=1000 * SLOPES * np.abs(expected).max())
    assert len(found.names) == len(found.rates) == 2 * (6 + n)
    np.testing.assert_array_equal(found.rates[:6], [*base.v, *base.omega])


@pytest.mark.slow
@pytest.mark.parametrize("moving", [False, True], ids=["at rest", "moving"])
def test_default_torques_hold_the_joints_of_a_free_robot(moving):
    """The base falls as it does with stiff joints."""
    robot, rng = Robot(record_of(random_model(3, 4)), "free"), np.random.default_rng(6)
    q, base = rng.uniform(-1, 1, robot.dof), base_motion(rng)
    base = hp.BodyMotion(R=base.R, S=base.S, v=base.v, omega=base.omega) if moving else None
    found = hp.linearize(robot, q, base_motion=base, force1=(1, 2, 3))
    rates = dict(zip(found.names, found.rates, strict=True))
    assert max(abs(rates[f"{name}_dot"]) for name in robot.names) < TIGHT * np.abs(found.rates).max()
    assert found.equilibrium is False
