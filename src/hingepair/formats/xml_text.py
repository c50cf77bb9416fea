"""Elements of XML, and names of links, as the exports write them."""

from __future__ import annotations

import functools
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, quoted, warn_of_dynamics
from hingepair.mechanism.tree import Frame, Tree

NO_TURN = (0.0, 0.0, 0.0)  # roll, pitch and yaw [rad]

# Characters that XML cannot hold; compiled when used, which takes milliseconds.
_INVALID = "[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]"


def check_xml_text(argument: str, text: str) -> None:
    """Raise an ArgumentError if the text of an argument has a character that XML cannot hold."""
    if re.search(_INVALID, text):
        raise ArgumentError(argument, "characters that XML can hold", quoted(text))


def check_names(tree: Tree) -> None:
    """Raise an ArgumentError if a name of a robot has a character that XML cannot hold."""
    for name in (tree.name, *tree.links, *tree.frames, *(joint.name for joint in tree.joints)):
        check_xml_text("name", name)


def seat_of(tree: Tree, number: int) -> tuple[dict[str, Frame], dict[str, Frame], str | None]:
    """Return the links of a body, its frames, and the name of the link at the body's joint, which the others lack;
    None if there is none.
    """
    links = {name: frame for name, frame in tree.links.items() if frame.body == number}
    frames = {name: frame for name, frame in tree.frames.items() if frame.body == number}
    seat = next((n for n, f in links.items() if not f.R.any() and (np.eye(3) == f.S).all()), None)
    links.pop(seat or "", None)
    return links, frames, seat


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


def document(root: ET.Element, tree: Tree, sentences: Sequence[str]) -> str:
    """Return the XML text of a robot, with its declaration, and a DynamicsWarning and a comment for each sentence on
    what is assumed. The element is indented in place.
    """
    if unread := [name for drawing in tree.drawings for name in drawing.unread]:
        sentences = [*sentences, f"{tree.name}: what cannot be read is not written: {first_few(unread)}"]
    for sentence in sentences:
        warn_of_dynamics(sentence)
    ET.indent(root)
    text = '<?xml version="1.0" encoding="utf-8"?>\n' + ET.tostring(root, encoding="unicode") + "\n"
    return functools.reduce(commented, reversed(sentences), text)


def commented(text: str, comment: str) -> str:
    """Return an XML document with a comment below its first line; "--", which XML forbids there, becomes "- -"."""
    first, _, rest = text.partition("\n")
    return f"{first}\n<!-- {comment.replace('--', '- -')} -->\n{rest}"
