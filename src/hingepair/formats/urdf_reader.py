"""URDF: any hinge of a robot read as a hinge pair.

A body is all links that are rigidly fixed to each other, taken together; the joint's child link has its origin at the
hinge point. Links and joints are read and checked when they are asked for: a robot has parts that a hinge has nothing
to do with, and what is wrong with these refuses nobody. Every joint's parent link must be declared: with a misspelt
parent, what the joint carries would be missing from the body that it belongs to.
"""

from __future__ import annotations

import os
import re
import warnings
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from hingepair.errors import ArgumentError, URDFError, choices, nearest, quoted
from hingepair.numeric.arrays import FloatArray
from hingepair.pair.body import Body, Box, Cylinder, Shape, Sphere
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.euler import euler_to_matrix

_HINGES = ("revolute", "continuous")
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", re.ASCII)
_NONE = (0.0, 0.0, 0.0)
_SIZES: Mapping[str, Mapping[str, tuple[float, ...]]] = {
    "box": {"size": _NONE}, "cylinder": {"radius": (0.0,), "length": (0.0,)}, "sphere": {"radius": (0.0,)}
}  # fmt: skip

Inertia: TypeAlias = tuple[float, FloatArray, FloatArray]
"""Mass [kg], its centre [m] and the tensor about it [kg m^2], in the axes that a link's pose is given in."""


def from_urdf(
    path_or_text: str | os.PathLike[str], joint: str, body1_frame: str | None = None, body2_frame: str | None = None
) -> HingePair:
    """One hinge of a URDF as a pair.

    Args:
        path_or_text: a file's path, or the URDF itself (text that starts with "<").
        joint: name of a revolute or continuous joint; a mimic joint is a hinge too.
        body1_frame: link whose frame is (R1, S1): the joint's parent link, or one rigidly fixed to it.
        body2_frame: link whose frame is (R2, S2): the joint's child link, or one rigidly fixed to it.

    Returns:
        The pair, named as the joint. Between parent and child link: u1 and home are the joint's origin, u2 = 0.
        With it come the limits of a revolute joint (None where lower and upper are equal, as they are where neither
        is given: URDF takes them for 0), its effort as torque_limit, its velocity as rate_limit, and the mass
        properties of the bodies, each of all links that are rigidly fixed to each other; None where no link has
        mass, and, with a warning, where the sum is none that a rigid body can have. With these come the boxes,
        cylinders and spheres of a body that is drawn by nothing else; meshes and the robot's name are not read.
        What `to_urdf` wrote has its u2 with body2_frame="body2"; the effort 1000 and velocity 100 that stand there
        for no limit come back as limits.

    Raises:
        URDFError: no readable URDF, or no such hinge or frame; says what would do. The hinge's limits are the wrong
            way round, its parent or child link is not declared or is one body with the other, a number of its two
            bodies is none. What is wrong elsewhere in the robot does not matter, but for a joint whose parent link
            is not declared: the links that it carries may belong to either body.

    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0))
    >>> hp.from_urdf(hp.to_urdf(pair), joint="hinge", body2_frame="body2").u2.tolist()
    [-0.25, 0.1, 0.0]
    """
    return hinge_pair(read_urdf(path_or_text), joint, body1_frame, body2_frame, name=joint, warn=True)


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


_HERE = Pose(np.eye(3), np.zeros(3))


