"""Products of sines and cosines as sums: by SymPy, where the sum is short enough to be read."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Final

import sympy
from sympy.simplify.fu import TR8

from hingepair.symbolic.kinks import Expr

MAX_TERMS: Final = 400
"""That may arise on the way. Where there would be more, nobody could read the sum."""


def trig_sum(expr: Expr) -> Expr | None:
    """An expression whose terms have one sine or cosine at most each; None where they would be too many.

    Those that share what they multiply their sines and cosines by are put together.

    >>> t, u = sympy.symbols("t u", real=True)
    >>> trig_sum(2 * sympy.cos(3 * t) * sympy.cos(t) + u * sympy.sin(t) + u * sympy.cos(t))
    u*(sin(t) + cos(t)) + cos(2*t) + cos(4*t)
    """
    if _terms_at_most(expr) > MAX_TERMS:
        return None
    groups: dict[Expr, list[Expr]] = {}
    for term in sympy.Add.make_args(sympy.expand(expr)):
        factor, waves = term.as_independent(sympy.sin, sympy.cos, as_Add=False)
        coefficient, rest = factor.as_coeff_Mul(rational=True)
        groups.setdefault(rest, []).append(coefficient * _sum_of(waves))
    return sympy.Add(*(rest * sympy.Add(*sums) for rest, sums in groups.items()))


@functools.lru_cache(maxsize=65536)
def _sum_of(waves: Expr) -> Expr:
    """A product of sines and cosines as a sum."""
    total, before = waves, None
    while total != before:  # of a high power SymPy makes squares first
        total, before = sympy.expand(TR8(total)), total
    return total


def _terms_at_most(expr: Expr) -> int:
    """How many terms an expression can have once everything is multiplied out: of two waves there are two."""
    if expr.is_Add:
        return sum(map(_terms_at_most, expr.args))
    if expr.is_Mul:
        return math.prod(_terms_at_most(part) * (1 + part.has(sympy.sin, sympy.cos)) for part in expr.args)
    if expr.is_Pow and expr.exp.is_Integer and expr.exp > 1:
        return int(
            min(
                (_terms_at_most(expr.base) * (1 + expr.base.has(sympy.sin, sympy.cos))) ** min(int(expr.exp), 20),
                10**9,
            )
        )
    return 1


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
