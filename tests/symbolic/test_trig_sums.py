"""Products of sines and cosines as sums: the same numbers, in fewer waves."""

from __future__ import annotations

import pytest
import sympy
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from hingepair.symbolic.trig_sums import MAX_TERMS, cosine_expression, sine_expression, trig_sum
from support.work import bounded_calls

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
    st.sampled_from([f(angle) for angle in ANGLES for f in (sine_expression, cosine_expression)]),
    st.sampled_from([t, u, sympy.sqrt(2), sympy.exp(t), sympy.Rational(-5, 2), sympy.S.Zero, sympy.S.One]),
)


def combined(parts):
    return st.one_of(
        st.tuples(parts, parts).map(lambda p: sympy.Add(*p)),
        st.tuples(parts, parts).map(lambda p: sympy.Mul(*p)),
        parts.map(lambda p: p**2),
    )


EXPRESSIONS = st.recursive(LEAVES, combined, max_leaves=4)


def value(expr):
    return sympy.sympify(expr).subs(POINT).evalf(30, maxn=1000)


def waves(term):
    """How many sines and cosines a term multiplies."""
    return sum(int(p.exp) if p.is_Pow else 1 for p in sympy.Mul.make_args(term) if p.has(sympy.sin, sympy.cos))


@pytest.mark.slow
@settings(max_examples=25, deadline=None, derandomize=True)
@given(EXPRESSIONS)
def test_a_sum_is_worth_what_its_expression_is(expr):
    """And every term of it has one wave at most, where SymPy leaves it one: sin(2 atan t) is a fraction."""
    total = trig_sum(expr)
    assume(total is not None)
    assert abs(value(total) - value(expr)) <= 1e-25 * (1 + abs(value(expr)))
    if not expr.has(sympy.atan):
        assert all(waves(term) <= 1 for term in sympy.Add.make_args(sympy.expand(total)))


def test_sine_of_an_arc_keeps_its_angle():
    """So that sin(atan(x)) cos(y) + cos(atan(x)) sin(y) can become sin(atan(x) + y)."""
    arc = sympy.atan(u)
    assert trig_sum(
        sine_expression(arc) * cosine_expression(t - arc) + cosine_expression(arc) * sine_expression(t - arc)
    ) == sympy.sin(t)


@pytest.mark.slow
def test_sums_are_bounded():
    many = sympy.Add(*(sympy.cos(i * t) for i in range(MAX_TERMS)))
    assert trig_sum(many) == many
    for expr in (many + sympy.cos(t / 2), many**2):
        assert trig_sum(expr) is None
    for power in ((t + u) ** (2 * MAX_TERMS), (1 + sympy.cos(t)) ** 10**9):
        assert trig_sum(power) == power


def test_sines_of_long_angles_stay_products():
    angle = sympy.Add(*(t**i / i for i in range(1, 300)))
    product = sympy.sin(angle, evaluate=False) * sympy.cos(angle + t, evaluate=False)
    with bounded_calls(100_000):
        assert trig_sum(product) is None
