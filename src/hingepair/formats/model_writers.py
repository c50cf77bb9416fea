"""Pairs and robots written as URDF or as MJCF (MuJoCo).

A pair is written as a robot of one joint, which hangs body 2 up at the hinge point:

    body1 --hinge--> body2_at_hinge --fixed--> body2

`body2_at_hinge` has body 2's axes, mass and shapes and the hinge point as origin; `body2`, fixed to it at -u2, is the
frame (R2, S2).
"""

from __future__ import annotations

import warnings
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, DynamicsWarning, quoted
from hingepair.formats.robot_mjcf import robot_to_mjcf
from hingepair.formats.robot_writer import robot_to_urdf
from hingepair.formats.simple_bodies import robot_size, simple_bodies
from hingepair.mechanism.bodies.body import Body
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.bodies.shapes import Drawing, placed_shapes
from hingepair.mechanism.building.pairs import tree_of_pair
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.subject import check_pair, check_single_pair
from hingepair.mechanism.tree import NO_LOAD, Tree
from hingepair.numeric.arrays import Float64Array, check_choice
from hingepair.urdf.rigid import ZERO_MASS_PROPERTIES, FramePose, MassProperties

_BLUE, _ORANGE = (0.30, 0.50, 0.75, 1.0), (0.85, 0.60, 0.30, 1.0)  # RGBA of the bodies, as in README's figure
_INERTIA_MARGIN = 2.0**-46
"""Margin by which A + B > C is written, as a share of the largest moment C: MuJoCo refuses A + B < C.

2^-50 was enough in all of 1,000 flat bodies.
"""


def to_urdf(
    pair: HingePair | Mechanism,
    *,
    base: str = "free",
    hinge_torque: HingeLoad | None = None,
    body1: BodyMotion | None = None,
    meshes: bool = True,
) -> str:
    """Return a HingePair or a Mechanism as URDF text; equal pairs give equal texts.

    For a pair, the text has three links:

    - `body1` has the frame (R1, S1).
    - `body2_at_hinge` has its origin at the hinge point, and the mass and the shapes of body 2. The joint `hinge`
      connects `body2_at_hinge` with `body1`. This joint is revolute if the pair has limits, else continuous.
    - `body2` has the frame (R2, S2); it is fixed to `body2_at_hinge` at -u2.

    Points of the pair are links without mass, fixed to `body1` and `body2_at_hinge`.

    A URDF joint with any limit must state effort and velocity. For a missing torque_limit, effort="1000.0" [N m or N]
    is written, and for a missing rate_limit velocity="100.0" [rad/s or m/s]. For a body of a pair without mass
    properties, 1 kg and the inertia 0.01 kg m^2 about each axis are written, unless it is the fixed base. A
    `DynamicsWarning` and a comment in the text say what is made up. For a body without shapes, rods to the hinge
    point and the reference point, and a drum at the hinge are written. Simulators reject a body if one principal
    moment of inertia exceeds the sum of the other two. Rounding can cause this for a flat body; the moments are then
    written slightly larger, so that simulators accept them.

    For a `Mechanism`, the text has all links and joints, with masses, limits and mimic rules. If hingepair or
    Pinocchio reads the text, q has the same order as before. Fixed and locked joints are written as fixed joints, and
    the mass, the shapes and the meshes of all links that they join are written to one of these links. Meshes keep
    their scales and names such as `package://...`; names relative to the URDF file become absolute. Rotor
    inertias are not written; a `DynamicsWarning` says so.

    Args:
        pair: a `HingePair`, whose limits, torque_limit, rate_limit and mass properties (pair.body1 and pair.body2)
            are written; or a `Mechanism`.
        base: "free" (default): the root link is `body1`, or the base of a robot, and the program that loads the text
            decides whether the root can move (in Pinocchio: a free-flyer as root joint). "floating": a floating joint
            connects the root with a link `world`. "fixed": a fixed joint connects the root with a link `world`.
        hinge_torque: `HingeLoad` at the hinge of a pair. Its damping and friction are written. If it has stops, they
            are written in place of the limits of the pair. A `DynamicsWarning` lists its other properties, which URDF
            cannot hold.
        body1: pose of body 1 of a pair in `world` (R and S of a `BodyMotion`), only if `base` is "fixed". By default,
            R is the origin and S is the identity.
        meshes: False: the meshes of a robot are left out, for programs that cannot find or load their files, such as
            MuJoCo, which knows no packages.

    Raises:
        ArgumentError: `base` is unknown; a name holds a character that XML does not allow; the argument body1 is
            given although `base` is not "fixed"; or hinge_torque or body1 is given with a robot.
        ShapeError: u1, u2, n or home of the pair has leading axes.

    >>> import hingepair as hp
    >>> beam = hp.Body(mass=2, shapes=[hp.Box((1, 0.2, 0.1))])
    >>> limits = dict(limits=(-1, 1), torque_limit=50, rate_limit=3)
    >>> pair = hp.HingePair((0.5, 0, 0.1), (-0.25, 0.1, 0), (0, 1, 0), body1=beam, body2=beam, **limits)
    >>> [line.strip() for line in hp.to_urdf(pair).splitlines() if "<limit" in line]
    ['<limit lower="-1.0" upper="1.0" effort="50.0" velocity="3.0" />']
    """
    check_choice("base", base, ("free", "floating", "fixed"))
    if isinstance(pair, Mechanism):
        _refuse_for_robots(hinge_torque=hinge_torque, body1=body1)
        return robot_to_urdf(tree_of(pair).plain(), base, meshes=meshes)
    if body1 is not None and base != "fixed":
        raise ArgumentError(
            "body1", f'None, since a model with base="{base}" does not hold the pose of body 1', quoted(body1)
        )
    hinge_load = _checked_load("URDF", hinge_torque, ("damping", "friction", "stops"))
    tree, sentences = drawn_pair(pair, hinge_load, is_fixed=base == "fixed")
    return robot_to_urdf(tree, base, pose=None if body1 is None else _checked_pose(body1), sentences=sentences)


