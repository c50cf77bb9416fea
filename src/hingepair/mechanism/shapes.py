"""The boxes, cylinders and spheres that a URDF draws a link by."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from hingepair.errors import ArgumentError, URDFError
from hingepair.pair.body import Box, Cylinder, Shape, Sphere
from hingepair.urdf.records import SIZES, Link, Visual
from hingepair.urdf.rigid import Pose


class Drawing(NamedTuple):
    """What a body is drawn by.

    Attributes:
        shapes: in the axes of the body, from its reference point.
        complete: whether they show all of the body; False where there are none, or where a URDF draws it by meshes.
    """

    shapes: tuple[Shape, ...] = ()
    complete: bool = False


def drawing_of(parts: Iterable[tuple[tuple[Shape, ...] | None, Pose]]) -> Drawing:
    """Return the drawing of a body by the shapes of its parts, None of a part drawn by meshes, and their poses."""
    placed: list[Shape] = []
    for shapes, pose in parts:
        if shapes is None:
            return Drawing()
        try:
            placed += placed_shapes(shapes, pose)
        except ArgumentError:  # a place that overflows: what a body looks like does not matter to motion
            return Drawing()
    return Drawing(tuple(placed), bool(placed))


def link_shapes(link: Link, *tags: str) -> tuple[Shape, ...] | None:
    """Return the shapes of a link, in its own axes; None where it is drawn by something else, such as meshes.

    Args:
        link: record of the link.
        tags: elements to look at, "visual" or "collision": the first of them that holds nothing but shapes counts.
    """
    drawn = False
    for tag in tags:
        try:
            visuals = link.visuals(tag)
            if visuals and all(visual.kind in SIZES for visual in visuals):
                return tuple(_shape(visual) for visual in visuals if min(visual.sizes) > 0)
        except (URDFError, ArgumentError):  # what a link looks like does not matter to motion
            return None
        drawn = drawn or bool(visuals)
    return None if drawn else ()


def placed_shapes(shapes: Iterable[Shape], pose: Pose) -> list[Shape]:
    """Return shapes that are given in a frame, in the axes that the pose of this frame is given in."""
    placed: list[Shape] = []
    for shape in shapes:
        center = pose.origin + pose.rotation @ shape.center
        if isinstance(shape, Box):
            placed.append(Box(shape.size, center, pose.rotation @ shape.axes))
        elif isinstance(shape, Cylinder):
            placed.append(Cylinder(shape.radius, shape.length, center, pose.rotation @ shape.axis))
        else:
            placed.append(Sphere(shape.radius, center))
    return placed


def _shape(visual: Visual) -> Shape:
    axes, center = (part + 0.0 for part in visual.pose)
    if visual.kind == "box":
        return Box(visual.sizes, center, axes)
    if visual.kind == "cylinder":
        return Cylinder(visual.sizes[0], visual.sizes[1], center, axes[:, 2])
    return Sphere(visual.sizes[0], center)
