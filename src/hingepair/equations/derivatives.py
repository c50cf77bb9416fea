"""The equations differentiated by what they depend on: by velocities (E2, E8), by coordinates, by u1, u2, n and psi.

Plain arithmetic on tuples, as in `equations`. A matrix is a tuple of its entries, row by row; `turn_axes` are the
three axes that body 1 turns about: the columns of J (E4), or the world's axes where its velocity is omega1 itself.
"""

from __future__ import annotations

from typing import TypeAlias

from hingepair.equations import spatial as eq
from hingepair.equations.spatial import ZERO_VECTOR, HingeTrig, Matrix, Scalar, Vector

Entries: TypeAlias = tuple[Scalar, ...]
Axes: TypeAlias = tuple[Vector, Vector, Vector]

WORLD_UNIT_VECTORS: Axes = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
"""Unit vectors along the world's axes."""


def matrix_from_columns(*columns: Entries) -> Entries:
    """Return the matrix with these columns, each a tuple of numbers, as a flat tuple row by row."""
    return tuple(entry for row in zip(*columns, strict=True) for entry in row)


def jacobian(turn_axes: Axes, d: Vector, r2: Vector, axis: Vector) -> Entries:
    """Return the Jacobian of (v2, omega2) with respect to v1, the rates of body 1's rotations about three axes
    (turn_axes), and psi': a 6 x 7 matrix as a flat tuple row by row. d = R2 - R1, r2 = S2 u2, and axis = S1 n; all
    are in world axes.

    Where turn_axes are the world's axes, the three rates are omega1 (E8, E2): v2 = v1 + omega1 x d + (r2 x S1 n) psi'
    and omega2 = omega1 + S1 n psi', with d = r1 - r2.
    """
    moved = [(*unit, *ZERO_VECTOR) for unit in WORLD_UNIT_VECTORS]
    turned = [(*eq.cross(turn, d), *turn) for turn in turn_axes]
    return matrix_from_columns(*moved, *turned, (*eq.cross(r2, axis), *axis))


def difference_rate(omega1: Vector, r1: Vector, omega2: Vector, r2: Vector) -> Vector:
    """Return d' = v2 - v1 = omega1 x r1 - omega2 x r2, the time derivative of d = r1 - r2 (E8), where r1 = S1 u1 and
    r2 = S2 u2.
    """
    return eq.subtract(eq.cross(omega1, r1), eq.cross(omega2, r2))


def jacobian_rate(
    turn_axes: Axes, turn_axis_rates: Axes, d_and_rate: tuple[Vector, Vector], r2: Vector, omegas_and_axis: Axes
) -> Entries:
    """Return the time derivative of `jacobian`, a 6 x 7 matrix as a flat tuple row by row. turn_axis_rates are the
    time derivatives of the three turn_axes, d_and_rate = (d, d') with d = R2 - R1, r2 = S2 u2, and omegas_and_axis =
    (omega1, omega2, S1 n).
    """
    omega1, omega2, axis = omegas_and_axis
    axis_rate = eq.cross(omega1, axis)
    lever_rate = eq.add(eq.cross(eq.cross(omega2, r2), axis), eq.cross(r2, axis_rate))
    constant_columns = [(*ZERO_VECTOR, *ZERO_VECTOR)] * 3
    turned = [
        (*eq.add(eq.cross(rate, d_and_rate[0]), eq.cross(turn, d_and_rate[1])), *rate)
        for turn, rate in zip(turn_axes, turn_axis_rates, strict=True)
    ]
    return matrix_from_columns(*constant_columns, *turned, (*lever_rate, *axis_rate))


def projection_across(n: Vector) -> Axes:
    """Return the three columns of I - n n^T, where n is a unit vector. The matrix projects a change of n to a change
    that keeps the length of n at 1.
    """
    x, y, z = (eq.subtract(unit, eq.scale(n, part)) for unit, part in zip(WORLD_UNIT_VECTORS, n, strict=True))
    return x, y, z


def turns_by_n(S1: Matrix, n: Vector, hinge_trig: HingeTrig) -> Axes:
    """Return three rotation vectors of body 2, world axes: the derivatives of its attitude with respect to the
    components of n, of which those that change its length count nothing (E6); hinge_trig = (sin psi, 1 - cos psi).

    The columns of S1 (sin(psi) (I - n n^T) + (1 - cos psi) [n]x).
    """
    s, k = hinge_trig[0], hinge_trig[1]
    x, y, z = (
        eq.rotate(S1, eq.add(eq.scale(part, s), eq.scale(eq.cross(n, unit), k)))
        for part, unit in zip(projection_across(n), WORLD_UNIT_VECTORS, strict=True)
    )
    return x, y, z


def attitude_by_turns(turns: Axes, S2: Matrix) -> Entries:
    """Return the derivatives of S2 with respect to three quantities that rotate body 2 by the rotation vectors
    `turns`: [turn]x S2, 9 x 3, as a flat tuple row by row.
    """
    return matrix_from_columns(*(eq.compose(eq.skew(turn), S2) for turn in turns))


def difference_by_turns(turns: Axes, r2: Vector) -> Entries:
    """Return the derivatives of d = r1 - r2 with respect to three quantities that rotate body 2 by the rotation
    vectors `turns`: r2 x turn, 3 x 3, as a flat tuple row by row.
    """
    return matrix_from_columns(*(eq.cross(r2, turn) for turn in turns))


def spins_by_n(S1: Matrix, n: Vector, psid: Scalar) -> Axes:
    """Return the derivatives of omega2 with respect to the components of n (E2), world axes: the three columns of S1
    (I - n n^T) psi'.
    """
    x, y, z = (eq.scale(eq.rotate(S1, part), psid) for part in projection_across(n))
    return x, y, z


def velocity_by_n(omega2_by_n: Axes, turns: Axes, omega2: Vector, r2: Vector) -> Entries:
    """Return the derivative of v2 with respect to n (E8), a 3 x 3 matrix as a flat tuple row by row. For each
    component of n, omega2_by_n holds the derivative of omega2, and `turns` the rotation vector of body 2; r2 = S2 u2.
    """
    return matrix_from_columns(
        *(
            eq.add(eq.cross(r2, spin), eq.cross(omega2, eq.cross(r2, turn)))
            for spin, turn in zip(omega2_by_n, turns, strict=True)
        )
    )


def velocity_by_psi(omega2: Vector, r2: Vector, axis: Vector) -> Vector:
    """Return the derivative of v2 with respect to psi (E8): omega2 x (r2 x S1 n), where axis = S1 n."""
    return eq.cross(omega2, eq.cross(r2, axis))


def negative(A: Entries) -> Entries:
    """Return the matrix or vector -A."""
    return tuple(-entry for entry in A)


def rotation_rate(omega: Vector, S: Matrix) -> Matrix:
    """Return S' = [omega]x S, the time derivative of a rotation matrix S of nine entries (E3), as nine entries."""
    return eq.compose(eq.skew(omega), S)
