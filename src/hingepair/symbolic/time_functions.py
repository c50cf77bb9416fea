"""Functions of time: expressions in t with their first and second derivatives, computed at many instants at once.

Each operation yields its value x, its rate x' and the rate x'' of that, from those of its parts, as far as they are
asked for. What does not depend on t is a Python float, which the equations use once and not once per sample.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.symbolic.expressions import Expression

TimeValue: TypeAlias = float | NDArray[np.float64]
"""Samples of a function of time, or a float where it is constant."""
TimeDerivatives: TypeAlias = tuple[tuple[TimeValue, ...], ...]
"""Values, first derivatives, and so on; each a tuple with one entry per expression."""

_BLOCK = 2_048  # samples that are computed at a time; intermediate results stay in the cache


class TimeFunctions:
    """Expressions in t, evaluated with their derivatives.

    Args:
        expressions: the expressions.
        symbols: names of further symbols in the expressions, for `values`.

    >>> from hingepair.symbolic.expressions import parse_expression
    >>> functions = TimeFunctions([parse_expression("x", text) for text in ("3*t", "t**2 + 1")])
    >>> functions.derivatives(np.array([0.0, 2.0]))
    ((array([0., 6.]), array([1., 5.])), (3.0, array([0., 4.])), (0.0, 2.0))
    """

    def __init__(self, expressions: Sequence[Expression], symbols: Sequence[str] = ()) -> None:
        self._count, self._symbols = len(expressions), ("t", *symbols)
        self._program = _Program(expressions)

    def derivatives(
        self, t: ArrayLike, order: int = 2, given: Mapping[str, NDArray[np.float64]] | None = None
    ) -> TimeDerivatives:
        """Return the values and the derivatives up to `order` at the instants t: one tuple for each order, with one
        entry for each expression, an array of t's shape, or a float if it does not depend on t.

        Samples at which an expression has no real value, or no derivative, are NaN; at a kink, derivatives are those
        from the right.

        Args:
            t: instants [s]; shape (...).
            order: order of the highest derivative, at most 2.
            given: values of further symbols in the expressions, which do not depend on t; shape (N,), as t.
        """
        times = np.asarray(t, dtype=np.float64)
        flat = times.reshape(-1)
        rows: list[list[TimeValue]] = []  # by order
        for start in range(0, max(1, flat.size), _BLOCK):
            block = slice(start, start + _BLOCK)
            known = {name: values[block] for name, values in (given or {}).items()}
            found = [*zip(*self._program.results({"t": flat[block], **known}, order), strict=True)]
            rows = rows or [[x if isinstance(x, float) else np.empty(flat.shape) for x in own] for own in found]
            for own, parts in zip(rows, found, strict=True):
                for row, part, value in zip(own, parts, found[0], strict=True):
                    if isinstance(row, np.ndarray):
                        row[block] = np.where(np.isnan(value), np.nan, part)
        shaped = [[row if isinstance(row, float) else row.reshape(times.shape) for row in own] for own in rows]
        values = [tuple(row if times.ndim else float(row) for row in own) for own in shaped]
        return tuple(values) if values else ((),) * (order + 1)

    def values(self, *instants_and_values: ArrayLike) -> tuple[TimeValue, ...]:
        """Return the values of the expressions; floats where they are constant.

        Args:
            instants_and_values: the instants t, then the values of each further symbol; arrays of one shape.
        """
        given = dict(zip(self._symbols, map(np.asarray, instants_and_values), strict=True))
        return tuple(value for (value,) in self._program.results(given, 0))

    def switches(self, t: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return whether an expression has a kink or a jump between neighbouring instants.

        Args:
            t: instants [s] that increase; shape (N,).

        Returns:
            shape (N - 1,).
        """
        switched = np.zeros(max(0, t.size - 1), dtype=bool)
        for start in range(0, switched.size, _BLOCK):
            block = slice(start, start + _BLOCK)
            for branches in self._program.branches({"t": t[start : start + _BLOCK + 1]}):
                switched[block] |= np.abs(np.diff(branches)) > 0  # False for NaN
        return switched


_Derivatives: TypeAlias = tuple[Any, ...]
"""x, x' and x'', or the first of them. A condition has what it is at t and just after t: 1 where it holds, -1 where
it does not, NaN where it is not known."""


