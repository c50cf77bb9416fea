"""Smooth motion from noisy recordings, beside the truth and beside what smoothers in hindsight can do."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import hingepair as hp

PAIR = hp.HingePair(u1=(0.3, 0.1, 0), u2=(-0.2, 0, 0.1), n=(0, 0, 1))


def motion(t: np.ndarray, spin: float = 0.0) -> hp.PairState:
    """Body 1 along smooth coordinates, with everything about it."""
    zero = np.zeros_like(t)
    parts = [
        (np.sin(t), np.cos(t), -np.sin(t)),
        (np.cos(2 * t), -2 * np.sin(2 * t), -4 * np.cos(2 * t)),
        (0.2 * t, zero + 0.2, zero),
        (np.sin(1.3 * t), 1.3 * np.cos(1.3 * t), -1.69 * np.sin(1.3 * t)),
        (0.6 * np.sin(2.1 * t + 1), 1.26 * np.cos(2.1 * t + 1), -2.646 * np.sin(2.1 * t + 1)),
        (np.cos(0.9 * t) + spin * t, -0.9 * np.sin(0.9 * t) + spin, -0.81 * np.cos(0.9 * t)),
        (zero, zero, zero),
    ]
    q, qd, qdd = (np.stack(own, axis=-1) for own in zip(*parts, strict=True))
    names = ("R1", "S1", "v1", "omega1", "a1", "alpha1")
    return PAIR.forward_kinematics(q, qd, qdd, outputs=names, sequence="ZYX")


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(x))))


def noisy(state: hp.PairState, metres: float, radians: float, seed: int) -> hp.BodyMotion:
    rng = np.random.default_rng(seed)
    S = state.S1 @ hp.rotation_exp(radians * rng.standard_normal(state.R1.shape))
    return hp.BodyMotion(R=state.R1 + metres * rng.standard_normal(state.R1.shape), S=S)


@pytest.mark.slow
def test_exact_motion_keeps_its_derivatives() -> None:
    t = np.arange(600) / 200
    truth = motion(t)
    found = hp.smooth(t, hp.BodyMotion(R=truth.R1, S=truth.S1))
    assert np.abs(found.R - truth.R1).max() < 1e-12  # as below: left by the curve between samples
    assert np.abs(found.S - truth.S1).max() < 1e-11
    for letter, tolerance in {"v": 1e-9, "omega": 1e-9, "a": 1e-6, "alpha": 1e-6}.items():
        assert np.abs(getattr(found, letter) - getattr(truth, f"{letter}1")).max() < tolerance, letter


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [1e-3, 1e-2])
def test_smoothing_is_within_twice_the_best_filter_in_hindsight(sigma: float) -> None:
    from scipy.signal import savgol_filter

    t, ratios = np.arange(2000) / 200, []
    filters = [(degree, width) for degree in (2, 4, 6) for width in range(21 + 2 * degree, 401, 20)]
    for seed in range(3):
        y = angle(t)[0] + sigma * np.random.default_rng(seed).standard_normal(t.size)
        found = hp.smooth(t, y)
        for order, (own, truth) in enumerate(zip(found, angle(t), strict=True)):
            best = min(rms(savgol_filter(y, width, degree, order, 1 / 200) - truth) for degree, width in filters)
            ratios.append(rms(own - truth) / best)
    assert np.mean(np.reshape(ratios, (3, 3)), axis=0).max() < 2


@pytest.mark.slow
def test_a_steady_spin_costs_nothing_however_fast() -> None:
    t = np.arange(1000) / 200
    turn = hp.rotation_exp(t[:, None] * np.array([20.0, -30.0, 40.0]))
    S = turn @ hp.rotation_exp(2e-3 * np.random.default_rng(3).standard_normal((1000, 3)))
    found = hp.smooth(t, hp.BodyMotion(R=np.outer(t, (1, 2, 3)), S=S))
    assert found.bandwidth["S"] < 6  # the spin is of 8.6 Hz
    assert rms(found.omega - np.array([20.0, -30.0, 40.0])) < 0.05


@pytest.mark.slow
def test_gaps_stay_gaps_and_holes_are_filled() -> None:
    t = np.arange(1000) / 200
    truth = motion(t)
    body = noisy(truth, 1e-4, 1e-4, 4)
    R, S = body.R.copy(), body.S.copy()
    R[300:304] = S[400:406] = np.nan  # up to 35 ms
    S[600:650] = np.nan  # 255 ms
    found = hp.smooth(t, hp.BodyMotion(R=R, S=S))
    assert np.isfinite(found.a).all()
    lost = np.isnan(found.alpha).any(axis=-1)
    assert np.flatnonzero(lost).tolist() == list(range(600, 650))
    assert (np.isnan(found.S).any(axis=(-2, -1)) == lost).all()
    assert np.abs(found.S[400:406] - truth.S1[400:406]).max() < 4e-4  # of the noise
    assert rms(found.alpha[390:420] - truth.alpha1[390:420]) < 3 * found.noise["alpha"]
    # On the far side of a gap nothing of the near side enters.
    turned = np.concatenate((np.roll(S[:600], 1, axis=-1), S[600:]))
    moved, whole = (hp.smooth(t, hp.BodyMotion(R=R, S=each), 3.0) for each in (turned, S))
    assert np.abs(moved.alpha[650:] - whole.alpha[650:]).max() < 1e-9  # rounding of the equations of all samples


@pytest.mark.slow
def test_angles_may_jump_by_turns_and_unpack() -> None:
    t = np.arange(500) / 100
    psi = 4 * t + 0.5 * np.sin(2 * t)
    wrapped = (psi + np.pi) % (2 * np.pi) - np.pi
    found = hp.smooth(t, wrapped)
    angle, rate, second = found
    assert np.abs(angle - psi).max() < 1e-9  # as below: left by the curve
    assert np.abs(rate - 4 - np.cos(2 * t)).max() < 1e-5
    assert second is found.psidd


@pytest.mark.slow
def test_short_pieces_between_gaps_are_smoothed_with_long_ones() -> None:
    """The lowest bandwidths do not determine a short piece: they are passed over."""
    t, random = np.arange(600) / 100, np.random.default_rng(0)
    for first in (100, 30, 560):
        psi = np.sin(2 * t) + 1e-3 * random.standard_normal(600)
        psi[first : first + 20] = np.nan
        found = hp.smooth(t, psi)
        assert (np.isnan(found.psi) == np.isnan(psi)).all()
        assert np.nanmax(np.abs(found.psi - np.sin(2 * t))) < 5e-3  # rad, of a noise of 1 mrad


def correlated(share: float, count: int, seed: int) -> np.ndarray:
    """Noise of variance 1 whose neighbours are correlated so much."""
    from scipy.signal import lfilter

    start = 500
    white = np.random.default_rng(seed).standard_normal(count + start)
    return lfilter([np.sqrt(1 - share * share)], [1, -share], white)[start:]


def angle(t: np.ndarray) -> tuple[np.ndarray, ...]:
    """An angle with its rates."""
    return (
        np.sin(t) + 0.3 * np.sin(7 * t + 1),
        np.cos(t) + 2.1 * np.cos(7 * t + 1),
        -np.sin(t) - 14.7 * np.sin(7 * t + 1),
    )


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
@pytest.mark.filterwarnings("ignore:angle. the noise of neighbouring samples is correlated")
def test_noise_with_memory_is_not_followed(share: float) -> None:
    """Taken for white it gives a bandwidth of 22 Hz and more, and psidd is 5 to 10 rad/s^2 off."""
    t = np.arange(2000) / 200
    psi, _, psidd = angle(t)
    found = hp.smooth(t, psi + 1e-3 * correlated(share, 2000, 1))
    assert found.correlation == pytest.approx(share, abs=0.12)  # of 2000 samples, less what smoothing takes
    assert found.bandwidth < 4
    assert rms(found.psidd - psidd) < 0.2
    low, high = (0.5e-3, 2e-3) if share == 0.9 else (0.8e-3, 1.2e-3)  # slow noise is like motion
    assert low < found.noise["psi"] < high


def scores_of_angles(seeds: int, share: float, loss: str = "linear", outliers: float = 0.0) -> np.ndarray:
    """Errors of psi, psid, psidd in their standard deviations; (seeds, 3, N)."""
    t = np.arange(600) / 100
    truth = angle(t)
    scores = []
    for seed in range(seeds):
        off = np.random.default_rng(seed).random(600) < outliers
        found = hp.smooth(t, truth[0] + 2e-3 * correlated(share, 600, seed) + 0.2 * off, loss=loss)
        names = ("psi", "psid", "psidd")
        scores.append([(getattr(found, name) - x) / found.std[name] for name, x in zip(names, truth, strict=True)])
    return np.array(scores)


@pytest.mark.proof
@pytest.mark.parametrize("share", [0.0, 0.3, 0.5, 0.9])
@pytest.mark.parametrize(("loss", "outliers"), [("linear", 0.0), ("cauchy", 0.02), ("cauchy", 0.1)])
def test_errors_of_samples_are_within_the_intervals_in_many_runs(share: float, loss: str, outliers: float) -> None:
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        scores = np.abs(scores_of_angles(40, share, loss, outliers))
    assert len(told) < 8 or share == 0.9
    if share < 0.9:  # from 0.8 on, correlated noise is told to make standard deviations too small
        for rows in (slice(60, -60), np.r_[:15, -15:0]):
            inside = (scores[..., rows] < 1.96).mean(axis=(0, 2))
            assert inside.min() >= 0.88, inside
            assert inside.max() <= 0.999  # curves that the bandwidth follows closely are surer than they say
    else:
        assert len(told) > 20


@pytest.mark.slow
@pytest.mark.parametrize("loss", ["linear", "cauchy"])
@pytest.mark.parametrize("turned", [False, True])
def test_noise_of_a_planar_recording_is_that_of_its_plane(loss: str, turned: bool) -> None:
    rng = np.random.default_rng(7)
    t = np.arange(600) / 100
    R = np.stack([np.sin(t), np.cos(2 * t), 0 * t], axis=-1)
    R[:, :2] += 3e-3 * rng.standard_normal((600, 2))
    S = hp.rodrigues((0, 0, 1), 0.5 * np.sin(3 * t) + 2e-3 * rng.standard_normal(600))
    Q = hp.rotation_exp((0.3, 0.5, -0.2)) if turned else np.eye(3)
    found = hp.smooth(t, hp.BodyMotion(R=R @ Q.T, S=Q @ S), loss=loss)
    assert found.noise["R"] == pytest.approx(3e-3, rel=0.15)  # of 600 samples: 3 %, and what smoothing takes
    assert found.noise["S"] == pytest.approx(2e-3, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("row", [0, 1, 300, -1])
def test_one_outlier_anywhere_counts_little(row: int) -> None:
    t = np.arange(400) / 100
    truth = angle(t)
    raw = truth[0] + 1e-3 * np.random.default_rng(3).standard_normal(400)
    clean, raw[row] = hp.smooth(t, raw, loss="cauchy"), raw[row] + 2.0
    found = hp.smooth(t, raw, loss="cauchy")
    assert found.noise["psi"] == pytest.approx(clean.noise["psi"], rel=0.05)  # one of 400 samples
    assert np.abs(found.psi - truth[0]).max() < 5e-3  # rad, of a noise of 1 mrad
    assert rms(found.psidd - truth[2]) < 3 * rms(clean.psidd - truth[2]) + 0.05


@pytest.mark.slow
def test_outliers_among_attitudes_count_little() -> None:
    t = np.arange(1000) / 200
    truth, off = motion(t), np.random.default_rng(3).random(1000) < 0.02
    body = noisy(truth, 1e-3, 2e-3, 4)
    S = np.where(off[:, None, None], body.S @ hp.rotation_exp((0.5, -0.8, 0.3)), body.S)
    found, good = hp.smooth(t, hp.BodyMotion(R=body.R, S=S), loss="cauchy"), hp.smooth(t, body)
    assert rms(found.alpha - truth.alpha1) < 1.5 * rms(good.alpha - truth.alpha1)


@pytest.mark.slow
def test_standard_deviations_grow_towards_ends_and_in_holes() -> None:
    t = np.arange(1000) / 200
    truth = motion(t)
    body = noisy(truth, 1e-3, 2e-3, 4)
    R = body.R.copy()
    R[500:508] = np.nan
    found = hp.smooth(t, hp.BodyMotion(R=R, S=body.S))
    for name in ("R", "v", "a", "S", "omega", "alpha"):
        assert found.std[name][[0, -1]].min() > 1.4 * np.median(found.std[name]), name
    assert found.std["R"][504, 0] > 1.02 * found.std["R"][450, 0]
    assert found.std["S"][504, 0] < 1.01 * found.std["S"][450, 0]
    assert 0.5 < rms((found.omega - truth.omega1) / found.std["omega"]) < 1.6


def doubtful() -> dict[str, tuple[np.ndarray, np.ndarray, float | None, str]]:
    """Instants, angles, bandwidth, and what is warned of."""
    from scipy.signal import butter, filtfilt

    rng = np.random.default_rng(1)
    t, few = np.arange(2000) / 200, np.arange(400) / 100
    noisy, spikes = angle(t)[0] + 1e-3 * rng.standard_normal(2000), np.sin(3 * few) + 1e-3 * rng.standard_normal(400)
    one, jitter = spikes.copy(), np.cumsum(rng.uniform(0.001, 0.009, 500))
    one[133] += 0.1
    spikes[rng.choice(400, 4, replace=False)] += 1.0
    return {
        "degrees": (few * 5, 90 * np.sin(15 * few), None, r"body spans 180 rad, 28.6 turns: is it in radians"),
        "noise": (t, noisy, 80.0, r"psidd: noise of \d+ rad/s\^2 in \d+ rad/s\^2"),
        "jitter": (jitter, np.sin(jitter), None, "t: stamps jitter: steps from .* to .* ms about .* ms"),
        "filtered": (t, filtfilt(*butter(2, 0.06), noisy), None, "as where samples were filtered before; the noise"),
        "too low": (t, noisy, 0.3, r"neighbouring samples is correlated .* bandwidth of 0.3 Hz"),
        "one outlier": (few, one, None, r"angle: 0.25 % of the samples are outliers"),
        "outliers": (few, spikes, None, r"angle: 1(\.\d)? % of the samples are outliers"),  # not their neighbours
    }


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::hingepair.MeasurementWarning")
@pytest.mark.parametrize("name", doubtful())
def test_recordings_that_are_doubtful_are_warned_of(name: str) -> None:
    t, psi, bandwidth, words = doubtful()[name]
    with pytest.warns(hp.MeasurementWarning, match=words):
        hp.smooth(t, psi, bandwidth)


@pytest.mark.slow
@pytest.mark.parametrize("digits", [17, 3])
def test_a_motion_from_rest_without_noise_has_no_outliers(digits: int) -> None:
    """Where the acceleration jumps the curve cannot follow; elsewhere next to nothing is left of the samples."""
    t = np.arange(401) / 100
    turned = np.maximum(t - 2, 0) ** 2
    ramp = np.round(np.clip(t - 2, 0, 1), digits)
    body = hp.BodyMotion(R=np.outer(turned, (1, 0, 0)), S=hp.rodrigues((0, 0, 1), turned))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        hp.smooth(t, ramp)
        hp.smooth(t, body)
    assert not any("outliers" in str(warning.message) for warning in caught)


@pytest.mark.slow
def test_the_inverse_of_bands_is_that_of_the_matrix() -> None:
    from hingepair.measured.smoothing.spline import SmoothingModel, SmoothingSpline

    t = np.sort(np.random.default_rng(0).uniform(0, 3, 200))
    spline = SmoothingSpline([t[:90], t[90:] + 1], SmoothingModel(3.0, 0.5), np.ones(200))
    curves = spline.solve(np.eye(200))  # of samples that are 0 but for one
    for order in range(3):
        rows = spline.evaluate(curves, 1, t[90:] + 1, order)
        smoother = rows @ np.linalg.inv((spline.whitener.T @ spline.whitener).toarray())
        variances = spline.variances(1, t[90:] + 1, order)
        if order == 0:
            np.testing.assert_allclose(np.diagonal(smoother[:, 90:]), variances, rtol=1e-9)  # by an inverse
        assert (variances > 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("size", [1e-3, 1e-2])
def test_errors_of_derivatives_far_from_ends_are_what_is_told(size: float) -> None:
    t = np.arange(2000) / 200
    truth, made = motion(t), [hp.smooth(t, noisy(motion(t), size, 2 * size, seed)) for seed in (1, 2, 3)]
    for letter in ("v", "omega", "a", "alpha"):
        errors = [(getattr(one, letter) - getattr(truth, f"{letter}1"))[100:-100] / one.noise[letter] for one in made]
        assert 0.6 < rms(np.array(errors)) < 1.2, letter  # told is a little too much where the motion is slow
