"""Poses of frames, and masses of what is rigidly joined.

Products may underflow or overflow, whatever the caller's `numpy.errstate` is; users of the results check them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from hingepair.numeric.arrays import Float64Array, Frozen, read_only
from hingepair.rotations.matrices import skew


class FramePose(NamedTuple):
    """Pose of a frame in the axes of another: rotation matrix (3, 3) and origin (3,) [m]."""

    rotation: Float64Array
    origin: Float64Array

    def placed(self, inner: FramePose) -> FramePose:
        """Return the pose `inner`, given in the axes of this frame, in the axes in which this frame is given."""
        with np.errstate(all="ignore"):
            return FramePose(self.rotation @ inner.rotation, self.origin + self.rotation @ inner.origin)

    def seen(self, other: FramePose) -> FramePose:
        """Return the pose `other`, given in the same axes as this frame, in the axes of this frame."""
        with np.errstate(all="ignore"):
            return FramePose(self.rotation.T @ other.rotation, self.rotation.T @ (other.origin - self.origin))


_QUARTER_TURN_ERROR = 2.0**-50  # allowed to entries that a quaternion gave, which err by at most 2^-52


def exact_quarter_turns(rotation: Float64Array) -> Float64Array:
    """Return the rotation of entries 0, 1 and -1 next to a rotation, or else that rotation as it is."""
    near = np.rint(rotation)
    is_near = np.abs(rotation - near).max() <= _QUARTER_TURN_ERROR
    return np.asarray(near + 0.0 if is_near else rotation)


IDENTITY_POSE = FramePose(np.eye(3), np.zeros(3))
"""Pose of a frame in itself."""


@dataclass(frozen=True, slots=True, eq=False)
class MassProperties(Frozen):
    """Mass, centre of mass and inertia of one body as they were given, even if no rigid body can have them."""

    mass: float  # [kg]
    # from the origin of the frame, in its axes [m]; shape (3,). Zero where the mass is 0
    centre_of_mass: Float64Array
    # about the centre of mass, axes of the frame [kg m^2]; shape (3, 3), symmetric. Where the mass is 0: the sum of
    # the inertias, about the origin
    inertia: Float64Array

    def placed(self, pose: FramePose) -> MassProperties:
        """Return these mass properties in another frame, in which the present one has the given pose."""
        axes, centre = pose.placed(FramePose(np.eye(3), self.centre_of_mass))
        with np.errstate(all="ignore"):
            return MassProperties(self.mass, centre, axes @ self.inertia @ axes.T)


ZERO_MASS_PROPERTIES = MassProperties(0.0, read_only(np.zeros(3)), read_only(np.zeros((3, 3))))


def combined_masses(bodies: Collection[MassProperties]) -> MassProperties:
    """Return the mass properties of rigidly joined bodies, all in one frame; about its origin if their mass is 0."""
    with np.errstate(all="ignore"):
        total = sum(body.mass for body in bodies)
        middle = np.zeros(3)
        if total:
            middle = np.sum([body.mass / total * body.centre_of_mass for body in bodies], axis=0)
        inertia = np.zeros((3, 3))
        for body in bodies:
            arm = body.centre_of_mass - middle
            inertia += body.inertia
            inertia -= body.mass * skew(arm) @ skew(arm)
        return MassProperties(total, middle + 0.0, inertia + 0.0)
