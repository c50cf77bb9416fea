"""The most likely hinge: Gauss-Newton on the constraints, psi and every true pose eliminated.

Each pose is off by isotropic noise, of place and of attitude, alike for both bodies. What the constraints leave of
sample i, the tilt Q m - n (two components) and the gap u1 - p - Q u2 (three), is then linear in that noise, so that
the most likely hinge makes `sum r_i^T C_i^-1 r_i` least, with C_i the covariance of r_i (the adjustment of condition
equations with parameters, Helmert 1872; Förstner and Wrobel, Photogrammetric Computer Vision, 2016, 4.8). All is
written in axes along the hinge. There the tilt is seen free of the gap; half of the lever times the tilt is taken
from the gap, after which it is

    C = a + b (abs(p)^2 - p p^T) + b w w^T,   w = n x (S1 u1 + S2 u2),

a the variance of R2 - R1, b a quarter of that of the relative attitude. Samples are walked through in blocks; nothing
of the size of a Jacobian of all samples is kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from hingepair.measured.hinge import Hinge, frame
from hingepair.measured.relative_poses import RelativePoses
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import rotation_exp

PARAMETERS = 9
"""Those of `Hinge.moved`."""
_BLOCK = 2048  # samples, that fit the caches
_THIN = 16384  # samples that the first steps are taken with
_MAX_SCORED, _STRETCH = 131072, 16  # samples that the covariance is taken from; blocks of them that follow each other
_MIN_SUMS = 40  # sums of neighbouring scores that the covariance is taken from, at least
_MAX_STEPS, _MAX_TURN = 40, 0.3  # steps of a fit; turn of an axis in one of them [rad]
_MAX_LAST_STEP, _MAX_NEXT_STEP = 0.02, 0.1  # at rest: standard deviations of a step, and of the next one
_ROUNDING_STEP = 2.0**-50  # a step, of turns or in parts of the bodies' largest coordinate, that rounding makes
_BIAS_SAMPLES, _MIN_BIAS = 300, 0.1  # samples that the bias is taken at; standard deviations from which it counts
_MIN_AXES_COSINE = -0.999999  # cosine of axes below which they point against each other
_U = 2.0**-53
_LOSS_SCALE = 11.07
"""Size of r^T C^-1 r at which losses other than "linear" bend: 95 % of good samples are below."""
_MAX_NOISE_SIZE, _MAX_COUNTED_SIZE = 100.0, 900.0
"""Sizes from which samples tell nothing of the noise, and from which they count nothing in losses but "linear"."""
_MEDIANS = {2: 1.3863, 3: 2.3660}  # of chi-squared, by degrees of freedom

Loss = Callable[[Float64Array], tuple[Float64Array, Float64Array]]

LOSSES: dict[str, Loss | None] = {
    "linear": None,
    "soft_l1": lambda z: ((1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5),
    "huber": lambda z: (np.maximum(z, 1) ** -0.5, np.where(z > 1, -0.5 * np.maximum(z, 1) ** -1.5, 0.0)),
    "cauchy": lambda z: (1 / (1 + z), -1 / (1 + z) ** 2),
    "arctan": lambda z: (1 / (1 + z * z), -2 * z / (1 + z * z) ** 2),
}
"""First and second derivative of each loss, as SciPy's least_squares defines them."""


class Noise(NamedTuple):
    """Variances of the noise."""

    place: float  # of a component of R2 - R1 [m^2]
    attitude: float  # of a component of the relative attitude [rad^2]


