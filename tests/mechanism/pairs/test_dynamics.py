"""Forces and motion of the pair (D1-D8), against laws that need no reference."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.near import assert_near
from support.states import generator, rotations
from support.states import pair as random_pair

U = 2.0**-53
GRAVITY = np.array([0.3, -0.2, -9.81])


def random_body(rng):
    turn = rotations(rng, 1)[0]
    moments = rng.uniform(0.5, 1, 3)
    inertia = turn @ np.diag(moments) @ turn.T
    return hp.Body(rng.uniform(0.5, 3), rng.normal(size=3), (inertia + inertia.T) / 2)


def massive(rng):
    u1, u2, n, home = random_pair(rng)
    return hp.HingePair(u1, u2, n, home, body1=random_body(rng), body2=random_body(rng))


def moving(rng, *shape):
    R, v, omega, a, alpha = rng.normal(size=(5, *shape, 3))
    return hp.BodyMotion(R=R, S=rotations(rng, *shape), v=v, omega=omega, a=a, alpha=alpha)


def size_of(pair, body1, psid, psidd):
    """Mass, reach and acceleration of a state: what its forces and torques are made of before they cancel."""
    levers = (pair.u1, pair.u2, pair.body1.centre_of_mass, pair.body2.centre_of_mass)
    reach = 1 + sum(map(np.linalg.norm, levers))
    mass = pair.body1.mass + pair.body2.mass + np.abs(pair.body1.inertia).sum() + np.abs(pair.body2.inertia).sum()
    rate = np.linalg.norm(body1.omega) + abs(psid)
    push = np.linalg.norm(body1.a) + np.linalg.norm(GRAVITY) + np.linalg.norm(body1.alpha) + abs(psidd) + rate**2
    return mass * reach**2, push


def case_of(seed):
    rng = generator(17, seed)
    pair, body1 = massive(rng), moving(rng)
    rates = rng.uniform(-3, 3), *rng.normal(size=2)
    return pair, body1, rates


@pytest.fixture(params=range(4))
def case(request):
    return case_of(request.param)


def test_what_acts_and_what_moves_are_each_others_inverse(case):
    """Loads on body 2 included: they count as what they are about R1 and about the hinge."""
    pair, body1, (psi, psid, psidd) = case
    loads = dict(zip(("force1", "torque1", "force2", "torque2"), generator(19).normal(size=(4, 3)), strict=True))
    a1, alpha1, found = pair.forward_dynamics(body1, psi, psid, **loads, hinge_torque=-0.4, gravity=GRAVITY)
    moved = hp.BodyMotion(R=body1.R, S=body1.S, omega=body1.omega, a=a1, alpha=alpha1)
    forces = pair.inverse_dynamics(moved, psi, psid, found, gravity=GRAVITY)
    state = pair.forward_kinematics_from_body1(body1, psi)
    axis, arm = body1.S @ pair.n, -state.S2 @ pair.u2
    force2, torque2 = loads["force2"], loads["torque2"]
    mass, push = size_of(pair, body1, psid, psidd)
    near = 64 * U * mass * (push + 4)
    np.testing.assert_allclose(forces.force1, loads["force1"] + force2, rtol=0, atol=near)
    np.testing.assert_allclose(
        forces.torque1, loads["torque1"] + torque2 + np.cross(state.d, force2), rtol=0, atol=near
    )
    motor = -0.4 + axis @ (torque2 + np.cross(arm, force2))
    np.testing.assert_allclose(forces.hinge_torque, motor, rtol=0, atol=near)


NEEDLE = hp.HingePair(
    (1, 0, 0), (0, 0, 0), (0, 0, 1), name="needle", body1=hp.Body(1, inertia=(1, 1, 1)),
    body2=hp.Body(mass=1, inertia=(1, 1, 1e-30)),
)  # fmt: skip
"""Body 2 is a rod along the hinge axis, of no thickness to round-off: nothing resists psi."""


def test_a_motion_without_resistance_is_nan_and_said():
    turned = hp.BodyMotion(R=(0, 0, 0), S=rotations(generator(23), 1)[0], omega=(0, 0, 0))
    with pytest.warns(hp.DynamicsWarning, match=r"needle: no mass resists joint 'hinge' at 2 of 2 samples"):
        found = NEEDLE.forward_dynamics(turned, [0.3, 0.4], 0.0)
    assert all(np.isnan(part).all() for part in found)
    prepared = NEEDLE.prepare("forward_dynamics")
    with pytest.warns(hp.DynamicsWarning, match="no mass resists joint 'hinge' here"):
        found = prepared(np.eye(3), np.zeros(3), 0.1, 0.2, np.zeros(3), np.zeros(3), 0.0)
    assert np.isnan(found.psidd)
    light = hp.Body(mass=1e-30, inertia=(1e-30, 1e-30, 1e-30))
    pair = hp.HingePair(
        (1, 0, 0), (0, 1, 0), (0, 0, 1), name="light", body1=light, body2=hp.Body(1, inertia=(1, 1, 1))
    )
    with pytest.warns(hp.DynamicsWarning, match="light: no mass resists the base here"):
        pair.forward_dynamics(turned, 0.3, 0.0)


def test_an_inertia_that_was_not_given_is_warned_of_and_shapes_give_one():
    body1 = moving(generator(24))
    shaped = hp.Body(mass=3, shapes=[hp.Box((1, 2, 3), (0, 0, 1)), hp.Sphere(0.5, (0, 0, -1))])
    pair = hp.HingePair((1, 0, 0), (0, 1, 0), (0, 0, 1), body1=shaped, body2=hp.Body(mass=1))
    with pytest.warns(hp.DynamicsWarning, match="body2: no inertia is given"):
        pair.mass_matrix(body1, 0.0)
    volumes = np.array([6, np.pi / 6])
    m = 3 * volumes / volumes.sum()
    middle = (m[0] - m[1]) / 3
    about = m[0] * (4 + 9) / 12 + m[0] * (1 - middle) ** 2 + 0.4 * m[1] * 0.25 + m[1] * (1 + middle) ** 2
    assert_near(shaped.centre_of_mass, (0, 0, middle), 4)
    assert shaped.inertia[0, 0] == pytest.approx(about, rel=8 * U)
    assert shaped.inertia[2, 2] == pytest.approx(m[0] * 5 / 12 + 0.1 * m[1], rel=8 * U)
    lying = hp.Body(1, shapes=[hp.Cylinder(1, 2, axis=(1, 0, 0))])
    assert_near(lying.inertia.diagonal(), (1 / 2, 7 / 12, 7 / 12), 4)


@pytest.mark.slow
def test_prepared_loads_on_body2_and_coordinates():
    rng = generator(26)
    pair, (q, qd) = massive(rng), rng.normal(size=(2, 4, 7))
    force2, torque2 = rng.normal(size=(2, 4, 3))
    found = pair.prepare(("q", "qd", "force2", "torque2"), outputs=("a1", "psidd", "a2"))(q, qd, force2, torque2)
    state = pair.forward_kinematics(q, qd, outputs=("R1", "S1", "v1", "omega1"))
    body1 = hp.BodyMotion(R=state.R1, S=state.S1, v=state.v1, omega=state.omega1)
    a = pair.forward_dynamics(body1, q[:, 6], qd[:, 6], force2=force2, torque2=torque2)
    assert_near(found.a1, a.a1, 256)
    assert_near(found.psidd, a.psidd, 256)
    moved = hp.BodyMotion(R=state.R1, S=state.S1, v=state.v1, omega=state.omega1, a=a.a1, alpha=a.alpha1)
    body2 = pair.forward_kinematics_from_body1(moved, q[:, 6], qd[:, 6], a.psidd)
    assert_near(found.a2, body2.a2, 256)


def test_a_mass_that_nobody_gave_is_said_once():
    shapes = [hp.Sphere(radius=0.1)]
    pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), body2=hp.Body(shapes=shapes))
    still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 0), a=(0, 0, 0), alpha=(0, 0, 0))
    with pytest.warns(hp.DynamicsWarning, match=r"body2: no mass is given, 1 kg is taken"):
        pair.hinge_wrench(still, 0.0, 0.0, 0.0)
    found = pair.hinge_wrench(still, 0.0, 0.0, 0.0)
    assert_near((found.force, found.torque), (found.hinge_force, found.hinge_moment), 0)
    assert_near(found.force, (0, 0, 9.81), 4)
    assert_near(found.torque, (0, -9.81, 0), 4)
