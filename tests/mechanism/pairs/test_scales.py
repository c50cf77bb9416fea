"""The scales of the accuracy contract, and errors in their units."""

from __future__ import annotations

from hingepair.mechanism.pairs.accuracy import (
    PROMISED_BOUND_BY_OUTPUT,
    output_scales,
)


def test_scales_are_those_of_the_contract():
    given = {"u1": (3, 4, 0), "u2": (0, 0, -2), "R1": (1, -7, 2), "v1": (0.5, 0, -3), "a1": (11, 0, -13)}
    found = output_scales(**given, W1=2.0, A1=17.0, psid=-3.0, psidd=-19.0)
    W2, A2 = 5.0, 17 + 19 + 2 * 3.0
    expected = {
        "S1": 1,
        "S2": 1,
        "d": 7,
        "R2": 14,
        "omega1": 2,
        "omega2": W2,
        "v2": 3 + 2 * 5 + W2 * 2,
        "alpha1": 17,
        "alpha2": A2,
        "a2": 13 + (17 + 4) * 5 + (A2 + W2**2) * 2,
    }
    assert {name: float(value) for name, value in found.items()} == expected
    assert set(expected) == set(PROMISED_BOUND_BY_OUTPUT)
    spatial = output_scales(**given, W1=2.0, A1=17.0, psid=-3.0, psidd=-19.0, pinocchio=True)
    assert spatial["a2"] == expected["a2"] + (2 + 5) * 3 + 2 * 5 * 5
    assert spatial["alpha2"] == A2 + 9
