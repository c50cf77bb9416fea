"""Robots written as URDF: what is read back, by this library and by Pinocchio, is the robot that was written."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.mechanism.mechanism import tree_of
from support.exported import ARM

U = 2.0**-53


def check_same(robot, back):
    """Compare two robots joint by joint; the links of the first are those of the second too."""
    one, other = tree_of(robot), tree_of(back)
    assert robot.names == back.names
    bodies = ([tree.base, *(joint.body for joint in tree.joints)] for tree in (one, other))
    for a, b in zip(*bodies, strict=True):
        assert a.mass == b.mass
        assert np.array_equal(a.centre_of_mass, b.centre_of_mass)
        assert np.array_equal(a.inertia, b.inertia)
    for a, b in zip(one.joints, other.joints, strict=True):
        assert (a.name, a.kind, a.parent, a.mimic) == (b.name, b.kind, b.parent, b.mimic)
        assert a.position_limits == b.position_limits
        assert np.array_equal(a.u, b.u)
        assert np.abs(a.S - b.S).max() <= 16 * U
        assert np.abs(a.n - b.n).max() <= 4 * U
    for name, frame in one.links.items():
        assert frame.body == other.links[name].body
        assert np.array_equal(frame.R, other.links[name].R)
        assert np.abs(frame.S - other.links[name].S).max() <= 16 * U


ROBOTS = {
    "panda": lambda: hp.load_robot("panda", locked={"panda_joint3": 0.5}),
    "romeo": lambda: hp.load_robot("romeo", base="free"),
    "tiago_pro": lambda: hp.load_robot("tiago_pro"),
    "icub": lambda: hp.load_robot("icub"),
    "one body": lambda: hp.load_robot("quadrotor_base"),
}
"""A locked joint, mimic joints, joints whose names are out of order, masses that no rigid body has, and no joint."""


@pytest.mark.slow
@pytest.mark.parametrize("name", ROBOTS)
def test_what_was_written_is_read_back(name):
    robot = ROBOTS[name]()
    text = hp.to_urdf(robot)
    check_same(robot, hp.Mechanism.from_urdf(text, base=robot.base))
    assert text == hp.to_urdf(robot)
    assert "-0.0 " not in text
    names = list(pin.buildModelFromXML(text).names)[1:]
    assert names == [joint.name for joint in tree_of(robot).joints]


BODY = hp.Body(mass=2, centre_of_mass=(0.1, 0, 0), inertia=(1, 1.5, 1))


def pairs():
    boom = hp.HingePair(u1=(1, 0, 2), u2=(-0.5, 0, 0), n=(0, 1, 0), name="boom", limits=(-1, 1), body2=BODY)
    home = hp.rotation_exp((0.3, 0.2, 0.1))
    return [
        boom,
        hp.Slider(u1=(0, 0, 1), u2=(0, 0.5, 0), n=(3, 0, 4), name="lift", rate_limit=2),
        hp.HingePair(u1=(1, 1, 1), u2=(0, 0, 0), n=(1, 2, 3), name="stick", home=home, torque_limit=7),
    ]


@pytest.mark.slow
@pytest.mark.parametrize("base", ["free", "floating", "fixed"])
def test_pairs_are_written_with_their_links(base):
    """Body 2 of a pair has its reference point off the hinge: it hangs on a link at the hinge."""
    robot = hp.Mechanism(pairs(), parents=[0, 1, 1], base="fixed", name="crane")
    text = hp.to_urdf(robot, base=base)
    root = ET.fromstring(text)
    kinds = {joint.get("name"): joint.get("type") for joint in root.findall("joint")}
    assert [kinds[name] for name in robot.names] == ["revolute", "prismatic", "continuous"]
    assert kinds.get("base") == {"free": None, "floating": "floating", "fixed": "fixed"}[base]
    assert [link.get("name") for link in root.findall("link")][:2] == ["base", "boom_at_joint"]
    if base != "floating":
        back = hp.Mechanism.from_urdf(text)
        check_same(robot, back)
        q = (0.3, 0.2, 0.1)
        frames = ("boom", "lift", "stick")
        states = [one.forward_kinematics(q, frames=frames) for one in (robot, back)]
        assert np.abs(states[0].R - states[1].R).max() <= 64 * U
        limits = back.effort_limits, back.rate_limits
        assert [limit.tolist() for limit in limits] == [[1000, 1000, 7], [100, 2, 100]]


def test_further_frames_are_links():
    robot = hp.load_robot("ur5_robot").with_frame("tool", link="tool0", R=(0, 0, 0.1))
    back = hp.Mechanism.from_urdf(hp.to_urdf(robot))
    assert set(back.links) == {*robot.links, "tool"}
    assert np.abs(tree_of(back).links["tool"].R - tree_of(robot).frames["tool"].R).max() == 0


def test_limits_of_one_side_are_written():
    model = pin.Model()
    limits = [np.array([value]) for value in (math.inf, math.inf, -math.inf, 0.5)]
    model.addJoint(0, pin.JointModelRX(), pin.SE3.Identity(), "knee", *limits)
    robot = hp.Mechanism.from_pinocchio(model)
    assert robot.position_limits.tolist() == [[-math.inf, 0.5]]
    assert hp.Mechanism.from_urdf(hp.to_urdf(robot)).position_limits.tolist() == [[-math.inf, 0.5]]


@pytest.mark.parametrize("base", ["free", "floating", "fixed"])
def test_a_floating_root_joint_is_a_free_base(base):
    robot = hp.Mechanism.from_urdf(ARM, base="free")
    text = hp.to_urdf(robot, base=base)
    back = hp.Mechanism.from_urdf(text)
    assert back.base == ("free" if base == "floating" else "fixed")
    assert hp.Mechanism.from_urdf(text, base="fixed").base == "fixed"
    if base == "floating":
        check_same(robot, back)
        assert robot.links == back.links
