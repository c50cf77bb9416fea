"""How many steps `integrate` makes of a callable, what it overlooks, and what rounding leaves of fast motion."""

from __future__ import annotations

import contextlib
from fractions import Fraction

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS
from hingepair.engine.backend import execution_of
from hingepair.motion import steps
from hingepair.motion.magnus import AttitudeIntegral, Steps, subdivide
from hingepair.motion.signals import CallableSignal
from support.sparse import sparse
from support.spins import U
from support.states import generator

PAIR = hp.HingePair(u1=(0.3, -0.2, 0.5), u2=(0.1, 0.7, -0.4), n=(1, 2, -2))
SCENE = """
[pair]
u1 = [0.3, -0.2, 0.5]
u2 = [0.1, 0.7, -0.4]
n = [1, 2, -2]
[motion]
omega1 = ["1000*t", 0, 0]
psi_dot = "sqrt(t)"
{tol}
[time]
start = 0
stop = 10
samples = 3
"""


def about_x(rate):
    return lambda t: np.stack([rate(t), 0 * t, 0 * t], axis=-1)


def true_error(motion, whole, instants=600):
    """How far the attitude is off [rad] at the worst of some instants; whole(t) is the angle about x from t[0]."""
    worst, looked = 0.0, np.unique(np.linspace(0, len(motion.t) - 1, instants).astype(int))
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


