"""`hingepair tolerance`: the effect of manufacturing tolerances on the pose of body 2, and on points."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from hingepair.cli.output import (
    PICTURE_SUFFIXES,
    JsonOption,
    UnitsOption,
    check_output,
    check_picture_suffix,
    print_title,
    save_figure,
    terminal_width,
)
from hingepair.cli.scenes import SceneArgument
from hingepair.cli.sources import load_named_scene
from hingepair.errors import ArgumentError
from hingepair.mechanism.pairs.tolerances import DEVIATIONS, LIMITS
from hingepair.scenes.variants.tolerance import study_tolerances
from hingepair.tables.sheets import ruled_table


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
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help=f"Draw the deviations over time and their causes ({', '.join(PICTURE_SUFFIXES)}).",
        ),
    ] = None,
    units: UnitsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show how manufacturing tolerances affect the pose of body 2, and the points of the bodies.

    The tolerances come from the option or from the table [tolerances] of the scene. A tolerance +- is taken for
    three standard deviations of a normal distribution, unless it is uniform. The table shows the standard deviation
    of each component, to first order, where it is largest of 101 instants at most, and which dimensions cause it, as
    a mean over the motion.
    """
    if plot is not None:
        check_picture_suffix("--plot", plot)
    check_output("--plot", plot, [scene_file])
    scene = load_named_scene(scene_file)
    scene.in_units(units)  # refuses unknown ones before anything is computed
    given: dict[str, Any] = {}
    for name, value in map(_parse, tolerance or ()):
        if name in (*LIMITS, *DEVIATIONS):
            given[name] = value
        else:
            given.setdefault("points", {})[name] = value
    study = study_tolerances(scene, **given)
    if plot is not None:
        save_figure("--plot", study.plot(units), plot, scene.files, dpi=110)
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
    print(f"written: {plot}" if plot else "nothing drawn (--plot FILE draws the deviations over time)")


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
