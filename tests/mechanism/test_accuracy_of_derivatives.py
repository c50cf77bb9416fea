"""Derivatives of torques are within their bounds of 60 digits, those of accelerations leave little, of all robots."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from hingepair import ArgumentError
from hingepair.mechanism.mechanism import tree_of
from support.exact import Exact
from support.trees import Robot, random_model, record_of, urdf_model

EPS, MARK = 2.0**-53, pytest.mark


def hard_states(rng, dof):
    """q, qd, qdd: ordinary, large angles, tiny ones near right angles, large and tiny rates."""
    q, qd, qdd = rng.uniform(-3, 3, (3, 5, dof))
    q[1] *= 1e8
    q[2] = np.pi / 2 * rng.integers(-2, 3, dof) + 1e-9 * q[2]
    qd[3], qdd[3] = 1e6 * qd[3], 1e12 * qdd[3]
    qd[4], qdd[4] = 1e-9 * qd[4], 1e-160 * qdd[4]
    return q, qd, qdd


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_derivatives_of_torques_are_those_of_60_digits(seed):
    robot = Robot(record_of(random_model(seed, 4)))
    states = hard_states(np.random.default_rng(seed), robot.dof)
    slides = [joint.axis.shifts != 0 for joint in tree_of(robot).coordinates]
    states[0][1, slides] *= 1e-8  # large angles, not lengths
    exact = Exact(tree_of(robot), None, False, dict(zip(("q", "qd", "qdd"), states, strict=True))).torque_slopes()
    del exact["tau_qdd"]
    for backend in ("numpy", "compiled"):
        found = robot.inverse_dynamics_derivatives(*states, outputs=("tau_q", "tau_qd"), backend=backend)
        for name, truth in exact.items():
            errors = np.abs(found[name] - truth).astype(float).max(axis=(-2, -1))
            sizes = np.abs(np.asarray(truth, float)).max(axis=(-2, -1))
            assert (errors <= 256 * EPS * sizes).all(), (backend, name, errors / sizes / EPS)


@pytest.mark.slow
def test_derivatives_of_accelerations_leave_little_in_60_digits():
    robot = Robot(record_of(random_model(1, 4)))
    q, qd, tau = np.random.default_rng(5).uniform(-2, 2, (3, 2, robot.dof))
    found = robot.forward_dynamics_derivatives(q, qd, tau)
    exact = Exact(tree_of(robot), None, False, {"q": q, "qd": qd})
    M, slopes_of = np.asarray(exact.mass_matrix(), float), exact.at(qdd=exact.accelerations(tau)).torque_slopes()
    for name in ("qdd_q", "qdd_qd"):
        slopes = slopes_of[name.replace("qdd", "tau", 1)]
        left = np.asarray(M @ found[name] + np.asarray(slopes, float))
        scale = np.abs(M).max() * np.abs(found[name]).max() * np.linalg.cond(M).max()
        np.testing.assert_allclose(left, 0, rtol=0, atol=64 * EPS * scale)


def models():
    from hingepair.formats.robots import robot_names

    return robot_names()


SLOW = ("solo12", "panda")  # branches, and a follower


@pytest.mark.filterwarnings("ignore::hingepair.DynamicsWarning")
@pytest.mark.parametrize("name", [pytest.param(x, marks=MARK.slow if x in SLOW else MARK.proof) for x in models()])
def test_derivatives_of_every_robot_are_those_of_pinocchio(name):
    try:
        model = urdf_model(name)
        robot = Robot(record_of(model))
    except Exception as error:
        pytest.skip(f"no model of single coordinates: {error}")
    if not robot.dof:
        pytest.skip("nothing moves")
    data, rng = model.createData(), np.random.default_rng(7)
    q, qd, qdd = rng.uniform(-1.5, 1.5, (3, robot.dof))
    found = robot.inverse_dynamics_derivatives(q, qd, qdd)
    pin.computeRNEADerivatives(model, data, q, qd, qdd)
    M = np.triu(data.M) + np.triu(data.M, 1).T
    expected = {"tau_q": data.dtau_dq, "tau_qd": data.dtau_dv, "tau_qdd": M}
    size = max(np.abs(theirs).max() for theirs in expected.values())  # some of them may be zero
    for key, theirs in expected.items():
        np.testing.assert_allclose(found[key], theirs, rtol=0, atol=512 * EPS * size, err_msg=key)
    if not np.isfinite(np.linalg.cond(M)) or np.linalg.cond(M) > 1e12:
        return  # no accelerations
    tau = robot.inverse_dynamics(q, qd, qdd).tau
    if robot.dof > 80:  # a program of minutes, which is refused
        with pytest.raises(ArgumentError, match="fewer joints"):
            robot.forward_dynamics_derivatives(q, qd, tau)
        return
    ours = robot.forward_dynamics_derivatives(q, qd, tau)
    if np.isnan(ours.qdd_q).any():
        return
    for key, theirs in (("qdd_q", data.dtau_dq), ("qdd_qd", data.dtau_dv)):
        scale = abs(M).max() * abs(ours[key]).max() + size
        np.testing.assert_allclose(M @ ours[key], -theirs, rtol=0, atol=512 * EPS * np.linalg.cond(M) * scale)
