"""Samples for a fit, checked on entry: poses of two bodies, weights, noise that is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.measured.findings import Finding
from hingepair.measured.relative_poses import RelativePoses, compute_relative_poses, equal_noise
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_arrays
from hingepair.numeric.arrays import Float64Array, broadcast_shape, read_only, real_array
from hingepair.tables.instants import increasing_seconds

_FROZEN = 5  # repetitions of a pose from which a tracker is called frozen


class Samples(NamedTuple):
    """Checked arrays of one length N."""

    t: Float64Array | None  # instants since the first [s]; shape (N,)
    R1: NDArray[np.floating]  # shape (N, 3)
    S1: NDArray[np.floating]  # shape (N, 3, 3)
    R2: NDArray[np.floating]
    S2: NDArray[np.floating]
    known1: NDArray[np.bool_]  # where body 1 was recorded and has weight; shape (N,)
    known2: NDArray[np.bool_]
    weights: Float64Array  # as the user gave them; shape (N,)
    # variances of positions and of attitudes divided by typical ones, and body 1's share of the latter; shape (3, N)
    noise: Float64Array
    knows_split: bool  # whether body 1's share is known
    is_point: bool  # whether body 2 has no attitudes
    frozen: tuple[int, int]  # samples of either body that repeat the one before, which count as missing

    def poses(self, is_used: NDArray[np.bool_]) -> RelativePoses:
        """Return the relative poses of some of the samples at equal time stamps."""
        rows = slice(None) if is_used.all() else is_used
        R1, S1, R2, S2 = (array[rows] for array in (self.R1, self.S1, self.R2, self.S2))
        return compute_relative_poses(R1, S1, R2, S2, self.noise[:, rows])

    def findings(self) -> list[Finding]:
        """Return findings on samples that were left out."""
        text = (
            "{} samples of body {} repeat the one before while the other body moves, as of a tracker that lost it; "
        )
        text += "they are left out."
        counts = [(count, body) for body, count in enumerate(self.frozen, 1) if count]
        return [Finding("frozen", each[0], 0, text.format(*each), harmless=True) for each in counts]


def checked_samples(
    body1: BodyMotion,
    body2: BodyMotion,
    t: ArrayLike | None,
    weights: ArrayLike | None,
    clock_offset: float | None,
    noise1: tuple[ArrayLike, ArrayLike] | None,
    noise2: tuple[ArrayLike, ArrayLike] | None,
) -> Samples:
    """Check the arguments of `fit`, which have the same names; samples that are not finite count as missing."""
    for name, body in (("body1", body1), ("body2", body2)):
        if not isinstance(body, BodyMotion):
            expected = "a BodyMotion, as hingepair.read_recording(...).body1 of files, DataFrames and dicts"
            raise ArgumentError(name, expected, quoted(body) if isinstance(body, str) else type(body).__name__)
    arrays = motion_arrays("body1", body1, "R", "S") | motion_arrays("body2", body2, "R")
    is_point = body2.S is None
    arrays["S2"] = np.eye(3) if is_point else motion_arrays("body2", body2, "S")["S2"]
    try:
        shape = broadcast_shape({"body1": body1.shape, "body2": body2.shape})
    except ShapeError as error:
        expected = f"{error.expected}; hingepair.resample(t2, body2, to=t1) gives body 2 the instants of body 1"
        raise ShapeError(error.name, expected, error.got) from None
    if len(shape) != 1:
        raise ShapeError("body1, body2", "motions of shape (N,), N instants", f"shape {shape}")
    time = None if t is None else read_only(increasing_seconds("t", t)[0])
    if time is not None and time.shape != shape:
        raise ShapeError("t", f"shape {shape}, as the bodies", f"shape {time.shape}")
    if clock_offset is not None and clock_offset != 0:
        expected = "0 if both have one clock, or None; shift t2 by another offset, and hingepair.resample body 2"
        raise ArgumentError("clock_offset", expected, clock_offset)
    sample_weights = _checked_weights(weights, shape[0])
    sample_shapes = {"R": (3,), "S": (3, 3)}
    full_arrays = {name: np.broadcast_to(array, (*shape, *sample_shapes[name[0]])) for name, array in arrays.items()}
    known = {digit: np.ones(shape, dtype=bool) for digit in "12"}
    known["1"] &= sample_weights > 0
    for name, array in full_arrays.items():
        if not np.isfinite(array.sum()):  # one pass where nothing is missing
            known[name[1]] &= np.isfinite(array.reshape(shape[0], -1)).all(axis=-1)
    frozen = _frozen_samples(full_arrays)
    for digit, rows in frozen.items():
        known[digit] &= ~rows
    sample_noise = _checked_noise(noise1, noise2, shape)
    share = 0.5
    if not is_point and sample_noise is None:
        share = 0.0 if _is_constant(full_arrays["S1"]) else 1.0 if _is_constant(full_arrays["S2"]) else 0.5
    knows_split = sample_noise is not None or share != 0.5 or (is_point and _is_constant(full_arrays["S1"]))
    if sample_noise is None:
        sample_noise = equal_noise(shape[0])
        sample_noise[2] = share
    used = known["1"] & known["2"]
    if used.any():
        sample_noise[:2] /= np.where(used, sample_weights / max(sample_weights[used].mean(), 1e-300), 1.0)
    return Samples(
        t=time,
        **full_arrays,
        known1=known["1"],
        known2=known["2"],
        weights=sample_weights,
        noise=sample_noise,
        knows_split=knows_split,
        is_point=is_point,
        frozen=(int(frozen["1"].sum()), int(frozen["2"].sum())),
    )


def _frozen_samples(arrays: dict[str, NDArray[np.floating]]) -> dict[str, NDArray[np.bool_]]:
    """Return by body which samples (N,) repeat its pose exactly, `_FROZEN` times in a row and thrice as often as
    usual, while the other body moves. A slow clock or coarse numbers repeat a pose by chance, but not for so long.
    """
    repeats = {}
    for digit in "12":
        same = np.ones(len(arrays[f"R{digit}"]), dtype=bool)
        for array in (arrays[f"R{digit}"], arrays[f"S{digit}"]):
            same[1:] &= (array[1:] == array[:-1]).reshape(same.size - 1, -1).all(axis=1)
        same[:1] = False
        repeats[digit] = same
    frozen = {}
    for digit, other in ("12", "21"):
        ends = np.flatnonzero(np.diff(repeats[digit] & ~repeats[other], prepend=False, append=False))
        starts, counts = ends[::2], np.diff(ends)[::2]
        usual = max(_FROZEN, 3 * float(np.median(counts[counts > 0]))) if counts.size > 2 else _FROZEN
        frozen[digit] = np.zeros(repeats[digit].size, dtype=bool)
        if 2 * repeats[digit].sum() < repeats[digit].size:  # no body that is at rest
            for start, count in zip(starts[counts >= usual], counts[counts >= usual], strict=True):
                frozen[digit][start : start + count] = True
    return frozen


def _is_constant(S: NDArray[np.floating]) -> bool:
    """Return whether all attitudes S (N, 3, 3) are the same: a body at rest, whose pose has no noise."""
    some = S[:: max(1, S.shape[0] // 16)]
    return bool((some == S[0]).all() and (S[0] == S).all())


def _checked_weights(weights: ArrayLike | None, num_samples: int) -> Float64Array:
    """Return the weights of the samples (N,), all 1 if they are None."""
    if weights is None:
        return np.ones(num_samples)
    sample_weights = real_array("weights", weights).astype(np.float64)
    if sample_weights.shape != (num_samples,):
        raise ShapeError("weights", f"shape ({num_samples},), as the bodies", f"shape {sample_weights.shape}")
    if not (np.isfinite(sample_weights) & (sample_weights >= 0)).all():
        raise ArgumentError("weights", "finite numbers, none negative", sample_weights)
    # Half of the range of floats, in which squares of ratios stay finite
    if sample_weights.size and not 1e-150 < sample_weights.max() < 1e150:
        raise ArgumentError("weights", "numbers between 1e-150 and 1e150, the largest of them", sample_weights.max())
    return sample_weights


def _checked_noise(
    noise1: tuple[ArrayLike, ArrayLike] | None, noise2: tuple[ArrayLike, ArrayLike] | None, shape: tuple[int, ...]
) -> Float64Array | None:
    """Return the variances of position and attitude (3, N), over their means, with body 1's part of the latter; None
    if no noise is given.
    """
    if noise1 is None and noise2 is None:
        return None
    parts = []
    for name, noise in (("noise1", noise1), ("noise2", noise2)):
        expected = "two standard deviations, of positions [m] and of attitudes [rad]"
        if not isinstance(noise, (tuple, list)) or len(noise) != 2:
            raise ArgumentError(name, expected + (", as for the other body" if noise is None else ""), noise)
        for part in noise:
            deviation = real_array(name, part).astype(np.float64)
            if deviation.shape not in {(), shape}:
                raise ShapeError(name, f"numbers or shape {shape}, as the bodies", f"shape {deviation.shape}")
            if not (np.isfinite(deviation) & (deviation >= 0)).all():
                raise ArgumentError(name, "finite numbers, none negative", part)
            parts.append(np.broadcast_to(deviation**2, shape))
    place, attitude = parts[0] + parts[2], parts[1] + parts[3]
    if not ((place > 0) & (attitude > 0)).all():
        raise ArgumentError(
            "noise1, noise2", "standard deviations above 0 for at least one body in every sample", "0 for both"
        )
    return np.stack((place / place.mean(), attitude / attitude.mean(), parts[1] / attitude))
