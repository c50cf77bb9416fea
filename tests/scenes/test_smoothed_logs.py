"""Scenes whose log is a noisy recording that is smoothed."""

from __future__ import annotations

import re

import numpy as np
import pytest

import hingepair as hp
from hingepair.pair.results import Record

PAIR = """
[pair]
u1 = [0.3, 0.1, 0]
u2 = [-0.2, 0, 0.1]
n = [0, 0, 1]

[motion]
file = "log.csv"
smooth = true
"""


def written(folder, text=PAIR, quaternions=True, **more):
    """A scene with a log of noisy samples; the exact motion of body 2."""
    t = np.arange(600) / 100
    rng = np.random.default_rng(0)
    phi = np.stack((np.sin(t), 0.5 * np.cos(1.3 * t), 0.3 * t), axis=-1)
    psi, R = np.sin(2 * t), np.stack((np.cos(t), np.sin(t), 0.1 * t), axis=-1)
    zero = np.zeros_like(t)
    pair = hp.HingePair(u1=(0.3, 0.1, 0), u2=(-0.2, 0, 0.1), n=(0, 0, 1))
    q = np.column_stack((R, phi, psi))
    rates = np.column_stack(
        (-np.sin(t), np.cos(t), zero + 0.1, np.cos(t), -0.65 * np.sin(1.3 * t), zero + 0.3, 2 * np.cos(2 * t))
    )
    state = pair.forward_kinematics(q, rates, outputs=("S1", "R2", "v2", "omega2"))
    off = 1e-3 * rng.standard_normal((7, 600))
    columns = dict(zip("xyz", R.T + off[:3], strict=True))
    if quaternions:
        from scipy.spatial.transform import Rotation

        turned = Rotation.from_matrix(state.S1) * Rotation.from_rotvec(off[3:6].T)
        columns |= dict(zip(("qx", "qy", "qz", "qw"), turned.as_quat().T, strict=True))
    else:
        columns |= {f"phi_{c}": row for c, row in zip("xyz", phi.T + off[3:6], strict=True)}
    Record(t, columns | {"psi": psi + off[6]} | dict.fromkeys(more, zero), "log").save(folder / "log.csv")
    (folder / "scene.toml").write_text(text)
    return folder / "scene.toml", state


@pytest.mark.slow
@pytest.mark.parametrize("quaternions", [True, False], ids=["quaternions", "Euler angles"])
def test_a_noisy_log_is_smoothed_with_its_rates(tmp_path, quaternions):
    path, state = written(tmp_path, quaternions=quaternions)
    scene = hp.load_scene(path)
    result = scene.evaluate(outputs=("R2", "v2", "omega2", "a2"))
    for name, most in (("R2", 1e-3), ("v2", 6e-3), ("omega2", 8e-3)):
        error = getattr(result, name) - getattr(state, name)
        assert np.sqrt(np.mean(error[50:-50] ** 2)) < most, name
    assert any("smoothed: noise of 0.001 m of position" in note for note in scene.motion.notes)


@pytest.mark.slow
def test_the_noise_of_forces_is_what_smoothing_leaves(tmp_path):
    """Not the roughness of the smoothed curves, of which nothing is left."""
    text = PAIR.replace(
        "[motion]", "body2 = { mass = 3, centre_of_mass = [0.1, 0, 0], inertia = [0.1, 0.1, 0.1] }\n\n[motion]"
    )
    path, _ = written(tmp_path, text, quaternions=False)
    forces = hp.load_scene(path).forces()
    t = np.arange(600) / 100
    q = np.column_stack((np.cos(t), np.sin(t), 0.1 * t, np.sin(t), 0.5 * np.cos(1.3 * t), 0.3 * t, np.sin(2 * t)))
    zero = np.zeros_like(t)
    qd = np.column_stack(
        (-np.sin(t), np.cos(t), zero + 0.1, np.cos(t), -0.65 * np.sin(1.3 * t), zero + 0.3, 2 * np.cos(2 * t))
    )
    qdd = np.column_stack(
        (-np.cos(t), -np.sin(t), zero, -np.sin(t), -0.845 * np.cos(1.3 * t), zero, -4 * np.sin(2 * t))
    )
    pair = hp.load_scene(path).pair
    state = pair.forward_kinematics(q, qd, qdd, outputs=("R1", "S1", "v1", "omega1", "a1", "alpha1"))
    body1 = hp.BodyMotion(R=state.R1, S=state.S1, v=state.v1, omega=state.omega1, a=state.a1, alpha=state.alpha1)
    exact = pair.hinge_wrench(body1, q[:, 6], qd[:, 6], qdd[:, 6])
    for name, truth in (("hinge_torque", exact.hinge_torque), ("hinge_force", exact.force)):
        error = np.sqrt(np.mean((forces[name] - truth) ** 2, axis=0))
        ratio = forces.noise[name] / error
        assert (ratio > 0.4).all(), name
        assert (ratio < 2.5).all(), name
    (note,) = (note for note in forces.notes if note.startswith("noise of the log, after smoothing"))
    assert "hp.smooth" not in note


