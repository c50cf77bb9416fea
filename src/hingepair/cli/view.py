"""`hingepair view SCENE`: a page on which the pair moves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hingepair.cli.output import console
from hingepair.cli.pairs import Joint, Source, inputs_of, named_pair
from hingepair.pair.hinge_pair import HingePair
from hingepair.pictures.page import view as page_of
from hingepair.scenes.scene import load_scene


def view(
    source: Source,
    joint: Joint = None,
    out: Annotated[Path, typer.Option("--out", "-o", metavar="FILE", help="Where the page goes (.html).")] = Path(
        "hingepair.html"
    ),
) -> None:
    """Write a web page on which the pair moves.

    One HTML file for any browser, without a network. A scene moves as it says; the joint of a robot or of a URDF
    file turns through its limits.
    """
    if joint is None and source.lower().endswith(".toml"):
        page = page_of(load_scene(source))
    else:
        pair = named_pair(source, joint)
        page = page_of(pair if isinstance(pair, HingePair) else pair.to_spatial())
    console().print(f"written: {page.save(out, inputs_of(source))} ({page.frames} instants; open it in a browser)")
