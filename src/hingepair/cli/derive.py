"""`hingepair derive SCENE`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from hingepair.errors import ArgumentError
from hingepair.formats.results import write_whole
from hingepair.scenes.scene import load_scene

DEFAULT = ("omega1", "R2", "S2", "v2", "omega2", "a2", "alpha2")
"""What is derived unless the command line or the scene says otherwise."""


def derive(
    scene_file: Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).")],
    unicode: Annotated[
        bool, typer.Option("--unicode", help="One line a component, as a paper has it: the default.")
    ] = False,
    latex: Annotated[bool, typer.Option("--latex", help="LaTeX: an align* environment (amsmath).")] = False,
    python: Annotated[bool, typer.Option("--python", help="A Python module that needs only NumPy.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="JSON: the SymPy form of each component.")] = False,
    outputs: Annotated[str | None, typer.Option(metavar="NAMES", help="What to derive: R2,omega1.")] = None,
    symbolic: Annotated[str, typer.Option(metavar="NAMES", help="What stays a letter, of u1,u2,n.")] = "",
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write to FILE instead of standard output.")
    ] = None,
) -> None:
    """Show the motion in closed form: omega1(t), R2(t), S2(t), v2(t), omega2(t), a2(t), alpha2(t)."""
    if unicode + latex + python + as_json > 1:
        raise ArgumentError("format", "one of --unicode, --latex, --python, --json", "several")
    from hingepair.evaluation.plan import ACCELERATION, PLANAR, check_outputs, default_outputs
    from hingepair.symbolic import listings
    from hingepair.symbolic.closed_forms import derive as closed_forms

    scene = load_scene(scene_file)
    usual = default_outputs(ACCELERATION, PLANAR) if scene.kind == PLANAR else DEFAULT
    names = check_outputs(_names(outputs), scene.kind) if outputs is not None else scene.outputs or usual
    forms = closed_forms(scene, _names(symbolic))
    if latex:
        text = listings.to_latex(forms, names)
    elif python:
        text = listings.to_python(forms, names, scene.title)
    elif as_json:
        text = json.dumps(listings.to_sympy(forms, names), indent=2) + "\n"
    else:
        text = listings.to_text(forms, names)
    if out is None:
        print(text, end="")
        return
    write_whole(out, lambda file: file.write(text.encode()))
    print(f"written: {out}")


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",") if name.strip()]
