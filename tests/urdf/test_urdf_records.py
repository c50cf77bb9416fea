"""The records of a URDF: turns that are exact, and links and joints that are no tree."""

from __future__ import annotations

import itertools
import math

import mpmath
import numpy as np
import pinocchio as pin
import pytest

from hingepair.errors import URDFError
from hingepair.rotations.euler import euler_to_matrix
from hingepair.urdf.reader import read_urdf
from hingepair.urdf.records import sine_and_cosine
from support.exported import ARM

U = 2.0**-53


def turned(*rpy, snap=0.0):
    """The rotation of a joint's origin."""
    origin = f'<origin rpy="{" ".join(repr(float(angle)) for angle in rpy)}"/>'
    text = '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="fixed"><parent link="a"/>'
    return read_urdf(f'{text}<child link="b"/>{origin}</joint></robot>', snap).joints[0].pose.rotation


def quarter_turns(axis, count):
    """The rotation by so many quarter turns about a coordinate axis, of integers."""
    turn = np.eye(3, dtype=int)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[[i, j, i, j], [i, j, j, i]] = (0, 0, -1, 1)
    return np.linalg.matrix_power(turn, count % 4)


def test_quarter_turns_are_exact():
    for turns in itertools.product((-2, -1, 0, 1, 3), repeat=3):
        roll, pitch, yaw = (quarter_turns(axis, count) for axis, count in enumerate(turns))
        rotation = turned(*(count * math.pi / 2 for count in turns))
        assert np.array_equal(rotation, yaw @ pitch @ roll), turns
        assert not np.signbit(rotation[rotation == 0]).any(), turns


def test_doubles_nearest_to_many_quarter_turns_are_exact():
    with mpmath.workdps(40):
        nearest = [float(count * mpmath.pi / 2) for count in range(3000)]
    assert {sine_and_cosine(angle) for angle in nearest} == {(0, 1), (1, 0), (0, -1), (-1, 0)}


@pytest.mark.parametrize("off", [math.ulp(math.pi / 2), -4 * math.ulp(1), 5e-12, 1e-7], ids=str)
def test_what_is_near_a_quarter_turn_is_not_one(off):
    """1.57079632679, as robots are written, is the turn that it says, unless another is asked for."""
    assert math.isclose(turned(math.pi / 2 + off, 0, 0)[1, 1], -off + 6e-17, rel_tol=0.5)
    assert np.array_equal(turned(math.pi / 2 + off, 0, 0, snap=1e-6), quarter_turns(0, 1))


def test_other_turns_are_those_of_fixed_axes():
    rng = np.random.default_rng(1)
    for rpy in (*rng.uniform(-4, 4, (20, 3)), (1e300, -1e22, 1e9)):
        assert np.abs(turned(*rpy) - euler_to_matrix(rpy, "xyz")).max() <= 6 * U


def test_a_tree_is_depth_first_with_siblings_by_name():
    root, joints = read_urdf(ARM).tree()
    assert root == "base"
    assert [joint.name for joint in joints] == ["shoulder", "elbow", "follower", "slide", "weld"]
    renamed = ARM.replace('"weld"', '"a weld"').replace('"elbow"', '"z elbow"')
    assert [joint.name for joint in read_urdf(renamed).tree()[1]][:3] == ["shoulder", "a weld", "z elbow"]


def test_what_a_joint_says_of_its_motion():
    joint = (
        '<dynamics damping="0.5" friction="0.25"/><mimic joint="elbow" multiplier="-2" offset="0.125"/>'
        '<limit effort="3" velocity="4"/>'
    )
    text = ARM.replace('<mimic joint="elbow"/>\n    <limit effort="1" velocity="1"/>', joint)
    assert joint in text
    follower = read_urdf(text).hinge("follower")
    assert follower.mimic == ("elbow", -2.0, 0.125)
    assert (follower.damping, follower.friction, follower.effort, follower.velocity) == (0.5, 0.25, 3.0, 4.0)
    elbow = read_urdf(text).hinge("elbow")
    assert (elbow.mimic, elbow.damping, elbow.friction, elbow.effort, elbow.limits) == (None, 0, 0, None, None)
    assert read_urdf(ARM).hinge("follower").mimic == ("elbow", 1.0, 0.0)


def test_shapes_are_read_as_they_are_written():
    shapes = (
        '<visual><geometry><box size="1 2 3"/></geometry></visual>'
        '<visual><origin xyz="0 1 0"/><geometry><cylinder radius="0.5" length="2"/></geometry></visual>'
        '<visual><geometry><sphere radius="4"/></geometry></visual>'
        '<visual><geometry><mesh filename="a.stl"/></geometry></visual>'
    )
    text = ARM.replace('<link name="hand"/>', f'<link name="hand">{shapes}</link>')
    found = read_urdf(text).links["hand"][0].visuals()
    assert [(shape.kind, shape.sizes) for shape in found] == [
        ("box", (1.0, 2.0, 3.0)), ("cylinder", (0.5, 2.0)), ("sphere", (4.0,)), ("mesh", ()),
    ]  # fmt: skip
    assert found[1].pose.origin.tolist() == [0, 1, 0]


