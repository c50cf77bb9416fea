"""A hinge that turns as given: what it makes of a body 1 that is free, and the torque that it takes."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.states import generator, rotations

STILL = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
WEIGHTLESS = (0.0, 0.0, 0.0)


def swing(t):
    return np.sin(3 * t), 3 * np.cos(3 * t), -9 * np.sin(3 * t)


@pytest.mark.slow
def test_a_reaction_wheel_turns_its_satellite_the_other_way():
    """Both of one axis: phi' (I1 + I2) + I2 psi' is constant."""
    satellite, wheel = hp.Body(5.0, inertia=(3, 3, 2)), hp.Body(1.0, inertia=(0.3, 0.3, 0.5))
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body1=satellite, body2=wheel)
    t = np.linspace(0, 4, 41)
    still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, -3 * 0.5 / 2.5))
    found = hp.simulate(pair, t, still, hinge=swing, gravity=WEIGHTLESS, tol=1e-12)
    angle = -0.2 * np.sin(3 * t)
    expected = hp.rodrigues((0, 0, 1), angle)
    np.testing.assert_allclose(found.S1, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.loads["hinge_torque"], 0.5 * 0.8 * swing(t)[2], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.psi, swing(t)[0])
    assert found.error_estimate < 1e-11
    assert found.psi_error_estimate == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("base", ["free", "pinned", "fixed"])
def test_the_torque_of_a_driven_hinge_is_that_of_inverse_dynamics(base):
    rng = generator(71)
    bodies = [hp.Body(rng.uniform(1, 2), rng.normal(size=3), np.diag(rng.uniform(0.6, 1, 3))) for _ in range(2)]
    pair = hp.HingePair(*rng.normal(size=(3, 3)), home=rotations(rng, 1)[0], body1=bodies[0], body2=bodies[1])
    v, omega = rng.normal(size=(2, 3))
    moving = {"free": {"v": v, "omega": omega}, "pinned": {"omega": omega}, "fixed": {}}[base]
    start, t = hp.BodyMotion(R=rng.normal(size=3), S=rotations(rng, 1)[0], **moving), np.linspace(0, 1, 11)
    found = hp.simulate(pair, t, start, hinge=swing, base=base, force2=(0, 0, 2), tol=1e-12)
    forces = pair.inverse_dynamics(found.body1, found.psi, found.psid, found.psidd)
    np.testing.assert_array_equal(found.psidd, swing(t)[2])
    by_force2 = (np.cross(found.S1 @ pair.n, found.R2 - (found.R1 + found.S1 @ pair.u1)) * (0, 0, 2)).sum(-1)
    np.testing.assert_allclose(forces.hinge_torque, found.loads["hinge_torque"] + by_force2, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(found.loads["motor_torque"], found.loads["hinge_torque"])
    if base == "free":
        np.testing.assert_allclose(forces.force1, np.broadcast_to((0, 0, 2), (11, 3)), rtol=0, atol=1e-10)


def test_what_does_not_go_with_a_driven_hinge_is_named():
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=hp.Body(1.0, inertia=(1, 1, 1)))
    for name, given in (
        ("psi_0", {"psi_0": 1.0}), ("psid_0", {"psid_0": 1.0}), ("hinge_torque", {"hinge_torque": 1.0}),
        ("hinge_torque", {"hinge_torque": hp.HingeLoad()}), ("hinge", {"hinge": "driven"}),
        ("hinge", {"hinge": lambda: 0}), ("hinge", {"hinge": lambda t: t}),
    ):  # fmt: skip
        with pytest.raises(hp.ArgumentError, match=rf"^{name}: expected "):
            hp.simulate(pair, [0, 1], STILL, base="fixed", **{"hinge": swing} | given)
    with pytest.raises(hp.ArgumentError, match=r"^psi_0: expected"):
        hp.simulate(pair, [0, 1], STILL, base="fixed")
