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
    """Return the inertia of a key as 3 x 3 numbers, from three principal moments or a matrix."""
    entries = table.values[key]
    diagonal = isinstance(entries, list) and not any(isinstance(row, list) for row in entries)
    return np.diag(table.numbers(key, 3)) if diagonal else table.numbers(key, 3, 3)


def _read_shapes(table: Table, key: str) -> list[Shape]:
    """Return the shapes (Box, Cylinder, Sphere) of a body, in the order of the file."""
    shape_tables = table.values[key]
    if not isinstance(shape_tables, list) or not all(isinstance(shape, dict) for shape in shape_tables):
        table.fail(key, "a list of { box = [...] }, { cylinder = radius, length = ... }, { sphere = radius }")
    return [
        _read_shape(replace(table, name=f"{table.name}.{key}[{i}]", values=values))
        for i, values in enumerate(shape_tables)
    ]


def _read_shape(table: Table) -> Shape:
    """Return the Box, Cylinder or Sphere of a table, which has exactly one of the keys box, cylinder, sphere."""
    named = [kind for kind in _SHAPE_SPEC_BY_KIND if kind in table.values]
    if len(named) != 1:
        table.refuse("", f"one of {', '.join(_SHAPE_SPEC_BY_KIND)}", ", ".join(named) or "none of them")
    (kind,) = named
    make, size, keys = _SHAPE_SPEC_BY_KIND[kind]
    values = table.read(keys, required=[key for key in keys if key in {kind, "length"}])
    return made(table, make, {size: values.pop(kind), **values})


def read_body(table: Table, key: str) -> Body:
    """Read mass properties and shapes from the table below a key."""
    own = table.table(key)
    return made(own, Body, own.read(BODY_KEY_READERS))


# Class of each shape, the attribute that its first key becomes, and its keys with their readers.
_SHAPE_SPEC_BY_KIND: Final[Mapping[str, tuple[Callable[..., Shape], str, Mapping[str, Key]]]] = {
    "box": (Box, "size", {"box": numbers_key(3), "center": numbers_key(3), "axes": Table.rotation}),
    "cylinder": (
        Cylinder,
        "radius",
        {"cylinder": Table.number, "length": Table.number, "center": numbers_key(3), "axis": numbers_key(3)},
    ),
    "sphere": (Sphere, "radius", {"sphere": Table.number, "center": numbers_key(3)}),
}
BODY_KEY_READERS: Final[Mapping[str, Key]] = {
    "mass": Table.number,
    "center_of_mass": numbers_key(3),
    "inertia": _read_inertia,
    "shapes": _read_shapes,
}
"""Keys of a body and their readers."""
_BODY1_AND_BODY2_READERS: Final[Mapping[str, Key]] = {"body1": read_body, "body2": read_body}
"""Keys of both bodies of a pair and their readers."""
_ROBOT_HINGE_KEY_READERS: Final[Mapping[str, Key]] = {"robot": Table.text, "joint": Table.text}
"""Keys that take a pair from a hinge of a robot, and their readers."""
_PLANAR_PAIR_KEY_READERS: Final[Mapping[str, Key]] = {
    "u1": numbers_key(2),
    "u2": numbers_key(2),
    "name": Table.text,
    **_BODY1_AND_BODY2_READERS,
}
"""Keys of a pair in the plane and their readers; u1 and u2 in metres."""
PAIR_KEY_READERS: Final[Mapping[str, Key]] = {
    **{
        "u1": numbers_key(3),
        "u2": numbers_key(3),
        "n": numbers_key(3),
        "home": Table.rotation,
        "limits": numbers_key(2),
    },
    **{"torque_limit": Table.number, "rate_limit": Table.number, "name": Table.text, **_BODY1_AND_BODY2_READERS},
}
"""Keys of a pair in space, given by its own geometry, and their readers."""
SPATIAL_PAIR_TABLE_KEYS: Final = (*PAIR_KEY_READERS, *_ROBOT_HINGE_KEY_READERS)
"""Keys that the table [pair] of a pair in space may have."""


def read_pair(table: Table, planar: bool) -> HingePair | PlanarPair:
    """Return the HingePair or PlanarPair of the table [pair]; its name is that of the file unless given."""
    name = {"name": " ".join(printable(Path(table.file).stem).split()) or None}
    if planar:
        return made(table, PlanarPair, name | table.read(_PLANAR_PAIR_KEY_READERS, ("u1", "u2")))
    table.check_keys(SPATIAL_PAIR_TABLE_KEYS)
    if not table.values.keys() & _ROBOT_HINGE_KEY_READERS:
        return made(table, HingePair, name | table.read(PAIR_KEY_READERS, ("u1", "u2", "n")))
    from hingepair.formats.robots import load_robot_hinge

    for key in table.values:
        if key not in {**_ROBOT_HINGE_KEY_READERS, **_BODY1_AND_BODY2_READERS}:
            table.fail(key, "nothing beside robot, joint, body1 and body2")
    values = table.read({**_ROBOT_HINGE_KEY_READERS, **_BODY1_AND_BODY2_READERS}, _ROBOT_HINGE_KEY_READERS)
    return replace(
        made(table, load_robot_hinge, {key: values.pop(key) for key in _ROBOT_HINGE_KEY_READERS}), **values
    )


def pair_expressions(
    table: Table, planar: bool, symbolic_constants: Collection[str] = ()
) -> dict[str, tuple[Any, ...]]:
    """Return u1, u2, n (of length 1) and home of the table [pair] by name, as tuples of exact SymPy expressions.

    What the table does not have is left out, such as all of a robot's hinge, and so is an axis in plain numbers.

    Args:
        table: the table [pair].
        planar: whether u1 and u2 have two components.
        symbolic_constants: constants of the scene that stay symbols.
    """
    from hingepair.symbolic.exact_constants import exact_unit_axis

    size = 2 if planar else 3
    written: dict[str, tuple[Any, ...]] = {
        key: tuple(table.expressions(key, size, symbolic_constants=symbolic_constants))
        for key in ("u1", "u2")
        if key in table.values
    }
    if any(isinstance(component, str) for component in table.values.get("n", ())):
        written["n"] = exact_unit_axis(table.expressions("n", 3, symbolic_constants=symbolic_constants))
    if "home" in table.values:
        written["home"] = table.exact_rotation("home", symbolic_constants)
    return written


def made(table: Table, make: Callable[..., Made], values: Mapping[str, Any]) -> Made:
    """Make something of the values of a table; errors name the key that a refused argument came from."""
    with table.naming():
        return make(**values)
