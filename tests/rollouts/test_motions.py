"""Motions in time: against loops of Pinocchio's aba and of forward dynamics, and by energy and momentum."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.mechanism.mechanism import tree_of
from support.linkages import four_bar
from support.near import U, assert_near
from support.trees import Robot, base_motion, random_model, record_of

STEPS, H = 12, 2e-2
MODEL = random_model(1, 4)
ROBOT = Robot(record_of(MODEL))
DOF = ROBOT.dof


def samples(*shape, seed=5):
    rng = np.random.default_rng(seed)
    return rng.uniform(-1, 1, (2, *shape, DOF)), 3 * rng.uniform(-1, 1, (*shape, STEPS, DOF))


def aba_loop(q, v, efforts, method):
    """The motion by Pinocchio; efforts(k, q, v) in the step k."""
    data = MODEL.createData()

    def rates(k, q, v):
        return pin.aba(MODEL, data, q, v, efforts(k, q, v)).copy()

    path = [(q, v)]
    for k in range(STEPS):
        if method == "semi_implicit":
            v = v + H * rates(k, q, v)
            q = q + H * v
        else:
            v1, a1 = v, rates(k, q, v)
            v2, a2 = v + H / 2 * a1, rates(k, q + H / 2 * v1, v + H / 2 * a1)
            v3, a3 = v + H / 2 * a2, rates(k, q + H / 2 * v2, v + H / 2 * a2)
            v4, a4 = v + H * a3, rates(k, q + H * v3, v + H * a3)
            q, v = q + H / 6 * (v1 + 2 * v2 + 2 * v3 + v4), v + H / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        path.append((q, v))
    return tuple(np.stack(part) for part in zip(*path, strict=True))


def close(found, expected, near=90_000):
    """As near as roundings of all steps leave them, in u."""
    assert_near(found, expected, near, max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("method", ["semi_implicit", "rk4"])
def test_motions_are_those_of_a_loop_of_aba(method):
    (q0, qd0), tau = samples(2, 3)
    found = ROBOT.rollout(q0, qd0, tau, H, method=method)
    assert found.q.shape == (2, 3, STEPS + 1, DOF)
    q, qd = aba_loop(q0[1, 2], qd0[1, 2], lambda k, *_: tau[1, 2, k], method)
    close(found.q[1, 2], q)
    close(found.qd[1, 2], qd)


@pytest.mark.slow
@pytest.mark.parametrize("gains", ["number", "diagonal", "full", "full_rates"])
@pytest.mark.parametrize("method", ["semi_implicit", "rk4"])
def test_feedback_is_evaluated_in_every_stage(method, gains):
    (q0, qd0), wanted = samples(2)
    rng = np.random.default_rng(6)
    K, D = {
        "number": (20.0, 0.5),
        "diagonal": (rng.uniform(1, 20, DOF), 0.5),
        "full": (rng.normal(size=(DOF, DOF)), rng.uniform(0, 1, DOF)),
        "full_rates": (3.0, rng.normal(size=(DOF, DOF))),
    }[gains]
    ahead = rng.normal(size=DOF)
    most = np.full(DOF, 8.0)
    controller = hp.Feedback(K, D, wanted, 0.1, ahead)
    found = ROBOT.rollout(q0, qd0, controller, H, method=method, effort_limits=most)
    full = [gain if np.ndim(gain) == 2 else np.diag(np.broadcast_to(gain, DOF)) for gain in (K, D)]

    def efforts(k, q, v):
        return np.clip(ahead + full[0] @ (wanted[1, k] - q) + full[1] @ (0.1 - v), -most, most)

    q, qd = aba_loop(q0[1], qd0[1], efforts, method)
    close(found.q[1], q)
    close(found.qd[1], qd)


def test_forms_of_a_call_are_the_same_motions():
    (q0, qd0), tau = samples(5)
    whole = ROBOT.rollout(q0, qd0, tau, H)
    some = ROBOT.rollout(q0, qd0, tau, H, every=5)
    np.testing.assert_array_equal(some.q, whole.q[:, [0, 5, 10]])
    out = {"q": np.empty((5, STEPS + 1, DOF)), "qd": np.empty((STEPS + 1, 5, DOF)).swapaxes(0, 1)}
    written = ROBOT.rollout(q0, qd0, tau, H, out=out, workers=2)
    for name, array in whole.arrays().items():
        close(out[name], array, 1e-13)
        assert np.shares_memory(written[name], out[name])
    grid, places = (
        ROBOT.rollout(q0[:4].reshape(2, 2, DOF), qd0[0], 0, H, steps=2).q,
        np.empty((2, 2, 3, DOF)).swapaxes(0, 1),
    )
    ROBOT.rollout(
        q0[:4].reshape(2, 2, DOF), qd0[0], 0, H, steps=2, out={"q": places}
    )  # whose motions are no one axis
    np.testing.assert_array_equal(places, grid)
    one = ROBOT.rollout(dict(zip(ROBOT.names, q0[1], strict=True)), tuple(qd0[1]), tau[1], H)
    close(one.q, whole.q[1], 1e-13)
    held = ROBOT.rollout(q0[0], qd0, tau[0, 0], H, steps=3)
    close(held.q[2], ROBOT.rollout(q0[0], qd0[2], tau[0, :1], H, steps=3).q, 1e-13)
    close(ROBOT.rollout(q0[0], qd0[2], tau[0, :1], H).q, held.q[2, :2], 1e-13)  # one step
    close(ROBOT.rollout(q0[0], qd0[0], tau[0, :2], H).q, whole.q[0, :3], 1e-13)  # efforts of two steps
    assert ROBOT.rollout(q0[:0], qd0[:0], 0, H, steps=3).q.shape == (0, 4, DOF)
    assert ROBOT.rollout(q0[:0], qd0[:0], tau[:0], H).q.shape == (0, STEPS + 1, DOF)
    assert ROBOT.rollout(q0, qd0, 0, H, steps=0).q.shape == (5, 1, DOF)


def loop_of_states(robot, base, q, qd, tau, wrenches=None):
    """A free base beside the coordinates, by forward_dynamics and rotation_exp."""

    def rates(S, omega, q, qd, k):
        motion = hp.BodyMotion(R=(0, 0, 0), S=S, omega=omega)
        given = {link: (force[k], 0) for link, force in (wrenches or {}).items()}
        found = robot.forward_dynamics(q, qd, tau[k], base_motion=motion, wrenches=given)
        return np.concatenate([found.a1, found.alpha1, found.qdd])

    R, S, v, w = base.R, base.S, base.v, base.omega
    path = [(R, S, v, w, q, qd)]
    for k in range(STEPS):
        a = rates(S, w, q, qd, k)
        v, w, qd = v + H * a[:3], w + H * a[3:6], qd + H * a[6:]
        R, S, q = R + H * v, hp.rotation_exp(H * w) @ S, q + H * qd
        path.append((R, S, v, w, q, qd))
    return [np.stack(part) for part in zip(*path, strict=True)]


def test_a_free_base_moves_on_the_group():
    robot = Robot(record_of(MODEL), "free")
    (q0, qd0), tau = samples(2)
    base = base_motion(np.random.default_rng(8), (2,))
    link = tree_of(robot).tips[0]
    push = np.random.default_rng(9).normal(size=(STEPS, 3))
    found = robot.rollout(q0, qd0, tau, H, base_motion=base, wrenches={link: (push, 0)})
    one = hp.BodyMotion(**{x: getattr(base, x)[1] for x in ("R", "S", "v", "omega")})
    expected = loop_of_states(robot, one, q0[1], qd0[1], tau[1], {link: push})
    for name, exact in zip(("R1", "S1", "v1", "omega1", "q", "qd"), expected, strict=True):
        close(found[name][1], exact)
    assert found.base_motion.S.shape == (2, STEPS + 1, 3, 3)


@pytest.mark.slow(2)
def test_rk4_is_of_order_4_and_keeps_energy_and_momentum():
    """Of a free robot without loads; from half the step, a sixteenth of the drift."""
    robot = Robot(record_of(random_model(2, 4)), "free")
    rng = np.random.default_rng(11)
    q0, qd0 = rng.uniform(-1, 1, (2, 4))
    base = base_motion(rng)
    drifts = []
    for steps in (40, 80):
        r = robot.rollout(
            q0, qd0, 0, 1.0 / steps, steps=steps, method="rk4", base_motion=base, gravity=(0, 0, 0), every=4
        )
        energy = robot.energy(r.q, r.qd, base_motion=r.base_motion).kinetic
        momentum = np.hstack(robot.momentum(r.q, r.qd, base_motion=r.base_motion))
        drifts.append((np.abs(energy - energy[0]).max() / energy[0], np.abs(momentum - momentum[0]).max()))
        orthogonal = r.S1 @ np.swapaxes(r.S1, -1, -2) - np.eye(3)
        assert np.abs(orthogonal).max() < 64 * U
    coarse, fine = np.array(drifts)
    assert (coarse > 1e-10).all()
    assert (coarse / fine > 12).all()


@pytest.mark.slow
def test_a_diagonal_for_each_motion_is_the_controller_of_each():
    robot, rng = hp.load_robot("ur5_robot"), np.random.default_rng(1)
    q, K, D = rng.uniform(-1, 1, (6, 6)), rng.uniform(1, 50, (6, 6)), rng.uniform(1, 5, (6, 6))
    many = robot.rollout(q, np.zeros(6), hp.Feedback.diagonal(K, D, 0.1), 1e-3, steps=5).q
    for start, k, d, one in zip(q, K, D, many, strict=True):
        alone = robot.rollout(start, np.zeros(6), hp.Feedback(k, d, 0.1), 1e-3, steps=5).q
        np.testing.assert_allclose(one, alone, rtol=512 * U)
    with pytest.raises(
        hp.ShapeError, match=r"^tau.K: .*; hp.Feedback.diagonal takes a diagonal for each motion, got"
    ):
        robot.rollout(q[:5], np.zeros(6), hp.Feedback(K[:5], D[:5], 0.1), 1e-3, steps=5)


BODY = hp.Body(2.0, centre_of_mass=(0.1, -0.2, 0.3), inertia=(1, 2, 2.5))


@pytest.mark.slow
def test_one_free_rigid_body_falls_and_keeps_its_angular_momentum():
    pair = hp.HingePair(
        (0, 0, 0), (0, 0, 0), (0, 0, 1), name="h", body1=BODY, body2=hp.Body(1e-9, inertia=(1e-9,) * 3)
    )
    body = hp.Mechanism([pair], base="free").with_locked({"h": 0.0})
    start = hp.BodyMotion(R=(1, 2, 3), S=np.eye(3), v=(0.5, 0, 1), omega=(1, 2, 0.3))
    assert body.dof == 0
    found = body.rollout([], [], 0.0, 1e-3, steps=1000, every=250, base_motion=start, method="rk4")
    t, base = found.t, found.base_motion
    assert found.vjp({"R1": np.ones(3)}, wrt="v1")["v1"].shape == (3,)
    centre = body.centre_of_mass(np.zeros((5, 0)), base_motion=base)
    momentum = body.momentum(np.zeros((5, 0)), np.zeros((5, 0)), base_motion=base)
    expected = centre[0] + np.outer(t, momentum.linear[0] / BODY.mass) - np.outer(t**2 / 2, (0, 0, 9.81))
    np.testing.assert_allclose(centre, expected, rtol=0, atol=1e-6)  # of steps of this length
    spin = momentum.angular - np.cross(centre, momentum.linear)
    np.testing.assert_allclose(
        spin, np.broadcast_to(spin[0], spin.shape), rtol=0, atol=1e-8
    )  # of steps of this length


def test_a_linkage_that_is_lost_is_told():
    linkage = four_bar(coordinate="rocker")
    with pytest.warns(hp.DynamicsWarning, match="1 of 2 motions become NaN"):
        motion = linkage.rollout([[1.9], [1.9]], [[0.0], [100.0]], 0.0, 1e-3, steps=50, gravity=(0, 0, 0))
    assert np.isfinite(motion.q[0]).all()
