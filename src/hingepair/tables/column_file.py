"""Columns of numbers by name, out of files: .csv, .npz or .parquet.

What a file says of its size and its kinds of number is judged before anything of that size is made; nothing is run.
"""

from __future__ import annotations

import contextlib
import csv
import io
import itertools
import math
import os
import re
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import IO, Any, Final, NamedTuple, NoReturn, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import real_array
from hingepair.numeric.optional import require
from hingepair.tables.column_tables import ColumnTable

MAX_FILE_ROWS: Final = 10_000_000  # of a file or a table in memory; more are refused
MAX_FILE_BYTES: Final = 2_000_000_000
_MAX_HEADING: Final = 100_000  # characters of the first line of a .csv, bytes of an array's heading in a .npz
# The heading of an array in a .npz: its dtype, its order in memory, its shape.
_NPY_HEADER: Final = re.compile(
    r"\{'descr': '([<>|=]?[A-Za-z]\d{0,9}(?:\[\w{1,9}\])?)', 'fortran_order': (True|False), "
    r"'shape': \(((?:\d{1,18},? ?){0,9})\),? ?\}\s*"
)

# A date of ISO 8601: day, time, and sign, hours and minutes of a zone.
_DATE: Final = re.compile(r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d(?::\d\d(?:\.\d{1,9})?)?)\s*(?:Z|([+-])(\d\d):?(\d\d)?)?")
_DATE_FORMS: Final = (  # for messages
    "a date such as 2026-11-23T10:00:00.25+01:00 (ISO 8601) or 23.11.2026 10:00:00,25 (DD.MM.YYYY HH:MM:SS)"
)

Columns: TypeAlias = dict[str, NDArray[Any]]


HeadingReader: TypeAlias = Callable[[str], tuple[str, float]]
"""Function from a heading to the name of the column and the factor to its SI unit."""


class ColumnRequest(NamedTuple):
    """The columns to read from a file."""

    # From the names of all columns to those to read, in the order of the result; may raise an error.
    choose: Callable[[list[str]], list[str]]
    # From the name of an array and the shape of one sample to the names of its columns, in that shape.
    names_of: Callable[[str, tuple[int, ...]], ArrayLike]
    exact: str = ""  # column whose integers, dates and times stay as they are; all others become float64
    read_heading: HeadingReader = lambda heading: (heading, 1.0)


def read_columns(source: Path | ColumnTable, request: ColumnRequest) -> Columns:
    """Return columns of a .csv, .npz or .parquet file, or of a table in memory: arrays of one length by name. Empty
    cells are NaN.

    Raises:
        ArgumentError: the file cannot be read, has no rows, or is too large; `name` is where: a column, `line 3`,
            `line 3: t` or nothing. Also what `request.choose` and `request.names_of` raise.
        MissingDependencyError: the file is a .parquet and pyarrow is not installed.
    """
    columns = _read_table(source, request) if isinstance(source, ColumnTable) else _read_file(source, request)
    counts = {column.size for column in columns.values()}
    if len(counts) > 1:
        lengths = ", ".join(f"{name}: {column.size}" for name, column in columns.items())
        raise ArgumentError("", "columns of one length", lengths)
    if 0 in counts:
        raise ArgumentError("", "at least one sample", "none")
    return columns


def _read_file(path: Path, request: ColumnRequest) -> Columns:
    """Read columns of a file by the reader of its ending; what it cannot read is an ArgumentError."""
    read = _READERS.get(path.suffix.lower())
    if read is None:
        raise ArgumentError(
            "",
            f"a file name that ends in {', '.join(_READERS)}",
            path.suffix or "no ending",
        )
    expected = f"a {path.suffix} file that can be read"
    if not os.path.isfile(path):  # of a name that is too long Path.is_file would raise
        raise ArgumentError("", expected, "no such file")
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise ArgumentError("", f"at most {MAX_FILE_BYTES} bytes", size)
        return read(path, request)
    except ArgumentError:
        raise
    except (
        *(OSError, EOFError, ValueError, KeyError, NotImplementedError, RuntimeError),
        *(csv.Error, zlib.error, zipfile.BadZipFile),
    ) as error:
        raise ArgumentError("", expected, getattr(error, "strerror", None) or str(error)) from None


