"""Loops of a model that MuJoCo has read: equalities `connect` and `weld`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

from hingepair.errors import ArgumentError
from hingepair.mechanism.linkages import Loop, close_tree
from hingepair.mechanism.tree import Tree

_KINDS: Final = {0: "ball", 1: "weld"}  # of loops, by the type of an equality (mjtEq)
_SITE: Final = 6  # what an equality joins (mjtObj)


class BodyFrame(NamedTuple):
    """A frame of a body that the model has no site for."""

    name: str
    body: int
    position: Any
    quat_wxyz: Any


def read_loops(model: Any, names: Sequence[str], sites: Sequence[str]) -> Iterator[tuple[Loop, list[BodyFrame]]]:
    """Yield the loops of a model, with the frames that they need: active equalities `connect` and `weld`."""
    for number, name in enumerate(names):
        kind, data = _KINDS.get(int(model.eq_type[number])), model.eq_data[number]
        if kind is None or not model.eq_active0[number]:
            continue
        first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        if model.eq_objtype[number] == _SITE:
            yield Loop(sites[first], sites[second], kind, name=name), []
        else:
            places, turn = (data[:3], data[3:6]), (1.0, 0.0, 0.0, 0.0)
            one, other = places if kind == "ball" else places[::-1]
            own = data[6:10] if kind == "weld" else turn
            frames = [BodyFrame(f"{name}_1", first, one, own), BodyFrame(f"{name}_2", second, other, turn)]
            yield Loop(frames[0].name, frames[1].name, kind, name=name), frames


def closed_near(
    tree: Tree, loops: Sequence[Loop], positions: Sequence[Mapping[str, float]], warn: Callable[[str], None]
) -> Tree:
    """Return a tree with loops closed near the first positions, coordinates by joint, near which they can be; else
    as it is, and `warn` of it.
    """
    joints, refused = {joint.name for joint in tree.own_coordinates}, None
    for at in positions if loops else ():
        try:
            return close_tree(tree, loops, None, {name: x for name, x in at.items() if name in joints})
        except ArgumentError as error:
            refused = error
    if refused is not None:
        names = ", ".join(str(loop.name) for loop in loops)
        warn(f"the loops {names} are left open, and can be closed by robot.closed: {refused}")
    return tree
