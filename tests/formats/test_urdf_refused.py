"""URDF that cannot be used is refused, by an error that says where and what would do."""

from __future__ import annotations

import pinocchio as pin
import pytest

from hingepair.errors import URDFError
from hingepair.formats.urdf_reader import from_urdf
from hingepair.urdf.reader import read_urdf
from support.exported import ARM
from support.work import bounded_calls

NO_LINK = "expected a parent and a child that are links of the robot"
ONE_BODY = "expected a parent and a child that are not fixed to each other, got"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('xyz="1 2 3"', 'xyz="1 2"', "joint 'elbow', origin xyz: expected three finite numbers, got '1 2'"),
        ('xyz="1 2 3"', 'xyz="1 2 3 4"', "joint 'elbow', origin xyz"),
        ('xyz="1 2 3"', 'xyz="1,5 2 3"', "joint 'elbow', origin xyz"),
        ('xyz="1 2 3"', 'xyz="1 2 nan"', "joint 'elbow', origin xyz"),
        ('xyz="1 2 3"', 'xyz="1 2 1e999"', "joint 'elbow', origin xyz"),
        ('xyz="1 2 3"', 'xyz="1_0 2 3"', "joint 'elbow', origin xyz"),
        pytest.param('xyz="1 2 3"', f'xyz="{"1" * 1_000_000}x 2 3"', "joint 'elbow', origin xyz", id="long"),
        ('xyz="1 2 3"', 'xyz=""', "joint 'elbow', origin xyz"),
        ('xyz="1 2 3"', 'xyz="٣ 2 3"', "joint 'elbow', origin xyz"),
        ('rpy="0.1 -0.2 0.3"', 'rpy="${pi} 0 0"', "joint 'shoulder', origin rpy"),
        ('xyz="0 0 2"', 'xyz="0 0 x"', "joint 'shoulder', axis xyz"),
        ('xyz="0 0 2"', 'xyz="0 0 0"', "joint 'shoulder', axis xyz: expected a non-zero axis"),
        ('<parent link="base"/>', "", f"joint 'shoulder': {NO_LINK}, got none"),
        ('<child link="upper"/>', "<child/>", f"joint 'shoulder': {NO_LINK}, got none"),
        ('name="elbow"', 'name="shoulder"', "joint: expected each name once, got 'shoulder' twice"),
        ('<link name="base"/>', '<link name="base"/><link name="upper"/>', "link: expected each name once"),
        ('<child link="lower"/>', '<child link="upper"/>', "child link: expected each name once"),
        (
            '<parent link="upper"/> <child link="lower"/>',
            '<parent link="upper"/> <child link="upper"/>',
            "child link: e",
        ),
        ('<link name="upper"/>', "", f"joint 'elbow': {NO_LINK}"),
        ('<parent link="base"/>', '<parent link="bse"/>', f"joint 'shoulder': {NO_LINK} (nearest: base), got 'bse'"),
        ('<parent link="base"/>', '<parent link="upper"/>', f"joint 'shoulder': {ONE_BODY} 'upper' and 'upper'"),
        ('<parent link="base"/>', '<parent link="camera"/>', f"joint 'shoulder': {ONE_BODY} 'camera' and 'upper'"),
        ('<link name="camera"/>', "", f"joint 'weld': {NO_LINK}, got 'camera'"),
        ('<child link="camera"/>', "", f"joint 'weld': {NO_LINK}, got none"),
        ('<child link="camera"/>', '<child link="upper"/>', "child link: expected each name once, got 'upper' twice"),
        ("robot", "model", "URDF: expected the element <robot>, got <model>"),
    ],
)
def test_a_malformed_urdf_is_refused_by_name(old, new, message):
    assert old in ARM
    with pytest.raises(URDFError) as raised:
        from_urdf(ARM.replace(old, new), "elbow" if "'elbow'" in message else "shoulder")
    assert str(raised.value).startswith(message)
    assert isinstance(raised.value, ValueError)


