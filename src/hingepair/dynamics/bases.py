"""What moves: the state of a pair whose body 1 is free, pinned or carried, how it changes, and what it means.

The state of a free pair is the place of the common centre of mass, the linear momentum, the angular momentum about
that centre, the attitude of body 1 as Cayley coordinates g that begin anew with every step, psi and psi'. Where
nothing acts, the momenta are constants of the integration, not results of it. Of a pinned pair the place is R1, and
the angular momentum that about R1; in the plane g is (0, 0, phi) and goes on. A carried pair has psi and psi' alone.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np

from hingepair.dynamics.collocation import BESIDE, NODES, Array
from hingepair.dynamics.loads import Loads, Moving
from hingepair.equations import dynamics as dyn
from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError
from hingepair.evaluation.backend import How
from hingepair.evaluation.binding import Bound, bind
from hingepair.evaluation.dynamics_steps import forward_steps, lever_steps
from hingepair.evaluation.loops import Loop
from hingepair.evaluation.plan import INPUTS, SPATIAL, Plan, needed_steps, steps_of
from hingepair.evaluation.steps import Step, upright
from hingepair.integration.methods import quaternion_product
from hingepair.integration.trajectory import rotations
from hingepair.numeric.blocks import turn_terms
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.dynamics import SINGULAR, check_resistance, mass_constants
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import matrix_to_quaternion

Start: TypeAlias = tuple[Array, Array, Array, Array, float, float]
"""R, S, v and omega of body 1, psi and psi'."""
Tails: TypeAlias = Mapping[str, tuple[int, ...]]

_DOUBLE = np.dtype(np.float64)
_G = slice(9, 12)  # where the attitude stands in the state

_STATE = (
    Step("place", lambda state: state[0:3], ("state",)),
    Step("momentum", lambda state: state[3:6], ("state",)),
    Step("angular", lambda state: state[6:9], ("state",)),
    Step("g", lambda state: state[9:12], ("state",)),
    Step("psi", lambda state: state[12], ("state",)),
    Step("psid", lambda state: state[13], ("state",)),
)
_SPACE = Step("S1", dyn.cayley_attitude, ("g", "S0"))
_PLANE = Step("S1", lambda g: upright(turn_terms(g[2])), ("g",))
_SPIN = Step("omega1", dyn.spin_of_momentum, ("about", "angular", "psid"))
_FREE = (
    Step("sway", lambda share, psid: share * psid, ("share", "psid")),
    Step("beside", dyn.from_centre, ("none", "omega1", "centre", "push", "sway")),
    Step("mass", lambda masses: masses[0] + masses[1], ("masses",)),
    Step("velocity", lambda momentum, mass: eq.scale(momentum, 1 / mass), ("momentum", "mass")),
    Step("v1", eq.add, ("velocity", "beside")),
    Step("weight", eq.scale, ("gravity", "mass")),
    Step("drive", eq.add, ("pushed", "weight")),
    Step("moment1", dyn.torque_from, ("torque1", "point", "force1")),
    Step("from_point", eq.subtract, ("d", "point")),
    Step("moment2", dyn.torque_about, ("torque2", "from_point", "force2")),
    Step("twist", eq.add, ("moment1", "moment2")),
)
_PINNED = (
    *(Step(name, lambda none: none, ("none",)) for name in ("beside", "velocity", "v1", "drive")),
    Step("mass", lambda masses: masses[0] + masses[1], ("masses",)),
    Step("weight", eq.scale, ("gravity", "mass")),
    Step("twist", dyn.torque_about, ("turned", "centre", "weight")),
)
_SLOPES = (
    Step("R1", eq.subtract, ("place", "point")),
    Step("start", dyn.momentum_about, ("about", "omega1", "psid")),
    Step("slopes", lambda v, drive, twist, g_rate, psid, psidd: (*v, *drive, *twist, *g_rate, psid, psidd),
         ("velocity", "drive", "twist", "g_rate", "psid", "psidd")),
)  # fmt: skip

_MOTION: Final[Tails] = {"R1": (3,), "S1": (3, 3), "v1": (3,), "omega1": (3,)}
_SLOPE: Final[Tails] = {"slopes": (14,)}
_ACCELERATIONS: Final[Tails] = {"a1": (3,), "alpha1": (3,), "psidd": ()}
_BEGIN: Final[Tails] = {"point": (3,), "beside": (3,), "start": (3,)}
_TAILS: Final[Tails] = {
    **INPUTS,
    "S0": (9,),
    "state": (14,),
}


class Course(NamedTuple):
    """What was found at the instants; phi, the angle of body 1, in the plane."""

    quats: Array
    now: Moving
    a1: Array
    alpha1: Array
    psidd: Array
    phi: Array
    steps: int = 0


