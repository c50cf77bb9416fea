"""Parser of expressions in t, from text to SymPy, without running the text.

Python's own parser makes the syntax tree, whose nodes are converted one by one; only the functions and names listed
here become SymPy. Numbers stay exact: 0.1 is 1/10, so no digit is lost before the last step. Expressions that would
take too long or too much memory are refused before they are computed.
"""

from __future__ import annotations

import ast
import functools
import keyword
import math
import operator
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from fractions import Fraction
from types import MappingProxyType
from typing import Any, Final, NamedTuple, NoReturn, TypeAlias

import sympy

from hingepair.errors import ArgumentError, line_with_caret, nearest
from hingepair.symbolic.exact_constants import exact, value_without_nested_roots
from hingepair.symbolic.jets import (
    MAX_EXACT_NUMBER_BITS,
    SMOOTH_FUNCTION_NAMES,
    SYMPY_ERROR_TYPES,
    bit_length,
    time_symbol,
)
from hingepair.symbolic.kinks import Expr, Larger, Remainder, Smaller, Where, constant_value, cosh, sinh, tanh

MAX_EXPRESSION_CHARACTERS: Final = 10_000
"""Largest number of characters of a text."""
MAX_EXPRESSION_NESTING_DEPTH: Final = 50
"""Largest number of nested parentheses, calls and powers; a sum or a product of any length is one level."""
MAX_EXPRESSION_SYNTAX_NODES: Final = 3_000
"""Largest number of numbers, names and operations, those of constants included. It bounds the steps that compute the
derivatives too.
"""
MAX_ABSOLUTE_EXPONENT: Final = 1_000
"""Largest size of the exponent of a power, and of the exponent of ten in a decimal number."""
MAX_EXPONENT_DENOMINATOR: Final = 10_000
"""Largest denominator of an exponent: t**0.1234 has 5000."""

_OWN_FUNCTION_BY_SIGNATURE: Final[Mapping[str, Callable[..., Expr]]] = MappingProxyType({
    "abs(x)": sympy.Abs,
    "sign(x)": sympy.sign,
    "min(x, y, ...)": lambda *parts: _nest_by_halves(Smaller, parts),
    "max(x, y, ...)": lambda *parts: _nest_by_halves(Larger, parts),
    "clip(x, lowest, highest)": lambda x, lowest, highest: Smaller(Larger(x, lowest), highest),
    "mod(x, period)": Remainder,
    "where(t < 1, x, y)": Where,
    "step(x)": lambda x: Where(x, 1, 0),
    "ramp(x)": lambda x: Larger(x, 0),
    "deg(x)": lambda x: x * sympy.pi / 180,
})  # fmt: skip
"""Functions that SymPy has not, or not as they are wanted here, by their call."""

