"""Noise that is known of each body, and the variances that the fit finds."""

from __future__ import annotations

import re

import numpy as np
import pytest

import hingepair as hp
from support.recorded import N1, recording, truth, turns


def bodies(made) -> tuple[hp.BodyMotion, hp.BodyMotion]:
    return hp.BodyMotion(R=made.R1, S=made.S1), hp.BodyMotion(R=made.R2, S=made.S2)


SIGN = np.sign(hp.fit(*bodies(recording(50))).pair.n @ N1)


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
