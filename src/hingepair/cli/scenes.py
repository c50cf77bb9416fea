"""`hingepair run`, `check` and `forces`: compute a scene, compare it with Pinocchio, compute its forces."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from rich.console import Console

from hingepair.cli.output import (
    JsonOption,
    OutputsOption,
    check_output,
    make_console,
    out_option,
    print_component_table,
    report_if_stopped,
    split_names,
    with_progress_bar,
)
from hingepair.cli.pairs import GravityOption, load_named_robot, load_named_scene, parse_gravity
from hingepair.cli.summary import RunSummary
from hingepair.errors import ArgumentError, printable
from hingepair.numeric.tables import instant_text, json_text, number_texts, unit_of
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.results import RESULT_FILE_SUFFIXES, check_ending, column_names, result_file
from hingepair.scenes.robot_forces import joint_load_table_rows
from hingepair.scenes.robot_scene import MechanismScene, MechanismSceneResult
from hingepair.scenes.scene import Scene, SceneResult, load_scene
from hingepair.validation.cross_validate import cross_validate
from hingepair.validation.report import CrossValidation
from hingepair.validation.states import random_and_hard_states

SceneArgument = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).")]
ResultsOption = Annotated[Path | None, out_option(f"Write all instants to FILE ({', '.join(RESULT_FILE_SUFFIXES)}).")]


def run_command(
    scene_file: SceneArgument,
    out: ResultsOption = None,
    outputs: OutputsOption = None,
    explain: Annotated[
        bool, typer.Option("--explain", help="Explain what is computed, what is skipped, and why.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Compute and print the motion of body 2 or of a mechanism.

    The table shows each component at three instants and its range; --out writes all instants. A .csv or .parquet file
    is written piece by piece, so that a motion of any length needs little memory.

    R2 and S2 are position and attitude of body 2, d is R2 - R1, v2 and a2 are velocity and acceleration, omega2 and
    alpha2 the angular ones; 1 in place of 2 stands for body 1.
    """
    if out is not None:
        check_ending(out)
        check_output("--out", out, [scene_file])
    scene = load_named_scene(scene_file)
    names = split_names("--outputs", outputs)
    plan = scene.plan(names) if explain else None
    summary = RunSummary(scene)
    with contextlib.ExitStack() as exit_stack:
        add = None
        if out is not None:
            exit_stack.enter_context(report_if_stopped(out))
            add = exit_stack.enter_context(result_file(out, scene.samples, scene.title, scene.files, scene.unit))
        parts: Iterable[SceneResult | MechanismSceneResult] = scene.blocks(names)
        for part in with_progress_bar(parts, scene.samples):
            summary.add(part)
            if add is not None:
                add(part.t, part.recorded())
    residuals, notes = summary.residuals(), summary.notes()
    if as_json:
        largest = {r.label: {"largest": r.largest, "in_u_scale": r.ratio} for r in residuals}
        result = {
            **_scene_facts(scene),
            "not_finite": summary.lost,
            "outputs": summary.ranges(),
            "residuals": largest,
        }
        result |= {"notes": notes, "file": None if out is None else str(out)}
        print(json_text(result | ({"plan": asdict(plan)} if plan else {})))
        return
    screen = make_console()
    _print_heading(screen, scene)
    if plan:
        screen.print(str(plan))
    print_component_table(screen, summary.table())
    for frame, shown in summary.coincident_frames.items():
        screen.print(printable(f"{frame} moves exactly as {shown} and is not shown"))
    some = summary.lost < scene.samples
    if summary.lost:
        others = "ranges and residuals are those of the other instants" if some else "the table has no numbers"
        screen.print(f"{summary.lost} of {scene.samples} instants are not finite; {others}")
    for r in residuals if some else ():
        screen.print(f"{r.label}  largest {r.meaning}: {r.largest:.2g} {r.unit} ({r.ratio:.2g} u * scale)")
    _print_notes(screen, notes, out)


