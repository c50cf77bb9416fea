"""`hingepair fit`: fit a hinge to the recorded motion of two bodies, and report on it."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
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
from hingepair.formats.recordings import ColumnAdvice, no_body_error, read_poses
from hingepair.measured.hinge import GAUGES
from hingepair.measured.hinge_fit import HingeFit, fit
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
        typer.Argument(metavar="FILE", help="One recording of both bodies, or two files: body 1, body 2."),
    ],
    loss: Annotated[
        str,
        typer.Option(help=f"Loss function: {', '.join(LOSSES)}. Choose cauchy if there may be outliers."),
    ] = "linear",
    gauge: Annotated[
        str,
        typer.Option(help=f"Point of the hinge axis that u1 and u2 lead to: {', '.join(GAUGES)}."),
    ] = GAUGES[0],
    n_along: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Direction in body 1's axes, such as 0,0,-1, along which n is to point, which gives psi its sign.",
        ),
    ] = None,
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
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write a report (.md) of the hinge, its standard deviations, residuals, findings and advice; with "
            "--plot it shows the figure.",
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
    the first file is that of body 1, and names need no digit. Units other than SI units stand behind a name, such as
    "phi_z1 [deg]", or in --column phi_z1=Kurs:compass: degrees, clockwise from north. The exit code is 1 if the
    recordings do not determine a hinge.
    """
    Units.of(units)  # refuses unknown ones before anything is computed
    outputs = _Outputs(files, out, plot, scene, report, units)
    outputs.check()
    along = None if n_along is None else _parse_direction(n_along)
    columns = parse_columns(column or ())
    recording = read_poses(files, columns, ignore or (), gaps, sequence, _COLUMN_OPTIONS)
    if scene is not None and recording.t is None:
        raise ArgumentError("scene", "a recording with a column t", "none")
    if recording.body2 is None:
        raise no_body_error("2", files)
    body1, body2, t = recording.body1, recording.body2, recording.t
    try:
        fitted = fit(body1, body2, loss, gauge, t, clock_offset=clock_offset, n_along=along)
    except FitError as error:
        outputs.write_report(_report_without_hinge(error, files))
        print(json.dumps({"ok": False, "findings": [str(error)]}, indent=2) if as_json else f"NO HINGE: {error}")
        raise typer.Exit(1) from None
    outputs.write(fitted, body1)
    print(fitted.to_json() if as_json else fitted.text(units))
    for path in () if as_json else outputs.written:
        print(f"written: {path}")
    raise typer.Exit(0 if fitted.ok else 1)


# What messages on columns advise.
_COLUMN_OPTIONS = ColumnAdvice("--column '{ours}={name}'", "--column '{ours}={name}:{unit}'", "--ignore {name!r}")


