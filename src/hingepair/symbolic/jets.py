"""Expressions in t with their first and second derivatives, in steps that each stay small.

The derivatives of one long expression can be a thousand times as long. Here every part is named and differentiated
in terms of the names of its own parts, which SymPy does exactly and the chain rule puts together: as many steps as
the expression has parts.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from typing import Any, Final, TypeAlias

from hingepair.symbolic import expression_size as size

Expr: TypeAlias = Any  # a sympy.Expr; SymPy carries no types
Jet: TypeAlias = tuple[Expr, Expr, Expr]

SYMPY_ERRORS: Final = (ArithmeticError, AttributeError, NotImplementedError, RecursionError, TypeError, ValueError)
"""What SymPy is known to raise on odd but harmless expressions, such as asin(cos(1e300))."""

_COMPILED = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
    *("asinh", "acosh", "atanh", "exp", "log", "Abs", "sign", "Heaviside", "DiracDelta"),
)


class NotRealError(ArithmeticError):
    """An expression or a derivative is not real, or holds a number that is no finite float."""


def time_symbol() -> Expr:
    """The SymPy symbol t of every expression: real."""
    import sympy

    return sympy.Symbol("t", real=True)


@functools.lru_cache(maxsize=4096)
def constant_value(expr: Expr) -> float:
    """The float nearest to an expression without t; not finite where there is none."""
    if expr.is_Rational:
        try:
            return int(expr.p) / int(expr.q)
        except OverflowError:
            return math.inf
    number = expr.evalf(30)
    return float(number) if number.is_Float else math.nan


class JetProgram:
    """Steps that compute expressions and their derivatives from t.

    Attributes:
        steps: pairs (name, what it is in terms of t and earlier names), all of them SymPy expressions.
    """

    def __init__(self) -> None:
        self.steps: list[tuple[Expr, Expr]] = []
        self._names: dict[Expr, Expr] = {}
        self._jets: dict[Expr, Jet] = {}
        self._constants: dict[Expr, Expr] = {}

    def jet(self, expr: Expr) -> Jet:
        """An expression in t with its first and second derivative, each a number, t, or the name of a step.

        Raises:
            NotRealError: one of them is not real and finite.
        """
        import sympy

        if expr not in self._jets:
            zero, one = sympy.S.Zero, sympy.S.One
            if not expr.free_symbols:
                self._jets[expr] = (self._name(expr), zero, zero)
            elif expr.is_Symbol:
                self._jets[expr] = (expr, one, zero)
            else:
                self._jets[expr] = self._combine(expr, [self.jet(part) for part in expr.args])
        return self._jets[expr]

    def value(self, result: Expr) -> float | None:
        """The float that a result is, where it does not depend on t."""
        constant: Expr = self._constants.get(result) or result
        return None if constant.free_symbols else constant_value(constant)

    def needed(self, results: list[Expr]) -> list[tuple[Expr, Expr]]:
        """The steps that some results need, in order."""
        names = set().union(*(result.free_symbols for result in results))
        taken = []
        for name, meaning in reversed(self.steps):
            if name in names:
                taken.append((name, meaning))
                names |= meaning.free_symbols
        return taken[::-1]

    def _combine(self, expr: Expr, jets: list[Jet]) -> Jet:
        import sympy

        if expr.is_Add:
            value, first, second = (self._name(sympy.Add(*column)) for column in zip(*jets, strict=True))
            return value, first, second
        if expr.is_Mul:
            return functools.reduce(self._multiply, jets)
        return self._differentiate(expr.func(*[value for value, _, _ in jets]), jets)

    def _multiply(self, a: Jet, b: Jet) -> Jet:
        """The jet of a product: (a b)'' = a'' b + 2 a' b' + a b''."""
        first = a[1] * b[0] + a[0] * b[1]
        second = a[2] * b[0] + 2 * a[1] * b[1] + a[0] * b[2]
        return self._name(a[0] * b[0]), self._name(first), self._name(second)

    def _differentiate(self, expr: Expr, jets: list[Jet]) -> Jet:
        """The jet of f(u, v) by the chain rule; expr is f in terms of the names of u and v."""
        parts = {value: (first, second) for value, first, second in jets if value.is_Symbol}
        value, first, second = self._name(expr), 0, 0
        for u, (ud, udd) in parts.items():
            slope = expr.diff(u)
            _check(slope)
            first += self._share(slope) * ud
            second += self._share(slope) * udd
            for v, (vd, _) in parts.items():
                second += self._share(slope.diff(v)) * ud * vd
        return value, self._name(first), self._name(second)

    def _share(self, expr: Expr) -> Expr:
        """The expression with its functions as steps of their own: f, f' and f'' mostly hold the same."""
        import sympy

        functions = [f for f in expr.atoms(sympy.Function) if all(part.is_Atom for part in f.args)]
        return expr.xreplace({f: self._name(f) for f in functions})

    def _name(self, expr: Expr) -> Expr:
        """The name of a step that computes an expression; rational numbers and names stand for themselves."""
        import sympy

        expr = sympy.sympify(expr)
        if expr.free_symbols <= self._constants.keys():
            expr = expr.xreplace(self._constants)
        if expr.is_Symbol:
            return expr
        if expr not in self._names:
            _check(expr)
            if expr.is_Rational:
                return expr
            self._names[expr] = sympy.Symbol(f"w{len(self.steps)}", real=True)
            self.steps.append((self._names[expr], expr))
            if not expr.free_symbols:
                self._constants[self._names[expr]] = expr
        return self._names[expr]


def _check(expr: Expr) -> None:
    """Refuse what NumPy cannot evaluate in real numbers."""
    import sympy

    if expr.has(sympy.I, sympy.nan, sympy.zoo, sympy.oo, -sympy.oo):
        raise NotRealError("an imaginary or infinite part")
    if any(size.bits(number) > size.MAX_BITS for number in expr.atoms(sympy.Rational)):
        raise NotRealError("a number of too many digits")
    if not all(math.isfinite(constant_value(constant)) for constant in _constants(expr)):
        raise NotRealError("a number that is not real or past the range of floats")
    for power in expr.atoms(sympy.Pow):
        if power.base.is_Number and power.base.is_negative and not power.exp.is_integer:
            raise NotRealError(f"a power of the negative number {power.base}")
    for function in expr.atoms(sympy.Function, sympy.Derivative, sympy.Subs, sympy.Piecewise):
        if type(function).__name__ not in _COMPILED:
            raise NotRealError(f"{type(function).__name__}(...)")


def _constants(expr: Expr) -> Iterator[Expr]:
    """The largest parts without t."""
    rest = [expr]
    while rest:
        part = rest.pop()
        if part.free_symbols:
            rest += part.args
        else:
            yield part
