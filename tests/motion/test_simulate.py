"""Motion under forces: closed cases, what is conserved, and forces found again from the motion."""

from __future__ import annotations

from dataclasses import replace

import mpmath
import numpy as np
import pytest

import hingepair as hp
from support.near import TIGHT, TOL, U
from support.sparse import sparse
from support.states import generator, rotations

STILL = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
WEIGHTLESS = (0.0, 0.0, 0.0)


def heavy(rng):
    bodies = (hp.Body(rng.uniform(1, 2), rng.normal(size=3), np.diag(rng.uniform(0.6, 1, 3))) for _ in range(2))
    body1, body2 = bodies
    return hp.HingePair(*rng.normal(size=(3, 3)), home=rotations(rng, 1)[0], body1=body1, body2=body2)


def thrown(rng):
    v, omega = rng.normal(size=(2, 3))
    return hp.BodyMotion(R=rng.normal(size=3), S=rotations(rng, 1)[0], v=v, omega=omega)


def pendulum():
    rod = hp.Body(mass=2, inertia=np.diag([0.01, 1, 1]))
    return hp.HingePair(u1=(0, 0, 0), u2=(-1, 0, 0), n=(0, 1, 0), body2=rod)


def flywheel():
    return hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=hp.Body(1.0, inertia=np.eye(3)))


@pytest.mark.slow
@pytest.mark.parametrize("tol", sparse([1e-7, 1e-11], 2))
def test_a_pendulum_swings_as_jacobi_says(tol):
    """Let go at 2 rad from rest below: sin(angle / 2) = k cd(w t), k = sin 1, of a compound pendulum."""
    t = np.linspace(0, 20, 101)
    swing = hp.simulate(pendulum(), t, STILL, psi_0=np.pi / 2 - 2, psid_0=0.0, base="fixed", tol=tol)
    k, w = mpmath.sin(1), mpmath.sqrt(2 * mpmath.mpf("9.81") / 3)  # m g l / (I + m l^2) with m = 2, l = 1, I = 1
    below = [2 * mpmath.asin(k * mpmath.ellipfun("cd", w * mpmath.mpf(float(x)), k=k)) for x in t]
    error = np.abs(np.pi / 2 - swing.psi - np.array(below, float)).max()
    assert error <= 100 * tol + 512 * U
    assert swing.psi_error_estimate <= 100 * tol
    assert error <= 3 * swing.psi_error_estimate + 512 * U


@pytest.mark.slow
def test_a_symmetric_top_precesses():
    """Two bodies of one axis, which is the hinge's: body 1 precesses about the angular momentum, uniformly."""
    transverse, axial = 0.8, 0.3
    wheel = hp.Body(1.0, inertia=np.diag([transverse, transverse, axial]))
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body1=wheel, body2=wheel)
    omega = np.array([0.7, 0.0, 2.0])
    body1 = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), v=(0, 0, 0), omega=omega)
    t = np.linspace(0, 12, 25)
    top = hp.simulate(pair, t, body1, 0.0, -1.5, gravity=WEIGHTLESS, tol=TIGHT)
    momentum = np.array([2 * transverse * omega[0], 0, 2 * axial * omega[2] + axial * -1.5])
    rate = momentum / (2 * transverse)  # the axis turns with L / transverse
    axis = np.stack([hp.rotation_exp(x * rate) @ (0, 0, 1) for x in t])
    np.testing.assert_allclose(top.S1[:, :, 2], axis, rtol=0, atol=1024 * U)
    np.testing.assert_allclose(top.psi, -1.5 * t, rtol=0, atol=1024 * U)


@pytest.mark.slow
@pytest.mark.parametrize("seed", sparse(range(3), 3))
def test_a_free_pair_keeps_its_momenta_and_its_energy(seed):
    rng = generator(30, seed)
    free = hp.simulate(heavy(rng), np.linspace(0, 4, 81), thrown(rng), 0.3, 1.0, gravity=WEIGHTLESS, tol=TIGHT)
    momentum, energy = free.momentum(), free.energy().kinetic
    size = 1 + np.abs(free.R1).max() * np.abs(momentum.linear).max() + np.abs(momentum.angular).max()
    assert np.ptp(momentum.linear, axis=0).max() <= 8 * U * size
    assert np.ptp(momentum.angular, axis=0).max() <= 32 * U * size
    assert np.ptp(energy) <= 512 * U * energy.max()


