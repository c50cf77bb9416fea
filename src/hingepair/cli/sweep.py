"""`hingepair sweep SWEEP.toml`: a design over numbers of a scene, computed in chunks."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from hingepair.cli.output import Json, console, file_option
from hingepair.errors import printable
from hingepair.numeric.tables import json_text
from hingepair.sweeps.stores import ENDINGS
from hingepair.sweeps.sweep import Progress, load_sweep, run_sweep

SweepFile = Annotated[Path, typer.Argument(metavar="SWEEP", help="Sweep file (TOML).")]
Store = Annotated[
    Path | None,
    file_option(f"Where the results go ({', '.join(ENDINGS)}); named as the sweep is unless told."),
]


def sweep(
    sweep_file: SweepFile,
    out: Store = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="A dask.distributed scheduler; threads of this process unless given."),
    ] = None,
    workers: Annotated[int, typer.Option(help="Threads of this process; -1 for one on every core.")] = -1,
    as_json: Json = False,
) -> None:
    """Compute all variants of a sweep.

    A sweep file names a scene, the numbers of it that are varied, and what is kept of each variant; the page "Scene
    files" of the documentation describes the format. A sweep that was interrupted is taken up by the same command,
    without computing finished chunks again. On other machines: `dask scheduler` on one, `dask worker ADDRESS` on
    each; scene files are read there too where a scene has a log or a URDF file.
    """
    own = load_sweep(sweep_file)
    path = own.default_store() if out is None else out
    with _bar() as progress, _said_if_stopped(path):
        run_sweep(own, path, scheduler, workers, progress)
    if as_json:
        facts = {"title": own.title, "variants": own.variants, "chunks": own.chunks, "keys": own.keys}
        print(json_text(facts | {"file": str(path)}))
        return
    screen = console()
    screen.print(printable(own.title), style="bold")
    screen.print(f"{own.variants} variants of {', '.join(own.keys)} in {own.chunks} chunks")
    screen.print(f"written: {path}")


@contextlib.contextmanager
def _bar() -> Iterator[Progress | None]:
    """Show a progress bar on a terminal."""
    screen = Console(stderr=True)
    if not screen.is_terminal:
        yield None
        return
    from rich.progress import Progress as Bar

    with Bar(console=screen, transient=True) as bar:
        task = bar.add_task("computing", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


@contextlib.contextmanager
def _said_if_stopped(path: Path) -> Iterator[None]:
    """Say that a signal stopped a sweep, and how it goes on."""
    try:
        yield
    except SystemExit:
        print(f"hingepair: stopped; the same command goes on where it was ({path}.parts)", file=sys.stderr)
        raise
