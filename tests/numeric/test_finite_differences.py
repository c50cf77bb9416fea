"""What a local polynomial leaves of samples: nothing of a polynomial, all of their noise."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.numeric.finite_differences import local_fit_residuals


@pytest.mark.parametrize("degree", range(7))
def test_the_residuals_of_a_polynomial_vanish_up_to_degree_five(degree):
    t = np.cumsum(np.random.default_rng(degree).uniform(0.5, 1.5, 40)) / 20
    residuals = local_fit_residuals(t, (t**degree)[:, None])
    assert residuals.shape == (34, 1)
    vanish = bool(np.abs(residuals).max() < 1e-12 * t[-1] ** degree)
    assert vanish is (degree <= 5)


@pytest.mark.parametrize("jitter", [0.0, 0.4])
def test_the_residuals_of_noise_are_as_large_as_the_noise(jitter):
    rng = np.random.default_rng(7)
    t = np.arange(20_000) / 100 + jitter / 100 * rng.uniform(0, 1, 20_000)
    noise = rng.standard_normal((t.size, 2)) * (0.003, 0.5)
    deviations = np.sqrt(np.mean(local_fit_residuals(t, np.sin(t)[:, None] + noise) ** 2, axis=0))
    np.testing.assert_allclose(deviations, (0.003, 0.5), rtol=0.03)


def test_a_sample_that_is_not_known_spoils_the_windows_that_hold_it():
    values = np.ones((20, 1))
    values[10] = np.nan
    lost = np.isnan(local_fit_residuals(np.arange(20.0), values))[:, 0]
    assert np.flatnonzero(lost).tolist() == [4, 5, 6, 7, 8, 9, 10]


def test_fewer_than_seven_samples_leave_nothing():
    assert local_fit_residuals(np.arange(6.0), np.ones((6, 3))).shape == (0, 3)