def _read_table(table: ColumnTable, request: ColumnRequest) -> Columns:
    """Read columns of a table in memory; an array with several axes has a column for each component."""
    arrays, unread = [], {}
    for heading, array in table.arrays.items():
        is_index = heading == table.index and request.exact not in table.arrays
        name, factor = request.read_heading(request.exact if is_index else heading)
        if unit := table.units.get(heading):
            read, factor = request.read_heading(f"{name} [{unit}]")
            if read != name:
                unread[name] = unit
        names = np.array(request.names_of(name, array.shape[1:]))
        if not array.ndim or array.shape[1:] != names.shape:
            raise ArgumentError(name, "shape " + str(("N", *names.shape)).replace("'", ""), f"shape {array.shape}")
        arrays.append((name, array, factor, names))
    chosen = set(request.choose([column for *_, names in arrays for column in names.ravel().tolist()]))
    columns: Columns = {}
    for name, array, factor, names in arrays:
        _check_rows(len(array))
        if name in unread and chosen.intersection(names.ravel().tolist()):
            raise ArgumentError(name, "the unit of this quantity, as a log may state it", repr(unread[name]))
        for column, part in zip(names.ravel().tolist(), array.reshape(len(array), names.size).T, strict=True):
            if column in chosen:
                if array.dtype.kind not in ("fiumM" if column == request.exact else "fiu"):
                    expected = "numbers; pandas.read_csv(..., sep=';', decimal=',') reads decimal commas"
                    if column == request.exact:
                        expected = "numbers, or dates, which pandas.to_datetime makes of text"
                    got = repr(str(array.ravel()[0])[:40]) if array.size else "none"
                    raise ArgumentError(column, expected, got)
                columns[column] = _in_si_unit(np.array(part, None if column == request.exact else np.float64), factor)
    return columns


def csv_line(cells: Iterable[str]) -> str:
    r"""Return a line of a .csv file, with its line break; cells with commas, quotes or line breaks are quoted.

    >>> csv_line(["t", "shoulder, left"])
    't,"shoulder, left"\n'
    """
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(cells)
    return text.getvalue()


