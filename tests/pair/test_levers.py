"""The constants that a pair makes of u1, u2, n and home: right to the last bit, at any size."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS, exactly, unit
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
def test_levers_are_rounded_once(case):
    sizes, rng = CASES[case], generator(80)
    u1, u2, n = (rng.normal(size=(40, 3)) * size for size in sizes)
    home = rotations(rng, 40)
    found = hp.HingePair(u1=u1, u2=u2, n=n, home=home).constants.arrays
    with mpmath.workdps(DIGITS):
        axis, arm = unit(n), (exactly(home) @ exactly(u2)[..., None])[..., 0]
        dot = (axis * arm).sum(axis=-1, keepdims=True)
        lever_cos = arm - axis * dot
        lever_sin = np.cross(axis, arm)
        exact = {"lever_cos": lever_cos, "lever_sin": lever_sin, "lever_fixed": exactly(u1) - axis * dot}
        for name, value in exact.items():
            size = max(sizes[:2]) if name == "lever_fixed" else sizes[1]
            rounding = np.spacing(abs(found[name])) * 0.5 + 1e-28 * size
            assert np.all(abs(exactly(found[name]) - value) <= rounding), name


def test_numbers_of_twice_the_precision():
    a, b, c, d = generator(81).normal(size=(4, 200))
    found = (Twofold(a) * Twofold(b) - Twofold(c) * Twofold(d)) * (Twofold(a) + -Twofold(c))
    with mpmath.workdps(DIGITS):
        x, y, z, w = map(exactly, (a, b, c, d))
        error = abs(exactly(found.high) + exactly(found.low) - (x * y - z * w) * (x - z))
        size = (abs(x * y) + abs(z * w)) * (abs(x) + abs(z))
        assert np.all(error <= mpmath.mpf(2) ** -98 * size)
