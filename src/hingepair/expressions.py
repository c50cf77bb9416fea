"""Expressions in t, from text to SymPy, without running the text.

The text is read by Python's own grammar and walked node by node; only what is listed here becomes SymPy, and nothing
is looked up by a name that came from outside. Numbers stay exact: 0.1 is 1/10, so no digit is lost before the
last step. What would take too long or too much memory is refused before it is computed.
"""

from __future__ import annotations

import ast
import functools
import keyword
import math
import warnings
from collections.abc import Callable, Iterable, Mapping
from fractions import Fraction
from typing import Any, Final, NamedTuple, NoReturn, TypeAlias

from hingepair.errors import SceneError

Expr: TypeAlias = Any  # a sympy.Expr; SymPy carries no types

FUNCTIONS: Final = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
    *("asinh", "acosh", "atanh", "exp", "log", "sqrt"),
)
"""What can be called: the same names in SymPy and in math."""

CONSTANTS: Final = {"pi": math.pi, "tau": math.tau, "e": math.e}

_SIGNS = "+-*/().,_ \t\r\n\f\v"
_A_NUMBER = "a finite real number"


class ExpressionError(SceneError):
    """An expression cannot be read, or would take too long to compute."""


class UnknownNameError(ExpressionError):
    """An expression uses a name that nothing is known by; `expected` lists those that are."""

    def __init__(self, name: str, expected: str, got: object) -> None:
        super().__init__(name, expected, got)
        self.args = (f"{name}: {got}; known: {expected}",)


def parse(name: str, text: str, constants: Mapping[str, float] | None = None) -> Expr:
    """The SymPy expression that a text in t stands for.

    Numbers, `+ - * / **`, brackets, t, pi, tau, e, the named constants and FUNCTIONS; decimal numbers are exact.

    Args:
        name: what the text is, for messages: `motion.psi`.
        text: the expression.
        constants: values of further names, finite; see `check_constant_name`.

    Raises:
        ExpressionError: no such expression; a constant part that is not a finite real number; too long, too deep,
            or with derivatives too large to work with.
        UnknownNameError: a name that is not known.

    >>> parse("psi", "amplitude*sin(2*pi*t) + 0.1", {"amplitude": 0.25})
    sin(2*pi*t)/4 + 1/10
    """
    builder = _Builder(name, text, constants or {})
    try:
        part = builder.build(builder.syntax(), 0)
    except RecursionError:
        raise ExpressionError(name, "a simpler expression", text) from None
    if sum(part.cost) > MAX_TERMS:
        got = f"one whose derivatives have up to {sum(part.cost):.3g} terms"
        raise ExpressionError(name, f"an expression whose derivatives have at most {MAX_TERMS} terms", got)
    return part.expr


def check_constant_name(name: str) -> str | None:
    """Why a constant cannot have this name; None where it can."""
    if not (name.isascii() and name.isidentifier()) or keyword.iskeyword(name):
        return "a name of letters, digits and _"
    if name == "t" or name in CONSTANTS or name in FUNCTIONS:
        return f"a name other than {', '.join(('t', *CONSTANTS, *FUNCTIONS))}"
    return None


class _Part(NamedTuple):
    """A part of an expression; value is that of a part without t, else None."""

    expr: Expr
    value: float | None
    cost: Cost


