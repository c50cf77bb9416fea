"""Forces within limits against all combinations of limits."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from hingepair.motion.events import forces_within_limits
from support.near import U
from support.states import generator


def by_enumeration(mobility, free, lowest, highest):
    """Return the forces of the one choice of limits that agrees with itself."""
    n = len(free)
    for sides in itertools.product((-1, 0, 1), repeat=n):
        side = np.array(sides)
        forces = np.where(side < 0, lowest, highest)
        within = side == 0
        if not np.isfinite(forces[~within]).all():
            continue
        forces[within] = 0.0
        if within.any():
            rest = (free + mobility @ forces)[within]
            forces[within] = np.linalg.solve(mobility[np.ix_(within, within)], -rest)
        a = free + mobility @ forces
        inside = (forces[within] >= lowest[within]) & (forces[within] <= highest[within])
        if inside.all() and (a[side < 0] >= 0).all() and (a[side > 0] <= 0).all():
            return forces
    raise AssertionError("no solution")


@pytest.mark.parametrize("seed", range(40))
def test_forces_are_those_of_the_only_consistent_choice(seed):
    rng = generator(700 + seed)
    n = int(rng.integers(1, 6))
    root = rng.normal(size=(n, n))
    mobility, free = root @ root.T + 0.05 * np.eye(n), 3 * rng.normal(size=n)
    lowest, highest = -rng.uniform(0, 2, n), rng.uniform(0, 2, n)
    lowest[rng.random(n) < 0.3], highest[rng.random(n) < 0.3] = -np.inf, np.inf
    expected = by_enumeration(mobility, free, lowest, highest)
    found = forces_within_limits(mobility, free, lowest, highest)
    np.testing.assert_allclose(found, expected, rtol=0, atol=8192 * U * (1 + np.abs(expected).max(initial=0)))
