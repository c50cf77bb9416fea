"""What loads have done along a simulated motion, and that nothing else has."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.near import TIGHT, TOL
from support.states import generator, rotations

STILL = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))


def heavy(rng):
    bodies = [hp.Body(rng.uniform(1, 2), rng.normal(size=3), np.diag(rng.uniform(0.6, 1, 3))) for _ in range(2)]
    return hp.HingePair(*rng.normal(size=(3, 3)), home=rotations(rng, 1)[0], body1=bodies[0], body2=bodies[1])


def shaken(t):
    zero = np.zeros((len(t), 3))
    wave = np.stack([np.sin(3 * t), 0 * t, 0 * t], axis=-1)
    rate = np.stack([3 * np.cos(3 * t), 0 * t, 0 * t], axis=-1)
    turn = hp.rodrigues((0, 0, 1), 0.5 * t)
    return hp.BodyMotion(R=wave, S=turn, v=rate, omega=(0, 0, 0.5), a=-9 * wave, alpha=zero)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:psi passes the stops")
@pytest.mark.parametrize("base", ["free", "pinned", "fixed", "carried"])
@pytest.mark.parametrize("rigid", [False, True])
def test_the_energies_grow_by_the_work_of_the_loads(base, rigid):
    rng = generator(81)
    pair, (v, omega) = heavy(rng), rng.normal(size=(2, 3))
    moving = {"free": {"v": v, "omega": omega}, "pinned": {"omega": omega}}.get(base, {})
    start = None if base == "carried" else hp.BodyMotion(R=rng.normal(size=3), S=rotations(rng, 1)[0], **moving)
    stops = {"stop_restitution": 0.5} if rigid else {"stop_damping": 0.2}
    load = hp.HingeLoad(
        stiffness=2, damping=0.1, friction=0.5, stops=(-0.1, 0.2), motor=lambda t, *_: 3 * np.sin(2 * t), **stops
    )
    loads = {"force2": (1, 0, 0)}
    if base in ("free", "pinned"):
        loads |= {"force1": (0.1, 0, 0.3), "torque1": lambda t, _: np.stack([np.sin(t)] * 3, -1)}
    found = hp.simulate(
        pair, np.linspace(0, 2, 41), start, 0.1, 2.0, hinge_torque=load, torque2=(0, 0.3, 0), tol=1e-11,
        base=shaken if base == "carried" else base, **loads,
    )  # fmt: skip
    balance = found.energy_balance()
    size = 1 + np.abs(balance.kinetic).max() + np.abs(balance.potential).max()
    assert np.abs(balance.residual).max() <= 10 * TOL * size
    expected = {"motor", "spring", "damper", "friction", "force2", "torque2", "impacts" if rigid else "stop"}
    expected |= {"free": {"force1", "torque1"}, "pinned": {"torque1"}, "carried": {"base"}}.get(base, set())
    assert {*balance.work} == expected
    for loss in ("damper", "friction", "impacts" if rigid else "stop"):
        assert balance.work[loss][-1] < -1e-3
    assert np.diff(balance.work["friction"]).max() <= TIGHT


def test_an_impact_at_the_first_instant_counts():
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=hp.Body(1.0, inertia=(1, 1, 1)))
    stop = hp.HingeLoad(stops=(-1, 1), stop_restitution=0.5)
    found = hp.simulate(pair, np.linspace(0, 1, 5), STILL, 1.0, 2.0, base="fixed", hinge_torque=stop)
    balance = found.energy_balance()
    np.testing.assert_allclose(balance.work["impacts"], [0, -1.5, -1.5, -1.5, -1.5], rtol=TIGHT)
    np.testing.assert_allclose(balance.residual, 0, rtol=0, atol=TIGHT)
