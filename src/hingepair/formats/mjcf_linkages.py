"""Loops and struts of a robot, written as equalities and tendons of MJCF."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from hingepair.formats.xml_text import add_element
from hingepair.mechanism.bodies.body import warn_of_dynamics
from hingepair.mechanism.tree import Frame, Tree, TreeStrut
from hingepair.numeric.arrays import Float64Array
from hingepair.rotations.matrices import matrix_to_quaternion
from hingepair.urdf.rigid import FramePose


def linkage_frames(tree: Tree) -> Iterator[Frame]:
    """Yield the frames of all loops and struts."""
    for strut in tree.struts:
        yield from strut.frames
    for pair in () if tree.closure is None else tree.closure.frames:
        yield from pair


def add_linkages(
    root: ET.Element,
    equality: ET.Element,
    bodies: Sequence[ET.Element],
    tree: Tree,
    base: str,
    pose: FramePose | None,
) -> list[str]:
    """Add sites, tendons, equalities and a keyframe; return sentences on forces that MJCF cannot hold.

    Args:
        root: the model.
        equality: element of all equalities.
        bodies: element of each body.
        tree: the robot.
        base: "free", "pinned" or "fixed".
        pose: of the base at the start.
    """
    closure, sentences, tendons = tree.closure, list[str](), ET.Element("tendon")
    taken = {*tree.links, *tree.frames, *(joint.name for joint in tree.joints)}

    def site(name: str, frame: Frame, own: str = "", along: float = 0.0) -> str:
        """Return the name of a site at a frame, or farther along its z axis: `own` if that is one, or a new one."""
        if own in tree.frames and own not in tree.links:
            return own
        while name in taken:
            name += "_"
        taken.add(name)
        turn = matrix_to_quaternion(frame.S)
        add_element(bodies[frame.body], "site", name=name, pos=frame.R + along * frame.S[:, 2], quat=turn)
        return name

    def tendon(name: str, ends: tuple[str, str], frames: tuple[Frame, Frame], **attributes: Any) -> None:
        """Add a tendon straight from one frame to another."""
        element = add_element(tendons, "spatial", name=name, **attributes)
        for k, (end, frame) in enumerate(zip(ends, frames, strict=True), 1):
            add_element(element, "site", site=site(f"{name}_{k}", frame, end))

    for strut in tree.struts:
        attributes, left_out = _tendon_of(strut)
        tendon(strut.name, strut.ends, strut.frames, **attributes)
        if left_out:
            sentence = f"MJCF cannot hold the force of strut {strut.name}: {left_out} is left out"
            sentences.append(sentence)
            warn_of_dynamics(sentence)
    loops = [] if closure is None else [*zip(closure.loops, closure.frames, strict=True)]
    for loop, frames in loops:
        name, ends = str(loop.name), (loop.frame1, loop.frame2)
        if loop.kind == "distance":
            if name in {strut.name for strut in tree.struts}:  # whose length is a coordinate
                continue
            tendon(name, ends, frames)
            longer = loop.length - _distance(tree, frames)  # than at q = 0, from where MuJoCo counts
            add_element(equality, "tendon", name=name, tendon1=name, polycoef=(longer, 0, 0, 0, 0))
            continue
        sites = [site(f"{name}_{k}", *pair) for k, pair in enumerate(zip(frames, ends, strict=True), 1)]
        tag = "weld" if loop.kind == "weld" else "connect"
        add_element(equality, tag, name=name, site1=sites[0], site2=sites[1])
        if loop.kind == "hinge" and closure is not None:
            axis = [site(f"{name}_axis_{k}", frame, along=closure.size) for k, frame in enumerate(frames, 1)]
            add_element(equality, "connect", name=f"{name}_axis", site1=axis[0], site2=axis[1])
    root.extend([tendons] if len(tendons) else [])
    if closure is not None:
        add_element(add_element(root, "keyframe"), "key", name="assembled", qpos=_assembled(tree, base, pose))
    return sentences


def _tendon_of(strut: TreeStrut) -> tuple[dict[str, Any], str]:
    """Return the attributes of a tendon, and what of the strut's force it cannot hold."""
    law, attributes = strut.law, dict[str, Any]()
    rest = [] if strut.function is None else ["a function"]
    if law.slope < 0:
        attributes |= {"stiffness": -law.slope, "springlength": -law.at_zero / law.slope}
    elif law.slope or law.at_zero:
        rest.append("what does not fall with the length")
    if law.knots or law.terms:
        rest.append("what is not linear in the length")
    attributes |= {name: value for name, value in (("damping", law.damping), ("frictionloss", law.friction)) if value}
    if np.isfinite(strut.limits).all():
        attributes |= {"limited": "true", "range": strut.limits}
    return attributes, " and ".join(rest)


def _distance(tree: Tree, frames: tuple[Frame, Frame]) -> float:
    """Return the distance between two frames at q = 0 [m]."""
    poses = [FramePose(np.eye(3), np.zeros(3))]
    for joint in tree.joints:
        poses.append(poses[joint.parent].placed(FramePose(np.array(joint.S), np.array(joint.u))))
    first, second = (poses[frame.body].origin + poses[frame.body].rotation @ frame.R for frame in frames)
    return float(np.linalg.norm(second - first))


def _assembled(tree: Tree, base: str, pose: FramePose | None) -> Float64Array:
    """Return qpos where the loops were assembled."""
    of_base: list[Any] = []
    if base != "fixed":
        of_base = [np.zeros(3) if pose is None else pose.origin] if base == "free" else []
        of_base.append(
            (1.0, 0.0, 0.0, 0.0) if pose is None or base != "free" else matrix_to_quaternion(pose.rotation)
        )
    values: dict[str, float] = {} if tree.closure is None else {**tree.closure.assembled}
    for joint in tree.joints:
        if (rule := joint.mimic) is not None:
            values[joint.name] = rule.multiplier * values[tree.joints[rule.leader - 1].name] + rule.offset
    return np.concatenate([*of_base, [values[joint.name] for joint in tree.joints]])
