"""Logs as others write them: names, units, signs, decimal commas, dates, headings, repeated stamps, the plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import hingepair as hp
from support.near import assert_near
from support.scenes import logged

SCENE = logged([-1.5, 0, 0], [4, 0, 0], [0, 0, 1])
COLUMNS = """
[motion.columns]
t = "Zeit"
x = { name = "Ost", unit = "km" }
y = "Nord"
phi_z = { name = "Kurs", unit = "compass" }
psi = { name = "Knick", unit = "-deg" }
"""
T = np.linspace(0, 2, 41)
X, Y, HEADING, KINK = 3 * T, 2 + T**2, 350 + 10 * T, 4 * T


def stamp(t: float, zone: str) -> str:
    return f"2026-11-23T10:00:{t:09.6f}{zone}"


def german(*, rows: slice = slice(None), zone: str = "+01:00", repeat: int | None = None) -> str:
    numbers = zip(T, 1e-3 * X, Y, HEADING % 360, KINK, strict=True)
    lines = [
        ";".join([stamp(t, zone), *(f"{value:.12f}".replace(".", ",") for value in values), "fein"])
        for t, *values in numbers
    ][rows]
    if repeat is not None:
        lines.insert(repeat, lines[repeat])
    return "\n".join(["Zeit;Ost;Nord;Kurs;Knick;Wetter", *lines, ""])


def load(folder: Path, text: str, columns: str = COLUMNS, encoding: str = "utf-8") -> hp.scenes.scene.Scene:
    (folder / "log.csv").write_text(text, encoding=encoding)
    (folder / "scene.toml").write_text(SCENE + columns, encoding="utf-8")
    return hp.load_scene(folder / "scene.toml")


def test_a_german_log_is_that_of_the_same_motion_in_si_units(tmp_path: Path) -> None:
    scene = load(tmp_path, german())
    state = scene.evaluate(("R1", "S1", "psi"))
    assert_near(scene.t, T, 4)
    assert_near(state.R1, np.stack([X, Y, 0 * T], axis=1), 16)
    ahead = np.radians(90 - HEADING)
    assert_near(state.S1[:, :2, 0], np.stack([np.cos(ahead), np.sin(ahead)], axis=1), 16)
    assert_near(state.psi, -np.radians(KINK), 16)
    notes = " ".join(scene.notes())
    assert "columns that were not read: Wetter" in notes
    assert "no column was named for z, phi_x, phi_y: they were taken as 0" in notes
    assert "2026-11-23T09:00:00" in notes  # in UTC


def test_repeated_stamps_are_left_out_and_told(tmp_path: Path) -> None:
    scene = load(tmp_path, german(repeat=7))
    assert len(scene.t) == len(T)
    assert "1 row has the stamp of the row before and was left out, the first in line 10" in scene.notes()
    plain = load(tmp_path, german())
    np.testing.assert_array_equal(scene.evaluate(("R2",)).R2, plain.evaluate(("R2",)).R2)


def test_a_data_frame_stands_for_the_file_of_a_scene(tmp_path: Path) -> None:
    from_file = load(tmp_path, german(repeat=4))
    frame = pd.read_csv(tmp_path / "log.csv", sep=";", decimal=",", parse_dates=["Zeit"])
    path = tmp_path / "scene.toml"
    (tmp_path / "log.csv").unlink()
    path.write_text(path.read_text().replace('file = "log.csv"', ""), encoding="utf-8")
    for log in (frame, frame.set_index("Zeit"), frame.to_xarray().swap_dims(index="Zeit")):
        scene = hp.load_scene(path, log=log)
        np.testing.assert_array_equal(scene.evaluate().R2, from_file.evaluate().R2)
        kind = "DataFrame" if isinstance(log, pd.DataFrame) else "Dataset"
        assert any("columns that were not read: " in note and "Wetter" in note for note in scene.motion.notes), kind
        assert any("the first in sample 5" in note for note in scene.motion.notes)
        assert scene.files == (path.absolute(),)
    with pytest.raises(hp.SceneError, match=r"motion\.columns\.psi: expected one of .* got 'Knick'"):
        hp.load_scene(path, log=frame.drop(columns="Knick"))
    with pytest.raises(hp.ArgumentError, match="log: expected the path of a file, a pandas DataFrame"):
        hp.load_scene(path, log=3)
