"""Lengths and directions of vectors to the last bit: no overflow, no underflow, one rounding.

Vectors are tuples of components, floats or arrays, of any dimension.
"""

from __future__ import annotations

import functools
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import AxisError
from hingepair.numeric.arrays import Component, all_finite, vectors
from hingepair.numeric.blocks import Components, components_of, tabulate_one
from hingepair.numeric.twofold import Twofold, exact_product, exact_sum, normal


def unit_axis(name: str, n: ArrayLike) -> NDArray[Any]:
    """Return the axes n at unit length as a float64 array (..., 3), each component rounded once.

    Raises:
        AxisError: n is zero or not finite.
    """
    axis = components_of(finite_axis(name, n))
    return tabulate_one(lambda values: direction(values["n"]), {"n": axis}, (3,), np.dtype(np.float64))


def finite_axis(name: str, n: ArrayLike) -> NDArray[Any]:
    """Return the axes n as an array (..., 3), not normalised, after checking that each is finite and not zero.

    Raises:
        AxisError: n is zero or not finite.
    """
    axis = vectors(name, n, 3)
    if not all_finite(axis):
        raise AxisError(name, "a finite axis", n)
    if not (any(axis.tolist()) if axis.ndim == 1 else axis.any(axis=-1).all()):
        raise AxisError(name, "a non-zero axis", n)
    return axis


def least_axis(n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit vector along the coordinate axis with the largest angle to n; shape (..., 3)."""
    axis: NDArray[np.float64] = np.eye(3)[np.argmin(np.abs(n), axis=-1)]
    return axis


def direction(v: Components) -> Components:
    """Return the unit vector along v, a tuple of components, each rounded once; that of zero is zero."""
    return tuple(unit.high for unit in polar(v)[0])


def polar(v: Components) -> tuple[tuple[Twofold, ...], Twofold]:
    """Return the direction of v, a tuple of components, and its length, in twice the precision; the direction of zero
    is zero.
    """
    w, exponent = scaled_by_power_of_two(v)
    total: Component = 0.0
    low_sum: Component = 0.0
    for component in w:
        square, square_low = exact_product(component, component)
        total, sum_low = exact_sum(total, square)
        low_sum = low_sum + (sum_low + square_low)
    length: Component
    safe: Component
    if type(total) is float:
        length = math.sqrt(total)
        safe = length if length > 0 else 1.0
    else:
        length = np.sqrt(total)
        safe = np.where(length > 0, length, 1.0)
    again, square_low = exact_product(length, length)
    low = ((total - again) - square_low + low_sum) / (2 * safe)
    units = tuple(_quotient(component, safe, low) for component in w)
    return units, Twofold(times_power_of_two(length, exponent), times_power_of_two(low, exponent))


def scaled_by_power_of_two(v: Components) -> tuple[Components, Component]:
    """Return v / 2^exponent, exactly, whose largest component is neither huge nor tiny, and the exponent."""
    if all(type(component) is float for component in v):
        size = max(map(abs, v))
        if 2.0**-10 < size < 2.0**10:  # usual lengths in metres, and axes that are nearly unit vectors
            return v, 0
        _, exponent = math.frexp(size)
    else:
        _, exponent = np.frexp(functools.reduce(np.maximum, (np.abs(component) for component in v)))
    half = -exponent // 2  # in two steps: 2^-e itself overflows for subnormal vectors
    return tuple(
        times_power_of_two(times_power_of_two(component, half), -exponent - half) for component in v
    ), exponent


def times_power_of_two(x: Component, exponent: Component) -> Component:
    """Return x 2^exponent."""
    if type(x) is float and type(exponent) is int:
        if exponent == 0:
            return x
        try:
            return math.ldexp(x, exponent)
        except OverflowError:
            return math.copysign(math.inf, x)
    return np.ldexp(x, exponent)


def _quotient(a: Component, high: Component, low: Component) -> Twofold:
    """Return a double over a number of twice the precision."""
    ratio = a / high
    again, error = exact_product(ratio, high)
    return Twofold(*normal(ratio, ((a - again) - error - ratio * low) / high))
