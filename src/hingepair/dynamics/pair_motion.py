"""State of a pair whose body 1 is free, pinned or carried, with its derivatives and the motion that it stands for.

The state of a free pair is its base point, which is the common centre of mass, the linear momentum, the angular
momentum about that centre, the attitude of body 1 as Cayley coordinates g relative to the start of the step, psi and
psi'. Without loads the momenta are exactly constant. The base point of a pinned pair is R1, and its angular momentum
that about R1. For a planar pair g is (0, 0, phi) with phi from the start of the motion. The state of a carried pair,
whose body 1 moves as given, is psi and psi' alone.
"""

from __future__ import annotations

import functools
import operator
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.dynamics.loads import KinkSide, Loads, MotionAtInstants
from hingepair.dynamics.state_steps import forward_dynamics_steps, inertia_steps
from hingepair.engine.backend import Execution
from hingepair.engine.calls import Call
from hingepair.equations import dynamics as dyn
from hingepair.equations import spatial as eq
from hingepair.errors import ArgumentError
from hingepair.integration.methods import quaternion_product
from hingepair.integration.trajectory import quaternions_to_matrices
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.numeric.blocks import turn_terms
from hingepair.pair.body_motion import BodyMotion, motion_arrays
from hingepair.pair.computations import cached_call
from hingepair.pair.constants import Constants
from hingepair.pair.dynamics import check_masses, tree_constants
from hingepair.pair.hinge_load import call_with_arrays
from hingepair.pair.hinge_pair import HingePair
from hingepair.plans.plan import SPATIAL_MOTION_KIND, Plan, all_steps, needed_steps
from hingepair.plans.steps import Step, same, upright
from hingepair.rotations.matrices import matrix_to_quaternion

InitialState: TypeAlias = tuple[Array, Array, Array, Array, float, float]
"""R, S, v and omega of body 1, psi [rad] and psi' [rad/s]."""
PrescribedMotion: TypeAlias = Callable[[Array], BodyMotion]
"""Motion of body 1 at instants (n,) [s]."""
HingeMotion: TypeAlias = Callable[[Array], Any]
"""psi, psi' and psi'' at instants (n,) [s]; each (n,)."""

_TURN, _PSI = slice(9, 12), 12  # of the Cayley coordinates g and of psi in the state
_PLACES = {
    "base_point": slice(0, 3),
    "momentum": slice(3, 6),
    "angular_momentum": slice(6, 9),
    "g": _TURN,
    "psi": _PSI,
    "psid": 13,
}
_UNPACKED = tuple(Step(name, operator.itemgetter(where), ("state",)) for name, where in _PLACES.items())
# From g to the attitude and to the derivative of g, by whether the pair is planar.
_ATTITUDES = {
    False: (Step("S1", dyn.cayley_attitude, ("g", "S0")), Step("g_rate", dyn.cayley_rate, ("g", "omega1"))),
    True: (Step("S1", lambda g: upright(turn_terms(g[2])), ("g",)), Step("g_rate", same, ("omega1",))),
}
_OMEGA1 = Step("omega1", dyn.omega1_from_momentum, ("inertia_about_point", "angular_momentum", "psid"))
# To the derivatives of base point and momenta, and to v1, by the kind of base.
_MOMENTUM_RATES = {
    "free": (
        Step("psid_fraction", operator.mul, ("mass_fraction2", "psid")),
        Step(
            "offset_velocity",
            dyn.reference_point_rate,
            ("none", "omega1", "centre", "partial_velocity2", "psid_fraction"),
        ),
        Step("velocity", lambda momentum, mass: eq.scale(momentum, 1 / mass), ("momentum", "mass")),
        Step("v1", eq.add, ("velocity", "offset_velocity")),
        Step("net_force", eq.add, ("total_force", "weight")),
        Step("net_torque", dyn.torque_from, ("total_torque", "point", "total_force")),
    ),
    "pinned": (
        *(Step(name, same, ("none",)) for name in ("offset_velocity", "velocity", "v1", "net_force")),
        Step("net_torque", dyn.torque_about, ("total_torque", "centre", "weight")),
    ),
}
_STATE_RATES = (
    Step("weight", eq.scale, ("gravity", "mass")),
    Step("R1", eq.subtract, ("base_point", "point")),
    Step("initial_angular_momentum", dyn.pair_angular_momentum, ("inertia_about_point", "omega1", "psid")),
    Step("state_rates", lambda v, force, torque, g_rate, psid, psidd: (*v, *force, *torque, *g_rate, psid, psidd),
         ("velocity", "net_force", "net_torque", "g_rate", "psid", "psidd")),
)  # fmt: skip

