"""The binding of a loop's inputs: which components are known numbers, constants or arrays.

A component that is the number 0, 1 or -1 becomes part of the program, which folds it away. Other constants are
parameters, so that one program serves all pairs with the same pattern. Arrays are read in place.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

ArrayShape: TypeAlias = tuple[int, ...]
NamedShapes: TypeAlias = tuple[tuple[str, ArrayShape], ...]
ComponentSource: TypeAlias = float | tuple[int, int] | None
"""Source of a component: a known number; (index of an array, component of it); or None, the next constant."""
InputPattern: TypeAlias = tuple[ComponentSource, ...]

FOLDED: Final = {0.0: 0.0, 1.0: 1.0, -1.0: -1.0}  # numbers that vanish from the program; -0.0 becomes 0.0


class Constant(NamedTuple):
    """An input that is equal at all samples, bound once for many calls."""

    sources: InputPattern
    numbers: tuple[float, ...]  # components that do not fold


class Bound(NamedTuple):
    """The inputs of a loop, divided into known numbers, constants and arrays."""

    pattern: InputPattern  # the source of each component of each input
    numbers: list[float]  # constants
    arrays: list[NDArray[Any]]  # the last axes hold the components
    tails: list[ArrayShape]  # shape of one sample of each array


def bind(shapes: NamedShapes, values: Mapping[str, Any]) -> Bound:
    """Return the inputs of a loop, divided into known numbers, constants and arrays.

    Args:
        shapes: names of the inputs, and the shape of one sample of each.
        values: inputs by name: arrays, tuples of numbers and arrays, numbers, or `Constant`s.
    """
    sources: list[ComponentSource] = []
    bound, tails = Bound((), [], [], []), dict(shapes)
    whole = {}  # places of whole arrays, in the order of the values
    for name, value in values.items():
        if name in tails and isinstance(value, np.ndarray):
            whole[name] = len(bound.arrays)
            bound.arrays.append(value)
            bound.tails.append(tails[name])
    places: dict[int, int] = {}  # of components that are arrays, by id: one may come several times
    for name, shape in shapes:
        value = values[name]
        if isinstance(value, Constant):
            sources += value.sources
            bound.numbers.extend(value.numbers)
        elif name in whole:
            sources += [(whole[name], k) for k in range(math.prod(shape))]
        else:
            for component in value if isinstance(value, tuple) else (value,):
                if not isinstance(component, np.ndarray):
                    sources.append(FOLDED.get(component))
                    bound.numbers.extend([float(component)] if sources[-1] is None else [])
                    continue
                if id(component) not in places:
                    places[id(component)] = len(bound.arrays)
                    bound.arrays.append(component)
                    bound.tails.append(())
                sources.append((places[id(component)], 0))
    return bound._replace(pattern=tuple(sources))


def bind_constant(shape: ArrayShape, value: Any, fold: bool = True) -> Any:
    """Return an input of one sample as a `Constant`, and one of more samples unchanged. Numbers fold unless `fold` is
    False; those in arrays are parameters, so that one program serves them all.
    """
    parts = value if isinstance(value, tuple) else (value,)
    if sum(map(np.size, parts)) != math.prod(shape):
        return value
    numbers = [(float(x), isinstance(part, np.ndarray)) for part in parts for x in np.ravel(part).tolist()]
    sources = tuple(None if held or not fold else FOLDED.get(x) for x, held in numbers)
    return Constant(sources, tuple(x for (x, _), source in zip(numbers, sources, strict=True) if source is None))
