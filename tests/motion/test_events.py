"""Events of a simulated motion: friction that sticks and slips, stops, jumps of loads in time, and the user's."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.near import TIGHT, TOL, U
from support.sparse import sparse
from support.states import generator, rotations

STILL = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
WEIGHTLESS = (0.0, 0.0, 0.0)


def wheel(inertia=1.0):
    return hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=hp.Body(1.0, inertia=inertia * np.eye(3)))


def rod():
    """A rod of 2 kg whose centre is 1 m from the hinge; gravity turns it by 19.62 cos(psi) N m."""
    body = hp.Body(mass=2, inertia=np.diag([0.01, 1, 1]))
    return hp.HingePair(u1=(0, 0, 0), u2=(-1, 0, 0), n=(0, 1, 0), body2=body)


def turned(pair, t, psi, psid, torque, **options):
    return hp.simulate(pair, t, STILL, psi, psid, base="fixed", hinge_torque=torque, **options)


def heavy(rng):
    bodies = [hp.Body(rng.uniform(1, 2), rng.normal(size=3), np.diag(rng.uniform(0.6, 1, 3))) for _ in range(2)]
    return hp.HingePair(*rng.normal(size=(3, 3)), home=rotations(rng, 1)[0], body1=bodies[0], body2=bodies[1])


# friction


def test_friction_holds_a_rod_where_it_is():
    held = turned(rod(), np.linspace(0, 20, 21), 0.0, 0.0, hp.HingeLoad(friction=30))
    np.testing.assert_array_equal(held.psi, 0.0)
    np.testing.assert_array_equal(held.psid, 0.0)
    np.testing.assert_allclose(held.loads["friction_torque"], -19.62, rtol=8 * U)
    np.testing.assert_array_equal(held.loads["hinge_torque"], held.loads["friction_torque"])
    assert held.steps < 10


@pytest.mark.slow
@pytest.mark.parametrize("start", sparse([3.37, 1.0, 0.2, 7.77], 2))
def test_a_swing_against_friction_loses_the_same_angle_each_time(start):
    """Each half swing is half a period about a centre that friction shifts by F / k, to the side it comes from."""
    J, k, friction, t = 2.0, 8.0, 1.0, np.linspace(0, 60, 1201)
    found = turned(wheel(J), t, start, 0.0, hp.HingeLoad(stiffness=k, friction=friction), tol=TIGHT)
    half, shift, expected, end = np.pi / np.sqrt(k / J), friction / k, np.empty(1201), start
    for i in range(50):
        centre = np.sign(end) * shift
        inside = (t >= i * half) & (t <= (i + 1) * half)
        if abs(end) <= shift:
            expected[t >= i * half] = end
            break
        expected[inside] = centre + (end - centre) * np.cos(np.sqrt(k / J) * (t[inside] - i * half))
        end = 2 * centre - end
    np.testing.assert_allclose(found.psi, expected, rtol=0, atol=2 * TIGHT)
    assert found.psi[-1] == found.psi[-2]
    assert found.psid[-1] == 0.0
    assert found.loads["friction_torque"][-1] == pytest.approx(k * found.psi[-1], rel=TIGHT)
    assert found.steps < 500  # 13 for a half swing


@pytest.mark.slow
def test_a_free_pair_keeps_its_momenta_while_its_hinge_sticks():
    rng = generator(51)
    pair, (v, omega) = heavy(rng), rng.normal(size=(2, 3))
    start = hp.BodyMotion(R=rng.normal(size=3), S=rotations(rng, 1)[0], v=v, omega=omega)
    load = hp.HingeLoad(friction=5.0)
    found = hp.simulate(pair, np.linspace(0, 4, 41), start, 0.3, 3.0, gravity=WEIGHTLESS, hinge_torque=load)
    momentum, energy = found.momentum(), found.energy().kinetic
    size = np.abs(found.body1.R).max() * np.abs(momentum.linear).max() + np.abs(momentum.angular).max()
    assert np.ptp(momentum.angular, axis=0).max() <= size * 2.0**-49
    stuck = found.psid == 0
    assert 5 < stuck.sum() < 40
    assert stuck[-1]
    np.testing.assert_allclose(energy[stuck], energy[-1], rtol=10 * TOL)  # a rigid body
    assert np.abs(found.loads["friction_torque"]).max() <= 5 * (1 + 1e-9)
    required = pair.inverse_dynamics(found.body1, found.psi, found.psid, found.psidd, gravity=WEIGHTLESS)
    np.testing.assert_allclose(required.hinge_torque, found.loads["hinge_torque"], rtol=0, atol=10 * TIGHT)
    np.testing.assert_allclose(required.force1, 0, rtol=0, atol=10 * TIGHT)


@pytest.mark.slow
def test_friction_that_hardly_lets_go_does_not_chatter():
    """The hinge turns in a stop where all torques and the friction balance to some 1e-10 of them."""
    rng = np.random.default_rng(32)
    pair = heavy(rng)
    load = hp.HingeLoad(stiffness=5, friction=0.1, stops=(-0.5, 0.4), stop_damping=0.2)
    rng.choice(4)
    _, omega = rng.normal(size=(2, 3))
    start = hp.BodyMotion(R=rng.normal(size=3), S=rotations(rng, 1)[0], omega=omega)
    found = hp.simulate(pair, np.linspace(0, 2, 21), start, 0.4, 0.0, base="pinned", hinge_torque=load, tol=1e-8)
    assert found.steps < 400


# stops


@pytest.mark.slow
@pytest.mark.parametrize("restitution", sparse([0.5, 0.0, 0.8], 2))
def test_a_hinge_bounces_off_a_rigid_stop_and_comes_to_rest_there(restitution):
    """Under a constant torque each bounce is a parabola; their times are a geometric series."""
    t, fall = np.linspace(0, 12, 601), 2.0
    load = hp.HingeLoad(stops=(-1, 1), stop_restitution=restitution, motor=fall)
    found = turned(wheel(), t, 0.0, 0.0, load, tol=TIGHT)
    expected, speed, hit = np.minimum(fall / 2 * t**2, 1), 2.0, 1.0
    expected[t > hit] = 1.0
    while speed > 1e-9 and restitution:
        speed *= restitution
        since = t - hit
        inside = (since >= 0) & (since <= 2 * speed / fall)
        expected[inside] = 1 - speed * since[inside] + fall / 2 * since[inside] ** 2
        hit += 2 * speed / fall
    np.testing.assert_allclose(found.psi, expected, rtol=0, atol=10 * TIGHT)
    assert found.psi[-1] == 1.0
    assert found.psid[-1] == 0.0
    assert found.loads["stop_torque"][-1] == pytest.approx(-fall, rel=TIGHT)
    assert found.loads["motor_torque"][-1] == fall


@pytest.mark.slow
@pytest.mark.parametrize("span", [6.0, 60.0])
def test_bounces_come_to_rest_at_every_tolerance(span):
    """The second run for the estimate has a tolerance below the rounding of impacts."""
    rng = generator(3)
    for _ in range(4):
        low = rng.uniform(-0.5, 0.3)
        load = hp.HingeLoad(stops=(low - 0.5, low + rng.uniform(0.3, 1)), stop_restitution=rng.uniform(0.2, 0.8))
        moved = turned(rod(), [0, span], low + rng.uniform(-0.2, 0.2), 0.0, load)
        assert moved.psi_error_estimate < 10 * TIGHT


@pytest.mark.slow
@pytest.mark.parametrize("restitution", [1.0, 0.6])
def test_impacts_of_a_free_pair_keep_momenta_and_elastic_ones_energy(restitution):
    rng = generator(52)
    pair, (v, omega) = heavy(rng), rng.normal(size=(2, 3))
    start = hp.BodyMotion(R=rng.normal(size=3), S=rotations(rng, 1)[0], v=v, omega=omega)
    load, t = hp.HingeLoad(stops=(0, 0.5), stop_restitution=restitution), np.linspace(0, 2, 41)
    found = hp.simulate(pair, t, start, 0.3, 3.0, gravity=WEIGHTLESS, tol=1e-11, hinge_torque=load)
    assert 0 <= found.psi.min() < 0.1
    assert 0.4 < found.psi.max() <= 0.5
    momentum, energy = found.momentum(), found.energy().kinetic
    size = np.abs(found.body1.R).max() * np.abs(momentum.linear).max() + np.abs(momentum.angular).max()
    assert np.ptp(momentum.angular, axis=0).max() <= size * 2.0**-49
    if restitution == 1:
        np.testing.assert_allclose(energy, energy[0], rtol=TOL)
    else:
        assert np.diff(energy).max() < 10 * TOL * energy[0]
        assert (np.diff(energy) < -1e-3 * energy[0]).sum() >= 3  # impacts


def test_a_rigid_stop_lets_go_what_is_pulled_away():
    load = hp.HingeLoad(stops=(-1, 1), stop_restitution=0.0, motor=lambda t, *_: np.cos(t))
    found = turned(wheel(), np.linspace(0, 3, 31), 1.0, 0.0, load, tol=TIGHT)
    since = np.maximum(found.t - np.pi / 2, 0)
    np.testing.assert_allclose(found.psi, 1 + np.sin(since) - since, rtol=0, atol=TIGHT)
    with pytest.raises(hp.ArgumentError, match=r"^psi_0: expected a coordinate between the rigid stops, -1 to 1,"):
        turned(wheel(), [0, 1], 1.1, 0.0, load)


@pytest.mark.filterwarnings("ignore:psi passes the stops")
@pytest.mark.parametrize("speed", sparse([1.0, 1e-3, 30.0], 3))
def test_a_stop_that_is_a_damped_spring_takes_what_hunt_and_crossley_say(speed):
    """Whatever its stiffness; and it never pulls."""
    load = hp.HingeLoad(stops=(-5, 0), stop_stiffness=1e4, stop_damping=0.5)
    given = {"gravity": WEIGHTLESS, "tol": TIGHT}
    found = turned(wheel(), np.linspace(0, 1.5 / speed + 0.5, 101), -speed * 1e-3, speed, load, **given)
    into, out = 0.5 * speed, -0.5 * found.psid[-1]
    assert into - np.log1p(into) == pytest.approx(-out - np.log1p(-out), rel=1000 * TOL)
    assert found.loads["stop_torque"].max() <= 0.0


# jumps of loads in time


def pulse(t, _psi, _psid):
    return np.where(np.abs(t - 35.003) < 0.15, 10.0, 0.0)


@pytest.mark.slow
def test_a_short_pulse_in_a_long_rest_is_not_missed():
    t = np.linspace(0, 100, 11)
    found = turned(wheel(3.0), t, 0.0, 0.0, pulse, gravity=WEIGHTLESS)
    assert found.psid[-1] == pytest.approx(1.0, abs=100 * TOL)
    assert abs(found.psi[-1] - (100 - 35.003)) <= 2 * found.psi_error_estimate
    known = turned(wheel(3.0), t, 0.0, 0.0, pulse, gravity=WEIGHTLESS, breaks=(34.853, 35.153))
    np.testing.assert_allclose(known.psi[-1], 100 - 35.003, rtol=0, atol=10 * TIGHT)
    assert known.steps < 20


def test_a_jump_at_the_last_instant_ends_the_steps_before_it():
    def torque(t, *_):
        return np.where(t < 1, 1.0, 5.0)

    for breaks in ((), (1.0,)):
        found = turned(wheel(), np.linspace(0, 1, 5), 0.0, 0.0, torque, breaks=breaks)
        np.testing.assert_allclose(found.psid[-1], 1.0, rtol=0, atol=10 * TOL)
        assert found.steps < (8 if breaks else 60)


# always ending


@pytest.mark.slow
def test_a_load_that_chatters_is_named_within_bounded_work():
    calls = []

    def rub(_t, _psi, psid):
        calls.append(1)
        return -0.5 * np.sign(psid)

    with pytest.raises(
        hp.errors.SimulationError, match=r"hinge_torque jumps from 0\.5 to -0\.5 at psi' = .*friction"
    ) as found:
        turned(wheel(), [0, 4], 0.0, 1.0, rub)
    assert found.value.t == pytest.approx(2.0, abs=0.01)  # s: where the search gave up
    assert len(calls) < 150_000


# the user's event


def crossed(level, direction=0):
    def event(_t, now):
        return now.psi - level

    event.direction = direction
    return event


@pytest.mark.slow
def test_a_motion_ends_at_the_event_of_the_user():
    t = np.linspace(0, 5, 51)
    whole = turned(rod(), t, 0.0, 0.0, 0.0, tol=TIGHT)
    cut = turned(rod(), t, 0.0, 0.0, 0.0, tol=TIGHT, until=crossed(1.0))
    assert cut.psi[-1] == pytest.approx(1.0, abs=512 * U)
    n = len(cut.t) - 1
    assert t[n - 1] < cut.t[-1] < t[n]
    np.testing.assert_allclose(cut.psi[:n], whole.psi[:n], rtol=0, atol=10 * TIGHT)
    assert cut.R2.shape == (n + 1, 3)
    assert cut.psi_error_estimate < 10 * TOL
    back = turned(rod(), t, 0.0, 0.0, 0.0, tol=TIGHT, until=crossed(1.0, -1))
    assert back.psi[-1] == pytest.approx(1.0, abs=512 * U)
    assert back.psid[-1] == pytest.approx(-cut.psid[-1], rel=TOL)
    np.testing.assert_array_equal(turned(rod(), t, 0.0, 0.0, 0.0, until=crossed(4.0)).t, t)


def test_an_event_that_is_zero_at_the_start_waits_for_the_next():
    swing = turned(rod(), np.linspace(0, 5, 51), 0.0, 0.0, 0.0, tol=TIGHT, until=crossed(0.0, 0))
    assert swing.t[-1] > 1


@pytest.mark.parametrize("restitution", [0.0, 0.5])
@pytest.mark.parametrize(("power", "direction"), [(1, 0), (1, 1), (9, 0), (9, 1)])
def test_a_value_that_comes_to_zero_at_a_rigid_stop_ends_the_motion(restitution, power, direction):
    """The stop takes psi to its angle, from which the value stays 0 or turns back."""
    stops = hp.HingeLoad(stops=(-9, 1.2), stop_restitution=restitution)

    def event(_t, now):
        return now.psi**power - 1.2**power

    event.direction = direction
    found = turned(wheel(), [0.0, 6.0], -3.0, 1.0, stops, until=event)
    assert found.ended_by_event
    assert found.t[-1] == pytest.approx(4.2, rel=512 * U)


@pytest.mark.parametrize("restitution", [0.5, 1.0])
def test_a_value_that_turns_back_at_a_rigid_stop_has_not_passed_the_other_way(restitution):
    stops = hp.HingeLoad(stops=(-9, 1.2), stop_restitution=restitution)
    found = turned(wheel(), [0.0, 6.0], -3.0, 1.0, stops, until=crossed(1.2, -1))
    assert not found.ended_by_event
    assert found.t[-1] == 6.0


@pytest.mark.parametrize(
    ("load", "end"),
    [
        (hp.HingeLoad(stops=(-1, 1.2), stop_restitution=0.0), 1.2),
        (hp.HingeLoad(stops=(-1, 1.2), stop_restitution=0.5), 1.2),
        (hp.HingeLoad(friction=0.5), 2.0),
    ],
    ids=["caught", "bounced", "rubbed"],
)
def test_a_rate_that_comes_to_zero_ends_the_motion_before_the_impact(load, end):
    for power in (1, 3):
        found = turned(wheel(), [0.0, 4.0], 0.0, 1.0, load, until=lambda _t, now, power=power: now.psid**power)
        assert found.ended_by_event
        assert found.t[-1] == pytest.approx(end, rel=512 * U if power == 1 else 1e-6)
        assert found.psid[-1] == pytest.approx(1.0 if end == 1.2 else 0.0, abs=1e-5)  # rad/s: the cube of it is 0


def test_an_event_that_is_undefined_from_some_angle_on_is_no_event():
    """It was one where rounding put the end of the step just before that angle."""
    for limit in np.linspace(0.5, 2.4, 20):
        with pytest.raises(hp.ArgumentError, match="until: expected a finite number"):
            hp.simulate(
                wheel(), [0, 5], STILL, 0.0, 1.0, base="fixed", hinge_torque=0.1,
                until=lambda _, now, limit=limit: np.where(now.psi > limit, np.nan, 2 * np.pi - now.psi),
            )  # fmt: skip
