"""Bounds of robots with joints of any kind, axis and placement: no error against 60 digits is beyond its bound."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.mechanism import tree_of
from hingepair.mechanism.robots import constants
from hingepair.mechanism.tree import Frame, Joint, Tree
from hingepair.urdf.rigid import MassProperties
from support import states
from support.exact import Exact
from support.trees import Robot, inertia_of
from support.truths import largest_errors

TRUTH = 1e-50  # error of 60 digits
GRAVITY = (1.5, -2.0, -9.0)
LINKS = ("tip", "middle")
FORCES = ("force1", "torque1", "tau")


def one_of(rng, *values):
    return values[rng.integers(len(values))]


def random_robot(rng, count, base, heavy=False):
    """A chain with axes along and across the body's, placements turned by Euler angles, and masses on the axes."""
    joints = []
    for k in range(count):
        n = one_of(rng, np.eye(3)[rng.integers(3)], states.rotations(rng, 1)[0][0], np.ones(3) / np.sqrt(3))
        turn = one_of(rng, (0, 0, 0), rng.uniform(-3, 3, 3), (0, 0, rng.uniform(-3, 3)))
        u = one_of(rng, rng.uniform(-1, 1, 3), np.array((0, 0, rng.uniform())), np.zeros(3))
        mass = rng.uniform(0.1, 3) if heavy else one_of(rng, *rng.uniform(0.1, 3, 2), 1e-6, 1e3, 0.0)
        A = rng.normal(size=(3, 3)) * 0.3
        inertia = one_of(rng, inertia_of(A @ A.T), np.eye(3) * 0.2, np.eye(3) * heavy)
        centre = one_of(rng, rng.normal(size=3) * 0.3, n * 0.5, np.zeros(3))
        zero = mass == 0
        body = MassProperties(mass, centre * (not zero), (inertia + inertia.T) / 2 * (not zero))
        kind = "slider" if rng.random() < 0.2 else "hinge"
        joints.append(Joint(f"joint_{k}", kind, k, u, np.array(hp.euler_to_matrix(turn)), n, body))
    turn = np.array(hp.euler_to_matrix(rng.uniform(-3, 3, 3)))
    links = {"tip": Frame(count, rng.normal(size=3), turn), "middle": Frame(count // 2, np.zeros(3), np.eye(3))}
    base_body = MassProperties(2.0, rng.normal(size=3), np.eye(3))
    return Robot(Tree("robot", tuple(joints), base_body, links, {}, ("tip",)), base)


def check_robot(robot, coordinates, backend):
    """Motion of both links, and forces."""
    given = dict(zip(("q", "qd", "qdd"), coordinates, strict=True))
    truth = Exact(tree_of(robot), None, robot.base == "free", given, GRAVITY)
    state = robot.forward_kinematics(*coordinates, frames=LINKS, backend=backend)
    bounds = robot.error_bounds(*coordinates, frames=LINKS)
    for k, link in enumerate(LINKS):
        exact = truth.motion_of(tree_of(robot).links[link])
        for name, bound in bounds.items():
            off = largest_errors(getattr(state, name)[:, k], exact[name], 2 if name == "S" else 1)
            assert (off <= bound[:, k] + TRUTH).all(), (link, name, off, bound[:, k])
    forces = robot.inverse_dynamics(*coordinates, gravity=GRAVITY, backend=backend)
    bounds = robot.error_bounds(*coordinates, outputs=FORCES, gravity=GRAVITY)
    for name, exact in zip(FORCES, truth.forces, strict=True):
        off = largest_errors(getattr(forces, name), exact, 1)
        assert (off <= bounds[name] + TRUTH).all(), (name, off, bounds[name])


def check_random(seed, backend):
    rng = states.generator(810, seed)
    robot = random_robot(rng, int(rng.integers(1, 7)), one_of(rng, "fixed", "free"))
    size = 10.0 ** one_of(rng, 0.0, 0.0, rng.uniform(-4, 4))
    check_robot(robot, [rng.normal(size=(2, robot.dof)) * own for own in (2, size, size)], backend)


@pytest.mark.parametrize("seed", range(3))
def test_a_random_robot_keeps_its_bounds(seed):
    check_random(seed, "numpy")


@pytest.mark.proof
@pytest.mark.filterwarnings("ignore::hingepair.DynamicsWarning")
@pytest.mark.parametrize("part", range(20))
def test_random_robots_keep_their_bounds(part):
    for seed in range(25 * part, 25 * part + 25):
        check_random(seed, "compiled" if seed % 5 == 0 else "numpy")


def test_a_mass_on_an_oblique_axis_keeps_its_bound():
    """It moves to the parent (T9), and what stays with its joint is rounding of the size of the whole mass."""
    body = hp.Body(mass=1, centre_of_mass=(0.5, 0.5, 0.5), inertia=(1e-9, 1e-9, 1e-9))
    robot = hp.Mechanism([hp.HingePair((0, 0, 0), (0, 0, 0), (1, 1, 1), body2=body)])
    tau = robot.inverse_dynamics([0.3], [0.0], [0.0]).tau
    assert abs(tau[0]) <= robot.error_bounds([0.3], [0.0], [0.0], outputs=("tau",))["tau"]


def test_integers_above_2_to_the_53_are_off_by_their_rounding():
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (1, 0, 0))
    robot = hp.Mechanism([hp.Slider((0, 0, 0), (0, 0, 0), (1, 0, 0))])
    large = 2**53 + 1
    assert pair.error_bounds(np.array([large, 0, 0, 0, 0, 0, 0]))["R2"] >= 1
    assert robot.error_bounds(np.array([large]))["R"].max() >= 1
    assert robot.error_bounds(np.array([large - 1]))["R"].max() == 0


@pytest.mark.slow
def test_exact_masses_of_long_chains_have_a_bounded_number_of_digits(monkeypatch):
    """Each joint multiplies what its masses hand to the parent: digits would add up, and the first call with them."""
    tree = tree_of(random_robot(states.generator(812), 200, "fixed", heavy=True))
    hinges = tuple(replace(joint, kind="hinge") for joint in tree.joints)
    numbers, plain = [], constants._ten_numbers
    monkeypatch.setattr(constants, "_ten_numbers", lambda moments: numbers.extend(plain(moments)) or plain(moments))
    constants.robot_constants(replace(tree, joints=hinges), False)
    assert max(number.denominator.bit_length() for number in numbers) < 5000
