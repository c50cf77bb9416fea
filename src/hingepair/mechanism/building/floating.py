"""A free base as six joints, for searches that move it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hingepair.mechanism.joints import JointKind
from hingepair.mechanism.tree import Frame, Joint, Tree
from hingepair.numeric.arrays import read_only
from hingepair.urdf.rigid import ZERO_MASS_PROPERTIES

BASE_JOINTS = 6
"""Joints of a base: sliders along x, y and z, then hinges about x, y and z, in the axes in which it starts."""


def tree_with_base_joints(tree: Tree) -> Tree:
    """Return a robot whose base moves by `BASE_JOINTS` coordinates, which stand before its own."""
    zero, axes = read_only(np.zeros(3)), np.eye(3)
    kinds: tuple[JointKind, ...] = ("slider", "slider", "slider", "hinge", "hinge", "hinge")
    base = [
        Joint(
            f"base {kind} {'xyz'[k % 3]}", kind, k, zero, read_only(axes), read_only(axes[k % 3]),
            tree.base if k == BASE_JOINTS - 1 else ZERO_MASS_PROPERTIES,
        )
        for k, kind in enumerate(kinds)
    ]  # fmt: skip
    joints = [
        replace(
            joint,
            parent=joint.parent + BASE_JOINTS,
            mimic=None if joint.mimic is None else joint.mimic._replace(leader=joint.mimic.leader + BASE_JOINTS),
        )
        for joint in tree.plain().joints
    ]
    links, frames = (
        {name: on_moved_base(frame) for name, frame in group.items()} for group in (tree.links, tree.frames)
    )
    return Tree(tree.name, (*base, *joints), ZERO_MASS_PROPERTIES, links, frames, tree.tips)


def on_moved_base(frame: Frame) -> Frame:
    """Return a frame of a robot as one of the robot with joints of the base."""
    return replace(frame, body=frame.body + BASE_JOINTS)
