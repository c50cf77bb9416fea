"""The motion of a pair under what acts on it: from its start to any instant, by steps of Gauss collocation."""

from __future__ import annotations

import functools
import itertools
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hingepair.dynamics.bases import Course, HingeMotion, PairMotion, Start, hinge_motion
from hingepair.dynamics.collocation import Array, Stepper, TooStiffError
from hingepair.dynamics.energy_balance import BalanceOnDemand, EnergyBalance, Leg, energy_balance
from hingepair.dynamics.loads import Base, Load, Loads
from hingepair.dynamics.switches import HingeSwitches, Until
from hingepair.engine.backend import execution_of
from hingepair.errors import ArgumentError, HingePairError, quoted
from hingepair.integration.trajectory import LazyValue, PlanarTrajectory, Trajectory
from hingepair.numeric.arrays import check_choice, finite_number, read_only, real_array
from hingepair.numeric.instants import instants_of
from hingepair.numeric.suspicions import degree_suspicions, inertia_suspicions
from hingepair.pair.body import DynamicsWarning
from hingepair.pair.body_motion import BodyMotion, motion_arrays, motion_of_rotations
from hingepair.pair.constants import check_one, check_pair
from hingepair.pair.dynamics import GRAVITY, Energy, Momentum
from hingepair.pair.forward_kinematics import Outputs
from hingepair.pair.hinge_load import HingeLoad, HingeTorque, check_callable
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PLANAR_GRAVITY, PlanarPair

BASES: Final = ("free", "pinned", "fixed")
_TOLERANCES: Final = (1e-14, 1e-2)
_PLANAR = "hp.BodyMotion(R=(x, y, 0), S=hp.rodrigues((0, 0, 1), phi))"
_MIN_STOP_DEPTH = 0.02  # rad past a stop, from which on a warning or a note says so
_FINER = 1e-3  # of the tolerance: the second run that the first is judged by
_LOOKS: Final = (
    509 * 17,
    4.3,
)  # at loads that are callables, over a whole motion; so many times as often in that run
_WINDOW, _MAX_TRIALS = 1000, 1e6  # trial steps after which progress is looked at; more to come are refused


class SimulationError(HingePairError, RuntimeError):
    """The motion cannot be followed any further.

    Attributes:
        t: how far it was followed [s].
        why: what happened there.
    """

    def __init__(self, t: float, why: str) -> None:
        self.t = t
        self.why = why
        super().__init__(f"the motion cannot be followed past t = {t!r}: {why}")

    def __reduce__(self) -> tuple[type, tuple[float, str]]:
        return type(self), (self.t, self.why)


