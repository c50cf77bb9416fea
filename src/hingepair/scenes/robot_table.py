"""The tables [mechanism] and [[joint]] of a scene file: a robot or a tree of joints, with frames and payload."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from hingepair.errors import SceneError, URDFError, choices, nearest, printable, quoted
from hingepair.mechanism.bodies.body import Body
from hingepair.mechanism.joints import JOINT_CLASSES, KINDS, RobotJoint
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.tree import BASE_KINDS
from hingepair.scenes.pair_table import (
    BODY_KEYS,
    PAIR_KEYS,
    construct_from_table,
)
from hingepair.scenes.tables import Key, NamedSource, Table, numbers_key

_SOURCES: Final = ("robot", "urdf")
"""Keys of [mechanism] that name a robot or its file; it has one of them, or none beside [[joint]] tables."""
MECHANISM_KEYS: Final = ("robot", "urdf", "name", "base", "locked", "gravity", "joint_loads", "frames", "payload")
"""Keys that the table [mechanism] may have."""
JOINT_TABLE_KEYS: Final = (
    "name",
    "parent",
    "kind",
    "pitch",
    *(key for key in PAIR_KEYS if key != "name"),
)
"""Keys that a table [[joint]] may have."""
_FRAME_KEYS: Final[Mapping[str, Key]] = {
    "link": Table.text,
    "R": numbers_key(3),
    "S": Table.rotation,
}
"""Keys of a frame and their readers: its link, and its position [m] and attitude in the link."""


def read_mechanism(tables: Table, folder: Path) -> Mechanism:
    """Return the Mechanism that the tables [mechanism] and [[joint]] of a scene's top-level Table define, with its
    frames and payload.

    Args:
        tables: top-level table of the scene file.
        folder: folder that the path of a URDF file is relative to.
    """
    table = tables.table("mechanism", required=False)
    table.check_keys(MECHANISM_KEYS)
    sources = [key for key in _SOURCES if key in table.values]
    if "joint" in tables.values:
        for key in (*sources, "locked"):
            if key in table.values:
                table.fail(key, "no such key together with [[joint]] tables, which describe the mechanism")
    elif len(sources) != 1:
        expected = 'a robot of example-robot-data, such as robot = "panda"; or urdf = "file"; or [[joint]] tables'
        table.refuse("robot", expected, "both robot and urdf" if sources else "none of them")
    base = table.choice("base", BASE_KINDS)
    if base == "free" and not {"base", "dynamics"} & tables.values.keys():
        table.fail("base", '"fixed", or "free" together with a table [base] for the motion of the base')
    robot = _assemble_joints(tables, table, base) if "joint" in tables.values else _read_robot(table, folder, base)
    return with_payload(_with_frames(robot, table), table)


def read_gravity(tables: Table) -> tuple[float, ...] | None:
    """Return the gravity vector of the table [mechanism] in a scene's top-level Table, three floats [m/s^2]; None if
    the table has no key gravity.
    """
    table = tables.table("mechanism", required=False)
    return tuple(table.numbers("gravity", 3)) if "gravity" in table.values else None


def read_joint_loads(tables: Table) -> bool:
    """Return whether springs, dampers and dry friction of the joints count among the forces of a scene."""
    dynamics = tables.table("dynamics", required=False)
    return tables.table("mechanism", required=False).flag("joint_loads") or dynamics.flag("joint_loads")


def _read_robot(table: Table, folder: Path, base: str) -> Mechanism:
    """Return the Mechanism of the URDF file or of the robot of example-robot-data that the Table [mechanism] names,
    with its locked joints.
    """
    if "name" in table.values:
        table.fail("name", "no such key together with robot or urdf, which have a name")
    held = table.table("locked", required=False)
    locked = {joint: held.number(joint) for joint in held.values}
    if "robot" in table.values:
        from hingepair.formats.robots import load_robot

        with table.naming():
            return load_robot(table.text("robot"), base, locked)
    file = folder / table.file_name("urdf")
    if not os.path.isfile(file):  # of a name that is too long Path.is_file would raise
        table.refuse("urdf", "a URDF file that can be read", f"no such file: {file}")
    with table.naming():
        try:
            return Mechanism.from_urdf(file, base, locked)
        except URDFError:
            with NamedSource(str(file), "").naming(path_or_text="URDF"):
                raise


def _assemble_joints(tables: Table, table: Table, base: str) -> Mechanism:
    """Return the Mechanism of the [[joint]] tables in the top-level Table `tables`, which may come in any order."""
    joint_tables = tables.values["joint"]
    if (
        not isinstance(joint_tables, list)
        or not joint_tables
        or not all(isinstance(values, dict) for values in joint_tables)
    ):
        tables.fail("joint", "tables [[joint]], one for each joint")
    joints: dict[str, Table] = {}
    for i, values in enumerate(joint_tables):
        numbered = replace(tables, name=f"joint[{i}]", values=values)
        numbered.check_keys(JOINT_TABLE_KEYS)
        name = numbered.text("name")
        if name in joints:
            numbered.refuse("name", "another name for each joint", f"{name!r} twice")
        joints[name] = replace(numbered, name=f"joint.{name}")
    parents = {name: _parent_joint(joint, joints) for name, joint in joints.items()}
    order = _depth_first_names(joints, parents)
    pairs = [_read_joint_pair(name, joints[name]) for name in order]
    parent_indices = [0 if parents[name] is None else 1 + order.index(str(parents[name])) for name in order]
    title = table.text("name", " ".join(printable(Path(table.file).stem).split()) or "mechanism")
    with NamedSource(tables.file, "").naming(pairs="joint", parents="joint"):
        return Mechanism(pairs, parent_indices, base, title)


def _parent_joint(table: Table, joints: Mapping[str, Table]) -> str | None:
    """Return the name of the parent that a [[joint]] table names; None if it names none."""
    if "parent" not in table.values:
        return None
    name = table.text("parent")
    if name not in joints:
        wanted = f"a joint whose body carries this one, {choices(tuple(joints))}, or no such key (the base does)"
        table.refuse("parent", wanted + nearest(name, joints), quoted(name))
    return name


def _depth_first_names(joints: Mapping[str, Table], parents: Mapping[str, str | None]) -> list[str]:
    """Return the names of the joints in depth-first order, siblings by name; refuse circles."""
    order: list[str] = []
    waiting: list[str | None] = [None]
    while waiting:
        joint = waiting.pop()
        if joint is not None:
            order.append(joint)
        waiting += sorted((name for name, parent in parents.items() if parent == joint), reverse=True)
    for name, table in joints.items():
        if name not in order:
            table.refuse("parent", "joints that lead to the base, one without a parent", f"a circle through {name!r}")
    return order


def _read_joint_pair(name: str, table: Table) -> RobotJoint:
    """Return the joint `name` of a Table [[joint]]."""
    kind: Any = table.choice("kind", tuple(JOINT_CLASSES))
    keys = {**PAIR_KEYS, "pitch": Table.number} if KINDS[kind].has_pitch else PAIR_KEYS
    needed = ("u1", "u2", "n", *(key for key in keys if key not in PAIR_KEYS))
    described = replace(
        table, values={key: value for key, value in table.values.items() if key not in {"parent", "kind"}}
    )
    pair: Any = construct_from_table(table, JOINT_CLASSES[kind], {**described.read(keys, needed), "name": name})
    made: RobotJoint = pair
    return made


def _with_frames(robot: Mechanism, table: Table) -> Mechanism:
    """Return a copy of the robot with the frames of [mechanism.frames] added; `table` is the Table [mechanism]."""
    frames = table.table("frames", required=False)
    for name in frames.values:
        frame = frames.table(name)
        values: dict[str, Any] = frame.read(_FRAME_KEYS, ("link",))
        if tree_of(robot).frame(name) is not None:
            frames.refuse(name, "a name that no link, joint or frame has", quoted(name))
        with frame.naming():
            robot = robot.with_frame(name, values["link"], values.get("R", np.zeros(3)), values.get("S"))
    return robot


def with_payload(robot: Mechanism, table: Table) -> Mechanism:
    """Return a copy of the robot with the bodies of [mechanism.payload] fixed to the links, joints or frames that
    their keys name; `table` is the Table [mechanism].
    """
    payload = table.table("payload", required=False)
    for link in payload.values:
        described = payload.table(link)
        if "link" in described.values:
            meant = f"[mechanism.payload.{described.text('link')}]"
            described.fail("link", f"no such key, since the name behind payload is the link's: {meant}")
        body = construct_from_table(described, Body, described.read(BODY_KEYS, ("mass",)))
        with payload.naming(link=link):
            robot = robot.with_payload(link, body)
    return robot


def is_stray_joint(tables: Table, folder: Path, error: SceneError) -> bool:
    """Return whether an error is about a joint of the robot in a table that moves none, such as [time]."""
    *parents, key = error.loc or ("",)
    if not parents or parents[0] in {"motion", "dynamics"} or parents[-1] == "locked":
        return False
    value: Any = tables.values
    for step in (*parents, key):
        value = value.get(step) if isinstance(value, dict) else None
    if isinstance(value, dict) and "value" not in value:  # no way points: a frame, or a payload
        return False
    if "joint" in tables.values:
        return key in (joint.get("name") for joint in tables.values["joint"] if isinstance(joint, dict))
    table = tables.table("mechanism")
    source = {name: entry for name, entry in table.values.items() if name in {"robot", "urdf"}}
    try:
        return key in read_mechanism(replace(tables, values={"mechanism": source}), folder).names
    except SceneError:
        return False
