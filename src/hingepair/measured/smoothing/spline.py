"""Smoothing splines through noisy columns: the linear smoother that positions, attitudes and angles share.

Of all curves f the one that makes `sum (y_i - f(t_i))^2 + lambda int f^(5)^2 dt` least, written in B-splines of
degree 7 on knots closer than the curve can bend (Eilers and Marx, Statistical Science 11 (1996), 89-121): solved in
time proportional to the samples, and well conditioned at any lambda. Away from the ends a cosine of f Hz comes out
multiplied by 1 / (1 + (f / bandwidth)^10), without delay. The penalty is on the fifth derivative because it is
accelerations that are asked for: with the third or second, what noise leaves in them is up to ten times as large for
the same motion.

The bandwidth is that of the least generalised cross validation (Craven and Wahba, Numerische Mathematik 31 (1979),
377-403), each degree of freedom counted 1.4 times, against its habit of following noise now and then (Kim and Gu,
Journal of the Royal Statistical Society B 66 (2004), 337-356).

Noise whose neighbours are correlated would be followed as if it were motion. So the spectrum of the samples tells
first whether the correlation of their noise falls by a factor from step to step (an autoregressive process of order
1; the likelihood is that of Whittle, Arkiv för Matematik 2 (1953), 423-434). By it samples are whitened (Kohn, Ansley
and Wong, Biometrika 79 (1992), 335-346).

The curve is the mean of a Gaussian process given the samples, so the inverse of the matrix that is solved is its
covariance (Wahba, Journal of the Royal Statistical Society B 45 (1983), 133-150): the standard deviation of every
sample and derivative, ends and gaps included.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError
from hingepair.measured.smoothing.angular_velocity import lagrange_weights
from hingepair.measured.smoothing.resample import interpolated
from hingepair.measured.statistics import OUTLIER, Loss, every_kth, loss_weights, median_variance
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.caching import lock_free_cached_property

MIN_PIECE = 8  # samples of a piece that is smoothed
_DEGREE = 7  # of the B-splines
_PENALISED = 5  # order of the derivative whose square is penalised
_CORRELATIONS = np.concatenate((np.arange(0, 0.9, 0.05), (0.9, 0.925, 0.95, 0.97)))  # of neighbours' noise, tried
_MAX_STEP = 1.5  # usual time steps: over longer ones noise is not correlated
_FIRST_FREQUENCY = 4  # index in a tapered spectrum: slower ones are of the taper itself
_LEAST_WEIGHT = 1e-6  # of an outlier; above 0, so that a curve through few samples stays determined
_STRETCH, _STRETCHES = 1024, 5  # samples of a stretch; of longer records, so many stretches choose the bandwidth


class SmoothingModel(NamedTuple):
    """Bandwidth of a smoothing, and the correlation of the noise that it assumes."""

    bandwidth: float  # [Hz]
    correlation: float  # of the noise of samples one usual step apart
    is_limited: bool = False  # whether the bandwidth is the highest that the samples allow


@dataclass(frozen=True, slots=True, eq=False)
class SmoothedColumns:
    """Columns (N, k) after smoothing. Curves and standard deviations are computed when they are asked for."""

    t: Float64Array  # [s]; (N,)
    columns: Float64Array  # samples; (N, k)
    pieces: Sequence[NDArray[np.intp]]
    model: SmoothingModel
    spline: SmoothingSpline
    coefficients: Float64Array
    residuals: Float64Array  # of the samples of all pieces; (M, k)
    variance: float  # of the noise of one sample of one column

    def _over_pieces(
        self, shape: tuple[int, ...], every: int, of: Callable[[int, Float64Array], Float64Array]
    ) -> Float64Array:
        """Return what a function gives of the number and of every k-th instant of each piece, NaN elsewhere."""
        whole = np.full(shape, np.nan)
        for i, piece in enumerate(self.pieces):
            span = slice(piece[0], piece[-1] + 1, every)
            whole[span] = of(i, self.t[span])
        return whole

    def curves(self, order: int) -> Float64Array:
        """Return the smooth columns, or their first or second derivatives; (N, k), NaN between the pieces."""
        return self._over_pieces(
            self.columns.shape, 1, lambda i, t: self.spline.evaluate(self.coefficients, i, t, order)
        )

    def deviations(self, order: int, every: int = 1) -> Float64Array:
        """Return the standard deviations of a column of `curves`, of every k-th sample; (N,), NaN elsewhere."""

        def deviation(i: int, t: Float64Array) -> Float64Array:
            # Measured: near ends, derivatives miss by more than the covariance of the coefficients says.
            from_end = np.minimum(t - t[0], t[-1] - t)
            more = 1 + 0.15 * order * np.exp(-2 * self.model.bandwidth * from_end)
            return np.asarray(more * np.sqrt(self.variance * self.spline.variances(i, t, order)))

        return self._over_pieces(self.t.shape, every, deviation)

    @property
    def residual_correlation(self) -> float:
        """Correlation of whitened residuals of neighbours."""
        white = self.spline.whitener @ self.residuals
        return float((white[1:] * white[:-1]).sum() / max((white * white).sum(), 1e-300))

    @property
    def outlier_share(self) -> float:
        """Fraction of the samples that are outliers."""
        squares = (self.residuals**2).sum(axis=1)
        # Large residuals that are small elsewhere are due to motion that the curve cannot follow.
        parts = np.array_split(squares, min(16, max(1, squares.size // 16)))
        if min(float(np.median(part)) for part in parts) < float(np.median(squares)) / 30:
            return 0.0
        directions = _count_noisy_directions(self.residuals)
        is_far = squares > OUTLIER * max(median_variance(squares, directions), 1e-300)
        if not is_far.any():
            return 0.0
        # A curve that follows an outlier is far off its neighbours, too: what they predict tells which one is.
        alone = [_deviations_of_isolated_outliers(self.t[piece], self.columns[piece]) for piece in self.pieces]
        isolated = np.concatenate(alone).any(axis=1)
        return float(np.mean(isolated if isolated.any() else is_far))


def smooth_columns(
    t: Float64Array,
    columns: Float64Array,
    pieces: Sequence[NDArray[np.intp]],
    bandwidth: float | None,
    loss: Loss | None = None,
) -> SmoothedColumns:
    """Smooth columns (N, k) in each piece of the record, NaN between the pieces.

    Args:
        t: instants [s]; (N,).
        columns: samples; (N, k).
        pieces: indices of the samples of each piece, at least MIN_PIECE, all of them finite.
        bandwidth: [Hz]; None: cross validation chooses it.
        loss: by which outliers count little; all columns of a sample have the same weight.

    Raises:
        ArgumentError: the bandwidth is far from all frequencies that the samples can show.
    """
    used, times = np.concatenate(pieces), [t[piece] for piece in pieces]
    weights, residuals = np.ones(used.size), np.zeros((used.size, columns.shape[1]))
    if loss is not None:  # a curve that begins by following an outlier never leaves it
        starts = [_deviations_of_isolated_outliers(t[piece], columns[piece]) for piece in pieces]
        residuals = np.concatenate(starts)
        weights[residuals.any(axis=1)] = _LEAST_WEIGHT
    for iteration in range(1 if loss is None else 6):
        # Bandwidth and correlation of the noise, with outliers replaced by the curve.
        if iteration < 2:
            clean, is_winsorised = columns.copy(), weights < 0.3
            clean[used[is_winsorised]] -= residuals[is_winsorised]
            model = _choose_model(t, columns, clean, pieces, weights, bandwidth)
        try:
            spline = SmoothingSpline(times, model, weights)
        except np.linalg.LinAlgError:
            if bandwidth is None:
                raise
            lowest, highest = 1 / (t[-1] - t[0]), 1 / float(np.median(np.diff(t)))
            expected = f"a frequency that the samples can show, about {lowest:.2g} to {highest:.2g} Hz"
            raise ArgumentError("bandwidth", expected, bandwidth) from None
        # The curve, the variance that it leaves, and by a loss the weights.
        coefficients = spline.solve(columns[used])
        residuals = columns[used] - spline.basis @ coefficients
        freedom = max(used.size - spline.freedom(), 1.0)
        directions = _count_noisy_directions(residuals)
        if loss is None:
            variance = float(((spline.whitener @ residuals) ** 2).sum() / (directions * freedom))
        else:
            white = _whitener(times, model.correlation, np.ones(used.size)) @ residuals
            variance = median_variance((white * white).sum(axis=1), directions) * used.size / freedom
            # A curve follows outliers more readily than a hinge: they lose their weight earlier.
            squares = (residuals * residuals).sum(axis=1) / max(variance, 1e-300)
            weights = np.maximum(loss_weights(loss, squares, directions, 100.0)[0], _LEAST_WEIGHT)
    return SmoothedColumns(t, columns, pieces, model, spline, coefficients, residuals, variance)


def _count_noisy_directions(residuals: Float64Array) -> int:
    """Return in how many directions residuals (N, k) vary: in 2 of positions, in 1 of attitudes in a plane."""
    squares = (residuals * residuals).sum(axis=1)
    usual = residuals[squares <= 20 * np.median(squares)]
    variances = np.linalg.eigvalsh(usual.T @ usual)
    return max(1, int((variances > 1e-4 * variances[-1]).sum()))


# Neighbours whose cubics and parabolas predict a sample: most of these sets miss an outlier nearby.
_PREDICTING_NEIGHBOURS = (
    *((-2, -1, 1, 2), (-4, -3, 3, 4), (-6, -5, 5, 6)),
    *((1, 3, 5), (2, 4, 6), (3, 6, 9)),
    *((-5, -3, -1), (-6, -4, -2), (-9, -6, -3)),
)


def _deviations_of_isolated_outliers(t: Float64Array, columns: Float64Array) -> Float64Array:
    """Return how far samples (N, k) lie from what their neighbours predict; 0 unless that is far beyond the usual."""
    from scipy.ndimage import median_filter

    predictions = np.full((len(_PREDICTING_NEIGHBOURS), *columns.shape), np.nan)
    for prediction, neighbours in zip(predictions, _PREDICTING_NEIGHBOURS, strict=True):
        rows = np.arange(max(0, -neighbours[0]), t.size - max(0, neighbours[-1]))
        near = rows[:, None] + np.array(neighbours)
        prediction[rows] = np.einsum("ni,nij->nj", lagrange_weights(t[near] - t[rows, None])[0], columns[near])
    deviations = columns - np.nanmedian(predictions, axis=0)
    sizes = (deviations * deviations).sum(axis=1)
    usual = np.maximum(np.median(sizes), median_filter(sizes, min(33, t.size)))
    is_outlier = sizes > 100 * usual
    between = interpolated(t, np.where(is_outlier[:, None], np.nan, columns), t, np.inf)
    # At the ends nothing is interpolated: there the prediction of one side stands.
    return np.where(is_outlier[:, None], np.where(np.isfinite(between), columns - between, deviations), 0.0)


def _choose_model(
    t: Float64Array,
    columns: Float64Array,
    clean_columns: Float64Array,
    pieces: Sequence[NDArray[np.intp]],
    weights: Float64Array,
    bandwidth: float | None,
) -> SmoothingModel:
    """Return the bandwidth, given or cross-validated, and the correlation of the noise, which `clean_columns` tell:
    in them outliers are replaced.
    """
    weight_by_row = np.full(t.size, np.nan)
    weight_by_row[np.concatenate(pieces)] = weights
    count = sum(piece.size for piece in pieces)
    if count > _STRETCH * _STRETCHES:
        apart, last = count // _STRETCHES, MIN_PIECE - 1
        stretches = [piece[k : k + _STRETCH] for piece in pieces for k in range(0, piece.size - last, apart)]
        pieces = stretches[every_kth(len(stretches), 2 * _STRETCHES)]
    times = [t[piece] - t[piece[0]] for piece in pieces]
    used = np.concatenate(pieces)
    values, weights = columns[used], weight_by_row[used]
    correlation = _noise_correlation([clean_columns[run] for piece in pieces for run in _even_runs(t, piece)])
    if bandwidth is not None:
        return SmoothingModel(bandwidth, correlation)

    model = _cross_validated_model(times, values, weights, correlation)
    # Of samples without noise the spectrum tells nothing of it.
    return _cross_validated_model(times, values, weights, 0.0) if model.is_limited and correlation else model


def _cross_validated_model(
    times: Sequence[Float64Array], values: Float64Array, weights: Float64Array, correlation: float
) -> SmoothingModel:
    """Return the model whose bandwidth has the least cross-validation score for a given correlation."""
    count = values.shape[0]
    longest, step = max(time[-1] for time in times), sum(time[-1] for time in times) / count

    def score(log_bandwidth: float) -> float:
        """Return the generalised cross-validation score; inf where a spline fails or has no freedom left."""
        try:
            spline = SmoothingSpline(times, SmoothingModel(float(np.exp(log_bandwidth)), correlation), weights)
        except np.linalg.LinAlgError:
            return np.inf  # so low that a short piece does not determine it
        share = 1 - 1.4 * spline.freedom() / count  # each degree of freedom counts 1.4 times
        if share <= 0:
            return np.inf
        residuals = spline.whitener @ (values - spline.basis @ spline.solve(values))
        return float((residuals * residuals).sum() / share**2)

    # Half-octaves, then bisections around the best.
    scan = np.arange(np.log(0.1 / longest), np.log(0.5 / step), np.log(2) / 2)
    scores = np.array([score(x) for x in scan])
    if not np.isfinite(scores).any():
        return SmoothingModel(float(np.exp(scan[0])), correlation)
    best = int(np.argmin(scores))
    is_limited = bool(best >= np.flatnonzero(np.isfinite(scores))[-1] - 1)
    best_logarithm, width = float(scan[best]), np.log(2) / 4
    lowest = scores[best]
    for _ in range(3):
        for x in (best_logarithm - width, best_logarithm + width):
            if (value := score(x)) < lowest:
                best_logarithm, lowest = x, value
        width /= 2
    # Derivatives near the ends gain more by a tenth than those in the middle lose.
    return SmoothingModel(1.1 * float(np.exp(best_logarithm)), correlation, is_limited)


def _even_runs(t: Float64Array, piece: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """Split a piece wherever samples are missing, into parts of nearly even time steps."""
    steps = np.diff(t[piece])
    return np.split(piece, np.flatnonzero(steps > _MAX_STEP * np.median(steps)) + 1)


def _noise_correlation(pieces: Sequence[Float64Array]) -> float:
    """Return the correlation of the noise of neighbours that the spectra of samples at even steps tell, 0 if it may
    be white. A spectrum is that of a motion, which falls with the tenth power of the frequency, and of noise.
    """
    frequencies, powers = [], []
    for values in pieces:
        count = values.shape[0]
        if count < 128:
            continue
        # Blackman and Harris's taper: little of slow motion leaks into fast noise.
        place = np.arange(count)
        angle = 2 * np.pi * place / count
        coefficients = (0.35875, -0.48829, 0.14128, -0.01168)
        taper = sum(part * np.cos(i * angle) for i, part in enumerate(coefficients))
        line = np.polynomial.polynomial.polyfit(place / count, values, 1)
        level = values - np.polynomial.polynomial.polyval(place / count, line).T
        power = (np.abs(np.fft.rfft(level * taper[:, None], axis=0)) ** 2).sum(axis=1) / (taper @ taper)
        frequencies.append(np.arange(_FIRST_FREQUENCY, power.size - 1) / count)
        powers.append(power[_FIRST_FREQUENCY : power.size - 1])
    if not powers:
        return 0.0
    # Whittle's likelihood of every correlation, at the best corner of the motion's spectrum.
    f, power = np.concatenate(frequencies), np.concatenate(powers)
    if not power.max() > 0:
        return 0.0
    power = np.maximum(power / power.max(), 1e-300)
    corners = np.exp(np.arange(np.log(f.min()), np.log(0.4), np.log(2) / 4))
    motion = (corners[:, None] / f) ** (2 * _PENALISED)
    cosine = np.cos(2 * np.pi * f)
    costs = []
    for correlation in _CORRELATIONS:
        noise = (1 - correlation**2) / (1 + correlation**2 - 2 * correlation * cosine)
        shape = noise + motion * (1 + correlation) / (1 - correlation)
        costs.append(float((np.log(shape).sum(axis=1) + f.size * np.log((power / shape).mean(axis=1))).min()))
    columns = _count_noisy_directions(
        np.concatenate([np.diff(values, 4, axis=0) for values in pieces if len(values) > 4])
    )
    best = int(np.argmin(costs))
    gain = 0.5 * columns * (costs[0] - costs[best])  # half of the terms of a tapered spectrum are independent
    return float(_CORRELATIONS[best]) if gain > 5.0 else 0.0


class SmoothingSpline:
    """A smoothing spline through columns of samples: uniform knots in each piece of the record, and the Cholesky
    factor of the banded matrix that is solved for the coefficients.
    """

    def __init__(self, times: Sequence[Float64Array], model: SmoothingModel, weights: Float64Array) -> None:
        from scipy.interpolate import BSpline
        from scipy.linalg import cholesky_banded
        from scipy.sparse import block_diag

        step = _mean_step(times)
        widest = max(1 / (4.0 * model.bandwidth), step) * (1 + 1e-12)
        inner = [np.linspace(time[0], time[-1], 1 + math.ceil((time[-1] - time[0]) / widest)) for time in times]
        self.knots = [_extended_knots(piece_knots) for piece_knots in inner]
        self.ends = np.cumsum([piece_knots.size - _DEGREE - 1 for piece_knots in self.knots])
        self.basis = block_diag(
            [
                BSpline.design_matrix(time, piece_knots, _DEGREE)
                for time, piece_knots in zip(times, self.knots, strict=True)
            ],
            "csr",
        )
        self.whitener = _whitener(times, model.correlation, weights)
        self.rows = self.whitener @ self.basis
        self.normal = self.rows.T @ self.rows
        penalty = np.concatenate(
            [_penalty_bands(piece_knots.size - 1, piece_knots[1] - piece_knots[0]) for piece_knots in inner], axis=1
        )
        weight = (2 * np.pi * model.bandwidth) ** (-2 * _PENALISED) / step
        weight *= (1 - model.correlation) / (1 + model.correlation)  # what whitening leaves of slow changes
        bands = _DEGREE + (2 if model.correlation else 0)  # neighbours that are correlated reach further
        self._matrix = np.zeros((bands + 1, penalty.shape[1]))
        self._matrix[bands - _DEGREE :] = weight * penalty
        for k in range(min(bands + 1, penalty.shape[1])):
            self._matrix[bands - k, k:] += self.normal.diagonal(k)
        self.factor = cholesky_banded(self._matrix, check_finite=False)

    def solve(self, columns: Float64Array) -> Float64Array:
        """Return the B-spline coefficients for columns (N, k) of all pieces, one after the other."""
        return self._solve_right_hand_side(self.rows.T @ (self.whitener @ columns))

    def _solve_right_hand_side(self, right: Float64Array) -> Float64Array:
        from scipy.linalg import cho_solve_banded

        return np.asarray(cho_solve_banded((self.factor, False), right, check_finite=False))

    def _columns(self, piece: int) -> slice:
        """Return which coefficients are those of a piece."""
        return slice(self.ends[piece] - self.knots[piece].size + _DEGREE + 1, self.ends[piece])

    def _design(self, piece: int, t: Float64Array, order: int) -> Any:
        """Return the sparse matrix that takes coefficients of a piece to its derivative of an order at instants t."""
        from scipy.interpolate import BSpline
        from scipy.sparse import diags_array

        knots = self.knots[piece]
        design = BSpline.design_matrix(t, knots[order : knots.size - order], _DEGREE - order)
        for size in range(design.shape[1], design.shape[1] + order):
            slope = np.array((-1, 1)) / (knots[1] - knots[0])
            design = design @ diags_array(slope, offsets=[0, 1], shape=(size, size + 1))
        return design

    def evaluate(self, coefficients: Float64Array, piece: int, t: Float64Array, order: int) -> Float64Array:
        """Return the curves, or their derivatives of an order, at instants t [s] of a piece; (N, k)."""
        from scipy.interpolate import BSpline

        return np.asarray(BSpline(self.knots[piece], coefficients[self._columns(piece)], _DEGREE)(t, order))

    @lock_free_cached_property
    def covariances(self) -> Float64Array:
        """Upper bands of the inverse of the matrix that is solved: [d, j] is entry (j, j + d)."""
        return inverse_bands(self._matrix, _DEGREE + 1)

    def variances(self, piece: int, t: Float64Array, order: int) -> Float64Array:
        """Return the variances (N,) of the curve, or of its derivative, at instants of a piece, for noise of variance
        1.
        """
        from scipy.sparse import diags_array

        design, columns = self._design(piece, t, order), self._columns(piece)
        bands = [
            self.covariances[abs(d), columns.start : columns.stop - abs(d)] for d in range(-_DEGREE, _DEGREE + 1)
        ]
        covariance = diags_array(bands, offsets=range(-_DEGREE, _DEGREE + 1))
        return np.asarray(np.maximum((design @ covariance).multiply(design).sum(axis=1), 0.0)).ravel()

    def freedom(self) -> float:
        """Return the degrees of freedom, the trace of the smoother, estimated by vectors of signs (fixed seed)."""
        size = int(self.ends[-1])
        probes = np.zeros((size, min(16, size)))
        probes[np.arange(size), np.arange(size) % probes.shape[1]] = np.random.default_rng(1).choice(
            (-1.0, 1.0), size
        )
        return float(((self.normal @ probes) * self._solve_right_hand_side(probes)).sum())


def _mean_step(times: Sequence[Float64Array]) -> float:
    """Return the mean time step of pieces [s]."""
    return float(sum(time[-1] - time[0] for time in times) / sum(time.size - 1 for time in times))


def _whitener(times: Sequence[Float64Array], correlation: float, weights: Float64Array) -> Any:
    """Return the sparse matrix that makes the noise white and of equal variance. `correlation` is that of samples a
    mean step apart; variances go as 1 / weights.
    """
    from scipy.sparse import diags_array

    scale = np.sqrt(weights)
    if not correlation:
        return diags_array([scale], offsets=[0], format="csr")
    steps = np.concatenate([np.append(np.inf, np.diff(time)) for time in times]) / _mean_step(times)
    correlations = np.where(steps > _MAX_STEP, 0.0, correlation ** np.minimum(steps, 1e3))
    inverse_noise = 1 / np.sqrt(1 - correlations**2)
    diagonals = [inverse_noise * scale, (-correlations * inverse_noise)[1:] * scale[:-1]]
    return diags_array(diagonals, offsets=[0, -1], format="csr")


def inverse_bands(matrix: Float64Array, bands: int) -> Float64Array:
    """Return upper bands of the inverse of a positive definite banded matrix, which SciPy stores by its upper bands:
    row d, column j is entry (j, j + d), padded at the end.

    With A = L L^T block by block, the blocks of the inverse beside the diagonal follow from the last to the first
    (Takahashi, Fagan and Chin, Proceedings of the Eighth PICA Conference, 1973, 63-69).
    """
    size, count = matrix.shape
    blocks = -(-count // size)
    padded = np.zeros((size, (blocks + 1) * size))
    padded[:, :count], padded[-1, count:] = matrix, 1.0

    def entries(i: Any, j: Any) -> Float64Array:
        d = abs(i - j)
        return np.asarray(np.where(d < size, padded[np.maximum(size - 1 - d, 0), np.maximum(i, j)], 0.0))

    place = np.arange(blocks * size).reshape(blocks, size)
    diagonal, beside = (entries(place[:, :, None], place[:, None] + shift) for shift in (0, size))
    # Forwards: Schur complements. Backwards: blocks of the inverse.
    inverses, gains = np.empty_like(diagonal), np.empty_like(beside)
    schur_complement = diagonal[0]
    for k in range(blocks):
        inverses[k] = np.linalg.inv(schur_complement)
        if k + 1 < blocks:
            gains[k] = inverses[k] @ beside[k]
            schur_complement = diagonal[k + 1] - beside[k].T @ gains[k]
    diagonal_inverse, beside_inverse = inverses, np.zeros_like(beside)
    for k in range(blocks - 2, -1, -1):
        beside_inverse[k] = -gains[k] @ diagonal_inverse[k + 1]
        diagonal_inverse[k] -= beside_inverse[k] @ gains[k].T
    block, i = np.divmod(np.arange(blocks * size), size)
    j = i + np.arange(bands)[:, None]
    inner, outer = (
        diagonal_inverse[block, i, np.minimum(j, size - 1)],
        beside_inverse[block, i, np.maximum(j - size, 0)],
    )
    return np.asarray(np.where(j < size, inner, outer))


def _extended_knots(knots: Float64Array) -> Float64Array:
    """Return uniform knots with seven more at either end."""
    more = (knots[1] - knots[0]) * np.arange(1, _DEGREE + 1)
    return np.concatenate([knots[0] - more[::-1], knots, knots[-1] + more])


def _penalty_bands(intervals: int, width: float) -> Float64Array:
    """Return the upper bands of the integrals of products of the fifth derivatives of uniform B-splines; (8,
    intervals + 7).
    """
    from scipy.interpolate import BSpline

    nodes, weights = np.polynomial.legendre.leggauss(_DEGREE - _PENALISED + 1)
    bend = BSpline.basis_element(np.arange(_DEGREE + 2.0)).derivative(_PENALISED)
    bends = bend((nodes + 1) / 2 + np.arange(_DEGREE, -1, -1)[:, None])
    products = (bends * (weights / 2)) @ bends.T * width ** (1 - 2 * _PENALISED)
    bands = np.zeros((_DEGREE + 1, intervals + _DEGREE))
    for i, j in itertools.combinations_with_replacement(range(_DEGREE + 1), 2):
        bands[_DEGREE - (j - i), j : j + intervals] += products[i, j]
    return bands
