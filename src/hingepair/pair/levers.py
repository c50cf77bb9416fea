"""What the hinge turns of the levers u1 and u2, and what it leaves: constants of a pair, right to the last bit."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.evaluation.steps import LEVER_STEPS
from hingepair.numeric.arrays import vectors
from hingepair.numeric.blocks import components_of
from hingepair.numeric.twofold import Twofold
from hingepair.numeric.unit_vectors import by_power_of_two, exact_direction

LEVERS = ("along", "across", "around")


def levers(u1: NDArray[Any], u2: NDArray[Any], n: ArrayLike, home: NDArray[Any]) -> dict[str, NDArray[np.float64]]:
    """The vectors along, across and around of `steps.LEVER_STEPS`, each component rounded once; body-1 axes [m].

    They are computed from the axis as it was given: that at unit length has been rounded.
    """
    lengths, exponent = by_power_of_two((*components_of(u1), *components_of(u2)))
    numbers = tuple(Twofold(length) for length in lengths)
    axis = exact_direction(components_of(vectors("n", n, 3).astype(np.float64)))
    rotation = tuple(Twofold(c) for c in components_of(home, 2))
    values: dict[str, Any] = {"u1": numbers[:3], "u2": numbers[3:], "n": axis, "home": rotation}
    for result, function, arguments in LEVER_STEPS:
        values[result] = function(*[values[name] for name in arguments])
    found = {}
    for name in LEVERS:
        parts = np.broadcast_arrays(*(np.ldexp(c.high, exponent) for c in values[name]))
        found[name] = np.stack(parts, axis=-1)
    return found
