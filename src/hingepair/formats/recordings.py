"""Recordings of two bodies in files: columns by name, from .csv, .npz or .parquet, brought to one clock.

| what | columns | as one array in .npz |
|---|---|---|
| instants: seconds, or integer nanoseconds since 1970 | t | t |
| place of body 1, m | R1_x, R1_y, R1_z, or x1, y1, z1 | R1 (N, 3) |
| its attitude | S1_xx, S1_xy, ..., S1_zz, or qx1, qy1, qz1, qw1 (qw1 the scalar) | S1 (N, 3, 3) |
| body 2 | the same with 2 | R2, S2 |
| an encoder of the hinge angle, in any unit | as the caller names it | the same, (N,) |

Body 2 may be a point: a recording with positions alone.

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
from hingepair.numeric.column_file import ColumnRequest, Columns, read_columns
from hingepair.numeric.instants import increasing_seconds
from hingepair.numeric.wrapped_angles import unwrap_if_wrapped
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
    encoder: Float64Array | None  # readings at the instants of body 1; None where no column was named; shape (N,)


class _Body(NamedTuple):
    """One body, and where it was read."""

    motion: BodyMotion
    t: NDArray[Any] | None
    path: Path
    encoder: Float64Array | None  # readings in the file of the body


def read_recording(
    paths: Sequence[Path], ignore: Sequence[str] = (), gaps: float = 0.05, encoder: str | None = None
) -> Recording:
    """Read the poses of two bodies from one file, or from one file for each body.

    Bodies of different instants are brought to those of the slower recording.

    Args:
        paths: one file, or two.
        ignore: columns to ignore; `*` stands for anything.
        gaps: the longest time without a sample that is bridged [s].
        encoder: column with the readings of an encoder, in the file of body 1, whose clock it has.

    Raises:
        ArgumentError: a file or a column cannot be used; names both.
    """
    if not 1 <= len(paths) <= 2:
        raise ArgumentError("FILE", "one file, or two", f"{len(paths)}")
    poses = {"t", *(name for digit in ("1", "2", "") for names in _all_names(digit) for name in names)}
    if encoder in poses:
        raise ArgumentError("encoder", "a column that is not t and not of a pose", repr(encoder))
    bodies: dict[str, _Body] = {}
    present: list[str] = []
    for place, path in enumerate(paths, start=1):
        columns = _read_columns(path, ignore, encoder, present)
        digits = [digit for digit in ("1", "2", "") if any(_has(columns, names) for names in _places(digit))]
        if "1" in digits and "" in digits:
            digits.remove("")  # coordinates beside poses, as results are saved
        for digit in digits:
            name = digit or ("1" if len(paths) == 1 and "2" in digits else str(place))
            if name in bodies:
                raise ArgumentError(f"{path}", f"body {name} once", "a second time")
            reading = None if encoder is None else columns.get(encoder)
            bodies[name] = _Body(_body_motion(path, columns, digit, name), columns.get("t"), path, reading)
    for name in ("1", "2"):
        if name not in bodies:
            wanted = f"columns of body {name}: R{name}_x, ... or x{name}, ... (without {name} in a file of its own)"
            raise ArgumentError(", ".join(map(str, paths)), wanted, "none")
    first, second = bodies["1"], bodies["2"]
    if encoder is not None and first.encoder is None:
        wanted = f"a column of {first.path}, the file of body 1, whose clock the encoder has"
        got = f"{encoder!r} in {second.path}" if second.encoder is not None else repr(encoder[:40])
        near = "" if second.encoder is not None else nearest(encoder, sorted(set(present)))
        raise ArgumentError("encoder", wanted + near, got)
    if first.path == second.path:
        return Recording(first.motion, second.motion, first.t, first.encoder)
    return _on_one_clock(first, second, gaps)


def _on_one_clock(first: _Body, second: _Body, gaps: float) -> Recording:
    """Return both bodies at the instants of the one with the longer steps."""
    t1, t2 = _body_instants(first), _body_instants(second)
    if np.array_equal(t1, t2):
        return Recording(first.motion, second.motion, t1, first.encoder)
    times = [increasing_seconds(f"{body.path}: t", t)[0] for body, t in ((first, t1), (second, t2))]
    steps = [float(np.median(np.diff(time))) for time in times]
    if steps[0] >= steps[1]:
        recording = Recording(first.motion, resample(t2, second.motion, t1, gaps), t1, first.encoder)
    else:
        reading = first.encoder
        if reading is not None:
            reading = resample(t1, unwrap_if_wrapped(reading), t2, gaps)
        recording = Recording(resample(t1, first.motion, t2, gaps), second.motion, t2, reading)
    known = np.isfinite(recording.body1.R).all(axis=-1) & np.isfinite(recording.body2.R).all(axis=-1)
    if known.sum() < 2:
        spans = [f"{time[-1]:.4g} s in steps of {step:.4g} s" for time, step in zip(times, steps, strict=True)]
        wanted = "recordings of the same time, by one clock and in one unit"
        raise ArgumentError(f"{first.path}: t, {second.path}: t", wanted, " and ".join(spans))
    return recording


def _body_instants(body: _Body) -> NDArray[Any]:
    """Return the instants of a body that has a file of its own, or refuse a file without them."""
    if body.t is None:
        raise ArgumentError(f"{body.path}: t", "a column, since each body has a file", "no such column")
    return body.t


def _places(digit: str) -> tuple[tuple[str, ...], ...]:
    return tuple(f"R{digit}_{c}" for c in "xyz"), tuple(f"{c}{digit}" for c in "xyz")


def _attitudes(digit: str) -> tuple[tuple[str, ...], ...]:
    return tuple(f"S{digit}_{r}{c}" for r in "xyz" for c in "xyz"), tuple(f"q{c}{digit}" for c in "xyzw")


def _all_names(digit: str) -> tuple[tuple[str, ...], ...]:
    return (*_places(digit), *_attitudes(digit))


def _has(columns: Columns, names: tuple[str, ...]) -> bool:
    return any(name in columns for name in names)


def _body_motion(path: Path, columns: Columns, digit: str, body: str) -> BodyMotion:
    """Return the motion of a body; an attitude is NaN where a part of it is missing or its quaternion is 0.

    Body 2 without any column of an attitude is a point.
    """
    R = _together(path, columns, _places(digit))
    if not any(_has(columns, names) for names in _attitudes(digit)):
        if body == "2":
            return BodyMotion(R=R)
        wanted = (
            f"columns of the attitude of body 1: S{digit}_xx, ..., S{digit}_zz or qx{digit}, qy{digit}, qz{digit}, "
            f"qw{digit} (a body that is known by its position alone must be body 2)"
        )
        raise ArgumentError(f"{path}", wanted, "none")
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
            raise ArgumentError(f"{path}: {name}", f"a column, beside {', '.join(_present(columns, own))}", "none")
    return np.stack([columns[name] for name in own], axis=-1)


def _present(columns: Columns, names: Sequence[str]) -> list[str]:
    return [name for name in names if name in columns]


def _read_columns(path: Path, ignore: Sequence[str], encoder: str | None, present: list[str]) -> Columns:
    """Return the columns that a recording is made of, by name; add the names of all columns to `present`."""

    def choose(names: list[str]) -> list[str]:
        present.extend(names)
        return _known_columns(names, ignore, encoder)

    try:
        columns = read_columns(path, ColumnRequest(choose, _names_of, exact="t"))
    except ArgumentError as error:
        name = ": ".join(filter(None, (str(path), error.name)))
        raise ArgumentError(name, error.expected, error.got) from None
    return columns


def _names_of(name: str, tail: tuple[int, ...]) -> ArrayLike:
    return np.reshape(column_names({name: np.empty((1, *tail))}), tail) if tail in {(3,), (3, 3)} else name


def _known_columns(names: Sequence[str], ignore: Sequence[str], encoder: str | None) -> list[str]:
    """Return the columns to read; refuse a column that is unknown or comes twice."""
    known = ["t", *(name for digit in ("1", "2", "") for own in _all_names(digit) for name in own)]
    if encoder is not None:
        known.append(encoder)
    wanted = []
    for name in names:
        if name != encoder and any(fnmatch.fnmatchcase(name, pattern) for pattern in ignore):
            continue
        if name in known:
            if name in wanted:
                raise ArgumentError(name, "a column once", "a second one")
            wanted.append(name)
        elif not _PASSED_OVER.fullmatch(name):
            short = repr(name[:40])
            meant = _meant(name, known)
            reads_angle = "" if meant or encoder is not None else f", --encoder {short} if it reads the hinge angle"
            expected = f"columns of poses{meant}{reads_angle}, or --ignore {short}"
            raise ArgumentError(short, expected, "an unknown column")
    return wanted


def _meant(name: str, known: Sequence[str]) -> str:
    """Return ` (nearest: t)` for a column `time`, and likewise for other names that recorders give."""
    lower = name.lower()
    place = _PLACE_NAME.fullmatch(lower)
    column = "t" if lower in _INSTANT_NAMES else "".join(place.groups()) if place else ""
    return f" (nearest: {column})" if column in known else nearest(name, known)
