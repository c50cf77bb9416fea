"""Recordings of two bodies in files: columns by name, from .csv, .npz or .parquet, brought to one clock.

| what | columns | as one array in .npz |
|---|---|---|
| instants: seconds, or integer nanoseconds since 1970 | t | t |
| place of body 1, m | R1_x, R1_y, R1_z, or x1, y1, z1 | R1 (N, 3) |
| its attitude | S1_xx, S1_xy, ..., S1_zz, or qx1, qy1, qz1, qw1 (qw1 the scalar) | S1 (N, 3, 3) |
| body 2 | the same with 2 | R2, S2 |

A file of one body may leave the digit away (x, y, z, qx, qy, qz, qw): of two files the first is body 1. Results that
were saved with R1, S1, R2, S2 can be read as they are. Empty cells, nan and attitudes of zeros are missing samples.
Columns of no concern have to be named, so that a misspelt one is not missed; rates, angles and psi are passed over.
"""

from __future__ import annotations

import fnmatch
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, RotationError, nearest
from hingepair.measured.resample import resample
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.column_file import Columns, Wanted, read_columns
from hingepair.numeric.instants import increasing_seconds
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.results import column_names
from hingepair.rotations.matrices import project_to_rotation

# Columns that results have and a recording of poses does not need.
_PASSED_OVER = re.compile(r"(v|omega|a|alpha|d|q|qd|qdd|phi|phid|phidd)[12]?(_[xyz])?|psi(d|dd)?[12]?")

# Names, in small letters, that other recorders give the column t.
_INSTANT_NAMES = frozenset({"time", "times", "timestamp", "stamp", "seconds", "sec", "time_s", "t_s"})
# Names, in small letters, that other recorders give the columns x, y, z, x1 and so on.
_PLACE_NAME = re.compile(r"p(?:os(?:ition)?)?_?([xyz])([12]?)")


class Recording(NamedTuple):
    """Both bodies at the same instants, NaN where nothing was recorded."""

    body1: BodyMotion
    body2: BodyMotion
    t: NDArray[Any] | None  # as the file has it; None where it has none


class _Body(NamedTuple):
    """One body, and where it was read."""

    motion: BodyMotion
    t: NDArray[Any] | None
    path: Path


def read_recording(paths: Sequence[Path], ignore: Sequence[str] = (), gaps: float = 0.05) -> Recording:
    """Read the poses of two bodies from one file, or from one file for each body.

    Bodies of different instants are brought to those of the slower recording. Columns to ignore may have a `*` for
    anything; `gaps` is the longest time without a sample that is bridged [s].

    Raises:
        ArgumentError: a file or a column cannot be used; names both.
    """
    if not 1 <= len(paths) <= 2:
        raise ArgumentError("FILE", "one file, or two", f"{len(paths)}")
    bodies: dict[str, _Body] = {}
    for place, path in enumerate(paths, start=1):
        columns = _columns(path, ignore)
        digits = [digit for digit in ("1", "2", "") if any(_has(columns, names) for names in _places(digit))]
        if "1" in digits and "" in digits:
            digits.remove("")  # coordinates beside poses, as results are saved
        for digit in digits:
            name = digit or ("1" if len(paths) == 1 and "2" in digits else str(place))
            if name in bodies:
                raise ArgumentError(f"{path}", f"body {name} once", "a second time")
            bodies[name] = _Body(_motion(path, columns, digit), columns.get("t"), path)
    for name in ("1", "2"):
        if name not in bodies:
            wanted = f"columns of body {name}: R{name}_x, ... or x{name}, ... (without {name} in a file of its own)"
            raise ArgumentError(", ".join(map(str, paths)), wanted, "none")
    first, second = bodies["1"], bodies["2"]
    if first.path == second.path:
        return Recording(first.motion, second.motion, first.t)
    return _on_one_clock(first, second, gaps)