@pytest.mark.parametrize("count", sparse([600, 20_000], 2))
@pytest.mark.parametrize("late", [0.0, 1e4])
def test_error_estimate_knows_the_rounding_of_instants(late, count):
    """Nodes are rounded in proportion to t, the more the later they are, on probes too."""
    t = late + np.cumsum(generator(160).uniform(0.3, 1.5, count) * (2 / count))
    rates = about_x(lambda t: 50 * np.cos(10 * (t - late))), lambda t: 50 * np.cos(10 * (t - late))
    motion = hp.integrate(PAIR, t, *rates, outputs=())

    def exact(s):
        return 5 * (mpmath.sin(10 * (s - late)) - mpmath.sin(10 * (t[0] - late)))

    true = true_error(motion, exact)
    assert true / 3 <= motion.error_estimate <= 10 * max(true, 20 * U)
    with mpmath.workdps(DIGITS):
        off = max(abs(float(motion.psi[i] - exact(mpmath.mpf(t[i])))) for i in range(0, count, count // 300))
    assert off / 3 <= motion.psi_error_estimate <= 10 * max(off, 20 * U)


@pytest.mark.slow
def test_probes_do_not_enlarge_rounding():
    """One interval in fifty is measured; what rounding does to these is not fifty times what it does to all."""
    t = np.linspace(0, 1e4, 100_001)
    motion = hp.integrate(PAIR, t, about_x(lambda t: 10 + np.sin(t)), 0.0, outputs=())
    true = true_error(motion, lambda t: 10 * t + 1 - mpmath.cos(t))
    assert true / 3 <= motion.error_estimate <= 10 * true


def test_steps_do_not_chase_rounding():
    """What is left of the errors of intervals is rounding, which more steps do not mend."""
    omega = CallableSignal("omega1", about_x(np.exp), (3,))
    turning = AttitudeIntegral("omega1", omega, execution_of("numpy", 1), False)
    assert steps.select_steps((turning,), np.linspace(0, 10, 3), 1e-14).steps.step_count <= 3000
    smooth = hp.integrate(PAIR, [0, 1], about_x(np.cos), np.cos, tol=1e-2, outputs=())
    assert smooth.steps == 16


def test_noise_is_not_divided_with_a_jump():
    """Steps beside the jump alone are divided until its error is no larger than what noise leaves elsewhere."""

    def rate(t):
        return np.where(t > 0.30012, 1.0, 0.0) + 1e-11 * np.sin(1e13 * t)

    motion = hp.integrate(PAIR, np.linspace(0, 1, 2001), (0, 0, 0), rate, tol=1e-12, outputs=())
    assert motion.steps <= 3000


def test_no_attitude_is_off_by_more_than_half_a_turn():
    assert hp.integrate(PAIR, [0, 1e9], (1e9, 0, 0), 0.0, outputs=()).error_estimate == np.pi


def test_lengths_of_steps_add_up():
    """Exactly: no length is rounded alike in all steps of an interval."""
    t, counts = np.array([0.1, 1 / 3, 10.7, 1e4]), np.array([7, 1, 1000])
    parts = subdivide(t[:-1], t[1:], counts)
    assert [parts.start[i] for i in (0, 7, 8)] == t[:-1].tolist()
    assert parts.part.tolist() == [*range(7), 0, *range(1000)]
    steps = Steps(t).refine(parts.start)
    assert (steps.step_count, steps.instant_indices.tolist()) == (1008, [0, 7, 8, 1008])
    _, (h, low) = steps.starts_and_lengths(0, 1008)
    assert sum(Fraction(float(x)) for x in (*h, *low)) == Fraction(1e4) - Fraction(0.1)
    assert (h > 0).all()


@pytest.mark.parametrize("at", generator(161).uniform(0.5, 9.5, 4).tolist())
def test_a_short_pulse_is_seen(at):
    """Of a thousandth of the time; in two instants, and without a tolerance the estimate says it is not followed."""
    rate = about_x(lambda t: 100 * np.exp(-((t - at) ** 2) / 1e-4))
    whole = np.sqrt(np.pi)
    blind = hp.integrate(PAIR, [0, 10], rate, 0.0, outputs=())
    assert whole / 2 <= blind.error_estimate <= 2 * whole
    motion = hp.integrate(PAIR, [0, 10], rate, lambda t: rate(t)[:, 0], tol=1e-6, outputs=())
    assert abs(motion.euler_angles(1)[-1, 0] - whole) <= 3 * motion.error_estimate <= 3e-6
    assert abs(motion.psi[-1] - whole) <= 3 * motion.psi_error_estimate <= 3e-6


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
            turned = np.abs(motion.euler_angles(1)[:, 0] - angle(t)).max()
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


def uneven_instants(kind, random):
    """More instants than are looked at, over 20 s, whose distances differ by orders of magnitude."""
    steps = {
        "any": random.exponential(size=6000),
        "all sizes": 10 ** random.uniform(-6, 0, 6000),
        "few long ones": np.where(random.uniform(size=6000) < 0.02, 0.3, 1e-3),
        "late ones": np.concatenate([np.full(6000, 1e-4), random.uniform(0.01, 0.2, 200)]),
        "growing": np.linspace(1e-4, 1, 6000) ** 2,
    }[kind]
    t = np.concatenate([[0], np.cumsum(steps)])
    return 20 * t / t[-1]


@pytest.mark.slow
@pytest.mark.parametrize("tol", sparse([1e-6, None, 1e-9], 3))
@pytest.mark.parametrize("kind", ["any", "all sizes", "few long ones", "late ones", "growing"])
def test_uneven_intervals(kind, tol):
    """The step that a tolerance asks for is a length, whatever the length of the intervals."""
    random = generator(165)
    for speed in 10 ** random.uniform(0, 1.5, 3):
        t = uneven_instants(kind, random)
        rate = lambda t, w=speed: 2 * np.cos(w * t) + 0.5  # noqa: E731
        motion = hp.integrate(PAIR, t, about_x(rate), rate, tol=tol, outputs=())
        off = np.abs(motion.psi - (2 * np.sin(speed * t) / speed + t / 2)).max()
        assert off <= (tol or 10)
        assert off / 10 <= motion.psi_error_estimate <= 10 * max(off, 50 * U)
        assert off / 10 <= motion.error_estimate <= 10 * max(off, 100 * U)


@pytest.mark.slow
@pytest.mark.parametrize("count", [4, 5, 6])
def test_few_samples_of_a_constant_rate(count):
    t = np.arange(float(count))
    motion = hp.integrate(PAIR, t, about_x(lambda t: 0.5 + 0 * t)(t), np.full(count, 0.5), outputs=())
    np.testing.assert_allclose(motion.psi, 0.5 * t, rtol=0, atol=8 * U)
    assert motion.error_estimate < 50 * U
    assert motion.psi_error_estimate < 50 * U


@pytest.mark.parametrize("jump", [1.6851933, 2.8944841, 7.4101957])
def test_a_jump_is_measured_in_one_of_many_steps(jump):
    t = np.linspace(0, 10, 20_001)
    rate = lambda t: np.where(t < jump, 0.3, 5.3)  # noqa: E731
    motion = hp.integrate(PAIR, t, about_x(rate), rate, outputs=())
    off = np.abs(motion.psi - (0.3 * t + 5 * np.maximum(t - jump, 0))).max()
    assert off > 1e-5
    assert off / 10 <= motion.psi_error_estimate <= 10 * off
    assert off / 10 <= motion.error_estimate <= 10 * off


def test_intervals_are_divided_like_their_neighbours():
    t = np.linspace(0, 1, 6144)
    motion = hp.integrate(PAIR, t, (0, 0, 0), lambda t: 1e4 * np.cos(1e4 * t), tol=1e-6, outputs=())
    assert np.abs(motion.psi - np.sin(1e4 * t)).max() <= 1e-6
    assert 2 * len(t) - 2 <= motion.steps <= 10 * len(t)


def random_rate(random, kinds=9, largest=7):
    """A rate of any size, smooth or not, and not always finite; of the first 7 kinds it is."""
    size, speed = 10 ** random.uniform(-3, largest), 10 ** random.uniform(-2, 3)
    rates = (
        lambda t: size * np.sin(speed * t), lambda t: size * np.sqrt(np.abs(t)), lambda t: size * t**3,
        lambda t: size * np.exp(-((speed * t) ** 2)), lambda t: size / (t + 0.37), lambda t: size * (t > 0.5),
        lambda t: size + 0 * t, lambda t: size * np.exp(np.minimum(speed * t, 400)), lambda t: 1e200 * t,
    )  # fmt: skip
    return rates[random.integers(kinds)]


@pytest.mark.parametrize("seed", sparse(range(20), 5))
@pytest.mark.parametrize("wild", [False, True], ids=["tame", "wild"])
def test_steps_are_counted_for_any_rate(wild, seed, monkeypatch):
    """Wild rates over spans up to 1e6 may be refused, in our words; of tame ones the steps are within the bound."""
    monkeypatch.setattr(steps, "MAX_STEPS", 5000)
    random = generator(162, seed, int(wild))
    rates = [random_rate(random) if wild else random_rate(random, 7, 0) for _ in range(4)]
    start, span = random.choice([0, -1, 1000]) if wild else 0.0, 10 ** random.uniform(-3, 6 if wild else 0)
    t = start + np.linspace(0, span, random.integers(2, 101))
    with contextlib.suppress(hp.ArgumentError) if wild else contextlib.nullcontext(), np.errstate(all="ignore"):
        motion = hp.integrate(
            PAIR, t, lambda s: np.stack([r(s) for r in rates[:3]], -1), rates[3], tol=1e-3, outputs=()
        )
        assert len(t) - 1 <= motion.steps <= 5000 + len(t)
        assert max(motion.error_estimate, motion.psi_error_estimate) <= 1e-3


def growing(t):
    return np.sin(t), 0.5 * np.cos(2 * t), 1 + 0.2 * t


def steady(t):
    return np.sin(t), np.cos(t), 1 + 0 * t


@pytest.mark.slow
@pytest.mark.parametrize(
    ("omega", "psid", "stop", "samples"),
    sparse(
        [
            (growing, lambda t: 2 * np.cos(3 * t), 100, 2),
            (growing, lambda t: 2 * np.cos(3 * t), 300, 11),
            (steady, lambda t: np.sin(3 * t), 1000, 11),
        ],
        3,
    ),
)
def test_long_times_need_only_many_steps(omega, psid, stop, samples):
    """The first steps turn by tens of radians, which says nothing about how many there must be."""
    t = np.linspace(0, stop, samples)
    motion = hp.integrate(PAIR, t, lambda s: np.stack(omega(s), axis=-1), psid, tol=1e-9, outputs=())
    assert motion.steps <= 300 * stop
    fine = np.linspace(0, stop, 100 * stop + 1)
    other = hp.integrate(PAIR, fine, lambda s: np.stack(omega(s), axis=-1), psid, outputs=())
    same = other.quat_wxyz[:: 100 * stop // (samples - 1)]
    apart = np.minimum(*(np.abs(motion.quat_wxyz - sign * same).max(axis=1) for sign in (1, -1)))
    assert apart.max() <= 1e-9 + other.error_estimate


def test_a_tolerance_out_of_reach_is_refused_only_where_it_was_asked(tmp_path, monkeypatch):
    """And then says that psi_dot, which is too fast for so few steps, is what leaves so much."""
    monkeypatch.setattr(steps, "MAX_STEPS", 2000)
    fast = SCENE.replace("sqrt(t)", "cos(400*t)")
    (tmp_path / "my.toml").write_text(fast.format(tol=""))
    scene = hp.load_scene(tmp_path / "my.toml")
    off = np.abs(scene.motion.source.hinge[0] - np.sin(400 * scene.motion.t) / 400).max()
    assert 1e-10 <= off / 3 <= scene.motion.error_estimate <= 10 * off
    assert "error about" in scene.motion.description
    (tmp_path / "my.toml").write_text(fast.format(tol="tol = 1e-11"))
    left = r"motion.tol: expected .* left, (\S+) rad \(omega1 leaves .*e-1\d, psi_dot leaves \1\), got 1e-11"
    with pytest.raises(hp.SceneError, match=left):
        hp.load_scene(tmp_path / "my.toml")


@pytest.mark.slow
def test_a_corner_costs_some_sixty_steps(tmp_path, monkeypatch):
    """Jumps, kinks and a root, to the last digits of what a scene aims at, though steps there are ever shorter."""
    monkeypatch.setattr(steps, "MAX_STEPS", 20_000)
    rates = {
        "step(t - 1.234)": lambda t: max(0, t - 1.234),
        "abs(t - 1.234)": lambda t: ((t - 1.234) * abs(t - 1.234) + 1.234**2) / 2,
        "sqrt(t)": lambda t: t**1.5 / 1.5,
    }
    for rate, angle in rates.items():
        (tmp_path / "my.toml").write_text(
            SCENE.replace("1000*t", "t").replace("sqrt(t)", rate).format(tol="tol = 1e-12")
        )
        motion = hp.load_scene(tmp_path / "my.toml").motion
        np.testing.assert_allclose(motion.source.hinge[0], [angle(t) for t in motion.t], rtol=0, atol=1e-12)
        assert motion.error_estimate <= 1e-12
    motion = hp.integrate(PAIR, [0, 10], about_x(np.cos), lambda t: 1.0 * (t > 0.3), tol=1e-5)
    assert abs(motion.psi[-1] - 9.7) <= 1e-5
    assert motion.steps <= 20_000
    assert len(motion.t) == len(motion.psi) == len(motion.S1) == 2


def test_samples_beside_a_callable_that_jumps():
    """Halved intervals are parts of those between samples, whose errors keep their places."""
    t = np.linspace(0, 3, 61)
    for at in (0.123, 2.91):
        rates = about_x(lambda s: np.cos(2 * s))(t)
        jump = hp.integrate(PAIR, t, rates, lambda s, at=at: 1.0 * (s > at), tol=1e-6, outputs=())
        plain = hp.integrate(PAIR, t, rates, 0.0, outputs=())
        off = np.abs(jump.euler_angles(1)[:, 0] - np.sin(2 * t) / 2).max()
        assert jump.steps > len(t) + 8
        assert off <= jump.error_estimate <= 200 * off
        assert jump.error_estimate == pytest.approx(plain.error_estimate, rel=0.1)
        np.testing.assert_allclose(jump.psi, np.maximum(0, t - at), rtol=0, atol=1e-6)


@pytest.mark.slow
def test_a_pole_is_reported(tmp_path, monkeypatch):
    """No number of steps follows the attitude through it; that is said."""
    monkeypatch.setattr(steps, "MAX_STEPS", 2000)
    text = SCENE.replace('"1000*t", 0, 0', '"1e9*t", "cos(t)", 1').replace("sqrt(t)", "1/(t - 0.987)")
    (tmp_path / "my.toml").write_text(text.format(tol=""))
    assert hp.load_scene(tmp_path / "my.toml").motion.error_estimate >= 1
    (tmp_path / "my.toml").write_text(text.format(tol="tol = 1e-3"))
    with pytest.raises(hp.SceneError, match=r"motion.tol: .* left, .* rad \(omega1 leaves .*, psi_dot leaves "):
        hp.load_scene(tmp_path / "my.toml")
