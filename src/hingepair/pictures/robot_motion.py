"""Motion of a robot that is given to a picture as arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, ShapeError, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.numeric.arrays import is_table, real_array
from hingepair.pictures.motion_samples import Array


class RobotMotion(NamedTuple):
    """Motion of a robot at N instants."""

    t: Array  # instants [s]; shape (N,)
    q: Array  # coordinates; shape (N, dof)
    R: Array  # position of the base [m]; shape (N, 3), or (1, 3)
    S: Array  # attitude of the base; shape (N, 3, 3), or (1, 3, 3)
    others: dict[str, Array]  # qd and tau, those that were given; shape (N, dof)


def read_robot_motion(
    robot: Mechanism,
    q: ArrayLike | None,
    t: ArrayLike | None,
    base_motion: BodyMotion | None,
    rate: float = 30.0,
    **others: ArrayLike | None,
) -> RobotMotion:
    """Return the checked arguments of a picture; N = 0 without q, `rate` instants a second without t."""
    positions = np.zeros((0, robot.dof)) if q is None else _joint_rows(robot, "q", q)
    if positions.ndim != 2 or positions.shape[1] != robot.dof or (q is not None and not len(positions)):
        raise ShapeError("q", f"shape (T, {robot.dof}) with T from 1 on", positions.shape)
    instants = np.arange(len(positions)) / rate if t is None else real_array("t", t).astype(np.float64)
    if instants.shape != positions.shape[:1]:
        raise ShapeError("t", f"shape {positions.shape[:1]}, as many instants as q has", instants.shape)
    if not np.isfinite(instants).all() or (np.diff(instants) < 0).any():
        raise ArgumentError("t", "finite instants that do not decrease", quoted(t))
    R, S = base_poses(base_motion, len(instants))
    rows = {name: _joint_rows(robot, name, value) for name, value in others.items() if value is not None}
    for name, values in rows.items():
        if values.shape != positions.shape:
            raise ShapeError(name, f"shape {positions.shape}, that of q", values.shape)
    return RobotMotion(instants, positions, R, S, rows)


def base_poses(base_motion: BodyMotion | None, count: int) -> tuple[Array, Array]:
    """Return R and S of a base at one or `count` instants, checked; None is rest at the origin."""
    if base_motion is None:
        return np.zeros((1, 3)), np.eye(3)[None]
    if not isinstance(base_motion, BodyMotion):
        raise ArgumentError("base_motion", "a BodyMotion", quoted(base_motion))
    if base_motion.S is None:
        raise ArgumentError("base_motion.S", "a value, as in BodyMotion(..., S=...)", None)
    R, S = np.asarray(base_motion.R, np.float64), np.asarray(base_motion.S, np.float64)
    shape = np.broadcast_shapes(R.shape[:-1], S.shape[:-2])
    if shape not in {(), (1,), (count or 1,)}:
        raise ShapeError("base_motion", f"one instant, or the {count} instants of q", shape)
    places = shape[0] if shape else 1
    return np.broadcast_to(R, (places, 3)), np.broadcast_to(S, (places, 3, 3))


def _joint_rows(robot: Mechanism, name: str, value: ArrayLike) -> Array:
    """Return numbers of the joints as float64; of a table the columns that have the joints' names."""
    if is_table(value):
        value = np.stack(tuple(tree_of(robot).coordinate_names.of_table(name, value).values()), axis=-1)
    return real_array(name, value).astype(np.float64)
