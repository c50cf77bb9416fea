"""Files of samples that cannot be used: each refused in one line that names the file and the column."""

from __future__ import annotations

import csv
import io
import tracemalloc
import zipfile

import numpy as np
import pytest

import hingepair as hp
from support.sampled import BODY, EULER, SCENE, logged, moving, scene_of, some, write

GOOD = some(moving(), "t", *EULER)


def text_of(columns):
    stream = io.StringIO()
    csv.writer(stream).writerows([list(columns), *zip(*(c.tolist() for c in columns.values()), strict=True)])
    return stream.getvalue()


def changed(**columns):
    return {name: value for name, value in (GOOD | columns).items() if value is not None}


def with_value(name, index, value):
    column = GOOD[name].copy()
    column[index] = value
    return changed(**{name: column})


LINES = text_of(GOOD).splitlines()
REFUSED_CSV = {
    "empty file": ("", "", "log.csv: expected"),
    "short row": ("\n".join([*LINES[:4], "1,2", *LINES[5:]]), "", "line 5: expected 8 fields"),
    "decimal commas": ("\n".join([LINES[0], *(line.replace(".", ",") for line in LINES[1:])]), "", "decimal points"),
    "no instant": ("\n".join([*LINES[:2], LINES[2][LINES[2].index(",") :], *LINES[3:]]), "", "t: .* nan at index 1"),
    "results": (changed(R2_x=GOOD["psi"]), "", "run --outputs q,qd,qdd --out FILE"),
    "words": ("\n".join([*LINES[:2], "a" + LINES[2], *LINES[3:]]), "", "line 3: t: expected"),
    "column twice": (LINES[0].replace("y", "x", 1) + "\n" + LINES[1], "", "log.csv: x: expected"),
    "no t": (changed(t=None), "", "log.csv: t: expected"),
    "no psi": (changed(psi=None), "", "log.csv: psi: expected"),
    "half a position": (changed(y=None), "", "y: expected"),
    "no attitude": (changed(phi_x=None, phi_y=None, phi_z=None), "", "phi_x: expected"),
    "two attitudes": (changed(qx=GOOD["x"]), "", "qx: expected"),
    "omega1 beside angles": (changed(omega1_x=GOOD["x"]), "", "omega1_x: expected"),
    "t is nan": (with_value("t", 5, np.nan), "", "log.csv: t: expected .*index 5"),
    "t goes back": (with_value("t", 5, GOOD["t"][3]), "", "at index 5"),
    "zero quaternion": (
        {name: np.zeros(3) for name in BODY} | {"t": np.arange(3)},
        "",
        "zero quaternion at sample 0",
    ),
    "sequence of quaternions": (some(logged(9), *BODY), 'sequence = "XYZ"\n', "motion.sequence: expected"),
    "time beside": (GOOD, "[time]\nstart = 0\nstop = 1\nsamples = 3\n", "my.toml: time: expected"),
    "expression beside": (GOOD, 'x = "t"\n', "motion.x: expected"),
    "unknown column says how to leave it out": (
        changed(temp=GOOD["psi"]),
        "",
        r"'temp': .*; \[motion\] ignore = \['temp'\] leaves the column out",
    ),
    "not UTF-8": (b"t,x\xff\n1,2\n", "", "log.csv: 'x\u00ff': expected"),
}


@pytest.mark.parametrize(("columns", "more", "message"), REFUSED_CSV.values(), ids=REFUSED_CSV)
def test_refused_in_one_line_that_names_file_and_column(tmp_path, columns, more, message):
    with pytest.raises(hp.SceneError, match=message) as caught:
        scene_of(tmp_path, columns, more)
    assert "\n" not in str(caught.value)
    assert str(tmp_path) in str(caught.value)


def test_ignored_columns_are_not_read(tmp_path):
    rows = ["temp,comment," + LINES[0], *(f"{20 + i},warm," + line for i, line in enumerate(LINES[1:]))]
    given, plain = scene_of(tmp_path, "\n".join(rows), "ignore = ['comment', 'temp']\n"), scene_of(tmp_path, GOOD)
    np.testing.assert_array_equal(given.evaluate().R2, plain.evaluate().R2)


