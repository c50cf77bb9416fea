"""Boxes, cylinders, spheres and meshes as elements of URDF and MJCF."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from hingepair.formats.xml_text import NO_TURN, add_element, check_xml_text, first_few
from hingepair.mechanism.bodies.body import Box, Cylinder, Shape
from hingepair.mechanism.bodies.shapes import BodyDrawing, Drawn, Mesh
from hingepair.mechanism.tree import Tree
from hingepair.rotations.euler import matrix_to_euler
from hingepair.rotations.matrices import matrix_to_quaternion

DRAWN_ONLY: Final = {"contype": "0", "conaffinity": "0", "group": "1"}  # attributes of a geom that does not collide


def add_shape(link: ET.Element, shape: Drawn, tag: str, colour: Sequence[float] | None) -> None:
    """Add a shape or a mesh, which stands in the axes of a link, to the link of a URDF as an element "visual" or
    "collision". A shape to be seen has the colour, a mesh its own.
    """
    kind, sizes, rpy = _urdf_geometry(shape)
    element = add_element(link, tag)
    add_element(element, "origin", xyz=_place(shape), rpy=rpy)
    add_element(add_element(element, "geometry"), kind, **sizes)
    colour = shape.colour if isinstance(shape, Mesh) else colour
    if colour is not None and tag == "visual":
        name = "colour_" + "".join(f"{round(255 * part):02x}" for part in colour)
        add_element(add_element(element, "material", name=name), "color", rgba=colour)


def drawing_of_body(tree: Tree, number: int) -> BodyDrawing:
    """Return the drawing of a body of a robot, in the axes of the body."""
    return tree.drawings[number] if tree.drawings else BodyDrawing()


def unread_sentences(tree: Tree) -> list[str]:
    """Return a sentence, if any, on what draws the robot in its URDF and could not be read."""
    unread = [name for drawing in tree.drawings for name in drawing.unread]
    return [f"{tree.name}: what cannot be read is not written: {first_few(unread)}"] if unread else []


def _place(shape: Drawn) -> Any:
    return shape.pose.origin if isinstance(shape, Mesh) else shape.center


def _urdf_geometry(shape: Drawn) -> tuple[str, dict[str, Any], Any]:
    """Return kind, sizes, and roll, pitch and yaw [rad] of a shape or a mesh in URDF."""
    if isinstance(shape, Mesh):
        file = shape.named_anywhere()
        check_xml_text("the file of a mesh", file)
        scale = {"scale": shape.scale} if shape.scale != (1.0, 1.0, 1.0) else {}
        return "mesh", {"filename": file, **scale}, matrix_to_euler(shape.pose.rotation, "xyz")
    if isinstance(shape, Box):
        return "box", {"size": shape.size}, matrix_to_euler(shape.axes, "xyz")
    if isinstance(shape, Cylinder):
        x, y, z = map(float, shape.axis)
        rpy = math.atan2(-y, math.hypot(x, z)), math.atan2(x, z), 0.0
        return "cylinder", {"radius": shape.radius, "length": shape.length}, rpy
    return "sphere", {"radius": shape.radius}, NO_TURN


def mjcf_geometry(shape: Shape) -> dict[str, Any]:
    """Return type, size (half lengths and radii) and direction of a shape as a geom of MuJoCo."""
    if isinstance(shape, Box):
        turn = {"quat": matrix_to_quaternion(shape.axes)} if (shape.axes != np.eye(3)).any() else {}
        return {"type": "box", "size": shape.size / 2, **turn}
    if isinstance(shape, Cylinder):
        return {"type": "cylinder", "size": (shape.radius, shape.length / 2), "zaxis": shape.axis}
    return {"type": "sphere", "size": shape.radius}
