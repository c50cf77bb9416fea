"""How far integrals over samples are off: the estimate holds for gaps, too few samples, jumps and kinks.

The law is `true <= 10 * estimate`, and where the motion is smooth `estimate <= 10 * true` as well.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.integration import interpolation_error
from support.commands import run_command
from support.sparse import sparse
from support.spins import U
from support.states import generator

MODELS = Path(__file__).parents[2] / "models"
PAIR = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
FLAT = hp.PlanarPair(u1=(0.5, 0.2), u2=(-0.25, 0.1))
STILL = np.zeros(3)
GAP = np.r_[np.linspace(0, 4, 401), np.linspace(5, 9, 401)]
LOG = np.linspace(0, 10, 1001)


BESIDE_A_GAP = (
    ((0.01, 0.01, 0.05, 0.01, 0.05, 0.01, 0.005, 0.005, 0.005, 0.005, 0.01), 0.743),
    ((0.01, 0.01, 0.005, 0.01, 0.05, 0.005, 0.005, 0.005, 0.005, 0.005, 0.05), 0.832),
    ((0.005, 0.01, 0.05, 0.01, 0.05, 0.01, 0.005, 0.005, 0.005, 0.01, 0.01), 0.761),
)
"""Distances of instants, and where within the sixth of them a bend is."""


def tumble(t, frame):
    """S = Rz(1.7 t) Rx(2.3 t) and its angular velocity."""
    (cz, sz), (cx, sx), o = (np.cos(1.7 * t), np.sin(1.7 * t)), (np.cos(2.3 * t), np.sin(2.3 * t)), 0 * t
    S = np.stack([cz, -sz * cx, sz * sx, sz, cz * cx, -cz * sx, o, sx, cx], -1).reshape(-1, 3, 3)
    world = np.stack([2.3 * cz, 2.3 * sz, 1.7 + o], -1)
    body = np.stack([2.3 + o, 1.7 * sx, 1.7 * cx], -1)
    return S, world if frame == "world" else body


def tumbling(t, frame, **options):
    """What is estimated, and the largest angle to the truth, of a pair that tumbles."""
    S, omega = tumble(t, frame)
    motion = hp.integrate(PAIR, t, omega, 0.0, S1_0=S[0], frame=frame, outputs=(), **options)
    off = hp.rotation_log(np.swapaxes(S, -1, -2) @ motion.S1)
    return motion.error_estimate, float(np.linalg.norm(off, axis=-1).max())


def hinge(t, rate, angle):
    """What is estimated of psi, and how far it is off, from samples of its rate."""
    motion = hp.integrate(PAIR, t, STILL, rate(t), outputs=())
    return motion.psi_error_estimate, float(np.abs(motion.psi - (angle(t) - angle(t[:1]))).max())


def vibration(hertz, phase, size=5.0):
    """A rate and its integral."""
    w = 2 * np.pi * hertz
    return lambda t: size * np.cos(w * t + phase), lambda t: size * np.sin(w * t + phase) / w


def singular(order, at, size, w, phase):
    """A motion whose rate has a jump (order 0), a kink, a bend at an instant."""

    def rate(t):
        return np.where(t > at, np.maximum(0.0, t - at) ** order, 0.0) + size * np.cos(w * t + phase)

    def angle(t):
        return np.maximum(0.0, t - at) ** (order + 1) / (order + 1) + size * np.sin(w * t + phase) / w

    return rate, angle


def check(estimate, true, factor=10.0):
    """Never more than ten times too small; too large by the factor at most."""
    assert true <= 10 * estimate
    assert estimate <= factor * max(true, 20 * U)


def test_a_gap_is_seen_in_every_kind_of_signal():
    """A second without samples among those of cos 2t: psi of a pair, of a planar one, and omega in both frames."""
    rate, exact = np.cos(2 * GAP), np.sin(2 * GAP) / 2
    check(*hinge(GAP, lambda t: np.cos(2 * t), lambda t: np.sin(2 * t) / 2), factor=2)
    for frame in ("world", "body"):
        motion = hp.integrate(PAIR, GAP, np.stack([0 * rate, 0 * rate, rate], -1), 0.0, frame=frame, outputs=())
        check(motion.error_estimate, np.abs(motion.euler_angles(1)[:, 2] - exact).max(), factor=2)
        assert motion.psi_error_estimate == 0
    flat = hp.integrate(FLAT, GAP, rate, -rate, outputs=())
    check(flat.error_estimate, np.abs(flat.phi - exact).max(), factor=2)
    check(flat.psi_error_estimate, np.abs(flat.psi + exact).max(), factor=2)


@pytest.mark.slow
@pytest.mark.parametrize("frame", sparse(["world", "body"], 2))
@pytest.mark.parametrize("count", sparse([1, 5, 10, 30, 100], 3))
def test_a_log_without_some_of_its_lines(frame, count):
    for start in (0, 1, 20, 300, 995 - count, 1000 - count):
        estimate, true = tumbling(np.delete(LOG, slice(start, start + count)), frame)
        assert true / 1.1 <= estimate <= (3 if count == 100 else 1.3) * true


@pytest.mark.parametrize("frame", ["world", "body"])
@pytest.mark.parametrize("seed", sparse(range(4), 4))
def test_random_instants(frame, seed):
    draw = generator(140 + seed)
    check(*tumbling(np.sort(draw.uniform(0, 10, 1000)), frame))
    check(*tumbling(np.sort(draw.choice(LOG, 700, replace=False)), frame))
    check(*hinge(np.sort(draw.uniform(0, 10, 1000)), *vibration(0.3, seed)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hertz", "factor"),
    sparse([(1, 2), (2, 2), (5, 2), (10, 4), (15, 10), (20, 10), (25, 200), (35, 900), (40, 300), (45, 300)], 3),
)
def test_vibration_that_the_samples_hardly_follow(hertz, factor):
    """A hundred samples a second: with four or fewer a period the estimate fears jumps, and says too much."""
    for phase in (0.0, 0.5, 1.0, 2.0):
        for count in (101, 1001):
            t = np.arange(count) / 100
            check(*hinge(t, *vibration(hertz, phase)), factor=factor)


@pytest.mark.parametrize("order", [0, 1, 2], ids=["jump", "kink", "bend"])
@pytest.mark.parametrize("seed", sparse(range(6), 3))
def test_singular_motion(order, seed):
    """At a sample or not, alone or on top of a smooth motion, at even and at random instants."""
    draw = generator(150 + seed)
    count = int(draw.integers(60, 1200))
    size, w, phase = draw.choice([0, 0.3, 3]), draw.uniform(0.5, 8), draw.uniform(0, 6)
    for t in (np.arange(count) / 100, np.sort(draw.uniform(0, count / 100, count))):
        for at in (draw.uniform(t[4], t[-5]), t[draw.integers(4, count - 4)]):
            estimate, true = hinge(t, *singular(order, at, size, w, phase))
            assert true <= 10 * estimate


@pytest.mark.slow
def test_a_jump_is_seen_wherever_it_is():
    """In the first interval, in the last, and across the blocks that are worked through."""
    t = np.arange(1000) / 100
    for at in [*t[:12:4], 5.0, *t[-12::4]]:
        for inside in (0.0, 0.002, 0.007):
            estimate, true = hinge(t, *singular(0, at + inside, 0.1, 1.0, 0.0))
            assert true <= 10 * estimate
            assert estimate <= 0.01  # a jump of 1 may be off by half a step


def test_a_jump_stands_out_of_a_steep_slope():
    """Half a step of a jump, whatever the rate changes from sample to sample besides; a kink is no jump."""
    for slope in (0, 10, 1000):
        for order, most in ((0, 0.0051), (1, 2e-5)):
            rate, angle = singular(order, 5.0023, 0.0, 1.0, 0.0)
            found = hinge(
                LOG, lambda t, r=rate, k=slope: r(t) + k * t, lambda t, a=angle, k=slope: a(t) + k * t**2 / 2
            )
            check(*found, factor=5)
            assert found[0] <= most


def test_a_bend_beside_a_gap():
    """Where the differences to the left and to the right of a stencil cancel."""
    for steps, part in BESIDE_A_GAP:
        t = np.cumsum(np.r_[np.full(10, 0.01), steps, np.full(10, 0.01)])
        estimate, true = hinge(t, *singular(2, t[14] + part * (t[15] - t[14]), 0.0, 1.0, 0.0))
        assert true <= 10 * estimate


@pytest.mark.filterwarnings("ignore:.*is it in seconds:hingepair.MeasurementWarning")
@pytest.mark.parametrize("step", [10, 23.37, 49, 50.3])
def test_many_jumps(step):
    """At samples, where their errors add up, and between them, where they cancel: halfway between the two."""
    t = np.arange(3000.0)

    def angle(t):
        whole = np.floor(t / step)
        return whole * (whole - 1) / 2 * step + whole * (t - whole * step)

    check(*hinge(t, lambda t: np.floor(t / step), angle), factor=30)


@pytest.mark.slow
@pytest.mark.parametrize("count", sparse([8, 4, 5, 6, 7, 10, 15, 31], 8))
def test_few_samples(count):
    draw = generator(160 + count)
    for turns in (0.05, 0.2, 0.5):
        for phase in draw.uniform(0, 6, 30 if count == 4 else 10):
            t = np.linspace(0, 1, count)
            estimate, true = hinge(t, *vibration(turns, phase, 1.0))
            assert true <= 10 * max(estimate, U)
    if count > 6:
        check(*tumbling(np.linspace(0, 1, count), "world"))


@pytest.mark.slow
def test_too_few_samples_cannot_tell():
    for count in (2, 3):
        t = np.linspace(0, 1, count)
        motion = hp.integrate(PAIR, t, np.outer(t, STILL), t, outputs=())
        assert np.isnan([motion.error_estimate, motion.psi_error_estimate]).all()
        with pytest.raises(hp.ArgumentError, match="tol: expected at least the error that is left, nan rad"):
            hp.integrate(PAIR, t, STILL, t, tol=1.0, outputs=())


def test_polynomials_of_degree_5_are_not_off():
    """Nor constants: rounding is all that is estimated."""
    for t in (np.linspace(0, 2, 40), np.cumsum(generator(130).uniform(0.02, 0.1, 30))):
        estimate, _ = hinge(t, lambda t: 1 + t**5 - t**2, lambda t: t)
        assert estimate <= 1000 * U
        assert hinge(t, np.ones_like, lambda t: t)[0] <= 20 * U


@pytest.mark.slow
def test_tolerance_refuses_a_gap_and_keeps_to_it_elsewhere():
    """Steps are made shorter across a gap; what interpolation misses there stays."""
    t = np.delete(LOG, slice(300, 400))
    for frame in ("world", "body"):
        plain, off = tumbling(t, frame)
        assert off > 1e-2
        check(plain, off, factor=2)
        estimate, true = tumbling(t, frame, tol=5e-3)
        check(estimate, true, factor=7)
        assert true <= 5e-3
        with pytest.raises(hp.ArgumentError, match=r"tol: expected at least the error that is left, 0\.00\d+ rad"):
            tumbling(t, frame, tol=1e-4)
    for pair, omega in ((PAIR, STILL), (FLAT, 0.0)):
        with pytest.raises(hp.ArgumentError, match="tol: expected at least the error that is left"):
            hp.integrate(pair, GAP, omega, np.cos(2 * GAP), tol=1e-4, outputs=())
        hp.integrate(pair, GAP, omega, np.cos(2 * GAP), tol=1e-2, outputs=())


@pytest.mark.slow
@pytest.mark.parametrize("frame", sparse(["world", "body"], 2))
def test_blocks_do_not_show(frame, monkeypatch):
    """The same estimate, whatever the length of the blocks that samples are worked through in."""
    t = np.delete(LOG[:300], [100, 101, 102, 250])
    S, omega = tumble(t, frame)
    whole, blocks = [], []
    for found, length in ((whole, 10_000), (blocks, 40)):
        monkeypatch.setattr(interpolation_error, "_BLOCK", length)
        for jump in (np.inf, *(1.58 + np.arange(8) / 100)):
            given = omega + np.outer(t > jump, [0, 0.1, 0])
            motion = hp.integrate(PAIR, t, given, given[:, 1], S1_0=S[0], frame=frame, outputs=(), backend="numpy")
            found.append((motion.error_estimate, motion.psi_error_estimate))
    np.testing.assert_allclose(blocks, whole, rtol=1e-6)


@pytest.mark.slow
def test_run_shows_what_a_gap_in_a_log_costs(tmp_path):
    """The gyroscope's log without thirty lines, against the attitude and psi beside it."""
    lines = (MODELS / "gyro_log.csv").read_text().splitlines(keepends=True)
    truth = np.loadtxt(MODELS / "gyro_log_truth.csv", delimiter=",", skiprows=1)
    scene = tmp_path / "gyro_log.toml"
    scene.write_text((MODELS / "gyro_log.toml").read_text())
    for start in (200, len(lines) - 40):
        (tmp_path / "gyro_log.csv").write_text("".join(lines[:start] + lines[start + 30 :]))
        motion = hp.load_scene(scene).motion
        kept = np.delete(truth, slice(start - 1, start + 29), axis=0)
        S = hp.BodyMotion.from_quaternion_xyzw(R=np.zeros(3), quat_xyzw=kept[:, 1:5]).S
        off = np.linalg.norm(hp.rotation_log(np.swapaxes(S, -1, -2) @ motion.source.body1.S), axis=-1).max()
        check(motion.error_estimate, max(off, np.abs(motion.source.hinge[0] - kept[:, 5]).max()), factor=2)
        assert off > 1e-8
    assert f"error about {motion.error_estimate:.1g} rad" in run_command("run", scene).stdout
