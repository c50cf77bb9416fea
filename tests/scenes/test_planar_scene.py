"""Scenes in the plane: `planar = true`, and scenes whose constants prove that all turns are about z."""

from __future__ import annotations

import re

import numpy as np
import pytest

import hingepair as hp
from hingepair.mechanism.states import PlanarState
from support.near import U, assert_near
from support.scenes import scene_of, time, toml

PLANAR_MOTION_KIND = (
    "planar = true\n"
    + toml("pair", u1=[0.5, 0.2], u2=[-0.25, 0.1], name="legs")
    + toml("motion", x="3*t", y=0.5, phi="0.3*t**2", psi="sin(t)")
    + time(0, 2, 21)
)


@pytest.mark.slow
def test_is_the_scene_in_space(tmp_path):
    in_space = (
        PLANAR_MOTION_KIND.replace("planar = true", "")
        .replace("2]", "2, 0]")
        .replace("0.1]", "0.1, 0]\nn = [0, 0, 2]")
    )
    in_space = in_space.replace("phi =", "z = 0\nphi_x = 0\nphi_y = 0\nphi_z =")
    flat, space = (scene_of(tmp_path, text).evaluate() for text in (PLANAR_MOTION_KIND, in_space))
    assert isinstance(flat.state, PlanarState)
    for name in ("R2", "d", "v2", "a2"):
        np.testing.assert_allclose(getattr(flat, name), getattr(space, name)[:, :2], rtol=0, atol=64 * U)
    for name in ("omega2", "alpha2"):
        np.testing.assert_allclose(getattr(flat, name), getattr(space, name)[:, 2], rtol=0, atol=64 * U)


def test_body_1_rests_at_the_origin_where_psi_is_given_alone(tmp_path):
    still = 'x = "3*t"\ny = 0.5\nphi = "0.3*t**2"\n'
    alone = scene_of(tmp_path, PLANAR_MOTION_KIND.replace(still, ""))
    result = alone.evaluate()
    expected = alone.pair.forward_kinematics((0, 0, 0, np.sin(result.t)))
    assert_near(result.R2, expected.R2, 1.0)
    assert alone.cross_validate().ok


def test_names_its_own_coordinates_and_outputs(tmp_path):
    scene = scene_of(tmp_path, PLANAR_MOTION_KIND + '[outputs]\nnames = ["phi2", "R2"]\n')
    assert list(scene.expressions) == ["x", "y", "phi", "psi"]
    result = scene.evaluate()
    assert result.state.outputs == ("phi2", "R2")
    assert {"phi2", "R2"} <= set(dir(result))
    assert "S2" not in dir(result)
    np.testing.assert_array_equal(result.phi2, 0.3 * result.t**2 + np.sin(result.t))
    assert repr(scene.pair) == "PlanarPair(u1=[0.5, 0.2], u2=[-0.25, 0.1], name='legs')"
    assert (scene.space.n.tolist(), scene.space.name) == ([0, 0, 1], "legs")


def test_what_a_planar_scene_writes_is_a_log(tmp_path):
    scene = scene_of(tmp_path, PLANAR_MOTION_KIND)
    result = scene.evaluate(("q", "qd", "qdd"))
    result.save(tmp_path / "my  log.csv")
    pair = "[pair]\nu1 = [0.5, 0.2, 0]\nu2 = [-0.25, 0.1, 0]\nn = [0, 0, 1]\n"
    (tmp_path / "back.toml").write_text(f'{pair}[motion]\nfile = "my  log.csv"\n')  # two blanks in its name
    back = hp.load_scene(tmp_path / "back.toml").evaluate(("psi", "R1", "omega1"))
    np.testing.assert_array_equal(back.psi, result.psi)
    np.testing.assert_array_equal(back.R1[:, :2], result.q[:, :2])
    assert_near(back.omega1[:, 2], result.qd[:, 2], 4)


def test_gravity_that_nobody_gave_is_told_unless_it_made_the_motion(tmp_path):
    body = "body2 = { mass = 1, inertia = [1, 1, 1] }\n[motion]"
    text = PLANAR_MOTION_KIND.replace("[motion]", body)
    known = scene_of(tmp_path, text)
    simulated = scene_of(
        tmp_path, re.sub(r"\[motion\].*\[time\]", "[dynamics]\nbase = 'fixed'\n[time]", text, flags=re.S)
    )
    told = [any("gravity is taken" in note for note in notes) for notes in (
        known.forces().notes, known.forces((0, -1)).notes, simulated.forces().notes
    )]  # fmt: skip
    assert told == [True, False, False]
