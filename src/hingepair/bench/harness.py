"""The parts of every benchmark: methods, cases, the timer, processes without caches, rows of results, the report.

A benchmark is a function that returns a `Report`: it yields a `Case` for each comparison, `measure` times the jobs of
each case in turn, and table, JSON and picture come out of the report.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
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

from hingepair.tables.sheets import json_text, ruled_table

if TYPE_CHECKING:
    from hingepair.bench.plot import Panel

Job: TypeAlias = Callable[[], Any]
"""A call that is timed; it returns what the method computes."""

HINGEPAIR, PREPARED = "hingepair", "hingepair, prepared"  # names of methods of several benchmarks


class Method(NamedTuple):
    """A way to compute what a case asks for."""

    name: str
    # Returns the job of a task. What a user sets up once is set up here and not timed; what a user reads out of an
    # engine is read in the job.
    make_job: Callable[[Any], Job]
    min_samples: int = 1  # smallest batch for which it is measured
    max_samples: int = 10**7  # of a larger batch it computes the first samples only
    package: str = ""  # that must be installed
    in_picture: bool = True


def installed(methods: Iterable[Method], reasons: Mapping[str, str | None]) -> tuple[list[Method], list[str]]:
    """Return the methods that can be measured, and a note on each of the others.

    Args:
        methods: all methods; those whose package is missing are left out.
        reasons: why a method is left out, by its name; None for no reason.
    """
    found, notes = [], []
    for method in methods:
        is_absent = method.package and find_spec(method.package) is None
        if reason := f"{method.package} is not installed" if is_absent else reasons.get(method.name):
            notes.append(f"left out: {method.name} ({reason})")
        else:
            found.append(method)
    return found, notes


class Case(NamedTuple):
    """Jobs that compute the same, by the names of their methods; ratios are to the first."""

    name: str
    jobs: Mapping[str, Job]
    samples: int | Mapping[str, int] = 1  # of a call, for all methods or by name
    errors: Mapping[str, float] = {}
    columns: Mapping[str, Mapping[str, Any]] = {}  # further values, by method and heading


def batch_case(
    name: str,
    methods: Iterable[Method],
    make_task: Callable[[int], Any],
    samples: int,
    errors: Mapping[str, float] | None = None,
    columns: Mapping[str, Mapping[str, Any]] | None = None,
) -> Case:
    """Return the case of a batch, without methods for larger ones; `make_task(n)` makes its task of n samples."""
    counts = {method: min(samples, method.max_samples) for method in methods if method.min_samples <= samples}
    jobs = {method.name: method.make_job(make_task(count)) for method, count in counts.items()}
    by_name = {method.name: count for method, count in counts.items()}
    return Case(f"{name}, N = {samples:,}", jobs, by_name, errors or {}, columns or {})


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a table: run times and error of a method on a case."""

    case: str
    method: str
    count: int  # samples of a call
    seconds: float  # of a call, the median of the repeats
    min_seconds: float
    ratio: float  # time for a sample over that of the case's first method: the median of the ratios in each repeat
    error: float | None = None  # infinite if a result is not finite, None if there is nothing to compare with
    extra_columns: Mapping[str, Any] = field(default_factory=dict)  # by heading

    @property
    def seconds_per_sample(self) -> float:
        """Return the time for one sample [s]."""
        return self.seconds / self.count


class Report(NamedTuple):
    """The result of a benchmark."""

    rows: Sequence[Row]  # those of a case stand together
    error_label: str = ""  # heading of the errors
    notes: Sequence[str] = ()  # sentences below the table
    panels: Sequence[Sequence[Panel]] = ()  # of the picture, row by row

    def table(self, width: int | None = None) -> list[str]:
        """Return the lines of the table, a block for each case; the first and the last are empty.

        Args:
            width: largest length of a line; None for any.
        """
        columns = list(dict.fromkeys(key for row in self.rows for key in row.extra_columns))
        has_errors = any(row.error is not None for row in self.rows)
        heading = ("", "N", "a call", "each", "ratio", *[self.error_label] * has_errors, *columns)
        lines: list[Sequence[str]] = [heading]
        for i, row in enumerate(self.rows):
            if i == 0 or self.rows[i - 1].case != row.case:
                lines += [()] if i else []
                lines.append((row.case, *[""] * (len(heading) - 1)))
            times = duration_text(row.seconds), duration_text(row.seconds_per_sample)
            values = (*[row.error] * has_errors, *map(row.extra_columns.get, columns))
            cells = (f"{row.count:,}", *times, number_text(row.ratio), *map(_cell, values))
            lines.append((f"  {row.method}", *cells))
        return ["", *ruled_table(lines, 1, width), ""]

    def to_json(self) -> str:
        """Return facts about the machine, rows and notes as JSON; a number that is not finite becomes null."""
        return json_text({"facts": machine_facts(), "rows": [asdict(row) for row in self.rows], "notes": self.notes})


def measure(cases: Iterable[Case], repeats: int) -> list[Row]:
    """Time the jobs of each case and return its rows."""
    rows = []
    for case in cases:
        print_progress(f"{case.name}: {repeats} repeats")
        rows += make_rows(case, time_interleaved(case.jobs, repeats))
    return rows


def make_rows(case: Case, seconds: Mapping[str, Sequence[float]]) -> list[Row]:
    """Return the rows of a case from the times of a call in each repeat [s], by the method's name."""
    counts = dict.fromkeys(seconds, case.samples) if isinstance(case.samples, int) else case.samples
    first, rows = next(iter(seconds), ""), []
    for name, times in seconds.items():
        scale = counts[first] / counts[name]
        ratio = median(scale * t / base for t, base in zip(times, seconds[first], strict=True))
        further = case.errors.get(name), case.columns.get(name, {})
        rows.append(Row(case.name, name, counts[name], median(times), min(times), ratio, *further))
    return rows


