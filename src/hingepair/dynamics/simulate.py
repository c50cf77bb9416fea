"""The motion of a pair under what acts on it: steps of Gauss collocation over momenta and local coordinates.

The state of a free pair is the place of the common centre of mass, the linear momentum, the angular momentum about
that centre, the attitude of body 1 as Cayley coordinates g that begin anew with every step, psi and psi'. Where
nothing acts, the momenta are constants of the integration, not results of it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.dynamics.collocation import NODES, Array, Stepper, TooStiffError
from hingepair.dynamics.loads import Base, HingeTorque, Load, Loads, Moving
from hingepair.equations import dynamics as dyn
from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError, HingePairError, quoted
from hingepair.evaluation.backend import How, choose
from hingepair.evaluation.binding import Bound, bind
from hingepair.evaluation.loops import Loop
from hingepair.evaluation.plan import steps_of
from hingepair.evaluation.steps import Step
from hingepair.integration.trajectory import Later, Trajectory, rotations
from hingepair.numeric.arrays import check_choice, finite_number, one_constant, read_only, real_array
from hingepair.numeric.finite_differences import check_instants
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.constants import check_one, check_pair
from hingepair.pair.dynamics import FORWARD, GRAVITY, LEVERS, mass_constants
from hingepair.pair.evaluate import Outputs
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import matrix_to_quaternion

BASES: Final = ("free", "fixed")
_TOLERANCES: Final = (1e-14, 1e-2)
_FINER = 1e-3  # of the tolerance: the second run that the first is judged by
_ZERO = (0.0, 0.0, 0.0)
_Begin: TypeAlias = tuple[Array, Array, Array, Array]
_DOUBLE = np.dtype(np.float64)
_TAILS: Final[Mapping[str, tuple[int, ...]]] = {
    **dict.fromkeys(("psi", "psid", "psidd", "psi_torque", "m1", "m2"), ()),
    **dict.fromkeys(("S0", "home", "I1", "I2"), (9,)),
    **{"S1": (3, 3), "state": (14,)},
}
"""Shapes of inputs that are no vectors."""
_G = slice(9, 12)  # where the Cayley coordinates stand in the state of a free pair

_ATTITUDE = Step("S1", dyn.cayley_attitude, ("g", "S0"))
_CENTRE = (
    Step("centre", dyn.common_centre, ("masses", "centre1", "e")),
    Step("v_centre", dyn.velocity_from_centre, ("masses", "centre", "omega1", "push", "psid")),
)
_START = (
    *_CENTRE,
    Step("spins", lambda one, two: (one, two), ("omega1", "omega2")),
    Step("angular", dyn.momentum_about, ("masses", "centre1", "e", "inertias", "spins", "push", "psid")),
)
_STATE = (
    Step("momentum", lambda state: state[3:6], ("state",)),
    Step("angular", lambda state: state[6:9], ("state",)),
    Step("g", lambda state: state[9:12], ("state",)),
    Step("psi", lambda state: state[12], ("state",)),
    Step("psid", lambda state: state[13], ("state",)),
)
_FREE = (
    *_STATE,
    Step("omega1", dyn.spin_of_momentum,
         ("masses", "centre1", "e", "inertias", "axis", "push", "angular", "psid")),
    Step("g_rate", dyn.cayley_rate, ("g", "omega1")),
    *_CENTRE,
)  # fmt: skip
_LOADED = (
    _CENTRE[0],
    Step("from_centre", eq.subtract, ("d", "centre")),
    Step("by1", dyn.torque_from, ("torque1", "centre", "force1")),
    Step("by2", dyn.torque_about, ("torque2", "from_centre", "force2")),
    Step("twist", eq.add, ("by1", "by2")),
)
_RATES = (
    Step("mass", lambda masses: masses[0] + masses[1], ("masses",)),
    Step("velocity", lambda momentum, mass: eq.scale(momentum, 1 / mass), ("momentum", "mass")),
    Step("weight", eq.scale, ("gravity", "mass")),
    Step("drive", eq.add, ("pushed", "weight")),
    Step("slopes", lambda v, drive, twist, g_rate, psid, psidd: (*v, *drive, *twist, *g_rate, psid, psidd),
         ("velocity", "drive", "twist", "g_rate", "psid", "psidd_found")),
)  # fmt: skip
_DRIVEN = (
    Step("acting", lambda own, other: own + other, ("psi_torque", "torque2_at_hinge")),
    Step("driven", dyn.driven_acceleration, ("m2", "J2", "axis", "push", "acting", "hinge_torque_bias")),
)


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


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class SimulatedMotion(Trajectory):
    """The motion of a pair that `simulate` found: a `Trajectory`, and the motion of body 1 and of the hinge.

    Attributes:
        body1: motion of body 1 at the instants, with all its derivatives; shape (N,).
        psid: hinge rate [rad/s]; shape (N,).
        psidd: its rate [rad/s^2]; shape (N,).
    """

    body1: BodyMotion
    psid: Array
    psidd: Array

    def recorded(self) -> dict[str, Array]:
        """The outputs of the state, the motion of body 1 and that of the hinge, by name; shape (N, ...)."""
        body1 = {f"{letter}1": getattr(self.body1, letter) for letter in ("R", "S", "v", "omega", "a", "alpha")}
        return {**self.state.arrays(), **body1, "psi": self.psi, "psid": self.psid, "psidd": self.psidd}


def simulate(
    pair: HingePair,
    t: ArrayLike,
    body1: BodyMotion | None,
    psi_0: float,
    psid_0: float,
    *,
    hinge_torque: HingeTorque = 0.0,
    force1: Load = 0,
    torque1: Load = 0,
    force2: Load = 0,
    torque2: Load = 0,
    gravity: ArrayLike = GRAVITY,
    base: Base = "free",
    tol: float = 1e-10,
    outputs: Outputs = None,
    backend: str = "auto",
) -> SimulatedMotion:
    """The motion of a pair under what acts on it (D1-D6), from its start at t[0].

    Steps of Gauss collocation of order 16, their lengths chosen by the tolerance; attitudes on the rotation group. A
    free pair on which nothing acts keeps its momenta to the last bit. The limits of the pair are not enforced: a
    `HingeLoad(stops=pair.limits)` does that. An inertia that was not given is that of a radius of gyration of 0.1 m.

    Args:
        pair: a HingePair whose bodies have mass properties (body 2 alone where the base is not free).
        t: instants [s], increasing; shape (N,).
        body1: where body 1 starts: R and S, and v and omega unless they are zero. None beside a base that moves.
        psi_0: hinge angle at t[0] [rad].
        psid_0: hinge rate at t[0] [rad/s].
        hinge_torque: of body 1 on body 2 about the hinge axis [N m]: a number, a `HingeLoad` (spring, damper,
            friction, stops), or any callable of arrays (t, psi, psid), each (n,), that returns (n,).
        force1: on body 1 at R1, world axes [N]: shape (3,), the number 0, or a callable of (t, now) that returns
            (n, 3); `now` has R1, S1, v1, omega1, psi and psid at the instants t.
        torque1: on body 1, world axes [N m]; likewise.
        force2: on body 2 at R2, world axes [N]; likewise.
        torque2: on body 2, world axes [N m]; likewise.
        gravity: acceleration of free fall, world axes [m/s^2]; shape (3,).
        base: "free"; "fixed", where body 1 stays where it starts; or a callable of times (n,) that returns the
            BodyMotion of body 1, with v, omega, a and alpha.
        tol: largest error of a step [rad], of positions in units of the pair's levers; from 1e-14 to 1e-2.
        outputs: as for `forward_kinematics`; all of body 2 unless given.
        backend: as for `forward_kinematics`.

    Returns:
        A `Trajectory` (`.t`, `.S1`, `.psi`, `.R2`, ...), and `.body1`, `.psid` and `.psidd`; `.error_estimate` and
        `.psi_error_estimate` [rad] come from a second run, of a smaller tolerance, when they are asked for.

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
    check_pair(pair)
    check_one(pair)
    instants = check_instants("t", real_array("t", t), 0)
    tolerance = finite_number("tol", tol)
    if not _TOLERANCES[0] <= tolerance <= _TOLERANCES[1]:
        raise ArgumentError("tol", f"a number from {_TOLERANCES[0]} to {_TOLERANCES[1]}", tol)
    loads = Loads({"force1": force1, "torque1": torque1, "force2": force2, "torque2": torque2}, hinge_torque)
    start = finite_number("psi_0", psi_0), finite_number("psid_0", psid_0)
    fall = tuple(one_constant("gravity", gravity, 3).tolist())
    if not callable(base):
        check_choice("base", base, BASES)
        _start_of(body1)
    elif body1 is not None:
        raise ArgumentError("body1", "None beside a base that moves as given", quoted(body1))

    how = choose(backend, 1)

    def run(tolerance: float) -> _Course:
        if callable(base):
            return _follow(_Driven(pair, base, start, loads, fall, how), instants, tolerance)
        begin = _start_of(body1)
        kind = _Free if base == "free" else _Fixed
        return _follow(kind(pair, begin, start, loads, fall, how), instants, tolerance)

    found = run(tolerance)
    finer = functools.cache(lambda: run(max(tolerance * _FINER, 1e-15)))
    return SimulatedMotion(
        t=read_only(instants),
        quat_wxyz=read_only(found.quats),
        psi=read_only(found.psi),
        R1=found.body1.R,
        pair=pair,
        state=pair.forward_kinematics_from_body1(
            found.body1, found.psi, found.psid, found.psidd, outputs=outputs, backend=backend
        ),
        method="collocation",
        steps=found.steps,
        _error=Later(lambda: _angle_between(found.quats, finer().quats)),
        _psi_error=Later(lambda: float(np.abs(found.psi - finer().psi).max(initial=0.0))),
        body1=found.body1,
        psid=read_only(found.psid),
        psidd=read_only(found.psidd),
    )


