"""The boxes, cylinders and spheres by which the bodies of a robot are drawn."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from hingepair.errors import ArgumentError, URDFError
from hingepair.pair.body import Box, Cylinder, Shape, Sphere
from hingepair.urdf.records import DEFAULT_SIZES_BY_ATTRIBUTE_NAME_BY_SHAPE_KIND, LinkRecord, Visual
from hingepair.urdf.rigid import FramePose


class BodyDrawing(NamedTuple):
    """Drawing of a body of a robot. A drawing without shapes, or of a body that a URDF draws by meshes, is not
    complete.

    Attributes:
        shapes: shapes in the axes of the body, from its reference point.
        is_complete: whether the shapes show all of the body; False if there are none, or if a URDF has meshes.
    """

    shapes: tuple[Shape, ...] = ()
    is_complete: bool = False


def body_drawing(shapes_and_poses: Iterable[tuple[tuple[Shape, ...] | None, FramePose]]) -> BodyDrawing:
    """Return the BodyDrawing of a body from pairs (shapes, FramePose), one for each part that belongs to the body.
    The drawing is empty if the shapes of a part are None, since meshes draw it, or if a position overflows.
    """
    placed: list[Shape] = []
    for shapes, pose in shapes_and_poses:
        if shapes is None:
            return BodyDrawing()
        try:
            placed += placed_shapes(shapes, pose)
        except ArgumentError:  # a position overflows; the drawing does not matter to motion
            return BodyDrawing()
    return BodyDrawing(tuple(placed), bool(placed))


def link_shapes(link: LinkRecord, *tags: str) -> tuple[Shape, ...] | None:
    """Return the boxes, cylinders and spheres of a LinkRecord as a tuple, in the axes of the link. Return an empty
    tuple if nothing is drawn, and None if the link is drawn by meshes or its elements cannot be read.

    Args:
        link: record of the link.
        tags: elements to search, "visual" or "collision"; the first that holds only shapes is used.
    """
    drawn = False
    for tag in tags:
        try:
            visuals = link.visuals(tag)
            if visuals and all(visual.kind in DEFAULT_SIZES_BY_ATTRIBUTE_NAME_BY_SHAPE_KIND for visual in visuals):
                return tuple(_shape_of_visual(visual) for visual in visuals if min(visual.sizes) > 0)
        except (URDFError, ArgumentError):  # the drawing of a link does not matter to motion
            return None
        drawn = drawn or bool(visuals)
    return None if drawn else ()


def placed_shapes(shapes: Iterable[Shape], pose: FramePose) -> list[Shape]:
    """Return a list of copies of shapes that are rotated and then shifted by the FramePose `pose`."""
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


def _shape_of_visual(visual: Visual) -> Shape:
    """Convert a Visual record of a URDF, whose kind is box, cylinder or sphere, to a Box, Cylinder or Sphere."""
    axes, center = (part + 0.0 for part in visual.pose)
    if visual.kind == "box":
        return Box(visual.sizes, center, axes)
    if visual.kind == "cylinder":
        return Cylinder(visual.sizes[0], visual.sizes[1], center, axes[:, 2])
    return Sphere(visual.sizes[0], center)
