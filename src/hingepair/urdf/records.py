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
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hingepair.errors import URDFError, choices, nearest, quoted
from hingepair.rotations.matrices import quaternion_to_matrix
from hingepair.rotations.sequences import find_sequence
from hingepair.urdf.rigid import FramePose, Inertia, exact_quarter_turns

HINGE_TYPES = ("revolute", "continuous")
"""Joint types that turn about one axis."""

SLIDER_TYPES = ("prismatic",)
"""Joint types that shift along one axis."""

# A number as URDF writes it; possessive, so that the time stays linear.
_NUMBER = re.compile(r"[+-]?(?:\d++(?:\.\d*+)?|\.\d++)(?:[eE][+-]?\d++)?", re.ASCII)
_ZERO_VECTOR = (0.0, 0.0, 0.0)  # a position or angles that are not given
DEFAULT_SIZES: Mapping[str, Mapping[str, tuple[float, ...]]] = {
    "box": {"size": _ZERO_VECTOR}, "cylinder": {"radius": (0.0,), "length": (0.0,)}, "sphere": {"radius": (0.0,)}
}  # fmt: skip
"""Attributes that give the sizes of a shape, by its kind, and what they are where they are not given."""

# The attributes of URDF's inertia.
_INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_HALF_PI = Fraction(math.pi / 2) + Fraction(6.123233995736766e-17)  # to 107 bits
_MAX_QUARTERS = 2**20  # multiples of pi/2 beyond have rounded sines and cosines
# Sine and cosine of 0, 1, 2, 3 quarter turns.
_QUARTERS = ((0.0, 1.0), (1.0, 0.0), (0.0, -1.0), (-1.0, 0.0))


class PoseRules(NamedTuple):
    """How the origins of a URDF are read."""

    snap: float  # how near to a multiple of pi/2 an angle is taken for it [rad]
    has_quaternions: bool  # whether quat_xyzw may stand for rpy: from version 1.1 on


class Visual(NamedTuple):
    """Shape by which a link is drawn or collides."""

    kind: str  # "box", "cylinder", "sphere", or another tag such as "mesh"
    sizes: tuple[float, ...]  # edges of a box, radius and length of a cylinder along z, radius of a sphere [m]
    pose: FramePose  # in the axes of the link
    file: str = ""  # name of a mesh, as written; "" for other shapes
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)  # of a mesh
    colour: tuple[float, ...] | None = None  # of a mesh: red, green, blue, opacity from 0 to 1


class MimicRecord(NamedTuple):
    """Rule by which a joint follows the joint named `leader`: q = multiplier * q_leader + offset [rad or m]."""

    leader: str
    multiplier: float
    offset: float

    def __str__(self) -> str:
        factor = "" if self.multiplier == 1 else f"{self.multiplier:.4g} "
        added = "" if self.offset == 0 else f" {'-' if self.offset < 0 else '+'} {abs(self.offset):.4g}"
        return f"{factor}{self.leader}{added}"


@dataclass(frozen=True, slots=True, eq=False)
class LinkRecord:
    """Link of a URDF, whose numbers are read and checked when they are asked for."""

    element: ET.Element  # the XML element
    name: str  # name of the link
    rules: PoseRules  # how its origins are read

    def inertia(self) -> Inertia:
        """Return the mass properties of the link in its own axes; numbers that are not given are 0."""
        label = f"link {self.name!r}, inertial"
        (mass,) = _numbers(self.element.find("inertial/mass"), "value", label, (0.0,))
        moments = self.element.find("inertial/inertia")
        xx, xy, xz, yy, yz, zz = (_numbers(moments, key, label, (0.0,))[0] for key in _INERTIA)
        at_centre = Inertia(mass, np.zeros(3), np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))))
        return at_centre.placed(_pose(self.element.find("inertial/origin"), label, self.rules))

    def visuals(self, tag: str = "visual") -> list[Visual]:
        """Return the shapes that draw the link (`tag` "visual"), or those for collisions ("collision")."""
        shapes = []
        for element in self.element.findall(tag):
            shape = element.find("geometry/*")
            kind = "" if shape is None else shape.tag
            label = f"link {self.name!r}, {tag}"
            pose = _pose(element.find("origin"), label, self.rules)
            groups = [
                _numbers(shape, key, f"{label}, {kind}", zero) for key, zero in DEFAULT_SIZES.get(kind, {}).items()
            ]
            visual = Visual(kind, tuple(size for group in groups for size in group), pose)
            if shape is not None and kind == "mesh":
                scale = _numbers(shape, "scale", f"{label}, {kind}", (1.0, 1.0, 1.0))
                colour = element.find("material/color")
                rgba = None if colour is None else _numbers(colour, "rgba", f"{label}, color", (0.5, 0.5, 0.5, 1.0))
                visual = visual._replace(file=shape.get("filename", ""), scale=scale, colour=rgba)
            shapes.append(visual)
        return shapes


