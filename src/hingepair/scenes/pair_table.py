"""The table [pair] of a scene file: geometry, limits, masses and shapes of a pair, or a robot's hinge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from hingepair.errors import printable
from hingepair.pair.body import Body, Box, Cylinder, Shape, Sphere
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.scenes.tables import Table

Made = TypeVar("Made")

KEYS = ("u1", "u2", "n", "home", "limits", "torque_limit", "rate_limit", "name", "body1", "body2", "robot", "joint")


def read_pair(table: Table, planar: bool) -> HingePair | PlanarPair:
    """The pair of the table [pair].

    Raises:
        SceneError: a value cannot be used; names file, table and key.
        MissingDependencyError: the pair is a robot's, and example-robot-data is not installed.
    """
    if planar:
        table.check_keys(("u1", "u2", "name", "body1", "body2"))
        own = {key: table.numbers(key, 2) for key in ("u1", "u2")}
        return _made(table, PlanarPair, **own, **_bodies(table), name=_name(table))
    table.check_keys(KEYS)
    if "robot" in table.values or "joint" in table.values:
        from hingepair.formats.robots import load_robot_hinge

        for key in table.values:
            if key not in {"robot", "joint", "body1", "body2"}:
                table.fail(key, "nothing beside robot, joint, body1 and body2")
        hinge = _made(table, load_robot_hinge, robot=table.text("robot"), joint=table.text("joint"))
        bodies: dict[str, Any] = _bodies(table)
        return replace(hinge, **bodies)
    values: dict[str, Any] = {key: table.numbers(key, 3) for key in ("u1", "u2", "n")}
    if "home" in table.values:
        values["home"] = table.rotation("home")
    if "limits" in table.values:
        values["limits"] = table.numbers("limits", 2)
    values |= {key: table.number(key) for key in ("torque_limit", "rate_limit") if key in table.values}
    return _made(table, HingePair, **values, **_bodies(table), name=_name(table))


def _bodies(table: Table) -> dict[str, Body]:
    return {key: _body(table.table(key)) for key in ("body1", "body2") if key in table.values}


def _name(table: Table) -> str:
    """The name of the pair; that of the file unless given."""
    return table.text("name", printable(Path(table.file).stem).strip() or None)


def _body(table: Table) -> Body:
    """Mass properties and shapes: the table [pair.body1]."""
    table.check_keys(("mass", "center_of_mass", "inertia", "shapes"))
    values: dict[str, Any] = {"mass": table.number("mass", 1.0)}
    if "center_of_mass" in table.values:
        values["center_of_mass"] = table.numbers("center_of_mass", 3)
    if "inertia" in table.values:
        moments = table.values["inertia"]
        diagonal = isinstance(moments, list) and not any(isinstance(row, list) for row in moments)
        values["inertia"] = np.diag(table.numbers("inertia", 3)) if diagonal else table.numbers("inertia", 3, 3)
    shapes = table.values.get("shapes", [])
    if not isinstance(shapes, list) or not all(isinstance(shape, dict) for shape in shapes):
        table.fail("shapes", "a list of { box = [...] }, { cylinder = radius, length = ... }, { sphere = radius }")
    own = [Table(table.file, f"{table.name}.shapes[{i}]", shape, table.constants) for i, shape in enumerate(shapes)]
    return _made(table, Body, shapes=[_shape(shape) for shape in own], **values)


def _shape(table: Table) -> Shape:
    kinds: dict[str, tuple[Callable[..., Shape], tuple[str, ...]]] = {
        "box": (Box, ("center", "axes")),
        "cylinder": (Cylinder, ("length", "center", "axis")),
        "sphere": (Sphere, ("center",)),
    }
    named = [kind for kind in kinds if kind in table.values]
    if len(named) != 1:
        table.refuse("", f"one of {', '.join(kinds)}", ", ".join(named) or "none of them")
    (kind,) = named
    make, others = kinds[kind]
    table.check_keys((kind, *others))
    values: dict[str, Any] = {"size": table.numbers(kind, 3)} if kind == "box" else {"radius": table.number(kind)}
    values |= {key: table.numbers(key, 3) for key in ("center", "axis") if key in table.values}
    if kind == "cylinder":
        values["length"] = table.number("length")
    if "axes" in table.values:
        values["axes"] = table.rotation("axes")
    return _made(table, make, **values)


def _made(table: Table, make: Callable[..., Made], **values: Any) -> Made:
    """What is made of the values of a table; an argument that is refused is named as the key that it came from."""
    with table.naming():
        return make(**values)
