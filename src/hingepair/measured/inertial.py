"""The hinge from inertial sensors alone, one on either body: no positions, no attitudes.

The axis: across it both bodies turn alike, so that `abs(omega1 x n1) = abs(omega2 x n2)`, each in its own body's axes
(Seel, Schauer and Raisch, IEEE International Conference on Control Applications, 2012, 45-49; Sensors 14 (2014),
6891-6909). Of n2 and -n2, which satisfy it alike, the one is right with which the angle between the two turning
vectors across the axis changes as psi' = omega2 . n2 - omega1 . n1 says.

The point: both sensors, moved there, feel the same force, `abs(f1 + Gamma1 u1) = abs(f2 + Gamma2 u2)` with
`Gamma u = omega x (omega x u) + alpha x u` (the same papers). What of the axis and the point is seen depends on the
motion (Olsson, Kok, Seel and Halvorsen, Sensors 20 (2020), 3534), and is told by the covariance.

Gyroscopes and accelerometers read something at rest too. These biases are unknowns beside the axis and the point,
with prior standard deviations: what the motion does not show of them widens the covariance as much as they may be.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, FitError, ShapeError
from hingepair.measured.findings import (
    RANDOM,
    RELIABLE_POINT,
    Finding,
)
from hingepair.measured.hinge import frame, sign_of, tilt_axis
from hingepair.measured.least_squares import (
    score_scatter,
)
from hingepair.measured.spline import MIN_PIECE, smooth_columns
from hingepair.numeric.arrays import Float64Array, number_not_below_0, read_only, vectors
from hingepair.numeric.instants import checked_gaps, increasing_seconds, split_at_gaps
from hingepair.numeric.suspicions import suspicions
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.rotations.matrices import skew

Linearise = Callable[[Float64Array], tuple[Float64Array, Float64Array]]
Move = Callable[[Float64Array, Float64Array], Float64Array]

_START_SAMPLES = 400  # samples that starts are tried with
_MIN_OFFSET, _MIN_OFFSET_IN_STDS = 0.02, 4.0  # of clocks, in samples; smaller ones are not told
_MIN_OFFSET_EFFECT = 0.5  # on an axis, in standard deviations
_MIN_OFFSET_GAIN = 1.1
_LAG_WINDOW = 3  # readings on either side that give a derivative
_MIN_LAG_SIGNAL = 3.0  # of the derivatives, to what noise makes of them
_SLOPE_WEIGHTS = 28  # sum of the squares of -3 ... 3
_LAG_STEPS = 12
_MAX_LAG_SAMPLES = 4000
_BIAS_ROUNDS = 3  # of fits with biases, each with the noise that the last one left
_ROUNDING = 1e-13  # residuals that rounding explains
# [rad]: an axis that is known less well is not to be relied on.
_MAX_RELIABLE_INERTIAL_AXIS_STD_IN_RADIANS = np.radians(5.0)
_MIN_REFERENCE_LEVER_LENGTH_IN_METRES = 0.1  # [m]: shorter levers are judged as if they had this length
_MAX_HARMLESS_RATE_RESIDUAL_TO_RMS_RATE = 0.3  # of the rates across the axis
_SYSTEMATIC_RATE = 0.05
"""Residuals that are not noise: the axis is still reliable below this."""
_MAX_HARMLESS_SYSTEMATIC_FORCE_RESIDUAL_TO_RMS_FORCE_DIFFERENCE = 0.07
"""Residuals that are not noise, over the difference between the sizes of both forces: the point is still reliable
below this."""
_MIN_TURN_CORRELATION_THAT_SHOWS_HINGE_AXIS_SIGN = 0.2  # from which the sign of n2 is shown
_MIN_DETERMINED_EIGENVALUE_TO_NORMAL_MATRIX_NORM = 1e-10  # from which a direction is not rounding
_MIN_SIGNAL_TO_NOISE_POWER_OF_DETERMINED_HINGE_AXIS = 10.0
"""Size of the normal matrix over what noise adds to it, from which a direction of the axes is shown. What noise adds
is more than the variance of the rates says where rates across an axis are small."""
_MIN_SIGNAL_TO_NOISE_POWER_OF_DETERMINED_HINGE_POINT = 2.0
"""Size of the normal matrix over what noise adds to it, from which a direction of the hinge point is shown."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AxisFit:
    """The result of `fit_axis`: the hinge axis in each body's own axes, the biases of both gyroscopes, standard
    deviations, the rms residual, whether the axis is reliable (`ok`), and findings.

    Attributes:
        n1: hinge axis in body 1's axes, unit vector; shape (3,). It is the argument `n` of a HingePair. The page of
            `fit_axis` says which sign n1 has.
        n2: the same vector in body 2's axes; shape (3,). For a HingePair, n2 = home^T n1.
        std: standard deviations of n1 and n2 [rad]; shape (2,). Each is the standard deviation of the angle by which
            the vector deviates in its least certain direction. It is inf if the motion does not determine the vector.
        covariance: covariance matrix of the six components of n1 and n2, in this order; shape (6, 6). A variance is
            inf if the motion does not determine the vector.
        bias1: bias of gyroscope 1 in body 1's axes [rad/s]; shape (3,).
        bias2: bias of gyroscope 2 in body 2's axes [rad/s]; shape (3,).
        bias_std: standard deviations of bias1 (first row) and bias2 (second row) [rad/s]; shape (2, 3). In directions
            that the motion does not determine, both biases stay near 0, and their standard deviations are close to
            the argument `gyroscope_bias` of `fit_axis`.
        rms: root mean square of the residuals [rad/s], over the samples at which both angular velocities are finite.
            The residual of a sample is the length of omega1 x n1 minus the length of omega2 x n2. omega1 and omega2
            are the recorded angular velocities, each in its body's axes, minus the biases.
        ok: whether the recorded angular velocities agree with a hinge and determine n1 and n2.
        findings: sentences that say what is wrong with the data, or what the motion does not determine.
    """

    n1: Float64Array
    n2: Float64Array
    std: Float64Array
    covariance: Float64Array
    bias1: Float64Array
    bias2: Float64Array
    bias_std: Float64Array
    rms: float
    ok: bool
    findings: tuple[str, ...]

    def __str__(self) -> str:
        lines = ["hinge axis of two gyroscopes"]
        for name, vector, std in zip(("n1", "n2"), (self.n1, self.n2), np.degrees(self.std), strict=True):
            lines.append(f"{name} = ({', '.join(f'{x:.6g}' for x in vector)}), known to {std:.2g} deg")
        lines.append(f"left: {self.rms:.3g} rad/s rms")
        return report(lines, self.findings, self.ok)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AnchorFit:
    """The result of `fit_anchor`: the vectors from each of two inertial sensors to the hinge point with their
    covariance, the biases of both accelerometers with standard deviations, the rms residual, whether the point is
    reliable (`ok`), and findings.

    Attributes:
        u1: vector from sensor 1 to the hinge point, in body 1's axes [m]; shape (3,).
        u2: vector from sensor 2 to the hinge point, in body 2's axes [m]; shape (3,).
        covariance: covariance matrix of the six components of u1 and u2, in this order [m^2]; shape (6, 6). A
            variance is inf if the motion does not determine the component. The position of the hinge point along the
            hinge axis follows from a convention (see `fit_anchor`) and has no uncertainty in the matrix. A hinge axis
            that was given to `fit_anchor` counts as uncertain as these angular velocities determine it.
        bias1: bias of accelerometer 1 in body 1's axes [m/s^2]; shape (3,).
        bias2: bias of accelerometer 2 in body 2's axes [m/s^2]; shape (3,).
        bias_std: standard deviations of bias1 (first row) and bias2 (second row) [m/s^2]; shape (2, 3). In directions
            that the motion does not determine, both biases stay near 0, and their standard deviations are close to
            the argument `accelerometer_bias` of `fit_anchor`.
        rms: root mean square of the residuals [m/s^2], over the samples that `fit_anchor` uses. The magnitude of the
            specific force at the hinge point is computed from sensor 1 and from sensor 2; the residual is the
            difference of the two values.
        ok: whether the recorded data agree with a point that is fixed in both bodies, and the motion determines this
            point except for its position along the hinge axis.
        findings: sentences that say what is wrong with the data, or what the motion does not determine.
    """

    u1: Float64Array
    u2: Float64Array
    covariance: Float64Array
    bias1: Float64Array
    bias2: Float64Array
    bias_std: Float64Array
    rms: float
    ok: bool
    findings: tuple[str, ...]

    def __str__(self) -> str:
        lines, std = ["hinge point of two inertial sensors"], np.sqrt(np.diagonal(self.covariance)).reshape(2, 3)
        for name, vector, deviations in zip(("u1", "u2"), (self.u1, self.u2), std, strict=True):
            numbers = ", ".join(f"{x:.6g} +- {s:.2g}" for x, s in zip(vector, deviations, strict=True))
            lines.append(f"{name} = ({numbers}) m")
        lines.append(f"left: {self.rms:.3g} m/s^2 rms")
        return report(lines, self.findings, self.ok)


