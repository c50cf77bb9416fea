"""The conversion of a robot in URDF, and of pairs, to parts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from hingepair.errors import ArgumentError, ShapeError, URDFError, quoted
from hingepair.mechanism.folding import JointPart
from hingepair.mechanism.kinds import JointKind
from hingepair.mechanism.shapes import link_shapes, link_visuals, placed_shapes
from hingepair.mechanism.slider import JOINT_CLASSES, RobotJoint
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.pair.body import Body, warn_of_dynamics
from hingepair.pair.hinge_load import HingeLoad
from hingepair.pair.hinge_pair import HingePair
from hingepair.urdf import records
from hingepair.urdf.rigid import IDENTITY_POSE, FramePose, Inertia

# Kinds of parts, by the type of a URDF joint.
_KIND_OF_TYPE: Mapping[str, JointKind] = {
    "revolute": "hinge",
    "continuous": "hinge",
    "prismatic": "slider",
    "fixed": "fixed",
}
BASE_LINK = "base"
"""Name of the base link of a robot that is built from pairs."""


def parts_of_urdf(robot: records.RobotRecord) -> tuple[Literal["fixed", "free"], list[JointPart]]:
    """Return (kind of the base, parts) for a RobotRecord: the base, then the joints depth-first by name. The kind is
    "free" if one floating joint carries all but the root link, which is then left out. Issue a DynamicsWarning for a
    mimic joint whose leader does not exist; it moves by itself.

    Raises:
        URDFError: the links and joints are no tree, a joint is of a type that has no part, or a number is missing;
            names the joint or the link.
    """
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
        parts.append(
            JointPart(joint.name, kind, numbers[joint.parent], joint.pose, axis, **link, **limits, mimic=mimic)
        )
    return ("free" if is_free else "fixed"), parts


def _link_content(robot: records.RobotRecord, link_name: str, is_leaf: bool) -> dict[str, Any]:
    """Return what a `JointPart` takes of one link of a RobotRecord."""
    link = robot.links[link_name][0]
    leaves, shapes = (link_name,) if is_leaf else (), link_shapes(link, "visual", "collision")
    visuals = link_visuals(link, robot.folder)
    return {
        "links": {link_name: IDENTITY_POSE},
        "leaves": leaves,
        "inertias": {link_name: link.inertia()},
        "shapes": shapes,
        "visuals": visuals,
    }


def parts_of_pairs(pairs: Iterable[RobotJoint], parents: Sequence[int] | None) -> list[JointPart]:
    """Convert joints that share bodies to a list of JointParts: the base, then the pairs in order.

    Args:
        pairs: joints, by name depth-first with siblings by name.
        parents: for each pair, 0 where its body 1 is the base, or j where its body 1 is body 2 of the j-th pair, from
            1 on; None where each pair's body 1 is body 2 of the pair before it.

    Raises:
        ArgumentError: no pair, a name twice, parents that make no tree, another order (names the order to use), or a
            body that is given twice and differs.
    """
    checked = _checked_pairs(pairs)
    parent_numbers = _checked_parents(checked, parents)
    names = [pair.name for pair in checked]
    order = _depth_first_order(names, parent_numbers)
    if order != list(range(len(checked))):
        numbers = {old: new for new, old in enumerate(order, 1)}
        sorted_parents = [numbers.get(parent_numbers[old] - 1, 0) for old in order]
        expected = f"the order {', '.join(names[i] for i in order)} with parents={sorted_parents}"
        raise ArgumentError("pairs", f"{expected}: depth-first, siblings by name", ", ".join(names))
    bodies = [
        _shared_body([("body1", pair) for pair, parent in zip(checked, parent_numbers, strict=True) if parent == 0])
    ]
    for number, pair in enumerate(checked, 1):
        carried = [
            ("body1", other) for other, parent in zip(checked, parent_numbers, strict=True) if parent == number
        ]
        bodies.append(_shared_body([("body2", pair), *carried]))
    seats = [IDENTITY_POSE, *(FramePose(np.eye(3), 0.0 - pair.u2) for pair in checked)]
    base_content = _body_content(BASE_LINK, bodies[0], IDENTITY_POSE, is_leaf=False)
    parts = [JointPart("", "fixed", -1, **base_content)]
    for number, (pair, parent) in enumerate(zip(checked, parent_numbers, strict=True), 1):
        leaf = number not in parent_numbers
        home = np.asarray(pair.home)
        parts.append(
            JointPart(
                pair.name,
                next(kind for kind, made in JOINT_CLASSES.items() if isinstance(pair, made)),
                parent,
                seats[parent].placed(FramePose(home, pair.u1)),
                unit_axis("n", home.T @ pair.n),
                **_body_content(pair.name, bodies[number], seats[number], leaf),
                limits=pair.limits,
                effort_limit=pair.torque_limit,
                rate_limit=pair.rate_limit,
                pitch=getattr(pair, "pitch", 0.0),
            )
        )
    return parts


def nominal_pair(pair: Any) -> Any:
    """Return a pair; if its points u1 and u2 have leading axes, that of the first sample.

    Raises:
        ShapeError: n or home have leading axes.
    """
    if not isinstance(pair, HingePair) or pair.constants.single:
        return pair
    if pair.n.ndim > 1 or pair.home.ndim > 2:
        expected = f"n and home of {pair.name!r} that are the same for all samples; u1 and u2 may differ"
        raise ShapeError("pairs", expected, f"pairs of shape {pair.constants.shape}")
    return replace(pair, u1=pair.u1.reshape(-1, 3)[0], u2=pair.u2.reshape(-1, 3)[0])


def _checked_pairs(pairs: Iterable[RobotJoint]) -> list[RobotJoint]:
    """Check the argument `pairs`, an iterable of HingePairs, Sliders and Screws, and return it as a list."""
    if not isinstance(pairs, Iterable):
        raise ArgumentError("pairs", "HingePairs, Sliders and Screws", quoted(pairs))
    checked = list(pairs)
    if not checked:
        raise ArgumentError("pairs", "at least one HingePair, Slider or Screw", "none")
    names = set()
    for pair in checked:
        if not isinstance(pair, tuple(JOINT_CLASSES.values())):
            hint = " (a PlanarPair's is pair.to_spatial())" if hasattr(pair, "to_spatial") else ""
            raise ArgumentError("pairs", f"HingePairs, Sliders and Screws{hint}", quoted(pair))
        if pair.name in names:
            raise ArgumentError("pairs", "a different name for each, by name=", f"{pair.name!r} twice")
        if pair.name == BASE_LINK:
            raise ArgumentError(
                "pairs",
                f"names other than {BASE_LINK!r}, which is that of the base",
                quoted(pair.name),
            )
        names.add(pair.name)
    return checked


def _checked_parents(pairs: Sequence[RobotJoint], parents: Sequence[int] | None) -> list[int]:
    """Return the number of body 1 of each pair (0 is the base), whether or not they form a tree."""
    count = len(pairs)
    if parents is None:
        return list(range(count))
    parent_numbers = list(parents) if isinstance(parents, Iterable) else None
    if parent_numbers is None or len(parent_numbers) != count:
        raise ArgumentError("parents", f"{count} numbers, one for each pair", quoted(parents))
    for parent in parent_numbers:
        if isinstance(parent, bool) or not isinstance(parent, int | np.integer) or not 0 <= parent <= count:
            raise ArgumentError("parents", f"numbers from 0 (the base) to {count}", quoted(parent))
    return [int(parent) for parent in parent_numbers]


def _depth_first_order(names: Sequence[str], parent_numbers: Sequence[int]) -> list[int]:
    """Return the pairs in depth-first order, siblings by name."""
    carried: dict[int, list[int]] = {}
    for place, parent in enumerate(parent_numbers):
        carried.setdefault(parent, []).append(place)
    order: list[int] = []
    waiting = [0]
    while waiting:
        here = waiting.pop()
        if here:
            order.append(here - 1)
        waiting += [place + 1 for place in sorted(carried.get(here, ()), key=names.__getitem__, reverse=True)]
    if len(order) < len(names):
        loop = next(name for place, name in enumerate(names) if place not in order)
        raise ArgumentError(
            "parents", "a tree that starts at the base, 0", f"{list(parent_numbers)}, where {loop!r} is in a circle"
        )
    return order


def _shared_body(sides_of_pairs: Sequence[tuple[str, RobotJoint]]) -> Body | None:
    """Return the Body that the sides of several pairs share; None if no pair gives it."""
    first_given: tuple[str, Body] | None = None
    for side, pair in sides_of_pairs:
        body: Body | None = getattr(pair, side)
        if body is None:
            continue
        where = f"{side} of {pair.name!r}"
        if first_given is None:
            first_given = where, body
        elif not _same_body(first_given[1], body):
            raise ArgumentError(where, f"the body that {first_given[0]} is, or None", body)
    return None if first_given is None else first_given[1]


def _same_body(one: Body, other: Body) -> bool:
    """Return whether two Body objects have equal mass properties; their shapes are not compared."""
    return one is other or (
        one.mass == other.mass
        and np.array_equal(one.centre_of_mass, other.centre_of_mass)
        and np.array_equal(one.inertia, other.inertia)
    )


def _body_content(link_name: str, body: Body | None, frame_pose: FramePose, is_leaf: bool) -> dict[str, Any]:
    """Return what a `JointPart` takes of a Body in a frame: links, leaves, inertias, shapes and notes."""
    content: dict[str, Any] = {"links": {link_name: frame_pose}, "leaves": (link_name,) if is_leaf else ()}
    if body is None:
        return content | {"without_mass": (link_name,)}
    content["inertias"] = {link_name: body_inertia(body).placed(frame_pose)}
    content["shapes"] = content["visuals"] = tuple(placed_shapes(body.shapes, frame_pose))
    return content | {"notes": tuple(f"{link_name}: {sentence}" for sentence in body.assumed)}


def body_inertia(body: Body) -> Inertia:
    """Return the mass properties of a Body as an Inertia, in the body's axes from its reference point."""
    return Inertia(body.mass, np.asarray(body.centre_of_mass), np.asarray(body.inertia))
