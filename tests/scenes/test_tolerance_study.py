"""`hingepair tolerance SCENE`: the standard deviation of each component, and what causes it."""

from __future__ import annotations

import json
import re
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
    path.write_text(PAIR + MOTION + "[tolerances]\nu1 = ['+-3 mm', '0', '0']\naxis = '+-0.3 deg'\n")
    return path


def check_sums(study):
    """The causes of each component add up to its variance."""
    for name, std in study.std.items():
        np.testing.assert_allclose(sum(study.contributions[name].values()), std**2, rtol=64 * U, atol=0)


def test_a_planar_pair_has_components_in_the_plane():
    study = study_tolerances(hp.load_scene(MODELS / "reference_2d.toml"), u1="+-0.3 mm", home="+-0.3 mrad")
    assert [*study.std] == ["R2_x", "R2_y", "attitude_z"]
    assert all(own.any() for own in study.std.values())


@pytest.mark.slow
def test_sampled_pairs_scatter_as_the_study_says():
    scene = hp.load_scene(MODELS / "landing_gear.toml")
    tolerances = {"u1": "+-0.3 mm", "u2": "+-0.6 mm", "axis": "+-0.3 mrad", "home": "+-0.3 mrad"}
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
    assert study.tolerances == {"u1": ["+-3 mm", "0", "0"], "axis": "+-0.3 deg"}
    check_sums(study)
    shares = study_tolerances(scene, u1="0, +-3 cm, +-3 mm", axis="+-0.03 mrad").shares()
    assert shares["R2_x"].keys() == {"axis"}  # body 1 turns about x, and u1_x has no tolerance
    assert next(iter(shares["R2_y"])) == "u1_y"
    assert shares["attitude_x"] == {"axis": 1.0}
    assert all(sum(own.values()) == pytest.approx(1, rel=8 * U) for own in shares.values())
    row = next(line.split() for line in run_command("tolerance", scene_path).stdout.splitlines() if "R2_x" in line)
    assert row[:2] == ["R2_x", "m"]
    assert [word for word in row if word in {"u1_x", "axis"}] == ["u1_x", "axis"]


def test_limits_of_the_scene_are_those_of_drawings(scene_path):
    scene = hp.load_scene(scene_path)
    study, own = study_tolerances(scene, axis="+-0.15 deg"), {"u1_std": (1e-3, 0, 0)}
    known = scene.known(scene.spread(101), 0)
    found = scene.pair.propagate_covariance(known.body1, known.psi, axis_std=np.radians(0.05), **own)
    np.testing.assert_allclose(study.std["R2_x"], found.R2_std[:, 0], rtol=64 * U)
    assert [note for note in study.notes if "three standard deviations" in note]
    options = ("--tolerance", "u1=+-1 mm, 0, 0", "--tolerance", "u2=+-0.2 mm")
    shown = run_command("tolerance", scene_path, *options).stdout
    assert "u1 = +-1 mm, 0, 0; axis = +-0.3 deg; u2 = +-0.2 mm" in shown
    told = json.loads(run_command("tolerance", scene_path, "--tolerance", "axis=0", "--json").stdout)
    assert told["tolerances"] == {"u1": ["+-3 mm", "0", "0"], "axis": "0"}


def test_points_are_components_too(scene_path):
    limits = "[tolerances]\nu1 = '+-3 mm'\n[tolerances.points]\nhandle = ['+-3 mm', '0', '0']\n"
    scene_path.write_text(PAIR + POINTS + MOTION + limits)
    study = study_tolerances(hp.load_scene(scene_path))
    assert [*study.std][6:] == ["handle_x", "handle_y", "handle_z"]
    check_sums(study)
    more = run_command("tolerance", scene_path, "--tolerance", "latch=+-3 mm", "--units", "mm").stdout
    assert "u1 = +-3 mm; handle = +-3 mm, 0, 0; latch = +-3 mm" in more
    row = next(line.split() for line in more.splitlines() if line.startswith("latch_z  "))
    assert row[:3] == ["latch_z", "mm", "1"]
    told = json.loads(run_command("tolerance", scene_path, "--tolerance", "handle=+-1 mm", "--json").stdout)
    assert told["tolerances"]["points"] == {"handle": "+-1 mm"}
    assert refusal("tolerance", scene_path, "--tolerance", "hook=+-1 mm").startswith(
        "--tolerance: expected one of latch, mark"
    )
    assert refusal("tolerance", scene_path, "--tolerance", "hook").startswith("--tolerance: expected NAME=LIMIT")
    assert refusal("tolerance", scene_path, "--tolerance", "u1=nan").startswith("u1: expected")
    scene_path.write_text(scene_path.read_text().replace("handle = ['+-3 mm'", "grip = ['+-3 mm'"))
    assert "tolerances.points: expected one of latch, mark, handle" in refusal("tolerance", scene_path)


@pytest.mark.parametrize(
    ("given", "shown"), [("0.0005", "handle = 0.0005"), ("[0.0005, 0, 0.001]", "handle = 0.0005, 0, 0.001")]
)
def test_standard_deviations_of_a_point_are_shown_and_are_no_limits(scene_path, given, shown):
    scene_path.write_text(PAIR + POINTS + MOTION + f"[tolerances]\npoints = {{ handle = {given} }}\n")
    printed = run_command("tolerance", scene_path).stdout
    assert f"; {shown}\n" in printed
    assert "three standard deviations" not in printed


@pytest.mark.parametrize(
    "given", [{"u1": "±3 mm"}, {"u1": "+/-3 mm"}, {"u1": ("0", "0", "± 3 mm")}, {"points": {"handle": "+/-3 mm"}}]
)
def test_what_limits_mean_is_said_however_they_are_written(scene_path, given):
    scene_path.write_text(PAIR + POINTS + MOTION)
    (note,) = study_tolerances(hp.load_scene(scene_path), **{"points": None} | given).notes
    assert "three standard deviations" in note


def test_tables_of_the_documentation_can_be_used(scene_path):
    page = (MODELS.parent / "docs" / "howto" / "tolerances.md").read_text(encoding="utf-8")
    tables = re.findall(r"^```toml\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    assert tables
    for table in tables:
        scene_path.write_text(PAIR + POINTS + MOTION + table)
        check_sums(study_tolerances(hp.load_scene(scene_path)))
