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
from hingepair.measured.smoothing.resample import resample
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.column_file import ColumnRequest, Columns, read_columns
from hingepair.numeric.instants import increasing_seconds
from hingepair.numeric.wrapped_angles import unwrap_if_wrapped
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.results import column_names
from hingepair.rotations.matrices import project_to_rotation

# Columns that results have and a recording of poses does not need.
_IGNORED_COLUMNS = re.compile(r"(v|omega|a|alpha|d|q|qd|qdd|phi|phid|phidd)[12]?(_[xyz])?|psi(d|dd)?[12]?")

# Names, in small letters, that other recorders give the column t.
_TIME_ALIASES = frozenset({"time", "times", "timestamp", "stamp", "seconds", "sec", "time_s", "t_s"})
# Names, in small letters, that other recorders give the columns x, y, z, x1 and so on.
_POSITION_ALIAS = re.compile(r"p(?:os(?:ition)?)?_?([xyz])([12]?)")


class Recording(NamedTuple):
    """Motions of two bodies at common instants, NaN where not recorded, and what an encoder read."""

    body1: BodyMotion
    body2: BodyMotion
    t: NDArray[Any] | None  # as the file has it; None where it has none
    encoder: Float64Array | None  # readings at the instants of body 1; None where no column was named; shape (N,)


class _RecordedBody(NamedTuple):
    """Motion of one body, with what stands in its file; None for columns that the file lacks."""

    motion: BodyMotion
    t: NDArray[Any] | None
    path: Path
    encoder: Float64Array | None


def read_recording(
    paths: Sequence[Path],
    ignored_columns: Sequence[str] = (),
    max_gap: float = 0.05,
    encoder_column: str | None = None,
) -> Recording:
    """Read the poses of two bodies, from one file or from one file for each, and return them at common instants, if
    these differ those of the slower recording.

    Args:
        paths: one file, or two.
        ignored_columns: columns to ignore; `*` stands for anything.
        max_gap: the longest time without a sample that is bridged [s].
        encoder_column: column with the readings of an encoder, in the file of body 1, whose clock it has.

    Raises:
        ArgumentError: a file or a column cannot be used; names both.
    """
    if not 1 <= len(paths) <= 2:
        raise ArgumentError("FILE", "one file, or two", f"{len(paths)}")
    poses = {"t", *(name for digit in ("1", "2", "") for names in _pose_column_names(digit) for name in names)}
    if encoder_column in poses:
        raise ArgumentError("encoder", "a column that is not t and not of a pose", repr(encoder_column))
    bodies: dict[str, _RecordedBody] = {}
    present_names: list[str] = []
    for place, path in enumerate(paths, start=1):
        columns = _read_columns(path, ignored_columns, encoder_column, present_names)
        digits = [
            digit
            for digit in ("1", "2", "")
            if any(_has_any_column(columns, names) for names in _position_column_names(digit))
        ]
        if "1" in digits and "" in digits:
            digits.remove("")  # coordinates beside poses, as results are saved
        for digit in digits:
            name = digit or str(place)
            if name in bodies:
                raise ArgumentError(f"{path}", f"body {name} once", "a second time")
            reading = None if encoder_column is None else columns.get(encoder_column)
            bodies[name] = _RecordedBody(_body_motion(path, columns, digit, name), columns.get("t"), path, reading)
    for name in ("1", "2"):
        if name not in bodies:
            expected = f"columns of body {name}: R{name}_x, ... or x{name}, ... (without {name} in a file of its own)"
            raise ArgumentError(", ".join(map(str, paths)), expected, "none")
    first, second = bodies["1"], bodies["2"]
    if encoder_column is not None and first.encoder is None:
        expected = f"a column of {first.path}, the file of body 1, whose clock the encoder has"
        got = f"{encoder_column!r} in {second.path}" if second.encoder is not None else repr(encoder_column[:40])
        near = "" if second.encoder is not None else nearest(encoder_column, sorted(set(present_names)))
        raise ArgumentError("encoder", expected + near, got)
    if first.path == second.path:
        return Recording(first.motion, second.motion, first.t, first.encoder)
    return _resample_to_one_clock(first, second, max_gap)


