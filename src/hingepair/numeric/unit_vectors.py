"""Lengths and directions of vectors to the last bit: no overflow, no underflow, one rounding.

Vectors are tuples of components, floats or arrays, of any dimension.
"""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import AxisError
from hingepair.numeric.arrays import Component, vectors
from hingepair.numeric.blocks import Components, components_of, evaluate
from hingepair.numeric.twofold import Twofold, normal, product, sum_error


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
    units, length, low = _polar(v)
    return tuple(unit.high for unit in units), length, low


def exact_direction(v: Components) -> tuple[Twofold, ...]:
    """The vector at unit length, in twice the precision of a double."""
    return _polar(v)[0]


def _polar(v: Components) -> tuple[tuple[Twofold, ...], Component, Component]:
    w, exponent = by_power_of_two(v)
    total: Component = 0.0
    lost: Component = 0.0
    for component in w:
        square, tail = product(component, component)
        previous, total = total, total + square
        lost = lost + (sum_error(previous, square, total) + tail)
    length = np.sqrt(total)
    again, tail = product(length, length)
    safe = np.where(length > 0, length, 1.0)
    low = ((total - again) - tail + lost) / (2 * safe)
    units = tuple(_quotient(component, safe, low) for component in w)
    return units, np.ldexp(length, exponent), np.ldexp(low, exponent)


def by_power_of_two(v: Components) -> tuple[Components, Component]:
    """The vector scaled exactly so that its largest component is in [0.5, 1), and the exponent taken out."""
    _, exponent = np.frexp(functools.reduce(np.maximum, (np.abs(component) for component in v)))
    half = -exponent // 2  # in two steps: 2^-e itself overflows for subnormal vectors
    return tuple(np.ldexp(np.ldexp(component, half), -exponent - half) for component in v), exponent


def _quotient(a: Component, high: Component, low: Component) -> Twofold:
    """The quotient a / (high + low)."""
    ratio = a / high
    again, error = product(ratio, high)
    return normal(ratio, ((a - again) - error - ratio * low) / high)
