"""The page on which a pair or a robot moves, in a browser where there is one."""

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
from hingepair.mechanism.mechanism import tree_of
from support.drawn import content_of
from support.scenes import logged, moved, scene_of, time, toml
from support.work import HANG

MODELS = Path(__file__).parents[2] / "models"
CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--window-size=900,600", "--enable-logging=stderr", "--virtual-time-budget=3000"),
)
in_a_browser = pytest.mark.skipif(CHROMIUM is None, reason="no browser: apt-get install chromium")
U = 2.0**-53
PAIR = hp.HingePair(u1=(1, 0, 0), u2=(-1, 0, 0), n=(0, 0, 1))


@pytest.fixture(scope="module")
def scene():
    return hp.load_scene(MODELS / "satellite_panel.toml")


def placements_of(content):
    """Rotations and origins of the base, as far as they are known."""
    matrices = np.array([m or [np.nan] * 16 for m in content["placements"]]).reshape(-1, 4, 4)
    return matrices[:, :3, :3], matrices[:, :3, 3]


def browse(page, tmp_path, *arguments):
    """Open a page, as it is or with a script, and return what the browser says."""
    path = tmp_path / "page.html"
    path.write_text(page)
    profile = f"--user-data-dir={tmp_path / 'profile'}"
    done = subprocess.run(
        [CHROMIUM, *FLAGS, profile, *arguments, path.as_uri()],
        capture_output=True,
        text=True,
        timeout=HANG,
        check=True,
    )
    assert "CONSOLE" not in done.stderr, done.stderr
    return done.stdout


def asked(page, tmp_path, script):
    """What a script returns on a page."""
    probe = f"""<script>
const probe = document.createElement("pre");
probe.id = "probe";
probe.textContent = JSON.stringify((() => {{ {script} }})());
document.body.append(probe);
</script></body>"""
    said = browse(page.html.replace("</body>", probe), tmp_path, "--dump-dom")
    return json.loads(unescape(re.search(r'<pre id="probe">(.*?)</pre>', said, re.DOTALL)[1]))


# ---------------------------------------------------------------- what a page holds


@pytest.mark.slow
def test_the_page_holds_the_motion_and_asks_for_nothing_else(scene):
    page = hp.view(scene)
    content = content_of(page)
    result = scene.evaluate(("R1", "S1", "psid", "omega1", "psi"))
    rows = np.searchsorted(scene.t, content["t"])
    S, R = placements_of(content)
    np.testing.assert_array_equal(S, result.state.S1[rows])
    np.testing.assert_allclose(R + content["origin"], result.state.R1[rows], rtol=8 * U)
    np.testing.assert_array_equal(np.array(content["q"])[:, 0], result.psi[rows])
    np.testing.assert_array_equal(np.array(content["qd"])[:, 0], result.psid[rows])
    np.testing.assert_array_equal(content["base_rates"]["omega"], result.state.omega1[rows])
    head = page.html[: page.html.index("<script>")] + page.html[page.html.index("</script>") :]
    assert not re.search(r"(src|href)\s*=\s*[\"']?(https?:)?//", head)


def test_a_pair_is_a_mechanism_of_one_joint_whose_base_is_body_1(scene):
    content, pair = content_of(hp.view(scene)), scene.pair
    (joint,) = content["joints"]
    assert (joint["axis"], joint["parent"], joint["u"]) == ([1, 0], 0, pair.u1.tolist())
    assert joint["S"] == pair.home.ravel().tolist()
    np.testing.assert_allclose(pair.home @ joint["n"], pair.n, atol=4 * U)
    frames = {frame["name"]: frame for frame in content["frames"]}
    assert (frames["body 1"]["body"], frames["hinge"]["R"]) == (0, [0, 0, 0])
    np.testing.assert_array_equal(frames["body 2"]["R"], -pair.u2)
    assert content["path_colours"].keys() == {"body 1", "hinge", "body 2"}
    assert content["frame"] == "body 2"


