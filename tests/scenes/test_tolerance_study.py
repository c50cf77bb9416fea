"""`hingepair tolerance SCENE`: the standard deviation of each component, and what causes it."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.scenes.variants.tolerance import study_tolerances
from support.commands import refusal, run_command
from support.near import U
from support.scenes import moved, toml

MODELS = Path(__file__).parents[2] / "models"
SAMPLES = 5_000
PAIR = toml("pair", u1=[0.5, 0.2, 0.1], u2=[-0.25, 0.1, 0.3], n=[1, 2, 0])
MOTION = moved(0, 3, 31, phi_x="sin(t)", psi="t")
POINTS = "[pair.points1]\nlatch = [1, 0, 0]\nmark = [0, 1, 0]\n[pair.points2]\nhandle = [0, 0, 2]\n"


@pytest.fixture
def scene_path(tmp_path: Path) -> Path:
    path = tmp_path / "arm.toml"
    path.write_text(PAIR + MOTION + "[tolerances]\nu1_std = [0.001, 0, 0]\naxis_std = 'pi/1800'\n")
    return path


def check_sums(study):
    """The causes of each component add up to its variance."""
    for name, std in study.std.items():
        np.testing.assert_allclose(sum(study.contributions[name].values()), std**2, rtol=64 * U, atol=0)


def test_a_planar_pair_has_components_in_the_plane():
    study = study_tolerances(hp.load_scene(MODELS / "reference_2d.toml"), u1_std=1e-4, home_std=1e-4)
    assert [*study.std] == ["R2_x", "R2_y", "attitude_z"]
    assert all(own.any() for own in study.std.values())


@pytest.mark.slow
def test_sampled_pairs_scatter_as_the_study_says():
    scene = hp.load_scene(MODELS / "landing_gear.toml")
    tolerances = {"u1_std": 1e-4, "u2_std": 2e-4, "axis_std": 1e-4, "home_std": 1e-4}
    study = study_tolerances(scene, **tolerances)
    assert [*study.std] == [f"{name}_{letter}" for name in ("R2", "attitude") for letter in "xyz"]
    assert (study.t[0], study.t[-1]) == (scene.start, scene.stop)
    pairs = hp.sample_pairs(scene.space, SAMPLES, seed=0, **tolerances)
    known = scene.known(scene.spread(101), 0)
    for k in (0, 50, 100):
        state = pairs.forward_kinematics_from_body1(hp.BodyMotion(R=np.zeros(3), S=known.body1.S[k]), known.psi[k])
        said = [study.std[f"R2_{letter}"][k] for letter in "xyz"]
        assert np.abs(state.d.std(axis=0) / said - 1).max() < 5 / np.sqrt(2 * SAMPLES)
    check_sums(study)


def test_each_component_says_what_causes_it(scene_path):
    scene = hp.load_scene(scene_path)
    study = study_tolerances(scene)
    assert study.tolerances == {"u1_std": [0.001, 0.0, 0.0], "axis_std": np.pi / 1800}
    shares = study_tolerances(scene, u1_std=(0, 1e-2, 1e-3), axis_std=1e-5).shares()
    assert shares["R2_x"].keys() == {"axis"}  # body 1 turns about x, and u1_x has no tolerance
    assert next(iter(shares["R2_y"])) == "u1_y"
    assert shares["attitude_x"] == {"axis": 1.0}
    assert all(sum(own.values()) == pytest.approx(1) for own in shares.values())
    row = next(line.split() for line in run_command("tolerance", scene_path).stdout.splitlines() if "R2_x" in line)
    assert row[:2] == ["R2_x", "m"]
    assert [word for word in row if word in {"u1_x", "axis"}] == ["u1_x", "axis"]


def test_limits_of_the_scene_are_those_of_drawings(scene_path):
    before = scene_path.read_text().partition("[tolerances]")[0]
    scene_path.write_text(
        before + """[tolerances]\nu1 = ["+-3 mm", "0", "0"]\naxis = "+-0.1 deg uniform"\nu2_std = 1e-3\n"""
    )
    scene = hp.load_scene(scene_path)
    study, same = study_tolerances(scene), study_tolerances(scene, u1_std=(1e-3, 0, 0), axis_std=np.radians(0.05))
    for name, std in same.std.items():
        np.testing.assert_allclose(study.std[name], std, rtol=64 * U)
    assert [note for note in study.notes if "three standard deviations" in note]
    assert same.notes == ()  # options replace limits
    shown = run_command("tolerance", scene_path, "--tolerance", "u2=+-0.2 mm").stdout
    assert "u1 = +-3 mm, 0, 0; axis = +-0.1 deg uniform; u2 = +-0.2 mm" in shown
    assert "_std" not in shown
    options = ("--tolerance", "u1=+-1 mm uniform", "--tolerance", "u2_std=0", "--json")
    told = json.loads(run_command("tolerance", scene_path, *options).stdout)
    assert told["tolerances"] == {"u1": "+-1 mm uniform", "axis": "+-0.1 deg uniform", "u2_std": 0.0}
    assert told["notes"] == []


def test_points_are_components_too(scene_path):
    limits = "[tolerances]\nu1 = '+-3 mm'\n[tolerances.points]\nhandle = ['+-3 mm', '0', '0']\n"
    scene_path.write_text(PAIR + POINTS + MOTION + limits)
    study = study_tolerances(hp.load_scene(scene_path))
    assert [*study.std][6:] == ["handle_x", "handle_y", "handle_z"]
    check_sums(study)
    more = run_command("tolerance", scene_path, "--tolerance", "latch=1e-3", "--units", "mm").stdout
    assert "u1 = +-3 mm; handle = +-3 mm, 0, 0; latch = 0.001" in more
    row = next(line.split() for line in more.splitlines() if line.startswith("latch_z  "))
    assert row[:3] == ["latch_z", "mm", "1"]
    told = json.loads(run_command("tolerance", scene_path, "--tolerance", "handle=+-1 mm", "--json").stdout)
    assert told["tolerances"]["points"] == {"handle": "+-1 mm"}
    assert refusal("tolerance", scene_path, "--tolerance", "hook=1").startswith(
        "--tolerance: expected one of latch, mark"
    )
    assert refusal("tolerance", scene_path, "--tolerance", "hook").startswith("--tolerance: expected NAME=LIMIT")
    assert refusal("tolerance", scene_path, "--tolerance", "u1_std=nan").startswith("u1_std: expected a finite")
    scene_path.write_text(scene_path.read_text().replace("handle = ['+-3 mm'", "grip = ['+-3 mm'"))
    assert "tolerances.points: expected one of latch, mark, handle" in refusal("tolerance", scene_path)
