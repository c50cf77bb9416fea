"""A robot of one joint is a pair: T1-T8 give what E1-E9 and D1-D8 give."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.trees import base_motion

BODY1 = hp.Body(2.0, (0.1, -0.2, 0.3), ((0.5, 0.02, -0.03), (0.02, 0.4, 0.01), (-0.03, 0.01, 0.6)))
BODY2 = hp.Body(1.5, (-0.2, 0.1, 0.05), (0.2, 0.3, 0.25))
PAIRS = {
    "along_z": {"n": (0, 0, 1)},
    "along_minus_x": {"n": (-2, 0, 0)},
    "along_y_with_home": {"n": (0, 1, 0), "home": hp.rotation_exp((0.3, -0.5, 0.2))},
    "oblique": {"n": (0.3, -0.4, 0.6), "home": hp.rotation_exp((0.3, -0.5, 0.2))},
}
COUNT = 6


@pytest.fixture(scope="module", params=PAIRS)
def pair(request):
    given = {"u1": (0.5, -0.1, 0.2), "u2": (-0.25, 0.1, 0.3), "body1": BODY1, "body2": BODY2, "name": "hinge"}
    return hp.HingePair(**given, **PAIRS[request.param])


@pytest.fixture(scope="module")
def robot(pair):
    return hp.Mechanism([pair], base="free")


def moving(key):
    rng = np.random.default_rng(key)
    base = base_motion(rng, (COUNT,))
    return base, *rng.uniform(-3, 3, (3, COUNT))


def close(found, expected):
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-13 * max(1.0, np.abs(expected).max()))


@pytest.mark.slow
def test_its_link_moves_as_body_2(pair, robot):
    base, psi, psid, psidd = moving(1)
    state = pair.forward_kinematics_from_body1(base, psi, psid, psidd)
    link = robot.forward_kinematics(psi[:, None], psid[:, None], psidd[:, None], base_motion=base)["hinge"]
    for name in ("R", "S", "v", "omega", "a", "alpha"):
        close(link.arrays()[name], state.arrays()[f"{name}2"])
    close(link.d, state.d)
    close(robot.jacobian(psi[:, None], base_motion=base), pair.jacobian(base, psi))
    close(
        robot.acceleration_bias(psi[:, None], psid[:, None], base_motion=base),
        pair.acceleration_bias(base, psi, psid),
    )


@pytest.mark.slow
def test_its_forces_are_those_of_the_pair(pair, robot):
    base, psi, psid, psidd = moving(2)
    q, qd, qdd = psi[:, None], psid[:, None], psidd[:, None]
    forces, expected = (
        robot.inverse_dynamics(q, qd, qdd, base_motion=base),
        pair.inverse_dynamics(base, psi, psid, psidd),
    )
    close(forces.tau[:, 0], expected.hinge_torque)
    close(forces.force1, expected.force1)
    close(forces.torque1, expected.torque1)
    close(robot.mass_matrix(q, base_motion=base), pair.mass_matrix(base, psi))
    loads = {"force1": forces.force1, "torque1": forces.torque1}
    moves = robot.forward_dynamics(q, qd, forces.tau, base_motion=base, **loads)
    same = pair.forward_dynamics(base, psi, psid, hinge_torque=forces.tau[:, 0], **loads)
    np.testing.assert_allclose(moves.qdd[:, 0], same.psidd, atol=1e-11)
    np.testing.assert_allclose(moves.a1, same.a1, atol=1e-11)
    np.testing.assert_allclose(moves.alpha1, same.alpha1, atol=1e-11)


@pytest.mark.slow
def test_a_wrench_on_its_link_acts_at_the_reference_point_of_body_2(pair, robot):
    base, psi, psid, _ = moving(3)
    force, torque = np.random.default_rng(4).normal(size=(2, COUNT, 3))
    moves = robot.forward_dynamics(
        psi[:, None], psid[:, None], np.zeros((COUNT, 1)), base_motion=base, wrenches={"hinge": (force, torque)}
    )
    same = pair.forward_dynamics(base, psi, psid, force2=force, torque2=torque)
    np.testing.assert_allclose(moves.qdd[:, 0], same.psidd, atol=1e-11)
    np.testing.assert_allclose(moves.a1, same.a1, atol=1e-11)


@pytest.mark.slow
def test_its_energy_and_momentum_are_those_of_the_pair(pair, robot):
    base, psi, psid, _ = moving(5)
    q, qd = psi[:, None], psid[:, None]
    for found, expected in (
        (robot.energy(q, qd, base_motion=base), pair.energy(base, psi, psid)),
        (robot.momentum(q, qd, base_motion=base), pair.momentum(base, psi, psid)),
    ):
        for part, same in zip(found, expected, strict=True):
            close(part, same)


@pytest.mark.slow
def test_its_joint_transmits_what_the_hinge_does(pair, robot):
    base, psi, psid, psidd = moving(6)
    found = robot.joint_wrenches(psi[:, None], psid[:, None], psidd[:, None], base_motion=base)["hinge"]
    expected = pair.hinge_wrench(base, psi, psid, psidd)
    close(found.force, expected.force)
    close(found.torque, expected.torque)
