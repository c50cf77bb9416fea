"""`hingepair run` and `check`: a scene computed and summed up, or compared with Pinocchio."""

from __future__ import annotations

import contextlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console

from hingepair.cli.output import NOTHING_WRITTEN, Json, Outputs, console, listed, said_if_stopped, watched
from hingepair.cli.summary import Summary
from hingepair.errors import printable
from hingepair.numeric.tables import finite_or_none, instant
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.results import ENDINGS, check_ending, result_file
from hingepair.scenes.scene import load_scene, scene_files

if TYPE_CHECKING:
    from hingepair.scenes.scene import Scene

MOST_CHECKED = 10_001
"""Instants that `check` takes through Pinocchio at most, evenly spread: about a second."""

SceneFile = Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file (TOML).")]


def run(
    scene_file: SceneFile,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", metavar="FILE", help=f"Write all instants to FILE ({', '.join(ENDINGS)})."),
    ] = None,
    outputs: Outputs = None,
    explain: Annotated[
        bool, typer.Option("--explain", help="Say what is computed, what is skipped, and why.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Compute the motion of body 2 and show what came out.

    The table shows three instants and the range of each component; --out writes all of them. A .csv or .parquet is
    written as the motion is computed, however long it is.
    """
    if out is not None:
        check_ending(out)
    scene = load_scene(scene_file)
    names = listed(outputs)
    summary = Summary(scene)
    with contextlib.ExitStack() as opened:
        add = None
        if out is not None:
            opened.enter_context(said_if_stopped(out))
            add = opened.enter_context(result_file(out, scene.samples, scene.title, scene_files(scene_file)))
        for part in watched(scene.blocks(names), scene.samples):
            summary.add(part)
            if add is not None:
                add(part.t, part.recorded())
    if as_json:
        found = {
            **_facts(scene),
            "not_finite": summary.lost,
            "outputs": summary.as_json(),
            "residuals": {
                r.label: {"largest": finite_or_none(r.largest), "in_u_scale": finite_or_none(r.ratio)}
                for r in summary.residuals()
            },
            "notes": summary.notes(),
            "file": None if out is None else str(out),
            **({"plan": asdict(scene.plan(names))} if explain else {}),
        }
        print(json.dumps(found, indent=2, allow_nan=False))
        return
    screen = console()
    head(screen, scene)
    if explain:
        screen.print(str(scene.plan(names)))
    screen.print(summary.table())
    some = summary.lost < scene.samples
    if summary.lost:
        others = "ranges and residuals are those of the others" if some else "there is nothing to show"
        screen.print(f"{summary.lost} of {scene.samples} instants are not finite; {others}")
    for r in summary.residuals() if some else ():
        screen.print(f"{r.label}  largest {r.meaning}: {r.largest:.2g} {r.unit} ({r.ratio:.2g} u * scale)")
    for note in summary.notes():
        screen.print(f"note: {note}")
    screen.print(f"written: {out}" if out else NOTHING_WRITTEN)


def check(scene_file: SceneFile, as_json: Json = False) -> None:
    """Compare the motion of body 2 with Pinocchio's.

    Pose, velocities and accelerations are computed by the equations and by Pinocchio. At most 10,001 instants are
    compared, evenly spread. The exit code is 1 where a difference is past its bound.
    """
    scene = load_scene(scene_file)
    report = scene.cross_validate(MOST_CHECKED)
    if as_json:
        print(report.to_json())
    else:
        screen = console()
        head(screen, scene)
        if report.samples < scene.samples:
            screen.print(f"{report.samples} of the {scene.samples} instants are compared, evenly spread")
        print(report)
    raise typer.Exit(0 if report.ok else 1)


def _facts(scene: Scene) -> dict[str, object]:
    return {
        "scene": str(scene.path),
        "title": scene.title,
        "samples": scene.samples,
        "start": scene.start,
        "stop": scene.stop,
        "sequence": scene.sequence,
        "error_estimate": finite_or_none(scene.motion.error_estimate),
        "pair": {key: getattr(scene.space, key).tolist() for key in ("u1", "u2", "n", "home")},
    }


def head(screen: Console, scene: Scene) -> None:
    """What a scene is, in three lines."""
    if scene.title:
        screen.print(printable(scene.title), style="bold")
    pair = scene.pair
    own = ("u1", "u2", "n") if isinstance(pair, HingePair) else ("u1", "u2")
    vectors = ", ".join(f"{key} = ({', '.join(f'{c:g}' for c in getattr(pair, key))})" for key in own)
    screen.print(f"{printable(pair.name)}: {vectors}")
    instants = (
        f"{scene.samples} instant{'s' * (scene.samples != 1)}, t = {instant(scene.start)} to {instant(scene.stop)} s"
    )
    screen.print(f"{instants}; {scene.motion.turning}")
