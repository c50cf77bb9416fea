"""Loads on a robot: efforts and HingeLoads at its joints, forces on its links and its base."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.dynamics.events import Side
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.mechanism import Mechanism
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import is_zero, one_constant
from hingepair.pair.body_motion import BodyMotion, motion_of_rotations
from hingepair.pair.hinge_load import (
    TORQUE_PARTS,
    HingeLoad,
    HingeTorque,
    call_with_arrays,
    check_callable,
    is_plain_hinge_load,
)
from hingepair.plans.arguments import CoordinateNames, Coordinates, read_coordinates
from hingepair.rollouts.tracks import Feedback

RobotLoadArgument: TypeAlias = ArrayLike | Callable[[Array, "RobotMotionAtInstants"], ArrayLike]
"""A force or a torque as users give it: constants, or a callable of (t, now)."""
EffortArgument: TypeAlias = Coordinates | Callable[[Array, "RobotMotionAtInstants"], ArrayLike] | Feedback
"""Efforts at the joints as users give them: constants, a callable of (t, now), or a Feedback."""
_ON_BASE = ("force1", "torque1")


class RobotMotionAtInstants(NamedTuple):
    """Motion of a robot at n instants. Loads and events that are callables get an object of this class as their
    argument `now`.

    Attributes:
        q: coordinates [rad, m]; shape (n, dof).
        qd: their rates; shape (n, dof).
        R1: reference point of the base, world axes [m]; shape (n, 3).
        S1: rotation of the base, base to world; shape (n, 3, 3).
        v1: velocity of R1, world axes [m/s]; shape (n, 3).
        omega1: angular velocity of the base, world axes [rad/s]; shape (n, 3).
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
        raise AttributeError(f"now has no {name!r}; known: {', '.join(self._fields)}, base_motion")


class JointAndBodyLoads(Protocol):
    """Loads on the joints and bodies of a robot, or of a pair, as the equations of motion ask for them."""

    gravity: tuple[float, ...]  # acceleration of free fall [m/s^2]
    joint_loads: tuple[HingeLoad, ...]  # of each joint, for its kinks, friction and stops
    wrenches: tuple[str, ...]  # links on which wrenches act
    callable_names: tuple[str, ...]  # loads known only at the instants at which they are called
    coordinate_names: Sequence[tuple[str, str]]  # of the coordinate and the rate of each joint, in messages
    need_motion: bool  # whether callables are given the motion of the base
    acts_on_bodies: bool  # whether any load acts on the base or on a link

    def driven_label(self, k: int) -> str:
        """Return the name of the motion of a joint in messages."""

    def now(self, motion: RobotMotionAtInstants) -> Any:
        """Return the motion as callables of users see it."""

    def efforts(self, t: Array, motion: RobotMotionAtInstants, side: Side) -> Array:
        """Return the efforts at the joints, (n, dof); `side` selects the branches of HingeLoads."""

    def on_bodies(self, t: Array, motion: RobotMotionAtInstants) -> tuple[Array, Array]:
        """Return force1 and torque1 as (n, 6), and the wrenches on links as (n, links, 6)."""

    def callables_at(self, t: Array, motion: RobotMotionAtInstants, side: Side) -> dict[str, Array]:
        """Return the loads that are callables, by name."""

    def all_at(
        self, t: Array, motion: RobotMotionAtInstants, side: Side, holding: Array, driven: tuple[int, ...]
    ) -> dict[str, Array]:
        """Return all loads but gravity by name. `holding` are the efforts that hold joints or drive those in
        `driven`, (n, dof).
        """

    def parts_of(self, loads: Mapping[str, Array]) -> dict[str, Array]:
        """Return the parts of the efforts out of the result of `all_at`, (n, dof) each."""

    def wrench_names(self, link: str) -> tuple[str, str]:
        """Return the names of the force and the torque on a link in the result of `all_at`."""


