"""What moves in a scene: the tables [pair], [mechanism], [[joint]], [[loop]] and [[strut]]."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from hingepair.errors import URDFError, choices, nearest, printable, quoted
from hingepair.mechanism.bodies.body import Body, Box, Cylinder, Shape, Sphere
from hingepair.mechanism.joints import JOINT_CLASSES, KINDS, RobotJoint
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


def read_body(table: Table, key: str) -> Body:
    """Return the Body (mass properties and shapes) that the table under `key` of a Table describes."""
    body_table = table.table(key)
    return construct_from_table(body_table, Body, body_table.read(BODY_KEYS))


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


def _geometry_keys(size: int) -> dict[str, Key]:
    """Return the keys of the geometry of a pair in 2 or 3 dimensions."""
    keys: dict[str, Key] = {"u1": numbers_key(size), "u2": numbers_key(size)}
    return keys if size == 2 else {**keys, "n": numbers_key(3), "home": Table.rotation, "limits": numbers_key(2)}


def _point_keys(size: int) -> dict[str, Key]:
    return dict.fromkeys(("points1", "points2"), _points_key(size))


_HINGE_KEYS: Final[Mapping[str, Key]] = {
    **_geometry_keys(3),
    "torque_limit": Table.number,
    "rate_limit": Table.number,
    "name": Table.text,
    **_BODIES,
}
_ROBOT_HINGE_KEYS: Final[Mapping[str, Key]] = {"robot": Table.text, "joint": Table.text}


def read_pair(tables: Table) -> HingePair | PlanarPair:
    """Return the pair of the table [pair], which describes it or names a robot's hinge: a PlanarPair if the scene is
    `planar`, otherwise a HingePair. Its name is the stem of the file's name unless the table has one.
    """
    if is_of_mechanism(tables):
        tables.refuse("pair", "the scene of a pair, which has a table [pair]", "the scene of a mechanism")
    table = tables.table("pair")
    name = {"name": _stem(table.file) or None}
    if tables.flag("planar"):
        keys = {**_geometry_keys(2), "name": Table.text, **_BODIES, **_point_keys(2)}
        return construct_from_table(table, PlanarPair, name | table.read(keys, ("u1", "u2")))
    keys = {**_HINGE_KEYS, **_point_keys(3)}
    table.check_keys((*keys, *_ROBOT_HINGE_KEYS))
    if not table.values.keys() & _ROBOT_HINGE_KEYS:
        return construct_from_table(table, HingePair, name | table.read(keys, ("u1", "u2", "n")))
    from hingepair.formats.robots import load_robot_hinge

    known = {**_ROBOT_HINGE_KEYS, **_BODIES, **_point_keys(3)}
    for key in table.values:
        if key not in known:
            table.fail(key, f"no such key together with robot: {', '.join(known)} describe the pair")
    values = table.read(known, _ROBOT_HINGE_KEYS)
    pair = construct_from_table(table, load_robot_hinge, {key: values.pop(key) for key in _ROBOT_HINGE_KEYS})
    with table.naming():
        return replace(pair, **values)


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
        for key in (*sources, "locked"):
            if key in table.values:
                table.fail(key, "no such key together with [[joint]] tables, which describe the mechanism")
    elif len(sources) != 1:
        expected = 'a robot of example-robot-data, such as robot = "panda"; or urdf = "file"; or [[joint]] tables'
        table.refuse("robot", expected, "both robot and urdf" if sources else "none of them")
    robot = _assemble_joints(tables, table, base) if "joint" in tables.values else _read_robot(table, folder, base)
    robot = with_payload(_with_frames(robot, table), table)
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
    described = tables.tables("joint", "tables [[joint]], one for each joint")
    names = [one.values.get("name") for one in described]
    for numbered in described:
        for key in numbered.values:
            if key in names and key not in _HINGE_KEYS:
                numbered.refuse(key, "the motion of a joint under [motion]", "a joint in another table")
        numbered.check_keys(("name", "parent", "kind", "pitch", *_HINGE_KEYS))
        name = numbered.text("name")
        if name in joints:
            numbered.refuse("name", "another name for each joint", f"{name!r} twice")
        joints[name] = replace(numbered, name=f"joint.{name}")
    if not joints:
        tables.fail("joint", "tables [[joint]], one for each joint")
    parents = {name: _parent_joint(joint, joints) for name, joint in joints.items()}
    order = _depth_first_names(joints, parents)
    pairs = [_read_joint(name, joints[name]) for name in order]
    parent_indices = [0 if parents[name] is None else 1 + order.index(str(parents[name])) for name in order]
    title = table.text("name", _stem(table.file) or "mechanism")
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
    children: dict[str | None, list[str]] = {}
    for name in sorted(joints, reverse=True):
        children.setdefault(parents[name], []).append(name)
    order: dict[str, None] = {}
    waiting = [*children.get(None, ())]
    while waiting:
        joint = waiting.pop()
        order[joint] = None
        waiting += children.get(joint, ())
    for name, table in joints.items():
        if name not in order:
            table.refuse("parent", "joints that lead to the base, one without a parent", f"a circle through {name!r}")
    return [*order]


def _read_joint(name: str, table: Table) -> RobotJoint:
    """Return the joint `name` of a Table [[joint]]."""
    kind: Any = table.choice("kind", tuple(JOINT_CLASSES))
    keys = {**_HINGE_KEYS, "pitch": Table.number} if KINDS[kind].has_pitch else _HINGE_KEYS
    needed = ("u1", "u2", "n", *(key for key in keys if key not in _HINGE_KEYS))
    values = {key: value for key, value in table.values.items() if key not in {"parent", "kind"}}
    described = replace(table, values=values).read(keys, needed)
    made: Any = construct_from_table(table, JOINT_CLASSES[kind], {**described, "name": name})
    joint: RobotJoint = made
    return joint


def _with_frames(robot: Mechanism, table: Table) -> Mechanism:
    """Return the robot with the frames of [mechanism.frames]; `table` is the Table [mechanism]."""
    frames = table.table("frames", required=False)
    for name in frames.values:
        frame = frames.table(name)
        values: dict[str, Any] = frame.read(_FRAME_KEYS, ("link",))
        if tree_of(robot).frame(name) is not None:
            frames.refuse(name, "a name that no link, joint or frame has", quoted(name))
        with frame.naming():
            robot = robot.with_frame(name, values["link"], values.get("R", np.zeros(3)), values.get("S"))
    return robot


def with_payload(robot: Mechanism, table: Table, names: Collection[str] | None = None) -> Mechanism:
    """Return the robot with the bodies of [mechanism.payload], or those of `names`, fixed to the links, joints or
    frames that their keys name; `table` is the Table [mechanism].
    """
    payload = table.table("payload", required=False)
    for link in payload.values if names is None else names:
        described = payload.table(link)
        if "link" in described.values:
            meant = f"[mechanism.payload.{described.text('link')}]"
            described.fail("link", f"no such key, since the name behind payload is the link's: {meant}")
        body = construct_from_table(described, Body, described.read(BODY_KEYS, ("mass",)))
        with payload.naming(link=link):
            robot = robot.with_payload(link, body)
    return robot


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
