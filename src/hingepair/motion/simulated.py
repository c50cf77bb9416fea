"""Simulated motions as `simulate` returns them: of a robot, and of a pair, which is a robot of one joint."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.bodies.hinge_load import TORQUE_PARTS
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.results import Result
from hingepair.mechanism.states import Energy, FrameState, MechanismForces, MechanismState, Momentum
from hingepair.motion.energy_balance import EnergyBalance, energy_balance
from hingepair.motion.equations_of_motion import RobotMotion
from hingepair.motion.loads import ON_BASE
from hingepair.motion.run import Impact, RunOptions, run_motion
from hingepair.motion.trajectory import Deferred, Trajectory
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import Frozen, read_only


class Simulation(Deferred):
    """A run, and what is computed from it when it is first asked for.

    Args:
        make_motion: makes the equations of motion, in their first state.
        t: instants.
        options: options of the run.

    Raises:
        SimulationError: the motion cannot be continued.
    """

    def __init__(self, make_motion: Callable[[], RobotMotion], t: Array, options: RunOptions) -> None:
        self._make_motion, self._options = make_motion, options
        self.run = run_motion(make_motion(), t, options)

    @functools.cached_property
    def errors(self) -> Array:
        """Errors of the base's attitude [rad] and of each coordinate at the worst instant, by a second run with a
        thousandth of the tolerance.
        """
        samples = self.run.samples
        finer = run_motion(self._make_motion(), samples.t, self._options.finer).samples
        chords = [np.linalg.norm(samples.quats + sign * finer.quats, axis=-1) for sign in (-1, 1)]
        attitude = 4 * np.arcsin(np.minimum(np.minimum(*chords) / 2, 1)).max(initial=0.0)
        return np.append(attitude, np.abs(samples.motion.q - finer.motion.q).max(axis=0, initial=0.0))

    @functools.cached_property
    def balance(self) -> EnergyBalance:
        """The energy balance."""
        return energy_balance(self.run)


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
    #: attitude of the base as unit quaternions with the scalar first and without jumps of sign; shape (N, 4)
    base_quat_wxyz: Array
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
    #: whether `until`, a dead point or the end of a strut's stroke ended the motion before the last instant
    ended_by_event: bool
    _simulation: Simulation

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
        return self._simulation.errors[1:]

    @property
    def attitude_error_estimate(self) -> float:
        """Estimated error of the base's attitude at the worst instant [rad]; 0 if the base is fixed or moving."""
        return float(self._simulation.errors[0])

    @property
    def error_estimate(self) -> float:
        """Largest of the estimated errors of all coordinates and of the base's attitude [rad, m]."""
        return float(self._simulation.errors.max())

    def state(self, frames: str | Iterable[str] | None = None) -> MechanismState:
        """Compute the motion of frames at the instants, with accelerations; by default of the last links."""
        return self.robot.forward_kinematics(self.q, self.qd, self.qdd, frames=frames, base_motion=self.base_motion)

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
        return self._simulation.balance

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
        ended = ", ended by an event" if self.ended_by_event else ""
        span = f"{self.t[0]:g} to {self.t[-1]:g} s" if len(self.t) else ""
        return f"SimulatedRobotMotion({self.robot.name!r}, {len(self.t)} instants, {span}, steps={self.steps}{ended})"


ON_BODY2: Final = ("force2", "torque2")
"""Names of the force and the torque on body 2 of a pair in results."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class SimulatedMotion(Trajectory):
    """The motion of a pair, as `simulate` returns it: a `Trajectory` with rates and loads."""

    #: the motion as that of a robot of one joint, psi
    robot_motion: SimulatedRobotMotion
    #: motion of body 1 at the instants, with all its derivatives; shape (N,)
    body1: BodyMotion
    #: hinge rate [rad/s]; shape (N,)
    psid: Array
    #: second derivative of psi [rad/s^2]; shape (N,)
    psidd: Array
    #: acceleration of free fall, world axes [m/s^2]
    gravity: tuple[float, ...]
    #: what holds body 1: "free", "pinned", "fixed", or "prescribed" if `base` was a callable
    base: str
    #: smallest and largest psi of the whole motion, between the instants too [rad]
    psi_range: tuple[float, float]
    #: impacts at rigid stops, in order of time, with the fields joint ("psi"), t [s], and the rates before and after
    #: [rad/s]; `loads` are without their forces
    impacts: tuple[Impact, ...]
    #: whether `until` ended the motion before the last instant that was asked for
    ended_by_event: bool

    @functools.cached_property
    def loads(self) -> dict[str, Array]:
        """Loads by name: hinge_torque, shape (N,), force1, torque1, force2 and torque2, (N, 3); and the parts of
        hinge_torque: motor_torque, and spring_torque, damper_torque, friction_torque and stop_torque where there are
        any, (N,).
        """
        loads, nothing = self.robot_motion.loads, read_only(np.zeros((len(self.psi), 3)))
        bodies = {name: loads.get(name, nothing) for name in (*ON_BASE, *ON_BODY2)}
        parts = {f"{name}_torque": loads[name][:, 0] for name in TORQUE_PARTS if name in loads}
        return {**bodies, "hinge_torque": loads["tau"][:, 0], **parts}

    @property
    def error_estimate(self) -> float:
        """Estimated error of body 1's attitude at the worst instant [rad], from a second run with a
        thousandth of the tolerance at first access; 0 if the base is fixed or prescribed. `psi_error_estimate` is
        that of psi.
        """
        return self.robot_motion.attitude_error_estimate

    @property
    def psi_error_estimate(self) -> float:
        """Estimated error of psi at the worst instant [rad], as `error_estimate`."""
        return float(self.robot_motion.q_error_estimate[0])

    def __repr__(self) -> str:
        text = super().__repr__()
        return f"{text[:-1]}, ended by until)" if self.ended_by_event else text

    def energy(self) -> Energy:
        """Compute the kinetic and potential energy of all bodies that have mass properties, (N,) each."""
        return self.pair.energy(self.body1, self.psi, self.psid, gravity=self.gravity)

    def energy_balance(self) -> EnergyBalance:
        """Compute the energy balance at the first call, keep it, and return this EnergyBalance: the work of each load
        since the first instant, and the energies. `print` shows it as a table.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=hp.Body(1.0, inertia=(1, 1, 1)))
        >>> start, load = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), hp.HingeLoad(friction=0.5)
        >>> wheel = hp.simulate(pair, np.linspace(0, 4, 9), start, 0.0, 1.0, hinge_torque=load, base="fixed")
        >>> wheel.energy_balance().work["friction"].round(6).tolist()
        [0.0, -0.21875, -0.375, -0.46875, -0.5, -0.5, -0.5, -0.5, -0.5]
        """
        return self.robot_motion.energy_balance()

    def momentum(self) -> Momentum:
        """Compute the linear and angular momentum, (N, 3) each.

        Raises:
            ArgumentError: a body has no mass properties.
        """
        return self.pair.momentum(self.body1, self.psi, self.psid)

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return arrays (N, ...) by name: the outputs of the state, the motion of body 1, psi, psid, psidd and
        hinge_torque.
        """
        body1 = {f"{letter}1": getattr(self.body1, letter) for letter in ("R", "S", "v", "omega", "a", "alpha")}
        rates = {"psi": self.psi, "psid": self.psid, "psidd": self.psidd}
        return {**self.state.arrays(), **body1, **rates, "hinge_torque": self.loads["hinge_torque"]}