@pytest.mark.slow
def test_forces_are_found_again_from_the_motion():
    rng = generator(31)
    pair, start, t = heavy(rng), thrown(rng), np.linspace(0, 3, 31)

    def motor(t, psi, psid):
        return 0.3 * np.cos(t) - 0.1 * psid - 0.5 * np.sin(psi)

    def thrust(t, now):
        return np.stack([np.sin(t), -now.v1[:, 1], now.psi], axis=-1)

    push = (0.1, 0, -0.2)
    moved = hp.simulate(pair, t, start, 0.3, 1.0, force1=thrust, torque1=push, hinge_torque=motor, tol=TIGHT)
    forces = pair.inverse_dynamics(moved.body1, moved.psi, moved.psid, moved.psidd)
    thrusts = np.stack([np.sin(t), -moved.body1.v[:, 1], moved.psi], axis=-1)
    np.testing.assert_allclose(forces.force1, thrusts, rtol=0, atol=TIGHT)
    np.testing.assert_allclose(forces.torque1, np.broadcast_to(push, (31, 3)), rtol=0, atol=TIGHT)
    np.testing.assert_allclose(forces.hinge_torque, motor(t, moved.psi, moved.psid), rtol=0, atol=TIGHT)
    balance = moved.energy_balance()
    assert np.abs(balance.residual).max() < TIGHT * balance.kinetic.max()
    assert {*balance.work} == {"force1", "torque1", "motor"}


DOOR = (0.0, 1.5)  # its stops; of inertia 4, stiffness 1e4: half a swing of 50 rad/s in a stop, then 3 rad/s


def door(tol, hinge_torque):
    body = hp.Body(mass=1, inertia=(4, 4, 4))
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=body)
    given = {"base": "fixed", "hinge_torque": hinge_torque, "tol": tol}
    found = hp.simulate(pair, np.linspace(0, 3, 301), STILL, 0.3, 3.0, **given)
    flight, contact = DOOR[1] / 3, np.pi / 50
    since = np.mod(found.t + 0.1, 2 * (flight + contact))
    way = since % (flight + contact)
    psi = np.where(way < flight, 3 * way, DOOR[1] + 3 / 50 * np.sin(50 * (way - flight)))
    return found, np.abs(found.psi - np.where(since < flight + contact, psi, DOOR[1] - psi)).max()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:psi passes the stops")
@pytest.mark.parametrize("tol", sparse([1e-8, 1e-4, 1e-6, 1e-10, 1e-12, 1e-14], 6))
def test_a_door_between_its_stops_is_found_within_the_tolerance(tol):
    """Steps end where psi meets a stop; the estimate is neither far above the error nor below it."""
    found, error = door(tol, hp.HingeLoad(stops=DOOR))
    _, of_motor = door(tol, hp.HingeLoad(stops=(-1, 2), motor=hp.HingeLoad(stops=DOOR)))
    assert max(error, of_motor) <= tol + TIGHT
    assert error / 3 - TIGHT <= found.psi_error_estimate <= 10 * error + TIGHT


@pytest.mark.slow
@pytest.mark.parametrize("tol", sparse([1e-8, 1e-6, 1e-10], 3))
def test_kinks_that_nobody_names_cost_steps_and_not_the_tolerance(tol):
    """Eight of them, in 3 s."""
    found, error = door(tol, lambda _t, psi, _psid: 1e4 * (np.clip(psi, *DOOR) - psi))
    assert error <= 200 * tol
    assert error / 3 - TIGHT <= found.psi_error_estimate <= 10 * error + TIGHT


@pytest.mark.parametrize("torque", [3.0, -3.0, 0.0])
def test_a_hinge_that_starts_at_rest_at_its_stop_goes_where_it_is_pushed(torque):
    t, stops = np.linspace(0, 0.5, 51), hp.HingeLoad(stops=(-1, 1), motor=torque)
    found = hp.simulate(flywheel(), t, STILL, 1.0, 0.0, base="fixed", hinge_torque=stops, tol=TIGHT)
    expected = torque / 2 * t**2 if torque < 0 else torque / 1e4 * (1 - np.cos(100 * t))
    np.testing.assert_allclose(found.psi - 1, expected, rtol=0, atol=TIGHT)


def test_a_stop_that_is_hardly_touched_is_felt():
    """Thrown up against a torque of -1, psi would turn 5e-7 beyond the stop, in 2 ms of a step of seconds."""
    stops = hp.HingeLoad(stops=(-1, 2 - 5e-7), stop_stiffness=1e6, motor=-1.0)
    found = hp.simulate(flywheel(), [0.0, 3.0], STILL, 0.0, 2.0, base="fixed", hinge_torque=stops, tol=1e-6)
    felt, speed, sag = 1000.0, 1e-3, 1e-6  # inside, psi + sag swings as speed / felt sin + sag cos
    inside = 2 * np.arctan2(speed, sag * felt) / felt
    assert found.psid[-1] == pytest.approx(-speed - (3.0 - (2 - speed) - inside), abs=10 * TIGHT)


def test_time_stamps_of_a_clock_cost_nothing():
    stops, t = hp.HingeLoad(stops=(-0.2, 0.2)), np.linspace(0, 1, 9)
    early, late = (
        hp.simulate(flywheel(), t + since, STILL, 0.0, 1.0, base="fixed", hinge_torque=stops) for since in (0, 1.7e9)
    )
    np.testing.assert_allclose(late.psi, early.psi, rtol=0, atol=512 * U)


