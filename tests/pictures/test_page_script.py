"""What the page computes, run by node: poses and rates as the library has them; what is missing stays missing."""

from __future__ import annotations

import json
import shutil
import subprocess
from importlib.resources import files

import numpy as np
import pytest

import hingepair as hp
from support.drawn import content_of
from support.linkages import four_bar
from support.sparse import sparse

NODE = shutil.which("node")
by_node = pytest.mark.skipif(NODE is None, reason="node is not installed: the script of the page is NOT tested")
U = 2.0**-53
LOG = "t,a,ad,add\n0,0.6,1,0\n0.1,0.7,1,0\n0.2,0.8,,0\n0.3,0.9,1,0\n0.4,1,1,0\n0.5,,,\n0.6,2.5,1,0\n"
TURN = '[[joint]]\nname = "a"\nu1 = [0, 0, 0]\nu2 = [0, 0, 0]\nn = [0, 0, 1]\nlimits = [0.5, 2]\n'
MASS = "body2 = { mass = 1, inertia = [1, 1, 1] }\n"
SECOND = "[time]\nstart = 0\nstop = 1\nsamples = 6\n"
CYLINDER = (
    '[mechanism]\ncoordinates = ["cylinder"]\nat = { a = 0.9 }\nframes = { foot = { link = "base", R = [1, 0, 0] }, '
    'eye = { link = "a", R = [0.8, 0, 0] } }\n[[strut]]\nname = "cylinder"\nframe1 = "foot"\nframe2 = "eye"\n'
)