@dataclass(frozen=True, slots=True, eq=False)
class JointRecord:
    """Joint of a URDF, whose numbers are read and checked when they are asked for."""

    element: ET.Element  # the XML element
    name: str  # name of the joint; "" where none is given
    type: str  # revolute, continuous, prismatic, fixed, floating or planar
    parent: str  # name of the link that carries the joint
    child: str  # name of the link that the joint carries, whose frame is the joint's
    follows: str  # name of the joint whose position this one follows (mimic); "" for none
    rules: PoseRules  # how its origin is read

    @property
    def pose(self) -> FramePose:
        """Pose of the child link at position 0 in the axes of the parent link."""
        return _pose(self.element.find("origin"), self._label, self.rules)

    @property
    def axis(self) -> tuple[float, ...]:
        """Axis in the axes of the child link as written, not normalised; (1, 0, 0) unless given. Zero is refused."""
        axis = _numbers(self.element.find("axis"), "xyz", f"{self._label}, axis", (1.0, 0.0, 0.0))
        if not any(axis):
            raise URDFError(f"{self._label}, axis xyz", "a non-zero axis", axis)
        return axis

    @property
    def limits(self) -> tuple[float, float] | None:
        """Lower and upper limit [rad or m]; None if both are 0 or missing, and for continuous joints."""
        if self.type == "continuous":
            return None
        lower, upper = (self._number("limit", key, 0.0) for key in ("lower", "upper"))
        if lower > upper:
            raise URDFError(f"{self._label}, limit", "lower below upper", f"lower {lower!r}, upper {upper!r}")
        return (lower, upper) if lower or upper else None

    @property
    def effort(self) -> float | None:
        """Largest torque [N m] or force [N]; None if none is given. Raises a URDFError if it is negative."""
        return self._number_from_0("limit", "effort")

    @property
    def velocity(self) -> float | None:
        """Largest rate [rad/s or m/s]; None if none is given. Raises a URDFError if it is negative."""
        return self._number_from_0("limit", "velocity")

    @property
    def damping(self) -> float:
        """Viscous damping [N m s/rad or N s/m]; 0 if none is given. Raises a URDFError if it is negative."""
        return self._number_from_0("dynamics", "damping") or 0.0

    @property
    def friction(self) -> float:
        """Dry friction [N m or N]; 0 if none is given. Raises a URDFError if it is negative."""
        return self._number_from_0("dynamics", "friction") or 0.0

    @property
    def mimic(self) -> MimicRecord | None:
        """Rule by which this joint follows another joint; None if it follows none."""
        if self.element.find("mimic") is None:
            return None
        multiplier, offset = (self._number("mimic", key, one) for key, one in (("multiplier", 1.0), ("offset", 0.0)))
        return MimicRecord(self.follows, multiplier, offset)

    @property
    def _label(self) -> str:
        return f"joint {self.name!r}"

    def _number_from_0(self, tag: str, key: str) -> float | None:
        """Return the number of an attribute, or None if it is missing; raise a URDFError for a negative number."""
        number: float | None = self._number(tag, key, None)
        if number is not None and number < 0:
            raise URDFError(f"{self._label}, {tag} {key}", "a number not below 0", number)
        return number

    def _number(self, tag: str, key: str, default: float | None) -> Any:
        return _numbers(self.element.find(tag), key, f"{self._label}, {tag}", (default,))[0]


