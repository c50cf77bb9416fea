"""Products of sines and cosines as sums of them.

Term by term and from the inside out, so that what vanishes on the way is never multiplied. SymPy's TR8 gives the same
sums, in twenty times the time.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import Final, NamedTuple, TypeAlias

import sympy

from hingepair.symbolic.exact_constants import unnested
from hingepair.symbolic.kinks import Expr

MAX_TERMS: Final = 200
"""Of one sum. Where more would be needed, nobody could read it."""
MAX_PRODUCTS: Final = 10_000
"""Pairs of terms in one multiplication."""


class _Wave(NamedTuple):
    """The part of a term beside its coefficient: rest * sin(angle) or rest * cos(angle)."""

    rest: Expr
    angle: Expr
    odd: bool  # sine


_Terms: TypeAlias = dict[_Wave, Fraction]  # coefficients; of what is no wave, the angle is 0


class _TooManyTermsError(ArithmeticError):
    """A sum would grow past the bound."""


def trig_sum(expr: Expr) -> Expr | None:
    """Return an expression whose terms have one sine or cosine at most each; None where they would be too many.

    Those that share what they multiply their sines and cosines by are put together, and so are the constants that
    multiply one sine or cosine.

    >>> t, u = sympy.symbols("t u", real=True)
    >>> trig_sum(2 * sympy.cos(3 * t) * sympy.cos(t) + u * sympy.sin(t) + u * sympy.cos(t))
    u*(sin(t) + cos(t)) + cos(2*t) + cos(4*t)
    """
    groups: dict[Expr, dict[Expr, dict[Expr, Expr]]] = {}  # by what depends on letters; of each constant, its waves
    try:
        for (rest, angle, odd), c in _terms(expr).items():
            wave = sine(angle) if odd else cosine(angle)
            constant, varying = rest.as_independent(*rest.free_symbols, as_Add=False)
            groups.setdefault(varying, {}).setdefault(constant, {})[wave] = sympy.Rational(c)
    except _TooManyTermsError:
        return None
    return sympy.Add(*(varying * _combined(constants) for varying, constants in groups.items()))


def _combined(constants: dict[Expr, dict[Expr, Expr]]) -> Expr:
    """Return the sum of constants that each multiply a sum of waves, with each wave once."""
    waves: dict[Expr, list[Expr]] = {}
    for constant, own in constants.items():
        for wave, coefficient in own.items():
            waves.setdefault(wave, []).append(coefficient * constant)
    if len(constants) == 1:
        ((constant, own),) = constants.items()
        return constant * sympy.Add(*(coefficient * wave for wave, coefficient in own.items()))
    return sympy.Add(*(sympy.Add(*factors) * wave for wave, factors in waves.items()))


def sine(angle: Expr) -> Expr:
    """Return the sine of an angle, as it is where SymPy would make an algebraic function or roots of roots of it."""
    return _kept(sympy.sin, angle)


def cosine(angle: Expr) -> Expr:
    """Return the cosine of an angle likewise: cos(atan(x)) + ... can then still become cos(atan(x) + ...)."""
    return _kept(sympy.cos, angle)


def _kept(function: Callable[..., Expr], angle: Expr) -> Expr:
    if not angle.free_symbols:
        return unnested(function, angle)
    value = function(angle)
    is_wave = isinstance(value.as_coeff_Mul()[1], sympy.sin | sympy.cos)
    return value if is_wave else function(angle, evaluate=False)


@functools.lru_cache(maxsize=512)
def _terms(expr: Expr) -> _Terms:
    """The terms of an expression, in the order in which they arise; nobody changes them."""
    if expr.is_Add:
        return _joined(item for part in expr.args for item in _terms(part).items())
    if expr.is_Mul:
        return functools.reduce(_multiplied, map(_terms, expr.args))
    if expr.is_Pow and expr.exp.is_Integer and 1 < expr.exp <= MAX_TERMS and expr.free_symbols:
        return functools.reduce(_multiplied, [_terms(expr.base)] * int(expr.exp))
    if isinstance(expr, sympy.sin | sympy.cos) and expr.free_symbols:
        return dict(_waves(expr.args[0], isinstance(expr, sympy.sin)))
    coefficient, rest = _split(expr)
    return {_Wave(rest, sympy.S.Zero, False): coefficient} if coefficient else {}


def _multiplied(a: _Terms, b: _Terms) -> _Terms:
    if len(a) * len(b) > MAX_PRODUCTS:
        raise _TooManyTermsError
    return _joined((wave, x * y * z) for v, x in a.items() for w, y in b.items() for wave, z in _product(v, w))


def _joined(items: Iterable[tuple[_Wave, Fraction]]) -> _Terms:
    """The sum of terms, without those that vanish."""
    total: _Terms = {}
    for wave, coefficient in items:
        total[wave] = total.get(wave, Fraction()) + coefficient
    total = {wave: coefficient for wave, coefficient in total.items() if coefficient}
    if len(total) > MAX_TERMS:
        raise _TooManyTermsError
    return total


@functools.lru_cache(maxsize=65536)
def _product(a: _Wave, b: _Wave) -> tuple[tuple[_Wave, Fraction], ...]:
    """The product of two waves: 2 sin a cos b = sin(a - b) + sin(a + b), and so on."""
    coefficient, rest = _split(a.rest * b.rest)
    if a.angle == 0 or b.angle == 0:
        angle, odd = (b.angle, b.odd) if a.angle == 0 else (a.angle, a.odd)
        return ((_Wave(rest, angle, odd), coefficient),)
    half = coefficient / 2
    parts = (
        (a.angle - b.angle, -half if b.odd > a.odd else half),
        (a.angle + b.angle, -half if a.odd and b.odd else half),
    )
    found = []
    for angle, c in parts:
        for wave, own in _waves(angle, a.odd != b.odd):
            extra, whole = _split(rest * wave.rest)
            found.append((_Wave(whole, wave.angle, wave.odd), c * own * extra))
    return tuple(found)


@functools.lru_cache(maxsize=65536)
def _waves(angle: Expr, odd: bool) -> tuple[tuple[_Wave, Fraction], ...]:
    """The sine or cosine of an angle as a wave with its sign; the angle as SymPy writes it, so that equals meet."""
    coefficient, wave = _split(sine(angle) if odd else cosine(angle))
    if not coefficient:
        return ()
    if isinstance(wave, sympy.sin | sympy.cos) and wave.free_symbols:
        return ((_Wave(sympy.S.One, wave.args[0], isinstance(wave, sympy.sin)), coefficient),)
    return ((_Wave(wave, sympy.S.Zero, False), coefficient),)


def _split(expr: Expr) -> tuple[Fraction, Expr]:
    """The rational factor of a product, and the rest."""
    coefficient, rest = expr.as_coeff_Mul(rational=True)
    return Fraction(int(coefficient.p), int(coefficient.q)), rest
