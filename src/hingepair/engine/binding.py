"""The binding of a loop's inputs: which components are known numbers, constants or arrays.

A component that is the number 0, 1 or -1 becomes part of the program, which folds it away. Other constants are
parameters, so that one program serves all pairs with the same pattern. Arrays are read in place.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

ArrayShape: TypeAlias = tuple[int, ...]
NamedShapes: TypeAlias = tuple[tuple[str, ArrayShape], ...]
ComponentSource: TypeAlias = float | tuple[int, int] | None
"""Source of a component: a known number; (index of an array, component of it); or None, the next constant."""
InputPattern: TypeAlias = tuple[ComponentSource, ...]

FOLDED: Final = {0.0: 0.0, 1.0: 1.0, -1.0: -1.0}  # numbers that vanish from the program; -0.0 becomes 0.0


class BoundConstant(NamedTuple):
    """An input that is equal at all samples, bound once for many calls."""

    value: Any  # a number, a tuple of numbers, or an array
    pattern: InputPattern
    constants: tuple[float, ...]  # components that do not fold


class BoundInputs:
    """The inputs of a loop, divided into known numbers, constants and arrays."""

    def __init__(self) -> None:
        self.sources: list[ComponentSource] = []
        self.constants: list[float] = []
        self.arrays: list[Any] = []  # the last axis holds the components; of another library, single components
        self._places: dict[int, int] = {}  # of components that are arrays, by id

    @property
    def pattern(self) -> InputPattern:
        """The source of each component of each input."""
        return tuple(self.sources)

    def add_number(self, x: float) -> None:
        """Add a component that is a number."""
        known = FOLDED.get(x)
        self.sources.append(known)
        if known is None:
            self.constants.append(float(x))

    def add_component(self, component: Any, array: Any) -> None:
        """Add a component that is an array by itself, kept as `array`, once however often the component comes."""
        if id(component) not in self._places:
            self._places[id(component)] = len(self.arrays)
            self.arrays.append(array)
        self.sources.append((self._places[id(component)], 0))

    def add_array(self, array: NDArray[Any]) -> None:
        """Add an array of components."""
        self.sources += [(len(self.arrays), c) for c in range(array.shape[-1])]
        self.arrays.append(array)


def bind(shapes: NamedShapes, values: Mapping[str, Any], single_samples_vary: bool = False) -> BoundInputs:
    """Return the inputs of a loop, divided into known numbers, constants and arrays.

    Args:
        shapes: names of the inputs, and the shape of one sample of each.
        values: inputs by name: numbers, arrays, or tuples of numbers and arrays.
        single_samples_vary: whether arrays of one sample are arrays, too; else they are constants.
    """
    bound = BoundInputs()
    for name, shape in shapes:
        value, count = values[name], math.prod(shape)
        if isinstance(value, BoundConstant):
            if not single_samples_vary:
                bound.sources += value.pattern
                bound.constants += value.constants
                continue
            value = value.value
        if isinstance(value, np.ndarray):
            if value.size == count and not single_samples_vary:
                bound.sources += [None] * count
                bound.constants += map(float, value.ravel().tolist())
            else:
                for view in component_views(value, shape):
                    bound.add_array(view)
            continue
        for component in value if isinstance(value, tuple) else (value,):
            if not isinstance(component, np.ndarray):
                bound.add_number(float(component))
            elif component.size == 1 and not single_samples_vary:
                bound.sources.append(None)
                bound.constants.append(float(component.item()))
            else:
                bound.add_component(component, component[..., None])
    return bound


def bind_constant(name: str, shape: ArrayShape, value: Any) -> Any:
    """Return an input of one sample as a `BoundConstant`, and one of more samples unchanged."""
    bound = bind(((name, shape),), {name: value})
    return value if bound.arrays else BoundConstant(value, bound.pattern, tuple(bound.constants))


def component_views(array: NDArray[Any], shape: ArrayShape) -> Iterator[NDArray[Any]]:
    """Yield views of an array with the components of one sample along the last axis: one if the strides allow."""
    if not shape:
        yield array[..., None]
    elif len(shape) == 1:
        yield array
    else:
        axis = array.ndim - len(shape)
        try:
            yield np.reshape(array, (*array.shape[:axis], math.prod(shape)), copy=False)
        except ValueError:
            for i in range(shape[0]):
                yield from component_views(array[(slice(None),) * axis + (i,)], shape[1:])
