"""Prepared calls as functions of JAX and PyTorch: their derivatives are those of prepared calls.

The extra `torch` is not among those of the tests, since its wheels bring gigabytes: what concerns it runs where it is
installed. It last did with PyTorch 2.13 on Linux, x86-64.
"""

from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

import hingepair as hp
from hingepair.errors import DtypeError
from support.trees import Robot, random_model, record_of

EPS = 2.0**-53
SAMPLES = 3
RNG = np.random.default_rng(2)
STATES = RNG.uniform(-1, 1, (3, SAMPLES, 3))
ROBOT = Robot(record_of(random_model(1, 3)))
PAIR = hp.HingePair(u1=(0.5, 0, 0.1), u2=(-0.25, 0.1, 0), n=(1, 2, 0))

STEPS, H = 5, 0.02
EFFORTS = RNG.uniform(-3, 3, (4, STEPS, 3))
START = STATES[0, 0]
ROLLED = ROBOT.rollout(START, 0 * START, EFFORTS, H)
WEIGHTS = np.sin(np.arange(ROLLED.q.size)).reshape(ROLLED.q.shape)
GRADIENTS = ROLLED.vjp({"q": WEIGHTS})


@pytest.fixture
def jax():
    jax = pytest.importorskip("jax")
    with jax.enable_x64(True):
        yield jax


@pytest.fixture
def torch():
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of PyTorch's own
        yield torch


@pytest.fixture(scope="module")
def accelerations():
    return ROBOT.prepare("forward_dynamics", outputs=("qdd",))


@pytest.fixture(scope="module")
def slopes(accelerations):
    return accelerations.jacobian(tuple(STATES))["qdd"]


@pytest.fixture(scope="module")
def rolled():
    return ROBOT.prepare("rollout", dt=H)


def close(found, wanted, single=False):
    wanted = np.asarray(wanted)
    size = (2.0**-21 if single else 1024 * EPS) * np.abs(wanted).max(initial=0.0)
    np.testing.assert_allclose(np.asarray(found), wanted, rtol=0, atol=size)


# ---- JAX


@pytest.mark.slow(2)
def test_jax_transforms_calls(jax, accelerations, slopes):
    def qdd(*given):
        return accelerations.jax(*given).qdd

    given = tuple(map(jax.numpy.asarray, STATES))
    close(jax.jit(qdd)(*given), accelerations(*STATES).qdd)
    close(jax.jit(accelerations.jax)(*given).qdd, accelerations(*STATES).qdd)  # whose result is a pytree
    for transform in (jax.jacfwd, jax.jacrev):
        by_all = jax.jit(jax.vmap(transform(qdd, argnums=(0, 1, 2))))(*given)
        for found, name in zip(by_all, slopes, strict=True):
            close(found, slopes[name])
    one = tuple(x[0] for x in given)
    close(jax.jacrev(qdd, argnums=1)(*one), slopes["qd"][0])
    # one argument shared by all samples: its gradient is summed
    shared = jax.grad(lambda tau: qdd(given[0], given[1], tau).sum())(one[2])
    by_hand = accelerations.jacobian((*STATES[:2], STATES[2, 0]), wrt="tau")["qdd"]["tau"]
    close(shared, by_hand.sum(axis=(0, 1)))
    mixed = jax.vmap(qdd, in_axes=(0, None, 1))(given[0], one[1], given[2].T)
    close(mixed, accelerations(STATES[0], STATES[1, 0], STATES[2]).qdd)


@pytest.mark.slow
def test_jax_multiplies_by_the_jacobian_and_its_transpose(jax, accelerations, slopes):
    """One vector for each state, many vectors for one state, and many vectors for many states."""

    def qdd(*given):
        return accelerations.jax(*given).qdd

    q, qd, tau = map(jax.numpy.asarray, STATES)
    u, w = RNG.normal(size=(2, SAMPLES, 3))
    _, rates = jax.jvp(qdd, (q, qd, tau), (u, u, 0 * w))
    close(rates, np.einsum("nij,nj->ni", slopes["q"] + slopes["qd"], u))
    _, gradients = jax.vjp(qdd, q, qd, tau)
    for found, name in zip(gradients(w), slopes, strict=True):
        close(found, np.einsum("nij,ni->nj", slopes[name], w))
    J = np.hstack([slopes["q"][0], slopes["tau"][0]])
    _, rate = jax.linearize(lambda q, tau: qdd(q, qd[0], tau), q[0], tau[0])
    U, W = RNG.normal(size=(5, 6)), RNG.normal(size=(5, 3))
    close(jax.vmap(rate)(U[:, :3], U[:, 3:]), U @ J.T)
    close(np.hstack(jax.vmap(jax.linear_transpose(rate, q[0], tau[0]))(W)), W @ J)
    close(np.hstack(jax.linear_transpose(jax.vmap(rate), U[:, :3], U[:, 3:])(W)), W @ J)
    _, rates = jax.linearize(lambda q: qdd(q, qd, tau), q)
    V = RNG.normal(size=(5, SAMPLES, 3))
    close(jax.vmap(rates)(V), np.einsum("nij,vnj->vni", slopes["q"], V))


