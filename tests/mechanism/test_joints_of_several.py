"""Joints of several coordinates, which stand for hinges in series with bodies of no mass between them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.errors import ArgumentError

U = 2.0**-53
ZYX = np.eye(3)[::-1]


@dataclasses.dataclass
class Ball:
    """A ball joint by three hinges, which turn about z, y and x."""

    name: str
    u1: tuple[float, float, float]
    u2: tuple[float, float, float]
    body2: hp.Body | None

    def in_series(self):
        at, zero = (self.u1, (0, 0, 0), (0, 0, 0)), (0, 0, 0)
        hinges = [hp.HingePair(u, zero, n, name=f"{self.name}_{k}") for u, n, k in zip(at, ZYX, "zyx", strict=True)]
        return [*hinges[:2], dataclasses.replace(hinges[2], u2=self.u2, body2=self.body2)]


def body(mass, *centre):
    return hp.Body(mass, centre, inertia=mass * np.diag((0.1, 0.2, 0.25)))


def robot(held=None):
    """An arm that carries a hand at a ball joint, which carries a finger, and a tool."""
    arm = hp.HingePair((0, 0, 1), (0, 0, 0), (0, 1, 0), name="arm", body2=body(2, 0.2, 0, 0.1))
    wrist = Ball("hand", (0.5, 0, 0.1), (-0.1, 0, 0.2), held)
    finger = hp.HingePair((0.1, 0.2, 0.3), (0, 0, 0), (1, 0, 0), name="finger", body2=body(0.5, 0, 0.1, 0))
    tool = hp.HingePair((0, 0.4, 0), (0, 0, 0), (1, 0, 0), name="tool", body2=body(0.7, 0, 0.1, 0.2))
    return hp.Mechanism([arm, wrist, finger, tool], parents=(0, 1, 2, 1))


def with_ball_of_pinocchio():
    """The same robot with Pinocchio's own ball joint of the angles z, y, x."""
    model = pin.Model()

    def add(parent, joint, *origin, mass, centre, name):
        number = model.addJoint(parent, joint, pin.SE3(np.eye(3), np.array(origin)), name)
        one = body(mass, *centre)
        model.appendBodyToJoint(number, pin.Inertia(mass, one.centre_of_mass, one.inertia), pin.SE3.Identity())
        return number

    arm = add(0, pin.JointModelRY(), 0.0, 0.0, 1.0, mass=2, centre=(0.2, 0, 0.1), name="arm")
    # From the hinge point, whose distance from the reference point of the hand is u2.
    ball = pin.JointModelSphericalZYX()
    hand = add(arm, ball, 0.5, 0.0, 0.1, mass=1.5, centre=(0.2, 0.1, -0.2), name="hand")
    add(hand, pin.JointModelRX(), 0.2, 0.2, 0.1, mass=0.5, centre=(0, 0.1, 0), name="finger")
    add(arm, pin.JointModelRX(), 0.0, 0.4, 0.0, mass=0.7, centre=(0, 0.1, 0.2), name="tool")
    return model


@pytest.mark.parametrize("backend", ["numpy", "compiled"])
def test_a_ball_joint_moves_as_that_of_pinocchio(backend):
    ours, model = robot(body(1.5, 0.1, 0.1, 0)), with_ball_of_pinocchio()
    data = model.createData()
    assert ours.names == ("arm", "hand_z", "hand_y", "hand_x", "finger", "tool")
    q, qd, qdd = np.random.default_rng(1).uniform(-1, 1, (3, 20, 6))
    tau = ours.inverse_dynamics(q, qd, qdd, backend=backend).tau
    expected = np.array([pin.rnea(model, data, *one) for one in zip(q, qd, qdd, strict=True)])
    np.testing.assert_allclose(tau, expected, rtol=0, atol=32 * U * np.abs(expected).max())
    found = ours.forward_dynamics(q, qd, expected, backend=backend).qdd
    masses = [np.linalg.cond(pin.crba(model, data, one)) for one in q]
    np.testing.assert_allclose(found, qdd, rtol=0, atol=32 * U * max(masses) * np.abs(qdd).max())


def test_only_bodies_between_the_hinges_need_no_mass():
    with pytest.raises(ArgumentError, match="body2 of 'hand_x'"):
        robot().inverse_dynamics(np.zeros(6), np.zeros(6), np.zeros(6))
