"""Pairs and robots as Pinocchio models, and their coordinates as Pinocchio has them.

A model has a free-flyer if its base is free, and then every moving joint, mimic joints included:

    q = [R1, quat_xyzw(S1), joints]
    v = [S1^T v1, S1^T omega1, rates]                                   the free-flyer's velocity is in body axes
    a = [S1^T (a1 - omega1 x v1), S1^T alpha1, accelerations]           spatial, not classical

A pair is a model of one joint, whose base is body 1. Body 2 is the frame "body2"; read its velocity and classical
acceleration in LOCAL_WORLD_ALIGNED.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, MissingDependencyError, RotationError
from hingepair.mechanism.bodies.body import Body
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.joints import KINDS
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.pairs.geometry import check_pair, check_single_pair
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.tree import Joint, MassProperties, Tree, hinge_of_pair
from hingepair.numeric.arrays import Float64Array, broadcast_shape, real_array, vectors
from hingepair.rotations.matrices import matrix_to_quaternion, unit_quaternion

MotionTuple = tuple[BodyMotion, Float64Array, Float64Array | None, Float64Array | None]
"""Motion of body 1, psi [rad], psid [rad/s] and psidd [rad/s^2]; psid is None without v, psidd is None without a."""

BASE_AT_REST = BodyMotion(S=np.eye(3), **dict.fromkeys(("R", "v", "omega", "a", "alpha"), np.zeros(3)))
"""Motion of a base that rests at the origin."""


def import_pinocchio(caller_name: str) -> Any:
    """Return the module pinocchio; where it is not installed, the error names the caller."""
    try:
        import pinocchio
    except ImportError as error:
        raise MissingDependencyError(caller_name, "Pinocchio (pip install 'pin>=4.1,<5')", str(error)) from None
    if not hasattr(pinocchio, "JointModelFreeFlyer"):
        got = f"another package named pinocchio at {pinocchio.__file__}"
        raise MissingDependencyError(caller_name, "Pinocchio (pip install 'pin>=4.1,<5')", got)
    return pinocchio


# ---- coordinates


def _free_flyer(order: int, body1: BodyMotion) -> dict[str, Float64Array]:
    """Return a body's pose (order 0), velocity (1) or acceleration (2) as the two parts of a free-flyer's."""

    def given(*names: str) -> list[Float64Array]:
        """Return arrays of the motion, none of which may be missing."""
        for name in names:
            if getattr(body1, name) is None:
                raise ArgumentError("body1", f"a motion with {name}", "one without")
        return [np.asarray(getattr(body1, name), dtype=np.float64) for name in names]

    if order == 0:
        R, S = given("R", "S")
        return {"R": R, "S": np.roll(matrix_to_quaternion(S), -1, axis=-1)}
    if order == 1:
        S, v, omega = given("S", "v", "omega")
        return {"v": _to_body(S, v), "omega": _to_body(S, omega)}
    S, v, omega, a, alpha = given("S", "v", "omega", "a", "alpha")
    with np.errstate(over="ignore", invalid="ignore"):
        spatial = a - np.cross(omega, v)
    return {"a": _to_body(S, spatial), "alpha": _to_body(S, alpha)}


def _to_body(S: Float64Array, vector: Float64Array) -> Float64Array:
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray((S * vector[..., None]).sum(axis=-2))


def _to_world(S: Float64Array, vector: Float64Array) -> Float64Array:
    with np.errstate(over="ignore", invalid="ignore"):
        return np.asarray((S * vector[..., None, :]).sum(axis=-1))


def _joined(base: Mapping[str, Float64Array], joints: Mapping[str, Float64Array]) -> Float64Array:
    """Concatenate the parts of the base and the last of the joints' arrays, broadcast to the shape of all."""
    shape = broadcast_shape({name: part.shape[:-1] for name, part in {**base, **joints}.items()})
    parts = [*base.values(), [*joints.values()][-1]]
    return np.concatenate([np.broadcast_to(part, (*shape, part.shape[-1])) for part in parts], axis=-1)


