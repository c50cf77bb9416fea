"""`hingepair bench integrate`: error against step and run time of all methods, in one run."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from hingepair.bench.direct import facts
from hingepair.bench.spins import SPINS, STOP, Spin, Way, compared, installed, ways
from hingepair.errors import GimbalLockError

if TYPE_CHECKING:
    from rich.table import Table

GOAL: Final = 1e-11
"""Error at which the methods' run times are compared [rad]."""


@dataclass(frozen=True, slots=True)
class Row:
    """One method at one fineness.

    Attributes:
        spin: the motion, reference or turned.
        method: its name.
        fineness: steps, or the tolerance of a solver that chooses its steps.
        h: the step [s]; None for such a solver.
        error: largest error of the attitude [rad]; None where the method stopped at gimbal lock.
        order: how fast the error falls against h, seen between this fineness and the one before.
        median_ms: of the repeats, milliseconds.
        min_ms: the smallest of them.
    """

    spin: str
    method: str
    fineness: float
    h: float | None
    error: float | None
    order: float | None
    median_ms: float | None
    min_ms: float | None


@dataclass(frozen=True, slots=True)
class LongRun:
    """A run of many steps: how far rounding takes it.

    Attributes:
        spin: the motion.
        steps: how many.
        error: largest error of the attitude [rad].
        orthonormality: largest element of S^T S - I, in u.
        ns_per_step: run time, omega made on the way.
    """

    spin: str
    steps: int
    error: float
    orthonormality: float
    ns_per_step: float


def measure(repeats: int, tell: Callable[[str], None]) -> list[Row]:
    """All methods at all their finenesses on all motions; each repeat goes through all, so that noise meets all."""
    rows: list[Row] = []
    present = [way for way in ways() if installed(way)]
    for spin in SPINS:
        exact = spin.exact(compared())
        tell(f"{spin.name}: {len(present)} methods, {repeats} repeats")
        found = {(way, f): _first(way, spin, f, exact) for way in present for f in way.finenesses}
        times: dict[tuple[Way, float], list[float]] = {job: [] for job, error in found.items() if error is not None}
        for _ in range(repeats):
            for (way, fineness), own in times.items():
                start = time.perf_counter()
                way.run(spin, fineness)
                own.append(time.perf_counter() - start)
        rows += [
            _row(spin, way, i, [found[way, f] for f in way.finenesses], times.get((way, f)))
            for way in present
            for i, f in enumerate(way.finenesses)
        ]
    return rows


def long_runs(steps: int, tell: Callable[[str], None]) -> list[LongRun]:
    """`magnus6` in so many steps over the motion, compared at a few hundred instants."""
    from hingepair.integration.integrate import integrate
    from hingepair.integration.trajectory import rotations
    from hingepair.pair.hinge_pair import HingePair

    pair = HingePair(u1=(1, 0, 0), u2=(0, 1, 0), n=(0, 0, 1))
    rows = []
    for spin in SPINS:
        tell(f"{spin.name}: {steps} steps")
        t = np.linspace(0, STOP, steps + 1)
        start = time.perf_counter()
        motion = integrate(pair, t, spin.omega, 0.0, S1_0=spin.Q, outputs=(), backend="numba")
        seconds = time.perf_counter() - start
        picked = np.unique(np.linspace(1, steps, 200).astype(int))
        quats = motion.quat_wxyz[picked]
        S = rotations(quats).astype(np.longdouble)
        off = np.abs(np.einsum("nji,njk->nik", S, S) - np.eye(3)).max()
        error = spin.error(quats, spin.exact(t[picked]))
        rows.append(LongRun(spin.name, steps, error, float(off * 2.0**53), seconds / steps * 1e9))
    return rows


def time_to_goal(rows: Sequence[Row], spin: str, method: str) -> float | None:
    """The run time [ms] at which a method's error is GOAL, between its finenesses; None where it is never."""
    own = [r for r in rows if (r.spin, r.method) == (spin, method) and r.error and r.min_ms]
    for before, after in itertools.pairwise(own):
        if before.error is None or after.error is None or before.min_ms is None or after.min_ms is None:
            continue
        if before.error > GOAL >= after.error:
            part = math.log(before.error / GOAL) / math.log(before.error / after.error)
            return float(before.min_ms * (after.min_ms / before.min_ms) ** part)
    return own[0].min_ms if own and own[0].error is not None and own[0].error <= GOAL else None


def as_json(rows: list[Row], runs: list[LongRun]) -> dict[str, Any]:
    """Rows and machine facts as JSON."""
    goals = {spin.name: {way.name: time_to_goal(rows, spin.name, way.name) for way in ways()} for spin in SPINS}
    return {
        "facts": facts(),
        "rows": [asdict(row) for row in rows],
        "long_runs": [asdict(run) for run in runs],
        "ms_to_error": {"error_rad": GOAL, **goals},
    }


def table(rows: list[Row]) -> Table:
    """The rows as a table, a block for each method."""
    from rich import box
    from rich.table import Table

    found = Table(box=box.SIMPLE_HEAD)
    for heading in ("motion", "method"):
        found.add_column(heading, no_wrap=True)
    for heading in ("h [s] or tolerance", "error [rad]", "order", "ms", "smallest"):
        found.add_column(heading, justify="right", no_wrap=True)
    for i, row in enumerate(rows):
        first = i == 0 or rows[i - 1].method != row.method
        last = i + 1 == len(rows) or rows[i + 1].method != row.method
        size = f"{row.fineness:g} tol" if row.h is None else f"{row.h:g}"
        cells = ("gimbal lock", "", "", "") if row.error is None else _cells(row)
        found.add_row(row.spin if first else "", row.method if first else "", size, *cells, end_section=last)
    return found


def goal_table(rows: list[Row]) -> Table:
    """The run time of each method at the same error."""
    from rich import box
    from rich.table import Table

    found = Table(box=box.SIMPLE_HEAD, title=f"run time at an error of {GOAL:g} rad, ms (times that of magnus6)")
    found.add_column("method", no_wrap=True)
    for spin in SPINS:
        found.add_column(spin.name, justify="right")
    for name in dict.fromkeys(row.method for row in rows):
        cells = []
        for spin in SPINS:
            own, best = time_to_goal(rows, spin.name, name), time_to_goal(rows, spin.name, "magnus6")
            cells.append("-" if own is None or best is None else f"{own:.3g} ({own / best:.3g})")
        found.add_row(name, *cells)
    return found


def _cells(row: Row) -> tuple[str, ...]:
    order = "" if row.order is None else f"{row.order:.2f}"
    return f"{row.error:.2g}", order, f"{row.median_ms:.3g}", f"{row.min_ms:.3g}"


def _first(way: Way, spin: Spin, fineness: float, exact: list[Any]) -> float | None:
    """The error, and everything compiled and warm."""
    try:
        return spin.error(way.run(spin, fineness), exact)
    except GimbalLockError:
        return None


def _row(spin: Spin, way: Way, i: int, errors: list[float | None], times: list[float] | None) -> Row:
    fineness, error, before = way.finenesses[i], errors[i], errors[i - 1] if i else None
    order = None
    if not way.solver and error and before and min(error, before) > 1e-14:
        order = math.log(before / error) / math.log(fineness / way.finenesses[i - 1])
    h = None if way.solver else STOP / fineness
    middle, least = (median(times) * 1e3, min(times) * 1e3) if times else (None, None)
    return Row(spin.name, way.name, fineness, h, error, order, middle, least)
