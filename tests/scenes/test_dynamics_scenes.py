"""Scenes whose motion is dynamics: the same as `simulate` finds, and forces that are those that act."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import hingepair as hp
from hingepair.formats.robots import robot_urdf
from support.near import U, assert_near
from support.scenes import scene_of, time, toml

MODELS = Path(__file__).parents[2] / "models"
PAIR = (
    toml("pair", u1=[0.4, 0, 0], u2=[-0.25, 0.1, 0.05], n=[0, 1, 0.3], limits=[-0.3, 0.3])
    + toml("pair.body1", mass=0.6, inertia=[0.02, 0.03, 0.04], centre_of_mass=[0.1, 0, 0])
    + toml("pair.body2", mass=1.1, inertia=[0.002, 0.02, 0.02])
    + time(0, 0.5, 11)
)
FREE = """
[dynamics]
R1_0 = [0, 0, 1.5]
omega1_0 = [0.5, 3, 1]
psi.qd_0 = -1
psi.tau = "0.05*sin(3*psi) - 0.01*psid + rate*t"
force1 = [0.1, "0.2*t", 0]
wrenches.body2.torque = [0, "0.1*psi", 0.2]
wrenches.body2.force = [0.3, 0, "0.1*psid"]
psi.damping = 0.02
[constants]
rate = 0.1
"""


@pytest.mark.slow
def test_a_free_scene_moves_as_simulate_says(tmp_path):
    scene = scene_of(tmp_path, PAIR + FREE)
    t = np.linspace(0, 0.5, 11)
    found = hp.simulate(
        scene.pair, t, hp.BodyMotion(R=(0, 0, 1.5), S=np.eye(3), omega=(0.5, 3, 1)), 0.0, -1.0,
        hinge_torque=lambda t, psi, psid: 0.05 * np.sin(3 * psi) - 0.03 * psid + 0.1 * t,
        force1=lambda t, _: np.stack([0.1 + 0 * t, 0.2 * t, 0 * t], -1),
        torque2=lambda _, now: np.stack([0 * now.psi, 0.1 * now.psi, 0.2 + 0 * now.psi], -1),
        force2=lambda _, now: np.stack([0.3 + 0 * now.psi, 0 * now.psi, 0.1 * now.psid], -1),
    )  # fmt: skip
    assert_near(scene.evaluate().R2, found.R2, 16)
    weight = 1.7 * 9.81  # N, of both bodies; levers are shorter than 1 m
    forces = scene.forces()  # what acted on body 2 is not asked of the hinge or of body 1 again
    assert_near(forces.hinge_torque, found.loads["hinge_torque"], 32, weight)
    assert_near(forces.force1, found.loads["force1"], 32, weight)
    assert_near(forces.torque1, 0, 32, weight)
    axis = found.S1 @ scene.pair.n
    assert_near((forces.bearing_torque * axis).sum(-1), 0, 32, weight)
    assert scene.cross_validate().ok
    assert "base free" in scene.motion.description


@pytest.mark.slow
def test_a_prescribed_base_carries_the_hinge(tmp_path):
    turn = "\n".join(
        f"{name} = {value}" for name, value in (("x", "'0.1*sin(6*t)'"), ("y", 0), ("z", 0), ("phi_x", 0))
    )
    motion = f"[motion]\nsequence = 'ZYX'\n{turn}\nphi_y = '0.4*t'\nphi_z = 't'\n"
    load = "[dynamics]\nbase = 'prescribed'\npsi.stiffness = 2\npsi.rest = 0.2\ngravity = [0, 0, -1.6]\n"
    scene = scene_of(tmp_path, PAIR + motion + load)
    forces, spring = scene.forces(), hp.HingeLoad(stiffness=2, rest=0.2)
    psi = scene.motion.simulated.q[:, 0]
    assert_near(forces.hinge_torque, spring(0, psi, 0), 32)
    other = "[motion]\nsequence = 'ZYX'\n" + turn + "\nphi_y = '0.4*t'\nphi_z = 't'\npsi = 0\n"
    expected = scene_of(tmp_path, PAIR + other).evaluate(("R1", "S1", "a1"))
    found = scene.evaluate(("R1", "S1", "a1"))
    for name in ("R1", "S1", "a1"):
        assert_near(getattr(found, name), getattr(expected, name), 16)
    with pytest.raises(hp.ArgumentError, match="gravity: expected None, since"):
        scene.forces((0, 0, 0))


@pytest.mark.slow
def test_a_double_pendulum_in_the_plane(tmp_path):
    text = PAIR.replace("[0.4, 0, 0]", "[0.4, 0]").replace("[-0.25, 0.1, 0.05]", "[0, 0]")
    text = text.replace("n = [0, 1, 0.3]\nlimits = [-0.3, 0.3]\n", "")
    scene = scene_of(
        tmp_path, "planar = true\n" + text + "[dynamics]\nbase = 'pinned'\nphi_0 = 0.3\ntorque1 = '0.1*t'\n"
    )
    np.testing.assert_array_equal(scene.motion.simulated.base_motion.R, 0)
    forces = scene.forces()
    assert forces.force1.shape == (11, 2)
    weight = 1.7 * 9.81  # N; levers are shorter than 1 m
    assert_near(forces.hinge_torque, 0, 16, weight)
    assert_near(forces.torque1, 0.1 * scene.motion.t, 16, weight)
    assert scene.cross_validate().ok


@pytest.mark.slow
def test_all_that_hangs_on_talos_elbow_is_body2():
    """As Pinocchio adds it up, with the joints beyond at 0."""
    model = pin.buildModelFromUrdf(str(robot_urdf("talos_reduced")), pin.JointModelFreeFlyer())
    data = model.createData()
    pin.crba(model, data, pin.neutral(model))
    arm = data.Ycrb[model.getJointId("arm_left_4_joint")]
    scene = hp.load_scene(MODELS / "talos_elbow.toml")
    body2 = scene.pair.body2
    digits = 1e-7  # of the scene's file
    assert body2.mass == pytest.approx(arm.mass, abs=digits)
    np.testing.assert_allclose(body2.centre_of_mass, arm.lever, rtol=0, atol=digits)
    np.testing.assert_allclose(body2.inertia, arm.inertia, rtol=0, atol=digits)
    assert 10 < np.abs(scene.forces().hinge_torque).max() < scene.pair.torque_limit


def test_a_scene_has_rigid_stops_and_breaks(tmp_path):
    motion = "[dynamics]\nbase = 'fixed'\ngravity = [0, 0, 0]\npsi.tau = '{}*(1 + 3*step(t - 0.25))'\n"
    keys = "psi.stops = [-1, 1]\npsi.stop_restitution = 0.0\nbreaks = [0.25]\n"
    found = scene_of(tmp_path, PAIR + motion.format(1) + keys).motion.simulated
    slow, quick = (float(found.qdd[found.t.searchsorted(t), 0]) for t in (0.2, 0.3))
    assert quick == pytest.approx(4 * slow, rel=16 * U)
    assert found.q.max() <= 1


@pytest.mark.filterwarnings("error")
def test_a_mass_that_does_not_count_is_not_assumed(tmp_path):
    shaped = toml("pair.body1", shapes=[{"cylinder": 0.1, "length": 1}]).replace('": ', '" = ')
    pair = toml("pair", u1=[0, 0, 0], u2=[-0.5, 0, 0], n=[0, 1, 0]) + toml("pair.body2", mass=1, inertia=[1, 1, 1])
    forces = scene_of(tmp_path, pair + shaped + toml("dynamics", base="fixed") + time(0, 1, 3)).forces()
    assert "force1" not in forces.recorded()
    given = shaped.replace("[pair.body1]", "[pair.body1]\nmass = 2\ninertia = [1, 1, 1]")
    forces = scene_of(tmp_path, pair + given + toml("dynamics", base="fixed") + time(0, 1, 3)).forces()
    assert forces.force1[0, 2] == pytest.approx(2 * 9.81 + forces.hinge_force[0, 2])
