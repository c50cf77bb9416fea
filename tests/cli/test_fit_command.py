"""`hingepair fit`."""

from __future__ import annotations

import json

import numpy as np
from typer.testing import CliRunner

from hingepair.cli.main import app
from hingepair.pair.results import Record
from support.recorded import HOME, recording


def saved(path, made):
    return str(Record(made.t, {"R1": made.R1, "S1": made.S1, "R2": made.R2, "S2": made.S2}).save(path))


def test_the_hinge_of_a_file_is_told_written_and_drawn(tmp_path):
    made = recording(300, 1e-3, 2e-3)
    file, out, plot = saved(tmp_path / "a.npz", made), tmp_path / "psi.csv", tmp_path / "fit.png"
    done = CliRunner().invoke(app, ["fit", file, "--out", str(out), "--plot", str(plot)])
    assert done.exit_code == 0, done.output
    assert "u1 = (" in done.output
    psi = np.genfromtxt(out, delimiter=",", names=True)["psi"]
    assert np.ptp(psi - made.psi) < 0.05  # home is another than that of the recording
    assert plot.read_bytes().startswith(b"\x89PNG")
    told = json.loads(CliRunner().invoke(app, ["fit", file, "--json", "--loss", "cauchy"]).output)
    assert told["ok"] is True
    assert told["loss"] == "cauchy"


def test_what_shows_no_hinge_has_exit_code_1(tmp_path):
    fixed = saved(tmp_path / "fixed.csv", recording(300, Q=HOME))
    done = CliRunner().invoke(app, ["fit", fixed])
    assert done.exit_code == 1
    assert "a fixed pair" in done.output
    assert json.loads(CliRunner().invoke(app, ["fit", fixed, "--json"]).output)["ok"] is False
    slides = recording(300, slip=0.1 * np.sin(recording(300).t)[:, None] * (1, 2, -0.5))
    done = CliRunner().invoke(app, ["fit", saved(tmp_path / "slides.csv", slides)])
    assert done.exit_code == 1
    assert "slides along the axis" in done.output