def write_npz(file: IO[bytes], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays of any names to an open .npz file; `numpy.savez` has arguments of its own, such as `file`."""
    with zipfile.ZipFile(file, "w") as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)


def csv_column(
    path: Path, name: str, dtype: DTypeLike, read_heading: HeadingReader = lambda heading: (heading, 1.0)
) -> NDArray[Any]:
    """Return one column of a .csv file in the given dtype, such as int64 for numbers that a float would round."""
    with _open_csv(path) as stream:
        form = _csv_form(stream, read_heading)
        place = form.names.index(name)
        try:
            return _in_si_unit(_csv_rows(stream, form, [place], dtype=dtype)[:, 0], form.factors[place])
        except ValueError as error:
            raise ArgumentError(name, f"numbers of the kind {np.dtype(dtype)}", str(error)) from None


def _read_csv(path: Path, request: ColumnRequest) -> Columns:
    """Read columns of a CSV file; the exact one is of dates, or int64 if its numbers are too large for floats."""
    with _open_csv(path) as stream:
        form = _csv_form(stream, request.read_heading)
        names = form.names
        chosen = request.choose(names)
        if not chosen:
            return {}
        dated = request.exact if request.exact in chosen and request.exact in form.dated else ""
        numbered = [name for name in chosen if name != dated]
        positions = [names.index(name) for name in numbered]
        used = positions if len(positions) < len(names) else None  # all: then rows of more fields are found
        start = stream.tell()
        try:
            try:
                rows = _csv_rows(stream, form, used)
            except ValueError:  # once more, slowly: an empty cell is a number that is not there
                stream.seek(start)
                rows = _csv_rows(stream, form, used, converters=_cell_number)
        except ValueError as error:
            _fail_at_row(path, form, positions, str(error), request.exact)
        if next(stream, None) is not None:
            raise ArgumentError("", f"at most {MAX_FILE_ROWS} samples", "more lines")
    if rows.size and rows.shape[1] != len(positions):
        _fail_at_row(path, form, positions, f"{rows.shape[1]} fields", request.exact)
    _check_rows(len(rows))
    read = np.ascontiguousarray(rows.T) if rows.size else np.empty((len(positions), 0))
    factors = [form.factors[i] for i in positions]
    columns = {
        name: _in_si_unit(column, factor) for name, column, factor in zip(numbered, read, factors, strict=True)
    }
    if dated:
        columns[dated] = _csv_dates(path, form, dated)
    elif request.exact in columns:
        largest = np.abs(columns[request.exact]).max(initial=0.0)
        if largest > 1e14:  # integers: nanoseconds, which a float rounds
            columns[request.exact] = csv_column(path, request.exact, np.int64, request.read_heading)
    return columns


class _CsvForm(NamedTuple):
    """How a CSV file is written, by its first two lines."""

    names: list[str]
    factors: list[float]  # to SI units
    delimiter: str  # a comma, a semicolon or a tab
    has_decimal_commas: bool
    dated: list[str]  # names of the columns whose cells are dates


def _open_csv(path: Path) -> IO[str]:
    """Open a CSV file of UTF-8; other bytes are let through, since only names and numbers have to be understood."""
    return path.open(encoding="utf-8-sig", errors="surrogateescape", newline="")


def _legible(text: str) -> str:
    """Return text of a CSV file; text that is not UTF-8 is taken for Windows-1252."""
    content = text.encode("utf-8", "surrogateescape")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        return content.decode("cp1252", "replace")


def _csv_form(stream: IO[str], read_heading: HeadingReader) -> _CsvForm:
    """Return the form of a CSV file, of which the first line is consumed and the second one looked at."""
    line = stream.readline(_MAX_HEADING)
    if len(line) == _MAX_HEADING:
        raise ArgumentError("", "a first line of column names", "a longer line")
    if "\0" in line:
        raise ArgumentError("", "a text file in UTF-8 or Windows-1252", "zero bytes, as of UTF-16")
    start = stream.tell()
    lines = _legible(line).removeprefix("#"), stream.readline(_MAX_HEADING)  # numpy.savetxt writes a #
    stream.seek(start)
    splits = {sign: [next(csv.reader([one], delimiter=sign), []) for one in lines] for sign in ",;\t"}
    # Names may have the other signs; then the first row tells which one separates.
    # The comma comes last: names and decimal numbers of a row may agree in their commas.
    agreeing = [sign for sign in ";\t," if len(splits[sign][0]) == len(splits[sign][1]) > 1]
    delimiter = agreeing[0] if agreeing else max(splits, key=lambda sign: len(splits[sign][0]))
    headings, cells = [heading.strip() for heading in splits[delimiter][0]], splits[delimiter][1]
    if not headings:
        raise ArgumentError("", "a first line of column names", "an empty line")
    if all(map(_is_number, headings)):
        raise ArgumentError("", "a first line of column names", "numbers")
    decimal_commas = delimiter != "," and any(
        re.fullmatch(r"\s*[+-]?\d*,\d+(e[+-]?\d+)?\s*", cell, re.I) for cell in cells
    )
    names, factors = map(list, zip(*map(read_heading, headings), strict=True))
    dated = [name for name, cell in zip(names, cells, strict=False) if _DATE.match(_iso_date(cell))]
    return _CsvForm(names, factors, delimiter, decimal_commas, dated)


def _in_si_unit(column: NDArray[Any], factor: float) -> NDArray[Any]:
    return column if factor == 1.0 else column * factor


def _csv_rows(stream: IO[str], form: _CsvForm, columns: list[int] | None, **options: Any) -> NDArray[Any]:
    """Return the next lines, at most one more than a file may have, as a 2D array of columns by index."""
    options = {"delimiter": form.delimiter, "comments": None, "quotechar": '"', "ndmin": 2} | options
    lines: Iterable[str] = itertools.islice(stream, MAX_FILE_ROWS + 1)
    if form.has_decimal_commas:
        lines = (line.replace(",", ".") for line in lines)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # no rows: an error of ours
        warnings.simplefilter("error", DeprecationWarning)  # NumPy before 2.4 reads integers through floats
        # With max_rows, loadtxt would ask for the memory of so many rows at once.
        return np.loadtxt(lines, usecols=columns, **options)


def _iso_date(cell: str) -> str:
    """Return a cell whose date, if it is DD.MM.YYYY, is written as in ISO 8601, with a decimal point.

    >>> _iso_date("23.11.2026 10:00:00,25")
    '2026-11-23 10:00:00.25'
    """
    return re.sub(r"^(\d\d)\.(\d\d)\.(\d{4})\b", r"\3-\2-\1", cell.strip().replace(",", "."))


def _csv_dates(path: Path, form: _CsvForm, name: str) -> NDArray[np.datetime64]:
    """Return a column of dates in UTC; without a zone, they are taken for UTC."""
    with _open_csv(path) as stream:
        stream.readline()
        reader, place = csv.reader(stream, delimiter=form.delimiter), form.names.index(name)
        dates = []
        for row in filter(None, reader):
            match = _DATE.fullmatch(_iso_date(row[place])) if place < len(row) else None
            try:
                if match is None:
                    raise ValueError
                date = np.datetime64(f"{match[1]}T{match[2]}", "ns")
            except ValueError:
                got = repr(_legible(row[place][:40])) if place < len(row) else f"{len(row)} fields"
                raise ArgumentError(f"line {reader.line_num + 1}: {name}", _DATE_FORMS, got) from None
            if match[3]:
                minutes = 60 * int(match[4]) + int(match[5] or 0)
                date -= np.timedelta64(minutes if match[3] == "+" else -minutes, "m")
            dates.append(date)
    return np.array(dates, "datetime64[ns]")


def _cell_number(text: str) -> float:
    """Return the number in a cell, NaN if it is blank."""
    if "_" in text:  # Python reads 1_5 as 15
        raise ValueError(text)
    return float(text) if text.strip() else math.nan


def _is_number(text: str) -> bool:
    try:
        return bool(text.strip()) and _cell_number(text) is not None
    except ValueError:
        return False


def _fail_at_row(path: Path, form: _CsvForm, positions: list[int], reason: str, exact: str) -> NoReturn:
    """Raise the error of the first row with too few or too many fields, or a cell that is no number; else give the
    reason. In the column `exact`, dates are expected too.
    """
    with _open_csv(path) as stream:
        stream.readline()
        names, reader = form.names, csv.reader(stream, delimiter=form.delimiter)
        try:
            for row in filter(None, reader):
                place, fields = f"line {reader.line_num + 1}", len(row)
                if fields <= max(positions) or (len(positions) == len(names) < fields):
                    separator = {",": "commas, with decimal points", ";": "semicolons", "\t": "tabs"}[form.delimiter]
                    expected = f"{len(names)} fields, separated by {separator}"
                    raise ArgumentError(place, expected, f"{fields} fields")
                for i in positions:
                    try:
                        _cell_number(row[i].replace(",", ".") if form.has_decimal_commas else row[i])
                    except ValueError:
                        expected = "a number (nan or an empty cell where there is none)"
                        if names[i] == exact and re.match(r"\s*\d+[-./:]\d", row[i]):
                            expected = f"a number, or {_DATE_FORMS}"
                        raise ArgumentError(f"{place}: {names[i]}", expected, repr(_legible(row[i][:40]))) from None
        except csv.Error as error:
            reason = str(error)
    raise ArgumentError("", "rows of numbers", reason)


def _read_npz(path: Path, request: ColumnRequest) -> Columns:
    """Read columns of an NPZ file; an array with several axes has a column for each component."""
    columns: Columns = {}
    with zipfile.ZipFile(path) as archive:
        arrays = []
        for member in archive.infolist():
            name, factor = request.read_heading(member.filename.removesuffix(".npy"))
            with archive.open(member) as stream:
                _, _, shape = _read_npy_header(stream)
            arrays.append((member, name, factor, np.array(request.names_of(name, shape[1:]))))
        chosen = set(request.choose([column for *_, names in arrays for column in names.ravel().tolist()]))
        for member, name, factor, names in arrays:
            columns_of_array = names.ravel().tolist()
            if chosen.intersection(columns_of_array):
                with archive.open(member) as stream:
                    array = _read_npy_array(stream, name, names.shape, name == request.exact)
                kind = array.dtype if name == request.exact else np.float64
                parts = zip(columns_of_array, array.reshape(len(array), names.size).T, strict=True)
                columns |= {
                    column: _in_si_unit(np.ascontiguousarray(part, kind), factor)
                    for column, part in parts
                    if column in chosen
                }
    return columns


def _read_npy_array(stream: IO[bytes], name: str, sample_shape: tuple[int, ...], exact: bool) -> NDArray[Any]:
    """Read an array (N, *sample_shape) of real numbers; dates and times if it is `exact`."""
    dtype, fortran, shape = _read_npy_header(stream)
    if dtype is None:
        raise ArgumentError(name, "an array of real numbers (float64, float32 or integers)", "another header")
    if not (exact and dtype.kind in "mM"):
        real_array(name, np.empty(0, dtype))
    if shape[1:] != sample_shape or not shape:
        raise ArgumentError(name, "shape " + str(("N", *sample_shape)).replace("'", ""), f"shape {shape}")
    _check_rows(shape[0])
    size = math.prod(shape) * dtype.itemsize
    content = stream.read(size)
    if len(content) < size:
        raise ArgumentError(name, f"{size} bytes of numbers", len(content))
    return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran else "C")


def _read_npy_header(stream: IO[bytes]) -> tuple[np.dtype[Any] | None, bool, tuple[int, ...]]:
    """Return dtype, Fortran order and shape of an array; the dtype is None if the header is not understood."""
    magic = stream.read(8)
    size = int.from_bytes(stream.read(2 if magic[6:7] == b"\x01" else 4), "little")
    text = stream.read(size).decode("latin1") if magic[:6] == b"\x93NUMPY" and size <= _MAX_HEADING else ""
    if header := _NPY_HEADER.fullmatch(text):
        with contextlib.suppress(TypeError, ValueError):
            return np.dtype(header[1]), header[2] == "True", tuple(int(n) for n in header[3].split(",") if n.strip())
    return None, False, ()


def _read_parquet(path: Path, request: ColumnRequest) -> Columns:
    """Read columns of a Parquet file."""
    pa, pq = require("pyarrow", str(path)), require("pyarrow.parquet", str(path))
    columns: Columns = {}
    try:
        with pq.ParquetFile(path) as file:
            _check_rows(file.metadata.num_rows)
            kinds = file.schema_arrow
            names, factors = zip(*map(request.read_heading, kinds.names), strict=True) if kinds.names else ((), ())
            for name in request.choose([*names]):
                place = names.index(name)
                heading, factor = kinds.names[place], factors[place]
                kind, exact = kinds.field(heading).type, name == request.exact
                number = pa.types.is_floating(kind) or pa.types.is_integer(kind)
                if not (number or (exact and pa.types.is_temporal(kind))):
                    raise ArgumentError(name, "a column of numbers", str(kind))
                column = file.read([heading])[heading]
                numbers = np.array((column if exact else column.cast(pa.float64(), safe=False)).to_numpy())
                columns[name] = _in_si_unit(numbers, factor)
    except pa.ArrowException as error:
        raise OSError(str(error)) from None
    return columns


def _check_rows(count: int) -> None:
    if count > MAX_FILE_ROWS:
        raise ArgumentError("", f"at most {MAX_FILE_ROWS} samples", count)


# The readers, by the ending of the file.
_READERS: Final[dict[str, Callable[[Path, ColumnRequest], Columns]]] = {
    ".csv": _read_csv,
    ".npz": _read_npz,
    ".parquet": _read_parquet,
}
