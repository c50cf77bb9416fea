"""What the rounding of stamps does to integrals over samples (E12).

Clocks and files round stamps: seconds since 1970 as doubles to 2.4e-7 s, single floats to a 16-millionth of their
size, text to its last decimal place. Values of the true instants then lie beside the curve over the stamps, by as
much as they change in what the stamps are off; values that belong to the stamps as they are lie on a smooth curve.
Divided differences of high order tell the two apart. They are measured where the distances of stamps differ, since
stamps at even distances are what they are, or off all alike.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from hingepair.integration.signals import Samples
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import row_norms

_WINDOW: Final = 11
"""Samples whose highest divided difference tells roughness: of a smooth motion it is as good as none."""

_MAX_WINDOWS = 2048
_DECIMALS = 9  # places of seconds in text
_COARSER = 8.0  # times the spacing of doubles: a decimal place that stamps keep to is no accident
_UNIFORM = 1 / math.sqrt(12)  # standard deviation of what is rounded to a whole number
_QUANTILE, _SQUARE = 0.8, 1.642  # a quantile of the square of a normal variable; kinks are in fewer windows
_U = 2.0**-53
_SHOWN = 4.0  # times what the rounding of values makes: a larger difference has another cause


def stamp_deviations(signals: Sequence[Samples]) -> Array:
    """Return the standard deviations of the stamps of samples from the true instants [s]; shape (N,).

    They are those of rounding to a grid that all stamps are on (doubles, single floats, decimals), times the
    roughness of the values as a part of what this rounding would make; of the grid where they are largest, and of the
    smoothest signal, since another may be noisy itself. Too few samples to tell are taken to be rounded as doubles
    are.

    Args:
        signals: samples at the same instants.
    """
    t = signals[0].t
    if len(t) <= _WINDOW:
        return _UNIFORM * np.spacing(np.abs(t))
    found = np.zeros(len(t))
    for grid in stamp_grids(t):
        parts = [part for part in (_rounded_part(signal, _UNIFORM * grid) for signal in signals) if part is not None]
        found = np.maximum(found, min(parts, default=0.0) * _UNIFORM * grid)
    return found


def stamp_error(samples: Samples, deviations: Array) -> float:
    """Return how far an integral over samples is off since stamps deviate [rad].

    At an instant that is off by some time the integral is off by the rate times that, and a random walk of the
    changes of the rate times that comes to it on the way there.
    """
    columns = samples.values.reshape(len(samples.t), -1)
    walk = row_norms(np.diff(columns, axis=0)) * deviations[1:]
    return 2 * float((row_norms(columns) * deviations).max()) + math.sqrt(float((walk**2).sum()))


def stamp_grids(t: Array) -> list[Array]:
    """Return the distances of neighbours on the grids that all stamps are on, at each of them [s].

    >>> [float(grid[0]) for grid in stamp_grids(np.array([0.013, 0.031]))]
    [1.734723475976807e-18, 0.001]
    """
    size = np.abs(t)
    doubles = np.spacing(size)
    grids = [doubles]
    with np.errstate(over="ignore"):
        singles = size.astype(np.float32)
    if (singles == size).all():
        grids.append(np.spacing(singles).astype(np.float64))
    for unit in 10.0 ** np.arange(_DECIMALS + 1):
        if 1 / unit > _COARSER * doubles.max() and (np.abs(np.round(size * unit) / unit - size) <= doubles).all():
            grids.append(np.full(len(t), 1 / unit))
            break
    return grids


def _rounded_part(signal: Samples, deviations: Array) -> float | None:
    """Return how rough values are as a part of what deviations of stamps would make, or None if they cannot tell."""
    t, columns = signal.t, signal.values.reshape(len(signal.t), -1)
    first = np.unique(np.linspace(0, len(t) - _WINDOW, _MAX_WINDOWS).astype(np.intp))
    near = first[:, None] + np.arange(_WINDOW)
    steps = np.diff(t[near], axis=1)
    uneven = np.ptp(steps, axis=1) > deviations[near].max(axis=1)
    if not uneven.any():
        return None
    near = near[uneven]
    x = (t[near] - t[near[:, :1]]) / (t[near[:, -1:]] - t[near[:, :1]])
    weights = 1 / (x[:, :, None] - x[:, None, :] + np.eye(_WINDOW)).prod(axis=2)
    rough = (np.einsum("wi,wik->wk", weights, columns[near]) ** 2).sum(axis=1)
    slopes = np.asarray(np.gradient(columns, t, axis=0))
    by_stamps = row_norms(slopes) * deviations
    by_values = _U * row_norms(columns)
    expected, of_values = (((weights * each[near]) ** 2).sum(axis=1) for each in (by_stamps, by_values))
    tells = expected > _SHOWN**2 * of_values
    if not tells.any():
        return None
    rough, expected, of_values = rough[tells], expected[tells], of_values[tells]
    parts = np.where(rough > _SHOWN**2 * of_values, rough / expected, 0.0)
    return min(1.0, math.sqrt(float(np.quantile(parts, _QUANTILE)) / _SQUARE))
