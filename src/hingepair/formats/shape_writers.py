"""Boxes, cylinders and spheres as elements of URDF and MJCF."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from hingepair.formats.xml_text import add_element
from hingepair.mechanism.shapes import Mesh
from hingepair.mechanism.tree import Tree
from hingepair.pair.body import Box, Cylinder, Shape
from hingepair.rotations.euler import matrix_to_euler
from hingepair.rotations.matrices import matrix_to_quaternion

_NO_TURN = (0.0, 0.0, 0.0)  # roll, pitch and yaw [rad]


def add_visual(link: ET.Element, shape: Shape) -> ET.Element:
    """Add a shape, which stands in the axes of a link, to the link of a URDF; return its element."""
    kind, sizes, rpy = _urdf_geometry(shape)
    visual = add_element(link, "visual")
    add_element(visual, "origin", xyz=shape.center, rpy=rpy)
    add_element(add_element(visual, "geometry"), kind, **sizes)
    return visual


def add_geom(body: ET.Element, shape: Shape, colour: str) -> None:
    """Add a shape, which stands in the axes of a body and does not collide, to the body of an MJCF."""
    drawn = {"contype": "0", "conaffinity": "0", "group": "1", "rgba": colour}
    add_element(body, "geom", **_mjcf_geometry(shape), pos=shape.center, **drawn)


def shapes_of_body(tree: Tree, number: int) -> tuple[Shape, ...]:
    """Return the shapes of a body of a robot without its meshes, in the axes of the body."""
    if not tree.drawings:
        return ()
    drawing = tree.drawings[number]
    return tuple(shape for shape in drawing.visuals if not isinstance(shape, Mesh)) or drawing.shapes


def mesh_sentences(tree: Tree) -> list[str]:
    """Return a sentence, if any, on meshes, which are not written."""
    count = sum(isinstance(shape, Mesh) for drawing in tree.drawings for shape in drawing.visuals)
    return [f"meshes are not written: {count} of {tree.name}"] if count else []


def _urdf_geometry(shape: Shape) -> tuple[str, dict[str, Any], Any]:
    """Return kind, sizes, and roll, pitch and yaw [rad] of a shape in URDF."""
    if isinstance(shape, Box):
        return "box", {"size": shape.size}, matrix_to_euler(shape.axes, "xyz")
    if isinstance(shape, Cylinder):
        x, y, z = map(float, shape.axis)
        rpy = math.atan2(-y, math.hypot(x, z)), math.atan2(x, z), 0.0
        return "cylinder", {"radius": shape.radius, "length": shape.length}, rpy
    return "sphere", {"radius": shape.radius}, _NO_TURN


def _mjcf_geometry(shape: Shape) -> dict[str, Any]:
    """Return type, size (half lengths and radii) and direction of a shape as a geom of MuJoCo."""
    if isinstance(shape, Box):
        turn = {"quat": matrix_to_quaternion(shape.axes)} if (shape.axes != np.eye(3)).any() else {}
        return {"type": "box", "size": shape.size / 2, **turn}
    if isinstance(shape, Cylinder):
        return {"type": "cylinder", "size": (shape.radius, shape.length / 2), "zaxis": shape.axis}
    return {"type": "sphere", "size": shape.radius}
