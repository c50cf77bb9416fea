"""The page on which a pair moves, in a browser where there is one."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.sparse import sparse
from support.work import HANG

MODELS = Path(__file__).parents[2] / "models"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--window-size=900,600", "--enable-logging=stderr", "--virtual-time-budget=3000"),
)
PROBE = """<script>
const slider = document.getElementById("time");
slider.value = 700;
slider.dispatchEvent(new Event("input"));
const probe = document.createElement("pre");
probe.id = "probe";
probe.textContent = JSON.stringify({
  matrix: window.hingepair.bodies.body2.matrix.elements,
  numbers: document.getElementById("numbers").textContent,
  origin: window.hingepair.motion.origin,
  asked: performance.getEntriesByType("resource").map((entry) => entry.name),
});
document.body.append(probe);
</script>"""


@pytest.fixture(scope="module")
def scene():
    return hp.load_scene(MODELS / "satellite_panel.toml")


def motion_of(page):
    return json.loads(
        re.search(r'<script id="motion" type="application/json">(.*?)</script>', page.html, re.DOTALL)[1]
    )


def test_the_page_holds_the_motion_and_asks_for_nothing_else(scene):
    page = hp.view(scene)
    motion = motion_of(page)
    state = scene.evaluate(("R2", "S2", "v2", "omega2")).state
    rows = np.searchsorted(scene.times(), motion["t"])
    placements = np.array(motion["body2"]["placements"]).reshape(-1, 4, 4)
    np.testing.assert_array_equal(placements[:, :3, :3], state.S2[rows])
    np.testing.assert_allclose(placements[:, :3, 3] + motion["origin"], state.R2[rows], rtol=1e-15)
    np.testing.assert_array_equal(motion["v2"], state.v2[rows])
    head = page.html[: page.html.index("<script>")] + page.html[page.html.index("</script>") :]
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", head)


@pytest.mark.parametrize(
    "name", sparse(["talos_elbow", "reference_2d", "landing_gear", "spinning_satellite", "logged_arm"], 5)
)
def test_any_scene_is_shown(name):
    scene = hp.load_scene(MODELS / f"{name}.toml")
    motion = motion_of(hp.view(scene.evaluate()))
    assert len(motion["t"]) == min(scene.samples, 2000)
    assert motion["body1"]["shapes"]
    assert motion["title"] == scene.title


def test_a_trajectory_and_a_pair_are_shown():
    pair = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1), limits=(-0.5, 1))
    t = np.linspace(0, 1, 11)
    moved = hp.integrate(pair, t, omega1=(0, 0, 1), psid=np.cos, R1=np.stack([t, 0 * t, 0 * t], axis=-1))
    placements = np.array(motion_of(hp.view(moved))["body1"]["placements"]).reshape(-1, 4, 4)
    np.testing.assert_array_equal(placements[:, 0, 3], t)
    psi = motion_of(hp.view(pair))["psi"]
    assert (psi[0], psi[90], psi[-1]) == (-0.5, 1, -0.5)
    assert (min(psi), max(psi)) == (-0.5, 1)
    psi = motion_of(hp.view(hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))))["psi"]
    np.testing.assert_allclose(psi, np.linspace(-np.pi, np.pi, 181), atol=1e-15)


SHAPES = {  # of body 1 or 2, and how far they go from its reference point
    "cylinder": ((hp.Cylinder(0.3, 0.8, (0, 3, 4), (1, 2, 3)),), (), 5.5),
    "box": ((), (hp.Box((2, 4, 4), (0, 0, -2)),), 5.0),
    "sphere": ((hp.Sphere(0.1),), (hp.Sphere(7, (0, 1, 0)), hp.Sphere(2, (0, 5, 0))), 8.0),
    "small ones": ((hp.Sphere(0.1),), (hp.Cylinder(0.1, 0.1, (0, 0, 0), (0, 0, 1)),), 2.5),
}


@pytest.mark.parametrize(("one", "two", "reach"), SHAPES.values(), ids=SHAPES)
def test_the_camera_is_as_far_as_bodies_and_paths_need(one, two, reach):
    """The numbers of a page beside its motion: levers of 1 and 1.5 m, body 1 along x from 100 m to 103 m."""
    bodies = {name: hp.Body(mass=1, shapes=shapes) for name, shapes in (("body1", one), ("body2", two)) if shapes}
    pair = hp.HingePair(u1=(0, 1, 0), u2=(0, 0, 1.5), n=(0, 0, 1), **bodies)
    t = np.linspace(0, 1, 11)
    R1 = np.stack([100 + 3 * t, 0 * t, 0 * t], axis=-1)
    motion = motion_of(hp.view(hp.integrate(pair, t, omega1=(0, 0, 0), psid=0.0, R1=R1)))
    assert (motion["size"], motion["origin"]) == (2.5, [100, 0, 0])
    assert motion["reach"] == pytest.approx(reach, rel=1e-15)
    assert motion["extent"] == pytest.approx(max(reach, (3**2 + 1 + 1.5**2) ** 0.5), rel=1e-15)
    np.testing.assert_allclose(motion["centre"], (1.5, 0.5, -0.75), rtol=1e-15)
    assert (motion["axis"], motion["hinge"]) == ([0, 0, 1], [0, 1, 0])


def test_shapes_are_drawn_where_they_are():
    """Three.js has the axis of a cylinder along y."""
    turned = hp.rodrigues((1, 2, 3), 0.5)
    one = hp.Cylinder(0.3, 0.8, (0, 3, 4), (1, 2, -2)), hp.Box((2, 4, 5), (1, 0, -2), turned), hp.Sphere(7, (0, 1, 0))
    pair = hp.HingePair(u1=(0, 1, 0), u2=(0, 0, 1), n=(0, 0, 1), body1=hp.Body(mass=1, shapes=one))
    shapes = motion_of(hp.view(pair))["body1"]["shapes"]
    placed = np.array([shape.pop("placement") for shape in shapes]).reshape(-1, 4, 4)
    assert shapes == [
        {"kind": "cylinder", "radius": 0.3, "length": 0.8},
        {"kind": "box", "size": [2, 4, 5]},
        {"kind": "sphere", "radius": 7},
    ]
    np.testing.assert_array_equal(placed[:, :, 3], [(0, 3, 4, 1), (1, 0, -2, 1), (0, 1, 0, 1)])
    np.testing.assert_allclose(placed[0, :3, 1], np.array([1, 2, -2]) / 3, rtol=1e-15)
    np.testing.assert_allclose(placed[0, :3, :3] @ placed[0, :3, :3].T, np.eye(3), atol=1e-15)
    assert np.linalg.det(placed[0]) == pytest.approx(1)
    np.testing.assert_array_equal(placed[1:, :3, :3], [turned, np.eye(3)])


def test_a_page_says_of_how_many_instants_it_shows_some(scene):
    short = hp.view(hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1)))
    assert (short.frames, short.samples, motion_of(short)["shown"]) == (181, 181, "181")
    page = hp.view(scene)
    assert (page.frames, page.samples) == (2000, scene.samples)
    assert motion_of(page)["shown"] == f"2000 of {scene.samples}"
    assert repr(page) == f"Page({scene.title}, frames=2000 of {scene.samples})"


def test_a_gap_hides_the_body_and_a_title_is_only_text(tmp_path):
    log = "t,x,y,z,phi_x,phi_y,phi_z,psi\n" + "".join(
        f"{i / 10},{'nan' if i == 3 else i},0,0,0,0,0,{i}\n" for i in range(8)
    )
    (tmp_path / "log.csv").write_text(log)
    title = "</script><script>alert(1)</script>"
    text = f"title = '{title}'\n[pair]\nu1 = [1, 0, 0]\nu2 = [0, 1, 0]\nn = [0, 0, 1]\n[motion]\nfile = 'log.csv'\n"
    (tmp_path / "scene.toml").write_text(text)
    page = hp.view(hp.load_scene(tmp_path / "scene.toml"), tmp_path / "page.html")
    assert motion_of(page)["body2"]["placements"][3] is None
    assert title not in page.html
    assert (tmp_path / "page.html").read_text() == page.html


def test_what_cannot_be_shown_or_written_is_named(tmp_path):
    flat = hp.PlanarPair(u1=(1, 0), u2=(0, 1))
    with pytest.raises(hp.ArgumentError, match=r"^source: expected a pair in space"):
        hp.view(flat)
    with pytest.raises(hp.ArgumentError, match=r"^path: expected a file name that ends in \.html"):
        hp.view(flat.to_spatial(), tmp_path / "page.png")
    several = hp.HingePair(u1=np.zeros((2, 3)), u2=(1, 0, 0), n=(0, 0, 1))
    with pytest.raises(hp.ShapeError, match="pair"):
        hp.view(several)


@pytest.mark.skipif(CHROMIUM is None, reason="no browser: apt-get install chromium")
@pytest.mark.slow
def test_in_a_browser_the_slider_moves_body2_to_where_it_is(scene, tmp_path):
    page = hp.view(scene)
    path = tmp_path / "page.html"
    path.write_text(page.html.replace("</body>", PROBE + "</body>"))
    profile = f"--user-data-dir={tmp_path / 'profile'}"
    done = subprocess.run(
        [CHROMIUM, *FLAGS, profile, "--dump-dom", path.as_uri()],
        capture_output=True, text=True, timeout=HANG, check=True,
    )  # fmt: skip
    assert "CONSOLE" not in done.stderr, done.stderr
    found = json.loads(unescape(re.search(r'<pre id="probe">(.*?)</pre>', done.stdout, re.DOTALL)[1]))
    row = int(np.searchsorted(scene.times(), motion_of(page)["t"][700]))
    state = scene.evaluate(("R2", "S2")).state
    placement = np.array(found["matrix"]).reshape(4, 4).T
    np.testing.assert_array_equal(placement[:3, :3], state.S2[row])
    np.testing.assert_allclose(placement[:3, 3] + found["origin"], state.R2[row], rtol=1e-15)
    assert "omega2" in found["numbers"]
    assert found["asked"] == []


@pytest.mark.skipif(CHROMIUM is None, reason="no browser: apt-get install chromium")
@pytest.mark.slow
def test_in_a_browser_something_is_drawn(scene, tmp_path):
    from matplotlib.image import imread

    path, picture = hp.view(scene).save(tmp_path / "page.html"), tmp_path / "page.png"
    profile = f"--user-data-dir={tmp_path / 'profile'}"
    subprocess.run(
        [CHROMIUM, *FLAGS, profile, f"--screenshot={picture}", path.as_uri()],
        capture_output=True,
        timeout=HANG,
        check=True,
    )
    middle = imread(picture)[150:500, 150:750, :3]
    blue, orange = (middle[..., 2] - middle[..., 0] > 0.2), (middle[..., 0] - middle[..., 2] > 0.2)
    assert blue.sum() > 200
    assert orange.sum() > 200
