"""Functions for all models of Pinocchio: import, coordinates of a free-flyer, and the motion of a frame."""

from __future__ import annotations

from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, MissingDependencyError
from hingepair.numeric.arrays import Float64Array
from hingepair.pair.body_motion import BodyMotion
from hingepair.rotations.matrices import matrix_to_quaternion


def import_pinocchio(caller_name: str) -> Any:
    """Import the module pinocchio, and return it."""
    try:
        import pinocchio
    except ImportError as error:
        raise MissingDependencyError(caller_name, "Pinocchio (pip install 'pin>=4.1,<5')", str(error)) from None
    if not hasattr(pinocchio, "JointModelFreeFlyer"):
        got = f"another package named pinocchio at {pinocchio.__file__}"
        raise MissingDependencyError(caller_name, "Pinocchio (pip install 'pin>=4.1,<5')", got)
    return pinocchio


def pinocchio_configuration(body1: BodyMotion) -> dict[str, Float64Array]:
    """Return the pose of body 1 in the form of Pinocchio's free-flyer, as a dict with two keys: "R", the position
    [m], shape (..., 3), and "S", the attitude as a quaternion (x, y, z, w), shape (..., 4).
    """
    quat_wxyz = matrix_to_quaternion(_required_array(body1, "S"))
    return {"R": _required_array(body1, "R"), "S": np.roll(quat_wxyz, -1, axis=-1)}


def pinocchio_velocity(body1: BodyMotion) -> dict[str, Float64Array]:
    """Return the velocity of body 1 in the form of Pinocchio's free-flyer, as a dict with two keys: "v" [m/s] and
    "omega" [rad/s], both in body axes, shape (..., 3).
    """
    S, v, omega = (_required_array(body1, name) for name in ("S", "v", "omega"))
    return {"v": to_body(S, v), "omega": to_body(S, omega)}


def pinocchio_acceleration(body1: BodyMotion) -> dict[str, Float64Array]:
    """Return the spatial acceleration of body 1 in the form of Pinocchio's free-flyer, as a dict with two keys: "a"
    [m/s^2] and "alpha" [rad/s^2], both in body axes, shape (..., 3).

    Returns:
        a [m/s^2] and alpha [rad/s^2]; shape (..., 3) each.
    """
    S, v, omega, a, alpha = (_required_array(body1, name) for name in ("S", "v", "omega", "a", "alpha"))
    with np.errstate(over="ignore", invalid="ignore"):
        spatial = to_body(S, a - np.cross(omega, v))
    return {"a": spatial, "alpha": to_body(S, alpha)}


def _required_array(body1: BodyMotion, name: str) -> Float64Array:
    """Return the attribute called `name` of the motion of body 1 as a float64 array."""
    value = getattr(body1, name)
    if value is None:
        raise ArgumentError("body1", f"a motion with {name}", "one without")
    return np.asarray(value, dtype=np.float64)


def to_body(S: Float64Array, vector: Float64Array) -> Float64Array:
    """Convert vectors in world axes to body axes by the transpose of the rotation matrices S, shape (..., 3, 3);
    return an array of shape (..., 3).
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray((S * vector[..., None]).sum(axis=-2))


def to_world(S: Float64Array, vector: Float64Array) -> Float64Array:
    """Convert vectors in body axes to world axes by the rotation matrices S, shape (..., 3, 3); return an array of
    shape (..., 3).
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray((S * vector[..., None, :]).sum(axis=-1))


def frame_motion(model: Any, data: Any, frame: int, coordinates: list[Float64Array]) -> dict[str, Float64Array]:
    """Compute the motion of the frame with index `frame` by Pinocchio's model at `coordinates`, a list of q, of q and
    v, or of q, v and a. Return a dict of arrays (N, ...) with the keys R and S, also v and omega if v is given, and a
    and alpha if a is given. Vectors are in world axes, and accelerations are classical.

    Args:
        model: Pinocchio's model.
        data: Pinocchio's `Data` of the model, in which its algorithms store results.
        frame: index of the frame.
        coordinates: Pinocchio's q, or q and v, or q, v and a; shape (N, ...) each.
    """
    pin = import_pinocchio("body2")
    names = ("R", "S", "v", "omega", "a", "alpha")[: 2 * len(coordinates)]
    arrays = [np.empty((len(coordinates[0]), 3, *(3,) * (name == "S"))) for name in names]
    for i, sample in enumerate(zip(*coordinates, strict=True)):
        pin.forwardKinematics(model, data, *sample)
        placement = pin.updateFramePlacement(model, data, frame)
        arrays[0][i], arrays[1][i] = placement.translation, placement.rotation
        if len(sample) > 1:
            twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            arrays[2][i], arrays[3][i] = twist.linear, twist.angular
        if len(sample) > 2:
            classical = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            arrays[4][i], arrays[5][i] = classical.linear, classical.angular
    return dict(zip(names, arrays, strict=True))
