"""URDF text read as records, without trust in where it comes from."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from collections import defaultdict
from pathlib import Path

from hingepair.errors import URDFError
from hingepair.urdf.records import JointRecord, LinkRecord, PoseRules, RobotRecord


def read_urdf(path_or_text: str | os.PathLike[str], snap: float = 0.0) -> RobotRecord:
    """Read the links and joints of a URDF file or text (which starts with "<"); no meshes are read.

    An angle of an origin (rpy) within `snap` [rad] of a multiple of pi/2 is read as this multiple. With 0, only an
    angle that is the double nearest to a multiple of pi/2 is.
    """
    builder = _Builder()
    parser = ET.XMLParser(target=builder)
    try:
        text = _read_text(path_or_text)
        parser.feed(text)
        root = parser.close()
    except URDFError:
        raise
    except (ET.ParseError, ValueError, LookupError) as error:
        raise URDFError("URDF", "XML", str(error)) from None
    if root.tag != "robot":
        raise URDFError("URDF", "the element <robot>", f"<{root.tag}>")
    for element in root.iter():
        for name in (element.tag, *element.attrib):
            namespace = str(name)[1:].partition("}")[0] if str(name).startswith("{") else ""
            if "xacro" in namespace or namespace in builder.macros:
                expected = "a URDF without macros (the command xacro expands them)"
                raise URDFError("URDF", expected, f"xacro:{name.partition('}')[2]}")
    rules = PoseRules(snap, _has_quaternions(root.get("version", "1.0")))
    links, joints_at = defaultdict(list), defaultdict(list)
    for element in root.findall("link"):
        link = LinkRecord(element, element.get("name", ""), rules)
        links[link.name].append(link)
    joints = [_joint(element, rules) for element in root.findall("joint")]
    for joint in joints:
        for name in {joint.parent, joint.child}:
            joints_at[name].append(joint)
    folder = None if isinstance(text, str) else Path(path_or_text).absolute().parent
    robot = RobotRecord(root.get("name", ""), dict(links), joints, dict(joints_at), text, folder)
    for joint in joints:
        robot.check_declared(joint.parent, joint)
    return robot


def _has_quaternions(version: str) -> bool:
    """Return whether a version of URDF, such as "1.1", has quat_xyzw."""
    numbers = re.fullmatch(r"(\d{1,9})\.(\d{1,9})", version, re.ASCII)
    return numbers is not None and tuple(map(int, numbers.groups())) >= (1, 1)


def _joint(element: ET.Element, rules: PoseRules) -> JointRecord:
    names = ("parent", "link"), ("child", "link"), ("mimic", "joint")
    parent, child, leader = ("" if (one := element.find(tag)) is None else one.get(key, "") for tag, key in names)
    return JointRecord(element, element.get("name", ""), element.get("type", ""), parent, child, leader, rules)


class _Builder(ET.TreeBuilder):
    """Builder of XML trees that keeps the namespaces of macros, and refuses a DOCTYPE before any entity that it
    declares is expanded.
    """

    def __init__(self) -> None:
        super().__init__()
        self.macros: set[str] = set()  # namespaces whose prefix is "xacro"

    def start_ns(self, prefix: str, uri: str) -> None:
        if prefix == "xacro":
            self.macros.add(uri)

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        # Its entities could name files, or grow without bound.
        raise URDFError("URDF", "XML without a DOCTYPE", f"<!DOCTYPE {name} {pubid or ''} {system or ''}>")


def _read_text(path_or_text: str | os.PathLike[str]) -> str | bytes:
    """Return the text of a URDF: the argument itself if it starts with "<", else the bytes of a file."""
    if isinstance(path_or_text, str) and path_or_text.lstrip("\ufeff \t\r\n").startswith("<"):
        return path_or_text.lstrip("\ufeff \t\r\n")
    try:
        return Path(path_or_text).read_bytes()
    except (OSError, ValueError, TypeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise URDFError("path_or_text", "a readable file or URDF text", f"{path_or_text!r} ({reason})") from None
