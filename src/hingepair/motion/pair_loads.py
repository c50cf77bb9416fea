"""Loads on a pair as `simulate` and `linearize` are given them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.motion.loads import (
    ON_BASE,
    GivenLoad,
    Loads,
    MotionAtInstants,
    RobotMotionAtInstants,
    broadcast_load,
    called_load,
    check_rigid_stops,
)
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number, is_zero, one_constant
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.hinge_load import TORQUE_PARTS, HingeLoad, HingeTorque, check_callable, is_plain_hinge_load

BODY2 = "body2"
"""Name of body 2 in the robot of one joint."""
LoadArgument: TypeAlias = ArrayLike | Callable[[Array, MotionAtInstants], ArrayLike]
"""A force or torque on a body as users give it: a constant, or a callable of (t, now)."""
BaseArgument: TypeAlias = str | Callable[[Array], BodyMotion]
"""What holds body 1, as users give it: the name of a base, or a callable of t that returns the motion of body 1."""


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
    vectors = {name: GivenLoad(name, _vector(name, load, is_planar)) for name, load in forces.items()}
    hinge_load, efforts, motor = HingeLoad(), GivenLoad("hinge_torque", np.zeros(1), 1), "motor"
    if is_plain_hinge_load(hinge_torque):
        hinge_load = hinge_torque
        check_rigid_stops("hinge_torque", hinge_load, "hinge")
    else:
        efforts, motor = GivenLoad("hinge_torque", _plain_torque(hinge_torque), 1), "hinge_torque"
    acts_on_body2 = vectors["force2"].acts or vectors["torque2"].acts
    return Loads(
        tuple(_constant("gravity", gravity, is_planar).tolist()),
        efforts,
        (hinge_load,),
        ("hinge_torque",),
        ("psi",),
        vectors,
        {BODY2: ("force2", "torque2")} if acts_on_body2 else {},
        need_motion=any(callable(load) for load in forces.values()),
        now=_pair_motion,
        motor=motor,
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
        return HingeLoad(motor=torque)
    return HingeLoad(motor=finite_number("hinge_torque", torque))


def loads_of_pair(loads: Mapping[str, Array]) -> dict[str, Array]:
    """Return acting loads of a robot of one joint by the names that they have for a pair: hinge_torque and its parts,
    such as motor_torque, (n,), and the forces and torques on both bodies.
    """
    forces = {name: loads[name] for name in (*ON_BASE, "force2", "torque2")}
    parts = {f"{name}_torque": loads[name][:, 0] for name in TORQUE_PARTS if name in loads}
    return {**forces, "hinge_torque": loads["tau"][:, 0], **parts}


def _pair_motion(motion: RobotMotionAtInstants) -> MotionAtInstants:
    q, qd, R1, S1, v1, omega1 = motion
    return MotionAtInstants(R1, S1, v1, omega1, q[:, 0], qd[:, 0])


def _plain_torque(torque: Any) -> Any:
    """Return a number as the effort at one joint, (1,), or a callable of (t, psi, psid) as one of (t, now)."""
    if not callable(torque):
        return np.array([finite_number("hinge_torque", torque)])
    check_callable("hinge_torque", torque, "t", "psi", "psid")

    def effort(t: Array, now: MotionAtInstants) -> Array:
        return broadcast_load("hinge_torque", torque(t, now.psi, now.psid), t.shape)[:, None]

    return effort


def _vector(name: str, load: Any, is_planar: bool) -> Any:
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
