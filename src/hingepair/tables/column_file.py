"""Tables of columns in files: .csv, .npz or .parquet.

What a file says of its size and its kinds of number is judged before anything of that size is made; nothing is run.
pandas reads the numbers of a .csv. The fields of its rows are counted here, since pandas fills short rows and shifts
long ones in silence.
"""

from __future__ import annotations

import csv
import itertools
import os
import re
import zipfile
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import IO, Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError
from hingepair.numeric.optional import require
from hingepair.tables.column_tables import ColumnTable, column_table, number_in

MAX_FILE_ROWS: Final = 10_000_000  # of a file or a table in memory; more are refused
MAX_FILE_BYTES: Final = 2_000_000_000
_MAX_HEADING: Final = 100_000  # characters of a line above the numbers, bytes of an array's heading in a .npz
_MAX_PREAMBLE: Final = 100  # lines above the names
_COMMENT: Final = re.compile(r"^\s*(#|//|%)")  # beginning of a line above the names

Columns: TypeAlias = dict[str, NDArray[Any]]


def file_table(path: Path) -> ColumnTable:
    """Return the columns of a .csv, .npz or .parquet file. Empty cells are NaN.

    Raises:
        ArgumentError: the file cannot be read, or is too large; `name` is where: a column, `line 3` or nothing.
        MissingDependencyError: the file is a .parquet and pyarrow is not installed.
    """
    read = _READERS.get(path.suffix.lower())
    if read is None:
        raise ArgumentError("", f"a file name that ends in {', '.join(_READERS)}", path.suffix or "no ending")
    if not os.path.isfile(path):  # of a name that is too long Path.is_file would raise
        raise ArgumentError("", f"a {path.suffix} file that can be read", "no such file")
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise ArgumentError("", f"at most {MAX_FILE_BYTES} bytes", path.stat().st_size)
        return read(path)
    except ArgumentError:
        raise
    except (
        *(OSError, EOFError, ValueError, KeyError, NotImplementedError, RuntimeError),
        *(csv.Error, zlib.error, zipfile.BadZipFile),
    ) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ArgumentError("", f"a {path.suffix} file that can be read", reason) from None


def _check_rows(count: int) -> None:
    if count > MAX_FILE_ROWS:
        raise ArgumentError("", f"at most {MAX_FILE_ROWS} samples", count)


