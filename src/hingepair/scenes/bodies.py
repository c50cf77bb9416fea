"""What moves in a scene: the tables [pair], [mechanism], [[joint]], [[loop]] and [[strut]]."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from hingepair.errors import URDFError, choices, nearest, printable, quoted
from hingepair.mechanism.bodies.body import Body, Box, Cylinder, Shape, Sphere
from hingepair.mechanism.building.pairs import depth_first_order
from hingepair.mechanism.joints import JOINT_CLASSES, RobotJoint
from hingepair.mechanism.kinds import KINDS
from hingepair.mechanism.linkages import Loop
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.mechanism.struts import GasSpring
from hingepair.scenes.tables import Key, NamedSource, Table, numbers_key

Made = TypeVar("Made")


# ---- bodies


def _read_inertia(table: Table, key: str) -> Any:
    """Return the 3 x 3 inertia under a key of a Table, given as three principal moments or as a matrix."""
    entries = table.values[key]
    diagonal = isinstance(entries, list) and not any(isinstance(row, list) for row in entries)
    return np.diag(table.numbers(key, 3)) if diagonal else table.numbers(key, 3, 3)


def _read_shapes(table: Table, key: str) -> list[Shape]:
    """Return the shapes under a key of a body's table, in the order of the file."""
    expected = "a list of { box = [...] }, { cylinder = radius, length = ... }, { sphere = radius }"
    return [_read_shape(shape) for shape in table.tables(key, expected)]


def _read_shape(table: Table) -> Shape:
    """Return the Box, Cylinder or Sphere that a Table describes."""
    named = [kind for kind in _SHAPES if kind in table.values]
    if len(named) != 1:
        table.refuse("", f"one of {', '.join(_SHAPES)}", ", ".join(named) or "none of them")
    (kind,) = named
    make, size, keys = _SHAPES[kind]
    values = table.read(keys, required=[key for key in keys if key in {kind, "length"}])
    return construct_from_table(table, make, {size: values.pop(kind), **values})


def read_body(table: Table, key: str, required: Collection[str] = ()) -> Body:
    """Return the Body (mass properties and shapes) that the table under `key` of a Table describes."""
    body_table = table.table(key)
    return construct_from_table(body_table, Body, body_table.read(BODY_KEYS, required))


def _points_key(size: int) -> Key:
    """Return the reader of the points of a body: a table of positions by name."""

    def read(table: Table, key: str) -> dict[str, Any]:
        points = table.table(key)
        return {name: points.numbers(name, size) for name in points.values}

    return read


# By the key that names a shape: its class, the attribute that this key becomes, and its keys with their readers.
_SHAPES: Final[Mapping[str, tuple[Callable[..., Shape], str, Mapping[str, Key]]]] = {
    "box": (Box, "size", {"box": numbers_key(3), "center": numbers_key(3), "axes": Table.rotation}),
    "cylinder": (
        Cylinder,
        "radius",
        {"cylinder": Table.number, "length": Table.number, "center": numbers_key(3), "axis": numbers_key(3)},
    ),
    "sphere": (Sphere, "radius", {"sphere": Table.number, "center": numbers_key(3)}),
}
BODY_KEYS: Final[Mapping[str, Key]] = {
    "mass": Table.number,
    "centre_of_mass": numbers_key(3),
    "inertia": _read_inertia,
    "shapes": _read_shapes,
}
"""Keys of a body and their readers."""
_BODIES: Final[Mapping[str, Key]] = {"body1": read_body, "body2": read_body}


# ---- pairs


_HINGE_KEYS: Final[Mapping[str, Key]] = {
    **dict.fromkeys(("u1", "u2", "n"), numbers_key(3)),
    "home": Table.rotation,
    "limits": numbers_key(2),
    "torque_limit": Table.number,
    "rate_limit": Table.number,
    "name": Table.text,
    **_BODIES,
}
_NEEDED: Final = (
    "a table [pair] with u1, u2 and n, such as u1 = [0.5, 0, 0], u2 = [-0.5, 0, 0], n = [0, 0, 1], or a [mechanism] "
    "or [[joint]]; then [motion], such as psi = 'sin(t)', and [time] with start, stop and samples"
)


def read_pair(tables: Table) -> HingePair | PlanarPair:
    """Return the pair of the table [pair]: a PlanarPair if the scene is `planar`, otherwise a HingePair. Its name is
    the stem of the file's name unless the table has one.
    """
    if "pair" not in tables.values:
        tables.refuse("pair", _NEEDED, "nothing")
    table, planar = tables.table("pair"), tables.flag("planar")
    points = dict.fromkeys(("points1", "points2"), _points_key(2 if planar else 3))
    name = {"name": _stem(table.file) or None}
    if planar:
        keys = {**dict.fromkeys(("u1", "u2"), numbers_key(2)), "name": Table.text, **_BODIES, **points}
        return construct_from_table(table, PlanarPair, name | table.read(keys, ("u1", "u2")))
    read = table.read({**_HINGE_KEYS, **points}, ("u1", "u2", "n"))
    return _with_limits(table, HingePair, name | read)


