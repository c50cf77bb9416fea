"""Expressions of scenes: what they mean, that they keep their digits, and that hostile ones take little work."""

from __future__ import annotations

import math

import mpmath
import numpy as np
import pytest
import sympy

from hingepair import ArgumentError
from hingepair.symbolic.exact import TIME, to_sympy
from hingepair.symbolic.expressions import (
    SMOOTH_FUNCTIONS,
    parse_expression,
)
from hingepair.symbolic.time_functions import TimeFunctions
from support.sparse import sparse
from support.work import bounded_calls

U = 2.0**-53
T = np.linspace(0.1, 0.9, 41)
MOST_CALLS = 10**7  # of functions, to read an expression and its derivatives; the heaviest below take a million

MEANINGS = {
    "3*t": lambda t: 3 * t,
    "-t**2": lambda t: -(t**2),
    "2**-t": lambda t: 2.0**-t,
    "1 - 2 - t": lambda t: -1 - t,
    "8/t/2": lambda t: 4 / t,
    "t - (1 - t)": lambda t: 2 * t - 1,
    "--t": lambda t: t,
    "+t": lambda t: t,
    "pi*t + tau + e": lambda t: math.pi * t + math.tau + math.e,
    "w*t": lambda t: 1.5 * t,
    "deg(90 - 30*t)": lambda t: np.radians(90 - 30 * t),
    "1.25e1*t": lambda t: 12.5 * t,
    "atan2(t, 1 + t)": lambda t: np.arctan2(t, 1 + t),
    "sin(t)*cos(t) + tan(t)": lambda t: np.sin(t) * np.cos(t) + np.tan(t),
    "asin(t) + acos(t) + atan(t)": lambda t: np.pi / 2 + np.arctan(t),
    "sinh(t) + cosh(t) - exp(t)": lambda t: 0 * t,
    "tanh(t) + asinh(t) + acosh(1 + t) + atanh(t)": lambda t: (
        np.tanh(t) + np.arcsinh(t) + np.arccosh(1 + t) + np.arctanh(t)
    ),
    "log(t) + sqrt(t)": lambda t: np.log(t) + np.sqrt(t),
    "\n t +\n 1 ": lambda t: t + 1,
}


def exact(text: str, *constants_and_symbols: object) -> object:
    """An expression in SymPy."""
    return to_sympy("x", parse_expression("x", text, *constants_and_symbols))


@pytest.mark.parametrize("text", MEANINGS)
def test_text_means_what_it_says(text: str) -> None:
    ((value,),) = TimeFunctions([parse_expression("x", text, {"w": 1.5})]).derivatives(T, 0)
    np.testing.assert_allclose(value, MEANINGS[text](T), rtol=64 * U, atol=64 * U)


@pytest.mark.parametrize("name", SMOOTH_FUNCTIONS)
def test_derivatives_of_every_function(name: str) -> None:
    text = {"atan2": "atan2(t, 2 - t)", "acosh": "acosh(1 + t)"}.get(name, f"{name}(t)")
    values = TimeFunctions([parse_expression("x", text)]).derivatives(np.array([0.375]))
    with mpmath.workdps(40):
        function = getattr(mpmath, {"log": "ln"}.get(name, name))
        truth = {"atan2": lambda t: mpmath.atan2(t, 2 - t), "acosh": lambda t: mpmath.acosh(1 + t)}.get(
            name, function
        )
        expected = [float(mpmath.diff(truth, mpmath.mpf(3) / 8, k)) for k in range(3)]
    np.testing.assert_allclose([float(value[0][0]) for value in values], expected, rtol=16 * U, atol=0)


def test_what_does_not_move_is_a_number() -> None:
    q, qd, qdd = TimeFunctions(
        [parse_expression("x", "3*t"), parse_expression("y", "sqrt(2)/2"), parse_expression("z", "t**2")]
    ).derivatives(T)
    assert [type(value) for value in (*q, *qd, *qdd)] == [
        np.ndarray, float, np.ndarray, float, float, np.ndarray, float, float, float,
    ]  # fmt: skip
    assert abs(q[1] - math.sqrt(0.5)) <= U
    assert qd[:2] == (3.0, 0.0)
    assert qdd[2] == 2.0


