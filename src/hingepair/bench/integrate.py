"""`hingepair bench integrate`: attitudes from angular velocity by all methods; error against step and run time."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any, Final, NamedTuple

import mpmath
import numpy as np
from numpy.typing import NDArray

from hingepair.bench.measure import Job, Report, Row, make_rows, print_progress, time_interleaved
from hingepair.bench.plot import MethodCurve, Panel
from hingepair.bench.truth import rotation_about_axis, rotation_of_quaternion, skew_vector
from hingepair.integration.integrate import integrate as integrate_pair
from hingepair.pair.hinge_pair import HingePair

Array = NDArray[np.float64]

ATTITUDE_ERROR_LABEL: Final = "error [rad]"  # heading of the errors, and label of an axis
STEP_SIZE_COLUMN_HEADING: Final = "h [s]"  # heading of a column
CONVERGENCE_ORDER_COLUMN_HEADING: Final = "order"  # heading of a column
LONG_RUN_METHOD_NAME: Final = "magnus6, omega computed before"  # name of the method of the long run
MOTION_DURATION_SECONDS: Final = 10.0  # of every motion, which begins at t = 0
# Equal intervals of the motion; errors are computed at their ends, which the steps of every method include.
NUM_INTERVALS_BETWEEN_ERROR_INSTANTS: Final = 25
TARGET_ATTITUDE_ERROR_RAD: Final = 1e-11
"""Error at which the methods' run times are compared [rad]."""

_EXACT_ATTITUDE_DECIMAL_DIGITS: Final = 50  # decimal digits of exact attitudes
# The pair that is integrated; its hinge does not turn.
_INTEGRATED_PAIR = HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 0, 0))
# Methods of hingepair.
_HINGEPAIR_INTEGRATION_METHOD_NAMES = ("magnus6", "midpoint")
_STEP_COUNTS_OF_HINGEPAIR_METHODS = tuple(
    NUM_INTERVALS_BETWEEN_ERROR_INSTANTS * k for k in (2, 5, 10, 20, 40, 100, 200, 400)
)  # of hingepair's methods
_SCIPY_SOLVER_NAMES = ("DOP853", "RK45", "LSODA")  # names for solve_ivp
_SCIPY_TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-12, 1e-13)  # rtol and atol of SciPy's solvers


class RotationCase(NamedTuple):
    """A rotating body with the known attitude S = Q S_ref, where Q is a constant rotation and S_ref is the product of
    rotations about x, y and z by 3t, t and 5t. `quat` is a quaternion (w, x, y, z) of Q with integer components. The
    methods compute angular velocities, exact attitudes and errors of attitudes.
    """

    name: str
    quat: tuple[int, int, int, int]  # quaternion (w, x, y, z) of Q; its components are integers, so Q is exact

    def scaled_matrix(self) -> tuple[list[list[int]], int]:
        """Return Q as a matrix of integers and their common denominator."""
        size = sum(c * c for c in self.quat)
        return [[round(c) for c in row] for row in (rotation_of_quaternion(self.quat) * size).tolist()], size

    def initial_attitude(self) -> Array:
        """Return the attitude at t = 0; shape (3, 3)."""
        rows, size = self.scaled_matrix()
        return np.array(rows) / size

    def omega(self, t: Array) -> Array:
        """Return the angular velocity [rad/s] in world axes at an array of times t [s], shape (N, 3)."""
        x = 3 + 5 * np.sin(t)
        y = np.cos(3 * t) - 2.5 * (np.sin(2 * t) + np.sin(4 * t))
        z = np.sin(3 * t) + 2.5 * (np.cos(4 * t) + np.cos(2 * t))
        rows, size = self.scaled_matrix()
        return np.stack([(a * x + b * y + c * z) / size for a, b, c in rows], axis=-1)

    def exact_attitudes(self, t: Array) -> list[Any]:
        """Return a list of the attitudes at an array of times t [s], as mpmath rotation matrices with 50 digits."""
        x, y, z = np.eye(3).tolist()
        with mpmath.workdps(_EXACT_ATTITUDE_DECIMAL_DIGITS):
            Q, times = rotation_of_quaternion(self.quat), [mpmath.mpf(s) for s in t.tolist()]
            return [
                Q * rotation_about_axis(x, 3 * s) * rotation_about_axis(y, s) * rotation_about_axis(z, 5 * s)
                for s in times
            ]

    def largest_error(self, quats: Array, exact: list[Any]) -> float:
        """Return the largest angle [rad] between the attitudes of `quats` (w, x, y, z) and `exact`, a list of mpmath
        rotation matrices. It is inf if a component is not finite.
        """
        if not np.isfinite(quats).all():
            return math.inf
        with mpmath.workdps(_EXACT_ATTITUDE_DECIMAL_DIGITS):
            worst = mpmath.mpf(0)
            for quat, truth in zip(quats.tolist(), exact, strict=True):
                difference = rotation_of_quaternion([mpmath.mpf(c) for c in quat]).T * truth
                cosine = (difference[0, 0] + difference[1, 1] + difference[2, 2] - 1) / 2
                worst = max(worst, mpmath.atan2(mpmath.norm(skew_vector(difference)), cosine))
            return float(worst)


