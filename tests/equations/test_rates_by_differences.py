"""The equations against motions in sixty digits, whose rates are differences and whose bodies are clouds of points.

Rotations are products of turns about one axis, which are exponentials; nothing here uses the equations' own formulas.
"""

from __future__ import annotations

import mpmath
import pytest
from mpmath import mpf

from hingepair.equations import dynamics as dyn
from hingepair.equations import spatial as eq
from support.differences import (
    Body,
    at,
    column,
    hat,
    matrix,
    rate,
    same,
    tuple_of,
    turn,
    unit,
    vector,
    vee,
)


@pytest.fixture(autouse=True)
def _sixty_digits():
    with mpmath.workdps(60):
        yield


def test_a_turn_is_an_exponential():
    n = unit(vector(1))
    same(tuple_of(turn(n, mpf(2))), tuple_of(mpmath.expm(2 * hat(n))))


def test_matrices():
    S, w = matrix(vector(41, 9)), vector(42)
    same(eq.unskew(tuple_of(S)), vee(S))
    same(eq.rotate(tuple_of(S), w), S * column(w))
    same(eq.transpose(tuple_of(S)), tuple_of(S.T))
    same(eq.angular_velocity_matrix(tuple_of(S), vector(43, 9)), tuple_of(matrix(vector(43, 9)) * S.T))
    product = S * S.T - mpmath.eye(3)
    six = [product[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))]
    same(eq.orthonormality_terms(tuple_of(S)), [*six, mpmath.det(S)])


def test_symmetric_systems_are_solved():
    A = matrix(vector(141, 49), 7)
    A = A * A.T + mpmath.eye(7)
    lower = tuple(A[i, j] for i in range(7) for j in range(i + 1))
    same(dyn.solve_symmetric(lower, vector(142, 7))[0], mpmath.lu_solve(A, column(vector(142, 7))))


def test_cayley_s_map_and_its_rate():
    g, S = [vector(161), vector(162), vector(163)], Body(171).S()

    def attitude(s):
        now = at(g, s)
        size = mpmath.norm(now)
        return turn([part / size for part in now], 2 * mpmath.atan(size / 2)) * S

    same(dyn.cayley_attitude(g[0], tuple_of(S)), tuple_of(attitude(mpf(0))))
    omega = vee(rate(attitude) * attitude(mpf(0)).T)
    same(dyn.cayley_rate(g[0], omega), g[1])
