"""A robot written as URDF.

Each body is the link at its joint's point, which has the body's mass, and the other links, which fixed joints hold to
it. Joints stand in the order of q, which is that of their names on every link: where names would give another order,
they hang on links of their own, whose fixed joints have numbers for names.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from hingepair.errors import URDFError
from hingepair.formats.shape_writers import add_shape, drawing_of_body, unread_sentences
from hingepair.formats.xml_text import (
    add_element,
    add_inertial,
    add_urdf_joint,
    axis_for_urdf,
    check_xml_text,
    document,
    first_few,
)
from hingepair.mechanism.bodies.body import warn_of_dynamics
from hingepair.mechanism.bodies.shapes import Mesh
from hingepair.mechanism.joints import KINDS
from hingepair.mechanism.tree import Frame, Joint, Tree, unused_name
from hingepair.rotations.euler import matrix_to_euler
from hingepair.urdf.rigid import FramePose, MassProperties


def robot_to_urdf(
    tree: Tree,
    base: str = "free",
    *,
    meshes: bool = True,
    pose: FramePose | None = None,
    sentences: Sequence[str] = (),
) -> str:
    """Return a robot as URDF text, with its meshes or without; see `to_urdf`. `pose` is that of a fixed base, and
    `sentences` begin the comment.
    """
    for name in (tree.name, *tree.links, *tree.frames, *(joint.name for joint in tree.joints)):
        check_xml_text("name", name)
    geared = [joint.name for joint in tree.joints if joint.armature]
    sprung = [joint.name for joint in tree.joints if joint.load.stiffness]
    for part, written, joints in (("inertias of rotors", "armatures", geared), ("springs", "springs", sprung)):
        if joints:
            warn_of_dynamics(f"{tree.name}: URDF has no {part}; not written are the {written} of {', '.join(joints)}")
    writer = _UrdfWriter(tree, meshes)
    root = writer.build(base, pose)
    made_up = "; ".join(f"{phrase} of {first_few(names)}" for phrase, names in writer.made_up_limits.items())
    limits = [f"limits that URDF demands and that are not given are made up: {made_up}"] if made_up else []
    return document(root, [*sentences, *limits, *unread_sentences(tree)])


_DEFAULT_LIMITS = {"effort": 1000.0, "velocity": 100.0}  # [N m or N] and [rad/s or m/s]; they stop nothing


class _UrdfWriter:
    """Builder of the URDF elements of a robot."""

    def __init__(self, tree: Tree, meshes: bool) -> None:
        self._tree = tree
        self._meshes = meshes  # whether they are written
        # Names that are made up differ from all that are there.
        self._links = {*tree.links, *tree.frames}
        self._joints = {*tree.frames, *(joint.name for joint in tree.joints)}
        self.made_up_limits: dict[str, list[str]] = {}  # names of joints by what URDF demands of them

    def build(self, base: str, pose: FramePose | None) -> ET.Element:
        """Return the element <robot>; a joint of the type `base`, unless "free", holds the root to a link `world`."""
        tree = self._tree
        root = ET.Element("robot", {"name": tree.name})
        add_element(add_element(root, "mujoco"), "compiler", fusestatic="false", discardvisual="false")
        seats = [self._add_body(root, number, masses) for number, masses in enumerate(tree.bodies)]
        for number, seat in enumerate(seats):
            carried = [(joint, seats[k]) for k, joint in enumerate(tree.joints, 1) if joint.parent == number]
            names = [joint.name for joint, _ in carried]
            for place, (joint, child) in enumerate(carried):
                parent = seat if names == sorted(names) else self._add_carrier(root, seat, place, joint.name)
                self._add_moving_joint(root, joint, parent, child)
        if base != "free":
            world = unused_name("world", self._links)
            add_element(root, "link", name=world)
            to_base = add_urdf_joint(root, unused_name("base", self._joints), base, world, seats[0])
            if pose is not None:
                add_element(to_base, "origin", xyz=pose.origin, rpy=matrix_to_euler(pose.rotation, "xyz"))
        return root

    def _add_body(self, root: ET.Element, body_number: int, masses: MassProperties) -> str:
        """Add the links of a body, and return the name of that at the body's joint, which has its mass."""
        tree = self._tree
        links = {name: frame for name, frame in tree.links.items() if frame.body == body_number}
        frames = {name: frame for name, frame in tree.frames.items() if frame.body == body_number}
        seat = next((name for name, frame in links.items() if is_here(frame)), None)
        if seat is None:
            carrier = tree.joints[body_number - 1].name if body_number else "base"
            seat = unused_name(f"{carrier}_at_joint", self._links)
        link = add_element(root, "link", name=seat)
        if masses.mass or masses.inertia.any():
            add_inertial(link, masses.mass, masses.centre_of_mass, masses.inertia)
        drawing = drawing_of_body(tree, body_number)
        for tag, shapes in (("visual", drawing.visuals), ("collision", drawing.collisions)):
            for shape in shapes:
                if self._meshes or not isinstance(shape, Mesh):
                    add_shape(link, shape, tag, drawing.colour)
        for name, frame in links.items():
            if name == seat:
                continue
            held_by = next((joint for joint, other in frames.items() if _is_same_frame(frame, other)), None)
            frames.pop(held_by or "", None)
            self._add_fixed_link(root, held_by or unused_name(f"{name}_fixed", self._joints), seat, name, frame)
        for name, frame in frames.items():
            if name not in tree.links:
                self._add_fixed_link(root, unused_name(f"{name}_frame", self._joints), seat, name, frame)
        return seat

    def _add_fixed_link(self, root: ET.Element, joint: str, parent: str, link: str, frame: Frame) -> None:
        add_element(root, "link", name=link)
        element = add_urdf_joint(root, joint, "fixed", parent, link)
        add_element(element, "origin", xyz=frame.R, rpy=matrix_to_euler(frame.S, "xyz"))

    def _add_carrier(self, root: ET.Element, parent_link: str, order: int, joint_name: str) -> str:
        """Return an added link for one joint; the number in the name of its fixed joint sorts siblings."""
        held_by = unused_name(f"{order:04d}_{joint_name}", self._joints)
        link = unused_name(f"{held_by}_carrier", self._links)
        add_element(root, "link", name=link)
        add_urdf_joint(root, held_by, "fixed", parent_link, link)
        return link

    def _add_moving_joint(self, root: ET.Element, joint: Joint, parent: str, child: str) -> None:
        """Add a joint; refuse one that URDF does not have."""
        kind = KINDS[joint.kind].urdf
        if kind is None:
            raise URDFError("robot", "joints that URDF has", f"{joint.name!r}, a {joint.kind}")
        bounded = bool(np.isfinite(joint.position_limits).any())
        if kind == "revolute" and not bounded:
            kind = "continuous"
        element = add_urdf_joint(root, joint.name, kind, parent, child)
        add_element(element, "origin", xyz=joint.u, rpy=matrix_to_euler(joint.S, "xyz"))
        add_element(element, "axis", xyz=axis_for_urdf(joint.n))
        given = {"effort": joint.effort_limit, "velocity": joint.rate_limit}
        if kind != "continuous" or np.isfinite([*given.values()]).any():
            limit = {key: _DEFAULT_LIMITS[key] if np.isinf(value) else value for key, value in given.items()}
            if phrase := " and ".join(f"{key} {value:g}" for key, value in limit.items() if value != given[key]):
                self.made_up_limits.setdefault(phrase, []).append(joint.name)
            if bounded or kind == "prismatic":  # without numbers, readers hold a slider at 0; infinity is the largest
                limits = np.nan_to_num(joint.position_limits).tolist()
                limit = dict(zip(("lower", "upper"), limits, strict=True)) | limit
            add_element(element, "limit", **limit)
        if joint.load.damping or joint.load.friction:
            add_element(element, "dynamics", damping=joint.load.damping, friction=joint.load.friction)
        if joint.mimic is not None:
            leader = self._tree.joints[joint.mimic.leader - 1].name
            add_element(element, "mimic", joint=leader, multiplier=joint.mimic.multiplier, offset=joint.mimic.offset)


def is_here(frame: Frame) -> bool:
    """Return whether a frame is the frame at the joint of its body."""
    return not frame.R.any() and bool((np.eye(3) == frame.S).all())


def _is_same_frame(frame: Frame, other_frame: Frame) -> bool:
    return np.array_equal(frame.R, other_frame.R) and np.array_equal(frame.S, other_frame.S)