class Joint(NamedTuple):
    """A joint as the URDF says it; what is not given is "".

    Attributes:
        element: all that is said.
        name: of the joint.
        type: revolute, continuous, fixed, prismatic, floating or planar.
        parent: the link that carries it.
        child: the link that it carries, whose frame is the joint's.
        mimic: the joint whose angle it follows.
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
        return _pose(self.element.find("origin"), self._where)

    @property
    def axis(self) -> tuple[float, ...]:
        """Its axis in the child's axes, as written, not normalised."""
        axis = _numbers(self.element.find("axis"), "xyz", f"{self._where}, axis", (1.0, 0.0, 0.0))
        if not any(axis):
            raise URDFError(f"{self._where}, axis xyz", "a non-zero axis", axis)
        return axis

    @property
    def limits(self) -> tuple[float, float] | None:
        """Least and greatest angle [rad]; None where both are 0, which is how URDF reads a range not given."""
        if self.type == "continuous":
            return None
        lower, upper = (self._limit(key, 0.0) for key in ("lower", "upper"))
        if lower > upper:
            raise URDFError(f"{self._where}, limit", "lower below upper", f"lower {lower!r}, upper {upper!r}")
        return (lower, upper) if lower < upper else None

    def most(self, key: str) -> float | None:
        """Its largest torque ("effort") [N m] or rate ("velocity") [rad/s]; None where none is given."""
        number: float | None = self._limit(key, None)
        if number is not None and number < 0:
            raise URDFError(f"{self._where}, limit {key}", "a number not below 0", number)
        return number

    @property
    def _where(self) -> str:
        return f"joint {self.name!r}"

    def _limit(self, key: str, default: float | None) -> Any:
        return _numbers(self.element.find("limit"), key, f"{self._where}, limit", (default,))[0]


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
        return tuple(joint for joint in self.joints if joint.type in _HINGES and joint.name)

    def hinge(self, name: str) -> Joint:
        """The hinge of this name.

        Raises:
            URDFError: no such joint, two, or one that is no hinge; lists those that would do.
        """
        found = [joint for joint in self.joints if joint.name == name and name]
        if len(found) > 1:
            raise URDFError("joint", "each name once", f"{name!r} twice")
        if found and found[0].type in _HINGES:
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
            raise _undeclared(joint, name, self.links)
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
            a robot; a joint's parent link is not declared: whatever the joint carries would hang on nothing.
    """
    parser = ET.XMLParser(target=_NoDoctype())
    try:
        parser.feed(_text(path_or_text))
        root = parser.close()
    except URDFError:
        raise
    except (ET.ParseError, ValueError, LookupError) as error:
        raise URDFError("URDF", "XML", str(error)) from None
    if root.tag != "robot":
        raise URDFError("URDF", "the element <robot>", f"<{root.tag}>")
    links, joints_at = defaultdict(list), defaultdict(list)
    for element in root.findall("link"):
        links[element.get("name", "")].append(element)
    joints = [_joint(element) for element in root.findall("joint")]
    for joint in joints:
        if joint.parent not in links:
            raise _undeclared(joint, joint.parent, links)
        for link in {joint.parent, joint.child}:
            joints_at[link].append(joint)
    return Robot(root.get("name", ""), links, joints, joints_at)


def _undeclared(joint: Joint, link: str, links: Collection[str]) -> URDFError:
    """Return the error of a joint whose parent or child is no link of the robot."""
    expected = "a parent and a child that are links of the robot"
    return URDFError(f"joint {joint.name!r}", expected + nearest(link, links), quoted(link) if link else "none")


def _joint(element: ET.Element) -> Joint:
    names = ("parent", "link"), ("child", "link"), ("mimic", "joint")
    found = ["" if (one := element.find(tag)) is None else one.get(key, "") for tag, key in names]
    return Joint(element, element.get("name", ""), element.get("type", ""), *found)


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


def hinge_pair(
    robot: Robot,
    joint: str,
    body1_frame: str | None = None,
    body2_frame: str | None = None,
    *,
    name: str,
    warn: bool = False,
) -> HingePair:
    """The pair of `from_urdf`, of a robot already read; warnings are for those who can mend the URDF.

    Raises:
        URDFError: no such hinge or frame, or what belongs to it is malformed.
    """
    hinge = robot.hinge(joint)
    poses1, poses2 = (_fixed_to(robot, hinge, link) for link in (hinge.parent, hinge.child))
    if hinge.child in poses1:
        expected = "a parent and a child that are not fixed to each other"
        raise URDFError(f"joint {joint!r}", expected, f"{hinge.parent!r} and {hinge.child!r}")
    frame1 = _chosen(poses1, hinge.parent, body1_frame, "body1_frame")
    frame2 = _chosen(poses2, hinge.child, body2_frame, "body2_frame")
    home, u1 = frame1.seen(hinge.pose)
    return HingePair(
        u1=u1 + 0.0,
        u2=0.0 - frame2.rotation.T @ frame2.origin,
        n=home @ (np.array(hinge.axis) / max(map(abs, hinge.axis))) + 0.0,
        home=home @ frame2.rotation + 0.0,
        name=name,
        limits=hinge.limits,
        torque_limit=hinge.most("effort"),
        rate_limit=hinge.most("velocity"),
        body1=_combined_body(robot, {link: frame1.seen(pose) for link, pose in poses1.items()}, warn),
        body2=_combined_body(robot, {link: frame2.seen(pose) for link, pose in poses2.items()}, warn),
    )


def _fixed_to(robot: Robot, hinge: Joint, link: str) -> dict[str, Pose]:
    """Rotation and origin of every link that is rigidly fixed to a link of a hinge, in the axes of that link."""
    robot.check_link(link, hinge)
    poses = {link: _HERE}
    waiting: list[tuple[str, Joint]] = [(link, hinge)]
    with np.errstate(all="ignore"):  # an origin of 1e308 is HingePair's to refuse, where it is needed
        while waiting:
            here, come_by = waiting.pop()
            for joint in robot.joints_at[here]:
                if joint.type != "fixed" or joint is come_by:
                    continue
                there = joint.child if joint.parent == here else joint.parent
                robot.check_link(there, joint)
                if there in poses:
                    raise URDFError(f"joint {joint.name!r}", "a tree of links", f"a circle through {there!r}")
                poses[there] = poses[here].placed(joint.pose if there == joint.child else joint.pose.seen(_HERE))
                waiting.append((there, joint))
    return poses


def _chosen(poses: Mapping[str, Pose], link: str, frame: str | None, argument: str) -> Pose:
    wanted = link if frame is None else frame
    if not isinstance(wanted, str) or wanted not in poses:
        raise URDFError(argument, f"a link rigidly fixed to {link!r}: {choices(tuple(poses))}", quoted(frame))
    return poses[wanted]


def _combined_body(robot: Robot, poses: Mapping[str, Pose], warn: bool) -> Body | None:
    """The mass properties of links taken together, in the frame that their poses are given in.

    Links without mass count for nothing. None where no link has mass; and, with a warning, where one has a mass below
    zero or the sum is nothing that a rigid body can have: not a few robots carry made-up inertias.
    """
    with np.errstate(all="ignore"):  # what overflows is no mass property: Body refuses it
        inertias = {link: _inertia_of(robot.links[link][0], pose) for link, pose in poses.items()}
        heavy = {link: inertia for link, inertia in inertias.items() if inertia[0] != 0}
        try:
            for link, (mass, *_) in heavy.items():
                if mass < 0:
                    raise ArgumentError(f"mass of {link!r}", "a number above 0", mass)
            return _sum(heavy.values(), _shapes(robot, poses)) if heavy else None
        except ArgumentError as error:
            links = ", ".join(map(repr, heavy))
            told = f"the mass properties of the body of {links} are left out: {error}"
    if warn:
        warnings.warn(told, UserWarning, stacklevel=4)
    return None


def _inertia_of(link: ET.Element, pose: Pose) -> Inertia:
    where = f"link {link.get('name')!r}, inertial"
    (mass,) = _numbers(link.find("inertial/mass"), "value", where, (0.0,))
    inertia, keys = link.find("inertial/inertia"), ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    xx, xy, xz, yy, yz, zz = (_numbers(inertia, key, where, (0.0,))[0] for key in keys)
    axes, centre = pose.placed(_pose(link.find("inertial/origin"), where))
    return mass, centre, axes @ np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))) @ axes.T


def _sum(inertias: Collection[Inertia], shapes: Sequence[Shape]) -> Body:
    total = sum(mass for mass, *_ in inertias)
    middle = np.sum([mass / total * centre for mass, centre, _ in inertias], axis=0)
    inertia = np.zeros((3, 3))
    for mass, centre, own in inertias:
        arm = centre - middle
        inertia += own
        inertia += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Body(mass=total, center_of_mass=middle + 0.0, inertia=inertia, shapes=shapes)


def _shapes(robot: Robot, poses: Mapping[str, Pose]) -> list[Shape]:
    """The boxes, cylinders and spheres of links that are drawn by nothing else; none where there are meshes."""
    found: list[Shape] = []
    for link, pose in poses.items():
        for visual in robot.links[link][0].findall("visual"):
            shape = visual.find("geometry/*")
            if shape is None or shape.tag not in _SIZES:
                return []
            try:
                axes, center = (part + 0.0 for part in pose.placed(_pose(visual.find("origin"), "visual")))
                groups = [_numbers(shape, key, shape.tag, default) for key, default in _SIZES[shape.tag].items()]
            except URDFError:  # what it looks like is no matter of motion
                return []
            sizes = [size for group in groups for size in group]
            if min(sizes) <= 0:
                continue
            if shape.tag == "box":
                found.append(Box(sizes, center, axes))
            elif shape.tag == "cylinder":
                found.append(Cylinder(sizes[0], sizes[1], center, axes[:, 2]))
            else:
                found.append(Sphere(sizes[0], center))
    return found


def _pose(origin: ET.Element | None, where: str) -> Pose:
    """What the element <origin> says: xyz [m] and rpy, fixed-axis XYZ [rad]; without one, nothing is moved."""
    xyz, rpy = (_numbers(origin, key, f"{where}, origin", _NONE) for key in ("xyz", "rpy"))
    return Pose(euler_to_matrix(rpy, "xyz"), np.array(xyz))


def _numbers(element: ET.Element | None, key: str, where: str, default: tuple[Any, ...]) -> tuple[Any, ...]:
    """The one or three finite numbers of an attribute; where it is not given those of the default, as many."""
    text = None if element is None else element.get(key)
    if text is None:
        return default
    words = text.split()
    if len(words) == len(default) and all(_NUMBER.fullmatch(word) and np.isfinite(float(word)) for word in words):
        return tuple(map(float, words))
    raise URDFError(
        f"{where} {key}", "three finite numbers" if len(default) == 3 else "a finite number", quoted(text)
    )
