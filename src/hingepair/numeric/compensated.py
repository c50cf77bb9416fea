"""Sums that keep what rounding loses: numbers of twice the precision as tuples (high, low), which also compile.

Nothing here may be reordered by a compiler.
"""

from __future__ import annotations

from typing import Any, TypeAlias

from hingepair.numeric.twofold import product, sum_error

Scalar: TypeAlias = Any
Pair: TypeAlias = tuple[Scalar, Scalar]


def exact_sum(a: Scalar, b: Scalar) -> Pair:
    """The sum a + b, exactly."""
    total = a + b
    return total, sum_error(a, b, total)


def pair_sum(a: Pair, b: Pair) -> Pair:
    """The sum of two pairs."""
    total, lost = exact_sum(a[0], b[0])
    return exact_sum(total, lost + (a[1] + b[1]))


def pair_product(a: Pair, b: Pair) -> Pair:
    """The product of two pairs."""
    high, lost = product(a[0], b[0])
    return exact_sum(high, lost + (a[0] * b[1] + a[1] * b[0]))


def pair_quotient(a: Pair, divisor: Scalar) -> Pair:
    """A pair divided by a number."""
    quotient = a[0] / divisor
    high, lost = product(quotient, divisor)
    return exact_sum(quotient, (((a[0] - high) - lost) + a[1]) / divisor)
