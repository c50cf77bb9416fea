"""Columns of numbers out of files: what is read, in which order and kind, and what is refused where."""

from __future__ import annotations

import gc
import io
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.tables import column_file
from hingepair.tables.column_file import file_table
from hingepair.tables.recorded_columns import Vocabulary, read_recorded


def read(path: Path, *names: str, exact: str = "") -> dict[str, np.ndarray]:
    """These columns of a file, where they are there; all unless named."""
    table = file_table(path)
    wanted = [name for name in names or table.arrays if name in table.arrays]
    return {name: table.instants(name) if name == exact else table.numbers(name) for name in wanted}


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def test_columns_of_a_csv_come_by_name_in_the_order_chosen(tmp_path: Path) -> None:
    path = write(tmp_path / "log.CSV", '\ufeff t,"a, b" , c\n1,2,3\n\n4,5e-1,-6\n')
    found = read(path, "c", "t")
    assert {name: column.tolist() for name, column in found.items()} == {"c": [3.0, -6.0], "t": [1.0, 4.0]}
    assert list(found) == ["c", "t"]
    assert list(read(path)) == ["t", "a, b", "c"]
    assert all(column.flags.c_contiguous for column in found.values())


def test_empty_cells_and_nan_are_missing_numbers(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", "t,a\n1,\n2, \n3,nan\n4,7\n")
    assert np.array_equal(read(path)["a"], [np.nan, np.nan, np.nan, 7.0], equal_nan=True)


def test_instants_keep_all_their_digits(tmp_path: Path) -> None:
    stamps = [1_700_000_000_123_456_789, 1_700_000_000_128_456_790]
    path = write(tmp_path / "log.csv", "a,t\n" + "".join(f"0.5,{stamp}\n\n,\n" for stamp in stamps))
    assert read(path, "t", exact="t")["t"].tolist() == stamps


def test_dates_begin_with_the_year_or_the_day(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", "t;a\n23.11.2026 10:00:00,25;1\n2026-11-23 10:00:00,5;2\n")
    expected = np.array(["2026-11-23T10:00:00.25", "2026-11-23T10:00:00.5"], "datetime64[ns]")
    assert read(path, "t", exact="t")["t"].tolist() == expected.tolist()


def test_the_decimal_mark_is_that_of_all_rows(tmp_path: Path) -> None:
    path = write(tmp_path / "log.csv", "t;a\n0;0\n0,1;0,2\n0,2;1e-1\n")
    assert read(path)["a"].tolist() == [0.0, 0.2, 0.1]
    assert read(write(path, "t;a\n\n0,5;2\n;\n"))["a"].tolist() == [2.0]
    assert read(write(path, "t;a\n"))["a"].tolist() == []
    with pytest.raises(hp.ArgumentError, match="expected one decimal mark in all rows, got points and commas"):
        read(write(path, "t;a\n0;0.5\n1;1,250\n"))


def test_comments_may_stand_above_the_names(tmp_path: Path) -> None:
    preamble = "Instrument;X7\nOperator, and others\nRate: 100\n\n"
    for above in ("# made by X\n# 100 Hz\n", "\n", "// made by X, version 2\n\n", "% t,x\n", "#\n", preamble):
        found = read(write(tmp_path / "log.csv", above + "t,a\n0,1\n1,2\n"))
        assert {name: column.tolist() for name, column in found.items()} == {"t": [0, 1], "a": [1, 2]}
    with pytest.raises(hp.ArgumentError, match="line 4: a: expected a number"):
        read(write(tmp_path / "log.csv", "# made by X\nt,a\n0,1\n1,x\n"))
    for names in ("t,a", "t,a#", "t,a %b", "t,a//b"):  # signs of comments within names are letters
        found = read(write(tmp_path / "log.csv", f"# made by X\n# {names}\n0,1\n1,2\n"))
        assert ",".join(found) == names
        assert list(read(write(tmp_path / "log.csv", f"{names}\n0,1\n1,2\n"))) == list(found)


def test_rows_have_a_field_for_each_name(tmp_path: Path) -> None:
    """Also where only some columns are read: row names, as R writes them, would shift the others."""
    path = write(tmp_path / "log.csv", "t,a,b\n1,0.0,5,20\n2,0.1,5,20\n")
    with pytest.raises(hp.ArgumentError, match=r"line 2: expected 3 fields, .* got 4 fields"):
        read(path, "t", "a")
    found = read(write(path, "t,a\n1,2,\n3,4,\n"))  # an empty field at the end is none
    assert found["a"].tolist() == [2.0, 4.0]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "expected a first line of column names, got an empty line"),
        ("t\0a\n1\n", "expected a text file in UTF-8 or Windows-1252, got zero bytes, as of UTF-16"),
        ("t;a\n1;2\n3\n", "line 3: expected 2 fields, separated by semicolons, got 1 fields"),
        ("t;a\n1;2,5\n3;x,5\n", "line 3: a: expected a number"),
        ("t\ta\n1\t2\n3\n", "line 3: expected 2 fields, separated by tabs, got 1 fields"),
        ("x" * 100_001 + "\n1\n", "expected a first line of column names, got a longer line"),
        ("t,a\n1,2\n3\n", "line 3: expected 2 fields, separated by commas, with decimal points, got 1 fields"),
        ("t,a\n1,2\n3,4,5\n", "line 3: expected 2 fields, separated by commas, with decimal points, got 3 fields"),
        (
            "t,a\n1,2\n\n3,four\n",
            "line 4: a: expected a number (nan or an empty cell where there is none), got",
        ),
        ("t,a\n1,1_5\n", "line 2: a: expected a number (nan or an empty cell where there is none), got '1_5'"),
        pytest.param("t,a\n" + "1," * 1_000_000 + "1\n", "line 2: expected 2 fields", id="72 TiB"),
    ],
)
def test_what_cannot_be_read_of_a_csv_is_named(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(hp.ArgumentError, match=re.escape(words)):
        read(write(tmp_path / "log.csv", text))


@pytest.mark.parametrize("ending", [".npz", ".parquet"])
def test_exact_columns_keep_their_kind_and_others_become_float64(tmp_path: Path, ending: str) -> None:
    t = np.array([1_700_000_000_123_456_789, 1_700_000_000_128_456_790])
    path, a = tmp_path / f"log{ending}", np.array([3, -4], dtype=np.int32)
    if ending == ".npz":
        np.savez(path, t=t, a=a)
    else:
        pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
        pq.write_table(pa.table({"t": t, "a": a, "words": ["x", "y"]}), path)
    found = read(path, "t", "a", exact="t")
    assert found["t"].dtype == np.int64
    assert found["t"].tolist() == t.tolist()
    assert found["a"].dtype == np.float64
    assert found["a"].tolist() == [3.0, -4.0]
    assert read(path, "t")["t"].dtype == np.float64
    if ending == ".parquet":
        with pytest.raises(hp.ArgumentError, match=r"^words: expected numbers"):
            read(path)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_of_any_order_are_read(tmp_path: Path, save: object) -> None:
    path, R = tmp_path / "log.npz", np.arange(12.0).reshape(4, 3)
    save(path, R=np.asfortranarray(R), S=R[:, ::-1].astype(">f4"), t=np.arange(4))
    found = read(path)
    assert np.array_equal(found["R"], R)
    assert np.array_equal(found["S"], R[:, ::-1])
    assert found["t"].dtype == np.float64


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"a": np.arange(3), "b": np.arange(4)}, "expected columns of one length, got a: 3, b: 4"),
        ({"a": np.array([])}, "at least one sample"),
        ({"a": np.array(["x"])}, "a: expected numbers"),
        ({"a": np.array([1 + 2j])}, "a: expected numbers"),
        ({"a": np.array(3.0)}, "a: expected shape"),
        ({"a": np.array(["2026-01-01"], dtype="datetime64[D]")}, "a: expected"),
    ],
    ids=["lengths", "none", "words", "complex", "one number", "dates"],
)
def test_what_cannot_be_read_of_an_npz_is_named(tmp_path: Path, arrays: dict[str, np.ndarray], words: str) -> None:
    np.savez(tmp_path / "log.npz", **arrays)
    with pytest.raises(hp.ArgumentError, match=re.escape(words)):
        read_recorded(file_table(tmp_path / "log.npz"), {}, Vocabulary("ab", lambda _: "1"))


