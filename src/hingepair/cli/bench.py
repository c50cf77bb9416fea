"""`hingepair bench ...`: a command for each bench, and one way to report what it measured."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import check_choice

if TYPE_CHECKING:
    from hingepair.bench.measure import Row, Target
    from hingepair.bench.plot import Panel

app = typer.Typer(help="Measure run time and error on this machine.", no_args_is_help=True)

Json = Annotated[bool, typer.Option("--json", help="Print JSON with machine facts instead of tables.")]
Repeats = Annotated[int, typer.Option(min=1, max=1000, help="Repeats; the median counts.")]
Plot = Annotated[Path | None, typer.Option(metavar="FILE", help="Draw error against run time (.png, .svg, .pdf).")]


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def _report(
    rows: Sequence[Row],
    unit: str,
    show_json: bool,
    notes: Sequence[str] = (),
    targets: Sequence[Target] = (),
    picture: tuple[Path | None, Sequence[Sequence[Panel]]] = (None, ()),
) -> None:
    """Draw, then print: rows, targets, notes and the machine."""
    from rich.console import Console

    from hingepair.bench.measure import as_json, digits, empty_table, facts, finite, table
    from hingepair.bench.plot import draw

    path, panels = picture
    if path is not None:
        draw(panels, path)
        _tell(f"written: {path}")
    if show_json:
        aimed = [finite(asdict(target) | {"ok": target.ok}) for target in targets]
        print(json.dumps({"facts": facts(), "rows": as_json(rows), "targets": aimed, "notes": list(notes)}, indent=2))
        return
    console = Console(highlight=False, markup=False, width=120)
    console.print(table(rows, unit))
    if targets:
        found = empty_table("aimed at, on the reference machine", right=("target", "reached", "", ""))
        for target in targets:
            sign = ">=" if target.least else "<="
            verdict = "ok" if target.ok else "missed"
            found.add_row(target.what, f"{sign} {target.target:g}", digits(target.reached), target.unit, verdict)
        console.print(found)
    for line in (*notes, ", ".join(f"{key} {value}" for key, value in facts().items())):
        console.print(line)


@app.command()
def direct(
    sizes: Annotated[str, typer.Option(help="Numbers of samples.")] = "1,100,10000,1000000",
    levels: Annotated[str, typer.Option(help="Workloads.")] = "pose,velocity,acceleration",
    repeats: Repeats = 7,
    cpp: Annotated[
        bool, typer.Option("--cpp", help="Compile and measure Pinocchio's C++ loop (compiling takes up to a minute).")
    ] = False,
    cold: Annotated[
        bool, typer.Option("--cold/--no-cold", help="Imports and first calls too, in fresh processes.")
    ] = True,
    show_json: Json = False,
    plot: Plot = None,
) -> None:
    """Run time against error: this library, Pinocchio, MuJoCo, JAX, SciPy, NumPy, in one run."""
    from hingepair.bench import direct as bench
    from hingepair.bench import peers, truth
    from hingepair.bench.plot import check_picture

    counts = [_count(part) for part in sizes.split(",")]
    chosen = [level.strip() for level in levels.split(",")]
    for level in chosen:
        check_choice("levels", level, tuple(peers.LEVELS))
    if plot is not None:
        check_picture(plot)
    if cpp:
        _tell("compiling Pinocchio's C++ loop (up to a minute)")
    ways, left_out = peers.ways(cpp)
    rows = bench.direct(ways, counts, chosen, repeats, _tell) + bench.singles(repeats, _tell)
    rows += bench.starts(repeats, _tell) if cold else []
    notes = [
        *(f"left out: {line}" for line in left_out),
        "a call, each: medians, kernels compiled before; ratio: of a sample's time, against the first way of a case; "
        f"errors: largest of any output against {truth.DIGITS} digits [u * scale], on random and on hard states; "
        "inf: refuses one, or has no finite result where there is one",
    ]
    _report(rows, bench.ERROR, show_json, notes, bench.targets(rows), (plot, [bench.panels(rows)]))


def _count(text: str) -> int:
    try:
        count = int(text)
    except ValueError:
        count = 0
    if not 1 <= count <= 10**7:
        raise ArgumentError("sizes", "integers from 1 to 10000000, separated by commas", quoted(text))
    return count


@app.command()
def integrate(
    repeats: Repeats = 5,
    steps: Annotated[
        int, typer.Option(min=0, max=10**8, help="Steps of a long run as well; 0 for none.")
    ] = 1_000_000,
    show_json: Json = False,
    plot: Plot = None,
) -> None:
    """Error against step and run time: attitudes from angular velocity by all methods, and by SciPy's solvers."""
    from hingepair.bench import integrate as bench
    from hingepair.bench.plot import check_picture

    if plot is not None:
        check_picture(plot)
    rows = bench.integrate(repeats, _tell)
    more = bench.goals(rows) + (bench.long_run(steps, min(repeats, 3), _tell) if steps else [])
    notes = ["left out: finenesses at which a method stops at gimbal lock"]
    _report([*rows, *more], bench.ERROR, show_json, notes, bench.targets(more), (plot, bench.panels(rows)))


@app.command()
def fit(
    sizes: Annotated[str, typer.Option(help="Numbers of samples.")] = "1000,10000,1000000",
    repeats: Repeats = 5,
    show_json: Json = False,
) -> None:
    """The hinge from recordings: time and error, beside SciPy's least_squares on the constraints as they are."""
    from hingepair.bench import fit as bench

    rows = bench.fit([_count(part) for part in sizes.split(",")], repeats, _tell)
    notes = ["error: largest of the axes and, across them, of the hinge point; root mean square of 5 recordings"]
    _report(rows, bench.ERROR, show_json, notes, bench.targets(rows))


@app.command()
def skip(
    samples: Annotated[int, typer.Option(min=1, max=10**7, help="Samples.")] = 1_000_000,
    repeats: Repeats = 7,
    show_json: Json = False,
) -> None:
    """What it is worth to leave out what a scene does not need."""
    from hingepair.bench.skip import skip as bench

    _report(bench(samples, ("compiled", "numpy"), repeats, _tell), "", show_json)
