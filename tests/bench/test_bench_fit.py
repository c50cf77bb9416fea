"""`hingepair bench fit`."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from hingepair.bench import fit as bench
from hingepair.cli.main import app


@pytest.mark.parametrize("method", [bench.fit_by_hingepair, bench.fit_by_constraints, bench.fit_by_equations])
def test_every_way_finds_the_hinge_that_was_recorded(method):
    line = method(bench.make_recording(60, 0.0, 0), "linear")
    made = bench.make_recording(60, 0.0, 0)
    Q = np.swapaxes(made.S1, -1, -2) @ made.S2
    assert np.abs(Q @ line.n_body2 - line.n).max() < 0.02
    gap = made.R1 + made.S1 @ line.u1 - made.R2 - made.S2 @ line.u2
    assert np.abs(gap).max() < 0.02
    assert bench.hinge_error(line) < 0.01


def test_theerror_of_column_sees_anerror_of():
    truth = bench.true_hinge()
    assert bench.hinge_error(truth) < 1e-15
    assert bench.hinge_error(truth._replace(n=-truth.n, n_body2=-truth.n_body2)) < 1e-15
    assert bench.hinge_error(truth._replace(u2=truth.u2 + 0.01)) > 0.003
    assert bench.hinge_error(truth._replace(u1=truth.u1 + truth.n)) < 1e-15  # along the axis it is free


@pytest.mark.slow
def test_the_command_prints_rows():
    done = CliRunner().invoke(app, ["bench", "fit", "--sizes", "50", "--repeats", "1", "--json"])
    assert done.exit_code == 0, done.output
    told = json.loads(done.stdout)
    assert {row["method"] for row in told["rows"]} == {
        bench.HINGEPAIR_FIT_NAME,
        bench.CONSTRAINTS_FIT_NAME,
        bench.EQUATIONS_FIT_NAME,
    }
