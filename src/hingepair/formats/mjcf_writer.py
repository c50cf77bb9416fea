"""MJCF: a hinge pair written as a MuJoCo model of two bodies."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from hingepair.formats.model_parts import (
    BASE,
    BODY1,
    BODY2,
    BODY2_AT_HINGE,
    HINGE,
    Part,
    add,
    document,
    hinge_axis2,
    parts_of,
)
from hingepair.numeric.arrays import check_choice
from hingepair.pair.body import Box, Cylinder, Shape
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import matrix_to_quaternion

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


def to_mjcf(pair: HingePair, *, base: str = "free") -> str:
    """The pair as MJCF text, MuJoCo's format: the same text for the same pair.

    The body `body1` has the frame (R1, S1); it carries `body2_at_hinge`, turned by the joint `hinge` at the hinge
    point; in this, `body2` has the frame (R2, S2). qpos is (R1, quat_wxyz of S1, psi), qvel (v1, S1^T omega1, psi').
    There is no gravity, and nothing collides.

    Args:
        pair: the pair; its limits, torque_limit, body1 and body2 are written where given; MuJoCo knows no limit of
            the rate.
        base: "free": body 1 has a free joint; "fixed": it stands still, R1 = 0, S1 = identity, and qpos is (psi).

    Raises:
        ArgumentError: an unknown base; the pair's name holds a character that XML cannot.
        ShapeError: u1, u2, n or home differ from sample to sample.

    >>> import xml.etree.ElementTree as ET
    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0))
    >>> root = ET.fromstring(hp.to_mjcf(pair))
    >>> root.find("worldbody/body/body").get("pos")
    '0.5 0.0 0.1'
    """
    check_choice("base", base, ("free", "fixed"))
    one, two = parts_of(pair)
    root = ET.Element("mujoco", {"model": pair.name})
    add(root, "compiler", **_COMPILER)
    add(root, "option", gravity=(0, 0, 0))
    body1 = add(add(root, "worldbody"), "body", name=BODY1)
    if base == "free":
        add(body1, "freejoint", name=BASE)
    _add_part(body1, one)
    quat_wxyz = matrix_to_quaternion(pair.home)
    at_hinge = add(body1, "body", name=BODY2_AT_HINGE, pos=pair.u1, quat=quat_wxyz)
    limits: dict[str, Any] = {} if pair.limits is None else {"range": pair.limits}
    if pair.torque_limit:  # MuJoCo refuses a range of 0
        limits["actuatorfrcrange"] = -pair.torque_limit, pair.torque_limit
    add(at_hinge, "joint", name=HINGE, type="hinge", axis=hinge_axis2(pair), **limits)
    _add_part(at_hinge, two)
    add(at_hinge, "body", name=BODY2, pos=-pair.u2)
    return document(root)


def _add_part(body: ET.Element, part: Part) -> None:
    add(body, "inertial", pos=part.center, mass=part.mass, fullinertia=part.moments)
    for shape in part.shapes:
        drawn = {"contype": "0", "conaffinity": "0", "group": "1", "rgba": part.colour}
        add(body, "geom", **_geom(shape), pos=shape.center, **drawn)


def _geom(shape: Shape) -> dict[str, Any]:
    """Type and size; MuJoCo counts from the centre, in half lengths."""
    if isinstance(shape, Box):
        turned = (shape.axes != np.eye(3)).any()
        return {
            "type": "box",
            "size": shape.size / 2,
            **({"quat": matrix_to_quaternion(shape.axes)} if turned else {}),
        }
    if isinstance(shape, Cylinder):
        return {"type": "cylinder", "size": (shape.radius, shape.length / 2), "zaxis": shape.axis}
    return {"type": "sphere", "size": shape.radius}
