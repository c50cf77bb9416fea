"""Columns of numbers by name, out of files: .csv, .npz or .parquet, and out of tables in memory.

What a file says of its size and its kinds of number is judged before anything of that size is made; nothing is run.
"""

from __future__ import annotations

import csv
import functools
import io
import itertools
import math
import os
import re
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
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
_MAX_FIELDS: Final = 100_000  # of a row of a .csv
_ROWS_PER_BLOCK: Final = 65_536  # of a .csv whose text is in memory at a time
_COMMENT: Final = re.compile(r"\s*(#|//|%)")  # beginning of a line above the names

# A date of ISO 8601: day, time, and sign, hours and minutes of a zone.
_DATE: Final = re.compile(r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d(?::\d\d(?:\.\d{1,9})?)?)\s*(?:Z|([+-])(\d\d):?(\d\d)?)?")
_DATE_FORMS: Final = (  # for messages
    "a date such as 2026-11-23T10:00:00.25+01:00 (ISO 8601) or 23.11.2026 10:00:00,25 (DD.MM.YYYY HH:MM:SS)"
)

Columns: TypeAlias = dict[str, NDArray[Any]]


class ColumnRequest(NamedTuple):
    """The columns to read."""

    # From the names of all columns to those to read, in the order of the result; may raise an error.
    choose: Callable[[list[str]], list[str]]
    # From the name of an array and the shape of one sample to the names of its columns, in that shape.
    names_of: Callable[[str, tuple[int, ...]], ArrayLike]
    # Column whose integers, dates and times stay as they are, and whose decimals have all digits of a long double
    # where a double rounds them; all others become float64.
    exact: str = ""
    # From a heading to the name of the column and the factor to its SI unit.
    read_heading: Callable[[str], tuple[str, float]] = lambda heading: (heading, 1.0)


class _Array(NamedTuple):
    """An array of a file or of a table in memory, not yet read."""

    heading: str
    sample_shape: tuple[int, ...]
    rows: int
    read: Callable[[bool], NDArray[Any]]  # as numbers; as they are if the argument is True


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
        raise ArgumentError("", f"a file name that ends in {', '.join(_READERS)}", path.suffix or "no ending")
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


def _read_arrays(arrays: Iterable[_Array], request: ColumnRequest) -> Columns:
    """Return the chosen columns of arrays; an array with several axes has a column for each component."""
    named = []
    for array in arrays:
        name, factor = request.read_heading(array.heading)
        names = np.array(request.names_of(name, array.sample_shape))
        named.append((array, name, factor, names))
    chosen = request.choose([column for *_, names in named for column in names.ravel().tolist()])
    columns: Columns = {}
    for array, name, factor, names in named:
        if not set(chosen).intersection(names.ravel().tolist()):
            continue
        if array.sample_shape != names.shape or array.rows < 0:
            shape = (array.rows, *array.sample_shape) if array.rows >= 0 else ()
            raise ArgumentError(name, "shape " + str(("N", *names.shape)).replace("'", ""), f"shape {shape}")
        _check_rows(array.rows)
        exact = name == request.exact
        numbers = array.read(exact)
        for column, part in zip(names.ravel().tolist(), numbers.reshape(array.rows, names.size).T, strict=True):
            if column in chosen:
                columns[column] = _in_si_unit(np.array(part, None if exact else np.float64), factor)
    return {name: columns[name] for name in chosen if name in columns}


def _read_table(table: ColumnTable, request: ColumnRequest) -> Columns:
    """Read columns of a table in memory."""
    unread = {}  # units that are none of the quantity, by the column
    headings = {}
    for heading in table.arrays:
        is_index = heading == table.index and request.exact not in table.arrays
        name, _ = request.read_heading(request.exact if is_index else heading)
        headings[heading] = request.exact if is_index else heading
        if unit := table.units.get(heading):
            headings[heading] = f"{name} [{unit}]"
            if request.read_heading(headings[heading])[0] != name:
                headings[heading], unread[name] = name, unit

    def read(heading: str, exact: bool) -> NDArray[Any]:
        """Return an array of the table; refuse text."""
        array, name = table.arrays[heading], request.read_heading(headings[heading])[0]
        if name in unread:
            raise ArgumentError(name, "the unit of this quantity, as a log may state it", repr(unread[name]))
        if array.dtype.kind not in ("fiumM" if exact else "fiu"):
            expected = "numbers; pandas.read_csv(..., sep=';', decimal=',') reads decimal commas"
            if exact:
                expected = "numbers, or dates, which pandas.to_datetime makes of text"
            raise ArgumentError(name, expected, repr(str(array.ravel()[0])[:40]) if array.size else "none")
        return array

    return _read_arrays(
        [
            _Array(headings[name], a.shape[1:], len(a) if a.ndim else -1, functools.partial(read, name))
            for name, a in table.arrays.items()
        ],
        request,
    )


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


