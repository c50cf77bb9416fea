"""Simulation of robots: the argument of each load by joint or link, and the motion of joints, frames and base."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, choices, nearest, quoted
from hingepair.mechanism.bodies.body import DynamicsWarning
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_arrays
from hingepair.mechanism.bodies.hinge_load import HingeTorque
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.results import Result
from hingepair.mechanism.states import Energy, FrameState, MechanismForces, MechanismState, Momentum
from hingepair.mechanism.tree import loads_note
from hingepair.motion.energy_balance import EnergyBalance, LazyBalance, energy_balance
from hingepair.motion.equations_of_motion import REST, RobotMotion
from hingepair.motion.events import UserEvent
from hingepair.motion.given_loads import EffortArgument, LoadArgument, robot_loads
from hingepair.motion.given_motions import GivenBase, GivenJoint, JointCallable, check_rest
from hingepair.motion.loads import check_start
from hingepair.motion.robot_programs import RobotPrograms
from hingepair.motion.run import Impact, Simulation, joint_impacts, joint_range, read_options
from hingepair.motion.trajectory import LazyValue
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import Frozen, check_choice, finite_number, read_only
from hingepair.plans.arguments import Coordinates
from hingepair.tables.instants import instants_of
from hingepair.tables.suspicions import suspicions

BASES = ("fixed", "free", "pinned", "moving")  # what may hold the base of a robot
BaseArgument = BodyMotion | Callable[[Array], BodyMotion] | None


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
    #: (force, torque) on links by name, world axes, the force at the link's origin; (N, 3) each
    wrenches: Mapping[str, tuple[Array, Array]]
    #: acceleration of free fall, world axes [m/s^2]
    gravity: tuple[float, ...]
    #: what holds the base: "fixed", "free", "pinned" or "moving"
    base: str
    #: smallest and largest coordinate of each joint in the whole motion, between the instants too; shape (dof, 2)
    q_range: Array
    #: impacts of joints at rigid stops, in order of time, with the fields joint, t [s], and the rates before and
    #: after [rad/s or m/s]; `loads` are without their forces
    impacts: tuple[Impact, ...]
    #: number of integration steps
    steps: int
    #: whether `until` ended the motion before the last instant that was asked for
    ended_by_event: bool
    _frames: tuple[str, ...] | None
    _errors: LazyValue
    _balance: LazyBalance

    @property
    def described(self) -> str:
        """The robot's name, and that it is simulated."""
        return f"{self.robot.name}, simulated"

    @property
    def tau(self) -> Array:
        """Sum of the efforts at each joint [N m, N], of motors, springs, dampers, friction and stops; (N, dof)."""
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
            self.q, self.qd, self.qdd, gravity=self.gravity, wrenches=dict(self.wrenches),
            base_motion=self.base_motion, joint_loads=False,
        )  # fmt: skip

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return arrays (N,) by name: of a joint `elbow` elbow, elbowd, elbowdd and tau_elbow; of a base that moves
        also R1, S1, v1 and omega1, (N, ...).
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
        for joint in tree_of(self.robot).coordinates:
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
    joint_loads: bool | None = None,
    driven: Mapping[str, JointCallable] | None = None,
    wrenches: Mapping[str, tuple[LoadArgument, LoadArgument]] | None = None,
    force1: LoadArgument = 0,
    torque1: LoadArgument = 0,
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
    """Simulate the motion of a robot; `hp.simulate` says what the arguments are."""
    if not isinstance(robot, Mechanism):
        raise ArgumentError("robot", "a Mechanism", quoted(robot))
    tree_of(robot).single()
    if joint_loads is not None:
        loads = _described_loads(robot, loads, joint_loads)
    elif loads is None and (note := loads_note(tree_of(robot))):
        sentence = f"{robot.name}: {note}; loads=robot.joint_loads counts them, loads={{}} is silent"
        warnings.warn(sentence, DynamicsWarning, stacklevel=3)
    kind, start = _base_of(robot, base, base_motion)
    if not robot.dof and kind not in ("free", "pinned"):
        raise ArgumentError("robot", "joints that move, or a base that is free or pinned", "none")
    if kind in ("free", "pinned") and robot.base != "free":
        robot = robot.with_base("free")
    instants = instants_of("t", t)
    options = read_options(tol, breaks, until, max_steps)
    on_base = {"force1": force1, "torque1": torque1}
    for name, load in on_base.items():
        if kind not in ("free", "pinned") and (callable(load) or np.any(load)):
            raise ArgumentError(name, f"0: a base that is {kind} is not moved by forces", quoted(load))
    all_loads = robot_loads(robot, tau, loads, wrenches, on_base, gravity)
    moves = _driven(robot, driven, loads or {}, instants)
    q, qd = (_read_start(name, value, robot) for name, value in (("q0", q0), ("qd0", 0.0 if qd0 is None else qd0)))
    for k, move in moves.items():
        first = move.at(instants[:1])
        q[k], qd[k] = first["psi"][0], first["psid"][0]
    check_start(all_loads, [f"q0[{name!r}]" for name in robot.names], q)
    if isinstance(start, GivenBase):
        start.check(instants)
    programs = RobotPrograms(robot, kind, tuple(all_loads.wrenches), all_loads.gravity, backend)
    robot.energy(q, qd)  # refuses missing masses, and warns of those that are assumed
    make_motion = functools.partial(RobotMotion, robot, kind, start, q, qd, all_loads, programs, moves)
    found = Simulation(make_motion, instants, options)
    samples, q_range, in_degrees = found.samples, [], list[str]()
    impacts = list[Impact]()
    for k, joint in enumerate(tree_of(robot).coordinates):
        extremes, doubts = joint_range(found.run, k, joint.name, joint.position_limits, options.tol)
        q_range.append(extremes)
        impacts += joint_impacts(found.run, k, joint.name)
        degrees = suspicions("written angles", f"q0[{joint.name!r}]", q[k]) if joint.unit == "rad" else []
        in_degrees += degrees
        for sentence in doubts if not degrees else ():  # degrees pass the limits, too
            warnings.warn(sentence, DynamicsWarning, stacklevel=3)
    if in_degrees:  # one mistake, one warning
        others = f" So do {len(in_degrees) - 1} further angles of q0." if len(in_degrees) > 1 else ""
        warnings.warn(in_degrees[0] + others, DynamicsWarning, stacklevel=3)
    errors = [found.attitude_error, *(functools.partial(found.coordinate_error, k) for k in range(robot.dof))]
    return SimulatedRobotMotion(
        robot=robot,
        t=read_only(samples.t),
        q=read_only(samples.motion.q),
        qd=read_only(samples.motion.qd),
        qdd=read_only(samples.qdd),
        base_motion=samples.base,
        loads={name: read_only(np.array(load)) for name, load in samples.loads.items()},
        wrenches=all_loads.wrenches_of(samples.loads),
        gravity=all_loads.gravity,
        base=kind,
        q_range=read_only(np.array(q_range, np.float64).reshape(-1, 2)),
        impacts=tuple(sorted(impacts, key=lambda impact: impact.t)),
        steps=samples.steps,
        ended_by_event=found.run.ended,
        _frames=None if frames is None else tuple([frames] if isinstance(frames, str) else frames),
        _errors=LazyValue(errors),
        _balance=LazyBalance(lambda: energy_balance(found.run)),
    )


