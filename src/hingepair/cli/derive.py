"""`hingepair derive SCENE`: closed forms of a scene's motion, of any motion of a pair, or of a robot's frame."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import Annotated, Any, Final

import numpy as np
import typer

from hingepair.cli.output import give, listed
from hingepair.cli.pairs import Frame1, Frame2, Joint, TextFile, inputs_of, is_urdf, named, named_robot
from hingepair.errors import HingePairError
from hingepair.formats.robots import load_robot, robot_urdf
from hingepair.mechanism.mechanism import Mechanism
from hingepair.scenes.mechanisms.scene import MechanismScene
from hingepair.scenes.scene import SCENE_OUTPUTS, Scene

_SNAP: Final = 1e-6
"""[rad] within which an angle of a robot's file is taken for a multiple of pi/2, unless the command line says."""

DEFAULT = ("omega1", "R2", "S2", "v2", "omega2", "a2", "alpha2")
"""What is derived unless the command line or the scene says otherwise."""


def derive(
    source: Annotated[str, typer.Argument(metavar="SCENE", help="Scene file (TOML), a robot's name or a URDF file.")],
    joint: Joint = None,
    frame: Annotated[
        str | None,
        typer.Option(
            "--frame",
            metavar="NAME",
            help="A robot's link or joint; its last link, where it ends in one, unless given.",
        ),
    ] = None,
    snap: Annotated[
        float | None,
        typer.Option(
            "--snap",
            metavar="ANGLE",
            help="Angles [rad] of a robot's file so near to a multiple of pi/2 are taken for it: 1e-6 unless given, "
            "0 for none.",
        ),
    ] = None,
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
        str | None,
        typer.Option(
            metavar="NAMES",
            help="What stays a letter: of u1,u2,n and the scene's constants; of a robot u, its lengths.",
        ),
    ] = None,
    short: Annotated[
        bool | None,
        typer.Option(
            "--short/--full", help="Abbreviate sines and what comes again: where lines are long, and of a robot."
        ),
    ] = None,
    out: TextFile = None,
) -> None:
    """Show the motion in closed form.

    Unless told, omega1(t), R2(t), S2(t), v2(t), omega2(t), a2(t), alpha2(t). Without a motion (a scene that has
    none or simulates it, a robot's hinge) the forms are those of any motion. Of a whole robot: R, S, jacobian, v and
    omega of a frame, in the joints' q_1, q_2 and so on.
    """
    if unicode + latex + python + as_json > 1:
        raise HingePairError("--unicode, --latex, --python and --json exclude each other")
    write = "latex" if latex else "python" if python else "json" if as_json else "text"
    letters, asked = listed("--symbolic", symbolic) or (), listed("--outputs", outputs)
    robot = None if joint or body1_frame or body2_frame else _snapped_robot(source, snap)
    found = named(source, joint, body1_frame, body2_frame) if robot is None else None
    if isinstance(found, MechanismScene) and snap is None:
        robot = found.mechanism, ()
    if robot is not None:
        text = _of_robot(*robot, frame, letters, asked, write, short is not False)
    elif frame is not None or snap is not None:
        raise HingePairError(
            "--frame needs a whole robot or its scene, --snap a robot's name or a URDF file; no JOINT"
        )
    else:
        any_motion = joint is None and not is_urdf(source)
        text = _of_pair(found, source if any_motion else None, letters, asked, write, short)
    give(text, out, inputs_of(source))


def _of_pair(
    found: Any,
    file: str | None,
    letters: Sequence[str],
    outputs: Sequence[str] | None,
    write: str,
    short: bool | None,
) -> str:
    """Return the closed forms of a scene's motion, or those of any motion of a pair, which may stand in a file."""
    from hingepair.plans.plan import ACCELERATION, PLANAR, check_outputs, default_outputs
    from hingepair.scenes.derive import derive as closed_forms
    from hingepair.scenes.derive import derive_any_motion

    if isinstance(found, Scene) and found.motion.simulated:
        found = found.pair
    is_scene = isinstance(found, Scene)
    forms = closed_forms(found, letters) if is_scene or file is None else derive_any_motion(file, letters)
    title, wanted = (found.title, found.outputs) if is_scene else (found.name, None)
    asked = tuple(name for name in wanted or () if name not in SCENE_OUTPUTS)
    usual = default_outputs(ACCELERATION, PLANAR) if forms.kind is PLANAR else DEFAULT
    names = asked or usual if outputs is None else check_outputs(outputs, forms.kind.levels)
    if write == "latex":
        return forms.to_latex(names, short=bool(short))
    if write == "python":
        return forms.to_python(names, title)
    if write == "json":
        return json.dumps(forms.to_sympy(names), indent=2) + "\n"
    text = forms.to_text(names, short=bool(short))
    return forms.to_text(names, short=True) if short is None and "\n      " in text else text


def _snapped_robot(source: str, snap: float | None) -> tuple[Mechanism, tuple[str, ...]] | None:
    """Return the robot of a name or a URDF file, its angles near right ones taken for these, and a note on that."""
    robot = named_robot(source)
    if robot is None:
        if not os.path.exists(source) and not source.lower().endswith(".toml"):
            robot_urdf(source)  # refuses it, and says what robots there are
        return None
    near = _SNAP if snap is None else snap
    snapped = Mechanism.from_urdf(source, snap=near) if is_urdf(source) else load_robot(source, snap=near)
    moved = _largest_change(robot, snapped)
    note = f"angles of the robot's file up to {moved:.1g} rad from a multiple of pi/2 are taken for it (--snap)"
    return snapped, (note,) if moved else ()


def _of_robot(
    robot: Mechanism,
    notes: Sequence[str],
    frame: str | None,
    letters: Sequence[str],
    outputs: Sequence[str] | None,
    write: str,
    short: bool,
) -> str:
    """Return the closed forms of a robot's frame."""
    from hingepair.symbolic.frame_forms import FrameForms

    forms = FrameForms(robot, frame, letters, notes)
    if write == "latex":
        return forms.to_latex(outputs, short=short)
    if write == "python":
        return forms.to_python(outputs)
    if write == "json":
        return json.dumps(forms.to_sympy(outputs), indent=2) + "\n"
    return forms.to_text(outputs, short=short)


def _largest_change(robot: Mechanism, other: Mechanism) -> float:
    """Return the largest difference between the fixed rotations of two records of one robot."""
    one, two = (
        [*(joint.S for joint in own.tree.joints), *(link.S for link in own.tree.links.values())]
        for own in (robot, other)
    )
    return max(float(np.abs(a - b).max()) for a, b in zip(one, two, strict=True))
