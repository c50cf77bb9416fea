"""The hinge of two recorded motions: `hingepair.fit` and what it returns."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations.quantities import unit_of
from hingepair.errors import ArgumentError, FitError
from hingepair.measured.circle import CircleFit, circle_misfit, fit_circle
from hingepair.measured.clock import ClockedPoses, negative_log_likelihood_per_sample
from hingepair.measured.findings import (
    BodyPoses,
    Finding,
    check_turning,
    exceeded,
    find_outliers,
    is_reliable,
    judge_hinge,
    notes,
    probable_mistakes,
    split_findings,
)
from hingepair.measured.hinge import (
    GAUGES,
    RULE_OF_HOME,
    RULE_OF_SIGN,
    Hinge,
    home_angle,
    home_of,
    result_derivatives,
)
from hingepair.measured.likelihood import (
    PARAMETERS,
    SHIFT_SAMPLES,
    Estimate,
    HingeResiduals,
    Noise,
    bias_of_hinge,
    evaluate_hinge,
    frame_turn_angle,
    iterate_residuals,
    most_likely_hinge,
    noise_standard_deviations,
    shows_offset,
)
from hingepair.measured.relative_poses import RelativePoses, closed_form_hinge, robust_closed_form_hinge
from hingepair.measured.robust import LOSSES, Loss
from hingepair.measured.samples import Samples, checked_samples
from hingepair.measured.smoothing.spline import MIN_PIECE
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.results import OverInstants, Record
from hingepair.numeric.arrays import Float64Array, check_choice, one_constant, read_only
from hingepair.numeric.optional import new_figure
from hingepair.numeric.unit_vectors import finite_axis
from hingepair.rotations.matrices import rotation_vector
from hingepair.tables.instants import break_at_gaps, gap_sentences
from hingepair.tables.sheets import Sheet, Shown, cell_text
from hingepair.tables.suspicions import suspicions
from hingepair.tables.units import Columns, Units

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hingepair.mechanism.pairs.residuals import Residuals


_INLIER = 0.1  # weight below which a robust loss has made the sample an outlier
_START_SAMPLES = 65536  # for the start in closed form and the check that motion shows the clock offset, at most


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HingeFit(OverInstants, Shown):
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
            its own sample, and of the hinge; outliers excepted; inf in the plane. "noise_position" [m] and
            "noise_angle" [rad] are absent of a point, "clock_offset" [s] without `t`.
        rms_position: root mean square of `gap`, weighted with `weights` [m].
        rms_angle: root mean square of `tilt`, weighted with `weights` [rad]; NaN of a point.
        noise_position: standard deviation of the noise in each coordinate of R2 - R1, that of both bodies [m]. It is
            inaccurate if it is much smaller than `noise_angle` times the length of u1 or u2. With `noise1` and
            `noise2`, this and `noise_angle` are root mean squares over the samples; with `weights`, they are those of
            a sample of mean weight.
        noise_angle: standard deviation of the noise in each component of the rotation vector from the exact to the
            recorded relative attitude, that of both bodies [rad]; NaN of a point.
        clock_offset: time by which body 1's clock is ahead of body 2's clock [s]: a sample of body 2 with the time
            stamp s was taken at the instant s + clock_offset of body 1's clock. It is None without `t`, and 0 with
            the standard deviation inf if the motion does not determine it.
        findings: sentences on what the motion does not determine, why it does not agree with a hinge, and what else
            is notable. Each has `name`, `value`, `limit`, and `severity`: "serious" or "note".
        gauge: name of the rule for the position of the hinge point along the axis.
        loss: name of the loss function.
        n_along: direction that decided the sign of n, body-1 axes; None if the rule of `fit` did.
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
    findings: tuple[Finding, ...]
    gauge: str
    loss: str
    n_along: tuple[float, ...] | None
    weights: Float64Array
    t: Float64Array | None
    gap: Float64Array
    tilt: Float64Array
    samples: int
    body2: BodyMotion
    _body1: BodyMotion = field(repr=False)

    @property
    def ok(self) -> bool:
        """Whether no finding says that a number may be wrong by more than its standard deviations."""
        return is_reliable(self.findings)

    @property
    def residuals(self) -> Residuals:
        """Gap and tilt between the two recorded motions at every sample, as the `Residuals` of `pair.residuals`,
        whose attributes are vectors `gap` (N, 3), world axes [m], and angles `tilt_angle` (N,) [rad].

        The tolerances are five times `rms_position` and `rms_angle`. If `ok` is False, they are the defaults, which
        allow for rounding errors only, so that motions that do not agree with a hinge do not pass. A point has none.
        """
        rms_by_name = {"gap": self.rms_position, "tilt": self.rms_angle}
        limits = {name: 5.0 * max(rms, 1e-300) for name, rms in rms_by_name.items()}
        allowed = limits if self.ok else None
        first, second = (BodyMotion(R=body.R, S=body.S) for body in (self._body1, self.body2))
        return self.pair.residuals(first, second, allowed, self.t)

    def record(self) -> Record:
        """Return psi with its standard deviation, and what is left of each sample, as a result that `save` writes."""
        t = np.arange(float(self.psi.size)) if self.t is None else self.t
        arrays = {"psi": self.psi, "psi_std": np.asarray(self.std["psi"]), "gap": self.gap}
        arrays |= {} if self.body2.S is None else {"tilt": self.tilt}

        def unit(name: str) -> str:
            return "1" if name == "t" and self.t is None else unit_of(name)  # of places in the recording

        return Record(t, arrays | {"weight": self.weights}, "what is left of each sample", unit=unit)

    def plot(self, units: str | None = None) -> Figure:
        """Return a Matplotlib figure with psi, `gap` and `tilt` over time, or over the index of the sample. A band
        reaches from two standard deviations below psi to two above it. No line crosses a gap in time.

        Args:
            units: units in place of deg and mm, such as "rad, um".

        Raises:
            MissingDependencyError: Matplotlib is not installed.
        """
        figure, shown = new_figure(8, 6), Columns(_fine_units(units))
        names = ("psi", "gap") if np.isnan(self.rms_angle) else ("psi", "gap", "tilt")
        instants = np.arange(float(self.psi.size)) if self.t is None else shown.converted("t", self.t)
        places = figure.subplots(len(names), sharex=True)
        known = np.where(np.isfinite(self.std["psi"]), self.std["psi"], np.nan)
        band = shown.converted("psi", self.psi + np.outer((-2, 2), known))
        x, ends = break_at_gaps(instants, band.T)
        places[0].fill_between(x, *ends.T, alpha=0.3, linewidth=0)
        for axes, name in zip(places, names, strict=True):
            axes.plot(*break_at_gaps(instants, shown.converted(name, getattr(self, name))), linewidth=0.8)
            axes.set_ylabel(shown.heading(name))
            axes.grid(alpha=0.3)
        axes.set_xlabel("sample" if self.t is None else shown.heading("t"))
        figure.suptitle(self._residual_text(units))
        return figure

    @property
    def conventions(self) -> str:
        """Sentences on the sign of n and on the direction of psi = 0, which motion does not determine."""
        if self.n_along is None:
            return f"{RULE_OF_SIGN} {RULE_OF_HOME}"
        along = ", ".join(f"{component:g}" for component in self.n_along)
        return f"n points along ({along}), as asked. {RULE_OF_HOME}"

    def _clock_offset_line(self) -> str:
        """Return the line of the report on the clock offset."""
        offset, std = 1e3 * (self.clock_offset or 0.0), 1e3 * float(self.std["clock_offset"])
        if not np.isfinite(std):
            return "clock offset: not determined by this motion, taken as 0"
        size = f"{offset:.4g} +- {std:.2g} ms" if std else f"{offset:.4g} ms (given)"
        order = "later" if offset > 0 else "earlier"
        return f"clock offset: {size}" + f"; body 2 was recorded {order} than its time stamps say" * (offset != 0)

    def _residual_text(self, units: str | None = None) -> str:
        """Return what is left of the samples, gap and tilt rms, as text."""
        shown = _fine_units(units)
        gap = f"left: {shown.factor('m') * self.rms_position:.3g} {shown.unit('m')}"
        if np.isnan(self.rms_angle):
            return f"{gap} rms"
        return f"{gap} and {shown.factor('rad') * self.rms_angle:.3g} {shown.unit('rad')} rms"

    def __str__(self) -> str:
        return self.text()

    def text(self, units: str | None = None) -> str:
        """Return the report that `print` shows.

        Args:
            units: units in place of m for u1 and u2, mm for what is left, and deg for angles, such as "mm, rad".
        """
        lengths, shown = Units.of(units), _fine_units(units)
        angle, per_rad = shown.unit("rad"), shown.factor("rad")
        lines = [f"hinge of {self.samples} samples ({self.psi.size - self.samples} missing), loss {self.loss}"]
        for name, unit in (("u1", lengths.unit("m")), ("u2", lengths.unit("m")), ("n", "")):
            both = (getattr(self.pair, name), np.asarray(self.std[name]))
            value, std = (lengths.converted(own, unit_of(name)) for own in both)
            numbers = ", ".join(f"{v:.6g} +- {s:.2g}" for v, s in zip(value, std, strict=True))
            lines.append(f"{name} = ({numbers}) {unit}".rstrip())
        turn = per_rad * np.asarray(rotation_vector(self.pair.home))
        if self.body2.S is None:
            lines.append("body 2 is a point without recorded attitude, so home is the identity")
        else:
            lines.append(f"home turns by ({', '.join(f'{angle:.5g}' for angle in turn)}) {angle}")
        low, high = (per_rad * end for end in self.psi_range)
        each = per_rad * np.nanmedian(self.std["psi"])
        left = self._residual_text(units)
        lines.append(f"psi from {low:.4g} to {high:.4g} {angle}, each +- {each:.2g} {angle}; {left}")
        if self.clock_offset is not None:
            lines.append(self._clock_offset_line())
        lines.append(
            f"u1 and u2 lead to the point on the axis {self.gauge.replace('_', ' ')}; along the axis, motion "
            f"determines only their difference. {self.conventions}"
        )
        return "\n".join((*lines, *self.findings, "ok" if self.ok else "NOT RELIABLE"))

    def __repr__(self) -> str:
        return f"HingeFit({self.samples} samples, {self._residual_text()}, {'ok' if self.ok else 'not ok'})"

    def _sheet(self) -> Sheet:
        """Return what notebooks show."""
        names = ("u1", "u2", "n", "home")
        rows = [
            (name, cell_text(getattr(self.pair, name)), cell_text(self.std[name]), unit_of(name)) for name in names
        ]
        return Sheet(repr(self), (("", "value", "standard deviation", "unit"), *rows), self.findings)

    def to_json(self) -> str:
        """Return a report as JSON text, in m, rad and s. Numbers that are not finite become null.

        The keys are u1, u2, n and home of `pair`, psi for `psi_range`, missing for the number of samples that were
        not used, and names of attributes. The standard deviation of psi is the median of those of all samples.
        """
        import json

        report = {
            "ok": self.ok,
            "samples": self.samples,
            "missing": self.psi.size - self.samples,
            "loss": self.loss,
            "gauge": self.gauge,
            **{name: getattr(self.pair, name).tolist() for name in ("u1", "u2", "n", "home")},
            "std": {
                name: _finite_lists((np.nanmedian(value) if name == "psi" else value).tolist())
                for name, value in self.std.items()
            },
            **{
                name: _finite_lists(getattr(self, name))
                for name in ("rms_position", "rms_angle", "noise_position", "noise_angle")
            },
            "clock_offset": self.clock_offset,
            "psi": list(self.psi_range),
            "findings": list(self.findings),
        }
        return json.dumps(report, indent=2, allow_nan=False)


def _fine_units(units: str | None) -> Units:
    """Return units of angles and of small lengths: deg and mm unless others are named."""
    return Units.of(units).over(Units("deg, mm"))


def fit(
    body1: BodyMotion,
    body2: BodyMotion,
    loss: str = "linear",
    gauge: str = "closest_to_R1",
    t: ArrayLike | None = None,
    weights: ArrayLike | None = None,
    clock_offset: float | None = None,
    noise1: tuple[ArrayLike, ArrayLike] | None = None,
    noise2: tuple[ArrayLike, ArrayLike] | None = None,
    n_along: ArrayLike | None = None,
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
    - `n_along` selects the sign of n. Without it, the first component of n whose magnitude is at least 0.45 times the
      largest magnitude is positive.
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
        clock_offset: known time by which body 1's clock is ahead of body 2's clock [s], 0 if both recordings use the
            same clock; `t` must be given too. Without `t`, the clocks are assumed to be the same.
        noise1: standard deviations of the noise of body 1, in each coordinate of the position [m] and in each
            component of the rotation vector of the attitude error [rad]: a tuple of two numbers or arrays (N,), such
            as (smoothed.noise["R"], smoothed.noise["S"]) with `smoothed = smooth(t, body1)`. A common factor is still
            estimated from the data.
        noise2: those of body 2. Give both noise1 and noise2 or neither; give neither if body 2 is a point.
        n_along: direction in body 1's axes, such as (0, 0, -1), along which n is to have a positive component, so
            that psi grows in the wanted sense; shape (3,). It only selects the sign.

    Returns:
        The HingeFit. Check `.ok` and `.findings` before you use its numbers.

    Raises:
        FitError: fewer than two samples have the poses of both bodies (fewer than four if body 2 is a point), or the
            bodies do not turn relative to each other.
        ArgumentError: n_along is within 6 degrees of perpendicular to the axis, and does not tell its sign.

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
    along = None if n_along is None else finite_axis("n_along", one_constant("n_along", n_along, 3))
    samples = checked_samples(body1, body2, t, weights, clock_offset, noise1, noise2)
    used = samples.known1 & samples.known2
    if used.sum() < 2:
        raise FitError("body1, body2", "at least two samples with both poses", f"{int(used.sum())}")
    find = _find_circle if samples.is_point else _find_hinge
    found = find(samples, used, LOSSES[loss], gauge, clock_offset, along)
    return _hinge_fit(found, samples, body1, body2, loss, gauge, along)


class _Found(NamedTuple):
    """A hinge of two bodies, or of a body and a point, with what belongs to it; N samples are used."""

    pair: HingePair
    poses: RelativePoses
    used: NDArray[np.bool_]  # of all samples
    clock: ClockedPoses | None  # where a clock offset is used
    offset: float  # clock offset [s]
    offset_std: float  # 0 of a given one, inf of one that is not determined
    psi: Float64Array  # (N,)
    psi_std: Float64Array  # (N,)
    good: NDArray[np.bool_]  # no outliers; (N,)
    gap: Float64Array  # (N,)
    tilt: Float64Array  # NaN of a point; (N,)
    weights: Float64Array  # (N,)
    covariance: Float64Array  # (12, 12)
    noise: Noise  # the attitude's is NaN of a point
    noise_std: dict[str, Any]
    findings: list[Finding]


def _hinge_fit(
    found: _Found,
    samples: Samples,
    body1: BodyMotion,
    body2: BodyMotion,
    loss: str,
    gauge: str,
    n_along: Float64Array | None,
) -> HingeFit:
    """Return the HingeFit of a found hinge, with findings on the recordings too."""
    clock, used, weights, total = found.clock, found.used, found.weights, found.weights.sum()
    deviations = np.sqrt(np.diagonal(found.covariance)).reshape(4, 3)
    std: dict[str, Any] = dict(zip(("u1", "u2", "n", "home"), map(read_only, deviations), strict=True))
    std |= {"psi": _scatter_used(found.psi_std, used)} | found.noise_std
    if samples.t is not None:
        std["clock_offset"] = np.float64(found.offset_std)
    findings = list(found.findings)
    if clock is not None and abs(found.offset) > 4.0 * found.offset_std > 0:
        findings += notes("clock", clock.clock_offset_sentences(found.offset))
    if not is_reliable(findings) and not samples.is_point:
        recorded = (samples.R1, samples.S1, samples.R2, samples.S2)
        findings += notes("mistake", probable_mistakes(BodyPoses(*(array[used] for array in recorded))))
        if LOSSES[loss] is None and 'loss="cauchy"' not in " ".join(findings):
            findings += notes("outliers", ['Where some samples may be outliers, loss="cauchy" tells.'])
    findings += notes("missing samples", _missing_sample_sentences(used, clock))
    if found.poses.samples < 10:
        text = f"Of {found.poses.samples} samples, the standard deviations are no more than a hint."
        findings += notes("samples", [text])
    distances = np.linalg.norm(found.poses.p, axis=0)
    doubts = suspicions("distance", "R2 - R1", distances)
    if samples.t is not None:
        doubts += suspicions("instants", "t", samples.t)
        findings += notes("gaps", [f"{text}." for text in gap_sentences("t", samples.t)])
    findings += [Finding("unit", 1, 0, text) for text in doubts]
    findings += notes("noise", samples.noise_suspicions(found.noise))
    instants = np.flatnonzero(used) if samples.t is None else samples.t[used]
    findings += _turn_findings(found.psi, instants, found.good)
    counted = found.psi[found.good] if found.good.any() else found.psi
    moved = body2 if clock is None else clock.body2(found.offset)
    return HingeFit(
        pair=found.pair,
        psi=_scatter_used(found.psi, used),
        psi_range=(float(counted.min()), float(counted.max())),
        covariance=read_only(found.covariance),
        std=std,
        rms_position=float(np.sqrt(weights @ found.gap**2 / total)),
        rms_angle=float(np.sqrt(weights @ found.tilt**2 / total)),
        noise_position=float(np.sqrt(found.noise.place)),
        noise_angle=float(np.sqrt(found.noise.attitude)),
        clock_offset=None if samples.t is None else found.offset,
        findings=tuple(dict.fromkeys(findings)),
        gauge=gauge,
        loss=loss,
        n_along=None if n_along is None else tuple(n_along.tolist()),
        weights=_scatter_used(weights, used, 0.0),
        t=samples.t,
        gap=_scatter_used(found.gap, used),
        tilt=_scatter_used(found.tilt, used),
        samples=int(used.sum()),
        body2=BodyMotion(R=moved.R) if samples.is_point else moved,
        _body1=body1,
    )


def _turn_findings(psi: Float64Array, instants: NDArray[Any], good: NDArray[np.bool_]) -> list[Finding]:
    """Return findings if the hinge may turn by half a turn or more between samples: whole turns are not seen."""
    steps, turned = np.diff(instants).astype(np.float64), np.abs(np.diff(psi))
    both = good[1:] & good[:-1]  # neighbours of which neither is an outlier
    if both.sum() < 4:
        return []
    usual = float(np.median(turned[both]))
    fast = "the hinge may turn the other way, or further"
    often = f"psi turns by {usual:.2g} rad from sample to sample: {fast}; record more samples in a second."
    is_gap = steps > 3 * np.median(steps)
    rates = (turned / steps)[both & ~is_gap]
    rate = float(np.quantile(rates, 0.9)) if rates.size else 0.0
    most = float(rate * steps[is_gap].max(initial=0.0))
    gap = f"During a gap, the hinge may turn by {most:.2g} rad at its usual rate: whole turns there are not seen."
    return exceeded(Finding("turns", usual, 2.5, often), Finding("turns in a gap", most, np.pi, gap))


def _find_hinge(
    samples: Samples,
    used: NDArray[np.bool_],
    loss: Loss | None,
    gauge: str,
    clock_offset: float | None,
    n_along: Float64Array | None,
) -> _Found:
    """Find the hinge of two bodies that both have attitudes."""
    # The most likely hinge, without its bias, and its residuals.
    poses = samples.poses(used)
    check_turning(poses)
    estimate, clock = _most_likely_estimate(samples, poses, loss, clock_offset)
    if clock is not None:
        poses, used = clock.poses_at(estimate.offset), clock.used_at(estimate.offset)
        if clock_offset is not None:
            poses = poses._replace(offset_derivatives=None)
    noise = estimate.noise
    hinge = _without_bias(poses, estimate, gauge, n_along)
    residuals = random_part = evaluate_hinge(poses, hinge, noise, loss)
    if not samples.knows_split:
        residuals = _with_unknown_split(poses, hinge, noise, residuals)
    change = result_derivatives(hinge, gauge)
    random_covariance, covariance = (
        change @ each.covariance[:PARAMETERS, :PARAMETERS] @ change.T for each in (random_part, residuals)
    )
    deviations = np.sqrt(np.diagonal(covariance)).reshape(4, 3)
    std = dict(zip(("u1", "u2", "n", "home"), deviations, strict=True))
    # The angle.
    is_outlier, home = find_outliers(residuals, poses), home_of(hinge)
    good = ~is_outlier & (residuals.weights >= _INLIER)
    psi = _unwrap_angles(residuals.psi - home_angle(hinge, home), good)
    findings = judge_hinge(poses, hinge, noise, residuals, is_outlier, estimate.has_converged, std)
    psi_std = _angle_std(poses, hinge, noise, residuals.covariance)
    if any(finding.name == "plane" for finding in findings):
        psi_std = np.full_like(psi_std, np.inf)
    return _Found(
        pair=HingePair(u1=hinge.u1, u2=hinge.u2, n=hinge.n, home=home),
        poses=poses,
        used=used,
        clock=clock,
        offset=estimate.offset,
        offset_std=_clock_offset_std(poses, residuals, clock_offset),
        psi=psi,
        psi_std=psi_std,
        good=good,
        gap=np.linalg.norm(residuals.gap, axis=0),
        tilt=residuals.tilt,
        weights=residuals.weights * samples.weights[used],
        covariance=covariance,
        noise=noise,
        noise_std=noise_standard_deviations(poses, hinge, noise, loss),
        findings=[
            *findings,
            *split_findings(random_covariance, covariance, "divides between the bodies: noise1 and noise2 tell"),
        ],
    )


def _without_bias(poses: RelativePoses, estimate: Estimate, gauge: str, n_along: Float64Array | None) -> Hinge:
    """Return the hinge, with its sign, without its bias."""
    bias = bias_of_hinge(poses, estimate.hinge, estimate.noise)
    return estimate.hinge.moved(-bias).balanced().signed(n_along).in_gauge(gauge)


def _with_unknown_split(
    poses: RelativePoses, hinge: Hinge, noise: Noise, residuals: HingeResiduals
) -> HingeResiduals:
    """Return the residuals with a covariance that allows for any share of body 1 in the noise of the attitudes."""
    from_body1, from_body2 = (bias_of_hinge(poses, hinge, noise, share) for share in (1.0, 0.0))
    spread = np.zeros(residuals.covariance.shape[0])
    spread[:PARAMETERS] = from_body1 - from_body2
    # The variance of a number between 0 and 1 is 1/12.
    return residuals._replace(covariance=residuals.covariance + np.outer(spread, spread) / 12)


def _find_circle(
    samples: Samples,
    used: NDArray[np.bool_],
    loss: Loss | None,
    gauge: str,
    clock_offset: float | None,
    n_along: Float64Array | None,
) -> _Found:
    """Find the hinge of body 1 and a point of body 2 from the circle on which the point moves."""
    if samples.mean_noise is not None:
        raise ArgumentError("noise1", "None, since body 2 has no attitudes", "values")
    fitted, clock = _most_likely_circle(samples, samples.poses(used), loss, gauge, clock_offset, n_along)
    circle, poses = fitted.circle, fitted.poses
    used = used if clock is None else clock.used_at(fitted.offset)
    good = ~fitted.is_outlier & (fitted.weights >= _INLIER * poses.weights)
    u1, u2 = circle.levers(gauge)
    return _Found(
        pair=HingePair(u1=u1, u2=u2, n=circle.n),
        poses=poses,
        used=used,
        clock=clock,
        offset=fitted.offset,
        offset_std=np.inf if clock is None and clock_offset is None else fitted.offset_std,
        psi=_unwrap_angles(circle.angles(poses.p.T), good),
        psi_std=fitted.psi_std,
        good=good,
        gap=np.linalg.norm(fitted.residuals, axis=1),
        tilt=np.full(poses.samples, np.nan),
        weights=fitted.weights * samples.weights[used].mean(),
        covariance=fitted.covariance,
        noise=Noise(fitted.noise**2, np.nan),
        noise_std={},
        findings=list(fitted.findings),
    )


def _most_likely_circle(
    samples: Samples,
    poses: RelativePoses,
    loss: Loss | None,
    gauge: str,
    clock_offset: float | None,
    n_along: Float64Array | None,
) -> tuple[CircleFit, ClockedPoses | None]:
    """Return the circle of a point of body 2, and the clocked poses where a clock offset is used."""
    clock = _clocked_poses(samples, loss, clock_offset)
    known: dict[str, Any] = {"is_body1_exact": samples.knows_split, "n_along": n_along}
    if clock is not None and clock_offset is not None:
        there = _poses_at_known_offset(clock, clock_offset)
        return fit_circle(there, loss, gauge, **known)._replace(offset=clock_offset), clock
    if clock is not None and poses.samples >= MIN_PIECE:
        near = clock.most_likely_offset(circle_misfit)
        fitted = fit_circle(poses, loss, gauge, clock.poses_at, near, **known)
        if fitted.shows_offset(clock.noise_poses_at(fitted.offset)):
            return fitted, clock
    return fit_circle(poses, loss, gauge, **known), None


def _clocked_poses(samples: Samples, loss: Loss | None, clock_offset: float | None) -> ClockedPoses | None:
    """Return the poses at any clock offset; None without instants, at a known offset of 0, and where body 2 has too
    few samples in a row to be smoothed.
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
    """Return the poses at an offset that the user gave, which is not estimated."""
    there = clock.poses_at(clock_offset)._replace(offset_derivatives=None)
    if there.samples < 2:
        raise ArgumentError("clock_offset", "a time by which both recordings still overlap [s]", clock_offset)
    return there


