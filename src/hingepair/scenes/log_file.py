"""Samples of a motion in a file: columns by name, from .csv, .npz or .parquet.

models/SCENES.md tells the columns. Others are refused: a misspelt one would be missed.
"""

from __future__ import annotations

import csv
import math
import re
import warnings
import zipfile
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import IO, Any, Final, NoReturn, TextIO, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import MissingDependencyError, SceneError, choices, nearest
from hingepair.evaluation.plan import PLANAR, SPATIAL
from hingepair.numeric.arrays import real_array
from hingepair.scenes.known_motion import SPATIAL_NAMES
from hingepair.scenes.tables import Place

MAX_ROWS: Final = 10_000_000
MAX_BYTES: Final = 2_000_000_000
_MAX_HEADER: Final = 10_000
_LATE: Final = 1e5  # s: from here on instants are rounded to more than 1e-11 s
_REAL_ARRAY: Final = "an array of real numbers (float64, float32 or integers)"
_ARRAY_HEADER: Final = re.compile(
    r"\{'descr': '([<>|=]?[A-Za-z]\d{0,9})', 'fortran_order': (True|False), "
    r"'shape': \(((?:\d{1,18},? ?){0,9})\),? ?\}\s*"
)

Columns: TypeAlias = dict[str, NDArray[np.float64]]


def _xyz(name: str) -> tuple[str, ...]:
    return tuple(f"{name}_{axis}" for axis in "xyz")


ARRAYS: Final[dict[str, tuple[str, ...]]] = {
    "R1": ("x", "y", "z"),
    "quat_xyzw": ("qx", "qy", "qz", "qw"),
    "quat_wxyz": ("qw", "qx", "qy", "qz"),
    **{name: _xyz(name) for name in ("phi", "phid", "phidd", "v1", "a1", "omega1", "alpha1")},
    **dict(zip(("q", "qd", "qdd"), SPATIAL_NAMES, strict=True)),
}
"""Array -> its columns."""

_RESULTS: Final = frozenset({*SPATIAL.levels, *PLANAR.levels})
COLUMNS: Final = tuple(dict.fromkeys(("t", *(c for own in ARRAYS.values() for c in own), "psi")))


def columns_of(name: str) -> tuple[str, ...]:
    """The columns of an array; what is no array is a column itself."""
    return ARRAYS.get(name, (name,))


