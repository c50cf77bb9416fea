"""`hingepair derive`: closed forms of the motion of a scene, of any motion of a pair, or of a frame of a robot."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer

from hingepair.cli.options import SourceArgument, TextFileOption, split_names
from hingepair.cli.output import check_output, write_text
from hingepair.cli.sources import read_source
from hingepair.errors import HingePairError
from hingepair.mechanism.mechanism import Mechanism
from hingepair.plans.pairs import PLANE, SPACE
from hingepair.scenes.assembly import FURTHER_OUTPUTS
from hingepair.scenes.scene import Scene

_DERIVED = ("omega1", "R2", "S2", "phi2", "v2", "omega2", "a2", "alpha2")
"""Outputs that are derived unless --outputs or the scene names others, as far as the pair has them."""
_SNAP = 1e-6
"""Angles of a robot's file that are closer than this [rad] to a multiple of pi/2 are taken for that multiple."""


def derive_command(
    source: SourceArgument,
    frame: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Link or joint of a robot; default: its last link, if it has only one."),
    ] = None,
    latex: Annotated[bool, typer.Option("--latex", help="Print LaTeX: an align* environment (amsmath).")] = False,
    python: Annotated[bool, typer.Option("--python", help="Print a Python module that needs only NumPy.")] = False,
    c: Annotated[bool, typer.Option("--c", help="Print C functions (C99), one for each output.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print JSON: each component as text for sympy.sympify.")
    ] = False,
    outputs: Annotated[
        str | None, typer.Option(metavar="NAMES", help="Outputs to derive, separated by commas, such as R2,omega1.")
    ] = None,
    symbolic: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="Constants that stay symbols in the formulas, separated by commas: u1, u2, n and the constants of "
            "the scene; not of a robot.",
        ),
    ] = None,
    full: Annotated[bool, typer.Option("--full", help="Write repeated terms out in long lines, too.")] = False,
    out: TextFileOption = None,
) -> None:
    """Derive closed formulas of a motion, and print or write them.

    The outputs are omega1(t), R2(t), S2(t), v2(t), omega2(t), a2(t), alpha2(t) by default, and position, velocity and
    acceleration of points of the bodies. A scene without a motion or with a simulated one gives the formulas of an
    arbitrary motion. A robot gives R, S, jacobian, v and omega of a frame, in terms of the joint coordinates q_1, q_2
    and so on; angles of its file within 1e-6 rad of a multiple of pi/2 are taken for it.
    """
    if latex + python + c + as_json > 1:
        raise HingePairError("--latex, --python, --c and --json exclude each other; give one of them")
    check_output(out, [source])
    symbols, names = split_names("symbolic", symbolic) or (), split_names("outputs", outputs)
    read = read_source(source, snap=_SNAP)
    if isinstance(read.named, Scene):
        read.named.refuse_linkage("closed forms are of trees of joints, or of a pair")
    forms, title, usual = _forms(read.subject, frame, symbols)
    names, short = usual if names is None else names, False if full else None
    if latex:
        text = forms.to_latex(names, short=short)
    elif python or c:
        text = (forms.to_python if python else forms.to_c)(names, title)
    elif as_json:
        text = json.dumps(forms.to_sympy(names), indent=2) + "\n"
    else:
        text = forms.to_text(names, short=short)
    write_text(text, out, read.files)


def _forms(subject: Any, frame: str | None, symbols: Any) -> tuple[Any, str, list[str] | None]:
    """Return the formulas of a robot or of the scene of a pair, their title, and the outputs to write."""
    from hingepair.scenes.derive import derive

    if isinstance(subject, Mechanism):
        return derive(subject, symbols, frame), "", None
    forms = derive(subject, symbols, frame)
    has_functions = subject.has_motion and not subject.is_simulated
    named = [name for name in (subject.outputs if has_functions else None) or () if name not in FURTHER_OUTPUTS]
    points = [name for name in forms.names if name not in {*SPACE.levels, *PLANE.levels}]
    return forms, subject.title, named or [*(name for name in _DERIVED if name in forms.names), *points]
