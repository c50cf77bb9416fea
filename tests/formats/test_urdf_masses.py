"""Limits and mass properties that a URDF gives: those of all links fixed to each other, as Pinocchio adds them up."""

from __future__ import annotations

import re

import numpy as np
import pinocchio as pin
import pytest

from hingepair.errors import URDFError
from hingepair.mechanism.bodies.body import DynamicsWarning
from hingepair.mechanism.building.urdf import from_urdf
from hingepair.rotations.matrices import rotation_exp
from support import states
from support.exported import ARM, welded_robot

U = 2.0**-53


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
    backwards = ARM.replace('lower="-1" upper="1"', 'lower="1" upper="-1"')
    with pytest.raises(
        URDFError, match=r"joint 'shoulder', limit: expected lower below upper, got lower 1\.0, upper -1"
    ):
        from_urdf(backwards, "shoulder")


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
