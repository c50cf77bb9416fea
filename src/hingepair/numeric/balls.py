"""Exact numbers that are known up to a radius: balls around fractions, and around the entries of rotations."""

from __future__ import annotations

import decimal
import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_DIGITS: Final = 60  # decimal digits to which the rotations next to matrices are computed
_UPWARD: Final = 1 + 2.0**-40  # factor that covers the rounding of radii
_ROTATION_ROUNDING: Final = 4 * 2.0**-53  # of an entry made of products of three sines, or of a quaternion
_AXIS_ROUNDING: Final = 2 * 2.0**-53  # of a component of a normalised vector, and what it turns the other axes by


class Ball:
    """A number within `radius` of the fraction `value`; sums and products of such numbers are such numbers again."""

    __slots__ = ("radius", "value")

    def __init__(self, value: Fraction, radius: float) -> None:
        self.value = value
        self.radius = radius

    def __bool__(self) -> bool:
        return bool(self.value) or self.radius > 0

    def __add__(self, other: Ball | Fraction | int) -> Ball:
        value, radius = _parts(other)
        return Ball(self.value + value, (self.radius + radius) * _UPWARD)

    __radd__ = __add__

    def __mul__(self, other: Ball | Fraction | int) -> Ball:
        value, radius = _parts(other)
        carried = self.radius * (_size(value) + radius) + (_size(self.value) * radius if radius else 0.0)
        return Ball(self.value * value, carried * _UPWARD)

    __rmul__ = __mul__


def error_bound(number: float, exact: Ball | Fraction | float) -> float:
    """Return a bound on the error of a float whose exact value is a number or in a ball; infinite if it is not
    finite.

    >>> error_bound(0.5, Ball(Fraction(1, 4), 0.5)) >= 0.75, error_bound(0.5, Fraction(1, 2))
    (True, 0.0)
    """
    if number == exact:
        return 0.0
    value, radius = _parts(exact)
    return (_size(Fraction(number) - value) + radius) * _UPWARD if math.isfinite(number) else math.inf


def rotation_balls(S: NDArray[np.float64]) -> list[Any]:
    """Return nine balls around the entries of S (3, 3) that hold the rotation next to S and any rotation that rounds
    to S. Entries 0 and 1 of a turn about x, y or z are exact: plain fractions.
    """
    with decimal.localcontext(prec=_DIGITS):
        Q = _decimals(S)
        for _ in range(8):  # Newton-Schulz steps: each squares the distance from orthogonality
            Q = Q @ (3 * _decimals(np.eye(3)) - Q.T @ Q) / 2
        errors = _distance(S, Q)
    unit = np.abs(S) == 1
    unit &= (np.count_nonzero(S, axis=0) == 1) & (np.count_nonzero(S, axis=1) == 1)[:, None]
    exact = unit.any(axis=0) | unit.any(axis=1)[:, None]
    return _balls(S, np.where(exact, 0.0, errors + _ROTATION_ROUNDING))


def axes_balls(P: NDArray[np.float64]) -> list[Any]:
    """Return nine balls around the entries of P (3, 3) that hold rotations with the last column along that of P, and
    along any vector that rounds to it. A matrix of entries 0, 1 and -1 is exact: plain fractions.
    """
    if np.isin(P, (-1.0, 0.0, 1.0)).all():
        return _balls(P, np.zeros((3, 3)))
    with decimal.localcontext(prec=_DIGITS):
        x, _, n = _decimals(P).T
        n = n / (n @ n).sqrt()
        x = x - n * (n @ x)
        x = x / (x @ x).sqrt()
        errors = _distance(P, np.stack((x, np.cross(n, x), n), axis=1))
    return _balls(P, errors + _AXIS_ROUNDING)


def _decimals(array: NDArray[np.float64]) -> NDArray[Any]:
    """Return the numbers of an array, none rounded."""
    return np.array([decimal.Decimal(x) for x in array.ravel().tolist()], object).reshape(array.shape)


def _distance(array: NDArray[np.float64], exact: NDArray[Any]) -> NDArray[np.float64]:
    """Return the distances of the entries of two matrices."""
    return np.asarray(np.abs(_decimals(array) - exact), np.float64)


def _balls(array: NDArray[np.float64], radii: NDArray[np.float64]) -> list[Any]:
    """Return fractions with radii, row by row; plain fractions where the radius is 0."""
    pairs: Sequence[tuple[float, float]] = list(zip(array.ravel().tolist(), radii.ravel().tolist(), strict=True))
    return [Ball(Fraction(x), radius) if radius else Fraction(x) for x, radius in pairs]


def _parts(number: Ball | Fraction | float) -> tuple[Fraction, float]:
    """Return the middle and the radius of a number."""
    return (number.value, number.radius) if isinstance(number, Ball) else (Fraction(number), 0.0)


def _size(x: Fraction) -> float:
    """Return the absolute value of a fraction, not below it by more than half a unit in the last place."""
    try:
        return abs(float(x)) if x == 0 or abs(x) > 1e-300 else 1e-300
    except OverflowError:
        return math.inf
