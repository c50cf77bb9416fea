"""Springs, dampers and dry friction of joints (T14): against MuJoCo, and against what they leave."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import hingepair as hp
from hingepair.errors import ArgumentError

MJCF = """
<mujoco model="crane"><compiler angle="radian"/><option timestep="0.002"><flag contact="disable"/></option>
<worldbody><body name="post" pos=".1 .2 .3" euler=".1 .2 .3"><geom size=".1" mass="1"/>
  <body name="boom" pos=".1 0 .2" euler=".3 0 .4">
    <joint name="turn" axis="1 2 3" pos=".05 .01 0" ref=".4" stiffness="3" springref=".2" damping=".5"
      frictionloss=".3" armature=".02" range="-3 3" actuatorfrcrange="-5 5"/>
    <joint name="reach" type="slide" axis="0 1 1" pos=".1 .1 .1" ref="-.2" damping=".1" stiffness="20"
      springref=".1"/>
    <geom type="box" size=".1 .2 .3" pos=".1 .2 .1" mass="2" euler="1 2 3"/><site name="tool" pos="0 0 .4"/>
    <body name="bracket" pos="0 0 .3" euler="0 .5 0"><geom type="box" size=".1 .05 .1" mass=".5"/>
      <body name="load" pos=".3 0 0"><joint name="swing" axis="0 0 1" frictionloss=".05" damping=".01"/>
        <geom type="capsule" size=".05" fromto="0 0 0 .4 .1 0" mass=".7"/></body></body>
    <body name="arm" pos="-.3 0 0"><joint name="bend" axis="0 1 0"/>
      <geom type="capsule" size=".05" fromto="0 0 0 .4 .1 0" mass=".7"/></body>
  </body></body></worldbody></mujoco>
