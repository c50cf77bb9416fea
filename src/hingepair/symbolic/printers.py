"""Printers of SymPy expressions: plain text, LaTeX, NumPy source and SymPy source."""

from __future__ import annotations

import builtins
import contextlib
import decimal
import functools
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, TypeAlias

import sympy
from sympy.core.function import AppliedUndef
from sympy.printing.c import C99CodePrinter
from sympy.printing.latex import LatexPrinter
from sympy.printing.numpy import NumPyPrinter
from sympy.printing.precedence import PRECEDENCE
from sympy.printing.str import StrPrinter

from hingepair.symbolic.exact_constants import exact
from hingepair.symbolic.kinks import Expr, Kinked, Larger, Remainder, SideOfZero, Smaller, Where, constant_value

_MAX_DENOMINATOR: Final = 1_000  # of a fraction that is always printed as such
_DECIMAL_DENOMINATOR: Final = 4  # the same where decimals are preferred, such as for the lengths of a robot
_MAX_INTEGER: Final = 10**6  # in a fraction that is printed as such because it has no finite decimal form
_EXACT_FLOATS: Final = 2**53  # integers below are exact as floats
_MAX_CHARACTERS: Final = 18  # of an exact number; a longer one is printed as a decimal of 17 digits
_CANCELLED: Final = 1e-60  # a sum of constants this small, relative to its largest term, is 0
_GREEK = {"omega": "ω", "alpha": "α", "phi": "φ", "psi": "ψ", "Jomega": "Jω"}  # in text  # noqa: RUF001
_JACOBIANS = {"Jv": "J^{v}", "Jomega": "J^{\\omega}"}  # rows of the Jacobian for v and omega
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")  # of exponents in text

Writer: TypeAlias = Callable[[Expr], str]
"""Function that formats an expression as text."""


def join_terms(terms: Iterable[Expr], write: Writer) -> str:
    """Return the text of a sum of terms in the given order."""
    text = " ".join(signed_terms(terms, write))
    return text.removeprefix("+ ") if text.startswith("+") else text.replace("- ", "-", 1)


def signed_terms(terms: Iterable[Expr], write: Writer) -> list[str]:
    """Return the texts of terms, each after its sign: `+ x'`, `- 2 sin t`."""
    return [f"- {write(-x)}" if x.as_coeff_Mul()[0].is_negative else f"+ {write(x)}" for x in terms]


def with_symbols(exprs: Iterable[Expr], derivative_mark: str) -> list[Expr]:
    """Return the expressions with symbols in place of functions of t; the names of derivatives repeat
    `derivative_mark`: psi' and psi'' for the mark '.
    """
    expressions = list(exprs)
    symbols = {
        function.diff((*function.args, order)): sympy.Symbol(
            f"{function.func.__name__}{derivative_mark * order}", real=True
        )
        for function in set().union(*(expr.atoms(AppliedUndef) for expr in expressions))
        for order in range(3)
    }
    return [expr.xreplace(symbols) for expr in expressions]


def latex_name(name: str) -> str:
    r"""Return the LaTeX of a symbol's name: `phi_x'` becomes \dot{\phi}_{x}, `u1_x` becomes u_{1,x}.

    >>> latex_name("phi_x'"), latex_name("u1_x")
    ('\\dot{\\phi}_{x}', 'u_{1,x}')
    """
    bare = name.rstrip("'")
    letter, _, index = bare.partition("_")
    if not all(bare.split("_")):  # _x, x_, x__y
        escaped = bare.replace("_", "\\_")
        return f"\\mathrm{{{escaped}}}"
    index = index.replace("_", ",")
    if letter[-1:].isdigit():
        letter, index = letter[:-1], ",".join(filter(None, (letter[-1], index)))
    if letter in _JACOBIANS:
        letter = _JACOBIANS[letter]
    else:
        letter = f"\\{letter}" if letter in _GREEK else letter if len(letter) == 1 else f"\\mathrm{{{letter}}}"
    dots = len(name) - len(bare)
    dotted = f"\\{'d' * dots}ot{{{letter}}}" if dots else letter
    return f"{dotted}_{{{index}}}" if index else dotted


