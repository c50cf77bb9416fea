"""Expressions in t, from text to SymPy, without running the text.

The text is read by Python's own grammar and walked node by node; only what is listed here becomes SymPy, and nothing
is looked up by a name that came from outside. Numbers stay exact: 0.1 is 1/10, so no digit is lost before the
last step. What would take too long or too much memory is refused before it is computed.
"""

from __future__ import annotations

import ast
import keyword
import math
import re
import warnings
from collections.abc import Callable, Collection, Mapping
from fractions import Fraction
from types import MappingProxyType
from typing import Final, NamedTuple, NoReturn, TypeAlias

import sympy

from hingepair.errors import ArgumentError, nearest, pointed
from hingepair.symbolic.jets import MAX_BITS, SYMPY_ERRORS, bits, time_symbol
from hingepair.symbolic.kinks import Expr, Larger, Remainder, Smaller, Where, constant_value
from hingepair.symbolic.time_functions import exact

MAX_LENGTH: Final = 10_000
"""Characters of the text."""
MAX_DEPTH: Final = 50
"""Levels of brackets, calls and powers; the terms of a sum and the factors of a product are one level."""
MAX_NODES: Final = 3_000
"""Numbers, names and operations. As many steps compute the derivatives, so that these need no limit of their own."""
MAX_EXPONENT: Final = 1_000
"""Of a power, and of the ten in a decimal number."""
MAX_ROOT: Final = 10_000
"""Denominator of an exponent: t**0.1234."""

SMOOTH: Final = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
    *("asinh", "acosh", "atanh", "exp", "log", "sqrt"),
)
"""The same names in SymPy and in math."""

KINKED: Final = MappingProxyType({
    "abs": "abs(x)", "sign": "sign(x)", "min": "min(x, y, ...)", "max": "max(x, y, ...)",
    "clip": "clip(x, lowest, highest)", "mod": "mod(x, period)", "where": "where(t < 1, x, y)", "step": "step(x)",
    "ramp": "ramp(x)",
})  # fmt: skip
"""What has kinks or jumps, and how it is called."""

