"""Simple bodies of robots that nothing draws: rods from joint to joint, drums of hinges, prisms of sliders."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hingepair.mechanism.tree import Joint, Tree
from hingepair.pair.body import Box, Cylinder, Shape, Sphere

Vector: TypeAlias = NDArray[np.float64]

_DENSITY: Final = 2000.0  # kg/m^3 of a rod, from which its mass gives its radius: metal, motors and air
_RADII: Final = (0.016, 0.03)  # least and greatest radius of a rod, in units of the robot's size
_JOINT_LENGTH: Final = 0.25  # of what a body has besides its rods, in units of the robot's size
_MAX_THICKNESS: Final = 0.3  # greatest radius of a rod that is short for the robot, in units of its length
_DEFAULT_RADIUS: Final = 0.02  # of a rod without mass, in units of the robot's size
_DRAWABLE: Final = (1e-6, 1e6)  # least and greatest size of a robot [m] that is drawn to scale
_MAX_LIMIT: Final = 1e4  # rad or m; a larger limit of a file means that there is none
_MIN_LENGTH: Final = 1e-3  # of a rod, in units of the robot's size; shorter ones are left out


class SimpleBody(NamedTuple):
    """The shapes of a body, in its own axes.

    Attributes:
        links: rods and the blocks of sliders.
        joints: drums of hinges and rails of sliders.
    """

    links: list[Shape]
    joints: list[Shape]


def robot_size(tree: Tree) -> float:
    """Return the length of the longest chain of joints and links from the base [m]; 1 where there is none."""
    lengths = [0.0]
    for joint in tree.joints:
        shifts = [abs(limit) for limit in drawn_limits(joint) if joint.kind == "slider" and math.isfinite(limit)]
        lengths.append(lengths[joint.parent] + math.hypot(*joint.u) + max(shifts, default=0.0))
    ends = [lengths[tree.links[tip].body] + math.hypot(*tree.links[tip].R) for tip in tree.tips]
    centres = [2 * math.hypot(*body.center_of_mass) for body in (tree.base, *(joint.body for joint in tree.joints))]
    size = max(*lengths, *ends) or max(centres)
    return size if _DRAWABLE[0] <= size <= _DRAWABLE[1] else 1.0


def drawn_limits(joint: Joint) -> tuple[float, float]:
    """Return the limits of a joint [rad or m], infinite where there is none, and where it is too large to be one."""
    lower, upper = joint.position_limits
    return lower if lower > -_MAX_LIMIT else -math.inf, upper if upper < _MAX_LIMIT else math.inf


def drawn_range(joint: Joint, size: float) -> tuple[float, float]:
    """Return the range in which a joint is shown [rad or m]: that of its limits.

    A hinge without limits has -pi to pi, a slider half the robot's size; one limit is as far from the other end.
    """
    lower, upper = drawn_limits(joint)
    width = 2 * math.pi if joint.kind == "hinge" else size / 2
    if not math.isfinite(lower):
        lower = upper - width if math.isfinite(upper) else -width / 2
    return lower, upper if math.isfinite(upper) else lower + width


def simple_bodies(tree: Tree, size: float) -> list[SimpleBody]:
    """Return a simple body for each body of a robot, the base first.

    Args:
        tree: the robot.
        size: its size [m].
    """
    count = len(tree.joints) + 1
    carried: list[list[int]] = [[] for _ in range(count)]
    for number, joint in enumerate(tree.joints, 1):
        carried[joint.parent].append(number)
    ends = [_ends(tree, number, size) if not carried[number] else [] for number in range(count)]
    points = [[*(np.asarray(tree.joints[k - 1].u) for k in carried[n]), *ends[n]] for n in range(count)]
    masses = [tree.base.mass, *(joint.body.mass for joint in tree.joints)]
    lengths = [sum(math.hypot(*point) for point in own) for own in points]
    radii = [_radius(mass, length, size) for mass, length in zip(masses, lengths, strict=True)]
    for number, joint in enumerate(tree.joints, 1):
        if lengths[number] <= _MIN_LENGTH * size:  # a body without a rod is as thick as its thinner neighbour
            radii[number] = min(radii[joint.parent], *(radii[k] for k in carried[number]), math.inf)
    bodies = [SimpleBody([], []) for _ in range(count)]
    for number, body in enumerate(bodies):
        radius = radii[number]
        widths = [min(radius, 1.4 * radii[k]) for k in carried[number]] + [radius] * len(ends[number])
        for point, width in zip(points[number], widths, strict=True):
            body.links.extend(_rod(point, width, size))
        if number == 0:
            body.links.append(Box((2.4 * radius,) * 3))
            continue
        joint = tree.joints[number - 1]
        if joint.kind == "hinge":
            drum = 1.2 * max(radius, min(radii[joint.parent], 1.4 * radius))
            body.joints.append(Cylinder(drum, 2.2 * drum, axis=joint.n))
            body.links.append(Sphere(radius))
        else:
            lower, upper = drawn_range(joint, size)
            body.links.append(Box((2.6 * radius, 2.6 * radius, 3 * radius), axes=axes_along(joint.n)))
            middle = joint.u + joint.S @ joint.n * (lower + upper) / 2
            rail = (1.4 * radius, 1.4 * radius, upper - lower + 3 * radius)
            bodies[joint.parent].joints.append(Box(rail, middle, axes_along(joint.S @ joint.n)))
    return bodies


def axes_along(axis: Any) -> Vector:
    """Return a rotation whose third column is a unit axis."""
    direction: Vector = np.asarray(axis, dtype=np.float64)
    across = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction))])
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(direction, across), direction], axis=1)


def _ends(tree: Tree, number: int, size: float) -> list[Vector]:
    """Return the ends of the rods of a body that carries no joint: its last links, else beyond its centre of mass."""
    tips = [np.asarray(tree.links[tip].R) for tip in tree.tips if tree.links[tip].body == number]
    far = [tip for tip in tips if math.hypot(*tip) > _MIN_LENGTH * size]
    if far:
        return far
    masses = tree.joints[number - 1].body if number else tree.base
    beyond = 2 * masses.center_of_mass
    return [beyond] if _MIN_LENGTH * size < math.hypot(*beyond) < size / 2 else []


def _radius(mass: float, length: float, size: float) -> float:
    """Return the radius of the rods of a body, of its mass and their length [m]."""
    least = min(_RADII[0] * size, _MAX_THICKNESS * length) if length > _MIN_LENGTH * size else _RADII[0] * size
    if not mass > 0:
        return max(least, min(_DEFAULT_RADIUS * size, _MAX_THICKNESS * length))
    radius = math.sqrt(mass / (math.pi * _DENSITY * (length + _JOINT_LENGTH * size)))
    return min(max(radius, least), _RADII[1] * size)


def _rod(end: Vector, radius: float, size: float) -> Sequence[Shape]:
    """Return a rounded rod from the reference point to a point."""
    length = math.hypot(*end)
    if length <= _MIN_LENGTH * size:
        return ()
    return Cylinder(radius, length, end / 2, end), Sphere(radius, end)
