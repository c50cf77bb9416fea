"""Simple shapes for bodies without a drawing: rods from joint to joint, drums at hinges, prisms at sliders."""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from hingepair.mechanism.bodies.body import Box, Cylinder, Shape, Sphere
from hingepair.mechanism.tree import Frame, Joint, Tree
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.unit_vectors import least_axis

_SHORTEST: Final = 1e-3  # of the robot's size; rods up to this length are not drawn


class SimpleBody(NamedTuple):
    """Simple shapes for a body without a drawing, in the body's axes."""

    #: rods and the blocks of sliders
    links: list[Shape]
    #: drums of hinges and rails of sliders
    joints: list[Shape]


def robot_size(tree: Tree) -> float:
    """Return the length of the longest chain of joints and links of a robot from its base [m]; 1 if that length is
    too small or too large to be drawn.
    """
    lengths = [0.0]
    for joint in tree.joints:
        shifts = [abs(joint.axis.shift(limit)) for limit in drawn_limits(joint) if math.isfinite(limit)]
        lengths.append(lengths[joint.parent] + math.hypot(*joint.u) + max(shifts, default=0.0))
    ends = [lengths[frame.body] + math.hypot(*frame.R) for frame in _ends(tree)]
    centres = [2 * math.hypot(*body.centre_of_mass) for body in (tree.base, *(joint.body for joint in tree.joints))]
    size = max(*lengths, *ends) or max(centres)
    return size if 1e-6 <= size <= 1e6 else 1.0


def drawn_limits(joint: Joint) -> tuple[float, float]:
    """Return the lower and upper position limit of a joint [rad or m]; infinite if missing or beyond 1e4."""
    lower, upper = joint.position_limits
    return lower if lower > -1e4 else -math.inf, upper if upper < 1e4 else math.inf


def drawn_range(joint: Joint, size: float) -> tuple[float, float]:
    """Return both ends of the range of a joint's slider on the page [rad or m]: its limits, where it has any.

    Without limits, the range of a hinge is -pi to pi, and that of a slider has the width of half the robot's size
    around 0. With one limit, the range has the same width.
    """
    lower, upper = drawn_limits(joint)
    width = 2 * math.pi if joint.axis.turns else size / 2
    if not math.isfinite(lower):
        lower = upper - width if math.isfinite(upper) else -width / 2
    return lower, upper if math.isfinite(upper) else lower + width


def simple_bodies(tree: Tree, size: float) -> list[SimpleBody]:
    """Return simple shapes for all bodies of a robot, the base first.

    Args:
        tree: the robot.
        size: its size [m].
    """
    radius = float(f"{size / 50:.2g}")
    bodies = [SimpleBody([], []) for _ in range(len(tree.joints) + 1)]
    for number, body in enumerate(bodies):
        carried = [np.asarray(joint.u) for joint in tree.joints if joint.parent == number]
        for end in (*carried, *_rod_ends(tree, number, size, carries=bool(carried))):
            length = math.hypot(*end)
            if length > _SHORTEST * size:
                body.links.extend((Cylinder(radius, length, end / 2, end), Sphere(radius, end)))
        if number == 0:
            body.links.append(Box((2.4 * radius,) * 3))
            continue
        joint = tree.joints[number - 1]
        if joint.axis.turns:
            body.joints.append(Cylinder(1.4 * radius, 3 * radius, axis=joint.n))
            body.links.append(Sphere(radius))
        else:
            lower, upper = drawn_range(joint, size)
            body.links.append(Box((2.6 * radius, 2.6 * radius, 3 * radius), axes=axes_along(joint.n)))
            middle = joint.u + joint.S @ joint.n * (lower + upper) / 2
            rail = (1.4 * radius, 1.4 * radius, upper - lower + 3 * radius)
            bodies[joint.parent].joints.append(Box(rail, middle, axes_along(joint.S @ joint.n)))
    return bodies


def axes_along(axis: Any) -> Float64Array:
    """Return a rotation matrix whose third column is the given unit axis; shape (3, 3)."""
    direction: Float64Array = np.asarray(axis, dtype=np.float64)
    across = np.cross(direction, least_axis(direction))
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(direction, across), direction], axis=1)


def _ends(tree: Tree) -> list[Frame]:
    """Return the frames to which rods reach: of the last links, and those that were added, such as a strut's."""
    return [*(tree.links[tip] for tip in tree.tips), *tree.frames.values()]


def _rod_ends(tree: Tree, body_number: int, size: float, *, carries: bool) -> list[Float64Array]:
    """Return the ends [m] of the rods of a body beside those to joints that it carries; of a body without any, behind
    its centre of mass.
    """
    ends = [np.asarray(frame.R) for frame in _ends(tree) if frame.body == body_number]
    far = [end for end in ends if math.hypot(*end) > _SHORTEST * size]
    if far or carries:
        return far
    masses = tree.joints[body_number - 1].body if body_number else tree.base
    beyond = 2 * masses.centre_of_mass
    return [beyond] if _SHORTEST * size < math.hypot(*beyond) < size / 2 else []
