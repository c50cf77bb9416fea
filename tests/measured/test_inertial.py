"""The hinge from gyroscopes and accelerometers alone."""

from __future__ import annotations

import re

import numpy as np
import pytest

import hingepair as hp
from hingepair.measured.inertial.angle import AngleFit
from hingepair.measured.inertial.axis_and_point import AnchorFit, AxisFit, _Forces, _Rates
from hingepair.numeric.finite_differences import differentiate
from support.recorded import HOME, N1, U1, U2, truth

T = np.arange(1000) / 100
PAIR = hp.HingePair(u1=U1, u2=U2, n=N1, home=HOME)
N2 = HOME.T @ N1


def felt(
    moving: float = 1.0, hinge: float = 1.0, noise: float = 0.0, seed: int = 0, t: np.ndarray = T
) -> list[np.ndarray]:
    """omega1, f1, omega2, f2 in the axes of their bodies."""
    zero = np.zeros_like(t)
    parts = [
        (np.sin(t), np.cos(t), -np.sin(t)),
        (0.3 * np.cos(2 * t), -0.6 * np.sin(2 * t), -1.2 * np.cos(2 * t)),
        (zero, zero, zero),
        *(
            (
                moving * a * np.sin(w * t + p),
                moving * a * w * np.cos(w * t + p),
                -moving * a * w * w * np.sin(w * t + p),
            )
            for a, w, p in ((1.0, 1.3, 0.0), (0.6, 2.1, 1.0), (1.0, 0.9, 1.6))
        ),
        (hinge * np.sin(2.3 * t), hinge * 2.3 * np.cos(2.3 * t), -hinge * 5.29 * np.sin(2.3 * t)),
    ]
    q, qd, qdd = (np.stack(own, axis=-1) for own in zip(*parts, strict=True))
    state = PAIR.forward_kinematics(q, qd, qdd, outputs=("S1", "omega1", "a1", "S2", "omega2", "a2"))
    g = np.array([0, 0, -9.81])
    world = ((state.S1, state.omega1), (state.S1, state.a1 - g), (state.S2, state.omega2), (state.S2, state.a2 - g))
    rng = np.random.default_rng(seed)
    exact = [np.einsum("nji,nj->ni", S, v) for S, v in world]
    return [v + k * noise * rng.standard_normal(v.shape) for v, k in zip(exact, (1, 5, 1, 5), strict=True)]


def test_derivatives_are_those_of_the_residuals() -> None:
    """By axes, levers, and the biases of gyroscopes and accelerometers."""
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(2, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    rates = _Rates(*rng.normal(size=(2, 9, 3)), np.ones(6))
    forces = _Forces(*rng.normal(size=(3, 2, 9, 3)), np.ones(12), np.eye(6))
    for problem, x in (
        (rates, np.concatenate((axes, 0.3 * rng.normal(size=(2, 3))))),
        (forces, rng.normal(size=18)),
    ):
        _, found = problem.linearised(x)
        for step, column in zip(1e-6 * np.eye(found.shape[1]), found.T, strict=True):
            high, low = (problem.linearised(problem.moved(x, sign * step))[0] for sign in (1, -1))
            np.testing.assert_allclose(column, (high - low) / 2e-6, rtol=0, atol=1e-7)


@pytest.mark.slow
def test_exact_rates_give_both_axes_and_the_sign_between_them() -> None:
    omega1, _, omega2, _ = felt()
    found = hp.fit_axis(omega1, omega2)
    assert found.ok
    assert np.abs(found.n1 - N1).max() < 1e-14
    assert np.abs(found.n2 - N2).max() < 1e-14
    assert hp.fit_axis(omega2, omega1).n1 @ (np.sign(N2[1]) * N2) == pytest.approx(1, abs=1e-14)


@pytest.mark.slow
@pytest.mark.parametrize("moving", [1.0, 0.2])
def test_noisy_rates_give_them_within_what_is_told(moving: float) -> None:
    for seed in range(3):
        omega1, _, omega2, _ = felt(moving, noise=1e-2, seed=seed)
        found = hp.fit_axis(omega1, omega2)
        assert found.ok
        assert np.linalg.norm(found.n1 - N1) < 4 * np.sqrt(2) * found.std[0]
        assert np.linalg.norm(found.n2 - N2) < 4 * np.sqrt(2) * found.std[1]
        assert found.rms == pytest.approx(np.sqrt(2) * 1e-2, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1e-2], ids=["exact", "noisy"])
