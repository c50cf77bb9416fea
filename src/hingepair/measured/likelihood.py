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

An unknown offset between the clocks of the bodies is one more parameter.

Samples are walked through in blocks; nothing of the size of a Jacobian of all samples is kept.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from hingepair.measured.hinge import Hinge, frame
from hingepair.measured.least_squares import (
    Equations,
    least_squares,
    neighbour_correlation,
    sandwich,
    solve_semidefinite,
)
from hingepair.measured.relative_poses import RelativePoses
from hingepair.measured.robust import Loss, loss_weights, median_variance
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.bounded import UNIT_ROUNDOFF
from hingepair.rotations.matrices import rotation_exp

PARAMETERS = 9  # numbers of a step of `Hinge.moved`; the clock offset follows where sought
FIRST_PASS = 16384  # samples that the first steps are taken with, at most
MIN_OFFSET_GAIN = 10.0  # information on the clock offset over that of noise alone; below, motion does not show it
MAX_OFFSET_STD = 0.1  # [s]: nor if it is known less well
SHIFT_SAMPLES = 100  # samples that tell by how much the zero of psi shifts
_BLOCK = 2048  # samples, that fit the caches
_NOISE_SAMPLES = 4096  # samples that the variance components are estimated from
_BIAS_SAMPLES = 300  # at which the bias is computed, at most
_ROUNDING = 4 * UNIT_ROUNDOFF  # of attitudes, and of places in parts of their size
_LEAST_NOISE = 1e-3  # least variance of positions, in parts of the mean squared residual
_OPPOSITE = -0.999999  # cosine of axes below which they point against each other


class Noise(NamedTuple):
    """Variances of the noise; means, where the user gave standard deviations of single samples."""

    place: float  # of a component of R2 - R1 [m^2]
    attitude: float  # of a component of the relative attitude [rad^2]


class SampleResiduals(NamedTuple):
    """What the constraints leave of a block of M samples, in axes of which the third is the hinge axis, and what the
    covariance of that is computed from.
    """

    q: Float64Array  # relative attitude, row by row; shape (9, M)
    p: Float64Array  # relative place [m]; shape (3, M)
    arms: Float64Array  # S1 u1 + S2 u2 [m]; shape (3, M)
    tilt: Float64Array  # of Q m - n the direction, its length the chord; shape (2, M)
    gap: Float64Array  # of E1, half of the tilt's share taken out [m]; shape (3, M)
    offset_derivatives: Float64Array | None = None  # of tilt, gap and psi, by the clock offset; shape (6, M)
    relative_noise: Float64Array | None = None  # of each sample, as `Samples.relative_noise`; shape (3, M)

    @property
    def psi(self) -> Float64Array:
        """Hinge angles (M,) in [-pi, pi] [rad], from the first axis of `frame(n)`, fixed in body 1, to that of
        `frame(m)`, fixed in body 2.
        """
        return np.asarray(np.arctan2(self.q[3] - self.q[1], self.q[0] + self.q[4]))

    def variances(self, noise: Noise) -> tuple[Any, Any, Any]:
        """Return the variances of relative position [m^2] and attitude [rad^2], and body 1's part of the latter:
        numbers, or arrays (M,) where samples differ.
        """
        if self.relative_noise is None:
            return noise.place, noise.attitude, 0.5
        return noise.place * self.relative_noise[0], noise.attitude * self.relative_noise[1], self.relative_noise[2]

    @property
    def gap_variance_by_attitude(self) -> Float64Array:
        """Mean squared gap [m^2] that attitude noise of variance 1 rad^2 causes; (M,)."""
        x, y, _ = self.arms
        _, scale, share = self.variances(Noise(1.0, 1.0))
        return np.asarray(scale * (2 * share * (1 - share) * (self.p**2).sum(axis=0) + (x * x + y * y) / 4))

    def whiten(self, noise: Noise, tilts: Float64Array, gaps: Float64Array) -> Float64Array:
        """Return residuals, or their derivatives, times the inverse of the Cholesky factor of their covariance;
        (k, 5, M), of `tilts` (k, 2, M) and `gaps` (k, 3, M).
        """
        a, attitude, share = self.variances(noise)
        b, c = attitude * share * (1 - share), attitude / 4
        (p, q, r), (x, y, _) = self.p, self.arms
        rows = np.empty((tilts.shape[0], 5, tilts.shape[2]))
        # Cholesky factor with w = (-y, x, 0); no eigenvalue of the covariance is below a.
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
        """Return r^T C^-1 r (M,): 5 on average if the noise is right."""
        return np.asarray((self.whiten(noise, self.tilt[None], self.gap[None])[0] ** 2).sum(axis=0))

    def whitened_rows(self, noise: Noise) -> Float64Array:
        """Return the whitened derivatives of the residuals by each parameter, and the whitened residuals as the last
        row; (parameters + 1, 5, M). The parameters are the nine of the hinge, then the clock offset if it is
        estimated.
        """
        q, (x, y, z), count = self.q, self.arms, self.q.shape[1]
        parameters = PARAMETERS + (self.offset_derivatives is not None)
        tilts, gaps = np.zeros((parameters + 1, 2, count)), np.zeros((parameters + 1, 3, count))
        tilts[0, 0] = tilts[1, 1] = -1.0
        tilts[2], tilts[3], tilts[-1] = q[0:6:3], q[1:6:3], self.tilt
        for k in range(4):
            gaps[k, :2] = 0.5 * z * tilts[k]
            gaps[k, 2] = -0.5 * (tilts[k, 0] * x + tilts[k, 1] * y)
        for k in range(3):
            gaps[4 + k, k] = 1.0
        gaps[7], gaps[8], gaps[-1] = -q[0::3], -q[1::3], self.gap
        if self.offset_derivatives is not None:
            tilts[PARAMETERS], gaps[PARAMETERS] = (
                self.offset_derivatives[:2],
                self.offset_derivatives[2:5],
            )
        return self.whiten(noise, tilts, gaps)


