"""Sums that keep what rounding loses: a number as a sum (high, low) of two doubles, as plain arithmetic.

Error-free transformations of Knuth and Dekker; nothing here may be reordered by a compiler.
"""

from __future__ import annotations

from typing import TypeAlias

from hingepair.equations import Scalar

Pair: TypeAlias = tuple[Scalar, Scalar]

_SPLIT = 134217729.0  # 2^27 + 1


def exact_sum(a: Scalar, b: Scalar) -> Pair:
    """The sum a + b, exactly."""
    total = a + b
    shadow = total - a
    return total, (a - (total - shadow)) + (b - shadow)


def exact_product(a: Scalar, b: Scalar) -> Pair:
    """The product a b, exactly."""
    product = a * b
    carried = _SPLIT * a
    ah = carried - (carried - a)
    carried = _SPLIT * b
    bh = carried - (carried - b)
    al, bl = a - ah, b - bh
    return product, ((ah * bh - product) + ah * bl + al * bh) + al * bl


def pair_sum(a: Pair, b: Pair) -> Pair:
    """The sum of two pairs."""
    total, lost = exact_sum(a[0], b[0])
    return exact_sum(total, lost + (a[1] + b[1]))


def pair_product(a: Pair, b: Pair) -> Pair:
    """The product of two pairs."""
    product, lost = exact_product(a[0], b[0])
    return exact_sum(product, lost + (a[0] * b[1] + a[1] * b[0]))


def pair_quotient(a: Pair, divisor: Scalar) -> Pair:
    """A pair divided by a number."""
    quotient = a[0] / divisor
    product, lost = exact_product(quotient, divisor)
    return exact_sum(quotient, (((a[0] - product) - lost) + a[1]) / divisor)


def one_node(p1: Scalar, h: Pair) -> Pair:
    """The integral of p over a step from its value in the middle."""
    return pair_product((p1, 0 * p1), h)


def two_nodes(p1: Scalar, p2: Scalar, h: Pair) -> Pair:
    """The integral of p over a step from its values at two Gauss nodes."""
    return pair_product(pair_quotient(exact_sum(p1, p2), 2.0), h)


def three_nodes(p1: Scalar, p2: Scalar, p3: Scalar, outer: Scalar, middle: Scalar, h: Pair) -> Pair:
    """The integral of p over a step from three values of weights outer, middle, outer, which are integers.

    5, 8, 5 make Gauss's rule of three nodes, 1, 4, 1 Simpson's.
    """
    weighted = pair_sum(pair_product(exact_sum(p1, p3), (outer, 0 * p1)), exact_product(p2, middle + 0 * p2))
    return pair_product(pair_quotient(weighted, 2 * outer + middle), h)
