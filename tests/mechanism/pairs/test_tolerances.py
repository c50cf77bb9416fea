"""Tolerances of the geometry: their samples against their covariance, and points."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

import hingepair as hp
from support.states import body1 as random_body
from support.states import generator
from support.states import pair as random_pair

U = 2.0**-53
SAMPLES = 100_000
STD = {"u1_std": 1e-3, "u2_std": (1e-3, 0, 2e-3), "axis_std": 1.5e-3, "home_std": 5e-4}


def pair_and_states(seed: int) -> tuple[hp.HingePair, hp.BodyMotion, np.ndarray]:
    rng = generator(seed)
    u1, u2, n, C = random_pair(rng)
    R, S, *_ = random_body(rng, 5)
    return hp.HingePair(u1, u2, n, C), hp.BodyMotion(R=R, S=S), rng.uniform(-3, 3, 5)


def geometry_of_a_fit(pair: hp.HingePair) -> np.ndarray:
    """A covariance with correlations in which the axis keeps its length."""
    root = 1e-3 * generator(301).normal(size=(12, 12))
    root[6:9] -= np.outer(pair.n, pair.n @ root[6:9])
    return root @ root.T


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["standard_deviations", "covariance"])
def test_samples_scatter_as_the_first_order_says(kind):
    pair, body1, psi = pair_and_states(302)
    scatter = STD if kind == "standard_deviations" else {"covariance": geometry_of_a_fit(pair)}
    expected = pair.propagate_covariance(body1, psi, **scatter)
    made = hp.sample_pairs(pair, SAMPLES, **scatter, seed=3)
    assert np.abs(np.linalg.norm(made.n, axis=-1) - 1).max() < 4 * U
    for i in range(5):
        one = hp.BodyMotion(R=body1.R[i], S=body1.S[i])
        mean, found = (p.forward_kinematics_from_body1(one, psi[i]) for p in (pair, made))
        pose = np.concatenate((found.R2 - mean.R2, hp.rotation_log(found.S2 @ mean.S2.T)), axis=1)
        variances = np.diagonal(expected.covariance[i])
        error = np.sqrt((np.outer(variances, variances) + expected.covariance[i] ** 2) / SAMPLES)
        assert (np.abs(np.cov(pose.T) - expected.covariance[i]) < 5 * error).all()
        assert np.array_equal(expected.R2_std[i], np.sqrt(variances[:3]))
        assert np.array_equal(expected.attitude_std[i], np.sqrt(variances[3:]))


def test_a_seed_gives_the_same_pairs_and_only_what_scatters_is_sampled():
    pair = hp.HingePair((1, 2, 3), (0, 0, 1), (0, 0, 1), name="gate", limits=(0, 1), body2=hp.Body(3))
    first, again = (hp.sample_pairs(pair, 7, u1_std=0.1, home_std=0.2, seed=4) for _ in range(2))
    assert np.array_equal(first.u1, again.u1)
    assert np.array_equal(first.home, again.home)
    assert (first.u1.shape, first.home.shape, first.u2.shape, first.n.shape) == ((7, 3), (7, 3, 3), (3,), (3,))
    assert (first.name, first.limits, first.body2) == ("gate", (0.0, 1.0), pair.body2)
    rng = np.random.default_rng(4)
    assert np.array_equal(hp.sample_pairs(pair, 7, u1_std=0.1, home_std=0.2, seed=rng).u1, first.u1)


@pytest.mark.parametrize(
    ("limits", "std"),
    [
        ({"u1": "+-0.3 mm"}, {"u1_std": 1e-4}),
        ({"u2": "±0.3mm"}, {"u2_std": 1e-4}),
        ({"u1": "+/-30 um,+-0.6 mm, 0"}, {"u1_std": (1e-5, 2e-4, 0)}),
        ({"u1": ("+-.3 mm", "0", "+-0.001 in")}, {"u1_std": (1e-4, 0, 2.54e-5 / 3)}),
        ({"axis": "+-0.3°"}, {"axis_std": np.radians(0.1)}),
        ({"axis": "+-3 mrad"}, {"axis_std": 1e-3}),
        ({"home": "+-0.3 deg; 0; +-1.5 mrad"}, {"home_std": (np.radians(0.1), 0, 5e-4)}),
    ],
    ids=str,
)
def test_limits_mean_standard_deviations(limits, std):
    pair, body1, psi = pair_and_states(307)
    found, expected = (pair.propagate_covariance(body1, psi, **given).covariance for given in (limits, std))
    assert np.allclose(found, expected, rtol=64 * U, atol=64 * U * np.abs(expected).max())


def with_points(seed):
    """A pair with a point on either body, and five states."""
    pair, body1, psi = pair_and_states(seed)
    return dataclasses.replace(pair, points1={"mark": (1, 2, 3)}, points2={"handle": (0.5, -1, 2)}), body1, psi


def test_a_point_moves_with_the_body_that_carries_it():
    """P = R2 + S2 p: its deviation is that of R2, and the turn of body 2 times S2 p, and S2 times its own."""
    pair, body1, psi = with_points(309)
    found = pair.propagate_covariance(body1, psi, **STD, points={"handle": "+-0.3 mm, 0, 0", "mark": (0, 2e-3, 0)})
    S2 = pair.forward_kinematics_from_body1(body1, psi).S2
    pose, own = found.jacobian, found["handle"].jacobian
    expected = pose[:, :3] - hp.skew(S2 @ pair.points2["handle"]) @ pose[:, 3:]
    scale = np.abs(pair.points2["handle"]).sum() + np.abs(pair.u1).sum() + np.abs(pair.u2).sum()
    assert np.abs(own[..., :12] - expected).max() < 32 * U * scale
    assert np.abs(own[..., 12:] - S2).max() < 8 * U
    assert np.abs(found["handle"].R - own @ found["handle"].geometry @ np.swapaxes(own, 1, 2)).max() < 64 * U * 1e-5
    assert np.diagonal(found["handle"].geometry)[12:] == pytest.approx([1e-8, 0, 0], rel=8 * U, abs=0)
    assert np.array_equal(found["mark"].jacobian[..., :12], np.zeros((5, 3, 12)))
    assert found["mark"].R_std == pytest.approx(np.abs(2e-3 * body1.S[..., 1]), rel=8 * U)
    parts = found["handle"].contributions()
    assert list(parts)[-3:] == ["handle_x", "handle_y", "handle_z"]
    assert np.allclose(sum(parts.values()), found["handle"].R_std ** 2, rtol=64 * U, atol=0)
    with pytest.raises(KeyError):
        found["other"]


def test_points_may_be_all_that_scatters():
    pair, body1, psi = with_points(311)
    found = pair.propagate_covariance(body1, psi, points={"handle": 1e-3})
    assert not found.covariance.any()
    assert found["handle"].R_std == pytest.approx(np.full((5, 3), 1e-3), rel=8 * U)
    assert np.array_equal(pickle.loads(pickle.dumps(found))["handle"].R, found["handle"].R)
    made = hp.sample_pairs(pair, 3, points={"handle": 1e-3}, seed=1)
    assert (made.u1.shape, made.points2["handle"].shape, made.points1["mark"].shape) == ((3,), (3, 3), (3,))
