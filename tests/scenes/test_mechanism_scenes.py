"""Scenes of whole mechanisms: files to motions and forces, and every malformed file refused in one line."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.near import assert_near
from support.scenes import scene_of, time, toml

U = 2.0**-53

JOINTS = (
    toml("[joint]", name="stick", parent="boom", u1=[2, 0, 0], u2=[-0.5, 0, 0], n=[0, -1, 0], limits=[-2, -0.2])
    + "torque_limit = 900\n"
    + toml("joint.body2", mass=40, inertia=[1, 9, 9])
    + toml("[joint]", name="boom", u1=[0.1, 0, 1], u2=[-0.5, 0, 0.1], n=[0, -1, 0], rate_limit=0.5)
    + toml("joint.body2", mass=90, centre_of_mass=[0.2, 0, 0], inertia=[2, 30, 30])
    + toml("[joint]", name="ram", kind="slider", parent="stick", u1=[0.5, 0, 0], u2=[0, 0, 0], n=[1, 0, 0])
    + toml("joint.body2", mass=5, inertia=[0.1, 0.1, 0.1])
)
MOTION = toml("motion", boom="w*t") + "ram = { t = [0, 1], value = [0, 0.2], profile = 'quintic' }\n"
MOTION += toml("constants", w=0.3)
TIME = time(0, 2, 41)
GOOD = JOINTS + MOTION + TIME


def by_hand() -> hp.Mechanism:
    """The numbers of the tables, in the order of the tree."""
    tables = {table.pop("name"): table for table in tomllib.loads(JOINTS)["joint"]}
    kinds = {"boom": hp.HingePair, "stick": hp.HingePair, "ram": hp.Slider}
    given = ("u1", "u2", "n", "limits", "torque_limit", "rate_limit")
    return hp.Mechanism([
        kind(**{key: tables[name][key] for key in given if key in tables[name]}, name=name,
             body2=hp.Body(**tables[name]["body2"]))
        for name, kind in kinds.items()
    ])  # fmt: skip


def test_joints_of_a_file_are_the_mechanism_by_hand(tmp_path: Path) -> None:
    """The tables stand in another order than the tree."""
    scene, robot = scene_of(tmp_path, GOOD), by_hand()
    assert scene.mechanism.names == robot.names == ("boom", "stick", "ram")
    assert scene.mechanism.name == "scene"
    q, qd, qdd = scene.coordinates()
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


@pytest.mark.slow
def test_rates_of_outputs_are_slopes(tmp_path: Path) -> None:
    """Of a base that turns and moves, too."""
    base = "[motion]\nx = '0.3*t**2'\nz = 1\nphi_y = '0.2*sin(t)'\nphi_z = '0.5*t'\nsequence = 'ZYX'\n"
    good = GOOD.replace("[motion]\n", base)
    scene = scene_of(tmp_path, good)
    h, middle = 1e-4, 1.3
    t = f"[time]\nstart = {middle - h!r}\nstop = {middle + h!r}\nsamples = 3\n"
    near = scene_of(tmp_path, good.replace(TIME, t))
    ram = near.evaluate()["ram"]
    for slope, array in ((ram.v, ram.R), (ram.a, ram.v), (ram.alpha, ram.omega)):
        assert np.abs((array[2] - array[0]) / (2 * h) - slope[1]).max() < h * h
    turned = (ram.S[2] - ram.S[0]) / (2 * h) @ ram.S[1].T
    assert np.abs(turned - hp.skew(ram.omega[1])).max() < h * h
    moved = scene.known(slice(None), 2).base_motion
    assert moved is not None
    assert_near(np.asarray(moved.a)[:, 0], 0.6, 16)
    phi = np.stack([0 * scene.t, 0.2 * np.sin(scene.t), 0.5 * scene.t], axis=-1)
    assert np.abs(moved.S - hp.euler_to_matrix(phi, "ZYX")).max() <= 4 * U
    assert scene.cross_validate(7).ok


@pytest.mark.slow
def test_a_free_base_needs_a_motion_and_shows_what_moves_it(tmp_path: Path) -> None:
    base = "[dynamics]\nbase = '{}'\n[motion]\nz = '-4.905*t**2'\n" + TIME
    joints = JOINTS.replace(
        '[[joint]]\nname = "boom"', '[[joint]]\nname = "boom"\nbody1 = { mass = 1000, inertia = [500, 500, 500] }', 1
    )
    free = scene_of(tmp_path, joints + base.format("free"))
    assert free.mechanism.base == "free"
    forces = free.forces()  # everything falls together: nothing need act
    assert_near(forces.force1, 0, 16, 1135 * 9.81)
    assert_near(forces.tau, 0, 16, 1135 * 9.81)  # levers of some metres
    lifted = scene_of(tmp_path, joints + base.format("free").replace("-4.905", "0")).forces()
    np.testing.assert_allclose(lifted.force1[:, 2], 1135 * 9.81, rtol=16 * U)
    fixed = scene_of(tmp_path, joints + base.format("fixed").replace("-4.905", "0")).forces()
    np.testing.assert_allclose(fixed.force1[:, 2], 135 * 9.81, rtol=16 * U)


@pytest.mark.slow
def test_payload_frames_and_gravity_are_those_of_the_methods(tmp_path: Path) -> None:
    text = (
        GOOD
        + toml("mechanism", name="small digger")
        + toml("mechanism.frames.wrist", link="stick", R=[0.2, 0, 0.1])
        + "S = { axis = [1, 0, 0], deg = 90 }\n"
        + toml("mechanism.frames.teeth", link="wrist", R=[0, 0, 0.4])
        + toml("mechanism.payload.teeth", mass=7, inertia=[0.2, 0.2, 0.1])
        + toml("dynamics", gravity=[0, "-1.62*sin(0.1)", "-1.62*cos(0.1)"])
    )
    scene = scene_of(tmp_path, text)
    S = hp.rotation_exp((np.pi / 2, 0, 0))
    robot = by_hand().with_frame("wrist", "stick", (0.2, 0, 0.1), S).with_frame("teeth", "wrist", (0, 0, 0.4))
    robot = robot.with_payload("teeth", hp.Body(7, inertia=(0.2, 0.2, 0.1)))
    assert scene.mechanism.name == "small digger"
    assert scene.frames == ("wrist", "teeth")
    q, qd, qdd = scene.coordinates()
    result = scene.evaluate(("R", "S_teeth"))
    expected = robot.forward_kinematics(q, frames=("wrist", "teeth"))
    assert_near(result.R, expected.R, 16)
    assert list(result.requested_arrays()) == ["R_wrist", "R_teeth", "S_teeth"]
    gravity = (0, -1.62 * np.sin(0.1), -1.62 * np.cos(0.1))
    tau = robot.inverse_dynamics(q, qd, qdd, gravity=gravity).tau
    assert np.abs(scene.forces().tau - tau).max() <= 16 * U * np.abs(tau).max()


def test_a_urdf_file_beside_the_scene_is_a_robot(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(hp.to_urdf(by_hand()))
    table = "[mechanism]\nurdf = 'arm.urdf'\nlocked = { ram = '0.1/2' }\n"
    scene = scene_of(tmp_path, f"{table}[motion]\nboom = 't'\n{TIME}")
    assert scene.mechanism.names == ("boom", "stick")
    assert scene.files == (tmp_path / "scene.toml", tmp_path / "arm.urdf")
    q = np.stack([scene.t, np.full(41, -0.2), np.full(41, 0.05)], axis=1)
    expected = by_hand().forward_kinematics(q, frames=("ram",)).R
    assert_near(scene.evaluate(("R_ram",)).R, expected, 16)


@pytest.mark.slow
def test_what_is_written_is_a_log_that_comes_back_to_the_bit(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, GOOD)
    for name in ("log.csv", "log.npz", "log.parquet"):
        scene.evaluate(("q", "qd", "qdd")).save(tmp_path / name)
        logged = scene_of(tmp_path, JOINTS + f"[motion]\nfile = '{name}'\n")
        np.testing.assert_array_equal(logged.t, scene.t)
        for own, expected in zip(logged.coordinates(), scene.coordinates(), strict=True):
            np.testing.assert_array_equal(own, expected)
        assert_near(logged.forces().tau, scene.forces().tau, 64)
        assert logged.files == (tmp_path / "scene.toml", tmp_path / name)


def test_a_log_of_some_joints_leaves_the_others_at_rest(tmp_path: Path) -> None:
    t = np.linspace(0, 2, 201)
    np.savetxt(tmp_path / "log.csv", np.stack([t, np.sin(t)], 1), delimiter=",", header="t,boom", comments="")
    scene = scene_of(tmp_path, JOINTS + "[motion]\nfile = 'log.csv'\nsmooth = true\n")
    q, qd, qdd = scene.coordinates()
    assert (q[:, 1:] == (-0.2, 0)).all()
    assert not qd[:, 1:].any()
    assert np.abs(qd[:, 0] - np.cos(t)).max() < 1e-8  # left by the smoothing
    assert np.abs(qdd[:, 0] + np.sin(t))[10:-10].max() < 1e-9
    assert any(note.startswith("smoothed: noise of") and "rad of boom" in note for note in scene.notes())
    arrays = {"t": t, "q": np.stack([np.sin(t), t, 0 * t], 1)}
    np.savez(tmp_path / "log.npz", **arrays)
    q = scene_of(tmp_path, JOINTS + "[motion]\nfile = 'log.npz'\n").coordinates().q
    np.testing.assert_array_equal(q, arrays["q"])


def test_limits_that_are_passed_are_told_with_where(tmp_path: Path) -> None:
    text = (
        GOOD.replace("w = 0.3", "w = 0.6")
        .replace("torque_limit = 900", "torque_limit = 100")
        .replace("[motion]", "[motion]\nstick = '-2.5*t'", 1)
    )
    scene = scene_of(tmp_path, text)
    assert scene.notes() == (
        "boom' leaves its limits, -0.5 to 0.5 rad/s, at 41 of 41 instants, first at t = 0 s (0.6)",
        "stick leaves its limits, -2 to -0.2 rad, at 26 of 41 instants, first at t = 0 s (0)",
    )
    forces = scene.forces()
    (note,) = forces.notes
    tau, stick = forces.tau_stick, forces.ranges()["tau_stick"]
    beyond, largest = np.flatnonzero(np.abs(tau) > 100), np.abs(tau).max()
    assert note.startswith(f"stick takes up to {largest:.4g} N m, more than its limit of 100, at {beyond.size} of 41")
    assert f"first at t = {scene.t[beyond[0]]:g} s" in note
    assert stick["rms"] == pytest.approx(np.sqrt(np.mean(tau**2)), rel=64 * U)
    assert (stick["smallest"], stick["largest"]) == (tau.min(), tau.max())
    assert stick["t_of_largest_size"] == scene.t[np.abs(tau).argmax()]
    (row,) = (row for row in forces.table()[0] if row[0] == "tau_stick")
    assert row[-2:] == ("100", f"{largest / 100:.0%}")
    degrees = scene_of(tmp_path, GOOD.replace("[motion]", "[motion]\nstick = -90", 1)).notes()
    assert any(note.startswith("motion.stick: -90 is taken for radians") for note in degrees)


def test_robots_rest_at_zero_or_at_the_closest_limit(tmp_path: Path) -> None:
    scene = scene_of(tmp_path, "[mechanism]\nrobot = 'panda'\n[motion]\n" + TIME)
    q = scene.coordinates().q[0]
    limits = scene.mechanism.position_limits
    assert ((q >= limits[:, 0]) & (q <= limits[:, 1])).all()
    assert dict(zip(scene.mechanism.names, q.tolist(), strict=True))["panda_joint4"] == -0.0698
    assert np.count_nonzero(q) == 1
    assert scene.motion.moving == ()
    assert scene.notes() == ()
