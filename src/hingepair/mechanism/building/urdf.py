"""The reader of robots in URDF, and of one hinge as a pair."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import cast

from hingepair.errors import ArgumentError, URDFError, choices, nearest, quoted, warn_of_dynamics
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.bodies.shapes import link_drawing
from hingepair.mechanism.building.changes import pair_of
from hingepair.mechanism.building.folding import chosen_base, fold, framed, written_joint
from hingepair.mechanism.kinds import JointKind
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.tree import Source, Tree
from hingepair.numeric.arrays import number_not_below_0
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.urdf import records
from hingepair.urdf.reader import read_urdf

# Kinds by the type of a URDF joint; others are refused.
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
    tree, own = _tree(robot)
    return fold(replace(tree, source=Source(robot.text, {}, tolerance)), locked), chosen_base(base, own)


def _tree(robot: records.RobotRecord) -> tuple[Tree, str]:
    """Return the tree with all joints, depth-first by name, and the kind of the base."""
    root, joints = robot.root, robot.joints
    is_free = bool(joints) and joints[0].type == "floating" and all(joint.parent != root for joint in joints[1:])
    if is_free:
        root, joints = joints[0].child, joints[1:]
    names = {joint.name for joint in joints}
    numbers = {link: number for number, link in enumerate((root, *(joint.child for joint in joints)))}
    read = []
    for joint in joints:
        if joint.type not in _KIND_OF_TYPE:
            expected = f"a type out of {', '.join(_KIND_OF_TYPE)}"
            raise URDFError(f"joint {joint.name!r}", expected, quoted(joint.type) if joint.type else "none")
        mimic = joint.mimic
        if mimic is not None and mimic.leader not in names:
            lost = f"follows {mimic.leader!r}, which the robot does not have; it moves on its own"
            warn_of_dynamics(f"joint {joint.name!r} {lost}")
            mimic = None
        own = written_joint(
            joint.name, _KIND_OF_TYPE[joint.type], numbers[joint.parent], joint.pose,
            unit_axis(f"joint {joint.name!r}, axis", joint.axis), robot.links[joint.child].masses,
            joint.limits, joint.effort, joint.velocity, mimic=mimic, ratio=joint.reduction,
            load=HingeLoad(damping=joint.damping, friction=joint.friction), continuous=joint.type == "continuous",
        )  # fmt: skip
        read.append(own)
    parents = {joint.parent for joint in joints}
    tree = Tree(
        robot.name, tuple(read), robot.links[root].masses, {link: framed(k) for link, k in numbers.items()}, {},
        tuple(link for link in numbers if link not in parents),
        drawings=tuple(link_drawing(robot.links[link], robot.folder) for link in numbers),
    )  # fmt: skip
    return tree, "free" if is_free else "fixed"


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
    tree = fold(_tree(robot)[0])
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
        ends.append(links[link or own].pose)
    return cast(HingePair, pair_of(tree, number, (ends[0], ends[1])))