@dataclass(frozen=True, eq=False, repr=False)
class _Moved:
    """What a simulated motion has beside a trajectory."""

    body1: BodyMotion
    psid: Array
    psidd: Array
    loads: Mapping[str, Array]
    space: HingePair
    gravity: tuple[float, ...]
    base: str
    psi: Array
    ended_by_event: bool
    _error: LazyValue
    _balance: BalanceOnDemand

    @property
    def error_estimate(self) -> float:
        """How far the attitude of body 1, or its angle phi, is off at the worst instant [rad]; not psi.

        0 where the base is fixed or moves as given: all there is to know is then in `psi_error_estimate`. Both come
        from a second run, of a thousandth of the tolerance, when the first of them is asked for.
        """
        return self._error()

    def __repr__(self) -> str:
        text = super().__repr__()
        return f"{text[:-1]}, ended by until)" if self.ended_by_event else text

    def energy(self) -> Energy:
        """Kinetic and potential energy at the instants, of each body that has mass properties (D7)."""
        return self.space.energy(self.body1, self.psi, self.psid, self.gravity)

    def energy_balance(self) -> EnergyBalance:
        """Compute the work of each load since the first instant, beside the energies; `print` shows it.

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
        """Linear and angular momentum at the instants, of a pair whose bodies both have mass properties (D8)."""
        return self.space.momentum(self.body1, self.psi, self.psid)

    def _hinge(self) -> dict[str, Array]:
        """The motion of the hinge and the torque at it, by name."""
        return {"psi": self.psi, "psid": self.psid, "psidd": self.psidd, "hinge_torque": self.loads["hinge_torque"]}


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedMotion(_Moved, Trajectory):
    """The motion of a pair that `simulate` found: a `Trajectory`, the motion of body 1 and the hinge, and the loads.

    Attributes:
        body1: motion of body 1 at the instants, with all its derivatives; shape (N,).
        psid: hinge rate [rad/s]; shape (N,).
        psidd: its rate [rad/s^2]; shape (N,).
        loads: what acted, by name: hinge_torque, shape (N,), force1, torque1, force2 and torque2, (N, 3); of a
            `HingeLoad` also the parts of hinge_torque: motor_torque, and spring_torque, damper_torque,
            friction_torque and stop_torque where there are any, (N,).
        space: the pair, in space, and of a PlanarPair of bodies that stay in the plane.
        gravity: acceleration of free fall, in space [m/s^2].
        base: what holds body 1: "free", "pinned", "fixed", or "prescribed" where it moves as given.
        ended_by_event: whether `until` ended the motion before the last instant that was asked for.
    """

    def recorded(self) -> dict[str, NDArray[Any]]:
        """The outputs of the state, the motion of body 1 and that of the hinge, by name; shape (N, ...)."""
        body1 = {f"{letter}1": getattr(self.body1, letter) for letter in ("R", "S", "v", "omega", "a", "alpha")}
        return {**self.state.arrays(), **body1, **self._hinge()}


@dataclass(frozen=True, eq=False, repr=False)
class SimulatedPlanarMotion(_Moved, PlanarTrajectory):
    """The motion of a planar pair that `simulate` found: a `PlanarTrajectory`, and what a `SimulatedMotion` has."""

    def recorded(self) -> dict[str, NDArray[Any]]:
        """The outputs of the state, the motion of body 1 and that of the hinge, by name; shape (N, ...)."""
        return {**self.state.arrays(), "phi": self.phi, **self._hinge()}


def simulate(
    pair: HingePair | PlanarPair,
    t: ArrayLike,
    body1: BodyMotion | None,
    psi_0: float | None = None,
    psid_0: float | None = None,
    *,
    hinge: str | HingeMotion = "free",
    hinge_torque: HingeTorque = 0.0,
    force1: Load = 0,
    torque1: Load = 0,
    force2: Load = 0,
    torque2: Load = 0,
    gravity: ArrayLike | None = None,
    base: Base = "free",
    breaks: ArrayLike = (),
    until: Until | None = None,
    tol: float = 1e-10,
    outputs: Outputs = None,
    backend: str = "auto",
) -> SimulatedMotion | SimulatedPlanarMotion:
    """The motion of a pair under what acts on it (D1-D6), from its start at t[0].

    Steps of Gauss collocation of order 16, their lengths chosen by the tolerance; attitudes on the rotation group. A
    free pair on which nothing acts keeps its momenta to the last bit. The limits of the pair do not stop the motion;
    `HingeLoad(stops=pair.limits)` does. A `DynamicsWarning` says where a motion leaves a limit that no stop guards,
    and where it presses far into a stop.

    Args:
        pair: a pair whose bodies have mass properties (body 2 alone where the base is fixed or moves as given). A
            PlanarPair takes forces and gravity of two components and torques of one; its body 1 starts, and is
            looked at by loads, as in space: R in the plane z = 0, S a turn about z, such as
            hp.BodyMotion(R=(x, y, 0), S=hp.rodrigues((0, 0, 1), phi)).
        t: instants [s], increasing; shape (N,).
        body1: where body 1 starts: R and S, and v and omega unless they are zero. None beside a base that moves.
        psi_0: hinge angle at t[0] [rad]. None beside a hinge that moves as given.
        psid_0: hinge rate at t[0] [rad/s]; likewise.
        hinge: "free", which turns as the loads make it; or a callable of times (n,) that returns psi, psi' and psi'',
            each (n,): then the hinge_torque that it takes is among the loads of the result.
        hinge_torque: of body 1 on body 2 about the hinge axis [N m]: a number, a `HingeLoad` (spring, damper,
            friction, stops), or any callable of arrays (t, psi, psid), each (n,), that returns (n,).
        force1: on body 1 at R1, world axes [N]: shape (3,), the number 0, or a callable of (t, now) that returns
            (n, 3); `now` has R1, S1, v1, omega1, psi and psid at the instants t.
        torque1: on body 1, world axes [N m]; likewise.
        force2: on body 2 at R2, world axes [N]; likewise.
        torque2: on body 2, world axes [N m]; likewise.
        gravity: acceleration of free fall, world axes [m/s^2]; shape (3,), along -z unless given; in the plane (2,),
            along -y.
        base: "free"; "pinned", where R1 stays where it starts and body 1 turns about it (in space as in a ball
            joint); "fixed", where body 1 stays as it starts; or a callable of times (n,) that returns the
            BodyMotion of body 1, with v, omega, a and alpha.
        breaks: instants at which loads jump [s]; shape (M,). Steps end there, and what a callable gives is asked for
            beside them. Without them, pulses are found that are longer than 1/8000 of the motion, or at an instant.
        until: ends the motion where its value passes 0: a callable of (t, now), as of a force, that returns (n,).
            The instant is the last of the result. An attribute `direction` as of SciPy's events: 1, where it
            rises; -1, where it falls; 0, both. Where an impact makes the value jump across 0, the result ends with
            the motion before the impact. A value that comes to 0 at a rigid stop, or where friction stops the hinge,
            has passed 0, even if it stays there or turns back. Elsewhere a value that only touches 0 is not seen:
            of a turning point return now.psid, and of a quantity that stays at 0, such as np.maximum(1 - now.psi,
            0), what goes on below it, 1 - now.psi.
        tol: largest error of a step [rad], of positions in units of the pair's levers; from 1e-14 to 1e-2.
        outputs: as for `forward_kinematics`; all of body 2 unless given.
        backend: as for `forward_kinematics`.

    Returns:
        A `Trajectory` (`.t`, `.S1`, `.psi`, `.R2`, ...; of a PlanarPair a `PlanarTrajectory`), and `.body1`, `.psid`,
        `.psidd`, `.loads` (what acted), `.ended_by_event` (whether `until` ended the motion), `.energy()`,
        `.momentum()` and `.energy_balance()`; `.error_estimate` of the attitude of body 1 - 0 where that is given -
        and `.psi_error_estimate` of psi [rad] come from a second run, of a smaller tolerance, when they are asked
        for.

    Raises:
        ArgumentError: an argument cannot be used; names it.
        SimulationError: the motion cannot be followed any further; has the instant.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> rod = hp.Body(mass=2, inertia=np.diag([0.01, 1, 1]))
    >>> pair = hp.HingePair(u1=(0, 0, 0), u2=(-1, 0, 0), n=(0, 1, 0), body2=rod)
    >>> start = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
    >>> swing = hp.simulate(pair, np.linspace(0, 2, 201), start, psi_0=0.0, psid_0=0.0, base="fixed")
    >>> round(float(swing.psi.max()), 4)  # let go level, it swings to level on the other side
    3.1416
    """
    space = in_space(pair)
    instants = instants_of("t", t)
    tolerance = finite_number("tol", tol)
    if not _TOLERANCES[0] <= tolerance <= _TOLERANCES[1]:
        raise ArgumentError("tol", f"a number from {_TOLERANCES[0]} to {_TOLERANCES[1]}", tol)
    flat = space is not pair
    if gravity is None:
        gravity = PLANAR_GRAVITY if flat else GRAVITY
    forces = {"force1": force1, "torque1": torque1, "force2": force2, "torque2": torque2}
    driven = None if isinstance(hinge, str) else hinge
    loads = Loads(forces, hinge_torque if driven is None else HingeLoad(), gravity, flat=flat)
    if until is not None:
        check_callable("until", until, "t", "now")
    jumps = np.sort(real_array("breaks", breaks).astype(np.float64))
    if jumps.ndim != 1 or not np.isfinite(jumps).all():
        raise ArgumentError("breaks", "instants at which loads jump [s], shape (M,)", quoted(breaks))
    angles = _angles_of(hinge, hinge_torque, instants, psi_0, psid_0)
    start = start_of(base, body1, flat, *angles)
    if not loads.rigid_range[0] <= start[4] <= loads.rigid_range[1]:
        expected = f"an angle between the rigid stops, {loads.rigid_range[0]:g} to {loads.rigid_range[1]:g} rad"
        raise ArgumentError("psi_0", expected, psi_0)
    how = execution_of(backend, 1)

    def run(tolerance: float, looks: float, until: Until | None) -> tuple[PairMotion, Array, list[Leg], Course, bool]:
        motion = PairMotion(space, base, flat, start, loads, how, driven)
        begin, legs, ended = motion.state, list[Leg](), None
        if len(instants) > 1:
            legs, ended = _follow(motion, instants, _Task(tolerance, looks, jumps, until))
        read_at = instants
        if ended is not None:
            read_at = np.unique(np.hstack([instants[instants - instants[0] < ended], instants[0] + ended]))
        return motion, begin, legs, _read(motion, begin, legs, read_at), ended is not None

    motion, begin, legs, found, ended_by_event = run(tolerance, _LOOKS[0], until)
    stops = hinge_torque.tightest_stops if isinstance(hinge_torque, HingeLoad) else (-np.inf, np.inf)
    _warn_of_units(space, base, start, stops)
    if space.limits is not None:
        _warn_of_limits(space.limits, stops, found.t, found.now.psi)
    least, most = found.now.psi.min(initial=np.inf), found.now.psi.max(initial=-np.inf)
    if soft := passed_stops(stops, float(least), float(most)):
        warnings.warn(f"{soft}; HingeLoad(stop_stiffness=...) hardens them", DynamicsWarning, stacklevel=2)
    instants = found.t
    finer = functools.cache(lambda: run(max(tolerance * _FINER, 1e-15), _LOOKS[0] * _LOOKS[1], None)[3])
    now = found.now
    moved = motion_of_rotations(R=now.R1, S=now.S1, v=now.v1, omega=now.omega1, a=found.a1, alpha=found.alpha1)
    common: dict[str, Any] = {
        "t": read_only(instants),
        "psi": read_only(now.psi),
        "method": "collocation",
        "steps": found.steps,
        "ended_by_event": ended_by_event,
        "_error": LazyValue(lambda: _angle_between(found.quats, finer().quats)),
        "_psi_error": LazyValue(lambda: float(np.abs(now.psi - finer().now.psi).max(initial=0.0))),
        "_balance": BalanceOnDemand(
            lambda: energy_balance(motion, begin, legs, found.t, space, loads.known["gravity"], found)
        ),
        "body1": moved,
        "psid": read_only(now.psid),
        "psidd": read_only(found.psidd),
        "loads": {name: read_only(np.array(load)) for name, load in found.loads.items()},
        "space": space,
        "gravity": loads.known["gravity"],
        "base": "prescribed" if callable(base) else base,
    }
    if isinstance(pair, PlanarPair):
        q, qd = (*now.R1.T[:2], found.phi, now.psi), (*now.v1.T[:2], now.omega1[:, 2], now.psid)
        qdd = (*found.a1.T[:2], found.alpha1[:, 2], found.psidd)
        planar = pair.forward_kinematics(q, qd, qdd, outputs=outputs, backend=backend)
        return SimulatedPlanarMotion(**common, phi=read_only(found.phi), state=planar)
    state = pair.forward_kinematics_from_body1(
        moved, now.psi, now.psid, found.psidd, outputs=outputs, backend=backend
    )
    return SimulatedMotion(**common, quat_wxyz=read_only(found.quats), R1=moved.R, pair=pair, state=state)


def in_space(pair: object) -> HingePair:
    """Return the pair that moves in space.

    Raises:
        ArgumentError: it is no pair, or several.
    """
    if isinstance(pair, PlanarPair):
        check_one(pair)
        return pair.massive()
    check_pair(pair)
    check_one(pair)
    return pair  # type: ignore[return-value]


def _angles_of(
    hinge: object, hinge_torque: object, t: Array, psi_0: float | None, psid_0: float | None
) -> tuple[float, float]:
    """Return psi and psi' at the start."""
    if isinstance(hinge, str):
        check_choice("hinge", hinge, ("free",))
        return finite_number("psi_0", psi_0), finite_number("psid_0", psid_0)
    check_callable("hinge", hinge, "t")  # type: ignore[arg-type]
    for name, value in (("psi_0", psi_0), ("psid_0", psid_0)):
        if value is not None:
            raise ArgumentError(name, "None beside a hinge that moves as given", quoted(value))
    if callable(hinge_torque) or np.any(hinge_torque != 0):
        raise ArgumentError("hinge_torque", "none beside a hinge that moves as given", quoted(hinge_torque))
    psi, psid, _ = hinge_motion(hinge, t[:1])  # type: ignore[arg-type]
    return finite_number("psi_0", psi[0]), finite_number("psid_0", psid[0])


