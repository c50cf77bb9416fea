"""Recordings at other instants."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp


def turning(t: np.ndarray) -> np.ndarray:
    """An attitude that turns about an axis which moves."""
    return hp.rotation_exp(np.stack((np.sin(t), 0.5 * t, np.cos(2 * t)), axis=-1))


def test_a_cubic_comes_back_to_rounding_on_uneven_stamps() -> None:
    rng = np.random.default_rng(1)
    t = np.cumsum(rng.uniform(0.5, 1.5, 50))
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
    assert errors[0] < 1e-5


def test_at_a_sample_stands_the_sample() -> None:
    t = np.linspace(0, 1, 21) ** 1.5 + 1.7e9
    values = np.random.default_rng(2).normal(size=(21, 2))
    assert (hp.resample(t, values, t, gaps=1.0) == values).all()
    body = hp.BodyMotion(R=np.zeros((21, 3)), S=turning(t))
    assert (hp.resample(t, body, t, gaps=1.0).S == body.S).all()


def test_gaps_and_what_lies_outside_are_nan_and_the_rest_is_not() -> None:
    t = np.arange(100) * 0.01
    values = np.sin(t)
    values[20:23] = np.nan  # 40 ms: bridged
    values[60:70] = np.nan  # 110 ms: a gap
    to = np.array([-0.001, 0.0, 0.215, 0.595, 0.65, 0.695, 0.99, 0.9901])
    found = hp.resample(t, values, to)
    assert np.isnan(found).tolist() == [True, False, False, True, True, True, False, True]
    assert np.abs(found - np.sin(to))[2] < 1e-8


@pytest.mark.parametrize("count", [1, 2, 3])
def test_pieces_of_a_few_samples_are_lines_through_them(count: int) -> None:
    t = np.arange(count) * 0.5
    assert hp.resample(t, 1 + 2 * t, t[-1:] * 0.8).tolist() == pytest.approx([1 + 1.6 * t[-1]], rel=1e-15)


def test_all_that_a_body_has_is_resampled() -> None:
    t = np.linspace(0, 1, 30)
    body = hp.BodyMotion(R=np.outer(t, (1, 2, 3)), S=turning(t), v=np.ones((30, 3)), a=np.outer(t, (1, 0, 0)))
    found = hp.resample(t, body, [0.51], gaps=1.0)
    assert found.v[0].tolist() == pytest.approx([1, 1, 1], rel=1e-15)
    assert found.a[0, 0] == pytest.approx(0.51, rel=1e-15)
    assert found.omega is None


def test_two_clocks_of_nanoseconds_meet() -> None:
    t = np.int64(1_700_000_000_000_000_000) + 5_000_000 * np.arange(100)
    to = t[10:90] + 1_234_567
    found = hp.resample(t, np.sin((t - t[0]) * 1e-9), to)
    assert np.abs(found - np.sin((to - t[0]) * 1e-9)).max() < 1e-10


def test_what_cannot_be_used_is_named() -> None:
    with pytest.raises(hp.ShapeError, match="values"):
        hp.resample([0.0, 1.0], [1.0], [0.5])
    with pytest.raises(hp.ArgumentError, match="gaps"):
        hp.resample([0.0, 1.0], [1.0, 2.0], [0.5], gaps=0)
    with pytest.raises(hp.ShapeError, match="values"):
        hp.resample([0.0, 1.0], hp.BodyMotion(R=(0, 0, 0), S=np.eye(3)), [0.5])
