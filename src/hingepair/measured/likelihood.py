"""The most likely hinge: Gauss-Newton on the constraints, psi and every true pose eliminated.

Each pose is off by isotropic noise, of place and of attitude, alike for both bodies. What the constraints leave of
sample i, the tilt Q m - n (two components) and the gap u1 - p - Q u2 (three), is then linear in that noise, so that
the most likely hinge makes `sum r_i^T C_i^-1 r_i` least, with C_i the covariance of r_i (the adjustment of condition
equations with parameters, Helmert 1872; Förstner and Wrobel, Photogrammetric Computer Vision, 2016, 4.8). All is
written in axes along the hinge. There the tilt is seen free of the gap; half of the lever times the tilt is taken
from the gap, after which it is

    C = a + b (abs(p)^2 - p p^T) + c w w^T,   w = n x (S1 u1 + S2 u2),

a the variance of R2 - R1, b and c a quarter of that of the relative attitude s. Where it is told that the attitude of
body 1 has the part k of that variance, b = k (1 - k) s and w = 2 n x (k S1 u1 + (1 - k) S2 u2).

An unknown offset between the clocks of the bodies is one more parameter. An encoder that reads psi adds one residual,
psi - zero - slope * reading; the part of the gap that goes with it is taken from the gap, which leaves
c = (1 - g) s / 4, where g is the part of the residual's variance that the attitudes make.

Samples are walked through in blocks; nothing of the size of a Jacobian of all samples is kept.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from hingepair.measured.hinge import Hinge, frame
from hingepair.measured.relative_poses import RelativePoses
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.bounded import FLOAT64_UNIT_ROUNDOFF
from hingepair.rotations.matrices import rotation_exp

NUM_HINGE_PARAMETERS = 9
"""Those of `Hinge.moved`, which come first; then the clock offset and the encoder's line, where they are sought."""
_MAX_THINNED_SAMPLES_FOR_NOISE_VARIANCES = 4096  # samples that the variance components are estimated from
# Least noise of positions, or of the encoder, to the mean squared residual.
_MIN_POSITION_OR_ENCODER_NOISE_VARIANCE_TO_SQUARED_RESIDUAL = 1e-3
# [rad/s]: converts a step of the clock offset to a rotation, to judge the length of the step.
_EQUIVALENT_ROTATION_OF_CLOCK_OFFSET_STEP_IN_RADIANS_PER_SECOND = 5.0
_EFFICIENCY_OF_MEDIAN_TO_MEAN_SQUARE_VARIANCE_ESTIMATE = 0.37  # beside variances by squares
_NUM_SAMPLES_PER_RESIDUAL_BLOCK = 2048  # samples, that fit the caches
MAX_THINNED_SAMPLES_FOR_FIRST_FIT_PASS = 16384  # samples that the first steps are taken with
# About so many samples, in stretches of blocks, give the covariance.
_APPROXIMATE_NUM_SAMPLES_FOR_COVARIANCE = 131072
_MIN_NUM_SCORE_SUMS_FOR_COVARIANCE = 40  # sums of neighbouring scores that the covariance is taken from, at least
# A fit of many samples makes two passes: with thinned samples, then with all.
_MAX_GAUSS_NEWTON_STEPS_PER_HINGE_FIT_PASS = 40
_MAX_ROTATION_PER_GAUSS_NEWTON_STEP_IN_RADIANS = 0.3  # [rad]; longer steps are shortened
_MAX_CONVERGED_HINGE_STEP_NORM_IN_PARAMETER_STDS = 0.02  # below, the steps have converged
_MAX_PREDICTED_NEXT_HINGE_STEP_NORM_IN_PARAMETER_STDS = 0.1  # likewise of the next step
_MAX_THINNED_SAMPLES_FOR_HINGE_BIAS = 300  # samples that the bias is computed from
_MIN_CORRECTED_HINGE_BIAS_IN_STDS = 0.1  # below, the bias is left
MAX_THINNED_SAMPLES_FOR_PSI_ZERO_SHIFT = 100  # samples of poses that tell by how much the zero of psi shifts
_MAX_INLIER_ENCODER_RESIDUAL_TO_MEDIAN_RESIDUAL = 5.0  # of samples that the encoder's zero is computed from
# Of what noise adds to the normal matrix, from which the clock offset is shown.
MIN_SIGNAL_TO_NOISE_POWER_OF_DETERMINED_CLOCK_OFFSET = 10.0
MAX_STD_OF_DETERMINED_CLOCK_OFFSET_IN_SECONDS = 0.1  # [s]: an offset that is known less well is not shown
_MAX_COSINE_OF_OPPOSITE_HINGE_AXES = -0.999999  # cosine of axes below which they point against each other
_LOSS_SCALE_OF_WHITENED_SQUARED_RESIDUAL = 11.07
"""Size of r^T C^-1 r at which losses other than "linear" bend: 95 % of good samples are below."""
_MAX_WHITENED_SQUARED_RESIDUAL_FOR_NOISE_ESTIMATE = 100.0
"""From this size on a sample is left out of the medians that estimate the noise."""
_MIN_WHITENED_SQUARED_RESIDUAL_OF_ZERO_WEIGHT = 900.0
"""From this size on a sample has no weight in losses other than "linear"."""
CHI2_MEDIAN_BY_DOF = {1: 0.4549, 2: 1.3863, 3: 2.3660, 5: 4.35}  # of chi-squared, by degrees of freedom

Loss = Callable[[Float64Array], tuple[Float64Array, Float64Array]]

