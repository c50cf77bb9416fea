"""Scenes whose attitude is integrated from a log of rates (E12), and what is wrong with such logs, named."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp

MODELS = Path(__file__).parents[2] / "models"


@pytest.mark.slow
def test_the_gyro_log_is_what_its_script_makes(tmp_path):
    spec = importlib.util.spec_from_file_location("make_gyro_log", MODELS / "make_gyro_log.py")
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.main(tmp_path)
    for name in ("gyro_log.csv", "gyro_log_truth.csv"):
        assert (tmp_path / name).read_bytes() == (MODELS / name).read_bytes()
        assert (MODELS / name).stat().st_size < 100_000


@pytest.mark.slow
def test_the_gyro_log_gives_the_attitude_beside_it():
    """And the estimate says how far off it is."""
    scene = hp.load_scene(MODELS / "gyro_log.toml")
    truth = np.loadtxt(MODELS / "gyro_log_truth.csv", delimiter=",", skiprows=1)
    np.testing.assert_array_equal(scene.t, truth[:, 0])
    S = hp.BodyMotion.from_quaternion_xyzw(R=np.zeros(3), quat_xyzw=truth[:, 1:5]).S
    off = np.linalg.norm(hp.rotation_log(np.swapaxes(S, -1, -2) @ scene.motion.source.body1.S), axis=-1).max()
    assert off < 2e-11  # rad; the log has 12 decimals, and a step is 0.01 s
    assert off / 10 <= scene.motion.error_estimate <= 50 * off
    np.testing.assert_allclose(scene.motion.source.psi, truth[:, 5], rtol=0, atol=1e-12)  # 12 decimals
