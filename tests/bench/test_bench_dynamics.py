"""The bench of dynamics: all ways compute the same, and its textbook is not ours."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from hingepair.bench import dynamics as bench
from hingepair.cli.main import app

PAIR = bench.bodies()


@pytest.mark.slow
@pytest.mark.parametrize("inverse", [True, False], ids=[bench.INVERSE, bench.FORWARD])
def test_all_ways_compute_the_same(inverse):
    many, one = bench.task_of(PAIR, inverse, 5), bench.task_of(PAIR, inverse, 1)
    own = np.swapaxes(many.body1.S, -1, -2)

    def turned(vectors):
        return (own @ vectors[..., None])[..., 0]

    first, second, third = bench.ours(many)()
    near = {"rtol": 0, "atol": 1e-10}
    theirs, mujoco = bench.pinocchio_loop(many)(), bench.mujoco_loop(many)()
    np.testing.assert_allclose(mujoco, np.concatenate([first, turned(second), third[:, None]], -1), **near)
    drift = 0 if inverse else np.cross(many.body1.omega, many.body1.v)  # Pinocchio's is the spatial acceleration
    np.testing.assert_allclose(
        theirs, np.concatenate([turned(first - drift), turned(second), third[:, None]], -1), **near
    )
    for found, expected in zip(bench.prepared(one)(), bench.ours(one)(), strict=True):
        np.testing.assert_allclose(found, expected[0], **near)


def test_the_textbook_is_newton_and_euler():
    motion = bench.task_of(PAIR, True, 1)
    psi, psid, _ = motion.hinge[:, 0]
    one = motion.body1
    y = np.concatenate([one.R[0], np.roll(motion.rows[0][0, 3:7], 1), [psi], one.v[0], one.omega[0], [psid]])
    slopes = bench.textbook(PAIR, lambda _: 0.7)(0.0, y)
    found = PAIR.forward_dynamics(one, psi, psid, hinge_torque=0.7)
    np.testing.assert_allclose(
        slopes[8:], np.concatenate([found.a1[0], found.alpha1[0], found.psidd]), rtol=0, atol=1e-11
    )
    np.testing.assert_allclose(slopes[:3], one.v[0])


@pytest.mark.slow
def test_the_command_reports_a_simulation(monkeypatch):
    monkeypatch.setattr(bench, "_TIME", np.linspace(0, 0.1, 3))
    done = CliRunner().invoke(app, ["bench", "dynamics", "--samples", "10", "--repeats", "1", "--json"])
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert {bench.SIMULATION, bench.case_of(bench.INVERSE, 1)} < {row["case"] for row in report["rows"]}
    errors = [row["error"] for row in report["rows"] if row["case"] == bench.SIMULATION]
    assert len(errors) == 2
    assert max(errors) <= bench.GOAL
    stiff = [row for row in report["rows"] if row["case"] == bench.STIFF_SIMULATION]
    assert [row["method"] for row in stiff] == [bench.OURS, bench.RADAU, bench.LSODA]
    assert max(row["error"] for row in stiff) <= bench.GOAL
