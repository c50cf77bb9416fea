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


def chebyshev_integral(terms: Sequence[Scalar]) -> list[Scalar]:
    """Return the coefficients of the integral of a sum of Chebyshev polynomials: of T_j, T_(j+1) / (2 j + 2) less
    T_(j-1) / (2 j - 2).
    """
    sums: list[Scalar] = [0.0] * (len(terms) + 1)
    for j, term in enumerate(terms):
        sums[j + 1] = sums[j + 1] + term * (1.0 if j == 0 else 0.5 / (j + 1))
        if j > 1:
            sums[j - 1] = sums[j - 1] - term * (0.5 / (j - 1))
    return sums
