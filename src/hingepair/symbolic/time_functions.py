"""Functions of time: expressions in t with their exact derivatives, compiled to NumPy.

A result that does not depend on t is a Python float, which the equations use once and not once per sample.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any, TypeAlias

import numpy as np
import sympy
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError
from hingepair.symbolic.jets import (
    SYMPY_ERROR_TYPES,
    DerivativeProgram,
    NotRealError,
    ValueAndDerivatives,
    time_symbol,
)
from hingepair.symbolic.kinks import Expr
from hingepair.symbolic.printers import NumPySourcePrinter

TimeValue: TypeAlias = float | NDArray[np.float64]
"""Samples of a function of time, or a float where it is constant."""
TimeDerivatives: TypeAlias = tuple[tuple[TimeValue, ...], ...]
"""Values, first derivatives, and so on; each a tuple with one entry per expression."""

_SAMPLES_PER_EVALUATION_BLOCK = 2048  # samples that are computed at a time; intermediate results stay in the cache


class TimeFunctions:
    """Expressions in t, compiled to NumPy functions: the method `derivatives` computes their values and their exact
    first and second derivatives, and `values` their values alone, also at values of further symbols.

    Args:
        expressions: SymPy expressions in `time_symbol()`.
        names: names of the expressions, for messages.
        symbols: names of further symbols in the expressions, for `values`.

    Raises:
        ArgumentError: an expression or a derivative is not real and finite for any t. The message names it.

    >>> t = time_symbol()
    >>> functions = TimeFunctions([3 * t, t**2 + 1])
    >>> functions.derivatives(np.array([0.0, 2.0]))
    ((array([0., 6.]), array([1., 5.])), (3.0, array([0., 4.])), (0.0, 2.0))
    """

    def __init__(self, expressions: Sequence[Expr], names: Sequence[str] = (), symbols: Sequence[str] = ()) -> None:
        self._symbols = (time_symbol(), *(sympy.Symbol(symbol, real=True) for symbol in symbols))
        self._program = DerivativeProgram()
        self._derivatives: list[ValueAndDerivatives] = []
        self._compiled = functools.cache(self._compile)
        expected = "an expression with finite real values and derivatives"
        for i, expr in enumerate(expressions):
            name = names[i] if names else f"expressions[{i}]"
            try:
                self._derivatives.append(self._program.value_and_derivatives(expr))
            except NotRealError as error:
                raise ArgumentError(name, expected, str(error)) from None
            except SYMPY_ERROR_TYPES:
                raise ArgumentError(name, expected, "one that SymPy cannot differentiate") from None

    def derivatives(self, t: ArrayLike, order: int = 2) -> TimeDerivatives:
        """Return a tuple of the values and the derivatives up to `order` at the instants t. It has one tuple for each
        order, with one entry for each expression; an entry is an array of t's shape, or a float if it does not depend
        on t.

        Samples at which an expression has no real value, or no derivative, are NaN; at a kink, derivatives are those
        from the right.

        Args:
            t: instants [s]; shape (...).
            order: order of the highest derivative, at most 2.
        """
        times, count = np.asarray(t, dtype=np.float64), len(self._derivatives)
        rows = self._sample([row[k] for k in range(order + 1) for row in self._derivatives], times.reshape(-1))
        arrays = (row if isinstance(row, float) else row.reshape(times.shape) for row in rows)
        values = [array if times.ndim else float(array) for array in arrays]
        return tuple(tuple(values[k * count : (k + 1) * count]) for k in range(order + 1))

    def values(self, *instants_and_values: NDArray[np.float64]) -> tuple[TimeValue, ...]:
        """Return a tuple of the values of the expressions. The arguments are arrays of one shape: the instants t, and
        then the values of each further symbol. Constant expressions give floats, and complex results give NaN.
        """
        function = self._compiled(tuple(value for value, _, _ in self._derivatives))
        with np.errstate(all="ignore"):
            return tuple(np.nan if np.iscomplexobj(value) else value for value in function(*instants_and_values))

    def switches(self, t: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Return a boolean array of shape (N - 1,) for increasing instants t [s] of shape (N,). An element is True if
        an expression has a kink or a jump between the two neighbouring instants.
        """
        switched = np.zeros(max(0, t.size - 1), dtype=bool)
        for sides in self._sample(self._program.switches, t):
            switched |= np.abs(np.diff(np.broadcast_to(sides, t.shape))) > 0  # False for NaN
        return switched

    def _sample(self, results: Sequence[Expr], t: NDArray[np.float64]) -> list[TimeValue]:
        """Return a list of the values of program results (expressions or symbols of steps) at the instants t. A value
        is an array of shape (N,), computed in blocks, or a float if the result does not depend on t.
        """
        constants = [self._program.value(result) for result in results]
        rows = {result: np.empty(t.shape) for result, value in zip(results, constants, strict=True) if value is None}
        if rows:
            function = self._compiled(tuple(rows))
            with np.errstate(all="ignore"):
                for start in range(0, t.size, _SAMPLES_PER_EVALUATION_BLOCK):
                    block = slice(start, start + _SAMPLES_PER_EVALUATION_BLOCK)
                    for row, values in zip(rows.values(), function(t[block]), strict=True):
                        row[block] = np.nan if np.iscomplexobj(values) else values
        return [rows[result] if value is None else value for result, value in zip(results, constants, strict=True)]

    def _compile(self, results: tuple[Expr, ...]) -> Callable[..., Sequence[Any]]:
        """Return a NumPy function that takes t and then the values of the further symbols, and returns a sequence of
        the values of `results`, which are expressions or symbols of steps.
        """
        steps = self._program.steps_for(list(results))
        function: Callable[..., Sequence[Any]] = sympy.lambdify(
            self._symbols,
            results,
            [{"numpy": np}],
            NumPySourcePrinter(),
            cse=lambda parts: (steps, parts),
            docstring_limit=0,
        )
        return function
