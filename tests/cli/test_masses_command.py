"""`hingepair masses`: masses of a robot from a recording in a file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.commands import refusal, run_command

LOAD = hp.HingeLoad(damping=0.3, friction=0.2)


def arm(payload: float = 0.0) -> hp.Mechanism:
    bar = hp.Body(2.0, (0.2, 0.0, 0.0), inertia=(0.02, 0.1, 0.1))
    pairs = [
        hp.HingePair(u1=(0, 0, 0.4), u2=(0, 0, 0), n=(0, 0, 1), name="post", body2=bar),
        hp.HingePair(u1=(0.4, 0, 0), u2=(0, 0, 0), n=(0, 1, 0), name="elbow", body2=bar),
    ]
    robot = hp.Mechanism(pairs, name="arm").with_joint_loads({"post": LOAD, "elbow": LOAD})
    return robot.with_payload("elbow", hp.Body(payload, (0.4, 0, 0), inertia=(1e-3,) * 3)) if payload else robot


@pytest.fixture
def files(tmp_path: Path) -> tuple[Path, Path]:
    """A URDF file, and a recording of the robot with a payload of 1 kg."""
    t = np.arange(0, 10, 0.02)
    phase = np.outer(t, (1.1, 2.3, 3.1, 4.7)).reshape(-1, 2, 2)
    rates = np.array(((1.1, 2.3), (3.1, 4.7)))
    q, qd, qdd = np.sin(phase).sum(-1), (rates * np.cos(phase)).sum(-1), -(rates**2 * np.sin(phase)).sum(-1)
    tau = arm(1.0).inverse_dynamics(q, qd, qdd, joint_loads=True).tau
    rng = np.random.default_rng(0)
    q, tau = q + 1e-4 * rng.normal(size=q.shape), tau + 0.01 * rng.normal(size=tau.shape)
    names = [f"{name}_{joint}" for name in ("q", "tau") for joint in ("post", "elbow")]
    rows = np.column_stack((t, q, tau))
    (tmp_path / "arm.urdf").write_text(hp.to_urdf(arm()))
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header=",".join(("t", *names)), comments="")
    return tmp_path / "arm.urdf", tmp_path / "log.csv"


@pytest.mark.slow
def test_masses_of_a_urdf_file_are_fitted_and_written(files: tuple[Path, Path], tmp_path: Path) -> None:
    out, picture = tmp_path / "fitted.urdf", tmp_path / "torques.svg"
    printed = run_command("masses", *files, "--physical", "--urdf", out, "--plot", picture).stdout
    assert "\nok\n" in printed
    assert f"written: {out}\nwritten: {picture}\n" in printed
    fitted, heavier, q = hp.Mechanism.from_urdf(out), arm(1.0), np.array((0.3, 0.7))
    np.testing.assert_allclose(fitted.gravity_forces(q), heavier.gravity_forces(q), rtol=0, atol=0.02)
    assert abs(fitted.joint_loads["elbow"].damping - 0.3) < 0.02
    report = json.loads(
        run_command("masses", *files, "--joint-terms", "viscous, coulomb", "--test", 0, "--json").stdout
    )
    assert report["ok"]
    assert report["samples"] == 500
    assert report["joints"]["post"]["rms_test"] is None
    upside_down = json.loads(run_command("masses", *files, "--gravity", "0,0,9.81", "--json", code=1).stdout)
    assert not upside_down["ok"]


def test_a_recording_that_does_not_determine_masses_fails(files: tuple[Path, Path], tmp_path: Path) -> None:
    text = files[1].read_text().splitlines()
    (tmp_path / "short.csv").write_text("\n".join(text[:40]))
    printed = run_command("masses", files[0], tmp_path / "short.csv", code=1).stdout
    assert "NOT RELIABLE" in printed


@pytest.mark.slow
def test_a_recording_in_other_units_has_the_same_masses(files: tuple[Path, Path], tmp_path: Path) -> None:
    urdf, log = files
    _, *rows = log.read_text().splitlines()
    values = np.array([row.split(",") for row in rows], float) * (1e3, *[180 / np.pi] * 2, *[1e3] * 2)
    german = tmp_path / "german.csv"
    heading = "Zeit;q_post [deg];Winkel;tau_post [N mm];Moment;Wetter"
    lines = [";".join([*(f"{v!r}".replace(".", ",") for v in row), "1"]) for row in values.tolist()]
    german.write_text("\n".join([heading, *lines]) + "\n")
    columns = ("t=Zeit:ms", "q_elbow=Winkel:deg", "tau_elbow=Moment:N mm")
    named = [part for column in columns for part in ("--column", column)]
    expected = json.loads(run_command("masses", urdf, log, "--json").stdout)
    found = json.loads(run_command("masses", urdf, german, *named, "--json").stdout)
    for name, own in expected["parameters"].items():
        assert found["parameters"][name]["value"] == pytest.approx(own["value"], rel=1e-6, abs=1e-9)
    message = refusal("masses", urdf, german, *named[:2])
    assert message.startswith(f"{german}: expected a column q_elbow")
    assert "columns.q_elbow.unit: expected one of rad, mrad, deg" in refusal(
        "masses", urdf, log, "--column", "q_elbow=q:mm"
    )
    lines = run_command("masses", urdf, log, "--units", "N mm, deg, mm").stdout.splitlines()
    shown = {line.split("  ")[0]: line.split("  ") for line in lines}
    for name, unit, factor in (
        ("elbow hx", "kg mm", 1e3),
        ("elbow Jyy", "kg mm^2", 1e6),
        ("post viscous", "N mm s/deg", 1e3 * np.pi / 180),
        ("post coulomb", "N mm", 1e3),
    ):
        _, its, value, *_ = filter(None, shown[name])
        assert its.strip() == unit
        assert float(value) == pytest.approx(factor * expected["parameters"][name]["value"], rel=1e-5)
    *_, noise = (float(line.split()[3]) for line in lines if line.startswith(("elbow  N mm ", "post   N mm ")))
    assert noise == pytest.approx(1e3 * expected["joints"]["elbow"]["noise"], rel=5e-3)
    assert refusal("masses", urdf, log, "--units", "furlong").startswith("--units: ")
