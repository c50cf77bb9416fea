"""The table [pair] of a scene file: geometry, limits, masses and shapes of a pair, or a robot's hinge."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from hingepair.errors import printable
from hingepair.mechanism.bodies.body import Body, Box, Cylinder, Shape, Sphere
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.planar_pair import PlanarPair
from hingepair.scenes.tables import Key, Table, numbers_key

Made = TypeVar("Made")


def _read_inertia(table: Table, key: str) -> Any:
    """Return the 3 x 3 inertia under a key of a Table, given as three principal moments or as a matrix."""
    entries = table.values[key]
    diagonal = isinstance(entries, list) and not any(isinstance(row, list) for row in entries)
    return np.diag(table.numbers(key, 3)) if diagonal else table.numbers(key, 3, 3)


def _read_shapes(table: Table, key: str) -> list[Shape]:
    """Return the shapes under a key of a body's table, in the order of the file."""
    shape_tables = table.values[key]
    if not isinstance(shape_tables, list) or not all(isinstance(shape, dict) for shape in shape_tables):
        table.fail(key, "a list of { box = [...] }, { cylinder = radius, length = ... }, { sphere = radius }")
    return [
        _read_shape(replace(table, name=f"{table.name}.{key}[{i}]", values=values))
        for i, values in enumerate(shape_tables)
    ]


def _read_shape(table: Table) -> Shape:
    """Return the Box, Cylinder or Sphere that a Table describes."""
    named = [kind for kind in _SHAPES if kind in table.values]
    if len(named) != 1:
        table.refuse(
            "",
            f"one of {', '.join(_SHAPES)}",
            ", ".join(named) or "none of them",
        )
    (kind,) = named
    make, size, keys = _SHAPES[kind]
    values = table.read(keys, required=[key for key in keys if key in {kind, "length"}])
    return construct_from_table(table, make, {size: values.pop(kind), **values})


def read_body(table: Table, key: str) -> Body:
    """Return the Body (mass properties and shapes) that the table under `key` of a Table describes."""
    body_table = table.table(key)
    return construct_from_table(body_table, Body, body_table.read(BODY_KEYS))


def points_key(size: int) -> Key:
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
CENTRES: Final = ("centre_of_mass", "center_of_mass")
"""Both spellings of a key of a body."""
BODY_KEYS: Final[Mapping[str, Key]] = {
    "mass": Table.number,
    **dict.fromkeys(CENTRES, numbers_key(3)),
    "inertia": _read_inertia,
    "shapes": _read_shapes,
}
"""Keys of a body and their readers."""
_BODIES: Final[Mapping[str, Key]] = {"body1": read_body, "body2": read_body}
"""Keys of both bodies of a pair and their readers."""
_POINTS: Final[Mapping[int, Mapping[str, Key]]] = {
    size: dict.fromkeys(("points1", "points2"), points_key(size)) for size in (2, 3)
}
"""Keys of the points of both bodies and their readers, in the plane and in space."""
_ROBOT_HINGE_KEYS: Final[Mapping[str, Key]] = {"robot": Table.text, "joint": Table.text}
"""Keys that take a pair from a hinge of a robot, and their readers."""
_PLANAR_KEYS: Final[Mapping[str, Key]] = {
    "u1": numbers_key(2),
    "u2": numbers_key(2),
    "name": Table.text,
    **_BODIES,
    **_POINTS[2],
}
"""Keys of a pair in the plane and their readers; u1 and u2 in metres."""
PAIR_KEYS: Final[Mapping[str, Key]] = {
    **{
        "u1": numbers_key(3),
        "u2": numbers_key(3),
        "n": numbers_key(3),
        "home": Table.rotation,
        "limits": numbers_key(2),
    },
    **{
        "torque_limit": Table.number,
        "rate_limit": Table.number,
        "name": Table.text,
        **_BODIES,
    },
}
"""Keys of a pair in space, given by its own geometry, and their readers."""
PAIR_TABLE_KEYS: Final = (*PAIR_KEYS, *_POINTS[3], *_ROBOT_HINGE_KEYS)
"""Keys that the table [pair] of a pair in space may have."""


def read_pair(table: Table, planar: bool) -> HingePair | PlanarPair:
    """Return the pair of the Table [pair], which describes it or names a robot's hinge: a PlanarPair if `planar` is
    True, otherwise a HingePair. The name of the pair is the stem of the file's name unless the table has a name or
    names a hinge.
    """
    name = {"name": " ".join(printable(Path(table.file).stem).split()) or None}
    if planar:
        return construct_from_table(table, PlanarPair, name | table.read(_PLANAR_KEYS, ("u1", "u2")))
    table.check_keys(PAIR_TABLE_KEYS)
    if not table.values.keys() & _ROBOT_HINGE_KEYS:
        return construct_from_table(
            table, HingePair, name | table.read({**PAIR_KEYS, **_POINTS[3]}, ("u1", "u2", "n"))
        )
    from hingepair.formats.robots import load_robot_hinge

    known = {**_ROBOT_HINGE_KEYS, **_BODIES, **_POINTS[3]}
    for key in table.values:
        if key not in known:
            table.fail(key, f"no such key together with robot: {', '.join(known)} describe the pair")
    values = table.read(known, _ROBOT_HINGE_KEYS)
    pair = construct_from_table(table, load_robot_hinge, {key: values.pop(key) for key in _ROBOT_HINGE_KEYS})
    with table.naming():
        return replace(pair, **values)


def construct_from_table(table: Table, factory: Callable[..., Made], arguments: Mapping[str, Any]) -> Made:
    """Return factory(**arguments); an ArgumentError becomes a SceneError on the key of `table` of the same name."""
    with table.naming():
        return factory(**arguments)