def _in_si_unit(column: NDArray[Any], factor: float) -> NDArray[Any]:
    return column if factor == 1.0 else column * factor


def _check_rows(count: int) -> None:
    if count > MAX_FILE_ROWS:
        raise ArgumentError("", f"at most {MAX_FILE_ROWS} samples", count)


# ---- CSV


class _CsvForm(NamedTuple):
    """How a CSV file is written, by its names and the row below them."""

    headings: list[str]
    delimiter: str  # a comma, a semicolon or a tab
    skipped: int  # lines up to the names


def _read_csv(path: Path, request: ColumnRequest) -> Columns:
    """Read columns of a CSV file. Every row has a field for each name; what is chosen are numbers."""
    # Bytes that are not UTF-8 are let through, since only names and numbers have to be understood.
    with path.open(encoding="utf-8-sig", errors="surrogateescape", newline="") as stream:
        form = _csv_form(stream)
        names, factors = map(list, zip(*map(request.read_heading, form.headings), strict=True))
        chosen = request.choose(names)
        if not chosen:
            return {}
        start = stream.tell()
        try:
            columns = _regular_columns(stream, form, chosen, names, request.exact)
        except ValueError:  # quotes, dates, empty cells or errors: each cell by itself
            stream.seek(start)
            columns = _any_columns(stream, form, chosen, names, request.exact)
    return {name: _in_si_unit(column, factors[names.index(name)]) for name, column in columns.items()}


def _regular_columns(stream: IO[str], form: _CsvForm, chosen: list[str], names: list[str], exact: str) -> Columns:
    """Return columns of a file of numbers alone, without quotes; raise a ValueError if it is none."""
    start = stream.tell()

    def lines(marks: set[str]) -> Iterator[str]:
        """Yield the lines that are not blank."""
        separators, count = len(names) - 1, 0
        for line in stream:
            if not line.strip():
                continue
            count += 1
            if count > MAX_FILE_ROWS:
                raise ArgumentError("", f"at most {MAX_FILE_ROWS} samples", "more lines")
            if '"' in line or line.count(form.delimiter) != separators:
                raise ValueError
            if form.delimiter == ",":
                yield line
            else:
                marks.update({",", "."}.intersection(line))
                yield line.replace(",", ".")
        if len(marks) > 1:
            raise ValueError

    def numbers(positions: list[int], dtype: DTypeLike) -> NDArray[Any]:
        stream.seek(start)
        options: dict[str, Any] = {"delimiter": form.delimiter, "comments": None, "ndmin": 2, "dtype": dtype}
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # no rows: an error of ours
            warnings.simplefilter("error", DeprecationWarning)  # NumPy before 2.4 reads integers through floats
            return np.loadtxt(lines(set()), usecols=positions, **options)

    table = numbers([names.index(name) for name in chosen], np.float64)
    columns = dict(
        zip(chosen, np.ascontiguousarray(table.T) if table.size else np.empty((len(chosen), 0)), strict=True)
    )
    if exact in columns and (kind := _exact_kind(columns[exact])) != np.float64:
        columns[exact] = numbers([names.index(exact)], kind)[:, 0]
    return columns


def _exact_kind(instants: NDArray[np.float64]) -> DTypeLike:
    """Return the dtype that holds the digits of instants in a file."""
    largest = float(np.abs(instants).max(initial=0.0))
    if largest > 1e14:  # integers: nanoseconds, which a float rounds
        return np.int64
    return np.longdouble if largest > 1e5 else np.float64  # s: doubles beyond are rounded to more than 1e-11 s


def _any_columns(stream: IO[str], form: _CsvForm, chosen: list[str], names: list[str], exact: str) -> Columns:
    """Return columns of numbers, and instants that may be dates; refuse rows and cells that are none of these."""
    reader = csv.reader(stream, delimiter=form.delimiter)
    cells: dict[str, list[NDArray[Any]]] = {name: [] for name in chosen}
    count, marks = 0, set[str]()
    for rows in _blocks_of_rows(reader, form, len(names)):
        count += len(rows)
        if count > MAX_FILE_ROWS:
            raise ArgumentError("", f"at most {MAX_FILE_ROWS} samples", "more lines")
        for name in chosen:
            place = names.index(name)
            texts = [row[place] for _, row in rows]
            try:
                block = _exact_cells(texts, form) if name == exact else _numbers(texts, form, marks)
            except ValueError:
                _fail_at_cell(rows, name, place, form, is_exact=name == exact)
            cells[name].append(block)
    if len(marks) > 1:
        raise ArgumentError("", "one decimal mark in all rows", "points and commas")
    return {name: np.concatenate(blocks) if blocks else np.empty(0) for name, blocks in cells.items()}


