"""Robots written as MJCF: MuJoCo reads them, and from_mjcf reads them back, with the loops of MJCF."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.mechanism import tree_of
from support.near import U

ARM = """<robot name="arm"><link name="ROOT"><inertial><mass value="3"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>{links}
<joint name="lift" type="prismatic"><parent link="ROOT"/><child link="l1"/><origin xyz="0 0.1 1" rpy="0.1 0.2 0.3"/>
  <axis xyz="0 1 1"/><limit lower="-1" upper="1" effort="5" velocity="6"/><dynamics friction="2"/></joint>
<joint name="bend" type="continuous"><parent link="l1"/><child link="l2"/><origin xyz="0 0.1 -0.4"/>
  <axis xyz="1 1 0"/><dynamics damping="0.5"/></joint>
<joint name="flange" type="fixed"><parent link="l2"/><child link="l3"/><origin xyz="0 0 -0.4" rpy="0 0.2 0"/></joint>
<joint name="grip" type="revolute"><parent link="l2"/><child link="l4"/><origin xyz="0.1 0 -0.4"/><axis xyz="0 0 1"/>
  <limit lower="-2" upper="2" effort="5" velocity="6"/><mimic joint="bend" multiplier="-0.5" offset="0.1"/></joint>
</robot>"""
LINKS = "".join(
    f"""<link name="l{k}"><inertial><origin xyz="0.0{k} 0.01 0"/><mass value="{k}"/>
<inertia ixx="0.{k}" iyy="0.{k}" izz="0.{k}" ixy="0.01" ixz="0" iyz="0"/></inertial></link>"""
    for k in range(1, 5)
)


def arm(root="pedestal", **options):
    return hp.Mechanism.from_urdf(ARM.replace("ROOT", root).format(links=LINKS), **options)


def forces(robot, q, qd, qdd):
    found = robot.inverse_dynamics(q, qd, qdd, joint_loads=True, backend="numpy")
    return found.tau, robot.mass_matrix(q, backend="numpy"), robot.forward_kinematics(q, frames=("l3", "l4")).R


@pytest.mark.slow
@pytest.mark.parametrize("base", ["fixed", "free"])
@pytest.mark.parametrize("root", ["pedestal", "world"])
def test_a_robot_in_mjcf_comes_back(base, root):
    robot = arm(root, base=base).with_frame("tool", "l3", R=(0, 0, 0.1))
    robot = robot.with_joint_loads({"bend": hp.HingeLoad(stiffness=3, rest=0.2, damping=0.5)})
    back = hp.Mechanism.from_mjcf(hp.to_mjcf(robot))
    assert (back.base, back.names, back.name) == (base, robot.names, "arm")
    assert back.joint_loads == robot.joint_loads
    assert (back.position_limits == robot.position_limits).all()
    assert (back.effort_limits == robot.effort_limits).all()
    assert tree_of(back).frame("tool") is not None
    state = np.random.default_rng(2).uniform(-1, 1, (3, 4, 2))
    for got, expected in zip(forces(back, *state), forces(robot, *state), strict=True):
        assert np.abs(got - expected).max() <= 256 * U * np.abs(expected).max()


def test_mujoco_moves_the_written_robot():
    text = ARM.replace('<mimic joint="bend" multiplier="-0.5" offset="0.1"/>', "").format(links=LINKS)
    robot = hp.Mechanism.from_urdf(text, locked={"grip": 0.3})
    model = mujoco.MjModel.from_xml_string(hp.to_mjcf(robot, gravity=(1, 2, -9)))
    data = mujoco.MjData(model)
    data.qpos, data.qvel, data.qfrc_applied = (0.1, 0.5), (2, -3), (0.5, 0.25)
    mujoco.mj_forward(model, data)
    found = robot.forward_dynamics(
        data.qpos, data.qvel, data.qfrc_applied, gravity=(1, 2, -9), joint_loads=True, backend="numpy"
    )
    assert np.abs(found.qdd - data.qacc).max() <= 256 * U * np.abs(data.qacc).max()


def test_joints_without_a_body_between_them_are_joints_of_one_body():
    pose = 'pos="0.1 0.2 -0.3" quat="0.8 0.6 0 0"'
    text = f"""<mujoco><compiler angle="radian"/><worldbody><body name="trunk"><freejoint/>{GEOM}
      <body name="leg" {pose}><joint name="hx" axis="1 0 0.3" pos="0 0 0.1"/>
      <joint name="hz" type="slide" axis="0 1 1"/>
      <joint name="hy" axis="0 1 0" pos="0.05 0 0" ref="0.3"/>{GEOM}</body></body></worldbody></mujoco>"""
    robot = hp.Mechanism.from_mjcf(text)
    back = hp.Mechanism.from_mjcf(hp.to_mjcf(robot))
    assert back.names == robot.names == ("hx", "hz", "hy")
    state = np.random.default_rng(4).uniform(-1, 1, (3, 4, 3))
    for got, expected in (
        (back.inverse_dynamics(*state).tau, robot.inverse_dynamics(*state).tau),
        (back.mass_matrix(state[0]), robot.mass_matrix(state[0])),
        (back.forward_kinematics(state[0], frames="leg").R, robot.forward_kinematics(state[0], frames="leg").R),
    ):
        assert np.abs(got - expected).max() <= 256 * U * np.abs(expected).max()


GEOM = '<geom type="box" size=".1 .2 .3" mass="2"/>'


BODIES = """<mujoco><worldbody>
  <body name="a"><joint name="ja" axis="0 1 0"/><geom size="0.1" mass="1"/>
    <body name="b" pos="0.3 0 0"><joint name="jb" axis="0 1 0"/><geom size="0.1" mass="1"/>
    <site name="s" pos="0.2 0 0"/></body></body>
  <body name="c" pos="1 0 0"><joint name="jc" axis="0 1 0"/><geom size="0.1" mass="1" pos="0.2 0 0"/></body>
  <site name="g" pos="0.4 0 0.7"/></worldbody>{}</mujoco>"""


@pytest.mark.parametrize(
    "equality",
    [
        '<connect name="k" body1="b" body2="c" anchor="0.3 0 0.6"/>',
        '<weld name="k" body1="b" body2="c" anchor="0.1 0 0.2" relpose="0.3 0.1 0.2 0.9 0 0.3 0"/>',
    ],
)
def test_loops_between_bodies_are_where_mujoco_has_them(equality):
    text = BODIES.format(f"<equality>{equality}</equality>")
    closed = "connect" in equality
    with pytest.warns(hp.DynamicsWarning, match="left open") if not closed else np.errstate():
        robot = hp.Mechanism.from_mjcf(text)  # a weld of three bars leaves no freedom
    if closed:
        assert [(loop.name, loop.kind) for loop in robot.loops] == [("k", "ball")]
        robot = robot.opened()
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qpos = 0.3, -0.2, 0.5
    mujoco.mj_forward(model, data)
    state = robot.forward_kinematics(data.qpos, frames=("k_1", "k_2"))
    first, second = state["k_1"], state["k_2"]
    assert np.abs(first.R - second.R - data.efc_pos[:3]).max() < 16 * U
    if not closed:  # the vector part of the quaternion between them
        turn = hp.rotation_log(second.S.T @ first.S)
        angle = np.linalg.norm(turn)
        half = turn / angle * np.sin(angle / 2)
        assert np.abs(np.abs(half) - np.abs(data.efc_pos[3:6])).max() < 16 * U
