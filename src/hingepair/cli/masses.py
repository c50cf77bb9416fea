"""`hingepair masses`: fit the masses of a robot to a recorded motion and its torques, and report on them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from hingepair.cli.options import (
    ColumnOption,
    JsonOption,
    out_option,
    parse_columns,
    parse_gravity,
    split_names,
)
from hingepair.cli.output import check_output, show
from hingepair.cli.sources import read_source
from hingepair.errors import ArgumentError, quoted
from hingepair.formats.model_writers import to_urdf
from hingepair.formats.recordings import read_robot_recording
from hingepair.measured.mass_fit import fit_masses
from hingepair.measured.torques import JOINT_TERMS
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.tables.whole_file import whole_file


def masses_command(
    source: Annotated[str, typer.Argument(metavar="ROBOT", help="URDF file, robot by name, or scene of a robot.")],
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Recording (.csv, .npz, .parquet).")],
    lock: Annotated[
        list[str] | None,
        typer.Option(metavar="JOINT=POSITION", help="Hold a joint that was not recorded [rad, m]; may be repeated."),
    ] = None,
    joint_terms: Annotated[
        str,
        typer.Option(metavar="NAMES", help=f"What acts in each joint beside masses: {', '.join(JOINT_TERMS)}."),
    ] = "viscous,coulomb",
    gravity: Annotated[
        str | None, typer.Option(metavar="X,Y,Z", help="Acceleration of gravity in world axes [m/s^2].")
    ] = None,
    out: Annotated[Path | None, out_option("Write the robot with the fitted masses and friction (.urdf).")] = None,
    column: ColumnOption = None,
    as_json: JsonOption = False,
) -> None:
    """Fit the masses of a robot, and friction, to a recorded motion and its torques.

    Columns are read by name: t, q_JOINT and tau_JOINT of all joints, and where recorded qd_JOINT and qdd_JOINT, in SI
    units or with their unit, such as "q_JOINT [deg]"; or JOINT, JOINTd and JOINTdd, as hingepair run writes them. The
    results are the base parameters, combinations of masses on which torques depend, with standard deviations, what
    is left of the torques, and a verdict. The exit code is 1 if the recording does not determine them, or if they do
    not explain the torques.
    """
    check_output(out, [file], (".urdf",))
    robot = read_source(source).robot.with_locked(dict(map(_locked, lock or ())))
    _, recorded = read_robot_recording(file, robot, None, parse_columns(column))
    fit = fit_masses(
        robot,
        *(recorded[name] for name in ("q", "qd", "qdd", "tau")),
        joint_terms=tuple(split_names("joint_terms", joint_terms) or ()),
        gravity=parse_gravity(gravity) or DEFAULT_GRAVITY,
    )
    if out is not None:
        with whole_file(out, [file]) as written:
            written.write(to_urdf(fit.robot).encode())
    facts = json.loads(fit.to_json()) | {"file": out and str(out)}
    show(as_json, facts, fit, *[f"written: {out}"] * (out is not None))
    raise typer.Exit(0 if fit.ok else 1)


def _locked(text: str) -> tuple[str, float]:
    """Return joint and position of JOINT=POSITION."""
    joint, _, position = text.rpartition("=")
    try:
        return joint, float(position)
    except ValueError:
        raise ArgumentError("lock", "JOINT=POSITION, such as finger=0.02", quoted(text)) from None
