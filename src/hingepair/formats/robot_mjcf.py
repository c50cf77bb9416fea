"""A robot written as MJCF: each body with the links and frames that are fixed to it, joints in the order of q.

MuJoCo knows no packages: files of meshes are named by their paths.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, warn_of_dynamics
from hingepair.formats.xml_text import add_element, check_names, check_xml_text, document, first_few, seat_of
from hingepair.mechanism.bodies.body import Box, Cylinder
from hingepair.mechanism.bodies.shapes import Drawing, Drawn, Mesh
from hingepair.mechanism.tree import Joint, Tree, unused_name
from hingepair.numeric.arrays import one_constant
from hingepair.rotations.matrices import matrix_to_quaternion
from hingepair.urdf.rigid import IDENTITY_POSE, FramePose, MassProperties

# Nothing is left to the compiler's judgement: masses are those written, and fixed bodies stay bodies.
MJCF_COMPILER: Final = {
    "angle": "radian",
    "autolimits": "true",
    "inertiafromgeom": "false",
    "balanceinertia": "false",
    "boundmass": "0",
    "boundinertia": "0",
    "fusestatic": "false",
}
_TYPES: Final = {"hinge": "hinge", "slider": "slide"}  # MuJoCo's, by our kind of joint
_FARTHEST = 1e9  # rad or m; written for a missing limit beside a given one
_GREY: Final = (0.6, 0.6, 0.6, 1.0)  # RGBA of what has no colour
_COLLISION: Final = "collision"  # name of the class of the geoms for collisions
_DRAWN_ONLY: Final = {"contype": "0", "conaffinity": "0", "group": "1"}  # attributes of a geom that does not collide


class _Asset(NamedTuple):
    """Mesh of an MJCF."""

    name: str
    path: Path


_Assets: TypeAlias = dict[tuple[Any, ...], _Asset | None]
"""Assets by the mesh without its pose; None for a mesh that is not written."""


def robot_to_mjcf(
    tree: Tree,
    base: str,
    gravity: ArrayLike,
    *,
    meshes: bool = True,
    pose: FramePose | None = None,
    sentences: Sequence[str] = (),
) -> str:
    """Return a robot as MJCF text, with its meshes or without.

    Args:
        tree: the robot.
        base: "free", "pinned" or "fixed".
        gravity: acceleration of free fall [m/s^2]; shape (3,).
        meshes: whether they are written.
        pose: of the base at the start; by default at the origin.
        sentences: what the comment begins with.
    """
    check_names(tree)
    root = ET.Element("mujoco", {"model": tree.name})
    add_element(root, "compiler", **MJCF_COMPILER)
    add_element(root, "option", gravity=one_constant("gravity", gravity, 3))
    assets, unwritten = _mesh_assets(tree) if meshes else ({}, [])
    if any(assets.values()):
        _add_assets(root, assets)
    if any(drawing.collisions for drawing in tree.drawings):
        group = add_element(add_element(root, "default"), "default", **{"class": _COLLISION})
        add_element(group, "geom", **_DRAWN_ONLY | {"group": "3"})
    world = add_element(root, "worldbody")
    moves = base != "fixed"
    bodies = [_add_body(world, tree, 0, tree.base if moves else None, assets, pose)]
    if moves:
        tag, kind = ("freejoint", {}) if base == "free" else ("joint", {"type": "ball"})
        name = unused_name("base", {joint.name for joint in tree.joints})
        bodies[0].insert(0, ET.Element(tag, {"name": name, **kind}))
    chains: dict[int, list[Joint]] = {}  # joints whose bodies are left to the next one
    for number, joint in enumerate(tree.joints, 1):
        chain = [*chains.get(joint.parent, ()), joint]
        if _is_between_joints(tree, number):
            chains[number] = chain
            bodies.append(bodies[joint.parent])
            continue
        seats = _poses_in_last_body(chain)
        bodies.append(_add_body(bodies[joint.parent], tree, number, joint.body, assets, seats[0]))
        for one, seat in zip(reversed(chain), reversed(seats[1:]), strict=True):
            _insert_joint(bodies[number], one, seat)
    rules = [(joint, joint.mimic) for joint in tree.joints if joint.mimic is not None]
    equality = add_element(root, "equality") if rules else root
    for joint, rule in rules:
        curve = (rule.offset, rule.multiplier, 0, 0, 0)
        add_element(equality, "joint", joint1=joint.name, joint2=rule.leader, polycoef=curve)
    return document(root, tree, [*sentences, *unwritten])


def _is_between_joints(tree: Tree, number: int) -> bool:
    """Return whether a body is nothing but the place between two joints, which MJCF has as joints of one body."""
    masses = tree.joints[number - 1].body
    carried = [joint for joint in tree.joints if joint.parent == number]
    named = any(frame.body == number for frame in (*tree.links.values(), *tree.frames.values()))
    drawn = bool(tree.drawings) and bool(tree.drawings[number].shapes)
    return len(carried) == 1 and not (masses.mass or masses.inertia.any() or named or drawn)


def _poses_in_last_body(chain: list[Joint]) -> list[FramePose]:
    """Return the pose of the last body of a chain of joints in what carries the first, and the poses of the joints,
    whose axes are those of the bodies behind them, in the last body.
    """
    seats = [IDENTITY_POSE]
    for joint in chain:
        seats.append(seats[-1].placed(FramePose(np.array(joint.S), np.array(joint.u))))
    last = seats[-1]
    return [last, *(IDENTITY_POSE if seat is last else last.seen(seat) for seat in seats[1:])]


def _add_body(
    parent: ET.Element,
    tree: Tree,
    number: int,
    masses: MassProperties | None,
    assets: _Assets,
    place: FramePose | None,
) -> ET.Element:
    """Return the added body behind a joint (number 0: the base), at a place in the parent. Without `masses` it is a
    fixed base, and if it is called "world" the parent itself.
    """
    links, frames, seat = seat_of(tree, number)
    pose: dict[str, Any] = {} if place is None else _pose(place.origin, place.rotation)
    name = seat or f"{tree.joints[number - 1].name if number else 'base'}_at_joint"
    is_world = masses is None and seat == "world"
    body = parent if is_world else add_element(parent, "body", name=_body_name(name), **pose)
    if masses is not None and (masses.mass or masses.inertia.any()):
        J = masses.inertia
        moments = (J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])
        add_element(body, "inertial", pos=masses.centre_of_mass, mass=masses.mass, fullinertia=moments)
    _add_geoms(body, tree.drawings[number] if tree.drawings else Drawing(), assets)
    for name, frame in links.items():
        add_element(body, "body", name=_body_name(name), **_pose(frame.R, frame.S))
    for name, frame in frames.items():
        if name not in tree.links:
            add_element(body, "site", name=name, **_pose(frame.R, frame.S))
    return body


def _body_name(link: str) -> str:
    return "world_link" if link == "world" else link  # MuJoCo's own body has this name


def _insert_joint(body: ET.Element, joint: Joint, seat: FramePose) -> None:
    """Insert a joint, which has the pose `seat` in its body, as the first child of the body. Warn of what MuJoCo
    refuses, equal limits and an effort limit of 0; they are left out. Refuse a joint that MJCF does not have.
    """
    if joint.kind not in _TYPES:
        raise ArgumentError("robot", "joints that MJCF has", f"{joint.name!r}, a {joint.kind}")
    attributes: dict[str, Any] = {"type": _TYPES[joint.kind], "axis": seat.rotation @ joint.n}
    if seat.origin.any():
        attributes["pos"] = seat.origin
    for key, bounds in (("range", joint.position_limits), ("actuatorfrcrange", joint.effort_bounds)):
        lower, upper = np.clip(bounds, -_FARTHEST, _FARTHEST).tolist()
        if lower == upper:
            what = f"equal limits, {lower:g}" if key == "range" else "torque_limit = 0"
            warn_of_dynamics(f"MJCF cannot hold {what}: left out, so that joint {joint.name!r} is not limited by it")
        elif np.isfinite(bounds).any():
            attributes[key] = lower, upper
    load = joint.load
    if load.stiffness:
        attributes |= {"stiffness": load.stiffness, "springref": load.rest}
    written = {"damping": load.damping, "frictionloss": load.friction, "armature": joint.armature}
    attributes |= {name: value for name, value in written.items() if value}
    element = add_element(body, "joint", name=joint.name, **attributes)
    body.remove(element)
    body.insert(0, element)


def _pose(origin: Any, S: Any) -> dict[str, Any]:
    return {"pos": origin, "quat": matrix_to_quaternion(S)}


# ---- drawings


def _mesh_assets(tree: Tree) -> tuple[_Assets, list[str]]:
    """Return the meshes of a robot that MuJoCo can load, and sentences on the others."""
    assets: _Assets = {}
    taken: set[str] = set()
    left: dict[str, list[str]] = {}  # names of files that are not written, by the reason
    for mesh in (one for drawing in tree.drawings for one in (*drawing.visuals, *drawing.collisions)):
        if not isinstance(mesh, Mesh) or _key(mesh) in assets:
            continue
        path = mesh.find()
        if path is not None and path.suffix.lower() in {".stl", ".obj"}:
            assets[_key(mesh)] = _Asset(unused_name(path.stem, taken), Path(os.path.abspath(path)))
        else:
            assets[_key(mesh)] = None
            reason = "not found" if path is None else f"since MuJoCo cannot load {path.suffix[1:].upper()}"
            left.setdefault(reason, []).append(mesh.file.rpartition("/")[2])
    told = f"{tree.name}: these meshes are not written, "
    return assets, [f"{told}{reason}: {first_few(names)}" for reason, names in left.items()]


def _key(mesh: Mesh) -> tuple[Any, ...]:
    return mesh.file, mesh.folder, mesh.scale


def _add_assets(root: ET.Element, assets: _Assets) -> None:
    group = add_element(root, "asset")
    for (_, _, scale), asset in assets.items():
        if asset is not None:
            check_xml_text("the file of a mesh", str(asset.path))
            scaled = {"scale": scale} if scale != (1.0, 1.0, 1.0) else {}
            # A shell has an inertia also where the surface is open, which a volume has not.
            add_element(group, "mesh", name=asset.name, file=str(asset.path), **scaled, inertia="shell")


def _add_geoms(body: ET.Element, drawing: Drawing, assets: _Assets) -> None:
    """Add the geoms of a body: those that are drawn, and those for collisions, shown if there are no others."""
    visuals = [one for shape in drawing.visuals if (one := _geom(shape, assets))]
    for visual in visuals:
        colour = visual.pop("rgba", drawing.colour or _GREY)
        add_element(body, "geom", **visual, **_DRAWN_ONLY, rgba=colour)
    shown = {} if visuals else {"group": _DRAWN_ONLY["group"]}
    for shape in drawing.collisions:
        if geom := _geom(shape, assets):
            geom.pop("rgba", None)
            add_element(body, "geom", **{"class": _COLLISION}, **geom, **shown, rgba=_GREY)


def _geom(shape: Drawn, assets: Mapping[tuple[Any, ...], _Asset | None]) -> dict[str, Any]:
    """Return the attributes of the geom of a shape or mesh: half lengths and radii; none of a mesh that is not
    written.
    """
    if isinstance(shape, Mesh):
        asset = assets.get(_key(shape))
        if asset is None:
            return {}
        colour = {} if shape.colour is None else {"rgba": shape.colour}
        return {"type": "mesh", "mesh": asset.name, **_pose(shape.pose.origin, shape.pose.rotation), **colour}
    if isinstance(shape, Box):
        turn = {"quat": matrix_to_quaternion(shape.axes)} if (shape.axes != np.eye(3)).any() else {}
        return {"type": "box", "size": shape.size / 2, "pos": shape.center, **turn}
    if isinstance(shape, Cylinder):
        size = shape.radius, shape.length / 2
        return {"type": "cylinder", "size": size, "pos": shape.center, "zaxis": shape.axis}
    return {"type": "sphere", "size": shape.radius, "pos": shape.center}
