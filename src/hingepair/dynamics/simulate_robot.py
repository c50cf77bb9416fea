"""Simulation of robots: the argument of each load by joint or link, and the motion of joints, frames and base."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.dynamics.energy_balance import EnergyBalance, LazyBalance, energy_balance
from hingepair.dynamics.events import UserEvent
from hingepair.dynamics.robot_loads import EffortArgument, RobotLoadArgument, RobotLoads, wrenches_of
from hingepair.dynamics.robot_motion import BASES, JointCallable, RobotMotion, base_at, driven_at
from hingepair.dynamics.robot_programs import RobotPrograms
from hingepair.dynamics.run import (
    Run,
    RunOptions,
    angle_between,
    check_joint_rates,
    check_rates,
    joint_extremes,
    read_options,
    run_motion,
    stop_overrun,
)
from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.integration.trajectory import LazyValue
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.states import FrameState, MechanismForces, MechanismState
from hingepair.mechanism.tree import loads_note
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import Frozen, check_choice, finite_number, read_only
from hingepair.numeric.instants import instants_of
from hingepair.numeric.suspicions import suspicions
from hingepair.pair.body import DynamicsWarning
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.dynamics import DEFAULT_GRAVITY, Energy, Momentum
from hingepair.pair.hinge_load import HingeTorque, check_callable
from hingepair.pair.results import Result
from hingepair.plans.arguments import CoordinateNames, Coordinates, read_coordinates

BaseArgument = BodyMotion | Callable[[Array], BodyMotion] | None
_REST = BodyMotion(R=(0.0, 0.0, 0.0), S=np.eye(3))


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedRobotMotion(Frozen, Result):
    """The motion of a robot, as `simulate` returns it."""

    #: the robot; free if its base is free or pinned
    robot: Mechanism
    #: instants [s]; shape (N,)
    t: Array
    #: coordinates, in the order of `robot.names` [rad, m]; shape (N, dof)
    q: Array
    #: first derivatives of q; shape (N, dof)
    qd: Array
    #: second derivatives of q; shape (N, dof)
    qdd: Array
    #: motion of the base with all its derivatives; shape (N,)
    base_motion: BodyMotion
    #: loads by name: "tau", the sum of the efforts at each joint, (N, dof); its parts "motor" and, of HingeLoads,
    #: "spring", "damper", "friction" and "stop", (N, dof); force1 and torque1 on the base, and those on links, such
    #: as force_hand and torque_hand, (N, 3)
    loads: Mapping[str, Array]
    #: acceleration of free fall, world axes [m/s^2]
    gravity: tuple[float, ...]
    #: what holds the base: "fixed", "free", "pinned" or "moving"
    base: str
    #: smallest and largest coordinate of each joint in the whole motion, between the instants too; shape (dof, 2)
    q_range: Array
    #: number of integration steps
    steps: int
    #: whether `until` ended the motion before the last instant that was asked for
    ended_by_event: bool
    _frames: tuple[str, ...] | None
    _wrenches: Mapping[str, tuple[Array, Array]]
    _errors: LazyValue
    _balance: LazyBalance

    @property
    def described(self) -> str:
        """The robot's name."""
        return f"{self.robot.name}, simulated"

    @property
    def tau(self) -> Array:
        """Sum of the efforts at each joint [N m, N]; shape (N, dof)."""
        return self.loads["tau"]

    @property
    def q_error_estimate(self) -> Array:
        """Estimated error of each coordinate at the worst instant [rad, m], shape (dof,), from a second run with a
        thousandth of the tolerance at first access.
        """
        return np.asarray(self._errors()[1:])

    @property
    def attitude_error_estimate(self) -> float:
        """Estimated error of the base's attitude at the worst instant [rad]; 0 if the base is fixed or moving."""
        return float(self._errors()[0])

    @property
    def error_estimate(self) -> float:
        """Largest of the estimated errors of all coordinates and of the base's attitude [rad, m]."""
        return float(np.max(self._errors()))

    def state(self, frames: str | Iterable[str] | None = None) -> MechanismState:
        """Compute the motion of frames at the instants, with accelerations; by default those that `simulate` was
        given.
        """
        wanted = self._frames if frames is None else frames
        return self.robot.forward_kinematics(self.q, self.qd, self.qdd, frames=wanted, base_motion=self.base_motion)

    def __getitem__(self, frame: str) -> FrameState:
        """Compute the motion of one frame."""
        return self.state((frame,))[frame]  # type: ignore[no-any-return]

    def energy(self) -> Energy:
        """Compute the kinetic and potential energy, (N,) each; without the base unless it is free or pinned."""
        return self.robot.energy(self.q, self.qd, gravity=self.gravity, base_motion=self.base_motion)

    def energy_balance(self) -> EnergyBalance:
        """Compute the energy balance at the first call, keep it, and return this EnergyBalance: the work of each load
        since the first instant, and the energies. `print` shows it as a table.
        """
        return self._balance()

    def momentum(self) -> Momentum:
        """Compute the linear and angular momentum, about the world's origin, (N, 3) each."""
        return self.robot.momentum(self.q, self.qd, base_motion=self.base_motion)

    def reactions(self) -> MechanismForces:
        """Compute what holds or drives the base, `force1` and `torque1` about R1, (N, 3) each: the loads on it
        included, so that those of a free base are its loads. `tau` are the efforts that the motion requires.
        """
        return self.robot.inverse_dynamics(
            self.q, self.qd, self.qdd, gravity=self.gravity, wrenches=dict(self._wrenches),
            base_motion=self.base_motion, joint_loads=False,
        )  # fmt: skip

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return arrays (N,) by name: of each joint, such as an elbow, elbow, elbowd, elbowdd and tau_elbow; of a
        base that moves also R1, S1, v1 and omega1.
        """
        columns = {"": self.q, "d": self.qd, "dd": self.qdd}
        found = {
            name + ending: array[:, k] for k, name in enumerate(self.robot.names) for ending, array in columns.items()
        }
        found |= {f"tau_{name}": self.tau[:, k] for k, name in enumerate(self.robot.names)}
        base = {f"{letter}1": getattr(self.base_motion, letter) for letter in ("R", "S", "v", "omega")}
        return found | (base if self.base != "fixed" else {})

    def unit(self, name: str) -> str:
        """Return the unit of a recorded array, or of one of its components, by its name."""
        for joint in self.robot.tree.coordinates:
            units = {"": joint.unit, "d": f"{joint.unit}/s", "dd": f"{joint.unit}/s^2"}
            for ending, unit in units.items():
                if name == joint.name + ending:
                    return unit
            if name == f"tau_{joint.name}":
                return joint.effort_unit
        return super().unit(name)

    def _available_names(self) -> Iterable[str]:
        return ()  # besides those of the class

    def __repr__(self) -> str:
        ended = ", ended by until" if self.ended_by_event else ""
        span = f"{self.t[0]:g} to {self.t[-1]:g} s" if len(self.t) else ""
        return f"SimulatedRobotMotion({self.robot.name!r}, {len(self.t)} instants, {span}, steps={self.steps}{ended})"


def simulate_robot(
    robot: Mechanism,
    t: ArrayLike,
    q0: Coordinates,
    qd0: Coordinates | None = None,
    *,
    tau: EffortArgument = 0.0,
    loads: Mapping[str, HingeTorque] | None = None,
    driven: Mapping[str, JointCallable] | None = None,
    wrenches: Mapping[str, tuple[RobotLoadArgument, RobotLoadArgument]] | None = None,
    force1: RobotLoadArgument = 0,
    torque1: RobotLoadArgument = 0,
    gravity: ArrayLike = DEFAULT_GRAVITY,
    base: str | None = None,
    base_motion: BaseArgument = None,
    breaks: ArrayLike = (),
    until: UserEvent | None = None,
    tol: float = 1e-10,
    max_steps: int = 30_000,
    frames: str | Iterable[str] | None = None,
    backend: str = "auto",
) -> SimulatedRobotMotion:
    """Simulate the motion of a robot under loads (T1-T6) at the instants t, from the state (q0, qd0) at t[0];
    `hp.simulate` does so for robots.

    The method is Gauss collocation of order 16, with the attitude of a free base on the rotation group. Without loads
    and gravity, the momenta of a free base are kept to rounding. Dry friction of several joints is solved at once,
    and impacts at rigid stops are felt by all joints. The `position_limits` of the robot do not stop the motion;
    `HingeLoad(stops=...)` does.

    Args:
        robot: a robot each motion of which masses resist.
        t: instants, increasing; shape (N,), as for pairs.
        q0: coordinates at t[0] [rad, m]; shape (dof,), or a dict by joint.
        qd0: rates at t[0]; 0 by default.
        tau: efforts at the joints [N m, N]: shape (dof,), a dict by joint, a callable of (t, now) that returns (n,
            dof), or a `Feedback` with constant references. There t is an array of n instants, and `now` has the
            attributes q and qd, (n, dof), R1, S1, v1 and omega1 of the base, and base_motion, a BodyMotion of these.
        loads: `HingeLoad`s by joint: springs, dampers, dry friction, stops, motors that depend on the joint alone.
            They add to tau. For a slider, read m for rad and N for N m. `robot.joint_loads` are those that a URDF or
            MJCF describes, with stops at the limits.
        driven: motions of joints that move as given, by joint: callables of times (n,) that return the coordinate and
            its first two derivatives, (n,) each. Their q0 and qd0 are those of the callable; no tau and no HingeLoad
            acts on them, and their part of `loads["motor"]` is the effort that the motion needs.
        wrenches: loads on links: (force, torque) by link, world axes, the force at the link's origin [N, N m]; each
            has shape (3,), is the number 0, or a callable of (t, now) that returns (n, 3).
        force1: force on a free or pinned base at R1, world axes [N]; in the same form as a force of `wrenches`.
        torque1: torque on it [N m]; in the same form.
        gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).
        base: "fixed" where `base_motion` is, "free", "pinned" (R1 stays, the base can turn about it) or "moving". By
            default that of the robot, or "moving" if `base_motion` is a callable.
        base_motion: the base at t[0]: a BodyMotion of R and S, of a free base also v and omega; at rest at the origin
            by default. Of a moving base, a callable of times (n,) that returns a BodyMotion with all derivatives.
        breaks: instants at which loads jump [s], as for pairs.
        until: event that ends the motion: a callable of (t, now), as for pairs.
        tol: tolerance of each step, from 1e-14 to 1e-2: the error of an angle [rad], or that of a length in units of
            the robot's size, at most.
        max_steps: largest number of steps tried.
        frames: names of the frames that `.state()` of the result computes by default; the last links unless given.
        backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

    Returns:
        A `SimulatedRobotMotion` with `.t`, `.q`, `.qd`, `.qdd`, `.tau`, `.loads`, `.base_motion`, `.state()`,
        `["frame"]`, `.energy()`, `.momentum()`, `.energy_balance()`, `.reactions()`, and `.error_estimate`, the
        largest of `.q_error_estimate` and `.attitude_error_estimate`.

    Raises:
        ArgumentError: an argument cannot be used; the error names it.
        SimulationError: the simulation cannot be continued; `t` of the error is the last instant that it reached.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> rod = hp.Body(1.0, centre_of_mass=(0.5, 0, 0), inertia=(0.01, 0.09, 0.09))
    >>> names = "upper", "lower"
    >>> u1 = (0, 0, 0), (1, 0, 0)
    >>> arm = hp.Mechanism([hp.HingePair(a, (0, 0, 0), (0, 1, 0), body2=rod, name=b) for a, b in zip(u1, names)])
    >>> swing = hp.simulate(arm, np.linspace(0, 2, 201), [0.0, 0.0], loads={"lower": hp.HingeLoad(friction=0.5)})
    >>> swing["lower"].R.shape, bool(abs(swing.energy_balance().residual).max() < 1e-8)
    ((201, 3), True)
    """
    if not isinstance(robot, Mechanism):
        raise ArgumentError("robot", "a Mechanism", quoted(robot))
    if not robot.dof:
        raise ArgumentError("robot", "joints that move", "none")
    robot.tree.single()
    if loads is None and (note := loads_note(robot.tree)):
        _warn(f"{robot.name}: {note}; loads=robot.joint_loads counts them, loads={{}} is silent", 4)
    kind, start = _base_of(robot, base, base_motion)
    if kind in ("free", "pinned") and robot.base != "free":
        robot = robot.with_base("free")
    instants = instants_of("t", t)
    options = read_options(tol, breaks, until, max_steps)
    on_base = {"force1": force1, "torque1": torque1}
    for name, load in on_base.items():
        if kind not in ("free", "pinned") and (callable(load) or np.any(load)):
            raise ArgumentError(name, f"0: a base that is {kind} is not moved by forces", quoted(load))
    all_loads = RobotLoads(robot, tau, loads, wrenches, on_base, gravity)
    moves = _driven(robot, driven, loads or {}, instants)
    q, qd = (_start(name, value, robot) for name, value in (("q0", q0), ("qd0", 0.0 if qd0 is None else qd0)))
    for k, move in moves.items():
        q[k], qd[k] = (x[0] for x in driven_at(all_loads.driven_label(k), move, instants[:1])[:2])
    for name, joint_load, x in zip(robot.names, all_loads.joint_loads, q, strict=True):
        lower, upper = joint_load.rigid_range
        if not lower <= x <= upper:
            expected = f"a coordinate between the rigid stops, {lower:g} to {upper:g}"
            raise ArgumentError(f"q0[{name!r}]", expected, float(x))
    if callable(start):
        check_rates(
            "base_motion", functools.partial(base_at, "base_motion", start), instants,
            {"v1": "R1", "omega1": "S1", "a1": "v1", "alpha1": "omega1"},
        )  # fmt: skip

    programs = RobotPrograms(robot, kind, all_loads.wrenches, all_loads.gravity, backend)
    robot.energy(q, qd)  # refuses missing masses, and warns of those that are assumed

    def run(options: RunOptions, t: Array) -> Run:
        return run_motion(RobotMotion(robot, kind, start, q, qd, all_loads, programs, moves), t, options)

    found = run(options, instants)
    q_range = _checked_range(found, options.tol)
    samples = found.samples
    finer = functools.cache(lambda: run(options.finer, samples.t).samples)
    of_joints = [
        functools.partial(lambda k: np.abs(samples.motion.q - finer().motion.q)[:, k].max(initial=0.0), k)
        for k in range(robot.dof)
    ]
    return SimulatedRobotMotion(
        robot=robot,
        t=read_only(samples.t),
        q=read_only(samples.motion.q),
        qd=read_only(samples.motion.qd),
        qdd=read_only(samples.qdd),
        base_motion=samples.base,
        loads={name: read_only(np.array(load)) for name, load in samples.loads.items()},
        gravity=all_loads.gravity,
        base=kind,
        q_range=read_only(q_range),
        steps=samples.steps,
        ended_by_event=found.ended,
        _frames=None if frames is None else tuple([frames] if isinstance(frames, str) else frames),
        _wrenches=wrenches_of(all_loads, samples.loads),
        _errors=LazyValue([lambda: angle_between(samples.quats, finer().quats), *of_joints]),
        _balance=LazyBalance(lambda: energy_balance(found)),
    )


def _base_of(robot: Mechanism, base: str | None, base_motion: Any) -> tuple[str, Any]:
    """Return what holds the base, and its motion at the start or, of a moving base, a callable."""
    kind = ("moving" if callable(base_motion) else robot.base) if base is None else base
    check_choice("base", kind, BASES)
    if callable(base_motion) != (kind == "moving"):
        expected = "a callable of times that returns a BodyMotion, for base='moving' and no other"
        raise ArgumentError("base_motion", expected, quoted(base_motion))
    if callable(base_motion):
        check_callable("base_motion", base_motion, "t")
        return kind, base_motion
    start = _REST if base_motion is None else base_motion
    if not isinstance(start, BodyMotion) or start.shape != ():
        raise ArgumentError("base_motion", "one BodyMotion, the start of the base", quoted(base_motion))
    motion_arrays("base_motion", start, "S")
    resting = {"free": (), "pinned": ("v",), "fixed": ("v", "omega")}[kind]
    for name in resting:
        speed = getattr(start, name)
        if speed is not None and np.any(speed):
            raise ArgumentError(f"base_motion.{name}", f"None or zeros for base={kind!r}", speed)
    return kind, start


def _driven(
    robot: Mechanism, driven: Mapping[str, JointCallable] | None, loads: Mapping[str, Any], t: Array
) -> dict[int, JointCallable]:
    """Return the motions of joints that move as given, by the joint's number."""
    if driven is not None and not isinstance(driven, Mapping):
        raise ArgumentError("driven", "callables by the joint's name", quoted(driven))
    for name, move in (driven or {}).items():
        label = f"driven[{name!r}]"
        if name not in robot.names:
            raise ArgumentError("driven", choices(robot.names) + nearest(str(name), robot.names), quoted(name))
        check_callable(label, move, "t")
        if name in loads:
            raise ArgumentError(f"loads[{name!r}]", "no load at a joint that moves as given", quoted(loads[name]))
        check_joint_rates(label, move, t)
    return {robot.names.index(name): move for name, move in (driven or {}).items()}