def report(lines: list[str], findings: tuple[str, ...], ok: bool) -> str:
    """Return a report of the lines, the findings and the verdict."""
    return "\n".join((*lines, *findings, "ok" if ok else "NOT RELIABLE"))


def fit_axis(omega1_b1: ArrayLike, omega2_b2: ArrayLike, gyroscope_bias: float = 0.05) -> AxisFit:
    """Fit the hinge axis to the records of two gyroscopes, one on each body, and return an AxisFit. The records
    `omega1_b1` and `omega2_b2` are the angular velocities of body 1 and body 2, in body 1's axes and in body 2's axes
    [rad/s]. `gyroscope_bias` is the expected size of the gyroscopes' biases [rad/s]. Raise FitError if there are too
    few samples or neither body turns.

    Args:
        omega1_b1: angular velocity of body 1 in body 1's axes, S1^T omega1 [rad/s]; shape (N, 3), NaN where a sample
            is missing. Samples must be in the order of time and equally spaced, because the sign of n2 relative to n1
            is found from the changes between successive samples.
        omega2_b2: angular velocity of body 2 in body 2's axes, S2^T omega2, at the same instants [rad/s]; shape
            (N, 3), NaN where a sample is missing.
        gyroscope_bias: expected size of the gyroscopes' biases, as the standard deviation of one component [rad/s];
            0 if the biases were subtracted from the data.

    Returns:
        An AxisFit. Its `n1` and `n2` are unit vectors along the hinge axis, in body 1's axes and in body 2's axes;
        shape (3,). As -n1 and -n2 describe the same hinge, a rule fixes the sign: the first component
        of n1 whose magnitude is at least 0.45 times the largest magnitude is positive. Check `.ok` and
        `.findings` before you use the vectors: if, for example, both bodies turn as one, the motion does not
        determine the axis, and `.ok` is False.

    Raises:
        FitError: there are fewer than 8 instants at which both records are finite, or neither body turns.
        ArgumentError: an argument cannot be used; the error names it.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> t = np.linspace(0, 10, 1000)
    >>> omega1 = np.stack((np.sin(t), np.cos(2 * t), np.sin(3 * t)), axis=-1)
    >>> turn = hp.rodrigues((0, 0, 1), np.sin(t))
    >>> omega2 = np.einsum("nji,nj->ni", turn, omega1 + np.cos(t)[:, None] * np.array([0, 0, 1]))
    >>> fit = hp.fit_axis(omega1, omega2)
    >>> fit.n1.round(9) + 0.0, fit.n2.round(9) + 0.0
    (array([0., 0., 1.]), array([0., 0., 1.]))
    """
    omega1, omega2 = _checked_vectors({"omega1_b1": omega1_b1, "omega2_b2": omega2_b2})
    found = solve_axes(omega1, omega2, number_not_below_0("gyroscope_bias", gyroscope_bias))
    n1, n2, bias1, bias2 = found.unknowns
    findings = [
        Finding(
            f"The axis in body {i}'s axes is known to {np.degrees(s):.2g} deg only."
            if np.isfinite(s)
            else f"The motion does not show the axis in body {i}'s axes: let body {i} turn across it.",
            False,
        )
        for i, s in enumerate(found.std, start=1)
        if s > _MAX_RELIABLE_INERTIAL_AXIS_STD_IN_RADIANS
    ]
    rms = float(np.sqrt(np.mean(found.residuals**2)))
    if rms > _SYSTEMATIC_RATE * found.rms_rate and _neighbour_correlation(found.residuals) > RANDOM:
        text = (
            f"The two rates across the axis differ by {rms:.2g} rad/s rms, and not at random: they do not turn about "
            "one axis, or the clocks of the sensors differ."
        )
        findings.append(Finding(text, False))
    elif rms > _MAX_HARMLESS_RATE_RESIDUAL_TO_RMS_RATE * found.rms_rate:
        text = f"They do not turn about one axis: the two rates across it differ by {rms:.2g} rad/s rms."
        findings.append(Finding(text, False))
    if found.sign_correlation < _MIN_TURN_CORRELATION_THAT_SHOWS_HINGE_AXIS_SIGN:
        text = "The sign of n2 relative to n1 is not determined: the angle does not follow its rate."
        findings.append(Finding(text, False))
    findings += found.clock_findings(None)
    for name, omega in (("omega1_b1", omega1), ("omega2_b2", omega2)):
        findings += [Finding(text, False) for text in suspicions("gyroscope", name, omega)]
    return AxisFit(
        n1=read_only(n1),
        n2=read_only(n2),
        std=read_only(found.std),
        covariance=read_only(found.covariance_of_components()),
        bias1=read_only(bias1),
        bias2=read_only(bias2),
        bias_std=read_only(found.bias_std.reshape(2, 3)),
        rms=rms,
        ok=all(finding.harmless for finding in findings),
        findings=tuple(finding.text for finding in findings),
    )


