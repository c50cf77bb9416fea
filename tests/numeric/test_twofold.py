"""Arithmetic in twice the precision, against exact fractions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

from hingepair.numeric.twofold import (
    Twofold,
    exact_product,
    exact_sum,
    normal,
)

COUNT = 200


def numbers(seed: int) -> list[float]:
    """Of both signs, over twenty orders of magnitude."""
    rng = np.random.default_rng(seed)
    return (rng.normal(size=COUNT) * 10.0 ** rng.uniform(-10, 10, COUNT)).tolist()


def pairs(seed: int) -> list[tuple[float, float]]:
    """Numbers with 106 bits: high is the double nearest to the sum."""
    rng = np.random.default_rng(seed + 100)
    return [normal(a, a * 2.0**-54 * float(rng.uniform(-1, 1))) for a in numbers(seed)]


def exactly(pair: tuple[float, float] | Twofold | float) -> Fraction:
    if isinstance(pair, Twofold):
        pair = pair.high, pair.low
    return sum(map(Fraction, pair)) if isinstance(pair, tuple) else Fraction(pair)


def test_sums_and_products_of_two_numbers_are_exact() -> None:
    for a, b in zip(numbers(1), numbers(2), strict=True):
        total, product = exact_sum(a, b), exact_product(a, b)
        assert (total[0], product[0]) == (a + b, a * b)
        assert exactly(total) == Fraction(a) + Fraction(b)
        assert exactly(product) == Fraction(a) * Fraction(b)


@pytest.mark.parametrize(("name", "bits"), [("sum", 104), ("difference", 104), ("product", 102)])
def test_pairs_keep_twice_the_precision(name: str, bits: int) -> None:
    for a, b in zip(pairs(5), pairs(6), strict=True):
        x, y = Twofold(*a), Twofold(*b)
        found, exact, size = {
            "sum": (x + y, exactly(a) + exactly(b), abs(a[0]) + abs(b[0])),
            "difference": (x - y, exactly(a) - exactly(b), abs(a[0]) + abs(b[0])),
            "product": (x * y, exactly(a) * exactly(b), abs(a[0] * b[0])),
        }[name]
        assert abs(exactly(found) - exact) <= Fraction(size) / 2**bits
