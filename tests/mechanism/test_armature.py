"""Inertias of rotors (T10): from Pinocchio's models and its reader of MJCF, in everything that they count in."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from support.exported import ARM
from support.near import U, assert_near
from support.trees import Robot, random_model, record_of, with_mimics

pytestmark = pytest.mark.filterwarnings("ignore:.*no rigid body:hingepair.DynamicsWarning")

SAMPLES = 4
SPREAD = (0.0, 0.3, 1e-3, 40.0)  # kg m^2 or kg, by turns; the first joint has none


def geared(seed=1, count=7):
    """A model of hinges and sliders, of which most have rotors."""
    model = random_model(seed, count)
    model.armature = np.array([SPREAD[k % len(SPREAD)] for k in range(model.nv)])
    return model


def samples(dof, seed=3):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (4, SAMPLES, dof))


@pytest.fixture
def model():
    return geared()


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["fixed", "free"])
def test_a_follower_hands_the_effort_of_its_rotor_to_its_leader(mode):
    tree = record_of(random_model(3, 6))
    rotors = [SPREAD[k % len(SPREAD)] for k in range(len(tree.joints))]
    tree = replace(
        tree, joints=tuple(replace(joint, armature=own) for joint, own in zip(tree.joints, rotors, strict=True))
    )
    names = [joint.name for joint in tree.joints]
    rules = {names[1]: (names[4], -0.5, 0.25), names[3]: (names[2], 2.0, -0.1)}
    robot, alone = Robot(with_mimics(tree, rules), mode), Robot(tree, mode)
    own = [name for name in names if name not in rules]
    P = np.zeros((len(names), len(own)))
    for k, name in enumerate(names):
        leader, ratio, _ = rules.get(name, (name, 1.0, 0.0))
        P[k, own.index(leader)] = ratio
    shift = np.array([rules.get(name, (0, 0, 0.0))[2] for name in names])
    q, qd, qdd, _ = samples(len(own))
    every = q @ P.T + shift, qd @ P.T, qdd @ P.T
    forces, each = robot.inverse_dynamics(q, qd, qdd), alone.inverse_dynamics(*every)
    np.testing.assert_allclose(forces.tau, each.tau @ P, rtol=0, atol=256 * U * np.abs(forces.tau).max())
    base = 6 * (mode == "free")
    M, N = robot.mass_matrix(q)[:, base:, base:], alone.mass_matrix(every[0])[:, base:, base:]
    np.testing.assert_allclose(M, P.T @ N @ P, rtol=0, atol=256 * U * np.abs(M).max())
    np.testing.assert_allclose(robot.energy(q, qd).kinetic, alone.energy(*every[:2]).kinetic, rtol=256 * U)
    loads = {"force1": forces.force1, "torque1": forces.torque1} if base else {}
    np.testing.assert_allclose(
        robot.forward_dynamics(q, qd, forces.tau, **loads).qdd, qdd, rtol=0, atol=1e6 * U
    )  # of the condition of M
    coordinates = hp.Mechanism.__dict__["armature"].fget(robot)
    assert_near(coordinates, np.array(rotors) @ (P * P), 4)


def test_a_joint_without_mass_is_held_by_its_rotor():
    """Its acceleration is the rest of its torque divided by its rotor's inertia."""
    model = pin.Model()
    for name in ("first", "last"):
        model.addJoint(model.njoints - 1, pin.JointModelRY(), pin.SE3.Identity(), name)
    model.appendBodyToJoint(1, pin.Inertia(1.0, np.array((0.3, 0, 0)), np.eye(3)), pin.SE3.Identity())
    model.armature = np.array((0.0, 0.02))
    robot = hp.Mechanism.from_pinocchio(model)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = robot.forward_dynamics((0.1, 0.2), (0.3, 0.4), (0.0, 0.5)).qdd
    assert found[1] == pytest.approx(0.5 / 0.02, rel=64 * U)


def test_what_is_made_of_a_robot_keeps_its_rotors(model):
    names = list(model.names)[1:]
    robot = hp.Mechanism.from_pinocchio(model, locked={names[1]: 0.1})
    np.testing.assert_array_equal(robot.armature, np.delete(model.armature, 1))
    tip = robot.tips[0]
    loaded = robot.with_payload(tip, hp.Body(1, inertia=(1, 1, 1))).with_frame("tool", link=tip)
    np.testing.assert_array_equal(loaded.armature, robot.armature)


@pytest.mark.slow
@pytest.mark.parametrize("base", ["fixed", "free"])
def test_the_twin_has_the_rotors(model, base):
    robot = hp.Mechanism.from_pinocchio(model, base=base)
    np.testing.assert_array_equal(hp.to_pinocchio(robot).model.armature[-model.nv :], model.armature)
    report = hp.cross_validate(robot, *samples(model.nv)[:3])
    assert report.ok, report


