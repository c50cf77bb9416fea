"""Scenes with loops and struts: the same as the library says by hand."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.commands import run_command
from support.near import U, assert_near
from support.scenes import scene_of

HATCH = """
title = "A hatch with a gas spring, held by hand"
[mechanism.frames.foot]
link = "base"
R = [0.1, 0, -0.25]
[mechanism.frames.eye]
link = "lid"
R = [0.3, 0, 0]
[[joint]]
name = "lid"
u1 = [0, 0, 0]
u2 = [0, 0, 0]
n = [0, 1, 0]
body2 = { mass = 12, centre_of_mass = [0.4, 0, 0], inertia = [0.1, 0.8, 0.9] }
[[strut]]
name = "gas"
frame1 = "foot"
frame2 = "eye"
gas = { F1 = 150, F2 = 200, stroke = 0.25 }
free_length = 0.55
[motion]
lid = "-1.2*t"
[time]
start = 0
stop = 1
samples = 11
"""
FOUR_BAR = """
[mechanism]
coordinates = ["crank"]
at = { crank = 0.3, coupler = 0.8, rocker = 1.9 }
frames = { a = { link = "coupler", R = [0.9, 0, 0] }, b = { link = "rocker", R = [0.7, 0, 0] } }
[[loop]]
frame1 = "a"
frame2 = "b"
[dynamics]
crank.q_0 = 0.3
crank.qd_0 = 2
crank.tau = "0.1*sin(t)"
[time]
start = 0
stop = 1
samples = 11
"""
BARS = (("crank", "base", (0, 0, 0), 0.3), ("coupler", "crank", (0.3, 0, 0), 0.9), ("rocker", "base", (1, 0, 0), 0.7))
for name, parent, u1, length in BARS:
    FOUR_BAR += f'[[joint]]\nname = "{name}"\nu1 = {[*u1]}\nu2 = [0, 0, 0]\nn = [0, 0, 1]\n'
    FOUR_BAR += f'parent = "{parent}"\n' * (parent != "base")
    FOUR_BAR += (
        f"body2 = {{ mass = {2 * length}, centre_of_mass = [{length / 2}, 0, 0], inertia = [0.1, 0.1, 0.1] }}\n"
    )


def test_a_hatch_with_a_strut_is_that_of_the_library(tmp_path):
    scene = scene_of(tmp_path, HATCH)
    lid = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 1, 0), name="lid", body2=hp.Body(12, (0.4, 0, 0), (0.1, 0.8, 0.9)))
    robot = hp.Mechanism([lid]).with_frame("foot", "base", R=(0.1, 0, -0.25)).with_frame("eye", "lid", R=(0.3, 0, 0))
    robot = robot.with_strut("foot", "eye", "gas", force=hp.GasSpring(F1=150, F2=200, stroke=0.25), free_length=0.55)
    expected = robot.inverse_dynamics(*scene.coordinates()).tau
    assert_near(scene.forces().tau, expected, 16)
    gas = robot.struts(*scene.coordinates()[:2])["gas"]
    result = scene.evaluate(["gas", "length"])
    assert [*result.requested_arrays()] == ["length_gas", "rate_gas", "force_gas"]
    for name in ("length", "rate", "force"):
        np.testing.assert_allclose(getattr(result["gas"], name), getattr(gas, name), rtol=8 * U)
    np.testing.assert_array_equal(scene.forces().recorded()["force_gas"], result["gas"].force)
    assert "force_gas" in run_command("forces", scene.path).stdout
    assert scene.unit("rate_gas") == "m/s"
    with pytest.raises(hp.ArgumentError, match=r"nearest: length_gas"):
        scene.evaluate(["gas.length"])


def test_a_search_finds_where_a_strut_is_mounted(tmp_path):
    scene = scene_of(tmp_path, HATCH)
    found = hp.search(scene, {"mechanism.frames.foot.R[2]": (-0.3, -0.15)}, minimize="tau_lid_absmax")
    assert found.ok
    around = (scene.with_values({"mechanism.frames.foot.R[2]": found.values["mechanism.frames.foot.R[2]"] + d})
              for d in (-1e-3, 1e-3))  # fmt: skip
    assert all(np.abs(other.forces().tau).max() > found.results["tau_lid_absmax"] for other in around)


@pytest.mark.slow
def test_a_search_stays_within_the_stroke(tmp_path):
    """Further out the eye, a weaker spring would do; but it is drawn apart there."""
    scene = scene_of(tmp_path, HATCH)
    ranges = {"strut[0].gas.F1": (100, 200), "mechanism.frames.eye.R[0]": (0.2, 0.5)}
    found = hp.search(scene, ranges, minimize="tau_lid_absmax")
    best = scene.with_values(found.values)
    length = best.mechanism.struts(best.coordinates().q)["gas"].length
    assert found.ok
    assert length.min() >= 0.3
    assert length.max() <= 0.55
    far = scene.with_values({"mechanism.frames.eye.R[0]": 0.45})
    with pytest.warns(hp.DynamicsWarning, match=r"0.6724 m is beyond its stroke, .* at 6 of 11 samples"):
        assert np.isnan(far.forces().tau).sum() == 6
    lost = hp.search(far, {"strut[0].gas.F1": (100, 200)}, minimize="tau_lid_absmax")
    assert not lost.ok
    assert any("beyond its stroke" in note for note in lost.notes)


@pytest.mark.slow
def test_a_four_bar_moves_as_the_library_says(tmp_path):
    scene = scene_of(tmp_path, FOUR_BAR)
    assert scene.mechanism.names == ("crank",)
    crank = hp.HingeLoad(motor=lambda t, *_: 0.1 * np.sin(t))
    found = hp.simulate(scene.mechanism, scene.t, [0.3], [2.0], loads={"crank": crank})
    assert_near(scene.evaluate(["q"]).q, found.q, 64)
    ends = scene.evaluate(["R"])
    assert_near(ends["a"].R, ends["b"].R, 16)
    assert_near(scene.forces().tau[:, 0], 0.1 * np.sin(scene.t), 64, 1.0)  # 1 kg m^2, and qdd of 1 rad/s^2


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('frame2 = "b"', 'frame2 = "bb"', r"loop\[0\]\.frame2: expected a frame.*nearest: b"),
        ('coordinates = ["crank"]', 'coordinates = ["crnk"]', r"mechanism\.coordinates: "),
        ("coupler = 0.8,", "coupler = 0.8, elbow = 1,", r"mechanism\.at: |mechanism\.at\b"),
        (
            "[dynamics]",
            "[motion]\ncoupler = 1\n[dynamics]",
            r"motion\.coupler: expected one of crank, .* got .* moved by loops",
        ),
    ],
)
def test_what_cannot_be_closed_is_named(tmp_path, old, new, message):
    with pytest.raises(hp.SceneError, match=message):
        scene_of(tmp_path, FOUR_BAR.replace(old, new))


@pytest.mark.slow
def test_logged_cylinders_drive_a_backhoe():
    """The model, by its lengths: those of the cylinders are the log, and their forces hold the weights."""
    scene = hp.load_scene("models/backhoe.toml")
    logged = np.loadtxt("models/backhoe.csv", delimiter=",", skiprows=1)
    assert scene.mechanism.names == ("boom_cylinder", "stick_cylinder", "bucket_cylinder")
    assert np.abs(1e3 * scene.coordinates().q - logged[:, 1:]).max() < 0.5  # mm; five times the noise of the log
    result = scene.evaluate(["R"])
    length = np.linalg.norm(result["boom_eye"].R - result["boom_foot"].R, axis=1)
    np.testing.assert_allclose(length, scene.coordinates().q[:, 0], rtol=0, atol=8192 * U)
    still = scene.mechanism.gravity_forces(scene.coordinates().q)
    assert np.abs(scene.forces().tau - still)[10:-10].max() < 0.2 * np.abs(still).max()
