"""Loops and struts in MJCF: written, read back, and computed by MuJoCo."""

import xml.etree.ElementTree as ET

import mujoco
import numpy as np
import pytest

import hingepair as hp
from support.linkages import KINDS, bar, four_bar

GRAVITY = (0, 0, -9.81)
Y = (0, 1, 0)
STATES = np.random.default_rng(5).uniform(-0.2, 0.2, (3, 7, 1))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("base", ["fixed", "free"])
def test_a_loop_is_read_as_it_was_written(kind, base):
    robot = four_bar(kind, base, Y)
    back = hp.Mechanism.from_mjcf(hp.to_mjcf(robot))
    assert (back.names, back.base) == (robot.names, base)
    assert np.abs(back.all_coordinates(STATES[0]) - robot.all_coordinates(STATES[0])).max() < 1e-14
    assert np.abs(back.inverse_dynamics(*STATES).tau - robot.inverse_dynamics(*STATES).tau).max() < 1e-12
    kinds = [loop.kind for loop in back.loops]
    assert kinds == (["ball", "ball"] if kind == "hinge" else [kind])  # two points of the axis
    assert back.opened().names == robot.opened().names


@pytest.mark.parametrize("kind", KINDS)
def test_accelerations_are_those_of_mujoco(kind):
    robot = four_bar(kind, n=Y).with_strut("a", "base", "damper", stiffness=200, free_length=0.5, damping=9)
    root = ET.fromstring(hp.to_mjcf(robot))
    for element in root.find("equality"):  # as hard as MuJoCo allows
        element.set("solimp", "0.9999 0.9999 0.001 0.5 2")
    model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))
    data = mujoco.MjData(model)
    for q, qd, tau in zip(*STATES, strict=True):
        data.qpos, data.qvel = robot.all_coordinates(q, qd, 0 * q)[:2]
        data.qfrc_applied[0] = tau[0]
        mujoco.mj_forward(model, data)
        wanted = robot.all_coordinates(q, qd, robot.forward_dynamics(q, qd, tau).qdd)[2]
        assert np.abs(data.qacc - wanted).max() < 1e-3 * np.abs(wanted).max()
        strut = robot.struts(q, qd)["damper"]
        assert abs(data.ten_length[0] - strut.length) < 1e-12
        assert abs(data.ten_velocity[0] - strut.rate) < 1e-12
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    assert np.abs(data.efc_pos[: data.ne]).max() < 1e-12  # "assembled"


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
    assert np.abs(first.R - second.R - data.efc_pos[:3]).max() < 1e-14
    if not closed:  # the vector part of the quaternion between them
        turn = hp.rotation_log(second.S.T @ first.S)
        angle = np.linalg.norm(turn)
        half = turn / angle * np.sin(angle / 2)
        assert np.abs(np.abs(half) - np.abs(data.efc_pos[3:6])).max() < 1e-12


def test_a_straight_tendon_is_a_strut():
    tendon = """<tendon><spatial name="t" stiffness="70" damping="2" {}>
      <site site="g"/><site site="s"/></spatial></tendon>"""
    without = hp.Mechanism.from_mjcf(BODIES.format(""))
    for springs in ('springlength="0.4"', 'springlength="0.2 0.5" limited="true" range="0.1 2"'):
        text = BODIES.format(tendon.format(springs))
        robot, model = hp.Mechanism.from_mjcf(text), mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        for q, qd in zip(*np.random.default_rng(2).uniform(-2, 2, (2, 20, 3)), strict=True):
            data.qpos, data.qvel = q, qd
            mujoco.mj_forward(model, data)
            strut = robot.struts(q, qd)["t"]
            assert abs(strut.length - data.ten_length[0]) < 1e-14
            passive = data.qfrc_spring + data.qfrc_damper
            found = robot.inverse_dynamics(q, qd, 0 * q).tau - without.inverse_dynamics(q, qd, 0 * q).tau
            assert np.abs(passive + found).max() < 1e-12


def test_forces_that_mjcf_cannot_hold_are_named():
    hatch = hp.Mechanism([bar("lid", (0, 0, 0), 1, Y)]).with_frame("a", "base", R=(0.3, 0, -0.2))
    hatch = hatch.with_frame("b", "lid", R=(0.5, 0, 0))
    gas = hatch.with_strut("a", "b", "gas", force=hp.GasSpring(150, 200, 0.2, friction=10), free_length=0.6)
    back = hp.Mechanism.from_mjcf(hp.to_mjcf(gas))
    states = STATES[0] - 0.5, STATES[1]
    assert np.abs(back.struts(*states)["gas"].force - gas.struts(*states)["gas"].force).max() < 1e-11
    for force in (([0.1, 0.2, 0.3], [3, 2, 3]), hp.GasSpring(150, 200, 0.2, exponent=1.3), np.maximum):
        with pytest.warns(hp.DynamicsWarning, match="strut gas"):
            hp.to_mjcf(hatch.with_strut("a", "b", "gas", force=force, free_length=0.6))
