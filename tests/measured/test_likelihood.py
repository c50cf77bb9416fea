"""The pieces of the fit: derivatives against differences, weights against the covariance that they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.measured.hinge import GAUGES, Hinge, derivatives, frame, shortest_turn
from hingepair.measured.likelihood import Noise, Residuals, judged, most_likely, seen_from
from hingepair.measured.relative_poses import closed_form, relative_poses
from hingepair.rotations.matrices import rotation_log
from support.recorded import HOME, N1, U1, U2, recording

NOISE = Noise(place=4e-6, attitude=9e-6)


def seen(hinge: Hinge, radians: float = 0.0) -> Residuals:
    """What a short recording leaves."""
    made = recording(40, radians, radians)
    poses = relative_poses(made.R1, made.S1, made.R2, made.S2, np.ones(40))
    return next(found for _, found in seen_from(poses, hinge))


TRUE = Hinge(N1, HOME.T @ N1, U1, U2)


@pytest.mark.parametrize("k", range(9))
def test_derivatives_are_those_of_the_residuals(k: int) -> None:
    step = 1e-6 * np.eye(9)[k]
    high, low = (seen(TRUE.moved(sign * step)) for sign in (1, -1))
    # the axes along the hinge move with it; to first order tilt and gap, which are 0 here, do not
    tilts, gaps = (high.tilt - low.tilt) / 2e-6, (high.gap - low.gap) / 2e-6
    whitened = seen(TRUE).whiten(NOISE, tilts[None], gaps[None])
    rows = seen(TRUE).rows(NOISE)
    assert np.abs(rows[k] - whitened[0]).max() < 1e-8 * np.abs(rows).max()


def test_sizes_are_those_of_the_covariance_that_the_module_names() -> None:
    found = seen(TRUE, 2e-3)
    a, b = NOISE.place, NOISE.attitude / 4
    sizes = []
    for p, arm, tilt, gap in zip(found.p.T, found.arms.T, found.tilt.T, found.gap.T, strict=True):
        w = np.cross((0, 0, 1), arm)
        C = a * np.eye(3) + b * (p @ p * np.eye(3) - np.outer(p, p)) + b * np.outer(w, w)
        sizes.append(tilt @ tilt / NOISE.attitude + gap @ np.linalg.solve(C, gap))
    np.testing.assert_allclose(found.sizes(NOISE), sizes, rtol=1e-12)


def test_that_covariance_is_what_noise_leaves() -> None:
    made = recording(1)
    count, rng = 50_000, np.random.default_rng(3)
    from support.recorded import turns

    shape = (count, 3)
    R1, R2 = made.R1 + 1e-3 * rng.standard_normal(shape), made.R2 + 1e-3 * rng.standard_normal(shape)
    S1, S2 = (turns(2e-3 * rng.standard_normal(shape)) @ S for S in (made.S1, made.S2))
    poses = relative_poses(R1, S1, R2, S2, np.ones(count))
    sizes = np.concatenate([found.sizes(Noise(2e-6, 8e-6)) for _, found in seen_from(poses, TRUE)])
    assert sizes.mean() == pytest.approx(5, rel=0.01)
    assert sizes.var() == pytest.approx(10, rel=0.03)


@pytest.mark.parametrize("gauge", GAUGES)
def test_what_the_fit_returns_changes_as_its_derivatives_say(gauge: str) -> None:
    hinge = TRUE.in_gauge(gauge)
    columns = []
    for k in range(9):
        high, low = (hinge.moved(sign * 1e-6 * np.eye(9)[k]).in_gauge(gauge) for sign in (1, -1))
        turn = rotation_log(shortest_turn(high.m, high.n) @ shortest_turn(low.m, low.n).T)
        columns.append(np.concatenate((high.u1 - low.u1, high.u2 - low.u2, high.n - low.n, turn)) / 2e-6)
    found = derivatives(hinge, shortest_turn(hinge.m, hinge.n), gauge)
    assert np.abs(found - np.stack(columns, axis=-1)).max() < 1e-8


@pytest.mark.parametrize("axis", [*np.eye(3), *-np.eye(3), N1], ids=str)
def test_frames_are_right_handed_and_end_along_the_axis(axis: np.ndarray) -> None:
    found = frame(axis)
    assert np.abs(found.T @ found - np.eye(3)).max() < 4e-16
    assert np.linalg.det(found) == pytest.approx(1, abs=4e-16)
    assert (found[:, 2] == axis).all()


def test_the_shortest_turn_of_opposite_axes_is_half_a_turn() -> None:
    for n in (*np.eye(3), N1):
        turn = shortest_turn(-n, n)
        assert np.abs(turn @ -n - n).max() < 1e-15
        assert np.abs(turn @ turn - np.eye(3)).max() < 1e-15


def test_no_hinge_near_the_most_likely_one_is_likelier() -> None:
    made = recording(400, 1e-5, 2e-2)
    poses = relative_poses(made.R1, made.S1, made.R2, made.S2, np.ones(400))
    best, noise, still = most_likely(poses, closed_form(poses), None)
    scatter = np.sqrt(np.diagonal(judged(poses, best, noise, None).covariance))

    def misfit(hinge: Hinge) -> float:
        return sum(found.sizes(noise).sum() for _, found in seen_from(poses, hinge))

    least = misfit(best)
    assert still
    for k in range(9):
        for sign in (1, -1):
            assert misfit(best.moved(sign * 0.4 * scatter[k] * np.eye(9)[k]).balanced()) > least