# ---- mechanisms

_MECHANISM_KEYS: Final = ("robot", "urdf", "name", "locked", "frames", "payload", "coordinates", "at")
_FRAME_KEYS: Final[Mapping[str, Key]] = {"link": Table.text, "R": numbers_key(3), "S": Table.rotation}
_LOOP_KEYS: Final[Mapping[str, Key]] = {
    **dict.fromkeys(("frame1", "frame2", "kind", "name"), Table.text),
    "axis": numbers_key(3),
    "length": Table.number,
}
_GAS_KEYS: Final[Mapping[str, Key]] = dict.fromkeys(("F1", "F2", "stroke", "friction"), Table.number)
_STRUT_KEYS: Final[Mapping[str, Key]] = {
    **dict.fromkeys(("frame1", "frame2", "name"), Table.text),
    **dict.fromkeys(("stiffness", "free_length", "damping"), Table.number),
    "gas": lambda table, key: _read_gas_spring(table.table(key)),
    "force": lambda table, key: _read_force_table(table.table(key)),
}
MECHANISM_TABLES: Final = ("mechanism", "joint", "loop", "strut")
"""Tables of a scene that describe a mechanism."""


def is_of_mechanism(tables: Table) -> bool:
    """Return whether a scene's top-level Table is that of a mechanism, not of a pair."""
    return not tables.values.keys().isdisjoint(MECHANISM_TABLES[:2])


def read_mechanism(tables: Table, folder: Path, *, base: str = "fixed") -> Mechanism:
    """Return the Mechanism that a scene's top-level Table defines, with its frames, payload, struts and loops.

    Args:
        tables: top-level table of the scene file.
        folder: folder that the path of a URDF file is relative to.
        base: "fixed" or "free".
    """
    table = tables.table("mechanism", required=False)
    table.check_keys(_MECHANISM_KEYS)
    sources = [key for key in ("robot", "urdf") if key in table.values]
    if "joint" in tables.values:
        for key in (*sources, *({"locked"} & table.values.keys())):
            table.fail(key, "no such key together with [[joint]] tables, which describe the mechanism")
    elif len(sources) != 1:
        expected = 'a robot of example-robot-data, such as robot = "panda"; or urdf = "file"; or [[joint]] tables'
        table.refuse("robot", expected, "both robot and urdf" if sources else "none of them")
    robot = _assemble_joints(tables, table, base) if "joint" in tables.values else _read_robot(table, folder, base)
    frames, payload = table.table("frames", required=False), table.table("payload", required=False)
    for name in frames.values:
        frame = frames.table(name)
        values: dict[str, Any] = frame.read(_FRAME_KEYS, ("link",))
        if tree_of(robot).frame(name) is not None:
            frames.refuse(name, "a name that no link, joint or frame has", quoted(name))
        with frame.naming():
            robot = robot.with_frame(name, values["link"], values.get("R", np.zeros(3)), values.get("S"))
    for link in payload.values:
        with payload.naming(link=link):
            robot = robot.with_payload(link, read_body(payload, link, ("mass",)))
    return _closed(tables, _with_struts(tables, robot), table)


def _read_robot(table: Table, folder: Path, base: Any) -> Mechanism:
    """Return the robot that the Table [mechanism] names, with its locked joints."""
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


def _assemble_joints(tables: Table, table: Table, base: Any) -> Mechanism:
    """Return the Mechanism of the [[joint]] tables in the top-level Table `tables`, which may come in any order."""
    joints: dict[str, Table] = {}
    for numbered in tables.tables("joint", "tables [[joint]], one for each joint"):
        for key in ("points1", "points2"):
            if key in numbered.values:
                expected = "no such key: points of a mechanism stand in [mechanism.frames] with link and R"
                numbered.refuse(key, expected, "an unknown key")
        numbered.check_keys(("parent", "kind", "pitch", *_HINGE_KEYS))
        name = numbered.text("name")
        if name in joints:
            numbered.refuse("name", "another name for each joint", f"{name!r} twice")
        joints[name] = replace(numbered, name=f"joint.{name}")
    if not joints:
        tables.fail("joint", "tables [[joint]], one for each joint")
    names = [*joints]
    parents = [_parent_number(joint, names) for joint in joints.values()]
    title = table.text("name", _stem(table.file) or "mechanism")
    with NamedSource(tables.file, "").naming(pairs="joint", parents="parent of [[joint]]"):
        order = depth_first_order(names, parents)
        pairs = [_read_joint(names[k], joints[names[k]]) for k in order]
        parents = [1 + order.index(parents[k] - 1) if parents[k] else 0 for k in order]
        return Mechanism(pairs, parents, base, title)


