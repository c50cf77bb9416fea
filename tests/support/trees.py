"""Robots for tests: records of Pinocchio's models, and models made at random, with joints of every kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin

import hingepair as hp
from hingepair.formats.robots import robot_urdf
from hingepair.mechanism.mechanism import tree_of
from hingepair.urdf.records import MimicRecord


class Robot(hp.Mechanism):
    """A robot of a record."""

    __slots__ = ()

    def __init__(self, tree, base="fixed"):
        object.__setattr__(self, "_tree", tree)
        object.__setattr__(self, "base", base)


def weightless(pairs):
    """The robot of pairs in which bodies whose mass was never given have none, as links of a URDF."""
    return Robot(replace(tree_of(hp.Mechanism(pairs)), without_mass={}))


def urdf_model(robot):
    """The model of a robot of example-robot-data, its joints with two coordinates (cos, sin) held."""
    full = pin.buildModelFromUrdf(str(robot_urdf(robot)))
    held = [k for k in range(1, full.njoints) if full.joints[k].nq != 1]
    return pin.buildReducedModel(full, held, pin.neutral(full))


def random_model(seed, joints=7):
    """A tree of hinges along and across the axes, and of sliders, with branches, frames and a base that has mass."""
    rng = np.random.default_rng(seed)
    pin.seed(seed)  # or its Random would depend on the tests before
    model = pin.Model()
    model.appendBodyToJoint(0, body(rng), pin.SE3.Identity())
    for k in range(joints):
        axis = [np.eye(3)[k % 3] * (-1) ** k, unit(rng)][k % 4 == 3]
        kind = pin.JointModelPrismaticUnaligned if k % 3 == 1 else pin.JointModelRevoluteUnaligned
        parent = 0 if k in {0, joints - 2} else int(rng.integers(1, k + 1)) if k % 2 else k
        place = pin.SE3.Random() if k % 2 else pin.SE3(np.eye(3), rng.uniform(-1, 1, 3))
        # depth-first: a joint may only follow on the branch that was made last
        while parent and parent != k and not below(model, k, parent):
            parent = model.parents[parent]
        number = model.addJoint(parent, kind(axis), place, f"joint_{k}")
        model.appendBodyToJoint(number, body(rng), pin.SE3.Identity())
        model.addFrame(pin.Frame(f"link_{k}", number, 0, pin.SE3.Random(), pin.FrameType.BODY))
    return model


def below(model, joint, ancestor):
    """Whether a joint is carried by another."""
    while joint and joint != ancestor:
        joint = model.parents[joint]
    return joint == ancestor


def unit(rng):
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def body(rng):
    A = rng.normal(size=(3, 3)) * 0.4
    return pin.Inertia(rng.uniform(0.5, 3), rng.uniform(-0.3, 0.3, 3), inertia_of(A @ A.T))


def inertia_of(N):
    """The inertia of a body with second moments N."""
    return np.trace(N) * np.eye(3) - N


def record_of(model):
    return tree_of(hp.Mechanism.from_pinocchio(model))


def with_mimics(tree, rules):
    """The record where joints follow others: by name of the follower, (leader, multiplier, offset)."""
    joints = (replace(one, mimic=MimicRecord(*rules[one.name])) if one.name in rules else one for one in tree.joints)
    return replace(tree, joints=tuple(joints))


def on_free_base(model):
    """The same robot behind a free-flyer."""
    free = pin.Model()
    root = free.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root")
    base = free.addFrame(pin.Frame("base", root, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    return pin.appendModel(free, model, base, pin.SE3.Identity())


def base_motion(rng, shape=()):
    """A base that moves."""
    R, v, omega, a, alpha = rng.normal(size=(5, *shape, 3))
    return hp.BodyMotion(R=R, S=hp.rotation_exp(rng.normal(size=(*shape, 3))), v=v, omega=omega, a=a, alpha=alpha)


def pinocchio_state(base, q, qd, qdd):
    """(q, v, a) of a free-flyer and joints, of one sample."""
    quat = pin.Quaternion(np.array(base.S)).coeffs()
    back = base.S.T
    velocity = [back @ base.v, back @ base.omega]
    change = [back @ (base.a - np.cross(base.omega, base.v)), back @ base.alpha]
    return np.concatenate([base.R, quat, q]), np.concatenate([*velocity, qd]), np.concatenate([*change, qdd])
