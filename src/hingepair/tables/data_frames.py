"""Arrays by name as tables of pandas and xarray, and the names of their columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.equations.quantities import QUANTITIES
from hingepair.numeric.names import Names
from hingepair.tables.units import Columns


def column_names(arrays: Mapping[str, NDArray[Any]], heading: Callable[[str], str] = str) -> list[str]:
    """Return the headings of columns of the components of arrays: R2_x, S2_xy and so on; of numbers the name itself.

    >>> column_names({"d": np.zeros((1, 3)), "jacobian": np.zeros((1, 2, 6))})[:6]
    ['d_x', 'd_y', 'd_z', 'jacobian_0_0', 'jacobian_0_1', 'jacobian_0_2']
    """
    return [heading(f"{name}{ending}") for name, array in arrays.items() for ending in _endings(array.shape[1:])]


def _endings(sample_shape: tuple[int, ...]) -> list[str]:
    """Return the ends of names of components: "_x" of vectors, "_xy" of matrices, "_0_1" of larger ones, else ""."""
    if any(size > 3 for size in sample_shape):
        return ["".join(f"_{i}" for i in index) for index in np.ndindex(sample_shape)]
    letters = ["".join("xyz"[i] for i in index) for index in np.ndindex(sample_shape)]
    return [f"_{c}" if c else "" for c in letters]


def split_columns(arrays: Mapping[str, NDArray[Any]]) -> list[NDArray[Any]]:
    """Return all components of arrays of shape (N, ...), one array of shape (N,) for each column."""
    matrices = (array.reshape(len(array), math.prod(array.shape[1:])) for array in arrays.values())
    return [column for matrix in matrices for column in matrix.T]


_SIZED: Final = frozenset({"m/s", "m/s^2", "rad/s", "rad/s^2", "N", "N m"})  # vectors whose magnitude is shown


def with_magnitudes(arrays: Mapping[str, NDArray[Any]], si_unit: Callable[[str], str]) -> dict[str, NDArray[Any]]:
    """Return arrays of shape (N, ...), and behind each velocity, acceleration, force and torque its magnitude.

    >>> list(with_magnitudes({"R2": np.zeros((1, 3)), "v2": np.zeros((1, 3))}, lambda name: QUANTITIES[name].unit))
    ['R2', 'v2', '|v2|']
    """
    found: dict[str, NDArray[Any]] = {}
    for name, array in arrays.items():
        found[name] = array
        if array.shape[1:] in {(2,), (3,)} and si_unit(name) in _SIZED:
            found[f"|{name}|"] = np.hypot.reduce(array, axis=1)
    return found


def plain_magnitudes(components: Iterable[str], zeros: Collection[str]) -> set[str]:
    """Return the magnitudes, such as |v2|, of vectors of which fewer than two components are not in `zeros`.

    >>> sorted(plain_magnitudes(["v_x", "v_y", "v_z", "|v|", "a_x", "a_y", "a_z", "|a|"], {"v_y", "v_z", "a_x"}))
    ['|v|']
    """
    shown = [name.rpartition("_")[0] for name in components if name not in zeros]
    return {name for name in components if name.startswith("|") and shown.count(name.strip("|")) < 2}


def sample_rows(arrays: Mapping[str, Any], axes: int) -> dict[str, NDArray[Any]]:
    """Return arrays, of which some first axes are those of samples, with the samples along one axis."""
    return {name: np.reshape(a, (math.prod(np.shape(a)[:axes]), *np.shape(a)[axes:])) for name, a in arrays.items()}


def data_frame(arrays: Mapping[str, NDArray[Any]], columns: Columns, described: str) -> Any:
    """Return a pandas DataFrame with a row for each sample of arrays of shape (N, ...), in units."""
    import pandas

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
    """Return an xarray Dataset with a variable for each array, in units.

    Args:
        arrays: arrays by name, whose axes begin with `leading`.
        leading: names of the axes of the samples.
        columns: units of the arrays.
        described: description of the whole.
        t: instants, the coordinate of the axis "time".
    """
    import xarray

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
