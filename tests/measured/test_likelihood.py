"""The pieces of the fit: derivatives against differences, weights against the covariance that they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.measured.hinge import GAUGES, Hinge, frame, home_of, result_derivatives, sign_of
from hingepair.measured.least_squares import neighbours_to_sum
from hingepair.measured.likelihood import (
    Noise,
    SampleResiduals,
    bias_of_hinge,
    evaluate_hinge,
    iterate_residuals,
    most_likely_hinge,
)
from hingepair.measured.relative_poses import closed_form_hinge, compute_relative_poses
from hingepair.measured.robust import LOSSES
from hingepair.rotations.matrices import rotation_log
from support.recorded import HOME, N1, U1, U2, recording

NOISE = Noise(place=4e-6, attitude=9e-6)


def seen(hinge: Hinge, radians: float = 0.0) -> SampleResiduals:
    """What a short recording leaves."""
    made = recording(40, radians, radians)
    poses = compute_relative_poses(made.R1, made.S1, made.R2, made.S2)
    return next(found for _, found in iterate_residuals(poses, hinge))


TRUE = Hinge(N1, HOME.T @ N1, U1, U2)


@pytest.mark.parametrize("k", range(9))
def test_derivatives_are_those_of_the_residuals(k: int) -> None:
    step = 1e-6 * np.eye(9)[k]
    high, low = (seen(TRUE.moved(sign * step)) for sign in (1, -1))
    # the axes along the hinge move with it; to first order tilt and gap, which are 0 here, do not
    tilts, gaps = (high.tilt - low.tilt) / 2e-6, (high.gap - low.gap) / 2e-6
    whitened = seen(TRUE).whiten(NOISE, tilts[None], gaps[None])
    rows = seen(TRUE).whitened_rows(NOISE)
    assert np.abs(rows[k] - whitened[0]).max() < 1e-8 * np.abs(rows).max()


def test_sizes_are_those_of_the_covariance_that_the_module_names() -> None:
    found = seen(TRUE, 2e-3)
    a, b = NOISE.place, NOISE.attitude / 4
    sizes = []
    for p, arm, tilt, gap in zip(found.p.T, found.arms.T, found.tilt.T, found.gap.T, strict=True):
        w = np.cross((0, 0, 1), arm)
        C = a * np.eye(3) + b * (p @ p * np.eye(3) - np.outer(p, p)) + b * np.outer(w, w)
        sizes.append(tilt @ tilt / NOISE.attitude + gap @ np.linalg.solve(C, gap))
    np.testing.assert_allclose(found.whitened_squares(NOISE), sizes, rtol=1e-12)


@pytest.mark.slow
def test_that_covariance_is_what_noise_leaves() -> None:
    made = recording(1)
    count, rng = 50_000, np.random.default_rng(3)
    from support.recorded import turns

    shape = (count, 3)
    R1, R2 = made.R1 + 1e-3 * rng.standard_normal(shape), made.R2 + 1e-3 * rng.standard_normal(shape)
    S1, S2 = (turns(2e-3 * rng.standard_normal(shape)) @ S for S in (made.S1, made.S2))
    poses = compute_relative_poses(R1, S1, R2, S2)
    sizes = np.concatenate([found.whitened_squares(Noise(2e-6, 8e-6)) for _, found in iterate_residuals(poses, TRUE)])
    assert sizes.mean() == pytest.approx(5, rel=0.01)
    assert sizes.var() == pytest.approx(10, rel=0.03)


OPPOSITE = Hinge(N1, -np.array([0.9, 2.1, -0.4]) / np.linalg.norm([0.9, 2.1, -0.4]), U1, U2)


@pytest.mark.parametrize("true", [TRUE, OPPOSITE], ids=["short way", "nearly opposite axes"])
@pytest.mark.parametrize("gauge", GAUGES)
def test_what_the_fit_returns_changes_as_its_derivatives_say(gauge: str, true: Hinge) -> None:
    hinge = true.in_gauge(gauge)
    columns = []
    for k in range(9):
        high, low = (hinge.moved(sign * 1e-6 * np.eye(9)[k]).in_gauge(gauge) for sign in (1, -1))
        turn = rotation_log(home_of(high) @ home_of(low).T)
        columns.append(np.concatenate((high.u1 - low.u1, high.u2 - low.u2, high.n - low.n, turn)) / 2e-6)
    found = result_derivatives(hinge, gauge)
    assert np.abs(found - np.stack(columns, axis=-1)).max() < 1e-8


@pytest.mark.parametrize("axis", [*np.eye(3), *-np.eye(3), N1], ids=str)
def test_frames_are_right_handed_and_end_along_the_axis(axis: np.ndarray) -> None:
    found = frame(axis)
    assert np.abs(found.T @ found - np.eye(3)).max() < 4e-16
    assert np.linalg.det(found) == pytest.approx(1, abs=4e-16)
    assert (found[:, 2] == axis).all()


def units(count: int, seed: int) -> np.ndarray:
    """Coordinate axes, both ways, and random directions."""
    random = np.random.default_rng(seed).normal(size=(count, 3))
    return np.concatenate((np.eye(3), -np.eye(3), random / np.linalg.norm(random, axis=-1, keepdims=True)))


@pytest.mark.slow
def test_home_takes_one_axis_to_the_other_and_is_a_rotation() -> None:
    for n in units(40, 1):
        for m in (*units(40, 2), n, -n):
            home = home_of(Hinge(n, m, U1, U2))
            assert np.abs(home @ m - n).max() < 4e-15
            assert np.abs(home.T @ home - np.eye(3)).max() < 4e-15
            assert np.linalg.det(home) == pytest.approx(1, abs=4e-15)


@pytest.mark.slow
def test_home_is_the_short_way_unless_the_axes_are_nearly_opposite() -> None:
    for n in units(40, 1):
        for m in units(40, 2):
            if n @ m > -0.9:
                assert np.trace(home_of(Hinge(n, m, U1, U2))) == pytest.approx(1 + 2 * (n @ m), abs=1e-14)
        assert np.abs(home_of(Hinge(n, n, U1, U2)) - np.eye(3)).max() < 1e-15


def test_home_of_opposite_axes_hardly_moves_with_them() -> None:
    """Noise of 1e-6 in either axis moves home by little more than that, about all axes."""
    rng = np.random.default_rng(4)
    for n in units(200, 1):
        if (np.abs(np.abs(n) - 0.65) < 1e-5).any():
            continue  # another half turn begins there
        near, far = (np.asarray(x) + 1e-6 * rng.normal(size=3) for x in (n, -n))
        turn = (
            home_of(Hinge(near / np.linalg.norm(near), far / np.linalg.norm(far), U1, U2))
            @ home_of(Hinge(n, -n, U1, U2)).T
        )
        assert np.abs(rotation_log(turn)).max() < 2e-5


@pytest.mark.parametrize("axis", [(-1, 2, 0), (1, -1, 0), (-1, 0, 1), (0, -3, 1), (-1, -1, 1)], ids=str)
def test_noise_does_not_decide_the_sign_of_usual_axes(axis: tuple[float, ...]) -> None:
    n = np.array(axis) / np.linalg.norm(axis)
    rng = np.random.default_rng(5)
    assert {sign_of(n + 1e-3 * rng.normal(size=3)) for _ in range(50)} == {sign_of(n)}
    assert sign_of(-n) == -sign_of(n)


def test_no_hinge_near_the_most_likely_one_is_likelier() -> None:
    made = recording(400, 1e-5, 2e-2)
    poses = compute_relative_poses(made.R1, made.S1, made.R2, made.S2)
    best, noise, still, *_ = most_likely_hinge(poses, closed_form_hinge(poses), None)
    scatter = np.sqrt(np.diagonal(evaluate_hinge(poses, best, noise, None).covariance))

    def misfit(hinge: Hinge) -> float:
        return sum(found.whitened_squares(noise).sum() for _, found in iterate_residuals(poses, hinge))

    least = misfit(best)
    assert still
    for k in range(9):
        for sign in (1, -1):
            assert misfit(best.moved(sign * 0.4 * scatter[k] * np.eye(9)[k]).balanced()) > least


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_the_bias_of_rough_attitudes_is_taken_off(seed: int) -> None:
    """Rotations that are off at random are on average no rotations: levers come out short, by seven deviations."""
    made = recording(40_000, 1e-3, 4e-2, seed=seed)
    poses = compute_relative_poses(made.R1, made.S1, made.R2, made.S2)
    rough, noise, *_ = most_likely_hinge(poses, closed_form_hinge(poses), None)
    better = rough.moved(-bias_of_hinge(poses, rough, noise))
    change = result_derivatives(rough, "closest_to_R1")
    deviations = np.sqrt(np.diagonal(change @ evaluate_hinge(poses, rough, noise, None).covariance @ change.T))[:6]
    true = TRUE.in_gauge("closest_to_R1")
    off = []
    for hinge in (rough, better):
        found = hinge.in_gauge("closest_to_R1")
        off.append(np.abs(np.concatenate((found.u1 - true.u1, found.u2 - true.u2)) / deviations).max())
    assert off[0] > 5
    assert off[1] < 5
    assert off[1] < off[0] / 2


def scipy_loss(name: str, z: float) -> float:
    """rho(z), by SciPy's own word: twice the cost of one residual, which is the root of z."""
    from scipy.optimize import least_squares

    return 2 * float(least_squares(lambda x: np.sqrt([z]) + 0 * x, [0.0], loss=name).cost)


