"""What moves: the state of a pair whose body 1 is free, pinned or carried, how it changes, and what it means.

The state of a free pair is the place of the common centre of mass, the linear momentum, the angular momentum about
that centre, the attitude of body 1 as Cayley coordinates g that begin anew with every step, psi and psi'. Where
nothing acts, the momenta are constants of the integration, not results of it. Of a pinned pair the place is R1, and
the angular momentum that about R1; in the plane g is (0, 0, phi) and goes on. A carried pair has psi and psi' alone.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.dynamics.collocation import Array
from hingepair.dynamics.loads import Loads, Moving, Side
from hingepair.engine.backend import Execution
from hingepair.engine.calls import Call
from hingepair.equations import dynamics as dyn
from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError
from hingepair.integration.methods import quaternion_product
from hingepair.integration.trajectory import quaternions_to_matrices
from hingepair.numeric.blocks import turn_terms
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.constants import Constants
from hingepair.pair.dynamics import SINGULAR, check_resistance, mass_constants
from hingepair.pair.evaluate import call_of
from hingepair.pair.hinge_load import call_with_arrays
from hingepair.pair.hinge_pair import HingePair
from hingepair.plans.dynamics_steps import forward_steps, lever_steps
from hingepair.plans.plan import SPATIAL, Plan, needed_steps, steps_of
from hingepair.plans.steps import Step, same, upright
from hingepair.rotations.matrices import matrix_to_quaternion

Start: TypeAlias = tuple[Array, Array, Array, Array, float, float]
"""R, S, v and omega of body 1, psi and psi'."""
Prescribed: TypeAlias = Callable[[Array], BodyMotion]
HingeMotion: TypeAlias = Callable[[Array], Any]
"""psi, psi' and psi'' at instants."""

_G, _PSI = slice(9, 12), 12  # where the attitude and psi stand in the state

_PARTS = {"place": slice(0, 3), "momentum": slice(3, 6), "angular": slice(6, 9), "g": _G, "psi": _PSI, "psid": 13}
_STATE = tuple(Step(name, operator.itemgetter(where), ("state",)) for name, where in _PARTS.items())
_TURNED = {
    False: (Step("S1", dyn.cayley_attitude, ("g", "S0")), Step("g_rate", dyn.cayley_rate, ("g", "omega1"))),
    True: (Step("S1", lambda g: upright(turn_terms(g[2])), ("g",)), Step("g_rate", same, ("omega1",))),
}
"""The attitude and how g changes; in space, and in the plane."""
_SPIN = Step("omega1", dyn.spin_of_momentum, ("about", "angular", "psid"))
_MOVED = {
    "free": (
        Step("sway", operator.mul, ("share", "psid")),
        Step("beside", dyn.from_centre, ("none", "omega1", "centre", "push", "sway")),
        Step("velocity", lambda momentum, mass: eq.scale(momentum, 1 / mass), ("momentum", "mass")),
        Step("v1", eq.add, ("velocity", "beside")),
        Step("drive", eq.add, ("pushed", "weight")),
        Step("twist", dyn.torque_from, ("turned", "point", "pushed")),
    ),
    "pinned": (
        *(Step(name, same, ("none",)) for name in ("beside", "velocity", "v1", "drive")),
        Step("twist", dyn.torque_about, ("turned", "centre", "weight")),
    ),
}
"""How place and momenta change: velocity, drive and twist; R1 moves beside the place."""
_SLOPES = (
    Step("weight", eq.scale, ("gravity", "mass")),
    Step("R1", eq.subtract, ("place", "point")),
    Step("start", dyn.momentum_about, ("about", "omega1", "psid")),
    Step("slopes", lambda v, drive, twist, g_rate, psid, psidd: (*v, *drive, *twist, *g_rate, psid, psidd),
         ("velocity", "drive", "twist", "g_rate", "psid", "psidd")),
)  # fmt: skip

_MOVING: Final = np.repeat([False, True, False, True], [3, 6, 4, 1])  # what of the state is a velocity or a momentum
_MOTION: Final = ("R1", "S1", "v1", "omega1")
_RATES: Final = ("v1", "omega1", "a1", "alpha1")


class Course(NamedTuple):
    """What was found at the instants; phi, the angle of body 1, in the plane."""

    t: Array
    quats: Array
    now: Moving
    a1: Array
    alpha1: Array
    psidd: Array
    phi: Array
    loads: dict[str, Array]
    steps: int = 0