_ARE_RATES: Final = np.repeat([False, True, False, True], [3, 6, 4, 1])  # velocities and momenta in the state


class MotionSamples(NamedTuple):
    """Samples of a simulated motion at n instants."""

    t: Array  # instants [s]; (n,)
    quats: Array  # attitudes of body 1, scalar first; (n, 4)
    motion: MotionAtInstants
    a1: Array  # (n, 3) [m/s^2]
    alpha1: Array  # (n, 3) [rad/s^2]
    psidd: Array  # (n,) [rad/s^2]
    phi: Array  # angle of body 1 in the plane [rad]; (n,)
    loads: dict[str, Array]  # by name
    steps: int = 0  # number of steps


class PairMotion:
    """Equations of motion of a pair: the first state, the derivatives of any state, and the motion of the bodies in
    any state. It stores the attitude at the start of the present step, the `side` that selects the smooth branch of
    the hinge torque, and whether the hinge is `held`.

    Args:
        pair: a pair in space whose moving bodies have mass properties.
        base: "free", "pinned" at R1, "fixed" (body 1 at rest), or the motion of body 1.
        is_planar: whether the pair moves in the plane z = 0.
        start: the motion at the first instant.
        loads: loads on the bodies and at the hinge.
        execution: how programs are run.
        hinge: motion of the hinge; None: it turns by its loads.

    Raises:
        ArgumentError: a body that moves lacks mass properties or inertia.
    """

    def __init__(
        self,
        pair: HingePair,
        base: str | PrescribedMotion,
        is_planar: bool,
        start: InitialState,
        loads: Loads,
        execution: Execution,
        hinge: HingeMotion | None = None,
    ) -> None:
        self._hinge = hinge
        self._base_motion = base if callable(base) else None
        self._is_free_or_pinned = base in ("free", "pinned")
        masses = _masses(pair, moves_body1=self._is_free_or_pinned)
        self.loads, self._is_planar = loads, is_planar
        self.side: tuple[float, float] = (0.0, 0.0)  # branch of the torque at the hinge, between its kinks
        self.held = False  # whether friction or a stop holds the hinge at rest
        R, S, v, omega, psi, psid = start
        zero_rates = dict.fromkeys(("v1", "omega1", "a1", "alpha1"), np.zeros(3))
        self._rest = {"R1": R, "S1": S, **zero_rates} if base == "fixed" else {}
        rest_values = {name: tuple(array.ravel().tolist()) for name, array in self._rest.items()}
        constants_by_name = masses | loads.constants | pair.constants.values | rest_values
        kind = str(base) if self._is_free_or_pinned else "carried"
        self.quat = matrix_to_quaternion(S)
        self._S0 = quaternions_to_matrices(self.quat[None]).reshape(1, 9)

        constants = Constants(constants_by_name, {}, ())

        def compile_call(is_planar_or_none: bool | None, *outputs: str) -> Call:
            """Return the cached call, compiled if the backend allows, of the plan that computes the named outputs,
            with the constants of this pair. The plan computes the outputs from S1, omega1, psi and psi' if
            `is_planar_or_none` is None, otherwise from the state.
            """
            plan = _make_state_plan(kind, is_planar_or_none, "home" in constants_by_name, outputs)
            return cached_call(
                constants, plan, tuple(sorted(plan.inputs - constants_by_name.keys())), execution.backend
            )

        if not self._is_free_or_pinned:
            self.state, self.sizes, self.rate_mask, self.psi_index = (
                np.array([psi, psid]),
                np.ones(2),
                _ARE_RATES[-2:],
                0,
            )
            self._rate_call = self._acceleration_call = compile_call(None, "psidd")
            return
        self._motion_call, self._rate_call = (
            compile_call(is_planar, "R1", "S1", "v1", "omega1"),
            compile_call(is_planar, "state_rates"),
        )
        self._acceleration_call = compile_call(is_planar, "a1", "alpha1", "psidd")
        initial_call = compile_call(None, "point", "offset_velocity", "initial_angular_momentum")
        initial = _run_compiled_call(initial_call, {"S1": S, "omega1": omega, "psi": psi, "psid": psid})
        point, offset_velocity, angular = (initial[name] for name in initial_call.outputs)
        total_mass = masses["m1"] + masses["m2"]
        momentum = total_mass * (v - offset_velocity) if base == "free" else np.zeros(3)
        g = np.array([0, 0, np.arctan2(S[1, 0], S[0, 0])]) if is_planar else np.zeros(3)
        self.state = np.hstack([R + point, momentum, angular, g, psi, psid])
        length = sum(float(np.linalg.norm(x)) for x in (pair.u1, pair.u2, masses["c1"], masses["c2"])) or 1.0
        inertia = sum(sum(masses[name][0::4]) for name in ("I1", "I2")) + total_mass * length**2
        self.sizes = np.repeat([length, total_mass * length, inertia, 1.0, 1.0], [3, 3, 3, 3, 2])
        self.rate_mask, self.psi_index = _ARE_RATES, _PSI

    @property
    def callable_names(self) -> tuple[str, ...]:
        """Names of the arguments of `simulate` that are callables: loads, "hinge" and "base"."""
        return (
            *self.loads.callable_names,
            *["hinge"] * (self._hinge is not None),
            *["base"] * (self._base_motion is not None),
        )

    def first_step_length(self, t: float, span: float) -> float:
        """Return a length for the first step [s], in which nothing turns by more than a tenth of a radian at the
        present rates.
        """
        rates = (self.rates(np.array([t]), self.state[None])[0] / self.sizes)[-5:]
        rates[-1] /= max(1, abs(self.state[-1]))
        fastest = float(np.abs(rates).max())
        return min(span, 0.1 / fastest) if 0 < fastest < np.inf else span / 100

    def rates(self, t: Array, states: Array) -> Array:
        """Return the time derivatives of states, (m, k), on the present branch of the hinge torque."""
        if self.held and not self._is_free_or_pinned:
            return np.zeros((len(t), 2))
        inputs = self._program_inputs(t, states, self._S0)
        results = _run_compiled_call(self._rate_call, inputs | self._loads_at(t, inputs, self.side))
        if not self._is_free_or_pinned:
            return np.stack([inputs["psid"], (inputs if self._hinge else results)["psidd"]], axis=-1)
        rates: Array = results["state_rates"]
        if self.held or self._hinge:
            rates = rates.copy()
            rates[:, _PSI:] = np.stack([inputs["psid"], inputs["psidd"]], axis=-1) if self._hinge else 0.0
        return rates

    def hinge_acceleration(self, t: float, state: Array) -> float:
        """Return psi'' [rad/s^2] in one state, as if the hinge were not held."""
        inputs = self._program_inputs(np.array([t]), state[None], self._S0)
        return float(self._psidd(inputs, self._loads_at(np.array([t]), inputs, self.side))[0])

    def hinge_response(self, t: float, state: Array) -> float:
        """Return the derivative of psi'' by a torque at the hinge [rad/s^2 / (N m)] in one state."""
        inputs = self._program_inputs(np.array([t]), state[None], self._S0)
        loads = self._loads_at(np.array([t]), inputs, self.side)
        increased = self._psidd(inputs, loads | {"hinge_torque": loads["hinge_torque"] + 1.0})
        return float((increased - self._psidd(inputs, loads))[0])

    def holding_torque(self, t: Array, states: Array) -> Array:
        """Return the torque [N m] that must be added at the hinge so that psi'' is 0, (m,)."""
        inputs = self._program_inputs(t, states, self._S0)
        return self._torque_to_reach(inputs, self._loads_at(t, inputs, self.side), 0.0)

    def callable_loads(self, t: Array, states: Array) -> dict[str, Array]:
        """Return the callable loads by name, on the present branch of the hinge torque."""
        return self._loads_at(t, self._program_inputs(t, states, self._S0), self.side)

    def motion_at(self, t: Array, states: Array) -> MotionAtInstants:
        """Return the motion of the pair in states of the present step."""
        return self._motion_from_inputs(self._program_inputs(t, states, self._S0))

    def _psidd(self, inputs: dict[str, Any], loads: dict[str, Array]) -> Array:
        return np.asarray(_run_compiled_call(self._acceleration_call, inputs | loads)["psidd"])

    def _torque_to_reach(self, inputs: dict[str, Any], loads: dict[str, Array], psidd: Array | float) -> Array:
        """Return the torque [N m] that must be added at the hinge so that psi'' has this value, (m,)."""
        torque = loads["hinge_torque"]
        required = psidd - self._psidd(inputs, loads)
        slope = self._psidd(inputs, loads | {"hinge_torque": torque + 1.0}) - (psidd - required)
        added = required / slope
        for _ in range(2):  # refines away rounding errors, those of the slope too where 1 N m is small
            remaining = psidd - self._psidd(inputs, loads | {"hinge_torque": torque + added})
            added = added + remaining / slope
        return np.asarray(added)

    def restart_attitude(self, state: Array) -> Array:
        """Turn the stored attitude by g of a state at the end of a step; return the state with g = 0. A planar or
        carried pair stores none.
        """
        if self._is_planar or not self._is_free_or_pinned:
            return state
        self.quat = _rotate_by_cayley(state[_TURN], self.quat)
        self._S0 = quaternions_to_matrices(self.quat[None]).reshape(1, 9)
        state = state.copy()
        state[_TURN] = 0.0
        return state

    def sample(self, t: Array, states: Array, quats: Array, side: KinkSide, held: NDArray[np.bool_]) -> MotionSamples:
        """Return motion and loads at n instants, which may lie in different steps.

        Args:
            t: instants; shape (n,).
            states: the states there; shape (n, k).
            quats: attitudes at the starts of their steps; shape (n, 4).
            side: branches of the torque at the hinge; shape (n,) each.
            held: whether the hinge is held; shape (n,).
        """
        S0 = self._S0
        if self._is_free_or_pinned and not self._is_planar:
            quats = _rotate_by_cayley(states[:, _TURN], quats)
            S0, states = quaternions_to_matrices(quats).reshape(-1, 9), states.copy()
            states[:, _TURN] = 0.0
        inputs = self._program_inputs(t, states, S0)
        motion = self._motion_from_inputs(inputs)
        callable_loads = self._loads_at(t, inputs, side)
        loads = self.loads.all_at(t, motion, side)
        if self._hinge:
            loads["hinge_torque"] = loads["motor_torque"] = self._torque_to_reach(
                inputs, callable_loads, inputs["psidd"]
            )
            callable_loads |= {"hinge_torque": loads["hinge_torque"]}
        elif held.any():
            torque = np.where(held, self._torque_to_reach(inputs, callable_loads, 0.0), 0.0)
            callable_loads |= {"hinge_torque": callable_loads["hinge_torque"] + torque}
            loads |= {"hinge_torque": callable_loads["hinge_torque"]}
            friction = np.clip(torque, -self.loads.friction, self.loads.friction)
            for name, part in (("friction_torque", friction), ("stop_torque", torque - friction)):
                if name in loads:
                    loads[name] = loads[name] + part
        results = self._rest | inputs | _run_compiled_call(self._acceleration_call, inputs | callable_loads).arrays()
        if self._is_free_or_pinned:
            phi = states[:, _TURN][:, 2]
        else:
            quats = matrix_to_quaternion(motion.S1)
            phi = np.unwrap(2 * np.arctan2(quats[:, 3], quats[:, 0]))
        if self._is_free_or_pinned and self._is_planar:
            quats = np.stack([np.cos(phi / 2), 0 * phi, 0 * phi, np.sin(phi / 2)], axis=-1)
        a1, alpha1 = (np.broadcast_to(results[name], motion.R1.shape) for name in ("a1", "alpha1"))
        psidd = inputs["psidd"] if self._hinge else np.where(held, 0.0, results["psidd"])
        return MotionSamples(t, quats, motion, a1, alpha1, psidd, phi, loads)

    def _program_inputs(self, t: Array, states: Array, S0: Array) -> dict[str, Any]:
        """Return the inputs of compiled programs: psi and psi'; the state and S0, or the motion of body 1; psi'' of a
        given hinge.
        """
        hinge = dict(zip(("psi", "psid"), states.T[self.psi_index : self.psi_index + 2], strict=True))
        if self._hinge:
            hinge = dict(zip(("psi", "psid", "psidd"), hinge_motion(self._hinge, t), strict=True))
            states = states.copy()
            states[:, self.psi_index : self.psi_index + 2] = np.stack([hinge["psi"], hinge["psid"]], axis=-1)
        if self._is_free_or_pinned:
            return {**hinge, "state": states, "S0": np.broadcast_to(S0, (len(t), 9))}
        if self._base_motion is None:
            return hinge
        return hinge | prescribed_base_motion(self._base_motion, t)

    def _loads_at(self, t: Array, inputs: dict[str, Any], side: KinkSide) -> dict[str, Array]:
        motion = self._motion_from_inputs(inputs) if self.loads.need_motion else None
        return self.loads.callables_at(t, motion, inputs["psi"], inputs["psid"], side)

    def _motion_from_inputs(self, inputs: dict[str, Any]) -> MotionAtInstants:
        values = inputs | (
            _run_compiled_call(self._motion_call, inputs).arrays() if self._is_free_or_pinned else self._rest
        )
        shapes = {name: (len(inputs["psi"]), *SPATIAL_MOTION_KIND.shapes[name]) for name in MotionAtInstants._fields}
        return MotionAtInstants(*(np.broadcast_to(values[name], shape).copy() for name, shape in shapes.items()))


