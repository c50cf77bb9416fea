"""Loops and struts of a model that MuJoCo has read: equalities `connect` and `weld`, and tendons of one segment."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

from hingepair.errors import ArgumentError
from hingepair.mechanism.linkages import Loop, close_tree
from hingepair.mechanism.struts import add_strut, with_stops
from hingepair.mechanism.tree import Tree

_CONNECT, _WELD, _TENDON = 0, 1, 3  # types of equalities (mjtEq)
_SITE, _SITE_ON_TENDON = 6, 3  # what an equality joins (mjtObj), and what a tendon runs through (mjtWrap)


class End(NamedTuple):
    """A frame at which a loop is closed: a site, or a frame in a body, which gets a name."""

    name: str
    body: int
    position: Any  # of a frame; None of a site
    quat_wxyz: Any


class LoopRecord(NamedTuple):
    """A loop of a model."""

    name: str
    kind: str
    ends: tuple[End, End]
    length: float | None


class StrutRecord(NamedTuple):
    """A tendon that runs straight from one site to another."""

    name: str
    ends: tuple[str, str]
    number: int


def read_struts(model: Any, names: Sequence[str], sites: Sequence[str]) -> dict[int, StrutRecord]:
    """Return the tendons of one segment by number."""
    found = {}
    for number, name in enumerate(names):
        first = int(model.tendon_adr[number])
        places = slice(first, first + int(model.tendon_num[number]))
        if model.wrap_type[places].tolist() == [_SITE_ON_TENDON] * 2:
            one, other = (sites[site] for site in model.wrap_objid[places].tolist())
            found[number] = StrutRecord(name, (one, other), number)
    return found


def read_loops(
    model: Any, names: Sequence[str], sites: Sequence[str], struts: Mapping[int, StrutRecord]
) -> Iterator[LoopRecord]:
    """Yield the loops of a model: active equalities `connect`, `weld`, and `tendon` with one of one segment."""
    for number, name in enumerate(names):
        kind, data = int(model.eq_type[number]), model.eq_data[number]
        objects = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        if not model.eq_active0[number]:
            continue
        if kind == _TENDON and objects[0] in struts and objects[1] < 0 and not data[1:5].any():
            tendon = struts[objects[0]]
            length = float(model.tendon_length0[tendon.number] + data[0])
            ends = [End(site, -1, None, None) for site in tendon.ends]
            yield LoopRecord(name, "distance", (ends[0], ends[1]), length)
        elif kind in (_CONNECT, _WELD):
            turn = (1.0, 0.0, 0.0, 0.0)
            if model.eq_objtype[number] == _SITE:
                ends = [End(sites[site], -1, None, None) for site in objects]
            elif kind == _CONNECT:
                ends = [End(f"{name}_{k}", objects[k - 1], data[3 * k - 3 : 3 * k], turn) for k in (1, 2)]
            else:
                ends = [
                    End(f"{name}_1", objects[0], data[3:6], data[6:10]),
                    End(f"{name}_2", objects[1], data[:3], turn),
                ]
            yield LoopRecord(name, "ball" if kind == _CONNECT else "weld", (ends[0], ends[1]), None)


def with_linkages(
    tree: Tree,
    model: Any,
    loops: Sequence[LoopRecord],
    struts: Sequence[StrutRecord],
    positions: Sequence[Mapping[str, float]],
    warn: Callable[[str], None],
) -> Tree:
    """Return a tree with its struts, closed near the first positions near which it can be.

    Args:
        tree: the tree, which has the frames of all ends.
        model: the MjModel.
        loops: the loops.
        struts: the struts.
        positions: coordinates by joint at which it may be assembled.
        warn: called with what cannot be read.
    """
    for strut in struts:
        tree = _with_strut(tree, model, strut, warn)
    joints = {joint.name for joint in tree.own_coordinates}
    wanted = [Loop(one.ends[0].name, one.ends[1].name, one.kind, None, one.length, one.name) for one in loops]
    refused = None
    for at in positions if wanted else ():
        try:
            return close_tree(tree, wanted, None, {name: x for name, x in at.items() if name in joints})
        except ArgumentError as error:
            refused = error
    if refused is not None:
        names = ", ".join(str(loop.name) for loop in wanted)
        warn(f"the loops {names} are left open, and can be closed by robot.closed: {refused}")
    return tree


def _with_strut(tree: Tree, model: Any, strut: StrutRecord, warn: Callable[[str], None]) -> Tree:
    """Return a tree with a tendon as a strut: a spring that is slack between two lengths, a damper and friction."""
    number = strut.number
    low, high = model.tendon_lengthspring[number].tolist()
    limits = model.tendon_range[number].tolist() if model.tendon_limited[number] else None
    stiffness, damping = float(model.tendon_stiffness[number]), float(model.tendon_damping[number])
    plain = low == high
    try:
        tree = add_strut(tree, strut.ends, strut.name, None, stiffness * plain, low, damping, limits, 0.0)
    except ArgumentError as error:
        warn(f"tendon {strut.name} is left out: {error}")
        return tree
    *before, added = tree.struts
    law = added.law._replace(friction=float(model.tendon_frictionloss[number]))
    law = law if plain else with_stops(law, (low, high), stiffness)
    return replace(tree, struts=(*before, replace(added, law=law)))
