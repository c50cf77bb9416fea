"""Logs as others write them: names, units, signs, decimal commas, dates, headings, repeated stamps, the plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hingepair as hp

SCENE = """
[pair]
u1 = [-1.5, 0, 0]
u2 = [4, 0, 0]
n = [0, 0, 1]
[motion]
file = "log.csv"
differentiate = true
"""
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


def load(folder: Path, text: str, columns: str = COLUMNS) -> hp.scenes.scene.Scene:
    (folder / "log.csv").write_text(text)
    (folder / "scene.toml").write_text(SCENE + columns)
    return hp.load_scene(folder / "scene.toml")


def test_a_german_log_is_that_of_the_same_motion_in_si_units(tmp_path: Path) -> None:
    scene = load(tmp_path, german())
    state = scene.evaluate(("R1", "S1", "psi", "v1"))
    np.testing.assert_allclose(scene.t, T, atol=1e-9)
    np.testing.assert_allclose(state.R1, np.stack([X, Y, 0 * T], axis=1), atol=1e-9)
    ahead = np.radians(90 - HEADING)
    np.testing.assert_allclose(state.S1[:, :2, 0], np.stack([np.cos(ahead), np.sin(ahead)], axis=1), atol=1e-9)
    np.testing.assert_allclose(state.psi, -np.radians(KINK), atol=1e-9)
    np.testing.assert_allclose(state.v1[:, 1], 2 * T, atol=1e-7)
    notes = " ".join(scene.notes())
    assert "columns that were not read: Wetter" in notes
    assert "the log has no z, phi_x, phi_y: they were taken as 0" in notes
    assert "2026-11-23T09:00:00" in notes  # in UTC


def test_repeated_stamps_are_left_out_and_told(tmp_path: Path) -> None:
    scene = load(tmp_path, german(repeat=7))
    assert len(scene.t) == len(T)
    assert "1 row has the stamp of the row before and was left out, the first in line 10" in scene.notes()
    plain = load(tmp_path, german())
    np.testing.assert_array_equal(scene.evaluate(("R2",)).R2, plain.evaluate(("R2",)).R2)


def test_a_log_of_two_kinds_of_units_and_a_robot(tmp_path: Path) -> None:
    robot = hp.Mechanism([hp.HingePair((0, 0, 1), (-1, 0, 0), (0, 1, 0), name="boom"),
                          hp.Slider((0, 0, 0), (0, 0, 0), (1, 0, 0), name="stick")])  # fmt: skip
    (tmp_path / "crane.urdf").write_text(hp.to_urdf(robot))
    (tmp_path / "log.csv").write_text("time,B,S\n" + "".join(f"{100 * k},{k},{10 * k}\n" for k in range(9)))
    (tmp_path / "crane.toml").write_text(
        '[mechanism]\nurdf = "crane.urdf"\n[motion]\nfile = "log.csv"\n[motion.columns]\n'
        't = { name = "time", unit = "ms" }\nboom = { name = "B", unit = "deg" }\n'
        'stick = { name = "S", unit = "mm" }\n'
    )
    scene = hp.load_scene(tmp_path / "crane.toml")
    q = scene.evaluate(("q",)).q
    k = np.arange(9)
    np.testing.assert_allclose(scene.t, 0.1 * k, atol=1e-12)
    np.testing.assert_allclose(q, np.stack([np.radians(k), 0.01 * k], axis=1), atol=1e-15)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ('t = "Zei"', r"motion.columns.t: expected one of Zeit, Ost.* \(nearest: Zeit\), got 'Zei'"),
        ('psy = "Knick"', r"columns.psy: expected .*\(nearest: psi\)"),
        ('psi = { name = "Knick", unit = "degrees" }', r"columns.psi.unit: .*deg, turn, compass"),
        ('x = { name = "Ost", unit = "compass" }', r"columns.x.unit: expected one of m, mm"),
        ("x = 3", r"columns.x: expected the name of a column"),
    ],
)
def test_columns_that_cannot_be_used_are_named(columns: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(hp.SceneError, match=message):
        load(tmp_path, german(), f"[motion.columns]\n{columns}\n")


def test_a_date_that_is_none_is_named(tmp_path: Path) -> None:
    text = german().replace(stamp(T[3], "+01:00"), "23.11.2026 10:00")
    with pytest.raises(hp.SceneError, match=r"line 5: Zeit: expected a date such as"):
        load(tmp_path, text)
