"""URDF text read as records, without trust in where it comes from."""

from __future__ import annotations

import math
import os
import re
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from hingepair.errors import URDFError, nearest, quoted
from hingepair.rotations.sequences import find_sequence
from hingepair.urdf.records import (
    HINGE_TYPES,
    SHAPE_SIZES,
    SLIDER_TYPES,
    JointRecord,
    LinkRecord,
    MimicRecord,
    RobotRecord,
    Visual,
)
from hingepair.urdf.rigid import FramePose, MassProperties

# A number as URDF writes it; possessive, so that the time stays linear.
_NUMBER = re.compile(r"[+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d++)?", re.ASCII)
_COUNTS = {1: "a finite number", 3: "three finite numbers", 4: "four finite numbers"}
_ZERO_VECTOR = (0.0, 0.0, 0.0)
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_HALF_PI = Fraction(math.pi / 2) + Fraction(6.123233995736766e-17)  # to 107 bits
_MAX_QUARTERS = 2**20  # multiples of pi/2 beyond have rounded sines and cosines
_QUARTERS = ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))  # sine and cosine of 0, 1, 2, 3 quarter turns


def read_urdf(path_or_text: str | os.PathLike[str], snap: float = 0.0) -> RobotRecord:
    """Read the links and joints of a URDF file or text (which starts with "<"); no meshes are read.

    An angle of an origin (rpy) within `snap` [rad] of a multiple of pi/2 is read as this multiple. With 0, only an
    angle that is the double nearest to a multiple of pi/2 is.
    """
    text = _read_text(path_or_text)
    root = _parsed(text)
    links: dict[str, LinkRecord] = {}
    for element in root.findall("link"):
        name = element.get("name", "")
        if not name or name in links:
            raise URDFError("link", "each name once", f"{name!r} twice" if name else "a link without a name")
        links[name] = _link(element, name, snap)
    if not links:
        raise URDFError("URDF", "a robot with a link", "none")
    reductions = _reductions(root)
    joints = [_joint(element, snap, reductions) for element in root.findall("joint")]
    top, ordered = _tree(links, joints)
    folder = None if isinstance(text, str) else Path(path_or_text).absolute().parent
    return RobotRecord(root.get("name", ""), links, top, ordered, text, folder)


# ---- XML


