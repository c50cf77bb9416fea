"""Elements of XML, and joints of URDF, as the exports write them."""

from __future__ import annotations

import functools
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body import warn_of_dynamics
from hingepair.numeric.arrays import Float64Array

NO_TURN = (0.0, 0.0, 0.0)  # roll, pitch and yaw [rad]

# Characters that XML cannot hold; compiled when used, which takes milliseconds.
_INVALID = "[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"


def check_xml_text(argument: str, text: str) -> None:
    """Raise an ArgumentError if the text of an argument has a character that XML cannot hold."""
    if re.search(_INVALID, text):
        raise ArgumentError(argument, "characters that XML can hold", quoted(text))


def add_element(parent: ET.Element, tag: str, /, **attributes: Any) -> ET.Element:
    """Add a child to an XML element, and return it; attributes are strings, or numbers and arrays to be written.

    Numbers are written with all their digits (repr does not depend on the locale), and -0 as 0.
    """
    texts = {
        key: " ".join(repr(number + 0.0) for number in np.ravel(value).tolist())
        for key, value in attributes.items()
        if not isinstance(value, str)
    }
    return ET.SubElement(parent, tag, attributes | texts)


def first_few(names: Sequence[str]) -> str:
    """Return at most three names, and how many more there are."""
    return f"{', '.join(names[:3])}{f' and {len(names) - 3} more' * (len(names) > 3)}"


def document(root: ET.Element, sentences: Sequence[str] = ()) -> str:
    """Return the XML text of an element, with its declaration, and a DynamicsWarning and a comment for each sentence
    on what is assumed. The element is indented in place.
    """
    for sentence in sentences:
        warn_of_dynamics(sentence)
    ET.indent(root)
    text = '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
    return functools.reduce(commented, reversed(sentences), text)


def add_urdf_joint(robot: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    """Add a joint of a kind such as "revolute" to the element <robot> of a URDF, and return it."""
    joint = add_element(robot, "joint", name=name, type=kind)
    add_element(joint, "parent", link=parent)
    add_element(joint, "child", link=child)
    return joint


def add_inertial(link: ET.Element, mass: float, centre: Float64Array, inertia: Float64Array) -> None:
    """Add the mass properties of a body to a link of a URDF."""
    inertial = add_element(link, "inertial")
    add_element(inertial, "origin", xyz=centre, rpy=NO_TURN)
    add_element(inertial, "mass", value=mass)
    moments = inertia[np.triu_indices(3)].tolist()
    add_element(inertial, "inertia", **dict(zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), moments, strict=True)))


def axis_for_urdf(axis: Float64Array) -> Float64Array:
    """Return a unit axis; one so near x, y or z that readers would take it for that is made a little longer."""
    # Pinocchio takes an axis within 1e-12 of x for x, but normalises one that is longer by more than that.
    second_largest = np.sort(np.abs(axis))[1]
    return axis * (1 + 2.0**-38) if 2.0**-53 < second_largest < 2.0**-39 else axis


def commented(text: str, comment: str) -> str:
    """Return an XML document with a comment below its first line; "--", which XML forbids there, becomes "- -"."""
    first, _, rest = text.partition("\n")
    return f"{first}\n<!-- {comment.replace('--', '- -')} -->\n{rest}"