class _Builder:
    """One text on its way to SymPy."""

    def __init__(self, name: str, text: str, constants: Mapping[str, float]) -> None:
        self.name = name
        self.text = text
        self.constants = constants
        self.nodes = 0

    def syntax(self) -> ast.expr:
        """The syntax tree of the text; line breaks count as blanks."""
        text = self.text
        if len(text) > MAX_LENGTH:
            raise ExpressionError(self.name, f"at most {MAX_LENGTH} characters", f"{len(text)}")
        for column, sign in enumerate(text, 1):
            if sign not in _SIGNS and not (sign.isascii() and sign.isalnum()):
                hint = " (a power is written **)" if sign == "^" else ""
                raise self._error(f"an expression in t{hint}", f"character {sign!r} at column {column}")
        blank = "".join(" " if sign.isspace() else sign for sign in text)
        self.text = blank.strip()
        self.indent = len(blank) - len(blank.lstrip())
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return ast.parse(self.text, mode="eval").body
        except SyntaxError as error:
            got = f"{error.msg} at column {self.indent + (error.offset or 1)}" if self.text else "''"
            raise self._error("an expression in t", got) from None
        except (ValueError, MemoryError, RecursionError):
            raise self._error("an expression of fewer parts", self.text) from None

    def build(self, node: ast.expr, depth: int) -> _Part:
        """The part that a node of the syntax tree stands for."""
        self._count(1)
        if depth > MAX_DEPTH:
            self._refuse(node, f"at most {MAX_DEPTH} levels of brackets")
        match node:
            case ast.Constant():
                return self._number(node)
            case ast.Name():
                return self._named(node)
            case ast.BinOp(op=ast.Add() | ast.Sub()) | ast.UnaryOp(op=ast.UAdd() | ast.USub()):
                return self._sum(node, depth + 1)
            case ast.BinOp(op=ast.Mult() | ast.Div()):
                return self._product(node, depth + 1)
            case ast.BinOp(op=ast.Pow()):
                return self._power(node, depth + 1)
            case ast.Call():
                return self._call(node, depth + 1)
        self._refuse(node, "numbers, names, calls and + - * / **")

    def _number(self, node: ast.Constant) -> _Part:
        import sympy

        source = self._source(node)
        if type(node.value) not in {int, float} or not math.isfinite(_to_float(node.value)):
            self._refuse(node, _A_NUMBER)
        if isinstance(node.value, int):
            expr = sympy.Integer(node.value)
        elif abs(int(source.lower().partition("e")[2] or 0)) > MAX_EXPONENT:
            self._refuse(node, f"a power of ten of at most {MAX_EXPONENT}")
        else:
            fraction = Fraction(source)
            expr = sympy.Rational(fraction.numerator, fraction.denominator)
        return self._finish(node, expr, 0.0, Cost(1))

    def _named(self, node: ast.Name) -> _Part:
        import sympy

        if node.id == "t":
            return _Part(time_symbol(), None, Cost(1, 1, 0))
        if node.id in CONSTANTS:
            expr = {"pi": sympy.pi, "tau": 2 * sympy.pi, "e": sympy.E}[node.id]
            return _Part(expr, CONSTANTS[node.id], Cost(1))
        if node.id in self.constants:
            return self._finish(node, exact(self.constants[node.id]), 0.0, Cost(1))
        if node.id in FUNCTIONS:
            self._refuse(node, f"{node.id}(...)")
        self._unknown(node)

    def _sum(self, node: ast.expr, depth: int) -> _Part:
        import sympy

        parts = []
        for negative, term in self._chain(node, (ast.Add, ast.Sub)):
            part = self.build(term, depth)
            parts.append(part._replace(expr=-part.expr, value=_negative(part.value)) if negative else part)
        value = _known(math.fsum, [part.value for part in parts])
        costs = [part.cost for part in parts]
        cost = Cost(1 + _total(costs, 0), _total(costs, 1), _total(costs, 2))
        return self._finish(node, sympy.Add(*[part.expr for part in parts]), value, cost)

    def _product(self, node: ast.expr, depth: int) -> _Part:
        import sympy

        factors, values, costs = [], [], []
        for divides, factor in self._chain(node, (ast.Mult, ast.Div)):
            part = self.build(factor, depth)
            if divides and part.expr.is_zero:
                self._refuse(node, "a divisor that is not zero")
            factors.append(1 / part.expr if divides else part.expr)
            values.append(_known(lambda v: 1 / v[0] if v[0] else 0.0, [part.value]) if divides else part.value)
            costs.append(part.cost)
        cost = _product_cost(costs, sum(value is None for value in values))
        return self._finish(node, sympy.Mul(*factors), _known(math.prod, values), cost)

    def _power(self, node: ast.BinOp, depth: int) -> _Part:
        import sympy

        base, exponent = self.build(node.left, depth), self.build(node.right, depth)
        if exponent.value is not None and abs(exponent.value) > MAX_EXPONENT:
            self._refuse(node, f"an exponent of at most {MAX_EXPONENT}")
        if base.expr.is_Rational and bits(base.expr) * abs(exponent.value or 0) > MAX_BITS:
            self._refuse(node, f"exact numbers of at most {MAX_BITS} bits")
        value = self._evaluate(node, math.pow, (base, exponent))
        power = sympy.Pow(base.expr, exponent.expr)
        if power.is_Pow and power.exp.is_Rational and abs(power.exp) > MAX_EXPONENT:
            self._refuse(node, f"an exponent of at most {MAX_EXPONENT}")
        return self._finish(node, power, value, _function_cost((base, exponent)))

    def _call(self, node: ast.Call, depth: int) -> _Part:
        import sympy

        function = node.func
        if not isinstance(function, ast.Name):
            self._refuse(node, f"one of {', '.join(FUNCTIONS)} before the bracket")
        if function.id not in FUNCTIONS:
            if function.id == "t" or function.id in CONSTANTS or function.id in self.constants:
                self._refuse(node, f"{function.id}*(...), as {function.id} is no function")
            self._unknown(function)
        count = 2 if function.id == "atan2" else 1
        if node.keywords or len(node.args) != count:
            self._refuse(node, f"{function.id} with {count} argument{'s'[: count - 1]}")
        parts = tuple(self.build(argument, depth) for argument in node.args)
        value = self._evaluate(node, getattr(math, function.id), parts)
        expr = getattr(sympy, function.id)(*[part.expr for part in parts])
        return self._finish(node, expr, value, _function_cost(parts))

    def _chain(self, node: ast.expr, kinds: tuple[type, type]) -> list[tuple[bool, ast.expr]]:
        """The terms of `a - b + c`, or factors of `a / b * c`, with whether each counts negatively."""
        found = []
        negative = False
        while True:
            if isinstance(node, ast.BinOp) and isinstance(node.op, kinds):
                found.append((negative ^ isinstance(node.op, kinds[1]), node.right))
                node = node.left
            elif kinds[0] is ast.Add and isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.UAdd | ast.USub):
                negative ^= isinstance(node.op, ast.USub)
                node = node.operand
            else:
                found.append((negative, node))
                return found[::-1]
            self._count(1)

    def _evaluate(self, node: ast.expr, function: Callable[..., float], parts: Iterable[_Part]) -> float | None:
        try:
            return _known(lambda values: function(*values), [part.value for part in parts])
        except (ArithmeticError, ValueError):
            self._refuse(node, _A_NUMBER)

    def _finish(self, node: ast.expr, expr: Expr, value: float | None, cost: Cost) -> _Part:
        """The part, once it is known to be finite and of a size that can be worked with."""
        import sympy

        if {expr, *expr.args} & {sympy.nan, sympy.zoo, sympy.oo, -sympy.oo}:
            self._refuse(node, _A_NUMBER)
        if expr.is_Rational:
            if bits(expr) > MAX_BITS:
                self._refuse(node, f"exact numbers of at most {MAX_BITS} bits")
            value = rational_value(expr)
        elif value is None and not expr.free_symbols:  # t went away: t/t*pi
            value = constant_value(expr)
        if value is None:
            return _Part(expr, None, cost)
        if not math.isfinite(value):
            self._refuse(node, _A_NUMBER)
        return _Part(expr, value, Cost(cost.size, 0, 0))
