"""The records of a URDF: turns that are exact, joints that are a tree, and text that is refused."""

from __future__ import annotations

import itertools
import math

import mpmath
import numpy as np
import pytest

from hingepair.errors import URDFError
from hingepair.rotations.euler import euler_to_matrix
from hingepair.urdf.reader import read_urdf, sine_and_cosine
from support.exported import ARM
from support.work import bounded_calls

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


def joint_of(text, name):
    return next(joint for joint in read_urdf(text).joints if joint.name == name)


def test_a_tree_is_depth_first_with_siblings_by_name():
    robot = read_urdf(ARM)
    assert robot.root == "base"
    assert [joint.name for joint in robot.joints] == ["shoulder", "elbow", "follower", "slide", "weld"]
    renamed = ARM.replace('"weld"', '"a weld"').replace('"elbow"', '"z elbow"')
    assert [joint.name for joint in read_urdf(renamed).joints][:3] == ["shoulder", "a weld", "z elbow"]


def test_what_a_joint_says_of_its_motion():
    joint = (
        '<dynamics damping="0.5" friction="0.25"/><mimic joint="elbow" multiplier="-2" offset="0.125"/>'
        '<limit effort="3" velocity="4"/>'
    )
    text = ARM.replace('<mimic joint="elbow"/>\n    <limit effort="1" velocity="1"/>', joint)
    assert joint in text
    follower, elbow = joint_of(text, "follower"), joint_of(text, "elbow")
    assert follower.mimic == ("elbow", -2.0, 0.125)
    assert (follower.damping, follower.friction, follower.effort, follower.velocity) == (0.5, 0.25, 3.0, 4.0)
    assert (elbow.mimic, elbow.damping, elbow.friction, elbow.effort, elbow.limits) == (None, 0, 0, None, None)
    assert joint_of(ARM, "follower").mimic == ("elbow", 1.0, 0.0)


def test_shapes_are_read_as_they_are_written_and_those_that_cannot_be_read_harm_nobody():
    shapes = (
        '<visual><geometry><box size="1 2 3"/></geometry></visual>'
        '<visual><origin xyz="0 1 0"/><geometry><cylinder radius="0.5" length="2"/></geometry></visual>'
        '<visual><geometry><sphere radius="4"/></geometry></visual>'
        '<visual><geometry><mesh filename="a.stl"/></geometry></visual>'
    )
    text = ARM.replace('<link name="hand"/>', f'<link name="hand">{shapes}</link>')
    found = read_urdf(text).links["hand"].visuals
    assert [(shape.kind, shape.sizes) for shape in found] == [
        ("box", (1.0, 2.0, 3.0)), ("cylinder", (0.5, 2.0)), ("sphere", (4.0,)), ("mesh", ()),
    ]  # fmt: skip
    assert found[1].pose.origin.tolist() == [0, 1, 0]
    assert read_urdf(text.replace('radius="4"', 'radius="x"')).links["hand"].visuals is None


