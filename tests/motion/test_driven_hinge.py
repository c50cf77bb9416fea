"""A hinge that turns as given: what it makes of a body 1 that is free, and the torque that it takes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import hingepair as hp
from support.near import TIGHT, TOL
from support.states import generator, rotations

STILL = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
WEIGHTLESS = (0.0, 0.0, 0.0)


def driven(pair, t, start, hinge, base="free", **given):
    """The motion of a pair whose hinge moves as given."""
    robot = hp.Mechanism([replace(pair, name="psi")], base="fixed" if base == "fixed" else "free")
    return hp.simulate(robot, t, [0.0], driven={"psi": hinge}, base=base, base_motion=start, **given)


def swing(t):
    return np.sin(3 * t), 3 * np.cos(3 * t), -9 * np.sin(3 * t)


@pytest.mark.slow
def test_a_reaction_wheel_turns_its_satellite_the_other_way():
    """Both of one axis: phi' (I1 + I2) + I2 psi' is constant."""
    satellite, wheel = hp.Body(5.0, inertia=(3, 3, 2)), hp.Body(1.0, inertia=(0.3, 0.3, 0.5))
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body1=satellite, body2=wheel)
    t = np.linspace(0, 4, 41)
    still = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, -3 * 0.5 / 2.5))
    found = driven(pair, t, still, swing, gravity=WEIGHTLESS, tol=TIGHT)
    angle = -0.2 * np.sin(3 * t)
    expected = hp.rodrigues((0, 0, 1), angle)
    np.testing.assert_allclose(found.base_motion.S, expected, rtol=0, atol=TIGHT)
    np.testing.assert_allclose(found.tau[:, 0], 0.5 * 0.8 * swing(t)[2], rtol=0, atol=TIGHT)
    np.testing.assert_array_equal(found.q[:, 0], swing(t)[0])
    assert found.attitude_error_estimate < 10 * TIGHT
    assert found.q_error_estimate == [0.0]


@pytest.mark.slow
@pytest.mark.parametrize("base", ["free", "pinned", "fixed"])
def test_the_torque_of_a_driven_hinge_is_that_of_inverse_dynamics(base):
    rng = generator(71)
    bodies = [hp.Body(rng.uniform(1, 2), rng.normal(size=3), np.diag(rng.uniform(0.6, 1, 3))) for _ in range(2)]
    pair = hp.HingePair(*rng.normal(size=(3, 3)), home=rotations(rng, 1)[0], body1=bodies[0], body2=bodies[1])
    v, omega = rng.normal(size=(2, 3))
    moving = {"free": {"v": v, "omega": omega}, "pinned": {"omega": omega}, "fixed": {}}[base]
    start, t = hp.BodyMotion(R=rng.normal(size=3), S=rotations(rng, 1)[0], **moving), np.linspace(0, 1, 11)
    found = driven(pair, t, start, swing, base, wrenches={"psi": ((0, 0, 2), 0)}, tol=TIGHT)
    R2 = pair.forward_kinematics_from_body1(found.base_motion, found.q[:, 0], outputs=("R2",)).R2
    forces = pair.inverse_dynamics(found.base_motion, found.q[:, 0], found.qd[:, 0], found.qdd[:, 0])
    np.testing.assert_array_equal(found.qdd[:, 0], swing(t)[2])
    by_force2 = (
        np.cross(found.base_motion.S @ pair.n, R2 - (found.base_motion.R + found.base_motion.S @ pair.u1)) * (0, 0, 2)
    ).sum(-1)
    np.testing.assert_allclose(forces.hinge_torque, found.tau[:, 0] + by_force2, rtol=0, atol=TOL)
    np.testing.assert_array_equal(found.loads["motor"][:, 0], found.tau[:, 0])
    if base == "free":
        np.testing.assert_allclose(forces.force1, np.broadcast_to((0, 0, 2), (11, 3)), rtol=0, atol=TOL)


def test_rates_that_instants_are_too_coarse_for_are_taken_as_given():
    """A tenth of a millisecond of a clock that counts from 1970, whose instants are 0.24 microseconds apart."""
    t = 1.7e9 + np.linspace(0, 1e-4, 3)
    pair = hp.HingePair((0, 0, 0), (1, 0, 0), (0, 0, 1), body2=hp.Body(1.0, inertia=(1, 1, 1)))
    found = driven(pair, t, STILL, lambda t: (t - 1.7e9, 0 * t + 1, 0 * t), "fixed")
    np.testing.assert_array_equal(found.qd[:, 0], 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.0, -1.0, 1.5, np.pi / 180])
@pytest.mark.parametrize("offset", [0.0, 1e7])
def test_rates_that_are_not_derivatives_are_refused(factor, offset):
    pair = hp.HingePair((0, 0, 0), (1, 0, 0), (0, 0, 1), body2=hp.Body(1.0, inertia=(1, 1, 1)))
    t = np.linspace(0, 3, 5)
    start = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))

    def turning(rate, acceleration):
        return lambda t: (np.sin(t), rate * np.cos(t), acceleration * -np.sin(t))

    driven(pair, t, start, turning(1.0, 1.0), "fixed")
    with pytest.raises(hp.ArgumentError, match=r"^driven.*: .*psid is the derivative of its psi"):
        driven(pair, t, start, turning(factor, factor), "fixed")
    with pytest.raises(hp.ArgumentError, match=r"^driven.*: .*psidd is the derivative of its psid"):
        driven(pair, t, start, turning(1.0, factor), "fixed")

    def base(**factors):
        by = {"v": 1.0, "omega": 1.0, "a": 1.0, "alpha": 1.0} | factors

        def motion(t):
            axis = np.array([0.6, 0.0, 0.8])
            zero = np.zeros((len(t), 3))
            wave, rate = zero + np.sin(t)[:, None], zero + np.cos(t)[:, None]
            v, omega = by["v"] * rate, by["omega"] * rate * axis
            a, alpha = -by["a"] * by["v"] * wave, -by["alpha"] * by["omega"] * wave * axis
            return hp.BodyMotion(R=offset + wave, S=hp.rodrigues(axis, np.sin(t)), v=v, omega=omega, a=a, alpha=alpha)

        return motion

    hp.simulate(pair, t, None, 0.0, 0.0, base=base())
    for rate, quantity in (("v", "R"), ("omega", "S"), ("a", "v"), ("alpha", "omega")):
        if factor or rate in ("a", "alpha"):
            with pytest.raises(hp.ArgumentError, match=rf"^base: .*{rate} is the derivative of its {quantity}"):
                hp.simulate(pair, t, None, 0.0, 0.0, base=base(**{rate: factor}))


def ramp(t, end=0.7):
    """A hinge that turns at 1 rad/s until it stops at once."""
    return np.minimum(t, end), np.where(t < end, 1.0, 0.0), 0 * t


def test_a_rate_that_jumps_is_refused_and_one_that_changes_fast_is_not():
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=hp.Body(1.0, inertia=(1, 1, 1)))
    given = {"base": "fixed", "tol": 1e-6}
    with pytest.raises(hp.ArgumentError, match=r"^driven.*: expected .* psid does not jump, got .* at t = 0\.7 s"):
        driven(pair, np.linspace(0, 2, 3), STILL, ramp, **given)
    with pytest.raises(hp.ArgumentError, match=r"^base: expected .* v does not jump, got .* at t = 0\.7 s"):
        hp.simulate(
            pair, np.linspace(0, 2, 3), None, 0.0, 0.0,
            base=lambda t: hp.BodyMotion(
                R=np.stack([ramp(t)[0], 0 * t, 0 * t], -1), S=np.tile(np.eye(3), (len(t), 1, 1)),
                v=np.stack([ramp(t)[1], 0 * t, 0 * t], -1), omega=np.zeros((len(t), 3)), a=np.zeros((len(t), 3)),
                alpha=np.zeros((len(t), 3)),
            ),
        )  # fmt: skip
    smooth = [
        (lambda t: (np.sin(3000 * t), 3000 * np.cos(3000 * t), -9e6 * np.sin(3000 * t)), np.linspace(0, 0.02, 3)),
        (lambda t: (np.maximum(t - 1, 0) ** 2, 2 * np.maximum(t - 1, 0), 2.0 * (t > 1)), np.linspace(0, 2, 3)),
        (ramp, np.array([0, 0.7])),
        (lambda t: (0 * t + 2, 0 * t, 0 * t), np.linspace(0, 1, 3)),
    ]
    for hinge, t in smooth:
        assert len(driven(pair, t, STILL, hinge, **given).q) == len(t)
    late = 1.7e9 + np.linspace(0, 2, 3)
    assert len(driven(pair, late, STILL, lambda t: swing(t - late[0]), **given).q) == 3
