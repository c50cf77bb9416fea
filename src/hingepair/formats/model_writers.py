"""Pairs and robots written as URDF or as MJCF (MuJoCo).

Of a pair, both formats hang body 2 up at the hinge point:

    body1 --hinge--> body2_at_hinge --fixed--> body2

`body2_at_hinge` has body 2's axes, mass and shapes and the hinge point as origin; `body2`, fixed to it at -u2, is the
frame (R2, S2).
"""

from __future__ import annotations

import math
import warnings
import xml.etree.ElementTree as ET
from dataclasses import fields, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, quoted
from hingepair.formats.robot_mjcf import MJCF_COMPILER, insert_mjcf_joint, robot_to_mjcf
from hingepair.formats.robot_writer import add_moving_joint, robot_to_urdf
from hingepair.formats.shape_writers import add_geom, add_shape
from hingepair.formats.xml_text import (
    NO_TURN,
    add_element,
    add_inertial,
    add_urdf_joint,
    check_xml_text,
    document,
    limits_sentences,
)
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.tree import hinge_of_pair
from hingepair.numeric.arrays import Float64Array, check_choice, one_constant
from hingepair.pair.body import Body, Box, Cylinder, DynamicsWarning, Shape
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.geometry import check_pair, check_single_pair
from hingepair.pair.hinge_load import HingeLoad
from hingepair.pair.hinge_pair import HingePair
from hingepair.pair.requests import DEFAULT_GRAVITY
from hingepair.rotations.euler import matrix_to_euler
from hingepair.rotations.matrices import matrix_to_quaternion

# Names of the links and of the joints that are written.
WORLD_LINK_NAME, BODY1_LINK_NAME, BODY2_LINK_NAME = "world", "body1", "body2"
BODY2_AT_HINGE_LINK_NAME = "body2_at_hinge"  # its origin is the hinge point
BASE_JOINT_NAME, HINGE_JOINT_NAME = "base", "hinge"

