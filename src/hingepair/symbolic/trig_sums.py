"""Conversion of products of sines and cosines to sums of sines and cosines.

It works term by term and from the inside out, so that terms that vanish are never multiplied. SymPy's TR8 gives the
same sums, in twenty times the time.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import Final, NamedTuple, TypeAlias

import sympy

from hingepair.symbolic.exact import Expr, value_without_nested_roots

MAX_TERMS: Final = 200
"""Largest number of terms of a sum; a longer one would not be readable."""
_MAX_PAIRS: Final = 10_000  # of terms in one multiplication
# Of one sine; sums of longer angles are no easier to read than products, and take minutes.
_MAX_ANGLE_NODES: Final = 24


class _TrigTerm(NamedTuple):
    """Term of a sum without its rational coefficient: rest * sin(angle) or rest * cos(angle); the angle is 0 if there
    is neither.
    """

    rest: Expr
    angle: Expr
    is_sine: bool


_TrigTerms: TypeAlias = dict[_TrigTerm, Fraction]  # coefficients; a term without sine or cosine has angle 0


class _TooManyTermsError(ArithmeticError):
    """A sum would exceed the largest number of terms, or the angle of a sine is too long."""


def trig_sum(expr: Expr) -> Expr | None:
    """Return an expression as an equal sum of terms with at most one sine or cosine each; return None if there would
    be too many terms.

    Sines and cosines with a common factor are put together, and so are the constants that multiply one sine or
    cosine.

    >>> t, u = sympy.symbols("t u", real=True)
    >>> trig_sum(2 * sympy.cos(3 * t) * sympy.cos(t) + u * sympy.sin(t) + u * sympy.cos(t))
    u*(sin(t) + cos(t)) + cos(2*t) + cos(4*t)
    """
    groups: dict[Expr, dict[Expr, dict[Expr, Expr]]] = {}  # by the factor with symbols, then by the constant factor
    try:
        for (rest, angle, is_sine), c in _expand_terms(expr).items():
            wave = sine_expression(angle) if is_sine else cosine_expression(angle)
            constant, varying = rest.as_independent(*rest.free_symbols, as_Add=False)
            groups.setdefault(varying, {}).setdefault(constant, {})[wave] = sympy.Rational(c)
    except _TooManyTermsError:
        return None
    return sympy.Add(*(varying * _sum_by_wave(constants) for varying, constants in groups.items()))


def _sum_by_wave(coefficients_by_constant: dict[Expr, dict[Expr, Expr]]) -> Expr:
    """Return the sum of the products constant * coefficient * wave, in which each sine or cosine occurs once."""
    waves: dict[Expr, list[Expr]] = {}
    for constant, coefficients in coefficients_by_constant.items():
        for wave, coefficient in coefficients.items():
            waves.setdefault(wave, []).append(coefficient * constant)
    if len(coefficients_by_constant) == 1:
        ((constant, coefficients),) = coefficients_by_constant.items()
        return constant * sympy.Add(*(coefficient * wave for wave, coefficient in coefficients.items()))
    return sympy.Add(*(sympy.Add(*factors) * wave for wave, factors in waves.items()))


def sine_expression(angle: Expr) -> Expr:
    """Return the sine of an angle, unevaluated if SymPy's value would be algebraic or have nested roots."""
    return _evaluate_trig(sympy.sin, angle)


def cosine_expression(angle: Expr) -> Expr:
    """Return the cosine of an angle, likewise."""
    return _evaluate_trig(sympy.cos, angle)


def _evaluate_trig(function: Callable[..., Expr], angle: Expr) -> Expr:
    """Return sin or cos of an angle, unevaluated unless the value is a multiple of one, or a simple constant."""
    if not angle.free_symbols:
        return value_without_nested_roots(function, angle)
    value = function(angle)
    is_wave = isinstance(value.as_coeff_Mul()[1], sympy.sin | sympy.cos)
    return value if is_wave else function(angle, evaluate=False)


