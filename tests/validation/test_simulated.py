"""`check` of a simulated motion: it passes, and a motion that does not follow from its loads fails."""

from __future__ import annotations

import functools
import json
from dataclasses import replace

import numpy as np
import pytest

import hingepair as hp
from hingepair.scenes.assembly import Assembly
from hingepair.validation.cross_validate import compare_rates
from hingepair.validation.report import MAX_LOAD_RATIO, MAX_RATIO
from support.near import U
from support.scenes import altered, time, toml

SPACE = (
    toml("pair", u1=[0.4, 0, 0.1], u2=[-0.25, 0.1, 0.05], n=[0, 1, 0.3])
    + toml("pair.body1", mass=0.6, centre_of_mass=[0.1, 0, 0], inertia=[0.002, 0.03, 0.031])
    + toml("pair.body2", mass=1.1, centre_of_mass=[0, 0.05, 0.02], inertia=[0.004, 0.02, 0.021])
    + toml("dynamics.wrenches.body2", force=[0, "0.2*sin(3*t)", 0.1], torque=[0.01, 0, "0.02*t"])
    + toml("dynamics.psi", q_0=0.2, qd_0=-3, damping=0.02, stiffness=0.3, tau="0.1*sin(5*t)")
    + "[dynamics]\n"
)
PLANE = (
    "planar = true\n"
    + toml("pair", u1=[1, 0], u2=[-0.3, 0])
    + toml("pair.body1", mass=1.3, centre_of_mass=[0.5, 0, 0], inertia=[0.1, 0.1, 0.12])
    + toml("pair.body2", mass=0.7, centre_of_mass=[0.4, 0, 0], inertia=[0.05, 0.08, 0.09])
    + toml("dynamics.wrenches.body2", force=[0.1, "0.2*t"], torque=0.03)
    + toml("dynamics.psi", q_0=0.5, damping=0.02)
    + "[dynamics]\n"
)
TIME = time(0, 1, 101)
SIMULATION_BASE_NAMES = {
    "free": 'base = "free"\n',
    "pinned": 'base = "pinned"\n',
    "fixed": 'base = "fixed"\n',
    "prescribed": 'base = "prescribed"\n[motion]\n',
}
CARRIED = {
    SPACE: "x = 't'\ny = 0\nz = 0\nphi_x = '0.3*sin(4*t)'\nphi_y = 0\nphi_z = 't'\n",
    PLANE: "x = 't'\ny = 0\nphi = '0.3*sin(4*t)'\n",
}
SPUN = {SPACE: "omega1_0 = [0.5, 2, 1]\n", PLANE: "omega1_0 = 2\n"}
LOADED = {SPACE: "force1 = [0.1, 0, 't']\ntorque1 = [0.1, 0.05, 0]\n", PLANE: "force1 = [0.1, 't']\ntorque1 = 0.1\n"}


def scene_of(folder, text, base, more=""):
    more += SPUN[text] + LOADED[text] if base in {"free", "pinned"} else ""
    carried = CARRIED[text] if base == "prescribed" else ""
    path = folder / "scene.toml"
    path.write_text(text + more + SIMULATION_BASE_NAMES[base] + carried + TIME)
    return hp.load_scene(path)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    """Scenes by text and base, each simulated once."""
    return functools.cache(lambda text, base: scene_of(tmp_path_factory.mktemp("scene"), text, base))


COMPARED = {
    "free": ["hinge_torque", "force1", "torque1"],
    "pinned": ["hinge_torque", "torque1"],
    "fixed": ["hinge_torque"],
    "prescribed": ["hinge_torque"],
}


@pytest.mark.slow
@pytest.mark.parametrize("text", [SPACE, pytest.param(PLANE, marks=pytest.mark.proof)], ids=["space", "plane"])
@pytest.mark.parametrize("base", SIMULATION_BASE_NAMES)
def test_a_simulated_motion_is_compared_with_inverse_dynamics(scenes, base, text):
    report = scenes(text, base).cross_validate()
    assert report.ok
    *loads, rates = simulated(report)
    assert [row.output for row in loads] == COMPARED[base]
    assert (rates.output, rates.samples) == ("rates", 99)
    assert rates.max_ratio < 0.5
    for row in loads:
        assert row.max_ratio < 16
        assert (row.samples, row.bound) == (101, MAX_LOAD_RATIO)
    compared = ", ".join(COMPARED[base])
    assert report.verdict.endswith(f"of Pinocchio, and {compared} within 64 u*scale of its rnea")


