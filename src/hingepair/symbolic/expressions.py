"""Expressions in t, from text to SymPy, without running the text.

The text is read by Python's own grammar and walked node by node; only what is listed here becomes SymPy, and nothing
is looked up by a name that came from outside. Numbers stay exact: 0.1 is 1/10, so no digit is lost before the
last step. What would take too long or too much memory is refused before it is computed.
"""

from __future__ import annotations

import ast
import keyword
import math
import warnings
from collections.abc import Callable, Mapping
from fractions import Fraction
from types import MappingProxyType
from typing import Final, NamedTuple, NoReturn

from hingepair.errors import SceneError
from hingepair.symbolic import expression_size as size
from hingepair.symbolic.jets import SYMPY_ERRORS, Expr, constant_value, time_symbol
from hingepair.symbolic.time_functions import exact

FUNCTIONS: Final = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
    *("asinh", "acosh", "atanh", "exp", "log", "sqrt"),
)
"""What can be called: the same names in SymPy and in math."""

CONSTANTS: Final = MappingProxyType({"pi": math.pi, "tau": math.tau, "e": math.e})
"""What has a value by name."""

_PUNCTUATION = "+-*/().,_ \t\r\n\f\v"
_A_NUMBER = "a finite real number"
_SHOWN, _FRAGMENT = 20, 40  # constants, and characters of the text, in a message


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
        constants: values of further names, finite; see `constant_name_fault`.

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
    except SceneError:
        raise
    except SYMPY_ERRORS:
        raise ExpressionError(name, "an expression that SymPy can work with", text) from None
    if sum(part.cost) > size.MAX_TERMS:
        expected = f"an expression whose derivatives have at most {size.MAX_TERMS} terms"
        raise ExpressionError(name, expected, f"up to {sum(part.cost)} in {text}")
    return part.expr


def constant_name_fault(name: str) -> str | None:
    """What is expected of a constant's name that this one is not; None for a good one."""
    if not (name.isascii() and name.isidentifier()) or keyword.iskeyword(name):
        return "a name of letters, digits and _"
    taken = ("t", *CONSTANTS, *FUNCTIONS)
    return f"a name other than {', '.join(taken)}" if name in taken else None


class _Part(NamedTuple):
    """A part of an expression; value is that of a part without t, else None."""

    expr: Expr
    value: float | None
    cost: size.Cost


