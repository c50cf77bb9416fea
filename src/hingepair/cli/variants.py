"""`hingepair sweep`, `search` and `tolerance`: many variants of a scene."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from hingepair.cli.options import JsonOption, SceneArgument, UnitsOption, out_option
from hingepair.cli.output import new_file, show, table_lines
from hingepair.cli.sources import read_scene
from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.pairs.tolerances import LIMITS
from hingepair.scenes.variants.search import Range, search
from hingepair.scenes.variants.sweep import STORE_SUFFIXES, load_sweep, run_sweep
from hingepair.scenes.variants.tolerance import study_tolerances


def tolerance_command(
    scene_file: SceneArgument,
    tolerance: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=LIMIT",
            help='Tolerance of u1, u2, axis, home or a point, such as "u1=+-0.2 mm", "axis=+-0.1 deg" or '
            '"handle=+-0.5 mm"; three for three components, separated by commas. May be repeated.',
        ),
    ] = None,
    units: UnitsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show how manufacturing tolerances affect the pose of body 2, and points.

    The tolerances come from the option or from the table [tolerances] of the scene. A tolerance +- is taken for
    three standard deviations of a normal distribution. A tilt of the axis is taken with the
    bodies adjusted at psi = 0, which keep their attitude there. The table shows the standard deviation of each
    component, to first order, where it is largest of 101 instants at most, and which dimensions cause it, as a mean
    over the motion.
    """
    scene = read_scene(scene_file)
    scene.in_units(units)  # refuses unknown ones before anything is computed
    given: dict[str, Any] = {}
    for name, equals, limit in (text.partition("=") for text in tolerance or ()):
        if not (name.strip() and equals and limit.strip()):
            raise ArgumentError("tolerance", 'NAME=LIMIT, such as "u1=+-0.2 mm"', quoted(name))
        own = given if name.strip() in LIMITS else given.setdefault("points", {})
        own[name.strip()] = limit.strip()
    study = study_tolerances(scene, **given)
    shown = {**study.tolerances, **study.tolerances.get("points", {})}
    shown.pop("points", None)
    texts = ((name, ", ".join(map(str, own)) if isinstance(own, list) else own) for name, own in shown.items())
    sizes = (f"{name} = {text}" for name, text in texts)
    heading = (study.title, f"{len(study.t)} instants; {'; '.join(sizes)}")
    notes = (f"note: {note}" for note in study.notes)
    show(as_json, study.facts(units), *heading, *table_lines(study.table(units)), *notes)


def sweep_command(
    sweep_file: Annotated[Path, typer.Argument(metavar="SWEEP", help="Sweep file (TOML).")],
    out: Annotated[
        Path | None,
        out_option(
            f"Write the results to FILE ({', '.join(STORE_SUFFIXES)}); default: the sweep's name with .parquet."
        ),
    ] = None,
    units: UnitsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compute all variants of a sweep, and write the results.

    A sweep file names a scene, the numbers of it that are varied, and what is kept of each variant; the page "Scene
    files" of the documentation describes the format.
    """
    sweep = load_sweep(sweep_file, units)
    path, count, keys = out or new_file(sweep.default_store()), len(sweep.numbers), sweep.variants.keys
    run_sweep(sweep, path, _print_progress if sys.stderr.isatty() else None)
    facts = {"title": sweep.title, "variants": count, "keys": keys, "file": str(path)}
    show(as_json, facts, sweep.title, f"{count} variants of {', '.join(keys)}", f"written: {path}")


def _print_progress(done: int, count: int) -> None:
    print(f"\r{done} of {count} variants", end="\n" if done == count else "", file=sys.stderr, flush=True)


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
    units: UnitsOption = None,
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
    names = ("values", "start", "results", "units", "conditions", "notes", "ok", "evaluations")
    show(as_json, {name: getattr(found, name) for name in names}, found.scene.title, found)
    raise typer.Exit(0 if found.ok else 1)


def _read_range(text: str) -> tuple[str, Range]:
    """Return the key and the range that KEY or KEY=LOW:HIGH gives."""
    key, equals, ends = text.partition("=")
    try:
        low, high = map(float, ends.split(":")) if equals else (0.0, 0.0)
    except ValueError:
        expected = "KEY or KEY=LOW:HIGH, such as dynamics.psi.damping=0.1:10"
        raise ArgumentError("vary", expected, quoted(text)) from None
    return key.strip(), (low, high) if equals else None
