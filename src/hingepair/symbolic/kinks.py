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


def _without_proofs(function: type) -> type:
    """Return a hyperbolic function of SymPy's that is taken for real, and of which SymPy proves nothing else.

    SymPy asks such functions whether they are zero or positive, and splits their arguments into real and imaginary
    parts for it, which takes for ever where these are sums or products of many roots.
    """
    questions = ("positive", "negative", "nonnegative", "zero", "finite", "real", "extended_real")
    silent = dict.fromkeys([f"_eval_is_{question}" for question in questions])
    found: type = type(function)(function.__name__, (function,), {**silent, "is_real": True, "__module__": __name__})
    return found


sinh, cosh, tanh = map(_without_proofs, (sympy.sinh, sympy.cosh, sympy.tanh))


class Kinked(sympy.Function):  # type: ignore[misc]  # SymPy carries no types
    """A function with kinks or jumps; `numpy`, `text` and `latex` say how it is written of its arguments {0}, {1}."""

    is_real = True
    numpy = text = latex = ""

    def _numpycode(self, printer: Any) -> str:
        return self.numpy.format(*map(printer.doprint, self.args))

    def _latex(self, printer: Any, exp: str | None = None) -> str:
        written = self.latex.format(*map(printer.doprint, self.args))
        return written if exp is None else f"\\left({written}\\right)^{{{exp}}}"


class Choice(Kinked):
    """The first of the last two arguments where `guard` is at least 0, else the second."""

    guard: Expr

    def _eval_derivative(self, symbol: Expr) -> Expr:
        return Where(self.guard, *(part.diff(symbol) for part in self.args[-2:]))


class Where(Choice):
    """`Where(guard, x, y)`: x where guard >= 0, else y; NaN where the guard is.

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
        """What is left of a choice that has been made, or that another choice makes."""
        if not guard.free_symbols:
            return x if constant_value(guard) >= 0 else y
        if x == y:
            return x
        if isinstance(guard, Where) and not any(part.free_symbols for part in guard.args[1:]):
            return Where(guard.args[0], *(Where(part, x, y) for part in guard.args[1:]))
        return None


class Extreme(Choice):
    """The larger or the smaller of two."""

    nargs = 2
    sense = 0
    guard = property(lambda self: self.sense * (self.args[0] - self.args[1]))

    @classmethod
    def eval(cls, x: Expr, y: Expr) -> Expr | None:
        """The one of them, where that does not depend on t."""
        guard = cls.sense * (x - y)
        return None if guard.free_symbols else Where(guard, x, y)


class Larger(Extreme):
    """The larger of two."""

    sense = 1
    numpy, text, latex = "numpy.maximum({0}, {1})", "max({0}, {1})", r"\max\left({0}, {1}\right)"


class Smaller(Extreme):
    """The smaller of two."""

    sense = -1
    numpy, text, latex = "numpy.minimum({0}, {1})", "min({0}, {1})", r"\min\left({0}, {1}\right)"


class Remainder(Kinked):
    """`Remainder(x, period)`: x less whole periods, at least 0 and below the period, which is a positive number."""

    nargs = 2
    numpy, text, latex = "numpy.mod({0}, {1})", "mod({0}, {1})", r"\left({0} \bmod {1}\right)"

    @classmethod
    def eval(cls, x: Expr, period: Expr) -> Expr | None:
        """The remainder of what does not depend on t."""
        return None if x.free_symbols else x - period * sympy.floor(x / period)

    def _eval_derivative(self, symbol: Expr) -> Expr:
        return self.args[0].diff(symbol)


class Side(Kinked):
    """`Side(g, g', g'')`: 1 or -1, on which side of zero g is just after t; NaN where g is.

    It stands in guards only, where a reader wants to know g.
    """

    nargs = 3
    numpy = (
        "numpy.where({0} != 0, numpy.sign({0}), "
        "numpy.where({1} != 0, numpy.sign({1}), numpy.where({2} < 0, -1.0, 1.0)))"
    )
    text = latex = "{0}"

    def _eval_derivative(self, _: Expr) -> Expr:
        return sympy.S.Zero