def _csv_form(stream: IO[str]) -> _CsvForm:
    """Return the form of a CSV file, of which the lines up to the names are consumed."""
    skipped, line = 0, stream.readline(_MAX_HEADING)
    while _COMMENT.match(line) or (line and not line.strip()):
        start, following = stream.tell(), stream.readline(_MAX_HEADING)
        is_last = following and not _COMMENT.match(following)
        splits = _splits(line, following)
        if is_last and any(len(one) == len(two) and any(map(_is_number, two)) for one, two in splits.values()):
            line = _COMMENT.sub("", line, count=1)  # numpy.savetxt writes a # before the names
            stream.seek(start)
            break
        skipped, line = skipped + 1, following
    if len(line) == _MAX_HEADING:
        raise ArgumentError("", "a first line of column names", "a longer line")
    if "\0" in line:
        raise ArgumentError("", "a text file in UTF-8 or Windows-1252", "zero bytes, as of UTF-16")
    start = stream.tell()
    splits = _splits(_legible(line), stream.readline(_MAX_HEADING))
    stream.seek(start)
    # Names may have the other signs; then the first row tells which one separates.
    # The comma comes last: names and decimal numbers of a row may agree in their commas.
    agreeing = [sign for sign in ";\t," if len(splits[sign][0]) == len(splits[sign][1]) > 1]
    delimiter = agreeing[0] if agreeing else max(splits, key=lambda sign: len(splits[sign][0]))
    headings = [heading.strip() for heading in splits[delimiter][0]]
    if not headings:
        raise ArgumentError("", "a first line of column names", "an empty line")
    if all(map(_is_number, headings)):
        raise ArgumentError("", "a first line of column names", "numbers")
    return _CsvForm(headings, delimiter, skipped + 1)


def _splits(heading: str, row: str) -> dict[str, list[list[str]]]:
    """Return the fields of two lines by the sign that may separate them."""
    return {sign: [next(csv.reader([one], delimiter=sign), []) for one in (heading, row)] for sign in ",;\t"}


def _blocks_of_rows(reader: Any, form: _CsvForm, count: int) -> Iterator[list[tuple[int, list[str]]]]:
    """Yield rows with the number of their line, without blank ones, block by block; refuse rows that have more or
    fewer fields than there are names. An empty field at the end is no field.
    """
    while block := [(reader.line_num, row) for row in itertools.islice(reader, _ROWS_PER_BLOCK)]:
        rows = [(line, row) for line, row in block if row]
        for line, row in rows:
            if len(row) != count and not (len(row) == count + 1 and not row[-1].strip()):
                separator = {",": "commas, with decimal points", ";": "semicolons", "\t": "tabs"}[form.delimiter]
                expected = f"{count} fields, separated by {separator}"
                raise ArgumentError(f"line {line + form.skipped}", expected, f"{len(row)} fields")
        if rows:
            yield rows


def _numbers(texts: list[str], form: _CsvForm, marks: set[str]) -> NDArray[np.float64]:
    """Return the numbers in cells, NaN of blank ones; add their decimal marks to `marks`."""
    whole = "".join(texts)
    if "_" in whole:  # Python reads 1_5 as 15
        raise ValueError
    if form.delimiter != "," and "," in whole:
        marks.update({",", "."}.intersection(whole))
        texts = [text.replace(",", ".") for text in texts]
    elif form.delimiter != ",":
        marks.update({"."}.intersection(whole))
    try:
        return np.array(texts, dtype=object).astype(np.float64)
    except ValueError:  # once more, slowly: an empty cell is a number that is not there
        return np.array([float(text) if text.strip() else math.nan for text in texts])


def _exact_cells(texts: list[str], form: _CsvForm) -> NDArray[Any]:
    """Return the instants in cells: dates, integers that a double would round, or numbers."""
    if _DATE.match(_iso_date(texts[0])):
        return np.array([_date(text) for text in texts], "datetime64[ns]")
    numbers = _numbers(texts, form, set())
    kind = _exact_kind(numbers)
    if kind == np.float64:
        return numbers
    if kind == np.int64:
        return np.array(list(map(int, texts)), np.int64)
    return np.array([text.strip().replace(",", ".") or "nan" for text in texts]).astype(np.longdouble)


