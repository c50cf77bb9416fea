"""A robot's twin in Pinocchio, and the report of both compared."""

from __future__ import annotations

import dataclasses
import json
import math
import re

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.formats.robots import robot_urdf
from hingepair.mechanism.mechanism import tree_of
from hingepair.validation import cross_validate as comparison
from support import states
from support.exported import ARM

U = 2.0**-53


def base_motion(rng, *shape):
    parts = states.body1(rng, math.prod(shape))
    letters = ("R", "S", "v", "omega", "a", "alpha")
    return hp.BodyMotion(**{k: part.reshape(*shape, *part.shape[1:]) for k, part in zip(letters, parts, strict=True)})


def test_the_twin_is_the_model_of_the_urdf():
    twin, model = hp.to_pinocchio(hp.load_robot("panda")), pin.buildModelFromUrdf(str(robot_urdf("panda")))
    assert list(twin.model.names) == list(model.names)
    assert (twin.model.nq, twin.model.nv, twin.has_free_flyer) == (9, 9, False)
    assert np.array_equal(twin.model.lowerPositionLimit, model.lowerPositionLimit)
    assert np.array_equal(twin.model.upperEffortLimit, model.upperEffortLimit)
    assert np.array_equal(twin.model.upperVelocityLimit, model.upperVelocityLimit)
    q = np.linspace(-1, 1, 8)
    own, other = twin.configuration(q), np.r_[q, q[7]]
    assert np.array_equal(own, other)
    one, two = twin.model.createData(), model.createData()
    for frame in model.frames:
        if frame.type == pin.FrameType.BODY:
            pin.framesForwardKinematics(twin.model, one, own)
            pin.framesForwardKinematics(model, two, other)
            places = [
                data.oMf[own_model.getFrameId(frame.name, pin.FrameType.BODY)]
                for own_model, data in ((twin.model, one), (model, two))
            ]
            assert np.abs(places[0].translation - places[1].translation).max() <= 32 * U
    assert np.abs(pin.rnea(twin.model, one, own, own, own) - pin.rnea(model, two, own, own, own)).max() <= 1024 * U


def test_what_follows_has_a_coordinate_of_its_own():
    rule = '<mimic joint="elbow" multiplier="-2" offset="0.5"/>'
    robot = hp.Mechanism.from_urdf(ARM.replace('<mimic joint="elbow"/>', rule))
    twin = hp.to_pinocchio(robot)
    assert robot.names == ("shoulder", "elbow", "slide")
    assert list(twin.model.names)[1:] == ["shoulder", "elbow", "follower", "slide"]
    assert twin.configuration((0.1, 0.2, 0.3)).tolist() == [0.1, 0.2, 0.5 - 0.4, 0.3]
    assert twin.velocity((0, 0, 0), (0.1, 0.2, 0.3)).tolist() == [0.1, 0.2, -0.4, 0.3]
    assert twin.acceleration((0, 0, 0), (0, 0, 0), (0.1, 0.2, 0.3)).tolist() == [0.1, 0.2, -0.4, 0.3]


@pytest.mark.parametrize("name", ["iris_simple", "ur5_robot"])
def test_the_twin_has_the_masses_to_the_last_bit(name):
    """However many links a body has: with each that it adds, Pinocchio rounds the masses."""
    robot = hp.load_robot(name, base="free")
    bodies = [tree_of(robot).base, *(joint.body for joint in tree_of(robot).joints)]
    for own, inertia in zip(bodies, list(hp.to_pinocchio(robot).model.inertias)[1:], strict=True):
        assert (inertia.mass, inertia.lever.tolist()) == (own.mass, own.centre_of_mass.tolist())


# ---------------------------------------------------------------- the report

MASS = '><inertial><mass value="2"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
LADEN = re.sub('(<link name="[a-z]+")/>', rf"\1{MASS}", ARM).replace("1e-200", "1")  # which Pinocchio takes for 0
LEVELS = {
    1: {"R", "S", "d", "jacobian", "mass_matrix"},
    2: {"v", "omega", "kinetic", "potential", "linear", "angular"},
    3: {"a", "alpha", "tau", "force1", "torque1", "forward_dynamics"},
}


@pytest.mark.slow
@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("base", ["fixed", "free"])
def test_a_robot_is_compared_output_by_output(base, level):
    rng = states.generator(502)
    robot = hp.Mechanism.from_urdf(LADEN, base=base)
    coordinates = rng.normal(size=(level, 2, 3, robot.dof))
    report = hp.cross_validate(robot, *coordinates, base_motion=base_motion(rng, 3))
    assert report.ok, str(report)
    assert {row.output for row in report.rows} == set().union(*(LEVELS[k] for k in range(1, level + 1)))
    assert all(row.samples == 6 for row in report.rows)
    assert (report.samples, report.compared, report.skipped) == (6, 6, 0)
    passed = f"PASSED: {len(report.rows)} outputs of 6 samples"
    assert report.verdict == f"{passed} within 16 u*scale of Pinocchio"


