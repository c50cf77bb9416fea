"""`hingepair tolerance SCENE`: the band to first order beside sampled pairs, and the dimension that matters most."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hingepair.scenes.variants.tolerance import study_tolerances

import hingepair as hp
from support.commands import refusal, run_command

MODELS = Path(__file__).parents[2] / "models"
SAMPLES = 5_000
SCENE = """
[pair]
u1 = [0.5, 0.2, 0.1]
u2 = [-0.25, 0.1, 0.3]
n = [1, 2, 0]
[motion]
x = 0
y = 0
z = 0
phi_x = "sin(t)"
phi_y = 0
phi_z = 0
psi = "t"
[time]
start = 0
stop = 3
samples = 31
"""


@pytest.fixture
def scene_path(tmp_path: Path) -> Path:
    path = tmp_path / "arm.toml"
    path.write_text(SCENE + "[tolerances]\nu1_std = [0.001, 0, 0]\naxis_std = 'pi/1800'\n")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("name", ["landing_gear", "reference_2d"])
def test_first_order_and_samples_agree(name):
    scene = hp.load_scene(MODELS / f"{name}.toml")
    study = study_tolerances(scene, SAMPLES, u1_std=1e-4, u2_std=2e-4, axis_std=1e-4, home_std=1e-4)
    assert study.std.shape == study.sampled_std.shape == (101, 6)
    assert (study.t[0], study.t[-1]) == (scene.start, scene.stop)
    assert np.abs(study.sampled_std / study.std - 1).max() < 5 / np.sqrt(2 * SAMPLES)
    width = study.band[:, 1] - study.band[:, 0]
    assert np.abs(width / (2 * 1.96 * study.std) - 1).max() < 0.15
    assert np.allclose(sum(study.contributions.values()), study.std**2, rtol=1e-12, atol=0)


def test_tolerances_of_the_scene_are_taken_unless_named(scene_path):
    scene = hp.load_scene(scene_path)
    study = study_tolerances(scene, 10)
    assert study.tolerances == {"u1_std": [0.001, 0.0, 0.0], "axis_std": np.pi / 1800}
    assert set(study.shares()) == {"u1_x", "axis"}
    assert study_tolerances(scene, 10, u1_std=0.0, axis_std=1e-3).shares() == {"axis": (1.0, 1.0)}


@pytest.mark.slow
def test_limits_of_the_scene_are_those_of_drawings(tmp_path):
    path = tmp_path / "drawn.toml"
    path.write_text(
        SCENE + """[tolerances]\nu1 = ["+-3 mm", "0", "0"]\naxis = "+-0.1 deg uniform"\nu2_std = 1e-3\n"""
    )
    scene = hp.load_scene(path)
    study = study_tolerances(scene, 10)
    same = study_tolerances(scene, 10, u1_std=(1e-3, 0, 0), axis_std=np.radians(0.05))
    np.testing.assert_allclose(study.std, same.std, rtol=1e-12)
    assert [note for note in study.notes if "three standard deviations" in note]
    assert same.notes == ()  # options replace limits
    shown = run_command("tolerance", path, "--u2", "+-0,2 mm").stdout
    assert "a tilt of the axis is taken with the bodies adjusted at psi = 0" in shown
    assert shown.count("as a mean over the motion") == 1
    assert "u1 = +-3 mm, 0, 0; axis = +-0.1 deg uniform; u2 = +-0,2 mm" in shown
    assert "_std" not in shown
    assert "three standard deviations of a normal distribution" in " ".join(shown.split())
    told = json.loads(run_command("tolerance", path, "--u1", "+-1 mm uniform", "--u2-std", "0", "--json").stdout)
    assert told["tolerances"] == {"u1": "+-1 mm uniform", "axis": "+-0.1 deg uniform", "u2_std": 0.0}
    assert told["notes"] == []


def test_the_dimension_that_matters_most_is_named(scene_path):
    study = study_tolerances(hp.load_scene(scene_path), 10, u1_std=(0, 1e-2, 1e-3), axis_std=1e-5)
    assert [*study.shares()][:2] == ["axis", "u1_y"]  # all of the attitude, most of the position
    position, _ = study.verdict.split(";")
    assert position == "u1_y matters most for R2 (99 % of its variance)"
    assert study.shares()["u1_y"] == pytest.approx((100 / 101, 0.0), rel=1e-4)


POINTS = "[pair.points1]\nlatch = [1, 0, 0]\nmark = [0, 1, 0]\n[pair.points2]\nhandle = [0, 0, 2]\n"


@pytest.mark.slow
def test_points_have_bands_and_shares(scene_path):
    scene_path.write_text(
        SCENE.replace("[motion]", POINTS + "[motion]")
        + "[tolerances]\nu1 = '+-3 mm'\n[tolerances.points]\nhandle = ['+-3 mm', '0', '0']\n"
    )
    scene = hp.load_scene(scene_path)
    study = study_tolerances(scene, SAMPLES)
    assert study.points == ("handle",)
    assert study.std.shape == (31, 9)
    assert np.abs(study.sampled_std / np.maximum(study.std, 1e-9) - 1)[:, 6:].max() < 5 / np.sqrt(2 * SAMPLES)
    assert np.allclose(sum(study.contributions.values()), study.std**2, rtol=1e-12, atol=0)
    assert study.shares()["handle_x"] == pytest.approx((0, 0, 0.25))
    assert [band.component for band in study.bands()][6:] == ["handle_x", "handle_y", "handle_z"]
    assert study.verdict.endswith("for handle (25 % of its variance), as a mean over the motion")
    assert study_tolerances(scene, 2, points=None).points == ("handle",)
    rough = study_tolerances(scene, 2, points={"handle": np.array([1e-3, 0, 0])})
    assert json.loads(rough.to_json())["tolerances"]["points"]["handle"] == [1e-3, 0, 0]
    with pytest.raises(hp.HingePairError, match="points: expected tolerances by name"):
        study_tolerances(scene, 2, points="+-0.5 mm")
    more = run_command("tolerance", scene_path, "--point", "latch=1e-3", "--units", "mm").stdout
    assert "u1 = +-3 mm; handle = +-3 mm, 0, 0; latch = 0.001" in more
    row = next(line.split() for line in more.splitlines() if line.startswith("latch_z  "))
    assert row[:3] == ["latch_z", "mm", "1"]
    told = json.loads(run_command("tolerance", scene_path, "--point", "handle=+-1 mm", "--json").stdout)
    assert told["tolerances"]["points"] == {"handle": "+-1 mm"}
    assert told["shares"]["u1_x"]["handle"] == pytest.approx(1 / (3 + 3 * (1 / 3) ** 2))
    assert refusal("tolerance", scene_path, "--point", "hook=1").startswith("--point: expected one of latch, mark")
    assert refusal("tolerance", scene_path, "--point", "hook").startswith("--point: expected NAME=LIMIT")
    scene_path.write_text(scene_path.read_text().replace("handle = ['+-3 mm'", "grip = ['+-3 mm'"))
    assert "tolerances.points: expected one of latch, mark, handle" in refusal("tolerance", scene_path)


def test_large_tolerances_are_seen_by_the_samples_only(scene_path):
    study = study_tolerances(hp.load_scene(scene_path), SAMPLES, u1_std=0.0, axis_std=1.0)
    assert np.abs(study.sampled_std[1:] / study.std[1:] - 1).max() > 0.1  # psi is 0 at first
