"""Points of a scene's bodies: named in the file, found in every result by name."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

import hingepair as hp
from support.near import U
from support.scenes import moved, toml

mpl.use("Agg")

HATCH = (
    'title = "A hatch opens"\n'
    + toml("pair", u1=[0.4, 0, 1.2], u2=[-0.6, 0, 0], n=[0, -1, 0])
    + toml("pair.points1", catch=[1.6, 0, 1.2])
    + toml("pair.points2", handle=[0.55, 0.1, 0.05], edge=["1.2/2", 0.25, 0])
    + moved(0, 1, 11, phi_z="0.1*t", psi="t")
)
HANDLE = np.array((0.55, 0.1, 0.05))


@pytest.fixture
def hatch(tmp_path: Path) -> Path:
    path = tmp_path / "hatch.toml"
    path.write_text(HATCH)
    return path


def test_results_have_points_by_name(hatch):
    scene = hp.load_scene(hatch)
    result = scene.evaluate()
    state = result.state
    arm = state.S2 @ HANDLE
    assert abs(result["handle"].R - (state.R2 + arm)).max() <= 8 * U
    assert abs(result["handle"].v - (state.v2 + np.cross(state.omega2, arm))).max() <= 8 * U
    assert result["catch"].a.shape == (11, 3)
    names = [*result.requested_arrays()]
    assert names[-12:-3] == [point + end for point in ("catch", "handle", "edge") for end in ("", "_v", "_a")]
    (blocks,) = scene.blocks(("edge",))
    assert [*blocks.requested_arrays()] == ["edge"]
    assert blocks["edge"].v is None
    assert "computed: " in str(scene.plan(("edge",)))


def test_many_points_are_computed_without_a_kernel_of_all(hatch):
    """Beyond some sixty outputs of points, by NumPy from the motion of their bodies: the same to rounding."""
    few = hp.load_scene(hatch).evaluate()
    more = "".join(f"p{k} = [{k / 100}, 0.1, 0.05]\n" for k in range(30))
    hatch.write_text(hatch.read_text().replace("[pair.points2]\n", "[pair.points2]\n" + more))
    many = hp.load_scene(hatch).evaluate()
    assert many["p29"].a.shape == (11, 3)
    for name in ("handle", "handle_v", "handle_a", "catch_a", "R2", "a2"):
        expected = few.requested_arrays()[name]
        size = 16 * 2.0**-53 * (1 + np.abs(expected).max())
        np.testing.assert_allclose(many.requested_arrays()[name], expected, rtol=0, atol=size)


def test_sweeps_and_searches_take_components_of_points(hatch):
    """Along the lid the handle stands at the distance x, and 0.05 above it."""
    found = hp.search(hatch, "pair.points2.handle[0]", "handle_z_max = 2.5")
    x, angle = found.values["pair.points2.handle[0]"], 1.0
    assert found.ok
    assert 1.2 + (0.6 + x) * np.sin(angle) + 0.05 * np.cos(angle) == pytest.approx(2.5, rel=64 * U)


def test_planar_scenes_have_points(tmp_path):
    flat = tmp_path / "flat.toml"
    time = "[time]\nstart = 0\nstop = 1\nsamples = 3\n"
    pair = "[pair]\nu1 = [1, 0]\nu2 = [-1, 0]\npoints2 = { tip = [0.5, 0.25] }\n"
    flat.write_text(f"planar = true\n{pair}[motion]\nx = 0\ny = 0\nphi = 0\npsi = 't'\n{time}")
    result = hp.load_scene(flat).evaluate(("tip", "tip_v"))
    c, s = np.cos(result.t), np.sin(result.t)
    expected = np.stack([1 + 1.5 * c - 0.25 * s, 1.5 * s + 0.25 * c], axis=-1)
    assert abs(result["tip"].R - expected).max() <= 8 * U
    assert hp.load_scene(flat).unit("tip_v_x") == "m/s"
