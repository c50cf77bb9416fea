"""Results as tables of other libraries, and as files: .csv, .npz, .parquet, .nc."""

from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.results import missing_attribute_error
from hingepair.equations.quantities import unit_of
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.names import Names
from hingepair.numeric.optional import require
from hingepair.tables.column_file import write_npz
from hingepair.tables.data_frames import data_frame, dataset
from hingepair.tables.sheets import Sheet, Shown
from hingepair.tables.units import IN_SI, SI, Columns, Units, UnitsLike
from hingepair.tables.whole_file import whole_file

RESULT_ROWS_PER_BLOCK: Final = 131072
"""Rows that are computed and written at a time, and largest row group of a .parquet file."""
MAX_HELD_INSTANTS: Final = 10_000_000
"""Largest number of instants that are held in memory; more are computed block by block, or refused."""

RowWriter: TypeAlias = Callable[[NDArray[Any], Mapping[str, NDArray[Any]]], None]
"""Function that takes instants and the arrays at these instants by name."""


class Result(Shown):
    """Base class of results that are arrays over instants. Subclasses define `t`, `recorded()` and `described`."""

    __slots__ = ()

    t: NDArray[np.float64]

    @property
    def described(self) -> str:
        """Description of the result, a text of one sentence."""
        raise NotImplementedError

    @property
    def inputs(self) -> tuple[Path, ...]:
        """Paths of the files from which this object was computed, which `save` does not overwrite."""
        return ()

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that the result holds, by name; shape (N, ...) for N instants."""
        raise NotImplementedError

    def unit(self, name: str) -> str:
        """Return the unit of an output, such as "R2", or of one of its components, such as "R2_x"; "1" if it has
        none.
        """
        return unit_of(name)

    def in_units(self, units: UnitsLike) -> Columns:
        """Return names and numbers of columns in units; None for SI units."""
        return Columns(Units.of(units), self.unit)

    def __dir__(self) -> list[str]:
        attributes = (name for name in object.__dir__(self) if not name.startswith("_"))
        return sorted({*attributes, *self._available_names()})

    def _available_names(self) -> Iterable[str]:
        """Return the names of attributes beside those of the class, for `dir`."""
        raise NotImplementedError

    def _sheet(self) -> Sheet:
        """Return the printed table: name, shape at one instant, and unit of each array."""
        rows = [(name, str(array.shape[1:] or ""), self.unit(name)) for name, array in self.recorded().items()]
        title = f"{self.described}: {len(self.t)} instants"
        return Sheet(title, (("", "shape of one", "unit"), ("t", "", "s"), *rows))

    def to_dataframe(self, units: str | None = None) -> Any:
        """Return a pandas DataFrame with a row for each instant: a column t, columns such as R2_x of vectors and
        S2_xy of matrices, and psi of numbers. `attrs["units"]` holds the units by name.

        Args:
            units: units in place of SI units, such as "deg, mm"; the headings then say the units: "R2_x [mm]". By
                default those of the scene, otherwise SI units.

        Raises:
            ArgumentError: a unit is unknown.
            MissingDependencyError: pandas is not installed.
        """
        return data_frame({"t": self.t, **self.recorded()}, self.in_units(units), self.described)

    def to_xarray(self, units: str | None = None) -> Any:
        """Return an xarray Dataset with a variable for each array, with the dimension `time`, and unit and
        description as the attributes `units` and `long_name`.

        A vector has the dimension `xyz`, or `xy` in the plane; a matrix `xyz` for its rows (world axes) and
        `body_xyz` for its columns (body axes).

        Args:
            units: units in place of SI units, such as "deg, mm"; the names stay as they are. By default those of the
                scene, otherwise SI units.

        Raises:
            ArgumentError: a unit is unknown.
            MissingDependencyError: xarray is not installed.
        """
        return dataset(self.recorded(), ("time",), self.in_units(units), self.described, self.t)

    def save(
        self,
        path: str | os.PathLike[str],
        inputs: Iterable[str | os.PathLike[str]] = (),
        units: str | None = None,
    ) -> Path:
        """Write the arrays to a file, completely or not at all, with the full precision of every number.

        Args:
            path: file name, whose ending selects the format: .csv, with columns as in `to_dataframe` and the fewest
                digits that determine each number; .npz; .parquet; or .nc (NetCDF).
            inputs: further files that must not be overwritten, beside those from which this object was computed.
            units: units in place of SI units, such as "deg, mm"; the names of columns and of the arrays of a .npz
                then say the units: "R2_x [mm]", "R2 [mm]". In a .nc file, the attribute `units` does. Logs with such
                names can be read. By default the units of the scene, otherwise SI units.

        Returns:
            The path of the written file.

        Raises:
            ArgumentError: the ending or a unit is unknown, the file must not or cannot be written, or the object
                holds Dask arrays. A file that existed before stays as it was.
            MissingDependencyError: the package that writes this format is not installed.
        """
        columns = self.in_units(units)
        with result_file(path, self.described, (*self.inputs, *inputs), columns) as add:
            add(self.t, self.recorded())
        return Path(path)


class Record(Result):
    """Result of any arrays over instants, read as `record.hinge_torque` or `record["hinge_torque"]`.

    Args:
        t: instants [s]; shape (N,).
        arrays: the arrays by name; shape (N,), (N, 2), (N, 3) or (N, 3, 3).
        described: description in one sentence.
        inputs: files that the arrays were computed from.
        unit: function that returns the unit of an array or component by name.
        units: units of tables and files unless others are asked for.

    >>> Record(np.zeros(2), {"force1": np.ones((2, 3))}, "a push").force1.shape
    (2, 3)
    """

    __slots__ = ("_arrays", "_columns", "described", "inputs", "t")

    described: str
    inputs: tuple[Path, ...]

    def __init__(
        self,
        t: NDArray[Any],
        arrays: Mapping[str, NDArray[Any]],
        described: str = "",
        inputs: tuple[Path, ...] = (),
        unit: Callable[[str], str] = unit_of,
        units: Units = SI,
    ) -> None:
        self.t = t
        self._columns = Columns(units, unit)
        self.described = described
        self.inputs = inputs
        self._arrays = dict(arrays)

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return the arrays that the record holds, by name."""
        return self._arrays

    def unit(self, name: str) -> str:
        """Return the SI unit of an array of the record, or of one of its components, as a string."""
        return self._columns.si_unit(name)

    def in_units(self, units: UnitsLike) -> Columns:
        """Return names and numbers of columns in units; None for those of the record."""
        return self._columns if units is None else self._columns._replace(units=Units.of(units))

    def __getitem__(self, name: str) -> NDArray[Any]:
        return self._arrays[name]

    def __getattr__(self, name: str) -> NDArray[Any]:
        if name.startswith("_") or name not in self._arrays:
            raise missing_attribute_error(self, name)
        return self._arrays[name]

    def _available_names(self) -> Iterable[str]:
        """Return the names of the arrays, which are attributes, for `dir`."""
        return self._arrays

    def __repr__(self) -> str:
        return f"Record({self.described!r}, samples={len(self.t)}, {', '.join(self._arrays)})"