def test_decimal_numbers_are_exact() -> None:
    assert str(exact("0.1*3")) == "3/10"
    assert str(exact("w", {"w": 0.1})) == "1/10"
    assert float(parse_expression("x", "0.1*3")) == 0.3


@pytest.mark.parametrize(
    ("text", "real"),
    [
        ("sqrt(t - 5)*sqrt(t - 5)", [False, False, True]),
        ("sqrt(t - 5) - sqrt(t - 5)", [False, False, True]),
        ("1 + 0*log(t - 1.5)", [False, True, True]),
        ("exp(2*log(t - 1.5))", [False, True, True]),
        ("cos(acos(t - 1))", [True, True, False]),
        ("where(t >= 5, sqrt(t - 5)**2, 3)", [True, True, True]),
        ("sqrt(t**2)*sqrt(4*t)", [True, True, True]),
    ],
)
def test_what_cancels_is_still_nan_where_it_is_not_real(text: str, real: list[bool]) -> None:
    ((value,),) = TimeFunctions([parse_expression("x", text)]).derivatives(np.array([0.5, 2, 6]), 0)
    assert np.isfinite(value).tolist() == real


@pytest.mark.parametrize("text", ["sqrt(t)", "log(t)", "acosh(t)", "atanh(t + 3) + log(t)"])
def test_no_real_value_is_nan_in_its_own_sample(text: str) -> None:
    for (found,) in TimeFunctions([parse_expression("x", text)]).derivatives(np.array([-1.5, 4.0])):
        assert math.isnan(found[0])
        assert math.isfinite(found[1]) or "atanh" in text


REFUSED = {
    "empty": "",
    "unknown name": "sine(t)",
    "no call": "sin",
    "called number": "2(t)",
    "arguments": "sin(t, t)",
    "attribute": "t.real",
    "import": "__import__('os').system('true')",
    "lambda": "lambda: t",
    "comparison": "t < 1",
    "boolean": "True",
    "complex": "1j*t",
    "caret": "t^2",
    "NUL": "t\0",
    "unfinished": "sin(t",
    "zero division": "1/0",
    "root of minus one": "sqrt(-1)",
    "too large": "1e999",
    "tower": "9**9**9",
    "long": "t+" * 5_001 + "t",
    "minus signs": "-" * 100_000 + "t",
    "nested": "sin(" * 300 + "t" + ")" * 300,
    "tiny power of t": "tanh((3.95*t)**1e-300)",
    "power of a sum with a huge number": "sinh(asin(exp((-1e5)**(1e300 - t))))",
    "base below 0": "(-2)**t",
    "pole": "tan(pi/2)",
    "unicode": "\N{MATHEMATICAL BOLD SMALL T}",
}
ONLY_TOO_LARGE_FOR_SYMPY = {
    "power that log hides": "exp(-1e300*log(2))",
    "power of tau": "tau**(atan2(t, 2) - 94*sqrt(1e300))",
    "power of a logarithm": "sin(tanh(sqrt(log(sqrt(1e5)))**(pi - 1e300 + t)))",
    "asin of cos of 1e300": "asin(cos(1e300))",
}


@pytest.mark.parametrize("text", REFUSED.values(), ids=REFUSED)
def test_refused_in_one_line_and_with_little_work(text: str) -> None:
    with pytest.raises(ArgumentError) as caught, bounded_calls(MOST_CALLS):
        parse_expression("motion.psi", text)
    assert str(caught.value).startswith("motion.psi: ")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize("text", ONLY_TOO_LARGE_FOR_SYMPY.values(), ids=ONLY_TOO_LARGE_FOR_SYMPY)
def test_what_is_too_large_for_sympy_is_evaluated_all_the_same(text: str) -> None:
    with bounded_calls(MOST_CALLS):
        expression = parse_expression("motion.psi", text)
        TimeFunctions([expression]).derivatives(T)
        with pytest.raises(ArgumentError, match=r"motion\.psi: expected an expression that SymPy can work with"):
            to_sympy("motion.psi", expression)