def _missing_sample_sentences(is_used: NDArray[np.bool_], clock: ClockedPoses | None) -> list[str]:
    """Return a sentence that counts the samples that were not used."""
    if is_used.all():
        return []
    ends = "" if clock is None else ", or have no sample of body 2 at the same time"
    return [f"{int((~is_used).sum())} of {is_used.size} samples are missing or have no weight{ends}."]


def _most_likely_estimate(
    samples: Samples, poses: RelativePoses, loss: Loss | None, clock_offset: float | None
) -> tuple[Estimate, ClockedPoses | None]:
    """Return the most likely hinge, and what gives the poses at any clock offset; None in its place if the offset is
    0, as known or as taken where the motion does not determine it.
    """
    start = None if loss is None else robust_closed_form_hinge(poses)
    clock = _clocked_poses(samples, loss, clock_offset)
    if clock is not None and clock_offset is not None:
        there = _poses_at_known_offset(clock, clock_offset)
        estimate = most_likely_hinge(
            there,
            start or closed_form_hinge(there.thinned(_START_SAMPLES)),
            loss,
        )
        return estimate._replace(offset=clock_offset), clock
    if clock is not None:
        near = clock.most_likely_offset(functools.partial(negative_log_likelihood_per_sample, known_hinge=start))
        first = start or closed_form_hinge(clock.poses_at(near, _START_SAMPLES))
        estimate = most_likely_hinge(poses, first, loss, clock.poses_at, near)
        real, noisy = (at(estimate.offset, _START_SAMPLES) for at in (clock.poses_at, clock.noise_poses_at))
        if estimate.has_converged and shows_offset(real, noisy, estimate, loss):
            return estimate, clock
    return most_likely_hinge(poses, start or closed_form_hinge(poses.thinned(_START_SAMPLES)), loss), None


