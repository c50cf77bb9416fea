"""The boxes, cylinders, spheres and meshes by which the bodies of a robot are drawn."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from hingepair.errors import ArgumentError, URDFError
from hingepair.pair.body import Box, Cylinder, Shape, Sphere
from hingepair.urdf.records import DEFAULT_SIZES, LinkRecord, Visual
from hingepair.urdf.rigid import FramePose


class Mesh(NamedTuple):
    """Mesh in a file, as a URDF names it."""

    file: str  # as written: a path, or package://...
    folder: Path | None  # of the URDF file
    scale: tuple[float, ...]
    pose: FramePose
    colour: tuple[float, ...] | None  # red, green, blue, opacity from 0 to 1; None: the colours of the file

    def placed(self, pose: FramePose) -> Mesh:
        """Return the mesh rotated and then shifted by `pose`."""
        return self._replace(pose=pose.placed(self.pose))


class BodyDrawing(NamedTuple):
    """Drawing of a body of a robot, in the axes of the body, from its reference point."""

    shapes: tuple[Shape, ...] = ()
    is_complete: bool = (
        False  # whether the shapes show all of the body; False if there are none, or if meshes draw it
    )
    visuals: tuple[Shape | Mesh, ...] = ()  # shapes and meshes, as the URDF draws the body


def body_drawing(
    parts: Iterable[tuple[tuple[Shape, ...] | None, tuple[Shape | Mesh, ...], FramePose]],
) -> BodyDrawing:
    """Return the drawing of a body from (shapes, visuals, pose) of its parts; shapes of None are drawn by meshes."""
    placed: list[Shape] = []
    visuals: list[Shape | Mesh] = []
    is_complete = True
    for shapes, drawn, pose in parts:
        try:
            placed += placed_shapes(shapes or (), pose)
            visuals += placed_shapes(drawn, pose)
        except ArgumentError:  # a position overflows; the drawing does not matter to motion
            return BodyDrawing()
        is_complete &= shapes is not None
    if not is_complete:
        placed = []
    return BodyDrawing(tuple(placed), bool(placed), tuple(visuals))


def link_shapes(link: LinkRecord, *tags: str) -> tuple[Shape, ...] | None:
    """Return the shapes of a link, in its axes, from the first of the elements `tags` ("visual", "collision") that
    holds nothing else; () if nothing is drawn, None if meshes draw it or it cannot be read.
    """
    drawn = False
    for tag in tags:
        try:
            visuals = link.visuals(tag)
            if visuals and all(visual.kind in DEFAULT_SIZES for visual in visuals):
                return tuple(_shape_of_visual(visual) for visual in visuals if min(visual.sizes) > 0)
        except (URDFError, ArgumentError):  # the drawing of a link does not matter to motion
            return None
        drawn = drawn or bool(visuals)
    return None if drawn else ()


def link_visuals(link: LinkRecord, folder: Path | None) -> tuple[Shape | Mesh, ...]:
    """Return what a URDF draws a link by, in the axes of the link; nothing where its elements cannot be read."""
    try:
        return tuple(
            Mesh(visual.file, folder, visual.scale, visual.pose, visual.colour)
            if visual.kind == "mesh"
            else _shape_of_visual(visual)
            for visual in link.visuals()
            if visual.file or (visual.sizes and min(visual.sizes) > 0)
        )
    except (URDFError, ArgumentError):  # the drawing of a link does not matter to motion
        return ()


_S = TypeVar("_S", bound="Shape | Mesh")


def placed_shapes(shapes: Iterable[_S], pose: FramePose) -> list[_S]:
    """Return copies of shapes that are rotated and then shifted by `pose`."""
    return [_placed(shape, pose) for shape in shapes]


def _placed(shape: Any, pose: FramePose) -> Any:
    if isinstance(shape, Mesh):
        return shape.placed(pose)
    center = pose.origin + pose.rotation @ shape.center
    if isinstance(shape, Box):
        return Box(shape.size, center, pose.rotation @ shape.axes)
    if isinstance(shape, Cylinder):
        return Cylinder(shape.radius, shape.length, center, pose.rotation @ shape.axis)
    return Sphere(shape.radius, center)


def _shape_of_visual(visual: Visual) -> Shape:
    axes, center = (part + 0.0 for part in visual.pose)
    if visual.kind == "box":
        return Box(visual.sizes, center, axes)
    if visual.kind == "cylinder":
        return Cylinder(visual.sizes[0], visual.sizes[1], center, axes[:, 2])
    return Sphere(visual.sizes[0], center)