class Residuals(NamedTuple):
    """What the constraints E1 and E2 leave of some samples, in axes along the hinge."""

    q: Float64Array  # relative attitude, row by row; shape (9, M)
    p: Float64Array  # relative place [m]; shape (3, M)
    arms: Float64Array  # S1 u1 + S2 u2 [m]; shape (3, M)
    tilt: Float64Array  # of Q m - n the direction, its length the chord; shape (2, M)
    gap: Float64Array  # of E1, half of the tilt's share taken out [m]; shape (3, M)

    @property
    def spread(self) -> Float64Array:
        """Return what noise of attitude, of variance 1, adds to abs(gap)^2 [m^2]; shape (M,)."""
        x, y, _ = self.arms
        return np.asarray((self.p * self.p).sum(axis=0) / 2 + (x * x + y * y) / 4)

    def whiten(self, noise: Noise, tilts: Float64Array, gaps: Float64Array) -> Float64Array:
        """Return the tilts (k, 2, M) and gaps (k, 3, M) multiplied by L^-1, where L L^T is C; shape (k, 5, M).

        C = L L^T (Cholesky) with w = (-y, x, 0); no eigenvalue of C is below a.
        """
        a, b = noise.place, noise.attitude / 4
        (p, q, r), (x, y, _) = self.p, self.arms
        xy, zx, yz = -b * (p * q + x * y), -b * r * p, -b * q * r
        l1 = np.sqrt(a + b * (q * q + r * r + y * y))
        l2, l3 = xy / l1, zx / l1
        m2 = np.sqrt(np.maximum(a + b * (r * r + p * p + x * x) - l2 * l2, a))
        m3 = (yz - l2 * l3) / m2
        n3 = np.sqrt(np.maximum(a + b * (p * p + q * q) - l3 * l3 - m3 * m3, a))
        rows = np.empty((tilts.shape[0], 5, tilts.shape[2]))
        rows[:, :2] = tilts / np.sqrt(noise.attitude)
        rows[:, 2] = gaps[:, 0] / l1
        rows[:, 3] = (gaps[:, 1] - l2 * rows[:, 2]) / m2
        rows[:, 4] = (gaps[:, 2] - l3 * rows[:, 2] - m3 * rows[:, 3]) / n3
        return rows

    def sizes(self, noise: Noise) -> Float64Array:
        """Return r^T C^-1 r, about 5 where noise is as supposed; shape (M,)."""
        return np.asarray((self.whiten(noise, self.tilt[None], self.gap[None])[0] ** 2).sum(axis=0))

    def rows(self, noise: Noise) -> Float64Array:
        """Return derivatives by the PARAMETERS, and the residual last, whitened; shape (10, 5, M)."""
        q, (x, y, z), count = self.q, self.arms, self.q.shape[1]
        tilts, gaps = np.zeros((PARAMETERS + 1, 2, count)), np.zeros((PARAMETERS + 1, 3, count))
        tilts[0, 0] = tilts[1, 1] = -1.0
        tilts[2], tilts[3], tilts[9] = q[0:6:3], q[1:6:3], self.tilt
        for k in range(4):
            gaps[k, :2] = 0.5 * z * tilts[k]
            gaps[k, 2] = -0.5 * (tilts[k, 0] * x + tilts[k, 1] * y)
        for k in range(3):
            gaps[4 + k, k] = 1.0
        gaps[7], gaps[8], gaps[9] = -q[0::3], -q[1::3], self.gap
        return self.whiten(noise, tilts, gaps)


class Judged(NamedTuple):
    """What a hinge leaves of every sample, and the covariance of its parameters."""

    tilt: Float64Array  # angle between the axes [rad]; shape (N,)
    gap: Float64Array  # of E1, in axes along the hinge [m]; shape (3, N)
    psi: Float64Array  # angle about the hinge from one `frame` to the other, in [-pi, pi] [rad]; shape (N,)
    sizes: Float64Array  # r^T C^-1 r; shape (N,)
    weights: Float64Array  # given, times those of the loss; shape (N,)
    alike: tuple[float, float]  # correlations of neighbours, of tilts and of gaps
    covariance: Float64Array  # of the parameters
    unresolved_lag: int  # samples over which scores are still correlated at the longest sums; 0 where they are not


