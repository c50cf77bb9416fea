"""The parts of every benchmark: methods that are compared on a case, the timer, rows of results, the report.

A benchmark is a function that returns a `Report`. It makes one job for each method of a case (a job is a function
without arguments), times all jobs with `time_interleaved`, and adds columns of its own to `Row.extra_columns`.
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
"""A call that is timed; it returns what the method computes."""

_NAMES_OF_PACKAGES_WITH_REPORTED_VERSION = (
    "hingepair",
    "numpy",
    "llvmlite",
    "pin",
    "mujoco",
    "scipy",
    "jax",
)  # their versions are shown
_MIN_SECONDS_OF_ALL_CALLS_OF_A_JOB_IN_A_REPEAT = 2e-3  # [s]; a faster job is called several times in each repeat
_MAX_SECONDS_OF_JOBS_WARMED_UP_BEFORE_EACH_REPEAT = (
    0.1  # [s]; a faster job is called once untimed before each repeat, which fills the caches
)
_OTHER_THREADS_IDLE_POLL_INTERVAL_SECONDS = 1e-3  # [s] between two polls of the states of the other threads
# Successive polls that must find all other threads idle before a job is timed.
_NUM_SUCCESSIVE_IDLE_POLLS_BEFORE_A_JOB_IS_TIMED = 5
# Polls after which a job is timed although other threads are busy.
_MAX_OTHER_THREADS_IDLE_POLLS_BEFORE_A_JOB_IS_TIMED = 10_000
_SECONDS_BY_TIME_UNIT = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}  # [s], the largest first


class Method(NamedTuple):
    """A method under test: its name, the function `make_job` from a task to a job (a function without arguments that
    is timed), the smallest batch for which it is measured, the largest number of samples that it computes of a batch,
    the package that it needs, and whether the picture shows it.
    """

    name: str
    # Returns the job of a task. Whatever can be set up once is set up before the job is timed; the results that a
    # user would read out of an engine are read out inside the job.
    make_job: Callable[[Any], Job]
    min_samples: int = 1  # smallest batch for which the method is measured
    max_samples: int = 10**7  # of a larger batch the method computes only the first samples
    package: str = ""  # the package that must be installed; "" for none
    in_picture: bool = True  # whether the picture shows the method


def available_methods(
    methods: Iterable[Method], exclusion_reasons: Mapping[str, str | None]
) -> tuple[list[Method], list[str]]:
    """Return a list of the methods that can be measured, and a list of notes, one for each other method, that say why
    it is left out. A method cannot be measured if its package is not installed, or if `exclusion_reasons`, a mapping
    from names of methods to strings or None, holds a reason.

    Args:
        methods: all methods.
        exclusion_reasons: why a method cannot be measured, by its name; None for no reason. A missing package is
            detected here.
    """
    available, missing = [], []
    for method in methods:
        absent = (
            f"{method.package} is not installed" if method.package and find_spec(method.package) is None else None
        )
        if reason := absent or exclusion_reasons.get(method.name):
            missing.append(f"left out: {method.name} ({reason})")
        else:
            available.append(method)
    return available, missing


@dataclass(frozen=True, slots=True)
class Row:
    """A row of a report's table: run times and error of one method on one case. The fields are case, method, the
    number of samples, median and minimum time of a call [s], the time per sample divided by the first method's, the
    error, and a mapping of further values by column heading.
    """

    case: str  # what all methods of the case compute
    method: str  # name of the method
    count: int  # samples or steps of a call
    seconds: float  # of a call, the median of the repeats
    min_seconds: float  # of a call, the minimum of the repeats
    # Time for a sample divided by that of the first method of the case: the median of the ratios within one repeat.
    ratio: float
    # Largest error; infinite if a result is not finite, None if there is nothing to compare with.
    error: float | None = None
    # Values of the further columns of one benchmark, by heading.
    extra_columns: Mapping[str, Any] = field(default_factory=dict)

    @property
    def seconds_per_sample(self) -> float:
        """Return the time for one sample or step [s]."""
        return self.seconds / self.count


class Report(NamedTuple):
    """The result of a benchmark: the rows of its table, the heading of the errors, the notes below the table, and the
    rows of panels of its picture.
    """

    rows: Sequence[Row]  # the rows of a case stand together
    error_label: str = ""  # heading of the column of errors, with their unit
    notes: Sequence[str] = ()  # sentences below the table, which explain its columns
    panels: Sequence[Sequence[Panel]] = ()  # of the picture, row by row

    def table(self, width: int | None = None) -> list[str]:
        """Return the table as a list of lines of text, of at most `width` characters each, with a block of rows for
        each case. The first and the last line are empty.

        Args:
            width: of a line [characters]; None for lines of any length.
        """
        columns = list(dict.fromkeys(key for row in self.rows for key in row.extra_columns))
        errors = [self.error_label] if any(row.error is not None for row in self.rows) else []
        heading = ("", "N", "a call", "each", "ratio", *errors, *columns)
        lines: list[Sequence[str]] = [heading]
        for i, row in enumerate(self.rows):
            if i == 0 or self.rows[i - 1].case != row.case:
                lines += [()] if i else []
                lines.append((row.case, *[""] * (len(heading) - 1)))
            cells = [
                f"{row.count:,}",
                format_duration(row.seconds),
                format_duration(row.seconds_per_sample),
                format_number(row.ratio),
            ]
            further_values = (*([row.error] if errors else []), *map(row.extra_columns.get, columns))
            cells += [_format_cell(value) for value in further_values]
            lines.append((f"  {row.method}", *cells))
        return ["", *ruled_table(lines, 1, width), ""]

    def to_json(self) -> str:
        """Return the machine, the rows and the notes as JSON text; a number that is not finite becomes null."""
        return json_text({"facts": machine_facts(), "rows": [asdict(row) for row in self.rows], "notes": self.notes})


def measure_methods(
    case: str,
    methods: Iterable[Method],
    make_task: Callable[[int], Any],
    size: int,
    repeats: int,
    errors: Mapping[str, float] | None = None,
    extra_columns: Mapping[str, Mapping[str, Any]] | None = None,
) -> list[Row]:
    """Measure the run times of the methods for a batch of `size` samples, `repeats` times in alternation; return a
    list of the table rows of the case. A method is left out if `size` is below its `min_samples`, and computes at
    most its `max_samples`. `make_task` is a function from a number of samples to a task. `errors` maps names of
    methods to errors, and `extra_columns` maps them to mappings of further values by column heading; both may be
    None.

    Args:
        case: name of the case.
        methods: all methods; those whose `min_samples` exceed the size are left out.
        make_task: returns the task of a number of samples.
        size: samples of the batch; a method gets `max_samples` of them at most.
        repeats: of each measurement.
        errors: largest errors, by the method's name.
        extra_columns: further columns, by the method's name and the column's heading.
    """
    sample_counts = {method: min(size, method.max_samples) for method in methods if method.min_samples <= size}
    jobs = {method.name: method.make_job(make_task(count)) for method, count in sample_counts.items()}
    counts = {method.name: count for method, count in sample_counts.items()}
    return make_rows(case, time_interleaved(jobs, repeats), counts, errors, extra_columns)


def make_rows(
    case: str,
    repeat_seconds: Mapping[str, Sequence[float]],
    sample_counts: int | Mapping[str, int] = 1,
    errors: Mapping[str, float] | None = None,
    extra_columns: Mapping[str, Mapping[str, Any]] | None = None,
) -> list[Row]:
    """Return a list of the table rows of a case, computed from `repeat_seconds`, which maps each method's name to the
    run times [s] of a call, one for each repeat. Ratios refer to the first method. `sample_counts` is the number of
    samples of a call, or a mapping of these numbers by the method's name. `errors` maps names of methods to errors,
    and `extra_columns` maps them to mappings of further values by column heading; both may be None.

    Args:
        case: name of the case.
        repeat_seconds: time of a call in each repeat [s], by the method's name; ratios refer to the first method.
        sample_counts: samples of a call: one number, or numbers by the method's name.
        errors: largest errors, by the method's name.
        extra_columns: further columns, by the method's name and the column's heading.
    """
    if isinstance(sample_counts, int):
        sample_counts = dict.fromkeys(repeat_seconds, sample_counts)
    first, rows = next(iter(repeat_seconds), ""), []
    for name, seconds in repeat_seconds.items():
        scale = sample_counts[first] / sample_counts[name]
        ratio = median(scale * t / base for t, base in zip(seconds, repeat_seconds[first], strict=True))
        extra = (errors or {}).get(name), (extra_columns or {}).get(name, {})
        rows.append(Row(case, name, sample_counts[name], median(seconds), min(seconds), ratio, *extra))
    return rows


def time_interleaved(jobs: Mapping[str, Job], repeats: int) -> dict[str, list[float]]:
    """Call all jobs in turn, `repeats` times; return a dict from a job's name to a list of run times of one call [s],
    one for each repeat. `jobs` maps names to functions without arguments. Before a job is timed, wait until other
    threads are idle. Each job is also called without being timed, and a short job is called several times in a
    repeat.

    Every repeat runs all jobs, one after the other, so that disturbances affect all of them alike. Before a job is
    timed, the other threads of the process must be idle: JAX frees its memory after a call has returned, which delays
    new arrays of the next job. A short job is then called once untimed, so that the caches hold its own data and not
    those of the job before.
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
            if once[name] < _MAX_SECONDS_OF_JOBS_WARMED_UP_BEFORE_EACH_REPEAT:
                job()
            calls = max(1, int(_MIN_SECONDS_OF_ALL_CALLS_OF_A_JOB_IN_A_REPEAT / max(once[name], 1e-9)))
            times[name].append(timeit(job, number=calls) / calls)
    return times


