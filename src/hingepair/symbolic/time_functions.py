"""Functions of time: expressions in t with their first and second derivatives, computed at many instants at once.

Each operation has a rule for a jet: a value with its first and second derivative by t. A part that occurs several
times is computed once. What does not depend on t is a Python float, which the equations use once and not once per
sample; a product with the float 0.0 is 0.0.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.symbolic.expressions import Expression

TimeValue: TypeAlias = float | NDArray[np.float64]
"""Samples of a function of time, or a float where it is constant."""
TimeDerivatives: TypeAlias = tuple[tuple[TimeValue, ...], ...]
"""Values, first derivatives, and so on; each a tuple with one entry per expression."""

_Jet: TypeAlias = tuple[Any, ...]  # value, first and second derivative, or the value alone
_SideJet: TypeAlias = tuple[Any, Any]  # 1 or -1, or NaN: whether a condition holds at t, and just after t

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
        # Operations with the places of their operands, which come first; a constant is a float.
        self._steps: list[tuple[str, tuple[int, ...]] | float] = []
        self._places: dict[tuple[str, tuple[int, ...]] | float, int] = {}
        self._symbols = ("t", *symbols)
        self._results = [self._place(expression) for expression in expressions]

    def derivatives(self, t: ArrayLike, order: int = 2) -> TimeDerivatives:
        """Return the values and the derivatives up to `order` at the instants t: one tuple for each order, with one
        entry for each expression, an array of t's shape, or a float if it does not depend on t.

        Samples at which an expression has no real value, or no derivative, are NaN; at a kink, derivatives are those
        from the right.

        Args:
            t: instants [s]; shape (...).
            order: order of the highest derivative, at most 2.
        """
        times = np.asarray(t, dtype=np.float64)
        flat = times.reshape(-1)
        rows: list[TimeValue] = []
        for start in range(0, max(1, flat.size), _BLOCK):
            jets, _ = self._evaluate(flat[start : start + _BLOCK], differentiate=order > 0)
            parts = [jets[place][k] for k in range(order + 1) for place in self._results]
            rows = rows or [part if isinstance(part, float) else np.empty(flat.shape) for part in parts]
            for row, part in zip(rows, parts, strict=True):
                if isinstance(row, np.ndarray):
                    row[start : start + _BLOCK] = part
        shaped = (row if isinstance(row, float) else row.reshape(times.shape) for row in rows)
        values = [row if times.ndim else float(row) for row in shaped]
        count = len(self._results)
        return tuple(tuple(values[k * count : (k + 1) * count]) for k in range(order + 1))

    def values(self, *instants_and_values: ArrayLike) -> tuple[TimeValue, ...]:
        """Return the values of the expressions; floats where they are constant.

        Args:
            instants_and_values: the instants t, then the values of each further symbol; arrays of one shape.
        """
        jets, _ = self._evaluate(*map(np.asarray, instants_and_values), differentiate=False)
        return tuple(jets[place][0] for place in self._results)

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
            instants = t[start : start + _BLOCK + 1]
            for sides in self._evaluate(instants)[1]:
                # False for NaN.
                switched[block] |= np.abs(np.diff(np.broadcast_to(sides, instants.shape))) > 0
        return switched

    def _place(self, expression: Expression) -> int:
        """Return the place of an expression among the steps; equal ones have the same."""
        if expression.constant:
            step: tuple[str, tuple[int, ...]] | float = float(expression.constant)
        else:
            step = expression.operation, tuple(self._place(part) for part in expression.parts)
        if step not in self._places:
            self._places[step] = len(self._steps)
            self._steps.append(step)
        return self._places[step]

    def _evaluate(self, *samples: NDArray[np.float64], differentiate: bool = True) -> tuple[list[_Jet], list[Any]]:
        """Return the jets of all steps, and samples that change where an expression has a kink or a jump."""
        given: dict[str, _Jet] = dict(zip(self._symbols, ((sample,) for sample in samples), strict=True))
        if differentiate:
            given["t"] = (samples[0], 1.0, 0.0)
        jets: list[_Jet] = []
        switches: list[Any] = []
        with np.errstate(all="ignore"):
            for step in self._steps:
                if isinstance(step, float):
                    jets.append((step, 0.0, 0.0) if differentiate else (step,))
                    continue
                operation, places = step
                operands = [jets[place] for place in places]
                if not places:
                    jet = given[operation]
                elif operation in _CONDITIONS:
                    jet = _CONDITIONS[operation](*operands)
                elif operation in _KINKED:
                    jet, switch = _KINKED[operation](*operands)
                    switches.append(switch)
                else:
                    jet = _SMOOTH[operation](*operands)
                jets.append(jet)
            for place in self._results if differentiate else ():
                jets[place] = tuple(_real_parts(jets[place]))
        return jets, switches


def _real_parts(jet: _Jet) -> Iterator[Any]:
    """Yield the value and the derivatives, which are NaN where the value is."""
    value, *derivatives = jet
    unknown = np.isnan(value)
    yield value
    for derivative in derivatives:
        yield np.where(unknown, np.nan, derivative) if isinstance(derivative, np.ndarray) else derivative


def _times(a: Any, b: Any) -> Any:
    """Return a * b, 0.0 if one of them does not depend on t and is 0."""
    if (isinstance(a, float) and a == 0) or (isinstance(b, float) and b == 0):
        return 0.0
    return a * b


def _add(*terms: _Jet) -> _Jet:
    if len(terms[0]) == 1:
        return (sum(term[0] for term in terms),)
    return tuple(functools.reduce(_plus, parts) for parts in zip(*terms, strict=True))


def _plus(a: Any, b: Any) -> Any:
    return b if isinstance(a, float) and a == 0 else a if isinstance(b, float) and b == 0 else a + b


def _multiply(*factors: _Jet) -> _Jet:
    return functools.reduce(_product, factors)


def _product(a: _Jet, b: _Jet) -> _Jet:
    value = a[0] * b[0]
    if len(a) == 1:
        return (value,)
    cross = _times(2.0, _times(a[1], b[1]))
    return (
        value,
        _plus(_times(a[1], b[0]), _times(a[0], b[1])),
        _plus(_plus(_times(a[2], b[0]), cross), _times(a[0], b[2])),
    )


def _divide(a: _Jet, b: _Jet) -> _Jet:
    value = a[0] / b[0]
    if len(a) == 1:
        return (value,)
    # From a = value * b.
    first = _plus(a[1], -_times(value, b[1])) / b[0]
    second = _plus(_plus(a[2], -_times(2.0, _times(first, b[1]))), -_times(value, b[2])) / b[0]
    return value, first, second


def _chain(value: Any, slope: Any, bend: Any, x: _Jet) -> _Jet:
    """Return the jet of f(x) from f(x), f'(x) and f''(x)."""
    return value, _times(slope, x[1]), _plus(_times(slope, x[2]), _times(bend, _times(x[1], x[1])))