class Carried:
    """A pair whose body 1 moves as given: its state is (psi, psi')."""

    sizes = np.ones(2)
    moving = np.array([False, True])
    angle = 0  # where psi stands in the state
    quat = np.array([1.0, 0, 0, 0])

    def __init__(
        self, pair: HingePair, base: Callable[[Array], BodyMotion], start: Start, loads: Loads, how: How
    ) -> None:
        self.state = np.array(start[4:])
        self._base, self._loads, self.levels = base, loads, loads.levels
        _check_hinge(pair)
        known = mass_constants((None, pair.body2), "body2") | loads.known | pair.constants.values
        self._program = _Program(_loop("carried", None, "home" in known, (("psidd", ()),)), known, how)

    def first_step(self, t: float, span: float) -> float:
        """A length to begin with."""
        _, psid = self.state
        psidd = self.rates(np.array([t]), self.state[None])[0, 1]
        return _first_step(np.array([psid, np.sqrt(abs(psidd))]), span)

    def rates(self, t: Array, states: Array, side: int | None = None) -> Array:
        """The derivatives of the state at some instants; of a side, as they go on smoothly from there."""
        return np.stack([states[:, 1], self._accelerations(t, states, side)[-1]], axis=-1)

    def renew(self, state: Array) -> Array:
        """The state that the next step begins with."""
        return state

    def read(self, t: Array, states: Array, _: Array) -> Course:
        """What is asked for at some instants."""
        now, a, alpha, psidd = self._accelerations(t, states)
        quats = matrix_to_quaternion(now.S1)
        return Course(quats, now, a, alpha, psidd, np.unwrap(2 * np.arctan2(quats[:, 3], quats[:, 0])))

    def _accelerations(self, t: Array, states: Array, side: int | None = None) -> tuple[Moving, Array, Array, Array]:
        """The motion at some instants, and a1, alpha1 and psi''."""
        R, S, v, omega, a, alpha = self._carry(t)
        now = Moving(R, S, v, omega, *states.T.copy())
        given = {"S1": S, "omega1": omega, "a1": a, "alpha1": alpha, "psi": now.psi, "psid": now.psid}
        return (
            now,
            a,
            alpha,
            self._program(len(t), **given, **self._loads.at(t, now, now.psi, now.psid, side))["psidd"].copy(),
        )

    def _carry(self, t: Array) -> list[Array]:
        """The motion of body 1 at some instants, each of its arrays with an axis of instants."""
        given = motion_arrays("base1", self._base(t), "R", "S", "v", "omega", "a", "alpha")
        try:
            return [np.broadcast_to(x, (len(t), *_TAILS[name[:-1] + "1"])) for name, x in given.items()]
        except ValueError:
            expected = f"a callable that returns the motion of body 1 at {len(t)} instants"
            raise ArgumentError("base", expected, {name: array.shape for name, array in given.items()}) from None


class Turning:
    """A pair whose body 1 nothing holds, or a pin at R1."""

    moving = np.array([False] * 3 + [True] * 6 + [False] * 4 + [True])
    angle = 12

    def __init__(self, pair: HingePair, base: str, flat: bool, start: Start, loads: Loads, how: How) -> None:
        masses = mass_constants((pair.body1, pair.body2), "body1", "body2")
        check_resistance(pair.constants, (pair.body1, pair.body2))
        known = masses | loads.known | pair.constants.values
        own = base, flat, "home" in known
        self._motion, self._rates, self._accelerations = (
            _Program(_loop(*own, tuple(tails.items())), known, how) for tails in (_MOTION, _SLOPE, _ACCELERATIONS)
        )
        self._loads, self._flat, self.levels = loads, flat, loads.levels
        R, S, v, omega, psi, psid = start
        self.quat = matrix_to_quaternion(S)
        g = np.array([0, 0, np.arctan2(S[1, 0], S[0, 0])]) if flat else np.zeros(3)
        begin = _Program(_loop(base, None, own[2], tuple(_BEGIN.items())), known, how)
        found = begin(1, S1=S, omega1=omega, psi=psi, psid=psid)
        point, beside, angular = (found[name][0] for name in _BEGIN)
        mass = masses["m1"] + masses["m2"]
        momentum = mass * (v - beside) if base == "free" else np.zeros(3)
        self.state = np.hstack([R + point, momentum, angular, g, psi, psid])
        reach = sum(float(np.linalg.norm(x)) for x in (pair.u1, pair.u2, masses["c1"], masses["c2"])) or 1.0
        inertia = sum(sum(masses[name][0::4]) for name in ("I1", "I2")) + mass * reach**2
        sizes = (reach, mass * reach, inertia, 1.0)
        self.sizes = np.hstack([*(np.full(3, size) for size in sizes), 1.0, 1.0])

    def first_step(self, t: float, span: float) -> float:
        """A length to begin with."""
        slopes = self.rates(np.array([t]), self.state[None])[0] / self.sizes
        return _first_step(slopes[9:] / np.array([1, 1, 1, 1, max(1, abs(self.state[-1]))]), span)

    def rates(self, t: Array, states: Array, side: int | None = None) -> Array:
        """The derivatives of the state at some instants; of a side, as they go on smoothly from there."""
        S0 = eq.quaternion_attitude(tuple(self.quat.tolist()))
        return self._rates(len(t), state=states, S0=S0, **self._acting(t, states, S0, side))["slopes"].copy()

    def _acting(self, t: Array, states: Array, S0: Any, side: int | None = None) -> dict[str, Array]:
        """What acts at some instants."""
        now = self._now(states, S0) if self._loads.look_at_motion else None
        return self._loads.at(t, now, states[:, 12], states[:, 13], side)

    def _now(self, states: Array, S0: Any) -> Moving:
        """The motion at some instants."""
        found = self._motion(len(states), state=states, S0=S0)
        R1, S1, v1, omega1 = (found[name].copy() for name in _MOTION)
        return Moving(R1, S1, v1, omega1, states[:, 12], states[:, 13])

    def renew(self, state: Array) -> Array:
        """The state that the next step begins with: the turn of this one goes into the attitude."""
        if self._flat:
            return state
        self.quat = _turned(state[_G], self.quat)
        state = state.copy()
        state[_G] = 0.0
        return state

    def read(self, t: Array, states: Array, quats: Array) -> Course:
        """What is asked for at some instants; quats is the attitude that their steps began with."""
        S0 = np.eye(3).reshape(1, 9)
        if self._flat:
            half = states[:, 11] / 2
            quats = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=-1)
        else:
            quats = _turned(states[:, _G], quats)
            S0 = rotations(quats).reshape(-1, 9)
            states = states.copy()
            states[:, _G] = 0.0
        now = self._now(states, S0)
        found = self._accelerations(len(t), state=states, S0=S0, **self._acting(t, states, S0))
        return Course(quats, now, found["a1"], found["alpha1"], found["psidd"], states[:, 11])


