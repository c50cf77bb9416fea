"""The motion of a body with a known attitude, which is an input of kinematics."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.numeric.arrays import Frozen, broadcast_shape, own_copy, read_only, vectors
from hingepair.rotations.matrices import check_rotation, quaternion_to_matrix, rotation_exp

MOTION_SHAPES: Final[Mapping[str, tuple[int, ...]]] = {
    **dict.fromkeys(("R", "S", "v", "omega", "a", "alpha"), (3,)),
    "S": (3, 3),
}
"""Shape of one sample of each array of a motion."""


class MotionRates(TypedDict, total=False):
    """Velocities and accelerations of a body, as of `BodyMotion`."""

    v: ArrayLike | None
    omega: ArrayLike | None
    a: ArrayLike | None
    alpha: ArrayLike | None


@dataclass(frozen=True, slots=True, eq=False, init=False)
class BodyMotion(Frozen):
    """Position, attitude, velocities and accelerations of one body at one or many samples, in world axes.

    The arrays are copied and read-only.

    Args:
        R: position of the body's reference point [m]; shape (..., 3).
        S: rotation matrix from body axes to world axes; shape (..., 3, 3). Without S, the body is a point whose
            attitude was not measured, which `fit` takes as body 2 and what needs an attitude refuses.
        v: velocity of the reference point [m/s]; shape (..., 3).
        omega: angular velocity [rad/s]; shape (..., 3).
        a: acceleration of the reference point, the second time derivative of R [m/s^2]; shape (..., 3).
        alpha: angular acceleration [rad/s^2]; shape (..., 3).

    Attributes:
        shape: the common leading shape of the arrays; () for one sample.

    Raises:
        RotationError: an element of S S^T of a finite S is off the identity by more than 2e-9 (float32: 2e-5), or det
            S is negative.

    >>> import hingepair as hp
    >>> hp.BodyMotion(R=((0, 0, 0), (1, 0, 0)), S=((1, 0, 0), (0, 1, 0), (0, 0, 1))).shape
    (2,)
    """

    R: NDArray[Any]
    S: NDArray[Any]  # None for a point; `motion_arrays` raises an error if an attitude is needed
    v: NDArray[Any] | None
    omega: NDArray[Any] | None
    a: NDArray[Any] | None
    alpha: NDArray[Any] | None
    shape: tuple[int, ...] = field(init=False)

    def __init__(
        self,
        *,
        R: ArrayLike,
        S: ArrayLike | None = None,
        v: ArrayLike | None = None,
        omega: ArrayLike | None = None,
        a: ArrayLike | None = None,
        alpha: ArrayLike | None = None,
    ) -> None:
        array_by_name: dict[str, Any] = {"R": R, "S": S, "v": v, "omega": omega, "a": a, "alpha": alpha}
        _set_arrays(self, array_by_name, array_by_name)
        if self.S is not None:
            check_rotation("S", self.S)

    def __repr__(self) -> str:
        names = ", ".join(name for name in ("R", "S", "v", "omega", "a", "alpha") if getattr(self, name) is not None)
        return f"{type(self).__name__}(shape={self.shape}, {names})"

    @classmethod
    def at_rest(cls, R: ArrayLike = (0, 0, 0), S: ArrayLike = ((1, 0, 0), (0, 1, 0), (0, 0, 1))) -> BodyMotion:
        """Return a BodyMotion whose velocities and accelerations are 0; by default at the origin, with axes along
        those of the world.

        >>> import hingepair as hp
        >>> hp.BodyMotion.at_rest().v
        array([0., 0., 0.])
        """
        still = (0.0, 0.0, 0.0)
        return cls(R=R, S=S, v=still, omega=still, a=still, alpha=still)

    @classmethod
    def from_quaternion_xyzw(
        cls,
        *,
        R: ArrayLike,
        quat_xyzw: ArrayLike,
        **rates: Unpack[MotionRates],
    ) -> BodyMotion:
        """Return a BodyMotion whose attitude is quaternions (x, y, z, w), scalar last as in Pinocchio, SciPy and ROS,
        of any non-zero length, from body axes to world axes; shape (..., 4). S is NaN where one is not finite. The
        other arguments are those of `BodyMotion`.

        Raises:
            RotationError: a quaternion is zero.

        >>> import hingepair as hp
        >>> hp.BodyMotion.from_quaternion_xyzw(R=(0, 0, 0), quat_xyzw=(0, 0, 0, 2)).S
        array([[1., 0., 0.],
               [0., 1., 0.],
               [0., 0., 1.]])
        """
        S = quaternion_to_matrix("quat_xyzw", quat_xyzw, scalar_first=False)
        return _motion_with_attitude(S, R=R, **rates)

    @classmethod
    def from_quaternion_wxyz(
        cls,
        *,
        R: ArrayLike,
        quat_wxyz: ArrayLike,
        **rates: Unpack[MotionRates],
    ) -> BodyMotion:
        """Return a BodyMotion whose attitude is quaternions (w, x, y, z), scalar first as in MuJoCo; otherwise as
        `from_quaternion_xyzw`.

        Raises:
            RotationError: a quaternion is zero.

        >>> import hingepair as hp
        >>> hp.BodyMotion.from_quaternion_wxyz(R=(0, 0, 0), quat_wxyz=(2, 0, 0, 0)).S
        array([[1., 0., 0.],
               [0., 1., 0.],
               [0., 0., 1.]])
        """
        S = quaternion_to_matrix("quat_wxyz", quat_wxyz, scalar_first=True)
        return _motion_with_attitude(S, R=R, **rates)

    @classmethod
    def from_rotvec(
        cls,
        *,
        R: ArrayLike,
        rotvec: ArrayLike,
        **rates: Unpack[MotionRates],
    ) -> BodyMotion:
        """Return a BodyMotion whose attitude is rotation vectors, unit axis times angle [rad], shape (..., 3), that
        turn the world's axes into the body's. The other arguments are those of `BodyMotion`.

        >>> import hingepair as hp
        >>> hp.BodyMotion.from_rotvec(R=(0, 0, 0), rotvec=(0, 0, 3.141592653589793)).S.round(12) + 0.0
        array([[-1.,  0.,  0.],
               [ 0., -1.,  0.],
               [ 0.,  0.,  1.]])
        """
        return _motion_with_attitude(rotation_exp(rotvec), R=R, **rates)


def motion_of_rotations(**arrays: Any) -> BodyMotion:
    """Return a BodyMotion of the package's own arrays, which are neither copied nor checked for rotations."""
    body: BodyMotion = object.__new__(BodyMotion)
    _set_arrays(body, arrays)
    return body