def _described_loads(robot: Mechanism, loads: object, joint_loads: bool) -> Mapping[str, HingeTorque]:
    """Return the loads of joints that a file describes, without stops; none unless `joint_loads` is true."""
    if loads is not None:
        raise ArgumentError("joint_loads", "None beside loads", quoted(joint_loads))
    return {name: replace(load, stops=None) for name, load in robot.joint_loads.items()} if joint_loads else {}


def _base_of(robot: Mechanism, base: str | None, base_motion: Any) -> tuple[str, Any]:
    """Return what holds the base, and its motion at the start or, of a moving base, a callable."""
    kind = ("moving" if callable(base_motion) else robot.base) if base is None else base
    check_choice("base", kind, BASES)
    if callable(base_motion) != (kind == "moving"):
        expected = "a callable of times that returns a BodyMotion, for base='moving' and no other"
        raise ArgumentError("base_motion", expected, quoted(base_motion))
    if callable(base_motion):
        return kind, GivenBase("base_motion", base_motion)
    start = REST if base_motion is None else base_motion
    if not isinstance(start, BodyMotion) or start.shape != ():
        raise ArgumentError("base_motion", "one BodyMotion, the start of the base", quoted(base_motion))
    motion_arrays("base_motion", start, "S")
    check_rest("base_motion", kind, start)
    return kind, start


def _driven(
    robot: Mechanism, driven: Mapping[str, JointCallable] | None, loads: Mapping[str, Any], t: Array
) -> dict[int, GivenJoint]:
    """Return the motions of joints that move as given, by the joint's number."""
    if driven is not None and not isinstance(driven, Mapping):
        raise ArgumentError("driven", "callables by the joint's name", quoted(driven))
    moves, leaders = {}, tree_of(robot).coordinate_names.leaders
    for name, move in (driven or {}).items():
        if name not in robot.names:
            raise ArgumentError("driven", choices(robot.names) + nearest(str(name), robot.names), quoted(name))
        for loaded in {name, *(follower for follower, leader in leaders.items() if leader == name)} & {*loads}:
            raise ArgumentError(f"loads[{loaded!r}]", "no load at a joint that moves as given", quoted(loads[loaded]))
        joint = moves[robot.names.index(name)] = GivenJoint(f"driven[{name!r}]", move)
        joint.check(t)
    return moves


def _read_start(name: str, value: Any, robot: Mechanism) -> Array:
    """Return the checked coordinates or rates at the first instant, a new array (dof,)."""
    if isinstance(value, float | int) and not value:
        return np.zeros(robot.dof)
    array = tree_of(robot).rows(name, value).copy()
    if array.ndim > 1:
        raise ArgumentError(name, f"one start, shape ({robot.dof},)", f"shape {array.shape}")
    for joint, x in zip(robot.names, array.tolist(), strict=True):
        finite_number(f"{name}[{joint!r}]", x)
    return array
