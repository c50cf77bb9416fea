"""Seven joints against 60-digit arithmetic: no error is beyond its bound, nor beyond a few u times the scale."""

from __future__ import annotations

import functools
from dataclasses import replace

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS
from hingepair.mechanism.mechanism import tree_of
from hingepair.urdf.rigid import ZERO_MASS_PROPERTIES
from hingepair.validation.scales import Scales
from support import states
from support.exact import LETTERS, Exact
from support.trees import Robot, random_model, record_of
from support.truths import largest_errors

U = 2.0**-53
SEEN = 2.0
"""Largest error in units of u * scale, in which the roundings of all joints add up."""
LINKS = {"panda": ("panda_link3", "panda_link7", "panda_link8"), "oblique": ("link_2", "link_6")}
GRAVITY = (1.5, -2.0, -9.0)
HARD = {
    "ordinary": (3, 1, 1),
    "angles past 2^53": (1e17, 1, 1),
    "angles of 1e300": (1e300, 1, 1),
    "tiny": (1e-9, 1e-9, 1e-9),
    "nothing but tiny": (1e-160, 1e-160, 1e-160),
    "quick": (3, 1e4, 1e8),
    "sudden": (3, 1e-6, 1e6),
    "still": (3, 0, 0),
}


@functools.cache
def robot_of(name, base):
    """Panda, its fingers held, or joints along any axes; every placement is a rotation to the last bit."""
    if name == "panda":
        robot = hp.load_robot("panda", base=base, locked={"panda_finger_joint1": 0.02}, snap=1e-6)
    else:
        robot = Robot(exactly_turned(record_of(random_model(4, 7))), base)
    assert all(np.isin(joint.S, (-1.0, 0.0, 1.0)).all() for joint in tree_of(robot).joints)
    return robot


def exactly_turned(tree):
    """The record with quarter turns from body to body: other matrices of doubles are rotations to rounding only."""
    rng = np.random.default_rng(3)
    quarters = [np.roll(np.eye(3), int(rng.integers(3)), axis=0) * rng.choice((-1, 1), 3) for _ in tree.joints]
    turns = [S * np.linalg.det(S) + 0.0 for S in quarters]
    return replace(tree, joints=tuple(replace(j, S=S) for j, S in zip(tree.joints, turns, strict=True)))


@functools.cache
def case(name, base, sizes, count=2):
    """The robot, its coordinates, the motion of its base, and the truth; sliders shift by a metre at most."""
    robot, rng = robot_of(name, base), states.generator(800, count)
    slides = np.array([joint.kind == "slider" for joint in tree_of(robot).joints])
    coordinates = [rng.uniform(-1, 1, (count, len(slides))) * size for size in sizes]
    coordinates[0][:, slides] = rng.uniform(-1, 1, (count, slides.sum()))
    given = dict(zip(LETTERS, states.body1(rng, count), strict=True))
    given["S"] = np.stack([np.array(((0, 0, 1), (1, 0, 0), (0, 1, 0)), float)] * count)  # a rotation to the last bit
    motion = hp.BodyMotion(**given)
    return robot, coordinates, motion, exact(robot, *coordinates, motion)


def exact(robot, q, qd, qdd, motion, gravity=GRAVITY):
    given = {"q": q, "qd": qd, "qdd": qdd} | {letter: getattr(motion, letter) for letter in LETTERS}
    return Exact(tree_of(robot), None, robot.base == "free", given, gravity)


def check(name, got, truth, axes, bound, scale):
    """Hold errors against the rigorous bounds, and against u * scale."""
    found = largest_errors(got, truth, axes)
    assert (found <= bound + 1e-50 * scale).all(), (name, found, bound)  # the truth itself has sixty digits
    assert (found <= SEEN * U * scale).all(), (name, found, U * scale)


def scales_of(robot, coordinates, motion):
    tree = tree_of(robot) if robot.base == "free" else replace(tree_of(robot), base=ZERO_MASS_PROPERTIES)
    return Scales(tree, coordinates, motion, np.array(GRAVITY))


@functools.cache
def motion_bounds(arm, sizes):
    """Bounds on what either backend gives."""
    robot, coordinates, motion, _ = case(arm, "fixed", sizes)
    return robot.error_bounds(*coordinates, frames=LINKS[arm], base_motion=motion)


@pytest.mark.parametrize("sizes", HARD.values(), ids=HARD)
@pytest.mark.parametrize("backend", ["numpy", pytest.param("compiled", marks=pytest.mark.slow)])
@pytest.mark.parametrize("arm", LINKS)
def test_motion_is_within_its_bounds(arm, sizes, backend):
    robot, coordinates, motion, truth = case(arm, "fixed", sizes)
    state = robot.forward_kinematics(*coordinates, frames=LINKS[arm], base_motion=motion, backend=backend)
    bounds = motion_bounds(arm, sizes)
    scales = scales_of(robot, coordinates, motion)
    for k, link in enumerate(LINKS[arm]):
        frame = tree_of(robot).links[link]
        wanted, scale = truth.motion_of(frame), scales.motion(frame)
        for name in (*LETTERS, "d"):
            got, own = getattr(state, name)[:, k], scale.get(name, scale["R"])
            check(name, got, wanted[name], 2 if name == "S" else 1, bounds[name][:, k], own)