def test_axes_that_are_not_shown_are_not_told(noise: float) -> None:
    omega1, _, omega2, _ = felt(moving=0.0, noise=noise)
    found = hp.fit_axis(omega1, omega2)
    assert not found.ok
    assert found.std[0] == np.inf
    assert "axis in body 1's axes" in found.findings[0]
    assert abs(found.n2 @ N2) == pytest.approx(1, abs=1e-5)  # it turns about nothing else
    omega1, _, omega2, _ = felt(hinge=0.0, noise=noise)
    assert (hp.fit_axis(omega1, omega2).std == np.inf).all()


@pytest.mark.slow
def test_missing_rates_are_left_out() -> None:
    omega1, _, omega2, _ = felt()
    omega1[500:520] = np.nan
    omega2[700, 1] = np.nan
    assert np.abs(hp.fit_axis(omega1, omega2).n1 - N1).max() < 1e-14


@pytest.mark.slow
def test_forces_give_the_point_closest_to_sensor_1() -> None:
    omega1, f1, omega2, f2 = felt()
    found = hp.fit_anchor(T + 1.7e9, omega1, f1, omega2, f2, N1, N2)
    slide = -(U1 @ N1)
    assert found.ok
    assert np.abs(found.u1 - (U1 + slide * N1)).max() < 1e-5  # stamps of 1.7e9 s are rounded to 2.4e-7 s
    assert np.abs(found.u2 - (U2 + slide * N2)).max() < 1e-5


@pytest.mark.slow
def test_noisy_forces_give_it_within_what_is_told() -> None:
    omega1, f1, omega2, f2 = felt(noise=1e-2)
    found = hp.fit_anchor(T, omega1, f1, omega2, f2, N1, N2)
    slide = -(U1 @ N1)
    error = np.concatenate((found.u1 - U1 - slide * N1, found.u2 - U2 - slide * N2))
    assert (np.abs(error) < 4 * np.sqrt(np.diagonal(found.covariance)) + 1e-3).all()
    assert np.abs(error).max() < 5e-3
    bare = hp.fit_anchor(T, omega1, f1, omega2, f2, **KNOWN)
    across = np.eye(3) - np.outer(N1, N1)
    assert np.abs(across @ (bare.u1 - U1)).max() < 5e-3
    assert bare.u1 @ N1 + bare.u2 @ N2 == pytest.approx(0, abs=2e-3)


SLOW = np.arange(400) / 40


KNOWN = {"gyroscope_bias": 0.0, "accelerometer_bias": 0.0}
"""The sensors of `felt` have no biases."""


def anchor_scores(given: bool, seeds: int, **kind: float) -> tuple[np.ndarray, AnchorFit]:
    """Errors of u1 and u2 in standard deviations, by seed, in the gauge of the fit; and one of the fits."""
    scores = []
    for seed in range(seeds):
        omega1, f1, omega2, f2 = felt(noise=1e-2, seed=seed, t=SLOW, **kind)
        found = hp.fit_anchor(SLOW, omega1, f1, omega2, f2, *((N1, N2) if given else ()), **KNOWN)
        slide = -(U1 @ N1) if given else -(U1 @ N1 + U2 @ N2) / 2
        error = np.concatenate((found.u1 - U1 - slide * N1, found.u2 - U2 - slide * N2))
        scores.append(error / np.sqrt(np.diagonal(found.covariance)))
    return np.array(scores), found


@pytest.mark.slow
@pytest.mark.parametrize(("moving", "given"), [(1.0, True), (1.0, False), (0.05, True)])
def test_errors_of_the_point_are_those_of_the_covariance(moving: float, given: bool) -> None:
    """At 40 Hz, and where body 1 hardly turns: there noise of the derivatives is larger than what they tell."""
    scores, _ = anchor_scores(given, 8, moving=moving)
    rms = np.sqrt((scores**2).mean(axis=0))
    assert rms.max() < 1.6
    assert rms.min() > 0.3