DIFFERENTIATED = (
    "atan2(sin(t), 2 - t)",
    "atan2(t, t + 1)**2",
    "atan2(2*t, 2*t)*t",
    "t**t",
    "(1 + t)**(0.5 - t)",
    "2**sin(t)",
    "t**2.5/(1 + t)**3",
    "pi*sin(sqrt(2)*t)*exp(-t/pi)*cos(t)",
    "log(1 + t**2)*tanh(t - 0.3)",
)


@pytest.mark.slow
@pytest.mark.parametrize("text", sparse(DIFFERENTIATED, 4, str))
def test_chain_rule_agrees_with_the_derivative_of_the_whole(text: str) -> None:
    expr, symbol = exact(text), TIME
    for k, (found,) in enumerate(TimeFunctions([parse_expression("x", text)]).derivatives(T[::8])):
        whole = expr.diff(symbol, k) if k else expr
        with mpmath.workdps(40):
            expected = [float(sympy.lambdify(symbol, whole, "mpmath")(mpmath.mpf(float(t)))) for t in T[::8]]
        np.testing.assert_allclose(found, expected, rtol=64 * U, atol=64 * U * max(1.0, np.abs(expected).max()))


KINKED = {  # value, first and second derivative at -2, 0, 1, 3; those at a kink from the right
    "abs(-t)": ([2, 0, 1, 3], [-1, 1, 1, 1], 0),
    "-abs(t)*t": ([4, 0, -1, -9], [-4, 0, -2, -6], [2, -2, -2, -2]),
    "sign(t)": ([-1, 0, 1, 1], 0, 0),
    "min(t, t**2, 1)": ([-2, 0, 1, 1], [1, 0, 0, 0], [0, 2, 0, 0]),
    "max(t, 0)": ([0, 0, 1, 3], [0, 1, 1, 1], 0),
    "ramp(t - 1)": ([0, 0, 0, 2], [0, 0, 1, 1], 0),
    "clip(t, 0, 1)": ([0, 0, 1, 1], [0, 1, 0, 0], 0),
    "step(t - 1)": ([0, 0, 1, 1], 0, 0),
    "mod(t, 2)": ([0, 0, 1, 1], 1, 0),
    "mod(7, 2)": (1, 0, 0),
    "mod(3*pi, pi)": (0, 0, 0),
    "where(t < 1, 0, t**2)": ([0, 0, 1, 9], [0, 0, 2, 6], [0, 0, 2, 2]),
    "where(t <= 1, 0, t**2)": ([0, 0, 0, 9], [0, 0, 2, 6], [0, 0, 2, 2]),
    "where(0 <= t < 3, 1, 0)": ([0, 1, 1, 0], 0, 0),
    "where(t < -1 or t > 2, 1, 0)": ([1, 0, 0, 1], 0, 0),
    "where(t > 0 and t < 3, t, -t)": ([2, 0, 1, -3], [-1, 1, 1, -1], 0),
    "where(not (t > 0 or t < -2), -t, t)": ([2, 0, 1, 3], [-1, 1, 1, 1], 0),
    "where(1 < 2, t, sqrt(-t))": ([-2, 0, 1, 3], 1, 0),
    "where(t >= 0, sqrt(t), 0)**2": ([0, 0, 1, 3], [0, np.nan, 1, 1], [0, np.nan, 0, 0]),
}


@pytest.mark.parametrize("text", KINKED)
def test_kinks_take_their_derivatives_from_the_right(text: str) -> None:
    t = np.array([-2.0, 0.0, 1.0, 3.0])
    for found, expected in zip(
        TimeFunctions([parse_expression("x", text)]).derivatives(t), KINKED[text], strict=True
    ):
        np.testing.assert_array_equal(np.broadcast_to(found[0], 4).round(12), np.broadcast_to(expected, 4))


@pytest.mark.parametrize(
    ("text", "count"),
    [
        ("t**2", 0),
        ("abs(t)", 1),
        ("max(sin(pi*t), 0)", 3),
        ("mod(t, 0.5)", 7),
        ("abs(t)+sign(t)", 1),
        ("abs(sqrt(t))", 0),
        ("max(t, 0, 1 - t)", 1),
    ],
)
def test_kinks_are_counted(text: str, count: int) -> None:
    functions = TimeFunctions([parse_expression("x", text)])
    for samples in (200, 9_000):  # in one block and in several
        assert functions.switches(np.linspace(-1.99, 1.99, samples)).sum() == count
