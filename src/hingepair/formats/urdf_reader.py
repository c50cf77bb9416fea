"""URDF: any hinge of a robot read as a hinge pair.

A body is all links that are rigidly fixed to each other, taken together; the joint's child link has its origin at the
hinge point. Links and joints are read and checked when they are asked for: a robot has parts that a hinge has nothing
to do with, and what is wrong with these refuses nobody. Every joint's parent link must be declared: with a misspelt
parent, what the joint carries would be missing from the body that it belongs to.
"""

from __future__ import annotations

import os
from collections.abc import Mapping

import numpy as np

from hingepair.errors import ArgumentError, URDFError, choices, quoted
from hingepair.mechanism.shapes import body_drawing, link_shapes
from hingepair.pair.body import Body, Shape, warn_of_dynamics
from hingepair.pair.hinge_pair import HingePair
from hingepair.urdf.reader import read_urdf
from hingepair.urdf.records import JointRecord, RobotRecord
from hingepair.urdf.rigid import IDENTITY_POSE, FramePose, combined_inertia


def from_urdf(
    path_or_text: str | os.PathLike[str], joint: str, body1_frame: str | None = None, body2_frame: str | None = None
) -> HingePair:
    """Read the hinge named `joint` from a URDF file or from URDF text, and return it as a HingePair. `body1_frame`
    and `body2_frame` name the links whose frames are (R1, S1) and (R2, S2). By default, these are the parent link and
    the child link of the joint. Mass properties that no rigid body can have are left out, and a warning says so.

    Args:
        path_or_text: path of a file, or the URDF itself (text that starts with "<").
        joint: name of a revolute or continuous joint, which may be a mimic joint.
        body1_frame: name of the link whose frame is (R1, S1): the parent link of the joint (default), or a link that
            is rigidly fixed to it.
        body2_frame: name of the link whose frame is (R2, S2): the child link of the joint (default), or a link that
            is rigidly fixed to it.

    Returns:
        The pair, which has the name of the joint:

        - u1 is the vector from R1 to the joint, and n is the axis of the joint, both in the axes of body 1. u2 is the
          vector from R2 to the joint, in the axes of body 2. home is the attitude of body 2 relative to body 1 at psi
          = 0. With the default frames, u1 and home are the position and the rotation of the joint's `<origin>`, and
          u2 is zero.
        - `limits` are the limits of a revolute joint. They are None for a continuous joint, and for a revolute joint
          whose lower and upper limit are both 0 or are not stated.
        - `torque_limit` is the effort of the joint, and `rate_limit` is the velocity of the joint; each is None if
          the joint does not state it.
        - `body1` combines the parent link of the joint and all links that are rigidly fixed to it, and `body2`
          combines the child link and all links that are rigidly fixed to it. A body is None if none of its links has
          mass. It is also None, with a warning, if no rigid body can have the combined mass properties.
        - The `shapes` of a body are the boxes, cylinders and spheres of the `<visual>` elements of its links. There
          are none if one of the links has other visual shapes, such as meshes.

        To read a pair that `to_urdf` wrote, pass body2_frame="body2": u2 is then the u2 of that pair. For values that
        a pair does not have, `to_urdf` may write the effort 1000, the velocity 100, the mass 1 kg and simple shapes.
        They are read like any other values.

    Raises:
        URDFError: one of the faults in this list was found. Other faults of links and joints that do not belong to
            the two bodies are ignored.

            - The URDF cannot be read.
            - The URDF has no such hinge or frame. The message lists the hinges or frames that can be used.
            - The lower limit is above the upper limit.
            - A link of the two bodies is not declared exactly once, or is the child of more than one joint.
            - The parent link and the child link of the joint are rigidly fixed to each other.
            - A value of the two bodies is not a finite number.
            - A joint anywhere in the robot has a parent link that is not declared. The links that this joint carries
              might belong to one of the bodies.

    >>> import hingepair as hp
    >>> beam = hp.Body(mass=2, shapes=[hp.Box((1, 0.2, 0.1))])
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0), body1=beam, body2=beam)
    >>> hp.from_urdf(hp.to_urdf(pair), joint="hinge", body2_frame="body2").u2.tolist()
    [-0.25, 0.1, 0.0]
    """
    return hinge_pair(read_urdf(path_or_text), joint, body1_frame, body2_frame, name=joint, warn=True)


def hinge_pair(
    robot: RobotRecord,
    joint: str,
    body1_frame: str | None = None,
    body2_frame: str | None = None,
    *,
    name: str,
    warn: bool = False,
) -> HingePair:
    """Return a hinge of a robot as a HingePair called `name`. The frames are names of links, those of (R1, S1) and
    (R2, S2); by default the links that the hinge connects. Mass properties that no rigid body can have are left out,
    with a warning if `warn`.

    Raises:
        URDFError: no such hinge or frame, or what belongs to it is malformed.
    """
    hinge = robot.hinge(joint)
    poses1, poses2 = (_poses_of_fixed_links(robot, hinge, link) for link in (hinge.parent, hinge.child))
    if hinge.child in poses1:
        expected = "a parent and a child that are not fixed to each other"
        raise URDFError(f"joint {joint!r}", expected, f"{hinge.parent!r} and {hinge.child!r}")
    frame1 = _pose_of_frame(poses1, hinge.parent, body1_frame, "body1_frame")
    frame2 = _pose_of_frame(poses2, hinge.child, body2_frame, "body2_frame")
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
    link_name = link if frame is None else frame
    if not isinstance(link_name, str) or link_name not in poses:
        raise URDFError(argument, f"a link rigidly fixed to {link!r}: {choices(tuple(poses))}", quoted(frame))
    return poses[link_name]


def _combined_body(robot: RobotRecord, poses: Mapping[str, FramePose], warn: bool) -> Body | None:
    """Return links that are fixed to each other as one Body; None if none has mass, or if no rigid body can have such
    mass properties, which some robots have. Links without mass are not counted.
    """
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
    """Return the visual shapes of links with these poses; nothing if a link is drawn by anything but boxes, cylinders
    and spheres.
    """
    return body_drawing(
        (link_shapes(robot.links[link][0], "visual"), (), pose) for link, pose in poses.items()
    ).shapes