def to_mjcf(
    pair: HingePair | Mechanism,
    *,
    base: str | None = None,
    hinge_torque: HingeLoad | None = None,
    body1: BodyMotion | None = None,
    gravity: ArrayLike = DEFAULT_GRAVITY,
    meshes: bool = True,
) -> str:
    """Return a HingePair or a Mechanism as text in MJCF, the model format of MuJoCo; equal pairs give equal texts.

    For a pair, the model has three bodies, with these names:

    - "body1" has the frame (R1, S1).
    - "body2_at_hinge", the child of "body1", has its origin at the hinge point and is rotated by the joint "hinge".
    - "body2", fixed to "body2_at_hinge", has the frame (R2, S2).

    Points of the pair are sites. With a free base, qpos is (R1, quat_wxyz of S1, psi), and qvel is (v1, S1^T omega1,
    psi'). The bodies do not collide. For a body without mass properties, 1 kg and the inertia 0.01 kg m^2 about each
    axis are written, unless it is the fixed base; a `DynamicsWarning` and a comment in the text say so. For a body
    without shapes, rods to the hinge point and the reference point, and a drum at the hinge are written.

    For a `Mechanism`, the model has all links as bodies, added frames as sites, and joints in the order of q with
    limits of position and effort, loads (`joint_loads`) and armatures; mimic joints are joint equalities. Joints with
    nothing between them, neither mass nor link nor shape, are joints of one body. Limits of rates are not written.
    `Mechanism.from_mjcf` reads the text back.

    Shapes and meshes of a robot are written as geoms that do not collide: what is drawn in group 1, and shapes for
    collisions in group 3, or in group 1 where a body has nothing else. The latter have the class "collision": set
    its contype and conaffinity to 1, and these bodies collide. Files of meshes are named by their paths.
    MuJoCo loads STL (binary) and OBJ; a `DynamicsWarning` names meshes in other formats, such as DAE, and files that
    were not found, which are not written. MuJoCo itself names moving bodies that it refuses: without a mass, or with
    an inertia that no rigid body has.

    Args:
        pair: a `Mechanism`; or a `HingePair`, whose limits, torque_limit and mass properties (pair.body1 and
            pair.body2) are written. Its rate_limit is not written, since MuJoCo has no rate limits. A torque_limit of
            0, which MuJoCo does not allow, is left out with a `DynamicsWarning`.
        base: "free": body 1, or the base of a robot, has a free joint. "pinned": body 1 has a ball joint at R1, qpos
            is (quat_wxyz, psi), and qvel is (S1^T omega1, psi'). The attitude S1 is then the product of the initial
            attitude and the rotation matrix of quat_wxyz, in this order. "fixed": it does not move. By default,
            "free" for a pair, and the base of the robot for a robot.
        hinge_torque: `HingeLoad` at the hinge. Its spring, damping and friction are written. If it has stops, they
            are written in place of the limits of the pair; the softness of the stops depends on MuJoCo's solver. A
            `DynamicsWarning` lists its other properties, which MJCF cannot hold.
        body1: pose of body 1 at the start (R and S of a `BodyMotion`). By default, R is the origin and S is the
            identity.
        gravity: acceleration of free fall, world axes [m/s^2]; shape (3,). By default (0, 0, -9.81).
        meshes: False: the meshes of a robot are left out, so that the text needs no other file.

    Raises:
        ArgumentError: `base` is unknown, another argument cannot be used, a robot has loops or struts, or a name
            holds a character that XML does not allow.
        ShapeError: u1, u2, n or home of the pair has leading axes.

    >>> import xml.etree.ElementTree as ET
    >>> import hingepair as hp
    >>> beam = hp.Body(mass=2, shapes=[hp.Box((1, 0.2, 0.1))])
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0), body1=beam, body2=beam)
    >>> root = ET.fromstring(hp.to_mjcf(pair))
    >>> root.find("worldbody/body/body").get("pos")
    '0.5 0.0 0.1'
    """
    if isinstance(pair, Mechanism):
        _refuse_for_robots(hinge_torque=hinge_torque, body1=body1)
        chosen = pair.base if base is None else base
        check_choice("base", chosen, ("free", "fixed"))
        return robot_to_mjcf(tree_of(pair).plain(), chosen, gravity, meshes=meshes)
    base = "free" if base is None else base
    check_choice("base", base, ("free", "pinned", "fixed"))
    hinge_load = _checked_load("MJCF", hinge_torque, ("stiffness", "rest", "damping", "friction", "stops"))
    tree, sentences = drawn_pair(pair, hinge_load, is_fixed=base == "fixed")
    pose = None if body1 is None else _checked_pose(body1)
    return robot_to_mjcf(tree, base, gravity, pose=pose, sentences=sentences)


