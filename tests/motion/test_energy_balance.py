"""What loads have done along a simulated motion, and that nothing else has."""

from __future__ import annotations

import numpy as np

import hingepair as hp
from support.near import TIGHT

STILL = hp.BodyMotion(R=(0, 0, 0), S=np.eye(3))


def test_an_impact_at_the_first_instant_counts():
    pair = hp.HingePair((0, 0, 0), (0, 0, 0), (0, 0, 1), body2=hp.Body(1.0, inertia=(1, 1, 1)))
    stop = hp.HingeLoad(stops=(-1, 1), stop_restitution=0.5)
    found = hp.simulate(pair, np.linspace(0, 1, 5), STILL, 1.0, 2.0, base="fixed", hinge_torque=stop)
    balance = found.energy_balance()
    np.testing.assert_allclose(balance.work["impacts"], [0, -1.5, -1.5, -1.5, -1.5], rtol=TIGHT)
    np.testing.assert_allclose(balance.residual, 0, rtol=0, atol=TIGHT)
