"""The binding of a loop's inputs: which components are known numbers, constants or arrays.

A component that is the number 0, 1 or -1 becomes part of the program, which folds it away. Other constants are
run-time parameters, so that one program serves all pairs with the same pattern. Arrays are read in place.
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

_FOLDED: Final = {0.0: 0.0, 1.0: 1.0, -1.0: -1.0}  # numbers that become part of the program, which folds them away


class BoundInputs(NamedTuple):
    """The inputs of a loop, divided into known numbers, constants and arrays. `pattern` holds the source of each
    component: a known number, a pair (index of an array, index of the component in the array), or None for the next
    constant. `constants` holds the other numbers that are equal at all samples, and `arrays` the arrays that vary by
    sample.

    Attributes:
        pattern: the source of each component of each input.
        constants: numbers that are the same at all samples.
        arrays: arrays of the components that vary from sample to sample; the last axis holds the components.
    """

    pattern: InputPattern
    constants: list[float]
    arrays: list[NDArray[Any]]


class BoundConstant(NamedTuple):
    """An input that is equal at all samples: its value, its pattern (the source of each component) and its constants
    (all components except the numbers 0, 1 and -1, which fold). The input is bound once and serves many calls.

    Attributes:
        value: the input itself: a number, a tuple of numbers, or an array.
        pattern: the source of each component.
        constants: the components that are not among the folded numbers.
    """

    value: Any
    pattern: InputPattern
    constants: tuple[float, ...]


def bind_constant(name: str, sample_shape: ArrayShape, value: Any) -> Any:
    """Return an input of one sample as a `BoundConstant`; return an input of more than one sample unchanged. `value`
    is a number, an array or a tuple of them, and `sample_shape` is the shape of one sample.
    """
    bound = bind(((name, sample_shape),), {name: value})
    return value if bound.arrays else BoundConstant(value, bound.pattern, tuple(bound.constants))


def bind(
    input_shapes: NamedShapes,
    values: Mapping[str, Any],
    carried_names: frozenset[str] = frozenset(),
    keep_single_samples: bool = False,
) -> BoundInputs:
    """Divide the inputs of a loop into known numbers, constants and arrays that vary by sample, and return them as
    `BoundInputs`. input_shapes holds pairs (name, shape of one sample), and `values` is a dictionary of numbers,
    arrays or tuples of them by name. carried_names are the names of the inputs that a scan carries from sample to
    sample; these inputs must be arrays. Arrays of one sample become constants unless keep_single_samples is true.

    Args:
        input_shapes: names of the inputs, and the shape of one sample of each.
        values: inputs by name: numbers, arrays, or tuples of numbers and arrays.
        carried_names: names of the inputs that a scan carries, which are arrays of shape (*chains, *one sample).
        keep_single_samples: whether arrays of one sample count as varying, too; else they are constants.
    """
    pattern: list[ComponentSource] = []
    constants: list[float] = []
    arrays: list[NDArray[Any]] = []
    array_index_by_id: dict[int, int] = {}

    def bind_number(x: float) -> None:
        """Append a component that is the number x to the lists of `bind`. The pattern gets the numbers 0, 1 and -1;
        for any other number, the pattern gets None and the constants get the number.
        """
        known = _FOLDED.get(x)
        pattern.append(known)
        if known is None:
            constants.append(x)

    for name, sample_shape in input_shapes:
        value, count = values[name], math.prod(sample_shape)
        if isinstance(value, BoundConstant):
            if not keep_single_samples:
                pattern += value.pattern
                constants += value.constants
                continue
            value = value.value
        if name in carried_names:
            pattern.extend((len(arrays), c) for c in range(count))
            arrays.append(value.reshape(*value.shape[: value.ndim - len(sample_shape)], 1, count))
            continue
        if isinstance(value, np.ndarray):
            if value.size == count and not keep_single_samples:
                pattern.extend((None,) * count)
                constants.extend(map(float, value.ravel().tolist()))
                continue
            for part in component_views(value, sample_shape):
                pattern.extend((len(arrays), c) for c in range(part.shape[-1]))
                arrays.append(part)
            continue
        for component in value if isinstance(value, tuple) else (value,):
            if not isinstance(component, np.ndarray):
                bind_number(float(component))
            elif component.size == 1 and not keep_single_samples:
                pattern.append(None)
                constants.append(float(component.item()))
            else:
                if id(component) not in array_index_by_id:
                    array_index_by_id[id(component)] = len(arrays)
                    arrays.append(component[..., None])
                pattern.append((array_index_by_id[id(component)], 0))
    return BoundInputs(tuple(pattern), constants, arrays)


def bind_foreign(input_shapes: NamedShapes, values: Mapping[str, Any]) -> tuple[InputPattern, list[float], list[Any]]:
    """Divide inputs by the rules of `bind`, and return the tuple (pattern, constants, arrays), in which each array is
    one component. `values` is a dictionary of the inputs by name: numbers and arrays of another library, or tuples of
    them for vectors. input_shapes holds pairs (name, shape of one sample).

    Returns:
        The pattern, the constants, and the arrays, each of which is one component.
    """
    pattern: list[ComponentSource] = []
    constants: list[float] = []
    arrays: list[Any] = []
    array_index_by_id: dict[int, int] = {}
    for name, sample_shape in input_shapes:
        for component in values[name] if sample_shape else (values[name],):
            if not isinstance(component, float | int):
                if id(component) not in array_index_by_id:
                    array_index_by_id[id(component)] = len(arrays)
                    arrays.append(component)
                pattern.append((array_index_by_id[id(component)], 0))
                continue
            known = _FOLDED.get(component)
            pattern.append(known)
            if known is None:
                constants.append(float(component))
    return tuple(pattern), constants, arrays


def component_views(array: NDArray[Any], sample_shape: ArrayShape) -> Iterator[NDArray[Any]]:
    """Yield views of an array in which the last axis holds the components of one sample. One view holds all
    components if the strides allow that; otherwise several views follow each other. If `sample_shape` is (), the view
    has an additional last axis of length 1.
    """
    if not sample_shape:
        yield array[..., None]
    elif len(sample_shape) == 1:
        yield array
    else:
        axis = array.ndim - len(sample_shape)
        try:
            yield np.reshape(array, (*array.shape[:axis], math.prod(sample_shape)), copy=False)
        except ValueError:
            for i in range(sample_shape[0]):
                yield from component_views(array[(slice(None),) * axis + (i,)], sample_shape[1:])
