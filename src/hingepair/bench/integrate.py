"""`hingepair bench integrate`: attitudes from angular velocity by all methods; error against step and run time."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import Any, NamedTuple

import mpmath
import numpy as np
from numpy.typing import NDArray

from hingepair.bench.harness import Case, Job, Report, Row, measure
from hingepair.bench.plot import MethodCurve, Panel
from hingepair.bench.truth import DIGITS, Array, attitude_of_quaternion, exactly, rotation
from hingepair.integration.integrate import integrate
from hingepair.pair.hinge_pair import HingePair

DURATION = 10.0  # s, of every motion
INTERVALS = 25  # of the motion, at whose ends errors are computed; steps of every method divide them
TARGET = 1e-11  # rad, at which the methods' run times are compared
METHODS = ("magnus6", "midpoint")  # of hingepair
STEPS = tuple(INTERVALS * k for k in (2, 5, 10, 20, 40, 100, 200, 400))  # of a motion, by these methods
SOLVERS = ("DOP853", "RK45", "LSODA")  # of SciPy
TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-12, 1e-13)  # rtol and atol of SciPy's solvers
_PAIR = HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 0, 0))  # its hinge does not turn


class Motion(NamedTuple):
    """The attitude S = Q S_ref: S_ref is the product of turns about x, y and z by 3t, t and 5t."""

    name: str
    quat: tuple[int, int, int, int]  # of Q, (w, x, y, z), not normalised: Q is then exact

    def scaled_matrix(self) -> tuple[list[list[int]], int]:
        """Return Q as rows of integers and their common denominator."""
        w, x, y, z = self.quat
        size = w * w + x * x + y * y + z * z
        S = attitude_of_quaternion(np.array([[x, y, z, w]]))[0]
        return [[round(c * size) for c in row] for row in S.tolist()], size

    def initial_attitude(self) -> NDArray[np.float64]:
        """Return the attitude at t = 0."""
        rows, size = self.scaled_matrix()
        return np.array(rows) / size

    def omega(self, t: Any) -> NDArray[np.float64]:
        """Return the angular velocity in world axes, (N, 3)."""
        x = 3 + 5 * np.sin(t)
        y = np.cos(3 * t) - 2.5 * (np.sin(2 * t) + np.sin(4 * t))
        z = np.sin(3 * t) + 2.5 * (np.cos(4 * t) + np.cos(2 * t))
        rows, size = self.scaled_matrix()
        return np.stack([(a * x + b * y + c * z) / size for a, b, c in rows], axis=-1)

    def exact_attitudes(self, t: Any) -> Array:
        """Return the attitudes, (N, 3, 3), of mpf."""
        w, x, y, z = self.quat
        with mpmath.workdps(DIGITS):
            s = exactly(t)
            axes = zip(exactly(np.eye(3)), (3, 1, 5), strict=True)
            turns = [rotation(axis, (rate * s, 0 * s, 0 * s)).c0 for axis, rate in axes]
            Q: Array = attitude_of_quaternion(np.array([[x, y, z, w]]))[0]
            return Q @ turns[0] @ turns[1] @ turns[2]

    def largest_error(self, quats: NDArray[np.float64], exact: Array) -> float:
        """Return the largest angle [rad] between attitudes (w, x, y, z) and exact ones; inf if one is not finite."""
        if not np.isfinite(quats).all():
            return math.inf
        with mpmath.workdps(DIGITS):
            D = np.swapaxes(attitude_of_quaternion(np.roll(quats, -1, axis=-1)), -1, -2) @ exact
            vectors = zip(D[:, 2, 1] - D[:, 1, 2], D[:, 0, 2] - D[:, 2, 0], D[:, 1, 0] - D[:, 0, 1], strict=True)
            cosines = np.trace(D, axis1=1, axis2=2) - 1
            return float(max(mpmath.atan2(mpmath.norm(v), c) for v, c in zip(vectors, cosines, strict=True)))


MOTIONS = (Motion("reference", (1, 0, 0, 0)), Motion("turned", (6, 1, -1, 1)))
"""The reference example's Euler angles are linear in time, those of the other are not."""


def bench_integrate(repeats: int, long_run: int) -> Report:
    """Measure all methods on all motions.

    Args:
        repeats: of each measurement.
        long_run: steps of a further run, repeated three times at most; 0 for none.
    """
    rows = measure(map(method_case, MOTIONS), repeats)
    panels = convergence_panels(rows)
    rows += target_rows(rows)
    rows += measure(long_cases(long_run), min(repeats, 3))
    return Report(rows, "error [rad]", panels=panels)


def method_case(motion: Motion) -> Case:
    """Return the case of all methods with all steps and tolerances."""
    exact = motion.exact_attitudes(np.linspace(0, DURATION, INTERVALS + 1))
    jobs: dict[str, Job] = {}
    errors: dict[str, float] = {}
    columns: dict[str, dict[str, float | None]] = {}
    for method in METHODS:
        previous = math.nan, math.nan
        for steps in STEPS:
            name = f"{method}, {steps} steps"
            jobs[name] = functools.partial(_by_hingepair, method, motion, steps)
            errors[name] = motion.largest_error(jobs[name](), exact)
            run = DURATION / steps, errors[name]
            columns[name] = {"h [s]": run[0], "order": _order(previous, run)}
            previous = run
    for solver, tol in itertools.product(SOLVERS if find_spec("scipy") else (), TOLERANCES):
        name = f"SciPy {solver}, {tol:g}"
        jobs[name] = functools.partial(_by_scipy, solver, motion, tol)
        errors[name] = motion.largest_error(jobs[name](), exact)
    return Case(motion.name, jobs, 1, errors, columns)


