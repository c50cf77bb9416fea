"""Loads, and motions of the base and of joints, as users give them to `simulate` and `linearize`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.equations.spatial import unskew
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_arrays
from hingepair.mechanism.bodies.hinge_load import (
    HingeLoad,
    HingeTorque,
    call_with_arrays,
    check_callable,
    is_plain_hinge_load,
    stop_range,
)
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.robots.computations import read_wrenches
from hingepair.motion.linkages import efforts_of_followers, with_strut_loads
from hingepair.motion.loads import GivenLoad, Loads, MotionAtInstants, broadcast_load
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import finite_number, one_constant
from hingepair.plans.arguments import Coordinates
from hingepair.plans.pairs import SPACE
from hingepair.urdf.records import MimicRecord

LoadArgument: TypeAlias = ArrayLike | Callable[[Array, MotionAtInstants], ArrayLike]
"""A force or a torque as users give it: constants, or a callable of (t, now)."""
EffortArgument: TypeAlias = Coordinates | Callable[[Array, MotionAtInstants], ArrayLike]
"""Efforts at the joints as users give them: constants, or a callable of (t, now)."""


def robot_loads(
    robot: Mechanism,
    tau: EffortArgument,
    loads: Mapping[str, HingeTorque] | None,
    wrenches: Mapping[str, tuple[Any, Any]] | None,
    on_base: Mapping[str, Any],
    gravity: ArrayLike,
    wrench_names: tuple[str, str] | None = None,
) -> Loads:
    """Return the checked loads on a robot.

    Args:
        robot: the robot.
        tau: efforts of the joints: constants, or a callable of (t, now).
        loads: HingeLoads, numbers or callables of (t, q, qd) by joint; None: none.
        wrenches: (force, torque) by link, each a constant or a callable of (t, now); None: none.
        on_base: force1 and torque1.
        gravity: acceleration of free fall [m/s^2].
        wrench_names: names in results of the force and the torque on a link; by default with the link's name.

    Raises:
        ArgumentError: a load cannot be used; the error names it.
    """
    fall = tuple(one_constant("gravity", gravity, 3).tolist())
    wrenches = with_strut_loads(robot, wrenches)
    on_links, links = read_wrenches(wrenches, tree_of(robot))
    named = {name: (load, name) for name, load in on_base.items()}
    names = {link: wrench_names or (f"force_{link}", f"torque_{link}") for link in links}
    named |= zip((name for both in names.values() for name in both), on_links.values(), strict=True)
    vectors = {name: GivenLoad(label, load) for name, (load, label) in named.items()}
    if isinstance(tau, float | int):
        tau = np.full(robot.dof, finite_number("tau", tau))
    efforts = GivenLoad("tau", tau if callable(tau) else tree_of(robot).rows("tau", tau), robot.dof)
    if (further := efforts_of_followers(robot, loads or {})) is not None:
        alone = efforts
        efforts = GivenLoad("tau", lambda t, now: alone.at(t, now) + further(now), robot.dof)
    return Loads(fall, efforts, loads_by_joint(robot, loads), vectors, names)


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
            leader = rule.leader
            if load.motor:
                expected = f"a load without a motor: {name} follows {leader}, whose motor moves both"
                raise ArgumentError(f"loads[{name!r}]", expected, quoted(load.motor))
            of_joints[leader] = replace(_of_leader(load, rule), motor=of_joints[leader])
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


def _of_leader(load: HingeLoad, rule: MimicRecord) -> HingeLoad:
    """Return the load of a joint that follows as one of its leader: the same power, at the leader's coordinate."""
    ratio, offset = rule.multiplier, rule.offset
    stops = None if load.stops is None else sorted((stop - offset) / ratio for stop in load.stops)
    return HingeLoad(
        stiffness=ratio**2 * load.stiffness,
        rest=(load.rest - offset) / ratio,
        damping=ratio**2 * load.damping,
        friction=abs(ratio) * load.friction,
        friction_rate=None if load.friction_rate is None else load.friction_rate / abs(ratio),
        stops=None if stops is None else (stops[0], stops[1]),
        stop_stiffness=load.stop_stiffness * (ratio**2 if load.stop_restitution is None else 1),
        stop_damping=abs(ratio) * load.stop_damping,
        stop_restitution=load.stop_restitution,
    )


JointCallable: TypeAlias = Callable[[Array], Any]
"""Coordinate of a joint and its first two derivatives at instants (n,) [s]; (n,) each."""


