"""Outputs of a computation as functions of arrays of any library, the calls of their derivatives, and products with
Jacobians.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

from hingepair.engine.binding import ArrayShape
from hingepair.engine.calls import Call
from hingepair.numeric.array_libraries import Library
from hingepair.plans.derivatives import Derivative

Arrays: TypeAlias = Sequence[Any]
Functions: TypeAlias = Callable[..., tuple[Any, ...]]
Names: TypeAlias = tuple[str, ...]


class Caller(Protocol):
    """Function that returns the call of a computation's outputs, or of a derivative, whose weights or changes are
    further arguments.
    """

    def __call__(self, derivative: Derivative | None = None, further: Names = ()) -> Call:
        """Return the call."""


class Differentiable:
    """The outputs of a computation as a function of its arguments. An attitude changes by its entries.

    Args:
        call_of: what gives the calls.

    Attributes:
        call: the call of the outputs.
        arguments: shapes of one sample of the arguments.
        outputs: those of the outputs.
    """

    def __init__(self, call_of: Caller) -> None:
        self.call = call_of()
        self.arguments = self.call.argument_shapes
        shapes = dict(self.call.loop.outputs)
        self.outputs = {name: shapes[name] for name in self.call.outputs}
        self.derivative = functools.cache(functools.partial(self._derivative, call_of))

    def _derivative(self, call_of: Caller, kind: str, by: Names) -> Call:
        """Return the call of a derivative by arguments: "jacobian", a matrix for each output; "jvp", whose further
        arguments are changes of the arguments; "vjp", whose are weights of the outputs.
        """
        further: dict[str, Names] = {
            "jvp": tuple(f"change_{name}" for name in by),
            "vjp": tuple(f"weight_{name}" for name in self.outputs),
        }
        shapes = tuple((name, self.arguments[name]) for name in by)
        return call_of(Derivative(kind, tuple(self.outputs), shapes, entries=True), further.get(kind, ()))

    def products(self, by: Names, jacobians: Arrays, vectors: Arrays, transposed: bool = False) -> list[Any]:
        """Return the products of Jacobians (..., components of an output, of all arguments) and changes of arguments,
        one array for each output; or those of their transposes and the weights of outputs, one for each argument.
        Leading axes broadcast.
        """
        arguments, outputs = [self.arguments[name] for name in by], [*self.outputs.values()]
        if transposed:
            rows = [J[..., k, :] for J in jacobians for k in range(J.shape[-2])]
            total = sum(row * x[..., None] for row, x in zip(rows, _components(vectors, outputs), strict=True))
            return split(total, arguments)
        parts = [*_components(vectors, arguments)]
        # matmul of many small matrices is slow
        found = [sum(J[..., k] * x[..., None] for k, x in enumerate(parts)) for J in jacobians]
        return [one.reshape((*one.shape[:-1], *tail)) for one, tail in zip(found, outputs, strict=True)]


def _components(arrays: Arrays, tails: Iterable[ArrayShape]) -> Iterator[Any]:
    """Yield each component of each array, of which the shapes of one sample are `tails`."""
    for one, tail in zip(arrays, tails, strict=True):
        flat = one.reshape((*one.shape[: one.ndim - len(tail)], math.prod(tail)))
        for k in range(math.prod(tail)):
            yield flat[..., k]


def split(array: Any, tails: Iterable[ArrayShape]) -> list[Any]:
    """Return the arrays that stand side by side along the last axis.

    >>> import numpy as np
    >>> [one.shape for one in split(np.zeros((5, 10)), [(), (3, 3)])]
    [(5,), (5, 3, 3)]
    """
    found, start = [], 0
    for tail in tails:
        stop = start + math.prod(tail)
        found.append(array[..., start:stop].reshape((*array.shape[:-1], *tail)))
        start = stop
    return found


def leading_shapes(tails: Mapping[str, ArrayShape], arrays: Arrays) -> dict[str, ArrayShape]:
    """Return the leading shapes of arrays by name, of which the shapes of one sample are given.

    >>> import numpy as np
    >>> leading_shapes({"q": (7,), "dt": ()}, [np.zeros((5, 7)), np.zeros(5)])
    {'q': (5,), 'dt': (5,)}
    """
    return {
        name: tuple(one.shape)[: len(one.shape) - len(tail)]
        for (name, tail), one in zip(tails.items(), arrays, strict=True)
    }


def by_library(call: Call, library: Library, arrays: Arrays) -> tuple[Any, ...]:
    """Return the outputs of a call that an array library itself computes from the equations."""
    shapes = leading_shapes(call.argument_shapes, arrays)
    found = call.run_foreign(dict(zip(shapes, arrays, strict=True)), shapes, library, None, 1)
    return (found,) if call.result is None else tuple(found.arrays().values())