def wrenches_of(loads: JointAndBodyLoads, acting: Mapping[str, Array]) -> dict[str, tuple[Array, Array]]:
    """Return the wrenches by link out of the result of `all_at`."""
    names = {link: loads.wrench_names(link) for link in loads.wrenches}
    return {link: (acting[force], acting[torque]) for link, (force, torque) in names.items()}


class RobotLoads:
    """Checked loads on a robot.

    Args:
        robot: the robot.
        tau: efforts of the joints: constants, a callable of (t, now), or a Feedback.
        loads: HingeLoads by joint; None: none.
        wrenches: (force, torque) by link, each a constant or a callable of (t, now); None: none.
        on_base: force1 and torque1.
        gravity: acceleration of free fall [m/s^2].

    Raises:
        ArgumentError: a load cannot be used; the error names it.
    """

    def __init__(
        self,
        robot: Mechanism,
        tau: EffortArgument,
        loads: Mapping[str, HingeTorque] | None,
        wrenches: Mapping[str, tuple[Any, Any]] | None,
        on_base: Mapping[str, Any],
        gravity: ArrayLike,
    ) -> None:
        self.gravity: tuple[float, ...] = tuple(one_constant("gravity", gravity, 3).tolist())
        self._names, self._dof = robot.names, robot.dof
        self.coordinate_names: Sequence[tuple[str, str]] = [(name, f"{name}'") for name in robot.names]
        self.joint_loads, self._loaded = _loads_by_joint(robot, loads)
        self._tau, self._tau_callable = self._read_tau(tau)
        self._vectors: dict[str, Any] = {}  # forces and torques by name, constants or callables
        if wrenches is not None and not isinstance(wrenches, Mapping):
            raise ArgumentError("wrenches", "(force, torque) by the link's name", quoted(wrenches))
        self.wrenches = tuple(wrenches or ())
        """Names of the links on which wrenches act."""
        for link, pair in (wrenches or {}).items():
            if link not in robot.links:
                raise ArgumentError("wrenches", choices(robot.links) + nearest(str(link), robot.links), quoted(link))
            if not isinstance(pair, tuple | list) or len(pair) != 2:
                raise ArgumentError(f"wrenches[{link!r}]", "a pair (force, torque)", quoted(pair))
        given = dict(on_base) | {
            f"wrenches[{link!r}][{i}]": part for link, pair in (wrenches or {}).items() for i, part in enumerate(pair)
        }
        for name, value in given.items():
            if callable(value):
                check_callable(name, value, "t", "now")
                self._vectors[name] = value
            else:
                self._vectors[name] = np.zeros(3) if is_zero(value) else one_constant(name, value, 3)
        self._acts_on_base = any(callable(load) or np.any(load) for load in (self._vectors[one] for one in _ON_BASE))
        self.acts_on_bodies = self._acts_on_base or bool(self.wrenches)
        self.need_motion = any(callable(load) for load in (self._tau_callable, *self._vectors.values()))
        callables = [name for name, load in self._vectors.items() if callable(load)]
        motors = [f"loads[{self._names[k]!r}]" for k in self._loaded if has_callable(self.joint_loads[k])]
        self.callable_names = (*["tau"] * (self._tau_callable is not None), *callables, *motors)
        """Names of the loads that are callables, known only at the instants at which they are called."""

    def now(self, motion: RobotMotionAtInstants) -> RobotMotionAtInstants:
        """Return the motion as callables of users see it."""
        return motion

    def efforts(self, t: Array, motion: RobotMotionAtInstants, side: Side) -> Array:
        """Return the efforts at the joints, (n, dof); `side` selects the branches of HingeLoads."""
        efforts = self._motors(t, motion).copy()
        angles, rates = side
        for k in self._loaded:
            branch = angles[..., k], rates[..., k]
            value = self.joint_loads[k].smooth(branch, t, motion.q[:, k], motion.qd[:, k])
            efforts[:, k] += broadcast_load(f"loads[{self._names[k]!r}]", value, t.shape)
        return efforts

    def on_bodies(self, t: Array, motion: RobotMotionAtInstants) -> tuple[Array, Array]:
        """Return force1 and torque1 as (n, 6), and the wrenches on links as (n, links, 6)."""
        n, values = len(t), self._vectors_at(t, motion)
        base = np.concatenate([values[name] for name in _ON_BASE], axis=1) if self._acts_on_base else np.zeros((n, 6))
        if not self.wrenches:
            return base, np.zeros((n, 0, 6))
        parts = [values[f"wrenches[{link!r}][{i}]"] for link in self.wrenches for i in (0, 1)]
        return base, np.stack(parts, axis=1).reshape(n, -1, 6)

    def callables_at(self, t: Array, motion: RobotMotionAtInstants, side: Side) -> dict[str, Array]:
        """Return the loads that are callables, by name."""
        found = {} if self._tau_callable is None else {"tau": self._motors(t, motion)}
        efforts = self.efforts(t, motion, side)
        for name in self.callable_names:
            if name.startswith("loads["):
                k = next(k for k in self._loaded if name == f"loads[{self._names[k]!r}]")
                found[name] = efforts[:, k]
        values = self._vectors_at(t, motion)
        return found | {name: value for name, value in values.items() if callable(self._vectors[name])}

    def driven_label(self, k: int) -> str:
        """Return the name of the motion of a joint in messages."""
        return f"driven[{self._names[k]!r}]"

    def all_at(
        self, t: Array, motion: RobotMotionAtInstants, side: Side, holding: Array, driven: tuple[int, ...]
    ) -> dict[str, Array]:
        """Return all loads but gravity by name: "tau", the sum at each joint, and its parts, such as "motor",
        (n, dof); force1, torque1 and the wrenches, (n, 3). `holding` are the efforts that hold joints or drive those
        in `driven`, (n, dof).
        """
        n, (angles, rates) = len(t), side
        parts: dict[str, Array] = {"motor": self._motors(t, motion).copy()}
        for k in self._loaded:
            load, name = self.joint_loads[k], f"loads[{self._names[k]!r}]"
            q, qd = motion.q[:, k], motion.qd[:, k]
            for part, value in load.parts(t, q, qd, (angles[..., k], rates[..., k])).items():
                parts.setdefault(part, np.zeros((n, self._dof)))[:, k] += broadcast_load(name, value, t.shape)
        parts["motor"][:, driven] += holding[:, driven]
        holding = holding.copy()
        holding[:, driven] = 0.0
        if holding.any():
            friction = np.array([load.sticking_friction for load in self.joint_loads])
            sticking = np.clip(holding, -friction, friction)
            for part, value in (("friction", sticking), ("stop", holding - sticking)):
                if part in parts:
                    parts[part] = parts[part] + value
        parts = {name: parts[name] for name in TORQUE_PARTS if name in parts}
        total = sum(parts.values(), np.zeros((n, self._dof)))
        values = self._vectors_at(t, motion)
        on_links = {
            name: values[f"wrenches[{link!r}][{i}]"]
            for link in self.wrenches
            for i, name in enumerate(self.wrench_names(link))
        }
        return {"tau": total, **parts, **{name: values[name] for name in _ON_BASE}, **on_links}

    def parts_of(self, loads: Mapping[str, Array]) -> dict[str, Array]:
        """Return the parts of the efforts out of the result of `all_at`."""
        return {name: loads[name] for name in TORQUE_PARTS if name in loads}

    def wrench_names(self, link: str) -> tuple[str, str]:
        """Return the names of the force and the torque on a link in the result of `all_at`."""
        return f"force_{link}", f"torque_{link}"

    def _motors(self, t: Array, motion: RobotMotionAtInstants) -> Array:
        shape = (len(t), self._dof)
        if self._tau_callable is None:
            return np.broadcast_to(self._tau, shape)
        return broadcast_load("tau", call_with_arrays("tau", self._tau_callable, t, motion), shape)

    def _vectors_at(self, t: Array, motion: RobotMotionAtInstants) -> dict[str, Array]:
        shape = (len(t), 3)
        return {
            name: broadcast_load(name, call_with_arrays(name, load, t, motion), shape)
            if callable(load)
            else np.broadcast_to(load, shape)
            for name, load in self._vectors.items()
        }

    def _read_tau(self, tau: Any) -> tuple[Array, Any]:
        """Return constant efforts, (dof,), and a callable of (t, now) or None."""
        zero = np.zeros(self._dof)
        if isinstance(tau, Feedback):
            return zero, _feedback(tau, self._dof)
        if callable(tau):
            check_callable("tau", tau, "t", "now")
            return zero, tau
        if is_zero(tau):
            return zero, None
        value, shape = read_coordinates("tau", tau, CoordinateNames(self._names, noun="joints"))
        if shape:
            raise ArgumentError(
                "tau", f"{self._dof} efforts, a callable of (t, now), or a Feedback", f"shape {shape}"
            )
        return np.asarray(np.stack(value) if isinstance(value, tuple) else value, np.float64), None