@pytest.mark.slow
def test_attitudes_change_by_their_entries_in_jax(jax):
    call = PAIR.prepare("velocity")
    q, qd = RNG.normal(size=(2, SAMPLES, 7))
    state, by_hand = call(q, qd), call.jacobian((q, qd))
    found = jax.vmap(jax.jacfwd(lambda *x: (call.jax(*x).S2, call.jax(*x).v2)))(q, qd)
    close(found[1], by_hand["v2"]["q"])
    turns = np.moveaxis(by_hand["S2"]["q"], -1, 1)  # S' = [omega]x S
    close(np.moveaxis(found[0], -1, 1), hp.skew(turns) @ state.S2[:, None])
    given = PAIR.prepare(("S1", "psi"), outputs=("S2",))
    S1, W = state.S2, RNG.normal(size=(SAMPLES, 3, 3))
    gradient = jax.grad(lambda S: (given.jax(S, qd[:, 0]).S2 * W).sum())(S1)
    close(gradient, W @ np.swapaxes(given(np.eye(3), qd[:, 0]).S2, 1, 2))  # of S1 S(psi)


@pytest.mark.slow
def test_jax_runs_kernels_on_no_samples_without_jit_and_in_threads(jax, accelerations, slopes):
    def qdd(*given):
        return accelerations.jax(*given).qdd

    given = tuple(map(jax.numpy.asarray, STATES))
    nothing = tuple(one[:0] for one in given)
    assert jax.jit(qdd)(*nothing).shape == (0, 3)
    assert jax.vmap(jax.jacfwd(qdd))(*nothing).shape == (0, 3, 3)
    with jax.disable_jit():
        close(jax.vmap(jax.jacfwd(qdd))(*given), slopes["q"])
        close(jax.grad(lambda q: qdd(q, *given[1:]).sum())(given[0]), slopes["q"].sum(axis=1))
    compiled = jax.jit(qdd, donate_argnums=0)

    def run(_):
        with jax.enable_x64(True):
            return compiled(jax.numpy.array(STATES[0]), *given[1:])

    with ThreadPoolExecutor(4) as pool:
        for found in pool.map(run, range(20)):
            close(found, accelerations(*STATES).qdd)


@pytest.mark.slow
def test_jax_differentiates_rollouts(jax, rolled):
    """All motions at once, where what they share is summed; each by itself; and Jacobians by rows."""

    def path(q, tau):
        return rolled.jax(q, 0 * q, tau).q

    def loss(q, tau, weights):
        return (path(q, tau) * weights).sum()

    close(path(START, EFFORTS), ROLLED.q)
    by_q, by_tau = jax.jit(jax.grad(loss, argnums=(0, 1)))(START, EFFORTS, WEIGHTS)
    close(by_tau, GRADIENTS["tau"])
    close(by_q, GRADIENTS["q0"].sum(axis=0))
    each = jax.vmap(jax.grad(loss, argnums=(0, 1)), in_axes=(None, 0, 0))(START, EFFORTS, WEIGHTS)
    close(each[0], GRADIENTS["q0"])
    close(each[1], GRADIENTS["tau"])
    J = jax.jacrev(lambda q: path(q, EFFORTS[2])[-1])(START)
    rows = [ROBOT.rollout(START, 0 * START, EFFORTS[2], H).vjp({"q": row})["q0"] for row in _at_the_end(np.eye(3))]
    close(J, rows)


def _at_the_end(weights):
    rows = np.zeros((len(weights), STEPS + 1, 3))
    rows[:, -1] = weights
    return rows


