"""The hinge angle and its derivatives, recovered from two motions."""

from __future__ import annotations

import numpy as np

from support.hinged import bodies, made, only
from support.states import coordinates, generator
from support.states import pair as random_pair

U = 2.0**-53


def angle_between(a, b):
    """The difference without multiples of 2 pi, in float64."""
    gap = np.asarray(a) - b
    return abs(gap - 2 * np.pi * np.round(gap / (2 * np.pi)))


def test_psi_comes_back_from_every_angle():
    """Log-spaced away from 0 and from pi, to 8u: S1 and S2 hold no more."""
    away = 10.0 ** -np.arange(0, 18)
    psi = np.concatenate([[0.0, np.pi, -np.pi], away, -away, np.pi - away, away - np.pi, np.linspace(-3.1, 3.1, 40)])
    for key, home in ((0, None), (1, random_pair(generator(85, 9))[3])):
        q = coordinates(generator(90), len(psi))[0]
        q[:, 6] = psi
        pair = made(key, home=home)
        found = pair.residuals(*(only(b, "R", "S") for b in bodies(pair, (q, q, q))))
        assert angle_between(found.psi, psi).max() <= 12 * U
        assert abs(found.psi).max() <= np.pi
