"""Scenes whose attitude is integrated from rates (E12): expressions and logs, and what is wrong with them, named."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import mpmath
import numpy as np
import pytest
import sympy

import hingepair as hp
from hingepair.symbolic.exact import TIME as INSTANT
from hingepair.symbolic.exact import to_sympy
from hingepair.symbolic.expressions import parse_expression
from support.spins import U

MODELS = Path(__file__).parents[2] / "models"

PAIR = """
[pair]
u1 = [0.5, 0.2, 0.1]
u2 = [-0.25, 0.1, 0.3]
n = [1, 0, 0]
"""
TIME = """
[time]
start = 0
stop = 2
samples = 41
"""
REFERENCE = """
[motion]
omega1 = ["3 + 5*sin(t)", "cos(3*t) - 5/2*sin(2*t) - 5/2*sin(4*t)", "sin(3*t) + 5/2*cos(4*t) + 5/2*cos(2*t)"]
psi_dot = 10
x = "3*t"
y = "3*t"
z = "3*t"
"""
GOOD = PAIR + REFERENCE + TIME
FLAT = """
planar = true
[pair]
u1 = [0.5, 0.2]
u2 = [-0.25, 0.1]
[motion]
omega1 = "cos(t)"
psi_dot = "t*sin(2*t)"
x = "0.5*t"
phi_0 = 0.3
psi_0 = -1
"""
LOG = "t,omega1_x,omega1_y,omega1_z,psid\n" + "".join(f"{k / 10},0,0,{1 + k / 10},2\n" for k in range(12))
LOGGED = PAIR + '[motion]\nfile = "log.csv"\nintegrate = true\nframe = "world"\n'


def with_columns(names, cells):
    head, *rows = LOG.splitlines()
    return "\n".join([f"{head},{names}", *(f"{row},{cells}" for row in rows)])


def scene_of(folder, text, log=None):
    (folder / "my.toml").write_text(text)
    if log is not None:
        (folder / "log.csv").write_text(log)
    return hp.load_scene(folder / "my.toml")


@pytest.mark.slow
def test_rates_give_the_motion_that_has_them(tmp_path):
    """The reference example by its angular velocity, everything about body 2 to the tolerance of the scene."""
    result = scene_of(tmp_path, GOOD).evaluate()
    t = result.t
    pair = hp.HingePair((0.5, 0.2, 0.1), (-0.25, 0.1, 0.3), (1, 0, 0))
    expected = pair.forward_kinematics(
        (3 * t, 3 * t, 3 * t, 3 * t, t, 5 * t, 10 * t), (3.0, 3.0, 3.0, 3.0, 1.0, 5.0, 10.0), (0.0,) * 7
    )
    assert result.state.outputs == expected.outputs
    for name, array in expected.arrays().items():
        size = 1 + np.abs(array).max()
        np.testing.assert_allclose(getattr(result, name), array, rtol=0, atol=3e-12 * size)


@pytest.mark.slow
def test_a_scene_is_what_integrate_makes_of_it():
    """frame, S1_0, psi_0 and accelerations of models/spinning_satellite.toml, by hand."""
    scene = hp.load_scene(MODELS / "spinning_satellite.toml")

    def omega(t):
        return np.stack([0.3 * np.cos(1.1 * t), 0.3 * np.sin(1.1 * t), 2.5 * (1 - np.exp(-t / 8))], axis=-1)

    def alpha(t):
        return np.stack([-0.33 * np.sin(1.1 * t), 0.33 * np.cos(1.1 * t), 2.5 / 8 * np.exp(-t / 8)], axis=-1)

    t = scene.times()
    motion = hp.integrate(
        scene.pair, t, omega, lambda t: 0.3 * np.sin(0.4 * t) + 0.05 * t * np.exp(-t), psi_0=-0.4, frame="body",
        S1_0=[[0, -1, 0], [1, 0, 0], [0, 0, 1]], alpha1=alpha,
        psidd=lambda t: 0.12 * np.cos(0.4 * t) + 0.05 * (1 - t) * np.exp(-t),
        R1=(np.stack([0.01 * t, 0 * t, 0 * t], -1), np.array([0.01, 0, 0]), np.zeros(3)),
    )  # fmt: skip
    for name, array in scene.evaluate().state.arrays().items():
        np.testing.assert_allclose(array, getattr(motion, name), rtol=0, atol=1e-13 * (1 + np.abs(array).max()))


def test_planar_rates_are_two_integrals(tmp_path):
    result = scene_of(tmp_path, FLAT + TIME).evaluate()
    t = result.t
    phi, psi = 0.3 + np.sin(t), -1 + np.sin(2 * t) / 4 - t * np.cos(2 * t) / 2
    psid = t * np.sin(2 * t)
    expected = hp.PlanarPair((0.5, 0.2), (-0.25, 0.1)).forward_kinematics(
        (0.5 * t, 0.0, phi, psi),
        (0.5, 0.0, np.cos(t), psid),
        (0.0, 0.0, -np.sin(t), np.sin(2 * t) + 2 * t * np.cos(2 * t)),
    )
    assert result.state.outputs == expected.outputs
    for name, array in expected.arrays().items():
        np.testing.assert_allclose(getattr(result, name), array, rtol=0, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("rate", ["t**2 - 3", "2*cos(3*t) + 1", "exp(-t/4) - sin(0.5 - 2*t)", "7", "pi*t**5/3"])
def test_sums_are_as_good_as_antiderivatives(rate, tmp_path):
    scene = scene_of(tmp_path, GOOD.replace("psi_dot = 10", f'psi_dot = "{rate}"\npsi_0 = 0.5'))
    t = INSTANT
    whole = sympy.integrate(to_sympy("rate", parse_expression("rate", rate)), t)
    for instant, found in zip(scene.times()[::10], scene.motion.source.psi[::10], strict=True):
        exact = 0.5 + float((whole.subs(t, instant) - whole.subs(t, 0)).evalf(30))
        assert abs(found - exact) <= 32 * U * (1 + abs(exact))


def slow_sine(t):
    """The integral of 0.3 sin(1e-8 t) from 0."""
    return mpmath.mpf(3) * 10**7 * (1 - mpmath.cos(t / mpmath.mpf(10) ** 8))


@pytest.mark.parametrize(
    ("rate", "whole", "start"), [("t", lambda t: t * t / 2, 1.7e9), ("0.3*sin(1e-8*t)", slow_sine, 0)]
)
@pytest.mark.parametrize("planar", [False, True])
def test_the_estimate_holds_far_from_zero_and_for_slow_rates(tmp_path, rate, whole, start, planar):
    """Where an antiderivative minus its first value has no digits left."""
    text = (FLAT.replace("psi_0 = -1\n", "").replace('"t*sin(2*t)"', "10") if planar else PAIR + REFERENCE) + TIME
    text = text.replace("psi_dot = 10", f'psi_dot = "{rate}"').replace("start = 0", f"start = {start!r}")
    scene = scene_of(tmp_path, text.replace("stop = 2", f"stop = {start + 10!r}"))
    with mpmath.workdps(50):
        first, *others = (whole(mpmath.mpf(float(t))) for t in scene.times())
        exact = [0.0, *(float(value - first) for value in others)]
    error = np.abs(scene.motion.source.psi - exact).max()
    assert error <= scene.motion.error_estimate
    assert error <= 4 * U * np.abs(exact).max()


def test_rates_without_an_antiderivative_are_summed(tmp_path):
    scene = scene_of(tmp_path, GOOD.replace("psi_dot = 10", 'psi_dot = "2*t*cos(t**2)"'))
    np.testing.assert_allclose(scene.motion.source.psi, np.sin(scene.times() ** 2), rtol=0, atol=1e-12)


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
    np.testing.assert_array_equal(scene.times(), truth[:, 0])
    S = hp.BodyMotion.from_quaternion_xyzw(R=np.zeros(3), quat_xyzw=truth[:, 1:5]).S
    off = np.linalg.norm(hp.rotation_log(np.swapaxes(S, -1, -2) @ scene.motion.source.body1.S), axis=-1).max()
    assert off < 1e-10
    assert off / 10 <= scene.motion.error_estimate <= 50 * off
    np.testing.assert_allclose(scene.motion.source.psi, truth[:, 5], rtol=0, atol=1e-10)


@pytest.mark.slow
def test_the_level_follows_the_log(tmp_path):
    plain = scene_of(tmp_path, LOGGED, LOG)
    assert plain.evaluate().state.outputs == ("R2", "S2", "d", "v2", "omega2")
    turned = 1.1 + 1.1**2 / 2
    np.testing.assert_allclose(plain.evaluate(("S1",)).S1[-1], hp.rodrigues((0, 0, 1), turned), rtol=0, atol=20 * U)
    head, *rows = LOG.splitlines()
    moving = "\n".join(
        [
            head.replace("t,", "t,x,y,z,"),
            *(f"{k / 10},{k / 10},0,1{row[row.index(',') :]}" for k, row in enumerate(rows)),
        ]
    )
    with pytest.raises(hp.SceneError, match="v1_x: expected a column, since the log has x"):
        scene_of(tmp_path, LOGGED, moving)
    head, *rows = moving.splitlines()
    head = head.replace(",omega1_x", ",v1_x,v1_y,v1_z,omega1_x")
    velocities = "\n".join([head, *(_with_velocity(row, k / 5) for k, row in enumerate(rows))])
    again = scene_of(tmp_path, LOGGED, velocities).evaluate(("v1",))
    np.testing.assert_array_equal(again.v1[:, 0], np.arange(12) / 5)


def _with_velocity(row, speed):
    cells = row.split(",")
    return ",".join([*cells[:4], str(speed), "0", "0", *cells[4:]])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "psi_dot = 10\n",
            "",
            "motion.psi_dot: expected a finite number, an .*, got nothing",
        ),
        ('omega1 = ["3 + 5*sin(t)",', "omega1 = [", "motion.omega1: expected three numbers or expressions in t"),
        ('"3 + 5*sin(t)"', '"3 + sine(t)"', r"motion.omega1\[0\]: unknown name|motion.omega1\[0\]: .*sine"),
        ('"3 + 5*sin(t)"', '"log(t - 1)"', r"motion.omega1: expected finite numbers, got .*nan.* at t = 0\."),
        ("psi_dot = 10\n", 'psi_dot = "sqrt(1 - t)"\n', "motion.psi_dot: expected finite numbers, got nan at t = 1"),
        ("psi_dot = 10\n", 'psi_dot = 10\nframe = "hinge"\n', "motion.frame: expected one of world, body"),
        ("psi_dot = 10\n", 'psi_dot = 10\nmethod = "euler"\n', "motion.method: expected one of magnus6"),
        ("psi_dot = 10\n", "psi_dot = 10\ntol = 1e-17\n", "left, .* rad \\(omega1 leaves .*, psi_dot leaves"),
        ("psi_dot = 10\n", "psi_dot = 10\ntol = 0\n", "motion.tol: expected a positive number"),
        ("stop = 2", "stop = 1e300", "motion.omega1"),
        ('"3 + 5*sin(t)"', "1e200", "motion.omega1: expected a rate that turns by a finite angle in each step"),
        ("psi_dot = 10\n", "psi_dot = 10\nphi_x = 1\n", "motion.phi_x: expected one of"),
        ("psi_dot = 10\n", "psi_dot = 10\nS1_0 = 3\n", "motion.S1_0: expected 3 lists of 3 finite numbers"),
        ("psi_dot = 10\n", "psi_dot = 10\nS1_0 = [[2,0,0],[0,1,0],[0,0,1]]\n", "motion.S1_0: expected rotations"),
        ("psi_dot = 10\n", 'psi_dot = 10\npsi_0 = "t"\n', "motion.psi_0: expected a number: an expression without t"),
    ],
)
def test_what_is_wrong_with_expressions_is_named(tmp_path, old, new, message):
    assert old in GOOD
    with pytest.raises(hp.SceneError, match=message):
        scene_of(tmp_path, GOOD.replace(old, new))


@pytest.mark.parametrize(
    ("extra", "log", "message"),
    [
        ('integrate = "yes"', LOG, "motion.integrate: expected true or false"),
        ("tol = 1e-9", LOG, "motion.tol: expected one of"),
        ("integrate = false\npsi_0 = 1", LOG, "motion.psi_0: expected no such key without integrate = true"),
        ("integrate = false", LOG, "phi_x: expected .* or motion.integrate = true"),
        ("", None, r"my.toml: motion.file: expected .*, got no such file: .*log\.csv"),
        ("", LOG.replace(",psid", ",psidd"), "psid: expected a column, or psid = "),
        ("", LOG.replace("omega1_z", "alpha1_z"), "log.csv: omega1_z: expected a column, since the log has omega1_x"),
        ("", LOG.replace("psid", "psi"), "log.csv: psi: expected columns of rates and of R1"),
        ("", LOG.replace("t,", "v1_x,", 1), "log.csv: t: expected a column"),
        ("", with_columns("v1_x,v1_y,v1_z", "1,0,0"), "log.csv: x: expected a column"),
        ("", LOG.replace("0.3,0,", "0.3,nan,"), "log.csv: omega1_x: expected finite numbers, to be integrated"),
        ("", LOG.replace("0.3,", "0.1,"), "log.csv: t: expected instants that increase"),
    ],
)
def test_what_is_wrong_with_a_log_is_named(tmp_path, extra, log, message):
    text = LOGGED if "integrate" not in extra else LOGGED.replace("integrate = true\n", "")
    with pytest.raises(hp.SceneError, match=message):
        scene_of(tmp_path, text + extra + "\n", log)


def test_start_attitudes_are_said_by_axis_and_angle(tmp_path):
    text = GOOD.replace("psi_dot = 10\n", "psi_dot = 10\nS1_0 = { axis = [0, 0, 1], deg = 90 }\npsi_0 = 'pi/4'\n")
    scene = scene_of(tmp_path, text)
    np.testing.assert_allclose(scene.evaluate(("S1",)).S1[0], [[0, -1, 0], [1, 0, 0], [0, 0, 1]], rtol=0, atol=4 * U)
    assert scene.motion.source.psi[0] == np.pi / 4


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rate", "whole"),
    [
        ('"abs(t - 0.7)"', lambda t: (0.49 + (t - 0.7) * abs(t - 0.7)) / 2),
        ('"where(t < 0.7, 1, -2)"', lambda t: np.minimum(t, 0.7) - 2 * np.maximum(t - 0.7, 0)),
        (
            "{ t = [0.7, 1.4], value = [0, 1] }",
            lambda t: np.clip(t - 0.7, 0, 0.7) ** 2 / 1.4 + np.maximum(t - 1.4, 0),
        ),
    ],
    ids=["kink", "jump", "way points"],
)
def test_rates_with_kinks_and_jumps_between_the_instants(tmp_path, rate, whole):
    scene = scene_of(
        tmp_path, (GOOD.replace("psi_dot = 10", f"psi_dot = {rate}")).replace("samples = 41", "samples = 12")
    )
    error = np.abs(scene.motion.source.psi - whole(scene.times())).max()
    assert error <= 2 * scene.motion.error_estimate
    assert error <= 1e-11
    assert any("kinks" in note for note in scene.notes())
