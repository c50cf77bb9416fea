"""Exact SymPy expressions of numbers, axes and rotations, and of the expressions of scene files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, Final, TypeAlias

import sympy

from hingepair.errors import ArgumentError
from hingepair.symbolic.expressions import MAX_EXPONENT, SMOOTH_FUNCTIONS, Expression

Expr: TypeAlias = Any  # a sympy.Expr; SymPy carries no types

SYMPY_ERRORS: Final = (ArithmeticError, AttributeError, NotImplementedError, RecursionError, TypeError, ValueError)
"""Errors that SymPy raises on unusual but harmless expressions."""

_MAX_BITS = 256  # of a number; SymPy computes powers in full
_MAX_DENOMINATOR = 1_000  # of a fraction whose square root an entry is recognised as
_ROUNDING = 4 * 2.0**-53  # tolerance: of an entry 0 or 1, of a root relative to its size


def real_symbol(name: str) -> Expr:
    """Return the SymPy symbol of a name, declared as real."""
    return sympy.Symbol(name, real=True)


TIME: Final = real_symbol("t")
"""The symbol of time [s]."""


def rate(expr: Expr) -> Expr:
    """Return the derivative by t; at a kink or a jump that of one side."""
    steps = {step: sympy.Dummy(real=True) for step in expr.atoms(sympy.floor)}
    found = expr.xreplace(steps).diff(TIME).replace(sympy.DiracDelta, lambda *_: sympy.S.Zero)
    return found.xreplace({symbol: step for step, symbol in steps.items()})


def to_sympy(name: str, expression: Expression) -> Expr:
    """Return an expression of a scene in SymPy; its numbers are exact.

    Raises:
        ArgumentError: SymPy cannot work with it in reasonable time. The message calls it `name`.

    >>> from hingepair.symbolic.expressions import parse_expression
    >>> to_sympy("psi", parse_expression("psi", "amplitude*sin(2*pi*t) + 0.1", {"amplitude": 0.25}))
    sin(2*pi*t)/4 + 1/10
    """
    try:
        expr = _converted(expression)
        if not expr.has(sympy.nan, sympy.zoo, sympy.oo, -sympy.oo):
            return expr
    except SYMPY_ERRORS:
        pass
    raise ArgumentError(name, "an expression that SymPy can work with", "another one") from None


def _converted(expression: Expression) -> Expr:
    operation, parts = expression.operation, expression.parts
    if operation == "number" and expression.constant is not None:
        _check_size(expression, 2**_MAX_BITS)
        return sympy.Rational(expression.constant)
    if not parts:
        constants = {"pi": sympy.pi, "tau": 2 * sympy.pi, "e": sympy.E}
        return constants[operation] if expression.constant is not None else real_symbol(operation)
    if operation in {"pow", "exp"}:
        _check_size(parts[-1], MAX_EXPONENT)
    exprs = [_converted(part) for part in parts]
    if expression.constant is not None and operation in {"sin", "cos", "tan"}:
        return value_without_nested_roots(getattr(sympy, operation), *exprs)
    return _OPERATIONS[operation](*exprs)


def _check_size(expression: Expression, largest: int) -> None:
    """Raise an ArithmeticError if an expression contains a large number, or one of many digits."""
    value = expression.constant
    if value is not None and abs(float(value)) > largest:
        raise ArithmeticError("a large number")
    if isinstance(value, Fraction) and value.denominator.bit_length() > _MAX_BITS:
        raise ArithmeticError("many digits")
    for part in expression.parts:
        _check_size(part, largest)


def _choice(condition: Expr, x: Expr, y: Expr) -> Expr:
    return sympy.Piecewise((x, condition), (y, True))


def _largest(*exprs: Expr) -> Expr:
    first, *rest = exprs
    return _choice(first >= _largest(*rest), first, _largest(*rest)) if rest else first


_OPERATIONS: Final[dict[str, Callable[..., Expr]]] = {
    **{name: getattr(sympy, name) for name in SMOOTH_FUNCTIONS},
    "add": sympy.Add,
    "mul": sympy.Mul,
    "div": lambda x, y: x / y,
    "pow": sympy.Pow,
    "abs": lambda x: _choice(x >= 0, x, -x),
    "sign": lambda x: sympy.Piecewise((1, x > 0), (-1, x < 0), (0, True)),
    "min": lambda *exprs: -_largest(*(-expr for expr in exprs)),
    "max": _largest,
    "mod": lambda x, period: x - period * sympy.floor(x / period),
    "where": _choice,
    "<=": lambda x: x <= 0,
    "<": lambda x: x < 0,
    "and": sympy.And,
    "or": sympy.Or,
    "not": sympy.Not,
}


# ---- numbers and rotations


def exact(value: float) -> Expr:
    """Return a finite number as the rational SymPy number that its shortest decimal form shows: 0.1 becomes 1/10."""
    return sympy.Rational(Fraction(repr(float(value))))


def exact_entry(value: float) -> Expr:
    """Return an entry of a rotation matrix as an exact number: 0, 1, -1 or a square root of a simple fraction, with
    either sign, if one of them equals the entry within rounding; otherwise the rational number that its shortest
    decimal form shows.

    >>> exact_entry(6e-17), exact_entry(0.7071067811865475), exact_entry(-0.25)
    (0, sqrt(2)/2, -1/4)
    """
    nearest = round(value)
    if abs(value - nearest) <= _ROUNDING:
        return sympy.Integer(nearest)
    square = Fraction(value * value).limit_denominator(_MAX_DENOMINATOR)
    root = (1 if value > 0 else -1) * sympy.sqrt(sympy.Rational(square))
    return root if abs(float(root) - value) <= _ROUNDING * abs(value) else exact(value)


def exact_axis(n: Sequence[float]) -> tuple[Expr, ...]:
    """Return a unit axis as roots of simple fractions if they equal its components within rounding, otherwise as the
    numbers that the shortest decimals show.
    """
    roots = tuple(map(exact_entry, n))
    return roots if sum(root**2 for root in roots) == 1 else tuple(map(exact, n))


def value_without_nested_roots(function: Callable[..., Expr], argument: Expr) -> Expr:
    """Return the value of a SymPy function at an expression without symbols; the unevaluated call if the value has
    nested roots.

    >>> value_without_nested_roots(sympy.cos, sympy.pi / 6), value_without_nested_roots(sympy.cos, sympy.pi / 60)
    (sqrt(3)/2, cos(pi/60))
    """
    value = function(argument)
    nested = any(not (power.exp.is_Integer or power.base.is_Rational) for power in value.atoms(sympy.Pow))
    return function(argument, evaluate=False) if nested else value
