"""URDF: a hinge pair written as a robot of two links, and any hinge of a robot read as a hinge pair.

In URDF the child link's origin is the hinge point. So the pair is written as

    body1 --hinge--> body2_at_hinge --fixed--> body2

with the hinge's origin at (u1, home), its axis home^T n in the child's axes, and body2 (the reference point R2 and
attitude S2) at -u2. Read back with `body2_frame="body2"` the same u1, u2, n and home come out.
"""

from __future__ import annotations

import math
import os
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import URDFError, choices, quoted
from hingepair.formats.export_parts import (
    BASE,
    BODY1,
    BODY2,
    BODY2_AT_HINGE,
    HINGE,
    WORLD,
    Part,
    document,
    hinge_axis2,
    numbers,
    parts_of,
)
from hingepair.formats.urdf_inertia import Pose, combined_body
from hingepair.formats.urdf_tree import Robot, parse_urdf, read_urdf
from hingepair.numeric.arrays import check_choice
from hingepair.pair.body import Box, Cylinder, Shape
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.euler import euler_to_matrix, matrix_to_euler

__all__ = ["Robot", "from_urdf", "hinge_pair", "parse_urdf", "to_urdf"]

BASES = ("free", "floating", "fixed")
"""How body 1 hangs in the world, for `to_urdf`."""

_EFFORT, _VELOCITY = 1000.0, 100.0  # N m, rad/s: a revolute joint must name them, and these should stop nobody
_ASIDE = (2.0**-53, 2.0**-39)
_STILL = (0.0, 0.0, 0.0)

# MuJoCo reads URDF too, and this element of it: body2 stays a body of its own, and the shapes are kept.
_FOR_MUJOCO = {"fusestatic": "false", "discardvisual": "false"}


