"""`hingepair plot SCENE` and `view SCENE`: a figure of the motion, and a page on which the pair moves."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from hingepair.cli.output import PICTURES, Outputs, check_picture, console, file_option, listed, save_figure
from hingepair.cli.pairs import Frame1, Frame2, Joint, Source, inputs_of, named, of_a_pair
from hingepair.cli.scenes import SceneFile
from hingepair.errors import ArgumentError
from hingepair.pair.planar_pair import PlanarPair
from hingepair.pictures.page import view as page_of
from hingepair.pictures.plot import plot as figure_of
from hingepair.scenes.scene import load_scene

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
    scene = load_scene(scene_file)
    figure = figure_of(scene, listed("--outputs", outputs))
    save_figure(figure, out, scene.files, dpi=110)
    console().print(f"written: {out}")


def view(
    source: Source,
    joint: Joint = None,
    body1_frame: Frame1 = None,
    body2_frame: Frame2 = None,
    out: Annotated[Path | None, file_option(f"Where the page goes; {_NAMED}")] = None,
) -> None:
    """Write a web page on which the pair moves.

    One HTML file for any browser, without a network. A scene moves as it says; without a motion, and of the
    joint of a robot or of a URDF file, the hinge turns through its limits.
    """
    found = of_a_pair(named(source, joint, body1_frame, body2_frame))
    name = Path(source).stem if joint is None else f"{Path(source).stem}_{Path(joint).name}"
    out = out or _unused(f"{name}.html")
    page = page_of(found.to_spatial() if isinstance(found, PlanarPair) else found)
    path = page.save(out, inputs_of(source))
    console().print(f"written: {path} ({page.shown} instants; open it in a browser)")


def _unused(name: str) -> Path:
    """Return a file of this name in the current folder; refuse one that exists, which nobody asked to overwrite."""
    path = Path(name)
    if path.exists() or path.is_symlink():
        raise ArgumentError("--out", f"a file name, since {name} exists (--out {name} overwrites it)", "none")
    return path
