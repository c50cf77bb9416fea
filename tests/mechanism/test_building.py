"""Robots from URDF, Pinocchio's models and pairs: the bodies, joints and frames are those that Pinocchio has."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.errors import ArgumentError
from hingepair.formats.robots import robot_urdf
from hingepair.mechanism.building import urdf
from hingepair.mechanism.building.changes import add_body, pair_of
from hingepair.mechanism.building.pairs import tree_of_pairs
from hingepair.mechanism.building.pinocchio_model import tree_of_pinocchio
from hingepair.mechanism.joints import Slider
from hingepair.mechanism.mechanism import tree_of
from hingepair.rotations.matrices import rodrigues
from support.exported import ARM
from support.near import assert_near

U = 2.0**-53


def tree_of_urdf(*arguments):
    return urdf.tree_of_urdf(*arguments)[0]


def tree_of_file(name, base="fixed", locked=None, snap=None):
    return tree_of_urdf(robot_urdf(name), base, locked, snap)


def tree_of_model(model):
    return tree_of_pinocchio(model, None, None)[0]


def same_numbers(one, other, bound):
    """Compare two trees that have the same joints."""
    assert [(j.name, j.kind, j.parent, j.mimic) for j in one.joints] == [
        (j.name, j.kind, j.parent, j.mimic) for j in other.joints
    ]
    bodies = ([tree.base, *(joint.body for joint in tree.joints)] for tree in (one, other))
    for a, b in zip(*bodies, strict=True):
        for name in ("mass", "centre_of_mass", "inertia"):
            assert np.abs(getattr(a, name) - getattr(b, name)).max() <= bound * (1 + abs(a.mass)), name
    for a, b in zip(one.joints, other.joints, strict=True):
        assert max(np.abs(getattr(a, name) - getattr(b, name)).max() for name in ("u", "S", "n")) <= bound
        if a.mimic is None:  # of joints that follow others a model of Pinocchio has no limits
            limits = [(joint.position_limits, joint.rate_limit, joint.effort_limit) for joint in (a, b)]
            assert limits[0] == limits[1]
    assert one.links.keys() == other.links.keys()
    for name, frame in one.links.items():
        assert frame.body == other.links[name].body
        assert max(np.abs(getattr(frame, k) - getattr(other.links[name], k)).max() for k in ("R", "S")) <= bound
    assert set(one.tips) == set(other.tips)


@pytest.mark.parametrize("base", ["fixed", "free"])
@pytest.mark.parametrize("name", ["panda", "kinova"])
def test_a_model_of_pinocchio_is_the_robot_of_its_urdf(name, base):
    root = [pin.JointModelFreeFlyer()] if base == "free" else []
    model = pin.buildModelFromUrdf(str(robot_urdf(name)), *root, mimic=True)
    tree, own = tree_of_pinocchio(model, None, None)
    assert own == base
    same_numbers(tree, tree_of_file(name, base), 64 * U)
    assert tree_of_pinocchio(model, "free" if base == "fixed" else "fixed", None)[1] != base


def test_quarter_turns_of_a_model_are_exact():
    for tree in (tree_of_pinocchio(pin.buildModelFromUrdf(str(robot_urdf("z1"))), None, None)[0], tree_of_file("z1")):
        turned = [joint.S for joint in tree.joints if np.abs(joint.S - np.eye(3)).max() > 0.5]
        assert all(np.isin(S, (-1.0, 0.0, 1.0)).all() for S in turned)


def test_panda_is_not_snapped_unless_asked():
    plain, snapped = tree_of_file("ur5_robot"), tree_of_file("ur5_robot", snap=1e-6)
    entries = [np.isin(joint.S, (-1.0, 0.0, 1.0)).all() for tree in (plain, snapped) for joint in tree.joints]
    assert (all(entries[:6]), all(entries[6:])) == (False, True)


# ---------------------------------------------------------------- fixed, locked and mimic joints


@pytest.mark.parametrize(
    ("name", "locked"),
    [
        ("panda", {"panda_joint3": 1.0, "panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02}),
        ("talos_reduced", {"arm_left_4_joint": -1.1, "leg_left_1_joint": 0.3, "torso_2_joint": 0.1}),
        ("kinova", {"j2s6s200_joint_1": math.pi / 2, "j2s6s200_joint_3": 0.5}),
    ],
    ids=("panda", "talos", "kinova"),
)
def test_locked_joints_are_folded_as_pinocchio_folds_them(name, locked):
    model = pin.buildModelFromUrdf(str(robot_urdf(name)))
    q = pin.neutral(model)
    for joint, value in locked.items():
        own = model.joints[model.getJointId(joint)]
        q[own.idx_q : own.idx_q + own.nq] = value if own.nq == 1 else (math.cos(value), math.sin(value))
    reduced = pin.buildReducedModel(model, [model.getJointId(joint) for joint in locked], q)
    tree = tree_of_file(name, locked=locked)
    same_numbers(tree, tree_of_model(reduced), 64 * U)
    assert set(locked) <= set(tree.frames)
    held = tree.frame(next(iter(locked)))
    frame = reduced.frames[reduced.getFrameId(next(iter(locked)))]
    assert (held.body, np.abs(held.R - frame.placement.translation).max() < 32 * U) == (frame.parentJoint, True)


def test_a_joint_locked_at_a_quarter_turn_is_exact():
    text = ARM.replace('rpy="0.1 -0.2 0.3"', "").replace('"revolute"', '"continuous"')
    tree = tree_of_urdf(text, "fixed", {"shoulder": math.pi / 2, "elbow": -math.pi}, None)
    assert tree.links["lower"].S.tolist() == [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
    assert tree.joints[0].name == "slide"  # what follows the elbow is held too


def mimic_arm(*rules):
    """An arm of hinges a, b, c, ... of which some follow others: (follower, leader, multiplier, offset)."""
    names = "abcd"
    text = '<robot name="r"><link name="0"/>' + "".join(f'<link name="L{name}"/>' for name in names)
    for parent, name in zip(("0", "La", "Lb", "Lc"), names, strict=True):
        rule = "".join(f'<mimic joint="{r[1]}" multiplier="{r[2]}" offset="{r[3]}"/>' for r in rules if r[0] == name)
        links = f'<parent link="{parent}"/><child link="L{name}"/>'
        text += f'<joint name="{name}" type="continuous">{links}{rule}</joint>'
    return text + "</robot>"


def test_what_follows_a_follower_follows_its_leader():
    tree = tree_of_urdf(mimic_arm(("a", "c", 2, 0.5), ("d", "a", -3, 0.25)), "fixed", None, None)
    assert [joint.mimic for joint in tree.joints] == [("c", 2.0, 0.5), None, None, ("c", -6.0, -1.25)]
    assert [joint.name for joint in tree.coordinates] == ["b", "c"]


def test_what_follows_a_locked_joint_is_held():
    text = mimic_arm(("a", "c", 2, 0.5), ("d", "a", -3, 0.25))
    tree = tree_of_urdf(text, "fixed", {"c": 0.5}, None)
    assert [joint.name for joint in tree.joints] == ["b"]
    held = tree_of_urdf(text, "fixed", {"c": 0.5, "a": 1.5, "d": -4.25}, None)
    assert all(np.array_equal(tree.links[name].S, held.links[name].S) for name in tree.links)
    apart = tree_of_urdf(text, "fixed", {"a": 1.5, "d": -2.75, "c": 0.25}, None)  # as told
    assert apart.source.locked == {"a": 1.5, "d": -2.75, "c": 0.25}
    with pytest.raises(ArgumentError, match="locked: expected 'c', which it follows"):
        tree_of_urdf(text, "fixed", {"a": 1.5}, None)


def test_a_leader_that_does_not_exist_is_told():
    with pytest.warns(
        hp.DynamicsWarning, match="joint 'b' follows 'x', which the robot does not have; it moves on its own"
    ):
        tree = tree_of_urdf(mimic_arm(("b", "x", 2, 0)), "fixed", None, None)
    assert [joint.mimic for joint in tree.joints] == [None] * 4


@pytest.mark.parametrize(
    ("joint", "position", "message"),
    [
        ("slide", 20, "locked: 'slide' is held at 20 m, beyond its limits, -1 to 1 m"),
        ("shoulder", -1.5, "locked: 'shoulder' is held at -1.5 rad, beyond its limits, -1 to 1 rad"),
    ],
)
def test_a_joint_that_is_held_beyond_its_limits_is_told(joint, position, message):
    with pytest.warns(hp.DynamicsWarning, match=f"^{message}$") as told:
        robot = hp.Mechanism.from_urdf(ARM, locked={joint: position})
    assert (len(told), told[0].filename) == (1, __file__)
    assert joint not in robot.names
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hp.Mechanism.from_urdf(ARM, locked={"shoulder": -1, "elbow": 20, "slide": 1})


def hinges(*parents):
    """Hinges of a model of Pinocchio, by the numbers of the joints that carry them."""
    model = pin.Model()
    for number, parent in enumerate(parents, 1):
        model.addJoint(parent, pin.JointModelRZ(), pin.SE3.Identity(), f"j{number}")
    return model


def ball():
    model = pin.Model()
    model.addJoint(0, pin.JointModelSpherical(), pin.SE3.Identity(), "ball")
    return model


@pytest.mark.parametrize(
    ("call", "message"),
    [
        *((lambda kind=kind: tree_of_urdf(ARM.replace('"prismatic"', f'"{kind}"'), "fixed", None, None),
           "joint 'slide': expected a type out of revolute, continuous, ") for kind in ("planar", "floating", "")),
        *((lambda rules=rules: tree_of_urdf(mimic_arm(*rules), "fixed", None, None),
           "joint 'b', mimic: expected a joint that does not follow this one")
          for rules in ([("b", "b", 1, 0)], [("a", "b", 1, 0), ("b", "a", 1, 0)])),
        (lambda: tree_of_pinocchio(ball(), None, None), "joint 'ball': expected a revolute, .* JointModelSpherical"),
        (lambda: tree_of_pinocchio(3, None, None), "model: expected a model of Pinocchio, got 3"),
        (lambda: tree_of_pinocchio(hinges(0, 0, 1), None, None), "joint 'j3': expected its place right behind"),
    ],
)  # fmt: skip
def test_what_is_no_tree_is_refused_by_name(call, message):
    with pytest.raises(ArgumentError, match=message):
        call()


# ---------------------------------------------------------------- masses that no rigid body has


def test_masses_are_taken_as_written_and_told():
    tree, model = tree_of_file("icub"), pin.buildModelFromUrdf(str(robot_urdf("icub")))
    assert [joint.body.mass for joint in tree.joints] == [inertia.mass for inertia in list(model.inertias)[1:]]
    assert "'r_hip_1'" in tree.mass_notes(False)[0]
    assert not tree_of_file("panda").mass_notes(True)


def test_the_mass_of_a_fixed_base_is_not_judged():
    bad = '<inertial><mass value="-1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    text = ARM.replace('<link name="base"/>', f'<link name="base">{bad}</link>')
    q = np.zeros(3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        hp.Mechanism.from_urdf(text).mass_matrix(q)
    for robot in (hp.Mechanism.from_urdf(text, base="free"), hp.Mechanism.from_urdf(text).with_base("free")):
        with pytest.warns(hp.DynamicsWarning, match="no rigid body has the mass properties of 'base'"):
            assert robot.mass_matrix(q)[0, 0] == -1


# ---------------------------------------------------------------- models of Pinocchio beyond URDF

MJCF = """<mujoco model="m"><compiler angle="radian"/><worldbody>
<body name="torso" pos="0 0 1"><freejoint name="root"/><geom type="sphere" size="0.1" mass="1"/>
  <body name="leg" pos="0.1 0 0">
    <joint name="h1" type="hinge" axis="0 1 0" range="-1 1"/>
    <joint name="h2" type="hinge" axis="1 0 0" pos="0 0 0.1"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.05" mass="0.5"/>
    <body name="foot" pos="0 0 -0.3"><joint name="s" type="slide" axis="0 0 1"/>
      <geom type="sphere" size="0.03" mass="0.1"/>
      <site name="tip" pos="0 0 -0.02"/></body>
  </body></body></worldbody></mujoco>"""


@pytest.fixture
def composite_model(tmp_path):
    path = tmp_path / "m.xml"
    path.write_text(MJCF)
    return pin.buildModelFromMJCF(str(path))


def test_a_body_with_several_joints_has_as_many(composite_model):
    tree, base = tree_of_pinocchio(composite_model, None, None)
    assert base == "free"
    assert [(j.name, j.kind, j.parent) for j in tree.joints] == [
        ("Composite_h1_1", "hinge", 0), ("Composite_h1_2", "hinge", 1), ("s", "slider", 2),
    ]  # fmt: skip
    assert [joint.n.tolist() for joint in tree.joints] == [[0, 1, 0], [1, 0, 0], [0, 0, 1]]
    assert [joint.u.tolist() for joint in tree.joints] == [[0.1, 0, 0], [0, 0, 0.1], [0, 0, -0.4]]
    assert [joint.body.mass for joint in tree.joints] == [0.0, 0.5, 0.1]
    assert tree.base.mass == 1.0
    assert tree.joints[0].position_limits == (-1.0, 1.0)
    assert (tree.tips, list(tree.links)) == (("foot",), ["torso", "leg", "foot"])
    assert tree.frame("tip").R.tolist() == [0, 0, -0.02]
    assert tree.frame("Composite_h1").body == 2


def test_screws_and_chains_of_a_model_move_as_in_pinocchio():
    rng, model = np.random.default_rng(5), pin.Model()
    pin.seed(5)
    inner, outer = pin.JointModelComposite(), pin.JointModelComposite()
    inner.addJoint(pin.JointModelRX(), pin.SE3.Random())
    inner.addJoint(pin.JointModelPZ(), pin.SE3.Random())
    outer.addJoint(pin.JointModelRY(), pin.SE3.Random())
    outer.addJoint(inner, pin.SE3.Random())
    axis = rng.normal(size=3)
    joints = [pin.JointModelHY(0.3), pin.JointModelHelicalUnaligned(axis / np.linalg.norm(axis), -0.2), outer]
    parent = 0
    for number, joint in enumerate(joints):
        parent = model.addJoint(parent, joint, pin.SE3.Random(), f"j{number}")
        model.inertias[parent] = pin.Inertia.FromBox(2.0, *rng.uniform(0.2, 1, 3))
    robot, data = hp.Mechanism.from_pinocchio(model), model.createData()
    assert [tree_of(robot).joints[k].kind for k in range(3)] == ["screw", "screw", "hinge"]
    q, qd, qdd = rng.uniform(-2, 2, (3, 4, model.nq))
    found, torques = robot.forward_kinematics(q), robot.inverse_dynamics(q, qd, qdd).tau
    for k in range(4):
        pin.forwardKinematics(model, data, q[k])
        assert_near(found.S[k, 0], data.oMi[parent].rotation, 32)
        assert_near(found.R[k, 0], data.oMi[parent].translation, 32)
        assert_near(torques[k], pin.rnea(model, data, q[k], qd[k], qdd[k]), 128)


def test_a_screw_comes_back_from_pinocchio():
    screw = hp.Screw(
        (0, 1, 0), (0, 0, 0), (0, 1, 1), pitch=0.1, name="s", limits=(-3, 9), body2=hp.Body(2, inertia=(1, 1, 1))
    )
    robot = hp.Mechanism([screw])
    back = hp.Mechanism.from_pinocchio(hp.to_pinocchio(robot).model)
    assert (back["s"].pitch, back["s"].limits) == (0.1, (-3.0, 9.0))
    np.testing.assert_allclose(
        back.inverse_dynamics([2.0], [1.0], [3.0]).tau, robot.inverse_dynamics([2.0], [1.0], [3.0]).tau, rtol=16 * U
    )


# ---------------------------------------------------------------- pairs

BOOM = hp.HingePair(u1=(1, 0, 2), u2=(-0.5, 0, 0), n=(0, 1, 0), name="boom", limits=(-1, 1), torque_limit=3)
STICK = hp.HingePair(u1=(2, 0, 0), u2=(-1, 0, 0.25), n=(0, -2, 0), home=rodrigues((1, 2, 3), 0.5), name="stick")
LIFT = Slider(u1=(0, 0, 1), u2=(0, 0.5, 0), n=(3, 0, 4), name="lift", rate_limit=2, torque_limit=9)


def test_pairs_in_series_share_their_bodies():
    mass = hp.Body(mass=2, centre_of_mass=(0.1, 0, 0), inertia=(1, 1, 1))
    lift = replace(LIFT, body1=hp.Body(3, inertia=(1, 1, 1)))
    tree = tree_of_pairs([replace(BOOM, body2=mass), STICK, lift], None, "fixed", "arm")
    assert (tree.name, [joint.parent for joint in tree.joints]) == ("arm", [0, 1, 2])
    assert [joint.u.tolist() for joint in tree.joints] == [[1, 0, 2], [2.5, 0, 0], [1, 0, 0.75]]
    assert [joint.body.mass for joint in tree.joints] == [2, 3, 0]
    assert tree.joints[0].body.centre_of_mass.tolist() == [0.6, 0, 0]
    assert tree.joints[2].n.tolist() == [0.6, 0, 0.8]
    assert tree.links["stick"].R.tolist() == [1, 0, -0.25]
    assert (list(tree.links), tree.tips) == (["base", "boom", "stick", "lift"], ("lift",))
    assert tree.joints[0].position_limits == (-1, 1)
    assert (tree.joints[0].effort_limit, tree.joints[2].rate_limit, tree.joints[1].rate_limit) == (3, 2, np.inf)
    assert tree.without_mass[3] == "lift"


def test_the_motion_of_pairs_is_that_of_their_equations():
    """Of the tree's own definition: each pair gives R2 and S2 from the body before."""
    tree = tree_of_pairs([BOOM, STICK], None, "fixed", None)
    q = (0.7, -1.3)
    R, S = np.zeros(3), np.eye(3)
    for pair, angle in zip((BOOM, STICK), q, strict=True):
        body1 = hp.BodyMotion(R=R, S=S)
        state = pair.forward_kinematics_from_body1(body1, angle)
        R, S = state.R2, state.S2
    origin, turn = np.zeros(3), np.eye(3)
    for joint, angle in zip(tree.joints, q, strict=True):
        origin, turn = origin + turn @ joint.u, turn @ joint.S @ rodrigues(joint.n, angle)
    seat = tree.links["stick"]
    assert np.abs(origin + turn @ seat.R - R).max() <= 64 * U
    assert np.abs(turn @ seat.S - S).max() <= 16 * U


