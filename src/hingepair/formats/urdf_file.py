"""What a URDF says: its links and joints, each read and checked when it is asked for.

A robot has parts that a hinge has nothing to do with. What is wrong with these refuses nobody.
"""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hingepair.errors import URDFError, choices, nearest, quoted
from hingepair.numeric.arrays import FloatArray
from hingepair.pair.body import Box, Cylinder, Shape, Sphere
from hingepair.rotations.euler import euler_to_matrix

HINGE_TYPES = ("revolute", "continuous")

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_ORIGIN = (0.0, 0.0, 0.0)
_SIZES = {"box": {"size": 3}, "cylinder": {"radius": 1, "length": 1}, "sphere": {"radius": 1}}


class Pose(NamedTuple):
    """Rotation and origin of a frame, in the axes of another."""

    rotation: FloatArray
    origin: FloatArray

    def placed(self, inner: Pose) -> Pose:
        """A pose given in this frame, as this one is given."""
        return Pose(self.rotation @ inner.rotation, self.origin + self.rotation @ inner.origin)

    def seen(self, other: Pose) -> Pose:
        """A pose given as this one is, in this frame."""
        return Pose(self.rotation.T @ other.rotation, self.rotation.T @ (other.origin - self.origin))


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A joint as the URDF says it; a number that is none is refused, by joint and attribute, when it is read.

    Attributes:
        element: all that is said.
        name: nothing where none is given; likewise what follows.
        type: revolute, continuous, fixed, prismatic, floating or planar.
        parent: the link that carries it.
        child: the link that it carries, whose frame is the joint's.
        mimic: the joint whose angle it follows; nothing where it has its own.
    """

    element: ET.Element
    name: str
    type: str
    parent: str
    child: str
    mimic: str

    @property
    def pose(self) -> Pose:
        """Attitude at angle 0, and origin [m], in the parent's axes."""
        return _pose(self.element, self._where)

    @property
    def axis(self) -> tuple[float, ...]:
        """Its axis in the child's axes, as written, not normalised."""
        axis = _numbers(self.element.find("axis"), "xyz", f"{self._where}, axis", 3) or (1.0, 0.0, 0.0)
        if not any(axis):
            raise URDFError(f"{self._where}, axis xyz", "a non-zero axis", axis)
        return axis

    @property
    def limits(self) -> tuple[float, float] | None:
        """Least and greatest angle [rad]; None where both are 0, which is how URDF reads a range not given."""
        if self.type == "continuous":
            return None
        lower, upper = self._limit("lower") or 0.0, self._limit("upper") or 0.0
        if lower > upper:
            raise URDFError(f"{self._where}, limit", "lower below upper", f"lower {lower!r}, upper {upper!r}")
        return (lower, upper) if lower < upper else None

    def most(self, key: str) -> float | None:
        """Its largest torque ("effort") [N m] or rate ("velocity") [rad/s]; None where none is given."""
        number = self._limit(key)
        if number is not None and number < 0:
            raise URDFError(f"{self._where}, limit {key}", "a number not below 0", number)
        return number

    @property
    def _where(self) -> str:
        return f"joint {self.name!r}"

    def _limit(self, key: str) -> float | None:
        return _number(self.element.find("limit"), key, f"{self._where}, limit")


class Inertial(NamedTuple):
    """A link's mass properties as the URDF says them.

    Attributes:
        mass: kg.
        pose: centre of mass [m], and the axes of the tensor, in the link's axes.
        tensor: [kg m^2]; (3, 3).
    """

    mass: float
    pose: Pose
    tensor: FloatArray