@pytest.mark.slow
def test_notes_of_a_smoothed_log_name_its_columns_and_missing_samples(tmp_path):
    path, _ = written(tmp_path, quaternions=False)
    log = np.genfromtxt(tmp_path / "log.csv", delimiter=",", names=True)
    names = log.dtype.names

    def notes(**changes):
        columns = {name: changes.get(name, log[name]) for name in names}
        Record(columns.pop("t"), columns, "log").save(tmp_path / "log.csv")
        return hp.load_scene(path).motion.notes

    assert not any("missing" in note or "radians" in note for note in notes())
    few, many = log["psi"].copy(), log["x"].copy()
    few[300], many[100:200] = np.nan, np.nan
    said = notes(psi=few, x=many)
    assert "psi: 1 of 600 samples missing and filled; the first at t = 3 s" in said
    assert (
        "position: 100 of 600 samples missing and not filled, in gaps that are too long; the first at t = 1 s" in said
    )
    said = notes(psi=np.degrees(log["psi"]), phi_x=20 * log["phi_x"])
    assert any(re.match(r"psi spans \d+ rad, .* by unit = \"deg\" for psi in", note) for note in said)
    assert any(re.match(r"phi_x spans \d+ rad, .* by unit = \"deg\" for phi_x in", note) for note in said)


@pytest.mark.parametrize(
    ("text", "more", "words"),
    [
        (
            PAIR + "differentiate = true\n",
            (),
            "motion.smooth: expected no such key together with differentiate or integrate",
        ),
        (PAIR, ("psid",), "psid: expected samples of x, y, z, of an attitude and of psi"),
        (PAIR + "unwrap = true\n", (), "unwrap"),
    ],
)
def test_what_does_not_go_with_smoothing_is_refused(tmp_path, text, more, words):
    path, _ = written(tmp_path, text, **dict.fromkeys(more))
    with pytest.raises(hp.SceneError, match=words):
        hp.load_scene(path)


def test_a_missing_sample_that_cannot_be_differentiated_is_said_to_need_smoothing(tmp_path):
    path, _ = written(tmp_path, PAIR.replace("smooth = true", "differentiate = true"), quaternions=False)
    lines = (tmp_path / "log.csv").read_text().splitlines()
    lines[300] = lines[300].rpartition(",")[0] + ","
    (tmp_path / "log.csv").write_text("\n".join(lines))
    with pytest.raises(
        hp.SceneError, match=r"differentiated \(motion.smooth = true fills missing samples\), got nan"
    ):
        hp.load_scene(path)


def test_a_loss_makes_outliers_of_a_log_count_little(tmp_path):
    path, _ = written(tmp_path)
    lines = (tmp_path / "log.csv").read_text().splitlines()
    lines[300] = ",".join((*lines[300].split(",")[:-1], "30.0"))  # psi
    (tmp_path / "log.csv").write_text("\n".join(lines))
    off = []
    for text in (PAIR, PAIR + 'loss = "cauchy"\n'):
        path.write_text(text)
        scene = hp.load_scene(path)
        off.append(np.abs(scene.evaluate(("psi",)).psi - np.sin(2 * scene.t))[290:310].max())
    assert off[0] > 0.1 > 20 * off[1]
    path.write_text(PAIR.replace("smooth = true", 'differentiate = true\nloss = "cauchy"'))
    with pytest.raises(hp.SceneError, match=r"motion\.loss: expected no such key without smooth = true"):
        hp.load_scene(path)
