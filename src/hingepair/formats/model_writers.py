"""A hinge pair written as URDF or as MJCF (MuJoCo).

Both formats hang body 2 up at the hinge point:

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
from hingepair.formats.robot_writer import robot_to_urdf
from hingepair.formats.xml_text import BEYOND, add_element, add_joint, check_text, document, long_axis
from hingepair.mechanism.mechanism import Mechanism
from hingepair.numeric.arrays import Float64Array, check_choice, one_constant
from hingepair.pair.body import Body, Box, Cylinder, DynamicsWarning, Shape
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.constants import check_one, check_pair
from hingepair.pair.hinge_load import HingeLoad
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.euler import matrix_to_euler
from hingepair.rotations.matrices import matrix_to_quaternion

BODY1, BODY2, BODY2_AT_HINGE, HINGE, BASE, WORLD = "body1", "body2", "body2_at_hinge", "hinge", "base", "world"
"""Names of the links and of the joints."""

_NO_ROTATION = (0.0, 0.0, 0.0)  # roll, pitch and yaw [rad]
_DRAWABLE = (1e-9, 1e9)  # m: beyond, a viewer shows nothing, and what is drawn has the size of one metre
_LIFT = 2.0**-46
"""Margin by which A + B > C is written, as a share of the largest moment C: MuJoCo refuses A + B < C.

