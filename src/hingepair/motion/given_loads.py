"""Loads on robots as `simulate` and `linearize` are given them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, ShapeError, choices, nearest, quoted
from hingepair.mechanism.bodies.hinge_load import (
    HingeLoad,
    HingeTorque,
    call_with_arrays,
    check_callable,
    is_plain_hinge_load,
    stop_range,
)
from hingepair.mechanism.computations import read_wrenches
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.tree import Mimic
from hingepair.motion.linkages import efforts_of_followers, with_strut_loads
from hingepair.motion.loads import GivenLoad, Loads, MotionAtInstants, broadcast_load
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number, is_zero, one_constant
from hingepair.plans.arguments import Coordinates
from hingepair.rollouts.tracks import Feedback

LoadArgument: TypeAlias = ArrayLike | Callable[[Array, MotionAtInstants], ArrayLike]
"""A force or a torque as users give it: constants, or a callable of (t, now)."""
EffortArgument: TypeAlias = Coordinates | Callable[[Array, MotionAtInstants], ArrayLike] | Feedback
"""Efforts at the joints as users give them: constants, a callable of (t, now), or a Feedback."""


def robot_loads(
    robot: Mechanism,
    tau: EffortArgument,
    loads: Mapping[str, HingeTorque] | None,
    wrenches: Mapping[str, tuple[Any, Any]] | None,
    on_base: Mapping[str, Any],
    gravity: ArrayLike,
) -> Loads:
    """Return the checked loads on a robot.

    Args:
        robot: the robot.
        tau: efforts of the joints: constants, a callable of (t, now), or a Feedback.
        loads: HingeLoads, numbers or callables of (t, q, qd) by joint; None: none.
        wrenches: (force, torque) by link, each a constant or a callable of (t, now); None: none.
        on_base: force1 and torque1.
        gravity: acceleration of free fall [m/s^2].

    Raises:
        ArgumentError: a load cannot be used; the error names it.
    """
    fall = tuple(one_constant("gravity", gravity, 3).tolist())
    wrenches = with_strut_loads(robot, wrenches)
    on_links, links = read_wrenches(wrenches, tree_of(robot))
    named = {name: (load, name) for name, load in on_base.items()}
    wrench_names = {link: (f"force_{link}", f"torque_{link}") for link in links}
    named |= zip((name for both in wrench_names.values() for name in both), on_links.values(), strict=True)
    vectors = {name: GivenLoad(label, _vector(label, load)) for name, (load, label) in named.items()}
    efforts = GivenLoad("tau", _efforts(tau, robot), robot.dof)
    if (further := efforts_of_followers(robot, loads or {})) is not None:
        alone = efforts
        efforts = GivenLoad("tau", lambda t, now: alone.at(t, now) + further(now), robot.dof)
    return Loads(fall, efforts, loads_by_joint(robot, loads), vectors, wrench_names)


def _vector(label: str, load: Any) -> Any:
    """Return a force or a torque, (3,), or a callable of (t, now)."""
    if callable(load):
        check_callable(label, load, "t", "now")
        return load
    return np.zeros(3) if is_zero(load) else one_constant(label, load, 3)


def _efforts(tau: Any, robot: Mechanism) -> Any:
    """Return efforts, (dof,), or a callable of (t, now)."""
    if isinstance(tau, Feedback):
        return _feedback(tau, robot.dof)
    if callable(tau):
        check_callable("tau", tau, "t", "now")
        return tau
    if isinstance(tau, float | int):
        return np.full(robot.dof, finite_number("tau", tau))
    efforts = tree_of(robot).rows("tau", tau)
    if efforts.ndim > 1:
        expected = f"{robot.dof} efforts that stay, a callable of (t, now), or a Feedback"
        raise ShapeError("tau", expected, f"shape {efforts.shape}")
    return efforts


def _feedback(control: Feedback, dof: int) -> Callable[[Array, MotionAtInstants], Array]:
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

    def tau(_: Array, now: MotionAtInstants) -> Array:
        efforts: Array = control.tau_ff + (control.q_ref - now.q) @ K.T + (control.qd_ref - now.qd) @ D.T
        return efforts

    return tau


def loads_by_joint(robot: Mechanism, loads: Any) -> dict[str, HingeLoad]:
    """Return a HingeLoad for each joint with a coordinate; those of joints that follow are handed to their leaders.

    Raises:
        ArgumentError: they are no HingeLoads by the joint's name.
    """
    joints = {joint.name: joint for joint in (*tree_of(robot).joints, *tree_of(robot).coordinates)}
    if loads is not None and not isinstance(loads, Mapping):
        raise ArgumentError("loads", "HingeLoads by the joint's name", quoted(loads))
    given = {}
    for name, load in (loads or {}).items():
        if name not in joints:
            raise ArgumentError("loads", choices(list(joints)) + nearest(str(name), joints), quoted(name))
        given[name] = _hinge_load(f"loads[{name!r}]", load)
    of_joints: dict[str, Any] = {name: given.get(name, HingeLoad()) for name in robot.names}
    for name, load in given.items():
        rule = joints[name].mimic
        if rule is not None and rule.multiplier:
            leader = tree_of(robot).joints[rule.leader - 1].name
            of_joints[leader] = _sum(_of_leader(load, rule), of_joints[leader])
    return of_joints


def _hinge_load(label: str, torque: HingeTorque) -> HingeLoad:
    """Return a torque at a joint as a HingeLoad.

    Raises:
        ArgumentError: it is no number, no HingeLoad and no callable of (t, q, qd), or its rigid stops are too close
            together.
    """
    if is_plain_hinge_load(torque):
        lower, upper = stop_range(torque, rigid=True)
        if not upper - lower > 1e-9:  # impacts closer together could not be told apart
            expected = "rigid stops at least 1e-9 rad or m apart (what is driven= moves as given)"
            raise ArgumentError(label, expected, f"{lower!r} to {upper!r}")
        return torque
    if not callable(torque):
        return HingeLoad(motor=finite_number(label, torque))
    check_callable(label, torque, "t", "q", "qd")

    def motor(t: Any, q: Any, qd: Any) -> Array:
        return broadcast_load(label, call_with_arrays(label, torque, t, q, qd), np.shape(t))

    return HingeLoad(motor=motor)


def _of_leader(load: HingeTorque, rule: Mimic) -> HingeTorque:
    """Return the load of a joint that follows as one of its leader: the same power, at the leader's coordinate."""
    ratio, offset = rule.multiplier, rule.offset
    if not isinstance(load, HingeLoad):
        if callable(load):
            motor = load
            return lambda t, q, qd: ratio * np.asarray(motor(t, ratio * q + offset, ratio * qd))
        return ratio * load
    stops = None if load.stops is None else sorted((stop - offset) / ratio for stop in load.stops)
    return HingeLoad(
        stiffness=ratio**2 * load.stiffness,
        rest=(load.rest - offset) / ratio,
        damping=ratio**2 * load.damping,
        friction=abs(ratio) * load.friction,
        friction_rate=None if load.friction_rate is None else load.friction_rate / abs(ratio),
        stops=None if stops is None else (stops[0], stops[1]),
        stop_stiffness=ratio**2 * load.stop_stiffness,
        stop_damping=abs(ratio) * load.stop_damping,
        stop_restitution=load.stop_restitution,
        motor=_of_leader(load.motor, rule),
    )


def _sum(first: HingeTorque, second: HingeTorque) -> HingeTorque:
    """Return the sum of two torques, in which stops and friction are known."""
    if isinstance(first, HingeLoad):
        return replace(first, motor=_sum(first.motor, second))
    if isinstance(second, HingeLoad):
        return replace(second, motor=_sum(first, second.motor))
    if callable(first) or callable(second):
        parts = (first, second)
        return lambda t, q, qd: sum(np.asarray(one(t, q, qd)) if callable(one) else one for one in parts)
    return first + second
