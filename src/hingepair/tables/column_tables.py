"""Tables of columns by name, of which chosen ones are read: pandas DataFrames, xarray Datasets, dicts of arrays, and
files, whose readers are in `column_file`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError

# Units as the conventions of climate data and pint write them.
_UNIT_ALIASES: Final = {
    **dict.fromkeys(("second", "seconds"), "s"),
    **dict.fromkeys(("meter", "meters", "metre", "metres"), "m"),
    "millimeter": "mm",
    **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("degree", "degrees"), "deg"),
    **dict.fromkeys(("dimensionless", ""), "1"),
}


@dataclass(frozen=True, eq=False)
class ColumnTable:
    """Columns that can be read, each an array of shape (N,), or (N, ...) of vectors and matrices."""

    kind: str  # such as DataFrame, for messages
    shapes: Mapping[str, tuple[int, ...]]  # of one sample of each column
    # From the columns to read, and the one whose integers and dates stay as they are, to their arrays.
    read: Callable[[Collection[str], str], Mapping[str, NDArray[Any]]]
    units: Mapping[str, str] = field(default_factory=dict)  # that columns state, by name
    index: str = ""  # name of the column that has the instants if none has their usual name
    suffix: str = ""  # that of a file's name
    doubled: Collection[str] = ()  # names that more than one column has

    def __str__(self) -> str:
        return self.kind


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

    def read(wanted: Collection[str], exact: str) -> dict[str, NDArray[Any]]:
        return {name: _checked(name, arrays[name], name == exact) for name in wanted}

    return ColumnTable(kind, {name: a.shape[1:] for name, a in arrays.items()}, read, units, index)


def _checked(name: str, array: NDArray[Any], exact: bool) -> NDArray[Any]:
    """Return an array of numbers, or of dates if it is `exact`; refuse text."""
    if array.dtype.kind in ("fiumM" if exact else "fiu"):
        return array
    expected = "numbers; pandas.read_csv(..., sep=';', decimal=',') reads decimal commas"
    if exact:
        expected = "numbers, or dates, which pandas.to_datetime makes of text"
    raise ArgumentError(name, expected, repr(str(array.ravel()[0])[:40]) if array.size else "none")


def _of_dataset(source: Any) -> tuple[dict[str, NDArray[Any]], dict[str, str], str]:
    """Return the coordinates and variables of an xarray Dataset that have the first dimension of its first variable,
    the units that they state, and the name of that dimension if it is a coordinate.
    """
    first = next((variable.dims[0] for variable in source.data_vars.values() if variable.dims), "")
    arrays, units = {}, {}
    for key, variable in {**source.coords, **source.data_vars}.items():
        if variable.dims[:1] == (first,):
            name = str(key)
            arrays[name] = _array(variable)
            if unit := variable.attrs.get("units"):
                units[name] = _UNIT_ALIASES.get(str(unit), str(unit))
    return arrays, units, str(first) if str(first) in arrays else ""


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
