"""`hingepair masses`: masses of a robot from a recording in a file."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.commands import run_command

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
    out = tmp_path / "fitted.urdf"
    printed = run_command("masses", *files, "--out", out).stdout
    assert "\nok\n" in printed
    assert f"written: {out}\n" in printed
    fitted, heavier, q = hp.Mechanism.from_urdf(out), arm(1.0), np.array((0.3, 0.7))
    np.testing.assert_allclose(
        fitted.gravity_forces(q), heavier.gravity_forces(q), rtol=0, atol=0.02
    )  # N m, of the noise
    assert abs(fitted.joint_loads["elbow"].damping - 0.3) < 0.02
    report = json.loads(run_command("masses", *files, "--joint-terms", "viscous, coulomb", "--json").stdout)
    assert report["ok"]
    upside_down = json.loads(run_command("masses", *files, "--gravity", "0,0,9.81", "--json", code=1).stdout)
    assert not upside_down["ok"]


def test_a_recording_that_does_not_determine_masses_fails(files: tuple[Path, Path], tmp_path: Path) -> None:
    text = files[1].read_text().splitlines()
    (tmp_path / "short.csv").write_text("\n".join(text[:40]))
    printed = run_command("masses", files[0], tmp_path / "short.csv", code=1).stdout
    assert "NOT RELIABLE" in printed
