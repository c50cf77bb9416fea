"""Meshes of a robot as assets of an MJCF, and the geoms that show them.

MuJoCo knows no packages: files are named by their paths.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from hingepair.formats.shape_writers import DRAWN_ONLY, drawing_of_body, mjcf_geometry
from hingepair.formats.xml_text import add_element, check_xml_text, first_few
from hingepair.mechanism.bodies.shapes import Drawn, Mesh
from hingepair.mechanism.tree import Tree, unused_name
from hingepair.rotations.matrices import matrix_to_quaternion

_GREY: Final = (0.6, 0.6, 0.6, 1.0)  # RGBA of what has no colour
_COLLISION: Final = "collision"  # name of the class of the geoms for collisions
_STL_HEADER, _STL_TRIANGLE = 84, 50  # bytes
_MAX_STL_TRIANGLES = 200_000  # that MuJoCo reads


class MjcfMeshes:
    """The meshes of a robot that MuJoCo can load, and sentences on the others."""

    def __init__(self, tree: Tree, *, wanted: bool) -> None:
        self.sentences: list[str] = []
        self._tree = tree
        self._assets: dict[tuple[Path, tuple[float, ...]], str] = {}  # names by file and scale
        # Of the files as written, with their scale; None: not loaded.
        self._paths: dict[tuple[str, Path | None, tuple[float, ...]], Path | None] = {}
        taken: set[str] = set()
        left: dict[str, dict[str, None]] = {}  # names of files that are not written, by the reason
        numbers = range(len(tree.drawings)) if wanted else ()
        meshes = (one for k in numbers for one in _drawn(tree, k) if isinstance(one, Mesh))
        for mesh in meshes:
            key = mesh.file, mesh.folder, mesh.scale
            if key not in self._paths:
                path = mesh.find()
                path = path and Path(os.path.abspath(path))
                reason = "not found" if path is None else _refusal(path, mesh.scale)
                self._paths[key] = None if reason else path
                if reason:
                    left.setdefault(reason, {})[mesh.file.rpartition("/")[2] or mesh.file] = None
            found = self._paths[key]
            if found is not None and (found, mesh.scale) not in self._assets:
                self._assets[found, mesh.scale] = unused_name(found.stem, taken)
        for reason, names in left.items():
            self.sentences.append(f"{tree.name}: these meshes are not written, {reason}: {first_few(list(names))}")

    def add_assets(self, root: ET.Element) -> None:
        """Add the assets, and the class of geoms for collisions."""
        if self._assets:
            asset = add_element(root, "asset")
            for (path, scale), name in self._assets.items():
                check_xml_text("the file of a mesh", str(path))
                scaled = {"scale": scale} if scale != (1.0, 1.0, 1.0) else {}
                # A shell has an inertia also where the surface is open, which a volume has not.
                add_element(asset, "mesh", name=name, file=str(path), **scaled, inertia="shell")
        if any(drawing.collisions for drawing in self._tree.drawings):
            group = add_element(add_element(root, "default"), "default", **{"class": _COLLISION})
            add_element(group, "geom", **DRAWN_ONLY | {"group": "3"})

    def add_geoms(self, body: ET.Element, number: int) -> None:
        """Add the geoms of a body: those that are drawn, and those for collisions, shown if there are no others."""
        drawing = drawing_of_body(self._tree, number)
        visuals = [one for shape in drawing.visuals if (one := self._geom(shape))]
        for visual in visuals:
            colour = visual.pop("rgba", drawing.colour or _GREY)
            add_element(body, "geom", **visual, **DRAWN_ONLY, rgba=colour)
        shown: dict[str, Any] = {} if visuals else {"group": DRAWN_ONLY["group"]}
        for shape in drawing.collisions:
            if geom := self._geom(shape):
                geom.pop("rgba", None)
                add_element(body, "geom", **{"class": _COLLISION}, **geom, **shown, rgba=_GREY)

    def _geom(self, shape: Drawn) -> dict[str, Any] | None:
        """Return the attributes of the geom of a shape or mesh; None for a mesh that is not written."""
        if not isinstance(shape, Mesh):
            return {**mjcf_geometry(shape), "pos": shape.center}
        path = self._paths.get((shape.file, shape.folder, shape.scale))
        if path is None:
            return None
        colour = {} if shape.colour is None else {"rgba": shape.colour}
        quat = matrix_to_quaternion(shape.pose.rotation)
        return {
            **{"type": "mesh", "mesh": self._assets[path, shape.scale]},
            **{"pos": shape.pose.origin, "quat": quat, **colour},
        }


def _drawn(tree: Tree, number: int) -> Iterable[Drawn]:
    drawing = drawing_of_body(tree, number)
    return (*drawing.visuals, *drawing.collisions)


def _refusal(path: Path, scale: tuple[float, ...]) -> str:
    """Return a clause on why MuJoCo cannot load the file of a mesh at a scale; "" if it should."""
    suffix = path.suffix.lower()
    if 0.0 in scale:
        return "since MuJoCo loads no meshes without a surface, and their scale has a 0"
    if suffix not in {".stl", ".obj"}:
        return f"since MuJoCo cannot load {suffix[1:].upper()}"
    if suffix == ".stl":
        with path.open("rb") as file:
            count = int.from_bytes(file.read(_STL_HEADER)[80:], "little")
        if path.stat().st_size != _STL_HEADER + _STL_TRIANGLE * count or count > _MAX_STL_TRIANGLES:
            return f"since MuJoCo loads binary STL of at most {_MAX_STL_TRIANGLES:,} triangles"
    return ""
