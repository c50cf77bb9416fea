"""SymPy expressions as plain text, as LaTeX, as NumPy source and as SymPy source."""

from __future__ import annotations

import contextlib
import decimal
import functools
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, TypeAlias

import sympy
from sympy.core.function import AppliedUndef
from sympy.printing.latex import LatexPrinter
from sympy.printing.numpy import NumPyPrinter
from sympy.printing.precedence import PRECEDENCE
from sympy.printing.str import StrPrinter

from hingepair.symbolic.exact_constants import exact
from hingepair.symbolic.kinks import Expr, Kinked, Larger, Remainder, Side, Smaller, Where, constant_value

_READABLE: Final = 1_000  # the largest denominator that is read more easily than a decimal number
_LONGEST: Final = 10**6
_EXACT: Final = 2**53  # integers below are floats without rounding
_MAX_EXACT_LENGTH: Final = 18  # characters of a number that is no decimal: as many as a decimal of 17 digits has
_MIN_SHARE: Final = 1e-60  # of the largest term of a sum of constants; a smaller sum is 0, computed to 100 digits
_FEW: Final = 4  # the same among decimals, such as the lengths of a robot
_GREEK = {"omega": "ω", "alpha": "α", "phi": "φ", "psi": "ψ", "Jomega": "Jω"}  # noqa: RUF001
_IN_LATEX = {"Jv": "J^{v}", "Jomega": "J^{\\omega}"}
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

Write: TypeAlias = Callable[[Expr], str]


def joined(terms: Iterable[Expr], write: Write) -> str:
    """A sum with its terms in their order; derivatives of functions of t are x', x''."""
    text = " ".join(signed(terms, write))
    return text.removeprefix("+ ") if text.startswith("+") else text.replace("- ", "-", 1)


def signed(terms: Iterable[Expr], write: Write) -> list[str]:
    """The terms of a sum in their order, each after its sign: `+ x'`, `- 2 sin t`."""
    letters = lettered(terms, "'")
    return [f"- {write(-x)}" if x.as_coeff_Mul()[0].is_negative else f"+ {write(x)}" for x in letters]


def lettered(exprs: Iterable[Expr], mark: str) -> list[Expr]:
    """Expressions with a symbol for each function of t and for its derivatives: psi, psi', psi'' with the mark '."""
    found = list(exprs)
    letters = {
        function.diff((*function.args, order)): sympy.Symbol(f"{function.func.__name__}{mark * order}", real=True)
        for function in set().union(*(expr.atoms(AppliedUndef) for expr in found))
        for order in range(3)
    }
    return [expr.xreplace(letters) for expr in found]


def latex_name(name: str) -> str:
    r"""A letter with its index and its dots: `phi_x'` is \dot{\phi}_{x}, `u1_x` is u_{1,x}.

    >>> latex_name("phi_x'"), latex_name("u1_x")
    ('\\dot{\\phi}_{x}', 'u_{1,x}')
    """
    bare = name.rstrip("'")
    letter, _, index = bare.partition("_")
    if letter[-1:].isdigit():
        letter, index = letter[:-1], ",".join(filter(None, (letter[-1], index)))
    if letter in _IN_LATEX:
        letter = _IN_LATEX[letter]
    else:
        letter = f"\\{letter}" if letter in _GREEK else letter if len(letter) == 1 else f"\\mathrm{{{letter}}}"
    dots = len(name) - len(bare)
    dotted = f"\\{'d' * dots}ot{{{letter}}}" if dots else letter
    return f"{dotted}_{{{index}}}" if index else dotted


def _decimal(value: Expr, readable: int = _READABLE) -> str | None:
    """A rational number as a decimal, where a fraction would be harder to read: one with a denominator so large."""
    if value.q <= readable and abs(value.p) < _EXACT:
        return None
    terminates = pow(10, int(value.q).bit_length(), int(value.q)) == 0
    return _rounded(value) if terminates or max(abs(value.p), value.q) > _LONGEST else None


