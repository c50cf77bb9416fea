"""`hingepair bench dynamics`: forces from motion and motion from forces, beside Pinocchio, MuJoCo and SciPy.

The truth of a simulation is SciPy's solver at its finest over Newton and Euler as a textbook writes them; nothing of
hingepair has a part in it.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from importlib.util import find_spec
from operator import attrgetter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.direct import case_of
from hingepair.bench.engines import (
    CPP,
    DYNAMICS_FLAG,
    FEW,
    MUJOCO,
    PAIR_LOOP,
    PYTHON_LOOP,
    cpp_job,
    cpp_missing,
    mujoco_rows,
    pinocchio_rows,
)
from hingepair.bench.measure import (
    Job,
    Report,
    Row,
    Way,
    compared,
    interleaved,
    present,
    rows_of,
    tell,
)
from hingepair.bench.peers import CONSTANTS, OURS, PREPARED
from hingepair.dynamics.simulate import simulate
from hingepair.formats.model_writers import to_mjcf
from hingepair.pair.body import Body
from hingepair.pair.body_motion import BodyMotion, motion_of_rotations
from hingepair.pair.dynamics import GRAVITY, Forces
from hingepair.pair.hinge_load import HingeLoad
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import rotation_exp
from hingepair.validation.pinocchio_twin import to_pinocchio

Array: TypeAlias = NDArray[np.float64]

INVERSE, FORWARD = "inverse dynamics", "forward dynamics"
DOP853, RADAU, LSODA = "SciPy DOP853, NumPy", "SciPy Radau", "SciPy LSODA"
GOAL = 1e-8
"""Largest error of a simulation [rad]."""

_TIME = np.linspace(0, 10, 101)
_SPIN = np.array([0.3, 1.5, -0.7])
_SPRING = 3.0


def bodies() -> HingePair:
    """A pair whose bodies have masses."""
    body1 = Body(2.0, (0.1, -0.3, 0.2), [[0.7, 0.1, 0.05], [0.1, 0.6, -0.1], [0.05, -0.1, 0.8]])
    body2 = Body(1.0, (-0.2, 0.1, 0.05), [[0.3, 0.02, 0.04], [0.02, 0.25, -0.03], [0.04, -0.03, 0.35]])
    return HingePair(**CONSTANTS, body1=body1, body2=body2)


def dynamics(samples: int, repeats: int, cpp: bool) -> Report:
    """One state and many, both ways; a simulation to a given error."""
    pair, rows = bodies(), list[Row]()
    ways, notes = present(WAYS, {CPP: cpp_missing(cpp, PAIR_LOOP, DYNAMICS_FLAG)})
    for size in (1, samples):
        for case in (INVERSE, FORWARD):
            tell(f"{case}, N = {size:,}: {repeats} repeats")
            task = functools.cache(functools.partial(task_of, pair, case == INVERSE))
            own = ways[1:] if size > 1 else ways
            rows += compared(case_of(case, size), own, task, size, repeats)
    if find_spec("scipy"):
        rows += simulation(pair, repeats) + stiff_simulation(repeats)
    notes.append(
        f"error: largest of attitude and psi over the motion [rad]; tolerances by which it is at most {GOAL:g}"
    )
    return Report(rows, "error [rad]", notes)


class Task(NamedTuple):
    """Random states and forces that fit them, of which accelerations are sought, or, inverse, forces."""

    pair: HingePair  # with masses
    inverse: bool  # whether forces are sought
    body1: BodyMotion  # its motion
    hinge: Array  # psi, psi', psi''; shape (3, N)
    forces: Forces  # what acts
    rows: list[Array]  # Pinocchio's q and v, and its accelerations or, where these are sought, its forces


def task_of(pair: HingePair, inverse: bool, count: int) -> Task:
    """So many random states."""
    rng = np.random.default_rng(23)
    R, v, omega, a, alpha, turn = rng.normal(size=(6, count, 3))
    hinge: Array = rng.normal(size=(3, count))
    body1 = motion_of_rotations(R=R, S=rotation_exp(turn), v=v, omega=omega, a=a, alpha=alpha)
    forces = pair.inverse_dynamics(body1, *hinge)
    rows = pinocchio_rows(pair, body1, hinge)
    if not inverse:
        own = np.swapaxes(body1.S, -1, -2)
        vectors = [(own @ vector[..., None])[..., 0] for vector in forces[:2]]
        rows[2] = np.concatenate([*vectors, forces.hinge_torque[:, None]], axis=-1)
    return Task(pair, inverse, body1, hinge, forces, rows)


def ours(task: Task) -> Job:
    """The methods of the pair."""
    pair, _, body1, (psi, psid, psidd), (force1, torque1, hinge), _ = task
    if task.inverse:
        return lambda: pair.inverse_dynamics(body1, psi, psid, psidd)
    return lambda: pair.forward_dynamics(body1, psi, psid, force1=force1, torque1=torque1, hinge_torque=hinge)


def prepared(task: Task) -> Job:
    """One state from a quaternion, as Pinocchio's; what comes out is looked at."""
    psi, psid, psidd = map(float, task.hinge[:, 0])
    body1: Any = task.body1
    quat, omega, a, alpha = (x[0].copy() for x in (task.rows[0][:, 3:7], body1.omega, body1.a, body1.alpha))
    force1, torque1, hinge = (np.array(part[0]) for part in task.forces)
    if task.inverse:
        names, outputs = ("a1", "alpha1", "psi", "psid", "psidd"), ("force1", "torque1", "hinge_torque")
        given: tuple[Any, ...] = (a, alpha, psi, psid, psidd)
    else:
        names, outputs = ("psi", "psid", "force1", "torque1", "hinge_torque"), ("a1", "alpha1", "psidd")
        given = (psi, psid, force1, torque1, float(hinge))
    call, read = task.pair.prepare(("quat_xyzw", "omega1", *names), outputs=outputs), attrgetter(*outputs)
    return lambda: read(call(quat, omega, *given))


