"""`hingepair run`, `check` and `forces`: compute a scene, compare it with Pinocchio, compute its forces."""

from __future__ import annotations

import contextlib
import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from hingepair.cli.options import (
    GravityOption,
    JsonOption,
    OutputsOption,
    ResultsOption,
    SceneArgument,
    SourceArgument,
    UnitsOption,
    parse_gravity,
    split_names,
)
from hingepair.cli.output import check_output, show, table_lines
from hingepair.cli.sources import read_scene, read_source
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.results import RESULT_FILE_SUFFIXES, result_file
from hingepair.numeric.arrays import Float64Array
from hingepair.scenes.scene import Scene
from hingepair.scenes.summary import Summary
from hingepair.validation.cross_validate import cross_validate


def run_command(
    scene_file: SceneArgument,
    out: ResultsOption = None,
    outputs: OutputsOption = None,
    units: UnitsOption = None,
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
    check_output(out, [scene_file], RESULT_FILE_SUFFIXES)
    scene, names = read_scene(scene_file), split_names("outputs", outputs)
    balance = scene.energy_balance() if energy else None
    columns, summary = scene.in_units(units), Summary(scene, units)
    with contextlib.ExitStack() as stack:
        file = None if out is None else result_file(out, scene.title, scene.files, columns)
        add = None if file is None else stack.enter_context(file)
        for part in scene.blocks(names):
            summary.add(part.t, part.requested_arrays(), part.first)
            if add is not None:
                add(part.t, part.recorded())
    notes = scene.notes(units)
    facts = scene.facts() | {"not_finite": summary.lost, "outputs": summary.ranges(), "notes": notes}
    facts |= {"file": out and str(out)} | ({"energy_balance": balance.facts()} if balance else {})
    rows, left_out = summary.table(hides_matrices=names is None and scene.outputs is None)
    lines = (scene.title, *scene.heading(), *table_lines(rows), *([balance] if balance else []), *left_out)
    show(as_json, facts, *lines, *_last_lines(notes, out))


def check_command(source: SourceArgument, as_json: JsonOption = False) -> None:
    """Compare a scene or a robot with Pinocchio, and print a report.

    For the scene of a pair, poses, velocities and accelerations of body 2 are computed by hingepair and by Pinocchio,
    at 10,001 evenly spread instants at most. If [dynamics] simulates the motion, its loads are compared with the
    forces of Pinocchio's inverse dynamics (rnea). For a mechanism, all links, forces, the mass matrix and more are
    compared along the motion, at 501 instants at most. The exit code is 1 if a difference exceeds its bound.

    For a whole robot, the motion of its links, Jacobians, mass matrix, energies, momenta, forces and accelerations
    are compared at random states and at numerically difficult ones: angles that are tiny, huge or near pi, and rates
    that are zero or fast.
    """
    read = read_source(source)
    heading: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    if isinstance(read.named, Scene) and (read.named.has_motion or read.named.mechanism is None):
        scene = read.named.checked()
        heading, report = (scene.title, *scene.heading()), scene.cross_validate(scene.assembly.max_check_instants)
        notes = (*scene.suspicions(), *scene.motion.notes)
    else:
        report = cross_validate(read.robot, *_random_and_hard_states(read.robot))
    facts = json.loads(report.to_json())
    facts["notes"] = [*facts.get("notes", ()), *notes]
    show(as_json, facts, *heading, report, *(f"note: {note}" for note in notes))
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
    [dynamics], it is split into motor, spring, damper, friction and stop: where [motion] gives psi, the motor gives
    what the others do not. bearing_torque is the torque perpendicular to the axis, hinge_force the force at the hinge
    point. All three are exerted by body 1 on body 2. force1 and torque1 act on body 1 at R1. Vectors are in world
    axes; |hinge_force| is the magnitude of hinge_force.

    For a mechanism, tau_NAME is what the motor of the joint NAME gives: the torque of a hinge, the force of a slider.
    force1 and torque1 act on the base about its reference point; for a fixed base they are the reaction. What the
    hinges themselves carry is not printed: without loops, `joint_wrenches` of a Mechanism in Python gives it.
    """
    check_output(out, [scene_file], RESULT_FILE_SUFFIXES)
    scene = read_scene(scene_file)
    scene.in_units(units)  # refuses unknown ones before anything is computed
    result = scene.forces(parse_gravity(gravity))
    if out is not None:
        result.save(out, units=units)
    notes = tuple(dict.fromkeys((*result.notes, *scene.notes(units))))
    facts = {"scene": str(scene.path), "samples": scene.samples, "file": out and str(out)}
    facts |= {"gravity": list(result.gravity)}
    gravity_text = f"gravity = ({', '.join(f'{component:g}' for component in result.gravity)}) m/s^2"
    summary = result.summary(units)
    rows, left_out = summary.table_of_sizes()
    lines = (scene.title, *scene.heading(), gravity_text, *table_lines(rows), *left_out, *_last_lines(notes, out))
    show(as_json, facts | {"outputs": summary.ranges(), "notes": notes}, *lines)


def _last_lines(notes: tuple[str, ...], out: Path | None) -> list[str]:
    written = f"written: {out}" if out else "nothing written (--out FILE writes all instants)"
    return [*(f"note: {note}" for note in notes), written]
