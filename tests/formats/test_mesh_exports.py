"""Meshes of robots in URDF and MJCF: files, scales and places are those of the URDF that was read."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest
import trimesh

import hingepair as hp

U = 2.0**-53
CORNERS = np.array([(0.0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3)])
FACES = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
ORIGIN = '<origin xyz="0.1 0.2 0.3" rpy="0.4 0.5 0.6"/>'
STL = '<mesh filename="package://arm_description/meshes/hull.stl" scale="0.1 0.2 -0.3"/>'
COLOUR = '<material name="red"><color rgba="1 0 0 0.5"/></material>'
MASS = """<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""
URDF = """<robot name="arm"><link name="base"/><link name="upper">{upper}</link><link name="hand">{hand}</link>
<joint name="turn" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 1" rpy="0.3 0 0"/>
  <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
<joint name="grip" type="{kind}"><parent link="upper"/><child link="hand"/><origin xyz="1 0 0" rpy="0 0.2 0.7"/>
  <axis xyz="1 0 0"/><limit lower="-1" upper="1" effort="9" velocity="9"/></joint></robot>"""


def element(geometry: str, tag: str = "visual", more: str = "") -> str:
    return f"<{tag}>{ORIGIN}<geometry>{geometry}</geometry>{more}</{tag}>"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of a package with a tetrahedron in several formats."""
    meshes = tmp_path / "arm_description" / "meshes"
    meshes.mkdir(parents=True)
    hull = trimesh.Trimesh(CORNERS, FACES, process=False)
    for name in ("hull.stl", "hull.obj"):
        hull.export(meshes / name)
    (meshes / "hull.dae").write_text("<COLLADA/>")
    return tmp_path / "arm_description"


def robot(folder: Path, hand: str = "", upper: str = "", kind: str = "fixed", **options: object) -> hp.Mechanism:
    (folder / "arm.urdf").write_text(URDF.format(hand=MASS + hand, upper=MASS + upper, kind=kind))
    return hp.Mechanism.from_urdf(folder / "arm.urdf", **options)


def geometries(text: str, kind: pin.GeometryType, folder: Path) -> list[tuple[object, ...]]:
    model = pin.buildModelFromXML(text)
    found = pin.buildGeomFromUrdfString(model, text, kind, package_dirs=[str(folder.parent)])
    keys = ("meshPath", "meshScale", "meshColor", "overrideMaterial", "placement", "parentJoint")
    return [tuple(getattr(one, key) for key in keys) for one in found.geometryObjects]


@pytest.mark.parametrize("kind", ["VISUAL", "COLLISION"])
def test_pinocchio_finds_the_meshes_of_a_written_robot_where_they_were(folder: Path, kind: str) -> None:
    """Also those of a link that a fixed joint holds, which stand at another link then."""
    package = STL.replace("hull.stl", "hull.obj").replace("scale", "x")
    hand = (
        element(STL, "visual", COLOUR) + element(package, "collision") + element('<box size="1 2 3"/>', "collision")
    )
    arm = robot(folder, hand, upper=element(package))
    text = hp.to_urdf(arm)
    kinds = getattr(pin, kind)
    given, written = (geometries(one, kinds, folder) for one in ((folder / "arm.urdf").read_text(), text))
    assert len(given) == len(written) == 2
    for one, other in zip(given, written, strict=True):
        assert (one[0], one[1].tolist(), one[2].tolist(), one[3]) == (
            *(other[0], other[1].tolist(), other[2].tolist()), other[3],
        )  # fmt: skip
        assert np.abs(one[4].homogeneous - other[4].homogeneous).max() <= 16 * U
        assert one[5] == other[5]
    assert "mesh" not in hp.to_urdf(arm, meshes=False)


def test_meshes_beside_the_urdf_are_found_from_every_folder(folder: Path) -> None:
    arm = robot(folder, element(STL.replace("package://arm_description/", "")))
    (found,) = geometries(hp.to_urdf(arm), pin.GeometryType.VISUAL, folder)
    assert found[0] == (folder / "meshes" / "hull.stl").as_posix()
    written = folder.parent / "elsewhere.urdf"
    written.write_text(hp.to_urdf(arm))
    assert hp.to_urdf(hp.Mechanism.from_urdf(written)) == written.read_text()


def mujoco_points(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return the corners of a geom's mesh at q = 0, world axes."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mesh = model.geom_dataid[geom]
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    corners = model.mesh_vert[start : start + count]
    return data.geom_xpos[geom] + corners @ data.geom_xmat[geom].reshape(3, 3).T


@pytest.mark.parametrize("suffix", ["stl", "obj"])
def test_mujoco_shows_the_meshes_where_the_urdf_has_them(
    folder: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    hand = element(STL.replace(".stl", f".{suffix}"), "visual", COLOUR)
    monkeypatch.chdir(folder.parent)
    text = hp.to_mjcf(hp.Mechanism.from_urdf(URDF.format(hand=MASS + hand, upper=MASS, kind="fixed")))
    monkeypatch.chdir(folder)
    model = mujoco.MjModel.from_xml_string(text)
    found = mujoco_points(model, 0)
    state = robot(folder).forward_kinematics([0.0], frames="hand", backend="numpy")["hand"]
    at = np.array([0.1, 0.2, 0.3]), hp.euler_to_matrix((0.4, 0.5, 0.6), "xyz")
    placed = state.R + (at[0] + (CORNERS * (0.1, 0.2, -0.3)) @ at[1].T) @ state.S.T
    distances = np.linalg.norm(found[:, None] - placed, axis=2)
    assert distances.min(axis=1).max() <= 1e-6  # MuJoCo holds corners in single precision
    assert distances.min(axis=0).max() <= 1e-6  # as above
    assert model.geom_rgba[0].tolist() == [1, 0, 0, 0.5]
    assert model.geom_contype[0] == model.geom_conaffinity[0] == 0
    assert not model.nmesh - 1


LEFT_OUT = {
    "DAE": (STL.replace(".stl", ".dae"), "since MuJoCo cannot load DAE: hull.dae"),
    "absent": (STL.replace("hull.stl", "absent.stl"), "not found: absent.stl"),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_meshes_that_mujoco_cannot_load_are_named(folder: Path, name: str) -> None:
    geometry, reason = LEFT_OUT[name]
    arm = robot(folder, element(geometry) + element('<sphere radius="0.1"/>', "collision"))
    with pytest.warns(hp.DynamicsWarning, match=f"^arm: these meshes are not written, .*{reason}$"):
        text = hp.to_mjcf(arm)
    assert re.search(reason, text)
    model = mujoco.MjModel.from_xml_string(text)
    assert model.geom_group.tolist() == [1]  # the sphere is shown instead
    assert geometry.split('"')[1] in hp.to_urdf(arm)


def test_meshes_stay_with_locked_joints_and_payloads(folder: Path) -> None:
    arm = robot(folder, element(STL) + element(STL, "collision"), kind="revolute")
    load = hp.Body(mass=1, shapes=[hp.Sphere(0.1)])
    text = hp.to_urdf(arm.with_payload("hand", load).with_locked({"grip": 0.5}))
    tags = [shape.tag for link in ET.fromstring(text).iter("link") for shape in link if shape.tag != "inertial"]
    assert tags == ["visual", "visual", "collision"]
    assert text.count("hull.stl") == 2