def _rounded(value: Expr) -> str:
    """A rational number to 17 digits; past the range of floats too."""
    with contextlib.suppress(OverflowError):
        number = int(value.p) / int(value.q)
        if number:
            return repr(number)
    with decimal.localcontext(prec=17):
        return f"{(decimal.Decimal(int(value.p)) / decimal.Decimal(int(value.q))).normalize():e}"


def is_simple(angle: Expr) -> bool:
    """Whether an angle is t, 3t or a letter."""
    coefficient, rest = angle.as_coeff_Mul()
    return bool(rest.is_Symbol and coefficient.is_Integer and coefficient > 0)


def _is_inverse(factor: Expr) -> bool:
    return bool(factor.is_Pow and factor.exp.is_number and factor.exp.is_negative)


def _is_root(power: Expr) -> bool:
    return bool(power.exp == sympy.Rational(1, 2))


class NumPySource(NumPyPrinter):  # type: ignore[misc]  # SymPy carries no types
    """NumPy source, every name with its module; what does not depend on a letter is its nearest float.

    As a NumPy float it overflows to inf, where a Python number raises or, as a large integer, has no sine.
    """

    def __init__(self) -> None:
        super().__init__({"allow_unknown_functions": False})

    def _print(self, expr: Expr, **settings: Any) -> str:
        if isinstance(expr, sympy.Expr) and not expr.free_symbols:
            if expr.is_Rational and max(abs(expr.p), expr.q) < _EXACT:
                return f"{expr.p}/{expr.q}" if expr.q != 1 else str(expr.p)
            value = constant_value(expr)
            return f"numpy.float64({value!r})" if math.isfinite(value) else f"numpy.float64('{value!r}')"
        return str(super()._print(expr, **settings))


_IN_SYMPY: Final[Mapping[type, str]] = {Larger: "Max", Smaller: "Min", Remainder: "Mod"}


class _SymPySource(StrPrinter):  # type: ignore[misc]
    """Source that `sympy.sympify` reads, in SymPy's own functions."""

    def _print_Function(self, expr: Expr) -> str:
        if type(expr) in _IN_SYMPY:
            return f"{_IN_SYMPY[type(expr)]}({', '.join(map(self._print, expr.args))})"
        if isinstance(expr, Where):
            x, y = map(self._print, expr.args[1:])
            return f"Piecewise(({x}, {self._condition(expr.guard)}), ({y}, True))"
        return str(super()._print_Function(expr))

    def _condition(self, guard: Expr) -> str:
        """Return the source of the condition that a guard is at least 0."""
        match guard:
            case Smaller() | Larger():
                sign = " & " if isinstance(guard, Smaller) else " | "
                return sign.join(f"({self._condition(part)})" for part in guard.args)
            case Where() if guard.args[1:] == (-1, 1):
                return f"~({self._condition(guard.guard)})"
            case Side():
                return self._just_after(*guard.args)
        return f"{self._print(guard)} >= 0"

    def _just_after(self, value: Expr, *rates: Expr) -> str:
        """Return the source of the condition that an expression is at least 0 just after t, by its derivatives."""
        shown = self._print(value)
        if not rates or (value.is_number and value != 0):
            return f"{shown} >= 0"
        if rates[0].is_number and rates[0] != 0:
            return f"{shown} {'>=' if rates[0].is_positive else '>'} 0"
        return f"({shown} > 0) | (Eq({shown}, 0) & ({self._just_after(*rates)}))"

    def _print_Symbol(self, expr: Expr) -> str:
        return f"Symbol({expr.name!r})" if hasattr(sympy, expr.name) else str(expr.name)


