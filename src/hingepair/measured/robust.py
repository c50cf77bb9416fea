"""Losses by which outliers count little, and sizes that outliers do not change: one policy for all fits."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hingepair.numeric.arrays import Float64Array

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
