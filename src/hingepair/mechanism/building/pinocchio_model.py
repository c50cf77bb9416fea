"""The reader of Pinocchio models."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from typing import Any, Literal

import numpy as np

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.body import DynamicsWarning
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.building.folding import (
    JointPart,
    chosen_base,
    effort_fields,
    fold_parts,
    limit_or_infinity,
    written_joint,
)
from hingepair.mechanism.joints import JointKind
from hingepair.mechanism.options import DEFAULT_GRAVITY
from hingepair.mechanism.tree import Tree, unused_name
from hingepair.numeric.arrays import Float64Array
from hingepair.numeric.unit_vectors import unit_axis
from hingepair.urdf.records import MimicRecord
from hingepair.urdf.rigid import IDENTITY_POSE, FramePose, MassProperties, exact_quarter_turns

_COMPOSITE = "JointModelComposite"
_KINDS: Mapping[str, JointKind] = {  # by the name of Pinocchio's type
    **{f"JointModel{name}{axis}": "hinge" for name in ("R", "RUB") for axis in "XYZ"},
    **dict.fromkeys(("JointModelRevoluteUnaligned", "JointModelRevoluteUnboundedUnaligned"), "hinge"),
    **{f"JointModelP{axis}": "slider" for axis in "XYZ"},
    "JointModelPrismaticUnaligned": "slider",
    **{f"JointModelH{axis}": "screw" for axis in "XYZ"},
    "JointModelHelicalUnaligned": "screw",
}


def tree_of_pinocchio(model: Any, base: str | None, locked: Mapping[str, float] | None) -> tuple[Tree, str]:
    """Return the tree of a Pinocchio model, and the kind of its base, as `Mechanism.from_pinocchio` describes."""
    own, parts = _parts(model)
    return fold_parts(model.name or "model", parts, locked), chosen_base(base, own)


def _parts(model: Any) -> tuple[Literal["fixed", "free"], list[JointPart]]:
    """Return the kind of the base, and the parts: the base, then the joints.

    A free-flyer at the root is a free base; the links that stand in the world beside it are left out. A joint that is
    a chain of joints, as a body with several joints of MJCF has it, is as many joints, `name_1`, `name_2`, ...
    """
    if not all(hasattr(model, name) for name in ("jointPlacements", "inertias", "frames", "parents")):
        raise ArgumentError("model", "a model of Pinocchio", quoted(model))
    free = model.njoints > 1 and model.joints[1].shortname() == "JointModelFreeFlyer"
    root = 1 if free else 0
    if free and np.any(model.armature[:6]):
        expected = "0: the base has no motor (model.armature[:6] = 0 leaves it out)"
        raise ArgumentError(f"joint {model.names[root]!r}, armature", expected, model.armature[:6].tolist())
    if not np.array_equal(model.gravity.linear, DEFAULT_GRAVITY):
        message = f"the model's gravity {model.gravity.linear.tolist()} is not the robot's: methods take gravity="
        warnings.warn(message, DynamicsWarning, stacklevel=4)
    bodies = _BodyContents(model)
    names = {*model.names}
    numbers = {root: 0}  # number of the part of each joint's body, by the joint's number
    parts = [bodies.fill(JointPart(written_joint("")), root)]
    for joint in range(root + 1, model.njoints):
        parent = int(model.parents[joint])
        if parent not in numbers:
            raise _unsupported_joint_error(model, joint, "a joint that the free base carries")
        if joint > root + 1 and parent not in [*model.supports[joint - 1]]:  # which holds the joint itself, too
            raise _unsupported_joint_error(
                model, joint, f"its place right behind what {model.names[parent]!r} carries, depth-first"
            )
        parts += _parts_of_joint(model, joint, numbers[parent], len(parts), names)
        bodies.fill(parts[-1], joint)
        numbers[joint] = len(parts) - 1
    return ("free" if free else "fixed"), parts


def _unsupported_joint_error(model: Any, joint: int, expected: str) -> ArgumentError:
    """Return the error for a joint of another kind than `expected`."""
    return ArgumentError(f"joint {model.names[joint]!r}", expected, model.joints[joint].shortname())


def _parts_of_joint(model: Any, number: int, parent_part: int, first_part: int, names: set[str]) -> list[JointPart]:
    """Return a joint as parts numbered from `first_part`: several of a chain, whose last carries the body."""
    joint, name, parts = model.joints[number], model.names[number], list[JointPart]()
    idx_q, idx_v, is_chain = joint.idx_q, joint.idx_v, joint.shortname() == _COMPOSITE
    for single, seat in _chain(joint, _convert_placement(model.jointPlacements[number])):
        own = unused_name(f"{name}_{len(parts) + 1}", names) if is_chain else name
        carrier = first_part + len(parts) - 1 if parts else parent_part
        parts.append(_part_of_joint(model, single, own, number, carrier, seat, idx_q, idx_v))
        idx_q, idx_v = idx_q + single.nq, idx_v + single.nv
    if is_chain:
        parts[-1].frames[name] = IDENTITY_POSE
    return parts


def _chain(joint: Any, seat: FramePose) -> Iterator[tuple[Any, FramePose]]:
    """Yield the joints of which a joint is a chain, each with its place in the one before; `seat` is the first's."""
    if joint.shortname() != _COMPOSITE:
        yield joint, seat
        return
    own = joint.extract() if hasattr(joint, "extract") else joint
    for single, inner in zip(own.joints, own.jointPlacements, strict=True):
        yield from _chain(single, seat.placed(_convert_placement(inner)))
        seat = IDENTITY_POSE