def test_shapes_are_drawn_where_they_are():
    """Three.js has the axis of a cylinder along y; body 2 of a page has its origin at the hinge point."""
    axes = hp.rodrigues((1, 2, 3), 0.5)
    one = hp.Cylinder(0.3, 0.8, (0, 3, 4), (1, 2, -2)), hp.Box((2, 4, 5), (1, 0, -2), axes), hp.Sphere(7, (0, 1, 0))
    body = hp.Body(mass=1, shapes=one)
    pair = hp.HingePair(u1=(0, 1, 0), u2=(0, 0, 1), n=(0, 0, 1), body1=body, body2=body)
    for number, center in enumerate(((0, 0, 0), (0, 0, -1))):
        shapes = content_of(hp.view(pair))["bodies"][number]["shapes"]
        placed = np.array([shape.pop("placement") for shape in shapes]).reshape(-1, 4, 4)
        colour = {"colour": ("#4477aa", "#ee7733")[number]}
        assert shapes == [
            {"kind": "cylinder", "radius": 0.3, "length": 0.8} | colour,
            {"kind": "box", "size": [2, 4, 5]} | colour,
            {"kind": "sphere", "radius": 7} | colour,
        ]
        centers = np.array([(0, 3, 4), (1, 0, -2), (0, 1, 0)])
        np.testing.assert_array_equal(placed[:, :3, 3], centers + center)
        np.testing.assert_allclose(placed[0, :3, 1], np.array([1, 2, -2]) / 3, rtol=8 * U)
        np.testing.assert_allclose(placed[0, :3, :3] @ placed[0, :3, :3].T, np.eye(3), atol=8 * U)
        assert np.linalg.det(placed[0]) == pytest.approx(1, abs=8 * U)
        np.testing.assert_array_equal(placed[1:, :3, :3], [axes, np.eye(3)])


def test_a_gap_hides_the_bodies_and_a_title_is_only_text(tmp_path):
    log = "t,x,y,z,phi_x,phi_y,phi_z,psi\n" + "".join(
        f"{i / 10},{'nan' if i == 3 else i},0,0,0,0,0,{'nan' if i == 5 else i}\n" for i in range(8)
    )
    (tmp_path / "log.csv").write_text(log)
    title = "</script><script>alert(1)</script>"
    scene = scene_of(tmp_path, f"title = '{title}'\n" + logged([1, 0, 0], [0, 1, 0], [0, 0, 1]))
    page = hp.view(scene, tmp_path / "page.html")
    content = content_of(page)
    assert [place for place, matrix in enumerate(content["placements"]) if matrix is None] == [3]
    assert [place for place, q in enumerate(content["q"]) if q == [None]] == [5]
    assert title not in page.html
    assert (tmp_path / "page.html").read_text() == page.html


# ---------------------------------------------------------------- robots


@pytest.mark.slow
def test_a_robot_brings_its_constants_and_a_slider_for_each_coordinate():
    robot = hp.load_robot("panda")
    page = hp.view(robot)
    content = content_of(page)
    assert repr(page) == "Page(panda, joints=8)"
    assert (content["t"], content["q"], content["placements"]) == ([], [], [np.eye(4).ravel().tolist()])
    for joint, own in zip(content["joints"], tree_of(robot).joints, strict=True):
        assert (joint["name"], tuple(joint["axis"]), joint["parent"]) == (own.name, own.axis, own.parent)
        assert (joint["u"], joint["n"], joint["S"]) == (own.u.tolist(), own.n.tolist(), own.S.ravel().tolist())
    assert [joint["coordinate"] for joint in content["joints"]] == [*range(8), 7]
    sliders = content["coordinates"]
    assert tuple(slider["name"] for slider in sliders) == robot.names
    limits = [[slider["first"], slider["last"]] for slider in sliders]
    np.testing.assert_array_equal(limits, robot.position_limits)
    neutral = [slider["neutral"] for slider in sliders]
    np.testing.assert_array_equal(neutral, np.clip(0, *robot.position_limits.T))
    assert {frame["name"] for frame in content["frames"]} == {*robot.links, *tree_of(robot).frames}
    assert content["frame"] == "panda_leftfinger"  # of the tips, the first behind the most joints


@pytest.mark.slow
def test_a_motion_of_a_robot_is_played_at_its_instants():
    robot = hp.load_robot("panda", locked={"panda_finger_joint1": 0.02})
    q = np.random.default_rng(1).uniform(-1, 1, (5001, 7))
    page = hp.view(robot, q=q, t=np.linspace(3, 4, 5001))
    assert page.samples == 5001
    assert 2000 <= page.frames <= 2200  # those that are furthest beyond the limits beside 2,000
    content = content_of(page)
    rows = np.searchsorted(np.linspace(3, 4, 5001), content["t"])
    assert (rows[0], rows[-1]) == (0, 5000)
    np.testing.assert_array_equal(content["q"], q[rows])
    np.testing.assert_array_equal(content_of(hp.view(robot, q=q[:4]))["t"], np.arange(4) / 30)
    table = pytest.importorskip("pandas").DataFrame(q[:4, ::-1], columns=robot.names[::-1])
    np.testing.assert_array_equal(content_of(hp.view(robot, q=table))["q"], q[:4])