def frame_motions(
    model: Any, data: Any, frames: Sequence[int], states: Sequence[Float64Array]
) -> dict[str, Float64Array]:
    """Compute the motion of frames by Pinocchio; vectors are in world axes, and accelerations classical.

    Args:
        model: Pinocchio's model.
        data: its `Data`, which is overwritten.
        frames: numbers of the frames.
        states: q, or q and v, or q, v and a, as Pinocchio has them; shape (N, ...) each.

    Returns:
        R and S, with v also v and omega, with a also a and alpha; shape (N, frames, ...) each.
    """
    pin = import_pinocchio("body2")
    names = ("R", "S", "v", "omega", "a", "alpha")[: 2 * len(states)]
    arrays = [np.empty((len(states[0]), len(frames), 3, *(3,) * (name == "S"))) for name in names]
    for i, sample in enumerate(zip(*states, strict=True)):
        pin.forwardKinematics(model, data, *sample)
        for k, frame in enumerate(frames):
            placement = pin.updateFramePlacement(model, data, frame)
            arrays[0][i, k], arrays[1][i, k] = placement.translation, placement.rotation
            if len(sample) > 1:
                twist = pin.getFrameVelocity(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
                arrays[2][i, k], arrays[3][i, k] = twist.linear, twist.angular
            if len(sample) > 2:
                classical = pin.getFrameClassicalAcceleration(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
                arrays[4][i, k], arrays[5][i, k] = classical.linear, classical.angular
    return dict(zip(names, arrays, strict=True))


# ---- the twins


@dataclass(frozen=True, slots=True, eq=False)
class Twin:
    """A robot as a Pinocchio model, with methods that convert the robot's coordinates to Pinocchio's."""

    model: Any  # links are frames of type BODY, further frames of type OP_FRAME
    data: Any  # Pinocchio's `Data` of the model, in which its algorithms store results
    has_free_flyer: bool
    ratios: Float64Array  # of the rates of the model's joints to those of the robot's coordinates; (joints, dof)
    offsets: Float64Array  # positions of the model's joints at q = 0 [rad or m]; (joints,)

    def configuration(self, q: ArrayLike, base_motion: BodyMotion | None = None) -> Float64Array:
        """Return Pinocchio's q, shape (..., nq).

        Args:
            q: coordinates of the robot [rad or m]; shape (..., dof).
            base_motion: R and S of the base, of a model with a free-flyer; at rest at the origin unless given.
        """
        positions = self._of_joints("q", q) + self.offsets
        continuous = [joint.nq == 2 for joint in list(self.model.joints)[1 + self.has_free_flyer :]]
        if any(continuous):  # Pinocchio's q has cosine and sine for these
            columns = (
                (np.cos(column), np.sin(column)) if turns else (column,)
                for column, turns in zip(np.moveaxis(positions, -1, 0), continuous, strict=True)
            )
            positions = np.stack([one for group in columns for one in group], axis=-1)
        return _joined(self._base(0, base_motion), {"q": positions})

    def velocity(self, q: ArrayLike, qd: ArrayLike, base_motion: BodyMotion | None = None) -> Float64Array:
        """Return Pinocchio's v, shape (..., nv); of the base it takes S, v and omega."""
        return _joined(self._base(1, base_motion), {"q": self._of_joints("q", q), "qd": self._of_joints("qd", qd)})

    def acceleration(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, base_motion: BodyMotion | None = None
    ) -> Float64Array:
        """Return Pinocchio's a, which is spatial, shape (..., nv); of the base it takes all but R."""
        rates = {name: self._of_joints(name, value) for name, value in (("q", q), ("qd", qd), ("qdd", qdd))}
        return _joined(self._base(2, base_motion), rates)

    def _of_joints(self, name: str, values: ArrayLike) -> Float64Array:
        """Return q, qd or qdd of the robot as values of all joints of the model, without their offsets."""
        given = vectors(name, values, self.ratios.shape[1]).astype(np.float64)
        joints = np.zeros((*given.shape[:-1], len(self.ratios)))
        for joint, row in enumerate(self.ratios):
            for column in np.flatnonzero(row):  # a product with 0 would spread NaN to other joints
                joints[..., joint] = row[column] * given[..., column]
        return joints

    def _base(self, order: int, base_motion: BodyMotion | None) -> dict[str, Float64Array]:
        """Return the base's parts of q (order 0), v (1) or a (2); refuse a motion where the base stands."""
        if self.has_free_flyer:
            return _free_flyer(order, BASE_AT_REST if base_motion is None else base_motion)
        if base_motion is not None:
            raise ArgumentError("base_motion", "None, since the base stands in this model", base_motion)
        return {}


@dataclass(frozen=True, slots=True, eq=False)
class PairTwin:
    """A pair as a Pinocchio model, with methods that convert its coordinates to Pinocchio's and back."""

    model: Any  # with the joints "root_joint" and "hinge", and the frames "body1", "body2" and points
    data: Any  # Pinocchio's `Data` of the model, in which its algorithms store results
    body2_frame: int  # number of the frame "body2", whose placement is (S2, R2)

    def configuration(self, body1: BodyMotion, psi: ArrayLike) -> Float64Array:
        """Return Pinocchio's q, shape (..., 8).

        Args:
            body1: its R [m] and S; leading shape (...,).
            psi: hinge angle [rad]; shape (...,).
        """
        return _joined(_free_flyer(0, body1), _columns(psi=psi))

    def velocity(self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike) -> Float64Array:
        """Return Pinocchio's v, shape (..., 7).

        Args:
            body1: its S, v [m/s] and omega [rad/s], world axes; leading shape (...,).
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
        """
        return _joined(_free_flyer(1, body1), _columns(psi=psi, psid=psid))

    def acceleration(self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike, psidd: ArrayLike) -> Float64Array:
        """Return Pinocchio's a, the spatial acceleration, shape (..., 7).

        Args:
            body1: its S, v [m/s], omega [rad/s], a [m/s^2] and alpha [rad/s^2], world axes; leading shape (...,).
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
            psidd: hinge acceleration [rad/s^2]; shape (...,).
        """
        return _joined(_free_flyer(2, body1), _columns(psi=psi, psid=psid, psidd=psidd))

    def body2(self, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None) -> BodyMotion:
        """Compute the motion of body 2 by Pinocchio, one sample after another.

        Args:
            q: configuration; shape (..., 8); its quaternion may have any length but zero.
            v: velocity; shape (..., 7).
            a: spatial acceleration; shape (..., 7); needs v.

        Returns:
            R2 and S2, with v also v2 and omega2, with a also a2 and alpha2: in world axes, accelerations classical.

        >>> import numpy as np
        >>> import hingepair as hp
        >>> twin = hp.to_pinocchio(hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1)))
        >>> twin.body2((0, 0, 0, 0, 0, 0, 1, np.pi / 2)).R.round(12)
        array([1., 1., 0.])
        """
        arrays = _checked_states(q, v, a)
        shape = broadcast_shape({name: c.shape[:-1] for name, c in arrays.items()})
        quat = arrays["q"][..., 3:7]
        if (quat == 0).all(axis=-1).any():
            raise RotationError("q", "non-zero quaternions", "a zero quaternion")
        arrays["q"][..., 3:7] = unit_quaternion(quat)
        flat = [np.broadcast_to(c, (*shape, c.shape[-1])).reshape(-1, c.shape[-1]) for c in arrays.values()]
        motion = frame_motions(self.model, self.data, [self.body2_frame], flat)
        return BodyMotion(**{name: c.reshape(*shape, *c.shape[2:]) for name, c in motion.items()})

    def motion(self, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None) -> MotionTuple:
        """Convert Pinocchio's q, v and a to the tuple (body1, psi, psid, psidd).

        Args:
            q: configuration; shape (..., 8); its quaternion may have any length but zero.
            v: velocity; shape (..., 7).
            a: spatial acceleration; shape (..., 7); needs v.

        Returns:
            Vectors in world axes, accelerations classical. Rates are None without v, accelerations without a.
        """
        q, *rates = _checked_states(q, v, a).values()
        body1 = BodyMotion.from_quaternion_xyzw(R=q[..., :3], quat_xyzw=q[..., 3:7])
        if not rates:
            return body1, q[..., 7], None, None
        S = np.asarray(body1.S)
        parts = {"R": q[..., :3], "S": S, "v": _to_world(S, rates[0][..., :3])}
        parts["omega"] = _to_world(S, rates[0][..., 3:6])
        if len(rates) == 1:
            return BodyMotion(**parts), q[..., 7], rates[0][..., 6], None
        with np.errstate(over="ignore", invalid="ignore"):
            parts["a"] = _to_world(S, rates[1][..., :3]) + np.cross(parts["omega"], parts["v"])
        parts["alpha"] = _to_world(S, rates[1][..., 3:6])
        return BodyMotion(**parts), q[..., 7], rates[0][..., 6], rates[1][..., 6]


def _columns(**hinge: ArrayLike) -> dict[str, Float64Array]:
    return {name: real_array(name, value).astype(np.float64)[..., None] for name, value in hinge.items()}


def _checked_states(q: ArrayLike, v: ArrayLike | None, a: ArrayLike | None) -> dict[str, Float64Array]:
    """Return those of the q (..., 8), v and a (..., 7) of a pair that are given, by name."""
    if a is not None and v is None:
        raise ArgumentError("v", "the velocity that belongs to a", None)
    given = [(name, c, size) for name, c, size in (("q", q, 8), ("v", v, 7), ("a", a, 7)) if c is not None]
    return {name: vectors(name, c, size).astype(np.float64) for name, c, size in given}


# ---- the models


@overload
def to_pinocchio(pair: HingePair) -> PairTwin: ...


@overload
def to_pinocchio(pair: Mechanism) -> Twin: ...


def to_pinocchio(pair: HingePair | Mechanism) -> PairTwin | Twin:
    """Build a Pinocchio model of a pair or a robot, with methods that convert coordinates to Pinocchio's q, v and a.

    The model has the masses and limits that the pair or robot has; a missing body has no mass, which is enough for
    kinematics. Shapes are not in the model (`to_urdf` writes them).

    Args:
        pair: a single `HingePair` (u1, u2, n and home without leading axes), or a `Mechanism`.

    Returns:
        For a pair, a `PairTwin` (hingepair.validation.pinocchio_twin) with:

        - `.model` and `.data` of Pinocchio, and `.body2_frame`, the index of the frame whose placement is (S2, R2);
        - `.configuration(body1, psi)`: Pinocchio's q, shape (..., 8);
        - `.velocity(body1, psi, psid)`: Pinocchio's v, shape (..., 7);
        - `.acceleration(body1, psi, psid, psidd)`: Pinocchio's a, shape (..., 7);
        - `.motion(q, v, a)`: the tuple (body1, psi, psid, psidd), converted back from Pinocchio's q, v and a;
        - `.body2(q, v, a)`: the motion of body 2 that Pinocchio computes, a `BodyMotion`.

        For a `Mechanism`, a `Twin` with:

        - `.model` and `.data` of Pinocchio, with all links and moving joints, mimic joints included. It has a
          free-flyer if the base of the robot is "free"; otherwise, its base rests at the origin.
        - `.configuration(q)`, `.velocity(q, qd)` and `.acceleration(q, qd, qdd)`: Pinocchio's q, shape
          (..., model.nq), v and a, both of shape (..., model.nv). If the model has a free-flyer, these methods also
          take the argument `base_motion`, the BodyMotion of the base; by default the base rests at the origin.

    Raises:
        MissingDependencyError: Pinocchio is not installed.

    >>> import numpy as np
    >>> import hingepair as hp
    >>> twin = hp.to_pinocchio(hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 0, 0)))
    >>> body1 = hp.BodyMotion(R=(1, 2, 3), S=np.eye(3))
    >>> twin.configuration(body1, psi=0.5).tolist()
    [1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0, 0.5]
    """
    return robot_twin(pair) if isinstance(pair, Mechanism) else _pair_twin(pair)


def _pair_twin(pair: HingePair) -> PairTwin:
    """Build a pair as a Pinocchio model, whose free-flyer is body 1."""
    check_pair(pair)
    check_single_pair(pair)
    pin = import_pinocchio("to_pinocchio")
    home = np.array(pair.home)
    with np.errstate(under="ignore"):
        to_body2 = pin.SE3(home, -(home @ pair.u2))
    body1, body2 = (
        pin.Inertia.Zero() if body is None else placement.act(_inertia(pin, body))
        for body, placement in ((pair.body1, pin.SE3.Identity()), (pair.body2, to_body2))
    )
    hinge = replace(hinge_of_pair(pair), S=np.eye(3), n=pair.n)  # which rounds less than n in body 2's axes
    frames = [
        pin.Frame("body1", 1, pin.SE3.Identity(), pin.FrameType.OP_FRAME),
        pin.Frame("body2", 2, to_body2, pin.FrameType.OP_FRAME),
    ]
    for joint, points, to_body in ((1, pair.points1, pin.SE3.Identity()), (2, pair.points2, to_body2)):
        for name, position in points.items():
            placement = to_body * pin.SE3(np.eye(3), np.array(position))
            frames.append(pin.Frame(name, joint, placement, pin.FrameType.OP_FRAME))
    model = _model(pin, pair.name, "root_joint", [hinge], frames, [body1, body2])
    return PairTwin(model, model.createData(), int(model.getFrameId("body2", pin.FrameType.OP_FRAME)))


def robot_twin(robot: Mechanism, *, has_free_flyer: bool | None = None) -> Twin:
    """Build a robot as a Pinocchio model, without the mass of a fixed base, which has no effect.

    Args:
        robot: the robot.
        has_free_flyer: whether the base is a free-flyer; unless given, it is one if the robot's base is "free".
    """
    pin = import_pinocchio("to_pinocchio")
    tree, is_free = tree_of(robot).plain(), robot.base == "free"
    if has_free_flyer is None:
        has_free_flyer = is_free
    names = {joint.name for joint in tree.joints}
    flyer = "root_joint" if "root_joint" not in names else max(names, key=len) + "_root"
    first = int(has_free_flyer)
    frames = [
        pin.Frame(name, first + frame.body, pin.SE3(np.array(frame.S), np.array(frame.R)), kind)
        for kind, own in ((pin.FrameType.BODY, tree.links), (pin.FrameType.OP_FRAME, tree.frames))
        for name, frame in own.items()
    ]
    base = _inertia(pin, tree.base) if is_free else pin.Inertia.Zero()
    inertias = [base, *(_inertia(pin, joint.body) for joint in tree.joints)]
    model = _model(pin, tree.name, flyer if has_free_flyer else None, tree.joints, frames, inertias)
    return Twin(model, model.createData(), has_free_flyer, *joint_rules(tree))


def joint_rules(tree: Tree) -> tuple[Float64Array, Float64Array]:
    """Return the ratios (joints, dof) and offsets (joints,) by which the positions of all joints follow from q."""
    columns = {joint.name: column for column, joint in enumerate(tree.coordinates)}
    ratios, offsets = np.zeros((len(tree.joints), len(columns))), np.zeros(len(tree.joints))
    for row, joint in enumerate(tree.joints):
        leader = joint if joint.mimic is None else tree.joints[joint.mimic.leader - 1]
        ratios[row, columns[leader.name]] = 1.0 if joint.mimic is None else joint.mimic.multiplier
        offsets[row] = 0.0 if joint.mimic is None else joint.mimic.offset
    return ratios, offsets


def _joint_model(pin: Any, joint: Joint, axis: Any) -> Any:
    """Return the model of a joint about or along a unit axis."""
    kind = KINDS[joint.kind]
    arguments = (axis, joint.pitch) if kind.has_pitch else (axis,)
    return getattr(pin, kind.pinocchio)(*arguments)


def _model(
    pin: Any, name: str, flyer: str | None, joints: Iterable[Joint], frames: Iterable[Any], inertias: list[Any]
) -> Any:
    """Return a Pinocchio model. `flyer` names the free-flyer of a free base; `inertias` are the base's and the
    joints'.
    """
    model = pin.Model()
    model.name = name
    root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), flyer) if flyer else 0
    for joint in joints:
        axis, placement = np.array(joint.n), pin.SE3(np.array(joint.S), np.array(joint.u))
        limits = [np.array([value]) for value in (joint.effort_limit, joint.rate_limit, *joint.position_limits)]
        number = model.addJoint(root + joint.parent, _joint_model(pin, joint, axis), placement, joint.name, *limits)
        model.lowerVelocityLimit[model.joints[number].idx_v] = -joint.rate_limit  # Pinocchio drops the sign
        model.addJointFrame(number)
        model.armature[model.joints[number].idx_v] = joint.armature
    for frame in frames:
        model.addFrame(frame)
    for number, inertia in enumerate(inertias, root):  # after all frames, because addFrame rounds the masses
        model.inertias[number] = inertia
    return model


def _inertia(pin: Any, body: Body | MassProperties) -> Any:
    """Return the mass properties of a body as Pinocchio's `Inertia`."""
    inertia = pin.Inertia.Zero()  # the constructor refuses inertias that no rigid body has
    inertia.mass, inertia.lever, inertia.inertia = body.mass, np.array(body.centre_of_mass), np.array(body.inertia)
    return inertia