def _start(name: str, value: Any, robot: Mechanism) -> Array:
    """Return the coordinates or rates at the first instant, an array of its own."""
    if isinstance(value, float | int) and not value:
        return np.zeros(robot.dof)
    read, shape = read_coordinates(name, value, CoordinateNames(robot.names, noun="joints"))
    if shape:
        raise ArgumentError(name, f"one start, shape ({robot.dof},)", f"shape {(*shape, robot.dof)}")
    array = np.array(np.stack(read) if isinstance(read, tuple) else read, np.float64)
    for joint, x in zip(robot.names, array.tolist(), strict=True):
        finite_number(f"{name}[{joint!r}]", x)
    return array


def _warn(sentence: str, stacklevel: int = 5) -> None:
    warnings.warn(sentence, DynamicsWarning, stacklevel=stacklevel)


def _checked_range(run: Run, tol: float) -> Array:
    """Return the smallest and the largest coordinate of each joint, (dof, 2), and warn of those beyond limits and
    stops, and of starts in degrees.
    """
    motion = run.motion
    q_range = np.empty((motion.dof, 2))
    for k, (joint, load) in enumerate(zip(motion.robot.tree.coordinates, motion.joint_loads, strict=True)):
        lowest, highest = joint_extremes(run, k)
        q_range[k] = lowest.q, highest.q
        stops, limits = load.tightest_stops, joint.position_limits
        if overrun := stop_overrun(joint.name, joint.unit, stops, lowest.q, highest.q):
            _warn(f"{overrun}; HingeLoad(stop_stiffness=...) hardens them")
        passed = [lowest] if lowest.q < limits[0] - tol and stops[0] < limits[0] else []
        passed += [highest] if highest.q > limits[1] + tol and stops[1] > limits[1] else []
        if passed:
            reached = " and ".join(f"{extreme.q:.6g} {joint.unit} at t = {extreme.t:g} s" for extreme in passed)
            of_limits = f"{joint.name} leaves its limits, {limits[0]:g} to {limits[1]:g} {joint.unit}"
            _warn(f"{of_limits}: it reaches {reached}; HingeLoad(stops=...) enforces them")
        if joint.unit == "rad":
            for sentence in suspicions("written angles", f"q0[{joint.name!r}]", run.first_state[motion.q][k]):
                _warn(sentence)
    return q_range
