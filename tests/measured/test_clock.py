"""Two clocks: the offset between them is found with the hinge, or known, or not determined, and always said."""

from __future__ import annotations

import json

import numpy as np
import pytest

import hingepair as hp
from support.near import TIGHT
from support.recorded import HOME, N1, U1, U2, turns


def poses(t: np.ndarray, psi_rate: float = 2.0, moving: float = 1.0) -> tuple[np.ndarray, ...]:
    """R1, S1, R2, S2 of a hinge at some instants."""
    S1 = turns(moving * np.stack((np.sin(0.7 * t), np.cos(1.1 * t), 0.5 * np.sin(t)), axis=-1))
    R1 = moving * np.stack((np.sin(t), np.cos(t), 0.1 * t), axis=-1)
    psi = np.sin(psi_rate * t) + 0.3 * np.cos(2.5 * psi_rate * t)
    S2 = S1 @ turns(psi[:, None] * N1) @ HOME
    return R1, S1, R1 + S1 @ U1 - S2 @ U2, S2


def recorded(
    late: float, count: int = 2000, rate: float = 200.0, noise: float = 1.0, seed: int = 0, moving: float = 1.0
) -> tuple[np.ndarray, hp.BodyMotion, hp.BodyMotion]:
    """Two bodies with noise of 1 mm and 2 mrad each; body 2 is recorded later than its stamps say."""
    rng = np.random.default_rng(seed)
    t = np.arange(count) / rate
    found = []
    for R, S in (poses(t, moving=moving)[:2], poses(t + late, moving=moving)[2:]):
        off, turn = noise * rng.standard_normal((2, count, 3))
        found.append(hp.BodyMotion(R=R + 1e-3 * off, S=S @ turns(2e-3 * turn)))
    return t, *found


def point_error(fit: hp.HingeFit) -> np.ndarray:
    sign = np.sign(fit.pair.n @ N1)
    return fit.pair.u1 - (U1 - (U1 @ N1) * N1), fit.pair.n - sign * N1


@pytest.mark.slow
@pytest.mark.parametrize("point", [False, True])
@pytest.mark.parametrize("late", [2e-3, 33e-3, -50e-3, 0.4])
def test_an_offset_is_found_with_the_hinge(late: float, point: bool) -> None:
    t, body1, body2 = recorded(late)
    found = hp.fit(body1, as_point(body2) if point else body2, t=t)
    assert found.clock_offset == pytest.approx(late, abs=4 * found.std["clock_offset"])
    assert found.std["clock_offset"] < (0.2e-3 if point else 0.15e-3)  # s, of noise of 1 mm at some m/s
    off = found.pair.u1 - true_centre(N1) if point else point_error(found)[0]
    assert (np.abs(off) < 4.5 * found.std["u1"] + TIGHT).all()
    assert found.ok
    assert found.body2.S is None or not point
    order = "later" if late > 0 else "earlier"
    assert f"ms {order} than its time stamps say" in " ".join(found.findings)
    lost = int(np.floor(abs(late) * 200 + 0.25))
    assert found.samples == pytest.approx(2000 - lost, abs=1)


@pytest.mark.parametrize("seed", range(5))
def test_an_offset_halfway_between_samples_is_found(seed: int) -> None:
    """There, the nearest samples of body 2 change with each small change of the offset, and their noise with them."""
    t, body1, body2 = recorded(-30e-3, count=500, rate=50.0, seed=seed)
    found = hp.fit(body1, body2, t=t)
    assert found.ok
    assert found.clock_offset == pytest.approx(-30e-3, abs=4 * found.std["clock_offset"])
    assert found.std["clock_offset"] < 0.6e-3  # s, of noise of 1 mm at some m/s; infinite where it is not determined


def test_few_samples_of_a_fast_motion_are_taken_as_of_one_clock() -> None:
    t = np.linspace(0, 3, 10)
    R1, S1, R2, S2 = poses(t, psi_rate=20.0)
    found = hp.fit(hp.BodyMotion(R=R1, S=S1), hp.BodyMotion(R=R2, S=S2), t=t)
    assert (found.clock_offset, found.std["clock_offset"]) == (0.0, np.inf)
    assert np.abs(np.concatenate(point_error(found))).max() < TIGHT


