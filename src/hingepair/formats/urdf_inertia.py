"""The mass properties of a body of a URDF: all links that are rigidly fixed to each other, taken together."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hingepair.errors import ArgumentError
from hingepair.formats.urdf_tree import Inertial, Robot
from hingepair.pair.body import Body
from hingepair.rotations.euler import euler_to_matrix

Pose = tuple[NDArray[np.float64], NDArray[np.float64]]
"""Rotation and origin of a frame, in the axes of another."""


def combined_body(robot: Robot, poses: Mapping[str, Pose]) -> Body | None:
    """The mass properties of links taken together, in the frame that their poses are given in.

    Links without mass count for nothing. None where no link has mass; and, with a warning, where one has a mass below
    zero or the sum is nothing that a rigid body can have: not a few robots carry made-up inertias.
    """
    placed = {link: (robot.inertials[link], pose) for link, pose in poses.items() if link in robot.inertials}
    heavy = {link: (inertial, pose) for link, (inertial, pose) in placed.items() if inertial.mass != 0}
    if not heavy:
        return None
    try:
        for link, (inertial, _) in heavy.items():
            if inertial.mass < 0:
                raise ArgumentError(f"mass of {link!r}", "a number above 0", inertial.mass)
        with np.errstate(all="ignore"):  # what overflows is no mass property: Body refuses it
            return _sum(list(heavy.values()))
    except ArgumentError as error:
        links = ", ".join(map(repr, heavy))
        warnings.warn(f"the mass properties of the body of {links} are left out: {error}", UserWarning, stacklevel=4)
        return None


def _sum(placed: Sequence[tuple[Inertial, Pose]]) -> Body:
    total = sum(inertial.mass for inertial, _ in placed)
    centres = [origin + rotation @ np.array(inertial.xyz) for inertial, (rotation, origin) in placed]
    centre = np.sum([i.mass / total * c for (i, _), c in zip(placed, centres, strict=True)], axis=0)
    inertia = np.zeros((3, 3))
    for (inertial, (rotation, _)), point in zip(placed, centres, strict=True):
        xx, xy, xz, yy, yz, zz = inertial.moments
        axes = rotation @ euler_to_matrix(inertial.rpy, "xyz")
        arm = point - centre
        inertia += axes @ np.array(((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))) @ axes.T
        inertia += inertial.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return Body(mass=total, center_of_mass=centre + 0.0, inertia=inertia)
