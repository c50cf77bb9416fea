"""The hinge of two recorded motions: `hingepair.fit` and what it returns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, FitError, MissingDependencyError, ShapeError
from hingepair.measured.findings import check_turning, findings, outlying
from hingepair.measured.hinge import GAUGES, derivatives, home_of, offset
from hingepair.measured.likelihood import LOSSES, judged, most_likely, without_bias
from hingepair.measured.relative_poses import closed_form, closed_form_of_most, relative_poses
from hingepair.numeric.arrays import Float64Array, broadcast_shape, check_choice, read_only, real_array
from hingepair.numeric.instants import increasing_seconds
from hingepair.numeric.suspicions import distance_suspicions, instant_suspicions
from hingepair.numeric.tables import Sheet, Shown, cell, unit_of
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import rotation_vector

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from hingepair.pair.residuals import Residuals


_MAX_RESIDUAL = 5.0  # of a sample, in rms of all samples, that `HingeFit.residuals` passes
_MIN_GOOD_WEIGHT = 0.1  # part of a sample's weight that the loss leaves to one that is no outlier
_FEW_SAMPLES = 10  # below, standard deviations are no more than a hint


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HingeFit(Shown):
    """The hinge of two recorded motions, how sure it is, and what it leaves.

    Attributes:
        pair: the hinge, ready for everything else.
        psi: hinge angle, without jumps by 2 pi from one sample to the next, the first in [-pi, pi]; (N,) rad, NaN
            where a pose is missing.
        psi_range: smallest and largest psi of the samples that are no outliers [rad].
        covariance: of u1, u2 [m], n and the rotation vector of home in body 1's axes [rad], in this order; (12, 12).
            Its rank is 9: n keeps its length, the gauge keeps one of u1 and u2 across, home follows from both axes.
        std: standard deviations by name, roots of its diagonal; (3,) each.
        rms_position: of abs(R1 + S1 u1 - R2 - S2 u2) [m]; of a robust loss each sample by its weight.
        rms_angle: of the angle between the axes of the two bodies [rad]; likewise.
        noise_position: standard deviation of a coordinate of R2 - R1 [m], which has the noise of both bodies; poorly
            known where the noise of angles, times the levers, is much larger.
        noise_angle: standard deviation of a component of the relative attitude, that of psi [rad].
        ok: the motion shows a hinge and determines it.
        findings: in sentences: what was not seen, what is no hinge, what else to know.
        gauge: which point of the axis u1 and u2 name.
        loss: of each sample.
        weights: of each sample, by argument and loss; (N,), 0 where a pose is missing.
        t: instants since the first [s], or None; (N,).
        gap: abs(R1 + S1 u1 - R2 - S2 u2) of each sample; (N,) m.
        tilt: angle between the axes of the two bodies; (N,) rad.
        samples: how many were used.
    """

    pair: HingePair
    psi: Float64Array
    psi_range: tuple[float, float]
    covariance: Float64Array
    std: Mapping[str, Float64Array]
    rms_position: float
    rms_angle: float
    noise_position: float
    noise_angle: float
    ok: bool
    findings: tuple[str, ...]
    gauge: str
    loss: str
    weights: Float64Array
    t: Float64Array | None
    gap: Float64Array
    tilt: Float64Array
    samples: int
    _bodies: tuple[BodyMotion, BodyMotion] = field(repr=False)

    @property
    def residuals(self) -> Residuals:
        """Return E1 and E2 of every sample, judged by five times the rms that the fit leaves.

        Where the fit is not `ok`, what it leaves is not known to be noise, and round-off is the yardstick.
        """
        tolerances = {"gap": self.rms_position, "tilt": self.rms_angle}
        allowed = {name: _MAX_RESIDUAL * max(rms, 1e-300) for name, rms in tolerances.items()} if self.ok else None
        first, second = (BodyMotion(R=body.R, S=body.S) for body in self._bodies)
        return self.pair.residuals(first, second, allowed, self.t)

    def plot(self) -> Figure:
        """Draw the hinge angle and what is left of each sample, over time.

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
        rows = (("psi [deg]", angles[0]), ("gap [mm]", 1e3 * self.gap), ("tilt [deg]", angles[1]))
        for axes, (label, values) in zip(figure.subplots(3, sharex=True), rows, strict=True):
            axes.plot(x, values, linewidth=0.8)
            axes.set_ylabel(label)
            axes.grid(alpha=0.3)
        axes.set_xlabel("sample" if self.t is None else "t [s]")
        figure.suptitle(self._left())
        return figure

    def _left(self) -> str:
        return f"left: {1e3 * self.rms_position:.3g} mm and {np.degrees(self.rms_angle):.3g} deg rms"

    def __str__(self) -> str:
        lines = [f"hinge of {self.samples} samples ({self.psi.size - self.samples} missing), loss {self.loss}"]
        for name, unit in (("u1", "m"), ("u2", "m"), ("n", "")):
            value, std = getattr(self.pair, name), self.std[name]
            numbers = ", ".join(f"{v:.6g} +- {s:.2g}" for v, s in zip(value, std, strict=True))
            lines.append(f"{name} = ({numbers}) {unit}".rstrip())
        turn = np.degrees(rotation_vector(self.pair.home))
        lines.append(f"home turns by ({', '.join(f'{angle:.5g}' for angle in turn)}) deg")
        low, high = np.degrees(self.psi_range)
        lines.append(f"psi from {low:.4g} to {high:.4g} deg; {self._left()}")
        lines.append(
            f"u1 and u2 name the point of the axis {self.gauge.replace('_', ' ')}; along the axis only their "
            "difference is seen"
        )
        return "\n".join((*lines, *self.findings, "ok" if self.ok else "NOT A HINGE TO RELY ON"))

    def __repr__(self) -> str:
        return f"HingeFit({self.samples} samples, {self._left()}, {'ok' if self.ok else 'not ok'})"

    def _sheet(self) -> Sheet:
        rows = [(name, cell(getattr(self.pair, name)), cell(std), unit_of(name)) for name, std in self.std.items()]
        return Sheet(repr(self), (("", "value", "standard deviation", "unit"), *rows), self.findings)

    def to_json(self) -> str:
        """Return the hinge, its standard deviations and the findings as JSON."""
        import json

        found = {
            "ok": self.ok,
            "samples": self.samples,
            "missing": self.psi.size - self.samples,
            "loss": self.loss,
            "gauge": self.gauge,
            **{name: getattr(self.pair, name).tolist() for name in ("u1", "u2", "n", "home")},
            "std": {name: value.tolist() for name, value in self.std.items()},
            "rms_position": self.rms_position,
            "rms_angle": self.rms_angle,
            "noise_position": self.noise_position,
            "noise_angle": self.noise_angle,
            "psi": list(self.psi_range),
            "findings": list(self.findings),
        }
        return json.dumps(found, indent=2, allow_nan=False)


