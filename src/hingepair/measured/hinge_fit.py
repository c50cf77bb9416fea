"""The hinge of two recorded motions: `hingepair.fit` and what it returns."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, FitError, MissingDependencyError
from hingepair.measured.circle import CircleFit, circle_misfit, fit_circle
from hingepair.measured.clock import ClockedPoses, negative_log_likelihood_per_sample
from hingepair.measured.encoder import EncoderFit, encoder_findings, fuse
from hingepair.measured.findings import (
    BodyPoses,
    check_turning,
    find_outliers,
    judge_hinge,
    probable_mistakes,
    split_findings,
    verdict,
)
from hingepair.measured.hinge import (
    GAUGES,
    RULES_OF_SIGN,
    Hinge,
    home_angle,
    home_of,
    result_derivatives,
)
from hingepair.measured.likelihood import (
    PARAMETERS,
    SHIFT_SAMPLES,
    EncoderLine,
    Estimate,
    HingeResiduals,
    Noise,
    bias_of_hinge,
    evaluate_hinge,
    fit_encoder_line,
    frame_turn_angle,
    most_likely_hinge,
    noise_standard_deviations,
    shows_offset,
)
from hingepair.measured.relative_poses import RelativePoses, closed_form_hinge, robust_closed_form_hinge
from hingepair.measured.robust import LOSSES, Loss
from hingepair.measured.samples import Samples, checked_samples
from hingepair.measured.spline import MIN_PIECE
from hingepair.numeric.arrays import Float64Array, check_choice, read_only
from hingepair.numeric.suspicions import suspicions
from hingepair.numeric.tables import Sheet, Shown, cell_text, unit_of
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import rotation_vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hingepair.pair.residuals import Residuals


_RESIDUAL_TOLERANCE_TO_RMS_RESIDUAL = 5.0  # limit of each residual in `HingeFit.residuals`, in multiples of its rms
_INLIER = 0.1  # below, a robust loss has made the sample an outlier
# Samples for the start in closed form, and for the check that the motion determines the clock offset.
_SOME = 65536
_MENTIONED = 4.0  # of a clock offset that a finding mentions
# [rad], step of central differences of the encoder's zero.
_STEP = 1e-5
_MIN_SAMPLES_FOR_RELIABLE_STD = 10  # below, standard deviations are no more than a hint


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HingeFit(Shown):
    """The result of `fit`: the hinge found from two recorded motions, the hinge angle and the residuals of every
    sample, standard deviations, the clock offset, whether the hinge is reliable (`ok`), and findings.

    `fit` does not use a sample if a pose is missing, if the given weight of the sample is 0, or if the clock offset
    is not 0 and no sample of body 2 is near enough in time. Below, "body 2 is a point" means that the S of body 2 was
    not given to `fit`.

    Attributes:
        pair: the hinge, a HingePair.
        psi: hinge angle [rad]; shape (N,), NaN at samples that are not used. There are no jumps of 2 pi between
            samples. The first angle that is not the angle of an outlier (see `psi_range`) is in [-pi, pi].
        psi_range: pair of the smallest and the largest psi of the samples that are not outliers [rad]. A sample is an
            outlier if its residuals are far larger than those of most samples, or if the loss reduces its weight to
            less than a tenth.
        covariance: covariance matrix of twelve numbers in this order: the components of u1 (body-1 axes) [m], of u2
            (body-2 axes) [m], of n (body-1 axes), and of the rotation vector r by which home deviates (body-1 axes)
            [rad]; shape (12, 12). `home` is the attitude of body 2 relative to body 1 at psi = 0. The actual home is
            exp(r) @ home, where exp(r) is the rotation matrix of r. The covariance matrix has rank 9, because
            conventions fix three things: the length of n, the position of the hinge point along the axis, and the
            rotation of home about the axis. If body 2 is a point, home is exactly the identity, the rows and columns
            of r are 0, and the rank is 6.
        std: dict of the standard deviations of the estimates, that is, of their uncertainties. The values for the
            keys "u1" [m], "u2" [m], "n" (no unit) and "home" [rad] have shape (3,) and are the square roots of the
            diagonal of `covariance`; "home" stands for r. The values for the keys "noise_position" [m], "noise_angle"
            [rad] and "clock_offset" [s] are numbers, the uncertainties of the attributes with these names. The first
            two of these keys are absent if body 2 is a point, and "clock_offset" is absent if `fit` was called
            without `t`.
        rms_position: root mean square of `gap`, weighted with `weights` [m].
        rms_angle: root mean square of `tilt`, weighted with `weights` [rad]; NaN if body 2 is a point.
        noise_position: standard deviation of the measurement noise in each coordinate of R2 - R1 [m]; it includes the
            noise of both bodies. It is inaccurate if it is much smaller than `noise_angle` times the length of u1 or
            u2. If `fit` was called with `noise1` and `noise2`, `noise_position` and `noise_angle` are root mean
            squares over the samples; with `weights`, they are those of a sample of mean weight.
        noise_angle: standard deviation of the measurement noise in the attitude of body 2 relative to body 1 [rad],
            for each component of the rotation vector from the exact to the recorded relative attitude. It includes
            the noise of both bodies. Without an encoder, the noise of psi has the same standard deviation. It is NaN
            if body 2 is a point.
        clock_offset: time by which body 1's clock is ahead of body 2's clock [s]: a sample of body 2 with the time
            stamp s was taken at the instant s + clock_offset of body 1's clock. It is None if `fit` was called
            without `t`. If the offset was given to `fit`, `clock_offset` is this value and its standard deviation is
            0. If the motion does not determine the offset, `clock_offset` is 0 and its standard deviation is inf.
        encoder: the EncoderFit of the encoder; None if `fit` was called without encoder readings.
        ok: whether the recorded motion agrees with a hinge and determines this hinge.
        findings: sentences that say what the motion does not determine, why the motion does not agree with a hinge,
            and what else is notable.
        gauge: name of the rule for the position of the hinge point along the axis, as given to `fit`.
        loss: name of the loss function, as given to `fit`.
        weights: weight of each sample: the given weight times the weight from the loss; shape (N,), 0 at samples that
            are not used. The given weights are 1 by default, and the weights from the loss "linear" are 1.
        t: time since the first instant [s], shape (N,); None if `fit` was called without `t`.
        gap: distance between the hinge points of both bodies, the length of the vector R1 + S1 u1 - R2 - S2 u2 [m];
            shape (N,), NaN at samples that are not used.
        tilt: angle between the hinge axes of both bodies [rad]; shape (N,), NaN at samples that are not used, and at
            all samples if body 2 is a point.
        samples: number of samples that are used.
        body2: the motion of body 2 at the instants of body 1, a BodyMotion: the argument `body2`, corrected for the
            clock offset. If the offset is not 0, R and S are NaN at samples that are not used.
    """

    pair: HingePair
    psi: Float64Array
    psi_range: tuple[float, float]
    covariance: Float64Array
    std: Mapping[str, Float64Array | np.float64]
    rms_position: float
    rms_angle: float
    noise_position: float
    noise_angle: float
    clock_offset: float | None
    encoder: EncoderFit | None
    ok: bool
    findings: tuple[str, ...]
    gauge: str
    loss: str
    weights: Float64Array
    t: Float64Array | None
    gap: Float64Array
    tilt: Float64Array
    samples: int
    body2: BodyMotion
    _body1: BodyMotion = field(repr=False)

    @property
    def residuals(self) -> Residuals:
        """Gap and tilt between the two recorded motions at every sample, compared with tolerances, as the `Residuals`
        that `pair.residuals` returns. Raise ArgumentError if the S of body 2 was not given to `fit`.

        The attribute `gap` of the Residuals is a vector, world axes [m], shape (N, 3). Its length is `HingeFit.gap`.
        The attribute `tilt_angle` is an angle [rad], shape (N,); it equals `HingeFit.tilt`. The tolerance of the gap
        is five times `rms_position`, and the tolerance of the tilt is five times `rms_angle`. If `ok` is False, the
        tolerances are the defaults, which allow for rounding errors only, so that motions that do not agree with a
        hinge do not pass.
        """
        rms_by_name = {"gap": self.rms_position, "tilt": self.rms_angle}
        limits = {name: _RESIDUAL_TOLERANCE_TO_RMS_RESIDUAL * max(rms, 1e-300) for name, rms in rms_by_name.items()}
        allowed = limits if self.ok else None
        first, second = (BodyMotion(R=body.R, S=body.S) for body in (self._body1, self.body2))
        return self.pair.residuals(first, second, allowed, self.t)

    def plot(self) -> Figure:
        """Return a Matplotlib figure with the hinge angle psi [deg], the residual `gap` [mm] and the residual `tilt`
        [deg] over time. Raise MissingDependencyError if Matplotlib is not installed.

        If `fit` was called without `t`, the horizontal axis is the index of the sample. If the S of body 2 was not
        given to `fit`, the figure has no `tilt`.

        Raises:
            MissingDependencyError: Matplotlib is not installed.
        """
        try:
            from matplotlib.figure import Figure
        except ImportError as error:
            raise MissingDependencyError("plot", "Matplotlib (pip install matplotlib)", str(error)) from None

        figure = Figure(figsize=(8, 6), layout="constrained")
        x = np.arange(self.psi.size) if self.t is None else self.t
        angles = np.degrees((self.psi, self.tilt))
        rows = [("psi [deg]", angles[0]), ("gap [mm]", 1e3 * self.gap)]
        if not np.isnan(self.rms_angle):
            rows.append(("tilt [deg]", angles[1]))
        for axes, (label, values) in zip(figure.subplots(len(rows), sharex=True), rows, strict=True):
            axes.plot(x, values, linewidth=0.8)
            axes.set_ylabel(label)
            axes.grid(alpha=0.3)
        axes.set_xlabel("sample" if self.t is None else "t [s]")
        figure.suptitle(self._residual_text())
        return figure

    def _clock_offset_line(self) -> str:
        """Return the line of `str(fit)` that states the clock offset [ms] and its standard deviation, or that the
        motion does not determine the offset.
        """
        offset, std = 1e3 * (self.clock_offset or 0.0), 1e3 * float(self.std["clock_offset"])
        if not np.isfinite(std):
            return "clock offset: not determined by this motion, taken as 0"
        size = f"{offset:.4g} +- {std:.2g} ms" if std else f"{offset:.4g} ms (given)"
        order = "later" if offset > 0 else "earlier"
        return f"clock offset: {size}" + f"; body 2 was recorded {order} than its time stamps say" * (offset != 0)

    def _residual_text(self) -> str:
        """Return the rms residuals of the position [mm] and, if known, of the angle [deg] as text."""
        if np.isnan(self.rms_angle):
            return f"left: {1e3 * self.rms_position:.3g} mm rms"
        return f"left: {1e3 * self.rms_position:.3g} mm and {np.degrees(self.rms_angle):.3g} deg rms"

    def __str__(self) -> str:
        lines = [f"hinge of {self.samples} samples ({self.psi.size - self.samples} missing), loss {self.loss}"]
        for name, unit in (("u1", "m"), ("u2", "m"), ("n", "")):
            value, std = getattr(self.pair, name), np.asarray(self.std[name])
            numbers = ", ".join(f"{v:.6g} +- {s:.2g}" for v, s in zip(value, std, strict=True))
            lines.append(f"{name} = ({numbers}) {unit}".rstrip())
        turn = np.degrees(rotation_vector(self.pair.home))
        if self.body2.S is None:
            lines.append("body 2 is a point without recorded attitude, so home is the identity")
        else:
            lines.append(f"home turns by ({', '.join(f'{angle:.5g}' for angle in turn)}) deg")
        low, high = np.degrees(self.psi_range)
        lines.append(f"psi from {low:.4g} to {high:.4g} deg; {self._residual_text()}")
        if self.clock_offset is not None:
            lines.append(self._clock_offset_line())
        if self.encoder is not None:
            zero, scale = (
                f"{getattr(self.encoder, key):.6g} +- {self.encoder.std[key]:.2g}" for key in ("zero", "scale")
            )
            lines.append(f"psi = ({zero}) rad + ({scale}) * encoder, whose noise is {self.encoder.noise:.2g} rad")
        lines.append(
            f"u1 and u2 lead to the point on the axis {self.gauge.replace('_', ' ')}; along the axis, motion "
            f"determines only their difference. {RULES_OF_SIGN}"
        )
        return "\n".join((*lines, *self.findings, "ok" if self.ok else "NOT RELIABLE"))

    def __repr__(self) -> str:
        return f"HingeFit({self.samples} samples, {self._residual_text()}, {'ok' if self.ok else 'not ok'})"

    def _sheet(self) -> Sheet:
        """Return the Sheet that notebooks show: u1, u2, n and home with standard deviations, and the findings."""
        names = ("u1", "u2", "n", "home")
        rows = [
            (name, cell_text(getattr(self.pair, name)), cell_text(self.std[name]), unit_of(name)) for name in names
        ]
        return Sheet(repr(self), (("", "value", "standard deviation", "unit"), *rows), self.findings)

    @staticmethod
    def _encoder_numbers(encoder: EncoderFit) -> dict[str, Any]:
        """Return zero, scale, noise and standard deviations of an EncoderFit as a dict for JSON."""
        numbers = {name: getattr(encoder, name) for name in ("zero", "scale", "noise")}
        return numbers | {"std": {name: float(value) for name, value in encoder.std.items()}}

    def to_json(self) -> str:
        """Return a report as JSON text, a str. It holds one JSON object with the hinge, the standard deviations, the
        rms residuals, the noise, the clock offset, the zero and scale of the encoder, the range of psi, and the
        findings. Units are m, rad and s. Numbers that are not finite become null.

        The keys u1, u2, n and home hold the attributes of `pair`. The keys ok, samples, loss, gauge, std,
        rms_position, rms_angle, noise_position, noise_angle, clock_offset, encoder and findings hold the attributes
        of the HingeFit; encoder is null, or an object with the keys zero, scale, noise and std. The key psi holds
        `psi_range`, and the key missing holds the number of samples that were not used.
        """
        import json

        report = {
            "ok": self.ok,
            "samples": self.samples,
            "missing": self.psi.size - self.samples,
            "loss": self.loss,
            "gauge": self.gauge,
            **{name: getattr(self.pair, name).tolist() for name in ("u1", "u2", "n", "home")},
            "std": {name: _finite_lists(value.tolist()) for name, value in self.std.items()},
            **{
                name: _finite_lists(getattr(self, name))
                for name in ("rms_position", "rms_angle", "noise_position", "noise_angle")
            },
            "clock_offset": self.clock_offset,
            "encoder": None if self.encoder is None else self._encoder_numbers(self.encoder),
            "psi": list(self.psi_range),
            "findings": list(self.findings),
        }
        return json.dumps(report, indent=2, allow_nan=False)


def fit(
    body1: BodyMotion,
    body2: BodyMotion,
    loss: str = "linear",
    gauge: str = "closest_to_R1",
    t: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    clock_offset: float | None = None,
    encoder: ArrayLike | None = None,
    noise1: tuple[ArrayLike, ArrayLike] | None = None,
    noise2: tuple[ArrayLike, ArrayLike] | None = None,
) -> HingeFit:
    """Fit a hinge (n, home, u1, u2) and the hinge angle psi(t) to the recorded motions `body1` and `body2`, two
    BodyMotions, and return a HingeFit. With `t`, also estimate the offset between the clocks of the two recordings,
    unless `clock_offset` gives it. With `encoder`, the readings of a hinge angle sensor, also estimate the zero and
    the scale of the sensor. `loss` names the loss function; `gauge` names the rule that selects the hinge point on
    the axis. Raise FitError if the samples do not determine a hinge.

    A first estimate is computed in closed form from the mean relative attitude and six linear equations. A
    maximum-likelihood estimate then refines it. Unless `weights`, `noise1` and `noise2` say otherwise, the noise is
    assumed to be isotropic, equal for all samples and equal for both bodies; a body whose recorded attitude is the
    same at all samples has no noise of attitude. The size of the noise is estimated from the data. If it is not known
    how the noise of the attitudes divides between the bodies, the covariance includes what this may change. Poses
    that are not finite count as missing.

    The motion determines neither the position of the hinge point along the axis, nor the sign of n, nor the zero of
    psi. Rules fix these three:

    - `gauge` selects the position of the hinge point along the axis.
    - The sign of n, and with it the sign of psi, is chosen so that one component of n is positive. This is the first
      component whose magnitude is at least 0.45 times the largest magnitude.
    - `home` is the attitude of body 2 relative to body 1 at psi = 0. Let n and n2 be the components of the hinge axis
      in body 1's and in body 2's axes, both taken as vectors of three numbers. `home` is the rotation by the smallest
      angle that turns n2 into n. If n2 and n are more than 154 degrees apart, `home` consists of two rotations: first
      a half turn about the x, y or z axis of body 2, then the rotation by the smallest angle that turns the result of
      the half turn into n. The half turn is about the x axis of body 2 if abs(nx) < 0.65, where n = (nx, ny, nz) in
      body 1's axes; otherwise about its y axis if abs(ny) < 0.65, and otherwise about its z axis.

    Args:
        body1: BodyMotion of body 1, with R and S; shape (N,), or one pose if body 1 does not move.
        body2: BodyMotion of body 2 with the same time stamps, with R and S. If it has only R, body 2 is a point
            without attitude that moves on a circle about the axis. Then `home` is the identity. At psi = 0, the
            vector from the centre of the circle to the point has the direction of a coordinate axis of body 1,
            projected onto the plane perpendicular to n. This is the x axis if abs(nx) < 0.65, otherwise the y axis
            if abs(ny) < 0.65, and otherwise the z axis.
        loss: "linear" (least squares, the default), or a loss that reduces the influence of outliers: "soft_l1",
            "huber", "cauchy" or "arctan", as SciPy's `least_squares` defines them. With one of these four, the first
            estimate is the hinge with which most samples agree, and samples whose residual exceeds thirty standard
            deviations of the noise are ignored. With "cauchy" and "arctan", outliers have the least influence. The
            loss is applied once to each sample: to its position and attitude residuals together.
        gauge: "closest_to_R1" (the default): the hinge point is the point on the axis closest to R1, and u1 is
            perpendicular to n. "closest_to_R2": the hinge point is the point on the axis closest to R2, and u2 is
            perpendicular to the axis.
        t: instants, increasing: seconds (floats), datetime64, or nanoseconds since 1970 (integers); shape (N,). If t
            is given and clock_offset is not, the offset between the clocks of the two recordings is estimated. If the
            motion does not determine the offset, 0 is used. The estimate needs SciPy.
        weights: weights of the samples, such as inverse variances in any unit; shape (N,). The variance of the noise
            of a sample is taken as inversely proportional to its weight; a factor common to all weights has no
            effect. A sample of weight 0 is left out.
        clock_offset: known time by which body 1's clock is ahead of body 2's clock [s]: a sample of body 2 with the
            time stamp s was taken at the instant s + clock_offset of body 1's clock. Give 0 if both recordings use
            the same clock; `t` must be given too. With None (the default), the offset is estimated if `t` is given;
            without `t`, the clocks are assumed to be the same.
        encoder: readings of a hinge angle sensor at the instants of body 1, in any unit; shape (N,), NaN where a
            reading is missing. Jumps by 2 pi are removed; jumps by a turn in another unit are not. The zero, the
            scale and the noise of the sensor are estimated, and psi is found from the poses and the readings.
            Readings cannot be used if body 2 is a point.
        noise1: tuple of two standard deviations for body 1: of the noise in each coordinate of the position [m], and
            of the noise in each component of the rotation vector of the attitude error [rad]. Each is a number or an
            array (N,). With `smoothed = smooth(t, body1)`, the tuple is (smoothed.noise["R"], smoothed.noise["S"]). A
            factor that is common to all these standard deviations is still estimated from the data.
        noise2: tuple of two standard deviations for body 2, as noise1. Give both noise1 and noise2 or neither; give
            neither if body 2 is a point.

    Returns:
        The HingeFit, with the hinge as `.pair` and the hinge angle as `.psi` [rad], shape (N,), NaN at samples that
        are not used. Check `.ok` and `.findings` before you use the numbers of the HingeFit.

    Raises:
        FitError: the samples do not determine a hinge: fewer than two samples have the poses of both bodies (fewer
            than four if body 2 is a point), or the bodies do not turn relative to each other.
        ArgumentError: an argument cannot be used; the error names it.
        MissingDependencyError: SciPy is not installed, although `t` is given and `clock_offset` is None or not 0.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> t = np.linspace(0, 5, 400)
    >>> body1 = hp.BodyMotion(R=np.outer(t, (1, 0, 0)), S=hp.rodrigues((0, 0, 1), np.sin(t)))
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0))
    >>> state = pair.forward_kinematics_from_body1(body1, np.cos(2 * t))
    >>> fit = hp.fit(body1, hp.BodyMotion(R=state.R2, S=state.S2))
    >>> fit.ok, fit.pair.n.round(12) + 0.0, fit.pair.u1.round(12)
    (True, array([0., 1., 0.]), array([0.5, 0. , 0.1]))
    """
    check_choice("loss", loss, LOSSES)
    check_choice("gauge", gauge, GAUGES)
    samples = checked_samples(body1, body2, t, weights, clock_offset, encoder, noise1, noise2)
    used = samples.known1 & samples.known2
    if used.sum() < 2:
        raise FitError("body1, body2", "at least two samples with both poses", f"{int(used.sum())}")
    penalty = LOSSES[loss]
    if samples.is_point:
        return _fit_of_point(samples, body1, body2, loss, gauge, clock_offset)
    estimate, clock, poses, used = _estimate_hinge(samples, used, penalty, clock_offset)
    noise = estimate.noise
    hinge, line = _without_bias(poses, estimate, gauge)
    residuals = evaluate_hinge(poses, hinge, noise, penalty, line)
    home = home_of(hinge)
    random_part = residuals
    if not samples.knows_split:
        residuals = _with_unknown_split(poses, hinge, noise, line, residuals)
    derivatives_of_results = result_derivatives(hinge, gauge)
    random_covariance, covariance = (
        derivatives_of_results @ each.covariance[:PARAMETERS, :PARAMETERS] @ derivatives_of_results.T
        for each in (random_part, residuals)
    )
    std: dict[str, Any] = dict(
        zip(("u1", "u2", "n", "home"), np.sqrt(np.diagonal(covariance)).reshape(4, 3), strict=True)
    )
    is_outlier = find_outliers(residuals, poses)
    good = ~is_outlier & (residuals.weights >= _INLIER)
    fused = fuse(poses, hinge, noise, residuals, line)
    psi = _unwrap_angles(fused.psi - home_angle(hinge, home), good)
    encoder_fit = None if line is None else _encoder_fit(line, poses, hinge, residuals, noise)
    instants = None if samples.t is None else samples.t[used]
    listed_findings = [
        *judge_hinge(poses, hinge, noise, residuals, is_outlier, estimate.has_converged, std),
        *split_findings(random_covariance, covariance, "divides between the bodies: noise1 and noise2 tell"),
        *encoder_findings(psi, residuals, poses, noise, fused.is_rejected, encoder_fit, instants),
    ]
    ok, sentences = verdict(listed_findings)
    texts = list(sentences)
    std = {name: read_only(value) for name, value in std.items()} | noise_standard_deviations(
        poses, hinge, noise, penalty
    )
    if samples.t is not None:
        std["clock_offset"] = _clock_offset_std(poses, residuals, clock_offset)
    if clock is not None and abs(estimate.offset) > _MENTIONED * std["clock_offset"] > 0:
        texts += clock.clock_offset_sentences(estimate.offset)
    if not ok:
        texts += probable_mistakes(
            BodyPoses(*(array[used] for array in (samples.R1, samples.S1, samples.R2, samples.S2)))
        )
    if not ok and penalty is None and 'loss="cauchy"' not in " ".join(texts):
        texts.append('Where some samples may be outliers, loss="cauchy" tells.')
    texts += _missing_sample_sentences(used, clock)
    if poses.samples < _MIN_SAMPLES_FOR_RELIABLE_STD:
        texts.append(f"Of {poses.samples} samples, the standard deviations are no more than a hint.")
    if samples.t is not None:
        texts += suspicions("instants", "t", samples.t)
    texts += suspicions("distance", "R2 - R1", np.sqrt((poses.p * poses.p).sum(axis=0)))
    texts += samples.noise_suspicions(noise)
    weights = residuals.weights * samples.weights[used]
    counted = psi[good] if good.any() else psi
    total = weights.sum()
    gaps = np.sqrt((residuals.gap * residuals.gap).sum(axis=0))
    return HingeFit(
        pair=HingePair(u1=hinge.u1, u2=hinge.u2, n=hinge.n, home=home),
        psi=_scatter_used(psi, used),
        psi_range=(float(counted.min()), float(counted.max())),
        covariance=read_only(covariance),
        std=std,
        rms_position=float(np.sqrt(weights @ (gaps * gaps) / total)),
        rms_angle=float(np.sqrt(weights @ (residuals.tilt * residuals.tilt) / total)),
        noise_position=float(np.sqrt(noise.place)),
        noise_angle=float(np.sqrt(noise.attitude)),
        clock_offset=None if samples.t is None else estimate.offset,
        encoder=encoder_fit,
        ok=ok,
        findings=tuple(texts),
        gauge=gauge,
        loss=loss,
        weights=_scatter_used(weights, used, 0.0),
        t=samples.t,
        gap=_scatter_used(gaps, used),
        tilt=_scatter_used(residuals.tilt, used),
        samples=int(used.sum()),
        body2=body2 if clock is None else clock.body2(estimate.offset),
        _body1=body1,
    )


def _without_bias(poses: RelativePoses, estimate: Estimate, gauge: str) -> tuple[Hinge, EncoderLine | None]:
    """Return the Hinge, with the hinge point that `gauge` names, and the EncoderLine, both without their bias."""
    line = estimate.line
    bias = bias_of_hinge(poses, estimate.hinge, estimate.noise, line)
    hinge = estimate.hinge.moved(-bias[:PARAMETERS]).balanced().signed().in_gauge(gauge)
    if line is not None:
        line = line._replace(slope=line.slope - float(bias[-1]))
    return hinge, fit_encoder_line(poses, hinge, line)


def _with_unknown_split(
    poses: RelativePoses, hinge: Hinge, noise: Noise, line: EncoderLine | None, residuals: HingeResiduals
) -> HingeResiduals:
    """Return the HingeResiduals with a covariance widened by the bias of the hinge where body 1's share of the noise
    of the attitudes can be anything from 0 to 1.
    """
    from_body1, from_body2 = (bias_of_hinge(poses, hinge, noise, line, share) for share in (1.0, 0.0))
    size = residuals.covariance.shape[0]
    spread = np.zeros(size)
    spread[np.r_[:PARAMETERS, size - 2 * (line is not None) : size]] = from_body1 - from_body2
    # the variance of a number between 0 and 1 is 1/12
    return residuals._replace(covariance=residuals.covariance + np.outer(spread, spread) / 12)


def _fit_of_point(
    samples: Samples, body1: BodyMotion, body2: BodyMotion, loss: str, gauge: str, clock_offset: float | None
) -> HingeFit:
    """Fit the hinge of body 1 and a point of body 2, recorded without attitudes, from the circle on which the point
    moves; return a HingeFit. `samples` holds the checked recordings; the other parameters are arguments of `fit`.
    Raise ArgumentError if an encoder or noise is given, and FitError if the samples show no circle.
    """
    for name, value in (("encoder", samples.encoder), ("noise1", samples.mean_noise)):
        if value is not None:
            raise ArgumentError(name, "None, since body 2 has no attitudes", "values")
    fitted, clock = _fit_circle_of_point(samples, LOSSES[loss], gauge, clock_offset)
    poses, used, moved = fitted.poses, samples.known1 & samples.known2, body2
    if clock is not None:
        used = np.zeros_like(used)
        used[clock.body1_rows(fitted.offset)] = True
        moved = BodyMotion(R=clock.body2(fitted.offset).R)
    u1, u2 = fitted.circle.levers(gauge)
    deviations = np.sqrt(np.diagonal(fitted.covariance)).reshape(4, 3)
    std: dict[str, Any] = {
        name: read_only(value) for name, value in zip(("u1", "u2", "n", "home"), deviations, strict=True)
    }
    if samples.t is not None:
        unknown = clock is None and clock_offset is None
        std["clock_offset"] = np.float64(np.inf if unknown else fitted.offset_std)
    good = ~fitted.is_outlier & (fitted.weights >= _INLIER * poses.weights)
    psi = _unwrap_angles(fitted.circle.angles(poses.p.T), good)
    counted = psi[good] if good.any() else psi
    gaps = np.linalg.norm(fitted.residuals, axis=1)
    ok, sentences = verdict(fitted.findings)
    texts = list(sentences)
    if clock is not None and abs(fitted.offset) > _MENTIONED * fitted.offset_std > 0:
        texts += clock.clock_offset_sentences(fitted.offset)
    texts += _missing_sample_sentences(used, clock)
    if samples.t is not None:
        texts += suspicions("instants", "t", samples.t)
    texts += suspicions("distance", "R2 - R1", np.linalg.norm(poses.p, axis=0))
    return HingeFit(
        pair=HingePair(u1=u1, u2=u2, n=fitted.circle.n),
        psi=_scatter_used(psi, used),
        psi_range=(float(counted.min()), float(counted.max())),
        covariance=read_only(fitted.covariance),
        std=std,
        rms_position=float(np.sqrt(fitted.weights @ (gaps * gaps) / fitted.weights.sum())),
        rms_angle=np.nan,
        noise_position=fitted.noise,
        noise_angle=np.nan,
        clock_offset=None if samples.t is None else fitted.offset,
        encoder=None,
        ok=ok,
        findings=tuple(texts),
        gauge=gauge,
        loss=loss,
        weights=_scatter_used(fitted.weights * samples.weights[used].mean(), used, 0.0),
        t=samples.t,
        gap=_scatter_used(gaps, used),
        tilt=read_only(np.full(used.size, np.nan)),
        samples=int(used.sum()),
        body2=moved,
        _body1=body1,
    )


def _fit_circle_of_point(
    samples: Samples, loss: Loss | None, gauge: str, clock_offset: float | None
) -> tuple[CircleFit, ClockedPoses | None]:
    """Fit a circle to a point of body 2; return a tuple of the CircleFit and the ClockedPoses used. The ClockedPoses
    are None if `clock_offset`, the offset that the user gave, is 0, or if it is None and the offset cannot be
    determined. `loss` is a function or None for least squares; `gauge` names the hinge point on the axis. Raise
    FitError if the samples show no circle, ArgumentError for an unusable clock offset.
    """
    exact, clock = samples.knows_split, _clocked_poses(samples, loss, clock_offset)
    if clock is not None and clock_offset is not None:
        there = _poses_at_known_offset(clock, clock_offset)
        return fit_circle(there, loss, gauge, is_body1_exact=exact)._replace(offset=clock_offset), clock
    poses = samples.poses(samples.known1 & samples.known2)
    if clock is not None and poses.samples >= MIN_PIECE:
        near = clock.most_likely_offset(circle_misfit)
        fitted = fit_circle(poses, loss, gauge, clock.poses_at, near, is_body1_exact=exact)
        if fitted.shows_offset(clock.noise_poses_at(fitted.offset)):
            return fitted, clock
    return fit_circle(poses, loss, gauge, is_body1_exact=exact), None


def _clocked_poses(samples: Samples, loss: Loss | None, clock_offset: float | None) -> ClockedPoses | None:
    """Return the ClockedPoses of the samples, smoothed with `loss` (a function; None means least squares). Return
    None if the samples have no instants, if `clock_offset` (the offset that the user gave) is 0, or if body 2 has too
    few samples in a row to be smoothed. In the last case raise ArgumentError if an offset is given.
    """
    if samples.t is None or clock_offset == 0:
        return None
    if ClockedPoses.has_enough_samples(samples.t, samples.known2):
        return ClockedPoses(samples, loss)
    if clock_offset is not None:
        samples_text = f"at least {MIN_PIECE} samples without a gap"
        expected = f"0, or a body 2 with {samples_text}, to be moved in time"
        raise ArgumentError("clock_offset", expected, clock_offset)
    return None


def _poses_at_known_offset(clock: ClockedPoses, clock_offset: float) -> RelativePoses:
    """Return the RelativePoses at `clock_offset`, the offset that the user gave, without derivatives with respect to
    the offset, since it is not estimated. `clock` are ClockedPoses. Raise ArgumentError if fewer than two samples
    overlap.
    """
    there = clock.poses_at(clock_offset)._replace(offset_derivatives=None)
    if there.samples < 2:
        raise ArgumentError("clock_offset", "a time by which both recordings still overlap [s]", clock_offset)
    return there


def _missing_sample_sentences(is_used: NDArray[np.bool_], clock: ClockedPoses | None) -> list[str]:
    """Return a list with one sentence that counts the samples that are false in the boolean array `is_used`. The list
    is empty if all were used. If `clock` is not None, the sentence also names missing samples of body 2 as a possible
    reason.
    """
    if is_used.all():
        return []
    ends = "" if clock is None else ", or have no sample of body 2 at the same time"
    return [f"{int((~is_used).sum())} of {is_used.size} samples are missing or have no weight{ends}."]


def _estimate_hinge(
    samples: Samples, is_used: NDArray[np.bool_], loss: Loss | None, clock_offset: float | None
) -> tuple[Estimate, ClockedPoses | None, RelativePoses, NDArray[np.bool_]]:
    """Return a tuple of the most likely hinge (an Estimate), the ClockedPoses or None, the relative poses at the
    estimated clock offset, and a boolean array of the samples used. `clock_offset` is the offset that the user gave,
    or None to estimate it; `loss` is a function, or None for least squares. Raise FitError if the bodies do not
    rotate relative to each other, ArgumentError for an unusable clock offset.

    The ClockedPoses are None if the clock offset is 0. An offset that the motion does not determine is taken as 0.
    """
    poses = samples.poses(is_used)
    check_turning(poses)
    estimate, clock = _most_likely_estimate(samples, poses, loss, clock_offset)
    if clock is not None:
        poses, is_used = clock.poses_at(estimate.offset), np.zeros_like(is_used)
        is_used[clock.body1_rows(estimate.offset)] = True
        if clock_offset is not None:
            poses = poses._replace(offset_derivatives=None)
    return estimate, clock, poses, is_used


def _most_likely_estimate(
    samples: Samples, poses: RelativePoses, loss: Loss | None, clock_offset: float | None
) -> tuple[Estimate, ClockedPoses | None]:
    """Return a pair: the most likely hinge as an Estimate, and the ClockedPoses of the samples. The ClockedPoses are
    None, and the offset is 0, if `clock_offset` (the offset that the user gave) is 0, or if it is None and the motion
    does not determine the offset. `poses` are the relative poses at offset 0; `loss` is a function, or None for least
    squares. Raise ArgumentError for an unusable clock offset.
    """
    start = None if loss is None else robust_closed_form_hinge(poses)
    clock = _clocked_poses(samples, loss, clock_offset)
    if clock is not None and clock_offset is not None:
        there = _poses_at_known_offset(clock, clock_offset)
        estimate = most_likely_hinge(
            there,
            start or closed_form_hinge(there.thinned(_SOME)),
            loss,
        )
        return estimate._replace(offset=clock_offset), clock
    if clock is not None:
        near = clock.most_likely_offset(functools.partial(negative_log_likelihood_per_sample, known_hinge=start))
        first = start or closed_form_hinge(clock.poses_at(near, _SOME))
        estimate = most_likely_hinge(poses, first, loss, clock.poses_at, near)
        real, noisy = (at(estimate.offset, _SOME) for at in (clock.poses_at, clock.noise_poses_at))
        if estimate.has_converged and shows_offset(real, noisy, estimate, loss):
            return estimate, clock
    return most_likely_hinge(poses, start or closed_form_hinge(poses.thinned(_SOME)), loss), None


def _clock_offset_std(poses: RelativePoses, residuals: HingeResiduals, clock_offset: float | None) -> np.float64:
    """Return the standard deviation of the clock offset [s], from the covariance in the HingeResiduals `residuals` if
    the poses have derivatives with respect to the offset. Otherwise return 0 if `clock_offset`, the offset that the
    user gave, is not None, and inf if it is None.
    """
    if poses.offset_derivatives is None:
        return np.float64(np.inf if clock_offset is None else 0.0)
    return np.float64(np.sqrt(residuals.covariance[PARAMETERS, PARAMETERS]))


def _encoder_fit(
    encoder_line: EncoderLine, poses: RelativePoses, hinge: Hinge, residuals: HingeResiduals, noise: Noise
) -> EncoderFit:
    """Return an EncoderFit with the zero, the scale and the noise of the encoder and with standard deviations, from
    the fitted EncoderLine `encoder_line`, the relative poses, the covariance in the HingeResiduals `residuals`, and
    the Noise `noise`. The zero is counted from psi = 0 of the fitted hinge.
    """
    off = encoder_line.zero - home_angle(hinge, home_of(hinge))
    off -= 2 * np.pi * np.rint(off / (2 * np.pi))
    by_hinge = _encoder_zero_derivatives(poses, hinge)
    indices = np.r_[: by_hinge.size, -2]  # turns of both axes, and the zero
    change = np.append(by_hinge, 1.0)
    variance = change @ residuals.covariance[np.ix_(indices, indices)] @ change
    return EncoderFit(
        zero=float(off),
        scale=encoder_line.slope,
        noise=float(np.sqrt(noise.encoder)),
        std={
            "zero": np.float64(np.sqrt(max(variance, 0.0))),
            "scale": np.sqrt(max(residuals.covariance[-1, -1], np.float64(0.0))),
        },
    )


def _encoder_zero_derivatives(poses: RelativePoses, hinge: Hinge) -> Float64Array:
    """Return the derivatives of the encoder's zero with respect to two rotations of n and two of m, (4,), by central
    differences at a Hinge and its relative poses. The zero depends on the axes n and m because they determine where
    psi = 0 is.
    """
    some = poses.thinned(SHIFT_SAMPLES)
    changes = []
    for step in _STEP * np.eye(PARAMETERS)[:4]:
        ends = []
        for moved in (hinge.moved(step), hinge.moved(-step)):
            turn = home_angle(moved, home_of(moved)) - home_angle(hinge, home_of(hinge))
            turn -= 2 * np.pi * np.rint(turn / (2 * np.pi))
            ends.append(frame_turn_angle(some, hinge, moved) - turn)
        changes.append((ends[0] - ends[1]) / (2 * _STEP))
    return np.array(changes)


def _finite_lists(value: Any) -> Any:
    """Return `value`, a number or nested lists of numbers, for JSON. Numbers that are not finite are replaced by
    None.
    """
    if isinstance(value, list):
        return [_finite_lists(one) for one in value]
    return value if np.isfinite(value) else None


def _scatter_used(values: Float64Array, is_used: NDArray[np.bool_], fill_value: float = np.nan) -> Float64Array:
    """Return a read-only array over all samples that has `values` at the used samples and `fill_value` at the
    others. `is_used` marks the used samples.
    """
    all_samples = np.full(is_used.shape, fill_value)
    all_samples[is_used] = values
    return read_only(all_samples)


def _unwrap_angles(psi: Float64Array, is_good: NDArray[np.bool_]) -> Float64Array:
    """Return angles [rad] without jumps by 2 pi between successive good samples, which the boolean array `is_good`
    marks. The first good angle is in [-pi, pi]. Each angle that is not good differs by at most pi from the last good
    angle before it.
    """
    unwrapped = np.unwrap(psi[is_good])
    unwrapped = unwrapped - 2 * np.pi * np.rint(unwrapped[:1] / (2 * np.pi))
    if is_good.all():
        return unwrapped
    before = unwrapped[np.maximum(np.cumsum(is_good) - 1, 0)] if unwrapped.size else np.zeros_like(psi)
    return psi - 2 * np.pi * np.rint((psi - before) / (2 * np.pi))
