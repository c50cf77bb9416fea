"""Symmetric systems solved by A = L D L^T, and attitudes by Cayley's map, for equations of motion."""

from __future__ import annotations

import math
from collections.abc import Sequence

from hingepair.equations.spatial import Entries, Matrix, Scalar, Vector, add, compose, cross, dot, scale, subtract


def factor_symmetric(A: Entries) -> tuple[list[list[Scalar]], Entries]:
    """Return the entries of L below its diagonal, row by row, and the tuple of pivots D of A = L D L^T. A is
    symmetric and positive definite, given by the entries on and below its diagonal, row by row. A pivot that is known
    to be 0 is NaN.
    """
    lower: list[list[Scalar]] = []
    pivots: list[Scalar] = []
    while len(row := list(A[len(lower) * (len(lower) + 1) // 2 :][: len(lower) + 1])) > len(lower):
        size = len(lower)
        for j in range(size):
            for k in range(j):
                row[j] = row[j] - row[k] * lower[j][k]
        scaled = [row[j] * (1.0 / pivots[j]) for j in range(size)]
        pivot = row[size]
        for j in range(size):
            pivot = pivot - row[j] * scaled[j]
        lower.append(scaled)
        pivots.append(math.nan if type(pivot) is float and pivot == 0 else pivot)
    return lower, tuple(pivots)


def solve_symmetric(A: Entries, b: Entries) -> tuple[Entries, Entries]:
    """Solve A x = b by the factorisation A = L D L^T, and return the tuple x and the tuple of pivots D; A is as for
    `factor_symmetric`.
    """
    lower, pivots = factor_symmetric(A)
    return solve_factored(lower, pivots, b), pivots


def solve_factored(lower: Sequence[Sequence[Scalar]], pivots: Sequence[Scalar], b: Sequence[Scalar]) -> Entries:
    """Return x of L D L^T x = b from what `factor_symmetric` returns."""
    size = len(b)
    x = list(b)
    for i in range(size):
        for j in range(i):
            x[i] = x[i] - lower[i][j] * x[j]
    x = [part * (1.0 / pivot) for part, pivot in zip(x, pivots, strict=True)]
    for i in reversed(range(size)):
        for j in range(i + 1, size):
            x[i] = x[i] - lower[j][i] * x[j]
    return tuple(x)


def cayley_attitude(g: Vector, S: Matrix) -> Matrix:
    """Return S rotated by the angle 2 atan(|g| / 2) about the world vector g (Cayley's map). For small g, g is the
    rotation vector.
    """
    x, y, z = scale(g, 0.5)
    factor = 2 / (1 + (x * x + y * y + z * z))
    sx, sy, sz = factor * x, factor * y, factor * z
    turn = (
        1 - (sy * y + sz * z), sx * y - sz, sx * z + sy,
        sx * y + sz, 1 - (sx * x + sz * z), sy * z - sx,
        sx * z - sy, sy * z + sx, 1 - (sx * x + sy * y),
    )  # fmt: skip
    return compose(turn, S)


def cayley_rate(g: Vector, omega: Vector) -> Vector:
    """Return the time derivative of g for which `cayley_attitude(g, S)`, with a constant S, rotates with the angular
    velocity omega, world axes.
    """
    return add(subtract(omega, scale(cross(g, omega), 0.5)), scale(g, dot(g, omega) * 0.25))
