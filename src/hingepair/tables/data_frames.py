"""Arrays by name as tables of pandas and xarray, and the names of their columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.equations.quantities import QUANTITIES
from hingepair.numeric.names import Names
from hingepair.numeric.optional import require
from hingepair.tables.units import Columns


def column_names(arrays: Mapping[str, NDArray[Any]], heading: Callable[[str], str] = str) -> list[str]:
    """Return the headings of columns of the components of arrays: R2_x, S2_xy and so on; of numbers the name itself.

    >>> column_names({"d": np.zeros((1, 3)), "jacobian": np.zeros((1, 2, 6))})[:6]
    ['d_x', 'd_y', 'd_z', 'jacobian_0_0', 'jacobian_0_1', 'jacobian_0_2']
    """
    return [heading(f"{name}{ending}") for name, array in arrays.items() for ending in _endings(array.shape[1:])]


def _endings(sample_shape: tuple[int, ...]) -> list[str]:
    """Return the ends of the names of components: "_x" for vectors, "_xy" for matrices, "" for numbers."""
    if any(size > 3 for size in sample_shape):
        return ["".join(f"_{i}" for i in index) for index in np.ndindex(sample_shape)]
    letters = ["".join("xyz"[i] for i in index) for index in np.ndindex(sample_shape)]
    return [f"_{c}" if c else "" for c in letters]


def split_columns(arrays: Mapping[str, NDArray[Any]]) -> list[NDArray[Any]]:
    """Return all components of arrays of shape (N, ...), one array of shape (N,) for each column."""
    matrices = (array.reshape(len(array), math.prod(array.shape[1:])) for array in arrays.values())
    return [column for matrix in matrices for column in matrix.T]


def sample_rows(arrays: Mapping[str, Any], axes: int) -> dict[str, NDArray[Any]]:
    """Return arrays, of which some first axes are those of samples, with the samples along one axis."""
    return {name: np.reshape(a, (math.prod(np.shape(a)[:axes]), *np.shape(a)[axes:])) for name, a in arrays.items()}


def data_frame(arrays: Mapping[str, NDArray[Any]], columns: Columns, described: str) -> Any:
    """Return a pandas DataFrame with a row for each sample of arrays of shape (N, ...), in units.

    Raises:
        MissingDependencyError: pandas is not installed.
    """
    pandas = require("pandas", "to_dataframe")
    converted = {name: columns.converted(name, array) for name, array in arrays.items()}
    headings = column_names(arrays, columns.heading)
    frame = pandas.DataFrame(dict(zip(headings, split_columns(converted), strict=True)))
    frame.attrs = {"description": described, "units": {name: columns.unit(name) for name in arrays}}
    return frame


def dataset(
    arrays: Mapping[str, Any],
    leading: Sequence[str],
    columns: Columns,
    described: str,
    t: NDArray[Any] | None = None,
) -> Any:
    """Return an xarray Dataset with a variable for each array, in units; arrays of Dask stay lazy.

    Args:
        arrays: arrays by name, whose axes begin with `leading`.
        leading: names of the axes of the samples.
        columns: units of the arrays.
        described: description of the whole.
        t: instants, the coordinate of the axis "time".

    Raises:
        MissingDependencyError: xarray is not installed.
    """
    xarray = require("xarray", "to_xarray")
    coordinates: dict[str, Any] = {}
    if t is not None:
        coordinates["time"] = ("time", columns.converted("t", t), {"units": columns.unit("t")})
    variables: dict[str, Any] = {}
    names = Names((*leading, "xy", "xyz", "body_xy", "body_xyz")).take_all(arrays)  # a joint may be "time"
    for name, array in arrays.items():
        tail = array.shape[len(leading) :]
        axes = "xyz" if 3 in tail else "xy"
        inner: tuple[str, ...] = (axes, f"body_{axes}")[: len(tail)]
        if len(tail) > 2 or any(size > 3 for size in tail):
            inner = tuple(f"{names[name]}_{k}" for k in range(len(tail)))
        else:
            coordinates |= {dim: list(axes) for dim in inner}
        facts = {"units": columns.unit(name), "long_name": QUANTITIES[name].text if name in QUANTITIES else ""}
        facts |= {"axes": "world"} if tail else {}
        values = columns.converted(name, array)
        variables[names[name]] = (*leading, *inner), values, {key: text for key, text in facts.items() if text}
    return xarray.Dataset(variables, coordinates, {"description": described})