def hinge_motion(hinge: HingeMotion, t: Array) -> tuple[Array, Array, Array]:
    """Return psi, psi' and psi'' of a hinge that moves as given, (n,) each.

    Raises:
        ArgumentError: the callable returns something else.
    """
    values = call_with_arrays("hinge", hinge, t)
    try:
        psi, psid, psidd = (np.broadcast_to(np.asarray(value, np.float64), t.shape) for value in values)
    except (TypeError, ValueError):
        expected = f"a callable that returns (psi, psi', psi'') at {len(t)} instants"
        raise ArgumentError("hinge", expected, values) from None
    return psi, psid, psidd


def check_hinge_rates(hinge: HingeMotion, t: Array) -> None:
    """Raise an ArgumentError unless psi' and psi'' of a prescribed hinge are the derivatives of psi."""

    def motion(times: Array) -> dict[str, Array]:
        return dict(zip(("psi", "psid", "psidd"), hinge_motion(hinge, times), strict=True))

    _check_rates("hinge", motion, t, {"psid": "psi", "psidd": "psid"})


def prescribed_base_motion(base: PrescribedMotion, t: Array) -> dict[str, Array]:
    """Return the motion of a body 1 that moves as given, arrays of n rows by name.

    Raises:
        ArgumentError: the callable returns something else.
    """
    letters = ("R", "S", "v", "omega", "a", "alpha")
    body1 = motion_arrays("base1", call_with_arrays("base", base, t), *letters)
    try:
        return {name: np.broadcast_to(x, (len(t), *SPATIAL_MOTION_KIND.shapes[name])) for name, x in body1.items()}
    except ValueError:
        expected = f"a callable that returns the motion of body 1 at {len(t)} instants"
        raise ArgumentError("base", expected, {name: array.shape for name, array in body1.items()}) from None