LOSS_DERIVATIVE_FUNCTION_OR_NONE_BY_NAME: dict[str, Loss | None] = {
    "linear": None,
    "soft_l1": lambda z: ((1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5),
    "huber": lambda z: (np.maximum(z, 1) ** -0.5, np.where(z > 1, -0.5 * np.maximum(z, 1) ** -1.5, 0.0)),
    "cauchy": lambda z: (1 / (1 + z), -1 / (1 + z) ** 2),
    "arctan": lambda z: (1 / (1 + z * z), -2 * z / (1 + z * z) ** 2),
}
"""First and second derivative of each loss, as SciPy's least_squares defines them."""


class Noise(NamedTuple):
    """Variances of the noise of a component of relative positions (`place`, [m^2]), of a component of relative
    attitudes (`attitude`, [rad^2]) and of the encoder (`encoder`, [rad^2]). If the user gave standard deviations of
    single samples, the first two are mean variances.
    """

    place: float  # of a component of R2 - R1 [m^2]
    attitude: float  # of a component of the relative attitude [rad^2]
    encoder: float = 0.0  # of an encoder's reading, as a hinge angle [rad^2]


class EncoderLine(NamedTuple):
    """The line psi = zero + slope * reading that relates the reading of an encoder to the hinge angle. The angle psi
    leads from the first axis that the function `frame` returns for n, fixed in body 1, to the first axis that it
    returns for m, fixed in body 2.
    """

    zero: float  # [rad]
    slope: float  # [rad] in a unit of the reading


class SampleResiduals(NamedTuple):
    """Residuals of the hinge constraints, which are the tilt between the axes (`tilt`, E2) and the gap at the hinge
    point (`gap`, E1), and of the encoder (`turn`) at a block of M samples, in axes of which the third is the hinge
    axis. Further fields are the relative poses (`q`, `p`), levers and noise from which their covariance is computed,
    and derivatives with respect to the clock offset (`offset_derivatives`).
    """

    q: Float64Array  # relative attitude, row by row; shape (9, M)
    p: Float64Array  # relative place [m]; shape (3, M)
    arms: Float64Array  # S1 u1 + S2 u2 [m]; shape (3, M)
    tilt: Float64Array  # of Q m - n the direction, its length the chord; shape (2, M)
    gap: Float64Array  # of E1, half of the tilt's share taken out [m]; shape (3, M)
    offset_derivatives: Float64Array | None = None  # of tilt, gap and psi, by the clock offset; shape (6, M)
    relative_noise: Float64Array | None = None  # of each sample, as `Samples.relative_noise`; shape (3, M)
    reading: Float64Array | None = None  # of the encoder, NaN where none; shape (M,)
    turn: Float64Array | None = None  # psi less what the encoder says, 0 where it says nothing [rad]; shape (M,)
    slope: float = 1.0  # of the encoder's line

    @property
    def psi(self) -> Float64Array:
        """Return the hinge angles (M,) [rad], within [-pi, pi], from the first axis that the function `frame` returns
        for n, fixed in body 1, to the first axis that it returns for m, fixed in body 2.
        """
        return np.asarray(np.arctan2(self.q[3] - self.q[1], self.q[0] + self.q[4]))

    def variances(self, noise: Noise) -> tuple[Any, Any, Any]:
        """Return a tuple of three values: the variance of the relative position [m^2], the variance of the relative
        attitude [rad^2], and the fraction of the variance of the attitude that is due to body 1. Each is a number, or
        an array (M,) if the user gave the noise of every sample.
        """
        if self.relative_noise is None:
            return noise.place, noise.attitude, 0.5
        return noise.place * self.relative_noise[0], noise.attitude * self.relative_noise[1], self.relative_noise[2]

    @property
    def gap_variance_by_attitude(self) -> Float64Array:
        """Return the mean squared gap [m^2] that attitude noise of variance 1 rad^2 causes at the hinge point;
        shape (M,).
        """
        x, y, _ = self.arms
        _, scale, share = self.variances(Noise(1.0, 1.0))
        return np.asarray(scale * (2 * share * (1 - share) * (self.p**2).sum(axis=0) + (x * x + y * y) / 4))

    def whiten(
        self, noise: Noise, tilts: Float64Array, gaps: Float64Array, turns: Float64Array | None = None
    ) -> Float64Array:
        """Return residuals, or derivatives of residuals, multiplied by L^-1, where L L^T is the covariance of the
        noise. The inputs are `tilts` (k, 2, M), `gaps` (k, 3, M) and, with an encoder, `turns` (k, M). They are
        joined in the result, (k, 5 or 6, M).

        L is the Cholesky factor, with w = (-y, x, 0); no eigenvalue of the covariance is below a.
        """
        a, attitude, share = self.variances(noise)
        b, c = attitude * share * (1 - share), attitude / 4
        (p, q, r), (x, y, _) = self.p, self.arms
        rows = np.empty((tilts.shape[0], 5 if turns is None else 6, tilts.shape[2]))
        if turns is not None and self.reading is not None:
            total = attitude + noise.encoder
            gain = np.where(np.isfinite(self.reading), attitude / total, 0.0)
            c = c * (1 - gain)
            gaps = gaps + 0.5 * gain * turns[:, None] * np.stack((-y, x, np.zeros_like(x)))
            rows[:, 5] = turns / np.sqrt(total)
        xy, zx, yz = -b * p * q - c * x * y, -b * r * p, -b * q * r
        l1 = np.sqrt(a + b * (q * q + r * r) + c * y * y)
        l2, l3 = xy / l1, zx / l1
        m2 = np.sqrt(np.maximum(a + b * (r * r + p * p) + c * x * x - l2 * l2, a))
        m3 = (yz - l2 * l3) / m2
        n3 = np.sqrt(np.maximum(a + b * (p * p + q * q) - l3 * l3 - m3 * m3, a))
        rows[:, :2] = tilts / np.sqrt(attitude)
        rows[:, 2] = gaps[:, 0] / l1
        rows[:, 3] = (gaps[:, 1] - l2 * rows[:, 2]) / m2
        rows[:, 4] = (gaps[:, 2] - l3 * rows[:, 2] - m3 * rows[:, 3]) / n3
        return rows

    def whitened_squares(self, noise: Noise) -> Float64Array:
        """Return the whitened squared residuals r^T C^-1 r (M,) of residuals r with the covariance C. If the noise is
        right, they are about 5 on average, or 6 with an encoder.
        """
        turns = None if self.turn is None else self.turn[None]
        return np.asarray((self.whiten(noise, self.tilt[None], self.gap[None], turns)[0] ** 2).sum(axis=0))

    def whitened_rows(self, noise: Noise) -> Float64Array:
        """Return the whitened derivatives of the residuals with respect to each parameter, and the whitened residuals
        as the last row; shape (parameters + 1, 5 or 6, M). The parameters are the nine of the hinge, then the clock
        offset, the zero and the slope of the encoder, as far as they are estimated. `noise` is the Noise by which
        residuals are whitened.
        """
        q, (x, y, z), count = self.q, self.arms, self.q.shape[1]
        parameters = NUM_HINGE_PARAMETERS + (self.offset_derivatives is not None) + (0 if self.turn is None else 2)
        tilts, gaps = np.zeros((parameters + 1, 2, count)), np.zeros((parameters + 1, 3, count))
        turns = None if self.turn is None else np.zeros((parameters + 1, count))
        tilts[0, 0] = tilts[1, 1] = -1.0
        tilts[2], tilts[3], tilts[-1] = q[0:6:3], q[1:6:3], self.tilt
        for k in range(4):
            gaps[k, :2] = 0.5 * z * tilts[k]
            gaps[k, 2] = -0.5 * (tilts[k, 0] * x + tilts[k, 1] * y)
        for k in range(3):
            gaps[4 + k, k] = 1.0
        gaps[7], gaps[8], gaps[-1] = -q[0::3], -q[1::3], self.gap
        if self.offset_derivatives is not None:
            tilts[NUM_HINGE_PARAMETERS], gaps[NUM_HINGE_PARAMETERS] = (
                self.offset_derivatives[:2],
                self.offset_derivatives[2:5],
            )
        if turns is not None and self.reading is not None and self.turn is not None:
            read = np.isfinite(self.reading)
            # the reading without noise, as psi and the encoder have it together: else its noise makes the slope small
            _, attitude, _ = self.variances(noise)
            likeliest = self.reading + noise.encoder / (attitude + noise.encoder) * self.turn / self.slope
            turns[-3], turns[-2], turns[-1] = np.where(read, -1.0, 0.0), np.where(read, -likeliest, 0.0), self.turn
            if self.offset_derivatives is not None:
                turns[NUM_HINGE_PARAMETERS] = np.where(read, self.offset_derivatives[5], 0.0)
        return self.whiten(noise, tilts, gaps, turns)


class Estimate(NamedTuple):
    """The most likely Hinge (`hinge`), with the Noise, the clock offset [s] by which body 2 was recorded later than
    body 1 at equal stamps (`offset`), the EncoderLine or None (`line`), and whether the estimate converged.
    """

    hinge: Hinge
    noise: Noise
    has_converged: bool  # whether the steps came to rest
    offset: float = 0.0  # by how much later body 2 was recorded than body 1 at equal stamps [s]
    line: EncoderLine | None = None  # of the encoder


PosesAt = Callable[[float, int], RelativePoses]
"""Function of the clock offset [s] and of how many samples are needed at most, that returns relative poses."""


class HingeResiduals(NamedTuple):
    """Residuals (`tilt`, `gap`, `turn`), whitened squared residuals (`whitened_squares`), weights and hinge angles
    (`psi`) of all samples for a given hinge, the correlations of neighbouring residuals (`neighbour_correlations`),
    the number of samples over which residuals are still correlated (`unresolved_lag`), and the covariance of the
    hinge's parameters.
    """

    tilt: Float64Array  # angle between the axes [rad]; shape (N,)
    gap: Float64Array  # of E1, in axes along the hinge [m]; shape (3, N)
    psi: Float64Array  # angle about the hinge from one `frame` to the other, in [-pi, pi] [rad]; shape (N,)
    whitened_squares: Float64Array  # r^T C^-1 r; shape (N,)
    weights: Float64Array  # given, times those of the loss; shape (N,)
    neighbour_correlations: tuple[float, float]  # correlations of neighbours, of tilts and of gaps
    covariance: Float64Array  # of the parameters
    unresolved_lag: int  # samples over which scores are still correlated at the longest sums; 0 where they are not
    turn: Float64Array  # psi less what the encoder says, 0 where it says nothing [rad]; shape (N,)


def most_likely_hinge(
    poses: RelativePoses, start: Hinge, loss: Loss | None, poses_at: PosesAt | None = None, offset: float = 0.0
) -> Estimate:
    """Estimate the most likely hinge for `poses` by Gauss-Newton steps from the hinge `start`; return an Estimate
    with the noise and the encoder's line. `loss` is a function that returns the derivatives of the loss of a sample;
    None means least squares. If `poses_at`, a function of the clock offset and of the largest number of samples that
    returns RelativePoses, is given, estimate the clock offset too, from the first value `offset` [s].
    """
    poses_at = poses_at or (lambda _, max_samples: poses.thinned(max_samples))
    some = poses_at(offset, MAX_THINNED_SAMPLES_FOR_FIRST_FIT_PASS)
    hinge, line = start, fit_encoder_line(some, start)
    noise = _estimate_noise(some, hinge, None, loss, line)
    has_converged = False
    for most in (
        (MAX_THINNED_SAMPLES_FOR_FIRST_FIT_PASS, sys.maxsize)  # then all: how many match depends on the offset
        if poses.samples > MAX_THINNED_SAMPLES_FOR_FIRST_FIT_PASS
        else (sys.maxsize,)
    ):
        some = poses_at(offset, most)
        for _ in range(_MAX_GAUSS_NEWTON_STEPS_PER_HINGE_FIT_PASS):
            normal, gradient = _normal_equations(some, hinge, noise, loss, line)
            step = -solve_semidefinite(normal, gradient)
            delay = float(step[NUM_HINGE_PARAMETERS]) if some.offset_derivatives is not None else 0.0
            rotation = max(
                float(np.abs(step[:4]).max()),
                _EQUIVALENT_ROTATION_OF_CLOCK_OFFSET_STEP_IN_RADIANS_PER_SECOND * abs(delay),
            )
            if rotation > _MAX_ROTATION_PER_GAUSS_NEWTON_STEP_IN_RADIANS:
                step *= _MAX_ROTATION_PER_GAUSS_NEWTON_STEP_IN_RADIANS / rotation
            before, hinge = hinge, hinge.moved(step[:NUM_HINGE_PARAMETERS]).balanced()
            if line is not None:
                zero = (
                    line.zero
                    + float(step[-2])
                    + frame_turn_angle(some.thinned(MAX_THINNED_SAMPLES_FOR_PSI_ZERO_SHIFT), before, hinge)
                )
                line = EncoderLine(zero, line.slope + float(step[-1]))
            if some.offset_derivatives is not None:
                offset += float(step[NUM_HINGE_PARAMETERS])
                some = poses_at(offset, most)
            noise = _estimate_noise(some.thinned(MAX_THINNED_SAMPLES_FOR_FIRST_FIT_PASS), hinge, noise, loss, line)
            # in standard deviations; without a loss the next step is about this one times the noise
            size = np.sqrt(step @ normal @ step)
            quick = (
                loss is None
                and size * (rotation + np.sqrt(noise.attitude))
                < _MAX_PREDICTED_NEXT_HINGE_STEP_NORM_IN_PARAMETER_STDS
            )
            rounding_step = 2.0**-50 * np.repeat((1.0, poses.size), (4, 5))  # rotations [rad], shifts [m]
            rounded = (np.abs(step[:NUM_HINGE_PARAMETERS]) < rounding_step).all() and abs(delay) < 1e-12  # s
            has_converged = bool(size < _MAX_CONVERGED_HINGE_STEP_NORM_IN_PARAMETER_STDS or quick or rounded)
            if has_converged:
                break
    return Estimate(hinge, noise, has_converged, offset, line)


def fit_encoder_line(
    poses: RelativePoses, hinge: Hinge, previous_line: EncoderLine | None = None
) -> EncoderLine | None:
    """Fit the line psi = zero + slope * reading of the encoder for a given hinge; return an EncoderLine, or None if
    `poses` have no encoder readings. If `previous_line` is given, only the zero and the sign of the slope are fitted.

    The sign changes if the axis of the hinge was reversed since `previous_line` was fitted.
    """
    if poses.encoder is None:
        return None
    psi = np.concatenate([seen.psi for _, seen in iterate_residuals(poses, hinge)])
    has_reading = np.isfinite(poses.encoder)
    psi, reading, weights = psi[has_reading], poses.encoder[has_reading], poses.weights[has_reading]
    slopes = _encoder_slopes(psi, reading) if previous_line is None else [previous_line.slope, -previous_line.slope]
    lines = [_encoder_line_of_slope(psi, reading, weights, slope) for slope in slopes]
    return min(lines, key=lambda line: float(np.median(np.abs(_encoder_residual(psi, reading, line)))))


def frame_turn_angle(poses: RelativePoses, before: Hinge, after: Hinge) -> float:
    """Return the change of psi [rad] when the hinge changes from `before` to `after` at equal `poses`, as the median
    over the poses. The change arises because psi is counted between the axes that the function `frame` returns for n
    and m.
    """
    first, second = (
        np.concatenate([seen.psi for _, seen in iterate_residuals(poses, hinge)]) for hinge in (before, after)
    )
    turned = np.exp(1j * (second - first))
    return float(np.angle(np.median(turned.real) + 1j * np.median(turned.imag)))


def _encoder_slopes(psi: Float64Array, reading: Float64Array) -> list[float]:
    """Return a list of candidate slopes d psi / d reading of an encoder: 1, -1, the slope of a straight line through
    all samples, and the median slope between successive samples. The last two are missing if all readings are equal.
    """
    slopes = [1.0, -1.0]
    steps, turned = np.diff(reading), np.angle(np.exp(1j * np.diff(psi)))
    if np.ptp(reading) > 0:
        slopes.append(float(np.polyfit(reading - np.median(reading), np.unwrap(psi), 1)[0]))
        moved = steps != 0
        slopes.append(float(np.median(turned[moved] / steps[moved])) if moved.any() else 1.0)
    return slopes


def _encoder_line_of_slope(
    psi: Float64Array, reading: Float64Array, weights: Float64Array, slope: float
) -> EncoderLine:
    """Return the EncoderLine with a given slope, fitted to hinge angles psi (N,) and encoder readings (N,). The zero
    is a mean, weighted by `weights`, over the samples whose own zeros are near the median zero.
    """
    off = np.exp(1j * (psi - slope * reading))
    middle = float(np.angle(np.median(off.real) + 1j * np.median(off.imag)))
    rest = _encoder_residual(psi, reading, EncoderLine(middle, slope))
    near = np.abs(rest) <= _MAX_INLIER_ENCODER_RESIDUAL_TO_MEDIAN_RESIDUAL * np.median(np.abs(rest)) + 1e-300
    return EncoderLine(middle + float(weights[near] @ rest[near] / weights[near].sum()), slope)


def _encoder_residual(psi: Float64Array, reading: Float64Array, encoder_line: EncoderLine) -> Float64Array:
    """Return the difference [rad], within half a turn, between psi and the angle that the encoder's line gives for
    `reading`. It is 0 if the encoder has no reading.
    """
    off = np.nan_to_num(psi - encoder_line.zero - encoder_line.slope * reading)
    return np.asarray(off - 2 * np.pi * np.rint(off / (2 * np.pi)))


def attitude_noise_share(
    poses: RelativePoses, noise: Noise, encoder_line: EncoderLine | None
) -> Float64Array | float:
    """Return the fraction (N,) of the difference between psi and the encoder's angle that is due to noise of the
    attitudes, the variance of the attitude divided by the sum of both variances. psi is to be corrected by this
    fraction of the difference. Return the number 0 if `encoder_line`, the EncoderLine, is None or `poses` have no
    readings.
    """
    if encoder_line is None or poses.encoder is None:
        return 0.0
    attitude = noise.attitude * (1.0 if poses.relative_noise is None else poses.relative_noise[1])
    return np.broadcast_to(attitude / (attitude + noise.encoder), poses.samples)


def noise_standard_deviations(poses: RelativePoses, hinge: Hinge, noise: Noise, loss: Loss | None) -> dict[str, Any]:
    """Return a dict of how accurately the noise is estimated, for relative poses and a fitted Hinge: the standard
    deviations of the estimate of the position noise ("noise_position") [m] and of the estimate of the attitude noise
    ("noise_angle") [rad]. `loss` is None if least squares estimated the noise; otherwise medians did, and the
    standard deviations are larger.
    """
    thin = poses.thinned(_MAX_THINNED_SAMPLES_FOR_NOISE_VARIANCES)
    _, covariance = variance_components(thin, hinge, noise, noise, max_steps=0)
    variances = (
        np.diagonal(covariance)
        * thin.samples
        / poses.samples
        / (1.0 if loss is None else _EFFICIENCY_OF_MEDIAN_TO_MEAN_SQUARE_VARIANCE_ESTIMATE)
    )
    std = np.sqrt(variances) / (2 * np.sqrt(np.array(noise[:2])))
    return dict(zip(("noise_position", "noise_angle"), std, strict=True))


def shows_offset(poses: RelativePoses, noise_poses: RelativePoses, estimate: Estimate, loss: Loss | None) -> bool:
    """Return whether the motion determines the clock offset beside all other parameters: whether the derivatives of
    `poses` with respect to the offset contain far more information about the offset than the derivatives of
    `noise_poses`, which are noise alone, and the offset is certain enough. `estimate` is the Estimate of the hinge;
    `loss` is a function that returns derivatives of the loss, or None for least squares.
    """
    normals = [
        _normal_equations(each, estimate.hinge, estimate.noise, loss, estimate.line)[0]
        for each in (poses, noise_poses)
    ]
    k = NUM_HINGE_PARAMETERS
    others = np.delete(np.arange(normals[0].shape[0]), k)
    across = solve_semidefinite(normals[0][np.ix_(others, others)], normals[0][others, k])
    shown = normals[0][k, k] - normals[0][k, others] @ across
    return bool(
        shown > MIN_SIGNAL_TO_NOISE_POWER_OF_DETERMINED_CLOCK_OFFSET * normals[1][k, k]
        and shown * MAX_STD_OF_DETERMINED_CLOCK_OFFSET_IN_SECONDS**2 > 1
    )


def bias_of_hinge(
    poses: RelativePoses, hinge: Hinge, noise: Noise, line: EncoderLine | None = None, share: float | None = None
) -> Float64Array:
    """Return the bias of the parameters of the most likely hinge, and of the zero and the slope of the encoder's
    line, shape (9,) or (11,). It is proportional to the variance of the noise and does not decrease with the number
    of samples. `share` is the part of the variance of the attitudes that is due to body 1; None: that by which
    residuals are whitened.

    A rotation that is off at random is on average a shorter matrix than a rotation, so levers come out short. What
    the scores are on average follows from the fitted hinge itself: they are taken at its exact poses, each coordinate
    of noise once up and once down. A bias that is no tenth of a standard deviation is 0.
    """
    reach = max(float(np.sqrt((poses.p * poses.p).sum() / poses.samples)), 1e-300)
    size = np.sqrt(noise.attitude) + np.sqrt(noise.place) / reach + (0 if line is None else np.sqrt(noise.encoder))
    if np.sqrt(poses.samples) * size < _MIN_CORRECTED_HINGE_BIAS_IN_STDS:
        return np.zeros(NUM_HINGE_PARAMETERS + (0 if line is None else 2))
    thin = poses.thinned(_MAX_THINNED_SAMPLES_FOR_HINGE_BIAS)
    relative = np.repeat(((1.0,), (1.0,), (0.5,)), thin.samples, axis=1)
    relative = relative if thin.relative_noise is None else thin.relative_noise
    part = relative[2] if share is None else share
    first, second = frame(hinge.n), frame(hinge.m)
    q = np.kron(first.T, second.T) @ thin.Q
    psi = np.arctan2(q[3] - q[1], q[0] + q[4])
    c, s, zero = np.cos(psi), np.sin(psi), np.zeros_like(psi)
    Q = first @ np.stack((c, -s, zero, s, c, zero, zero, zero, zero + 1), axis=-1).reshape(-1, 3, 3) @ second.T
    p = hinge.u1 - Q @ hinge.u2
    reading = None if thin.encoder is None or line is None else (psi - line.zero) / line.slope + 0 * thin.encoder
    place, turn1, turn2 = (
        np.sqrt(variance)[:, None]
        for variance in (
            noise.place * relative[0],
            noise.attitude * relative[1] * part,
            noise.attitude * relative[1] * (1 - part),
        )
    )
    noisy = []
    for axis in np.concatenate((np.eye(3), -np.eye(3))):
        about1, about2 = (np.asarray(rotation_exp(size * axis)) for size in (turn1, turn2))
        noisy += [(about2 @ Q, p, reading), (Q, p + place * axis, reading)]
        noisy += [(about1 @ Q, np.einsum("nij,nj->ni", about1, p), reading)]
    if reading is not None and line is not None:
        noisy += [(Q, p, reading + sign * np.sqrt(noise.encoder) / line.slope) for sign in (1, -1)]
    around = RelativePoses(
        np.ascontiguousarray(np.concatenate([each[0].reshape(-1, 9) for each in noisy]).T),
        np.ascontiguousarray(np.concatenate([each[1] for each in noisy]).T),
        poses.size,
        relative_noise=None if thin.relative_noise is None else np.tile(relative, len(noisy)),
        encoder=None if reading is None else np.concatenate([each[2] for each in noisy if each[2] is not None]),
    )
    normal, gradient = _normal_equations(around, hinge, noise, None, line)
    return -solve_semidefinite(normal / len(noisy), gradient / 2)


def evaluate_hinge(
    poses: RelativePoses, hinge: Hinge, noise: Noise, loss: Loss | None, encoder_line: EncoderLine | None = None
) -> HingeResiduals:
    """Return the HingeResiduals of a Hinge for relative poses: the residuals and weights of every sample, and the
    covariance of the hinge's parameters. `noise` is the Noise of the poses; `loss` is a function that returns the
    derivatives of the loss of a sample, or None for least squares; `encoder_line` is the EncoderLine or None.

    The covariance is the sandwich A^-1 B A^-1 (Huber, Robust Statistics, 1981, 6.3): A the derivative of the sum of
    scores, B the scatter of the scores themselves, so it holds where the noise is not as the weights suppose. Scores
    of neighbours that are correlated in time are added up before they are squared. Of very many samples, A and B are
    those of some stretches.
    """
    count = poses.samples
    tilt, gap, psi = np.empty(count), np.empty((3, count)), np.empty(count)
    sizes, weights, turn = np.empty(count), np.empty(count), np.zeros(count)
    slope: Float64Array = np.zeros(())
    score_blocks, whitened_blocks = [], []
    every = max(1, count // _APPROXIMATE_NUM_SAMPLES_FOR_COVARIANCE)
    for k, (block, seen) in enumerate(iterate_residuals(poses, hinge, encoder_line)):
        q, (x, y, z) = seen.q, seen.arms
        tilt[block] = np.arctan2(np.hypot(q[2], q[5]), q[8])
        gap[:2, block] = seen.gap[:2] - 0.5 * z * seen.tilt
        gap[2, block] = seen.gap[2] + 0.5 * (seen.tilt[0] * x + seen.tilt[1] * y)
        psi[block] = seen.psi
        if seen.turn is not None:
            turn[block] = seen.turn
        if (k // 16) % every:  # outside of the stretches of 16 blocks that give the covariance
            sizes[block] = seen.whitened_squares(noise)
            weights[block] = 1.0 if loss is None else _loss_derivatives(loss, sizes[block])[0]
            continue
        rows = seen.whitened_rows(noise)
        sizes[block] = (rows[-1] ** 2).sum(axis=0)
        first, second = (1.0, 0.0) if loss is None else _loss_derivatives(loss, sizes[block])
        weights[block] = first
        score = np.einsum("kri,ri->ki", rows[:-1], rows[-1])
        slope = (
            slope
            + _weighted_gram_matrix(rows, weights[block])[:-1, :-1]
            + 2 / _LOSS_SCALE_OF_WHITENED_SQUARED_RESIDUAL * (score * second) @ score.T
        )
        score_blocks.append(weights[block] * score)
        whitened_blocks.append(weights[block] * rows[-1])
    all_scores = np.concatenate(score_blocks, axis=1)
    whitened_residuals = np.concatenate(whitened_blocks, axis=1)
    neighbour_correlations = _lag_correlation(whitened_residuals[:2], 1), _lag_correlation(whitened_residuals[2:5], 1)
    scatter, unresolved_lag = score_scatter(all_scores)
    share = all_scores.shape[1] / count
    # a sample tells less of itself than of others, by its part of the parameters
    free = 5 * all_scores.shape[1] / max(5 * all_scores.shape[1] - slope.shape[0], 1)
    inverse = solve_semidefinite(slope, np.eye(slope.shape[0]))
    covariance = share * free * inverse @ scatter @ inverse.T
    return HingeResiduals(tilt, gap, psi, sizes, weights, neighbour_correlations, covariance, unresolved_lag, turn)


def _lag_correlation(rows: Float64Array, lag: int) -> float:
    """Return the correlation between the entries of a row and the entries `lag` places later, the largest over all
    rows. Return 0 if all rows are zero or too short.
    """
    power = (rows * rows).sum(axis=1)
    known = power > 0
    if not known.any() or rows.shape[1] <= lag:
        return 0.0
    products = (rows[:, lag:] * rows[:, :-lag]).sum(axis=1)
    return float((products[known] / power[known]).max())


def score_scatter(scores: Float64Array) -> tuple[Float64Array, int]:
    """Return the covariance (k, k) of the sum of scores (k, N), and the lag over which scores are correlated too long
    for the recording, or 0. Scores of neighbours that are correlated are added up before they are squared. What sums
    of L samples still lack, if the correlation of scores falls like that of a first-order autoregression, is added.

    The sum of L samples has the variance L (1 + r) / (1 - r) - 2 r (1 - r^L) / (1 - r)^2 and lacks the second term.

    >>> score_scatter(np.array([[1.0, -1.0, -1.0, 1.0]]))[0]
    array([[4.]])
    """
    together, unresolved_lag = num_neighbours_to_sum_and_unresolved_lag(scores)
    added = np.add.reduceat(scores, np.arange(0, scores.shape[1], together), axis=1)
    scatter = np.asarray(added @ added.T)
    if together > 1 or unresolved_lag:
        r = min(_lag_correlation(scores, 1), 0.98)
        whole = together * (1 + r) / (1 - r)
        scatter = scatter * whole / (whole - 2 * r * (1 - r**together) / (1 - r) ** 2)
    return scatter, unresolved_lag


def num_neighbours_to_sum_and_unresolved_lag(scores: Float64Array) -> tuple[int, int]:
    """Return (count, lag), two ints. `count` neighbouring scores (columns of `scores`) must be added up for the sums
    to be uncorrelated. `lag` is 0; if the recording is too short for long enough sums, it is the lag at which scores
    are still correlated.

    Sums go over four times the lag at which scores are hardly correlated, but there are at least
    _MIN_NUM_SCORE_SUMS_FOR_COVARIANCE of them.
    """
    count, lag = scores.shape[1], 1
    uncorrelated = max(0.1, 3 / np.sqrt(count))
    while 4 * lag * _MIN_NUM_SCORE_SUMS_FOR_COVARIANCE <= count and _lag_correlation(scores, lag) > uncorrelated:
        lag *= 2
    together = 1 if lag == 1 else min(4 * lag, count // _MIN_NUM_SCORE_SUMS_FOR_COVARIANCE)
    unresolved = 4 * lag * _MIN_NUM_SCORE_SUMS_FOR_COVARIANCE > count and _lag_correlation(scores, lag) > uncorrelated
    return together, lag if unresolved else 0


def iterate_residuals(
    poses: RelativePoses, hinge: Hinge, encoder_line: EncoderLine | None = None
) -> Iterator[tuple[slice, SampleResiduals]]:
    """Yield the residuals of the hinge constraints for relative poses block by block, as pairs of the slice of the
    samples and their SampleResiduals. If `encoder_line`, an EncoderLine, is given, the residuals of the encoder are
    included.
    """
    first, second = frame(hinge.n), frame(hinge.m)
    turned = np.kron(first.T, second.T)
    lever1, lever2 = (first.T @ hinge.u1)[:, None], (second.T @ hinge.u2)[:, None]
    for start in range(0, poses.samples, _NUM_SAMPLES_PER_RESIDUAL_BLOCK):
        block = slice(start, min(start + _NUM_SAMPLES_PER_RESIDUAL_BLOCK, poses.samples))
        q, p = turned @ poses.Q[:, block], first.T @ poses.p[:, block]
        arm = (q.reshape(3, 3, -1) * lever2).sum(axis=1)
        relative_noise = None if poses.relative_noise is None else poses.relative_noise[:, block]
        arms = (
            lever1 + arm
            if relative_noise is None
            else 2 * (relative_noise[2] * lever1 + (1 - relative_noise[2]) * arm)
        )
        stretch = 1 / np.sqrt(np.maximum((1 + q[8]) / 2, 1e-12))
        tilt = q[2:6:3] * stretch
        if q[8].min() < _MAX_COSINE_OF_OPPOSITE_HINGE_AXES:
            tilt[0] = np.where(q[8] < _MAX_COSINE_OF_OPPOSITE_HINGE_AXES, 2.0, tilt[0])
        gap = lever1 - p - arm
        gap[:2] += 0.5 * arms[2] * tilt
        gap[2] -= 0.5 * (tilt[0] * arms[0] + tilt[1] * arms[1])
        seen = SampleResiduals(q, p, arms, tilt, gap, relative_noise=relative_noise)
        if poses.offset_derivatives is not None:
            dq, dp = turned @ poses.offset_derivatives[:9, block], first.T @ poses.offset_derivatives[9:, block]
            offset_derivatives = np.empty((6, q.shape[1]))
            offset_derivatives[:2] = dq[2:6:3] * stretch
            offset_derivatives[2:5] = -dp - (dq.reshape(3, 3, -1) * lever2).sum(axis=1)
            offset_derivatives[2:4] += 0.5 * arms[2] * offset_derivatives[:2]
            offset_derivatives[4] -= 0.5 * (offset_derivatives[0] * arms[0] + offset_derivatives[1] * arms[1])
            c, s = q[0] + q[4], q[3] - q[1]
            offset_derivatives[5] = (c * (dq[3] - dq[1]) - s * (dq[0] + dq[4])) / np.maximum(c * c + s * s, 1e-12)
            seen = seen._replace(offset_derivatives=offset_derivatives)
        if poses.encoder is not None and encoder_line is not None:
            reading = poses.encoder[block]
            seen = seen._replace(
                reading=reading, turn=_encoder_residual(seen.psi, reading, encoder_line), slope=encoder_line.slope
            )
        yield block, seen


def _normal_equations(
    poses: RelativePoses, hinge: Hinge, noise: Noise, loss: Loss | None, encoder_line: EncoderLine | None = None
) -> tuple[Float64Array, Float64Array]:
    """Return the matrix J^T W J (k, k) and the vector J^T W r (k,) of one Gauss-Newton step for the k parameters. J
    are the whitened derivatives, r the whitened residuals, and W the weights of the samples, which `loss` reduces for
    outliers (None means least squares). `encoder_line` is the EncoderLine or None.
    """
    total: Float64Array = np.zeros(())
    for _, seen in iterate_residuals(poses, hinge, encoder_line):
        rows = seen.whitened_rows(noise)
        if loss is not None:
            rows *= np.sqrt(_loss_derivatives(loss, (rows[-1] ** 2).sum(axis=0))[0])
        rows = rows.reshape(rows.shape[0], -1)
        total = total + rows @ rows.T
    return total[:-1, :-1], total[:-1, -1]


def _loss_derivatives(loss: Loss, squared_residuals: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the first and the second derivative of a loss, a pair of arrays, with respect to `squared_residuals`,
    the whitened squared residuals of samples. Both are 0 for gross outliers.
    """
    first, second = loss(squared_residuals / _LOSS_SCALE_OF_WHITENED_SQUARED_RESIDUAL)
    gross = squared_residuals > _MIN_WHITENED_SQUARED_RESIDUAL_OF_ZERO_WEIGHT
    return np.where(gross, 0.0, first), np.where(gross, 0.0, second)


def _weighted_gram_matrix(rows: Float64Array, weights: Float64Array) -> Float64Array:
    """Return the matrix (k, k) of weighted scalar products between k rows."""
    rows = (rows * np.sqrt(weights)).reshape(rows.shape[0], -1)
    return np.asarray(rows @ rows.T)


def _estimate_noise(
    poses: RelativePoses,
    hinge: Hinge,
    previous_noise: Noise | None,
    loss: Loss | None,
    encoder_line: EncoderLine | None = None,
) -> Noise:
    """Return the Noise estimated from the residuals of relative poses for a Hinge, by maximum likelihood if `loss` is
    None, otherwise by medians. The medians leave out samples whose residuals are far larger than `previous_noise`,
    unless `previous_noise` is None. No variance is smaller than the variance of rounding errors. With `encoder_line`,
    an EncoderLine, the noise of the encoder is estimated too.

    The variance of positions is what the gaps show beyond the effect of the attitudes.
    """
    parts = []
    for block, seen in iterate_residuals(poses, hinge, encoder_line):
        sizes = (
            np.zeros(seen.q.shape[1])
            if loss is None or previous_noise is None
            else seen.whitened_squares(previous_noise)
        )
        place, attitude, _ = seen.variances(Noise(1.0, 1.0))
        tilt, gap = (seen.tilt**2).sum(axis=0) / attitude, (seen.gap**2).sum(axis=0) / place
        turn = np.full_like(tilt, np.nan) if poses.encoder is None or seen.turn is None else seen.turn**2
        turn[~np.isfinite(np.nan if poses.encoder is None else poses.encoder[block])] = np.nan
        parts.append((tilt, gap, seen.gap_variance_by_attitude / place, turn, sizes))
    tilt, gap, spread, turn, sizes = (np.concatenate(blocks) for blocks in zip(*parts, strict=True))
    near = np.ones(tilt.size, dtype=bool)
    if loss is None:
        attitude, across = tilt.mean() / 2, gap.mean() / 3
    else:
        if 2 * (sizes < _MAX_WHITENED_SQUARED_RESIDUAL_FOR_NOISE_ESTIMATE).sum() > near.size:
            near = sizes < _MAX_WHITENED_SQUARED_RESIDUAL_FOR_NOISE_ESTIMATE
        attitude, across = (
            np.median(tilt[near]) / CHI2_MEDIAN_BY_DOF[2],
            np.median(gap[near]) / CHI2_MEDIAN_BY_DOF[3],
        )
    attitude = max(float(attitude), (4 * FLOAT64_UNIT_ROUNDOFF) ** 2)
    lever = float(spread[near].mean()) / 3
    rounding = max((4 * FLOAT64_UNIT_ROUNDOFF * poses.size) ** 2, 1e-300)
    place = max(float(across) - attitude * lever, 1e-3 * float(across), rounding)
    noise = Noise(place, attitude)
    if loss is None:
        least = Noise(
            max(_MIN_POSITION_OR_ENCODER_NOISE_VARIANCE_TO_SQUARED_RESIDUAL * float(across), rounding),
            (4 * FLOAT64_UNIT_ROUNDOFF) ** 2,
        )
        noise, _ = variance_components(poses.thinned(_MAX_THINNED_SAMPLES_FOR_NOISE_VARIANCES), hinge, noise, least)
    read = np.isfinite(turn) & near
    if encoder_line is None or not read.any():
        return noise
    total = float(turn[read].mean() if loss is None else np.median(turn[read]) / CHI2_MEDIAN_BY_DOF[1])
    return noise._replace(
        encoder=max(
            total - noise.attitude,
            _MIN_POSITION_OR_ENCODER_NOISE_VARIANCE_TO_SQUARED_RESIDUAL * total,
            (4 * FLOAT64_UNIT_ROUNDOFF) ** 2,
        )
    )


def variance_components(
    poses: RelativePoses, hinge: Hinge, start: Noise, minimum: Noise, max_steps: int = 25
) -> tuple[Noise, Float64Array]:
    """Return the most likely variances of relative positions and attitudes as a Noise, and the covariance (2, 2) of
    both variances. They are computed by at most `max_steps` steps of Fisher scoring from the Noise `start`, with the
    Noise `minimum` as lower limits, from the residuals that the hinge leaves.

    In the eigenvectors of what noise of attitudes adds to the covariance of a gap, residuals are independent, and
    their squares have means that are linear in both variances (Searle, Casella and McCulloch, Variance Components,
    1992, 8.3).
    """
    squares, places, attitudes = [], [], []
    for _, seen in iterate_residuals(poses, hinge):
        place, attitude, share = (np.broadcast_to(x, seen.p.shape[1]) for x in seen.variances(Noise(1.0, 1.0)))
        w = np.stack((-seen.arms[1], seen.arms[0], np.zeros_like(place)), axis=-1)
        p, b = seen.p.T, (share * (1 - share))[:, None, None]
        matrix = b * ((p * p).sum(axis=1)[:, None, None] * np.eye(3) - p[:, :, None] * p[:, None])
        values, axes = np.linalg.eigh(matrix + w[:, :, None] * w[:, None] / 4)
        gap = np.einsum("nij,in->jn", axes, seen.gap)
        squares += [*gap**2, *seen.tilt**2]
        places += [*np.broadcast_to(place, gap.shape), *np.zeros((2, place.size))]
        attitudes += [*(attitude * np.maximum(values.T, 0.0)), *np.broadcast_to(attitude, (2, attitude.size))]
    square, design = np.concatenate(squares), np.stack((np.concatenate(places), np.concatenate(attitudes)))
    square = square * (square.size / max(square.size - NUM_HINGE_PARAMETERS, 1))
    lower_limits = np.array(minimum[:2])
    variances = np.maximum(np.array(start[:2]), lower_limits)
    for _ in range(max_steps):
        scaled = design * variances[:, None] / (variances @ design)
        right = scaled @ (square / (variances @ design))
        change = np.linalg.lstsq(scaled @ scaled.T, right)[0]
        before, variances = variances, np.maximum(variances * np.clip(change, 0.1, 10.0), lower_limits)
        if (
            np.abs(variances - before).max(initial=0.0) <= 1e-4 * before.max()
            and (np.abs(variances / before - 1) < 1e-3).all()
        ):
            break
    scaled = design * variances[:, None] / (variances @ design)
    covariance = 2 * np.linalg.pinv(scaled @ scaled.T) * np.outer(variances, variances)
    return Noise(*variances.tolist()), covariance


def solve_semidefinite(matrix: Float64Array, right_hand_side: Float64Array) -> Float64Array:
    """Return the solution of a linear system with a symmetric positive semidefinite matrix and one or more columns on
    the right-hand side. Components of the solution that a singular matrix does not determine are 0.
    """
    scale = 1 / np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    solution = np.linalg.lstsq(matrix * scale * scale[:, None], (right_hand_side.T * scale).T, rcond=1e-13)[0]
    return np.asarray((solution.T * scale).T)