@pytest.mark.parametrize(
    ("old", "new", "argument"),
    [
        ('xyz="1 2 3"', 'xyz="1 2"', "joint 'elbow', origin xyz"),
        ('xyz="1 2 3"', 'xyz="1,5 2 3"', "joint 'elbow', origin xyz"),
        ('xyz="1 2 3"', 'xyz="1 2 nan"', "joint 'elbow', origin xyz"),
        ('xyz="1 2 3"', 'xyz="1 2 1e999"', "joint 'elbow', origin xyz"),
        ('xyz="1 2 3"', 'xyz="1_0 2 3"', "joint 'elbow', origin xyz"),
        pytest.param('xyz="1 2 3"', f'xyz="{"1" * 1_000_000}x 2 3"', "joint 'elbow', origin xyz", id="long"),
        ('xyz="1 2 3"', 'xyz="٣ 2 3"', "joint 'elbow', origin xyz"),
        ('rpy="0.1 -0.2 0.3"', 'rpy="${pi} 0 0"', "joint 'shoulder', origin rpy"),
        ('rpy="0.1 -0.2 0.3"', 'quat_xyzw="0 0 0 1"', "joint 'shoulder', origin"),
        ('xyz="0 0 2"', 'xyz="0 0 0"', "joint 'shoulder', axis xyz"),
        ('<limit effort="1" velocity="1"/>', '<limit lower="1" upper="-1"/>', "joint 'follower', limit"),
        ('<limit effort="1" velocity="1"/>', '<limit effort="-1"/>', "joint 'follower', limit effort"),
        ('<link name="hand"/>', '<link name="hand"><inertial><mass value="nan"/></inertial></link>', "link 'hand'"),
        ('<parent link="base"/>', "", "joint 'shoulder'"),
        ('<child link="upper"/>', "<child/>", "joint 'shoulder'"),
        ('<parent link="base"/>', '<parent link="bse"/>', "joint 'shoulder'"),
        ('<link name="tool"/>', "", "joint 'slide'"),
        ('name="elbow"', 'name="shoulder"', "joint"),
        ('name="elbow"', "", "joint"),
        ('<link name="base"/>', '<link name="base"/><link name="upper"/>', "link"),
        ('<link name="camera"/>', "<link/>", "link"),
        ('<link name="tool"/>', '<link name="tool"/><link name="island"/>', "URDF"),
        ('<child link="camera"/>', '<child link="hand"/>', "joint 'weld'"),
        ('<parent link="upper"/> <child', '<parent link="tool"/> <child', "joint 'elbow'"),
        ("robot", "model", "URDF"),
        (ARM, "<mujoco/>", "URDF"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(old, new, argument):
    assert old in ARM
    with pytest.raises(URDFError) as raised:
        read_urdf(ARM.replace(old, new))
    assert raised.value.name.startswith(argument)


def test_a_robot_of_one_link_is_a_tree_and_one_of_none_is_not():
    robot = read_urdf('<robot name="r"><link name="a"/></robot>')
    assert (robot.root, robot.joints) == ("a", ())
    with pytest.raises(URDFError):
        read_urdf('<robot name="r"/>')


def test_macros_are_refused_and_what_they_made_is_read():
    head = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    for macro in ('<xacro:include filename="arm.xacro"/>', '<link name="b"><xacro:inertia m="1"/></link>'):
        with pytest.raises(URDFError, match=r"URDF: expected a URDF without macros .*, got xacro:in"):
            read_urdf(f'{head}<link name="a"/>{macro}</robot>')
    assert list(read_urdf(f'{head}<link name="a"/></robot>').links) == ["a"]


BOMB = "".join(f'<!ENTITY l{i} "{f"&l{i - 1};" * 10 if i else "ha"}">' for i in range(30))
HOSTILE = {
    "doctype": '<!DOCTYPE robot><robot name="r"/>',
    "entity bomb": f'<?xml version="1.0"?><!DOCTYPE r [{BOMB}]><robot name="r">&l29;</robot>',
    "quadratic": f'<!DOCTYPE r [<!ENTITY a "{"a" * 50_000}">]><robot name="{"&a;" * 20_000}"/>',
    "file": '<!DOCTYPE r [<!ENTITY x SYSTEM "file:///etc/passwd">]><robot name="r">&x;</robot>',
    "remote dtd": '<!DOCTYPE robot SYSTEM "http://localhost:1/x.dtd"><robot name="r"/>',
    "undeclared entity": '<robot name="r">&x;</robot>',
    "truncated": ARM.strip()[:200],
    "two roots": ARM + ARM,
    "deep": "<robot>" * 100_000,
    "empty element": "<",
    "surrogate": '<robot name="\ud800"/>',
    "nul": '<robot name="\x00"/>',
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_hostile_xml_is_refused_with_little_work(text):
    reason = "XML without a DOCTYPE" if "<!DOCTYPE" in text else ""
    with pytest.raises(URDFError, match=f"^URDF: expected {reason}"), bounded_calls(1_000):
        read_urdf(text)


NO_URDF = [b"", b"\xff\xfe<", b"not xml", b'<?xml version="1.0" encoding="no-such"?><robot/>', b"\x00" * 100]


@pytest.mark.parametrize("content", NO_URDF, ids=ascii)
def test_a_file_that_is_no_urdf_is_refused(tmp_path, content):
    path = tmp_path / "x.urdf"
    path.write_bytes(content)
    with pytest.raises(URDFError, match=r"^URDF: expected XML"):
        read_urdf(path)