class _LatexPrinter(LatexPrinter):  # type: ignore[misc]
    r"""LaTeX with fractions before what they multiply: \frac{5}{2} \sin 2 t."""

    readable = _READABLE

    def _print_Symbol(self, expr: Expr, **_: Any) -> str:
        return latex_name(expr.name)

    def _print_Rational(self, expr: Expr) -> str:
        shown = _decimal(expr, self.readable)
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
        coefficient, rest = expr.as_coeff_Mul(rational=True)
        fraction = any(map(_is_inverse, sympy.Mul.make_args(rest)))
        if fraction or (coefficient.q == 1 and abs(coefficient) < _EXACT):
            return str(super()._print_Mul(expr))
        shown = self._print(rest)
        return f"{self._print(coefficient)} " + (f"\\left({shown}\\right)" if rest.is_Add else shown)


class _TextPrinter(StrPrinter):  # type: ignore[misc]
    """Plain text as a paper has it: `5/2 sin 3t cos t`, `t²`, `√2`, `x/(1 + t²)`."""

    readable = _READABLE
    tight = False  # within powers and fractions, where functions need brackets

    def _print_Symbol(self, expr: Expr) -> str:
        letter, mark, index = expr.name.partition("_")
        bare = letter.rstrip("'")
        return f"{_GREEK.get(bare, bare)}{letter[len(bare) :]}{mark}{index}"

    def _print_Rational(self, expr: Expr) -> str:
        return _decimal(expr, self.readable) or (f"{expr.p}/{expr.q}" if expr.q != 1 else str(expr.p))

    _print_Integer = _print_Rational  # noqa: N815

    def _print_Pi(self, _: Expr) -> str:
        return "π"

    def _print_Exp1(self, _: Expr) -> str:
        return "e"

    def _print_Add(self, expr: Expr, order: Any = None) -> str:  # noqa: ARG002
        return joined(in_order(expr), self._print)

    def _print_Function(self, expr: Expr) -> str:
        outer, self.tight = self.tight, False
        arguments = [self._print(part) for part in expr.args]
        self.tight = outer
        if isinstance(expr, Kinked):
            return expr.text.format(*arguments)
        name, together = expr.func.__name__.lower(), ", ".join(arguments)
        plain = isinstance(expr, sympy.sin | sympy.cos) and is_simple(expr.args[0]) and not self.tight
        return f"{name} {together}" if plain else f"{name}({together})"

    _print_ExpBase = _print_Function  # noqa: N815

    def _print_Pow(self, expr: Expr, rational: bool = False) -> str:  # noqa: ARG002
        if _is_inverse(expr):
            return self._print_Mul(expr)
        base = self._bracketed(expr.base)
        if _is_root(expr):
            return f"√{base}"
        if expr.exp.is_Integer:
            return base + str(expr.exp).translate(_SUPERSCRIPTS)
        return f"{base}^{self._bracketed(expr.exp)}"

    def _print_Mul(self, expr: Expr) -> str:
        coefficient, rest = expr.as_coeff_Mul(rational=True)
        factors = sympy.Mul.make_args(rest)
        over = sorted((f for f in factors if not _is_inverse(f) and f != 1), key=_rank)
        under = [1 / f for f in factors if _is_inverse(f)]
        sign, size = "-" if coefficient.is_negative else "", abs(coefficient)
        if not under:
            close = size.is_Integer and size < _EXACT and over[0].is_Symbol and len(over[0].name) == 1
            number = "" if size == 1 else self._print(size) + " " * (not close)
            return sign + number + " ".join(self._factor(f) for f in over)
        top, bottom = size.as_numer_denom() if _decimal(size, self.readable) is None else (size, sympy.S.One)
        above = [self._print(top)] * (top != 1 or not over) + [self._part(f) for f in over]
        below = [self._print(bottom)] * (bottom != 1) + [self._part(f) for f in under]
        return f"{sign}{' '.join(above)}/{below[0] if len(below) == 1 else '(' + ' '.join(below) + ')'}"

    def _factor(self, expr: Expr) -> str:
        return str(self.parenthesize(expr, PRECEDENCE["Mul"]))

    def _part(self, expr: Expr) -> str:
        return str(self._print(expr)) if expr.is_Pow and _is_root(expr) else self._bracketed(expr)

    def _bracketed(self, expr: Expr) -> str:
        """What a power or a fraction may be made of."""
        outer, self.tight = self.tight, True
        text = self._print(expr)
        self.tight = outer
        whole = expr.is_Symbol or expr.is_Function or (expr.is_Integer and expr >= 0) or expr.is_NumberSymbol
        power = expr.is_Pow and expr.exp.is_Integer and expr.exp > 0
        return text if whole or power else f"({text})"


