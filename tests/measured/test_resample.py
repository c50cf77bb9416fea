"""Recordings at other instants."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.near import U


def turning(t: np.ndarray) -> np.ndarray:
    """An attitude that turns about an axis which moves."""
    return hp.rotation_exp(np.stack((np.sin(t), 0.5 * t, np.cos(2 * t)), axis=-1))


def test_a_cubic_comes_back_to_rounding_on_uneven_stamps() -> None:
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.4, 1.2, 50))
    to = rng.uniform(t[0], t[-1], 200)
    curve = np.polynomial.Polynomial((1.0, -2.0, 0.5, 0.01))
    found = hp.resample(t, np.stack((curve(t), -curve(t)), axis=-1), to, gaps=2.0)
    size = np.abs(curve(t)).max()
    assert np.abs(found[:, 0] - curve(to)).max() < 32 * 2.0**-53 * size
    assert (found[:, 0] == -found[:, 1]).all()


def test_the_error_for_rotations_falls_with_the_fourth_power_of_the_step() -> None:
    to = np.linspace(0.1, 3.9, 57)
    errors = []
    for count in (101, 201):
        t = np.linspace(0, 4, count)
        body = hp.resample(t, hp.BodyMotion(R=np.zeros(3), S=turning(t)), to, gaps=1.0)
        off = hp.rotation_log(np.swapaxes(turning(to), -1, -2) @ body.S)
        errors.append(np.abs(off).max())
    assert errors[1] < errors[0] / 10
    assert errors[0] < 1e-5  # (0.04 s)^4 times the rates


def test_gaps_and_what_lies_outside_are_nan_and_the_rest_is_not() -> None:
    t = np.arange(100) * 0.01
    values = np.sin(t)
    values[20:23] = np.nan  # 40 ms: bridged
    values[60:70] = np.nan  # 110 ms: a gap
    to = np.array([-0.001, 0.0, 0.215, 0.595, 0.65, 0.695, 0.99, 0.9901])
    found = hp.resample(t, values, to)
    assert np.isnan(found).tolist() == [True, False, False, True, True, True, False, True]
    assert np.abs(found - np.sin(to))[2] < 1e-8  # (0.01 s)^4
    assert np.isnan(hp.resample(t, np.nan * t, to)).all()


def test_two_clocks_of_nanoseconds_meet() -> None:
    t = np.int64(1_700_000_000_000_000_000) + 5_000_000 * np.arange(100)
    to = t[10:90] + 1_234_567
    found = hp.resample(t, np.sin((t - t[0]) * 1e-9), to)
    assert np.abs(found - np.sin((to - t[0]) * 1e-9)).max() < 1e-10  # (5 ms)^4 / 6


def quaternions(t: np.ndarray, rate: float) -> np.ndarray:
    """Turning about (1, 2, 2) / 3, with the scalar last; never flipped."""
    angle = rate * t[:, None] / 2
    return np.concatenate((np.sin(angle) * np.array([[1, 2, 2]]) / 3, np.cos(angle)), axis=-1)


def test_quaternions_of_one_sign_are_interpolated() -> None:
    t = np.arange(200) / 100
    values = quaternions(t, 3.0)
    to = t[10:50] + 0.004
    assert np.abs(hp.resample(t, values, to) - quaternions(to, 3.0)).max() < (0.01 * 3.0) ** 4
    other = np.where(t[:, None] < 1.2, 1.0, -2.0) * np.array([0.1, 0.2, 0.3, 0.4])
    assert np.isfinite(hp.resample(t, other, [1.195])).all()  # four numbers that are no quaternion


def test_a_body_of_quaternions_may_flip() -> None:
    t = np.arange(200) / 100
    values = quaternions(t, 3.0) * np.where(np.arange(200) % 3, 1, -1)[:, None]
    body = hp.BodyMotion.from_quaternion_xyzw(R=np.zeros((200, 3)), quat_xyzw=values)
    there = hp.BodyMotion.from_quaternion_xyzw(R=np.zeros(3), quat_xyzw=quaternions(np.array([1.195]), 3.0)[0])
    assert np.abs(hp.resample(t, body, [1.195]).S[0] - there.S).max() < 4096 * U


@pytest.mark.parametrize(("turn", "words"), [(2 * np.pi, "2 pi"), (360.0, "360")], ids=["radians", "degrees"])
def test_wrapped_angles_are_warned_of(turn: float, words: str) -> None:
    """Between pi and -pi a polynomial goes through 0."""
    t = np.arange(200) / 100
    wrapped = (5 * t / (2 * np.pi) + 0.5) % 1 * turn - turn / 2
    with pytest.warns(hp.MeasurementWarning, match=f"values jump by nearly {words}, as a wrapped angle does"):
        hp.resample(t, wrapped, [0.625])
    with pytest.warns(hp.MeasurementWarning, match=f"values jump by nearly {words}"):
        hp.resample(t, np.stack((t, wrapped), axis=-1), [0.625])
    assert hp.resample(t, np.unwrap(wrapped, period=turn), [0.625])[0] == pytest.approx(
        (5 * 0.625 / (2 * np.pi) + 0.5) * turn - turn / 2, rel=64 * U
    )


@pytest.mark.parametrize("rate", [50, 64, 100, 128, 256])
def test_two_missing_samples_are_interpolated_like_one(rate):
    """At 64, 128 and 256 Hz a Lagrange weight is exactly 1 away from its node."""
    t = np.arange(40) / rate
    curve = 1 + t - 3 * (t * rate / 40) ** 3
    known = curve.copy()
    known[[10, 11, 20, 21]] = np.nan
    np.testing.assert_allclose(hp.resample(t, known, t, gaps=0.1), curve, rtol=0, atol=512 * U)
    S = hp.rotation_exp(curve[:, None] * (0, 0.6, 0.8))
    missing = np.where(np.isnan(known)[:, None, None], np.nan, S)
    found = hp.resample(t, hp.BodyMotion(R=np.zeros((40, 3)), S=missing), t, gaps=0.1).S
    np.testing.assert_allclose(found, S, rtol=0, atol=512 * U)
