"""What every bench is made of: one timer, one row, one table.

A bench is a function that gives rows. It makes the jobs of a case (functions of no argument, by the name of who does
the case this way), hands them to `measured`, and adds what it alone knows to `Row.more`.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from math import isfinite
from statistics import median
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from rich.table import Table

Job: TypeAlias = Callable[[], Any]

_PACKAGES = ("hingepair", "numpy", "llvmlite", "pin", "mujoco", "scipy", "jax")
_LEAST = 2e-3  # seconds that one repeat should take
_SHORT = 0.1  # seconds, in which what a job works on fits the caches


@dataclass(frozen=True, slots=True)
class Row:
    """One way to do a case, measured.

    Attributes:
        case: what all ways of it compute.
        method: the way.
        count: samples or steps of a call.
        seconds: of a call, the median of the repeats.
        least: the smallest of them.
        ratio: time for a sample against that of the case's first way: the median over the repeats of both in one.
        error: largest error, in the unit that the bench names; infinite where a result is not finite; None where
            there is nothing to compare.
        more: what one bench alone measures, by column.
    """

    case: str
    method: str
    count: int
    seconds: float
    least: float
    ratio: float
    error: float | None = None
    more: Mapping[str, Any] = field(default_factory=dict)

    @property
    def each(self) -> float:
        """Seconds for a sample."""
        return self.seconds / self.count


@dataclass(frozen=True, slots=True)
class Target:
    """What is aimed at on the reference machine (two cores, AVX2 or better), and what was reached.

    Attributes:
        what: is measured.
        reached: the number.
        target: what it should be.
        least: whether it should be at least that, not at most.
        unit: of both.
    """

    what: str
    reached: float
    target: float
    unit: str
    least: bool = False

    @property
    def ok(self) -> bool:
        """Whether it is reached."""
        return self.reached >= self.target if self.least else self.reached <= self.target


def measured(
    case: str,
    jobs: Mapping[str, Job],
    repeats: int,
    counts: int | Mapping[str, int] = 1,
    errors: Mapping[str, float] | None = None,
    more: Mapping[str, Mapping[str, Any]] | None = None,
) -> list[Row]:
    """The rows of a case: every repeat goes through all jobs, so that noise meets all alike.

    Args:
        case: what the jobs compute.
        jobs: what to time, by name; ratios are against the first.
        repeats: times that each is measured.
        counts: samples of a call, one number or by name.
        errors: by name, as far as known.
        more: further columns, by name.
    """
    times = interleaved(jobs, repeats)
    number = {name: counts if isinstance(counts, int) else counts[name] for name in jobs}
    each = {name: [t / number[name] for t in found] for name, found in times.items()}
    first = next(iter(each.values()), [])
    return [
        Row(
            case,
            name,
            number[name],
            median(found),
            min(found),
            median(own / base for own, base in zip(each[name], first, strict=True)),
            (errors or {}).get(name),
            (more or {}).get(name, {}),
        )
        for name, found in times.items()
    ]


def interleaved(jobs: Mapping[str, Job], repeats: int) -> dict[str, list[float]]:
    """Seconds of a call in each repeat, by name.

    A short job runs once untimed in every repeat: it finds the caches as it left them, not as its neighbour did.
    """
    calls, short = {}, set()
    for name, job in jobs.items():
        job()
        taken = _seconds(job, 1)
        calls[name] = max(1, int(_LEAST / max(taken, 1e-9)))
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


def table(rows: Sequence[Row], unit: str) -> Table:
    """The rows as a table, a block under each case; `unit` heads the errors."""
    columns = list(dict.fromkeys(key for row in rows for key in row.more))
    errors = any(row.error is not None for row in rows)
    found = empty_table("", right=("N", "a call", "each", "ratio", *([unit] if errors else []), *columns))
    for i, row in enumerate(rows):
        if i == 0 or rows[i - 1].case != row.case:
            found.add_row(row.case)
        last = i + 1 == len(rows) or rows[i + 1].case != row.case
        cells = [f"{row.count:,}", duration(row.seconds), duration(row.each), digits(row.ratio)]
        cells += [_cell(row.error)] if errors else []
        cells += [_cell(row.more.get(key)) for key in columns]
        found.add_row(f"  {row.method}", *cells, end_section=last)
    return found


def empty_table(*left: str, right: Sequence[str] = ()) -> Table:
    """A table with columns of words and of numbers."""
    from rich import box
    from rich.table import Table

    found = Table(box=box.SIMPLE_HEAD)
    for heading in left:
        found.add_column(heading, no_wrap=True)
    for heading in right:
        found.add_column(heading, justify="right", no_wrap=True)
    return found


def _cell(value: Any) -> str:
    if value is None:
        return "-"
    return f"{value:.2g}" if isinstance(value, float) else str(value)


def digits(number: float) -> str:
    """Three digits, or all before the point.

    >>> digits(1234.5), digits(0.0123456)
    ('1,234', '0.0123')
    """
    return f"{number:,.0f}" if number >= 100 else f"{number:.3g}"


def duration(seconds: float) -> str:
    """Seconds in a unit in which they read well.

    >>> duration(1.234e-8), duration(0.25)
    ('12.3 ns', '250 ms')
    """
    for unit, size in (("s", 1.0), ("ms", 1e-3), ("us", 1e-6)):
        if seconds >= size:
            return f"{digits(seconds / size)} {unit}"
    return f"{digits(seconds * 1e9)} ns"


def as_json(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The rows for JSON, in which a number that is not finite is null."""
    return [finite(asdict(row)) for row in rows]


def finite(values: Mapping[str, Any]) -> dict[str, Any]:
    """The same with None for numbers that are not finite."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            found[key] = finite(value)
        else:
            found[key] = None if isinstance(value, float) and not isfinite(value) else value
    return found


def facts() -> dict[str, Any]:
    """The machine and the versions that a measurement belongs to."""
    found = {
        "processor": _processor(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "system": platform.system(),
        "python": platform.python_version(),
    }
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def _processor() -> str:
    """The processor's name, where the system says it."""
    with suppress(OSError), open("/proc/cpuinfo", encoding="utf-8") as lines:
        for line in lines:
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor()