def _resample_to_one_clock(first: _RecordedBody, second: _RecordedBody, max_gap: float) -> Recording:
    """Resample the motions of two bodies and the encoder readings of the first at the instants of the body with the
    longer time steps, and return a Recording. Gaps up to `max_gap` [s] are bridged. Equal instants need no
    resampling. Raise an ArgumentError if a body has no instants, or if fewer than two instants have both bodies.
    """
    t1, t2 = _body_instants(first), _body_instants(second)
    if np.array_equal(t1, t2):
        return Recording(first.motion, second.motion, t1, first.encoder)
    times = [increasing_seconds(f"{body.path}: t", t)[0] for body, t in ((first, t1), (second, t2))]
    steps = [float(np.median(np.diff(time))) for time in times]
    if steps[0] >= steps[1]:
        recording = Recording(first.motion, resample(t2, second.motion, t1, max_gap), t1, first.encoder)
    else:
        reading = first.encoder
        if reading is not None:
            reading = resample(t1, unwrap_if_wrapped(reading), t2, max_gap)
        recording = Recording(resample(t1, first.motion, t2, max_gap), second.motion, t2, reading)
    is_known = np.isfinite(recording.body1.R).all(axis=-1) & np.isfinite(recording.body2.R).all(axis=-1)
    if is_known.sum() < 2:
        spans = [f"{time[-1]:.4g} s in steps of {step:.4g} s" for time, step in zip(times, steps, strict=True)]
        expected = "recordings of the same time, by one clock and in one unit"
        raise ArgumentError(f"{first.path}: t, {second.path}: t", expected, " and ".join(spans))
    return recording


def _body_instants(body: _RecordedBody) -> NDArray[Any]:
    """Return the array of instants of a body that has a file of its own; raise an ArgumentError if the file has no
    column of instants.
    """
    if body.t is None:
        raise ArgumentError(f"{body.path}: t", "a column, since each body has a file", "no such column")
    return body.t


def _position_column_names(digit: str) -> tuple[tuple[str, ...], ...]:
    """Return the two tuples of column names that may hold a position, for a body with this digit or ""."""
    return tuple(f"R{digit}_{c}" for c in "xyz"), tuple(f"{c}{digit}" for c in "xyz")


def _attitude_column_names(digit: str) -> tuple[tuple[str, ...], ...]:
    """Return the two tuples of column names that may hold an attitude, for a body with this digit or ""."""
    return tuple(f"S{digit}_{r}{c}" for r in "xyz" for c in "xyz"), tuple(f"q{c}{digit}" for c in "xyzw")


def _pose_column_names(digit: str) -> tuple[tuple[str, ...], ...]:
    """Return all tuples of column names of positions and attitudes, for a body with this digit or ""."""
    return (*_position_column_names(digit), *_attitude_column_names(digit))


def _has_any_column(columns: Columns, names: tuple[str, ...]) -> bool:
    """Return whether any of the names is a column."""
    return any(name in columns for name in names)


def _body_motion(path: Path, columns: Columns, column_digit: str, body_digit: str) -> BodyMotion:
    """Return the poses of body "1" or "2" (`body_digit`) as a BodyMotion, from the columns whose names hold
    `column_digit`, which is "" for names without a digit. An attitude is NaN if a part of it is missing or all of it
    is 0. Matrices of few digits are projected to rotations. Body 2 without columns of an attitude is a point. Raise
    an ArgumentError, which names the file `path`, if a column is missing.
    """
    R = _stack_columns(path, columns, _position_column_names(column_digit))
    if not any(_has_any_column(columns, names) for names in _attitude_column_names(column_digit)):
        if body_digit == "2":
            return BodyMotion(R=R)
        expected = (
            f"columns of the attitude of body 1: S{column_digit}_xx, ..., S{column_digit}_zz or qx{column_digit}, "
            f"qy{column_digit}, qz{column_digit}, qw{column_digit} (a body that is known by its position alone must "
            "be body 2)"
        )
        raise ArgumentError(f"{path}", expected, "none")
    attitude = _stack_columns(path, columns, _attitude_column_names(column_digit))
    attitude[~np.isfinite(attitude).all(axis=-1) | (attitude == 0).all(axis=-1)] = np.nan
    if attitude.shape[1] == 9:
        S = attitude.reshape(-1, 3, 3)
        try:
            return BodyMotion(R=R, S=S)
        except RotationError:  # of a few digits
            return BodyMotion(R=R, S=project_to_rotation(S))
    return BodyMotion.from_quaternion_xyzw(R=R, quat_xyzw=attitude)


