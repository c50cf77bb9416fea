"""Results as tables that other tools read, and as files: .csv, .npz, .parquet, .nc."""

from __future__ import annotations

import importlib
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, MissingDependencyError, quoted
from hingepair.numeric.whole_file import whole_file

_AXES = "xyz"
_ROWS = 65536
_UNITS = {
    **{
        "R": "m",
        "d": "m",
        "v": "m/s",
        "omega": "rad/s",
        "a": "m/s^2",
        "alpha": "rad/s^2",
        "phi": "rad",
        "psi": "rad",
    },
    **dict.fromkeys(("phi_x", "phi_y", "phi_z"), "rad"),
    **dict.fromkeys("xyz", "m"),
}


class Result:
    """Arrays over instants, as tables that other tools read. Its kinds have `t`, `recorded()` and `described`."""

    __slots__ = ()

    t: NDArray[np.float64]

    @property
    def described(self) -> str:
        """What it is, in a sentence."""
        raise NotImplementedError

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Everything that is kept, by name; shape (N, ...)."""
        raise NotImplementedError

    def to_dataframe(self) -> Any:
        """A pandas DataFrame, one column a component: t, R2_x, R2_y, ..., S2_xx, ..., psi; units in its `attrs`.

        Raises:
            MissingDependencyError: pandas is not installed.
        """
        pandas = _needed("pandas", "to_dataframe")
        arrays = self.recorded()
        frame = pandas.DataFrame(dict(zip(("t", *column_names(arrays)), _columns(self.t, arrays), strict=True)))
        frame.attrs = {"description": self.described, "units": {"t": "s", **{n: unit_of(n) for n in arrays}}}
        return frame

    def to_xarray(self) -> Any:
        """An xarray Dataset over `time`, vectors also over `xyz`, with units and descriptions as attributes.

        Matrices have the axes of the body as a third dimension, `body_xyz`.

        Raises:
            MissingDependencyError: xarray is not installed.
        """
        xarray = _needed("xarray", "to_xarray")
        arrays = self.recorded()
        variables: dict[str, Any] = {}
        letters: dict[str, list[str]] = {}
        for name, array in arrays.items():
            own = "xyz" if 3 in array.shape[1:] else "xy"
            dims = ("time", own, f"body_{own}")[: array.ndim]
            letters |= {dim: list(own) for dim in dims[1:]}
            variables[name] = (dims, array, {"units": unit_of(name), "axes": "world"})
        time = ("time", self.t, {"units": "s"})
        return xarray.Dataset(variables, {"time": time, **letters}, {"description": self.described})

    def save(self, path: str | os.PathLike[str], inputs: Iterable[str | os.PathLike[str]] = ()) -> Path:
        """Write it to a file, whole or not at all; every number comes back to the last bit.

        Args:
            path: ends in .csv (a header, then the fewest digits that give the same number), .npz (arrays by name),
                .parquet or .nc (NetCDF).
            inputs: files that are being read from, which the path must not be.

        Raises:
            ArgumentError: another ending, or the file cannot be written; what was there before stays.
            MissingDependencyError: the package for this kind of file is not installed.
        """
        return save(path, self.t, self.recorded(), inputs, self)


def save(
    path: str | os.PathLike[str],
    t: NDArray[Any],
    arrays: Mapping[str, NDArray[Any]],
    inputs: Iterable[str | os.PathLike[str]] = (),
    result: Result | None = None,
) -> Path:
    """Write t and the arrays to a file whose ending says how.

    Args:
        path: ends in one of `ENDINGS`.
        t: instants [s]; shape (N,).
        arrays: by output name; shape (N,), (N, 2), (N, 3) or (N, 3, 3).
        inputs: files that are being read from, which the path must not be.
        result: what they are, for files that describe themselves.

    Raises:
        ArgumentError: another ending, or the file cannot be written; what was there before stays.
    """
    target = Path(path)
    check_ending(target)
    record = result or _Arrays(t, dict(arrays))
    with whole_file(target, inputs) as file:
        _WRITERS[target.suffix.lower()](file, record)
    return target


class _Arrays(Result):
    """Arrays over instants, by themselves."""

    __slots__ = ("_arrays", "t")

    def __init__(self, t: NDArray[Any], arrays: dict[str, NDArray[Any]]) -> None:
        self.t = t
        self._arrays = arrays

    @property
    def described(self) -> str:
        """Nothing is known of them."""
        return ""

    def recorded(self) -> dict[str, NDArray[Any]]:
        """The arrays."""
        return self._arrays


def check_ending(path: Path) -> None:
    """Refuse a file name whose ending names no format.

    Raises:
        ArgumentError: it ends in none that is known.
    """
    if path.suffix.lower() not in _WRITERS:
        raise ArgumentError("out", f"a file name that ends in {', '.join(ENDINGS)}", quoted(str(path)))


def unit_of(name: str) -> str:
    """The unit of an output.

    >>> unit_of("omega2"), unit_of("R2"), unit_of("S2")
    ('rad/s', 'm', '1')
    """
    return _UNITS.get(name.rstrip("12"), "1")


def column_names(arrays: Mapping[str, NDArray[Any]]) -> list[str]:
    """One name for each component: R2_x, S2_xy and so on; a number at each instant has its own name.

    >>> column_names({"d": np.zeros((1, 3))})
    ['d_x', 'd_y', 'd_z']
    """
    return [f"{name}{ending}" for name, array in arrays.items() for ending in _endings(array.shape[1:])]


def _endings(tail: tuple[int, ...]) -> list[str]:
    """What is behind the name of each component; tail: () for a number, (3,) or (2,) for a vector, (3, 3)."""
    letters = ["".join(_AXES[i] for i in index) for index in np.ndindex(tail)]
    return [f"_{c}" if c else "" for c in letters]


def _columns(t: NDArray[Any], arrays: Mapping[str, NDArray[Any]]) -> list[NDArray[Any]]:
    return [t, *(column for array in arrays.values() for column in array.reshape(len(t), -1).T)]


def _write_npz(file: IO[bytes], result: Result) -> None:
    named: dict[str, Any] = {"t": result.t, **result.recorded()}
    np.savez(file, **named)  # no other keyword: NumPy 2.1 takes each for an array


def _write_csv(file: IO[bytes], result: Result) -> None:
    arrays = result.recorded()
    columns = _columns(result.t, arrays)
    file.write((",".join(["t", *column_names(arrays)]) + "\n").encode())
    for start in range(0, len(result.t), _ROWS):
        rows = np.stack([column[start : start + _ROWS] for column in columns], axis=1)
        np.savetxt(file, rows, fmt="%s", delimiter=",")


def _write_parquet(file: IO[bytes], result: Result) -> None:
    arrow = _needed("pyarrow", "save")
    parquet = _needed("pyarrow.parquet", "save")
    arrays = result.recorded()
    names = ["t", *column_names(arrays)]
    columns = [arrow.array(np.ascontiguousarray(column)) for column in _columns(result.t, arrays)]
    facts = {"description": result.described, "t": "s", **{name: unit_of(name) for name in arrays}}
    parquet.write_table(arrow.table(columns, names=names).replace_schema_metadata(facts), file)


def _write_netcdf(file: IO[bytes], result: Result) -> None:
    _needed("scipy", "save")
    file.write(result.to_xarray().to_netcdf(engine="scipy"))


def _needed(package: str, caller: str) -> Any:
    try:
        return importlib.import_module(package)
    except ImportError:
        expected = f"the package {package.partition('.')[0]}: pip install 'hingepair[data]'"
        raise MissingDependencyError(caller, expected, "none") from None


_WRITERS = {".csv": _write_csv, ".npz": _write_npz, ".parquet": _write_parquet, ".nc": _write_netcdf}
ENDINGS = tuple(_WRITERS)
"""Endings of files that results are written to."""
