"""`hingepair robots`: the robots that scenes and commands can name, and the joints of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import typer

from hingepair.cli.output import JsonOption
from hingepair.cli.sources import Source
from hingepair.errors import ArgumentError, URDFError, printable
from hingepair.formats.robots import robot_names, robot_urdf
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.tree import Tree
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.tables.sheets import align_columns, json_text
from hingepair.urdf.reader import read_urdf
from hingepair.urdf.records import HINGE_TYPES, SLIDER_TYPES, JointRecord, MimicRecord

# Headings of the table of robots.
ROBOT_HEADINGS = ("robot", "dof", "hinges", "sliders", "following")
# Headings of the table of joints.
JOINT_HEADINGS = (
    *(
        "q",
        "joint",
        "kind",
        "body 1",
        "body 2",
        "axis (joint axes)",
        "limits [rad, m]",
        "effort [N m, N]",
        "rate [rad/s, m/s]",
    ),
    *("body 2 [kg]", "moves [kg]", "follows"),
)
# Columns of numbers in the table of joints, which are right-aligned.
_RIGHT_COLUMNS = {0, 6, 7, 8, 9, 10}


def robots_command(
    name_or_urdf_file: Annotated[
        str | None,
        typer.Argument(metavar="NAME", help="Robot or URDF file whose joints are listed; default: list the robots."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List the example robots, or the joints of a robot.

    The robots are those of the package example-robot-data, which scenes and commands take by name. The table of
    joints shows the index of each coordinate in q, the two links, the axis in the axes of the joint, as in the URDF
    file, the limits of position, effort and rate, the mass of body 2 and of all bodies that the joint moves, and the
    joint that a mimic joint follows. Scenes, and commands with an argument JOINT, can take each hinge as a pair.
    """
    if name_or_urdf_file is None:
        rows = [_robot_table_row(robot) for robot in robot_names()]
        report: Any = rows
        lines = align_columns(
            [
                ROBOT_HEADINGS,
                *(tuple(str(row[key]) for key in ROBOT_HEADINGS) for row in rows),
            ],
            {1, 2, 3, 4},
        )
    else:
        report = _joint_report(name_or_urdf_file)
        table = (
            align_columns(
                [JOINT_HEADINGS, *map(_joint_cells, report["joints"])],
                _RIGHT_COLUMNS,
            )
            if report["joints"]
            else []
        )
        lines = [*table, *map(printable, _joint_table_notes(name_or_urdf_file, report))]
    if as_json:
        print(json_text(report))
    else:
        print(*lines, sep="\n")


def _robot_table_row(robot: str) -> dict[str, Any]:
    """Return the row of a robot in the table of robots, by heading; `dof` is without joints that follow others."""
    joints = read_urdf(robot_urdf(robot)).joints
    hinges, sliders = ([joint for joint in joints if joint.type in types] for types in (HINGE_TYPES, SLIDER_TYPES))
    names = {joint.name for joint in joints}
    # A joint whose leader is missing does not count.
    following = sum(joint.mimic is not None and joint.mimic.leader in names for joint in hinges + sliders)
    numbers = (len(hinges), len(sliders), following)
    return dict(zip(ROBOT_HEADINGS, (robot, sum(numbers[:2]) - following, *numbers), strict=True))


def _joint_report(name_or_urdf_file: str) -> dict[str, Any]:
    """Return what --json prints of a robot."""
    path = name_or_urdf_file if Source(name_or_urdf_file).is_urdf else robot_urdf(name_or_urdf_file)
    robot = read_urdf(path)
    moving = {joint.name: joint for joint in robot.joints if joint.type in (*HINGE_TYPES, *SLIDER_TYPES)}
    fixed = [joint.name for joint in robot.joints if joint.type == "fixed"]
    report: dict[str, Any] = {"robot": robot.name, "dof": None, "joints": [], "folded": fixed, "notes": []}
    try:
        mechanism = Mechanism.from_urdf(path)
    except (URDFError, ArgumentError) as error:
        report["joints"] = [_joint_row(joint) for joint in moving.values()]
        report["notes"] = [f"The joints cannot be loaded as a whole robot: {error}"]
        return report
    tree = tree_of(mechanism)
    report["joints"] = [
        _joint_row(moving[joint.name]) | facts for joint, facts in zip(tree.joints, _tree_facts(tree), strict=True)
    ]
    return report | {"dof": mechanism.dof, "notes": list(tree.notes)}