def test_an_ignored_array_is_not_read(tmp_path):
    more = {"image": np.zeros((2, 2, 2)), "omega1": np.zeros((len(GOOD["t"]), 3))}
    scene = scene_of(tmp_path, GOOD | more, "ignore = ['image', 'omega1']\n", name="log.npz")
    np.testing.assert_array_equal(scene.evaluate().psi, GOOD["psi"])


def test_an_empty_cell_is_a_number_that_is_not_there(tmp_path):
    text = "\n".join([*LINES[:3], LINES[3].rpartition(",")[0] + ",", *LINES[4:]])
    psi = scene_of(tmp_path, text, "").evaluate().psi
    assert np.flatnonzero(np.isnan(psi)).tolist() == [2]
    np.testing.assert_array_equal(np.delete(psi, 2), np.delete(GOOD["psi"], 2))


class Trap:
    """What must never be unpickled."""

    def __reduce__(self):
        return (exec, ("raise SystemExit('code from a file ran')",))


REFUSED_NPZ = {
    "pickle": ({"t": np.array([Trap()], dtype=object)}, "t: expected"),
    "complex": ({"t": np.zeros(3, complex)}, "t: expected"),
    "half precision": ({"t": np.zeros(3, np.float16)}, "t: expected"),
    "text": ({"t": np.array(["1"])}, "t: expected"),
    "unknown array": ({"time": np.arange(3)}, "'time': expected"),
    "scalar": ({"t": np.array(1.0)}, r"t: expected"),
    "transposed": ({"R1": np.zeros((3, 9))}, r"R1: expected"),
    "lengths": ({"t": np.arange(3), "psi": np.arange(4)}, "columns of one length, got t: 3, psi: 4"),
    "both ways": ({"R1": np.zeros((3, 3)), "x": np.zeros(3)}, "x: expected"),
    "empty": ({"t": np.empty(0)}, "at least one sample"),
}


@pytest.mark.parametrize(("arrays", "message"), REFUSED_NPZ.values(), ids=REFUSED_NPZ)
def test_arrays_refused(tmp_path, arrays, message):
    np.savez(tmp_path / "made.npz", **arrays)
    with pytest.raises(hp.SceneError, match=message):
        scene_of(tmp_path, (tmp_path / "made.npz").read_bytes(), name="log.npz")


def test_sizes_are_refused_before_anything_is_allocated(tmp_path, monkeypatch):
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f8", "fortran_order": False, "shape": (10**13,)})
    with zipfile.ZipFile(tmp_path / "log.npz", "w") as archive:
        archive.writestr("t.npy", header.getvalue())
    with pytest.raises(hp.SceneError, match="at most 10000000 samples, got 10000000000000"):
        scene_of(tmp_path, (tmp_path / "log.npz").read_bytes(), name="log.npz")
    for name in ("log.csv", "log.npz", "log.parquet"):
        with monkeypatch.context() as patch:
            patch.setattr("hingepair.tables.column_file.MAX_FILE_ROWS", 11)
            with pytest.raises(hp.SceneError, match="at most 11 samples, got "):
                scene_of(tmp_path, GOOD, name=name)
            patch.setattr("hingepair.tables.column_file.MAX_FILE_BYTES", 100)
            with pytest.raises(hp.SceneError, match="at most 100 bytes"):
                scene_of(tmp_path, GOOD, name=name)


@pytest.mark.parametrize("name", ["log.npz", "log.parquet"])
@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"PAR1junkPAR1", b"text"])
def test_no_such_format(tmp_path, name, content):
    with pytest.raises(hp.SceneError, match=name):
        scene_of(tmp_path, content, name=name)