def _parent_number(table: Table, names: list[str]) -> int:
    """Return the number of the parent that a [[joint]] table names, from 1 on; 0 if it names none."""
    name = table.text("parent") if "parent" in table.values else None
    if name is not None and name not in names:
        wanted = f"a joint whose body carries this one, {choices(names)}, or no such key (the base does)"
        table.refuse("parent", wanted + nearest(name, names), quoted(name))
    return 0 if name is None else 1 + names.index(name)


def _read_joint(name: str, table: Table) -> RobotJoint:
    """Return the joint `name` of a Table [[joint]]."""
    kind: Any = table.choice("kind", tuple(JOINT_CLASSES))
    pitch: dict[str, Key] = {"pitch": Table.number} if KINDS[kind].has_pitch else {}
    values = {key: value for key, value in table.values.items() if key not in {"parent", "kind"}}
    described = replace(table, values=values).read({**_HINGE_KEYS, **pitch}, ("u1", "u2", "n", *pitch))
    make: Callable[..., RobotJoint] = JOINT_CLASSES[kind]
    return _with_limits(table, make, {**described, "name": name})


def _with_limits(table: Table, make: Callable[..., Made], arguments: Mapping[str, Any]) -> Made:
    """Return what `construct_from_table` does, without a warning of limits in degrees: `scene.suspicions` says so."""
    limits = {key: value for key, value in arguments.items() if key == "limits"}
    made = construct_from_table(table, make, {**arguments, "limits": None})
    changed: Callable[..., Made] = functools.partial(replace, made)  # type: ignore[type-var]
    return construct_from_table(table, changed, limits) if limits else made


# ---- loops and struts


def _read_gas_spring(table: Table) -> GasSpring:
    return construct_from_table(table, GasSpring, table.read(_GAS_KEYS, ("F1", "F2", "stroke")))


def _read_force_table(table: Table) -> tuple[Any, Any]:
    """Return lengths [m] and forces [N] of a strut."""
    table.check_keys(("lengths", "forces"))
    lengths = table.values.get("lengths")
    count = max(len(lengths), 2) if isinstance(lengths, list) else 2
    return table.numbers("lengths", count), table.numbers("forces", count)


def _with_struts(tables: Table, robot: Mechanism) -> Mechanism:
    """Return the robot with the struts of the tables [[strut]]."""
    for table in tables.tables("strut", "tables [[strut]], one for each strut", required=False):
        values = table.read(_STRUT_KEYS, ("frame1", "frame2", "name"))
        if "gas" in values and "force" in values:
            table.fail("force", "no such key beside gas, which gives the force")
        gas = values.pop("gas", None)
        with table.naming():
            robot = robot.with_strut(**({"force": gas} if gas else {}) | values)
    return robot


def _closed(tables: Table, robot: Mechanism, table: Table) -> Mechanism:
    """Return the robot with the loops of the tables [[loop]] closed; `table` is the Table [mechanism], whose keys
    `coordinates` and `at` say what determines its joints, and where it is assembled.
    """
    loops = []
    for described in tables.tables("loop", "tables [[loop]], one for each loop", required=False):
        values = described.read(_LOOP_KEYS, ("frame1", "frame2"))
        for end in ("frame1", "frame2"):
            if tree_of(robot).frame(values[end]) is None:
                known = (*robot.links, *tree_of(robot).frames)
                described.refuse(end, f"a frame, {choices(known)}{nearest(values[end], known)}", quoted(values[end]))
        loops.append(construct_from_table(described, Loop, values))
    if not loops and "coordinates" not in table.values:
        if "at" in table.values:
            table.fail("at", "no such key without tables [[loop]], or struts among the coordinates")
        return robot
    coordinates = table.names("coordinates", 'a list of joints and struts, such as ["crank"]')
    at = table.table("at", required=False)
    near = {name: at.number(name) for name in at.values}
    with table.naming(loops="coordinates"):
        return robot.closed(*loops, coordinates=coordinates, at=near or None)


def construct_from_table(table: Table, factory: Callable[..., Made], arguments: Mapping[str, Any]) -> Made:
    """Return factory(**arguments); an ArgumentError becomes a SceneError on the key of `table` of the same name."""
    with table.naming():
        return factory(**arguments)


def _stem(file: str) -> str:
    return " ".join(printable(Path(file).stem).split())
