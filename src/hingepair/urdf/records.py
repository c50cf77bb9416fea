"""Content of a URDF: records of links and joints.

The numbers of a link or a joint are read and checked when they are asked for: a pair needs two bodies of a robot, and
what is wrong with the others does not matter to it. But every joint's parent link must be declared: with a misspelt
parent, what the joint carries would be missing from the body that it belongs to.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from hingepair.errors import URDFError, choices, nearest, quoted
from hingepair.rotations.sequences import find_sequence
from hingepair.urdf.rigid import FramePose, Inertia

HINGES = ("revolute", "continuous")
"""Joint types that turn about one axis."""

SLIDERS = ("prismatic",)
"""Joint types that shift along one axis."""

# A number as URDF writes it.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_ZERO_VECTOR = (0.0, 0.0, 0.0)  # a position or angles that are not given
SIZES: Mapping[str, Mapping[str, tuple[float, ...]]] = {
    "box": {"size": _ZERO_VECTOR}, "cylinder": {"radius": (0.0,), "length": (0.0,)}, "sphere": {"radius": (0.0,)}
}  # fmt: skip
"""Attributes that give the sizes of a shape, by its kind, and what they are where they are not given."""

# The attributes of URDF's inertia.
_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_HALF_PI = Fraction(math.pi / 2) + Fraction(6.123233995736766e-17)  # to 107 bits
_MAX_SNAPPED_QUARTER_TURNS = 2**20  # of larger angles every one is near a multiple
_QUARTER_TURNS = ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))  # sine and cosine of 0, 1, 2, 3 quarter turns


class Visual(NamedTuple):
    """A shape that a link is drawn by.

    Attributes:
        kind: "box", "cylinder", "sphere", or another tag such as "mesh".
        sizes: edges of a box, radius and length of a cylinder along z, radius of a sphere [m]; else none.
        pose: in the axes of the link.
    """

    kind: str
    sizes: tuple[float, ...]
    pose: FramePose


class MimicRecord(NamedTuple):
    """Rule by which a joint follows another: q = multiplier * q_leader + offset."""

    leader: str
    multiplier: float
    offset: float

    def __str__(self) -> str:
        factor = "" if self.multiplier == 1 else f"{self.multiplier:.4g} "
        added = "" if self.offset == 0 else f" {'-' if self.offset < 0 else '+'} {abs(self.offset):.4g}"
        return f"{factor}{self.leader}{added}"


@dataclass(frozen=True, slots=True, eq=False)
class LinkRecord:
    """A link.

    Attributes:
        element: the XML element.
        name: of the link.
        snap: how near to a multiple of pi/2 an angle of an origin is taken for it [rad].
    """

    element: ET.Element
    name: str
    snap: float

    def inertia(self) -> Inertia:
        """Return its mass properties in its own axes; zero where none are given.

        Raises:
            URDFError: an entry is no finite number.
        """
        where = f"link {self.name!r}, inertial"
        (mass,) = _numbers(self.element.find("inertial/mass"), "value", where, (0.0,))
        moments = self.element.find("inertial/inertia")
        xx, xy, xz, yy, yz, zz = (_numbers(moments, key, where, (0.0,))[0] for key in _MOMENTS)
        own = Inertia(mass, np.zeros(3), np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))))
        return own.placed(_pose(self.element.find("inertial/origin"), where, self.snap))

    def visuals(self, tag: str = "visual") -> list[Visual]:
        """Return the shapes that it is drawn by, or, by the tag "collision", those that it collides by.

        Raises:
            URDFError: an origin or a size is no finite number.
        """
        found = []
        for element in self.element.findall(tag):
            shape = element.find("geometry/*")
            kind = "" if shape is None else shape.tag
            where = f"link {self.name!r}, {tag}"
            pose = _pose(element.find("origin"), where, self.snap)
            groups = [_numbers(shape, key, f"{where}, {kind}", zero) for key, zero in SIZES.get(kind, {}).items()]
            found.append(Visual(kind, tuple(size for group in groups for size in group), pose))
        return found


@dataclass(frozen=True, slots=True, eq=False)
class JointRecord:
    """A joint; a name that is not given is "".

    Attributes:
        element: the XML element.
        name: of the joint.
        type: revolute, continuous, prismatic, fixed, floating or planar.
        parent: the link that carries it.
        child: the link that it carries, whose frame is the joint's.
        follows: the joint whose position it follows (mimic).
        snap: how near to a multiple of pi/2 an angle of its origin is taken for it [rad].
    """

    element: ET.Element
    name: str
    type: str
    parent: str
    child: str
    follows: str
    snap: float

    @property
    def pose(self) -> FramePose:
        """Attitude of the child link at position 0, and its origin [m], in the parent link's axes."""
        return _pose(self.element.find("origin"), self._where, self.snap)

    @property
    def axis(self) -> tuple[float, ...]:
        """Its axis in the child link's axes, as written, not normalised."""
        axis = _numbers(self.element.find("axis"), "xyz", f"{self._where}, axis", (1.0, 0.0, 0.0))
        if not any(axis):
            raise URDFError(f"{self._where}, axis xyz", "a non-zero axis", axis)
        return axis

    @property
    def limits(self) -> tuple[float, float] | None:
        """Least and greatest position [rad or m]; None where they are equal, as in URDF where no range is given."""
        if self.type == "continuous":
            return None
        lower, upper = (self._number("limit", key, 0.0) for key in ("lower", "upper"))
        if lower > upper:
            raise URDFError(f"{self._where}, limit", "lower below upper", f"lower {lower!r}, upper {upper!r}")
        return (lower, upper) if lower < upper else None

    @property
    def effort(self) -> float | None:
        """Its largest torque [N m] or force [N]; None where none is given."""
        return self._not_below_0("effort")

    @property
    def velocity(self) -> float | None:
        """Its largest rate [rad/s or m/s]; None where none is given."""
        return self._not_below_0("velocity")

    @property
    def damping(self) -> float:
        """Viscous damping [N m s/rad or N s/m]; 0 where none is given."""
        return float(self._number("dynamics", "damping", 0.0))

    @property
    def friction(self) -> float:
        """Static friction [N m or N]; 0 where none is given."""
        return float(self._number("dynamics", "friction", 0.0))

    @property
    def mimic(self) -> MimicRecord | None:
        """Rule by which the joint follows another; None where it does not."""
        if self.element.find("mimic") is None:
            return None
        multiplier, offset = (self._number("mimic", key, one) for key, one in (("multiplier", 1.0), ("offset", 0.0)))
        return MimicRecord(self.follows, multiplier, offset)

    @property
    def _where(self) -> str:
        return f"joint {self.name!r}"

    def _not_below_0(self, key: str) -> float | None:
        """Return a number of the limit element, None where it is missing; refuse a negative one."""
        number: float | None = self._number("limit", key, None)
        if number is not None and number < 0:
            raise URDFError(f"{self._where}, limit {key}", "a number not below 0", number)
        return number

    def _number(self, tag: str, key: str, default: float | None) -> Any:
        return _numbers(self.element.find(tag), key, f"{self._where}, {tag}", (default,))[0]


