"""A robot written as MJCF: each body with the links and frames that are fixed to it, joints in the order of q."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError
from hingepair.formats.mjcf_meshes import MjcfMeshes
from hingepair.formats.robot_writer import is_here
from hingepair.formats.shape_writers import unread_sentences
from hingepair.formats.xml_text import add_element, check_xml_text, document, first_few
from hingepair.mechanism.bodies.body import warn_of_dynamics
from hingepair.mechanism.tree import Joint, Tree
from hingepair.numeric.arrays import one_constant
from hingepair.rotations.matrices import matrix_to_quaternion
from hingepair.urdf.rigid import IDENTITY_POSE, FramePose, MassProperties

# Nothing is left to the compiler's judgement: masses are those written, and fixed bodies stay bodies.
MJCF_COMPILER: Final = {
    "angle": "radian",
    "autolimits": "true",
    "inertiafromgeom": "false",
    "balanceinertia": "false",
    "boundmass": "0",
    "boundinertia": "0",
    "fusestatic": "false",
}
_TYPES: Final = {"hinge": "hinge", "slider": "slide"}  # MuJoCo's, by our kind of joint
_LEAST_MASS, _LEAST_MOMENT = 1e-15, 1e-14  # kg and kg m^2; less is 0 to MuJoCo
_FARTHEST = 1e9  # rad or m; written for a missing limit beside a given one


def robot_to_mjcf(
    tree: Tree,
    base: str,
    gravity: ArrayLike,
    *,
    meshes: bool = True,
    pose: FramePose | None = None,
    base_joint: str = "",
    sentences: Sequence[str] = (),
) -> str:
    """Return a robot as MJCF text, with its meshes or without.

    Args:
        tree: the robot.
        base: "free", "pinned" or "fixed".
        gravity: acceleration of free fall [m/s^2]; shape (3,).
        meshes: whether they are written.
        pose: of the base at the start; by default at the origin.
        base_joint: name of the joint of a base that moves.
        sentences: what the comment begins with.
    """
    for name in (tree.name, *tree.links, *tree.frames, *(joint.name for joint in tree.joints)):
        check_xml_text("name", name)
    root = ET.Element("mujoco", {"model": tree.name})
    add_element(root, "compiler", **MJCF_COMPILER)
    add_element(root, "option", gravity=one_constant("gravity", gravity, 3))
    drawn = MjcfMeshes(tree, wanted=meshes)
    drawn.add_assets(root)
    world = add_element(root, "worldbody")
    moves = base != "fixed"
    bodies = [_add_body(world, tree, 0, tree.base if moves else None, drawn, pose, is_world=not moves)]
    if moves:
        tag, kind = ("freejoint", {}) if base == "free" else ("joint", {"type": "ball"})
        bodies[0].insert(0, ET.Element(tag, {"name": base_joint, **kind} if base_joint else kind))
    chains: dict[int, list[Joint]] = {}  # joints whose bodies are left to the next one
    for number, joint in enumerate(tree.joints, 1):
        chain = [*chains.get(joint.parent, ()), joint]
        if _is_between_joints(tree, number):
            chains[number] = chain
            bodies.append(bodies[joint.parent])
            continue
        seats = _poses_in_last_body(chain)
        bodies.append(_add_body(bodies[joint.parent], tree, number, joint.body, drawn, seats[0]))
        for one, seat in zip(reversed(chain), reversed(seats[1:]), strict=True):
            insert_mjcf_joint(bodies[number], one, f"joint {one.name!r}", seat)
    equality = ET.Element("equality")
    for joint in tree.joints:
        if (rule := joint.mimic) is not None:
            leader, curve = tree.joints[rule.leader - 1].name, (rule.offset, rule.multiplier, 0, 0, 0)
            add_element(equality, "joint", joint1=joint.name, joint2=leader, polycoef=curve)
    if len(equality):
        root.append(equality)
    masses = _mass_sentences(tree, bodies, moves=moves)
    return document(root, [*sentences, *masses, *drawn.sentences, *unread_sentences(tree)])


def _is_between_joints(tree: Tree, number: int) -> bool:
    """Return whether a body is nothing but the place between two joints, which MJCF has as joints of one body."""
    masses = tree.joints[number - 1].body
    carried = [joint for joint in tree.joints if joint.parent == number]
    frames = (*tree.links.values(), *tree.frames.values())
    named = any(frame.body == number for frame in frames)
    drawn = bool(tree.drawings) and bool(tree.drawings[number].shapes)
    return len(carried) == 1 and not (masses.mass or masses.inertia.any() or named or drawn)


def _poses_in_last_body(chain: list[Joint]) -> list[FramePose]:
    """Return the pose of the last body of a chain of joints in what carries the first, and the poses of the joints,
    whose axes are those of the bodies behind them, in the last body.
    """
    seats = [IDENTITY_POSE]
    for joint in chain:
        seats.append(seats[-1].placed(FramePose(np.array(joint.S), np.array(joint.u))))
    last = seats[-1]
    return [last, *(IDENTITY_POSE if seat is last else last.seen(seat) for seat in seats[1:])]


def _mass_sentences(tree: Tree, bodies: list[ET.Element], *, moves: bool) -> list[str]:
    """Return a sentence, if any, on the moving bodies that MuJoCo refuses for their masses."""
    masses = tree.bodies
    moving = [
        (bodies[k], masses[k]) for k in range(not moves, len(bodies)) if not (k and _is_between_joints(tree, k))
    ]
    refused = [body.get("name", "") for body, one in moving if not _has_mass(one)]
    if not refused:
        return []
    need = "moving bodies need a mass, and an inertia that a rigid body can have"
    return [f"{tree.name}: MuJoCo refuses this model: {need}; these have none: {first_few(refused)}"]


def _has_mass(masses: MassProperties) -> bool:
    least, middle, largest = map(float, np.linalg.eigvalsh(masses.inertia))
    return masses.mass >= _LEAST_MASS and least >= _LEAST_MOMENT and least + middle >= largest


def _add_body(
    parent: ET.Element,
    tree: Tree,
    number: int,
    masses: MassProperties | None,
    drawn: MjcfMeshes,
    place: FramePose | None = None,
    *,
    is_world: bool = False,
) -> ET.Element:
    """Return the added body behind a joint (number 0: the base), at a place in the parent; a fixed base called
    "world" is the parent itself.
    """
    links = {name: frame for name, frame in tree.links.items() if frame.body == number}
    seat = next((name for name, frame in links.items() if is_here(frame)), None)
    joint = tree.joints[number - 1] if number else None
    pose: dict[str, Any] = {} if place is None else _pose(place.origin, place.rotation)
    name = _body_name(seat or f"{joint.name if joint else 'base'}_at_joint")
    body = parent if is_world and seat == "world" else add_element(parent, "body", name=name, **pose)
    if masses is not None and (masses.mass or masses.inertia.any()):
        J = masses.inertia
        moments = (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
        add_element(body, "inertial", pos=masses.centre_of_mass, mass=masses.mass, fullinertia=moments)
    drawn.add_geoms(body, number)
    for name, frame in links.items():
        if name != seat:
            add_element(body, "body", name=_body_name(name), **_pose(frame.R, frame.S))
    for name, frame in tree.frames.items():
        if frame.body == number and name not in tree.links:
            add_element(body, "site", name=name, **_pose(frame.R, frame.S))
    return body


def _body_name(link: str) -> str:
    return "world_link" if link == "world" else link  # MuJoCo's own body has this name


def insert_mjcf_joint(body: ET.Element, joint: Joint, label: str, seat: FramePose = IDENTITY_POSE) -> None:
    """Insert a joint, which has the pose `seat` in its body, as the first child of the body. Warn of what MuJoCo
    refuses, under the name `label`: equal limits, and an effort limit of 0; they are left out.

    Raises:
        ArgumentError: MJCF has no such joint.
    """
    if joint.kind not in _TYPES:
        raise ArgumentError("robot", "joints that MJCF has", f"{joint.name!r}, a {joint.kind}")
    attributes: dict[str, Any] = {"type": _TYPES[joint.kind], "axis": seat.rotation @ joint.n}
    if seat.origin.any():
        attributes["pos"] = seat.origin
    lower, upper = np.clip(joint.position_limits, -_FARTHEST, _FARTHEST).tolist()
    if lower == upper:
        warn_of_dynamics(f"MJCF cannot hold equal limits, {lower:g}: left out, so that {label} is not limited")
    elif np.isfinite(joint.position_limits).any():
        attributes["range"] = lower, upper
    if joint.effort_limit == 0:
        warn_of_dynamics(f"MJCF cannot hold torque_limit = 0: left out, so that the torque at {label} is not limited")
    elif np.isfinite(joint.effort_bounds).any():
        attributes["actuatorfrcrange"] = np.clip(joint.effort_bounds, -_FARTHEST, _FARTHEST)
    load = joint.load
    if load.stiffness:
        attributes |= {"stiffness": load.stiffness, "springref": load.rest}
    written = {"damping": load.damping, "frictionloss": load.friction, "armature": joint.armature}
    attributes |= {name: value for name, value in written.items() if value}
    element = add_element(body, "joint", name=joint.name, **attributes)
    body.remove(element)
    body.insert(0, element)


def _pose(origin: Any, S: Any) -> dict[str, Any]:
    return {"pos": origin, "quat": matrix_to_quaternion(S)}
