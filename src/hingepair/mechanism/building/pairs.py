"""The reader of robots that are given as pairs."""

from __future__ import annotations

import itertools
import os
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body import Body, body_masses, inertial_parameters, moments_of
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.bodies.shapes import Drawing, placed_shapes
from hingepair.mechanism.building.changes import add_frame
from hingepair.mechanism.building.folding import fold, framed, written_joint
from hingepair.mechanism.joints import DEFAULT_NAMES, JOINT_CLASSES, JointOfSeveral, RobotJoint
from hingepair.mechanism.pairs.geometry import Points
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.requests import subject_of
from hingepair.mechanism.robots.samples import JointSamples, Samples
from hingepair.mechanism.tree import BASE_KINDS, NO_LOAD, Tree, check_name
from hingepair.numeric.arrays import check_choice, read_only
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.urdf.rigid import IDENTITY_POSE, FramePose, MassProperties

BASE_LINK = "base"
"""Name of the base link of a robot that is built from pairs."""


def tree_of_pairs(
    pairs: Iterable[RobotJoint | JointOfSeveral], parents: Sequence[int] | None, base: str, name: str | None
) -> Tree:
    """Return the tree of a robot that is given as pairs, as `Mechanism` describes."""
    check_choice("base", base, BASE_KINDS)
    if name is not None:
        check_name("name", name)
    given: Any = pairs
    massless = list[int]()
    if isinstance(pairs, Iterable) and not isinstance(pairs, str):
        in_series, parents, massless = _in_series([*pairs], parents)
        given = _numbered(in_series)
    single = [nominal_pair(pair) for pair in given] if isinstance(given, list) else given
    tree = fold(_single_tree("mechanism" if name is None else name, single, parents, massless))
    tree = tree if single == given else _with_lengths(tree, given, single)
    for joint, pair in zip(tree.joints, given, strict=True):
        if isinstance(pair, HingePair):
            carrier = tree.joints[joint.parent - 1].name if joint.parent else BASE_LINK
            tree = _with_points(tree, carrier, pair.points1)
            tree = _with_points(tree, joint.name, pair.points2)
    return tree


def tree_of_pair(pair: HingePair, load: HingeLoad = NO_LOAD, bodies: Sequence[MassProperties] | None = None) -> Tree:
    """Return a pair as a robot, without drawings. It has the links body1, body2_at_hinge, which the joint `hinge`
    carries, and body2, which is fixed to it at -u2; points are frames.

    Args:
        pair: one pair, without leading axes.
        load: of the hinge; its stops replace the limits of the pair.
        bodies: mass properties of body 1, and of body 2 from the hinge point, in place of those of the pair.
    """
    seats = IDENTITY_POSE, FramePose(np.eye(3), 0.0 - pair.u2)
    base, masses = bodies or map(body_masses, (pair.body1, pair.body2), seats)
    hinge = written_joint(
        "hinge", "hinge", 0, FramePose(pair.home, pair.u1), pair.home.T @ pair.n, masses,
        load.stops or pair.limits, pair.torque_limit, pair.rate_limit, load=load,
    )  # fmt: skip
    links = {"body1": framed(0), "body2_at_hinge": framed(1), "body2": framed(1, seats[1])}
    frames = {
        name: framed(body, FramePose(np.eye(3), position + seats[body].origin))
        for body, points in enumerate((pair.points1, pair.points2))
        for name, position in points.items()
    }
    return replace(fold(Tree(pair.name, (hinge,), base, links, frames, ("body2",))), drawings=())


def _with_points(tree: Tree, link: str, points: Points) -> Tree:
    """Return a copy of a tree with frames at the named points of a link."""
    for name, position in points.items():
        if tree.frame(name) is not None:
            expected = "points with names that no link, joint or other point has"
            raise ArgumentError("pairs", expected, quoted(name))
        tree = add_frame(tree, name, tree.known_frame("link", link), position, None)
    return tree


def _in_series(pairs: list[Any], parents: Sequence[int] | None) -> tuple[list[Any], Sequence[int] | None, list[int]]:
    """Return pairs and parents with joints in series in place of each `JointOfSeveral`, and the numbers of the bodies
    between these, which have no mass.
    """
    if not any(isinstance(pair, JointOfSeveral) for pair in pairs):
        return pairs, parents, []
    chains = [list(pair.in_series()) if isinstance(pair, JointOfSeveral) else [pair] for pair in pairs]
    ends = [0, *itertools.accumulate(map(len, chains))]  # number of the last joint in place of each
    carriers, massless = list[int](), list[int]()
    for start, end, parent in zip(ends[:-1], ends[1:], _checked_parents(pairs, parents), strict=True):
        carriers += [ends[parent], *range(start + 1, end)]
        massless += range(start + 1, end)
    return [*itertools.chain(*chains)], carriers, massless