def _part_of_joint(
    model: Any, joint: Any, name: str, joint_number: int, parent_part: int, pose: FramePose, idx_q: int, idx_v: int
) -> JointPart:
    """Return a joint, or one of a composite joint, as a part that another carries."""
    name_of_kind = joint.shortname()
    kind = _KINDS.get(name_of_kind)
    if kind is None and name_of_kind != "JointModelMimic":
        raise _unsupported_joint_error(
            model, joint_number, "a revolute, prismatic, helical or mimic joint, or a free-flyer at the root"
        )
    motion = np.ravel(joint.createData().S)
    pitch = 0.0
    if kind == "screw":
        own = joint.extract() if hasattr(joint, "extract") else joint
        axis = own.axis if hasattr(own, "axis") else np.eye(3)["XYZ".index(name_of_kind[-1])]
        motion, pitch = np.concatenate([np.zeros(3), axis]), float(own.pitch)
    if kind is None:
        mimic = joint.extract()
        if mimic.scaling == 0:
            raise _unsupported_joint_error(model, joint_number, "a mimic joint that moves")
        followed = (one.nq > 0 and one.idx_q == joint.idx_q for one in [*model.joints][1:])
        leader = model.names[1 + [*followed].index(True)]
        kind_of_mimic: JointKind = "hinge" if motion[3:].any() else "slider"
        follower = written_joint(name, kind_of_mimic, parent_part, pose, _unit_axis(motion / mimic.scaling))
        return JointPart(follower, MimicRecord(leader, mimic.scaling, mimic.offset))
    limits = None
    if joint.nq == 1:
        lower, upper = float(model.lowerPositionLimit[idx_q]), float(model.upperPositionLimit[idx_q])
        limits = (lower, upper) if lower < upper or lower == upper != 0 else None  # 0 and 0 are none, as in URDF
    armature = float(model.armature[idx_v])
    if not 0 <= armature < np.inf:
        raise ArgumentError(f"joint {name!r}, armature", "a finite number that is not below 0", armature)
    least, most = float(model.lowerEffortLimit[idx_v]), float(model.upperEffortLimit[idx_v])
    least = least if least <= 0 and least < most else -most  # above 0 where a model never had one
    try:
        load = HingeLoad(damping=model.damping[idx_v], friction=model.upperDryFrictionLimit[idx_v])
    except ArgumentError as error:
        raise error.renamed(f"joint {name!r}, {error.name}") from None
    own_joint = written_joint(
        name, kind, parent_part, pose,
        _unit_axis(motion), limits, rate_limit=limit_or_infinity(model.upperVelocityLimit[idx_v]),
        **effort_fields(least, most), armature=armature, load=load, pitch=pitch, continuous=joint.nq == 2,
    )  # fmt: skip
    return JointPart(own_joint)


def _unit_axis(motion: Float64Array) -> Float64Array:
    """Return the direction of the angular part of a motion subspace, or of the linear one if that is 0."""
    return unit_axis("axis", motion[3:] if motion[3:].any() else motion[:3])


class _BodyContents:
    """Links, further frames and mass properties of the bodies of a model, by the number of the body's joint."""

    def __init__(self, model: Any) -> None:
        self._model, self._parents = model, {*map(int, model.parents)}
        self._links, self._frames = ([dict[str, FramePose]() for _ in range(model.njoints)] for _ in range(2))
        self._carrying: set[str] = set()  # names of the links that carry others
        others: dict[str, Any] = {}
        frames = [*model.frames]
        for frame in frames[1:]:
            is_link, pose = frame.type.name == "BODY", _convert_placement(frame.placement)
            if not is_link:
                first = others.setdefault(frame.name, frame)
                if first.parentJoint != frame.parentJoint or not first.placement.isApprox(frame.placement):
                    raise ArgumentError(f"frame {frame.name!r}", "one place for frames of one name", "two places")
            if frame.type.name != "JOINT":
                (self._links if is_link else self._frames)[frame.parentJoint][frame.name] = pose
            above = frames[frame.parentFrame]
            while is_link and above.parentFrame > 0 and above.type.name != "BODY":
                above = frames[above.parentFrame]
            if is_link and above.type.name == "BODY":
                self._carrying.add(above.name)

    def fill(self, part: JointPart, joint: int) -> JointPart:
        """Return the part of a joint with its body."""
        links, body = self._links[joint], self._model.inertias[joint]
        leaves = [link for link in links if link not in self._carrying]
        if not links:
            name = unused_name(self._model.names[joint], {name for own in self._links for name in own})
            links, leaves = {name: IDENTITY_POSE}, [] if joint in self._parents else [name]
        part.links, part.leaves = links, leaves
        part.frames |= self._frames[joint]
        masses = MassProperties(float(body.mass), np.array(body.lever), np.array(body.inertia))
        part.masses[next(iter(links))] = masses
        return part


def _convert_placement(placement: Any) -> FramePose:
    """Convert a placement of Pinocchio to a FramePose, with quarter turns that its quaternions rounded made exact."""
    return FramePose(exact_quarter_turns(np.array(placement.rotation)), np.array(placement.translation))
