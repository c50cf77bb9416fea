"""What rounding adds to the integral of a rate over intervals: of the rate, of the angles, and of the instants.

A step that turns by an angle a is rounded by about u a. Its nodes are rounded by about u t, which adds u t times the
change of the rate over the step. Each step is rounded in its own way, so that the squares add up: over many steps
this is far less than u times all that is turned, over few fast ones about that.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.integration.attitude_steps import RULES, divided
from hingepair.integration.signals import Constant, Signal, Values

_U = 2.0**-53
_NODES = 0.4  # measured; a step's outer nodes are rounded in opposite senses, the middle one counts 4/9
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

    def added(self, weights: Values) -> float:
        """The noise of all intervals, each of which stands for so many."""
        if self.alike:
            return float((self.noise * weights).sum())
        return float(np.sqrt((self.noise**2 * weights).sum()))


def interval_rounding(signal: Signal, start: Values, stop: Values, counts: NDArray[np.int64]) -> Rounding:
    """The rounding of intervals, each in its number of steps."""
    if isinstance(signal, Constant):
        size = (stop - start) * float(_length(signal.value.reshape(-1)))
        return Rounding(size, _U * size, alike=True)
    begin, (h, _), _ = divided(start, stop, counts)
    rates = signal.nodes(begin, h, _OUTER).reshape(len(h), 2, -1)
    turned = 0.5 * h * (_length(rates[:, 0]) + _length(rates[:, 1]))
    moved = _NODES * np.abs(begin + h) * _length(rates[:, 1] - rates[:, 0])
    first = np.cumsum(counts) - counts
    size = np.add.reduceat(turned, first)
    if (rates == rates[0, 0]).all():
        return Rounding(size, _U * size, alike=True)
    return Rounding(size, _U * np.sqrt(np.add.reduceat(turned**2 + moved**2, first)), alike=False)


def _length(values: Values) -> Values:
    length: Values = np.sqrt((values**2).sum(axis=-1))
    return length
