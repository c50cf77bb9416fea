"""Derivatives of prepared calls of pairs and planar pairs, against the Jacobians that the equations give."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import hingepair as hp

EPS = 2.0**-53
HOME = hp.rotation_exp(np.array((0.3, -0.8, 0.5)))
PAIR = hp.HingePair((0.5, -0.2, 0.1), (-0.3, 0.4, 0.2), (1, 2, -1.3), HOME)


@pytest.fixture
def states():
    return np.random.default_rng(11).uniform(-2, 2, (2, 5, 7))


def test_body_2_changes_by_coordinates_as_it_moves_by_their_rates(states):
    q, qd = states
    found = PAIR.prepare("velocity", outputs=("R2", "S2", "v2", "omega2")).jacobian((q, qd))
    np.testing.assert_allclose(found["R2"]["q"], found["v2"]["qd"], atol=64 * EPS)
    np.testing.assert_allclose(found["S2"]["q"], found["omega2"]["qd"], atol=64 * EPS)
    state = PAIR.forward_kinematics(q, qd)
    for name in ("v2", "omega2"):  # linear in qd
        np.testing.assert_allclose(np.einsum("nij,nj->ni", found[name]["qd"], qd), state[name], atol=64 * EPS)


def test_a_turn_of_body_1_and_of_the_hinge_moves_body_2_as_the_jacobian_says(states):
    turns, psi = hp.rotation_exp(states[0, :, :3]), states[0, :, 6]
    R1 = states[1, :, :3]
    J = PAIR.jacobian(hp.BodyMotion(R=R1, S=turns), psi)
    found = PAIR.prepare(("R1", "S1", "psi"), outputs=("R2", "S2")).jacobian((R1, turns, psi))
    for rows, output in ((slice(0, 3), "R2"), (slice(3, 6), "S2")):
        np.testing.assert_allclose(found[output]["S1"], J[:, rows, 3:6], atol=64 * EPS)
        np.testing.assert_allclose(found[output]["psi"], J[:, rows, 6], atol=64 * EPS)
    np.testing.assert_array_equal(found["R2"]["R1"], np.broadcast_to(np.eye(3), (5, 3, 3)))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["quat_xyzw", "quat_wxyz"])
def test_a_quaternion_of_any_length_changes_by_rotations_about_world_axes(states, name):
    axis, size = np.array([0.6, 0.0, -0.8]), 1.7
    vector, w, S1 = size * np.sin(0.55) * axis, size * np.cos(0.55), hp.rotation_exp(1.1 * axis)
    quat = [*vector, w] if name == "quat_xyzw" else [w, *vector]
    rest = states[0, 0, :3], states[1, 0, :3], 0.3, 0.2
    given, outputs = ("omega1", "psi", "psid"), ("d", "S2", "v2")
    found = PAIR.prepare(("v1", name, *given), outputs=outputs).jacobian((rest[0], quat, *rest[1:]))
    expected = PAIR.prepare(("v1", "S1", *given), outputs=outputs).jacobian((rest[0], S1, *rest[1:]))
    for output in outputs:
        np.testing.assert_allclose(found[output][name], expected[output]["S1"], atol=64 * EPS)


# ---- by constants


def test_a_turn_of_home_turns_body_2_about_the_hinge_point(states):
    psi, R1, S1 = states[0, :, 6], states[1, :, :3], hp.rotation_exp(states[0, :, :3])
    found = PAIR.prepare(("R1", "S1", "psi"), outputs=("R2", "S2")).jacobian((R1, S1, psi), wrt="home")
    S2 = PAIR.forward_kinematics_from_body1(hp.BodyMotion(R=R1, S=S1), psi).S2
    turns = S2 @ HOME.T  # world axes, one for each axis of body 1
    np.testing.assert_allclose(found["S2"]["home"], turns, rtol=0, atol=64 * EPS)
    moved = -np.cross(turns, (S2 @ PAIR.u2)[:, :, None], axis=1)
    np.testing.assert_allclose(found["R2"]["home"], moved, rtol=0, atol=64 * EPS)


@pytest.mark.slow(6)
def test_constraints_follow_the_geometry_as_difference_quotients_say(states):
    motions = [
        hp.BodyMotion(R=part[:3], S=hp.rotation_exp(turn[:3]), v=part[3:6], omega=turn[3:6])
        for part, turn in zip(states[0, :2], states[1, :2], strict=True)
    ]
    outputs = ("gap", "tilt", "psi", "gap_rate", "tilt_rate", "psid")
    names = ("R1", "S1", "v1", "omega1", "R2", "S2", "v2", "omega2")
    given = tuple(getattr(motion, letter) for motion in motions for letter in ("R", "S", "v", "omega"))
    found, h = PAIR.prepare(names, outputs=outputs).jacobian(given, wrt=("u1", "u2", "n", "home")), 1e-5
    for name in ("u1", "u2", "n", "home"):
        for k, e in enumerate(np.eye(3) * h):
            sides = []
            for step in (e, -e):
                value = getattr(PAIR, name)
                moved = hp.rotation_exp(step) @ value if name == "home" else value + step
                pair = dataclasses.replace(PAIR, **{name: moved})
                sides.append(pair.prepare(names, outputs=outputs, backend="numpy")(*given))
            for output in outputs:
                quotient = (sides[0][output] - sides[1][output]) / (2 * h)
                np.testing.assert_allclose(found[output][name][..., k], quotient, rtol=0, atol=10 * h * h)


@pytest.mark.slow(6)
def test_products_with_derivatives_by_constants_are_products(states):
    call = PAIR.prepare("acceleration", outputs=("R2", "a2"))
    given, names = (*states, states[0]), ("u1", "n", "home")
    rng, J = np.random.default_rng(2), call.jacobian(given, wrt=("q", *names))
    changes = {name: rng.normal(size=J["a2"][name].shape[-1]) for name in names}
    value, rates = call.jvp(given, changes)
    expected = sum(np.einsum("sij,j->si", J["a2"][name], change) for name, change in changes.items())
    np.testing.assert_allclose(rates["a2"], expected, rtol=0, atol=1e3 * EPS)
    weight = rng.normal(size=rates["a2"].shape)
    same, gradient = call.vjp(given, {"a2": weight}, wrt=names)
    assert set(gradient) == {*names}
    for name in names:
        np.testing.assert_allclose(gradient[name], np.einsum("sij,si->sj", J["a2"][name], weight), atol=1e3 * EPS)
    for ours in (value, same):
        np.testing.assert_allclose(ours.a2, call(*given).a2, rtol=0, atol=1e3 * EPS)
