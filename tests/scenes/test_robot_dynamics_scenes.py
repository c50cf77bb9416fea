"""Scenes of robots with [dynamics]: run, check, forces and the energy balance, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import hingepair as hp
from support.near import assert_near
from support.scenes import time, toml

MODEL = Path("models/falling_rods.toml")
JOINTS = (
    toml("[joint]", name="lift", kind="slider", u1=[0, 0, 0], u2=[0, 0, 0], n=[0, 0, 1], limits=[-1, 1])
    + "{body1}\n"
    + toml("joint.body2", mass=2, inertia=[0.1, 0.1, 0.1])
    + toml("[joint]", name="arm", parent="lift", u1=[0.2, 0, 0], u2=[0, 0, 0], n=[0, 1, 0])
    + toml("joint.body2", mass=1, centre_of_mass=[0.4, 0, 0], inertia=[0.01, 0.05, 0.05])
)
TIME = time(0, 1, 101)
TOL = 1e-10  # J, or N m: the tolerance of simulations, relative, of energies and torques about 1
BODY1 = "[joint.body1]\nmass = 3\ninertia = [0.3, 0.3, 0.3]"


def scene(tmp_path, text, mechanism="", body1=""):
    path = tmp_path / "robot.toml"
    path.write_text(f"[mechanism]\n{mechanism}\n{JOINTS.format(body1=body1)}\n{text}\n{TIME}")
    return path


@pytest.mark.slow
def test_a_scene_is_the_simulation_of_its_robot():
    found = hp.load_scene(MODEL)
    robot, result = found.mechanism, found.evaluate(["q", "tip"])
    loads = {
        "shoulder": hp.HingeLoad(friction=0.5, damping=0.05),
        "elbow": hp.HingeLoad(friction=0.12, stops=np.deg2rad([-10, 150]), stop_restitution=0.4),
    }
    expected = hp.simulate(robot, found.t, [0, np.deg2rad(140)], loads=loads)
    assert_near(result.q, expected.q, 64)
    assert_near(result["tip"].R, expected["tip"].R, 64)
    assert found.energy_balance().work["impacts"][-1] < -5
    (note,) = found.notes()
    assert note.startswith("elbow hits a rigid stop at t = 0.49")


BASES = {
    "free": ("", '[dynamics]\nbase = "free"\nv1_0 = [0, 0, 3]\nomega1_0 = [0.1, 0.2, 0]', BODY1),
    "pinned": ("", '[dynamics]\nbase = "pinned"\nomega1_0 = [0.1, 0.2, 0]', BODY1),
    "fixed": ("", '[dynamics]\nR1_0 = [0, 0, 1]', ""),
    "prescribed": ("", '[dynamics]\n[motion]\nx = "0.1*sin(3*t)"', ""),
}  # fmt: skip


@pytest.mark.parametrize("base", BASES)
@pytest.mark.slow
def test_all_bases_are_compared_with_pinocchio(tmp_path, base):
    mechanism, text, body1 = BASES[base]
    load = '[dynamics.arm]\nq_0 = 0.3\ntau = "0.5*sin(4*t) - 0.1*qd"\n[dynamics.lift]\nstiffness = 300\n'
    head, _, tail = text.partition("[motion]")
    whole = head + "\n" + load + (f"[motion]{tail}" if tail else "")
    found = hp.load_scene(scene(tmp_path, whole, mechanism, body1))
    assert found.motion.simulated.base == ("moving" if base == "prescribed" else base)
    report = found.cross_validate()
    assert report.ok, str(report)
    assert {row.output for row in report.rows} >= {"tau"}
    assert np.abs(found.energy_balance().residual).max() < TOL


LOADED = (
    toml("dynamics", base="pinned", force1=[0, 1, 0], torque1=["0.3*t", 0, 0.1], until="armd + 2.5")
    + toml("dynamics.wrenches.arm", force=[0, "2*sin(3*t)", 1], torque=[0.1, 0, "t"])
    + toml("motion", lift="0.1*sin(4*t)")
)


@pytest.mark.slow
def test_wrenches_act_on_links_and_joints_of_motion_move_as_given(tmp_path):
    found = hp.load_scene(scene(tmp_path, LOADED, "", BODY1))
    given = {
        "driven": {"lift": lambda t: (0.1 * np.sin(4 * t), 0.4 * np.cos(4 * t), -1.6 * np.sin(4 * t))},
        "wrenches": {"arm": (
            lambda t, _: np.stack([0 * t, 2 * np.sin(3 * t), 0 * t + 1], axis=-1),
            lambda t, _: np.stack([0 * t + 0.1, 0 * t, t], axis=-1),
        )},
        "force1": (0, 1, 0), "torque1": lambda t, _: np.stack([0.3 * t, 0 * t, 0 * t + 0.1], axis=-1),
        "until": lambda _, now: now.qd[:, 1] + 2.5,
    }  # fmt: skip
    robot = found.mechanism
    expected = hp.simulate(robot, np.linspace(0, 1, 101), [0, 0], base="pinned", **given)
    assert expected.ended_by_event
    assert_near(found.t, expected.t, 64)
    assert_near(found.evaluate(["q"]).q, expected.q, 64)
    assert found.notes() == (f"until ends the motion at t = {found.t[-1]:.6g} s",)
    report = found.cross_validate()
    assert report.ok, str(report)
    assert [row.output for row in report.rows][-3:] == ["tau", "torque1", "rates"]
    assert np.abs(found.energy_balance().residual).max() < TOL
    assert_near(found.forces().tau, expected.tau, 64)  # what the wrenches do not do


def test_wrenches_count_where_the_motion_is_given(tmp_path):
    text = toml("motion", lift="0.1*sin(4*t)", arm="t**2") + toml("dynamics.wrenches.arm", force=[0, "armd", 1])
    found = hp.load_scene(scene(tmp_path, text))
    t, robot = found.t, found.mechanism
    q, qd = np.stack((0.1 * np.sin(4 * t), t**2), axis=-1), np.stack((0.4 * np.cos(4 * t), 2 * t), axis=-1)
    qdd = np.stack((-1.6 * np.sin(4 * t), 0 * t + 2), axis=-1)
    wrenches = {"arm": (np.stack([0 * t, 2 * t, 0 * t + 1], axis=-1), (0, 0, 0))}
    assert_near(found.forces().tau, robot.inverse_dynamics(q, qd, qdd, wrenches=wrenches).tau, 64)
    assert found.plan(("q", "tau")).operations > found.plan(("q",)).operations == 0


def test_efforts_are_those_of_motors_in_every_command(tmp_path):
    """What wrenches on links, dampers and springs do is not the motors' to do, in results and forces alike."""
    loads = "[dynamics]\n[dynamics.lift]\ndamping = 3\n[dynamics.arm]\nqd_0 = 1\ndamping = 0.5\nstiffness = 2\n"
    text = loads + "tau = '0.3*sin(t)'\n[dynamics.wrenches.arm]\nforce = [0, 0, 30]\ntorque = [0, '5*t', 0]\n"
    found = hp.load_scene(scene(tmp_path, text))
    motors = found.motion.simulated.loads["motor"]
    assert np.abs(motors[:, 1]).max() > 0.2
    for tau in (found.evaluate(("tau",)).tau, found.forces().tau, next(found.blocks(("tau",))).tau):
        assert_near(tau, motors, 16, 30)  # N m, of the wrench
    assert_near(found.arrays(("tau_arm",))["tau_arm"], motors[:, 1], 16, 30)
    np.testing.assert_array_equal(found.sampled(5, ("tau",)).tau, found.evaluate(("tau",)).tau[::25])