class _Course(NamedTuple):
    """What was found at the instants."""

    quats: Array
    body1: BodyMotion
    psi: Array
    psid: Array
    psidd: Array
    steps: int = 0


def _follow(motion: _Free | _Driven, t: Array, tol: float) -> _Course:
    """The motion from t[0] to t[-1], read out at the instants."""
    states, quats = np.empty((len(t), len(motion.state))), np.empty((len(t), 4))
    states[:1], quats[:1] = motion.state, motion.quat
    steps, place = 0, 1
    if len(t) > 1:
        first = motion.first_step(float(t[0]), float(t[-1] - t[0]))
        stepper = Stepper(motion.rates, float(t[0]), motion.state, motion.sizes, motion.moving, tol, first)
    while place < len(t):
        try:
            piece = stepper.step(float(t[-1]))
        except TooStiffError as error:
            why = "steps became too short; a load jumps or has no value, or the motion has no bound"
            raise SimulationError(error.t, why) from None
        end = int(np.searchsorted(t, stepper.t, side="right"))
        states[place:end], quats[place:end] = piece.at(t[place:end]), motion.quat
        steps, place = steps + 1, end
        stepper.turn(motion.renew(stepper.state))
    return motion.read(t, states, quats)._replace(steps=steps)


class _Driven:
    """A pair whose body 1 moves as given: psi and psi' are all that is found."""

    moving = np.array([False, True])
    sizes = np.ones(2)
    quat = np.array([1.0, 0.0, 0.0, 0.0])

    def __init__(
        self,
        pair: HingePair,
        base: Callable[[Array], BodyMotion],
        start: tuple[float, float],
        loads: Loads,
        fall: tuple[float, ...],
        how: How,
    ) -> None:
        known = mass_constants((pair.body1, pair.body2), "body2") | {
            "gravity": fall,
            "psidd": 0.0,
            **pair.constants.values,
        }
        self._program = _Program(_driven_loop("home" in known), known, how)
        self._base, self._loads = base, loads
        self.state = np.array(start)

    def first_step(self, t: float, span: float) -> float:
        """A length to begin with."""
        return _first_step(self.rates(np.array([t]), self.state[None])[0] / np.maximum(1, abs(self.state)), span)

    def rates(self, t: Array, states: Array) -> Array:
        """Psi' and psi'' at some instants."""
        psi, psid = states.T
        return np.stack([psid, self._acceleration(t, self._moved(t), psi, psid)], axis=-1)

    def renew(self, state: Array) -> Array:
        """The state that the next step begins with."""
        return state

    def read(self, t: Array, states: Array, _: Array) -> _Course:
        """What is asked for at some instants."""
        body1, (psi, psid) = self._moved(t), states.T.copy()
        return _Course(matrix_to_quaternion(body1.S), body1, psi, psid, self._acceleration(t, body1, psi, psid))

    def _moved(self, t: Array) -> BodyMotion:
        """Body 1 at some instants, each of its arrays with an axis of instants."""
        given = motion_arrays("base1", self._base(t), "R", "S", "v", "omega", "a", "alpha")
        letters = ("R", "S", "v", "omega", "a", "alpha")
        try:
            arrays = {
                letter: np.broadcast_to(array, (len(t), *((3, 3) if letter == "S" else (3,))))
                for letter, array in zip(letters, given.values(), strict=True)
            }
        except ValueError:
            expected = f"a callable that returns the motion of body 1 at {len(t)} instants"
            raise ArgumentError("base", expected, {name: array.shape for name, array in given.items()}) from None
        return BodyMotion(**arrays)

    def _acceleration(self, t: Array, body1: BodyMotion, psi: Array, psid: Array) -> Array:
        arrays = motion_arrays("base1", body1, "R", "S", "v", "omega", "a", "alpha")
        R, S, v, omega, a, alpha = arrays.values()
        forces = self._loads.forces(t, Moving(R, S, v, omega, psi, psid))
        given = {"S1": S, "omega1": omega, "a1": a, "alpha1": alpha, "psi": psi, "psid": psid}
        return self._program(len(t), **given, psi_torque=self._loads.torque(t, psi, psid), **forces)["driven"].copy()


