"""Derivatives of samples by local polynomials, and what these leave of samples: all of their noise."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.numeric.finite_differences import check_instants, differentiate, stencils

U = 2.0**-53
ORDERS = (2, 4, 6, 8)


def uneven(count, seed):
    return np.cumsum(np.random.default_rng(seed).uniform(0.5, 1.5, count))


@pytest.mark.parametrize("count", [30, 0], ids=["many samples", "as few as may be"])
@pytest.mark.parametrize("order", ORDERS)
def test_polynomials_of_the_degree_are_differentiated(order, count):
    """At the ends too, where there are fewer than order + 5 samples as well."""
    t = 100 + uneven(max(count, order + 1), order)
    x = (t - t.mean()) / 20
    poly = np.polynomial.Polynomial(np.random.default_rng(84).normal(size=order + 1))
    first, second = differentiate(t, 1e3 + poly(x), order)
    assert abs(first - poly.deriv()(x) / 20).max() <= 1e3 * U * 64
    assert abs(second - poly.deriv(2)(x) / 400).max() <= 1e3 * U * 512
    higher = differentiate(t, x ** (order + 1), order)[0] - (order + 1) * x**order / 20
    assert abs(higher).max() > 1e-12  # of one degree more they are not


@pytest.mark.parametrize("order", ORDERS)
def test_neighbours_are_those_on_either_side_and_order_plus_5_at_the_ends(order):
    t, seen = uneven(40, 1), np.zeros(40, dtype=int)
    for rows, neighbours, first, second in stencils(t, order):
        inside = rows.start >= order // 2 and rows.stop <= 40 - order // 2
        seen[rows] += 1
        assert neighbours.shape == first.shape == second.shape
        assert neighbours.shape[1] == (order + 1 if inside else order + 5)
        if inside:
            assert np.array_equal(neighbours[:, order // 2], np.arange(rows.start, rows.stop))
        assert (np.diff(neighbours, axis=1) == 1).all()
        assert (abs(first.sum(axis=1)) < 1e-13 * abs(first).sum(axis=1)).all()  # of a constant nothing
    assert (seen == 1).all()


def test_many_samples_are_like_few(monkeypatch):
    t = uneven(200, 2)
    whole = differentiate(t, np.sin(t / 9))
    monkeypatch.setattr("hingepair.numeric.finite_differences._BLOCK", 7)
    assert np.array_equal(whole, differentiate(t, np.sin(t / 9)))


def test_instants_become_float64():
    for t in (np.arange(5), np.arange(5, dtype=np.float32), np.array([0, 99_999_999_999]), np.arange(3.0) * 1e12):
        found = check_instants("t", t, 0)
        assert found.dtype == np.float64
        assert found.tolist() == t.tolist()
    assert check_instants("t", np.array([]), -1).size == 0
    assert check_instants("t", np.array([4.0]), 0).tolist() == [4.0]
