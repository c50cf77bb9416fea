"""`hingepair bench dynamics`: forces from motion and motion from forces, beside Pinocchio, MuJoCo and SciPy.

The truth of a simulation is SciPy's solver at its finest over Newton and Euler as a textbook writes them; nothing of
hingepair has a part in it.
"""

from __future__ import annotations

import weakref
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.measure import Job, Report, Row, Target, Tell, measured
from hingepair.bench.peers import (
    CONSTANTS,
    CPP,
    OURS,
    PREPARED,
    PYTHON_LOOP,
    address_of,
    compiled_loop,
    cpp_missing,
)
from hingepair.dynamics.simulate import simulate
from hingepair.formats.mjcf_writer import to_mjcf
from hingepair.pair.body import Body
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.dynamics import GRAVITY
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import rotation_exp
from hingepair.validation.pinocchio_twin import to_pinocchio

Array: TypeAlias = NDArray[np.float64]

INVERSE, FORWARD = "inverse dynamics", "forward dynamics"
MUJOCO, DOP853 = "MuJoCo, Python loop", "SciPy DOP853, NumPy"
GOAL = 1e-8
"""Largest error of a simulation [rad]."""

_FEW = 10**4
_TIME = np.linspace(0, 10, 101)
_SPIN = np.array([0.3, 1.5, -0.7])
_SPRING = 3.0


def bodies() -> HingePair:
    """A pair whose bodies have masses."""
    rng = np.random.default_rng(22)
    turned = [rotation_exp(vector) for vector in rng.normal(size=(2, 3))]
    moments = ((0.5, 0.7, 0.9), (0.2, 0.3, 0.4))
    body1, body2 = (
        Body(mass, rng.normal(size=3) / 5, S @ np.diag(own) @ S.T)
        for mass, S, own in zip((2.0, 1.0), turned, moments, strict=True)
    )
    return HingePair(**CONSTANTS, body1=body1, body2=body2)


def dynamics(samples: int, repeats: int, cpp: bool, tell: Tell) -> Report:
    """One state and many, both ways; a simulation to a given error."""
    pair, rows, notes = bodies(), list[Row](), []
    missing = cpp_missing(dynamics=True) if cpp else "compiled where --cpp asks for it"
    if missing:
        notes.append(f"left out: {CPP} ({missing})")
    for count in (1, samples):
        motion = Motion(pair, count)
        for case, inverse in ((INVERSE, True), (FORWARD, False)):
            ways = motion.ways(inverse, cpp=not missing)
            counts = {name: min(count, _FEW if name in {PYTHON_LOOP, MUJOCO} else count) for name in ways}
            tell(f"{case}, N = {count:,}: {len(ways)} ways, {repeats} repeats")
            rows += measured(case_of(case, count), ways, repeats, counts)
    if find_spec("scipy"):
        rows += simulation(pair, repeats, tell)
    notes.append(f"error: largest of attitude and psi over 10 s [rad]; tolerances by which it is at most {GOAL:g}")
    return Report(rows, "error [rad]", targets(rows, samples), notes)


def case_of(case: str, count: int) -> str:
    """The name of a case."""
    return f"{case}, N = {count:,}"


def targets(rows: Sequence[Row], samples: int) -> list[Target]:
    """What the rows say of each target, as far as they were measured."""
    by = {(row.case, row.method): row.ratio for row in rows}
    found = []
    for case in (INVERSE, FORWARD):
        one, many = case_of(case, 1), case_of(case, samples)
        if (one, PYTHON_LOOP) in by:
            ratio = by[one, PREPARED] / by[one, PYTHON_LOOP]
            found.append(Target(f"{case}, one state prepared", ratio, 1.0, "x Pinocchio from Python"))
        if (many, CPP) in by:
            found.append(Target(many, by[many, CPP] / by[many, OURS], 5.0, f"x {CPP}", least=True))
    if (SIMULATION, DOP853) in by:
        found.append(Target("a simulation", by[SIMULATION, DOP853], 10.0, f"x {DOP853}", least=True))
    return found


