"""The same robot in Pinocchio, joint by joint.

Of a free base, and of one that moves as it is given, Pinocchio's coordinates begin with those of a free-flyer:

    q = [R1, quat_xyzw(S1), joints]
    v = [S1^T v1, S1^T omega1, rates]
    a = [S1^T (a1 - omega1 x v1), S1^T alpha1, accelerations]       spatial, not classical

Every joint that moves is a joint there, one that follows another too: q has a number for it as for every other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError
from hingepair.mechanism.mechanism import Mechanism
from hingepair.mechanism.tree import MassProperties
from hingepair.numeric.arrays import Float64Array, vectors
from hingepair.pair.body_motion import BodyMotion
from hingepair.validation.free_flyer import (
    import_pinocchio,
    pinocchio_acceleration,
    pinocchio_configuration,
    pinocchio_velocity,
)


@dataclass(frozen=True, slots=True, eq=False)
class RobotTwin:
    """A robot as a Pinocchio model, and the way of its coordinates there.

    Attributes:
        model: a free-flyer "root_joint" where `flies`, then the joints that move, in their order; the links are its
            frames of type BODY, further frames are of type OP_FRAME.
        data: its scratch memory.
        flies: whether the base is a free-flyer.
        ratios: rates of the joints of the model for the rates of the robot's coordinates; shape (joints, dof).
        offsets: positions of the joints of the model where q is zero [rad or m]; shape (joints,).
    """

    model: Any
    data: Any
    flies: bool
    ratios: Float64Array
    offsets: Float64Array

    def configuration(self, q: ArrayLike, base_motion: BodyMotion | None = None) -> Float64Array:
        """Return Pinocchio's q, shape (..., nq), of the robot's q, shape (..., dof), and of R and S of the base.

        Raises:
            ArgumentError: q has another shape, or the base stands in this model and base_motion is given.
        """
        base = self._of_base(base_motion, pinocchio_configuration)
        return _join_coordinates(base, self._of_joints("q", q) + self.offsets)

    def velocity(self, q: ArrayLike, qd: ArrayLike, base_motion: BodyMotion | None = None) -> Float64Array:
        """Return Pinocchio's v, shape (..., nv), of q, qd, shape (..., dof), and of S, v and omega of the base.

        Raises:
            ArgumentError: as `configuration`.
        """
        self._of_joints("q", q)
        return _join_coordinates(self._of_base(base_motion, pinocchio_velocity), self._of_joints("qd", qd))

    def acceleration(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, base_motion: BodyMotion | None = None
    ) -> Float64Array:
        """Return Pinocchio's a, which is spatial, shape (..., nv), of q, qd, qdd and of the motion of the base.

        Raises:
            ArgumentError: as `configuration`.
        """
        self._of_joints("q", q), self._of_joints("qd", qd)
        return _join_coordinates(self._of_base(base_motion, pinocchio_acceleration), self._of_joints("qdd", qdd))

    def _of_joints(self, name: str, values: ArrayLike) -> Float64Array:
        """Return the mechanism's coordinates as those of all joints of Pinocchio's model, followers included."""
        own = vectors(name, values, self.ratios.shape[1]).astype(np.float64)
        rates = np.zeros((*own.shape[:-1], len(self.ratios)))
        for joint, row in enumerate(self.ratios):
            for column in np.flatnonzero(row):
                rates[..., joint] = row[column] * own[..., column]
        return rates

    def _of_base(self, base_motion: BodyMotion | None, coordinates: Any) -> list[Float64Array]:
        """Return the coordinates of Pinocchio's free-flyer for a motion of the base; none where the base is fixed."""
        if not self.flies:
            if base_motion is not None:
                raise ArgumentError("base_motion", "None, since the base stands in this model", base_motion)
            return []
        found: Mapping[str, Float64Array] = coordinates(RESTING_BASE_MOTION if base_motion is None else base_motion)
        return list(found.values())


# Position, velocities and accelerations of a base that rests at the origin.
_ZERO_COMPONENTS = np.zeros(3)
RESTING_BASE_MOTION = BodyMotion(
    R=_ZERO_COMPONENTS,
    S=np.eye(3),
    v=_ZERO_COMPONENTS,
    omega=_ZERO_COMPONENTS,
    a=_ZERO_COMPONENTS,
    alpha=_ZERO_COMPONENTS,
)
"""A base that rests at the origin."""


def robot_twin(robot: Mechanism, *, flies: bool | None = None) -> RobotTwin:
    """Return a robot as a Pinocchio model.

    Args:
        robot: the robot; the mass of a fixed base, which counts nowhere, is not in the model.
        flies: whether the base is a free-flyer; unless given, where the robot's base is free.

    Raises:
        MissingDependencyError: Pinocchio is not installed.
    """
    pin = import_pinocchio("to_pinocchio")
    tree, flying = robot.tree, robot.base == "free" if flies is None else flies
    model = pin.Model()
    model.name = tree.name
    known = {joint.name for joint in tree.joints}
    flyer = "root_joint" if "root_joint" not in known else max(known, key=len) + "_root"
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), flyer) if flying else 0
    kinds = {"hinge": pin.JointModelRevoluteUnaligned, "slider": pin.JointModelPrismaticUnaligned}
    for joint in tree.joints:
        axis, placement = np.array(joint.n), pin.SE3(np.array(joint.S), np.array(joint.u))
        limits = [np.array([value]) for value in (joint.effort_limit, joint.rate_limit, *joint.position_limits)]
        number = model.addJoint(root + joint.parent, kinds[joint.kind](axis), placement, joint.name, *limits)
        model.addJointFrame(number)
        model.armature[model.joints[number].idx_v] = joint.armature
    for kind, frames in ((pin.FrameType.BODY, tree.links), (pin.FrameType.OP_FRAME, tree.frames)):
        for name, frame in frames.items():
            placement = pin.SE3(np.array(frame.S), np.array(frame.R))
            model.addFrame(pin.Frame(name, root + frame.body, placement, kind))
    if robot.base == "free":
        model.inertias[root] = _pinocchio_inertia(pin, tree.base)
    for number, joint in enumerate(tree.joints, root + 1):  # after all frames: adding one rounds the masses
        model.inertias[number] = _pinocchio_inertia(pin, joint.body)
    columns = {joint.name: column for column, joint in enumerate(tree.coordinates)}
    ratios, offsets = np.zeros((len(tree.joints), len(columns))), np.zeros(len(tree.joints))
    for row, joint in enumerate(tree.joints):
        leader = joint if joint.mimic is None else tree.joints[joint.mimic.leader - 1]
        ratios[row, columns[leader.name]] = 1.0 if joint.mimic is None else joint.mimic.multiplier
        offsets[row] = 0.0 if joint.mimic is None else joint.mimic.offset
    return RobotTwin(model, model.createData(), flying, ratios, offsets)


def _pinocchio_inertia(pin: Any, body: MassProperties) -> Any:
    inertia = pin.Inertia.Zero()  # its constructor refuses what no rigid body has
    inertia.mass, inertia.lever, inertia.inertia = body.mass, np.array(body.center_of_mass), np.array(body.inertia)
    return inertia


def _join_coordinates(base: list[Float64Array], joints: Float64Array) -> Float64Array:
    """Return the coordinates of the base and of the joints, broadcast, in one array."""
    shape = np.broadcast_shapes(*(part.shape[:-1] for part in (*base, joints)))
    return np.concatenate([np.broadcast_to(part, (*shape, part.shape[-1])) for part in (*base, joints)], axis=-1)
