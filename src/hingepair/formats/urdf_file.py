"""What a URDF says: its links and joints as values, read once and checked; nothing else of the file is touched."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np

from hingepair.errors import URDFError, choices, quoted

HINGE_TYPES = ("revolute", "continuous")

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint as the URDF says it.

    Attributes:
        name: its name.
        type: revolute, continuous, fixed, prismatic, floating or planar.
        parent: link that carries it.
        child: link that it carries; this link's frame is the joint's frame.
        xyz: origin in the parent's axes [m].
        rpy: attitude at angle 0, fixed-axis XYZ [rad].
        axis: in the child's axes, as written, not normalised.
        mimic: the joint whose angle it follows; None where it has its own.
        limits: least and greatest value [rad or m]; None where there are none.
    """

    name: str
    type: str
    parent: str
    child: str
    xyz: Triple
    rpy: Triple
    axis: Triple
    mimic: str | None
    limits: tuple[float, float] | None

    @property
    def is_hinge(self) -> bool:
        """It turns about one axis."""
        return self.type in HINGE_TYPES


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
class Robot:
    """What a URDF says: `links` in order, `joints` by name in order, `inertials` by link where there are any."""

    name: str
    links: tuple[str, ...]
    joints: Mapping[str, Joint]
    inertials: Mapping[str, Inertial]

    def hinges(self) -> tuple[Joint, ...]:
        """The revolute and continuous joints, mimic joints included."""
        return tuple(joint for joint in self.joints.values() if joint.is_hinge)

    def hinge(self, name: str) -> Joint:
        """The hinge of this name.

        Raises:
            URDFError: no such joint, or one that is no hinge; lists those that would do.
        """
        joint = self.joints.get(name)
        if joint is not None and joint.is_hinge:
            return joint
        known = [hinge.name for hinge in self.hinges()]
        expected = choices(known) if known else "a robot with a revolute or continuous joint"
        raise URDFError("joint", expected, f"{name!r}, which is {joint.type}" if joint else quoted(name))


def read_urdf(path_or_text: str | os.PathLike[str]) -> str | bytes:
    """The text itself where it is one (it starts with "<"), else what the file holds.

    Raises:
        URDFError: the file cannot be read.
    """
    if isinstance(path_or_text, str) and path_or_text.lstrip("\ufeff \t\r\n").startswith("<"):
        return path_or_text.lstrip("\ufeff \t\r\n")
    try:
        return Path(path_or_text).read_bytes()
    except (OSError, ValueError, TypeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise URDFError("path_or_text", "a readable file or URDF text", f"{path_or_text!r} ({reason})") from None


def parse_urdf(text: str | bytes) -> Robot:
    """The links and joints of a URDF; meshes and everything else are not touched.

    Raises:
        URDFError: not XML, a DOCTYPE in it (it could name files or grow without bound), not a robot, a joint
            without parent or child, a name given twice, limits the wrong way round, a number that is none (named by
            joint and attribute).
    """
    parser = ET.XMLParser(target=_NoDoctype())
    try:
        parser.feed(text)
        root = parser.close()
    except (ET.ParseError, ValueError, LookupError) as error:
        if isinstance(error, URDFError):
            raise
        raise URDFError("URDF", "XML", str(error)) from None
    if root.tag != "robot":
        raise URDFError("URDF", "the element <robot>", f"<{root.tag}>")
    links = [_attribute(element, "name", "link") for element in root.findall("link")]
    joints = [_joint(element) for element in root.findall("joint")]
    _refuse_twice("link", links)
    _refuse_twice("joint", (joint.name for joint in joints))
    _refuse_twice("child link", (joint.child for joint in joints))
    by_name = MappingProxyType({joint.name: joint for joint in joints})
    inertials = (_inertial(name, element) for name, element in zip(links, root.findall("link"), strict=True))
    by_link = MappingProxyType({name: found for name, found in zip(links, inertials, strict=True) if found})
    return Robot(root.get("name", ""), tuple(links), by_name, by_link)


class _NoDoctype(ET.TreeBuilder):
    """Refuses a DOCTYPE before anything that it declares is expanded."""

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise URDFError("URDF", "XML without a DOCTYPE", f"<!DOCTYPE {name} {pubid or ''} {system or ''}>")


def _joint(element: ET.Element) -> Joint:
    name = _attribute(element, "name", "joint")
    where = f"joint {name!r}"
    origin, axis, mimic = element.find("origin"), element.find("axis"), element.find("mimic")
    ends = []
    for tag in ("parent", "child"):
        end = element.find(tag)
        if end is None:
            raise URDFError(where, f"a <{tag}>", "none")
        ends.append(_attribute(end, "link", f"{where}, {tag}"))
    return Joint(
        name=name,
        type=_attribute(element, "type", where),
        parent=ends[0],
        child=ends[1],
        xyz=_triple(origin, "xyz", f"{where}, origin", (0.0, 0.0, 0.0)),
        rpy=_triple(origin, "rpy", f"{where}, origin", (0.0, 0.0, 0.0)),
        axis=_triple(axis, "xyz", f"{where}, axis", (1.0, 0.0, 0.0)),
        mimic=None if mimic is None else _attribute(mimic, "joint", f"{where}, mimic"),
        limits=_limits(element, where),
    )


def _limits(element: ET.Element, where: str) -> tuple[float, float] | None:
    """The limits of a joint; none where both are 0, which is how URDF reads a range not given.

    Raises:
        URDFError: lower above upper.
    """
    limit = element.find("limit")
    if limit is None or element.get("type") == "continuous":
        return None
    lower, upper = (_number(limit, name, f"{where}, limit") for name in ("lower", "upper"))
    if lower > upper:
        raise URDFError(f"{where}, limit", "lower below upper", f"lower {lower!r}, upper {upper!r}")
    return (lower, upper) if lower < upper else None


def _inertial(link: str, element: ET.Element) -> Inertial | None:
    inertial = element.find("inertial")
    if inertial is None:
        return None
    where = f"link {link!r}, inertial"
    origin, mass, inertia = (inertial.find(tag) for tag in ("origin", "mass", "inertia"))
    return Inertial(
        mass=_number(mass, "value", where),
        xyz=_triple(origin, "xyz", f"{where}, origin", (0.0, 0.0, 0.0)),
        rpy=_triple(origin, "rpy", f"{where}, origin", (0.0, 0.0, 0.0)),
        moments=tuple(_number(inertia, key, where) for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")),
    )


def _attribute(element: ET.Element, name: str, where: str) -> str:
    value = element.get(name)
    if not value:
        raise URDFError(where, f"an attribute {name}", "none")
    return value


def _number(element: ET.Element | None, name: str, where: str) -> float:
    """The finite number of an attribute; 0 where it is not given."""
    text = None if element is None else element.get(name)
    if text is None:
        return 0.0
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


def _refuse_twice(kind: str, names: Iterable[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise URDFError(kind, "each name once", f"{name!r} twice")
        seen.add(name)
