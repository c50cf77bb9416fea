"""Parser of expressions in t, from text to a tree of operations, without running the text.

Python's own parser makes the syntax tree, whose nodes are converted one by one; only the functions and names listed
here are known. Constant parts are computed at once: decimals exactly, so that 0.1*3 is 0.3, functions as floats.
"""

from __future__ import annotations

import ast
import keyword
import math
import operator
import re
import warnings
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from fractions import Fraction
from types import MappingProxyType
from typing import Any, Final, NoReturn, TypeAlias

from hingepair.errors import ArgumentError, line_with_caret, nearest

MAX_CHARACTERS: Final = 10_000
"""Largest number of characters of a text."""
MAX_DEPTH: Final = 200
"""Largest number of terms of a sum or factors of a product; a call, a power or a condition counts as four."""
MAX_NODES: Final = 3_000
"""Largest number of numbers, names and operations, those of constants included."""
MAX_EXPONENT: Final = 1_000
"""Largest size of the exponent of a power, and of the exponent of ten in a decimal number."""
MAX_ROOT: Final = 10_000
"""Largest denominator of the exponent of a power: t**0.1234 has 5000."""
_MAX_BITS = 4_096  # of an exact number; a longer one becomes a float

SMOOTH_FUNCTIONS: Final = (
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh"),
    *("asinh", "acosh", "atanh", "exp", "log", "sqrt"),
)
"""Names of functions that math, NumPy and SymPy share."""

CALLS: Final = MappingProxyType(
    {name: "atan2(y, x)" if name == "atan2" else f"{name}(x)" for name in SMOOTH_FUNCTIONS}
    | {
        "abs": "abs(x)",
        "sign": "sign(x)",
        "min": "min(x, y, ...)",
        "max": "max(x, y, ...)",
        "clip": "clip(x, lowest, highest)",
        "mod": "mod(x, period)",
        "where": "where(t < 1, x, y)",
        "step": "step(x)",
        "ramp": "ramp(x)",
        "deg": "deg(x)",
    }
)
"""Calls of all functions, by name, as messages show them; their commas count the arguments."""

