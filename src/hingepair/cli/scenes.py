"""`hingepair run`, `check` and `forces`: a scene computed, compared with Pinocchio, and what forces it takes."""

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
    Json,
    Outputs,
    console,
    file_option,
    listed,
    print_components,
    said_if_stopped,
    watched,
)
from hingepair.cli.pairs import named_robot, named_scene
from hingepair.cli.summary import Summary
from hingepair.errors import ArgumentError, printable
from hingepair.numeric.tables import instant, json_text, unit_of
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.results import ENDINGS, check_ending, column_names, result_file
from hingepair.scenes.mechanisms.forces import load_rows
from hingepair.scenes.mechanisms.scene import MechanismScene, MechanismSceneResult
from hingepair.scenes.scene import Scene, SceneResult, load_scene
from hingepair.validation.cross_validate import cross_validate
from hingepair.validation.report import CrossValidation
from hingepair.validation.robot_report import RobotValidation
from hingepair.validation.robot_states import random_and_hard_states

MOST_CHECKED = 10_001
"""Instants that `check` takes through Pinocchio at most, evenly spread: about a second."""

MOST_CHECKED_OF_MECHANISM = 501
"""Instants of a mechanism that `check` takes through Pinocchio at most: some seconds of a humanoid."""

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).")]
Results = Annotated[Path | None, file_option(f"Write all instants to FILE ({', '.join(ENDINGS)}).")]