@pytest.mark.slow
@pytest.mark.parametrize("late", [0.0, 12.5e-3])
def test_exact_recordings_give_the_offset_exactly(late: float) -> None:
    t, body1, body2 = recorded(late, noise=0.0)
    found = hp.fit(body1, body2, t=t)
    assert found.clock_offset == pytest.approx(late, abs=1e-8)  # s, and m below: left by the splines
    assert np.abs(np.concatenate(point_error(found))).max() < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("late", [2.5e-3, 5e-3])
def test_moving_samples_leaves_their_noise_as_it_is(late: float) -> None:
    """Interpolation would average the noise of neighbours: by a third in the middle between samples."""
    t, body1, body2 = recorded(late, count=4000)
    found = hp.fit(body1, body2, t=t)
    assert found.noise_position == pytest.approx(np.sqrt(2) * 1e-3, rel=0.05)  # of 4000 samples: 1.1 %
    assert found.noise_angle == pytest.approx(np.sqrt(2) * 2e-3, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize("point", [False, True])
def test_a_body_1_that_stands_still_does_not_determine_the_offset(point: bool) -> None:
    """Then a delay is a delay of psi, which the fit does not know; a delayed point runs along the same circle."""
    t, body1, body2 = recorded(10e-3, moving=0.0)
    found = hp.fit(body1, as_point(body2) if point else body2, t=t)
    assert found.ok
    assert (found.clock_offset, found.std["clock_offset"]) == (0.0, np.inf)
    assert [finding.name for finding in found.findings].count("clock") == 1
    assert json.loads(found.to_json())["std"]["clock_offset"] is None


@pytest.mark.slow(2)
@pytest.mark.parametrize("point", [False, True])
def test_an_offset_is_shown_if_it_is_known_to_a_tenth_of_a_second(point: bool) -> None:
    """A slower clock stretches the offset and its error alike; the limit is applied to an estimate of the error."""
    t, body1, body2 = recorded(10e-3, count=400)
    body2 = as_point(body2) if point else body2
    error = hp.fit(body1, body2, t=t).std["clock_offset"]
    slow = hp.fit(body1, body2, t=0.085 / error * t)
    assert slow.std["clock_offset"] == pytest.approx(0.085, rel=0.01)  # s; the starts of the search differ
    assert hp.fit(body1, body2, t=0.115 / error * t).std["clock_offset"] == np.inf


def test_one_clock_is_taken_as_it_is() -> None:
    t, body1, body2 = recorded(10e-3)
    one = hp.fit(body1, body2, t=t, clock_offset=0)
    assert one.pair.u1.tolist() == hp.fit(body1, body2).pair.u1.tolist()
    assert (one.clock_offset, one.std["clock_offset"]) == (0.0, 0.0)
    assert "clock" in {finding.name for finding in one.findings}  # they differ
    t, body1, body2 = recorded(0.0)
    assert "clock" not in {finding.name for finding in hp.fit(body1, body2, t=t, clock_offset=0).findings}


@pytest.mark.slow
@pytest.mark.parametrize("point", [False, True])
@pytest.mark.parametrize("ppm", [500.0, -50.0])
def test_clocks_that_drift_apart_are_brought_together(ppm: float, point: bool) -> None:
    """Over 40 s, 500 ppm move body 2 by 20 ms, which would look like play of the hinge."""
    rng, t = np.random.default_rng(0), 0.025 * np.arange(1600)
    later = t + 0.03 + 1e-6 * ppm * (t - t[-1] / 2)
    made = []
    for R, S in (poses(t)[:2], poses(later)[2:]):
        off, turn = rng.standard_normal((2, 1600, 3))
        made.append(hp.BodyMotion(R=R + 1e-3 * off, S=S @ turns(2e-3 * turn)))
    found = hp.fit(made[0], as_point(made[1]) if point else made[1], t=t)
    assert found.ok
    assert found.clock_offset == pytest.approx(0.03, abs=4 * found.std["clock_offset"])
    assert found.clock_drift == pytest.approx(1e-6 * ppm, abs=4 * found.std["clock_drift"])
    assert found.std["clock_drift"] < 20e-6  # of the noise
    assert "drift apart by" in " ".join(found.findings)
    assert not any(finding.name == "play" for finding in found.findings)


@pytest.mark.slow
def test_an_offset_of_a_motion_that_repeats_may_be_off_by_a_period() -> None:
    """By a second, or by 0.3 s, which is as likely as no offset."""
    rng = np.random.default_rng(5)
    for period, late, ok in ((1.0, 0.7, False), (1.0, 0.01, True), (0.3, 0.01, False)):
        made, t = [], 0.025 * period * np.arange(800)
        for body, instants in ((0, t), (2, t + late)):
            cycle = 2 * np.pi * instants / period
            turn = np.stack((0.4 * np.sin(cycle), 0.3 * np.cos(cycle), 0.2 * np.sin(2 * cycle)), axis=-1)
            R1, S1 = 0.2 * np.stack((np.cos(cycle), np.sin(cycle), 0.3 * np.sin(2 * cycle)), axis=-1), turns(turn)
            S2 = S1 @ turns(0.7 * np.sin(cycle + 0.4)[:, None] * N1) @ HOME
            both = (R1, S1, R1 + S1 @ U1 - S2 @ U2, S2)
            off, angle = rng.standard_normal((2, 800, 3))
            made.append(hp.BodyMotion(R=both[body] + 1e-3 * off, S=both[body + 1] @ turns(2e-3 * angle)))
        found = hp.fit(*made, t=t)
        assert found.ok == ok
        assert f"repeats after {period:.3g} s" in " ".join(found.findings)


@pytest.mark.slow
def test_missing_samples_stay_missing_at_the_clock_of_body_1() -> None:
    t, body1, body2 = recorded(10e-3)  # two samples
    R2 = body2.R.copy()
    R2[700:720] = np.nan
    found = hp.fit(body1, hp.BodyMotion(R=R2, S=body2.S), t=t)
    assert np.flatnonzero(np.isnan(found.psi)).tolist() == [0, 1, *range(702, 722)]
    assert found.samples == 2000 - 22
    assert abs(found.clock_offset - 10e-3) < 4.5 * found.std["clock_offset"]


@pytest.mark.parametrize("loss", ["linear", "cauchy"])
def test_outliers_and_a_gap_beside_an_offset_are_survived(loss: str) -> None:
    """Of body 2 one second is missing at its own time stamps, which are those of other samples of body 1."""
    t, body1, body2 = recorded(-30e-3)
    rng = np.random.default_rng(1)
    R2, S2, off = body2.R.copy(), body2.S.copy(), rng.random(2000) < 0.1
    R2[off] += rng.normal(0, 0.1, (off.sum(), 3))
    S2[off] = S2[off] @ turns(rng.normal(0, 0.3, (off.sum(), 3)))
    R2[1000:1200], S2[1000:1200] = np.nan, np.nan
    found = hp.fit(body1, hp.BodyMotion(R=R2, S=S2), t=t, loss=loss)
    assert found.samples == pytest.approx(2000 - 6 - 200, abs=1)
    serious = [finding.name for finding in found.findings if finding.severity == "serious"]
    assert serious == ([] if loss == "cauchy" else ["outliers"])
    assert "turns in a gap" not in {finding.name for finding in found.findings}
    if loss == "cauchy":
        assert abs(found.clock_offset + 30e-3) < 4 * found.std["clock_offset"]
        assert (np.abs(point_error(found)[0]) < 4 * found.std["u1"] + TIGHT).all()


def as_point(body: hp.BodyMotion) -> hp.BodyMotion:
    return hp.BodyMotion(R=body.R)


def true_centre(n: np.ndarray) -> np.ndarray:
    """u1 of the circle on which body 2's reference point runs, closest to R1."""
    centre = U1 - (HOME @ U2 @ N1) * N1
    return centre - (centre @ n) * n