class Motion:
    """Random states, forces that fit them, and both as the engines take them."""

    def __init__(self, pair: HingePair, count: int) -> None:
        rng = np.random.default_rng(23)
        self.pair, self.count = pair, count
        R, v, omega, a, alpha, turn = rng.normal(size=(6, count, 3))
        self.hinge: Array = rng.normal(size=(3, count))
        self.body1 = BodyMotion(R=R, S=rotation_exp(turn), v=v, omega=omega, a=a, alpha=alpha)
        self.forces = pair.inverse_dynamics(self.body1, *self.hinge)
        twin = to_pinocchio(pair)
        makers: tuple[Any, ...] = (twin.configuration, twin.velocity, twin.acceleration)
        self.engine: list[Array] = [make(self.body1, *self.hinge[: i + 1]) for i, make in enumerate(makers)]
        own = np.swapaxes(self.body1.S, -1, -2)
        vectors = [(own @ vector[..., None])[..., 0] for vector in self.forces[:2]]
        self.tau = np.concatenate([*vectors, self.forces.hinge_torque[:, None]], axis=-1)

    def ways(self, inverse: bool, *, cpp: bool) -> dict[str, Job]:
        """Jobs by name."""
        found: dict[str, Job] = {} if self.count > 1 else {PREPARED: self._prepared(inverse)}
        found[OURS] = self._ours(inverse)
        found[PYTHON_LOOP] = self._pinocchio(inverse)
        if cpp:
            found[CPP] = self._compiled(inverse)
        if find_spec("mujoco"):
            found[MUJOCO] = self._mujoco(inverse)
        return found

    def _ours(self, inverse: bool) -> Job:
        pair, body1, (psi, psid, psidd), (force1, torque1, hinge) = self.pair, self.body1, self.hinge, self.forces
        if inverse:
            return lambda: pair.inverse_dynamics(body1, psi, psid, psidd)
        return lambda: pair.forward_dynamics(body1, psi, psid, force1=force1, torque1=torque1, hinge_torque=hinge)

    def _prepared(self, inverse: bool) -> Job:
        """From a quaternion, as Pinocchio's."""
        psi, psid, psidd = map(float, self.hinge[:, 0])
        moves = [np.array(array[0]) for array in (self.body1.omega, self.body1.a, self.body1.alpha)]  # type: ignore[index]
        quat, (force1, torque1, hinge) = self.engine[0][0, 3:7].copy(), (np.array(part[0]) for part in self.forces)
        if inverse:
            given = ("quat_xyzw", "omega1", "a1", "alpha1", "psi", "psid", "psidd")
            call = self.pair.prepare(given, outputs=("force1", "torque1", "hinge_torque"))

            def run() -> Any:
                state = call(quat, *moves, psi, psid, psidd)
                return state.force1, state.torque1, state.hinge_torque

            return run
        follow = self.pair.prepare(("quat_xyzw", "omega1", "psi", "psid", "force1", "torque1", "hinge_torque"))
        omega, torque = moves[0], float(hinge)

        def solve() -> Any:
            state = follow(quat, omega, psi, psid, force1, torque1, torque)
            return state.a1, state.alpha1, state.psidd

        return solve

    def _pinocchio(self, inverse: bool) -> Job:
        """From Python: of one state its parts are read out, of many each goes into an array."""
        import pinocchio as pin

        twin = to_pinocchio(self.pair)
        model, data, call = twin.model, twin.data, pin.rnea if inverse else pin.aba
        q, v, last = (self.engine[0], self.engine[1], self.engine[2] if inverse else self.tau)
        count = min(self.count, _FEW)
        room = np.empty((count, 7))
        if count == 1:
            one = q[0], v[0], last[0]

            def read() -> Any:
                found = call(model, data, *one)
                return found[:3], found[3:6], found[6]

            return read

        def run() -> Array:
            for i in range(count):
                room[i] = call(model, data, q[i], v[i], last[i])
            return room

        return run

    def _compiled(self, inverse: bool) -> Job:
        """The same loop in C++."""
        library, pair = compiled_loop(dynamics=True), self.pair
        constants = [np.ascontiguousarray(c) for c in (pair.u1, pair.u2, pair.n, pair.home)]
        handle = library.pair_new(*map(address_of, constants))
        both: list[Any] = [pair.body1, pair.body2]
        masses = [np.array([getattr(one, name) for one in both]) for name in ("mass", "center_of_mass", "inertia")]
        library.pair_masses(handle, *map(address_of, masses))
        room = np.ones((self.count, 7))
        arrays = [self.engine[0], self.engine[1], self.engine[2] if inverse else self.tau, room]
        addresses = [address_of(array) for array in arrays]

        def run() -> Array:
            library.pair_dynamics(handle, int(inverse), self.count, *addresses)
            return room

        weakref.finalize(run, lambda *_: library.pair_delete(handle), *arrays)
        return run

    def _mujoco(self, inverse: bool) -> Job:
        """MuJoCo on the exported model."""
        import mujoco as mj

        model = mj.MjModel.from_xml_string(to_mjcf(self.pair))
        model.opt.gravity[:] = GRAVITY
        data, count = mj.MjData(model), min(self.count, _FEW)
        q = self.engine[0][:count, [0, 1, 2, 6, 3, 4, 5, 7]]
        own = np.swapaxes(self.body1.S[:count], -1, -2)
        _, psid, psidd = self.hinge[:, :count, None]
        turned = [(own @ x[:count, :, None])[..., 0] for x in (self.body1.omega, self.body1.alpha)]  # type: ignore[index]
        v = np.concatenate([self.body1.v[:count], turned[0], psid], axis=-1)  # type: ignore[index]
        a = np.concatenate([self.body1.a[:count], turned[1], psidd], axis=-1)  # type: ignore[index]
        tau = np.concatenate([self.forces.force1[:count], self.tau[:count, 3:]], axis=-1)
        room = np.empty((count, 7))

        def run() -> Array:
            for i in range(count):
                data.qpos[:], data.qvel[:] = q[i], v[i]
                if inverse:
                    data.qacc[:] = a[i]
                    mj.mj_inverse(model, data)
                    room[i] = data.qfrc_inverse
                else:
                    data.qfrc_applied[:] = tau[i]
                    mj.mj_forward(model, data)
                    room[i] = data.qacc
            return room

        return run