def wait_for_other_threads() -> None:
    """Wait until no other thread of this process runs or waits for a memory page, but not longer than about ten
    seconds. Only Linux is supported; on other systems, return at once.

    Only Linux shows the states of threads; elsewhere the function returns at once.
    """
    idle_polls = 0
    for _ in range(_MAX_OTHER_THREADS_IDLE_POLLS_BEFORE_A_JOB_IS_TIMED):
        idle_polls = 0 if _other_threads_run() else idle_polls + 1
        if idle_polls == _NUM_SUCCESSIVE_IDLE_POLLS_BEFORE_A_JOB_IS_TIMED:
            return
        time.sleep(_OTHER_THREADS_IDLE_POLL_INTERVAL_SECONDS)


def _other_threads_run() -> bool:
    """Return whether Linux lists another thread of this process as running (R) or waiting uninterruptibly (D)."""
    for path in Path("/proc/self/task").glob("[0-9]*/stat"):
        if int(path.parent.name) != threading.get_native_id():
            with suppress(OSError):  # the thread has ended
                if path.read_text().rpartition(")")[2].split()[0] in "RD":
                    return True
    return False


def _format_cell(value: Any) -> str:
    return "-" if value is None else f"{value:.2g}" if isinstance(value, float) else str(value)


def format_number(number: float) -> str:
    """Return a number as text with three significant digits, or, if it is at least 100, as a rounded integer with
    commas between thousands.

    >>> format_number(1234.5), format_number(0.0123456)
    ('1,234', '0.0123')
    """
    return f"{number:,.0f}" if number >= 100 else f"{number:.3g}"


