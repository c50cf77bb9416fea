"""`hingepair masses`: fit the masses of a robot to a recorded motion and its torques, and report on them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hingepair.cli.models import GravityOption, parse_gravity
from hingepair.cli.output import (
    JsonOption,
    check_output,
    naming_option,
    split_names,
)
from hingepair.cli.sources import ColumnOption, Source, parse_columns
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
    test: Annotated[
        float, typer.Option(metavar="PART", help="Part of the samples, the last ones, that is kept for a test.")
    ] = 0.25,
    bandwidth: Annotated[
        float | None,
        typer.Option(metavar="HZ", help="Frequency up to which rates are derived from q; default: it is estimated."),
    ] = None,
    gravity: GravityOption = None,
    urdf: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Write the robot with the fitted masses and friction (.urdf).")
    ] = None,
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
    if urdf is not None and urdf.suffix.lower() != ".urdf":
        raise ArgumentError("urdf", "a file name that ends in .urdf", quoted(str(urdf)))
    check_output("urdf", urdf, [file])
    named = Source(source)
    robot = named.scene_file.mechanism if named.is_scene else named.robot()
    if robot is None:
        raise ArgumentError("ROBOT", "a URDF file, the name of a robot, or a scene of a robot", quoted(source))
    robot = robot.with_locked(dict(map(_locked, lock))) if lock else robot
    _, recorded = read_robot_recording(file, robot, bandwidth, parse_columns(column or ()))
    fit = fit_masses(
        robot,
        *(recorded[name] for name in ("q", "qd", "qdd", "tau")),
        joint_terms=tuple(split_names("joint_terms", joint_terms) or ()),
        test=test,
        gravity=DEFAULT_GRAVITY if gravity is None else parse_gravity(gravity, 3),
    )
    if urdf is not None:
        with naming_option("urdf"), whole_file(urdf, [file]) as stream:
            stream.write(to_urdf(fit.robot).encode())
    print(fit.to_json() if as_json else fit)
    if urdf is not None and not as_json:
        print(f"written: {urdf}")
    raise typer.Exit(0 if fit.ok else 1)


def _locked(text: str) -> tuple[str, float]:
    """Return joint and position of JOINT=POSITION."""
    joint, _, position = text.rpartition("=")
    try:
        return joint, float(position)
    except ValueError:
        raise ArgumentError("lock", "JOINT=POSITION, such as finger=0.02", quoted(text)) from None
