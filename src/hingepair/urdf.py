"""URDF: a hinge pair written as a robot of two links, and any hinge of a robot read as a hinge pair.

In URDF the child link's origin is the hinge point. So the pair is written as

    body1 --hinge--> body2_at_hinge --fixed--> body2

with the hinge's origin at (u1, home), its axis home^T n in the child's axes, and body2 (the reference point R2 and
attitude S2) at -u2. Read back with `body2_frame="body2"` the same u1, u2, n and home come out.
"""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, ShapeError, URDFError, choices
from hingepair.euler import euler_to_matrix, matrix_to_euler
from hingepair.pair import HingePair, check_pair
from hingepair.urdf_tree import Robot, parse_urdf, read_urdf

__all__ = ["Robot", "from_urdf", "hinge_pair", "parse_urdf", "to_urdf"]

BODY1, BODY2, BODY2_AT_HINGE, HINGE = "body1", "body2", "body2_at_hinge", "hinge"
"""Names of the links and of the joint in the URDF of a pair."""

_MASS, _INERTIA = 1.0, 0.01  # kg, kg m^2: small and valid, for loaders that refuse a body without inertia
_NOT_XML = "[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"  # compiled when used: that takes milliseconds

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]


def to_urdf(pair: HingePair) -> str:
    """The pair as URDF text: the same text for the same pair.

    The base is free: give the loader a free-flyer root joint. The links are named as the module says; body2's
    frame is (R2, S2), body1's is (R1, S1).

    Raises:
        ArgumentError: the pair's name holds a character that XML cannot.
        ShapeError: u1, u2, n or home differ from sample to sample.

    >>> from hingepair.pair import HingePair
    >>> pair = HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0))
    >>> parse_urdf(to_urdf(pair)).hinge("hinge").xyz
    (0.5, 0.0, 0.1)
    """
    check_pair(pair)
    for name, shape in (("u1", (3,)), ("u2", (3,)), ("n", (3,)), ("home", (3, 3))):
        if getattr(pair, name).shape != shape:
            raise ShapeError(name, f"one pair: shape {shape}", f"shape {getattr(pair, name).shape}")
    if re.search(_NOT_XML, pair.name):
        raise ArgumentError("name", "characters that XML can hold", pair.name)
    robot = ET.Element("robot", {"name": pair.name})
    _add_link(robot, BODY1, centre=np.zeros(3))
    _add_link(robot, BODY2_AT_HINGE, centre=-pair.u2)
    _add_link(robot, BODY2)
    hinge = _add_joint(robot, HINGE, "continuous", BODY1, BODY2_AT_HINGE)
    ET.SubElement(hinge, "origin", {"xyz": _text(pair.u1), "rpy": _text(matrix_to_euler(pair.home, "xyz"))})
    ET.SubElement(hinge, "axis", {"xyz": _text(pair.home.T @ pair.n)})
    reference = _add_joint(robot, "body2_reference", "fixed", BODY2_AT_HINGE, BODY2)
    ET.SubElement(reference, "origin", {"xyz": _text(-pair.u2), "rpy": _text((0.0, 0.0, 0.0))})
    ET.indent(robot)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


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

    Raises:
        URDFError: no readable URDF, or no such hinge or frame in it; says what would do.

    >>> from hingepair.pair import HingePair
    >>> pair = HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0))
    >>> from_urdf(to_urdf(pair), joint="hinge", body2_frame="body2").u2.tolist()
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
    frame1, point1 = _pose_in(robot, hinge.parent, body1_frame, "body1_frame")
    frame2, point2 = _pose_in(robot, hinge.child, body2_frame, "body2_frame")
    home = frame1.T @ euler_to_matrix(hinge.rpy, "xyz")
    size = max(map(abs, hinge.axis))
    n = home @ (np.array(hinge.axis) / size)
    u1 = frame1.T @ (np.array(hinge.xyz) - point1)
    return HingePair(u1=u1 + 0.0, u2=0.0 - frame2.T @ point2, n=n + 0.0, home=home @ frame2 + 0.0, name=name)


def _pose_in(robot: Robot, link: str, frame: str | None, argument: str) -> Pose:
    """Rotation and origin of a frame in the axes of the link that it is rigidly fixed to."""
    poses: dict[str, Pose] = {link: (np.eye(3), np.zeros(3))}
    wanted = link if frame is None else frame
    fixed = [joint for joint in robot.joints.values() if joint.type == "fixed"]
    grown = True
    while wanted not in poses and grown:
        grown = False
        for joint in fixed:
            if (joint.parent in poses) == (joint.child in poses):
                continue
            grown = True
            rotation, origin = euler_to_matrix(joint.rpy, "xyz"), np.array(joint.xyz)
            if joint.parent in poses:
                outer, start = poses[joint.parent]
                poses[joint.child] = outer @ rotation, start + outer @ origin
            else:
                outer, start = poses[joint.child]
                outer = outer @ rotation.T
                poses[joint.parent] = outer, start - outer @ origin
    if wanted not in poses:
        raise URDFError(argument, f"a link rigidly fixed to {link!r}: {choices(tuple(poses))}", frame)
    return poses[wanted]


def _add_link(robot: ET.Element, name: str, centre: NDArray[np.float64] | None = None) -> None:
    link = ET.SubElement(robot, "link", {"name": name})
    if centre is None:
        return
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", {"xyz": _text(centre), "rpy": _text((0.0, 0.0, 0.0))})
    ET.SubElement(inertial, "mass", {"value": repr(_MASS)})
    moments = dict.fromkeys(("ixx", "iyy", "izz"), repr(_INERTIA)) | dict.fromkeys(("ixy", "ixz", "iyz"), repr(0.0))
    ET.SubElement(inertial, "inertia", dict(sorted(moments.items())))


def _add_joint(robot: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    joint = ET.SubElement(robot, "joint", {"name": name, "type": kind})
    ET.SubElement(joint, "parent", {"link": parent})
    ET.SubElement(joint, "child", {"link": child})
    return joint


def _text(vector: Any) -> str:
    """Three numbers with all their digits (repr knows no locale), without the sign of -0."""
    return " ".join(repr(float(value) + 0.0) for value in vector)
