"""`hingepair bench integrate`: error against step and run time, attitudes from angular velocity by all methods."""

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

from hingepair.bench.measure import Job, Report, Row, interleaved, rows_of, tell
from hingepair.bench.plot import Curve, Panel
from hingepair.bench.truth import rotation, turn, vee
from hingepair.errors import GimbalLockError
from hingepair.integration.integrate import integrate as integrate_pair
from hingepair.pair.hinge_pair import HingePair

Array = NDArray[np.float64]

ERROR: Final = "error [rad]"
STEP: Final = "h [s]"
ORDER: Final = "order"
LONG: Final = "magnus6, omega at hand"
STOP: Final = 10.0
COMPARED: Final = 25  # instants, evenly spread; every method has them among its own
GOAL: Final = 1e-11
"""Error at which the methods' run times are compared [rad]."""

_DIGITS: Final = 50
_PAIR = HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 0, 0))
_OURS = ("magnus6", "magnus4", "cf4", "midpoint", "rk4_quaternion", "euler_angles")
_STEPS = tuple(COMPARED * k for k in (2, 5, 10, 20, 40, 100, 200, 400))
_SCIPY = ("DOP853", "RK45", "LSODA")
_TOLERANCES = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-12, 1e-13)


class Spin(NamedTuple):
    """The reference example's attitude S(t), turned: S = Q S_ref, omega = Q omega_ref."""

    name: str  # of the motion
    turn: tuple[int, int, int, int]  # Q, a quaternion (w, x, y, z) of whole numbers, so that Q is known exactly

    def matrix(self) -> tuple[list[list[int]], int]:
        """Q: whole numbers, and what they are divided by."""
        size = sum(c * c for c in self.turn)
        return [[round(c) for c in row] for row in (rotation(self.turn) * size).tolist()], size

    def start(self) -> Array:
        """The attitude at t = 0."""
        rows, size = self.matrix()
        return np.array(rows) / size

    def omega(self, t: Array) -> Array:
        """The angular velocity, world axes; shape (n, 3)."""
        x = 3 + 5 * np.sin(t)
        y = np.cos(3 * t) - 2.5 * (np.sin(2 * t) + np.sin(4 * t))
        z = np.sin(3 * t) + 2.5 * (np.cos(4 * t) + np.cos(2 * t))
        rows, size = self.matrix()
        return np.stack([(a * x + b * y + c * z) / size for a, b, c in rows], axis=-1)

    def exact(self, t: Array) -> list[Any]:
        """The attitudes to 50 digits: Q, and turns about x, y and z by 3t, t and 5t."""
        x, y, z = np.eye(3).tolist()
        with mpmath.workdps(_DIGITS):
            Q, times = rotation(self.turn), [mpmath.mpf(s) for s in t.tolist()]
            return [Q * turn(x, 3 * s) * turn(y, s) * turn(z, 5 * s) for s in times]

    def error(self, quats: Array, exact: list[Any]) -> float:
        """The largest angle between attitudes (w, x, y, z) and the exact ones [rad]; infinite where one is none."""
        if not np.isfinite(quats).all():
            return math.inf
        with mpmath.workdps(_DIGITS):
            worst = mpmath.mpf(0)
            for quat, truth in zip(quats.tolist(), exact, strict=True):
                off = rotation([mpmath.mpf(c) for c in quat]).T * truth
                cosine = (off[0, 0] + off[1, 1] + off[2, 2] - 1) / 2
                worst = max(worst, mpmath.atan2(mpmath.norm(vee(off)), cosine))
            return float(worst)


SPINS: Final = (Spin("reference", (1, 0, 0, 0)), Spin("turned", (6, 1, -1, 1)))


def runs(spin: Spin) -> dict[str, tuple[Job, float | None]]:
    """All methods at all finenesses, ours first: what finds attitudes (w, x, y, z), and its step, if it is given."""
    found: dict[str, tuple[Job, float | None]] = {}
    for method, steps in itertools.product(_OURS, _STEPS):
        found[f"{method}, {steps} steps"] = functools.partial(_ours, method, spin, steps), STOP / steps
    for solver, tol in itertools.product(_SCIPY if find_spec("scipy") else (), _TOLERANCES):
        found[f"SciPy {solver}, {tol:g}"] = functools.partial(_scipy, solver, spin, tol), None
    return found


def integrate(repeats: int, steps: int) -> Report:
    """All methods at all their finenesses on all motions; with `steps`, a long run too."""
    rows = [row for spin in SPINS for row in _all_ways(spin, repeats)]
    more = goals(rows) + (long_run(steps, min(repeats, 3)) if steps else [])
    notes = ["left out: finenesses at which a method stops at gimbal lock"]
    return Report([*rows, *more], ERROR, notes, panels(rows))


def _all_ways(spin: Spin, repeats: int) -> list[Row]:
    exact = spin.exact(np.linspace(0, STOP, COMPARED + 1))
    jobs: dict[str, Job] = {}
    errors: dict[str, float] = {}
    more: dict[str, dict[str, float | None]] = {}
    before: dict[str, tuple[float, float]] = {}
    for label, (job, step) in runs(spin).items():
        try:
            errors[label] = error = spin.error(job(), exact)
        except GimbalLockError:
            continue
        method = _method(label)
        jobs[label], more[label] = job, {STEP: step, ORDER: None}
        if step is not None:
            more[label][ORDER] = _order(before.get(method), (step, error))
            before[method] = step, error
    tell(f"{spin.name}: {len(jobs)} runs, {repeats} repeats")
    return rows_of(spin.name, interleaved(jobs, repeats), 1, errors, more)


