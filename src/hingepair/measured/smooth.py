"""From noisy positions, attitudes and angles to a motion with rates and accelerations.

Attitudes are smoothed on the rotation group, as Jupp and Kent (Applied Statistics 36 (1987), 34-46) do it on spheres:
the path is rolled out into a flat space along itself, without slipping or spinning, smoothed there like any other
three columns, and rolled back; a second round starts from the smooth path. A steady spin is a straight line there,
however fast, and costs nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, ShapeError
from hingepair.measured.resample import interpolated
from hingepair.measured.spline import FEWEST, Smoothed, smooth_columns
from hingepair.numeric.arrays import Float64Array, Frozen, finite_number, read_only, real_array
from hingepair.numeric.instants import (
    checked_gaps,
    increasing_seconds,
    jitter_suspicions,
    pieces,
    warn_of_measurements,
)
from hingepair.numeric.suspicions import angle_suspicions, instant_suspicions
from hingepair.numeric.tables import unit_of
from hingepair.numeric.wrapped_angles import is_wrapped, unwrap_if_wrapped
from hingepair.pair.body_motion import BodyMotion
from hingepair.rotations.angular_velocity import angular_velocity_from_samples
from hingepair.rotations.matrices import rotation_exp, rotation_vector

_ROUNDS = 2  # of smoothing attitudes; the second starts from the smooth path of the first
_ORDER = 6  # of the differences that make omega and alpha of smooth attitudes
_MAX_NOISE_SHARE = 0.5  # noise in a derivative that is not warned of, as a part of the derivative


@dataclass(frozen=True, slots=True, eq=False, init=False, repr=False)
class SmoothedMotion(BodyMotion):
    """A smooth motion of one body with its rates and accelerations, NaN in gaps: what `hingepair.smooth` returns.

    Attributes:
        noise: standard deviations by letter, of one component: R, S the noise of the samples [m, rad]; v, omega, a,
            alpha what this noise leaves in the derivatives [m/s, rad/s, m/s^2, rad/s^2], away from ends and gaps: in
            the last 1 / bandwidth seconds before one, derivatives are ten to twenty times worse.
        bandwidth: of the smoothing, of R and S [Hz]: a cosine of this frequency is halved.
    """

    noise: Mapping[str, float]
    bandwidth: Mapping[str, float]

    def __init__(
        self, arrays: Mapping[str, NDArray[Any]], noise: Mapping[str, float], bandwidth: Mapping[str, float]
    ) -> None:
        BodyMotion.__init__(self, **arrays)
        object.__setattr__(self, "noise", noise)
        object.__setattr__(self, "bandwidth", bandwidth)


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedAngle(Frozen):
    """A smooth angle with its rates, NaN in gaps: `psi, psid, psidd = smoothed` unpacks it.

    Attributes:
        psi: [rad], without jumps by 2 pi where the samples had such; shape (N,).
        psid: its time derivative [rad/s].
        psidd: its second time derivative [rad/s^2].
        noise: standard deviations: psi the noise of the samples; psid, psidd what it leaves in the derivatives away
            from ends and gaps, where they are ten to twenty times worse.
        bandwidth: of the smoothing [Hz].
    """

    psi: Float64Array
    psid: Float64Array
    psidd: Float64Array
    noise: Mapping[str, float]
    bandwidth: float

    def __iter__(self) -> Iterator[Float64Array]:
        return iter((self.psi, self.psid, self.psidd))


@overload
def smooth(t: ArrayLike, body: BodyMotion, bandwidth: float | None = None, gaps: float = 0.05) -> SmoothedMotion: ...
@overload
def smooth(t: ArrayLike, body: ArrayLike, bandwidth: float | None = None, gaps: float = 0.05) -> SmoothedAngle: ...
def smooth(
    t: ArrayLike, body: BodyMotion | ArrayLike, bandwidth: float | None = None, gaps: float = 0.05
) -> SmoothedMotion | SmoothedAngle:
    """Smooth a recorded motion, or a recorded hinge angle, and differentiate it twice.

    Smoothing splines (`hingepair.measured.spline`), of attitudes on the rotation group: the bandwidth of each is what
    the data ask for (generalised cross validation), or what is given. Nothing is delayed. What is further than `gaps`
    from the samples beside it is a gap: NaN, and never differentiated across. Shorter ones are filled.

    Args:
        t: instants, increasing, not necessarily uniform: seconds, datetime64 or integer nanoseconds since 1970; (N,).
        body: R and S at these instants (rates are not used); or angles [rad], shape (N,), which are unwrapped where
            they lie within one turn and jump by nearly 2 pi. NaN where nothing was recorded.
        bandwidth: frequency that is halved [Hz]; much lower ones pass, much higher ones do not.
        gaps: the longest time without a sample that is filled [s] (at least one and a half steps are).

    Returns:
        Of a body a BodyMotion with v, omega, a, alpha, and `.noise`, `.bandwidth`; of angles a SmoothedAngle,
        which unpacks as psi, psid, psidd and has the same two.

    Raises:
        ArgumentError: an argument cannot be used; names it. Stamps that repeat or go back are named. Wrapped degrees
            are refused.
        MissingDependencyError: SciPy is not installed.

    Warns:
        MeasurementWarning: noise is more than half of a derivative; stamps jitter; or instants are probably no
            seconds, angles no radians.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> t = np.arange(400) / 200
    >>> noise = 0.002 * np.random.default_rng(1).standard_normal(400)
    >>> psi, psid, psidd = hp.smooth(t, np.sin(3 * t) + noise)
    >>> bool(np.abs(psidd + 9 * np.sin(3 * t))[40:-40].max() < 0.2)
    True
    """
    time, _ = increasing_seconds("t", t)
    longest = checked_gaps(gaps)
    if bandwidth is not None and finite_number("bandwidth", bandwidth) <= 0:
        raise ArgumentError("bandwidth", "a positive frequency [Hz]", bandwidth)
    given = body if isinstance(body, BodyMotion) else real_array("body", body)
    if given.shape != time.shape:
        raise ShapeError("body", f"a BodyMotion or angles of shape {time.shape}, as t", f"shape {given.shape}")
    warn_of_measurements([*instant_suspicions("t", time), *jitter_suspicions("t", time)])
    if isinstance(given, BodyMotion):
        return _smooth_body(time, given, bandwidth, longest)
    angles = given.astype(np.float64)
    if is_wrapped(angles, 360.0):
        raise ArgumentError("body", "angles in radians: numpy.radians(body)", "jumps by nearly 360, as of degrees")
    if not is_wrapped(angles):
        warn_of_measurements(angle_suspicions("body", angles))
    return _smooth_angle(time, angles, bandwidth, longest)


def _smooth_body(t: Float64Array, body: BodyMotion, bandwidth: float | None, gaps: float) -> SmoothedMotion:
    R = np.broadcast_to(body.R, (t.size, 3)).astype(np.float64)
    S = np.broadcast_to(body.S, (t.size, 3, 3)).astype(np.float64)
    arrays, noise, hertz = smoothed_arrays(t, R, S, bandwidth, gaps)
    _warn_of_noise(arrays, noise)
    return SmoothedMotion(arrays, noise, hertz)


def smoothed_arrays(
    t: Float64Array, R: Float64Array, S: Float64Array, bandwidth: float | None, gaps: float
) -> tuple[dict[str, Float64Array], dict[str, float], dict[str, float]]:
    """Return R, v, a, S, omega and alpha of smoothed poses by name, their noise, and the bandwidths [Hz]."""
    where = _pieces("body.R", t, R, gaps)
    origin = R[where[0][0]]
    places = smooth_columns(t, R - origin, where, bandwidth)
    arrays = dict(zip(("R", "v", "a"), (places.values[0] + origin, *places.values[1:]), strict=True))
    noise = _named(("R", "v", "a"), places)
    where = _pieces("body.S", t, S, gaps)
    turns, attitude, hertz = _smooth_attitudes(t, S, where, gaps, bandwidth)
    return arrays | turns, noise | attitude, {"R": places.bandwidth, "S": hertz}


def _smooth_attitudes(
    t: Float64Array, S: Float64Array, where: Sequence[NDArray[np.intp]], gaps: float, bandwidth: float | None
) -> tuple[dict[str, Float64Array], dict[str, float], float]:
    """Return smooth attitudes with omega and alpha, their noise, and the bandwidth [Hz]."""
    whole = [slice(piece[0], piece[-1] + 1) for piece in where]
    base = interpolated(t, S, t, gaps, rotations=True)
    for _ in range(_ROUNDS):
        flat, frames = _rolled_out(base, whole)
        off = rotation_vector(np.swapaxes(base, -1, -2) @ S)
        found = smooth_columns(t, flat + np.einsum("nji,nj->ni", frames, off), where, bandwidth)
        bandwidth = found.bandwidth
        base = base @ rotation_exp(np.einsum("nij,nj->ni", frames, found.values[0] - flat))
    omega, alpha = np.full((2, t.size, 3), np.nan)
    for piece in whole:
        omega[piece], alpha[piece] = angular_velocity_from_samples(t[piece], base[piece], _ORDER, with_alpha=True)
    noise = _named(("S", "omega", "alpha"), found)
    return {"S": base, "omega": omega, "alpha": alpha}, noise, found.bandwidth


def _rolled_out(S: Float64Array, whole: Sequence[slice]) -> tuple[Float64Array, Float64Array]:
    """Return a path of attitudes rolled out into flat space, and the frames carried along; (N, 3), (N, 3, 3).

    From sample to sample the path turns about one axis; a vector carried along without spinning turns back by half of
    that, in the axes of the body. Each piece begins at 0 with the identity.
    """
    flat, frames = np.full(S.shape[:-1], np.nan), np.full(S.shape, np.nan)
    for piece in whole:
        steps = np.zeros_like(flat[piece])
        steps[1:] = rotation_vector(np.swapaxes(S[piece][:-1], -1, -2) @ S[piece][1:])
        frames[piece] = _products(np.asarray(rotation_exp(-0.5 * steps), dtype=np.float64))
        flat[piece] = np.cumsum(np.einsum("nji,nj->ni", frames[piece], steps), axis=0)
    return flat, frames


def _products(turns: Float64Array) -> Float64Array:
    """Return turns[i] @ ... @ turns[0] for every i, by doubling; (N, 3, 3)."""
    product, reach = turns, 1
    while reach < turns.shape[0]:
        product = np.concatenate((product[:reach], product[reach:] @ product[:-reach]))
        reach *= 2
    return product


def _smooth_angle(t: Float64Array, psi: Float64Array, bandwidth: float | None, gaps: float) -> SmoothedAngle:
    where = _pieces("body", t, psi, gaps)
    found = smooth_columns(t, unwrap_if_wrapped(psi)[:, None], where, bandwidth)
    names = ("psi", "psid", "psidd")
    arrays = {name: read_only(array[:, 0]) for name, array in zip(names, found.values, strict=True)}
    noise = _named(names, found)
    _warn_of_noise(arrays, noise)
    return SmoothedAngle(**arrays, noise=noise, bandwidth=found.bandwidth)


def _pieces(name: str, t: Float64Array, values: Float64Array, gaps: float) -> list[NDArray[np.intp]]:
    known: NDArray[np.bool_] = np.asarray(np.isfinite(values.reshape(t.size, -1)).all(axis=-1))
    found = pieces(t, known, gaps, FEWEST)
    if not found:
        expected = f"at least {FEWEST} finite samples without a gap"
        raise ArgumentError(name, expected, f"{int(known.sum())} finite samples, none so many together")
    return found


def _named(names: tuple[str, str, str], found: Smoothed) -> dict[str, float]:
    """Return the noise of the samples, and what it leaves in both derivatives, by name."""
    return dict(zip(names, (found.noise, *found.errors[1:].tolist()), strict=True))


def _warn_of_noise(arrays: Mapping[str, NDArray[Any]], noise: Mapping[str, float]) -> None:
    """Warn where a derivative is noise for the most part."""
    drowned = []
    for letter in ("v", "omega", "psid", "a", "alpha", "psidd"):
        if letter in arrays:
            size = float(np.sqrt(np.nanmean(np.square(arrays[letter]))))
            if noise[letter] > _MAX_NOISE_SHARE * size:
                unit = unit_of(letter)
                drowned.append(f"{letter}: noise of {noise[letter]:.2g} {unit} in {size:.2g} {unit}")
    if drowned:
        message = f"{'; '.join(drowned)} (rms of a component): a lower bandwidth leaves less"
        warn_of_measurements([message], stacklevel=5)