# The reference example itself, and rotated, so that its Euler angles are not linear in time.
ROTATION_CASES: Final = (RotationCase("reference", (1, 0, 0, 0)), RotationCase("turned", (6, 1, -1, 1)))


def make_integration_runs(motion: RotationCase) -> dict[str, tuple[Job, float | None]]:
    """Return a dict from a label, such as "magnus6, 50 steps", to a tuple (job, step [s]), one for each method and
    number of steps or tolerance; the step is None if it varies. A job integrates `motion` and returns an array of
    quaternions (w, x, y, z) at the instants at which errors are computed.

    Methods of hingepair with each number of steps come first. SciPy's solvers with each tolerance follow; their steps
    vary, for which None stands.
    """
    jobs: dict[str, tuple[Job, float | None]] = {}
    for method, steps in itertools.product(_HINGEPAIR_INTEGRATION_METHOD_NAMES, _STEP_COUNTS_OF_HINGEPAIR_METHODS):
        jobs[f"{method}, {steps} steps"] = (
            functools.partial(_integrate_by_hingepair, method, motion, steps),
            MOTION_DURATION_SECONDS / steps,
        )
    for solver, tol in itertools.product(_SCIPY_SOLVER_NAMES if find_spec("scipy") else (), _SCIPY_TOLERANCES):
        jobs[f"SciPy {solver}, {tol:g}"] = functools.partial(_integrate_by_scipy, solver, motion, tol), None
    return jobs


def measure_integration(repeats: int, long_run_steps: int) -> Report:
    """Measure run times and errors of all integration methods on all motions, `repeats` times; return the Report.
    Unless `long_run_steps` is 0, also measure a run of so many steps, `repeats` times but at most three times.
    """
    rows = [row for motion in ROTATION_CASES for row in _measure_all_methods(motion, repeats)]
    further_rows = make_target_rows(rows) + (
        measure_long_run(long_run_steps, min(repeats, 3)) if long_run_steps else []
    )
    return Report([*rows, *further_rows], ATTITUDE_ERROR_LABEL, [], make_convergence_panels(rows))


def _measure_all_methods(motion: RotationCase, repeats: int) -> list[Row]:
    """Measure run times and errors of all integration methods on one motion, with all numbers of steps and
    tolerances, `repeats` times; return a list of table rows.
    """
    exact = motion.exact_attitudes(np.linspace(0, MOTION_DURATION_SECONDS, NUM_INTERVALS_BETWEEN_ERROR_INSTANTS + 1))
    jobs: dict[str, Job] = {}
    errors: dict[str, float] = {}
    extra_columns: dict[str, dict[str, float | None]] = {}
    previous_runs: dict[str, tuple[float, float]] = {}
    for label, (job, step) in make_integration_runs(motion).items():
        errors[label] = error = motion.largest_error(job(), exact)
        method = _method_of_label(label)
        jobs[label], extra_columns[label] = (
            job,
            {STEP_SIZE_COLUMN_HEADING: step, CONVERGENCE_ORDER_COLUMN_HEADING: None},
        )
        if step is not None:
            extra_columns[label][CONVERGENCE_ORDER_COLUMN_HEADING] = _observed_order(
                previous_runs.get(method), (step, error)
            )
            previous_runs[method] = step, error
    print_progress(f"{motion.name}: {len(jobs)} runs, {repeats} repeats")
    return make_rows(motion.name, time_interleaved(jobs, repeats), 1, errors, extra_columns)


