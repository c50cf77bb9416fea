"""The equations differentiated by what they depend on: by velocities (E2, E8), by coordinates, by u1, u2, n and psi.

Plain arithmetic on tuples, as in `equations`. A matrix is a tuple of its entries, row by row; `turns` are the three
axes that body 1 turns about: the columns of J (E4), or the world's axes where its velocity is omega1 itself.
"""

from __future__ import annotations

from typing import TypeAlias

from hingepair.equations import spatial as eq
from hingepair.equations.spatial import HingeTrig, Matrix, Scalar, Vector

Entries: TypeAlias = tuple[Scalar, ...]
Axes: TypeAlias = tuple[Vector, Vector, Vector]

WORLD_AXES: Axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""The world's axes."""

_ZERO: Vector = (0.0, 0.0, 0.0)  # a derivative that is none


def beside(*columns: Entries) -> Entries:
    """Return the entries of a matrix, row by row, from its columns."""
    return tuple(entry for row in zip(*columns, strict=True) for entry in row)


def jacobian(turns: Axes, d: Vector, r2: Vector, axis: Vector) -> Entries:
    """Return the derivative of (v2, omega2) by (v1, omega1 or other rates of body 1, psi') (E8, E2); 6 x 7.

    v2 = v1 + omega1 x d + (r2 x S1 n) psi' and omega2 = omega1 + S1 n psi'; d = r1 - r2, axis = S1 n.
    """
    moved = [(*unit, *_ZERO) for unit in WORLD_AXES]
    turned = [(*eq.cross(turn, d), *turn) for turn in turns]
    return beside(*moved, *turned, (*eq.cross(r2, axis), *axis))


def difference_rate(omega1: Vector, r1: Vector, omega2: Vector, r2: Vector) -> Vector:
    """Return the rate of d, v2 - v1 (E8)."""
    return eq.subtract(eq.cross(omega1, r1), eq.cross(omega2, r2))


def jacobian_rate(turns: Axes, turn_rates: Axes, d: tuple[Vector, Vector], r2: Vector, spin: Axes) -> Entries:
    """Return the time derivative of `jacobian`, 6 x 7; d = (d, d'), spin = (omega1, omega2, S1 n)."""
    omega1, omega2, axis = spin
    axis_rate = eq.cross(omega1, axis)
    lever_rate = eq.add(eq.cross(eq.cross(omega2, r2), axis), eq.cross(r2, axis_rate))
    still = [(*_ZERO, *_ZERO)] * 3
    turned = [
        (*eq.add(eq.cross(rate, d[0]), eq.cross(turn, d[1])), *rate)
        for turn, rate in zip(turns, turn_rates, strict=True)
    ]
    return beside(*still, *turned, (*lever_rate, *axis_rate))


def across(n: Vector) -> Axes:
    """Return the columns of I - n n^T, the projection of a change of n that keeps n at unit length."""
    x, y, z = (eq.subtract(unit, eq.scale(n, part)) for unit, part in zip(WORLD_AXES, n, strict=True))
    return x, y, z


def turns_by_n(S1: Matrix, n: Vector, hinge: HingeTrig) -> Axes:
    """Return the rotation of body 2, world axes, by a change of each component of n (E6).

    The columns of S1 (sin(psi) (I - n n^T) + (1 - cos psi) [n]x); hinge = (sin psi, 1 - cos psi).
    """
    s, k = hinge[0], hinge[1]
    x, y, z = (
        eq.rotate(S1, eq.add(eq.scale(part, s), eq.scale(eq.cross(n, unit), k)))
        for part, unit in zip(across(n), WORLD_AXES, strict=True)
    )
    return x, y, z


def attitude_by_turns(turns: Axes, S2: Matrix) -> Entries:
    """Return the derivative of S2 by quantities that rotate body 2: [turn]x S2 for each, 9 x 3."""
    return beside(*(eq.compose(eq.skew(turn), S2) for turn in turns))


def difference_by_turns(turns: Axes, r2: Vector) -> Entries:
    """Return the derivative of d = r1 - r2 by a rotation of body 2, r2 x turn; 3 x 3."""
    return beside(*(eq.cross(r2, turn) for turn in turns))


def spins_by_n(S1: Matrix, n: Vector, psid: Scalar) -> Axes:
    """Return the derivative of omega2 by n (E2): the columns of S1 (I - n n^T) psi'."""
    x, y, z = (eq.scale(eq.rotate(S1, part), psid) for part in across(n))
    return x, y, z


def velocity_by_n(spins: Axes, turns: Axes, omega2: Vector, r2: Vector) -> Entries:
    """Return the derivative of v2 by n (E8): r2 x spin + omega2 x (r2 x turn), 3 x 3."""
    return beside(
        *(
            eq.add(eq.cross(r2, spin), eq.cross(omega2, eq.cross(r2, turn)))
            for spin, turn in zip(spins, turns, strict=True)
        )
    )


def velocity_by_psi(omega2: Vector, r2: Vector, axis: Vector) -> Vector:
    """Return the derivative of v2 by psi (E8): omega2 x (r2 x S1 n)."""
    return eq.cross(omega2, eq.cross(r2, axis))


def negative(A: Entries) -> Entries:
    """Return the matrix or vector -A."""
    return tuple(-entry for entry in A)


def spun(omega: Vector, S: Matrix) -> Matrix:
    """Return S' = [omega]x S (E3)."""
    return eq.compose(eq.skew(omega), S)
