"""`hingepair bench dynamics`: inverse and forward dynamics and simulations, beside Pinocchio, MuJoCo and SciPy.

The truth of a simulation is SciPy's solver at its smallest tolerance on the textbook's Newton and Euler equations,
which share no code with hingepair.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from importlib.util import find_spec
from operator import attrgetter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench import engines
from hingepair.bench.direct import PAIR_ARGUMENTS
from hingepair.bench.engines import FORWARD, INVERSE, States
from hingepair.bench.harness import (
    HINGEPAIR,
    PREPARED,
    Case,
    Job,
    Method,
    Report,
    batch_case,
    installed,
    measure,
    print_progress,
)
from hingepair.dynamics.simulate import simulate
from hingepair.pair.body import Body
from hingepair.pair.body_motion import BodyMotion, motion_of_rotations
from hingepair.pair.dynamics import DEFAULT_GRAVITY
from hingepair.pair.hinge_load import HingeLoad
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.states import Forces
from hingepair.rotations.matrices import rotation_exp

Array: TypeAlias = NDArray[np.float64]

MAX_ERROR = 1e-8  # rad; simulations are compared at their coarsest tolerances that reach it


def make_pair() -> HingePair:
    """Return the benchmark's pair, with masses."""
    body1 = Body(2.0, (0.1, -0.3, 0.2), [[0.7, 0.1, 0.05], [0.1, 0.6, -0.1], [0.05, -0.1, 0.8]])
    body2 = Body(1.0, (-0.2, 0.1, 0.05), [[0.3, 0.02, 0.04], [0.02, 0.25, -0.03], [0.04, -0.03, 0.35]])
    return HingePair(**PAIR_ARGUMENTS, body1=body1, body2=body2)


def bench_dynamics(batch_size: int, repeats: int, with_cpp: bool) -> Report:
    """Measure dynamics of one state and of a batch, and simulations if SciPy is installed.

    Args:
        batch_size: states of the batch.
        repeats: of each measurement.
        with_cpp: whether the C++ loop of Pinocchio is compiled and measured; if this fails, a note says why.
    """
    pair = make_pair()
    methods, notes = installed(METHODS, engines.cpp_reasons(with_cpp))
    rows = measure(
        (
            batch_case(workload, methods[size > 1 :], functools.partial(make_task, pair, workload), size)
            for size in (1, batch_size)
            for workload in (INVERSE, FORWARD)
        ),
        repeats,
    )
    if find_spec("scipy"):
        rows += measure((tumbling_case(pair), stiff_case()), repeats)
    notes.append(
        "error: largest error of attitude and psi over the motion [rad]; each solver has the coarsest tolerance "
        f"with an error of at most {MAX_ERROR:g}"
    )
    return Report(rows, "error [rad]", notes)


class Task(NamedTuple):
    """Random states of a pair, with their accelerations and the forces that cause them."""

    pair: HingePair
    workload: str  # INVERSE: the forces are computed; FORWARD: the accelerations
    body1: BodyMotion
    hinge: Array  # psi, psi', psi''; (3, N)
    forces: Forces
    states: States  # as other engines take them


@functools.lru_cache(maxsize=2)  # the methods of a case share it
def make_task(pair: HingePair, workload: str, count: int) -> Task:
    """Return a task of `count` states, always the same."""
    rng = np.random.default_rng(23)
    R, v, omega, a, alpha, turn = rng.normal(size=(6, count, 3))
    hinge: Array = rng.normal(size=(3, count))
    body1 = motion_of_rotations(R=R, S=rotation_exp(turn), v=v, omega=omega, a=a, alpha=alpha)
    forces = pair.inverse_dynamics(body1, *hinge)
    states = engines.pair_states(workload, pair, body1, list(hinge))
    if workload == FORWARD:
        to_body1 = np.swapaxes(body1.S, -1, -2)
        vectors = [(to_body1 @ vector[..., None])[..., 0] for vector in (forces.force1, forces.torque1)]
        w = np.concatenate([*vectors, forces.hinge_torque[:, None]], axis=-1)
        states = states._replace(rows=(*states.rows[:2], w))
    return Task(pair, workload, body1, hinge, forces, states)


def hingepair_job(task: Task) -> Job:
    """Return the job of `inverse_dynamics` or `forward_dynamics`."""
    pair, workload, body1, (psi, psid, psidd), (force1, torque1, hinge), _ = task
    if workload == INVERSE:
        return lambda: pair.inverse_dynamics(body1, psi, psid, psidd)
    return lambda: pair.forward_dynamics(body1, psi, psid, force1=force1, torque1=torque1, hinge_torque=hinge)