class _Fixed(_Driven):
    """A pair whose body 1 stays where it starts."""

    def __init__(self, pair: HingePair, begin: _Begin, *others: Any) -> None:
        R, S, *speeds = begin
        for name, speed in zip(("v", "omega"), speeds, strict=True):
            if speed.any():
                raise ArgumentError(f"body1.{name}", "none, of a base that is fixed", speed)
        zero = np.zeros(3)
        still = BodyMotion(R=R, S=S, v=zero, omega=zero, a=zero, alpha=zero)
        super().__init__(pair, lambda _: still, *others)


class _Free:
    """A pair that nothing holds: its state is (centre of mass, linear and angular momentum, g, psi, psi')."""

    moving = np.array([False] * 3 + [True] * 6 + [False] * 4 + [True])

    def __init__(
        self,
        pair: HingePair,
        begin: _Begin,
        start: tuple[float, float],
        loads: Loads,
        fall: tuple[float, ...],
        how: How,
    ) -> None:
        masses = mass_constants((pair.body1, pair.body2), "body1", "body2")
        known = masses | {"gravity": fall, "a1": _ZERO, "alpha1": _ZERO, "psidd": 0.0, **pair.constants.values}
        home = "home" in known
        self._motion, self._rates = (_Program(_free_loop(what, home), known, how) for what in ("motion", "rates"))
        self._mass, self._fall, self._loads = masses["m1"] + masses["m2"], np.array(fall), loads
        R, S, v, omega = begin
        self.quat = matrix_to_quaternion(S)
        psi, psid = start
        found = _Program(_start_loop(home), known, how)(1, S1=S, omega1=omega, psi=psi, psid=psid)
        centre, speed, angular = (found[name][0] for name in ("centre", "v_centre", "angular"))
        self.state = np.hstack([R + centre, self._mass * (v + speed), angular, np.zeros(3), start])
        reach = sum(float(np.linalg.norm(x)) for x in (pair.u1, pair.u2, masses["c1"], masses["c2"])) or 1.0
        inertia = sum(sum(masses[name][0::4]) for name in ("I1", "I2")) + self._mass * reach**2
        sizes = (reach, self._mass * reach, inertia, 1.0)
        self.sizes = np.hstack([*(np.full(3, size) for size in sizes), 1.0, 1.0])

    def first_step(self, t: float, span: float) -> float:
        """A length to begin with."""
        slopes = self.rates(np.array([t]), self.state[None])[0] / self.sizes
        return _first_step(slopes[9:] / np.array([1, 1, 1, 1, max(1, abs(self.state[-1]))]), span)

    def rates(self, t: Array, states: Array) -> Array:
        """The derivatives of the state at some instants."""
        S0 = eq.quaternion_attitude(tuple(self.quat.tolist()))
        now = self._now(states, S0) if self._loads.look_at_motion else None
        return self._at(t, now, states, S0)["slopes"].copy()

    def _now(self, states: Array, S0: Any) -> Moving:
        """The motion that loads may look at."""
        found = self._motion(len(states), state=states, S0=S0)
        R1 = states[:, 0:3] - found["centre"]
        v1 = states[:, 3:6] / self._mass - found["v_centre"]
        return Moving(R1, found["S1"].copy(), v1, found["omega1"].copy(), states[:, 12], states[:, 13])

    def _at(self, t: Array, now: Moving | None, states: Array, S0: Any) -> dict[str, Array]:
        torque = self._loads.torque(t, states[:, 12], states[:, 13])
        return self._rates(len(t), state=states, S0=S0, psi_torque=torque, **self._loads.forces(t, now))

    def renew(self, state: Array) -> Array:
        """The state that the next step begins with: the turn of this one goes into the attitude."""
        self.quat = _turned(state[_G], self.quat)
        state = state.copy()
        state[_G] = 0.0
        return state

    def read(self, t: Array, states: Array, quats: Array) -> _Course:
        """What is asked for at some instants; quats is the attitude that their steps began with."""
        found = _turned(states[:, _G], quats)
        S0 = rotations(found).reshape(-1, 9)
        states = states.copy()
        states[:, _G] = 0.0
        now = self._now(states, S0)
        rates = self._at(t, now, states, S0)
        body1 = BodyMotion(
            R=now.R1, S=now.S1, v=now.v1, omega=now.omega1, a=rates["a1_found"], alpha=rates["alpha1_found"]
        )
        return _Course(found, body1, states[:, 12], states[:, 13], rates["slopes"][:, 13])


