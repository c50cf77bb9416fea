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
from hingepair.mechanism.pairs.tolerances import DEVIATIONS
from hingepair.sweeps.tolerance import study_tolerances
from hingepair.tables.sheets import ruled_table

_EXPECTED = "a number, or three separated by commas"
"""What the help and messages say of options for standard deviations."""


def _limit_option(quantity: str, example: str, numbers: str = "; or three of these separated by commas") -> Any:
    """Return a Typer option for the limits of a quantity."""
    text = f'Tolerance of {quantity}: "{example}" or "{example} uniform"{numbers}.'
    return typer.Option(metavar="LIMIT", help=text)


def _std_option(quantity: str, unit: str, numbers: str = _EXPECTED) -> Any:
    """Return a Typer option for the standard deviation of a quantity."""
    return typer.Option(metavar="STD", help=f"Standard deviation of {quantity} [{unit}]: {numbers}.")


def tolerance_command(
    scene_file: SceneArgument,
    u1: Annotated[str | None, _limit_option("u1", "+-0.2 mm")] = None,
    u2: Annotated[str | None, _limit_option("u2", "+-0.2 mm")] = None,
    axis: Annotated[str | None, _limit_option("the tilt of the axis", "+-0.1 deg", "")] = None,
    home: Annotated[str | None, _limit_option("the rotation vector of home", "+-0.1 deg")] = None,
    u1_std: Annotated[str | None, _std_option("u1", "m")] = None,
    u2_std: Annotated[str | None, _std_option("u2", "m")] = None,
    axis_std: Annotated[str | None, _std_option("the tilt of the axis in each direction", "rad", "a number")] = None,
    home_std: Annotated[str | None, _std_option("the rotation vector of home", "rad")] = None,
    point: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=LIMIT",
            help='Tolerance of a point of a body, "handle=+-0.5 mm", as that of u1; a number is a standard deviation '
            "[m]. May be repeated.",
        ),
    ] = None,
    samples: Annotated[int, typer.Option(min=2, max=10**6, help="Number of sampled pairs.")] = 10_000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sampled pairs.")] = 0,
    plot: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help=f"Draw the bands over time and the share of each dimension ({', '.join(PICTURE_SUFFIXES)}).",
        ),
    ] = None,
    units: UnitsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show how manufacturing tolerances affect the pose of body 2, and the points of the bodies.

    The tolerances come from the options or from the table [tolerances] of the scene. A tolerance +- is taken for
    three standard deviations of a normal distribution, unless it is uniform. The first table shows the tolerance
    band, computed to first order and by sampled pairs, at 101 instants at most. The second table shows which
    dimension contributes most.
    """
    if plot is not None:
        check_picture_suffix("--plot", plot)
    check_output("--plot", plot, [scene_file])
    deviations = {"u1_std": u1_std, "u2_std": u2_std, "axis_std": axis_std, "home_std": home_std}
    tolerances: dict[str, Any] = {"u1": u1, "u2": u2, "axis": axis, "home": home}
    tolerances |= {name: None if text is None else _parse_numbers(name, text) for name, text in deviations.items()}
    scene = load_named_scene(scene_file)
    scene.in_units(units)  # refuses unknown ones before anything is computed
    given = {name: value for name, value in tolerances.items() if value is not None}
    if point:
        given["points"] = dict(map(_parse_point, point))
    study = study_tolerances(scene, samples, seed, **given)
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
    print(f"{study.samples} pairs at {len(study.t)} instants; {sizes}")
    if {*DEVIATIONS} & {*study.tolerances}:
        print("names with _std are standard deviations in m and rad")
    if {"axis", "axis_std"} & {*study.tolerances}:
        print("a tilt of the axis is taken with the bodies adjusted at psi = 0, which keep their attitude there")
    print()
    bands, shares = study.tables(units)
    print(*ruled_table(bands, 2, terminal_width()), "", sep="\n")
    print(*ruled_table(shares, 1, terminal_width()), "", sep="\n")
    print(study.verdict)
    for note in study.notes:
        print(f"note: {note}")
    print(f"written: {plot}" if plot else "nothing drawn (--plot FILE draws the bands over time)")


def _parse_point(text: str) -> tuple[str, Any]:
    """Return the name of a point, and its limits as text or standard deviations as numbers."""
    name, equals, value = text.partition("=")
    if not (name.strip() and equals and value.strip()):
        raise ArgumentError("point", 'NAME=LIMIT, such as "handle=+-0.5 mm"', repr(text))
    try:
        return name.strip(), _parse_numbers("point", value)
    except ArgumentError:
        return name.strip(), value.strip()


def _parse_numbers(name: str, text: str) -> float | list[float]:
    """Return the number in the value of an option, or a list of those that commas separate."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        raise ArgumentError(name, _EXPECTED, repr(text)) from None
    if not all(map(math.isfinite, numbers)):
        raise ArgumentError(name, _EXPECTED, repr(text))
    return numbers[0] if len(numbers) == 1 else numbers
