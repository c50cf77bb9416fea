"""Loads on pairs and robots as `simulate` and `linearize` are given them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, ShapeError, choices, nearest, quoted
from hingepair.mechanism.bodies.hinge_load import (
    TORQUE_PARTS,
    HingeLoad,
    HingeTorque,
    call_with_arrays,
    check_callable,
    is_plain_hinge_load,
)
from hingepair.mechanism.computations import read_wrenches
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.tree import Mimic
from hingepair.motion.linkage_loads import efforts_of_followers, with_strut_loads
from hingepair.motion.loads import (
    ON_BASE,
    GivenLoad,
    Loads,
    MotionAtInstants,
    broadcast_load,
    called_load,
    check_rigid_stops,
)
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number, is_zero, one_constant
from hingepair.plans.arguments import Coordinates
from hingepair.rollouts.tracks import Feedback

LoadArgument: TypeAlias = ArrayLike | Callable[[Array, MotionAtInstants], ArrayLike]
"""A force or a torque as users give it: constants, or a callable of (t, now)."""
EffortArgument: TypeAlias = Coordinates | Callable[[Array, MotionAtInstants], ArrayLike] | Feedback
"""Efforts at the joints as users give them: constants, a callable of (t, now), or a Feedback."""


BODY2 = "body2"
"""Name of body 2 in the robot of one joint that stands for a pair."""


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
        loads: HingeLoads by joint; None: none.
        wrenches: (force, torque) by link, each a constant or a callable of (t, now); None: none.
        on_base: force1 and torque1.
        gravity: acceleration of free fall [m/s^2].

    Raises:
        ArgumentError: a load cannot be used; the error names it.
    """
    fall = tuple(one_constant("gravity", gravity, 3).tolist())
    joint_loads = loads_by_joint(robot, loads)
    efforts = GivenLoad("tau", _efforts(tau, robot), robot.dof)
    if (further := efforts_of_followers(robot, loads or {})) is not None:
        alone = efforts
        efforts = GivenLoad("tau", lambda t, now: alone.at(t, now) + further(now), robot.dof)
    wrenches = with_strut_loads(robot, wrenches)
    on_links, links = read_wrenches(wrenches, tree_of(robot).links)
    vectors = {name: GivenLoad(name, _vector(name, load)) for name, load in on_base.items()}
    wrench_names = {link: (f"force_{link}", f"torque_{link}") for link in links}
    for name, (load, label) in zip(
        (name for both in wrench_names.values() for name in both), on_links.values(), strict=True
    ):
        vectors[name] = GivenLoad(label, _vector(label, load))
    return Loads(
        fall,
        efforts,
        joint_loads,
        tuple(f"loads[{name!r}]" for name in robot.names),
        robot.names,
        vectors,
        wrench_names,
        need_motion=any(callable(load.value) for load in (efforts, *vectors.values())),
    )


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


def loads_by_joint(robot: Mechanism, loads: Any) -> tuple[HingeLoad, ...]:
    """Return a HingeLoad for each joint with a coordinate; those of joints that follow are handed to their leaders.

    Raises:
        ArgumentError: they are no HingeLoads by the joint's name.
    """
    joints = {joint.name: joint for joint in (*tree_of(robot).joints, *tree_of(robot).coordinates)}
    if loads is not None and not isinstance(loads, Mapping):
        raise ArgumentError("loads", "HingeLoads by the joint's name", quoted(loads))
    for name, load in (loads or {}).items():
        if name not in joints:
            raise ArgumentError("loads", choices(list(joints)) + nearest(str(name), joints), quoted(name))
        if not is_plain_hinge_load(load):
            raise ArgumentError(f"loads[{name!r}]", "a HingeLoad", quoted(load))
        check_rigid_stops(f"loads[{name!r}]", load, "driven")
    of_joints: dict[str, Any] = {name: (loads or {}).get(name, HingeLoad()) for name in robot.names}
    for name, load in (loads or {}).items():
        rule = joints[name].mimic
        if rule is not None and rule.multiplier:
            leader = tree_of(robot).joints[rule.leader - 1].name
            of_joints[leader] = _sum(_of_leader(load, rule), of_joints[leader])
    return tuple(of_joints.values())


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


