"""`check` of a simulated motion: it passes, and a motion that does not follow from its loads fails."""

from __future__ import annotations

import functools
import json
from dataclasses import replace

import numpy as np
import pytest

import hingepair as hp
from hingepair.scenes.motions.known import MotionByBody1, MotionByCoordinates
from hingepair.validation.report import MAX_LOAD_RATIO
from hingepair.validation.simulated import compare_forces, compare_rates
from support.commands import run_command
from support.states import generator, rotations

SPACE = """
[pair]
u1 = [0.4, 0, 0.1]
u2 = [-0.25, 0.1, 0.05]
n = [0, 1, 0.3]
body1 = { mass = 0.6, centre_of_mass = [0.1, 0, 0], inertia = [0.002, 0.03, 0.031] }
body2 = { mass = 1.1, centre_of_mass = [0, 0.05, 0.02], inertia = [0.004, 0.02, 0.021] }
[dynamics]
psi_0 = 0.2
psid_0 = -3
damping = 0.02
stiffness = 0.3
hinge_torque = "0.1*sin(5*t)"
force2 = [0, "0.2*sin(3*t)", 0.1]
torque2 = [0.01, 0, "0.02*t"]
"""
PLANE = """
planar = true
[pair]
u1 = [1, 0]
u2 = [-0.3, 0]
body1 = { mass = 1.3, centre_of_mass = [0.5, 0, 0], inertia = [0.1, 0.1, 0.12] }
body2 = { mass = 0.7, centre_of_mass = [0.4, 0, 0], inertia = [0.05, 0.08, 0.09] }
[dynamics]
psi_0 = 0.5
damping = 0.02
force2 = [0.1, "0.2*t"]
torque2 = 0.03
"""
TIME = "[time]\nstart = 0\nstop = 1\nsamples = 101\n"
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
    "free": ["force1", "torque1", "hinge_torque"],
    "pinned": ["torque1", "hinge_torque"],
    "fixed": ["hinge_torque"],
    "prescribed": ["hinge_torque"],
}


@pytest.mark.slow
@pytest.mark.parametrize("text", [SPACE, pytest.param(PLANE, marks=pytest.mark.proof)], ids=["space", "plane"])
@pytest.mark.parametrize("base", SIMULATION_BASE_NAMES)
def test_a_simulated_motion_is_compared_with_inverse_dynamics(scenes, base, text):
    report = scenes(text, base).cross_validate()
    assert report.ok
    assert [row.output for row in report.forces] == COMPARED[base]
    for row in report.forces:
        assert row.max_ratio < 16
        assert (row.samples, row.bound) == (101, MAX_LOAD_RATIO)
    rates = ["psid", "psidd", *(["v1", "a1", "omega1", "alpha1"] if base in {"free", "pinned"} else [])]
    assert [row.rate for row in report.rates] == rates
    for row in report.rates:
        assert row.samples > 75
        assert row.max_error < 1e-2 * row.allowed or row.max_error == 0
    compared = ", ".join(COMPARED[base])
    assert report.verdict.endswith(f"of Pinocchio, and {compared} within 64 u*scale of its rnea")


def with_hinge(scene, change):
    """The scene, whose psi, psid and psidd are others."""
    given = scene.motion.source
    if isinstance(given, MotionByBody1):
        return replace(scene, motion=replace(scene.motion, source=replace(given, hinge=change(*given.hinge))))
    rows = [list(row) for row in given.derivatives]
    for row, value in zip(rows, change(*(row[-1] for row in rows)), strict=True):
        row[-1] = value
    other = MotionByCoordinates(given.count, tuple(map(tuple, rows)), given.sequence)
    return replace(scene, motion=replace(scene.motion, source=other))