@pytest.mark.slow
def test_the_base_of_a_robot_stands_or_moves_as_it_is_told():
    robot = hp.load_robot("panda", locked={"panda_finger_joint1": 0.02})
    q = np.random.default_rng(1).uniform(-1, 1, (4, 7))
    heights, turn = np.outer(np.arange(4), (0, 0, 0.5)), hp.rodrigues((0, 0, 1), 0.3)
    for R in (heights, heights[1]):
        page = hp.view(robot, q=q, base_motion=hp.BodyMotion(R=R, S=turn))
        content = content_of(page)
        places = np.array(content["placements"]).reshape(-1, 4, 4)
        assert len(places) == (4 if R.ndim == 2 else 1)
        np.testing.assert_array_equal(places[:, :3, 3] + content["origin"], np.atleast_2d(R))
        np.testing.assert_array_equal(places[:, :3, :3], np.broadcast_to(turn, (len(places), 3, 3)))
    still = content_of(hp.view(robot, base_motion=hp.BodyMotion(R=(1, 2, 3), S=turn)))
    assert still["origin"] == [1, 2, 3]


SCENE = (
    'title = "A crane on a cart"\n'
    + toml("mechanism", urdf="crane.urdf")
    + toml("mechanism.frames.hook", link="tip", R=[0.5, 0, 0])
    + toml("motion", turn="sin(t)", x="2*t", y="1", phi_z="t")
    + time(0, 2, 21)
)


@pytest.mark.slow
def test_a_scene_of_a_mechanism_is_played_with_its_base_and_its_frame(tmp_path):
    turn = hp.HingePair(u1=(0, 0, 1), u2=(0, 0, 0), n=(0, 0, 1), name="turn")
    tip = hp.HingePair(u1=(1, 0, 0), u2=(0, 0, 0), n=(0, 1, 0), name="tip")
    (tmp_path / "crane.urdf").write_text(hp.to_urdf(hp.Mechanism([turn, tip])))
    scene = scene_of(tmp_path, SCENE)
    page = hp.view(scene, tmp_path / "crane.html")
    content = content_of(page)
    assert repr(page) == "Page(A crane on a cart, frames=21)"
    assert content_of(hp.view(scene.evaluate())) == content
    assert content["frame"] == "hook"
    np.testing.assert_array_equal(content["t"], scene.t)
    np.testing.assert_array_equal(content["q"], scene.coordinates()[0])
    S, R = placements_of(content)
    np.testing.assert_array_equal(R + content["origin"], scene.known(slice(None), 2).base_motion.R)
    np.testing.assert_array_equal(S, scene.known(slice(None), 2).base_motion.S)
    (tmp_path / "still.toml").write_text(re.sub(r"(?m)^(x|y|phi_z) = .*\n", "", SCENE))
    assert len(content_of(hp.view(hp.load_scene(tmp_path / "still.toml")))["placements"]) == 1
    (tmp_path / "turned.toml").write_text(SCENE.replace('x = "2*t"\n', ""))
    turned = placements_of(content_of(hp.view(hp.load_scene(tmp_path / "turned.toml"))))
    np.testing.assert_array_equal(turned[0], S)


# ---------------------------------------------------------------- in a browser


def test_a_page_has_the_units_of_the_scene_and_an_offset_of_late_instants(tmp_path):
    text = toml("pair", u1=[0, 0, 0], u2=[1, 0, 0], n=[0, 0, 1]) + toml("outputs", units="mm, rad")
    scene = scene_of(tmp_path, text + moved(1718000000, 1718000010, 11, psi="t - 1718000000"))
    own, other = content_of(hp.view(scene)), content_of(hp.view(scene, units="km"))
    assert own["units"]["m/s"] == ["mm/s", 1000]
    assert own["angle"] == ["rad", 1]
    assert other["units"]["m"] == ["km", 1e-3]
    assert other["angle"] == ["deg", pytest.approx(180 / np.pi, rel=2 * U)]
    assert own["since"] == {"offset": 1718000000, "name": "t - 1718000000 s"}