@dataclass(frozen=True, slots=True, eq=False)
class RobotRecord:
    """Links and joints of a URDF, which `tree` checks to be a tree."""

    name: str  # name of the robot
    # links by name, in the order of the file; a name that is given twice has both links
    links: Mapping[str, Sequence[LinkRecord]]
    joints: Sequence[JointRecord]  # joints in the order of the file
    # for the name of each link, the joints of which it is parent or child
    joints_at: Mapping[str, Sequence[JointRecord]]
    text: str | bytes  # the URDF itself; bytes if it was read from a file
    folder: Path | None = None  # folder of the file, in which the names of meshes start; None for text

    def hinges(self) -> tuple[JointRecord, ...]:
        """Return a tuple of the revolute and continuous JointRecords that have a name, mimic joints included."""
        return tuple(joint for joint in self.joints if joint.type in HINGE_TYPES and joint.name)

    def hinge(self, name: str) -> JointRecord:
        """Return the revolute or continuous joint of a name; refuse a name that has none, or several."""
        joints = [joint for joint in self.joints if joint.name == name and name]
        if len(joints) > 1:
            raise URDFError("joint", "each name once", f"{name!r} twice")
        if joints and joints[0].type in HINGE_TYPES:
            return joints[0]
        known = [hinge.name for hinge in self.hinges()]
        if not known:
            raise URDFError("joint", "a robot with a revolute or continuous joint", quoted(name))
        if joints:
            raise URDFError("joint", choices(known), f"{name!r}, which is {joints[0].type or 'of no type'}")
        raise URDFError("joint", choices(known) + nearest(str(name), known), quoted(name))

    def check_declared(self, name: str, joint: JointRecord) -> None:
        """Refuse a joint if the robot has no link of this name, that of the joint's parent or child."""
        if name not in self.links:
            expected = "a parent and a child that are links of the robot" + nearest(name, self.links)
            raise URDFError(f"joint {joint.name!r}", expected, quoted(name) if name else "none")

    def check_link(self, name: str, joint: JointRecord) -> None:
        """Refuse a joint if its link of this name is not declared once, or more than one joint carries it."""
        self.check_declared(name, joint)
        if len(self.links[name]) > 1:
            raise URDFError("link", "each name once", f"{name!r} twice")
        if sum(joint.child == name for joint in self.joints_at[name]) > 1:
            raise URDFError("child link", "each name once", f"{name!r} twice")

    def tree(self) -> tuple[str, tuple[JointRecord, ...]]:
        """Return the name of the root link and all joints, depth-first, siblings by name; refuse what is no tree."""
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
        """Return the joints on a link, by name, the last first."""
        joints = [joint for joint in self.joints_at.get(link, ()) if joint.parent == link]
        return sorted(joints, key=lambda joint: joint.name, reverse=True)


def _pose(origin: ET.Element | None, label: str, rules: PoseRules) -> FramePose:
    """Return the pose of an element <origin>, the identity for None: xyz [m], and rpy, fixed-axis XYZ [rad], or
    quat_xyzw, a quaternion of any length.
    """
    label = f"{label}, origin"
    position = np.array(_numbers(origin, "xyz", label, _ZERO_VECTOR))
    has_rpy, has_quaternion = (origin is not None and origin.get(key) is not None for key in ("rpy", "quat_xyzw"))
    if has_quaternion and has_rpy is rules.has_quaternions:
        expected = "no rpy beside quat_xyzw" if has_rpy else '<robot version="1.1"> or later for quat_xyzw'
        raise URDFError(label, expected, "rpy too" if has_rpy else "an earlier version, which has rpy alone")
    if has_quaternion and not has_rpy:
        quaternion = _numbers(origin, "quat_xyzw", label, (0.0, 0.0, 0.0, 1.0))
        if not any(quaternion):
            raise URDFError(f"{label} quat_xyzw", "a quaternion that is not zero", quaternion)
        rotation = quaternion_to_matrix("quat_xyzw", quaternion, scalar_first=False).astype(np.float64)
        return FramePose(exact_quarter_turns(rotation, rules.snap), position)
    rpy = _numbers(origin, "rpy", label, _ZERO_VECTOR)
    order = find_sequence("xyz")
    trig = tuple(part for angle in order.angles(rpy) for part in sine_and_cosine(angle, rules.snap))
    return FramePose(np.array(order.attitude(trig)).reshape(3, 3) + 0.0, position)


def sine_and_cosine(angle: float, snap: float = 0.0) -> tuple[float, float]:
    """Return (sine, cosine) of an angle [rad], exact for angles within `snap` of a multiple of pi/2 and for the
    double nearest to one, up to 2**20 pi/2.
    """
    turns = round(angle / (math.pi / 2))
    near = angle == float(turns * _HALF_PI) or abs(angle - turns * (math.pi / 2)) <= snap
    return _QUARTERS[turns % 4] if near and abs(turns) <= _MAX_QUARTERS else (math.sin(angle), math.cos(angle))


def _numbers(element: ET.Element | None, key: str, label: str, default: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the finite numbers of an attribute, as many as in `default`, which is returned where there is none."""
    text = None if element is None else element.get(key)
    if text is None:
        return default
    words = text.split()
    if len(words) == len(default) and all(_NUMBER.fullmatch(word) and np.isfinite(float(word)) for word in words):
        return tuple(map(float, words))
    raise URDFError(
        f"{label} {key}",
        {1: "a finite number", 3: "three finite numbers"}.get(len(default), "four finite numbers"),
        quoted(text),
    )
