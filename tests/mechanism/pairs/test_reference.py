"""The oracle against itself, and against a closed form."""

from __future__ import annotations

import mpmath
import numpy as np

from hingepair.bench import truth as reference
from hingepair.bench.truth import OUTPUTS
from support import states, truths


def test_the_reference_agrees_with_itself():
    """Two independent ways through the oracle, and omega1 of the reference example in closed form."""
    t = np.linspace(0.0, 10.0, 11)
    q, qd, qdd = states.reference_example(t)
    truth = truths.from_euler(states.REFERENCE_PAIR, q, qd, qdd)
    x, y = q[:, 3].astype(object) + mpmath.mpf(0), q[:, 4].astype(object) + mpmath.mpf(0)
    with mpmath.workdps(reference.DIGITS):
        for i in range(len(t)):
            cx, sx, cy, sy = mpmath.cos(x[i]), mpmath.sin(x[i]), mpmath.cos(y[i]), mpmath.sin(y[i])
            exact = (3 + 5 * sy, cx - 5 * sx * cy, sx + 5 * cx * cy)
            for got, expected in zip(truth.values["omega1"][i], exact, strict=True):
                assert abs(got - expected) < mpmath.mpf(10) ** -55
    body1 = (q[:, :3], truth.values["S1"], qd[:, :3], truth.values["omega1"], qdd[:, :3], truth.values["alpha1"])
    again = reference.from_attitude(states.REFERENCE_PAIR, body1, q[:, 6], qd[:, 6], qdd[:, 6])
    for name in OUTPUTS:
        scale = 1 + float(abs(truth.values[name]).max())
        # omega1 and alpha1 were rounded to doubles on the way.
        assert float(abs(truth.values[name] - again.values[name]).max()) <= 64 * 2.0**-53 * scale, name