class _Program:
    """Operations that compute expressions, each once, with the places of their operands, which come first."""

    def __init__(self, expressions: Sequence[Expression]) -> None:
        self.steps: list[tuple[str, tuple[int, ...]] | _Derivatives] = []
        self._places: dict[tuple[Any, ...], int] = {}
        self._seen: dict[Expression, int] = {}
        self._results = [self._place(expression) for expression in expressions]
        self._kinked = [step for step in self.steps if step[0] in _BRANCHES]

    def _place(self, expression: Expression) -> int:
        """Return the place of an expression among the steps; equal ones have the same."""
        if expression not in self._seen:
            step: tuple[Any, ...]
            if isinstance(expression.constant, bool):
                step = (2.0 * expression.constant - 1.0,) * 3
            elif expression.constant is not None:
                step = float(expression), 0.0, 0.0
            else:
                step = expression.operation, tuple(map(self._place, expression.parts))
            if step not in self._places:
                self._places[step] = len(self.steps)
                self.steps.append(step)
            self._seen[expression] = self._places[step]
        return self._seen[expression]

    def results(self, given: dict[str, NDArray[np.float64]], order: int) -> list[_Derivatives]:
        """Return the values of the expressions and their derivatives: arrays, or floats of constants."""
        values = self._evaluate(given, order)
        return [values[place][: order + 1] for place in self._results]

    def branches(self, given: dict[str, NDArray[np.float64]]) -> list[Any]:
        """Return samples that change where an operation has a kink or a jump."""
        values = self._evaluate(given, 0)
        with np.errstate(all="ignore"):
            return [_BRANCHES[step[0]](*(values[place][0] for place in step[1])) for step in self._kinked]

    def _evaluate(self, given: dict[str, NDArray[np.float64]], order: int) -> list[_Derivatives]:
        count = 3 if order and self._kinked else order + 1  # what holds just after t is known from x', x''
        values: list[_Derivatives] = []
        with np.errstate(all="ignore"):
            for step in self.steps:
                if isinstance(step[0], float):
                    values.append(step[:count])
                elif not step[1]:
                    values.append((given[step[0]], float(step[0] == "t"), 0.0)[:count])
                else:
                    operation = _OPERATIONS[step[0]](*(values[place] for place in step[1]))
                    values.append(tuple(islice(operation, count)))
        return values


# ---- operations


def _plus(x: Any, y: Any) -> Any:
    return y if isinstance(x, float) and x == 0.0 else x if isinstance(y, float) and y == 0.0 else x + y


def _times(x: Any, y: Any) -> Any:
    """Return a product; one with 0 is 0."""
    for one, other in ((x, y), (y, x)):
        if isinstance(one, float) and one in {0.0, 1.0}:
            return other if one else 0.0
    return x * y


def _add(x: _Derivatives, y: _Derivatives) -> Iterator[Any]:
    yield np.add(x[0], y[0])
    yield from map(_plus, x[1:], y[1:])


def _multiply(x: _Derivatives, y: _Derivatives) -> Iterator[Any]:
    yield np.multiply(x[0], y[0])
    yield _plus(_times(x[1], y[0]), _times(x[0], y[1]))
    yield _plus(_plus(_times(x[2], y[0]), _times(x[0], y[2])), _times(2.0, _times(x[1], y[1])))


def _divide(x: _Derivatives, y: _Derivatives) -> Iterator[Any]:
    value = np.divide(x[0], y[0])
    yield value
    rate = np.divide(_plus(x[1], -_times(value, y[1])), y[0])
    yield rate
    yield np.divide(_plus(x[2], -_plus(_times(2.0, _times(rate, y[1])), _times(value, y[2]))), y[0])


def _along(x: _Derivatives, slope: Any, curve: Any) -> Iterator[Any]:
    """Yield the rates of a function of x with these derivatives."""
    yield _times(slope, x[1])
    yield _plus(_times(slope, x[2]), _times(curve, _times(x[1], x[1])))


def _smooth(function: Callable[[Any], Any], slopes: Callable[[Any, Any], tuple[Any, Any]]) -> Callable[..., Any]:
    def operation(x: _Derivatives) -> Iterator[Any]:
        value = function(x[0])
        yield value
        yield from _along(x, *slopes(x[0], value))

    return operation


def _raise(x: _Derivatives, k: _Derivatives) -> Iterator[Any]:
    """Yield x**k and its rates; those of a varying exponent are those of exp(k log(x))."""
    value = np.power(x[0], k[0])
    yield value
    if isinstance(k[0], float):
        slope, curve = (1.0 if n == 0 else np.power(x[0], n) for n in (k[0] - 1, k[0] - 2))
        yield from _along(x, k[0] * slope, _times(k[0] * (k[0] - 1), curve))
    else:
        log = tuple(islice(_OPERATIONS["log"](x), len(x)))
        yield from _along(tuple(islice(_multiply(k, log), len(x))), value, value)


def _turn(v: _Derivatives, u: _Derivatives) -> Iterator[Any]:
    """Yield atan2(v, u) and its rates."""
    yield np.arctan2(v[0], u[0])
    square = v[0] * v[0] + u[0] * u[0]
    rate = _plus(_times(u[0], v[1]), -_times(v[0], u[1])) / square
    yield rate
    stretch = _times(2.0, _plus(_times(u[0], u[1]), _times(v[0], v[1])))
    yield _plus(_plus(_times(u[0], v[2]), -_times(v[0], u[2])), -_times(rate, stretch)) / square