class Estimate(NamedTuple):
    """The most likely hinge."""

    hinge: Hinge
    noise: Noise
    has_converged: bool  # whether the steps came to rest
    offset: float = 0.0  # by how much later body 2 was recorded than body 1 at equal stamps [s]


PosesAt = Callable[[float, int], RelativePoses]
"""Function of the clock offset [s] and of how many samples are needed at most, that returns relative poses."""


class HingeResiduals(NamedTuple):
    """What a hinge leaves of all samples, and the covariance of its parameters."""

    tilt: Float64Array  # angle between the axes [rad]; shape (N,)
    gap: Float64Array  # of E1, in axes along the hinge [m]; shape (3, N)
    psi: Float64Array  # angle about the hinge from one `frame` to the other, in [-pi, pi] [rad]; shape (N,)
    whitened_squares: Float64Array  # r^T C^-1 r; shape (N,)
    weights: Float64Array  # of the loss alone; shape (N,)
    neighbour_correlations: tuple[float, ...]  # correlations of neighbours, of tilts and of gaps
    covariance: Float64Array  # of the parameters
    unresolved_lag: int  # samples over which scores are still correlated at the longest sums; 0 where they are not


class _State(NamedTuple):
    """The unknowns of `most_likely_hinge`, its noise, and the poses at the clock offset."""

    hinge: Hinge
    offset: float
    poses: RelativePoses
    noise: Noise


def most_likely_hinge(
    poses: RelativePoses, start: Hinge, loss: Loss | None, poses_at: PosesAt | None = None, offset: float = 0.0
) -> Estimate:
    """Return the most likely hinge by Gauss-Newton steps from `start`, with the noise. With
    `poses_at`, the clock offset is estimated too, from the first value `offset` [s].
    """
    find = poses_at or (lambda _, most: poses.thinned(most))

    def equations(state: _State) -> Equations:
        return _normal_equations(state.poses, state.hinge, state.noise, loss)

    def rotation_of(step: Float64Array, some: RelativePoses) -> float:
        turned = float(np.abs(step[:4]).max())
        # 5 rad/s: a step of the clock offset counts as so much rotation.
        return turned if some.offset_derivatives is None else max(turned, 5.0 * abs(float(step[PARAMETERS])))

    def move(state: _State, step: Float64Array) -> tuple[_State, Float64Array]:
        # Shorten it to the largest rotation, 0.3 rad.
        step = step * min(1.0, 0.3 / max(rotation_of(step, state.poses), 1e-300))
        hinge = state.hinge.moved(step[:PARAMETERS]).balanced()
        some, later = state.poses, state.offset
        if some.offset_derivatives is not None:
            later += float(step[PARAMETERS])
            some = find(later, most)
        noise = _estimate_noise(some.thinned(FIRST_PASS), hinge, state.noise, loss)
        return _State(hinge, later, some, noise), step

    def at_rest(step: Float64Array, before: Equations, state: _State) -> bool:
        # In standard deviations. Without a loss the next step is about this one times the noise.
        size = float(np.sqrt(step @ before.normal @ step))
        next_size = size * (rotation_of(step, state.poses) + np.sqrt(state.noise.attitude))
        if size < 0.02 or (loss is None and next_size < 0.1):
            return True
        # Rounding of rotations [rad], shifts [m] and the clock offset [s].
        rounding = 2.0**-50 * np.repeat((1.0, poses.size), (4, 5))
        delay = 0.0 if state.poses.offset_derivatives is None else abs(float(step[PARAMETERS]))
        return bool((np.abs(step[:PARAMETERS]) < rounding).all()) and delay < 1e-12

    # With some samples first, then with all: how many match depends on the offset.
    most, come_to_rest = FIRST_PASS, False
    some = find(offset, most)
    state = _State(start, offset, some, _estimate_noise(some, start, None, loss))
    for most in (FIRST_PASS, sys.maxsize) if poses.samples > FIRST_PASS else (sys.maxsize,):
        state = state._replace(poses=find(state.offset, most))
        state, come_to_rest = least_squares(state, equations, move, at_rest, 40)
    return Estimate(state.hinge, state.noise, come_to_rest, state.offset)