class Axes(NamedTuple):
    """The hinge axis in the axes of both bodies, from two gyroscopes."""

    unknowns: Float64Array  # n1, n2, bias1, bias2; (4, 3)
    covariance: Float64Array  # of two turns of n1 and two of n2 [rad^2]; (4, 4)
    unseen: NDArray[np.bool_]  # which of these turns the motion does not determine; (4,)
    bias_std: Float64Array  # (6,)
    residuals: Float64Array  # [rad/s]; (M,)
    rms_rate: float  # [rad/s]
    sign_correlation: float
    offset: float  # samples by which body 2 was recorded later than body 1 at equal rows
    offset_std: float
    offset_effect: float  # on an axis, in standard deviations
    offset_gain: float  # of the rms residual without the offset, in parts of that with it

    @property
    def std(self) -> Float64Array:
        """Return the standard deviations of n1 and n2 in their least certain directions [rad]."""
        variances = np.where(self.unseen, np.inf, np.diagonal(self.covariance)).reshape(2, 2)
        return np.asarray(np.sqrt(variances.max(axis=1)))

    def covariance_of_components(self) -> Float64Array:
        """Return the covariance (6, 6) of the components of n1 and n2, inf where they are not determined."""
        change = np.zeros((6, 4))
        for i, n in enumerate(self.unknowns[:2]):
            change[3 * i : 3 * i + 3, 2 * i : 2 * i + 2] = frame(n)[:, :2]
        covariance = change @ self.covariance @ change.T
        hidden = change**2 @ self.unseen > 1e-3
        covariance[hidden, hidden] = np.inf
        return np.asarray(covariance)

    def shows_offset(self) -> bool:
        """Return whether both clocks differ, and by more than the axis allows for."""
        return abs(self.offset) > max(_MIN_OFFSET_IN_STDS * self.offset_std, _MIN_OFFSET) and (
            self.offset_effect > _MIN_OFFSET_EFFECT or self.offset_gain > _MIN_OFFSET_GAIN
        )

    def clock_findings(self, step: float | None) -> list[Finding]:
        """Return a list with one Finding if the clocks differ. `step` is the time between samples [s]; None: not
        known.
        """
        if not self.shows_offset():
            return []
        how = f"{abs(self.offset):.2g} samples" if step is None else f"{1e3 * step * abs(self.offset):.3g} ms"
        order = "later" if self.offset > 0 else "earlier"
        text = f"Body 2 was recorded {how} {order} than body 1 at equal rows: the clocks of the sensors differ"
        return [Finding(f"{text}. fit_imus corrects this.", False)]


