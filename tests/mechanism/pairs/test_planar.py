"""The planar pair (E11): equal to the spatial pair and to Pinocchio; motion proven flat is the same motion."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.pairs.accuracy import output_scales
from support.sparse import sparse
from support.states import generator

BACKENDS = sparse(["numpy", "compiled"], 2)


def random_pair(rng, leading=()):
    return hp.PlanarPair(u1=rng.normal(size=(*leading, 2)), u2=rng.normal(size=(*leading, 2)))


def random_motion(rng, *shape):
    """q, qd, qdd of many sizes; shape (..., 4) each."""
    return [rng.normal(size=(*shape, 4)) * 10.0 ** rng.uniform(-3, 3, size=(*shape, 1)) for _ in range(3)]


def scales(pair, q, qd, qdd):
    W1 = np.abs(qd[..., 2])
    return output_scales(
        u1=pair.u1, u2=pair.u2, R1=q[..., :2], v1=qd[..., :2], a1=qdd[..., :2],
        W1=W1, A1=np.abs(qdd[..., 2]) + W1**2, psid=qd[..., 3], psidd=qdd[..., 3],
    )  # fmt: skip


def off(found, true, scale, dtype=np.float64):
    """The largest difference in units of u * scale."""
    error = np.abs(np.asarray(found, float) - true)
    error = error.reshape(*np.shape(scale), -1).max(axis=-1)
    return float((error / (scale * np.finfo(dtype).eps / 2)).max())


@pytest.mark.parametrize("backend", BACKENDS)
def test_equal_to_pinocchios_planar_joint(backend):
    import pinocchio as pin

    rng = generator(901)
    pair, (q, qd, qdd) = random_pair(rng), random_motion(rng, 50)
    model = pin.Model()
    first = model.addJoint(0, pin.JointModelPlanar(), pin.SE3.Identity(), "body1")
    second = model.addJoint(first, pin.JointModelRZ(), pin.SE3(np.eye(3), np.r_[pair.u1, 0]), "hinge")
    frame = model.addFrame(pin.Frame("body2", second, 0, pin.SE3(np.eye(3), np.r_[-pair.u2, 0]), pin.OP_FRAME))
    data, state, scale = (
        model.createData(),
        pair.forward_kinematics(q, qd, qdd, backend=backend),
        scales(pair, q, qd, qdd),
    )
    for i in range(len(q)):
        c, s = np.cos(q[i, 2]), np.sin(q[i, 2])
        turn = np.array([[c, s], [-s, c]])  # world to body: the joint's velocities stand in body axes
        spin = qd[i, 2] * np.array([[0, 1], [-1, 0]])
        v, a = turn @ qd[i, :2], turn @ qdd[i, :2] + spin @ turn @ qd[i, :2]
        configuration = np.r_[q[i, :2], c, s, q[i, 3]]
        pin.forwardKinematics(model, data, configuration, np.r_[v, qd[i, 2:]], np.r_[a, qdd[i, 2:]])
        pin.updateFramePlacements(model, data)
        world = pin.LOCAL_WORLD_ALIGNED
        velocity = pin.getFrameVelocity(model, data, frame, world)
        acceleration = pin.getFrameClassicalAcceleration(model, data, frame, world)
        speed = np.abs(qd[i, :2]).max() * (np.abs(qd[i, 2:]).sum() + abs(qd[i, 2]))
        both_round, classical = 16, scale["a2"][i] + speed  # Pinocchio goes through spatial accelerations
        assert off(state.R2[i], data.oMf[frame].translation[:2], scale["R2"][i]) <= both_round
        assert off(state.v2[i], velocity.linear[:2], scale["v2"][i]) <= both_round
        assert off(state.omega2[i], velocity.angular[2], scale["omega2"][i]) <= both_round
        assert off(state.a2[i], acceleration.linear[:2], classical) <= both_round
        assert off(state.alpha2[i], acceleration.angular[2], scale["alpha2"][i]) <= both_round