class _Builder(ET.TreeBuilder):
    """Builder of XML trees that refuses a DOCTYPE before any entity that it declares is expanded."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        # Its entities could name files, or grow without bound.
        raise URDFError("URDF", "XML without a DOCTYPE", f"<!DOCTYPE {name} {pubid or ''} {system or ''}>")


def _read_text(path_or_text: str | os.PathLike[str]) -> str | bytes:
    """Return the text of a URDF: the argument itself if it starts with "<", else the bytes of a file."""
    if isinstance(path_or_text, str) and path_or_text.lstrip("\ufeff \t\r\n").startswith("<"):
        return path_or_text.lstrip("\ufeff \t\r\n")
    try:
        return Path(path_or_text).read_bytes()
    except (OSError, ValueError, TypeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise URDFError("path_or_text", "a readable file or URDF text", f"{path_or_text!r} ({reason})") from None


def _parsed(text: str | bytes) -> ET.Element:
    """Return the element <robot>; refuse text that is no XML, has macros, or describes something else."""
    parser = ET.XMLParser(target=_Builder())
    try:
        parser.feed(text)
        root = parser.close()
    except URDFError:
        raise
    except (ET.ParseError, ValueError, LookupError) as error:
        raise URDFError("URDF", "XML", str(error)) from None
    if root.tag != "robot":
        hint = " (hp.Mechanism.from_mjcf reads MJCF)" if root.tag in {"mujoco", "mujocoinclude"} else ""
        raise URDFError("URDF", f"the element <robot>{hint}", f"<{root.tag}>")
    for element in root.iter():
        for name in (element.tag, *element.attrib):
            if "xacro" in str(name).partition("}")[0]:  # a namespace
                expected = "a URDF without macros (the command xacro expands them)"
                raise URDFError("URDF", expected, f"xacro:{name.partition('}')[2]}")
    return root


# ---- links and joints


def _link(element: ET.Element, name: str, snap: float) -> LinkRecord:
    label = f"link {name!r}, inertial"
    (mass,) = _numbers(element.find("inertial/mass"), "value", label, (0.0,))
    moments = element.find("inertial/inertia")
    xx, xy, xz, yy, yz, zz = (_number(moments, key, label, 0.0) for key in _INERTIA)
    at_centre = MassProperties(mass, np.zeros(3), np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))))
    masses = at_centre.placed(_pose(element.find("inertial/origin"), label, snap))
    return LinkRecord(name, masses, _visuals(element, "visual", snap), _visuals(element, "collision", snap))


def _visuals(link: ET.Element, tag: str, snap: float) -> tuple[Visual, ...] | None:
    """Return the elements `tag` of a link; None if they cannot be read, which does not matter to motion."""
    try:
        return tuple(_visual(element, snap) for element in link.findall(tag))
    except URDFError:
        return None


def _visual(element: ET.Element, snap: float) -> Visual:
    shape = element.find("geometry/*")
    pose = _pose(element.find("origin"), "", snap)
    if shape is None:
        return Visual("", (), pose)
    sizes = SHAPE_SIZES.get(shape.tag, {}).items()
    visual = Visual(shape.tag, tuple(x for key, n in sizes for x in _numbers(shape, key, "", (0.0,) * n)), pose)
    if shape.tag != "mesh":
        return visual
    colour = element.find("material/color")
    rgba = None if colour is None else _numbers(colour, "rgba", "", (0.5, 0.5, 0.5, 1.0))
    scale = _numbers(shape, "scale", "", (1.0, 1.0, 1.0))
    return visual._replace(file=shape.get("filename", ""), scale=scale, colour=rgba)


def _joint(element: ET.Element, snap: float, reductions: dict[str, float]) -> JointRecord:
    name, kind = element.get("name", ""), element.get("type", "")
    label = f"joint {name!r}"
    parent, child = ("" if (one := element.find(tag)) is None else one.get("link", "") for tag in ("parent", "child"))
    if not name:
        raise URDFError("joint", "a name", f"none, between {parent!r} and {child!r}")
    joint = JointRecord(name, kind, parent, child, _pose(element.find("origin"), label, snap))
    if kind not in (*HINGE_TYPES, *SLIDER_TYPES):
        return joint
    axis = _numbers(element.find("axis"), "xyz", f"{label}, axis", (1.0, 0.0, 0.0))
    if not any(axis):
        raise URDFError(f"{label}, axis xyz", "a non-zero axis", axis)
    limits = None
    if kind != "continuous":
        lower, upper = (_number(element.find("limit"), key, f"{label}, limit", 0.0) for key in ("lower", "upper"))
        if lower > upper:
            raise URDFError(f"{label}, limit", "lower below upper", f"lower {lower!r}, upper {upper!r}")
        limits = (lower, upper) if lower or upper else None

    def from_0(tag: str, key: str, default: Any = None) -> Any:
        """Return a number that is not negative."""
        number = _number(element.find(tag), key, f"{label}, {tag}", default)
        if number is not None and number < 0:
            raise URDFError(f"{label}, {tag} {key}", "a number not below 0", number)
        return number

    mimic = None
    if (rule := element.find("mimic")) is not None:
        factors = (_number(rule, key, f"{label}, mimic", one) for key, one in (("multiplier", 1.0), ("offset", 0.0)))
        mimic = MimicRecord(rule.get("joint", ""), *factors)
    return joint._replace(
        axis=axis,
        limits=limits,
        effort=from_0("limit", "effort"),
        velocity=from_0("limit", "velocity"),
        damping=from_0("dynamics", "damping", 0.0),
        friction=from_0("dynamics", "friction", 0.0),
        mimic=mimic,
        reduction=reductions.get(name, 1.0),
    )


def _reductions(root: ET.Element) -> dict[str, float]:
    """Return the gear ratios of the elements <transmission>, by joint. One of several joints or motors has none."""
    found = {}
    for transmission in root.findall("transmission"):
        joints = transmission.findall("joint")
        texts = [one.text or "" for one in transmission.iter("mechanicalReduction")]
        if len(joints) == 1 and len(texts) == 1:
            name = joints[0].get("name", "")
            found[name] = _parsed_numbers(texts[0], 1, f"transmission of {name!r}, mechanicalReduction")[0]
    return found


# ---- the tree


def _tree(links: dict[str, LinkRecord], joints: Sequence[JointRecord]) -> tuple[str, tuple[JointRecord, ...]]:
    """Return the name of the root link and all joints, depth-first, siblings by name; refuse what is no tree."""
    named: dict[str, JointRecord] = {}
    carriers: dict[str, JointRecord] = {}
    carried = defaultdict(list)
    for joint in joints:
        if joint.name in named:
            raise URDFError("joint", "each name once", f"{joint.name!r} twice")
        named[joint.name] = joint
        for name in (joint.parent, joint.child):
            if name not in links:
                expected = "a parent and a child that are links of the robot" + nearest(name, links)
                raise URDFError(f"joint {joint.name!r}", expected, quoted(name) if name else "none")
        other = carriers.setdefault(joint.child, joint)
        if other is not joint:
            expected = f"to be the one joint that carries the link {joint.child!r}; {_how_to_close(joint)}"
            raise URDFError(f"joint {joint.name!r}", expected, f"{other.name!r} too")
        carried[joint.parent].append(joint)
    roots = [name for name in links if name not in carriers]
    if len(roots) > 1:
        raise URDFError("URDF", "one link that no joint carries, the root", ", ".join(map(repr, roots)))

    def on(link: str) -> list[JointRecord]:
        """Return the joints on a link, the last first."""
        return sorted(carried[link], key=lambda joint: joint.name, reverse=True)

    ordered: list[JointRecord] = []
    waiting = on(roots[0]) if roots else []
    while waiting:
        ordered.append(waiting.pop())
        waiting += on(ordered[-1].child)
    if len(ordered) < len(joints):
        reached = {joint.name for joint in ordered}
        left = next(joint for joint in joints if joint.name not in reached)
        expected = f"a tree of links; {_how_to_close(left)}"
        raise URDFError(f"joint {left.name!r}", expected, f"a circle through {left.child!r}")
    return roots[0], tuple(ordered)


def _how_to_close(joint: JointRecord) -> str:
    """Return what to do with a joint that closes a loop."""
    frame = f"robot.with_frame({joint.name!r}, {joint.parent!r}, R=...)"
    return (
        f"URDF has no closed loops: leave the joint out, and close the robot by {frame}.closed("
        f"hp.Loop({joint.name!r}, {joint.child!r}, kind='hinge', axis=...))"
    )


# ---- numbers


def _pose(origin: ET.Element | None, label: str, snap: float) -> FramePose:
    """Return the pose of an element <origin>, the identity for None: xyz [m], and rpy, fixed-axis XYZ [rad]."""
    label = f"{label}, origin"
    if origin is not None and origin.get("quat_xyzw") is not None:
        raise URDFError(label, "rpy; quaternions are not read", "quat_xyzw")
    position = np.array(_numbers(origin, "xyz", label, _ZERO_VECTOR))
    rpy = _numbers(origin, "rpy", label, _ZERO_VECTOR)
    order = find_sequence("xyz")
    trig = tuple(part for angle in order.angles(rpy) for part in sine_and_cosine(angle, snap))
    return FramePose(np.array(order.attitude(trig)).reshape(3, 3) + 0.0, position)


def sine_and_cosine(angle: float, snap: float = 0.0) -> tuple[float, float]:
    """Return (sine, cosine) of an angle [rad], exact for angles within `snap` of a multiple of pi/2 and for the
    double nearest to one, up to 2**20 pi/2.
    """
    turns = round(angle / (math.pi / 2))
    near = angle == float(turns * _HALF_PI) or abs(angle - turns * (math.pi / 2)) <= snap
    return _QUARTERS[turns % 4] if near and abs(turns) <= _MAX_QUARTERS else (math.sin(angle), math.cos(angle))


def _number(element: ET.Element | None, key: str, label: str, default: Any) -> Any:
    """Return the finite number of an attribute; `default` where there is none."""
    return _numbers(element, key, label, (default,))[0]


def _numbers(element: ET.Element | None, key: str, label: str, default: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the finite numbers of an attribute, as many as in `default`, which is returned where there is none."""
    text = None if element is None else element.get(key)
    return default if text is None else _parsed_numbers(text, len(default), f"{label} {key}")


def _parsed_numbers(text: str, count: int, label: str) -> tuple[float, ...]:
    words = text.split()
    if len(words) == count and all(_NUMBER.fullmatch(word) and np.isfinite(float(word)) for word in words):
        return tuple(map(float, words))
    raise URDFError(label, _COUNTS[count], quoted(text))
