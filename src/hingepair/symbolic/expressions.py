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
from collections.abc import Callable, Collection, Mapping, Sequence
from fractions import Fraction
from types import MappingProxyType
from typing import Final, NamedTuple, NoReturn, TypeAlias

import sympy

from hingepair.errors import ArgumentError, nearest, pointed
from hingepair.symbolic.jets import MAX_BITS, SMOOTH, SYMPY_ERRORS, bits, time_symbol
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

_KINKED: Final[Mapping[str, Callable[..., Expr]]] = MappingProxyType({
    "abs(x)": sympy.Abs,
    "sign(x)": sympy.sign,
    "min(x, y, ...)": lambda *parts: _of_many(Smaller, parts),
    "max(x, y, ...)": lambda *parts: _of_many(Larger, parts),
    "clip(x, lowest, highest)": lambda x, lowest, highest: Smaller(Larger(x, lowest), highest),
    "mod(x, period)": Remainder,
    "where(t < 1, x, y)": Where,
    "step(x)": lambda x: Where(x, 1, 0),
    "ramp(x)": lambda x: Larger(x, 0),
})  # fmt: skip
"""What has kinks or jumps, by how it is called."""

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

FUNCTIONS: Final = MappingProxyType(
    {name: "atan2(y, x)" if name == "atan2" else f"{name}(x)" for name in SMOOTH}
    | {call.partition("(")[0]: call for call in _KINKED}
)
"""What can be called, and how."""

CONSTANTS: Final = MappingProxyType({"pi": sympy.pi, "tau": 2 * sympy.pi, "e": sympy.E})
"""What has a value by name."""

Number: TypeAlias = float | Expr

_STRANGE = re.compile(r"[^\w+*/().,<>=\s-]", re.ASCII)
_INSTEAD = {"^": "; a power is written **", "%": "; a remainder is written mod(x, period)"}
_A_NUMBER = "a finite real number"
_A_CONDITION = "a condition: comparisons by < <= > >=, joined by and, or, not"
_SHOWN, _FRAGMENT = 20, 40  # constants, and characters of the text, in a message
# 2t, 2 sin(t), (1 + t)(2 - t), pi t
_WORD = r"(?!(?:and|or|not|if|else)\b)[A-Za-z_]\w*+"
_NUMBER = r"(?<![\w.])(?<!\d[eE][-+])\d++(?:\.\d*+)?(?:[eE][-+]?\d++)?"
_PRODUCT = re.compile(rf"({_NUMBER}|\)|\b{_WORD}(?=\s+\w))\s*({_WORD}|\(|(?<=\s)\d)")


class UnknownNameError(ArgumentError):
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
        ArgumentError: no such expression; a constant part that is not a finite real number; too long or too deep.
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
        raise ArgumentError(name, "an expression that SymPy can work with", text) from None


