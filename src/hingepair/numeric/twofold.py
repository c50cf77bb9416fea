"""Numbers of twice the precision of a double, each the sum of two: for constants that must be right to the last bit.

Components are floats or arrays, neither too large to be multiplied by 2^27 nor their products subnormal.
"""

from __future__ import annotations

from hingepair.numeric.arrays import Component


class Twofold:
    """The number high + low, where low is what high lost in rounding; it adds, subtracts and multiplies."""

    __slots__ = ("high", "low")

    def __init__(self, high: Component, low: Component = 0.0) -> None:
        self.high = high
        self.low = low

    def __add__(self, other: Twofold) -> Twofold:
        a, b = self.high, other.high
        total = a + b
        return normal(total, sum_error(a, b, total) + (self.low + other.low))

    def __neg__(self) -> Twofold:
        return Twofold(-self.high, -self.low)

    def __sub__(self, other: Twofold) -> Twofold:
        a, b = self.high, -other.high
        total = a + b
        return normal(total, sum_error(a, b, total) + (self.low - other.low))

    def __mul__(self, other: Twofold) -> Twofold:
        high, error = product(self.high, other.high)
        return normal(high, error + (self.high * other.low + self.low * other.high))


def normal(high: Component, low: Component) -> Twofold:
    """The sum of two numbers of which the second is much smaller."""
    total = high + low
    return Twofold(total, (high - total) + low)


def product(a: Component, b: Component) -> tuple[Component, Component]:
    """Dekker: a b = product + error, exactly; a and b split into halves of 26 bits each (Veltkamp)."""
    high = a * b
    carried = 134217729.0 * a
    ah = carried - (carried - a)
    al = a - ah
    carried = 134217729.0 * b
    bh = carried - (carried - b)
    bl = b - bh
    return high, ((ah * bh - high) + ah * bl + al * bh) + al * bl


def sum_error(a: Component, b: Component, total: Component) -> Component:
    """Knuth: what the rounding of total = a + b lost."""
    shadow = total - a
    return (a - (total - shadow)) + (b - shadow)