@functools.cache
def force_bounds(arm, base, sizes):
    """Bounds on what either backend gives."""
    robot, coordinates, motion, _ = case(arm, base, sizes)
    names = ("force1", "torque1", "tau")
    return robot.error_bounds(*coordinates, outputs=names, base_motion=motion, gravity=GRAVITY)


@pytest.mark.slow
@pytest.mark.parametrize("sizes", HARD.values(), ids=HARD)
@pytest.mark.parametrize("base", ["fixed", "free"])
@pytest.mark.parametrize("backend", ["numpy", pytest.param("compiled", marks=pytest.mark.slow)])
@pytest.mark.parametrize("arm", LINKS)
def test_forces_are_within_their_bounds(arm, sizes, base, backend):
    robot, coordinates, motion, truth = case(arm, base, sizes)
    found = robot.inverse_dynamics(*coordinates, base_motion=motion, gravity=GRAVITY, backend=backend)
    names = ("force1", "torque1", "tau")
    bounds = force_bounds(arm, base, sizes)
    of_columns = np.split(scales_of(robot, coordinates, motion).forces(), (3, 6), axis=1)
    scales = {name: x.max(axis=1) for name, x in zip(names, of_columns, strict=True)}
    for name, wanted in zip(names, truth.forces, strict=True):
        check(name, getattr(found, name), wanted, 1, bounds[name], scales[name])


@pytest.mark.slow
def test_forces_of_followers_are_within_their_bounds():
    """Two hands whose fingers follow, on a lift that carries all: Pinocchio's own torques are past these bounds."""
    robot = hp.load_robot("tiago_pro")
    ratios = {joint.mimic.multiplier for joint in tree_of(robot).joints if joint.mimic}
    assert ratios == {1.0, -1.0}  # so that the positions of followers are exact
    rng, count = states.generator(802), 2
    sizes = np.array((3.0, 2.0, 5.0))[:, None, None]
    coordinates = rng.uniform(-1, 1, (3, count, robot.dof)) * sizes
    twin = hp.to_pinocchio(robot)
    assert not twin.offsets.any()
    free = replace(tree_of(robot), joints=tuple(replace(joint, mimic=None) for joint in tree_of(robot).joints))
    each = dict(zip(("q", "qd", "qdd"), coordinates @ twin.ratios.T, strict=True))
    with mpmath.workdps(DIGITS):
        wanted = Exact(free, None, False, each).forces[2] @ twin.ratios
    off = largest_errors(robot.inverse_dynamics(*coordinates).tau, wanted, 1)
    assert (off <= robot.error_bounds(*coordinates, outputs=("tau",))["tau"]).all()


def test_the_reference_conserves_what_it_must():
    """The oracle itself: force1 is the weight and the rate of momentum, whatever the joints do."""
    robot, coordinates, motion, truth = case("panda", "free", HARD["ordinary"])
    with mpmath.workdps(DIGITS):
        force1, _, tau = truth.forces
        mass = sum([tree_of(robot).base.mass, *(joint.body.mass for joint in tree_of(robot).joints)])
        weight = force1 - exact(robot, *coordinates, motion, (0, 0, 0)).forces[0]
        assert np.abs(weight + mass * np.array(GRAVITY)).max() < 512 * U
        assert tau.shape == (2, 7)


@pytest.mark.slow
@pytest.mark.parametrize("sizes", ["ordinary", "quick"])
@pytest.mark.parametrize("base", ["fixed", "free"])
@pytest.mark.parametrize("arm", LINKS)
def test_accelerations_leave_no_more_than_the_bounds_of_forces(arm, sizes, base):
    """What 60 digits need for the accelerations found is what acts, up to the bounds of these forces."""
    robot, (q, qd, _), motion, _ = case(arm, base, HARD[sizes], 1)
    rng = states.generator(803)
    tau, force1, torque1 = (rng.normal(size=(1, n)) * 10 for n in (q.shape[1], 3, 3))
    free = base == "free"
    loads = {"force1": force1, "torque1": torque1} if free else {}
    moves = robot.forward_dynamics(q, qd, tau, base_motion=motion, gravity=GRAVITY, **loads)
    moved = {letter: getattr(motion, letter) for letter in LETTERS} | (
        {"a": moves.a1, "alpha": moves.alpha1} if free else {}
    )
    base_motion = hp.BodyMotion(**moved)
    forces = exact(robot, q, qd, moves.qdd, base_motion).forces
    names = (*loads, "tau")
    bounds = robot.error_bounds(q, qd, moves.qdd, outputs=names, base_motion=base_motion, gravity=GRAVITY)
    for name, needed, acts in zip(names, forces[-len(names) :], (*loads.values(), tau), strict=True):
        off = largest_errors(acts, needed, 1)
        assert (off <= bounds[name]).all(), (name, off, bounds[name])
