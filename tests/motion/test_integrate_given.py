"""What may be given to `integrate`, how far its own estimate of the error can be trusted, and what it refuses."""

from __future__ import annotations

import pickle

import mpmath
import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

import hingepair as hp
from hingepair.bench.truth import DIGITS
from hingepair.motion.magnus import NODES
from hingepair.motion.signals import SampledSignal
from support.spins import REFERENCE, SPINS, TURNED, U, angle
from support.states import generator

PAIR = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
T = np.linspace(0, 1, 101)
spins = pytest.mark.parametrize("spin", SPINS.values(), ids=SPINS)


def attitudes(spin, t, given=None, **options):
    omega = spin.omega if given is None else given
    return hp.integrate(PAIR, t, omega, 1.0, S1_0=spin.S1_0, outputs=(), **options)


@spins
@pytest.mark.parametrize("even", [True, False], ids=["even", "uneven"])
def test_samples_keep_order_6(spin, even):
    """A spline of degree 5: halving the step makes the error 64 times smaller."""
    errors = []
    for count in (100, 200):
        t = np.linspace(0, 1, count + 1)
        t = t if even else t + 0.3 * (t * (1 - t))
        errors.append(spin.error(t, attitudes(spin, t, spin.omega(t)).S1))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6, abs=0.5)  # the order, of steps that are not 0
    assert errors[1] < 8192 * U


@spins
def test_tolerance_is_kept_by_substeps(spin):
    t, tol = np.array([0, 0.01, 0.1, 0.6, 1.0]), 1e-9
    motion = hp.integrate(PAIR, t, spin.omega, np.exp, S1_0=spin.S1_0, tol=tol, outputs=())
    assert spin.error(t, motion.S1, instants=4) <= motion.error_estimate * 1.01 <= tol * 1.01
    assert np.abs(motion.psi - np.expm1(t)).max() <= tol
    assert motion.steps <= 80


def test_tolerance_out_of_reach_says_what_is_left():
    with pytest.raises(hp.ArgumentError, match=r"tol: expected at least the error that is left, \d"):
        attitudes(REFERENCE, T, tol=1e-17)
    with pytest.raises(hp.ArgumentError, match="tol: expected at least"):
        attitudes(REFERENCE, T, REFERENCE.omega(T), tol=1e-14)
    motion = attitudes(REFERENCE, T[::4], tol=1e-13)
    assert motion.steps > len(T[::4]) - 1
    assert REFERENCE.error(T[::4], motion.S1) <= 512 * U


@pytest.mark.slow
@pytest.mark.parametrize("step", [2.0**-7, 0.01, None], ids=["dyadic", "even", "uneven"])
def test_stamps_since_1970_lose_nothing(step):
    """Samples at t and at t - t[0], the same numbers: the same motion, found as fast, and the same estimate."""
    steps = generator(132).uniform(0.005, 0.02, 50) if step is None else np.full(50, step)
    t = 1.7e9 + np.cumsum(steps)
    since = t - t[0]
    omega, psid = TURNED.omega(since), np.cos(3 * since)
    late, early = (hp.integrate(PAIR, x, omega, psid, outputs=()) for x in (t, since))
    np.testing.assert_allclose(late.quat_wxyz, early.quat_wxyz, rtol=0, atol=100 * U)
    np.testing.assert_allclose(late.psi, early.psi, rtol=0, atol=100 * U)
    assert early.error_estimate / 2 <= late.error_estimate <= 2 * early.error_estimate
    assert early.psi_error_estimate / 2 <= late.psi_error_estimate <= 2 * early.psi_error_estimate


