"""`hingepair view`: a page of a scene, of a hinge, or of a whole robot."""

from __future__ import annotations

from pathlib import Path

import pytest

import hingepair as hp
from hingepair.formats.robots import robot_urdf
from support.commands import refusal, run_command

MODELS = Path(__file__).parents[2] / "models"


def view(*arguments: object) -> str:
    return run_command("view", *arguments).stdout


@pytest.mark.slow
def test_a_robot_is_viewed_by_its_name_or_its_urdf(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert view("panda") == "written: panda.html (8 joints; open it in a browser)\n"
    page = (tmp_path / "panda.html").read_text()
    assert page == hp.view(hp.load_robot("panda")).html
    assert "or --out panda.html, which overwrites it" in refusal("view", "panda")
    assert view(robot_urdf("panda"), "-o", "file.html").startswith("written: file.html (8 joints;")
    assert (tmp_path / "file.html").read_text() == page
    assert "(1 joint;" in view(MODELS / "talos_elbow.urdf")


def test_a_hinge_of_a_robot_is_viewed_as_a_pair(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert view("go1", "FL_calf_joint") == "written: go1_FL_calf_joint.html (181 instants; open it in a browser)\n"
    pair = hp.load_robot_hinge("go1", "FL_calf_joint")
    assert (tmp_path / "go1_FL_calf_joint.html").read_text() == hp.view(pair).html


@pytest.mark.slow
def test_a_scene_of_a_mechanism_is_viewed(tmp_path: Path) -> None:
    scene = tmp_path / "wave.toml"
    scene.write_text(
        "[mechanism]\nrobot = 'ur5_robot'\n[motion]\nelbow_joint = 'sin(t)'\n"
        "[time]\nstart = 0\nstop = 1\nsamples = 11\n"
    )
    assert "(11 instants;" in view(scene, "-o", tmp_path / "wave.html")
    still = tmp_path / "still.toml"
    still.write_text("[mechanism]\nrobot = 'panda'\nlocked = { panda_finger_joint1 = 0.02 }\n")
    assert "(7 joints;" in view(still, "-o", tmp_path / "still.html")
    assert (tmp_path / "wave.html").read_text() == hp.view(hp.load_scene(scene)).html
