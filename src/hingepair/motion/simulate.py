"""Simulation: the motion of a pair under loads, from its start to any instant, by steps of Gauss collocation."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body import DynamicsWarning
from hingepair.mechanism.bodies.body_motion import BodyMotion, motion_arrays, motion_of_rotations
from hingepair.mechanism.bodies.hinge_load import HingeLoad, HingeTorque, stop_range
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.geometry import check_pair, check_single_pair, constants_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PLANAR_GRAVITY, PlanarPair, dynamics_in_space
from hingepair.mechanism.pairs.requests import check_masses, pivot_limits
from hingepair.mechanism.states import Energy, Momentum
from hingepair.motion.energy_balance import EnergyBalance, LazyBalance, energy_balance
from hingepair.motion.equations_of_motion import RobotMotion, RobotSamples
from hingepair.motion.events import UserEvent
from hingepair.motion.given_loads import BODY2, LoadArgument, loads_of_pair, pair_loads
from hingepair.motion.given_motions import GivenBase, GivenJoint, JointCallable, check_rest
from hingepair.motion.loads import Loads, check_start
from hingepair.motion.robot_programs import RobotPrograms
from hingepair.motion.run import Impact, Simulation, joint_impacts, joint_range, read_options
from hingepair.motion.simulated import simulate_robot
from hingepair.motion.trajectory import LazyValue, PlanarTrajectory, Trajectory
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.arrays import check_choice, finite_number, read_only
from hingepair.plans.arguments import Outputs
from hingepair.tables.instants import instants_of
from hingepair.tables.suspicions import suspicions

BaseArgument: TypeAlias = str | Callable[[Array], BodyMotion]
"""What holds body 1, as users give it: the name of a base, or a callable of t that returns the motion of body 1."""
BASES: Final = ("free", "pinned", "fixed")  # what may hold body 1, beside a callable
_PLANAR_START = "hp.BodyMotion(R=(x, y, 0), S=hp.rodrigues((0, 0, 1), phi))"  # in messages


class InitialState(NamedTuple):
    """Motion of body 1 and the hinge at the start."""

    R: Array
    S: Array
    v: Array
    omega: Array
    psi: float  # [rad]
    psid: float  # [rad/s]


@dataclass(frozen=True, eq=False, repr=False)
class _SimulatedMotionBase:
    """What simulated motions of spatial and of planar pairs share."""

    body1: BodyMotion
    psid: Array
    psidd: Array
    loads: Mapping[str, Array]
    space: HingePair
    gravity: tuple[float, ...]
    base: str
    psi: Array
    psi_range: tuple[float, float]
    impacts: tuple[Impact, ...]
    ended_by_event: bool
    _error: LazyValue
    _balance: LazyBalance

    @property
    def error_estimate(self) -> float:
        """Estimated error of body 1's attitude or angle phi at the worst instant [rad], from a second run with a
        thousandth of the tolerance at first access; 0 if the base is fixed or prescribed. `psi_error_estimate` is
        that of psi.
        """
        return float(self._error())

    def __repr__(self) -> str:
        text = super().__repr__()
        return f"{text[:-1]}, ended by until)" if self.ended_by_event else text

    def energy(self) -> Energy:
        """Compute the kinetic and potential energy of all bodies that have mass properties, (N,) each."""
        return self.space.energy(self.body1, self.psi, self.psid, gravity=self.gravity)

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
        return self._balance()

    def momentum(self) -> Momentum:
        """Compute the linear and angular momentum, (N, 3) each.

        Raises:
            ArgumentError: a body has no mass properties.
        """
        return self.space.momentum(self.body1, self.psi, self.psid)

    def _hinge_quantities(self) -> dict[str, Array]:
        return {"psi": self.psi, "psid": self.psid, "psidd": self.psidd, "hinge_torque": self.loads["hinge_torque"]}


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedMotion(_SimulatedMotionBase, Trajectory):
    """The motion of a pair, as `simulate` returns it: a `Trajectory` with rates and loads.

    Attributes:
        body1: motion of body 1 at the instants, with all its derivatives; shape (N,).
        psid: hinge rate [rad/s]; shape (N,).
        psidd: second derivative of psi [rad/s^2]; shape (N,).
        loads: loads by name: hinge_torque, shape (N,), force1, torque1, force2 and torque2, (N, 3); and the parts of
            hinge_torque: motor_torque, and spring_torque, damper_torque, friction_torque and stop_torque where there
            are any, (N,).
        space: the pair; for a PlanarPair, the HingePair with the same planar dynamics.
        gravity: acceleration of free fall, world axes [m/s^2]; three components.
        base: what holds body 1: "free", "pinned", "fixed", or "prescribed" if `base` was a callable.
        psi_range: smallest and largest psi of the whole motion, between the instants too [rad].
        impacts: impacts at rigid stops, in order of time, with the fields joint ("psi"), t [s], and the rates before
            and after [rad/s]. `loads` are without their forces.
        ended_by_event: whether `until` ended the motion before the last instant that was asked for.
    """

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return arrays (N, ...) by name: the outputs of the state, the motion of body 1, psi, psid, psidd and
        hinge_torque.
        """
        body1 = {f"{letter}1": getattr(self.body1, letter) for letter in ("R", "S", "v", "omega", "a", "alpha")}
        return {**self.state.arrays(), **body1, **self._hinge_quantities()}


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedPlanarMotion(_SimulatedMotionBase, PlanarTrajectory):
    """The motion of a planar pair: a `PlanarTrajectory` with the further fields of a `SimulatedMotion`."""

    def recorded(self) -> dict[str, NDArray[Any]]:
        """Return arrays (N, ...) by name: the outputs of the state, phi, psi, psid, psidd and hinge_torque."""
        return {**self.state.arrays(), "phi": self.phi, **self._hinge_quantities()}


