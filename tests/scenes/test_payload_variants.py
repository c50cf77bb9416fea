"""Variants that differ in payload alone are computed together: each is the scene with its payload."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.scenes.variants import vary

U = 2.0**-53
CRANE = """
[[joint]]
name = "boom"
u1 = [0, 0, 1]
u2 = [0.1, 0, 0.2]
n = [1, 2, 0]
home = { axis = [0, 1, 1], deg = 20 }
body1 = { mass = 5, inertia = [0.2, 0.2, 0.3] }
body2 = { mass = 3, inertia = [1, 1.1, 1.2], centre_of_mass = [1, 0, 0] }
[[joint]]
name = "trolley"
parent = "boom"
kind = "slider"
u1 = [0.3, 0, 0]
u2 = [0, 0, 0]
n = [1, 0, 0]
body2 = { mass = 2, inertia = [0.1, 0.2, 0.2] }
[[joint]]
name = "hook"
parent = "trolley"
u1 = [0, 0.1, -0.5]
u2 = [0, 0, 0]
n = [0, 0.6, 0.8]
body2 = { mass = 1, inertia = [0.1, 0.1, 0.1] }
[mechanism.frames.jaw]
link = "hook"
R = [0.05, 0.1, -0.2]
S = { axis = [1, 1, 0], deg = 40 }
[mechanism.payload.jaw]
mass = 1
inertia = [0.1, 0.12, 0.14]
centre_of_mass = [0.01, 0.02, -0.1]
[mechanism.payload.boom]
mass = 0.5
centre_of_mass = [0.3, 0, 0]
shapes = [{ box = [0.6, 0.1, 0.1], center = [0.3, 0, 0] }]
[mechanism.payload.trolley]
mass = 0.25
inertia = [0.01, 0.01, 0.01]
[motion]
boom = "t**2"
trolley = "sin(t)"
hook = "2*t - 0.3"
MOTION
BASE
[time]
start = 0
stop = 1
samples = 5
"""
FREE = 'x = "t"\ny = 0\nz = "0.2*t**2"\nphi_x = "0.3*t"\nphi_y = 0.1\nphi_z = "sin(t)"\n'
ON_A_BASE = {"fixed": ("", ""), "free": ('[dynamics]\nbase = "free"', FREE)}
BEAM = hp.Box((0.6, 0.1, 0.1), (0.3, 0, 0))
KEYS = tuple(
    f"mechanism.payload.{key}" for key in ("jaw.mass", "jaw.centre_of_mass[1]", "jaw.inertia[2]", "boom.mass")
)
OUTPUTS = ("tau", "force1", "torque1", "R_jaw", "q")


def drawn(count: int) -> np.ndarray:
    return np.random.default_rng(0).uniform((0.5, -0.2, 0.08, 0.1), (3, 0.2, 0.2, 2), (count, 4))


@pytest.fixture(autouse=True)
def _folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def variants_of(text: str, keys=KEYS, outputs=OUTPUTS) -> vary.Variants:
    Path("crane.toml").write_text(text)
    return vary.Variants(hp.load_scene("crane.toml"), keys, outputs)


def crane(base: str) -> str:
    return CRANE.replace("BASE", ON_A_BASE[base][0]).replace("MOTION", ON_A_BASE[base][1])


@pytest.fixture
def one_by_one(monkeypatch):
    """Count the variants that are computed one by one."""
    counted = []
    plain = vary.Variants.compute
    monkeypatch.setattr(vary.Variants, "compute", lambda self, row: counted.append(row) or plain(self, row))
    return counted


@pytest.mark.slow
@pytest.mark.parametrize("base", ON_A_BASE)
def test_variants_that_are_computed_together_are_the_scenes_with_their_payloads(base, one_by_one):
    variants, numbers = variants_of(crane(base)), drawn(7)
    (batch,) = variants.batches(numbers)
    together = batch.arrays
    assert not one_by_one
    scene = hp.load_scene("crane.toml")
    robot = scene.mechanism
    bare = hp.load_scene(bare_scene(base)).mechanism
    for i, (mass, lever, moment, boom) in enumerate(numbers.tolist()):
        loaded = bare.with_payload("jaw", hp.Body(mass, (0.01, lever, -0.1), (0.1, 0.12, moment)))
        loaded = loaded.with_payload("boom", hp.Body(boom, (0.3, 0, 0), shapes=[BEAM]))
        loaded = loaded.with_payload("trolley", hp.Body(0.25, inertia=(0.01, 0.01, 0.01)))
        expected = loaded.inverse_dynamics(
            *scene.coordinates(), base_motion=scene.base_motion(), gravity=scene.gravity
        )
        forces = {f"tau_{name}": expected.tau[:, k] for k, name in enumerate(robot.names)}
        forces |= {"force1": expected.force1, "torque1": expected.torque1}
        size = max(np.abs(array).max() for array in forces.values())
        for name, array in forces.items():
            assert np.abs(together[name][i] - array).max() < 32 * U * size, name
        assert np.abs(together["R_jaw"][i] - scene.evaluate(("R_jaw",)).R[:, 0]).max() < 16 * U
        assert (together["hook"][i] == scene.coordinates().q[:, 2]).all()
        assert (batch.t == scene.t).all()


@pytest.mark.slow(1)
def test_forces_do_not_depend_on_the_size_of_chunks():
    variants, numbers = variants_of(crane("free"), outputs=("tau", "force1")), drawn(4000)
    (whole,) = variants.batches(numbers)
    for size in (1, 7):
        (part,) = variants.batches(numbers[10 : 10 + size])
        for name in ("tau_hook", "force1"):
            np.testing.assert_array_equal(part.arrays[name], whole.arrays[name][10 : 10 + size])


def bare_scene(base: str) -> str:
    before, _, rest = crane(base).partition("[mechanism.payload.jaw]")
    Path("bare.toml").write_text(before + "[motion]" + rest.partition("[motion]")[2])
    return "bare.toml"


def test_a_payload_on_a_fixed_base_changes_nothing():
    text = crane("fixed").replace("payload.trolley", "payload.base")
    variants = variants_of(text, ("mechanism.payload.base.mass",), ("tau", "force1"))
    (batch,) = variants.batches(np.linspace(1, 100, 7)[:, None])
    assert (batch.arrays["tau_boom"] == batch.arrays["tau_boom"][0]).all()
    assert (batch.arrays["force1"] == batch.arrays["force1"][0]).all()
