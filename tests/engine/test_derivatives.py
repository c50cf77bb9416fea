"""Derivatives of traced functions are those of the functions, whatever these are made of."""

from __future__ import annotations

import math
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest

from hingepair.engine.backend import Execution
from hingepair.engine.derivatives import jacobian, pullback, pushforward, variables
from hingepair.engine.loops import Loop
from hingepair.engine.trace import (
    Trace,
    arc_tangent,
    hypotenuse,
    needed_values,
    square_root,
    where_less,
)
from hingepair.numeric.blocks import cosine, hinge_terms, sine
from support.near import U

TRACED = SimpleNamespace(
    sin=sine,
    cos=cosine,
    versine=lambda x: hinge_terms(x)[1],
    sqrt=square_root,
    atan2=arc_tangent,
    hypot=hypotenuse,
    where_less=where_less,
)
EXACT = SimpleNamespace(
    sin=mpmath.sin,
    cos=mpmath.cos,
    versine=lambda x: 1 - mpmath.cos(x),
    sqrt=mpmath.sqrt,
    atan2=mpmath.atan2,
    hypot=mpmath.hypot,
    where_less=lambda a, b, x, y: x if a < b else y,
)
FUNCTIONS = {
    "product": lambda x, y, _: 3 * x * x - y * (x - 2.5),
    "quotient": lambda x, y, _: (x - 1) / (2 + y * y) - 2 / y,
    "sine": lambda x, y, f: f.sin(x * y) - f.cos(-x),
    "far sine": lambda x, y, f: f.sin(1e6 * x) * f.cos(3e5 * y),
    "versine": lambda x, y, f: f.versine(x * 1e-5) / y,
    "root": lambda x, y, f: f.sqrt(x * x + 0.5) * y,
    "angle": lambda x, y, f: f.atan2(y, x) + f.atan2(2.0, y) - f.atan2(x, 3.0),
    "length": lambda x, y, f: f.hypot(x, y * y) + f.hypot(x, 2.0),
    "choice": lambda x, y, f: f.where_less(x, y, x * x * y, f.sin(y)),
    "choice of a root": lambda x, y, f: f.where_less(x, 0.0, y, f.where_less(0.0, x, f.sqrt(x), 1.0) * y),
    "chain": lambda x, y, f: f.sqrt(f.hypot(f.sin(x), 1 / y)) / f.atan2(x, 1.0 + y * y),
}
POINTS = np.random.default_rng(7).uniform(-3, 3, (40, 2))


def gradients(function, points, backend="numpy", mode="backwards"):
    """Return df/dx and df/dy at points, computed backwards or forwards."""

    def derived(values):
        x, y = values["x"], values["y"]
        result = function(x, y, TRACED)
        if mode == "backwards":
            return {"gradient": tuple(pullback([(result, 1.0)], [x, y]))}
        return {"gradient": tuple(pushforward([result], [(one, 1.0)])[0] for one in (x, y))}

    loop, out = Loop("derived", derived, {"x": (), "y": ()}, {"gradient": (2,)}), np.empty((len(points), 2))
    loop.run(
        {"x": points[:, 0], "y": points[:, 1]},
        {"gradient": out},
        (len(points),),
        out.dtype,
        Execution(backend, 1),
    )
    return out


@pytest.mark.parametrize("mode", ["backwards", "forwards"])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_derivatives_are_those_of_sixty_digits(name, mode):
    function = FUNCTIONS[name]
    found = gradients(function, POINTS, mode=mode)
    with mpmath.workdps(60):
        for (x, y), row in zip(POINTS.tolist(), found.tolist(), strict=True):
            for order, value in zip(((1, 0), (0, 1)), row, strict=True):
                exact = mpmath.diff(lambda a, b: function(a, b, EXACT), (x, y), order, h=mpmath.mpf(10) ** -25)
                # the far sine is multiplied by 1e6, and its argument is rounded to 1e-10
                scale = 1e6 * 1e6 if name == "far sine" else abs(exact) + 10
                assert abs(value - exact) <= 16 * 2.0**-53 * scale


@pytest.mark.parametrize("mode", ["backwards", "forwards"])
def test_the_branch_not_taken_leaves_no_trace(mode):
    def root_or_0(x, y, f):
        return f.where_less(0.0, x, f.sqrt(x) / x * y, 2 * y)

    found = gradients(root_or_0, np.array([[0.0, 3.0], [-1.0, 3.0], [4.0, 3.0]]), mode=mode)
    np.testing.assert_array_equal(found[:2], [[0, 2], [0, 2]])
    np.testing.assert_allclose(found[2], [-3 / 16, 0.5], rtol=4 * U)


@pytest.mark.parametrize("mode", ["backwards", "forwards"])
def test_nan_has_the_derivative_nan(mode):
    found = gradients(
        lambda x, y, f: y + f.where_less(0.0, x, 0.0, math.nan), np.array([[1.0, 2], [-1, 2]]), mode=mode
    )
    np.testing.assert_array_equal(found, [[0, 1], [np.nan, np.nan]])


def test_derivatives_fold():
    trace = Trace()
    x, y, z = (trace.input() for _ in range(3))
    results = [sine(x) * y, x + y]
    rows = jacobian(results, [[(x, 1.0)], [(y, 1.0)], [(z, 1.0)]])
    assert rows[1] == [1.0, 1.0, 0.0]
    assert rows[0][1] is sine(x)
    assert rows[0][2] == 0.0
    added = len(needed_values([*results, *rows[0]])) - len(needed_values(results))
    assert added == 2  # cos x, times y


def test_many_inputs_and_few_lead_to_the_same_jacobian():
    trace = Trace()
    inputs = [trace.input() for _ in range(9)]
    result = inputs[0]
    for one in inputs[1:]:
        result = result * one
    (backwards,) = jacobian([result], [[(x, 1.0)] for x in inputs])
    forwards = [pushforward([result], [(x, 1.0)])[0] for x in inputs]
    assert len(needed_values(backwards)) < len(needed_values(forwards))


def test_known_and_repeated_values_are_variables_of_their_own():
    (x, y), z = variables((0.0, 0.0)), Trace().input()
    assert x is not y
    assert pushforward([x * y + 3 * x], [(x, 1.0)])[0].operation == "+"
    first, second = variables((z, z))
    assert pushforward([2 * first + 3 * second], [(first, 1.0)]) == [2.0]
    (only,) = variables((z,), [z])
    assert pushforward([2 * only + 3 * z], [(only, 1.0)]) == [2.0]
