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
    """Return the SymPy symbol of a name, declared as real."""
    return sympy.Symbol(name, real=True)


def constant_value(expr: Expr) -> float:
    """Return the float nearest to a SymPy expression without symbols; inf if it is too large, NaN if it has no real
    value.
    """
    if expr.is_Rational:
        try:
            return int(expr.p) / int(expr.q)
        except OverflowError:
            return math.inf
    number = expr.evalf(30)
    if not number.is_Float:
        return math.nan
    return 0.0 if number._prec == 1 else float(number)  # SymPy found no digit that differs from 0


def _without_proofs(function: type) -> type:
    """Return a subclass of the given SymPy hyperbolic function that is declared as real, and about which SymPy
    derives no other property such as its sign.

    To find out whether such a function is zero or positive, SymPy splits its argument into real and imaginary parts,
    which takes for ever where the argument is a sum or product of many roots.
    """
    properties = ("positive", "negative", "nonnegative", "zero", "finite", "real", "extended_real")
    silent = dict.fromkeys([f"_eval_is_{name}" for name in properties])
    copy: type = type(function)(function.__name__, (function,), {**silent, "is_real": True, "__module__": __name__})
    return copy


sinh, cosh, tanh = map(_without_proofs, (sympy.sinh, sympy.cosh, sympy.tanh))


class Kinked(sympy.Function):  # type: ignore[misc]  # SymPy carries no types
    """Base class of SymPy functions with kinks or jumps. Its attributes `numpy`, `c`, `text` and `latex` are format
    strings of a call, in which {0}, {1} and so on stand for the arguments.
    """

    is_real = True
    numpy = c = text = latex = ""

    def _numpycode(self, printer: Any) -> str:
        return self.numpy.format(*map(printer.doprint, self.args))

    def _ccode(self, printer: Any) -> str:
        return self.c.format(*(f"({printer.doprint(part)})" for part in self.args))

    def _latex(self, printer: Any, exp: str | None = None) -> str:
        text = self.latex.format(*map(printer.doprint, self.args))
        return text if exp is None else f"\\left({text}\\right)^{{{exp}}}"


class Choice(Kinked):
    """Base class of SymPy functions that choose between their last two arguments. The value is the first of the two
    if the expression `guard` is at least 0, otherwise the second.
    """

    guard: Expr

    def _eval_derivative(self, symbol: Expr) -> Expr:
        return Where(self.guard, *(part.diff(symbol) for part in self.args[-2:]))


class Where(Choice):
    """SymPy function `Where(guard, x, y)`: x if guard >= 0, y if guard < 0, and NaN if the guard is NaN.

    >>> t = sympy.Symbol("t", real=True)
    >>> Where(t - 1, t**2, 0).diff(t), Where(-1, t, 0), Where(Where(t, -1, 1), 2, 3)
    (Where(t - 1, 2*t, 0), 0, Where(t, 3, 2))
    """

    nargs = 3
    guard = property(lambda self: self.args[0])
    numpy = "numpy.select([{0} >= 0, {0} < 0], [{1}, {2}], numpy.nan)"
    c = "({0} >= 0 ? {1} : {0} < 0 ? {2} : NAN)"
    text = "({1} if {0} ≥ 0 else {2})"
    latex = r"\begin{{cases}} {1} & {0} \ge 0 \\ {2} & \text{{else}} \end{{cases}}"

    @classmethod
    def eval(cls, guard: Expr, x: Expr, y: Expr) -> Expr | None:
        """Return a simpler equivalent expression if the guard has no symbols, x equals y, or the guard is itself a
        choice between constants; otherwise None, which leaves the call unevaluated.
        """
        if not guard.free_symbols:
            return x if constant_value(guard) >= 0 else y
        if x == y:
            return x
        if isinstance(guard, Where) and not any(part.free_symbols for part in guard.args[1:]):
            return Where(guard.args[0], *(Where(part, x, y) for part in guard.args[1:]))
        return None


class Extreme(Choice):
    """Base class of the SymPy functions Larger and Smaller of two arguments; the attribute `sense` is 1 for Larger
    and -1 for Smaller.
    """

    nargs = 2
    sense = 0
    guard = property(lambda self: self.sense * (self.args[0] - self.args[1]))

    @classmethod
    def eval(cls, x: Expr, y: Expr) -> Expr | None:
        """Return the larger or the smaller argument if the difference of the two has no symbols; otherwise None,
        which leaves the call unevaluated.
        """
        guard = cls.sense * (x - y)
        return None if guard.free_symbols else Where(guard, x, y)


class Larger(Extreme):
    """SymPy function `Larger(x, y)`: the larger of two arguments."""

    sense = 1
    c = "({0} > {1} || {0} != {0} ? {0} : {1})"  # fmax would lose NaN
    numpy, text, latex = "numpy.maximum({0}, {1})", "max({0}, {1})", r"\max\left({0}, {1}\right)"


class Smaller(Extreme):
    """SymPy function `Smaller(x, y)`: the smaller of two arguments."""

    sense = -1
    c = "({0} < {1} || {0} != {0} ? {0} : {1})"
    numpy, text, latex = "numpy.minimum({0}, {1})", "min({0}, {1})", r"\min\left({0}, {1}\right)"


class Remainder(Kinked):
    """SymPy function `Remainder(x, period)`: x minus a whole number of periods, so that the value is at least 0 and
    below the period, which is positive.
    """

    nargs = 2
    c = "fmod(fmod({0}, {1}) + {1}, {1})"
    numpy, text, latex = "numpy.mod({0}, {1})", "mod({0}, {1})", r"\left({0} \bmod {1}\right)"

    @classmethod
    def eval(cls, x: Expr, period: Expr) -> Expr | None:
        """Return the remainder as an expression if x has no symbols; otherwise None, which leaves the call
        unevaluated.
        """
        return None if x.free_symbols else x - period * sympy.floor(x / period)

    def _eval_derivative(self, symbol: Expr) -> Expr:
        return self.args[0].diff(symbol)


class SideOfZero(Kinked):
    """SymPy function `SideOfZero(g, g', g'')` of a function g of t and its derivatives: the sign of g just after t, 1
    or -1, or NaN if g is NaN.

    It occurs in guards only, where text shows g instead.
    """

    nargs = 3
    numpy = (
        "numpy.where({0} != 0, numpy.sign({0}), "
        "numpy.where({1} != 0, numpy.sign({1}), numpy.where({2} < 0, -1.0, 1.0)))"
    )
    c = (
        "({0} != 0 ? ({0} > 0 ? 1.0 : {0} < 0 ? -1.0 : NAN) : "
        "{1} != 0 ? ({1} > 0 ? 1.0 : -1.0) : {2} < 0 ? -1.0 : 1.0)"
    )
    text = latex = "{0}"

    def _eval_derivative(self, _: Expr) -> Expr:
        return sympy.S.Zero
