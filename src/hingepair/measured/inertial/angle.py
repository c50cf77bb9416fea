"""The hinge angle from two inertial sensors: integrated rates, and directions that both sensors see.

The rate psi' = omega2 . n2 - omega1 . n1 is smooth but drifts by the biases of the gyroscopes. Across the axis both
sensors see the same two vectors, the angular velocity there and the force at the hinge point, turned by psi: noisy,
without drift. The most likely angle has a constant bias of its rate and random noise in all three (a fixed-interval
smoother, as one tridiagonal system of linear equations).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import FitError
from hingepair.measured.findings import Check, Finding, exceeded, verdict
from hingepair.measured.hinge import Hinge, frame, home_angle, home_of, tilt_axis
from hingepair.measured.inertial.axis_and_point import sign_correlation, solve_axes
from hingepair.measured.inertial.records import Sensors, axis_arguments, read_sensors, record_doubts, report
from hingepair.measured.least_squares import Equations, least_squares, score_scatter
from hingepair.measured.robust import cauchy, loss_weights
from hingepair.measured.smoothing.spline import MIN_PIECE, inverse_bands
from hingepair.numeric.arrays import Float64Array, constant, read_only
from hingepair.tables.sheets import percent

_UNKNOWNS = 22  # of `_Records`: axes (4), levers (6), biases (12)
_STEP = 1e-5  # rad, m, rad/s, m/s^2: of central differences by the unknowns
_REFINED_SAMPLES = 4000  # from which the unknowns are estimated, at most
_UNMEASURED = 1e6  # rad: standard deviation of an angle, or a change over a gap, that nothing measures


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AngleFit:
    """The result of `fit_angle`: the hinge angle and its rate at every instant.

    Attributes:
        psi: hinge angle [rad]; shape (N,), NaN at instants that are not used. The first finite angle is in [-pi, pi],
            and there are no jumps of 2 pi between samples. psi = 0 is where `fit_angle` says.
        psid: rate of psi [rad/s]; shape (N,), NaN where psi is: the component of body 2's angular velocity along n2,
            minus that of body 1's along n1, minus `drift`.
        std: standard deviation of psi [rad]; shape (N,), NaN where psi is. It includes the uncertainty of the axis,
            of the hinge point and of the biases, as far as these records determine them.
        drift: constant bias of the measured rate [rad/s].
        drift_std: standard deviation of `drift` [rad/s].
        noise: median standard deviation of a hinge angle that is found at one instant from one vector, the specific
            force at the hinge point or the angular velocity [rad]; inf if none is long enough across the axis.
        ok: whether the measured vectors determine the angle and agree with the integral of psid.
        findings: sentences that say what is wrong with the data, or what the motion does not determine.
    """

    psi: Float64Array
    psid: Float64Array
    std: Float64Array
    drift: float
    drift_std: float
    noise: float
    ok: bool
    findings: tuple[str, ...]

    def __str__(self) -> str:
        psi, std = (values[np.isfinite(values)] for values in (self.psi, self.std))
        lines = [
            f"hinge angle at {psi.size} of {self.psi.size} instants",
            f"psi from {np.degrees(psi.min()):.4g} to {np.degrees(psi.max()):.4g} deg, known to "
            f"{np.degrees(np.median(std)):.2g} deg, {np.degrees(std.max()):.2g} deg at worst",
            f"drift: {self.drift:.3g} +- {self.drift_std:.2g} rad/s",
        ]
        return report(lines, self.findings, self.ok)


def fit_angle(
    t: ArrayLike,
    omega1_b1: ArrayLike,
    f1_b1: ArrayLike,
    omega2_b2: ArrayLike,
    f2_b2: ArrayLike,
    n1: ArrayLike,
    n2: ArrayLike,
    u1: ArrayLike,
    u2: ArrayLike,
    gaps: float = 0.05,
    gyroscope_bias: float = 0.05,
    accelerometer_bias: float = 0.2,
) -> AngleFit:
    """Fit the hinge angle to the records of two inertial sensors, one on each body of a known hinge.

    Two vectors are common to both bodies: the specific force at the hinge point, and the part of the angular velocity
    across the axis. Their directions from both sensors determine the hinge angle at each instant, unless a vector is
    along the axis; the integral of the hinge rate connects the instants. An instant is used if all four records are
    finite there, and if it belongs to a series of at least 8 such instants without a gap.

    Args:
        t: instants of the samples of both sensors, increasing: seconds (floats), datetime64, or nanoseconds since
            1970 (integers); shape (N,).
        omega1_b1: angular velocity of body 1 in body 1's axes [rad/s]; shape (N, 3), NaN where a sample is missing.
        f1_b1: specific force that accelerometer 1 measures, in body 1's axes [m/s^2]; shape (N, 3): S1^T (a1 - g),
            where a1 is the acceleration of the sensor and g = (0, 0, -9.81), both in world axes.
        omega2_b2: angular velocity of body 2 in body 2's axes [rad/s]; shape (N, 3).
        f2_b2: specific force that accelerometer 2 measures, in body 2's axes [m/s^2]; shape (N, 3).
        n1: hinge axis in body 1's axes, as `fit_axis` finds it; shape (3,).
        n2: hinge axis in body 2's axes; shape (3,).
        u1: vector from sensor 1 to the hinge point, body 1's axes, as `fit_anchor` finds it [m]; shape (3,).
        u2: vector from sensor 2 to the hinge point, body 2's axes [m]; shape (3,).
        gaps: longest time without a sample over which rates are integrated [s], at least 1.5 times the median time
            step.
        gyroscope_bias: expected size of the gyroscopes' biases, as the standard deviation of one component [rad/s];
            0 if the biases were subtracted from the data.
        accelerometer_bias: expected size of the accelerometers' biases, likewise [m/s^2].

    Returns:
        An AngleFit. At psi = 0, the attitude of body 2 relative to body 1 is the rotation by the smallest angle that
        turns n2 into n1; if n1 and n2 are more than 154 degrees apart, the rotation `home` that `fit` defines. Check
        `.ok` and `.findings` before you use the numbers of the fit.

    Raises:
        FitError: no series of 8 instants without a gap has finite values in all four records.
    """
    named = {"omega1_b1": omega1_b1, "f1_b1": f1_b1, "omega2_b2": omega2_b2, "f2_b2": f2_b2}
    axes = axis_arguments(n1, n2)
    levers = [constant(name, u, 3) for name, u in (("u1", u1), ("u2", u2))]
    sensors = read_sensors(t, named, gaps, gyroscope_bias, accelerometer_bias)
    used, count = sensors.used, sensors.t.size
    data = _Records(sensors, Hinge(axes[0], axes[1], levers[0], levers[1]))
    values, covariance = _fit_unknowns(data)
    seen = data.seen(values)
    estimate = _most_likely_angle(data, seen, values, covariance)
    std = np.minimum(estimate.std, np.pi)
    findings = _angle_findings(estimate, float(std.max()), seen)
    # Rows without readings in every gap, for changes must not reach across it.
    spaced = [np.insert(omega[used], np.repeat(sensors.starts, 64), np.nan, axis=0) for omega in sensors.omega]
    usual, flipped = (sign_correlation(spaced[0], spaced[1], axes[0], sign * axes[1]) for sign in (1, -1))
    if flipped > max(usual, 0.2):
        findings.insert(0, Finding("n2 points the other way than n1: the angle does not follow its rate."))
    try:
        found = solve_axes(sensors.omega[0], sensors.omega[1], sensors.gyroscope_bias, np.stack(axes))
        findings += found.clock_findings(sensors.step)
    except FitError:
        pass  # bodies at rest show no clock offset
    findings += record_doubts(t, named)
    if sensors.starts.size:
        text = "Whole turns during a gap are not seen: the angle after it is taken as less than half a turn away."
        findings.append(Finding(text, harmless=True))
    ok, sentences = verdict(findings)
    psi = estimate.psi - 2 * np.pi * np.rint(estimate.psi[0] / (2 * np.pi))
    return AngleFit(
        psi=_at_used_indices(psi, used, count),
        psid=_at_used_indices(seen.rate - estimate.drift, used, count),
        std=_at_used_indices(std, used, count),
        drift=estimate.drift,
        drift_std=estimate.drift_std,
        noise=estimate.noise,
        ok=ok,
        findings=sentences,
    )


class _Seen(NamedTuple):
    """The two vectors that both sensors see, in axes of which the third is the hinge axis, and the hinge rate."""

    turning: tuple[Float64Array, Float64Array]  # angular velocities [rad/s]; (N, 3) each
    pulling: tuple[Float64Array, Float64Array]  # specific forces at the hinge point [m/s^2]; (N, 3) each
    home: float  # angle between these axes at psi = 0 [rad]
    rate: Float64Array  # as measured, with the biases of the gyroscopes [rad/s]; (N,)

    def differences(self) -> Float64Array:
        """Return what does not depend on psi and is 0 without noise: the differences of the lengths of both vectors
        across the axis, and of the forces along it; (3, N).
        """
        lengths = [np.hypot(a[:, 0], a[:, 1]) - np.hypot(b[:, 0], b[:, 1]) for a, b in (self.turning, self.pulling)]
        return np.stack((*lengths, self.pulling[0][:, 2] - self.pulling[1][:, 2]))

    def angles(self) -> Float64Array:
        """Return the angles psi that both vectors tell, with jumps by 2 pi, and the hinge rate; shape (3, N)."""
        a, b = ([vector[:, 0] + 1j * vector[:, 1] for vector in both] for both in (self.turning, self.pulling))
        return np.stack((*(np.angle(x * np.conj(y)) - self.home for x, y in (a, b)), self.rate))


class _Records(NamedTuple):
    """The usable samples and the hinge. Its 22 unknowns are two turns of n1 and of n2, changes of u1 and u2, and the
    biases of both gyroscopes and of both accelerometers.
    """

    sensors: Sensors
    hinge: Hinge

    def seen(self, x: Float64Array, rows: slice = slice(None)) -> _Seen:
        """Return what both sensors see if the unknowns are x (22,), at all usable samples or at `rows` of them."""
        n, m = tilt_axis(self.hinge.n, x[:2]), tilt_axis(self.hinge.m, x[2:4])
        omega, force = self.sensors.omega[:, self.sensors.used[rows]], self.sensors.used_forces[:, rows]
        vectors = []
        for i, own in enumerate((self.hinge.u1, self.hinge.u2)):
            lever, gyroscope, accelerometer = own + x[4 + 3 * i :][:3], x[10 + 3 * i :][:3], x[16 + 3 * i :][:3]
            turning, alpha = self.sensors.smooth[i][0, rows] - gyroscope, self.sensors.smooth[i][1, rows]
            felt = force[i] - accelerometer + np.cross(turning, np.cross(turning, lever)) + np.cross(alpha, lever)
            vectors.append((omega[i] - gyroscope, felt))
        first, second = frame(n), frame(m)
        turning, pulling = ((a @ first, b @ second) for a, b in zip(*vectors, strict=True))
        hinge = Hinge(n, m, self.hinge.u1, self.hinge.u2)
        return _Seen(turning, pulling, home_angle(hinge, home_of(hinge)), omega[1] @ m - omega[0] @ n)

    def angle_derivatives(self, x: Float64Array) -> Float64Array:
        """Return the derivatives of both angles and of the rate by the unknowns; (22, 3, M)."""
        ends = [(self.seen(x + step).angles(), self.seen(x - step).angles()) for step in _STEP * np.eye(_UNKNOWNS)]
        change = np.stack([high - low for high, low in ends])
        change[:, :2] -= 2 * np.pi * np.rint(change[:, :2] / (2 * np.pi))
        return change / (2 * _STEP)


def _fit_unknowns(data: _Records) -> tuple[Float64Array, Float64Array]:
    """Return the most likely unknowns (22,) and their covariance (22, 22), from what does not depend on psi."""
    sensors = data.sensors
    rows = slice(None, None, -(-sensors.used.size // _REFINED_SAMPLES))
    # Given axes may be off by 0.05 rad, levers by 0.1 m.
    sizes = 0.05, 0.1, max(sensors.gyroscope_bias, 1e-9), max(sensors.accelerometer_bias, 1e-9)
    prior = 1 / np.repeat(sizes, (4, 6, 6, 6)) ** 2

    def equations(x: Float64Array) -> Equations:
        """Return the normal equations of the differences, weighted by what they leave, and of the priors."""
        left = data.seen(x, rows).differences()
        steps = _STEP * np.eye(_UNKNOWNS)
        ends = [(data.seen(x + h, rows).differences(), data.seen(x - h, rows).differences()) for h in steps]
        J = np.stack([high - low for high, low in ends]) / (2 * _STEP)
        variances = np.maximum(np.mean(left * left, axis=1), 1e-18)
        # Residuals that are correlated in time tell less.
        memory = [max(float(score_scatter(row[None])[0][0, 0] / max(row @ row, 1e-300)), 1.0) for row in left]
        weighted = J / (variances * np.array(memory))[:, None]
        normal = np.einsum("aki,bki->ab", weighted, J) + np.diag(prior)
        return Equations(normal, np.einsum("aki,ki->a", weighted, left) + prior * x)

    x, _ = least_squares(np.zeros(_UNKNOWNS), equations, lambda x, h: (x + h, h), lambda *_: False, 3)
    normal = equations(x).normal
    scale = 1 / np.sqrt(np.diagonal(normal))
    return x, np.linalg.inv(normal * scale * scale[:, None]) * scale * scale[:, None]


def _angle_findings(estimate: _AngleEstimate, worst: float, seen: _Seen) -> list[Finding]:
    """Return findings on the angle, of which `worst` is the largest standard deviation."""
    off = float(np.sqrt(np.mean((seen.pulling[0][:, 2] - seen.pulling[1][:, 2]) ** 2)))
    force = float(np.sqrt(np.mean(seen.pulling[0] ** 2) * 3))
    return exceeded(
        Check(
            worst,
            0.2,
            f"The angle is known to {worst:.2g} rad only: neither the force at the hinge point nor the angular "
            "velocity shows a direction across the axis for long enough.",
        ),
        Check(
            estimate.excess,
            3.0,
            f"Directions are {estimate.excess:.2g} times as far from the integrated angle as their noise explains: "
            "the axis or the point may be wrong.",
        ),
        Check(
            estimate.contradicted,
            0.2,
            f"{percent(estimate.contradicted)} of the directions contradict the integrated rate: units, the sign "
            "of n2, the axes, the point or the clocks may be wrong.",
        ),
        Check(
            estimate.unresolved_lag,
            0,
            f"What is left of the directions is correlated over {estimate.unresolved_lag} samples and more, too long "
            "relative to the whole recording: the standard deviations of the angle are too small.",
            harmless=True,
        ),
        Check(
            off,
            0.2 * force,
            f"The forces along the axis differ by {off:.2g} m/s^2 rms: the axis, the point or units may be wrong.",
        ),
    )


class _AngleEstimate(NamedTuple):
    """The hinge angle over time and the constant bias of its rate."""

    psi: Float64Array  # [rad]; (N,)
    std: Float64Array  # (N,)
    drift: float  # bias of the rate [rad/s]
    drift_std: float
    noise: float  # of a direction, the median [rad]
    excess: float  # scatter of the directions, in parts of what their noise explains
    contradicted: float  # share of directions that are far from the angle
    unresolved_lag: int  # samples over which directions err alike at least; 0 where they do not


def _angles_between(
    vectors1: Float64Array, vectors2: Float64Array
) -> tuple[tuple[Float64Array, Float64Array], float]:
    """Return the angles (N,) [rad] about the third axis, the hinge axis, from vectors of body 2 to those of body 1
    (N, 3), their variances, inf where a vector is too short across it, and the rms difference of both lengths.
    """
    a, b = (vector[:, 0] + 1j * vector[:, 1] for vector in (vectors1, vectors2))
    sizes = np.abs(a), np.abs(b)
    noise = max(float(np.sqrt(np.mean((sizes[0] - sizes[1]) ** 2))), 1e-9)
    least = max(0.05 * float(max(sizes[0].max(), sizes[1].max())), 3 * noise)
    seen = np.minimum(*sizes) > least
    variances = np.full(a.size, np.inf)
    variances[seen] = noise**2 / 2 * (1 / sizes[0][seen] ** 2 + 1 / sizes[1][seen] ** 2)
    return (np.angle(a * np.conj(b)), np.maximum(variances, 1e-18)), noise


def _most_likely_angle(data: _Records, seen: _Seen, values: Float64Array, covariance: Float64Array) -> _AngleEstimate:
    """Return the angle that integrated rates, which have a constant bias, and directions tell together. `values` and
    `covariance` are those of the unknowns.
    """
    (turning, rate_noise), (pulling, _) = (_angles_between(*both) for both in (seen.turning, seen.pulling))
    angles, variances = (np.stack(both) for both in zip(turning, pulling, strict=True))
    angles = angles - seen.home
    t, rate = data.sensors.t[data.sensors.used], seen.rate
    before_gaps, bias_std = data.sensors.starts - 1, np.sqrt(2) * data.sensors.gyroscope_bias
    dt = np.diff(t)
    steps_of_angle = (rate[1:] + rate[:-1]) / 2 * dt
    step_weights = 1 / (rate_noise * dt) ** 2
    steps_of_angle[before_gaps] = 0.0  # nothing is known of a gap
    step_weights[before_gaps] = 1 / _UNMEASURED**2
    precision = 1 / variances
    psi = _unwrapped_start(np.concatenate(([0.0], np.cumsum(steps_of_angle))), angles, precision)
    weights = precision
    # Each round with the directions nearest to the last angle; those far off count little.
    for _ in range(8):
        near = angles + 2 * np.pi * np.rint((psi - angles) / (2 * np.pi))
        weights = precision * loss_weights(cauchy, (psi - near) ** 2 * precision, 1, np.inf)[0]
        psi = _Smoother(dt, step_weights, weights, bias_std).solve(steps_of_angle, near)[0]
    near = angles + 2 * np.pi * np.rint((psi - angles) / (2 * np.pi))
    # How far directions are off, and over how many samples alike.
    rows = [((psi - one) * np.sqrt(weight))[weight > 0] for one, weight in zip(near, weights, strict=True)]
    excess, memory, lag = 0.0, 1.0, 0
    for row in rows:
        if row.size > MIN_PIECE:
            excess = max(excess, float(np.sqrt(np.mean(row * row))))
            scatter, unresolved_lag = score_scatter(row[None])
            memory, lag = max(memory, float(scatter[0, 0] / max(row @ row, 1e-300))), max(lag, unresolved_lag)
    scale = max(excess, 1.0) ** 2 * memory
    smoother = _Smoother(dt, step_weights, weights / scale, bias_std)
    psi, drift = smoother.solve(steps_of_angle, near)
    random_std, drift_std = smoother.std()
    # What the unknowns change goes through the same smoother.
    changes = []
    for change in data.angle_derivatives(values):
        steps = (change[-1, 1:] + change[-1, :-1]) / 2 * dt
        steps[before_gaps] = 0.0
        changes.append(smoother.solve(steps, change[:-1]))
    by_unknowns = np.stack([change for change, _ in changes])
    values, vectors = np.linalg.eigh(covariance)
    spread = vectors * np.sqrt(np.maximum(values, 0.0))
    std = np.sqrt(random_std**2 + ((spread.T @ by_unknowns) ** 2).sum(axis=0))
    drifts = spread.T @ np.array([change for _, change in changes])
    shown = variances[np.isfinite(variances)]
    noise = float(np.sqrt(np.median(shown))) if shown.size else np.inf
    near = angles + 2 * np.pi * np.rint((psi - angles) / (2 * np.pi))
    off = np.abs(psi - near)[np.isfinite(variances)]
    # Off by five deviations, and by more than half of what chance would leave.
    far = (off > 5.0 * np.sqrt(shown)) & (off > 0.2)
    contradicted = float(far.mean()) if far.size else 0.0
    drift_std = float(np.sqrt(drift_std**2 + drifts @ drifts))
    return _AngleEstimate(psi, std, drift, drift_std, noise, excess, contradicted, lag)


def _unwrapped_start(integrated_rates: Float64Array, angles: Float64Array, precision: Float64Array) -> Float64Array:
    """Return a first estimate of the hinge angle without jumps by 2 pi: the integrated rates (N,), of which measured
    angles (k, N) correct the slow drift.
    """
    off = (precision * np.exp(1j * (angles - integrated_rates))).sum(axis=0)
    if not precision.any():
        return integrated_rates
    total = np.concatenate(([0.0], np.cumsum(off)))
    half = max(1, integrated_rates.size // 100)
    place = np.arange(integrated_rates.size)
    mean = total[np.minimum(place + half, integrated_rates.size)] - total[np.maximum(place - half, 0)]
    return np.asarray(integrated_rates + np.unwrap(np.angle(mean)))


class _Smoother:
    """Weighted least squares of N angles and of the bias of their rate, factorised once. The weights are the inverse
    variances of measured steps (N - 1,) over times `dt` and of measured angles (k, N); `bias_std` is a prior.
    """

    def __init__(
        self, dt: Float64Array, step_weights: Float64Array, angle_weights: Float64Array, bias_std: float
    ) -> None:
        from scipy.linalg import cholesky_banded

        count = dt.size + 1
        self._dt, self._step_weights, self._angle_weights = dt, step_weights, angle_weights
        border, matrix = np.zeros(count), np.zeros((2, count))
        border[1:] += step_weights * dt
        border[:-1] -= step_weights * dt
        matrix[0, 1:] = -step_weights
        matrix[1, 1:] += step_weights
        matrix[1, :-1] += step_weights
        matrix[1] += angle_weights.sum(axis=0) + 1 / _UNMEASURED**2
        matrix[1] += 1e-13 * matrix[1].max()  # rounding must not make it indefinite
        self._matrix, self._factor, self._border = matrix, cholesky_banded(matrix), border
        self._y = self._solved(border)
        least = 1 / max(bias_std, 1e-9) ** 2
        self._precision = max(float((step_weights * dt) @ dt - border @ self._y), 0.0) + least

    def _solved(self, right: Float64Array) -> Float64Array:
        from scipy.linalg import cho_solve_banded

        return np.asarray(cho_solve_banded((self._factor, False), right))

    def solve(self, steps: Float64Array, angles: Float64Array) -> tuple[Float64Array, float]:
        """Return the angles (N,) and the bias of the rate, from measured `steps` (N - 1,) and `angles` (k, N)."""
        weighted = self._step_weights * steps
        right = (self._angle_weights * np.where(self._angle_weights > 0, angles, 0.0)).sum(axis=0)
        right[1:] += weighted
        right[:-1] -= weighted
        x = self._solved(right)
        drift = float((weighted @ self._dt - self._border @ x) / self._precision)
        return x - drift * self._y, drift

    def std(self) -> tuple[Float64Array, float]:
        """Return the standard deviations of the angles (N,) and of the bias of the rate."""
        variance = inverse_bands(self._matrix, 1)[0, : self._y.size] + self._y * self._y / self._precision
        return np.sqrt(np.maximum(variance, 0.0)), float(1 / np.sqrt(self._precision))


def _at_used_indices(values: Float64Array, used_indices: NDArray[np.intp], num_samples: int) -> Float64Array:
    """Return a read-only array of NaN that has `values` at the used indices."""
    all_samples = np.full(num_samples, np.nan)
    all_samples[used_indices] = values
    return read_only(all_samples)
