"""The table [pair] of a scene file: geometry, limits, masses and shapes of a pair, or a robot's hinge."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from hingepair.errors import printable
from hingepair.pair.body import Body, Box, Cylinder, Shape, Sphere
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.planar_pair import PlanarPair
from hingepair.scenes.tables import Key, Table, numbers_key

Made = TypeVar("Made")


def _read_inertia(table: Table, key: str) -> Any:
    """Read an inertia: three principal moments, or a matrix."""
    given = table.values[key]
    diagonal = isinstance(given, list) and not any(isinstance(row, list) for row in given)
    return np.diag(table.numbers(key, 3)) if diagonal else table.numbers(key, 3, 3)


def _read_shapes(table: Table, key: str) -> list[Shape]:
    """Return the shapes of a body, in the order of the file."""
    given = table.values[key]
    if not isinstance(given, list) or not all(isinstance(shape, dict) for shape in given):
        table.fail(key, "a list of { box = [...] }, { cylinder = radius, length = ... }, { sphere = radius }")
    return [_shape(replace(table, name=f"{table.name}.{key}[{i}]", values=own)) for i, own in enumerate(given)]


def _shape(table: Table) -> Shape:
    """Return one shape from its table, which names exactly one kind: box, cylinder or sphere."""
    named = [kind for kind in _SHAPE_READERS if kind in table.values]
    if len(named) != 1:
        table.refuse("", f"one of {', '.join(_SHAPE_READERS)}", ", ".join(named) or "none of them")
    (kind,) = named
    make, size, keys = _SHAPE_READERS[kind]
    values = table.read(keys, required=[key for key in keys if key in {kind, "length"}])
    return made(table, make, {size: values.pop(kind), **values})


def read_body(table: Table, key: str) -> Body:
    """Read mass properties and shapes from the table below a key."""
    own = table.table(key)
    return made(own, Body, own.read(BODY_KEYS))


# Class of each shape, the attribute that its first key becomes, and its keys with their readers.
_SHAPE_READERS: Final[Mapping[str, tuple[Callable[..., Shape], str, Mapping[str, Key]]]] = {
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
    "center_of_mass": numbers_key(3),
    "inertia": _read_inertia,
    "shapes": _read_shapes,
}
"""Keys of a body and their readers."""
_BODY_READERS: Final[Mapping[str, Key]] = {"body1": read_body, "body2": read_body}
"""Keys of both bodies of a pair and their readers."""
_ROBOT_HINGE_READERS: Final[Mapping[str, Key]] = {"robot": Table.text, "joint": Table.text}
"""Keys that take a pair from a hinge of a robot, and their readers."""
_PLANAR_PAIR_READERS: Final[Mapping[str, Key]] = {
    "u1": numbers_key(2),
    "u2": numbers_key(2),
    "name": Table.text,
    **_BODY_READERS,
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
    **{"torque_limit": Table.number, "rate_limit": Table.number, "name": Table.text, **_BODY_READERS},
}
"""Keys of a pair in space, given by its own geometry, and their readers."""
SPATIAL_PAIR_KEYS: Final = (*PAIR_KEYS, *_ROBOT_HINGE_READERS)
"""Keys that the table [pair] of a pair in space may have."""


def read_pair(table: Table, planar: bool) -> HingePair | PlanarPair:
    """Return the pair of the table [pair], named as its file is unless it has a name."""
    name = {"name": " ".join(printable(Path(table.file).stem).split()) or None}
    if planar:
        return made(table, PlanarPair, name | table.read(_PLANAR_PAIR_READERS, ("u1", "u2")))
    table.check_keys(SPATIAL_PAIR_KEYS)
    if not table.values.keys() & _ROBOT_HINGE_READERS:
        return made(table, HingePair, name | table.read(PAIR_KEYS, ("u1", "u2", "n")))
    from hingepair.formats.robots import load_robot_hinge

    for key in table.values:
        if key not in {**_ROBOT_HINGE_READERS, **_BODY_READERS}:
            table.fail(key, "nothing beside robot, joint, body1 and body2")
    values = table.read({**_ROBOT_HINGE_READERS, **_BODY_READERS}, _ROBOT_HINGE_READERS)
    return replace(made(table, load_robot_hinge, {key: values.pop(key) for key in _ROBOT_HINGE_READERS}), **values)


def pair_expressions(table: Table, planar: bool, letters: Collection[str] = ()) -> dict[str, tuple[Any, ...]]:
    """Return the exact SymPy expressions that u1, u2, n (of length 1) and home of the table [pair] stand for.

    What the table does not have is left out, such as all of a robot's hinge, and so is an axis in plain numbers.

    Args:
        table: the table [pair].
        planar: whether u1 and u2 have two components.
        letters: constants of the scene that stay letters.
    """
    from hingepair.symbolic.exact_constants import exact_unit_axis

    size = 2 if planar else 3
    written: dict[str, tuple[Any, ...]] = {
        key: tuple(table.expressions(key, size, letters=letters)) for key in ("u1", "u2") if key in table.values
    }
    if any(isinstance(component, str) for component in table.values.get("n", ())):
        written["n"] = exact_unit_axis(table.expressions("n", 3, letters=letters))
    if "home" in table.values:
        written["home"] = table.exact_rotation("home", letters)
    return written


def made(table: Table, make: Callable[..., Made], values: Mapping[str, Any]) -> Made:
    """Make something of the values of a table; errors name the key that a refused argument came from."""
    with table.naming():
        return make(**values)
