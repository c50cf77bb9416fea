"""`hingepair urdf` and `hingepair mjcf`: pairs and robots as files of other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hingepair.cli.options import JsonOption, SourceArgument, TextFileOption
from hingepair.cli.output import check_output, write_text
from hingepair.cli.sources import read_source
from hingepair.formats.model_writers import to_mjcf, to_urdf
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.mechanism import Mechanism
from hingepair.scenes.motions.simulated import PRESCRIBED
from hingepair.scenes.scene import Scene

BaseOption = Annotated[
    str | None,
    typer.Option(
        help="free; fixed: body 1 is fixed in the world; floating (URDF): a floating joint joins body 1 to a link "
        "`world`. Default: that of [dynamics]; without it free, in MJCF fixed if body 1 has no mass."
    ),
]


def urdf_command(
    source: SourceArgument, out: TextFileOption = None, base: BaseOption = None, as_json: JsonOption = False
) -> None:
    """Write a pair, or the mechanism of a scene, as a URDF file.

    A scene needs no motion. Of the table [dynamics] of a pair, the base, damping, friction and stops are written.
    """
    _write_model("URDF", source, out, base, as_json)


def mjcf_command(
    source: SourceArgument, out: TextFileOption = None, base: BaseOption = None, as_json: JsonOption = False
) -> None:
    """Write a pair, or the mechanism of a scene, as a MuJoCo model (MJCF).

    A scene needs no motion. Of the table [dynamics] of a pair, the base, the pose of body 1 at the start, gravity,
    spring, damping, friction and stops are written. Gravity is 9.81 m/s^2 along -z, of a planar pair along -y, unless
    [dynamics] gives it.
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
    space, setup = subject.space, subject.dynamics
    if kind == "MJCF":
        chosen["gravity"] = setup.gravity
        chosen.setdefault("base", "fixed" if space.body1 is None else "free")
    if "dynamics" not in subject.tables.values:
        return write_text(write(space, **chosen), out, source.files, as_json)
    if base is None:
        bases = {PRESCRIBED: "fixed", "pinned": "free" if kind == "URDF" else "pinned"}
        chosen["base"] = bases.get(setup.base, setup.base)
    keys = ("damping", "friction", "stops", *(("stiffness", "rest") if kind == "MJCF" else ()))
    load = setup.loads.get("psi", HingeLoad())
    chosen["hinge_torque"] = HingeLoad(**{key: getattr(load, key) for key in keys})
    if kind == "MJCF" or chosen["base"] == "fixed":
        chosen["body1"] = setup.start
    return write_text(write(space, **chosen), out, source.files, as_json)
