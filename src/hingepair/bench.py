"""`hingepair bench direct`: run time against error, all methods in one run."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import version
from statistics import median
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from hingepair.accuracy import error_ratios, euler_rate_sizes, output_scales
from hingepair.bench_contenders import METHODS, installed
from hingepair.bench_methods import LEVELS, PARTS, Job, Method, Motion
from hingepair.pair import HingePair

if TYPE_CHECKING:
    from rich.table import Table

DIGITS = 50
_COMPARED = 100  # random states, compared with the exact ones
_LEAST = 2e-3  # seconds that one repeat should take


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
        error: largest error of any output in units of u * scale.
    """

    method: str
    level: str
    samples: int
    median_ns: float
    min_ns: float
    ratio: float
    error: float


def direct(sizes: Sequence[int], levels: Sequence[str], repeats: int, tell: Callable[[str], None]) -> list[Row]:
    """Measure all methods, interleaved, with the copy floor in the same run."""
    rng = np.random.default_rng(20)
    pair = HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5), home=_home())
    rows: list[Row] = []
    for level in levels:
        count = list(LEVELS).index(level) + 1
        errors = _errors(pair, tuple(rng.normal(size=(count, _COMPARED, 7))), level)
        for size in sizes:
            motion = tuple(rng.normal(size=(count, size, 7)))
            jobs = {m.name: m.prepare(pair, _as(motion, m)) for m in METHODS if installed(m) and size <= m.most}
            jobs["copy floor"] = _copies(level, size)
            tell(f"{level}, N = {size}: {len(jobs)} methods, {repeats} repeats")
            times = interleaved(jobs, repeats)
            first = median(times[METHODS[0].name])
            for name, found in times.items():
                middle = median(found)
                nanoseconds = middle / size * 1e9, min(found) / size * 1e9
                rows.append(Row(name, level, size, *nanoseconds, middle / first, errors.get(name, 0.0)))
    return rows


def facts() -> dict[str, Any]:
    """The machine and the versions that a measurement belongs to."""
    packages = {name: version(name) for name in ("hingepair", "numpy", "numba", "pin", "sympy")}
    return {
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
        **packages,
    }


def as_json(rows: list[Row]) -> dict[str, Any]:
    """Rows and machine facts as JSON."""
    return {"facts": facts(), "rows": [asdict(row) for row in rows]}


def table(rows: list[Row]) -> Table:
    """The rows as a table: a block for each workload, the fastest first."""
    from rich import box
    from rich.table import Table

    found = Table(box=box.SIMPLE_HEAD)
    for heading in ("level", "N"):
        found.add_column(heading, no_wrap=True)
    found.add_column("method", no_wrap=True)
    for heading in ("ns/sample", "smallest", "ratio", "error [u*scale]"):
        found.add_column(heading, justify="right", no_wrap=True)
    workloads = list(dict.fromkeys((row.level, row.samples) for row in rows))
    for level, samples in workloads:
        block = sorted((r for r in rows if (r.level, r.samples) == (level, samples)), key=lambda r: r.median_ns)
        for i, row in enumerate(block):
            error = "-" if row.method == "copy floor" else f"{row.error:.2g}"
            cells = (f"{row.median_ns:.4g}", f"{row.min_ns:.4g}", f"{row.ratio:.3g}", error)
            head = (level, f"{samples:,}") if i == 0 else ("", "")
            found.add_row(*head, row.method, *cells, end_section=i == len(block) - 1)
    return found


def plot(rows: list[Row], path: str) -> None:
    """Error against run time, log-log, for the largest N of each level; labels at the points, legible in grey.

    Raises:
        MissingDependencyError: Matplotlib is not installed.
    """
    from hingepair.bench_plot import work_precision

    work_precision(rows, path)


def interleaved(jobs: dict[str, Job], repeats: int) -> dict[str, list[float]]:
    """Times of one call each, in seconds; every repeat goes through all methods, so that noise meets all alike."""
    calls = {}
    for name, job in jobs.items():
        job()
        start = time.perf_counter()
        job()
        calls[name] = max(1, int(_LEAST / (time.perf_counter() - start)))
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(repeats):
        for name, job in jobs.items():
            start = time.perf_counter()
            for _ in range(calls[name]):
                job()
            times[name].append((time.perf_counter() - start) / calls[name])
    return times