class _Program:
    """A loop with the constants of one pair, for a few instants; what it reads and writes stays in place."""

    def __init__(self, loop: Loop, known: Mapping[str, Any], how: How) -> None:
        self._loop, self._how = loop, how
        self._known = {name: known[name] for name, _ in loop.inputs if name in known}
        self._ready: dict[int, tuple[dict[str, Array], dict[str, Array], Bound]] = {}

    def __call__(self, count: int, **values: Any) -> dict[str, Array]:
        """The outputs at so many instants; of the nodes of a step they hold until the next call."""
        if count != NODES:
            out = self._rooms(count)
            self._loop.run({**self._known, **values}, out, (count,), _DOUBLE, self._how)
            return out
        if count not in self._ready:
            given = {name: np.empty((count, *tail)) for name, tail in self._loop.inputs if name not in self._known}
            self._ready[count] = given, self._rooms(count), bind(self._loop.inputs, {**self._known, **given})
        given, out, bound = self._ready[count]
        for name, array in given.items():
            array[...] = values[name]
        self._loop.program(bound.pattern).run(bound, out, (count,), _DOUBLE, self._how)
        return out

    def _rooms(self, count: int) -> dict[str, Array]:
        return {name: np.empty((count, *tail)) for name, tail in self._loop.outputs}


