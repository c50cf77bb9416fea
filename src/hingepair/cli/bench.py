"""`hingepair bench ...`: a command for each bench, and one way to report what it measured."""

from __future__ import annotations

import contextlib
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from hingepair.cli.options import naming_options
from hingepair.cli.output import check_picture, console, line_width
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import check_choice
from hingepair.numeric.whole_file import whole_file

if TYPE_CHECKING:
    from hingepair.bench.measure import Report

app = typer.Typer(help="Measure run time and error on this machine.", no_args_is_help=True)

_NOTE_WIDTH: Final = 100  # characters of a line below the table

Json = Annotated[bool, typer.Option("--json", help="Print JSON with machine facts instead of tables.")]
Cpp = Annotated[
    bool, typer.Option("--cpp", help="Compile and measure Pinocchio's C++ loop (compiling takes one or two minutes).")
]
Repeats = Annotated[int, typer.Option(min=1, max=1000, help="Repeats; the median counts.")]
Plot = Annotated[Path | None, typer.Option(metavar="FILE", help="Draw error against run time (.png, .svg, .pdf).")]
Sizes = Annotated[str, typer.Option(help="Numbers of samples.")]


def _report(measure: Callable[[], Report], show_json: bool, plot: Path | None = None) -> None:
    """Measure, print rows, notes and the machine, and draw them where a file is named.

    The file is opened before, so that no minutes of measuring end in a picture that cannot be written.
    """
    from hingepair.bench.measure import machine_facts, print_progress

    with contextlib.ExitStack() as opened:
        draw = None if plot is None else opened.enter_context(_picture(plot))
        found = measure()
        if draw is not None:
            draw(found)
            print_progress(f"written: {plot}")
    if show_json:
        print(found.to_json())
        return
    screen = console()
    machine = ", ".join(f"{key} {value}" for key, value in machine_facts().items())
    for line in found.table(line_width(screen)):
        screen.print(line)
    for sentence in (*found.notes, machine):
        for line in textwrap.wrap(sentence, _NOTE_WIDTH):
            screen.print(line)


@contextlib.contextmanager
def _picture(path: Path) -> Iterator[Callable[[Report], None]]:
    """Open the file of a picture; return what draws a report into it."""
    from hingepair.bench.plot import new_figure, write_picture

    check_picture("--plot", path)
    new_figure((1, 1))  # refused where Matplotlib is not installed
    with contextlib.ExitStack() as opened:
        try:
            file = opened.enter_context(whole_file(path))
        except ArgumentError as error:
            raise ArgumentError("--plot", error.expected, error.got) from None
        yield lambda report: write_picture(report.panels, file, path.suffix.lower()[1:])


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
    from hingepair.bench.peers import LEVEL_OUTPUTS

    counts, chosen = _counts(sizes), [level.strip() for level in levels.split(",")]
    for level in chosen:
        check_choice("levels", level, tuple(LEVEL_OUTPUTS))
    _report(lambda: bench.measure_kinematics(counts, chosen, repeats, cpp, cold), show_json, plot)


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

    _report(lambda: bench.measure_integration(repeats, steps), show_json, plot)


@app.command()
@naming_options
def fit(sizes: Sizes = "1000,10000,1000000", repeats: Repeats = 5, show_json: Json = False) -> None:
    """The hinge from recordings: time and error, beside SciPy's least_squares on the constraints as they are."""
    from hingepair.bench import fit as bench

    _report(lambda: bench.measure_fits(_counts(sizes), repeats), show_json)


@app.command()
@naming_options
def skip(
    samples: Annotated[int, typer.Option(min=1, max=10**7, help="Samples.")] = 1_000_000,
    repeats: Repeats = 7,
    show_json: Json = False,
) -> None:
    """What it is worth to leave out what a scene does not need."""
    from hingepair.bench import skip as bench

    _report(lambda: bench.measure_folding(samples, repeats), show_json)


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

    _report(lambda: bench.measure_dynamics(samples, repeats, cpp), show_json)


@app.command()
@naming_options
def robots(
    names: Annotated[
        str, typer.Option(metavar="NAMES", help="Robots of example-robot-data.")
    ] = "ur5_robot,panda,solo12,talos_reduced",
    sizes: Sizes = "1,100,100000",
    repeats: Repeats = 5,
    cpp: Cpp = False,
    show_json: Json = False,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw run times of the largest batch (.png, .svg, .pdf).")
    ] = None,
) -> None:
    """Poses, Jacobians and dynamics of whole robots: beside Pinocchio, its own batches, MuJoCo and frax (JAX).

    A block of the table is one task of one robot at N states; a row is one engine that does it.
    """
    from hingepair.bench import robots as bench

    chosen = [name.strip() for name in names.split(",")]
    _report(lambda: bench.measure_robots(chosen, _counts(sizes), repeats, cpp), show_json, plot)


@app.command()
@naming_options
def scale(
    samples: Annotated[int, typer.Option(min=1000, max=10**8, help="Samples of the calls.")] = 10_000_000,
    long: Annotated[
        int, typer.Option(min=0, max=10**10, help="Samples of a reduction whose memory is measured; 0 for none.")
    ] = 100_000_000,
    workers: Annotated[int, typer.Option(min=1, max=1024, help="Threads beside one.")] = 2,
    repeats: Repeats = 5,
    show_json: Json = False,
) -> None:
    """Dask beside the plain call, threads beside one, a reduction in little memory, and sweeps."""
    from hingepair.bench import scale as bench

    _report(lambda: bench.measure_dask(samples, long, workers, repeats), show_json)