def pair_loads(
    forces: Mapping[str, LoadArgument], hinge_torque: HingeTorque, gravity: ArrayLike, *, is_planar: bool
) -> Loads:
    """Return the loads on a pair as those on a robot of one joint.

    Args:
        forces: force1, torque1, force2 and torque2: constants, the number 0, or callables of (t, now).
        hinge_torque: torque at the hinge [N m]: a number, a HingeLoad, or a callable of (t, psi, psid).
        gravity: acceleration of free fall [m/s^2].
        is_planar: whether the pair is planar: forces and gravity have two components then, and torques one.

    Raises:
        ArgumentError: a constant is not finite or of the wrong shape, or a callable takes other arguments.
    """
    vectors = {name: GivenLoad(name, _body_load(name, load, is_planar)) for name, load in forces.items()}
    acts_on_body2 = vectors["force2"].acts or vectors["torque2"].acts
    return Loads(
        tuple(_constant("gravity", gravity, is_planar).tolist()),
        GivenLoad("hinge_torque", np.zeros(1), 1),
        (hinge_load(hinge_torque),),
        ("hinge_torque",),
        ("psi",),
        vectors,
        {BODY2: ("force2", "torque2")} if acts_on_body2 else {},
        need_motion=any(callable(load) for load in forces.values()),
    )


def hinge_load(torque: HingeTorque) -> HingeLoad:
    """Return a torque at the hinge as a HingeLoad.

    Raises:
        ArgumentError: it is no number, no HingeLoad and no callable of (t, psi, psid).
    """
    if is_plain_hinge_load(torque):
        check_rigid_stops("hinge_torque", torque, "hinge")
        return torque
    if callable(torque):
        check_callable("hinge_torque", torque, "t", "psi", "psid")

        def motor(t: Any, psi: Any, psid: Any) -> Array:
            values = call_with_arrays("hinge_torque", torque, t, psi, psid)
            return broadcast_load("hinge_torque", values, np.shape(t))

        return HingeLoad(motor=motor)
    return HingeLoad(motor=finite_number("hinge_torque", torque))


def loads_of_pair(loads: Mapping[str, Array]) -> dict[str, Array]:
    """Return acting loads of a robot of one joint by the names that they have for a pair: hinge_torque and its parts,
    such as motor_torque, (n,), and the forces and torques on both bodies.
    """
    forces = {name: loads[name] for name in (*ON_BASE, "force2", "torque2")}
    parts = {f"{name}_torque": loads[name][:, 0] for name in TORQUE_PARTS if name in loads}
    return {**forces, "hinge_torque": loads["tau"][:, 0], **parts}


def _body_load(name: str, load: Any, is_planar: bool) -> Any:
    """Return a force or a torque in space: (3,), or a callable of (t, now) that returns (n, 3)."""
    if not callable(load):
        return _constant(name, load, is_planar)
    check_callable(name, load, "t", "now")
    if not is_planar:
        return load
    tail = _tail(name, is_planar)
    return lambda t, now: _to_space(called_load(name, load, t, now, tail), len(tail))


def _constant(name: str, load: Any, is_planar: bool) -> Array:
    """Return a constant force, torque or gravity as three components in space."""
    tail = _tail(name, is_planar)
    if is_zero(load):
        return np.zeros(3)
    value = one_constant(name, load, *tail) if tail else np.array(finite_number(name, load))
    return _to_space(value, len(tail)) if is_planar else np.array(value)


def _tail(name: str, is_planar: bool) -> tuple[int, ...]:
    """Return the shape of one value of a load as users give it."""
    if not is_planar:
        return (3,)
    return () if name.startswith("torque") else (2,)


def _to_space(value: Array, rank: int) -> Array:
    """Return values for planar pairs as vectors in space: vectors in the plane (rank 1), or torques (rank 0)."""
    columns = [value[..., 0], value[..., 1], 0 * value[..., 0]] if rank else [0 * value, 0 * value, value]
    return np.stack(columns, axis=-1)
