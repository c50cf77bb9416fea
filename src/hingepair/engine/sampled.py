"""Numbers at many samples that are computed at once, and fold as a trace does (engine.trace)."""

from __future__ import annotations

from typing import Any

from hingepair.numeric.blocks import cosine, sine


class Sampled:
    """A number at each sample. A product with 0 is 0, with 1 the other factor, as in a trace: NaN of one joint does
    not reach what does not depend on it.
    """

    __array_ufunc__ = None  # NumPy's numbers leave sums and products with it to the methods below
    __slots__ = ("value",)

    def __init__(self, value: Any) -> None:
        self.value = value

    def __add__(self, other: Sampled | float) -> Sampled:
        if type(other) is Sampled:
            return Sampled(self.value + other.value)
        return self if other == 0 else Sampled(self.value + other)

    __radd__ = __add__

    def __sub__(self, other: Sampled | float) -> Sampled:
        if type(other) is Sampled:
            return Sampled(self.value - other.value)
        return self if other == 0 else Sampled(self.value - other)

    def __rsub__(self, other: float) -> Sampled:
        return Sampled(-self.value if other == 0 else other - self.value)

    def __mul__(self, other: Sampled | float) -> Sampled | float:
        if type(other) is Sampled:
            return Sampled(self.value * other.value)
        if other == 0:
            return 0.0
        if other == 1:
            return self
        return Sampled(-self.value if other == -1 else self.value * other)

    __rmul__ = __mul__

    def __truediv__(self, other: Sampled | float) -> Sampled:
        if type(other) is Sampled:
            return Sampled(self.value / other.value)
        return self if other == 1 else Sampled(self.value / other)

    def __rtruediv__(self, other: float) -> Sampled | float:
        return 0.0 if other == 0 else Sampled(other / self.value)

    def __neg__(self) -> Sampled:
        return Sampled(-self.value)

    def sine(self) -> Sampled:
        """Return the sine [rad]."""
        return Sampled(sine(self.value))

    def cosine(self) -> Sampled:
        """Return the cosine [rad]."""
        return Sampled(cosine(self.value))


def sampled_value(number: Sampled | float) -> Any:
    """Return the values of a number at its samples."""
    return number.value if type(number) is Sampled else number
