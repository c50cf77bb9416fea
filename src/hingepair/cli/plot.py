"""`hingepair plot SCENE`: a figure of the motion."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hingepair.cli.output import Outputs, console, listed
from hingepair.cli.run import SceneFile
from hingepair.errors import ArgumentError
from hingepair.numeric.whole_file import whole_file
from hingepair.pictures.plot import plot as figure_of
from hingepair.scenes.scene import load_scene, scene_files

_ENDINGS = (".png", ".svg", ".pdf")


def plot(
    scene_file: SceneFile,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help=f"Where the figure goes ({', '.join(_ENDINGS)}); unless told, here and named as the scene is.",
        ),
    ] = None,
    outputs: Outputs = None,
) -> None:
    """Draw a scene over time and in space.

    Position, attitude and rates over time, psi, paths in space, the residual of E1; or some outputs over time.
    """
    out = out or Path(f"{scene_file.stem}.png")
    if out.suffix.lower() not in _ENDINGS:
        raise ArgumentError("out", f"a file name that ends in {', '.join(_ENDINGS)}", repr(str(out)))
    figure = figure_of(load_scene(scene_file), listed(outputs))
    with whole_file(out, scene_files(scene_file)) as file:
        figure.savefig(file, format=out.suffix.lower()[1:], dpi=110)
    console().print(f"written: {out}")
