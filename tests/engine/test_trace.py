"""A trace folds what is known, writes nothing twice, and keeps the bits of what it was traced from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from hingepair.engine.loops import interpreter
from hingepair.engine.trace import (
    Trace,
    arc_tangent,
    hypotenuse,
    square_root,
    where_less,
)


@pytest.fixture
def xy():
    trace = Trace()
    return trace.input(), trace.input()


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


STATES = [(0.3, -0.7, 1.9), (2.0, 3.0, -0.5), (-3.0, 0.1, 4.0), (1e-9, 2.0, 1e5)]


def interpreted(function, count):
    trace = Trace()
    given = [trace.input() for _ in range(count)]
    return interpreter(given, function(*given))


@pytest.mark.parametrize("state", STATES)
def test_an_interpreter_computes_the_function_to_the_bit(state):
    assert tuple(interpreted(function, 3).run(*map(np.float64, state))) == plain(*state)


def test_a_register_serves_again_once_its_value_is_not_needed():
    """Results stay, inputs among them, however long the program is."""

    def chain(x, y):
        value = x
        for _ in range(1000):
            value = y - (value * 0.5 + 1.0) / 2.0
        return x + y, value, x, -value, 2.0

    expected = 0.3
    for _ in range(1000):
        expected = 0.7 - (expected * 0.5 + 1.0) / 2.0
    assert interpreted(chain, 2).run(0.3, 0.7) == [1.0, expected, 0.3, -expected, 2.0]
