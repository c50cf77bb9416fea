"""Joints of every kind folded into a tree of those that move.

`JointPart` is what URDF, Pinocchio's models and pairs have in common: a joint, fixed ones included, with the body
that it carries. Fixed and locked joints are folded into the bodies that carry them, masses included.
"""

from __future__ import annotations

import math
import sys
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

import numpy as np

from hingepair.equations.spatial import hinge_rotation
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.bodies.body import Body, warn_of_dynamics
from hingepair.mechanism.bodies.shapes import NOT_DRAWN, Drawing, body_drawing
from hingepair.mechanism.joints import JointKind
from hingepair.mechanism.tree import BASE_KINDS, Frame, Joint, Mimic, Tree
from hingepair.numeric.arrays import Float64Array, check_choice, finite_number, read_only
from hingepair.numeric.blocks import versine
from hingepair.urdf import records
from hingepair.urdf.reader import sine_and_cosine
from hingepair.urdf.rigid import IDENTITY_POSE, ZERO_MASS_PROPERTIES, FramePose, MassProperties, combined_masses


@dataclass(slots=True, eq=False)
class JointPart:
    """Joint of any kind, fixed ones included, and the body that it carries, whose origin is the joint's point."""

    # The joint as it is written. Its `parent` is the number of the part that carries it; 0 is the base, a fixed part
    # without a parent (-1). Masses stand in `masses`, and the joint that it follows in `follows`.
    joint: Joint
    follows: records.MimicRecord | None = None
    links: dict[str, FramePose] = field(default_factory=dict)  # poses of the frames of the links, by name
    leaves: list[str] = field(default_factory=list)  # names of the links that carry no further link
    frames: dict[str, FramePose] = field(default_factory=dict)  # poses of further frames, by name
    masses: dict[str, MassProperties] = field(default_factory=dict)  # by the link that has them
    drawing: Drawing = NOT_DRAWN  # what the body is drawn by
    notes: list[str] = field(default_factory=list)  # sentences about assumed masses
    without_mass: list[str] = field(default_factory=list)  # its links whose mass was never given; a URDF's has 0 kg

    def add_link(self, link: str, pose: FramePose, masses: MassProperties | None, is_leaf: bool) -> None:
        """Add a link in its pose, with masses in its own axes."""
        self.links[link] = pose
        if masses is not None:
            self.masses[link] = masses.placed(pose)
        if is_leaf:
            self.leaves.append(link)

    @property
    def name(self) -> str:
        """Name of the joint."""
        return self.joint.name

    @property
    def pose(self) -> FramePose:
        """Pose of the body at position 0, in the parent's axes."""
        return FramePose(self.joint.S, self.joint.u)


def written_joint(
    name: str,
    kind: JointKind = "fixed",
    parent: int = -1,
    pose: FramePose = IDENTITY_POSE,
    axis: Float64Array | None = None,
    limits: tuple[float, float] | None = None,
    effort_limit: float | None = None,
    rate_limit: float | None = None,
    **fields: Any,
) -> Joint:
    """Return a joint as files have it: `pose` is that of its body in the parent's axes, None stands for no limit, and
    `fields` are further ones of `Joint`. By default it is the fixed part that is the base.
    """
    lower, upper = limits or (-np.inf, np.inf)
    return Joint(
        name, kind, parent, pose.origin, pose.rotation, _ANY_AXIS if axis is None else axis, ZERO_MASS_PROPERTIES,
        position_limits=(limit_or_infinity(lower), limit_or_infinity(upper)),
        effort_limit=np.inf if effort_limit is None else effort_limit,
        rate_limit=np.inf if rate_limit is None else rate_limit,
        **fields,
    )  # fmt: skip


_ANY_AXIS = read_only(np.array((0.0, 0.0, 1.0)))  # of a joint that does not move
JointRule: TypeAlias = float | records.MimicRecord | None
"""How a joint moves: the position at which it is held, the joint that it follows, or None if by itself."""


