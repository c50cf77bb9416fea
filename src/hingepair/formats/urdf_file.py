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

import numpy as np

from hingepair.errors import URDFError, choices, nearest, quoted

HINGE_TYPES = ("revolute", "continuous")

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_ORIGIN = (0.0, 0.0, 0.0)
_SIZES = {"box": ("size",), "cylinder": ("radius", "length"), "sphere": ("radius",)}

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """A joint as the URDF says it; a number that is none is refused, by joint and attribute, when it is read."""

    element: ET.Element

    @property
    def name(self) -> str:
        """Its name; nothing where none is given."""
        return self.element.get("name", "")

    @property
    def type(self) -> str:
        """Revolute, continuous, fixed, prismatic, floating or planar."""
        return self.element.get("type", "")

    @property
    def is_hinge(self) -> bool:
        """It turns about one axis."""
        return self.type in HINGE_TYPES

    @property
    def parent(self) -> str:
        """The link that carries it; nothing where none is given."""
        return self._named("parent", "link")

    @property
    def child(self) -> str:
        """The link that it carries, whose frame is the joint's; nothing where none is given."""
        return self._named("child", "link")

    @property
    def mimic(self) -> str:
        """The joint whose angle it follows; nothing where it has its own."""
        return self._named("mimic", "joint")

    @property
    def xyz(self) -> Triple:
        """Its origin in the parent's axes [m]."""
        return _triple(self.element.find("origin"), "xyz", f"{self._where}, origin", _ORIGIN)

    @property
    def rpy(self) -> Triple:
        """Its attitude at angle 0, fixed-axis XYZ [rad]."""
        return _triple(self.element.find("origin"), "rpy", f"{self._where}, origin", _ORIGIN)

    @property
    def axis(self) -> Triple:
        """Its axis in the child's axes, as written, not normalised."""
        axis = _triple(self.element.find("axis"), "xyz", f"{self._where}, axis", (1.0, 0.0, 0.0))
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

    @property
    def effort(self) -> float | None:
        """Its largest torque [N m]; None where none is given."""
        return self._not_below_0("effort")

    @property
    def velocity(self) -> float | None:
        """Its largest rate [rad/s]; None where none is given."""
        return self._not_below_0("velocity")

    @property
    def _where(self) -> str:
        return f"joint {self.name!r}"

    def _named(self, tag: str, attribute: str) -> str:
        element = self.element.find(tag)
        return "" if element is None else element.get(attribute, "")

    def _limit(self, key: str) -> float | None:
        return _number(self.element.find("limit"), key, f"{self._where}, limit")

    def _not_below_0(self, key: str) -> float | None:
        number = self._limit(key)
        if number is not None and number < 0:
            raise URDFError(f"{self._where}, limit {key}", "a number not below 0", number)
        return number


@dataclass(frozen=True, slots=True)
class Inertial:
    """A link's mass properties as the URDF says them.

    Attributes:
        mass: kg.
        xyz: centre of mass in the link's axes [m].
        rpy: attitude of the axes that the moments are given in, fixed-axis XYZ [rad].
        moments: Ixx, Ixy, Ixz, Iyy, Iyz, Izz [kg m^2].
    """

    mass: float
    xyz: Triple
    rpy: Triple
    moments: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Visual:
    """A shape that a link is drawn with.

    Attributes:
        kind: box, cylinder or sphere.
        sizes: lengths of a box's edges; radius and length of a cylinder; radius of a sphere [m].
        xyz: its centre in the link's axes [m].
        rpy: its attitude, fixed-axis XYZ [rad]; a cylinder's axis is its z.
    """

    kind: str
    sizes: tuple[float, ...]
    xyz: Triple
    rpy: Triple


@dataclass(frozen=True, slots=True, eq=False)
class Link:
    """A link as the URDF says it."""

    element: ET.Element

    @property
    def inertial(self) -> Inertial | None:
        """Its mass properties; None where none are given."""
        inertial = self.element.find("inertial")
        if inertial is None:
            return None
        where = f"link {self.element.get('name')!r}, inertial"
        origin, mass, inertia = (inertial.find(tag) for tag in ("origin", "mass", "inertia"))
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        return Inertial(
            mass=_number(mass, "value", where) or 0.0,
            xyz=_triple(origin, "xyz", f"{where}, origin", _ORIGIN),
            rpy=_triple(origin, "rpy", f"{where}, origin", _ORIGIN),
            moments=tuple(_number(inertia, key, where) or 0.0 for key in keys),
        )

    @property
    def visuals(self) -> tuple[Visual, ...] | None:
        """The boxes, cylinders and spheres that it is drawn with; None where it is drawn otherwise (meshes) too."""
        found = []
        for visual in self.element.findall("visual"):
            origin, shape = visual.find("origin"), visual.find("geometry/*")
            if shape is None or shape.tag not in _SIZES:
                return None
            try:
                xyz, rpy = (_triple(origin, key, "origin", _ORIGIN) for key in ("xyz", "rpy"))
                if shape.tag == "box":
                    sizes: tuple[float, ...] = _triple(shape, "size", "box", _ORIGIN)
                else:
                    sizes = tuple(_number(shape, key, shape.tag) or 0.0 for key in _SIZES[shape.tag])
            except URDFError:  # what it looks like is no matter of motion
                return None
            found.append(Visual(shape.tag, sizes, xyz, rpy))
        return tuple(found)


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
    links: Mapping[str, Sequence[Link]]
    joints: Sequence[Joint]
    joints_at: Mapping[str, Sequence[Joint]]

    def hinges(self) -> tuple[Joint, ...]:
        """The revolute and continuous joints that have a name, mimic joints included."""
        return tuple(joint for joint in self.joints if joint.is_hinge and joint.name)

    def hinge(self, name: str) -> Joint:
        """The hinge of this name.

        Raises:
            URDFError: no such joint, two, or one that is no hinge; lists those that would do.
        """
        found = [joint for joint in self.joints if joint.name == name and name]
        if len(found) > 1:
            raise URDFError("joint", "each name once", f"{name!r} twice")
        if found and found[0].is_hinge:
            return found[0]
        known = [hinge.name for hinge in self.hinges()]
        if not known:
            raise URDFError("joint", "a robot with a revolute or continuous joint", quoted(name))
        if found:
            raise URDFError("joint", choices(known), f"{name!r}, which is {found[0].type or 'of no type'}")
        raise URDFError("joint", choices(known) + nearest(str(name), known), quoted(name))

    def link(self, name: str, joint: Joint) -> Link:
        """The link that a joint names.

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
        return links[0]


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
        links[element.get("name", "")].append(Link(element))
    joints = [Joint(element) for element in root.findall("joint")]
    for joint in joints:
        for link in {joint.parent, joint.child}:
            joints_at[link].append(joint)
    return Robot(root.get("name", ""), links, joints, joints_at)


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


def _number(element: ET.Element | None, name: str, where: str) -> float | None:
    """The finite number of an attribute; None where it is not given."""
    text = None if element is None else element.get(name)
    if text is None:
        return None
    if _NUMBER.fullmatch(text.strip()) and np.isfinite(float(text)):
        return float(text)
    raise URDFError(f"{where} {name}", "a finite number", quoted(text))


def _triple(element: ET.Element | None, name: str, where: str, default: Triple) -> Triple:
    text = None if element is None else element.get(name)
    if text is None:
        return default
    words = text.split()
    if len(words) == 3 and all(_NUMBER.fullmatch(word) for word in words):
        x, y, z = map(float, words)
        if np.isfinite((x, y, z)).all():
            return x, y, z
    raise URDFError(f"{where} {name}", "three finite numbers", quoted(text))
