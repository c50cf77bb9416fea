"""How large an expression may become: limits, and estimates made before anything is computed.

Within the limits an expression is read, differentiated twice and compiled in about a second.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

MAX_LENGTH: Final = 10_000
"""Characters of the text."""
MAX_DEPTH: Final = 50
"""Levels of brackets, calls and powers; the terms of a sum and the factors of a product are one level."""
MAX_NODES: Final = 3_000
"""Numbers, names and operations."""
MAX_EXPONENT: Final = 1_000
"""Of a power, and of the ten in a decimal number."""
MAX_ROOT: Final = 10_000
"""Denominator of an exponent: t**0.1234."""
MAX_BITS: Final = 4_096
"""Of the numerator and the denominator of an exact number."""
MAX_TERMS: Final = 16_000
"""Nodes of an expression and its first two derivatives, estimated from above."""


class Cost(NamedTuple):
    """How many nodes an expression, its first and its second derivative have, from above."""

    size: int
    first: int = 0
    second: int = 0


_HEAVY: Final = {"tan": 2, "tanh": 2, "asin": 2, "acos": 2, "atan": 2, "asinh": 2, "atanh": 2, "atan2": 3, "acosh": 8}
"""Functions whose derivatives are larger than themselves."""


def sum_cost(costs: Sequence[Cost]) -> Cost:
    """The cost of a sum: derivatives add."""
    total = _total(costs)
    return Cost(total.size, min(total.first, 1)) if total.second == 0 else total


def product_cost(costs: Sequence[Cost], varying: int) -> Cost:
    """The cost of a product: every varying factor gives a term, every pair of them gives one again."""
    total = _total(costs)
    if varying <= 1:
        return Cost(total.size, min(total.first, 1)) if total.second == 0 else total
    size, first, second = total
    pairs = varying * (varying - 1) // 2
    return Cost(size, first + varying * size, second + varying * first + pairs * size)


def function_cost(costs: Sequence[Cost], function: str = "") -> Cost:
    """The cost of f(u) or f(u, v): f' u', then f'' u'^2 + f' u''."""
    size, first, second = _total(costs)
    weight = _HEAVY.get(function, 1)
    if second == 0:
        return Cost(size, weight * (size + 2), weight * (size + 3))
    return Cost(size, weight * size + first + 2, weight * (2 * size + 2) + 2 * first + second)


def _total(costs: Sequence[Cost]) -> Cost:
    size, first, second = (sum(column) for column in zip(*costs, strict=True))
    return Cost(size + 1, first + 1 if first else 0, second + 1 if second else 0)


def bits(number: Any) -> int:
    """The bits of the longer of a SymPy rational's numerator and denominator."""
    return max(int(number.p).bit_length(), int(number.q).bit_length())
