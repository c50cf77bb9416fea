"""`hingepair forces SCENE`: what acts for the pair to move as a scene says."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich import box
from rich.table import Table

from hingepair.cli.output import NOTHING_WRITTEN, Json, console
from hingepair.cli.run import SceneFile, head
from hingepair.errors import ArgumentError
from hingepair.numeric.notebook import unit_of
from hingepair.numeric.tables import finite_or_none, instant
from hingepair.pair.results import ENDINGS, Record, check_ending, column_names
from hingepair.scenes.scene import load_scene, scene_files


def forces(
    scene_file: SceneFile,
    gravity: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Acceleration of free fall, world axes [m/s^2]: 0,0,-9.81, in the plane 0,-9.81, unless given.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help=f"Write all instants to FILE ({', '.join(ENDINGS)})."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Compute the forces that the motion of a scene takes.

    The bodies of its pair have masses. hinge_torque is what a motor must give about the axis, bearing_torque what
    the bearing carries across it, both of body 1 on body 2 at the hinge point, as is hinge_force; force1 and
    torque1 act on body 1 at R1. World axes.
    """
    if out is not None:
        check_ending(out)
    scene = load_scene(scene_file)
    found = scene.forces(None if gravity is None else _vector(gravity))
    written = None if out is None else found.save(out, scene_files(scene_file))
    rows = _rows(found)
    if as_json:
        numbers = {name: {key: finite_or_none(value) for key, value in row.items()} for name, row in rows.items()}
        facts = {
            "scene": str(scene.path),
            "samples": scene.samples,
            "file": None if written is None else str(written),
        }
        print(json.dumps({**facts, "outputs": numbers}, indent=2, allow_nan=False))
        return
    screen = console()
    head(screen, scene)
    table = Table(box=box.SIMPLE_HEAD)
    table.add_column("", no_wrap=True)
    for heading in ("unit", "first", "smallest", "largest", "rms", "max |.| at t"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, row in rows.items():
        *sizes, t = row.values()
        cells = (f"{value + 0.0:.5g}" for value in sizes)
        table.add_row(name, unit_of(name), *cells, instant(t), end_section=name.endswith("_z"))
    screen.print(table)
    for note in scene.notes():
        screen.print(f"note: {note}")
    screen.print(f"written: {written}" if written else NOTHING_WRITTEN)


def _rows(found: Record) -> dict[str, dict[str, float]]:
    """What a table says of each component."""
    t, arrays = found.t, found.recorded()
    columns = [column for array in arrays.values() for column in array.reshape(len(t), -1).T]
    return {
        name: {
            "first": float(column[0]),
            "smallest": float(np.nanmin(column)),
            "largest": float(np.nanmax(column)),
            "rms": float(np.sqrt(np.nanmean(column * column))),
            "t_of_largest_size": float(t[np.nanargmax(np.abs(column))]),
        }
        for name, column in zip(column_names(arrays), columns, strict=True)
    }


def _vector(text: str) -> tuple[float, ...]:
    try:
        return tuple(map(float, text.split(",")))
    except ValueError:
        raise ArgumentError("gravity", "numbers X,Y,Z", repr(text)) from None