def _parse_direction(text: str) -> list[float]:
    """Return the numbers in the value of --n-along; how many is checked later."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ArgumentError("n_along", "three numbers separated by commas", repr(text)) from None


@dataclass
class _Outputs:
    """Files that the command reads and writes."""

    files: list[Path]
    out: Path | None
    plot: Path | None
    scene: Path | None
    report: Path | None
    units: str | None
    written: list[Path] = field(default_factory=list)

    def check(self) -> None:
        """Raise an ArgumentError if a suffix does not fit, or if a file cannot be written."""
        if self.out is not None:
            check_ending(self.out)
        if self.plot is not None:
            check_picture_suffix("plot", self.plot)
        for option, path, suffix in (("scene", self.scene, ".toml"), ("report", self.report, ".md")):
            if path is not None and path.suffix.lower() != suffix:
                raise ArgumentError(option, f"a file name that ends in {suffix}", quoted(str(path)))
        for option, path in (("out", self.out), ("plot", self.plot), ("report", self.report)):
            check_output(option, path, self.files)
        if self.scene is not None:
            self._check_scene(self.scene)

    def _check_scene(self, scene: Path) -> None:
        """Raise an ArgumentError if the scene or its log exists: users edit the one, and do not name the other."""
        log = scene.with_suffix(".csv")
        for path in (scene, log):
            if path.exists() or path.is_symlink():
                raise ArgumentError("scene", f"the name of new files, since {path} exists", quoted(str(scene)))
            check_output("scene", path)
        if self.out is not None and os.path.abspath(self.out) == os.path.abspath(log):
            wanted = f"another name, since --out and it would both write {log}"
            raise ArgumentError("scene", wanted, quoted(str(scene)))

    def write(self, fitted: HingeFit, body1: BodyMotion) -> None:
        """Write all files; an error says which are complete."""
        try:
            if self.out is not None:
                self.written.append(fitted.record().save(self.out, self.files, self.units))
            if self.plot is not None:
                save_figure("plot", fitted.plot(self.units), self.plot, self.files)
                self.written.append(self.plot)
            if self.scene is not None:
                with naming_option("scene"):
                    self.written += _save_scene(self.scene, fitted, body1, self.files)
            figure = None
            if self.plot is not None and self.report is not None:
                figure = os.path.relpath(self.plot, self.report.parent)
            self.write_report(_report(fitted, self.files, figure, self.units))
        except ArgumentError as error:
            if self.written:
                error.add_note(f"written before: {', '.join(map(str, self.written))}")
            raise

    def write_report(self, text: str) -> None:
        """Write the report, if one is wanted."""
        if self.report is not None:
            with naming_option("report"):
                _save_text(self.report, text, self.files)
            self.written.append(self.report)


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
            "",
        )
    )
    _save_text(path, text, inputs)
    return [path, log]


def _save_text(path: Path, text: str, inputs: list[Path]) -> None:
    """Write text to the file `path`, completely or not at all."""
    with whole_file(path, inputs) as file:
        file.write(text.encode())


def _report_without_hinge(error: FitError, inputs: list[Path]) -> str:
    """Return the Markdown text of the report on recordings that determine no hinge."""
    return "\n".join((*_heading(inputs), "**No hinge.** These recordings determine none:", "", f"- {error}", ""))


def _report(fitted: HingeFit, inputs: list[Path], figure: str | None, units: str | None) -> str:
    """Return the Markdown text of the report on a HingeFit."""
    lengths = Units.of(units)
    fine = lengths.over(Units("deg, mm"))
    verdict = "**ok**: the motion shows a hinge and determines it." if fitted.ok else "**Not reliable.**"
    missing = fitted.psi.size - fitted.samples
    lines = [
        *_heading(inputs),
        f"{verdict} {fitted.samples} samples, {missing} missing; loss {fitted.loss}.",
        "",
        "## Hinge",
        "",
        *_hinge_table(fitted, lengths, fine),
        "",
        f"u1 and u2 lead to the point on the axis {fitted.gauge.replace('_', ' ')}; along the axis, motion "
        "determines only their difference. home is a rotation vector in the axes of body 1. Each number is followed "
        f"by its standard deviation. {fitted.conventions}",
        "",
        "## Residuals",
        "",
        *_residual_table(fitted, fine),
        "",
        *(() if figure is None else (f"![Hinge angle and residuals over time]({figure.replace(os.sep, '/')})", "")),
        "## Findings",
        "",
        *(f"- {text}" for text in fitted.findings or ("None.",)),
        "",
        "## What to do",
        "",
        *(f"- {text}" for text in _advice(fitted)),
        "",
    ]
    if fitted.ok:
        names = ("u1", "u2", "n", "home")
        code = (f"{name} = {getattr(fitted.pair, name).tolist()}" for name in names)
        call = "pair = hingepair.HingePair(u1=u1, u2=u2, n=n, home=home)"
        lines += ["## The pair in Python", "", "```python", *code, call, "```", ""]
    return "\n".join(lines)


def _heading(inputs: list[Path]) -> list[str]:
    """Return the lines of a report's heading, which names the files `inputs`."""
    return [f"# The hinge of {' and '.join(f'`{path.name}`' for path in inputs)}", ""]


