"""`hingepair plot` and `hingepair view`: a figure of a motion, and a web page that shows a pair or a robot."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hingepair.cli.output import (
    PICTURE_SUFFIXES,
    OutputsOption,
    UnitsOption,
    check_output,
    check_picture_suffix,
    out_option,
    save_figure,
    split_names,
)
from hingepair.cli.scenes import SceneArgument
from hingepair.cli.sources import Body1FrameOption, Body2FrameOption, JointArgument, Source, load_named_scene
from hingepair.errors import ArgumentError
from hingepair.pictures.page import view as make_page
from hingepair.pictures.plot import plot as plot_figure
from hingepair.scenes.load import load_scene

# Part of the help of --out.
_DEFAULT_OUT = "default: the scene's name in the current folder, unless that file exists."


def plot_command(
    scene_file: SceneArgument,
    out: Annotated[
        Path | None,
        out_option(f"Write the figure to FILE ({', '.join(PICTURE_SUFFIXES)}); {_DEFAULT_OUT}"),
    ] = None,
    outputs: OutputsOption = None,
    units: UnitsOption = None,
) -> None:
    """Draw the motion of a scene over time and in space.

    The figure of a pair shows position, attitude, rates and psi over time, torque and force of the hinge if body 2
    has masses, the paths of both bodies, and the residual of E1 (common hinge point). That of a mechanism shows
    position, rate and torque of each moving joint with their limits, and the paths of its frames. With --outputs, or
    names in [outputs] of the scene, the figure shows these outputs over time; of a pair with masses also
    hinge_torque, bearing_torque, hinge_force, force1 and torque1.
    """
    if out is not None:
        check_picture_suffix("--out", out)
    out = out or _check_new_file(f"{scene_file.stem}.png")
    check_output("--out", out, [scene_file])
    scene, names = load_named_scene(scene_file), split_names("--outputs", outputs)
    figure = plot_figure(scene, names or scene.outputs, units)
    save_figure("--out", figure, out, scene.files, dpi=110)
    print(f"written: {out}")


def view_command(
    source: Annotated[str, typer.Argument(metavar="SCENE", help="Scene file (TOML), a robot's name or a URDF file.")],
    joint: JointArgument = None,
    body1_frame: Body1FrameOption = None,
    body2_frame: Body2FrameOption = None,
    out: Annotated[Path | None, out_option(f"Write the page to FILE (.html); {_DEFAULT_OUT}")] = None,
    meshes: Annotated[
        float,
        typer.Option(metavar="MB", help="Size of the meshes of a robot on the page; 0 draws simple shapes instead."),
    ] = 4.0,
    units: UnitsOption = None,
) -> None:
    """Write a web page that shows a pair or a robot in motion.

    The page is one HTML file for any browser. It needs no network and has a slider for each joint. A scene shows its
    motion. A scene without a motion, and the JOINT of a robot or URDF file, shows the hinge turning within its
    limits. A whole robot, given by its name or URDF file, is shown in its neutral pose. Angles of hinges are in
    degrees unless --units names another unit.
    """
    name = Path(source).stem if joint is None else f"{Path(source).stem}_{Path(joint).name}"
    out = out or _check_new_file(f"{name}.html")
    check_output("--out", out, [source])
    named = Source(source, joint, body1_frame, body2_frame)
    robot = named.robot() if named.is_whole else None
    if robot is not None:
        page = make_page(robot, meshes=meshes, units=units)
    elif named.has_motion:
        page = make_page(load_scene(source), meshes=meshes, units=units)
    else:
        page = make_page(named.spatial_pair(), units=units)
    path = page.save(out, named.files)
    content = page.shown if page.frames else page.joints
    unit = "instants" if page.frames else "joint" if page.joints == 1 else "joints"
    print(
        *(f"note: {note}" for note in page.notes),
        f"written: {path} ({content} {unit}; open it in a browser)",
        sep="\n",
    )


def _check_new_file(name: str) -> Path:
    """Return a path in the current folder; refuse one that exists."""
    path = Path(name)
    if path.exists() or path.is_symlink():
        raise ArgumentError(
            "--out", f"another file name, or --out {name}, which overwrites it", f"{name!r}, which exists"
        )
    return path