_DRAWABLE = (1e-9, 1e9)  # m; beyond, viewers show nothing, and shapes have the size of one metre
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

    Points of the pair are links without mass, fixed to `body1` and `body2`.

    A URDF joint with any limit must state effort and velocity. For a missing torque_limit, effort="1000.0" [N m or N]
    is written, and for a missing rate_limit velocity="100.0" [rad/s or m/s]. For a body of a pair without mass
    properties, 1 kg and the inertia 0.01 kg m^2 about each axis are written, unless it is the fixed base. A
    `DynamicsWarning` and a comment in the text say what is made up. For a body without shapes, a box, a rod to the
    hinge point and a cylinder along the hinge axis are written. Simulators reject a body if one principal moment of
    inertia exceeds the sum of the other two. Rounding can cause this for a flat body; the moments are then written
    slightly larger, so that simulators accept them.

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
        return robot_to_urdf(pair, base, meshes=meshes)
    if body1 is not None and base != "fixed":
        raise ArgumentError(
            "body1", f'None, since a model with base="{base}" does not hold the pose of body 1', quoted(body1)
        )
    hinge_load = _checked_load("URDF", hinge_torque, ("damping", "friction", "stops"))
    parts = _pair_parts(pair, base)
    robot = ET.Element("robot", {"name": pair.name})
    # MuJoCo reads URDF too, and this element of it: body2 stays a body of its own, and the shapes are kept.
    add_element(add_element(robot, "mujoco"), "compiler", fusestatic="false", discardvisual="false")
    for part in parts:
        add_element(add_element(robot, "material", name=f"{part.link}_paint"), "color", rgba=part.colour)
    if base != "free":
        add_element(robot, "link", name=WORLD_LINK_NAME)
    for part in parts:
        _add_urdf_link(robot, part)
    add_element(robot, "link", name=BODY2_LINK_NAME)
    if base != "free":
        to_body1 = add_urdf_joint(robot, BASE_JOINT_NAME, base, WORLD_LINK_NAME, BODY1_LINK_NAME)
        if body1 is not None:
            R, S = _checked_pose(body1)
            add_element(to_body1, "origin", xyz=R, rpy=matrix_to_euler(S, "xyz"))
    hinge = hinge_of_pair(pair, hinge_load)
    _, made_up = add_moving_joint(robot, hinge, BODY1_LINK_NAME, BODY2_AT_HINGE_LINK_NAME)
    to_body2 = add_urdf_joint(robot, "body2_reference", "fixed", BODY2_AT_HINGE_LINK_NAME, BODY2_LINK_NAME)
    add_element(to_body2, "origin", xyz=-pair.u2, rpy=NO_TURN)
    for link, points in ((BODY1_LINK_NAME, pair.points1), (BODY2_LINK_NAME, pair.points2)):
        for name, position in points.items():
            add_element(robot, "link", name=name)
            to_point = add_urdf_joint(robot, f"{name}_point", "fixed", link, name)
            add_element(to_point, "origin", xyz=position, rpy=NO_TURN)
    return document(robot, [*_assumptions(parts), *limits_sentences([(HINGE_JOINT_NAME, made_up)])])


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
    without shapes, a box, a rod to the hinge point and a cylinder along the hinge axis are written.

    For a `Mechanism`, the model has all links as bodies, added frames as sites, and joints in the order of q with
    limits of position and effort, loads (`joint_loads`) and armatures; mimic joints are joint equalities. Limits of
    rates are not written. `Mechanism.from_mjcf` reads the text back.

    Shapes and meshes of a robot are written as geoms that do not collide: what is drawn in group 1, and shapes for
    collisions in group 3, or in group 1 where a body has nothing else. The latter have the class "collision": set
    its contype and conaffinity to 1, and these bodies collide. Files of meshes are named by their paths below
    `meshdir` of the compiler. MuJoCo loads STL (binary) and OBJ; a `DynamicsWarning` names meshes in other formats,
    such as DAE, and files that were not found, which are not written. Another one names moving bodies that MuJoCo
    refuses: without a mass, or with an inertia that no rigid body has.

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
        ArgumentError: `base` is unknown, another argument cannot be used, or the name of the pair holds a character
            that XML does not allow.
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
        return robot_to_mjcf(pair, chosen, gravity, meshes=meshes)
    base = "free" if base is None else base
    check_choice("base", base, ("free", "pinned", "fixed"))
    hinge_load = _checked_load("MJCF", hinge_torque, ("stiffness", "rest", "damping", "friction", "stops"))
    part1, part2 = _pair_parts(pair, base)
    root = ET.Element("mujoco", {"model": pair.name})
    add_element(root, "compiler", **MJCF_COMPILER)
    add_element(root, "option", gravity=one_constant("gravity", gravity, 3))
    pose: dict[str, Any] = {}
    if body1 is not None:
        R, S = _checked_pose(body1)
        pose = {"pos": R, "quat": matrix_to_quaternion(S)}
    carrier = add_element(add_element(root, "worldbody"), "body", name=BODY1_LINK_NAME, **pose)
    if base == "free":
        add_element(carrier, "freejoint", name=BASE_JOINT_NAME)
    elif base == "pinned":
        add_element(carrier, "joint", name=BASE_JOINT_NAME, type="ball")
    _add_mjcf_body(carrier, part1)
    quat_wxyz = matrix_to_quaternion(pair.home)
    at_hinge = add_element(carrier, "body", name=BODY2_AT_HINGE_LINK_NAME, pos=pair.u1, quat=quat_wxyz)
    insert_mjcf_joint(at_hinge, hinge_of_pair(pair, hinge_load), "the hinge")
    _add_mjcf_body(at_hinge, part2)
    body2 = add_element(at_hinge, "body", name=BODY2_LINK_NAME, pos=-pair.u2)
    for body, points in ((carrier, pair.points1), (body2, pair.points2)):
        for name, position in points.items():
            add_element(body, "site", name=name, pos=position)
    return document(root, _assumptions((part1, part2)))


def _refuse_for_robots(**values: Any) -> None:
    for name, value in values.items():
        if value is not None:
            raise ArgumentError(name, "None, since a robot has no single hinge", quoted(value))


def _assumptions(parts: tuple[_ModelPart, _ModelPart]) -> list[str]:
    """Return the sentences on assumed mass properties."""
    return [f"{part.link}: {sentence}" for part in parts for sentence in part.assumed]


def _checked_load(format_name: str, hinge_torque: HingeLoad | None, written_fields: tuple[str, ...]) -> HingeLoad:
    """Return the load, one without effect for None, and warn of its fields that are not written."""
    if hinge_torque is None:
        return HingeLoad()
    if not isinstance(hinge_torque, HingeLoad):
        raise ArgumentError("hinge_torque", "a HingeLoad", quoted(hinge_torque))
    without = [
        one.name
        for one in fields(HingeLoad)
        if one.name not in written_fields and getattr(hinge_torque, one.name) != one.default
    ]
    if without:
        warnings.warn(f"{format_name} has no {', '.join(without)}: left out", DynamicsWarning, stacklevel=3)
    return hinge_torque


def _checked_pose(body1: BodyMotion) -> tuple[Float64Array, Float64Array]:
    """Return position and rotation of the argument `body1`, a single pose."""
    if not isinstance(body1, BodyMotion) or body1.shape != () or body1.S is None:
        raise ArgumentError("body1", "one pose, such as BodyMotion(R=(0, 0, 0), S=np.eye(3))", quoted(body1))
    return np.asarray(body1.R, np.float64), np.asarray(body1.S, np.float64)


