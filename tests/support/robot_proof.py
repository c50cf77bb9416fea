"""A robot held against Pinocchio's own reading of its URDF, output by output, at ordinary and hard states.

The way to Pinocchio shares nothing with the library: the model is what `pin.buildModelFromUrdf` makes of the file,
and the rules of joints that follow others are read from the file here. Of the library are the scales alone.
"""

from __future__ import annotations

import functools
import math
import warnings
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin

import hingepair as hp
from hingepair.formats.robots import robot_urdf
from hingepair.mechanism.mechanism import tree_of
from hingepair.validation.scales import Scales
from support import states

U = 2.0**-53
WORLD = pin.LOCAL_WORLD_ALIGNED
MODES = ("fixed", "moving", "free")
"""A base at rest at the origin; one that moves as it is given; one that forces move."""
LETTERS = ("R", "S", "v", "omega", "a", "alpha")


class Reference:
    """Pinocchio's model of a robot's URDF.

    Attributes:
        model: with a free-flyer unless the base is at rest.
        has_free_flyer: whether it has one.
        ratios: rates of the model's joints for those of the joints that follow none; shape (joints, dof).
        offsets: of the positions; shape (joints,).
    """

    def __init__(self, name, mode, names):
        path, self.has_free_flyer = str(robot_urdf(name)), mode != "fixed"
        self.model = pin.buildModelFromUrdf(path, *[pin.JointModelFreeFlyer()] * self.has_free_flyer)
        self.data = self.model.createData()
        own = list(self.model.names)[1 + self.has_free_flyer :]
        rules = {
            joint.get("name"): joint.find("mimic")
            for joint in ET.parse(path).getroot().findall("joint")
            if joint.find("mimic") is not None and joint.find("mimic").get("joint") in own
        }
        self.ratios, self.offsets = np.zeros((len(own), len(names))), np.zeros(len(own))
        for row, joint in enumerate(own):
            ratio, offset, leader = 1.0, 0.0, joint
            while leader in rules:
                rule = rules[leader]
                offset += ratio * float(rule.get("offset", 0))
                ratio *= float(rule.get("multiplier", 1))
                leader = rule.get("joint")
            self.ratios[row, names.index(leader)], self.offsets[row] = ratio, offset

    def joints(self, q, qd, qdd):
        """Positions, rates and accelerations of all joints, (N, joints) each."""
        found = np.zeros((3, len(q), len(self.ratios)))
        for row, ratios in enumerate(self.ratios):  # one at a time, so that angles round as products do
            for column in np.flatnonzero(ratios):
                found[:, :, row] = [part[:, column] * ratios[column] for part in (q, qd, qdd)]
        return found[0] + self.offsets, found[1], found[2]

    def state(self, base, positions, rates, changes):
        """Pinocchio's q, v and a of one sample."""
        q = []
        for joint, position in zip(list(self.model.joints)[1 + self.has_free_flyer :], positions, strict=True):
            q += [position] if joint.nq == 1 else [math.cos(position), math.sin(position)]
        if not self.has_free_flyer:
            return np.array(q), rates.copy(), changes.copy()
        R, S, v, omega, a, alpha = base
        quat_xyzw = pin.Quaternion(np.ascontiguousarray(S)).coeffs()
        v_base = np.r_[S.T @ v, S.T @ omega]
        a_base = np.r_[S.T @ (a - np.cross(omega, v)), S.T @ alpha]
        return np.r_[R, quat_xyzw, q], np.r_[v_base, rates], np.r_[a_base, changes]


def outputs_of(reference, mode, base, state, links, tips):
    """What Pinocchio says at one state."""
    model, data = reference.model, reference.data
    q, v, a = state
    found = {name: [] for name in LETTERS} | {"jacobian": []}
    pin.forwardKinematics(model, data, q, v, a)
    pin.updateFramePlacements(model, data)
    for link in links:
        frame = model.getFrameId(link, pin.FrameType.BODY)
        twist = pin.getFrameVelocity(model, data, frame, WORLD)
        classical = pin.getFrameClassicalAcceleration(model, data, frame, WORLD)
        place = data.oMf[frame]
        values = (place.translation, place.rotation, twist.linear, twist.angular, classical.linear, classical.angular)
        for name, value in zip(LETTERS, values, strict=True):
            found[name].append(value.copy())
    if not model.nv:  # with none, functions of Pinocchio crash
        return {name: np.array(found[name]) for name in LETTERS} | NOTHING
    columns = columns_of(reference, mode, base)
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    for link in tips:
        frame = model.getFrameId(link, pin.FrameType.BODY)
        found["jacobian"].append(pin.getFrameJacobian(model, data, frame, WORLD) @ columns)
    upper = np.triu(pin.crba(model, data, q))
    found["mass_matrix"] = columns.T @ (upper + np.triu(upper, 1).T) @ columns
    found["generalized"] = pin.rnea(model, data, q, v, a) @ columns
    found["gravity_forces"] = pin.computeGeneralizedGravity(model, data, q) @ columns
    if mode != "moving":  # there, the model's energy is also that of the base
        found["kinetic"] = pin.computeKineticEnergy(model, data, q, v)
        found["potential"] = pin.computePotentialEnergy(model, data, q)
        if sum(body.mass for body in list(model.inertias)[1:]):
            momentum = pin.computeCentroidalMomentum(model, data, q, v)
            found["linear"] = momentum.linear.copy()
            found["angular"] = momentum.angular + np.cross(data.com[0], momentum.linear)
    return {name: np.array(value) for name, value in found.items()}


