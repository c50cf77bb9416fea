"""Functions of time: expressions in t with their exact derivatives, compiled to NumPy.

What does not depend on t comes out as a Python float, which the equations take once and not once per sample.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from typing import Any, TypeAlias

import numpy as np
import sympy
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError
from hingepair.symbolic.jets import SYMPY_ERRORS, Jet, JetProgram, NotRealError, time_symbol
from hingepair.symbolic.kinks import Expr
from hingepair.symbolic.printers import NumPySource

Value: TypeAlias = float | NDArray[np.float64]
Derivatives: TypeAlias = tuple[tuple[Value, ...], ...]

_BLOCK = 2048  # samples at a time: the intermediate results stay in the cache


def exact(value: float) -> Expr:
    """The rational number that the shortest decimal form of a finite number writes: 0.1 is 1/10."""
    return sympy.Rational(Fraction(repr(value if isinstance(value, int) else float(value))))


class TimeFunctions:
    """Expressions in t, ready to be evaluated with their derivatives.

    Args:
        expressions: SymPy expressions in `time_symbol()`.
        names: of the expressions, for messages.
        letters: further symbols that the expressions may hold, for `values`.

    Raises:
        ArgumentError: an expression or a derivative is not real and finite, whatever t is; names it.

    >>> t = time_symbol()
    >>> functions = TimeFunctions([3 * t, t**2 + 1])
    >>> functions.derivatives(np.array([0.0, 2.0]))
    ((array([0., 6.]), array([1., 5.])), (3.0, array([0., 4.])), (0.0, 2.0))
    """

    def __init__(self, expressions: Sequence[Expr], names: Sequence[str] = (), letters: Sequence[str] = ()) -> None:
        self._letters = (time_symbol(), *(sympy.Symbol(letter, real=True) for letter in letters))
        self._program = JetProgram()
        self._jets: list[Jet] = []
        self._compiled: dict[tuple[Expr, ...], Callable[..., Sequence[Any]]] = {}
        expected = "an expression with finite real values and derivatives"
        for i, expr in enumerate(expressions):
            name = names[i] if names else f"expressions[{i}]"
            try:
                self._jets.append(self._program.jet(expr))
            except NotRealError as error:
                raise ArgumentError(name, expected, str(error)) from None
            except SYMPY_ERRORS:
                raise ArgumentError(name, expected, "one that SymPy cannot differentiate") from None

    def derivatives(self, t: ArrayLike, order: int = 2) -> Derivatives:
        """(values, first derivatives, ...), each a tuple with one entry per expression.

        Entries are arrays of t's shape, or a Python float for what does not depend on t. Samples where an expression
        has no real value, or no derivative, are NaN; at a kink, derivatives are those from the right.

        Args:
            t: instants [s]; shape (...).
            order: of the highest derivative, at most 2.
        """
        times = np.asarray(t, dtype=np.float64)
        flat = [jet[k] for k in range(order + 1) for jet in self._jets]
        constants = [self._program.value(expr) for expr in flat]
        moving = [expr for expr, constant in zip(flat, constants, strict=True) if constant is None]
        rows = (row.reshape(times.shape) for row in self._sample(moving, times.reshape(-1)))
        arrays: Iterator[Value] = rows if times.ndim else map(float, rows)
        values = iter([next(arrays) if constant is None else constant for constant in constants])
        return tuple(tuple(itertools.islice(values, len(self._jets))) for _ in range(order + 1))

    def values(self, *given: NDArray[np.float64]) -> tuple[Value, ...]:
        """The expressions at instants and values of the letters, arrays of one shape; constants as numbers."""
        results = [jet[0] for jet in self._jets]
        found = self._compiled_for(results)
        with np.errstate(all="ignore"):
            return tuple(np.nan if np.iscomplexobj(value) else value for value in found(*given))

    def switches(self, t: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Whether kinks or jumps lie between neighbours of increasing instants; shape (N - 1,)."""
        switched = np.zeros(max(0, t.size - 1), dtype=bool)
        for sides in self._sample([switch for switch in self._program.switches if switch.free_symbols], t):
            switched |= np.abs(np.diff(sides)) > 0  # not of NaN, where nothing is known
        return switched

    def _sample(self, results: list[Expr], t: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Steps of the program evaluated, block by block."""
        rows = [np.empty(t.shape) for _ in results]
        if not results:
            return rows
        function = self._compiled_for(results)
        with np.errstate(all="ignore"):
            for start in range(0, t.size, _BLOCK):
                block = slice(start, start + _BLOCK)
                for row, values in zip(rows, function(t[block]), strict=True):
                    row[block] = np.nan if np.iscomplexobj(values) else values
        return rows

    def _compiled_for(self, results: list[Expr]) -> Callable[..., Sequence[Any]]:
        """A function of t and the letters."""
        key = tuple(results)
        if key not in self._compiled:
            steps = self._program.needed(results)
            self._compiled[key] = sympy.lambdify(
                self._letters,
                results,
                [{"numpy": np}],
                NumPySource(),
                cse=lambda parts: (steps, parts),
                docstring_limit=0,
            )
        return self._compiled[key]