def prepared_job(task: Task) -> Job:
    """Return the job of a prepared function at the first state; the attitude is a quaternion."""
    psi, psid, psidd = map(float, task.hinge[:, 0])
    body1: Any = task.body1
    quat, omega, a, alpha = (x[0].copy() for x in (task.states.rows[0][:, 3:7], body1.omega, body1.a, body1.alpha))
    force1, torque1, hinge = (np.array(part[0]) for part in task.forces)
    if task.workload == INVERSE:
        names, outputs = ("a1", "alpha1", "psi", "psid", "psidd"), ("force1", "torque1", "hinge_torque")
        inputs: tuple[Any, ...] = (a, alpha, psi, psid, psidd)
    else:
        names, outputs = ("psi", "psid", "force1", "torque1", "hinge_torque"), ("a1", "alpha1", "psidd")
        inputs = (psi, psid, force1, torque1, float(hinge))
    call, read = task.pair.prepare(("quat_xyzw", "omega1", *names), outputs=outputs), attrgetter(*outputs)
    return lambda: read(call(quat, omega, *inputs))


METHODS = (  # ratios refer to the first
    Method(PREPARED, prepared_job),  # of one state only
    Method(HINGEPAIR, hingepair_job),
    *engines.methods(attrgetter("states")),
)


def case_at_error(name: str, makers: Mapping[str, Callable[[float], Job]], error: Callable[[Any], float]) -> Case:
    """Return the case of solvers at their largest tolerances from 1e-5 to 1e-13 with errors of at most MAX_ERROR.

    Args:
        name: what is simulated.
        makers: returns the job of a tolerance, by the solver's name.
        error: of a job's result [rad].
    """
    jobs, errors = {}, {}
    print_progress(f"{name}: tolerances")
    for solver, make in makers.items():
        for tol in np.logspace(-5, -13, 17):
            jobs[solver] = make(float(tol))
            errors[solver] = error(jobs[solver]())
            if errors[solver] <= MAX_ERROR:
                break
    return Case(f"{name}, error at most {MAX_ERROR:g}", jobs, errors=errors)


def tumbling_case(pair: HingePair, duration: float = 10.0) -> Case:
    """Return the case of a tumbling pair with a spring of 3 N m/rad in its hinge."""
    from scipy.integrate import solve_ivp

    times, omega = np.linspace(0, duration, 101), np.array([0.3, 1.5, -0.7])
    rates = newton_euler_rates(pair, lambda psi: -3.0 * psi)
    y_0 = np.concatenate([np.zeros(3), (1, 0, 0, 0), (0.5,), np.zeros(3), omega, (1.0,)])
    start = BodyMotion(R=np.zeros(3), S=np.eye(3), omega=omega)
    read = attrgetter("quat_wxyz", "psi")

    def by_scipy(tol: float) -> Job:
        """Return the job of SciPy's solver, of which attitudes and psi come back."""

        def run() -> tuple[Array, Array]:
            y = solve_ivp(rates, (0, duration), y_0, "DOP853", times, rtol=tol, atol=tol).y
            return y[3:7].T / np.linalg.norm(y[3:7], axis=0)[:, None], y[7]

        return run

    def spring(_t: Array, psi: Array, _psid: Array) -> Array:
        return -3.0 * psi

    def by_hingepair(tol: float) -> Job:
        return lambda: read(simulate(pair, times, start, 0.5, 1.0, hinge_torque=spring, tol=tol))

    truth = by_scipy(1e-13)()
    makers = {HINGEPAIR: by_hingepair, "SciPy DOP853, NumPy": by_scipy}
    return case_at_error(f"simulation of {duration:g} s", makers, lambda found: simulation_error(found, truth))


