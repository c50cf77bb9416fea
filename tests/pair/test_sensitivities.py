"""Sensitivities to the pair's constants and psi, against difference quotients in 60 digits."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest

import hingepair as hp
from hingepair.bench.truth import DIGITS, exactly, from_attitude, unit
from support.hinged import pair_of
from support.states import body1 as random_body
from support.states import generator
from support.states import pair as random_pair

U = 2.0**-53
COUNT = 8
STEP = 1e-20
"""Of 60 digits the quotient keeps 40; what it cuts off is of the order of STEP^2."""

HINGES = (1e-9, -1e-160, 3e-4, 0.7, np.pi, np.pi - 1e-9, -2.0, 1e5)


def truth(constants, motion, hinge):
    """Derivatives by name, each (N, values, components varied), of the reference's d, S2, v2, omega2."""
    u1, u2, n, home = constants
    psi, psid = hinge
    found = {}
    with mpmath.workdps(DIGITS):
        base = {"u1": exactly(u1), "u2": exactly(u2), "n": unit(n), "psi": exactly(psi)}
        for varied, value in base.items():
            quotients = {name: [] for name in ("d", "S2", "v2", "omega2")}
            for direction in [np.ones(())] if varied == "psi" else np.eye(3):
                sides = []
                for sign in (1, -1):
                    moved = base | {varied: value + exactly(direction * sign * STEP)}
                    pair = (moved["u1"], moved["u2"], moved["n"], home)
                    sides.append(from_attitude(pair, motion, moved["psi"], psid).values)
                for name, columns in quotients.items():
                    columns.append((sides[0][name] - sides[1][name]).reshape(COUNT, -1) / (2 * mpmath.mpf(STEP)))
            found |= {f"{name}_by_{varied}": np.stack(c, axis=-1).astype(float) for name, c in quotients.items()}
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    "kind", ["home", *(pytest.param(kind, marks=pytest.mark.slow) for kind in ("no_home", "axis_z", "u2_zero"))]
)
def test_derivatives_are_exact_and_those_left_out_are_zero(kind):
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
    found = pair.sensitivities(hp.BodyMotion(R=R, S=S, omega=omega), psi, psid)
    W = np.linalg.norm(omega, axis=-1) + abs(psid)
    size = {"d": 1 + 0 * W, "S2": 1 + 0 * W, "v2": W, "omega2": W}
    lever = 1 + np.linalg.norm(constants["u1"]) + np.linalg.norm(constants["u2"])
    for key, expected in truth(tuple(constants.values()), (R, S, v, omega, a, alpha), (psi, psid)).items():
        if not hasattr(found, key):
            assert abs(expected).max() <= STEP, key
            continue
        gap = abs(getattr(found, key).reshape(expected.shape) - expected).max(axis=(-2, -1))
        assert np.all(gap <= 16 * U * size[key.split("_")[0]] * lever), key


def test_shapes_levels_and_samples():
    pair = pair_of(random_pair(generator(101)))
    R, S, _, omega, _, _ = random_body(generator(102), 6)
    body1 = hp.BodyMotion(R=R, S=S, omega=omega)
    pose = pair.sensitivities(body1, np.linspace(0, 1, 6))
    assert (pose.v2_by_u1, pose.v2_by_psi, pose.omega2_by_n) == (None, None, None)
    assert (pose.S2_by_n.shape, pose.d_by_psi.shape) == ((6, 3, 3, 3), (6, 3))
    assert not pose.d_by_n.flags.writeable
    one = pair.sensitivities(hp.BodyMotion(R=R[3], S=S[3], omega=omega[3]), 0.6, 2.0)
    assert one.S2_by_n.shape == (3, 3, 3)
    assert abs(one.S2_by_n - pose.S2_by_n[3]).max() <= 8 * U
    grid = pair.sensitivities(body1, np.zeros((4, 1)), 1.0)
    assert grid.v2_by_n.shape == (4, 6, 3, 3)
    with pytest.raises(hp.ArgumentError, match=r"body1.omega: expected a value"):
        pair.sensitivities(hp.BodyMotion(R=R, S=S), 0.0, 1.0)
    with pytest.raises(hp.ShapeError, match="psid: expected leading shape"):
        pair.sensitivities(body1, 0.0, np.zeros(5))