def pinocchio_loop(task: Task) -> Job:
    """From Python: of one state its parts are read out, of many each goes into an array."""
    import pinocchio as pin

    twin = to_pinocchio(task.pair)
    model, data, call = twin.model, twin.data, pin.rnea if task.inverse else pin.aba
    q, v, last = task.rows
    room = np.empty_like(v)
    if len(q) == 1:
        one = q[0], v[0], last[0]

        def read() -> Any:
            found = call(model, data, *one)
            return found[:3], found[3:6], found[6]

        return read

    def run() -> Array:
        for i in range(len(q)):
            room[i] = call(model, data, q[i], v[i], last[i])
        return room

    return run


def pinocchio_cpp(task: Task) -> Job:
    """The same loop in C++."""
    room = np.ones_like(task.rows[1])
    return cpp_job(task.pair, [int(task.inverse), len(room), *task.rows, room], room, dynamics=True)


def mujoco_loop(task: Task) -> Job:
    """MuJoCo on the exported model."""
    import mujoco as mj

    model = mj.MjModel.from_xml_string(to_mjcf(task.pair))
    model.opt.gravity[:] = GRAVITY
    data = mj.MjData(model)
    rows = mujoco_rows(task.rows, task.body1.v, task.body1.a if task.inverse else task.forces.force1)
    last, solve, found = (
        (data.qacc, mj.mj_inverse, data.qfrc_inverse)
        if task.inverse
        else (data.qfrc_applied, mj.mj_forward, data.qacc)
    )
    room = np.empty_like(rows[1])

    def run() -> Array:
        for i, given in enumerate(zip(*rows, strict=True)):
            data.qpos[:], data.qvel[:], last[:] = given
            solve(model, data)
            room[i] = found
        return room

    return run


WAYS = (
    Way(PREPARED, prepared),
    Way(OURS, ours),
    Way(PYTHON_LOOP, pinocchio_loop, most=FEW, needs="pinocchio"),
    Way(CPP, pinocchio_cpp, needs="pinocchio"),
    Way(MUJOCO, mujoco_loop, most=FEW, needs="mujoco"),
)
"""The first is of one state only."""


