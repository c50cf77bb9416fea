"""Loads on a pair: constants, and functions of time and motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.dynamics.events import Side
from hingepair.dynamics.robot_loads import RobotMotionAtInstants, broadcast_load, has_callable
from hingepair.errors import ArgumentError
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number, is_zero, one_constant
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_load import (
    TORQUE_PARTS,
    HingeLoad,
    HingeTorque,
    call_with_arrays,
    check_callable,
    is_plain_hinge_load,
)

BODY2 = "body2"
"""Name of body 2 in the robot of one joint."""
LoadArgument: TypeAlias = ArrayLike | Callable[[Array, "MotionAtInstants"], ArrayLike]
"""A force or torque on a body as users give it: a constant, or a callable of (t, now)."""
BaseArgument: TypeAlias = str | Callable[[Array], BodyMotion]
"""What holds body 1, as users give it: the name of a base, or a callable of t that returns the motion of body 1."""


class MotionAtInstants(NamedTuple):
    """Pose R1, S1 and velocities v1, omega1 of body 1, and hinge angle psi and rate psid, arrays at n instants. Loads
    and events that are callables get an object of this class as their argument `now`.

    Attributes:
        R1: reference point of body 1, world axes [m]; shape (n, 3).
        S1: rotation of body 1, body to world; shape (n, 3, 3).
        v1: velocity of R1, world axes [m/s]; shape (n, 3).
        omega1: angular velocity of body 1, world axes [rad/s]; shape (n, 3).
        psi: hinge angle [rad]; shape (n,).
        psid: hinge rate [rad/s]; shape (n,).
    """

    R1: Array
    S1: Array
    v1: Array
    omega1: Array
    psi: Array
    psid: Array

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"now has no {name!r}; known: {', '.join(self._fields)}")


class PairLoads:
    """Checked loads on a pair, constants and callables, as the loads on a robot of one joint.

    Args:
        forces: force1, torque1, force2 and torque2: constants, the number 0, or callables of (t, now).
        hinge_torque: torque at the hinge [N m]: a number, a HingeLoad, or a callable of (t, psi, psid).
        gravity: acceleration of free fall [m/s^2].
        is_planar: whether the pair is planar: forces and gravity have two components then, and torques one.

    Raises:
        ArgumentError: a constant is not finite or of the wrong shape, or a callable takes other arguments.
    """

    coordinate_names: Sequence[tuple[str, str]] = (("psi", "psi'"),)

    def __init__(
        self,
        forces: Mapping[str, LoadArgument],
        hinge_torque: HingeTorque,
        gravity: ArrayLike,
        *,
        is_planar: bool,
    ) -> None:
        self._is_planar = is_planar
        self._loads: dict[str, Any] = {}  # by name
        for name, load in forces.items():
            if callable(load):
                check_callable(name, load, "t", "now")
            self._loads[name] = load if callable(load) else np.array(self._checked_constant(name, load))
        self.gravity = self._checked_constant("gravity", gravity)
        on_body2 = [self._loads[name] for name in ("force2", "torque2")]
        acts = any(callable(load) or load.any() for load in on_body2)
        self.wrenches: tuple[str, ...] = (BODY2,) if acts else ()
        self.acts_on_bodies = any(callable(load) or load.any() for load in self._loads.values())
        self.need_motion = any(callable(load) for load in self._loads.values())
        self._torque = hinge_torque if callable(hinge_torque) else finite_number("hinge_torque", hinge_torque)
        if callable(hinge_torque):
            check_callable("hinge_torque", hinge_torque, "t", "psi", "psid")
        self._is_hinge_load = is_plain_hinge_load(hinge_torque)
        hinge_load = hinge_torque if is_plain_hinge_load(hinge_torque) else HingeLoad()
        self.joint_loads: tuple[HingeLoad, ...] = (hinge_load,)
        lower, upper = hinge_load.rigid_range
        if not upper - lower > 1e-9:  # rad; impacts closer together could not be told apart
            expected = "rigid stops at least 1e-9 rad apart (hinge= holds an angle)"
            raise ArgumentError("hinge_torque", expected, f"{lower!r} to {upper!r} rad")
        callables = [name for name, load in self._loads.items() if callable(load)]
        self.callable_names: tuple[str, ...] = (*callables, *["hinge_torque"] * has_callable(hinge_torque))
        """Names of the loads that are callables, known only at the instants at which they are called."""

    def driven_label(self, _: int) -> str:
        """Return the name of the motion of the hinge in messages."""
        return "hinge"

    def now(self, motion: RobotMotionAtInstants) -> MotionAtInstants:
        """Return the motion as callables of users see it."""
        q, qd, R1, S1, v1, omega1 = motion
        return MotionAtInstants(R1, S1, v1, omega1, q[:, 0], qd[:, 0])

    def efforts(self, t: Array, motion: RobotMotionAtInstants, side: Side) -> Array:
        """Return the torque at the hinge, (n, 1); `side` selects the branch of a HingeLoad."""
        psi, psid, torque = motion.q[:, 0], motion.qd[:, 0], self._torque
        if self._is_hinge_load:
            torque = self.joint_loads[0].smooth((side[0][..., 0], side[1][..., 0]), t, psi, psid)
        elif callable(torque):
            torque = call_with_arrays("hinge_torque", torque, t, psi, psid)
        return broadcast_load("hinge_torque", torque, t.shape)[:, None]

    def on_bodies(self, t: Array, motion: RobotMotionAtInstants) -> tuple[Array, Array]:
        """Return force1 and torque1 as (n, 6), and force2 and torque2 as (n, 1, 6); (n, 0, 6) of none."""
        loads = self._bodies_at(t, motion)
        base, body2 = (np.concatenate([loads[f"force{k}"], loads[f"torque{k}"]], axis=1) for k in (1, 2))
        return base, body2[:, None, :] if self.wrenches else np.zeros((len(t), 0, 6))

    def callables_at(self, t: Array, motion: RobotMotionAtInstants, side: Side) -> dict[str, Array]:
        """Return the loads that are callables, by name."""
        loads = self._bodies_at(t, motion) | {"hinge_torque": self.efforts(t, motion, side)[:, 0]}
        return {name: loads[name] for name in self.callable_names if name in loads}

    def all_at(
        self, t: Array, motion: RobotMotionAtInstants, side: Side, holding: Array, driven: tuple[int, ...]
    ) -> dict[str, Array]:
        """Return all loads but gravity by name, and the parts of a HingeLoad, such as motor_torque. `holding` are the
        torques that hold or drive the hinge, (n, 1).
        """
        psi, psid, held = motion.q[:, 0], motion.qd[:, 0], holding[:, 0]
        loads = self._bodies_at(t, motion) | {"hinge_torque": self.efforts(t, motion, side)[:, 0] + held}
        if self._is_hinge_load:
            branch = side[0][..., 0], side[1][..., 0]
            for part, torque in self.joint_loads[0].parts(t, psi, psid, branch).items():
                loads[f"{part}_torque"] = broadcast_load("hinge_torque", torque, t.shape)
            friction = self.joint_loads[0].sticking_friction
            sticking = np.clip(held, -friction, friction)
            additions = {"motor": held} if driven else {"friction": sticking, "stop": held - sticking}
            for part, torque in additions.items():
                if f"{part}_torque" in loads:
                    loads[f"{part}_torque"] = loads[f"{part}_torque"] + torque
        return loads

    def parts_of(self, loads: Mapping[str, Array]) -> dict[str, Array]:
        """Return the parts of the torque at the hinge out of the result of `all_at`, (n, 1) each."""
        parts = {name: loads[f"{name}_torque"] for name in TORQUE_PARTS if f"{name}_torque" in loads}
        return {name: part[:, None] for name, part in (parts or {"hinge_torque": loads["hinge_torque"]}).items()}

    def wrench_names(self, _: str) -> tuple[str, str]:
        """Return the names of the force and the torque on body 2 in the result of `all_at`."""
        return "force2", "torque2"

    def _bodies_at(self, t: Array, motion: RobotMotionAtInstants) -> dict[str, Array]:
        found = {}
        for name, load in self._loads.items():
            if not callable(load):
                found[name] = np.broadcast_to(load, (len(t), 3))
                continue
            tail = self._load_shape(name)
            value = broadcast_load(name, call_with_arrays(name, load, t, self.now(motion)), (len(t), *tail))
            found[name] = _to_space(value, len(tail)) if self._is_planar else value
        return found

    def _load_shape(self, name: str) -> tuple[int, ...]:
        """Return the shape of one value of a load as users give it."""
        if not self._is_planar:
            return (3,)
        return () if name.startswith("torque") else (2,)

    def _checked_constant(self, name: str, load: Any) -> tuple[float, ...]:
        """Return a constant force, torque or gravity as three components in space."""
        tail = self._load_shape(name)
        if is_zero(load):
            return (0.0, 0.0, 0.0)
        value = one_constant(name, load, *tail) if tail else np.array(finite_number(name, load))
        return tuple((_to_space(value, len(tail)) if self._is_planar else value).tolist())


def _to_space(value: Array, rank: int) -> Array:
    """Return values for planar pairs as vectors in space: vectors in the plane (rank 1), or torques (rank 0)."""
    columns = [value[..., 0], value[..., 1], 0 * value[..., 0]] if rank else [0 * value, 0 * value, value]
    return np.stack(columns, axis=-1)