@pytest.mark.slow
def test_jax_rolls_out_in_float32_under_efforts_that_hold_and_controllers(jax):
    held = ROBOT.prepare("rollout", dt=H, steps=STEPS)
    tau = jax.numpy.asarray(EFFORTS[0, 0], dtype="float32")
    start = jax.numpy.asarray(START, dtype="float32")
    assert held.jax(start, 0 * start, tau).q.dtype == np.float32
    gradient = jax.grad(lambda tau: held.jax(start, 0 * start, tau).q[-1].sum())(tau)
    close(gradient, held(START, 0 * START, EFFORTS[0, 0]).vjp({"q": _at_the_end(np.ones((1, 3)))[0]})["tau"], True)
    control = hp.Feedback(K=2.0, D=1.0, q_ref=0.3)
    by_q = jax.grad(lambda q: held.jax(q, 0 * q, control).q[-1].sum())(START)
    weights = _at_the_end(np.ones((1, 3)))[0]
    close(by_q, held(START, 0 * START, control).vjp({"q": weights}, wrt="q0")["q0"])


@pytest.mark.slow
def test_jax_turns_a_free_base(jax):
    rolled = Robot(record_of(random_model(1, 3)), "free").prepare("rollout", dt=H)
    W = RNG.normal(size=(STEPS + 1, 3, 3))
    found = rolled(START, START, EFFORTS[0])
    turns = np.cross(found.S1, W, axis=-2).sum(axis=-1)
    gradient = jax.grad(lambda tau: (rolled.jax(START, START, tau).S1 * W).sum())(EFFORTS[0])
    close(gradient, found.vjp({"S1": turns}, wrt="tau")["tau"])


# ---- PyTorch


def test_torch_differentiates_calls(torch, accelerations, slopes):
    given = tuple(torch.tensor(x, requires_grad=True) for x in STATES)
    found = accelerations.torch(*given)
    close(found.qdd.detach(), accelerations(*STATES).qdd)
    found.qdd.sum().backward()
    for one, name in zip(given, slopes, strict=True):
        close(one.grad, slopes[name].sum(axis=-2))
    shared = torch.tensor(STATES[2, 0], requires_grad=True)
    accelerations.torch(*STATES[:2], shared).qdd.sum().backward()
    by_hand = accelerations.jacobian((*STATES[:2], STATES[2, 0]), wrt="tau")["qdd"]["tau"]
    close(shared.grad, by_hand.sum(axis=(0, 1)))
    single = ROBOT.prepare("pose").torch(torch.tensor(STATES[0], dtype=torch.float32))
    assert single.R.dtype == torch.float32
    q = torch.tensor(STATES[0], requires_grad=True)
    state = ROBOT.prepare("pose").torch(q)
    with torch.no_grad():
        q += 1.0
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        state.R.sum().backward()


def test_torch_differentiates_rollouts(torch, rolled):
    q, tau = torch.tensor(START, requires_grad=True), torch.tensor(EFFORTS, requires_grad=True)
    found = rolled.torch(q, 0 * START, tau).q
    close(found.detach(), ROLLED.q)
    (found * torch.tensor(WEIGHTS)).sum().backward()
    close(tau.grad, GRADIENTS["tau"])
    close(q.grad, GRADIENTS["q0"].sum(axis=0))


@pytest.fixture(scope="module")
def second(accelerations):
    """Second derivatives of the accelerations of one state by q and qd, (3, 2, 3, 2, 3), by differences of exact
    first ones, and how far these may be off.
    """
    given, h, columns = STATES[:, 0], 2.0**-14, []
    for k in range(6):
        shift = np.zeros((3, 3))
        shift[divmod(k, 3)] = h
        ends = [accelerations.jacobian(tuple(given + side * shift))["qdd"] for side in (1, -1, 2, -2)]
        near, near_back, far, far_back = (np.stack([one["q"], one["qd"]], axis=1) for one in ends)
        columns.append((8 * (near - near_back) - (far - far_back)) / (12 * h))
    found = np.stack(columns, axis=-1).reshape(3, 2, 3, 2, 3)
    return found, 1e-9 * abs(found).max()


@pytest.mark.slow
@pytest.mark.parametrize("order", ["fwd of fwd", "fwd of rev", "rev of fwd", "rev of rev"])
def test_jax_takes_second_derivatives(jax, accelerations, second, order):
    outer, inner = (getattr(jax, f"jac{one}") for one in order.split(" of "))
    q, qd, tau = STATES[:, 0]

    def qdd(both):
        return accelerations.jax(both[0], both[1], tau).qdd

    found = jax.jit(outer(inner(qdd)))(np.stack([q, qd]))
    np.testing.assert_allclose(found, second[0], rtol=0, atol=second[1])


