"""`hingepair robots`: the robots whose hinges a scene or a command may name."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer

from hingepair.cli.output import Json
from hingepair.cli.pairs import is_urdf
from hingepair.errors import URDFError, printable
from hingepair.formats.robots import robot_names, robot_urdf
from hingepair.formats.urdf_reader import hinge_pair
from hingepair.numeric.tables import aligned
from hingepair.urdf.reader import read_urdf

HEADINGS = (
    "joint",
    "body 1",
    "body 2",
    "axis n",
    "limits [rad]",
    "[N m]",
    "[rad/s]",
    "m1 [kg]",
    "m2 [kg]",
    "follows",
)


def robots(
    name: Annotated[
        str | None, typer.Argument(metavar="NAME", help="Show the hinges of this robot, or of a URDF file.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the robots, or the hinges of one.

    A scene or a command may name any of them. Of a hinge it shows the links, the axis n in body 1's axes, the limits
    of angle, torque and rate, the masses of both bodies, and the joint that it follows.
    """
    found = _counts() if name is None else _hinges(name)
    if as_json:
        print(json.dumps(found, indent=2))
        return
    if name is None:
        lines = aligned([("robot", "hinges"), *((row["robot"], str(row["hinges"])) for row in found)], {1})
    else:
        lines = aligned([HEADINGS, *map(_cells, found)], {4, 5, 6, 7, 8})
    print("\n".join(lines))


def _counts() -> list[dict[str, Any]]:
    return [{"robot": name, "hinges": len(read_urdf(robot_urdf(name)).hinges())} for name in robot_names()]


def _hinges(name: str) -> list[dict[str, Any]]:
    robot = read_urdf(name if is_urdf(name) else robot_urdf(name))
    found = []
    for hinge in robot.hinges():
        row: dict[str, Any] = {"joint": hinge.name, "type": hinge.type, "parent": hinge.parent, "child": hinge.child}
        row |= {"follows": hinge.follows}
        try:
            pair = hinge_pair(robot, hinge.name, name=hinge.name)
        except URDFError as error:
            found.append(row | {"error": str(error)})
            continue
        row |= {"n": pair.n.tolist(), "u1": pair.u1.tolist(), "home": pair.home.tolist(), "limits": pair.limits}
        row |= {"torque_limit": pair.torque_limit, "rate_limit": pair.rate_limit}
        row |= {f"mass{i}": body and body.mass for i, body in ((1, pair.body1), (2, pair.body2))}
        found.append(row)
    return found


def _cells(row: dict[str, Any]) -> list[str]:
    names = [printable(row[key]) for key in ("joint", "parent", "child")]
    if "error" in row:
        return [*names, row["error"], *[""] * 6]
    limits = "none" if row["limits"] is None else " to ".join(map(_number, row["limits"]))
    axis = " ".join(f"{round(component, 3) + 0.0:g}" for component in row["n"])
    numbers = (_number(row[key]) for key in ("torque_limit", "rate_limit", "mass1", "mass2"))
    return [*names, axis, limits, *numbers, printable(row["follows"])]


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}"