def check_base_rates(base: PrescribedMotion, t: Array) -> None:
    """Raise an ArgumentError unless the rates of a prescribed body 1 are the derivatives of its pose."""
    derived = {"v1": "R1", "omega1": "S1", "a1": "v1", "alpha1": "omega1"}
    _check_rates("base", functools.partial(prescribed_base_motion, base), t, derived)


def _check_rates(
    name: str, motion: Callable[[Array], dict[str, Array]], t: Array, derived: Mapping[str, str]
) -> None:
    """Refuse a rate of a given motion that differs by more than a tenth, over the whole motion, from the central
    difference of the quantity that `derived` names for it.
    """
    span = float(t[-1] - t[0])
    if not span:
        return
    middles = t[0] + span * (np.arange(16) + 0.5) / 16
    given = motion(middles)
    excess = dict.fromkeys(derived, np.nan)
    # A rate counts as right if one step fits it: long ones are coarse. Short ones that drown in rounding say nothing.
    for step in span * np.array([1e-3, 1e-5, 1e-7]):
        before, after = motion(middles - step), motion(middles + step)
        for rate, quantity in derived.items():
            size, change = float(np.abs(after[quantity]).max()), after[quantity] - before[quantity]
            if quantity == "S1":
                turn = after[quantity] @ np.swapaxes(before[quantity], -1, -2)
                change = np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=-1) / 2
            slopes, rates = change / (2 * step), given[rate]
            rounding = np.spacing(size) + np.spacing(abs(t[0]) + span) * float(np.abs(rates).max())
            allowed = 0.1 * max(float(np.abs(slopes).sum()), float(np.abs(rates).sum()))
            if 64 * slopes.size * rounding < step * allowed:
                excess[rate] = np.fmin(excess[rate], float(np.abs(slopes - rates).sum()) - allowed)
    for rate, quantity in derived.items():
        if excess[rate] > 0:
            letters = rate.removesuffix("1"), quantity.removesuffix("1")
            expected = f"a callable whose {letters[0]} is the derivative of its {letters[1]}"
            raise ArgumentError(name, expected, f"another {letters[0]}")


