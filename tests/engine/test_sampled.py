"""Numbers at many samples: they compute what NumPy computes, and fold what is known."""

from __future__ import annotations

import operator

import numpy as np
import pytest

from hingepair.engine.trace import Sampled, sampled_value

VALUES = np.array([0.5, -2.0, 3.0])


@pytest.mark.parametrize("operation", [operator.add, operator.sub, operator.mul, operator.truediv])
@pytest.mark.parametrize("other", [0.0, 1.0, -1.0, 2.5, Sampled(VALUES[::-1])])
def test_operations_give_what_numpy_gives(operation, other):
    x, known = Sampled(VALUES), sampled_value(other)
    ways = [(other, x, known, VALUES)]
    if operation is not operator.truediv or np.all(known != 0):
        ways.append((x, other, VALUES, known))
    for left, right, *plain in ways:
        found = sampled_value(operation(left, right))
        np.testing.assert_array_equal(np.broadcast_to(found, VALUES.shape), operation(*plain))
    np.testing.assert_array_equal((-x).value, -VALUES)


def test_what_is_known_folds():
    x = Sampled(np.array([np.nan, 1.0]))
    assert (0 * x, x * 0, 0 / x) == (0, 0, 0)
    for same in (x + 0, 0 + x, x - 0, x * 1, 1 * x, x / 1):
        assert same is x