MOVED = """
const byId = (id) => document.getElementById(id), { bodies, content, frames } = window.hingepair;
const matrices = () => bodies.map((body) => body.matrix.elements.slice());
const neutral = matrices(), texts = [...document.querySelectorAll(".joint output")].map((one) => one.textContent);
const set = (i, value) => {
  byId(`joint${i}`).value = value;
  byId(`joint${i}`).dispatchEvent(new Event("input"));
};
VALUES.forEach((value, i) => set(i, value));
const moved = matrices(), shown = [...document.querySelectorAll(".joint output")].map((one) => one.textContent);
const spoken = byId("joint7").getAttribute("aria-valuetext");
const position = byId("position").textContent, values = VALUES.map((_, i) => Number(byId(`joint${i}`).value));
byId("reset").click();
return { neutral, texts, moved, shown, spoken, position, values, again: matrices(),
  labels: [...document.querySelectorAll(".joint label")].map((one) => one.textContent),
  keyboard: VALUES.every((_, i) => byId(`joint${i}`).tabIndex === 0) && byId("reset").tabIndex === 0,
  controls: byId("controls").hidden,
  asked: performance.getEntriesByType("resource").map((entry) => entry.name) };
"""


@in_a_browser
@pytest.mark.slow
def test_sliders_move_the_robot_and_reset_brings_it_back(tmp_path):
    robot = hp.load_robot("panda")
    lower, upper = robot.position_limits.T
    q = lower + (upper - lower) * np.linspace(0.1, 0.9, 8)
    found = asked(hp.view(robot, meshes=0), tmp_path, MOVED.replace("VALUES", json.dumps(q.tolist())))
    np.testing.assert_allclose(found["values"], q, rtol=1e-14)  # a browser's slider keeps fifteen digits
    for matrices, values in (("neutral", np.clip(0, lower, upper)), ("moved", found["values"])):
        joints = [joint.name for joint in tree_of(robot).joints]
        state = robot.forward_kinematics(values, frames=joints, outputs=("R", "S"))
        placed = np.array(found[matrices]).reshape(-1, 4, 4).swapaxes(1, 2)[1:]
        np.testing.assert_allclose(placed[:, :3, 3], state.R, rtol=0, atol=100 * U)
        np.testing.assert_allclose(placed[:, :3, :3], state.S, rtol=0, atol=100 * U)
    assert found["again"] == found["neutral"]
    assert found["labels"] == list(robot.names)
    assert found["texts"] == ["0.0°"] * 3 + ["-4.0°", "0.0°", "0.0°", "0.0°", "0.0000 m"]
    assert found["shown"] == [f"{np.degrees(value):.1f}°" for value in q[:7]] + ["0.0360 m"]
    assert found["spoken"] == "0.0360 m"
    tool = content_of(hp.view(robot))["frame"]
    R = robot.forward_kinematics(q, frames=tool)[tool].R
    np.testing.assert_allclose(
        list(map(float, found["position"].split()[1:4])), R, atol=1e-4
    )  # m: four digits are shown
    assert found["keyboard"]
    assert found["controls"]
    assert found["asked"] == []


FRAMED = """
const { viewer, bodies } = window.hingepair;
viewer.scene.updateMatrixWorld(true);
viewer.camera.updateMatrixWorld(true);
let most = 0, lowest = Infinity;
for (const body of bodies) body.traverse((one) => {
  if (!one.isMesh || one.material.isMeshBasicMaterial) return;
  const place = one.geometry.attributes.position, v = new THREE.Vector3();
  for (let i = 0; i < place.count; i++) {
    v.fromBufferAttribute(place, i).applyMatrix4(one.matrixWorld);
    lowest = Math.min(lowest, v.y);
    v.project(viewer.camera);
    most = Math.max(most, Math.abs(v.x), Math.abs(v.y), Math.abs(v.z));
  }
});
const grid = viewer.scene.children.find((one) => one.type === "GridHelper");
return { most, lowest, floor: grid.position.z, shown: grid.visible };
"""


def test_points_of_a_pair_are_frames_with_marks():
    pair = hp.HingePair((1, 0, 0), (-1, 0, 0), (0, 0, 1), points1={"pin": (0, 0, 2)}, points2={"tip": (0.5, 0, 0)})
    content = content_of(hp.view(pair))
    frames = {frame["name"]: (frame["body"], frame["R"]) for frame in content["frames"]}
    assert content["marks"] == ["tip", "pin"]
    assert content["frame"] == "tip"
    assert (frames["pin"], frames["tip"]) == ((0, [0, 0, 2]), (1, [1.5, 0, 0]))


@in_a_browser
@pytest.mark.proof
@pytest.mark.parametrize("name", ["talos_reduced", "go1"])
def test_the_camera_has_the_whole_robot_and_the_floor_is_below_it(name, tmp_path):
    found = asked(hp.view(hp.load_robot(name), meshes=0), tmp_path, FRAMED)
    assert 0.3 < found["most"] < 1
    assert found["shown"]
    assert found["floor"] <= 8192 * U
    assert found["lowest"] >= found["floor"] - 0.02
