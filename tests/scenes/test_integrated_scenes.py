"""Scenes whose attitude is integrated from rates (E12): expressions and logs, and what is wrong with them, named."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp

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
