"""Coordinates as functions of time: SymPy expressions in t, differentiated exactly, evaluated by NumPy.

What does not depend on t comes out as a Python float, which the equations take once and not once per sample.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError
from hingepair.symbolic.jets import SYMPY_ERRORS, Expr, Jet, JetProgram, NotRealError, constant_value, time_symbol

Value: TypeAlias = float | NDArray[np.float64]
Coordinates: TypeAlias = tuple[tuple[Value, ...], ...]

_BLOCK = 2048  # samples at a time: the intermediate results stay in the cache
_EXACT = 2**53  # integers below are floats without rounding


def exact(value: float) -> Expr:
    """The rational number that the shortest decimal form of a finite number writes: 0.1 is 1/10."""
    from fractions import Fraction

    import sympy

    fraction = Fraction(repr(value if isinstance(value, int) else float(value)))
    return sympy.Rational(fraction.numerator, fraction.denominator)


def check_real(names: Sequence[str], expressions: Sequence[Expr]) -> None:
    """Check that expressions in t and their derivatives are real and finite, as far as they do not depend on t.

    Raises:
        ArgumentError: one is not; names it.
    """
    for name, fault in zip(names, _jets(tuple(expressions))[2], strict=True):
        if fault:
            raise ArgumentError(name, "an expression with finite real values and derivatives", fault)


def compile_coordinates(expressions: Sequence[Expr], order: int = 2) -> Callable[[ArrayLike], Coordinates]:
    """Compile expressions in t and their derivatives into one function of t.

    The function maps t, shape (...) [s], to a tuple (values, first derivatives, ...) of `order + 1` tuples with one
    entry per expression: an array of t's shape, or a Python float for what does not depend on t. Samples where an
    expression has no real value, or no derivative, are NaN.

    Args:
        expressions: SymPy expressions in `time_symbol()`.
        order: of the highest derivative, at most 2.

    Raises:
        ArgumentError: an expression or a derivative is not real and finite.

    >>> t = time_symbol()
    >>> compile_coordinates([3 * t, t**2 + 1])(np.array([0.0, 2.0]))
    ((array([0., 6.]), array([1., 5.])), (3.0, array([0., 4.])), (0.0, 2.0))
    """
    check_real([f"expressions[{i}]" for i in range(len(expressions))], expressions)
    program, jets, _ = _jets(tuple(expressions))
    flat = [jet[k] for k in range(order + 1) for jet in jets]
    constants = [program.value(expr) for expr in flat]
    varying = [expr for expr, constant in zip(flat, constants, strict=True) if constant is None]
    function = _lambdify(program, varying)

    def evaluate(t: ArrayLike) -> Coordinates:
        times = np.asarray(t, dtype=np.float64)
        arrays = iter(_sample(function, len(varying), times))
        values = iter([next(arrays) if constant is None else constant for constant in constants])
        return tuple(tuple(itertools.islice(values, len(expressions))) for _ in range(order + 1))

    return evaluate


@functools.lru_cache(maxsize=8)
def _jets(expressions: tuple[Expr, ...]) -> tuple[JetProgram, tuple[Jet, ...], tuple[str | None, ...]]:
    """The steps to the expressions with their derivatives, and what is wrong with each."""
    program = JetProgram()
    jets: list[Jet] = []
    faults: list[str | None] = []
    for expr in expressions:
        fault, jet = None, (expr, expr, expr)
        try:
            jet = program.jet(expr)
        except NotRealError as error:
            fault = str(error)
        except SYMPY_ERRORS:
            fault = "one that SymPy cannot differentiate"
        jets.append(jet)
        faults.append(fault)
    return program, tuple(jets), tuple(faults)


def _lambdify(program: JetProgram, results: list[Expr]) -> Callable[[NDArray[np.float64]], Sequence[Any]]:
    import sympy

    numeric = {"sign": _sign, "Heaviside": _heaviside, "DiracDelta": _dirac, "float64": np.float64}
    steps = program.needed(results)
    function: Callable[[NDArray[np.float64]], Sequence[Any]] = sympy.lambdify(
        time_symbol(),
        results,
        [numeric, "numpy"],
        _printer(numeric),
        cse=lambda parts: (steps, parts),
        docstring_limit=0,
    )
    return function


def _printer(numeric: dict[str, Any]) -> Any:
    """SymPy's printer of NumPy code, with what is constant as its nearest float.

    As a NumPy float it overflows to inf, where a Python number raises or, as a large integer, has no sine.
    """
    import sympy
    from sympy.printing.numpy import NumPyPrinter

    names = {name: name for name in numeric}
    printer = NumPyPrinter({
        "fully_qualified_modules": False, "inline": True, "allow_unknown_functions": True, "user_functions": names,
    })  # fmt: skip
    usual = printer._print

    def printed(expr: Any, **settings: Any) -> Any:
        if isinstance(expr, sympy.Expr) and not expr.free_symbols:
            small = expr.is_Rational and max(abs(expr.p), expr.q) < _EXACT
            if not small:
                return f"float64({constant_value(expr)!r})"
        return usual(expr, **settings)

    printer._print = printed
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