def constant(name: str, text: str, constants: Mapping[str, Number] | None = None) -> Expr:
    """The SymPy expression that a text without t stands for: `pi/6`.

    Raises:
        ArgumentError: as for `parse`, or the text depends on t.
    """
    expr = parse(name, text, constants)
    if expr.free_symbols:
        raise ArgumentError(name, "a number: an expression without t", text)
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
        self.line = re.sub(r"\s", " ", text, flags=re.ASCII)
        self.text = self.line.strip(" ")
        self.constants = {**CONSTANTS, **constants, **{key: sympy.Symbol(key, real=True) for key in letters}}
        self.column = 1 + len(self.line) - len(self.line.lstrip(" "))
        self.nodes = 0

    def syntax(self) -> ast.expr:
        """The syntax tree of the text; line breaks count as blanks."""
        if len(self.line) > MAX_LENGTH:
            self._fail(f"at most {MAX_LENGTH} characters", f"{len(self.line)}")
        if strange := _STRANGE.search(self.line):
            column = strange.start() + 1
            instead = _INSTEAD.get(strange[0], "")
            self._fail(f"an expression in t{instead}", f"character {strange[0]!r} at column {column}", column)
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
        return self._finish(node, sympy.Rational(Fraction(source)))

    def _named(self, node: ast.Name) -> _Part:
        if node.id == "t":
            return _Part(time_symbol(), None)
        if node.id in self.constants:
            value = self.constants[node.id]
            return self._finish(node, exact(value) if isinstance(value, int | float) else value)
        if node.id in FUNCTIONS:
            self._refuse(node, FUNCTIONS[node.id])
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
            if function == "t" or function in self.constants:
                self._refuse(node, f"{function}*(...)")
            self._unknown(node.func)
        call, count = FUNCTIONS[function], len(node.args)
        if node.keywords or (count < 2 if call.endswith("...)") else count != call.count(",") + 1):
            self._refuse(node, call)
        if call in _KINKED:
            return self._finish(node, self._kinked(node, call, depth))
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

    def _kinked(self, node: ast.Call, call: str, depth: int) -> Expr:
        """A call of what has kinks or jumps."""
        first, *rest = node.args
        read = self._guard if _KINKED[call] is Where else self._expr
        parts = [read(first, depth), *(self._expr(argument, depth) for argument in rest)]
        if _KINKED[call] is Remainder and (parts[1].free_symbols or not constant_value(parts[1]) > 0):
            self._refuse(node, f"{call} with a period above 0 that does not depend on t")
        return _KINKED[call](*parts)

    def _expr(self, node: ast.expr, depth: int) -> Expr:
        return self.build(node, depth).expr

    def _guard(self, node: ast.expr, depth: int) -> Expr:
        """What is at least 0 where a condition holds."""
        self._count(node, depth)
        match node:
            case ast.BoolOp():
                guards = [self._guard(operand, depth + 1) for operand in node.values]
                return _of_many(Smaller if isinstance(node.op, ast.And) else Larger, guards)
            case ast.UnaryOp(op=ast.Not()):
                return _negated(self._guard(node.operand, depth + 1))
            case ast.Compare():
                sides = [self._expr(side, depth + 1) for side in (node.left, *node.comparators)]
                pairs = zip(node.ops, sides[:-1], sides[1:], strict=True)
                return _of_many(Smaller, [self._comparison(node, sign, left, right) for sign, left, right in pairs])
        self._refuse(node, _A_CONDITION)

    def _comparison(self, node: ast.expr, sign: ast.cmpop, left: Expr, right: Expr) -> Expr:
        if not isinstance(sign, ast.Lt | ast.LtE | ast.Gt | ast.GtE):
            self._refuse(node, _A_CONDITION)
        guard = right - left if isinstance(sign, ast.LtE | ast.Gt) else left - right
        return _negated(guard) if isinstance(sign, ast.Lt | ast.Gt) else guard

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

    def _finish(self, node: ast.expr, expr: Expr, value: float | None = None) -> _Part:
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
            call = f"{found[1]}({found[2]})" if found[1] in SMOOTH else FUNCTIONS[found[1]]
            return f"; a function is called as {call}"
        if found:
            return f"; a product is written {found[1][:_FRAGMENT]}*{found[2][:_FRAGMENT]}"
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
        names = (*FUNCTIONS, "t", *list(self.constants)[: _SHOWN + len(CONSTANTS)])
        column, short = self.column + node.col_offset, node.id[:_FRAGMENT]
        meant = f" ({_MEANT[short]})" if short in _MEANT else nearest(short, names)
        got = f"unknown name '{short}' at column {column}{meant}"
        error = UnknownNameError(self.name, ", ".join(names), got)
        error.add_note(pointed(self.line, column))
        raise error

    def _fail(self, expected: str, got: str, column: int | None = None) -> NoReturn:
        error = ArgumentError(self.name, expected, got)
        if column is not None:
            error.add_note(pointed(self.line, column))
        raise error from None


def _of_many(choose: Callable[[Expr, Expr], Expr], parts: Sequence[Expr]) -> Expr:
    """The largest or smallest of many, by halves: what is nested deeply, SymPy gives up on."""
    half = len(parts) // 2
    return parts[0] if not half else choose(_of_many(choose, parts[:half]), _of_many(choose, parts[half:]))


def _negated(guard: Expr) -> Expr:
    """What is at least 0 where a guard is not."""
    again = isinstance(guard, Where) and guard.args[1:] == (-1, 1)
    return guard.args[0] if again else Where(guard, -1, 1)
