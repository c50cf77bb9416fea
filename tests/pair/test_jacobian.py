"""Jacobians of body 2 and their rates: against the motion itself, Pinocchio, and differences in time."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.validation.pinocchio_twin import to_pinocchio
from support.hinged import made
from support.states import body1 as random_body1
from support.states import generator

U = 2.0**-53
COUNT = 40


def moving(key, count=COUNT):
    rng = generator(71, key)
    R, S, v, omega, a, alpha = random_body1(rng, count)
    return hp.BodyMotion(R=R, S=S, v=v, omega=omega, a=a, alpha=alpha), *rng.normal(size=(3, count))


def lever(pair):
    return sum(math.hypot(*u) for u in (pair.u1.tolist(), pair.u2.tolist()))


def size(pair, body1, psid):
    """abs(v1) + W lever, W: the scale of (v2, omega2)."""
    W = np.linalg.norm(body1.omega, axis=-1) + abs(psid)
    return np.stack([np.linalg.norm(body1.v, axis=-1) + W * lever(pair)] * 3 + [W] * 3, axis=-1)


PAIRS = {"home": {}, "no_home": {"home": None}, "axis_z": {"n": (0, 0, 5)}, "u2_zero": {"u2": (0, 0, 0)}}


@pytest.mark.slow
@pytest.mark.parametrize("kind", PAIRS)
def test_velocity_is_the_jacobian_times_the_velocities(kind):
    pair, (body1, psi, psid, _) = made(1, **PAIRS[kind]), moving(1)
    state = pair.forward_kinematics_from_body1(body1, psi, psid)
    given = np.concatenate([body1.v, body1.omega, psid[:, None]], axis=-1)
    found = (pair.jacobian(body1, psi) @ given[..., None])[..., 0]
    expected = np.concatenate([state.v2, state.omega2], axis=-1)
    assert np.all(abs(found - expected) <= 12 * U * size(pair, body1, psid))


@pytest.mark.slow
@pytest.mark.parametrize("kind", PAIRS)
def test_acceleration_is_the_jacobian_times_the_accelerations_and_the_bias(kind):
    pair, (body1, psi, psid, psidd) = made(2, **PAIRS[kind]), moving(2)
    state = pair.forward_kinematics_from_body1(body1, psi, psid, psidd)
    given = np.concatenate([body1.a, body1.alpha, psidd[:, None]], axis=-1)
    found = (pair.jacobian(body1, psi) @ given[..., None])[..., 0] + pair.acceleration_bias(body1, psi, psid)
    expected = np.concatenate([state.a2, state.alpha2], axis=-1)
    W = np.linalg.norm(body1.omega, axis=-1) + abs(psid)
    A = np.linalg.norm(body1.alpha, axis=-1) + abs(psidd) + W * W
    scale = np.stack([np.linalg.norm(body1.a, axis=-1) + 2 * A * lever(pair)] * 3 + [A] * 3, axis=-1)
    assert np.all(abs(found - expected) <= 16 * U * scale)


def test_jacobian_and_bias_are_those_of_pinocchio():
    """Pinocchio's free-flyer velocity is in body 1's axes: Jac = J X, Jac' = J' X + J X', X = (S1^T, S1^T, 1)."""
    pair, (body1, psi, psid, _) = made(3), moving(3)
    twin = to_pinocchio(pair)
    q, v = twin.configuration(body1, psi), twin.velocity(body1, psi, psid)
    found, bias = pair.jacobian(body1, psi), pair.acceleration_bias(body1, psi, psid)
    for i in range(COUNT):
        pin.computeJointJacobiansTimeVariation(twin.model, twin.data, q[i], v[i])
        pin.updateFramePlacements(twin.model, twin.data)
        frame = twin.model, twin.data, twin.body2_frame, pin.LOCAL_WORLD_ALIGNED
        J, J_dot = pin.getFrameJacobian(*frame), pin.getFrameJacobianTimeVariation(*frame)
        S, omega = body1.S[i], body1.omega[i]
        X, X_dot = np.eye(7), np.zeros((7, 7))
        X[:3, :3] = X[3:6, 3:6] = S.T
        X_dot[:3, :3] = X_dot[3:6, 3:6] = -S.T @ pin.skew(omega)
        assert abs(found[i] - J @ X).max() <= 32 * U * (1 + lever(pair) + abs(body1.R[i]).max())
        given = np.concatenate([body1.v[i], omega, [psid[i]]])
        W = np.linalg.norm(omega) + abs(psid[i])
        scale = W * W * (1 + lever(pair) + abs(body1.R[i]).max()) + W * np.linalg.norm(body1.v[i])
        assert abs(bias[i] - (J_dot @ X + J @ X_dot) @ given).max() <= 64 * U * scale
