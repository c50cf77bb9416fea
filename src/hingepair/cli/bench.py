"""`hingepair bench`: a command for each benchmark, and the printing of its report."""

from __future__ import annotations

import contextlib
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hingepair.cli.options import with_option_names
from hingepair.cli.output import check_picture_suffix, terminal_width
from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import check_choice
from hingepair.tables.whole_file import whole_file

if TYPE_CHECKING:
    from hingepair.bench.harness import Report

bench_app = typer.Typer(help="Measure run time and error on this machine.", no_args_is_help=True)

BenchJsonOption = Annotated[
    bool, typer.Option("--json", help="Print JSON, which includes facts about the machine, instead of tables.")
]
CppOption = Annotated[
    bool, typer.Option("--cpp", help="Compile and measure Pinocchio's C++ loop (compiling takes one or two minutes).")
]
ColdOption = Annotated[
    bool, typer.Option("--cold/--no-cold", help="Measure starts and first calls too, in fresh processes.")
]
RepeatsOption = Annotated[
    int, typer.Option(min=1, max=1000, help="Repeats of each measurement, of which the median is shown.")
]
PlotOption = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Draw error against run time (.png, .svg, .pdf).")
]
SizesOption = Annotated[str, typer.Option(help="Batch sizes [samples], separated by commas.")]


def _run_benchmark(measure: Callable[[], Report], show_json: bool, plot: Path | None = None) -> None:
    """Print the Report that `measure` returns, or its JSON, and draw it to `plot`, if any."""
    from hingepair.bench.harness import machine_facts, print_progress

    with contextlib.ExitStack() as exit_stack:
        draw = None if plot is None else exit_stack.enter_context(_open_picture(plot))
        report = measure()
        if draw is not None:
            draw(report)
            print_progress(f"written: {plot}")
    if show_json:
        print(report.to_json())
        return
    machine = ", ".join(f"{key} {value}" for key, value in machine_facts().items())
    for line in report.table(terminal_width()):
        print(line)
    for sentence in (*report.notes, machine):
        for line in textwrap.wrap(sentence, 100):
            print(line)


@contextlib.contextmanager
def _open_picture(path: Path) -> Iterator[Callable[[Report], None]]:
    """Open a picture file before anything is measured, and yield a function that draws a Report into it."""
    from hingepair.bench.plot import write_picture
    from hingepair.numeric.optional import new_figure

    check_picture_suffix("--plot", path)
    new_figure(1, 1, "--plot")  # raises an error if Matplotlib is not installed
    with contextlib.ExitStack() as exit_stack:
        try:
            file = exit_stack.enter_context(whole_file(path))
        except ArgumentError as error:
            raise ArgumentError("--plot", error.expected, error.got) from None
        yield lambda report: write_picture(report.panels, file, path.suffix.lower()[1:])


def _parse_sizes(sizes: str) -> list[int]:
    """Return the batch sizes, 1 to 10,000,000 each, in a text with commas."""
    counts = [int(part) if part.strip().isdecimal() else 0 for part in sizes.split(",")]
    if not all(1 <= count <= 10**7 for count in counts):
        raise ArgumentError("sizes", "integers from 1 to 10000000, separated by commas", quoted(sizes))
    return counts


@bench_app.command("direct")
@with_option_names
def bench_direct(
    sizes: SizesOption = "1,100,10000,1000000",
    levels: Annotated[
        str, typer.Option(help="Levels, separated by commas: pose, velocity, acceleration.")
    ] = "pose,velocity,acceleration",
    repeats: RepeatsOption = 7,
    cpp: CppOption = False,
    cold: ColdOption = True,
    show_json: BenchJsonOption = False,
    plot: PlotOption = None,
) -> None:
    """Measure forward kinematics of a pair, and its errors.

    Poses, velocities and accelerations are computed by hingepair, Pinocchio, MuJoCo, JAX, SciPy and NumPy, as far as
    these are installed. The errors are those against arithmetic of 60 digits.
    """
    from hingepair.bench import direct as bench

    counts, chosen = _parse_sizes(sizes), [level.strip() for level in levels.split(",")]
    for level in chosen:
        check_choice("levels", level, tuple(bench.LEVELS))
    _run_benchmark(lambda: bench.bench_direct(counts, chosen, repeats, cpp, cold), show_json, plot)


@bench_app.command("robots")
@with_option_names
def bench_robots(
    names: Annotated[
        str, typer.Option(metavar="NAMES", help="Robots of example-robot-data, separated by commas.")
    ] = "ur5_robot,panda,solo12,talos_reduced",
    sizes: SizesOption = "1,100,100000",
    repeats: RepeatsOption = 5,
    cpp: CppOption = False,
    cold: ColdOption = True,
    show_json: BenchJsonOption = False,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw run times of the largest batch (.png, .svg, .pdf).")
    ] = None,
) -> None:
    """Measure kinematics and dynamics of whole robots.

    The engines are hingepair, Pinocchio, MuJoCo and frax (JAX), as far as they are installed. Each block of the table
    is one workload (poses, Jacobians, inverse or forward dynamics) of one robot at N states; each row is one engine.
    """
    from hingepair.bench import robots as bench

    chosen = [name.strip() for name in names.split(",")]
    _run_benchmark(lambda: bench.bench_robots(chosen, _parse_sizes(sizes), repeats, cpp, cold), show_json, plot)


@bench_app.command("ik")
@with_option_names
def bench_ik(
    names: Annotated[
        str, typer.Option(metavar="NAMES", help="Robots of example-robot-data, separated by commas.")
    ] = "ur5_robot,panda",
    size: Annotated[int, typer.Option(min=1, max=10**7, help="Number of targets.")] = 10_000,
    repeats: RepeatsOption = 3,
    cpp: CppOption = False,
    show_json: BenchJsonOption = False,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Draw targets missed and errors against run time.")
    ] = None,
) -> None:
    """Measure inverse kinematics of robots.

    The engines are hingepair, Pinocchio's loop of closed-loop inverse kinematics, mink and ikpy, as far as they are
    installed. All have the same targets, tolerances and limits, and start again where they get stuck.
    """
    from hingepair.bench import inverse_kinematics as bench

    chosen = [name.strip() for name in names.split(",")]
    _run_benchmark(lambda: bench.bench_inverse_kinematics(chosen, size, repeats, cpp), show_json, plot)


@bench_app.command("rollouts")
@with_option_names
def bench_rollouts(
    names: Annotated[
        str, typer.Option(metavar="NAMES", help="Robots of example-robot-data, separated by commas.")
    ] = "ur5_robot,panda",
    size: Annotated[int, typer.Option(min=1, max=10**6, help="Number of motions.")] = 4096,
    steps: Annotated[int, typer.Option(min=1, max=10**6, help="Number of steps of each motion.")] = 100,
    repeats: RepeatsOption = 5,
    cpp: CppOption = False,
    show_json: BenchJsonOption = False,
) -> None:
    """Measure motions of robots in time, and gradients through them.

    The engines are hingepair, loops of Pinocchio's forward dynamics, and mujoco.rollout, as far as they are
    installed. All make the same steps.
    """
    from hingepair.bench import rollouts as bench

    chosen = [name.strip() for name in names.split(",")]
    _run_benchmark(lambda: bench.bench_rollouts(chosen, size, steps, repeats, cpp), show_json)
