"""`hingepair view SCENE`: a page on which the pair moves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hingepair.cli.output import console
from hingepair.cli.pairs import Frame1, Frame2, Joint, Source, inputs_of, named
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pictures.page import view as page_of


def view(
    source: Source,
    joint: Joint = None,
    body1_frame: Frame1 = None,
    body2_frame: Frame2 = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            "-o",
            metavar="FILE",
            help="Where the page goes; unless told, here and named as the scene is.",
        ),
    ] = None,
) -> None:
    """Write a web page on which the pair moves.

    One HTML file for any browser, without a network. A scene moves as it says; without a motion, and of the
    joint of a robot or of a URDF file, the hinge turns through its limits.
    """
    found = named(source, joint, body1_frame, body2_frame)
    own = f"{Path(source).stem}.html" if joint is None else f"{Path(source).stem}_{Path(joint).name}.html"
    page = page_of(found.to_spatial() if isinstance(found, PlanarPair) else found)
    console().print(
        f"written: {page.save(out or own, inputs_of(source))} ({page.frames} instants; open it in a browser)"
    )