def _side(*derivatives: Any) -> Any:
    """Return 1 where a function is at most 0, else -1; with its derivatives, just after t."""
    x, *rates = derivatives
    falls = np.where(rates[0] != 0, np.sign(rates[0]), np.where(rates[1] > 0, 1.0, -1.0)) if rates else -1.0
    return -np.where(x != 0, np.sign(x), falls)


def _below(*derivatives: Any) -> Any:
    """Return 1 where a function is below 0, else -1; with its derivatives, just after t."""
    return -_side(*(-x for x in derivatives))


def _holds(side: Callable[..., Any], x: _Derivatives) -> _Derivatives:
    return (side(x[0]), side(*x))[: len(x)]


def _where(condition: _Derivatives, x: _Derivatives, y: _Derivatives) -> Iterator[Any]:
    for place, (one, other) in enumerate(zip(x, y, strict=True)):
        holds = condition[min(place, 1)]
        is_same = isinstance(one, float) and isinstance(other, float) and one == other
        yield one if is_same else np.where(holds > 0, one, np.where(holds < 0, other, np.nan))


def _extreme(function: Callable[[Any, Any], Any], sign: float) -> Callable[..., Any]:
    def of_two(x: _Derivatives, y: _Derivatives) -> _Derivatives:
        value = function(x[0], y[0])
        if len(x) == 1:
            return (value,)
        first_counts = _side(*(sign * (one - other) for one, other in zip(x, y, strict=True)))
        return value, *_where((first_counts,) * 2, x[1:], y[1:])

    return lambda *parts: functools.reduce(of_two, parts)


def _combine(function: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    """Return an operation on conditions."""
    return lambda *parts: (functools.reduce(function, sides) for sides in zip(*parts, strict=False))


def _of_root(s: Any, x: Any) -> tuple[Any, Any]:
    """Return the slopes s = 1/sqrt(...) of an inverse function, and x s^3."""
    return s, x * s * s * s


_SLOPES: Final[dict[str, Callable[[Any, Any], tuple[Any, Any]]]] = {  # f'(x) and f''(x), from x and y = f(x)
    "sin": lambda x, y: (np.cos(x), -y),
    "cos": lambda x, y: (-np.sin(x), -y),
    "tan": lambda _, y: (1 + y * y, 2 * y * (1 + y * y)),
    "asin": lambda x, _: _of_root(1 / np.sqrt((1 - x) * (1 + x)), x),
    "acos": lambda x, _: _of_root(-1 / np.sqrt((1 - x) * (1 + x)), x),
    "atan": lambda x, _: (1 / (1 + x * x), -2 * x / (1 + x * x) ** 2),
    "sinh": lambda x, y: (np.cosh(x), y),
    "cosh": lambda x, y: (np.sinh(x), y),
    "tanh": lambda x, y: (1 / np.cosh(x) ** 2, -2 * y / np.cosh(x) ** 2),
    "asinh": lambda x, _: _of_root(1 / np.sqrt(1 + x * x), -x),
    "acosh": lambda x, _: _of_root(1 / np.sqrt((x - 1) * (x + 1)), -x),
    "atanh": lambda x, _: (1 / ((1 - x) * (1 + x)), 2 * x / ((1 - x) * (1 + x)) ** 2),
    "exp": lambda _, y: (y, y),
    "log": lambda x, _: (1 / x, -1 / (x * x)),
    "sqrt": lambda x, y: (1 / (2 * y), -1 / (4 * x * y)),
}
_UFUNCS: Final = {name: getattr(np, name.replace("a", "arc", 1) if name[0] == "a" else name) for name in _SLOPES}
_OPERATIONS: Final[dict[str, Callable[..., Any]]] = {
    **{name: _smooth(_UFUNCS[name], slopes) for name, slopes in _SLOPES.items()},
    "add": _add,
    "mul": _multiply,
    "div": _divide,
    "pow": _raise,
    "atan2": _turn,
    "where": _where,
    "min": _extreme(np.minimum, 1.0),
    "max": _extreme(np.maximum, -1.0),
    "abs": lambda x: _where(_holds(_below, x), tuple(-rate for rate in x), x),
    "sign": lambda x: (np.sign(x[0]), 0.0, 0.0),
    "mod": lambda x, period: (np.mod(x[0], period[0]), *x[1:]),
    "<=": functools.partial(_holds, _side),
    "<": functools.partial(_holds, _below),
    "not": lambda x: map(np.negative, x),
    "and": _combine(np.minimum),
    "or": _combine(np.maximum),
}
_BRANCHES: Final[dict[str, Callable[..., Any]]] = {  # which branch of an operation with kinks holds
    "where": lambda condition, *_: condition,
    "abs": _below,
    "sign": _below,
    "max": lambda *parts: np.argmax(np.broadcast_arrays(*parts), axis=0),
    "min": lambda *parts: np.argmin(np.broadcast_arrays(*parts), axis=0),
    "mod": lambda x, period: np.floor(x / period),
}
