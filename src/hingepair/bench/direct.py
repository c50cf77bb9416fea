"""`hingepair bench direct`: run time against error, all methods in one run."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib.metadata import version
from importlib.util import find_spec
from math import isfinite
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hingepair.bench.methods import LEVELS, Job, Method, converted, room_at
from hingepair.bench.truth import hard_states, random_states, worst_errors
from hingepair.pair.hinge_pair import HingePair

if TYPE_CHECKING:
    from rich.table import Table

FLOOR = "copy floor"
_PACKAGES = {name: name for name in ("hingepair", "numpy", "numba", "sympy", "scipy", "jax", "mujoco")} | {
    "pin": "pinocchio"
}
_COMPARED = 100  # random states, compared with the exact ones
_LEAST = 2e-3  # seconds that one repeat should take
_SHORT = 0.1  # seconds, in which what a job works on fits the caches


@dataclass(frozen=True, slots=True)
class Row:
    """One method on one workload.

    Attributes:
        method: its name.
        level: pose, velocity or acceleration.
        samples: N.
        median_ns: nanoseconds a sample, the median of the repeats.
        min_ns: the smallest of the repeats.
        ratio: median against that of hingepair's first row of the workload.
        error: largest error of any output on random states, in units of u * scale; None for copies.
        hard_error: the same on hard states; infinite where there is no finite result.
    """

    method: str
    level: str
    samples: int
    median_ns: float
    min_ns: float
    ratio: float
    error: float | None
    hard_error: float | None


def direct(
    methods: Sequence[Method], sizes: Sequence[int], levels: Sequence[str], repeats: int, tell: Callable[[str], None]
) -> list[Row]:
    """Measure all methods, interleaved, with the copy floor in the same run."""
    rng = np.random.default_rng(20)
    pair = HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5), home=_home())
    rows: list[Row] = []
    for level in levels:
        parts = list(LEVELS).index(level) + 1
        errors = [
            worst_errors(methods, pair, states, level)
            for states in (random_states(rng, _COMPARED, parts), hard_states(rng, parts))
        ]
        for size in sizes:
            motion = random_states(rng, size, parts)
            jobs = {m.name: m.prepare(pair, converted(motion, m.dtype)) for m in methods if size <= m.most}
            jobs |= _copies(parts, size)
            tell(f"{level}, N = {size}: {len(jobs)} methods, {repeats} repeats")
            times = interleaved(jobs, repeats)
            first = median(times[methods[0].name])
            for name, found in times.items():
                middle = median(found)
                nanoseconds = middle / size * 1e9, min(found) / size * 1e9
                rows.append(Row(name, level, size, *nanoseconds, middle / first, *(e.get(name) for e in errors)))
    return rows


def facts() -> dict[str, Any]:
    """The machine and the versions that a measurement belongs to."""
    return {
        "processor": _processor(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        **{name: version(name) for name in _PACKAGES if find_spec(_PACKAGES[name]) is not None},
    }


def as_json(rows: list[Row], left_out: list[str]) -> dict[str, Any]:
    """Rows and machine facts as JSON, in which a number that is not finite is null."""
    finite = [
        {
            key: None if isinstance(value, float) and not isfinite(value) else value
            for key, value in asdict(row).items()
        }
        for row in rows
    ]
    return {"facts": facts(), "rows": finite, "left_out": left_out}


def table(rows: list[Row]) -> Table:
    """The rows as a table: a block for each workload, the fastest first."""
    from rich import box
    from rich.table import Table

    found = Table(box=box.SIMPLE_HEAD)
    for heading in ("level", "N"):
        found.add_column(heading, no_wrap=True)
    found.add_column("method", no_wrap=True)
    for heading in ("ns/sample", "smallest", "ratio", "random", "hard"):
        found.add_column(heading, justify="right", no_wrap=True)
    workloads = list(dict.fromkeys((row.level, row.samples) for row in rows))
    for level, samples in workloads:
        block = sorted((r for r in rows if (r.level, r.samples) == (level, samples)), key=lambda r: r.median_ns)
        for i, row in enumerate(block):
            errors = ("-" if error is None else f"{error:.2g}" for error in (row.error, row.hard_error))
            cells = (*map(_digits, (row.median_ns, row.min_ns, row.ratio)), *errors)
            head = (level, f"{samples:,}") if i == 0 else ("", "")
            found.add_row(*head, row.method, *cells, end_section=i == len(block) - 1)
    return found


def _digits(number: float) -> str:
    """Three digits, or all before the point."""
    return f"{number:,.0f}" if number >= 100 else f"{number:.3g}"


def plot(rows: list[Row], path: str) -> None:
    """Error against run time, log-log, for the largest N of each level; labels at the points, legible in grey.

    Raises:
        MissingDependencyError: Matplotlib is not installed.
    """
    from hingepair.bench.plot import work_precision

    work_precision(rows, path)


def interleaved(jobs: dict[str, Job], repeats: int) -> dict[str, list[float]]:
    """Times of one call each, in seconds; every repeat goes through all methods, so that noise meets all alike.

    A short job runs once untimed in every repeat: it finds the caches as it left them, not as its neighbour did.
    """
    calls, short = {}, set()
    for name, job in jobs.items():
        job()
        taken = _seconds(job, 1)
        calls[name] = max(1, int(_LEAST / taken))
        if taken < _SHORT:
            short.add(name)
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(repeats):
        for name, job in jobs.items():
            if name in short:
                job()
            times[name].append(_seconds(job, calls[name]) / calls[name])
    return times


def _seconds(job: Job, calls: int) -> float:
    start = time.perf_counter()
    for _ in range(calls):
        job()
    return time.perf_counter() - start


def _copies(parts: int, size: int) -> dict[str, Job]:
    """The floors: copies of as many bytes as the outputs have, into arrays that are there or into new ones."""
    source, target = room_at(parts, size), room_at(parts, size)
    for array in source.values():
        array.fill(1.0)

    def copy() -> dict[str, NDArray[Any]]:
        for name, array in source.items():
            np.copyto(target[name], array)
        return target

    return {FLOOR: copy, f"{FLOOR}, fresh": lambda: {name: array.copy() for name, array in source.items()}}


def _processor() -> str:
    """The processor's name, where the system says it."""
    with suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as lines:
        for line in lines:
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()


def _home() -> NDArray[Any]:
    from hingepair.rotations.matrices import rodrigues

    return rodrigues((1, -2, 0.5), 0.7)