_HINTS: Final = MappingProxyType({  # names that are known from elsewhere, as they are written here
    **dict.fromkeys(("degrees", "deg2rad", "radians", "rad"), "degrees are written deg(30)"),
    **dict.fromkeys(("piecewise", "Piecewise", "ifelse"), "where(condition, x, y)"),
    **dict.fromkeys(("heaviside", "Heaviside"), "step(x)"),
    **{f"arc{name}": f"a{name}(x)" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    "arctan2": "atan2(y, x)",
    "ln": "log(x)",
    "T": "t",
})  # fmt: skip

_FORBIDDEN = re.compile(r"[^\w+*/().,<>=\s-]", re.ASCII)  # a character that no expression has
_INSTEAD: Final[Mapping[type[ast.expr], str]] = {  # what is expected in place of nodes that are not allowed
    **dict.fromkeys((ast.Compare, ast.BoolOp, ast.UnaryOp), "a condition only in where(condition, x, y)"),
    ast.IfExp: "where(condition, x, y) for a choice",
    ast.Tuple: "one number or expression (decimals follow a point)",
}
_SPELLING: Final = (
    "; products are written 2*t, powers t**2, remainders mod(t, 2), angles in degrees deg(30), 5 millimetres 5e-3, "
    "a choice where(t < 1, x, y)"
)
"""End of messages on texts that are no expression."""
_FINITE = "a finite real number"  # what messages expect of a constant
_MAX_SHOWN = 40  # characters of the text in a message
_U = 2.0**-53  # half the distance of 1 to the next float

Number: TypeAlias = "Fraction | float"
"""Value without t: exact, or a float."""


@dataclass(frozen=True, slots=True, eq=False)
class Expression:
    """Expression in t: an operation on parts, or a leaf."""

    #: add, mul, div, pow, a function, a comparison <= or < of its part with 0, and, or, not; of a leaf "number" or a
    #: name
    operation: str
    parts: tuple[Expression, ...] = ()
    #: the value if the expression contains neither t nor symbols; of a condition True or False
    constant: Number | None = None
    #: numbers, names and operations as they are written
    nodes: int = 1

    @property
    def names(self) -> frozenset[str]:
        """Names of the symbols: t and those that have no value."""
        if self.constant is not None:
            return frozenset()
        if not self.parts:
            return frozenset({self.operation})
        return frozenset().union(*(part.names for part in self.parts))

    def __float__(self) -> float:
        if self.constant is None:
            raise TypeError("the expression depends on t")
        try:
            return float(self.constant)
        except OverflowError:
            return math.inf if self.constant > 0 else -math.inf


BUILTIN_CONSTANTS: Final = MappingProxyType(
    {name: Expression(name, (), value) for name, value in (("pi", math.pi), ("tau", math.tau), ("e", math.e))}
)
"""Constants that every expression knows, by name."""


def number(value: Number) -> Expression:
    """Return a finite number as an expression; of a float, the number that its shortest decimal form shows."""
    return Expression("number", (), Fraction(repr(float(value))) if isinstance(value, float) else Fraction(value))


def parse_expression(
    name: str, text: str, constants: Mapping[str, float | Expression] | None = None, symbols: Collection[str] = ()
) -> Expression:
    """Return an expression in t.

    The text may hold numbers, `+ - * / **`, parentheses, t, pi, tau, e, the given constants and the functions of
    CALLS.

    Args:
        name: name of the expression, for messages: `motion.psi`.
        text: the expression.
        constants: values of further names, finite numbers or expressions; see `constant_name_fault`.
        symbols: further names, which stay symbols.

    Raises:
        ArgumentError: the text is no such expression, has a constant part that is not a finite real number, or is too
            long or too deep.

    >>> float(parse_expression("psi", "0.1*amplitude", {"amplitude": 3}))
    0.3
    """
    builder = _Builder(name, text, constants or {}, symbols)
    return builder.build(builder.syntax(), 0)


def parse_constant(
    name: str, text: str, constants: Mapping[str, float | Expression] | None = None, symbols: Collection[str] = ()
) -> Expression:
    """Return an expression without t, such as `pi/6`, as `parse_expression` does.

    Raises:
        ArgumentError: as for `parse_expression`, or the text depends on t.
    """
    expression = parse_expression(name, text, constants, symbols)
    if "t" in expression.names:
        raise ArgumentError(name, "a number: an expression without t", text)
    return expression


def in_radians(degrees: Expression) -> Expression:
    """Return an angle that is given in degrees."""
    return parse_expression("angle", "deg(angle)", {"angle": degrees})


def constant_name_fault(name: str) -> str | None:
    """Return a phrase on the names that are allowed if `name` cannot be that of a constant, else None."""
    if not (name.isascii() and name.isidentifier()) or keyword.iskeyword(name):
        return "a name of letters, digits and _"
    # A constant may be called step or max: step(x) is a call.
    taken = ("t", *BUILTIN_CONSTANTS, *SMOOTH_FUNCTIONS)
    return f"a name other than {', '.join(taken)}" if name in taken else None


class _Builder:
    """Converter of one text to an Expression; its errors name the expression and show the text with a caret."""

    def __init__(
        self, name: str, text: str, constants: Mapping[str, float | Expression], symbols: Collection[str]
    ) -> None:
        self.name = name
        self.line = re.sub(r"\s", " ", text, flags=re.ASCII)
        self.text = self.line.strip(" ")
        self.names: dict[str, float | Expression] = {
            "t": Expression("t"),
            **BUILTIN_CONSTANTS,
            **constants,
            **{key: Expression(key) for key in symbols},
        }
        self.column = 1 + len(self.line) - len(self.line.lstrip(" "))
        self.nodes = 0

    def syntax(self) -> ast.expr:
        """Return the syntax tree of the text; line breaks count as spaces."""
        if len(self.line) > MAX_CHARACTERS:
            self._fail(f"at most {MAX_CHARACTERS} characters", f"{len(self.line)}")
        if forbidden := _FORBIDDEN.search(self.line):
            column = forbidden.start() + 1
            self._fail(f"an expression in t{_SPELLING}", f"character {forbidden[0]!r} at column {column}", column)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return ast.parse(self.text, mode="eval").body
        except SyntaxError as error:
            if not self.text:
                self._fail("an expression in t", "''")
            column = self.column + (error.offset or len(self.text) + 1) - 1  # without offset the error is at the end
            problem = error.msg if error.offset else "an end where something is missing"
            self._fail(f"an expression in t{_SPELLING}", f"{problem} at column {column}", column)
        except (ValueError, MemoryError, RecursionError):
            self._fail("an expression of fewer parts", self.text)

    def build(self, node: ast.expr, depth: int) -> Expression:
        """Return the expression of a syntax node that stands in so many parentheses, calls and powers."""
        self._count(node, depth)
        match node:
            case ast.Constant():
                return self._number(node)
            case ast.Name():
                return self._name(node)
            case ast.UnaryOp(op=ast.UAdd() | ast.USub()):
                x = self.build(node.operand, depth + 1)
                return self._negative(node, x) if isinstance(node.op, ast.USub) else x
            case ast.BinOp(op=ast.Add() | ast.Sub() | ast.Mult() | ast.Div() | ast.Pow()):
                depth += 4 if isinstance(node.op, ast.Pow) else 1
                return self._binary(node, self.build(node.left, depth), self.build(node.right, depth))
            case ast.Call():
                return self._call(node, depth + 4)
        self._refuse(node, _INSTEAD.get(type(node), "numbers, names, calls and + - * / **"))

    def _number(self, node: ast.Constant) -> Expression:
        """Return a number, exactly as it is written; refuse one that is too long."""
        if type(node.value) not in {int, float} or node.value == math.inf:
            self._refuse(node, _FINITE)
        source = self._source_of(node) if isinstance(node.value, float) else str(node.value)
        if abs(int(source.lower().partition("e")[2] or 0)) > MAX_EXPONENT:
            self._refuse(node, f"a power of ten of at most {MAX_EXPONENT}")
        return self._operation(node, "number", (), Fraction(source))

    def _name(self, node: ast.Name) -> Expression:
        """Return t, a symbol or the value of a constant; refuse unknown names, and functions without a call."""
        if node.id in self.names:
            value = self.names[node.id]
            if not isinstance(value, Expression):
                return number(value)
            self._count(node, count=value.nodes - 1)
            return value
        if node.id in CALLS:
            self._refuse(node, CALLS[node.id])
        self._refuse_name(node)

    def _negative(self, node: ast.expr, x: Expression) -> Expression:
        return self._operation(node, "mul", (_MINUS_ONE, x))

    def _binary(self, node: ast.BinOp, x: Expression, y: Expression) -> Expression:
        """Return a sum, a product or a power; refuse a power that takes too long, or has a varying exponent and no
        base above 0.
        """
        match node.op:
            case ast.Sub():
                return self._operation(node, "add", (x, self._negative(node, y)))
            case ast.Div() if y.constant is not None and x.constant is None:
                return self._operation(node, "mul", (x, self._operation(node, "div", (_ONE, y))))
            case ast.Pow():
                if y.constant is None and x.constant is not None and x.constant <= 0:
                    self._refuse(node, "a base above 0 where the exponent varies")
                k = y.constant
                if isinstance(k, Fraction) and (abs(k) > MAX_EXPONENT or k.denominator > MAX_ROOT):
                    self._refuse(node, f"an exponent of at most {MAX_EXPONENT}, with at most 4 decimals")
        return self._operation(node, _BINARY[type(node.op)], (x, y))

    def _call(self, node: ast.Call, depth: int) -> Expression:
        """Return the value of a function; refuse what is none, and another number of arguments than in CALLS."""
        if not isinstance(node.func, ast.Name):
            self._refuse(node, f"the name of a function before the parenthesis{_SPELLING}")
        name = node.func.id
        if name not in CALLS:
            if name in self.names:
                self._refuse(node, f"{name}*(...)")
            self._refuse_name(node.func)
        call, count = CALLS[name], len(node.args)
        if node.keywords or (count < 2 if call.endswith("...)") else count != call.count(",") + 1):
            self._refuse(node, call)
        if name == "where":
            condition = self._condition(node.args[0], depth)
            return self._choice(node, condition, *(self.build(part, depth) for part in node.args[1:]))
        parts = tuple(self.build(argument, depth) for argument in node.args)
        match name:
            case "step":
                return self._choice(node, self._operation(node, "<=", (self._negative(node, parts[0]),)), _ONE, _ZERO)
            case "ramp":
                name, parts = "max", (parts[0], _ZERO)
            case "clip":
                name, parts = "min", (self._operation(node, "max", parts[:2]), parts[2])
            case "deg":
                in_turns = self._operation(node, "mul", (*parts, number(Fraction(1, 180))))
                return self._operation(node, "mul", (in_turns, BUILTIN_CONSTANTS["pi"]))
            case "mod" if parts[1].constant is None or parts[1].constant <= 0:
                self._refuse(node, f"{call} with a period above 0 that does not depend on t")
        return self._operation(node, name, parts)

    def _choice(self, node: ast.expr, condition: Expression, x: Expression, y: Expression) -> Expression:
        """Return x where a condition holds and y elsewhere."""
        if condition.constant is not None:
            return x if condition.constant else y
        return self._operation(node, "where", (condition, x, y))

    def _condition(self, node: ast.expr, depth: int) -> Expression:
        """Return the expression of a condition, such as `0 <= t < 1`."""
        self._count(node, depth)
        match node:
            case ast.BoolOp():
                parts = tuple(self._condition(operand, depth + 1) for operand in node.values)
                return self._operation(node, "and" if isinstance(node.op, ast.And) else "or", parts)
            case ast.UnaryOp(op=ast.Not()):
                return self._operation(node, "not", (self._condition(node.operand, depth + 1),))
            case ast.Compare() if all(isinstance(sign, ast.Lt | ast.LtE | ast.Gt | ast.GtE) for sign in node.ops):
                sides = [self.build(side, depth + 1) for side in (node.left, *node.comparators)]
                parts = ()
                for sign, left, right in zip(node.ops, sides[:-1], sides[1:], strict=True):
                    low, high = (left, right) if isinstance(sign, ast.Lt | ast.LtE) else (right, left)
                    difference = self._operation(node, "add", (low, self._negative(node, high)))
                    comparison = "<" if isinstance(sign, ast.Lt | ast.Gt) else "<="
                    parts = (*parts, self._operation(node, comparison, (difference,)))
                return parts[0] if len(parts) == 1 else self._operation(node, "and", parts)
        self._refuse(node, "a condition: comparisons by < <= > >=, joined by and, or, not")

    def _operation(
        self, node: ast.expr, operation: str, parts: tuple[Expression, ...], constant: Number | None = None
    ) -> Expression:
        """Return an operation on parts, with its value if all parts have one; refuse a value that is not finite."""
        values = [part.constant for part in parts if part.constant is not None]
        if len(values) < len(parts):
            return Expression(operation, parts)
        try:
            value = _CONSTANT[operation](*values) if constant is None else constant
            if isinstance(value, Fraction) and _bits(value) > _MAX_BITS:
                value = float(value)
            if not math.isfinite(float(value)):
                self._refuse(node, _FINITE)
        except (ArithmeticError, ValueError, TypeError):  # TypeError: a complex power
            self._refuse(node, _FINITE)
        return Expression(operation, parts, value, 1 + sum(part.nodes for part in parts))

    def _count(self, node: ast.expr, depth: int = 0, count: int = 1) -> None:
        """Add `count` to the numbers, names and operations so far; refuse too many, or too deep a node."""
        self.nodes += count
        if self.nodes > MAX_NODES:
            self._refuse(node, f"at most {MAX_NODES} numbers, names and operations, with constants written out")
        if depth > MAX_DEPTH:
            self._refuse(node, f"at most {MAX_DEPTH} terms, or {MAX_DEPTH // 4} levels of calls and powers")

    def _source_of(self, node: ast.expr) -> str:
        return self.text[node.col_offset : node.end_col_offset]

    def _refuse(self, node: ast.expr, expected: str) -> NoReturn:
        """Raise an ArgumentError on a syntax node, in whose place `expected` was expected."""
        source = self._source_of(node)
        shown = source if len(source) <= _MAX_SHOWN else source[: _MAX_SHOWN - 3] + "..."
        column = self.column + node.col_offset
        self._fail(expected, f"{shown} at column {column}", column)

    def _refuse_name(self, node: ast.Name) -> NoReturn:
        """Raise an ArgumentError on an unknown name, with a hint and the names that are known."""
        given = [name for name in self.names if name != "t"]
        names = (
            *CALLS,
            "t",
            *given[: len(BUILTIN_CONSTANTS) + 20],
        )  # more than 20 of the user's are too many to read
        column, short = self.column + node.col_offset, node.id[:_MAX_SHOWN]
        hint = f" ({_HINTS[short]})" if short in _HINTS else nearest(short, names)
        got = f"unknown name '{short}' at column {column}{hint}"
        error = ArgumentError(self.name, ", ".join(names), got)
        error.said = f"{got}; known: {error.expected}"
        error.add_note(line_with_caret(self.line, column))
        raise error

    def _fail(self, expected: str, got: str, column: int | None = None) -> NoReturn:
        """Raise an ArgumentError, with a note that shows the text with a caret at a column, counted from 1."""
        error = ArgumentError(self.name, expected, got)
        if column is not None:
            error.add_note(line_with_caret(self.line, column))
        raise error from None


_ZERO, _ONE, _MINUS_ONE = number(0), number(1), number(-1)
_BINARY: Final = {ast.Add: "add", ast.Mult: "mul", ast.Div: "div", ast.Pow: "pow"}


# ---- values of constant parts


def _bits(value: Fraction) -> int:
    return max(value.numerator.bit_length(), value.denominator.bit_length())


def _power(base: Number, exponent: Number) -> Number:
    """Return a power, exact where it is short; a complex one raises a ValueError."""
    rough = math.pow(base, exponent)  # raises an OverflowError before many digits are computed
    if isinstance(base, Fraction) and isinstance(exponent, Fraction) and exponent.denominator == 1:
        return Fraction(base**exponent) if _bits(base) * abs(exponent) <= _MAX_BITS else rough
    return rough


def _remainder(x: Number, period: Number) -> Number:
    """Return the remainder; 0 of a multiple of the period within rounding, as in mod(3*pi, pi)."""
    if isinstance(x, Fraction) and isinstance(period, Fraction):
        return x % period
    periods = float(x) / float(period)
    return Fraction(0) if abs(periods - round(periods)) <= 4 * _U * (1 + abs(periods)) else float(x) % float(period)


def constant_sine(angle: Number) -> float:
    """Return the sine of an angle [rad]; 0 where the angle is a multiple of pi within rounding."""
    return 0.0 if _is_rounding(math.sin(angle), angle) else math.sin(angle)


def constant_cosine(angle: Number) -> float:
    """Return the cosine of an angle [rad]; 0 where the angle is an odd multiple of pi/2 within rounding."""
    return 0.0 if _is_rounding(math.cos(angle), angle) else math.cos(angle)


def _tangent(angle: Number) -> float:
    if not constant_cosine(angle):
        raise ValueError("a pole")
    return 0.0 if not constant_sine(angle) else math.tan(angle)


def _is_rounding(value: float, angle: Number) -> bool:
    return not isinstance(angle, Fraction) and abs(value) <= 2 * _U * abs(angle)


_CONSTANT: Final[Mapping[str, Callable[..., Any]]] = {  # values of operations on constants
    **{name: getattr(math, name) for name in SMOOTH_FUNCTIONS},
    "sin": constant_sine,
    "cos": constant_cosine,
    "tan": _tangent,
    "add": operator.add,
    "mul": operator.mul,
    "div": operator.truediv,
    "pow": _power,
    "mod": _remainder,
    "abs": abs,
    "min": min,
    "max": max,
    "sign": lambda x: Fraction((x > 0) - (x < 0)),
    "<=": lambda x: x <= 0,
    "<": lambda x: x < 0,
    "not": operator.not_,
    "and": lambda *parts: all(parts),
    "or": lambda *parts: any(parts),
}
