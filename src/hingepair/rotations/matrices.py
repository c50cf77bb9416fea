"""Rotations: matrices, axes and angles, rotation vectors, quaternions, angular velocity (E3, E6)."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError, RotationError
from hingepair.numeric.arrays import FloatArray, broadcast_shape, real_array, result_dtype, vectors
from hingepair.numeric.blocks import (
    VERSINE_SWITCH,
    Named,
    components_of,
    hinge_terms,
    tabulate,
    tabulate_one,
)
from hingepair.numeric.twofold import Twofold
from hingepair.numeric.unit_vectors import direction, polar, unit_axis

# Largest element of S S^T - I of an accepted rotation, by the bytes of a number: twice the error of a row's length.
MAX_ORTHOGONALITY_ERRORS = {4: 2e-5, 8: 2e-9}


def skew(w: ArrayLike) -> FloatArray:
    """Return the cross-product matrices [w]x, with [w]x @ u = w x u.

    Args:
        w: vectors; shape (..., 3).

    >>> import hingepair as hp
    >>> hp.skew((1, 2, 3))
    array([[ 0., -3.,  2.],
           [ 3.,  0., -1.],
           [-2.,  1.,  0.]])
    """
    vector = vectors("w", w, 3)
    matrix = np.zeros((*vector.shape, 3), result_dtype((vector,)))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., k, j] = vector[..., i]
        matrix[..., j, k] = -matrix[..., k, j]
    return matrix


def unskew(W: ArrayLike) -> FloatArray:
    """Return the vectors w of cross-product matrices [w]x, the inverse of `skew`.

    Args:
        W: antisymmetric matrices; shape (..., 3, 3). One that is not finite is not checked.

    Raises:
        ArgumentError: the symmetric part of W has an element above 1e-9 of the largest of W (float32: 1e-5).

    >>> import hingepair as hp
    >>> hp.unskew([[0, -3, 2], [3, 0, -1], [-2, 1, 0]])
    array([1., 2., 3.])
    """
    matrix = vectors("W", W, 3, 3)
    dtype = result_dtype((matrix,))
    matrix = matrix.astype(dtype, copy=False)
    with np.errstate(all="ignore"):
        rest = np.abs(matrix + np.swapaxes(matrix, -1, -2)).max(axis=(-2, -1), initial=0.0)
        size = np.abs(matrix).max(axis=(-2, -1), initial=0.0)
        bad = np.isfinite(size) & (rest > {4: 2e-5, 8: 2e-9}[dtype.itemsize] * size)
    if np.any(bad):
        raise ArgumentError("W", "antisymmetric matrices", f"W + W^T up to {np.max(rest[bad]):.3g}")
    return tabulate_one(lambda v: eq.unskew(v["W"]), {"W": components_of(matrix, 2)}, (3,), dtype)


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


def rodrigues(n: ArrayLike, psi: ArrayLike) -> FloatArray:
    """Return the rotation matrices of rotations by an angle about an axis (E6).

    Args:
        n: rotation axis of any non-zero length; shape (..., 3).
        psi: rotation angle, right-handed about n [rad]; shape (...,), broadcasts against n. NaN where it is not
            finite.

    Raises:
        AxisError: n is zero or not finite.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> hp.rodrigues((0, 0, 1), np.pi / 2).round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    axis, angle = real_array("n", n), real_array("psi", psi)
    inputs = {"n": components_of(unit_axis("n", axis)), "psi": angle}
    dtype = result_dtype((axis, angle))
    return tabulate_one(lambda v: eq.hinge_rotation(v["n"], hinge_terms(v["psi"])), inputs, (3, 3), dtype)