2^-50 was enough in all of 1,000 flat bodies.
"""
# Nothing of the model is left to the compiler's judgement: its masses are those written, and body2 stays a body.
_COMPILER = {
    "angle": "radian",
    "autolimits": "true",
    "inertiafromgeom": "false",
    "balanceinertia": "false",
    "boundmass": "0",
    "boundinertia": "0",
    "fusestatic": "false",
}


def to_urdf(
    pair: HingePair | Mechanism,
    *,
    base: str = "free",
    hinge_torque: HingeLoad | None = None,
    body1: BodyMotion | None = None,
) -> str:
    """Return the pair as URDF text; equal pairs give equal texts.

    Of a `Mechanism` it has the links and joints, with masses, limits and the rules of joints that follow others; read
    back, by Pinocchio too, q has the same order. A fixed or locked joint is a fixed joint; the links that it holds to
    each other have one mass together. Shapes are not written, nor are inertias of rotors, of which a DynamicsWarning
    tells.

    The link `body1` has the frame (R1, S1). The joint `hinge`, revolute where the pair has limits, else continuous,
    leads from it to the link `body2_at_hinge`, which has body 2's mass and shapes and its origin at the hinge point;
    the link `body2`, fixed to that at -u2, has the frame (R2, S2). A joint of URDF that has
    any limit must say how strong and how fast it is: where the pair has no torque_limit effort="1000.0" (N m) is
    written, where it has no rate_limit velocity="100.0" (rad/s), which should stop nothing. Simulators refuse
    principal moments that no rigid body has: those of a flat body are raised above their round-off, or above the
    rounding that `Body` warned of.

    Args:
        pair: the pair; its limits, torque_limit, rate_limit, body1 and body2 are written where given. Or a robot.
        base: "free": body1 (of a robot the base) is the root, to be set free by the loader (Pinocchio: a free-flyer
            root joint); "floating": a floating joint from a link `world`; "fixed": body1 is fixed to `world`.
        hinge_torque: what acts at the hinge of a pair, as in `simulate`: its damping and friction are written, and
            its stops in place of the pair's limits. A `DynamicsWarning` lists what URDF has not.
        body1: where body 1 of a pair stands, if the base is fixed: R and S; unless given, at the origin of `world`.

    Raises:
        ArgumentError: an unknown base; the pair's name holds a character that XML cannot; body1 beside a base that is
            not fixed, hinge_torque or body1 of a robot.
        ShapeError: u1, u2, n or home differ from sample to sample.

    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0), limits=(-1, 1))
    >>> [line.strip() for line in hp.to_urdf(pair).splitlines() if "<limit" in line]
    ['<limit lower="-1.0" upper="1.0" effort="1000.0" velocity="100.0" />']
    """
    check_choice("base", base, ("free", "floating", "fixed"))
    if isinstance(pair, Mechanism):
        for name, value in (("hinge_torque", hinge_torque), ("body1", body1)):
            if value is not None:
                raise ArgumentError(name, "None beside a robot, which has no single hinge", quoted(value))
        return robot_to_urdf(pair, base)
    if body1 is not None and base != "fixed":
        raise ArgumentError("body1", f'None beside base="{base}", whose place is not in the model', quoted(body1))
    load = _checked_load("URDF", hinge_torque, ("damping", "friction", "stops"))
    parts = _pair_parts(pair)
    robot = ET.Element("robot", {"name": pair.name})
    # MuJoCo reads URDF too, and this element of it: body2 stays a body of its own, and the shapes are kept.
    add_element(add_element(robot, "mujoco"), "compiler", fusestatic="false", discardvisual="false")
    for part in parts:
        add_element(add_element(robot, "material", name=f"{part.link}_paint"), "color", rgba=part.colour)
    if base != "free":
        add_element(robot, "link", name=WORLD)
    for part in parts:
        _add_urdf_link(robot, part)
    add_element(robot, "link", name=BODY2)
    if base != "free":
        to_body1 = add_joint(robot, BASE, base, WORLD, BODY1)
        if body1 is not None:
            R, S = _standing(body1)
            add_element(to_body1, "origin", xyz=R, rpy=matrix_to_euler(S, "xyz"))
    limits = load.stops or pair.limits
    hinge = add_joint(robot, HINGE, "revolute" if limits else "continuous", BODY1, BODY2_AT_HINGE)
    add_element(hinge, "origin", xyz=pair.u1, rpy=matrix_to_euler(pair.home, "xyz"))
    add_element(hinge, "axis", xyz=long_axis(_axis2(pair)))
    if limit := _limit_attributes(pair, limits):
        add_element(hinge, "limit", **limit)
    if load.damping or load.friction:
        add_element(hinge, "dynamics", damping=load.damping, friction=load.friction)
    add_element(
        add_joint(robot, "body2_reference", "fixed", BODY2_AT_HINGE, BODY2), "origin", xyz=-pair.u2, rpy=_NO_ROTATION
    )
    return document(robot)


def to_mjcf(
    pair: HingePair,
    *,
    base: str = "free",
    hinge_torque: HingeLoad | None = None,
    body1: BodyMotion | None = None,
    gravity: ArrayLike = (0.0, 0.0, 0.0),
) -> str:
    """Write the pair as MJCF text, MuJoCo's format: the same text for the same pair.

    The body `body1` has the frame (R1, S1); it carries `body2_at_hinge`, turned by the joint `hinge` at the hinge
    point; in this, `body2` has the frame (R2, S2). qpos is (R1, quat_wxyz of S1, psi), qvel (v1, S1^T omega1, psi').
    Nothing collides.

    Args:
        pair: the pair; its limits, torque_limit, body1 and body2 are written where given; MuJoCo knows no limit of
            the rate.
        base: "free": body 1 has a free joint; "pinned": a ball joint at R1, and qpos is (quat_wxyz of the turn of
            body 1 from where it starts, psi); "fixed": it stands still, and qpos is (psi).
        hinge_torque: what acts at the hinge, as in `simulate`: its spring, damping and friction are written, and its
            stops in place of the pair's limits; MuJoCo's own solver says how these give way. A `DynamicsWarning`
            lists what MJCF has not.
        body1: where body 1 stands or starts: R and S; unless given, at the origin.
        gravity: acceleration of free fall, world axes [m/s^2]; shape (3,); none unless given.

    Raises:
        ArgumentError: an unknown base, or another argument that cannot be used; the pair's name holds a character
            that XML cannot.
        ShapeError: u1, u2, n or home differ from sample to sample.

    >>> import xml.etree.ElementTree as ET
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0))
    >>> root = ET.fromstring(hp.to_mjcf(pair))
    >>> root.find("worldbody/body/body").get("pos")
    '0.5 0.0 0.1'
    """
    check_choice("base", base, ("free", "pinned", "fixed"))
    load = _checked_load("MJCF", hinge_torque, ("stiffness", "rest", "damping", "friction", "stops"))
    one, two = _pair_parts(pair)
    root = ET.Element("mujoco", {"model": pair.name})
    add_element(root, "compiler", **_COMPILER)
    add_element(root, "option", gravity=one_constant("gravity", gravity, 3))
    place: dict[str, Any] = {}
    if body1 is not None:
        R, S = _standing(body1)
        place = {"pos": R, "quat": matrix_to_quaternion(S)}
    carrier = add_element(add_element(root, "worldbody"), "body", name=BODY1, **place)
    if base == "free":
        add_element(carrier, "freejoint", name=BASE)
    elif base == "pinned":
        add_element(carrier, "joint", name=BASE, type="ball")
    _add_mjcf_body(carrier, one)
    quat_wxyz = matrix_to_quaternion(pair.home)
    at_hinge = add_element(carrier, "body", name=BODY2_AT_HINGE, pos=pair.u1, quat=quat_wxyz)
    limits = load.stops or pair.limits
    more: dict[str, Any] = {"range": limits} if limits else {}
    if pair.torque_limit:  # MuJoCo refuses a range of 0
        more["actuatorfrcrange"] = -pair.torque_limit, pair.torque_limit
    if load.stiffness:
        more |= {"stiffness": load.stiffness, "springref": load.rest}
    more |= {"damping": load.damping} if load.damping else {}
    more |= {"frictionloss": load.friction} if load.friction else {}
    add_element(at_hinge, "joint", name=HINGE, type="hinge", axis=_axis2(pair), **more)
    _add_mjcf_body(at_hinge, two)
    add_element(at_hinge, "body", name=BODY2, pos=-pair.u2)
    return document(root)


def _checked_load(kind: str, load: HingeLoad | None, held: tuple[str, ...]) -> HingeLoad:
    """Return what acts at a hinge, and warn of everything in it that a format has no place for.

    Raises:
        ArgumentError: it is no HingeLoad.
    """
    if load is None:
        return HingeLoad()
    if not isinstance(load, HingeLoad):
        raise ArgumentError("hinge_torque", "a HingeLoad", quoted(load))
    without = [
        one.name for one in fields(HingeLoad) if one.name not in held and getattr(load, one.name) != one.default
    ]
    if without:
        warnings.warn(f"{kind} has no {', '.join(without)}: left out", DynamicsWarning, stacklevel=3)
    return load


def _standing(body1: BodyMotion) -> tuple[Float64Array, Float64Array]:
    """Return the place and the attitude that body 1 stands at.

    Raises:
        ArgumentError: it is no single pose.
    """
    if not isinstance(body1, BodyMotion) or body1.shape != () or body1.S is None:
        raise ArgumentError("body1", "one pose, such as BodyMotion(R=(0, 0, 0), S=np.eye(3))", quoted(body1))
    return np.asarray(body1.R, np.float64), np.asarray(body1.S, np.float64)


def drawn_shapes(pair: HingePair) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
    """Return the shapes of body 1 and body 2, each in its body's axes: the bodies' own, else simple drawn ones.

    A body without shapes is a box at the reference point and a rod from there to the hinge, with a pin (body 1) or a
    sleeve (body 2) along the hinge axis.

    Raises:
        ArgumentError: no pair.
        ShapeError: u1, u2, n or home differ from sample to sample.
    """
    check_pair(pair)
    check_one(pair)
    reach = math.hypot(*pair.u1) + math.hypot(*pair.u2)
    size = reach if _DRAWABLE[0] <= reach <= _DRAWABLE[1] else 1.0
    pin = Cylinder(_short(0.04 * size), _short(0.3 * size), pair.u1, pair.n)
    sleeve = Cylinder(_short(0.06 * size), _short(0.15 * size), pair.u2, _axis2(pair))
    one = pair.body1.shapes if pair.body1 else ()
    two = pair.body2.shapes if pair.body2 else ()
    return one or (*_arm(pair.u1, size), pin), two or (*_arm(pair.u2, size), sleeve)


class _Part(NamedTuple):
    """A body in the frame of its link: mass [kg], centre of mass [m], what is drawn, and its colour.

    `moments` are Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the centre of mass [kg m^2].
    """

    link: str
    colour: str
    mass: float
    center: Float64Array
    moments: tuple[float, ...]
    shapes: tuple[Shape, ...]


def _pair_parts(pair: HingePair) -> tuple[_Part, _Part]:
    """Return body 1 in the frame (R1, S1), and body 2 at the hinge point, in its own axes."""
    one, two = drawn_shapes(pair)
    check_text("name", pair.name)
    blue, orange = "0.30 0.50 0.75 1", "0.85 0.60 0.30 1"  # of the README's figure
    return _make_model_part(BODY1, blue, pair.body1, one, np.zeros(3)), _make_model_part(
        BODY2_AT_HINGE, orange, pair.body2, two, pair.u2
    )


def _make_model_part(
    link: str, colour: str, given: Body | None, drawn: tuple[Shape, ...], origin: Float64Array
) -> _Part:
    """Return one body as a URDF or MJCF link: its masses and shapes, moved to the link's origin."""
    body = given or Body()
    shapes = tuple(replace(shape, center=shape.center - origin) for shape in drawn)
    (xx, xy, xz), (_, yy, yz), (*_, zz) = _readable(body.inertia).tolist()
    return _Part(link, colour, body.mass, body.center_of_mass - origin, (xx, yy, zz, xy, xz, yz), shapes)


