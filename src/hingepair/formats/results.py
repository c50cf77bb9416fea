"""Results to files: .npz, or .csv with one column a component."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.formats.whole_file import whole_file
from hingepair.numeric.arrays import split

_AXES = "xyz"
_ROWS = 65536


def save(
    path: str | os.PathLike[str],
    t: NDArray[Any],
    arrays: Mapping[str, NDArray[Any]],
    inputs: Iterable[str | os.PathLike[str]] = (),
) -> Path:
    """Write t and the arrays to a file whose ending says how.

    Args:
        path: ends in .npz (arrays by name) or .csv (a header, then the fewest digits that give the same number).
        t: instants [s]; shape (N,).
        arrays: by output name; shape (N,), (N, 2), (N, 3) or (N, 3, 3).
        inputs: files that are being read from, which the path must not be.

    Raises:
        ArgumentError: another ending, or the file cannot be written; what was there before stays.
    """
    target = Path(path)
    check_ending(target)
    with whole_file(target, inputs) as file:
        _WRITERS[target.suffix.lower()](file, t, arrays)
    return target


def check_ending(path: Path) -> None:
    """Refuse a file name whose ending names no format.

    Raises:
        ArgumentError: it ends neither in .npz nor in .csv.
    """
    if path.suffix.lower() not in _WRITERS:
        raise ArgumentError("out", "a file name that ends in .npz or .csv", quoted(str(path)))


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


def _write_npz(file: IO[bytes], t: NDArray[Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    named: dict[str, Any] = {"t": t, **arrays}
    np.savez(file, **named)  # no other keyword: NumPy 2.1 takes each for an array


def _write_csv(file: IO[bytes], t: NDArray[Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    file.write((",".join(["t", *column_names(arrays)]) + "\n").encode())
    for (rows,) in split(t.shape, _ROWS):
        parts = [t[rows, None], *(array[rows].reshape(rows.stop - rows.start, -1) for array in arrays.values())]
        np.savetxt(file, np.concatenate(parts, axis=1), fmt="%s", delimiter=",")


_WRITERS = {".npz": _write_npz, ".csv": _write_csv}
