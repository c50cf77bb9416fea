"""What a page draws and moves: bodies and their shapes, joints, and the frames that it shows."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.formats.model_writers import drawn_shapes
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.shapes import placed_shapes
from hingepair.mechanism.tree import NO_MASS, Frame, Joint, Tree
from hingepair.pair.body import Box, Shape, Sphere
from hingepair.pair.hinge_pair import HingePair
from hingepair.pictures.simple_bodies import (
    SimpleBody,
    axes_along,
    drawn_limits,
    drawn_range,
    robot_size,
    simple_bodies,
)
from hingepair.urdf.rigid import Pose

BODY1, BODY2, AXIS = "#4477aa", "#ee7733", "#222222"
_BASE: Final = "#8b919b"
_JOINT: Final = "#3c424b"
_LIMBS: Final = ("#4477aa", "#ee7733", "#228833", "#aa3377", "#ccaa22", "#33a0b8")


class DrawnBody(NamedTuple):
    """A body: its name, its colour (#rrggbb), and its shapes by colour, in its own axes."""

    name: str
    colour: str
    shapes: list[tuple[str, Shape]]


class Model(NamedTuple):
    """What a page draws and moves; body 0 is the base, body k >= 1 is what joint k moves.

    Attributes:
        title: title of the page.
        bodies: the base first.
        joints: in the order of the bodies that they move.
        limbs: names of groups of joints, and the numbers of these joints, from 1 on.
        frames: by name.
        frame: name of the frame whose position the page shows first.
        traced: frames whose paths are always drawn, and their colours.
        marked: frames whose axes are always drawn.
        legend: colours, and what has them.
        base: what the page calls the base.
        size: length that the lengths of marks follow [m].
        mark: length of the axes of a frame [m].
        opacity: of the bodies, 1 where nothing is seen through them.
    """

    title: str
    bodies: Sequence[DrawnBody]
    joints: Sequence[Joint]
    limbs: Sequence[tuple[str, Sequence[int]]]
    frames: Mapping[str, Frame]
    frame: str
    traced: Mapping[str, str]
    marked: Sequence[str]
    legend: Sequence[tuple[str, str]]
    base: str
    size: float
    mark: float
    opacity: float


def pair_model(pair: HingePair, title: str) -> Model:
    """Return the model of a pair: a mechanism of one joint, whose base is body 1."""
    one, two = drawn_shapes(pair)
    size = float(np.linalg.norm(pair.u1) + np.linalg.norm(pair.u2)) or 1.0
    limits = pair.limits or (-math.inf, math.inf)
    joint = Joint(pair.name, "hinge", 0, pair.u1, pair.home, pair.home.T @ pair.n, NO_MASS, limits)
    here, still = np.zeros(3), np.eye(3)
    frames = {
        "body 1": Frame(0, here, still),
        "hinge": Frame(1, here, still),
        "body 2": Frame(1, 0.0 - pair.u2, still),
    }
    return Model(
        title=title,
        bodies=[
            DrawnBody("body1", BODY1, [(BODY1, shape) for shape in one]),
            DrawnBody("body2", BODY2, [(BODY2, shape) for shape in placed_shapes(two, Pose(still, 0.0 - pair.u2))]),
        ],
        joints=[joint],
        limbs=[("", [1])],
        frames=frames,
        frame="body 2",
        traced={"body 1": BODY1, "hinge": AXIS, "body 2": BODY2},
        marked=("body 1", "body 2"),
        legend=[(BODY1, "body 1"), (BODY2, "body 2"), (AXIS, "hinge axis")],
        base="body 1",
        size=size,
        mark=0.35 * size,
        opacity=0.85,
    )


def robot_model(robot: Mechanism, title: str, frame: str | None = None) -> Model:
    """Return the model of a robot: the shapes of its URDF or of its pairs, else simple bodies.

    Args:
        robot: whose base is where the page says.
        title: title of the page.
        frame: link or frame whose position is shown first; unless given, a last link.
    """
    tree, size = robot.tree, robot_size(robot.tree)
    limbs = _limbs(tree)
    colours = [_BASE] * (len(tree.joints) + 1)
    for place, (_, joints) in enumerate(limbs):
        for along, number in enumerate(joints):
            colours[number] = _lighter(_LIMBS[place % len(_LIMBS)], 0.4 * (along % 2))
    names = ["base", *(joint.name for joint in tree.joints)]
    bodies = [
        DrawnBody(name, colour, _shapes(colour, drawing.shapes, None if drawing.complete else simple))
        for name, colour, drawing, simple in zip(
            names, colours, tree.drawings, simple_bodies(tree, size), strict=True
        )
    ]
    return Model(
        title=title,
        bodies=bodies,
        joints=tree.joints,
        limbs=limbs,
        frames={**tree.frames, **tree.links},
        frame=_last_link(tree) if frame is None else frame,
        traced={},
        marked=(),
        legend=(),
        base="the base",
        size=size,
        mark=0.12 * size,
        opacity=1.0,
    )


def model_json(model: Model, positions: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Return a model as JSON has it.

    Args:
        model: what is drawn and moves.
        positions: those of a motion, which the sliders reach; shape (N, dof), N may be 0.
    """
    leaders = [number for number, joint in enumerate(model.joints, 1) if joint.mimic is None]
    places = {number: place for place, number in enumerate(leaders)}
    limb_of = {number: limb for limb, (_, numbers) in enumerate(model.limbs) for number in numbers}
    coordinates = [
        _coordinate(model.joints[number - 1], limb_of[number], model.size, positions[:, place])
        for place, number in enumerate(leaders)
    ]
    return {
        "title": model.title,
        "bodies": [
            {"name": body.name, "shapes": [_drawn(shape) | {"colour": colour} for colour, shape in body.shapes]}
            for body in model.bodies
        ],
        "joints": [
            {
                **{"name": joint.name, "kind": joint.kind, "parent": joint.parent},
                **{"u": joint.u.tolist(), "S": joint.S.ravel().tolist(), "n": joint.n.tolist()},
                "coordinate": places[joint.mimic.leader if joint.mimic else number],
                "multiplier": joint.mimic.multiplier if joint.mimic else 1.0,
                "offset": joint.mimic.offset if joint.mimic else 0.0,
            }
            for number, joint in enumerate(model.joints, 1)
        ],
        "coordinates": coordinates,
        "limbs": [{"name": name, "colour": model.bodies[numbers[0]].colour} for name, numbers in model.limbs],
        "frames": [
            {"name": name, "body": frame.body, "R": frame.R.tolist(), "S": frame.S.ravel().tolist()}
            for name, frame in model.frames.items()
        ],
        "frame": model.frame,
        "traced": model.traced,
        "marked": model.marked,
        "legend": model.legend,
        "base": model.base,
        "size": model.size,
        "mark": model.mark,
        "opacity": model.opacity,
    }


def placements(R: np.ndarray[Any, Any], S: np.ndarray[Any, Any]) -> list[list[float] | None]:
    """Return 4 x 4 matrices of poses, row by row; None where one is not finite."""
    matrices = np.zeros((len(R), 4, 4))
    matrices[:, :3, :3], matrices[:, :3, 3], matrices[:, 3, 3] = S, R, 1.0
    return [m if np.isfinite(m).all() else None for m in matrices.reshape(-1, 16).tolist()]


def _coordinate(joint: Joint, limb: int, size: float, positions: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Return what the slider of a coordinate has: limits, range, and where the joint is in the neutral pose.

    Where a motion goes beyond the range of the joint, so does the slider's.
    """
    (lower, upper), (first, last) = drawn_limits(joint), drawn_range(joint, size)
    known = positions[np.isfinite(positions)]
    return {
        **{"name": joint.name, "kind": joint.kind, "limb": limb},
        "limits": [limit if math.isfinite(limit) else None for limit in (lower, upper)],
        "first": min(first, float(known.min(initial=first))),
        "last": max(last, float(known.max(initial=last))),
        "neutral": min(max(0.0, lower), upper),
    }


def _shapes(colour: str, shapes: Sequence[Shape], simple: SimpleBody | None) -> list[tuple[str, Shape]]:
    """Return the shapes of a body by colour: its own, and those of a simple body where they do not show all of it."""
    drawn = [(colour, shape) for shape in shapes]
    if simple is not None:
        drawn += [*((colour, shape) for shape in simple.links), *((_JOINT, shape) for shape in simple.joints)]
    return drawn


def _limbs(tree: Tree) -> list[tuple[str, list[int]]]:
    """Return the unbranched chains of joints, each with a name and the numbers of its joints."""
    carried = [0] * (len(tree.joints) + 1)
    for joint in tree.joints:
        carried[joint.parent] += 1
    chains: dict[int, list[int]] = {}
    start_of = [0]
    for number, joint in enumerate(tree.joints, 1):
        start = start_of[joint.parent] if joint.parent and carried[joint.parent] == 1 else number
        start_of.append(start)
        chains.setdefault(start, []).append(number)
    return [(_limb_name([tree.joints[k - 1].name for k in chain]), chain) for chain in chains.values()]


def _limb_name(names: Sequence[str]) -> str:
    """Return a name for some joints: what their names begin with, else the first and the last of them."""
    if len(names) == 1:
        return names[0]
    alike = (len(set(letters)) == 1 for letters in zip(*names, strict=False))
    shared = names[0][: sum(1 for _ in itertools.takewhile(bool, alike))].rstrip("_-. 0123456789")
    first, last = (re.sub(r"[_-]?\d*([_-]?joint)?$", "", name) or name for name in (names[0], names[-1]))
    return shared or f"{first} ... {last}"


def _last_link(tree: Tree) -> str:
    """Return the tip that the most joints carry, the first of several."""
    depths = [0]
    for joint in tree.joints:
        depths.append(depths[joint.parent] + 1)
    return max(tree.tips, key=lambda tip: depths[tree.links[tip].body])


def _lighter(colour: str, share: float) -> str:
    """Return a colour mixed with white."""
    parts = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    return "#" + "".join(f"{round(part + share * (255 - part)):02x}" for part in parts)


def _drawn(shape: Shape) -> dict[str, Any]:
    """Return a shape as the page builds it; three.js has the axis of a cylinder along y."""
    turn = np.eye(3)
    found: dict[str, Any] = {"kind": type(shape).__name__.lower()}
    if isinstance(shape, Box):
        found["size"], turn = shape.size.tolist(), shape.axes
    elif isinstance(shape, Sphere):
        found["radius"] = shape.radius
    else:
        found |= {"radius": shape.radius, "length": shape.length}
        turn = axes_along(shape.axis)[:, [0, 2, 1]] * (1, 1, -1)
    found["placement"] = placements(shape.center[None], turn[None])[0]
    return found
