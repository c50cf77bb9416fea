"""Pairs and robots as Pinocchio models, and their coordinates as Pinocchio has them.

A model has a free-flyer if its base is free, and then every moving joint, mimic joints included:

    q = [R1, quat_xyzw(S1), joints]
    v = [S1^T v1, S1^T omega1, rates]                                   the free-flyer's velocity is in body axes
    a = [S1^T (a1 - omega1 x v1), S1^T alpha1, accelerations]           spatial, not classical

A pair is a model of one joint, whose base is body 1. Read velocities and classical accelerations of frames in
LOCAL_WORLD_ALIGNED.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from hingepair.errors import ArgumentError, MissingDependencyError
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.building.pairs import tree_of_pair
from hingepair.mechanism.kinds import KINDS
from hingepair.mechanism.mechanism import Mechanism, tree_of
from hingepair.mechanism.pairs.hinge_pair import HingePair
from hingepair.mechanism.pairs.subject import check_pair, check_single_pair
from hingepair.mechanism.robots.conventions import PINOCCHIO, check_base, read_state, written_a, written_q, written_v
from hingepair.mechanism.tree import Tree
from hingepair.numeric.arrays import Float64Array, broadcast_shape, real_array, vectors
from hingepair.urdf.rigid import ZERO_MASS_PROPERTIES

LETTERS = ("R", "S", "v", "omega", "a", "alpha")
"""Names of the parts of a motion."""
_Rule = tuple[str, float, float]
MotionTuple = tuple[BodyMotion, Float64Array, Float64Array | None, Float64Array | None]
"""Motion of body 1, psi [rad], psid [rad/s] and psidd [rad/s^2]; psid is None without v, psidd is None without a."""


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
    pin = import_pinocchio("cross_validate")
    names = LETTERS[: 2 * len(states)]
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
        (positions,) = self._of_joints(base_motion, q=q)
        joints = list(self.model.joints)[1 + self.has_free_flyer :]
        turning = [number for number, joint in enumerate(joints) if joint.nq == 2]  # by cosine and sine
        return written_q(PINOCCHIO, positions + self.offsets, base_motion, self.has_free_flyer, turning)

    def velocity(self, q: ArrayLike, qd: ArrayLike, base_motion: BodyMotion | None = None) -> Float64Array:
        """Return Pinocchio's v, shape (..., nv); of the base it takes S, v and omega."""
        _, rates = self._of_joints(base_motion, q=q, qd=qd)
        with np.errstate(all="ignore"):
            return written_v(PINOCCHIO, rates, base_motion, self.has_free_flyer)

    def acceleration(
        self, q: ArrayLike, qd: ArrayLike, qdd: ArrayLike, base_motion: BodyMotion | None = None
    ) -> Float64Array:
        """Return Pinocchio's a, which is spatial, shape (..., nv); of the base it takes all but R."""
        *_, changes = self._of_joints(base_motion, q=q, qd=qd, qdd=qdd)
        with np.errstate(all="ignore"):
            return written_a(changes, base_motion, self.has_free_flyer)

    def columns(self, S: Float64Array) -> Float64Array:
        """Return the matrices from the velocities of base and coordinates to v, of a model with a free-flyer whose
        attitude is S (N, 3, 3); shape (N, nv, 6 + dof).
        """
        matrices = np.broadcast_to(with_base(self.ratios), (len(S), self.model.nv, 6 + self.ratios.shape[1])).copy()
        matrices[:, :3, :3] = matrices[:, 3:6, 3:6] = np.swapaxes(S, -1, -2)
        return matrices

    def _of_joints(self, base_motion: BodyMotion | None, **given: ArrayLike) -> list[Float64Array]:
        """Return q and its derivatives as values of all joints of the model, without their offsets."""
        check_base(base_motion, self.has_free_flyer)
        read = {name: vectors(name, one, self.ratios.shape[1]).astype(np.float64) for name, one in given.items()}
        shape = broadcast_shape({name: one.shape[:-1] for name, one in read.items()})
        return [np.broadcast_to(one @ self.ratios.T, (*shape, len(self.ratios))) for one in read.values()]