class PairMotion:
    """The motion of a pair: its state, how that changes, and what it means.

    The base is nothing ("free"), a pin at R1 ("pinned"), all of body 1 at rest ("fixed"), or its motion as given. The
    hinge turns as loads make it, or as given.
    """

    def __init__(
        self,
        pair: HingePair,
        base: str | Prescribed,
        flat: bool,
        start: Start,
        loads: Loads,
        how: Execution,
        hinge: HingeMotion | None = None,
    ) -> None:
        self._hinge = hinge
        self._carry = base if callable(base) else None
        self._turning = base in ("free", "pinned")
        bodies = ({"body1": pair.body1} if self._turning else {}) | {"body2": pair.body2}
        masses = mass_constants(bodies, "; or base='fixed', for which body 2 suffices")
        self.loads, self._flat = loads, flat
        self.side: tuple[float, float] = (0.0, 0.0)  # of the kinks of the torque at the hinge
        self.held = False  # whether the hinge is at rest: psi stays, by friction or against a stop
        R, S, v, omega, psi, psid = start
        self._still = {"R1": R, "S1": S, **dict.fromkeys(_RATES, np.zeros(3))} if base == "fixed" else {}
        still = {name: tuple(array.ravel().tolist()) for name, array in self._still.items()}
        known = masses | loads.known | pair.constants.values | still
        kind = str(base) if self._turning else "carried"
        self.quat = matrix_to_quaternion(S)
        self._S0 = quaternions_to_matrices(self.quat[None]).reshape(1, 9)

        constants = Constants(known, {}, ())

        def program(own: bool | None, *outputs: str) -> Call:
            plan = _plan(kind, own, "home" in known, outputs)
            return call_of(constants, plan, tuple(sorted(plan.inputs - known.keys())), how.backend)

        if not self._turning:
            _check_hinge(pair)
            self.state, self.sizes, self.speeds, self.angle = np.array([psi, psid]), np.ones(2), _MOVING[-2:], 0
            self._rates = self._accelerations = program(None, "psidd")
            return
        check_resistance(pair.constants, (pair.body1, pair.body2))
        self._motion, self._rates = program(flat, *_MOTION), program(flat, "slopes")
        self._accelerations = program(flat, "a1", "alpha1", "psidd")
        begin = program(None, "point", "beside", "start")
        found = _run(begin, {"S1": S, "omega1": omega, "psi": psi, "psid": psid})
        point, beside, angular = (found[name] for name in begin.outputs)
        mass = masses["m1"] + masses["m2"]
        momentum = mass * (v - beside) if base == "free" else np.zeros(3)
        g = np.array([0, 0, np.arctan2(S[1, 0], S[0, 0])]) if flat else np.zeros(3)
        self.state = np.hstack([R + point, momentum, angular, g, psi, psid])
        reach = sum(float(np.linalg.norm(x)) for x in (pair.u1, pair.u2, masses["c1"], masses["c2"])) or 1.0
        inertia = sum(sum(masses[name][0::4]) for name in ("I1", "I2")) + mass * reach**2
        self.sizes = np.repeat([reach, mass * reach, inertia, 1.0, 1.0], [3, 3, 3, 3, 2])
        self.speeds, self.angle = _MOVING, _PSI

    @property
    def callables(self) -> tuple[str, ...]:
        """Names of what is given as functions of time, of which nothing is known between the instants asked for."""
        return (*self.loads.callables, *["hinge"] * (self._hinge is not None), *["base"] * (self._carry is not None))

    def first_step(self, t: float, span: float) -> float:
        """A length to begin with, in which nothing turns by more than a tenth of a radian."""
        turns = (self.rates(np.array([t]), self.state[None])[0] / self.sizes)[-5:]
        turns[-1] /= max(1, abs(self.state[-1]))
        fastest = float(np.abs(turns).max())
        return min(span, 0.1 / fastest) if 0 < fastest < np.inf else span / 100

    def rates(self, t: Array, states: Array) -> Array:
        """Compute the derivatives of the state at some instants, as they go on smoothly from the present side."""
        if self.held and not self._turning:
            return np.zeros((len(t), 2))
        given = self._given(t, states, self._S0)
        found = _run(self._rates, given | self._acting(t, given, self.side))
        if not self._turning:
            return np.stack([given["psid"], (given if self._hinge else found)["psidd"]], axis=-1)
        slopes: Array = found["slopes"]
        if self.held or self._hinge:
            slopes = slopes.copy()
            slopes[:, _PSI:] = np.stack([given["psid"], given["psidd"]], axis=-1) if self._hinge else 0.0
        return slopes

    def hinge_acceleration(self, t: float, state: Array) -> float:
        """Compute psi'' of one state, on the present side, of a hinge that is not held."""
        given = self._given(np.array([t]), state[None], self._S0)
        return float(self._psidd(given, self._acting(np.array([t]), given, self.side))[0])

    def hinge_response(self, t: float, state: Array) -> float:
        """Compute the derivative of psi'' by a torque at the hinge, of one state [rad/s^2 / (N m)]."""
        given = self._given(np.array([t]), state[None], self._S0)
        acting = self._acting(np.array([t]), given, self.side)
        more = self._psidd(given, acting | {"hinge_torque": acting["hinge_torque"] + 1.0})
        return float((more - self._psidd(given, acting))[0])

    def holding_torque(self, t: Array, states: Array) -> Array:
        """Compute the torque beside all loads that keeps psi' at some instants [N m]; shape (m,)."""
        given = self._given(t, states, self._S0)
        return self._holding(given, self._acting(t, given, self.side), 0.0)

    def acting(self, t: Array, states: Array) -> dict[str, Array]:
        """Compute the loads that change at some instants, on the present side, by name."""
        return self._acting(t, self._given(t, states, self._S0), self.side)

    def moving(self, t: Array, states: Array) -> Moving:
        """Compute the motion of the pair at some instants of the present step."""
        return self._now(self._given(t, states, self._S0))

    def _psidd(self, given: dict[str, Any], acting: dict[str, Array]) -> Array:
        return np.asarray(_run(self._accelerations, given | acting)["psidd"])

    def _holding(self, given: dict[str, Any], acting: dict[str, Array], psidd: Array | float) -> Array:
        """Compute the torque beside what acts that gives psi'': it depends on the torque by a straight line."""
        torque = acting["hinge_torque"]
        missing = psidd - self._psidd(given, acting)
        slope = self._psidd(given, acting | {"hinge_torque": torque + 1.0}) - (psidd - missing)
        found = missing / slope
        for _ in range(2):  # what rounding leaves, and the slope too where 1 N m is little
            left = psidd - self._psidd(given, acting | {"hinge_torque": torque + found})
            found = found + left / slope
        return np.asarray(found)

    def renew(self, state: Array) -> Array:
        """The state that the next step begins with: the turn of this one goes into the attitude."""
        if self._flat or not self._turning:
            return state
        self.quat = _turned(state[_G], self.quat)
        self._S0 = quaternions_to_matrices(self.quat[None]).reshape(1, 9)
        state = state.copy()
        state[_G] = 0.0
        return state

    def read(self, t: Array, states: Array, quats: Array, side: Side, held: NDArray[np.bool_]) -> Course:
        """Compute what is asked for at some instants.

        Args:
            t: instants; shape (n,).
            states: the states there; shape (n, k).
            quats: the attitudes that their steps began with; shape (n, 4).
            side: the side of the kinks on which each lies; shape (n,) each.
            held: whether the hinge is held there; shape (n,).
        """
        S0 = self._S0
        if self._turning and not self._flat:
            quats = _turned(states[:, _G], quats)
            S0, states = quaternions_to_matrices(quats).reshape(-1, 9), states.copy()
            states[:, _G] = 0.0
        given = self._given(t, states, S0)
        now = self._now(given)
        acting = self._acting(t, given, side)
        loads = self.loads.everything(t, now, side)
        if self._hinge:
            loads["hinge_torque"] = loads["motor_torque"] = self._holding(given, acting, given["psidd"])
            acting |= {"hinge_torque": loads["hinge_torque"]}
        elif held.any():
            torque = np.where(held, self._holding(given, acting, 0.0), 0.0)
            acting |= {"hinge_torque": acting["hinge_torque"] + torque}
            loads |= {"hinge_torque": acting["hinge_torque"]}
            friction = np.clip(torque, -self.loads.friction, self.loads.friction)
            for name, part in (("friction_torque", friction), ("stop_torque", torque - friction)):
                if name in loads:
                    loads[name] = loads[name] + part
        found = self._still | given | _run(self._accelerations, given | acting).arrays()
        if self._turning:
            phi = states[:, _G][:, 2]
        else:
            quats = matrix_to_quaternion(now.S1)
            phi = np.unwrap(2 * np.arctan2(quats[:, 3], quats[:, 0]))
        if self._turning and self._flat:
            quats = np.stack([np.cos(phi / 2), 0 * phi, 0 * phi, np.sin(phi / 2)], axis=-1)
        a1, alpha1 = (np.broadcast_to(found[name], now.R1.shape) for name in ("a1", "alpha1"))
        psidd = given["psidd"] if self._hinge else np.where(held, 0.0, found["psidd"])
        return Course(t, quats, now, a1, alpha1, psidd, phi, loads)

    def _given(self, t: Array, states: Array, S0: Array) -> dict[str, Any]:
        """What the programs start from at some instants: the state, and the motion of body 1 where it is given."""
        hinge = dict(zip(("psi", "psid"), states.T[self.angle : self.angle + 2], strict=True))
        if self._hinge:
            hinge = dict(zip(("psi", "psid", "psidd"), hinge_motion(self._hinge, t), strict=True))
            states = states.copy()
            states[:, self.angle : self.angle + 2] = np.stack([hinge["psi"], hinge["psid"]], axis=-1)
        if self._turning:
            return {**hinge, "state": states, "S0": np.broadcast_to(S0, (len(t), 9))}
        if self._carry is None:
            return hinge
        given = motion_arrays("base1", call_with_arrays("base", self._carry, t), "R", "S", "v", "omega", "a", "alpha")
        try:
            wide = {name: np.broadcast_to(x, (len(t), *SPATIAL.shapes[name])) for name, x in given.items()}
        except ValueError:
            expected = f"a callable that returns the motion of body 1 at {len(t)} instants"
            raise ArgumentError("base", expected, {name: array.shape for name, array in given.items()}) from None
        return hinge | wide

    def _acting(self, t: Array, given: dict[str, Any], side: Side) -> dict[str, Array]:
        """What acts at some instants."""
        now = self._now(given) if self.loads.look_at_motion else None
        return self.loads.at(t, now, given["psi"], given["psid"], side)

    def _now(self, given: dict[str, Any]) -> Moving:
        """The motion where this is given."""
        known = given | (_run(self._motion, given).arrays() if self._turning else self._still)
        shapes = {name: (len(given["psi"]), *SPATIAL.shapes[name]) for name in Moving._fields}
        return Moving(*(np.broadcast_to(known[name], shape).copy() for name, shape in shapes.items()))


