"""`hingepair plot SCENE` and `view SCENE`: a figure of the motion, and a page on which a pair or a robot moves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hingepair.cli.output import PICTURES, Outputs, check_picture, console, file_option, listed, save_figure
from hingepair.cli.pairs import Frame1, Frame2, Joint, inputs_of, named, named_robot, named_scene
from hingepair.cli.scenes import SceneFile
from hingepair.errors import ArgumentError
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pictures.page import view as page_of
from hingepair.pictures.plot import plot as figure_of

_NAMED = "unless told, here and named as the scene is, where no such file exists."


def plot(
    scene_file: SceneFile,
    out: Annotated[Path | None, file_option(f"Where the figure goes ({', '.join(PICTURES)}); {_NAMED}")] = None,
    outputs: Outputs = None,
) -> None:
    """Draw a scene over time and in space.

    Position, attitude and rates over time, psi, paths in space, the residual of E1. Of a mechanism position, rate
    and torque of each joint that moves, with their limits, and the paths of its frames. Or some outputs over time.
    """
    out = out or _unused(f"{scene_file.stem}.png")
    check_picture("--out", out)
    scene = named_scene(scene_file)
    figure = figure_of(scene, listed("--outputs", outputs))
    save_figure(figure, out, scene.files, dpi=110)
    console().print(f"written: {out}")


def view(
    source: Annotated[str, typer.Argument(metavar="SCENE", help="Scene file (TOML), a robot's name or a URDF file.")],
    joint: Joint = None,
    body1_frame: Frame1 = None,
    body2_frame: Frame2 = None,
    out: Annotated[Path | None, file_option(f"Where the page goes; {_NAMED}")] = None,
) -> None:
    """Write a web page on which a pair or a robot moves.

    One HTML file for any browser, without a network, with a slider for each joint. A scene moves as it says; without
    a motion, and of the JOINT of a robot or of a URDF file, the hinge turns through its limits. A whole robot, by its
    name or URDF file, stands in the neutral pose.
    """
    frames = (body1_frame, body2_frame)
    robot = None if joint is not None or any(frames) else named_robot(source)
    shown = robot or named(source, joint, *frames)
    name = Path(source).stem if joint is None else f"{Path(source).stem}_{Path(joint).name}"
    out = out or _unused(f"{name}.html")
    page = page_of(shown.to_spatial() if isinstance(shown, PlanarPair) else shown)
    path = page.save(out, inputs_of(source))
    content = page.shown if page.frames else page.joints
    unit = "instants" if page.frames else "joint" if page.joints == 1 else "joints"
    console().print(f"written: {path} ({content} {unit}; open it in a browser)")


def _unused(name: str) -> Path:
    """Return a file of this name in the current folder; refuse one that exists, which nobody asked to overwrite."""
    path = Path(name)
    if path.exists() or path.is_symlink():
        raise ArgumentError("--out", f"a file name, since {name} exists (--out {name} overwrites it)", "none")
    return path
