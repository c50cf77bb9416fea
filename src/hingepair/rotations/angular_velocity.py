"""Return the angular velocity of a moving attitude (E3): from its derivative, or from samples of it."""

from __future__ import annotations

import functools
from typing import Literal, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import Float64Array, FloatArray, broadcast_shape, result_dtype, vectors
from hingepair.numeric.blocks import Named, components_of, tabulate
from hingepair.numeric.finite_differences import stencils
from hingepair.numeric.instants import instants_of
from hingepair.rotations.matrices import check_rotation, rotation_vector

ALLOWED_ERROR_ORDERS_OF_ANGULAR_VELOCITY = (2, 4, 6, 8)  # in the time step


@overload
def angular_velocity(S: ArrayLike, S_dot: ArrayLike, with_defect: Literal[False] = False) -> FloatArray: ...
@overload
def angular_velocity(S: ArrayLike, S_dot: ArrayLike, with_defect: Literal[True]) -> tuple[FloatArray, FloatArray]: ...
def angular_velocity(
    S: ArrayLike, S_dot: ArrayLike, with_defect: bool = False
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Return the angular velocity omega (..., 3), in world axes, of rotation matrices S with time derivatives S_dot
    (equation E3). With `with_defect`, return (omega, defect), where defect says how far S_dot is from the derivative
    of a rotation. Raise RotationError if a finite S is not a rotation.

    The angular velocity satisfies [omega]x = S' S^T. Here S' is S_dot, and [omega]x is the cross-product matrix of
    omega. If an element of S or S_dot is not finite, the components of omega that depend on this element are not
    finite either.

    Args:
        S: rotation matrices, body to world; shape (..., 3, 3).
        S_dot: their time derivatives [1/s]; shape (..., 3, 3).
        with_defect: whether to return the defect too; False by default. The defect is 0 if S_dot is the derivative
            of a rotation, because S' S^T is then antisymmetric.

    Returns:
        omega, world axes [rad/s]; shape (..., 3). [omega]x is the antisymmetric part of S' S^T. With `with_defect`,
        (omega, defect), where the defect is the largest magnitude of an element of the symmetric part of S' S^T
        [1/s]; shape (...,).

    Raises:
        RotationError: S is finite, but an element of S S^T differs from the same element of the identity by more than
            2e-9 (2e-5 for float32), or det S is negative.

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
        """Return a dict of "omega", the components of the angular velocity, and, if `with_defect` of the enclosing
        function is true, "defect", the largest absolute element of the symmetric part of S' S^T. `values` is a dict
        from "S" and "S_dot" to tuples of nine entries.
        """
        W = eq.angular_velocity_matrix(values["S"], values["S_dot"])
        results: Named = {"omega": eq.unskew(W)}
        if with_defect:
            pairs = ((0, 0), (4, 4), (8, 8), (1, 3), (2, 6), (5, 7))
            results["defect"] = functools.reduce(np.maximum, [np.abs(0.5 * W[i] + 0.5 * W[j]) for i, j in pairs])
        return results

    results = tabulate(omega_and_defect, inputs, tails, shape, result_dtype((attitude, rate)))
    return (results["omega"], results["defect"]) if with_defect else results["omega"]


@overload
def angular_velocity_from_samples(
    t: ArrayLike, S: ArrayLike, order: int = 6, with_alpha: Literal[False] = False
) -> FloatArray: ...
@overload
def angular_velocity_from_samples(
    t: ArrayLike, S: ArrayLike, order: int = 6, *, with_alpha: Literal[True]
) -> tuple[FloatArray, FloatArray]: ...
def angular_velocity_from_samples(
    t: ArrayLike, S: ArrayLike, order: int = 6, with_alpha: bool = False
) -> FloatArray | tuple[FloatArray, FloatArray]:
    """Return the angular velocity omega (..., N, 3), in world axes, from the rotation matrices S (..., N, 3, 3) at N
    instants t (equation E3). The finite differences have an error proportional to the time step to the power `order`.
    With `with_alpha`, return (omega, alpha), where alpha is the angular acceleration. Raise ArgumentError if the body
    turns by pi or more between two samples that one finite difference uses.

    For each sample i, `S(t) = exp([theta(t)]x) S_i` defines the rotation vector theta(t) in world axes; [theta]x is
    the cross-product matrix of theta. At sample i, theta is 0, and therefore omega = theta' and alpha = theta''
    exactly. The function differentiates the polynomial of degree `order` that interpolates theta at sample i and at
    order / 2 neighbours on each side. Near the ends, a polynomial of degree `order` is fitted by least squares to
    theta at the first or the last (`order` + 5) samples, or at all samples if there are fewer.

    A higher order suits smooth motion, and a lower order suits noisy data at small time steps. Suppose that the noise
    of the attitudes is white, that the rotation vector of the noise has the standard deviation sigma [rad] in each
    component, and that the time step is h [s]. Then the standard deviation of every component of omega is
    c sigma / h [rad/s], with c from this table:

        order    in the middle    first and last sample
        2        0.71             0.68
        4        0.95             1.9
        6        1.1              3.7
        8        1.2              6.8

    Args:
        t: instants, increasing, not necessarily uniform: seconds (floats), datetime64, or nanoseconds since 1970
            (integers); shape (N,) with N > order.
        S: rotation matrices, body to world, at the instants t; shape (..., N, 3, 3).
        order: power of the time step to which the error of omega is proportional: 2, 4, 6 (the default) or 8.
        with_alpha: whether to return the angular acceleration alpha too; False by default. If the time steps are
            uniform, the error of alpha away from the ends is of the same order as the error of omega. Otherwise, and
            near the ends, its order is lower by one.

    Returns:
        omega, world axes [rad/s]; shape (..., N, 3). With `with_alpha`, (omega, alpha), where alpha [rad/s^2] has the
        same shape, world axes. If a sample of S is not finite, the results that depend on this sample are not finite
        either.

    Raises:
        ArgumentError: t is not increasing or not finite; `order` is not 2, 4, 6 or 8; or the
            angles by which the body turns from sample to sample add up to pi or more between a sample and a neighbour
            that is used with it (turns back and forth do not cancel). The rotation vector may then be ambiguous. Each
            single angle is assumed to be less than pi; a larger one cannot be detected.
        RotationError: S is finite, but an element of S S^T differs from the same element of the identity by more than
            2e-9 (2e-5 for float32), or det S is negative.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> t = np.linspace(0, 1, 11)
    >>> hp.angular_velocity_from_samples(t, hp.rotation_exp(t[:, None] * (0, 0, 2))).round(12)[5] + 0.0
    array([0., 0., 2.])
    """
    if not isinstance(order, int | np.integer) or order not in ALLOWED_ERROR_ORDERS_OF_ANGULAR_VELOCITY:
        raise ArgumentError(
            "order", f"one of {', '.join(map(str, ALLOWED_ERROR_ORDERS_OF_ANGULAR_VELOCITY))}", quoted(order)
        )
    time, attitude = instants_of("t", t, order), vectors("S", S, 3, 3)
    dtype = result_dtype((np.asarray(t), attitude))
    if attitude.ndim < 3 or attitude.shape[-3] != time.size:
        raise ArgumentError("S", f"shape (..., {time.size}, 3, 3), a rotation for each t", f"shape {attitude.shape}")
    check_rotation("S", attitude)
    found = _rotation_vector_derivatives(time, attitude.astype(np.float64, copy=False), order, 1 + with_alpha)
    omega, *alpha = (array.astype(dtype, copy=False) for array in found)
    return (omega, alpha[0]) if alpha else omega


def _rotation_vector_derivatives(t: Float64Array, S: Float64Array, order: int, count: int) -> list[Float64Array]:
    """Return a list of arrays (..., N, 3), the first `count` time derivatives of the rotation vector at the samples S
    at instants t: [omega], or [omega, alpha] if `count` is 2, both in world axes. The error of the finite differences
    is proportional to the time step to the power `order`. Raise ArgumentError if two samples that are used together
    differ by a turn of pi or more.
    """
    turned_angles = _turned_angles(S)
    derivatives = [np.zeros(S.shape[:-1]) for _ in range(count)]
    with np.errstate(all="ignore"):
        for rows, neighbours, *weights in stencils(t, order):
            samples = np.arange(rows.start, rows.stop)
            _check_turn_angles(
                np.abs(turned_angles[..., neighbours] - turned_angles[..., samples, None]).max(axis=-1, initial=0.0),
                samples,
            )
            for k, others in enumerate(neighbours.T):
                theta = _rotation_between(S[..., rows, :, :], S[..., others, :, :])
                theta[..., others == samples, :] *= 0.0  # round-off; NaN where S is
                for derivative, weight in zip(derivatives, weights, strict=False):
                    derivative[..., rows, :] += weight[:, k, None] * theta
    return derivatives


def _rotation_between(start: Float64Array, stop: Float64Array) -> Float64Array:
    """Return the rotation vectors (..., 3) [rad], in world axes, that turn the rotation matrices `start` into the
    rotation matrices `stop`.
    """
    return rotation_vector(stop @ np.swapaxes(start, -1, -2))


def _turned_angles(S: Float64Array) -> Float64Array:
    """Return the angle [rad] that the body has turned from the first sample to each of the samples S (..., N, 3, 3),
    an array (..., N) that begins with 0. It is the sum of the angles, each at most pi, between consecutive samples;
    an angle that is NaN counts as 0.
    """
    angles = np.zeros(S.shape[:-2])
    with np.errstate(all="ignore"):
        steps = _rotation_between(S[..., :-1, :, :], S[..., 1:, :, :])
        np.cumsum(np.nan_to_num(np.sqrt((steps * steps).sum(axis=-1))), axis=-1, out=angles[..., 1:])
    return angles


def _check_turn_angles(angles: Float64Array, sample_indices: NDArray[np.intp]) -> None:
    """Raise ArgumentError if an angle (..., samples) [rad] is pi or more. `angles` holds, for each sample, the angle
    to the farthest sample that is used together with it; the rotation vector is ambiguous from pi on.
    `sample_indices` are the indices of the samples, for the message.
    """
    bad = np.argwhere(angles >= np.pi)
    if bad.size:
        expected = (
            "samples that turn by less than pi from one to each neighbour used (a smaller step, or a lower order)"
        )
        raise ArgumentError("S", expected, f"{angles[tuple(bad[0])]:.3g} rad at index {sample_indices[bad[0, -1]]}")
