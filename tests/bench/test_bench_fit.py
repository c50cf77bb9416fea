"""`hingepair bench fit`."""

from __future__ import annotations

import json
from importlib.util import find_spec

import numpy as np
import pytest

from hingepair.bench import fit as bench
from support.commands import run_command


@pytest.mark.parametrize("method", [bench.fit_by_hingepair, bench.fit_by_constraints])
def test_every_way_finds_the_hinge_that_was_recorded(method):
    line = method(bench.record_poses(60, 0.0, 0), "linear")
    made = bench.record_poses(60, 0.0, 0)
    Q = np.swapaxes(made.S1, -1, -2) @ made.S2
    assert np.abs(Q @ line.n_body2 - line.n).max() < 0.02
    gap = made.R1 + made.S1 @ line.u1 - made.R2 - made.S2 @ line.u2
    assert np.abs(gap).max() < 0.02
    assert bench.hinge_error(line) < 0.01


def test_the_column_of_errors_sees_an_error():
    truth = bench.true_hinge()
    assert bench.hinge_error(truth) < 1e-15
    assert bench.hinge_error(truth._replace(n=-truth.n, n_body2=-truth.n_body2)) < 1e-15
    assert bench.hinge_error(truth._replace(u2=truth.u2 + 0.01)) > 0.003
    assert bench.hinge_error(truth._replace(u1=truth.u1 + truth.n)) < 1e-15  # along the axis it is free


@pytest.mark.slow
def test_the_command_prints_rows():
    told = json.loads(run_command("bench", "fit", "--sizes", 50, "--repeats", 1, "--json").stdout)
    assert {row["method"] for row in told["rows"]} == {
        "hingepair.fit",
        "least_squares on E1, E2",
        *(method.name for method in bench.AXIS_METHODS if not method.package or find_spec(method.package)),
    }


@pytest.mark.proof
def test_an_absent_qmt_is_said(monkeypatch):
    monkeypatch.setattr("hingepair.bench.harness.find_spec", lambda _: None)
    report = bench.bench_fit([50], 1)
    assert {row.method for row in report.rows if row.case.startswith("axis")} == {"hingepair.fit_axis"}
    assert "left out: qmt, gyroscopes alone (qmt is not installed)" in report.notes
    assert "pip install qmt" in report.notes[-1]


@pytest.mark.slow
@pytest.mark.parametrize("bias", [0.0, 0.02])
def test_gyroscopes_read_rates_about_the_axis_that_errors_are_counted_from(bias):
    """Across the axis both bodies turn alike, and the biases are what they read beside."""
    made = bench.record_inertial(4000, bias, 1)
    truth = bench.true_hinge()
    across = [
        np.linalg.norm(np.cross(w, n), axis=1) for w, n in ((made.omega1, truth.n), (made.omega2, truth.n_body2))
    ]
    off = across[0] - across[1]
    assert np.sqrt(np.mean(off**2)) == pytest.approx(
        np.sqrt(2) * bench.GYROSCOPE_NOISE, rel=0.05 if bias == 0 else 1.5
    )
    assert np.abs(np.linalg.norm(made.f1.mean(axis=0))) < 9.81
    error, wrong = bench.axis_errors(*bench.axis_by_hingepair(made, bias))
    assert error < 2e-3
    assert not wrong
    assert bench.axis_errors(truth.n, -truth.n_body2) == (0.0, True)
    turned = truth.n + np.array((0.01, 0, 0))
    assert bench.axis_errors(turned, truth.n_body2)[0] == pytest.approx(0.01)


@pytest.mark.parametrize("method", [bench.axis_by_qmt_gyroscopes, bench.axis_by_qmt])
def test_qmt_finds_the_axis(method, capsys):
    pytest.importorskip("qmt")
    made = bench.record_inertial(2000, 0.0, 1)
    assert bench.axis_errors(*method(made, 0.0))[0] < 0.02
    assert capsys.readouterr().out == ""
