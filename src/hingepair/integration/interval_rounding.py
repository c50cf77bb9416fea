"""What rounding adds to the integral of a rate over intervals: of the rate, of the angles, and of the instants.

A step that turns by an angle a is rounded by about u a. Its nodes are rounded by about u t, which adds u t times the
change of the rate over the step. Each step is rounded in its own way, so that the squares add up: over many steps
this is far less than u times all that is turned, over few fast ones about that.

The stamps of samples may be rounded too: u times 1.7e9 s is 1e-7 s. Values that belong to the stamps as they are lie
on a smooth curve over them; over rounded stamps they are as rough as their slope times that.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.integration.attitude_steps import RULES, divided
from hingepair.integration.signals import Constant, Samples, Signal, Values

_U = 2.0**-53
_NODES = 0.4  # measured; a step's outer nodes are rounded in opposite senses, the middle one counts 4/9
_WINDOW = 11  # samples whose highest divided difference tells roughness; of a smooth motion it is as good as none
_WINDOWS = 2048
_ROUGH = 0.3  # of the roughness that rounded stamps make, in the mean of squares: they go like a saw
_OUTER = RULES["magnus6"].nodes[0], RULES["magnus6"].nodes[-1]


class Rounding(NamedTuple):
    """Of each interval.

    Attributes:
        size: the integral of the rate's size, shape (P,).
        noise: standard deviation of what rounding adds to the integral, shape (P,).
        alike: whether all steps of all intervals have the same rate, and so are rounded alike.
    """

    size: Values
    noise: Values
    alike: bool


def interval_rounding(signal: Signal, start: Values, stop: Values, counts: NDArray[np.int64]) -> Rounding:
    """The rounding of intervals, each in its number of steps."""
    if isinstance(signal, Constant):
        size = (stop - start) * float(_length(signal.value.reshape(-1)))
        return Rounding(size, _U * size, alike=True)
    begin, (h, _), _ = divided(start, stop, counts)
    rates = signal.nodes(begin, h, _OUTER).reshape(len(h), 2, -1)
    turned = 0.5 * h * (_length(rates[:, 0]) + _length(rates[:, 1]))
    moved = 0.0 if isinstance(signal, Samples) else _NODES * np.abs(begin + h) * _length(rates[:, 1] - rates[:, 0])
    first = np.cumsum(counts) - counts
    size = np.add.reduceat(turned, first)
    if (rates == rates[0, 0]).all():
        return Rounding(size, _U * size, alike=True)
    return Rounding(size, _U * np.sqrt(np.add.reduceat(turned**2 + moved**2, first)), alike=False)


def stamp_rounding(samples: Samples) -> float:
    """What the rounding of the stamps adds to an integral over samples; 0 where values show that none took place.

    At an instant that is off by some time the integral is off by the rate times that, and a random walk of the
    changes of the rate times that comes to it on the way there.
    """
    t, columns = samples.t, samples.values.reshape(len(samples.t), -1)
    sigma = np.spacing(np.abs(t)) / math.sqrt(12)
    h, slopes = np.diff(t), _length(np.diff(columns, axis=0)) / np.diff(t)
    if not _stamps_are_rounded(t, columns, sigma):
        return 0.0
    walk = math.sqrt(float(((slopes * h * sigma[1:]) ** 2).sum()))
    return 2 * float((_length(columns) * sigma).max()) + walk


def _stamps_are_rounded(t: Values, columns: Values, sigma: Values) -> bool:
    if len(t) < _WINDOW + 1:
        return True
    first = np.unique(np.linspace(0, len(t) - _WINDOW, _WINDOWS).astype(np.intp))
    near = first[:, None] + np.arange(_WINDOW)
    x = (t[near] - t[first, None]) / (t[first + _WINDOW - 1] - t[first])[:, None]
    apart = x[:, :, None] - x[:, None, :] + np.eye(_WINDOW)
    weights = 1 / apart.prod(axis=2)
    rough = _length(np.einsum("wi,wik->wk", weights, columns[near]))
    slopes = _length(np.gradient(columns, t, axis=0))[near]
    expected = ((weights * slopes * sigma[near]) ** 2).sum(axis=1)
    return bool((rough**2).sum() > _ROUGH**2 * expected.sum())


def _length(values: Values) -> Values:
    length: Values = np.sqrt((values**2).sum(axis=-1))
    return length