@pytest.mark.slow
def test_the_covariance_is_in_the_gauge_of_the_values() -> None:
    """u1 is across n1, so along n1 it has only the variance that the axis has; u2 has its own."""
    _, found = anchor_scores(True, 1)
    along1, along2 = (np.concatenate(parts) for parts in ((N1, np.zeros(3)), (np.zeros(3), N2)))
    assert abs(found.u1 @ N1) < 1e-15
    assert np.abs(found.covariance @ along1).max() < 0.02 * found.covariance.max()
    assert along2 @ found.covariance @ along2 > 0.1 * found.covariance.max()
    assert np.abs(found.covariance - found.covariance.T).max() < 1e-12 * found.covariance.max()


@pytest.mark.slow
def test_a_point_that_is_hardly_shown_is_known_to_so_much() -> None:
    _, found = anchor_scores(True, 1, moving=0.05)
    std = np.sqrt(np.diagonal(found.covariance).max())
    assert 0.1 < std < 1
    assert not found.ok
    assert found.findings[0].startswith(f"The hinge point is known to {std:.2g} m only")


@pytest.mark.slow
@pytest.mark.parametrize("moving", [1.0, 0.25, 0.2])
def test_a_point_is_good_if_it_is_known_to_a_tenth_of_the_levers(moving: float) -> None:
    found = hp.fit_anchor(T, *felt(moving, noise=1e-2), N1, N2, **KNOWN)
    share = np.sqrt(np.diagonal(found.covariance).max()) / max(np.linalg.norm(found.u1), np.linalg.norm(found.u2))
    assert found.ok == (share <= 0.1)
    low, high = {1.0: (0, 0.04), 0.25: (0.055, 0.095), 0.2: (0.105, 0.2)}[moving]
    assert low < share < high


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.05, 40.0])
def test_points_far_from_the_starts_are_found(scale: float) -> None:
    """Levers of centimetres and of tens of metres; the starts are some decimetres long."""
    omega1, f1, omega2, f2 = felt()
    forces = [
        f + (scale - 1) * np.einsum("nij,j->ni", accelerations(omega), -u)
        for f, omega, u in ((f1, omega1, U1), (f2, omega2, U2))
    ]
    found = hp.fit_anchor(T, omega1, forces[0], omega2, forces[1], N1, N2)
    slide = -scale * (U1 @ N1)
    assert np.abs(found.u1 - (scale * U1 + slide * N1)).max() < 2e-4 * scale
    assert np.abs(found.u2 - (scale * U2 + slide * N2)).max() < 2e-4 * scale


def accelerations(omega: np.ndarray) -> np.ndarray:
    """What takes a lever to the acceleration of its end, omega by differences; (N, 3, 3)."""
    alpha = np.stack([differentiate(T, column)[0] for column in omega.T], axis=-1)
    W = hp.skew(omega)
    return W @ W + hp.skew(alpha)


def biased(gyroscope: float, accelerometer: float, seed: int, **kind: object) -> tuple[list[np.ndarray], np.ndarray]:
    """What sensors feel that read something at rest too, and these biases: of omega1, f1, omega2, f2; (4, 3)."""
    sizes = np.array((gyroscope, accelerometer, gyroscope, accelerometer))[:, None]
    biases = sizes * np.random.default_rng(1000 + seed).standard_normal((4, 3))
    return [column + bias for column, bias in zip(felt(seed=seed, **kind), biases, strict=True)], biases


def axis_scores(seeds: int, size: float, **told: float) -> tuple[np.ndarray, np.ndarray]:
    """Errors of both axes in standard deviations, and in degrees."""
    scores, degrees = [], []
    for seed in range(seeds):
        (omega1, _, omega2, _), _ = biased(size, 0.0, seed, noise=1e-2)
        found = hp.fit_axis(omega1, omega2, **told)
        scores.append(np.concatenate(((found.n1 - N1) / found.std[0], (found.n2 - N2) / found.std[1])))
        degrees.append(np.degrees(np.linalg.norm(found.n1 - N1)))
    return np.array(scores), np.array(degrees)


@pytest.mark.slow
def test_biases_of_gyroscopes_are_found_with_the_axis() -> None:
    scores, degrees = axis_scores(6, 0.02)
    _, blind = axis_scores(6, 0.02, gyroscope_bias=0.0)
    assert np.sqrt(np.mean(degrees**2)) < 0.25
    assert np.sqrt(np.mean(blind**2)) > 3 * np.sqrt(np.mean(degrees**2))
    assert 0.4 < np.sqrt(np.mean(scores**2)) < 1.6