def _decimal_text(value: Expr, max_denominator: int = _MAX_DENOMINATOR) -> str | None:
    """Return the decimal text of a rational number, or None if its fraction is easier to read."""
    if value.q <= max_denominator and abs(value.p) < _EXACT_FLOATS:
        return None
    terminates = pow(10, int(value.q).bit_length(), int(value.q)) == 0
    return _float_text(value) if terminates or max(abs(value.p), value.q) > _MAX_INTEGER else None


def _float_text(value: Expr) -> str:
    """Return the shortest text that gives the same float, or 17 digits of a number beyond the range of floats."""
    with contextlib.suppress(OverflowError):
        number = int(value.p) / int(value.q)
        if number:
            return repr(number)
    with decimal.localcontext(prec=17):
        return f"{(decimal.Decimal(int(value.p)) / decimal.Decimal(int(value.q))).normalize():e}"


def is_simple(angle: Expr) -> bool:
    """Return whether an angle is a symbol or a positive integer times a symbol, as t and 3t."""
    coefficient, rest = angle.as_coeff_Mul()
    return bool(rest.is_Symbol and coefficient.is_Integer and coefficient > 0)


def _is_inverse(factor: Expr) -> bool:
    """Return whether a factor is a power with a negative exponent, which stands in a denominator."""
    return bool(factor.is_Pow and factor.exp.is_number and factor.exp.is_negative)


def _is_root(power: Expr) -> bool:
    """Return whether a power is a square root."""
    return bool(power.exp == sympy.Rational(1, 2))


class NumPySourcePrinter(NumPyPrinter):  # type: ignore[misc]  # SymPy carries no types
    """Printer of SymPy expressions as NumPy source, with full names of functions such as `numpy.sin`.

    A NumPy float overflows to inf, where a Python number raises or, as a large integer, has no sine.
    """

    def __init__(self) -> None:
        super().__init__({"allow_unknown_functions": False})

    def _print(self, expr: Expr, **settings: Any) -> str:
        """Print a part without symbols, such as sqrt(2)/3, as one number: an integer, a fraction or a float."""
        if isinstance(expr, sympy.Expr) and not expr.free_symbols:
            if expr.is_Rational and max(abs(expr.p), expr.q) < _EXACT_FLOATS:
                return f"{expr.p}/{expr.q}" if expr.q != 1 else str(expr.p)
            value = constant_value(expr)
            return f"numpy.float64({value!r})" if math.isfinite(value) else f"numpy.float64('{value!r}')"
        return str(super()._print(expr, **settings))


class _CSourcePrinter(C99CodePrinter):  # type: ignore[misc]
    """Printer of SymPy expressions as C source."""

    def _print(self, expr: Expr, **settings: Any) -> str:
        """Print a part without symbols as one double."""
        if isinstance(expr, sympy.Expr) and not expr.free_symbols:
            value = constant_value(expr)
            return repr(value) if math.isfinite(value) else "NAN" if math.isnan(value) else "INFINITY"
        return str(super()._print(expr, **settings))


# SymPy's names of functions with kinks.
_IN_SYMPY: Final[Mapping[type, str]] = {Larger: "Max", Smaller: "Min", Remainder: "Mod"}