def check_command(
    source: Annotated[
        str, typer.Argument(metavar="SCENE", help="Scene file (TOML); or a robot, by its name or URDF file.")
    ],
    as_json: JsonOption = False,
) -> None:
    """Compare a scene or a robot with Pinocchio, and print a report.

    For the scene of a pair, poses, velocities and accelerations of body 2 are computed by hingepair and by Pinocchio,
    at 10,001 evenly spread instants at most. If [dynamics] simulates the motion, its loads are compared with the
    forces of Pinocchio's inverse dynamics (rnea), and its rates with numerical derivatives. For a mechanism, all
    links, forces, the mass matrix and more are compared along the motion, at 501 instants at most. The exit code is 1
    if a difference exceeds its bound.

    For a whole robot, the motion of its links, Jacobians, mass matrix, energies, momenta, forces and accelerations
    are compared at random states and at numerically difficult ones: angles that are tiny, huge or near pi, and rates
    that are zero or fast.
    """
    robot = load_named_robot(source)
    if robot is not None:
        compared = cross_validate(robot, *random_and_hard_states(robot))
        print(compared.to_json() if as_json else compared)
        raise typer.Exit(0 if compared.ok else 1)
    scene = load_scene(Path(source))
    report: CrossValidation
    if isinstance(scene, Scene):
        report, notes = (
            scene.cross_validate(10_001),
            (*scene.suspicions(), *scene.motion.notes),
        )  # these instants take about a second
    else:
        report, notes = (
            scene.cross_validate(501),
            (*scene.suspicions(), *scene.joint_motion.notes),
        )  # of a humanoid, some seconds
    if report.samples < scene.samples:
        notes = (f"{report.samples} of the {scene.samples} instants are compared, evenly spread", *notes)
    if as_json:
        facts = json.loads(report.to_json())
        print(json_text(facts | {"notes": [*facts.get("notes", ()), *notes]}))
    else:
        screen = make_console()
        _print_heading(screen, scene)
        print(report)
        for note in notes:
            screen.print(f"note: {note}")
    raise typer.Exit(0 if report.ok else 1)


def forces_command(
    scene_file: SceneArgument,
    gravity: GravityOption = None,
    out: ResultsOption = None,
    as_json: JsonOption = False,
) -> None:
    """Compute and print the forces that a motion requires.

    The bodies of the pair must have masses. hinge_torque is the torque about the hinge axis; if the table [dynamics]
    of the scene simulates the motion, it is split into motor, spring, damper, friction and stop. bearing_torque is
    the torque perpendicular to the axis, hinge_force the force at the hinge point. All three are exerted by body 1 on
    body 2. force1 and torque1 act on body 1 at R1. Vectors are in world axes. For a log the table also shows the
    effect of noise.

    For a mechanism, the table shows the effort of each joint (N m of a hinge, N of a slider), its coordinate and its
    rate with their limits; for a log also the standard deviation of each effort that the noise of the log causes.
    force1 and torque1 act on the base about its reference point; for a fixed base they are the reaction.
    """
    if out is not None:
        check_ending(out)
        check_output("--out", out, [scene_file])
    scene = load_named_scene(scene_file)
    if not isinstance(scene, Scene):
        _show_mechanism_forces(scene, gravity, out, as_json)
        return
    gravity_vector = None if gravity is None else parse_gravity(gravity, len(scene.pair.u1))
    try:
        result = scene.forces(gravity_vector)
    except ArgumentError as error:
        if not error.name.startswith("pair."):
            raise
        raise type(error)(f"{scene_file}: {error.name}", error.expected, error.got) from None
    written = None if out is None else str(result.save(out))
    rows = _component_ranges(result.t, result.recorded(), result.noise)
    doubt = scene.motion.doubt if result.noise else ""  # the note on noise is more precise
    notes = (*result.notes, *(note for note in scene.notes() if note != doubt))
    if as_json:
        facts = {"scene": str(scene.path), "samples": scene.samples, "gravity": list(result.gravity), "file": written}
        print(json_text(facts | {"outputs": rows, "notes": notes}))
        return
    screen = make_console()
    _print_heading(screen, scene)
    _print_gravity(screen, result.gravity)
    print_component_table(screen, _component_rows(rows, with_noise=bool(result.noise)))
    _print_notes(screen, notes, out)


def _show_mechanism_forces(scene: MechanismScene, gravity: str | None, out: Path | None, as_json: bool) -> None:
    """Compute the joint efforts and the forces on the base of a MechanismScene."""
    result = scene.forces(None if gravity is None else parse_gravity(gravity, 3))
    written = None if out is None else str(result.save(out))
    notes = (*result.notes, *scene.notes())
    base = _component_ranges(result.t, {name: result[name] for name in ("force1", "torque1")})
    if as_json:
        facts = {"scene": str(scene.path), "samples": scene.samples, "gravity": list(result.gravity), "file": written}
        joints = {
            load.joint: {key: value for key, value in asdict(load).items() if key != "joint"} for load in result.loads
        }
        print(json_text(facts | {"joints": joints, "outputs": base, "notes": notes}))
        return
    screen = make_console()
    _print_heading(screen, scene)
    _print_gravity(screen, result.gravity)
    print_component_table(screen, joint_load_table_rows(result.loads))
    print_component_table(screen, _component_rows(base))
    _print_notes(screen, notes, out)


def _print_gravity(screen: Console, gravity: tuple[float, ...]) -> None:
    """Print the acceleration of gravity, a tuple of components [m/s^2], on a console."""
    screen.print(f"gravity = ({', '.join(f'{component:g}' for component in gravity)}) m/s^2")


