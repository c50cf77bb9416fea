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
from hingepair.measured.findings import Finding
from hingepair.measured.hinge import Hinge, frame, home_angle, home_of, tilt_axis
from hingepair.measured.inertial import (
    checked_recording,
    recording_suspicions,
    report,
    sign_correlation,
    solve_axes,
)
from hingepair.measured.least_squares import score_scatter
from hingepair.measured.spline import MIN_PIECE, inverse_bands, smooth_columns
from hingepair.numeric.arrays import Float64Array, constant, number_not_below_0, read_only
from hingepair.numeric.instants import checked_gaps, split_at_gaps
from hingepair.numeric.tables import percent
from hingepair.numeric.unit_vectors import unit_axis

_NUM_HINGE_ANGLE_SMOOTHING_ROUNDS = 8  # of the smoother, each with the directions nearest to the last angle
_MIN_VECTOR_LENGTH_ACROSS_HINGE_AXIS_TO_LARGEST_LENGTH = 0.05  # from which a vector shows a direction
_MAX_RELIABLE_HINGE_ANGLE_STD_IN_RADIANS = 0.2  # [rad]: an angle that is known less well is not to be relied on
# Above, a direction counts less.
_LOSS_SCALE_OF_SQUARED_DIRECTION_RESIDUAL_IN_NOISE_VARIANCES = 4.0
_MAX_EXCESS = 3.0  # rms of directions about the most likely angle, to their noise
_MAX_CONTRADICTED = 0.2  # share of directions far from the angle
_MIN_CONTRADICTION = 5.0  # in standard deviations of a direction
_MAX_FORCE_DIFFERENCE = 0.2  # along the axis, in parts of the force
_NUM_UNKNOWNS = 22
_DIFFERENCE_STEP = 1e-5
_REFINING_STEPS = 3
_MAX_REFINING_SAMPLES = 4000
_AXIS_PRIOR, _LEVER_PRIOR = 0.05, 0.1  # [rad], [m]: how far given axes and levers may be off
_MIN_DIRECTION_NOISE_STD_IN_RADIANS = 1e-9  # [rad]
_MIN_HINGE_RATE_BIAS_STD_IN_RADIANS_PER_SECOND = 1e-9  # [rad/s]
# [rad], of an angle, or a change over a gap, that nothing measures.
_UNMEASURED = 1e6


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class AngleFit:
    """The result of `fit_angle`: the hinge angle and its rate at every instant, the drift of the measured rate,
    standard deviations, whether the angle is reliable (`ok`), and findings.

    Attributes:
        psi: hinge angle [rad]; shape (N,). It is NaN at instants that `fit_angle` does not use: where an angular
            velocity or a specific force is not finite, and in series of fewer than 8 samples without a gap. The first
            finite angle is in [-pi, pi], and there are no jumps of 2 pi between samples. At psi = 0, the attitude of
            body 2 relative to body 1 is the rotation by the smallest angle that turns n2 into n1; n1 and n2 are the
            arguments of `fit_angle`. If the angle between n1 and n2 is near 180 degrees, this rotation is not
            determined well. If that angle exceeds 154 degrees, the attitude at psi = 0 is therefore the rotation
            `home` that the page of `fit` defines, with n = n1.
        psid: rate of psi [rad/s]; shape (N,), NaN where psi is NaN. It is the measured rate minus `drift`. The
            measured rate is the component of body 2's angular velocity along n2, minus the component of body 1's
            angular velocity along n1.
        std: standard deviation of psi [rad]; shape (N,), NaN where psi is NaN. It includes the uncertainty of the
            axis, of the hinge point and of the biases, as far as these records determine them.
        drift: constant bias of the measured rate [rad/s].
        drift_std: standard deviation of `drift` [rad/s].
        noise: typical standard deviation of a hinge angle that is found at one instant from one vector [rad]. Each
            instant gives two such angles: one from the specific force at the hinge point, and one from the angular
            velocity. Each angle has an estimated standard deviation, and `noise` is their median over all instants.
            An angle is left out if the part of its vector that is perpendicular to the hinge axis is too short.
            `noise` is inf if all angles are left out.
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
    """Fit the hinge angle to the records of two inertial sensors, one on each body of a known hinge, and return an
    AngleFit. Each sensor records an angular velocity (`omega1_b1`, `omega2_b2`) and a specific force
    (`f1_b1`, `f2_b2`). n1 and n2 are the hinge axis in the axes of body 1 and body 2, and u1 and u2 are the vectors
    from the sensors to the hinge point; `fit_axis` and `fit_anchor` find them. `gaps` is the longest time without
    samples over which rates are integrated [s]. Raise FitError if there are too few samples.

    Body 1's axes and body 2's axes are the axes in which the two sensors give their readings. Two vectors are common
    to both bodies: the specific force at the hinge point, and the part of the angular velocity that is perpendicular
    to the hinge axis. The fit computes each of them twice: from sensor 1 in body 1's axes, and from sensor 2 in body
    2's axes. At each instant, the two directions found for a vector determine the hinge angle, unless the vector is
    parallel to the hinge axis. The hinge rate is the component of body 2's angular velocity along the hinge axis
    minus that of body 1. The integral of the hinge rate connects the angles of different instants.

    Each of the four records may have NaN where a sample is missing. An instant is used if all four records are finite
    there, and if it belongs to a series of at least 8 such instants without a gap.

    Args:
        t: instants of the samples of both sensors, increasing: seconds (floats), datetime64, or nanoseconds since
            1970 (integers); shape (N,).
        omega1_b1: angular velocity of body 1 in body 1's axes [rad/s]; shape (N, 3).
        f1_b1: specific force that accelerometer 1 measures, in body 1's axes [m/s^2]; shape (N, 3). This specific
            force is S1^T (a1 - g), where a1 is the acceleration of the sensor and g = (0, 0, -9.81), both in world
            axes.
        omega2_b2: angular velocity of body 2 in body 2's axes [rad/s]; shape (N, 3).
        f2_b2: specific force that accelerometer 2 measures, in body 2's axes [m/s^2]; shape (N, 3).
        n1: hinge axis in body 1's axes; shape (3,).
        n2: hinge axis in body 2's axes; shape (3,).
        u1: vector from sensor 1 to the hinge point, body 1's axes [m]; shape (3,).
        u2: vector from sensor 2 to the hinge point, body 2's axes [m]; shape (3,).
        gaps: longest time without a sample over which rates are integrated [s]. A longer time is a gap. A value below
            1.5 times the median time step counts as 1.5 times the median time step.
        gyroscope_bias: expected size of the gyroscopes' biases, as the standard deviation of one component [rad/s];
            0 if the biases were subtracted from the data.
        accelerometer_bias: expected size of the accelerometers' biases, as the standard deviation of one component
            [m/s^2]. The attribute `std` of the result includes the effects of both kinds of biases.

    Returns:
        An AngleFit, with the hinge angle as `.psi` [rad], shape (N,), NaN at the instants that are not used. At psi =
        0, the attitude of body 2 relative to body 1 is the rotation by the smallest angle that turns n2 into n1. If
        n1 = n2, the axes of body 1 and body 2 are parallel at psi = 0. If the angle between n1 and n2 is near 180
        degrees, the rotation by the smallest angle is not determined well. If the angle exceeds 154 degrees, the
        attitude at psi = 0 is therefore the rotation `home` that the documentation of `fit` defines, with n = n1.
        Check `.ok` and `.findings` before you use the numbers of the fit.

    Raises:
        FitError: no series of 8 instants without a gap has finite values in all four records.
        ArgumentError: an argument cannot be used; the error names it.
        MissingDependencyError: SciPy is not installed.
    """
    named_vectors = {"omega1_b1": omega1_b1, "f1_b1": f1_b1, "omega2_b2": omega2_b2, "f2_b2": f2_b2}
    time, columns = checked_recording(t, named_vectors)
    axes = [np.asarray(unit_axis(name, np.asarray(n))) for name, n in (("n1", n1), ("n2", n2))]
    levers = [constant(name, u, 3) for name, u in (("u1", u1), ("u2", u2))]
    tilting = number_not_below_0("accelerometer_bias", accelerometer_bias)
    bias = number_not_below_0("gyroscope_bias", gyroscope_bias)
    known: NDArray[np.bool_] = np.asarray(np.isfinite(np.concatenate(columns, axis=-1)).all(axis=-1))
    where = split_at_gaps(time, known, checked_gaps(gaps), MIN_PIECE)
    if not where:
        raise FitError(
            ", ".join(named_vectors),
            f"at least {MIN_PIECE} finite samples without a gap",
            int(known.sum()),
        )
    used = np.concatenate(where)
    smooth = [smooth_columns(time, omega, where, None).values[:2, used] for omega in columns[::2]]
    data = _Records([column[used] for column in columns], smooth, Hinge(axes[0], axes[1], levers[0], levers[1]))
    values, covariance = _refined(data, bias, tilting)
    seen = data.seen(values)
    (turning, rate_noise), (pulling, _) = (_angles_between(*both) for both in (seen.turning, seen.pulling))
    angles, variances = (np.stack(both) for both in zip(turning, pulling, strict=True))
    starts = np.cumsum([piece.size for piece in where])[:-1]
    estimate = _most_likely_angle(
        time[used],
        seen.rate,
        rate_noise,
        angles - seen.home,
        variances,
        np.sqrt(2) * bias,
        starts,
        data.derivatives(values),
        covariance,
    )
    std = np.minimum(estimate.std, np.pi)
    psi = estimate.psi - 2 * np.pi * np.rint(estimate.psi[0] / (2 * np.pi))
    findings = _angle_findings(estimate, float(std.max()), seen)
    # rows without readings in every gap, for changes must not reach across it
    spaced = [np.insert(columns[i][used], np.repeat(starts, 64), np.nan, axis=0) for i in (0, 2)]
    usual, flipped = (sign_correlation(spaced[0], spaced[1], axes[0], sign * axes[1]) for sign in (1, -1))
    if flipped > max(usual, 0.2):
        findings.insert(0, Finding("n2 points the other way than n1: the angle does not follow its rate.", False))
    try:
        found = solve_axes(columns[0], columns[2], bias, np.stack(axes))
        findings += found.clock_findings(float(np.median(np.diff(time))))
    except FitError:
        pass  # bodies at rest show no clock offset
    findings += recording_suspicions(t, named_vectors)
    if starts.size:
        text = "Whole turns during a gap are not seen: the angle after it is taken as less than half a turn away."
        findings.append(Finding(text, True))
    return AngleFit(
        psi=_at_used_indices(psi, used, time.size),
        psid=_at_used_indices(seen.rate - estimate.drift, used, time.size),
        std=_at_used_indices(std, used, time.size),
        drift=estimate.drift,
        drift_std=estimate.drift_std,
        noise=estimate.noise,
        ok=all(finding.harmless for finding in findings),
        findings=tuple(finding.text for finding in findings),
    )


class _Seen(NamedTuple):
    """The two vectors that both sensors see, in axes of which the third is the hinge axis, and the hinge rate."""

    turning: tuple[Float64Array, Float64Array]  # angular velocities [rad/s]; (N, 3) each
    pulling: tuple[Float64Array, Float64Array]  # specific forces at the hinge point [m/s^2]; (N, 3) each
    home: float  # angle between these axes at psi = 0 [rad]
    rate: Float64Array  # as measured, with the biases of the gyroscopes [rad/s]; (N,)

    def differences(self) -> Float64Array:
        """Return what does not depend on psi and is 0 without noise: the differences of the lengths of both vectors
        across the axis, and of the forces along it; shape (3, N).
        """
        lengths = [np.hypot(a[:, 0], a[:, 1]) - np.hypot(b[:, 0], b[:, 1]) for a, b in (self.turning, self.pulling)]
        return np.stack((*lengths, self.pulling[0][:, 2] - self.pulling[1][:, 2]))

    def angles(self) -> Float64Array:
        """Return the angles that both vectors tell, and the hinge rate; shape (3, N)."""
        a, b = ([vector[:, 0] + 1j * vector[:, 1] for vector in both] for both in (self.turning, self.pulling))
        return np.stack((*(np.angle(x * np.conj(y)) - self.home for x, y in (a, b)), self.rate))


class _Records(NamedTuple):
    """Four records of M usable samples, smoothed angular velocities with their derivatives, and the Hinge. Its 22
    unknowns are two turns of n1 and of n2, changes of u1 and u2, and the biases of both gyroscopes and of both
    accelerometers.
    """

    columns: list[Float64Array]
    smooth: list[Float64Array]  # (2, M, 3) of each body
    hinge: Hinge

    def seen(self, x: Float64Array, rows: slice = slice(None)) -> _Seen:
        """Return the vectors at the unknowns x (22,)."""
        n, m = tilt_axis(self.hinge.n, x[:2]), tilt_axis(self.hinge.m, x[2:4])
        vectors = []
        for i, own in enumerate((self.hinge.u1, self.hinge.u2)):
            lever, gyroscope, accelerometer = own + x[4 + 3 * i :][:3], x[10 + 3 * i :][:3], x[16 + 3 * i :][:3]
            omega, alpha = self.smooth[i][0, rows] - gyroscope, self.smooth[i][1, rows]
            force = self.columns[2 * i + 1][rows] - accelerometer
            force = force + np.cross(omega, np.cross(omega, lever)) + np.cross(alpha, lever)
            vectors.append((self.columns[2 * i][rows] - gyroscope, force))
        first, second = frame(n), frame(m)
        turning, pulling = ((a @ first, b @ second) for a, b in zip(*vectors, strict=True))
        hinge = Hinge(n, m, self.hinge.u1, self.hinge.u2)
        rate = self.columns[2][rows] @ m - self.columns[0][rows] @ n
        return _Seen(turning, pulling, home_angle(hinge, home_of(hinge)), rate)

    def derivatives(self, x: Float64Array) -> Float64Array:
        """Return the derivatives of both angles and of the rate by the unknowns; shape (22, 3, M)."""
        columns = []
        for step in _DIFFERENCE_STEP * np.eye(_NUM_UNKNOWNS):
            change = self.seen(x + step).angles() - self.seen(x - step).angles()
            change[:2] -= 2 * np.pi * np.rint(change[:2] / (2 * np.pi))
            columns.append(change / (2 * _DIFFERENCE_STEP))
        return np.stack(columns)


def _refined(data: _Records, bias: float, tilting: float) -> tuple[Float64Array, Float64Array]:
    """Return the most likely unknowns (22,) of the records and their covariance (22, 22), from what does not depend
    on psi. `bias` and `tilting` are the expected sizes of the biases of gyroscopes and accelerometers.
    """
    rows = slice(None, None, -(-data.columns[0].shape[0] // _MAX_REFINING_SAMPLES))
    prior = 1 / np.repeat((_AXIS_PRIOR, _LEVER_PRIOR, max(bias, 1e-9), max(tilting, 1e-9)), (4, 6, 6, 6)) ** 2
    x = np.zeros(_NUM_UNKNOWNS)
    for _ in range(_REFINING_STEPS):
        left = data.seen(x, rows).differences()
        columns = [
            (data.seen(x + step, rows).differences() - data.seen(x - step, rows).differences())
            / (2 * _DIFFERENCE_STEP)
            for step in _DIFFERENCE_STEP * np.eye(_NUM_UNKNOWNS)
        ]
        variances = np.maximum(np.mean(left * left, axis=1, keepdims=True), 1e-18)
        # residuals that are correlated in time tell less
        memory = [max(float(score_scatter(row[None])[0][0, 0] / max(row @ row, 1e-300)), 1.0) for row in left]
        weights = 1 / (variances * np.array(memory)[:, None])
        J = np.stack(columns)
        normal = np.einsum("aki,bki,ki->ab", J, J, np.broadcast_to(weights, left.shape)) + np.diag(prior)
        scale = 1 / np.sqrt(np.diagonal(normal))
        covariance = np.linalg.inv(normal * scale * scale[:, None]) * scale * scale[:, None]
        gradient = np.einsum("aki,ki,ki->a", J, left, np.broadcast_to(weights, left.shape)) + prior * x
        x = x - covariance @ gradient
    return x, covariance


def _angle_findings(estimate: _AngleEstimate, worst: float, seen: _Seen) -> list[Finding]:
    """Return a list of findings on the angle, of which `worst` is the largest standard deviation."""
    findings = []
    if worst > _MAX_RELIABLE_HINGE_ANGLE_STD_IN_RADIANS:
        text = (
            f"The angle is known to {worst:.2g} rad only: neither the force at the hinge point nor the angular "
            "velocity shows a direction across the axis for long enough."
        )
        findings.append(Finding(text, False))
    if estimate.excess > _MAX_EXCESS:
        text = (
            f"Directions are {estimate.excess:.2g} times as far from the integrated angle as their noise explains: "
            "the axis or the point may be wrong."
        )
        findings.append(Finding(text, False))
    if estimate.contradicted > _MAX_CONTRADICTED:
        text = (
            f"{percent(estimate.contradicted)} of the directions contradict the integrated rate: units, the sign "
            "of n2, the axes, the point or the clocks may be wrong."
        )
        findings.append(Finding(text, False))
    if estimate.unresolved_lag:
        text = (
            f"What is left of the directions is correlated over {estimate.unresolved_lag} samples and more, too long "
            "relative to the whole recording: the standard deviations of the angle are too small."
        )
        findings.append(Finding(text, True))
    along = np.stack([force[:, 2] for force in seen.pulling])
    off = float(np.sqrt(np.mean((along[0] - along[1]) ** 2)))
    size = float(np.sqrt(np.mean(seen.pulling[0] ** 2) * 3))
    if off > _MAX_FORCE_DIFFERENCE * size:
        text = f"The forces along the axis differ by {off:.2g} m/s^2 rms: the axis, the point or units may be wrong."
        findings.append(Finding(text, False))
    return findings


class _AngleEstimate(NamedTuple):
    """Estimate of the hinge angle over time (`psi`, `std`) and of the constant bias of its rate (`drift`,
    `drift_std`), with the noise of a measured direction [rad].
    """

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
    """Return ((angles, variances), noise). The angles (N,) [rad] lead from `vectors2` to `vectors1` (N, 3) about the
    third axis. Both arrays hold the same vectors, seen in body 1 and in body 2, each in axes of which the third is
    the hinge axis. The variances (N,) of the angles are inf if either vector is too short across the hinge axis.
    `noise` is the rms difference between the lengths of both vectors across the hinge axis.
    """
    a, b = (vector[:, 0] + 1j * vector[:, 1] for vector in (vectors1, vectors2))
    sizes = np.abs(a), np.abs(b)
    noise = max(float(np.sqrt(np.mean((sizes[0] - sizes[1]) ** 2))), 1e-9)
    least = max(
        _MIN_VECTOR_LENGTH_ACROSS_HINGE_AXIS_TO_LARGEST_LENGTH * float(max(sizes[0].max(), sizes[1].max())), 3 * noise
    )
    seen = np.minimum(*sizes) > least
    variances = np.full(a.size, np.inf)
    variances[seen] = noise**2 / 2 * (1 / sizes[0][seen] ** 2 + 1 / sizes[1][seen] ** 2)
    return (np.angle(a * np.conj(b)), np.maximum(variances, _MIN_DIRECTION_NOISE_STD_IN_RADIANS**2)), noise


def _most_likely_angle(
    t: Float64Array,
    rate: Float64Array,
    rate_noise: float,
    angles: Float64Array,
    variances: Float64Array,
    bias_std: float,
    piece_starts: NDArray[np.intp],
    derivatives: Float64Array,
    covariance: Float64Array,
) -> _AngleEstimate:
    """Fit the hinge angle to its measured rates (N,), which have a constant bias, and to k measured angles (k, N),
    known up to multiples of 2 pi; return an _AngleEstimate. `rate_noise` and `bias_std` are the standard deviations
    of a rate and of the bias [rad/s], `variances` (k, N) are the variances of the measured angles, inf for a missing
    angle. `piece_starts` are the indices of samples after gaps. `derivatives` (j, k + 1, N) are those of the angles
    and of the rate by j unknowns, and `covariance` (j, j) is that of the unknowns.
    """
    dt = np.diff(t)
    steps_of_angle = (rate[1:] + rate[:-1]) / 2 * dt
    step_weights = 1 / (rate_noise * dt) ** 2
    steps_of_angle[piece_starts - 1] = 0.0  # nothing is known of a gap
    step_weights[piece_starts - 1] = 1 / _UNMEASURED**2
    precision = 1 / variances
    psi = _unwrapped_start(np.concatenate(([0.0], np.cumsum(steps_of_angle))), angles, precision)
    weights = precision
    for _ in range(_NUM_HINGE_ANGLE_SMOOTHING_ROUNDS):
        near = angles + 2 * np.pi * np.rint((psi - angles) / (2 * np.pi))
        off = (psi - near) * np.sqrt(precision)
        weights = precision / (1 + off**2 / _LOSS_SCALE_OF_SQUARED_DIRECTION_RESIDUAL_IN_NOISE_VARIANCES)
        psi = _Smoother(dt, step_weights, weights, bias_std).solve(steps_of_angle, near)[0]
    near = angles + 2 * np.pi * np.rint((psi - angles) / (2 * np.pi))
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
    # what the unknowns change goes through the same smoother
    changes = []
    for change in derivatives:
        steps = (change[-1, 1:] + change[-1, :-1]) / 2 * dt
        steps[piece_starts - 1] = 0.0
        changes.append(smoother.solve(steps, change[:-1]))
    by_unknowns = np.stack([change for change, _ in changes])
    values, vectors = np.linalg.eigh(covariance)
    spread = vectors * np.sqrt(np.maximum(values, 0.0))
    std = np.sqrt(random_std**2 + ((spread.T @ by_unknowns) ** 2).sum(axis=0))
    drifts = spread.T @ np.array([change for _, change in changes])
    seen = variances[np.isfinite(variances)]
    noise = float(np.sqrt(np.median(seen))) if seen.size else np.inf
    near = angles + 2 * np.pi * np.rint((psi - angles) / (2 * np.pi))
    off = np.abs(psi - near)[np.isfinite(variances)]
    # off by many deviations, and by more than half of what chance would leave
    far = (off > _MIN_CONTRADICTION * np.sqrt(seen)) & (off > 0.2)
    contradicted = float(far.mean()) if far.size else 0.0
    drift_std = float(np.sqrt(drift_std**2 + drifts @ drifts))
    return _AngleEstimate(psi, std, drift, drift_std, noise, excess, contradicted, lag)


def _unwrapped_start(integrated_rates: Float64Array, angles: Float64Array, precision: Float64Array) -> Float64Array:
    """Return a first estimate (N,) of the hinge angle without jumps by 2 pi: the integrated rates (N,), of which the
    measured `angles` (k, N) correct the slow drift. `precision` (k, N) is the inverse of the variances of `angles`.
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
    """Weighted least squares of N angles and of the bias of their rate, factorised once. `step_weights` (N - 1,) and
    `angle_weights` (k, N) are inverse variances of measured steps, over the times `dt`, and of measured angles;
    `bias_std` is the standard deviation of the bias before the fit.
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
        least = 1 / max(bias_std, _MIN_HINGE_RATE_BIAS_STD_IN_RADIANS_PER_SECOND) ** 2
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
    """Return a read-only array of `num_samples` numbers that has `values` at `used_indices` and NaN elsewhere."""
    all_samples = np.full(num_samples, np.nan)
    all_samples[used_indices] = values
    return read_only(all_samples)