@pytest.mark.parametrize("order", ["fwd of fwd", "fwd of rev", "rev of fwd", "rev of rev"])
def test_torch_func_takes_second_derivatives(torch, accelerations, second, order):
    outer, inner = (getattr(torch.func, f"jac{one}") for one in order.split(" of "))
    q, qd, tau = map(torch.tensor, STATES[:, 0])

    def qdd(both):
        return accelerations.torch(both[0], both[1], tau).qdd

    found = outer(inner(qdd))(torch.stack([q, qd]))
    np.testing.assert_allclose(found, second[0], rtol=0, atol=second[1])


def test_torch_func_transforms_calls(torch, accelerations, slopes, second):
    def qdd(*given):
        return accelerations.torch(*given).qdd

    given = tuple(map(torch.tensor, STATES))
    for transform in (torch.func.jacfwd, torch.func.jacrev):
        for k, name in enumerate(slopes):
            close(torch.func.vmap(transform(qdd, argnums=k))(*given), slopes[name])
    mixed = torch.func.vmap(qdd, in_dims=(0, None, 1))(given[0], given[1][0], given[2].T)
    close(mixed, accelerations(STATES[0], STATES[1, 0], STATES[2]).qdd)
    shared = torch.func.grad(lambda tau: qdd(given[0], given[1], tau).sum())(given[2][0])
    close(shared, accelerations.jacobian((*STATES[:2], STATES[2, 0]), wrt="tau")["qdd"]["tau"].sum(axis=(0, 1)))
    hessian = torch.func.hessian(lambda q: qdd(q, given[1][0], given[2][0])[0])(given[0][0])
    np.testing.assert_allclose(hessian, second[0][0, 0, :, 0], rtol=0, atol=second[1])
    # a penalty on a gradient
    q = torch.tensor(STATES[0, 0], requires_grad=True)
    (slope,) = torch.autograd.grad(qdd(q, given[1][0], given[2][0])[0], q, create_graph=True)
    slope.sum().backward()
    np.testing.assert_allclose(q.grad, second[0][0, 0, :, 0].sum(axis=0), rtol=0, atol=second[1])


def test_torch_compiles_around_calls(torch, accelerations, slopes):
    @torch.compile(backend="eager")
    def loss(q, qd, tau):
        return (2.0 * accelerations.torch(q, qd, tau).qdd).sum()

    given = tuple(torch.tensor(x, requires_grad=True) for x in STATES)
    found = loss(*given)
    close(found.detach(), 2.0 * accelerations(*STATES).qdd.sum())
    found.backward()
    close(given[0].grad, 2.0 * slopes["q"].sum(axis=-2))


# ---- what is refused


@pytest.mark.parametrize("library", ["jax", "torch"])
@pytest.mark.parametrize(
    ("argument", "call"),
    [
        ("qd", lambda x: ROBOT.forward_kinematics(STATES[0], x)),
        ("q", lambda x: ROBOT.inverse_dynamics(x, *STATES[1:])),
        ("q['joint_1']", lambda x: ROBOT.mass_matrix({"joint_0": 0.0, "joint_1": x[:, 0], "joint_2": 0.0})),
        ("tau", lambda x: ROBOT.rollout(START, START, x, H)),
        ("q", ROBOT.prepare("pose")),
        ("psi", lambda x: PAIR.jacobian(hp.BodyMotion(R=np.zeros(3), S=np.eye(3)), x[:, 0])),
        ("q", lambda x: hp.PlanarPair((1, 0), (0, 1)).forward_kinematics(x)),
        ("v", lambda x: hp.BodyMotion(R=np.zeros(3), v=x)),
        ("rotvec", hp.rotation_exp),
        ("phi", hp.euler_to_matrix),
        ("tau.K", lambda x: hp.Feedback(K=x, D=1.0, q_ref=0.0)),
    ],
)
def test_methods_refuse_arrays_of_other_libraries(library, argument, call):
    module = pytest.importorskip(library)
    array = {"jax": lambda: module.numpy.asarray(STATES[0]), "torch": lambda: module.tensor(STATES[0])}[library]()
    with pytest.raises(DtypeError, match=rf"NumPy.*f\.{library}") as refused:
        call(array)
    assert refused.value.name == argument
