"""Numbers with a bound on their rounding: the bound holds for every way to round, and is not much more."""

from __future__ import annotations

import itertools
import math
import operator
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from hingepair.numeric.bounded import Bounded, BoundedSingle

COUNT = 300
KINDS = pytest.mark.parametrize("kind", [Bounded, BoundedSingle])


def operands(kind: type[Bounded], seed: int) -> tuple[list[Bounded], list[Fraction]]:
    """Computed numbers, of which the exact ones lie anywhere within the bound."""
    rng = np.random.default_rng(seed)
    values = (rng.normal(size=COUNT) * 10.0 ** rng.uniform(-6, 6, COUNT)).astype(kind.dtype).astype(float)
    bounds = np.abs(values) * kind.u * rng.uniform(0, 8, COUNT) * (rng.random(COUNT) < 0.8)
    exact = [
        Fraction(v) + Fraction(b) * int(s) for v, b, s in zip(values, bounds, rng.integers(-1, 2, COUNT), strict=True)
    ]
    return [kind(v, b) for v, b in zip(values.tolist(), bounds.tolist(), strict=True)], exact


@KINDS
@pytest.mark.parametrize("name", ["sum", "difference", "product", "quotient"])
def test_the_bound_of_an_operation_holds_and_is_sharp(kind: type[Bounded], name: str) -> None:
    """As the precision that is bounded rounds the operation; carried errors are of the worst signs now and then."""
    (xs, exact_x), (ys, exact_y) = operands(kind, 1), operands(kind, 2)
    shares = []
    for x, y, ex, ey in zip(xs, ys, exact_x, exact_y, strict=True):
        a, b = kind.dtype(x.value), kind.dtype(y.value)
        found, computed, exact = {
            "sum": (x + y, a + b, ex + ey),
            "difference": (x - y, a - b, ex - ey),
            "product": (x * y, a * b, ex * ey),
            "quotient": (x / y, a / b, ex / ey),
        }[name]
        error = abs(Fraction(float(computed)) - exact)
        assert error <= Fraction(float(found.error))
        if found.bound:
            shares.append(float(error / Fraction(float(found.bound))))
    assert max(shares) > 0.5
    assert np.mean(shares) > 0.1


@KINDS
@pytest.mark.parametrize("name", ["sum", "product", "quotient"])
def test_wide_bounds_hold_at_their_worst_signs(kind: type[Bounded], name: str) -> None:
    """Bounds of a third of the numbers, where products of bounds and what is left of a divisor count.

    The bound holds for every evaluation, each within the bounds of the exact numbers, not only for the value at hand:
    of a quotient the worst divides 5/3 of the dividend by 1/3 of the divisor, where 4/3 by 2/3 are exact.
    """
    operation = {"sum": operator.add, "product": operator.mul, "quotient": operator.truediv}[name]
    for a, b in ((1.5, 2.0), (-3.0, 0.5), (0.25, -8.0)):
        x, y = kind(a, abs(a) / 3), kind(b, abs(b) / 3)
        found, errors = operation(x, y), []
        bounds = Fraction(x.bound), Fraction(y.bound)
        for i, j, k, m in itertools.product((-1, 1), repeat=4):
            exact = Fraction(a) + i * bounds[0], Fraction(b) + j * bounds[1]
            evaluated = exact[0] + k * bounds[0], exact[1] + m * bounds[1]
            assert abs(Fraction(float(found.value)) - operation(*exact)) <= Fraction(float(found.error))
            errors.append(abs(operation(*evaluated) - operation(*exact)))
        assert max(errors) <= Fraction(float(found.error)) < Fraction(1.5) * max(errors)


@KINDS
def test_products_with_0_and_1_and_sums_with_0_are_exact(kind: type[Bounded]) -> None:
    x = kind(0.7, 0.0)
    for one in (1.0, -1.0, 0.0):
        assert (x * one).bound == 0
        assert (one * x).bound == 0
        assert (x * one).value == 0.7 * one
    assert (x + 0.0).bound == (0.0 + x).bound == (x - 0.0).bound == (0.0 - x).bound == 0
    assert (0.0 - x).value == -0.7
    assert (x * 3.0).bound > 0
    assert (x * kind(1.0, 1e-9)).bound >= 0.7e-9  # not exactly 1
    assert (kind(1.0, 1e-9) * kind(1.0, 1e-9)).bound > 2e-9
    assert (x * kind(1.0 + 2 * kind.u)).bound > 0


@KINDS
def test_a_sum_is_rounded_by_no_more_than_its_smaller_term(kind: type[Bounded]) -> None:
    tiny = 2.0**-100
    assert 0 < float((kind(1.0) + kind(tiny)).bound) <= tiny
    assert float((kind(tiny) + kind(1.0)).bound) <= tiny
    assert float((kind(1.0) + kind(1.0)).bound) <= 2 * kind.u


@KINDS
def test_numbers_that_overflow_or_vanish(kind: type[Bounded]) -> None:
    largest = kind(kind.largest)
    assert np.isinf((largest + largest).error)
    assert np.isinf((largest * kind(2.0)).error)
    assert np.isinf((kind(math.inf) - kind(math.inf)).error)
    small = kind(2.0**-600 if kind is Bounded else 2.0**-80)
    assert 0 < float((small * small).error) <= 8 * kind.smallest


@KINDS
@pytest.mark.parametrize("function", ["sine", "cosine", "versine"])
def test_bounds_of_sines_hold_and_are_not_much_more(kind: type[Bounded], function: str) -> None:
    """The bound takes an error of SINE_ULPS; a sine rounded rightly has half a unit."""
    rng = np.random.default_rng(3)
    angles = np.concatenate((rng.uniform(-10, 10, 100), 10.0 ** rng.uniform(-12, 0, 60), [0.0, 0.5, 1e-3]))
    angles = angles.astype(kind.dtype).astype(float)
    with mpmath.workdps(40):
        for angle in angles.tolist():
            exact = {
                "sine": mpmath.sin(angle),
                "cosine": mpmath.cos(angle),
                "versine": 2 * mpmath.sin(mpmath.mpf(angle) / 2) ** 2,
            }[function]
            found = getattr(kind(angle), function)()
            assert abs(found.value - exact) <= found.error
            if angle == 0:
                assert found.bound <= 4 * kind.smallest
            else:
                scale = {"sine": abs(exact), "cosine": abs(exact), "versine": max(exact, mpmath.mpf("0.3"))}[function]
                assert found.bound <= 10 * kind.u * scale


@pytest.mark.parametrize("function", ["sine", "cosine", "versine"])
def test_the_bound_of_a_sine_covers_what_its_angle_is_off(function: str) -> None:
    known = {"sine": math.sin, "cosine": math.cos, "versine": lambda x: 2 * math.sin(x / 2) ** 2}
    for angle in (0.0, 1e-7, 0.4, 1.2, 3.0):
        for off in (0.0, 1e-12, 1e-4):
            bounded = getattr(Bounded(angle, off), function)()
            for other in (angle - off, angle + off):
                exact = known[function](other)
                assert abs(float(bounded.value) - exact) <= float(bounded.error) * (1 + 1e-9) + 1e-17  # in doubles