def _on_one_clock(first: _Body, second: _Body, gaps: float) -> Recording:
    """Return both bodies at the instants of the one with the longer steps."""
    t1, t2 = _instants(first), _instants(second)
    if np.array_equal(t1, t2):
        return Recording(first.motion, second.motion, t1)
    times = [increasing_seconds(f"{body.path}: t", t)[0] for body, t in ((first, t1), (second, t2))]
    steps = [float(np.median(np.diff(time))) for time in times]
    if steps[0] >= steps[1]:
        recording = Recording(first.motion, resample(t2, second.motion, t1, gaps), t1)
    else:
        recording = Recording(resample(t1, first.motion, t2, gaps), second.motion, t2)
    known = np.isfinite(recording.body1.R).all(axis=-1) & np.isfinite(recording.body2.R).all(axis=-1)
    if known.sum() < 2:
        spans = [f"{time[-1]:.4g} s in steps of {step:.4g} s" for time, step in zip(times, steps, strict=True)]
        wanted = "recordings of the same time, by one clock and in one unit"
        raise ArgumentError(f"{first.path}: t, {second.path}: t", wanted, " and ".join(spans))
    return recording


def _instants(body: _Body) -> NDArray[Any]:
    """Return the instants of a body that has a file of its own, or refuse a file without them."""
    if body.t is None:
        raise ArgumentError(f"{body.path}: t", "a column, since each body has a file", "no such column")
    return body.t


def _places(digit: str) -> tuple[tuple[str, ...], ...]:
    return tuple(f"R{digit}_{c}" for c in "xyz"), tuple(f"{c}{digit}" for c in "xyz")


def _attitudes(digit: str) -> tuple[tuple[str, ...], ...]:
    return tuple(f"S{digit}_{r}{c}" for r in "xyz" for c in "xyz"), tuple(f"q{c}{digit}" for c in "xyzw")


def _has(columns: Columns, names: tuple[str, ...]) -> bool:
    return any(name in columns for name in names)


def _motion(path: Path, columns: Columns, digit: str) -> BodyMotion:
    """Return the motion of a body; an attitude is NaN where a part of it is missing or its quaternion is 0."""
    R = _together(path, columns, _places(digit))
    attitude = _together(path, columns, _attitudes(digit))
    attitude[~np.isfinite(attitude).all(axis=-1) | (attitude == 0).all(axis=-1)] = np.nan
    if attitude.shape[1] == 9:
        S = attitude.reshape(-1, 3, 3)
        try:
            return BodyMotion(R=R, S=S)
        except RotationError:  # of a few digits
            return BodyMotion(R=R, S=project_to_rotation(S))
    return BodyMotion.from_quaternion_xyzw(R=R, quat_xyzw=attitude)


def _together(path: Path, columns: Columns, choices: tuple[tuple[str, ...], ...]) -> Float64Array:
    """Return the columns of the first choice of which any is present, stacked along the last axis."""
    own = next((names for names in choices if _has(columns, names)), choices[-1])
    for name in own:
        if name not in columns:
            raise ArgumentError(f"{path}: {name}", "a column", "no such column")
    return np.stack([columns[name] for name in own], axis=-1)


def _columns(path: Path, ignore: Sequence[str]) -> Columns:
    """Return the columns that a recording is made of, by name."""
    try:
        columns = read_columns(path, Wanted(lambda names: _known(names, ignore), _names_of, exact="t"))
    except ArgumentError as error:
        name = ": ".join(filter(None, (str(path), error.name)))
        raise ArgumentError(name, error.expected, error.got) from None
    return columns


def _names_of(name: str, tail: tuple[int, ...]) -> ArrayLike:
    return np.reshape(column_names({name: np.empty((1, *tail))}), tail) if tail in {(3,), (3, 3)} else name


def _known(names: Sequence[str], ignore: Sequence[str]) -> list[str]:
    """Return the columns to read; refuse a column that is unknown or comes twice."""
    known = [
        "t",
        *(name for digit in ("1", "2", "") for own in (*_places(digit), *_attitudes(digit)) for name in own),
    ]
    wanted = []
    for name in names:
        if any(fnmatch.fnmatchcase(name, pattern) for pattern in ignore):
            continue
        if name in known:
            if name in wanted:
                raise ArgumentError(name, "a column once", "a second one")
            wanted.append(name)
        elif not _PASSED_OVER.fullmatch(name):
            expected = f"columns of poses{_meant(name, known)}, or --ignore {name[:40]!r}"
            raise ArgumentError(repr(name[:40]), expected, "an unknown column")
    return wanted


def _meant(name: str, known: Sequence[str]) -> str:
    """Return ` (nearest: t)` for a column `time`, and likewise for other names that recorders give."""
    lower = name.lower()
    place = _PLACE_NAME.fullmatch(lower)
    column = "t" if lower in _INSTANT_NAMES else "".join(place.groups()) if place else ""
    return f" (nearest: {column})" if column in known else nearest(name, known)
