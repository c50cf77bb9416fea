"""What every bench is made of: ways to do a case, one timer, one row, one report.

A bench is a function that gives a `Report`. It makes the jobs of a case (functions of no argument, by the name of who
does the case this way), times them with `interleaved`, and adds what it alone knows to `Row.more`.
"""

from __future__ import annotations

import os
import platform
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from timeit import timeit
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

from hingepair.numeric.tables import json_text, ruled_table

if TYPE_CHECKING:
    from hingepair.bench.plot import Panel

Job: TypeAlias = Callable[[], Any]

_PACKAGES = ("hingepair", "numpy", "llvmlite", "pin", "mujoco", "scipy", "jax")
_LEAST = 2e-3  # seconds that one repeat should take
_SHORT = 0.1  # seconds, in which what a job works on fits the caches
_LOOK_SECONDS = 1e-3  # between two looks at the other threads of the process
_LOOKS_AT_REST = 5  # looks, one after the other, that find no thread running before a job is timed
_MAX_LOOKS = 10_000  # looks, after which a job is timed all the same
_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}


class Way(NamedTuple):
    """One way to do a case: this library's, or what a user could take instead."""

    name: str  # it
    # makes a job of a problem; what can be made once is made before the job, what a user would read out of an engine
    # is read out in it
    make: Callable[[Any], Job]
    least: int = 1  # samples below which it is not asked
    most: int = 10**7  # samples that it is given at most, the first of all
    needs: str = ""  # the package it needs
    drawn: bool = True  # whether it is in the picture


def present(ways: Iterable[Way], lacking: Mapping[str, str | None]) -> tuple[list[Way], list[str]]:
    """The ways that can be had, and a line for each that cannot; `lacking` are reasons by name, found beforehand."""
    found, missing = [], []
    for way in ways:
        absent = f"{way.needs} is not installed" if way.needs and find_spec(way.needs) is None else None
        if reason := absent or lacking.get(way.name):
            missing.append(f"left out: {way.name} ({reason})")
        else:
            found.append(way)
    return found, missing


@dataclass(frozen=True, slots=True)
class Row:
    """One way to do a case, measured."""

    case: str  # what all ways of it compute
    method: str  # the way
    count: int  # samples or steps of a call
    seconds: float  # of a call, the median of the repeats
    least: float  # the smallest of them
    ratio: float  # time for a sample against that of the case's first way: the median over the repeats of both in one
    # largest error, in the unit that the bench names; infinite where a result is not finite; None where there is
    # nothing to compare
    error: float | None = None
    more: Mapping[str, Any] = field(default_factory=dict)  # what one bench alone measures, by column

    @property
    def each(self) -> float:
        """Seconds for a sample."""
        return self.seconds / self.count


class Report(NamedTuple):
    """What a bench found."""

    rows: Sequence[Row]  # a block of them for each case
    unit: str = ""  # of their errors
    notes: Sequence[str] = ()  # lines to read the numbers by
    panels: Sequence[Sequence[Panel]] = ()  # of the picture, row by row

    def table(self, width: int | None = None) -> list[str]:
        """Return the lines of the table: a block of rows for each case.

        Args:
            width: of a line [characters]; None for lines of any length.
        """
        columns = list(dict.fromkeys(key for row in self.rows for key in row.more))
        errors = [self.unit] if any(row.error is not None for row in self.rows) else []
        heading = ("", "N", "a call", "each", "ratio", *errors, *columns)
        lines: list[Sequence[str]] = [heading]
        for i, row in enumerate(self.rows):
            if i == 0 or self.rows[i - 1].case != row.case:
                lines += [()] if i else []
                lines.append((row.case, *[""] * (len(heading) - 1)))
            cells = [f"{row.count:,}", duration(row.seconds), duration(row.each), digits(row.ratio)]
            cells += [_cell(number) for number in (*([row.error] if errors else []), *map(row.more.get, columns))]
            lines.append((f"  {row.method}", *cells))
        return ["", *ruled_table(lines, 1, width), ""]

    def to_json(self) -> str:
        """Everything but the picture, and the machine, as JSON; a number that is not finite is null."""
        return json_text({"facts": facts(), "rows": [asdict(row) for row in self.rows], "notes": self.notes})