def fold_parts(name: str, parts: Sequence[JointPart], locked: Mapping[str, float] | None = None) -> Tree:
    """Return the tree of the joints that move, where fixed and locked joints merge bodies.

    Args:
        name: name of the robot.
        parts: the base, and joints depth-first; names are unique.
        locked: positions [rad or m] of the joints to lock, by name.
    """
    positions = locked_positions(parts, locked)
    for part in parts:
        (least, most), unit = part.joint.position_limits, part.joint.unit
        position = positions.get(part.name, least)
        if not least <= position <= most:
            limits = f"{least:g} to {most:g} {unit}"
            warn_of_dynamics(f"locked: {part.name!r} is held at {position:g} {unit}, beyond its limits, {limits}")
    rules = _joint_rules(parts, positions)
    moving = [part for part in parts if not isinstance(rules[part.name], float)]
    body_numbers = {part.name: number for number, part in enumerate(moving, 1)}
    with np.errstate(all="ignore"):  # numbers that overflow are refused below
        body_poses = _body_poses(parts, rules, body_numbers)
        masses: list[dict[str, MassProperties]] = [{} for _ in range(len(moving) + 1)]
        for part, (body, pose) in zip(parts, body_poses, strict=True):
            masses[body] |= {link: one.placed(pose) for link, one in part.masses.items()}
        joints = []
        for part, own in zip(moving, masses[1:], strict=True):
            (parent, carrier), rule = body_poses[part.joint.parent], rules[part.name]
            frame = _frame_in_body(f"joint {part.name!r}", parent, carrier.placed(part.pose))
            mimic = Mimic(body_numbers[rule.leader], *rule[1:]) if isinstance(rule, records.MimicRecord) else None
            n, sum_of = read_only(part.joint.n + 0.0), mass_properties(own)
            joints.append(replace(part.joint, parent=parent, u=frame.R, S=frame.S, n=n, body=sum_of, mimic=mimic))
        links, frames = _links_and_frames(parts, body_poses, body_numbers)
        base_masses = mass_properties(masses[0])
        drawn: list[list[tuple[Drawing, FramePose]]] = [[] for _ in masses]
        for part, (body, pose) in zip(parts, body_poses, strict=True):
            drawn[body].append((part.drawing, pose))
        drawings = tuple(map(body_drawing, drawn))
    ends = set(range(len(masses))) - {joint.parent for joint in joints}
    tips = [leaf for part, (body, _) in zip(parts, body_poses, strict=True) if body in ends for leaf in part.leaves]
    of_base = [*parts[0].notes, unphysical_mass_note(masses[0])]
    notes = [note for part in parts[1:] for note in part.notes] + [unphysical_mass_note(body) for body in masses[1:]]
    without_mass = {own: link for part, (own, _) in zip(parts, body_poses, strict=True) for link in part.without_mass}
    leaves = tuple(leaf for part in parts for leaf in part.leaves)
    return Tree(
        name, tuple(joints), base_masses, links, frames, tuple(tips), tuple(filter(None, notes)),
        tuple(filter(None, of_base)), drawings, without_mass=without_mass, leaves=leaves,
    )  # fmt: skip


def chosen_base(base: str | None, own: str) -> str:
    """Return the argument `base`, by default the kind of base that a model has itself."""
    if base is not None:
        check_choice("base", base, BASE_KINDS)
    return own if base is None else base


def locked_positions(parts: Sequence[JointPart], locked: Mapping[str, float] | None) -> dict[str, float]:
    """Return the argument `locked` as numbers."""
    if not isinstance(locked, Mapping | None):
        raise ArgumentError("locked", "positions by the joint's name", quoted(locked))
    by_name = {part.name: part for part in parts if part.joint.kind != "fixed"}
    for joint in locked or ():
        if joint not in by_name:
            known = choices(list(by_name)) + nearest(str(joint), by_name)
            expected = known if by_name else "no joint, since none moves"
            raise ArgumentError("locked", expected, quoted(joint))
    positions = {joint: finite_number(f"locked, {joint!r}", value) for joint, value in (locked or {}).items()}
    for joint in [*positions]:
        rule = by_name[joint].follows
        if rule is not None and rule.leader in by_name and rule.leader not in positions:
            raise ArgumentError("locked", f"{rule.leader!r}, which it follows, beside it", quoted(joint))
    return positions


def _joint_rules(parts: Sequence[JointPart], positions: Mapping[str, float]) -> dict[str, JointRule]:
    """Return by name how each joint moves; a follower of a follower follows the last leader of its chain."""
    by_name = {part.name: part for part in parts}

    def rule(part: JointPart) -> JointRule:
        multiplier, offset, followers = 1.0, 0.0, {part.name}
        while True:
            if part.name in positions or part.joint.kind == "fixed":
                return multiplier * positions.get(part.name, 0.0) + offset
            if part.follows is None:
                return records.MimicRecord(part.name, multiplier, offset) if len(followers) > 1 else None
            leader = part.follows.leader
            where = f"joint {part.name!r}, mimic"
            if leader in followers:
                raise ArgumentError(where, "a joint that does not follow this one", quoted(leader))
            offset += multiplier * part.follows.offset
            multiplier *= part.follows.multiplier
            followers.add(leader)
            part = by_name[leader]

    return {part.name: rule(part) for part in parts}


