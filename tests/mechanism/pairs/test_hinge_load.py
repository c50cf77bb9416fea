"""What acts at a hinge: the torque of a `HingeLoad`, part by part, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.bodies.hinge_load import stop_angles, stop_range
from support.near import U, assert_near

T, PSI, PSID = np.linspace(0, 1, 3), np.array([-1.5, 0.3, 1.2]), np.array([0.5, -0.02, 2.0])
"""Leaving a stop quicker than its spring follows, between the stops, and going into one."""
WHOLE = {
    "stiffness": 2,
    "rest": 0.1,
    "damping": 0.3,
    "friction": 0.2,
    "friction_rate": 0.05,
    "stops": (-1, 1),
    "stop_stiffness": 100,
    "stop_damping": 3,
}
COORDINATE_PART_NAMES = {
    "motor": np.sin(T),
    "spring": -2 * (PSI - 0.1),
    "damper": -0.3 * PSID,
    "friction": -0.2 * np.tanh(PSID / 0.05),
    "stop": np.array([0, 0, -20 * (1 + 3 * 2)]),
}


def test_the_parts_of_a_load_are_those_of_its_formula_and_sum_to_it():
    load = hp.HingeLoad(**WHOLE, motor=lambda t, *_: np.sin(t))
    parts = load.parts(T, PSI, PSID)
    assert list(parts) == list(COORDINATE_PART_NAMES)
    for name, torque in COORDINATE_PART_NAMES.items():
        np.testing.assert_allclose(parts[name], torque, rtol=8 * U, atol=4 * U)
    np.testing.assert_allclose(load(T, PSI, PSID), sum(COORDINATE_PART_NAMES.values()), rtol=8 * U)
    assert load(T[0], PSI[0], PSID[0]) == pytest.approx(
        sum(torque[0] for torque in COORDINATE_PART_NAMES.values()), rel=8 * U
    )


def test_the_parts_of_a_load_that_is_the_motor_are_added_to_those_of_the_load():
    inner = hp.HingeLoad(stiffness=1, stops=(-1.2, 2), stop_stiffness=10, motor=5)
    parts = hp.HingeLoad(damping=0.3, stops=(-1, 1), stop_stiffness=100, motor=inner).parts(T, PSI, PSID)
    assert list(parts) == ["motor", "spring", "damper", "stop"]
    assert parts["motor"] == 5
    np.testing.assert_array_equal(parts["spring"], -PSI)
    assert_near(parts["damper"], -0.3 * PSID, 2)
    assert_near(parts["stop"], [50 + 3, 0, -20], 8)


def test_a_stop_pushes_until_the_hinge_leaves_it_quicker_than_its_spring():
    load = hp.HingeLoad(stops=(-1, 1), stop_stiffness=100, stop_damping=0.5)
    assert_near(load(0.0, np.array([1.1, -1.1]), np.array([-1.9, 1.9])), [-0.5, 0.5], 4, 10)  # N m, of the spring
    np.testing.assert_array_equal(load(0.0, np.array([1.1, -1.1]), np.array([-2.1, 2.1])), 0.0)


def test_dry_friction_has_the_sign_of_the_rate():
    load = hp.HingeLoad(friction=2)
    np.testing.assert_array_equal(load(0.0, np.zeros(3), np.array([-1e-9, 0, 3])), [2, 0, -2])
    assert hp.HingeLoad(friction=2, motor=hp.HingeLoad(friction=1)).sticking_friction == 3


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:psi passes the stops:hingepair.DynamicsWarning")
def test_a_simulated_motion_has_the_parts_of_the_hinge_torque_among_its_loads():
    pair = hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body2=hp.Body(mass=2, inertia=(1, 1, 1)))
    start, t = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), np.linspace(0, 1, 3)
    load = hp.HingeLoad(**WHOLE, motor=0.5)
    found = hp.simulate(pair, t, start, 0.2, 0.0, base="fixed", hinge_torque=load)
    parts = load.parts(t, found.psi, found.psid)
    for name, torque in parts.items():
        np.testing.assert_array_equal(found.loads[f"{name}_torque"], np.broadcast_to(torque, t.shape))
    assert_near(sum(found.loads[f"{name}_torque"] for name in parts), found.loads["hinge_torque"], 8)
    plain = hp.simulate(pair, t, start, 0.2, 0.0, base="fixed", hinge_torque=lambda *args: -args[1])
    assert "spring_torque" not in plain.loads
    np.testing.assert_array_equal(plain.loads["motor_torque"], plain.loads["hinge_torque"])


def test_a_load_may_be_negative_where_that_has_a_meaning():
    assert hp.HingeLoad(motor=-1, rest=-2, stiffness=1)(0.0, 0.0, 0.0) == -3.0


@pytest.mark.parametrize("others", [{}, {"stop_damping": 3}, {"stop_stiffness": 0}, {"stop_restitution": 0.5}])
def test_an_infinite_stop_is_none(others):
    one, both = (hp.HingeLoad(stops=(least, 1.0), **others) for least in (-np.inf, -9.0))
    with np.errstate(all="raise"):
        assert np.array_equal(one(T, PSI, PSID), both(T, PSI, PSID))
    assert stop_angles(one) == (1.0,)
    assert one.rigid_stops == ({1.0: 0.5} if "stop_restitution" in others else {})
    assert stop_range(one) == (-np.inf, 1.0)