def broadcast_load(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Return the result of a callable load in its shape.

    Raises:
        ArgumentError: it has another shape; the error names the load.
    """
    try:
        if value is None:  # NumPy reads it as NaN
            raise TypeError
        return np.broadcast_to(np.asarray(value, dtype=np.float64), shape)
    except (TypeError, ValueError):
        expected = f"a callable that returns shape {shape}, or what broadcasts to it"
        raise ArgumentError(name, expected, value) from None


def _loads_by_joint(robot: Mechanism, loads: Any) -> tuple[tuple[HingeLoad, ...], list[int]]:
    """Return a HingeLoad for each joint, and the numbers of those joints to which one was given."""
    if loads is not None and not isinstance(loads, Mapping):
        raise ArgumentError("loads", "HingeLoads by the joint's name", quoted(loads))
    for name, load in (loads or {}).items():
        if name not in robot.names:
            raise ArgumentError("loads", choices(robot.names) + nearest(str(name), robot.names), quoted(name))
        if not is_plain_hinge_load(load):
            raise ArgumentError(f"loads[{name!r}]", "a HingeLoad", quoted(load))
        lower, upper = load.rigid_range
        if not upper - lower > 1e-9:  # impacts closer together could not be told apart
            expected = "rigid stops at least 1e-9 rad or m apart"
            raise ArgumentError(f"loads[{name!r}]", expected, f"{lower!r} to {upper!r}")
    of_joints: Any = [(loads or {}).get(name, HingeLoad()) for name in robot.names]
    return tuple(of_joints), [k for k, name in enumerate(robot.names) if name in (loads or {})]


def has_callable(torque: Any) -> bool:
    """Return whether a torque is a callable other than a HingeLoad, or has one as its motor."""
    return has_callable(torque.motor) if is_plain_hinge_load(torque) else callable(torque)


def _feedback(control: Feedback, dof: int) -> Callable[[Array, RobotMotionAtInstants], Array]:
    """Return a Feedback with constant references as a callable of (t, now)."""
    for name in ("q_ref", "qd_ref", "tau_ff"):
        if getattr(control, name).ndim > 1:
            raise ArgumentError(
                f"tau.{name}", f"shape ({dof},), held; a callable of (t, now) varies", "an axis of steps"
            )
    gains = []
    for name in ("K", "D"):
        gain = getattr(control, name)
        if gain.ndim > 2:
            raise ArgumentError(f"tau.{name}", f"shape ({dof},) or ({dof}, {dof})", "an axis of steps")
        gains.append(gain if gain.ndim == 2 else np.diag(np.broadcast_to(gain, (dof,))))
    K, D = gains

    def tau(_: Array, now: RobotMotionAtInstants) -> Array:
        efforts: Array = control.tau_ff + (control.q_ref - now.q) @ K.T + (control.qd_ref - now.qd) @ D.T
        return efforts

    return tau