@pytest.mark.parametrize("kind", ["fixed", "revolute", "prismatic"])
def test_a_joint_on_an_undeclared_link_is_refused_as_pinocchio_refuses_it(kind):
    mass = '<inertial><mass value="{}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    joint = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><limit effort="1" velocity="1"/></joint>'
    links = "".join(f'<link name="{name}">{mass.format(kg)}</link>' for name, kg in (("a", 1), ("b", 2), ("c", 5)))
    joints = joint.format("j", "revolute", "a", "b") + joint.format("k", kind, "b", "c")
    text = f'<robot name="r">{links}{joints}</robot>'
    assert from_urdf(text, "j").body2.mass == (7 if kind == "fixed" else 2)
    assert sum(inertia.mass for inertia in pin.buildModelFromXML(text).inertias) == 8
    misspelt = text.replace('<parent link="b"/>', '<parent link="bb"/>')
    with pytest.raises(ValueError, match="valid URDF"):
        pin.buildModelFromXML(misspelt)
    for read in (read_urdf, lambda text: from_urdf(text, "j")):
        with pytest.raises(URDFError, match=r"joint 'k': .* links of the robot \(nearest: b\), got 'bb'"):
            read(misspelt)


def test_links_fixed_in_a_circle_are_refused():
    circle = '<joint name="{0}" type="fixed"><parent link="{1}"/><child link="{2}"/></joint>'
    extra = '<link name="foot"/>' + circle.format("down", "base", "foot") + circle.format("up", "foot", "base")
    with pytest.raises(URDFError, match=r"joint '(up|down)': expected a tree of links, got a circle through"):
        from_urdf(ARM.replace("</robot>", f"{extra}</robot>"), "shoulder")


ZERO_MASS = '<inertial><mass value="nan"/></inertial>'
ELSEWHERE = {
    "reversed limits": ('<limit effort="1" velocity="1"/>', '<limit lower="1" upper="-1"/>'),
    "an effort that is no number": ('<limit effort="1" velocity="1"/>', '<limit effort="strong" velocity="-1"/>'),
    "an origin that is no number": ('xyz="1 2 3"', 'xyz="1 nan 3"'),
    "a mass that is none": ('<link name="hand"/>', f'<link name="hand">{ZERO_MASS}</link>'),
    "a joint without name": ('name="elbow"', ""),
    "a joint that is its own parent": ('<parent link="lower"/>', '<parent link="hand"/>'),
    "a joint without child": ('<child link="tool"/>', ""),
    "a link that is not declared": ('<link name="tool"/>', ""),
    "a link twice": ('<link name="tool"/>', '<link name="tool"/><link name="tool"/>'),
    "two joints of one name": ('name="follower"', 'name="elbow"'),
    "a zero axis": ('xyz="0 1e-200 0"', 'xyz="0 0 0"'),
    "a mimic of nothing": ('<mimic joint="elbow"/>', "<mimic/>"),
}


@pytest.mark.parametrize(("old", "new"), ELSEWHERE.values(), ids=ELSEWHERE)
def test_what_the_hinge_does_not_need_refuses_nobody(old, new):
    assert old in ARM
    assert repr(from_urdf(ARM.replace(old, new), "shoulder")) == repr(from_urdf(ARM, "shoulder"))


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
    with pytest.raises(URDFError, match=r"^URDF: "), bounded_calls(1_000):
        from_urdf(text, "knee")


@pytest.mark.parametrize("name", ["doctype", "entity bomb", "quadratic", "file", "remote dtd"])
def test_a_doctype_is_refused_for_what_it_is(name):
    with pytest.raises(URDFError, match="without a DOCTYPE"):
        read_urdf(HOSTILE[name])


NO_URDF = [b"", b"\xff\xfe<", b"not xml", b'<?xml version="1.0" encoding="no-such"?><robot/>', b"\x00" * 100]


@pytest.mark.parametrize("content", NO_URDF, ids=ascii)
def test_a_file_that_is_no_urdf_is_refused(tmp_path, content):
    path = tmp_path / "x.urdf"
    path.write_bytes(content)
    with pytest.raises(URDFError, match=r"^URDF: expected XML"):
        from_urdf(path, "knee")