class _SymPySourcePrinter(StrPrinter):  # type: ignore[misc]
    """Printer of SymPy expressions as source that `sympy.sympify` reads and that contains only SymPy's own
    functions.
    """

    def _print_Function(self, expr: Expr) -> str:
        """Print functions with kinks as Max, Min, Mod and Piecewise."""
        if type(expr) in _IN_SYMPY:
            return f"{_IN_SYMPY[type(expr)]}({', '.join(map(self._print, expr.args))})"
        if isinstance(expr, Where):
            x, y = map(self._print, expr.args[1:])
            return f"Piecewise(({x}, {self._condition_source(expr.guard)}), ({y}, True))"
        return str(super()._print_Function(expr))

    def _condition_source(self, guard: Expr) -> str:
        """Return the source of the condition that `guard` is at least 0."""
        match guard:
            case Smaller() | Larger():
                sign = " & " if isinstance(guard, Smaller) else " | "
                return sign.join(f"({self._condition_source(part)})" for part in guard.args)
            case Where() if guard.args[1:] == (-1, 1):
                return f"~({self._condition_source(guard.guard)})"
            case SideOfZero():
                return self._condition_just_after(*guard.args)
        return f"{self._print(guard)} >= 0"

    def _condition_just_after(self, value: Expr, *rates: Expr) -> str:
        """Return the source of the condition that a function is at least 0 just after t, from its value and its
        derivatives at t.
        """
        shown = self._print(value)
        if not rates or (value.is_number and value != 0):
            return f"{shown} >= 0"
        if rates[0].is_number and rates[0] != 0:
            return f"{shown} {'>=' if rates[0].is_positive else '>'} 0"
        return f"({shown} > 0) | (Eq({shown}, 0) & ({self._condition_just_after(*rates)}))"

    def _print_Symbol(self, expr: Expr) -> str:
        known = hasattr(sympy, expr.name) or hasattr(builtins, expr.name)
        return f"Symbol({expr.name!r})" if known else str(expr.name)


class _LatexPrinter(LatexPrinter):  # type: ignore[misc]
    r"""Printer of SymPy expressions as LaTeX, with fractions in front of the factors that they multiply: \frac{5}{2}
    \sin 2 t.
    """

    max_denominator = _MAX_DENOMINATOR

    def _print_Symbol(self, expr: Expr, **_: Any) -> str:
        return latex_name(expr.name)

    def _print_Rational(self, expr: Expr) -> str:
        """Print a fraction, or the decimal if that is easier to read."""
        shown = _decimal_text(expr, self.max_denominator)
        if shown is None:
            sign = "-" if expr.p < 0 else ""
            return f"{sign}\\frac{{{abs(expr.p)}}}{{{expr.q}}}" if expr.q != 1 else str(expr.p)
        mantissa, _, exponent = shown.partition("e")
        return f"{mantissa} \\cdot 10^{{{int(exponent)}}}" if exponent else mantissa

    _print_Integer = _print_Rational  # noqa: N815

    def _print_Function(self, expr: Expr, exp: str | None = None) -> str:
        if exp is None and isinstance(expr, sympy.sin | sympy.cos) and is_simple(expr.args[0]):
            return f"\\{expr.func.__name__} {self._print(expr.args[0])}"
        return str(super()._print_Function(expr, exp))

    def _print_Mul(self, expr: Expr) -> str:
        """Print a rational factor in front of the others, unless one of these is a divisor."""
        coefficient, rest = expr.as_coeff_Mul(rational=True)
        fraction = any(map(_is_inverse, sympy.Mul.make_args(rest)))
        if fraction or (coefficient.q == 1 and abs(coefficient) < _EXACT_FLOATS):
            return str(super()._print_Mul(expr))
        shown = self._print(rest)
        return f"{self._print(coefficient)} " + (f"\\left({shown}\\right)" if rest.is_Add else shown)