def _hinge_table(fitted: HingeFit, lengths: Units, fine: Units) -> list[str]:
    """Return the lines of a Markdown table of what was fitted, u1 and u2 in `lengths` and angles in `fine`."""
    pair, angle = fitted.pair, fine.unit("rad")
    vectors = [(name, getattr(pair, name), lengths.factor("m"), lengths.unit("m")) for name in ("u1", "u2")]
    vectors += [("n", pair.n, 1.0, "1")]
    if fitted.body2.S is not None:
        vectors += [("home", np.asarray(rotation_vector(pair.home)), fine.factor("rad"), angle)]
    rows = []
    for name, values, factor, unit in vectors:
        both = zip(factor * values, factor * np.asarray(fitted.std[name]), strict=True)
        rows.append((name, ", ".join(f"{value:.6g} ± {std:.2g}" for value, std in both), unit))
    each = float(np.nanmedian(fitted.std["psi"]))
    low, high, each = (fine.factor("rad") * size for size in (*fitted.psi_range, each))
    rows.append(("psi", f"{low:.4g} to {high:.4g}, each ± {each:.2g}", angle))
    if fitted.clock_offset is not None:
        std = 1e3 * float(fitted.std["clock_offset"])
        spread = f"± {std:.2g}" if std else "(given)"
        known = f"{1e3 * fitted.clock_offset:.4g} {spread}" if np.isfinite(std) else "not determined, taken as 0"
        rows.append(("clock offset", known, "ms"))
    return _table(("", "value", "unit"), rows)


def _residual_table(fitted: HingeFit, fine: Units) -> list[str]:
    """Return the lines of a Markdown table of the gap at the hinge and, if known, of the tilt of the axis."""
    kinds = [("gap", fitted.gap, fitted.rms_position, fitted.noise_position, "m")]
    if fitted.body2.S is not None:
        kinds.append(("tilt", fitted.tilt, fitted.rms_angle, fitted.noise_angle, "rad"))
    rows = []
    for name, sizes, *rms_and_noise, si in kinds:
        values, unit = fine.converted(sizes, si), fine.unit(si)
        rms, noise = (fine.factor(si) * size for size in rms_and_noise)
        worst = int(np.nanargmax(values))
        place = f"sample {worst}" if fitted.t is None else f"t = {fitted.t[worst]:.6g} s"
        middle, most = np.nanquantile(values, (0.5, 0.95))
        numbers = (f"{number:.3g}" for number in (rms, middle, most, values[worst]))
        rows.append((name, *numbers, place, f"{noise:.3g}", unit))
    return _table(("", "rms", "median", "95 %", "largest", "at", "noise of a component", "unit"), rows)


def _table(heading: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Return the lines of a Markdown table."""
    return [f"| {' | '.join(row)} |" for row in (heading, ("---",) * len(heading), *rows)]


def _advice(fitted: HingeFit) -> list[str]:
    """Return sentences on what to do next: what makes the fit better, and what it can be used for."""
    advice = []
    if not fitted.ok:
        advice.append("Do not use these numbers: the first finding says why.")
        if fitted.loss == "linear":
            advice.append("Repeat with `--loss cauchy` where some samples may be outliers.")
    low, high = np.degrees(fitted.psi_range)
    if high - low < 30:
        advice.append(
            f"Let the hinge turn further than {high - low:.2g} deg: the standard deviations of the axis and of the "
            "point fall in proportion."
        )
    if fitted.clock_offset is not None and fitted.std["clock_offset"] > 0:
        is_significant = abs(fitted.clock_offset) > 4 * fitted.std["clock_offset"]
        if not is_significant:
            advice.append(
                "Repeat with `--clock-offset 0` if both bodies were recorded by one clock: it is more certain."
            )
    if fitted.samples < 0.9 * fitted.psi.size:
        advice.append("Find out why so many samples are missing; a gap in the motion costs certainty.")
    if fitted.ok:
        advice.append("Check the hinge on a second recording: `pair.residuals(body1, body2, tolerances)`.")
        if fitted.t is not None:
            advice.append("Write the pair and its motion as a scene by `--scene FILE.toml`, for every other command.")
    return advice