def start_of(base: Base, body1: object, flat: bool, psi: float, psid: float) -> Start:
    """Return where body 1 and the hinge start; of a base that moves as given, body 1 is left open.

    Raises:
        ArgumentError: base or body1 cannot be used; names it.
    """
    zero = np.zeros(3)
    if callable(base):
        check_callable("base", base, "t")
        if body1 is not None:
            raise ArgumentError("body1", "None beside a base that moves as given", quoted(body1))
        return zero, np.eye(3), zero, zero, psi, psid
    check_choice("base", base, BASES)
    if not isinstance(body1, BodyMotion):
        where = _PLANAR if flat else "hp.BodyMotion(R=(x, y, z), S=np.eye(3))"
        raise ArgumentError("body1", f"where body 1 starts, a BodyMotion such as {where}", quoted(body1))
    motion_arrays("body1", body1, "S")
    if body1.shape != ():
        expected = f"one start, such as {_PLANAR if flat else 'BodyMotion(R=(0, 0, 0), S=np.eye(3))'}"
        raise ArgumentError("body1", expected, f"shape {body1.shape}")
    R, S, v, omega = (zero if x is None else x.astype(np.float64) for x in (body1.R, body1.S, body1.v, body1.omega))
    none = {"free": (), "pinned": ("v",), "fixed": ("v", "omega")}[base]
    for name, speed in (("v", v), ("omega", omega)):
        if name in none and speed.any():
            raise ArgumentError(f"body1.{name}", f"none, of a base that is {base}", speed)
    if flat and (R[2] or v[2] or omega[:2].any() or S[2, 2] != 1):
        expected = f"a start in the plane, R and v with z = 0, S and omega about z, such as {_PLANAR}"
        raise ArgumentError("body1", expected, quoted(body1))
    return R, S, v, omega, psi, psid


