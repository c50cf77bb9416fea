"""The model of a robot in Pinocchio.

If the base is free or has a given motion, Pinocchio's coordinates begin with the coordinates of a free-flyer:

    q = [R1, quat_xyzw(S1), joints]
    v = [S1^T v1, S1^T omega1, rates]
    a = [S1^T (a1 - omega1 x v1), S1^T alpha1, accelerations]       spatial, not classical

Every moving joint is a joint of the model. Pinocchio's q has a number for each of them, mimic joints included.
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
    """A robot as a Pinocchio `model` with its `data`, and methods that convert the robot's coordinates to
    Pinocchio's.
    """

    #: Pinocchio model with a free-flyer "root_joint" if `has_free_flyer`, then the moving joints in their order. The
    #: links are frames of type BODY, further frames are of type OP_FRAME
    model: Any
    #: Pinocchio's `Data` of the model, in which its algorithms store results
    data: Any
    #: whether the base is a free-flyer
    has_free_flyer: bool
    #: matrix from the rates of the robot's coordinates to the rates of the model's joints; shape (joints, dof)
    ratios: Float64Array
    #: positions of the model's joints at q = 0 [rad or m]; shape (joints,)
    offsets: Float64Array

    def configuration(self, q: ArrayLike, base_motion: BodyMotion | None = None) -> Float64Array:
        """Return Pinocchio's q, shape (..., nq), for the robot's q, shape (..., dof), and the R and S of
        `base_motion`. Without `base_motion`, the base is at the origin.
        """
        base = self._base_coordinates(base_motion, pinocchio_configuration)
        positions = self.joint_positions(q)
        continuous = [joint.nq == 2 for joint in list(self.model.joints)[1 + self.has_free_flyer :]]
        if any(continuous):  # Pinocchio's q has cosine and sine for these
            columns = (
                (np.cos(column), np.sin(column)) if turns else (column,)
                for column, turns in zip(np.moveaxis(positions, -1, 0), continuous, strict=True)
            )
            positions = np.stack([one for group in columns for one in group], axis=-1)
        return _join_coordinates(base, positions)

    def joint_positions(self, q: ArrayLike) -> Float64Array:
        """Return the positions of all joints of the model, mimic joints included; shape (..., joints)."""
        return self._joint_coordinates("q", q) + self.offsets

    def velocity(self, q: ArrayLike, qd: ArrayLike, base_motion: BodyMotion | None = None) -> Float64Array:
        """Return Pinocchio's v, shape (..., nv), for q and qd, shape (..., dof), and the S, v and omega of
        `base_motion`. Without `base_motion`, the base is at rest.
        """
        self._joint_coordinates("q", q)
        return _join_coordinates(
            self._base_coordinates(base_motion, pinocchio_velocity), self._joint_coordinates("qd", qd)
        )

    def acceleration(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, base_motion: BodyMotion | None = None
    ) -> Float64Array:
        """Return Pinocchio's a, which is spatial, shape (..., nv), for q, qd and qdd, shape (..., dof), and
        `base_motion`. Without `base_motion`, the base is at rest.
        """
        self._joint_coordinates("q", q), self._joint_coordinates("qd", qd)
        return _join_coordinates(
            self._base_coordinates(base_motion, pinocchio_acceleration), self._joint_coordinates("qdd", qdd)
        )

    def _joint_coordinates(self, name: str, values: ArrayLike) -> Float64Array:
        """Convert q, qd or qdd of the robot, shape (..., dof), to values of all joints of Pinocchio's model, mimic
        joints included but without their offsets; return shape (..., joints).
        """
        robot_values = vectors(name, values, self.ratios.shape[1]).astype(np.float64)
        joint_values = np.zeros((*robot_values.shape[:-1], len(self.ratios)))
        for joint, row in enumerate(self.ratios):
            for column in np.flatnonzero(row):
                joint_values[..., joint] = row[column] * robot_values[..., column]
        return joint_values

    def _base_coordinates(self, base_motion: BodyMotion | None, convert: Any) -> list[Float64Array]:
        """Return a list of the arrays of Pinocchio's coordinates that describe the free-flyer."""
        if not self.has_free_flyer:
            if base_motion is not None:
                raise ArgumentError("base_motion", "None, since the base stands in this model", base_motion)
            return []
        by_name: Mapping[str, Float64Array] = convert(BASE_AT_REST if base_motion is None else base_motion)
        return list(by_name.values())


BASE_AT_REST = BodyMotion(S=np.eye(3), **dict.fromkeys(("R", "v", "omega", "a", "alpha"), np.zeros(3)))
"""Motion of a base that rests at the origin."""


def robot_twin(robot: Mechanism, *, has_free_flyer: bool | None = None) -> RobotTwin:
    """Build a robot as a Pinocchio model, and return a RobotTwin, which also converts coordinates to Pinocchio's.

    Args:
        robot: the robot. The mass of a fixed base is not in the model, because it has no effect.
        has_free_flyer: whether the base is a free-flyer; unless given, it is one if the robot's base is "free".
    """
    pin = import_pinocchio("to_pinocchio")
    tree = robot.tree
    if has_free_flyer is None:
        has_free_flyer = robot.base == "free"
    model = pin.Model()
    model.name = tree.name
    joint_names = {joint.name for joint in tree.joints}
    flyer = "root_joint" if "root_joint" not in joint_names else max(joint_names, key=len) + "_root"
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), flyer) if has_free_flyer else 0
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
    for number, joint in enumerate(tree.joints, root + 1):  # after all frames, because addFrame rounds the masses
        model.inertias[number] = _pinocchio_inertia(pin, joint.body)
    columns = {joint.name: column for column, joint in enumerate(tree.coordinates)}
    ratios, offsets = np.zeros((len(tree.joints), len(columns))), np.zeros(len(tree.joints))
    for row, joint in enumerate(tree.joints):
        leader = joint if joint.mimic is None else tree.joints[joint.mimic.leader - 1]
        ratios[row, columns[leader.name]] = 1.0 if joint.mimic is None else joint.mimic.multiplier
        offsets[row] = 0.0 if joint.mimic is None else joint.mimic.offset
    return RobotTwin(model, model.createData(), has_free_flyer, ratios, offsets)


def _pinocchio_inertia(pin: Any, body: MassProperties) -> Any:
    """Convert the mass properties of a body to Pinocchio's Inertia without checking them."""
    inertia = pin.Inertia.Zero()  # the constructor refuses inertias that no rigid body has
    inertia.mass, inertia.lever, inertia.inertia = body.mass, np.array(body.center_of_mass), np.array(body.inertia)
    return inertia


def _join_coordinates(base: list[Float64Array], joints: Float64Array) -> Float64Array:
    """Return the coordinates of the base, a list of arrays, and of the joints as one array, joined along the last
    axis; leading axes are broadcast.
    """
    shape = np.broadcast_shapes(*(part.shape[:-1] for part in (*base, joints)))
    return np.concatenate([np.broadcast_to(part, (*shape, part.shape[-1])) for part in (*base, joints)], axis=-1)