def _run_compiled_call(call: Call, values: Mapping[str, Any]) -> Any:
    """Return the results of a call for those of the values that are its arguments."""
    arrays = {name: np.asarray(values[name], np.float64, order="C") for name in call.argument_shapes}
    results = call.rows(*arrays.values())
    if results is not None:
        return results
    return call.run(
        arrays, {name: array.shape[: array.ndim - len(call.argument_shapes[name])] for name, array in arrays.items()}
    )


@functools.cache
def _make_state_plan(base: str, is_planar: bool | None, has_home: bool, outputs: tuple[str, ...]) -> Plan:
    """Return the cached plan that computes outputs from the state of a pair, or, if `is_planar` is None, from S1,
    omega1, psi and psi'. The base is "free", "pinned" or "carried" (a body 1 whose motion is known).
    """
    hinge, body1_steps = all_steps(None, has_home), list[Step]()
    if is_planar is not None:
        attitude, rate = _ATTITUDES[is_planar]
        attitude_count = [step.result for step in hinge].index("omega2")
        body1_steps = [
            *_UNPACKED,
            attitude,
            *hinge[:attitude_count],
            *inertia_steps(base),
            _OMEGA1,
            rate,
        ]
    steps = forward_dynamics_steps((*body1_steps, *hinge), base)
    if base != "carried":
        steps = (
            *steps,
            *_STATE_RATES[:1],
            *_MOMENTUM_RATES[base],
            *_STATE_RATES[1:],
        )
    plan_steps, inputs = needed_steps({step.result: step for step in steps}.values(), outputs)
    return Plan(outputs, plan_steps, inputs, SPATIAL_MOTION_KIND)