SIMULATION = f"simulation of 10 s, error at most {GOAL:g}"


def simulation(pair: HingePair, repeats: int, tell: Tell) -> list[Row]:
    """A tumbling pair with a spring at its hinge, by the coarsest tolerance that reaches the goal."""
    truth = by_scipy(pair, 1e-13)()
    start = BodyMotion(R=np.zeros(3), S=np.eye(3), omega=_SPIN)

    def ours(tol: float) -> Job:
        return lambda: simulate(
            pair, _TIME, start, 0.5, 1.0, hinge_torque=lambda _t, psi, _psid: -_SPRING * psi, tol=tol
        )

    makers: Mapping[str, Callable[[float], Job]] = {OURS: ours, DOP853: lambda tol: by_scipy(pair, tol)}
    jobs, errors = {}, {}
    tell(f"simulation: tolerances for an error of {GOAL:g}, {repeats} repeats")
    for name, make in makers.items():
        for tol in np.logspace(-5, -13, 17):
            found = make(float(tol))()
            other = (found.quat_wxyz, found.psi) if name == OURS else found
            errors[name] = error_of(other, truth)
            if errors[name] <= GOAL:
                break
        jobs[name] = make(float(tol))
    return measured(SIMULATION, jobs, repeats, errors=errors)


def error_of(found: tuple[Array, Array], truth: tuple[Array, Array]) -> float:
    """Largest error of the attitude and of psi [rad]."""
    one, other = (q / np.linalg.norm(q, axis=-1, keepdims=True) for q in (found[0], truth[0]))
    gap = np.minimum(np.linalg.norm(one - other, axis=-1), np.linalg.norm(one + other, axis=-1))
    return float(max(2 * gap.max(), np.abs(found[1] - truth[1]).max()))


