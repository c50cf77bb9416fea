"""Copies of a robot's tree with payloads, frames, loads or locked joints; its joints as pairs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, quoted, warn_of_dynamics
from hingepair.mechanism.bodies.body import Body, moments_of
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.bodies.shapes import placed_shapes
from hingepair.mechanism.building.folding import mass_properties
from hingepair.mechanism.joints import JOINT_CLASSES, RobotJoint
from hingepair.mechanism.kinds import KINDS, JointKind
from hingepair.mechanism.robots.samples import Payload, Samples
from hingepair.mechanism.tree import LOAD_FIELDS, NO_LOAD, Frame, Joint, Tree, check_name, unphysical_reason
from hingepair.numeric.arrays import (
    check_choice,
    finite_number,
    number_not_below_0,
    one_constant,
    read_only,
    real_array,
)
from hingepair.rotations.matrices import check_rotation
from hingepair.urdf.rigid import IDENTITY_POSE, ZERO_MASS_PROPERTIES, FramePose, MassProperties


def pair_of(
    tree: Tree,
    number: int,
    ends: tuple[FramePose, FramePose] = (IDENTITY_POSE, IDENTITY_POSE),
) -> RobotJoint:
    """Return joint `number` of a tree as a pair, whose frames are `ends` in the axes of the tree's bodies. A body is
    None without mass and, with a DynamicsWarning, where no rigid body has its mass properties.
    """
    joint = tree.single().joints[number - 1]
    seat = ends[0].seen(joint.pose)
    limits: dict[str, Any] = {
        "limits": joint.position_limits,
        "torque_limit": joint.effort_limit,
        "rate_limit": joint.rate_limit,
    }
    options = {key: value for key, value in limits.items() if np.isfinite(value).all()}
    for k, body in enumerate((joint.parent, number)):
        end, masses, label = ends[k].seen(IDENTITY_POSE), tree.bodies[body], f"body{k + 1}"
        if masses.mass and (reason := unphysical_reason(masses)):
            message = (
                f"{label} of {joint.name!r}: no rigid body has its mass properties, which are left out: {reason}"
            )
            warn_of_dynamics(message)
        elif masses.mass:
            shapes = placed_shapes((tree.drawings[body].shapes if tree.drawings else ()) or (), end)
            masses = masses.placed(end)
            options[label] = Body(masses.mass, masses.centre_of_mass, masses.inertia, shapes)
    if KINDS[joint.kind].has_pitch:
        options["pitch"] = joint.pitch
    made: Any = JOINT_CLASSES[joint.kind]
    with np.errstate(all="ignore"):
        n, home = seat.rotation @ joint.n + 0.0, seat.placed(ends[1]).rotation + 0.0
    u2 = ends[1].seen(IDENTITY_POSE).origin + 0.0
    pair: RobotJoint = made(seat.origin + 0.0, u2, n, home=home, name=joint.name, **options)
    return pair


def add_body(tree: Tree, link: str, body: Body | None) -> Tree:
    """Return a copy of a tree with a Body fixed to the frame `link`, and with notes on its assumed masses."""
    frame = tree.known_frame("link", link)
    if not isinstance(body, Body):
        raise ArgumentError("body", "a Body", quoted(body))
    tree = add_payload(tree, link, Payload(np.array(body.mass), body.centre_of_mass, body.inertia))
    assumed = ((frame.body, f"payload of {link}: {note}") for note in body.assumed)
    drawings = list(tree.drawings)
    drawings[frame.body] = drawings[frame.body].with_shapes(placed_shapes(body.shapes, frame.pose))
    return replace(tree, assumed=(*tree.assumed, *assumed), drawings=tuple(drawings))


def set_loads(tree: Tree, loads: Mapping[str, HingeLoad]) -> Tree:
    """Return a copy of a tree in which joints, by name, have other loads."""
    if not isinstance(loads, Mapping):
        raise ArgumentError("loads", "HingeLoads by the joint's name", quoted(loads))
    names = [joint.name for joint in tree.joints]
    for name, load in loads.items():
        check_choice("loads", name, names)
        if not isinstance(load, HingeLoad):
            raise ArgumentError(f"loads[{name!r}]", "a HingeLoad", quoted(load))
        if load != replace(NO_LOAD, stops=load.stops, **{field: getattr(load, field) for field in LOAD_FIELDS}):
            expected = "stiffness, rest, damping, friction and stops alone, which joints of a robot have"
            raise ArgumentError(f"loads[{name!r}]", expected, quoted(load))
    joints = {joint.name: joint for joint in tree.joints}
    for name, load in loads.items():
        limits = load.stops or joints[name].position_limits
        joints[name] = replace(joints[name], load=replace(load, stops=None), position_limits=limits)
    return replace(tree, joints=tuple(joints.values()), source=None)


def set_motor(tree: Tree, name: str, armature: float, ratio: float | None) -> Tree:
    """Return a copy of a tree in which a joint has a motor with a rotor of inertia `armature` behind a gear."""
    names = [joint.name for joint in tree.joints]
    check_choice("joint", name, names)
    number = names.index(name)
    turns = tree.joints[number].ratio if ratio is None else finite_number("ratio", ratio)
    if not turns:
        raise ArgumentError("ratio", "a number other than 0", ratio)
    inertia = number_not_below_0("armature", armature) * turns * turns
    joints = list(tree.joints)
    joints[number] = replace(joints[number], armature=inertia, ratio=turns)
    return replace(tree, joints=tuple(joints), source=None)


def add_payload(tree: Tree, link: str, payload: Payload) -> Tree:
    """Return a copy of a tree with a Payload fixed to the frame `link`, as samples where it has leading axes."""
    frame = tree.known_frame("link", link)
    number, tree = frame.body, replace(tree, source=None)
    if payload.shape or frame.samples is not None:
        matter = moments_of(payload, frame.origin, frame.S)
        return replace(tree, samples=(tree.samples or Samples()).with_matter(number, matter))
    single = MassProperties(float(payload.mass), payload.centre_of_mass, payload.inertia).placed(frame.pose)
    total = mass_properties(f"payload of {link}", (tree.bodies[number], single))
    joints = list(tree.joints)
    if number:
        joints[number - 1] = replace(joints[number - 1], body=total)
    without_mass = {body: name for body, name in tree.without_mass.items() if body != number}
    return replace(tree, base=tree.base if number else total, joints=tuple(joints), without_mass=without_mass)


def add_frame(tree: Tree, name: str, frame: Frame, R: ArrayLike, S: ArrayLike | None) -> Tree:
    """Return a copy of a tree with a frame that has origin R [m], (..., 3), and rotation S in another, `frame`."""
    check_name("name", name)
    if tree.frame(name) is not None:
        raise ArgumentError("name", "a name that no link, joint or frame has", quoted(name))
    turn = one_constant("S", np.eye(3) if S is None else S, 3, 3)
    check_rotation("S", turn)
    positions = np.asarray(real_array("R", R), np.float64)
    if positions.ndim <= 1:
        positions = one_constant("R", R, 3)
    elif positions.shape[-1] != 3 or not positions.size or not np.isfinite(positions).all():
        raise ArgumentError("R", "finite positions of shape (..., 3)", f"shape {positions.shape}")
    pose = frame.pose.placed(FramePose(turn, positions.reshape(-1, 3)[0]))
    added = Frame(frame.body, read_only(pose.origin), read_only(pose.rotation))
    if positions.ndim == 1 and frame.samples is None:
        return replace(tree, frames={**tree.frames, name: added})
    added = replace(added, samples=read_only(frame.origin + positions @ frame.S.T))
    samples = (tree.samples or Samples()).with_joints({}, [added.origin])
    return replace(tree, frames={**tree.frames, name: added}, samples=samples, source=None)


# ---- a free base as six joints, for searches that move it

BASE_JOINTS = 6
"""Joints of a base: sliders along x, y and z, then hinges about x, y and z, in the axes in which it starts."""


def tree_with_base_joints(tree: Tree) -> Tree:
    """Return a robot whose base moves by `BASE_JOINTS` coordinates, which stand before its own."""
    zero, axes = read_only(np.zeros(3)), np.eye(3)
    kinds: tuple[JointKind, ...] = ("slider", "slider", "slider", "hinge", "hinge", "hinge")
    base = [
        Joint(
            f"base {kind} {'xyz'[k % 3]}", kind, k, zero, read_only(axes), read_only(axes[k % 3]),
            tree.base if k == BASE_JOINTS - 1 else ZERO_MASS_PROPERTIES,
        )
        for k, kind in enumerate(kinds)
    ]  # fmt: skip
    joints = [replace(joint, parent=joint.parent + BASE_JOINTS) for joint in tree.plain().joints]
    links, frames = (
        {name: on_moved_base(frame) for name, frame in group.items()} for group in (tree.links, tree.frames)
    )
    return Tree(tree.name, (*base, *joints), ZERO_MASS_PROPERTIES, links, frames, tree.leaves)


def on_moved_base(frame: Frame) -> Frame:
    """Return a frame of a robot as one of the robot with joints of the base."""
    return replace(frame, body=frame.body + BASE_JOINTS)
