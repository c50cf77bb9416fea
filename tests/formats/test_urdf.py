"""Pairs in URDF: what is written is read back, and what is read is what Pinocchio reads."""

from __future__ import annotations

import math
import re
from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest

from hingepair.errors import DynamicsWarning
from hingepair.formats.model_writers import to_urdf
from hingepair.mechanism.bodies.body_motion import BodyMotion
from hingepair.mechanism.building.urdf import from_urdf
from hingepair.rotations.matrices import rotation_exp
from support import states
from support.exported import ARM, corner_pair
from support.near import U

pytestmark = pytest.mark.filterwarnings("ignore:.*no mass properties:hingepair.DynamicsWarning")


@pytest.mark.slow
def test_what_was_written_is_read_back():
    for k in range(30):
        pair = corner_pair(k)
        back = from_urdf(to_urdf(pair), "hinge", body2_frame="body2")
        assert np.array_equal(back.u1, pair.u1)
        assert np.array_equal(back.u2, pair.u2)
        assert np.abs(back.home - pair.home).max() <= 16 * U, k
        assert np.abs(back.n - pair.n).max() <= 16 * U, k


def test_a_joint_is_read_as_parent_and_child_link():
    pair = from_urdf(ARM, "shoulder")
    home = pin.rpy.rpyToMatrix(0.1, -0.2, 0.3)
    assert np.array_equal(pair.u1, (0, 0, 1))
    assert np.array_equal(pair.u2, (0, 0, 0))
    assert np.abs(pair.home - home).max() <= 8 * U
    assert np.abs(pair.n - home[:, 2]).max() <= 8 * U
    assert pair.name == "shoulder"


def test_a_mimic_joint_is_a_hinge_and_any_axis_is_normalised():
    assert np.array_equal(from_urdf(ARM, "follower").n, (0, 1, 0))


def welded_robot(rng):
    """Side and top fixed to middle, middle to parent, which carries the hinge; child carries near, near far."""
    stem = ("top", "middle", "parent", "child", "near", "far")
    joints = [*pairwise(stem), ("middle", "side")]
    parts = [f'<link name="{link}"/>' for link in (*stem, "side")]
    for one, two in joints:
        xyz, rpy = (" ".join(map(repr, row.tolist())) for row in rng.uniform(-3, 3, (2, 3)))
        kind = "continuous" if two == "child" else "fixed"
        parts.append(
            f'<joint name="{two}_joint" type="{kind}"><parent link="{one}"/><child link="{two}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="1 -2 3"/></joint>'
        )
    return f'<robot name="welded">{"".join(parts)}</robot>'


@pytest.mark.parametrize("body2", ["child", "near", "far"])
@pytest.mark.parametrize("body1", ["parent", "middle", "side", "top"])
def test_frames_are_found_along_fixed_joints_up_and_down(body1, body2):
    text = welded_robot(states.generator(83))
    pair = from_urdf(text, "child_joint", body1_frame=body1, body2_frame=body2)
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.r_[np.zeros(6), 1.0, math.cos(0.7), math.sin(0.7)])
    one, two = (data.oMf[model.getFrameId(name, pin.FrameType.BODY)] for name in (body1, body2))
    state = pair.forward_kinematics_from_body1(BodyMotion(R=one.translation, S=one.rotation), 0.7)
    offsets = 6 * np.linalg.norm((3, 3, 3))
    assert np.abs(state.R2 - two.translation).max() <= 16 * U * offsets
    assert np.abs(state.S2 - two.rotation).max() <= 6 * 16 * U


@pytest.mark.parametrize("kind", ["fixed", "revolute", "prismatic"])
def test_what_is_fixed_to_a_body_belongs_to_it(kind):
    mass = '<inertial><mass value="{}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    joint = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><limit effort="1" velocity="1"/></joint>'
    links = "".join(f'<link name="{name}">{mass.format(kg)}</link>' for name, kg in (("a", 1), ("b", 2), ("c", 5)))
    joints = joint.format("j", "revolute", "a", "b") + joint.format("k", kind, "b", "c")
    text = f'<robot name="r">{links}{joints}</robot>'
    assert from_urdf(text, "j").body2.mass == (7 if kind == "fixed" else 2)
    assert sum(inertia.mass for inertia in pin.buildModelFromXML(text).inertias) == 8


