"""The pieces of the fit: derivatives against differences, weights against the covariance that they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.measured.hinge import Hinge, home_of, result_derivatives, sign_of
from hingepair.measured.hinge_model import BodyModel, Noise, PointModel
from hingepair.measured.most_likely import Model, evaluate, most_likely, psi_derivatives
from hingepair.measured.relative_poses import RelativePoses, compute_relative_poses
from hingepair.measured.statistics import LOSSES, sandwich
from hingepair.rotations.matrices import rotation_log
from support.near import U
from support.recorded import HOME, N1, U1, U2, recording, turns

NOISE = Noise(place=4e-6, attitude=9e-6)
TRUE = Hinge.along(N1, HOME.T @ N1, U1, U2)
STILL = np.zeros(2)  # clock offset and drift


def relative(count: int = 40, metres: float = 0.0, radians: float = 0.0, seed: int = 0) -> RelativePoses:
    """What a short recording shows."""
    made = recording(count, metres, radians, seed)
    return compute_relative_poses(made.R1, made.S1, made.R2, made.S2)


def models() -> dict[str, Model]:
    point = PointModel.start(relative(400), None)
    return {
        "body": BodyModel(TRUE.balanced(), NOISE),
        "point": most_likely(point, lambda *_: relative(400), STILL, None)[0].model,
    }


MODELS = models()


@pytest.mark.parametrize("name", MODELS)
def test_derivatives_are_those_of_the_residuals(name: str) -> None:
    model, poses, h = MODELS[name], relative(), 1e-6
    found = model.rows(poses)[:-1]
    for k, step in enumerate(h * np.eye(model.parameters)):
        high, low = (model.moved(sign * step).rows(poses)[-1] for sign in (1, -1))
        assert np.abs(found[k] - (high - low) / (2 * h)).max() < 0.1 * h * np.abs(found).max()


@pytest.mark.parametrize("name", MODELS)
def test_angles_change_as_their_derivatives_say(name: str) -> None:
    model, poses, h = MODELS[name], relative(), 1e-6
    found = psi_derivatives(model, poses)
    for k, step in enumerate(h * np.eye(model.parameters)):
        high, low = (model.moved(sign * step).psi(poses) for sign in (1, -1))
        change = np.angle(np.exp(1j * (high - low))) / (2 * h)
        assert np.abs(found[k] - change).max() < h * (1 + np.abs(change).max())


@pytest.mark.slow
def test_that_covariance_is_what_noise_leaves() -> None:
    made = recording(1)
    count, rng = 50_000, np.random.default_rng(3)
    shape = (count, 3)
    R1, R2 = made.R1 + 1e-4 * rng.standard_normal(shape), made.R2 + 1e-4 * rng.standard_normal(shape)
    S1, S2 = (turns(4e-3 * rng.standard_normal(shape)) @ S for S in (made.S1, made.S2))
    poses = compute_relative_poses(R1, S1, R2, S2)
    sizes = evaluate(BodyModel(TRUE, Noise(2e-8, 32e-6)), poses, STILL, None).squares
    assert sizes.mean() == pytest.approx(5, rel=0.01)  # of 50,000: 0.3 %
    assert sizes.var() == pytest.approx(10, rel=0.03)  # of 50,000: 1 %


def units(count: int, seed: int) -> np.ndarray:
    """Coordinate axes, both ways, and random directions."""
    random = np.random.default_rng(seed).normal(size=(count, 3))
    return np.concatenate((np.eye(3), -np.eye(3), random / np.linalg.norm(random, axis=-1, keepdims=True)))


@pytest.mark.slow
def test_home_takes_one_axis_to_the_other_and_is_a_rotation() -> None:
    for n in units(40, 1):
        for m in (*units(40, 2), n, -n):
            home = home_of(Hinge.along(n, m, U1, U2))
            assert np.abs(home @ m - n).max() < 32 * U
            assert np.abs(home.T @ home - np.eye(3)).max() < 32 * U
            assert np.linalg.det(home) == pytest.approx(1, abs=32 * U)


def test_home_of_opposite_axes_hardly_moves_with_them() -> None:
    """Noise of 1e-6 in either axis moves home by little more than that, about all axes."""
    rng = np.random.default_rng(4)
    for n in units(200, 1):
        if (np.abs(np.abs(n) - 0.65) < 1e-5).any():
            continue  # another half turn begins there
        near, far = (np.asarray(x) + 1e-6 * rng.normal(size=3) for x in (n, -n))
        turn = (
            home_of(Hinge.along(near / np.linalg.norm(near), far / np.linalg.norm(far), U1, U2))
            @ home_of(Hinge.along(n, -n, U1, U2)).T
        )
        assert np.abs(rotation_log(turn)).max() < 2e-5  # rad, of axes moved by 1e-6


@pytest.mark.parametrize("axis", [(-1, 2, 0), (1, -1, 0), (-1, 0, 1), (0, -3, 1), (-1, -1, 1)], ids=str)
def test_noise_does_not_decide_the_sign_of_usual_axes(axis: tuple[float, ...]) -> None:
    n = np.array(axis) / np.linalg.norm(axis)
    rng = np.random.default_rng(5)
    assert {sign_of(n + 1e-3 * rng.normal(size=3)) for _ in range(50)} == {sign_of(n)}
    assert sign_of(-n) == -sign_of(n)


def test_no_hinge_near_the_most_likely_one_is_likelier() -> None:
    poses = relative(400, 1e-5, 2e-2)
    found, _ = most_likely(BodyModel.start(poses, None), lambda *_: poses, STILL, None)
    seen = evaluate(found.model, poses, STILL, None)
    assert found.has_converged
    for k, std in enumerate(np.sqrt(np.diagonal(seen.covariance[0]))):
        for sign in (1, -1):
            near = found.model.moved(sign * 0.4 * std * np.eye(9)[k])
            assert (near.rows(poses)[-1] ** 2).sum() > seen.squares.sum()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_the_bias_of_rough_attitudes_is_taken_off(seed: int) -> None:
    """Rotations that are off at random are on average no rotations: levers come out short, by seven deviations."""
    poses = relative(40_000, 1e-3, 4e-2, seed)
    found, _ = most_likely(BodyModel.start(poses, None), lambda _, most: poses.thinned(most), STILL, None)
    change = result_derivatives(lambda step: found.model.hinge.moved(step).results("closest_to_R1"), 9)
    covariance = evaluate(found.model, poses, STILL, None).covariance[0]
    deviations = np.sqrt(np.diagonal(change @ covariance @ change.T))[:6]
    true = TRUE.in_gauge("closest_to_R1")
    off = []
    for model in (found.model, found.model.moved(-found.model.bias(poses))):
        hinge = model.hinge.in_gauge("closest_to_R1")
        off.append(np.abs(np.concatenate((hinge.u1 - true.u1, hinge.u2 - true.u2)) / deviations).max())
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
        assert first == pytest.approx(values @ (1, -8, 0, 8, -1) / (12 * h), rel=1e-8)  # (h / z)^4, and rounding
        assert second == pytest.approx(values @ (-1, 16, -30, 16, -1) / (12 * h * h), rel=1e-5, abs=1e-7 / z)


def test_the_covariance_of_a_mean_is_that_of_its_noise() -> None:
    noise = 0.3 * np.random.default_rng(1).standard_normal((1, 20_000))
    inverse = np.array([[1 / noise.size]])
    assert sandwich(inverse, noise)[0][0, 0] == pytest.approx(0.09 / noise.size, rel=0.05)  # of 20,000: 1 %
    assert sandwich(inverse, noise, prior=0.09 * noise.size)[0][0, 0] == pytest.approx(0.18 / noise.size, rel=0.05)


@pytest.mark.parametrize("name", MODELS)
def test_outliers_hardly_change_how_badly_a_model_fits(name: str) -> None:
    """By medians, of which a fifth of outliers moves the square by less than 2: clock offsets are compared so."""
    clean, spoiled = (
        compute_relative_poses(made.R1, made.S1, made.R2, made.S2)
        for made in (recording(1000, 1e-3, 2e-3, outliers=outliers) for outliers in (0.0, 0.2))
    )
    one, other = (MODELS[name].misfit(poses, LOSSES["cauchy"]) for poses in (clean, spoiled))
    assert abs(one - other) < 2.5 * np.log(2)
    far = recording(1000, 1e-2, 2e-2)
    assert MODELS[name].misfit(compute_relative_poses(far.R1, far.S1, far.R2, far.S2), LOSSES["cauchy"]) > one + 2


def test_rounds_that_go_in_circles_end() -> None:
    """Those of a ball joint, of which no hinge is the most likely one."""
    t = recording(2000).t
    vectors = np.stack((recording(2000).psi, 0.8 * np.sin(1.3 * t), 0.7 * np.cos(1.9 * t)), axis=-1)
    made = recording(2000, 1e-3, 2e-3, Q=turns(vectors) @ HOME)
    poses, asked = compute_relative_poses(made.R1, made.S1, made.R2, made.S2), []
    found, _ = most_likely(BodyModel.start(poses, None), lambda *_: asked.append(1) or poses, STILL, None)
    assert not found.has_converged
    assert len(asked) < 20
