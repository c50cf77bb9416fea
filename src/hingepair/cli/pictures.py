"""`hingepair plot` and `hingepair view`: a figure of a motion, and a web page that shows a pair or a robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from hingepair.cli.options import (
    PICTURE_SUFFIXES,
    JsonOption,
    OutputsOption,
    SceneArgument,
    SourceArgument,
    UnitsOption,
    out_option,
    split_names,
)
from hingepair.cli.output import check_output, new_file, save_figure, show
from hingepair.cli.sources import read_scene, read_source
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.pictures.page import view
from hingepair.pictures.plot import plot

# Part of the help of --out.
_DEFAULT_OUT = "default: the scene's name in the current folder, unless that file exists."


def plot_command(
    scene_file: SceneArgument,
    out: Annotated[
        Path | None, out_option(f"Write the figure to FILE ({', '.join(PICTURE_SUFFIXES)}); {_DEFAULT_OUT}")
    ] = None,
    outputs: OutputsOption = None,
    units: UnitsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Draw the motion of a scene over time and in space.

    The figure of a pair shows position, attitude, rates and psi over time, torque and force of the hinge if body 2
    has masses, and the paths of both bodies. That of a mechanism shows position, rate and torque of each moving joint
    with their limits, and the paths of its frames. With --outputs, or names in [outputs] of the scene, the figure
    shows these outputs over time; of a pair with masses also hinge_torque, bearing_torque, hinge_force, force1 and
    torque1.
    """
    out = out or new_file(f"{scene_file.stem}.png")
    check_output(out, [scene_file], PICTURE_SUFFIXES)
    scene, names = read_scene(scene_file), split_names("outputs", outputs)
    save_figure(plot(scene, names or scene.outputs, units), out, scene.files)
    show(as_json, {"file": str(out)}, f"written: {out}")


def view_command(
    source: SourceArgument,
    out: Annotated[Path | None, out_option(f"Write the page to FILE (.html); {_DEFAULT_OUT}")] = None,
    meshes: Annotated[
        float,
        typer.Option(metavar="MB", help="Size of the meshes of a robot on the page; 0 draws simple shapes instead."),
    ] = 4.0,
    units: UnitsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Write a web page that shows a pair or a robot in motion.

    The page is one HTML file for any browser. It needs no network and has a slider for each joint. A scene shows its
    motion; the pair of a scene without one turns within its limits, and a robot is shown in its neutral pose. Angles
    of hinges are in degrees unless --units names another unit.
    """
    out = out or new_file(f"{Path(source).stem}.html")
    check_output(out, [source])
    read = read_source(source)
    if not isinstance(read.named, Mechanism) and read.named.has_motion:
        shown: Any = read.named.checked()
    else:
        shown = read.subject if isinstance(read.subject, Mechanism) else read.subject.pair
    page = view(shown.to_spatial() if isinstance(shown, PlanarPair) else shown, meshes=meshes, units=units)
    path, count = page.save(out, read.files), page.shown if page.frames else page.joints
    unit = "instants" if page.frames else "joint" if page.joints == 1 else "joints"
    notes = [f"note: {note}" for note in page.notes]
    facts = {"file": str(path), unit: count, "notes": page.notes}
    show(as_json, facts, *notes, f"written: {path} ({count} {unit}; open it in a browser)")
