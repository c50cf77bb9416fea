"""Scenes: files to motions, closed forms, and every malformed file refused in one line."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.scenes.motions.waypoints import PROFILES, interpolate_way_points
from support.scenes import moved, scene_of, toml

U = 2.0**-53
MODELS = Path(__file__).parents[2] / "models"

GOOD = (
    toml("pair", u1=[0.5, 0.2, 0.1], u2=[-0.25, 0.1, 0.3], n=[1, 0, 0])
    + moved(0, 2, 21, x="3*t", y=0.5, z="w*t**2", phi_x="0.1*t", phi_y="0.2*sin(t)", psi="pi*t")
    + toml("constants", w=2)
)


def test_derivatives_reach_the_state(tmp_path: Path) -> None:
    result = scene_of(tmp_path, GOOD).evaluate(("v1", "a1", "R1"))
    t = result.t
    np.testing.assert_allclose(result.R1, np.stack([3 * t, 0 * t + 0.5, 2 * t**2], -1), rtol=4 * U)
    np.testing.assert_allclose(result.v1, np.stack([0 * t + 3, 0 * t, 4 * t], -1), rtol=4 * U)
    np.testing.assert_allclose(result.a1, np.broadcast_to((0.0, 0.0, 4.0), (21, 3)), rtol=4 * U)


def test_outputs_of_the_file_are_those_computed(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, GOOD + '[outputs]\nnames = ["R2", "omega1"]\n')
    assert scene.evaluate().state.outputs == ("R2", "omega1")
    assert scene.evaluate(("d",)).state.outputs == ("d",)


def change(old: str, new: str) -> str:
    assert GOOD.count(old) == 1, old
    return GOOD.replace(old, new)


def test_numbers_may_be_expressions_of_constants(tmp_path: Path) -> None:
    text = change("u1 = [0.5, 0.2, 0.1]", 'u1 = ["cos(pi/3)", "w/10", 0.1]').replace("stop = 2", 'stop = "w"')
    scene = scene_of(tmp_path, text.replace("w = 2", 'half = "tau/(2*pi)"\nw = "2*half"'))
    np.testing.assert_allclose(scene.pair.u1, (0.5, 0.2, 0.1), rtol=4 * U)
    assert (scene.stop, scene.constants) == (2.0, {"half": 1.0, "w": 2.0})


@pytest.mark.parametrize(
    "home",
    [
        "{ axis = [0, 0, 2], deg = 30 }",
        '{ axis = [0, 0, 1], rad = "pi/6" }',
        "{ rpy_deg = [0, 0, 30] }",
        '{ rpy = [0, 0, "pi/6"] }',
    ],
)
def test_home_is_said_by_axis_and_angle_or_by_roll_pitch_yaw(tmp_path: Path, home: str) -> None:
    pair = scene_of(tmp_path, change("n = [1, 0, 0]", f"n = [1, 0, 0]\nhome = {home}")).pair
    np.testing.assert_allclose(pair.home, hp.rodrigues((0, 0, 1), np.pi / 6), rtol=0, atol=4 * U)


def test_masses_and_shapes_come_with_the_pair(tmp_path: Path) -> None:
    bodies = """
