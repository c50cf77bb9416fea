"""Recordings of two bodies, and of robots, in files."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray

import hingepair as hp
from hingepair.formats.recordings import Recording, read_recording, read_robot_recording
from support.near import U, assert_near
from support.recorded import recording

MADE = recording(300, 1e-3, 2e-3)


def quaternions(S: np.ndarray) -> np.ndarray:
    """(x, y, z, w) of rotations, half of them with the other sign."""
    rotvec = hp.rotation_log(S)
    angle = np.linalg.norm(rotvec, axis=-1, keepdims=True)
    found = np.concatenate((np.sin(angle / 2) * rotvec / angle, np.cos(angle / 2)), axis=-1)
    return np.where(np.arange(len(S))[:, None] % 2, found, -found)


def table(path: Path, **columns: np.ndarray) -> Path:
    """A .csv file; NaN are empty cells."""
    rows = [",".join(columns)]
    rows += [",".join("" if str(v) == "nan" else str(v) for v in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join(rows) + "\n")
    return path


def pose(digit: str, R: np.ndarray, S: np.ndarray) -> dict[str, np.ndarray]:
    return dict(
        zip(
            (f"{c}{digit}" for c in ("x", "y", "z", "qx", "qy", "qz", "qw")),
            np.hstack((R, quaternions(S))).T,
            strict=True,
        )
    )


def both(made=MADE) -> dict[str, np.ndarray]:
    return {"t": made.t, **pose("1", made.R1, made.S1), **pose("2", made.R2, made.S2)}


def test_columns_are_read_by_name_and_quaternions_may_flip(tmp_path: Path) -> None:
    columns = both()
    found = read_recording(table(tmp_path / "a.csv", **dict(reversed(columns.items()))))
    assert np.abs(found.body1.S - MADE.S1).max() <= 16 * U
    assert (found.body2.R == MADE.R2).all()
    assert (found.t == MADE.t).all()


def test_what_the_library_saved_is_read(tmp_path: Path) -> None:
    arrays = {name: getattr(MADE, name) for name in ("R1", "S1", "R2", "S2", "psi")} | {"x": MADE.psi, "y": MADE.psi}
    from hingepair.mechanism.results import Record

    for name in ("a.npz", "a.csv"):
        found = read_recording(Record(MADE.t, arrays).save(tmp_path / name))
        assert (found.body2.S == MADE.S2).all()
        assert (found.body1.R == MADE.R1).all()


@pytest.mark.parametrize("ending", ["csv", "npz"])
def test_trajectories_in_the_plane_are_read(tmp_path: Path, ending: str) -> None:
    flat = hp.PlanarPair((1, 0.5), (-1, 0.2))
    path = hp.integrate(flat, MADE.t[:30], 0.3, np.cos(MADE.t[:30]), R1=(1, 2)).save(tmp_path / f"a.{ending}")
    found = read_recording(path)
    assert_near(hp.fit(found.body1, found.body2).pair.u1, (1, 0.5, 0), 2**20)  # of 0.3 rad
    assert_near(found.body1.R[-1], (1, 2, 0), 1)


@pytest.mark.parametrize(("last", "place"), [("0.1", "line 5"), ("nan", "line 5")])
def test_instants_that_are_none_are_named_by_their_line(tmp_path: Path, last: str, place: str) -> None:
    path = tmp_path / "a.csv"
    path.write_text(f"t,psi\n0.1,1\n\n0.2,1\n{last},2\n")
    text = "[pair]\nu1 = [0, 0, 0]\nu2 = [0, 0, 0]\nn = [0, 0, 1]\n[motion]\nfile = 'a.csv'\n"
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(hp.SceneError, match=place):
        hp.load_scene(tmp_path / "a.toml")


@pytest.mark.slow
def test_two_files_with_clocks_of_their_own_meet(tmp_path: Path) -> None:
    fast, slow = recording(1000), recording(1000)
    start = 1_700_000_000_000_000_000
    kept = np.arange(3, 990, 7)
    stamps = start + np.round(fast.t * 1e9).astype(np.int64)
    first = table(tmp_path / "one.csv", t=stamps, **pose("", fast.R1, fast.S1))
    late = stamps[kept]
    second = table(tmp_path / "two.csv", t=late, **pose("", slow.R2[kept], slow.S2[kept]))
    found = read_recording(first, second, gaps=0.1)
    assert found.t.tolist() == late.tolist()  # every nanosecond
    assert np.abs(found.body1.R - fast.R1[kept]).max() <= 4 * U
    assert hp.fit(found.body1, found.body2, t=found.t).ok


def test_a_body_2_without_attitudes_is_a_point(tmp_path: Path) -> None:
    columns = {name: array for name, array in both().items() if not name.startswith("q") or name.endswith("1")}
    found = read_recording(table(tmp_path / "a.csv", **columns))
    assert found.body1.S is not None
    assert found.body2.S is None
    assert np.abs(found.body2.R - MADE.R2).max() <= 4 * U
    assert hp.fit(found.body1, found.body2).ok
    first = table(tmp_path / "one.csv", t=MADE.t, **pose("", MADE.R1, MADE.S1))
    point = table(tmp_path / "two.csv", t=MADE.t[1::2], x=MADE.R2[1::2, 0], y=MADE.R2[1::2, 1], z=MADE.R2[1::2, 2])
    assert read_recording(first, point).body2.shape == (150,)
    with pytest.raises(hp.ArgumentError, match=r"two\.csv: expected columns of the attitude of body 1: S_xx"):
        read_recording(point, first)


def test_attitudes_of_a_few_digits_and_of_zeros_are_read(tmp_path: Path) -> None:
    S2 = MADE.S2.round(6)
    S2[5] = 0
    columns = {
        f"S{i}_{a}{b}": S[:, j, k]
        for i, S in ((1, MADE.S1), (2, S2))
        for j, a in enumerate("xyz")
        for k, b in enumerate("xyz")
    }
    places = {f"R{i}_{a}": R[:, j] for i, R in ((1, MADE.R1), (2, MADE.R2)) for j, a in enumerate("xyz")}
    found = read_recording(table(tmp_path / "a.csv", **columns, **places))
    assert np.isnan(found.body2.S[5]).all()
    assert np.abs(np.delete(found.body2.S - MADE.S2, 5, axis=0)).max() < 1e-6  # of six digits


def same_recording(found: Recording, expected: Recording) -> None:
    for one, other in zip(found[:2], expected[:2], strict=True):
        np.testing.assert_array_equal(one.R, other.R)
        np.testing.assert_array_equal(one.S, other.S)
    np.testing.assert_array_equal(found.t, expected.t)


@pytest.mark.slow
def test_a_data_frame_is_read_like_its_file(tmp_path: Path) -> None:
    columns = both()
    columns["x1"][7] = np.nan
    expected = hp.read_recording(table(tmp_path / "a.csv", **columns))
    frame = pd.DataFrame(columns)
    nullable = frame.assign(x1=frame["x1"].astype("Float64"), weather="fine")
    by_index = frame.set_index("t")
    for source in (frame, columns, by_index, xarray.Dataset.from_dataframe(by_index)):
        same_recording(hp.read_recording(source), expected)
    same_recording(hp.read_recording(nullable), expected)
    first, second = ([name for name in columns if digit not in name] for digit in "21")
    same_recording(hp.read_recording(frame[first], frame[second]), expected)


def test_a_dataset_of_results_is_read_with_its_units() -> None:
    pair = hp.HingePair(u1=(0.5, 0, 0), u2=(0.1, 0.2, 0), n=(0, 0, 1))
    result = hp.integrate(pair, np.linspace(0, 1, 20), (0.1, 0.2, 1.0), 1.0, outputs=("R1", "S1", "R2", "S2"))
    expected = hp.read_recording(result.to_dataframe())
    found = hp.read_recording(result.to_xarray(units="mm, deg, ms"))
    assert np.abs(found.body2.R - expected.body2.R).max() <= 4 * U
    assert np.array_equal(found.body1.S, expected.body1.S)
    assert np.abs(found.t - expected.t).max() <= 4 * U
    strange = result.to_xarray()
    strange["R1"].attrs["units"] = "furlong"
    with pytest.raises(hp.ArgumentError, match=r"Dataset: R1: expected the unit of this quantity.*'furlong'"):
        hp.read_recording(strange)


def test_columns_of_another_program_have_names_and_units(tmp_path: Path) -> None:
    made = both()
    stamps = np.datetime64("2026-03-05T13:30:00", "ns") + np.rint(1e9 * MADE.t).astype("m8[ns]")
    frame = pd.DataFrame(made).rename(columns={"x1": "Ost", "t": "Zeit"}).assign(Wetter="fine")
    frame["Ost"], frame["Zeit"] = 1e3 * frame["Ost"], pd.to_datetime(stamps).tz_localize("UTC")
    german = frame.assign(Zeit=frame["Zeit"].dt.tz_convert("Europe/Berlin"))
    path = tmp_path / "fahrt.csv"
    german.assign(Zeit=german["Zeit"].map(lambda stamp: stamp.isoformat())).to_csv(
        path, sep=";", decimal=",", index=False
    )
    columns = {"t": "Zeit", "x1": {"name": "Ost", "unit": "mm"}}
    expected = hp.read_recording(made)
    for source in (german, german.set_index("Zeit"), path):
        found = hp.read_recording(source, columns=columns)
        assert np.array_equal(found.t.astype("M8[ns]"), stamps)
        assert np.abs(found.body1.R - expected.body1.R).max() <= 4 * U
        assert np.array_equal(found.body2.S, expected.body2.S)
    with pytest.raises(hp.ArgumentError, match=r"columns\.x1: expected one of .* \(nearest: Ost\), got 'Osten'"):
        hp.read_recording(german, columns=columns | {"x1": "Osten"})
    with pytest.raises(hp.ArgumentError, match=r"x1: expected x1 once, from columns or from a column of this name"):
        hp.read_recording(german.assign(x1=0.0), columns=columns)
    with pytest.raises(hp.ArgumentError, match=r"columns\.x1\.unit: expected one of m, mm"):
        hp.read_recording(german, columns=columns | {"x1": {"name": "Ost", "unit": "deg"}})


@pytest.mark.slow
def test_one_body_may_be_read_alone() -> None:
    columns = {name.removesuffix("1"): column for name, column in both().items() if not name.endswith("2")}
    found = hp.read_recording(columns, gaps=0.1)
    assert found.body2 is None
    assert hp.smooth(found.t, found.body1).omega.shape == (300, 3)
    point = hp.read_recording({name: columns[name] for name in "txyz"})
    assert point.body1.S is None


@pytest.mark.parametrize("sequence", ["XYZ", "ZYX"])
def test_euler_angles_are_attitudes(sequence: str) -> None:
    columns = {name: column for name, column in both().items() if not name.startswith("q")}
    for S, form in ((MADE.S1, "phi_{}1"), (MADE.S2, "phi_{}2")):
        phi = hp.matrix_to_euler(S, sequence)
        columns |= {form.format(c): phi[:, i] for i, c in enumerate("xyz")}
    columns["phi_y1"][5] = np.nan
    found = hp.read_recording(columns, sequence=None if sequence == "XYZ" else sequence)
    assert np.isnan(found.body1.S[5]).all()
    assert np.abs(np.delete(found.body1.S - MADE.S1, 5, axis=0)).max() < 12 * U
    assert np.abs(found.body2.S - MADE.S2).max() < 12 * U


def test_headings_are_read_as_in_scenes(tmp_path: Path) -> None:
    """A truck and its trailer, by compass; beside them the scene that has the same columns."""
    t = np.arange(40) / 10
    course, pitch = 350 + 3 * t + np.sin(t), 2 * np.sin(t)  # deg
    log = {"t": t, "Ost": 4 * t, "Nord": t, "Kurs": course, "Nick": pitch, "psi": 0 * t}
    compass = {"name": "Kurs", "unit": "compass"}
    path = table(tmp_path / "fahrt.csv", **log)
    scene = "[pair]\nu1 = [0, 0, 0]\nu2 = [0, 0, 0]\nn = [0, 0, 1]\n[motion]\nfile = 'fahrt.csv'\n"
    places = "[motion.columns]\nx = 'Ost'\ny = 'Nord'\n"
    (tmp_path / "flat.toml").write_text(scene + places + "phi_z = { name = 'Kurs', unit = 'compass' }\n")
    flat = hp.read_recording(path, columns={"x": "Ost", "y": "Nord", "phi_z": compass})
    expected = hp.load_scene(tmp_path / "flat.toml").evaluate(("R1", "S1"))
    assert np.array_equal(flat.body1.R, expected.R1)
    assert np.abs(flat.body1.S - expected.S1).max() < 2 * 8 * U  # the promise of S1, by either backend
    forward = flat.body1.S[:, :, 0]
    assert np.abs(forward[:, 0] - np.sin(np.radians(course))).max() < 4 * U
    # As yaw, with a pitch that is positive upwards, and no roll.
    columns = {"x": "Ost", "y": "Nord", "z": "psi", "phi_x": compass, "phi_z": "psi"}
    columns |= {"phi_y": {"name": "Nick", "unit": "-deg"}}
    whole = hp.read_recording(log | {"Null": 0 * t}, columns=columns | {"z": "Null"}, sequence="ZYX")
    assert np.abs(whole.body1.S[:, 2, 0] - np.sin(np.radians(pitch))).max() < 4 * U
    assert np.abs(whole.body1.S[:, 0, 0] - np.cos(np.radians(pitch)) * forward[:, 0]).max() < 8 * U
    with pytest.raises(hp.ArgumentError, match=r"sequence: expected a sequence that ends in Z.*no z, phi_x, phi_y"):
        hp.read_recording(path, columns={"x": "Ost", "y": "Nord", "phi_z": compass | {"unit": "deg"}}, sequence="ZYX")
    (tmp_path / "flat.toml").write_text(
        (tmp_path / "flat.toml").read_text().replace("file", "sequence = 'ZYX'\nfile", 1).replace("compass", "deg")
    )
    with pytest.raises(hp.SceneError, match="sequence: expected a sequence that ends in Z"):
        hp.load_scene(tmp_path / "flat.toml")


def test_angles_in_degrees_are_noticed() -> None:
    t = np.arange(40) / 10
    log = {"t": t, "x1": t, "y1": t, "phi_z1": 20 * t, "x2": t, "y2": t, "phi_z2 [deg]": 3000 * t}
    with pytest.warns(hp.MeasurementWarning, match=r"phi_z1 .*'unit': 'deg'") as said:
        found = hp.read_recording(log)
    assert len(said) == 1
    assert said[0].filename == __file__
    assert np.abs(found.body2.S[:, 0, 0] - np.cos(np.radians(3000 * t))).max() < 256 * U
    with pytest.raises(hp.ArgumentError, match=r"phi_z1: expected angles in radians, .*, got jumps by nearly 360"):
        hp.read_recording(log | {"phi_z1": 150 * t % 360})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hp.read_recording(both() | {"phi_x1": 100 * MADE.t})  # coordinates beside the quaternion


ARM = hp.Mechanism([hp.HingePair((0, 0, 1), (-1, 0, 0), (0, 1, 0), name="elbow")])


def robot_log(folder: Path, *names: str) -> Path:
    """Return a file whose columns of these names hold 1, 2, 3 and so on, times the row."""
    rows = np.outer(np.arange(9), 1 + np.arange(len(names)))
    path = folder / "log.csv"
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="")
    return path


def test_columns_of_other_names_are_those_of_ours(tmp_path: Path) -> None:
    path = robot_log(tmp_path, "t", "Winkel", "qd_elbow", "qdd_elbow", "tau_elbow [N mm]")
    t, found = read_robot_recording(path, ARM, columns={"q_elbow": {"name": "Winkel", "unit": "deg"}})
    rows = np.arange(9.0)
    assert np.array_equal(t, rows)
    np.testing.assert_allclose(found["q"][:, 0], np.radians(2 * rows), rtol=4 * U, atol=0)
    np.testing.assert_allclose(found["tau"][:, 0], 5e-3 * rows, rtol=4 * U, atol=0)
    assert np.array_equal(found["qd"][:, 0], 3 * rows)