@dataclass(frozen=True, slots=True, eq=False)
class Robot:
    """Content of a URDF.

    Attributes:
        name: of the robot.
        links: by name, in order; a name that is given twice stands for both.
        joints: in order.
        joints_at: by link, the joints that it is parent or child of.
    """

    name: str
    links: Mapping[str, Sequence[LinkRecord]]
    joints: Sequence[JointRecord]
    joints_at: Mapping[str, Sequence[JointRecord]]

    def hinges(self) -> tuple[JointRecord, ...]:
        """Return the revolute and continuous joints that have a name, mimic joints included."""
        return tuple(joint for joint in self.joints if joint.type in HINGES and joint.name)

    def hinge(self, name: str) -> JointRecord:
        """Return the hinge of this name.

        Raises:
            URDFError: no such joint, two, or one that is no hinge; lists those that would do.
        """
        joints = [joint for joint in self.joints if joint.name == name and name]
        if len(joints) > 1:
            raise URDFError("joint", "each name once", f"{name!r} twice")
        if joints and joints[0].type in HINGES:
            return joints[0]
        known = [hinge.name for hinge in self.hinges()]
        if not known:
            raise URDFError("joint", "a robot with a revolute or continuous joint", quoted(name))
        if joints:
            raise URDFError("joint", choices(known), f"{name!r}, which is {joints[0].type or 'of no type'}")
        raise URDFError("joint", choices(known) + nearest(str(name), known), quoted(name))

    def check_declared(self, name: str, joint: JointRecord) -> None:
        """Refuse a link that a joint names and the robot has not.

        Raises:
            URDFError: names the joint.
        """
        if name not in self.links:
            expected = "a parent and a child that are links of the robot" + nearest(name, self.links)
            raise URDFError(f"joint {joint.name!r}", expected, quoted(name) if name else "none")

    def check_link(self, name: str, joint: JointRecord) -> None:
        """Refuse a link that a joint names.

        Raises:
            URDFError: it is not declared, or twice, or more than one joint carries it.
        """
        self.check_declared(name, joint)
        if len(self.links[name]) > 1:
            raise URDFError("link", "each name once", f"{name!r} twice")
        if sum(joint.child == name for joint in self.joints_at[name]) > 1:
            raise URDFError("child link", "each name once", f"{name!r} twice")

    def tree(self) -> tuple[str, tuple[JointRecord, ...]]:
        """Return the root link and all joints, depth-first, the joints of one link by name.

        Raises:
            URDFError: the links and joints are no tree: names the joint or the links that are wrong.
        """
        if not self.links:
            raise URDFError("URDF", "a robot with a link", "none")
        count = Counter(joint.name for joint in self.joints)
        for joint in self.joints:
            if not joint.name:
                raise URDFError("joint", "a name", f"none, between {joint.parent!r} and {joint.child!r}")
            if count[joint.name] > 1:
                raise URDFError("joint", "each name once", f"{joint.name!r} twice")
            self.check_declared(joint.child, joint)
            carriers = [other.name for other in self.joints_at[joint.child] if other.child == joint.child]
            if len(carriers) > 1:
                expected = f"to be the one joint that carries the link {joint.child!r}"
                raise URDFError(f"joint {carriers[-1]!r}", expected, f"{carriers[0]!r} too")
        for name, links in self.links.items():
            if not name or len(links) > 1:
                raise URDFError("link", "each name once", f"{name!r} twice" if name else "a link without a name")
        children = {joint.child for joint in self.joints}
        roots = [name for name in self.links if name not in children]
        if len(roots) > 1:
            raise URDFError("URDF", "one link that no joint carries, the root", ", ".join(map(repr, roots)))
        ordered, waiting = [], self._carried_by(roots[0]) if roots else []
        while waiting:
            joint = waiting.pop()
            ordered.append(joint)
            waiting += self._carried_by(joint.child)
        if len(ordered) < len(self.joints):
            reached = set(map(id, ordered))
            left = next(joint for joint in self.joints if id(joint) not in reached)
            raise URDFError(f"joint {left.name!r}", "a tree of links", f"a circle through {left.child!r}")
        return roots[0], tuple(ordered)

    def _carried_by(self, link: str) -> list[JointRecord]:
        """Return the joints whose parent is a link, the last name first."""
        joints = [joint for joint in self.joints_at.get(link, ()) if joint.parent == link]
        return sorted(joints, key=lambda joint: joint.name, reverse=True)


