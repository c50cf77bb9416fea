"""`hingepair sweep`, `search` and `tolerance`: many variants of a scene."""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any

import typer

from hingepair.cli.output import (
    JsonOption,
    UnitsOption,
    out_option,
    print_title,
    report_if_stopped,
    terminal_width,
)
from hingepair.cli.scenes import SceneArgument
from hingepair.cli.sources import load_named_scene
from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.pairs.tolerances import DEVIATIONS, LIMITS
from hingepair.scenes.variants.search import Range, search
from hingepair.scenes.variants.sweep import STORE_SUFFIXES, Progress, load_sweep, run_sweep
from hingepair.scenes.variants.tolerance import study_tolerances
from hingepair.tables.sheets import json_text, ruled_table


def tolerance_command(
    scene_file: SceneArgument,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=LIMIT",
            help='Tolerance of u1, u2, axis, home or a point, such as "u1=+-0.2 mm", "axis=+-0.1 deg uniform" or '
            '"handle=+-0.5 mm"; or a standard deviation [m, rad], such as u1_std=0.001 or handle=0.001; three for '
            "three components, separated by commas. May be repeated.",
        ),
    ] = None,
    units: UnitsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show how manufacturing tolerances affect the pose of body 2, and points.

    The tolerances come from the option or from the table [tolerances] of the scene. A tolerance +- is taken for
    three standard deviations of a normal distribution, unless it is uniform. The table shows the standard deviation
    of each component, to first order, where it is largest of 101 instants at most, and which dimensions cause it, as
    a mean over the motion.
    """
    scene = load_named_scene(scene_file)
    scene.in_units(units)  # refuses unknown ones before anything is computed
    given: dict[str, Any] = {}
    for name, value in map(_parse, tolerance or ()):
        if name in (*LIMITS, *DEVIATIONS):
            given[name] = value
        else:
            given.setdefault("points", {})[name] = value
    study = study_tolerances(scene, **given)
    if as_json:
        print(study.to_json(units))
        return
    print_title(study.title)
    shown = {**study.tolerances, **study.tolerances.get("points", {})}
    shown.pop("points", None)
    sizes = "; ".join(
        f"{name} = {', '.join(map(str, value)) if isinstance(value, list) else value}"
        for name, value in shown.items()
    )
    print(f"{len(study.t)} instants; {sizes}")
    if {*DEVIATIONS} & {*study.tolerances}:
        print("names with _std are standard deviations in m and rad")
    if {"axis", "axis_std"} & {*study.tolerances}:
        print("a tilt of the axis is taken with the bodies adjusted at psi = 0, which keep their attitude there")
    print("", *ruled_table(study.table(units), 2, terminal_width()), "", sep="\n")
    for note in study.notes:
        print(f"note: {note}")


def _parse(text: str) -> tuple[str, Any]:
    """Return the name of a dimension or a point, and its limits as text or standard deviations as numbers."""
    name, equals, value = text.partition("=")
    if not (name.strip() and equals and value.strip()):
        raise ArgumentError("tolerance", 'NAME=LIMIT, such as "u1=+-0.2 mm"', repr(text))
    try:
        numbers = [float(part) for part in value.split(",")]
    except ValueError:
        if name.strip() in DEVIATIONS:
            raise ArgumentError("tolerance", "a number, or three separated by commas", repr(text)) from None
        return name.strip(), value.strip()
    if not all(map(math.isfinite, numbers)):
        raise ArgumentError("tolerance", "finite numbers", repr(text))
    return name.strip(), numbers[0] if len(numbers) == 1 else numbers


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
            metavar="ADDRESS", help="Address of a dask.distributed scheduler; default: this process computes."
        ),
    ] = None,
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
    stopped = f"stopped; the same command goes on where it was ({path}.parts)"
    with _sweep_progress_bar() as progress, report_if_stopped(stopped):
        run_sweep(loaded, path, scheduler, progress)
    if as_json:
        facts = {
            "title": loaded.title,
            "variants": loaded.variants,
            "chunks": loaded.chunks,
            "keys": loaded.keys,
            "file": str(path),
        }
        print(json_text(facts))
        return
    print_title(loaded.title)
    print(f"{loaded.variants} variants of {', '.join(loaded.keys)} in {loaded.chunks} chunks")
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


def search_command(
    scene_file: SceneArgument,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="KEY[=LOW:HIGH]",
            help="Number of the scene to vary, such as dynamics.psi.damping=0.1:10, in the unit of the scene file; "
            "may be given several times.",
        ),
    ],
    until: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CONDITION",
            help='Condition, such as "psi_t_below(0.01) = 5" or "psid_min >= -0.2"; may be given several times.',
        ),
    ] = None,
    minimize: Annotated[
        str | None, typer.Option(metavar="RESULT", help="Result to be smallest, such as hinge_torque_absmax.")
    ] = None,
    maximize: Annotated[str | None, typer.Option(metavar="RESULT", help="Result to be largest.")] = None,
    units: Annotated[
        str | None,
        typer.Option(metavar="UNITS", help='Units of results and conditions, such as "deg, mm". Default: SI units.'),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find numbers of a scene for which results have wanted values.

    A result is a component of an output and a reduction: psi_last, R2_z_max, hinge_torque_absmax, or the time at a
    level: psi_t_below(0.01), psi_t_settled(0.02). --minimize and --maximize need a range for each number. Exit code
    1: no such numbers were found; the closest are printed.
    """
    found = search(
        scene_file, dict(map(_read_range, vary)), until or (), minimize=minimize, maximize=maximize, units=units
    )
    if as_json:
        facts = {
            field: getattr(found, field)
            for field in ("values", "start", "results", "units", "conditions", "notes", "ok", "evaluations")
        }
        print(json_text(facts))
    else:
        print_title(found.scene.title)
        print(found)
    if not found.ok:
        raise typer.Exit(1)


def _read_range(text: str) -> tuple[str, Range]:
    """Return the key and the range that KEY or KEY=LOW:HIGH gives."""
    key, equals, ends = text.partition("=")
    if not equals:
        return key.strip(), None
    try:
        low, high = map(float, ends.split(":"))
    except ValueError:
        raise ArgumentError(
            "--vary", "KEY or KEY=LOW:HIGH, such as dynamics.psi.damping=0.1:10", quoted(text)
        ) from None
    return key.strip(), (low, high)