def rotation_exp(rotvec: ArrayLike) -> FloatArray:
    """Return the rotation matrices of rotation vectors, unit axis times angle (E6).

    Args:
        rotvec: rotation vectors [rad]; shape (..., 3). NaN where one is not finite.

    Returns:
        Rotation matrices; shape (..., 3, 3). In double precision, the error of a component is at most 6 * 2^-53 for
        angles up to 1e15 rad.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> hp.rotation_exp((0, 0, np.pi / 2)).round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    vector = vectors("rotvec", rotvec, 3)

    def rotation(values: Named) -> tuple[Any, ...]:
        """Return a rotation matrix (E6), corrected for the rounding of axis and angle."""
        axis, angle = polar(values["rotvec"])
        x, y, z = (unit.high for unit in axis)
        s, k, c = hinge_terms(angle.high)
        s_low, k_low, _ = hinge_terms(angle.low)
        lost = np.where(c > VERSINE_SWITCH, 0.0, (1 - k) - c)  # when k = 1 - c was rounded
        rest = _rounding_correction((x, y, z), axis, (s, k), (c * s_low - s * k_low, lost + (s * s_low + c * k_low)))
        return tuple(x + y for x, y in zip(eq.hinge_rotation((x, y, z), (s, k)), rest, strict=True))

    S = tabulate_one(rotation, {"rotvec": components_of(vector)}, (3, 3), np.dtype(np.float64))
    return S.astype(result_dtype((vector,)), copy=False)


def _rounding_correction(
    n: eq.Vector, twofold_axis: tuple[Twofold, ...], trig: eq.HingeTrig, trig_low: eq.HingeTrig
) -> tuple[Any, ...]:
    """Return nine entries to add to the rotation matrix (E6) of the rounded n and trig = (sin, 1 - cos): what the low
    parts of the axis and of the trigonometric terms change.
    """
    (s, k), (s_low, k_low) = trig, trig_low
    x, y, z = n
    a, b, c = (unit.low for unit in twofold_axis)
    xx, yy, zz = (2 * k * w.low * w.high + k_low * w.high * w.high for w in twofold_axis)
    xy = k * (x * b + y * a) + k_low * x * y
    yz = k * (y * c + z * b) + k_low * y * z
    zx = k * (z * a + x * c) + k_low * z * x
    sx, sy, sz = s * a + s_low * x, s * b + s_low * y, s * c + s_low * z
    return -yy - zz, xy - sz, zx + sy, xy + sz, -zz - xx, yz - sx, zx - sy, yz + sx, -xx - yy


def rotation_log(S: ArrayLike) -> FloatArray:
    """Return the rotation vectors of rotation matrices, unit axis times angle in [0, pi] (inverse of E6).

    Args:
        S: rotation matrices; shape (..., 3, 3). NaN where one is not finite.

    Returns:
        Rotation vectors [rad]; shape (..., 3). In double precision `rotation_log(rotation_exp(rotvec))` is off by at
        most 6 * 2^-53 times the length of `rotvec`, if that is below pi - 2e-15. At pi, one of two vectors is
        returned.

    Raises:
        RotationError: an element of S S^T of a finite S is off the identity by more than 2e-9 (float32: 2e-5), or det
            S is negative.

    >>> import hingepair as hp
    >>> hp.rotation_log([[0, -1, 0], [1, 0, 0], [0, 0, 1]]).round(6) + 0.0
    array([0.      , 0.      , 1.570796])
    """
    matrix = vectors("S", S, 3, 3)
    check_rotation("S", matrix)
    rotvec: FloatArray = rotation_vector(matrix.astype(np.float64, copy=False))
    return rotvec.astype(result_dtype((matrix,)), copy=False)


def rotation_vector(S: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rotation vectors [rad], of length at most pi, of rotation matrices, which are not checked."""
    quat = _scaled_quaternion(S)
    vector = quat[..., 1:]
    with np.errstate(all="ignore"):
        length = np.hypot(np.hypot(vector[..., 0], vector[..., 1]), vector[..., 2])
        factor = np.where(length > 0, 2 * np.arctan2(length, quat[..., 0]) / length, 2 / quat[..., 0])
        return np.asarray(vector * factor[..., None])


