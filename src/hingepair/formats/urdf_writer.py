"""URDF: a hinge pair written as a robot of two links.

    body1 --hinge--> body2_at_hinge --fixed--> body2

The hinge's origin is (u1, home), its axis home^T n in the child's axes. Read back with `body2_frame="body2"` the same
u1, u2, n and home come out.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hingepair.formats.model_parts import (
    BASE,
    BODY1,
    BODY2,
    BODY2_AT_HINGE,
    HINGE,
    WORLD,
    Part,
    add,
    document,
    hinge_axis2,
    parts_of,
)
from hingepair.numeric.arrays import check_choice
from hingepair.pair.body import Box, Cylinder, Shape
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.euler import matrix_to_euler

BASES = ("free", "floating", "fixed")
"""How body 1 hangs in the world, for `to_urdf`."""

_BEYOND = {"effort": 1000.0, "velocity": 100.0}  # N m, rad/s: what should stop nobody
_ASIDE = (2.0**-53, 2.0**-39)
_STILL = (0.0, 0.0, 0.0)


def to_urdf(pair: HingePair, *, base: str = "free") -> str:
    """The pair as URDF text: the same text for the same pair.

    The link `body1` has the frame (R1, S1). The joint `hinge`, revolute where the pair has limits, else continuous,
    leads from it to the link `body2_at_hinge`, which has body 2's mass and shapes and its origin at the hinge point;
    the link `body2`, fixed to that at -u2, has the frame (R2, S2). A joint of URDF that has
    any limit must say how strong and how fast it is: where the pair has no torque_limit effort="1000.0" (N m) is
    written, where it has no rate_limit velocity="100.0" (rad/s), which should stop nothing.

    Args:
        pair: the pair; its limits, torque_limit, rate_limit, body1 and body2 are written where given.
        base: "free": body1 is the root, to be set free by the loader (Pinocchio: a free-flyer root joint);
            "floating": a floating joint from a link `world`; "fixed": body1 is fixed to `world`.

    Raises:
        ArgumentError: an unknown base; the pair's name holds a character that XML cannot.
        ShapeError: u1, u2, n or home differ from sample to sample.

    >>> import hingepair as hp
    >>> pair = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(0, 1, 0), limits=(-1, 1))
    >>> [line.strip() for line in hp.to_urdf(pair).splitlines() if "<limit" in line]
    ['<limit lower="-1.0" upper="1.0" effort="1000.0" velocity="100.0" />']
    """
    check_choice("base", base, BASES)
    parts = dict(zip((BODY1, BODY2_AT_HINGE), parts_of(pair), strict=True))
    robot = ET.Element("robot", {"name": pair.name})
    # MuJoCo reads URDF too, and this element of it: body2 stays a body of its own, and the shapes are kept.
    add(add(robot, "mujoco"), "compiler", fusestatic="false", discardvisual="false")
    for name, part in parts.items():
        add(add(robot, "material", name=f"{name}_paint"), "color", rgba=part.colour)
    if base != "free":
        add(robot, "link", name=WORLD)
    for name, part in parts.items():
        _add_link(robot, name, part)
    add(robot, "link", name=BODY2)
    if base != "free":
        _add_joint(robot, BASE, base, WORLD, BODY1)
    kind = "continuous" if pair.limits is None else "revolute"
    hinge = _add_joint(robot, HINGE, kind, BODY1, BODY2_AT_HINGE)
    add(hinge, "origin", xyz=pair.u1, rpy=matrix_to_euler(pair.home, "xyz"))
    add(hinge, "axis", xyz=_axis(pair))
    if limit := _limit(pair):
        add(hinge, "limit", **limit)
    add(_add_joint(robot, "body2_reference", "fixed", BODY2_AT_HINGE, BODY2), "origin", xyz=-pair.u2, rpy=_STILL)
    return document(robot)


def _limit(pair: HingePair) -> dict[str, float]:
    """What URDF says of a joint's limits: effort and velocity, both, where it says anything."""
    given = {"effort": pair.torque_limit, "velocity": pair.rate_limit}
    if pair.limits is None and set(given.values()) == {None}:
        return {}
    range_ = dict(zip(("lower", "upper"), pair.limits or (), strict=False))
    return range_ | {key: _BEYOND[key] if value is None else value for key, value in given.items()}


def _axis(pair: HingePair) -> NDArray[np.float64]:
    """The hinge axis in the child's axes, a hair too long where it is a hair off x, y or z.

    Pinocchio takes what is within 1e-12 of x for x; an axis that is longer by more than that it normalises.
    """
    axis = hinge_axis2(pair)
    aside = float(np.sort(np.abs(axis))[1])
    return axis * (1 + 2 * _ASIDE[1]) if _ASIDE[0] < aside < _ASIDE[1] else axis


def _add_link(robot: ET.Element, name: str, part: Part) -> None:
    link = add(robot, "link", name=name)
    inertial = add(link, "inertial")
    add(inertial, "origin", xyz=part.center, rpy=_STILL)
    add(inertial, "mass", value=part.mass)
    add(inertial, "inertia", **dict(zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), part.moments, strict=True)))
    for shape in part.shapes:
        kind, sizes, rpy = _geometry(shape)
        visual = add(link, "visual")
        add(visual, "origin", xyz=shape.center, rpy=rpy)
        add(add(visual, "geometry"), kind, **sizes)
        add(visual, "material", name=f"{name}_paint")


def _geometry(shape: Shape) -> tuple[str, dict[str, Any], Any]:
    """Kind, sizes, and roll, pitch and yaw: of a cylinder those that take z, the axis of URDF's, to its own."""
    if isinstance(shape, Box):
        return "box", {"size": shape.size}, matrix_to_euler(shape.axes, "xyz")
    if isinstance(shape, Cylinder):
        x, y, z = map(float, shape.axis)
        rpy = math.atan2(-y, math.hypot(x, z)), math.atan2(x, z), 0.0
        return "cylinder", {"radius": shape.radius, "length": shape.length}, rpy
    return "sphere", {"radius": shape.radius}, _STILL


def _add_joint(robot: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    joint = add(robot, "joint", name=name, type=kind)
    add(joint, "parent", link=parent)
    add(joint, "child", link=child)
    return joint
