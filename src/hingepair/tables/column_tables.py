"""Tables of columns by name: of files, whose readers are in `column_file`, pandas DataFrames, xarray Datasets and
dicts of arrays.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any, Final, NamedTuple, NoReturn

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import Float64Array

# Units as the conventions of climate data and pint write them.
_UNIT_ALIASES: Final = {
    **dict.fromkeys(("second", "seconds"), "s"),
    **dict.fromkeys(("meter", "meters", "metre", "metres"), "m"),
    "millimeter": "mm",
    **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("degree", "degrees"), "deg"),
    **dict.fromkeys(("dimensionless", ""), "1"),
}
_NUMBER: Final = "a number (nan or an empty cell where there is none)"
_INSTANT: Final = (
    "a number, or a date such as 2026-11-23T10:00:00.25+01:00 (ISO 8601) or 23.11.2026 10:00:00,25 "
    "(DD.MM.YYYY HH:MM:SS), as in the first row"
)


class ColumnTable(NamedTuple):
    """Columns, each an array of shape (N,), or (N, ...) of vectors and matrices."""

    kind: str  # such as DataFrame, or the path of a file, for messages
    arrays: Mapping[str, NDArray[Any]]  # by name
    units: Mapping[str, str] = {}  # that columns state, by name
    row_index: str = ""  # name of the column that has the instants if none has their usual name
    lines: NDArray[Any] | None = None  # of the file in which the samples stand
    mark: str = "."  # sign that numbers in text may have for the decimal point
    doubled: Collection[str] = ()  # names that more than one column has

    def __str__(self) -> str:
        return self.kind

    def numbers(self, name: str, expected: str = _NUMBER) -> Float64Array:
        """Return a column as float64; refuse text and dates."""
        array = self.arrays[name]
        if array.dtype.kind in "fiu":
            return array.astype(np.float64)
        if self.lines is None:
            self._refuse(name, 0, "numbers; pandas.read_csv(..., sep=';', decimal=',') reads decimal commas")
        numbers = np.empty(len(array))
        for row, cell in enumerate(array):
            try:
                numbers[row] = number_in(cell, self.mark)
            except ValueError:
                self._refuse(name, row, expected)
        return numbers

    def instants(self, name: str) -> NDArray[Any]:
        """Return a column of instants: numbers, of which integers stay as they are, or dates (UTC where they name no
        zone).
        """
        array = self.arrays[name]
        if array.dtype.kind in "fiumM":
            return array.astype(np.float64) if array.dtype.kind == "f" else array
        if self.lines is None:
            self._refuse(name, 0, "numbers, or dates, which pandas.to_datetime makes of text")
        import pandas

        dates = pandas.to_datetime([_iso_date(str(c)) for c in array], utc=True, format="ISO8601", errors="coerce")
        missing = np.flatnonzero(dates.isna()).tolist()
        if missing[:1] == [0]:
            return self.numbers(name, _INSTANT)
        if missing:
            self._refuse(name, missing[0], _INSTANT)
        return np.asarray(dates.tz_localize(None).to_numpy("datetime64[ns]"))

    def _refuse(self, name: str, row: int, expected: str) -> NoReturn:
        cell = repr(str(self.arrays[name].ravel()[row])[:40]) if self.arrays[name].size else "none"
        raise ArgumentError(name if self.lines is None else f"line {self.lines[row]}: {name}", expected, cell)


def number_in(cell: Any, mark: str = ".") -> float:
    """Return the number in a cell of a file, NaN of a blank one; raise ValueError if it has none."""
    if isinstance(cell, float):  # how pandas says blank
        return cell
    if not isinstance(cell, str) or "_" in cell:  # Python reads 1_5 as 15
        raise ValueError
    return float(cell.replace(mark, ".")) if cell.strip() else np.nan


def _iso_date(cell: str) -> str:
    """Return a cell whose date, if it is DD.MM.YYYY, is written as in ISO 8601, with a decimal point."""
    return re.sub(r"^(\d\d)\.(\d\d)\.(\d{4})\b", r"\3-\2-\1", cell.strip().replace(",", "."))


def column_table(name: str, source: Any) -> ColumnTable:
    """Return the columns of a DataFrame (of pandas or polars), a Dataset or a dict of arrays.

    Raises:
        ArgumentError: `source` is none of these; the error is called `name`.
    """
    kind, index = type(source).__name__, ""
    units: dict[str, str] = {}
    if hasattr(source, "data_vars"):
        arrays, units, index = _of_dataset(source)
    elif isinstance(source, Mapping):
        arrays = {str(key): _array(values) for key, values in source.items()}
    elif hasattr(source, "columns") and hasattr(source, "__getitem__"):
        arrays = {str(key): _array(source[key]) for key in source.columns}
        rows = getattr(source, "index", None)  # of pandas
        if rows is not None and (rows.name is not None or rows.dtype.kind in "mM"):  # no row numbers
            index = "index" if rows.name is None else str(rows.name)
            arrays = {index: _array(rows.to_series()), **arrays}
    else:
        expected = "the path of a file, a pandas DataFrame, an xarray Dataset or a dict of arrays"
        raise ArgumentError(name, expected, kind)
    return ColumnTable(kind, arrays, units, index)


def _of_dataset(source: Any) -> tuple[dict[str, NDArray[Any]], dict[str, str], str]:
    """Return the coordinates and variables of an xarray Dataset that have the first dimension of its first variable,
    the units that they state, and the name of that dimension if it is a coordinate.
    """
    first = next((variable.dims[0] for variable in source.data_vars.values() if variable.dims), "")
    found = {**source.coords, **source.data_vars}
    found = {str(key): variable for key, variable in found.items() if variable.dims[:1] == (first,)}
    stated = {name: str(variable.attrs["units"]) for name, variable in found.items() if variable.attrs.get("units")}
    units = {name: _UNIT_ALIASES.get(unit, unit) for name, unit in stated.items()}
    return {name: _array(variable) for name, variable in found.items()}, units, str(first) if first in found else ""


def _array(values: Any) -> NDArray[Any]:
    """Return a column as an array, of numbers, dates (UTC) or durations if it holds these."""
    if hasattr(values, "to_index") and values.ndim == 1 and values.dtype == object:  # dates with a zone in xarray
        values = values.to_index().to_series()
    if getattr(getattr(values, "dtype", None), "tz", None) is not None:
        values = values.dt.tz_convert(None)  # to UTC
    array = np.asarray(values)
    if array.dtype == object and getattr(values.dtype, "kind", "O") in "fiu":  # numbers of pandas that may be missing
        array = values.to_numpy(np.float64, na_value=np.nan)
    return array
