"""Instants of recordings: counted from the first one, exactly, and cut where samples are missing.

Seconds since 1970 take 31 bits of a double before the point and leave 2.4e-7 s behind it. So instants are subtracted
in the kind of number that they came in, and only their differences become float64 seconds.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, DtypeError, ShapeError
from hingepair.numeric.arrays import Float64Array, finite_number, real_array

_NANOSECONDS = 10**17  # integers from here on are nanoseconds since 1970 (1973 and later)
_MILLISECONDS = 1e11  # 3,000 years: integers from here on are in milliseconds or microseconds
_MAX_SECONDS = 1e14  # floats beyond can only be nanoseconds
_MAX_STEP_SPREAD = 0.3  # of the median step, from the 10 % to the 90 % quantile; more is jitter


class MeasurementWarning(UserWarning):
    """Warns that recorded data make a result unreliable: noise, irregular time steps, or doubtful units."""


def warn_of_measurements(sentences: Iterable[str], stacklevel: int = 3) -> None:
    """Issue a MeasurementWarning for each sentence, by default at the line that called the caller."""
    for sentence in sentences:
        warnings.warn(sentence, MeasurementWarning, stacklevel=stacklevel)


def _stamps(name: str, t: ArrayLike) -> NDArray[Any]:
    """Return instants as an array: of pandas with a time zone in UTC, datetime64 of months or years in seconds."""
    stamps = t if isinstance(t, np.ndarray) else np.asarray(t)
    if stamps.dtype.kind == "O" and getattr(getattr(t, "dtype", None), "tz", None) is not None:
        stamps = t.to_numpy("datetime64[ns]")  # type: ignore[union-attr]
    if stamps.dtype.kind in "mM" and np.datetime_data(stamps.dtype)[0] in {"M", "Y"}:
        if stamps.dtype.kind == "m":
            raise DtypeError(name, "a timedelta64 of weeks or shorter units", stamps.dtype.name)
        stamps = stamps.astype("datetime64[s]")
    return stamps


def sample_text(sample: int, lines: NDArray[Any] | None) -> str:
    """Return where a sample is, for messages: its line in a file, if the lines of all samples are known."""
    return f"sample {sample}" if lines is None else f"line {lines[sample]}"


def elapsed_seconds(
    name: str, t: ArrayLike, since: object = None, lines: NDArray[Any] | None = None
) -> tuple[Float64Array, Any]:
    """Return the seconds since a reference instant, and this instant.

    Nothing is lost of datetime64 and of integers. Seconds since 1970 as floats are multiples of 2.4e-7 s, which is
    how they came; they are not rounded again.

    Args:
        name: of the argument, for messages.
        t: seconds as floats, datetime64, timedelta64, or integer nanoseconds since 1970; shape (N,).
        since: the instant to count from, as an earlier call returned it; the first of t unless given.
        lines: lines of a file in which the instants stand; shape (N,).

    Raises:
        ArgumentError: not of one axis, empty, not finite, of another kind than `since`, or integers that may be
            nanoseconds, milliseconds or seconds.
    """
    given = _stamps(name, t)
    stamps = given if given.dtype.kind in "mM" else real_array(name, t)
    if stamps.ndim != 1 or not stamps.size:
        raise ShapeError(name, "shape (N,), at least one instant", f"shape {stamps.shape}")
    if stamps.dtype.kind in "iu":
        if np.abs(stamps.astype(np.float64)).min() < _NANOSECONDS:
            wanted = "float seconds, datetime64, or nanoseconds since 1970 as integers: which unit are these in?"
            raise DtypeError(name, f"{wanted} (1e-3 * t where milliseconds)", f"{stamps.dtype.name} from {stamps[0]}")
        stamps = stamps.astype(np.int64)
    missing = np.flatnonzero(np.isnat(stamps) if stamps.dtype.kind in "mM" else ~np.isfinite(stamps))
    if missing.size:
        raise ArgumentError(name, "finite instants", f"{stamps[missing[0]]} at {sample_text(missing[0], lines)}")
    if stamps.dtype.kind == "f":
        stamps = stamps.astype(np.float64)
        if np.abs(stamps).max() > _MAX_SECONDS:
            wanted = "seconds, or integers where they are nanoseconds (as floats they are off by 100 ns)"
            raise ArgumentError(name, wanted, float(stamps[0]))
    first = stamps[0] if since is None else since
    if np.asarray(first).dtype.kind != stamps.dtype.kind:
        kinds = {"f": "float seconds", "i": "integer nanoseconds", "M": "datetime64", "m": "timedelta64"}
        raise DtypeError(name, kinds[np.asarray(first).dtype.kind], kinds[stamps.dtype.kind])
    differences = stamps - first
    if differences.dtype.kind == "m":
        return np.asarray(differences / np.timedelta64(1, "ns") * 1e-9), first
    return np.asarray(differences * 1e-9 if differences.dtype.kind == "i" else differences, dtype=np.float64), first


def increasing_seconds(name: str, t: ArrayLike, lines: NDArray[Any] | None = None) -> tuple[Float64Array, Any]:
    """Return the seconds since the first of the instants t, and this instant with its own type; `lines` are those of
    the file in which they stand.

    Raises:
        ArgumentError: as `elapsed_seconds`, or two instants are the same or in the wrong order; names the first such.
    """
    seconds, first = elapsed_seconds(name, t, lines=lines)
    steps = np.diff(seconds)
    bad = np.flatnonzero(~(steps > 0)) + 1
    if bad.size:
        i = int(bad[0])
        how = "the same stamp as" if steps[i - 1] == 0 else f"{-steps[i - 1]:.6g} s before"
        more = f", and {bad.size - 1} more" if bad.size > 1 else ""
        raise ArgumentError(
            name, "instants that increase", f"{sample_text(i, lines)} {how} the sample before it{more}"
        )
    return seconds, first


def instants_of(name: str, t: ArrayLike, order: int = 0, lines: NDArray[Any] | None = None) -> Float64Array:
    """Return instants as an array of seconds.

    datetime64, timedelta64 and integer nanoseconds since 1970 are counted from the first, and subtracted before they
    are rounded. Integers below 1e11 are seconds.

    Args:
        name: of the argument, for messages.
        t: instants; shape (N,).
        order: of the finite differences that the instants are for; there must be more instants than that.
        lines: lines of a file in which the instants stand; shape (N,).

    Raises:
        ShapeError, DtypeError, ArgumentError: not one axis of increasing instants; names the first that is wrong.

    >>> instants_of("t", np.array(["2026-01-01T00:00", "2026-01-01T00:01"], dtype="datetime64[m]"))
    array([ 0., 60.])
    """
    stamps = _stamps(name, t)
    clock = stamps.dtype.kind in "mM"
    if not clock:
        stamps = real_array(name, t)
        sizes = np.abs(stamps.astype(np.float64))
        clock = bool(stamps.dtype.kind in "iu" and stamps.size and sizes.min() >= _NANOSECONDS)
        if stamps.dtype.kind in "iu" and not clock and sizes.max(initial=0.0) >= _MILLISECONDS:
            got = f"{stamps.dtype.name} from {stamps.flat[0]}"
            raise ArgumentError(name, "seconds, such as (t - t[0]) * 1e-3 of milliseconds", got)
    if stamps.ndim != 1 or stamps.size < order + 1:
        fewest = f" with at least {order + 1} samples" if order else ""
        raise ShapeError(name, f"shape (N,){fewest}", f"shape {stamps.shape}")
    seconds = stamps if clock else stamps.astype(np.float64)
    since_first, _ = increasing_seconds(name, seconds, lines)
    return since_first if clock else seconds


def jitter_suspicions(name: str, seconds: Float64Array) -> list[str]:
    """Return a sentence, in a list, if the steps between instants [s] are irregular: derivatives are inaccurate."""
    steps = np.diff(seconds)
    if steps.size < 8:
        return []
    low, middle, high = np.percentile(steps, (10, 50, 90))
    if high - low <= _MAX_STEP_SPREAD * middle:
        return []
    message = f"{name}: stamps jitter: steps from {1e3 * low:.3g} to {1e3 * high:.3g} ms about {1e3 * middle:.3g}"
    return [f"{message} ms (10 to 90 %); rates are as good as the stamps"]


def rows_after_gaps(t: Float64Array) -> NDArray[np.intp]:
    """Return the indices of the samples that follow a gap: a step of more than five usual ones.

    >>> rows_after_gaps(np.array([0, 1, 2, 3, 13, 14]))
    array([4])
    """
    steps = np.diff(t)
    return np.flatnonzero(steps > 5 * np.median(steps)) + 1 if steps.size else np.arange(0)


def break_at_gaps(t: Float64Array, values: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return instants and values of a curve, with NaN in each gap wide enough to be seen: no line crosses it."""
    rows = rows_after_gaps(t)
    rows = rows[t[rows] - t[rows - 1] > np.ptp(t) / 200] if rows.size else rows  # thinned curves have smaller steps
    return np.insert(t, rows, (t[rows - 1] + t[rows]) / 2), np.insert(values, rows, np.nan, axis=0)


