"""Derivatives of prepared calls of pairs and planar pairs, against the Jacobians that the equations give."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp

EPS = 2.0**-53
PAIR = hp.HingePair((0.5, -0.2, 0.1), (-0.3, 0.4, 0.2), (1, 2, -1), home=hp.rotation_exp(np.array((0.3, -0.8, 0.5))))


@pytest.fixture
def states():
    return np.random.default_rng(11).uniform(-2, 2, (2, 5, 7))


def test_body_2_changes_as_the_coordinate_jacobian_says(states):
    q, qd = states
    J, rate = PAIR.coordinate_jacobian(q), PAIR.coordinate_jacobian_rate(q, qd)
    found = PAIR.prepare("velocity", outputs=("R2", "S2", "v2", "omega2")).jacobian((q, qd))
    np.testing.assert_allclose(found["R2"]["q"], J[:, :3], atol=64 * EPS)
    np.testing.assert_allclose(found["S2"]["q"], J[:, 3:], atol=64 * EPS)
    np.testing.assert_allclose(found["v2"]["qd"], J[:, :3], atol=64 * EPS)
    np.testing.assert_allclose(found["omega2"]["qd"], J[:, 3:], atol=64 * EPS)
    # v2 = J qd, so its derivative by q along qd is J' qd.
    np.testing.assert_allclose((found["v2"]["q"] @ qd[..., None])[..., 0], (rate[:, :3] @ qd[..., None])[..., 0],
                               atol=1e4 * EPS)  # fmt: skip


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


@pytest.mark.slow
@pytest.mark.parametrize("planar", [False, True])
def test_products_with_the_jacobian_are_its_products(states, planar):
    pair = hp.PlanarPair((0.5, -0.2), (-0.3, 0.4)) if planar else PAIR
    given = tuple(states[..., [0, 1, 3, 6]] if planar else states)
    call = pair.prepare("velocity", outputs=("R2", "v2"))
    J, changes = call.jacobian(given), {"q": given[1], "qd": given[0]}
    value, rates = call.jvp(given, changes)
    weight = np.random.default_rng(2).normal(size=rates["v2"].shape)
    same, gradient = call.vjp(given, {"v2": weight})
    expected = sum(np.einsum("sij,sj->si", J["v2"][name], change) for name, change in changes.items())
    np.testing.assert_allclose(rates["v2"], expected, atol=1e3 * EPS)
    for name in ("q", "qd"):
        np.testing.assert_allclose(gradient[name], np.einsum("sij,si->sj", J["v2"][name], weight), atol=1e3 * EPS)
    np.testing.assert_array_equal(value.v2, call(*given).v2)
    np.testing.assert_array_equal(same.R2, call(*given).R2)


def test_pairs_of_many_geometries_have_derivatives_of_their_own(states):
    several = hp.HingePair(states[0, :, :3], states[1, :, :3], (0, 0, 1))
    found = several.prepare("pose", outputs=("R2",)).jacobian((states[0],))["R2"]["q"]
    for k in range(5):
        one = hp.HingePair(states[0, k, :3], states[1, k, :3], (0, 0, 1))
        np.testing.assert_allclose(found[k], one.coordinate_jacobian(states[0, k])[:3], atol=64 * EPS)
