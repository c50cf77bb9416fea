"""A trace folds what is known, writes nothing twice, and keeps the bits of what it was traced from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hingepair.engine import python_source
from hingepair.engine.trace import (
    Trace,
    arc_tangent,
    hypotenuse,
    needed_values,
    operation_count,
    square_root,
    where_less,
)


@pytest.fixture
def xy():
    trace = Trace()
    return trace.input("x"), trace.input("y")


FOLDED = {
    "x + 0": lambda x: x + 0,
    "0 + x": lambda x: 0 + x,
    "x - 0.0": lambda x: x - 0.0,
    "x * 1": lambda x: x * 1,
    "1 * x": lambda x: 1.0 * x,
    "x / 1": lambda x: x / 1,
    "-(-x)": lambda x: x.__neg__().__neg__(),
    "-(x * -1)": lambda x: -(x * -1),
    "0 - (0 - x)": lambda x: 0 - (0 - x),
}


@pytest.mark.parametrize("fold", FOLDED.values(), ids=FOLDED)
def test_what_changes_nothing_is_not_written(xy, fold):
    assert fold(xy[0]) is xy[0]


def test_what_is_zero_is_a_number(xy):
    for zero in (xy[0] * 0, 0.0 * xy[0], 0 / xy[0]):
        assert zero == 0.0
        assert type(zero) is float


def test_a_sum_with_a_negative_is_a_difference(xy):
    x, y = xy
    assert x + -y is x - y
    assert x - -y is x + y


def test_the_same_line_is_written_once(xy):
    x, y = xy
    assert x * y is y * x
    assert x + y is y + x
    assert x - y is not y - x
    assert (-x).sine() is -x.sine()
    assert (-x).cosine() is x.cosine()
    assert (-x).versine() is x.versine()


def test_only_what_is_needed_is_left(xy):
    x, y = xy
    wanted, _ = x * y + 1.0, x.sine() * 3.0
    assert operation_count(needed_values([wanted])) == 2


def test_a_line_of_constants_does_not_move():
    trace = Trace()
    constant, moving = trace.input("c", varies=False), trace.input("x")
    assert not (2.0 * constant + 1.0).varies
    assert (constant * moving).varies
    lines = needed_values([2.0 * constant * moving])
    assert (operation_count(lines, varying=False), operation_count(lines, varying=True)) == (1, 1)


def test_a_traced_value_decides_nothing(xy):
    with pytest.raises(TypeError, match="where"):
        bool(xy[0])


def function(x, y, z):
    """Every operation and every precedence once."""
    a = -(x - (y - z)) * (x + y) / (z / (y * x)) - -x
    b = where_less(x, y, a * x.versine(), square_root(y * y + 1.0))
    return a, b, arc_tangent(y, x) * hypotenuse(x, z), -(-a * 2.0 + b), (a - b) - (y + z) - 3.0, 5.0


def plain(x, y, z):
    a = -(x - (y - z)) * (x + y) / (z / (y * x)) - -x
    s, c = math.sin(x), math.cos(x)
    b = a * (s * s / (1 + c) if c > 0 else 1 - c) if x < y else math.sqrt(y * y + 1.0)
    return a, b, math.atan2(y, x) * math.hypot(x, z), -(-a * 2.0 + b), (a - b) - (y + z) - 3.0, 5.0


@pytest.fixture(scope="module")
def source():
    trace = Trace()
    given = [trace.input(name) for name in "xyz"]
    return python_source.function_source("f", given, function(*given))


STATES = [(0.3, -0.7, 1.9), (2.0, 3.0, -0.5), (-3.0, 0.1, 4.0), (1e-9, 2.0, 1e5)]


@pytest.mark.parametrize("state", STATES)
def test_generated_python_is_the_function_to_the_bit(source, state):
    assert python_source.compile_for_floats("f", source)(*state) == plain(*state)


def test_generated_python_takes_arrays(source):
    found = python_source.compile_for_arrays("f", source)(*np.array(STATES).T)
    expected = np.array([plain(*state) for state in STATES]).T
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(np.broadcast_to(one, other.shape), other, rtol=4e-16)


def test_floats_that_python_refuses_give_nan_and_infinity():
    trace = Trace()
    x, y = trace.input("x"), trace.input("y")
    text = python_source.function_source("f", [x, y], [x.sine(), x / y, square_root(y)])
    found = python_source.compile_for_floats("f", text)
    assert np.isnan(found(math.inf, 1.0)[0])
    assert found(3.0, 0.0)[1] == math.inf
    assert np.isnan(found(3.0, -1.0)[2])
    assert found(3.0, -1.0)[1] == -3.0


def test_names_of_results_are_names_in_the_code():
    trace = Trace()
    x, y = trace.input("phi_x"), trace.input("phi_y")
    product = x * y
    product.name = "S1_xx"
    text = python_source.function_source("f", [x, y], [product + 1.0])
    assert "S1_xx = phi_x * phi_y" in text


ODD_NAMES = ['a-b.c d"e', "a_b_c_d_e", "2nd", "lambda", "sin", "nan", "t1", "t", "", "\u03c6 \u2032\n", "f", "None"]


def test_names_may_be_any_text():
    """Of inputs, results and the function itself; two that look alike stay two."""
    trace = Trace()
    inputs = [trace.input(name) for name in ODD_NAMES]
    shared = inputs[0] * inputs[1] + inputs[2]
    results = [(value + shared).sine() * 2.0 for value in inputs]
    for value, name in zip(results, ODD_NAMES, strict=True):
        value.name = name
    for name in ODD_NAMES:
        text = python_source.function_source(name, inputs, results)
        numbers = [0.1 * k for k in range(len(inputs))]
        expected = tuple(math.sin(x + (numbers[0] * numbers[1] + numbers[2])) * 2.0 for x in numbers)
        assert python_source.compile_for_floats(name, text)(*numbers) == expected


def test_long_expressions_are_cut():
    """Python nests 200 brackets at most."""
    trace = Trace()
    x, y = trace.input("x"), trace.input("y")
    value = x
    for _ in range(1000):
        value = y - (value * 0.5 + 1.0) / 2.0
    text = python_source.function_source("f", [x, y], [value])
    plain = 0.3
    for _ in range(1000):
        plain = 0.7 - (plain * 0.5 + 1.0) / 2.0
    assert python_source.compile_for_floats("f", text)(0.3, 0.7) == (plain,)