def gap_sentences(name: str, t: Float64Array) -> list[str]:
    """Return a sentence, in a list, if samples are missing between the instants t [s].

    >>> gap_sentences("t", np.array([0, 1, 2, 3, 13, 14]))
    ['t has no samples from 3 to 13 s']
    """
    rows = rows_after_gaps(t)
    if not rows.size:
        return []
    lengths = t[rows] - t[rows - 1]
    first = f"{name} has no samples from {t[rows[0] - 1]:.6g} to {t[rows[0]]:.6g} s"
    if rows.size == 1:
        return [first]
    more = f"{rows.size - 1} more gap{'s' * (rows.size > 2)}"
    return [f"{first}, nor in {more} of up to {lengths[1:].max():.3g} s"]


def checked_gaps(gaps: object) -> float:
    """Return the argument `gaps`, the longest time that is no gap [s]; refuse all but positive numbers."""
    longest = finite_number("gaps", gaps)
    if longest <= 0:
        raise ArgumentError("gaps", "a positive time [s]", gaps)
    return longest


def split_at_gaps(
    t: Float64Array, is_known: NDArray[np.bool_], gaps: float, min_samples: int = 1
) -> list[NDArray[np.intp]]:
    """Return the indices of known samples, cut where neighbours are more than `gaps` [s] and more than 1.5 median
    time steps apart; pieces of fewer than `min_samples` are left out.
    """
    there = np.flatnonzero(is_known)
    if not there.size:
        return []
    usual = float(np.median(np.diff(t))) if t.size > 1 else 0.0
    cuts = np.flatnonzero(np.diff(t[there]) > max(gaps, 1.5 * usual)) + 1
    return [piece for piece in np.split(there, cuts) if piece.size >= min_samples]
