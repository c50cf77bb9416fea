"""Robots as readers make them, with joints of every kind, folded into trees of the joints that move.

A reader makes a Tree whose joints may be fixed, and may follow others that follow. `fold` merges the bodies that
fixed and locked joints connect.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np

from hingepair.equations.spatial import hinge_rotation
from hingepair.errors import ArgumentError, choices, nearest, quoted, warn_of_dynamics
from hingepair.mechanism.bodies.shapes import NOT_DRAWN, body_drawing
from hingepair.mechanism.kinds import JointKind
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.tree import BASE_KINDS, Frame, Joint, Tree
from hingepair.numeric.arrays import Float64Array, check_choice, finite_number, read_only
from hingepair.numeric.blocks import versine
from hingepair.urdf.reader import sine_and_cosine
from hingepair.urdf.records import MimicRecord
from hingepair.urdf.rigid import IDENTITY_POSE, ZERO_MASS_PROPERTIES, FramePose, MassProperties, combined_masses

_ANY_AXIS = read_only(np.array((0.0, 0.0, 1.0)))  # of a joint that does not move
JointRule: TypeAlias = float | MimicRecord | None
"""How a joint moves: the position at which it is held, the joint that it follows, or None if by itself."""


def written_joint(
    name: str,
    kind: JointKind,
    parent: int,
    pose: FramePose,
    axis: Float64Array | None = None,
    body: MassProperties = ZERO_MASS_PROPERTIES,
    limits: tuple[float, float] | None = None,
    effort_limit: float | None = None,
    rate_limit: float | None = None,
    **fields: Any,
) -> Joint:
    """Return a joint as files have it: `pose` is that of its body in the parent's axes, None stands for no limit, and
    `fields` are further ones of `Joint`.
    """
    lower, upper = limits or (-np.inf, np.inf)
    return Joint(
        name, kind, parent, pose.origin, pose.rotation, _ANY_AXIS if axis is None else axis, body,
        position_limits=(limit_or_infinity(lower), limit_or_infinity(upper)),
        effort_limit=np.inf if effort_limit is None else effort_limit,
        rate_limit=np.inf if rate_limit is None else rate_limit,
        **fields,
    )  # fmt: skip


def framed(body: int, pose: FramePose = IDENTITY_POSE) -> Frame:
    """Return a pose in the axes of a body as a Frame."""
    return Frame(body, read_only(pose.origin + 0.0), read_only(pose.rotation + 0.0))


def fold(tree: Tree, locked: Mapping[str, float] | None = None) -> Tree:
    """Return the tree of the joints that move, where fixed and locked joints merge bodies.

    Args:
        tree: joints of any kind, depth-first; their names are unique.
        locked: positions [rad or m] of the joints to lock, by name.
    """
    positions = _locked_positions(tree, locked)
    for joint in tree.joints:
        (least, most), unit = joint.position_limits, joint.unit
        position = positions.get(joint.name, least)
        if not least <= position <= most:
            limits = f"{least:g} to {most:g} {unit}"
            warn_of_dynamics(f"locked: {joint.name!r} is held at {position:g} {unit}, beyond its limits, {limits}")
    rules = _joint_rules(tree, positions)
    moving = [joint for joint in tree.joints if not isinstance(rules[joint.name], float)]
    numbers = {joint.name: number for number, joint in enumerate(moving, 1)}
    with np.errstate(all="ignore"):  # numbers that overflow are refused
        places = [(0, IDENTITY_POSE)]  # of each body: the one into which it is merged, and its pose in that
        for joint in tree.joints:
            rule = rules[joint.name]
            if isinstance(rule, float):
                body, pose = places[joint.parent]
                places.append((body, pose.placed(joint.pose.placed(displaced(joint, rule)))))
            else:
                places.append((numbers[joint.name], IDENTITY_POSE))

        def merged(label: str, frame: Frame) -> Frame:
            body, pose = places[frame.body]
            found = framed(body, pose.placed(frame.pose))
            if not (np.isfinite(found.R).all() and np.isfinite(found.S).all()):
                raise ArgumentError(label, "a position that does not overflow", "numbers that overflow")
            return found

        members: list[list[tuple[int, FramePose]]] = [[] for _ in range(len(moving) + 1)]
        for k, (body, pose) in enumerate(places):
            members[body].append((k, pose))
        given, names, drawn = tree.bodies, tree.body_names, tree.drawings or (NOT_DRAWN,) * len(places)
        base, *bodies = (
            mass_properties(f"the body of {names[own[0][0]]!r}", [given[k].placed(pose) for k, pose in own])
            for own in members
        )
        joints = []
        for joint, masses in zip(moving, bodies, strict=True):
            seat, rule = merged(f"joint {joint.name!r}", Frame(joint.parent, joint.u, joint.S)), rules[joint.name]
            follows = rule if isinstance(rule, MimicRecord) else None
            n = read_only(joint.n + 0.0)
            joints.append(replace(joint, parent=seat.body, u=seat.R, S=seat.S, n=n, body=masses, mimic=follows))
        held = {joint.name: framed(k) for k, joint in enumerate(tree.joints, 1) if joint.name not in numbers}
        return replace(
            tree,
            joints=tuple(joints),
            base=base,
            links={name: merged(f"link {name!r}", frame) for name, frame in tree.links.items()},
            frames={name: merged(f"frame {name!r}", frame) for name, frame in {**held, **tree.frames}.items()},
            assumed=tuple((places[k][0], note) for k, note in tree.assumed),
            drawings=tuple(body_drawing([(drawn[k], pose) for k, pose in own]) for own in members),
            source=tree.source and tree.source._replace(locked={**tree.source.locked, **positions}),
            without_mass={places[k][0]: link for k, link in tree.without_mass.items()},
        )


def chosen_base(base: str | None, own: str) -> str:
    """Return the argument `base`, by default the kind of base that a model has itself."""
    if base is not None:
        check_choice("base", base, BASE_KINDS)
    return own if base is None else base


def _locked_positions(tree: Tree, locked: Mapping[str, float] | None) -> dict[str, float]:
    """Return the argument `locked` as numbers."""
    if not isinstance(locked, Mapping | None):
        raise ArgumentError("locked", "positions by the joint's name", quoted(locked))
    by_name = {joint.name: joint for joint in tree.joints if joint.kind != "fixed"}
    for name in locked or ():
        if name not in by_name:
            known = choices(list(by_name)) + nearest(str(name), by_name)
            raise ArgumentError("locked", known if by_name else "no joint, since none moves", quoted(name))
    positions = {name: finite_number(f"locked, {name!r}", value) for name, value in (locked or {}).items()}
    for name in positions:
        leader = by_name[name].rule.leader
        if leader in by_name and leader not in positions:
            raise ArgumentError("locked", f"{leader!r}, which it follows, beside it", quoted(name))
    return positions


def _joint_rules(tree: Tree, positions: Mapping[str, float]) -> dict[str, JointRule]:
    """Return by name how each joint moves; a follower of a follower follows the last leader of its chain."""
    by_name = {joint.name: joint for joint in tree.joints}

    def rule(joint: Joint) -> JointRule:
        multiplier, offset, followers = 1.0, 0.0, {joint.name}
        while True:
            if joint.name in positions or joint.kind == "fixed":
                return multiplier * positions.get(joint.name, 0.0) + offset
            if joint.mimic is None:
                return MimicRecord(joint.name, multiplier, offset) if len(followers) > 1 else None
            leader, where = joint.mimic.leader, f"joint {joint.name!r}, mimic"
            if leader in followers:
                raise ArgumentError(where, "a joint that does not follow this one", quoted(leader))
            offset += multiplier * joint.mimic.offset
            multiplier *= joint.mimic.multiplier
            followers.add(leader)
            joint = by_name[leader]

    return {joint.name: rule(joint) for joint in tree.joints}


def displaced(joint: Joint, position: float) -> FramePose:
    """Return the pose of the body of a joint at a position [rad or m], in the axes that it has at position 0."""
    if position == 0:
        return IDENTITY_POSE
    axis, turn = joint.axis, np.eye(3)
    if axis.turns:
        sine, cosine = sine_and_cosine(axis.turn(position))
        turn = np.array(hinge_rotation(tuple(joint.n.tolist()), (sine, versine(sine, cosine)))).reshape(3, 3)
    return FramePose(turn, joint.n * axis.shift(position))


def warn_of_gravity(gravity: Float64Array) -> None:
    """Issue a DynamicsWarning unless the gravity of a model is what methods take by default."""
    if not np.array_equal(gravity, DEFAULT_GRAVITY):
        warn_of_dynamics(f"the model's gravity {gravity.tolist()} is not the robot's: methods take gravity=")


def limit_or_infinity(value: float) -> float:
    """Return a limit, and infinity for the largest float, by which URDF and Pinocchio mark a missing one."""
    return math.copysign(math.inf, value) if abs(value) >= sys.float_info.max else float(value)


def effort_fields(lower: float, upper: float) -> dict[str, Any]:
    """Return the fields of a `Joint` that hold bounds of an effort."""
    lower, upper = limit_or_infinity(lower), limit_or_infinity(upper)
    largest = max(abs(lower), abs(upper))
    return {"effort_limit": largest, "effort_range": None if lower == -upper else (lower, upper)}


def mass_properties(label: str, bodies: Iterable[MassProperties]) -> MassProperties:
    """Return the sum of mass properties in the axes of one body, which the label names; refuse an overflow."""
    heavy = [body for body in bodies if body.mass or body.inertia.any()]
    if not heavy:
        return ZERO_MASS_PROPERTIES
    total = combined_masses(heavy)
    if not np.isfinite([total.mass, *total.centre_of_mass, *total.inertia.ravel()]).all():
        raise ArgumentError(label, "mass properties that do not overflow", "numbers that overflow")
    symmetric = (total.inertia + total.inertia.T) / 2
    return MassProperties(total.mass, read_only(total.centre_of_mass), read_only(symmetric))
