"""`hingepair derive`: closed forms of the motion of a scene, of any motion of a pair, or of a frame of a robot."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, NamedTuple

import numpy as np
import typer

from hingepair.cli.models import TextFileOption
from hingepair.cli.output import check_output, split_names, write_text
from hingepair.cli.sources import Body1FrameOption, Body2FrameOption, JointArgument, Source
from hingepair.errors import HingePairError
from hingepair.formats.robots import load_robot, robot_urdf
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.scenes.subjects.pair import FURTHER_OUTPUTS

if TYPE_CHECKING:
    from hingepair.symbolic.closed_forms import PairForms
    from hingepair.symbolic.writing import ClosedForms

_DERIVED = ("omega1", "R2", "S2", "v2", "omega2", "a2", "alpha2")
"""Outputs that are derived unless --outputs or the scene names others."""
_SNAP = 1e-6
"""Angles of a robot's file that are closer than this [rad] to a multiple of pi/2 are taken for that multiple."""


def derive_command(
    source: Annotated[str, typer.Argument(metavar="SCENE", help="Scene file (TOML), a robot's name or a URDF file.")],
    joint: JointArgument = None,
    frame: Annotated[
        str | None,
        typer.Option(
            "--frame",
            metavar="NAME",
            help="Link or joint of a robot; default: its last link, if it has only one.",
        ),
    ] = None,
    body1_frame: Body1FrameOption = None,
    body2_frame: Body2FrameOption = None,
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
    short: Annotated[
        bool | None,
        typer.Option(
            "--short/--full",
            help="--short abbreviates repeated terms, and a robot's sines; --full writes them out; default: --short "
            "if lines are long.",
        ),
    ] = None,
    out: TextFileOption = None,
) -> None:
    """Derive closed formulas of a motion, and print or write them.

    The outputs are omega1(t), R2(t), S2(t), v2(t), omega2(t), a2(t), alpha2(t) by default, and position, velocity and
    acceleration of points of the bodies. A scene without a motion
    or with a simulated one, and a hinge of a robot, give the formulas of an arbitrary motion. A whole robot gives R,
    S, jacobian, v and omega of a frame, in terms of the joint coordinates q_1, q_2 and so on.
    """
    if latex + python + c + as_json > 1:
        raise HingePairError("--latex, --python, --c and --json exclude each other; give one of them")
    check_output("--out", out, [source])
    output_format = "latex" if latex else "python" if python else "c" if c else "json" if as_json else "text"
    symbols, output_names = split_names("--symbolic", symbolic) or (), split_names("--outputs", outputs)
    named = Source(source, joint, body1_frame, body2_frame)
    named.print_suspicions()
    robot = _load_snapped_robot(named) if named.is_whole else None
    if robot is not None:
        from hingepair.symbolic.closed_forms import FrameForms

        if symbols:
            raise HingePairError("--symbolic is for a pair or its scene; the formulas of a robot show its numbers")
        mechanism, notes = robot
        text = _write(FrameForms(mechanism, frame, notes), output_names, output_format, short)
    elif frame is not None:
        raise HingePairError("--frame needs a whole robot or its scene, without a JOINT")
    else:
        text = _write_pair(_pair_forms(named, symbols), output_names, output_format, short)
    write_text(text, out, named.files)


class _PairForms(NamedTuple):
    forms: PairForms
    title: str
    outputs: tuple[str, ...]  # those that the scene names


def _pair_forms(source: Source, symbols: Sequence[str]) -> _PairForms:
    """Return the formulas of a scene's motion, or of any motion of a pair whose scene has none or simulates it."""
    from hingepair.scenes.derive import derive as closed_forms
    from hingepair.scenes.derive import derive_any_motion

    if source.has_motion and not source.scene_file.is_simulated:
        scene = source.scene_file.scene()
        scene.require_pair()
        named = tuple(name for name in scene.outputs or () if name not in FURTHER_OUTPUTS)
        return _PairForms(closed_forms(scene, symbols), scene.title, named)
    pair = source.pair()
    # The exact values of a file count.
    forms = derive_any_motion(source.scene_file, symbols) if source.is_scene else closed_forms(pair, symbols)
    return _PairForms(forms, pair.name, ())


def _write_pair(derived: _PairForms, outputs: Sequence[str] | None, output_format: str, short: bool | None) -> str:
    """Return the formulas of a pair in a format."""
    from hingepair.equations.quantities import ACCELERATION
    from hingepair.plans.arguments import check_outputs
    from hingepair.plans.pairs import PLANE

    forms, title, named = derived
    planar = forms.kind is PLANE
    usual = named or (PLANE.default_outputs(ACCELERATION) if planar else _DERIVED)
    of_points = () if named else tuple(name for name in forms.names if name not in forms.kind.levels)
    names = (*usual, *of_points) if outputs is None else check_outputs(outputs, forms.names)
    return _write(forms, names, output_format, short, title)


def _write(
    forms: ClosedForms, names: Sequence[str] | None, output_format: str, short: bool | None, title: str = ""
) -> str:
    """Return formulas in a format: "text", "latex", "python", "c" or "json"."""
    match output_format:
        case "latex":
            return forms.to_latex(names, short=short)
        case "python":
            return forms.to_python(names, title)
        case "c":
            return forms.to_c(names, title)
        case "json":
            return json.dumps(forms.to_sympy(names), indent=2) + "\n"
    return forms.to_text(names, short=short)


def _load_snapped_robot(source: Source) -> tuple[Mechanism, tuple[str, ...]] | None:
    """Return (robot, notes) of a scene of a robot, or of a robot or URDF file with angles within _SNAP of right
    angles taken for these, with a note if any is changed; None for anything else.
    """
    if source.is_scene:
        described = source.scene_file.mechanism
        return None if described is None else (described, ())
    robot = source.robot()
    if robot is None:
        if not os.path.exists(source.text) and not source.text.lower().endswith(".toml"):
            robot_urdf(source.text)  # raises an error that lists the robots
        return None
    snapped = (Mechanism.from_urdf if source.is_urdf else load_robot)(source.text, snap=_SNAP)
    change = _largest_rotation_change(robot, snapped)
    note = f"angles of the robot's file up to {change:.1g} rad from a multiple of pi/2 are taken for it"
    return snapped, (note,) if change else ()


def _largest_rotation_change(robot: Mechanism, other: Mechanism) -> float:
    """Return the largest absolute difference between entries of the fixed rotations of two versions of a robot."""
    first, second = (
        [*(joint.S for joint in tree_of(version).joints), *(link.S for link in tree_of(version).links.values())]
        for version in (robot, other)
    )
    return max(float(np.abs(a - b).max()) for a, b in zip(first, second, strict=True))
