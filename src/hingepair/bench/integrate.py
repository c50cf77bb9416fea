"""`hingepair bench integrate`: error against step and run time, attitudes from angular velocity by all methods."""

from __future__ import annotations

import importlib.util
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

import mpmath
import numpy as np
from numpy.typing import NDArray

from hingepair.bench.measure import Row, Target, measured
from hingepair.bench.plot import Curve, Panel
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

_PAIR = HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 0, 0))
_OURS = ("magnus6", "magnus4", "cf4", "midpoint", "rk4_quaternion", "euler_angles")
_SCIPY = ("DOP853", "RK45", "LSODA")


class Spin(NamedTuple):
    """The reference example's attitude S(t), turned: S = Q S_ref, omega = Q omega_ref.

    Attributes:
        name: of the motion.
        turn: Q, a quaternion (w, x, y, z) of whole numbers, so that Q is known exactly.
    """

    name: str
    turn: tuple[int, int, int, int]

    def matrix(self) -> tuple[list[list[int]], int]:
        """Q: whole numbers, and what they are divided by."""
        w, x, y, z = self.turn
        rows = [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
        return rows, w * w + x * x + y * y + z * z

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
        """The attitudes to 50 digits: products of quaternions about x, y and z."""
        found = []
        with mpmath.workdps(50):
            for time in t.tolist():
                quat: Any = [mpmath.mpf(k) for k in self.turn]
                for axis, rate in enumerate((3, 1, 5)):
                    half = rate * mpmath.mpf(time) / 2
                    turn = [mpmath.cos(half), *[mpmath.mpf(0)] * 3]
                    turn[1 + axis] = mpmath.sin(half)
                    quat = _times(quat, turn)
                found.append(quat)
        return found

    def error(self, quats: Array, exact: list[Any]) -> float:
        """The largest angle between attitudes and the exact ones [rad]; infinite where one is not finite."""
        if not np.isfinite(quats).all():
            return math.inf
        with mpmath.workdps(50):
            worst = mpmath.mpf(0)
            for (w, x, y, z), truth in zip(quats.tolist(), exact, strict=True):
                scalar, *vector = _times([mpmath.mpf(w), -mpmath.mpf(x), -mpmath.mpf(y), -mpmath.mpf(z)], truth)
                worst = max(worst, 2 * mpmath.atan2(mpmath.norm(vector), abs(scalar)))
            return float(worst)


def _times(p: Any, q: Any) -> list[Any]:
    """The product of two quaternions (w, x, y, z)."""
    a, b, c, d = p
    e, f, g, h = q
    return [
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    ]


SPINS: Final = (Spin("reference", (1, 0, 0, 0)), Spin("turned", (6, 1, -1, 1)))


class Way(NamedTuple):
    """A method with its finenesses.

    Attributes:
        name: the method.
        finenesses: numbers of steps, or tolerances of a solver that chooses its steps.
        solver: whether it chooses its steps.
        run: of a spin and a fineness, the attitudes at the compared instants, quaternions (w, x, y, z).
    """

    name: str
    finenesses: tuple[float, ...]
    solver: bool
    run: Callable[[Spin, float], Array]


def ways() -> tuple[Way, ...]:
    """All methods that can be had, ours first."""
    steps = tuple(float(COMPARED * k) for k in (2, 5, 10, 20, 40, 100, 200, 400))
    tolerances = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-12, 1e-13)
    solvers = _SCIPY if importlib.util.find_spec("scipy") else ()
    return (
        *(Way(name, steps, False, _ours(name)) for name in _OURS),
        *(Way(f"SciPy {name}", tolerances, True, _scipy(name)) for name in solvers),
    )


