"""Angular velocity of a moving attitude, from its derivative (E3)."""

from __future__ import annotations

from numpy.typing import ArrayLike

from hingepair.equations import spatial as eq
from hingepair.numeric.arrays import FloatArray, broadcast_shape, result_dtype, vectors
from hingepair.numeric.blocks import Named, components_of, tabulate
from hingepair.rotations.matrices import check_rotation


def angular_velocity(S: ArrayLike, S_dot: ArrayLike) -> FloatArray:
    """Return the angular velocity of rotation matrices and their time derivatives, [omega]x = S' S^T (E3).

    Args:
        S: rotation matrices, body to world; shape (..., 3, 3).
        S_dot: their time derivatives [1/s]; shape (..., 3, 3).

    Returns:
        omega, world axes [rad/s], of the antisymmetric part of S' S^T; shape (..., 3); not finite where an element on
        which it depends is not.

    Raises:
        RotationError: an element of S S^T of a finite S is off the identity by more than 2e-9 (float32: 2e-5), or det
            S is negative.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> hp.angular_velocity(np.eye(3), [[0, -3, 2], [3, 0, -1], [-2, 1, 0]])
    array([1., 2., 3.])
    """
    attitude, rate = vectors("S", S, 3, 3), vectors("S_dot", S_dot, 3, 3)
    check_rotation("S", attitude)
    shape = broadcast_shape({"S": attitude.shape[:-2], "S_dot": rate.shape[:-2]})
    inputs = {"S": components_of(attitude, 2), "S_dot": components_of(rate, 2)}

    def omega(values: Named) -> Named:
        return {"omega": eq.unskew(eq.angular_velocity_matrix(values["S"], values["S_dot"]))}

    return tabulate(omega, inputs, {"omega": (3,)}, shape, result_dtype((attitude, rate)))["omega"]
