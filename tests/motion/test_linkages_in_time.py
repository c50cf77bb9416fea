"""Linkages in time: dead points and ends of strokes end motions, and the energies grow by the work of struts."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.linkages import four_bar
from support.near import TIGHT, TOL, U

STOPS = {"force": ([0.25, 0.3, 0.5, 0.55], [5e3, 0, 0, -5e3])}  # of 1e5 N/m at 0.3 m and 0.5 m


def hatch(**strut):
    lid = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 1, 0), name="lid", body2=hp.Body(12, (0.4, 0, 0), (0.1, 0.8, 0.9)))
    tree = hp.Mechanism([lid]).with_frame("foot", "base", R=(0.3, 0, -0.2)).with_frame("eye", "lid", R=(0.5, 0, 0))
    return tree.with_strut("foot", "eye", "gas", **strut)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [1.0, -1.0])
def test_a_motion_ends_where_its_coordinate_comes_to_a_dead_point(rate):
    """The crank goes on there, and shows when the rocker turns back."""
    by_rocker, by_crank = four_bar(coordinate="rocker"), four_bar()
    t, given = np.linspace(0, 3, 301), {"gravity": (0, 0, 0), "tol": TIGHT}
    with pytest.warns(hp.DynamicsWarning, match="ends at t = .* a-b at a dead point, where rocker no longer moves"):
        found = hp.simulate(by_rocker, t, [1.9], [rate], **given)
    assert found.ended_by_event
    _, rates = by_rocker.all_coordinates(found.q[-1], [1.0])
    assert np.abs(rates).max() == pytest.approx(1e3, rel=1e4 * TOL)
    assert np.isfinite(found.qdd).all()
    q0, qd0 = by_rocker.all_coordinates([1.9], [rate])
    other = hp.simulate(
        by_crank, t, q0[:1], qd0[:1], until=lambda _, now: by_crank.all_coordinates(now.q, now.qd)[1][:, 2], **given
    )
    assert 0 < other.t[-1] - found.t[-1] < 5e-3  # s: the crank comes nearer to the dead point
    rows = len(found.t) - 1
    np.testing.assert_allclose(by_crank.all_coordinates(other.q)[:rows, 2], found.q[:rows, 0], rtol=0, atol=10 * TOL)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gas", "start", "rate", "end"), [(150, -0.5, 0, 0.5), (150, -0.2, 4, 0.3), (15, 0.0, -2, 0.3)], ids=str
)
def test_a_motion_ends_at_the_end_of_a_stroke_that_has_no_stops(gas, start, rate, end):
    """The last one begins beyond the stroke, and comes into it on the way."""
    lid = hatch(force=hp.GasSpring(F1=gas, F2=4 / 3 * gas, stroke=0.2), free_length=0.5)
    with pytest.warns(hp.DynamicsWarning) as caught:
        found = hp.simulate(lid, np.linspace(0, 2, 21), [start], [rate], tol=TIGHT)
    *of_the_start, last = (str(one.message) for one in caught)
    assert f"gas at the end of its stroke, {end} m" in last
    assert ["0.2828 m is beyond its stroke" in one for one in of_the_start] == [True] * (start == 0)
    assert found.ended_by_event
    assert np.isfinite(lid.struts(found.q[1:], found.qd[1:])["gas"].force).all()
    assert lid.struts(found.q[-1])["gas"].length == pytest.approx(end, abs=TIGHT)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.0, 30.0])
def test_elastic_stops_of_a_strut_are_felt_and_its_damper_works(damping):
    lid = hatch(stiffness=300, free_length=0.4, damping=damping).with_strut("foot", "eye", "stops", **STOPS)
    found = hp.simulate(lid, np.linspace(0, 2, 201), [-0.5], tol=1e-11)
    balance = found.energy_balance()
    assert np.abs(balance.residual).max() < 100 * TOL
    assert ("struts" in balance.work) == (damping > 0)
    assert 0.27 < lid.struts(found.q)["gas"].length.min() < 0.3
    assert not found.ended_by_event


@pytest.mark.slow
def test_a_thrown_four_bar_keeps_its_momenta_and_rolls_out_to_the_same():
    linkage = four_bar(base="free")
    start = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), v=(0.1, 0, 0), omega=(0.1, 0.3, 0.2))
    given = {"gravity": (0, 0, 0), "base_motion": start}
    found = hp.simulate(linkage, np.linspace(0, 2, 41), [0.3], [3.0], **given)
    for momentum in (found.momentum().linear, found.momentum().angular):
        assert np.ptp(momentum, axis=0).max() < 64 * U
    assert np.ptp(found.energy().kinetic) < TOL
    rolled = linkage.rollout([0.3], [3.0], np.zeros((200, 1)), 1e-2, method="rk4", **given)
    np.testing.assert_allclose(rolled.q[::5], found.q, rtol=0, atol=1000 * TOL)
    np.testing.assert_allclose(rolled.R1[::5], found.base_motion.R, rtol=0, atol=1000 * TOL)


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_a_small_slider_crank_is_far_from_dead_points(unit):
    bodies = [hp.Body(1, (x * unit, 0, 0), (0.1 * unit**2,) * 3) for x in (0.1, 0.4, 0)]
    joints = [
        hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), name="crank", body2=bodies[0]),
        hp.HingePair((0.3 * unit, 0, 0), (0, 0, 0), (0, 0, 1), name="rod", body2=bodies[1]),
        hp.Slider((0, 0, 0), (0, 0, 0), (1, 0, 0), name="piston", body2=bodies[2]),
    ]
    tree = hp.Mechanism(joints, parents=[0, 1, 0]).with_frame("pin", "rod", R=(0.9 * unit, 0, 0))
    engine = tree.closed(hp.Loop("pin", "piston"), coordinates="crank", at={"piston": 1.2 * unit})
    q = np.linspace(0, 6, 20)[:, None]
    assert engine.transmission(q).min() > 0.4
    motion = hp.simulate(engine, [0, 1, 2], [0.3], [2.0], gravity=(0, 0, 0))
    assert not motion.ended_by_event


@pytest.mark.slow
def test_a_hatch_comes_to_rest_by_the_friction_of_its_gas_spring():
    """Where the spring carries the lid on either side of its friction; it creeps on by less than 0.1 mm/s."""
    gas = hp.GasSpring(F1=150, F2=200, stroke=0.2, friction=20)
    lid = hatch(force=gas, free_length=0.5, limits=(0.2, 0.6)).with_strut("foot", "eye", "stops", **STOPS)
    found = hp.simulate(lid, np.linspace(0, 4, 41), [-0.5])
    assert found.steps < 2000
    assert np.abs(lid.struts(found.q[-5:], found.qd[-5:])["gas"].rate).max() < 1e-4  # m/s, as said
    assert np.abs(found.energy_balance().residual).max() < 100 * TOL