def frame_turn_angle(poses: RelativePoses, before: Hinge, after: Hinge) -> float:
    """Return the median growth of psi [rad] at equal poses from one hinge to another, since psi is counted between
    the first axes of `frame(n)` and `frame(m)`.
    """
    first, second = (
        np.concatenate([seen.psi for _, seen in iterate_residuals(poses, hinge)]) for hinge in (before, after)
    )
    turned = np.exp(1j * (second - first))
    return float(np.angle(np.median(turned.real) + 1j * np.median(turned.imag)))


def noise_standard_deviations(poses: RelativePoses, hinge: Hinge, noise: Noise, loss: Loss | None) -> dict[str, Any]:
    """Return how well the noise is known: the standard deviations of "noise_position" [m] and "noise_angle" [rad].
    With a loss, medians estimated it, which is less accurate.
    """
    thin = poses.thinned(_NOISE_SAMPLES)
    _, covariance = variance_components(thin, hinge, noise, noise, max_steps=0)
    variances = (
        np.diagonal(covariance) * thin.samples / poses.samples / (1.0 if loss is None else 0.37)  # efficiency
    )
    std = np.sqrt(variances) / (2 * np.sqrt(np.array(noise[:2])))
    return dict(zip(("noise_position", "noise_angle"), std, strict=True))


def shows_offset(poses: RelativePoses, noise_poses: RelativePoses, estimate: Estimate, loss: Loss | None) -> bool:
    """Return whether the motion determines the clock offset beside all other parameters: far better than derivatives
    that are noise alone, those of `noise_poses`, would.
    """
    normals = [_normal_equations(each, estimate.hinge, estimate.noise, loss).normal for each in (poses, noise_poses)]
    k = PARAMETERS
    others = np.delete(np.arange(normals[0].shape[0]), k)
    across = solve_semidefinite(normals[0][np.ix_(others, others)], normals[0][others, k])
    shown = normals[0][k, k] - normals[0][k, others] @ across
    return bool(shown > MIN_OFFSET_GAIN * normals[1][k, k] and shown * MAX_OFFSET_STD**2 > 1)