def _copies(level: str, size: int) -> Job:
    """The floor: numpy.copyto of as many bytes as the outputs have."""
    source = {name: np.ones((size, 9 if name == "S2" else 3)) for name in LEVELS[level]}
    target = {name: np.zeros_like(array) for name, array in source.items()}

    def run() -> dict[str, NDArray[Any]]:
        for name, array in source.items():
            np.copyto(target[name], array)
        return target

    return run


def _errors(pair: HingePair, motion: Motion, level: str) -> dict[str, float]:
    """Each method's largest error against 50 digits, in units of u * scale of its dtype."""
    exact: dict[Any, Any] = {
        dtype: _exact(pair, tuple(c.astype(dtype) for c in motion), level) for dtype in (np.float64, np.float32)
    }
    errors = {}
    for method in METHODS:
        if not installed(method):
            continue
        given = _as(motion, method)
        found = method.prepare(pair, given)()
        scales = _scales(pair, given)
        worst = 0.0
        for name in LEVELS[level]:
            _, ratio = error_ratios(name, found[name], exact[method.dtype][name], scales[name], method.dtype)
            worst = max(worst, float(ratio.max()))
        errors[method.name] = worst
    return errors


def _exact(pair: HingePair, motion: Motion, level: str) -> dict[str, NDArray[Any]]:
    """The outputs to 50 digits, rounded to doubles at the end: the plan's steps over mpmath numbers."""
    import mpmath

    from hingepair.plan import make_plan

    def numbers(row: Any) -> tuple[Any, ...]:
        return tuple(mpmath.mpf(float(x)) for x in row)

    with mpmath.workdps(DIGITS):
        n = numbers(pair.n)
        constants = {key: numbers(getattr(pair, key).ravel()) for key in ("u1", "u2", "home")}
        length = mpmath.sqrt(sum(x * x for x in n))
        constants["n"] = tuple(x / length for x in n)
        plan = make_plan(LEVELS[level], "XYZ", True, (_angle_terms, _hinge_terms))
        found: dict[str, list[Any]] = {name: [] for name in LEVELS[level]}
        for sample in zip(*motion, strict=True):
            values: dict[str, Any] = dict(constants)
            for names, seven in zip(PARTS, map(numbers, sample), strict=False):
                values |= dict(zip(names, (seven[:3], seven[3:6], seven[6]), strict=True))
            plan.run(values)
            for name, parts in found.items():
                parts.append([float(x) for x in values[name]])
    return {name: np.array(p).reshape(-1, *((3, 3) if name == "S2" else (3,))) for name, p in found.items()}


def _angle_terms(phi: Any) -> tuple[Any, ...]:
    import mpmath

    return tuple(f(angle) for angle in phi for f in (mpmath.sin, mpmath.cos))


def _hinge_terms(psi: Any) -> tuple[Any, Any]:
    import mpmath

    return mpmath.sin(psi), 2 * mpmath.sin(psi / 2) ** 2


def _scales(pair: HingePair, motion: Motion) -> dict[str, NDArray[np.float64]]:
    q, qd, qdd = (*motion, None, None)[:3]
    W1, A1 = euler_rate_sizes(None if qd is None else qd[:, 3:6], None if qdd is None else qdd[:, 3:6])
    linear: dict[str, Any] = {name: c[:, :3] for name, c in (("R1", q), ("v1", qd), ("a1", qdd)) if c is not None}
    hinge: dict[str, Any] = {name: c[:, 6] for name, c in (("psid", qd), ("psidd", qdd)) if c is not None}
    return output_scales(u1=pair.u1, u2=pair.u2, W1=W1, A1=A1, **linear, **hinge)


def _as(motion: Motion, method: Method) -> Motion:
    return tuple(c.astype(method.dtype) for c in motion)


def _home() -> NDArray[Any]:
    from hingepair.rotations import rodrigues

    return rodrigues((1, -2, 0.5), 0.7)
