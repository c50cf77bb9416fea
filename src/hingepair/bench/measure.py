"""What every bench is made of: one timer, one row, one report.

A bench is a function that gives a `Report`. It makes the jobs of a case (functions of no argument, by the name of who
does the case this way), hands them to `measured`, and adds what it alone knows to `Row.more`.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from statistics import median
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from hingepair.numeric.tables import json_text

if TYPE_CHECKING:
    from rich.table import Table

    from hingepair.bench.plot import Panel

Job: TypeAlias = Callable[[], Any]
Tell: TypeAlias = Callable[[str], None]
"""Where a bench says what it is about to measure."""

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
        unit: of both.
        least: whether it should be at least that, not at most.
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


class Report(NamedTuple):
    """What a bench found.

    Attributes:
        rows: a block of them for each case.
        unit: of their errors.
        targets: as far as they were measured.
        notes: lines to read the numbers by.
        panels: of the picture, row by row.
    """

    rows: Sequence[Row]
    unit: str = ""
    targets: Sequence[Target] = ()
    notes: Sequence[str] = ()
    panels: Sequence[Sequence[Panel]] = ()

    def tables(self) -> list[Table]:
        """The rows, a block under each case, and the targets."""
        columns = list(dict.fromkeys(key for row in self.rows for key in row.more))
        errors = [self.unit] if any(row.error is not None for row in self.rows) else []
        found = _table("", right=("N", "a call", "each", "ratio", *errors, *columns))
        for i, row in enumerate(self.rows):
            if i == 0 or self.rows[i - 1].case != row.case:
                found.add_row(row.case)
            last = i + 1 == len(self.rows) or self.rows[i + 1].case != row.case
            cells = [f"{row.count:,}", duration(row.seconds), duration(row.each), digits(row.ratio)]
            cells += [_cell(number) for number in (*([row.error] if errors else []), *map(row.more.get, columns))]
            found.add_row(f"  {row.method}", *cells, end_section=last)
        aims = _table("aimed at, on the reference machine", right=("target", "reached", "", ""))
        for target in self.targets:
            aim, verdict = f"{'>=' if target.least else '<='} {target.target:g}", "ok" if target.ok else "missed"
            aims.add_row(target.what, aim, digits(target.reached), target.unit, verdict)
        return [found, aims] if self.targets else [found]

    def to_json(self) -> str:
        """Everything but the picture, and the machine, as JSON; a number that is not finite is null."""
        targets = [asdict(target) | {"ok": target.ok} for target in self.targets]
        rows = [asdict(row) for row in self.rows]
        return json_text({"facts": facts(), "rows": rows, "targets": targets, "notes": self.notes})


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
    return rows_of(case, interleaved(jobs, repeats), counts, errors, more)


def rows_of(
    case: str,
    times: Mapping[str, Sequence[float]],
    counts: int | Mapping[str, int] = 1,
    errors: Mapping[str, float] | None = None,
    more: Mapping[str, Mapping[str, Any]] | None = None,
) -> list[Row]:
    """The rows of a case whose times are known: seconds of a call in each repeat, by name; else as `measured`."""
    number = {name: counts if isinstance(counts, int) else counts[name] for name in times}
    first = next(iter(times), "")
    rows = []
    for name, own in times.items():
        scale = number[first] / number[name]
        ratio = median(scale * t / base for t, base in zip(own, times[first], strict=True))
        extra = (errors or {}).get(name), (more or {}).get(name, {})
        rows.append(Row(case, name, number[name], median(own), min(own), ratio, *extra))
    return rows


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


def _table(left: str, right: Sequence[str]) -> Table:
    """A table with a column of words, and columns of numbers."""
    from rich import box
    from rich.table import Table

    found = Table(box=box.SIMPLE_HEAD)
    found.add_column(left, no_wrap=True)
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