@pytest.mark.parametrize("name", [name for name in LOSSES if name != "linear"])
def test_losses_are_those_of_scipy(name: str) -> None:
    """First and second derivative, against differences of order 4 of rho."""
    loss = LOSSES[name]
    assert loss is not None
    assert loss(np.array([0.0]))[0][0] == 1.0
    for z in (0.05, 0.3, 0.9, 1.1, 2.5, 10.0, 80.0):
        h = 2e-3 * z
        values = np.array([scipy_loss(name, z + k * h) for k in (-2, -1, 0, 1, 2)])
        first, second = (each[0] for each in loss(np.array([z])))
        assert first == pytest.approx(values @ (1, -8, 0, 8, -1) / (12 * h), rel=1e-8)
        assert second == pytest.approx(values @ (-1, 16, -30, 16, -1) / (12 * h * h), rel=1e-5, abs=1e-7 / z)


def autoregressive(count: int, memory: float, seed: int) -> np.ndarray:
    """Scores of which the correlation falls by e in so many samples; (2, N)."""
    from scipy.signal import lfilter

    share = np.exp(-1 / memory)
    return lfilter([np.sqrt(1 - share * share)], [1, -share], np.random.default_rng(seed).normal(size=(2, count)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("memory", "together", "unresolved"),
    [(1e-3, {1}, False), (3.0, {32, 64}, False), (12.0, {128, 256}, False), (400.0, {250}, True)],
    ids=["white", "3", "12", "400"],
)
def test_scores_are_added_up_over_more_than_they_are_correlated(
    memory: float, together: set[int], unresolved: bool
) -> None:
    """Over four times the lag, a power of two, at which less than a tenth is left; over N / 40 at most."""
    count, lag = neighbours_to_sum(autoregressive(10_000, memory, 1))
    assert count in together
    assert (lag > 0) is unresolved


@pytest.mark.slow
def test_few_scores_are_not_added_up() -> None:
    """Chance makes neighbours of a few samples alike; what is more than chance is said."""
    assert neighbours_to_sum(autoregressive(30, 1e-3, 2)) == (1, 0)
    assert neighbours_to_sum(autoregressive(100, 30.0, 2)) == (1, 1)
    assert neighbours_to_sum(np.zeros((2, 500))) == (1, 0)