def to_urdf(pair: HingePair, *, base: str = "free") -> str:
    """The pair as URDF text: the same text for the same pair.

    The link `body1` has the frame (R1, S1). The joint `hinge`, revolute where the pair has limits, else continuous,
    leads from it to the link `body2_at_hinge`, which has body 2's mass and shapes and its origin at the hinge point;
    the link `body2`, fixed to that at -u2, has the frame (R2, S2). A revolute joint of URDF must say how strong and
    how fast it is: effort="1000.0" (N m) and velocity="100.0" (rad/s) are written, which a pair does not know and
    which should stop nothing.

    Args:
        pair: the pair; its limits, body1 and body2 are written where given.
        base: "free": body1 is the root, to be set free by the loader (Pinocchio: a free-flyer root joint);
            "floating": a floating joint from a link `world`; "fixed": body1 is fixed to `world`.

    Raises:
        ArgumentError: an unknown base; the pair's name holds a character that XML cannot.
        ShapeError: u1, u2, n or home differ from sample to sample.

    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0), limits=(-1, 1))
    >>> [line.strip() for line in hp.to_urdf(pair).splitlines() if "<limit" in line]
    ['<limit lower="-1.0" upper="1.0" effort="1000.0" velocity="100.0" />']
    """
    check_choice("base", base, BASES)
    one, two = parts_of(pair)
    robot = ET.Element("robot", {"name": pair.name})
    ET.SubElement(ET.SubElement(robot, "mujoco"), "compiler", _FOR_MUJOCO)
    for name, part in ((BODY1, one), (BODY2_AT_HINGE, two)):
        material = ET.SubElement(robot, "material", {"name": f"{name}_paint"})
        ET.SubElement(material, "color", {"rgba": part.colour})
    if base != "free":
        ET.SubElement(robot, "link", {"name": WORLD})
    _add_link(robot, BODY1, one)
    _add_link(robot, BODY2_AT_HINGE, two)
    ET.SubElement(robot, "link", {"name": BODY2})
    if base != "free":
        _add_joint(robot, BASE, base, WORLD, BODY1)
    kind = "continuous" if pair.limits is None else "revolute"
    hinge = _add_joint(robot, HINGE, kind, BODY1, BODY2_AT_HINGE)
    _add_origin(hinge, pair.u1, matrix_to_euler(pair.home, "xyz"))
    ET.SubElement(hinge, "axis", {"xyz": numbers(_axis(pair))})
    if pair.limits is not None:
        keys, values = ("lower", "upper", "effort", "velocity"), (*pair.limits, _EFFORT, _VELOCITY)
        ET.SubElement(hinge, "limit", {key: numbers((value,)) for key, value in zip(keys, values, strict=True)})
    _add_origin(_add_joint(robot, "body2_reference", "fixed", BODY2_AT_HINGE, BODY2), -pair.u2, _STILL)
    return document(robot)


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
        is given: URDF takes them for 0), and the mass properties of the bodies, each of all links that are rigidly
        fixed to each other; None where no link has mass, and, with a warning, where the sum is none that a rigid
        body can have. Shapes, the limits of effort and velocity, and the robot's name are not read.

    Raises:
        URDFError: no readable URDF, limits the wrong way round, or no such hinge or frame; says what would do.

    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0))
    >>> hp.from_urdf(hp.to_urdf(pair), joint="hinge", body2_frame="body2").u2.tolist()
    [-0.25, 0.1, 0.0]
    """
    robot = parse_urdf(read_urdf(path_or_text))
    return hinge_pair(robot, joint, body1_frame, body2_frame, name=joint)


def hinge_pair(robot: Robot, joint: str, body1_frame: str | None, body2_frame: str | None, *, name: str) -> HingePair:
    """The pair of `from_urdf`, of a robot already parsed.

    Raises:
        URDFError: no such hinge or frame, or an axis of zero.
    """
    hinge = robot.hinge(joint)
    if not any(hinge.axis):
        raise URDFError(f"joint {joint!r}, axis xyz", "a non-zero axis", hinge.axis)
    poses1, poses2 = _fixed_to(robot, hinge.parent), _fixed_to(robot, hinge.child)
    frame1, point1 = _chosen(poses1, hinge.parent, body1_frame, "body1_frame")
    frame2, point2 = _chosen(poses2, hinge.child, body2_frame, "body2_frame")
    home = frame1.T @ euler_to_matrix(hinge.rpy, "xyz")
    size = max(map(abs, hinge.axis))
    n = home @ (np.array(hinge.axis) / size)
    u1 = frame1.T @ (np.array(hinge.xyz) - point1)
    return HingePair(
        u1=u1 + 0.0,
        u2=0.0 - frame2.T @ point2,
        n=n + 0.0,
        home=home @ frame2 + 0.0,
        name=name,
        limits=hinge.limits,
        body1=combined_body(robot, _seen_from(poses1, frame1, point1)),
        body2=combined_body(robot, _seen_from(poses2, frame2, point2)),
    )


def _fixed_to(robot: Robot, link: str) -> dict[str, Pose]:
    """Rotation and origin of every link that is rigidly fixed to a link, in the axes of that link."""
    fixed = [joint for joint in robot.joints.values() if joint.type == "fixed"]
    rotations = euler_to_matrix(np.array([joint.rpy for joint in fixed]).reshape(-1, 3), "xyz")
    neighbours = defaultdict(list)
    for joint, rotation in zip(fixed, rotations, strict=True):
        neighbours[joint.parent].append((joint, rotation))
        neighbours[joint.child].append((joint, rotation))
    poses: dict[str, Pose] = {link: (np.eye(3), np.zeros(3))}
    waiting = [link]
    with np.errstate(all="ignore"):  # an origin of 1e308 is HingePair's to refuse, where it is needed
        while waiting:
            here = waiting.pop()
            outer, start = poses[here]
            for joint, rotation in neighbours[here]:
                there = joint.child if joint.parent == here else joint.parent
                if there in poses:
                    continue
                origin = np.array(joint.xyz)
                if there == joint.child:
                    poses[there] = outer @ rotation, start + outer @ origin
                else:
                    outwards = outer @ rotation.T
                    poses[there] = outwards, start - outwards @ origin
                waiting.append(there)
    return poses


def _chosen(poses: Mapping[str, Pose], link: str, frame: str | None, argument: str) -> Pose:
    wanted = link if frame is None else frame
    if wanted not in poses:
        raise URDFError(argument, f"a link rigidly fixed to {link!r}: {choices(tuple(poses))}", quoted(frame))
    return poses[wanted]


def _seen_from(poses: Mapping[str, Pose], axes: NDArray[np.float64], point: NDArray[np.float64]) -> dict[str, Pose]:
    """Poses in a frame that is itself given by its axes and origin."""
    return {link: (axes.T @ rotation, axes.T @ (origin - point)) for link, (rotation, origin) in poses.items()}


def _axis(pair: HingePair) -> NDArray[np.float64]:
    """The hinge axis in the child's axes, a hair too long where it is a hair off x, y or z.

    Pinocchio takes what is within 1e-12 of x for x; an axis that is longer by more than that it normalises.
    """
    axis = hinge_axis2(pair)
    aside = float(np.sort(np.abs(axis))[1])
    return axis * (1 + 2 * _ASIDE[1]) if _ASIDE[0] < aside < _ASIDE[1] else axis


def _add_link(robot: ET.Element, name: str, part: Part) -> None:
    link = ET.SubElement(robot, "link", {"name": name})
    inertial = ET.SubElement(link, "inertial")
    _add_origin(inertial, part.center, _STILL)
    ET.SubElement(inertial, "mass", {"value": numbers((part.mass,))})
    keys = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    ET.SubElement(inertial, "inertia", {k: numbers((m,)) for k, m in zip(keys, part.moments, strict=True)})
    for shape in part.shapes:
        visual = ET.SubElement(link, "visual")
        _add_origin(visual, shape.center, _turn(shape))
        kind, sizes = _geometry(shape)
        ET.SubElement(ET.SubElement(visual, "geometry"), kind, sizes)
        ET.SubElement(visual, "material", {"name": f"{name}_paint"})


def _geometry(shape: Shape) -> tuple[str, dict[str, str]]:
    if isinstance(shape, Box):
        return "box", {"size": numbers(shape.size)}
    if isinstance(shape, Cylinder):
        return "cylinder", {"radius": numbers((shape.radius,)), "length": numbers((shape.length,))}
    return "sphere", {"radius": numbers((shape.radius,))}


def _turn(shape: Shape) -> tuple[float, float, float]:
    """Roll and pitch that take z, the axis of URDF's cylinders, to the shape's."""
    if not isinstance(shape, Cylinder):
        return _STILL
    x, y, z = map(float, shape.axis)
    return math.atan2(-y, math.hypot(x, z)), math.atan2(x, z), 0.0


def _add_joint(robot: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    joint = ET.SubElement(robot, "joint", {"name": name, "type": kind})
    ET.SubElement(joint, "parent", {"link": parent})
    ET.SubElement(joint, "child", {"link": child})
    return joint


def _add_origin(element: ET.Element, xyz: Iterable[float], rpy: Iterable[float]) -> None:
    ET.SubElement(element, "origin", {"xyz": numbers(xyz), "rpy": numbers(rpy)})