def by_scipy(pair: HingePair, tol: float) -> Callable[[], tuple[Array, Array]]:
    """The same motion by SciPy's DOP853: quaternions (scalar first, of length 1 to its error) and psi."""
    from scipy.integrate import solve_ivp

    rates = textbook(pair, lambda psi: -_SPRING * psi)
    start = np.concatenate([np.zeros(3), (1, 0, 0, 0), (0.5,), np.zeros(3), _SPIN, (1.0,)])

    def run() -> tuple[Array, Array]:
        y = solve_ivp(rates, (_TIME[0], _TIME[-1]), start, "DOP853", _TIME, rtol=tol, atol=tol).y
        return y[3:7].T / np.linalg.norm(y[3:7], axis=0)[:, None], y[7]

    return run


def textbook(pair: HingePair, torque: Callable[[float], float]) -> Callable[[float, Array], Array]:
    """Newton and Euler by Jacobians of both centres of mass; the state: R1, quaternion, psi, v1, omega1, psi'."""
    one: Any = pair.body1
    two: Any = pair.body2
    K = _skew(pair.n)
    g = np.array(GRAVITY)

    def rates(_: float, y: Array) -> Array:
        w, x, z, u = y[3:7] / np.sqrt(y[3:7] @ y[3:7])
        q = np.array([x, z, u])
        Q = _skew(q)
        S1 = np.eye(3) + 2 * w * Q + 2 * Q @ Q
        psi, omega1, psid = y[7], y[11:14], y[14]
        S2 = S1 @ (np.eye(3) + np.sin(psi) * K + (1 - np.cos(psi)) * K @ K) @ pair.home
        axis, r1, h = S1 @ pair.n, S1 @ one.center_of_mass, S2 @ (two.center_of_mass - pair.u2)
        arm = S1 @ pair.u1
        omega2, alpha2 = omega1 + psid * axis, np.cross(omega1, psid * axis)
        M, bias = np.zeros((7, 7)), np.zeros(7)
        drift1 = np.cross(omega1, np.cross(omega1, r1))
        drift2 = np.cross(omega1, np.cross(omega1, arm)) + np.cross(omega2, np.cross(omega2, h)) + np.cross(alpha2, h)
        for body, S, r, push, turn, omega, drift, alpha in (
            (one, S1, r1, np.zeros(3), np.zeros(3), omega1, drift1, np.zeros(3)),
            (two, S2, arm + h, np.cross(axis, h), axis, omega2, drift2, alpha2),
        ):
            J = np.zeros((6, 7))
            J[:3, :3] = J[3:, 3:6] = np.eye(3)
            J[:3, 3:6], J[:3, 6], J[3:, 6] = -_skew(r), push, turn
            own = S @ body.inertia @ S.T
            W = np.zeros((6, 6))
            W[:3, :3], W[3:, 3:] = body.mass * np.eye(3), own
            M += J.T @ W @ J
            bias += J.T @ np.concatenate([body.mass * (drift - g), own @ alpha + np.cross(omega, own @ omega)])
        acceleration = np.linalg.solve(M, np.array([0, 0, 0, 0, 0, 0, torque(psi)]) - bias)
        turned = 0.5 * np.concatenate([[-omega1 @ q], w * omega1 + np.cross(omega1, q)])
        return np.concatenate([y[8:11], turned, [psid], acceleration])

    return rates


def _skew(v: Array) -> Array:
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
