"""A recording at other instants: cubics through the four samples around each, of rotations on the group."""

from __future__ import annotations

from typing import overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, ShapeError
from hingepair.measured.smoothing.angular_velocity import (
    lagrange_weights,
    needed_spin,
    turn_between,
    vector_beside_spin,
)
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.numeric.arrays import Float64Array, real_array
from hingepair.rotations.matrices import rotation_exp
from hingepair.tables.instants import (
    checked_gaps,
    elapsed_seconds,
    increasing_seconds,
    split_at_gaps,
    warn_of_measurements,
)
from hingepair.tables.suspicions import suspicions
from hingepair.tables.wrapped_angles import is_wrapped


@overload
def resample(t: ArrayLike, values: BodyMotion, to: ArrayLike, gaps: float = 0.05) -> BodyMotion: ...
@overload
def resample(t: ArrayLike, values: ArrayLike, to: ArrayLike, gaps: float = 0.05) -> Float64Array: ...
def resample(
    t: ArrayLike, values: ArrayLike | BodyMotion, to: ArrayLike, gaps: float = 0.05
) -> Float64Array | BodyMotion:
    """Interpolate a recording at other instants.

    The interpolant is the cubic polynomial through the four nearest samples of a series without a gap; its error is
    of order h^4 for a time step h. In a series of two or three samples, it is the polynomial through all of them.
    Attitudes are interpolated as rotation vectors beside a steady spin, which may be fast, if they turn by less than
    pi from sample to sample. Samples that are not finite are skipped. At the instant of a finite sample, the result
    is the sample itself.

    Args:
        t: instants of the recording, increasing: seconds (floats), datetime64, or nanoseconds since 1970 (integers);
            shape (N,).
        values: numbers with time on the first axis, shape (N, ...), interpolated one by one: angles must have no
            jumps of 2 pi (`numpy.unwrap` removes them). Or a BodyMotion of shape (N,), whose arrays are all
            resampled.
        to: the new instants, on the same clock and in the same form as t, in any order; shape (M,).
        gaps: longest time between two samples across which values are interpolated [s], at least 1.5 times the
            median time step.

    Returns:
        A float64 array of shape (M, ...), or a BodyMotion of shape (M,). It is NaN before the first sample, after the
        last sample and in gaps.

    Raises:
        ArgumentError: among others, instants repeat or go back, or values that are quaternions, with norms within
            0.01 of 1, change their sign from sample to sample.

    Warns:
        MeasurementWarning: a column jumps like a wrapped angle, or instants are probably not in seconds.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> t = np.array([0.0, 0.01, 0.02, 0.03, 0.04, 0.2, 0.21])
    >>> hp.resample(t, t**2, [0.0, 0.015, 0.1, 0.3]).round(9)
    array([0.      , 0.000225,      nan,      nan])
    """
    time, first = increasing_seconds("t", t)
    target, _ = elapsed_seconds("to", to, first)
    longest = checked_gaps(gaps)
    warn_of_measurements(suspicions("instants", "t", time))
    if isinstance(values, BodyMotion):
        if values.shape != time.shape:
            raise ShapeError("values", f"a BodyMotion of shape {time.shape}, as t", f"shape {values.shape}")
        arrays = {}
        for letter in ("R", "S", "v", "omega", "a", "alpha"):
            array = getattr(values, letter)
            if array is not None:
                sample_shape = (3, 3) if letter == "S" else (3,)
                samples = np.broadcast_to(array, (*time.shape, *sample_shape)).astype(np.float64, copy=False)
                arrays[letter] = interpolated(time, samples, target, longest, rotations=letter == "S")
        return BodyMotion(**arrays)
    samples = real_array("values", values)
    if samples.shape[:1] != time.shape:
        raise ShapeError("values", f"shape ({time.size}, ...), as t", f"shape {samples.shape}")
    columns = samples.astype(np.float64, copy=False)
    _refuse_quaternions_that_flip(columns)
    warn_of_measurements(_wrapping_suspicions(columns))
    return interpolated(time, columns, target, longest)