def format_duration(seconds: float) -> str:
    """Return a duration in seconds as text, in the largest of the units s, ms, us and ns in which it is at least 1. A
    shorter duration is in ns.

    >>> format_duration(1.234e-8), format_duration(0.25)
    ('12.3 ns', '250 ms')
    """
    unit = next((unit for unit, size in _SECONDS_BY_TIME_UNIT.items() if seconds >= size), "ns")
    return f"{format_number(seconds / _SECONDS_BY_TIME_UNIT[unit])} {unit}"


def case_name(description: str, size: int) -> str:
    """Return the name of a case as text, such as "pose, N = 1,000": the description of what is computed, and the
    number of samples.
    """
    return f"{description}, N = {size:,}"


def machine_facts() -> dict[str, Any]:
    """Return a dict of facts to print with a measurement, by name: the processor, the machine type, the number of
    cores, the system, and the versions of Python and of packages. Packages that are not installed are left out.
    """
    processor = platform.processor()
    with suppress(OSError, StopIteration), open("/proc/cpuinfo", encoding="utf-8") as lines:
        processor = next(line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    facts = {"processor": processor, "machine": platform.machine(), "cores": os.cpu_count()}
    facts |= {"system": platform.system(), "python": platform.python_version()}
    for name in _NAMES_OF_PACKAGES_WITH_REPORTED_VERSION:
        with suppress(PackageNotFoundError):
            facts[name] = version(name)
    return facts


def print_progress(text: str) -> None:
    """Print a line about the progress of a benchmark to standard error."""
    print(text, file=sys.stderr, flush=True)