def _numbered(pairs: list[Any]) -> list[Any]:
    """Return pairs in which default names that repeat end in the place of the pair, such as hinge_pair_2."""
    kinds, width = tuple(JOINT_CLASSES.values()), len(str(len(pairs)))
    names = [pair.name if isinstance(pair, kinds) else None for pair in pairs]
    repeated = {name for name in DEFAULT_NAMES if names.count(name) > 1}
    return [
        replace(pair, name=f"{name}_{place:0{width}}") if name in repeated else pair  # zeros: siblings are sorted
        for place, (pair, name) in enumerate(zip(pairs, names, strict=True), 1)
    ]


def _with_lengths(tree: Tree, pairs: Sequence[Any], single: Sequence[Any]) -> Tree:
    """Return the tree of the pairs `single` with the geometry that `pairs` have in leading axes."""
    joints, links, samples = {}, dict(tree.links), Samples()
    for number, (joint, pair, one) in enumerate(zip(tree.joints, pairs, single, strict=True), 1):
        u2 = pairs[joint.parent - 1].u2 if joint.parent else np.zeros(3)
        if max(pair.u1.ndim, u2.ndim, pair.n.ndim, pair.home.ndim - 1) > 1:
            n = (pair.n[..., None, :] @ pair.home)[..., 0, :]
            size = np.sqrt((n * n).sum(axis=-1, keepdims=True))
            joints[number] = JointSamples(pair.u1 - u2, pair.home, n / size)
        if pair.u2.ndim > 1:
            links[pair.name] = replace(links[pair.name], samples=read_only(0.0 - pair.u2))
            own = replace(joint.body, centre_of_mass=joint.body.centre_of_mass + one.u2)
            moved = moments_of(own, -pair.u2, np.eye(3)) - moments_of(own, -one.u2, np.eye(3))
            samples = samples.with_matter(number, moved)
    origins = [frame.samples for frame in links.values() if frame.samples is not None]
    return replace(tree, links=links, samples=samples.with_joints(joints, origins))


def _single_tree(
    name: str, pairs: Iterable[RobotJoint], parents: Sequence[int] | None, massless: Collection[int]
) -> Tree:
    """Return the tree of pairs without leading axes, with the numbers of bodies that have no mass; refuse any but
    depth-first order.
    """
    checked = _checked_pairs(pairs)
    parent_numbers = _checked_parents(checked, parents)
    names = [pair.name for pair in checked]
    order = depth_first_order(names, parent_numbers)
    if order != list(range(len(checked))):
        numbers = {old: new for new, old in enumerate(order, 1)}
        sorted_parents = [numbers.get(parent_numbers[old] - 1, 0) for old in order]
        expected = f"the order {', '.join(names[i] for i in order)} with parents={sorted_parents}"
        raise ArgumentError("pairs", f"{expected}: depth-first, siblings by name", ", ".join(names))
    sides: list[list[tuple[str, RobotJoint]]] = [[], *([("body2", pair)] for pair in checked)]
    for pair, parent in zip(checked, parent_numbers, strict=True):
        sides[parent].append(("body1", pair))
    bodies = [_shared_body(one) for one in sides]
    seats = [IDENTITY_POSE, *(FramePose(np.eye(3), 0.0 - pair.u2) for pair in checked)]
    base, *masses = map(body_masses, bodies, seats)
    joints = tuple(
        written_joint(
            pair.name, next(kind for kind, made in JOINT_CLASSES.items() if isinstance(pair, made)), parent,
            seats[parent].placed(FramePose(pair.home, pair.u1)), unit_axis("n", pair.home.T @ pair.n), own,
            pair.limits, pair.torque_limit, pair.rate_limit, pitch=getattr(pair, "pitch", 0.0),
        )
        for pair, parent, own in zip(checked, parent_numbers, masses, strict=True)
    )  # fmt: skip
    links = [BASE_LINK, *names]
    shapes = (body.shapes if body else () for body in bodies)
    drawn = [tuple(placed_shapes(own, seat)) for own, seat in zip(shapes, seats, strict=True)]
    return Tree(
        name, joints, base,
        {link: framed(k, seats[k]) for k, link in enumerate(links)}, {},
        tuple(link for k, link in enumerate(names, 1) if k not in parent_numbers),
        tuple((k, f"{links[k]}: {note}") for k, body in enumerate(bodies) if body for note in body.assumed),
        tuple(Drawing(own, own) for own in drawn),
        without_mass={k: links[k] for k, body in enumerate(bodies) if body is None and k not in massless},
    )  # fmt: skip