def _axis2(pair: HingePair) -> Float64Array:
    """Return the hinge axis in the axes of body 2, C^T n."""
    axis: Float64Array = pair.home.T @ pair.n
    return axis


def _readable(inertia: Float64Array) -> Float64Array:
    """Return an inertia whose largest principal moment is below the sum of the others after rounding too; (3, 3).

    That of a flat body is raised by the margin, and by what its moments, if they were given rounded, lack for it.
    """
    *smaller, largest = map(float, np.linalg.eigvalsh(inertia))
    lift = _LIFT * largest + largest - sum(smaller)
    return inertia + lift * np.eye(3) if lift > 0 else inertia


def _arm(u: Float64Array, size: float) -> tuple[Shape, ...]:
    """Return a box at the reference point, and a rod to the hinge unless the rod is too short to be seen."""
    box = Box(np.full(3, _short(0.12 * size)))
    length = math.hypot(*u)
    if not 0.01 * size < length < _DRAWABLE[1]:
        return (box,)
    return box, Cylinder(_short(0.025 * size), length, u / 2, u)


def _short(length: float) -> float:
    """Return a length rounded to the two digits that a drawing needs."""
    return float(f"{length:.2g}")


def _limit_attributes(pair: HingePair, limits: tuple[float, float] | None) -> dict[str, float]:
    """Return the attributes of URDF's `limit`: effort and velocity are always both written, where it is written."""
    given = {"effort": pair.torque_limit, "velocity": pair.rate_limit}
    if limits is None and set(given.values()) == {None}:
        return {}
    range_ = dict(zip(("lower", "upper"), limits or (), strict=False))
    return range_ | {key: BEYOND[key] if value is None else value for key, value in given.items()}