def integrate(repeats: int, tell: Callable[[str], None]) -> list[Row]:
    """All methods at all their finenesses on all motions."""
    rows: list[Row] = []
    for spin in SPINS:
        exact = spin.exact(np.linspace(0, STOP, COMPARED + 1))
        found = {_label(way, f): (way, f, _error(way, spin, f, exact)) for way in ways() for f in way.finenesses}
        jobs = {label: _run(way, spin, f) for label, (way, f, error) in found.items() if error is not None}
        tell(f"{spin.name}: {len(jobs)} runs, {repeats} repeats")
        errors = {label: error for label, (_, _, error) in found.items() if error is not None}
        more = {label: {STEP: None if way.solver else STOP / f} for label, (way, f, _) in found.items()}
        rows += _with_orders(measured(spin.name, jobs, repeats, 1, errors, more))
    return rows


def _with_orders(rows: list[Row]) -> list[Row]:
    """How fast the error falls against the step, between a row and the one before; where rounding is not all."""
    found = []
    for before, row in zip([None, *rows], rows, strict=False):
        h, order = row.more[STEP], None
        falls = before is not None and h and method_of(before) == method_of(row)
        if before and falls and before.error and row.error and min(before.error, row.error) > 1e-14:
            order = math.log(before.error / row.error) / math.log(before.more[STEP] / h)
        found.append(replace(row, more={STEP: h, ORDER: order}))
    return found


def long_run(steps: int, repeats: int, tell: Callable[[str], None]) -> list[Row]:
    """`magnus6` in so many steps, omega at its nodes computed beforehand: the time for a step, and the drift."""
    rows = []
    for spin in SPINS:
        tell(f"{spin.name}: {steps:,} steps")
        t = np.linspace(0, STOP, steps + 1)
        job = _long_job(spin, t)
        picked = np.unique(np.linspace(1, steps, 100).astype(int))
        error = spin.error(job().quat_wxyz[picked], spin.exact(t[picked]))
        rows += measured(f"{spin.name}, long", {LONG: job}, repeats, steps, {LONG: error})
    return rows


def _long_job(spin: Spin, t: Array) -> Callable[[], Any]:
    computed: dict[Any, Array] = {}

    def omega(nodes: Array) -> Array:
        key = len(nodes), nodes[0], nodes[-1]
        if key not in computed:
            computed[key] = spin.omega(nodes)
        return computed[key]

    return lambda: integrate_pair(_PAIR, t, omega, 0.0, S1_0=spin.start(), outputs=())


def targets(rows: Sequence[Row]) -> list[Target]:
    """What a step of a long run should take."""
    return [Target(row.case, row.each * 1e9, 120.0, "ns a step") for row in rows if row.method == LONG]


def _ours(method: str) -> Callable[[Spin, float], Array]:
    def run(spin: Spin, steps: float) -> Array:
        t = np.linspace(0, STOP, int(steps) + 1)
        motion = integrate_pair(_PAIR, t, spin.omega, 0.0, S1_0=spin.start(), method=method, outputs=())
        return motion.quat_wxyz[:: int(steps) // COMPARED]

    return run


def _scipy(solver: str) -> Callable[[Spin, float], Array]:
    """SciPy on the quaternion's four equations, written out for a single time, which Python computes fastest."""

    def run(spin: Spin, tol: float) -> Array:
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

    return run


def _run(way: Way, spin: Spin, fineness: float) -> Callable[[], Any]:
    return lambda: way.run(spin, fineness)


def _error(way: Way, spin: Spin, fineness: float, exact: list[Any]) -> float | None:
    """The error; None where the method stops at gimbal lock."""
    try:
        return spin.error(way.run(spin, fineness), exact)
    except GimbalLockError:
        return None


def _label(way: Way, fineness: float) -> str:
    return f"{way.name}, {fineness:g}" + ("" if way.solver else " steps")


def method_of(row: Row) -> str:
    """The method of a row, without its fineness."""
    return row.method.rpartition(", ")[0]


def time_to_goal(rows: Sequence[Row], case: str) -> dict[str, float]:
    """By method, the run time [s] at which its error is GOAL, between its finenesses; without those that miss it."""
    found = {}
    for method in dict.fromkeys(method_of(row) for row in rows):
        own = [(row.error, row.least) for row in rows if row.case == case and method_of(row) == method and row.error]
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
            points.setdefault(method_of(row), []).append((x, row.error))
    return [Curve(name, own) for name, own in points.items()]
