"""What `integrate`, its results and integrated scenes say of themselves, and of what they cannot use."""

from __future__ import annotations

import numpy as np
import pytest

import hingepair as hp
from support.spins import U

PAIR = hp.HingePair(u1=(0.3, -0.2, 0.5), u2=(0.1, 0.7, -0.4), n=(1, 2, -2))
T = np.linspace(0, 1, 11)


def test_a_callable_may_return_one_value_for_all_times():
    motion = hp.integrate(PAIR, T, lambda _: (1.0, 2.0, 3.0), lambda _: 0.5)
    same = hp.integrate(PAIR, T, (1.0, 2.0, 3.0), 0.5)
    np.testing.assert_allclose(motion.S2, same.S2, rtol=0, atol=8 * U)


@pytest.mark.parametrize("kind", [np.int64, "datetime64[ns]"])
def test_stamps_of_clocks_are_counted_from_the_first_without_rounding(kind):
    pair = hp.HingePair((1, 0, 0), (0, 1, 0), (0, 0, 1))
    steps = 10_000_000 + np.random.default_rng(3).integers(-3_000_000, 3_000_000, 200)
    stamps = (1_700_000_000_123_456_789 + np.cumsum(steps)).astype(kind)
    t = np.cumsum(steps) * 1e-9 - steps[0] * 1e-9
    omega1 = np.stack([np.sin(t), np.cos(2 * t), 0.5 * t], axis=-1)
    found, expected = (hp.integrate(pair, own, omega1, np.cos(t)) for own in (stamps, t))
    np.testing.assert_allclose(found.t, t, rtol=0, atol=8 * U)
    np.testing.assert_allclose(found.S1, expected.S1, rtol=0, atol=64 * U)
    with pytest.raises(hp.ArgumentError, match="t: expected instants that increase, got sample 3 the same stamp"):
        hp.integrate(pair, stamps[[0, 1, 2, 2, 4]], (0, 0, 1), 0.5)
