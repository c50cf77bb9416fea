"""`hingepair bench ...`: a command for each bench, and one way to report what it measured."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hingepair.cli.options import naming_options
from hingepair.cli.output import console, line_width
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import check_choice

if TYPE_CHECKING:
    from hingepair.bench.measure import Report

app = typer.Typer(help="Measure run time and error on this machine.", no_args_is_help=True)

Json = Annotated[bool, typer.Option("--json", help="Print JSON with machine facts instead of tables.")]
Cpp = Annotated[
    bool, typer.Option("--cpp", help="Compile and measure Pinocchio's C++ loop (compiling takes one or two minutes).")
]
Repeats = Annotated[int, typer.Option(min=1, max=1000, help="Repeats; the median counts.")]
Plot = Annotated[Path | None, typer.Option(metavar="FILE", help="Draw error against run time (.png, .svg, .pdf).")]
Sizes = Annotated[str, typer.Option(help="Numbers of samples.")]


def _report(found: Report, show_json: bool, plot: Path | None = None) -> None:
    """Print rows, targets, notes and the machine, and draw them where a file is named."""
    from hingepair.bench.measure import facts, tell
    from hingepair.bench.plot import draw

    if plot is not None:
        draw(found.panels, plot)
        tell(f"written: {plot}")
    if show_json:
        print(found.to_json())
        return
    screen = console()
    machine = ", ".join(f"{key} {value}" for key, value in facts().items())
    for line in (*found.tables(line_width(screen)), *found.notes, machine):
        screen.print(line)


def _counts(sizes: str) -> list[int]:
    counts = [int(part) if part.strip().isdecimal() else 0 for part in sizes.split(",")]
    if not all(1 <= count <= 10**7 for count in counts):
        raise ArgumentError("sizes", "integers from 1 to 10000000, separated by commas", quoted(sizes))
    return counts


@app.command()
@naming_options
def direct(
    sizes: Sizes = "1,100,10000,1000000",
    levels: Annotated[str, typer.Option(help="Workloads.")] = "pose,velocity,acceleration",
    repeats: Repeats = 7,
    cpp: Cpp = False,
    cold: Annotated[
        bool, typer.Option("--cold/--no-cold", help="Imports and first calls too, in fresh processes.")
    ] = True,
    show_json: Json = False,
    plot: Plot = None,
) -> None:
    """Run time against error: this library, Pinocchio, MuJoCo, JAX, SciPy, NumPy, in one run."""
    from hingepair.bench import direct as bench
    from hingepair.bench.peers import LEVELS
    from hingepair.bench.plot import check_picture

    counts, chosen = _counts(sizes), [level.strip() for level in levels.split(",")]
    for level in chosen:
        check_choice("levels", level, tuple(LEVELS))
    check_picture(plot)
    _report(bench.direct(counts, chosen, repeats, cpp, cold), show_json, plot)


@app.command()
@naming_options
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

    check_picture(plot)
    _report(bench.integrate(repeats, steps), show_json, plot)


@app.command()
@naming_options
def fit(sizes: Sizes = "1000,10000,1000000", repeats: Repeats = 5, show_json: Json = False) -> None:
    """The hinge from recordings: time and error, beside SciPy's least_squares on the constraints as they are."""
    from hingepair.bench import fit as bench

    _report(bench.fit(_counts(sizes), repeats), show_json)


@app.command()
@naming_options
def skip(
    samples: Annotated[int, typer.Option(min=1, max=10**7, help="Samples.")] = 1_000_000,
    repeats: Repeats = 7,
    show_json: Json = False,
) -> None:
    """What it is worth to leave out what a scene does not need."""
    from hingepair.bench import skip as bench

    _report(bench.skip(samples, repeats), show_json)


@app.command()
@naming_options
def dynamics(
    samples: Annotated[int, typer.Option(min=2, max=10**7, help="Samples of a batch.")] = 1_000_000,
    repeats: Repeats = 5,
    cpp: Cpp = False,
    show_json: Json = False,
) -> None:
    """Forces from motion, motion from forces, and a simulation: beside Pinocchio, MuJoCo and SciPy."""
    from hingepair.bench import dynamics as bench

    _report(bench.dynamics(samples, repeats, cpp), show_json)


@app.command()
@naming_options
def robots(
    names: Annotated[
        str, typer.Option(help="Robots of example-robot-data.")
    ] = "ur5_robot,panda,solo12,talos_reduced",
    sizes: Sizes = "1,100,100000",
    repeats: Repeats = 5,
    cpp: Cpp = False,
    show_json: Json = False,
    plot: Plot = None,
) -> None:
    """Poses, Jacobians and dynamics of whole robots: beside Pinocchio, its own batches, MuJoCo and frax (JAX)."""
    from hingepair.bench import robots as bench
    from hingepair.bench.plot import check_picture

    check_picture(plot)
    chosen = [name.strip() for name in names.split(",")]
    _report(bench.robots(chosen, _counts(sizes), repeats, cpp), show_json, plot)
