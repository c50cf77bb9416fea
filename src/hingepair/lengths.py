"""Lengths and directions of vectors to the last bit: no overflow, no underflow, one rounding.

Vectors are tuples of components, floats or arrays, of any dimension.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.arrays import Component, vectors
from hingepair.blocks import Components, components_of, evaluate
from hingepair.errors import AxisError


def unit_axis(name: str, n: ArrayLike) -> NDArray[Any]:
    """The axis n at unit length in float64, each component rounded once; shape (..., 3).

    Raises:
        AxisError: n is zero or not finite.
    """
    axis = vectors(name, n, 3)
    if not np.isfinite(axis).all():
        raise AxisError(name, "a finite axis", n)
    if np.any((axis == 0).all(axis=-1)):
        raise AxisError(name, "a non-zero axis", n)
    return evaluate(lambda values: direction(values["n"]), {"n": components_of(axis)}, (3,), np.dtype(np.float64))


def direction(v: Components) -> Components:
    """The vector at unit length, each component rounded once; of zero: zero."""
    return polar(v)[0]


def polar(v: Components) -> tuple[Components, Component, Component]:
    """Direction and length of a vector; the length as a sum of two doubles, of which the second is tiny."""
    w, exponent = _by_power_of_two(v)
    total: Component = 0.0
    lost: Component = 0.0
    for component in w:
        square, tail = _product(component, component)
        previous, total = total, total + square
        lost = lost + (_sum_error(previous, square, total) + tail)
    length = np.sqrt(total)
    again, tail = _product(length, length)
    safe = np.where(length > 0, length, 1.0)
    low = ((total - again) - tail + lost) / (2 * safe)
    units = tuple(_quotient(component, safe, low) for component in w)
    return units, np.ldexp(length, exponent), np.ldexp(low, exponent)


def _by_power_of_two(v: Components) -> tuple[Components, Component]:
    """The vector scaled exactly so that its largest component is in [0.5, 1), and the exponent taken out."""
    _, exponent = np.frexp(functools.reduce(np.maximum, (np.abs(component) for component in v)))
    half = -exponent // 2  # in two steps: 2^-e itself overflows for subnormal vectors
    return tuple(np.ldexp(np.ldexp(component, half), -exponent - half) for component in v), exponent


def _quotient(a: Component, high: Component, low: Component) -> Component:
    """The quotient a / (high + low), rounded once."""
    ratio = a / high
    product, error = _product(ratio, high)
    return ratio + ((a - product) - error - ratio * low) / high


def _split(x: Component) -> tuple[Component, Component]:
    """Veltkamp: x = high + low, of 26 bits each."""
    carried = 134217729.0 * x
    high = carried - (carried - x)
    return high, x - high


def _product(a: Component, b: Component) -> tuple[Component, Component]:
    """Dekker: a b = product + error, exactly."""
    product = a * b
    (ah, al), (bh, bl) = _split(a), _split(b)
    return product, ((ah * bh - product) + ah * bl + al * bh) + al * bl


def _sum_error(a: Component, b: Component, total: Component) -> Component:
    """Knuth: what the rounding of total = a + b lost."""
    shadow = total - a
    return (a - (total - shadow)) + (b - shadow)