def with_short_constants(expr: Expr) -> Expr:
    """Return an expression in which each constant is one number: exact, or a decimal where that is shorter.

    >>> x = sympy.Symbol("x", real=True)
    >>> TEXT(with_short_constants(sympy.sqrt(3) / 4 + x * (sympy.cos(1) ** 2 + sympy.sin(2) / 5)))
    '1/4 √3 + 0.4737860670915651 x'
    """
    if not expr.free_symbols:
        return _short_constant(expr)
    if not expr.args:
        return expr
    constants = [part for part in expr.args if not part.free_symbols] if expr.is_Add or expr.is_Mul else []
    parts = [_short_constant(expr.func(*constants))] if constants else []
    parts += [with_short_constants(part) for part in expr.args if part not in constants]
    return expr if set(parts) == {*expr.args} else expr.func(*parts)


def _short_constant(constant: Expr) -> Expr:
    """Return a number as it is, or as the rational number that its shortest decimal writes where that is shorter."""
    if constant.is_Rational or len(TEXT(constant)) <= _MAX_EXACT_LENGTH:
        return constant
    value = constant_value(constant)
    if abs(value) <= _MIN_SHARE * max(abs(constant_value(term)) for term in sympy.Add.make_args(constant)):
        return sympy.S.Zero
    return exact(value) if math.isfinite(value) else constant


@functools.lru_cache(maxsize=65536)
def count_letters(expr: Expr) -> int:
    """How often letters stand in an expression; x(t) and its derivatives are letters, numbers are none."""
    if not expr.args or expr.is_Derivative or isinstance(expr, AppliedUndef):
        return 0 if expr.is_number else 1
    return sum(map(count_letters, expr.args))


def in_order(expr: Expr, by_letters: bool = False) -> tuple[Expr, ...]:
    """The terms of a sum: short ones first, then those that weigh less; none with a minus sign in front if may be.

    Among terms with as many letters the order is that of the letters instead, short names first, if `by_letters`.
    """

    def key(term: Expr) -> tuple[int, Any, Any]:
        coefficient, rest = term.as_coeff_Mul(rational=True)
        letters = sorted((len(letter.name), letter.name[1:], letter.name) for letter in term.free_symbols)
        return count_letters(term), letters if by_letters else abs(coefficient), rest.sort_key()

    terms = sorted(sympy.Add.make_args(expr), key=key)
    first = next((i for i, term in enumerate(terms) if not term.as_coeff_Mul()[0].is_negative), 0)
    return terms[first], *terms[:first], *terms[first + 1 :]


def _rank(factor: Expr) -> tuple[bool, bool, Any]:
    """Letters, then sums, then functions."""
    base = factor.base if factor.is_Pow else factor
    return bool(base.is_Function), bool(base.is_Add), factor.sort_key()


class _DecimalText(_TextPrinter):
    """Plain text with decimals where a fraction has no small denominator."""

    readable = _FEW


class _DecimalLatex(_LatexPrinter):
    """LaTeX with decimals where a fraction has no small denominator."""

    readable = _FEW


TEXT: Write = _TextPrinter().doprint
LATEX: Write = _LatexPrinter({"order": "none"}).doprint
DECIMAL_TEXT: Write = _DecimalText().doprint
DECIMAL_LATEX: Write = _DecimalLatex({"order": "none"}).doprint
PYTHON: Write = NumPySource().doprint
SYMPY: Write = _SymPySource().doprint