def _fail_at_cell(
    rows: list[tuple[int, list[str]]], name: str, place: int, form: _CsvForm, *, is_exact: bool
) -> NoReturn:
    """Raise the error of the first row of which a cell is no number or, in the column of instants, no date."""
    first = rows[0][1][place]
    for line, row in rows:
        text = row[place]
        try:
            _exact_cells([first, text], form) if is_exact else _numbers([text], form, set())
        except ValueError:
            expected = "a number (nan or an empty cell where there is none)"
            if is_exact and _DATE.match(_iso_date(first)):
                expected = _DATE_FORMS
            elif is_exact and first.strip().isdigit() and _exact_kind(np.array([float(first)])) == np.int64:
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


def _date(cell: str) -> np.datetime64:
    """Return the date in a cell, in UTC; without a zone, it is taken for UTC. Raise a ValueError if it is none."""
    match = _DATE.fullmatch(_iso_date(cell))
    if match is None:
        raise ValueError
    date = np.datetime64(f"{match[1]}T{match[2]}", "ns")
    if match[3]:
        minutes = 60 * int(match[4]) + int(match[5] or 0)
        date -= np.timedelta64(minutes if match[3] == "+" else -minutes, "m")
    return date


# ---- other files


def _read_npz(path: Path, request: ColumnRequest) -> Columns:
    """Read columns of an NPZ file."""
    with zipfile.ZipFile(path) as archive:

        def read(name: str, exact: bool) -> NDArray[Any]:
            """Return an array of real numbers; dates and times if it is `exact`."""
            column, _ = request.read_heading(name.removesuffix(".npy"))
            with archive.open(name) as stream:
                shape, fortran, dtype = _read_npy_header(stream)
                if dtype is None:
                    wanted = "an array of real numbers (float64, float32 or integers)"
                    raise ArgumentError(column, wanted, "another header")
                if not (exact and dtype.kind in "mM"):
                    real_array(column, np.empty(0, dtype))
                size = math.prod(shape) * dtype.itemsize
                content = stream.read(size)
            if len(content) < size:
                raise ArgumentError(column, f"{size} bytes of numbers", len(content))
            return np.frombuffer(content, dtype).reshape(shape, order="F" if fortran else "C")

        arrays = []
        for name in archive.namelist():
            with archive.open(name) as stream:
                shape, _, dtype = _read_npy_header(stream)
            rows = shape[0] if shape else -1 if dtype else 0
            heading = name.removesuffix(".npy")
            arrays.append(_Array(heading, shape[1:], rows, functools.partial(read, name)))
        return _read_arrays(arrays, request)


def _read_npy_header(stream: IO[bytes]) -> tuple[tuple[int, ...], bool, np.dtype[Any] | None]:
    """Return shape, Fortran order and dtype of an array; the dtype is None if the header is not understood."""
    try:
        version = np.lib.format.read_magic(stream)
        length = stream.read(2 if version == (1, 0) else 4)
        size = int.from_bytes(length, "little")
        header = io.BytesIO(length + stream.read(size if size <= _MAX_HEADING else 0))
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read(header, max_header_size=_MAX_HEADING)
    except Exception:  # whatever the header of a stranger does to the parser
        return (), False, None
    return shape, fortran, dtype


def _read_parquet(path: Path, request: ColumnRequest) -> Columns:
    """Read columns of a Parquet file."""
    pa, pq = require("pyarrow", str(path)), require("pyarrow.parquet", str(path))
    try:
        with pq.ParquetFile(path) as file:

            def read(heading: str, exact: bool) -> NDArray[Any]:
                """Return a column of numbers; dates and times if it is `exact`."""
                kind = file.schema_arrow.field(heading).type
                number = pa.types.is_floating(kind) or pa.types.is_integer(kind)
                if not (number or (exact and pa.types.is_temporal(kind))):
                    raise ArgumentError(request.read_heading(heading)[0], "a column of numbers", str(kind))
                column = file.read([heading])[heading]
                return np.array((column if exact else column.cast(pa.float64(), safe=False)).to_numpy())

            arrays = [
                _Array(heading, (), file.metadata.num_rows, functools.partial(read, heading))
                for heading in file.schema_arrow.names
            ]
            return _read_arrays(arrays, request)
    except pa.ArrowException as error:
        raise OSError(str(error)) from None


# The readers, by the ending of the file.
_READERS: Final[dict[str, Callable[[Path, ColumnRequest], Columns]]] = {
    ".csv": _read_csv,
    ".npz": _read_npz,
    ".parquet": _read_parquet,
}