@functools.lru_cache(maxsize=512)
def _expand_terms(expr: Expr) -> _TrigTerms:
    """Return the coefficients of an expression by term; the dict is cached and must not be changed."""
    if expr.is_Add:
        return _collect_terms(item for part in expr.args for item in _expand_terms(part).items())
    if expr.is_Mul:
        return functools.reduce(_multiply_sums, map(_expand_terms, expr.args))
    if expr.is_Pow and expr.exp.is_Integer and 1 < expr.exp <= MAX_TERMS and expr.free_symbols:
        return functools.reduce(_multiply_sums, [_expand_terms(expr.base)] * int(expr.exp))
    if isinstance(expr, sympy.sin | sympy.cos) and expr.free_symbols:
        if sum(1 for _ in sympy.preorder_traversal(expr.args[0])) > _MAX_ANGLE_NODES:
            raise _TooManyTermsError
        return dict(_normalise_trig(expr.args[0], isinstance(expr, sympy.sin)))
    coefficient, rest = _split_rational(expr)
    return {_TrigTerm(rest, sympy.S.Zero, False): coefficient} if coefficient else {}


def _multiply_sums(a: _TrigTerms, b: _TrigTerms) -> _TrigTerms:
    """Return the product of two sums; refuse too many terms."""
    if len(a) * len(b) > _MAX_PAIRS:
        raise _TooManyTermsError
    return _collect_terms(
        (wave, x * y * z) for v, x in a.items() for w, y in b.items() for wave, z in _multiply_terms(v, w)
    )


def _collect_terms(items: Iterable[tuple[_TrigTerm, Fraction]]) -> _TrigTerms:
    """Return the sum of terms, equal ones added, without those that cancel; refuse too many terms."""
    total: _TrigTerms = {}
    for wave, coefficient in items:
        total[wave] = total.get(wave, Fraction()) + coefficient
    total = {wave: coefficient for wave, coefficient in total.items() if coefficient}
    if len(total) > MAX_TERMS:
        raise _TooManyTermsError
    return total


@functools.lru_cache(maxsize=65536)
def _multiply_terms(a: _TrigTerm, b: _TrigTerm) -> tuple[tuple[_TrigTerm, Fraction], ...]:
    """Return the product of two terms, by formulas such as 2 sin a cos b = sin(a - b) + sin(a + b)."""
    coefficient, rest = _split_rational(a.rest * b.rest)
    if a.angle == 0 or b.angle == 0:
        angle, is_sine = (b.angle, b.is_sine) if a.angle == 0 else (a.angle, a.is_sine)
        return ((_TrigTerm(rest, angle, is_sine), coefficient),)
    half = coefficient / 2
    parts = (
        (a.angle - b.angle, -half if b.is_sine > a.is_sine else half),
        (a.angle + b.angle, -half if a.is_sine and b.is_sine else half),
    )
    terms = []
    for angle, c in parts:
        for wave, sign in _normalise_trig(angle, a.is_sine != b.is_sine):
            extra, whole = _split_rational(rest * wave.rest)
            terms.append((_TrigTerm(whole, wave.angle, wave.is_sine), c * sign * extra))
    return tuple(terms)


@functools.lru_cache(maxsize=65536)
def _normalise_trig(angle: Expr, is_sine: bool) -> tuple[tuple[_TrigTerm, Fraction], ...]:
    """Return a sine or cosine in SymPy's standard form, so that equal terms compare equal; nothing if it is 0."""
    coefficient, wave = _split_rational(sine_expression(angle) if is_sine else cosine_expression(angle))
    if not coefficient:
        return ()
    if isinstance(wave, sympy.sin | sympy.cos) and wave.free_symbols:
        return ((_TrigTerm(sympy.S.One, wave.args[0], isinstance(wave, sympy.sin)), coefficient),)
    return ((_TrigTerm(wave, sympy.S.Zero, False), coefficient),)


def _split_rational(expr: Expr) -> tuple[Fraction, Expr]:
    """Return the rational factor of an expression and the product of the others."""
    coefficient, rest = expr.as_coeff_Mul(rational=True)
    return Fraction(int(coefficient.p), int(coefficient.q)), rest
