"""`hingepair fit FILE...`: the hinge of two recorded bodies."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from hingepair.cli.output import PICTURES, Json, check_picture, console, file_option, save_figure
from hingepair.errors import ArgumentError, FitError, quoted
from hingepair.formats.recordings import read_recording
from hingepair.measured.hinge import GAUGES
from hingepair.measured.hinge_fit import HingeFit, fit
from hingepair.measured.likelihood import LOSSES
from hingepair.numeric.whole_file import whole_file
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.results import ENDINGS, Record, check_ending
from hingepair.rotations.matrices import rotation_vector
from hingepair.scenes.known_motion import quaternion_columns


def fit_files(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="Poses of both bodies in one file, or of each in a file of its own."),
    ],
    loss: Annotated[
        str, typer.Option(help=f"Of a sample: {', '.join(LOSSES)}; cauchy where there may be outliers.")
    ] = "linear",
    gauge: Annotated[str, typer.Option(help=f"Which point of the axis u1, u2 name: {', '.join(GAUGES)}.")] = GAUGES[
        0
    ],
    ignore: Annotated[
        list[str] | None, typer.Option(metavar="COLUMN", help="A column of no concern; * stands for anything.")
    ] = None,
    gaps: Annotated[
        float, typer.Option(metavar="SECONDS", help="Longest time without a sample that is bridged between clocks.")
    ] = 0.05,
    out: Annotated[
        Path | None, file_option(f"Write psi and what is left of each sample ({', '.join(ENDINGS)}).")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help=f"Draw psi and what is left over time ({', '.join(PICTURES)})."),
    ] = None,
    scene: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write a scene (.toml) of the fitted pair, moved as recorded, and its log (.csv)."
        ),
    ] = None,
    clock_offset: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="By how much later body 2 was recorded than its stamps say, where that is known; 0: one clock. "
            "Otherwise it is estimated.",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Find the hinge of two recorded bodies.

    Its n, home, u1, u2 and psi, how sure they are, and whether it is a hinge. Columns, by name: t; R1_x, R1_y,
    R1_z or x1, y1, z1; S1_xx, ..., S1_zz or qx1, qy1, qz1, qw1; of body 2 the same with 2. Where each body has a
    file, the first is body 1, and the digit may be left away. Exit code 1: there is no hinge to rely on.
    """
    if out is not None:
        check_ending(out)
    if plot is not None:
        check_picture("plot", plot)
    if scene is not None and scene.suffix.lower() != ".toml":
        raise ArgumentError("scene", "a file name that ends in .toml", quoted(str(scene)))
    recording = read_recording(files, ignore or (), gaps)
    if scene is not None and recording.t is None:
        raise ArgumentError("scene", "a recording with a column t", "none")
    try:
        found = fit(recording.body1, recording.body2, loss, gauge, recording.t, clock_offset=clock_offset)
    except FitError as error:
        if as_json:
            print(json.dumps({"ok": False, "findings": [str(error)]}, indent=2))
        else:
            console().print(f"NO HINGE: {error}")
        raise typer.Exit(1) from None
    written = []
    if out is not None:
        t = np.arange(float(found.psi.size)) if found.t is None else found.t
        arrays = {"psi": found.psi, "gap": found.gap, "tilt": found.tilt, "weight": found.weights}
        written.append(Record(t, arrays, "what is left of each sample").save(out, files))
    if plot is not None:
        save_figure(found.plot(), plot, files)
        written.append(plot)
    if scene is not None:
        written += _save_scene(scene, found, recording.body1, files)
    print(found.to_json() if as_json else found)
    for path in () if as_json else written:
        console().print(f"written: {path}")
    raise typer.Exit(0 if found.ok else 1)


def _save_scene(path: Path, found: HingeFit, body1: BodyMotion, inputs: list[Path]) -> list[Path]:
    """Write a scene of a fitted pair that smooths the recorded motion of body 1 and psi, and the log beside it."""
    log = path.with_suffix(".csv")
    t = np.asarray(found.t)
    places = np.broadcast_to(body1.R, (t.size, 3))
    attitudes = np.broadcast_to(body1.S, (t.size, 3, 3))
    columns = dict(zip("xyz", places.T, strict=True)) | quaternion_columns(attitudes)
    Record(t, columns | {"psi": found.psi}, "recorded motion of body 1 and fitted psi").save(log, inputs)
    pair = found.pair
    lines = [f"{name} = {getattr(pair, name).tolist()}" for name in ("u1", "u2", "n")]
    turn = np.asarray(rotation_vector(pair.home))
    angle = float(np.linalg.norm(turn))
    if angle > 0:
        lines.append(f"home = {{ axis = {(turn / angle).tolist()}, rad = {angle!r} }}")
    text = "\n".join(
        (
            f'title = "A fitted hinge, moved as recorded: {found.samples} samples"',
            "",
            "[pair]",
            *lines,
            "",
            "[motion]",
            f"file = {json.dumps(log.name)}",
            "smooth = true",
            "",
        )
    )
    with whole_file(path, inputs) as file:
        file.write(text.encode())
    return [path, log]
