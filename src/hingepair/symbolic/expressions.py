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
import operator
import re
import warnings
from collections.abc import Callable, Collection, Mapping, Sequence
from fractions import Fraction
from types import MappingProxyType
from typing import Any, Final, NamedTuple, NoReturn, TypeAlias

import sympy

from hingepair.errors import ArgumentError, nearest, pointed
from hingepair.symbolic.exact_constants import exact, unnested
from hingepair.symbolic.jets import MAX_BITS, SMOOTH, SYMPY_ERRORS, bits, time_symbol
from hingepair.symbolic.kinks import Expr, Larger, Remainder, Smaller, Where, constant_value, cosh, sinh, tanh

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
_INSTEAD: Final[Mapping[Any, str]] = {
    "^": "; a power is written **",
    "%": "; a remainder is written mod(x, period)",
    **dict.fromkeys((ast.Compare, ast.BoolOp, ast.UnaryOp), "a condition only in where(condition, x, y)"),
    ast.IfExp: "where(condition, x, y) for a choice",
    ast.Tuple: "one number or expression (decimals follow a point)",
}  # of a sign or a node
_TRIGONOMETRIC = ("sin", "cos", "tan")
_HYPERBOLIC: Final = {"sinh": sinh, "cosh": cosh, "tanh": tanh}  # of what SymPy does not know to be real
_A_NUMBER = "a finite real number"
_A_CONDITION = "a condition: comparisons by < <= > >=, joined by and, or, not"
_SHOWN, _FRAGMENT = 20, 40  # constants, and characters of the text, in a message
# 2t, 2 sin(t), (1 + t)(2 - t), pi t
_WORD = r"(?!(?:and|or|not|if|else)\b)[A-Za-z_]\w*+"
_NUMBER = r"(?<![\w.])(?<!\d[eE][-+])\d++(?:\.\d*+)?(?:[eE][-+]?\d++)?"
_SIDE_BY_SIDE = re.compile(rf"({_NUMBER}|\)|\b{_WORD}(?=\s+\w))\s*({_WORD}|\(|(?<=\s)\d)")


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


def constant(
    name: str, text: str, constants: Mapping[str, Number] | None = None, letters: Collection[str] = ()
) -> Expr:
    """Return the SymPy expression that a text without t stands for: `pi/6`. Arguments as for `parse`.

    Raises:
        ArgumentError: as for `parse`, or the text depends on t.
    """
    expr = parse(name, text, constants, letters)
    if time_symbol() in expr.free_symbols:
        raise ArgumentError(name, "a number: an expression without t", text)
    return expr


def constant_name_fault(name: str) -> str | None:
    """What is expected of a constant's name that this one is not; None for a good one."""
    if not (name.isascii() and name.isidentifier()) or keyword.iskeyword(name):
        return "a name of letters, digits and _"
    taken = ("t", *CONSTANTS, *SMOOTH)  # a constant named step or max is told from step(x) by its use
    return f"a name other than {', '.join(taken)}" if name in taken else None


