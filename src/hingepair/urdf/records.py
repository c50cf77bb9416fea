"""What a URDF says of a robot, as plain records of links and joints."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from hingepair.urdf.rigid import FramePose, MassProperties

HINGE_TYPES: Final = ("revolute", "continuous")
"""Types of joints that turn about one axis."""
SLIDER_TYPES: Final = ("prismatic",)
"""Types of joints that shift along one axis."""
SHAPE_SIZES: Final[Mapping[str, Mapping[str, int]]] = {
    "box": {"size": 3}, "cylinder": {"radius": 1, "length": 1}, "sphere": {"radius": 1}
}  # fmt: skip
"""Attributes that give the sizes of a shape, by its kind, and how many numbers each has."""


class Visual(NamedTuple):
    """Shape by which a link is drawn or collides."""

    kind: str  # "box", "cylinder", "sphere", or another tag such as "mesh"
    sizes: tuple[float, ...]  # edges of a box, radius and length of a cylinder along z, radius of a sphere [m]
    pose: FramePose  # in the axes of the link
    file: str = ""  # name of a mesh, as written; "" for other shapes
    scale: tuple[float, ...] = (1.0, 1.0, 1.0)  # of a mesh
    colour: tuple[float, ...] | None = None  # of a mesh: red, green, blue, opacity from 0 to 1


class MimicRecord(NamedTuple):
    """Rule by which a joint follows the joint named `leader`: q = multiplier * q_leader + offset [rad or m]."""

    leader: str
    multiplier: float
    offset: float

    def __str__(self) -> str:
        factor = "" if self.multiplier == 1 else f"{self.multiplier:.4g} "
        added = "" if self.offset == 0 else f" {'-' if self.offset < 0 else '+'} {abs(self.offset):.4g}"
        return f"{factor}{self.leader}{added}"


class LinkRecord(NamedTuple):
    """Link of a robot."""

    name: str
    masses: MassProperties  # in the axes of the link; 0 where nothing is written
    visuals: tuple[Visual, ...] | None  # by which it is drawn; None: they cannot be read
    collisions: tuple[Visual, ...] | None


class JointRecord(NamedTuple):
    """Joint of a robot. Of a joint that is not revolute, continuous or prismatic only the first five are read."""

    name: str
    type: str  # revolute, continuous, prismatic, fixed, floating or planar; "" if none is written
    parent: str  # name of the link that carries the joint
    child: str  # name of the link that the joint carries, whose frame is the joint's
    pose: FramePose  # of the child link at position 0, in the axes of the parent link
    axis: tuple[float, ...] = (1.0, 0.0, 0.0)  # in the axes of the child link; not zero, of any length
    limits: tuple[float, float] | None = None  # rad or m; None if both are 0 or missing, or it is continuous
    effort: float | None = None  # largest torque [N m] or force [N]; None if none is given
    velocity: float | None = None  # largest rate [rad/s or m/s]; None if none is given
    damping: float = 0.0  # N m s/rad or N s/m
    friction: float = 0.0  # dry friction [N m or N]
    mimic: MimicRecord | None = None  # of a joint that follows another
    reduction: float = 1.0  # turns of its motor for one of its own, of the transmission that drives it alone


class RobotRecord(NamedTuple):
    """Links and joints of a robot, which are a tree."""

    name: str
    links: Mapping[str, LinkRecord]  # by name, in the order of the file
    root: str  # name of the link that no joint carries
    joints: tuple[JointRecord, ...]  # depth-first, siblings by name
    text: str | bytes  # the URDF itself; bytes if it was read from a file
    folder: Path | None = None  # folder of the file, in which the names of meshes start; None for text
