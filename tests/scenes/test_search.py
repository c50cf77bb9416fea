"""`hingepair search`: numbers of a scene for which results have wanted values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.special import lambertw

import hingepair as hp
from hingepair.scenes.variants.reductions import reduce_arrays
from support.near import U
from support.scenes import moved, time, toml

ROOT = 1e-12  # of a root that the search finds, relative: a few of its own tolerance, 1e-13
FLAT = 1e-6  # of a largest value's place, where the square of an error counts
ARM = (
    toml("pair", u1=[0, 0, 0], u2=[-2, 0, 0], n=[0, -1, 0])
    + toml("constants", a=0.25, c=1.0)
    + moved(0, 2, 201, z="c", psi="a*t**2")
)
DOOR = (
    toml("pair", u1=[0, 0, 1], u2=[-0.45, 0, 0], n=[0, 0, 1])
    + toml("pair.body2", mass=1, inertia=[1, 1, 1])
    + toml("dynamics", {"psi.q_0": 1, "psi.qd_0": 0, "psi.stiffness": 1, "psi.damping": 3}, base="fixed")
    + time(0, 20, 2001)
)


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.toml"
    path.write_text(ARM)
    return path


def test_one_number_is_found_where_its_result_has_the_value(arm: Path) -> None:
    found = hp.search(arm, "constants.a", "R2_z_last = 2")  # 1 + 2 sin(4 a) = 2
    assert found.ok
    np.testing.assert_allclose(found.values["constants.a"], np.pi / 24, rtol=ROOT)
    np.testing.assert_allclose(found.scene.evaluate().R2[-1, 2], 2, rtol=ROOT)
    again = hp.search(hp.load_scene(arm), {"constants.a": (0.5, 0.7)}, "R2_z_last = 2")
    np.testing.assert_allclose(again.values["constants.a"], 5 * np.pi / 24, rtol=ROOT)


def test_several_numbers_meet_several_conditions(arm: Path) -> None:
    found = hp.search(arm, ["constants.a", "constants.c"], ["R2_z_last = 2", "R2_z_first = 0.5"])
    assert found.ok
    np.testing.assert_allclose(list(found.values.values()), (np.arcsin(0.75) / 4, 0.5), rtol=ROOT)


@pytest.mark.slow
def test_a_smallest_and_a_largest_result_are_inside_their_range(arm: Path) -> None:
    found = hp.search(arm, {"constants.a": (0.1, 1)}, maximize="R2_z_last")
    assert found.ok
    np.testing.assert_allclose(found.values["constants.a"], np.pi / 8, rtol=FLAT)
    bounded = hp.search(arm, {"constants.a": (0.1, 0.3)}, maximize="R2_z_last")
    assert bounded.ok
    np.testing.assert_allclose(bounded.values["constants.a"], 0.3, rtol=ROOT)
    assert bounded.notes == ("constants.a = 0.3 is at an end of its range",)


@pytest.mark.slow
def test_one_number_with_an_aim_stops_at_the_condition(arm: Path) -> None:
    """1 + 2 sin(4 a) reaches 2 at a = pi/24; the largest a with less is just below."""
    found = hp.search(arm, {"constants.a": (0.05, 0.35)}, "R2_z_last <= 2", maximize="psi_last")
    assert found.ok
    assert found.results["R2_z_last"] <= 2
    np.testing.assert_allclose(found.values["constants.a"], np.pi / 24, rtol=ROOT)


@pytest.mark.slow
def test_an_inequality_does_not_hold_where_its_result_has_no_value(arm: Path) -> None:
    """The angle a t^2 is 1 at t = 1.6 with a = 1/1.6^2, and not within 2 s with a < 1/4."""
    aimed = hp.search(arm, {"constants.a": (0.1, 0.5)}, "psi_t_above(1) <= 1.6", minimize="psi_last")
    assert aimed.ok
    np.testing.assert_allclose(aimed.values["constants.a"], 1 / 1.6**2, rtol=1e-6)  # a smaller one has no time


def test_a_condition_that_cannot_hold_is_not_found(arm: Path) -> None:
    found = hp.search(arm, "constants.a", "R2_z_last = 4")
    assert not found.ok
    np.testing.assert_allclose(found.results["R2_z_last"], 3, atol=0.05)  # the most that it can be


@pytest.mark.slow
def test_the_damping_of_a_door_is_that_of_the_closed_form(tmp_path: Path) -> None:
    """Critically damped, psi = (1 + w t) exp(-w t), which is 0.01 at t = 4 where w t = -1 - W(-0.01/e)."""
    inertia = 1 + 0.45**2
    w = float(-1 - lambertw(-0.01 / np.e, -1).real) / 4
    path = tmp_path / "door.toml"
    path.write_text(DOOR.replace("psi.stiffness = 1", f"psi.stiffness = {inertia * w**2:.17g}"))
    found = hp.search(path, {"dynamics.psi.damping": (inertia * w, 4 * inertia * w)}, "psi_t_below(0.01) = 4")
    assert found.ok
    np.testing.assert_allclose(found.values["dynamics.psi.damping"], 2 * inertia * w, rtol=ROOT)


@pytest.mark.slow
def test_a_time_just_before_the_end_of_the_motion_is_found(tmp_path: Path) -> None:
    """With more damping, psi is not below the level before the motion ends, and the time is NaN."""
    path = tmp_path / "door.toml"
    path.write_text(DOOR.replace("stop = 20", "stop = 2"))
    found = hp.search(path, "dynamics.psi.damping", "psi_t_below(0.8) = 1.9")
    assert found.ok
    np.testing.assert_allclose(found.results["psi_t_below(0.8)"], 1.9, rtol=ROOT)


@pytest.mark.slow
def test_an_inequality_that_decides_is_met_exactly(tmp_path: Path) -> None:
    """The lid of a hatch shuts in 5 s, and touches its frame at 0.08 m/s."""
    text = (Path(__file__).parents[2] / "models/hatch.toml").read_text()
    path = tmp_path / "hatch.toml"
    text = text.replace('base = "fixed"', 'base = "fixed"\nuntil = "psi"').replace("stops = true ", "# ")
    text = text.replace("stop_restitution = 0.2\n", "")
    path.write_text(text.replace("stop = 6", "stop = 12").replace("samples = 601", "samples = 1201"))
    keys = "dynamics.psi.damping", "dynamics.psi.stiffness"
    found = hp.search(path, keys, ("psi_t_below(0.001) = 5", "edge_v_z_last >= -0.08"))
    assert found.ok
    np.testing.assert_allclose(found.results["edge_v_z_last"], -0.08, rtol=ROOT)


def test_conditions_and_results_are_in_the_units_that_are_asked_for(arm: Path) -> None:
    found = hp.search(arm, "constants.a", "R2_z_last = 2000", units="mm, deg")
    np.testing.assert_allclose(found.values["constants.a"], np.pi / 24, rtol=ROOT)
    assert found.units == {"R2_z_last": "mm"}
    timed = hp.search(arm, "constants.a", "psi_t_at(30) = 1000", units="ms, deg")  # a = 30 deg / s^2
    np.testing.assert_allclose(timed.values["constants.a"], np.radians(30), rtol=ROOT)
    assert timed.units == {"psi_t_at(30)": "ms"}
    assert "ms" in str(timed)


def test_times_at_levels_are_linear_between_instants() -> None:
    t = np.array([0.0, 1.0, 2.0, 3.0, 4.0])
    x = np.array([[2.0, 1.0, 0.0, 0.5, 0.4], [0, 0, 0, 0, 0], [1, 1, np.nan, 0, 0]])
    names = ("t_below(0.5)", "t_above(3)", "t_at(1.5)", "t_settled(0.2)", "t_above(-1)")
    found = reduce_arrays(t, {"psi": x}, names)
    np.testing.assert_array_equal(found["psi_t_below(0.5)"], (1.5, 0, np.nan))
    np.testing.assert_array_equal(found["psi_t_above(3)"], (np.nan, np.nan, np.nan))
    np.testing.assert_array_equal(found["psi_t_at(1.5)"], (0.5, np.nan, np.nan))
    np.testing.assert_allclose(found["psi_t_settled(0.2)"], (2.4, 0, np.nan), rtol=4 * U)
    np.testing.assert_array_equal(found["psi_t_above(-1)"], (0, 0, np.nan))


@pytest.mark.slow
def test_a_search_starts_from_a_number_that_is_zero(tmp_path):
    (tmp_path / "door.toml").write_text(DOOR.replace("damping = 3", "damping = 0"))
    found = hp.search(tmp_path / "door.toml", {"dynamics.psi.damping": None}, "psi_t_below(0.02) = 5")
    assert found.ok
    assert found.results["psi_t_below(0.02)"] == pytest.approx(5, rel=ROOT)


def test_a_swing_without_end_never_settles():
    t = np.linspace(0, 10, 1001)
    swing, door = np.sin(10 * t), np.exp(-t) * np.cos(10 * t)
    found = reduce_arrays(t, {"psi": np.stack([swing, door, 0 * t])}, ["t_settled(0.02)"])["psi_t_settled(0.02)"]
    assert np.isnan(found[0])
    assert 3 < found[1] < 5
    assert found[2] == 0


BARS = {"crank": (0, {}), "coupler": (0.2, {"parent": "crank"}), "rocker": (0.6, {})}
FOUR_BAR = "".join(
    toml("[joint]", more, name=name, u1=[x, 0, 0], u2=[0, 0, 0], n=[0, 0, 1]) for name, (x, more) in BARS.items()
)
FOUR_BAR += (
    toml("mechanism.at", crank=0.3, coupler=0.8, rocker=1.9)
    + toml("mechanism.frames.a", link="coupler", R=[0.5, 0, 0])
    + toml("mechanism.frames.b", link="rocker", R=[0.4, 0, 0])
    + toml("mechanism", coordinates=["crank"])
    + toml("[loop]", frame1="a", frame2="b")
    + toml("motion", crank="2*pi*t")
    + time(0, 1, 21)
)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_variants_that_cannot_close_are_told(tmp_path):
    (tmp_path / "four.toml").write_text(FOUR_BAR)
    found = hp.search(tmp_path / "four.toml", {"joint[2].u1[0]": (0.3, 3.0)}, minimize="R_b_x_max")
    assert any("variants cannot be computed" in note and "a-b at a dead point" in note for note in found.notes)
    varied = hp.vary(tmp_path / "four.toml", {"joint[2].u1[0]": [0.3, 0.6, 3.0]}, ["R_b"])
    first, middle, last = varied.reason.values
    assert "a-b at a dead point" in first
    assert "can be closed" in last
    assert middle == ""


def test_what_is_no_number_or_no_result_is_named_with_what_is(tmp_path):
    (tmp_path / "door.toml").write_text(DOOR)
    for key, until, words in (
        ("pair.body2.inertia", "psi_last = 1", r"pair.body2.inertia\[0\] to pair.body2.inertia\[2\]"),
        ("dynamics.psi.damping", "psi_lst = 1", "nearest: last"),
        ("dynamics.psi.damping", "psidd_z_max = 1", "until"),
        ("dynamics.psi.damping", (), "a result to minimize or maximize"),
    ):
        with pytest.raises(hp.ArgumentError, match=words):
            hp.search(tmp_path / "door.toml", key, until)
    for aim in ("minimize", "maximize"):
        for result in ("psi_lst", "psidd_z_max", "R2_w_max"):
            with pytest.raises(hp.ArgumentError, match=f"^{aim}: "):
                hp.search(tmp_path / "door.toml", {"dynamics.psi.damping": (0.1, 1)}, **{aim: result})