@pytest.mark.slow
def test_a_bias_is_told_as_far_as_the_motion_shows_it() -> None:
    """Along the axis rates tell nothing of it: there it is as unknown as before."""
    (omega1, _, omega2, _), biases = biased(0.02, 0.0, 3, noise=1e-3)
    found = hp.fit_axis(omega1, omega2)
    across = np.eye(3) - np.outer(N1, N1)
    assert np.abs(across @ (found.bias1 - biases[0])).max() < 2e-3
    assert abs(found.bias1 @ N1) < 1e-3
    assert found.bias_std.max() > 0.03
    assert (np.abs(found.bias1 - biases[0]) < 4 * found.bias_std[0]).all()
    assert np.abs(hp.fit_axis(omega1, omega2, gyroscope_bias=0.0).bias1).max() == 0


@pytest.mark.slow
def test_biases_of_accelerometers_are_found_with_the_point() -> None:
    scores, errors = [], []
    for seed in range(3):
        columns, _ = biased(0.02, 0.1, seed, noise=1e-2)
        for told in ({}, KNOWN):
            found = hp.fit_anchor(T, *columns, N1, N2, **told)
            slide = -(U1 @ N1)
            off = np.concatenate((found.u1 - U1 - slide * N1, found.u2 - U2 - slide * N2))
            errors.append(np.abs(off).max())
            if not told:
                scores.append(off / np.sqrt(np.diagonal(found.covariance)))
    seeking, blind = np.reshape(errors, (-1, 2)).T
    assert np.sqrt(np.mean(seeking**2)) < 0.5 * np.sqrt(np.mean(blind**2))
    assert np.abs(scores).max() < 4
    assert np.sqrt(np.mean(np.square(scores))) < 1.5


def later(columns: list[np.ndarray], samples: int) -> list[np.ndarray]:
    """The recording with sensor 2 read later than sensor 1."""
    return [*(column[:-samples] for column in columns[:2]), *(column[samples:] for column in columns[2:])]


@pytest.mark.slow
@pytest.mark.parametrize("samples", [20, 100])
def test_what_is_no_hinge_is_not_passed(samples: int) -> None:
    """Clocks that differ by 0.2 s and more: the point comes out 0.1 m off, with a small standard deviation."""
    columns = later(felt(noise=1e-2), samples)
    point = hp.fit_anchor(T[:-samples], *columns)
    assert np.abs(point.u1 - U1).max() > 0.05
    assert not point.ok
    assert "not at random: no point is in both bodies, or the clocks" in " ".join(point.findings)
    axis = hp.fit_axis(columns[0], columns[2])
    assert not axis.ok
    assert "not at random: they do not turn about one axis" in " ".join(axis.findings)


@pytest.mark.slow
@pytest.mark.parametrize("noise", [0.0, 1e-3, 1e-2])
def test_noise_is_not_said_to_be_another_joint(noise: float) -> None:
    columns = felt(noise=noise)
    assert hp.fit_axis(columns[0], columns[2]).findings == ()
    assert hp.fit_anchor(T, *columns).findings == ()


@pytest.mark.slow
def test_units_of_sensors_are_asked_about() -> None:
    omega1, f1, omega2, f2 = felt(noise=1e-2)
    point = hp.fit_anchor(T, omega1, f1 / 9.80665, omega2, f2 / 9.80665)
    assert [text.partition(" is of")[0] for text in point.findings] == ["f1_b1", "f2_b2"]
    assert "9.80665 * f2_b2" in point.findings[1]
    fast = np.degrees(omega1), np.degrees(omega2)
    for found in (hp.fit_axis(*fast), hp.fit_anchor(T, fast[0], f1, fast[1], f2)):
        assert [text.partition(" comes to")[0] for text in found.findings[-2:]] == ["omega1_b1", "omega2_b2"]
        assert "numpy.radians(omega1_b1)" in found.findings[-2]


@pytest.mark.proof
def test_errors_with_biases_are_within_the_intervals_in_many_runs() -> None:
    scores, _ = axis_scores(100, 0.05)
    inside = (np.abs(scores) < 1.96).mean(axis=0)
    assert inside.min() >= 0.9
    # std is the larger one across each axis
    assert np.sqrt((scores**2).mean()) > 0.5


POINT = (U1 - (U1 @ N1) * N1, U2 - (U1 @ N1) * N2)


def true_angle(t: np.ndarray) -> np.ndarray:
    """Psi of `felt` with the home that fits have."""
    return np.sin(2.3 * t) + hp.rotation_log(HOME @ truth(1.0)[3].T) @ N1