@dataclass(frozen=True, slots=True, eq=False)
class PairTwin:
    """A pair as a Pinocchio model, with methods that convert its coordinates to Pinocchio's and back."""

    model: Any  # with the joints "root_joint" and "hinge", and the frames "body1", "body2" and points
    data: Any  # Pinocchio's `Data` of the model, in which its algorithms store results
    body2_frame: int  # number of the frame "body2", whose placement is (S2, R2)
    robot: Twin  # the same as a robot of one joint

    def configuration(self, body1: BodyMotion, psi: ArrayLike) -> Float64Array:
        """Return Pinocchio's q, shape (..., 8).

        Args:
            body1: its R [m] and S; leading shape (...,).
            psi: hinge angle [rad]; shape (...,).
        """
        return self.robot.configuration(_column("psi", psi), body1)

    def velocity(self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike) -> Float64Array:
        """Return Pinocchio's v, shape (..., 7).

        Args:
            body1: its S, v [m/s] and omega [rad/s], world axes; leading shape (...,).
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
        """
        return self.robot.velocity(_column("psi", psi), _column("psid", psid), body1)

    def acceleration(self, body1: BodyMotion, psi: ArrayLike, psid: ArrayLike, psidd: ArrayLike) -> Float64Array:
        """Return Pinocchio's a, the spatial acceleration, shape (..., 7).

        Args:
            body1: its S, v [m/s], omega [rad/s], a [m/s^2] and alpha [rad/s^2], world axes; leading shape (...,).
            psi: hinge angle [rad]; shape (...,).
            psid: hinge rate [rad/s]; shape (...,).
            psidd: hinge acceleration [rad/s^2]; shape (...,).
        """
        rates = _column("psid", psid), _column("psidd", psidd)
        return self.robot.acceleration(_column("psi", psi), *rates, body1)

    def motion(self, q: ArrayLike, v: ArrayLike | None = None, a: ArrayLike | None = None) -> MotionTuple:
        """Convert Pinocchio's q, v and a to the tuple (body1, psi, psid, psidd).

        Args:
            q: configuration; shape (..., 8); its quaternion may have any length but zero.
            v: velocity; shape (..., 7).
            a: spatial acceleration; shape (..., 7); needs v.

        Returns:
            Vectors in world axes, accelerations classical. Rates are None without v, accelerations without a.
        """
        if a is not None and v is None:
            raise ArgumentError("v", "the velocity that belongs to a", None)
        state = read_state(PINOCCHIO, q, v, True, 1, [])
        body1 = cast(BodyMotion, state.base_motion)
        psi, psid, psidd = state.q[..., 0], None if state.qd is None else state.qd[..., 0], None
        if a is not None:  # a spatial acceleration is turned as a velocity
            spatial = read_state(PINOCCHIO, q, a, True, 1, [])
            of_base, psidd = cast(BodyMotion, spatial.base_motion), cast(Any, spatial.qd)[..., 0]
            with np.errstate(all="ignore"):
                a1 = np.asarray(of_base.v) + np.cross(np.asarray(body1.omega), np.asarray(body1.v))
            body1 = replace(body1, a=a1, alpha=of_base.omega)
        return body1, psi, psid, psidd


def _column(name: str, values: ArrayLike) -> Float64Array:
    return real_array(name, values).astype(np.float64)[..., None]


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
        - `.motion(q, v, a)`: the tuple (body1, psi, psid, psidd), converted back from Pinocchio's q, v and a.

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
    return robot_twin(pair) if isinstance(pair, Mechanism) else pair_twin(pair)


def pair_twin(pair: HingePair) -> PairTwin:
    """Build a pair as a Pinocchio model, whose free-flyer is body 1."""
    check_pair(pair)
    check_single_pair(pair)
    tree = tree_of_pair(pair)
    tree = replace(tree, links={}, frames={**tree.links, **tree.frames})
    twin = tree_twin(tree, is_free=True, has_free_flyer=True)
    return PairTwin(twin.model, twin.data, int(twin.model.getFrameId("body2")), twin)