torque_limit = 5
[pair.body1]
mass = 12
centre_of_mass = [0, 0, "1/8"]
inertia = [1, 1, 0.5]
shapes = [{ box = [1, 2, 3], axes = { rpy_deg = [0, 0, 90] } }, { cylinder = 0.1, length = 2 }]
[pair.body2]
inertia = [[1, 0.1, 0], [0.1, 1, 0], [0, 0, 1]]
shapes = [{ sphere = 0.2, center = [0, 0, 1] }]
[motion]
"""
    pair = scene_of(tmp_path, GOOD.replace("\n[motion]\n", bodies)).pair
    assert (pair.body1.mass, pair.body1.centre_of_mass.tolist()) == (12, [0, 0, 0.125])
    assert pair.body1.inertia.diagonal().tolist() == [1, 1, 0.5]
    assert pair.body1.shapes[0].size.tolist() == [1, 2, 3]
    np.testing.assert_allclose(pair.body1.shapes[0].axes, hp.rodrigues((0, 0, 1), np.pi / 2), rtol=0, atol=4 * U)
    assert pair.body1.shapes[1].length == 2
    assert (pair.body2.inertia[0, 1], pair.body2.shapes[0].radius, pair.torque_limit) == (0.1, 0.2, 5)


POINTS = "{ t = [0, 0.5, 2], value = [0, -1, 'pi/2'], profile = 'PROFILE' }"


@pytest.mark.slow
@pytest.mark.parametrize("profile", PROFILES)
def test_way_points_are_passed_and_their_derivatives_belong_together(tmp_path: Path, profile: str) -> None:
    text = change('psi = "pi*t"', f"psi = {POINTS.replace('PROFILE', profile)}")
    text = text.replace("samples = 21", "samples = 2001")
    scene = scene_of(tmp_path, text)
    psi, psid, psidd = (array[:, 0] for array in scene.coordinates())
    np.testing.assert_allclose(psi[[0, 500, -1]], (0, -1, np.pi / 2), rtol=0, atol=16 * U)
    h, t = 1e-3, scene.t[1:-1]
    breaks = (0, 0.5, 2, *(i + j / 3 * (k - i) for i, k in ((0, 0.5), (0.5, 2)) for j in (1, 2)))
    # Differences of steps h are off by h^2.
    inner = np.all([np.abs(t - at) > 1.5 * h for at in breaks], axis=0)
    np.testing.assert_allclose(
        ((psi[2:] - psi[:-2]) / 2 / h - psid[1:-1])[inner], 0, atol=100 * h * h
    )  # of steps h, as below
    np.testing.assert_allclose(((psid[2:] - psid[:-2]) / 2 / h - psidd[1:-1])[inner], 0, atol=1000 * h * h)
    if profile != "linear":
        assert np.abs(psid[[0, -1]]).max() <= 64 * U
    if profile in {"quintic", "spline"}:
        assert np.abs(psidd[[0, -1]]).max() <= 64 * U
    kinks = {"linear": 2, "trapezoid": 6, "cubic": 2}.get(profile, 0)
    assert scene.motion.functions.switches(scene.t).sum() == kinks
    assert ("kinks" in " ".join(scene.notes())) == (kinks > 0)
    assert scene.cross_validate(50).ok
    assert "psi(t)" in str(hp.derive(scene).S2)


def through_points(t: list[float], value: list[float], profile: str) -> tuple[np.ndarray, ...]:
    times = np.linspace(t[0], t[-1], 4001)
    return times, *interpolate_way_points(np.array(t), np.array(value), profile).derivatives(times, 2)


@pytest.mark.parametrize("profile", ["trapezoid", "cubic", "quintic"])
def test_profiles_stop_at_each_point_and_never_pass_it(profile: str) -> None:
    t, value = [0.0, 1.0, 1.5, 3.0, 5.0], [0.0, 2.0, 2.0, -1.0, 0.5]
    times, position, speed, acceleration = through_points(t, value, profile)
    at = np.searchsorted(times, t)
    np.testing.assert_allclose(speed[at], 0, atol=64 * U)
    for i in range(4):
        there = (times >= t[i]) & (times <= t[i + 1])
        low, high = sorted(value[i : i + 2])
        assert low - 8 * U <= position[there].min() <= position[there].max() <= high + 8 * U
        assert (np.diff(position[there]) * (value[i + 1] - value[i]) >= -8 * U).all()  # and never turns back
    assert (position[(times >= 1) & (times <= 1.5)] == 2).all()  # a pause
    if profile == "quintic":
        np.testing.assert_allclose(acceleration[at], 0, atol=512 * U)


def test_a_trapezoid_keeps_its_limits(tmp_path: Path) -> None:
    text = change(
        'psi = "pi*t"', "psi = { t = [0, 2], value = [0, 1], profile = 'trapezoid', speed = 0.6, acceleration = 4 }"
    )
    scene = scene_of(tmp_path, text.replace("samples = 21", "samples = 2001"))
    _, psid, psidd = scene.coordinates()
    assert abs(psid.max() - 0.6) <= 4 * U  # a third of the time each would need 0.75
    assert psidd.max() == pytest.approx(1.8, abs=256 * U) == -psidd.min()  # of differences of positions in 2 / 3 s


def doubts(tmp_path: Path, text: str) -> tuple[str, ...]:
    """The suspicions of units, which are the first notes."""
    scene = scene_of(tmp_path, text)
    found = scene.suspicions()
    assert scene.notes()[: len(found)] == found
    return found


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("stop = 2", "stop = 2000", "t steps by 100 s: is it in seconds"),
        ('psi = "pi*t"', "psi = -90", "motion.psi: -90 is taken for radians, 14.3 turns; degrees .* by .deg"),
        ('psi = "pi*t"', 'psi = "90"', "motion.psi: 90 is taken for radians"),
        ('psi = "pi*t"', 'psi = "90*t/2"', "motion.psi turns by 90 rad, 14.3 turns: is it in radians"),
        ('psi = "pi*t"', 'psi = "30*sin(3*t)"', "motion.psi turns by 59.* rad"),
        ('psi = "pi*t"', "psi = { t = [0, 2], value = [0, 90] }", "motion.psi: 90 is taken for radians"),
        ("[motion]\n", "limits = [-90, 0]\n[motion]\n", "limits of psi: -90 is taken for radians"),
        ("[motion]\n", "rate_limit = 90\n[motion]\n", "pair.rate_limit: 90 is taken for rad/s"),
        ("[motion]\n", "home = { rpy = [0, 90, 0] }\n[motion]\n", "pair.home.rpy: 90 is taken for radians"),
        (
            "[motion]\n",
            "body2 = { mass = 1, shapes = [{ sphere = 90 }] }\n[motion]\n",
            "pair.body2.shapes.0..sphere: 90 .* metres",
        ),
    ],
)
def test_other_units_in_a_scene_are_suspected(tmp_path: Path, old: str, new: str, said: str) -> None:
    (sentence,) = doubts(tmp_path, change(old, new))
    assert re.match(said, sentence)
