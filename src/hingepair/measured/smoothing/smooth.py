"""From noisy positions, attitudes and angles to a motion with rates and accelerations.

Attitudes are smoothed on the rotation group, as Jupp and Kent (Applied Statistics 36 (1987), 34-46) do it on spheres:
the path is rolled out into a flat space along itself, without slipping or spinning, smoothed there like any other
three columns, and rolled back; a second round starts from the smooth path. A steady spin is a straight line there,
however fast, and costs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations.quantities import unit_of
from hingepair.errors import ArgumentError, ShapeError
from hingepair.measured.smoothing.angular_velocity import angular_velocity_from_samples
from hingepair.measured.smoothing.resample import interpolated
from hingepair.measured.smoothing.spline import MIN_PIECE, SmoothedColumns, smooth_columns
from hingepair.measured.statistics import LOSSES, Loss
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.results import OverInstants, Record
from hingepair.numeric.arrays import Float64Array, Frozen, check_choice, finite_number, read_only, real_array
from hingepair.rotations.matrices import rotation_exp, rotation_vector
from hingepair.tables.instants import (
    checked_gaps,
    increasing_seconds,
    jitter_suspicions,
    split_at_gaps,
    warn_of_measurements,
)
from hingepair.tables.sheets import percent
from hingepair.tables.suspicions import suspicions
from hingepair.tables.wrapped_angles import is_wrapped, unwrap_if_wrapped

_QUANTITIES = {"R": ("R", "v", "a"), "S": ("S", "omega", "alpha")}  # a smoothed quantity and its derivatives


class _Smoothed(OverInstants):
    """Base of the results of `smooth`."""

    __slots__ = ()
    t: Float64Array
    std: Mapping[str, Float64Array]

    def record(self) -> Record:
        """Return the smoothed arrays with their standard deviations (`psi_std`, ...) as a result that `save`
        writes.
        """
        arrays = {name: np.asarray(getattr(self, name)) for name in self.std}
        arrays |= {f"{name}_std": std.reshape(self.t.size, -1)[:, 0] for name, std in self.std.items()}
        return Record(self.t, arrays, "smoothed motion", unit=_unit)


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class SmoothedMotion(_Smoothed, BodyMotion):
    """The result of `smooth` for a body: a BodyMotion with smooth R, v, a, S, omega and alpha, NaN at missing samples
    in a gap.

    Attributes:
        noise: standard deviations of one component by "R", "v", "a", "S", "omega" and "alpha". Those of "R" and "S"
            are the noise of the recorded samples [m, rad]; the others are the errors that this noise causes far from
            ends and gaps. Within 1 / bandwidth seconds of an end or a gap, these are ten to twenty times larger.
        std: by the same keys, the standard deviation of each component of the smoothed quantity at every sample,
            (N, 3), including the effect of ends and gaps; NaN in gaps. The three values of a sample are equal and
            hold for any axes; for "S" they are those of a small rotation vector [rad].
        bandwidth: frequencies at which smoothing halves the amplitude, by "R" and "S" [Hz].
        correlation: estimated correlation between the noise of neighbouring samples, by "R" and "S".
        t: time since the first instant [s]; shape (N,).
    """

    noise: Mapping[str, float]
    std: Mapping[str, Float64Array]
    bandwidth: Mapping[str, float]
    correlation: Mapping[str, float]
    t: Float64Array

    def __init__(
        self, t: Float64Array, arrays: Mapping[str, NDArray[Any]], parts: Mapping[str, SmoothedColumns]
    ) -> None:
        BodyMotion.__init__(self, **arrays)
        noise: dict[str, float] = {}
        std: dict[str, Float64Array] = {}
        for letter, names in _QUANTITIES.items():
            own_noise, own_std = _noise_and_std(names, parts[letter])
            noise |= own_noise
            std |= {name: np.broadcast_to(own[:, None], (t.size, 3)) for name, own in own_std.items()}
        object.__setattr__(self, "noise", noise)
        object.__setattr__(self, "std", std)
        for name in ("bandwidth", "correlation"):
            object.__setattr__(self, name, {letter: getattr(part.model, name) for letter, part in parts.items()})
        object.__setattr__(self, "t", read_only(t))


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedAngle(_Smoothed, Frozen):
    """The result of `smooth` for an angle, NaN at missing samples in a gap. `psi, psid, psidd = smoothed` unpacks the
    angle and its derivatives.

    Attributes:
        psi: the angle [rad], without the jumps by 2 pi that the samples may have; shape (N,).
        psid: time derivative of psi [rad/s]; shape (N,).
        psidd: second time derivative of psi [rad/s^2]; shape (N,).
        noise: by "psi", the standard deviation of the noise of the recorded samples [rad]; by "psid" and "psidd",
            those of the errors that this noise causes far from ends and gaps. Within 1 / bandwidth seconds of an end
            or a gap, these are ten to twenty times larger.
        std: by the same keys, the standard deviation at every sample, (N,), including the effect of ends and gaps;
            NaN in gaps.
        bandwidth: frequency at which smoothing halves the amplitude [Hz].
        correlation: estimated correlation between the noise of neighbouring samples.
        t: time since the first instant [s]; shape (N,).
    """

    psi: Float64Array
    psid: Float64Array
    psidd: Float64Array
    noise: Mapping[str, float]
    std: Mapping[str, Float64Array]
    bandwidth: float
    correlation: float
    t: Float64Array

    def __iter__(self) -> Iterator[Float64Array]:
        return iter((self.psi, self.psid, self.psidd))


def _unit(name: str) -> str:
    """Return the unit of a quantity, or of its standard deviation: of an attitude that of a rotation vector."""
    return "rad" if name == "S_std" else unit_of(name.removesuffix("_std"))


@overload
def smooth(
    t: ArrayLike, body: BodyMotion, bandwidth: float | None = None, gaps: float | None = None, loss: str = "linear"
) -> SmoothedMotion: ...
@overload
def smooth(
    t: ArrayLike, body: ArrayLike, bandwidth: float | None = None, gaps: float | None = None, loss: str = "linear"
) -> SmoothedAngle: ...
def smooth(
    t: ArrayLike,
    body: BodyMotion | ArrayLike,
    bandwidth: float | None = None,
    gaps: float | None = None,
    loss: str = "linear",
) -> SmoothedMotion | SmoothedAngle:
    """Smooth a recorded motion or angle, with first and second time derivatives, by a smoothing spline.

    Attitudes are smoothed on the rotation group. Smoothing causes no delay. The noise may be white, or the noise of
    neighbouring samples may be correlated. A time of more than `gaps` seconds without a sample is a gap: it cuts the
    series in two, each with ends of its own. Results are NaN in gaps, and where gaps leave a series of fewer than 8
    samples. Shorter times without a sample are filled.

    Args:
        t: instants, increasing, not necessarily uniform: seconds (floats), datetime64, or nanoseconds since 1970
            (integers); shape (N,).
        body: BodyMotion with R and S at these instants (its velocities and accelerations are not used); or angles
            [rad], shape (N,). Wrapped angles, which jump by nearly 2 pi, are unwrapped. Samples that were not
            recorded are NaN.
        bandwidth: frequency at which smoothing halves the amplitude [Hz]; much lower frequencies pass, much higher
            frequencies are removed. By default, generalised cross validation chooses it, for R and S separately.
        gaps: longest time without a sample that is filled [s], at least 1.5 times the median time step. By default,
            0.05 s or five median time steps, whichever is longer.
        loss: "linear" (least squares, the default), or a loss that reduces the influence of outliers: "soft_l1",
            "huber", "cauchy" or "arctan", as SciPy's `least_squares` defines them. With "cauchy" and "arctan",
            outliers have the least influence.

    Returns:
        For a BodyMotion, a SmoothedMotion, a BodyMotion with v, omega, a and alpha. For angles, a SmoothedAngle,
        which unpacks as psi, psid, psidd, each (N,). Both have standard deviations, `.std` of every sample and
        `.noise` of the recording, and the `.bandwidth`.

    Raises:
        ArgumentError: among others, instants repeat or go back, wrapped angles are in degrees, or no series has 8
            samples.

    Warns:
        MeasurementWarning: the error of a derivative, caused by noise, is more than half of the derivative's rms; the
            samples seem to have been filtered before, so that noise cannot be told from motion; some samples are
            outliers; the time steps are irregular; instants are probably not in seconds; or angles are probably not
            in radians.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> t = np.arange(400) / 200
    >>> noise = 0.002 * np.random.default_rng(1).standard_normal(400)
    >>> psi, psid, psidd = hp.smooth(t, np.sin(3 * t) + noise)
    >>> bool(np.abs(psidd + 9 * np.sin(3 * t))[40:-40].max() < 0.2)
    True
    """
    time, _ = increasing_seconds("t", t)
    longest = longest_filled(time, gaps)
    check_choice("loss", loss, LOSSES)
    if bandwidth is not None and finite_number("bandwidth", bandwidth) <= 0:
        raise ArgumentError("bandwidth", "a positive frequency [Hz]", bandwidth)
    recording = body if isinstance(body, BodyMotion) else real_array("body", body)
    if recording.shape != time.shape:
        raise ShapeError("body", f"a BodyMotion or angles of shape {time.shape}, as t", f"shape {recording.shape}")
    warn_of_measurements([*suspicions("instants", "t", time), *jitter_suspicions("t", time)])
    if isinstance(recording, BodyMotion):
        return _smooth_body(time, recording, bandwidth, longest, LOSSES[loss])
    angles = recording.astype(np.float64)
    if is_wrapped(angles, 360.0):
        raise ArgumentError("body", "angles in radians: numpy.radians(body)", "jumps by nearly 360, as of degrees")
    if not is_wrapped(angles):
        warn_of_measurements(suspicions("angle", "body", angles))
    return _smooth_angle(time, angles, bandwidth, longest, LOSSES[loss])


def longest_filled(t: Float64Array, gaps: float | None) -> float:
    """Return the longest time without a sample that `smooth` fills [s], by its argument `gaps`."""
    if gaps is not None:
        return checked_gaps(gaps)
    # Half a step more than five, for jitter and rounding. In white noise, accelerations beside such a gap are as good
    # as elsewhere, for motion of up to a twentieth of the sampling rate.
    return max(0.05, 5.5 * float(np.median(np.diff(t)))) if t.size > 1 else 0.05


def _smooth_body(
    t: Float64Array, body: BodyMotion, bandwidth: float | None, gaps: float, loss: Loss | None
) -> SmoothedMotion:
    """Smooth a body, and warn if noise, outliers or earlier filtering make the result doubtful."""
    R = np.broadcast_to(body.R, (t.size, 3)).astype(np.float64)
    if body.S is None:
        raise ArgumentError("body.S", "attitudes; places of a point alone are smoothed column by column", None)
    S = np.broadcast_to(body.S, (t.size, 3, 3)).astype(np.float64)
    arrays, parts = smoothed_arrays(t, R, S, bandwidth, gaps, loss)
    motion = SmoothedMotion(t, arrays, parts)
    recorded = {"positions": (R, parts["R"], ("v", "a")), "attitudes": (S, parts["S"], ("omega", "alpha"))}
    _warn(loss, recorded, arrays, motion.noise)
    return motion


def smoothed_arrays(
    t: Float64Array,
    R: Float64Array,
    S: Float64Array,
    bandwidth: float | None,
    gaps: float,
    loss: Loss | None,
) -> tuple[dict[str, Float64Array], dict[str, SmoothedColumns]]:
    """Return the arrays R, v, a, S, omega and alpha, and what smoothing R and S found."""
    position_pieces = _smoothable_pieces("body.R", t, R, gaps)
    origin = R[position_pieces[0][0]]
    places = smooth_columns(t, R - origin, position_pieces, bandwidth, loss)
    arrays = {"R": places.curves(0) + origin, "v": places.curves(1), "a": places.curves(2)}
    turns, attitudes = _smooth_attitudes(t, S, _smoothable_pieces("body.S", t, S, gaps), gaps, bandwidth, loss)
    return arrays | turns, {"R": places, "S": attitudes}


def _smooth_attitudes(
    t: Float64Array,
    S: Float64Array,
    pieces: Sequence[NDArray[np.intp]],
    gaps: float,
    bandwidth: float | None,
    loss: Loss | None,
) -> tuple[dict[str, Float64Array], SmoothedColumns]:
    """Return the arrays S, omega and alpha, NaN between the pieces, and what smoothing found."""
    piece_slices = [slice(piece[0], piece[-1] + 1) for piece in pieces]
    recorded = interpolated(t, S, t, gaps, rotations=True)
    # A steady spin, in axes of the body, is taken out where it is fast.
    step = float(np.median(np.diff(t)))
    spin = np.nanmedian(
        rotation_vector(np.swapaxes(recorded[:-1], -1, -2) @ recorded[1:]) / np.diff(t)[:, None], axis=0
    )
    spin = spin * float(np.linalg.norm(spin) * step > 0.3)  # rad a sample
    spun = np.asarray(rotation_exp(spin * (t - t[0])[:, None]))
    base, S = (array @ np.swapaxes(spun, -1, -2) for array in (recorded, S))
    for _ in range(2):  # the second round starts from the smooth path of the first
        flat, frames = _unrolled_attitudes(base, piece_slices)
        off = rotation_vector(np.swapaxes(base, -1, -2) @ S)
        smoothed = smooth_columns(t, flat + np.einsum("nji,nj->ni", frames, off), pieces, bandwidth, loss)
        bandwidth = smoothed.model.bandwidth
        base = base @ rotation_exp(np.einsum("nij,nj->ni", frames, smoothed.curves(0) - flat))
    omega, alpha = np.full((2, t.size, 3), np.nan)
    for piece in piece_slices:
        try:
            omega[piece], alpha[piece] = angular_velocity_from_samples(t[piece], base[piece], 6, with_alpha=True)
        except ArgumentError as error:
            expected = "attitudes whose spin changes less from sample to sample (radians, not degrees; more samples)"
            raise ArgumentError("body.S", expected, error.got) from None
    axis = base @ spin
    return {"S": base @ spun, "omega": omega + axis, "alpha": alpha + np.cross(omega, axis)}, smoothed


def _unrolled_attitudes(S: Float64Array, piece_slices: Sequence[slice]) -> tuple[Float64Array, Float64Array]:
    """Return the path of attitudes rolled out in flat space (N, 3), and the rotations (N, 3, 3) from steps there to
    steps in body axes. Each piece begins at 0 with the identity; NaN between pieces.
    """
    flat, frames = np.full(S.shape[:-1], np.nan), np.full(S.shape, np.nan)
    for piece in piece_slices:
        steps = np.zeros_like(flat[piece])
        steps[1:] = rotation_vector(np.swapaxes(S[piece][:-1], -1, -2) @ S[piece][1:])
        # A vector carried along without spinning turns back by half of each step, in the axes of the body.
        frames[piece] = _cumulative_products(np.asarray(rotation_exp(-0.5 * steps), dtype=np.float64))
        flat[piece] = np.cumsum(np.einsum("nji,nj->ni", frames[piece], steps), axis=0)
    return flat, frames


def _cumulative_products(turns: Float64Array) -> Float64Array:
    """Return turns[i] @ ... @ turns[0] for every i: in rows of about sqrt(N), all at a time, then row after row."""
    width = math.isqrt(turns.shape[0]) + 1
    rows = np.concatenate((turns, np.broadcast_to(np.eye(3), (-turns.shape[0] % width, 3, 3))))
    rows = rows.reshape(-1, width, 3, 3)
    for k in range(1, width):
        rows[:, k] = rows[:, k] @ rows[:, k - 1]
    for k in range(1, len(rows)):
        rows[k] = rows[k] @ rows[k - 1, -1]
    return rows.reshape(-1, 3, 3)[: turns.shape[0]]


def _smooth_angle(
    t: Float64Array, psi: Float64Array, bandwidth: float | None, gaps: float, loss: Loss | None
) -> SmoothedAngle:
    """Smooth an angle, and warn if noise, outliers or earlier filtering make the result doubtful."""
    pieces = _smoothable_pieces("body", t, psi, gaps)
    smoothed = smooth_columns(t, unwrap_if_wrapped(psi)[:, None], pieces, bandwidth, loss)
    names = ("psi", "psid", "psidd")
    arrays = {name: read_only(smoothed.curves(order)[:, 0]) for order, name in enumerate(names)}
    noise, std = _noise_and_std(names, smoothed)
    _warn(loss, {"angle": (psi, smoothed, names[1:])}, arrays, noise)
    model = smoothed.model
    return SmoothedAngle(
        **arrays, noise=noise, std=std, bandwidth=model.bandwidth, correlation=model.correlation, t=read_only(t)
    )


def _smoothable_pieces(name: str, t: Float64Array, values: Float64Array, gaps: float) -> list[NDArray[np.intp]]:
    """Return the samples of each piece between gaps that is long enough to be smoothed; refuse values without one."""
    is_known: NDArray[np.bool_] = np.asarray(np.isfinite(values.reshape(t.size, -1)).all(axis=-1))
    pieces_of_samples = split_at_gaps(t, is_known, gaps, MIN_PIECE)
    if not pieces_of_samples:
        expected = f"at least {MIN_PIECE} finite samples without a gap"
        raise ArgumentError(name, expected, f"{int(is_known.sum())} finite samples, none so many together")
    return pieces_of_samples


def _noise_and_std(
    names: tuple[str, str, str], smoothed: SmoothedColumns
) -> tuple[dict[str, float], dict[str, Float64Array]]:
    """Return by name the noise of the samples with the median noise of both derivatives, and the standard deviations
    at every sample (N,).
    """
    std = {name: read_only(smoothed.deviations(order)) for order, name in enumerate(names)}
    noise = {name: float(np.nanmedian(own)) for name, own in std.items()}
    return noise | {names[0]: float(np.sqrt(smoothed.variance))}, std


def _warn(
    loss: Loss | None,
    recorded: Mapping[str, tuple[Float64Array, SmoothedColumns, tuple[str, str]]],
    arrays: Mapping[str, NDArray[Any]],
    noise: Mapping[str, float],
) -> None:
    """Warn of earlier filtering, correlated noise and outliers of recorded samples, of which smoothing found this,
    and of derivatives, named last, that are mostly noise.
    """
    sentences, noisy = [], []
    for what, (samples, found, names) in recorded.items():
        if found.variance <= (1e-11 * float(np.nanmax(np.abs(samples)))) ** 2:  # rounding explains it
            continue
        sentences += [f"{what}: {sentence}" for sentence in _residual_suspicions(found, loss)]
        for name in names:
            size, unit = float(np.sqrt(np.nanmean(np.square(arrays[name])))), unit_of(name)
            if noise[name] > 0.5 * size:
                noisy.append(f"{name}: noise of {noise[name]:.2g} {unit} in {size:.2g} {unit}")
    if noisy:
        sentences.append(f"{'; '.join(noisy)} (rms of a component): a lower bandwidth leaves less")
    warn_of_measurements(sentences, stacklevel=5)


def _residual_suspicions(found: SmoothedColumns, loss: Loss | None) -> list[str]:
    """Return sentences on earlier filtering, correlated noise and outliers."""
    model, count = found.model, len(found.residuals)
    too_small = "the noise and the standard deviations that are stated are too small"
    sentences = []
    if model.is_limited:
        sentences.append(
            f"the bandwidth is the highest that the samples allow, {model.bandwidth:.3g} Hz: their noise cannot be "
            f"told from motion, as where samples were filtered before; {too_small}. Smooth the raw samples."
        )
    elif found.residual_correlation > max(0.2, 4 / np.sqrt(count)):
        sentences.append(
            f"what smoothing leaves of neighbouring samples is correlated ({found.residual_correlation:.2g}): motion "
            f"that the bandwidth of {model.bandwidth:.3g} Hz leaves out, or noise with a long memory; {too_small}."
        )
    elif model.correlation > 0.72:  # measured: below, standard deviations cover 90 to 99 %
        sentences.append(
            f"the noise of neighbouring samples is correlated ({model.correlation:.2g}), and slow noise passes for "
            f"motion; {too_small}, perhaps by a factor of two or three."
        )
    share = found.outlier_share if loss is None and not model.is_limited else 0.0
    if share > 0:
        sentences.append(
            f"{percent(share)} of the samples are outliers and pull the curve: take them out of the recording, or "
            'call hingepair.smooth with the loss "cauchy", by which they count little.'
        )
    return sentences
