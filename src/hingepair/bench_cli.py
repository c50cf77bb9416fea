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

from hingepair.arrays import check_choice
from hingepair.bench_methods import LEVELS, METHODS, installed
from hingepair.errors import ArgumentError

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
    as_json: Json = False,
    plot: Annotated[Path | None, typer.Option(metavar="FILE.png", help="Draw error against run time.")] = None,
) -> None:
    """Run time against error: this library, Pinocchio, SciPy, NumPy, SymPy, in one run."""
    from hingepair import bench

    counts = [_count(part) for part in sizes.split(",")]
    chosen = [level.strip() for level in levels.split(",")]
    for level in chosen:
        check_choice("levels", level, tuple(LEVELS))
    rows = bench.direct(counts, chosen, repeats, _tell)
    if plot is not None:
        bench.plot(rows, str(plot))
        _tell(f"written: {plot}")
    if as_json:
        print(json.dumps(bench.as_json(rows), indent=2))
        return
    console = Console(highlight=False, markup=False, width=120)
    console.print(bench.table(rows))
    for method in METHODS:
        if not installed(method):
            console.print(f"left out: {method.name} ({method.needs} is not installed)")
    console.print(", ".join(f"{key} {value}" for key, value in bench.facts().items()))
    console.print(
        "ratio: against the first method at the same workload; error: against 50 digits; loops up to N = 10,000"
    )


@app.command()
def skip(
    samples: Annotated[int, typer.Option(min=1, max=10**7, help="Samples.")] = 1_000_000,
    repeats: Repeats = 7,
    as_json: Json = False,
) -> None:
    """What it is worth to leave out what a scene does not need."""
    from hingepair import bench
    from hingepair.bench_skip import skips

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
    from hingepair import bench, bench_integrate
    from hingepair.bench_spins import installed, ways

    rows = bench_integrate.measure(repeats, _tell)
    runs = bench_integrate.long_runs(long, _tell) if long else []
    if plot is not None:
        from hingepair.bench_integrate_plot import draw

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


def _count(text: str) -> int:
    try:
        count = int(text)
    except ValueError:
        count = 0
    if not 1 <= count <= 10**7:
        raise ArgumentError("sizes", "integers from 1 to 10000000, separated by commas", text)
    return count
