"""How many steps `integrate` makes of a callable, what it overlooks, and what rounding leaves of fast motion."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS
from hingepair.motion import steps
from support.sparse import sparse
from support.spins import U
from support.states import generator

PAIR = hp.HingePair(u1=(0.3, -0.2, 0.5), u2=(0.1, 0.7, -0.4), n=(1, 2, -2))


def about_x(rate):
    return lambda t: np.stack([rate(t), 0 * t, 0 * t], axis=-1)


def turns_about_x(motion):
    return np.unwrap(2 * np.arctan2(motion.quat_wxyz[:, 1], motion.quat_wxyz[:, 0]))


def true_error(motion, whole):
    """How far the attitude is off [rad] at the worst of some instants; whole(t) is the angle about x from t[0]."""
    worst, looked = 0.0, np.unique(np.linspace(0, len(motion.t) - 1, 600).astype(int))
    with mpmath.workdps(DIGITS):
        for t, (w, x, *_) in zip(motion.t[looked].tolist(), motion.quat_wxyz[looked].tolist(), strict=True):
            half = whole(mpmath.mpf(t)) / 2
            worst = max(worst, abs(float(2 * (x * mpmath.cos(half) - w * mpmath.sin(half)))))
    return worst


@pytest.mark.parametrize(
    ("samples", "tol"), sparse([(2, 1e-11), (11, 1e-11), (101, 5e-12), (1001, None), (5001, None)], 3)
)
def test_error_estimate_knows_the_rounding_of_fast_motion(samples, tol):
    """22026 rad, the fastest of them at last: u times that is what can be had."""
    t = np.linspace(0, 10, samples)
    motion = hp.integrate(PAIR, t, about_x(np.exp), np.exp, tol=tol, outputs=())
    true = true_error(motion, lambda t: mpmath.exp(t) - 1)
    assert true <= (tol or 2 * U * np.exp(10))
    assert true / 3 <= motion.error_estimate <= 10 * true
    with mpmath.workdps(DIGITS):
        off = max(abs(float(psi - mpmath.expm1(s))) for psi, s in zip(motion.psi.tolist(), t.tolist(), strict=True))
    assert off / 2 <= motion.psi_error_estimate <= 30 * off


def test_no_attitude_is_off_by_more_than_half_a_turn():
    assert hp.integrate(PAIR, [0, 1e9], (1e9, 0, 0), 0.0, outputs=()).error_estimate == np.pi


@pytest.mark.parametrize("at", generator(161).uniform(0.5, 9.5, 4).tolist())
def test_a_short_pulse_is_seen(at):
    """Of a thousandth of the time; in two instants, and without a tolerance the estimate says it is not followed."""
    rate = about_x(lambda t: 100 * np.exp(-((t - at) ** 2) / 1e-4))
    whole = np.sqrt(np.pi)
    blind = hp.integrate(PAIR, [0, 10], rate, 0.0, outputs=())
    assert whole / 2 <= blind.error_estimate <= 2 * whole
    tol = 1e-6
    motion = hp.integrate(PAIR, [0, 10], rate, lambda t: rate(t)[:, 0], tol=tol, outputs=())
    assert abs(turns_about_x(motion)[-1] - whole) <= 3 * motion.error_estimate <= 3 * tol
    assert abs(motion.psi[-1] - whole) <= 3 * motion.psi_error_estimate <= 3 * tol


def kinked(order, at):
    """A rate that jumps (order 0) or bends at an instant, on top of a smooth one, and its integral from 0."""

    def rate(t):
        return np.where(t < at, 0.0, np.maximum(0.0, t - at) ** order) + 0.3 * np.cos(3 * t)

    return rate, lambda t: np.maximum(0.0, t - at) ** (order + 1) / (order + 1) + 0.1 * np.sin(3 * t)


@pytest.mark.slow
@pytest.mark.parametrize("order", [0, 1], ids=["jump", "kink"])
@pytest.mark.parametrize("count", sparse([2, 11, 101, 12_001], 3))
def test_a_jump_of_a_callable_is_seen(count, order):
    """Wherever it is, also where rules of few nodes agree by chance; on more intervals than are looked at, too."""
    t = np.linspace(0, 1, count)
    for at in generator(163).uniform(0.02, 0.98, 3):
        rate, angle = kinked(order, at)
        for tol in (None, 1e-4):
            motion = hp.integrate(PAIR, t, about_x(rate), rate, tol=tol, outputs=())
            off = np.abs(motion.psi - angle(t)).max()
            turned = np.abs(turns_about_x(motion) - angle(t)).max()
            assert off <= min(tol or 1, 3 * motion.psi_error_estimate + 10 * U)
            assert turned <= min(tol or 1, 3 * motion.error_estimate + 20 * U)
            assert motion.psi_error_estimate <= (tol or 1.0 / (count - 1))


def test_a_jump_at_an_instant_costs_nothing():
    """Rates that are held over the intervals, from their left end: each interval is exact."""
    t = np.linspace(0, 1, 101)
    values = generator(164).normal(size=101)

    def held(s):
        return values[np.searchsorted(t, s, side="right") - 1]

    motion = hp.integrate(PAIR, t, about_x(held), held, tol=1e-12, outputs=())
    assert motion.steps == 100
    exact = np.concatenate([[0], np.cumsum(values[:-1] * np.diff(t))])
    np.testing.assert_allclose(motion.psi, exact, rtol=0, atol=20 * U)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "angle"),
    [
        (lambda t: 1.0 * (t > 1.234), lambda t: np.maximum(0, t - 1.234)),
        (lambda t: np.abs(t - 1.234), lambda t: ((t - 1.234) * np.abs(t - 1.234) + 1.234**2) / 2),
        (np.sqrt, lambda t: t**1.5 / 1.5),
    ],
    ids=["jump", "kink", "root"],
)
def test_a_corner_costs_some_sixty_steps(rate, angle, monkeypatch):
    """To the last digits, though steps there are ever shorter."""
    monkeypatch.setattr(steps, "MAX_STEPS", 20_000)
    t = np.linspace(0, 4, 41)
    motion = hp.integrate(PAIR, t, (0, 0, 0), rate, tol=1e-12, outputs=())
    np.testing.assert_allclose(motion.psi, angle(t), rtol=0, atol=8192 * U)
    assert motion.steps <= 20_000
