"""Real robots: each hinge as a pair moves like the same hinge within Pinocchio's kinematics of the whole robot."""

from __future__ import annotations

import importlib.metadata
import math
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from hingepair.errors import ArgumentError, MissingDependencyError
from hingepair.formats import robots
from hingepair.formats.robots import load_robot_hinge, robot_names, robot_urdf
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.pairs.accuracy import error_ratios
from support import states
from support.commands import refusal
from support.sparse import sparse

HINGES = {
    "talos_reduced": 32,
    "anymal_c_simple_description/anymal": 12,
    "solo12": 12,
    "panda": 7,
    "ur5_robot": 6,
    "tiago": 47,
}
"""A humanoid, two quadrupeds, two arms, and a wheeled robot with continuous and mimic joints."""

OUTPUTS = ("R2", "S2", "v2", "omega2", "a2", "alpha2")


class WholeRobot:
    """The robot in Pinocchio, its base flying and every joint moving, at one random state."""

    def __init__(self, path, rng):
        self.model = model = pin.buildModelFromUrdf(str(path), pin.JointModelFreeFlyer())
        self.data = model.createData()
        self.hinges = {
            joint.get("name"): (joint.find("parent").get("link"), joint.find("child").get("link"))
            for joint in ET.parse(path).getroot().findall("joint")
            if joint.get("type") in {"revolute", "continuous"}
        }
        self.psi = dict(zip(self.hinges, rng.uniform(-3, 3, len(self.hinges)), strict=True))
        self.q, self.v, self.a = pin.neutral(model), rng.normal(size=model.nv), rng.normal(size=model.nv)
        self.q[:3] = rng.normal(size=3)
        self.q[3:7] = pin.Quaternion(states.rotations(rng, 1)[0]).normalized().coeffs()
        for name, psi in self.psi.items():
            joint = model.joints[model.getJointId(name)]
            self.q[joint.idx_q : joint.idx_q + joint.nq] = psi if joint.nq == 1 else (math.cos(psi), math.sin(psi))
        pin.forwardKinematics(model, self.data, self.q, self.v, self.a)
        pin.updateFramePlacements(model, self.data)

    def rates(self, name):
        at = self.model.joints[self.model.getJointId(name)].idx_v
        return self.v[at], self.a[at]

    def link(self, name):
        """R, S, v, omega, a, alpha of a link's frame."""
        frame = self.model.getFrameId(name, pin.FrameType.BODY)
        place = self.data.oMf[frame]
        twist = pin.getFrameVelocity(self.model, self.data, frame, pin.LOCAL_WORLD_ALIGNED)
        classical = pin.getFrameClassicalAcceleration(self.model, self.data, frame, pin.LOCAL_WORLD_ALIGNED)
        parts = (place.translation, place.rotation, twist.linear, twist.angular, classical.linear, classical.angular)
        return {k: part.copy() for k, part in zip(("R", "S", "v", "omega", "a", "alpha"), parts, strict=True)}

    def chain_scales(self, name, parent):
        """The size of the terms that add up along the chain from the base to the hinge.

        W and A grow by each joint's rates: W += |q'|, A += |q''| + W |q'| + q'^2. Over each offset l between joints
        (and that of the parent link's frame): R += l, V += W l, a += (A + W^2) l; the base brings |R|, |v|, |omega|,
        |a|, |alpha|. Pinocchio goes through spatial accelerations, which adds W V to a. Rotations count as 1.
        """
        model = self.model
        base = [np.linalg.norm(part) for part in (self.q[:3], self.v[:3], self.v[3:6], self.a[:3], self.a[3:6])]
        R, V, W, a, A = base
        a += W * V
        path = list(model.supports[model.getJointId(name)])[2:]
        offsets = [model.jointPlacements[k].translation for k in path]
        offsets.append(model.frames[model.getFrameId(parent, pin.FrameType.BODY)].placement.translation)
        for k, offset in zip([*path, None], offsets, strict=True):
            size = np.linalg.norm(offset)
            R, V, a = R + size, V + W * size, a + (A + W * W) * size
            if k is not None:
                assert model.joints[k].nv == 1
                rate, change = np.abs((self.v[model.joints[k].idx_v], self.a[model.joints[k].idx_v]))
                A, W = A + change + W * rate + rate * rate, W + rate
        return {"R2": R, "S2": 1.0, "v2": V, "omega2": W, "a2": a + W * V, "alpha2": A}


