"""A robot written as URDF.

Each body is the link at its joint's point, which has the body's mass, and the other links, which fixed joints hold to
it. Joints stand in the order of q, which is that of their names on every link: where names would give another order,
they hang on links of their own, whose fixed joints have numbers for names.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

import numpy as np

from hingepair.errors import URDFError, warn_of_dynamics
from hingepair.formats.xml_text import NO_TURN, add_element, check_names, check_xml_text, document, seat_of
from hingepair.mechanism.bodies.body import Box, Cylinder
from hingepair.mechanism.bodies.shapes import Drawing, Drawn, Mesh
from hingepair.mechanism.kinds import KINDS
from hingepair.mechanism.tree import Joint, Tree, unused_name
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.euler import matrix_to_euler
from hingepair.urdf.rigid import IDENTITY_POSE, FramePose, MassProperties

_DEFAULT_LIMITS = {"effort": 1000.0, "velocity": 100.0}  # [N m or N] and [rad/s or m/s]; they stop nothing


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
    check_names(tree)
    geared = [joint.name for joint in tree.joints if joint.armature]
    sprung = [joint.name for joint in tree.joints if joint.load.stiffness]
    for part, own, joints in (("inertias of rotors", "armatures", geared), ("springs", "springs", sprung)):
        if joints:
            warn_of_dynamics(f"{tree.name}: URDF has no {part}; not written are the {own} of {', '.join(joints)}")
    writer = _UrdfWriter(tree, meshes)
    writer.build(base, pose)
    made_up = [f"limits that URDF demands and that are not given are made up: {'; '.join(writer.made_up)}"]
    return document(writer.root, tree, [*sentences, *(made_up if writer.made_up else ())])


class _UrdfWriter:
    """Builder of the URDF elements of a robot."""

    def __init__(self, tree: Tree, meshes: bool) -> None:
        self.root = ET.Element("robot", {"name": tree.name})
        self.made_up: list[str] = []  # limits
        self._tree, self._meshes = tree, meshes
        # Names that are made up differ from all that are there.
        self._links = {*tree.links, *tree.frames}
        self._joints = {*tree.frames, *(joint.name for joint in tree.joints)}

    def build(self, base: str, pose: FramePose | None) -> None:
        """Add all elements; a joint of the type `base`, unless "free", holds the root to a link `world`."""
        tree = self._tree
        add_element(add_element(self.root, "mujoco"), "compiler", fusestatic="false", discardvisual="false")
        seats = [self._add_body(number, masses) for number, masses in enumerate(tree.bodies)]
        for number, seat in enumerate(seats):
            carried = [(joint, seats[k]) for k, joint in enumerate(tree.joints, 1) if joint.parent == number]
            names = [joint.name for joint, _ in carried]
            for place, (joint, child) in enumerate(carried):
                parent = seat
                if names != sorted(names):  # a number in the name of a fixed joint sorts siblings
                    held_by = unused_name(f"{place:04d}_{joint.name}", self._joints)
                    parent = self._add_fixed_link(held_by, seat, unused_name(f"{held_by}_carrier", self._links))
                self._add_moving_joint(joint, parent, child)
        if base != "free":
            world = unused_name("world", self._links)
            add_element(self.root, "link", name=world)
            self._add_joint(unused_name("base", self._joints), base, world, seats[0], pose or IDENTITY_POSE)

    def _add_body(self, number: int, masses: MassProperties) -> str:
        """Add the links of a body, and return the name of that at the body's joint, which has its mass."""
        tree = self._tree
        links, frames, seat = seat_of(tree, number)
        if seat is None:
            seat = unused_name(f"{tree.joints[number - 1].name if number else 'base'}_at_joint", self._links)
        link = add_element(self.root, "link", name=seat)
        if masses.mass or masses.inertia.any():
            inertial = add_element(link, "inertial")
            add_element(inertial, "origin", xyz=masses.centre_of_mass, rpy=NO_TURN)
            add_element(inertial, "mass", value=masses.mass)
            moments = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), masses.inertia[np.triu_indices(3)], strict=True)
            add_element(inertial, "inertia", **dict(moments))
        drawing = tree.drawings[number] if tree.drawings else Drawing()
        for tag, shapes in (("visual", drawing.visuals), ("collision", drawing.collisions)):
            for shape in shapes:
                if self._meshes or not isinstance(shape, Mesh):
                    _add_shape(link, shape, tag, drawing.colour)
        for name, frame in links.items():
            here = FramePose(frame.S, frame.R)
            # Fixed joints keep their names.
            same = (n for n, f in frames.items() if np.array_equal(f.R, frame.R) and np.array_equal(f.S, frame.S))
            held_by = next(same, None)
            frames.pop(held_by or "", None)
            self._add_fixed_link(held_by or unused_name(f"{name}_fixed", self._joints), seat, name, here)
        for name, frame in frames.items():
            if name not in tree.links:
                held_by = unused_name(f"{name}_frame", self._joints)
                self._add_fixed_link(held_by, seat, name, FramePose(frame.S, frame.R))
        return seat

    def _add_joint(self, name: str, kind: str, parent: str, child: str, pose: FramePose) -> ET.Element:
        joint = add_element(self.root, "joint", name=name, type=kind)
        add_element(joint, "parent", link=parent)
        add_element(joint, "child", link=child)
        if pose is not IDENTITY_POSE:
            add_element(joint, "origin", xyz=pose.origin, rpy=matrix_to_euler(pose.rotation, "xyz"))
        return joint

    def _add_fixed_link(self, joint: str, parent: str, link: str, pose: FramePose = IDENTITY_POSE) -> str:
        add_element(self.root, "link", name=link)
        self._add_joint(joint, "fixed", parent, link, pose)
        return link

    def _add_moving_joint(self, joint: Joint, parent: str, child: str) -> None:
        """Add a joint; refuse one that URDF does not have."""
        kind = KINDS[joint.kind].urdf
        if kind is None:
            raise URDFError("robot", "joints that URDF has", f"{joint.name!r}, a {joint.kind}")
        bounded = bool(np.isfinite(joint.position_limits).any())
        if kind == "revolute" and not bounded:
            kind = "continuous"
        element = self._add_joint(joint.name, kind, parent, child, FramePose(np.array(joint.S), np.array(joint.u)))
        add_element(element, "axis", xyz=_axis(joint.n))
        given = {"effort": joint.effort_limit, "velocity": joint.rate_limit}
        if kind != "continuous" or np.isfinite([*given.values()]).any():
            limit = {key: _DEFAULT_LIMITS[key] if np.isinf(value) else value for key, value in given.items()}
            if made_up := [f"{key} {limit[key]:g}" for key in limit if limit[key] != given[key]]:
                self.made_up.append(f"{' and '.join(made_up)} of {joint.name}")
            if bounded or kind == "prismatic":  # without numbers, readers hold a slider at 0; infinity is the largest
                limits = np.nan_to_num(joint.position_limits).tolist()
                limit = dict(zip(("lower", "upper"), limits, strict=True)) | limit
            add_element(element, "limit", **limit)
        if joint.load.damping or joint.load.friction:
            add_element(element, "dynamics", damping=joint.load.damping, friction=joint.load.friction)
        if (rule := joint.mimic) is not None:
            add_element(element, "mimic", joint=rule.leader, multiplier=rule.multiplier, offset=rule.offset)


