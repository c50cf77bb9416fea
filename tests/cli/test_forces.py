"""`hingepair forces`, and the forces of a scene."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.commands import refusal, run_command

MODELS = Path(__file__).parents[2] / "models"


def test_forces_of_a_scene_are_those_of_its_motion():
    scene = hp.load_scene(MODELS / "landing_gear.toml")
    found = scene.forces(gravity=(0, 0, 0))
    state = scene.evaluate(("S2", "R2", "a2", "omega2", "alpha2")).state
    body2 = scene.pair.body2
    lever = state.S2 @ body2.centre_of_mass
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


@pytest.mark.slow
def test_the_command_prints_and_writes_them(tmp_path):
    scene, out = MODELS / "landing_gear.toml", tmp_path / "forces.csv"
    shown = told(scene, "--out", out)
    assert "hinge_torque" in shown
    assert "max |.| at t" in shown
    columns = np.genfromtxt(out, delimiter=",", names=True)
    np.testing.assert_array_equal(columns["hinge_torque"], hp.load_scene(scene).forces().hinge_torque)
    report = json.loads(told(scene, "--gravity", "0,0,0", "--json"))
    assert report["outputs"]["force1_x"]["first"] == pytest.approx(1171 * 1.6, rel=0.1)


def scene_file(folder, text, log=None):
    """A scene of the given tables, beside a log of the given columns."""
    if log is not None:
        rows = np.stack(np.broadcast_arrays(*log.values()), axis=-1)
        lines = [",".join(log), *(",".join(map(repr, row)) for row in rows.tolist())]
        (folder / "log.csv").write_text("\n".join(lines) + "\n")
    path = folder / "scene.toml"
    path.write_text(text)
    return path


PENDULUM = """
[pair]
u1 = [0, 0, 0]
u2 = [-0.5, 0, 0]
n = [0, 1, 0]
torque_limit = 20
rate_limit = 3
[pair.body2]
mass = 4
inertia = [0.02, 0.3, 0.3]
"""
MOVED = """
[motion]
x = 0
y = 0
z = 0
phi_x = 0
phi_y = 0
phi_z = 0
psi = "{}"
[time]
start = 0
stop = 1
samples = 101
"""


def told(*arguments):
    return run_command("forces", *arguments).stdout


def test_instants_without_finite_forces_are_counted_and_left_out_of_the_ranges(tmp_path):
    path = scene_file(tmp_path, PENDULUM + MOVED.format("asin(t/0.615)"))
    output = told(path)
    assert "39 of 101 instants" in output
    report = json.loads(told(path, "--json"))
    torque = hp.load_scene(path).forces().hinge_torque
    finite = torque[np.isfinite(torque)]
    row = report["outputs"]["hinge_torque"]
    assert finite.size == 62
    assert (row["smallest"], row["largest"]) == (finite.min(), finite.max())
    assert row["rms"] == pytest.approx(np.sqrt(np.mean(finite**2)), rel=1e-14)
    assert row["t_of_largest_size"] == np.linspace(0, 1, 101)[np.nanargmax(np.abs(torque))]


DRIVEN = """
[dynamics]
base = "fixed"
psi.tau = "{}"
psi.stiffness = 2
psi.rest = 0.1
psi.damping = 0.3
psi.friction = 0.2
psi.stops = [-0.5, 0.5]
psi.stop_damping = 1
[time]
start = 0
stop = 1
samples = 101
"""


@pytest.mark.slow
def test_the_torque_about_the_hinge_axis_is_split_into_what_gives_it(tmp_path):
    path = scene_file(tmp_path, PENDULUM + DRIVEN.format("21*cos(3*t)"))
    scene = hp.load_scene(path)
    forces, t, (psi, psid) = scene.forces(), np.linspace(0, 1, 101), scene.motion.source.hinge[:2]
    beyond = -1e4 * (psi - np.clip(psi, -0.5, 0.5)) * np.maximum(1 + np.sign(psi) * psid, 0)
    parts = {
        "motor_torque": 21 * np.cos(3 * t),
        "spring_torque": -2 * (psi - 0.1),
        "damper_torque": -0.3 * psid,
        "friction_torque": -0.2 * np.where(t == 0, 1, np.sign(psid)),  # it sets off upwards
        "stop_torque": beyond,
    }
    assert beyond.any()
    assert list(forces.recorded())[:6] == ["hinge_torque", *parts]
    for name, torque in parts.items():
        np.testing.assert_allclose(forces[name], torque, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(sum(parts.values()), forces.hinge_torque, rtol=1e-9, atol=1e-9)
    output = told(path)
    rows = [line.split()[:3] for line in output.splitlines() if re.match(r" *\w+_torque +N m", line)]
    assert rows == [[name, "N", "m"] for name in ("hinge_torque", *parts)]
    beyond = (np.abs(parts["motor_torque"]) > 20).sum()
    words = " ".join(output.split())
    assert re.search(rf"note: motor_torque .*torque_limit, 20 N m, .*{beyond} of 101 .* 0 s \(21\)", words)
    assert not re.search(r"note: hinge_torque .*torque_limit", words)


LOADS = """
[dynamics]
psi.stiffness = 2
psi.rest = 0.1
psi.damping = 0.3
psi.friction = 0.2
psi.stops = [-0.5, 0.3]
gravity = [0, 0, -3]
"""


def test_the_motor_does_what_loads_beside_a_given_psi_do_not(tmp_path):
    path = scene_file(tmp_path, PENDULUM.replace("20", "300") + MOVED.format("0.4*sin(3*t)**2") + LOADS)
    scene = hp.load_scene(path)
    forces, (psi, psid) = scene.forces(), scene.motion.source.part(slice(None), 1).hinge
    parts = {
        "motor_torque": forces.motor_torque,
        "spring_torque": -2 * (psi - 0.1),
        "damper_torque": -0.3 * psid,
        "friction_torque": -0.2 * np.sign(psid),
        "stop_torque": -1e4 * np.maximum(psi - 0.3, 0),
    }
    assert list(forces.recorded())[:6] == ["hinge_torque", *parts]
    for name, torque in parts.items():
        np.testing.assert_allclose(forces[name], torque, rtol=1e-14, atol=1e-12)
    np.testing.assert_allclose(sum(parts.values()), forces.hinge_torque, rtol=1e-12, atol=1e-10)
    plain = scene_file(tmp_path, PENDULUM + MOVED.format("0.4*sin(3*t)**2"))
    np.testing.assert_array_equal(hp.load_scene(plain).forces((0, 0, -3)).hinge_torque, forces.hinge_torque)
    path.write_text(PENDULUM + MOVED.format("0.4*sin(3*t)**2") + LOADS)
    output = " ".join(told(path).split())
    assert "gravity = (0, 0, -3) m/s^2" in output
    assert (
        "note: friction_torque is 0 at 1 of 101 instants, where psi' is 0; friction may hold up to 0.2 N m" in output
    )
    assert "note: motor_torque exceeds the torque_limit, 20 N m" in output
    assert "--gravity: expected None, since the table [dynamics]" in refusal("forces", path, "--gravity", "0,0,1")
    assert scene.arrays(("motor_torque",))["motor_torque"].shape == (101,)
    assert scene.cross_validate(20).ok
