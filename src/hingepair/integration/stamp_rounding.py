"""Errors of integrals over samples (E12) by the rounding of their time stamps.

Clocks and files round stamps: seconds since 1970 as doubles to 2.4e-7 s, single floats to a 16-millionth of their
size, text to its last decimal place. Values of the true instants then deviate from a smooth curve over the stamps by
their rate of change times the error of the stamp; values that belong to the rounded stamps lie on a smooth curve.
Divided differences of high order tell the two cases apart. They are measured where the distances of stamps differ,
since stamps at even distances are exact, or all have the same error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from hingepair.integration.signals import SampledSignal
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import row_norms
from hingepair.numeric.bounded import UNIT_ROUNDOFF

_WINDOW = 11  # samples whose highest divided difference measures roughness; that of a smooth motion is negligible
_UNIFORM_STD = 1 / math.sqrt(12)  # standard deviation of rounding to a grid, in its spacings


def stamp_deviations(signals: Sequence[SampledSignal]) -> Array:
    """Return an estimate of the standard deviations of the signals' time stamps from the true instants [s]; (N,).

    They are those of rounding to a grid that all stamps lie on (doubles, single floats, decimals), times the
    roughness of the values relative to what this rounding would cause; of the grid where they are largest, and of the
    smoothest signal, since another may be noisy itself.
    """
    t = signals[0].t
    if len(t) <= _WINDOW:  # too few to measure: doubles
        return _UNIFORM_STD * np.spacing(np.abs(t))
    deviations = np.zeros(len(t))
    for grid in stamp_grids(t):
        parts = [
            part
            for part in (_relative_roughness(signal, _UNIFORM_STD * grid) for signal in signals)
            if part is not None
        ]
        deviations = np.maximum(deviations, min(parts, default=0.0) * _UNIFORM_STD * grid)
    return deviations


def stamp_error(samples: SampledSignal, deviations: Array) -> float:
    """Return an estimate of the error [rad] of an integral over samples whose stamps have these standard deviations
    (N,) [s].
    """
    columns = samples.values.reshape(len(samples.t), -1)
    # The rate times the error of the stamp, and a random walk of the changes of the rate times those before.
    walk = row_norms(np.diff(columns, axis=0)) * deviations[1:]
    return 2 * float((row_norms(columns) * deviations).max()) + math.sqrt(float((walk**2).sum()))


def stamp_grids(t: Array) -> list[Array]:
    """Return the spacings (N,) at the stamps of every grid that all of them lie on [s]: doubles, then single floats
    and decimals if they fit.

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
    for unit in 10.0 ** np.arange(10):
        # That all stamps lie on a grid is no accident if it is much coarser than the grid of doubles.
        if 1 / unit > 8.0 * doubles.max() and (np.abs(np.round(size * unit) / unit - size) <= doubles).all():
            grids.append(np.full(len(t), 1 / unit))
            break
    return grids


def _relative_roughness(signal: SampledSignal, deviations: Array) -> float | None:
    """Return the ratio, at most 1, of the roughness of a signal to that which `deviations` of its stamps [s] would
    cause; None if it cannot be measured, as of evenly spaced stamps.
    """
    t, columns = signal.t, signal.values.reshape(len(signal.t), -1)
    window_starts = np.unique(np.linspace(0, len(t) - _WINDOW, 2048).astype(np.intp))
    windows = window_starts[:, None] + np.arange(_WINDOW)
    steps = np.diff(t[windows], axis=1)
    uneven = np.ptp(steps, axis=1) > deviations[windows].max(axis=1)
    if not uneven.any():
        return None
    windows = windows[uneven]
    x = (t[windows] - t[windows[:, :1]]) / (t[windows[:, -1:]] - t[windows[:, :1]])
    weights = 1 / (x[:, :, None] - x[:, None, :] + np.eye(_WINDOW)).prod(axis=2)
    roughness = (np.einsum("wi,wik->wk", weights, columns[windows]) ** 2).sum(axis=1)
    slopes = np.asarray(np.gradient(columns, t, axis=0))
    stamp_noise = row_norms(slopes) * deviations
    value_noise = UNIT_ROUNDOFF * row_norms(columns)
    roughness_by_stamps, roughness_by_values = (
        ((weights * noise[windows]) ** 2).sum(axis=1) for noise in (stamp_noise, value_noise)
    )
    smallest_roughness = 4.0**2 * roughness_by_values  # less may come from the rounding of values
    measurable = roughness_by_stamps > smallest_roughness
    if not measurable.any():
        return None
    roughness, roughness_by_stamps, smallest_roughness = (
        roughness[measurable],
        roughness_by_stamps[measurable],
        smallest_roughness[measurable],
    )
    ratios = np.where(roughness > smallest_roughness, roughness / roughness_by_stamps, 0.0)
    # The 0.8 quantile of a squared normal variable is 1.642; kinks lie in fewer than a fifth of the windows.
    return min(1.0, math.sqrt(float(np.quantile(ratios, 0.8)) / 1.642))
