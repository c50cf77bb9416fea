"""Numbers without t in expressions: exact fractions, or fractions that are accurate to some 70 digits.

A condition on constants, such as sqrt(2)*sqrt(3) <= sqrt(6), needs more digits than a float has.
"""

from __future__ import annotations

import functools
import math
import operator
from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Any, Final, NamedTuple

from hingepair.equations import spatial as eq

MAX_BITS: Final = 4_096
"""Largest number of bits of the numerator and of the denominator of an exact number; a longer one is refused."""
MAX_EXPONENT: Final = 1_000
"""Largest size of the exponent of a power, and of the exponent of ten in a decimal number; others are refused."""
MAX_ROOT: Final = 10_000
"""Largest denominator of an exponent: t**0.1234 has 5000. Others are refused."""

_BITS: Final = 256  # to which numbers that are not exact are rounded
_CANCELLED: Final = Fraction(1, 2**200)  # a sum this small relative to its largest term is 0


class Constant(NamedTuple):
    """Number that does not depend on t."""

    value: Fraction
    #: whether `value` is the number itself
    exact: bool = True

    def __float__(self) -> float:
        try:
            return float(self.value)
        except OverflowError:
            return math.inf if self.value > 0 else -math.inf


PI: Final = Constant(
    Fraction("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899863"), False
)
E: Final = Constant(
    Fraction("2.71828182845904523536028747135266249775724709369995957496696762772407663035354759457"), False
)

_DIRECT: Final[dict[str, Callable[..., Fraction]]] = {  # whose values for fractions are fractions
    "min": min,
    "max": max,
    "abs": abs,
    "sign": lambda x: Fraction((x > 0) - (x < 0)),
    "mod": operator.mod,
}


class LimitError(ArithmeticError):
    """An operation would take too long; the text says what is allowed."""


def shown_fraction(value: float) -> Fraction:
    """Return a finite number as the fraction that its shortest decimal form shows: 0.1 becomes 1/10."""
    return Fraction(repr(value if isinstance(value, int) else float(value)))


def bit_length(value: Fraction) -> int:
    """Return the larger of the numbers of bits of numerator and denominator."""
    return max(value.numerator.bit_length(), value.denominator.bit_length())


def add(terms: Sequence[Constant]) -> Constant:
    """Return the sum of the terms, 0 where they cancel within rounding."""
    total = sum((term.value for term in terms), Fraction())
    exact = all(term.exact for term in terms)
    if not exact and abs(total) <= _CANCELLED * max(abs(term.value) for term in terms):
        return Constant(Fraction())
    return _limited(total, exact)


def multiply(factors: Sequence[Constant]) -> Constant:
    """Return the product of the factors."""
    return _limited(math.prod((factor.value for factor in factors), start=Fraction(1)), all(f.exact for f in factors))


def divide(x: Constant, y: Constant) -> Constant:
    """Return x / y."""
    return _limited(x.value / y.value, x.exact and y.exact)


def power(base: Constant, exponent: Constant) -> Constant:
    """Return base**exponent; raise a ValueError where it is not real."""
    check_power(base, exponent)
    if exponent.exact and exponent.value.denominator == 1:
        float(base) ** int(exponent.value)  # raises an OverflowError before many digits are computed
        return _limited(base.value ** int(exponent.value), base.exact)
    math.pow(float(base), float(exponent))
    return _real(_precise().power(_mpf(base), _mpf(exponent)))


def check_power(base: Constant | None, exponent: Constant) -> None:
    """Raise a LimitError if a power takes too long; `base` is None if it is not a constant."""
    value = exponent.value
    if exponent.exact and (abs(value) > MAX_EXPONENT or value.denominator > MAX_ROOT):
        raise LimitError(f"an exponent of at most {MAX_EXPONENT}, with at most 4 decimals")
    if base is not None and base.exact and bit_length(base.value) * abs(value) > MAX_BITS:
        raise LimitError(f"exact numbers of at most {MAX_BITS} bits")