@functools.singledispatch
def simulate(
    pair: HingePair | PlanarPair,
    t: ArrayLike,
    body1: BodyMotion | None,
    psi_0: float | None = None,
    psid_0: float | None = None,
    *,
    hinge: str | JointCallable = "free",
    hinge_torque: HingeTorque = 0.0,
    force1: LoadArgument = 0,
    torque1: LoadArgument = 0,
    force2: LoadArgument = 0,
    torque2: LoadArgument = 0,
    gravity: ArrayLike | None = None,
    base: BaseArgument = "free",
    breaks: ArrayLike = (),
    until: UserEvent | None = None,
    tol: float = 1e-10,
    max_steps: int = 30_000,
    outputs: Outputs = None,
    backend: str = "auto",
) -> SimulatedMotion | SimulatedPlanarMotion:
    """Simulate the motion of a pair under loads (D1-D6) at the instants t, from the state (body1, psi_0, psid_0) at
    t[0], or the motion of a robot (T1-T6) by `hp.simulate(robot, t, q0, qd0, tau=...)`, whose arguments are below.

    The method is Gauss collocation of order 16, with attitudes on the rotation group. If `base` is "free" and no
    gravity and no external load acts, momentum and angular momentum are kept to rounding. Dry friction of several
    joints is solved at once, and impacts at rigid stops are felt by all joints.

    The `limits` of the pair and the `position_limits` of a robot do not stop the motion; the `stops` of a `HingeLoad`
    do. A `DynamicsWarning` is issued if a coordinate passes a limit at which there is no stop, or passes a stop by
    more than 0.02 rad.

    Of a robot, `t`, `gravity`, `breaks`, `until`, `tol`, `max_steps` and `backend` are as for pairs. The others are

    - `q0`: coordinates at t[0] [rad, m]; shape (dof,), or a dict by joint.
    - `qd0`: rates at t[0], in the same form; 0 by default.
    - `tau`: efforts at the joints [N m, N]: a number or shape (dof,), held; a dict by joint; a callable of (t, now)
      that returns (n, dof), such as ``lambda t, now: -50 * (now.q - 0.3)``; or a `Feedback` with constant references.
      There t is an array of n instants, and `now` has the attributes q and qd, (n, dof), R1, S1, v1 and omega1 of the
      base, and base_motion, a BodyMotion of these. The rate of the second joint is ``now.qd[:, 1]``.
    - `loads`: `HingeLoad`s by joint: springs, dampers, dry friction, stops, motors that depend on the joint alone.
      They add to tau; those of a joint that follows another act on its leader. For a slider, read m for rad and N for
      N m. `robot.joint_loads` are those that a URDF or MJCF describes, with stops at the limits.
    - `joint_loads`: in place of `loads`, whether the springs, dampers and dry friction that a file describes act,
      without stops, as for `inverse_dynamics`.
    - `driven`: motions of joints that move as given, by joint: callables of times (n,) that return the coordinate and
      its first two derivatives, (n,) each; the first must not jump. Their q0 and qd0 are those of the callable; no
      tau and no HingeLoad acts on them, and their part of `loads["motor"]` of the result is the effort that the
      motion needs.
    - `wrenches`: loads on links: (force, torque) by link, world axes, the force at the link's origin [N, N m]; each
      has shape (3,), is the number 0, or a callable of (t, now) that returns (n, 3).
    - `force1`, `torque1`: force at R1 and torque on a free or pinned base, world axes [N, N m], in the same forms.
    - `base`: "fixed" where `base_motion` is, "free", "pinned" (R1 stays, the base can turn about it) or "moving". By
      default that of the robot, or "moving" if `base_motion` is a callable.
    - `base_motion`: the base at t[0]: a BodyMotion of R and S, of a free base also v and omega; at rest at the origin
      by default. Of a moving base, a callable of times (n,) that returns a BodyMotion with all derivatives.
    - `frames`: names of the frames that `.state()` of the result computes by default; the last links unless given.

    Args:
        pair: a pair whose bodies have mass properties. If the base is fixed or a callable, only body 2 needs them.
            For a PlanarPair, a force or gravity has shape (2,), and a callable returns (n, 2); a torque is a number,
            and a callable returns (n,). The argument `body1` and
            the argument `now` of callables (see `force1`) have three-dimensional quantities also for a PlanarPair: R
            lies in the plane z = 0, and S is a rotation about z, such as hp.BodyMotion(R=(x, y, 0),
            S=hp.rodrigues((0, 0, 1), phi)).
        t: instants, increasing; shape (N,): seconds (floats), datetime64, or nanoseconds since 1970 (integers).
            datetime64 and integer nanoseconds are converted to seconds since the first one; callables and `breaks`
            use these seconds.
        body1: motion of body 1 at t[0] as a BodyMotion: R and S; v and omega are zero by default. None if `base` is a
            callable.
        psi_0: hinge angle at t[0] [rad]; required, except if `hinge` is a callable.
        psid_0: hinge rate at t[0] [rad/s]; required, except if `hinge` is a callable.
        hinge: "free" (the default): the loads determine the motion of the hinge. A callable of times (n,) that
            returns psi, psi' and psi'', each (n,), prescribes the motion of the hinge; psi' and psi'' must be the
            derivatives of psi, and psi' must not jump. The argument hinge_torque must then be 0, and
            `loads["hinge_torque"]` of the result is the torque that this motion needs.
        hinge_torque: torque that body 1 exerts on body 2 about the hinge axis [N m]: a number (0 by default), a
            `HingeLoad` (spring, damper, friction, stops), or a callable of arrays (t, psi, psid), each (n,), that
            returns (n,).
        force1: force on body 1 at R1, world axes [N]: shape (3,), the number 0 (the default), or a callable of
            (t, now) that returns (n, 3). There t is an array of n instants, and `now` has the attributes R1, S1, v1,
            omega1, psi and psid at these instants, such as now.R1 of shape (n, 3).
        torque1: torque on body 1, world axes [N m]; in the same form as force1.
        force2: force on body 2 at R2, world axes [N]; in the same form as force1.
        torque2: torque on body 2, world axes [N m]; in the same form as force1.
        gravity: acceleration of free fall, world axes [m/s^2]; (0, 0, -9.81) by default, for a PlanarPair
            (0, -9.81).
        base: what holds body 1, one of:

            - "free" (the default): nothing;
            - "pinned": R1 stays where it is at t[0], and body 1 can turn about R1, as on a ball joint (on a pin, for
              a PlanarPair);
            - "fixed": body 1 stays at its pose at t[0];
            - a callable of times (n,) that returns the BodyMotion of body 1, with v, omega, a and alpha, which must
              be the derivatives of R and S; v and omega must not jump.
        breaks: instants at which loads jump [s]; shape (M,); none by default. Steps end at these instants, and
            callables are evaluated just before and just after them. A pulse of a load whose instants are not given
            here is found if it is longer than 1/8000 of the simulated time or covers one of the instants t.
        until: event that ends the motion: a callable of (t, now), as for force1, that returns values (n,). The motion
            ends when the value passes 0, and this instant is the last one of the result. An attribute `direction` of
            the callable selects, as for SciPy's events, values that rise (1), that fall (-1), or both (0, the
            default). If an impact makes the value jump across 0, the result ends with the motion before the impact. A
            value that reaches 0 at a rigid stop, or where friction stops the hinge, counts as having passed 0, even
            if the value then stays at 0 or turns back. Everywhere else, a value that touches 0 without passing it is
            not found. For a turning point of psi, return now.psid. Return a quantity that goes below 0, such as
            1 - now.psi, instead of one that stays at 0, such as np.maximum(1 - now.psi, 0).
        tol: tolerance of each step, a number from 1e-14 to 1e-2; 1e-10 by default. The error of an angle in one step
            is at most tol [rad]. The error of a position is at most tol times the sum of the lengths of u1, u2 and
            both bodies' centre_of_mass [m], or times 1 m if all of them are zero.
        max_steps: largest number of steps tried, 30,000 by default, which take about a minute: a free swing needs
            some 20 a period, an impact some 5. A motion that needs more is a SimulationError. The second run for
            error estimates may take three times as many.
        outputs: tuple of the names of the outputs to compute, such as ("R2", "v2"), as for `forward_kinematics`. By
            default, all outputs of body 2.
        backend: "auto", "numpy" or "compiled", as for `forward_kinematics`.

    Returns:
        A `SimulatedMotion`, for a PlanarPair a `SimulatedPlanarMotion`, with `.t`, `.psi`, `.psid`, `.psidd`,
        `.body1`, `.loads`, `.ended_by_event`, `.energy()`, `.momentum()`, `.energy_balance()` and the outputs of body
        2, such as `.R2`. `.error_estimate` (of the attitude of body 1) and `.psi_error_estimate` [rad] come from a
        second run with a smaller tolerance, at the first access. A DynamicsWarning says that arguments seem to be in
        the wrong units. Of a robot, a `SimulatedRobotMotion` with `.t`, `.q`, `.qd`, `.qdd`, `.tau`, `.loads`,
        `.base_motion`, `.state()`, `["frame"]`, `.reactions()`, energies and error estimates. `.tau`, (N, dof),
        is the sum of all efforts at each joint, whose parts are in `.loads`: "motor" (`tau` and motors), "spring",
        "damper", "friction" and "stop", without the impulses at rigid stops.

    Raises:
        ArgumentError: an argument cannot be used; the error names it.
        SimulationError: the simulation cannot be continued; `t` of the error is the last instant that the simulation
            reached.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> rod = hp.Body(mass=2, inertia=np.diag([0.01, 1, 1]))
    >>> pair = hp.HingePair(u1=(0, 0, 0), u2=(-1, 0, 0), n=(0, 1, 0), body2=rod)
    >>> start = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
    >>> swing = hp.simulate(pair, np.linspace(0, 2, 201), start, psi_0=0.0, psid_0=0.0, base="fixed")
    >>> round(float(swing.psi.max()), 4)  # released level, it swings to level on the other side
    3.1416

    A robot with a controller, until its second joint has turned by 0.2 rad:

    >>> bodies = [hp.HingePair(u1, (-1, 0, 0), (0, 1, 0), body2=rod) for u1 in ((0, 0, 0), (1, 0, 0))]
    >>> found = hp.simulate(
    ...     hp.Mechanism(bodies), [0, 1], q0=[0, 0], tau=lambda t, now: -50 * now.q - 5 * now.qd,
    ...     until=lambda t, now: now.q[:, 1] - 0.2,
    ... )
    >>> found.ended_by_event, round(float(found.q[-1, 1]), 6)
    (True, 0.2)
    """
    space = to_spatial_pair(pair)
    instants = instants_of("t", t)
    options = read_options(tol, breaks, until, max_steps)
    is_planar = space is not pair
    gravity = (PLANAR_GRAVITY if is_planar else DEFAULT_GRAVITY) if gravity is None else gravity
    forces = {"force1": force1, "torque1": torque1, "force2": force2, "torque2": torque2}
    held, driven = read_base(base), {} if isinstance(hinge, str) else {0: GivenJoint("hinge", hinge)}
    loads = pair_loads(forces, HingeLoad() if driven else hinge_torque, gravity, is_planar=is_planar)
    if driven:
        initial_hinge = _given_start(driven[0], hinge_torque, instants, psi_0, psid_0)
    else:
        check_choice("hinge", hinge, ("free",))
        initial_hinge = finite_number("psi_0", psi_0), finite_number("psid_0", psid_0)
    start = initial_state(held, body1, is_planar, *initial_hinge)
    if isinstance(held, GivenBase):
        held.check(instants)
    check_start(loads, ["psi_0"], np.array([start.psi]))
    found = Simulation(pair_motion(space, held, start, loads, backend, driven), instants, options)
    samples = found.samples
    psi_range, passed = joint_range(found.run, 0, "psi", space.limits or (-np.inf, np.inf), options.tol)
    for sentence in (*_unit_doubts(space, held, start, stop_range(loads.joint_loads[0]), samples), *passed):
        warnings.warn(sentence, DynamicsWarning, stacklevel=3)
    body1_motion, psi, psid, psidd = samples.base, samples.motion.q[:, 0], samples.motion.qd[:, 0], samples.qdd[:, 0]
    fields: dict[str, Any] = {
        "t": read_only(samples.t),
        "psi": read_only(psi),
        "psi_range": psi_range,
        "impacts": tuple(joint_impacts(found.run, 0, "psi")),
        "method": "collocation",
        "steps": samples.steps,
        "ended_by_event": found.run.ended,
        "_error": LazyValue(found.attitude_error),
        "_psi_error": LazyValue(lambda: found.coordinate_error(0)),
        "_balance": LazyBalance(lambda: energy_balance(found.run)),
        "body1": body1_motion,
        "psid": read_only(psid),
        "psidd": read_only(psidd),
        "loads": {name: read_only(np.array(load)) for name, load in loads_of_pair(samples.loads).items()},
        "space": space,
        "gravity": loads.gravity,
        "base": "prescribed" if isinstance(held, GivenBase) else held,
    }
    if isinstance(pair, PlanarPair):
        now = samples.motion
        q, qd = (*now.R1.T[:2], samples.phi, psi), (*now.v1.T[:2], now.omega1[:, 2], psid)
        qdd = (*samples.a1.T[:2], samples.alpha1[:, 2], psidd)
        planar = pair.forward_kinematics(q, qd, qdd, outputs=outputs, backend=backend)
        return SimulatedPlanarMotion(**fields, phi=read_only(samples.phi), state=planar)
    state = pair.forward_kinematics_from_body1(body1_motion, psi, psid, psidd, outputs=outputs, backend=backend)
    return SimulatedMotion(**fields, quat_wxyz=read_only(samples.quats), R1=body1_motion.R, pair=pair, state=state)