def bias_of_hinge(poses: RelativePoses, hinge: Hinge, noise: Noise, share: float | None = None) -> Float64Array:
    """Return the bias (estimate less truth) of the most likely hinge, as a step (9,). It goes as the variance of the
    noise and does not decrease with the number of samples: a rotation that is off at random is on average a shorter
    matrix, so levers come out short.

    Args:
        poses: the samples.
        hinge: the most likely hinge.
        noise: variances.
        share: body 1's part of the variance of the attitudes; None: that by which residuals are whitened.
    """
    reach = max(float(np.sqrt((poses.p * poses.p).sum() / poses.samples)), 1e-300)
    size = np.sqrt(noise.attitude) + np.sqrt(noise.place) / reach
    if np.sqrt(poses.samples) * size < 0.1:  # in standard deviations
        return np.zeros(PARAMETERS)
    # The mean of the scores, at the exact poses of the hinge, each coordinate of noise once up and once down.
    thin = poses.thinned(_BIAS_SAMPLES)
    relative = np.repeat(((1.0,), (1.0,), (0.5,)), thin.samples, axis=1)
    relative = relative if thin.relative_noise is None else thin.relative_noise
    part = relative[2] if share is None else share
    first, second = frame(hinge.n), frame(hinge.m)
    q = np.kron(first.T, second.T) @ thin.Q
    psi = np.arctan2(q[3] - q[1], q[0] + q[4])
    c, s, zero = np.cos(psi), np.sin(psi), np.zeros_like(psi)
    Q = first @ np.stack((c, -s, zero, s, c, zero, zero, zero, zero + 1), axis=-1).reshape(-1, 3, 3) @ second.T
    p = hinge.u1 - Q @ hinge.u2
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
        noisy += [(about2 @ Q, p), (Q, p + place * axis)]
        noisy += [(about1 @ Q, np.einsum("nij,nj->ni", about1, p))]
    around = RelativePoses(
        np.ascontiguousarray(np.concatenate([each[0].reshape(-1, 9) for each in noisy]).T),
        np.ascontiguousarray(np.concatenate([each[1] for each in noisy]).T),
        poses.size,
        relative_noise=None if thin.relative_noise is None else np.tile(relative, len(noisy)),
    )
    normal, gradient, _ = _normal_equations(around, hinge, noise, None)
    return -solve_semidefinite(normal / len(noisy), gradient / 2)


