"""The constants that a robot makes of axes, and a pair of u1, u2, n and home: near the exact ones, at any size."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS, exactly, unit
from hingepair.mechanism.requests import subject_of
from support.states import generator, rotations

U = 2.0**-53
CASES = {
    "ordinary": (1.0, 1.0, 1.0),
    "short": (1e-290, 1e-290, 1e-300),
    "long": (1e290, 1e290, 1e300),
    "unequal": (1e-8, 1e8, 1.0),
    "u1 far longer": (1e200, 1e-200, 1.0),
    "u2 far longer": (1e-200, 1e200, 1.0),
    "subnormal axis": (1.0, 1.0, 1e-310),
}


@pytest.mark.parametrize("case", CASES)
def test_frames_of_the_hinge(case):
    """The axes e1, e2 and n of the tree, each entry rounded once; and in these the vector from the hinge to R2."""
    sizes, rng = CASES[case], generator(80)
    u1, u2, n = (rng.normal(size=(40, 3)) * size for size in sizes)
    home = rotations(rng, 40)
    tree = subject_of(hp.HingePair(u1=u1, u2=u2, n=n, home=home)).tree_numbers
    columns = [
        list(tree.varied).index(place)
        for place in (*range(10, 19), *range(len(tree.numbers) - 12, len(tree.numbers) - 9))
    ]
    axes, origin = np.split(tree.samples[:, columns], [9], axis=1)
    with mpmath.workdps(DIGITS):
        axis, arm = unit(n), -(exactly(home) @ exactly(u2)[..., None])[..., 0]
        e2 = unit(np.cross(exactly(n), np.eye(3)[np.argmin(np.abs(n), axis=-1)]))
        exact = np.stack((np.cross(e2, axis), e2, axis), axis=-1)
        assert np.all(abs(exactly(axes) - exact.reshape(40, 9)) <= np.spacing(abs(axes)) * 0.5 + 1e-26)
        gap = exactly(origin) - (np.swapaxes(exact, -1, -2) @ arm[..., None])[..., 0]
        assert np.all(abs(gap) <= 8 * U * np.abs(u2).sum(axis=-1, keepdims=True))
