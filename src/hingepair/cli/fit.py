"""`hingepair fit FILE...`: the hinge of two recorded bodies, and a report on it."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from hingepair.cli.output import (
    PICTURE_ENDINGS,
    JsonOption,
    check_picture_ending,
    make_console,
    out_option,
    save_figure,
)
from hingepair.errors import ArgumentError, FitError, quoted
from hingepair.formats.recordings import read_recording
from hingepair.measured.hinge import GAUGES
from hingepair.measured.hinge_fit import HingeFit, fit
from hingepair.measured.likelihood import LOSSES
from hingepair.numeric.whole_file import whole_file
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.results import RESULT_SUFFIXES, Record, check_ending
from hingepair.rotations.matrices import rotation_vector
from hingepair.scenes.known_motion import quaternion_columns

_MIN_TURN = 30.0  # [deg] of the hinge, below which more turning is worth the effort
_MIN_CERTAIN_OFFSET = 4.0  # in standard deviations, of a clock offset that is there
_MAX_MISSING = 0.1  # part of the samples


def fit_command(
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
        Path | None, out_option(f"Write psi and what is left of each sample ({', '.join(RESULT_SUFFIXES)}).")
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help=f"Draw psi and what is left over time ({', '.join(PICTURE_ENDINGS)})."),
    ] = None,
    scene: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Write a scene (.toml) of the fitted pair, moved as recorded, and its log (.csv)."
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write a report (.md): the hinge, how sure it is, residuals, findings, what to do; with --plot the "
            "figure too.",
        ),
    ] = None,
    encoder: Annotated[
        str | None,
        typer.Option(
            metavar="COLUMN",
            help="Readings of the hinge angle, in any unit, on body 1's clock; zero, scale and noise are estimated.",
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
    as_json: JsonOption = False,
) -> None:
    """Find the hinge of two recorded bodies.

    Its n, home, u1, u2 and psi, how sure they are, and whether it is a hinge. Columns, by name: t; R1_x, R1_y,
    R1_z or x1, y1, z1; S1_xx, ..., S1_zz or qx1, qy1, qz1, qw1; of body 2 the same with 2, or the position alone of
    a point whose attitude was not measured. Where each body has a file, the first is body 1, and the digit may be
    left away. Exit code 1: there is no hinge to rely on.
    """
    _check_names(out, plot, scene, report)
    recording = read_recording(files, ignore or (), gaps, encoder)
    if scene is not None and recording.t is None:
        raise ArgumentError("scene", "a recording with a column t", "none")
    try:
        found = fit(
            recording.body1,
            recording.body2,
            loss,
            gauge,
            recording.t,
            clock_offset=clock_offset,
            encoder=recording.encoder,
        )
    except FitError as error:
        if report is not None:
            _save_text(report, _report_without_hinge(error, files), files)
        if as_json:
            print(json.dumps({"ok": False, "findings": [str(error)]}, indent=2))
        else:
            make_console().print(f"NO HINGE: {error}")
        raise typer.Exit(1) from None
    written = _save(found, recording.body1, files, out, plot, scene, report)
    print(found.to_json() if as_json else found)
    for path in () if as_json else written:
        make_console().print(f"written: {path}")
    raise typer.Exit(0 if found.ok else 1)


def _check_names(out: Path | None, plot: Path | None, scene: Path | None, report: Path | None) -> None:
    """Refuse names of files to write whose endings say another kind of file."""
    if out is not None:
        check_ending(out)
    if plot is not None:
        check_picture_ending("plot", plot)
    if scene is not None and scene.suffix.lower() != ".toml":
        raise ArgumentError("scene", "a file name that ends in .toml", quoted(str(scene)))
    if report is not None and report.suffix.lower() != ".md":
        raise ArgumentError("report", "a file name that ends in .md", quoted(str(report)))


def _save(
    found: HingeFit,
    body1: BodyMotion,
    files: list[Path],
    out: Path | None,
    plot: Path | None,
    scene: Path | None,
    report: Path | None,
) -> list[Path]:
    """Write what was asked for of a fit, and return the names of the files."""
    written: list[Path] = []
    if out is not None:
        t = np.arange(float(found.psi.size)) if found.t is None else found.t
        arrays = {"psi": found.psi, "gap": found.gap, "tilt": found.tilt, "weight": found.weights}
        if found.body2.S is None:
            del arrays["tilt"]
        written.append(Record(t, arrays, "what is left of each sample").save(out, files))
    if plot is not None:
        save_figure(found.plot(), plot, files)
        written.append(plot)
    if scene is not None:
        written += _save_scene(scene, found, body1, files)
    if report is not None:
        figure = None if plot is None else os.path.relpath(plot, report.parent)
        _save_text(report, _report(found, files, figure), files)
        written.append(report)
    return written


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
    _save_text(path, text, inputs)
    return [path, log]


def _save_text(path: Path, text: str, inputs: list[Path]) -> None:
    with whole_file(path, inputs) as file:
        file.write(text.encode())


def _report_without_hinge(error: FitError, inputs: list[Path]) -> str:
    """Return a report in Markdown on recordings that determine no hinge."""
    return "\n".join((*_heading(inputs), "**No hinge.** These recordings determine none:", "", f"- {error}", ""))


def _report(found: HingeFit, inputs: list[Path], figure: str | None) -> str:
    """Return a report on a fit in Markdown; `figure` is the path of its picture from there."""
    verdict = "**ok**: the motion shows a hinge and determines it." if found.ok else "**Not a hinge to rely on.**"
    missing = found.psi.size - found.samples
    lines = [
        *_heading(inputs),
        f"{verdict} {found.samples} samples, {missing} missing; loss {found.loss}.",
        "",
        "## Hinge",
        "",
        *_hinge_table(found),
        "",
        f"u1 and u2 name the point of the axis {found.gauge.replace('_', ' ')}; along the axis only their difference "
        "is seen. home is a rotation vector in the axes of body 1. Behind each number stands its standard deviation.",
        "",
        "## Residuals",
        "",
        *_residual_table(found),
        "",
        *(() if figure is None else (f"![Hinge angle and residuals over time]({figure.replace(os.sep, '/')})", "")),
        "## Findings",
        "",
        *(f"- {text}" for text in found.findings or ("None.",)),
        "",
        "## What to do",
        "",
        *(f"- {text}" for text in _advice(found)),
        "",
    ]
    if found.ok:
        names = ("u1", "u2", "n", "home")
        code = (f"{name} = {getattr(found.pair, name).tolist()}" for name in names)
        call = "pair = hingepair.HingePair(u1=u1, u2=u2, n=n, home=home)"
        lines += ["## The pair in Python", "", "```python", *code, call, "```", ""]
    return "\n".join(lines)


def _heading(inputs: list[Path]) -> list[str]:
    return [f"# The hinge of {' and '.join(f'`{path.name}`' for path in inputs)}", ""]


def _hinge_table(found: HingeFit) -> list[str]:
    """Return the hinge and what was estimated with it, a row each, in Markdown."""
    turn = np.degrees(rotation_vector(found.pair.home))
    vectors = [(name, getattr(found.pair, name), np.asarray(found.std[name]), "m") for name in ("u1", "u2")]
    vectors += [("n", found.pair.n, np.asarray(found.std["n"]), "1")]
    if found.body2.S is not None:
        vectors += [("home", turn, np.degrees(found.std["home"]), "deg")]
    rows = [
        (name, ", ".join(f"{v:.6g} ± {s:.2g}" for v, s in zip(values, stds, strict=True)), unit)
        for name, values, stds, unit in vectors
    ]
    low, high = np.degrees(found.psi_range)
    rows.append(("psi", f"{low:.4g} to {high:.4g}", "deg"))
    if found.clock_offset is not None:
        std = 1e3 * float(found.std["clock_offset"])
        known = f"{1e3 * found.clock_offset:.4g} ± {std:.2g}" if np.isfinite(std) else "not determined, taken as 0"
        rows.append(("clock offset", known, "ms"))
    if found.encoder is not None:
        zero, scale = (
            f"{getattr(found.encoder, key):.6g} ± {found.encoder.std[key]:.2g}" for key in ("zero", "scale")
        )
        rows += [
            ("encoder: zero", zero, "rad"),
            ("encoder: scale", scale, "rad in a unit of the reading"),
            ("encoder: noise", f"{found.encoder.noise:.2g}", "rad"),
        ]
    return _table(("", "value", "unit"), rows)


def _residual_table(found: HingeFit) -> list[str]:
    """Return what the fit leaves of the samples, in Markdown."""
    kinds = [("gap", 1e3 * found.gap, 1e3 * found.rms_position, 1e3 * found.noise_position, "mm")]
    if found.body2.S is not None:
        rms, noise = np.degrees((found.rms_angle, found.noise_angle))
        kinds.append(("tilt", np.degrees(found.tilt), float(rms), float(noise), "deg"))
    rows = []
    for name, values, rms, noise, unit in kinds:
        worst = int(np.nanargmax(values))
        place = f"sample {worst}" if found.t is None else f"t = {found.t[worst]:.6g} s"
        middle, most = np.nanquantile(values, (0.5, 0.95))
        numbers = (f"{number:.3g}" for number in (rms, middle, most, values[worst]))
        rows.append((name, *numbers, place, f"{noise:.3g}", unit))
    return _table(("", "rms", "median", "95 %", "largest", "at", "noise of a component", "unit"), rows)


def _table(heading: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (heading, ("---",) * len(heading), *rows)]


def _advice(found: HingeFit) -> list[str]:
    """Return what to do next, in sentences."""
    advice = []
    if not found.ok:
        advice.append("Do not use these numbers: the first finding says why.")
        if found.loss == "linear":
            advice.append("Repeat with `--loss cauchy` where some samples may be outliers.")
    low, high = np.degrees(found.psi_range)
    if high - low < _MIN_TURN:
        advice.append(
            f"Let the hinge turn further than {high - low:.2g} deg: the standard deviations of the axis and of the "
            "point fall in proportion."
        )
    if found.clock_offset is not None and found.std["clock_offset"] > 0:
        certain = abs(found.clock_offset) > _MIN_CERTAIN_OFFSET * found.std["clock_offset"]
        if not certain:
            advice.append(
                "Repeat with `--clock-offset 0` if both bodies were recorded by one clock: it is more certain."
            )
    if found.samples < (1 - _MAX_MISSING) * found.psi.size:
        advice.append("Find out why so many samples are missing; a gap in the motion costs certainty.")
    if found.ok:
        advice.append("Check the hinge on a second recording: `pair.residuals(body1, body2, tolerances)`.")
        if found.t is not None:
            advice.append("Write the pair and its motion as a scene by `--scene FILE.toml`, for every other command.")
    return advice
