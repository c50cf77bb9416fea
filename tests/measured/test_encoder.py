"""An encoder beside the poses, noise that is known of each body, and the variances that the fit finds."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from scipy.stats import binom

import hingepair as hp
from support.recorded import HOME, N1, recording, truth, turns


def bodies(made) -> tuple[hp.BodyMotion, hp.BodyMotion]:
    return hp.BodyMotion(R=made.R1, S=made.S1), hp.BodyMotion(R=made.R2, S=made.S2)


def true_psi(made, sign: float) -> np.ndarray:
    """Return psi with the sign and the home of the fit; made.psi is about N1 from HOME on."""
    home = truth(sign)[3]
    turn = hp.rotation_log(HOME @ home.T) @ (sign * N1)
    return sign * made.psi + turn


def read(made, sign: float, zero: float, scale: float, noise: float, seed: int) -> np.ndarray:
    rng = np.random.default_rng(1000 + seed)
    return (true_psi(made, sign) + noise * rng.standard_normal(made.psi.size) - zero) / scale


SIGN = np.sign(hp.fit(*bodies(recording(50))).pair.n @ N1)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, -1.0, np.pi / 180], ids=["radians", "the other way", "degrees"])
def test_an_encoder_is_read_with_zero_and_scale_and_makes_psi_better(scale: float) -> None:
    made = recording(1000, 1e-3, 1e-2)
    found = hp.fit(*bodies(made), encoder=read(made, SIGN, 0.4, scale, 1e-3, 0))
    assert found.encoder.zero == pytest.approx(0.4, abs=4 * found.encoder.std["zero"])
    assert found.encoder.scale == pytest.approx(scale, abs=4 * found.encoder.std["scale"])
    assert found.encoder.std["scale"] < 2e-3 * abs(scale)
    psi = true_psi(made, SIGN)
    assert np.std(found.psi - psi) < 0.2 * np.std(hp.fit(*bodies(made)).psi - psi)
    assert "* encoder, whose noise is" in str(found)
    assert json.loads(found.to_json())["encoder"]["scale"] == found.encoder.scale


def test_a_wrapped_encoder_and_missing_readings() -> None:
    made = recording(1000, 1e-3, 1e-2, turn=8.0)
    reading = np.mod(read(made, SIGN, 0.4, 1.0, 1e-3, 0), 2 * np.pi)
    reading[300:400] = np.nan
    found = hp.fit(*bodies(made), encoder=reading)
    turns_off = (found.encoder.zero - 0.4) / (2 * np.pi)
    assert turns_off == pytest.approx(np.rint(turns_off), abs=1e-3)
    off = found.psi - true_psi(made, SIGN)
    assert np.std(off[:300]) < 3e-3
    assert np.std(off[300:400]) == pytest.approx(np.sqrt(2) * 1e-2, rel=0.3)


def test_an_encoder_has_its_noise_beside_poses_of_different_weight() -> None:
    sizes = np.where(np.arange(1000) % 2, 1.0, 4.0)[:, None]
    made = recording(1000, 1e-3 * sizes, 3e-3 * sizes)
    reading = read(made, SIGN, 0.4, 1.0, 1e-2, 0)
    for loss in ("linear", "cauchy"):
        found = hp.fit(*bodies(made), encoder=reading, weights=1 / sizes[:, 0] ** 2, loss=loss)
        assert found.encoder.noise == pytest.approx(1e-2, rel=0.2)
        z = (found.psi - true_psi(made, SIGN)) / found.std["psi"]
        assert np.std(z) == pytest.approx(1, abs=0.12)


@pytest.mark.slow
def test_a_rough_encoder_has_its_noise_and_an_unbiased_scale() -> None:
    scores = []
    for seed in range(12):
        made = recording(400, 1e-3, 1e-2, seed)
        found = hp.fit(*bodies(made), encoder=read(made, SIGN, 0.4, 1.0, 5e-2, seed))
        assert found.encoder.noise == pytest.approx(5e-2, rel=0.15)
        scores.append((found.encoder.scale - 1) / found.encoder.std["scale"])
    assert abs(np.mean(scores)) < 4 / np.sqrt(12)


@pytest.mark.proof
def test_the_zero_is_as_uncertain_as_the_home_that_it_is_counted_from() -> None:
    """Axes 132 degrees apart in the two bodies: errors of either turn `home` about the other by twice as much."""
    across = np.cross(N1, (1.0, 0.0, 0.0)) / np.linalg.norm(np.cross(N1, (1.0, 0.0, 0.0)))
    over = turns(2.3 * across)  # takes the axis of body 2 to that of body 1 the short way
    psi = recording(300).psi
    scores = []
    for seed in range(60):
        made = recording(300, 1e-3, 1e-2, seed, Q=turns(psi[:, None] * N1) @ over)
        noise = 1e-3 * np.random.default_rng(1000 + seed).standard_normal(300)
        found = hp.fit(*bodies(made), encoder=np.sign(SIGN) * psi + noise - 0.4)
        assert np.abs(found.pair.home - over).max() < 0.02
        scores.append((found.encoder.zero - 0.4) / found.encoder.std["zero"])
    assert 0.75 < np.sqrt(np.mean(np.square(scores))) < 1.3


NOISE = np.random.default_rng(7).standard_normal(1000)
BAD_ENCODERS = {
    "noise alone": lambda _, psi: 0 * psi + NOISE,
    "noise as large as the motion": lambda _, psi: psi + np.std(psi) * NOISE,
    "50 ms late": lambda t, psi: np.interp(t - 0.05, t, psi) + 1e-3 * NOISE,
    "50 ms early": lambda t, psi: np.interp(t + 0.05, t, psi) + 1e-3 * NOISE,
    "eccentric": lambda _, psi: psi + 0.4 * np.sin(3 * psi),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", BAD_ENCODERS)
def test_an_encoder_that_does_not_follow_the_hinge_is_not_relied_on(name: str) -> None:
    made = recording(1000, 1e-3, 5e-3)
    found = hp.fit(*bodies(made), encoder=BAD_ENCODERS[name](made.t, true_psi(made, SIGN)))
    assert not found.ok
    assert "The encoder" in " ".join(found.findings)
    assert all(word in " ".join(found.findings) for word in re.findall("late|early", name))


@pytest.mark.parametrize("loss", ["linear", "cauchy"])
def test_a_reading_that_is_rejected_does_not_move_psi(loss: str) -> None:
    made = recording(1000, 1e-3, 5e-3)
    reading = read(made, SIGN, 0.4, 1.0, 1e-3, 0)
    reading[77] += 1.0
    found = hp.fit(*bodies(made), loss, encoder=reading)
    assert np.abs(found.psi - true_psi(made, SIGN)).max() < 6 * np.sqrt(2) * 5e-3
    assert "of the encoder's readings are outliers; psi leaves them out" in " ".join(found.findings)


def test_the_encoder_tells_psi_where_a_pose_is_an_outlier() -> None:
    made = recording(1000, 1e-3, 5e-3, outliers=0.1)
    found = hp.fit(*bodies(made), "cauchy", encoder=read(made, SIGN, 0.4, 1.0, 1e-3, 0))
    assert found.ok
    assert np.abs(found.psi - true_psi(made, SIGN)).max() < 0.02


def test_readings_that_cannot_be_used_are_named() -> None:
    made = recording(400, 1e-3, 1e-2)
    with pytest.raises(hp.ArgumentError, match="encoder: expected at least two readings that differ"):
        hp.fit(*bodies(made), encoder=np.ones(400))
    with pytest.raises(hp.ShapeError, match="encoder"):
        hp.fit(*bodies(made), encoder=np.ones(3))


@pytest.mark.slow
def test_the_variances_are_told_apart_where_attitudes_are_rough() -> None:
    """Noise of attitudes times levers is twelve times as large as that of positions."""
    ratios = []
    for seed in range(10):
        found = hp.fit(*bodies(recording(1000, 1e-3, 3e-2, seed)))
        ratios.append((found.noise_position / (np.sqrt(2) * 1e-3), found.noise_angle / (np.sqrt(2) * 3e-2)))
        scores = (found.noise_position - np.sqrt(2) * 1e-3) / found.std["noise_position"]
        assert abs(scores) < 4
    rms = np.sqrt(np.mean((np.array(ratios) - 1) ** 2, axis=0))
    assert rms[0] < 0.12
    assert rms[1] < 0.02


@pytest.mark.slow
def test_noise_that_is_known_of_each_body_and_sample_is_used() -> None:
    """Body 2 has attitudes like a gyroscope's and, in half of its samples, places that are ten times worse."""
    gains = []
    for seed in range(8):
        made = recording(600)
        rng = np.random.default_rng(seed)
        place = np.where(np.arange(600) % 2, 1e-2, 1e-3)
        off, turn1, turn2 = rng.standard_normal((3, 600, 3))
        body1 = hp.BodyMotion(R=made.R1, S=made.S1 @ turns(1e-2 * turn1))
        body2 = hp.BodyMotion(R=made.R2 + place[:, None] * off, S=made.S2 @ turns(1e-4 * turn2))
        told = hp.fit(body1, body2, noise1=(1e-6, 1e-2), noise2=(place, 1e-4))
        blind = hp.fit(body1, body2)
        errors = [np.abs(fit.pair.u1 - truth(SIGN)[0]).max() for fit in (told, blind)]
        gains.append(errors)
        assert "noise1" not in " ".join(told.findings)
        assert (np.abs(told.pair.u1 - truth(SIGN)[0]) < 4.5 * told.std["u1"]).all()
    told_rms, blind_rms = np.sqrt(np.mean(np.square(gains), axis=0))
    assert told_rms < 0.7 * blind_rms


