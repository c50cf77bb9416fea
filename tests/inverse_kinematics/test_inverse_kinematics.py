"""Inverse kinematics: solutions by forward kinematics, limits, closest points in closed form, and the same bits."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.formats.robots import robot_names
from hingepair.inverse_kinematics.starts import Starts
from support.near import POSE, U

ARMS = {"panda": "panda_hand", "ur5_robot": "tool0"}


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


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_solutions_reach_their_targets_within_limits(name):
    robot, frame = robot_of(name), ARMS[name]
    wanted = robot.forward_kinematics(random_coordinates(robot, 1000), frames=frame)[frame]
    found = robot.inverse_kinematics(wanted.R, wanted.S, frame=frame)
    assert found.ok.mean() >= 0.998
    distance, angle = errors(robot, found.q, frame, wanted.R, wanted.S)
    assert distance[found.ok].max() <= POSE + 64 * U
    assert angle[found.ok].max() <= POSE + 64 * U
    assert np.abs(distance - found.position_error).max() <= 64 * U
    assert np.abs(angle - found.angle_error).max() <= 512 * U
    low, high = robot.position_limits.T
    assert (found.q >= low).all()
    assert (found.q <= high).all()
    assert (found.steps >= found.starts).all()
    assert found.steps.mean() <= 24  # 16 of a UR5, 21 of a Panda; more without the limits' part of a step


def test_solutions_are_exact_where_the_jacobian_is_regular():
    robot = hp.load_robot("ur5_robot")
    wanted = robot.forward_kinematics(random_coordinates(robot, 2000), frames="tool0")["tool0"]
    found = robot.inverse_kinematics(wanted.R, wanted.S, frame="tool0")
    sizes = np.linalg.svd(robot.jacobian(found.q, "tool0"), compute_uv=False)
    regular = found.ok & (sizes[:, 0] < 30 * sizes[:, -1])
    assert regular.sum() > 1000
    inexact = np.maximum(found.position_error, found.angle_error)[regular] > 64 * U
    assert inexact.mean() < 0.005  # of these few, the search ended with its last step


@pytest.mark.parametrize("limits", [None, (-999_999, 999_999)])
def test_sliders_go_as_far_as_the_target(limits):
    rail = hp.Slider((0, 0, 0), (0, 0, 0), (1, 0, 0), name="rail", limits=limits)
    upper = hp.HingePair((0, 0, 0.2), (0, 0, 0), (0, 1, 0), name="upper")
    lower = hp.HingePair((0.4, 0, 0), (-0.5, 0, 0), (0, 1, 0), name="lower")
    for joints in ([rail], [rail, upper, lower]):
        robot = hp.Mechanism(joints)
        q = np.random.default_rng(3).uniform(
            (-5000, 0.2, 0.4)[: robot.dof], (5000, 0.6, 1.2)[: robot.dof], (20, robot.dof)
        )
        R = robot.forward_kinematics(q).R[:, 0]
        found = robot.inverse_kinematics(R)
        assert found.ok.all()
        np.testing.assert_allclose(robot.forward_kinematics(found.q).R[:, 0], R, rtol=0, atol=POSE)


@pytest.mark.parametrize("limits", [(0, 400), None])
def test_the_angle_of_a_lead_screw_is_not_a_length(limits):
    pitch = 0.005 / (2 * np.pi)
    robot = hp.Mechanism([hp.Screw((0, 0, 0), (0, 0, 0), (0, 0, 1), pitch=pitch, name="s", limits=limits)])
    z = np.linspace(0.01, 0.3, 6)
    found = robot.inverse_kinematics(np.stack([0 * z, 0 * z, z], axis=-1))
    assert found.ok.all()
    np.testing.assert_allclose(found.q[:, 0] * pitch, z, rtol=0, atol=POSE)


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [{}, {"select": "nearest"}, {"solutions": 3}, {"prefer": "middle"}, {"seed": 5, "workers": 2}],
    ids=lambda options: "-".join(options) or "any",
)
def test_a_target_gives_the_same_bits_in_any_batch(options):
    robot = robot_of("panda")
    q = random_coordinates(robot, 60 if not options else 12)
    wanted = robot.forward_kinematics(q, frames="panda_hand")["panda_hand"]
    R, S = np.array(wanted.R), np.array(wanted.S)
    R[3] += 2  # out of reach
    q0 = q * 0.5

    def solve(*index):
        return robot.inverse_kinematics(R[index], S[index], q0=q0[index], frame="panda_hand", **options)

    whole = solve(slice(None))
    pieces = [solve(slice(5)), solve(slice(5, None))]
    for name in whole.outputs:
        assert np.array_equal(whole[name], np.concatenate([one[name] for one in pieces]), equal_nan=True), name
        assert np.array_equal(whole[name][7], solve(7)[name], equal_nan=True), name


def test_targets_out_of_reach_give_the_closest_position():
    arm = planar_arm(((-3.0, 3.0), (-2.0, 2.0)))
    angle = np.linspace(-2.5, 2.5, 11)
    direction = np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=-1)
    for length in (0.9 + 1e-3, 2.9, 1e6):
        found = arm.inverse_kinematics(length * direction, frame="tip")
        assert not found.ok.any()
        assert np.abs(found.position_error - (length - 0.9)).max() <= POSE * length
    near = arm.inverse_kinematics((0, 0, 0), frame="tip")  # the elbow bends by 2 rad at most
    assert near.q[1] in (-2.0, 2.0)
    closest = np.sqrt(0.4**2 + 0.5**2 + 2 * 0.4 * 0.5 * np.cos(2.0))
    assert near.position_error == pytest.approx(closest, abs=8192 * U)
    for length in (1e200, 1.7e308):
        found = arm.inverse_kinematics((length, length, -length), frame="tip")
        assert np.isfinite(found.q).all()
        assert not found.ok


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
    assert np.abs(found.q - nearest).max() <= 100 * POSE


@pytest.mark.slow
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


@pytest.mark.proof
@pytest.mark.filterwarnings("ignore::hingepair.DynamicsWarning")
@pytest.mark.parametrize("name", robot_names())
def test_tips_of_every_robot_reach_their_targets(name, record_property):
    """Shares of 1,000 random targets that are solved, for each tip: of poses, and of positions alone."""
    robot = hp.load_robot(name)
    if not robot.dof:
        pytest.skip("no joint moves")
    q, (low, high) = random_coordinates(robot, 1000), robot.position_limits.T
    for tip in robot.tips:
        wanted = robot.forward_kinematics(q, frames=tip)[tip]
        shares = []
        for S in (wanted.S, None):
            found = robot.inverse_kinematics(wanted.R, S, frame=tip)
            assert ((low <= found.q) & (found.q <= high)).all()
            shares.append(float(found.ok.mean()))  # xdist hands on no numbers of NumPy
        record_property(tip, shares)
        print(f"{name:28} {tip:34} {shares[0]:.3f} {shares[1]:.3f}")
        assert min(shares) >= 0.998, tip


def test_a_frame_that_no_joint_moves_stays_where_it_is():
    arm = planar_arm(((-1.0, 2.0), (-2.0, 1.0)))
    found = arm.inverse_kinematics(((0, 0, 0), (3.0, 0, 4.0)), np.eye(3), frame="base", q0=(0.5, 0.25))
    assert found.ok.tolist() == [True, False]
    assert found.q.tolist() == [[0.5, 0.25]] * 2
    assert found.position_error.tolist() == [0, 5]


def test_poses_are_those_on_a_moving_base():
    robot, q = robot_of("ur5_robot"), random_coordinates(robot_of("ur5_robot"), 20)
    turns = np.linspace((0, 0, 0), (1, -2, 0.5), 20)
    base = hp.BodyMotion.from_rotvec(R=5 * turns + 1, rotvec=turns)
    wanted = robot.forward_kinematics(q, frames="tool0", base_motion=base)["tool0"]
    found = robot.inverse_kinematics(wanted, frame="tool0", base_motion=base)
    there = robot.forward_kinematics(found.q, frames="tool0", base_motion=base)["tool0"]
    assert found.ok.all()
    assert np.abs(there.R - wanted.R).max() <= POSE + 64 * U
    assert np.abs(there.S - wanted.S).max() <= POSE + 64 * U
    at_rest = robot.inverse_kinematics(wanted, frame="tool0")
    assert not at_rest.ok[1:].all()


@pytest.mark.slow
@pytest.mark.parametrize("axis", [(0, 0, 1), (2, 0, 0), (1, -2, 0.5)])
def test_an_axis_has_its_direction(axis):
    robot, axis = robot_of("ur5_robot"), np.array(axis)
    R = np.random.default_rng(3).uniform((-0.4, -0.4, 0), (0.4, 0.4, 0.8), (30, 3))
    direction = np.random.default_rng(4).normal(size=(30, 3))
    found = robot.inverse_kinematics(R, frame="tool0", direction=1e200 * direction, axis=axis)
    assert found.ok.mean() >= 0.9
    there = robot.forward_kinematics(found.q[found.ok], frames="tool0")["tool0"]
    wanted = direction[found.ok] / np.linalg.norm(direction[found.ok], axis=1, keepdims=True)
    assert np.abs(there.S @ (axis / np.linalg.norm(axis)) - wanted).max() <= 2 * POSE
    assert np.abs(there.R - R[found.ok]).max() <= 2 * POSE
    assert found.angle_error[found.ok].max() <= POSE


@pytest.mark.slow(2)
def test_several_frames_reach_their_targets_at_once():
    robot = hp.load_robot("talos_full_v2")
    names = ("gripper_left_base_link", "gripper_right_base_link", "leg_left_6_link")
    state = robot.forward_kinematics(random_coordinates(robot, 50), frames=names)
    R = {name: state[name] for name in names[:2]} | {names[2]: state[names[2]].R}
    found = robot.inverse_kinematics(R)
    assert found.ok.mean() >= 0.98
    assert found.position_error.shape == found.angle_error.shape == (50, 3)
    there = robot.forward_kinematics(found.q, frames=names)
    for k, name in enumerate(names):
        distance = np.linalg.norm(there[name].R - state[name].R, axis=1)
        assert np.abs(distance - found.position_error[:, k]).max() <= 64 * U
    assert (found.angle_error[:, 2] == 0).all()  # none is wanted
    one = robot.inverse_kinematics({names[0]: state[names[0]]})
    alone = robot.inverse_kinematics(state[names[0]], frame=names[0])
    assert np.array_equal(one.q, alone.q)


@pytest.mark.slow
def test_a_posture_is_approached_where_the_frame_leaves_it_free():
    robot = robot_of("panda")
    low, high = robot.position_limits.T
    q = random_coordinates(robot, 100)
    wanted = robot.forward_kinematics(q, frames="panda_hand")["panda_hand"]
    back = robot.inverse_kinematics(wanted, frame="panda_hand", q0=q + 1e-3, prefer=q)
    assert np.abs(back.q - q).max() <= 1e-6  # the posture itself has the pose
    middle = (low + high) / 2
    found = robot.inverse_kinematics(wanted, frame="panda_hand", prefer="middle")
    assert found.ok.mean() >= 0.99
    # Optimal: what is left of the way to the middle lies in the rows of the Jacobian.
    inside = found.ok & ((low + 1e-9 < found.q) & (found.q < high - 1e-9)).all(axis=1)
    jacobian, way = robot.jacobian(found.q, "panda_hand"), middle - found.q
    left = [z - np.linalg.pinv(J) @ (J @ z) for J, z in zip(jacobian[inside], way[inside], strict=True)]
    assert inside.mean() >= 0.5
    assert (np.abs(left).max(axis=1) <= 1e4 * POSE).mean() >= 0.97


def test_several_solutions_are_all_of_a_wrist():
    robot = robot_of("ur5_robot")
    q = random_coordinates(robot, 60)
    wanted = robot.forward_kinematics(q, frames="tool0")["tool0"]
    q0 = random_coordinates(robot, 60, seed=2)
    found = robot.inverse_kinematics(wanted, frame="tool0", q0=q0, solutions=10)
    counts = found.ok.sum(axis=1)
    assert (counts % 2 == 0).mean() >= 0.95  # solutions come in pairs, with the wrist turned over
    assert counts.max() == 8
    distance = np.linalg.norm(found.q - q0[:, None], axis=2)
    for k in range(60):
        count = counts[k]
        there = robot.forward_kinematics(found.q[k, :count], frames="tool0")["tool0"]
        assert np.abs(there.R - wanted.R[k]).max() <= 2 * POSE
        assert (np.diff(distance[k, :count]) >= 0).all()
        apart = np.abs(found.q[k, :count, None] - found.q[k, None, :count]).max(axis=-1)
        assert (apart + np.eye(count)).min() >= 1e-3
        assert np.isnan(found.q[k, count:]).all()
    few = robot.inverse_kinematics(wanted, frame="tool0", q0=q0, solutions=2)
    assert np.array_equal(few.q, found.q[:, :2])
    nearest = robot.inverse_kinematics(wanted, frame="tool0", q0=q0, select="nearest")
    assert np.array_equal(nearest.q, found.q[:, 0])


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_a_path_is_followed_without_a_jump(name):
    robot, frame = robot_of(name), ARMS[name]
    angle = np.linspace(0, 2 * np.pi, 400)
    R = np.stack([0.45 + 0.1 * np.cos(angle), 0.1 * np.sin(angle), 0.3 + 0.05 * np.sin(2 * angle)], axis=-1)
    found = robot.inverse_kinematics_path(R, np.diag([1.0, -1, -1]), frame=frame)
    assert found.ok.all()
    assert not found.jumps.any()
    assert np.abs(np.diff(found.q, axis=0)).max() <= 0.1
    distance, angle = errors(robot, found.q, frame, R, np.diag([1.0, -1, -1]))
    assert max(distance.max(), angle.max()) <= POSE + 64 * U
    both = robot.inverse_kinematics_path(np.stack([R, R[::-1]]), np.diag([1.0, -1, -1]), frame=frame, workers=2)
    assert np.array_equal(both.q[0], found.q)


@pytest.mark.slow(2)
@pytest.mark.parametrize("prefers", [False, True])
def test_a_redundant_arm_follows_smooth_paths_from_their_start(prefers):
    """Seeds 14 and 18 drift into limits without a posture; 21 is drawn across `max_change` by one."""
    robot, frame = robot_of("panda"), ARMS["panda"]
    low, high = robot.position_limits.T
    time, q = np.linspace(0, 1, 400)[:, None], []
    for seed in (6, 14, 18, 21, 31):
        g = np.random.default_rng(seed)
        wave = np.sin(g.uniform(1, 5, 7) * time + g.uniform(0, 6.28, 7))
        q.append((low + high) / 2 + 0.3 * (high - low) * wave)
    start = np.array(q)[:, 0]
    wanted = robot.forward_kinematics(np.array(q), frames=frame)[frame]
    prefer = start[:, None] if prefers else None
    found = robot.inverse_kinematics_path(wanted, frame=frame, q0=start, prefer=prefer)
    assert found.ok.all()
    assert not found.jumps.any()
    assert np.abs(np.diff(found.q, axis=1)).max() <= 0.5


def round_trip():
    angle = np.linspace(0.1, 0.1 + 2 * np.pi, 200)
    return 0.6 * np.stack([np.cos(angle), 0 * angle, -np.sin(angle)], axis=-1)


def test_a_path_jumps_only_where_it_must():
    R = round_trip()
    free = planar_arm().inverse_kinematics_path(R, frame="tip")
    assert (free.ok.all(), free.jumps.sum()) == (True, 0)
    held = planar_arm(((-3.0, 3.0), (-2.9, 2.9))).inverse_kinematics_path(R, frame="tip")
    assert (held.ok.all(), held.jumps.sum()) == (True, 1)  # a full turn does not fit into 6 rad
    jump = np.abs(np.diff(held.q, axis=0)).max(axis=1) > 0.5
    assert np.array_equal(held.jumps[1:], jump)


def test_a_path_starts_with_the_branch_that_lasts():
    """The elbow passes 1.6 rad on one side only: from there, both ends of the path are reached."""
    arm = planar_arm(((-3.0, 3.0), (-2.9, 1.6)))
    R = np.linspace(0.75, 0.4, 100)[:, None] * np.array([np.cos(0.3), 0, -np.sin(0.3)])
    found = arm.inverse_kinematics_path(R, frame="tip")
    assert (found.ok.all(), found.jumps.sum()) == (True, 0)
    assert (found.q[:, 1] < 0).all()
    other = arm.inverse_kinematics_path(R, frame="tip", q0=(-0.2, 1.0))
    assert other.q[0, 1] > 0
    assert other.ok.all()
    assert other.jumps.sum() == 1


def test_a_path_goes_as_near_as_the_arm_reaches_and_comes_back():
    away = np.concatenate((np.linspace(0.7, 1.2, 20), np.linspace(1.2, 0.7, 20)))
    found = planar_arm().inverse_kinematics_path(away[:, None] * np.array([1.0, 0, 0]), frame="tip")
    assert np.array_equal(found.ok, away < 0.9)
    np.testing.assert_allclose(found.position_error, np.maximum(away - 0.9, 0), rtol=0, atol=1e3 * POSE)


def test_a_lost_target_of_a_path_is_lost_alone():
    R = np.linspace(0.4, 0.7, 9)[:, None] * np.array([1.0, 0, 0])
    R[4] = np.nan
    found = planar_arm().inverse_kinematics_path(R, frame="tip")
    assert np.isnan(found.q).all(axis=1).tolist() == np.isnan(R).all(axis=1).tolist()


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


def test_a_pose_of_a_random_start_is_nearest_to_itself(monkeypatch):
    kept, nearest = [], Starts.nearest
    monkeypatch.setattr(Starts, "nearest", lambda self, *given: kept.append(self) or nearest(self, *given))
    robot = robot_of("ur5_robot")
    robot.inverse_kinematics(robot.forward_kinematics(np.full(6, 0.3), frames="tool0")["tool0"], frame="tool0")
    starts = kept[0]
    size = starts.measure.argument_shapes["target"]
    q = starts.nearest(np.random.default_rng(0).normal(size=(20, *size)), 0, 256)
    np.testing.assert_array_equal(starts.nearest(starts.measure.rows(q, np.zeros(size))["pose"], 0, 256), q)