def evaluate(function: str, parts: Sequence[Constant]) -> Constant:
    """Return the value of a function, such as sin; raise a ValueError where it is not real."""
    if function == "mod" and not all(part.exact for part in parts):
        periods = parts[0].value / parts[1].value
        if abs(periods - round(periods)) <= _CANCELLED * (1 + abs(periods)):  # mod(3*pi, pi)
            return Constant(Fraction())
    if function in _DIRECT:
        return _limited(_DIRECT[function](*(part.value for part in parts)), all(part.exact for part in parts))
    if function in ("sin", "tan", "asin", "atan", "sinh", "tanh", "asinh", "atanh", "sqrt") and not parts[0].value:
        return Constant(Fraction())
    getattr(math, function)(*map(float, parts))
    value = _real(getattr(_precise(), function)(*map(_mpf, parts)))
    if function in ("sin", "cos", "tan") and not parts[0].exact:  # multiples of pi
        size = abs(value.value)
        if size > 1 / _CANCELLED:
            raise ValueError("a pole")
        if size < _CANCELLED * (1 + abs(parts[0].value)):
            return Constant(Fraction())
    return value


def rotation_matrix(axis: Sequence[Constant], angle: Constant) -> tuple[float, ...]:
    """Return the rotation of an angle [rad] about an axis of any length (E6): nine numbers, row by row, each rounded
    once.
    """
    return tuple(map(float, _rotation(axis, angle)))


def roll_pitch_yaw_matrix(angles: Sequence[Constant]) -> tuple[float, ...]:
    """Return the rotation of the angles roll, pitch and yaw [rad] about the fixed axes x, y, z, as `rotation_matrix`
    does.
    """
    zero, one = Constant(Fraction()), Constant(Fraction(1))
    axes = (one, zero, zero), (zero, one, zero), (zero, zero, one)
    roll, pitch, yaw = (_rotation(axis, angle) for axis, angle in zip(axes, angles, strict=True))
    entries = eq.compose(eq.compose(yaw, pitch), roll)
    return tuple(map(float, _without_rounding(entries, min(abs(x) for x in (*roll, *pitch, *yaw) if x))))


def _rotation(axis: Sequence[Constant], angle: Constant) -> tuple[Any, ...]:
    """Return the entries of a rotation (E6) as numbers of mpmath, row by row."""
    n = [_mpf(c) for c in axis]
    length = _precise().sqrt(sum(c * c for c in n))
    x, y, z = (c / length for c in n)
    sine, cosine = (_mpf(evaluate(function, (angle,))) for function in ("sin", "cos"))
    return _without_rounding(eq.hinge_rotation((x, y, z), (sine, 1 - cosine)), abs(sine) + 1 - cosine)


def _without_rounding(entries: Sequence[Any], scale: Any) -> tuple[Any, ...]:
    """Return the entries, 0 where terms of the size `scale` cancel."""
    limit = scale * _mpf(Constant(_CANCELLED))
    return tuple(entry if abs(entry) > limit else 0 * entry for entry in entries)


@functools.cache
def _precise() -> Any:
    """Return the functions of mpmath with a precision of their own; the global one belongs to the user."""
    import mpmath

    context = mpmath.MPContext()
    context.prec = _BITS + 16
    return context


def _mpf(number: Constant) -> Any:
    return _precise().mpf(number.value.numerator) / number.value.denominator


def _real(value: Any) -> Constant:
    """Return the real part of a number of mpmath as a Constant; the imaginary part is rounding, as of acos(1)."""
    sign, mantissa, exponent, bits = value.real._mpf_
    if exponent + bits < -MAX_BITS:
        return Constant(Fraction(), False)
    signed = -int(mantissa) if sign else int(mantissa)
    return Constant(Fraction(signed) * Fraction(2) ** int(exponent), False)


def _limited(value: Fraction, exact: bool) -> Constant:
    """Return a Constant; raise a LimitError if an exact number is too long, and round one that is not exact."""
    if exact:
        if bit_length(value) > MAX_BITS:
            raise LimitError(f"exact numbers of at most {MAX_BITS} bits")
        return Constant(value)
    shift = _BITS + value.denominator.bit_length() - value.numerator.bit_length()
    return Constant(Fraction(round(value * Fraction(2) ** shift)) / Fraction(2) ** shift, False)