def most_likely(poses: RelativePoses, start: Hinge, loss: Loss | None) -> tuple[Hinge, Noise, bool]:
    """Return the most likely hinge, its noise, and whether the steps came to rest."""
    thin = poses.thinned(_THIN)
    hinge, noise = start, _noise(thin, start, None, loss)
    still = False
    for some in (thin, poses) if thin is not poses else (poses,):
        for _ in range(_MAX_STEPS):
            normal, gradient = _normal_equations(some, hinge, noise, loss)
            step = -_solved(normal, gradient)
            turn = float(np.abs(step[:4]).max())
            if turn > _MAX_TURN:
                step *= _MAX_TURN / turn
            hinge = hinge.moved(step).balanced()
            noise = _noise(thin, hinge, noise, loss)
            # in standard deviations; without a loss the next step is about this one times the noise
            size = np.sqrt(step @ normal @ step)
            quick = loss is None and size * (turn + np.sqrt(noise.attitude)) < _MAX_NEXT_STEP
            rounded = (np.abs(step) < _ROUNDING_STEP * np.repeat((1.0, poses.size), (4, 5))).all()
            still = bool(size < _MAX_LAST_STEP or quick or rounded)
            if still:
                break
    return hinge, noise, still


def without_bias(poses: RelativePoses, hinge: Hinge, noise: Noise) -> Hinge:
    """Return the hinge less its bias, which is of the order of the noise squared, however many samples there are.

    A rotation that is off at random is on average a shorter matrix than a rotation, so levers come out short. What
    the scores are on average follows from the fitted hinge itself: they are taken at its exact poses, each of the
    nine coordinates of noise once up and once down. Nothing is taken off that is no tenth of a standard deviation.
    """
    reach = max(float(np.sqrt((poses.p * poses.p).sum() / poses.samples)), 1e-300)
    if np.sqrt(poses.samples) * (np.sqrt(noise.attitude) + np.sqrt(noise.place) / reach) < _MIN_BIAS:
        return hinge
    thin = poses.thinned(_BIAS_SAMPLES)
    first, second = frame(hinge.n), frame(hinge.m)
    q = np.kron(first.T, second.T) @ thin.Q
    psi = np.arctan2(q[3] - q[1], q[0] + q[4])
    c, s, zero = np.cos(psi), np.sin(psi), np.zeros_like(psi)
    Q = first @ np.stack((c, -s, zero, s, c, zero, zero, zero, zero + 1), axis=-1).reshape(-1, 3, 3) @ second.T
    p = hinge.u1 - Q @ hinge.u2
    exact = []
    turns = rotation_exp(np.sqrt(noise.attitude / 2) * np.eye(3))
    for turn, off in zip(turns, np.sqrt(noise.place) * np.eye(3), strict=True):
        exact += [(turn @ Q, p), (turn.T @ Q, p), (Q, p + off), (Q, p - off)]
        exact += [(turn.T @ Q, p @ turn), (turn @ Q, p @ turn.T)]
    rows = np.concatenate([each[0].reshape(-1, 9) for each in exact])
    places = np.concatenate([each[1] for each in exact])
    around = RelativePoses(
        np.ascontiguousarray(rows.T), np.ascontiguousarray(places.T), np.ones(places.shape[0]), poses.size
    )
    normal, gradient = _normal_equations(around, hinge, noise, None)
    return hinge.moved(_solved(normal / len(exact), gradient / 2)).balanced()