@pytest.mark.slow
@pytest.mark.parametrize("moving", [1.0, 0.0], ids=["moving", "body 1 at rest"])
def test_the_angle_of_biased_gyroscopes_does_not_drift(moving: float) -> None:
    t = np.arange(2000) / 100
    columns, biases = biased(0.02, 0.0, 0, noise=1e-2, t=t, moving=moving)
    found = hp.fit_angle(t, *columns, N1, N2, *POINT, accelerometer_bias=0.0)
    off = found.psi - true_angle(t)
    assert found.ok
    assert np.sqrt(np.mean(off**2)) < 4e-3
    assert np.sqrt(np.mean((off / found.std) ** 2)) < 1.7
    assert found.drift == pytest.approx(biases[2] @ N2 - biases[0] @ N1, abs=4 * found.drift_std)
    assert found.drift_std < 3e-3
    assert np.abs(found.psid - 2.3 * np.cos(2.3 * t)).max() < 0.1


@pytest.mark.slow
@pytest.mark.parametrize(("moving", "least", "most"), [(1.0, 5e-4, 3e-3), (0.0, 2e-3, 0.05)], ids=["seen", "unseen"])
def test_a_bias_of_accelerometers_widens_the_angle_as_far_as_it_is_not_seen(
    moving: float, least: float, most: float
) -> None:
    columns, _ = biased(0.0, 0.1, 0, noise=1e-2, moving=moving)
    found = hp.fit_angle(T, *columns, N1, N2, *POINT, accelerometer_bias=0.1)
    assert np.abs(found.psi - true_angle(T)).max() < 5 * found.std.max()
    assert least < found.std.min()
    assert found.std.max() < most


@pytest.mark.slow
def test_an_angle_that_no_direction_shows_is_not_relied_on() -> None:
    """An axis along gravity and body 1 at rest: rates alone drift."""
    t, zero = np.arange(3000) / 100, np.zeros((3000, 3))
    rng = np.random.default_rng(0)
    up = zero + np.array((0.0, 0.0, 9.81))
    columns = [zero, up, zero + np.stack((0 * t, 0 * t, np.sin(t)), axis=-1), up]
    columns = [column + 1e-2 * rng.standard_normal(column.shape) for column in columns]
    found = hp.fit_angle(t, *columns, (0, 0, 1), (0, 0, 1), (0, 0, 0), (0, 0, 0))
    assert not found.ok
    assert "neither the force at the hinge point nor the angular velocity" in found.findings[0]
    assert found.std.max() > 0.2


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.7], ids=["white", "coloured"])
def test_noise_with_a_memory_is_told_with_the_angle(share: float) -> None:
    t = np.arange(200) / 40
    rng = np.random.default_rng(1)
    columns = []
    for column, size in zip(felt(t=t), (0.01, 0.05, 0.01, 0.05), strict=True):
        noise = rng.standard_normal(column.shape)
        for i in range(1, t.size):
            noise[i] = share * noise[i - 1] + np.sqrt(1 - share**2) * noise[i]
        columns.append(column + size * noise)
    found = hp.fit_angle(t, *columns, N1, N2, *POINT, **KNOWN)
    assert found.ok
    assert ("standard deviations of the angle are too small" in " ".join(found.findings)) == (share > 0)


@pytest.mark.slow
def test_angles_have_gaps_where_samples_are_missing() -> None:
    columns = felt(noise=1e-2)
    columns[1][400:460] = np.nan
    found = hp.fit_angle(T, *columns, N1, N2, *POINT)
    assert np.flatnonzero(np.isnan(found.psi)).tolist() == list(range(400, 460))
    good = np.isfinite(found.psi)
    assert np.abs(found.psi - true_angle(T))[good].max() < 0.02


def chain(t: np.ndarray, columns: list[np.ndarray]) -> tuple[AxisFit, AnchorFit, AngleFit]:
    """Axis, point and angle, one after the other."""
    axis = hp.fit_axis(columns[0], columns[2])
    point = hp.fit_anchor(t, *columns, axis.n1, axis.n2)
    return axis, point, hp.fit_angle(t, *columns, axis.n1, axis.n2, point.u1, point.u2)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [2, -3])