"""
LINKS = ("post", "boom", "bracket", "load", "arm")
PENDULUM = """<robot name="pendulum"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.5"/>
<mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="2" effort="10" velocity="3"/><dynamics damping="0.2" friction="0.3"/></joint></robot>"""
U = 2.0**-53


def crane():
    model = mujoco.MjModel.from_xml_string(MJCF)
    return hp.Mechanism.from_mjcf(model), model, mujoco.MjData(model)


def states(dof, rows, seed=5):
    return np.random.default_rng(seed).uniform(-1, 1, (rows, 3, dof))


def test_a_model_in_mjcf_stands_and_moves_as_in_mujoco():
    robot, model, data = crane()
    assert robot.names == ("turn", "reach", "swing", "bend")
    for q, rate, tau in states(4, 5):
        qd = rate + 3 * np.sign(rate)  # MuJoCo's friction acts against q'' + 105 q', of which q' decides here
        data.qpos, data.qvel, data.qfrc_applied = q, qd, tau
        mujoco.mj_forward(model, data)
        state = robot.forward_kinematics(q, frames=(*LINKS, "tool"))
        expected = [*(data.body(name).xpos for name in LINKS), data.site("tool").xpos]
        assert np.abs(state.R - expected).max() <= 16 * U
        turned = [data.body(name).xmat.reshape(3, 3) for name in LINKS]
        assert np.abs(state.S[:5] - turned).max() <= 16 * U
        got = robot.forward_dynamics(q, qd, tau, joint_loads=True, backend="numpy").qdd
        left = robot.mass_matrix(q) @ (got - data.qacc)  # accelerations themselves err by the condition of M
        sizes = np.abs(robot.mass_matrix(q)) @ np.abs(data.qacc) + 100
        assert (np.abs(left) <= 64 * U * sizes).all()
        assert (
            np.abs(robot.forward_dynamics(q, qd, tau, joint_loads=False, backend="numpy").qdd - data.qacc).max() > 0.1
        )


def test_what_mjcf_says_of_joints_is_kept_and_printed():
    robot, _, _ = crane()
    assert robot.armature.tolist() == [0.02, 0, 0, 0]
    assert robot.position_limits[0].tolist() == [-3, 3]
    assert robot.effort_limits.tolist() == [5, np.inf, np.inf, np.inf]
    assert robot.joint_loads == {
        "turn": hp.HingeLoad(stiffness=3, rest=0.2, damping=0.5, friction=0.3, stops=(-3, 3)),
        "reach": hp.HingeLoad(stiffness=20, rest=0.1, damping=0.1),
        "swing": hp.HingeLoad(damping=0.01, friction=0.05),
    }
    lines = str(robot).splitlines()
    assert lines[1].split()[-5:] == ["armature", "stiffness", "rest", "damping", "friction"]
    assert lines[2].split()[-5:] == ["0.02", "3", "0.2", "0.5", "0.3"]
    assert lines[-1] == (
        "dynamics: left out are springs, damping and dry friction of 3 joints, unless joint_loads=True"
    )
    with pytest.warns(hp.DynamicsWarning) as told:
        text = hp.to_urdf(robot)
    assert ["springs" in str(one.message) for one in told][:2] == [False, True]
    assert hp.Mechanism.from_urdf(text).joint_loads["swing"] == hp.HingeLoad(damping=0.01, friction=0.05)


@pytest.mark.parametrize("base", ["fixed", "free"])
def test_inverse_dynamics_takes_back_what_forward_dynamics_gives(base):
    model = crane()[1]
    robot = hp.Mechanism.from_mjcf(model, base=base)
    q, qd, tau = np.moveaxis(states(4, 6), 0, 1)
    zero = {"outputs": ("qdd",)} if base == "fixed" else {}
    found = robot.forward_dynamics(q, qd, tau, joint_loads=True, backend="numpy", **zero)
    motion = None
    if base == "free":
        still = np.zeros(3)
        motion = hp.BodyMotion(R=still, S=np.eye(3), v=still, omega=still, a=found.a1, alpha=found.alpha1)
    back = robot.inverse_dynamics(q, qd, found.qdd, base_motion=motion, joint_loads=True, backend="numpy")
    assert np.abs(back.tau - tau).max() <= 1000 * U * 30
    plain = robot.inverse_dynamics(q, qd, found.qdd, base_motion=motion, joint_loads=False, backend="numpy").tau
    rate = np.sign(qd)
    loads = [robot.joint_loads.get(name, hp.HingeLoad()) for name in robot.names]
    expected = [
        load.stiffness * (q[:, k] - load.rest) + load.damping * qd[:, k] + load.friction * rate[:, k]
        for k, load in enumerate(loads)
    ]
    assert np.abs(back.tau - plain - np.stack(expected, axis=-1)).max() <= 100 * U * 30


def test_loads_of_followers_are_handed_to_their_leader():
    text = PENDULUM.replace("</robot>", "").replace('friction="0.3"', 'friction="0"')
    text += """<link name="end"><inertial><mass value="1"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      <joint name="gear" type="continuous"><parent link="rod"/><child link="end"/><axis xyz="0 1 0"/>
      <dynamics damping="0.5" friction="0.25"/><mimic joint="pivot" multiplier="-2" offset="0.3"/></joint></robot>"""
    robot = hp.Mechanism.from_urdf(text)
    rows = {loads: robot.inverse_dynamics([0.1], [0.7], [0], joint_loads=loads).tau for loads in (True, False)}
    assert rows[True] - rows[False] == pytest.approx(0.2 * 0.7 + 4 * 0.5 * 0.7 + 2 * 0.25, rel=8 * U)
    qdd = robot.forward_dynamics([0.1], [0.7], rows[True], joint_loads=True).qdd
    assert abs(qdd).max() <= 100 * U
    at_rest = robot.forward_dynamics([0.0], [0.0], [0.4], joint_loads=True).qdd
    assert at_rest.tolist() == [0]  # less than the friction of the follower, twice 0.25 N m


def test_dry_friction_holds_a_joint_at_rest_as_in_mujoco():
    robot = hp.Mechanism.from_urdf(PENDULUM)
    held, slips = (robot.forward_dynamics([angle], [0], [0], joint_loads=True).qdd.item() for angle in (0.03, 0.1))
    assert held == 0  # m g l sin(0.03) is below 0.3 N m
    assert slips == pytest.approx((-2 * 9.81 * 0.5 * np.sin(0.1) + 0.3) / 0.6, rel=8 * U)
    assert np.isnan(robot.forward_dynamics([0.1], [np.nan], [0], joint_loads=True).qdd).all()


@pytest.mark.slow
def test_steps_with_dampers_are_those_of_mujoco():
    _, model, data = crane()
    model.dof_damping *= 200  # beyond what a damper of the rate at the start would be stable with
    model.dof_frictionloss[:] = 0
    data.qpos = q = np.array((0.3, 0.1, -0.2, 0.4))
    for _ in range(100):
        mujoco.mj_step(model, data)
    found = hp.Mechanism.from_mjcf(model).rollout(q, np.zeros(4), 0.0, 0.002, steps=100, joint_loads=True)
    assert np.abs(found.q[-1] - data.qpos).max() <= 8192 * U


def test_a_rollout_comes_to_rest_by_dry_friction():
    robot = hp.Mechanism.from_urdf(PENDULUM)
    for method in ("semi_implicit", "rk4"):
        r = robot.rollout([0.3], [0.0], 0.0, 1e-3, steps=8000, method=method, joint_loads=True)
        assert abs(r.qd[-1]).max() <= 8192 * U
        assert 0 < abs(r.q[-1, 0]) < 0.0306  # where gravity is within the friction
        assert np.ptp(r.q[-100:]) <= 8192 * U


@pytest.mark.slow(1.6)
def test_derivatives_hold_dampers_and_springs():
    robot, _, _ = crane()
    q, qd, tau = states(4, 1)[0]
    d = robot.forward_dynamics_derivatives(q, qd, tau, joint_loads=True)
    step = 1e-5
    for name, column in (("qdd_q", 0), ("qdd_qd", 1)):
        for k in range(4):
            change = np.zeros((2, 4))
            change[column, k] = step
            ahead, behind = (
                robot.forward_dynamics(q + sign * change[0], qd + sign * change[1], tau, joint_loads=True).qdd
                for sign in (1, -1)
            )
            slope = (ahead - behind) / (2 * step)
            assert np.abs(d[name][:, k] - slope).max() <= 10 * step * step * (1 + np.abs(slope).max())
    prepared = robot.prepare("forward_dynamics", joint_loads=True)
    assert prepared(q, qd, tau).qdd.tolist() == robot.forward_dynamics(q, qd, tau, joint_loads=True).qdd.tolist()
    assert np.allclose(prepared.jacobian((q, qd, tau))["qdd"]["qd"], d.qdd_qd, rtol=0, atol=8192 * U)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('type="slide"', 'type="ball"', "joint 'reach': expected a hinge or a slide joint"),
        ('name="bend" axis="0 1 0"', 'name="bend" type="free"', "model: expected MJCF that MuJoCo can read"),
        ("<mujoco", "<nonsense", "model: expected MJCF that MuJoCo can read"),
    ],
)
def test_what_is_no_tree_of_hinges_is_refused(old, new, message):
    with pytest.raises(ArgumentError, match=message):
        hp.Mechanism.from_mjcf(MJCF.replace(old, new, 1))


def test_what_is_not_read_from_mjcf_is_named():
    text = MJCF.replace("</worldbody>", '</worldbody><actuator><motor joint="bend"/></actuator>')
    with pytest.warns(hp.DynamicsWarning, match="^crane: not read from MJCF are 1 actuators$"):
        hp.Mechanism.from_mjcf(text)


def test_loads_of_joints_can_be_replaced():
    robot, _, _ = crane()
    changed = robot.with_joint_loads({"bend": hp.HingeLoad(friction=2, stops=(-1, 1))})
    assert changed.joint_loads == robot.joint_loads | {"bend": hp.HingeLoad(friction=2, stops=(-1, 1))}
    assert changed.position_limits[3].tolist() == [-1, 1]
    assert robot.with_joint_loads(robot.joint_loads).joint_loads == robot.joint_loads
    q, qd = np.zeros(4), np.array((0, 0, 0, 0.5))
    added = [one.inverse_dynamics(q, qd, q, joint_loads=True, backend="numpy").tau for one in (changed, robot)]
    assert (added[0] - added[1])[3] == pytest.approx(2, rel=16 * U)