simulate.register(Mechanism, cast(Any, simulate_robot))


def read_base(base: BaseArgument) -> str | GivenBase:
    """Return what holds body 1: one of BASES, or a motion that is given."""
    if callable(base):
        return GivenBase("base", base)
    check_choice("base", base, BASES)
    return base


def pair_motion(
    pair: HingePair,
    base: str | GivenBase,
    start: InitialState,
    loads: Loads,
    backend: str,
    driven: Mapping[int, GivenJoint] | None = None,
) -> Callable[[], RobotMotion]:
    """Return a function that makes the equations of motion of a pair, those of a robot of one joint, at its start.

    Raises:
        ArgumentError: a body that moves lacks mass properties, or nothing resists its motion.
    """
    robot = robot_of_pair(pair, base)
    at_start = motion_of_rotations(R=start.R, S=start.S, v=start.v, omega=start.omega)
    kind, base_motion = ("moving", base) if isinstance(base, GivenBase) else (base, at_start)
    programs = RobotPrograms(robot, kind, tuple(loads.wrenches), loads.gravity, backend)
    q, qd = np.array([start.psi]), np.array([start.psid])
    return functools.partial(RobotMotion, robot, kind, base_motion, q, qd, loads, programs, driven)


def robot_of_pair(pair: HingePair, base: str | GivenBase) -> Mechanism:
    """Return a pair as a robot of one joint, whose base is free if `base` is "free" or "pinned".

    Raises:
        ArgumentError: a body that moves lacks mass properties, or nothing resists its motion.
    """
    moves_body1 = base in ("free", "pinned")
    _check_masses(pair, moves_body1=moves_body1)
    return Mechanism([replace(pair, name=BODY2)], base="free" if moves_body1 else "fixed")