def evaluate_hinge(poses: RelativePoses, hinge: Hinge, noise: Noise, loss: Loss | None) -> HingeResiduals:
    """Return what a hinge leaves of every sample, and the covariance of its parameters (`sandwich`), of very many
    samples from stretches of them.
    """
    count = poses.samples
    tilt, gap, psi = np.empty(count), np.empty((3, count)), np.empty(count)
    sizes, weights = np.empty(count), np.empty(count)
    slope: Float64Array = np.zeros(())
    score_blocks, whitened_blocks = [], []
    every = max(1, count // 131072)  # about so many samples give the covariance
    for k, (block, seen) in enumerate(iterate_residuals(poses, hinge)):
        q, (x, y, z) = seen.q, seen.arms
        tilt[block] = np.arctan2(np.hypot(q[2], q[5]), q[8])
        gap[:2, block] = seen.gap[:2] - 0.5 * z * seen.tilt
        gap[2, block] = seen.gap[2] + 0.5 * (seen.tilt[0] * x + seen.tilt[1] * y)
        psi[block] = seen.psi
        if (k // 16) % every:  # outside of the stretches of 16 blocks that give the covariance
            sizes[block] = seen.whitened_squares(noise)
            weights[block], _ = loss_weights(loss, sizes[block], 5)
            continue
        rows = seen.whitened_rows(noise)
        sizes[block] = (rows[-1] ** 2).sum(axis=0)
        weights[block], bend = loss_weights(loss, sizes[block], 5)
        score = np.einsum("kri,ri->ki", rows[:-1], rows[-1])
        slope = slope + _weighted_gram_matrix(rows, weights[block])[:-1, :-1] + 2 * (score * bend) @ score.T
        score_blocks.append(weights[block] * score)
        whitened_blocks.append(weights[block] * rows[-1])
    all_scores = np.concatenate(score_blocks, axis=1)
    whitened_residuals = np.concatenate(whitened_blocks, axis=1)
    neighbour_correlations = tuple(neighbour_correlation(part) for part in np.split(whitened_residuals, [2]))
    share = all_scores.shape[1] / count
    covariance, unresolved_lag = sandwich(solve_semidefinite(slope, np.eye(slope.shape[0])), all_scores, 5)
    return HingeResiduals(tilt, gap, psi, sizes, weights, neighbour_correlations, share * covariance, unresolved_lag)


def iterate_residuals(poses: RelativePoses, hinge: Hinge) -> Iterator[tuple[slice, SampleResiduals]]:
    """Yield the slice of each block of samples and what the hinge leaves of them."""
    first, second = frame(hinge.n), frame(hinge.m)
    turned = np.kron(first.T, second.T)
    lever1, lever2 = (first.T @ hinge.u1)[:, None], (second.T @ hinge.u2)[:, None]
    for start in range(0, poses.samples, _BLOCK):
        block = slice(start, min(start + _BLOCK, poses.samples))
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
        if q[8].min() < _OPPOSITE:
            tilt[0] = np.where(q[8] < _OPPOSITE, 2.0, tilt[0])
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
        yield block, seen


def _normal_equations(poses: RelativePoses, hinge: Hinge, noise: Noise, loss: Loss | None) -> Equations:
    """Return the normal equations of whitened residuals, by the parameters of `SampleResiduals.whitened_rows`."""
    total: Float64Array = np.zeros(())
    for _, seen in iterate_residuals(poses, hinge):
        rows = seen.whitened_rows(noise)
        weights = 1.0 if loss is None else loss_weights(loss, (rows[-1] ** 2).sum(axis=0), 5)[0]
        total = total + _weighted_gram_matrix(rows, weights)
    return Equations(total[:-1, :-1], total[:-1, -1])


def _weighted_gram_matrix(rows: Float64Array, weights: Float64Array | float) -> Float64Array:
    """Return the products of rows (k, components, M) with each other (k, k), summed with weights (M,)."""
    rows = (rows * np.sqrt(weights)).reshape(rows.shape[0], -1)
    return np.asarray(rows @ rows.T)


def _estimate_noise(poses: RelativePoses, hinge: Hinge, previous_noise: Noise | None, loss: Loss | None) -> Noise:
    """Return the noise that the residuals show: the most likely, or with a loss by medians, which leave out samples
    far beyond the previous noise. No variance is below that of rounding.
    """
    parts = []
    for _, seen in iterate_residuals(poses, hinge):
        sizes = (
            np.zeros(seen.q.shape[1])
            if loss is None or previous_noise is None
            else seen.whitened_squares(previous_noise)
        )
        place, attitude, _ = seen.variances(Noise(1.0, 1.0))
        tilt, gap = (seen.tilt**2).sum(axis=0) / attitude, (seen.gap**2).sum(axis=0) / place
        parts.append((tilt, gap, seen.gap_variance_by_attitude / place, sizes))
    tilt, gap, spread, sizes = (np.concatenate(blocks) for blocks in zip(*parts, strict=True))
    near = np.ones(tilt.size, dtype=bool)
    if loss is None:
        attitude, across = tilt.mean() / 2, gap.mean() / 3
    else:
        if 2 * (sizes < 100.0).sum() > near.size:
            near = sizes < 100.0
        attitude, across = median_variance(tilt[near], 2), median_variance(gap[near], 3)
    attitude = max(float(attitude), _ROUNDING**2)
    # The variance of positions is what the gaps show beyond the effect of the attitudes.
    lever = float(spread[near].mean()) / 3
    rounding = max((_ROUNDING * poses.size) ** 2, 1e-300)
    place = max(float(across) - attitude * lever, 1e-3 * float(across), rounding)
    noise = Noise(place, attitude)
    if loss is None:
        least = Noise(max(_LEAST_NOISE * float(across), rounding), _ROUNDING**2)
        noise, _ = variance_components(poses.thinned(_NOISE_SAMPLES), hinge, noise, least)
    return noise


def variance_components(
    poses: RelativePoses, hinge: Hinge, start: Noise, minimum: Noise, max_steps: int = 25
) -> tuple[Noise, Float64Array]:
    """Return the most likely variances of positions and attitudes, at least `minimum`, and their covariance (2, 2),
    by Fisher scoring from `start` (Searle, Casella and McCulloch, Variance Components, 1992, 8.3).
    """
    squares, places, attitudes = [], [], []
    for _, seen in iterate_residuals(poses, hinge):
        place, attitude, share = (np.broadcast_to(x, seen.p.shape[1]) for x in seen.variances(Noise(1.0, 1.0)))
        w = np.stack((-seen.arms[1], seen.arms[0], np.zeros_like(place)), axis=-1)
        p, b = seen.p.T, (share * (1 - share))[:, None, None]
        matrix = b * ((p * p).sum(axis=1)[:, None, None] * np.eye(3) - p[:, :, None] * p[:, None])
        # In these eigenvectors residuals are independent, with means of squares that are linear in both variances.
        values, axes = np.linalg.eigh(matrix + w[:, :, None] * w[:, None] / 4)
        gap = np.einsum("nij,in->jn", axes, seen.gap)
        squares += [*gap**2, *seen.tilt**2]
        places += [*np.broadcast_to(place, gap.shape), *np.zeros((2, place.size))]
        attitudes += [*(attitude * np.maximum(values.T, 0.0)), *np.broadcast_to(attitude, (2, attitude.size))]
    square, design = np.concatenate(squares), np.stack((np.concatenate(places), np.concatenate(attitudes)))
    square = square * (square.size / max(square.size - PARAMETERS, 1))
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
