"""Meshes of robots on a page: read by trimesh, and simplified to the size that the page bears."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from hingepair.mechanism.shapes import Mesh
from hingepair.pictures.motion_samples import Array

_BYTES_PER_FACE = 26.0  # on the page: three indices of 4 bytes, about 0.6 vertices of 12, and base64's third
_MIN_FACES = 200  # of a piece: what is smaller is not simplified


class MeshPiece(NamedTuple):
    """Triangles of one colour, in the axes of a body."""

    colour: str | None  # #rrggbb; None: that of the body
    vertices: Array  # shape (N, 3) [m]
    faces: Array  # numbers of the vertices of each triangle; shape (M, 3)

    def json(self, colour: str) -> dict[str, Any]:
        """Return the piece for the page, with `colour` where it has none of its own."""
        return {
            "kind": "mesh",
            "colour": self.colour or colour,
            "vertices": base64.b64encode(self.vertices.astype("<f4").tobytes()).decode(),
            "faces": base64.b64encode(self.faces.astype("<u4").tobytes()).decode(),
        }


def read_meshes(meshes: Iterable[Mesh], megabytes: float) -> tuple[dict[int, list[MeshPiece]], list[str]]:
    """Return (pieces by `id` of the mesh, sentences about the meshes that cannot be drawn). The pieces take at most
    about `megabytes` on a page.
    """
    wanted = list(meshes)
    try:
        import trimesh
    except ImportError:
        advice = "meshes are not drawn, as trimesh is not installed: pip install 'hingepair[robots]'"
        return {}, [advice] if wanted else []
    scenes: dict[int, list[tuple[str | None, Any]]] = {}
    notes: dict[str, None] = {}
    for mesh in wanted:
        path = mesh.find()
        if path is None:
            notes[f"mesh not found: {mesh.file}"] = None
            continue
        try:
            loaded = trimesh.load_scene(path, process=False).dump()
            pieces = [_placed(mesh, geometry) for geometry in loaded if len(getattr(geometry, "faces", ()))]
        except Exception as error:  # whatever a file of a stranger does to the reader
            notes[f"mesh not read: {path.name} ({type(error).__name__}: {error})"] = None
            continue
        if pieces:
            scenes[id(mesh)] = pieces
        else:
            notes[f"mesh not read: {path.name} (no triangles)"] = None
    count = sum(len(geometry.faces) for pieces in scenes.values() for _, geometry in pieces)
    share = min(1.0, 1e6 * megabytes / _BYTES_PER_FACE / max(1, count))
    return {key: [_piece(*one, share) for one in pieces] for key, pieces in scenes.items()}, list(notes)


def _placed(mesh: Mesh, geometry: Any) -> tuple[str | None, Any]:
    """Move a geometry into the axes of the body, in place, merge equal vertices, and return (colour, geometry)."""
    geometry.vertices = mesh.pose.origin + (geometry.vertices * mesh.scale) @ mesh.pose.rotation.T
    if np.prod(mesh.scale) < 0:  # a mirrored body: triangles keep their outer side
        geometry.invert()
    colour = _own_colour(geometry) if mesh.colour is None else _hex_colour(np.multiply(mesh.colour, 255))
    geometry.merge_vertices(merge_tex=True, merge_norm=True)
    return colour, geometry


def _own_colour(geometry: Any) -> str | None:
    """Return the colour that the file gives to all of a geometry; None if it gives none."""
    visual = geometry.visual
    if visual.kind == "texture" and visual.material is not None:
        return _hex_colour(visual.material.main_color)
    return _hex_colour(visual.main_color) if visual.kind in {"face", "vertex"} else None


def _hex_colour(rgba: Sequence[float] | Array) -> str:
    return "#" + "".join(f"{round(min(max(float(part), 0), 255)):02x}" for part in rgba[:3])


def _piece(colour: str | None, geometry: Any, share: float) -> MeshPiece:
    """Return the piece with about `share` of its triangles, but with _MIN_FACES at least."""
    wanted = max(_MIN_FACES, int(share * len(geometry.faces)))
    if share < 1 and wanted < len(geometry.faces):
        geometry = geometry.simplify_quadric_decimation(face_count=wanted)
    return MeshPiece(colour, np.asarray(geometry.vertices), np.asarray(geometry.faces))