class _Builder:
    """One text on its way to SymPy."""

    def __init__(self, name: str, text: str, constants: Mapping[str, float]) -> None:
        self.name = name
        self.text = text
        self.constants = constants
        self.column = 1
        self.nodes = 0

    def syntax(self) -> ast.expr:
        """The syntax tree of the text; line breaks count as blanks."""
        if len(self.text) > size.MAX_LENGTH:
            self._fail(f"at most {size.MAX_LENGTH} characters", f"{len(self.text)}")
        for column, sign in enumerate(self.text, 1):
            if sign not in _PUNCTUATION and not (sign.isascii() and sign.isalnum()):
                hint = "; a power is written **" if sign == "^" else ""
                self._fail(f"an expression in t{hint}", f"character {sign!r} at column {column}")
        blank = "".join(" " if sign.isspace() else sign for sign in self.text)
        self.text = blank.strip()
        self.column = 1 + len(blank) - len(blank.lstrip())
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return ast.parse(self.text, mode="eval").body
        except SyntaxError as error:
            fault = f"{error.msg} at column {self.column + (error.offset or 1) - 1}"
            self._fail("an expression in t", fault if self.text else "''")
        except (ValueError, MemoryError, RecursionError):
            self._fail("an expression of fewer parts", self.text)

    def build(self, node: ast.expr, depth: int) -> _Part:
        """The part that a node of the syntax tree stands for."""
        self._count(node)
        if depth > size.MAX_DEPTH:
            self._refuse(node, f"at most {size.MAX_DEPTH} levels of brackets")
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

        if type(node.value) not in {int, float} or node.value == math.inf:
            self._refuse(node, _A_NUMBER)
        source = self._source(node) if isinstance(node.value, float) else str(node.value)
        if abs(int(source.lower().partition("e")[2] or 0)) > size.MAX_EXPONENT:
            self._refuse(node, f"a power of ten of at most {size.MAX_EXPONENT}")
        fraction = Fraction(source)
        return self._finish(node, sympy.Rational(fraction.numerator, fraction.denominator), None, size.Cost(1))

    def _named(self, node: ast.Name) -> _Part:
        import sympy

        if node.id == "t":
            return _Part(time_symbol(), None, size.Cost(1, 1))
        if node.id in CONSTANTS:
            expr = {"pi": sympy.pi, "tau": 2 * sympy.pi, "e": sympy.E}[node.id]
            return _Part(expr, CONSTANTS[node.id], size.Cost(1))
        if node.id in self.constants:
            return self._finish(node, exact(self.constants[node.id]), None, size.Cost(1))
        if node.id in FUNCTIONS:
            self._refuse(node, f"{node.id}(...)")
        self._unknown(node)

    def _sum(self, node: ast.expr, depth: int) -> _Part:
        import sympy

        terms, costs, values = [], [], []
        for negative, term in self._chain(node, (ast.Add, ast.Sub)):
            part = self.build(term, depth)
            terms.append(-part.expr if negative else part.expr)
            values.append(-part.value if negative and part.value is not None else part.value)
            costs.append(part.cost)
        value = self._evaluate(node, lambda *numbers: math.fsum(numbers), values)
        return self._finish(node, sympy.Add(*terms), value, size.sum_cost(costs))

    def _product(self, node: ast.expr, depth: int) -> _Part:
        import sympy

        factors, costs, values = [], [], []
        for divides, factor in self._chain(node, (ast.Mult, ast.Div)):
            part = self.build(factor, depth)
            factors.append(1 / part.expr if divides else part.expr)
            values.append(self._evaluate(node, lambda x: 1 / x, [part.value]) if divides else part.value)
            costs.append(size.function_cost([part.cost]) if divides and part.value is None else part.cost)
        value = self._evaluate(node, lambda *numbers: math.prod(numbers), values)
        return self._finish(node, sympy.Mul(*factors), value, size.product_cost(costs, values.count(None)))

    def _power(self, node: ast.BinOp, depth: int) -> _Part:
        import sympy

        base, exponent = self.build(node.left, depth), self.build(node.right, depth)
        self._check_power(node, base.expr, exponent.expr)
        value = self._evaluate(node, math.pow, [base.value, exponent.value])
        cost = size.function_cost([base.cost, exponent.cost])
        return self._finish(node, sympy.Pow(base.expr, exponent.expr), value, cost)

    def _call(self, node: ast.Call, depth: int) -> _Part:
        import sympy

        if not isinstance(node.func, ast.Name):
            self._refuse(node, "the name of a function before the bracket")
        function = node.func.id
        if function not in FUNCTIONS:
            if function == "t" or function in CONSTANTS or function in self.constants:
                self._refuse(node, f"{function}*(...)")
            self._unknown(node.func)
        count = 2 if function == "atan2" else 1
        if node.keywords or len(node.args) != count:
            self._refuse(node, f"{function}(y, x)" if count == 2 else f"{function}(x)")
        parts = [self.build(argument, depth) for argument in node.args]
        value = self._evaluate(node, getattr(math, function), [part.value for part in parts])
        if function == "exp":  # SymPy turns exp(c*log(b)) into b**c
            for term in sympy.Add.make_args(parts[0].expr):
                factor, rest = term.as_coeff_Mul()
                if isinstance(rest, sympy.log):
                    self._check_power(node, rest.args[0], factor)
        evaluate = function != "atan2" or value is None  # of constants: SymPy may try logarithms for minutes
        expr = getattr(sympy, function)(*[part.expr for part in parts], evaluate=evaluate)
        cost = size.function_cost([part.cost for part in parts], function)
        return self._finish(node, expr, value, cost)

    def _chain(self, node: ast.expr, kinds: tuple[type, type]) -> list[tuple[bool, ast.expr]]:
        """The terms of `a - b + c`, or factors of `a / b * c`, with whether each counts inversely."""
        found = []
        inverse = False
        while True:
            if isinstance(node, ast.BinOp) and isinstance(node.op, kinds):
                found.append((inverse ^ isinstance(node.op, kinds[1]), node.right))
                node = node.left
            elif isinstance(node, ast.UnaryOp) and ast.Sub in kinds and isinstance(node.op, ast.UAdd | ast.USub):
                inverse ^= isinstance(node.op, ast.USub)
                node = node.operand
            else:
                return [*found, (inverse, node)][::-1]
            self._count(node)

    def _evaluate(self, node: ast.expr, function: Callable[..., float], values: list[float | None]) -> float | None:
        """The value of a part without t, in floats: it shows what is not finite before SymPy tries it exactly."""
        try:
            return None if None in values else function(*values)
        except (ArithmeticError, ValueError):
            self._refuse(node, _A_NUMBER)

    def _finish(self, node: ast.expr, expr: Expr, value: float | None, cost: size.Cost) -> _Part:
        """The part, once it is known to be finite and of a size that can be worked with."""
        import sympy

        if not {expr, *expr.args}.isdisjoint({sympy.nan, sympy.zoo, sympy.oo, -sympy.oo}):
            self._refuse(node, _A_NUMBER)
        for part in (expr, *expr.args):
            if part.is_Pow:
                self._check_power(node, part.base, part.exp)
        if expr.is_Rational and size.bits(expr) > size.MAX_BITS:
            self._refuse(node, f"exact numbers of at most {size.MAX_BITS} bits")
        if expr.is_Rational or (value is None and not expr.free_symbols):
            value = constant_value(expr)
        if value is not None and not math.isfinite(value):
            self._refuse(node, _A_NUMBER)
        return _Part(expr, value, cost if value is None else size.Cost(cost.size))

    def _check_power(self, node: ast.expr, base: Expr, exponent: Expr) -> None:
        """Refuse exponents that SymPy would be long at work with."""
        import sympy

        largest = max(abs(term.as_coeff_Mul()[0]) for term in sympy.Add.make_args(exponent))
        if exponent.is_Rational and (abs(exponent) > size.MAX_EXPONENT or exponent.q > size.MAX_ROOT):
            self._refuse(node, f"an exponent of at most {size.MAX_EXPONENT}, with at most 4 decimals")
        if base is not sympy.E and size.bits(base.as_coeff_Mul()[0]) * largest > size.MAX_BITS:
            self._refuse(node, f"exact numbers of at most {size.MAX_BITS} bits")

    def _count(self, node: ast.expr) -> None:
        self.nodes += 1
        if self.nodes > size.MAX_NODES:
            self._refuse(node, f"at most {size.MAX_NODES} numbers, names and operations")

    def _source(self, node: ast.expr) -> str:
        return self.text[node.col_offset : node.end_col_offset]

    def _refuse(self, node: ast.expr, expected: str) -> NoReturn:
        source = self._source(node)
        shown = source if len(source) <= _FRAGMENT else source[: _FRAGMENT - 3] + "..."
        self._fail(expected, f"{shown} at column {self.column + node.col_offset}")

    def _unknown(self, node: ast.Name) -> NoReturn:
        known = ", ".join((*FUNCTIONS, "t", *CONSTANTS, *list(self.constants)[:_SHOWN]))
        column = self.column + node.col_offset
        raise UnknownNameError(self.name, known, f"unknown name '{node.id[:_FRAGMENT]}' at column {column}")

    def _fail(self, expected: str, got: str) -> NoReturn:
        raise ExpressionError(self.name, expected, got) from None