def compared(
    case: str,
    ways: Iterable[Way],
    problem: Callable[[int], Any],
    size: int,
    repeats: int,
    errors: Mapping[str, float] | None = None,
    more: Mapping[str, Mapping[str, Any]] | None = None,
) -> list[Row]:
    """A case by all ways that are asked at this size, of a problem of as many samples as each is given."""
    given = {way: min(size, way.most) for way in ways if way.least <= size}
    jobs = {way.name: way.make(problem(count)) for way, count in given.items()}
    counts = {way.name: count for way, count in given.items()}
    return rows_of(case, interleaved(jobs, repeats), counts, errors, more)


def rows_of(
    case: str,
    times: Mapping[str, Sequence[float]],
    counts: int | Mapping[str, int] = 1,
    errors: Mapping[str, float] | None = None,
    more: Mapping[str, Mapping[str, Any]] | None = None,
) -> list[Row]:
    """The rows of a case.

    Args:
        case: what is computed.
        times: seconds of a call in each repeat, by name; ratios are against the first.
        counts: samples of a call, one number or by name.
        errors: by name, as far as known.
        more: further columns, by name.
    """
    number = {name: counts if isinstance(counts, int) else counts[name] for name in times}
    first, rows = next(iter(times), ""), []
    for name, own in times.items():
        scale = number[first] / number[name]
        ratio = median(scale * t / base for t, base in zip(own, times[first], strict=True))
        extra = (errors or {}).get(name), (more or {}).get(name, {})
        rows.append(Row(case, name, number[name], median(own), min(own), ratio, *extra))
    return rows


def interleaved(jobs: Mapping[str, Job], repeats: int) -> dict[str, list[float]]:
    """Seconds of a call in each repeat, by name; every repeat goes through all jobs, so that noise meets all alike.

    Every timing waits until the other threads of the process are at rest: JAX frees its memory after the call has
    returned, and until that is done a neighbour's new arrays wait for it. A short job then runs once untimed in every
    repeat: it finds the caches as it left them, not as its neighbour did.
    """
    for job in jobs.values():
        job()
    once = {}
    for name, job in jobs.items():
        wait_for_other_threads()
        once[name] = timeit(job, number=1)
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(repeats):
        for name, job in jobs.items():
            wait_for_other_threads()
            if once[name] < _SHORT:
                job()
            calls = max(1, int(_LEAST / max(once[name], 1e-9)))
            times[name].append(timeit(job, number=calls) / calls)
    return times


def wait_for_other_threads() -> None:
    """Wait until no other thread of this process runs or waits for a page of memory, or for ten seconds.

    Only Linux shows the states of threads; elsewhere the function returns at once.
    """
    looks_at_rest = 0
    for _ in range(_MAX_LOOKS):
        looks_at_rest = 0 if _other_threads_run() else looks_at_rest + 1
        if looks_at_rest == _LOOKS_AT_REST:
            return
        time.sleep(_LOOK_SECONDS)


def _other_threads_run() -> bool:
    """Return whether Linux lists another thread of this process as running (R) or waiting uninterruptibly (D)."""
    for path in Path("/proc/self/task").glob("[0-9]*/stat"):
        if int(path.parent.name) != threading.get_native_id():
            with suppress(OSError):  # the thread has ended
                if path.read_text().rpartition(")")[2].split()[0] in "RD":
                    return True
    return False


def _cell(value: Any) -> str:
    return "-" if value is None else f"{value:.2g}" if isinstance(value, float) else str(value)


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
    unit = next((unit for unit, size in _UNITS.items() if seconds >= size), "ns")
    return f"{digits(seconds / _UNITS[unit])} {unit}"


def facts() -> dict[str, Any]:
    """The machine and the versions that a measurement belongs to."""
    processor = platform.processor()
    with suppress(OSError, StopIteration), open("/proc/cpuinfo", encoding="utf-8") as lines:
        processor = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    found = {"processor": processor, "machine": platform.machine(), "cores": os.cpu_count()}
    found |= {"system": platform.system(), "python": platform.python_version()}
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):
            found[name] = version(name)
    return found


def tell(text: str) -> None:
    """Say what is about to be measured."""
    print(text, file=sys.stderr, flush=True)
