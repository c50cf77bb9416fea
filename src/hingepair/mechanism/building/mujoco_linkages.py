"""Loops and struts of a model that MuJoCo has read: equalities `connect` and `weld`, and tendons of one segment."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, NamedTuple

from hingepair.errors import ArgumentError
from hingepair.mechanism.linkages import Loop, close_tree
from hingepair.mechanism.struts import add_strut, with_stops
from hingepair.mechanism.tree import Tree

_KINDS: Final = {0: "ball", 1: "weld"}  # of loops, by the type of an equality (mjtEq)
_TENDON: Final = 3  # the type of an equality of the length of a tendon
_SITE, _SITE_ON_TENDON = 6, 3  # what an equality joins (mjtObj), and what a tendon runs through (mjtWrap)


class BodyFrame(NamedTuple):
    """A frame of a body that the model has no site for."""

    name: str
    body: int
    position: Any
    quat_wxyz: Any


def read_struts(model: Any, sites: Sequence[str]) -> dict[int, tuple[str, str]]:
    """Return the sites of the tendons of one segment, by the tendon's number."""
    found = {}
    for number, first in enumerate(model.tendon_adr.tolist()):
        places = slice(first, first + int(model.tendon_num[number]))
        if model.wrap_type[places].tolist() == [_SITE_ON_TENDON] * 2:
            one, other = (sites[site] for site in model.wrap_objid[places].tolist())
            found[number] = one, other
    return found


def read_loops(
    model: Any, names: Sequence[str], sites: Sequence[str], struts: Mapping[int, tuple[str, str]]
) -> Iterator[tuple[Loop, list[BodyFrame]]]:
    """Yield the loops of a model, with the frames that they need: active equalities `connect` and `weld`, and those
    of the length of a tendon of one segment.
    """
    for number, name in enumerate(names):
        kind, data = int(model.eq_type[number]), model.eq_data[number]
        first, second = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        if not model.eq_active0[number]:
            continue
        if kind == _TENDON and first in struts and second < 0 and not data[1:5].any():
            length = float(model.tendon_length0[first] + data[0])
            yield Loop(*struts[first], kind="distance", length=length, name=name), []
        elif kind in _KINDS and model.eq_objtype[number] == _SITE:
            yield Loop(sites[first], sites[second], _KINDS[kind], name=name), []
        elif kind in _KINDS:
            places, turn = (data[:3], data[3:6]), (1.0, 0.0, 0.0, 0.0)
            one, other = places if _KINDS[kind] == "ball" else places[::-1]
            own = data[6:10] if _KINDS[kind] == "weld" else turn
            frames = [BodyFrame(f"{name}_1", first, one, own), BodyFrame(f"{name}_2", second, other, turn)]
            yield Loop(frames[0].name, frames[1].name, _KINDS[kind], name=name), frames


def with_linkages(
    tree: Tree,
    model: Any,
    loops: Sequence[Loop],
    struts: Mapping[str, tuple[int, tuple[str, str]]],
    positions: Sequence[Mapping[str, float]],
    warn: Callable[[str], None],
) -> Tree:
    """Return a tree with its struts, closed near the first positions near which it can be.

    Args:
        tree: the tree, which has the frames of all ends.
        model: the MjModel.
        loops: the loops.
        struts: numbers and sites of the tendons that are struts, by name.
        positions: coordinates by joint at which it may be assembled.
        warn: called with what cannot be read.
    """
    for name, (number, ends) in struts.items():
        try:
            tree = _with_strut(tree, model, name, number, ends)
        except ArgumentError as error:
            warn(f"tendon {name} is left out: {error}")
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


def _with_strut(tree: Tree, model: Any, name: str, number: int, ends: tuple[str, str]) -> Tree:
    """Return a tree with a tendon as a strut: a spring that is slack between two lengths, a damper and friction."""
    low, high = model.tendon_lengthspring[number].tolist()
    limits = model.tendon_range[number].tolist() if model.tendon_limited[number] else None
    stiffness, damping = float(model.tendon_stiffness[number]), float(model.tendon_damping[number])
    tree = add_strut(tree, ends, name, None, stiffness * (low == high), low, damping, limits, 0.0)
    *before, added = tree.struts
    law = added.law._replace(friction=float(model.tendon_frictionloss[number]))
    law = law if low == high else with_stops(law, (low, high), stiffness)
    return replace(tree, struts=(*before, replace(added, law=law)))
