"""The model that a page draws and moves: bodies and their shapes, joints, and frames."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.formats.model_writers import drawn_pair
from hingepair.formats.simple_bodies import (
    SimpleBody,
    axes_along,
    drawn_limits,
    drawn_range,
    robot_size,
    simple_bodies,
)
from hingepair.mechanism.bodies.body import Box, Shape, Sphere
from hingepair.mechanism.bodies.shapes import Drawing, Mesh
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.tree import Frame, Joint, Tree
from hingepair.pictures.curves import check_drawable
from hingepair.pictures.meshes import MeshPiece, read_meshes

BODY1_COLOUR, BODY2_COLOUR, AXIS_COLOUR = "#4477aa", "#ee7733", "#222222"  # of a pair
POINT_COLOUR: Final = "#d62839"  # of the points of bodies, and of their paths
_BASE_COLOUR: Final = "#8b919b"  # of a robot's base
_JOINT_COLOUR: Final = "#3c424b"  # of the drums and rails of simple bodies
# Colours of the bodies of a robot's chains of joints, which repeat.
_CHAIN_COLOURS: Final = ("#4477aa", "#ee7733", "#228833", "#aa3377", "#ccaa22", "#33a0b8")


class DrawnBody(NamedTuple):
    """A body on a page."""

    name: str
    colour: str  # #rrggbb
    shapes: list[tuple[str, Shape | MeshPiece]]  # with their colours, in the body's axes


class PageModel(NamedTuple):
    """Model that a page draws and moves: bodies, joints and frames, with colours and lengths."""

    #: title of the page
    title: str
    #: bodies, the base first
    bodies: Sequence[DrawnBody]
    #: joints, in the order of the bodies that they move
    joints: Sequence[Joint]
    #: for each unbranched chain of joints, its name and the numbers of its joints, from 1 on
    chains: Sequence[tuple[str, Sequence[int]]]
    #: frames by name
    frames: Mapping[str, Frame]
    #: name of the frame whose position the page shows first
    frame: str
    #: colours of the paths that are always drawn, by the frame's name
    path_colours: Mapping[str, str]
    #: names of the frames whose axes are always drawn
    axes_shown: Sequence[str]
    #: pairs (colour, name) of the legend
    legend: Sequence[tuple[str, str]]
    #: name of the base on the page
    base: str
    #: length of the model, to which the lengths of lines are proportional [m]
    size: float
    #: length of the axes of a frame [m]
    axes_length: float
    #: opacity of the bodies; 1 is opaque
    opacity: float
    #: sentences about what is not drawn
    notes: Sequence[str] = ()
    #: names of the frames that are marked with a dot and their name
    marks: Sequence[str] = ()
    #: the two frames of each strut, between whose origins it is drawn, by name
    struts: Mapping[str, tuple[Frame, Frame]] = {}


def pair_model(pair: HingePair, title: str) -> PageModel:
    """Return the page model of a pair as a mechanism of one joint. Its base is body 1, and `title` is the page's
    title; the paths of both bodies, of the hinge and of points are always drawn. Points are marked.
    """
    for name in ("u1", "u2"):
        check_drawable(name, getattr(pair, name))
    drawings = drawn_pair(pair)[0].drawings
    size = float(np.linalg.norm(pair.u1) + np.linalg.norm(pair.u2)) or 1.0
    places = {"body 1": (0, np.zeros(3)), "hinge": (1, np.zeros(3)), "body 2": (1, 0.0 - pair.u2)}
    points = {name: (1, position - pair.u2) for name, position in pair.points2.items()}
    points |= {name: (0, position) for name, position in pair.points1.items()}
    return robot_model(Mechanism([pair]), title)._replace(
        bodies=[
            DrawnBody(name, colour, [(colour, shape) for shape in drawing.shapes or ()])
            for name, colour, drawing in zip(("body1", "body2"), (BODY1_COLOUR, BODY2_COLOUR), drawings, strict=True)
        ],
        frames={name: Frame(body, R, np.eye(3)) for name, (body, R) in (places | points).items()},
        frame=next(iter(points), "body 2"),
        path_colours={
            **{"body 1": BODY1_COLOUR, "hinge": AXIS_COLOUR, "body 2": BODY2_COLOUR},
            **dict.fromkeys(points, POINT_COLOUR),
        },
        axes_shown=("body 1", "body 2"),
        legend=[(BODY1_COLOUR, "body 1"), (BODY2_COLOUR, "body 2"), (AXIS_COLOUR, "hinge axis")],
        base="body 1",
        size=size,
        axes_length=0.35 * size,
        opacity=0.85,
        marks=tuple(points),
    )


def robot_model(robot: Mechanism, title: str, frame: str | None = None, megabytes: float = 0.0) -> PageModel:
    """Return the page model of a robot. Its bodies have the meshes and shapes of the URDF or of the pairs, and simple
    shapes are added to a body that these do not draw completely. Struts are drawn as rods, and the frames where loops
    are closed are marked with the names of the loops.

    Args:
        robot: the robot.
        title: title of the page.
        frame: link or frame whose motion is shown first; by default the last link of the longest chain.
        megabytes: size of the meshes on the page; 0: none are read.
    """
    tree, size = tree_of(robot), robot_size(tree_of(robot))
    meshes = [visual for drawing in tree.drawings for visual in drawing.visuals if isinstance(visual, Mesh)]
    pieces, notes = read_meshes(meshes, megabytes) if megabytes else ({}, [])
    chains = _joint_chains(tree)
    colours = [_BASE_COLOUR] * (len(tree.joints) + 1)
    for place, (_, joints) in enumerate(chains):
        for number in joints:
            colours[number] = _CHAIN_COLOURS[place % len(_CHAIN_COLOURS)]
    depths = [0]
    for joint in tree.joints:
        depths.append(depths[joint.parent] + 1)
    names = ["base", *(joint.name for joint in tree.joints)]
    loops: dict[str, Frame] = {}
    if tree.closure is not None:
        ends = zip(tree.closure.loops, tree.closure.frames, strict=True)
        loops = {str(loop.name): first for loop, (first, _) in ends if loop.name not in robot.names}
    bodies = [
        DrawnBody(name, colour, _coloured_shapes(colour, drawing, simple, pieces))
        for name, colour, drawing, simple in zip(
            names, colours, tree.drawings, simple_bodies(tree, size), strict=True
        )
    ]
    return PageModel(
        title=title,
        bodies=bodies,
        joints=tree.joints,
        chains=chains,
        frames={**tree.frames, **tree.links, **loops},
        frame=max(tree.tips, key=lambda name: depths[tree.links[name].body]) if frame is None else frame,
        path_colours={},
        axes_shown=(),
        legend=(),
        base="the base",
        size=size,
        axes_length=0.12 * size,
        opacity=1.0,
        notes=notes,
        marks=tuple(loops),
        struts={strut.name: strut.frames for strut in tree.struts},
    )


def model_json(model: PageModel, positions: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Return a page model as a dictionary for JSON.

    Args:
        model: the page model.
        positions: coordinates of all joints that follow no other by a rule, which the sliders can reach; shape
            (N, joints), N may be 0.
    """
    leaders = [number for number, joint in enumerate(model.joints, 1) if joint.mimic is None]
    places = {model.joints[number - 1].name: place for place, number in enumerate(leaders)}
    chain_of = {number: chain for chain, (_, numbers) in enumerate(model.chains) for number in numbers}
    coordinates = [
        _coordinate_json(model.joints[number - 1], chain_of[number], model.size, positions[:, place])
        for place, number in enumerate(leaders)
    ]
    as_they_are = ("title", "frame", "path_colours", "axes_shown", "marks", "legend", "base", "size", "axes_length")
    return {
        **{name: getattr(model, name) for name in (*as_they_are, "opacity")},
        "bodies": [
            {"name": body.name, "shapes": [_shape_json(shape, colour) for colour, shape in body.shapes]}
            for body in model.bodies
        ],
        "joints": [
            {
                **{"name": joint.name, "axis": joint.axis, "parent": joint.parent},
                **{"u": joint.u.tolist(), "S": joint.S.ravel().tolist(), "n": joint.n.tolist()},
                **{"coordinate": places[joint.rule.leader], "multiplier": joint.rule.multiplier},
                "offset": joint.rule.offset,
            }
            for number, joint in enumerate(model.joints, 1)
        ],
        "coordinates": coordinates,
        "chains": [{"name": name, "colour": model.bodies[numbers[0]].colour} for name, numbers in model.chains],
        "frames": [{"name": name, **_frame_json(frame)} for name, frame in model.frames.items()],
        "struts": [{"name": name, "frames": [*map(_frame_json, ends)]} for name, ends in model.struts.items()],
    }


