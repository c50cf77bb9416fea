"""Samples for a fit, checked on entry: poses of two bodies, weights, noise that is known."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.measured.findings import Finding
from hingepair.measured.relative_poses import RelativePoses, compute_relative_poses
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
    share: float | None  # of body 1 in the variance of attitudes, None if it is not known
    is_point: bool  # whether body 2 has no attitudes
    frozen: tuple[int, int]  # samples of either body that repeat the one before, which count as missing

    def poses(self, is_used: NDArray[np.bool_]) -> RelativePoses:
        """Return the relative poses of some of the samples at equal time stamps."""
        rows = slice(None) if is_used.all() else is_used
        R1, S1, R2, S2 = (array[rows] for array in (self.R1, self.S1, self.R2, self.S2))
        return compute_relative_poses(R1, S1, R2, S2, self.variances[rows], 0.5 if self.share is None else self.share)

    @property
    def variances(self) -> Float64Array:
        """Variances of the noise of the samples, divided by that of a usual one; (N,)."""
        used = self.known1 & self.known2
        weights = np.where(used, self.weights, 1.0)
        return np.asarray((weights[used].mean() if used.any() else 1.0) / weights)

    def findings(self) -> list[Finding]:
        """Return findings on samples that were left out."""
        text = (
            "{} samples of body {} repeat the one before while the other body moves, as of a tracker that lost it; "
            "they are left out."
        )
        counts = [(count, body) for body, count in enumerate(self.frozen, 1) if count]
        return [Finding("frozen", each[0], 0, text.format(*each), harmless=True) for each in counts]


def checked_samples(
    body1: BodyMotion,
    body2: BodyMotion,
    t: ArrayLike | None,
    weights: ArrayLike | None,
    clock_offset: float | None,
    noise1: tuple[float, float] | None,
    noise2: tuple[float, float] | None,
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
    share: float | None = None
    if noise1 is not None or noise2 is not None:
        share = _share_of_body1(noise1, noise2, is_point)
    elif _is_constant(full_arrays["S1"]):
        share = 0.0
    elif not is_point and _is_constant(full_arrays["S2"]):
        share = 1.0
    return Samples(
        t=time,
        **full_arrays,
        known1=known["1"],
        known2=known["2"],
        weights=sample_weights,
        share=share,
        is_point=is_point,
        frozen=(int(frozen["1"].sum()), int(frozen["2"].sum())),
    )


def _frozen_samples(arrays: dict[str, NDArray[np.floating]]) -> dict[str, NDArray[np.bool_]]:
    """Return by body which samples (N,) repeat its pose exactly, `_FROZEN` times in a row and thrice as often as
    usual, while the other body moves. A slow clock or coarse numbers repeat a pose by chance, but not for so long.
    """
    from scipy.ndimage import label

    repeats = {}
    for digit in "12":
        same = np.ones(len(arrays[f"R{digit}"]), dtype=bool)
        for array in (arrays[f"R{digit}"], arrays[f"S{digit}"]):
            same[1:] &= (array[1:] == array[:-1]).all(axis=tuple(range(1, array.ndim)))
        same[:1] = False
        repeats[digit] = same
    frozen = {}
    for digit, other in ("12", "21"):
        series, count = label(repeats[digit] & ~repeats[other])
        lengths = np.bincount(series)
        usual = max(_FROZEN, 3 * float(np.median(lengths[1:]))) if count > 2 else _FROZEN
        is_at_rest = 2 * repeats[digit].sum() >= repeats[digit].size
        frozen[digit] = (series > 0) & (lengths >= usual)[series] & (not is_at_rest)
    return frozen


def _is_constant(S: NDArray[np.floating]) -> bool:
    """Return whether all attitudes S (N, 3, 3) are the same: a body at rest, whose pose has no noise."""
    some = S[:: max(1, S.shape[0] // 16)]
    return bool((some == S[:1]).all() and (S[:1] == S).all())


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


def _share_of_body1(noise1: tuple[float, float] | None, noise2: tuple[float, float] | None, is_point: bool) -> float:
    """Return the share of body 1 in the variance of attitudes by the arguments `noise1` and `noise2`."""
    if is_point:
        raise ArgumentError("noise1", "None, since body 2 has no attitudes", "values")
    deviations = []
    for name, noise in (("noise1", noise1), ("noise2", noise2)):
        pair = np.zeros(0) if noise is None else real_array(name, noise).astype(np.float64)
        if pair.shape != (2,) or not (np.isfinite(pair) & (pair >= 0)).all():
            expected = "two standard deviations, of positions [m] and of attitudes [rad], of each body"
            raise ArgumentError(name, expected, noise)
        deviations.append(pair[1])
    if not any(deviations):
        raise ArgumentError("noise1, noise2", "a standard deviation of attitudes above 0", "0 for both")
    first, second = (np.array(deviations) / max(deviations)) ** 2
    return float(first / (first + second))
