"""Methods, the times of their jobs, and the table or JSON of a comparison."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib.util import find_spec
from statistics import median
from timeit import timeit
from typing import Any, NamedTuple, TypeAlias

from hingepair.tables.sheets import ruled_table

Job: TypeAlias = Callable[[], tuple[Any, ...]]
"""A call that is timed; it returns what the method computes, as arrays with a row for each sample."""

HINGEPAIR = "hingepair"


class Method(NamedTuple):
    """A way to compute what a case asks for."""

    name: str
    make_job: Callable[[Any], Job]  # of a task; what a user sets up once is set up here and not timed
    max_samples: int = 10**7  # of a larger batch it computes the first samples only
    min_samples: int = 1
    package: str = ""  # that must be installed


class Case(NamedTuple):
    """Jobs that compute the same, by the names of their methods; ratios are to the first."""

    name: str
    jobs: Mapping[str, Job]
    samples: Mapping[str, int]  # of a call
    columns: Mapping[str, Mapping[str, Any]]  # further values, by method and heading


def batch_case(
    name: str,
    methods: Iterable[Method],
    make_task: Callable[[int], Any],
    samples: int,
    columns: Mapping[str, Mapping[str, Any]],
) -> Case:
    """Return the case of a batch; `make_task(n)` makes the task of the first n samples."""
    counts = {method: min(samples, method.max_samples) for method in methods if method.min_samples <= samples}
    jobs = {method.name: method.make_job(make_task(count)) for method, count in counts.items()}
    by_name = {method.name: count for method, count in counts.items()}
    return Case(f"{name}, N = {samples:,}", jobs, by_name, columns)


def parser(description: str, names: str) -> argparse.ArgumentParser:
    """Return the parser of the options that all benchmarks have."""
    options = argparse.ArgumentParser(description=description)
    options.add_argument("--names", default=names, help="robots of example-robot-data, separated by commas")
    options.add_argument("--repeats", type=int, default=5, help="of each measurement; medians are shown")
    options.add_argument("--cpp", action="store_true", help="compile Pinocchio's loop in C++, too (a minute or two)")
    options.add_argument("--json", action="store_true", help="print JSON")
    return options


def able(methods: Iterable[Method], *, cpp: bool) -> list[Method]:
    """Return the methods whose package is installed; those in C++ only on request."""
    found = []
    for method in methods:
        if method.package and find_spec(method.package) is None:
            print(f"left out: {method.name} ({method.package} is not installed)", file=sys.stderr)
        elif cpp or "C++" not in method.name:
            found.append(method)
    return found


def run(cases: Iterable[Case], repeats: int, as_json: bool) -> None:
    """Time all jobs of each case, and print rows."""
    rows = [row for case in cases for row in _measure(case, repeats)]
    print(json.dumps(rows, indent=1) if as_json else "\n".join(_table(rows)))


def _measure(case: Case, repeats: int) -> list[dict[str, Any]]:
    """Call all jobs in turn, `repeats` times, so that disturbances meet all alike."""
    print(case.name, file=sys.stderr, flush=True)
    for job in case.jobs.values():
        job()
    once = {name: timeit(job, number=1) for name, job in case.jobs.items()}
    times: dict[str, list[float]] = {name: [] for name in case.jobs}
    for _ in range(repeats):
        for name, job in case.jobs.items():
            calls = max(1, int(2e-3 / once[name]))  # of a fast job, so that they take 2 ms
            times[name].append(timeit(job, number=calls) / calls / case.samples[name])
    first = next(iter(times.values()))
    ratios = {name: median(t / base for t, base in zip(own, first, strict=True)) for name, own in times.items()}
    return [
        {"case": case.name, "method": name, "N": case.samples[name], "each [ns]": 1e9 * median(own)}
        | {"ratio": ratios[name]}
        | dict(case.columns.get(name, {}))
        for name, own in times.items()
    ]


def _table(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return the lines of a table, a block for each case."""
    headings = [key for key in dict.fromkeys(key for row in rows for key in row) if key != "case"]
    lines: list[list[str]] = [headings]
    for before, row in zip([{}, *rows], rows, strict=False):
        if row["case"] != before.get("case"):
            lines += [[]] if before else []
            lines.append([row["case"], *[""] * (len(headings) - 1)])
        cells = [row.get(key, "") for key in headings]
        lines.append([f"{cell:.3g}" if isinstance(cell, float) else str(cell) for cell in cells])
    return ruled_table(lines)