def _warn_of_units(space: HingePair, base: Base, start: Start, stops: tuple[float, float]) -> None:
    """Warn of numbers that look like degrees, or like inertias in another unit than kg m^2."""
    ends = np.array([stop for stop in stops if np.isfinite(stop)])
    found = [*degree_suspicions("stops", ends), *degree_suspicions("psi_0", np.array([start[4]]))]
    found += degree_suspicions("psid_0", np.array([start[5]]), rates=True)
    found += degree_suspicions("body1.omega", start[3], rates=True)
    bodies = {"body1": (space.body1, space.u1), "body2": (space.body2, space.u2)}
    for name in ("body1", "body2") if base in BASES[:2] else ("body2",):
        body, lever = bodies[name]
        if body is not None:
            levers = [float(np.linalg.norm(vector)) for vector in (lever, body.center_of_mass)]
            levers.append(float(np.linalg.norm(lever - body.center_of_mass)))
            found += inertia_suspicions(f"{name}.inertia", body.mass, body.inertia, max(levers))
    for sentence in found:
        warnings.warn(sentence, DynamicsWarning, stacklevel=3)


def _warn_of_limits(limits: tuple[float, float], stops: tuple[float, float], t: Array, psi: Array) -> None:
    """Warn where psi [rad] leaves a limit that no stop guards: a stop that lies beyond its limit does not."""
    lower = -np.inf if stops[0] >= limits[0] else limits[0]
    upper = np.inf if stops[1] <= limits[1] else limits[1]
    outside = np.flatnonzero((psi < lower) | (psi > upper))
    if outside.size:
        where = f"t = {t[outside[0]]:g} s (psi = {psi[outside[0]]:.6g} rad)"
        left = f"psi leaves the pair's limits, {limits[0]:g} to {limits[1]:g} rad, first at {where}"
        warnings.warn(f"{left}; HingeLoad(stops=pair.limits) enforces them", DynamicsWarning, stacklevel=3)