def _refuse_for_robots(**values: Any) -> None:
    for name, value in values.items():
        if value is not None:
            raise ArgumentError(name, "None, since a robot has no single hinge", quoted(value))


def _checked_load(format_name: str, hinge_torque: HingeLoad | None, written_fields: tuple[str, ...]) -> HingeLoad:
    """Return the load, one without effect for None, and warn of its fields that are not written."""
    if hinge_torque is None:
        return HingeLoad()
    if not isinstance(hinge_torque, HingeLoad):
        raise ArgumentError("hinge_torque", "a HingeLoad", quoted(hinge_torque))
    written = {name: getattr(hinge_torque, name) for name in written_fields}
    changed = [one.name for one in fields(HingeLoad) if getattr(hinge_torque, one.name) != one.default]
    if without := [name for name in changed if name not in written]:
        warnings.warn(f"{format_name} has no {', '.join(without)}: left out", DynamicsWarning, stacklevel=3)
    return HingeLoad(**written)


def _checked_pose(body1: BodyMotion) -> FramePose:
    """Return the argument `body1`, a single pose."""
    if not isinstance(body1, BodyMotion) or body1.shape != () or body1.S is None:
        raise ArgumentError("body1", "one pose, such as BodyMotion(R=(0, 0, 0), S=np.eye(3))", quoted(body1))
    return FramePose(np.asarray(body1.S, np.float64), np.asarray(body1.R, np.float64))


def drawn_pair(pair: HingePair, load: HingeLoad = NO_LOAD, *, is_fixed: bool = False) -> tuple[Tree, list[str]]:
    """Return a pair as the record of a robot of one joint, with the shapes of its bodies or simple ones, and
    sentences on assumed masses. A body that moves gets 1 kg if it has none.

    Raises:
        ArgumentError: no pair.
        ShapeError: u1, u2, n or home differ from sample to sample.
    """
    check_pair(pair)
    check_single_pair(pair)
    bodies = ("body1", pair.body1, np.zeros(3)), ("body2_at_hinge", pair.body2, pair.u2)
    sentences: list[str] = []
    masses: list[MassProperties] = []
    for link, body, origin in bodies:
        moves = link != "body1" or not is_fixed
        if body is None and moves:
            sentences.append(
                f"{link}: no mass properties are given: 1 kg with a radius of gyration of 0.1 m is written"
            )
            masses.append(_mass_properties(Body(), origin))
            continue
        sentences += [f"{link}: {sentence}" for sentence in (body.assumed if body and moves else ())]
        masses.append(ZERO_MASS_PROPERTIES if body is None else _mass_properties(body, origin))
    tree, drawings = tree_of_pair(pair, load, masses), list[Drawing]()
    simple = simple_bodies(tree, robot_size(tree))
    for (_, body, origin), colour, own in zip(bodies, (_BLUE, _ORANGE), simple, strict=True):
        given = placed_shapes(body.shapes, FramePose(np.eye(3), 0.0 - origin)) if body else []
        shapes = tuple(given or (*own.links, *own.joints))
        drawings.append(Drawing(shapes, shapes, colour=colour))
    return replace(tree, drawings=tuple(drawings)), sentences


def _mass_properties(body: Body, origin: Float64Array) -> MassProperties:
    """Return the mass properties of a body from another origin in it, so that simulators accept them."""
    return MassProperties(body.mass, body.centre_of_mass - origin, _raise_flat_inertia(body.inertia))


def _raise_flat_inertia(inertia: Float64Array) -> Float64Array:
    """Return an inertia, increased about all axes if its largest principal moment is not below the sum of the others
    by a margin, as that of a flat body or of rounded moments.
    """
    *smaller, largest = map(float, np.linalg.eigvalsh(inertia))
    lift = _INERTIA_MARGIN * largest + largest - sum(smaller)
    return inertia + lift * np.eye(3) if lift > 0 else inertia
