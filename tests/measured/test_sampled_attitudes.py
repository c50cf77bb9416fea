"""Angular velocity from samples of S (E3), on any instants."""

from __future__ import annotations

import re

import numpy as np
import pytest

import hingepair as hp
from hingepair.measured.smoothing.angular_velocity import stencils
from support.spins import REFERENCE
from support.states import generator

U = 2.0**-53
ORDERS = (2, 4, 6, 8)


def reference(t):
    return hp.euler_to_matrix(np.stack([3 * t, t, 5 * t], axis=-1))


def uneven(count, seed=0):
    return np.cumsum(generator(80, seed).uniform(0.5, 1.5, count))


@pytest.mark.slow
def test_reference_example_at_a_millisecond():
    t = np.arange(10_001) * 1e-3
    omega, alpha = hp.angular_velocity_from_samples(t, reference(t), with_alpha=True)
    assert abs(omega - REFERENCE.omega(t)).max() <= 2e-11  # left by differences of rounded attitudes
    assert abs(alpha - REFERENCE.alpha(t)).max() <= 1e-7  # as above, twice
    assert np.array_equal(omega, hp.angular_velocity_from_samples(t, reference(t)))


@pytest.mark.parametrize("order", ORDERS)
def test_error_falls_with_the_order(order):
    """On uneven instants too; at the ends, where the neighbours are on one side, with the same order."""
    steps = uneven(21, order) / 21
    errors = []
    for span in (0.06 * order, 0.03 * order):
        t = 1 + span * steps
        found = hp.angular_velocity_from_samples(t, reference(t), order, with_alpha=True)
        exact = (REFERENCE.omega(t), REFERENCE.alpha(t))
        errors.append([abs(a - b).max(axis=-1)[rows].max() for a, b in zip(found, exact, strict=True) for rows in
                       (slice(order // 2, -order // 2), slice(0, order // 2), slice(-order // 2, None))])  # fmt: skip
    observed = np.log2(np.array(errors[0]) / errors[1])
    assert (observed[:3] > order - 0.5).all(), observed
    assert (observed[3:] > order - 1.5).all(), observed


def test_noise_gain_is_that_of_the_docstring():
    """Weights on independent noise: the sum of their squares."""
    rows = re.findall(r"^ +(\d) +([\d.]+) +([\d.]+)$", hp.angular_velocity_from_samples.__doc__, re.MULTILINE)
    assert [int(row[0]) for row in rows] == list(ORDERS)
    for order, *stated in rows:
        gain = np.empty(40)
        for own, _, first, _ in stencils(np.arange(40.0) / 8, int(order)):
            gain[own] = np.sqrt((first**2).sum(axis=-1)) / 8
        assert [f"{gain[20]:.2g}", f"{gain[0]:.2g}"] == [f"{float(text):.2g}" for text in stated]
        assert gain[-1] == pytest.approx(gain[0], rel=8192 * U)


def test_a_lost_sample_costs_its_stencil_and_nothing_else():
    t = np.arange(60) * 0.01
    S = reference(t)
    whole = hp.angular_velocity_from_samples(t, S)
    S[30, 1, 2] = np.nan
    omega = hp.angular_velocity_from_samples(t, S)
    lost = np.isnan(omega).any(axis=-1)
    assert np.flatnonzero(lost).tolist() == list(range(27, 34))
    assert np.isnan(omega[lost]).all()
    assert np.array_equal(omega[~lost], whole[~lost])
    S[30] = np.inf
    assert np.array_equal(np.isnan(hp.angular_velocity_from_samples(t, S)).any(axis=-1), lost)


def test_leading_axes_are_many_attitudes_at_the_same_instants():
    t = uneven(30) * 0.01
    S = np.stack([reference(t), np.swapaxes(reference(t), -1, -2), reference(t + 1)]).reshape(3, 1, 30, 3, 3)
    omega, alpha = hp.angular_velocity_from_samples(t, S, 4, with_alpha=True)
    assert omega.shape == alpha.shape == (3, 1, 30, 3)
    for i in range(3):
        assert np.array_equal(omega[i, 0], hp.angular_velocity_from_samples(t, S[i, 0], 4))
    assert hp.angular_velocity_from_samples(t, S[:0]).shape == (0, 1, 30, 3)


@pytest.mark.parametrize("turn", [0.39, 0.77, 1.5, 3.0])
def test_a_fast_spin_is_exact_and_a_shaking_one_refused(turn):
    t, axis = np.arange(20.0), np.array([0.6, 0.0, 0.8])
    steady = hp.rotation_exp(t[:, None] * turn * axis)
    omega, alpha = hp.angular_velocity_from_samples(t, steady, with_alpha=True)
    assert abs(omega - turn * axis).max() <= 256 * U
    assert abs(alpha).max() <= 2048 * U
    shaking = hp.rotation_exp((t % 2)[:, None] * turn * axis)
    if turn < 0.5:
        hp.angular_velocity_from_samples(t, shaking, 2)
    else:
        with pytest.raises(hp.ArgumentError, match="spin that changes less"):
            hp.angular_velocity_from_samples(t, shaking)


@pytest.mark.slow
@pytest.mark.parametrize("order", [2, 6])
def test_a_fast_spin_about_an_axis_that_tilts_slowly_is_followed(order):
    """A spin of 1 rad a sample about an axis of the body, beside a slow turn."""

    def attitude(t):
        slow, fast = (
            hp.rotation_exp(0.3 * np.sin(t)[:, None] * (1, 0, 0)),
            hp.rotation_exp(100 * t[:, None] * (0, 0, 1)),
        )
        return slow @ fast

    t = np.arange(200) / 100
    tilt = np.stack([0.3 * np.cos(t), 0 * t, 0 * t], axis=-1)
    S = attitude(t)
    slow = hp.rotation_exp(0.3 * np.sin(t)[:, None] * (1, 0, 0))
    exact = tilt + 100 * slow[..., 2]
    error = np.abs(hp.angular_velocity_from_samples(t, S, order) - exact)[10:-10].max()
    assert error < (0.1 if order == 2 else 0.01)  # rad/s, of a tilt that changes within steps
    motion = hp.resample(t, hp.BodyMotion(R=np.zeros((200, 3)), S=S), t[:-1] + 0.005)
    between = attitude(t[:-1] + 0.005)
    assert np.abs(hp.rotation_log(np.swapaxes(between, -1, -2) @ motion.S)).max() < 1e-3  # rad, left between samples