_HINT_BY_UNKNOWN_NAME: Final = MappingProxyType({
    **dict.fromkeys(("degrees", "deg2rad", "radians", "rad"), "degrees are written deg(30)"),
    **dict.fromkeys(("piecewise", "Piecewise", "ifelse"), "where(condition, x, y)"),
    **dict.fromkeys(("heaviside", "Heaviside"), "step(x)"),
    **{f"arc{name}": f"a{name}(x)" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh")},
    "arctan2": "atan2(y, x)",
    "ln": "log(x)",
    "T": "t",
})  # fmt: skip
"""Hints for names that are known from elsewhere: how they are written here."""

FUNCTION_SIGNATURE_BY_NAME: Final = MappingProxyType(
    {name: "atan2(y, x)" if name == "atan2" else f"{name}(x)" for name in SMOOTH_FUNCTION_NAMES}
    | {call.partition("(")[0]: call for call in _OWN_FUNCTION_BY_SIGNATURE}
)
"""Calls of all functions, by name."""

BUILTIN_SYMPY_CONSTANT_BY_NAME: Final = MappingProxyType({"pi": sympy.pi, "tau": 2 * sympy.pi, "e": sympy.E})
"""Constants that every expression knows, by name."""

Number: TypeAlias = float | Expr
"""Value of a constant."""

_FORBIDDEN_CHARACTER_PATTERN = re.compile(r"[^\w+*/().,<>=\s-]", re.ASCII)  # in a text
_HINT_BY_FORBIDDEN_CHARACTER: Final = {
    "^": "; a power is written **",
    "%": "; a remainder is written mod(x, period)",
}  # how the operation of the character is written instead
_EXPECTED_TEXT_BY_REFUSED_SYNTAX_NODE_TYPE: Final[Mapping[type[ast.expr], str]] = {
    **dict.fromkeys((ast.Compare, ast.BoolOp, ast.UnaryOp), "a condition only in where(condition, x, y)"),
    ast.IfExp: "where(condition, x, y) for a choice",
    ast.Tuple: "one number or expression (decimals follow a point)",
}  # what is expected in place of a node of a type that is not allowed
_REAL_HYPERBOLIC_FUNCTION_BY_NAME: Final = {
    "sinh": sinh,
    "cosh": cosh,
    "tanh": tanh,
}  # used for arguments that SymPy does not know to be real
_DOMAIN_GUARDS: Final[Mapping[type, Callable[[Expr], Expr]]] = {
    sympy.log: lambda x: x,
    sympy.asin: lambda x: 1 - x**2,
    sympy.acos: lambda x: 1 - x**2,
    sympy.atanh: lambda x: 1 - x**2,
    sympy.acosh: lambda x: x - 1,
}  # at least 0 where the function is real
_EXPECTED_FINITE_NUMBER_TEXT = "a finite real number"  # in messages
_MAX_GIVEN_CONSTANT_NAMES_IN_UNKNOWN_NAME_MESSAGE = 20  # beside the built-in ones
_MAX_FRAGMENT_CHARACTERS_IN_MESSAGE = 40  # characters of the text in a message
# A word other than an operator.
_OPERAND_WORD_PATTERN_TEXT = r"(?!(?:and|or|not|if|else)\b)[A-Za-z_]\w*+"
# A number.
_NUMBER_PATTERN_TEXT = r"(?<![\w.])(?<!\d[eE][-+])\d++(?:\.\d*+)?(?:[eE][-+]?\d++)?"
# Two operands without an operator between them: 2t, 2 sin(t), (1 + t)(2 - t), pi t.
_MISSING_OPERATOR_PATTERN = re.compile(
    rf"({_NUMBER_PATTERN_TEXT}|\)|\b{_OPERAND_WORD_PATTERN_TEXT}(?=\s+\w))\s*({_OPERAND_WORD_PATTERN_TEXT}|\(|(?<=\s)\d)"
)


def parse_expression(
    name: str, text: str, constants: Mapping[str, Number] | None = None, symbols: Collection[str] = ()
) -> Expr:
    """Parse an expression in t, the string `text`, and return it as a SymPy expression. Names in the dict `constants`
    are replaced by their values, and names in `symbols` stay symbols. Raise an ArgumentError, whose message names the
    expression by `name`, if the string is not an allowed expression.

    The text may hold numbers, `+ - * / **`, parentheses, t, pi, tau, e, the given constants and the functions of
    FUNCTION_SIGNATURE_BY_NAME; decimal numbers are exact.

    Args:
        name: name of the expression, for messages: `motion.psi`.
        text: the expression.
        constants: values of further names, finite numbers or expressions without t; see `constant_name_fault`.
        symbols: further names, which stay symbols.

    Raises:
        ArgumentError: the text is no such expression, has a constant part that is not a finite real number, or is too
            long or too deep.

    >>> parse_expression("psi", "amplitude*sin(2*pi*t) + 0.1", {"amplitude": 0.25})
    sin(2*pi*t)/4 + 1/10
    >>> parse_expression("psi", "where(0 <= t <= 1, abs(t - 0.5), 0)")
    Where(Smaller(t, 1 - t), Abs(t - 1/2), 0)
    """
    builder = _ExpressionBuilder(name, text, constants or {}, symbols)
    try:
        return builder.build(builder.syntax(), 0).expr
    except ArgumentError:
        raise
    except SYMPY_ERROR_TYPES:
        raise ArgumentError(name, "an expression that SymPy can work with", text) from None


def parse_constant(
    name: str, text: str, constants: Mapping[str, Number] | None = None, symbols: Collection[str] = ()
) -> Expr:
    """Parse an expression without t, the string `text`, such as `pi/6`, and return it as a SymPy expression. Names in
    the dict `constants` are replaced by their values, and names in `symbols` stay symbols. Raise an ArgumentError,
    whose message names the constant by `name`, if the string depends on t or cannot be parsed.

    Raises:
        ArgumentError: as for `parse_expression`, or the text depends on t.
    """
    expr = parse_expression(name, text, constants, symbols)
    if time_symbol() in expr.free_symbols:
        raise ArgumentError(name, "a number: an expression without t", text)
    return expr


def constant_name_fault(name: str) -> str | None:
    """Return None if `name` can be the name of a constant; otherwise return a string that describes the allowed
    names.
    """
    if not (name.isascii() and name.isidentifier()) or keyword.iskeyword(name):
        return "a name of letters, digits and _"
    taken = (
        "t",
        *BUILTIN_SYMPY_CONSTANT_BY_NAME,
        *SMOOTH_FUNCTION_NAMES,
    )  # a constant may be called step or max: step(x) is a call
    return f"a name other than {', '.join(taken)}" if name in taken else None


_Function: TypeAlias = Callable[..., Any]


class _OperatorGroup(NamedTuple):
    """The operators + and -, or * and /, which form one sum or product with all their operands. `node_types` are the
    classes of the two operators in the syntax tree; the functions `operate_exactly` and `operate_on_floats` add or
    multiply all operands. The function `invert` is applied first to operands that follow - or /.
    """

    node_types: tuple[type[ast.operator], type[ast.operator]]
    operate_exactly: _Function
    operate_on_floats: _Function
    invert: _Function


# + and -.
_SUM_OPERATOR_GROUP: Final = _OperatorGroup(
    (ast.Add, ast.Sub), sympy.Add, lambda *terms: math.fsum(terms), operator.neg
)
# * and /.
_PRODUCT_OPERATOR_GROUP: Final = _OperatorGroup(
    (ast.Mult, ast.Div), sympy.Mul, lambda *factors: math.prod(factors), lambda x: 1 / x
)


class _ParsedSubexpression(NamedTuple):
    """Parsed subexpression: `expr` is its SymPy expression, and `value` is its float, or None if it depends on t or
    on symbols.
    """

    expr: Expr
    value: float | None


class _ExpressionBuilder:
    """Converter of one expression, given as a string, to a SymPy expression: `syntax` returns the syntax tree of the
    string, and `build` converts a syntax node to a _ParsedSubexpression. Its errors name the expression and show the
    string with a caret.
    """

    def __init__(self, name: str, text: str, constants: Mapping[str, Number], symbols: Collection[str]) -> None:
        self.name = name
        self.line = re.sub(r"\s", " ", text, flags=re.ASCII)
        self.text = self.line.strip(" ")
        self.constants = {
            **BUILTIN_SYMPY_CONSTANT_BY_NAME,
            **constants,
            **{key: sympy.Symbol(key, real=True) for key in symbols},
        }
        self.column = 1 + len(self.line) - len(self.line.lstrip(" "))
        self.nodes = 0

    def syntax(self) -> ast.expr:
        """Return the syntax tree of the string that is converted; line breaks count as spaces. Raise an ArgumentError
        if the string is too long, contains a forbidden character, or has invalid syntax.
        """
        if len(self.line) > MAX_EXPRESSION_CHARACTERS:
            self._fail(f"at most {MAX_EXPRESSION_CHARACTERS} characters", f"{len(self.line)}")
        if forbidden := _FORBIDDEN_CHARACTER_PATTERN.search(self.line):
            column = forbidden.start() + 1
            hint = _HINT_BY_FORBIDDEN_CHARACTER.get(forbidden[0], "")
            self._fail(f"an expression in t{hint}", f"character {forbidden[0]!r} at column {column}", column)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return ast.parse(self.text, mode="eval").body
        except SyntaxError as error:
            if not self.text:
                self._fail("an expression in t", "''")
            column = self.column + (error.offset or len(self.text) + 1) - 1  # without offset the error is at the end
            problem = error.msg if error.offset else "an end where something is missing"
            self._fail(f"an expression in t{self._syntax_hint()}", f"{problem} at column {column}", column)
        except (ValueError, MemoryError, RecursionError):
            self._fail("an expression of fewer parts", self.text)

    def build(self, node: ast.expr, depth: int) -> _ParsedSubexpression:
        """Return the _ParsedSubexpression of a syntax node at a nesting depth. Raise an ArgumentError if the syntax
        is not allowed, if there are too many nodes, or if they are nested too deeply.
        """
        self._count_node(node, depth)
        match node:
            case ast.Constant():
                return self._build_number(node)
            case ast.Name():
                return self._build_name(node)
            case ast.BinOp(op=ast.Add() | ast.Sub()) | ast.UnaryOp(op=ast.UAdd() | ast.USub()):
                return self._build_chain(node, depth + 1, _SUM_OPERATOR_GROUP)
            case ast.BinOp(op=ast.Mult() | ast.Div()):
                return self._build_chain(node, depth + 1, _PRODUCT_OPERATOR_GROUP)
            case ast.BinOp(op=ast.Pow()):
                return self._build_power(node, depth + 1)
            case ast.Call():
                return self._build_call(node, depth + 1)
        self._refuse(
            node, _EXPECTED_TEXT_BY_REFUSED_SYNTAX_NODE_TYPE.get(type(node), "numbers, names, calls and + - * / **")
        )

    def _build_number(self, node: ast.Constant) -> _ParsedSubexpression:
        """Return the _ParsedSubexpression of a number, an exact rational. Raise an ArgumentError if the number is not
        finite, or if its power of ten is too large.
        """
        if type(node.value) not in {int, float} or node.value == math.inf:
            self._refuse(node, _EXPECTED_FINITE_NUMBER_TEXT)
        source = self._source_of(node) if isinstance(node.value, float) else str(node.value)
        if abs(int(source.lower().partition("e")[2] or 0)) > MAX_ABSOLUTE_EXPONENT:
            self._refuse(node, f"a power of ten of at most {MAX_ABSOLUTE_EXPONENT}")
        return self._checked_subexpression(node, sympy.Rational(Fraction(source)))

    def _build_name(self, node: ast.Name) -> _ParsedSubexpression:
        """Return the _ParsedSubexpression of a name: t, a constant or a symbol. Raise an ArgumentError for any other
        name.
        """
        if node.id == "t":
            return _ParsedSubexpression(time_symbol(), None)
        if node.id in self.constants:
            value = self.constants[node.id]
            if isinstance(value, sympy.Basic):
                self._count_nodes(node, sum(1 for _ in sympy.preorder_traversal(value)) - 1)
            return self._checked_subexpression(node, exact(value) if isinstance(value, int | float) else value)
        if node.id in FUNCTION_SIGNATURE_BY_NAME:
            self._refuse(node, FUNCTION_SIGNATURE_BY_NAME[node.id])
        self._refuse_name(node)

    def _build_chain(self, node: ast.expr, depth: int, operator_group: _OperatorGroup) -> _ParsedSubexpression:
        """Return the _ParsedSubexpression of the syntax node of a sum such as `a - b + c` or a product such as `a / b
        * c`; `operator_group` says which of the two it is. A chain of any length counts as one level of nesting.
        """
        node_types, operate_exactly, operate_on_floats, invert = operator_group
        inverted_operands, is_inverted, current = [], False, node
        while True:
            if isinstance(current, ast.BinOp) and isinstance(current.op, node_types):
                inverted_operands.append((is_inverted ^ isinstance(current.op, node_types[1]), current.right))
                current = current.left
            elif (
                isinstance(current, ast.UnaryOp)
                and ast.Sub in node_types
                and isinstance(current.op, ast.UAdd | ast.USub)
            ):
                is_inverted ^= isinstance(current.op, ast.USub)
                current = current.operand
            else:
                break
            self._count_node(current)
        parts = [
            (is_inverted, self.build(term, depth))
            for is_inverted, term in reversed([*inverted_operands, (is_inverted, current)])
        ]
        operands = [self._apply(node, invert, invert, part) if is_inverted else part for is_inverted, part in parts]
        return self._apply(node, operate_exactly, operate_on_floats, *operands)

    def _build_power(self, node: ast.BinOp, depth: int) -> _ParsedSubexpression:
        """Return the _ParsedSubexpression of the syntax node of a power at a nesting depth. Raise an ArgumentError if
        the exponent is too large.
        """
        base, exponent = self.build(node.left, depth), self.build(node.right, depth)
        self._check_power(node, base.expr, exponent.expr)
        return self._apply(node, sympy.Pow, math.pow, base, exponent)

    def _build_call(self, node: ast.Call, depth: int) -> _ParsedSubexpression:
        """Return the _ParsedSubexpression of the syntax node of a function call at a nesting depth. Raise an
        ArgumentError for an unknown function, a wrong number of arguments, or an argument that is not allowed.
        """
        if not isinstance(node.func, ast.Name):
            self._refuse(node, f"the name of a function before the parenthesis{self._syntax_hint()}")
        name = node.func.id
        if name not in FUNCTION_SIGNATURE_BY_NAME:
            if name == "t" or name in self.constants:
                self._refuse(node, f"{name}*(...)")
            self._refuse_name(node.func)
        call, count = FUNCTION_SIGNATURE_BY_NAME[name], len(node.args)
        if node.keywords or (count < 2 if call.endswith("...)") else count != call.count(",") + 1):
            self._refuse(node, call)
        own_function = _OWN_FUNCTION_BY_SIGNATURE.get(call)
        first = (
            _ParsedSubexpression(self._build_guard(node.args[0], depth), None)
            if own_function is Where
            else self.build(node.args[0], depth)
        )
        parts = [first, *(self.build(argument, depth) for argument in node.args[1:])]
        if own_function is not None:
            if own_function is Remainder and not (parts[1].value or 0) > 0:
                self._refuse(node, f"{call} with a period above 0 that does not depend on t")
            exprs = [part.expr for part in parts]
            expr = own_function(*exprs)
            return self._checked_subexpression(node, expr if own_function is Where else _keep_domains(expr, exprs))
        if name == "exp":  # SymPy turns exp(c*log(b)) into b**c
            for term in sympy.Add.make_args(parts[0].expr):
                factor, rest = term.as_coeff_Mul()
                if isinstance(rest, sympy.log):
                    self._check_power(node, rest.args[0], factor)
        function, is_constant = getattr(sympy, name), None not in [part.value for part in parts]
        if is_constant and name == "atan2":  # evaluation may take SymPy minutes
            function = functools.partial(function, evaluate=False)
        elif is_constant and name in ("sin", "cos", "tan"):  # their values may have nested roots
            function = functools.partial(value_without_nested_roots, function)
        elif not is_constant and name in _REAL_HYPERBOLIC_FUNCTION_BY_NAME and not parts[0].expr.is_extended_real:
            function = _REAL_HYPERBOLIC_FUNCTION_BY_NAME[name]
        return self._apply(node, function, getattr(math, name), *parts)

    def _build_guard(self, node: ast.expr, depth: int) -> Expr:
        """Return the guard of a condition: a SymPy expression that is at least 0 exactly where the condition of the
        syntax node holds. Raise an ArgumentError if the node is not a condition, if there are too many nodes, or if
        they are nested too deeply.
        """
        self._count_node(node, depth)
        match node:
            case ast.BoolOp():
                guards = [self._build_guard(operand, depth + 1) for operand in node.values]
                return _nest_by_halves(Smaller if isinstance(node.op, ast.And) else Larger, guards)
            case ast.UnaryOp(op=ast.Not()):
                return _negate_guard(self._build_guard(node.operand, depth + 1))
            case ast.Compare() if all(
                isinstance(comparison, ast.Lt | ast.LtE | ast.Gt | ast.GtE) for comparison in node.ops
            ):
                sides = [self.build(side, depth + 1).expr for side in (node.left, *node.comparators)]
                guards = []
                for comparison, left, right in zip(node.ops, sides[:-1], sides[1:], strict=True):
                    guard = right - left if isinstance(comparison, ast.LtE | ast.Gt) else left - right
                    guards.append(_negate_guard(guard) if isinstance(comparison, ast.Lt | ast.Gt) else guard)
                return _nest_by_halves(Smaller, guards)
        self._refuse(node, "a condition: comparisons by < <= > >=, joined by and, or, not")

    def _apply(
        self, node: ast.expr, operate_exactly: _Function, operate_on_floats: _Function, *parts: _ParsedSubexpression
    ) -> _ParsedSubexpression:
        """Apply a function to parsed subexpressions, the further arguments, and return the result as a
        _ParsedSubexpression. The function `operate_exactly` is applied to their expressions, and `operate_on_floats`
        to their floats if all have one. Raise an ArgumentError that points to the syntax node if the result is not
        finite or too large.
        """
        exprs, values = zip(*parts, strict=True)
        try:
            value = None if None in values else operate_on_floats(*values)
        except (ArithmeticError, ValueError):
            self._refuse(node, _EXPECTED_FINITE_NUMBER_TEXT)
        return self._checked_subexpression(node, _keep_domains(operate_exactly(*exprs), exprs), value)

    def _checked_subexpression(self, node: ast.expr, expr: Expr, value: float | None = None) -> _ParsedSubexpression:
        """Return `expr` as a _ParsedSubexpression, with its float if it has no symbols; `value` is this float if it
        is known, else None. Raise an ArgumentError that points to the syntax node if the expression is not finite or
        too large.
        """
        if not {expr, *expr.args}.isdisjoint({sympy.nan, sympy.zoo, sympy.oo, -sympy.oo}):
            self._refuse(node, _EXPECTED_FINITE_NUMBER_TEXT)
        for part in (expr, *expr.args):
            if part.is_Pow:
                self._check_power(node, part.base, part.exp)
        if expr.is_Rational and bit_length(expr) > MAX_EXACT_NUMBER_BITS:
            self._refuse(node, f"exact numbers of at most {MAX_EXACT_NUMBER_BITS} bits")
        if expr.is_Rational or (value is None and not expr.free_symbols):
            value = constant_value(expr)
        if value is not None and not math.isfinite(value):
            self._refuse(node, _EXPECTED_FINITE_NUMBER_TEXT)
        return _ParsedSubexpression(expr, value)

    def _check_power(self, node: ast.expr, base: Expr, exponent: Expr) -> None:
        """Raise an ArgumentError that points to the syntax node if the exponent, its denominator, or the product of
        the exponent and the number of bits of the base is too large for SymPy to compute the power quickly.
        """
        largest = max(abs(term.as_coeff_Mul()[0]) for term in sympy.Add.make_args(exponent))
        if exponent.is_Rational and (abs(exponent) > MAX_ABSOLUTE_EXPONENT or exponent.q > MAX_EXPONENT_DENOMINATOR):
            self._refuse(node, f"an exponent of at most {MAX_ABSOLUTE_EXPONENT}, with at most 4 decimals")
        if base is not sympy.E and bit_length(base.as_coeff_Mul()[0]) * largest > MAX_EXACT_NUMBER_BITS:
            self._refuse(node, f"exact numbers of at most {MAX_EXACT_NUMBER_BITS} bits")

    def _count_node(self, node: ast.expr, depth: int = 0) -> None:
        """Increase the number of syntax nodes by one. Raise an ArgumentError if there are too many nodes or `depth`
        is too large.
        """
        self._count_nodes(node, 1)
        if depth > MAX_EXPRESSION_NESTING_DEPTH:
            self._refuse(node, f"at most {MAX_EXPRESSION_NESTING_DEPTH} levels of parentheses")

    def _count_nodes(self, node: ast.expr, count: int) -> None:
        self.nodes += count
        if self.nodes > MAX_EXPRESSION_SYNTAX_NODES:
            expected = (
                f"at most {MAX_EXPRESSION_SYNTAX_NODES} numbers, names and operations, with constants written out"
            )
            self._refuse(node, expected)

    def _source_of(self, node: ast.expr) -> str:
        """Return the part of the text that a syntax node covers."""
        return self.text[node.col_offset : node.end_col_offset]

    def _syntax_hint(self) -> str:
        """Return a hint for the message on invalid syntax, such as a missing * or a missing parenthesis, as a string
        that begins with "; "; return an empty string if there is no hint.
        """
        match = _MISSING_OPERATOR_PATTERN.search(self.text)
        if match and match[1] in FUNCTION_SIGNATURE_BY_NAME:
            call = (
                f"{match[1]}({match[2]})"
                if match[1] in SMOOTH_FUNCTION_NAMES
                else FUNCTION_SIGNATURE_BY_NAME[match[1]]
            )
            return f"; a function is called as {call}"
        if match and match[2].startswith("deg"):
            return f"; degrees are written deg({match[1][:_MAX_FRAGMENT_CHARACTERS_IN_MESSAGE]})"
        if match:
            left, right = (operand[:_MAX_FRAGMENT_CHARACTERS_IN_MESSAGE] for operand in match.groups()[:2])
            return f"; a product is written {left}*{right}"
        if re.search(r"\bif\b", self.text):
            return "; a choice is written where(condition, x, y)"
        assigns = re.search("(?<![<>=])=(?!=)", self.text)
        return "; an expression has no assignment: its name stands before the quotes" if assigns else ""

    def _refuse(self, node: ast.expr, expected: str) -> NoReturn:
        """Raise an ArgumentError that says what was expected (`expected`) in place of a syntax node, and gives the
        node's text and its column.
        """
        source = self._source_of(node)
        shown = (
            source
            if len(source) <= _MAX_FRAGMENT_CHARACTERS_IN_MESSAGE
            else source[: _MAX_FRAGMENT_CHARACTERS_IN_MESSAGE - 3] + "..."
        )
        column = self.column + node.col_offset
        self._fail(expected, f"{shown} at column {column}", column)

    def _refuse_name(self, node: ast.Name) -> NoReturn:
        """Raise an ArgumentError on an unknown name. Its message lists the known names, and gives the nearest one or
        a hint.
        """
        names = (
            *FUNCTION_SIGNATURE_BY_NAME,
            "t",
            *list(self.constants)[
                : len(BUILTIN_SYMPY_CONSTANT_BY_NAME) + _MAX_GIVEN_CONSTANT_NAMES_IN_UNKNOWN_NAME_MESSAGE
            ],
        )
        column, short = self.column + node.col_offset, node.id[:_MAX_FRAGMENT_CHARACTERS_IN_MESSAGE]
        hint = f" ({_HINT_BY_UNKNOWN_NAME[short]})" if short in _HINT_BY_UNKNOWN_NAME else nearest(short, names)
        got = f"unknown name '{short}' at column {column}{hint}"
        error = ArgumentError(self.name, ", ".join(names), got)
        error.said = f"{got}; known: {error.expected}"
        error.add_note(line_with_caret(self.line, column))
        raise error

    def _fail(self, expected: str, got: str, column: int | None = None) -> NoReturn:
        """Raise an ArgumentError that says what was expected and what was given instead (`got`). If `column`, counted
        from 1, is not None, a note shows the text with a caret at this column.
        """
        error = ArgumentError(self.name, expected, got)
        if column is not None:
            error.add_note(line_with_caret(self.line, column))
        raise error from None


def _domains(exprs: Iterable[Expr]) -> dict[Expr, Expr]:
    """Return the parts of expressions that are real for some values of their symbols only, each by its guard: an
    expression that is at least 0 where the part is real.
    """
    parts = {}
    for part in (part for expr in exprs for part in expr.atoms(sympy.Pow, *_DOMAIN_GUARDS)):
        x = part.args[0]
        if x.free_symbols and not (part.is_Pow and part.exp.is_integer):
            parts[x if part.is_Pow else _DOMAIN_GUARDS[type(part)](x)] = part
    return parts


def _keep_domains(result: Expr, operands: Iterable[Expr]) -> Expr:
    """Return the result of an operation, NaN where an operand is not real: SymPy simplifies sqrt(x)*sqrt(x) to x."""
    if lost := _domains(operands):
        kept = _domains([result])
        for guard, part in lost.items():
            if guard not in kept:
                result = Where(guard, result, part)
    return result


def _nest_by_halves(function: Callable[[Expr, Expr], Expr], arguments: Sequence[Expr]) -> Expr:
    """Return Larger or Smaller, whichever `function` is, of one or more arguments as a balanced tree of calls with
    two arguments, since SymPy fails on deep nesting.
    """
    half = len(arguments) // 2
    return (
        arguments[0]
        if not half
        else function(_nest_by_halves(function, arguments[:half]), _nest_by_halves(function, arguments[half:]))
    )


def _negate_guard(guard: Expr) -> Expr:
    """Return a guard of the opposite condition: an expression that is at least 0 exactly where `guard` is below 0."""
    is_negated = isinstance(guard, Where) and guard.args[1:] == (-1, 1)
    return guard.args[0] if is_negated else Where(guard, -1, 1)
