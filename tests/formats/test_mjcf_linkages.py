"""Loops of MJCF, where MuJoCo has them."""

import mujoco
import numpy as np
import pytest

import hingepair as hp
from support.near import U

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
