"""Small matrices in the equations of trees, in sixty digits."""

from __future__ import annotations

import mpmath
from mpmath import mpf

from hingepair.equations import trees
from support.differences import column, same, tuple_of, turn, unit, vector


@mpmath.workdps(60)
def test_symmetric_matrices():
    A, B = vector(351, 6), vector(352, 6)
    S, pair = turn(unit(vector(353)), mpf(1)), (mpmath.sin(mpf(2)), mpmath.cos(mpf(2)))
    full_A, about_z = (
        mpmath.matrix([list(trees.full_matrix(A)[i : i + 3]) for i in (0, 3, 6)]),
        turn([0, 0, 1], mpf(2)),
    )

    def upper(m):
        return [m[i, j] for i in range(3) for j in range(i, 3)]

    assert full_A == full_A.T
    same(trees.symmetric_sum(A, B), [a + b for a, b in zip(A, B, strict=True)])
    same(trees.conjugate(tuple_of(S), A), upper(S * full_A * S.T))
    same(trees.turned_symmetric(pair, A), upper(about_z * full_A * about_z.T))
    same(trees.inertia_from_moment(A), upper((A[0] + A[3] + A[5]) * mpmath.eye(3) - full_A))
    x, y = column(vector(354)), column(vector(355))
    same(trees.outer_sum(tuple(x), tuple(y)), upper(x * y.T + y * x.T))
    C = mpmath.matrix([list(vector(356)), list(vector(357)), list(vector(358))])
    same(trees.turned_matrix(pair, tuple_of(C)), tuple_of(about_z * C * about_z.T))
    same(trees.turned_columns(tuple_of(C), pair), tuple_of(C * about_z))
    same(trees.turned(pair, tuple(x)), about_z * x)
    same(trees.turned_back(pair, tuple(x)), about_z.T * x)