def test_clocks_that_differ_are_noticed_by_every_estimate(samples: int) -> None:
    columns = felt(noise=1e-2)
    columns = later(columns, samples) if samples > 0 else later([*columns[2:], *columns[:2]], -samples)
    columns = columns if samples > 0 else [*columns[2:], *columns[:2]]
    for found in chain(T[: -abs(samples)], columns):
        assert not found.ok
        text = " ".join(found.findings)
        assert re.search(r"recorded [\d.]+ (samples|ms) (later|earlier) than body 1", text), text
        assert ("later" in text) is (samples > 0)
        size, unit = re.search(r"recorded ([\d.]+) (samples|ms)", text).groups()
        assert float(size) == pytest.approx(abs(samples) * (10 if unit == "ms" else 1), rel=0.1)
        assert str(found).endswith("NOT RELIABLE")


@pytest.mark.slow
def test_a_point_of_a_body_that_hardly_moves_is_as_uncertain_as_its_axis() -> None:
    scores = []
    for seed in range(3):
        columns, _ = biased(0.02, 0.1, seed, noise=1e-2, moving=0.1)
        axis = hp.fit_axis(columns[0], columns[2])
        point = hp.fit_anchor(T, *columns, axis.n1, axis.n2)
        slide = -(U1 @ N1)
        error = np.concatenate((point.u1 - U1 - slide * N1, point.u2 - U2 - slide * N2))
        scores.append(error / np.sqrt(np.diagonal(point.covariance)))
        assert np.isfinite(axis.covariance).all()
        assert not point.ok or np.abs(scores[-1]).max() < 4.5
    assert 0.2 < np.median(np.abs(scores)) < 1.2


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0.7, 1.9, 3.3])
def test_a_gap_adds_no_whole_turns(seconds: float) -> None:
    columns, there = felt(noise=1e-2), (T < 3) | (3 + seconds < T)
    found = hp.fit_angle(T[there], *(column[there] for column in columns), N1, N2, *POINT)
    assert found.ok
    assert "Whole turns during a gap are not seen" in " ".join(found.findings)
    assert np.abs(found.psi - true_angle(T[there])).max() < 6 * found.std.max()


CONTRADICTIONS = {
    "degrees a second": (lambda o1, f1, o2, f2: (np.degrees(o1), f1, np.degrees(o2), f2), 1.0, 1.0),
    "multiples of g": (lambda o1, f1, o2, f2: (o1, f1 / 9.80665, o2, f2 / 9.80665), 1.0, 1.0),
    "milliseconds": (lambda *columns: columns, 1e3, 1.0),
    "n2 flipped": (lambda *columns: columns, 1.0, -1.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("moving", [1.0, 0.0], ids=["moving", "body 1 at rest"])
@pytest.mark.parametrize("name", CONTRADICTIONS)
def test_an_angle_that_its_records_contradict_is_not_relied_on(name: str, moving: float) -> None:
    change, seconds, sign = CONTRADICTIONS[name]
    columns = change(*felt(moving, noise=1e-2))
    found = hp.fit_angle(seconds * T, *columns, N1, sign * N2, *POINT)
    assert not found.ok, found


def imus(columns: list[np.ndarray], t1: np.ndarray, t2: np.ndarray) -> tuple[hp.ImuRecording, hp.ImuRecording]:
    return hp.ImuRecording(t1, columns[0], columns[1]), hp.ImuRecording(t2, columns[2], columns[3])


@pytest.mark.slow
@pytest.mark.parametrize("late", [-0.035, 0.3])
def test_two_recordings_give_the_hinge_whatever_their_clocks(late: float) -> None:
    """Sensor 2 has other instants, and is read later than it says."""
    t2 = T[:-7] + 0.0037
    columns = [*felt(noise=1e-2)[:2], *felt(noise=1e-2, seed=1, t=t2 + late)[2:]]
    found = hp.fit_imus(*imus(columns, T, t2))
    assert found.ok, found
    assert abs(found.clock_offset - late) < 4.5 * found.clock_offset_std + 1e-4
    assert np.abs(np.cross(found.axis.n1, N1)).max() < 4 * found.axis.std[0]
    assert np.abs(found.pair.u1 - U1 + (U1 @ N1) * N1).max() < 0.05
    off = found.angle.psi - true_angle(T)
    assert np.nanmax(np.abs(off)) < 6 * np.nanmax(found.angle.std)
    assert str(found).endswith("ok")