def test_pairs_without_names_are_told_apart_by_their_places():
    hinge, slider = hp.HingePair((1, 0, 0), (0, 0, 0), (0, 0, 1)), hp.Slider((1, 0, 0), (0, 0, 0), (0, 0, 1))
    assert hp.Mechanism([hinge, slider]).names == ("hinge_pair", "slider")
    assert hp.Mechanism([hinge, slider, hinge, BOOM]).names == ("hinge_pair_1", "slider", "hinge_pair_3", "boom")
    branches = hp.Mechanism([slider] * 11, parents=[0] * 11).names  # siblings by name, which are in the order given
    assert (branches[0], branches[9], len(branches)) == ("slider_01", "slider_10", 11)
    varied = hp.HingePair(np.arange(6.0).reshape(2, 3), (0, 0, 0), (0, 0, 1))
    robot = hp.Mechanism([varied, varied])
    assert robot.names[1] == "hinge_pair_2"
    assert robot.forward_kinematics((0, 0))["hinge_pair_2"].R.tolist() == [[0, 2, 4], [6, 8, 10]]


def test_a_joint_comes_back_as_a_pair():
    tree = tree_of_file("panda")
    knee = pair_of(tree, 4)
    expected = hp.load_robot_hinge("panda", "panda_joint4")
    for name in ("u1", "u2", "n", "home"):
        assert np.array_equal(getattr(knee, name), getattr(expected, name)), name
    assert (knee.limits, knee.torque_limit, knee.rate_limit) == (expected.limits, 87.0, expected.rate_limit)
    assert knee.body2.mass == expected.body2.mass
    finger = pair_of(tree, 8)
    assert (type(finger), finger.limits) == (Slider, (0.0, 0.04))
    assert np.array_equal(finger.n, tree.joints[7].S[:, 1])
    continuous = tree_of_file("kinova")
    assert pair_of(continuous, 1).limits is None


