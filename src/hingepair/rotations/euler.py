"""Euler angles: attitudes (E10), rates and angular velocity (E4), gimbal lock; of all 24 sequences."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations import spatial as eq
from hingepair.errors import GimbalLockError
from hingepair.numeric.arrays import (
    FloatArray,
    broadcast_shape,
    result_dtype,
    vectors,
)
from hingepair.numeric.blocks import Named, angle_terms, components_of, tabulate, tabulate_one
from hingepair.rotations.matrices import check_rotation
from hingepair.rotations.sequences import EulerSequence, find_sequence, nine


def _gimbal_lock_limit(array: NDArray[Any]) -> float:
    """Return the cosine of the middle angle (in sequences such as XYX, its sine) below which angles of this array
    count as locked: the rounding of angles or matrix then leaves fewer than four digits of the rates.
    """
    return {4: 5e-4, 8: 1e-12}[result_dtype((array,)).itemsize]


def euler_to_matrix(phi: ArrayLike, sequence: str = "XYZ") -> FloatArray:
    """Return the rotation matrices of Euler angles (E10).

    Args:
        phi: angles in the order of the sequence's letters [rad]; shape (..., 3).
        sequence: one of 24 Euler sequences: upper-case letters are rotations about axes of the rotated body
            (intrinsic), lower-case letters about fixed axes (extrinsic).

    Returns:
        Rotation matrices, body to world; shape (..., 3, 3). The error of a component is at most 6 u, with u = 2^-53
        (float32: 2^-24); NaN where an angle on which it depends is not finite.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> hp.euler_to_matrix((0, 0, np.pi / 2)).round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    return _matrices_of_angles(phi, sequence, EulerSequence.attitude)


def matrix_to_euler(S: ArrayLike, sequence: str = "XYZ") -> FloatArray:
    """Return the Euler angles of rotation matrices (E10).

    The middle angle is in [-pi/2, pi/2], of sequences such as XYX in [0, pi]; the others are in [-pi, pi]. At gimbal
    lock, where only the sum or the difference of the first and the third angle is determined, rounding decides which
    pair is returned. In double precision, the matrix of the angles is within 6 * 2^-53 of S, at gimbal lock too.

    Args:
        S: rotation matrices, body to world; shape (..., 3, 3). NaN where one is not finite.
        sequence: one of 24 Euler sequences: upper-case letters are rotations about axes of the rotated body
            (intrinsic), lower-case letters about fixed axes (extrinsic).

    Returns:
        Angles in the order of the sequence's letters [rad]; shape (..., 3).

    Raises:
        RotationError: an element of S S^T of a finite S is off the identity by more than 2e-9 (float32: 2e-5), or det
            S is negative.

    >>> import hingepair as hp
    >>> hp.matrix_to_euler([[0, -1, 0], [1, 0, 0], [0, 0, 1]]).round(6) + 0.0
    array([0.      , 0.      , 1.570796])
    """
    order = find_sequence(sequence)
    matrix = vectors("S", S, 3, 3)
    check_rotation("S", matrix)
    back = [order.place.index(i) for i in range(3)]

    def angles(values: Named) -> eq.Vector:
        canonical = nine(values["S"][3 * i + j] for i in back for j in back)
        return order.angles(_canonical_angles(order, canonical))

    return tabulate_one(angles, {"S": components_of(matrix, 2)}, (3,), result_dtype((matrix,)))


def euler_rate_matrix(phi: ArrayLike, sequence: str = "XYZ") -> FloatArray:
    """Return the matrix J in omega = J phi', with omega in world axes (E4); shape (..., 3, 3).

    Args:
        phi: angles in the order of the sequence's letters [rad]; shape (..., 3).
        sequence: one of 24 Euler sequences: upper-case letters are rotations about axes of the rotated body
            (intrinsic), lower-case letters about fixed axes (extrinsic).

    >>> import hingepair as hp
    >>> hp.euler_rate_matrix((0, 0, 0)).round(12) + 0.0
    array([[1., 0., 0.],
           [0., 1., 0.],
           [0., 0., 1.]])
    """
    return _matrices_of_angles(
        phi, sequence, lambda order, trig: eq.matrix_from_columns(*order.columns(order.axes(trig)))
    )


