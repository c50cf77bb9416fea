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
from hingepair.measured.hinge import Hinge, frame, home_angle, home_of
from hingepair.measured.inertial import acceleration_matrices, checked_recording
from hingepair.measured.likelihood import score_scatter
from hingepair.measured.spline import MIN_SAMPLES_PER_SMOOTHED_PIECE, inverse_bands, smooth_columns
from hingepair.numeric.arrays import Float64Array, constant, number_not_below_0, read_only
from hingepair.numeric.instants import checked_gaps, split_at_gaps
from hingepair.numeric.unit_vectors import unit_axis

_NUM_HINGE_ANGLE_SMOOTHING_ROUNDS = 8  # of the smoother, each with the directions nearest to the last angle
_MIN_VECTOR_LENGTH_ACROSS_HINGE_AXIS_TO_LARGEST_LENGTH = 0.05  # from which a vector shows a direction
_MAX_RELIABLE_HINGE_ANGLE_STD_IN_RADIANS = 0.2  # [rad]: an angle that is known less well is not to be relied on
# Above, a direction counts less.
_LOSS_SCALE_OF_SQUARED_DIRECTION_RESIDUAL_IN_NOISE_VARIANCES = 4.0
_MAX_RMS_DIRECTION_RESIDUAL_TO_DIRECTION_NOISE = 3.0  # of directions about the most likely angle
_MIN_DIRECTION_NOISE_STD_IN_RADIANS = 1e-9  # [rad]
_MIN_HINGE_RATE_BIAS_STD_IN_RADIANS_PER_SECOND = 1e-9  # [rad/s]
# [rad], of an angle, or a change over a gap, that nothing measures.
_PRIOR_STD_OF_UNMEASURED_HINGE_ANGLE_IN_RADIANS = 1e6


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
        std: standard deviation of psi [rad]; shape (N,), NaN where psi is NaN.
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
    longest = checked_gaps(gaps)
    where = split_at_gaps(time, known, longest, MIN_SAMPLES_PER_SMOOTHED_PIECE)
    if not where:
        raise FitError(
            ", ".join(named_vectors),
            f"at least {MIN_SAMPLES_PER_SMOOTHED_PIECE} finite samples without a gap",
            int(known.sum()),
        )
    used = np.concatenate(where)
    seen = []
    for omega, force, lever, axis in zip(columns[::2], columns[1::2], levers, axes, strict=True):
        smooth = smooth_columns(time, omega, where, None)
        at_hinge = force[used] + acceleration_matrices(*smooth.values[:2, used]) @ lever
        seen.append([vector @ frame(axis) for vector in (omega[used], at_hinge)])
    rate = seen[1][0][:, 2] - seen[0][0][:, 2]
    (turning, rate_noise), (pulling, _) = (_angles_between(*both) for both in zip(*seen, strict=True))
    angles, variances = (np.stack(both) for both in zip(turning, pulling, strict=True))
    starts = np.cumsum([piece.size for piece in where])[:-1]
    estimate = _most_likely_angle(time[used], rate, rate_noise, angles, variances, np.sqrt(2) * bias, starts)
    pull = float(np.sqrt(np.mean(seen[0][1][:, :2] ** 2) * 2))
    std = np.hypot(estimate.std, min(np.sqrt(2) * tilting / max(pull, 1e-300), np.pi) if tilting else 0.0)
    hinge = Hinge(axes[0], axes[1], levers[0], levers[1])
    psi = estimate.psi - home_angle(hinge, home_of(hinge))
    psi -= 2 * np.pi * np.rint(psi[0] / (2 * np.pi))
    worst = float(std.max())
    findings = []
    if worst > _MAX_RELIABLE_HINGE_ANGLE_STD_IN_RADIANS:
        findings.append(
            f"The angle is known to {worst:.2g} rad only: neither the force at the hinge point nor the angular "
            "velocity shows a direction across the axis for long enough."
        )
    if estimate.excess > _MAX_RMS_DIRECTION_RESIDUAL_TO_DIRECTION_NOISE:
        findings.append(
            f"Directions are {estimate.excess:.2g} times as far from the integrated angle as their noise explains: "
            "the axis or the point may be wrong."
        )
    return AngleFit(
        psi=_at_used_indices(psi, used, time.size),
        psid=_at_used_indices(rate - estimate.drift, used, time.size),
        std=_at_used_indices(std, used, time.size),
        drift=estimate.drift,
        drift_std=estimate.drift_std,
        noise=estimate.noise,
        ok=not findings,
        findings=tuple(findings),
    )


