"""Derivatives of body 2's motion by u1, u2, n and psi, against difference quotients in 60 digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS, exactly, from_attitude, unit
from support.states import body1 as random_body
from support.states import generator
from support.states import pair as random_pair

U = 2.0**-53
COUNT = 8
STEP = 1e-20
"""Of 60 digits the quotient keeps 40; what it cuts off is of the order of STEP^2."""

HINGES = (1e-9, -1e-160, 3e-4, 0.7, np.pi, np.pi - 1e-9, -2.0, 1e5)


def truth(constants, motion, hinge):
    """Derivatives by output and what is varied, each (N, values, components varied), of the reference."""
    u1, u2, n, home = constants
    psi, psid = hinge
    found = {}
    with mpmath.workdps(DIGITS):
        base = {"u1": exactly(u1), "u2": exactly(u2), "n": unit(n), "psi": exactly(psi)}
        for varied, value in base.items():
            quotients = {name: [] for name in ("d", "v2", "omega2")}
            for direction in [np.ones(())] if varied == "psi" else np.eye(3):
                sides = []
                for sign in (1, -1):
                    moved = base | {varied: value + exactly(direction * sign * STEP)}
                    pair = (moved["u1"], moved["u2"], moved["n"], home)
                    sides.append(from_attitude(pair, motion, moved["psi"], psid).values)
                for name, columns in quotients.items():
                    columns.append((sides[0][name] - sides[1][name]).reshape(COUNT, -1) / (2 * mpmath.mpf(STEP)))
            found |= {(name, varied): np.stack(c, axis=-1).astype(float) for name, c in quotients.items()}
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", ["home", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("no_home", "axis_z", "u2_zero"))]
)
def test_derivatives_by_geometry_and_hinge_angle_are_exact(kind):
    rng = generator(100)
    changed = {
        "home": {},
        "no_home": {"home": None},
        "axis_z": {"n": np.array([0, 0, 2.0])},
        "u2_zero": {"u2": np.zeros(3)},
    }
    constants = dict(zip(("u1", "u2", "n", "home"), random_pair(rng), strict=True)) | changed[kind]
    motion, psi, psid = random_body(rng, COUNT), np.array(HINGES), rng.normal(size=COUNT)
    R, S, v, omega, a, alpha = motion
    pair = hp.HingePair(**constants)
    given = ("S1", "v1", "omega1", "psi", "psid")
    call = pair.prepare(given, outputs=("d", "v2", "omega2"))
    found = call.jacobian((S, v, omega, psi, psid), wrt=("u1", "u2", "n", "psi"))
    W = np.linalg.norm(omega, axis=-1) + abs(psid)
    size = {"d": 1 + 0 * W, "v2": W, "omega2": W}
    lever = 1 + np.linalg.norm(constants["u1"]) + np.linalg.norm(constants["u2"])
    for (output, varied), expected in truth(
        tuple(constants.values()), (R, S, v, omega, a, alpha), (psi, psid)
    ).items():
        gap = abs(found[output][varied].reshape(expected.shape) - expected).max(axis=(-2, -1))
        assert np.all(gap <= 16 * U * size[output] * lever), (output, varied)
