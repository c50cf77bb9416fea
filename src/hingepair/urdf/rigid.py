"""Poses of frames, and masses of what is rigidly joined.

Products may underflow or overflow, whatever the caller's `numpy.errstate` is; users of the results check them.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from hingepair.numeric.arrays import Float64Array
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


def exact_quarter_turns(rotation: Float64Array, tolerance: float = 0.0) -> Float64Array:
    """Return the rotation of entries 0, 1 and -1 within `tolerance` of a rotation, or else that rotation as it is."""
    near = np.rint(rotation)
    is_near = np.abs(rotation - near).max() <= max(tolerance, _QUARTER_TURN_ERROR)
    return np.asarray(near + 0.0 if is_near else rotation)


IDENTITY_POSE = FramePose(np.eye(3), np.zeros(3))
"""Pose of a frame in itself."""


class Inertia(NamedTuple):
    """Mass properties in the axes of a frame."""

    mass: float  # [kg], of either sign, as it was written
    centre: Float64Array  # centre of mass [m]; shape (3,)
    tensor: Float64Array  # inertia tensor about the centre of mass [kg m^2]; shape (3, 3)

    def placed(self, pose: FramePose) -> Inertia:
        """Return these mass properties in another frame, in which the present one has the given pose."""
        axes, centre = pose.placed(FramePose(np.eye(3), self.centre))
        with np.errstate(all="ignore"):
            return Inertia(self.mass, centre, axes @ self.tensor @ axes.T)


def combined_inertia(inertias: Collection[Inertia]) -> Inertia:
    """Return the mass properties of rigidly joined bodies, all in one frame; about its origin if their mass is 0."""
    with np.errstate(all="ignore"):
        total = sum(part.mass for part in inertias)
        middle = np.zeros(3)
        if total:
            middle = np.sum([part.mass / total * part.centre for part in inertias], axis=0)
        tensor = np.zeros((3, 3))
        for mass, centre, part_tensor in inertias:
            arm = centre - middle
            tensor += part_tensor
            tensor -= mass * skew(arm) @ skew(arm)
        return Inertia(total, middle + 0.0, tensor + 0.0)
