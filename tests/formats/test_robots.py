"""Real robots: each hinge as a pair is where Pinocchio has the same hinge in the whole robot."""

from __future__ import annotations

import importlib.metadata
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from hingepair.errors import ArgumentError, MissingDependencyError
from hingepair.formats import robots
from hingepair.formats.robots import load_robot_hinge, robot_names, robot_urdf
from support.commands import refusal
from support.sparse import sparse

U = 2.0**-53
HINGES = {
    "talos_reduced": 32,
    "anymal_c_simple_description/anymal": 12,
    "solo12": 12,
    "panda": 7,
    "ur5_robot": 6,
    "kinova": 6,
}
"""A humanoid, two quadrupeds, and three arms, one with continuous joints."""


def differences(robot):
    """Names of hinges whose places, axes or limits are not those of Pinocchio's model, and the count of hinges."""
    path = str(robot_urdf(robot))
    model, off, count = pin.buildModelFromUrdf(path), [], 0
    for joint in ET.parse(path).getroot().findall("joint"):
        if joint.get("type") not in {"revolute", "continuous"}:
            continue
        pair, number = load_robot_hinge(robot, joint.get("name")), model.getJointId(joint.get("name"))
        parent = model.frames[model.getFrameId(joint.find("parent").get("link"), pin.FrameType.BODY)]
        seat = parent.placement.actInv(model.jointPlacements[number])
        axis = np.ravel(model.joints[number].createData().S)[3:]
        size = 1 + np.linalg.norm(seat.translation) + np.linalg.norm(parent.placement.translation)
        far = np.abs(pair.u1 - seat.translation).max() > 16 * U * size
        turned = max(np.abs(pair.home - seat.rotation).max(), np.abs(pair.n - seat.rotation @ axis).max()) > 16 * U
        index, moved = model.joints[number].idx_q, np.any(pair.u2)
        other = pair.limits is not None and pair.limits != (
            model.lowerPositionLimit[index],
            model.upperPositionLimit[index],
        )
        off += [joint.get("name")] * bool(far or turned or moved or other)
        count += 1
    return off, count


@pytest.mark.slow
@pytest.mark.parametrize("robot", sparse(sorted(HINGES, key=HINGES.get), 6))
def test_each_hinge_is_where_the_whole_robot_has_it(robot):
    assert differences(robot) == ([], HINGES[robot])


@pytest.mark.filterwarnings("ignore::hingepair.DynamicsWarning")  # of masses, and of leaders that are not there
@pytest.mark.proof
def test_every_hinge_of_every_robot():
    """All revolute and continuous joints of all robots that Pinocchio loads; those it refuses are listed."""
    count, off, refused = 0, {}, {}
    for robot in robot_names():
        try:
            off[robot], hinges = differences(robot)
        except ValueError as error:
            refused[robot] = " ".join(str(error).split())
            continue
        count += hinges
    assert not any(off.values()), off
    assert count >= 1200
    assert len(refused) <= 1, refused


def test_every_robot_has_a_name_of_its_own():
    names = robot_names()
    assert len(names) == len(set(names)) >= 68
    assert sorted(names) == list(names)
    assert len({robot_urdf(name) for name in names}) == len(names)


def test_a_stem_that_two_robots_share_needs_its_folder():
    with pytest.raises(ArgumentError) as raised:
        load_robot_hinge("anymal", "LF_HAA")
    expected = "robot: expected one robot: anymal_b_simple_description/anymal or anymal_c_simple_description/anymal"
    assert str(raised.value).startswith(expected)
    b, c = (load_robot_hinge(f"anymal_{x}_simple_description/anymal", "LF_HAA") for x in "bc")
    assert not np.array_equal(b.u1, c.u1)


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
