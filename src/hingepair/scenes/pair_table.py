"""The tables of a scene file as the parts of a scene: its pair, its motion, its outputs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

from hingepair.errors import ArgumentError, SceneError
from hingepair.evaluation.plan import check_outputs
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.scenes.expression_motion import ExpressionMotion, read_expression_motion
from hingepair.scenes.integrated_motion import IntegratedMotion
from hingepair.scenes.logged_motion import SampledMotion, read_sampled_motion
from hingepair.scenes.rate_expressions import read_rate_expressions
from hingepair.scenes.rate_file import read_rate_file
from hingepair.scenes.tables import Table

Made = TypeVar("Made")
Motion: TypeAlias = ExpressionMotion | SampledMotion | IntegratedMotion
"""Knows its instants `t`, its `level`, its `sequence`, and gives `samples(rows, order)`."""


def read_planar(tables: Table) -> bool:
    """Whether the scene is one of the plane."""
    planar = tables.values.get("planar", False)
    if not isinstance(planar, bool):
        tables.fail("planar", "true or false")
    return planar


def read_pair(table: Table, planar: bool) -> HingePair | PlanarPair:
    """The pair of the table [pair]."""
    if planar:
        return _planar_pair(table)
    if "robot" in table.values or "joint" in table.values:
        table.check_keys(("robot", "joint", "u1", "u2", "n", "home", "name", "limits"))
        for key in table.values:
            if key not in {"robot", "joint"}:
                table.fail(key, "nothing beside robot and joint")
        return _robot_pair(table)
    table.check_keys(("u1", "u2", "n", "home", "name", "limits", "robot", "joint"))
    values: dict[str, Any] = {key: table.numbers(key, 3) for key in ("u1", "u2", "n")}
    if "home" in table.values:
        values["home"] = table.numbers("home", 3, 3)
    if "limits" in table.values:
        values["limits"] = table.numbers("limits", 2)
    if "name" in table.values:
        values["name"] = table.text("name")
    return _made(table, HingePair, **values)


def _planar_pair(table: Table) -> PlanarPair:
    table.check_keys(("u1", "u2", "name"))
    values: dict[str, Any] = {key: table.numbers(key, 2) for key in ("u1", "u2")}
    if "name" in table.values:
        values["name"] = table.text("name")
    return _made(table, PlanarPair, **values)


def _robot_pair(table: Table) -> HingePair:
    from hingepair.formats.robots import load_robot_hinge

    return _made(table, load_robot_hinge, robot=table.text("robot"), joint=table.text("joint"))


def _made(table: Table, make: Callable[..., Made], **values: Any) -> Made:
    """What is made of the values of a table; an argument that is refused is named as the key that it came from."""
    try:
        return make(**values)
    except ArgumentError as error:
        raise SceneError(table.label(error.name), error.expected, error.got) from None


def read_motion(tables: Table, folder: Path, planar: bool) -> Motion:
    """The motion of the tables [motion] and [time]; files are relative to the folder."""
    motion = tables.table("motion", required=False)
    if "file" not in motion.values:
        time = tables.table("time")
        if "omega1" in motion.values:
            return read_rate_expressions(motion, time, planar)
        return read_expression_motion(tables.table("motion"), time, planar)
    if planar:
        motion.fail("file", "no such key in a planar scene, whose motion is expressions")
    if "time" in tables.values:
        tables.fail("time", "no such table beside motion.file, whose column t has the instants")
    integrated = motion.values.get("integrate", False)
    if not isinstance(integrated, bool):
        motion.fail("integrate", "true or false")
    return read_rate_file(motion, folder) if integrated else read_sampled_motion(motion, folder)


def read_outputs(table: Table, kind: str) -> tuple[str, ...] | None:
    """The names of the table [outputs]; None without."""
    table.check_keys(("names",))
    if "names" not in table.values:
        return None
    names = table.values["names"]
    if not isinstance(names, list) or not names or not all(isinstance(name, str) for name in names):
        table.fail("names", 'a list of names such as ["R2", "v2"]')
    try:
        return check_outputs(names, kind)
    except ArgumentError as error:
        raise SceneError(table.label("names"), error.expected, error.got) from None