_Slopes: TypeAlias = Callable[[Any, Any], tuple[Any, Any]]  # f'(x) and f''(x) from x and f(x)


def _function(function: Callable[[Any], Any], slopes: _Slopes) -> Callable[[_Jet], _Jet]:
    """Return a function of jets from a function of one number and its derivatives."""

    def rule(x: _Jet) -> _Jet:
        value = function(x[0])
        return (value,) if len(x) == 1 else _chain(value, *slopes(x[0], value), x)

    return rule


def _arc(radicand: Callable[[Any], Any], sign: float, bend: float) -> _Slopes:
    """Return the derivatives sign / sqrt(radicand) and sign bend x / sqrt(radicand)^3 of an inverse function."""

    def slopes(x: Any, _: Any) -> tuple[Any, Any]:
        slope = 1 / np.sqrt(radicand(x))
        return sign * slope, sign * bend * x * slope**3

    return slopes


def _power(x: _Jet, exponent: _Jet) -> _Jet:
    """Return x**exponent; if the exponent varies, the derivatives are NaN where x is below 0."""
    value = x[0] ** exponent[0]
    if len(x) == 1:
        return (value,)
    k = exponent[0]
    if isinstance(k, float):
        return _chain(value, _times(k, _raised(x[0], k - 1)), _times(k * (k - 1), _raised(x[0], k - 2)), x)
    log = _SMOOTH["log"](x) if isinstance(x[0], np.ndarray) else (float(np.log(x[0])), 0.0, 0.0)
    return _chain(value, value, value, _product(exponent, log))


def _raised(x: Any, k: float) -> Any:
    return 1.0 if k == 0 else x if k == 1 else x**k


def _atan2(y: _Jet, x: _Jet) -> _Jet:
    value = np.arctan2(y[0], x[0])
    if len(x) == 1:
        return (value,)
    # The angle turns at (x y' - y x') / r^2.
    square = _plus(_times(x[0], x[0]), _times(y[0], y[0]))
    first = _plus(_times(x[0], y[1]), -_times(y[0], x[1])) / square
    growth = _times(2.0, _plus(_times(x[0], x[1]), _times(y[0], y[1])))
    second = (_plus(_times(x[0], y[2]), -_times(y[0], x[2])) - _times(first, growth)) / square
    return value, first, second


