"""`hingepair bench dynamics`: inverse and forward dynamics and simulations, beside Pinocchio, MuJoCo and SciPy.

The reference of a simulation is SciPy's solver at its smallest tolerance, applied to the textbook equations of Newton
and Euler; it is computed independently of hingepair.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from importlib.util import find_spec
from operator import attrgetter
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.engines import (
    DYNAMICS_FLAG,
    FORWARD_WORKLOAD,
    INVERSE_WORKLOAD,
    MAX_SAMPLES_IN_PYTHON_LOOP,
    MUJOCO_NAME,
    PAIR_LOOP_SOURCE,
    PINOCCHIO_CPP_NAME,
    PINOCCHIO_LOOP_NAME,
    cpp_missing_reason,
    make_cpp_job,
    mujoco_coordinates,
    pinocchio_coordinates,
)
from hingepair.bench.measure import (
    Job,
    Method,
    Report,
    Row,
    available_methods,
    case_name,
    make_rows,
    measure_methods,
    print_progress,
    time_interleaved,
)
from hingepair.bench.peers import BENCH_PAIR_ARGUMENT_BY_NAME, HINGEPAIR_NAME, PREPARED_NAME
from hingepair.dynamics.simulate import simulate
from hingepair.formats.model_writers import to_mjcf
from hingepair.pair.body import Body
from hingepair.pair.body_motion import BodyMotion, motion_of_rotations
from hingepair.pair.dynamics import DEFAULT_GRAVITY_VECTOR, Forces
from hingepair.pair.hinge_load import HingeLoad
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import rotation_exp
from hingepair.validation.pinocchio_twin import to_pinocchio

Array: TypeAlias = NDArray[np.float64]

DOP853_NAME, RADAU_NAME, LSODA_NAME = "SciPy DOP853, NumPy", "SciPy Radau", "SciPy LSODA"  # names of methods
MAX_SIMULATION_ERROR_RAD = 1e-8
"""Largest error of a simulation [rad]; the run times of the coarsest tolerances that reach it are compared."""

_TUMBLING_SIMULATION_INSTANTS_SECONDS = np.linspace(0, 10, 101)  # [s], of the tumbling pair
_TUMBLING_INITIAL_OMEGA1_RAD_PER_SECOND = np.array([0.3, 1.5, -0.7])  # [rad/s], of the tumbling pair
_TUMBLING_HINGE_SPRING_STIFFNESS_NM_PER_RAD = 3.0  # [N m/rad], of the tumbling pair's hinge


def make_pair_with_masses() -> HingePair:
    """Return the hinge pair of this benchmark, whose bodies have masses, centres of mass and inertias."""
    body1 = Body(2.0, (0.1, -0.3, 0.2), [[0.7, 0.1, 0.05], [0.1, 0.6, -0.1], [0.05, -0.1, 0.8]])
    body2 = Body(1.0, (-0.2, 0.1, 0.05), [[0.3, 0.02, 0.04], [0.02, 0.25, -0.03], [0.04, -0.03, 0.35]])
    return HingePair(**BENCH_PAIR_ARGUMENT_BY_NAME, body1=body1, body2=body2)


def measure_dynamics(batch_size: int, repeats: int, with_cpp: bool) -> Report:
    """Measure run times of inverse and forward dynamics of one state and of `batch_size` states by hingepair and
    other packages, and of simulations if SciPy is installed, `repeats` times each; return the Report. `with_cpp`
    compiles and adds Pinocchio's C++ loop.
    """
    pair, rows = make_pair_with_masses(), list[Row]()
    methods, notes = available_methods(
        COMPARED_DYNAMICS_METHODS, {PINOCCHIO_CPP_NAME: cpp_missing_reason(with_cpp, PAIR_LOOP_SOURCE, DYNAMICS_FLAG)}
    )
    for size in (1, batch_size):
        for case in (INVERSE_WORKLOAD, FORWARD_WORKLOAD):
            print_progress(f"{case}, N = {size:,}: {repeats} repeats")
            task = functools.cache(functools.partial(make_dynamics_task, pair, case == INVERSE_WORKLOAD))
            applicable = methods[1:] if size > 1 else methods
            rows += measure_methods(case_name(case, size), applicable, task, size, repeats)
    if find_spec("scipy"):
        rows += measure_tumbling_simulation(pair, repeats) + measure_stiff_simulation(repeats)
    notes.append(
        f"error: largest error of attitude and psi over the motion [rad]; each solver has the coarsest tolerance "
        f"with an error of at most {MAX_SIMULATION_ERROR_RAD:g}"
    )
    return Report(rows, "error [rad]", notes)


class DynamicsTask(NamedTuple):
    """Random states of a pair, with their accelerations and the `forces` that cause them. A method is to compute the
    forces if `is_inverse`, else the accelerations. `body1` is the motion of body 1, `hinge` is an array of psi, psi'
    and psi'', shape (3, N), and `rows` is a list of the arrays that Pinocchio's function takes: q, v, and
    accelerations or forces, with a row for each state.
    """

    pair: HingePair  # with masses
    is_inverse: bool  # whether forces are computed; otherwise accelerations are
    body1: BodyMotion  # motion of body 1
    hinge: Array  # psi, psi', psi''; shape (3, N)
    forces: Forces  # forces on the pair
    rows: list[Array]  # Pinocchio's q, v and the third argument of its function: accelerations or forces


def make_dynamics_task(pair: HingePair, is_inverse: bool, count: int) -> DynamicsTask:
    """Return a DynamicsTask of `count` random states of a pair with masses, always the same ones. A method is to
    compute the forces if `is_inverse`, else the accelerations.

    Args:
        pair: a pair with masses.
        is_inverse: whether forces are computed.
        count: number of states.
    """
    rng = np.random.default_rng(23)
    R, v, omega, a, alpha, turn = rng.normal(size=(6, count, 3))
    hinge: Array = rng.normal(size=(3, count))
    body1 = motion_of_rotations(R=R, S=rotation_exp(turn), v=v, omega=omega, a=a, alpha=alpha)
    forces = pair.inverse_dynamics(body1, *hinge)
    rows = pinocchio_coordinates(pair, body1, hinge)
    if not is_inverse:
        S1_inverse = np.swapaxes(body1.S, -1, -2)
        vectors = [(S1_inverse @ vector[..., None])[..., 0] for vector in forces[:2]]
        rows[2] = np.concatenate([*vectors, forces.hinge_torque[:, None]], axis=-1)
    return DynamicsTask(pair, is_inverse, body1, hinge, forces, rows)


def hingepair_dynamics_job(task: DynamicsTask) -> Job:
    """Return a job, a function without arguments, that calls the pair's `inverse_dynamics` if the task is inverse,
    else `forward_dynamics`, for all states at once. The job returns the named tuple of arrays that the method
    returns.
    """
    pair, _, body1, (psi, psid, psidd), (force1, torque1, hinge), _ = task
    if task.is_inverse:
        return lambda: pair.inverse_dynamics(body1, psi, psid, psidd)
    return lambda: pair.forward_dynamics(body1, psi, psid, force1=force1, torque1=torque1, hinge_torque=hinge)


def prepared_dynamics_job(task: DynamicsTask) -> Job:
    """Return a job that computes inverse or forward dynamics of the task's first state by the function that
    `pair.prepare` returns. The job returns a tuple of the outputs: force1, torque1 and hinge_torque, or a1, alpha1
    and psidd. The attitude is given as a quaternion.
    """
    psi, psid, psidd = map(float, task.hinge[:, 0])
    body1: Any = task.body1
    quat, omega, a, alpha = (x[0].copy() for x in (task.rows[0][:, 3:7], body1.omega, body1.a, body1.alpha))
    force1, torque1, hinge = (np.array(part[0]) for part in task.forces)
    if task.is_inverse:
        names, outputs = ("a1", "alpha1", "psi", "psid", "psidd"), ("force1", "torque1", "hinge_torque")
        inputs: tuple[Any, ...] = (a, alpha, psi, psid, psidd)
    else:
        names, outputs = ("psi", "psid", "force1", "torque1", "hinge_torque"), ("a1", "alpha1", "psidd")
        inputs = (psi, psid, force1, torque1, float(hinge))
    call, read = task.pair.prepare(("quat_xyzw", "omega1", *names), outputs=outputs), attrgetter(*outputs)
    return lambda: read(call(quat, omega, *inputs))


def pinocchio_dynamics_job(task: DynamicsTask) -> Job:
    """Return a job that calls Pinocchio's inverse or forward dynamics for each state of the task in a Python loop.
    The job returns an array with a row of seven components for each state; for a single state it returns a tuple of
    the row's linear, angular and hinge parts.

    The results of a single state are read out part by part; those of many states are copied into an array.
    """
    import pinocchio as pin

    twin = to_pinocchio(task.pair)
    model, data, call = twin.model, twin.data, pin.rnea if task.is_inverse else pin.aba
    q, v, last = task.rows
    results = np.empty_like(v)
    if len(q) == 1:
        state = q[0], v[0], last[0]

        def read() -> Any:
            result = call(model, data, *state)
            return result[:3], result[3:6], result[6]

        return read

    def run() -> Array:
        for i in range(len(q)):
            results[i] = call(model, data, q[i], v[i], last[i])
        return results

    return run


def pinocchio_cpp_dynamics_job(task: DynamicsTask) -> Job:
    """Compile Pinocchio's C++ loop, unless it has been compiled before, and return a job that calls Pinocchio's
    inverse or forward dynamics for each state of the task in this loop. The job returns an array with a row for each
    state. Raise a MissingDependencyError if the loop cannot be compiled.
    """
    results = np.ones_like(task.rows[1])
    arguments = [int(task.is_inverse), len(results), *task.rows, results]
    return make_cpp_job(task.pair, arguments, results, with_dynamics=True)


def mujoco_dynamics_job(task: DynamicsTask) -> Job:
    """Return a job that calls MuJoCo's inverse or forward dynamics for each state of the task in a Python loop, on
    the model that `to_mjcf` exports. The job returns an array with a row for each state.
    """
    import mujoco as mj

    model = mj.MjModel.from_xml_string(to_mjcf(task.pair))
    data = mj.MjData(model)
    rows = mujoco_coordinates(task.rows, task.body1.v, task.body1.a if task.is_inverse else task.forces.force1)
    last, solve, result = (
        (data.qacc, mj.mj_inverse, data.qfrc_inverse)
        if task.is_inverse
        else (data.qfrc_applied, mj.mj_forward, data.qacc)
    )
    results = np.empty_like(rows[1])

    def run() -> Array:
        """Compute the forces or accelerations of every state by MuJoCo; return an array with a row for each state."""
        for i, row in enumerate(zip(*rows, strict=True)):
            data.qpos[:], data.qvel[:], last[:] = row
            solve(model, data)
            results[i] = result
        return results

    return run


COMPARED_DYNAMICS_METHODS = (
    Method(PREPARED_NAME, prepared_dynamics_job),
    Method(HINGEPAIR_NAME, hingepair_dynamics_job),
    Method(PINOCCHIO_LOOP_NAME, pinocchio_dynamics_job, max_samples=MAX_SAMPLES_IN_PYTHON_LOOP, package="pinocchio"),
    Method(PINOCCHIO_CPP_NAME, pinocchio_cpp_dynamics_job, package="pinocchio"),
    Method(MUJOCO_NAME, mujoco_dynamics_job, max_samples=MAX_SAMPLES_IN_PYTHON_LOOP, package="mujoco"),
)
"""All methods of `hingepair bench dynamics`; the first one computes one state only."""

TUMBLING_SIMULATION_CASE_NAME = f"simulation of 10 s, error at most {MAX_SIMULATION_ERROR_RAD:g}"  # name of the case


def measure_tumbling_simulation(pair: HingePair, repeats: int) -> list[Row]:
    """Measure the run time of the simulation of a tumbling pair with a hinge spring by hingepair and by SciPy's
    DOP853, `repeats` times. Return a list of two table rows, one for each method, with the run time and the error at
    the largest tolerance from 1e-5 to 1e-13 whose error is at most MAX_SIMULATION_ERROR_RAD, or at 1e-13 if there is
    none.
    """
    truth = scipy_simulation_job(pair, 1e-13)()
    start = BodyMotion(R=np.zeros(3), S=np.eye(3), omega=_TUMBLING_INITIAL_OMEGA1_RAD_PER_SECOND)

    def spring(_t: Array, psi: Array, _psid: Array) -> Array:
        return -_TUMBLING_HINGE_SPRING_STIFFNESS_NM_PER_RAD * psi

    def hingepair_job(tol: float) -> Job:
        """Return a job that simulates the pair by hingepair with tolerance `tol` and returns a tuple of two arrays
        (quat_wxyz, psi).
        """
        read = attrgetter("quat_wxyz", "psi")
        return lambda: read(
            simulate(pair, _TUMBLING_SIMULATION_INSTANTS_SECONDS, start, 0.5, 1.0, hinge_torque=spring, tol=tol)
        )

    makers: dict[str, Callable[[float], Job]] = {
        HINGEPAIR_NAME: hingepair_job,
        DOP853_NAME: lambda tol: scipy_simulation_job(pair, tol),
    }
    return _measure_at_max_error(
        TUMBLING_SIMULATION_CASE_NAME, makers, lambda result: simulation_error(result, truth), repeats
    )


STIFF_SIMULATION_CASE_NAME = (
    f"simulation of stiff friction, 0.2 s, error at most {MAX_SIMULATION_ERROR_RAD:g}"  # name of the case
)


def measure_stiff_simulation(repeats: int) -> list[Row]:
    """Measure the run time of the simulation of a motor-driven wheel with stiff friction by hingepair and by SciPy's
    Radau and LSODA, `repeats` times. Return a list of three table rows, one for each method, with the run time and
    the error at the largest tolerance from 1e-5 to 1e-13 whose error is at most MAX_SIMULATION_ERROR_RAD, or at 1e-13
    if there is none.
    """
    from scipy.integrate import solve_ivp

    inertia, friction_torque = 3e-5, 0.05  # [kg m^2] and [N m], reached at 0.01 rad/s; the time constant is 6 us
    times = np.linspace(0, 0.2, 21)  # [s]
    wheel = HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=Body(1.0, inertia=inertia * np.eye(3)))
    start = BodyMotion(R=np.zeros(3), S=np.eye(3))
    load = HingeLoad(friction=friction_torque, friction_rate=0.01, motor=lambda t, _psi, _psid: 0.1 * np.sin(50 * t))

    def rates(t: float, y: Array) -> list[float]:
        return [y[1], (0.1 * np.sin(50 * t) - friction_torque * np.tanh(y[1] / 0.01)) / inertia]

    def jacobian(_t: float, y: Array) -> list[list[float]]:
        return [[0, 1], [0, -friction_torque / 0.01 / np.cosh(min(abs(y[1] / 0.01), 300)) ** 2 / inertia]]

    def scipy_job(solver: str, tol: float) -> Job:
        span = times[0], times[-1]
        options: dict[str, Any] = {"rtol": max(tol, 3e-14), "atol": tol, "jac": jacobian}
        return lambda: solve_ivp(rates, span, [0.0, 1.0], solver, times, **options).y[0]

    def hingepair_job(tol: float) -> Job:
        return lambda: simulate(wheel, times, start, 0.0, 1.0, hinge_torque=load, base="fixed", tol=tol).psi

    truth = scipy_job("Radau", 1e-13)()
    makers: dict[str, Callable[[float], Job]] = {
        HINGEPAIR_NAME: hingepair_job,
        RADAU_NAME: functools.partial(scipy_job, "Radau"),
        LSODA_NAME: functools.partial(scipy_job, "LSODA"),
    }
    return _measure_at_max_error(
        STIFF_SIMULATION_CASE_NAME, makers, lambda psi: float(np.abs(psi - truth).max()), repeats
    )


def _measure_at_max_error(
    case: str,
    job_maker_by_method: dict[str, Callable[[float], Job]],
    error_of_result: Callable[[Any], float],
    repeats: int,
) -> list[Row]:
    """Measure the run time of each method, `repeats` times, at the largest tolerance from 1e-5 to 1e-13 whose error
    is at most MAX_SIMULATION_ERROR_RAD, or at 1e-13 if there is none; return a list of table rows.
    `job_maker_by_method` maps a method's name to a function from a tolerance to a job. `error_of_result` is a
    function from a job's result to its error [rad].

    Args:
        case: name of the case.
        job_maker_by_method: by the method's name, the function that makes its job of a tolerance.
        error_of_result: returns the error of a job's result [rad].
        repeats: of each measurement.
    """
    jobs, errors = {}, {}
    print_progress(f"{case}: tolerances, {repeats} repeats")
    for name, make in job_maker_by_method.items():
        for tol in np.logspace(-5, -13, 17):
            jobs[name] = make(float(tol))
            errors[name] = error_of_result(jobs[name]())
            if errors[name] <= MAX_SIMULATION_ERROR_RAD:
                break
    return make_rows(case, time_interleaved(jobs, repeats), errors=errors)


def simulation_error(simulation: tuple[Array, Array], truth: tuple[Array, Array]) -> float:
    """Return the largest difference of attitude or psi [rad] between a simulation and the true one, as a float. Both
    are tuples of two arrays (quat_wxyz, psi).
    """
    one, other = (q / np.linalg.norm(q, axis=-1, keepdims=True) for q in (simulation[0], truth[0]))
    gap = np.minimum(np.linalg.norm(one - other, axis=-1), np.linalg.norm(one + other, axis=-1))
    return float(max(2 * gap.max(), np.abs(simulation[1] - truth[1]).max()))


def scipy_simulation_job(pair: HingePair, tol: float) -> Callable[[], tuple[Array, Array]]:
    """Return a job that simulates the tumbling pair by SciPy's DOP853 with `tol` as relative and absolute tolerance.
    The job returns a tuple of two arrays (quat_wxyz, psi).
    """
    from scipy.integrate import solve_ivp

    rates = newton_euler_rates(pair, lambda psi: -_TUMBLING_HINGE_SPRING_STIFFNESS_NM_PER_RAD * psi)
    start = np.concatenate(
        [np.zeros(3), (1, 0, 0, 0), (0.5,), np.zeros(3), _TUMBLING_INITIAL_OMEGA1_RAD_PER_SECOND, (1.0,)]
    )

    def run() -> tuple[Array, Array]:
        """Simulate by SciPy's DOP853; return a tuple of two arrays: the unit quaternions (w, x, y, z) of body 1, and
        psi [rad].
        """
        y = solve_ivp(
            rates,
            (_TUMBLING_SIMULATION_INSTANTS_SECONDS[0], _TUMBLING_SIMULATION_INSTANTS_SECONDS[-1]),
            start,
            "DOP853",
            _TUMBLING_SIMULATION_INSTANTS_SECONDS,
            rtol=tol,
            atol=tol,
        ).y
        return y[3:7].T / np.linalg.norm(y[3:7], axis=0)[:, None], y[7]

    return run


def newton_euler_rates(pair: HingePair, hinge_torque: Callable[[float], float]) -> Callable[[float, Array], Array]:
    """Return the right-hand side of the equations of motion of a pair with masses, for ODE solvers: a function of the
    time and the state, an array of R1, quaternion (w, x, y, z), psi, v1, omega1 and psi', that returns the time
    derivative of the state. `hinge_torque` is a function from psi to the hinge torque [N m].

    Args:
        pair: a pair with masses.
        hinge_torque: the hinge torque [N m] as a function of psi.

    Returns:
        Function of t and the state (R1, quat_wxyz, psi, v1, omega1, psi'), which returns the state's derivative.
    """
    body1: Any = pair.body1
    body2: Any = pair.body2
    K = _skew_matrix(pair.n)
    g = np.array(DEFAULT_GRAVITY_VECTOR)

    def rates(_: float, y: Array) -> Array:
        """Return the time derivative of the state y, an array of position, quaternion (w, x, y, z), psi, v1, omega1
        and psi'. The time, which is the first argument, is ignored.
        """
        w, x, z, u = y[3:7] / np.sqrt(y[3:7] @ y[3:7])
        q = np.array([x, z, u])
        Q = _skew_matrix(q)
        S1 = np.eye(3) + 2 * w * Q + 2 * Q @ Q
        psi, omega1, psid = y[7], y[11:14], y[14]
        S2 = S1 @ (np.eye(3) + np.sin(psi) * K + (1 - np.cos(psi)) * K @ K) @ pair.home
        axis, r1, h = S1 @ pair.n, S1 @ body1.center_of_mass, S2 @ (body2.center_of_mass - pair.u2)
        arm = S1 @ pair.u1
        omega2, alpha2 = omega1 + psid * axis, np.cross(omega1, psid * axis)
        M, bias = np.zeros((7, 7)), np.zeros(7)
        drift1 = np.cross(omega1, np.cross(omega1, r1))
        drift2 = np.cross(omega1, np.cross(omega1, arm)) + np.cross(omega2, np.cross(omega2, h)) + np.cross(alpha2, h)
        for body, S, r, linear, angular, omega, drift, alpha in (
            (body1, S1, r1, np.zeros(3), np.zeros(3), omega1, drift1, np.zeros(3)),
            (body2, S2, arm + h, np.cross(axis, h), axis, omega2, drift2, alpha2),
        ):
            J = np.zeros((6, 7))
            J[:3, :3] = J[3:, 3:6] = np.eye(3)
            J[:3, 3:6], J[:3, 6], J[3:, 6] = -_skew_matrix(r), linear, angular
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


def _skew_matrix(v: Array) -> Array:
    """Return the matrix [v]x of the cross product."""
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