def matrix_to_quaternion(S: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the unit quaternions (w, x, y, z) of rotation matrices S (..., 3, 3), with w >= 0; shape (..., 4)."""
    return unit_quaternion(_scaled_quaternion(S))


def unit_quaternion(quat: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternions of an array (..., 4) scaled to unit length; NaN where one is not finite."""
    with np.errstate(invalid="ignore"):
        return np.stack(direction(components_of(quat)), axis=-1)


def _scaled_quaternion(S: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return quaternions (w, x, y, z), (..., 4), of rotation matrices S, with w >= 0 and lengths between 2 and 4."""
    # Four times the outer product of the unit quaternion with itself, which is linear in S.
    outer = np.empty((*S.shape[:-2], 4, 4))
    xx, yy, zz = S[..., 0, 0], S[..., 1, 1], S[..., 2, 2]
    with np.errstate(all="ignore"):
        for i, diagonal in enumerate(
            (1 + (xx + yy + zz), 1 + (xx - yy - zz), 1 + (yy - zz - xx), 1 + (zz - xx - yy))
        ):
            outer[..., i, i] = diagonal
        for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            outer[..., 0, i + 1] = outer[..., i + 1, 0] = S[..., k, j] - S[..., j, k]
            outer[..., j + 1, k + 1] = outer[..., k + 1, j + 1] = S[..., j, k] + S[..., k, j]
    # The row with the largest diagonal element is the quaternion times a number that is never small, so nothing
    # cancels, near 0 and pi included.
    pivot = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    quat = np.take_along_axis(outer, pivot[..., None, None], axis=-2)[..., 0, :]
    return np.where(quat[..., :1] < 0, -quat, quat)


def quaternion_to_matrix(name: str, quat: ArrayLike, *, scalar_first: bool) -> FloatArray:
    """Return the rotation matrices of quaternions of any length, (w, x, y, z) if `scalar_first`, else (x, y, z, w);
    NaN where one is not finite.

    Raises:
        RotationError: a quaternion is zero; names the argument `name`.
    """
    quaternions = vectors(name, quat, 4)
    if np.any((quaternions == 0).all(axis=-1)):
        raise RotationError(name, "non-zero quaternions", "a zero quaternion")
    parts = components_of(quaternions)
    order = parts if scalar_first else (parts[3], *parts[:3])
    S = tabulate_one(lambda v: eq.quaternion_attitude(direction(v["q"])), {"q": order}, (3, 3), np.dtype(np.float64))
    return S.astype(result_dtype((quaternions,)), copy=False)


def project_to_rotation(M: ArrayLike) -> FloatArray:
    """Return the rotation matrices nearest to matrices, their orthogonal polar factors.

    Args:
        M: matrices with a positive determinant; shape (..., 3, 3). NaN where one is not finite.

    Returns:
        Rotation matrices; shape (..., 3, 3). In double precision, the error of a component is at most 6 * 2^-53 if M
        is within 1e-2 of a rotation; else it grows with the ratio of the largest singular value to the sum of the
        others.

    Raises:
        RotationError: a determinant is not positive: the polar factor is a reflection, or not unique.

    >>> import hingepair as hp
    >>> hp.project_to_rotation([[2, 0, 0], [0, 3, 0], [0, 0, 1]]) + 0.0
    array([[1., 0., 0.],
           [0., 1., 0.],
           [0., 0., 1.]])
    """
    matrix = vectors("M", M, 3, 3)
    work = matrix.astype(np.float64)
    finite = np.isfinite(work).all(axis=(-2, -1))
    work[~finite] = np.eye(3)
    size = np.abs(work).max(axis=(-2, -1), keepdims=True, initial=0.0)
    with np.errstate(all="ignore"):  # tiny entries underflow
        scaled = work / np.where(size > 0, size, 1.0)
        left, singular, right = np.linalg.svd(scaled)
        S = left @ right
        bad = (singular[..., 2] <= 1e-14 * singular[..., 0]) | (np.linalg.det(S) < 0)
        if np.any(bad):
            got = f"{int(np.sum(bad))} of {bad.size} without"
            raise RotationError("M", "matrices with a positive determinant", got)
        S = _refine_nearest_rotation(S, scaled)  # corrects the rounding of the decomposition
        S = 0.5 * (S @ (3 * np.eye(3) - np.swapaxes(S, -1, -2) @ S))
    S[~finite] = np.nan
    nearest: FloatArray = S.astype(result_dtype((matrix,)), copy=False)
    return nearest


def _refine_nearest_rotation(S: NDArray[np.float64], M: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return approximations S of the rotations nearest to M, (..., 3, 3), corrected by one Newton step."""
    A = np.swapaxes(S, -1, -2) @ M
    w = np.stack([A[..., k, j] - A[..., j, k] for _, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1))], axis=-1)
    inertia = np.trace(A, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - (A + np.swapaxes(A, -1, -2)) / 2
    turn = np.linalg.solve(inertia, w[..., None])[..., 0]  # makes S^T M symmetric
    return S + S @ skew(turn)  # orthogonal only to first order in the turn


def check_rotation(name: str, S: NDArray[Any]) -> None:
    """Refuse matrices that are no rotations to within 1e-9 (float32: 1e-5); those that are not finite pass.

    Raises:
        RotationError: names the argument, and project_to_rotation.
    """
    dtype, shape = result_dtype((S,)), S.shape[:-2]
    tolerance = MAX_ORTHOGONALITY_ERRORS[dtype.itemsize]
    if shape == ():
        one = _rotation_errors({"S": S.ravel().tolist()})
        if one["error"] <= tolerance and one["volume"] >= 0:
            return
        out = {name: np.asarray(value) for name, value in one.items()}
    else:
        out = tabulate(_rotation_errors, {"S": components_of(S, 2)}, {"error": (), "volume": ()}, shape, dtype)
    bad = (out["error"] > tolerance) | (out["volume"] < 0)
    if not np.any(bad):
        return
    bad &= np.isfinite(S).all(axis=(-2, -1))
    if np.any(bad):
        if np.any(bad & (out["volume"] < 0)):
            got = "a reflection (determinant below 0)"
        else:
            got = f"S^T S off the identity by {np.max(out['error'][bad]):.3g}"
        wanted = f"rotations to within {tolerance / 2:g} (project_to_rotation gives the nearest)"
        raise RotationError(name, wanted, got)


def _rotation_errors(values: Named) -> Named:
    """Return the largest absolute entry of S S^T - I as "error", and the determinant of S as "volume"."""
    *products, volume = eq.orthonormality_terms(values["S"])
    errors = list(map(abs, products))
    return {"error": max(errors) if type(volume) is float else functools.reduce(np.maximum, errors), "volume": volume}
