"""`hingepair bench direct|skip|integrate`."""

from __future__ import annotations

import json
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich import box
from rich.console import Console
from rich.table import Table

from hingepair.bench.cold import Start, cold_starts
from hingepair.bench.contenders import contenders
from hingepair.bench.memory import Peak, peaks
from hingepair.bench.methods import LEVELS
from hingepair.bench.plot import figure_type
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import check_choice

MILLION = 1_000_000

app = typer.Typer(help="Measure run time and error on this machine.", no_args_is_help=True)

Json = Annotated[bool, typer.Option("--json", help="Print JSON with machine facts instead of a table.")]
Repeats = Annotated[int, typer.Option(min=1, max=1000, help="Repeats; the median counts.")]


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


@app.command()
def direct(
    sizes: Annotated[str, typer.Option(help="Numbers of samples.")] = "1,100,10000,1000000",
    levels: Annotated[str, typer.Option(help="Workloads.")] = ",".join(LEVELS),
    repeats: Repeats = 5,
    cpp: Annotated[
        bool, typer.Option("--cpp", help="Compile and measure Pinocchio's C++ loop (compiling takes up to a minute).")
    ] = False,
    cold: Annotated[
        bool, typer.Option("--cold", help="Measure imports and first calls too, in fresh processes (a minute).")
    ] = False,
    memory: Annotated[
        bool, typer.Option("--memory", help="Measure the peak memory of a million samples too (half a minute).")
    ] = False,
    as_json: Json = False,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Draw error against run time.")] = None,
) -> None:
    """Run time against error: this library, Pinocchio, MuJoCo, JAX, SciPy, NumPy, SymPy, in one run."""
    from hingepair.bench import direct as bench

    if plot is not None:
        figure_type()
    counts = [_count(part) for part in sizes.split(",")]
    chosen = [level.strip() for level in levels.split(",")]
    for level in chosen:
        check_choice("levels", level, tuple(LEVELS))
    if cpp:
        _tell("compiling Pinocchio's C++ loop (up to a minute)")
    methods, left_out = contenders(cpp)
    rows = bench.direct(methods, counts, chosen, repeats, _tell)
    starts = cold_starts(repeats, _tell) if cold else []
    found = peaks(MILLION, _tell) if memory else []
    if plot is not None:
        bench.plot(rows, str(plot))
        _tell(f"written: {plot}")
    if as_json:
        more = {"cold": [asdict(start) for start in starts], "memory": [asdict(peak) for peak in found]}
        print(json.dumps(bench.as_json(rows, left_out) | more, indent=2))
        return
    console = Console(highlight=False, markup=False, width=120)
    console.print(bench.table(rows))
    for line in left_out:
        console.print(f"left out: {line}")
    console.print(", ".join(f"{key} {value}" for key, value in bench.facts().items()))
    console.print(
        "ratio: against the first method at the same workload; random, hard: largest error of any output against 50 "
        "digits on such states, in units of u*scale (inf: refuses one, or has no finite result where there is one); "
        "Python loops up to N = 10,000"
    )
    if starts:
        console.print(_starts(starts))
    if found:
        console.print(_peaks(found))


@app.command()
def skip(
    samples: Annotated[int, typer.Option(min=1, max=10**7, help="Samples.")] = 1_000_000,
    repeats: Repeats = 7,
    as_json: Json = False,
) -> None:
    """What it is worth to leave out what a scene does not need."""
    from hingepair.bench import direct as bench
    from hingepair.bench.skip import skips

    rows = skips(samples, repeats, _tell)
    if as_json:
        print(json.dumps({"facts": bench.facts(), "rows": [asdict(row) for row in rows]}, indent=2))
        return
    table = Table("skipped", "backend", "full ns/sample", "skipped ns/sample", "ratio", box=box.SIMPLE_HEAD)
    for row in rows:
        table.add_row(row.skipped, row.backend, f"{row.full_ns:.3g}", f"{row.skip_ns:.3g}", f"{row.ratio:.2f}")
    Console(highlight=False, markup=False, width=120).print(table)


@app.command()
def integrate(
    repeats: Repeats = 5,
    long: Annotated[
        int, typer.Option(min=0, max=10**8, help="Steps of a long run as well, such as 10000000; 0 for none.")
    ] = 0,
    as_json: Json = False,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Draw error against step and time.")] = None,
) -> None:
    """Error against step and run time: attitudes from angular velocity by all methods, and by SciPy's solvers."""
    from hingepair.bench import direct as bench
    from hingepair.bench import integrate as bench_integrate
    from hingepair.bench.spins import installed, ways

    if plot is not None:
        figure_type()
    rows = bench_integrate.measure(repeats, _tell)
    runs = bench_integrate.long_runs(long, _tell) if long else []
    if plot is not None:
        from hingepair.bench.integrate_plot import draw

        draw(rows, str(plot))
        _tell(f"written: {plot}")
    if as_json:
        print(json.dumps(bench_integrate.as_json(rows, runs), indent=2))
        return
    console = Console(highlight=False, markup=False, width=120)
    console.print(bench_integrate.table(rows))
    console.print(bench_integrate.goal_table(rows))
    for run in runs:
        console.print(
            f"{run.spin}, {run.steps:,} steps of magnus6: error {run.error:.2g} rad, S^T S - I up to "
            f"{run.orthonormality:.2g} u, {run.ns_per_step:.3g} ns a step (omega included)"
        )
    for way in ways():
        if not installed(way):
            console.print(f"left out: {way.name} ({way.needs} is not installed)")
    console.print(", ".join(f"{key} {value}" for key, value in bench.facts().items()))


def _starts(starts: list[Start]) -> Table:
    table = Table("a fresh process, files in memory", "seconds", "smallest", box=box.SIMPLE_HEAD)
    for start in starts:
        table.add_row(start.what, f"{start.median_s:.3g}", f"{start.min_s:.3g}")
    return table


def _peaks(found: list[Peak]) -> Table:
    table = Table("peak memory", "workers", "level", "N", "arrays [MB]", "beyond them [MB]", box=box.SIMPLE_HEAD)
    for peak in found:
        sizes = f"{peak.arrays_mb:.0f}", f"{peak.extra_mb:.1f}"
        table.add_row(peak.backend, str(peak.workers), peak.level, f"{peak.samples:,}", *sizes)
    return table


def _count(text: str) -> int:
    try:
        count = int(text)
    except ValueError:
        count = 0
    if not 1 <= count <= 10**7:
        raise ArgumentError("sizes", "integers from 1 to 10000000, separated by commas", quoted(text))
    return count
