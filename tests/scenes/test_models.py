"""models/: what stands there is what the program writes today, and its README's code runs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.commands import run_command
from support.sparse import sparse

U = 2.0**-53
MODELS = Path(__file__).parents[2] / "models"
README = (MODELS / "README.md").read_text()
EVERY_SCENE = sorted(MODELS.glob("*.toml"))
OF_MECHANISMS = [path for path in EVERY_SCENE if re.search(r"^\[mechanism", path.read_text(), re.MULTILINE)]
SCENES = [path for path in EVERY_SCENE if path not in OF_MECHANISMS]
EXPORTS = {".urdf": "urdf", ".xml": "mjcf"}
NUMBER = re.compile(r"-?\d+\.\d+(?:e[-+]?\d+)?")


@pytest.mark.filterwarnings("ignore:.*no mass properties:hingepair.DynamicsWarning")
@pytest.mark.parametrize("ending", EXPORTS)
@pytest.mark.parametrize("scene", sparse(SCENES, 4, lambda path: path.stem))
def test_the_exports_are_fresh(scene, ending):
    assert_fresh(scene, ending)


def test_the_urdf_of_the_excavator_is_fresh():
    assert_fresh(MODELS / "excavator.toml", ".urdf")


def assert_fresh(scene, ending):
    """To the letter, and to the last bits of each number: machines differ in these (atan2, fused multiply-add)."""
    stored = scene.with_suffix(ending).read_text(encoding="utf-8")
    fresh = run_command(EXPORTS[ending], scene).stdout
    assert NUMBER.sub("#", stored) == NUMBER.sub("#", fresh), "stale: see models/README.md"
    one, two = (np.array([float(n) for n in NUMBER.findall(text)]) for text in (stored, fresh))
    assert (np.abs(one - two) <= 8 * U * np.maximum(1, np.abs(two))).all(), "stale: see models/README.md"


@pytest.mark.slow
@pytest.mark.parametrize("scene", OF_MECHANISMS, ids=lambda path: path.stem)
def test_scenes_of_mechanisms_stay_within_their_limits(scene):
    loaded = hp.load_scene(scene)
    said = ("elbow hits a rigid stop", "smoothed: noise of", "rates at the ends")
    assert all(note.startswith(said) for note in loaded.notes())
    known = ("left out are damping and dry friction of 18 joints", "elbow hits a rigid stop")
    assert all(note.startswith(known) for note in loaded.forces().notes)


@pytest.mark.slow
def test_loads_of_joints_count_among_the_forces_of_a_scene(tmp_path):
    text = (MODELS / "talos_lift.toml").read_text()
    (tmp_path / "loaded.toml").write_text(text.replace("[time]", "[dynamics]\njoint_loads = true\n[time]"))
    with_loads, without = (hp.load_scene(path) for path in (tmp_path / "loaded.toml", MODELS / "talos_lift.toml"))
    forces, robot = with_loads.forces(), with_loads.mechanism
    assert forces.notes[0].startswith("arm_left_4_joint takes up to 17.91 N m, more than its limit of 17.86")
    elbow = robot.joint_loads["arm_left_4_joint"]
    qd = with_loads.coordinates().qd[:, robot.names.index("arm_left_4_joint")]
    added = forces.tau_arm_left_4_joint - without.forces().tau_arm_left_4_joint
    expected = elbow.damping * qd + elbow.friction * np.sign(qd)
    assert np.abs(added - expected).max() <= 64 * 2.0**-53 * np.abs(forces.tau_arm_left_4_joint).max()
    assert np.abs(expected).max() > 0.1