def _order(before: tuple[float, float] | None, own: tuple[float, float]) -> float | None:
    """How fast the error falls between two steps; each is (h, error). Where rounding is all: none."""
    if before is None or min(before[1], own[1]) <= 1e-14:
        return None
    return math.log(before[1] / own[1]) / math.log(before[0] / own[0])


def long_run(steps: int, repeats: int) -> list[Row]:
    """`magnus6` in so many steps, omega at its nodes computed beforehand: the time for a step, and the drift."""
    rows = []
    for spin in SPINS:
        tell(f"{spin.name}: {steps:,} steps")
        t = np.linspace(0, STOP, steps + 1)
        job = _long_job(spin, t)
        picked = np.unique(np.linspace(1, steps, 100).astype(int))
        error = spin.error(job().quat_wxyz[picked], spin.exact(t[picked]))
        rows += rows_of(_long(spin), interleaved({LONG: job}, repeats), steps, {LONG: error})
    return rows


def _long(spin: Spin) -> str:
    return f"{spin.name}, long"


def _long_job(spin: Spin, t: Array) -> Job:
    computed: dict[Any, Array] = {}

    def omega(nodes: Array) -> Array:
        key = len(nodes), nodes[0], nodes[-1]
        if key not in computed:
            computed[key] = spin.omega(nodes)
        return computed[key]

    return lambda: integrate_pair(_PAIR, t, omega, 0.0, S1_0=spin.start(), outputs=())


def _ours(method: str, spin: Spin, steps: int) -> Array:
    t = np.linspace(0, STOP, steps + 1)
    motion = integrate_pair(_PAIR, t, spin.omega, 0.0, S1_0=spin.start(), method=method, outputs=())
    return motion.quat_wxyz[:: steps // COMPARED]


def _scipy(solver: str, spin: Spin, tol: float) -> Array:
    """SciPy on the quaternion's four equations, written out for a single time, which Python computes fastest."""
    from scipy.integrate import solve_ivp

    rows, size = spin.matrix()
    (a, b, c), (d, e, f), (g, h, i) = rows
    sin, cos = math.sin, math.cos

    def rate(t: float, quat: Any) -> tuple[float, ...]:
        u = (1.5 + 2.5 * sin(t)) / size
        v = (0.5 * cos(3 * t) - 1.25 * (sin(2 * t) + sin(4 * t))) / size
        w = (0.5 * sin(3 * t) + 1.25 * (cos(4 * t) + cos(2 * t))) / size
        x, y, z = a * u + b * v + c * w, d * u + e * v + f * w, g * u + h * v + i * w
        k, l, m, n = quat.tolist()  # noqa: E741
        return -(x * l + y * m + z * n), x * k + y * n - z * m, y * k + z * l - x * n, z * k + x * m - y * l

    begin = np.array(spin.turn) / math.sqrt(size)
    instants = np.linspace(0, STOP, COMPARED + 1)
    done = solve_ivp(rate, (0, STOP), begin, method=solver, t_eval=instants, rtol=max(tol, 3e-14), atol=tol)
    return np.asarray(done.y.T)


def _method(label: str) -> str:
    """The method, without its fineness."""
    return label.rpartition(", ")[0]


def time_to_goal(rows: Sequence[Row], case: str) -> dict[str, float]:
    """By method, the run time [s] at which its error is GOAL, between its finenesses; without those that miss it."""
    found = {}
    for method in dict.fromkeys(_method(row.method) for row in rows):
        own = [
            (row.error, row.least) for row in rows if row.case == case and _method(row.method) == method and row.error
        ]
        for (e1, t1), (e2, t2) in itertools.pairwise(own):
            if e1 > GOAL >= e2 and math.isfinite(e1):
                found[method] = t1 * (t2 / t1) ** (math.log(e1 / GOAL) / math.log(e1 / e2))
    return found


def goals(rows: Sequence[Row]) -> list[Row]:
    """The run times at the same error as rows."""
    found = []
    for spin in SPINS:
        times = time_to_goal(rows, spin.name)
        first = next(iter(times.values()), math.nan)
        case = f"{spin.name}, an error of {GOAL:g} rad"
        found += [Row(case, name, 1, t, t, t / first, GOAL) for name, t in times.items()]
    return found


def panels(rows: Sequence[Row]) -> list[list[Panel]]:
    """The picture: error against step and against run time, a row for each motion."""
    return [
        [
            Panel(f"{spin.name}: step", "step h [s]", ERROR, _curves(rows, spin.name, STEP), falling=True),
            Panel(f"{spin.name}: time", "run time [ms]", "", _curves(rows, spin.name, None)),
        ]
        for spin in SPINS
    ]


def _curves(rows: Sequence[Row], case: str, column: str | None) -> list[Curve]:
    points: dict[str, list[tuple[float, float]]] = {}
    for row in rows:
        x = row.least * 1e3 if column is None else row.more.get(column)
        if row.case == case and x is not None and row.error is not None:
            points.setdefault(_method(row.method), []).append((x, row.error))
    return [Curve(name, own) for name, own in points.items()]
