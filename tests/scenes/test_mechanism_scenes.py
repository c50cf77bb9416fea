"""Scenes of whole mechanisms: files to motions and forces, and every malformed file refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import hingepair as hp
from hingepair.scenes.mechanisms.scene import MechanismScene

U = 2.0**-53

JOINTS = """
[[joint]]
name = "stick"
parent = "boom"
u1 = [2, 0, 0]
u2 = [-0.5, 0, 0]
n = [0, -1, 0]
limits = [-2, -0.2]
torque_limit = 900
body2 = { mass = 40, inertia = [1, 9, 9] }

[[joint]]
name = "boom"
u1 = [0.1, 0, 1]
u2 = [-0.5, 0, 0.1]
n = [0, -1, 0]
rate_limit = 0.5
body2 = { mass = 90, center_of_mass = [0.2, 0, 0], inertia = [2, 30, 30] }

[[joint]]
name = "ram"
kind = "slider"
parent = "stick"
u1 = [0.5, 0, 0]
u2 = [0, 0, 0]
n = [1, 0, 0]
body2 = { mass = 5, inertia = [0.1, 0.1, 0.1] }
"""
MOTION = """
[motion]
boom = "w*t"
ram = { t = [0, 1], value = [0, 0.2], profile = "quintic" }
[motion.constants]
w = 0.3
"""
TIME = """
[time]
start = 0
stop = 2
samples = 41
"""
GOOD = JOINTS + MOTION + TIME


def scene_of(tmp_path: Path, text: str) -> MechanismScene:
    (tmp_path / "digger.toml").write_text(text, encoding="utf-8")
    scene = hp.load_scene(tmp_path / "digger.toml")
    assert isinstance(scene, MechanismScene)
    return scene


def by_hand() -> hp.Mechanism:
    boom = hp.HingePair(
        u1=(0.1, 0, 1),
        u2=(-0.5, 0, 0.1),
        n=(0, -1, 0),
        rate_limit=0.5,
        name="boom",
        body2=hp.Body(90, (0.2, 0, 0), (2, 30, 30)),
    )
    stick = hp.HingePair(
        u1=(2, 0, 0),
        u2=(-0.5, 0, 0),
        n=(0, -1, 0),
        limits=(-2, -0.2),
        torque_limit=900,
        name="stick",
        body2=hp.Body(40, inertia=(1, 9, 9)),
    )
    ram = hp.Slider(u1=(0.5, 0, 0), u2=(0, 0, 0), n=(1, 0, 0), name="ram", body2=hp.Body(5, inertia=(0.1, 0.1, 0.1)))
    return hp.Mechanism([boom, stick, ram])


def test_joints_of_a_file_are_the_mechanism_by_hand(tmp_path: Path) -> None:
    """The tables stand in another order than the tree."""
    scene, robot = scene_of(tmp_path, GOOD), by_hand()
    assert scene.mechanism.names == robot.names == ("boom", "stick", "ram")
    assert scene.mechanism.name == "digger"
    q, qd, qdd = scene.motion()
    t = np.linspace(0, 2, 41)
    np.testing.assert_array_equal(scene.t, t)
    assert np.abs(q[:, 0] - 0.3 * t).max() <= 2 * U
    np.testing.assert_array_equal(q[:, 1], np.full(41, -0.2))  # rests at the limit closest to 0
    s = np.minimum(t, 1)
    assert np.abs(q[:, 2] - 0.2 * s**3 * (10 - 15 * s + 6 * s * s)).max() <= 16 * U
    assert np.abs(qd[:, 0] - 0.3).max() <= U
    assert not qd[:, 1].any()
    assert not qdd[:, :2].any()
    result, state = scene.evaluate(), robot.forward_kinematics(q, qd, qdd)
    assert result.state.frames == ("ram",)
    for name, array in state.arrays().items():
        own = getattr(result, name)
        if name != "d":  # that of a resting base is R
            assert np.abs(own - array).max() <= 32 * U * max(1, np.abs(array).max()), name
    np.testing.assert_array_equal(result["ram"].R, result.R[:, 0])
    forces, expected = scene.forces(), robot.inverse_dynamics(q, qd, qdd)
    for name in ("tau", "force1", "torque1"):
        size = np.abs(expected[name]).max()
        assert np.abs(getattr(forces, name) - expected[name]).max() <= 64 * U * size, name
