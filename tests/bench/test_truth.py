"""The 60-digit reference of robots holds for joints of every kind, sliders and followers too."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.mechanism import tree_of
from hingepair.mechanism.tree import Frame
from support.exact import Exact
from support.near import U

FOLLOWERS = """<robot name="r"><link name="a"/>
<link name="b"><inertial><origin xyz="0.1 0 0.2"/><mass value="2"/>
<inertia ixx=".3" iyy=".4" izz=".5" ixy=".01" ixz="0" iyz="0"/></inertial></link>
<link name="c"><inertial><origin xyz="0 0.1 0"/><mass value="1"/>
<inertia ixx=".1" iyy=".2" izz=".25" ixy="0" ixz="0" iyz=".02"/></inertial></link>
<link name="d"><inertial><origin xyz="0 0 0.3"/><mass value="0.5"/>
<inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j1" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 1" rpy="0.3 0 0"/>
<axis xyz="0 1 0"/><limit effort="1" velocity="1"/></joint>
<joint name="j2" type="prismatic"><parent link="b"/><child link="c"/><origin xyz="0.5 0 0" rpy="0.2 0 0"/>
<axis xyz="0.6 0 0.8"/><limit effort="1" velocity="1"/></joint>
<joint name="j3" type="revolute"><parent link="c"/><child link="d"/><origin xyz="0 0.3 0"/><axis xyz="1 0 0"/>
<mimic joint="j1" multiplier="-2" offset="0.25"/><limit effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.slow
def test_the_truth_holds_for_joints_of_every_kind():
    robot = hp.Mechanism.from_urdf(FOLLOWERS)
    rng = np.random.default_rng(5)
    q, v, w = rng.uniform(-1, 1, (3, 1, robot.dof))
    joint = tree_of(robot).joints[-1].name
    state, body = robot.forward_kinematics(q, frames=(joint,)), len(tree_of(robot).joints)
    frame = Frame(body, np.zeros(3), np.eye(3))
    truth = Exact(tree_of(robot), frame, False, {"q": q, "qd": v, "qdd": w})
    motion = truth.motion
    np.testing.assert_allclose(motion["R"].astype(float), state[joint].R, rtol=0, atol=8 * U)
    np.testing.assert_allclose(motion["S"].astype(float), state[joint].S, rtol=0, atol=8 * U)
    np.testing.assert_allclose(truth.jacobian().astype(float), robot.jacobian(q, joint), rtol=0, atol=8 * U)
    np.testing.assert_allclose(truth.mass_matrix().astype(float), robot.mass_matrix(q), rtol=256 * U)
    tau = truth.forces[2].astype(float)
    np.testing.assert_allclose(tau, robot.inverse_dynamics(q, v, w).tau, rtol=256 * U)
    np.testing.assert_allclose(truth.accelerations(tau).astype(float), w, rtol=4096 * U)
