"""`hingepair sweep`: a scene computed for many values of its numbers, in chunks."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from hingepair.cli.output import JsonOption, out_option, print_title
from hingepair.scenes.variants.stores import STORE_SUFFIXES
from hingepair.scenes.variants.sweep import Progress, load_sweep, run_sweep
from hingepair.tables.sheets import json_text

SweepArgument = Annotated[Path, typer.Argument(metavar="SWEEP", help="Sweep file (TOML).")]
StoreOption = Annotated[
    Path | None,
    out_option(f"Write the results to FILE ({', '.join(STORE_SUFFIXES)}); default: the sweep's name with .parquet."),
]


def sweep_command(
    sweep_file: SweepArgument,
    out: StoreOption = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Address of a dask.distributed scheduler; default: threads of this process."
        ),
    ] = None,
    workers: Annotated[int, typer.Option(help="Threads of this process; -1: one for each core.")] = -1,
    units: Annotated[
        str | None,
        typer.Option(
            metavar="UNITS",
            help='Units of results and levels, such as "deg, mm". Default: units of the sweep, or else SI units.',
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Compute all variants of a sweep, and write the results.

    A sweep file names a scene, the numbers of it that are varied, and what is kept of each variant; the page "Scene
    files" of the documentation describes the format. A sweep that was interrupted is continued by the same command,
    without computing finished chunks again. To compute on other machines, start `dask scheduler` on one and `dask
    worker ADDRESS` on each, and give --scheduler ADDRESS. A log or URDF file that the scene names is read there too.
    """
    loaded = load_sweep(sweep_file, units)
    path = loaded.default_store() if out is None else out
    with _sweep_progress_bar() as progress, _report_stopped_sweep(path):
        run_sweep(loaded, path, scheduler, workers, progress)
    if as_json:
        facts = {
            "title": loaded.title,
            "variants": loaded.variants,
            "chunks": loaded.chunks,
            "keys": loaded.task.keys,
        }
        print(json_text(facts | {"keys": loaded.task.keys, "file": str(path)}))
        return
    print_title(loaded.title)
    print(f"{loaded.variants} variants of {', '.join(loaded.task.keys)} in {loaded.chunks} chunks")
    print(f"written: {path}")


@contextlib.contextmanager
def _sweep_progress_bar() -> Iterator[Progress | None]:
    """Yield a function that updates a progress bar; None if standard error is not a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    with typer.progressbar(length=1, label="computing", file=sys.stderr) as bar:

        def show(done: int, total: int) -> None:
            bar.length = total
            bar.update(done - bar.pos)

        yield show


@contextlib.contextmanager
def _report_stopped_sweep(path: Path) -> Iterator[None]:
    """Print to standard error how to go on if a signal stops the block that computes a sweep into `path`."""
    try:
        yield
    except SystemExit:
        print(f"hingepair: stopped; the same command goes on where it was ({path}.parts)", file=sys.stderr)
        raise
