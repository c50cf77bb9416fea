"""Loads on a robot, or on a pair as on a robot of one joint: constants, and functions of time and motion."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from hingepair.errors import ArgumentError, ShapeError
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_of_rotations
from hingepair.mechanism.bodies.hinge_load import (
    TORQUE_PARTS,
    HingeLoad,
    call_with_arrays,
    check_callable,
    is_plain_hinge_load,
    stop_range,
)
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import is_zero, one_constant

Side: TypeAlias = tuple[Array, Array]
"""Coordinates and rates, (..., joints) each, that select one smooth branch of the load of each joint."""
ON_BASE = ("force1", "torque1")
"""Names of the force and the torque on the base in results."""


class MotionAtInstants(NamedTuple):
    """Motion of a pair or a robot at n instants. Loads and events that are callables get an object of this class as
    their argument `now`.

    Attributes:
        q: coordinates [rad, m]; shape (n, dof).
        qd: their rates; shape (n, dof).
        R1: reference point of body 1, or of the base, world axes [m]; shape (n, 3).
        S1: rotation of body 1, or of the base, body to world; shape (n, 3, 3).
        v1: velocity of R1, world axes [m/s]; shape (n, 3).
        omega1: angular velocity of body 1, or of the base, world axes [rad/s]; shape (n, 3).
    """

    q: Array
    qd: Array
    R1: Array
    S1: Array
    v1: Array
    omega1: Array

    @property
    def base_motion(self) -> BodyMotion:
        """Motion of the base, for the argument of this name of the robot's methods."""
        return motion_of_rotations(R=self.R1, S=self.S1, v=self.v1, omega=self.omega1)

    def __getattr__(self, name: str) -> Any:
        """Return psi or psid of a pair, (n,)."""
        known: tuple[str, ...] = (*self._fields, "base_motion")
        if self.q.shape[-1] == 1:
            if name in _OF_PAIR:
                return self[_OF_PAIR.index(name)][..., 0]
            known = (*_OF_PAIR, *known)
        raise AttributeError(f"now has no {name!r}; known: {', '.join(known)}")


_OF_PAIR = ("psi", "psid")  # names of the columns of q and qd where there is one joint


class GivenLoad:
    """A force, a torque, or the efforts at all joints, as given: `size` constants, or a callable of (t, now)."""

    def __init__(self, label: str, value: Any, size: int = 3) -> None:
        self.label, self.size = label, size
        if callable(value):
            check_callable(label, value, "t", "now")
        self.value: Any = value if callable(value) else np.zeros(size)
        if not callable(value) and not is_zero(value):
            self.value = one_constant(label, value, size)

    @property
    def acts(self) -> bool:
        """Whether it may be other than zero."""
        return callable(self.value) or bool(np.any(self.value))

    def at(self, t: Array, now: Any) -> Array:
        """Return the load at n instants, (n, size)."""
        if not callable(self.value):
            return np.broadcast_to(self.value, (len(t), self.size))
        values = call_with_arrays(self.label, self.value, t, now)
        if np.ndim(values) < 2 and values is not None:
            example = "-50 * now.q, where now.q[:, 1] is joint 2" if self.label == "tau" else "-20 * now.v1"
            expected = f"shape (n, {self.size}), a row for each of the n instants, such as {example}"
            raise ShapeError(self.label, expected, f"shape {np.shape(values)}, of one instant")
        return broadcast_load(self.label, values, (len(t), self.size))