@functools.cache
def _free_loop(what: str, home: bool) -> Loop:
    """What a free pair does: its "motion" from its state, or the "rates" of that."""
    outputs: dict[str, tuple[int, ...]] = {"slopes": (14,), "a1_found": (3,), "alpha1_found": (3,)}
    if what == "motion":
        outputs = {"S1": (3, 3), "omega1": (3,), "centre": (3,), "v_centre": (3,)}
    steps = (*steps_of(None, home), *FORWARD, *_LOADED, *_FREE, *_RATES, _ATTITUDE)
    return _loop(f"free_{what}", steps, outputs)


@functools.cache
def _driven_loop(home: bool) -> Loop:
    """Psi'' where body 1 moves as given."""
    return _loop("driven", (*steps_of(None, home), *FORWARD, *_DRIVEN), {"driven": ()})


@functools.cache
def _start_loop(home: bool) -> Loop:
    """Centre of mass and angular momentum of a motion."""
    outputs = {"centre": (3,), "v_centre": (3,), "angular": (3,)}
    return _loop("start", (*steps_of(None, home), *LEVERS, *_START), outputs)


def _loop(name: str, steps: Iterable[Step], outputs: Mapping[str, tuple[int, ...]]) -> Loop:
    """Steps that lead to some results, in whatever order they stand, as a loop."""
    by_result = {step.result: step for step in steps}
    order: dict[str, Step | None] = {}

    def visit(result: str) -> None:
        if result not in order:
            step = by_result.get(result)
            for argument in step.arguments if step else ():
                visit(argument)
            order[result] = step

    for result in outputs:
        visit(result)
    taken = [step for step in order.values() if step]
    inputs = {result: _TAILS.get(result, (3,)) for result, step in order.items() if step is None}

    def function(values: dict[str, Any]) -> dict[str, Any]:
        for result, equation, arguments in taken:
            values[result] = equation(*[values[argument] for argument in arguments])
        return values

    return Loop(name, function, inputs, outputs)