_SMOOTH: Final[dict[str, Callable[..., _Jet]]] = {  # smooth operations, as functions of jets
    "add": _add,
    "mul": _multiply,
    "div": _divide,
    "pow": _power,
    "atan2": _atan2,
    "sin": _function(np.sin, lambda x, y: (np.cos(x), -y)),
    "cos": _function(np.cos, lambda x, y: (-np.sin(x), -y)),
    "tan": _function(np.tan, lambda _, y: (1 + y * y, 2 * y * (1 + y * y))),
    "asin": _function(np.arcsin, _arc(lambda x: (1 - x) * (1 + x), 1.0, 1.0)),
    "acos": _function(np.arccos, _arc(lambda x: (1 - x) * (1 + x), -1.0, 1.0)),
    "atan": _function(np.arctan, lambda x, _: (1 / (1 + x * x), -2 * x / (1 + x * x) ** 2)),
    "sinh": _function(np.sinh, lambda x, y: (np.cosh(x), y)),
    "cosh": _function(np.cosh, lambda x, y: (np.sinh(x), y)),
    "tanh": _function(np.tanh, lambda x, y: (1 / np.cosh(x) ** 2, -2 * y / np.cosh(x) ** 2)),
    "asinh": _function(np.arcsinh, _arc(lambda x: 1 + x * x, 1.0, -1.0)),
    "acosh": _function(np.arccosh, _arc(lambda x: (x - 1) * (x + 1), 1.0, -1.0)),
    "atanh": _function(np.arctanh, lambda x, _: (1 / ((1 - x) * (1 + x)), 2 * x / ((1 - x) * (1 + x)) ** 2)),
    "exp": _function(np.exp, lambda _, y: (y, y)),
    "log": _function(np.log, lambda x, _: (1 / x, -1 / x**2)),
    "sqrt": _function(np.sqrt, lambda x, y: (0.5 / y, -0.25 / (x * y))),
}


def _side(x: _Jet) -> Any:
    """Return 1 where x is at least 0 just after t, -1 where it is below 0, NaN where it is NaN."""
    if len(x) == 1:
        return np.sign(x[0]) + (x[0] == 0)
    falls = np.where(x[1] != 0, np.sign(x[1]), np.where(x[2] < 0, -1.0, 1.0))
    return np.where(x[0] != 0, np.sign(x[0]), falls)


def _at_least_0(x: _Jet) -> _SideJet:
    now = _side(x[:1])
    return now, now if len(x) == 1 else _side(x)


def _negated(condition: _SideJet) -> _SideJet:
    return -condition[0], -condition[1]


def _joined(function: Callable[[Any, Any], Any]) -> Callable[..., _SideJet]:
    """Return a function that joins conditions by the smallest (and) or the largest (or) of their sides."""

    def rule(*parts: _SideJet) -> _SideJet:
        now, after = (functools.reduce(function, sides) for sides in zip(*parts, strict=True))
        return now, after

    return rule


_CONDITIONS: Final[dict[str, Callable[..., _SideJet]]] = {  # sides of conditions, from jets or from other sides
    "<=": _at_least_0,
    "<": lambda x: _negated(_at_least_0(x)),
    "not": _negated,
    "and": _joined(np.minimum),
    "or": _joined(np.maximum),
}


def _chosen(side: Any, x: Any, y: Any) -> Any:
    """Return x where the side is 1, y where it is -1, else NaN; a float if both are the same one."""
    if isinstance(x, float) and isinstance(y, float) and x == y:
        return x
    return np.where(side > 0, x, np.where(side < 0, y, np.nan))


def _where(condition: _SideJet, x: _Jet, y: _Jet) -> tuple[_Jet, Any]:
    now, after = condition
    value, *derivatives = (_chosen(after if k else now, a, b) for k, (a, b) in enumerate(zip(x, y, strict=True)))
    return (value, *derivatives), after


def _extreme(function: Callable[[Any, Any], Any], sense: float) -> Callable[..., tuple[_Jet, Any]]:
    """Return the operation max (sense 1) or min (sense -1) on jets."""

    def rule(*parts: _Jet) -> tuple[_Jet, Any]:
        if len(parts[0]) == 1:
            return (functools.reduce(function, [part[0] for part in parts]),), 0.0
        switches = []
        best, *rest = parts
        for part in rest:
            side = _side(tuple(sense * (a - b) for a, b in zip(best, part, strict=True)))
            (_, *derivatives), _ = _where((side, side), best, part)
            best = (function(best[0], part[0]), *derivatives)
            switches.append(side)
        return best, functools.reduce(lambda a, b: 2 * a + b, switches)

    return rule


def _absolute(x: _Jet) -> tuple[_Jet, Any]:
    side = 0.0 if len(x) == 1 else _side(x)
    return (np.abs(x[0]), *(_times(side, part) for part in x[1:])), side


def _sign(x: _Jet) -> tuple[_Jet, Any]:
    return (np.sign(x[0]), 0.0, 0.0)[: len(x)], _side(x)


def _remainder(x: _Jet, period: _Jet) -> tuple[_Jet, Any]:
    return (np.mod(x[0], period[0]), *x[1:]), np.floor(x[0] / period[0])


# Operations with kinks and jumps: the jet, and samples that change at them.
_KINKED: Final[dict[str, Callable[..., tuple[_Jet, Any]]]] = {
    "where": _where,
    "max": _extreme(np.maximum, 1.0),
    "min": _extreme(np.minimum, -1.0),
    "abs": _absolute,
    "sign": _sign,
    "mod": _remainder,
}