def computed(page, code):
    """What an expression of JavaScript is worth beside the content of a page; null where a number is NaN."""
    script = files("hingepair.pictures").joinpath("kinematics.js").read_text("utf-8")
    text = f"const content = {json.dumps(content_of(page))};\n{script}\nconsole.log(JSON.stringify({code}))"
    done = subprocess.run([NODE, "-"], input=text, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def robot_of_all_kinds():
    """Hinges and a slider with oblique axes, and a tool."""
    turn = hp.rodrigues((1, 2, 3), 0.7)
    pairs = [
        hp.HingePair(u1=(0, 0.1, 1), u2=(0.2, 0, 0), n=(1, 2, -1), home=turn, name="hinge"),
        hp.Slider(u1=(0.5, 0, 0), u2=(0, 0, 0.1), n=(0, 1, 1), name="slider"),
        hp.HingePair(u1=(0.3, 0, 0.2), u2=(0, 0, 0), n=(0, 0, 1), name="wrist"),
    ]
    return hp.Mechanism(pairs, name="kinds").with_frame("tool", link="wrist", R=(0, 0.1, 0.2), S=turn)


def following_robot():
    """A hinge and a hinge that follows it, with oblique axes and attitudes."""
    home = hp.rodrigues((1, 2, -1), 0.7)
    lead = hp.HingePair(u1=(0, 0.2, 1), u2=(0, 0, 0), n=(0, 1, 0.5), home=home, name="lead")
    tip = hp.HingePair(u1=(1, 0, 0.3), u2=(0, 0, 0), n=(1, 0.2, 1), home=home.T, name="tip")
    text, joint = hp.to_urdf(hp.Mechanism([lead, tip])), '<joint name="tip" type="continuous">'
    return hp.Mechanism.from_urdf(text.replace(joint, joint + '<mimic joint="lead" multiplier="-2" offset="0.5"/>'))


@by_node
@pytest.mark.parametrize(
    "name", ["kinds", "following", "panda", pytest.param("talos_full_v2", marks=pytest.mark.slow)]
)
def test_the_page_computes_the_poses_that_the_mechanism_has(name):
    made = {"kinds": robot_of_all_kinds, "following": following_robot}
    robot = made[name]() if name in made else hp.load_robot(name)
    frames = ("tool",) if name == "kinds" else robot.tips
    q = np.random.default_rng(3).uniform(-3, 3, (4, robot.dof))
    base = hp.BodyMotion(R=(1, -2, 0.5), S=hp.rodrigues((0, 1, 1), 0.3))
    page = hp.view(robot, q=q, base_motion=base, meshes=0)
    code = "content.q.map((q, k) => { const poses = bodyPoses(baseAt(k), q);"
    code += f" return {json.dumps(frames)}.map((name) =>"
    code += " framePose(poses, content.frames.find((frame) => frame.name === name))); })"
    origin, poses = np.array(content_of(page)["origin"]), computed(page, code)
    state = robot.forward_kinematics(q, frames=frames, base_motion=base, outputs=("R", "S"))
    for k, found in enumerate(poses):
        for frame, pose in zip(frames, found, strict=True):
            scale = max(1.0, np.abs(state.R).max())
            np.testing.assert_allclose(pose["R"] + origin, state[frame].R[k], rtol=0, atol=400 * U * scale)
            np.testing.assert_allclose(np.reshape(pose["S"], (3, 3)), state[frame].S[k], rtol=0, atol=400 * U)


@by_node
@pytest.mark.parametrize("kind", sparse(["of a free base", "with a cylinder"], 2))
def test_the_page_moves_what_loops_close(kind, tmp_path):
    if kind == "of a free base":
        source = found = hp.simulate(four_bar(base="free"), np.linspace(0, 1, 6), [0.3], [2.0])
        robot, q, qd, base = found.robot, found.q, found.qd, found.base_motion
    else:
        (tmp_path / "s.toml").write_text(CYLINDER + TURN + '[motion]\ncylinder = "0.8 + 0.2*t"\n' + SECOND)
        source = hp.load_scene(tmp_path / "s.toml")
        robot, (q, qd, _), base = source.mechanism, source.coordinates(), None
    page = hp.view(source)
    content = content_of(page)
    assert all(len(row) == len(content["coordinates"]) == robot.opened().dof for row in content["q"])
    names = ["eye"] if kind == "with a cylinder" else ["a", "b"]
    frames = [next(one for one in content["frames"] if one["name"] == name) for name in names]
    code = "content.t.map((t, k) => { const poses = bodyPoses(baseAt(k), content.q[k]), rates = bodyRates(poses, k);"
    code += f" return {json.dumps(frames)}.map((one) => [framePose(poses, one).R, rates[one.body].omega]); }})"
    state = robot.forward_kinematics(q, qd, frames=names, base_motion=base, outputs=("R", "omega"))
    wanted = [[state[name].R - np.array(content["origin"]), state[name].omega] for name in names]
    np.testing.assert_allclose(computed(page, code), np.moveaxis(wanted, 2, 0), rtol=0, atol=512 * U)


@by_node
def test_the_page_computes_rates_and_keeps_what_is_missing(tmp_path):
    """At 0.2 s the rate is missing, at 0.5 s all is: neither is 0, nor beyond its limits; 2.5 rad is."""
    (tmp_path / "log.csv").write_text(LOG)
    (tmp_path / "s.toml").write_text(TURN + MASS + '[motion]\nfile = "log.csv"\n')
    page = hp.view(hp.load_scene(tmp_path / "s.toml"))
    rates = computed(page, "content.t.map((t, k) => bodyRates(bodyPoses(baseAt(k), content.q[k]), k)[1].omega)")
    assert rates[1] == [0, 0, 1]
    assert rates[2] == rates[5] == [None, None, None]
    assert computed(page, "isKnown(bodyPoses(baseAt(5), content.q[5])[1])") is False
    (event,) = content_of(page)["events"]
    assert (event["name"], event["what"], event["first"], event["last"]) == ("a", "its limits", 0.6, 0.6)


def test_a_peak_of_one_sample_is_marked_and_shown():
    """Of 10,001 samples a page shows some 2,000: the sample beyond the limit is among them."""
    arm = hp.HingePair(
        (0, 0, 0), (0, 0, 0), (0, 0, 1), name="a", torque_limit=10, body2=hp.Body(1, inertia=(1, 1, 1))
    )
    t, tau = np.linspace(0, 10, 10_001), np.zeros((10_001, 1))
    tau[5003] = 100  # N m
    tau[7001:7006, 0] = (-11, -12, np.nan, -30, -11)
    content = content_of(hp.view(hp.Mechanism([arm]), q=0 * tau, t=t, tau=tau))
    assert (np.nanmax(np.array(content["tau"], float)), np.nanmin(np.array(content["tau"], float))) == (100, -30)
    assert [(event["what"], event["first"], event["last"]) for event in content["events"]] == [
        ("its torque", t[5003], t[5003]),
        ("its torque", t[7001], t[7002]),
        ("its torque", t[7004], t[7005]),
    ]
    assert 2000 < len(content["t"]) <= 2003


@by_node
def test_numbers_of_any_size_take_nine_characters():
    page = hp.view(hp.HingePair((1, 0, 0), (0, 0, 0), (0, 0, 1)))
    texts = computed(page, "[null, 0, -0.5, 123456.7, 1e-7, 5334760.5, 1e12].map(formatNumber)")
    assert [text.strip() for text in texts] == [
        "-",
        "0.00000",
        "-0.50000",
        "123456.70",
        "1.0e-7",
        "5334760.5",
        "1.0e+12",
    ]
    assert {len(text) for text in texts} <= {9, 10}
    assert computed(page, "[-1, 0, 3, 100].map(frameAt)") == [0, 0, 90, 180]
