"""`hingepair tolerance SCENE`: what tolerances of the geometry make of the pose of body 2."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hingepair.cli.output import PICTURES, Json, check_picture, console, line_width, save_figure
from hingepair.cli.pairs import named_scene
from hingepair.cli.scenes import SceneFile
from hingepair.errors import ArgumentError, printable
from hingepair.numeric.tables import ruled_table
from hingepair.sweeps.tolerance import study_tolerances

_NUMBERS = "a number, or three separated by commas"


def _std(what: str, unit: str, numbers: str = _NUMBERS) -> Any:
    return typer.Option(metavar="STD", help=f"Standard deviation of {what} [{unit}]: {numbers}.")


def tolerance(
    scene_file: SceneFile,
    u1_std: Annotated[str | None, _std("u1", "m")] = None,
    u2_std: Annotated[str | None, _std("u2", "m")] = None,
    axis_std: Annotated[str | None, _std("the tilt of the axis in each direction", "rad", "a number")] = None,
    home_std: Annotated[str | None, _std("the rotation vector of home", "rad")] = None,
    samples: Annotated[int, typer.Option(min=2, max=10**6, help="Number of sampled pairs.")] = 10_000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the sampled pairs.")] = 0,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help=f"Draw bands and shares ({', '.join(PICTURES)}).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Show what manufacturing tolerances make of the position and attitude of body 2.

    The standard deviations are those of the table [tolerances] of the scene, or those of the options. The band is
    computed to first order and by sampled pairs, side by side, at 101 instants at most. The second table shows which
    dimension matters most.
    """
    if plot is not None:
        check_picture("--plot", plot)
    given = {"u1_std": u1_std, "u2_std": u2_std, "axis_std": axis_std, "home_std": home_std}
    std = {name: _numbers(name, text) for name, text in given.items() if text is not None}
    scene = named_scene(scene_file)
    study = study_tolerances(scene, samples, seed, **std)
    if plot is not None:
        save_figure(study.plot(), plot, scene.files, dpi=110)
    if as_json:
        print(study.to_json())
        return
    screen = console()
    if study.title:
        screen.print(printable(study.title), style="bold")
    sizes = ", ".join(f"{name} = {value}" for name, value in study.tolerances.items())
    screen.print(f"{study.samples} pairs at {len(study.t)} instants; {sizes} (standard deviations, m and rad)", "")
    bands, shares = study.tables()
    screen.print(*ruled_table(bands, 2, line_width(screen)), "", sep="\n")
    screen.print(*ruled_table(shares, 1, line_width(screen)), "", sep="\n")
    screen.print(study.verdict)
    screen.print(f"written: {plot}" if plot else "nothing drawn (--plot FILE draws the bands over time)")


def _numbers(name: str, text: str) -> float | list[float]:
    """Return the number, or the three numbers, of an option."""
    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        raise ArgumentError(name, _NUMBERS, repr(text)) from None
    return numbers[0] if len(numbers) == 1 else numbers