def run(
    scene_file: SceneFile,
    out: Results = None,
    outputs: Outputs = None,
    explain: Annotated[
        bool, typer.Option("--explain", help="Say what is computed, what is skipped, and why.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Compute the motion of body 2, or of a mechanism's frames, and show what came out.

    The table shows three instants and the range of each component; --out writes all of them. A .csv or .parquet is
    written as the motion is computed, however long it is.
    """
    if out is not None:
        check_ending(out)
    scene = named_scene(scene_file)
    names = listed("--outputs", outputs)
    plan = scene.plan(names) if explain else None
    summary = Summary(scene)
    with contextlib.ExitStack() as opened:
        add = None
        if out is not None:
            opened.enter_context(said_if_stopped(out))
            add = opened.enter_context(result_file(out, scene.samples, scene.title, scene.files, scene.unit))
        parts: Iterable[SceneResult | MechanismSceneResult] = scene.blocks(names)
        for part in watched(parts, scene.samples):
            summary.add(part)
            if add is not None:
                add(part.t, part.recorded())
    residuals, notes = summary.residuals(), summary.notes()
    if as_json:
        largest = {r.label: {"largest": r.largest, "in_u_scale": r.ratio} for r in residuals}
        found = {**_facts(scene), "not_finite": summary.lost, "outputs": summary.ranges(), "residuals": largest}
        found |= {"notes": notes, "file": None if out is None else str(out)}
        print(json_text(found | ({"plan": asdict(plan)} if plan else {})))
        return
    screen = console()
    _head(screen, scene)
    if plan:
        screen.print(str(plan))
    print_components(screen, summary.table())
    some = summary.lost < scene.samples
    if summary.lost:
        others = "ranges and residuals are those of the others" if some else "there is nothing to show"
        screen.print(f"{summary.lost} of {scene.samples} instants are not finite; {others}")
    for r in residuals if some else ():
        screen.print(f"{r.label}  largest {r.meaning}: {r.largest:.2g} {r.unit} ({r.ratio:.2g} u * scale)")
    _foot(screen, notes, out)


def check(
    source: Annotated[
        str, typer.Argument(metavar="SCENE", help="Scene file (TOML); or a robot, by its name or URDF file.")
    ],
    as_json: Json = False,
) -> None:
    """Compare a scene, or a whole robot, with Pinocchio.

    Of a scene the motion of body 2 is compared.
    Pose, velocities and accelerations are computed by the equations and by Pinocchio. Of a motion by [dynamics] the
    loads are compared with the forces that Pinocchio's inverse dynamics (rnea) finds for it, and the rates with the
    slopes of what they are the rates of. At most 10,001 instants are compared, evenly spread. Of a mechanism all
    links, forces, the mass matrix and more are compared along the motion, at 501 instants at most. The exit code is 1
    where a difference is past its bound.

    A whole robot is compared at random and at hard states (tiny, straight and huge angles, no and fast rates): the
    motion of its links, Jacobians, mass matrix, energies, momenta, forces and accelerations.
    """
    robot = named_robot(source)
    if robot is not None:
        compared = cross_validate(robot, *random_and_hard_states(robot))
        print(compared.to_json() if as_json else compared)
        raise typer.Exit(0 if compared.ok else 1)
    scene = load_scene(Path(source))
    report: CrossValidation | RobotValidation
    if isinstance(scene, Scene):
        report, notes = scene.cross_validate(MOST_CHECKED), scene.motion.notes
    else:
        report, notes = scene.cross_validate(MOST_CHECKED_OF_MECHANISM), scene.joint_motion.notes
    if report.samples < scene.samples:
        notes = (f"{report.samples} of the {scene.samples} instants are compared, evenly spread", *notes)
    if as_json:
        facts = json.loads(report.to_json())
        print(json_text(facts | {"notes": [*facts.get("notes", ()), *notes]}))
    else:
        screen = console()
        _head(screen, scene)
        print(report)
        for note in notes:
            screen.print(f"note: {note}")
    raise typer.Exit(0 if report.ok else 1)


def forces(
    scene_file: SceneFile,
    gravity: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Acceleration of free fall, world axes [m/s^2]: 0,0,-9.81, in the plane 0,-9.81, unless given.",
        ),
    ] = None,
    out: Results = None,
    as_json: Json = False,
) -> None:
    """Compute the forces that the motion of a scene takes.

    The bodies of its pair have masses. hinge_torque is the torque about the hinge axis; of a motion by [dynamics]
    it is split into motor, spring, damper, friction and stop. bearing_torque is what the bearing carries across the
    axis, hinge_force acts at the hinge point, all of them of body 1 on body 2; force1 and torque1 act on body 1 at
    R1. World axes. Of a log the table shows what the noise of its samples makes of each number.

    Of a mechanism every motor's torque (of a slider force) stands beside its limit, the coordinates and rates of the
    joints beside theirs; force1 and torque1 act on the base about its reference point: of a fixed base its reaction.
    """
    if out is not None:
        check_ending(out)
    scene = named_scene(scene_file)
    if not isinstance(scene, Scene):
        _forces_of_mechanism(scene, gravity, out, as_json)
        return
    found = scene.forces(None if gravity is None else _vector(gravity, len(scene.pair.u1)))
    written = None if out is None else str(found.save(out))
    rows = _ranges(found.t, found.recorded(), found.noise)
    own_doubt = scene.motion.doubt if found.noise else ""  # the note on noise says more
    notes = (*found.notes, *(note for note in scene.notes() if note != own_doubt))
    if as_json:
        facts = {"scene": str(scene.path), "samples": scene.samples, "gravity": list(found.gravity), "file": written}
        print(json_text(facts | {"outputs": rows, "notes": notes}))
        return
    screen = console()
    _head(screen, scene)
    _print_gravity(screen, found.gravity)
    print_components(screen, _component_rows(rows, noise=bool(found.noise)))
    _foot(screen, notes, out)


def _forces_of_mechanism(scene: MechanismScene, gravity: str | None, out: Path | None, as_json: bool) -> None:
    """Show what acts on a mechanism: on each joint beside its limits, and on the base."""
    found = scene.forces(None if gravity is None else _vector(gravity, 3))
    written = None if out is None else str(found.save(out))
    notes = (*found.notes, *scene.notes())
    base = _ranges(found.t, {name: found[name] for name in ("force1", "torque1")})
    if as_json:
        facts = {"scene": str(scene.path), "samples": scene.samples, "gravity": list(found.gravity), "file": written}
        joints = {
            load.joint: {key: value for key, value in asdict(load).items() if key != "joint"} for load in found.loads
        }
        print(json_text(facts | {"joints": joints, "outputs": base, "notes": notes}))
        return
    screen = console()
    _head(screen, scene)
    _print_gravity(screen, found.gravity)
    print_components(screen, load_rows(found.loads))
    print_components(screen, _component_rows(base))
    _foot(screen, notes, out)


def _print_gravity(screen: Console, gravity: tuple[float, ...]) -> None:
    screen.print(f"gravity = ({', '.join(f'{component:g}' for component in gravity)}) m/s^2")


def _component_rows(rows: dict[str, dict[str, float]], noise: bool = False) -> list[tuple[str, ...]]:
    """Return the heading and the rows of a table of components over the instants; of a log with their noise."""
    headings = ("", "unit", "first", "smallest", "largest", "rms", "max |.| at t", *(["by noise"] if noise else []))
    lines: list[tuple[str, ...]] = [headings]
    for name, (*sizes, t, own) in ((name, _cells(row)) for name, row in rows.items()):
        numbers = (f"{value + 0.0:.5g}" for value in sizes)
        lines.append((name, unit_of(name), *numbers, instant(t), *(f"{n:.2g}" for n in own)))
    return lines


def _cells(row: dict[str, float]) -> tuple[Any, ...]:
    """Return the numbers of a component: four sizes, the instant of the largest, and a list of its noise, if any."""
    sizes = [row[key] for key in ("first", "smallest", "largest", "rms", "t_of_largest_size")]
    return *sizes, [row["noise"]] if "noise" in row else []


def _ranges(
    t: NDArray[Any], arrays: Mapping[str, NDArray[Any]], noise: Mapping[str, NDArray[Any]] | None = None
) -> dict[str, dict[str, float]]:
    """Return what the table says of each component; NaN of what is finite at no instant."""
    v = np.concatenate([array.reshape(len(t), -1) for array in arrays.values()], axis=1)
    v = np.where(np.isfinite(v), v, np.nan)
    known = np.isfinite(v).any(axis=0)
    largest = np.where(np.isfinite(v), np.abs(v), -1.0).argmax(axis=0)
    squares, count = np.nansum(v * v, axis=0), np.maximum(np.isfinite(v).sum(axis=0), 1)
    columns = {"first": v[0], "smallest": np.fmin.reduce(v), "largest": np.fmax.reduce(v)}
    columns |= {"rms": np.where(known, np.sqrt(squares / count), np.nan)}
    columns |= {"t_of_largest_size": np.where(known, t[largest], np.nan)}
    if noise:
        columns["noise"] = np.concatenate([np.ravel(noise[name]) for name in arrays])
    return {name: {key: float(own[i]) for key, own in columns.items()} for i, name in enumerate(column_names(arrays))}


def _vector(text: str, count: int) -> tuple[float, ...]:
    """Return the components of --gravity, three or in the plane two."""
    with contextlib.suppress(ValueError):
        vector = tuple(map(float, text.split(",")))
        if len(vector) == count and np.isfinite(vector).all():
            return vector
    expected = "three finite numbers X,Y,Z" if count == 3 else "two finite numbers X,Y of a scene in the plane"
    raise ArgumentError("--gravity", expected, repr(text))


def _facts(scene: Scene | MechanismScene) -> dict[str, Any]:
    facts: dict[str, Any] = {"scene": str(scene.path), "title": scene.title, "samples": scene.samples}
    facts |= {"start": scene.start, "stop": scene.stop}
    if isinstance(scene, Scene):
        vectors = {key: getattr(scene.space, key).tolist() for key in ("u1", "u2", "n", "home")}
        return {**facts, "sequence": scene.sequence, "error_estimate": scene.motion.error_estimate, "pair": vectors}
    robot = scene.mechanism
    own = {"name": robot.name, "base": robot.base, "joints": robot.names, "frames": scene.frames}
    return {**facts, "mechanism": own, "moving": scene.joint_motion.moving}


def _head(screen: Console, scene: Scene | MechanismScene) -> None:
    """Print what a scene is, in three lines."""
    if scene.title:
        screen.print(printable(scene.title), style="bold")
    if isinstance(scene, Scene):
        pair, how = scene.pair, scene.motion.turning
        own = ("u1", "u2", "n") if isinstance(pair, HingePair) else ("u1", "u2")
        vectors = ", ".join(f"{key} = ({', '.join(f'{c:g}' for c in getattr(pair, key))})" for key in own)
        screen.print(f"{printable(pair.name)}: {vectors}")
    else:
        robot, moving, how = scene.mechanism, scene.joint_motion.moving, scene.joint_motion.origin
        resting = f", {robot.dof - len(moving)} rest" if len(moving) < robot.dof else ""
        names = printable(", ".join(moving)) or "none"
        screen.print(f"{printable(robot.name)}: {robot.dof} joints, {robot.base} base; moving: {names}{resting}")
    plural = "s" * (scene.samples != 1)
    t = f"t = {instant(scene.start)} to {instant(scene.stop)} s"
    screen.print(f"{scene.samples} instant{plural}, {t}; {how}")


def _foot(screen: Console, notes: tuple[str, ...], out: Path | None) -> None:
    """Print the notes, and where the results were written."""
    for note in notes:
        screen.print(f"note: {note}")
    screen.print(f"written: {out}" if out else "nothing written (--out FILE writes all instants)")
