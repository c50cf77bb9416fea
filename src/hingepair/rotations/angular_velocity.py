"""Angular velocity of a moving attitude, from its derivative (E3)."""

from __future__ import annotations

import functools
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike

from hingepair.equations import spatial as eq
from hingepair.numeric.arrays import FloatArray, broadcast_shape, result_dtype, vectors
from hingepair.numeric.blocks import Named, components_of, tabulate
from hingepair.rotations.matrices import check_rotation


@overload
def angular_velocity(S: ArrayLike, S_dot: ArrayLike, with_defect: Literal[False] = False) -> FloatArray: ...
@overload
def angular_velocity(S: ArrayLike, S_dot: ArrayLike, with_defect: Literal[True]) -> tuple[FloatArray, FloatArray]: ...
def angular_velocity(
    S: ArrayLike, S_dot: ArrayLike, with_defect: bool = False
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Return the angular velocity of rotation matrices and their time derivatives, [omega]x = S' S^T (E3).

    Args:
        S: rotation matrices, body to world; shape (..., 3, 3).
        S_dot: their time derivatives [1/s]; shape (..., 3, 3).
        with_defect: return also how far S_dot is from the derivative of a rotation.

    Returns:
        omega, world axes [rad/s], of the antisymmetric part of S' S^T; shape (..., 3); not finite where an element on
        which it depends is not. With `with_defect`, (omega, defect), where the defect is the largest element of the
        symmetric part [1/s], 0 for a rotation; shape (...,).

    Raises:
        RotationError: an element of S S^T of a finite S is off the identity by more than 2e-9 (float32: 2e-5), or det
            S is negative.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> hp.angular_velocity(np.eye(3), [[0, -3, 2], [3, 0, -1], [-2, 1, 0]])
    array([1., 2., 3.])
    >>> omega, defect = hp.angular_velocity(np.eye(3), [[0, -3, 2], [3, 0, -1], [-2, 2, 0]], with_defect=True)
    >>> omega.tolist(), float(defect)
    ([1.5, 2.0, 3.0], 0.5)
    """
    attitude, rate = vectors("S", S, 3, 3), vectors("S_dot", S_dot, 3, 3)
    check_rotation("S", attitude)
    shape = broadcast_shape({"S": attitude.shape[:-2], "S_dot": rate.shape[:-2]})
    inputs = {"S": components_of(attitude, 2), "S_dot": components_of(rate, 2)}
    tails: dict[str, tuple[int, ...]] = {"omega": (3,), "defect": ()} if with_defect else {"omega": (3,)}

    def omega_and_defect(values: Named) -> Named:
        """Return omega and, `with_defect`, the defect, of one block of S and S_dot."""
        W = eq.angular_velocity_matrix(values["S"], values["S_dot"])
        results: Named = {"omega": eq.unskew(W)}
        if with_defect:
            pairs = ((0, 0), (4, 4), (8, 8), (1, 3), (2, 6), (5, 7))
            results["defect"] = functools.reduce(np.maximum, [np.abs(0.5 * W[i] + 0.5 * W[j]) for i, j in pairs])
        return results

    results = tabulate(omega_and_defect, inputs, tails, shape, result_dtype((attitude, rate)))
    return (results["omega"], results["defect"]) if with_defect else results["omega"]