def to_spatial_pair(pair: object) -> HingePair:
    """Return a HingePair itself, or for a PlanarPair the HingePair in space with the same motion in the plane.

    Raises:
        ArgumentError: no pair, or several pairs.
    """
    if isinstance(pair, PlanarPair):
        check_single_pair(pair)
        return dynamics_in_space(pair)
    check_pair(pair)
    check_single_pair(pair)
    return pair  # type: ignore[return-value]


def _given_start(
    given: GivenJoint, hinge_torque: object, t: Array, psi_0: float | None, psid_0: float | None
) -> tuple[float, float]:
    """Check the motion of a hinge that moves as given, and return psi and psi' at the first instant."""
    given.check(t)
    for name, value in (("psi_0", psi_0), ("psid_0", psid_0)):
        if value is not None:
            raise ArgumentError(name, "None for a hinge that moves as given", quoted(value))
    if callable(hinge_torque) or np.any(hinge_torque != 0):
        raise ArgumentError("hinge_torque", "0 for a hinge that moves as given", quoted(hinge_torque))
    first = given.at(t[:1])
    return finite_number("psi_0", first["psi"][0]), finite_number("psid_0", first["psid"][0])


def initial_state(base: str | GivenBase, body1: object, is_planar: bool, psi: float, psid: float) -> InitialState:
    """Return the checked start, in which a body 1 that moves as given rests at the origin.

    Raises:
        ArgumentError: body1 cannot be used.
    """
    zero = np.zeros(3)
    if isinstance(base, GivenBase):
        if body1 is not None:
            raise ArgumentError("body1", "None for a base that moves as given", quoted(body1))
        return InitialState(zero, np.eye(3), zero, zero, psi, psid)
    if not isinstance(body1, BodyMotion):
        example = _PLANAR_START if is_planar else "hp.BodyMotion(R=(x, y, z), S=np.eye(3))"
        raise ArgumentError("body1", f"the start of body 1, a BodyMotion such as {example}", quoted(body1))
    motion_arrays("body1", body1, "S")
    if body1.shape != ():
        example = _PLANAR_START if is_planar else "BodyMotion(R=(0, 0, 0), S=np.eye(3))"
        expected = f"one start, such as {example}"
        raise ArgumentError("body1", expected, f"shape {body1.shape}")
    R, S, v, omega = (zero if x is None else x.astype(np.float64) for x in (body1.R, body1.S, body1.v, body1.omega))
    check_rest("body1", base, body1)
    if is_planar and (R[2] or v[2] or omega[:2].any() or S[2, 2] != 1):
        example = _PLANAR_START
        expected = f"a start in the plane, R and v with z = 0, S and omega about z, such as {example}"
        raise ArgumentError("body1", expected, quoted(body1))
    return InitialState(R, S, v, omega, psi, psid)