def judged(poses: RelativePoses, hinge: Hinge, noise: Noise, loss: Loss | None) -> Judged:
    """Compute what the hinge leaves of every sample, and the covariance of its parameters.

    The covariance is the sandwich A^-1 B A^-1 (Huber, Robust Statistics, 1981, 6.3): A the derivative of the sum of
    scores, B the scatter of the scores themselves, so it holds where the noise is not as the weights suppose. Scores
    of neighbours that are correlated in time are added up before they are squared. Of very many samples, A and B are
    those of some stretches.
    """
    count = poses.samples
    tilt, gap, psi = np.empty(count), np.empty((3, count)), np.empty(count)
    sizes, weights = np.empty(count), np.empty(count)
    slope, scores, left = np.zeros((PARAMETERS, PARAMETERS)), [], []
    every = max(1, count // _MAX_SCORED)
    for k, (own, seen) in enumerate(seen_from(poses, hinge)):
        q, (x, y, z) = seen.q, seen.arms
        tilt[own] = np.arctan2(np.hypot(q[2], q[5]), q[8])
        gap[:2, own] = seen.gap[:2] - 0.5 * z * seen.tilt
        gap[2, own] = seen.gap[2] + 0.5 * (seen.tilt[0] * x + seen.tilt[1] * y)
        psi[own] = np.arctan2(q[3] - q[1], q[0] + q[4])
        given = poses.weights[own]
        if (k // _STRETCH) % every:
            sizes[own] = seen.sizes(noise)
            weights[own] = given if loss is None else given * _slopes(loss, given * sizes[own])[0]
            continue
        rows = seen.rows(noise)
        sizes[own] = (rows[-1] ** 2).sum(axis=0)
        first, second = (1.0, 0.0) if loss is None else _slopes(loss, given * sizes[own])
        weights[own] = given * first
        score = np.einsum("kri,ri->ki", rows[:-1], rows[-1])
        slope += _gram(rows, weights[own])[:-1, :-1] + 2 / _LOSS_SCALE * (score * (second * given**2)) @ score.T
        scores.append(weights[own] * score)
        left.append(weights[own] * rows[-1])
    whole = np.concatenate(scores, axis=1)
    rest = np.concatenate(left, axis=1)
    alike = _alike(rest[:2], 1), _alike(rest[2:], 1)
    together, unresolved_lag = summed_neighbours(whole)
    added = np.add.reduceat(whole, np.arange(0, whole.shape[1], together), axis=1)
    share = whole.shape[1] / count
    # a sample tells less of itself than of others, by its part of the parameters
    free = 5 * whole.shape[1] / max(5 * whole.shape[1] - PARAMETERS, 1)
    inverse = _solved(slope, np.eye(PARAMETERS))
    covariance = share * free * inverse @ (added @ added.T) @ inverse.T
    return Judged(tilt, gap, psi, sizes, weights, alike, covariance, unresolved_lag)


def _alike(rows: Float64Array, lag: int) -> float:
    """Return the correlation of numbers with those `lag` samples later, of the row where it is largest."""
    power = (rows * rows).sum(axis=1)
    known = power > 0
    if not known.any() or rows.shape[1] <= lag:
        return 0.0
    products = (rows[:, lag:] * rows[:, :-lag]).sum(axis=1)
    return float((products[known] / power[known]).max())


def summed_neighbours(scores: Float64Array) -> tuple[int, int]:
    """Return how many neighbouring scores are added up before they are squared, and the lag that this falls short of.

    Sums go over four times the lag at which scores are hardly correlated, but there are _MIN_SUMS of them at least.
    Where scores are still correlated at the largest lag that this allows, the second number is that lag, else 0: then
    the covariance is too small.
    """
    count, lag = scores.shape[1], 1
    uncorrelated = max(0.1, 3 / np.sqrt(count))
    while 4 * lag * _MIN_SUMS <= count and _alike(scores, lag) > uncorrelated:
        lag *= 2
    together = 1 if lag == 1 else min(4 * lag, count // _MIN_SUMS)
    unresolved = 4 * lag * _MIN_SUMS > count and _alike(scores, lag) > uncorrelated
    return together, lag if unresolved else 0


def seen_from(poses: RelativePoses, hinge: Hinge) -> Iterator[tuple[slice, Residuals]]:
    """Compute what the constraints leave of the samples, block by block."""
    first, second = frame(hinge.n), frame(hinge.m)
    turned = np.kron(first.T, second.T)
    lever1, lever2 = (first.T @ hinge.u1)[:, None], (second.T @ hinge.u2)[:, None]
    for start in range(0, poses.samples, _BLOCK):
        own = slice(start, min(start + _BLOCK, poses.samples))
        q, p = turned @ poses.Q[:, own], first.T @ poses.p[:, own]
        arm = (q.reshape(3, 3, -1) * lever2).sum(axis=1)
        arms = lever1 + arm
        tilt = q[2:6:3] / np.sqrt(np.maximum((1 + q[8]) / 2, 1e-12))
        if q[8].min() < _MIN_AXES_COSINE:
            tilt[0] = np.where(q[8] < _MIN_AXES_COSINE, 2.0, tilt[0])
        gap = lever1 - p - arm
        gap[:2] += 0.5 * arms[2] * tilt
        gap[2] -= 0.5 * (tilt[0] * arms[0] + tilt[1] * arms[1])
        yield own, Residuals(q, p, arms, tilt, gap)


def _normal_equations(
    poses: RelativePoses, hinge: Hinge, noise: Noise, loss: Loss | None
) -> tuple[Float64Array, Float64Array]:
    """Return J^T W J and J^T W r of one Gauss-Newton step; (9, 9), (9,)."""
    total = np.zeros((PARAMETERS + 1, PARAMETERS + 1))
    for own, seen in seen_from(poses, hinge):
        rows, weights = seen.rows(noise), poses.weights[own]
        if loss is not None:
            weights = weights * _slopes(loss, weights * (rows[-1] ** 2).sum(axis=0))[0]
        total += _gram(rows, weights)
    return total[:-1, :-1], total[:-1, -1]


def _slopes(loss: Loss, sizes: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the first and second derivative of a loss; 0 where a sample is too far off to be noise."""
    first, second = loss(sizes / _LOSS_SCALE)
    gross = sizes > _MAX_COUNTED_SIZE
    return np.where(gross, 0.0, first), np.where(gross, 0.0, second)


def _gram(rows: Float64Array, weights: Float64Array) -> Float64Array:
    rows = (rows * np.sqrt(weights)).reshape(rows.shape[0], -1)
    return np.asarray(rows @ rows.T)


def _noise(poses: RelativePoses, hinge: Hinge, before: Noise | None, loss: Loss | None) -> Noise:
    """Return variances by moments of the residuals, or by medians where there may be outliers; rounding at least.

    The noise found before tells which samples are so far off that they are left out of the medians.
    """
    parts = []
    for _, seen in seen_from(poses, hinge):
        sizes = np.zeros(seen.q.shape[1]) if loss is None or before is None else seen.sizes(before)
        parts.append((*((row * row).sum(axis=0) for row in (seen.tilt, seen.gap)), seen.spread, sizes))
    tilt, gap, spread, sizes = (np.concatenate(own) for own in zip(*parts, strict=True))
    weights = poses.weights
    near = np.ones(weights.size, dtype=bool)
    if loss is None:
        attitude, across = weights @ tilt / weights.sum() / 2, weights @ gap / weights.sum() / 3
    else:
        if 2 * (sizes < _MAX_NOISE_SIZE).sum() > near.size:
            near = sizes < _MAX_NOISE_SIZE
        attitude, across = np.median(tilt[near]) / _MEDIANS[2], np.median(gap[near]) / _MEDIANS[3]
    attitude = max(float(attitude), (4 * _U) ** 2)
    lever = float(weights[near] @ spread[near] / weights[near].sum()) / 3
    place = max(float(across) - attitude * lever, 1e-3 * float(across), (4 * _U * poses.size) ** 2, 1e-300)
    return Noise(place, attitude)


def _solved(matrix: Float64Array, right: Float64Array) -> Float64Array:
    """Return matrix^-1 right; directions that the matrix does not determine come out as 0."""
    scale = 1 / np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    found = np.linalg.lstsq(matrix * scale * scale[:, None], (right.T * scale).T, rcond=1e-13)[0]
    return np.asarray((found.T * scale).T)
