"""Expressions of scenes as exact SymPy expressions, and their derivatives, for closed forms.

SymPy computes numbers in full and simplifies at once, which some expressions make endless; they are refused before.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

import sympy

from hingepair.errors import ArgumentError
from hingepair.symbolic.constants import MAX_BITS, MAX_EXPONENT, MAX_ROOT
from hingepair.symbolic.exact_constants import value_without_nested_roots
from hingepair.symbolic.expressions import Expression
from hingepair.symbolic.kinks import (
    Choice,
    Expr,
    Larger,
    Remainder,
    SideOfZero,
    Smaller,
    Where,
    constant_value,
    cosh,
    real_symbol,
    sinh,
    tanh,
)
from hingepair.symbolic.printers import count_symbols

SYMPY_ERRORS: Final = (
    ArithmeticError,
    AttributeError,
    NotImplementedError,
    RecursionError,
    TypeError,
    ValueError,
)
"""Errors that SymPy raises on unusual but harmless expressions."""

MAX_DERIVATIVE_SYMBOLS: Final = 2_000
"""Largest number of symbols in a derivative, counted with repetition."""

_HYPERBOLIC: Final = {"sinh": sinh, "cosh": cosh, "tanh": tanh}  # about which SymPy proves nothing
# Guards of functions: expressions in the argument that are at least 0 where the function is real.
_DOMAINS: Final[dict[type, Callable[[Expr], Expr]]] = {
    sympy.log: lambda x: x,
    sympy.asin: lambda x: 1 - x**2,
    sympy.acos: lambda x: 1 - x**2,
    sympy.atanh: lambda x: 1 - x**2,
    sympy.acosh: lambda x: x - 1,
}


def time_symbol() -> Expr:
    """Return the real SymPy symbol t, which stands for time in every expression."""
    return real_symbol("t")


def to_sympy(name: str, expression: Expression) -> Expr:
    """Return an expression of a scene in SymPy; its numbers are exact.

    Raises:
        ArgumentError: SymPy cannot work with it in reasonable time. The message calls it `name`.

    >>> from hingepair.symbolic.expressions import parse_expression
    >>> to_sympy("psi", parse_expression("psi", "amplitude*sin(2*pi*t) + 0.1", {"amplitude": 0.25}))
    sin(2*pi*t)/4 + 1/10
    """
    try:
        return _converted(expression)
    except SYMPY_ERRORS:
        raise ArgumentError(name, "an expression that SymPy can work with", "another one") from None


def _converted(expression: Expression) -> Expr:
    """Return an expression in SymPy, NaN where a part is not real; raise an ArithmeticError if it is too large."""
    operation, parts = expression.operation, expression.parts
    if operation == "number" and expression.constant:
        return sympy.Rational(expression.constant.value)
    if not parts:
        constants = {"pi": sympy.pi, "tau": 2 * sympy.pi, "e": sympy.E}
        return constants[operation] if expression.constant else real_symbol(operation)
    if operation == "where":
        return Where(_guard(parts[0]), *map(_converted, parts[1:]))
    exprs = [_converted(part) for part in parts]
    return _checked(_keep_domains(_operate(operation, exprs, constant=bool(expression.constant)), exprs))


def _operate(operation: str, exprs: Sequence[Expr], constant: bool) -> Expr:  # noqa: PLR0911
    """Return the result of an operation in SymPy; `constant` says that it contains neither t nor symbols."""
    x = exprs[0]
    match operation:
        case "add" | "mul":
            return (sympy.Add if operation == "add" else sympy.Mul)(*exprs)
        case "div":
            return x / exprs[1]
        case "pow":
            _check_power(*exprs)
            return sympy.Pow(*exprs)
        case "min" | "max":
            return _by_halves(Smaller if operation == "min" else Larger, exprs)
        case "abs":
            return sympy.Abs(x)
        case "mod":
            return Remainder(*exprs)
        case "exp":  # SymPy turns exp(c*log(b)) into b**c
            for term in sympy.Add.make_args(x):
                factor, rest = term.as_coeff_Mul()
                if isinstance(rest, sympy.log):
                    _check_power(rest.args[0], factor)
    function = getattr(sympy, operation)
    if constant and operation == "atan2":  # evaluation may take SymPy minutes
        return function(*exprs, evaluate=False)
    if constant and operation in ("sin", "cos", "tan"):  # their values may have nested roots
        return value_without_nested_roots(function, *exprs)
    if not constant and operation in _HYPERBOLIC and not x.is_extended_real:
        return _HYPERBOLIC[operation](x)
    return function(*exprs)


def _guard(condition: Expression) -> Expr:
    """Return an expression that is at least 0 exactly where a condition holds."""
    match condition.operation:
        case "and" | "or":
            guards = [_guard(part) for part in condition.parts]
            return _by_halves(Smaller if condition.operation == "and" else Larger, guards)
        case "not":
            return _negated(_guard(condition.parts[0]))
    difference = _converted(condition.parts[0])
    return _negated(difference) if condition.operation == "<" else difference


def _negated(guard: Expr) -> Expr:
    """Return a guard of the opposite condition: at least 0 exactly where `guard` is below 0."""
    is_negated = isinstance(guard, Where) and guard.args[1:] == (-1, 1)
    return guard.args[0] if is_negated else Where(guard, -1, 1)


def _checked(expr: Expr) -> Expr:
    """Return an expression; raise an ArithmeticError if it is not finite, or too large for SymPy."""
    _check_finite(expr)
    for part in (expr, *expr.args):
        if part.is_Pow:
            _check_power(part.base, part.exp)
    if expr.is_Rational and _bit_length(expr) > MAX_BITS:
        raise ArithmeticError("too many bits")
    if not expr.free_symbols and not math.isfinite(constant_value(expr)):
        raise ArithmeticError("an infinite number")
    return expr


def _check_finite(expr: Expr) -> None:
    if not {expr, *expr.args}.isdisjoint({sympy.nan, sympy.zoo, sympy.oo, -sympy.oo}):
        raise ArithmeticError("an infinite part")


def _check_power(base: Expr, exponent: Expr) -> None:
    """Raise an ArithmeticError if SymPy would compute a power for too long."""
    largest = max(abs(term.as_coeff_Mul()[0]) for term in sympy.Add.make_args(exponent))
    if exponent.is_Rational and (abs(exponent) > MAX_EXPONENT or exponent.q > MAX_ROOT):
        raise ArithmeticError("a large exponent")
    if base is not sympy.E and _bit_length(base.as_coeff_Mul()[0]) * largest > MAX_BITS:
        raise ArithmeticError("a large power")


def _bit_length(number: Expr) -> int:
    return max(int(number.p).bit_length(), int(number.q).bit_length())


def _domains(exprs: Iterable[Expr]) -> dict[Expr, Expr]:
    """Return the parts that are real for some values of their symbols only, by guards that are then at least 0."""
    parts = {}
    for part in (part for expr in exprs for part in expr.atoms(sympy.Pow, *_DOMAINS)):
        x = part.args[0]
        if x.free_symbols and not (part.is_Pow and part.exp.is_integer):
            parts[x if part.is_Pow else _DOMAINS[type(part)](x)] = part
    return parts


def _keep_domains(result: Expr, operands: Iterable[Expr]) -> Expr:
    """Return the result of an operation, NaN where an operand is not real: SymPy simplifies sqrt(x)*sqrt(x) to x."""
    if lost := _domains(operands):
        kept = _domains([result])
        for guard, part in lost.items():
            if guard not in kept:
                result = Where(guard, result, part)
    return result


def _by_halves(function: Callable[[Expr, Expr], Expr], arguments: Sequence[Expr]) -> Expr:
    """Return Larger or Smaller of one or more arguments as a balanced tree, since SymPy fails on deep nesting."""
    half = len(arguments) // 2
    if not half:
        return arguments[0]
    return function(_by_halves(function, arguments[:half]), _by_halves(function, arguments[half:]))


def derivatives(name: str, expr: Expr) -> tuple[Expr, Expr, Expr]:
    """Return an expression in t with its first and second derivatives; at kinks they are those from the right.

    Raises:
        ArgumentError: a derivative does not exist or is too long. The message calls the expression `name`.
    """
    expected = f"an expression whose derivatives have at most {MAX_DERIVATIVE_SYMBOLS} symbols"
    try:
        return _Jets().of(expr)
    except _TooLongError as error:
        raise ArgumentError(name, expected, str(error)) from None
    except SYMPY_ERRORS:
        raise ArgumentError(name, expected, "one that SymPy cannot differentiate") from None


class _TooLongError(Exception):
    """A derivative has too many symbols."""


class _Jets:
    """Values and derivatives of the parts of an expression, each computed once."""

    def __init__(self) -> None:
        self.of = functools.cache(self._differentiate)

    def _differentiate(self, expr: Expr) -> tuple[Expr, Expr, Expr]:
        """Return an expression in t with its first and second derivatives; refuse long or infinite ones."""
        t, zero = time_symbol(), sympy.S.Zero
        if t not in expr.free_symbols:
            return expr, zero, zero
        if expr == t:
            return expr, sympy.S.One, zero
        jets = [self.of(part) for part in expr.args]
        match expr:
            case sympy.Add():
                first, second = (sympy.Add(*(jet[k] for jet in jets)) for k in (1, 2))
            case sympy.Mul():
                _, first, second = functools.reduce(_product, jets)
            case Remainder():
                _, first, second = jets[0]
            case sympy.Abs():
                side = self._side(expr.args[0])
                first, second = (Where(side, jets[0][k], -jets[0][k]) for k in (1, 2))
            case sympy.sign():
                first = second = zero
            case Choice():
                side = self._side(expr.guard)
                first, second = (Where(side, jets[-2][k], jets[-1][k]) for k in (1, 2))
            case _:
                first, second = _chain(expr, jets)
        for derivative in (first, second):
            _check_finite(derivative)
            if count_symbols(derivative) > MAX_DERIVATIVE_SYMBOLS:
                raise _TooLongError(f"{count_symbols(derivative)}")
        return expr, first, second

    def _side(self, guard: Expr) -> Expr:
        """Return an expression that is 1 or -1: the sign of `guard` just after t."""
        match guard:
            case Choice():
                return guard.func(*map(self._side, guard.args))
            case sympy.Number():
                return sympy.S.One if constant_value(guard) >= 0 else sympy.S.NegativeOne
        return SideOfZero(*self.of(guard))


def _product(a: Sequence[Expr], b: Sequence[Expr]) -> tuple[Expr, Expr, Expr]:
    return a[0] * b[0], a[1] * b[0] + a[0] * b[1], a[2] * b[0] + 2 * a[1] * b[1] + a[0] * b[2]


def _chain(expr: Expr, jets: Sequence[tuple[Expr, Expr, Expr]]) -> tuple[Expr, Expr]:
    """Return the first and second derivatives of a function of expressions by the chain rule."""
    places = [sympy.Dummy(real=True) for _ in jets]
    function: Any = expr.func(*places)
    given = dict(zip(places, expr.args, strict=True))
    first, second = sympy.S.Zero, sympy.S.Zero
    for u, (_, ud, udd) in zip(places, jets, strict=True):
        if not ud:
            continue
        slope = function.diff(u)
        first += slope.xreplace(given) * ud
        second += slope.xreplace(given) * udd
        for v, (_, vd, _) in zip(places, jets, strict=True):
            if vd:
                second += slope.diff(v).xreplace(given) * ud * vd
    return first, second