class _TextPrinter(StrPrinter):  # type: ignore[misc]
    """Printer of SymPy expressions as plain text in mathematical notation: `5/2 sin 3t cos t`, `t²`, `√2`, `x/(1 +
    t²)`.
    """

    max_denominator = _MAX_DENOMINATOR
    needs_parentheses = False  # whether it prints inside a power or fraction, where functions need parentheses

    def _print_Symbol(self, expr: Expr) -> str:
        base, mark, index = expr.name.partition("_")
        bare = base.rstrip("'")
        return f"{_GREEK.get(bare, bare)}{base[len(bare) :]}{mark}{index}"

    def _print_Rational(self, expr: Expr) -> str:
        return _decimal_text(expr, self.max_denominator) or (f"{expr.p}/{expr.q}" if expr.q != 1 else str(expr.p))

    _print_Integer = _print_Rational  # noqa: N815

    def _print_Pi(self, _: Expr) -> str:
        return "π"

    def _print_Exp1(self, _: Expr) -> str:
        return "e"

    def _print_Add(self, expr: Expr, order: Any = None) -> str:  # noqa: ARG002
        return join_terms(sorted_terms(expr), self._print)

    def _print_Function(self, expr: Expr) -> str:
        """Leave out the parentheses of sin and cos around a simple argument, except in powers and fractions."""
        outer, self.needs_parentheses = self.needs_parentheses, False
        arguments = [self._print(part) for part in expr.args]
        self.needs_parentheses = outer
        if isinstance(expr, Kinked):
            return expr.text.format(*arguments)
        name, together = expr.func.__name__.lower(), ", ".join(arguments)
        plain = isinstance(expr, sympy.sin | sympy.cos) and is_simple(expr.args[0]) and not self.needs_parentheses
        return f"{name} {together}" if plain else f"{name}({together})"

    _print_ExpBase = _print_Function  # noqa: N815

    def _print_Pow(self, expr: Expr, rational: bool = False) -> str:  # noqa: ARG002
        """Print a power as √x, t², x^y or, with an exponent below 0, as a fraction."""
        if _is_inverse(expr):
            return self._print_Mul(expr)
        base = self._parenthesise(expr.base)
        if _is_root(expr):
            return f"√{base}"
        if expr.exp.is_Integer:
            return base + str(expr.exp).translate(_SUPERSCRIPTS)
        return f"{base}^{self._parenthesise(expr.exp)}"

    def _print_Mul(self, expr: Expr) -> str:
        """Print the number first, then symbols, sums and functions; what divides stands behind a slash."""
        coefficient, rest = expr.as_coeff_Mul(rational=True)
        factors = sympy.Mul.make_args(rest)
        over = sorted((f for f in factors if not _is_inverse(f) and f != 1), key=_factor_key)
        under = [1 / f for f in factors if _is_inverse(f)]
        sign, size = "-" if coefficient.is_negative else "", abs(coefficient)
        if not under:
            close = size.is_Integer and size < _EXACT_FLOATS and over[0].is_Symbol and len(over[0].name) == 1
            number = "" if size == 1 else self._print(size) + " " * (not close)
            return sign + number + " ".join(self._print_factor(f) for f in over)
        top, bottom = (
            size.as_numer_denom() if _decimal_text(size, self.max_denominator) is None else (size, sympy.S.One)
        )
        above = [self._print(top)] * (top != 1 or not over) + [self._operand(f) for f in over]
        below = [self._print(bottom)] * (bottom != 1) + [self._operand(f) for f in under]
        return f"{sign}{' '.join(above)}/{below[0] if len(below) == 1 else '(' + ' '.join(below) + ')'}"

    def _print_factor(self, expr: Expr) -> str:
        return str(self.parenthesize(expr, PRECEDENCE["Mul"]))

    def _operand(self, expr: Expr) -> str:
        return str(self._print(expr)) if expr.is_Pow and _is_root(expr) else self._parenthesise(expr)

    def _parenthesise(self, expr: Expr) -> str:
        """Return the text of an operand of a power or a fraction, in parentheses if it needs them."""
        outer, self.needs_parentheses = self.needs_parentheses, True
        text = self._print(expr)
        self.needs_parentheses = outer
        whole = expr.is_Symbol or expr.is_Function or (expr.is_Integer and expr >= 0) or expr.is_NumberSymbol
        power = expr.is_Pow and expr.exp.is_Integer and expr.exp > 0
        return text if whole or power else f"({text})"


