"""A base that is solved for, frames seen from frames, the centre of mass, single coordinates, one target at a time:
what forward kinematics says of the solutions.
"""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.building.changes import tree_with_base_joints
from hingepair.mechanism.mechanism import tree_of
from support.near import POSE, U

FEET = ("left", "right")
HOME = np.array((0.3, 0.5, 0.4, -0.3, 0.5, 0.4))  # rad
START = hp.BodyMotion.from_rotvec(R=(0.4, -0.2, 1.1), rotvec=(0.2, -0.1, 0.4))


def walker(base="free"):
    """A trunk of 5 kg with two legs of three joints each, without a foot's attitude of its own."""
    limb = hp.Body(1, (0.1, 0, -0.2), 0.02 * np.eye(3))
    legs, parents = [], []
    for side, name in ((1, "left"), (-1, "right")):
        first = len(legs)
        legs += [
            hp.HingePair((0, 0.2 * side, 0), (0, 0, 0), (1, 0, 0), name=f"{name}_a", body2=limb, limits=(-1, 1)),
            hp.HingePair((0, 0.05, 0), (0, 0, 0), (0, 1, 0), name=f"{name}_b", body2=limb),
            hp.HingePair((0, 0, -0.5), (0, 0, 0.5), (0, 1, 0), name=name, body2=limb),
        ]
        parents += [0, first + 1, first + 2]
    legs[0] = hp.HingePair(
        (0, 0.2, 0), (0, 0, 0), (1, 0, 0), name="left_a", limits=(-1, 1), body2=limb,
        body1=hp.Body(5, (0.05, 0, 0.3), np.diag((0.5, 0.4, 0.3))),
    )  # fmt: skip
    return hp.Mechanism(legs, parents, base=base)


ROBOT = walker()


def wanted(q=HOME, base=START):
    """Positions of both feet."""
    return {name: ROBOT.forward_kinematics(q, frames=name, base_motion=base)[name].R for name in FEET}


def found_base(s):
    return hp.BodyMotion(R=s.base_R, S=s.base_S)


def test_joints_of_a_base_are_its_pose():
    """The tree with six joints more, against the same robot on a base with that pose."""
    tree = tree_with_base_joints(tree_of(ROBOT))
    moved = hp.Mechanism.from_pinocchio(hp.to_pinocchio(_robot_of(tree)).model)
    x = np.array((0.3, -0.2, 0.5, 0.4, -0.6, 1.2))
    S = hp.euler_to_matrix(x[3:])
    for name in FEET:
        here = moved.forward_kinematics(np.concatenate([x, HOME]), frames=name)[name]
        there = ROBOT.forward_kinematics(HOME, frames=name, base_motion=hp.BodyMotion(R=x[:3], S=S))[name]
        np.testing.assert_allclose(here.R, there.R, rtol=0, atol=64 * U)
        np.testing.assert_allclose(here.S, there.S, rtol=0, atol=64 * U)


def _robot_of(tree):
    robot = walker(base="fixed")
    object.__setattr__(robot, "_tree", tree)
    return robot


def test_the_base_is_solved_for_beside_the_joints():
    """Two positions leave the base free in many ways: it stays near where it starts."""
    rng = np.random.default_rng(1)
    targets = {name: R + rng.normal(size=(20, 3)) * 0.05 for name, R in wanted().items()}
    s = ROBOT.inverse_kinematics(targets, q0=HOME, base="solve", base_motion=START)
    assert s.ok.all()
    assert (s.base_R.shape, s.base_S.shape) == ((20, 3), (20, 3, 3))
    there = ROBOT.forward_kinematics(s.q, frames=FEET, base_motion=found_base(s))
    for name, R in targets.items():
        assert np.abs(there[name].R - R).max() <= POSE + 64 * U
    assert np.abs(s.base_S @ np.swapaxes(s.base_S, -1, -2) - np.eye(3)).max() <= 16 * U
    assert np.abs(s.base_R - START.R).max() < 0.3
    assert (np.abs(s.q[:, [0, 3]]) <= 1).all()
    alone = ROBOT.inverse_kinematics({k: R[3] for k, R in targets.items()}, q0=HOME, base="solve", base_motion=START)
    assert np.array_equal(alone.q, s.q[3])
    assert np.array_equal(alone.base_R, s.base_R[3])


def test_a_base_that_stands_right_does_not_move():
    s = ROBOT.inverse_kinematics(wanted(), q0=HOME, base="solve", base_motion=START)
    np.testing.assert_allclose(s.q, HOME, rtol=0, atol=8192 * U)
    np.testing.assert_allclose(s.base_R, START.R, rtol=0, atol=8192 * U)
    np.testing.assert_allclose(s.base_S, START.S, rtol=0, atol=8192 * U)
    held = ROBOT.inverse_kinematics(wanted(), q0=HOME, base_motion=START)
    assert held.base_R is None