def drawn_shapes(pair: HingePair) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
    """Return the shapes of both bodies, in their axes. A body without shapes gets a box at the reference point, a rod
    to the hinge point and a cylinder along the hinge axis: a pin for body 1, a wider sleeve for body 2.

    Raises:
        ArgumentError: no pair.
        ShapeError: u1, u2, n or home differ from sample to sample.
    """
    check_pair(pair)
    check_single_pair(pair)
    reach = math.hypot(*pair.u1) + math.hypot(*pair.u2)
    size = reach if _DRAWABLE[0] <= reach <= _DRAWABLE[1] else 1.0
    pin = Cylinder(_round_for_drawing(0.04 * size), _round_for_drawing(0.3 * size), pair.u1, pair.n)
    sleeve = Cylinder(_round_for_drawing(0.06 * size), _round_for_drawing(0.15 * size), pair.u2, _axis_in_body2(pair))
    one = pair.body1.shapes if pair.body1 else ()
    two = pair.body2.shapes if pair.body2 else ()
    return one or (*_arm_shapes(pair.u1, size), pin), two or (*_arm_shapes(pair.u2, size), sleeve)


class _ModelPart(NamedTuple):
    """A body of the pair as a link of a file."""

    link: str  # its name
    colour: str  # four numbers (RGBA)
    body: Body | None  # mass properties; None of a fixed base that has none
    origin: Float64Array  # of the link, in the axes of the body [m]
    shapes: tuple[Shape, ...]  # in the frame of the link
    assumed: tuple[str, ...]  # sentences on mass properties that were not given


def _pair_parts(pair: HingePair, base: str) -> tuple[_ModelPart, _ModelPart]:
    """Return body 1 in the frame (R1, S1), and body 2 with its origin at the hinge point."""
    one, two = drawn_shapes(pair)
    check_xml_text("name", pair.name)
    blue, orange = "0.30 0.50 0.75 1", "0.85 0.60 0.30 1"  # of the README's figure
    return (
        _make_model_part(BODY1_LINK_NAME, blue, pair.body1, one, np.zeros(3), needs_mass=base != "fixed"),
        _make_model_part(BODY2_AT_HINGE_LINK_NAME, orange, pair.body2, two, pair.u2, needs_mass=True),
    )


def _make_model_part(
    link: str, colour: str, body: Body | None, drawn: tuple[Shape, ...], origin: Float64Array, *, needs_mass: bool
) -> _ModelPart:
    """Return a body that is drawn by shapes, both in its axes; one that needs a mass and has none gets 1 kg."""
    assumed = () if body is None else body.assumed
    if body is None and needs_mass:
        body = Body()
        assumed = ("no mass properties are given: 1 kg with a radius of gyration of 0.1 m is written",)
    shapes = tuple(replace(shape, center=shape.center - origin) for shape in drawn)
    return _ModelPart(link, colour, body, origin, shapes, assumed if needs_mass else ())


def _axis_in_body2(pair: HingePair) -> Float64Array:
    axis: Float64Array = pair.home.T @ pair.n
    return axis


def _raise_flat_inertia(inertia: Float64Array) -> Float64Array:
    """Return an inertia, increased about all axes if its largest principal moment is not below the sum of the others
    by a margin, as that of a flat body or of rounded moments.
    """
    *smaller, largest = map(float, np.linalg.eigvalsh(inertia))
    lift = _INERTIA_MARGIN * largest + largest - sum(smaller)
    return inertia + lift * np.eye(3) if lift > 0 else inertia


def _arm_shapes(u: Float64Array, size: float) -> tuple[Shape, ...]:
    """Return a box at the reference point, and a rod to the hinge point unless it is too short or long to be seen."""
    box = Box(np.full(3, _round_for_drawing(0.12 * size)))
    length = math.hypot(*u)
    if not 0.01 * size < length < _DRAWABLE[1]:
        return (box,)
    return box, Cylinder(_round_for_drawing(0.025 * size), length, u / 2, u)


def _round_for_drawing(length: float) -> float:
    return float(f"{length:.2g}")


def _add_urdf_link(robot: ET.Element, part: _ModelPart) -> None:
    """Add a body as a link, with its mass properties and shapes."""
    link = add_element(robot, "link", name=part.link)
    if part.body is not None:
        place = part.body.centre_of_mass - part.origin
        add_inertial(link, part.body.mass, place, _raise_flat_inertia(part.body.inertia))
    for shape in part.shapes:
        add_element(add_shape(link, shape), "material", name=f"{part.link}_paint")


def _add_mjcf_body(body: ET.Element, part: _ModelPart) -> None:
    """Add the mass properties and shapes of a body to its element <body>."""
    if part.body is not None:
        place = part.body.centre_of_mass - part.origin
        J = _raise_flat_inertia(part.body.inertia)
        moments = [*J.diagonal(), J[0, 1], J[0, 2], J[1, 2]]
        add_element(body, "inertial", pos=place, mass=part.body.mass, fullinertia=moments)
    for shape in part.shapes:
        add_geom(body, shape, part.colour)
