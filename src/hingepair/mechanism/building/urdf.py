"""The reader of robots in URDF, and of one hinge as a pair."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, cast

from hingepair.errors import ArgumentError, URDFError, choices, nearest, quoted
from hingepair.mechanism.bodies.body import warn_of_dynamics
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.bodies.shapes import link_drawing
from hingepair.mechanism.building.changes import pair_of
from hingepair.mechanism.building.folding import (
    JointPart,
    chosen_base,
    fold_parts,
    locked_positions,
    written_joint,
)
from hingepair.mechanism.joints import JointKind
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.tree import Source, Tree
from hingepair.numeric.arrays import number_not_below_0
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.urdf import records
from hingepair.urdf.reader import read_urdf
from hingepair.urdf.rigid import IDENTITY_POSE, FramePose

# Kind of a `JointPart`, by the type of its URDF joint; others are refused.
_KIND_OF_TYPE: Mapping[str, JointKind] = {
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slider",
    "fixed": "fixed",
}
_MAX_SNAP = 0.1  # rad; a tolerance of pi/4 would replace every angle


def tree_of_urdf(
    path_or_text: str | os.PathLike[str], base: str | None, locked: Mapping[str, float] | None, snap: float | None
) -> tuple[Tree, str]:
    """Return the tree of a URDF file or text, and the kind of its base, as `Mechanism.from_urdf` describes."""
    tolerance = 0.0 if snap is None else number_not_below_0("snap", snap)
    if tolerance > _MAX_SNAP:
        raise ArgumentError("snap", f"an angle [rad] of at most {_MAX_SNAP}", snap)
    robot = read_urdf(path_or_text, tolerance)
    own, parts = _parts(robot)
    held = locked_positions(parts, locked)
    tree = fold_parts(robot.name, parts, held)
    return replace(tree, source=Source(robot.text, held, tolerance)), chosen_base(base, own)


def _parts(robot: records.RobotRecord) -> tuple[Literal["fixed", "free"], list[JointPart]]:
    """Return the kind of the base, and the parts: the base, then the joints depth-first by name."""
    root, joints = robot.root, robot.joints
    is_free = bool(joints) and joints[0].type == "floating" and all(joint.parent != root for joint in joints[1:])
    if is_free:
        root, joints = joints[0].child, joints[1:]
    parents = {joint.parent for joint in joints}
    names = {joint.name for joint in joints}
    numbers = {root: 0}
    parts = [_with_link(JointPart(written_joint("")), robot, root, root not in parents)]
    for joint in joints:
        if joint.type not in _KIND_OF_TYPE:
            expected = f"a type out of {', '.join(_KIND_OF_TYPE)}"
            raise URDFError(f"joint {joint.name!r}", expected, quoted(joint.type) if joint.type else "none")
        mimic = joint.mimic
        if mimic is not None and mimic.leader not in names:
            lost = f"follows {mimic.leader!r}, which the robot does not have; it moves on its own"
            warn_of_dynamics(f"joint {joint.name!r} {lost}")
            mimic = None
        numbers[joint.child] = len(parts)
        own = written_joint(
            joint.name, _KIND_OF_TYPE[joint.type], numbers[joint.parent], joint.pose,
            unit_axis(f"joint {joint.name!r}, axis", joint.axis), joint.limits, joint.effort, joint.velocity,
            ratio=joint.reduction, load=HingeLoad(damping=joint.damping, friction=joint.friction),
            continuous=joint.type == "continuous",
        )  # fmt: skip
        parts.append(_with_link(JointPart(own, mimic), robot, joint.child, joint.child not in parents))
    return ("free" if is_free else "fixed"), parts


def _with_link(part: JointPart, robot: records.RobotRecord, name: str, is_leaf: bool) -> JointPart:
    link = robot.links[name]
    part.add_link(name, IDENTITY_POSE, link.masses, is_leaf)
    part.drawing = link_drawing(link, robot.folder)
    return part


# ---- one hinge


def from_urdf(
    path_or_text: str | os.PathLike[str],
    joint: str,
    body1_frame: str | None = None,
    body2_frame: str | None = None,
) -> HingePair:
    """Read one hinge of a robot from a URDF file or from URDF text.

    Each body is the link of the joint with all links that are rigidly fixed to it.

    Args:
        path_or_text: path of a file, or the URDF itself (text that starts with "<").
        joint: name of a revolute or continuous joint, which may be a mimic joint.
        body1_frame: name of the link whose frame is (R1, S1): the parent link of the joint (default), or one that is
            rigidly fixed to it.
        body2_frame: name of the link whose frame is (R2, S2): the child link of the joint (default), or one that is
            rigidly fixed to it. With "body2", a pair that `to_urdf` wrote has the same u2 again.

    Returns:
        The HingePair, which has the name of the joint. With the default frames, u1 and home are the position and the
        rotation of the joint's `<origin>`, and u2 is zero.

        - `limits`, `torque_limit` (effort) and `rate_limit` (velocity) are None where they are not stated; limits
          also if both are 0, and those of a continuous joint.
        - `body1` and `body2` are None if nothing has mass, and, with a warning, if no rigid body can have the mass
          properties. Their `shapes` are the boxes, cylinders and spheres of `<visual>` or else of `<collision>`; none
          if one of the links has others, such as meshes.

    Raises:
        URDFError: the URDF cannot be read, as for `Mechanism.from_urdf`, or has no such hinge or frame.

    >>> import hingepair as hp
    >>> beam = hp.Body(mass=2, shapes=[hp.Box((1, 0.2, 0.1))])
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0), body1=beam, body2=beam)
    >>> hp.from_urdf(hp.to_urdf(pair), joint="hinge", body2_frame="body2").u2.tolist()
    [-0.25, 0.1, 0.0]
    """
    robot = read_urdf(path_or_text)
    parts = _parts(robot)[1]
    tree = fold_parts(robot.name, parts)
    hinges = {one.name: number for number, one in enumerate(tree.joints, 1) if one.kind == "hinge"}
    if joint not in hinges:
        known = choices(list(hinges)) if hinges else "a robot with a revolute or continuous joint"
        kind = next((f", which is {one.type}" for one in robot.joints if one.name == joint), "")
        raise URDFError("joint", known + ("" if kind else nearest(str(joint), hinges)), f"{quoted(joint)}{kind}")
    number, record = hinges[joint], next(one for one in robot.joints if one.name == joint)
    ends = []
    for argument, body, own, link in (
        ("body1_frame", tree.joints[number - 1].parent, record.parent, body1_frame),
        ("body2_frame", number, record.child, body2_frame),
    ):
        links = {name: frame for name, frame in tree.links.items() if frame.body == body}
        if link is not None and link not in links:
            raise URDFError(argument, f"a link rigidly fixed to {own!r}: {choices(list(links))}", quoted(link))
        frame = links[link or own]
        ends.append(FramePose(frame.S, frame.R))
    return cast(HingePair, pair_of(tree, number, (ends[0], ends[1])))