class LogFile(Place):
    """A file of samples, and its name in messages.

    Attributes:
        path: where it is.
        columns: by name, all of one length, which is not 0.
        late: the instants since the first, with digits that the column t has lost; None where it has them all.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(str(path) if str(path).isprintable() else repr(str(path)), "")
        self.path = path
        self.late: NDArray[np.float64] | None = None
        self.columns = self._read()

    def _read(self) -> Columns:
        read = _READERS.get(self.path.suffix.lower())
        if read is None:
            self.refuse("", f"a file name that ends in {', '.join(_READERS)}", self.path.suffix or "no ending")
        try:
            size = self.path.stat().st_size
            if size > MAX_BYTES:
                self.refuse("", f"at most {MAX_BYTES} bytes", size)
            found = read(self)
        except (OSError, EOFError, NotImplementedError, RuntimeError, zlib.error, zipfile.BadZipFile) as error:
            self.refuse(
                "", f"a {self.path.suffix} file that can be read", getattr(error, "strerror", None) or str(error)
            )
        counts = {column.size for column in found.values()}
        if len(counts) > 1:
            lengths = ", ".join(f"{name}: {column.size}" for name, column in found.items())
            self.refuse("", "columns of one length", lengths)
        if counts in (set(), {0}):
            self.refuse("", "at least one sample", "none")
        return found

    def together(self, name: str, required: bool) -> NDArray[np.float64] | None:
        """The columns of an array side by side; None where none of them is there and none need be."""
        own = columns_of(name)
        there = [column for column in own if column in self.columns]
        if not there and not required:
            return None
        for column in own:
            if column not in self.columns:
                self.refuse(column, f"a column beside {there[0]}" if there else "a column", "no such column")
        return np.stack([self.columns[column] for column in own], axis=-1)

    def check_names(self, names: Iterable[str], known: tuple[str, ...]) -> None:
        """Refuse a name that is not known or that comes twice."""
        seen = set()
        for name in names:
            if name.partition("_")[0] in _RESULTS and name not in known:
                way = "run --outputs q,qd,qdd --out FILE writes what is read here"
                self.refuse(repr(name[:40]), choices(known), f"a column of results, which are no motion ({way})")
            if name not in known:
                self.refuse(repr(name[:40]), choices(known), f"an unknown column{nearest(name, known)}")
            if name in seen:
                self.refuse(name, "a column once", "a second one")
            seen.add(name)

    def check_rows(self, count: int) -> None:
        """Refuse too many samples."""
        if count > MAX_ROWS:
            self.refuse("", f"at most {MAX_ROWS} samples", count)


def _read_csv(file: LogFile) -> Columns:
    try:
        with file.path.open(encoding="utf-8-sig", newline="") as stream:
            names = _header(file, stream)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # no rows: an error of ours
                options: dict[str, Any] = {"delimiter": ",", "comments": None, "ndmin": 2, "quotechar": '"'}
                options["max_rows"] = MAX_ROWS + 1
                try:
                    rows = np.loadtxt(stream, **options)
                except ValueError:  # once more, slowly: an empty cell is a number that is not there
                    stream.seek(0)
                    stream.readline()
                    rows = np.loadtxt(stream, converters=_number, **options)
    except SceneError:
        raise
    except ValueError as error:
        _fail_at_row(file, str(error))
    if rows.size and rows.shape[1] != len(names):
        _fail_at_row(file, f"{rows.shape[1]} fields")
    file.check_rows(len(rows))
    if "t" in names and rows.size and abs(rows[0, names.index("t")]) > _LATE:
        file.late = _since_first(file, names.index("t"))
    return {name: np.ascontiguousarray(rows[:, i]) if rows.size else np.empty(0) for i, name in enumerate(names)}


def _number(text: str) -> float:
    return float(text) if text.strip() else math.nan


def _since_first(file: LogFile, column: int) -> NDArray[np.float64]:
    """The instants of a file since the first, of which more digits stand in the text than a float holds."""
    with file.path.open(encoding="utf-8-sig", newline="") as stream:
        stream.readline()
        t = np.loadtxt(stream, np.longdouble, delimiter=",", comments=None, ndmin=1, quotechar='"', usecols=column)
    return np.asarray(t - t[0], dtype=np.float64)


def _header(file: LogFile, stream: TextIO) -> list[str]:
    line = stream.readline(_MAX_HEADER)
    if len(line) == _MAX_HEADER:
        file.refuse("", "a first line of column names", "a longer line")
    if ";" in line or "\t" in line:
        file.refuse("", "columns separated by commas, and decimal points", line)
    names = [name.strip() for name in next(csv.reader([line]), [])]
    if not names:
        file.refuse("", "a first line of column names", "an empty line")
    file.check_names(names, COLUMNS)
    return names


def _fail_at_row(file: LogFile, reason: str) -> NoReturn:
    """Find the row that could not be read, and say where it is."""
    with file.path.open(encoding="utf-8-sig", errors="replace", newline="") as stream:
        names = _header(file, stream)
        reader = csv.reader(stream)
        try:
            for row in reader:
                line = reader.line_num + 1
                if row and len(row) != len(names):
                    expected = f"{len(names)} fields, separated by commas, with decimal points"
                    file.refuse(f"line {line}", expected, f"{len(row)} fields")
                for name, text in zip(names, row, strict=False):
                    try:
                        _number(text)
                    except ValueError:
                        expected = "a number (nan or an empty cell where there is none)"
                        file.refuse(f"line {line}: {name}", expected, repr(text[:40]))
        except csv.Error as error:
            reason = str(error)
    file.refuse("", "rows of numbers", reason)


def _read_npz(file: LogFile) -> Columns:
    with zipfile.ZipFile(file.path) as archive:
        members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
        names = [info.filename.removesuffix(".npy") for info in archive.infolist()]
        file.check_names(names, tuple(dict.fromkeys((*ARRAYS, *COLUMNS))))
        found: Columns = {}
        for name, member in members.items():
            try:
                array = _read_array(file, archive, member, name)
            except (ValueError, TypeError) as error:
                if isinstance(error, SceneError):
                    raise
                file.refuse(name, _REAL_ARRAY, str(error))
            own = dict(zip(ARRAYS[name], array.T, strict=True)) if name in ARRAYS else {name: array}
            for column, values in own.items():
                if column in found:
                    file.refuse(name, f"{column} once", "a second one")
                found[column] = np.ascontiguousarray(values, dtype=np.float64)
    return found


def _read_array(file: LogFile, archive: zipfile.ZipFile, member: zipfile.ZipInfo, name: str) -> NDArray[Any]:
    """One array; its header is looked at before anything of its size is allocated, and nothing in it is run."""
    with archive.open(member) as stream:
        descr, fortran, shape = _array_header(file, stream, name)
        with file.naming(name):
            real_array(name, np.empty(0, descr))
        tail = (len(ARRAYS[name]),) if name in ARRAYS else ()
        if shape[1:] != tail or len(shape) != 1 + len(tail):
            file.refuse(name, f"shape (N, {tail[0]})" if tail else "shape (N,)", f"shape {shape}")
        file.check_rows(shape[0])
        size = math.prod(shape) * np.dtype(descr).itemsize
        content = stream.read(size)
    if len(content) < size:
        file.refuse(name, f"{size} bytes of numbers", len(content))
    return np.frombuffer(content, descr).reshape(shape, order="F" if fortran else "C")


def _array_header(file: LogFile, stream: IO[bytes], name: str) -> tuple[str, bool, tuple[int, ...]]:
    """The type of number, whether columns come first, and the shape that the header of an array states."""
    magic = stream.read(8)
    size = int.from_bytes(stream.read(2 if magic[6:7] == b"\x01" else 4), "little")
    text = stream.read(size).decode("latin1") if magic[:6] == b"\x93NUMPY" and size <= _MAX_HEADER else ""
    found = _ARRAY_HEADER.fullmatch(text)
    if not found:
        file.refuse(name, _REAL_ARRAY, "another header")
    descr, fortran, shape = found.groups()
    return descr, fortran == "True", tuple(int(n) for n in shape.split(",") if n.strip())


def _read_parquet(file: LogFile) -> Columns:
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingDependencyError(
            file.name, "PyArrow (pip install '.[parquet]' in the project's folder)", str(error)
        ) from None
    try:
        with pq.ParquetFile(file.path) as table:
            file.check_rows(table.metadata.num_rows)
            schema = table.schema_arrow
            file.check_names(schema.names, COLUMNS)
            for field in schema:
                if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
                    file.refuse(field.name, "a column of numbers", str(field.type))
            columns = {name: table.read([name])[name].cast(pa.float64(), safe=False) for name in schema.names}
            return {name: np.array(column.to_numpy()) for name, column in columns.items()}  # nulls are NaN
    except SceneError:
        raise
    except (pa.ArrowException, ValueError, KeyError) as error:
        file.refuse("", "a .parquet file that can be read", str(error))


_READERS: Final[dict[str, Callable[[LogFile], Columns]]] = {
    ".csv": _read_csv,
    ".npz": _read_npz,
    ".parquet": _read_parquet,
}