@pytest.mark.slow
def test_a_difference_fails(monkeypatch):
    """Any output off by 100 of its u * scale, at one sample and in one part."""
    robot, q = hp.load_robot("ur5_robot"), np.linspace(-2, 2, 24).reshape(4, 6)
    by_equations = comparison._outputs_by_equations
    for name in set().union(*LEVELS.values()) - {"forward_dynamics"}:

        def harmed(*given, name=name):
            found, *more = by_equations(*given)
            found[name][2] *= 1 + 1e-12
            found[name][2] += 1e-12
            return found, *more

        monkeypatch.setattr(comparison, "_outputs_by_equations", harmed)
        report = hp.cross_validate(robot, q, q, q)
        failed = [row for row in report.rows if not row.ok]
        assert name in {row.output for row in failed}, name
        assert failed[0].worst_sample == (2,)
        assert report.verdict.startswith("FAILED: ")


@pytest.mark.slow
def test_forward_dynamics_is_judged_by_what_it_leaves(monkeypatch):
    robot, q = hp.load_robot("ur5_robot"), np.linspace(-2, 2, 24).reshape(4, 6)
    by_equations = comparison._outputs_by_equations

    def harmed(*given):
        found, *more = by_equations(*given)
        found["qdd"][1, 2] *= 1 + 1e-9
        return found, *more

    monkeypatch.setattr(comparison, "_outputs_by_equations", harmed)
    (failed,) = [row for row in hp.cross_validate(robot, q, q, q).rows if not row.ok]
    assert (failed.output, failed.worst_sample) == ("forward_dynamics", (1,))


def pendulum(*masses):
    """Two hinges about y in series with point masses a metre behind each; a mass of 0 is none."""
    model = pin.Model()
    for name, reach, mass in zip(("upper", "lower"), (0.0, 1.0), masses, strict=True):
        place = pin.SE3(np.eye(3), np.array((reach, 0, 0)))
        number = model.addJoint(model.njoints - 1, pin.JointModelRY(), place, name)
        model.appendBodyToJoint(
            number, pin.Inertia(mass, np.array((1.0, 0, 0)), np.zeros((3, 3))), pin.SE3.Identity()
        )
    return hp.Mechanism.from_pinocchio(model)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hingepair.DynamicsWarning")
def test_what_a_singular_mass_matrix_leaves_is_said():
    """Nothing resists a joint without mass; nothing resists folding an arm whose one mass is at its straight tip."""
    q = np.array(((0.3, 0.4), (0.3, 0.0), (0.1, 1.0)))
    report = hp.cross_validate(pendulum(2, 0), q, q, q)
    assert "forward_dynamics" not in {row.output for row in report.rows}
    assert report.ok, str(report)
    note = "forward_dynamics is not compared at 3 of 3 samples, where the mass matrix is singular"
    assert report.notes == (note,)
    report = hp.cross_validate(pendulum(0, 2), q, q, q)
    assert report.rows[-1].samples == 2, str(report)
    assert "forward_dynamics is not compared at 1 of 3 samples" in str(report)
    assert report.verdict == "PASSED: 17 outputs of 3 samples within 16 u*scale of Pinocchio"


def harmed_tree(part):
    """The robot of LADEN with one part of its description wrong."""
    tree = tree_of(hp.Mechanism.from_urdf(LADEN))
    first, *others = tree.joints
    changes = {
        "names": {"name": "neck"},
        "R": {"u": first.u + 1e-13},
        "mass_matrix": {"body": dataclasses.replace(first.body, inertia=first.body.inertia * (1 + 1e-12))},
    }
    return dataclasses.replace(tree, joints=(dataclasses.replace(first, **changes[part]), *others))


@pytest.mark.slow
@pytest.mark.parametrize("part", ["names", "R", "mass_matrix"])
def test_an_error_of_reading_fails(part):
    robot = hp.Mechanism.from_urdf(LADEN)
    object.__setattr__(robot, "_tree", harmed_tree(part))
    report = hp.cross_validate(robot, np.ones(robot.dof))
    assert part in [row.output for row in report.rows if not row.ok]
    assert report.verdict.startswith("FAILED: ")
    assert part in [row["output"] for row in json.loads(report.to_json())["rows"]]


@pytest.mark.slow
def test_joints_that_are_held_stand_still_in_the_reading_of_pinocchio():
    rule = '<mimic joint="elbow" multiplier="-2" offset="0.5"/>'
    text = LADEN.replace('<mimic joint="elbow"/>', rule)
    for locked in ({"shoulder": 0.3}, {"elbow": 0.4}, {"follower": 0.1, "elbow": 0.2}):
        robot = hp.Mechanism.from_urdf(text, locked=locked)
        q = states.generator(504).normal(size=(3, 5, robot.dof))
        report = hp.cross_validate(robot, *q)
        assert report.ok, str(report)
        assert report.compared_with == "Pinocchio's reading of the URDF"
