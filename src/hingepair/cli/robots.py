"""`hingepair robots`: the robots that a scene or a command may name, and the joints of one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import typer

from hingepair.cli.output import Json, console
from hingepair.cli.pairs import is_urdf
from hingepair.errors import ArgumentError, URDFError, printable
from hingepair.formats.robots import robot_names, robot_urdf
from hingepair.formats.urdf_reader import hinge_pair
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.tree import Tree
from hingepair.numeric.tables import aligned, json_text
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.urdf.reader import read_urdf
from hingepair.urdf.records import HINGES, SLIDERS, Joint, Mimic, Robot

COUNTS = ("robot", "dof", "hinges", "sliders", "following")
HEADINGS = (
    *("q", "joint", "kind", "body 1", "body 2", "axis n", "limits [rad, m]", "effort [N m, N]", "rate [rad/s, m/s]"),
    *("body 2 [kg]", "moves [kg]", "follows"),
)
_NUMBERS = {0, 6, 7, 8, 9, 10}
"""Columns of numbers, which are aligned to the right."""


def robots(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="Show the joints of this robot, or of a URDF file.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the robots, or the joints of one.

    Of a joint it shows the place of its coordinate in q, the links that it joins, the axis in the axes of body 1, the
    limits of position, effort and rate, the mass of body 2 and of all that the joint moves, and the joint that it
    follows. Every hinge can be taken as a pair of body 1 and body 2, by scenes and by commands that take a JOINT.
    """
    if name is None:
        rows = [_counts(robot) for robot in robot_names()]
        report: Any = rows
        lines = aligned([COUNTS, *(tuple(str(row[key]) for key in COUNTS) for row in rows)], {1, 2, 3, 4})
    else:
        report = _report(name)
        table = aligned([HEADINGS, *map(_cells, report["joints"])], _NUMBERS) if report["joints"] else []
        lines = [*table, *map(printable, _sentences(name, report))]
    if as_json:
        print(json_text(report))
    else:
        console().print(*lines, sep="\n")


def _counts(robot: str) -> dict[str, Any]:
    """Return the numbers of joints of a robot: with a coordinate of their own, hinges, sliders, those that follow."""
    joints = read_urdf(robot_urdf(robot)).joints
    hinges, sliders = ([joint for joint in joints if joint.type in types] for types in (HINGES, SLIDERS))
    names = {joint.name for joint in joints}
    following = sum(joint.follows in names for joint in hinges + sliders)  # a leader that is missing leads nothing
    numbers = (len(hinges), len(sliders), following)
    return dict(zip(COUNTS, (robot, sum(numbers[:2]) - following, *numbers), strict=True))


def _report(name: str) -> dict[str, Any]:
    """Return the joints of a robot that move, the names of those that do not, and sentences on what is wrong.

    A robot that is no tree of hinges and sliders still has hinges that can be taken as pairs.
    """
    path = name if is_urdf(name) else robot_urdf(name)
    robot = read_urdf(path)
    moving = [joint for joint in robot.joints if joint.type in (*HINGES, *SLIDERS) and joint.name]
    fixed = [joint.name for joint in robot.joints if joint.type == "fixed"]
    report: dict[str, Any] = {"robot": robot.name, "dof": None, "joints": [], "folded": fixed, "notes": []}
    try:
        mechanism = Mechanism.from_urdf(path)
    except (URDFError, ArgumentError) as error:
        report["joints"] = [_joint_row(robot, joint) for joint in moving]
        report["notes"] = [f"These joints make no whole robot: {error}"]
        return report
    by_name = {joint.name: joint for joint in moving}
    for number, facts in enumerate(_facts(mechanism.tree)):
        joint = by_name[mechanism.tree.joints[number].name]
        report["joints"].append(_joint_row(robot, joint) | facts)
    return report | {"dof": mechanism.dof, "notes": list(mechanism.tree.notes)}


def _facts(tree: Tree) -> list[dict[str, Any]]:
    """Return what the joints of a robot have as parts of it: places in q, rules of following, masses."""
    masses = [tree.base.mass, *(joint.body.mass for joint in tree.joints)]
    moved = list(masses)
    for number in range(len(tree.joints), 0, -1):
        moved[tree.joints[number - 1].parent] += moved[number]
    places = {joint.name: place for place, joint in enumerate(tree.coordinates)}
    facts = []
    for number, joint in enumerate(tree.joints, 1):
        mimic = joint.mimic and {
            "joint": tree.joints[joint.mimic.leader - 1].name,
            "multiplier": joint.mimic.multiplier,
            "offset": joint.mimic.offset,
        }
        fact = {"index": places.get(joint.name), "mimic": mimic, "mass1": masses[joint.parent]}
        facts.append(fact | {"mass2": masses[number], "mass_moved": moved[number]})
    return facts


def _joint_row(robot: Robot, joint: Joint) -> dict[str, Any]:
    """Return what a joint is by itself: links, axis, place and limits; of a hinge, those of its pair."""
    kind = "hinge" if joint.type in HINGES else "slider"
    row: dict[str, Any] = {"index": None, "joint": joint.name, "kind": kind, "type": joint.type}
    row |= {"parent": joint.parent, "child": joint.child, "follows": joint.follows, "mimic": None}
    row |= dict.fromkeys(("mass1", "mass2", "mass_moved"))
    try:
        if kind == "hinge":
            hinge_pair(robot, joint.name, name=joint.name)  # refuses what a pair cannot be made of
        home, u1 = joint.pose
        n = home @ unit_axis("axis", joint.axis) + 0.0
        row |= {"n": n.tolist(), "u1": u1.tolist(), "home": home.tolist(), "limits": joint.limits}
        row |= {"effort_limit": joint.effort, "rate_limit": joint.velocity}
    except (URDFError, ArgumentError) as error:
        row["error"] = str(error)
    return row


def _cells(row: dict[str, Any]) -> list[str]:
    place = "" if row["index"] is None else str(row["index"])
    names = [place, *(printable(row[key]) for key in ("joint", "kind", "parent", "child"))]
    if "error" in row:
        return [*names, row["error"], *[""] * 6]
    limits = "none" if row["limits"] is None else " to ".join(map(_number, row["limits"]))
    axis = " ".join(f"{round(component, 3) + 0.0:g}" for component in row["n"])
    numbers = (_number(row[key]) for key in ("effort_limit", "rate_limit", "mass2", "mass_moved"))
    return [*names, axis, limits, *numbers, printable(_rule(row))]


def _rule(row: dict[str, Any]) -> str:
    """Return how a joint follows another: `leader`, or `-0.5 leader + 0.1` where ratio or offset are given."""
    mimic = row["mimic"]
    if mimic is None:
        return str(row["follows"])
    return str(Mimic(mimic["joint"], mimic["multiplier"], mimic["offset"]))


def _sentences(name: str, report: dict[str, Any]) -> Sequence[str]:
    """Return what stands below the table."""
    joints, folded = report["joints"], report["folded"]
    sentences = []
    if report["dof"] is not None:
        sentences.append(f"{name}: q has {report['dof']} {'coordinate' if report['dof'] == 1 else 'coordinates'}.")
    if folded:
        sentences.append(f"Fixed joints, folded into the bodies that carry them: {', '.join(folded)}.")
    pairs = [row for row in joints if row["kind"] == "hinge" and "error" not in row]
    if pairs:
        sentences.append(f"Each hinge can be taken as a pair, such as: hingepair view {name} {pairs[0]['joint']}")
    return [*sentences, *report["notes"]]


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
