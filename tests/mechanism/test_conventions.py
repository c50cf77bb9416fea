"""States as Pinocchio and MuJoCo write them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from support.near import U, assert_near
from support.trees import Robot, base_motion, on_free_base, pinocchio_state, random_model, record_of

MODEL = random_model(2, 4)
FREE, FIXED = Robot(record_of(MODEL), "free"), Robot(record_of(MODEL))
Q, QD = np.random.default_rng(3).uniform(-3, 3, (2, 5, 4))
BASE = base_motion(np.random.default_rng(4), (5,))


def close(found, expected):
    assert_near(found, expected, 32, max(1.0, np.abs(expected).max()))


def test_pinocchio_places_and_moves_the_robot_from_our_state():
    flying = on_free_base(MODEL)
    data = flying.createData()
    q, v = FREE.to_pinocchio_state(Q, QD, BASE)
    name = FREE.names[-1]
    state = FREE.forward_kinematics(Q, QD, frames=name, base_motion=BASE)[name]
    for k in range(5):
        pin.forwardKinematics(flying, data, q[k], v[k])
        place, moving = data.oMi[5], data.v[5]
        close(state.R[k], place.translation)
        close(state.v[k], place.rotation @ moving.linear)
        close(state.omega[k], place.rotation @ moving.angular)
        one = hp.BodyMotion(**{x: getattr(BASE, x)[k] for x in ("R", "S", "v", "omega", "a", "alpha")})
        expected = pinocchio_state(one, Q[k], QD[k], QD[k])
        close(
            q[k] * np.sign(q[k, 6]), expected[0] * np.r_[np.ones(3), np.full(4, np.sign(expected[0][6])), np.ones(4)]
        )
        close(v[k], expected[1])


def test_mujoco_places_and_moves_the_robot_from_our_state():
    import mujoco

    body = hp.Body(2.0, (0.1, -0.2, 0.3), (0.5, 0.6, 0.4))
    pair = hp.HingePair((0.5, -0.1, 0.2), (-0.25, 0.1, 0.3), (0.3, -0.4, 0.6), body1=body, body2=body)
    robot = hp.Mechanism([pair], base="free")
    q, qd = Q[:, :1], QD[:, :1]
    qpos, qvel = robot.to_mujoco_state(q, qd, BASE)
    model = mujoco.MjModel.from_xml_string(hp.to_mjcf(pair))
    data = mujoco.MjData(model)
    kinetic = robot.energy(q, qd, base_motion=BASE).kinetic
    for k in range(5):
        data.qpos[:], data.qvel[:] = qpos[k], qvel[k]
        mujoco.mj_forward(model, data)
        mujoco.mj_energyVel(model, data)
        np.testing.assert_allclose(data.energy[1], kinetic[k], rtol=64 * U)


def test_only_continuous_hinges_have_cosine_and_sine():
    def joint(name, kind, parent, child, limit=""):
        ends = f'<parent link="{parent}"/><child link="{child}"/>'
        return f'<joint name="{name}" type="{kind}">{ends}<axis xyz="0 0 1"/>{limit}</joint>'

    zero = '<limit lower="0" upper="0" effort="1" velocity="1"/>'  # as many URDFs write that there is none
    joints = joint("j", "revolute", "a", "b", zero) + joint("k", "continuous", "b", "c")
    text = f'<robot name="x"><link name="a"/><link name="b"/><link name="c"/>{joints}</robot>'
    model = pin.buildModelFromXML(text)
    for robot in (hp.Mechanism.from_urdf(text), hp.Mechanism.from_pinocchio(model)):
        assert np.isinf(robot.position_limits).all()
        q, _ = robot.to_pinocchio_state([0.3, 0.4], cos_sin=True)
        np.testing.assert_allclose(q, [0.3, np.cos(0.4), np.sin(0.4)], rtol=4 * U)
        np.testing.assert_allclose(robot.from_pinocchio_state(q).q, [0.3, 0.4], rtol=4 * U)
        assert q.shape == pin.neutral(model).shape
    assert robot.with_locked({"j": 0.0, "k": 0.0}).to_pinocchio_state([])[0].shape == (0,)


@pytest.mark.parametrize("package", ["pinocchio", "mujoco"])
def test_states_come_back(package):
    q, v = getattr(FREE, f"to_{package}_state")(Q, QD, BASE)
    state = getattr(FREE, f"from_{package}_state")(q, v)
    close(state.q, Q)
    close(state.qd, QD)
    for name in ("R", "S", "v", "omega"):
        close(getattr(state.base_motion, name), getattr(BASE, name))
    at_rest = getattr(FREE, f"from_{package}_state")(*getattr(FREE, f"to_{package}_state")(Q, QD)).base_motion
    assert not at_rest.R.any()
    assert not at_rest.v.any()
    close(at_rest.S, np.broadcast_to(np.eye(3), (5, 3, 3)))
    alone = getattr(FIXED, f"from_{package}_state")(Q[0])
    assert alone.base_motion is None
    close(alone.q, Q[0])
    close(getattr(FIXED, f"to_{package}_state")(Q)[0], Q)