def _refuse_quaternions_that_flip(values: Float64Array) -> None:
    """Refuse unit quaternions (N, ..., 4) whose sign changes from sample to sample."""
    if values.ndim < 2 or values.shape[-1] != 4:
        return
    known = values[np.isfinite(values.reshape(len(values), -1)).all(axis=1)]
    are_units = known.size and np.abs(np.linalg.norm(known, axis=-1) - 1).max() < 1e-2
    if are_units and ((known[1:] * known[:-1]).sum(axis=-1) < 0).any():
        wanted = "a BodyMotion (from_quaternion_xyzw, from_quaternion_wxyz), or quaternions of one sign"
        raise ArgumentError("values", wanted, "quaternions whose sign changes from sample to sample")


def _wrapping_suspicions(values: Float64Array) -> list[str]:
    """Return a sentence if a column of `values` jumps like a wrapped angle, by 2 pi or by 360."""
    how = "as a wrapped angle does: unwrap angles first, such as numpy.unwrap(values, axis=0) of radians."
    columns = values.reshape(len(values), -1).T
    turns = (("2 pi", 2 * np.pi), ("360", 360.0))
    found = [text for text, turn in turns if any(is_wrapped(column, turn) for column in columns)]
    return [f"values jump by nearly {text}, {how}" for text in found[:1]]


def interpolated(
    t: Float64Array, values: Float64Array, new_instants: Float64Array, gaps: float, rotations: bool = False
) -> Float64Array:
    """Return columns, or rotation matrices, interpolated at new instants; NaN outside of the recording and in gaps.
    Samples that are not finite are left out.
    """
    result = np.full((new_instants.size, *values.shape[1:]), np.nan)
    is_known: NDArray[np.bool_] = np.asarray(np.isfinite(values.reshape(t.size, -1)).all(axis=-1))
    pieces_of_samples = split_at_gaps(t, is_known, gaps)
    if not pieces_of_samples:
        return result
    known_indices, sizes = np.concatenate(pieces_of_samples), np.array([len(piece) for piece in pieces_of_samples])
    stops = np.cumsum(sizes)
    starts = stops - sizes
    which = np.searchsorted(t[known_indices[starts]], new_instants, side="right") - 1
    inside = np.flatnonzero((which >= 0) & (new_instants <= t[known_indices[stops[which] - 1]]))
    which, before = which[inside], np.searchsorted(t[known_indices], new_instants[inside], side="right") - 1
    is_sample = t[known_indices[before]] == new_instants[inside]
    result[inside[is_sample]] = values[known_indices[before[is_sample]]]
    inside, which, before = (array[~is_sample] for array in (inside, which, before))
    counts = np.minimum(4, sizes[which])
    first = np.clip(before - 1, starts[which], stops[which] - counts)
    for count in np.unique(counts):
        rows, first_nodes = inside[counts == count], first[counts == count]
        near = known_indices[first_nodes[:, None] + np.arange(count)]
        nodes = t[near] - new_instants[rows, None]
        if rotations:
            result[rows] = _interpolated_rotations(nodes, values[near])
        else:
            result[rows] = np.einsum("ni,ni...->n...", lagrange_weights(nodes)[0], values[near])
    return result


def _interpolated_rotations(nodes: Float64Array, neighbours: Float64Array) -> Float64Array:
    """Return rotations at 0 between k others: polynomials through rotation vectors beside the steady spin between
    two.
    """
    if nodes.shape[1] == 1:
        return neighbours[:, 0]
    # The spin is that of the two nearest neighbours, the middle ones if all are: across a gap turns may exceed pi.
    steps = np.diff(nodes, axis=1)
    nearest = np.argmin(steps * (1 + 1e-3 * np.abs(np.arange(steps.shape[1]) - (steps.shape[1] - 1) / 2)), axis=1)
    row = np.arange(len(nodes))
    base, start = neighbours[row, nearest], nodes[row, nearest]
    turned = np.linalg.norm(turn_between(neighbours[:, :-1], neighbours[:, 1:]), axis=-1).sum(axis=-1)
    omega = needed_spin(turn_between(base, neighbours[row, nearest + 1]) / steps[row, nearest][:, None], turned)
    beside = [
        vector_beside_spin(base, S, omega, dt)
        for S, dt in zip(np.moveaxis(neighbours, 1, 0), (nodes - start[:, None]).T, strict=True)
    ]
    x = np.einsum("ni,nij->nj", lagrange_weights(nodes)[0], np.stack(beside, axis=1))
    return np.asarray(rotation_exp(x) @ rotation_exp(-omega * start[:, None]) @ base)
