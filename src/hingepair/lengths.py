"""Lengths and directions of vectors to the last bit: no overflow, no underflow, one rounding."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.arrays import vectors
from hingepair.errors import AxisError


def unit_axis(name: str, n: ArrayLike) -> NDArray[np.float64]:
    """The axis n at unit length, each component rounded once; lengths from 1e-300 to 1e300.

    Raises:
        AxisError: n is zero or not finite.
    """
    axis = vectors(name, n, 3).astype(np.float64)
    if not np.isfinite(axis).all():
        raise AxisError(name, "a finite axis", np.asarray(n).tolist())
    if np.any((axis == 0).all(axis=-1)):
        raise AxisError(name, "a non-zero axis", np.asarray(n).tolist())
    return polar(axis)[0]


def polar(v: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Direction and length of v; the length as a sum of two doubles, the direction (of zero: zero) from that sum."""
    with np.errstate(all="ignore"):
        w, exponent = by_power_of_two(v)
        square, rest = _product(w, w)
        total = square.sum(axis=-1, keepdims=True)
        # What the three roundings of squares and sum lost, found exactly (two-sum) and added in.
        partial = square[..., :1] + square[..., 1:2]
        lost = _two_sum_error(square[..., :1], square[..., 1:2], partial)
        lost += _two_sum_error(partial, square[..., 2:], partial + square[..., 2:])
        total = partial + square[..., 2:]
        length = np.sqrt(total)
        again, tail = _product(length, length)
        remainder = (total - again) - tail + (lost + rest.sum(axis=-1, keepdims=True))
        safe = np.where(length > 0, length, 1.0)
        low = remainder / (2 * safe)
        ratio = w / safe
        product, error = _product(ratio, safe)
        direction = ratio + ((w - product) - error - ratio * low) / safe
        return direction, np.ldexp(length, exponent)[..., 0], np.ldexp(low, exponent)[..., 0]


def by_power_of_two(v: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.intc]]:
    """The vector scaled exactly so that its largest component is in [0.5, 1), and the exponent taken out."""
    _, exponent = np.frexp(np.abs(v).max(axis=-1, keepdims=True, initial=0.0))
    half = -exponent // 2  # in two steps: 2^-e itself overflows for subnormal vectors
    return np.ldexp(np.ldexp(v, half), -exponent - half), exponent


def _split(x: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Veltkamp: x = high + low, of 26 bits each."""
    carried = 134217729.0 * x
    high = carried - (carried - x)
    return high, x - high


def _product(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Dekker: a b = product + error, exactly."""
    product = a * b
    (ah, al), (bh, bl) = _split(a), _split(b)
    return product, ((ah * bh - product) + ah * bl + al * bh) + al * bl


def _two_sum_error(a: NDArray[np.float64], b: NDArray[np.float64], total: NDArray[np.float64]) -> NDArray[np.float64]:
    """Knuth: what the rounding of total = a + b lost."""
    shadow = total - a
    return (a - (total - shadow)) + (b - shadow)
