"""What URDF and MJCF both say of a pair: names, the bodies' mass properties and shapes, numbers as text.

Both formats hang body 2 up at the hinge point: its link `body2_at_hinge` has body 2's axes and the hinge point as
origin. `body2`, fixed to it at -u2, is the frame (R2, S2).
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError, quoted
from hingepair.pair.body import Body, Box, Cylinder, Shape
from hingepair.pair.constants import check_one, check_pair
from hingepair.pair.hinge_pair import HingePair

BODY1, BODY2, BODY2_AT_HINGE, HINGE, BASE, WORLD = "body1", "body2", "body2_at_hinge", "hinge", "base", "world"
"""Names of the links and of the joints."""

COLOURS = {BODY1: "0.30 0.50 0.75 1", BODY2: "0.85 0.60 0.30 1"}
"""Red, green, blue and opacity: the two bodies of the README's figure."""

_NOT_XML = "[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"  # compiled when used: that takes milliseconds
_DRAWABLE = (1e-9, 1e9)  # m: beyond, a viewer shows nothing, and what is drawn has the size of one metre
_LIFT = 2.0**-46  # of the largest moment; 2^-50 was enough for MuJoCo in all of 1,000 flat bodies

Vector = NDArray[np.float64]


class Part(NamedTuple):
    """A body in the frame of its link: mass [kg], centre of mass [m], what is drawn, and its colour.

    `moments` are Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the centre of mass [kg m^2].
    """

    mass: float
    center: Vector
    moments: tuple[float, ...]
    shapes: tuple[Shape, ...]
    colour: str


def parts_of(pair: HingePair) -> tuple[Part, Part]:
    """Body 1 in the frame (R1, S1), and body 2 at the hinge point, in its own axes.

    Raises:
        ArgumentError: no pair; its name holds a character that XML cannot.
        ShapeError: u1, u2, n or home differ from sample to sample.
    """
    one, two = drawn_shapes(pair)
    if re.search(_NOT_XML, pair.name):
        raise ArgumentError("name", "characters that XML can hold", quoted(pair.name))
    return _part(BODY1, pair.body1, one, np.zeros(3)), _part(BODY2, pair.body2, two, pair.u2)


def drawn_shapes(pair: HingePair) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
    """The shapes of body 1 and body 2, each in its own axes from its reference point: those given, else drawn ones.

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
    sleeve = Cylinder(_short(0.06 * size), _short(0.15 * size), pair.u2, hinge_axis2(pair))
    one = pair.body1.shapes if pair.body1 else ()
    two = pair.body2.shapes if pair.body2 else ()
    return one or (*_arm(pair.u1, size), pin), two or (*_arm(pair.u2, size), sleeve)


def hinge_axis2(pair: HingePair) -> Vector:
    """The hinge axis in body 2's axes, C^T n."""
    axis: Vector = pair.home.T @ pair.n
    return axis


def add(parent: ET.Element, tag: str, /, **said: Any) -> ET.Element:
    """A new child of an element, with attributes: texts, numbers and arrays of numbers.

    Numbers have all their digits (repr knows no locale), and no -0 a sign.
    """
    texts = {
        key: " ".join(repr(number + 0.0) for number in np.ravel(value).tolist())
        for key, value in said.items()
        if not isinstance(value, str)
    }
    return ET.SubElement(parent, tag, said | texts)


def document(root: ET.Element) -> str:
    """The XML text of an element."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _part(name: str, given: Body | None, drawn: tuple[Shape, ...], origin: Vector) -> Part:
    body = given or Body()
    shapes = tuple(replace(shape, center=shape.center - origin) for shape in drawn)
    (xx, xy, xz), (_, yy, yz), (*_, zz) = _readable(body.inertia).tolist()
    return Part(body.mass, body.center_of_mass - origin, (xx, yy, zz, xy, xz, yz), shapes, COLOURS[name])


def _readable(inertia: Vector) -> Vector:
    """The inertia, of a flat body lifted by some round-off: loaders compute its principal moments A + B = C anew."""
    *smaller, largest = map(float, np.linalg.eigvalsh(inertia))
    lift = _LIFT * largest
    return inertia + lift * np.eye(3) if sum(smaller) - largest < lift else inertia


def _arm(u: Vector, size: float) -> tuple[Shape, ...]:
    """A box at the reference point, and a rod from there to the hinge unless that is too short to be seen."""
    box = Box(np.full(3, _short(0.12 * size)))
    length = math.hypot(*u)
    if not 0.01 * size < length < _DRAWABLE[1]:
        return (box,)
    return box, Cylinder(_short(0.025 * size), length, u / 2, u)


def _short(length: float) -> float:
    """Two digits are enough for a drawing."""
    return float(f"{length:.2g}")