class _AngleEstimate(NamedTuple):
    """Estimate of the hinge angle over time (`psi`, `std`) and of the constant bias of its rate (`drift`,
    `drift_std`), with the noise of a measured direction [rad] and the ratio of the scatter of the directions to their
    noise (`excess`).
    """

    psi: Float64Array  # [rad]; (N,)
    std: Float64Array  # (N,)
    drift: float  # bias of the rate [rad/s]
    drift_std: float
    noise: float  # of a direction, the median [rad]
    excess: float  # scatter of the directions, in parts of what their noise explains


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
) -> _AngleEstimate:
    """Fit the hinge angle to its measured rates (N,), which have a constant bias, and to k measured angles (k, N),
    known up to multiples of 2 pi; return an _AngleEstimate. `rate_noise` and `bias_std` are the standard deviations
    of a rate and of the bias [rad/s], `variances` (k, N) are the variances of the measured angles, inf for a missing
    angle. `piece_starts` are the indices of samples after gaps.
    """
    dt = np.diff(t)
    steps_of_angle = (rate[1:] + rate[:-1]) / 2 * dt
    step_weights = 1 / (rate_noise * dt) ** 2
    step_weights[piece_starts - 1] = 1 / _PRIOR_STD_OF_UNMEASURED_HINGE_ANGLE_IN_RADIANS**2
    precision = 1 / variances
    psi = _unwrapped_start(np.concatenate(([0.0], np.cumsum(steps_of_angle))), angles, precision)
    weights = precision
    for _ in range(_NUM_HINGE_ANGLE_SMOOTHING_ROUNDS):
        near = angles + 2 * np.pi * np.rint((psi - angles) / (2 * np.pi))
        off = (psi - near) * np.sqrt(precision)
        weights = precision / (1 + off**2 / _LOSS_SCALE_OF_SQUARED_DIRECTION_RESIDUAL_IN_NOISE_VARIANCES)
        psi, _, _ = _solve_smoother(dt, steps_of_angle, step_weights, weights, near, bias_std)
    near = angles + 2 * np.pi * np.rint((psi - angles) / (2 * np.pi))
    rows = [((psi - one) * np.sqrt(weight))[weight > 0] for one, weight in zip(near, weights, strict=True)]
    excess, memory = 0.0, 1.0
    for row in rows:
        if row.size > MIN_SAMPLES_PER_SMOOTHED_PIECE:
            excess = max(excess, float(np.sqrt(np.mean(row * row))))
            memory = max(memory, float(score_scatter(row[None])[0][0, 0] / max(row @ row, 1e-300)))
    scale = max(excess, 1.0) ** 2 * memory
    psi, std, (drift, drift_std) = _solve_smoother(dt, steps_of_angle, step_weights, weights / scale, near, bias_std)
    seen = variances[np.isfinite(variances)]
    noise = float(np.sqrt(np.median(seen))) if seen.size else np.inf
    return _AngleEstimate(psi, std, drift, drift_std, noise, excess)


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


def _solve_smoother(
    dt: Float64Array,
    steps_of_angle: Float64Array,
    step_weights: Float64Array,
    angle_weights: Float64Array,
    angles: Float64Array,
    bias_std: float,
) -> tuple[Float64Array, Float64Array, tuple[float, float]]:
    """Return a tuple of the hinge angles (N,) of weighted least squares, their standard deviations (N,), and a pair
    of the rate's bias and the standard deviation of the bias. `steps_of_angle` (N - 1,) are the measured changes over
    the times dt between samples, and `angles` (k, N) are the measured angles. `step_weights` and `angle_weights` are
    inverse variances, and `bias_std` is the standard deviation of the bias before the fit.
    """
    from scipy.linalg import solveh_banded

    count = steps_of_angle.size + 1
    right, border, matrix = np.zeros(count), np.zeros(count), np.zeros((2, count))
    right[1:] += step_weights * steps_of_angle
    right[:-1] -= step_weights * steps_of_angle
    border[1:] += step_weights * dt
    border[:-1] -= step_weights * dt
    matrix[0, 1:] = -step_weights
    matrix[1, 1:] += step_weights
    matrix[1, :-1] += step_weights
    matrix[1] += angle_weights.sum(axis=0) + 1 / _PRIOR_STD_OF_UNMEASURED_HINGE_ANGLE_IN_RADIANS**2
    right += (angle_weights * np.where(angle_weights > 0, angles, 0.0)).sum(axis=0)
    x, y = solveh_banded(matrix, np.stack((right, border), axis=-1)).T
    drift_precision = (
        (step_weights * dt) @ dt + 1 / max(bias_std, _MIN_HINGE_RATE_BIAS_STD_IN_RADIANS_PER_SECOND) ** 2 - border @ y
    )
    drift = float(((step_weights * steps_of_angle) @ dt - border @ x) / drift_precision)
    variance = inverse_bands(matrix, 1)[0, :count] + y * y / drift_precision
    return x - drift * y, np.sqrt(variance), (drift, float(1 / np.sqrt(drift_precision)))


def _at_used_indices(values: Float64Array, used_indices: NDArray[np.intp], num_samples: int) -> Float64Array:
    """Return a read-only array of `num_samples` numbers that has `values` at `used_indices` and NaN elsewhere."""
    all_samples = np.full(num_samples, np.nan)
    all_samples[used_indices] = values
    return read_only(all_samples)
