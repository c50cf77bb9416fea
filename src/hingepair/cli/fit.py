"""`hingepair fit`: fit a hinge to the recorded motion of two bodies, and report on it."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from hingepair.cli.output import (
    PICTURE_SUFFIXES,
    JsonOption,
    check_output,
    check_picture_suffix,
    naming_option,
    out_option,
    save_figure,
)
from hingepair.cli.sources import ColumnOption, parse_columns
from hingepair.errors import ArgumentError, FitError, quoted
from hingepair.formats.imu_recordings import are_imus, read_imus
from hingepair.formats.recordings import ColumnAdvice, no_body_error, read_poses
from hingepair.measured.hinge import GAUGES
from hingepair.measured.hinge_fit import HingeFit, fit
from hingepair.measured.hinge_report import HingeReport
from hingepair.measured.imus import fit_imus
from hingepair.measured.robust import LOSSES
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.results import RESULT_FILE_SUFFIXES, Record, check_ending
from hingepair.rotations.matrices import rotation_vector
from hingepair.scenes.motions.known import quaternion_columns
from hingepair.tables.units import Units
from hingepair.tables.whole_file import whole_file


def fit_command(
    files: Annotated[
        list[Path],
        typer.Argument(
            metavar="FILE",
            help="One recording of both bodies, or two files: body 1, body 2; poses or inertial sensors.",
        ),
    ],
    loss: Annotated[
        str,
        typer.Option(help=f"Loss function: {', '.join(LOSSES)}. Choose cauchy if there may be outliers."),
    ] = "linear",
    gauge: Annotated[
        str,
        typer.Option(help=f"Point of the hinge axis that u1 and u2 lead to: {', '.join(GAUGES)}."),
    ] = GAUGES[0],
    ignore: Annotated[
        list[str] | None, typer.Option(metavar="COLUMN", help="Column that is not read; * matches any text.")
    ] = None,
    column: ColumnOption = None,
    sequence: Annotated[
        str | None,
        typer.Option(
            help="Axes of the Euler angles phi_x, phi_y, phi_z, such as ZYX of yaw, pitch, roll; default: XYZ."
        ),
    ] = None,
    gaps: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            help="Longest gap between samples over which one clock's poses are interpolated to the other clock.",
        ),
    ] = 0.05,
    out: Annotated[
        Path | None,
        out_option(f"Write psi and the residuals of each sample to FILE ({', '.join(RESULT_FILE_SUFFIXES)})."),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help=f"Draw psi and the residuals over time ({', '.join(PICTURE_SUFFIXES)})."),
    ] = None,
    scene: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write a scene (.toml) of the fitted pair with the recorded motion, and its log (.csv); neither may "
            "exist.",
        ),
    ] = None,
    clock_offset: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            help="Delay of body 2's samples relative to their time stamps, if known; 0: both bodies have one clock. "
            "Default: it is estimated.",
        ),
    ] = None,
    units: Annotated[
        str | None,
        typer.Option(
            metavar="UNITS",
            help='Units of what is printed and drawn and of --out, such as "deg, mm"; JSON and scenes are in SI '
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
    outputs = _Outputs(files, out, plot, scene, units)
    outputs.check()
    columns = parse_columns(column or ())
    fitted: HingeReport
    body1 = None
    try:
        if are_imus(files, columns):
            of_poses = {"loss": loss != "linear", "gauge": gauge != GAUGES[0], "sequence": sequence,
                        "scene": scene, "clock_offset": clock_offset}  # fmt: skip
            for name, value in of_poses.items():
                if value not in {None, False}:
                    raise ArgumentError(name, "recordings of poses", "inertial sensors")
            imu1, imu2 = read_imus(files, columns)
            fitted = fit_imus(imu1, imu2, gaps)
        else:
            recording = read_poses(files, columns, ignore or (), gaps, sequence, _COLUMN_OPTIONS)
            if scene is not None and recording.t is None:
                raise ArgumentError("scene", "a recording with a column t", "none")
            if recording.body2 is None:
                raise no_body_error("2", files)
            body1, body2, t = recording.body1, recording.body2, recording.t
            fitted = fit(body1, body2, loss, gauge, t, clock_offset=clock_offset)
    except FitError as error:
        print(json.dumps({"ok": False, "findings": [str(error)]}, indent=2) if as_json else f"NO HINGE: {error}")
        raise typer.Exit(1) from None
    outputs.write(fitted, body1)
    print(fitted.to_json() if as_json else fitted.text(units))
    for path in () if as_json else outputs.written:
        print(f"written: {path}")
    raise typer.Exit(0 if fitted.ok else 1)


# What messages on columns advise.
_COLUMN_OPTIONS = ColumnAdvice("--column '{ours}={name}'", "--column '{ours}={name}:{unit}'", "--ignore {name!r}")


@dataclass
class _Outputs:
    """Files that the command reads and writes."""

    files: list[Path]
    out: Path | None
    plot: Path | None
    scene: Path | None
    units: str | None
    written: list[Path] = field(default_factory=list)

    def check(self) -> None:
        """Raise an ArgumentError if a suffix does not fit, or if a file cannot be written."""
        if self.out is not None:
            check_ending(self.out)
        if self.plot is not None:
            check_picture_suffix("plot", self.plot)
        for option, path in (("out", self.out), ("plot", self.plot)):
            check_output(option, path, self.files)
        if self.scene is not None:
            self._check_scene(self.scene)

    def _check_scene(self, scene: Path) -> None:
        """Raise an ArgumentError if the scene or its log exists: users edit the one, and do not name the other."""
        if scene.suffix.lower() != ".toml":
            raise ArgumentError("scene", "a file name that ends in .toml", quoted(str(scene)))
        log = scene.with_suffix(".csv")
        for path in (scene, log):
            if path.exists() or path.is_symlink():
                raise ArgumentError("scene", f"the name of new files, since {path} exists", quoted(str(scene)))
            check_output("scene", path)
        if self.out is not None and os.path.abspath(self.out) == os.path.abspath(log):
            wanted = f"another name, since --out and it would both write {log}"
            raise ArgumentError("scene", wanted, quoted(str(scene)))

    def write(self, fitted: HingeReport, body1: BodyMotion | None) -> None:
        """Write all files; an error says which are complete."""
        try:
            if self.out is not None:
                self.written.append(fitted.record().save(self.out, self.files, self.units))
            if self.plot is not None:
                save_figure("plot", fitted.plot(self.units), self.plot, self.files)
                self.written.append(self.plot)
            if self.scene is not None and body1 is not None and isinstance(fitted, HingeFit):
                with naming_option("scene"):
                    self.written += _save_scene(self.scene, fitted, body1, self.files)
        except ArgumentError as error:
            if self.written:
                error.add_note(f"written before: {', '.join(map(str, self.written))}")
            raise


def _save_scene(path: Path, fitted: HingeFit, body1: BodyMotion, inputs: list[Path]) -> list[Path]:
    """Write a scene of the fitted pair, and beside it a log (.csv) with the recorded motion of body 1 and the fitted
    psi; return both paths.
    """
    log = path.with_suffix(".csv")
    t = np.asarray(fitted.t)
    places = np.broadcast_to(body1.R, (t.size, 3))
    attitudes = np.broadcast_to(body1.S, (t.size, 3, 3))
    columns = dict(zip("xyz", places.T, strict=True)) | quaternion_columns(attitudes)
    Record(t, columns | {"psi": fitted.psi}, "recorded motion of body 1 and fitted psi").save(log, inputs)
    pair = fitted.pair
    lines = [f"{name} = {getattr(pair, name).tolist()}" for name in ("u1", "u2", "n")]
    turn = np.asarray(rotation_vector(pair.home))
    angle = float(np.linalg.norm(turn))
    if angle > 0:
        lines.append(f"home = {{ axis = {(turn / angle).tolist()}, rad = {angle!r} }}")
    text = "\n".join(
        (
            f'title = "A fitted hinge, moved as recorded: {fitted.samples} samples"',
            "",
            "[pair]",
            *lines,
            "",
            "[motion]",
            f"file = {json.dumps(log.name)}",
            "smooth = true",
            f"loss = {json.dumps(fitted.loss)}",  # outliers of the log count as little as they did in the fit
            "",
        )
    )
    with whole_file(path, inputs) as file:
        file.write(text.encode())
    return [path, log]
