"""Random rates and starts of many motions for `integrate`, and the pairs that move by them."""

from __future__ import annotations

import numpy as np

import hingepair as hp
from support.states import generator

PAIR = hp.HingePair(u1=(0.5, 0.2, 0.1), u2=(-0.25, 0.1, 0.3), n=(1, 2, -0.5))
FLAT = hp.PlanarPair(u1=(0.5, 0.2), u2=(-0.25, 0.1))
SPATIAL_NAMES = ("quat_wxyz", "quat_xyzw", "psi", "R1", "S1", "R2", "S2", "d", "v2", "omega2", "a2", "alpha2")
ERROR_NAMES = ("error_estimate", "psi_error_estimate", "steps")


def many_motions(seed, motions, t):
    """Return (omega1, psid, R1, v1, S1_0, psi_0) of a number of motions at the instants t."""
    random = generator(seed)
    omega1 = random.normal(size=(motions, 1, 3)) * np.sin(t[:, None] * (1, 2, 3) + 1)
    psid = random.normal(size=(motions, 1)) * np.cos(t)
    R1, v1 = random.normal(size=(2, motions, t.size, 3))
    return omega1, psid, R1, v1, hp.rotation_exp(random.normal(size=(motions, 3))), random.normal(size=motions)
