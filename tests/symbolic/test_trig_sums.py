"""Trigonometric sums are numbers: they add and multiply as the expressions do that they stand for."""

from __future__ import annotations

import pytest
import sympy
from hypothesis import given, settings
from hypothesis import strategies as st

from hingepair.symbolic.trig_sums import MAX_TERMS, TooManyTermsError, cosine, sine, trig_sum

t, a, u = sympy.symbols("t a u", real=True)
POINT = {t: sympy.Rational(7, 5), a: sympy.Rational(-4, 3), u: sympy.Rational(5, 7)}

ANGLES = (
    t,
    3 * t,
    -t / 2,
    t + a,
    2 * t + sympy.Rational(1, 3),
    sympy.pi / 4 + t,
    t - sympy.pi,
    sympy.atan(t),
    sympy.S.Zero,
)
LEAVES = st.one_of(
    st.sampled_from([f(angle) for angle in ANGLES for f in (sine, cosine)]),
    st.sampled_from([t, u, sympy.sqrt(2), sympy.exp(t), sympy.Rational(-5, 2), sympy.S.Zero, sympy.S.One]),
)


def combined(parts):
    return st.one_of(
        st.tuples(parts, parts).map(lambda p: sympy.Add(*p)),
        st.tuples(parts, parts).map(lambda p: sympy.Mul(*p)),
        parts.map(lambda p: p**2),
    )


EXPRESSIONS = st.recursive(LEAVES, combined, max_leaves=4)


def sine_sum(angle):
    return trig_sum(sine(angle))


def cosine_sum(angle):
    return trig_sum(cosine(angle))


def value(expr):
    return sympy.sympify(expr).subs(POINT).evalf(30, maxn=1000)


def whole(total):
    return sympy.Add(*total.terms())


def waves(term):
    """How many sines and cosines a term multiplies."""
    return sum(int(p.exp) if p.is_Pow else 1 for p in sympy.Mul.make_args(term) if p.has(sympy.sin, sympy.cos))


@settings(max_examples=8, deadline=None, derandomize=True)
@given(EXPRESSIONS, EXPRESSIONS)
def test_sums_add_and_multiply_as_expressions_do(first, second):
    x, y = trig_sum(first), trig_sum(second)
    for got, expected in ((x + y, first + second), (x - y, first - second), (x * y, first * second), (-x, -first)):
        assert abs(value(whole(got)) - value(expected)) <= 1e-25 * (1 + abs(value(expected)))
        assert all(waves(wave) <= 1 for term in got.terms() for wave in sympy.Add.make_args(sympy.expand(term)))


def test_whole_numbers_join_in():
    x = cosine_sum(t)
    assert [whole(s) for s in (1 - x, 1 + x, x - 1, x + 1, 2 * x, x * 0)] == [
        1 - sympy.cos(t), 1 + sympy.cos(t), sympy.cos(t) - 1, sympy.cos(t) + 1, 2 * sympy.cos(t), 0,
    ]  # fmt: skip


def test_terms_stand_in_the_order_in_which_they_arise():
    assert (sine_sum(3 * t) * cosine_sum(t)).terms() == (sympy.sin(2 * t) / 2, sympy.sin(4 * t) / 2)
    assert (cosine_sum(3 * t) * cosine_sum(t)).terms() == (sympy.cos(4 * t) / 2, sympy.cos(2 * t) / 2)
    assert (trig_sum(t) - sine_sum(t) * trig_sum(u) + cosine_sum(t) * trig_sum(u)).terms() == (
        t,
        u * (sympy.cos(t) - sympy.sin(t)),
    )


def test_squares_of_sine_and_cosine_make_one():
    angle = sympy.atan(t) + a
    total = sine_sum(angle) * sine_sum(angle) + cosine_sum(angle) * cosine_sum(angle)
    assert total.terms() == (1,)


def test_sine_of_an_arc_keeps_its_angle():
    """So that sin(atan(x)) cos(y) + cos(atan(x)) sin(y) can become sin(atan(x) + y)."""
    arc = sympy.atan(u)
    total = sine_sum(arc) * cosine_sum(t - arc) + cosine_sum(arc) * sine_sum(t - arc)
    assert total.terms() == (sympy.sin(t),)


def test_sums_are_bounded():
    many = [sympy.cos(i * t) for i in range(MAX_TERMS + 1)]
    with pytest.raises(TooManyTermsError):
        trig_sum(sympy.Add(*many))
    half = trig_sum(sympy.Add(*many[: MAX_TERMS // 2 + 10]))
    with pytest.raises(TooManyTermsError):
        half * half
    power = trig_sum((t + u) ** (2 * MAX_TERMS))
    assert power.terms() == ((t + u) ** (2 * MAX_TERMS),)
