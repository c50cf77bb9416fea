"""Tables of columns in files: .csv, .npz or .parquet.

What a file says of its size and its kinds of number is judged before anything of that size is made; nothing is run.
pandas would read the text of a .csv no faster (500,000 rows of four numbers: 2.1 s, here 1.7 s), and its fields would
have to be counted beside it all the same: it fills short rows, renames doubled names and shifts long rows in silence.
"""

from __future__ import annotations

import csv
import itertools
import math
import os
import re
import zipfile
import zlib
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, Any, Final, NamedTuple, NoReturn, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError
from hingepair.numeric.optional import require
from hingepair.tables.column_tables import ColumnTable, column_table

MAX_FILE_ROWS: Final = 10_000_000  # of a file or a table in memory; more are refused
MAX_FILE_BYTES: Final = 2_000_000_000
_MAX_HEADING: Final = 100_000  # characters of a line above the numbers, bytes of an array's heading in a .npz
_MAX_PREAMBLE: Final = 100  # lines above the names
_ROWS_PER_BLOCK: Final = 65_536  # of a .csv whose text is in memory at a time
_COMMENT: Final = re.compile(r"\s*(#|//|%)")  # beginning of a line above the names

_DATE: Final = re.compile(r"\d{4}-\d\d-\d\d[T ]\d")  # beginning of a date of ISO 8601
_DATE_FORMS: Final = (  # for messages
    "a date such as 2026-11-23T10:00:00.25+01:00 (ISO 8601) or 23.11.2026 10:00:00,25 (DD.MM.YYYY HH:MM:SS)"
)

Columns: TypeAlias = dict[str, NDArray[Any]]


def file_table(path: Path) -> ColumnTable:
    """Return the columns of a .csv, .npz or .parquet file. Empty cells are NaN; a column that is not exact becomes
    float64.

    Raises:
        ArgumentError: the file cannot be read, has no rows, or is too large; `name` is where: a column, `line 3`,
            `line 3: t` or nothing. Its `read` raises the same.
        MissingDependencyError: the file is a .parquet and pyarrow is not installed.
    """
    suffix = path.suffix.lower()
    open_table = _TABLES.get(suffix)
    if open_table is None:
        raise ArgumentError("", f"a file name that ends in {', '.join(_TABLES)}", path.suffix or "no ending")
    if not os.path.isfile(path):  # of a name that is too long Path.is_file would raise
        raise ArgumentError("", f"a {path.suffix} file that can be read", "no such file")
    table = _as_ours(path, lambda: open_table(path))

    def read(wanted: Collection[str], exact: str) -> Columns:
        columns: Columns = _as_ours(path, lambda: table.read(wanted, exact))
        return {n: a if n == exact else a.astype(np.float64) for n, a in columns.items()}

    return ColumnTable(str(path), table.shapes, read, suffix=suffix, doubled=table.doubled)


def _as_ours(path: Path, work: Callable[[], Any]) -> Any:
    """Return the result of `work`, whose errors are on a file that cannot be read."""
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise ArgumentError("", f"at most {MAX_FILE_BYTES} bytes", path.stat().st_size)
        return work()
    except ArgumentError:
        raise
    except (
        *(OSError, EOFError, ValueError, KeyError, NotImplementedError, RuntimeError),
        *(csv.Error, zlib.error, zipfile.BadZipFile),
    ) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise ArgumentError("", f"a {path.suffix} file that can be read", reason) from None


def _check_rows(count: int, got: object = None) -> None:
    if count > MAX_FILE_ROWS:
        raise ArgumentError("", f"at most {MAX_FILE_ROWS} samples", count if got is None else got)


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
    with _opened(path) as stream:
        form = _csv_form(stream)

    def read(wanted: Collection[str], exact: str) -> Columns:
        with _opened(path) as stream:
            for _ in range(form.skipped):
                stream.readline()
            return _csv_columns(stream, form, list(wanted), exact)

    doubled = {name for name in form.headings if form.headings.count(name) > 1}
    return ColumnTable(str(path), dict.fromkeys(form.headings, ()), read, doubled=doubled)


def _opened(path: Path) -> IO[str]:
    # Bytes that are not UTF-8 are let through, since only names and numbers have to be understood.
    return path.open(encoding="utf-8-sig", errors="surrogateescape", newline="")


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
    plain = [k for k in filled if not _COMMENT.match(lines[k])]
    if not filled or not lines[plain[0] if plain else filled[0]].strip():
        raise ArgumentError("", "a first line of column names", "an empty line")
    for place, following in itertools.pairwise(filled):
        forms = _agreeing_forms(_COMMENT.sub("", _legible(lines[place]), count=1), lines[following])
        if forms and not _COMMENT.match(lines[following]):  # numpy.savetxt writes a # before the names
            return _CsvForm(*forms[0], skipped=place + 1)
    place = plain[0] if plain else filled[0]
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


def _csv_columns(stream: IO[str], form: _CsvForm, wanted: list[str], exact: str) -> Columns:
    """Return columns of numbers, and instants that may be dates; refuse rows and cells that are none of these."""
    places = {name: form.headings.index(name) for name in wanted}
    cells: dict[str, list[NDArray[Any]]] = {name: [] for name in wanted}
    count, marks = 0, set[str]()
    for rows in _blocks_of_rows(csv.reader(stream, delimiter=form.delimiter), form):
        count += len(rows)
        _check_rows(count, "more lines")
        for name, place in places.items():
            texts = [row[place] for _, row in rows]
            try:
                cells[name].append(_instants(texts, form) if name == exact else _numbers(texts, form, marks))
            except ValueError:
                _fail_at_cell(rows, name, place, form, is_exact=name == exact)
    if len(marks) > 1:
        raise ArgumentError("", "one decimal mark in all rows", "points and commas")
    return {name: np.concatenate(blocks) if blocks else np.empty(0) for name, blocks in cells.items()}