class _Program:
    """A loop with the constants of one pair, for a few instants; what it reads and writes stays in place."""

    def __init__(self, loop: Loop, known: Mapping[str, Any], how: How) -> None:
        self._loop, self._how = loop, how
        self._known = {name: known[name] for name, _ in loop.inputs if name in known}
        self._ready: dict[int, tuple[dict[str, Array], dict[str, Array], Bound]] = {}

    def __call__(self, count: int, **values: Any) -> dict[str, Array]:
        """The outputs at so many instants; of the nodes of a step, and beside them, they hold until the next call."""
        if count not in {NODES, len(BESIDE)}:
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
def _loop(base: str, flat: bool | None, home: bool, outputs: tuple[tuple[str, tuple[int, ...]], ...]) -> Loop:
    """From the state - where `flat` is None, from S1, omega1, psi and psi' - to some outputs."""
    hinge = steps_of(None, home)
    if base == "carried":
        steps = forward_steps(hinge, base)
    else:
        own: tuple[Step, ...] = ()
        if flat is not None:
            turn = Step("g_rate", *((_omega, ("omega1",)) if flat else (dyn.cayley_rate, ("g", "omega1"))))
            before = [step.result for step in hinge].index("omega2")
            own = (*_STATE, _PLANE if flat else _SPACE, *hinge[:before], *lever_steps(base), _SPIN, turn)
        steps = (*forward_steps((*own, *hinge), base), *(_FREE if base == "free" else _PINNED), *_SLOPES)
    taken, inputs = needed_steps({step.result: step for step in steps}.values(), (name for name, _ in outputs))
    plan = Plan(tuple(name for name, _ in outputs), taken, inputs, (), None, home, SPATIAL)
    return Loop(base, plan.run, {name: _TAILS.get(name, (3,)) for name in sorted(inputs)}, dict(outputs))


def _omega(omega1: eq.Vector) -> eq.Vector:
    return omega1


def _check_hinge(pair: HingePair) -> None:
    """Refuse a body 2 that does not resist psi''."""
    body2 = pair.body2
    if body2 is None:  # which is said where its mass is asked for
        return
    k, h = pair.home.T @ pair.n, body2.center_of_mass - pair.u2
    push = np.cross(k, h)
    about = k @ body2.inertia @ k + body2.mass * (push @ push)
    if about <= SINGULAR * np.trace(body2.inertia):
        raise ArgumentError("pair.body2", "inertia about the hinge axis, beyond round-off", body2)


def _first_step(slopes: Array, span: float) -> float:
    """A length in which nothing turns by more than a tenth of a radian."""
    fastest = float(np.abs(slopes).max())
    return min(span, 0.1 / fastest) if 0 < fastest < np.inf else span / 100


def _turned(g: Array, quats: Array) -> Array:
    """Attitudes, unit quaternions (..., 4) with the scalar first, turned by Cayley coordinates (..., 3)."""
    x, y, z = np.moveaxis(g / 2, -1, 0)
    w, i, j, k = np.moveaxis(quats, -1, 0)
    found = np.stack(quaternion_product((1.0, x, y, z), (w, i, j, k)), axis=-1)
    unit: Array = found / np.linalg.norm(found, axis=-1, keepdims=True)
    return unit