@pytest.mark.slow
def test_a_motion_without_end_is_refused_where_it_ends():
    calls = []

    def torque(t, psi, _):  # psi'' = 2 psi^3 has the solution 1 / (1 - t)
        calls.append(t)
        return 2 * psi**3

    with pytest.raises(hp.errors.SimulationError) as caught:
        hp.simulate(flywheel(), [0.0, 10.0], STILL, 1.0, 1.0, base="fixed", hinge_torque=torque)
    assert caught.value.t == pytest.approx(1.0, abs=1e4 * TOL)
    assert len(calls) < 15_000


@pytest.mark.parametrize("where", ["load", "motor"])
def test_a_stop_beyond_its_limit_does_not_guard_it(where):
    limited = replace(flywheel(), limits=(0, 1))
    stops = hp.HingeLoad(stops=(-5, 5))
    torque = stops if where == "load" else hp.HingeLoad(damping=1e-3, motor=stops)
    with pytest.warns(
        hp.DynamicsWarning, match=r"psi leaves its limits, 0 to 1 rad: it reaches 2\.9\d* rad at t = 3 s"
    ):
        hp.simulate(limited, [0, 1, 2, 3], STILL, 0.0, 0.99, base="fixed", hinge_torque=torque)


def test_what_happens_between_the_instants_is_warned_of():
    """Out and back within the two instants that were asked for."""
    pair = replace(pendulum(), limits=(0, 1))
    with pytest.warns(hp.DynamicsWarning, match=r"it reaches 3\.14159 rad"):
        swing = hp.simulate(pair, [0, 2.96188], STILL, 0.0, 0.0, base="fixed")  # nearly a period
    assert swing.psi.max() < 0.1
    assert swing.psi_range == (pytest.approx(0, abs=TIGHT), pytest.approx(np.pi, abs=1e4 * TOL))
    spring = hp.HingeLoad(stops=(-1, 1), stop_stiffness=1.0)
    with pytest.warns(hp.DynamicsWarning, match="psi passes the stops by"):
        hp.simulate(pendulum(), [0, 2.9], STILL, 0.0, 0.0, base="fixed", hinge_torque=spring)


@pytest.mark.slow
def test_an_event_that_is_undefined_beyond_a_stop_is_followed():
    stops = hp.HingeLoad(stops=(-1, 1), stop_restitution=0.5)

    def event(_, now):
        return np.where(now.psi > 1 + 1e-9, np.nan, 2 - now.psi)

    end = hp.simulate(pendulum(), [0, 5], STILL, 0.0, 0.0, base="fixed", hinge_torque=stops, until=event)
    assert end.psi[-1] == 1


def test_numbers_that_look_like_degrees_are_warned_of():
    for name, given in (
        ("stops: 90 is taken for radians", {"hinge_torque": hp.HingeLoad(stops=(-90, 90))}),
        ("psi_0: 45 is taken for radians", {"psi_0": 45.0}),
        ("psid_0: 180 is taken for rad/s", {"psid_0": 180.0}),
    ):
        with pytest.warns(hp.DynamicsWarning, match=name):
            hp.simulate(flywheel(), [0, 0.01], STILL, **{"psi_0": 0.0, "psid_0": 0.0, "base": "fixed"} | given)
    body = hp.Body(1.0, inertia=(1, 1, 1))
    pair, turning = replace(flywheel(), body1=body), hp.BodyMotion(R=(0, 0, 0), S=np.eye(3), omega=(0, 0, 90))
    with pytest.warns(hp.DynamicsWarning, match=r"body1\.omega: 90 is taken for rad/s"):
        hp.simulate(pair, [0, 0.01], turning, 0.0, 0.0)


def sum_of_errors(total, _, psi):
    total[0] += np.mean(1 - psi) * 0.01


def integral_of_errors(total, t, psi):
    """As controllers do, by the time since the last call, which may be negative."""
    total[0] += np.mean(1 - psi) * (t[-1] - total[1])
    total[1] = t[-1]


def integral_forwards(total, t, psi):
    if t[-1] > total[1]:
        integral_of_errors(total, t, psi)


@pytest.mark.parametrize("late", [False, True], ids=["at the start", "later"])
@pytest.mark.parametrize("add", [sum_of_errors, integral_of_errors, integral_forwards])
def test_a_controller_with_a_memory_is_named(late, add):
    """It would be called at trial steps, in any order: its sum means nothing, and steps never agree."""
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=hp.Body(1.0, inertia=(1, 1, 1)))
    total, calls = np.zeros(2), []

    def torque(t, psi, psid):
        calls.append(t)
        if not late or t.min() > 0.1:
            add(total, t, psi)
        return 5 * (1 - psi) - 2 * psid + total[0]

    start = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))
    with pytest.raises(
        hp.ArgumentError, match="hinge_torque: expected a callable that returns the same values whenever"
    ):
        hp.simulate(pair, [0, 5], start, 0.0, 0.0, hinge_torque=torque, base="fixed")
    assert len(calls) <= (5000 if late else 3)
