"""The same pair in Pinocchio: a free-flyer and a revolute joint.

Pinocchio's coordinates of the pair:

    q = [R1, quat_xyzw(S1), psi]
    v = [S1^T v1, S1^T omega1, psi']                        the free-flyer's velocity is in body 1's axes
    a = [S1^T (a1 - omega1 x v1), S1^T alpha1, psi'']       the free-flyer's acceleration is spatial

Body 2 is the frame "body2"; read its velocity and classical acceleration in LOCAL_WORLD_ALIGNED.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, RotationError
from hingepair.mechanism.mechanism import Mechanism
from hingepair.numeric.arrays import Float64Array, broadcast_shape, real_array, vectors
from hingepair.pair.body_motion import BodyMotion
from hingepair.pair.constants import check_pair, check_single_pair
from hingepair.pair.hinge_pair import HingePair
from hingepair.rotations.matrices import unit_quaternion
from hingepair.validation.free_flyer import (
    frame_motion,
    import_pinocchio,
    pinocchio_acceleration,
    pinocchio_configuration,
    pinocchio_velocity,
    to_world,
)
from hingepair.validation.robot_twin import RobotTwin, robot_twin

MotionTuple = tuple[BodyMotion, Float64Array, Float64Array | None, Float64Array | None]
"""Motion of body 1, psi [rad], psid [rad/s] and psidd [rad/s^2]; psid is None without v, psidd is None without a."""


@dataclass(frozen=True, slots=True, eq=False)
class PinocchioTwin:
    """A pair as a Pinocchio model: `model` and its `data`, the index `body2_frame` of the frame of body 2, and
    methods that convert coordinates to Pinocchio's and back, and that compute body 2.
    """

    #: Pinocchio model with the free-flyer "root_joint", then the revolute joint "hinge"; the frames "body1" and
    #: "body2"; and inertias and limits if the pair has them
    model: Any
    #: Pinocchio's `Data` of the model, in which its algorithms store results
    data: Any
    #: index of the frame "body2", whose placement is (S2, R2)
    body2_frame: int

    def configuration(self, body1: BodyMotion, psi: ArrayLike) -> Float64Array:
        """Return Pinocchio's q, shape (..., 8), for a pose of body 1 and the hinge angle.

        Args:
            body1: its R [m] and S; leading shape (...,).
            psi: hinge angle [rad]; shape (...,).
        """
        return _join_base_and_hinge(pinocchio_configuration(body1), psi=psi)

    def velocity(self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike) -> Float64Array:
        """Return Pinocchio's v, shape (..., 7), for a motion of body 1 and of the hinge.

        Args:
            body1: its S, v [m/s] and omega [rad/s], world axes; leading shape (...,).
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
        """
        return _join_base_and_hinge(pinocchio_velocity(body1), psi=psi, psid=psid)

    def acceleration(self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike, psidd: ArrayLike) -> Float64Array:
        """Return Pinocchio's a, the spatial acceleration, shape (..., 7), for a motion of body 1 and of the hinge.

        Args:
            body1: its S, v [m/s], omega [rad/s], a [m/s^2] and alpha [rad/s^2], world axes; leading shape (...,).
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
            psidd: hinge acceleration [rad/s^2]; shape (...,).
        """
        return _join_base_and_hinge(pinocchio_acceleration(body1), psi=psi, psid=psid, psidd=psidd)

    def body2(self, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None) -> BodyMotion:
        """Compute the motion of body 2 by Pinocchio from Pinocchio's q, v and a, one sample after another; return it
        as a BodyMotion.

        Args:
            q: configuration; shape (..., 8); its quaternion may have any length but zero.
            v: velocity; shape (..., 7).
            a: spatial acceleration; shape (..., 7); needs v.

        Returns:
            R2 and S2; v2 and omega2 if v is given; a2 and alpha2 if a is given. Vectors are in world axes, and
            accelerations are classical.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> twin = hp.to_pinocchio(hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1)))
        >>> twin.body2((0, 0, 0, 0, 0, 0, 1, np.pi / 2)).R.round(12)
        array([1., 1., 0.])
        """
        if a is not None and v is None:
            raise ArgumentError("v", "the velocity that belongs to a", None)
        arguments = [(name, c, size) for name, c, size in (("q", q, 8), ("v", v, 7), ("a", a, 7)) if c is not None]
        arrays = {name: vectors(name, c, size).astype(np.float64) for name, c, size in arguments}
        shape = broadcast_shape({name: c.shape[:-1] for name, c in arrays.items()})
        quat = arrays["q"][..., 3:7]
        if (quat == 0).all(axis=-1).any():
            raise RotationError("q", "non-zero quaternions", "a zero quaternion")
        arrays["q"][..., 3:7] = unit_quaternion(quat)
        flat = [np.broadcast_to(c, (*shape, c.shape[-1])).reshape(-1, c.shape[-1]) for c in arrays.values()]
        motion = frame_motion(self.model, self.data, self.body2_frame, flat)
        return BodyMotion(**{name: c.reshape(*shape, *c.shape[1:]) for name, c in motion.items()})

    def motion(self, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None) -> MotionTuple:
        """Convert Pinocchio's q, v and a to the tuple (motion of body 1, psi, psi', psi''). psi' is None without v,
        and psi'' without a.

        Args:
            q: configuration; shape (..., 8); its quaternion may have any length but zero.
            v: velocity; shape (..., 7).
            a: spatial acceleration; shape (..., 7); needs v.

        Returns:
            (body1, psi, psid, psidd). Vectors are in world axes, and accelerations are classical. Rates are None
            without v, accelerations without a.
        """
        if a is not None and v is None:
            raise ArgumentError("v", "the velocity that belongs to a", None)
        q = vectors("q", q, 8).astype(np.float64)
        body1 = BodyMotion.from_quaternion_xyzw(R=q[..., :3], quat_xyzw=q[..., 3:7])
        if v is None:
            return body1, q[..., 7], None, None
        S, v = np.asarray(body1.S), vectors("v", v, 7).astype(np.float64)
        attributes = {"R": q[..., :3], "S": S, "v": to_world(S, v[..., :3]), "omega": to_world(S, v[..., 3:6])}
        if a is None:
            return BodyMotion(**attributes), q[..., 7], v[..., 6], None
        a = vectors("a", a, 7).astype(np.float64)
        with np.errstate(over="ignore", invalid="ignore"):
            a1 = to_world(S, a[..., :3]) + np.cross(attributes["omega"], attributes["v"])
        body1 = BodyMotion(**attributes, a=a1, alpha=to_world(S, a[..., 3:6]))
        return body1, q[..., 7], v[..., 6], a[..., 6]


@overload
def to_pinocchio(pair: HingePair) -> PinocchioTwin: ...


@overload
def to_pinocchio(pair: Mechanism) -> RobotTwin: ...


def to_pinocchio(pair: HingePair | Mechanism) -> PinocchioTwin | RobotTwin:
    """Build a Pinocchio model of a pair or a robot. Return a PinocchioTwin for a pair and a RobotTwin for a robot.
    Both hold the model and have methods that convert coordinates to Pinocchio's q, v and a.

    The model of a pair has a free-flyer joint for body 1, a revolute joint about n at u1, and a frame of body 2. It
    has the masses and the limits of the pair. If body1 or body2 is None, its mass in the model is 0; this is enough
    for kinematics, but dynamics needs both bodies. If the pair has no limits, the joint of the model has none. Shapes
    are not in the model (`to_urdf` writes them).

    Args:
        pair: a single `HingePair` (u1, u2, n and home without leading axes), or a `Mechanism`.

    Returns:
        For a pair, a `PinocchioTwin` (hingepair.validation.pinocchio_twin) with:

        - `.model` and `.data` of Pinocchio, and `.body2_frame`, the index of the frame whose placement is (S2, R2);
        - `.configuration(body1, psi)`: Pinocchio's q, shape (..., 8);
        - `.velocity(body1, psi, psid)`: Pinocchio's v, shape (..., 7);
        - `.acceleration(body1, psi, psid, psidd)`: Pinocchio's a, shape (..., 7);
        - `.motion(q, v, a)`: the tuple (body1, psi, psid, psidd), converted back from Pinocchio's q, v and a;
        - `.body2(q, v, a)`: the motion of body 2 that Pinocchio computes, a `BodyMotion`.

        For a `Mechanism`, a `RobotTwin` (hingepair.validation.robot_twin) with:

        - `.model` and `.data` of Pinocchio. The model has all links and all moving joints, mimic joints included. It
          has a free-flyer if the base of the robot is "free"; otherwise, its base rests at the origin.
        - `.configuration(q)`, `.velocity(q, qd)` and `.acceleration(q, qd, qdd)`: Pinocchio's q, shape
          (..., model.nq), v and a, both of shape (..., model.nv). If the model has a free-flyer, these methods also
          take the argument `base_motion`, the BodyMotion of the base; by default the base rests at the origin.

    Raises:
        MissingDependencyError: Pinocchio is not installed.
        ShapeError: u1, u2, n or home of the pair has leading axes.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> twin = hp.to_pinocchio(hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0)))
    >>> body1 = hp.BodyMotion(R=(1, 2, 3), S=np.eye(3))
    >>> twin.configuration(body1, psi=0.5).tolist()
    [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.5]
    """
    if isinstance(pair, Mechanism):
        return robot_twin(pair)
    check_pair(pair)
    check_single_pair(pair)
    pin = import_pinocchio("to_pinocchio")
    model = pin.Model()
    model.name = pair.name
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    hinge = model.addJoint(
        root, pin.JointModelRevoluteUnaligned(np.array(pair.n)), pin.SE3(np.eye(3), np.array(pair.u1)), "hinge"
    )
    home = np.array(pair.home)
    model.addFrame(pin.Frame("body1", root, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    with np.errstate(under="ignore"):
        placement = pin.SE3(home, -(home @ pair.u2))
    body2 = model.addFrame(pin.Frame("body2", hinge, placement, pin.FrameType.OP_FRAME))
    for joint, body, frame in ((root, pair.body1, pin.SE3.Identity()), (hinge, pair.body2, placement)):
        if body is not None:
            inertia = pin.Inertia(body.mass, np.array(body.center_of_mass), np.array(body.inertia))
            model.appendBodyToJoint(joint, inertia, frame)
    if pair.limits is not None:
        model.lowerPositionLimit[-1], model.upperPositionLimit[-1] = pair.limits
    if pair.torque_limit is not None:
        model.lowerEffortLimit[-1], model.upperEffortLimit[-1] = -pair.torque_limit, pair.torque_limit
    if pair.rate_limit is not None:
        model.lowerVelocityLimit[-1], model.upperVelocityLimit[-1] = -pair.rate_limit, pair.rate_limit
    return PinocchioTwin(model, model.createData(), int(body2))


def _join_base_and_hinge(base_parts: dict[str, Float64Array], **hinge: ArrayLike) -> Float64Array:
    """Join the coordinates of the base, a dict of arrays, and the coordinate of the hinge along the last axis, and
    return one array. psi, psid and psidd are given by further keyword arguments; the last of these is the coordinate
    that is joined.
    """
    numbers = {name: real_array(name, value).astype(np.float64)[..., None] for name, value in hinge.items()}
    shape = broadcast_shape({name: part.shape[:-1] for name, part in (base_parts | numbers).items()})
    joined = [*base_parts.values(), list(numbers.values())[-1]]
    return np.concatenate([np.broadcast_to(part, (*shape, part.shape[-1])) for part in joined], axis=-1)
