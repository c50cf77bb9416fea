"""Functions with kinks and jumps as SymPy functions: choices, the larger and the smaller of two, remainders.

SymPy's own (Piecewise, Max, Mod) try to prove things about their arguments, which may take for ever, and their
derivatives contain Dirac's delta. These functions keep their arguments as they are. At a kink their derivatives are
those from the right.
"""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import sympy

Expr: TypeAlias = Any  # a sympy.Expr; SymPy carries no types


def real_symbol(name: str) -> Expr:
    """Return the real symbol of a name."""
    return sympy.Symbol(name, real=True)


def constant_value(expr: Expr) -> float:
    """Return the float nearest to an expression without t; inf or NaN where there is none."""
    if expr.is_Rational:
        try:
            return int(expr.p) / int(expr.q)
        except OverflowError:
            return math.inf
    number = expr.evalf(30)
    return float(number) if number.is_Float else math.nan


def _without_proofs(function: type) -> type:
    """Return a copy of SymPy's hyperbolic function that counts as real, and of which SymPy proves nothing else.

    To find out whether such a function is zero or positive, SymPy splits its argument into real and imaginary parts,
    which takes for ever where the argument is a sum or product of many roots.
    """
    properties = ("positive", "negative", "nonnegative", "zero", "finite", "real", "extended_real")
    silent = dict.fromkeys([f"_eval_is_{name}" for name in properties])
    copy: type = type(function)(function.__name__, (function,), {**silent, "is_real": True, "__module__": __name__})
    return copy


sinh, cosh, tanh = map(_without_proofs, (sympy.sinh, sympy.cosh, sympy.tanh))


class Kinked(sympy.Function):  # type: ignore[misc]  # SymPy carries no types
    """Base of SymPy functions with kinks; `numpy`, `text`, `latex` are their notations with arguments {0}, {1}."""

    is_real = True
    numpy = text = latex = ""

    def _numpycode(self, printer: Any) -> str:
        return self.numpy.format(*map(printer.doprint, self.args))

    def _latex(self, printer: Any, exp: str | None = None) -> str:
        text = self.latex.format(*map(printer.doprint, self.args))
        return text if exp is None else f"\\left({text}\\right)^{{{exp}}}"


class Choice(Kinked):
    """Base of choices between the last two arguments: the first where `guard` is at least 0, else the second."""

    guard: Expr

    def _eval_derivative(self, symbol: Expr) -> Expr:
        return Where(self.guard, *(part.diff(symbol) for part in self.args[-2:]))


class Where(Choice):
    """SymPy function `Where(guard, x, y)`: x where guard >= 0, else y; NaN where the guard is.

    >>> t = sympy.Symbol("t", real=True)
    >>> Where(t - 1, t**2, 0).diff(t), Where(-1, t, 0), Where(Where(t, -1, 1), 2, 3)
    (Where(t - 1, 2*t, 0), 0, Where(t, 3, 2))
    """

    nargs = 3
    guard = property(lambda self: self.args[0])
    numpy = "numpy.select([{0} >= 0, {0} < 0], [{1}, {2}], numpy.nan)"
    text = "({1} if {0} ≥ 0 else {2})"
    latex = r"\begin{{cases}} {1} & {0} \ge 0 \\ {2} & \text{{else}} \end{{cases}}"

    @classmethod
    def eval(cls, guard: Expr, x: Expr, y: Expr) -> Expr | None:
        """Return a simpler form of a choice, where its guard has no t or chooses between constants; else None."""
        if not guard.free_symbols:
            return x if constant_value(guard) >= 0 else y
        if x == y:
            return x
        if isinstance(guard, Where) and not any(part.free_symbols for part in guard.args[1:]):
            return Where(guard.args[0], *(Where(part, x, y) for part in guard.args[1:]))
        return None


class Extreme(Choice):
    """Base of the SymPy functions for the larger and the smaller of two arguments."""

    nargs = 2
    sense = 0
    guard = property(lambda self: self.sense * (self.args[0] - self.args[1]))

    @classmethod
    def eval(cls, x: Expr, y: Expr) -> Expr | None:
        """Return the argument chosen, where the choice does not depend on t."""
        guard = cls.sense * (x - y)
        return None if guard.free_symbols else Where(guard, x, y)


class Larger(Extreme):
    """SymPy function for the larger of two arguments."""

    sense = 1
    numpy, text, latex = "numpy.maximum({0}, {1})", "max({0}, {1})", r"\max\left({0}, {1}\right)"


class Smaller(Extreme):
    """SymPy function for the smaller of two arguments."""

    sense = -1
    numpy, text, latex = "numpy.minimum({0}, {1})", "min({0}, {1})", r"\min\left({0}, {1}\right)"


class Remainder(Kinked):
    """SymPy function `Remainder(x, period)`: x less whole periods, from 0 to below the period, a positive number."""

    nargs = 2
    numpy, text, latex = "numpy.mod({0}, {1})", "mod({0}, {1})", r"\left({0} \bmod {1}\right)"

    @classmethod
    def eval(cls, x: Expr, period: Expr) -> Expr | None:
        """Return the remainder of an argument that does not depend on t."""
        return None if x.free_symbols else x - period * sympy.floor(x / period)

    def _eval_derivative(self, symbol: Expr) -> Expr:
        return self.args[0].diff(symbol)


class SideOfZero(Kinked):
    """SymPy function `SideOfZero(g, g', g'')`: 1 or -1, the sign of g just after t; NaN where g is.

    It occurs in guards only, where text shows g instead.
    """

    nargs = 3
    numpy = (
        "numpy.where({0} != 0, numpy.sign({0}), "
        "numpy.where({1} != 0, numpy.sign({1}), numpy.where({2} < 0, -1.0, 1.0)))"
    )
    text = latex = "{0}"

    def _eval_derivative(self, _: Expr) -> Expr:
        return sympy.S.Zero