def passed_stops(stops: tuple[float, float], least: float, most: float) -> str:
    """Return a sentence on how far psi [rad] passes the stops; an empty text where they yield less than 0.02 rad."""
    depth = max(stops[0] - least, most - stops[1])
    return f"psi passes the stops by {depth:.3g} rad, for they are springs" if depth > _MIN_STOP_DEPTH else ""


class _Task(NamedTuple):
    """How a motion is followed."""

    tol: float  # largest error of a step [rad]
    looks: float  # how often a load that is a callable is looked at over the whole motion, at least
    breaks: Array  # instants at which loads jump, increasing
    until: Until | None  # the user's event


def _follow(motion: PairMotion, t: Array, task: _Task) -> tuple[list[Leg], float | None]:
    """Follow the motion from t[0] to t[-1]: its steps, and after which time the user's event ended it, if it did."""
    start, since = float(t[0]), t - t[0]
    span = float(since[-1])
    switches = HingeSwitches(motion, start, task.tol, task.until)
    breaks = [float(x) for x in task.breaks - start if 0 <= x <= span]
    beside, window = 8 * np.spacing(max(abs(start), abs(start + span))), np.zeros(2)
    looked = bool(motion.callables or task.until)
    stepper = Stepper(
        lambda since, states: motion.rates(start + np.clip(since, *window), states),
        switches if switches.needed else None,
        0.0,
        motion.state,
        motion.sizes,
        motion.speeds,
        motion.angle,
        task.tol,
        motion.first_step(start, span),
        span / task.looks if looked else np.inf,
        since if looked else np.empty(0),
    )
    legs, trials, reached = list[Leg](), 0, 0.0
    for begin, end in itertools.pairwise(sorted({0.0, *breaks, span})):
        window[:] = begin + beside * (begin in breaks), end - beside * (end in breaks)  # loads jump at a break
        while stepper.t < end:
            quat = motion.quat
            try:
                piece = stepper.step(end)
            except TooStiffError as error:
                why = f"steps became too short; {_reason(motion, start, stepper)}"
                raise SimulationError(start + error.t, why) from None
            if piece is not None:
                legs.append(Leg(piece, quat, motion.side, motion.held))
                stepper.switch()
            if stepper.ended:
                return legs, stepper.t
            stepper.turn(motion.renew(stepper.state))
            if stepper.trials >= trials + _WINDOW:
                missing = (span - stepper.t) / (stepper.t - reached) * (stepper.trials - trials)
                if missing > _MAX_TRIALS:
                    why = f"some {missing:.0g} more steps would be needed; {_reason(motion, start, stepper)}"
                    raise SimulationError(start + stepper.t, why)
                trials, reached = stepper.trials, stepper.t
    return legs, None


