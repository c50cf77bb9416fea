"""Small motions: natural frequencies and damping in closed form, and beside simulated motions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import eigh, expm

import hingepair as hp
from support.near import TIGHT, TOL, U
from support.states import generator, rotations

SLOPES = 1e-9  # of loads that are differentiated by steps of 1e-4, with formulas of order 4

STILL = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
WEIGHTLESS = (0.0, 0.0, 0.0)


def rod():
    """A rod of 2 kg, inertia 3 about the hinge, whose centre hangs 1 m below it at psi = pi / 2."""
    return hp.HingePair((0, 0, 0), (-1, 0, 0), (0, 1, 0), body2=hp.Body(mass=2, inertia=np.diag([0.01, 1, 1])))


@pytest.mark.parametrize("damping", [0.0, 0.6, 30.0])
def test_a_pendulum_swings_and_fades_as_textbooks_say(damping):
    load = hp.HingeLoad(damping=damping, friction=0.0)
    small = hp.linearize(rod(), STILL, 0.4, hinge_torque=load, base="fixed", equilibrium=True)
    assert small.psi == pytest.approx(np.pi / 2, abs=TIGHT)
    stiffness = 2 * 9.81
    np.testing.assert_allclose(small.A, [[0, 1], [-stiffness / 3, -damping / 3]], rtol=0, atol=SLOPES)
    np.testing.assert_allclose(small.B, [0, 1 / 3], rtol=TIGHT)
    np.testing.assert_allclose(small.rates, 0, rtol=0, atol=TIGHT)
    natural, ratio = np.sqrt(stiffness / 3), damping / (2 * np.sqrt(stiffness * 3))
    if ratio < 1:
        np.testing.assert_allclose(small.natural_frequencies, [natural], rtol=TOL)
        np.testing.assert_allclose(small.damping_ratios, [ratio], rtol=0, atol=TOL)
    else:
        spread = np.sqrt(ratio**2 - 1)
        np.testing.assert_allclose(small.poles, natural * np.array([spread - ratio, -spread - ratio]), rtol=SLOPES)
    assert small.names == ("psi", "psid")
    assert small.equilibrium
    assert "equilibrium" not in str(small)
    assert "natural frequency" in str(small)


def test_a_state_that_is_no_equilibrium_says_so():
    small = hp.linearize(rod(), STILL, 0.4, base="fixed")
    assert not small.equilibrium
    assert "psi = 0.4 rad, which is no equilibrium: psid' = 6.02" in str(small)
    assert not hp.linearize(rod(), STILL, np.pi / 2, 0.1, base="fixed").equilibrium


def test_a_rod_that_stands_falls():
    small = hp.linearize(rod(), STILL, -np.pi / 2, base="fixed")
    rate = np.sqrt(19.62 / 3)
    np.testing.assert_allclose(small.poles, [-rate, rate], rtol=TOL)
    np.testing.assert_allclose(sorted(small.damping_ratios), [-1, 1], rtol=TIGHT)


@pytest.mark.parametrize(
    ("psi_0", "stops", "beyond"),
    [(1.0, (-1, 1.2), 1.2), (1.3, (-1, 1.2), 1.2), (0.0, (-1, 1.2), 1.2), (1.8, (1.7, 3), 1.7), (3.1, (1.7, 3), 1.7)],
)
def test_an_equilibrium_against_a_stop_is_where_the_stop_bears_the_weight(psi_0, stops, beyond):
    load = hp.HingeLoad(stops=stops)
    small = hp.linearize(rod(), STILL, psi_0, hinge_torque=load, base="fixed", equilibrium=True)
    weight = 2 * 9.81 * np.cos(small.psi)
    assert load(0.0, small.psi, 0.0) == pytest.approx(-weight, rel=SLOPES)
    assert small.psi == pytest.approx(beyond, abs=1e-3)  # rad: half of 20 N m on 1e4 N m/rad
    assert small.natural_frequencies[0] == pytest.approx(
        np.sqrt((1e4 + 2 * 9.81 * np.sin(small.psi)) / 3), rel=1000 * SLOPES
    )


@pytest.mark.parametrize("offset", [0.0, 1e-12, 1e-3, -1e-3])
def test_no_standing_rod_is_a_stable_equilibrium(offset):
    small = hp.linearize(rod(), STILL, offset - np.pi / 2, base="fixed", equilibrium=True)
    assert np.cos(small.psi - np.pi / 2) == pytest.approx(1, abs=8 * U)


ROD1 = hp.Body(mass=1.3, centre_of_mass=(0.5, 0, 0), inertia=(0.1, 0.1, 0.12))
ROD2 = hp.Body(mass=0.7, centre_of_mass=(0.4, 0, 0), inertia=(0.05, 0.08, 0.09))
DOUBLE = hp.HingePair((1, 0, 0), (0, 0, 0), (0, 0, 1), body1=ROD1, body2=ROD2)
ALONG_Y = (0.0, -9.81, 0.0)


def test_a_double_pendulum_has_the_two_frequencies_of_its_stiffness_and_mass():
    hanging = hp.BodyMotion(R=(0, 0, 0), S=hp.rodrigues((0, 0, 1), -np.pi / 2))
    small = hp.linearize(DOUBLE, hanging, 0.0, base="pinned", gravity=ALONG_Y)
    assert small.equilibrium
    coupled = 0.7 * 0.4
    M = np.array([[0.12 + 1.3 * 0.25 + 0.7, coupled], [coupled, 0.09 + 0.7 * 0.16]])
    K = 9.81 * np.diag([1.3 * 0.5 + 0.7, 0.7 * 0.4])
    expected = np.sqrt(eigh(K, M, eigvals_only=True))
    # In space there is a third one, about the axis in the plane across both rods.
    for frequency in expected:
        assert np.abs(small.natural_frequencies - frequency).min() < SLOPES * frequency
    np.testing.assert_allclose(small.damping_ratios, 0, rtol=0, atol=10 * SLOPES)


@pytest.mark.slow
def test_two_wheels_that_a_spring_joins_swing_against_each_other():
    one, two = hp.Body(1.0, inertia=(1, 1, 0.4)), hp.Body(1.0, inertia=(1, 1, 1.5))
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body1=one, body2=two)
    load = hp.HingeLoad(stiffness=7.0, rest=0.3)
    small = hp.linearize(pair, STILL, 0.3, hinge_torque=load, gravity=WEIGHTLESS)
    np.testing.assert_allclose(small.natural_frequencies, [np.sqrt(7 * (1 / 0.4 + 1 / 1.5))], rtol=SLOPES)
    assert len(small.names) == 14


@pytest.mark.slow
@pytest.mark.parametrize("base", ["free", "pinned", "fixed"])
def test_small_changes_grow_as_those_of_a_simulated_motion(base):
    rng, h, nudge = generator(91), 1e-3, 1e-4
    bodies = [hp.Body(rng.uniform(1, 2), rng.normal(size=3), rng.uniform(0.6, 1, 3)) for _ in range(2)]
    pair = hp.HingePair(*rng.normal(size=(3, 3)), home=rotations(rng, 1)[0], body1=bodies[0], body2=bodies[1])
    start = hp.BodyMotion(R=rng.normal(size=3), S=rotations(rng, 1)[0])
    given = {"hinge_torque": hp.HingeLoad(stiffness=3, damping=0.4), "base": base}
    small = hp.linearize(pair, start, 0.3, **given)
    low, high = (
        hp.simulate(pair, [0, h], start, 0.3 + way * nudge, 0.0, tol=1e-14, **given).psid[-1] for way in (-1, 1)
    )
    grown = expm(h * small.A)[small.names.index("psid"), small.names.index("psi")]
    assert (high - low) / (2 * nudge) == pytest.approx(grown, rel=1e-4)  # of differences over steps of 1e-4 rad


@pytest.mark.filterwarnings("error")
def test_the_search_for_an_equilibrium_comes_back_from_beyond_the_stroke_of_a_strut():
    body = hp.Body(mass=25, centre_of_mass=(0.1, 0, -0.5), inertia=(2.5, 2.7, 0.7))
    points = {"points1": {"foot": (0.06, 0, -0.55)}, "points2": {"eye": (0.03, 0, -0.25)}}
    gate = hp.HingePair((0, 0, 0), (0, 0, 0), (0, -1, 0), name="gate", body2=body, **points)
    gate = gate.with_strut("foot", "eye", "gas", force=hp.GasSpring(900, 1200, 0.35), free_length=0.65)
    loads = {"gate": hp.HingeLoad(stops=(0, np.pi / 2), damping=20)}
    found = [hp.linearize(gate, [q], equilibrium=True, loads=loads).q for q in (1.5, 1.57)]
    assert found == pytest.approx([1.5797600, 1.5797600], abs=1e-7)  # rad: where it comes to rest in a simulation
