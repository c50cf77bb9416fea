"""`hingepair forces`, and the forces of a scene."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.commands import run_command
from support.near import U
from support.scenes import moved, toml

MODELS = Path(__file__).parents[2] / "models"


def scene_file(folder, text, log=None):
    """A scene of the given tables, beside a log of the given columns."""
    if log is not None:
        rows = np.stack(np.broadcast_arrays(*log.values()), axis=-1)
        lines = [",".join(log), *(",".join(map(repr, row)) for row in rows.tolist())]
        (folder / "log.csv").write_text("\n".join(lines) + "\n")
    path = folder / "scene.toml"
    path.write_text(text)
    return path


PENDULUM = toml("pair", u1=[0, 0, 0], u2=[-0.5, 0, 0], n=[0, 1, 0], torque_limit=20, rate_limit=3)
PENDULUM += toml("pair.body2", mass=4, inertia=[0.02, 0.3, 0.3])
MOVED = moved(0, 1, 101, psi="{}")


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
    assert row["rms"] == pytest.approx(np.sqrt(np.mean(finite**2)), rel=64 * U)
    assert row["t_of_largest_size"] == np.linspace(0, 1, 101)[np.nanargmax(np.abs(torque))]


SPRING = {"psi.stiffness": 2, "psi.rest": 0.1, "psi.damping": 0.3, "psi.friction": 0.2}
LOADS = toml("dynamics", SPRING | {"psi.stops": [-0.5, 0.3], "psi.stop_damping": 1})
DRIVEN = LOADS + 'psi.tau = "21*cos(3*t)"\nbase = "fixed"\n[time]\nstart = 0\nstop = 1\nsamples = 101\n'
GIVEN = MOVED.format("0.4*sin(3*t)**2") + LOADS + "gravity = [0, 0, -3]\n"


@pytest.mark.slow
@pytest.mark.parametrize("text", [DRIVEN, GIVEN], ids=["simulated", "given"])
def test_the_torque_about_the_hinge_axis_is_split_into_what_gives_it(tmp_path, text):
    """Of a psi that is given, the motor does what the loads beside it do not."""
    path = scene_file(tmp_path, PENDULUM + text)
    scene = hp.load_scene(path)
    forces, (psi, psid) = scene.forces(), scene.motion.source.part(slice(None), 1).hinge
    parts = {
        "motor_torque": 21 * np.cos(3 * scene.t) if text is DRIVEN else forces.motor_torque,
        "spring_torque": -2 * (psi - 0.1),
        "damper_torque": -0.3 * psid,
        "friction_torque": -0.2 * np.where((psid == 0) & (text is DRIVEN), 1, np.sign(psid)),  # it sets off upwards
        "stop_torque": -1e4 * (psi - np.clip(psi, -0.5, 0.3)) * np.maximum(1 + np.sign(psi) * psid, 0),
    }
    assert parts["stop_torque"].any()
    assert list(forces.recorded())[:7] == ["psi", "hinge_torque", *parts]
    for name, torque in parts.items():
        np.testing.assert_allclose(forces[name], torque, rtol=512 * U, atol=8192 * U)
    np.testing.assert_allclose(sum(parts.values()), forces.hinge_torque, rtol=512 * U, atol=8192 * U)
    output = told(path)
    rows = [line.split()[:3] for line in output.splitlines() if re.match(r" *\w+_torque +N m", line)]
    assert rows == [[name, "N", "m"] for name in ("hinge_torque", *parts)]
    assert "more than its limit of 20" in " ".join(output.split())
    if text is GIVEN:
        plain = scene_file(tmp_path, PENDULUM + MOVED.format("0.4*sin(3*t)**2"))
        np.testing.assert_array_equal(hp.load_scene(plain).forces((0, 0, -3)).hinge_torque, forces.hinge_torque)
        assert "gravity = (0, 0, -3) m/s^2" in output
        assert scene.cross_validate(20).ok
