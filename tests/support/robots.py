"""Robots as trees, beside Pinocchio's models of them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from hingepair.formats.robots import robot_urdf
from hingepair.mechanism.building.urdf import tree_of_urdf

U = 2.0**-53


def tree_of_file(name, base="fixed", locked=None, snap=None):
    return tree_of_urdf(robot_urdf(name), base, locked, snap)[0]


def check_against_model(tree, model, root):
    """Compare the tree with a model: joints, masses, limits and the frames of links; `root` is the base's joint."""
    assert [joint.name for joint in tree.joints] == list(model.names)[root + 1 :]
    bodies = [tree.base, *(joint.body for joint in tree.joints)]
    for number, joint in enumerate(tree.joints, 1):
        own, placement = model.joints[root + number], model.jointPlacements[root + number]
        assert joint.parent == model.parents[root + number] - root
        assert np.abs(joint.u - placement.translation).max() <= 8 * U * (1 + np.abs(joint.u).max())
        assert np.abs(joint.S - placement.rotation).max() <= 16 * U
        linear, angular = np.split(own.createData().S.ravel(), 2)
        axis, other = (angular, linear) if joint.kind == "hinge" else (linear, angular)
        assert np.abs(joint.n - axis).max() <= 4 * U
        assert not other.any()
        most = model.upperVelocityLimit[own.idx_v], model.upperEffortLimit[own.idx_v]
        assert (joint.rate_limit, joint.effort_limit) == most
        if own.nq == 1 and np.isfinite(joint.position_limits).any():
            limits = model.lowerPositionLimit[own.idx_q], model.upperPositionLimit[own.idx_q]
            assert joint.position_limits == limits
    for body, inertia in zip(bodies, list(model.inertias)[root:], strict=True):
        size = 1 + np.linalg.norm(inertia.lever)
        moment = (inertia.mass + np.abs(inertia.inertia).max()) * size**2
        assert abs(body.mass - inertia.mass) <= 8 * U * inertia.mass
        assert np.abs(body.centre_of_mass - inertia.lever).max() <= 64 * U * size
        assert np.abs(body.inertia - inertia.inertia).max() <= 64 * U * moment
    frames = {frame.name: frame for frame in model.frames if frame.type == pin.FrameType.BODY}
    assert set(tree.links) == set(frames)
    for name, frame in tree.links.items():
        assert frame.body == frames[name].parentJoint - root
        assert np.abs(frame.R - frames[name].placement.translation).max() <= 32 * U
        assert np.abs(frame.S - frames[name].placement.rotation).max() <= 32 * U
