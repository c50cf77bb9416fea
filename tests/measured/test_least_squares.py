"""The solver, the covariance and the weights that all fits share."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.measured.hinge import tilt_axis
from hingepair.measured.least_squares import Equations, least_squares, neighbour_correlation, sandwich
from hingepair.measured.robust import LOSSES, cauchy, loss_weights, median_variance


def rosenbrock(x: np.ndarray) -> Equations:
    residuals = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])
    J = np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])
    return Equations(J.T @ J, J.T @ residuals, float(residuals @ residuals))


def test_damped_steps_follow_a_curved_valley_and_never_climb() -> None:
    costs = [rosenbrock(np.array([-1.2, 1.0])).cost]

    def move(x: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return x + step, step

    def at_rest(step: np.ndarray, _: Equations, x: np.ndarray) -> bool:
        costs.append(rosenbrock(x).cost)
        return bool(np.abs(step).max() < 1e-12)

    found, rests = least_squares(np.array([-1.2, 1.0]), rosenbrock, move, at_rest, 100, damped=True)
    assert rests
    np.testing.assert_allclose(found, 1.0, rtol=0, atol=1e-10)
    assert (np.diff(costs) <= 0).all()


def test_steps_on_the_sphere_reach_the_mean_direction() -> None:
    """Of directions around an axis, from nearly a right angle away, in steps of 0.3 rad at most."""
    rng = np.random.default_rng(0)
    vectors = np.array([1.0, 2.0, -2.0]) / 3 + 0.1 * rng.standard_normal((200, 3))

    def equations(n: np.ndarray) -> Equations:
        turns = np.stack([(tilt_axis(n, h) - tilt_axis(n, -h)) / 2e-6 for h in 1e-6 * np.eye(2)], axis=-1)
        return Equations(len(vectors) * np.eye(2), -turns.T @ vectors.sum(axis=0))

    def move(n: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        step = step * min(1.0, 0.3 / np.abs(step).max())
        return tilt_axis(n, step), step

    start = np.array([0.0, 1.0, 1.1]) / np.sqrt(2.21)
    found, rests = least_squares(start, equations, move, lambda step, *_: bool(np.abs(step).max() < 1e-9), 60)
    mean = vectors.sum(axis=0)
    assert rests
    assert np.abs(found - mean / np.linalg.norm(mean)).max() < 1e-8
    assert not least_squares(start, equations, move, lambda *_: False, 3)[1]


def test_the_covariance_of_a_mean_is_that_of_its_noise() -> None:
    noise = 0.3 * np.random.default_rng(1).standard_normal((1, 20_000))
    inverse = np.array([[1 / noise.size]])
    assert sandwich(inverse, noise)[0][0, 0] == pytest.approx(0.09 / noise.size, rel=0.05)
    assert sandwich(inverse, noise, prior=0.09 * noise.size)[0][0, 0] == pytest.approx(0.18 / noise.size, rel=0.05)
    # A sample tells less of itself than of others.
    few = np.array([[1.0, -1.0]])
    assert sandwich(np.array([[0.5]]), few)[0][0, 0] == pytest.approx(1.0)


def test_neighbours_are_compared_row_by_row() -> None:
    alternating, slow = np.tile((1.0, -1.0), 50), np.repeat((1.0, -1.0), 50)
    assert neighbour_correlation(alternating) == pytest.approx(-0.99)
    assert neighbour_correlation(np.stack((alternating, slow))) == pytest.approx(0.97)
    assert neighbour_correlation(alternating, lag=2) == pytest.approx(0.98)
    assert neighbour_correlation(np.zeros(5)) == neighbour_correlation(np.ones(1)) == 0


@pytest.mark.parametrize("name", [name for name, loss in LOSSES.items() if loss is not None])
def test_derivatives_of_weights_are_those_of_the_weights(name: str) -> None:
    squares = np.array([0.1, 2.0, 30.0, 200.0])
    for freedom in (1, 2, 3, 5):
        weights, change = loss_weights(LOSSES[name], squares, freedom)
        high, low = (loss_weights(LOSSES[name], squares * (1 + h), freedom)[0] for h in (1e-6, -1e-6))
        np.testing.assert_allclose(change, (high - low) / (2e-6 * squares), rtol=1e-6, atol=1e-12)
        assert (np.diff(weights) <= 0).all()
        assert weights[0] == pytest.approx(1, abs=0.05)


def test_gross_outliers_have_no_weight_and_medians_do_not_see_them() -> None:
    rng = np.random.default_rng(2)
    squares = (rng.standard_normal((20_000, 3)) ** 2).sum(axis=1)
    squares[:2000] = 1e6
    assert loss_weights(cauchy, np.array([899.0, 901.0]), 3)[0].tolist() == [pytest.approx(7.81 / 906.81), 0.0]
    assert loss_weights(None, squares, 3)[0].min() == 1.0
    assert median_variance(squares[2000:], 3) == pytest.approx(1, rel=0.03)
    assert median_variance(squares, 3) < 1.2
