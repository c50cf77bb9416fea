"""Inverse kinematics: solutions by forward kinematics, limits, closest points in closed form, and the same bits."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.formats.robots import robot_names

ARMS = {"panda": "panda_hand", "ur5_robot": "tool0"}
U = 2.0**-53


def robot_of(name, **options):
    return hp.load_robot(name, locked={"panda_finger_joint1": 0.02} if name == "panda" else None, **options)


def random_coordinates(robot, count, seed=1):
    limits = np.clip(robot.position_limits, -np.pi, np.pi)
    return np.random.default_rng(seed).uniform(*limits.T, (count, robot.dof))


def errors(robot, q, frame, R, S):
    """Distance and angle from the targets, by forward kinematics."""
    there = robot.forward_kinematics(q, frames=frame)[frame]
    turn = np.swapaxes(there.S, -1, -2) @ S
    skew = turn - np.swapaxes(turn, -1, -2)
    sine = np.linalg.norm(skew, axis=(-1, -2)) / np.sqrt(8)
    angle = np.arctan2(sine, (np.trace(turn, axis1=-2, axis2=-1) - 1) / 2)
    return np.linalg.norm(there.R - R, axis=-1), angle


def planar_arm(limits=((-np.inf, np.inf), (-np.inf, np.inf))):
    """Links of 0.4 m and 0.5 m in the x-z plane; the end is the frame "tip"."""
    kind = "revolute" if np.isfinite(limits).all() else "continuous"
    bounds = [f'lower="{low}" upper="{high}"' if kind == "revolute" else "" for low, high in limits]
    joints = [
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{name}"/><origin xyz="{x} 0 0"/>'
        f'<axis xyz="0 1 0"/><limit {bound} effort="1" velocity="1"/></joint>'
        for name, parent, x, bound in zip(("upper", "lower"), ("base", "upper"), (0.0, 0.4), bounds, strict=True)
    ]
    tip = '<joint name="end" type="fixed"><parent link="lower"/><child link="tip"/><origin xyz="0.5 0 0"/></joint>'
    links = "".join(f'<link name="{name}"/>' for name in ("base", "upper", "lower", "tip"))
    return hp.Mechanism.from_urdf(f'<robot name="arm">{links}{"".join(joints)}{tip}</robot>')


@pytest.mark.parametrize("name", ARMS)
def test_solutions_reach_their_targets_within_limits(name):
    robot, frame = robot_of(name), ARMS[name]
    wanted = robot.forward_kinematics(random_coordinates(robot, 1000), frames=frame)[frame]
    found = robot.inverse_kinematics(wanted.R, wanted.S, frame=frame)
    assert found.ok.mean() >= 0.998
    distance, angle = errors(robot, found.q, frame, wanted.R, wanted.S)
    assert distance[found.ok].max() <= 1e-9 + 64 * U
    assert angle[found.ok].max() <= 1e-9 + 64 * U
    assert np.abs(distance - found.position_error).max() <= 64 * U
    assert np.abs(angle - found.angle_error).max() <= 1e-15 * 64
    low, high = robot.position_limits.T
    assert (found.q >= low).all()
    assert (found.q <= high).all()
    assert (found.steps >= found.starts).all()


def test_errors_come_down_to_tight_tolerances():
    robot = robot_of("ur5_robot")
    q = random_coordinates(robot, 200)
    q[:, 4] = np.sign(q[:, 4]) * (0.3 + np.abs(q[:, 4]) / 2)  # no stretched wrist
    wanted = robot.forward_kinematics(q, frames="tool0")["tool0"]
    found = robot.inverse_kinematics(
        wanted.R, wanted.S, q0=q + 0.05, frame="tool0", position_tolerance=1e-13, angle_tolerance=1e-13
    )
    assert found.ok.mean() >= 0.98
    assert max(found.position_error[found.ok].max(), found.angle_error[found.ok].max()) <= 1e-13


@pytest.mark.parametrize("select", ["any", "nearest"])
def test_a_target_gives_the_same_bits_in_any_batch(select):
    robot = robot_of("panda")
    q = random_coordinates(robot, 60 if select == "any" else 12)
    wanted = robot.forward_kinematics(q, frames="panda_hand")["panda_hand"]
    R, S = np.array(wanted.R), np.array(wanted.S)
    R[3] += 2  # out of reach
    q0 = q * 0.5

    def solve(*index):
        return robot.inverse_kinematics(R[index], S[index], q0=q0[index], frame="panda_hand", select=select)

    whole = solve(slice(None))
    pieces = [solve(slice(5)), solve(slice(5, None))]
    for name in whole.outputs:
        assert np.array_equal(whole[name], np.concatenate([one[name] for one in pieces])), name
        assert np.array_equal(whole[name][7], solve(7)[name]), name


def test_targets_out_of_reach_give_the_closest_position():
    arm = planar_arm(((-3.0, 3.0), (-2.0, 2.0)))
    angle = np.linspace(-2.5, 2.5, 11)
    direction = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=-1)
    for length in (0.9 + 1e-3, 2.9, 1e6):
        found = arm.inverse_kinematics(length * direction, frame="tip")
        assert not found.ok.any()
        assert np.abs(found.position_error - (length - 0.9)).max() <= 1e-9 * length
    near = arm.inverse_kinematics((0, 0, 0), frame="tip")  # the elbow bends by 2 rad at most
    assert near.q[1] in (-2.0, 2.0)
    closest = np.sqrt(0.4**2 + 0.5**2 + 2 * 0.4 * 0.5 * np.cos(2.0))
    assert near.position_error == pytest.approx(closest, abs=1e-12)
    for length in (1e200, 1.7e308):
        found = arm.inverse_kinematics((length, length, -length), frame="tip")
        assert np.isfinite(found.q).all()
        assert not found.ok


@pytest.mark.parametrize("q0", [(0.1, 0.2), (40.0, -30.0)])
def test_hinges_turn_no_farther_from_q0_than_half_a_turn(q0):
    found = planar_arm().inverse_kinematics(((0.2, 0, 0.1), (-2.0, 0, 0.1), (0.3, 0, -0.8)), frame="tip", q0=q0)
    assert np.abs(found.q - q0).max() <= np.pi * (1 + 4 * U)


def test_limits_hold_to_the_last_bit():
    robot = robot_of("panda")
    limits = robot.position_limits
    corners = np.array([limits[np.arange(7), [int(c) for c in f"{k:07b}"]] for k in range(0, 128, 5)])
    wanted = robot.forward_kinematics(corners, frames="panda_hand")["panda_hand"]
    found = robot.inverse_kinematics(wanted.R, wanted.S, q0=corners, frame="panda_hand")
    assert found.ok.all()
    outside = robot.inverse_kinematics(wanted.R + np.array((0, 0, 0.5)), wanted.S, q0=9 * corners, frame="panda_hand")
    for q in (found.q, outside.q):
        assert (q >= limits[:, 0]).all()
        assert (q <= limits[:, 1]).all()


def test_without_limits_joints_may_pass_theirs():
    arm = planar_arm(((-0.5, 0.5), (-0.5, 0.5)))
    target = (0.0, 0.0, 0.7)
    assert not arm.inverse_kinematics(target, frame="tip").ok
    assert arm.inverse_kinematics(target, frame="tip", limits=False).ok


@pytest.mark.parametrize("q0", [(0.0, 0.1), (7.0, -20.0), (-3.0, 2.0)])
def test_nearest_is_the_nearest_of_all_solutions_and_turns(q0):
    arm, angle, length = planar_arm(), 0.7, 0.6
    target = length * np.array([np.cos(angle), 0, -np.sin(angle)])
    bend = np.arccos((length**2 - 0.4**2 - 0.5**2) / (2 * 0.4 * 0.5))
    shoulder = np.arctan2(0.5 * np.sin(bend), 0.4 + 0.5 * np.cos(bend))
    both = np.array([(angle - shoulder, bend), (angle + shoulder, -bend)])
    both -= 2 * np.pi * np.round((both - q0) / (2 * np.pi))
    nearest = min(both, key=lambda q: np.linalg.norm(q - q0))
    found = arm.inverse_kinematics(target, frame="tip", q0=np.array(q0), select="nearest")
    assert found.ok
    assert np.abs(found.q - nearest).max() <= 1e-7


def test_nearest_is_no_farther_than_a_known_solution():
    robot = robot_of("ur5_robot")
    q = random_coordinates(robot, 25)
    q0 = q + np.random.default_rng(2).uniform(-0.8, 0.8, q.shape)
    wanted = robot.forward_kinematics(q, frames="tool0")["tool0"]
    found = robot.inverse_kinematics(wanted.R, wanted.S, q0=q0, frame="tool0", select="nearest")
    assert found.ok.all()
    assert (np.linalg.norm(found.q - q0, axis=1) <= np.linalg.norm(q - q0, axis=1) + 1e-6).mean() >= 0.96


@pytest.mark.parametrize(
    "q", [np.zeros(6), (0.3, -np.pi / 2, 0, 0.2, 0, 0), (1, -1, 1.5, 0.5, 0, 0.3), (0, -1.2, np.pi, 0, 1, 0)],
    ids=["stretched", "upright", "wrist", "folded"],
)  # fmt: skip
def test_singular_targets_are_reached(q):
    robot = robot_of("ur5_robot")
    wanted = robot.forward_kinematics(q, frames="tool0")["tool0"]
    found = robot.inverse_kinematics(wanted.R, wanted.S, frame="tool0", position_tolerance=1e-6, angle_tolerance=1e-6)
    assert found.ok


@pytest.mark.parametrize("axis", range(3))
def test_opposite_attitudes_are_reached(axis):
    robot, q0 = robot_of("ur5_robot"), np.array([0.2, -1.2, 1.4, 0.3, 1.1, -0.4])
    there = robot.forward_kinematics(q0, frames="tool0")["tool0"]
    turn = -np.eye(3)
    turn[axis, axis] = 1
    found = robot.inverse_kinematics(there.R, there.S @ turn, frame="tool0", q0=q0)
    assert found.ok


@pytest.mark.parametrize(
    ("name", "frame"),
    [("tiago", "arm_7_link"), ("talos_full_v2", "gripper_left_base_link"), ("panda", "panda_leftfinger"),
     ("talos_full_v2", "leg_right_6_link"), ("solo12", "FL_FOOT")],
)  # fmt: skip
def test_robots_with_sliders_mimics_and_branches(name, frame):
    robot = hp.load_robot(name)
    q = random_coordinates(robot, 50)
    wanted = robot.forward_kinematics(q, frames=frame)[frame]
    S = wanted.S if name != "solo12" else None  # three joints reach positions
    q0 = np.clip(0.5 * q, *robot.position_limits.T)
    found = robot.inverse_kinematics(wanted.R, S, q0=q0, frame=frame)
    assert found.ok.mean() >= 0.9
    still = ~robot.jacobian(q, frame).any(axis=(0, 1))
    assert np.array_equal(found.q[:, still], q0[:, still])
    anywhere = robot.inverse_kinematics(wanted.R[:3], frame=frame).q[:, still]
    low, high = robot.position_limits[still].T
    free = np.isinf(low)
    middle = np.where(free, 0, (np.where(free, 0, low) + np.where(free, 0, high)) / 2)
    assert np.abs(anywhere - middle).max(initial=0) <= 4 * U * np.pi
    assert (found.q >= robot.position_limits[:, 0]).all()
    assert (found.q <= robot.position_limits[:, 1]).all()


@pytest.mark.slow(30)
@pytest.mark.filterwarnings("ignore::hingepair.DynamicsWarning")
@pytest.mark.parametrize("name", robot_names())
def test_a_tip_of_every_robot_reaches_its_targets(name):
    robot = hp.load_robot(name)
    if not robot.dof:
        pytest.skip("no joint moves")
    frame, (low, high) = robot.tips[0], robot.position_limits.T
    wanted = robot.forward_kinematics(random_coordinates(robot, 100), frames=frame)[frame]
    found = robot.inverse_kinematics(wanted.R, wanted.S, frame=frame)
    assert found.ok.mean() >= 0.98
    assert ((low <= found.q) & (found.q <= high)).all()


def test_a_frame_that_no_joint_moves_stays_where_it_is():
    arm = planar_arm(((-1.0, 2.0), (-2.0, 1.0)))
    found = arm.inverse_kinematics(((0, 0, 0), (3.0, 0, 4.0)), np.eye(3), frame="base", q0=(0.5, 0.25))
    assert found.ok.tolist() == [True, False]
    assert found.q.tolist() == [[0.5, 0.25]] * 2
    assert found.position_error.tolist() == [0, 5]


def test_a_free_base_rests():
    fixed, free = (robot_of("ur5_robot", base=base) for base in ("fixed", "free"))
    wanted = fixed.forward_kinematics(random_coordinates(fixed, 5), frames="tool0")["tool0"]
    one, other = (robot.inverse_kinematics(wanted.R, wanted.S, frame="tool0") for robot in (fixed, free))
    assert other.ok.all()
    assert np.array_equal(one.q, other.q)


def test_only_targets_that_are_not_finite_give_nan():
    robot = robot_of("ur5_robot")
    R, S = np.full((4, 3), 0.3), np.broadcast_to(np.eye(3), (4, 3, 3)).copy()
    R[1, 2], S[2, 0, 0] = np.nan, np.nan
    R[3, 0] = np.inf
    found = robot.inverse_kinematics(R, S, frame="tool0")
    assert np.isnan(found.q).any(axis=1).tolist() == [False, True, True, True]
    assert found.ok.tolist() == [bool(found.ok[0]), False, False, False]
    assert np.isnan(found.position_error).tolist() == [False, True, True, True]
    assert found.starts.tolist()[1:] == [0, 0, 0]


def test_shapes_broadcast_and_positions_alone_have_no_angle():
    robot = robot_of("ur5_robot")
    R = np.array([[0.4, 0.1, 0.3], [0.3, 0.2, 0.4]])
    found = robot.inverse_kinematics(R[:, None], np.eye(3), frame="tool0", q0=np.zeros((4, 6)))
    assert found.q.shape == (2, 4, 6)
    assert found.shape == found.ok.shape == found.steps.shape == (2, 4)
    assert robot.inverse_kinematics(R[0], frame="tool0").angle_error is None
    assert robot.inverse_kinematics(np.empty((0, 3)), frame="tool0").q.shape == (0, 6)
    by_joint = robot.inverse_kinematics(R, frame="tool0", q0=dict.fromkeys(robot.names, 0.1))
    assert np.array_equal(by_joint.q, robot.inverse_kinematics(R, frame="tool0", q0=np.full(6, 0.1)).q)


@pytest.mark.parametrize(
    ("name", "arguments", "word"),
    [
        ("talos_full_v2", {"R": (0, 0, 0)}, "frame"),
        ("iris_simple", {"R": (0, 0, 0), "frame": "iris__rotor_0"}, "robot"),
        ("ur5_robot", {"R": (0, 0)}, "R"),
        ("ur5_robot", {"R": (0, 0, 0), "S": 2 * np.eye(3)}, "S"),
        ("ur5_robot", {"R": (0, 0, 0), "q0": (1, 2)}, "q0"),
        ("ur5_robot", {"R": (0, 0, 0), "q0": np.full(6, np.nan)}, "q0"),
        ("ur5_robot", {"R": (0, 0, 0), "select": "nearest"}, "q0"),
        ("ur5_robot", {"R": (0, 0, 0), "select": "best"}, "select"),
        ("ur5_robot", {"R": (0, 0, 0), "frame": "tool1"}, "frame"),
        ("ur5_robot", {"R": (0, 0, 0), "angle_tolerance": -1}, "angle_tolerance"),
        ("ur5_robot", {"R": (0, 0, 0), "seed": 0.5}, "seed"),
        ("ur5_robot", {"R": (0, 0, 0), "limits": 3}, "limits"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(name, arguments, word):
    with pytest.raises(hp.ArgumentError) as caught:
        robot_of(name).inverse_kinematics(**{**({"frame": "tool0"} if name == "ur5_robot" else {}), **arguments})
    assert str(caught.value).startswith(word)