NOTHING = {"jacobian": np.zeros((1, 6, 0)), "mass_matrix": np.zeros((0, 0)), "generalized": np.zeros(0)}
"""What a robot at rest has that has no joint."""


def columns_of(reference, mode, base):
    """Pinocchio's v for (v1, omega1, qd) of a free base, for qd of any other."""
    if not reference.has_free_flyer:
        return reference.ratios
    rows, dof = reference.ratios.shape
    columns = np.zeros((6 + rows, 6 + dof))
    columns[:3, :3] = columns[3:6, 3:6] = base[1].T
    columns[6:, 6:] = reference.ratios
    return columns if mode == "free" else columns[:, 6:]


def samples_of(robot, count, seed):
    """Coordinates and the base's motion at ordinary states and at hard ones: (q, qd, qdd) and a BodyMotion."""
    rng = states.generator(700, seed)
    sizes = [  # of q, qd, qdd, and of the base's motion
        *[(3, 1, 1, 1)] * count, (1e6, 1, 1, 1), (1e15, 1, 1, 1), (1e-9, 1e-9, 1e-9, 1), (1e-160, 1e-160, 1e-160, 1),
        (3, 1e5, 1e8, 1), (3, 1e-5, 1e5, 1), (3, 1, 1, 1e4), (0, 0, 0, 0),
    ]  # fmt: skip
    scale = np.array(sizes, float)
    slides = np.array([joint.kind == "slider" for joint in tree_of(robot).coordinates], dtype=bool)
    coordinates = [rng.uniform(-1, 1, (len(sizes), robot.dof)) * scale[:, [k]] for k in range(3)]
    coordinates[0][:, slides] = rng.uniform(-1, 1, (len(sizes), slides.sum()))
    body1 = dict(zip(LETTERS, states.body1(rng, len(sizes)), strict=True))
    body1 |= {name: body1[name] * scale[:, [3]] for name in ("R", "v", "omega", "a", "alpha")}
    return coordinates, hp.BodyMotion(**body1)


def ratios_of(name, mode, count=3, backend="auto"):
    """The largest difference to Pinocchio of every output, in units of u * scale.

    Of forward dynamics it is that of what the accelerations leave: rnea(aba(tau)) - tau.
    """
    robot = load(name, "free" if mode == "free" else "fixed")
    (q, qd, qdd), base = samples_of(robot, count, len(name))
    moving = {} if mode == "fixed" else {"base_motion": base}
    links, tips = robot.links, robot.tips[:8]
    reference = Reference(name, mode, list(robot.names))
    joints = reference.joints(q, qd, qdd)
    at = [[getattr(base, letter)[i] for letter in LETTERS] for i in range(len(q))]
    pinocchio = [reference.state(at[i], *(part[i] for part in joints)) for i in range(len(q))]
    rows = [outputs_of(reference, mode, at[i], pinocchio[i], links, tips) for i in range(len(q))]
    expected = {output: np.stack([row[output] for row in rows]) for output in rows[0]}
    run = {"backend": backend, **moving}
    state = robot.forward_kinematics(q, qd, qdd, frames=links, **run)
    got = {output: getattr(state, output) for output in LETTERS}
    got["jacobian"] = np.stack([robot.jacobian(q, tip, **run) for tip in tips], axis=1)
    got["mass_matrix"], got["gravity_forces"] = robot.mass_matrix(q, **run), robot.gravity_forces(q, **run)
    energy, momentum = robot.energy(q, qd, **run), robot.momentum(q, qd, **run)
    got |= {"kinetic": energy.kinetic, "potential": energy.potential}
    got |= {"linear": momentum.linear, "angular": momentum.angular}
    forces = robot.inverse_dynamics(q, qd, qdd, **run)
    loads = {"force1": forces.force1, "torque1": forces.torque1} if mode == "free" else {}
    got["generalized"] = np.concatenate((*loads.values(), forces.tau), axis=-1)
    moves = robot.forward_dynamics(q, qd, forces.tau, **loads, **run)
    changes = {"a": np.nan_to_num(moves.a1), "alpha": np.nan_to_num(moves.alpha1)} if mode == "free" else {}
    reached = hp.BodyMotion(**{letter: getattr(base, letter) for letter in LETTERS} | changes)
    got["left"], expected["left"] = left_over(reference, mode, joints, moves.qdd, reached, expected)
    still = hp.BodyMotion(**{letter: np.zeros((len(q), 3)) for letter in LETTERS if letter != "S"}, S=base.S)
    if not robot.dof and mode == "fixed":
        got |= {output: np.zeros_like(expected[output]) for output in NOTHING}
    scales = scales_of(robot, reference, mode, joints, still if mode == "fixed" else base, links, tips)
    after = reference.joints(q, qd, np.nan_to_num(moves.qdd))
    then = scales_of(robot, reference, mode, after, still if mode == "fixed" else reached, links, tips)
    at_rest = scales_of(robot, reference, mode, joints[:1], hp.BodyMotion(R=base.R, S=base.S), links, tips)
    scales["gravity_forces"] = at_rest["generalized"]
    scales["left"] = scales["generalized"] + then["generalized"]
    return {output: ratio(got[output], expected[output], scales[output]) for output in expected}