def late_outputs(robot, states_):
    """(hinge, output) -> error in units of u * scale of the chain, where it is past 16."""
    late = {}
    for name in states_[0].hinges:
        pair = load_robot_hinge(robot, name)
        for state in states_:
            parent, child = state.hinges[name]
            body1 = BodyMotion(**state.link(parent))
            found = pair.forward_kinematics_from_body1(body1, state.psi[name], *state.rates(name))
            truth, scales = state.link(child), state.chain_scales(name, parent)
            for output in OUTPUTS:
                _, ratio = error_ratios(output, getattr(found, output), truth[output[:-1]], scales[output])
                late |= {(name, output): float(ratio)} if not ratio <= 16 else {}
    return late


@pytest.mark.slow
@pytest.mark.parametrize("robot", sparse(sorted(HINGES, key=HINGES.get), 6))
def test_each_hinge_moves_as_in_the_whole_robot(robot):
    rng = states.generator(90, len(robot))
    whole = [WholeRobot(robot_urdf(robot), rng) for _ in range(3)]
    assert len(whole[0].hinges) == HINGES[robot]
    assert not late_outputs(robot, whole)


@pytest.mark.proof
@pytest.mark.filterwarnings("ignore:inertia:hingepair.DynamicsWarning")  # of romeo_laas_small
def test_every_hinge_of_every_robot():
    """All revolute and continuous joints of all robots that Pinocchio loads; those it refuses are listed."""
    count, late, refused = 0, {}, {}
    for i, robot in enumerate(robot_names()):
        try:
            whole = WholeRobot(robot_urdf(robot), states.generator(91, i))
        except ValueError as error:
            refused[robot] = " ".join(str(error).split())
            continue
        count += len(whole.hinges)
        if whole.hinges:
            late |= {(robot, *key): ratio for key, ratio in late_outputs(robot, [whole]).items()}
    print(f"{count} hinges of {len(robot_names()) - len(refused)} robots; refused by Pinocchio: {refused}")
    assert not late
    assert count >= 1200
    assert len(refused) <= 1


def test_every_robot_has_a_name_of_its_own():
    names = robot_names()
    assert len(names) == len(set(names)) >= 68
    assert sorted(names) == list(names)
    assert {robot_urdf(name).suffix for name in names} == {".urdf"}
    assert len({robot_urdf(name) for name in names}) == len(names)
    assert all(robot_urdf(name).is_file() for name in names)


def test_a_stem_that_two_robots_share_needs_its_folder():
    with pytest.raises(ArgumentError) as raised:
        load_robot_hinge("anymal", "LF_HAA")
    expected = "robot: expected one robot: anymal_b_simple_description/anymal or anymal_c_simple_description/anymal"
    assert str(raised.value).startswith(expected)
    b, c = (load_robot_hinge(f"anymal_{x}_simple_description/anymal", "LF_HAA") for x in "bc")
    assert not np.array_equal(b.u1, c.u1)
    assert {"anymal_b_simple_description/anymal", "anymal_c_simple_description/anymal"} <= set(robot_names())
    assert "anymal" not in robot_names()


def test_the_pair_is_named_after_robot_and_joint():
    pair = load_robot_hinge("talos_reduced", "arm_left_4_joint")
    assert pair.name == "talos_reduced/arm_left_4_joint"
    assert np.array_equal(pair.u2, np.zeros(3))


@pytest.fixture
def forgotten():
    """The listing is read again, in this test and after it."""
    robots._urdf_paths.cache_clear()
    yield
    robots._urdf_paths.cache_clear()


@pytest.mark.usefixtures("forgotten")
def test_a_missing_package_is_said(monkeypatch):
    def none(name):
        raise importlib.metadata.PackageNotFoundError(name)

    monkeypatch.setattr(importlib.metadata, "distribution", none)
    for ask in (robot_names, lambda: load_robot_hinge("talos_reduced", "arm_left_4_joint")):
        with pytest.raises(MissingDependencyError, match=r"pip install 'hingepair\[robots\]'"):
            ask()
    for command in ("check", "view", "derive", "urdf", "run"):
        message = refusal(command, "panda")
        assert message.startswith(
            "panda: expected a file, or the package example-robot-data (pip install 'hingepair["
        )


@pytest.mark.usefixtures("forgotten")
def test_a_package_without_its_files_is_said(monkeypatch):
    class Hollow:
        files = None

    monkeypatch.setattr(importlib.metadata, "distribution", lambda _name: Hollow)
    with pytest.raises(MissingDependencyError, match="with its robots"):
        robot_names()