def _clock_offset_std(poses: RelativePoses, residuals: HingeResiduals, clock_offset: float | None) -> np.float64:
    """Return the standard deviation of the clock offset [s]: 0 of a given one, inf of one that is not determined."""
    if poses.offset_derivatives is None:
        return np.float64(np.inf if clock_offset is None else 0.0)
    return np.float64(np.sqrt(residuals.covariance[PARAMETERS, PARAMETERS]))


def _angle_std(poses: RelativePoses, hinge: Hinge, noise: Noise, covariance: Float64Array) -> Float64Array:
    """Return the standard deviations of psi [rad] (N,)."""
    attitude = noise.attitude * (1.0 if poses.relative_noise is None else poses.relative_noise[1])
    own = np.broadcast_to(attitude, poses.samples)
    # The axes shift all angles alike; the clock does not.
    parameters, slopes = [np.eye(covariance.shape[0])[:4].T @ _zero_derivatives(poses, hinge)], [np.ones(own.size)]
    if poses.offset_derivatives is not None:
        by_offset = [np.asarray(seen.offset_derivatives)[5] for _, seen in iterate_residuals(poses, hinge)]
        parameters.append(np.eye(covariance.shape[0])[PARAMETERS])
        slopes.append(np.concatenate(by_offset))
    common = np.stack(parameters) @ covariance @ np.stack(parameters).T
    change = np.stack(slopes)
    return np.asarray(np.sqrt(own + np.maximum((change * (common @ change)).sum(axis=0), 0.0)))


