"""The boxes, cylinders, spheres and meshes by which the bodies of a robot are drawn."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias, TypeVar

from hingepair.errors import ArgumentError
from hingepair.mechanism.bodies.body import Box, Cylinder, Shape, Sphere
from hingepair.urdf.records import SHAPE_SIZES, LinkRecord, Visual
from hingepair.urdf.rigid import FramePose

_MESH_SUFFIXES = (".stl", ".dae", ".obj", ".ply")  # glTF may name other files, and more numbers than it holds
_MAX_MESH_BYTES = 200_000_000  # a URDF of a stranger may name any file


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

    def named_anywhere(self) -> str:
        """Return a name of the file that holds in every folder: a relative one starts from the folder of the URDF."""
        if self.folder is None or "://" in self.file:
            return self.file
        return Path(os.path.abspath(self.folder / self.file)).as_posix()

    def find(self) -> Path | None:
        """Return the path of the file, or None if there is no such file, or one that is no mesh."""
        scheme, colon, name = self.file.rpartition("://")
        folder = self.folder or Path()
        if scheme in {"package", "model"}:
            # A package lies beside or above the URDF, or where ROS looks for it.
            environment = os.environ.get("ROS_PACKAGE_PATH", ""), os.environ.get("AMENT_PREFIX_PATH", "")
            prefixes = (Path(one) for paths in environment for one in paths.split(os.pathsep) if one)
            roots = [folder, *folder.parents, *(place for one in prefixes for place in (one, one / "share"))]
            inner = name.partition("/")[2]  # in a package whose folder has another name
            candidates = [root / part for part in (name, inner) for root in roots]
        else:
            candidates = [Path(name) if colon else folder / name]
        for path in candidates:
            if path.suffix.lower() in _MESH_SUFFIXES and path.is_file() and path.stat().st_size <= _MAX_MESH_BYTES:
                return path
        return None


Drawn: TypeAlias = Shape | Mesh


class Drawing(NamedTuple):
    """What a link or a body is drawn by, in its axes, from its reference point."""

    shapes: tuple[Shape, ...] | None = ()  # that show all of it; None if others do, such as meshes
    visuals: tuple[Drawn, ...] = ()  # shapes and meshes, as written
    collisions: tuple[Drawn, ...] = ()  # those for collisions, as written
    unread: tuple[str, ...] = ()  # what was written and cannot be read, such as "visual of link 'hand'"
    colour: tuple[float, ...] | None = None  # RGBA of shapes, in files that are written

    def with_shapes(self, added: Iterable[Shape]) -> Drawing:
        """Return the drawing with further shapes."""
        more = tuple(added)
        shapes = None if self.shapes is None else (*self.shapes, *more)
        return self._replace(shapes=shapes, visuals=(*self.visuals, *more))


NOT_DRAWN = Drawing()


def body_drawing(parts: Iterable[tuple[Drawing, FramePose]]) -> Drawing:
    """Return the drawing of a body from those of its links and their poses in it."""
    links: list[tuple[Any, FramePose]] = [*parts]
    try:
        shapes, visuals, collisions = (
            tuple(one for part, pose in links for one in placed_shapes(part[k] or (), pose)) for k in range(3)
        )
    except ArgumentError:  # a position overflows; the drawing does not matter to motion
        return Drawing()
    is_complete = all(part.shapes is not None for part, _ in links)
    unread = tuple(name for part, _ in links for name in part.unread)
    return Drawing(shapes if is_complete else None, visuals, collisions, unread)


def link_drawing(link: LinkRecord, folder: Path | None) -> Drawing:
    """Return what a URDF draws a link by; `folder` is that of the file."""
    unread = []
    drawn: dict[str, tuple[Drawn, ...]] = {}
    shapes: tuple[Shape, ...] | None = ()  # of the first kind of elements that are nothing else
    for tag, written in (("visual", link.visuals), ("collision", link.collisions)):
        records, own = written, list[Drawn]()
        try:
            own = [one for record in written or () for one in _drawn(record, folder)]
        except ArgumentError:  # the drawing of a link does not matter to motion
            records = None
        if records is None or any(one.kind not in SHAPE_SIZES and not one.file for one in records):
            unread.append(f"{tag} of link {link.name!r}")
        drawn[tag] = tuple(own)
        if shapes:
            continue
        if records and all(one.kind in SHAPE_SIZES for one in records):
            shapes = tuple(one for one in own if not isinstance(one, Mesh))
        elif records != ():
            shapes = None
    return Drawing(shapes, drawn["visual"], drawn["collision"], tuple(unread))


def _drawn(visual: Visual, folder: Path | None) -> list[Drawn]:
    """Return the shape or mesh of a URDF, in the axes of its link; nothing of what is unknown or has no size."""
    if visual.file:
        return [Mesh(visual.file, folder, visual.scale, visual.pose, visual.colour)]
    if visual.kind not in SHAPE_SIZES or min(visual.sizes) <= 0:
        return []
    axes, center = (part + 0.0 for part in visual.pose)
    if visual.kind == "box":
        return [Box(visual.sizes, center, axes)]
    if visual.kind == "cylinder":
        return [Cylinder(visual.sizes[0], visual.sizes[1], center, axes[:, 2])]
    return [Sphere(visual.sizes[0], center)]


_S = TypeVar("_S", bound="Shape | Mesh")


def placed_shapes(shapes: Iterable[_S], pose: FramePose) -> list[_S]:
    """Return copies of shapes that are rotated and then shifted by `pose`."""
    return [_placed_shape(shape, pose) for shape in shapes]


def _placed_shape(shape: Any, pose: FramePose) -> Any:
    if isinstance(shape, Mesh):
        return shape.placed(pose)
    center = pose.origin + pose.rotation @ shape.center
    if isinstance(shape, Box):
        return Box(shape.size, center, pose.rotation @ shape.axes)
    if isinstance(shape, Cylinder):
        return Cylinder(shape.radius, shape.length, center, pose.rotation @ shape.axis)
    return Sphere(shape.radius, center)