def test_a_file_cut_short(tmp_path):
    for name in ("log.npz", "log.parquet"):
        write(tmp_path / name, GOOD)
        whole = (tmp_path / name).read_bytes()
        for length in (len(whole) // 3, len(whole) - 3):
            with pytest.raises(hp.SceneError, match=name):
                scene_of(tmp_path, whole[:length], name=name)


def test_parquet_nulls_are_lost_numbers_and_words_are_refused(tmp_path):
    columns = {name: column.tolist() for name, column in GOOD.items()}
    columns["y"][2] = None
    result = scene_of(tmp_path, columns, name="log.parquet").evaluate()
    assert np.flatnonzero(np.isnan(result.R2[:, 1])).tolist() == [2]
    columns["y"] = ["1.5"] * 12
    with pytest.raises(hp.SceneError, match="y: expected a column of numbers, got string"):
        scene_of(tmp_path, columns, name="log.parquet")


@pytest.mark.parametrize("name", ["log.txt", "log", "none.csv", "."])
def test_no_such_file(tmp_path, name):
    (tmp_path / "my.toml").write_text(SCENE.format(file=name))
    with pytest.raises(hp.SceneError, match=r"a file (name that ends in|of samples)"):
        hp.load_scene(tmp_path / "my.toml")


HURTFUL = {
    "brackets": b"{'descr': '<f8', 'fortran_order': False, 'shape': " + b"(" * 5_000,
    "minus signs": b"{'descr': '<f8', 'fortran_order': False, 'shape': (" + b"-" * 9_000 + b"1,), }",
    "no dictionary": b"print('hello')",
    "record": b"{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': (3,), }",
    "no type": b"{'descr': '<q99', 'fortran_order': False, 'shape': (3,), }",
    "objects": b"{'descr': '|O', 'fortran_order': False, 'shape': (3,), }",
}


def npz_of(header, content=b"", size=None, version=b"\x01\x00"):
    stated = (len(header) if size is None else size).to_bytes(2 if version == b"\x01\x00" else 4, "little")
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("t.npy", b"\x93NUMPY" + version + stated + header + content)
    return stream.getvalue()


@pytest.mark.parametrize("header", HURTFUL.values(), ids=HURTFUL)
@pytest.mark.parametrize("version", [b"\x01\x00", b"\x02\x00", b"\x03\x00", b"\x09\x00"])
def test_headers_made_to_hurt(tmp_path, header, version):
    with pytest.raises(hp.SceneError, match="t: expected "):
        scene_of(tmp_path, npz_of(header, b"0" * 64, version=version), name="log.npz")


@pytest.mark.slow
def test_a_header_of_a_declared_gigabyte_is_not_read(tmp_path):
    content = npz_of(b" " * 100_000_000, size=1_000_000_000, version=b"\x02\x00")
    tracemalloc.start()
    with pytest.raises(hp.SceneError, match="t: expected an array of real numbers"):
        scene_of(tmp_path, content, name="log.npz")
    assert tracemalloc.get_traced_memory()[1] < 20_000_000
    tracemalloc.stop()


def test_terminal_escapes_do_not_reach_the_screen(tmp_path):
    for text in ("t,\x1b[31mx\n1,2\n", "t;\x1b[31mx\n1;2\n", "t,x\n1,\x1b[31m2\n"):
        with pytest.raises(hp.SceneError) as caught:
            scene_of(tmp_path, text)
        assert str(caught.value).isprintable()


@pytest.mark.parametrize("order", ["C", "F"])
def test_arrays_of_any_order_and_type_are_read(tmp_path, order):
    columns = moving()
    q = np.asarray(np.stack([columns[c] for c in EULER], axis=-1), order=order)
    plain = scene_of(tmp_path, {"t": columns["t"], "q": q}, name="log.npz").evaluate(("R2",))
    assert np.array_equal(plain.R2, scene_of(tmp_path, some(columns, "t", *EULER)).evaluate(("R2",)).R2)
    swapped = scene_of(tmp_path, {"t": columns["t"].astype(">f8"), "q": q}, name="log.npz").evaluate(("R2",))
    assert np.array_equal(plain.R2, swapped.R2)
