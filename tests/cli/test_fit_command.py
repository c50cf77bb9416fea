"""`hingepair fit`."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.results import Record
from support.commands import refusal, run_command
from support.drawn import drawn_texts
from support.near import U
from support.recorded import HOME, bodies, recording

NOISE = re.compile(r"smoothed: noise of (0\.001|0\.0009\d) m of position, (0\.002|0\.0019) rad of attitude")


def fit(*arguments, code=0):
    return run_command("fit", *arguments, code=code).stdout


def refused(*arguments):
    return refusal("fit", *arguments)


def saved(path, made):
    return str(Record(made.t, {"R1": made.R1, "S1": made.S1, "R2": made.R2, "S2": made.S2}).save(path))


@pytest.mark.slow
def test_the_hinge_of_a_file_is_told_written_and_drawn(tmp_path):
    made = recording(300, 1e-3, 2e-3)
    file, out, plot = saved(tmp_path / "a.npz", made), tmp_path / "psi.csv", tmp_path / "fit.svg"
    assert "u1" in fit(file, "--out", out, "--out", plot)
    written = np.genfromtxt(out, delimiter=",", names=True)
    assert np.ptp(written["psi"] - made.psi) < 0.05  # home is another than that of the recording
    assert np.median(written["psi_std"]) == pytest.approx(np.sqrt(2) * 2e-3, rel=0.1)
    assert {"psi", "gap", "tilt"} <= drawn_texts(plot)
    told = json.loads(fit(file, "--json", "--loss", "cauchy"))
    assert told["ok"] is True
    assert told["loss"] == "cauchy"


@pytest.mark.slow
def test_lengths_and_angles_are_in_the_units_that_are_asked_for(tmp_path):
    made = recording(300, 1e-3, 2e-3)
    file, out = saved(tmp_path / "a.npz", made), tmp_path / "psi.csv"
    shown = fit(file, "--units", "mm, mrad", "--out", out, "--clock-offset", 0)
    fitted = hp.fit(*bodies(made), t=made.t, clock_offset=0)
    both = zip(1e3 * fitted.pair.u1, 1e3 * fitted.std["u1"], strict=True)
    u1 = ", ".join(f"{value:.6g} +- {std:.2g}" for value, std in both)
    assert re.search(rf"u1 +{re.escape(u1)} +mm\n", shown)
    assert re.search(rf"rms_angle, left +{1e3 * fitted.rms_angle:.6g} +mrad\n", shown)
    doubtful = saved(tmp_path / "b.npz", recording(2000, slip=0.02 * np.sin(recording(2000).t)[:, None] * HOME[0]))
    assert re.search(r"by 1\d mm rms", fit(doubtful, "--units", "mm", code=1))  # findings, too
    heading, *rows = out.read_text(encoding="utf-8").splitlines()
    assert heading == "t [s],psi [mrad],psi_std [mrad],gap [mm],tilt [mrad],weight"
    assert float(rows[0].split(",")[3]) == pytest.approx(1e3 * fitted.gap[0], rel=4 * U)
    (line,) = hp.plot(fitted, units="um").axes[1].get_lines()
    np.testing.assert_allclose(line.get_ydata(), 1e6 * fitted.gap, rtol=64 * U)
    assert "--units: expected one of" in refused(file, "--units", "degrees")


@pytest.mark.slow
def test_what_shows_no_hinge_has_exit_code_1(tmp_path):
    fixed = saved(tmp_path / "fixed.csv", recording(300, Q=HOME))
    assert "a fixed pair" in fit(fixed, code=1)
    assert json.loads(fit(fixed, "--json", code=1))["ok"] is False
    slides = recording(300, slip=0.1 * np.sin(recording(300).t)[:, None] * (1, 2, -0.5))
    assert "slides along the axis" in fit(saved(tmp_path / "slides.csv", slides), code=1)


@pytest.mark.slow
def test_a_scene_of_the_fitted_pair_moves_as_recorded(tmp_path):
    made = recording(600, 1e-3, 2e-3)
    scene = tmp_path / "fitted.toml"
    shown = fit(saved(tmp_path / "a.npz", made), "--out", scene, "--clock-offset", 0)
    assert f"written: {scene}" in shown
    loaded = hp.load_scene(scene)
    assert any(NOISE.search(note) for note in loaded.motion.notes)
    result = loaded.evaluate(outputs=("R2", "S2", "v2", "alpha2"))
    inside = slice(50, -50)
    assert np.sqrt(np.mean((result.R2 - made.R2)[inside] ** 2)) < 2e-3  # m, of the noise, as below
    exact = recording(600)
    assert np.sqrt(np.mean((result.R2 - exact.R2)[inside] ** 2)) < 1e-3  # m, of noise of 1 mm in both bodies
    slopes = np.gradient(exact.R2, exact.t, axis=0)
    assert np.sqrt(np.mean((result.v2 - slopes)[inside] ** 2)) < 0.05
    checked = json.loads(run_command("check", scene, "--json").stdout)
    assert any("smoothed: noise of" in note for note in checked["notes"])
    fit(tmp_path / "a.npz", "--out", tmp_path / "robust.toml", "--clock-offset", 0, "--loss", "cauchy")
    assert 'smooth = true\nloss = "cauchy"\n' in (tmp_path / "robust.toml").read_text(encoding="utf-8")


def saved_columns(path, made, **columns):
    """Poses of body 1, and of body 2 what is given."""
    return Record(made.t, {"R1": made.R1, "S1": made.S1} | columns).save(path)


@pytest.mark.slow
def test_a_point_is_fitted_reported_and_moved_in_a_scene(tmp_path):
    made = recording(600, 1e-3, 2e-3)
    made.R2[200:203] = np.nan
    file = saved_columns(tmp_path / "a.npz", made, R2=made.R2)
    scene, out = tmp_path / "fitted.toml", tmp_path / "psi.csv"
    fit(file, "--out", scene, "--out", out)
    assert "tilt" not in np.genfromtxt(out, delimiter=",", names=True).dtype.names
    result = hp.load_scene(scene).evaluate(outputs=("R2",))
    assert np.sqrt(np.nanmean((result.R2 - recording(600).R2)[50:-50] ** 2)) < 3e-3  # m, of the noise of a point


@pytest.mark.parametrize("existing", ["door.toml", "door.csv"])
def test_a_scene_that_exists_is_kept_and_nothing_is_written(tmp_path, existing):
    file, out = saved(tmp_path / "poses.npz", recording(300)), tmp_path / "psi.csv"
    (tmp_path / existing).write_text("kept")
    error = refused(file, "--out", tmp_path / "door.toml", "--out", out)
    assert str(error).startswith("--out: expected the name of new files")
    assert (tmp_path / existing).read_text() == "kept"
    assert {path.name for path in tmp_path.iterdir()} == {"poses.npz", existing}


@pytest.mark.slow
def test_two_files_of_inertial_sensors_tell_the_hinge(tmp_path):
    t = np.arange(1000) / 100
    S1 = hp.rodrigues((1, 0, 0), np.sin(2 * t)) @ hp.rodrigues((0, 0, 1), np.cos(3 * t))
    files, rng = [], np.random.default_rng(0)
    for name, S in (("a.csv", S1), ("b.csv", S1 @ hp.rodrigues((0, 1, 0), np.sin(4 * t)))):
        omega = np.einsum("nji,nj->ni", S, hp.angular_velocity_from_samples(t, S))
        readings = np.hstack((t[:, None], np.degrees(omega), S[:, 2]))
        readings[:, 1:] += 1e-3 * rng.standard_normal((1000, 6))
        heading = ",".join(("t", *(f"gyr_{c}" for c in "xyz"), *(f"force_{c} [g]" for c in "xyz")))
        np.savetxt(tmp_path / name, readings, delimiter=",", header=heading, comments="")
        files.append(tmp_path / name)
    names = [f"--column=omega_{c}=gyr_{c}:deg/s" for c in "xyz"]
    told = json.loads(fit(*files, *names, "--json"))
    assert np.abs(np.array(told["n"]) - (0, 1, 0)).max() < 1e-3  # rad, of the noise of the readings
    assert abs(told["clock_offset"]) < 5 * told["std"]["clock_offset"]
    out, plot = tmp_path / "psi.csv", tmp_path / "psi.svg"
    assert "hinge of two inertial sensors" in fit(*files, *names, "--out", out, "--out", plot)
    psi = np.genfromtxt(out, delimiter=",", names=True)["psi"]
    assert np.ptp(psi - np.sin(4 * t)) < 0.02
    assert "--out: expected recordings of poses" in refused(*files, *names, "--out", tmp_path / "x.toml")
    assert "omega_x" in refused(*files)
    assert "two files of inertial sensors" in refused(files[0], *names)
