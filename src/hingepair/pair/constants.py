"""What a pair brings to every call: u1, u2, n, home, and the levers that the hinge turns or leaves, by component."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.evaluation.steps import LEVER_STEPS
from hingepair.numeric.arrays import vectors
from hingepair.numeric.blocks import Values, components_of
from hingepair.numeric.twofold import Twofold
from hingepair.numeric.unit_vectors import by_power_of_two, exact_direction

LEVERS = ("along", "across", "around")


class Constants(NamedTuple):
    """What a pair brings: u1, u2 and n, and home where it is not the identity, by component.

    Attributes:
        values: components by name; floats where the pair is one.
        arrays: the same as arrays, with the components last.
        shape: leading shape of the pair; () for one pair.
    """

    values: Values
    arrays: Values
    shape: tuple[int, ...]

    @property
    def single(self) -> bool:
        """Whether it is one pair."""
        return self.shape == ()


def levers(u1: NDArray[Any], u2: NDArray[Any], n: ArrayLike, home: NDArray[Any]) -> dict[str, NDArray[np.float64]]:
    """The vectors along, across and around of `steps.LEVER_STEPS`, each component rounded once; body-1 axes [m].

    They are computed from the axis as it was given: that at unit length has been rounded.
    """
    lever1, lever2 = components_of(u1), components_of(u2)
    own, exponent2 = by_power_of_two(lever2)
    both, exponent = by_power_of_two((*lever1, *lever2))
    axis = exact_direction(components_of(vectors("n", n, 3).astype(np.float64)))
    rotation = tuple(Twofold(c) for c in components_of(home, 2))
    values: dict[str, Any] = {"u2": tuple(map(Twofold, own)), "n": axis, "home": rotation}
    *of_u2, along = LEVER_STEPS
    for result, function, arguments in of_u2:
        values[result] = function(*[values[name] for name in arguments])
    # Only `along` holds both levers, and the shorter one may vanish beside the longer.
    shift = exponent2 - exponent
    beside = (
        tuple(Twofold(np.ldexp(c.high, shift), np.ldexp(c.low, shift)) for c in values[name])
        for name in along.arguments[1:]
    )
    values["along"] = along.function(tuple(map(Twofold, both[:3])), *beside)
    exponents = {"along": exponent, "across": exponent2, "around": exponent2}
    found = {}
    for name in LEVERS:
        parts = np.broadcast_arrays(*(np.ldexp(c.high, exponents[name]) for c in values[name]))
        found[name] = np.stack(parts, axis=-1)
    return found
