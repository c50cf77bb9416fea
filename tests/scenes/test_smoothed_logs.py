"""Scenes whose log is a noisy recording that is smoothed."""

from __future__ import annotations

import json

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.results import Record
from support.commands import run_command
from support.scenes import logged

PAIR = logged([0.3, 0.1, 0], [-0.2, 0, 0.1], [0, 0, 1], smooth=True)


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


def test_the_ends_of_smoothing_are_extremes_of_poses_but_not_of_rates(tmp_path):
    path, _ = written(tmp_path)
    scene = hp.load_scene(path)
    outputs = ("R2", "psi", "v2", "a2")
    found, inside = scene.evaluate(outputs).to_dataframe(), scene.motion.sure
    assert found["R2_z"].idxmin() == 0
    assert any(found[name].max() > found[name][inside].max() for name in ("a2_x", "a2_y", "a2_z"))
    printed = json.loads(run_command("run", path, "--outputs", ",".join(outputs), "--json").stdout)["outputs"]
    for name, own in printed.items():
        kept = found[name] if name == "psi" or name.startswith("R2") else found[name][inside]
        assert (own["smallest"], own["largest"]) == (kept.min(), kept.max()), name
