"""Every engine of `bench ik` reaches its targets, and what it misses is seen."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.bench import engines
from hingepair.bench import inverse_kinematics as bench

PYTHON = [method for method in bench.METHODS if method.name != engines.PINOCCHIO_CPP]


@pytest.mark.slow(4)
@pytest.mark.parametrize("method", PYTHON, ids=lambda method: method.name)
def test_engines_reach_targets(method):
    pytest.importorskip(method.package or "numpy")
    task = bench.make_task(*bench.load_models("ur5_robot"), 3)
    found = bench.outcome(task, method.make_job(task)()[0])
    assert found.loosely >= 0.6
    assert found.error <= bench.TOLERANCE


@pytest.mark.slow
def test_the_judge_sees_what_is_missed():
    task = bench.make_task(*bench.load_models("panda"), 4)
    q = bench.hingepair_job(task)()[0].copy()
    assert bench.outcome(task, q).solved == 1
    q[0, 2] += 1e-4
    q[1, 2] += 0.5
    q[2, 6] += 2 * np.pi  # the same pose, beyond the limit
    assert bench.outcome(task, q)[:2] == (0.25, 0.5)


@pytest.mark.slow
def test_the_report_draws_each_robot(monkeypatch):
    monkeypatch.setattr(bench, "METHODS", bench.METHODS[:1])
    report = bench.bench_inverse_kinematics(["ur5_robot", "panda"], 50, 1, with_cpp=False)
    assert [row.method for row in report.rows] == ["hingepair"] * 2
    assert all(row.extra_columns["solved"] == "100.00 %" for row in report.rows)
    assert [len(panels) for panels in report.panels] == [2, 2]
    assert report.panels[0][0].curves[0].points[0][1] == pytest.approx(0.01)  # of 50 targets no more is known