class OverInstants:
    """Base class of what has arrays over instants and can be made a table; subclasses define `record()`."""

    __slots__ = ()

    def record(self) -> Record:
        """Return the arrays over instants as a result, whose `save` writes them."""
        raise NotImplementedError

    def to_dataframe(self, units: str | None = None) -> Any:
        """Return a pandas DataFrame with a row for each instant; `units` as of results."""
        return self.record().to_dataframe(units)

    def to_xarray(self, units: str | None = None) -> Any:
        """Return an xarray Dataset with the instants as its coordinate; `units` as of results."""
        return self.record().to_xarray(units)


@contextlib.contextmanager
def result_file(
    path: str | os.PathLike[str],
    described: str = "",
    inputs: Iterable[str | os.PathLike[str]] = (),
    columns: Columns = IN_SI,
) -> Iterator[RowWriter]:
    """Open a file for results, block by block: yield a function `add(t, arrays)`. The file replaces another only if
    the block ends without an error; .npz and .nc hold all in memory until then.

    Args:
        path: file name that ends in one of `RESULT_FILE_SUFFIXES`.
        described: description of the result, for formats that store it.
        inputs: files that are being read and must not be overwritten.
        columns: units of the columns.

    Raises:
        ArgumentError: the ending is unknown, or the file cannot be written.
        MissingDependencyError: the package for this kind of file is not installed.
    """
    target = Path(path)
    check_ending(target)
    kind = target.suffix.lower()
    with whole_file(target, inputs) as file, _WRITERS[kind](file, described, columns) as add:
        yield add