def test_centre_of_mass_coordinates_and_held_joints():
    centre = ROBOT.centre_of_mass(HOME, base_motion=START) + np.array((0.03, 0.02, -0.04))
    goals = {"centre_of_mass": centre, "coordinates": {"left_b": 0.55, "right_a": HOME[3]}}
    s = ROBOT.inverse_kinematics(wanted(), q0=HOME, base="solve", base_motion=START, **goals)
    assert s.ok
    np.testing.assert_allclose(ROBOT.centre_of_mass(s.q, base_motion=found_base(s)), centre, rtol=0, atol=2 * POSE)
    assert s.centre_of_mass_error <= POSE
    assert (s.q[1], s.q[3]) == (0.55, HOME[3])
    centre = ROBOT.centre_of_mass(HOME + 0.1, base_motion=START)
    alone = ROBOT.inverse_kinematics(centre_of_mass=centre, q0=HOME, base_motion=START)
    np.testing.assert_allclose(ROBOT.centre_of_mass(alone.q, base_motion=START), centre, rtol=0, atol=2 * POSE)


def test_targets_may_be_given_in_the_axes_of_another_frame():
    q = np.array((0.1, 0.4, 0.6, -0.2, 0.3, 0.7))
    state = ROBOT.forward_kinematics(q, frames=FEET)
    seen = state["left"].S.T @ (state["right"].R - state["left"].R)
    turn = state["left"].S.T @ state["right"].S
    for R, S, names in (({"right": seen}, None, {"right": "left"}), (None, {"right": turn}, "left")):
        s = ROBOT.inverse_kinematics(R, S, relative_to=names, q0=q + 0.1, base_motion=START)
        assert s.ok
        there = ROBOT.forward_kinematics(s.q, frames=FEET)
        if R:
            found = there["left"].S.T @ (there["right"].R - there["left"].R)
            np.testing.assert_allclose(found, seen, rtol=0, atol=2 * POSE)
        else:
            np.testing.assert_allclose(there["left"].S.T @ there["right"].S, turn, rtol=0, atol=4 * POSE)


def test_a_displacement_is_a_coordinate_to_be_had():
    lift = hp.Slider((0, 0, 0), (0, 0, 0), (0, 0, 1), name="lift")
    arm = hp.HingePair((0, 0, 0), (-0.5, 0, 0), (0, 1, 0), name="arm")
    turn = hp.HingePair((0, 0, 0), (-0.5, 0, 0), (0, 1, 0), name="turn")
    robot = hp.Mechanism([lift, arm, turn])
    s = robot.inverse_kinematics((0.3, 0, 7.4), frame="turn", coordinates={"lift": 7.0})
    assert s.ok
    assert s.q[0] == 7.0
    path = robot.inverse_kinematics_path(
        np.linspace((0.3, 0, 7.4), (0.5, 0, 7.2), 9), frame="turn", coordinates={"lift": 7.0}
    )
    assert path.ok.all()
    assert (path.q[:, 0] == 7.0).all()


# ---------------------------------------------------------------- one target at a time

PANDA = hp.load_robot("panda", locked={"panda_finger_joint1": 0.02})


def test_one_target_is_reached_from_coordinates_near_it():
    rng = np.random.default_rng(2)
    low, high = PANDA.position_limits.T
    q = rng.uniform(low, high, (60, 7))
    target = PANDA.forward_kinematics(q, frames="panda_hand")["panda_hand"]
    solve = PANDA.prepare("inverse_kinematics", frames="panda_hand")
    for k in range(len(q)):
        s = solve(target.R[k], target.S[k], q[k] + 0.1 * rng.normal(size=7))
        there = PANDA.forward_kinematics(s.q, frames="panda_hand")["panda_hand"]
        assert s.ok
        assert (s.position_error.shape, s.q.shape) == ((), (7,))
        assert np.abs(there.R - target.R[k]).max() <= POSE + 64 * U
        assert np.abs(there.S - target.S[k]).max() <= 2 * POSE
        assert (low <= s.q).all()
        assert (s.q <= high).all()
    assert solve(target.R[0], q0=q[1]).angle_error is None
    far = solve((3.0, 0, 0), q0=q[0])
    assert (bool(far.ok), bool(np.isfinite(far.q).all()), int(far.starts)) == (False, True, 16)
    nothing = solve((np.nan, 0, 0), q0=q[0])
    assert (bool(nothing.ok), bool(np.isnan(nothing.q).all())) == (False, True)


def test_one_target_approaches_a_posture():
    home = np.array((0, -0.4, 0, -2.2, 0, 1.9, 0.8))
    target = PANDA.forward_kinematics(home + 0.2, frames="panda_hand")["panda_hand"]
    solve = PANDA.prepare("inverse_kinematics", frames="panda_hand", prefer=home)
    one = solve(target.R, target.S, home + 0.3)
    best = PANDA.inverse_kinematics(target, frame="panda_hand", q0=home + 0.3, prefer=home)
    plain = PANDA.inverse_kinematics(target, frame="panda_hand", q0=home + 0.3)
    distance = [float(np.linalg.norm(s.q - home)) for s in (best, one, plain)]
    assert one.ok
    assert distance[0] <= distance[1] + POSE < distance[2]
    assert distance[1] < distance[0] + 0.02 * (distance[2] - distance[0])


@pytest.mark.parametrize("base", ["hold", "solve"])
def test_one_target_of_several_frames_with_a_base(base):
    targets = np.stack([*wanted().values()]) + 0.02
    solve = ROBOT.prepare("inverse_kinematics", frames=FEET, base=base)
    s = solve(targets, q0=HOME, base_motion=START)
    there = ROBOT.forward_kinematics(s.q, frames=FEET, base_motion=found_base(s) if base == "solve" else START)
    assert s.ok
    assert s.position_error.shape == (2,)
    np.testing.assert_allclose(there.R, targets, rtol=0, atol=2 * POSE)
