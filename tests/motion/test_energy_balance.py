"""What loads have done along a simulated motion, and that nothing else has."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.hinged import shaken
from support.near import TIGHT, TOL
from support.states import generator, rotations

STILL = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:psi passes the stops")
@pytest.mark.parametrize(
    ("base", "stop"), [("free", "impacts"), ("pinned", "stop"), ("fixed", "impacts"), ("carried", "stop")]
)
def test_the_energies_of_a_pair_grow_by_the_work_of_its_loads(base, stop):
    rng = generator(81)
    bodies = [hp.Body(rng.uniform(1, 2), rng.normal(size=3), rng.uniform(0.6, 1, 3)) for _ in range(2)]
    pair = hp.HingePair(*rng.normal(size=(3, 3)), home=rotations(rng, 1)[0], body1=bodies[0], body2=bodies[1])
    (R, v, omega), S = rng.normal(size=(3, 3)), rotations(rng, 1)[0]
    moving = {"free": {"v": v, "omega": omega}, "pinned": {"omega": omega}}.get(base, {})
    start = None if base == "carried" else hp.BodyMotion(R=R, S=S, **moving)
    load = hp.HingeLoad(
        stiffness=2, damping=0.1, friction=0.5, stops=(-0.1, 0.2), motor=lambda t, *_: 3 * np.sin(2 * t),
        **({"stop_restitution": 0.5} if stop == "impacts" else {"stop_damping": 0.2}),
    )  # fmt: skip
    torque1 = {"torque1": lambda t, _: np.stack([np.sin(t)] * 3, -1)}
    on_body1 = {"free": {"force1": (0.1, 0, 0.3)} | torque1, "pinned": torque1}.get(base, {})
    found = hp.simulate(
        pair, np.linspace(0, 2, 41), start, 0.1, 2.0, hinge_torque=load, force2=(1, 0, 0), torque2=(0, 0.3, 0),
        base=shaken if base == "carried" else base, tol=1e-11, **on_body1,
    )  # fmt: skip
    balance = found.energy_balance()
    size = 1 + np.abs(balance.kinetic).max() + np.abs(balance.potential).max()
    assert np.abs(balance.residual).max() <= 10 * TOL * size
    others = {*on_body1} | ({"base"} if base == "carried" else set())
    assert {*balance.work} == {"motor", "spring", "damper", "friction", "force2", "torque2", stop} | others
    assert max(balance.work[loss][-1] for loss in ("damper", "friction", stop)) < -1e-3  # J
    assert np.diff(balance.work["friction"]).max() <= TIGHT


def test_an_impact_at_the_first_instant_counts():
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=hp.Body(1.0, inertia=(1, 1, 1)))
    stop = hp.HingeLoad(stops=(-1, 1), stop_restitution=0.5)
    found = hp.simulate(pair, np.linspace(0, 1, 5), STILL, 1.0, 2.0, base="fixed", hinge_torque=stop)
    balance = found.energy_balance()
    np.testing.assert_allclose(balance.work["impacts"], [0, -1.5, -1.5, -1.5, -1.5], rtol=TIGHT)
    np.testing.assert_allclose(balance.residual, 0, rtol=0, atol=TIGHT)