def _observed_order(previous_run: tuple[float, float] | None, current_run: tuple[float, float]) -> float | None:
    """Return the order of convergence between two runs, tuples (step, error). It is None if there is no previous run
    or if an error is at most 1e-14, which is the size of rounding errors.
    """
    if previous_run is None or min(previous_run[1], current_run[1]) <= 1e-14:
        return None
    return math.log(previous_run[1] / current_run[1]) / math.log(previous_run[0] / current_run[0])


def measure_long_run(steps: int, repeats: int) -> list[Row]:
    """Measure run time and error of the integration of each motion by `magnus6` with `steps` steps, `repeats` times;
    return a list of table rows. The evaluation of omega is not timed.
    """
    rows = []
    for motion in ROTATION_CASES:
        print_progress(f"{motion.name}: {steps:,} steps")
        t = np.linspace(0, MOTION_DURATION_SECONDS, steps + 1)
        job = _long_run_job(motion, t)
        compared = np.unique(np.linspace(1, steps, 100).astype(int))
        error = motion.largest_error(job().quat_wxyz[compared], motion.exact_attitudes(t[compared]))
        rows += make_rows(
            _long_case_name(motion),
            time_interleaved({LONG_RUN_METHOD_NAME: job}, repeats),
            steps,
            {LONG_RUN_METHOD_NAME: error},
        )
    return rows


def _long_case_name(motion: RotationCase) -> str:
    """Return the name of the case of the long run."""
    return f"{motion.name}, long"


def _long_run_job(motion: RotationCase, t: Array) -> Job:
    """Return a job that integrates the motion from `t[0]` to `t[-1]` with a step between successive instants, and
    returns the trajectory with the attribute `quat_wxyz`. The first call of the job caches the values of omega, which
    later calls read.
    """
    computed: dict[Any, Array] = {}

    def omega(nodes: Array) -> Array:
        """Return the angular velocity [rad/s] at the instants `nodes`; it is computed once and stored for later calls
        with the same nodes.
        """
        key = len(nodes), nodes[0], nodes[-1]
        if key not in computed:
            computed[key] = motion.omega(nodes)
        return computed[key]

    return lambda: integrate_pair(_INTEGRATED_PAIR, t, omega, 0.0, S1_0=motion.initial_attitude(), outputs=())


