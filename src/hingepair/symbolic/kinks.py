"""Functions with kinks and jumps, as SymPy sees them: choices, the larger and the smaller of two, remainders.

SymPy's own (Piecewise, Max, Mod) try to prove things about their arguments, which may take for ever, and their
derivatives hold Dirac's delta. These keep their arguments as they are. At a kink their derivatives are those from the
right, the side on which t goes on.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import sympy

Expr: TypeAlias = Any  # a sympy.Expr; SymPy carries no types


def constant_value(expr: Expr) -> float:
    """The float nearest to an expression without t; not finite where there is none."""
    if expr.is_Rational:
        try:
            return int(expr.p) / int(expr.q)
        except OverflowError:
            return math.inf
    number = expr.evalf(30)
    return float(number) if number.is_Float else math.nan


class Where(sympy.Function):  # type: ignore[misc]  # SymPy carries no types
    """`Where(guard, x, y)`: x where guard >= 0, else y; NaN where the guard is.

    >>> t = sympy.Symbol("t", real=True)
    >>> Where(t - 1, t**2, 0).diff(t), Where(-1, t, 0), Where(Where(t, -1, 1), 2, 3)
    (Where(t - 1, 2*t, 0), 0, Where(t, 3, 2))
    """

    nargs = 3
    is_real = True

    @classmethod
    def eval(cls, guard: Expr, x: Expr, y: Expr) -> Expr | None:
        """What is left of a choice that has been made, or that another choice makes."""
        if not guard.free_symbols:
            return x if constant_value(guard) >= 0 else y
        if x == y:
            return x
        if isinstance(guard, Where) and not any(part.free_symbols for part in guard.args[1:]):
            return Where(guard.args[0], *(Where(part, x, y) for part in guard.args[1:]))
        return None

    def _eval_derivative(self, symbol: Expr) -> Expr:
        guard, x, y = self.args
        return Where(guard, x.diff(symbol), y.diff(symbol))

    def _numpycode(self, printer: Any) -> str:
        guard, x, y = map(printer.doprint, self.args)
        return f"numpy.select([{guard} >= 0, {guard} < 0], [{x}, {y}], numpy.nan)"

    def _latex(self, printer: Any) -> str:
        guard, x, y = (printer.doprint(part) for part in (shown_guard(self.args[0]), *self.args[1:]))
        return f"\\begin{{cases}} {x} & {guard} \\ge 0 \\\\ {y} & \\text{{else}} \\end{{cases}}"


class Side(sympy.Function):  # type: ignore[misc]
    """`Side(g, g', g'')`: 1 or -1, on which side of zero g is just after t; NaN where g is."""

    nargs = 3
    is_real = True

    def _eval_derivative(self, _: Expr) -> Expr:
        return sympy.S.Zero

    def _numpycode(self, printer: Any) -> str:
        value, first, second = map(printer.doprint, self.args)
        after = f"numpy.where({first} != 0, numpy.sign({first}), numpy.where({second} < 0, -1.0, 1.0))"
        return f"numpy.where({value} != 0, numpy.sign({value}), {after})"


class Extreme(sympy.Function):  # type: ignore[misc]
    """The larger or the smaller of two."""

    nargs = 2
    is_real = True
    sense, word = 0, ""

    @classmethod
    def eval(cls, x: Expr, y: Expr) -> Expr | None:
        """The one of them, where that does not depend on t."""
        guard = cls.sense * (x - y)
        return None if guard.free_symbols else Where(guard, x, y)

    def guard(self) -> Expr:
        """What is at least 0 where it is the first of the two."""
        return self.sense * (self.args[0] - self.args[1])

    def _eval_derivative(self, symbol: Expr) -> Expr:
        return Where(self.guard(), *(part.diff(symbol) for part in self.args))

    def _numpycode(self, printer: Any) -> str:
        return f"numpy.{self.word}imum({', '.join(map(printer.doprint, self.args))})"

    def _latex(self, printer: Any) -> str:
        return f"\\{self.word}\\left({', '.join(map(printer.doprint, self.args))}\\right)"


class Larger(Extreme):
    """The larger of two."""

    sense, word = 1, "max"


class Smaller(Extreme):
    """The smaller of two."""

    sense, word = -1, "min"


class Remainder(sympy.Function):  # type: ignore[misc]
    """`Remainder(x, period)`: x less whole periods, at least 0 and below the period, which is a positive number."""

    nargs = 2
    is_real = True
    word = "mod"

    @classmethod
    def eval(cls, x: Expr, period: Expr) -> Expr | None:
        """The remainder of what does not depend on t."""
        return None if x.free_symbols else x - period * sympy.floor(x / period)

    def _eval_derivative(self, symbol: Expr) -> Expr:
        return self.args[0].diff(symbol)

    def _numpycode(self, printer: Any) -> str:
        return f"numpy.mod({', '.join(map(printer.doprint, self.args))})"

    def _latex(self, printer: Any) -> str:
        x, period = map(printer.doprint, self.args)
        return f"\\left({x} \\bmod {period}\\right)"


def shown_guard(guard: Expr) -> Expr:
    """What a reader wants to know of a guard: of a Side, the value."""
    return guard.args[0] if isinstance(guard, Side) else guard