@dataclass(frozen=True, eq=False)
class Loads:
    """Checked loads on the joints and bodies of a robot."""

    #: acceleration of free fall [m/s^2]
    gravity: tuple[float, ...]
    #: efforts at all joints, to which those of HingeLoads are added
    efforts: GivenLoad
    #: HingeLoad of each joint with a coordinate, by its name
    joint_loads: Mapping[str, HingeLoad]
    #: forces and torques by their names in results, among them those on the base
    vectors: Mapping[str, GivenLoad]
    #: names of the force and the torque on each link on which a wrench acts
    wrenches: Mapping[str, tuple[str, str]]

    @functools.cached_property
    def acts_on_bodies(self) -> bool:
        """Whether any load acts on the base or on a link."""
        return bool(self.wrenches) or any(self.vectors[name].acts for name in ON_BASE)

    @functools.cached_property
    def callables(self) -> tuple[GivenLoad, ...]:
        """Loads that are callables of (t, now), which are given the motion of the base."""
        return tuple(load for load in (self.efforts, *self.vectors.values()) if callable(load.value))

    @functools.cached_property
    def has_callables(self) -> bool:
        """Whether loads are known only at the instants at which they are called."""
        return bool(self.callables or self._callable_motors)

    @functools.cached_property
    def _callable_motors(self) -> dict[int, str]:
        return {k: name for k, name, load in self._acting if has_callable(load)}

    @functools.cached_property
    def _acting(self) -> tuple[tuple[int, str, HingeLoad], ...]:
        """Number of each joint with a HingeLoad that exerts something, the load's name in messages, and the load."""
        rows = [(k, f"loads[{name!r}]", load) for k, (name, load) in enumerate(self.joint_loads.items())]
        return tuple(row for row in rows if row[2] != HingeLoad())

    def efforts_at(self, t: Array, motion: MotionAtInstants, side: Side) -> Array:
        """Return the efforts at the joints, (n, dof); `side` selects the branches of HingeLoads."""
        motor, *others = self._parts_at(t, motion, side).values()
        return sum(others, motor)

    def _parts_at(self, t: Array, motion: MotionAtInstants, side: Side) -> dict[str, Array]:
        """Return the parts of the efforts by name, the first "motor", (n, dof) each."""
        parts, (angles, rates) = {"motor": self.efforts.at(t, motion).copy()}, side
        for k, label, load in self._acting:
            of_joint = load.parts(t, motion.q[:, k], motion.qd[:, k], (angles[..., k], rates[..., k]))
            for part, value in of_joint.items():
                parts.setdefault(part, np.zeros(motion.q.shape))
                parts[part][:, k] += broadcast_load(label, value, t.shape)
        return parts

    def on_bodies(self, t: Array, motion: MotionAtInstants) -> Array:
        """Return force1, torque1, and the force and the torque on each link, (n, 2 + 2 links, 3)."""
        return np.stack([*self._vectors_at(t, motion).values()], axis=1)

    def callables_at(self, t: Array, motion: MotionAtInstants, side: Side) -> dict[str, Array]:
        """Return the loads that are callables, by their names in messages."""
        efforts = self.efforts_at(t, motion, side)
        given = {load.label: load.at(t, motion) for load in self.callables}
        return given | {label: efforts[:, k] for k, label in self._callable_motors.items()}

    def all_at(
        self, t: Array, motion: MotionAtInstants, side: Side, holding: Array, driven: tuple[int, ...]
    ) -> dict[str, Array]:
        """Return all loads but gravity by name: "tau", the sum at each joint, and its parts, such as "spring", (n,
        dof); forces and torques, (n, 3). `holding` are the efforts that hold joints or drive those in `driven`, (n,
        dof).
        """
        parts, held = self._parts_at(t, motion, side), holding.copy()
        parts["motor"][:, driven] += holding[:, driven]
        held[:, driven] = 0.0
        friction = np.array([load.sticking_friction for load in self.joint_loads.values()])
        sticking = np.clip(held, -friction, friction)
        for part, value in (("friction", sticking), ("stop", held - sticking)):
            if part in parts:
                parts[part] = parts[part] + value
        named: dict[str, Array] = {name: parts[name] for name in TORQUE_PARTS if name in parts}
        return {"tau": sum(parts.values(), np.zeros(held.shape)), **named, **self._vectors_at(t, motion)}

    def wrenches_of(self, loads: Mapping[str, Array]) -> dict[str, tuple[Array, Array]]:
        """Return the wrenches by link out of the result of `all_at`."""
        return {link: (loads[force], loads[torque]) for link, (force, torque) in self.wrenches.items()}

    def _vectors_at(self, t: Array, motion: MotionAtInstants) -> dict[str, Array]:
        return {name: load.at(t, motion) for name, load in self.vectors.items()}


def broadcast_load(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return what a callable load has returned, broadcast to `shape`.

    Raises:
        ArgumentError: it has another shape; the error names the load.
    """
    try:
        if value is None:  # NumPy reads it as NaN
            raise TypeError
        return np.broadcast_to(np.asarray(value, dtype=np.float64), shape)
    except (TypeError, ValueError):
        expected = f"a callable that returns shape {shape}, the instants first, or one value for all of them"
        raise ArgumentError(name, expected, value) from None


def check_start(loads: Loads, q: Array) -> None:
    """Refuse coordinates at the first instant, (dof,), that are not between the rigid stops."""
    for (name, load), x in zip(loads.joint_loads.items(), q, strict=True):
        lower, upper = stop_range(load, rigid=True)
        if not lower <= x <= upper:
            raise ArgumentError(
                f"q0[{name!r}]", f"a coordinate between the rigid stops, {lower:g} to {upper:g}", float(x)
            )


def has_callable(torque: Any) -> bool:
    """Return whether a torque is a callable other than a HingeLoad, or has one as its motor."""
    return has_callable(torque.motor) if is_plain_hinge_load(torque) else callable(torque)
