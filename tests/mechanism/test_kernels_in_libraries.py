"""Kernels in JAX and PyTorch: derivatives by their transformations are those of prepared calls.

The extra `torch` is not among those of the tests, since its wheels bring gigabytes: what concerns it runs where it is
installed. It last did with PyTorch 2.13 on Linux, x86-64.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import hingepair as hp
from hingepair.engine.calls import Call

EPS = 2.0**-53
SAMPLES = 3


@pytest.fixture(scope="module")
def robot():
    return hp.load_robot("ur5_robot")


@pytest.fixture(scope="module")
def states():
    return np.random.default_rng(2).uniform(-1, 1, (3, SAMPLES, 6))


@pytest.fixture(scope="module")
def expected(robot, states):
    return robot.forward_dynamics_derivatives(*states)


@pytest.fixture
def jax():
    jax = pytest.importorskip("jax")
    with jax.enable_x64(True):
        yield jax


@pytest.fixture(scope="module")
def arm():
    body = hp.Body(mass=2.0, centre_of_mass=(0.3, 0.1, 0), inertia=(0.1, 0.2, 0.3))
    pairs = [hp.HingePair((0.5, 0, 0), (0, 0, 0), n, body2=body) for n in ((0, 1, 0), (1, 0, 0))]
    return hp.Mechanism(pairs)


@pytest.fixture
def torch():
    return pytest.importorskip("torch", reason="PyTorch is not installed")


def close(found, wanted, single=False):
    wanted = np.asarray(wanted)
    size = (2.0**-22 if single else 256 * EPS) * np.abs(wanted).max()
    np.testing.assert_allclose(np.asarray(found), wanted, rtol=0, atol=size)


@pytest.mark.slow(4)
def test_jax_transforms_accelerations_by_the_kernels(jax, robot, states, expected):
    def qdd(*given):
        return robot.forward_dynamics(*given).qdd

    given = tuple(map(jax.numpy.asarray, states))
    close(jax.jit(qdd)(*given), robot.forward_dynamics(*states).qdd)
    by_all = jax.jit(jax.vmap(jax.jacfwd(qdd, argnums=(0, 1, 2))))(*given)
    for found, name in zip(by_all, ("qdd_q", "qdd_qd", "qdd_tau"), strict=True):
        close(found, expected[name])
    one = tuple(x[0] for x in given)
    close(jax.jacrev(qdd, argnums=1)(*one), expected.qdd_qd[0])
    # one argument shared by all samples: its gradient is summed
    shared = jax.grad(lambda tau: qdd(given[0], given[1], tau).sum())(one[2])
    by_hand = robot.forward_dynamics_derivatives(*states[:2], states[2, 0], outputs=("qdd_tau",)).qdd_tau
    close(shared, by_hand.sum(axis=(0, 1)))
    mixed = jax.vmap(qdd, in_axes=(0, None, 1))(given[0], one[1], given[2].T)
    close(mixed, robot.forward_dynamics(states[0], states[1, 0], states[2]).qdd)


@pytest.mark.slow(2)
def test_jax_computes_in_float32_and_differentiates_attitudes_by_their_entries(jax, robot, states):
    q = jax.numpy.asarray(states[0], dtype="float32")
    state = robot.forward_kinematics(q, frames="tool0")
    assert state.S.dtype == np.float32
    close(state.S, robot.forward_kinematics(states[0], frames="tool0").S, single=True)
    J = jax.vmap(jax.jacfwd(lambda q: robot.forward_kinematics(q, frames="tool0", outputs=("S",)).S))(q)
    turns = robot.jacobian(states[0], "tool0")[:, 3:]  # S' = [omega]x S
    rates = np.stack([hp.skew(turns[:, :, k]) for k in range(6)], axis=1) @ state.S
    close(np.moveaxis(np.asarray(J)[:, 0], -1, 1), rates, single=True)


@pytest.mark.slow
def test_jax_multiplies_by_the_jacobian_and_its_transpose(jax, arm):
    """One vector for each state, or many vectors for one state, be they unit vectors or any others."""

    def torque(*given):
        return arm.inverse_dynamics(*given).tau

    rng = np.random.default_rng(7)
    states = rng.uniform(-1, 1, (3, SAMPLES, 2))
    q, qd, qdd = map(jax.numpy.asarray, states)
    slopes = arm.inverse_dynamics_derivatives(*states)
    u, w = rng.normal(size=(2, SAMPLES, 2))
    _, rates = jax.jvp(torque, (q, qd, qdd), (u, u, 0 * w))
    close(rates, np.einsum("nij,nj->ni", slopes.tau_q + slopes.tau_qd, u))
    _, gradients = jax.vjp(torque, q, qd, qdd)
    for found, name in zip(gradients(w), ("tau_q", "tau_qd", "tau_qdd"), strict=True):
        close(found, np.einsum("nij,ni->nj", slopes[name], w))
    # many vectors: as many as entries, and more
    J = np.hstack([slopes.tau_q[0], slopes.tau_qdd[0]])
    _, rate = jax.linearize(lambda q, qdd: torque(q, qd[0], qdd), q[0], qdd[0])
    for count in (4, 5):
        U = rng.normal(size=(count, 4))
        close(jax.vmap(rate)(U[:, :2], U[:, 2:]), U @ J.T)
    W = rng.normal(size=(count, 2))
    close(np.hstack(jax.vmap(jax.linear_transpose(rate, q[0], qdd[0]))(W)), W @ J)
    close(np.hstack(jax.linear_transpose(jax.vmap(rate), U[:, :2], U[:, 2:])(W)), W @ J)
    # and for many states
    by_rows = jax.vmap(jax.jacrev(torque, argnums=(0, 2)))(q, qd, qdd)
    by_columns = jax.vmap(jax.jacfwd(torque, argnums=(0, 2)))(q, qd, qdd)
    for found in (by_rows, by_columns):
        close(found[0], slopes.tau_q)
        close(found[1], slopes.tau_qdd)


@pytest.mark.slow
def test_jax_runs_kernels_on_no_samples_without_jit_and_in_threads(jax, arm):
    def torque(*given):
        return arm.inverse_dynamics(*given).tau

    states = np.random.default_rng(8).uniform(-1, 1, (3, SAMPLES, 2))
    given = tuple(map(jax.numpy.asarray, states))
    nothing = tuple(one[:0] for one in given)
    assert jax.jit(torque)(*nothing).shape == (0, 2)
    assert jax.vmap(jax.jacfwd(torque))(*nothing).shape == (0, 2, 2)
    slopes = arm.inverse_dynamics_derivatives(*states)
    with jax.disable_jit():
        close(jax.vmap(jax.jacfwd(torque))(*given), slopes.tau_q)
        close(jax.grad(lambda q: torque(q, *given[1:]).sum())(given[0]), slopes.tau_q.sum(axis=1))
    compiled = jax.jit(torque, donate_argnums=0)

    def run(_):
        with jax.enable_x64(True):
            return compiled(jax.numpy.array(states[0]), *given[1:])

    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(run, range(20)):
            close(found, arm.inverse_dynamics(*states).tau)


@pytest.mark.slow(3)
def test_derivatives_of_derivatives_are_those_of_the_equations(jax):
    body = hp.Body(mass=2.0, centre_of_mass=(0.3, 0, 0), inertia=(0.1, 0.1, 0.1))
    arm = hp.Mechanism([hp.HingePair((0, 0, 0), (0, 0, 0), (0, 1, 0), body2=body)])

    def torque(q):
        return arm.inverse_dynamics(q, 0.0 * q, 0.0 * q).tau[0]

    q = jax.numpy.asarray([0.4])
    close(jax.hessian(torque)(q), [[-torque(q)]])  # m g x cos q
    close(jax.grad(torque)(q), [torque(q + np.pi / 2)])


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*torch.jit.script")  # of its own forward derivatives
def test_torch_transforms_accelerations_by_the_kernels(torch, robot, states, expected, monkeypatch):
    def qdd(*given):
        return robot.forward_dynamics(*given).qdd

    given = tuple(torch.tensor(x, requires_grad=True) for x in states)
    with monkeypatch.context() as kernels_alone:
        kernels_alone.setattr(Call, "run_foreign", None)
        found = qdd(*given)
    close(found.detach(), robot.forward_dynamics(*states).qdd)
    found.sum().backward()
    for one, name in zip(given, ("qdd_q", "qdd_qd", "qdd_tau"), strict=True):
        close(one.grad, expected[name].sum(axis=-2))
    plain = tuple(map(torch.tensor, states))
    for transform in (torch.func.jacfwd, torch.func.jacrev):
        close(torch.vmap(transform(qdd, argnums=1))(*plain), expected.qdd_qd)
    shared = torch.tensor(states[2, 0], requires_grad=True)
    qdd(plain[0], plain[1], shared).sum().backward()
    by_hand = robot.forward_dynamics_derivatives(*states[:2], states[2, 0], outputs=("qdd_tau",)).qdd_tau
    close(shared.grad, by_hand.sum(axis=(0, 1)))
    single = robot.forward_kinematics(torch.tensor(states[0], dtype=torch.float32), frames="tool0")
    assert single.R.dtype == torch.float32
    twice = torch.autograd.functional.hessian(lambda q: robot.inverse_dynamics(q, q, q).tau.sum(), plain[0][0])
    step = 1e-5 * np.eye(6)
    call = robot.prepare("inverse_dynamics", outputs=("tau",))
    near = [
        sum(call.vjp((q, q, q), {"tau": np.ones(6)})[1].values()) for q in (states[0, 0] + step, states[0, 0] - step)
    ]
    np.testing.assert_allclose(twice, (near[0] - near[1]) / 2e-5, rtol=0, atol=1e-7)
