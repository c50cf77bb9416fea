"""Bounds on rounding errors: a program runs over numbers that carry a bound on theirs (`numeric.bounded`)."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from hingepair.engine.binding import FOLDED, ArrayShape
from hingepair.numeric.arrays import Float64Array, broadcast_shape, result_dtype
from hingepair.numeric.blocks import Components, Named, components, components_of, tabulate
from hingepair.numeric.bounded import Bounded, bounded_class, conversion_error
from hingepair.plans.arguments import Arguments


class Known(NamedTuple):
    """Components of an input that is no argument, and bounds on their errors."""

    values: Components
    errors: Components


def output_bounds(
    compute: Callable[[Mapping[str, Any]], Mapping[str, Any]],
    arguments: Arguments,
    inputs: Mapping[str, ArrayShape],
    known: Mapping[str, Any],
    parts: Mapping[str, int],
) -> dict[str, Float64Array]:
    """Return the largest bound on the errors of each output's components, for every sample.

    Args:
        compute: the program: from values by name to outputs by name, scalars or tuples of components.
        arguments: the checked arguments. Bounds are those of computing in their dtype.
        inputs: shape of one sample of each input that the program needs.
        known: the other inputs: exact arrays or tuples, or a `Known`.
        parts: by output, how many bounds each sample has, such as one for each frame; 0 for a single one, without an
            axis for it.
    """
    given = arguments.values
    number_type = bounded_class(result_dtype(part for value in given.values() for part in components(value)))
    groups: dict[str, Any] = {}
    for name, tail in inputs.items():
        value = given[name] if name in given else known[name]
        if isinstance(value, Known):
            groups[name], groups[f"{name} error"] = value
        else:
            groups[name] = value if isinstance(value, tuple) or not tail else _components(np.asarray(value), tail)
            errors = tuple(map(conversion_error, components(groups[name])))
            groups[f"{name} error"] = errors if isinstance(groups[name], tuple) else errors[0]

    def bounds(block: Named) -> Mapping[str, Any]:
        values = {name: _bounded(block[name], block[f"{name} error"], number_type) for name in inputs}
        found = compute(values)
        return {name: _largest(found[name], count) for name, count in parts.items()}

    tails = {name: (count,) if count else () for name, count in parts.items()}
    return tabulate(bounds, groups, tails, broadcast_shape(arguments.shapes), np.dtype(np.float64))


def _components(array: Any, tail: ArrayShape) -> Components:
    """Return the components of arrays of samples; those of one sample of doubles as numbers."""
    axes = array.ndim - len(tail)
    if not axes and array.dtype.char == "d":
        return tuple(array.ravel().tolist())
    return components_of(array.reshape(*array.shape[:axes], math.prod(tail)))


def _bounded(quantity: Any, error: Any, number_type: type[Bounded]) -> Any:
    """Return a number, or the components of a vector, with bounds on their errors; 0, 1 and -1 as they are, if they
    are exact, since programs fold them.
    """
    if isinstance(quantity, tuple):
        return tuple(_bounded(*one, number_type) for one in zip(quantity, error, strict=True))
    if type(quantity) is float and type(error) is float and error == 0 and quantity in FOLDED:
        return quantity + 0.0
    return number_type.rounded(quantity, error)


def _largest(quantity: Any, count: int) -> Any:
    """Return the largest bound of components, or of each of `count` parts of them; plain numbers are exact."""
    errors = [c.error if isinstance(c, Bounded) else 0.0 for c in components(quantity)]
    if not count:
        return functools.reduce(np.maximum, errors, 0.0)
    size = len(errors) // count
    return tuple(functools.reduce(np.maximum, errors[k * size : (k + 1) * size]) for k in range(count))
