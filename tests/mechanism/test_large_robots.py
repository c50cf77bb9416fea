"""Robots of many joints, as Pinocchio computes them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from support import states


def chain(count):
    """Hinges along all directions, with bodies."""
    rng = states.generator(822, count)
    pairs = []
    for k in range(count):
        body = hp.Body(mass=1.0, centre_of_mass=rng.normal(size=3) * 0.1, inertia=(0.02, 0.03, 0.04))
        place = {"u1": rng.normal(size=3) * 0.1, "u2": (0, 0, 0), "n": rng.normal(size=3)}
        home = hp.euler_to_matrix(rng.normal(size=3))
        pairs.append(hp.HingePair(**place, home=home, name=f"joint_{k}", body2=body))
    return hp.Mechanism(pairs)


@pytest.mark.slow
def test_what_is_recorded_has_a_limit(monkeypatch):
    """A million operations, which the derivatives of 100 joints pass, would take LLVM minutes and gigabytes."""
    monkeypatch.setattr("hingepair.engine.trace.MAX_OPERATIONS", 50_000)
    call = chain(24).prepare("inverse_dynamics", outputs=("tau",), backend="numpy")
    with pytest.raises(hp.ArgumentError, match="program: expected at most 50,000 operations"):
        call.jacobian(tuple(np.zeros((3, 24))))
    monkeypatch.setattr("hingepair.engine.trace.MAX_OPERATIONS", 500)  # of a mass matrix, before it is recorded
    with pytest.raises(hp.ArgumentError, match="program: expected at most 500 operations"):
        chain(24).mass_matrix(np.zeros(24))


@pytest.mark.slow
def test_a_long_chain_agrees_with_pinocchio():
    count = 40
    robot, rng = chain(count), states.generator(823)
    twin = hp.to_pinocchio(robot)
    q, qd, qdd = rng.normal(size=(3, 3, count))
    state = robot.forward_kinematics(q, qd, qdd)
    tau = robot.inverse_dynamics(q, qd, qdd).tau
    M = robot.mass_matrix(q)
    solved = robot.forward_dynamics(q, qd, tau).qdd
    for k in range(3):
        at = twin.configuration(q[k]), twin.velocity(q[k], qd[k]), twin.acceleration(q[k], qd[k], qdd[k])
        near(tau[k], pin.rnea(twin.model, twin.data, *at))
        upper = np.triu(pin.crba(twin.model, twin.data, at[0]))
        near(M[k], upper + np.triu(upper, 1).T)
        change = twin.acceleration(q[k], qd[k], solved[k])
        near(pin.rnea(twin.model, twin.data, *at[:2], change), tau[k])
        pin.forwardKinematics(twin.model, twin.data, *at)
        near(state.R[k, 0], twin.data.oMi[count].translation)
        near(state.S[k, 0], twin.data.oMi[count].rotation)


def near(found, expected):
    assert abs(found - expected).max() <= 1e-11 * abs(expected).max()  # both round along a hundred joints