WRONG = {
    "an undeclared child": (
        ('<link name="tool"/>', ""),
        "joint 'slide': expected a parent and a child that are links of the robot, got 'tool'",
    ),
    "two parents": (
        ('<child link="camera"/>', '<child link="hand"/>'),
        "joint 'weld': expected to be the one joint that carries the link 'hand', got 'follower' too",
    ),
    "two roots": (
        ('<link name="tool"/>', '<link name="tool"/><link name="island"/>'),
        "URDF: expected one link that no joint carries, the root, got 'base', 'island'",
    ),
    "a circle": (
        ('<parent link="upper"/> <child link="lower"/>', '<parent link="tool"/> <child link="lower"/>'),
        "joint 'elbow': expected a tree of links, got a circle through 'lower'",
    ),
    "two joints of one name": (('"slide"', '"elbow"'), "joint: expected each name once, got 'elbow' twice"),
    "a link without a name": (('<link name="camera"/>', "<link/>"), "joint 'weld': expected a parent and a child"),
}


@pytest.mark.parametrize(("change", "message"), WRONG.values(), ids=WRONG)
def test_what_is_no_tree_is_refused_by_name(change, message):
    text = ARM.replace(*change)
    assert text != ARM
    if "through all" in message or "'upper'" in message:
        text = text.replace('<link name="base"/>', "")
    with pytest.raises(URDFError) as raised:
        read_urdf(text).tree()
    assert str(raised.value).startswith(message)


def test_a_robot_of_one_link_is_a_tree_and_one_of_none_is_not():
    assert read_urdf('<robot name="r"><link name="a"/></robot>').tree() == ("a", ())
    with pytest.raises(URDFError, match="URDF: expected a robot with a link, got none"):
        read_urdf('<robot name="r"/>').tree()


WITH_QUATERNION = """<robot name="r" {version}><link name="a"/><link name="b"><inertial>
  <origin xyz="0 0 0.3" {inertial}/><mass value="1"/>
  <inertia ixx="1" iyy="2" izz="2.5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="j" type="revolute"><origin {joint}/><parent link="a"/><child link="b"/>
  <limit effort="1" velocity="1" lower="-1" upper="1"/></joint></robot>"""


@pytest.mark.parametrize("version", ["1.1", "1.2"])
@pytest.mark.parametrize("place", ["joint", "inertial"])
def test_quaternions_of_origins_are_read_as_pinocchio_reads_them(version, place):
    rng = np.random.default_rng(3)
    for quaternion in (*rng.normal(size=(5, 4)), (0, 0, 3, 3), (0.5, 0.5, -0.5, 0.5)):
        origins = {"joint": "", "inertial": ""} | {
            place: f'quat_xyzw="{" ".join(map(repr, map(float, quaternion)))}"'
        }
        text = WITH_QUATERNION.format(version=f'version="{version}"', **origins)
        model, robot = pin.buildModelFromXML(text), read_urdf(text)
        assert np.abs(robot.joints[0].pose.rotation - model.jointPlacements[1].rotation).max() <= 8 * U
        assert np.abs(robot.links["b"][0].inertia().tensor - model.inertias[1].inertia).max() <= 40 * U
    assert set(robot.joints[0].pose.rotation.ravel()) <= {0, 1, -1}


@pytest.mark.parametrize(
    ("version", "origin", "message"),
    [
        ("", 'quat_xyzw="0 0 0 1"', 'origin: expected <robot version="1.1"> or later'),
        ('version="1.0"', 'quat_xyzw="0 0 0 1"', "origin: expected <robot version"),
        ('version="1.1"', 'quat_xyzw="0 0 0 1" rpy="0 0 0"', "origin: expected no rpy"),
        ('version="1.1"', 'quat_xyzw="0 0 0 0"', "origin quat_xyzw: expected a quaternion that is not zero"),
        ('version="1.1"', 'quat_xyzw="0 0 1"', "origin quat_xyzw: expected four finite numbers"),
    ],
)
def test_a_rotation_that_readers_understand_differently_is_refused(version, origin, message):
    text = WITH_QUATERNION.format(version=version, joint=origin, inertial="")
    with pytest.raises(URDFError, match=f"joint 'j', {message}"):
        _ = read_urdf(text).joints[0].pose


def test_macros_are_refused_and_what_they_made_is_read():
    head = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    for macro in ('<xacro:include filename="arm.xacro"/>', '<link name="b"><xacro:inertia m="1"/></link>'):
        with pytest.raises(URDFError, match=r"URDF: expected a URDF without macros .*, got xacro:in"):
            read_urdf(f'{head}<link name="a"/>{macro}</robot>')
    assert list(read_urdf(f'{head}<link name="a"/></robot>').links) == ["a"]
    with pytest.raises(URDFError, match="got xacro:arm"):  # a namespace of any name
        read_urdf('<robot xmlns:xacro="x" name="a"><link name="base"/><xacro:arm parent="base"/></robot>')