def robot_twin(robot: Mechanism, *, has_free_flyer: bool | None = None) -> Twin:
    """Build a robot as a Pinocchio model; unless given, its base is a free-flyer if that of the robot is "free"."""
    is_free = robot.base == "free"
    return tree_twin(tree_of(robot).plain(), is_free, is_free if has_free_flyer is None else has_free_flyer)


def data_of(model: Any) -> Any:
    """Return Pinocchio's data of a model; refuse one for which the memory does not suffice."""
    try:
        return model.createData()
    except MemoryError:
        expected = "fewer joints, since Pinocchio's data grow with the cube of their number"
        raise ArgumentError("robot", expected, f"{model.nv} coordinates") from None


def tree_twin(tree: Tree, is_free: bool, has_free_flyer: bool) -> Twin:
    """Build a robot as a Pinocchio model, without the mass of a fixed base, which has no effect."""
    pin = import_pinocchio("to_pinocchio")
    model = pin.Model()
    model.name = tree.name
    root = 0
    if has_free_flyer:
        names = {joint.name for joint in tree.joints}
        flyer = "root_joint" if "root_joint" not in names else max(names, key=len) + "_root"
        root = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), flyer)
    for joint in tree.joints:
        kind = KINDS[joint.kind]
        axis = (np.array(joint.n), joint.pitch) if kind.has_pitch else (np.array(joint.n),)
        placement = pin.SE3(np.array(joint.S), np.array(joint.u))
        limits = [np.array([value]) for value in (joint.effort_limit, joint.rate_limit, *joint.position_limits)]
        own = getattr(pin, kind.pinocchio)(*axis)
        number = model.addJoint(root + joint.parent, own, placement, joint.name, *limits)
        column = model.joints[number].idx_v
        model.lowerVelocityLimit[column] = -joint.rate_limit  # Pinocchio drops the sign
        model.lowerEffortLimit[column], model.upperEffortLimit[column] = joint.effort_bounds
        model.addJointFrame(number)
        model.armature[column] = joint.armature
    for kind, frames in ((pin.FrameType.BODY, tree.links), (pin.FrameType.OP_FRAME, tree.frames)):
        for name, frame in frames.items():
            model.addFrame(pin.Frame(name, root + frame.body, pin.SE3(np.array(frame.S), np.array(frame.R)), kind))
    base = tree.base if is_free else ZERO_MASS_PROPERTIES
    # After all frames, because addFrame rounds the masses.
    for number, masses in enumerate((base, *(joint.body for joint in tree.joints)), root):
        inertia = pin.Inertia.Zero()  # the constructor refuses inertias that no rigid body has
        inertia.mass, inertia.lever = masses.mass, np.array(masses.centre_of_mass)
        inertia.inertia = np.array(masses.inertia)
        model.inertias[number] = inertia
    return Twin(model, data_of(model), has_free_flyer, *joint_rules(tree))


def joint_rules(tree: Tree) -> tuple[Float64Array, Float64Array]:
    """Return the ratios (joints, dof) and offsets (joints,) by which the positions of all joints follow from q."""
    columns = {joint.name: column for column, joint in enumerate(tree.coordinates)}
    ratios, offsets = np.zeros((len(tree.joints), len(columns))), np.zeros(len(tree.joints))
    for row, joint in enumerate(tree.joints):
        ratios[row, columns[joint.rule.leader]], offsets[row] = joint.rule[1:]
    return ratios, offsets


def with_base(matrix: Float64Array) -> Float64Array:
    """Return matrices of joints, (..., m, n), with those of the base before them, (..., 6 + m, 6 + n)."""
    found = np.zeros((*matrix.shape[:-2], 6 + matrix.shape[-2], 6 + matrix.shape[-1]))
    found[..., :6, :6], found[..., 6:, 6:] = np.eye(6), matrix
    return found