def fit(
    body1: BodyMotion,
    body2: BodyMotion,
    loss: str = "linear",
    gauge: str = "closest_to_R1",
    t: ArrayLike | None = None,
    weights: ArrayLike | None = None,
) -> HingeFit:
    """Fit the hinge that two recorded motions share: n, home, u1, u2 and psi(t) (E1, E5).

    First in closed form, from the mean relative attitude and six linear equations; then the most likely hinge if
    every pose is off by isotropic noise, alike in both bodies, psi and the true poses eliminated. How large the noise
    is, the data say. Poses that are not finite are missing samples.

    What a motion cannot show is fixed by rules. The point of the axis that u1 and u2 name: the gauge. The sign of
    (n, psi): of the components of n that are at least 0.45 times as large as the largest, the first is positive.
    psi = 0: `home` turns the axis of body 2 into that of body 1 the short way, so it is the identity where the two
    have the same components. Where they are more than 154 degrees apart, `home` begins with a half turn about the
    axis of body 2 (x, y or z) whose component of n is the first below 0.65.

    Args:
        body1: R and S of body 1, shape (N,); one pose where it stands still.
        body2: R and S of body 2 at the same instants.
        loss: "linear", or one that makes outliers count little: "soft_l1", "huber", "cauchy", "arctan", as SciPy's
            `least_squares` defines them, of each sample as a whole. Then the start is that which most samples agree
            with, and what is thirty standard deviations off counts nothing. "cauchy" and "arctan" mind outliers
            least.
        gauge: "closest_to_R1" (u1 is across n) or "closest_to_R2".
        t: instants [s], datetime64 or nanoseconds, for reports; shape (N,).
        weights: of the samples, such as inverse variances; shape (N,); 0 leaves one out.

    Returns:
        The fit. Look at `.ok` and `.findings` before its numbers.

    Raises:
        FitError: nothing determines a hinge: fewer than two samples, or bodies that do not turn against each other.
        ArgumentError: an argument cannot be used; names it.

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
    arrays = motion_arrays("body1", body1, "R", "S") | motion_arrays("body2", body2, "R", "S")
    shape = broadcast_shape({"body1": body1.shape, "body2": body2.shape})
    if len(shape) != 1:
        raise ShapeError("body1, body2", "motions of shape (N,), N instants", f"shape {shape}")
    time = None if t is None else read_only(increasing_seconds("t", t)[0])
    if time is not None and time.shape != shape:
        raise ShapeError("t", f"shape {shape}, as the bodies", f"shape {time.shape}")
    given = _checked_weights(weights, shape[0])
    tails = {"R": (3,), "S": (3, 3)}
    whole = {name: np.broadcast_to(array, (*shape, *tails[name[0]])) for name, array in arrays.items()}
    used = given > 0
    for array in whole.values():
        if not np.isfinite(array.sum()):  # one pass where nothing is missing
            used &= np.isfinite(array.reshape(shape[0], -1)).all(axis=-1)
    if used.sum() < 2:
        raise FitError("body1, body2", "at least two samples with both poses", f"{int(used.sum())}")
    parts = whole if used.all() else {name: array[used] for name, array in whole.items()}
    poses = relative_poses(parts["R1"], parts["S1"], parts["R2"], parts["S2"], given[used])
    check_turning(poses)
    penalty = LOSSES[loss]
    start = closed_form(poses.thinned(65536)) if penalty is None else closed_form_of_most(poses)
    hinge, noise, still = most_likely(poses, start, penalty)
    hinge = without_bias(poses, hinge, noise).signed().in_gauge(gauge)
    seen = judged(poses, hinge, noise, penalty)
    home = home_of(hinge)
    change = derivatives(hinge, gauge)
    covariance = change @ seen.covariance @ change.T
    std = dict(zip(("u1", "u2", "n", "home"), np.sqrt(np.diagonal(covariance)).reshape(4, 3), strict=True))
    far = outlying(seen, poses)
    found = findings(poses, hinge, noise, seen, far, still, std)
    texts = [finding.text for finding in found]
    ok = all(finding.harmless for finding in found)
    if not ok and penalty is None and 'loss="cauchy"' not in " ".join(texts):
        texts.append('Where some samples may be outliers, loss="cauchy" tells.')
    if not used.all():
        texts.append(f"{int((~used).sum())} of {shape[0]} samples are missing or have no weight.")
    if poses.samples < _FEW_SAMPLES:
        texts.append(f"Of {poses.samples} samples, the standard deviations are no more than a hint.")
    if time is not None:
        texts += instant_suspicions("t", time)
    texts += distance_suspicions("R2 - R1", np.sqrt((poses.p * poses.p).sum(axis=0)))
    good = ~far & (seen.weights >= _MIN_GOOD_WEIGHT * given[used])
    psi = _unwrapped(seen.psi - offset(hinge, home), good)
    counted = psi[good] if good.any() else psi
    total = seen.weights.sum()
    gaps = np.sqrt((seen.gap * seen.gap).sum(axis=0))
    return HingeFit(
        pair=HingePair(u1=hinge.u1, u2=hinge.u2, n=hinge.n, home=home),
        psi=_spread(psi, used),
        psi_range=(float(counted.min()), float(counted.max())),
        covariance=read_only(covariance),
        std={name: read_only(value) for name, value in std.items()},
        rms_position=float(np.sqrt(seen.weights @ (gaps * gaps) / total)),
        rms_angle=float(np.sqrt(seen.weights @ (seen.tilt * seen.tilt) / total)),
        noise_position=float(np.sqrt(noise.place)),
        noise_angle=float(np.sqrt(noise.attitude)),
        ok=ok,
        findings=tuple(texts),
        gauge=gauge,
        loss=loss,
        weights=_spread(seen.weights, used, 0.0),
        t=time,
        gap=_spread(gaps, used),
        tilt=_spread(seen.tilt, used),
        samples=int(used.sum()),
        _bodies=(body1, body2),
    )


def _checked_weights(weights: ArrayLike | None, count: int) -> Float64Array:
    if weights is None:
        return np.ones(count)
    given = real_array("weights", weights).astype(np.float64)
    if given.shape != (count,):
        raise ShapeError("weights", f"shape ({count},), as the bodies", f"shape {given.shape}")
    if not (np.isfinite(given) & (given >= 0)).all():
        raise ArgumentError("weights", "finite numbers, none negative", given)
    return given


def _spread(values: Float64Array, used: NDArray[np.bool_], missing: float = np.nan) -> Float64Array:
    """Return values of the samples used at their places among all samples."""
    whole = np.full(used.shape, missing)
    whole[used] = values
    return read_only(whole)


def _unwrapped(psi: Float64Array, good: NDArray[np.bool_]) -> Float64Array:
    """Return angles without jumps by 2 pi from good sample to good sample, the first of these in [-pi, pi].

    The other samples are as near to the last good one as whole turns allow.
    """
    whole = np.unwrap(psi[good])
    whole = whole - 2 * np.pi * np.rint(whole[:1] / (2 * np.pi))
    if good.all():
        return whole
    before = whole[np.maximum(np.cumsum(good) - 1, 0)] if whole.size else np.zeros_like(psi)
    return psi - 2 * np.pi * np.rint((psi - before) / (2 * np.pi))
