"""`hingepair run`, `check` and `forces`: compute a scene, compare it with Pinocchio, compute its forces."""

from __future__ import annotations

import contextlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from hingepair.cli.models import GravityOption, parse_gravity
from hingepair.cli.output import (
    JsonOption,
    OutputsOption,
    UnitsOption,
    check_output,
    out_option,
    print_component_table,
    print_title,
    report_if_stopped,
    split_names,
    with_progress_bar,
)
from hingepair.cli.sources import Source, load_named_scene
from hingepair.cli.summary import RunSummary
from hingepair.errors import ArgumentError, printable
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.results import RESULT_FILE_SUFFIXES, check_ending, result_file
from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.load import load_scene
from hingepair.scenes.scene import Scene
from hingepair.tables.sheets import json_text
from hingepair.validation.cross_validate import cross_validate

SceneArgument = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).")]
ResultsOption = Annotated[Path | None, out_option(f"Write all instants to FILE ({', '.join(RESULT_FILE_SUFFIXES)}).")]


def run_command(
    scene_file: SceneArgument,
    out: ResultsOption = None,
    outputs: OutputsOption = None,
    units: UnitsOption = None,
    explain: Annotated[
        bool, typer.Option("--explain", help="Print how many operations are computed, and why others are skipped.")
    ] = False,
    energy: Annotated[
        bool, typer.Option("--energy", help="Print the energy balance of a motion that [dynamics] simulates.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Compute and print the motion of body 2 or of a mechanism.

    The table shows each component at three instants and its range, except what is zero throughout and, unless
    --outputs names it, the matrix S2; --out writes all columns and instants. A .csv or .parquet file is written piece
    by piece, so that a motion of any length needs little memory.

    R2 and S2 are position and attitude of body 2, d is R2 - R1, v2 and a2 are velocity and acceleration, omega2 and
    alpha2 the angular ones; 1 in place of 2 stands for body 1. |v2| is the magnitude of v2.
    """
    if out is not None:
        check_ending(out)
        check_output("--out", out, [scene_file])
    scene = load_named_scene(scene_file)
    names = split_names("--outputs", outputs)
    plan = scene.plan(names) if explain else None
    balance = scene.energy_balance() if energy else None
    columns, summary = scene.in_units(units), RunSummary(scene, names, units)
    with contextlib.ExitStack() as exit_stack:
        add = None
        if out is not None:
            exit_stack.enter_context(report_if_stopped(f"stopped by a signal; {out} is not written"))
            add = exit_stack.enter_context(result_file(out, scene.samples, scene.title, scene.files, columns))
        for part in with_progress_bar(scene.blocks(names), scene.samples):
            summary.add(part)
            if add is not None:
                add(part.t, part.recorded())
    notes = summary.notes()
    if as_json:
        result = {**scene.facts(), "not_finite": summary.lost, "outputs": summary.ranges()}
        result |= {"notes": notes, "file": None if out is None else str(out)}
        result |= {"energy_balance": balance.facts()} if balance else {}
        print(json_text(result | ({"plan": asdict(plan)} if plan else {})))
        return
    _print_heading(scene)
    if plan:
        print(str(plan))
    print_component_table(summary.table())
    if balance:
        print(balance)
    for frame, shown in summary.coincident_frames.items():
        print(printable(f"{frame} moves exactly as {shown} and is not shown"))
    print(*map(printable, summary.omissions()), sep="\n", end="\n" * bool(summary.omissions()))
    if summary.lost:
        some = summary.lost < scene.samples
        others = "ranges are those of the other instants" if some else "the table has no numbers"
        print(f"{summary.lost} of {scene.samples} instants are not finite; {others}")
    _print_notes(notes, out)


def check_command(
    source: Annotated[
        str, typer.Argument(metavar="SCENE", help="Scene file (TOML); or a robot, by its name or URDF file.")
    ],
    as_json: JsonOption = False,
) -> None:
    """Compare a scene or a robot with Pinocchio, and print a report.

    For the scene of a pair, poses, velocities and accelerations of body 2 are computed by hingepair and by Pinocchio,
    at 10,001 evenly spread instants at most. If [dynamics] simulates the motion, its loads are compared with the
    forces of Pinocchio's inverse dynamics (rnea). For a mechanism, all links, forces, the mass matrix and more are
    compared along the motion, at 501 instants at most. The exit code is 1 if a difference exceeds its bound.

    For a whole robot, the motion of its links, Jacobians, mass matrix, energies, momenta, forces and accelerations
    are compared at random states and at numerically difficult ones: angles that are tiny, huge or near pi, and rates
    that are zero or fast.
    """
    robot = Source(source).robot()
    if robot is not None:
        compared = cross_validate(robot, *_random_and_hard_states(robot))
        print(compared.to_json() if as_json else compared)
        raise typer.Exit(0 if compared.ok else 1)
    scene = load_scene(Path(source))
    report = scene.cross_validate(scene.subject.max_check_instants)
    notes = (*scene.suspicions(), *scene.motion.notes)
    if report.samples < scene.samples:
        notes = (f"{report.samples} of the {scene.samples} instants are compared, evenly spread", *notes)
    if as_json:
        facts = json.loads(report.to_json())
        print(json_text(facts | {"notes": [*facts.get("notes", ()), *notes]}))
    else:
        _print_heading(scene)
        print(report)
        for note in notes:
            print(f"note: {note}")
    raise typer.Exit(0 if report.ok else 1)


def _random_and_hard_states(robot: Mechanism) -> list[Float64Array]:
    """Return q, q' and q'' of random states, and of states at which computations tend to fail; (N, dof) each."""
    rng, size = np.random.default_rng(0), (200, robot.dof)  # a humanoid takes some seconds
    turns = np.array([joint.unit == "rad" for joint in tree_of(robot).coordinates], dtype=bool)
    random = [rng.uniform(-np.pi, np.pi, size) * np.where(turns, 1.0, 0.1)]  # rad, m
    random += [rng.uniform(-most, most, size) for most in (2, 5)]
    angles = (0.0, 1e-9, -1e-160, np.pi, np.pi - 1e-9, -np.pi / 2, 1e6, -1e15)  # of hinges; sliders have none
    angle, rate = (one.reshape(-1, 1) for one in np.meshgrid(angles, (0.0, 1e3, 1e-9)))
    signs = rng.choice((-1.0, 1.0), (3, len(angle), robot.dof))
    hard = [signs[0] * np.where(turns, angle, 0.0), signs[1] * rate, signs[2] * rate**2]
    return [np.concatenate(both) for both in zip(random, hard, strict=True)]


def forces_command(
    scene_file: SceneArgument,
    gravity: GravityOption = None,
    out: ResultsOption = None,
    units: UnitsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compute and print the forces that a motion requires.

    The bodies of the pair must have masses. hinge_torque is the torque about the hinge axis; if the scene has a table
    [dynamics], it is split into motor, spring, damper, friction and stop. Beside a psi that [motion] gives,
    motor_torque is what the motion needs beside the others. bearing_torque is the torque perpendicular to the axis,
    hinge_force the force at the hinge point. All three are exerted by body 1 on body 2. force1 and torque1 act on
    body 1 at R1. Vectors are in world axes; |hinge_force| is the magnitude of hinge_force.

    For a mechanism, the table shows the effort of each joint (N m of a hinge, N of a slider), its coordinate and its
    rate with their limits.
    force1 and torque1 act on the base about its reference point; for a fixed base they are the reaction.
    """
    if out is not None:
        check_ending(out)
        check_output("--out", out, [scene_file])
    scene = load_named_scene(scene_file)
    scene.in_units(units)  # refuses unknown ones before anything is computed
    fall = None if gravity is None else parse_gravity(gravity, scene.dimensions)
    try:
        result = scene.forces(fall)
    except ArgumentError as error:
        raise error.renamed(f"{scene_file}: {error.name}") if error.name.startswith("pair.") else error from None
    written = None if out is None else str(result.save(out, units=units))
    notes = tuple(dict.fromkeys((*result.notes, *scene.notes(units))))
    if as_json:
        facts = {"scene": str(scene.path), "samples": scene.samples, "file": written}
        print(json_text(facts | result.facts(units) | {"notes": notes}))
        return
    _print_heading(scene)
    print(f"gravity = ({', '.join(f'{component:g}' for component in result.gravity)}) m/s^2")
    for rows in result.tables(units):
        print_component_table(rows)
    _print_notes(notes, out)


def _print_heading(scene: Scene) -> None:
    print_title(scene.title)
    print(*map(printable, scene.heading()), sep="\n")


def _print_notes(notes: tuple[str, ...], out: Path | None) -> None:
    for note in notes:
        print(f"note: {note}")
    print(f"written: {out}" if out else "nothing written (--out FILE writes all instants)")