# ---------------------------------------------------------------- payloads and frames


def test_a_payload_adds_its_mass_where_it_is():
    tree = tree_of_file("panda")
    body = hp.Body(mass=3, centre_of_mass=(0, 0, 0.1), inertia=(0.1, 0.2, 0.15))
    laden = add_body(tree, "panda_hand", body)
    model = pin.buildModelFromUrdf(str(robot_urdf("panda")), mimic=True)
    frame = model.frames[model.getFrameId("panda_hand", pin.FrameType.BODY)]
    inertia = pin.Inertia(3, np.array((0, 0, 0.1)), np.diag((0.1, 0.2, 0.15)))
    model.appendBodyToJoint(frame.parentJoint, inertia, frame.placement)
    same_numbers(laden, tree_of_model(model), 64 * U)
    assert tree.joints[6].body.mass < 2
    (note, _) = add_body(tree, "panda_hand", hp.Body()).mass_notes(True)
    assert note.startswith("payload of panda_hand: no mass is given")
    on_base = add_body(tree, "panda_link0", body)
    assert on_base.base.mass == tree.base.mass + 3


# ---------------------------------------------------------------- what users hold


@pytest.mark.parametrize("backend", ["auto", "numpy", "compiled"])
@pytest.mark.parametrize("base", ["fixed", "free"])
def test_a_robot_without_joints_has_empty_coordinates(base, backend):
    robot, columns = hp.load_robot("quadrotor_base", base=base), 6 * (base == "free")
    for shape in ((), (4,)):
        q = np.zeros((*shape, 0))
        assert robot.jacobian(q, backend=backend).shape == (*shape, 6, columns)
        assert robot.mass_matrix(q, backend=backend).shape == (*shape, columns, columns)
        assert robot.forward_kinematics(q, q, q, backend=backend).R.shape == (*shape, 1, 3)
        assert robot.inverse_dynamics(q, q, q, backend=backend).tau.shape == (*shape, 0)
        assert robot.forward_dynamics(q, q, q, backend=backend).qdd.shape == (*shape, 0)
    assert len(robot.base_parameters().names) == (10 if base == "free" else 0)