_MEANT: Final = MappingProxyType({
    **dict.fromkeys(("deg", "degrees", "deg2rad", "radians", "rad"), "degrees are written 30*pi/180"),
    **dict.fromkeys(("piecewise", "Piecewise", "ifelse"), "where(condition, x, y)"),
    **dict.fromkeys(("heaviside", "Heaviside"), "step(x)"),
    **{f"arc{name}": f"a{name}(x)" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    "arctan2": "atan2(y, x)",
    "ln": "log(x)",
    "T": "t",
})  # fmt: skip
"""What is called otherwise elsewhere."""

FUNCTIONS: Final = (*SMOOTH, *KINKED)
"""What can be called."""

CONSTANTS: Final = MappingProxyType({"pi": math.pi, "tau": math.tau, "e": math.e})
"""What has a value by name."""

Number: TypeAlias = float | Expr

_EXACT: Final = MappingProxyType({"pi": sympy.pi, "tau": 2 * sympy.pi, "e": sympy.E})
_PUNCTUATION = "+-*/().,_<>= \t\r\n\f\v"
_A_NUMBER = "a finite real number"
_A_CONDITION = "a condition: comparisons by < <= > >=, joined by and, or, not"
_SHOWN, _FRAGMENT = 20, 40  # constants, and characters of the text, in a message
# 2t, 2 sin(t), (1 + t)(2 - t), pi t
_WORD = r"(?!(?:and|or|not|if|else)\b)[A-Za-z_]\w*+"
_NUMBER = r"(?<![\w.])(?<!\d[eE][-+])\d++(?:\.\d*+)?(?:[eE][-+]?\d++)?"
_PRODUCT = re.compile(rf"({_NUMBER}|\)|\b{_WORD}(?=\s+\w))\s*({_WORD}|\(|(?<=\s)\d)")


class ExpressionError(ArgumentError):
    """An expression cannot be read, or would take too long to compute."""


class UnknownNameError(ExpressionError):
    """An expression uses a name that nothing is known by; `expected` lists those that are."""

    def __init__(self, name: str, expected: str, got: object) -> None:
        super().__init__(name, expected, got)
        self.args = (f"{name}: {got}; known: {expected}",)


def parse(name: str, text: str, constants: Mapping[str, Number] | None = None, letters: Collection[str] = ()) -> Expr:
    """The SymPy expression that a text in t stands for.

    Numbers, `+ - * / **`, brackets, t, pi, tau, e, the named constants and FUNCTIONS; decimal numbers are exact.

    Args:
        name: what the text is, for messages: `motion.psi`.
        text: the expression.
        constants: values of further names, finite numbers or expressions without t; see `constant_name_fault`.
        letters: those of them that stay letters.

    Raises:
        ExpressionError: no such expression; a constant part that is not a finite real number; too long or too deep.
        UnknownNameError: a name that is not known.

    >>> parse("psi", "amplitude*sin(2*pi*t) + 0.1", {"amplitude": 0.25})
    sin(2*pi*t)/4 + 1/10
    >>> parse("psi", "where(0 <= t <= 1, abs(t - 0.5), 0)")
    Where(Smaller(t, 1 - t), Abs(t - 1/2), 0)
    """
    builder = _Builder(name, text, constants or {}, letters)
    try:
        return builder.build(builder.syntax(), 0).expr
    except ArgumentError:
        raise
    except SYMPY_ERRORS:
        raise ExpressionError(name, "an expression that SymPy can work with", text) from None


def constant(name: str, text: str, constants: Mapping[str, Number] | None = None) -> Expr:
    """The SymPy expression that a text without t stands for: `pi/6`.

    Raises:
        ExpressionError: as for `parse`, or the text depends on t.
    """
    expr = parse(name, text, constants)
    if expr.free_symbols:
        raise ExpressionError(name, "a number: an expression without t", text)
    return expr


def constant_name_fault(name: str) -> str | None:
    """What is expected of a constant's name that this one is not; None for a good one."""
    if not (name.isascii() and name.isidentifier()) or keyword.iskeyword(name):
        return "a name of letters, digits and _"
    taken = ("t", *CONSTANTS, *SMOOTH)  # a constant named step or max is told from step(x) by its use
    return f"a name other than {', '.join(taken)}" if name in taken else None


class _Part(NamedTuple):
    """A part of an expression; value is that of a part without t, else None."""

    expr: Expr
    value: float | None


class _Builder:
    """One text on its way to SymPy; `line` is the whole of it, for messages with a caret."""

    def __init__(self, name: str, text: str, constants: Mapping[str, Number], letters: Collection[str]) -> None:
        self.name = name
        self.text = self.line = text
        self.constants = constants
        self.letters = letters
        self.column = 1
        self.nodes = 0

    def syntax(self) -> ast.expr:
        """The syntax tree of the text; line breaks count as blanks."""
        if len(self.text) > MAX_LENGTH:
            self._fail(f"at most {MAX_LENGTH} characters", f"{len(self.text)}")
        for column, sign in enumerate(self.text, 1):
            if sign not in _PUNCTUATION and not (sign.isascii() and sign.isalnum()):
                hint = {"^": "; a power is written **", "%": "; a remainder is written mod(x, period)"}.get(sign, "")
                self._fail(f"an expression in t{hint}", f"character {sign!r} at column {column}", column)
        blank = "".join(" " if sign.isspace() else sign for sign in self.text)
        self.text, self.line = blank.strip(), blank
        self.column = 1 + len(blank) - len(blank.lstrip())
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return ast.parse(self.text, mode="eval").body
        except SyntaxError as error:
            if not self.text:
                self._fail("an expression in t", "''")
            column = self.column + (error.offset or len(self.text) + 1) - 1  # no offset: at the end
            fault = error.msg if error.offset else "an end where something is missing"
            self._fail(f"an expression in t{self._hint()}", f"{fault} at column {column}", column)
        except (ValueError, MemoryError, RecursionError):
            self._fail("an expression of fewer parts", self.text)

    def build(self, node: ast.expr, depth: int) -> _Part:
        """The part that a node of the syntax tree stands for."""
        self._count(node, depth)
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
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()):
                self._refuse(node, "a condition only in where(condition, x, y)")
            case ast.IfExp():
                self._refuse(node, "where(condition, x, y) for a choice")
            case ast.Tuple():
                self._refuse(node, "one number or expression (decimals follow a point)")
        self._refuse(node, "numbers, names, calls and + - * / **")

    def _number(self, node: ast.Constant) -> _Part:
        if type(node.value) not in {int, float} or node.value == math.inf:
            self._refuse(node, _A_NUMBER)
        source = self._source(node) if isinstance(node.value, float) else str(node.value)
        if abs(int(source.lower().partition("e")[2] or 0)) > MAX_EXPONENT:
            self._refuse(node, f"a power of ten of at most {MAX_EXPONENT}")
        fraction = Fraction(source)
        return self._finish(node, sympy.Rational(fraction.numerator, fraction.denominator), None)

    def _named(self, node: ast.Name) -> _Part:
        if node.id == "t":
            return _Part(time_symbol(), None)
        if node.id in CONSTANTS:
            return _Part(_EXACT[node.id], CONSTANTS[node.id])
        if node.id in self.letters:
            return _Part(sympy.Symbol(node.id, real=True), None)
        if node.id in self.constants:
            value = self.constants[node.id]
            return self._finish(node, exact(value) if isinstance(value, int | float) else value, None)
        if node.id in FUNCTIONS:
            self._refuse(node, KINKED.get(node.id, f"{node.id}(...)"))
        self._unknown(node)

    def _sum(self, node: ast.expr, depth: int) -> _Part:
        terms, values = [], []
        for negative, term in self._chain(node, (ast.Add, ast.Sub)):
            part = self.build(term, depth)
            terms.append(-part.expr if negative else part.expr)
            values.append(-part.value if negative and part.value is not None else part.value)
        value = self._evaluate(node, lambda *numbers: math.fsum(numbers), values)
        return self._finish(node, sympy.Add(*terms), value)

    def _product(self, node: ast.expr, depth: int) -> _Part:
        factors, values = [], []
        for divides, factor in self._chain(node, (ast.Mult, ast.Div)):
            part = self.build(factor, depth)
            factors.append(1 / part.expr if divides else part.expr)
            values.append(self._evaluate(node, lambda x: 1 / x, [part.value]) if divides else part.value)
        value = self._evaluate(node, lambda *numbers: math.prod(numbers), values)
        return self._finish(node, sympy.Mul(*factors), value)

    def _power(self, node: ast.BinOp, depth: int) -> _Part:
        base, exponent = self.build(node.left, depth), self.build(node.right, depth)
        self._check_power(node, base.expr, exponent.expr)
        value = self._evaluate(node, math.pow, [base.value, exponent.value])
        return self._finish(node, sympy.Pow(base.expr, exponent.expr), value)

    def _call(self, node: ast.Call, depth: int) -> _Part:
        if not isinstance(node.func, ast.Name):
            self._refuse(node, f"the name of a function before the bracket{self._hint()}")
        function = node.func.id
        if function not in FUNCTIONS:
            if function == "t" or function in CONSTANTS or function in self.constants:
                self._refuse(node, f"{function}*(...)")
            self._unknown(node.func)
        if function in KINKED:
            return self._kinked(node, function, depth)
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
        return self._finish(node, expr, value)

    def _kinked(self, node: ast.Call, function: str, depth: int) -> _Part:
        """A call of what has kinks or jumps."""
        count = {"min": max(2, len(node.args)), "max": max(2, len(node.args)), "clip": 3, "where": 3, "mod": 2}
        if node.keywords or len(node.args) != count.get(function, 1):
            self._refuse(node, KINKED[function])
        if function == "where":
            x, y = (self.build(argument, depth).expr for argument in node.args[1:])
            guard, inverse = self._guard(node.args[0], depth)
            return self._finish(node, Where(guard, y, x) if inverse else Where(guard, x, y), None)
        first, *rest = (self.build(argument, depth).expr for argument in node.args)
        match function:
            case "abs" | "sign":
                expr = getattr(sympy, function.capitalize() if function == "abs" else function)(first)
            case "min" | "max":
                expr = _of_many(Smaller if function == "min" else Larger, [first, *rest])
            case "clip":
                expr = Smaller(Larger(first, rest[0]), rest[1])
            case "mod":
                if rest[0].free_symbols or not constant_value(rest[0]) > 0:
                    self._refuse(node, "mod(x, period) with a period above 0 that does not depend on t")
                expr = (
                    Remainder(first, rest[0])
                    if first.free_symbols
                    else first - rest[0] * sympy.floor(first / rest[0])
                )
            case "step":
                expr = Where(first, sympy.S.One, sympy.S.Zero)
            case _:
                expr = Larger(first, sympy.S.Zero)
        return self._finish(node, expr, None)

    def _guard(self, node: ast.expr, depth: int) -> tuple[Expr, bool]:
        """What is at least 0 where a condition holds; or, if the second is true, where it does not."""
        self._count(node, depth)
        match node:
            case ast.BoolOp():
                guards = [self._plain_guard(operand, depth + 1) for operand in node.values]
                return _of_many(Smaller if isinstance(node.op, ast.And) else Larger, guards), False
            case ast.UnaryOp(op=ast.Not()):
                guard, inverse = self._guard(node.operand, depth + 1)
                return guard, not inverse
            case ast.Compare():
                sides = [self.build(side, depth + 1).expr for side in (node.left, *node.comparators)]
                pairs = zip(node.ops, sides[:-1], sides[1:], strict=True)
                guards = [self._comparison(node, sign, left, right) for sign, left, right in pairs]
                return guards[0] if len(guards) == 1 else (_of_many(Smaller, [_plain(*g) for g in guards]), False)
        self._refuse(node, _A_CONDITION)

    def _plain_guard(self, node: ast.expr, depth: int) -> Expr:
        return _plain(*self._guard(node, depth))

    def _comparison(self, node: ast.expr, sign: ast.cmpop, left: Expr, right: Expr) -> tuple[Expr, bool]:
        match sign:
            case ast.LtE():
                return right - left, False
            case ast.GtE():
                return left - right, False
            case ast.Lt():
                return left - right, True
            case ast.Gt():
                return right - left, True
        self._refuse(node, _A_CONDITION)

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

    def _finish(self, node: ast.expr, expr: Expr, value: float | None) -> _Part:
        """The part, once it is known to be finite and of a size that can be worked with."""
        if not {expr, *expr.args}.isdisjoint({sympy.nan, sympy.zoo, sympy.oo, -sympy.oo}):
            self._refuse(node, _A_NUMBER)
        for part in (expr, *expr.args):
            if part.is_Pow:
                self._check_power(node, part.base, part.exp)
        if expr.is_Rational and bits(expr) > MAX_BITS:
            self._refuse(node, f"exact numbers of at most {MAX_BITS} bits")
        if expr.is_Rational or (value is None and not expr.free_symbols):
            value = constant_value(expr)
        if value is not None and not math.isfinite(value):
            self._refuse(node, _A_NUMBER)
        return _Part(expr, value)

    def _check_power(self, node: ast.expr, base: Expr, exponent: Expr) -> None:
        """Refuse exponents that SymPy would be long at work with."""
        largest = max(abs(term.as_coeff_Mul()[0]) for term in sympy.Add.make_args(exponent))
        if exponent.is_Rational and (abs(exponent) > MAX_EXPONENT or exponent.q > MAX_ROOT):
            self._refuse(node, f"an exponent of at most {MAX_EXPONENT}, with at most 4 decimals")
        if base is not sympy.E and bits(base.as_coeff_Mul()[0]) * largest > MAX_BITS:
            self._refuse(node, f"exact numbers of at most {MAX_BITS} bits")

    def _count(self, node: ast.expr, depth: int = 0) -> None:
        self.nodes += 1
        if self.nodes > MAX_NODES:
            self._refuse(node, f"at most {MAX_NODES} numbers, names and operations")
        if depth > MAX_DEPTH:
            self._refuse(node, f"at most {MAX_DEPTH} levels of brackets")

    def _source(self, node: ast.expr) -> str:
        return self.text[node.col_offset : node.end_col_offset]

    def _hint(self) -> str:
        """What to write where a product lacks its sign, or a function its brackets."""
        found = _PRODUCT.search(self.text)
        if found and found[1] in FUNCTIONS:
            return f"; a function is called as {KINKED.get(found[1], f'{found[1]}({found[2]})')}"
        if found:
            return f"; a product is written {found[1]}*{found[2]}"
        if re.search(r"\bif\b", self.text):
            return "; a choice is written where(condition, x, y)"
        assigns = re.search("(?<![<>=])=(?!=)", self.text)
        return "; what = assigns to stands outside the quotes" if assigns else ""

    def _refuse(self, node: ast.expr, expected: str) -> NoReturn:
        source = self._source(node)
        shown = source if len(source) <= _FRAGMENT else source[: _FRAGMENT - 3] + "..."
        column = self.column + node.col_offset
        self._fail(expected, f"{shown} at column {column}", column)

    def _unknown(self, node: ast.Name) -> NoReturn:
        names = (*FUNCTIONS, "t", *CONSTANTS, *list(self.constants)[:_SHOWN])
        column, short = self.column + node.col_offset, node.id[:_FRAGMENT]
        meant = f" ({_MEANT[short]})" if short in _MEANT else nearest(short, names)
        got = f"unknown name '{short}' at column {column}{meant}"
        error = UnknownNameError(self.name, ", ".join(names), got)
        error.add_note(pointed(self.line, column))
        raise error

    def _fail(self, expected: str, got: str, column: int | None = None) -> NoReturn:
        error = ExpressionError(self.name, expected, got)
        if column is not None:
            error.add_note(pointed(self.line, column))
        raise error from None


def _of_many(choose: Callable[[Expr, Expr], Expr], parts: list[Expr]) -> Expr:
    """The largest or smallest of many, by halves: what is nested deeply, SymPy gives up on."""
    half = len(parts) // 2
    return parts[0] if not half else choose(_of_many(choose, parts[:half]), _of_many(choose, parts[half:]))


def _plain(guard: Expr, inverse: bool) -> Expr:
    """What is at least 0 where a condition holds."""
    return Where(guard, sympy.S.NegativeOne, sympy.S.One) if inverse else guard