def test_error_estimate_of_samples_sees_gaps_jumps_and_too_few_samples():
    """At most five times too small; NaN where samples cannot tell, which no tolerance accepts."""
    gap = np.r_[np.linspace(0, 4, 401), np.linspace(5, 9, 401)]
    cases = [(gap, lambda t: np.cos(2 * t), lambda t: np.sin(2 * t) / 2)]
    for at in (5.0021, 5.0051, 5.0089):
        jump = (lambda t, at=at: 1.0 * (t > at)), (lambda t, at=at: np.maximum(0, t - at))
        cases.append((np.linspace(0, 10, 1001), *jump))
    for t, rate, turn in cases:
        rates = np.outer(rate(t), (0, 0, 1))
        motion = hp.integrate(PAIR, t, rates, rate(t), outputs=())
        off = np.abs(motion.psi - (turn(t) - turn(t[0]))).max()
        assert off <= 5 * motion.psi_error_estimate <= 100 * off
        assert motion.error_estimate == pytest.approx(motion.psi_error_estimate, rel=1e-6)  # of two estimates
    with pytest.raises(hp.ArgumentError, match="tol: expected at least the error that is left, nan rad"):
        hp.integrate(PAIR, t[:3], (0, 0, 0), t[:3], tol=1.0, outputs=())


@pytest.mark.parametrize("count", [2, 3, 5, 6, 7, 9, 30, 2000])
@pytest.mark.parametrize("jitter", [0.0, 1e-4], ids=["even", "uneven"])
def test_samples_take_the_spline_of_scipy(jitter, count):
    """From sample to sample and in parts of the intervals; noise shows every coefficient."""
    even = 3 + 2.0**-7 * np.arange(count)
    t = even + jitter * np.sin(1e3 * even)
    values = generator(5).normal(size=(count, 3))
    spline = make_interp_spline(t - t[0], values, min(5, count - 1))
    halves = np.sort(np.append(t, t[:-1] + np.diff(t) / 2))
    for times in (t, t[count // 3 : count // 2 + 2], halves):
        start, h = times[:-1], np.diff(times)
        nodes = (start - t[0])[:, None] + h[:, None] * np.array(NODES)
        found = SampledSignal(t, values).values_at_nodes(start, h, NODES)
        np.testing.assert_allclose(found, spline(nodes), rtol=0, atol=100 * count * U)  # SciPy's times are rounded


def test_pickling_computes_no_estimate_and_keeps_those_computed():
    calls = []
    motion = hp.integrate(PAIR, T, lambda t: calls.append(1) or TURNED.omega(t), 1.0)
    before = len(calls)
    again = pickle.loads(pickle.dumps(motion))
    assert len(calls) == before
    np.testing.assert_array_equal(again.R2, motion.R2)
    with pytest.raises(hp.ArgumentError, match="computed before the motion was pickled"):
        again.error_estimate  # noqa: B018
    estimate = motion.error_estimate
    assert pickle.loads(pickle.dumps(motion)).error_estimate == estimate > 0


@pytest.mark.proof
@pytest.mark.parametrize("name", [*SPINS][1:])
def test_a_million_steps_do_not_drift(name):
    """Attitude to 2e-14 rad and psi to 2u at every instant looked at: truncation is far below."""
    spin, count = SPINS[name], 10**6
    t = np.linspace(0, 10, count + 1)
    motion = hp.integrate(
        PAIR, t, spin.omega, lambda s: 1 + 0.3 * np.cos(s), S1_0=spin.S1_0, psi_0=0.1, outputs=(), backend="compiled"
    )
    for i in generator(131).integers(1, count + 1, 100):
        S = hp.BodyMotion.from_quaternion_wxyz(R=(0, 0, 0), quat_wxyz=motion.quat_wxyz[i]).S
        assert angle(S, spin.exact(t[i])) <= 128 * U
        with mpmath.workdps(DIGITS):
            exact = mpmath.mpf(0.1) + mpmath.mpf(t[i]) + mpmath.mpf(3) / 10 * mpmath.sin(mpmath.mpf(t[i]))
            assert abs(motion.psi[i] - exact) <= 2 * U * abs(exact)
    assert motion.error_estimate <= 128 * U
