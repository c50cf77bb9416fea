"""`hingepair search`: numbers of a scene for which results have wanted values."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import lambertw

import hingepair as hp
from hingepair.sweeps.reductions import reduce_arrays
from support.commands import refusal, run_command

ARM = """
title = "An arm that is raised"
[pair]
u1 = [0, 0, 0]
u2 = [-2, 0, 0]
n = [0, -1, 0]
[motion]
x = 0
y = 0
z = "c"
phi_x = 0
phi_y = 0
phi_z = 0
psi = "a*t**2"
[constants]
a = 0.25
c = 1.0
[time]
start = 0
stop = 2
samples = 201
"""
DOOR = """
[pair]
u1 = [0, 0, 1]
u2 = [-0.45, 0, 0]
n = [0, 0, 1]
[pair.body2]
mass = 1
inertia = [1, 1, 1]
[dynamics]
base = "fixed"
psi_0 = 1
psid_0 = 0
stiffness = 1
damping = 3
[time]
start = 0
stop = 20
samples = 2001
"""


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.toml"
    path.write_text(ARM)
    return path


def test_one_number_is_found_where_its_result_has_the_value(arm: Path) -> None:
    found = hp.search(arm, "constants.a", "R2_z_last = 2")  # 1 + 2 sin(4 a) = 2
    assert found.ok
    np.testing.assert_allclose(found.values["constants.a"], np.pi / 24, rtol=1e-10)
    np.testing.assert_allclose(found.scene.evaluate().R2[-1, 2], 2, rtol=1e-10)
    again = hp.search(hp.load_scene(arm), {"constants.a": (0.5, 0.7)}, "R2_z_last = 2")
    np.testing.assert_allclose(again.values["constants.a"], 5 * np.pi / 24, rtol=1e-10)


def test_several_numbers_meet_several_conditions(arm: Path) -> None:
    found = hp.search(arm, ["constants.a", "constants.c"], ["R2_z_last = 2", "R2_z_first = 0.5"])
    assert found.ok
    np.testing.assert_allclose(list(found.values.values()), (np.arcsin(0.75) / 4, 0.5), rtol=1e-6)


def test_a_smallest_and_a_largest_result_are_inside_their_range(arm: Path) -> None:
    found = hp.search(arm, {"constants.a": (0.1, 1)}, maximize="R2_z_last")
    assert found.ok
    np.testing.assert_allclose(found.values["constants.a"], np.pi / 8, rtol=1e-4)
    bounded = hp.search(arm, {"constants.a": (0.1, 0.3)}, maximize="R2_z_last")
    assert not bounded.ok
    np.testing.assert_allclose(bounded.values["constants.a"], 0.3, rtol=1e-6)


def test_a_condition_that_cannot_hold_is_not_found(arm: Path) -> None:
    found = hp.search(arm, "constants.a", "R2_z_last = 4")
    assert not found.ok
    np.testing.assert_allclose(found.results["R2_z_last"], 3, atol=0.05)  # the most that it can be


def test_what_no_number_reaches_says_why(arm: Path) -> None:
    late = hp.search(arm, "constants.a", "R2_z_t_at(2) = 2.5")
    assert late.notes == ("R2_z_t_at(2) = 2.5 is not within the motion, which ends at t = 2 s (time.stop)",)
    jump = hp.search(arm, {"constants.a": (0.7, 0.9)}, "R2_z_t_min = 1")  # from the start to the end at pi/4
    assert not jump.ok
    assert jump.notes == ("R2_z_t_min jumps past 1 at constants.a = 0.785398",)
    assert jump.notes[0] in str(jump)


def test_the_damping_of_a_door_is_that_of_the_closed_form(tmp_path: Path) -> None:
    """Critically damped, psi = (1 + w t) exp(-w t), which is 0.01 at t = 4 where w t = -1 - W(-0.01/e)."""
    inertia = 1 + 0.45**2
    w = float(-1 - lambertw(-0.01 / np.e, -1).real) / 4
    path = tmp_path / "door.toml"
    path.write_text(DOOR.replace("stiffness = 1", f"stiffness = {inertia * w**2:.17g}"))
    found = hp.search(path, {"dynamics.damping": (inertia * w, 4 * inertia * w)}, "psi_t_below(0.01) = 4")
    assert found.ok
    np.testing.assert_allclose(found.values["dynamics.damping"], 2 * inertia * w, rtol=1e-4)


def test_times_at_levels_are_linear_between_instants() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    x = np.array([[2.0, 1.0, 0.0, 0.5, 0.4], [0, 0, 0, 0, 0], [1, 1, np.nan, 0, 0]])
    names = ("t_below(0.5)", "t_above(3)", "t_at(1.5)", "t_settled(0.2)", "t_above(-1)")
    found = reduce_arrays(t, {"psi": x}, names)
    np.testing.assert_allclose(found["psi_t_below(0.5)"], (1.5, 0, np.nan))
    np.testing.assert_allclose(found["psi_t_above(3)"], (np.nan, np.nan, np.nan))
    np.testing.assert_allclose(found["psi_t_at(1.5)"], (0.5, np.nan, np.nan))
    np.testing.assert_allclose(found["psi_t_settled(0.2)"], (2.4, 0, np.nan))
    np.testing.assert_allclose(found["psi_t_above(-1)"], (0, 0, np.nan))


def test_the_command_prints_what_it_found(arm: Path) -> None:
    shown = run_command("search", arm, "--vary", "constants.a=0.1:0.3", "--until", "R2_z_last = 2").stdout
    assert "0.1309" in shown
    assert "found after" in shown
    record = json.loads(
        run_command("search", arm, "--vary", "constants.a", "--until", "R2_z_last = 9", "--json", code=1).stdout
    )
    assert record["ok"] is False


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--vary", "constants.b", "--until", "R2_z_last = 2"), "expected one of a, c"),
        (("--vary", "constants.a=1", "--until", "R2_z_last = 2"), "--vary: expected KEY or KEY=LOW:HIGH"),
        (("--vary", "constants.a", "--until", "R2_z_last"), "--until: expected conditions such as"),
        (("--vary", "constants.a", "--until", "R2_z = 2"), "--until: expected a result that ends in a reduction"),
        (("--vary", "constants.a", "--until", "R2_w_last = 2"), "R2_x_last, R2_y_last, R2_z_last"),
        (("--vary", "constants.a", "--until", "R9_last = 2"), "R9_last: expected a component of an output"),
        (("--vary", "motion.psi", "--until", "R2_z_last = 2"), "not of an expression"),
        (("--vary", "constants.a", "--minimize", "R2_z_last"), "ranges"),
        (("--vary", "constants.a"), "--until: expected a condition"),
    ],
)
def test_what_cannot_be_searched_is_named(words: tuple[str, ...], message: str, arm: Path) -> None:
    assert message in refusal("search", arm, *words)
