"""Sums of sines and cosines as numbers: the equations run over them and every product comes out as a sum.

A trigonometric sum is a sum of terms coefficient * rest * sin(angle) or coefficient * rest * cos(angle), where rest
is a product of things that are neither: t, u1_x, sqrt(2). It adds and multiplies (products of sines and
cosines turn into sums of them), remembers the order in which its terms arose, and never grows past a bound.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from fractions import Fraction
from typing import Final, NamedTuple, TypeAlias

import sympy

from hingepair.symbolic.kinks import Expr

MAX_TERMS: Final = 200
"""Of one sum. Where more would be needed, nobody could read it."""
MAX_PRODUCTS: Final = 10_000
"""Pairs of terms in one multiplication."""


class TooManyTermsError(ArithmeticError):
    """A sum would grow past the bound."""


class _Wave(NamedTuple):
    """The part of a term beside its coefficient: rest * sin(angle) or rest * cos(angle)."""

    rest: Expr
    angle: Expr
    odd: bool  # sine


_Terms: TypeAlias = dict[_Wave, Fraction]


class TrigSum:
    """A trigonometric sum; immutable.

    >>> import sympy
    >>> t = sympy.Symbol("t", real=True)
    >>> (trig_sum(sympy.cos(3 * t)) * trig_sum(sympy.cos(t))).terms()
    (cos(4*t)/2, cos(2*t)/2)
    """

    __slots__ = ("_terms",)

    def __init__(self, terms: _Terms) -> None:
        if len(terms) > MAX_TERMS:
            raise TooManyTermsError
        self._terms = terms

    def __add__(self, other: TrigSum | int) -> TrigSum:
        terms = dict(self._terms)
        for wave, coefficient in _terms_of(other).items():
            _join(terms, wave, coefficient)
        return TrigSum(terms)

    def __neg__(self) -> TrigSum:
        return TrigSum({wave: -coefficient for wave, coefficient in self._terms.items()})

    def __sub__(self, other: TrigSum | int) -> TrigSum:
        return self + -TrigSum(_terms_of(other))

    def __radd__(self, other: int) -> TrigSum:
        return TrigSum(_terms_of(other)) + self

    def __rsub__(self, other: int) -> TrigSum:
        return TrigSum(_terms_of(other)) - self

    def __mul__(self, other: TrigSum | int) -> TrigSum:
        factor = _terms_of(other)
        if len(self._terms) * len(factor) > MAX_PRODUCTS:
            raise TooManyTermsError
        terms: _Terms = {}
        for a, x in self._terms.items():
            for b, y in factor.items():
                for wave, z in _product(a, b):
                    _join(terms, wave, x * y * z)
        return TrigSum(terms)

    __rmul__ = __mul__

    def terms(self) -> tuple[Expr, ...]:
        """The terms in the order in which they arose; those that share a rest are put together."""
        groups: dict[Expr, list[Expr]] = {}
        for (rest, angle, odd), c in self._terms.items():
            wave = sine(angle) if odd else cosine(angle)
            groups.setdefault(rest, []).append(sympy.Rational(c.numerator, c.denominator) * wave)
        found: list[Expr] = []
        for rest, waves in groups.items():
            found += waves if rest == 1 else [rest * sympy.Add(*waves)]
        return tuple(found) or (sympy.S.Zero,)


def trig_sum(expr: Expr) -> TrigSum:
    """A SymPy expression as a trigonometric sum: sums, products and whole powers are multiplied out.

    Raises:
        TooManyTermsError: it has too many terms.
    """
    if expr.is_Add:
        return functools.reduce(TrigSum.__add__, map(trig_sum, expr.args))
    if expr.is_Mul:
        return functools.reduce(TrigSum.__mul__, map(trig_sum, expr.args))
    if expr.is_Pow and expr.exp.is_Integer and 1 < expr.exp <= MAX_TERMS and expr.free_symbols:
        return functools.reduce(TrigSum.__mul__, [trig_sum(expr.base)] * int(expr.exp))
    if isinstance(expr, sympy.sin | sympy.cos) and expr.free_symbols:
        return TrigSum(dict(_waves(expr.args[0], isinstance(expr, sympy.sin))))
    coefficient, rest = _split(expr)
    return TrigSum({_Wave(rest, sympy.S.Zero, False): coefficient} if coefficient else {})


def sine(angle: Expr) -> Expr:
    """The SymPy sine of an angle, left as a sine where SymPy would make an algebraic function of it."""
    return _kept(sympy.sin, angle)


def cosine(angle: Expr) -> Expr:
    """The SymPy cosine likewise: cos(atan(x)) + ... can then still become cos(atan(x) + ...)."""
    return _kept(sympy.cos, angle)


def _kept(function: Callable[..., Expr], angle: Expr) -> Expr:
    value = function(angle)
    is_wave = isinstance(value.as_coeff_Mul()[1], sympy.sin | sympy.cos)
    return value if is_wave or not angle.free_symbols else function(angle, evaluate=False)


def _terms_of(number: TrigSum | int) -> _Terms:
    if isinstance(number, TrigSum):
        return number._terms
    return {_Wave(sympy.S.One, sympy.S.Zero, False): Fraction(number)} if number else {}


def _join(terms: _Terms, wave: _Wave, coefficient: Fraction) -> None:
    total = terms.get(wave, Fraction()) + coefficient
    if total:
        terms[wave] = total
    else:
        terms.pop(wave, None)


@functools.lru_cache(maxsize=65536)
def _product(a: _Wave, b: _Wave) -> tuple[tuple[_Wave, Fraction], ...]:
    """The product of two waves: 2 sin a cos b = sin(a - b) + sin(a + b), and so on."""
    coefficient, rest = _split(a.rest * b.rest)
    if a.angle == 0 or b.angle == 0:
        angle, odd = (b.angle, b.odd) if a.angle == 0 else (a.angle, a.odd)
        return ((_Wave(rest, angle, odd), coefficient),)
    odd, half = a.odd != b.odd, coefficient / 2
    parts = [
        (a.angle - b.angle, -half if b.odd > a.odd else half),
        (a.angle + b.angle, -half if a.odd and b.odd else half),
    ]
    found = []
    for angle, c in parts if a.odd else parts[::-1]:
        for wave, own in _waves(angle, odd):
            extra, whole = _split(rest * wave.rest)
            found.append((_Wave(whole, wave.angle, wave.odd), c * own * extra))
    return tuple(found)


@functools.lru_cache(maxsize=65536)
def _waves(angle: Expr, odd: bool) -> tuple[tuple[_Wave, Fraction], ...]:
    """The sine or cosine of an angle as a wave with its sign; the angle as SymPy writes it, so that equals meet."""
    value = sine(angle) if odd else cosine(angle)
    coefficient, wave = _split(value)
    if not coefficient:
        return ()
    if isinstance(wave, sympy.sin | sympy.cos) and wave.free_symbols:
        return ((_Wave(sympy.S.One, wave.args[0], isinstance(wave, sympy.sin)), coefficient),)
    return ((_Wave(wave, sympy.S.Zero, False), coefficient),)


def _split(expr: Expr) -> tuple[Fraction, Expr]:
    """The rational factor of a product, and the rest."""
    coefficient, rest = expr.as_coeff_Mul(rational=True)
    return Fraction(int(coefficient.p), int(coefficient.q)), rest