def _motion_with_attitude(
    S: Any, *, R: Any, v: Any = None, omega: Any = None, a: Any = None, alpha: Any = None
) -> BodyMotion:
    """Return the BodyMotion of computed rotations S and of copies of the user's other arrays."""
    users_arrays = {"R": R, "v": v, "omega": omega, "a": a, "alpha": alpha}
    body: BodyMotion = object.__new__(BodyMotion)
    _set_arrays(body, {"S": S, **users_arrays}, users_arrays)
    return body


def _set_arrays(body: BodyMotion, arrays: Mapping[str, Any], copied: Collection[str] = ()) -> None:
    """Set the arrays of a BodyMotion, read-only, those named in `copied` as copies, and the shape that they share."""
    shapes = {}
    for name, tail in MOTION_SHAPES.items():
        value = arrays.get(name)
        array = None if value is None and name != "R" else _read_motion_array(name, value, *tail)
        if name in copied and isinstance(array, np.ndarray):
            array = own_copy(array)
        object.__setattr__(body, name, array)
        if array is not None:
            shapes[name] = array.shape[: array.ndim - len(tail)]
    object.__setattr__(body, "shape", broadcast_shape(shapes))


def _read_motion_array(name: str, value: Any, *sample_shape: int) -> Any:
    """Return an array as a read-only view."""
    try:
        return read_only(vectors(name, value, *sample_shape))
    except ShapeError as error:
        if sample_shape == (3,) and np.shape(value)[-1:] == (2,):
            raise ShapeError(name, "shape (..., 3), of what moves in the plane (x, y, 0)", error.got) from None
        raise


AT_REST: Final = BodyMotion.at_rest()
"""What None stands for where a body may rest."""


def motion_inputs(
    name: str, body: object, letters: Iterable[str] = ("R", "S", "v", "omega", "a", "alpha")
) -> dict[str, Any]:
    """Return the arrays of a BodyMotion that it has, by input name, such as S1 for S of the argument "body1"; those
    of a body at rest at the origin in place of None.

    Raises:
        ArgumentError: the body is not a BodyMotion.
    """
    if body is None:
        body = AT_REST
    if not isinstance(body, BodyMotion):
        raise ArgumentError(name, "a BodyMotion", quoted(body))
    digit = name[-1]
    return {f"{letter}{digit}": array for letter in letters if (array := getattr(body, letter)) is not None}


def motion_arrays(name: str, body: object, *letters: str) -> dict[str, NDArray[Any]]:
    """Return the arrays of a BodyMotion with these letters by input name, such as S1.

    Raises:
        ArgumentError: not a BodyMotion, or an array is missing.
    """
    if not isinstance(body, BodyMotion):
        raise ArgumentError(name, "a BodyMotion", quoted(body))
    arrays = {f"{letter}{name[-1]}": getattr(body, letter) for letter in letters}
    for letter, array in zip(letters, arrays.values(), strict=True):
        if array is None:
            raise ArgumentError(
                f"{name}.{letter}", f"a value, as in BodyMotion(..., {letter}=...): an output needs it", None
            )
    return arrays
