"""`hingepair forces`, and the forces of a scene."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import hingepair as hp
from hingepair.cli.main import app

MODELS = Path(__file__).parents[2] / "models"


def test_forces_of_a_scene_are_those_of_its_motion():
    scene = hp.load_scene(MODELS / "landing_gear.toml")
    found = scene.forces(gravity=(0, 0, 0))
    state = scene.evaluate(("S2", "R2", "a2", "omega2", "alpha2")).state
    body2 = scene.pair.body2
    lever = state.S2 @ body2.center_of_mass
    acceleration = state.a2 + np.cross(state.alpha2, lever)
    acceleration += np.cross(state.omega2, np.cross(state.omega2, lever))
    np.testing.assert_allclose(found.hinge_force, body2.mass * acceleration, rtol=0, atol=1e-10)
    assert found["hinge_torque"].shape == (scene.samples,)
    assert set(found.recorded()) == {"hinge_torque", "bearing_torque", "hinge_force", "force1", "torque1"}
    with pytest.raises(AttributeError, match=r"no 'force2'; it has bearing_torque, .* hinge_torque"):
        _ = found.force2
    units = found.to_dataframe().attrs["units"]
    assert (units["hinge_torque"], units["bearing_torque"], units["hinge_force"]) == ("N m", "N m", "N")
    assert (units["force1"], units["torque1"]) == ("N", "N m")


def test_the_command_prints_and_writes_them(tmp_path):
    scene, out = str(MODELS / "landing_gear.toml"), tmp_path / "forces.csv"
    done = CliRunner().invoke(app, ["forces", scene, "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "hinge_torque" in done.output
    assert "max |.| at t" in done.output
    columns = np.genfromtxt(out, delimiter=",", names=True)
    np.testing.assert_array_equal(columns["hinge_torque"], hp.load_scene(scene).forces().hinge_torque)
    report = json.loads(CliRunner().invoke(app, ["forces", scene, "--gravity", "0,0,0", "--json"]).output)
    assert report["outputs"]["force1_x"]["first"] == pytest.approx(1171 * 1.6, rel=0.1)


@pytest.fixture
def light(tmp_path):
    """The landing gear without the inertia of its leg."""
    text = (MODELS / "landing_gear.toml").read_text()
    bodies = re.sub(r"(?m)^inertia = .*$|(?s:^shapes = \[\n.*?^\]$)", "", text[text.index("[pair.body2]") :], count=2)
    path = tmp_path / "light.toml"
    path.write_text(text[: text.index("[pair.body2]")] + bodies)
    return path


@pytest.mark.slow
def test_an_inertia_that_was_not_given_is_said_once(light):
    command = [sys.executable, "-m", "hingepair", "forces", str(light)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stderr
    assert said.count("no inertia is given") == 1
    assert CliRunner().invoke(app, ["forces", str(MODELS / "landing_gear.toml")]).exit_code == 0


def test_an_inertia_that_was_not_given_is_said(light):
    with pytest.warns(hp.DynamicsWarning, match=r"pair\.body2: no inertia is given"):
        hp.load_scene(light).forces()


def test_a_mass_that_was_not_given_is_said(light):
    light.write_text(re.sub(r"(?m)^mass = .*$", "", light.read_text()))
    with pytest.warns(hp.DynamicsWarning) as said:
        hp.load_scene(light).forces()
    assert [name for name in ("body1", "body2") for one in said if f"pair.{name}: no mass" in str(one.message)]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["reference_3d.toml"], "pair.body2: expected mass properties"),
        (["reference_2d.toml"], "pair.body2: expected mass properties"),
        (["landing_gear.toml", "--gravity", "down"], "--gravity: expected three finite numbers X,Y,Z, got 'down'"),
        (["landing_gear.toml", "--out", "forces.doc"], "--out: expected a file name that ends in"),
    ],
)
def test_what_has_no_forces_is_told_why(arguments, words):
    done = CliRunner().invoke(app, ["forces", str(MODELS / arguments[0]), *arguments[1:]])
    assert isinstance(done.exception, hp.HingePairError)
    assert words in str(done.exception)
