"""`hingepair fit`."""

from __future__ import annotations

import json
import re

import numpy as np
from typer.testing import CliRunner

import hingepair as hp
from hingepair.cli.main import app
from hingepair.pair.results import Record
from support.recorded import HOME, recording

NOISE = re.compile(r"smoothed: noise of (0\.001|0\.0009\d) m of position, (0\.002|0\.0019) rad of attitude")


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


def test_a_scene_of_the_fitted_pair_moves_as_recorded(tmp_path):
    made = recording(600, 1e-3, 2e-3)
    scene = tmp_path / "fitted.toml"
    done = CliRunner().invoke(
        app, ["fit", saved(tmp_path / "a.npz", made), "--scene", str(scene), "--clock-offset", "0"]
    )
    assert done.exit_code == 0, done.output
    assert "clock offset: 0 +- 0 ms" in done.output
    assert f"written: {scene}" in done.output
    loaded = hp.load_scene(scene)
    assert any(NOISE.search(note) for note in loaded.motion.notes)
    result = loaded.evaluate(outputs=("R2", "S2", "v2", "alpha2"))
    inside = slice(50, -50)
    assert np.sqrt(np.mean((result.R2 - made.R2)[inside] ** 2)) < 2e-3
    exact = recording(600)
    assert np.sqrt(np.mean((result.R2 - exact.R2)[inside] ** 2)) < 1e-3
    slopes = np.gradient(exact.R2, exact.t, axis=0)
    assert np.sqrt(np.mean((result.v2 - slopes)[inside] ** 2)) < 0.05
    checked = CliRunner().invoke(app, ["check", str(scene), "--json"])
    assert checked.exit_code == 0, checked.output
    assert any("smoothed: noise of" in note for note in json.loads(checked.output)["notes"])


def test_a_known_clock_offset_is_printed_and_a_scene_needs_instants(tmp_path):
    made = recording(300, 1e-3, 2e-3)
    done = CliRunner().invoke(app, ["fit", saved(tmp_path / "a.npz", made)])
    assert "clock offset: " in done.output
    bad = CliRunner().invoke(app, ["fit", saved(tmp_path / "a.npz", made), "--scene", "x.json"])
    assert isinstance(bad.exception, hp.ArgumentError) or bad.exit_code == 2
