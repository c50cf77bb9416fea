"""The bench of dynamics: all methods compute the same, and its textbook is not ours."""

from __future__ import annotations

import json

import numpy as np
import pytest

from hingepair.bench import dynamics as bench
from support.commands import run_command

PAIR = bench.make_pair_with_masses()


@pytest.mark.slow
@pytest.mark.parametrize("inverse", [True, False], ids=[bench.INVERSE_WORKLOAD, bench.FORWARD_WORKLOAD])
def test_all_ways_compute_the_same(inverse):
    many, one = bench.make_dynamics_task(PAIR, inverse, 5), bench.make_dynamics_task(PAIR, inverse, 1)
    own = np.swapaxes(many.body1.S, -1, -2)

    def turned(vectors):
        return (own @ vectors[..., None])[..., 0]

    first, second, third = bench.hingepair_dynamics_job(many)()
    near = {"rtol": 0, "atol": 1e-10}
    theirs, mujoco = bench.pinocchio_dynamics_job(many)(), bench.mujoco_dynamics_job(many)()
    np.testing.assert_allclose(mujoco, np.concatenate([first, turned(second), third[:, None]], -1), **near)
    drift = 0 if inverse else np.cross(many.body1.omega, many.body1.v)  # Pinocchio's is the spatial acceleration
    np.testing.assert_allclose(
        theirs, np.concatenate([turned(first - drift), turned(second), third[:, None]], -1), **near
    )
    for found, expected in zip(bench.prepared_dynamics_job(one)(), bench.hingepair_dynamics_job(one)(), strict=True):
        np.testing.assert_allclose(found, expected[0], **near)


def test_the_textbook_is_newton_and_euler():
    motion = bench.make_dynamics_task(PAIR, True, 1)
    psi, psid, _ = motion.hinge[:, 0]
    one = motion.body1
    y = np.concatenate([one.R[0], np.roll(motion.rows[0][0, 3:7], 1), [psi], one.v[0], one.omega[0], [psid]])
    slopes = bench.newton_euler_rates(PAIR, lambda _: 0.7)(0.0, y)
    found = PAIR.forward_dynamics(one, psi, psid, hinge_torque=0.7)
    np.testing.assert_allclose(
        slopes[8:], np.concatenate([found.a1[0], found.alpha1[0], found.psidd]), rtol=0, atol=1e-11
    )
    np.testing.assert_allclose(slopes[:3], one.v[0])


@pytest.mark.slow
def test_the_command_reports_a_simulation(monkeypatch):
    monkeypatch.setattr(bench, "_TUMBLING_SIMULATION_INSTANTS_SECONDS", np.linspace(0, 0.1, 3))
    report = json.loads(run_command("bench", "dynamics", "--samples", 10, "--repeats", 1, "--json").stdout)
    assert {bench.TUMBLING_SIMULATION_CASE_NAME, bench.case_name(bench.INVERSE_WORKLOAD, 1)} < {
        row["case"] for row in report["rows"]
    }
    errors = [row["error"] for row in report["rows"] if row["case"] == bench.TUMBLING_SIMULATION_CASE_NAME]
    assert len(errors) == 2
    assert max(errors) <= bench.MAX_SIMULATION_ERROR_RAD
    stiff = [row for row in report["rows"] if row["case"] == bench.STIFF_SIMULATION_CASE_NAME]
    assert [row["method"] for row in stiff] == [bench.HINGEPAIR_NAME, bench.RADAU_NAME, bench.LSODA_NAME]
    assert max(row["error"] for row in stiff) <= bench.MAX_SIMULATION_ERROR_RAD
