"""Logs as others write them: names, units, signs, decimal commas, dates, headings, repeated stamps, the plane."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import hingepair as hp

SCENE = """
[pair]
u1 = [-1.5, 0, 0]
u2 = [4, 0, 0]
n = [0, 0, 1]
[motion]
file = "log.csv"
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


def load(folder: Path, text: str, columns: str = COLUMNS, encoding: str = "utf-8") -> hp.scenes.scene.Scene:
    (folder / "log.csv").write_text(text, encoding=encoding)
    (folder / "scene.toml").write_text(SCENE + columns, encoding="utf-8")
    return hp.load_scene(folder / "scene.toml")


def test_a_german_log_is_that_of_the_same_motion_in_si_units(tmp_path: Path) -> None:
    scene = load(tmp_path, german())
    state = scene.evaluate(("R1", "S1", "psi"))
    np.testing.assert_allclose(scene.t, T, atol=1e-9)
    np.testing.assert_allclose(state.R1, np.stack([X, Y, 0 * T], axis=1), atol=1e-9)
    ahead = np.radians(90 - HEADING)
    np.testing.assert_allclose(state.S1[:, :2, 0], np.stack([np.cos(ahead), np.sin(ahead)], axis=1), atol=1e-9)
    np.testing.assert_allclose(state.psi, -np.radians(KINK), atol=1e-9)
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
        ('psi = { name = "Knick", unit = "degrees" }', r"columns.psi.unit: .*deg, turn, or one of them with"),
        ('phi_z = { name = "Kurs", unit = "degrees" }', r"columns.phi_z.unit: .*deg, turn, compass"),
        (
            'psi = { name = "Knick", unit = "compass" }',
            r"psi.unit: .* a turn about z is a heading, such as phi_z",
        ),
        ('phi_x = { name = "Kurs", unit = "compass" }', r"phi_x.unit: .* a turn about z is a heading, such as phi_z"),
        ('x = { name = "Ost", unit = "compass" }', r"columns.x.unit: expected one of m, mm"),
        ("x = 3", r"columns.x: expected the name of a column"),
    ],
)
def test_columns_that_cannot_be_used_are_named(columns: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(hp.SceneError, match=message):
        load(tmp_path, german(), f"[motion.columns]\n{columns}\n")


def test_german_dates_are_read(tmp_path: Path) -> None:
    head, *rows = german(zone="").replace("2026-11-23T", "05.03.2026 ").splitlines()
    scene = load(tmp_path, "\n".join([head, *(row.replace(".0", ",0", 3).replace(",03,", ".03.") for row in rows)]))
    np.testing.assert_allclose(scene.t, T, atol=1e-9)
    assert any("first stamp of the log, 2026-03-05T10:00:00.000" in note for note in scene.notes())


def test_any_column_of_dates_can_be_the_instants(tmp_path: Path) -> None:
    head, *rows = german().splitlines()
    scene = load(tmp_path, "\n".join([f"Export;{head}", *(f"24.11.2026 08:00;{row}" for row in rows)]))
    np.testing.assert_allclose(scene.t, T, atol=1e-9)


def test_dates_are_not_suspected_of_being_milliseconds(tmp_path: Path) -> None:
    rows = "".join(f"2026-11-23 10:{k:02}:00,{k},0,0,0\n" for k in range(12))
    notes = load(tmp_path, f"t,x,y,phi_z,psi\n{rows}", "").notes()
    assert not any("is it in seconds" in note for note in notes), notes


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "cp1252"])
def test_headings_of_windows_are_understood(encoding: str, tmp_path: Path) -> None:
    columns = COLUMNS.replace("Kurs", "Kurs [°]")
    text = german().replace("Kurs", "Kurs [°]").replace("fein", "schön")
    scene = load(tmp_path, text, columns, encoding)
    np.testing.assert_allclose(scene.t, T, atol=1e-9)
    with pytest.raises(hp.SceneError, match=r"line 4: Nord: expected a number .* got '5°'"):
        load(tmp_path, text.replace(f";{Y[2]:.12f}".replace(".", ","), ";5°"), columns, encoding)