def _axis(axis: Float64Array) -> Float64Array:
    """Return a unit axis; one so near x, y or z that readers would take it for that is made a little longer."""
    # Pinocchio takes an axis within 1e-12 of x for x, but normalises one that is longer by more than that.
    second_largest = np.sort(np.abs(axis))[1]
    return axis * (1 + 2.0**-38) if 2.0**-53 < second_largest < 2.0**-39 else axis


def _add_shape(link: ET.Element, shape: Drawn, tag: str, colour: Sequence[float] | None) -> None:
    """Add a shape or a mesh as an element "visual" or "collision". A shape to be seen has the colour, a mesh its
    own.
    """
    rpy: Any = NO_TURN
    sizes: dict[str, Any]
    origin = shape.pose.origin if isinstance(shape, Mesh) else shape.center
    if isinstance(shape, Mesh):
        kind, file, colour = "mesh", shape.named_anywhere(), shape.colour
        check_xml_text("the file of a mesh", file)
        sizes = {"filename": file} | ({"scale": shape.scale} if shape.scale != (1.0, 1.0, 1.0) else {})
        rpy = matrix_to_euler(shape.pose.rotation, "xyz")
    elif isinstance(shape, Box):
        kind, sizes, rpy = "box", {"size": shape.size}, matrix_to_euler(shape.axes, "xyz")
    elif isinstance(shape, Cylinder):
        x, y, z = map(float, shape.axis)
        kind, sizes = "cylinder", {"radius": shape.radius, "length": shape.length}
        rpy = math.atan2(-y, math.hypot(x, z)), math.atan2(x, z), 0.0
    else:
        kind, sizes = "sphere", {"radius": shape.radius}
    element = add_element(link, tag)
    add_element(element, "origin", xyz=origin, rpy=rpy)
    add_element(add_element(element, "geometry"), kind, **sizes)
    if colour is not None and tag == "visual":
        name = "colour_" + "".join(f"{round(255 * part):02x}" for part in colour)
        add_element(add_element(element, "material", name=name), "color", rgba=colour)