def left_over(reference, mode, joints, qdd, base, expected):
    """What acts by Pinocchio's rnea at our accelerations, and what acted; zeros where M is singular."""
    got, wanted = np.zeros_like(expected["generalized"]), expected["generalized"].copy()
    changes = reference.joints(qdd, qdd, qdd)[2]
    for i in range(len(qdd)):
        at = [getattr(base, letter)[i] for letter in LETTERS]
        if np.isnan(qdd[i]).any():
            assert is_singular(expected["mass_matrix"][i])
            wanted[i] = 0
        else:
            state = reference.state(at, joints[0][i], joints[1][i], changes[i])
            got[i] = pin.rnea(reference.model, reference.data, *state) @ columns_of(reference, mode, at)
    return got, wanted


def is_singular(matrix):
    size = np.sqrt(np.abs(np.diagonal(matrix)))
    return not size.all() or np.abs(np.linalg.eigvalsh(matrix / size / size[:, None])).min() < 1e-12


def scales_of(robot, reference, mode, joints, base, links, tips):
    """The scale of every output, of shapes that broadcast against them."""
    scales = Scales(tree_of(robot), list(joints), base, np.array((0, 0, -9.81)))
    columns = np.zeros((6 + len(reference.ratios), 6 + robot.dof))
    columns[:6, :6], columns[6:, 6:] = np.eye(6), np.abs(reference.ratios)
    columns = columns if mode == "free" else columns[:, 6:]
    motions = [scales.motion(tree_of(robot).links[link]) for link in links]
    found = {name: np.stack([one[name] for one in motions], axis=1)[..., None] for name in LETTERS}
    found["S"] = found["S"][..., None]
    found["jacobian"] = np.stack([scales.jacobian(tree_of(robot).links[tip]) @ columns for tip in tips], axis=1)
    found["mass_matrix"] = columns.T @ scales.mass_matrix() @ columns
    own = scales.energy_and_momentum()
    found |= {name: own[name] for name in ("kinetic", "potential")}
    found |= {name: own[name][:, None] for name in ("linear", "angular")}
    force, torque = scales.forces()
    slides = np.array([joint.kind == "slider" for joint in tree_of(robot).joints], dtype=bool)
    base_parts = [np.repeat(part[:, :1], 3, axis=1) for part in (force, torque)]
    along = np.where(slides, force[:, 1:], torque[:, 1:])
    found["generalized"] = found["gravity_forces"] = np.concatenate((*base_parts, along), axis=1) @ columns
    return found


def ratio(got, expected, scale):
    """The largest difference in units of u * scale; inf where it is not a number."""
    if not expected.size:
        return 0.0
    smallest = np.finfo(float).tiny / U
    off = np.abs(got.reshape(expected.shape) - expected) / (U * np.maximum(scale, smallest))
    return float(np.where(np.isfinite(off), off, np.inf).max())


@functools.cache
def load(name, base):
    """A robot, without the words on masses and leaders that its file has wrong."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return hp.load_robot(name, base=base)
