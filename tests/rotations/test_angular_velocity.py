"""Angular velocity from S' (E3)."""

from __future__ import annotations

import numpy as np

import hingepair as hp
from support.states import generator, rotations

U = 2.0**-53


def test_defect_is_the_symmetric_part():
    rng = generator(83)
    S, w = rotations(rng, 30), rng.normal(size=(30, 3))
    symmetric = rng.normal(size=(30, 3, 3))
    symmetric += np.swapaxes(symmetric, -1, -2)
    omega, defect = hp.angular_velocity(S, (hp.skew(w) + symmetric) @ S, with_defect=True)
    assert abs(omega - w).max() <= 32 * U * abs(w).max() * 4
    assert abs(defect - abs(symmetric).max(axis=(-2, -1))).max() <= 64 * U * abs(symmetric).max()
    clean, none = hp.angular_velocity(S, hp.skew(w) @ S, with_defect=True)
    assert none.max() <= 16 * U * abs(w).max()
    assert np.array_equal(clean, hp.angular_velocity(S, hp.skew(w) @ S))
    S[3, 0, 0] = np.nan
    _, lost = hp.angular_velocity(S, hp.skew(w) @ S, with_defect=True)
    assert np.flatnonzero(np.isnan(lost)).tolist() == [3]
