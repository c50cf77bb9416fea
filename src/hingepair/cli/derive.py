"""`hingepair derive SCENE`: closed forms of a scene's motion, or of any motion of a pair."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from hingepair.cli.output import give, listed
from hingepair.cli.pairs import Frame1, Frame2, Joint, Source, TextFile, inputs_of, is_urdf, named, of_a_pair
from hingepair.errors import HingePairError
from hingepair.scenes.scene import SCENE_OUTPUTS, Scene

DEFAULT = ("omega1", "R2", "S2", "v2", "omega2", "a2", "alpha2")
"""What is derived unless the command line or the scene says otherwise."""


def derive(
    source: Source,
    joint: Joint = None,
    body1_frame: Frame1 = None,
    body2_frame: Frame2 = None,
    unicode: Annotated[
        bool, typer.Option("--unicode", help="One line a component, as a paper has it: the default.")
    ] = False,
    latex: Annotated[bool, typer.Option("--latex", help="LaTeX: an align* environment (amsmath).")] = False,
    python: Annotated[bool, typer.Option("--python", help="A Python module that needs only NumPy.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="JSON: each component as sympy.sympify reads it.")] = False,
    outputs: Annotated[str | None, typer.Option(metavar="NAMES", help="What to derive: R2,omega1.")] = None,
    symbolic: Annotated[
        str | None, typer.Option(metavar="NAMES", help="What stays a letter: of u1,u2,n and the scene's constants.")
    ] = None,
    short: Annotated[
        bool | None,
        typer.Option(
            "--short/--full", help="Abbreviate sines and other functions that come again: where lines are long."
        ),
    ] = None,
    out: TextFile = None,
) -> None:
    """Show the motion in closed form.

    Unless told, omega1(t), R2(t), S2(t), v2(t), omega2(t), a2(t), alpha2(t). Without a motion (a scene that has
    none or simulates it, a robot's hinge) the forms are those of any motion.
    """
    if unicode + latex + python + as_json > 1:
        raise HingePairError("--unicode, --latex, --python and --json exclude each other")
    from hingepair.plans.plan import ACCELERATION, PLANAR, check_outputs, default_outputs
    from hingepair.scenes.derive import derive as closed_forms
    from hingepair.scenes.derive import derive_any_motion

    found = of_a_pair(named(source, joint, body1_frame, body2_frame))
    letters = listed("--symbolic", symbolic) or ()
    if isinstance(found, Scene) and found.motion.simulated:
        found = found.pair
    if isinstance(found, Scene) or joint is not None or is_urdf(source):
        forms = closed_forms(found, letters)
    else:
        forms = derive_any_motion(source, letters)
    title, wanted = (found.title, found.outputs) if isinstance(found, Scene) else (found.name, None)
    asked = tuple(name for name in wanted or () if name not in SCENE_OUTPUTS)
    usual = default_outputs(ACCELERATION, PLANAR) if forms.kind is PLANAR else DEFAULT
    names = asked or usual if outputs is None else check_outputs(listed("--outputs", outputs), forms.kind.levels)
    if latex:
        text = forms.to_latex(names, short=bool(short))
    elif python:
        text = forms.to_python(names, title)
    elif as_json:
        text = json.dumps(forms.to_sympy(names), indent=2) + "\n"
    else:
        text = forms.to_text(names, short=bool(short))
        if short is None and "\n      " in text:
            text = forms.to_text(names, short=True)
    give(text, out, inputs_of(source))
