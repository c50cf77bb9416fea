"""Statistics of all fits: losses by which outliers count little, sizes that outliers do not change, and covariances
of least squares that hold where the noise is not as the weights suppose.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.numeric.arrays import Float64Array, read_only

Loss = Callable[[Float64Array], tuple[Float64Array, Float64Array]]
"""First and second derivative of a loss by the squared residual z, as SciPy's `least_squares` defines losses."""


def soft_l1(z: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the first and the second derivative of 2 (sqrt(1 + z) - 1)."""
    return (1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5


def huber(z: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the first and the second derivative of z up to 1, and of 2 sqrt(z) - 1 from there on."""
    far = np.maximum(z, 1)
    return far**-0.5, np.where(z > 1, -0.5 * far**-1.5, 0.0)


def cauchy(z: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the first and the second derivative of log(1 + z)."""
    return 1 / (1 + z), -1 / (1 + z) ** 2


def arctan(z: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return the first and the second derivative of the arc tangent of z."""
    return 1 / (1 + z * z), -2 * z / (1 + z * z) ** 2


LOSSES: dict[str, Loss | None] = {  # by the names that users type; None: least squares
    "linear": None,
    "soft_l1": soft_l1,
    "huber": huber,
    "cauchy": cauchy,
    "arctan": arctan,
}

OUTLIER = 50.0  # squared residual, in variances, from which a sample is called an outlier
_MEDIANS = {1: 0.4549, 2: 1.3863, 3: 2.3660, 5: 4.35}  # of chi-squared, by degrees of freedom
_BENDS = {1: 3.84, 2: 5.99, 3: 7.81, 5: 11.07}  # likewise, where losses bend: 95 % of the squares are below


def loss_weights(
    loss: Loss | None, squares: Float64Array, freedom: int, gross: float = 900.0
) -> tuple[Float64Array, Float64Array]:
    """Return the weights by which a loss counts samples, and the derivatives of the weights by the squares.

    Args:
        loss: None: all samples weigh 1.
        squares: squared residuals in variances, each a sum over `freedom` components.
        freedom: degrees of freedom of a square.
        gross: square from which a sample has no weight.
    """
    if loss is None:
        return np.ones_like(squares), np.zeros_like(squares)
    first, second = loss(squares / _BENDS[freedom])
    near = squares <= gross
    return np.where(near, first, 0.0), np.where(near, second / _BENDS[freedom], 0.0)


def median_variance(squares: Float64Array, freedom: int) -> float:
    """Return the variance of a component from the median of sums of `freedom` squares."""
    return float(np.median(squares)) / _MEDIANS[freedom]


def every_kth(count: int, most: int) -> slice:
    """Return every k-th of `count` samples, with the smallest k that leaves at most so many.

    >>> range(10)[every_kth(10, 4)]
    range(0, 10, 3)
    """
    return slice(None, None, max(-(-count // most), 1))


def over_all(values: Float64Array, rows: NDArray[Any], count: int, fill: float = np.nan) -> Float64Array:
    """Return a read-only array over `count` samples that has `values` at some rows, and `fill` at the others."""
    whole = np.full((count, *values.shape[1:]), fill)
    whole[rows] = values
    return read_only(whole)


# ---- covariances

_MIN_SUMS = 40  # of neighbouring scores, from which a covariance is taken


def solve_semidefinite(matrix: Float64Array, right_hand_side: Float64Array) -> Float64Array:
    """Return the solution of a linear system with a symmetric positive semidefinite matrix and one or more columns on
    the right-hand side. Components that a singular matrix does not determine are 0.
    """
    scale = 1 / np.sqrt(np.maximum(np.diagonal(matrix), 1e-300))
    solution = np.linalg.lstsq(matrix * scale * scale[:, None], (right_hand_side.T * scale).T, rcond=1e-13)[0]
    return np.asarray((solution.T * scale).T)


def sandwich(
    inverse: Float64Array, scores: Float64Array, prior: Float64Array | float = 0.0
) -> tuple[Float64Array, int]:
    """Return the covariance A^-1 B A^-T of parameters (Huber, Robust Statistics, 1981, 6.3), and the lag of
    `score_scatter`.

    Args:
        inverse: A^-1, of the derivative of the sum of scores; (k, k).
        scores: of the samples, whose scatter is B; (k, N).
        prior: scatter that priors add to B.
    """
    scatter, lag = score_scatter(scores)
    return inverse @ (scatter + prior) @ inverse.T, lag


def neighbour_correlation(rows: Float64Array, lag: int = 1) -> float:
    """Return the correlation of entries with those `lag` places later, the largest over all rows (k, N); 0 if the
    rows are zero or too short.
    """
    rows = np.atleast_2d(rows)
    power = (rows * rows).sum(axis=1)
    known = power > 0
    if not known.any() or rows.shape[1] <= lag:
        return 0.0
    products = (rows[:, lag:] * rows[:, :-lag]).sum(axis=1)
    return float((products[known] / power[known]).max())


def score_scatter(scores: Float64Array) -> tuple[Float64Array, int]:
    """Return the covariance (k, k) of the sum of scores (k, N), and the lag over which scores are correlated too long
    for the recording, or 0. Scores of neighbours that are correlated are added up before they are squared.

    >>> score_scatter(np.array([[1.0, -1.0, -1.0, 1.0]]))[0]
    array([[4.]])
    """
    together, unresolved_lag = neighbours_to_sum(scores)
    added = np.add.reduceat(scores, np.arange(0, scores.shape[1], together), axis=1)
    scatter = np.asarray(added @ added.T)
    if together > 1 or unresolved_lag:
        # A sum of L samples of a first-order autoregression has the variance L (1 + r) / (1 - r) less this.
        r = min(neighbour_correlation(scores), 0.98)
        whole = together * (1 + r) / (1 - r)
        scatter = scatter * whole / (whole - 2 * r * (1 - r**together) / (1 - r) ** 2)
    return scatter, unresolved_lag


def neighbours_to_sum(scores: Float64Array) -> tuple[int, int]:
    """Return how many neighbouring scores must be added up for the sums to be uncorrelated: four times the lag at
    which scores hardly are. Also return that lag if the recording is too short for so long sums, otherwise 0.
    """
    count, lag = scores.shape[1], 1
    uncorrelated = max(0.1, 3 / np.sqrt(count))
    while 4 * lag * _MIN_SUMS <= count and neighbour_correlation(scores, lag) > uncorrelated:
        lag *= 2
    together = 1 if lag == 1 else min(4 * lag, count // _MIN_SUMS)
    unresolved = 4 * lag * _MIN_SUMS > count and neighbour_correlation(scores, lag) > uncorrelated
    return together, lag if unresolved else 0