def hinge_motion(hinge: HingeMotion, t: Array) -> tuple[Array, Array, Array]:
    """Return psi, psi' and psi'' of a hinge that moves as given, at instants; shape (n,) each."""
    values = call_with_arrays("hinge", hinge, t)
    try:
        psi, psid, psidd = (np.broadcast_to(np.asarray(value, np.float64), t.shape) for value in values)
    except (TypeError, ValueError):
        expected = f"a callable that returns (psi, psi', psi'') at {len(t)} instants"
        raise ArgumentError("hinge", expected, values) from None
    return psi, psid, psidd


def _run(call: Call, values: Mapping[str, Any]) -> Any:
    """Return the results of a call for values by name."""
    arrays = {name: np.asarray(values[name], np.float64, order="C") for name in call.argument_shapes}
    results = call.fast_path(*arrays.values())
    if results is not None:
        return results
    return call.run(
        arrays, {name: array.shape[: array.ndim - len(call.argument_shapes[name])] for name, array in arrays.items()}
    )


@functools.cache
def _plan(base: str, flat: bool | None, home: bool, outputs: tuple[str, ...]) -> Plan:
    """From the state - where `flat` is None, from S1, omega1, psi and psi' - to some outputs."""
    hinge, own = steps_of(None, home), list[Step]()
    if flat is not None:
        attitude, rate = _TURNED[flat]
        before = [step.result for step in hinge].index("omega2")
        own = [*_STATE, attitude, *hinge[:before], *lever_steps(base), _SPIN, rate]
    steps = forward_steps((*own, *hinge), base)
    if base != "carried":
        steps = (*steps, *_SLOPES[:1], *_MOVED[base], *_SLOPES[1:])
    taken, inputs = needed_steps({step.result: step for step in steps}.values(), outputs)
    return Plan(outputs, taken, inputs, SPATIAL)


def _check_hinge(pair: HingePair) -> None:
    """Refuse a body 2 that does not resist psi''."""
    body2: Any = pair.body2
    k, h = pair.home.T @ pair.n, body2.center_of_mass - pair.u2
    push = np.cross(k, h)
    about = k @ body2.inertia @ k + body2.mass * (push @ push)
    if about <= SINGULAR * np.trace(body2.inertia):
        raise ArgumentError("pair.body2", "inertia about the hinge axis, beyond round-off", body2)


def _turned(g: Array, quats: Array) -> Array:
    """Attitudes, unit quaternions (..., 4) with the scalar first, turned by Cayley coordinates (..., 3)."""
    x, y, z = np.moveaxis(g / 2, -1, 0)
    w, i, j, k = np.moveaxis(quats, -1, 0)
    found = np.stack(quaternion_product((1.0, x, y, z), (w, i, j, k)), axis=-1)
    unit: Array = found / np.linalg.norm(found, axis=-1, keepdims=True)
    return unit