def _masses(pair: HingePair, *, moves_body1: bool) -> dict[str, Any]:
    """Return mass, centre of mass and inertia of the bodies that move, as numbers and tuples by name.

    Raises:
        ArgumentError: a body that moves has no mass properties, or nothing resists its motion.
    """
    bodies = ({"body1": pair.body1} if moves_body1 else {}) | {"body2": pair.body2}
    check_masses(bodies, "; or base='fixed', for which body 2 suffices")
    tree = tree_constants(pair.constants, (pair.body1, pair.body2)).arrays["tree"]
    of_hinge, *of_body1 = tree[-3:] > 0  # sizes below which pivots are rounding; 0 where they are larger
    if of_hinge or (moves_body1 and any(of_body1)):
        expected = "masses that resist every motion: body 2 has no inertia about the hinge axis, to round-off, or a"
        raise ArgumentError(
            "pair.body2", f"{expected} body's inertia is negligible relative to the other's", pair.body2
        )
    values: dict[str, Any] = {}
    for name, body in bodies.items():
        if body is not None:
            k = name[-1]
            values |= {f"m{k}": body.mass, f"c{k}": tuple(body.center_of_mass.tolist())}
            values[f"I{k}"] = tuple(body.inertia.ravel().tolist())
    return values


def _rotate_by_cayley(g: Array, quats: Array) -> Array:
    """Return attitudes, unit quaternions (..., 4), turned about world axes by Cayley coordinates g."""
    x, y, z = np.moveaxis(g / 2, -1, 0)
    w, i, j, k = np.moveaxis(quats, -1, 0)
    products = np.stack(quaternion_product((1.0, x, y, z), (w, i, j, k)), axis=-1)
    quaternions: Array = products / np.linalg.norm(products, axis=-1, keepdims=True)
    return quaternions
