"""The constants that a pair makes of u1, u2, n and home: right to the last bit, at any size."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS, exactly, unit
from hingepair.mechanism.pairs.requests import constants_of
from hingepair.numeric.twofold import Twofold
from support.states import generator, rotations

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
def test_frames_of_the_hinge_are_rounded_once(case):
    """The axes e1, e2 and n of the tree; in these the vector from the hinge point to R2; and its parts in body 1."""
    sizes, rng = CASES[case], generator(80)
    u1, u2, n = (rng.normal(size=(40, 3)) * size for size in sizes)
    home = rotations(rng, 40)
    frames = constants_of(hp.HingePair(u1=u1, u2=u2, n=n, home=home)).frames
    with mpmath.workdps(DIGITS):
        axis, arm = unit(n), -(exactly(home) @ exactly(u2)[..., None])[..., 0]
        e2 = unit(np.cross(exactly(n), np.eye(3)[np.argmin(np.abs(n), axis=-1)]))
        axes = np.stack((np.cross(e2, axis), e2, axis), axis=-1)
        along = axis * (axis * arm).sum(axis=-1, keepdims=True)
        origin = (np.swapaxes(axes, -1, -2) @ arm[..., None])[..., 0]
        parts = {
            "axes": (axes.reshape(40, 9), frames.axes, 1.0),
            "origin": (origin, frames.frames[0][:3], sizes[1]),
            "fixed": (exactly(u1) + along, frames.frames[0][3:6], sizes[0] + sizes[1]),
            "turned": (np.hstack((arm - along, np.cross(axis, arm))), frames.frames[0][6:], sizes[1]),
        }
        for name, (value, found, size) in parts.items():
            computed = np.stack(np.broadcast_arrays(*(c.high for c in found)), axis=-1)
            rounding = np.spacing(abs(computed)) * 0.5 + 1e-26 * size
            assert np.all(abs(exactly(computed) - value) <= rounding), name


def test_numbers_of_twice_the_precision():
    a, b, c, d = generator(81).normal(size=(4, 200))
    found = (Twofold(a) * Twofold(b) - Twofold(c) * Twofold(d)) * (Twofold(a) + -Twofold(c))
    with mpmath.workdps(DIGITS):
        x, y, z, w = map(exactly, (a, b, c, d))
        error = abs(exactly(found.high) + exactly(found.low) - (x * y - z * w) * (x - z))
        size = (abs(x * y) + abs(z * w)) * (abs(x) + abs(z))
        assert np.all(error <= mpmath.mpf(2) ** -98 * size)
