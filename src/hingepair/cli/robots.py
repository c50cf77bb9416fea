"""`hingepair robots`: the robots that scenes and commands can name, and the joints of a robot."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from hingepair.cli.options import JsonOption
from hingepair.cli.output import show
from hingepair.cli.sources import read_source
from hingepair.formats.robots import robot_names, robot_urdf
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.tables.sheets import align_columns
from hingepair.urdf.reader import read_urdf
from hingepair.urdf.records import HINGE_TYPES, SLIDER_TYPES


def robots_command(
    source: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="Robot or URDF file whose joints are listed; default: list the robots."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the example robots, or the joints of a robot.

    Without NAME, list the robots of the package example-robot-data, which scenes and commands take by name. The table
    of joints shows what carries each joint, the axis in the axes of the joint, as in the URDF file, the limits of
    position, rate and effort, the mass of body 2, and the joint that a mimic joint follows.
    """
    if source is None:
        robots = [_robot_row(name) for name in robot_names()]
        cells = [(*robots[0],), *(tuple(map(str, row.values())) for row in robots)]
        return show(as_json, {"robots": robots}, *align_columns(cells, {1, 2, 3, 4}))
    robot = read_source(source).robot
    show(as_json, _facts(robot), robot)


def _robot_row(robot: str) -> dict[str, Any]:
    """Return the row of a robot in the table of robots, by heading; `dof` is without joints that follow others."""
    joints = read_urdf(robot_urdf(robot)).joints
    hinges, sliders = ([joint for joint in joints if joint.type in types] for types in (HINGE_TYPES, SLIDER_TYPES))
    names = {joint.name for joint in joints}
    # A joint whose leader is missing does not count.
    following = sum(joint.mimic is not None and joint.mimic.leader in names for joint in hinges + sliders)
    dof = len(hinges) + len(sliders) - following
    return {"robot": robot, "dof": dof, "hinges": len(hinges), "sliders": len(sliders), "following": following}


def _facts(robot: Mechanism) -> dict[str, Any]:
    """Return what --json prints of a robot; limits that are not finite are null."""
    tree, rows = tree_of(robot), []
    for joint in tree.joints:
        limits = {"limits": joint.position_limits, "rate_limit": joint.rate_limit, "effort_limit": joint.effort_limit}
        row = {"joint": joint.name, "kind": joint.kind, "axis": joint.n.tolist(), **limits, "mass2": joint.body.mass}
        if joint.mimic is not None:
            row["mimic"] = dict(zip(("joint", "multiplier", "offset"), joint.mimic, strict=True))
        rows.append(row)
    facts = {"robot": robot.name, "dof": robot.dof, "links": robot.links, "joints": rows}
    return {**facts, "notes": tree.mass_notes(False)}