@pytest.mark.parametrize("name", ["tool", "universe_tool"])
def test_frames_of_a_model_have_one_place_for_a_name(name):
    model = pin.buildSampleModelManipulator()
    for kind, x in ((pin.FrameType.OP_FRAME, 0.0), (pin.FrameType.SENSOR, 1.0)):
        placement = pin.SE3(np.eye(3), np.array((x, 0, 0)))
        model.addFrame(pin.Frame("tool", 0 if name != "tool" else 2, placement, kind))
    with pytest.raises(ArgumentError, match="frame 'tool': expected one place"):
        hp.Mechanism.from_pinocchio(model)
    model.frames[-1].placement = pin.SE3.Identity()
    assert "tool" in tree_of(hp.Mechanism.from_pinocchio(model)).frames


@pytest.mark.parametrize("read", ["urdf", "pinocchio"])
def test_damping_friction_and_equal_limits_are_kept(read):
    text = ARM.replace('lower="-1" upper="1"', 'lower="0.5" upper="0.5"')
    text = text.replace("</joint>", '<dynamics damping="0.25" friction="3"/></joint>', 1)
    model = pin.buildModelFromXML(text)
    robot = hp.Mechanism.from_urdf(text) if read == "urdf" else hp.Mechanism.from_pinocchio(model)
    damped = [joint for joint in tree_of(robot).joints if joint.load.damping]
    assert [(joint.load.damping, joint.load.friction) for joint in damped] == [(0.25, 3.0)]
    assert damped[0].name == model.names[1]
    heading, first = str(robot).splitlines()[1:3]
    assert heading.split()[-2:] == ["damping", "friction"]
    assert first.split()[-2:] == ["0.25", "3"]
    held = [joint.name for joint in tree_of(robot).joints if joint.position_limits == (0.5, 0.5)]
    assert held == ["shoulder", "slide"]
    assert [robot[name].limits for name in held] == [(0.5, 0.5)] * 2


def test_a_body_without_a_link_does_not_take_the_place_of_another():
    model = pin.Model()
    for name in ("upper", "lower"):
        model.addJoint(model.njoints - 1, pin.JointModelRX(), pin.SE3(np.eye(3), np.array((0, 0, 1.0))), name)
    model.addFrame(pin.Frame("lower", 1, pin.SE3.Identity(), pin.FrameType.BODY))
    links = tree_of(hp.Mechanism.from_pinocchio(model)).links
    assert {name: frame.body for name, frame in links.items()} == {"universe": 0, "lower": 1, "lower_": 2}


def test_a_pair_of_a_robot_leaves_out_masses_that_no_body_has():
    body = '<inertial><mass value="-1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    joint = '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>'
    robot = hp.Mechanism.from_urdf(f'<robot name="r"><link name="a"/><link name="b">{body}</link>{joint}</robot>')
    with pytest.warns(hp.DynamicsWarning, match="body2 of 'j': no rigid body has its .* expected a number above 0"):
        assert robot["j"].body2 is None