# ---- the model that Pinocchio makes of the URDF from which a robot was read
#
# Nothing of the robot's own description goes into the model: Pinocchio reads the text, and the rules of mimic joints
# are read here. Joints that the robot holds keep their coordinate there, at a constant position.


def urdf_twin(robot: Mechanism) -> tuple[Twin, str, tuple[str, ...]]:
    """Return a Twin with a free-flyer, what its model is, as a phrase, and names of joints that only one of the two
    has. The model is Pinocchio's reading of the URDF; where there is no such text, it is made of the robot. The mass
    of a fixed base, and of what is held on it, has no effect and is left out.
    """
    source, pin = tree_of(robot).source, import_pinocchio("cross_validate")
    why = "it was not read from a URDF, or was changed afterwards"
    if source is not None and source.snap:
        why = f"snap={source.snap:g} changed angles of the URDF"
    elif source is not None:
        root = ET.fromstring(source.text)
        floating = any(joint.get("type") == "floating" for joint in root.findall("joint"))
        flyer = () if floating else (pin.JointModelFreeFlyer(),)
        try:
            model = pin.buildModelFromXML(ET.tostring(root, encoding="unicode"), *flyer)
        except ValueError:
            why = "Pinocchio cannot read its URDF"
        else:
            return _twin_of_reading(model, robot, _mimic_rules(root), source.locked)
    return (
        robot_twin(robot, has_free_flyer=True),
        f"a model built from the robot as hingepair holds it, since {why}",
        (),
    )


def _twin_of_reading(
    model: Any, robot: Mechanism, rules: Mapping[str, _Rule], locked: Mapping[str, float]
) -> tuple[Twin, str, tuple[str, ...]]:
    """Return what `urdf_twin` does, of a model that Pinocchio has read."""
    pin = import_pinocchio("cross_validate")
    model.jointPlacements[1] = pin.SE3.Identity()  # of a floating root joint
    inertias, known = [inertia.copy() for inertia in model.inertias], {frame.name for frame in model.frames}
    for name, frame in tree_of(robot).frames.items():  # those that were added to the robot after it was read
        if name not in known:
            placement = pin.SE3(np.array(frame.S), np.array(frame.R))
            model.addFrame(pin.Frame(name, 1 + frame.body, placement, pin.FrameType.OP_FRAME))
    names, columns = list(model.names)[2:], list(robot.names)
    ratios, offsets, missing = np.zeros((len(names), robot.dof)), np.zeros(len(names)), set[str]()
    for row, name in enumerate(names):
        leader, ratio, offsets[row] = name, 1.0, 0.0
        while leader not in locked and rules.get(leader, ("",))[0] in names:
            leader, multiplier, offset = rules[leader]
            offsets[row] += ratio * offset
            ratio *= multiplier
        if leader in locked:
            offsets[row] += ratio * locked[leader]
        elif leader in columns:
            ratios[row, columns.index(leader)] = ratio
        elif ratio:
            missing.add(leader)
    missing |= {name for name, column in zip(columns, ratios.T, strict=True) if not column.any()}
    for number in range(1, model.njoints):  # addFrame rounds the masses
        moves = robot.base == "free" or any(ratios[joint - 2].any() for joint in model.supports[number] if joint > 1)
        model.inertias[number] = inertias[number] if moves else pin.Inertia.Zero()
    return Twin(model, data_of(model), True, ratios, offsets), "Pinocchio's reading of the URDF", (*missing,)


def _mimic_rules(root: ET.Element) -> dict[str, _Rule]:
    """Return, by name of a joint that follows another, the name of that joint, the ratio and the offset."""
    mimics = {joint.get("name", ""): joint.find("mimic") for joint in root.findall("joint")}
    return {
        name: (mimic.get("joint", ""), float(mimic.get("multiplier", 1)), float(mimic.get("offset", 0)))
        for name, mimic in mimics.items()
        if mimic is not None
    }