def _unit_doubts(
    pair: HingePair, base: str | GivenBase, start: InitialState, stops: tuple[float, float], samples: RobotSamples
) -> list[str]:
    """Return sentences on angles or rates that look like degrees, on instants that look like milliseconds, and on
    inertias that are probably not in kg m^2.
    """
    finite_stops = np.array([stop for stop in stops if np.isfinite(stop)])
    sentences = suspicions("written angles", "stops", finite_stops)
    sentences += suspicions("written angles", "limits", pair.limits or ())
    sentences += suspicions("sampled motion", "t", np.stack((samples.t, samples.motion.q[:, 0]), axis=-1))
    sentences += suspicions("written angles", "psi_0", start.psi)
    sentences += suspicions("written rates", "psid_0", start.psid)
    sentences += suspicions("written rates", "body1.omega", start.omega[None])
    bodies = {"body1": (pair.body1, pair.u1), "body2": (pair.body2, pair.u2)}
    for name in ("body1", "body2") if base in BASES[:2] else ("body2",):
        body, lever = bodies[name]
        if body is not None:
            levers = [float(np.linalg.norm(vector)) for vector in (lever, body.centre_of_mass)]
            levers.append(float(np.linalg.norm(lever - body.centre_of_mass)))
            radius = np.sqrt(np.linalg.eigvalsh(body.inertia)[-1] / body.mass)
            sentences += suspicions("gyration", f"{name}.inertia", [radius, max(levers)])
    return sentences


def _check_masses(pair: HingePair, *, moves_body1: bool) -> None:
    """Refuse a pair of which a body that moves has no mass properties, or whose motion nothing resists."""
    bodies = ({"body1": pair.body1} if moves_body1 else {}) | {"body2": pair.body2}
    check_masses(bodies, "; or base='fixed', for which body 2 suffices")
    of_hinge, *of_body1 = pivot_limits(constants_of(pair)) > 0  # sizes below which pivots are rounding
    if of_hinge or (moves_body1 and any(of_body1)):
        expected = "masses that resist every motion: body 2 has no inertia about the hinge axis, to round-off, or a"
        raise ArgumentError(
            "pair.body2", f"{expected} body's inertia is negligible relative to the other's", pair.body2
        )
