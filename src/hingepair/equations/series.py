"""Sums of Chebyshev polynomials, for numbers, arrays and traced values."""

from __future__ import annotations

from collections.abc import Sequence

from hingepair.equations.spatial import Scalar


def chebyshev_sum(coefficients: Sequence[Scalar], x: Scalar) -> Scalar:
    """Return the sum of coefficients times the Chebyshev polynomials T_0(x), T_1(x), ..., by Clenshaw."""
    now, after = clenshaw(coefficients[1:], x)
    return coefficients[0] + (x * now - after)


def clenshaw(coefficients: Sequence[Scalar], x: Scalar) -> tuple[Scalar, Scalar]:
    """Return u1 and u2 of Clenshaw's recurrence u_k = a_k + 2 x u_(k+1) - u_(k+2), for a_1, a_2, ..."""
    after: Scalar = 0.0
    now: Scalar = 0.0
    double = x + x
    for a in reversed(coefficients):
        now, after = a + (double * now - after), now
    return now, after