def simulated(report):
    """The rows of loads and rates."""
    return [row for row in report.rows if row.bound != MAX_RATIO]


def with_hinge(scene, change):
    """The scene, whose psi, psid and psidd are others."""
    given = scene.motion.source
    other = replace(given, joints=tuple((row,) for row in change(*given.hinge)))
    return altered(scene, motion=replace(scene.motion, source=other))


CHANGES = {
    "all": lambda psi, psid, psidd: (3 * psi, 0 * psid - 7, 0 * psidd + 99),
    "psi": lambda psi, psid, psidd: (3 * psi, psid, psidd),
    "psid": lambda psi, psid, psidd: (psi, 1.01 * psid, psidd),
    "psidd": lambda psi, psid, psidd: (psi, psid, 0 * psidd + 99),
    "signs": lambda psi, psid, psidd: (-psi, -psid, -psidd),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("base", "text", "change"),
    [
        *(
            pytest.param(base, SPACE, change, id=f"{base}-space-{change}")
            for base in SIMULATION_BASE_NAMES
            for change in CHANGES
        ),
        *(pytest.param(base, PLANE, "all", id=f"{base}-plane-all") for base in SIMULATION_BASE_NAMES),
    ],
)
def test_a_motion_that_does_not_follow_from_its_loads_fails(scenes, base, text, change):
    report = with_hinge(scenes(text, base), CHANGES[change]).cross_validate()
    assert not report.ok
    assert report.verdict.startswith("FAILED: ")
    assert all(row.ok for row in report.rows if row.bound == MAX_RATIO)  # the kinematics are those of whatever psi is
    if change in {"all", "psidd"}:
        assert "hinge_torque" in report.verdict


def test_rates_of_slow_motions_are_judged_as_those_of_quick_ones():
    t = np.linspace(0, 1, 101)
    q, qd, qdd = np.sin(t)[:, None], 1.01 * np.cos(t)[:, None], -np.sin(t)[:, None]
    quick, slow = (
        compare_rates(factor * t, (q, qd / factor, qdd / factor**2), ("psi",))[0] for factor in (1.0, 1024.0)
    )
    assert not quick.ok
    assert slow.max_ratio == pytest.approx(quick.max_ratio, rel=1024 * U)


HARM = {
    "mass of body 1": lambda pair: replace(pair, body1=replace(pair.body1, mass=0.7)),
    "mass of body 2": lambda pair: replace(pair, body2=replace(pair.body2, mass=1.2)),
    "inertia of body 1": lambda pair: replace(pair, body1=replace(pair.body1, inertia=np.diag([0.003, 0.03, 0.03]))),
    "inertia of body 2": lambda pair: replace(pair, body2=replace(pair.body2, inertia=np.diag([0.005, 0.02, 0.02]))),
    "u2": lambda pair: replace(pair, u2=pair.u2 + np.array([0, 0, 1e-3])),
}


def with_simulated(scene, **change):
    return altered(scene, motion=replace(scene.motion, simulated=replace(scene.motion.simulated, **change)))


@pytest.mark.slow
@pytest.mark.parametrize("harm", HARM)
def test_loads_of_another_pair_are_no_loads_of_this_motion(scenes, harm):
    scene = scenes(SPACE, "free")
    motion = scene.motion.simulated
    assert all(row.ok for row in simulated(scene.cross_validate()))
    harmed = Assembly(HARM[harm](scene.pair))
    other = with_simulated(altered(scene, assembly=harmed), robot=harmed.robot)
    assert not all(row.ok for row in simulated(other.cross_validate()))
    assert not any(row.ok for row in simulated(altered(scene, gravity=(0, 0, -9.8)).cross_validate())[:3])
    for name in ("force1", "torque1", "force_psi", "torque_psi", "tau"):
        loads = {**motion.loads, name: motion.loads[name] + 1e-9}
        assert not all(row.ok for row in simulated(with_simulated(scene, loads=loads).cross_validate())), name


@pytest.mark.slow
def test_a_motion_that_is_further_off_than_the_bound_says_so(tmp_path):
    scene = scene_of(tmp_path, SPACE, "fixed", "tol = 1e-4\n")
    report = scene.cross_validate()
    _, note = report.notes
    error = scene.motion.simulated.q_error_estimate[0]
    assert f"by its own estimate the motion is off by about {error:.1g} rad, above the bound of 2e-15 rad" in note
    assert error > 1e-9
    assert f"note: {note}" in str(report)
    assert json.loads(report.to_json())["notes"][1:] == [note]
    assert report.ok
