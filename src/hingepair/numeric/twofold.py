"""Numbers of twice the precision of a double, each the sum of two: high, and low, what high lost in rounding.

As pairs (high, low) they are components like any other; as `Twofold` the equations run over them. Components are
floats, arrays or traced values, neither too large to be multiplied by 2^27 nor their products subnormal. Nothing here
may be reordered or fused by a compiler.
"""

from __future__ import annotations

from typing import TypeAlias

from hingepair.numeric.arrays import Component

HighLow: TypeAlias = tuple[Component, Component]


class Twofold:
    """A number high + low, which adds, subtracts and multiplies."""

    __slots__ = ("high", "low")

    def __init__(self, high: Component, low: Component = 0.0) -> None:
        self.high = high
        self.low = low

    def __add__(self, other: Twofold) -> Twofold:
        total, lost = exact_sum(self.high, other.high)
        return Twofold(*normal(total, lost + (self.low + other.low)))

    def __neg__(self) -> Twofold:
        return Twofold(-self.high, -self.low)

    def __sub__(self, other: Twofold) -> Twofold:
        return self + -other

    def __mul__(self, other: Twofold) -> Twofold:
        high, lost = exact_product(self.high, other.high)
        return Twofold(*normal(high, lost + (self.high * other.low + self.low * other.high)))


def normal(high: Component, low: Component) -> HighLow:
    """Return the exact sum of two doubles as (sum, rounding error); `low` may not be larger than `high`."""
    total = high + low
    return total, (high - total) + low


def exact_sum(a: Component, b: Component) -> HighLow:
    """Return the exact sum of two doubles as (sum, rounding error): Knuth's algorithm."""
    total = a + b
    shadow = total - a
    return total, (a - (total - shadow)) + (b - shadow)


def exact_product(a: Component, b: Component) -> HighLow:
    """Return the exact product of two doubles as (product, rounding error): Dekker's algorithm with Veltkamp's split
    into halves of 26 bits.
    """
    high = a * b
    carried = 134217729.0 * a
    ah = carried - (carried - a)
    al = a - ah
    carried = 134217729.0 * b
    bh = carried - (carried - b)
    bl = b - bh
    return high, ((ah * bh - high) + ah * bl + al * bh) + al * bl
