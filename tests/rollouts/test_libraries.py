"""Rollouts under the transformations of JAX and PyTorch, against `vjp`."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.trees import Robot, random_model, record_of

STEPS, H = 5, 0.02
ROBOT = Robot(record_of(random_model(1, 3)))
RNG = np.random.default_rng(3)
Q = RNG.uniform(-1, 1, 3)
TAU = RNG.uniform(-3, 3, (4, STEPS, 3))
FOUND = ROBOT.rollout(Q, 0 * Q, TAU, H)
WEIGHTS = np.sin(np.arange(FOUND.q.size)).reshape(FOUND.q.shape)
GRADIENT = FOUND.vjp({"q": WEIGHTS})


@pytest.fixture
def jax():
    jax = pytest.importorskip("jax")
    with jax.enable_x64(True):
        yield jax


def close(found, expected, rtol=1e-12):
    np.testing.assert_allclose(np.asarray(found), expected, rtol=rtol, atol=rtol * np.abs(expected).max())


@pytest.mark.slow
def test_jax_differentiates_rollouts(jax):
    """All motions at once, where what they share is summed; each by itself; and Jacobians."""
    q, tau = jax.numpy.asarray(Q), jax.numpy.asarray(TAU)

    def path(q, tau):
        return ROBOT.rollout(q, 0 * q, tau, H).q

    def loss(q, tau, weights):
        return (path(q, tau) * weights).sum()

    close(path(q, tau), FOUND.q)
    by_q, by_tau = jax.jit(jax.grad(loss, argnums=(0, 1)))(q, tau, WEIGHTS)
    close(by_tau, GRADIENT["tau"])
    close(by_q, GRADIENT["q0"].sum(axis=0))
    each = jax.vmap(jax.grad(loss, argnums=(0, 1)), in_axes=(None, 0, 0))(q, tau, WEIGHTS)
    close(each[0], GRADIENT["q0"])
    close(each[1], GRADIENT["tau"])
    J = jax.jacrev(lambda q: path(q, tau[2])[-1])(q)  # a row for each weight
    ahead, behind = (ROBOT.rollout(Q + x, 0 * Q, TAU[2], H).q[-1] for x in ((1e-6, 0, 0), (-1e-6, 0, 0)))
    close(J[:, 0], (ahead - behind) / 2e-6, 1e-7)


def test_what_jax_does_not_trace_says_what_gives_derivatives(jax):
    uses = {
        "mass": (lambda m: ROBOT.with_payload(ROBOT.tips[0], mass=m), 'wrt="masses".*vjp'),
        "tau.K": (lambda K: hp.Feedback(K=K, D=1.0, q_ref=0.0), r'motions\.vjp\(weights, wrt="K"\) gives'),
    }
    for name, (use, derivatives) in uses.items():
        with pytest.raises(hp.errors.DtypeError, match=rf"^{name}: expected numbers, since JAX .*{derivatives}"):
            jax.grad(use)(1.0)


@pytest.mark.slow
def test_jax_in_float32_and_with_efforts_that_hold(jax):
    tau = jax.numpy.asarray(TAU[0, 0], dtype="float32")
    found = ROBOT.rollout(Q, 0 * Q, tau, H, steps=STEPS, every=2)
    assert found.q.dtype == np.float32
    assert found.shape == (3,)
    motions = ROBOT.rollout(tau, np.stack([Q, 2 * Q]), 0.0, H, steps=STEPS)  # NumPy's, with an axis of motions
    assert (motions.shape, motions.q.dtype) == ((2, STEPS + 1), np.float32)
    gradient = jax.grad(lambda tau: ROBOT.rollout(Q, 0 * Q, tau, H, steps=STEPS).q[-1].sum())(tau)
    held = ROBOT.rollout(Q, 0 * Q, TAU[0, 0], H, steps=STEPS)
    weights = np.zeros((STEPS + 1, 3))
    weights[-1] = 1.0
    close(gradient, held.vjp({"q": weights})["tau"], 1e-5)


@pytest.mark.slow
def test_jax_turns_a_free_base(jax):
    robot = Robot(record_of(random_model(1, 3)), "free")
    W = np.random.default_rng(5).normal(size=(STEPS + 1, 3, 3))
    found = robot.rollout(Q, Q, TAU[0], H)
    turns = np.cross(found.S1, W, axis=-2).sum(axis=-1)
    gradient = jax.grad(lambda tau: (robot.rollout(Q, Q, tau, H).S1 * W).sum())(jax.numpy.asarray(TAU[0]))
    close(gradient, found.vjp({"S1": turns}, wrt="tau")["tau"])


def test_torch_differentiates_rollouts():
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    q, tau = torch.tensor(Q, requires_grad=True), torch.tensor(TAU, requires_grad=True)
    found = ROBOT.rollout(q, 0 * Q, tau, H).q
    close(found.detach(), FOUND.q)
    (found * torch.tensor(WEIGHTS)).sum().backward()
    close(tau.grad, GRADIENT["tau"])
    close(q.grad, GRADIENT["q0"].sum(axis=0))


@pytest.mark.slow
def test_what_cannot_be_used_is_named(jax):
    tau = jax.numpy.zeros((STEPS, 2))
    with pytest.raises(hp.ArgumentError, match=r"^tau: expected shape \(\.\.\., 3\)"):
        ROBOT.rollout(Q, Q, tau, H)
    with pytest.raises(hp.ArgumentError, match=r"^out: expected None"):
        ROBOT.rollout(jax.numpy.zeros(3), Q, 0.0, H, steps=1, out={})
    with pytest.raises(hp.ArgumentError, match=r"^steps"):
        ROBOT.rollout(jax.numpy.zeros(3), Q, 0.0, H)
