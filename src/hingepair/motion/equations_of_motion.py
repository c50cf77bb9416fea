"""State of a robot in a simulation, with its derivatives and the motion that it stands for.

The state of a robot with a free base is its base point, which is the common centre of mass, the linear momentum, the
angular momentum about that centre, the attitude of the base as Cayley coordinates g relative to the start of the
step, q and q'. Without loads the momenta are exactly constant. The base point of a pinned base is R1, and its angular
momentum that about R1. The state of a robot whose base rests or moves as given is q and q' alone.

The velocities are (v1, omega1, q') of a free or pinned base, and q' otherwise; accelerations solve M a + h = f with
the mass matrix M (T4) and the bias forces h (T1-T3). Some of them are known: 0 of joints that are held and of the
point of a pinned base, and those of joints that move as given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.engine.backend import execution_of
from hingepair.engine.calls import Call
from hingepair.engine.loops import Loop
from hingepair.engine.results import Results
from hingepair.errors import ArgumentError
from hingepair.mechanism.bodies.body_motion import AT_REST, BodyMotion, motion_of_rotations
from hingepair.mechanism.bodies.hinge_load import TORQUE_PARTS
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.robots.computations import RobotComputation
from hingepair.mechanism.robots.constants import robot_constants
from hingepair.motion.collocation import StepPolynomial
from hingepair.motion.given import GivenMotion
from hingepair.motion.linkages import marks_of, strut_powers_of
from hingepair.motion.loads import ON_BASE, Loads, MotionAtInstants, Side
from hingepair.motion.magnus import quaternion_product
from hingepair.motion.trajectory import quaternions_to_matrices
from hingepair.numeric.arrays import Float64Array as Array
from hingepair.plans.simulation import MOTION, state_loop
from hingepair.plans.trees import request_loop
from hingepair.rotations.matrices import matrix_to_quaternion

_BASE_INPUTS = ("S1", "omega1", "a1", "alpha1")  # inputs of programs of a base that rests or moves as given


class RobotPrograms:
    """Compiled equations of a robot whose base is held or moves as given or, with `has_momenta`, is free or pinned.

    Args:
        robot: the robot.
        base: "fixed", "free", "pinned" or "moving".
        start: the base at the first instant, where it rests if it is fixed.
        loads: what acts on the robot.
        backend: as for `simulate`.
    """

    def __init__(self, robot: Mechanism, base: str, start: BodyMotion, loads: Loads, backend: str) -> None:
        self.has_momenta, links = base in ("free", "pinned"), tuple(loads.wrenches)
        self._backend = execution_of(backend, 1).backend
        rest = dict.fromkeys((*_BASE_INPUTS, "force1", "torque1"), _ZERO) | {"S1": np.asarray(start.S)}
        base_inputs = _BASE_INPUTS if base == "moving" else ()
        frames = tuple(tree_of(robot).known_frame("wrenches", link) for link in links)
        constants = robot_constants(tree_of(robot), self.has_momenta)
        computation = RobotComputation(constants, ("qdd",), (), frames)
        form, request = computation.form, computation.request._replace(shown_count=None)
        self._known: dict[str, Any] = {**computation.known, **rest, "gravity": loads.gravity}
        matrices = ("mass_matrix", "bias_forces", *(("jacobian",) if frames else ()))
        if self.has_momenta:
            pinned, blank = base == "pinned", request._replace(outputs=())
            self._motion = self._call(state_loop(form, blank, pinned, MOTION), ("state", "S0"))
            terms = state_loop(form, blank, pinned, (*MOTION, "centre", *matrices))
            rates = state_loop(form, blank, pinned, ("rates",))
            self._terms = self._call(terms, ("state", "S0"))
        else:
            without_loads = request._replace(outputs=matrices, pushed=())
            self._terms = self._call(request_loop(form, without_loads), ("q", "qd", *base_inputs))
            rates = request_loop(form, request)
        of_links = (f"{kind}_{k}" for k in range(len(frames)) for kind in ("force", "torque"))
        self._on_bodies, self._links = (*ON_BASE, *of_links), len(frames)
        acting = self._on_bodies if loads.acts_on_bodies else ()
        given = ("state", "S0") if self.has_momenta else ("q", "qd", *base_inputs)
        self._rates = self._call(rates, (*given, "tau", *acting))

    def motion(self, states: Array, S0: Array) -> Any:
        """Return R1, S1, v1 and omega1 of a free or pinned base, by name."""
        return _run(self._motion, {"state": states, "S0": S0})

    def terms(self, **inputs: Array) -> tuple[Any, Array]:
        """Return the mass matrix and bias forces, of a free or pinned base also its motion and the centre of mass
        from R1, by name; and the Jacobians of the loaded links, (n, links, 6, velocities).
        """
        found = _run(self._terms, inputs)
        M = found["mass_matrix"]
        shape = (len(M), self._links, 6, M.shape[-1])
        return found, found["jacobian"].reshape(shape) if self._links else np.zeros(shape)

    def rates(self, inputs: dict[str, Array], on_bodies: Array | None) -> Array:
        """Return the derivative of the state of a free or pinned base, otherwise q''.

        Args:
            inputs: state, S0 and tau; otherwise q, qd, tau, S1, omega1, a1 and alpha1.
            on_bodies: force1, torque1, and force and torque on each link, (n, 2 + 2 links, 3); None: no loads.
        """
        if on_bodies is not None:
            inputs |= {name: on_bodies[:, k] for k, name in enumerate(self._on_bodies)}
        found: Array = _run(self._rates, inputs)
        return found

    def _call(self, loop: Loop, given: tuple[str, ...]) -> Call:
        """Return the call of a loop with the arguments `given`, as far as it has them; other inputs are constants."""
        shapes = dict(loop.inputs)
        given = tuple(name for name in given if name in shapes)
        return Call(
            loop, {name: shapes[name] for name in given},
            {name: self._known[name] for name in shapes if name not in given},
            None if len(loop.outputs) == 1 else Results, backend=self._backend, shared=True,
        )  # fmt: skip


def _run(call: Call, values: dict[str, Array]) -> Any:
    """Return the results of a call for those of the values that are its arguments."""
    arrays = {name: np.ascontiguousarray(values[name], np.float64) for name in call.argument_shapes}
    results = call.rows(*arrays.values())
    if results is not None:
        return results
    return call.run(
        arrays, {name: array.shape[: array.ndim - len(call.argument_shapes[name])] for name, array in arrays.items()}
    )


_G = slice(9, 12)  # Cayley coordinates in the state
_Q = 12  # index of q in the state of a free or pinned base
_ZERO = np.zeros(3)  # a vector


class RobotSamples(NamedTuple):
    """Samples of a simulated motion at n instants."""

    t: Array  # instants [s]; (n,)
    quats: Array  # attitudes of the base, scalar first; (n, 4)
    motion: MotionAtInstants
    qdd: Array  # (n, dof)
    a1: Array  # (n, 3) [m/s^2]
    alpha1: Array  # (n, 3) [rad/s^2]
    loads: dict[str, Array]  # by name
    steps: int = 0  # number of steps

    @property
    def base(self) -> BodyMotion:
        """Motion of the base."""
        now = self.motion
        return motion_of_rotations(R=now.R1, S=now.S1, v=now.v1, omega=now.omega1, a=self.a1, alpha=self.alpha1)


class StepRecord(NamedTuple):
    """One step of a simulation."""

    polynomial: StepPolynomial
    quat: Array  # attitude of the base at the start of the step; (4,)
    side: Side  # branches of the loads
    held: NDArray[np.bool_]  # whether each joint is held


class _Terms(NamedTuple):
    """Terms of the equations of motion in n states."""

    now: MotionAtInstants
    a1: Array  # of a base that moves as given
    alpha1: Array
    qdd: Array  # of joints that move as given; 0 of others; (n, dof)
    M: Array  # (n, velocities, velocities)
    bias: Array  # (n, velocities)
    jacobians: Array  # of the loaded links; (n, links, 6, velocities)


class RobotMotion:
    """Equations of motion of a robot: the first state, the derivatives of any state, and the motion in any state. It
    stores the attitude at the start of the present step, the `side` that selects the smooth branch of the load of
    each joint, and which joints are `held`.

    Args:
        robot: a robot, with base="free" if the base is free or pinned.
        base: "fixed", "free", "pinned" at R1, or "moving".
        base_motion: motion of the base: at the first instant, or, of a moving base, the whole motion.
        q0: coordinates at the first instant; shape (dof,).
        qd0: their rates; shape (dof,).
        loads: loads on links and joints.
        programs: the robot's equations.
        driven: joints that move as given, by number.

    Raises:
        ArgumentError: no mass resists some motion.
    """

    def __init__(
        self,
        robot: Mechanism,
        base: str,
        base_motion: BodyMotion | GivenMotion,
        q0: Array,
        qd0: Array,
        loads: Loads,
        programs: RobotPrograms,
        driven: Mapping[int, GivenMotion] | None = None,
    ) -> None:
        self.robot, self.loads, self.base, self._driven, self._programs = robot, loads, base, driven or {}, programs
        self.joint_loads = tuple(loads.joint_loads.values())
        self.marks = marks_of(robot)
        self.dof = robot.dof
        self.has_momenta = base in ("free", "pinned")
        self._given_base = base_motion if isinstance(base_motion, GivenMotion) else None
        self.side: Side = (np.zeros(self.dof), np.zeros(self.dof))
        self.held: NDArray[np.bool_] = np.zeros(self.dof, np.bool_)
        start = AT_REST if isinstance(base_motion, GivenMotion) else base_motion
        R, S, v, omega = (_ZERO if x is None else x for x in (start.R, start.S, start.v, start.omega))
        self._R, self._S = np.asarray(R, np.float64), np.asarray(S, np.float64)
        self.quat = matrix_to_quaternion(self._S)
        self._S0 = quaternions_to_matrices(self.quat[None])
        self._of_joints = slice(6 * self.has_momenta, None)  # in velocities and generalized forces
        self._known = np.zeros(self.dof + 6 * self.has_momenta, np.bool_)
        self._known[:3] = base == "pinned"
        self._known[self._of_joints][[*self._driven]] = True
        self.length = _length(robot)
        units = np.array([1.0 if joint.unit == "rad" else self.length for joint in tree_of(robot).coordinates])
        self.q = slice(_Q * self.has_momenta, _Q * self.has_momenta + self.dof)
        self.state, self.sizes = np.hstack([q0, qd0]), np.hstack([units, units])
        self.rate_mask: NDArray[np.bool_] = np.repeat([False, True], self.dof)
        if self.has_momenta:
            rest = np.hstack([np.zeros(12), q0, np.zeros(self.dof)])[None]
            found, _ = programs.terms(state=rest, S0=self._S[None])
            M, centre = found["mass_matrix"][0], found["centre"][0]
            mass, velocities = M[0, 0], np.hstack([np.zeros(3) if base == "pinned" else v, omega, qd0])
            point, P, L = self._R, M[:3] @ velocities, M[3:6] @ velocities
            if base == "free":
                point, L = R + centre, L - np.cross(centre, P)
            else:
                P = np.zeros(3)
            inertia = float(np.trace(M[3:6, 3:6])) + mass * self.length**2
            own = np.repeat([self.length, mass * self.length, inertia, 1.0], 3)
            self.state, self.sizes = np.hstack([point, P, L, np.zeros(3), self.state]), np.hstack([own, self.sizes])
            self.rate_mask = np.hstack([np.repeat([False, True, False], [3, 6, 3]), self.rate_mask])
        if not self._known.all() and (doubt := self.mass_doubt(0.0, self.state, 1e-14)):
            raise ArgumentError("robot", "masses that resist every motion", doubt)

    @property
    def asks_callables(self) -> bool:
        """Whether loads or motions are known only at the instants at which users' functions are called."""
        return bool(self.loads.has_callables or self._driven or self._given_base)

    @property
    def _qd(self) -> slice:
        return slice(self.q.stop, self.q.stop + self.dof)

    def mass_doubt(self, t: float, state: Array, least: float) -> str:
        """Return what nothing resists in a state, where the smallest eigenvalue of the scaled mass matrix is below
        `least`; "" elsewhere.
        """
        M = self._terms(np.array([t]), state[None]).M[0][np.ix_(~self._known, ~self._known)]
        scale = np.sqrt(np.abs(np.diag(M)))
        names = np.array([*["the base"] * 6 * self.has_momenta, *self.robot.names])[~self._known]
        if not (scale > 0).all():
            return f"nothing resists {names[int(np.argmin(scale))]}"
        sizes, motions = np.linalg.eigh(M / scale / scale[:, None])
        worst = names[int(np.argmax(np.abs(motions[:, 0])))]
        return f"a singular mass matrix: hardly anything resists {worst}" if sizes[0] <= least else ""

    def first_step_length(self, t: float, span: float) -> float:
        """Return a length for the first step [s], in which nothing turns by more than a tenth of a radian at the
        present rates.
        """
        turning = slice(_G.start if self.has_momenta else 0, None)
        rates = (self.rates(np.array([t]), self.state[None])[0] / self.sizes)[turning]
        rates[len(rates) - self.dof :] /= np.maximum(1, np.abs(self.state[self._qd]))
        fastest = float(np.abs(rates).max(initial=0.0))
        return min(span, 0.1 / fastest) if 0 < fastest < np.inf else span / 100

    def rates(self, t: Array, states: Array) -> Array:
        """Return the time derivatives of states, (m, k), on the present branches of the loads."""
        states, given = self._with_driven(t, states)
        now = self._now(t, states)
        on_bodies = self.loads.on_bodies(t, now) if self.loads.acts_on_bodies else None
        tau, known = self.loads.efforts_at(t, now, self.side), self.held | self._known[self._of_joints]
        if known.any() and not self.held.all():
            tau = tau + self._solved(t, states)[2][:, self._of_joints]
        if self.has_momenta:
            inputs = {"tau": tau, "state": states, "S0": np.repeat(self._S0, len(t), axis=0)}
            rates: Array = self._programs.rates(inputs, on_bodies)
        else:
            base = self._given_base.at(t) if self._given_base is not None else {}
            qdd = self._programs.rates({"tau": tau, "q": now.q, "qd": now.qd, **base}, on_bodies)
            rates = np.concatenate([now.qd, qdd], axis=1)
        if known.any():
            rates = rates.copy()
            rates[:, self._qd] = np.where(known, given, rates[:, self._qd])
        return rates

    def joint_accelerations(self, t: float, state: Array) -> Array:
        """Return the accelerations of the joints in one state, (dof,); 0 of held ones."""
        return self._solved(np.array([t]), state[None])[1][0, self._of_joints]

    def joint_mobility(self, t: float, state: Array) -> Array:
        """Return the derivatives of the accelerations by efforts at the joints, none of which is held; (dof, dof)."""
        M = self._terms(np.array([t]), state[None]).M
        inverse: Array = np.linalg.inv(_with_known(M, self._known[None]))[0]
        inverse[self._known] = 0.0
        return inverse[self._of_joints, self._of_joints]

    def holding_efforts(self, t: Array, states: Array) -> Array:
        """Return the efforts that hold the held joints, (n, dof); 0 of others."""
        return np.where(self.held, self._solved(t, states)[2][:, self._of_joints], 0.0)

    def callable_loads(self, t: Array, states: Array) -> dict[str, Array]:
        """Return the callable loads by name, on the present branches."""
        return self.loads.callables_at(t, self._now(t, self._with_driven(t, states)[0]), self.side)

    def motion_at(self, t: Array, states: Array) -> Any:
        """Return the motion in states of the present step, as callables of users see it."""
        return self._now(t, self._with_driven(t, states)[0], with_base=True)

    def restart_attitude(self, state: Array) -> Array:
        """Turn the stored attitude by g of a state at the end of a step; return the state with g = 0."""
        if not self.has_momenta:
            return state
        self.quat = _rotate_by_cayley(state[_G], self.quat)
        self._S0 = quaternions_to_matrices(self.quat[None])
        state = state.copy()
        state[_G] = 0.0
        return state

    def sample_steps(self, t: Array, states: Array, steps: Sequence[StepRecord]) -> RobotSamples:
        """Return motion and loads at n instants, each with its state, shape (n, k), and its step."""
        quats, held = np.array([step.quat for step in steps]), np.array([step.held for step in steps])
        side: Side = (np.array([step.side[0] for step in steps]), np.array([step.side[1] for step in steps]))
        S0 = None
        if self.has_momenta:
            quats = _rotate_by_cayley(states[:, _G], quats)
            S0, states = quaternions_to_matrices(quats), states.copy()
            states[:, _G] = 0.0
        terms, accelerations, holding = self._solved(t, states, side, held, S0)
        a1, alpha1 = terms.a1, terms.alpha1
        if self.has_momenta:
            a1, alpha1 = accelerations[:, :3], accelerations[:, 3:6]
        else:
            quats = matrix_to_quaternion(terms.now.S1)
        loads = self.loads.all_at(t, terms.now, side, holding[:, self._of_joints], tuple(self._driven))
        qdd = accelerations[:, self._of_joints]
        return RobotSamples(t, quats, terms.now, qdd, a1, alpha1, loads)

    # ---- what the energy balance asks

    def energies(self, samples: RobotSamples) -> tuple[Array, Array]:
        """Return the kinetic and the potential energy [J], (n,) each."""
        now = samples.motion
        energy = self.robot.energy(now.q, now.qd, gravity=self.loads.gravity, base_motion=samples.base)
        return np.asarray(energy.kinetic, np.float64), np.asarray(energy.potential, np.float64)

    def powers(self, samples: RobotSamples) -> dict[str, Array]:
        """Return the power of each load [W], (n,), and as "base" that of what moves a base as given."""
        now, loads, powers = samples.motion, samples.loads, dict[str, Array]()
        if self.has_momenta:
            powers["force1"] = (loads["force1"] * now.v1).sum(axis=-1)
            powers["torque1"] = (loads["torque1"] * now.omega1).sum(axis=-1)
        wrenches = self.loads.wrenches_of(loads)
        if wrenches:
            frames = self.robot.forward_kinematics(now.q, now.qd, base_motion=samples.base, frames=tuple(wrenches))
            for link, wrench in wrenches.items():
                rates = frames[link].v, frames[link].omega
                for name, load, rate in zip(self.loads.wrenches[link], wrench, rates, strict=True):
                    powers[name] = (load * rate).sum(axis=-1)
        if self.base == "moving":
            support = self.robot.inverse_dynamics(
                now.q, now.qd, samples.qdd, base_motion=samples.base, gravity=self.loads.gravity, wrenches=wrenches,
                joint_loads=False,
            )  # fmt: skip
            powers["base"] = (support.force1 * now.v1 + support.torque1 * now.omega1).sum(axis=-1)
        if (strut_powers := strut_powers_of(self.robot)) is not None:
            powers["struts"] = strut_powers(now.q, now.qd)
        for name in TORQUE_PARTS:
            if name in loads:
                powers[name] = (loads[name] * now.qd).sum(axis=-1)
        return powers

    # ---- the equations

    def _terms(self, t: Array, states: Array, S0: Array | None = None) -> _Terms:
        """Return the terms in n states whose steps begin at attitudes S0, (n, 3, 3); None: of the present step."""
        states, qdd = self._with_driven(t, states)
        q, qd = states[:, self.q], states[:, self._qd]
        if self.has_momenta:
            S0 = np.repeat(self._S0, len(t), axis=0) if S0 is None else S0
            found, jacobians = self._programs.terms(state=states, S0=S0)
            now = MotionAtInstants(q, qd, *(found[name] for name in MOTION))
            a1 = alpha1 = np.zeros_like(now.v1)
        else:
            base = self._base_inputs(t)
            found, jacobians = self._programs.terms(q=q, qd=qd, **base)
            now = MotionAtInstants(q, qd, *(base[name] for name in MOTION))
            a1, alpha1 = base["a1"], base["alpha1"]
        return _Terms(now, a1, alpha1, qdd, found["mass_matrix"], found["bias_forces"], jacobians)

    def _now(self, t: Array, states: Array, *, with_base: bool = False) -> MotionAtInstants:
        """Return the motion in states of the present step, in which driven joints are where they move; of the base
        only if loads or `with_base` ask for it.
        """
        q, qd = states[:, self.q], states[:, self._qd]
        if not (with_base or self.loads.callables):
            return MotionAtInstants(q, qd, *(_ZERO,) * 4)
        if not self.has_momenta:
            return MotionAtInstants(q, qd, *(self._base_inputs(t)[name] for name in MOTION))
        found = self._programs.motion(states, np.repeat(self._S0, len(t), axis=0))
        return MotionAtInstants(q, qd, *(found[name] for name in MOTION))

    def _with_driven(self, t: Array, states: Array) -> tuple[Array, Array]:
        """Return states in which joints that move as given are where they move, and q'' of these, 0 of others."""
        qdd = np.zeros((len(t), self.dof))
        if self._driven:
            states = states.copy()
            for k, joint in self._driven.items():
                states[:, self.q.start + k], states[:, self._qd.start + k], qdd[:, k] = joint.at(t).values()
        return states, qdd

    def _base_inputs(self, t: Array) -> dict[str, Array]:
        """Return the motion of a base that rests or moves as given, arrays of n rows by name."""
        if self._given_base is not None:
            return self._given_base.at(t)
        rest = {"R1": self._R, "S1": self._S, **dict.fromkeys(("v1", "omega1", "a1", "alpha1"), _ZERO)}
        return {name: np.broadcast_to(value, (len(t), *value.shape)) for name, value in rest.items()}

    def _solved(
        self,
        t: Array,
        states: Array,
        side: Side | None = None,
        held: NDArray[np.bool_] | None = None,
        S0: Array | None = None,
    ) -> tuple[_Terms, Array, Array]:
        """Return the terms in n states, the accelerations, and the generalized forces by which known ones are held or
        driven; (n, velocities) each. `side`, `held`, (n, dof), and S0 are those of the present step by default.
        """
        terms = self._terms(t, states, S0)
        on_bodies = self.loads.on_bodies(t, terms.now)
        efforts = self.loads.efforts_at(t, terms.now, self.side if side is None else side)
        loads = efforts
        if self.has_momenta:
            loads = np.concatenate([on_bodies[:, :2].reshape(len(t), 6), efforts], axis=1)
        if terms.jacobians.size:
            wrenches = on_bodies[:, 2:].reshape(len(t), -1, 6)
            loads = loads + np.einsum("nlij,nli->nj", terms.jacobians, wrenches)
        known = np.broadcast_to(self._known, loads.shape).copy()
        known[:, self._of_joints] |= self.held if held is None else held
        forces = loads - terms.bias
        if not known.any():
            return terms, _solution(terms.M, forces), np.zeros_like(forces)
        given = np.zeros_like(forces)
        given[:, self._of_joints] = terms.qdd
        rest = np.where(known, given, forces - (terms.M @ given[..., None])[..., 0])
        accelerations = _solution(_with_known(terms.M, known), rest)
        needed = (terms.M @ accelerations[..., None])[..., 0] - forces
        return terms, accelerations, np.where(known, needed, 0.0)


