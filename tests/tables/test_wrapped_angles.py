"""Angles brought into one turn, and angles that truly jump."""

from __future__ import annotations

import numpy as np
import pytest

from hingepair.tables.wrapped_angles import is_wrapped, unwrap_if_wrapped
from support.near import assert_near

T = np.arange(400) / 100


def wrapped(angles: np.ndarray, low: float = -np.pi) -> np.ndarray:
    return (angles - low) % (2 * np.pi) + low


@pytest.mark.parametrize("low", [-np.pi, 0.0, 1.0])
@pytest.mark.parametrize("rate", [3.0, -20.0, 150.0], ids=["slow", "backwards", "a quarter of a turn a sample"])
def test_wrapped_angles_become_continuous(low: float, rate: float) -> None:
    angles = rate * T + 0.3
    assert is_wrapped(wrapped(angles, low))
    continuous = unwrap_if_wrapped(wrapped(angles, low))
    assert_near(continuous - continuous[0], angles - angles[0], 64)


@pytest.mark.parametrize(
    "angles",
    [10 * np.arange(20) * 0.5, np.radians(40) * np.sin(3 * T), 90 * np.sin(30 * T), np.where(T < 2, 0.0, 4.5)],
    ids=["5 rad a sample", "a hinge", "degrees", "a jump of less than three quarters"],
)
def test_other_angles_are_left_alone(angles: np.ndarray) -> None:
    assert not is_wrapped(angles)
    assert unwrap_if_wrapped(angles) is angles


def test_missing_samples_stay_missing_and_are_stepped_over() -> None:
    angles = wrapped(5 * T)
    angles[60:70] = np.nan  # over the jump
    continuous = unwrap_if_wrapped(angles)
    assert np.isnan(continuous).tolist() == np.isnan(angles).tolist()
    known = np.isfinite(angles)
    assert_near(continuous[known], 5 * T[known], 16)
    assert not is_wrapped(np.array([np.nan, 1.0]))
    assert not is_wrapped(np.array([]))