def _pose(origin: ET.Element | None, where: str, snap: float) -> FramePose:
    """Return the rotation matrix (3, 3) and position (3,) [m] of an element <origin>; the identity without one.

    Its attributes are xyz [m] and rpy, fixed-axis XYZ [rad].
    """
    xyz, rpy = (_numbers(origin, key, f"{where}, origin", _ZERO_VECTOR) for key in ("xyz", "rpy"))
    order = find_sequence("xyz")
    roll, pitch, yaw = order.angles(rpy)
    trig = tuple(part for angle in (roll, pitch, yaw) for part in sine_and_cosine(angle, snap))
    return FramePose(np.array(order.attitude(trig)).reshape(3, 3) + 0.0, np.array(xyz))


def sine_and_cosine(angle: float, snap: float = 0.0) -> tuple[float, float]:
    """Return sine and cosine of an angle [rad], exactly where it is the double nearest to a multiple of pi/2.

    An angle within `snap` of a multiple of pi/2 is taken for that multiple.
    """
    turns = round(angle / (math.pi / 2))
    near = angle == float(turns * _HALF_PI) or abs(angle - turns * (math.pi / 2)) <= snap
    return (
        _QUARTER_TURNS[turns % 4]
        if near and abs(turns) <= _MAX_SNAPPED_QUARTER_TURNS
        else (math.sin(angle), math.cos(angle))
    )


def _numbers(element: ET.Element | None, key: str, where: str, default: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the one or three finite numbers of an attribute; where it is not given, those of the default."""
    text = None if element is None else element.get(key)
    if text is None:
        return default
    words = text.split()
    if len(words) == len(default) and all(_NUMBER.fullmatch(word) and np.isfinite(float(word)) for word in words):
        return tuple(map(float, words))
    raise URDFError(
        f"{where} {key}", "three finite numbers" if len(default) == 3 else "a finite number", quoted(text)
    )
