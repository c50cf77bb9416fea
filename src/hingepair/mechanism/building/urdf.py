"""The reader of robots in URDF."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal

from hingepair.errors import ArgumentError, URDFError, quoted
from hingepair.mechanism.bodies.body import warn_of_dynamics
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.bodies.shapes import link_drawing
from hingepair.mechanism.building.folding import JointPart, chosen_base, fold_parts, locked_positions
from hingepair.mechanism.joints import JointKind
from hingepair.mechanism.tree import Source, Tree
from hingepair.numeric.arrays import number_not_below_0
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.urdf import records
from hingepair.urdf.reader import read_urdf
from hingepair.urdf.rigid import IDENTITY_POSE

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
    chosen = chosen_base(base, own)
    held = locked_positions(parts, locked)
    tree = fold_parts(robot.name, parts, chosen, held)
    return replace(tree, source=Source(robot.text, held, tolerance)), chosen


def _parts(robot: records.RobotRecord) -> tuple[Literal["fixed", "free"], list[JointPart]]:
    """Return the kind of the base, and the parts: the base, then the joints depth-first by name."""
    root, joints = robot.tree()
    is_free = bool(joints) and joints[0].type == "floating" and all(joint.parent != root for joint in joints[1:])
    if is_free:
        root, joints = joints[0].child, joints[1:]
    parents = {joint.parent for joint in joints}
    names = {joint.name for joint in joints}
    numbers = {root: 0}
    parts = [JointPart("", "fixed", -1, **_link_content(robot, root, root not in parents))]
    for joint in joints:
        if joint.type not in _KIND_OF_TYPE:
            expected = f"a type out of {', '.join(_KIND_OF_TYPE)}"
            raise URDFError(f"joint {joint.name!r}", expected, quoted(joint.type) if joint.type else "none")
        numbers[joint.child] = len(parts)
        link = _link_content(robot, joint.child, joint.child not in parents)
        kind = _KIND_OF_TYPE[joint.type]
        if kind == "fixed":
            parts.append(JointPart(joint.name, kind, numbers[joint.parent], joint.pose, **link))
            continue
        axis = unit_axis(f"joint {joint.name!r}, axis", joint.axis)
        limits: dict[str, Any] = {"limits": joint.limits, "effort_limit": joint.effort, "rate_limit": joint.velocity}
        limits["load"] = HingeLoad(damping=joint.damping, friction=joint.friction)
        mimic = joint.mimic
        if mimic is not None and mimic.leader not in names:
            message = (
                f"joint {joint.name!r} follows {mimic.leader!r}, which the robot does not have; it moves on its own"
            )
            warn_of_dynamics(message)
            mimic = None
        limits |= {"mimic": mimic, "continuous": joint.type == "continuous"}
        parts.append(JointPart(joint.name, kind, numbers[joint.parent], joint.pose, axis, **link, **limits))
    return ("free" if is_free else "fixed"), parts


def _link_content(robot: records.RobotRecord, link_name: str, is_leaf: bool) -> dict[str, Any]:
    """Return what a `JointPart` takes of a link."""
    link = robot.links[link_name][0]
    return {
        "links": {link_name: IDENTITY_POSE},
        "leaves": (link_name,) if is_leaf else (),
        "inertias": {link_name: link.inertia()},
        "drawing": link_drawing(link, robot.folder),
    }
