"""Numbers that carry a bound on what rounding has done to them (Higham, Accuracy and Stability, 3.3).

The equations run over them unchanged. A bound is rigorous for every way to evaluate the same equations in the same
order, with fused multiply-add or without, by either backend; it holds where numbers underflow, and is infinite or NaN
where they overflow. It is worst-case arithmetic: after many operations, what rounding really did is a third of it.

Components are floats or arrays, in float64 whatever the precision that is bounded.
"""

from __future__ import annotations

from typing import Any, ClassVar, Final, Self

import numpy as np

from hingepair.numeric.arrays import Component
from hingepair.numeric.blocks import VERSINE_SWITCH

UNIT_ROUNDOFF: Final = 2.0**-53  # largest relative error u of a rounding to double precision
# Most units of its last place that a sine or cosine is off: 0.52 of NumPy and C (float32: 1.48), 1.47 if compiled.
SINE_ULPS = 1.5
_NEAR: Final = 1e6  # rad; sines of angles beyond have an error of the reduction by multiples of pi/2 as well:
_FAR_ERROR: Final = 2.0**-88  # a search found 2^-92.4 in the C library; it counts where the sine is below 1e-10


class Bounded:
    """A computed number with a bound on its distance from the exact one, at one or many samples. Sums, products and
    functions of such numbers are such numbers again.
    """

    __array_ufunc__ = None  # NumPy leaves sums and products with its numbers to the methods below
    __slots__ = ("bound", "value")

    dtype: ClassVar[type[np.floating[Any]]] = np.float64  # whose rounding errors count
    u: ClassVar[float] = UNIT_ROUNDOFF
    smallest: ClassVar[float] = 2.0**-1074
    largest: ClassVar[float] = float(np.finfo(np.float64).max)

    def __init__(self, value: Component, bound: Component = 0.0) -> None:
        self.value = value  # of one evaluation; that of any other differs by at most twice the bound
        self.bound = bound  # largest distance of any evaluation from the exact number

    @classmethod
    def rounded(cls, value: Component, bound: Component = 0.0) -> Self:
        """Return a float64 with this bound, rounded to the precision of the class."""
        number = np.asarray(value, cls.dtype).astype(np.float64)
        return cls(number, np.abs(number - value) + bound)

    @property
    def error(self) -> Component:
        """The bound, with what covers the rounding of its own arithmetic; infinite where it is NaN."""
        # A robot's longest recursion takes fewer than 2^16 operations, whose bounds are computed in float64.
        bound = self.bound * (1 + max(2.0**10 * self.u, 2.0**16 * UNIT_ROUNDOFF))
        return np.where(np.isnan(bound), np.inf, bound)

    def __add__(self, other: Self | float) -> Self:
        x, y = self, self._as_bounded(other)
        total = x.value + y.value
        carried, rounding = x.bound + y.bound, self._rounding_error(total, x.bound + y.bound)
        # A sum is rounded by no more than its smaller term: the larger one is a number, too.
        least = np.minimum(np.abs(x.value) + 2 * x.bound, np.abs(y.value) + 2 * y.bound)
        return type(self)(total, carried + np.where(np.isinf(rounding), np.inf, np.minimum(rounding, least)))

    __radd__ = __add__

    def __neg__(self) -> Self:
        return type(self)(-self.value, self.bound)

    def __sub__(self, other: Self | float) -> Self:
        return self + -other

    def __rsub__(self, other: float) -> Self:
        return -self + other

    def __mul__(self, other: Self | float) -> Self:
        x, y = self, self._as_bounded(other)
        product = x.value * y.value
        carried = np.abs(x.value) * y.bound + np.abs(y.value) * x.bound + 3 * x.bound * y.bound
        exact = _multiplies_exactly(x) | _multiplies_exactly(y)
        rounding = self._rounding_error(product, carried) + 4 * self.smallest
        return type(self)(product, carried + np.where(exact, 0.0, rounding))

    __rmul__ = __mul__

    def __truediv__(self, other: Self | float) -> Self:
        y = self._as_bounded(other)
        ratio = self.value / y.value
        size = np.abs(y.value)
        near = size - y.bound
        exact = np.abs(ratio) + self.bound / near + np.abs(ratio) * (y.bound / near)
        least = size - 2 * y.bound  # of the denominator of any evaluation
        carried = np.where(least > 0, self.bound / least + exact * (y.bound / least), np.inf)
        return type(self)(ratio, carried + self._rounding_error(ratio, carried) + 4 * self.smallest)

    def __rtruediv__(self, other: float) -> Self:
        made: Self = self._as_bounded(other) / self
        return made

    def sine(self) -> Self:
        """Return the sine of this angle, which adds 1.5 units in the last place; that of an exact 0 is exact."""
        s = np.sin(self.value)
        rounding = self._sine_rounding(np.abs(s) + 2 * self.bound) + self._reduction_error() + self.smallest
        return type(self)(s, np.where(self._is_exact_zero(), 0.0, self.bound + rounding))

    def cosine(self) -> Self:
        """Return the cosine of this angle, which adds 1.5 units in the last place; that of an exact 0 is exact."""
        c, half = np.cos(self.value), np.abs(np.sin(0.5 * self.value)) + self.bound
        # The cosine of a small angle is 1, rounded: it is off by no more than a few times what it lacks of 1.
        near_one = 6 * half * half + self.smallest
        rounding = np.minimum(self._sine_rounding(np.abs(c) + 2 * self.bound), near_one) + self._reduction_error()
        return type(self)(c, np.where(self._is_exact_zero(), 0.0, self.bound + rounding))

    def _reduction_error(self) -> Component:
        """Return the error of a far angle's sine or cosine that does not shrink with its value."""
        return np.where(np.abs(self.value) > _NEAR, _FAR_ERROR, 0.0)

    def _is_exact_zero(self) -> Any:
        """Return whether this number is 0 without an error, sample by sample."""
        return (self.value == 0) & (self.bound == 0)

    def versine(self) -> Self:
        """Return 1 - cosine of this angle: s^2 / (1 + c) where its cosine c is above 0.7, else 1 - c."""
        s, c = self.sine(), self.cosine()
        near, far = s * s / (1 + c), 1 - c
        value = np.where(c.value > VERSINE_SWITCH, near.value, far.value)
        # Either way is taken where the cosine is about 0.7.
        either = np.where(c.value > 0.75, near.bound, np.maximum(near.bound, far.bound))
        return type(self)(value, np.where(c.value > 0.65, either, far.bound))

    @classmethod
    def _as_bounded(cls, other: Any) -> Any:
        """Return a plain number as an exact one."""
        return other if isinstance(other, Bounded) else cls(other)

    @classmethod
    def _rounding_error(cls, value: Component, carried_bound: Component) -> Component:
        """Return half a unit in the last place of a result; infinite where it may overflow."""
        size = np.abs(value) + 2 * carried_bound
        return np.where(size <= cls.largest, in_last_places(0.5, size, cls.u), np.inf)

    @classmethod
    def _sine_rounding(cls, size: Component) -> Component:
        """Return the rounding error of a sine or cosine of this size."""
        largest_size = np.minimum(np.abs(size) * (1 + 4 * cls.u), 1 - cls.u)
        return in_last_places(SINE_ULPS, largest_size, cls.u)