def _zero_derivatives(poses: RelativePoses, hinge: Hinge) -> Float64Array:
    """Return the derivatives (4,) of the shift that all angles psi have in common, by two turns of n and two of m; by
    central differences.
    """
    some = poses.thinned(SHIFT_SAMPLES)
    changes = []
    size = 1e-5  # rad
    for step in size * np.eye(PARAMETERS)[:4]:
        ends = []
        for moved in (hinge.moved(step), hinge.moved(-step)):
            turn = home_angle(moved, home_of(moved)) - home_angle(hinge, home_of(hinge))
            turn -= 2 * np.pi * np.rint(turn / (2 * np.pi))
            ends.append(frame_turn_angle(some, hinge, moved) - turn)
        changes.append((ends[0] - ends[1]) / (2 * size))
    return np.array(changes)


def _finite_lists(value: Any) -> Any:
    """Return a number or nested lists of numbers with None for those that are not finite."""
    if isinstance(value, list):
        return [_finite_lists(one) for one in value]
    return value if np.isfinite(value) else None


def _scatter_used(values: Float64Array, is_used: NDArray[np.bool_], fill_value: float = np.nan) -> Float64Array:
    """Return a read-only array over all samples that has `values` at the used ones."""
    all_samples = np.full(is_used.shape, fill_value)
    all_samples[is_used] = values
    return read_only(all_samples)


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