@functools.lru_cache(maxsize=4096)  # long forms repeat their parts
def with_short_constants(expr: Expr) -> Expr:
    """Return an expression whose constant parts are one number each: exact, or the shortest decimal of its float
    where that is long.

    >>> x = sympy.Symbol("x", real=True)
    >>> to_text(with_short_constants(sympy.sqrt(3) / 4 + x * (sympy.cos(1) ** 2 + sympy.sin(2) / 5)))
    '1/4 √3 + 0.4737860670915651 x'
    """
    if not _has_symbols(expr):
        return _short_constant(expr)
    if not expr.args:
        return expr
    constants = [part for part in expr.args if not _has_symbols(part)] if expr.is_Add or expr.is_Mul else []
    parts = [_short_constant(expr.func(*constants))] if constants else []
    parts += [with_short_constants(part) for part in expr.args if part not in constants]
    return expr if set(parts) == {*expr.args} else expr.func(*parts)


@functools.lru_cache(maxsize=4096)
def _has_symbols(expr: Expr) -> bool:
    """Return whether an expression has free symbols; SymPy goes through the whole expression at each question."""
    return any(map(_has_symbols, expr.args)) if expr.args else bool(expr.free_symbols)


def _short_constant(constant: Expr) -> Expr:
    """Return a constant as it is if it is short, 0 if its terms cancel, else its float as a Rational."""
    if constant.is_Rational or len(to_text(constant)) <= _MAX_CHARACTERS:
        return constant
    value = constant_value(constant)
    if abs(value) <= _CANCELLED * max(abs(constant_value(term)) for term in sympy.Add.make_args(constant)):
        return sympy.S.Zero
    return exact(value) if math.isfinite(value) else constant


@functools.lru_cache(maxsize=65536)
def count_symbols(expr: Expr) -> int:
    """Return the number of symbols in an expression, with repetition; x(t) and its derivatives count as symbols."""
    if not expr.args or expr.is_Derivative or isinstance(expr, AppliedUndef):
        return 0 if expr.is_number else 1
    return sum(map(count_symbols, expr.args))


def sorted_terms(expr: Expr, by_symbols: bool = False) -> tuple[Expr, ...]:
    """Return the terms of a sum, those with few symbols first, but if possible one without a minus sign at the front.
    Of equally many symbols, the coefficient decides or, if `by_symbols`, the names, short ones first.
    """

    def key(term: Expr) -> tuple[int, Any, Any]:
        coefficient, factor = term.as_coeff_Mul(rational=True)
        symbols = sorted((len(symbol.name), symbol.name[1:], symbol.name) for symbol in term.free_symbols)
        return count_symbols(term), symbols if by_symbols else abs(coefficient), factor.sort_key()

    terms = sorted(sympy.Add.make_args(expr), key=key)
    first = next((i for i, term in enumerate(terms) if not term.as_coeff_Mul()[0].is_negative), 0)
    return terms[first], *terms[:first], *terms[first + 1 :]


def _factor_key(factor: Expr) -> tuple[bool, bool, Any]:
    """Return the sort key of a factor of a product, which puts symbols first, then sums, then functions."""
    base = factor.base if factor.is_Pow else factor
    return bool(base.is_Function), bool(base.is_Add), factor.sort_key()


class _DecimalText(_TextPrinter):
    """Printer of plain text, with decimals where a fraction has no small denominator."""

    max_denominator = _DECIMAL_DENOMINATOR


class _DecimalLatex(_LatexPrinter):
    """Printer of LaTeX, with decimals where a fraction has no small denominator."""

    max_denominator = _DECIMAL_DENOMINATOR


# The printers of expressions as functions.
to_text: Writer = _TextPrinter().doprint
to_latex: Writer = _LatexPrinter({"order": "none"}).doprint
to_decimal_text: Writer = _DecimalText().doprint
to_decimal_latex: Writer = _DecimalLatex({"order": "none"}).doprint
to_numpy_source: Writer = NumPySourcePrinter().doprint
to_c_source: Writer = _CSourcePrinter({"allow_unknown_functions": False}).doprint
to_sympy_source: Writer = _SymPySourcePrinter().doprint