def test_urdf_says_which_rotors_it_leaves_out(model):
    robot = hp.Mechanism.from_pinocchio(model)
    names = [name for name, own in zip(robot.names, robot.armature, strict=True) if own]
    with pytest.warns(hp.DynamicsWarning, match=f"the armatures of {', '.join(names)}$"):
        text = hp.to_urdf(robot)
    assert not hp.Mechanism.from_urdf(text).armature.any()


@pytest.mark.parametrize("own", [-1.0, np.nan, np.inf])
def test_an_armature_that_no_rotor_has_is_refused(model, own):
    model.armature[2] = own
    with pytest.raises(hp.ArgumentError, match=f"joint '{model.names[3]}', armature: "):
        hp.Mechanism.from_pinocchio(model)


def test_gravity_of_the_model_is_not_dropped_without_a_word(model):
    model.gravity.linear = np.array((0.0, 0.0, -1.62))
    with pytest.warns(hp.DynamicsWarning, match=r"gravity \[0.0, 0.0, -1.62\] is not the robot's: methods take grav"):
        hp.Mechanism.from_pinocchio(model)


def test_limits_that_pinocchio_has_not_are_infinite():
    model = pin.Model()
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "joint")
    robot = hp.Mechanism.from_pinocchio(model)
    assert robot.position_limits.tolist() == [[-np.inf, np.inf]]
    assert robot.effort_limits.tolist() == robot.rate_limits.tolist() == [np.inf]


# ---- motors


def test_a_motor_is_felt_by_the_square_of_its_gear_ratio():
    robot = hp.load_robot("ur5_robot").with_motor("elbow_joint", armature=2e-5, ratio=-100)
    assert robot.armature.tolist() == [0, 0, 2e-5 * 100 * 100, 0, 0, 0]
    q = np.linspace(-1, 1, 6)
    added = robot.mass_matrix(q) - hp.load_robot("ur5_robot").mass_matrix(q)
    assert_near(added, np.diag(robot.armature), 16, 1)  # kg m^2, of the arm
    assert hp.cross_validate(robot, q, q, q).ok


def test_gear_ratios_are_those_of_transmissions_of_one_joint():
    transmission = (
        '<transmission name="t{0}"><type>transmission_interface/SimpleTransmission</type><joint name="{0}"/>'
        '<actuator name="m"><mechanicalReduction>{1}</mechanicalReduction></actuator></transmission>'
    )
    text = ARM.replace(
        "</robot>", transmission.format("elbow", "50") + transmission.format("slide", "-7.5") + "</robot>"
    )
    robot = hp.Mechanism.from_urdf(text)
    for name, ratio in (("elbow", 50), ("slide", -7.5), ("shoulder", 1)):
        geared = robot.with_motor(name, armature=0.5)
        assert geared.armature[robot.names.index(name)] == 0.5 * ratio**2
    with pytest.raises(hp.errors.URDFError, match="mechanicalReduction"):
        hp.Mechanism.from_urdf(ARM.replace("</robot>", transmission.format("elbow", "high") + "</robot>"))
    for options, argument in (({"joint": "arm"}, "joint"), ({"ratio": 0}, "ratio"), ({"armature": -1}, "armature")):
        with pytest.raises(hp.errors.ArgumentError) as raised:
            robot.with_motor(**{"joint": "elbow", "armature": 1, **options})
        assert raised.value.name == argument


def test_bounds_of_efforts_may_differ():
    body = '<body><joint name="{}" actuatorfrcrange="{}"/><geom size="1"/>'
    bodies = body.format("a", "-5 0") + body.format("b", "-2 2")
    text = f"<mujoco><worldbody>{bodies}</body></body></worldbody></mujoco>"
    robot = hp.Mechanism.from_mjcf(text)
    assert robot.effort_bounds.tolist() == [[-5, 0], [-2, 2]]
    assert robot.effort_limits.tolist() == [5, 2]
    back = hp.Mechanism.from_mjcf(hp.to_mjcf(robot.with_locked({"b": 0.0})))
    assert back.effort_bounds.tolist() == [[-5, 0]]
    model = hp.to_pinocchio(robot).model
    assert (model.lowerEffortLimit.tolist(), model.upperEffortLimit.tolist()) == ([-5, -2], [0, 2])
    assert hp.Mechanism.from_pinocchio(model).effort_bounds.tolist() == [[-5, 0], [-2, 2]]
    assert hp.Mechanism.from_pinocchio(pin.buildSampleModelManipulator()).effort_bounds[0].tolist() == [-10, 10]