def inertial_of(link: ET.Element) -> Inertial | None:
    """The mass properties of a link; None where none are given."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    where = f"link {link.get('name')!r}, inertial"
    mass, inertia = inertial.find("mass"), inertial.find("inertia")
    keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    xx, xy, xz, yy, yz, zz = (_number(inertia, key, where) or 0.0 for key in keys)
    tensor = np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    return Inertial(_number(mass, "value", where) or 0.0, _pose(inertial, where), tensor)


def shapes_of(link: ET.Element, pose: Pose) -> list[Shape] | None:
    """The boxes, cylinders and spheres of a link of this pose; None where it is drawn otherwise (meshes) too."""
    found: list[Shape] = []
    for visual in link.findall("visual"):
        shape = visual.find("geometry/*")
        if shape is None or shape.tag not in _SIZES:
            return None
        try:
            axes, center = (part + 0.0 for part in pose.placed(_pose(visual, "visual")))
            given = [_numbers(shape, key, shape.tag, count) or (0.0,) for key, count in _SIZES[shape.tag].items()]
        except URDFError:  # what it looks like is no matter of motion
            return None
        sizes = [size for group in given for size in group]
        if min(sizes) <= 0:
            continue
        if shape.tag == "box":
            found.append(Box(sizes, center, axes))
        elif shape.tag == "cylinder":
            found.append(Cylinder(sizes[0], sizes[1], center, axes[:, 2]))
        else:
            found.append(Sphere(sizes[0], center))
    return found


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """What a URDF says.

    Attributes:
        name: of the robot.
        links: by name, in order; a name that is given twice stands for both.
        joints: in order.
        joints_at: by link, the joints that it is parent or child of.
    """

    name: str
    links: Mapping[str, Sequence[ET.Element]]
    joints: Sequence[Joint]
    joints_at: Mapping[str, Sequence[Joint]]

    def hinges(self) -> tuple[Joint, ...]:
        """The revolute and continuous joints that have a name, mimic joints included."""
        return tuple(joint for joint in self.joints if joint.type in HINGE_TYPES and joint.name)

    def hinge(self, name: str) -> Joint:
        """The hinge of this name.

        Raises:
            URDFError: no such joint, two, or one that is no hinge; lists those that would do.
        """
        found = [joint for joint in self.joints if joint.name == name and name]
        if len(found) > 1:
            raise URDFError("joint", "each name once", f"{name!r} twice")
        if found and found[0].type in HINGE_TYPES:
            return found[0]
        known = [hinge.name for hinge in self.hinges()]
        if not known:
            raise URDFError("joint", "a robot with a revolute or continuous joint", quoted(name))
        if found:
            raise URDFError("joint", choices(known), f"{name!r}, which is {found[0].type or 'of no type'}")
        raise URDFError("joint", choices(known) + nearest(str(name), known), quoted(name))

    def check_link(self, name: str, joint: Joint) -> None:
        """Refuse a link that a joint names.

        Raises:
            URDFError: it is not declared, or twice, or more than one joint carries it.
        """
        links = self.links.get(name, ())
        if not links:
            got = quoted(name) if name else "none"
            raise URDFError(f"joint {joint.name!r}", "a parent and a child that are links of the robot", got)
        if len(links) > 1:
            raise URDFError("link", "each name once", f"{name!r} twice")
        if sum(joint.child == name for joint in self.joints_at[name]) > 1:
            raise URDFError("child link", "each name once", f"{name!r} twice")


def read_urdf(path_or_text: str | os.PathLike[str]) -> Robot:
    """The links and joints of a URDF; meshes and everything else are not touched.

    Args:
        path_or_text: the text itself (it starts with "<"), else a file's path.

    Raises:
        URDFError: the file cannot be read; not XML, a DOCTYPE in it (it could name files or grow without bound), not
            a robot.
    """
    parser = ET.XMLParser(target=_NoDoctype())
    try:
        parser.feed(_text(path_or_text))
        root = parser.close()
    except (ET.ParseError, ValueError, LookupError) as error:
        if isinstance(error, URDFError):
            raise
        raise URDFError("URDF", "XML", str(error)) from None
    if root.tag != "robot":
        raise URDFError("URDF", "the element <robot>", f"<{root.tag}>")
    links, joints_at = defaultdict(list), defaultdict(list)
    for element in root.findall("link"):
        links[element.get("name", "")].append(element)
    joints = [_joint(element) for element in root.findall("joint")]
    for joint in joints:
        for link in {joint.parent, joint.child}:
            joints_at[link].append(joint)
    return Robot(root.get("name", ""), links, joints, joints_at)


def _joint(element: ET.Element) -> Joint:
    named = [element.find(tag) for tag in ("parent", "child", "mimic")]
    parent, child = ("" if tag is None else tag.get("link", "") for tag in named[:2])
    mimic = "" if named[2] is None else named[2].get("joint", "")
    return Joint(element, element.get("name", ""), element.get("type", ""), parent, child, mimic)


class _NoDoctype(ET.TreeBuilder):
    """Refuses a DOCTYPE before anything that it declares is expanded."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise URDFError("URDF", "XML without a DOCTYPE", f"<!DOCTYPE {name} {pubid or ''} {system or ''}>")


def _text(path_or_text: str | os.PathLike[str]) -> str | bytes:
    """The text itself where it is one, else what the file holds."""
    if isinstance(path_or_text, str) and path_or_text.lstrip("\ufeff \t\r\n").startswith("<"):
        return path_or_text.lstrip("\ufeff \t\r\n")
    try:
        return Path(path_or_text).read_bytes()
    except (OSError, ValueError, TypeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise URDFError("path_or_text", "a readable file or URDF text", f"{path_or_text!r} ({reason})") from None


def _pose(element: ET.Element, where: str) -> Pose:
    """What the <origin> of an element says: xyz [m] and rpy, fixed-axis XYZ [rad]; without one, nothing is moved."""
    origin = element.find("origin")
    xyz, rpy = (_numbers(origin, key, f"{where}, origin", 3) or _ORIGIN for key in ("xyz", "rpy"))
    return Pose(euler_to_matrix(rpy, "xyz"), np.array(xyz))


def _number(element: ET.Element | None, name: str, where: str) -> float | None:
    found = _numbers(element, name, where, 1)
    return found[0] if found else None


def _numbers(element: ET.Element | None, name: str, where: str, count: int) -> tuple[float, ...] | None:
    """The one or three finite numbers of an attribute; None where it is not given."""
    text = None if element is None else element.get(name)
    if text is None:
        return None
    words = text.split()
    if len(words) == count and all(_NUMBER.fullmatch(word) and np.isfinite(float(word)) for word in words):
        return tuple(map(float, words))
    raise URDFError(f"{where} {name}", "a finite number" if count == 1 else "three finite numbers", quoted(text))