def nominal_pair(pair: Any) -> Any:
    """Return a pair; if its geometry has leading axes, that of the first sample."""
    if not isinstance(pair, HingePair) or subject_of(pair).single:
        return pair
    first = {name: getattr(pair, name).reshape(-1, 3)[0] for name in ("u1", "u2", "n")}
    return replace(pair, **first, home=pair.home.reshape(-1, 3, 3)[0], points1={}, points2={})


def _checked_pairs(pairs: Iterable[RobotJoint]) -> list[RobotJoint]:
    """Check the argument `pairs`, an iterable of HingePairs, Sliders and Screws, and return it as a list."""
    if isinstance(pairs, str | os.PathLike):
        expected = "HingePairs, Sliders and Screws; hp.Mechanism.from_urdf and hp.Mechanism.from_mjcf read files"
        raise ArgumentError("pairs", expected, quoted(str(pairs)))
    if not isinstance(pairs, Iterable):
        raise ArgumentError("pairs", "HingePairs, Sliders and Screws", quoted(pairs))
    checked = list(pairs)
    if not checked:
        raise ArgumentError("pairs", "at least one HingePair, Slider or Screw", "none")
    names = set()
    for pair in checked:
        if not isinstance(pair, tuple(JOINT_CLASSES.values())):
            hint = " (a PlanarPair's is pair.to_spatial())" if hasattr(pair, "to_spatial") else ""
            raise ArgumentError("pairs", f"HingePairs, Sliders and Screws{hint}", quoted(pair))
        check_name("pairs", pair.name)
        if pair.name in names:
            raise ArgumentError("pairs", "a different name for each, by name=", f"{pair.name!r} twice")
        if pair.name == BASE_LINK:
            raise ArgumentError("pairs", f"names other than {BASE_LINK!r}, that of the base", quoted(pair.name))
        names.add(pair.name)
    return checked


def _checked_parents(pairs: Sequence[object], parents: Sequence[int] | None) -> list[int]:
    """Return the argument `parents`, by default the pairs in series; whether they form a tree is not checked."""
    count = len(pairs)
    if parents is None:
        return list(range(count))
    numbers = list(parents) if isinstance(parents, Iterable) else []
    for parent in numbers:
        if isinstance(parent, bool) or not isinstance(parent, int | np.integer) or not 0 <= parent <= count:
            raise ArgumentError("parents", f"numbers from 0 (the base) to {count}", quoted(parent))
    if len(numbers) != count:
        raise ArgumentError("parents", f"{count} numbers, one for each pair", quoted(parents))
    return [int(parent) for parent in numbers]


def depth_first_order(names: Sequence[str], parent_numbers: Sequence[int]) -> list[int]:
    """Return the indices of the pairs in depth-first order, siblings by name; refuse pairs in a circle."""
    carried: dict[int, list[int]] = {}
    for place, parent in enumerate(parent_numbers):
        carried.setdefault(parent, []).append(place)
    order: list[int] = []
    waiting = [0]
    while waiting:
        here = waiting.pop()
        if here:
            order.append(here - 1)
        waiting += [place + 1 for place in sorted(carried.get(here, ()), key=names.__getitem__, reverse=True)]
    if len(order) < len(names):
        loop = next(name for place, name in enumerate(names) if place not in order)
        raise ArgumentError(
            "parents", "a tree that starts at the base, 0", f"{list(parent_numbers)}, where {loop!r} is in a circle"
        )
    return order


def _shared_body(sides_of_pairs: Sequence[tuple[str, RobotJoint]]) -> Body | None:
    """Return the Body that these sides of pairs describe, None if none does; refuse those whose masses differ."""
    given = [(f"{side} of {pair.name!r}", getattr(pair, side)) for side, pair in sides_of_pairs]
    given = [(where, body) for where, body in given if body is not None]
    for where, body in given:
        one, other = (inertial_parameters(x.mass, x.centre_of_mass, x.inertia) for x in (given[0][1], body))
        if not np.array_equal(one, other):
            raise ArgumentError(where, f"the body that {given[0][0]} is, or None", body)
    return given[0][1] if given else None
