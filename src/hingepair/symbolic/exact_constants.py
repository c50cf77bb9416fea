"""Exact numbers, axes of length 1 and rotations, as SymPy expressions without t."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Final

import sympy

from hingepair.equations import spatial as eq
from hingepair.symbolic.constants import shown_fraction
from hingepair.symbolic.kinks import Expr

_MAX_DENOMINATOR: Final = 1_000  # of a fraction whose square root an entry is recognised as
_ROUNDING: Final = 4 * 2.0**-53  # tolerance: of an entry 0 or 1, of a root relative to its size, of an angle [rad]


def exact(value: float) -> Expr:
    """Return a finite number as the rational SymPy number that its shortest decimal form shows: 0.1 becomes 1/10."""
    return sympy.Rational(shown_fraction(value))


def exact_entry(value: float) -> Expr:
    """Return an entry of a rotation matrix as an exact number: 0, 1, -1 or a square root of a simple fraction, with
    either sign, if one of them equals the entry within rounding; otherwise the rational number that its shortest
    decimal form shows.

    >>> exact_entry(6e-17), exact_entry(0.7071067811865475), exact_entry(-0.25)
    (0, sqrt(2)/2, -1/4)
    """
    nearest = float(round(value))
    if abs(value - nearest) <= _ROUNDING:
        return sympy.Integer(int(nearest))
    square = Fraction(value * value).limit_denominator(_MAX_DENOMINATOR)
    root = sympy.sign(exact(value)) * sympy.sqrt(sympy.Rational(square))
    return root if abs(float(root) - value) <= _ROUNDING * abs(value) else exact(value)


def exact_angle(value: float) -> Expr:
    """Return an angle [rad] as an exact number that equals it within rounding: a multiple of pi/12 if there is one,
    otherwise the rational number with the fewest decimals.

    >>> exact_angle(0.7853981633974484), exact_angle(0.30000000000000004)
    (pi/4, 3/10)
    """
    step = math.pi / 12
    if abs(value - round(value / step) * step) <= _ROUNDING:
        return sympy.pi * sympy.Rational(round(value / step), 12)
    roundings = (round(value, decimals) for decimals in range(18))  # 17 decimals are closer than the tolerance
    return exact(next(number for number in roundings if abs(number - value) <= _ROUNDING))


def value_without_nested_roots(function: Callable[..., Expr], *arguments: Expr) -> Expr:
    """Return the value of a SymPy function at the further arguments, which are expressions without symbols. If the
    value has nested roots, return the unevaluated call instead.

    >>> value_without_nested_roots(sympy.cos, sympy.pi / 6), value_without_nested_roots(sympy.cos, sympy.pi / 60)
    (sqrt(3)/2, cos(pi/60))
    """
    value = function(*arguments)
    nested = any(not (power.exp.is_Integer or power.base.is_Rational) for power in value.atoms(sympy.Pow))
    return function(*arguments, evaluate=False) if nested else value


def exact_unit_axis(n: Sequence[Expr]) -> tuple[Expr, ...]:
    """Return the unit vector along `n`, three expressions of any non-zero length, as a tuple of three exact
    expressions.

    >>> exact_unit_axis([sympy.cos(1), sympy.sin(1), 0])
    (cos(1), sin(1), 0)
    >>> exact_unit_axis([1, 2, 2])
    (1/3, 2/3, 2/3)
    """
    square = sympy.Add(*(c**2 for c in map(sympy.sympify, n)))
    if not square.is_Rational and not square.free_symbols:  # cos(1)**2 + sin(1)**2, which is 1
        value = square.evalf(50)  # significant digits
        near = sympy.Rational(Fraction(str(value)).limit_denominator(1_000))
        square = near if abs(near - value) <= sympy.Rational(1, 10**40) * abs(value) else square
    length = sympy.sqrt(square)
    return tuple(c / length for c in n)


def axis_rotation(axis: Sequence[Expr], angle: Expr) -> tuple[Expr, ...]:
    """Return the rotation matrix of an angle [rad] about an axis of any length (E6) as a tuple of nine exact
    expressions, row by row.

    >>> axis_rotation([0, 0, 2], sympy.pi / 2)
    (0, -1, 0, 1, 0, 0, 0, 0, 1)
    """
    hinge = value_without_nested_roots(sympy.sin, angle), 1 - value_without_nested_roots(sympy.cos, angle)
    x, y, z = exact_unit_axis(axis)
    return _expanded(eq.hinge_rotation((x, y, z), hinge))


def roll_pitch_yaw_rotation(angles: Sequence[Expr]) -> tuple[Expr, ...]:
    """Return the rotation matrix of the angles roll, pitch and yaw [rad] about the fixed axes x, y, z as a tuple of
    nine exact expressions, row by row.

    >>> roll_pitch_yaw_rotation([sympy.pi / 2, 0, sympy.pi])
    (-1, 0, 0, 0, 0, 1, 0, 1, 0)
    """
    axes = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    roll, pitch, yaw = (axis_rotation(axis, angle) for axis, angle in zip(axes, angles, strict=True))
    return _expanded(eq.compose(eq.compose(yaw, pitch), roll))


def _expanded(entries: Sequence[Expr]) -> tuple[Expr, ...]:
    """Return the entries expanded to sums of products, so that terms that cancel vanish."""
    return tuple(sympy.expand(entry) for entry in entries)