def _matrices_of_angles(
    phi: ArrayLike, sequence: str, matrix_of_trig: Callable[[EulerSequence, tuple[Any, ...]], Any]
) -> FloatArray:
    """Return the matrices (..., 3, 3) that a function makes of a sequence and (sin, cos) of its canonical angles."""
    order, angles = find_sequence(sequence), vectors("phi", phi, 3)

    def matrix(values: Named) -> Any:
        return matrix_of_trig(order, angle_terms(order.angles(values["phi"])))

    return tabulate_one(matrix, {"phi": components_of(angles)}, (3, 3), result_dtype((angles,)))


def euler_rates(phi: ArrayLike, omega: ArrayLike, sequence: str = "XYZ") -> FloatArray:
    """Return the time derivatives phi' = J^-1 omega of Euler angles (E4).

    Args:
        phi: angles in the order of the sequence's letters [rad]; shape (..., 3).
        omega: angular velocity, world axes [rad/s]; shape (..., 3).
        sequence: one of 24 Euler sequences: upper-case letters are rotations about axes of the rotated body
            (intrinsic), lower-case letters about fixed axes (extrinsic).

    Returns:
        The rates phi' [rad/s]; shape (..., 3).

    Raises:
        GimbalLockError: angles are at gimbal lock, where the cosine of the middle angle (of sequences such as XYX,
            its sine) is below 1e-12 (float32: 5e-4).

    >>> import numpy as np
    >>> import hingepair as hp
    >>> hp.euler_rates((0, 0, np.pi / 2), (1, 0, 0)).round(6) + 0.0
    array([1., 0., 0.])
    """
    order = find_sequence(sequence)
    angles, velocity = vectors("phi", phi, 3), vectors("omega", omega, 3)
    shape = broadcast_shape({"phi": angles.shape[:-1], "omega": velocity.shape[:-1]})
    inputs = {"phi": components_of(angles), "omega": components_of(velocity)}

    def rates(values: Named) -> Named:
        trig = angle_terms(order.angles(values["phi"]))
        phid = order.angles(_canonical_rates(order, trig, values["omega"]))
        return {"phid": phid, "lock": trig[2] if order.proper else trig[3]}

    out = tabulate(rates, inputs, {"phid": (3,), "lock": ()}, shape, result_dtype((angles, velocity)))
    locked = np.abs(out["lock"]) < _gimbal_lock_limit(angles)
    if locked.any():
        got = f"lock of {sequence} at {int(locked.sum())} of {locked.size} samples"
        raise GimbalLockError("phi", "angles away from gimbal lock", got)
    return out["phid"]


def _canonical_rates(sequence: EulerSequence, trig: tuple[Any, ...], omega: eq.Vector) -> eq.Vector:
    """Return the rates of the canonical angles, whose (sin, cos) are `trig`, for omega in world axes (E4)."""
    axes = sequence.axes(trig)
    x, y, z = (omega[sequence.place.index(i)] for i in range(3))
    if sequence.sign < 0:
        x, y, z = -x, -y, -z
    scaled_third = eq.scaled_third_rate(axes, (x, y, z))
    third_rate = -np.divide(scaled_third, trig[2]) if sequence.proper else np.divide(scaled_third, trig[3])
    return eq.euler_rates1(axes, (x, y, z), third_rate)


def _canonical_angles(sequence: EulerSequence, S: eq.Matrix) -> eq.Vector:
    """Return the canonical angles [rad] of a rotation S = Sx Sy Sz, or Sx Sy Sx of a proper sequence."""
    # Of the two first angles of Sx Sy Sx, half a turn apart, the sign picks that with a positive middle angle.
    opposite, adjacent = (sequence.sign * S[3], -sequence.sign * S[6]) if sequence.proper else (-S[5], S[8])
    first = np.arctan2(opposite, adjacent + 0.0)  # of zeros of any sign: 0
    s, c = np.sin(first), np.cos(first)
    # The other angles are read after the first has been turned back out of S.
    level = c * S[3] + s * S[6], c * S[4] + s * S[7], c * S[5] + s * S[8]
    if sequence.proper:
        return first, np.arctan2(s * S[3] - c * S[6], S[0]), np.arctan2(-level[2], level[1])
    return first, np.arctan2(S[2], c * S[8] - s * S[5]), np.arctan2(level[0], level[1])
