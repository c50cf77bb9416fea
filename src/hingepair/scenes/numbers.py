"""Numbers of a scene file: the keys that lead to them, and tables with other numbers."""

from __future__ import annotations

import copy
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, TypeAlias

from hingepair.errors import choices, nearest
from hingepair.scenes.tables import Table

NumberPath: TypeAlias = tuple[str | int, ...]
"""Keys and indices that lead to a number of a scene file: ("pair", "u1", 0) of "pair.u1[0]"."""

# One part of the path to a number of a scene: a key, then indices in brackets. Each number has one spelling.
_KEY_PART: Final = re.compile(r"([A-Za-z0-9_-]+)((?:\[(?:0|[1-9][0-9]{0,8})\])*)")


def number_path(table: Table, values: Mapping[str, Any], key: str) -> NumberPath:
    """Return the path of keys and indices that a key such as "pair.u1[0]" states. Raise a SceneError that names the
    step that fails, on `key` of `table`, unless it leads to a number or an expression in the tables `values` of a
    scene file.
    """
    path: list[Any] = []
    for part in key.split("."):
        match = _KEY_PART.fullmatch(part)
        if match is None:
            table.fail("key", 'names with dots, and places in brackets counted from 0, such as "pair.u1[0]"')
        path.append(match[1])
        path += [int(place) for place in re.findall(r"\d+", match[2])]
    here: Any = values
    for step in path:
        if isinstance(here, dict) and step not in here:
            known = tuple(map(str, here))
            table.refuse("key", f"{choices(known)} at this place{nearest(str(step), known)}", repr(step))
        if isinstance(here, list) and (not isinstance(step, int) or step >= len(here)):
            table.refuse("key", f"a place in a list of {len(here)}, such as [0]", repr(step))
        if not isinstance(here, dict | list):
            table.refuse("key", "the key of a number of the scene", repr(key))
        here = here[step]
    if isinstance(here, list) and here:
        table.refuse("key", f"one number: {key}[0] to {key}[{len(here) - 1}]", f"{key!r}, which is a list")
    if isinstance(here, bool) or not isinstance(here, int | float | str):
        table.refuse("key", "the key of a number of the scene, or of an expression", repr(key))
    return tuple(path)


def number_at(tables: Table, path: NumberPath) -> float:
    """Return the number or constant expression of a scene to which a path leads."""
    here: Any = tables.values
    for step in path:
        here = here[step]
    return replace(tables, name="", values={"number": here}).number("number")


def with_numbers(values: Mapping[str, Any], paths: Sequence[NumberPath], numbers: Sequence[Any]) -> dict[str, Any]:
    """Return the tables of a scene with these numbers; those that are not changed are shared."""
    changed = dict(values)
    for root in {path[0] for path in paths}:
        changed[str(root)] = copy.deepcopy(changed[str(root)])
    write_numbers(changed, paths, numbers)
    return changed


def write_numbers(values: dict[str, Any], paths: Sequence[NumberPath], numbers: Sequence[Any]) -> None:
    """Write numbers into the tables of a scene."""
    for path, number in zip(paths, numbers, strict=True):
        here: Any = values
        for step in path[:-1]:
            here = here[step]
        here[path[-1]] = number


def keep_motion(paths: Sequence[NumberPath]) -> bool:
    """Return whether a given motion is the same whatever these numbers are: those of geometry and masses."""
    resting = ("u1", "u2", "n", "home", "body1", "body2", "torque_limit", "rate_limit")
    return all(
        path[0] in ("outputs", "title")
        or (path[0] == "pair" and path[1] != "limits")  # where stops may be
        or path[:2] in (("mechanism", "payload"), ("mechanism", "frames"))
        or (path[0] == "joint" and len(path) > 2 and path[2] in resting)
        for path in paths
    )