def inertial(rng):
    turn, (a, b) = rotation_exp(3 * rng.normal(size=3)), rng.uniform(0.1, 1, 2)
    tensor = turn @ np.diag([a, b, rng.uniform(abs(a - b), a + b)]) @ turn.T
    xyz, rpy = (" ".join(map(repr, row.tolist())) for row in rng.uniform(-3, 3, (2, 3)))
    moments = "".join(f' i{"xyz"[i]}{"xyz"[j]}="{float(tensor[i, j])!r}"' for i in range(3) for j in range(i, 3))
    mass = float(rng.uniform(0.1, 10))
    return f'<inertial><origin xyz="{xyz}" rpy="{rpy}"/><mass value="{mass!r}"/><inertia{moments}/></inertial>'


def laden_robot(seed):
    rng = states.generator(seed)
    return re.sub(r'<link name="(\w+)"/>', lambda m: f'<link name="{m[1]}">{inertial(rng)}</link>', welded_robot(rng))


@pytest.mark.parametrize("frames", [("parent", "child"), ("top", "far"), ("side", "near")], ids="-".join)
def test_links_fixed_to_each_other_are_one_body(frames):
    text = laden_robot(88)
    pair = from_urdf(text, "child_joint", *frames)
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    for name, body, joint in zip(frames, (pair.body1, pair.body2), (1, 2), strict=True):
        frame = model.frames[model.getFrameId(name, pin.FrameType.BODY)]
        expected = frame.placement.actInv(model.inertias[joint])
        assert abs(body.mass - expected.mass) <= 4 * U * expected.mass
        assert np.abs(body.centre_of_mass - expected.lever).max() <= 32 * U * 12
        assert np.abs(body.inertia - expected.inertia).max() <= 64 * U * expected.mass * 12**2


def test_limits_are_read_where_they_leave_a_range():
    assert from_urdf(ARM, "shoulder").limits == (-1.0, 1.0)
    assert from_urdf(ARM, "elbow").limits is None
    assert from_urdf(ARM, "follower").limits is None  # lower and upper not given: both 0, says URDF
    assert from_urdf(ARM.replace('lower="-1" upper="1"', 'upper="0.5"'), "shoulder").limits == (0.0, 0.5)


def with_inertial(link, mass, moments, origin="0 0 0"):
    inside = (
        f'<inertial><origin xyz="{origin}"/><mass value="{mass}"/>'
        f'<inertia ixx="{moments[0]}" iyy="{moments[1]}" izz="{moments[2]}"/></inertial>'
    )
    return ARM.replace(f'<link name="{link}"/>', f'<link name="{link}">{inside}</link>')


def test_a_link_alone_is_read_to_the_bit():
    body = from_urdf(with_inertial("lower", 0.3, (0.1, 0.2, 0.25), "0.1 0.2 0.3"), "elbow").body2
    assert body.mass == 0.3
    assert np.array_equal(body.centre_of_mass, (0.1, 0.2, 0.3))
    assert np.array_equal(body.inertia, np.diag([0.1, 0.2, 0.25]))
    assert from_urdf(ARM, "elbow").body1 is None


@pytest.mark.parametrize(
    ("mass", "moments"), [(1, (1, 1, 3)), (1, (0, 0, 0)), (-1, (1, 1, 1)), (0, (1, 1, 1))], ids=str
)
def test_what_no_rigid_body_has_is_left_out(mass, moments):
    text = with_inertial("upper", mass, moments)
    if mass == 0:
        assert from_urdf(text, "elbow").body1 is None
        return
    with pytest.warns(DynamicsWarning, match="no rigid body has its mass properties"):
        assert from_urdf(text, "elbow").body1 is None