def _frame_json(frame: Frame) -> dict[str, Any]:
    return {"body": frame.body, "R": frame.R.tolist(), "S": frame.S.ravel().tolist()}


def placements(R: np.ndarray[Any, Any], S: np.ndarray[Any, Any]) -> list[list[float] | None]:
    """Return the 4 x 4 matrices of positions R (N, 3) and rotations S (N, 3, 3) for JSON, each as 16 numbers row by
    row; None for a pose that is not finite.
    """
    matrices = np.zeros((len(R), 4, 4))
    matrices[:, :3, :3], matrices[:, :3, 3], matrices[:, 3, 3] = S, R, 1.0
    return [m if np.isfinite(m).all() else None for m in matrices.reshape(-1, 16).tolist()]


def _coordinate_json(joint: Joint, chain_index: int, size: float, positions: np.ndarray[Any, Any]) -> dict[str, Any]:
    """Return the slider of a joint for JSON: limits, range, which reaches all `positions`, neutral position and index
    of the chain.
    """
    (lower, upper), (first, last) = drawn_limits(joint), drawn_range(joint, size)
    known = positions[np.isfinite(positions)]
    return {
        **{"name": joint.name, "unit": joint.unit, "chain": chain_index},
        "limits": [limit if math.isfinite(limit) else None for limit in (lower, upper)],
        "effort_unit": joint.effort_unit,
        "effort_limit": joint.effort_limit if math.isfinite(joint.effort_limit) else None,
        "first": min(first, float(known.min(initial=first))),
        "last": max(last, float(known.max(initial=last))),
        "neutral": min(max(0.0, lower), upper),
    }


