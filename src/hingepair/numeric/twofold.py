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
        total = self.high + other.high
        return normal(total, sum_error(self.high, other.high, total) + (self.low + other.low))

    def __neg__(self) -> Twofold:
        return Twofold(-self.high, -self.low)

    def __sub__(self, other: Twofold) -> Twofold:
        return self + -other

    def __mul__(self, other: Twofold) -> Twofold:
        high, error = product(self.high, other.high)
        return normal(high, error + (self.high * other.low + self.low * other.high))


def normal(high: Component, low: Component) -> Twofold:
    """The sum of two numbers of which the second is much smaller."""
    total = high + low
    return Twofold(total, (high - total) + low)


def product(a: Component, b: Component) -> tuple[Component, Component]:
    """Dekker: a b = product + error, exactly."""
    high = a * b
    (ah, al), (bh, bl) = _split(a), _split(b)
    return high, ((ah * bh - high) + ah * bl + al * bh) + al * bl


def sum_error(a: Component, b: Component, total: Component) -> Component:
    """Knuth: what the rounding of total = a + b lost."""
    shadow = total - a
    return (a - (total - shadow)) + (b - shadow)


def _split(x: Component) -> tuple[Component, Component]:
    """Veltkamp: x = high + low, of 26 bits each."""
    carried = 134217729.0 * x
    high = carried - (carried - x)
    return high, x - high