def solve_axes(omega1: Float64Array, omega2: Float64Array, bias: float, start: Float64Array | None = None) -> Axes:
    """Return the Axes of angular velocities (N, 3) in the axes of their bodies, NaN where missing. `bias` is the
    expected size of the biases [rad/s], and `start` (2, 3) a first estimate of n1 and n2. Raise FitError as
    `fit_axis` does.
    """
    known = np.isfinite(omega1).all(axis=-1) & np.isfinite(omega2).all(axis=-1)
    size = float(np.sqrt((omega1[known] ** 2).sum() + (omega2[known] ** 2).sum()))
    if known.sum() < MIN_PIECE or size == 0:
        expected = f"at least {MIN_PIECE} finite samples of bodies that turn"
        raise FitError("omega1_b1, omega2_b2", expected, int(known.sum()))
    w1, w2 = omega1[known], omega2[known]
    step = -(-w1.shape[0] // _START_SAMPLES)
    thin1, thin2 = w1[::step], w2[::step]
    axes, residuals = _fit_from_starts(
        _rate_residual_function(thin1, thin2),
        _rate_residual_function(w1, w2),
        _step_axes_and_biases,
        _axis_starts(thin1, thin2) if start is None else [start],
    )
    unknowns, prior = np.concatenate((axes, np.zeros((2, 3)))), np.zeros(6)
    if bias > 0 and residuals @ residuals > (_ROUNDING * size) ** 2:
        for _ in range(_BIAS_ROUNDS):
            prior = np.full(6, np.sqrt(residuals @ residuals / residuals.size) / bias)
            unknowns, all_residuals = _levenberg_marquardt(
                _rate_residual_function(w1, w2, prior), _step_axes_and_biases, unknowns
            )
            residuals = all_residuals[: w1.shape[0]]
    n1, n2, bias1, bias2 = unknowns
    sign_correlations = [sign_correlation(omega1 - bias1, omega2 - bias2, n1, sign * n2) for sign in (1, -1)]
    if sign_correlations[1] > sign_correlations[0]:
        n2 = -n2
    n1, n2 = sign_of(n1) * n1, sign_of(n1) * n2
    unknowns = np.stack((n1, n2, bias1, bias2))
    _, derivatives = _rate_residual_function(w1, w2, prior)(unknowns)
    sample_derivatives, prior_derivatives, bias_std = _derivatives_without_biases(
        derivatives, 4, residuals, prior, bias
    )
    covariance, unseen = _covariance(
        np.zeros(4),
        residuals,
        sample_derivatives,
        residuals @ residuals / 2 * np.eye(4),
        _MIN_SIGNAL_TO_NOISE_POWER_OF_DETERMINED_HINGE_AXIS,
        prior_derivatives,
    )
    is_systematic = (
        np.sqrt(np.mean(residuals**2)) > _SYSTEMATIC_RATE * size / np.sqrt(2 * w1.shape[0])
        and _neighbour_correlation(residuals) > RANDOM
    )
    lag, lag_std, moved, least = _fit_lag(omega1, omega2, unknowns, prior, is_systematic)
    across = np.where(unseen, 0.0, np.diagonal(covariance))
    turned = np.concatenate([frame(n)[:, :2].T @ m for n, m in zip(unknowns[:2], moved[:2], strict=True)])
    return Axes(
        unknowns,
        covariance,
        unseen,
        bias_std,
        residuals,
        float(size / np.sqrt(2 * w1.shape[0])),
        max(sign_correlations),
        -lag,
        lag_std,
        float(np.max(np.abs(turned) / np.sqrt(np.maximum(across, 1e-24)))),
        float(np.sqrt(np.mean(residuals**2))) / least,
    )


def _fit_lag(
    omega1: Float64Array, omega2: Float64Array, unknowns: Float64Array, prior: Float64Array, search: bool
) -> tuple[float, float, Float64Array, float]:
    """Return the number of rows by which the record of sensor 2 is to be read later to agree best with that of sensor
    1, its standard deviation, the unknowns (4, 3) that go with it, and the rms residual. If `search` is True, other
    lags than those near 0 are tried too.

    A lag within half a row moves a reading along its derivative: the slope of a parabola through seven readings, in
    which the reading itself has no part, so that its noise makes no bias.
    """
    change = np.full_like(omega2, np.nan)
    if omega2.shape[0] < 4 * _LAG_WINDOW:
        return 0.0, np.inf, unknowns, np.inf
    weights = np.arange(-_LAG_WINDOW, _LAG_WINDOW + 1)
    windows = np.lib.stride_tricks.sliding_window_view(omega2, weights.size, axis=0)
    change[_LAG_WINDOW:-_LAG_WINDOW] = windows @ weights / (weights @ weights)
    stride = -(-omega1.shape[0] // _MAX_LAG_SAMPLES)
    starts = [0.0]
    if search:
        speed, pace = (float(np.sqrt(np.nanmedian((x * x).sum(axis=1)))) for x in (omega2, change))
        gap = max(1.0, np.rint(0.3 * speed / max(pace, 1e-300)))
        most = min(omega1.shape[0] // 4, 40 * gap)
        starts += [sign * lag for lag in np.arange(gap, most, gap) for sign in (1, -1)]
    found = [
        _lag_from(omega1, omega2, change, unknowns, prior, start, max(stride, 4 * stride * search))
        for start in starts
    ]
    best = min(found, key=lambda each: each[3])
    if search:
        best = _lag_from(omega1, omega2, change, best[2], prior, best[0], stride)
    return best


def _lag_from(
    omega1: Float64Array,
    omega2: Float64Array,
    change: Float64Array,
    unknowns: Float64Array,
    prior: Float64Array,
    lag: float,
    stride: int,
) -> tuple[float, float, Float64Array, float]:
    """Return the lag that Gauss-Newton steps reach from `lag`, its standard deviation, the unknowns, and the rms
    residual. `change` (N, 3) is the change of omega2 from row to row; every `stride`-th row is used.
    """
    has_biases, start, std, rms = bool(prior.any()), lag, np.inf, np.inf
    rows = np.arange(0, omega1.shape[0], stride)
    for _ in range(_LAG_STEPS):
        place = rows + int(np.rint(lag))
        inside = (place >= 0) & (place < omega2.shape[0])
        w1, w2, d = omega1[rows[inside]], omega2[place[inside]], change[place[inside]]
        known = np.isfinite(w1 + w2 + d).all(axis=1)
        if known.sum() < 4 * MIN_PIECE:
            return start, np.inf, unknowns, np.inf
        w1, w2, d = w1[known], w2[known] + (lag - np.rint(lag)) * d[known], d[known]
        x = unknowns if has_biases else unknowns[:2]
        residuals, derivatives = _rate_residual_function(w1, w2, prior if has_biases else None)(x)
        across = (w2 - x[3] if has_biases else w2) @ frame(x[1])[:, :2]
        by_lag = np.zeros(residuals.size)
        by_lag[: w1.shape[0]] = -np.einsum("ni,ni->n", across, d @ frame(x[1])[:, :2]) / np.maximum(
            np.linalg.norm(across, axis=1), 1e-300
        )
        own = by_lag - derivatives @ np.linalg.lstsq(derivatives, by_lag)[0]
        power = max(float(own @ own), 1e-300)
        std = float(np.sqrt(score_scatter((own * residuals)[None])[0][0, 0])) / power
        rms = float(np.sqrt(residuals @ residuals / residuals.size))
        step = -np.asarray(np.linalg.lstsq(np.column_stack((derivatives, by_lag)), residuals)[0])
        step *= min(1.0, 0.3 / max(float(np.abs(step[:4]).max()), 1e-300), 3.0 / max(abs(float(step[-1])), 1e-300))
        moved = _step_axes_and_biases(x, step[:-1])
        unknowns = moved if has_biases else np.concatenate((moved, unknowns[2:]))
        lag += float(step[-1])
        if abs(step[-1]) < 1e-3 * std or abs(step[-1]) < 1e-9:
            break
    # what noise of the readings alone, which neighbours do not share, makes of the derivatives
    noise = float((np.diff(residuals) ** 2).sum()) / 4 / _SLOPE_WEIGHTS
    return (lag, std, unknowns, rms) if power > _MIN_LAG_SIGNAL * noise else (lag, np.inf, unknowns, rms)


def fit_anchor(
    t: ArrayLike,
    omega1_b1: ArrayLike,
    f1_b1: ArrayLike,
    omega2_b2: ArrayLike,
    f2_b2: ArrayLike,
    n1: ArrayLike | None = None,
    n2: ArrayLike | None = None,
    gaps: float = 0.05,
    gyroscope_bias: float = 0.05,
    accelerometer_bias: float = 0.2,
) -> AnchorFit:
    """Fit the hinge point to the records of two inertial sensors, one on each body, and return an AnchorFit. Each
    sensor records an angular velocity (`omega1_b1`, `omega2_b2`) and a specific force (`f1_b1`, `f2_b2`). If the
    hinge axis is given in the axes of both bodies (n1, n2), the result is the point on the axis closest to sensor 1.
    `gaps` is the longest time without samples across which angular velocities are smoothed [s]. Raise FitError if
    there are too few samples or neither body turns.

    You may choose the axes of each sensor as the axes of its body. The angular velocities are smoothed and
    differentiated with the method of `smooth`. The specific forces are used as recorded. The biases of both
    gyroscopes and of both accelerometers are estimated together with the hinge point.

    Each of the four records may have NaN where a sample is missing. An instant is used if all four records are finite
    there, and if it belongs to a series of at least 8 such instants without a gap.

    Args:
        t: instants, increasing: seconds (floats), datetime64, or nanoseconds since 1970 (integers); shape (N,).
        omega1_b1: angular velocity of body 1 in body 1's axes [rad/s]; shape (N, 3).
        f1_b1: specific force that accelerometer 1 measures, in body 1's axes [m/s^2]; shape (N, 3). The specific
            force is S1^T (a - g), where a is the acceleration of the sensor and g = (0, 0, -9.81) is the acceleration
            of free fall, both in world axes.
        omega2_b2: angular velocity of body 2 in body 2's axes [rad/s]; shape (N, 3).
        f2_b2: specific force that accelerometer 2 measures, in body 2's axes [m/s^2]; shape (N, 3).
        n1: hinge axis in body 1's axes, as found by `fit_axis`; shape (3,). Give both n1 and n2 or neither. If they
            are given, the hinge point is the point on the axis closest to sensor 1. Otherwise the axis is estimated,
            and the hinge point is the point on it at which the sum of the squared distances to both sensors is
            smallest.
        n2: hinge axis in body 2's axes; shape (3,).
        gaps: longest time without a sample across which the angular velocities are smoothed [s]. A longer time is a
            gap. A value below 1.5 times the median time step counts as 1.5 times the median time step.
        gyroscope_bias: expected size of the gyroscopes' biases, as the standard deviation of one component [rad/s]; 0
            if the biases were subtracted from the data, for example the biases that `fit_axis` estimates.
        accelerometer_bias: expected size of the accelerometers' biases, as the standard deviation of one component
            [m/s^2]; 0 if the biases were subtracted from the data.

    Returns:
        The AnchorFit. `.u1` is the vector from sensor 1 to the hinge point in body 1's axes [m], and `.u2` is the
        vector from sensor 2 to the hinge point in body 2's axes [m]. Check `.ok` and `.findings` before you use the
        numbers of the AnchorFit.

    Raises:
        FitError: no series of samples without a gap has 8 samples or more, or neither body turns.
        ArgumentError: an argument cannot be used; the error names it.
        MissingDependencyError: SciPy is not installed.
    """
    named_vectors = {"omega1_b1": omega1_b1, "f1_b1": f1_b1, "omega2_b2": omega2_b2, "f2_b2": f2_b2}
    time, columns = checked_recording(t, named_vectors)
    if (n1 is None) != (n2 is None):
        raise ArgumentError(
            "n2" if n2 is None else "n1", f"an axis, since {'n1' if n2 is None else 'n2'} is given", None
        )
    omega1, force1, omega2, force2 = columns
    known: NDArray[np.bool_] = np.asarray(np.isfinite(np.concatenate(columns, axis=-1)).all(axis=-1))
    pieces = split_at_gaps(time, known, checked_gaps(gaps), MIN_PIECE)
    if not pieces:
        raise FitError(
            ", ".join(named_vectors),
            f"at least {MIN_PIECE} finite samples without a gap",
            int(known.sum()),
        )
    used = np.concatenate(pieces)
    smooth = [smooth_columns(time, omega, pieces, None) for omega in (omega1, omega2)]
    gammas = [acceleration_matrices(*each.values[:2, used]) for each in smooth]
    if not any(np.abs(gamma).max() > 0 for gamma in gammas):
        raise FitError("omega1_b1, omega2_b2", "bodies that turn", "none that does")

    bias_stds = np.repeat(
        (
            number_not_below_0("accelerometer_bias", accelerometer_bias),
            number_not_below_0("gyroscope_bias", gyroscope_bias),
        ),
        6,
    )
    forces = [force[used] for force in (force1, force2)]
    rates, rate_derivatives = [[each.values[order, used] for each in smooth] for order in range(2)]
    unknowns, residuals, prior = _point_and_biases(forces, rates, rate_derivatives, bias_stds)
    try:
        known_axes = (
            None
            if n1 is None or n2 is None
            else np.stack([unit_axis(name, np.asarray(n)) for name, n in (("n1", n1), ("n2", n2))])
        )
        axes = solve_axes(omega1, omega2, bias_stds[-1], known_axes)
    except FitError:
        axes = None  # the angular velocities show no axis
    if known_axes is not None:
        unknowns, residuals = _point_across(forces, rates, rate_derivatives, prior, unknowns, known_axes)
    u = unknowns[:6]
    _, derivatives = _force_residual_function(forces, rates, rate_derivatives, prior)(unknowns)
    sample_derivatives, prior_derivatives, bias_std = _derivatives_without_biases(
        derivatives, 6, residuals, prior, bias_stds
    )
    derivatives = np.concatenate((sample_derivatives, prior_derivatives))
    if known_axes is None:
        along = np.linalg.eigh(derivatives.T @ derivatives)[1][:, 0]
        u = u - along * (along @ u)  # what is along both axes is not seen
        across = np.linalg.svd(along[None])[2][1:].T
    else:
        across = np.linalg.svd(np.concatenate((known_axes[0], np.zeros(3)))[None])[2][1:].T
    deviations = [each.deviations[1, used] for each in smooth]
    noise = _lever_noise_matrix(forces, gammas, u, deviations)
    inner, unseen = _covariance(
        across.T @ u,
        residuals,
        sample_derivatives @ across,
        across.T @ noise @ across,
        _MIN_SIGNAL_TO_NOISE_POWER_OF_DETERMINED_HINGE_POINT,
        prior_derivatives @ across,
    )
    covariance = across @ inner @ across.T
    if known_axes is not None and axes is not None:
        # an axis that is off moves the point that is closest to sensor 1 along the axis
        turns = np.where(axes.unseen, 0.0, 1.0) * np.pad(u[:3] @ frame(axes.unknowns[0])[:, :2], (0, 2))
        covariance += float(turns @ axes.covariance @ turns) * np.outer(known_axes, known_axes)
    hidden = across**2 @ unseen > 1e-3
    covariance[hidden, hidden] = np.inf
    std = float(np.sqrt(np.diagonal(covariance).max()))
    findings = [Finding(text, False) for text in _point_sentences(std, u, residuals, forces)]
    if axes is not None:
        findings += axes.clock_findings(float(np.median(np.diff(time))))
    findings += recording_suspicions(t, named_vectors)
    return AnchorFit(
        u1=read_only(u[:3]),
        u2=read_only(u[3:]),
        covariance=read_only(covariance),
        bias1=read_only(unknowns[6:9]),
        bias2=read_only(unknowns[9:12]),
        bias_std=read_only(bias_std[:6].reshape(2, 3)),
        rms=float(np.sqrt(residuals @ residuals / used.size)),
        ok=all(finding.harmless for finding in findings),
        findings=tuple(finding.text for finding in findings),
    )


def recording_suspicions(t: ArrayLike, named_vectors: dict[str, ArrayLike]) -> list[Finding]:
    """Return a list of findings on readings or instants that are probably in another unit than expected."""
    texts = suspicions("instants", "t", increasing_seconds("t", t)[0])
    for name, column in named_vectors.items():
        texts += suspicions("gyroscope" if name.startswith("omega") else "accelerometer", name, column)
    return [Finding(text, False) for text in texts]


def _point_across(
    forces: list[Float64Array],
    rates: list[Float64Array],
    rate_derivatives: list[Float64Array],
    prior: Float64Array,
    start: Float64Array,
    axes: Float64Array,
) -> tuple[Float64Array, Float64Array]:
    """Return the unknowns (18,) and the residuals (N,) of the point at which u1 is across n1, from the unknowns
    `start`; `axes` (2, 3) are n1 and n2. What is along the axis is not seen, so it must not be left to the noise.
    """
    along = np.concatenate((axes[0], np.zeros(3)))
    size = 18 if prior.any() else 6
    within = np.linalg.svd(np.pad(along, (0, size - 6))[None])[2][1:].T
    linearise = _force_residual_function(forces, rates, rate_derivatives, prior if prior.any() else None)

    def inner(y: Float64Array) -> tuple[Float64Array, Float64Array]:
        residuals, derivatives = linearise(within @ y)
        return residuals, derivatives @ within

    x = start.copy()
    x[:6] -= (start[:3] @ axes[0]) * axes.ravel()
    y, residuals = _levenberg_marquardt(inner, np.add, within.T @ x[:size])
    x[:size] = within @ y
    return x, residuals[: rates[0].shape[0]]


def _point_sentences(std: float, u: Float64Array, residuals: Float64Array, forces: list[Float64Array]) -> list[str]:
    """Return a list of sentences that say why the fitted hinge point is not reliable, empty if it is. `std` is the
    largest standard deviation of a coordinate [m], `u` are both levers (6,) [m]. `residuals`
    (N,) are the differences of the forces' sizes at the hinge point [m/s^2], and `forces` the pair of measured
    specific forces (N, 3).
    """
    lengths = np.linalg.norm(u.reshape(2, 3), axis=1)
    lever_length = max(float(lengths.max()), _MIN_REFERENCE_LEVER_LENGTH_IN_METRES)
    findings = []
    if not std <= RELIABLE_POINT * lever_length:
        how = f"is known to {std:.2g} m only" if np.isfinite(std) else "is not shown"
        findings.append(f"The hinge point {how}: let both bodies turn faster, about more than one direction.")
    rms = float(np.sqrt(np.mean(residuals**2)))
    apart = np.linalg.norm(forces[0], axis=1) - np.linalg.norm(forces[1], axis=1)
    if (
        rms > _MAX_HARMLESS_SYSTEMATIC_FORCE_RESIDUAL_TO_RMS_FORCE_DIFFERENCE * np.sqrt(np.mean(apart**2))
        and _neighbour_correlation(residuals) > RANDOM
    ):
        findings.append(
            f"The forces at the hinge point differ by {rms:.2g} m/s^2 rms, and not at random: no point is in both "
            "bodies, or the clocks, units or axes of the sensors differ."
        )
    return findings


def _neighbour_correlation(residuals: Float64Array) -> float:
    """Return the correlation of residuals (N,) with their neighbours; 0 if all residuals are 0."""
    power = float(residuals @ residuals)
    return float(residuals[1:] @ residuals[:-1]) / power if power > 0 else 0.0


def checked_recording(t: ArrayLike, named_vectors: dict[str, ArrayLike]) -> tuple[Float64Array, list[Float64Array]]:
    """Return a tuple of the instants (N,) of a recording [s], counted from the first, and a list of the recorded
    vectors as float64 arrays (N, 3). `named_vectors` is a dict of the arrays by argument name. Raise ArgumentError
    for unusable values, and ShapeError if the lengths differ.
    """
    time, _ = increasing_seconds("t", t)
    columns = _checked_vectors(named_vectors)
    if columns[0].shape[0] != time.size:
        raise ShapeError(next(iter(named_vectors)), f"shape ({time.size}, 3), as t", f"shape {columns[0].shape}")
    return time, columns


def _checked_vectors(named_vectors: dict[str, ArrayLike]) -> list[Float64Array]:
    """Return the vectors of the dict `named_vectors`, by argument name, as a list of float64 arrays of one shape (N,
    3). Raise ShapeError that names the first array of another shape.
    """
    arrays = [vectors(name, value, 3).astype(np.float64) for name, value in named_vectors.items()]
    for name, array in zip(named_vectors, arrays, strict=True):
        if array.ndim != 2 or array.shape != arrays[0].shape:
            shape = (
                f"shape {arrays[0].shape}, as {next(iter(named_vectors))}" if arrays[0].ndim == 2 else "shape (N, 3)"
            )
            raise ShapeError(name, shape, f"shape {array.shape}")
    return arrays


def _point_and_biases(
    forces: list[Float64Array],
    rates: list[Float64Array],
    rate_derivatives: list[Float64Array],
    bias_stds: Float64Array,
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Fit the levers (u1, u2) and the biases of both sensors by least squares. Return a tuple of the unknowns in one
    array (18,), the residuals of the samples (N,), and the weights of the priors (12,) that hold the biases near 0.
    The biases and the weights are 0 if no bias is expected or rounding explains the residuals. `forces`, `rates` and
    `rate_derivatives` are lists of two arrays (N, 3), one for each sensor; `bias_stds` (12,) are the expected sizes
    of the biases.

    The biases are those of both accelerometers, then of both gyroscopes. A weight is the standard deviation of a
    residual divided by that of the bias.
    """
    count = rates[0].shape[0]
    rng = np.random.default_rng(0)
    starts = [np.zeros(6), *rng.normal(scale=0.3, size=(5, 6))]
    some = slice(None, None, -(-count // _START_SAMPLES))
    thin1, thin2, thin3 = ([each[some] for each in parts] for parts in (forces, rates, rate_derivatives))
    u, residuals = _fit_from_starts(
        _force_residual_function(thin1, thin2, thin3),
        _force_residual_function(forces, rates, rate_derivatives),
        np.add,
        starts,
    )
    unknowns, prior = np.concatenate((u, np.zeros(12))), np.zeros(12)
    if bias_stds.any() and residuals @ residuals > _ROUNDING**2 * sum(
        float((force * force).sum()) for force in forces
    ):
        for _ in range(_BIAS_ROUNDS):
            noise = np.sqrt(residuals @ residuals / residuals.size)
            prior = noise / np.where(bias_stds > 0, bias_stds, 1e-9)  # 0: known to be without bias
            unknowns, all_residuals = _levenberg_marquardt(
                _force_residual_function(forces, rates, rate_derivatives, prior), np.add, unknowns
            )
            residuals = all_residuals[:count]
    return unknowns, residuals, prior


def _lever_noise_matrix(
    forces: list[Float64Array], gammas: list[Float64Array], u: Float64Array, deviations: list[Float64Array]
) -> Float64Array:
    """Return the matrix (6, 6) that noise of the angular accelerations adds to the normal matrix of the levers `u` =
    (u1, u2). For each of the two bodies, `forces` holds the specific forces (N, 3), `gammas` the matrices (N, 3, 3)
    that convert a lever to an acceleration, and `deviations` the standard deviations (N,) of the angular
    accelerations.
    """
    noise = np.zeros((6, 6))
    for rows, force, gamma, deviation in zip((slice(0, 3), slice(3, 6)), forces, gammas, deviations, strict=True):
        felt = force + gamma @ u[rows]
        felt /= np.maximum(np.linalg.norm(felt, axis=-1, keepdims=True), 1e-300)
        variances = deviation**2
        noise[rows, rows] = variances.sum() * np.eye(3) - (felt * variances[:, None]).T @ felt
    return noise


def _derivatives_without_biases(
    derivatives: Float64Array,
    num_parameters: int,
    residuals: Float64Array,
    prior: Float64Array,
    bias_stds: float | Float64Array,
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Return (derivatives of the samples' residuals (N, k), derivatives of the priors' residuals (b, k), standard
    deviations of the biases (b,)). The derivatives are with respect to the k = `num_parameters` parameters, without
    the part that a change of the b biases could explain. `prior` holds the weights of the priors and `bias_stds` the
    expected sizes of the biases. If all weights are 0, the derivatives of the samples and `bias_stds` are returned
    unchanged, with no derivatives of priors.

    Args:
        derivatives: of the residuals by the k parameters and b biases, priors of biases last; (N + b, k + b), or
            (N, k + b) where there is no prior.
        num_parameters: k.
        residuals: residuals of the samples; (N,).
        prior: standard deviation of a residual in those of each bias; (b,).
        bias_stds: standard deviations of the biases beforehand.

    Returns:
        Derivatives of the samples (N, k), those of the priors (b, k), and standard deviations of the biases (b,).
    """
    samples, biases = residuals.size, derivatives.shape[1] - num_parameters
    if not prior.any():
        return (
            derivatives[:samples, :num_parameters],
            np.zeros((0, num_parameters)),
            np.broadcast_to(bias_stds, biases).astype(np.float64),
        )
    parameter_part, bias_part = derivatives[:, :num_parameters], derivatives[:, num_parameters:]
    without_biases = parameter_part - bias_part @ np.linalg.lstsq(bias_part, parameter_part)[0]
    without_parameters = bias_part - parameter_part @ np.linalg.lstsq(parameter_part, bias_part)[0]
    deviations = np.sqrt(
        np.mean(residuals * residuals) * np.diagonal(np.linalg.pinv(without_parameters.T @ without_parameters))
    )
    return without_biases[:samples], without_biases[samples:], deviations


def _force_residual_function(
    forces: list[Float64Array],
    rates: list[Float64Array],
    rate_derivatives: list[Float64Array],
    prior: Float64Array | None = None,
) -> Linearise:
    """Return a function of the levers (u1, u2), one array (6,), that returns residuals (N,) and their derivatives (N,
    6). A residual is the difference between the sizes of both specific forces at the hinge point. `forces`, `rates`
    (angular velocities) and `rate_derivatives` are lists of two arrays (N, 3), one for each sensor. With `prior`, the
    weights of priors, biases are further unknowns.

    With priors the biases of both accelerometers and of both gyroscopes are unknowns too; then the shapes are
    (N + 12,) and (N + 12, 18).
    """

    def linearise(x: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return a pair at the unknowns x: the residuals of the samples and then of the priors, and their derivatives
        with respect to the unknowns.
        """
        biases = np.zeros(12) if prior is None else x[6:]
        felt, by_lever, by_bias, by_rate = [], [], [], []
        for i, (force, omega, alpha) in enumerate(zip(forces, rates, rate_derivatives, strict=True)):
            components = slice(3 * i, 3 * i + 3)
            u, turning = x[components], omega - biases[6:][components]
            gamma = acceleration_matrices(turning, alpha)
            hinge_force = force - biases[components] + gamma @ u
            size = np.maximum(np.linalg.norm(hinge_force, axis=-1), 1e-300)
            unit = hinge_force / size[:, None]
            felt.append(size)
            by_lever.append((unit[:, None] @ gamma)[:, 0])
            if prior is not None:
                by_bias.append(-unit)
                # of turning x (turning x u), less the bias
                arm = np.cross(turning, u)
                by_rate.append(np.cross(arm, -unit) - np.cross(np.cross(unit, turning), u))
        differences = felt[0] - felt[1]
        derivatives = np.concatenate((by_lever[0], -by_lever[1]), axis=-1)
        if prior is None:
            return differences, derivatives
        derivatives = np.concatenate((derivatives, by_bias[0], -by_bias[1], by_rate[0], -by_rate[1]), axis=-1)
        rows = np.concatenate((np.zeros((12, 6)), np.diag(prior)), axis=1)
        return np.concatenate((differences, prior * biases)), np.concatenate((derivatives, rows))

    return linearise


def _axis_starts(w1: Float64Array, w2: Float64Array) -> list[Float64Array]:
    """Return a list of pairs (n1, n2) of axes, shape (2, 3) each, from which fits start: the solution of linear least
    squares for the matrices n n^T, the principal axes of the angular velocities, and ten random pairs (fixed seed).
    `w1` and `w2` are angular velocities (N, 3).
    """
    rows = [np.einsum("ni,nj->nij", w, w).reshape(-1, 9) for w in (w1, w2)]
    size = (w1 * w1).sum(axis=-1) - (w2 * w2).sum(axis=-1)
    squares = np.linalg.lstsq(np.concatenate((rows[0], -rows[1]), axis=-1), size)[0].reshape(2, 3, 3)
    linear = np.linalg.eigh((squares + np.swapaxes(squares, -1, -2)) / 2)[1][..., -1]
    principal = np.linalg.eigh(np.stack((w1.T @ w1, w2.T @ w2)))[1][..., -1]
    random = np.random.default_rng(0).normal(size=(10, 2, 3))
    random /= np.linalg.norm(random, axis=-1, keepdims=True)
    return [linear, principal, *random]


def _rate_residual_function(w1: Float64Array, w2: Float64Array, prior: Float64Array | None = None) -> Linearise:
    """Return a function of the axes (n1, n2), one array (2, 3), that returns residuals (N,) and their derivatives (N,
    4). A residual is the difference between the sizes of both angular velocities across the axes. `w1` and `w2` are
    the measured angular velocities (N, 3). With `prior`, the weights of priors, biases are further unknowns.

    The derivatives are by two turns of each axis across itself. With priors the function is one of (n1, n2, bias1,
    bias2), and the shapes are (N + 6,) and (N + 6, 10).
    """

    def linearise(x: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return a pair at the unknowns x: the residuals of the samples and then of the priors, and their derivatives
        with respect to the unknowns.
        """
        axes, biases = x[:2], np.zeros((2, 3)) if prior is None else x[2:]
        frames = [frame(n) for n in axes]
        in_axes = [(w - bias) @ axes_frame for w, bias, axes_frame in zip((w1, w2), biases, frames, strict=True)]
        sizes = [np.maximum(np.hypot(w[:, 0], w[:, 1]), 1e-300) for w in in_axes]
        rows = [-w[:, 2:] * w[:, :2] / size[:, None] for w, size in zip(in_axes, sizes, strict=True)]
        differences, derivatives = sizes[0] - sizes[1], np.concatenate((rows[0], -rows[1]), axis=-1)
        if prior is None:
            return differences, derivatives
        by_bias = [
            -(w[:, :2] / size[:, None]) @ axes_frame[:, :2].T
            for w, size, axes_frame in zip(in_axes, sizes, frames, strict=True)
        ]
        derivatives = np.concatenate((derivatives, by_bias[0], -by_bias[1]), axis=-1)
        prior_rows = np.concatenate((np.zeros((6, 4)), np.diag(prior)), axis=1)
        return np.concatenate((differences, prior * biases.ravel())), np.concatenate((derivatives, prior_rows))

    return linearise


def _step_axes_and_biases(axes: Float64Array, step: Float64Array) -> Float64Array:
    """Return `axes` after a step: an array (2, 3) of the axes n1 and n2, or (4, 3) if the biases of both sensors
    follow. The step holds two rotations [rad] of each axis, then the changes of the biases.
    """
    tilted_axes = np.stack(
        [tilt_axis(n, rotations) for n, rotations in zip(axes[:2], step[:4].reshape(2, 2), strict=True)]
    )
    return np.concatenate((tilted_axes, axes[2:] + step[4:].reshape(-1, 3)))


def sign_correlation(omega1: Float64Array, omega2: Float64Array, n1: Float64Array, n2: Float64Array) -> float:
    """Return the correlation between two estimates of the changes of the hinge angle: one from the angular velocities
    across the axis, the other from the integrated angular velocity about the axis. It is positive if n1 and n2 point
    in the same direction along the axis. `omega1` and `omega2` are the angular velocities (N, 3) in the axes of their
    bodies.

    Changes are taken over one, four, sixteen ... steps and the largest correlation counts: over few steps noise
    exceeds the change, over many the angle turns around.
    """
    a, b = omega1 @ frame(n1), omega2 @ frame(n2)
    across = (a[:, 0] + 1j * a[:, 1]) * (b[:, 0] - 1j * b[:, 1])
    rate = b[:, 2] - a[:, 2]
    turned = np.cumsum(np.nan_to_num(rate))
    best, lag = -1.0, 1
    while lag <= min(256, rate.size // 4):
        step, middle = across[lag:] * np.conj(across[:-lag]), turned[lag:] - turned[:-lag]
        known = np.isfinite(step)
        weight, turn, middle = np.abs(step[known]), np.angle(step[known]), middle[known]
        power = (weight @ (turn * turn)) * (weight @ (middle * middle))
        best = max(best, float(weight @ (turn * middle) / np.sqrt(power)) if power > 0 else 0.0)
        lag *= 4
    return best


def acceleration_matrices(omega: Float64Array, alpha: Float64Array) -> Float64Array:
    """Return matrices (N, 3, 3) that convert a lever to the acceleration of its end relative to its start."""
    W = np.asarray(skew(omega), dtype=np.float64)
    return np.asarray(W @ W + skew(alpha), dtype=np.float64)


def _fit_from_starts(
    linearise_few: Linearise, linearise: Linearise, move: Move, starts: Iterable[Float64Array]
) -> tuple[Float64Array, Float64Array]:
    """Return (solution, residuals): the least-squares solution that is reached from the best of several starts, and
    the residuals at the solution. `linearise` is a function of the unknowns that returns residuals and derivatives.
    `linearise_few` is such a function for fewer samples, by which the starts are compared. `move` is a function that
    returns the unknowns after a step.
    """
    tried = [_levenberg_marquardt(linearise_few, move, start, max_steps=12) for start in starts]
    return _levenberg_marquardt(linearise, move, min(tried, key=lambda solution: float(solution[1] @ solution[1]))[0])


def _levenberg_marquardt(
    linearise: Linearise, move: Move, start: Float64Array, max_steps: int = 60
) -> tuple[Float64Array, Float64Array]:
    """Return (solution, residuals): the least-squares solution that the Levenberg-Marquardt method reaches from
    `start` in at most `max_steps` steps, and the residuals at the solution. `linearise` is a function of the unknowns
    that returns residuals and derivatives; `move` is a function that returns the unknowns after a step. A solution
    that has not converged is returned without a warning.
    """
    unknowns, (residuals, derivatives) = start, linearise(start)
    cost, damping = float(residuals @ residuals), 1e-3
    for _ in range(max_steps):
        normal = derivatives.T @ derivatives
        step = -np.asarray(
            np.linalg.lstsq(normal + damping * np.diag(np.diagonal(normal)), derivatives.T @ residuals)[0]
        )
        trial_unknowns = move(unknowns, step)
        trial = linearise(trial_unknowns)
        size = float(trial[0] @ trial[0])
        if size <= cost:
            settled = float(np.abs(step).max()) < 1e-13 or cost - size < 1e-15 * cost
            unknowns, (residuals, derivatives), cost, damping = trial_unknowns, trial, size, damping / 10
            if settled:
                break
        else:
            damping *= 10
            if damping > 1e12:
                break
    return unknowns, residuals


def _covariance(
    parameters: Float64Array,
    residuals: Float64Array,
    derivatives: Float64Array,
    noise: Float64Array,
    min_signal: float,
    prior_rows: Float64Array,
) -> tuple[Float64Array, NDArray[np.bool_]]:
    """Return a tuple of the covariance (k, k) of parameters fitted by least squares, and a boolean array (k,) of the
    parameters that the motion does not determine. `noise` (k, k) is what noise in the derivatives adds to the normal
    matrix, and `min_signal` the minimum ratio of the normal matrix to `noise` in a determined direction. `prior_rows`
    (b, k) are the derivatives of the priors.

    Noise in the derivatives adds to the normal matrix, by which parameters come out too small. The matrix without
    that noise says how sure a direction is: the scatter of the scores is divided by it (the sandwich; scores
    of neighbours are added up before they are squared), and the parameters' shrinking is taken for a further error.

    Args:
        parameters: the parameters, from where noise does not shrink them; (k,).
        residuals: what is left of each sample; (N,).
        derivatives: its derivatives by the parameters; (N, k).
        noise: what noise in `derivatives` adds to the normal matrix; (k, k).
        min_signal: size of the normal matrix from which a direction is shown, in parts of what noise adds to it.
        prior_rows: rows of priors, whose residuals scatter like those of the samples; (b, k).
    """
    normal = derivatives.T @ derivatives + prior_rows.T @ prior_rows
    values, axes = np.linalg.eigh(normal - min_signal * noise)
    blind = values <= _MIN_DETERMINED_EIGENVALUE_TO_NORMAL_MATRIX_NORM * np.linalg.norm(normal)
    shown = axes[:, ~blind]
    inverse = shown @ np.linalg.inv(shown.T @ (normal - noise) @ shown) @ shown.T
    scores = (derivatives * residuals[:, None]).T
    free = residuals.size / max(residuals.size - derivatives.shape[1], 1)
    shrinking = inverse @ noise @ parameters
    scatter = score_scatter(scores)[0] + np.mean(residuals * residuals) * prior_rows.T @ prior_rows
    covariance = free * inverse @ scatter @ inverse + np.outer(shrinking, shrinking)
    return covariance, (axes[:, blind] ** 2).sum(axis=1) > 1e-3