def write_npz(file: IO[bytes], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays of any names to an open .npz file; `numpy.savez` has arguments of its own, such as `file`."""
    with zipfile.ZipFile(file, "w") as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)


# ---- CSV


class _CsvForm(NamedTuple):
    """How a CSV file is written, by its names and the rows below them."""

    headings: list[str]
    delimiter: str  # a comma, a semicolon or a tab
    skipped: int  # lines up to and with the names


def _csv_table(path: Path) -> ColumnTable:
    import pandas

    # Bytes that are not UTF-8 are let through, since only names and numbers have to be understood.
    with path.open(encoding="utf-8-sig", errors="surrogateescape", newline="") as stream:
        form = _csv_form(stream)
        stream.seek(0)
        rows, blank = _counted_rows(stream, form)
    # pandas 3.1 reads numbers exactly by itself, and warns of the option.
    before = tuple(map(int, pandas.__version__.split(".")[:2])) < (3, 1)
    with path.open("rb") as file:
        for _ in range(form.skipped):
            file.readline()
        frame = pandas.read_csv(
            file,
            sep=form.delimiter,
            names=range(len(form.headings) + 1),  # a row may end in a further delimiter
            index_col=False,
            keep_default_na=False,
            na_values=["", "nan", "NaN"],
            skiprows=blank,
            skip_blank_lines=False,
            skipinitialspace=True,
            low_memory=False,
            encoding_errors="replace",
            **({"float_precision": "round_trip"} if before else {}),
        )
    lines = np.delete(np.arange(rows) + form.skipped + 1, blank)
    if len(frame) != len(lines):
        raise ValueError("a row of several lines")
    arrays = {name: frame[k].to_numpy() for k, name in enumerate(form.headings)}
    if form.delimiter != ",":
        _check_marks(arrays)
    doubled = {name for name in form.headings if form.headings.count(name) > 1}
    mark = "." if form.delimiter == "," else ","
    return ColumnTable(str(path), arrays, lines=lines, mark=mark, doubled=doubled)


def _csv_form(stream: IO[str]) -> _CsvForm:
    """Return the form of a CSV file. The names are the first line that agrees in its fields with a row of numbers
    below it, if there is one; else the first line that is no comment.
    """
    lines: list[str] = []
    while len(lines) < _MAX_PREAMBLE and (line := stream.readline(_MAX_HEADING)):
        lines.append(line)
        if len(line) == _MAX_HEADING:
            break
    if any("\0" in line for line in lines[:1]):
        raise ArgumentError("", "a text file in UTF-8 or Windows-1252", "zero bytes, as of UTF-16")
    filled = [k for k, line in enumerate(lines) if line.strip() and not _COMMENT.fullmatch(line.strip())]
    if not filled:
        raise ArgumentError("", "a first line of column names", "an empty line")
    for place, following in itertools.pairwise(filled):
        forms = _agreeing_forms(_COMMENT.sub("", _legible(lines[place]), count=1), lines[following])
        if forms and not _COMMENT.match(lines[following]):  # numpy.savetxt writes a # before the names
            return _CsvForm(*forms[0], skipped=place + 1)
    place = next((k for k in filled if not _COMMENT.match(lines[k])), filled[0])
    if len(lines[place]) == _MAX_HEADING:
        raise ArgumentError("", "a first line of column names", "a longer line")
    fields = {sign: _split_line(_legible(lines[place]), sign) for sign in ",;\t"}
    delimiter = max(fields, key=lambda sign: len(fields[sign]))
    if all(map(_is_number, fields[delimiter])):
        raise ArgumentError("", "a first line of column names", "numbers")
    return _CsvForm(fields[delimiter], delimiter, place + 1)


def _agreeing_forms(heading: str, row: str) -> list[tuple[list[str], str]]:
    """Return the fields of a line of names, and the sign between them, for each sign that gives a row of numbers as
    many fields. The comma comes last: names and decimal numbers may agree in their commas.
    """
    forms = []
    for sign in ";\t,":
        names, numbers = _split_line(heading, sign), _split_line(row, sign)
        named = len(names) == len(numbers) and not any(map(_is_number, names)) and any(map(_is_number, numbers))
        if named and (len(names) > 1 or sign == ","):
            forms.append((names, sign))
    return forms


def _split_line(line: str, delimiter: str) -> list[str]:
    return [field.strip() for field in next(csv.reader([line], delimiter=delimiter), [])]


def _counted_rows(stream: IO[str], form: _CsvForm) -> tuple[int, list[int]]:
    """Return the number of lines below the names, and which are blank; refuse those that have more or fewer fields
    than there are names. An empty field at the end is no field.
    """
    count, rows = len(form.headings), 0
    blank: list[int] = []
    for line in itertools.islice(stream, form.skipped, None):
        rows += 1
        if line.count(form.delimiter) + 1 == count and line[0] not in " \r\n,;\t":
            continue
        fields = _split_line(line, form.delimiter)
        if not any(fields):
            blank.append(rows - 1)
        elif len(fields) != count and not (len(fields) == count + 1 and not fields[-1]):
            separator = {",": "commas, with decimal points", ";": "semicolons", "\t": "tabs"}[form.delimiter]
            expected = f"{count} fields, separated by {separator}"
            raise ArgumentError(f"line {rows + form.skipped}", expected, f"{len(fields)} fields")
    _check_rows(rows - len(blank))
    return rows, blank


def _check_marks(arrays: Columns) -> None:
    """Refuse numbers with decimal commas, which pandas left as text, beside numbers with decimal points."""
    texts = [[str(cell) for cell in cells] for cells in arrays.values() if cells.dtype == object]
    with_commas = [cells for cells in texts if cells and _is_number(cells[0]) and any("," in cell for cell in cells)]
    points = any("." in cell for cells in with_commas for cell in cells)
    numbers = [array for array in arrays.values() if array.dtype.kind == "f"]
    points |= any(not np.isnan(array).any() or (array % 1 > 0).any() for array in numbers)
    if with_commas and points:
        raise ArgumentError("", "one decimal mark in all rows", "points and commas")


def _is_number(text: str) -> bool:
    try:
        return bool(text) and number_in(text.replace(",", ".")) is not None
    except ValueError:
        return False


def _legible(text: str) -> str:
    """Return text of a CSV file; text that is not UTF-8 is taken for Windows-1252."""
    content = text.encode("utf-8", "surrogateescape")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace")


# ---- other files


def _npz_table(path: Path) -> ColumnTable:
    arrays: dict[str, Any] = {}
    # NumPy leaves a file open that it opened itself and cannot read.
    with path.open("rb") as opened, np.load(opened, allow_pickle=False, max_header_size=_MAX_HEADING) as file:
        for name in file.files:
            try:
                arrays[name] = file[name]
            except MemoryError as error:  # more numbers than any file can hold
                raise ValueError(f"{name}: {error}") from None
            except (ValueError, EOFError) as error:  # objects, or more numbers than the file holds
                arrays[name] = np.array(str(error))
            _check_rows(arrays[name].shape[0] if arrays[name].ndim else 0)
    return ColumnTable(str(path), arrays)


def _parquet_table(path: Path) -> ColumnTable:
    parquet = require("pyarrow.parquet", str(path))
    _check_rows(parquet.read_metadata(path).num_rows)
    return column_table("source", parquet.read_table(path).to_pandas())._replace(kind=str(path))


_READERS: Final[dict[str, Callable[[Path], ColumnTable]]] = {
    ".csv": _csv_table,
    ".npz": _npz_table,
    ".parquet": _parquet_table,
}