def _length(robot: Mechanism) -> float:
    """Return the sum of the distances between joints and to centres of mass [m]; 1 m if all of them are zero."""
    bodies = [tree_of(robot).base, *(joint.body for joint in tree_of(robot).joints)]
    vectors = [joint.u for joint in tree_of(robot).joints] + [body.centre_of_mass for body in bodies]
    return sum(float(np.linalg.norm(vector)) for vector in vectors) or 1.0


def _with_known(M: Array, known: NDArray[np.bool_]) -> Array:
    """Return mass matrices (n, k, k) in which the rows and columns of known accelerations are those of the unit
    matrix.
    """
    known = np.broadcast_to(known, M.shape[:2])
    M = np.where(known[:, :, None] | known[:, None, :], 0.0, M)
    n, k = np.nonzero(known)
    M[n, k, k] = 1.0
    return M


def _solution(M: Array, forces: Array) -> Array:
    """Return the solutions of M a = forces, (n, k); NaN if a matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(M, forces[..., None])[..., 0], np.float64)
    except np.linalg.LinAlgError:
        return np.full(forces.shape, np.nan)


def _rotate_by_cayley(g: Array, quats: Array) -> Array:
    """Return attitudes, unit quaternions (..., 4), turned about world axes by Cayley coordinates g."""
    x, y, z = np.moveaxis(g / 2, -1, 0)
    w, i, j, k = np.moveaxis(quats, -1, 0)
    products = np.stack(quaternion_product((1.0, x, y, z), (w, i, j, k)), axis=-1)
    quaternions: Array = products / np.linalg.norm(products, axis=-1, keepdims=True)
    return quaternions