def _blocks_of_rows(reader: Any, form: _CsvForm) -> Iterator[list[tuple[int, list[str]]]]:
    """Yield rows with the number of their line, without blank ones, block by block; refuse rows that have more or
    fewer fields than there are names. An empty field at the end is no field.
    """
    count = len(form.headings)
    while block := [(reader.line_num, row) for row in itertools.islice(reader, _ROWS_PER_BLOCK)]:
        rows = [(line, row) for line, row in block if row and (count == 1 or any(map(str.strip, row)))]
        for line, row in rows:
            if len(row) != count and not (len(row) == count + 1 and not row[-1].strip()):
                separator = {",": "commas, with decimal points", ";": "semicolons", "\t": "tabs"}[form.delimiter]
                expected = f"{count} fields, separated by {separator}"
                raise ArgumentError(f"line {line + form.skipped}", expected, f"{len(row)} fields")
        if rows:
            yield rows


def _numbers(texts: Sequence[str], form: _CsvForm, marks: set[str]) -> NDArray[np.float64]:
    """Return the numbers in cells, NaN of blank ones; add their decimal marks to `marks`."""
    whole = "".join(texts)
    if "_" in whole:  # Python reads 1_5 as 15
        raise ValueError
    if form.delimiter != ",":
        marks.update({",", "."}.intersection(whole))
        texts = [text.replace(",", ".") for text in texts] if "," in whole else texts
    try:
        return np.fromiter(map(float, texts), np.float64, len(texts))
    except ValueError:  # once more, slowly: an empty cell is a number that is not there
        return np.array([float(text) if text.strip() else math.nan for text in texts])


def _instants(texts: Sequence[str], form: _CsvForm) -> NDArray[Any]:
    """Return the instants in cells: dates (UTC where they name no zone), integers that a double would round, or
    numbers.
    """
    if _DATE.match(_iso_date(texts[0])):
        import pandas

        dates = pandas.to_datetime([_iso_date(text) for text in texts], utc=True, format="ISO8601")
        return np.asarray(dates.tz_localize(None).to_numpy("datetime64[ns]"))
    numbers = _numbers(texts, form, set())
    largest = float(np.abs(numbers).max(initial=0.0))
    if largest > 1e14:  # integers: nanoseconds, which a float rounds
        return np.array(list(map(int, texts)), np.int64)
    if largest <= 1e5:  # s: doubles beyond are rounded to more than 1e-11 s
        return numbers
    return np.array([text.strip().replace(",", ".") or "nan" for text in texts]).astype(np.longdouble)


def _fail_at_cell(
    rows: list[tuple[int, list[str]]], name: str, place: int, form: _CsvForm, *, is_exact: bool
) -> NoReturn:
    """Raise the error of the first row of which a cell is no number or, in the column of instants, no date."""
    first = rows[0][1][place]
    for line, row in rows:
        text = row[place]
        try:
            _instants([first, text], form) if is_exact else _numbers([text], form, set())
        except ValueError:
            expected = "a number (nan or an empty cell where there is none)"
            if is_exact and _DATE.match(_iso_date(first)):
                expected = _DATE_FORMS
            elif is_exact and first.strip().isdigit() and float(first) > 1e14:
                expected = "a whole number of nanoseconds, as in the first row"
            elif is_exact and re.match(r"\s*\d+[-./:]\d", text):
                expected = f"a number, or {_DATE_FORMS}"
            where = f"line {line + form.skipped}: {name}"
            raise ArgumentError(where, expected, repr(_legible(text[:40]))) from None
    raise ArgumentError(name, "numbers or dates of one kind", "several")


def _is_number(text: str) -> bool:
    try:
        return bool(text.strip()) and "_" not in text and float(text.replace(",", ".")) is not None
    except ValueError:
        return False


def _legible(text: str) -> str:
    """Return text of a CSV file; text that is not UTF-8 is taken for Windows-1252."""
    content = text.encode("utf-8", "surrogateescape")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace")


def _iso_date(cell: str) -> str:
    """Return a cell whose date, if it is DD.MM.YYYY, is written as in ISO 8601, with a decimal point.

    >>> _iso_date("23.11.2026 10:00:00,25")
    '2026-11-23 10:00:00.25'
    """
    return re.sub(r"^(\d\d)\.(\d\d)\.(\d{4})\b", r"\3-\2-\1", cell.strip().replace(",", "."))


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
    return column_table("source", arrays)


def _parquet_table(path: Path) -> ColumnTable:
    pa, pq = require("pyarrow", str(path)), require("pyarrow.parquet", str(path))
    try:
        _check_rows(pq.read_metadata(path).num_rows)
        return column_table("source", pq.read_table(path).to_pandas())
    except pa.ArrowException as error:
        raise OSError(str(error)) from None


# The tables of files, by the ending of the file.
_TABLES: Final[dict[str, Callable[[Path], ColumnTable]]] = {
    ".csv": _csv_table,
    ".npz": _npz_table,
    ".parquet": _parquet_table,
}