def _coloured_shapes(
    colour: str, drawing: Drawing, simple_body: SimpleBody, pieces: Mapping[int, Sequence[MeshPiece]]
) -> list[tuple[str, Shape | MeshPiece]]:
    """Return a body's shapes and their colours: as the URDF draws it if all its meshes were read, else by its shapes,
    with those of a simple body where they are not complete.
    """
    meshes = [visual for visual in drawing.visuals if isinstance(visual, Mesh)]
    if meshes and all(id(mesh) in pieces for mesh in meshes):
        shapes: list[Shape | MeshPiece] = [shape for shape in drawing.visuals if not isinstance(shape, Mesh)]
        shapes += [piece for mesh in meshes for piece in pieces[id(mesh)]]
        return [(colour, shape) for shape in shapes]
    written = [shape for shape in drawing.visuals if not isinstance(shape, Mesh)]
    drawn: list[tuple[str, Shape | MeshPiece]] = [(colour, shape) for shape in drawing.shapes or written]
    if not drawing.shapes:
        drawn += [(colour, shape) for shape in simple_body.links]
        drawn += [(_JOINT_COLOUR, shape) for shape in simple_body.joints]
    return drawn


def _joint_chains(tree: Tree) -> list[tuple[str, list[int]]]:
    """Return the names of the first and the last joint, and the numbers of the joints from 1 on, of each unbranched
    chain of a robot's joints.
    """
    carried = [0] * (len(tree.joints) + 1)
    for joint in tree.joints:
        carried[joint.parent] += 1
    chains: dict[int, list[int]] = {}
    start_of = [0]
    for number, joint in enumerate(tree.joints, 1):
        start = start_of[joint.parent] if joint.parent and carried[joint.parent] == 1 else number
        start_of.append(start)
        chains.setdefault(start, []).append(number)
    ends = [dict.fromkeys(tree.joints[k - 1].name for k in (chain[0], chain[-1])) for chain in chains.values()]
    return [(" ... ".join(names), chain) for names, chain in zip(ends, chains.values(), strict=True)]


def _shape_json(shape: Shape | MeshPiece, colour: str) -> dict[str, Any]:
    """Return a shape for JSON: kind, colour, dimensions [m] and placement (see `placements`); or a mesh."""
    if isinstance(shape, MeshPiece):
        return shape.json(colour)
    turn = np.eye(3)
    values: dict[str, Any] = {"kind": type(shape).__name__.lower(), "colour": colour}
    if isinstance(shape, Box):
        values["size"], turn = shape.size.tolist(), shape.axes
    elif isinstance(shape, Sphere):
        values["radius"] = shape.radius
    else:
        values |= {"radius": shape.radius, "length": shape.length}
        turn = axes_along(shape.axis)[:, [0, 2, 1]] * (1, 1, -1)
    values["placement"] = placements(shape.center[None], turn[None])[0]
    return values
