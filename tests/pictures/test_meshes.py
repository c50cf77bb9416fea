"""Meshes of a URDF on the page: found, coloured, placed, and simplified."""

from __future__ import annotations

import base64
from pathlib import Path

import numpy as np
import pytest
import trimesh

import hingepair as hp
from hingepair.mechanism.bodies.shapes import Mesh
from hingepair.pictures.meshes import read_meshes
from hingepair.urdf.rigid import FramePose
from support.drawn import content_of

LINK = """<link name="{name}"><visual><origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>
  <geometry><mesh filename="{file}" scale="2 1 1"/></geometry>{colour}</visual></link>"""
URDF = """<robot name="r"><link name="a"/>{link}
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" effort="9" velocity="9"/></joint></robot>"""


def box_file(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box((0.1, 0.2, 0.3)).export(folder / "box.stl")


def urdf_file(folder: Path, file: str, colour: str = "") -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "r.urdf"
    path.write_text(URDF.format(link=LINK.format(name="b", file=file, colour=colour)))
    return path


def shapes(page: hp.Page) -> list[dict[str, object]]:
    return content_of(page)["bodies"][1]["shapes"]


def corners(shape: dict[str, object]) -> np.ndarray:
    return np.frombuffer(base64.b64decode(shape["vertices"]), "<f4").reshape(-1, 3)


@pytest.mark.parametrize("file", ["box.stl", "package://robot_description/meshes/box.stl", "file://{folder}/box.stl"])
def test_a_mesh_is_scaled_and_placed_as_the_urdf_says(file: str, tmp_path: Path) -> None:
    home = tmp_path / "robot_description"
    box_file(home / "meshes" if "package" in file else home / "urdf")
    path = urdf_file(home / "urdf", file.format(folder=home / "urdf"))
    (shape,) = shapes(hp.view(hp.Mechanism.from_urdf(path)))
    found = corners(shape)
    # the edges of 0.2 (twice 0.1), 0.2 and 0.3 m turn by 90 degrees about z, about the centre (1, 0, 0)
    np.testing.assert_allclose(found.min(axis=0), (0.9, -0.1, -0.15), rtol=0, atol=4 * 2.0**-24)
    np.testing.assert_allclose(found.max(axis=0), (1.1, 0.1, 0.15), rtol=0, atol=4 * 2.0**-24)
    faces = np.frombuffer(base64.b64decode(shape["faces"]), "<u4").reshape(-1, 3)
    assert len(found) == 8
    assert len(faces) == 12
    outward = np.cross(*(found[faces[:, k]] - found[faces[:, 0]] for k in (1, 2)))
    assert ((found[faces[:, 0]] - (1, 0, 0)) * outward).sum(axis=1).min() > 0


def test_a_mirrored_mesh_keeps_its_outer_side(tmp_path: Path) -> None:
    box_file(tmp_path)
    pose = FramePose(np.eye(3), np.zeros(3))
    mesh = Mesh("box.stl", tmp_path, (-1.0, 1.0, 1.0), pose, None)
    ((piece,),) = read_meshes([mesh], 1.0)[0].values()
    first, second, third = (piece.vertices[piece.faces[:, k]] for k in range(3))
    assert (first * np.cross(second - first, third - first)).sum(axis=1).min() > 0


def test_colours_are_those_of_the_urdf_or_of_the_file_or_of_the_body(tmp_path: Path) -> None:
    box_file(tmp_path)
    colour = '<material name="m"><color rgba="1 0 0.5 1"/></material>'
    (shape,) = shapes(hp.view(hp.Mechanism.from_urdf(urdf_file(tmp_path, "box.stl", colour))))
    assert shape["colour"] == "#ff0080"
    painted = trimesh.creation.box((1, 1, 1))
    painted.visual.face_colors = (0, 128, 255, 255)
    painted.export(tmp_path / "box.ply")
    (shape,) = shapes(hp.view(hp.Mechanism.from_urdf(urdf_file(tmp_path, "box.ply"))))
    assert shape["colour"] == "#0080ff"
    (shape,) = shapes(hp.view(hp.Mechanism.from_urdf(urdf_file(tmp_path, "box.stl"))))
    assert shape["colour"] == "#4477aa"


def test_large_meshes_are_simplified_to_the_size_that_was_asked_for(tmp_path: Path) -> None:
    trimesh.creation.icosphere(subdivisions=5).export(tmp_path / "ball.stl")  # 20,480 triangles
    robot = hp.Mechanism.from_urdf(urdf_file(tmp_path, "ball.stl"))
    whole, small = (hp.view(robot, meshes=size) for size in (4.0, 0.1))
    grown = len(whole.html) - len(hp.view(robot, meshes=0).html)
    assert 0.3e6 < grown < 0.7e6
    assert len(small.html) - len(hp.view(robot, meshes=0).html) < 0.12e6
    np.testing.assert_allclose(
        np.linalg.norm((corners(shapes(small)[0]) - (1, 0, 0)) / (1, 2, 1), axis=1),
        1,
        atol=0.02,  # of the edges left
    )


def test_a_body_whose_mesh_cannot_be_drawn_gets_simple_shapes_and_a_note(tmp_path: Path) -> None:
    (tmp_path / "broken.stl").write_text("solid\nvertex 1 2\n")
    (tmp_path / "secret.txt").write_text("no mesh")
    (tmp_path / "arm.gltf").write_text('{"asset": {"version": "2.0"}}')
    for file, note in (
        ("away.stl", "mesh not found: away.stl"),
        ("secret.txt", "mesh not found: secret.txt"),
        ("broken.stl", "mesh not read: broken.stl"),
        ("arm.gltf", "mesh not found: arm.gltf"),
    ):
        page = hp.view(hp.Mechanism.from_urdf(urdf_file(tmp_path, file)))
        (sentence,) = page.notes
        assert sentence.startswith(note)
        assert {shape["kind"] for shape in shapes(page)} <= {"box", "cylinder", "sphere"} != set()


def test_every_mesh_of_a_robot_of_the_package_is_read() -> None:
    page = hp.view(hp.load_robot("solo12"), meshes=0.5)
    assert page.notes == ()
    assert page.html.count('"kind": "mesh"') == 17