def _stack_columns(path: Path, columns: Columns, alternatives: tuple[tuple[str, ...], ...]) -> Float64Array:
    """Stack columns along the last axis, and return the array (N, k). The columns are named by the first tuple of
    names in `alternatives` of which any column is present. Raise an ArgumentError, which names the file `path`, if a
    column of that tuple is missing.
    """
    names = next((names for names in alternatives if _has_any_column(columns, names)), alternatives[-1])
    for name in names:
        if name not in columns:
            raise ArgumentError(
                f"{path}: {name}",
                f"a column, since the file has {', '.join(_present_columns(columns, names))}",
                "none",
            )
    return np.stack([columns[name] for name in names], axis=-1)


def _present_columns(columns: Columns, names: Sequence[str]) -> list[str]:
    """Return a list of the names that are columns."""
    return [name for name in names if name in columns]


def _read_columns(
    path: Path, ignored_columns: Sequence[str], encoder_column: str | None, present_names: list[str]
) -> Columns:
    """Read the columns of a file that a recording needs, and return a dict of arrays by name. Add the names of all
    columns of the file to the list `present_names`. `ignored_columns` are name patterns, and `encoder_column` is a
    name or None. Raise an ArgumentError if a column is unknown or cannot be used.
    """

    def choose(names: list[str]) -> list[str]:
        present_names.extend(names)
        return _columns_to_read(names, ignored_columns, encoder_column)

    try:
        columns = read_columns(path, ColumnRequest(choose, _component_names, exact="t"))
    except ArgumentError as error:
        name = ": ".join(filter(None, (str(path), error.name)))
        raise ArgumentError(name, error.expected, error.got) from None
    return columns


def _component_names(name: str, sample_shape: tuple[int, ...]) -> ArrayLike:
    """Return an array (3,) or (3, 3) of the column names of the components of a vector or a matrix called `name`.
    `sample_shape` is the shape of one sample; if it is neither (3,) nor (3, 3), return `name`, a string.
    """
    if sample_shape not in {(3,), (3, 3)}:
        return name
    return np.reshape(column_names({name: np.empty((1, *sample_shape))}), sample_shape)


def _columns_to_read(names: Sequence[str], ignored_columns: Sequence[str], encoder_column: str | None) -> list[str]:
    """Return a list of the `names` to be read: instants, poses, and `encoder_column` unless it is None. Names that
    match a pattern in `ignored_columns` are left out, and so are columns of results that are not poses, such as
    velocities. Raise an ArgumentError for a column that occurs twice, or that is neither known nor ignored.
    """
    known_names = [
        "t",
        *(name for digit in ("1", "2", "") for pose_names in _pose_column_names(digit) for name in pose_names),
    ]
    if encoder_column is not None:
        known_names.append(encoder_column)
    wanted = []
    for name in names:
        if name != encoder_column and any(fnmatch.fnmatchcase(name, pattern) for pattern in ignored_columns):
            continue
        if name in known_names:
            if name in wanted:
                raise ArgumentError(name, "a column once", "a second one")
            wanted.append(name)
        elif not _IGNORED_COLUMNS.fullmatch(name):
            short = repr(name[:40])
            meant = _column_hint(name, known_names)
            reads_angle = (
                "" if meant or encoder_column is not None else f", --encoder {short} if it reads the hinge angle"
            )
            expected = f"columns of poses{meant}{reads_angle}, or --ignore {short}"
            raise ArgumentError(short, expected, "an unknown column")
    return wanted


def _column_hint(name: str, known_names: Sequence[str]) -> str:
    """Return the end of a message on an unknown column `name`, such as ` (nearest: t)` for `time`; "" if none of
    `known_names` is near.
    """
    lower = name.lower()
    position = _POSITION_ALIAS.fullmatch(lower)
    column = "t" if lower in _TIME_ALIASES else "".join(position.groups()) if position else ""
    return f" (nearest: {column})" if column in known_names else nearest(name, known_names)
