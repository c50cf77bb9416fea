"""Functions of time: expressions in t with their first and second derivatives, computed at many instants at once.

Derivatives are expressions, too, by the rules of this file. What does not depend on t is a Python float, which the
equations use once and not once per sample.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.symbolic.expressions import SMOOTH_FUNCTIONS, Expression, number, parse_expression

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
        self._expressions = tuple(expressions)
        self._symbols = ("t", *symbols)
        self._rates = _Rates()

    @functools.cached_property
    def _programs(self) -> list[_Program]:
        """Programs of the values, of these with the first and of these with the second derivatives."""
        rows = [self._expressions]
        for _ in range(2):
            rows.append(tuple(map(self._rates.of, rows[-1])))
        return [_Program(sum(rows[: order + 1], ())) for order in range(3)]

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
        flat, count = times.reshape(-1), len(self._expressions)
        rows: list[TimeValue] = []
        for start in range(0, max(1, flat.size), _BLOCK):
            block = slice(start, start + _BLOCK)
            parts = self._programs[order].results(
                {"t": flat[block], **{name: values[block] for name, values in (given or {}).items()}}
            )
            rows = rows or [part if isinstance(part, float) else np.empty(flat.shape) for part in parts]
            for k, (row, part) in enumerate(zip(rows, parts, strict=True)):
                if isinstance(row, np.ndarray):
                    row[block] = np.where(np.isnan(parts[k % count]), np.nan, part)
        shaped = (row if isinstance(row, float) else row.reshape(times.shape) for row in rows)
        values = [row if times.ndim else float(row) for row in shaped]
        return tuple(tuple(values[k * count : (k + 1) * count]) for k in range(order + 1))

    def values(self, *instants_and_values: ArrayLike) -> tuple[TimeValue, ...]:
        """Return the values of the expressions; floats where they are constant.

        Args:
            instants_and_values: the instants t, then the values of each further symbol; arrays of one shape.
        """
        given = dict(zip(self._symbols, map(np.asarray, instants_and_values), strict=True))
        return tuple(self._values_alone.results(given))

    @functools.cached_property
    def _values_alone(self) -> _Program:
        return _Program(self._expressions)

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
            for branches in self._values_alone.branches({"t": t[start : start + _BLOCK + 1]}):
                switched[block] |= np.abs(np.diff(branches)) > 0  # False for NaN
        return switched


class _Program:
    """Operations that compute expressions, each once, with the places of their operands, which come first."""

    def __init__(self, expressions: Sequence[Expression]) -> None:
        self.steps: list[tuple[str, tuple[int, ...]] | float] = []
        self._places: dict[tuple[str, tuple[int, ...]] | float, int] = {}
        self._seen: dict[Expression, int] = {}
        self._results = [self._place(expression) for expression in expressions]

    def _place(self, expression: Expression) -> int:
        """Return the place of an expression among the steps; equal ones have the same."""
        if expression not in self._seen:
            step: tuple[str, tuple[int, ...]] | float
            if expression.constant is not None:
                is_condition = isinstance(expression.constant, bool)
                step = float(2 * expression.constant - 1 if is_condition else expression)
            else:
                step = expression.operation, tuple(map(self._place, expression.parts))
            if step not in self._places:
                self._places[step] = len(self.steps)
                self.steps.append(step)
            self._seen[expression] = self._places[step]
        return self._seen[expression]

    def results(self, given: dict[str, NDArray[np.float64]]) -> list[Any]:
        """Return the values of the expressions: arrays, or floats of constants."""
        values = self._evaluate(given)
        return [values[place] for place in self._results]

    def branches(self, given: dict[str, NDArray[np.float64]]) -> list[Any]:
        """Return samples that change where an operation has a kink or a jump."""
        values = self._evaluate(given)
        kinked = [(*step, i) for i, step in enumerate(self.steps) if isinstance(step, tuple) and step[0] in _BRANCHES]
        with np.errstate(all="ignore"):
            return [_BRANCHES[operation](*(values[place] for place in places)) for operation, places, _ in kinked]

    def _evaluate(self, given: dict[str, NDArray[np.float64]]) -> list[Any]:
        values: list[Any] = []
        with np.errstate(all="ignore"):
            for step in self.steps:
                if isinstance(step, float):
                    values.append(step)
                elif not step[1]:
                    values.append(given[step[0]])
                else:
                    values.append(_FUNCTIONS[step[0]](*(values[place] for place in step[1])))
        return values


# ---- values. A condition is 1 where it holds, -1 where it does not, NaN where it is not known.


def _side(*derivatives: Any) -> Any:
    """Return 1 where a function is at most 0, else -1; with its derivatives, just after t."""
    x, *rates = derivatives
    falls = np.where(rates[0] != 0, np.sign(rates[0]), np.where(rates[1] > 0, 1.0, -1.0)) if rates else -1.0
    return -np.where(x != 0, np.sign(x), falls)


def _where(condition: Any, x: Any, y: Any) -> Any:
    return np.where(condition > 0, x, np.where(condition < 0, y, np.nan))


def _below(*derivatives: Any) -> Any:
    """Return 1 where a function is below 0, else -1; with its derivatives, just after t."""
    return -_side(*(-x for x in derivatives))


_FUNCTIONS: Final[dict[str, Callable[..., Any]]] = {
    **{name: getattr(np, name.replace("a", "arc", 1) if name[0] == "a" else name) for name in SMOOTH_FUNCTIONS},
    "add": np.add,
    "mul": np.multiply,
    "div": np.divide,
    "pow": np.power,
    "abs": np.abs,
    "sign": np.sign,
    "min": lambda *parts: functools.reduce(np.minimum, parts),
    "max": lambda *parts: functools.reduce(np.maximum, parts),
    "mod": np.mod,
    "where": _where,
    "<=": _side,
    "<": _below,
    "not": np.negative,
    "and": lambda *parts: functools.reduce(np.minimum, parts),
    "or": lambda *parts: functools.reduce(np.maximum, parts),
}
_BRANCHES: Final[dict[str, Callable[..., Any]]] = {  # which branch of an operation with kinks holds
    "where": lambda condition, *_: condition,
    "abs": _below,
    "sign": _below,
    "max": lambda *parts: np.argmax(np.broadcast_arrays(*parts), axis=0),
    "min": lambda *parts: np.argmin(np.broadcast_arrays(*parts), axis=0),
    "mod": lambda x, period: np.floor(x / period),
}


# ---- derivatives


class _Rates:
    """Derivatives of expressions by t, each found once."""

    def __init__(self) -> None:
        self._found: dict[Expression, Expression] = {}

    def of(self, x: Expression) -> Expression:
        """Return the derivative of an expression; at a kink that from the right."""
        if x not in self._found:
            self._found[x] = self._differentiate(x)
        return self._found[x]

    def _differentiate(self, x: Expression) -> Expression:  # noqa: PLR0911
        parts = x.parts
        if x.constant is not None or (not parts and x.operation != "t"):
            return _ZERO
        match x.operation:
            case "t":
                return _ONE
            case "add":
                return _sum(*map(self.of, parts))
            case "mul":
                a, b = parts
                return _sum(_product(self.of(a), b), _product(a, self.of(b)))
            case "div":
                return _quotient(_sum(self.of(parts[0]), _negative(_product(x, self.of(parts[1])))), parts[1])
            case "pow":
                return self._of_power(x, *parts)
            case "atan2":
                v, u = parts
                turned = _sum(_product(u, self.of(v)), _negative(_product(v, self.of(u))))
                return _quotient(turned, _sum(_product(u, u), _product(v, v)))
            case "where":
                return _where_after(self._just_after(parts[0]), *map(self.of, parts[1:]))
            case "min" | "max":
                a, b = _halves(x.operation, parts)
                low, high = (a, b) if x.operation == "min" else (b, a)
                a_counts = self._just_after(Expression("<=", (_sum(low, _negative(high)),)))
                return _where_after(a_counts, self.of(a), self.of(b))
            case "abs":
                below = self._just_after(Expression("<", (parts[0],)))
                return _where_after(below, _negative(self.of(parts[0])), self.of(parts[0]))
            case "mod":
                return self.of(parts[0])
            case "sign":
                return _ZERO
        slope = parse_expression("slope", _SLOPES[x.operation], {"x": parts[0], "y": x})
        return _product(slope, self.of(parts[0]))

    def _of_power(self, x: Expression, base: Expression, exponent: Expression) -> Expression:
        if exponent.constant is not None:
            lower = _power(base, number(exponent.constant - 1))
            return _product(number(exponent.constant), _product(lower, self.of(base)))
        log = _log(base)
        return _product(x, _sum(_product(self.of(exponent), log), _product(exponent, self.of(log))))

    def _just_after(self, condition: Expression) -> Expression:
        """Return a condition as it is just after t, from its function and the derivatives of it."""
        if condition.constant is not None:
            return condition
        if condition.operation in {"<", "<="}:
            x = condition.parts[0]
            return Expression(condition.operation, (x, self.of(x), self.of(self.of(x))))
        return Expression(condition.operation, tuple(map(self._just_after, condition.parts)))


_ZERO, _ONE = number(0), number(1)


def _sum(x: Expression, y: Expression) -> Expression:
    if x.constant is not None and y.constant is not None:
        return number(x.constant + y.constant)
    return y if x.constant == 0 else x if y.constant == 0 else Expression("add", (x, y))


def _product(x: Expression, y: Expression) -> Expression:
    """Return a product; one with 0 is 0."""
    if x.constant is not None and y.constant is not None:
        return number(x.constant * y.constant)
    if x.constant == 0 or y.constant == 0:
        return _ZERO
    return y if x.constant == 1 else x if y.constant == 1 else Expression("mul", (x, y))


def _negative(x: Expression) -> Expression:
    return _product(number(-1), x)


def _quotient(x: Expression, y: Expression) -> Expression:
    return _ZERO if x.constant == 0 else Expression("div", (x, y))


def _power(x: Expression, k: Expression) -> Expression:
    return _ONE if k.constant == 0 else x if k.constant == 1 else Expression("pow", (x, k))


def _log(x: Expression) -> Expression:
    return Expression("log", (x,)) if x.constant is None else number(float(np.log(float(x))))


def _where_after(condition: Expression, x: Expression, y: Expression) -> Expression:
    same = x is y or (x.constant is not None and x.constant == y.constant)
    return x if same else Expression("where", (condition, x, y))


def _halves(operation: str, parts: Sequence[Expression]) -> list[Expression]:
    """Return an operation on many parts as two, so that a derivative of many parts is not nested deeply."""
    half = len(parts) // 2
    sides = tuple(parts[:half]), tuple(parts[half:])
    return [side[0] if len(side) == 1 else Expression(operation, side) for side in sides]


_SLOPES: Final = {  # f'(x), from x and y = f(x)
    "sin": "cos(x)",
    "cos": "-sin(x)",
    "tan": "1 + y*y",
    "asin": "1/sqrt((1 - x)*(1 + x))",
    "acos": "-1/sqrt((1 - x)*(1 + x))",
    "atan": "1/(1 + x*x)",
    "sinh": "cosh(x)",
    "cosh": "sinh(x)",
    "tanh": "1/cosh(x)**2",
    "asinh": "1/sqrt(1 + x*x)",
    "acosh": "1/sqrt((x - 1)*(x + 1))",
    "atanh": "1/((1 - x)*(1 + x))",
    "exp": "y",
    "log": "1/x",
    "sqrt": "1/(2*y)",
}
