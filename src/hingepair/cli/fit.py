"""`hingepair fit`: fit a hinge to the recorded motion of two bodies, and report on it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from hingepair.cli.options import PICTURE_SUFFIXES, ColumnOption, JsonOption, out_option, parse_columns
from hingepair.cli.output import check_output, save_figure, show
from hingepair.errors import ArgumentError, FitError, quoted
from hingepair.formats.recordings import are_imus, no_body_error, read_imus, read_recording
from hingepair.measured.hinge_fit import HingeFit, fit
from hingepair.measured.hinge_report import HingeReport
from hingepair.measured.imus import fit_imus
from hingepair.measured.statistics import LOSSES
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.results import RESULT_FILE_SUFFIXES, Record
from hingepair.pictures.plot import plot
from hingepair.rotations.matrices import rotation_vector
from hingepair.scenes.motions.known import quaternion_columns
from hingepair.tables.units import Units
from hingepair.tables.whole_file import whole_file

_ENDINGS = (*RESULT_FILE_SUFFIXES, *PICTURE_SUFFIXES, ".toml")
_GAPS = 0.05  # longest gap between samples over which one clock's poses are interpolated to the other [s]


def fit_command(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help="One recording of both bodies, or two files: body 1, body 2; poses or inertial sensors.",
        ),
    ],
    loss: Annotated[
        str, typer.Option(help=f"Loss function: {', '.join(LOSSES)}. Choose cauchy if there may be outliers.")
    ] = "linear",
    column: ColumnOption = None,
    sequence: Annotated[
        str | None,
        typer.Option(
            help="Axes of the Euler angles phi_x, phi_y, phi_z, such as ZYX of yaw, pitch, roll; default: XYZ."
        ),
    ] = None,
    out: Annotated[
        list[Path] | None,
        out_option(
            "Write FILE; may be repeated. Its ending decides what: psi and the residuals of each sample "
            f"({', '.join(RESULT_FILE_SUFFIXES)}), a figure of them ({', '.join(PICTURE_SUFFIXES)}), or a scene of "
            "the fitted pair with the recorded motion (.toml), beside its log (.csv); neither of these may exist."
        ),
    ] = None,
    clock_offset: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="0: both bodies have one clock. Default: the time by which body 2 is late is estimated.",
        ),
    ] = None,
    units: Annotated[
        str | None,
        typer.Option(
            metavar="UNITS",
            help='Units of what is printed and drawn and of tables, such as "deg, mm"; JSON and scenes are in SI '
            "units. Default: m, and mm and deg for what is left.",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Fit a hinge to the recorded motion of two bodies.

    The results are n, home, u1, u2 and psi with their standard deviations, and a verdict on whether the motion is
    that of a hinge. Columns are read by name: t; R1_x, R1_y, R1_z or x1, y1, z1; S1_xx, ..., S1_zz, or qx1, qy1,
    qz1, qw1, or Euler angles phi_x1, phi_y1, phi_z1; in the plane x1, y1, phi_z1 alone. For body 2 they are these
    names with 2, or only the position of a point whose attitude was not measured. If each body has a file of its own,
    the first file is that of body 1, and names need no digit. Two files of inertial sensors have t, omega_x, omega_y,
    omega_z, force_x, force_y and force_z, angular velocity and specific force. Units other than SI units stand behind
    a name, such as "phi_z1 [deg]", or in --column phi_z1=Kurs:compass: degrees, clockwise from north. The exit code
    is 1 if the recordings do not determine a hinge.
    """
    Units.of(units)  # refuses unknown ones before anything is computed
    _check_outputs(out or (), files)
    scenes = [path for path in out or () if path.suffix.lower() == ".toml"]
    columns, body1 = parse_columns(column), None
    fitted: HingeReport
    try:
        if are_imus(files, columns):
            of_poses = {"loss": loss != "linear", "sequence": sequence, "out": scenes, "clock_offset": clock_offset}
            for name, value in of_poses.items():
                if value not in (None, False, []):
                    raise ArgumentError(name, "recordings of poses", "inertial sensors")
            fitted = fit_imus(*read_imus(files, columns))
        else:
            recording = read_recording(*files, columns=columns, gaps=_GAPS, sequence=sequence)
            body1, body2, t = recording.body1, recording.body2, recording.t
            if scenes and t is None:
                raise ArgumentError("out", "a recording with a column t for a scene", "none")
            if body2 is None:
                raise no_body_error("2", files)
            fitted = fit(body1, body2, loss, t=t, clock_offset=clock_offset)
    except FitError as error:
        show(as_json, {"ok": False, "findings": [str(error)]}, f"NO HINGE: {error}")
        raise typer.Exit(1) from None
    written = [*(path.with_suffix(".csv") for path in scenes), *(out or ())]
    show(as_json, json.loads(fitted.to_json()) | {"files": [*map(str, written)]}, fitted.text(units))
    for path in out or ():
        _write(path, fitted, body1, files, units)
        if not as_json:
            print(f"written: {path}")
    raise typer.Exit(0 if fitted.ok else 1)


def _check_outputs(out: Sequence[Path], files: Sequence[Path]) -> None:
    """Raise an ArgumentError if a file cannot be written, or if a scene or its log exists: users edit the one, and do
    not name the other.
    """
    for path in out:
        check_output(path, files, _ENDINGS)
        for new in (path, path.with_suffix(".csv")) if path.suffix.lower() == ".toml" else ():
            if new.exists() or new.is_symlink() or (new != path and new in out):
                raise ArgumentError("path", f"the name of new files, and not of {new}", quoted(str(path)))


def _write(
    path: Path, fitted: HingeReport, body1: BodyMotion | None, inputs: Sequence[Path], units: str | None
) -> None:
    """Write one output; of a scene also its log, with the recorded motion of body 1 and the fitted psi."""
    if path.suffix.lower() in RESULT_FILE_SUFFIXES:
        fitted.record().save(path, inputs, units)
    elif path.suffix.lower() in PICTURE_SUFFIXES:
        save_figure(plot(fitted, units=units), path, inputs)
    elif isinstance(fitted, HingeFit) and body1 is not None:
        t, log = np.asarray(fitted.t), path.with_suffix(".csv")
        places, attitudes = np.broadcast_to(body1.R, (t.size, 3)), np.broadcast_to(body1.S, (t.size, 3, 3))
        columns = dict(zip("xyz", places.T, strict=True)) | quaternion_columns(attitudes) | {"psi": fitted.psi}
        Record(t, columns, "recorded motion of body 1 and fitted psi").save(log, inputs)
        with whole_file(path, inputs) as file:
            file.write(_scene_text(fitted, log.name).encode())


def _scene_text(fitted: HingeFit, log: str) -> str:
    """Return the scene of a fitted pair that moves as in a log."""
    turn = np.asarray(rotation_vector(fitted.pair.home))
    angle = float(np.linalg.norm(turn))
    home = f"home = {{ axis = {(turn / angle).tolist()}, rad = {angle!r} }}\n" if angle > 0 else ""
    vectors = "".join(f"{name} = {getattr(fitted.pair, name).tolist()}\n" for name in ("u1", "u2", "n"))
    # Outliers of the log count as little as they did in the fit.
    return f"""title = "A fitted hinge, moved as recorded: {fitted.samples} samples"

[pair]
{vectors}{home}
[motion]
file = {json.dumps(log)}
smooth = true
loss = {json.dumps(fitted.loss)}
"""