def check_ending(path: Path) -> None:
    """Refuse a file name whose ending is none of RESULT_FILE_SUFFIXES."""
    if path.suffix.lower() not in _WRITERS:
        raise ArgumentError("path", f"a file name that ends in {', '.join(RESULT_FILE_SUFFIXES)}", quoted(str(path)))


@contextlib.contextmanager
def _csv_writer(file: IO[bytes], described: str, columns: Columns) -> Iterator[RowWriter]:
    """Yield a function that appends rows as CSV, after a line of column names."""
    heads = iter([True])

    def add(t: NDArray[Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        frame = data_frame({"t": t, **arrays}, columns, described)
        frame.to_csv(file, index=False, header=next(heads, False), na_rep="nan", lineterminator="\n")

    yield add


@contextlib.contextmanager
def _parquet_writer(file: IO[bytes], described: str, columns: Columns) -> Iterator[RowWriter]:
    """Yield a function that appends row groups in the Parquet format, with description and units as metadata."""
    arrow, parquet = require("pyarrow", "save"), require("pyarrow.parquet", "save")
    writers: list[Any] = []

    def add(t: NDArray[Any], arrays: Mapping[str, NDArray[Any]]) -> None:
        frame = data_frame({"t": t, **arrays}, columns, described)
        table = arrow.Table.from_pandas(frame, preserve_index=False)
        table = table.replace_schema_metadata({**frame.attrs["units"], "description": described})
        if not writers:
            writers.append(opened.enter_context(parquet.ParquetWriter(file, table.schema, use_dictionary=False)))
        writers[0].write_table(table, RESULT_ROWS_PER_BLOCK)

    with contextlib.ExitStack() as opened:
        yield add


@contextlib.contextmanager
def _whole_writer(
    file: IO[bytes], described: str, columns: Columns, write: Callable[..., None]
) -> Iterator[RowWriter]:
    """Yield a function that collects rows, all of which `write` gets at the end."""
    blocks: list[dict[str, NDArray[Any]]] = []
    yield lambda t, arrays: blocks.append({"t": t, **arrays})
    names = blocks[0] if blocks else {}
    write(file, {one: np.concatenate([block[one] for block in blocks]) for one in names}, described, columns)


def _write_npz(file: IO[bytes], arrays: dict[str, Any], _: str, columns: Columns) -> None:
    write_npz(file, {columns.heading(name): columns.converted(name, array) for name, array in arrays.items()})


def _write_netcdf(file: IO[bytes], arrays: dict[str, Any], described: str, columns: Columns) -> None:
    table = dataset(arrays, ("time",), columns, described, arrays.pop("t"))
    written = Names(name for name in table.variables if name.isascii())
    for name in [name for name in table.data_vars if not name.isascii()]:  # SciPy writes no other letters
        table[name].attrs.setdefault("long_name", name)
        table = table.rename_vars({name: written.take(name.encode("ascii", "replace").decode().replace("?", "_"))})
    file.write(table.to_netcdf(engine="scipy"))


_WRITERS: Final[dict[str, Callable[..., contextlib.AbstractContextManager[RowWriter]]]] = {
    ".csv": _csv_writer,
    ".parquet": _parquet_writer,
    ".npz": functools.partial(_whole_writer, write=_write_npz),
    ".nc": functools.partial(_whole_writer, write=_write_netcdf),
}
"""Context managers that take blocks of rows, by the ending of the file."""
RESULT_FILE_SUFFIXES: Final = tuple(_WRITERS)
"""Endings of files that results are written to."""