def _component_rows(
    ranges_by_component: dict[str, dict[str, float]], with_noise: bool = False
) -> list[tuple[str, ...]]:
    """Return the rows of a table of components as tuples of strings, headings first."""
    headings = (
        "",
        "unit",
        "first",
        "smallest",
        "largest",
        "rms",
        "max |.| at t",
        *(["by noise"] if with_noise else []),
    )
    lines: list[tuple[str, ...]] = [headings]
    cells = [_component_cells(row) for row in ranges_by_component.values()]
    texts = number_texts([*ranges_by_component], [sizes for *sizes, _, _ in cells], digits=5)
    for name, numbers, (*_, t, noises) in zip(ranges_by_component, texts, cells, strict=True):
        lines.append((name, unit_of(name), *numbers, instant_text(t), *(f"{value:.2g}" for value in noises)))
    return lines


def _component_cells(row: dict[str, float]) -> tuple[Any, ...]:
    """Return the numbers of one component, from its dict of ranges, as a tuple of six: the first, smallest, largest
    and rms value, the time of the largest absolute value [s], and a list of the noise, which is empty if there is
    none.
    """
    sizes = [row[key] for key in ("first", "smallest", "largest", "rms", "t_of_largest_size")]
    return *sizes, [row["noise"]] if "noise" in row else []


def _component_ranges(
    t: NDArray[Any], arrays: Mapping[str, NDArray[Any]], noise: Mapping[str, NDArray[Any]] | None = None
) -> dict[str, dict[str, float]]:
    """Return a dict from the name of each component of `arrays`, a dict of outputs by name at the instants t, to a
    dict of floats: the first, smallest, largest and rms value, and the time of the largest absolute value [s].
    """
    v = np.concatenate([array.reshape(len(t), -1) for array in arrays.values()], axis=1)
    v = np.where(np.isfinite(v), v, np.nan)
    finite_once = np.isfinite(v).any(axis=0)
    largest = np.where(np.isfinite(v), np.abs(v), -1.0).argmax(axis=0)
    squares, count = np.nansum(v * v, axis=0), np.maximum(np.isfinite(v).sum(axis=0), 1)
    columns = {"first": v[0], "smallest": np.fmin.reduce(v), "largest": np.fmax.reduce(v)}
    columns |= {"rms": np.where(finite_once, np.sqrt(squares / count), np.nan)}
    columns |= {"t_of_largest_size": np.where(finite_once, t[largest], np.nan)}
    if noise:
        columns["noise"] = np.concatenate([np.ravel(noise[name]) for name in arrays])
    return {
        name: {key: float(values[i]) for key, values in columns.items()}
        for i, name in enumerate(column_names(arrays))
    }


def _scene_facts(scene: Scene | MechanismScene) -> dict[str, Any]:
    """Return a dict for JSON of a Scene or MechanismScene: path, title, number of samples, first and last instant."""
    facts: dict[str, Any] = {"scene": str(scene.path), "title": scene.title, "samples": scene.samples}
    facts |= {"start": scene.start, "stop": scene.stop}
    if isinstance(scene, Scene):
        vectors = {key: getattr(scene.space, key).tolist() for key in ("u1", "u2", "n", "home")}
        return {**facts, "sequence": scene.sequence, "error_estimate": scene.motion.error_estimate, "pair": vectors}
    robot = scene.mechanism
    mechanism = {"name": robot.name, "base": robot.base, "joints": robot.names, "frames": scene.frames}
    return {**facts, "mechanism": mechanism, "moving": scene.joint_motion.moving}


def _print_heading(screen: Console, scene: Scene | MechanismScene) -> None:
    """Print the title, if any, of a Scene or MechanismScene, a line on its pair or mechanism, and a line on its
    instants.
    """
    if scene.title:
        screen.print(printable(scene.title), style="bold")
    if isinstance(scene, Scene):
        pair, origin = scene.pair, scene.motion.motion_description
        keys = ("u1", "u2", "n") if isinstance(pair, HingePair) else ("u1", "u2")
        vectors = ", ".join(f"{key} = ({', '.join(f'{c:g}' for c in getattr(pair, key))})" for key in keys)
        screen.print(f"{printable(pair.name)}: {vectors}")
    else:
        robot, moving, origin = scene.mechanism, scene.joint_motion.moving, scene.joint_motion.origin
        resting_text = f", {robot.dof - len(moving)} rest" if len(moving) < robot.dof else ""
        names = printable(", ".join(moving)) or "none"
        screen.print(f"{printable(robot.name)}: {robot.dof} joints, {robot.base} base; moving: {names}{resting_text}")
    plural = "s" * (scene.samples != 1)
    t = f"t = {instant_text(scene.start)} to {instant_text(scene.stop)} s"
    screen.print(f"{scene.samples} instant{plural}, {t}; {origin}")


def _print_notes(screen: Console, notes: tuple[str, ...], out: Path | None) -> None:
    """Print each note, a sentence, on a line of the console, and a last line that says that the file `out` was
    written, or, if `out` is None, that nothing was.
    """
    for note in notes:
        screen.print(f"note: {note}")
    screen.print(f"written: {out}" if out else "nothing written (--out FILE writes all instants)")