def _order(previous: tuple[float, float], run: tuple[float, float]) -> float | None:
    """Return the order of convergence between two runs (step, error); None where rounding errors are as large."""
    if not min(previous[1], run[1]) > 1e-14:
        return None
    return math.log(previous[1] / run[1]) / math.log(previous[0] / run[0])


def long_cases(steps: int) -> Iterator[Case]:
    """Yield a case for each motion of so many steps by `magnus6`, with omega computed before; none for 0 steps."""
    name = "magnus6, omega computed before"
    for motion in MOTIONS if steps else ():
        t = np.linspace(0, DURATION, steps + 1)
        omega = functools.partial(_stored, motion, {})
        job = functools.partial(integrate, _PAIR, t, omega, 0.0, S1_0=motion.initial_attitude(), outputs=())
        compared = np.unique(np.linspace(1, steps, 100).astype(int))
        error = motion.largest_error(job().quat_wxyz[compared], motion.exact_attitudes(t[compared]))
        yield Case(f"{motion.name}, long", {name: job}, steps, {name: error})


def _stored(motion: Motion, known: dict[Any, Any], nodes: Any) -> Any:
    """Return omega of a motion at nodes from `known`, which keeps what was computed."""
    key = len(nodes), nodes[0], nodes[-1]
    if key not in known:
        known[key] = motion.omega(nodes)
    return known[key]


def _by_hingepair(method: str, motion: Motion, steps: int) -> NDArray[np.float64]:
    """Return quaternions (w, x, y, z) at the ends of the intervals."""
    t = np.linspace(0, DURATION, steps + 1)
    found = integrate(_PAIR, t, motion.omega, 0.0, S1_0=motion.initial_attitude(), method=method, outputs=())
    return found.quat_wxyz[:: steps // INTERVALS]


def _by_scipy(solver: str, motion: Motion, tol: float) -> NDArray[np.float64]:
    """Return quaternions (w, x, y, z), not normalised, at the ends of the intervals.

    The equations are written out in Python floats, which is the fastest way for SciPy.
    """
    from scipy.integrate import solve_ivp

    rows, size = motion.scaled_matrix()
    (a, b, c), (d, e, f), (g, h, i) = rows
    sin, cos = math.sin, math.cos

    def rate(t: float, quat: Any) -> tuple[float, ...]:
        """Return the derivative of the quaternion, half of omega times it."""
        u = (1.5 + 2.5 * sin(t)) / size  # half of omega in the axes of S_ref
        v = (0.5 * cos(3 * t) - 1.25 * (sin(2 * t) + sin(4 * t))) / size
        w = (0.5 * sin(3 * t) + 1.25 * (cos(4 * t) + cos(2 * t))) / size
        x, y, z = a * u + b * v + c * w, d * u + e * v + f * w, g * u + h * v + i * w
        k, l, m, n = quat.tolist()  # noqa: E741
        return -(x * l + y * m + z * n), x * k + y * n - z * m, y * k + z * l - x * n, z * k + x * m - y * l

    times = np.linspace(0, DURATION, INTERVALS + 1)
    start = np.array(motion.quat) / math.sqrt(size)
    found = solve_ivp(rate, (0, DURATION), start, solver, times, rtol=max(tol, 3e-14), atol=tol)
    return np.asarray(found.y.T)


def _method_of(name: str) -> str:
    return name.rpartition(", ")[0]


def times_to_target(rows: Sequence[Row], case: str) -> dict[str, float]:
    """Return the times [s] of methods that reach the target error, interpolated between their rows, by method."""
    times = {}
    for method in dict.fromkeys(_method_of(row.method) for row in rows):
        own = [row for row in rows if row.case == case and _method_of(row.method) == method and row.error]
        points = [(row.error or math.nan, row.min_seconds) for row in own]
        for (e1, t1), (e2, t2) in itertools.pairwise(points):
            if e1 > TARGET >= e2 and math.isfinite(e1):
                times[method] = t1 * (t2 / t1) ** (math.log(e1 / TARGET) / math.log(e1 / e2))
    return times


def target_rows(rows: Sequence[Row]) -> list[Row]:
    """Return rows with each motion's and method's time at the target error."""
    found = []
    for motion in MOTIONS:
        times = times_to_target(rows, motion.name)
        first = next(iter(times.values()), math.nan)
        case = f"{motion.name}, an error of {TARGET:g} rad"
        found += [Row(case, name, 1, t, t, t / first, TARGET) for name, t in times.items()]
    return found


def convergence_panels(rows: Sequence[Row]) -> list[list[Panel]]:
    """Return for each motion a panel of error against step and one of error against run time."""
    found = []
    for motion in MOTIONS:
        steps: dict[str, list[tuple[float, float]]] = {}
        times: dict[str, list[tuple[float, float]]] = {}
        for row in rows:
            if row.case == motion.name and row.error is not None:
                times.setdefault(_method_of(row.method), []).append((row.min_seconds * 1e3, row.error))
                if step := row.extra_columns.get("h [s]"):
                    steps.setdefault(_method_of(row.method), []).append((step, row.error))
        curves = [[MethodCurve(*item) for item in points.items()] for points in (steps, times)]
        found.append(
            [
                Panel(f"{motion.name}: step", "step h [s]", "error [rad]", curves[0], x_descending=True),
                Panel(f"{motion.name}: time", "run time [ms]", "", curves[1]),
            ]
        )
    return found
