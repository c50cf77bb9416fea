"""`scene.with_values` and `hp.vary`: every variant is the scene with its numbers, whatever is computed together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from hingepair.scenes.variants.vary import Variants
from support.near import assert_near
from support.scenes import moved, scene_of, time, toml

MODELS = Path(__file__).parents[2] / "models"
ROD = (
    toml("pair", u1=[0, 0, 0], u2=[-0.5, 0, 0], n=[0, 1, 0])
    + toml("pair.body2", mass=1, inertia=[0.1, 0.1, 0.1])
    + toml(
        "dynamics",
        {"psi.q_0": 1, "psi.damping": 0.1, "psi.stops": [-0.2, 3], "psi.stop_restitution": 0.5},
        base="fixed",
    )
    + time(0, 2, 21)
)
SWUNG = (
    toml("pair", u1=[0.5, 0.2, 0.1], u2=[-0.25, 0.1, 0.3], n=[1, 2, 0])
    + toml("constants", speed=1.5, twice="2*speed", swing="sin(speed*t)")
    + moved(0, 3, 31, x="twice*t", phi_x="swing", phi_y="swing**2", psi="t")
)
PAYLOADS = {"mass": [0.5, 2], "centre_of_mass[1]": [0, 0.1], "inertia[2]": [0.01, 0.02]}
TOGETHER = {
    "geometry": ("landing_gear", {"pair.u1[0]": [0.3, 0.4], "pair.n[2]": [0.1, 0.2]}, ["R2", "hinge_torque"]),
    "masses": ("landing_gear", {"pair.body2.mass": [15, 21, 30], "pair.body1.mass": [900, 1000]}, ["force1", "psi"]),
    "motion": ("reference_2d", {"constants.swing": [0.1, 0.9], "motion.x": [0, 1]}, ["R2", "psi", "q"]),
    "payload": (
        "sweeps/panda_reach",
        {f"mechanism.payload.panda_hand.{key}": own for key, own in PAYLOADS.items()},
        ["tau", "force1", "torque1", "R", "q"],
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", TOGETHER)
def test_variants_that_are_computed_together_are_those_of_the_scenes(kind, monkeypatch):
    name, values, outputs = TOGETHER[kind]
    scene = hp.load_scene(MODELS / f"{name}.toml")
    monkeypatch.setattr(Variants, "compute", lambda *_: pytest.fail("computed by itself"))
    found = hp.vary(scene, values, outputs)
    assert [*found.sizes][: len(values)] == [*values]
    assert (found.reason.values == "").all()
    for place in np.ndindex(*map(len, values.values())):
        chosen = {key: own[i] for i, (key, own) in zip(place, values.items(), strict=True)}
        for output, array in scene.with_values(chosen).arrays(outputs).items():
            size = 1e-13 * max(1.0, np.abs(array).max())
            np.testing.assert_allclose(found[output].values[place], array, rtol=0, atol=size)


def test_constants_may_depend_on_time(tmp_path):
    scene = scene_of(tmp_path, SWUNG)
    written = (
        SWUNG.replace('"swing"', '"sin(1.5*t)"').replace('"swing**2"', '"sin(1.5*t)**2"').replace("twice*t", "3*t")
    )
    (tmp_path / "plain.toml").write_text(written)
    np.testing.assert_array_equal(scene.evaluate().a2, hp.load_scene(tmp_path / "plain.toml").evaluate().a2)
    found = hp.vary(scene, {"constants.speed": [0.5, 1.5]}, ["a2"])
    assert_near(found.a2.values[1], scene.evaluate().a2, 64)
    for old, new, message in (
        ("sin(speed*t)", "sin(spede*t)", r"constants\.swing: unknown name 'spede'"),
        ("u1 = [0.5,", 'u1 = ["swing",', r"pair\.u1: expected a number: an expression without t"),
    ):
        (tmp_path / "bad.toml").write_text(SWUNG.replace(old, new))
        with pytest.raises(hp.SceneError, match=message):
            hp.load_scene(tmp_path / "bad.toml")


def test_a_variant_that_fails_says_why_and_ends_no_other(tmp_path):
    (tmp_path / "rod.toml").write_text(ROD)
    found = hp.vary(tmp_path / "rod.toml", {"dynamics.psi.damping": [-1.0, 0.1]}, ["psi"])
    assert np.isnan(found.psi.values[0]).all()
    assert np.isfinite(found.psi.values[1]).all()
    assert "damping: expected 0 or above" in str(found.reason.values[0])
    with pytest.raises(hp.ArgumentError, match=r"psi.damp'?.*|expected one of"):
        hp.vary(tmp_path / "rod.toml", {"dynamics.psi.damp": [1]}, ["psi"])


def test_motions_that_end_at_an_event_are_as_long_as_they_are(tmp_path):
    (tmp_path / "rod.toml").write_text(ROD.replace('base = "fixed"', 'base = "fixed"\nuntil = "psi - 2"'))
    found = hp.vary(tmp_path / "rod.toml", {"dynamics.psi.damping": [0.0, 1.0]}, ["psi"])
    ends = [np.isfinite(own).sum() for own in found.psi.values]
    assert ends[0] < ends[1]
    for i, damping in enumerate((0.0, 1.0)):
        scene = hp.load_scene(tmp_path / "rod.toml").with_values({"dynamics.psi.damping": damping})
        np.testing.assert_array_equal(found.t.values[i][: ends[i]], scene.t)
        np.testing.assert_array_equal(found.psi.values[i][: ends[i]], scene.evaluate(["psi"]).psi)
