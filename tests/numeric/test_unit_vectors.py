"""Lengths and directions to the last bit, at any size."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

from hingepair.bench.truth import DIGITS
from hingepair.numeric.unit_vectors import (
    direction,
    polar,
    unit_axis,
)

SIZES = (1.0, 3e-4, 5e3, 1e-200, 1e200, 3e-310, 5e-324 * 2**20, 1e308)


def vectors(size: float, dimension: int = 3) -> list[tuple[float, ...]]:
    """Random ones, unequal ones and ones along an axis."""
    rng = np.random.default_rng(1)
    rows = [
        *rng.uniform(-1, 1, (20, dimension)),
        *(rng.uniform(-1, 1, (10, dimension)) * 10.0 ** rng.uniform(-9, 0, dimension)),
    ]
    scaled = [tuple((size * row).tolist()) for row in (*rows, *np.eye(dimension), -np.eye(dimension)[0])]
    return [v for v in scaled if any(v)]


def exact_polar(v: tuple[float, ...]) -> tuple[list[mpmath.mpf], mpmath.mpf]:
    length = mpmath.sqrt(sum(mpmath.mpf(x) ** 2 for x in v))
    return [x / length for x in v], length


@pytest.mark.parametrize("size", SIZES, ids="{:.0e}".format)
@pytest.mark.parametrize("dimension", [2, 3, 4])
def test_direction_and_length_have_twice_the_precision(size: float, dimension: int) -> None:
    for v in vectors(size, dimension):
        units, length = polar(v)
        with mpmath.workdps(DIGITS):
            exact_units, exact_length = exact_polar(v)
            for unit, exact in zip(units, exact_units, strict=True):
                assert abs(mpmath.mpf(unit.high) + unit.low - exact) <= mpmath.mpf(2) ** -100
                assert abs(unit.high - exact) <= 0.5 * np.spacing(abs(unit.high)) * (1 + 2.0**-40)
            tiny = 5e-324  # low itself may be rounded to a subnormal number
            assert (
                abs(mpmath.mpf(length.high) + length.low - exact_length)
                <= exact_length * mpmath.mpf(2) ** -100 + tiny
            )


@pytest.mark.parametrize("size", SIZES, ids="{:.0e}".format)
def test_arrays_give_what_numbers_give(size: float) -> None:
    rows = vectors(size)
    components = tuple(np.array(rows).T)
    found = np.stack(direction(components), axis=-1)
    assert found.tolist() == [list(direction(row)) for row in rows]
    assert unit_axis("n", rows).tolist() == found.tolist()
    units, length = polar(components)
    assert [unit.low.tolist() for unit in units] == np.array(
        [[u.low for u in polar(row)[0]] for row in rows]
    ).T.tolist()
    assert length.high.tolist() == [polar(row)[1].high for row in rows]


def test_the_direction_of_zero_is_zero() -> None:
    assert direction((0.0, 0.0, 0.0)) == (0.0, 0.0, 0.0)
    assert [c.tolist() for c in direction(tuple(np.zeros((3, 2))))] == [[0.0, 0.0]] * 3
    assert polar((0.0, 0.0))[1].high == 0.0
