"""Columns of numbers by name, out of what is in memory: a pandas DataFrame, an xarray Dataset, a dict of arrays."""

from __future__ import annotations

import contextlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError

# Units as the conventions of climate data and pint write them.
_UNIT_ALIASES: Final = {
    "second": "s",
    "seconds": "s",
    "meter": "m",
    "meters": "m",
    "metre": "m",
    "metres": "m",
    "millimeter": "mm",
    "radian": "rad",
    "radians": "rad",
    "degree": "deg",
    "degrees": "deg",
    "dimensionless": "1",
    "": "1",
}


@dataclass(frozen=True, eq=False)
class ColumnTable:
    """Columns in memory, which are read as those of a file."""

    kind: str  # such as DataFrame, for messages
    arrays: Mapping[str, NDArray[Any]]  # of shape (N,), or (N, ...) of vectors and matrices
    units: Mapping[str, str]  # that columns state, by name
    index: str = ""  # name of the array that has the instants if none has their usual name
    suffix: str = ""  # that of a file's name

    def __str__(self) -> str:
        return self.kind

    def without_units(self, names: Collection[str]) -> ColumnTable:
        """Return the table whose columns of these names do not state their units."""
        return replace(self, units={name: unit for name, unit in self.units.items() if name not in names})


def column_table(name: str, source: Any) -> ColumnTable:
    """Return the columns of a DataFrame (of pandas or polars), a Dataset or a dict of arrays.

    Raises:
        ArgumentError: `source` is none of these; the error is called `name`.
    """
    if hasattr(source, "data_vars"):
        return _of_dataset(source)
    kind = type(source).__name__
    if isinstance(source, Mapping):
        return ColumnTable(kind, {str(key): _array(values) for key, values in source.items()}, {})
    if not (hasattr(source, "columns") and hasattr(source, "__getitem__")):
        expected = "the path of a file, a pandas DataFrame, an xarray Dataset or a dict of arrays"
        raise ArgumentError(name, expected, kind)
    arrays = {str(key): _array(source[key]) for key in source.columns}
    index = getattr(source, "index", None)  # of pandas
    if index is None or (index.name is None and index.dtype.kind not in "mM"):  # row numbers
        return ColumnTable(kind, arrays, {})
    label = "index" if index.name is None else str(index.name)
    return ColumnTable(kind, {label: _array(index.to_series()), **arrays}, {}, label)


def _of_dataset(source: Any) -> ColumnTable:
    """Return the coordinates and variables of an xarray Dataset that have the first dimension of its first variable,
    with the units that they state.
    """
    first = next((variable.dims[0] for variable in source.data_vars.values() if variable.dims), "")
    arrays, units = {}, {}
    for key, variable in {**source.coords, **source.data_vars}.items():
        if variable.dims[:1] == (first,):
            name = str(key)
            arrays[name] = _array(variable)
            if unit := variable.attrs.get("units"):
                units[name] = _UNIT_ALIASES.get(str(unit), str(unit))
    return ColumnTable("Dataset", arrays, units, str(first) if str(first) in arrays else "")


def _array(values: Any) -> NDArray[Any]:
    """Return a column as an array, of numbers, dates (UTC) or durations if it holds these."""
    if hasattr(values, "to_index") and values.ndim == 1 and values.dtype == object:  # dates with a zone in xarray
        values = values.to_index().to_series()
    if getattr(getattr(values, "dtype", None), "tz", None) is not None:
        values = values.dt.tz_convert(None)  # to UTC
    array = np.asarray(values)
    if array.dtype == object and hasattr(values, "to_numpy"):  # numbers of pandas that may be missing
        with contextlib.suppress(TypeError, ValueError):
            array = values.to_numpy(np.float64, na_value=np.nan)
    return array