class BoundedSingle(Bounded):
    """Bounded numbers whose rounding errors are those of float32; value and bound are float64."""

    __slots__ = ()
    dtype = np.float32
    u, smallest, largest = 2.0**-24, 2.0**-149, float(np.finfo(np.float32).max)


def bounded_class(dtype: np.dtype[Any]) -> type[Bounded]:
    """Return the class for a dtype."""
    return BoundedSingle if dtype == np.float32 else Bounded


def conversion_error(number: Any) -> Component:
    """Return how much a number or an array changes when it is converted to float64, as integers above 2^53 may.

    >>> float(conversion_error(2**53 + 1)), conversion_error(0.1)
    (1.0, 0.0)
    """
    array = np.asarray(number)
    if array.dtype.kind not in "iu" or array.dtype.itemsize < 8:
        return 0.0
    high = array >> 32 << 32
    return np.abs((array.astype(np.float64) - high.astype(np.float64)) - (array - high).astype(np.float64))


def in_last_places(count: float, size: Component, u: float) -> Component:
    """Return `count` units in the last place of a number of this size, for the unit roundoff u; 0 of 0."""
    _, exponent = np.frexp(size)
    return np.where(size == 0, 0.0, np.ldexp(count * u, exponent))


def _multiplies_exactly(x: Bounded) -> Any:
    """Return whether x is exactly 0, 1 or -1."""
    return (x.bound == 0) & ((x.value == 0) | (np.abs(x.value) == 1))