def test_noise_that_is_known_wrongly_is_said() -> None:
    made = recording(600, 1e-3, 2e-3)
    found = hp.fit(*bodies(made), noise1=(1e-4, 2e-3), noise2=(1e-4, 2e-3))
    assert re.search(r"Positions scatter (9\.\d|10) times as much as noise1 and noise2 say", found.findings[0])
    assert "Attitudes" not in " ".join(found.findings)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"noise1": (1e-3, 1e-3)},
            "noise2: expected two standard deviations, .* as for the other body",
        ),
        ({"noise1": (1e-3, 1e-3), "noise2": 1e-3}, "noise2: expected two standard deviations"),
        ({"noise1": (1e-3, -1.0), "noise2": (1e-3, 1.0)}, "noise1: expected finite numbers, none negative"),
        ({"noise1": (np.ones(3), 1.0), "noise2": (1e-3, 1.0)}, "noise1: expected numbers or shape"),
        ({"noise1": (0.0, 1.0), "noise2": (0.0, 1.0)}, "above 0 for at least one body"),
    ],
)
def test_noise_that_cannot_be_used_is_named(change: dict[str, object], words: str) -> None:
    with pytest.raises(hp.ArgumentError, match=words):
        hp.fit(*bodies(recording(50)), **change)


def seen_by_an_encoder(kind: str, seed: int) -> hp.HingeFit:
    """A fit of a recording whose encoder is as the kind says."""
    outliers, loss = (0.2, "cauchy") if kind == "outliers" else (0.0, "linear")
    made = recording(300, 1e-3, 1e-2, seed, outliers=outliers)
    reading = read(made, SIGN, 0.4, 1.0, 3e-2 if kind == "rough" else 1e-3, seed)
    if kind == "gaps":
        reading[np.random.default_rng(seed).random(300) < 0.5] = np.nan
    return hp.fit(*bodies(made), loss=loss, encoder=reading, t=made.t if kind == "clock" else None)


@pytest.mark.proof(10)
@pytest.mark.parametrize("kind", ["good", "rough", "gaps", "outliers", "clock"])
def test_errors_with_an_encoder_are_within_the_intervals_in_many_runs(kind: str) -> None:
    inside, runs = np.zeros(11), 40 if kind == "clock" else 120
    for seed in range(runs):
        found = seen_by_an_encoder(kind, seed)
        u1, u2, n, _ = truth(SIGN)
        off = [found.encoder.zero - 0.4, found.encoder.scale - 1, *(found.pair.u1 - u1), *(found.pair.u2 - u2)]
        std = [*found.encoder.std.values(), *found.std["u1"], *found.std["u2"], *found.std["n"]]
        inside += np.abs([*off, *(found.pair.n - n)]) < 1.96 * np.array(std)
    assert inside.min() >= binom.ppf(0.001, runs, 0.95)
    assert (inside / runs).mean() <= 0.985
