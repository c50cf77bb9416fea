"""Meshes of robots on a page: read by trimesh, and simplified to the size that the page bears."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hingepair.mechanism.bodies.shapes import Mesh
from hingepair.pictures.moving import Array

_BYTES_PER_FACE = 26.0  # on the page: three indices of 4 bytes, about 0.6 vertices of 12, and base64's third
_MAX_FACES = 5_000_000  # of a file; more takes gigabytes
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
    notes: dict[str, None] = {}
    files: dict[Path, list[tuple[str | None, Any]]] = {}  # colours and geometries of each file, read once
    found: list[tuple[Mesh, Path]] = []
    for mesh in wanted:
        path = mesh.find()
        if path is None:
            notes[f"mesh not found: {mesh.file}"] = None
            continue
        if path not in files:
            try:
                files[path] = _load(trimesh, path)
                reason = "" if files[path] else "no triangles"
            except Exception as error:  # whatever a file of a stranger does to the reader
                files[path], reason = [], f"{type(error).__name__}: {error}"
            if reason:
                notes[f"mesh not read: {path.name} ({reason})"] = None
        if files[path]:
            found.append((mesh, path))
    count = sum(len(geometry.faces) for _, path in found for _, geometry in files[path])
    share = min(1.0, 1e6 * megabytes / _BYTES_PER_FACE / max(1, count))
    pieces = {path: [_piece(*one, share) for one in files[path]] for path in files}
    return {id(mesh): [_placed(mesh, piece) for piece in pieces[path]] for mesh, path in found}, list(notes)


def _load(trimesh: Any, path: Path) -> list[tuple[str | None, Any]]:
    """Return the colours and geometries of a file; raise a ValueError if it has too many triangles."""
    scene = trimesh.load_scene(path, process=False)
    drawn = [scene.geometry[scene.graph[node][1]] for node in scene.graph.nodes_geometry]
    count = sum(len(getattr(geometry, "faces", ())) for geometry in drawn)
    if count > _MAX_FACES:
        raise ValueError(f"{count} triangles, more than {_MAX_FACES}")
    pieces = []
    for geometry in scene.dump():
        if len(getattr(geometry, "faces", ())):
            colour = _own_colour(geometry)
            geometry.merge_vertices(merge_tex=True, merge_norm=True)
            pieces.append((colour, geometry))
    return pieces


def _placed(mesh: Mesh, piece: MeshPiece) -> MeshPiece:
    """Return a piece of a mesh's file in the axes of the body, in the colour of the mesh if it has one."""
    vertices = mesh.pose.origin + (piece.vertices * mesh.scale) @ mesh.pose.rotation.T
    mirrored = np.prod(mesh.scale) < 0  # triangles keep their outer side
    colour = piece.colour if mesh.colour is None else _hex_colour(np.multiply(mesh.colour, 255))
    return MeshPiece(colour, vertices, piece.faces[:, ::-1] if mirrored else piece.faces)


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
