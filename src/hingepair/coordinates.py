"""Coordinates as functions of time: SymPy expressions in t, differentiated exactly, evaluated by NumPy.

What does not depend on t comes out as a Python float, which the equations take once and not once per sample.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError
from hingepair.expression_size import MAX_BITS, bits

Expr: TypeAlias = Any  # a sympy.Expr; SymPy carries no types
Value: TypeAlias = float | NDArray[np.float64]
Coordinates: TypeAlias = tuple[tuple[Value, ...], ...]

_BLOCK = 8192  # samples at a time: the intermediate results stay in the cache
_EXACT = 2**53  # integers below are floats without rounding
_COMPILED = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
    *("asinh", "acosh", "atanh", "exp", "log", "Abs", "sign", "Heaviside", "DiracDelta"),
)


def time_symbol() -> Expr:
    """The SymPy symbol t of every expression: real."""
    import sympy

    return sympy.Symbol("t", real=True)


def exact(value: float) -> Expr:
    """The rational number that the shortest decimal form of a finite number writes: 0.1 is 1/10."""
    from fractions import Fraction

    import sympy

    fraction = Fraction(repr(value if isinstance(value, int) else float(value)))
    return sympy.Rational(fraction.numerator, fraction.denominator)


def constant_value(expr: Expr) -> float:
    """The float nearest to an expression without t; not finite where there is none."""
    if expr.is_Rational:
        try:
            return int(expr.p) / int(expr.q)
        except OverflowError:
            return math.inf
    number = expr.evalf(30)
    return float(number) if number.is_Float else math.nan


def derivatives(name: str, expr: Expr, order: int = 2) -> tuple[Expr, ...]:
    """An expression in t and its derivatives up to an order, exact.

    Args:
        name: of the expression, for messages.
        expr: SymPy expression in `time_symbol()`.
        order: of the highest derivative.

    Raises:
        ArgumentError: the expression or a derivative is not real, or holds a number that is no finite float.

    >>> t = time_symbol()
    >>> derivatives("x", t**3 / 2)
    (t**3/2, 3*t**2/2, 3*t)
    """
    found, fault = _differentiate(expr, order)
    if fault:
        raise ArgumentError(name, "finite real values and derivatives", fault)
    return found


def compile_coordinates(expressions: Sequence[Expr], order: int = 2) -> Callable[[ArrayLike], Coordinates]:
    """Compile expressions in t and their derivatives into one function of t.

    The function maps t, shape (...) [s], to a tuple (values, first derivatives, ...) of `order + 1` tuples with one
    entry per expression: an array of t's shape, or a Python float for what does not depend on t. Samples where an
    expression has no real value, or no derivative, are NaN.

    Args:
        expressions: SymPy expressions in `time_symbol()`.
        order: of the highest derivative.

    Raises:
        ArgumentError: an expression or a derivative is not real and finite; see `derivatives`.

    >>> t = time_symbol()
    >>> compile_coordinates([3 * t, t**2 + 1])(np.array([0.0, 2.0]))
    ((array([0., 6.]), array([1., 5.])), (3.0, array([0., 4.])), (0.0, 2.0))
    """
    by_expression = [derivatives(f"expressions[{i}]", expr, order) for i, expr in enumerate(expressions)]
    flat = [by_expression[i][k] for k in range(order + 1) for i in range(len(expressions))]
    varying = [expr for expr in flat if expr.free_symbols]
    constants = [None if expr.free_symbols else constant_value(expr) for expr in flat]
    function = _lambdify(varying)

    def evaluate(t: ArrayLike) -> Coordinates:
        times = np.asarray(t, dtype=np.float64)
        arrays = iter(_sample(function, len(varying), times))
        values = iter([next(arrays) if constant is None else constant for constant in constants])
        return tuple(tuple(itertools.islice(values, len(expressions))) for _ in range(order + 1))

    return evaluate


@functools.lru_cache(maxsize=32)
def _differentiate(expr: Expr, order: int) -> tuple[tuple[Expr, ...], str | None]:
    """An expression with its derivatives, and what is wrong with them."""
    found = [expr]
    for _ in range(order):
        found.append(found[-1].diff(time_symbol()))
    for derivative, label in zip(found, ("", " in the first derivative", " in the second derivative"), strict=False):
        fault = _fault(derivative)
        if fault:
            return tuple(found), fault + label
    return tuple(found), None


def _fault(expr: Expr) -> str | None:
    """Why NumPy cannot evaluate an expression in real numbers; None where it can."""
    import sympy

    if expr.has(sympy.I, sympy.nan, sympy.zoo, sympy.oo, -sympy.oo):
        return "an imaginary or infinite part"
    for number in expr.atoms(sympy.Rational):
        if bits(number) > MAX_BITS or not math.isfinite(constant_value(number)):
            return "a number past the range of floats"
    for power in expr.atoms(sympy.Pow):
        if power.base.is_Number and power.base.is_negative and not power.exp.is_integer:
            return f"a power of the negative number {power.base}"
    for function in expr.atoms(sympy.Function, sympy.Derivative, sympy.Subs, sympy.Piecewise):
        if type(function).__name__ not in _COMPILED:
            return f"{type(function).__name__}(...)"
    if not expr.free_symbols and not math.isfinite(constant_value(expr)):
        return "a value that is no finite number"
    return None


def _lambdify(expressions: list[Expr]) -> Callable[[NDArray[np.float64]], Sequence[Any]]:
    import sympy

    def shared(parts: list[Expr]) -> Any:
        return sympy.cse(parts, order="none", list=False)

    numeric = {"sign": _sign, "Heaviside": _heaviside, "DiracDelta": _dirac}
    function: Callable[[NDArray[np.float64]], Sequence[Any]] = sympy.lambdify(
        time_symbol(), expressions, [numeric, "numpy"], _printer(numeric), cse=shared, docstring_limit=0
    )
    return function


def _printer(numeric: dict[str, Any]) -> Any:
    """SymPy's printer of NumPy code, with large integers as floats: NumPy takes no sine of a Python int >= 2^63."""
    from sympy.printing.numpy import NumPyPrinter

    names = {name: name for name in numeric}
    printer = NumPyPrinter({
        "fully_qualified_modules": False, "inline": True, "allow_unknown_functions": True, "user_functions": names,
    })  # fmt: skip
    printer._print_Integer = lambda n: str(n.p) if abs(n.p) < _EXACT else f"({constant_value(n)!r})"
    return printer


def _sample(function: Callable[..., Sequence[Any]], count: int, times: NDArray[np.float64]) -> Iterator[Value]:
    """The values of a compiled function, block by block; floats for a single time."""
    t = times.reshape(-1)
    rows = [np.empty(t.shape) for _ in range(count)]
    with np.errstate(all="ignore"):
        for start in range(0, t.size if rows else 0, _BLOCK):
            block = slice(start, start + _BLOCK)
            for row, values in zip(rows, function(t[block]), strict=True):
                row[block] = np.nan if np.iscomplexobj(values) else values
    return (float(row[0]) if times.ndim == 0 else row.reshape(times.shape) for row in rows)


def _sign(x: Value) -> Value:
    """The derivative of |x|, x / |x|: NaN at the kink, where there is none."""
    return x / np.abs(x)


def _heaviside(x: Value) -> Value:
    return (_sign(x) + 1) / 2


def _dirac(x: Value) -> Value:
    """The derivative of a step: 0, and NaN at the step, where there is none."""
    return np.where(x == 0, np.nan, 0.0)
