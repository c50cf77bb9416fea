"""URDF: any hinge of a robot read as a hinge pair.

A body is all links that are rigidly fixed to each other, taken together; the joint's child link has its origin at the
hinge point. Links and joints are read and checked when they are asked for: a robot has parts that a hinge has nothing
to do with, and what is wrong with these refuses nobody. Every joint's parent link must be declared: with a misspelt
parent, what the joint carries would be missing from the body that it belongs to.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, URDFError, choices, quoted
from hingepair.mechanism.bodies.body import Body, Shape, warn_of_dynamics
from hingepair.mechanism.bodies.shapes import LinkDrawing, body_drawing, link_shapes
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.urdf.reader import read_urdf
from hingepair.urdf.records import JointRecord, RobotRecord
from hingepair.urdf.rigid import IDENTITY_POSE, FramePose, combined_inertia


def from_urdf(
    path_or_text: str | os.PathLike[str],
    joint: str,
    body1_frame: str | None = None,
    body2_frame: str | None = None,
    *,
    points: Iterable[str] = (),
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
        points: names of links that are rigidly fixed to either body. Their origins become points of the pair.

    Returns:
        The HingePair, which has the name of the joint. With the default frames, u1 and home are the position and the
        rotation of the joint's `<origin>`, and u2 is zero.

        - `limits`, `torque_limit` (effort) and `rate_limit` (velocity) are None where they are not stated; limits
          also if both are 0, and those of a continuous joint.
        - `body1` and `body2` are None if nothing has mass, and, with a warning, if no rigid body can have the mass
          properties. Their `shapes` are the boxes, cylinders and spheres of `<visual>`, none if a link has others,
          such as meshes.

    Raises:
        URDFError: the URDF cannot be read, has no such hinge or frame, or what belongs to the two bodies is wrong: an
            inertia, limits, or links that are declared twice or in a circle. Faults of other links are ignored, but
            not a parent link that is not declared: what that joint carries might belong to one of the bodies.

    >>> import hingepair as hp
    >>> beam = hp.Body(mass=2, shapes=[hp.Box((1, 0.2, 0.1))])
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0), body1=beam, body2=beam)
    >>> hp.from_urdf(hp.to_urdf(pair), joint="hinge", body2_frame="body2").u2.tolist()
    [-0.25, 0.1, 0.0]
    """
    return hinge_pair(read_urdf(path_or_text), joint, body1_frame, body2_frame, name=joint, points=points, warn=True)


def hinge_pair(
    robot: RobotRecord,
    joint: str,
    body1_frame: str | None = None,
    body2_frame: str | None = None,
    *,
    name: str,
    points: Iterable[str] = (),
    warn: bool = False,
) -> HingePair:
    """Return a hinge of a robot as a HingePair called `name`, with the warnings of `from_urdf` if `warn`."""
    hinge = robot.hinge(joint)
    poses1, poses2 = (_poses_of_fixed_links(robot, hinge, link) for link in (hinge.parent, hinge.child))
    if hinge.child in poses1:
        expected = "a parent and a child that are not fixed to each other"
        raise URDFError(f"joint {joint!r}", expected, f"{hinge.parent!r} and {hinge.child!r}")
    frame1 = _pose_of_frame(poses1, hinge.parent, body1_frame, "body1_frame")
    frame2 = _pose_of_frame(poses2, hinge.child, body2_frame, "body2_frame")
    points1: dict[str, Any] = {}
    points2: dict[str, Any] = {}
    for link in (points,) if isinstance(points, str) else points:
        if link not in poses1 and link not in poses2:
            expected = f"links fixed to {hinge.parent!r} or {hinge.child!r}: {choices((*poses1, *poses2))}"
            raise URDFError("points", expected, quoted(link))
        if link in poses1:
            points1[link] = frame1.seen(poses1[link]).origin + 0.0
        else:
            points2[link] = frame2.seen(poses2[link]).origin + 0.0
    home, u1 = frame1.seen(hinge.pose)
    with np.errstate(under="ignore"):
        n, home = home @ (np.array(hinge.axis) / max(map(abs, hinge.axis))), home @ frame2.rotation
    return HingePair(
        u1=u1 + 0.0,
        u2=frame2.seen(IDENTITY_POSE).origin + 0.0,
        n=n + 0.0,
        home=home + 0.0,
        name=name,
        limits=hinge.limits,
        torque_limit=hinge.effort,
        rate_limit=hinge.velocity,
        body1=_combined_body(robot, {link: frame1.seen(pose) for link, pose in poses1.items()}, warn),
        body2=_combined_body(robot, {link: frame2.seen(pose) for link, pose in poses2.items()}, warn),
        points1=points1,
        points2=points2,
    )


def _poses_of_fixed_links(robot: RobotRecord, hinge: JointRecord, link: str) -> dict[str, FramePose]:
    """Return the poses of a link of a hinge and of all links that are fixed to it, in the axes of the link."""
    robot.check_link(link, hinge)
    poses = {link: IDENTITY_POSE}
    waiting: list[tuple[str, JointRecord]] = [(link, hinge)]
    with np.errstate(all="ignore"):  # an origin of 1e308 is HingePair's to refuse, where it is needed
        while waiting:
            link_name, last_joint = waiting.pop()
            for joint in robot.joints_at[link_name]:
                if joint.type != "fixed" or joint is last_joint:
                    continue
                other_link = joint.child if joint.parent == link_name else joint.parent
                robot.check_link(other_link, joint)
                if other_link in poses:
                    raise URDFError(f"joint {joint.name!r}", "a tree of links", f"a circle through {other_link!r}")
                poses[other_link] = poses[link_name].placed(
                    joint.pose if other_link == joint.child else joint.pose.seen(IDENTITY_POSE)
                )
                waiting.append((other_link, joint))
    return poses


def _pose_of_frame(poses: Mapping[str, FramePose], link: str, frame: str | None, argument: str) -> FramePose:
    """Return the pose of `frame`, by default of `link`; refuse one that is not fixed to the link."""
    link_name = link if frame is None else frame
    if not isinstance(link_name, str) or link_name not in poses:
        raise URDFError(argument, f"a link rigidly fixed to {link!r}: {choices(tuple(poses))}", quoted(frame))
    return poses[link_name]


def _combined_body(robot: RobotRecord, poses: Mapping[str, FramePose], warn: bool) -> Body | None:
    """Return links that are fixed to each other as one Body; None without mass, or with one of no rigid body."""
    with np.errstate(all="ignore"):  # what overflows is no mass property: Body refuses it
        inertias = {link: robot.links[link][0].inertia().placed(pose) for link, pose in poses.items()}
        heavy = {link: inertia for link, inertia in inertias.items() if inertia[0] != 0}
        try:
            for link, part in heavy.items():
                if part.mass < 0:
                    raise ArgumentError(f"mass of {link!r}", "a number above 0", part.mass)
            mass, centre, tensor = combined_inertia(heavy.values())
            return Body(mass, centre, tensor, _link_shapes(robot, poses)) if heavy else None
        except ArgumentError as error:
            links = ", ".join(map(repr, heavy))
            message = f"the mass properties of the body of {links} are left out: {error}"
    if warn:
        warn_of_dynamics(message)
    return None


def _link_shapes(robot: RobotRecord, poses: Mapping[str, FramePose]) -> tuple[Shape, ...]:
    """Return the visual shapes of links with these poses; nothing if meshes draw a link."""
    drawings = (LinkDrawing(link_shapes(robot.links[link][0], "visual")) for link in poses)
    return body_drawing(zip(drawings, poses.values(), strict=True)).shapes
