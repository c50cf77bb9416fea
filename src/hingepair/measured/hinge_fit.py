"""The hinge of two recorded motions: `hingepair.fit` and what it returns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, FitError
from hingepair.measured.clock import ClockedPoses
from hingepair.measured.findings import Finding, exceeded, is_reliable, notes
from hingepair.measured.hinge import GAUGES
from hingepair.measured.hinge_findings import Fitted, check_turning, judged, probable_mistakes
from hingepair.measured.hinge_model import BodyModel, Noise, PointModel
from hingepair.measured.hinge_report import HingeReport
from hingepair.measured.most_likely import Estimate, most_likely, shows_offset
from hingepair.measured.relative_poses import RelativePoses
from hingepair.measured.samples import Samples, checked_samples
from hingepair.measured.smoothing.spline import MIN_PIECE
from hingepair.measured.statistics import LOSSES, Loss, over_all
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.numeric.arrays import Float64Array, check_choice, read_only
from hingepair.tables.instants import gap_sentences
from hingepair.tables.suspicions import suspicions

_INLIER = 0.1  # weight below which a robust loss has made the sample an outlier
_OF_LATE_BODIES = ("play", "tilt", "memory", "outliers")  # findings that a clock offset may explain
_START_SAMPLES = 65536  # for the start in closed form and the check that motion shows the clock offset, at most


@dataclass(frozen=True, slots=True, eq=False, repr=False, kw_only=True)
class HingeFit(HingeReport):
    """The result of `fit`: the hinge found from two recorded motions.

    A sample is not used if a pose is missing, if its given weight is 0, or if the clock offset is not 0 and no sample
    of body 2 is near enough in time. "A point" below is a body 2 whose S was not given.

    Attributes:
        pair: the hinge, a HingePair.
        psi: hinge angle [rad]; shape (N,), NaN at samples that are not used. There are no jumps of 2 pi between
            samples. The first angle that is not that of an outlier is in [-pi, pi].
        psi_range: smallest and largest psi of the samples that are not outliers [rad]: whose residuals are not far
            larger than those of most samples, and whose weight the loss does not reduce to less than a tenth.
        covariance: covariance matrix of u1 (body-1 axes) [m], u2 (body-2 axes) [m], n (body-1 axes), and the rotation
            vector r by which home deviates (body-1 axes) [rad]: the actual home is exp(r) @ home; shape (12, 12). Its
            rank is 9, since conventions fix the length of n, the hinge point along the axis, and the rotation of home
            about the axis. Of a point, home is exactly the identity, and the rank is 6.
        std: standard deviations of the estimates: "u1" [m], "u2" [m], "n" and "home" [rad], of shape (3,), are the
            roots of the diagonal of `covariance`. "psi" [rad], of shape (N,), is that of each angle: of the noise of
            its own sample, and of the hinge; inf of outliers, and in the plane; NaN at samples that are not used.
            "clock_offset" [s] and "clock_drift" are absent without `t`.
        rms_position: root mean square of `gap`, weighted with `weights` [m].
        rms_angle: root mean square of `tilt`, weighted with `weights` [rad]; NaN of a point.
        noise_position: standard deviation of the noise in each coordinate of R2 - R1, that of both bodies [m]. It is
            inaccurate if it is much smaller than `noise_angle` times the length of u1 or u2. With `weights`, this and
            `noise_angle` are those of a sample of mean weight.
        noise_angle: standard deviation of the noise in each component of the rotation vector from the exact to the
            recorded relative attitude, that of both bodies [rad]; NaN of a point.
        clock_offset: time by which body 1's clock is ahead of body 2's clock in the middle of the recording [s]: a
            sample of body 2 with the time stamp s was taken at the instant s + clock_offset of body 1's clock. It is
            None without `t`, and 0 with the standard deviation inf if the motion does not determine it.
        clock_drift: seconds by which the clock offset grows in a second, likewise; 0 of a given clock offset.
        findings: sentences on what the motion does not determine, why it does not agree with a hinge, and what else
            is notable. Each has `name`, `value`, `limit`, and `severity`: "serious" or "note".
        gauge: name of the rule for the position of the hinge point along the axis.
        loss: name of the loss function.
        weights: weight of each sample, given (1 by default) times that of the loss; shape (N,), 0 at samples that are
            not used.
        t: time since the first instant [s], shape (N,); None without `t`.
        gap: length of R1 + S1 u1 - R2 - S2 u2 [m]; shape (N,), NaN at samples that are not used.
        tilt: angle between the hinge axes of both bodies [rad]; shape (N,), NaN at samples that are not used, and of
            a point.
        samples: number of samples that are used.
        body2: the motion of body 2 at the instants of body 1, a BodyMotion, corrected for the clock offset. If the
            offset is not 0, R and S are NaN at samples that are not used.
    """

    rms_position: float
    rms_angle: float
    noise_position: float
    noise_angle: float
    loss: str
    weights: Float64Array
    gap: Float64Array
    tilt: Float64Array
    body2: BodyMotion

    _left: ClassVar = {"rms_position": "m", "rms_angle": "rad"}
    _reported: ClassVar = ("loss", "gauge", "noise_position", "noise_angle")
    _over_instants: ClassVar = {"gap": "gap", "tilt": "tilt", "weight": "weights"}

    @property
    def _title(self) -> str:
        return f"hinge of two bodies, loss {self.loss}"


def fit(
    body1: BodyMotion,
    body2: BodyMotion,
    loss: str = "linear",
    gauge: str = "closest_to_R1",
    t: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    clock_offset: float | None = None,
    noise1: tuple[float, float] | None = None,
    noise2: tuple[float, float] | None = None,
) -> HingeFit:
    """Fit a hinge (n, home, u1, u2) and the hinge angle psi(t) to two recorded motions.

    A maximum-likelihood estimate refines a first one in closed form. Unless `weights`, `noise1` and `noise2` say
    otherwise, the noise is assumed to be isotropic, equal for all samples and equal for both bodies; a body whose
    recorded attitude is the same at all samples has no noise of attitude. The size of the noise is estimated from the
    data. If it is not known how the noise of the attitudes divides between the bodies, the covariance includes what
    this may change. Poses that are not finite count as missing.

    The motion determines neither the position of the hinge point along the axis, nor the sign of n, nor the zero of
    psi. Rules fix these three:

    - `gauge` selects the position of the hinge point along the axis.
    - The first component of n whose magnitude is at least 0.45 times the largest magnitude is positive. A pair with
      -n and the angles -psi is the same hinge.
    - `home`, the attitude of body 2 relative to body 1 at psi = 0, is the rotation by the smallest angle that turns
      n2 into n, where n and n2 are the components of the hinge axis in body 1's and in body 2's axes. If these are
      more than 154 degrees apart, a half turn of body 2 comes first, about its x axis if abs(nx) < 0.65, otherwise
      about its y axis if abs(ny) < 0.65, and otherwise about its z axis.

    Args:
        body1: BodyMotion of body 1, with R and S; shape (N,), or one pose if body 1 does not move.
        body2: BodyMotion of body 2 with the same time stamps, with R and S. If it has only R, body 2 is a point
            without attitude that moves on a circle about the axis. Then `home` is the identity, and at psi = 0 the
            vector from the centre of the circle to the point has the direction of a coordinate axis of body 1,
            projected onto the plane across n: of the x axis if abs(nx) < 0.65, otherwise of the y axis if
            abs(ny) < 0.65, and otherwise of the z axis.
        loss: "linear" (least squares, the default), or a loss that reduces the influence of outliers: "soft_l1",
            "huber", "cauchy" or "arctan", as SciPy's `least_squares` defines them, of the residuals of a sample
            together. With one of these four, the first estimate is the hinge with which most samples agree, and
            samples whose residual exceeds thirty standard deviations of the noise are ignored. With "cauchy" and
            "arctan", outliers have the least influence.
        gauge: "closest_to_R1" (the default) or "closest_to_R2": the hinge point is the point on the axis closest to
            R1 or R2, so that u1 or u2 is across the axis.
        t: instants, increasing: seconds (floats), datetime64, or nanoseconds since 1970 (integers); shape (N,). With
            them, the offset between the clocks of the two recordings is estimated, unless clock_offset is given. If
            the motion does not determine the offset, 0 is used.
        weights: weights of the samples, such as inverse variances in any unit; shape (N,). A common factor has no
            effect. A sample of weight 0 is left out.
        clock_offset: 0 if both recordings use the same clock, as is assumed without `t`; None to estimate the offset.
            Of another known offset, shift the instants of body 2, and `resample` it to those of body 1.
        noise1: standard deviations of the noise of body 1, in each coordinate of the position [m] and in each
            component of the rotation vector of the attitude error [rad]: two numbers, such as (smoothed.noise["R"],
            smoothed.noise["S"]) with `smoothed = smooth(t, body1)`. Only the ratio of the attitudes' noise counts;
            its size is estimated from the data.
        noise2: those of body 2. Give both noise1 and noise2 or neither; give neither if body 2 is a point.

    Returns:
        The HingeFit. Check `.ok` and `.findings` before you use its numbers.

    Raises:
        FitError: fewer than two samples have the poses of both bodies (fewer than four if body 2 is a point), or the
            bodies do not turn relative to each other.
        ArgumentError: an argument cannot be used.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> t = np.linspace(0, 5, 400)
    >>> body1 = hp.BodyMotion(R=np.outer(t, (1, 0, 0)), S=hp.rodrigues((0, 0, 1), np.sin(t)))
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0))
    >>> state = pair.forward_kinematics_from_body1(body1, np.cos(2 * t))
    >>> fit = hp.fit(body1, hp.BodyMotion(R=state.R2, S=state.S2))
    >>> fit.ok, fit.pair.n.round(12) + 0.0, fit.pair.u1.round(12) + 0.0
    (True, array([0., 1., 0.]), array([0.5, 0. , 0.1]))
    """
    check_choice("loss", loss, LOSSES)
    check_choice("gauge", gauge, GAUGES)
    samples = checked_samples(body1, body2, t, weights, clock_offset, noise1, noise2)
    used = samples.known1 & samples.known2
    if used.sum() < 2:
        raise FitError("body1, body2", "at least two samples with both poses", f"{int(used.sum())}")
    poses = samples.poses(used)
    if not samples.is_point:
        check_turning(poses)
    kind: type[PointModel | BodyModel] = PointModel if samples.is_point else BodyModel
    start = kind.start(poses.thinned(_START_SAMPLES), LOSSES[loss])
    own_clock = None if clock_offset is not None else _at_own_clock(samples, poses.samples, start, LOSSES[loss])
    if own_clock is None:
        clocked, at_one_clock = None, poses
        estimate, poses = most_likely(start, lambda _, most: at_one_clock.thinned(most), np.zeros(2), LOSSES[loss])
    else:
        clocked, estimate, poses = own_clock
    moved = body2 if clocked is None else clocked.body2(estimate.clock)
    used = used if clocked is None else np.isfinite(moved.R).all(axis=1)
    fitted = Fitted(estimate, poses, LOSSES[loss], gauge, samples.share is not None)
    findings = judged(fitted)
    good = ~fitted.is_outlier() & (fitted.seen.weights >= _INLIER)
    psi = _unwrap_angles(fitted.psi, good)
    instants = np.flatnonzero(used) if samples.t is None else samples.t[used]
    findings += _recording_findings(samples, used, clocked, fitted, findings, loss)
    findings += _turn_findings(psi, instants, good)
    is_planar = any(finding.name == "plane" for finding in findings)
    deviations = map(read_only, np.sqrt(np.diagonal(fitted.covariance)).reshape(4, 3))
    std: dict[str, Any] = dict(zip(("u1", "u2", "n", "home"), deviations, strict=True))
    std["psi"] = over_all(np.where(good & (not is_planar), fitted.psi_std, np.inf), used, used.size)
    if samples.t is not None:
        clock_std = fitted.clock_std if clocked is not None else np.full(2, np.inf if clock_offset is None else 0.0)
        std |= dict(zip(("clock_offset", "clock_drift"), clock_std, strict=True))
    if clocked is not None:
        findings += clocked.findings(estimate.clock, fitted.clock_std)
    elif samples.t is not None and clock_offset is None:
        text = "The motion does not determine the clock offset, which is taken as 0; clock_offset=0 says that it is."
        findings += notes("clock", [text])
    elif samples.t is not None and any(finding.name in _OF_LATE_BODIES for finding in findings):
        shifted = _at_own_clock(samples, poses.samples, start, LOSSES[loss])
        if shifted is not None and _is_much_smaller(shifted[1].model.noise, fitted.model.noise):
            late = f"{1e3 * abs(shifted[1].clock[0]):.3g} ms"
            text = f"If the clocks differ by {late}, less than half is left of the samples: leave clock_offset out."
            findings += notes("clock", [text])
    counted = psi[good] if good.any() else psi
    weights = fitted.seen.weights * samples.weights[used]
    gap, shares = np.linalg.norm(fitted.gap, axis=0), weights / weights.sum()
    return HingeFit(
        pair=fitted.pair,
        psi=over_all(psi, used, used.size),
        psi_range=(float(counted.min()), float(counted.max())),
        covariance=read_only(fitted.covariance),
        std=std,
        rms_position=float(np.sqrt(shares @ gap**2)),
        rms_angle=float(np.sqrt(shares @ fitted.tilt**2)),
        noise_position=float(np.sqrt(fitted.model.noise.place)),
        noise_angle=float(np.sqrt(fitted.model.noise.attitude)),
        clock_offset=None if samples.t is None else float(estimate.clock[0]),
        clock_drift=None if samples.t is None else float(estimate.clock[1]),
        findings=tuple(dict.fromkeys(findings)),
        gauge=gauge,
        loss=loss,
        weights=over_all(weights, used, used.size, 0.0),
        t=samples.t,
        gap=over_all(gap, used, used.size),
        tilt=over_all(fitted.tilt, used, used.size),
        samples=int(used.sum()),
        body2=BodyMotion(R=moved.R) if samples.is_point else moved,
    )


def _at_own_clock(
    samples: Samples, count: int, start: PointModel | BodyModel, loss: Loss | None
) -> tuple[ClockedPoses, Estimate, RelativePoses] | None:
    """Return what gives the poses at any clock, the most likely hinge and clock, and the poses there; None if the
    motion does not determine the clock, or no instants are known.
    """
    if samples.t is None or count < MIN_PIECE or not ClockedPoses.has_enough_samples(samples):
        return None
    try:
        clocked = ClockedPoses(samples, loss)
    except ArgumentError:  # a motion too fast for its samples does not tell the offset
        return None
    near = np.array((clocked.most_likely_offset(lambda trial: start.misfit(trial, loss)), 0.0))
    first = type(start).start(clocked.poses_at(near, _START_SAMPLES), loss)
    estimate, there = most_likely(first, clocked.poses_at, near, loss)
    if not estimate.has_converged:
        return None
    noise_poses = clocked.noise_poses_at(estimate.clock, _START_SAMPLES)
    shows = shows_offset(estimate.model, there.thinned(_START_SAMPLES), noise_poses, loss)
    return (clocked, estimate, there) if shows else None


def _is_much_smaller(noise: Noise, other: Noise) -> bool:
    """Return whether the deviation of the places or of the attitudes is less than half of the other."""
    return noise.place < 0.25 * other.place or noise.attitude < 0.25 * other.attitude


def _recording_findings(
    samples: Samples,
    used: NDArray[np.bool_],
    clocked: ClockedPoses | None,
    fitted: Fitted,
    of_hinge: list[Finding],
    loss: str,
) -> list[Finding]:
    """Return findings on the recordings beside those on the hinge: mistakes, missing samples, units."""
    findings = []
    if not is_reliable(of_hinge) and not samples.is_point:
        # With a clock offset, samples are used of which body 2 was not recorded at the same time stamp.
        both = used & samples.known1 & samples.known2
        poses = {name: getattr(samples, name)[both] for name in ("R1", "S1", "R2", "S2")}
        findings += notes("mistake", probable_mistakes(poses))
        if loss == "linear" and not any(finding.name == "outliers" for finding in of_hinge):
            findings += notes("outliers", ['Where some samples may be outliers, loss="cauchy" tells.'])
    if not used.all():
        ends = "" if clocked is None else ", or have no sample of body 2 at the same time"
        text = f"{int((~used).sum())} of {used.size} samples are missing or have no weight{ends}."
        findings += notes("missing samples", [text])
    doubts = suspicions("distance", "R2 - R1", np.linalg.norm(fitted.poses.p, axis=0))
    if samples.t is not None:
        doubts += suspicions("instants", "t", samples.t)
        findings += notes("gaps", [f"{text}." for text in gap_sentences("t", samples.t)])
    findings += [Finding("unit", 1, 0, text) for text in doubts]
    return findings + samples.findings()


def _turn_findings(psi: Float64Array, instants: NDArray[Any], good: NDArray[np.bool_]) -> list[Finding]:
    """Return findings if the hinge may turn by half a turn or more between samples: whole turns are not seen."""
    both = good[1:] & good[:-1]  # neighbours of which neither is an outlier
    if both.sum() < 4:
        return []
    usual = float(np.median(np.abs(np.diff(psi))[both]))
    fast = "the hinge may turn the other way, or further"
    often = f"psi turns by {usual:.2g} rad from sample to sample: {fast}; record more samples in a second."
    most = _most_turned_in_a_gap(psi[good], instants[good])
    gap = f"During a gap, the hinge may turn by {most:.2g} rad at its usual rate: whole turns there are not seen."
    return exceeded(Finding("turns", usual, 2.5, often), Finding("turns in a gap", most, np.pi, gap))


def _most_turned_in_a_gap(psi: Float64Array, instants: NDArray[Any]) -> float:
    """Return by how much the hinge turns in the longest gap [rad] at its usual rate.

    Nine tenths of the mean rates over an eighth of the gap do not exceed it: over single samples, noise is faster.
    """
    steps = np.diff(instants).astype(np.float64)
    longest, usual = float(steps.max()), float(np.median(steps))
    if longest <= 3 * usual:
        return 0.0
    grid = np.arange(instants[0], instants[-1], max(longest / 8, usual))
    gaps_before = np.interp(grid, instants, np.append(0, np.cumsum(steps > 3 * usual)))
    turned = np.abs(np.diff(np.interp(grid, instants, psi)))[np.diff(gaps_before) == 0]
    if not turned.size:
        return 0.0
    return float(np.quantile(turned, 0.9)) * longest / float(grid[1] - grid[0])


def _unwrap_angles(psi: Float64Array, is_good: NDArray[np.bool_]) -> Float64Array:
    """Return angles without jumps by 2 pi between good samples, the first in [-pi, pi]; others are within half a turn
    of the last good one.
    """
    unwrapped = np.unwrap(psi[is_good])
    unwrapped = unwrapped - 2 * np.pi * np.rint(unwrapped[:1] / (2 * np.pi))
    if is_good.all():
        return unwrapped
    before = unwrapped[np.maximum(np.cumsum(is_good) - 1, 0)] if unwrapped.size else np.zeros_like(psi)
    return psi - 2 * np.pi * np.rint((psi - before) / (2 * np.pi))
