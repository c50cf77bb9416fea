"""What a scene's [dynamics] says goes into the exports, as far as a format has a place for it; the rest is listed."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from support.commands import run_command
from support.near import U
from support.scenes import time, toml

pytestmark = pytest.mark.filterwarnings("ignore:.*no mass properties:hingepair.DynamicsWarning")

PAIR = """
[pair]
u1 = [0.3, 0.1, 0.2]
u2 = [0.45, 0, 0.1]
n = [0, 1, 0.4]
home = { axis = [0, 0, 1], deg = 20 }
limits = [-3, 3]
body1 = { mass = 2, centre_of_mass = [0.1, 0, 0.1], inertia = [0.2, 0.3, 0.35] }
body2 = { mass = 1.5, centre_of_mass = [0.05, 0, 0], inertia = [0.1, 0.2, 0.25] }
"""
TIME = time(0, 1, 11)
START = "R1_0 = [1, 2, 3]\nS1_0 = { axis = [1, 2, 0.5], deg = 70 }\n"


def exported(folder, command, text, *options):
    """What the command writes."""
    (folder / "scene.toml").write_text(text)
    return run_command(command, folder / "scene.toml", *options).stdout


def moved_by_mujoco(text, t, qvel):
    """The hinge angle at the instants, from rest but for the velocities of joints."""
    import mujoco

    model = mujoco.MjModel.from_xml_string(text)
    model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 1e-3
    data = mujoco.MjData(model)
    data.qvel[:] = qvel
    found = []
    for instant in t:
        while data.time < instant - 5e-4:  # half a step
            mujoco.mj_step(model, data)
        found.append(data.qpos[-1])
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("base", ["fixed", "pinned", "free"])
def test_mujoco_moves_the_model_as_the_scene_moves(tmp_path, base):
    table = f'[dynamics]\nbase = "{base}"\npsi.stiffness = 3\npsi.rest = 0.4\npsi.damping = 0.2\n{START}'
    text = PAIR + table + "psi.qd_0 = 1.5\n" + TIME
    model = exported(tmp_path, "mjcf", text)
    scene = hp.load_scene(tmp_path / "scene.toml")
    start = [0.0] * {"fixed": 0, "pinned": 3, "free": 6}[base] + [1.5]
    found = moved_by_mujoco(model, scene.t, start)
    assert np.ptp(found) > 0.1
    np.testing.assert_allclose(found, scene.motion.source.psi, rtol=0, atol=1e-8)  # rad, of steps of 1 ms by MuJoCo


HINGE = {
    "q_0": 0.1, "stiffness": 2, "rest": 0.3, "damping": 0.5, "friction": 0.2, "friction_rate": 0.02, "stops": [-1, 1],
    "stop_stiffness": 500, "stop_damping": 20, "tau": "sin(t)",
}  # fmt: skip
WHOLE = toml("dynamics.wrenches.body2", force=[0, 0, 1])
WHOLE += toml("dynamics", base="fixed", gravity=[0, 0, -1.6], tol=1e-8) + START + toml("dynamics.psi", HINGE)


def test_mjcf_holds_spring_damping_friction_and_stops(tmp_path):
    text = exported(tmp_path, "mjcf", PAIR + WHOLE + TIME)
    root = ET.fromstring(text)
    joint = root.find(".//joint[@name='hinge']").attrib
    held = {"stiffness": "2.0", "springref": "0.3", "damping": "0.5", "frictionloss": "0.2", "range": "-1.0 1.0"}
    assert {key: joint[key] for key in held} == held
    assert root.find("option").get("gravity") == "0.0 0.0 -1.6"
    assert root.find(".//freejoint") is None
    assert root.find("worldbody/body").get("pos") == "1.0 2.0 3.0"


def test_urdf_holds_damping_friction_and_stops(tmp_path):
    text = exported(tmp_path, "urdf", PAIR + WHOLE + TIME)
    joint = ET.fromstring(text).find("joint[@name='hinge']")
    assert joint.find("dynamics").attrib == {"damping": "0.5", "friction": "0.2"}
    model = pin.buildModelFromXML(text)
    assert (model.damping.tolist(), model.friction.tolist(), model.nv) == ([0.5], [0.2], 1)
    assert (model.lowerPositionLimit[0], model.upperPositionLimit[0]) == (-1, 1)
    S = hp.rodrigues((1, 2, 0.5), np.deg2rad(70))
    place = model.jointPlacements[1]
    np.testing.assert_allclose(place.translation, np.array([1, 2, 3]) + S @ (0.3, 0.1, 0.2), rtol=0, atol=16 * U)


@pytest.mark.parametrize(
    ("command", "base", "expected"),
    [
        ("mjcf", "free", "freejoint"),
        ("mjcf", "pinned", "ball"),
        ("mjcf", "prescribed", None),
        ("urdf", "free", None),
        ("urdf", "pinned", None),
        ("urdf", "prescribed", "world"),
    ],
)
def test_the_base_is_that_of_the_scene(tmp_path, command, base, expected):
    place = "" if base == "prescribed" else START
    carried = "[motion]\nx = 't'\ny = 0\nz = 0\nphi_x = 0\nphi_y = 0\nphi_z = 0\n" * (base == "prescribed")
    text = PAIR + f'[dynamics]\nbase = "{base}"\n{place}' + carried + TIME
    root = ET.fromstring(exported(tmp_path, command, text))
    if command == "mjcf":
        kinds = [joint.get("type", joint.tag) for joint in root.findall("worldbody/body/*") if "joint" in joint.tag]
        assert kinds == ([expected] if expected else [])
    else:
        assert ("world" in {link.get("name") for link in root.findall("link")}) is (expected == "world")


BEAM = hp.HingePair((1, 0, 0), (0, 1, 0), (0, 0, 1))


@pytest.mark.parametrize("write", [hp.to_urdf, hp.to_mjcf])
def test_a_mass_that_nobody_gave_is_written_with_a_warning_or_not_at_all(write):
    lone = hp.HingePair(u1=(1, 0, 0), u2=(0, 1, 0), n=(0, 0, 1), body2=BEAM.body2 or hp.Body(2, inertia=(1, 1, 1)))
    with pytest.warns(hp.DynamicsWarning, match="^body1: no mass properties are given: 1 kg"):
        text = write(lone)
    assert "<!-- body1: no mass properties are given: 1 kg" in text
    masses = [
        element.get("value", element.get("mass"))
        for element in ET.fromstring(text).iter()
        if element.tag in {"mass", "inertial"}
    ]
    assert "1.0" in masses
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fixed = ET.fromstring(write(lone, base="fixed"))
    assert len(list(fixed.iter("inertial"))) == 1