CHANGES = {
    "all": lambda psi, psid, psidd: (3 * psi, 0 * psid - 7, 0 * psidd + 99),
    "psi": lambda psi, psid, psidd: (3 * psi, psid, psidd),
    "psid": lambda psi, psid, psidd: (psi, 0 * psid - 7, psidd),
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
    assert all(row.ok for row in report.rows)  # the kinematics are those of whatever psi is
    if change in {"all", "psidd"}:
        assert "hinge_torque" in report.verdict
    if change == "psid":
        assert "psid" in report.verdict.split(": ")[1].split(", ")


@pytest.mark.slow
def test_the_command_fails_on_such_a_motion(scenes, monkeypatch):
    scene = scenes(SPACE, "fixed")
    passed = run_command("check", scene.path).stdout
    assert "PASSED: 7 outputs of 101 samples" in passed
    assert "rnea" in passed
    other = with_hinge(scene, CHANGES["all"])
    monkeypatch.setattr("hingepair.cli.scenes.load_scene", lambda _: other)
    assert "FAILED: hinge_torque, psid, psidd" in run_command("check", scene.path, code=1).stdout
    facts = json.loads(run_command("check", scene.path, "--json", code=1).stdout)
    assert [row["ok"] for row in facts["forces"] + facts["rates"]] == [False] * 3
    assert facts["forces"][0]["scale"] == "as for torque1, but of body 2 alone"


HARM = {
    "mass of body 1": lambda pair: replace(pair, body1=replace(pair.body1, mass=0.7)),
    "mass of body 2": lambda pair: replace(pair, body2=replace(pair.body2, mass=1.2)),
    "inertia of body 1": lambda pair: replace(pair, body1=replace(pair.body1, inertia=np.diag([0.003, 0.03, 0.03]))),
    "inertia of body 2": lambda pair: replace(pair, body2=replace(pair.body2, inertia=np.diag([0.005, 0.02, 0.02]))),
    "u2": lambda pair: replace(pair, u2=pair.u2 + np.array([0, 0, 1e-3])),
}


@pytest.mark.slow
@pytest.mark.parametrize("harm", HARM)
def test_loads_of_another_pair_are_no_loads_of_this_motion(scenes, harm):
    motion = scenes(SPACE, "free").motion.simulated
    hinge = motion.psi, motion.psid, motion.psidd
    held = {"base": "free", "is_planar": False}
    right = compare_forces(motion.space, motion.body1, hinge, motion.loads, motion.gravity, **held)
    wrong = compare_forces(HARM[harm](motion.space), motion.body1, hinge, motion.loads, motion.gravity, **held)
    assert all(row.ok for row in right)
    assert not all(row.ok for row in wrong)
    falling = compare_forces(motion.space, motion.body1, hinge, motion.loads, (0, 0, -9.8), **held)
    assert not any(row.ok for row in falling)
    for name in ("force1", "torque1", "force2", "torque2", "hinge_torque"):
        loads = {**motion.loads, name: motion.loads[name] + 1e-9}
        rows = compare_forces(motion.space, motion.body1, hinge, loads, motion.gravity, **held)
        assert not all(row.ok for row in rows), name


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:psi passes the stops:hingepair.DynamicsWarning")
@pytest.mark.parametrize(("base", "samples"), [("free", 40), ("pinned", 400), ("fixed", 3000)])
def test_rates_pass_at_stops_and_where_instants_are_few(base, samples):
    for k in range(3):
        rng = generator(5, k)
        bodies = [hp.Body(m, rng.normal(size=3), np.diag(rng.uniform(0.6, 1, 3)) * m) for m in (1, 4)]
        pair = hp.HingePair(*rng.normal(size=(3, 3)), home=rotations(rng, 1)[0], body1=bodies[0], body2=bodies[1])
        v, omega = rng.normal(size=(2, 3)) * 3
        start = {"v": v, "omega": omega} if base == "free" else {"omega": omega} if base == "pinned" else {}
        load = hp.HingeLoad(friction=0.1, friction_rate=0.3, stops=(-0.5, 0.7), stop_stiffness=1e4, stop_damping=1)
        body1, t = hp.BodyMotion(R=rng.normal(size=3), S=rotations(rng, 1)[0], **start), np.linspace(0, 2, samples)
        motion = hp.simulate(pair, t, body1, 0.2, -1.0, base=base, hinge_torque=load, tol=10.0 ** -(4 + 3 * k))
        hinge = motion.psi, motion.psid, motion.psidd
        for row in compare_rates(t, motion.body1, hinge, body1_moves=base != "fixed"):
            # Rounding decides which samples beside a stop are compared; those at the edge are the least exact.
            assert row.max_error <= row.allowed / 2


@pytest.mark.slow
def test_a_body_that_turns_by_half_a_turn_a_sample_has_no_slope_to_compare():
    body = hp.Body(1, inertia=(1, 1, 1))
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body1=body, body2=body)
    start, t = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 2 * np.pi)), np.arange(20.0)
    motion = hp.simulate(pair, t, start, 0.0, 0.0)
    rows = {
        row.rate: row
        for row in compare_rates(t, motion.body1, (motion.psi, motion.psid, motion.psidd), body1_moves=True)
    }
    assert (rows["omega1"].samples, rows["omega1"].ok) == (0, True)


@pytest.mark.slow
def test_a_sample_that_is_not_finite_is_left_out(scenes):
    scene = scenes(SPACE, "fixed")
    psi = scene.motion.source.psi.copy()
    psi[7] = np.nan
    report = with_hinge(scene, lambda _, *rates: (psi, *rates)).cross_validate()
    assert report.ok
    assert [row.samples for row in report.forces] == [100]
    assert report.rates[0].samples < 101 - 6


@pytest.mark.slow
@pytest.mark.parametrize("most", [10, None])
def test_the_slopes_are_those_of_all_instants(scenes, most):
    report = scenes(SPACE, "fixed").cross_validate(most)
    assert (report.samples, report.forces[0].samples) == (most or 101, most or 101)
    assert report.rates[0].samples > 75


@pytest.mark.slow
def test_a_motion_that_is_further_off_than_the_bound_says_so(tmp_path):
    scene = scene_of(tmp_path, SPACE, "fixed", "tol = 1e-4\n")
    report = scene.cross_validate()
    (note,) = report.notes
    error = scene.motion.simulated.psi_error_estimate
    assert (
        f"by its own estimate the motion is off by about {error:.1g} rad of psi, above the bound of 2e-15 rad" in note
    )
    assert error > 1e-9
    assert f"note: {note}" in str(report)
    assert json.loads(report.to_json())["notes"] == [note]
    assert report.ok


@pytest.mark.slow
def test_a_motion_by_expressions_has_neither_forces_nor_notes(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SPACE.partition("[dynamics]")[0] + "[motion]\npsi = 't'\n" + CARRIED[SPACE] + TIME)
    report = hp.load_scene(path).cross_validate()
    assert (report.forces, report.rates, report.notes) == ((), (), ())
    assert "rnea" not in str(report)
