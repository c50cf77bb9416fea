"""The bench of dynamics: all methods compute the same, and its textbook is not ours."""

from __future__ import annotations

import functools
import json

import numpy as np
import pytest

from hingepair.bench import dynamics as bench
from hingepair.bench import engines
from support.commands import run_command

PAIR = bench.make_pair()


@pytest.mark.slow
@pytest.mark.parametrize("workload", [bench.INVERSE, bench.FORWARD])
def test_all_ways_compute_the_same(workload):
    many, one = bench.make_task(PAIR, workload, 5), bench.make_task(PAIR, workload, 1)
    own = np.swapaxes(many.body1.S, -1, -2)

    def turned(vectors):
        return (own @ vectors[..., None])[..., 0]

    first, second, third = bench.hingepair_job(many)()
    near = {"rtol": 0, "atol": 1e-10}
    (theirs,), (mujoco,) = engines.pinocchio_job(many.states)(), engines.mujoco_job(many.states)()
    np.testing.assert_allclose(mujoco, np.concatenate([first, turned(second), third[:, None]], -1), **near)
    drift = (
        0 if workload == bench.INVERSE else np.cross(many.body1.omega, many.body1.v)
    )  # Pinocchio's is the spatial acceleration
    np.testing.assert_allclose(
        theirs, np.concatenate([turned(first - drift), turned(second), third[:, None]], -1), **near
    )
    for found, expected in zip(bench.prepared_job(one)(), bench.hingepair_job(one)(), strict=True):
        np.testing.assert_allclose(found, expected[0], **near)


@pytest.mark.slow
def test_the_textbook_is_newton_and_euler():
    motion = bench.make_task(PAIR, bench.INVERSE, 1)
    psi, psid, _ = motion.hinge[:, 0]
    one = motion.body1
    y = np.concatenate([one.R[0], np.roll(motion.states.rows[0][0, 3:7], 1), [psi], one.v[0], one.omega[0], [psid]])
    slopes = bench.newton_euler_rates(PAIR, lambda _: 0.7)(0.0, y)
    found = PAIR.forward_dynamics(one, psi, psid, hinge_torque=0.7)
    np.testing.assert_allclose(
        slopes[8:], np.concatenate([found.a1[0], found.alpha1[0], found.psidd]), rtol=0, atol=1e-11
    )
    np.testing.assert_allclose(slopes[:3], one.v[0])


@pytest.mark.proof
def test_the_command_reports_simulations(monkeypatch):
    monkeypatch.setattr(bench, "tumbling_case", functools.partial(bench.tumbling_case, duration=0.1))
    report = json.loads(run_command("bench", "dynamics", "--samples", 10, "--repeats", 1, "--json").stdout)
    methods = {}
    for row in report["rows"]:
        methods.setdefault(row["case"].partition(",")[0], set()).add(row["method"])
        assert row["error"] is None or row["error"] <= bench.MAX_ERROR
    assert methods.keys() == {bench.INVERSE, bench.FORWARD, "simulation of 0.1 s", "simulation of stiff friction"}
    assert methods["simulation of 0.1 s"] == {"hingepair", "SciPy DOP853, NumPy"}
    assert methods["simulation of stiff friction"] == {"hingepair", "SciPy Radau", "SciPy LSODA"}