def stiff_case() -> Case:
    """Return the case of a wheel with a motor and friction whose time constant is 6 us."""
    from scipy.integrate import solve_ivp

    inertia, friction = 3e-5, 0.05  # kg m^2; N m, reached at 0.01 rad/s
    times = np.linspace(0, 0.2, 21)  # s
    wheel = HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=Body(1.0, inertia=inertia * np.eye(3)))
    start = BodyMotion(R=np.zeros(3), S=np.eye(3))
    load = HingeLoad(friction=friction, friction_rate=0.01, motor=lambda t, _psi, _psid: 0.1 * np.sin(50 * t))

    def rates(t: float, y: Array) -> list[float]:
        return [y[1], (0.1 * np.sin(50 * t) - friction * np.tanh(y[1] / 0.01)) / inertia]

    def jacobian(_t: float, y: Array) -> list[list[float]]:
        return [[0, 1], [0, -friction / 0.01 / np.cosh(min(abs(y[1] / 0.01), 300)) ** 2 / inertia]]

    def by_scipy(solver: str, tol: float) -> Job:
        options: dict[str, Any] = {"rtol": max(tol, 3e-14), "atol": tol, "jac": jacobian}
        return lambda: solve_ivp(rates, (0, 0.2), [0.0, 1.0], solver, times, **options).y[0]

    def by_hingepair(tol: float) -> Job:
        return lambda: simulate(wheel, times, start, 0.0, 1.0, hinge_torque=load, base="fixed", tol=tol).psi

    truth = by_scipy("Radau", 1e-13)()
    makers = {HINGEPAIR: by_hingepair} | {
        f"SciPy {solver}": functools.partial(by_scipy, solver) for solver in ("Radau", "LSODA")
    }
    name = "simulation of stiff friction, 0.2 s"
    return case_at_error(name, makers, lambda psi: float(np.abs(psi - truth).max()))


def simulation_error(found: tuple[Array, Array], truth: tuple[Array, Array]) -> float:
    """Return the largest difference of attitude or psi [rad] between two simulations, (quat_wxyz, psi) each."""
    one, other = (q / np.linalg.norm(q, axis=-1, keepdims=True) for q in (found[0], truth[0]))
    gap = np.minimum(np.linalg.norm(one - other, axis=-1), np.linalg.norm(one + other, axis=-1))
    return float(max(2 * gap.max(), np.abs(found[1] - truth[1]).max()))


def newton_euler_rates(pair: HingePair, hinge_torque: Callable[[float], float]) -> Callable[[float, Array], Array]:
    """Return the right-hand side of the equations of motion for ODE solvers.

    Args:
        pair: a pair with masses.
        hinge_torque: [N m], of psi.

    Returns:
        Function of t and the state (R1, quat_wxyz, psi, v1, omega1, psi') that returns the state's derivative.
    """
    body1: Any = pair.body1
    body2: Any = pair.body2
    K = _skew(pair.n)
    g = np.array(DEFAULT_GRAVITY)

    def rates(_: float, y: Array) -> Array:
        w, x, z, u = y[3:7] / np.sqrt(y[3:7] @ y[3:7])
        q = np.array([x, z, u])
        Q = _skew(q)
        S1 = np.eye(3) + 2 * w * Q + 2 * Q @ Q
        psi, omega1, psid = y[7], y[11:14], y[14]
        S2 = S1 @ (np.eye(3) + np.sin(psi) * K + (1 - np.cos(psi)) * K @ K) @ pair.home
        axis, r1, h = S1 @ pair.n, S1 @ body1.centre_of_mass, S2 @ (body2.centre_of_mass - pair.u2)
        arm = S1 @ pair.u1
        omega2, alpha2 = omega1 + psid * axis, np.cross(omega1, psid * axis)
        # Accelerations of both centres of mass where those of the coordinates are zero.
        drift1 = np.cross(omega1, np.cross(omega1, r1))
        drift2 = np.cross(omega1, np.cross(omega1, arm)) + np.cross(omega2, np.cross(omega2, h)) + np.cross(alpha2, h)
        # Newton's and Euler's laws of each body, projected on the coordinates.
        M, bias = np.zeros((7, 7)), np.zeros(7)
        for body, S, r, linear, angular, omega, drift, alpha in (
            (body1, S1, r1, np.zeros(3), np.zeros(3), omega1, drift1, np.zeros(3)),
            (body2, S2, arm + h, np.cross(axis, h), axis, omega2, drift2, alpha2),
        ):
            J = np.zeros((6, 7))
            J[:3, :3] = J[3:, 3:6] = np.eye(3)
            J[:3, 3:6], J[:3, 6], J[3:, 6] = -_skew(r), linear, angular
            inertia = S @ body.inertia @ S.T
            W = np.zeros((6, 6))
            W[:3, :3], W[3:, 3:] = body.mass * np.eye(3), inertia
            M += J.T @ W @ J
            bias += J.T @ np.concatenate(
                [body.mass * (drift - g), inertia @ alpha + np.cross(omega, inertia @ omega)]
            )
        acceleration = np.linalg.solve(M, np.array([0, 0, 0, 0, 0, 0, hinge_torque(psi)]) - bias)
        quat_rate = 0.5 * np.concatenate([[-omega1 @ q], w * omega1 + np.cross(omega1, q)])
        return np.concatenate([y[8:11], quat_rate, [psid], acceleration])

    return rates


def _skew(v: Array) -> Array:
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
