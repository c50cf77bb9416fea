"""Elements of XML, and joints of URDF, as the exports write them."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, quoted
from hingepair.numeric.arrays import Float64Array

BEYOND = {"effort": 1000.0, "velocity": 100.0}
"""What a joint of URDF with any limit must say, where it is not given: N m (N) and rad/s (m/s) that stop nothing."""

_BLURRED_SIZES = (2.0**-53, 2.0**-39)  # second largest components of an axis that readers may take for zero
_NOT_XML = "[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"  # compiled when used: that takes milliseconds


def check_text(argument: str, text: str) -> None:
    """Refuse a text that XML cannot hold.

    Raises:
        ArgumentError: names the argument.
    """
    if re.search(_NOT_XML, text):
        raise ArgumentError(argument, "characters that XML can hold", quoted(text))


def add_element(parent: ET.Element, tag: str, /, **said: Any) -> ET.Element:
    """Return a new child of an element, with attributes: texts, numbers and arrays of numbers.

    Numbers have all their digits (repr knows no locale), and no -0 a sign.
    """
    texts = {
        key: " ".join(repr(number + 0.0) for number in np.ravel(value).tolist())
        for key, value in said.items()
        if not isinstance(value, str)
    }
    return ET.SubElement(parent, tag, said | texts)


def document(root: ET.Element) -> str:
    """Return the XML text of an element."""
    ET.indent(root)
    return '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def add_joint(robot: ET.Element, name: str, kind: str, parent: str, child: str) -> ET.Element:
    """Return a new joint of a URDF robot."""
    joint = add_element(robot, "joint", name=name, type=kind)
    add_element(joint, "parent", link=parent)
    add_element(joint, "child", link=child)
    return joint


def long_axis(axis: Float64Array) -> Float64Array:
    """Return a unit axis, a hair too long where it is a hair off x, y or z.

    Pinocchio takes what is within 1e-12 of x for x; an axis that is longer by more than that it normalises.
    """
    return (
        axis * (1 + 2 * _BLURRED_SIZES[1])
        if _BLURRED_SIZES[0] < np.sort(np.abs(axis))[1] < _BLURRED_SIZES[1]
        else axis
    )


def commented(text: str, comment: str) -> str:
    """Return the text of a document with a comment below its first line."""
    first, _, rest = text.partition("\n")
    return f"{first}\n<!-- {comment.replace('--', '- -')} -->\n{rest}"