@pytest.mark.parametrize("ending", [".csv", ".npz", ".parquet"])
def test_files_of_too_many_bytes_or_rows_are_refused(
    tmp_path: Path, ending: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pd = pytest.importorskip("pandas")
    path, table = tmp_path / f"log{ending}", pd.DataFrame({"t": [1.0, 2.0, 3.0]})
    save = {".csv": table.to_csv, ".npz": lambda name: np.savez(name, t=table.t), ".parquet": table.to_parquet}
    save[ending](path)
    for limit, most in {"MAX_FILE_ROWS": 3, "MAX_FILE_BYTES": path.stat().st_size}.items():
        with monkeypatch.context() as limited:
            limited.setattr(column_file, limit, most)
            assert read(path)["t"].size == 3
            limited.setattr(column_file, limit, most - 1)
            with pytest.raises(hp.ArgumentError, match=f"expected at most {most - 1} "):
                read(path)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("t;x, m;y, m\n0;1,5;2,5\n", ["t", "x, m", "y, m"]),
        ("t;x, m;y\n0;1,5;2\n", ["t", "x, m", "y"]),
        ("t,a;b\n0,1.5\n", ["t", "a;b"]),
        ('t,"shoulder, left",a;b\n0,1,2\n', ["t", "shoulder, left", "a;b"]),
        ("t;a\n1;2\n", ["t", "a"]),
        ("t\ta\n1\t2\n", ["t", "a"]),
    ],
)
def test_the_separator_is_that_on_which_names_and_numbers_agree(tmp_path, text, names):
    path = tmp_path / "a.csv"
    path.write_text(text)
    assert list(read(path)) == names


@pytest.mark.parametrize("kind", ["no archive", "numbers beyond any file"])
def test_an_npz_that_is_none_is_refused_and_closed(tmp_path: Path, kind: str) -> None:
    """Where warnings are errors, so are files that stay open."""
    path, head = tmp_path / "log.npz", io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": "<f8", "fortran_order": False, "shape": (10**13,)})
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("t.npy", head.getvalue())
    if kind == "no archive":
        path.write_bytes(b"PK\x03\x04 and nothing more")
    with pytest.raises(hp.ArgumentError, match=r"expected a \.npz file that can be read"):
        read(path)
    gc.collect()