def _start_of(body1: object) -> _Begin:
    """R, S, v and omega of body 1 at the start."""
    if not isinstance(body1, BodyMotion):
        raise ArgumentError("body1", "a BodyMotion, where body 1 starts", quoted(body1))
    if body1.shape != ():
        raise ArgumentError(
            "body1", "one start, such as BodyMotion(R=(0, 0, 0), S=np.eye(3))", f"shape {body1.shape}"
        )
    zero = np.zeros(3)
    v, omega = (zero if x is None else x.astype(np.float64) for x in (body1.v, body1.omega))
    return body1.R.astype(np.float64), body1.S.astype(np.float64), v, omega


def _first_step(slopes: Array, span: float) -> float:
    """A length in which nothing turns by more than a tenth of a radian."""
    fastest = float(np.abs(slopes).max())
    return min(span, 0.1 / fastest) if 0 < fastest < np.inf else span / 100


def _turned(g: Array, quats: Array) -> Array:
    """Attitudes, unit quaternions (..., 4) with the scalar first, turned by Cayley coordinates (..., 3)."""
    x, y, z = np.moveaxis(g / 2, -1, 0)
    a, b, c, d = np.moveaxis(quats, -1, 0)
    found = np.stack(
        [a - x * b - y * c - z * d, b + x * a + y * d - z * c, c + y * a + z * b - x * d, d + z * a + x * c - y * b],
        -1,
    )
    unit: Array = found / np.linalg.norm(found, axis=-1, keepdims=True)
    return unit


def _angle_between(one: Array, other: Array) -> float:
    """The largest angle between attitudes, unit quaternions (n, 4)."""
    gap = np.minimum(np.linalg.norm(one - other, axis=-1), np.linalg.norm(one + other, axis=-1))
    return float((4 * np.arcsin(np.minimum(gap / 2, 1))).max(initial=0.0))