_Function: TypeAlias = Callable[..., Any]
_Chain: TypeAlias = tuple[tuple[type, type], _Function, _Function, _Function]
"""Its signs, what puts it together exactly and in floats, and what its second sign does to a part."""
_SUM: Final = ((ast.Add, ast.Sub), sympy.Add, lambda *terms: math.fsum(terms), operator.neg)
_PRODUCT: Final = ((ast.Mult, ast.Div), sympy.Mul, lambda *factors: math.prod(factors), lambda x: 1 / x)


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
                return self._chain(node, depth + 1, _SUM)
            case ast.BinOp(op=ast.Mult() | ast.Div()):
                return self._chain(node, depth + 1, _PRODUCT)
            case ast.BinOp(op=ast.Pow()):
                return self._power(node, depth + 1)
            case ast.Call():
                return self._call(node, depth + 1)
        self._refuse(node, _INSTEAD.get(type(node), "numbers, names, calls and + - * / **"))

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

    def _chain(self, node: ast.expr, depth: int, kind: _Chain) -> _Part:
        """The sum `a - b + c`, or the product `a / b * c`: one level, however long."""
        signs, exact, rounded, inverse = kind
        found, inverts, place = [], False, node
        while True:
            if isinstance(place, ast.BinOp) and isinstance(place.op, signs):
                found.append((inverts ^ isinstance(place.op, signs[1]), place.right))
                place = place.left
            elif isinstance(place, ast.UnaryOp) and ast.Sub in signs and isinstance(place.op, ast.UAdd | ast.USub):
                inverts ^= isinstance(place.op, ast.USub)
                place = place.operand
            else:
                break
            self._count(place)
        parts = [(inverts, self.build(term, depth)) for inverts, term in reversed([*found, (inverts, place)])]
        own = [self._apply(node, inverse, inverse, part) if inverts else part for inverts, part in parts]
        return self._apply(node, exact, rounded, *own)

    def _power(self, node: ast.BinOp, depth: int) -> _Part:
        base, exponent = self.build(node.left, depth), self.build(node.right, depth)
        self._check_power(node, base.expr, exponent.expr)
        return self._apply(node, sympy.Pow, math.pow, base, exponent)

    def _call(self, node: ast.Call, depth: int) -> _Part:
        if not isinstance(node.func, ast.Name):
            self._refuse(node, f"the name of a function before the bracket{self._hint()}")
        name = node.func.id
        if name not in FUNCTIONS:
            if name == "t" or name in self.constants:
                self._refuse(node, f"{name}*(...)")
            self._unknown(node.func)
        call, count = FUNCTIONS[name], len(node.args)
        if node.keywords or (count < 2 if call.endswith("...)") else count != call.count(",") + 1):
            self._refuse(node, call)
        kinked = _KINKED.get(call)
        first = _Part(self._guard(node.args[0], depth), None) if kinked is Where else self.build(node.args[0], depth)
        parts = [first, *(self.build(argument, depth) for argument in node.args[1:])]
        if kinked is not None:
            if kinked is Remainder and not (parts[1].value or 0) > 0:
                self._refuse(node, f"{call} with a period above 0 that does not depend on t")
            return self._finish(node, kinked(*(part.expr for part in parts)))
        if name == "exp":  # SymPy turns exp(c*log(b)) into b**c
            for term in sympy.Add.make_args(parts[0].expr):
                factor, rest = term.as_coeff_Mul()
                if isinstance(rest, sympy.log):
                    self._check_power(node, rest.args[0], factor)
        function, is_constant = getattr(sympy, name), None not in [part.value for part in parts]
        if is_constant and name == "atan2":  # SymPy may try for minutes
            function = functools.partial(function, evaluate=False)
        elif is_constant and name in _TRIGONOMETRIC:
            function = functools.partial(unnested, function)
        elif not is_constant and name in _HYPERBOLIC and not parts[0].expr.is_extended_real:
            function = _HYPERBOLIC[name]
        return self._apply(node, function, getattr(math, name), *parts)

    def _guard(self, node: ast.expr, depth: int) -> Expr:
        """What is at least 0 where a condition holds."""
        self._count(node, depth)
        match node:
            case ast.BoolOp():
                guards = [self._guard(operand, depth + 1) for operand in node.values]
                return _of_many(Smaller if isinstance(node.op, ast.And) else Larger, guards)
            case ast.UnaryOp(op=ast.Not()):
                return _negated(self._guard(node.operand, depth + 1))
            case ast.Compare() if all(isinstance(sign, ast.Lt | ast.LtE | ast.Gt | ast.GtE) for sign in node.ops):
                sides = [self.build(side, depth + 1).expr for side in (node.left, *node.comparators)]
                guards = []
                for sign, left, right in zip(node.ops, sides[:-1], sides[1:], strict=True):
                    guard = right - left if isinstance(sign, ast.LtE | ast.Gt) else left - right
                    guards.append(_negated(guard) if isinstance(sign, ast.Lt | ast.Gt) else guard)
                return _of_many(Smaller, guards)
        self._refuse(node, _A_CONDITION)

    def _apply(self, node: ast.expr, exact: _Function, rounded: _Function, *parts: _Part) -> _Part:
        """A function of parts: in floats first, which shows what is not finite before SymPy tries it exactly."""
        exprs, values = zip(*parts, strict=True)
        try:
            value = None if None in values else rounded(*values)
        except (ArithmeticError, ValueError):
            self._refuse(node, _A_NUMBER)
        return self._finish(node, exact(*exprs), value)

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
        found = _SIDE_BY_SIDE.search(self.text)
        if found and found[1] in FUNCTIONS:
            call = f"{found[1]}({found[2]})" if found[1] in SMOOTH else FUNCTIONS[found[1]]
            return f"; a function is called as {call}"
        if found and found[2].startswith("deg"):
            return f"; degrees are written {found[1][:_FRAGMENT]}*pi/180"
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
        error = ArgumentError(self.name, ", ".join(names), got)
        error.args = (f"{self.name}: {got}; known: {error.expected}",)
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
