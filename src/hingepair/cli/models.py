"""`hingepair urdf` and `hingepair mjcf`: pairs and robots as files of other programs."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Annotated, Any

import typer

from hingepair.cli.options import JsonOption, SourceArgument, TextFileOption
from hingepair.cli.output import check_output, write_text
from hingepair.cli.sources import read_source
from hingepair.formats.model_writers import to_mjcf, to_urdf
from hingepair.formats.xml_text import commented
from hingepair.mechanism.bodies.body import DynamicsWarning
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.scenes.motions.dynamics import PRESCRIBED
from hingepair.scenes.scene import Scene

BaseOption = Annotated[
    str | None,
    typer.Option(
        help="free; fixed: body 1 is fixed in the world; floating, of URDF: by a floating joint to a link `world`. "
        "Default: that of [dynamics], otherwise free, of MJCF only if body 1 has a mass."
    ),
]
_SIMULATION = ("tol", "breaks", "max_steps", "until")  # keys of [dynamics] that are of no model


def urdf_command(
    source: SourceArgument, out: TextFileOption = None, base: BaseOption = None, as_json: JsonOption = False
) -> None:
    """Write a pair, or the mechanism of a scene, as a URDF file.

    A scene needs no motion. Of a scene with [dynamics] the base, damping, friction and stops are written as well; a
    comment and a warning list the keys that URDF cannot express.
    """
    _write_model("URDF", source, out, base, as_json)


def mjcf_command(
    source: SourceArgument, out: TextFileOption = None, base: BaseOption = None, as_json: JsonOption = False
) -> None:
    """Write a pair, or the mechanism of a scene, as a MuJoCo model (MJCF).

    A scene needs no motion. Of a scene with [dynamics] the base, the pose of body 1 at the start, gravity, spring,
    damping, friction and stops are written; a comment and a warning list the keys that MJCF cannot express. Gravity
    is 9.81 m/s^2 along -z, of a planar pair along -y, unless [dynamics] gives it.
    """
    _write_model("MJCF", source, out, base, as_json)


def _write_model(kind: str, text: str, out: Path | None, base: str | None, as_json: bool) -> None:
    """Write what SCENE names as URDF or MJCF."""
    source = read_source(text)
    subject, write = source.subject, to_urdf if kind == "URDF" else to_mjcf
    if isinstance(source.named, Scene):
        source.named.refuse_linkage(f"{kind} files are written of trees of joints alone")
    check_output(out, source.files)
    chosen: dict[str, Any] = {} if base is None else {"base": base}
    if isinstance(subject, Mechanism):
        return write_text(write(subject, **chosen), out, source.files, as_json)
    pair: Any = subject.pair
    setup = subject.dynamics
    if kind == "MJCF":
        chosen["gravity"] = setup.gravity
        chosen.setdefault("base", "fixed" if pair.body1 is None else "free")
    space = pair if isinstance(pair, HingePair) else pair.to_spatial()
    if "dynamics" not in subject.tables.values:
        return write_text(write(space, **chosen), out, source.files, as_json)
    if base is None:
        bases = {PRESCRIBED: "fixed", "pinned": "free" if kind == "URDF" else "pinned"}
        chosen["base"] = bases.get(setup.base, setup.base)
    keys = ("damping", "friction", "stops", *(("stiffness", "rest") if kind == "MJCF" else ()))
    load = setup.loads.get("psi", HingeLoad())
    chosen["hinge_torque"] = HingeLoad(**{key: getattr(load, key) for key in keys})
    written = {*keys, *_SIMULATION} | ({"gravity"} if kind == "MJCF" else set())
    if kind == "MJCF" or chosen["base"] == "fixed":
        chosen["body1"] = setup.start
        written |= {"R1_0", "S1_0", "phi_0"}
    if base is not None or chosen["base"] == setup.base:
        written.add("base")
    left_out = [key for key in setup.keys if key.removeprefix("psi.") not in written]
    model = write(space, **chosen)
    if left_out:
        shown = ", ".join(f'base = "{setup.base}"' if key == "base" else key for key in left_out)
        sentence = f"{kind} cannot express these keys of [dynamics], which are left out: {shown}"
        warnings.warn(sentence, DynamicsWarning, stacklevel=2)
        model = commented(model, sentence)
    return write_text(model, out, source.files, as_json)
