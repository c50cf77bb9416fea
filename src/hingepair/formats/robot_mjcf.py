"""A robot written as MJCF: each body with the links and frames that are fixed to it, joints in the order of q."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError
from hingepair.formats.robot_writer import is_here
from hingepair.formats.xml_text import add_element, check_xml_text, document
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.tree import Frame, Joint, MassProperties, Tree
from hingepair.numeric.arrays import one_constant
from hingepair.pair.body import warn_of_dynamics
from hingepair.pair.hinge_load import HingeLoad
from hingepair.rotations.matrices import matrix_to_quaternion

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
_TYPES: Final = {"hinge": "hinge", "slider": "slide"}
_FARTHEST = 1e9  # rad or m; a limit that is none beside one that is


def mjcf_joint_attributes(
    name: str, limits: tuple[float, float] | None, effort_limit: float | None, load: HingeLoad
) -> dict[str, Any]:
    """Return the attributes of a joint of MJCF for limits [rad or m; N m or N] and a load. Issue a DynamicsWarning
    for what MuJoCo refuses: equal limits, and an effort limit of 0.
    """
    attributes: dict[str, Any] = {}
    if limits and limits[0] == limits[1]:
        warn_of_dynamics(f"MJCF cannot hold equal limits, {limits[0]:g}: left out, so that {name} is not limited")
    elif limits:
        attributes["range"] = limits
    if effort_limit:
        attributes["actuatorfrcrange"] = -effort_limit, effort_limit
    elif effort_limit is not None:
        warn_of_dynamics(f"MJCF cannot hold torque_limit = 0: left out, so that the torque at {name} is not limited")
    if load.stiffness:
        attributes |= {"stiffness": load.stiffness, "springref": load.rest}
    attributes |= {"damping": load.damping} if load.damping else {}
    return attributes | ({"frictionloss": load.friction} if load.friction else {})


def robot_to_mjcf(robot: Mechanism, base: str, gravity: ArrayLike) -> str:
    """Return a Mechanism as MJCF text; `base` is "free" or "fixed".

    Raises:
        ArgumentError: a name holds a character that XML cannot, or MJCF has no such joint.
    """
    tree = robot.tree.single()
    for name in (tree.name, *tree.links, *tree.frames, *(joint.name for joint in tree.joints)):
        check_xml_text("name", name)
    root = ET.Element("mujoco", {"model": tree.name})
    add_element(root, "compiler", **MJCF_COMPILER)
    add_element(root, "option", gravity=one_constant("gravity", gravity, 3))
    world = add_element(root, "worldbody")
    bodies = [_add_body(world, tree, 0, tree.base if base == "free" else None, base == "fixed")]
    if base == "free":
        bodies[0].insert(0, ET.Element("freejoint"))
    for number, joint in enumerate(tree.joints, 1):
        bodies.append(_add_body(bodies[joint.parent], tree, number, joint.body))
        _insert_joint(bodies[number], joint)
    followers = [joint for joint in tree.joints if joint.mimic is not None]
    equality = add_element(root, "equality") if followers else root
    for joint in followers:
        if (rule := joint.mimic) is not None:
            leader, curve = tree.joints[rule.leader - 1].name, (rule.offset, rule.multiplier, 0, 0, 0)
            add_element(equality, "joint", joint1=joint.name, joint2=leader, polycoef=curve)
    return document(root)


def _add_body(
    parent: ET.Element, tree: Tree, number: int, masses: MassProperties | None, is_world: bool = False
) -> ET.Element:
    """Add the body of a joint, with the links and frames that are fixed to it. A fixed base called "world" is the
    world.
    """
    links = {name: frame for name, frame in tree.links.items() if frame.body == number}
    seat = next((name for name, frame in links.items() if is_here(frame)), None)
    joint = tree.joints[number - 1] if number else None
    pose: dict[str, Any] = {} if joint is None else _pose(joint.u, joint.S)
    name = _body_name(seat or f"{joint.name if joint else 'base'}_at_joint")
    body = parent if is_world and seat == "world" else add_element(parent, "body", name=name, **pose)
    if masses is not None and (masses.mass or masses.inertia.any()):
        J = masses.inertia
        moments = (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
        add_element(body, "inertial", pos=masses.centre_of_mass, mass=masses.mass, fullinertia=moments)
    for name, frame in links.items():
        if name != seat:
            add_element(body, "body", name=_body_name(name), **_pose_of(frame))
    for name, frame in tree.frames.items():
        if frame.body == number and name not in tree.links:
            add_element(body, "site", name=name, **_pose_of(frame))
    return body


def _body_name(link: str) -> str:
    return "world_link" if link == "world" else link  # MuJoCo's own body has this name


def _insert_joint(body: ET.Element, joint: Joint) -> None:
    if joint.kind not in _TYPES:
        raise ArgumentError("robot", "joints that MJCF has", f"{joint.name!r}, a {joint.kind}")
    limits = None
    if np.isfinite(joint.position_limits).any():
        lower, upper = np.clip(joint.position_limits, -_FARTHEST, _FARTHEST).tolist()
        limits = lower, upper
    effort = joint.effort_limit if np.isfinite(joint.effort_limit) else None
    attributes = mjcf_joint_attributes(f"joint {joint.name!r}", limits, effort, joint.load)
    attributes |= {"armature": joint.armature} if joint.armature else {}
    element = add_element(body, "joint", name=joint.name, type=_TYPES[joint.kind], axis=joint.n, **attributes)
    body.remove(element)
    body.insert(0, element)


def _pose_of(frame: Frame) -> dict[str, Any]:
    return _pose(frame.R, frame.S)


def _pose(origin: Any, S: Any) -> dict[str, Any]:
    return {"pos": origin, "quat": matrix_to_quaternion(S)}