class GivenMotion:
    """Motion that a callable of time prescribes.

    Args:
        label: its name in messages.
        motion: the callable.
        rates: names of rates by the quantities of which they are the derivatives.
        read: returns what the callable has returned at n instants as n rows by name, or refuses it.

    Raises:
        ArgumentError: it is no callable of t.
    """

    def __init__(
        self,
        label: str,
        motion: Callable[[Array], Any],
        rates: Mapping[str, str],
        read: Callable[[str, Any, Array], dict[str, Array]],
    ) -> None:
        check_callable(label, motion, "t")
        self._label, self._motion, self._rates, self._read = label, motion, rates, read

    def at(self, t: Array) -> dict[str, Array]:
        """Return the motion at n instants, arrays of n rows by name.

        Raises:
            ArgumentError: the callable returns something else.
        """
        return self._read(self._label, call_with_arrays(self._label, self._motion, t), t)

    def check(self, t: Array) -> None:
        """Refuse rates that differ from the derivatives by more than a tenth, and velocities that jump, for the
        simulation knows no impulse. From t[0] to t[-1], changes are compared with integrals of rates over short
        intervals, then over parts of the worst interval, and so on.
        """
        margin = 1e-9 * (t[-1] - t[0])  # a jump at the first or the last instant changes nothing
        for rate, quantity in self._rates.items() if margin else ():
            letter, of = rate.removesuffix("1"), quantity.removesuffix("1")
            start, end, largest, shares = t[0] + margin, t[-1] - margin, 0.0, list[float]()
            for _ in range(5):  # what a finite rate adds vanishes with the interval
                times = np.linspace(start, end, 1025)
                found = self.at(times)
                slopes = found[rate].reshape(len(times), -1)
                changes = _changes(found[quantity])
                integrals = np.diff(times)[:, None] * (slopes[1:] + slopes[:-1]) / 2
                largest = max(largest, float(np.abs(found[quantity]).max()))
                rounding = 4 * (np.spacing(largest) + np.spacing(np.abs(times).max()) * np.abs(slopes).max())
                off = np.maximum(np.abs(changes - integrals).max(axis=1) - rounding, 0.0)
                sizes = np.maximum(np.abs(changes).sum(), np.abs(integrals).sum()) / len(off)
                if sizes > 64 * rounding:  # less drowns in rounding
                    shares.append(float(off.mean() / sizes))
                k = int(np.argmax(off))
                start, end = times[k : k + 2]
                if end - start <= 16 * np.spacing(np.abs(times).max()):
                    break
            if quantity in self._rates and off[k] > 1e-6 * largest:
                expected, got = f"a motion whose {of} does not jump", f"a jump of {of} at t = {start:.6g} s"
                raise ArgumentError(self._label, expected, got)
            # Over long intervals, the integrals of a fast motion are coarse: they count where they fit best.
            if min(shares, default=0.0) > 0.1:
                expected = f"a callable whose {letter} is the derivative of its {of}"
                raise ArgumentError(self._label, expected, f"another {letter}")


def _changes(x: Array) -> Array:
    """Return the changes of vectors, numbers or attitudes from row to row; of attitudes small turns."""
    if x.ndim < 3:
        return np.diff(x.reshape(len(x), -1), axis=0)
    turns: Any = (x[1:] @ np.swapaxes(x[:-1], -1, -2)).reshape(-1, 9).T
    return np.stack(unskew(turns), axis=-1)


def given_base(label: str, motion: Callable[[Array], BodyMotion]) -> GivenMotion:
    """Return the motion of a base: R1, S1, v1, omega1, a1 and alpha1."""
    return GivenMotion(label, motion, {"v1": "R1", "omega1": "S1", "a1": "v1", "alpha1": "omega1"}, _read_base)


def given_joint(label: str, motion: JointCallable) -> GivenMotion:
    """Return the motion of a joint: psi, psid and psidd, in this order."""
    return GivenMotion(label, motion, {"psid": "psi", "psidd": "psid"}, _read_joint)


def _read_base(label: str, returned: Any, t: Array) -> dict[str, Array]:
    arrays = motion_arrays(f"{label}1", returned, "R", "S", "v", "omega", "a", "alpha")
    try:
        return {name: np.broadcast_to(x, (len(t), *SPACE.shapes[name])) for name, x in arrays.items()}
    except ValueError:
        expected = f"a callable that returns the motion of the base at {len(t)} instants"
        raise ArgumentError(label, expected, {name: array.shape for name, array in arrays.items()}) from None


def _read_joint(label: str, returned: Any, t: Array) -> dict[str, Array]:
    try:
        values = (np.broadcast_to(np.asarray(value, np.float64), t.shape) for value in returned)
        return dict(zip(("psi", "psid", "psidd"), values, strict=True))
    except (TypeError, ValueError):
        raise ArgumentError(
            label, f"a callable that returns (psi, psi', psi'') at {len(t)} instants", returned
        ) from None


def check_rest(label: str, base: str, start: BodyMotion) -> None:
    """Refuse a start of the base with a speed that `base`, "free", "pinned" or "fixed", does not allow."""
    for name in {"free": (), "pinned": ("v",), "fixed": ("v", "omega")}[base]:
        speed = getattr(start, name)
        if speed is not None and np.any(speed):
            raise ArgumentError(f"{label}.{name}", f"None or zeros for base={base!r}", speed)