def _integrate_by_hingepair(method: str, motion: RotationCase, steps: int) -> Array:
    """Integrate a motion from its beginning to its end in `steps` equal steps by the method of hingepair named
    `method`. Return an array of quaternions (w, x, y, z) at the instants at which errors are computed, shape
    (instants, 4).
    """
    t = np.linspace(0, MOTION_DURATION_SECONDS, steps + 1)
    trajectory = integrate_pair(
        _INTEGRATED_PAIR, t, motion.omega, 0.0, S1_0=motion.initial_attitude(), method=method, outputs=()
    )
    return trajectory.quat_wxyz[:: steps // NUM_INTERVALS_BETWEEN_ERROR_INSTANTS]


def _integrate_by_scipy(solver: str, motion: RotationCase, tol: float) -> Array:
    """Integrate a motion from its beginning to its end by the solver of SciPy named `solver`, with `tol` as relative
    and absolute tolerance. Return an array of quaternions (w, x, y, z), not normalised, at the instants at which
    errors are computed, shape (instants, 4).

    The four equations of the quaternion are written out in Python floats, which is the fastest way for SciPy.
    """
    from scipy.integrate import solve_ivp

    rows, size = motion.scaled_matrix()
    (a, b, c), (d, e, f), (g, h, i) = rows
    sin, cos = math.sin, math.cos

    def rate(t: float, quat: Any) -> tuple[float, ...]:
        """Return the time derivative of a quaternion (w, x, y, z) at time t under the known angular velocity, as a
        tuple of four floats.
        """
        u = (1.5 + 2.5 * sin(t)) / size
        v = (0.5 * cos(3 * t) - 1.25 * (sin(2 * t) + sin(4 * t))) / size
        w = (0.5 * sin(3 * t) + 1.25 * (cos(4 * t) + cos(2 * t))) / size
        x, y, z = a * u + b * v + c * w, d * u + e * v + f * w, g * u + h * v + i * w
        k, l, m, n = quat.tolist()  # noqa: E741
        return -(x * l + y * m + z * n), x * k + y * n - z * m, y * k + z * l - x * n, z * k + x * m - y * l

    initial_quat = np.array(motion.quat) / math.sqrt(size)
    instants = np.linspace(0, MOTION_DURATION_SECONDS, NUM_INTERVALS_BETWEEN_ERROR_INSTANTS + 1)
    solution = solve_ivp(
        rate,
        (0, MOTION_DURATION_SECONDS),
        initial_quat,
        method=solver,
        t_eval=instants,
        rtol=max(tol, 3e-14),
        atol=tol,
    )
    return np.asarray(solution.y.T)


def _method_of_label(label: str) -> str:
    """Return the method of a label, without its number of steps or tolerance."""
    return label.rpartition(", ")[0]


def times_to_target_error(rows: Sequence[Row], case: str) -> dict[str, float]:
    """Return a dict from a method's name to its minimum run time [s] at the error TARGET_ATTITUDE_ERROR_RAD,
    interpolated between the table rows of the case named `case`. Methods that do not reach that error are left out.
    """
    times = {}
    for method in dict.fromkeys(_method_of_label(row.method) for row in rows):
        points = [
            (row.error, row.min_seconds)
            for row in rows
            if row.case == case and _method_of_label(row.method) == method and row.error
        ]
        for (e1, t1), (e2, t2) in itertools.pairwise(points):
            if e1 > TARGET_ATTITUDE_ERROR_RAD >= e2 and math.isfinite(e1):
                times[method] = t1 * (t2 / t1) ** (math.log(e1 / TARGET_ATTITUDE_ERROR_RAD) / math.log(e1 / e2))
    return times


def make_target_rows(rows: Sequence[Row]) -> list[Row]:
    """Return a list of new table rows with the run time of each method at the error TARGET_ATTITUDE_ERROR_RAD,
    interpolated between the measured rows of a motion. There is a row for each motion and each method that reaches
    the error.
    """
    target_rows = []
    for motion in ROTATION_CASES:
        times = times_to_target_error(rows, motion.name)
        first = next(iter(times.values()), math.nan)
        case = f"{motion.name}, an error of {TARGET_ATTITUDE_ERROR_RAD:g} rad"
        target_rows += [Row(case, name, 1, t, t, t / first, TARGET_ATTITUDE_ERROR_RAD) for name, t in times.items()]
    return target_rows


def make_convergence_panels(rows: Sequence[Row]) -> list[list[Panel]]:
    """Return the picture's panels as a list of rows, one for each motion. Each row is a list of two panels, one of
    error against step and one of error against run time. `rows` are the measured table rows.
    """
    return [
        [
            Panel(
                f"{motion.name}: step",
                "step h [s]",
                ATTITUDE_ERROR_LABEL,
                _error_curves(rows, motion.name, STEP_SIZE_COLUMN_HEADING),
                x_descending=True,
            ),
            Panel(f"{motion.name}: time", "run time [ms]", "", _error_curves(rows, motion.name, None)),
        ]
        for motion in ROTATION_CASES
    ]


def _error_curves(rows: Sequence[Row], case: str, column: str | None) -> list[MethodCurve]:
    """Return a list of MethodCurves, one for each method, of the errors of the case named `case`. Their abscissa is
    the value in the extra column named `column`, or the minimum run time [ms] if `column` is None.
    """
    points: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        x = row.min_seconds * 1e3 if column is None else row.extra_columns.get(column)
        if row.case == case and x is not None and row.error is not None:
            points.setdefault(_method_of_label(row.method), []).append((x, row.error))
    return [MethodCurve(name, curve_points) for name, curve_points in points.items()]