SIMULATION = f"simulation of 10 s, error at most {GOAL:g}"


def simulation(pair: HingePair, repeats: int) -> list[Row]:
    """A tumbling pair with a spring at its hinge, by the coarsest tolerance that reaches the goal."""
    truth = by_scipy(pair, 1e-13)()
    start = BodyMotion(R=np.zeros(3), S=np.eye(3), omega=_SPIN)

    def spring(_t: Array, psi: Array, _psid: Array) -> Array:
        return -_SPRING * psi

    def by_us(tol: float) -> Job:
        read = attrgetter("quat_wxyz", "psi")
        return lambda: read(simulate(pair, _TIME, start, 0.5, 1.0, hinge_torque=spring, tol=tol))

    makers: dict[str, Callable[[float], Job]] = {OURS: by_us, DOP853: lambda tol: by_scipy(pair, tol)}
    return _at_goal(SIMULATION, makers, lambda found: error_of(found, truth), repeats)


STIFF_SIMULATION = f"simulation of stiff friction, 0.2 s, error at most {GOAL:g}"
_STIFF_TIME = np.linspace(0, 0.2, 21)
_STIFF_INERTIA, _STIFF_FRICTION = 3e-5, 0.05  # kg m^2, N m: reached at 0.01 rad/s, in 6 us


def stiff_simulation(repeats: int) -> list[Row]:
    """A small wheel that a motor swings against friction, beside SciPy's solvers for stiff equations."""
    from scipy.integrate import solve_ivp

    wheel = HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=Body(1.0, inertia=_STIFF_INERTIA * np.eye(3)))
    start = BodyMotion(R=np.zeros(3), S=np.eye(3))
    load = HingeLoad(friction=_STIFF_FRICTION, friction_rate=0.01, motor=lambda t, _psi, _psid: 0.1 * np.sin(50 * t))

    def rates(t: float, y: Array) -> list[float]:
        return [y[1], (0.1 * np.sin(50 * t) - _STIFF_FRICTION * np.tanh(y[1] / 0.01)) / _STIFF_INERTIA]

    def jacobian(_t: float, y: Array) -> list[list[float]]:
        return [[0, 1], [0, -_STIFF_FRICTION / 0.01 / np.cosh(min(abs(y[1] / 0.01), 300)) ** 2 / _STIFF_INERTIA]]

    def by_scipy_solver(solver: str, tol: float) -> Job:
        span = _STIFF_TIME[0], _STIFF_TIME[-1]
        given: dict[str, Any] = {"rtol": max(tol, 3e-14), "atol": tol, "jac": jacobian}
        return lambda: solve_ivp(rates, span, [0.0, 1.0], solver, _STIFF_TIME, **given).y[0]

    def by_us(tol: float) -> Job:
        return lambda: simulate(wheel, _STIFF_TIME, start, 0.0, 1.0, hinge_torque=load, base="fixed", tol=tol).psi

    truth = by_scipy_solver("Radau", 1e-13)()
    makers: dict[str, Callable[[float], Job]] = {
        OURS: by_us,
        RADAU: functools.partial(by_scipy_solver, "Radau"),
        LSODA: functools.partial(by_scipy_solver, "LSODA"),
    }
    return _at_goal(STIFF_SIMULATION, makers, lambda psi: float(np.abs(psi - truth).max()), repeats)


def _at_goal(
    case: str, makers: dict[str, Callable[[float], Job]], error: Callable[[Any], float], repeats: int
) -> list[Row]:
    """Return the rows of simulations, each by the coarsest tolerance that reaches the goal."""
    jobs, errors = {}, {}
    tell(f"{case}: tolerances, {repeats} repeats")
    for name, make in makers.items():
        for tol in np.logspace(-5, -13, 17):
            jobs[name] = make(float(tol))
            errors[name] = error(jobs[name]())
            if errors[name] <= GOAL:
                break
    return rows_of(case, interleaved(jobs, repeats), errors=errors)


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