def _body_poses(
    parts: Sequence[JointPart], rules: Mapping[str, JointRule], body_numbers: Mapping[str, int]
) -> list[tuple[int, FramePose]]:
    """Return for each part the number of the body into which it is merged, and its pose in the axes of that body."""
    body_poses: list[tuple[int, FramePose]] = []
    for part in parts:
        rule = rules[part.name]
        if isinstance(rule, float):
            body, pose = body_poses[part.joint.parent] if body_poses else (0, IDENTITY_POSE)
            body_poses.append((body, pose.placed(part.pose.placed(displaced(part.joint, rule)))))
        else:
            body_poses.append((body_numbers[part.name], IDENTITY_POSE))
    return body_poses


def displaced(joint: Joint, position: float) -> FramePose:
    """Return the pose of the body of a joint at a position [rad or m], in the axes that it has at position 0."""
    if position == 0:
        return IDENTITY_POSE
    axis, turn = joint.axis, np.eye(3)
    if axis.turns:
        sine, cosine = sine_and_cosine(axis.turn(position))
        turn = np.array(hinge_rotation(tuple(joint.n.tolist()), (sine, versine(sine, cosine)))).reshape(3, 3)
    return FramePose(turn, joint.n * axis.shift(position))


def limit_or_infinity(value: float) -> float:
    """Return a limit, and infinity for the largest float, by which URDF and Pinocchio mark a missing one."""
    return math.copysign(math.inf, value) if abs(value) >= sys.float_info.max else float(value)


def effort_fields(lower: float, upper: float) -> dict[str, Any]:
    """Return the fields of a `Joint` that hold bounds of an effort."""
    lower, upper = limit_or_infinity(lower), limit_or_infinity(upper)
    largest = max(abs(lower), abs(upper))
    return {"effort_limit": largest, "effort_range": None if lower == -upper else (lower, upper)}


def _links_and_frames(
    parts: Sequence[JointPart], body_poses: Sequence[tuple[int, FramePose]], body_numbers: Mapping[str, int]
) -> tuple[dict[str, Frame], dict[str, Frame]]:
    """Return the frames of links, and further frames: of fixed and locked joints, and those that parts list."""
    links: dict[str, Frame] = {}
    frames: dict[str, Frame] = {}
    for part, (body, pose) in zip(parts, body_poses, strict=True):
        if part.joint.parent >= 0 and part.name not in body_numbers:
            frames[part.name] = _frame_in_body(f"joint {part.name!r}", body, pose)
        for kind, found, inner in (("link", links, part.links), ("frame", frames, part.frames)):
            found |= {name: _frame_in_body(f"{kind} {name!r}", body, pose.placed(one)) for name, one in inner.items()}
    return links, frames


def _frame_in_body(label: str, body_number: int, pose: FramePose) -> Frame:
    """Return a pose in the axes of a body as a Frame; refuse numbers that overflow."""
    if not all(np.isfinite(values).all() for values in pose):
        raise ArgumentError(label, "a position that does not overflow", "numbers that overflow")
    return Frame(body_number, read_only(pose.origin + 0.0), read_only(pose.rotation + 0.0))


def mass_properties(bodies: Mapping[str, MassProperties]) -> MassProperties:
    """Return the sum of the mass properties of links, by name, in the axes of one body; refuse an overflow."""
    heavy = {link: body for link, body in bodies.items() if body.mass or body.inertia.any()}
    if not heavy:
        return ZERO_MASS_PROPERTIES
    total = combined_masses(heavy.values())
    if not np.isfinite([total.mass, *total.centre_of_mass, *total.inertia.ravel()]).all():
        links = ", ".join(map(repr, heavy))
        raise ArgumentError(
            f"the mass properties of {links}", "numbers whose sum does not overflow", "numbers that overflow"
        )
    symmetric = (total.inertia + total.inertia.T) / 2
    return MassProperties(total.mass, read_only(total.centre_of_mass), read_only(symmetric))


def body_masses(body: Body) -> MassProperties:
    """Return the mass properties of a Body, in the body's axes from its reference point."""
    return MassProperties(body.mass, body.centre_of_mass, body.inertia)


def unphysical_mass_note(bodies: Mapping[str, MassProperties]) -> str:
    """Return a sentence that names the links whose sum is no rigid body; "" if it is one."""
    reason = unphysical_reason(mass_properties(bodies))
    links = ", ".join(repr(link) for link, body in bodies.items() if body.mass or body.inertia.any())
    if not reason:
        return ""
    return f"no rigid body has the mass properties of {links}, which are used as they are written: {reason}"


def unphysical_reason(masses: MassProperties) -> str:
    """Return why no rigid body has these mass properties; "" if one has, or if all are 0."""
    if not masses.mass and not masses.inertia.any():
        return ""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            Body(masses.mass, masses.centre_of_mass, masses.inertia)
    except ArgumentError as error:
        return str(error)
    return ""