def test_a_file_in_utf_16_is_refused(tmp_path: Path) -> None:
    with pytest.raises(hp.SceneError, match="expected a text file in UTF-8 or Windows-1252, got zero bytes"):
        load(tmp_path, german(), COLUMNS, "utf-16")


def test_small_angles_beside_angles_in_degrees_are_suspected_of_degrees(tmp_path: Path) -> None:
    columns = '[motion.columns]\nphi_z = { name = "Kurs", unit = "UNIT" }\npsi = { name = "Knick", unit = "deg" }\n'
    text = "t,x,y,Kurs,Knick\n" + "".join(f"{t},{t},0,{10 * t},{4 * t}\n" for t in T)
    said = "psi may be in the same unit as phi_z"
    notes = load(tmp_path, text, columns.replace("UNIT", "rad").replace("deg", "rad")).notes()
    assert said in notes
    conversion = 'unit = "deg" for phi_z in [motion.columns] (unit = "compass" for headings clockwise from north)'
    assert any(note.endswith(f"Degrees become radians by {conversion}.") for note in notes)
    for unit in ("rad", "deg"):
        assert said not in load(tmp_path, text, columns.replace("UNIT", unit)).notes()


def test_what_is_converted_is_not_suspected(tmp_path: Path) -> None:
    rows = "".join(f"{t},{t},0,0,{400 * t}\n" for t in T)
    notes = load(tmp_path, f"t,x,y,phi_z,psi\n{rows}", '[motion.columns]\npsi = { unit = "deg" }\n').notes()
    assert not any("radians" in note for note in notes), notes


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
        assert any("the first in row 5, counted from 0" in note for note in scene.motion.notes)
        assert scene.files == (path.absolute(),)
    with pytest.raises(hp.SceneError, match=r"DataFrame: motion\.columns\.psi: expected one of .* got 'Knick'"):
        hp.load_scene(path, log=frame.drop(columns="Knick"))
    with pytest.raises(hp.ArgumentError, match="log: expected the path of a file, a pandas DataFrame"):
        hp.load_scene(path, log=3)


def test_another_file_stands_for_that_of_a_scene(tmp_path: Path) -> None:
    expected = load(tmp_path, german()).evaluate().R2
    other = (tmp_path / "log.csv").rename(tmp_path / "other.csv")
    np.testing.assert_array_equal(hp.load_scene(tmp_path / "scene.toml", log=other).evaluate().R2, expected)


def test_units_of_a_dataset_are_read_with_its_names(tmp_path: Path) -> None:
    scene = load(tmp_path, german())
    units = {"Ost": "km", "Kurs": "compass", "Knick": "-deg"}
    frame = pd.DataFrame({"Zeit": T, "Ost": 1e-3 * X, "Nord": Y, "Kurs": HEADING, "Knick": KINK})
    log = frame.set_index("Zeit").to_xarray()
    for name, unit in units.items():
        log[name].attrs["units"] = unit
    plain = '[motion.columns]\nt = "Zeit"\nx = "Ost"\ny = "Nord"\nphi_z = "Kurs"\npsi = "Knick"\n'
    (tmp_path / "plain.toml").write_text(SCENE.replace('file = "log.csv"', "") + plain, encoding="utf-8")
    found = hp.load_scene(tmp_path / "plain.toml", log=log).evaluate()
    np.testing.assert_allclose(found.R2, scene.evaluate().R2, atol=1e-9)
    # Names of ours, in units of theirs.
    ours = log.rename({"Ost": "x", "Nord": "y", "Kurs": "phi_z", "Knick": "psi", "Zeit": "t"})
    ours["phi_z"], ours["psi"] = np.radians(90 - ours["phi_z"]), -ours["psi"]
    ours["x"].attrs["units"], ours["phi_z"].attrs["units"], ours["psi"].attrs["units"] = "km", "rad", "degrees"
    path = tmp_path / "ours.toml"
    path.write_text(SCENE.replace('file = "log.csv"', ""), encoding="utf-8")
    np.testing.assert_allclose(hp.load_scene(path, log=ours).evaluate().R2, scene.evaluate().R2, atol=1e-9)
