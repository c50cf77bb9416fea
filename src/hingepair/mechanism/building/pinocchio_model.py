"""The reader of Pinocchio models."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from hingepair.errors import ArgumentError, quoted
from hingepair.mechanism.bodies.hinge_load import HingeLoad
from hingepair.mechanism.building.folding import (
    chosen_base,
    effort_fields,
    fold,
    framed,
    limit_or_infinity,
    warn_of_gravity,
    written_joint,
)
from hingepair.mechanism.kinds import JointKind
from hingepair.mechanism.tree import Frame, Joint, Tree, unused_name
from hingepair.numeric.arrays import Float64Array, number_not_below_0
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
    tree, own = _tree(model)
    return fold(tree, locked), chosen_base(base, own)


def _tree(model: Any) -> tuple[Tree, str]:
    """Return the tree with all joints, and the kind of the base.

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
    warn_of_gravity(model.gravity.linear)
    joints, frames, names = list[Joint](), dict[str, Frame](), {*model.names}
    numbers = {root: 0}  # number of the body that each joint moves, by the number that the joint has in Pinocchio
    for joint in range(root + 1, model.njoints):
        parent = int(model.parents[joint])
        if parent not in numbers:
            raise _unsupported_joint_error(model, joint, "a joint that the free base carries")
        if joint > root + 1 and parent not in [*model.supports[joint - 1]]:  # which holds the joint itself, too
            raise _unsupported_joint_error(
                model, joint, f"its place right behind what {model.names[parent]!r} carries, depth-first"
            )
        joints += _read_joint(model, joint, numbers[parent], len(joints), names)
        joints[-1] = replace(joints[-1], body=_masses(model, joint))
        numbers[joint] = len(joints)
        if joints[-1].name != model.names[joint]:
            frames[model.names[joint]] = framed(len(joints))
    links, leaves, further = _read_frames(model, numbers)
    tree = Tree(model.name or "model", tuple(joints), _masses(model, root), links, {**frames, **further}, leaves)
    return tree, "free" if free else "fixed"


def _unsupported_joint_error(model: Any, joint: int, expected: str) -> ArgumentError:
    """Return the error for a joint of another kind than `expected`."""
    return ArgumentError(f"joint {model.names[joint]!r}", expected, model.joints[joint].shortname())


def _read_joint(model: Any, number: int, parent: int, count: int, names: set[str]) -> list[Joint]:
    """Return a joint behind `count` others: several of a chain, whose last carries the body."""
    joint, name, found = model.joints[number], model.names[number], list[Joint]()
    idx_q, idx_v, is_chain = joint.idx_q, joint.idx_v, joint.shortname() == _COMPOSITE
    for single, seat in _chain(joint, _convert_placement(model.jointPlacements[number])):
        own = unused_name(f"{name}_{len(found) + 1}", names) if is_chain else name
        carrier = count + len(found) if found else parent
        found.append(_read_single(model, single, own, number, carrier, seat, idx_q, idx_v))
        idx_q, idx_v = idx_q + single.nq, idx_v + single.nv
    return found


def _chain(joint: Any, seat: FramePose) -> Iterator[tuple[Any, FramePose]]:
    """Yield the joints of which a joint is a chain, each with its place in the one before; `seat` is the first's."""
    if joint.shortname() != _COMPOSITE:
        yield joint, seat
        return
    own = joint.extract() if hasattr(joint, "extract") else joint
    for single, inner in zip(own.joints, own.jointPlacements, strict=True):
        yield from _chain(single, seat.placed(_convert_placement(inner)))
        seat = IDENTITY_POSE


def _read_single(
    model: Any, joint: Any, name: str, joint_number: int, parent: int, pose: FramePose, idx_q: int, idx_v: int
) -> Joint:
    """Return a joint, or one of a composite joint."""
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
        rule = MimicRecord(leader, mimic.scaling, mimic.offset)
        return written_joint(name, kind_of_mimic, parent, pose, _unit_axis(motion / mimic.scaling), mimic=rule)
    limits = None
    if joint.nq == 1:
        lower, upper = float(model.lowerPositionLimit[idx_q]), float(model.upperPositionLimit[idx_q])
        limits = (lower, upper) if lower < upper or lower == upper != 0 else None  # 0 and 0 are none, as in URDF
    armature = number_not_below_0(f"joint {name!r}, armature", float(model.armature[idx_v]))
    least, most = float(model.lowerEffortLimit[idx_v]), float(model.upperEffortLimit[idx_v])
    least = least if least <= 0 and least < most else -most  # above 0 where a model never had one
    try:
        load = HingeLoad(damping=model.damping[idx_v], friction=model.upperDryFrictionLimit[idx_v])
    except ArgumentError as error:
        raise error.renamed(f"joint {name!r}, {error.name}") from None
    return written_joint(
        name, kind, parent, pose,
        _unit_axis(motion), limits=limits, rate_limit=limit_or_infinity(model.upperVelocityLimit[idx_v]),
        **effort_fields(least, most), armature=armature, load=load, pitch=pitch, continuous=joint.nq == 2,
    )  # fmt: skip


def _unit_axis(motion: Float64Array) -> Float64Array:
    """Return the direction of the angular part of a motion subspace, or of the linear one if that is 0."""
    return unit_axis("axis", motion[3:] if motion[3:].any() else motion[:3])


def _read_frames(
    model: Any, numbers: Mapping[int, int]
) -> tuple[dict[str, Frame], tuple[str, ...], dict[str, Frame]]:
    """Return the links, the leaves among them and further frames of the bodies with these numbers."""
    links, further, others = dict[str, Frame](), dict[str, Frame](), dict[str, Any]()
    carrying = set[str]()  # links that carry others
    frames = [*model.frames]
    for frame in frames[1:]:
        if is_link := frame.type.name == "BODY":
            above = frame.parentFrame
            while frames[above].type.name != "BODY" and frames[above].parentFrame != above:
                above = frames[above].parentFrame
            if frames[above].type.name == "BODY":
                carrying.add(frames[above].name)
            elif above:  # a joint that pin.buildReducedModel held, its own parent: the body's first link carries this
                own = [one.name for one in frames if (one.type, one.parentJoint) == (frame.type, frame.parentJoint)]
                carrying |= {own[0]} - {frame.name}
        else:
            first = others.setdefault(frame.name, frame)
            if first.parentJoint != frame.parentJoint or not first.placement.isApprox(frame.placement):
                raise ArgumentError(f"frame {frame.name!r}", "one place for frames of one name", "two places")
        if frame.type.name != "JOINT" and frame.parentJoint in numbers:
            seat = framed(numbers[frame.parentJoint], _convert_placement(frame.placement))
            (links if is_link else further)[frame.name] = seat
    named, parents = {frame.body for frame in links.values()}, {*map(int, model.parents)}
    for joint, number in numbers.items():
        if number not in named:
            name = unused_name(model.names[joint], {*links})
            links[name] = framed(number)
            if joint in parents:
                carrying.add(name)
    links = dict(sorted(links.items(), key=lambda link: link[1].body))
    return links, tuple(name for name in links if name not in carrying), further


def _masses(model: Any, joint: int) -> MassProperties:
    body = model.inertias[joint]
    return MassProperties(float(body.mass), np.array(body.lever), np.array(body.inertia))


def _convert_placement(placement: Any) -> FramePose:
    """Convert a placement of Pinocchio to a FramePose, with quarter turns that its quaternions rounded made exact."""
    return FramePose(exact_quarter_turns(np.array(placement.rotation)), np.array(placement.translation))