def time_interleaved(jobs: Mapping[str, Job], repeats: int) -> dict[str, list[float]]:
    """Call all jobs in turn, `repeats` times, so that disturbances meet all alike; return times of a call [s]. A job
    that fails, as for want of memory, is reported and left out.
    """
    able = {}
    for name, job in jobs.items():
        try:
            job()
        except Exception as error:
            print_progress(f"left out: {name} ({type(error).__name__}: {str(error).partition(chr(10))[0]})")
        else:
            able[name] = job
    jobs, once = able, {}
    for name, job in jobs.items():
        wait_for_other_threads()
        once[name] = timeit(job, number=1)
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for _ in range(repeats):
        for name, job in jobs.items():
            wait_for_other_threads()
            if once[name] < 0.1:  # s; the caches then hold the job's data and not those of the job before
                job()
            calls = max(1, int(2e-3 / max(once[name], 1e-9)))  # of a fast job, so that they take 2 ms
            times[name].append(timeit(job, number=calls) / calls)
    return times


def wait_for_other_threads() -> None:
    """Wait up to ten seconds until the other threads of this process are idle (Linux only).

    JAX frees its memory after a call has returned, which would delay the next job.
    """
    idle = 0
    for _ in range(10_000):
        idle = 0 if _other_threads_run() else idle + 1
        if idle == 5:
            return
        time.sleep(1e-3)


def _other_threads_run() -> bool:
    """Return whether Linux lists another thread of this process as running (R) or waiting for a page (D)."""
    for path in Path("/proc/self/task").glob("[0-9]*/stat"):
        if int(path.parent.name) != threading.get_native_id():
            with suppress(OSError):  # the thread has ended
                if path.read_text().rpartition(")")[2].split()[0] in "RD":
                    return True
    return False


FIRST, ON_DISK, SECOND = "first call", "first call, code on disk", "second call"


def measure_cold(
    case: str, codes: Mapping[str, tuple[str, str]], repeats: int, calls: Sequence[str] = (FIRST, ON_DISK, SECOND)
) -> list[Row]:
    """Measure calls in fresh processes, as a user meets them, and return their rows.

    Args:
        case: name of the case.
        codes: by the method's name, Python code that runs before and the statement that is timed.
        repeats: of each measurement.
        calls: which calls have rows: the first on this machine (FIRST), the first of a process after another process
            has left machine code on the disk (ON_DISK), and the one after that (SECOND).
    """
    print_progress(f"{case}: fresh processes, {repeats} repeats")
    times: dict[str, list[float]] = {f"{name}, {call}": [] for name in codes for call in calls}
    with tempfile.TemporaryDirectory() as bytecode:
        for repeat in range(-1, repeats):  # the first round compiles the sources to bytecode and is not counted
            for name, code in codes.items():
                with tempfile.TemporaryDirectory() as cache:
                    first, _ = _times_of_process(*code, bytecode, cache)
                    on_disk, second = _times_of_process(*code, bytecode, cache)
                for call, seconds in ((FIRST, first), (ON_DISK, on_disk), (SECOND, second)):
                    if repeat >= 0 and call in calls:
                        times[f"{name}, {call}"].append(seconds)
    return make_rows(Case(case, {}), times)


def _times_of_process(before: str, timed: str, bytecode: str, cache: str) -> tuple[float, float]:
    """Return the times [s] of two executions of a statement in a new process, whose caches are these two folders."""
    code = f"""
import sys, time
{before}
times = []
for _ in range(2):
    start = time.perf_counter()
    {timed}
    times.append(time.perf_counter() - start)
print(*times, file=sys.stderr)
"""
    folders = {"PYTHONPYCACHEPREFIX": bytecode, "PYTHONDONTWRITEBYTECODE": "", "HINGEPAIR_CACHE": cache}
    command = [sys.executable, "-c", code]
    process = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | folders)
    first, second = map(float, process.stderr.split()[-2:])
    return first, second


def _cell(value: Any) -> str:
    return "-" if value is None else f"{value:.2g}" if isinstance(value, float) else str(value)


def number_text(number: float) -> str:
    """Return a number with three significant digits, or as an integer if it is at least 100.

    >>> number_text(1234.5), number_text(0.0123456)
    ('1,234', '0.0123')
    """
    return f"{number:,.0f}" if number >= 100 else f"{number:.3g}"


def duration_text(seconds: float) -> str:
    """Return a duration in the largest unit in which it is at least 1.

    >>> duration_text(1.234e-8), duration_text(0.25)
    ('12.3 ns', '250 ms')
    """
    units = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
    unit = next((unit for unit, size in units.items() if seconds >= size), "ns")
    return f"{number_text(seconds / units[unit])} {unit}"


def machine_facts() -> dict[str, Any]:
    """Return the processor, its cores, the system, and the versions of Python and of what is installed."""
    processor = platform.processor()
    with suppress(OSError, StopIteration), open("/proc/cpuinfo", encoding="utf-8") as lines:
        processor = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    facts = {"processor": processor, "machine": platform.machine(), "cores": os.cpu_count()}
    facts |= {"system": platform.system(), "python": platform.python_version()}
    for name in ("hingepair", "numpy", "llvmlite", "pin", "mujoco", "scipy", "jax"):
        with suppress(PackageNotFoundError):
            facts[name] = version(name)
    return facts


def print_progress(text: str) -> None:
    """Print a line about the progress of a benchmark to standard error."""
    print(text, file=sys.stderr, flush=True)