def _read(motion: PairMotion, start: Array, legs: list[Leg], t: Array) -> Course:
    """Read a motion out at instants, the first of which is that of the start."""
    states, quats, since = np.empty((len(t), len(start))), np.empty((len(t), 4)), t - t[:1]
    sides, held, place = np.zeros((len(t), 2)), np.zeros(len(t), bool), 1
    if legs:
        states[:1], quats[:1], sides[:1], held[:1] = start, legs[0].quat, legs[0].side, legs[0].held
    else:
        states[:], quats[:], sides[:], held[:] = start, motion.quat, motion.side, motion.held
    for leg in legs:
        end = int(np.searchsorted(since, leg.piece.start + leg.piece.length, side="right"))
        if leg is legs[-1]:
            end = len(t)
        states[place:end], quats[place:end] = leg.piece.at(since[place:end]), leg.quat
        sides[place:end], held[place:end] = leg.side, leg.held
        place = max(place, end)
    return motion.read(t, states, quats, (sides[:, 0], sides[:, 1]), held)._replace(steps=len(legs))


def _reason(motion: PairMotion, start: float, stepper: Stepper) -> str:
    """Return which load changes most within rounding of where a motion cannot be followed, and what to do."""
    nudges = {"t": 1e-9, "psi": 1e-9, "psi'": 1e-6}
    worst = (1e-3, "a load has no value, or the motion has no bound")
    t, states = np.full(2, start + stepper.t), np.stack([stepper.state] * 2)
    for name, nudge in nudges.items():
        times, moved = t.copy(), states.copy()
        if name == "t":
            times += np.array([-nudge, nudge]) * max(1.0, abs(t[0]))
            at, remedy = t[0], "breaks= names the instants at which loads jump"
        else:
            column = motion.angle + (name == "psi'")
            at, remedy = (
                states[0, column],
                "HingeLoad(friction=..., stops=...) has friction and stops that are followed",
            )
            moved[:, column] += np.array([-nudge, nudge]) * max(1.0, abs(at))
        for load, values in motion.acting(times, moved).items():
            low, high = values.reshape(2, -1)
            k = int(np.abs(high - low).argmax())
            change = float(abs(high[k] - low[k]) / max(abs(high[k]), abs(low[k]), 1e-300))
            if not change <= worst[0]:
                worst = change, f"{load} jumps from {low[k]:.6g} to {high[k]:.6g} at {name} = {at:.6g}; {remedy}"
    return worst[1]


def _angle_between(one: Array, other: Array) -> float:
    """The largest angle between attitudes, unit quaternions (n, 4)."""
    gap = np.minimum(np.linalg.norm(one - other, axis=-1), np.linalg.norm(one + other, axis=-1))
    return float((4 * np.arcsin(np.minimum(gap / 2, 1))).max(initial=0.0))
