"""`hingepair robots`: the robots that scenes and commands can name, and the joints of a robot."""

from __future__ import annotations

import os
from typing import Annotated, Any

import typer

from hingepair.cli.options import JsonOption
from hingepair.cli.output import show
from hingepair.formats.robots import robot_names, robot_urdf
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.tables.sheets import align_columns
from hingepair.urdf.reader import read_urdf
from hingepair.urdf.records import HINGE_TYPES, SLIDER_TYPES, MimicRecord

_HEADINGS = (
    *("q", "joint", "kind", "body 1", "body 2", "axis (joint axes)", "limits [rad, m]", "effort [N m, N]"),
    *("rate [rad/s, m/s]", "body 2 [kg]", "moves [kg]", "follows"),
)


def robots_command(
    source: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="Robot or URDF file whose joints are listed; default: list the robots."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the example robots, or the joints of a robot.

    The robots are those of the package example-robot-data, which scenes and commands take by name. The table of
    joints shows the index of each coordinate in q, the two links, the axis in the axes of the joint, as in the URDF
    file, the limits of position, effort and rate, the mass of body 2 and of all bodies that the joint moves, and the
    joint that a mimic joint follows.
    """
    if source is None:
        robots = [_robot_row(name) for name in robot_names()]
        cells = [(*robots[0],), *(tuple(map(str, row.values())) for row in robots)]
        return show(as_json, {"robots": robots}, *align_columns(cells, {1, 2, 3, 4}))
    report = _joint_report(source if os.path.exists(source) else str(robot_urdf(source)))
    lines = align_columns([_HEADINGS, *map(_joint_cells, report["joints"])], {0, 6, 7, 8, 9, 10})
    fixed = f"Fixed joints, whose links are part of the body that carries them: {', '.join(report['folded'])}."
    return show(as_json, report, *lines, *[fixed] * bool(report["folded"]), *report["notes"])


def _robot_row(robot: str) -> dict[str, Any]:
    """Return the row of a robot in the table of robots, by heading; `dof` is without joints that follow others."""
    joints = read_urdf(robot_urdf(robot)).joints
    hinges, sliders = ([joint for joint in joints if joint.type in types] for types in (HINGE_TYPES, SLIDER_TYPES))
    names = {joint.name for joint in joints}
    # A joint whose leader is missing does not count.
    following = sum(joint.mimic is not None and joint.mimic.leader in names for joint in hinges + sliders)
    dof = len(hinges) + len(sliders) - following
    return {"robot": robot, "dof": dof, "hinges": len(hinges), "sliders": len(sliders), "following": following}


def _joint_report(path: str) -> dict[str, Any]:
    """Return what --json prints of a robot."""
    file, robot = read_urdf(path), Mechanism.from_urdf(path)
    records, tree = {joint.name: joint for joint in file.joints}, tree_of(robot)
    moved = [tree.base.mass, *(joint.body.mass for joint in tree.joints)]
    for number in range(len(tree.joints), 0, -1):
        moved[tree.joints[number - 1].parent] += moved[number]
    rows = []
    for joint, mass in zip(tree.joints, moved[1:], strict=True):
        record, mimic = records[joint.name], joint.mimic
        leader = None if mimic is None else tree.joints[mimic.leader - 1].name
        rows.append(
            {
                "index": None if mimic else robot.names.index(joint.name),
                **{"joint": joint.name, "kind": joint.kind, "parent": record.parent, "child": record.child},
                "axis": unit_axis("axis", record.axis).tolist(),
                **{"limits": record.limits, "effort_limit": record.effort, "rate_limit": record.velocity},
                **{"mass2": joint.body.mass, "mass_moved": mass},
                "mimic": mimic and {"joint": leader, "multiplier": mimic.multiplier, "offset": mimic.offset},
            }
        )
    fixed = [joint.name for joint in file.joints if joint.type == "fixed"]
    return {"robot": file.name, "dof": robot.dof, "joints": rows, "folded": fixed, "notes": list(tree.notes)}


def _joint_cells(row: dict[str, Any]) -> list[str]:
    """Return the cells of a joint in the table of joints."""
    names = ("" if row["index"] is None else str(row["index"]), *(row[key] for key in ("joint", "kind", "parent")))
    axis = " ".join(f"{round(component, 3) + 0.0:g}" for component in row["axis"])
    limits = "none" if row["limits"] is None else " to ".join(f"{limit:.4g}" for limit in row["limits"])
    numbers = (row[key] for key in ("effort_limit", "rate_limit", "mass2", "mass_moved"))
    texts = ("-" if number is None else f"{number:.4g}" for number in numbers)
    mimic = row["mimic"]
    follows = "" if mimic is None else str(MimicRecord(mimic["joint"], mimic["multiplier"], mimic["offset"]))
    return [*names, row["child"], axis, limits, *texts, follows]