def _add_urdf_link(robot: ET.Element, part: _Part) -> None:
    """Add a link element to a URDF tree: the inertial element, and a visual element for each shape."""
    link = add_element(robot, "link", name=part.link)
    inertial = add_element(link, "inertial")
    add_element(inertial, "origin", xyz=part.center, rpy=_NO_ROTATION)
    add_element(inertial, "mass", value=part.mass)
    add_element(
        inertial, "inertia", **dict(zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), part.moments, strict=True))
    )
    for shape in part.shapes:
        kind, sizes, rpy = _geometry(shape)
        visual = add_element(link, "visual")
        add_element(visual, "origin", xyz=shape.center, rpy=rpy)
        add_element(add_element(visual, "geometry"), kind, **sizes)
        add_element(visual, "material", name=f"{part.link}_paint")


def _geometry(shape: Shape) -> tuple[str, dict[str, Any], Any]:
    """Return kind, sizes and (roll, pitch, yaw) of a shape; a cylinder's angles turn URDF's z axis to its own."""
    if isinstance(shape, Box):
        return "box", {"size": shape.size}, matrix_to_euler(shape.axes, "xyz")
    if isinstance(shape, Cylinder):
        x, y, z = map(float, shape.axis)
        rpy = math.atan2(-y, math.hypot(x, z)), math.atan2(x, z), 0.0
        return "cylinder", {"radius": shape.radius, "length": shape.length}, rpy
    return "sphere", {"radius": shape.radius}, _NO_ROTATION


def _add_mjcf_body(body: ET.Element, part: _Part) -> None:
    """Add the inertial element and a geom for each shape to a body element of an MJCF tree."""
    add_element(body, "inertial", pos=part.center, mass=part.mass, fullinertia=part.moments)
    for shape in part.shapes:
        drawn = {"contype": "0", "conaffinity": "0", "group": "1", "rgba": part.colour}
        add_element(body, "geom", **_geom(shape), pos=shape.center, **drawn)


def _geom(shape: Shape) -> dict[str, Any]:
    """Return type and size of a shape for MuJoCo, which takes half lengths from the centre."""
    if isinstance(shape, Box):
        turn = {"quat": matrix_to_quaternion(shape.axes)} if (shape.axes != np.eye(3)).any() else {}
        return {"type": "box", "size": shape.size / 2, **turn}
    if isinstance(shape, Cylinder):
        return {"type": "cylinder", "size": (shape.radius, shape.length / 2), "zaxis": shape.axis}
    return {"type": "sphere", "size": shape.radius}