def _tree_facts(tree: Tree) -> list[dict[str, Any]]:
    """Return the index in q, the mimic rule, and the masses of body 1, of body 2 and of all that moves, by joint."""
    masses = [tree.base.mass, *(joint.body.mass for joint in tree.joints)]
    moved = list(masses)
    for number in range(len(tree.joints), 0, -1):
        moved[tree.joints[number - 1].parent] += moved[number]
    indices = {joint.name: index for index, joint in enumerate(tree.coordinates)}
    facts = []
    for number, joint in enumerate(tree.joints, 1):
        mimic = joint.mimic and {
            "joint": tree.joints[joint.mimic.leader - 1].name,
            "multiplier": joint.mimic.multiplier,
            "offset": joint.mimic.offset,
        }
        fact = {"index": indices.get(joint.name), "mimic": mimic, "mass1": masses[joint.parent]}
        facts.append(fact | {"mass2": masses[number], "mass_moved": moved[number]})
    return facts


def _joint_row(joint: JointRecord) -> dict[str, Any]:
    """Return what --json prints of a hinge or slider by itself."""
    axis, home = unit_axis("axis", joint.axis), joint.pose.rotation
    return {
        "index": None,
        "joint": joint.name,
        "kind": "hinge" if joint.type in HINGE_TYPES else "slider",
        "type": joint.type,
        "parent": joint.parent,
        "child": joint.child,
        "follows": "" if joint.mimic is None else joint.mimic.leader,
        **dict.fromkeys(("mimic", "mass1", "mass2", "mass_moved")),
        "axis": axis.tolist(),
        "n": (home @ axis + 0.0).tolist(),
        "u1": joint.pose.origin.tolist(),
        "home": home.tolist(),
        "limits": joint.limits,
        "effort_limit": joint.effort,
        "rate_limit": joint.velocity,
    }


def _joint_cells(row: dict[str, Any]) -> list[str]:
    """Return the cells of a joint in the table of joints."""
    index_text = "" if row["index"] is None else str(row["index"])
    names = [index_text, *(printable(row[key]) for key in ("joint", "kind", "parent", "child"))]
    limits = "none" if row["limits"] is None else " to ".join(map(_format_number, row["limits"]))
    axis = " ".join(f"{round(component, 3) + 0.0:g}" for component in row["axis"])
    numbers = (_format_number(row[key]) for key in ("effort_limit", "rate_limit", "mass2", "mass_moved"))
    return [*names, axis, limits, *numbers, printable(_mimic_text(row))]


def _mimic_text(row: dict[str, Any]) -> str:
    """Return the rule of a mimic joint, such as -0.5 leader + 0.1; the leader alone if no rule was read."""
    mimic = row["mimic"]
    if mimic is None:
        return str(row["follows"])
    return str(MimicRecord(mimic["joint"], mimic["multiplier"], mimic["offset"]))


def _joint_table_notes(name: str, report: dict[str, Any]) -> Sequence[str]:
    """Return the sentences below the table of joints, from the report of `_joint_report`."""
    joints, folded = report["joints"], report["folded"]
    sentences = []
    if report["dof"] is not None:
        sentences.append(f"{name}: q has {report['dof']} {'coordinate' if report['dof'] == 1 else 'coordinates'}.")
    if folded:
        sentences.append(f"Fixed joints, whose links are part of the body that carries them: {', '.join(folded)}.")
    pairs = [row for row in joints if row["kind"] == "hinge"]
    if pairs:
        sentences.append(f"Each hinge can be used as a pair, for example: hingepair view {name} {pairs[0]['joint']}")
    return [*sentences, *report["notes"]]


def _format_number(value: float | None) -> str:
    """Return a number as text; "-" for None."""
    return "-" if value is None else f"{value:.4g}"
